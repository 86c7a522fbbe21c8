"""The exact drained biaxial path of one diamond (Nicot et al. 2016, Figs. 6 and 8).

From the confined state A (isotropic strain, `T = 0`) `E1` grows under constant `s2`. The elastic
part is a quadrature, the sliding part is algebraic, `N = f/(sin a - s mu cos a)` with
`f = F2/(2 kn l0)`. The path is given over the branch angle, which determines the state.

The end of the elastic part is found for whole sweeps of diamonds. Arrays are rows (n,) of one path
each; lengths over `l0`, forces over `kn l0`, radians. Balance (12) gives `N = (T cos a + f)/sin a`,
and `T' = kappa l` becomes `(T sin^kappa a)' = kappa sin^(kappa - 1) a (sin a - f)`. Over
`v = ln tan(a/2)`, `da = sin a dv`, the integrand is analytic in a strip of half-width pi/2 whatever
the angles: short Gauss-Legendre panels reach round-off also at `alpha0` near 0.

Where alpha grows, yield `T = mu N` reads `T sin(alpha - phi) = f sin(phi)`. The left side rises
from the larger of `alpha0` and `phi` on: at most one root. With `K22 < 0` at A alpha falls; then N
and E1 grow all the way, and `|T| - mu N` is concave in the turn: Newton's method from A approaches
the first root from below. Where alpha grows K22 can reach zero, the limit of strain control, only
if `kappa > 3`: there `T >= 3 l tan(alpha)`, while balance keeps `T < kappa l tan(alpha)`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops import InputError
from loops.arrays import Flags, Floats
from loops.validation import acute_angle, confining_strain, drained_kappa, finite, friction_angle
from patterns.diamond.states import DiamondParameters

Rows = NDArray[np.intp]
# Rows computed together, so that their quadrature nodes fit the cache.
DIAMONDS_AT_ONCE = 4096
_ITERATIONS = 100
# Error before the last step of Newton's method, which squares it.
_CLOSE = 1e-8
_EPS = float(np.finfo(np.float64).eps)
# Angles at which K22 is sampled.
_SAMPLES = 256
# Bisections of its zero: more than a number has bits.
_BISECTIONS = 60
_SMALLEST_KAPPA = 3.0
# Eight nodes on a panel of 0.5: error 12.6^-16 = 3e-18 of the integrand; sin^kappa needs panels
# below 2/kappa.
_NODES = 0.5 * (np.polynomial.legendre.leggauss(8)[0] + 1.0)
_WEIGHTS = 0.5 * np.polynomial.legendre.leggauss(8)[1]
_PANEL = 0.5


@dataclass(frozen=True, eq=False)
class DrainedEnd:
    """End of the elastic part of drained paths; arrays (...).

    `status`: 'yield', where all four contacts reach `|T| = mu N`, point B; 'opening', where without
    confinement and with `phi <= alpha0` the contacts never carry force, and the state is A;
    'limit', where K22 vanishes before yield and `E1` cannot grow on (only for `kappa > 3`); 'none',
    no event before alpha reaches 90 degrees or the grains' centres meet. `direction`: +1 where
    alpha grows, -1 where it falls (`K22 < 0` at A; where `K22 = 0` both raise `E1`, and +1 is
    followed). `state`: the state there, NaN where the status is 'none'.
    """

    status: NDArray[np.str_]
    direction: Floats
    state: DrainedState


def drained_end(
    alpha0: ArrayLike, kappa: ArrayLike, phi: ArrayLike, confinement: ArrayLike
) -> DrainedEnd:
    """End of the elastic drained path, `E1' > 0` and `s2' = 0` from the confined state A.

    Exact up to rounding: quadrature of the closed form, Newton's method on the branch angle.
    Theory, equation (5.24). Arguments broadcast; `phi = pi/2` means that nothing slides. The cost
    grows with `kappa` beyond 3, where the limit of strain control is looked for.

    >>> end = drained_end(np.pi / 4, 0.2, np.radians(5.0), 0.3)
    >>> str(end.status), round(float(end.state.E1), 12), round(float(end.state.s1), 12)
    ('yield', 0.40973434897, 0.254009900083)
    """
    arguments = np.broadcast_arrays(
        acute_angle("alpha0", alpha0),
        drained_kappa("kappa", kappa),
        friction_angle("phi", phi),
        confining_strain("confinement", confinement),
    )
    shape, rows = arguments[0].shape, PathRows(*(a.reshape(-1) for a in arguments))
    chunks = range(0, max(rows.alpha0.size, 1), DIAMONDS_AT_ONCE)
    parts = [_ends(rows.take(slice(start, start + DIAMONDS_AT_ONCE))) for start in chunks]
    status, direction, turn, T = (
        np.concatenate([part[k] for part in parts]).reshape(shape) for k in range(4)
    )
    return DrainedEnd(status, direction, drained_state(arguments[0], arguments[3], turn, T))


def _ends(paths: PathRows) -> tuple[NDArray[np.str_], Floats, Floats, Floats]:
    """Status, direction, turn and shear force of one chunk."""
    zero = np.zeros_like(paths.alpha0)
    K22 = turning_stiffness(paths.alpha0, paths.f, zero, paths.kappa)
    direction = np.where(K22 < 0.0, -1.0, 1.0)
    unloaded = (paths.confinement == 0.0) & ((paths.phi <= paths.alpha0) | (paths.kappa == 0.0))
    at_once, never = unloaded | (paths.phi == 0.0), paths.phi == 0.5 * np.pi
    turn, T = np.where(at_once, 0.0, np.nan), np.where(at_once, 0.0, np.nan)
    for solver, sign in ((growing_yield, 1.0), (falling_yield, -1.0)):
        rows = np.flatnonzero((direction == sign) & ~at_once & ~never)
        turn[rows], T[rows] = solver(paths.take(rows))
    status = np.where(np.isnan(turn), "none", np.where(unloaded, "opening", "yield"))
    rows = np.flatnonzero((direction > 0.0) & ~at_once)
    end = np.where(np.isnan(turn), 0.5 * np.pi - paths.alpha0, turn)
    limit_turn, limit_T = strain_limit(paths.take(rows), end[rows])
    limited = np.isfinite(limit_turn)
    found = rows[limited]
    status[found], turn[found], T[found] = "limit", limit_turn[limited], limit_T[limited]
    return status, direction, turn, T


@dataclass(frozen=True, eq=False)
class DrainedState:
    """States of a diamond under constant `s2`; arrays (...), `kn = l0 = 1`, radians.

    `turn` is `alpha - alpha0`, which keeps its digits at stiff grains; T positive when alpha grows.
    """

    E1: Floats
    E2: Floats
    length: Floats
    alpha: Floats
    turn: Floats
    N: Floats
    T: Floats
    s1: Floats
    s2: Floats


def drained_state(alpha0: Floats, confinement: Floats, turn: Floats, T: Floats) -> DrainedState:
    """State at the turn `alpha - alpha0` with shear force `T`, in terms that don't cancel."""
    cos0, sin0, f = np.cos(alpha0), np.sin(alpha0), confinement * np.sin(alpha0)
    fall = 2.0 * np.sin(alpha0 + 0.5 * turn) * np.sin(0.5 * turn) / cos0
    rise = 2.0 * np.cos(alpha0 + 0.5 * turn) * np.sin(0.5 * turn) / sin0
    cos, sin = cos0 * (1.0 - fall), sin0 * (1.0 + rise)
    N = (T * cos + f) / sin
    return DrainedState(
        E1=N + fall * (1.0 - N),
        E2=N - rise * (1.0 - N),
        length=1.0 - N,
        alpha=alpha0 + turn,
        turn=turn,
        N=N,
        T=T,
        s1=(T + f * cos) / (sin * sin0),
        s2=confinement * np.tan(alpha0) + 0.0 * N,
    )


