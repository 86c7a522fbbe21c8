"""The numbers of the page on larger loops, every one computed anew."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from loops import HertzMindlin, LinearFrictional, RollingResistance
from loops.closures import Closure, Spins
from studies.polygon.comparison import Compared, ComparisonParameters, compare
from studies.polygon.parameters import PolygonParameters
from studies.polygon.path import follow_polygon
from studies.polygon.thresholds import critical_strain

KAPPA = 0.3
LONGER = (5, 6, 8, 12)
ROLLING = (0.003, 0.03, 0.3)
POISSON = (0.0, 0.3, 0.5)
BEYOND = 0.01


def stable_threshold(kappa: float) -> float:
    """`(1 + kappa)/(2 + kappa)`: the normal stiffness helps.

    Parameters
    ----------
    kappa : float
        Stiffness ratio.

    Returns
    -------
    float
    """
    return (1.0 + kappa) / (2.0 + kappa)


def diamond_threshold(kappa: float) -> float:
    """`kappa/(1 + kappa)`: the shear stiffness is alone.

    Parameters
    ----------
    kappa : float
        Stiffness ratio.

    Returns
    -------
    float
    """
    return kappa / (1.0 + kappa)


# Closure, spins, and for n = 3, 4 and more: the threshold in words and as a function.
Threshold = tuple[str, Callable[[float], float]]
STABLE: Threshold = ("(1 + κ)/(2 + κ)", stable_threshold)
DIAMOND: Threshold = ("κ/(1 + κ)", diamond_threshold)
HALF: Threshold = ("1/2", lambda kappa: 0.5)
NONE: Threshold = ("0: the first load", lambda kappa: 0.0)
TABLE: tuple[tuple[Closure, Spins, tuple[Threshold, Threshold, Threshold]], ...] = (
    ("affine", "blocked", (STABLE, DIAMOND, STABLE)),
    ("traction", "blocked", (STABLE, DIAMOND, DIAMOND)),
    ("traction", "free", (HALF, DIAMOND, NONE)),
)


def collect() -> dict[str, Any]:
    """Everything that the page tells and draws, but the measured times.

    Returns
    -------
    dict
        `table`, `square`, `full`, `hertz`, `rolling`: rows; `compared`: paths of orders 3 to 12
        by closure.
    """
    return {
        "table": [row for entry in TABLE for row in _cells(*entry)],
        "square": _square(),
        "full": _full(),
        "hertz": _hertz(),
        "rolling": _rolling(),
        "compared": {closure: compared(closure) for closure in ("affine", "traction")},
    }


def path_threshold(order: int, closure: Closure, spins: Spins, end: float) -> float | None:
    """Strain of the first loss of Ks in (11, 22) on an isotropic path.

    Parameters
    ----------
    order : int
        Number of grains.
    closure, spins : str
        See `stability.follow`.
    end : float
        Strain where the path ends.

    Returns
    -------
    float or None
        0 where Ks is not definite at the first state beyond the unloaded one; None where there is
        no loss on the way.

    Examples
    --------
    >>> round(path_threshold(5, "traction", "blocked", 0.25), 10)
    0.2307692308
    """
    parameters = PolygonParameters(
        order,
        kappa=KAPPA,
        phi_deg=90.0,
        closure=closure,
        spins=spins,
        confine=0.0,
        programme="isotropic",
        end=end,
    )
    path = follow_polygon(parameters, ("diagonal",)).path
    events = path.of_kind("det_Ks_zero")
    loaded = np.flatnonzero(path.H[:, 0] > 0.0)
    if len(loaded) and path.symmetric_eigenvalues[loaded[0], 0] < 0.0:
        return 0.0
    return float(path.H[events[0].index, 0]) if events else None


def compared(closure: Closure) -> Compared:
    """Drained paths of orders 3 to 12.

    Parameters
    ----------
    closure : {'affine', 'traction'}
        How the loops are driven.

    Returns
    -------
    Compared
    """
    shared = PolygonParameters(3, closure=closure, kappa=KAPPA, phi_deg=20.0, confine=0.1, end=0.5)
    return compare(ComparisonParameters(tuple(range(3, 13)), shared))


def _cells(
    closure: Closure, spins: Spins, thresholds: tuple[Threshold, Threshold, Threshold]
) -> list[dict[str, Any]]:
    rows = []
    law = LinearFrictional(kn=1.0, kt=KAPPA)
    for orders, (words, threshold) in zip(((3,), (4,), LONGER), thresholds, strict=True):
        wanted = threshold(KAPPA)
        found = [path_threshold(n, closure, spins, wanted + BEYOND) for n in orders]
        roots = [critical_strain(n, law, closure, spins) for n in orders]
        rows.append(
            {
                "closure": closure,
                "spins": spins,
                "orders": orders,
                "words": words,
                "expected": wanted,
                "path": found[0],
                "path_error": _worst(found, wanted),
                "root_error": _worst(roots, wanted),
            }
        )
    return rows


def _worst(found: list[float | None], wanted: float) -> float:
    """Largest difference; NaN if a threshold was not found."""
    values = np.array([np.nan if value is None else value for value in found])
    return float(np.max(np.abs(values - wanted)))


def _square() -> dict[str, float | None]:
    law = LinearFrictional(kn=1.0, kt=KAPPA)
    return {
        subspace: critical_strain(4, law, "traction", "blocked", subspace, "edge")
        for subspace in ("diagonal", "symmetric")
    }


def _full() -> float:
    """Largest difference of the full form's threshold from `kappa/(1 + kappa)`, n = 3 to 12."""
    law = LinearFrictional(kn=1.0, kt=KAPPA)
    closures: tuple[Closure, Closure] = ("affine", "traction")
    found = [
        critical_strain(n, law, closure, "blocked", "full")
        for closure in closures
        for n in range(3, 13)
    ]
    return _worst(found, diamond_threshold(KAPPA))


