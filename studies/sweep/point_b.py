"""Point B of one diamond: as a user would integrate it, and in many digits."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Floats = NDArray[np.float64]
Row = tuple[float, float, float, float]

# Ranges of the draw; angles in degrees.
RANGES = {
    "alpha0": (5.0, 85.0),
    "kappa": (0.05, 1.5),
    "phi": (1.0, 35.0),
    "confinement": (1e-4, 0.5),
}
DIGITS = 25
# Short of the strain at which the diamond has folded.
LAST_STRAIN = 1.0 - 1e-9


class PointB(NamedTuple):
    """Strains and axial stress at yield."""

    E1: float
    E2: float
    s1: float


def random_diamonds(count: int, seed: int) -> Floats:
    """Random diamonds, uniform over `RANGES`.

    Parameters
    ----------
    count : int
        How many.
    seed : int
        Seed.

    Returns
    -------
    diamonds : ndarray (count, 4)
        `alpha0, kappa, phi, confinement`; radians.

    Examples
    --------
    >>> random_diamonds(3, seed=1).shape
    (3, 4)
    """
    low, high = np.array(list(RANGES.values())).T
    drawn = np.random.default_rng(seed).uniform(low, high, (count, 4))
    drawn[:, [0, 2]] = np.radians(drawn[:, [0, 2]])
    return drawn


def point_b_by_steps(diamond: Row, method: str, rtol: float) -> PointB | None:
    """Point B as a user would integrate it, one path at a time.

    Parameters
    ----------
    diamond : tuple
        `alpha0, kappa, phi, confinement`; radians.
    method : str
        Of `scipy.integrate.solve_ivp`.
    rtol : float
        Relative tolerance; the absolute one is a thousandth of it.

    Returns
    -------
    PointB or None
        None if the contacts don't yield before the diamond folds, `E1 = 1`.

    Examples
    --------
    >>> B = point_b_by_steps((np.pi / 4, 0.2, np.radians(5.0), 0.3), "DOP853", 1e-10)
    >>> round(B.E1, 8), round(B.s1, 8)
    (0.40973435, 0.2540099)
    """
    alpha0, kappa, phi, E = diamond
    t0, sin0, cos0, mu = math.tan(alpha0), math.sin(alpha0), math.cos(alpha0), math.tan(phi)
    s2 = E * t0

    # Plain floats: half the time of numpy's scalars.
    def rates(E1: float, y: Floats) -> tuple[float, float]:
        E1, (E2, s1) = float(E1), y.tolist()
        t = t0 * (1.0 - E2) / (1.0 - E1)
        cos2, p1, p2 = 1.0 / (1.0 + t * t), s1 / (1.0 - E2), s2 / (1.0 - E1)
        K22 = cos2 * (t * t + kappa - t * p1) * t0
        K21 = cos2 * ((1.0 - kappa) * t + t * t * p1)
        return -K21 / K22, (kappa - cos2 * t * (p2 + p1)) / K22

    def friction(E1: float, y: Floats) -> float:
        E1, (E2, s1) = float(E1), y.tolist()
        a = math.atan2((1.0 - E2) * sin0, (1.0 - E1) * cos0)
        N = s1 * sin0 * math.cos(a) + s2 * cos0 * math.sin(a)
        return mu * N - abs(s1 * sin0 * math.sin(a) - s2 * cos0 * math.cos(a))

    friction.terminal = True  # type: ignore[attr-defined]
    start, atol = np.array([E, E / t0]), 1e-3 * rtol
    found = solve_ivp(rates, (E, LAST_STRAIN), start, method, events=friction, rtol=rtol, atol=atol)
    if found.status != 1:
        return None
    return PointB(float(found.t_events[0][0]), *map(float, found.y_events[0][0]))


def exact_point_b(diamond: Row, alpha: float, direction: int) -> PointB:
    """Point B from the quadrature of the theory note (section 5) in 25 digits.

    Parameters
    ----------
    diamond : tuple
        `alpha0, kappa, phi, confinement`; radians.
    alpha : float
        Guess of the branch angle at yield.
    direction : int
        +1 where alpha grows, -1 where it falls.

    Returns
    -------
    PointB
        Rounded to float64.

    Examples
    --------
    >>> exact_point_b((np.pi / 4, 0.2, np.radians(5.0), 0.3), 0.9561, 1).E1.__round__(14)
    0.40973434897033
    """
    from mpmath import mp, mpf

    with mp.workdps(DIGITS):
        a0, k, phi, E = map(mpf, diamond)
        f, mu = E * mp.sin(a0), direction * mp.tan(phi)

        def forces(a: Any) -> tuple[Any, Any]:
            def swept(b: Any) -> Any:
                return (mp.sin(b) / mp.sin(a)) ** k * (1 - f * mp.sin(b)) / mp.cos(b) ** 2

            start = (1 - E) * mp.tan(a0) * (mp.sin(a0) / mp.sin(a)) ** k
            N = 1 - (start + mp.quad(swept, [a0, a])) / mp.tan(a)
            return N, (N * mp.sin(a) - f) / mp.cos(a)

        def excess(a: Any) -> Any:
            N, T = forces(a)
            return T - mu * N

        guess = mpf(alpha)
        nearby = guess + (guess - a0) * mpf("1e-9")
        a = mp.findroot(excess, (guess, nearby), tol=mp.eps**1.5)
        N, T = forces(a)
        E1 = 1 - (1 - N) * mp.cos(a) / mp.cos(a0)
        E2 = 1 - (1 - N) * mp.sin(a) / mp.sin(a0)
        s1 = (N * mp.cos(a) + T * mp.sin(a)) / mp.sin(a0)
        return PointB(float(E1), float(E2), float(s1))
