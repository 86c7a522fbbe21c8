"""Contacts added between opposite grains of a diamond: its stability under isotropic strain."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from loops.arrays import Floats
from patterns.diamond import DiamondParameters, critical_strain
from stability import symmetric_spectrum
from studies.paths.diamond import touching_strains
from studies.paths.states import operators, states_at

SAMPLES = 401


def added_summary(loop: DiamondParameters) -> dict[str, Any]:
    """Strains between which the diamond is stable under isotropic strain, without and with."""
    return {
        "touching_strains": list(touching_strains(loop)),
        "definite_ignored": definite_intervals(loop, added=False),
        "definite_added": definite_intervals(loop, added=True),
    }


def added_critical_strain(loop: DiamondParameters, added: tuple[bool, bool]) -> float:
    """Isotropic strain at which `det K` vanishes with contacts on axis 1, on axis 2.

    From (40) with `1/tan(alpha0)` added to K11 and `tan(alpha0)` to K22. With both it is
    `(1 + kappa)/(2 + kappa)` whatever the angle: that of the triangle.
    """
    cos2, sin2 = np.cos(loop.alpha0) ** 2, np.sin(loop.alpha0) ** 2
    reserve = {
        (False, False): 0.0,
        (True, False): sin2 / (1.0 + cos2),
        (False, True): cos2 / (1.0 + sin2),
        (True, True): 1.0,
    }[added]
    return float(critical_strain(loop.kappa + reserve))


def definite_intervals(loop: DiamondParameters, *, added: bool) -> list[tuple[float, float]]:
    """Isotropic strains over which Ks is positive definite, in rising order."""
    found: list[tuple[float, float]] = []
    for start, end, contacts in _between_meetings(loop, 1.0, added):
        end = min(end, added_critical_strain(loop, contacts))
        if end > start:
            joined = found and found[-1][1] == start
            found[-1:] = [(found[-1][0], end)] if joined else [*found[-1:], (start, end)]
    return found


def isotropic_eigenvalues(loop: DiamondParameters, *, added: bool) -> tuple[Floats, Floats]:
    """Strains (n,) and eigenvalues of Ks (n, 2) under isotropic strain until both have lost it.

    NaN between two strains where a contact comes in.
    """
    last = 1.05 * definite_intervals(loop, added=True)[-1][1]
    strains, eigenvalues = [], []
    for start, end, contacts in _between_meetings(loop, last, added):
        E = np.linspace(start, end, SAMPLES)
        K = operators(loop, states_at(loop, E, E, added=contacts)).K
        strains += [E, np.full(1, np.nan)]
        eigenvalues += [symmetric_spectrum(K), np.full((1, 2), np.nan)]
    return np.concatenate(strains), np.concatenate(eigenvalues)


def _between_meetings(
    loop: DiamondParameters, last: float, added: bool
) -> list[tuple[float, float, tuple[bool, bool]]]:
    """Parts of the isotropic path, and the contacts that opposite grains share on each."""
    on1, on2 = touching_strains(loop)
    meetings = sorted({E for E in (on1, on2) if 0.0 < E < last}) if added else []
    return [
        (start, end, (added and on1 <= start, added and on2 <= start))
        for start, end in pairwise([0.0, *meetings, last])
    ]
