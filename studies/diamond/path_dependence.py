"""The paper's Fig. 4: work on one contact along two routes, in closed form and by integration."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from patterns.diamond import DiamondParameters as LoopParameters
from patterns.diamond.geometry import work_compress_then_shear, work_shear_then_compress

Floats = NDArray[np.float64]
Leg = Literal["shear", "compress"]
ROUTES: dict[str, tuple[Leg, Leg]] = {
    "shear_then_compress": ("shear", "compress"),
    "compress_then_shear": ("compress", "shear"),
}
# Compression where the study has no confinement to take it from.
COMPRESSION, LAST_ANGLE = 0.2, np.pi / 4


def path_dependence_table(loop: LoopParameters, angles: int = 46) -> dict[str, Floats]:
    """Work along both routes over the turn of the branch, `kn = l0 = 1`.

    Parameters
    ----------
    loop : patterns.diamond.DiamondParameters
        Gives `kt = kappa` and the compression `D`, its confinement.
    angles : int
        Number of angles from 0 to 45 degrees.

    Returns
    -------
    dict of str to ndarray (angles,)
        `alpha_deg`, `compression`; `shear_then_compress` (9) and `compress_then_shear` (10), each
        also `_integrated` from the rate law (8).

    Examples
    --------
    >>> from patterns.diamond import TABLE_1
    >>> from studies.diamond.path_dependence import path_dependence_table
    >>> table = path_dependence_table(TABLE_1, 2)
    >>> table["shear_then_compress"].round(6).tolist()
    [0.045, 0.106685]
    """
    D = compression(loop)
    alpha = np.linspace(0.0, LAST_ANGLE, angles)
    closed = {
        "shear_then_compress": work_shear_then_compress(1.0, alpha, D, 1.0, loop.kappa),
        "compress_then_shear": work_compress_then_shear(1.0, alpha, D, 1.0, loop.kappa),
    }
    integrated = {
        f"{route}_integrated": np.array([route_work(loop.kappa, a, D, route) for a in alpha])
        for route in ROUTES
    }
    return {
        "alpha_deg": np.degrees(alpha),
        "compression": np.full(angles, D),
        **closed,
        **integrated,
    }


def compression(loop: LoopParameters) -> float:
    """Compression `D` of the figure over `l0`: the confinement, where there is one.

    Parameters
    ----------
    loop : patterns.diamond.DiamondParameters
        The diamond.

    Returns
    -------
    float
    """
    return loop.confinement or COMPRESSION


def route_work(kappa: float, alpha: float, D: float, route: str) -> float:
    """Work along a route by integrating the rate law (8a), (8b), `kn = l0 = 1`.

    Parameters
    ----------
    kappa : float
        Stiffness ratio `kt/kn`.
    alpha, D : float
        Turn of the branch in radians, and its shortening.
    route : {'shear_then_compress', 'compress_then_shear'}
        Which comes first.

    Returns
    -------
    float

    Examples
    --------
    >>> from studies.diamond.path_dependence import route_work
    >>> round(route_work(4.0 / 3.0, 0.5, 0.5, "shear_then_compress"), 9)
    0.291666667
    """
    y = np.array([1.0, 0.0, 0.0, 0.0])
    for leg in ROUTES[route]:
        rates = (0.0, alpha) if leg == "shear" else (-D, 0.0)

        def slope(_: float, y: Floats, rates: tuple[float, float] = rates) -> list[float]:
            length, N, T, _work = y
            stretching, arc = rates[0], length * rates[1]
            return [stretching, -stretching, kappa * arc, -N * stretching + T * arc]

        y = solve_ivp(slope, (0.0, 1.0), y, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    return float(y[-1])
