"""The exact drained biaxial path of one diamond (Nicot et al. 2016, Figs. 6 and 8).

From the confined state A (isotropic strain, `T = 0`) `E1` grows under constant `s2`. The elastic
part is a quadrature, the sliding part is algebraic, `N = f/(sin a - s mu cos a)` with
`f = F2/(2 kn l0)`. The path is given over the turn `alpha - alpha0`, which determines the state and
keeps its digits at stiff grains. Lengths over `l0`, forces over `kn l0`, radians.

Balance (12) gives `N = (T cos a + f)/sin a`, and `T' = kappa l` becomes
`(T sin^kappa a)' = kappa sin^(kappa - 1) a (sin a - f)`. Over `v = ln tan(a/2)`, `da = sin a dv`,
the integrand is analytic in a strip of half-width pi/2 whatever the angles.

Where alpha grows, yield `T = mu N` reads `T sin(alpha - phi) = f sin(phi)`. The left side rises
from the larger of `alpha0` and `phi` on: at most one root. With `K22 < 0` at A alpha falls; then N
and E1 grow all the way. Where alpha grows K22 can reach zero, the limit of strain control, only
if `kappa > 3`: there `T >= 3 l tan(alpha)`, while balance keeps `T < kappa l tan(alpha)`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from tests.oracles.diamond import DiamondParameters

Floats = NDArray[np.float64]
# Over a span of 20 of `v`, a diamond of 1e-7 degrees opened to 90: error 1.17^-256 = 3e-18.
NODES, WEIGHTS = np.polynomial.legendre.leggauss(128)
# Turns among which the first change of sign is looked for.
SAMPLES = 256
EPS = np.finfo(float).eps


@dataclass(frozen=True, eq=False)
class DrainedState:
    """States of a diamond under constant `s2`; arrays (...); T positive when alpha grows."""

    E1: Floats
    E2: Floats
    length: Floats
    alpha: Floats
    turn: Floats
    N: Floats
    T: Floats
    s1: Floats
    s2: Floats


@dataclass(frozen=True, eq=False)
class DrainedPath:
    """A drained biaxial path and its events.

    `status`: 'yield', where all four contacts reach `|T| = mu N`, point B; 'opening', where without
    confinement and with `phi <= alpha0` the contacts never carry force, and the state is A;
    'limit', where K22 vanishes before yield and `E1` cannot grow on; 'none', no event before alpha
    reaches 90 degrees or the grains' centres meet. `direction`: +1 where alpha grows, -1 where it
    falls. `confined`, `end`: state A, and the end of the elastic part, NaN if none. `snaps_back`:
    whether `E1` stops growing at the end; the states beyond B then need another control than `E1`.
    `stick_angle`: where sliding contacts of a falling alpha stick again; NaN if they slide on.
    """

    parameters: DiamondParameters
    status: str
    direction: int
    confined: DrainedState
    end: DrainedState
    snaps_back: bool
    stick_angle: float


def drained_path(parameters: DiamondParameters) -> DrainedPath:
    """Follow a diamond's drained biaxial path to the end of its elastic part."""
    p = parameters
    f, zero = lateral_force(p), np.array(0.0)
    direction = -1 if turning_stiffness(p.alpha0, f, zero, p.kappa) < 0.0 else 1
    if p.confinement == 0.0 and (p.phi <= p.alpha0 or p.kappa == 0.0):
        status, turn = "opening", 0.0
    else:
        turn = yield_turn(p, direction)
        status = "none" if np.isnan(turn) else "yield"
        limit = strain_limit(p, turn) if direction > 0 else np.nan
        if np.isfinite(limit):
            status, turn = "limit", limit
    end = drained_state(p, turn, elastic_shear(p, p.alpha0, 0.0, turn))
    snaps_back = status == "limit"
    if status == "yield":
        # K22 of the sliding contacts at B has another sign than on the elastic path.
        sliding = -direction * p.mu * np.tan(end.alpha)
        snaps_back = bool(direction * turning_stiffness(end.alpha, f, end.T, sliding) < 0.0)
    sticks = status == "yield" and direction < 0
    return DrainedPath(
        parameters=p,
        status=status,
        direction=direction,
        confined=drained_state(p, zero, zero),
        end=end,
        snaps_back=snaps_back,
        stick_angle=stick_angle(p, float(end.alpha)) if sticks else float("nan"),
    )