def normal_force(alpha: Floats, f: Floats, T: Floats) -> Floats:
    """`N = (T cos a + f)/sin a`, balance (12b) under `f = F2/(2 kn l0)`."""
    return (T * np.cos(alpha) + f) / np.sin(alpha)


def turning_stiffness(alpha: Floats, f: Floats, T: Floats, lambda2: Floats) -> Floats:
    """`K22/tan(alpha0)`: positive where, under constant `s2`, `E1` grows with the angle."""
    cos, sin = np.cos(alpha), np.sin(alpha)
    axial = (T + f * cos) / sin
    return sin**2 + lambda2 * cos**2 - cos * axial / (1.0 - normal_force(alpha, f, T))


@dataclass(frozen=True, eq=False)
class PathRows:
    """Elastic drained paths as rows: `alpha0`, `kappa`, `phi`, `confinement` of shape (n,)."""

    alpha0: Floats
    kappa: Floats
    phi: Floats
    confinement: Floats

    @property
    def f(self) -> Floats:
        """Half the lateral force, `F2/(2 kn l0)`."""
        return self.confinement * np.sin(self.alpha0)

    def take(self, rows: Rows | Flags | slice) -> PathRows:
        """The picked rows."""
        return PathRows(self.alpha0[rows], self.kappa[rows], self.phi[rows], self.confinement[rows])

    def shear_after(self, turn: Floats, T: Floats, step: Floats) -> Floats:
        """Shear force at `turn + step`, from `T` at `turn`."""
        return advance_shear(T, self.alpha0 + turn, step, self.f, self.kappa)


