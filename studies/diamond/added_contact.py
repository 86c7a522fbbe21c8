"""What a contact between opposite grains does to the stability of the diamond."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from patterns.diamond import DiamondParameters as LoopParameters
from patterns.diamond import critical_strain
from stability import symmetric_spectrum
from studies.diamond.events import touching_strains
from studies.diamond.operators import operators
from studies.diamond.parameters import DiamondParameters
from studies.diamond.path import DiamondPath, follow
from studies.diamond.states import isotropic_states
from studies.diamond.table import path_table

Floats = NDArray[np.float64]
COLUMNS = (
    "stage", "regime", "E1", "E2", "s1", "s2", "lambda_1", "lambda_2", "det_K", "det_Ks",
    "chord_1", "chord_2",
)  # fmt: skip
SAMPLES = 401


def added_critical_strain(loop: LoopParameters, chords: tuple[bool, bool]) -> float:
    """Isotropic strain at which `det K` vanishes with contacts between opposite grains.

    From (40) with `1/tan(alpha0)` added to K11 and `tan(alpha0)` to K22. With both the strain is
    `(1 + kappa)/(2 + kappa)` whatever the angle: that of the triangle.

    Parameters
    ----------
    loop : patterns.diamond.DiamondParameters
        The diamond.
    chords : tuple of bool
        Whether there is a contact on axis 1, and on axis 2.

    Returns
    -------
    float

    Examples
    --------
    >>> from patterns.diamond import TABLE_2
    >>> from studies.diamond.added_contact import added_critical_strain
    >>> for chords in ((False, False), (False, True), (True, True)):
    ...     print(round(added_critical_strain(TABLE_2, chords), 6))
    0.193548
    0.426902
    0.553571
    """
    cos2, sin2 = np.cos(loop.alpha0) ** 2, np.sin(loop.alpha0) ** 2
    reserve = {
        (False, False): 0.0,
        (True, False): sin2 / (1.0 + cos2),
        (False, True): cos2 / (1.0 + sin2),
        (True, True): 1.0,
    }[chords]
    return float(critical_strain(loop.kappa + reserve))


def definite_intervals(loop: LoopParameters, *, added: bool) -> list[tuple[float, float]]:
    """Isotropic strains over which Ks is positive definite.

    Parameters
    ----------
    loop : patterns.diamond.DiamondParameters
        The diamond.
    added : bool
        Whether opposite grains make contacts when they meet.

    Returns
    -------
    list of (float, float)
        In rising order; touching intervals are joined.

    Examples
    --------
    >>> from patterns.diamond import TABLE_1
    >>> from studies.diamond.added_contact import definite_intervals
    >>> [(round(a, 4), round(b, 4)) for a, b in definite_intervals(TABLE_1, added=True)]
    [(0.0, 0.1667), (0.2929, 0.5455)]
    """
    touching = touching_strains(loop)
    meetings = sorted(set(touching)) if added else []
    bounds = [0.0, *(E for E in meetings if E > 0.0), 1.0]
    found: list[tuple[float, float]] = []
    for start, end in pairwise(bounds):
        chords = (added and touching[0] <= start, added and touching[1] <= start)
        end = min(end, added_critical_strain(loop, chords))
        if end <= start:
            continue
        joined = found and found[-1][1] == start
        found[-1:] = [(found[-1][0], end)] if joined else [*found[-1:], (start, end)]
    return found


def isotropic_eigenvalues(loop: LoopParameters, *, added: bool) -> tuple[Floats, Floats]:
    """Eigenvalues of Ks under isotropic strain, on beyond A until both diamonds have lost it.

    Parameters
    ----------
    loop : patterns.diamond.DiamondParameters
        The diamond.
    added : bool
        Whether opposite grains make contacts when they meet.

    Returns
    -------
    E : ndarray (n,)
        Strains.
    eigenvalues : ndarray (n, 2)
        Ascending; NaN between two strains where a contact comes in.
    """
    touching = touching_strains(loop)
    last = 1.05 * definite_intervals(loop, added=True)[-1][1]
    meetings = sorted({E for E in touching if 0.0 < E < last}) if added else []
    bounds, strains, eigenvalues = [0.0, *meetings, last], [], []
    for start, end in pairwise(bounds):
        E = np.linspace(start, end, SAMPLES)
        chords = (added and touching[0] <= start, added and touching[1] <= start)
        found = operators(loop, isotropic_states(loop, E, chords))
        strains += [E, np.full(1, np.nan)]
        eigenvalues += [symmetric_spectrum(found.K), np.full((1, 2), np.nan)]
    return np.concatenate(strains), np.concatenate(eigenvalues)


def ignored_and_added(path: DiamondPath) -> dict[str, DiamondPath]:
    """The same programme with opposite grains ignored and with contacts added.

    Parameters
    ----------
    path : DiamondPath
        With contacts added.

    Returns
    -------
    dict of str to DiamondPath
        'ignored' and 'added'.
    """
    return {"ignored": follow(replace(path.parameters, contact_on_touch="ignore")), "added": path}


def added_table(path: DiamondPath) -> dict[str, Any]:
    """Table of both paths, one below the other.

    Parameters
    ----------
    path : DiamondPath
        With contacts added.

    Returns
    -------
    dict of str to array
        `opposite`, 'ignored' or 'added', and columns of `path_table`.
    """
    tables = {name: path_table(one) for name, one in ignored_and_added(path).items()}
    names = [np.full(len(table["E1"]), name) for name, table in tables.items()]
    columns = {key: np.concatenate([table[key] for table in tables.values()]) for key in COLUMNS}
    return {"opposite": np.concatenate(names), **columns}


def added_summary(parameters: DiamondParameters) -> dict[str, Any]:
    """Strains between which the diamond is stable under isotropic strain, without and with.

    Parameters
    ----------
    parameters : DiamondParameters
        What was asked.

    Returns
    -------
    dict
        `definite_ignored`, `definite_added`: intervals of isotropic strain; `touching_strains`.
    """
    loop = parameters.loop()
    return {
        "touching_strains": list(touching_strains(loop)),
        "definite_ignored": definite_intervals(loop, added=False),
        "definite_added": definite_intervals(loop, added=True),
    }