def lateral_force(p: DiamondParameters) -> float:
    """`f = F2/(2 kn l0)`."""
    return p.confinement * np.sin(p.alpha0)


def drained_state(p: DiamondParameters, turn: ArrayLike, T: ArrayLike) -> DrainedState:
    """State at the turn `alpha - alpha0` with shear force `T`, in terms that don't cancel."""
    turn, T, f = np.asarray(turn), np.asarray(T), lateral_force(p)
    cos0, sin0 = np.cos(p.alpha0), np.sin(p.alpha0)
    fall = 2.0 * np.sin(p.alpha0 + 0.5 * turn) * np.sin(0.5 * turn) / cos0
    rise = 2.0 * np.cos(p.alpha0 + 0.5 * turn) * np.sin(0.5 * turn) / sin0
    cos, sin = cos0 * (1.0 - fall), sin0 * (1.0 + rise)
    N = (T * cos + f) / sin
    return DrainedState(
        E1=N + fall * (1.0 - N),
        E2=N - rise * (1.0 - N),
        length=1.0 - N,
        alpha=p.alpha0 + turn,
        turn=turn,
        N=N,
        T=T,
        s1=(T + f * cos) / (sin * sin0),
        s2=p.confinement * np.tan(p.alpha0) + 0.0 * N,
    )


def turning_stiffness(alpha: ArrayLike, f: float, T: Floats, lambda2: ArrayLike) -> Floats:
    """`K22/tan(alpha0)`: positive where, under constant `s2`, `E1` grows with the angle."""
    cos, sin = np.cos(alpha), np.sin(alpha)
    length = 1.0 - (T * cos + f) / sin
    return sin**2 + lambda2 * cos**2 - cos * (T + f * cos) / sin / length


def elastic_shear(p: DiamondParameters, start: float, T: float, turn: ArrayLike) -> Floats:
    """Shear force after turns (...) from the angle `start`, where it was `T`.

    Integrates `(sin b / sin(start + turn))^kappa (sin b - f) dv` over `v = ln tan(b/2)`.
    """
    turn = np.asarray(turn, dtype=float)
    span = np.log1p(np.sin(0.5 * turn) / (np.cos(0.5 * (start + turn)) * np.sin(0.5 * start)))
    half = np.tan(0.5 * start) * np.exp(0.5 * span[..., None] * (1.0 + NODES))
    sin, sin_end = 2.0 * half / (1.0 + half**2), np.sin(start + turn)
    integrand = (sin / sin_end[..., None]) ** p.kappa * (sin - lateral_force(p))
    integral = 0.5 * p.kappa * span * (integrand @ WEIGHTS)
    return T * (np.sin(start) / sin_end) ** p.kappa + integral


def first_root(values: Callable[[Floats], Floats], turns: Floats) -> float:
    """First zero of what is not negative at the first of these turns; NaN where there is none."""
    below = np.flatnonzero(values(turns) < 0.0)
    if len(below) == 0:
        return float("nan")
    return float(brentq(values, *turns[below[0] - 1 : below[0] + 1], xtol=1e-300, rtol=4 * EPS))


def yield_turn(p: DiamondParameters, direction: int) -> float:
    """Turn at which the contacts yield; NaN where they never do."""
    if p.phi == 0.0 or p.phi == 0.5 * np.pi:
        return 0.0 if p.phi == 0.0 else float("nan")
    f = lateral_force(p)

    def margin(turn: Floats) -> Floats:
        """`N - |T|/mu`, times `sin(alpha) sin(phi)`; it ends where the grains' centres meet."""
        T, alpha = elastic_shear(p, p.alpha0, 0.0, turn), p.alpha0 + turn
        left = f * np.sin(p.phi) - direction * T * np.sin(alpha - direction * p.phi)
        return np.where(T * np.cos(alpha) + f < np.sin(alpha), left, np.inf)

    first = max(p.phi - p.alpha0, 0.0) if direction > 0 else 0.0
    last = 0.5 * np.pi - p.alpha0 if direction > 0 else -p.alpha0 * (1.0 - EPS)
    return first_root(margin, np.linspace(first, last, SAMPLES))