def growing_yield(paths: PathRows) -> tuple[Floats, Floats]:
    """Turn and shear force at yield; NaN where 90 degrees comes first.

    Newton's method inside a shrinking bracket. The shear force is carried from iterate to iterate
    by short quadratures and integrated anew from A for the last step.
    """
    low, ceiling = np.maximum(paths.phi - paths.alpha0, 0.0), 0.5 * np.pi - paths.alpha0
    bracket = _Bracket(low, ceiling.copy(), ceiling, np.zeros(low.shape, dtype=bool))
    # First the root with `T = kappa (1 - E) turn` and the sine of the turn to first order.
    stiffness, over = paths.kappa * (1.0 - paths.confinement), paths.alpha0 - paths.phi
    half, need = 0.5 * stiffness * np.sin(over), paths.f * np.sin(paths.phi)
    root = np.sqrt(half**2 + stiffness * np.cos(over) * need)
    with np.errstate(divide="ignore", invalid="ignore"):
        rising, falling = need / (half + root), (root - half) / (stiffness * np.cos(over))
    guess = np.nan_to_num(np.where(half > 0.0, rising, falling), nan=np.inf)
    turn = np.clip(guess, low, ceiling)
    T = paths.shear_after(np.zeros_like(turn), np.zeros_like(turn), turn)
    rows, active = np.arange(turn.size), paths
    for _ in range(_ITERATIONS):
        excess, slope = _excess(active, turn[rows], T[rows])
        goal = bracket.next_turn(rows, turn[rows], excess, slope)
        moving = np.abs(goal - turn[rows]) > _CLOSE * goal
        rows, goal, active = rows[moving], goal[moving], active.take(moving)
        if rows.size == 0:
            break
        T[rows] = active.shear_after(turn[rows], T[rows], goal - turn[rows])
        turn[rows] = goal
    turn[bracket.fails] = np.nan
    T[:] = np.nan
    found = np.flatnonzero(np.isfinite(turn))
    paths, start = paths.take(found), turn[found]
    shear = paths.shear_after(np.zeros_like(start), np.zeros_like(start), start)
    excess, slope = _excess(paths, start, shear)
    step = np.maximum(-excess / np.where(slope > 0.0, slope, np.inf), -start)
    turn[found], T[found] = start + step, paths.shear_after(start, shear, step)
    return turn, T


@dataclass(frozen=True, eq=False)
class _Bracket:
    """Bounds of the root; `high` counts only once an iterate there or below had an excess."""

    low: Floats
    high: Floats
    ceiling: Floats
    closed: Flags

    @property
    def fails(self) -> Flags:
        return ~self.closed & (self.low >= self.ceiling)

    def next_turn(self, rows: Rows, turn: Floats, excess: Floats, slope: Floats) -> Floats:
        """Take in an iterate; return Newton's next, or one that surely shrinks the bracket."""
        below = excess < 0.0
        self.low[rows] = np.where(below, turn, self.low[rows])
        self.high[rows] = np.where(below, self.high[rows], turn)
        self.closed[rows] |= ~below
        low, high = self.low[rows], self.high[rows]
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = turn - excess / slope
        inside = (newton >= low) & (newton <= high)
        middle = 0.5 * (low + high)
        return np.where(inside, newton, np.where(self.closed[rows], middle, high))