def _hertz() -> list[dict[str, Any]]:
    rows = []
    for poisson in POISSON:
        law = HertzMindlin(young=1.0, poisson=poisson)
        kappa = float(law.stiffness_ratio)
        found = [critical_strain(n, law, "traction") for n in (4, *LONGER)]
        wanted = kappa / (kappa + 2.0 / 3.0)
        rows.append(
            {
                "poisson": poisson,
                "kappa": kappa,
                "found": found[0],
                "linear": diamond_threshold(kappa),
                "error": _worst(found, wanted),
            }
        )
    return rows


def rolling_threshold(order: int, kappa: float, k_r: float) -> float:
    """Root of `E/(1 - E) = kt'/kn`, `1/kt' = 1/kt + l^2 cot^2(2 pi/n)/(4 k_r)`, `l = 1 - E`.

    Parameters
    ----------
    order : int
        Five or more grains.
    kappa : float
        Stiffness ratio.
    k_r : float
        Rolling stiffness over `kn l0^2`, positive.

    Returns
    -------
    float

    Examples
    --------
    >>> round(rolling_threshold(6, 0.3, 1e9), 9) == round(0.3 / 1.3, 9)
    True
    """
    turn = 1.0 / np.tan(2.0 * np.pi / order) ** 2 / 4.0
    # With l = 1 - E, E = 1 - l: (1 - l)(1/kappa + turn l^2/k_r) = l, a cubic in l.
    a = turn / k_r
    roots = np.roots([-a, a, -1.0 / kappa - 1.0, 1.0 / kappa])
    real = roots[np.abs(roots.imag) < 1e-9].real
    return float(1.0 - real[(real > 0.0) & (real < 1.0)].max())


def _rolling() -> list[dict[str, Any]]:
    rows = []
    for k_r in ROLLING:
        law = RollingResistance(LinearFrictional(kn=1.0, kt=KAPPA), k_r=k_r)
        found = {n: critical_strain(n, law, "traction", "free") for n in LONGER}
        wanted = {n: rolling_threshold(n, KAPPA, k_r) for n in LONGER}
        errors = [abs((found[n] or np.nan) - wanted[n]) for n in LONGER]
        rows.append({"k_r": k_r, "found": found, "error": float(max(errors))})
    return rows