def strain_limit(p: DiamondParameters, turn: float) -> float:
    """Turn of the first `K22 = 0` before `turn` (90 degrees if NaN); NaN where there is none."""

    def stiffness(turn: Floats) -> Floats:
        T = elastic_shear(p, p.alpha0, 0.0, turn)
        return turning_stiffness(p.alpha0 + turn, lateral_force(p), T, p.kappa)

    last = 0.5 * np.pi - p.alpha0 if np.isnan(turn) else turn
    return first_root(stiffness, np.linspace(0.0, last, SAMPLES)) if p.kappa > 3 else float("nan")


def sliding_shear(path: DrainedPath, alpha: Floats) -> Floats:
    """`T = s mu N` with `N = f/(sin a - s mu cos a)`; zero without lateral force."""
    p, s = path.parameters, path.direction
    force = lateral_force(p) * np.sin(p.phi)
    return s * force / np.sin(alpha - s * p.phi) if force > 0.0 else np.zeros_like(alpha)


def stick_angle(p: DiamondParameters, alpha_B: float) -> float:
    """Angle where slip of falling alpha stops, `kappa l = mu N cot(alpha + phi)`; NaN if none."""
    f = lateral_force(p)

    def slip(theta: float) -> float:
        stiff = p.kappa * (np.sin(theta) - f * np.cos(p.phi)) * np.sin(theta)
        return float(stiff - f * np.sin(p.phi) * np.cos(theta))

    theta_B = alpha_B + p.phi
    last = max(p.phi, float(np.arcsin(f * np.cos(p.phi))))
    if slip(theta_B) <= 0.0:
        return alpha_B
    return brentq(slip, last, theta_B, xtol=1e-16) - p.phi if slip(last) < 0.0 else float("nan")


def drained_states(path: DrainedPath, alpha: ArrayLike) -> tuple[DrainedState, NDArray[np.str_]]:
    """States where the branch stands at `alpha`, and their regimes."""
    return drained_states_after_turn(path, np.asarray(alpha) - path.parameters.alpha0)


def drained_states_after_turn(
    path: DrainedPath, turn: ArrayLike
) -> tuple[DrainedState, NDArray[np.str_]]:
    """States after turns (...) in the path's direction; 'elastic', 'sliding', 'open'.

    At B itself the state is still elastic.
    """
    p, turn = path.parameters, np.asarray(turn, dtype=float)
    if path.status == "opening":
        return drained_state(p, turn, np.zeros_like(turn)), np.full(turn.shape, "open")
    past_yield = (turn - path.end.turn) * path.direction > 0.0
    stick = path.stick_angle - p.alpha0
    stuck = (turn - stick) * path.direction > 0.0
    T = np.where(
        past_yield,
        sliding_shear(path, p.alpha0 + turn),
        elastic_shear(p, p.alpha0, 0.0, np.where(past_yield, 0.0, turn)),
    )
    if stuck.any():
        T_stick = float(sliding_shear(path, np.array(path.stick_angle)))
        T[stuck] = elastic_shear(p, path.stick_angle, T_stick, turn[stuck] - stick)
    sliding = "sliding" if p.confinement > 0.0 else "open"
    return drained_state(p, turn, T), np.where(past_yield & ~stuck, sliding, "elastic")


def printed_states_after_turn(path: DrainedPath, turn: ArrayLike) -> DrainedState:
    """States where sliding contacts follow (8c) as printed, after the branch has turned by `turn`.

    Beyond B the printed rule adds `-mu N'` to `T` where alpha grows and N falls: with
    `T = T_B - mu (N - N_B)` balance (12b) gives `N (sin a + mu cos a) = f + (T_B + mu N_B) cos a`,
    and `|T|` leaves Coulomb's cone. Where alpha falls N grows, and the rule is Coulomb's.
    """
    exact, regime = drained_states_after_turn(path, turn)
    if path.direction < 0:
        return exact
    p, B = path.parameters, path.end
    held = B.T + p.mu * B.N
    N = lateral_force(p) + held * np.cos(exact.alpha)
    N = N / (np.sin(exact.alpha) + p.mu * np.cos(exact.alpha))
    return drained_state(p, exact.turn, np.where(regime == "sliding", held - p.mu * N, exact.T))