def _excess(paths: PathRows, turn: Floats, T: Floats) -> tuple[Floats, Floats]:
    """`T sin(alpha - phi) - f sin(phi)` and its derivative."""
    alpha, f = paths.alpha0 + turn, paths.f
    over = alpha - paths.phi
    length = 1.0 - normal_force(alpha, f, T)
    slope = paths.kappa * length * np.sin(over) + T * np.cos(over)
    return T * np.sin(over) - f * np.sin(paths.phi), slope


def falling_yield(paths: PathRows) -> tuple[Floats, Floats]:
    """Turn (negative) and shear force at yield; NaN where the grains' centres meet first."""
    turn, T = np.zeros_like(paths.alpha0), np.zeros_like(paths.alpha0)
    fails = np.zeros(turn.shape, dtype=bool)
    rows, active = np.arange(turn.size), paths
    for _ in range(_ITERATIONS):
        # Margin to yield, `N sin(phi) - |T| cos(phi)`, and its decrease per falling angle.
        alpha = active.alpha0 + turn[rows]
        N = normal_force(alpha, active.f, T[rows])
        shear_rate = active.kappa * (1.0 - N)
        normal_rate = (N - shear_rate) / np.tan(alpha) + T[rows]
        # Exactly zero at pi/2, where nothing slides.
        cos = np.where(active.phi == 0.5 * np.pi, 0.0, np.cos(active.phi))
        sin = np.sin(active.phi)
        lack, slope = N * sin + T[rows] * cos, shear_rate * cos - normal_rate * sin
        with np.errstate(divide="ignore", invalid="ignore"):
            step = -np.where(lack > 0.0, lack / slope, 0.0)
        # Once the excess falls, or l has vanished, there is no yield.
        alive = (step <= 0.0) & (active.alpha0 + turn[rows] + step > 0.0)
        fails[rows[~alive]] = True
        moving = alive & (-step > -4.0 * _EPS * turn[rows])
        rows, step, active = rows[moving], step[moving], active.take(moving)
        if rows.size == 0:
            break
        T[rows] = active.shear_after(turn[rows], T[rows], step)
        turn[rows] += step
    return np.where(fails, np.nan, turn), np.where(fails, np.nan, T)


def strain_limit(paths: PathRows, end: Floats) -> tuple[Floats, Floats]:
    """Turn and shear force at the first `K22 = 0` between A and `end`; NaN where there is none.

    The path is sampled at 256 angles, evenly in `ln tan(alpha/2)`: a K22 that dips below zero
    between two of them goes unseen.
    """
    turn, T = np.full_like(end, np.nan), np.full_like(end, np.nan)
    rows = np.flatnonzero(paths.kappa > _SMALLEST_KAPPA)
    paths, end = paths.take(rows), end[rows]
    last_turn, last_T = np.zeros_like(end), np.zeros_like(end)
    half_tan = np.tan(0.5 * paths.alpha0)
    growth = np.log(np.tan(0.5 * (paths.alpha0 + end)) / half_tan) / _SAMPLES
    for sample in range(1, _SAMPLES + 1):
        goal = 2.0 * np.arctan(half_tan * np.exp(sample * growth)) - paths.alpha0
        goal_T = paths.shear_after(last_turn, last_T, goal - last_turn)
        below = turning_stiffness(paths.alpha0 + goal, paths.f, goal_T, paths.kappa) < 0.0
        if below.any():
            # Bisection between the last angle, where K22 is positive, and this one.
            own, start, start_T = paths.take(below), last_turn[below], last_T[below]
            low, high = start, goal[below]
            for _ in range(_BISECTIONS):
                middle = 0.5 * (low + high)
                middle_T = own.shear_after(start, start_T, middle - start)
                beyond = turning_stiffness(own.alpha0 + middle, own.f, middle_T, own.kappa) < 0.0
                low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
            turn[rows[below]], T[rows[below]] = low, own.shear_after(start, start_T, low - start)
            rows, paths = rows[~below], paths.take(~below)
            half_tan, growth, goal, goal_T = (x[~below] for x in (half_tan, growth, goal, goal_T))
        last_turn, last_T = goal, goal_T
    return turn, T


def advance_shear(T: Floats, alpha: Floats, turn: Floats, f: Floats, kappa: Floats) -> Floats:
    """Shear force after the branch has turned elastically from `alpha` to `alpha + turn`.

    Integrates `(sin b / sin(alpha + turn))^kappa (sin b - f) dv` over `v = ln tan(b/2)`.
    """
    span, half_tan = log_tangent_step(alpha, turn), np.tan(0.5 * alpha)
    sin_end = np.sin(alpha + turn)
    panels = np.ceil(np.abs(span) / np.minimum(_PANEL, 2.0 / np.maximum(kappa, 1.0)))
    width = span / np.maximum(panels, 1.0)
    integral = np.zeros_like(T)
    for panel in range(int(panels.max(initial=0.0))):
        rows = np.flatnonzero(panels > panel)
        own = width[rows, None]
        half = half_tan[rows, None] * np.exp(own * (panel + _NODES))
        sin = 2.0 * half / (1.0 + half**2)
        integrand = (sin / sin_end[rows, None]) ** kappa[rows, None] * (sin - f[rows, None])
        # einsum, not a matrix product: a row must not depend on its neighbours, nor start threads.
        integral[rows] += width[rows] * np.einsum("ij,j->i", integrand, _WEIGHTS)
    return T * (np.sin(alpha) / sin_end) ** kappa + kappa * integral


def log_tangent_step(alpha: Floats, turn: Floats) -> Floats:
    """`ln tan((alpha + turn)/2) - ln tan(alpha/2)`, free of cancellation."""
    return np.log1p(np.sin(0.5 * turn) / (np.cos(0.5 * (alpha + turn)) * np.sin(0.5 * alpha)))


@dataclass(frozen=True, eq=False)
class DrainedPath:
    """A drained biaxial path and its events.

    `status`, `direction`: see `DrainedEnd`; `confined`, `end`: state A, and the end of the elastic
    part: B at yield, NaN if none; `snaps_back`: whether `E1` stops growing at the end, where K22
    changes its sign as the contacts start to slide, or vanishes ('limit'): the states beyond B then
    need another control than `E1`; `stick_angle`: angle at which sliding contacts stick again,
    radians, NaN if they slide on. It exists for a falling alpha alone, where N grows faster than
    the shear force of slip.
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
    p, zero = parameters, np.zeros(())
    end = drained_end(p.alpha0, p.kappa, p.phi, p.confinement)
    status, direction = str(end.status), int(end.direction)
    sticks = status == "yield" and direction < 0
    snaps_back = status == "limit"
    if status == "yield":
        # K22 of the sliding contacts at B has another sign than on the elastic path.
        f, B = np.asarray(p.confinement * np.sin(p.alpha0)), end.state
        lambda2 = np.asarray(-direction * p.mu * np.tan(B.alpha))
        snaps_back = bool(direction * turning_stiffness(B.alpha, f, B.T, lambda2) < 0.0)
    return DrainedPath(
        parameters=p,
        status=status,
        direction=direction,
        confined=drained_state(np.array(p.alpha0), np.array(p.confinement), zero, zero),
        end=end.state,
        snaps_back=snaps_back,
        stick_angle=_stick_angle(p, float(end.state.alpha)) if sticks else float("nan"),
    )


def drained_states_after_turn(
    path: DrainedPath, turn: ArrayLike
) -> tuple[DrainedState, NDArray[np.str_]]:
    """States after the branch has turned by `turn = alpha - alpha0`; 'elastic', 'sliding', 'open'.

    Turns run from 0 on in the path's direction; at B itself the state is still elastic. Exact to
    relative rounding errors also where stiff grains yield after a turn of 1e-9.
    """
    p, turn, direction = path.parameters, finite("turn", turn), path.direction
    last = 0.5 * np.pi if direction > 0 else 0.0
    inside = (turn * direction >= 0.0) & ((last - p.alpha0 - turn) * direction > 0.0)
    expected = f"angles from alpha0 = {p.alpha0:.17g} on, short of {last:.17g}"
    if path.status == "limit":
        inside &= turn <= path.end.turn
        expected += f", up to the limit of strain control at {float(path.end.alpha):.17g}"
    if not np.all(inside):
        received = p.alpha0 + float(np.atleast_1d(turn)[~np.atleast_1d(inside)][0])
        raise InputError("alpha", f"{received:.17g}", expected, "Move it.")
    # Elastic from A, sliding from B, stuck again.
    flat, stick_turn = turn.reshape(-1), path.stick_angle - p.alpha0
    if path.status == "opening":
        T, regime = np.zeros_like(flat), np.full(flat.shape, "open")
    else:
        past_yield = (flat - path.end.turn) * direction > 0.0
        stuck = (flat - stick_turn) * direction > 0.0
        slides = past_yield & ~stuck
        T = _elastic_shear(p, p.alpha0, 0.0, np.where(past_yield, 0.0, flat))
        T[slides] = _sliding_shear(path, p.alpha0 + flat[slides])
        stick_T = _sliding_shear(path, np.array([path.stick_angle]))[0]
        T[stuck] = _elastic_shear(p, path.stick_angle, stick_T, flat[stuck] - stick_turn)
        regime = np.where(slides, "sliding" if p.confinement > 0.0 else "open", "elastic")
    alpha0, confinement = np.full(turn.shape, p.alpha0), np.full(turn.shape, p.confinement)
    state = drained_state(alpha0, confinement, turn, T.reshape(turn.shape))
    if np.any(state.length <= 0.0):
        met = float(np.max(state.alpha[state.length <= 0.0]))
        expected = "angles short of the one where the grains' centres meet (l = 0)"
        raise InputError("alpha", f"{met:.17g}", expected, "Stay closer to alpha0.")
    return state, regime.reshape(turn.shape)


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
    f = p.confinement * np.sin(p.alpha0)
    held = B.T + p.mu * B.N
    N = (f + held * np.cos(exact.alpha)) / (np.sin(exact.alpha) + p.mu * np.cos(exact.alpha))
    T = np.where(regime == "sliding", held - p.mu * N, exact.T)
    return drained_state(np.asarray(p.alpha0), np.asarray(p.confinement), exact.turn, T)


def _elastic_shear(p: DiamondParameters, start: float, T: float, turn: Floats) -> Floats:
    """Shear force after turns (n,) from the angle `start`, where it was `T`."""
    same, f = np.ones_like(turn), p.confinement * np.sin(p.alpha0)
    return advance_shear(T * same, start * same, turn, f * same, p.kappa * same)


def _sliding_shear(path: DrainedPath, alpha: Floats) -> Floats:
    """`T = s mu N` with `N = f/(sin a - s mu cos a)`; zero without lateral force."""
    p, s = path.parameters, path.direction
    force = p.confinement * np.sin(p.alpha0) * np.sin(p.phi)
    return s * force / np.sin(alpha - s * p.phi) if force > 0.0 else np.zeros_like(alpha)


def _stick_angle(p: DiamondParameters, alpha_B: float) -> float:
    """Angle where slip of falling alpha stops, `kappa l = mu N cot(alpha + phi)`; NaN if none."""
    # Imported here, since it is slow to load and used by paths alone.
    from scipy.optimize import brentq

    f = p.confinement * np.sin(p.alpha0)

    def slip(theta: float) -> float:
        stiff = p.kappa * (np.sin(theta) - f * np.cos(p.phi)) * np.sin(theta)
        return float(stiff - f * np.sin(p.phi) * np.cos(theta))

    theta_B = alpha_B + p.phi
    last = max(p.phi, float(np.arcsin(f * np.cos(p.phi))))
    if slip(theta_B) <= 0.0:
        return alpha_B
    return brentq(slip, last, theta_B, xtol=1e-16) - p.phi if slip(last) < 0.0 else float("nan")
