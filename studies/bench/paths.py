"""Path integrators on the drained biaxial path to point B of Table 1: steps or tolerance.

Explicit Euler and the classical Runge-Kutta method march E2 and s1 over E1 by (33) in plain
Python, as a script would; DOP853 and the path solver adapt their steps; the exact solver takes
none. Yield, `|T| = mu N`, is located to each method's own order.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from loops import LinearFrictional
from loops.arrays import Floats
from patterns import diamond
from patterns.diamond import TABLE_1, drained_end
from stability import Stage, follow, programmes
from studies.bench.measure import Rows

State = tuple[float, float, float]
# E1, E2, s1 at B from the quadrature in 20 digits.
POINT_B = (0.40973434897033423289, 0.164934999828385506, 0.25400990008305293503)
# E1 grows by this much in the nominal number of steps: yield comes within the last per cent.
SPAN = 0.11
TAN0, MU, KAPPA = math.tan(TABLE_1.alpha0), TABLE_1.mu, TABLE_1.kappa
START: State = (TABLE_1.confinement, TABLE_1.confinement, TABLE_1.confinement / TAN0)
# The default tolerance of `stability.follow`.
DEFAULT = 1e-12


def drained(
    alpha0: float, kappa: float, phi: float, confinement: float
) -> tuple[Callable[..., tuple[float, float]], Callable[..., float]]:
    """Rates and friction left of a diamond of sticking contacts under constant s2.

    Both take `E1, E2, s1`. Rates are `dE2/dE1 = -K21/K22` and `ds1/dE1 = det K/K22` (26), (33); the
    friction left is `mu N - |T|` over `kn l0`, from balance (12), zero at yield.
    """
    t0, sin0, cos0, mu = math.tan(alpha0), math.sin(alpha0), math.cos(alpha0), math.tan(phi)
    s2 = confinement * t0

    # Plain floats: half the time of numpy's scalars.
    def rates(E1: float, E2: float, s1: float) -> tuple[float, float]:
        t = t0 * (1.0 - E2) / (1.0 - E1)
        cos2, p1, p2 = 1.0 / (1.0 + t * t), s1 / (1.0 - E2), s2 / (1.0 - E1)
        K22 = cos2 * (t * t + kappa - t * p1) * t0
        K21 = cos2 * ((1.0 - kappa) * t + t * t * p1)
        return -K21 / K22, (kappa - cos2 * t * (p2 + p1)) / K22

    def friction_left(E1: float, E2: float, s1: float) -> float:
        a = math.atan2((1.0 - E2) * sin0, (1.0 - E1) * cos0)
        F1, F2, c, s = s1 * sin0, s2 * cos0, math.cos(a), math.sin(a)
        return mu * (F1 * c + F2 * s) - abs(F1 * s - F2 * c)

    return rates, friction_left


def by_scipy(
    diamond: Sequence[float], method: str, rtol: float, atol: float, end: float = 1.0 - 1e-9
) -> State:
    """Point B of a diamond by scipy's integrators with their event location; NaN if it folds."""
    rates, friction_left = drained(*diamond)
    E = diamond[3]

    def slope(E1: float, y: Floats) -> tuple[float, float]:
        return rates(float(E1), *y.tolist())

    def left(E1: float, y: Floats) -> float:
        return friction_left(float(E1), *y.tolist())

    left.terminal = True  # type: ignore[attr-defined]
    start = np.array([E, E / math.tan(diamond[0])])
    found = solve_ivp(slope, (E, end), start, method, events=left, rtol=rtol, atol=atol)
    if found.status != 1:
        return math.nan, math.nan, math.nan
    E2, s1 = found.y_events[0][0]
    return float(found.t_events[0][0]), float(E2), float(s1)


DIAMOND = (TABLE_1.alpha0, TABLE_1.kappa, TABLE_1.phi, TABLE_1.confinement)
rates, friction_left = drained(*DIAMOND)


def euler(steps: int) -> State:
    """Point B by explicit Euler, interpolated within the step that passes yield."""
    h = SPAN / steps
    (E1, E2, s1), left = START, friction_left(*START)
    while True:
        E2_rate, s1_rate = rates(E1, E2, s1)
        after = (E1 + h, E2 + h * E2_rate, s1 + h * s1_rate)
        left_after = friction_left(*after)
        if left_after <= 0.0:
            part = h * left / (left - left_after)
            return E1 + part, E2 + part * E2_rate, s1 + part * s1_rate
        (E1, E2, s1), left = after, left_after


def runge_kutta(steps: int) -> State:
    """Point B by the classical Runge-Kutta method, the last step shortened to end at yield."""
    h, now = SPAN / steps, START
    while True:
        after = _runge_kutta_step(now, h)
        if friction_left(*after) <= 0.0:
            return _runge_kutta_step(now, brentq(_left_after, 0.0, h, args=(now,), xtol=1e-17))
        now = after


def _left_after(h: float, state: State) -> float:
    return friction_left(*_runge_kutta_step(state, h))


def _runge_kutta_step(state: State, h: float) -> State:
    E1, E2, s1 = state
    a = rates(E1, E2, s1)
    b = rates(E1 + h / 2, E2 + h / 2 * a[0], s1 + h / 2 * a[1])
    c = rates(E1 + h / 2, E2 + h / 2 * b[0], s1 + h / 2 * b[1])
    d = rates(E1 + h, E2 + h * c[0], s1 + h * c[1])
    E2_mean, s1_mean = ((a[k] + 2 * b[k] + 2 * c[k] + d[k]) / 6 for k in range(2))
    return E1 + h, E2 + h * E2_mean, s1 + h * s1_mean


def dop853(rtol: float) -> State:
    """Point B by scipy's DOP853."""
    return by_scipy(DIAMOND, "DOP853", rtol, 1e-2 * rtol, START[0] + SPAN)


def path_solver(rtol: float) -> State:
    """Point B by `stability.follow` on the graph of four grains, knowing nothing of diamonds."""
    E = TABLE_1.confinement
    path = follow(
        diamond(TABLE_1.alpha0, E1=E, E2=E),
        LinearFrictional(1.0, KAPPA, MU),
        Stage(programmes.drained_biaxial(), "H11", START[0] + SPAN),
        volume=2.0 * math.sin(2.0 * TABLE_1.alpha0),  # L10 L20, the paper's reference area
        rtol=rtol,
        atol=1e-2 * rtol,
        max_step=1.0,
    )
    row = next(event.index for event in path.events if event.kind == "yield")
    return float(path.H[row, 0]), float(path.H[row, 3]), float(path.P[row, 0])


def exact(paths: int) -> State:
    """Point B by the exact solver, for so many paths at once."""
    alpha0 = np.full(paths, TABLE_1.alpha0)
    state = drained_end(alpha0, KAPPA, TABLE_1.phi, TABLE_1.confinement).state
    return float(state.E1[-1]), float(state.E2[-1]), float(state.s1[-1])


# Method, its solver, what is varied, and the values.
METHODS: tuple[tuple[str, Callable[[Any], State], str, Sequence[float]], ...] = (
    ("explicit Euler", euler, "steps", (100, 1000, 10_000, 100_000)),
    ("Runge-Kutta 4", runge_kutta, "steps", (2, 4, 8, 16, 32, 64, 128, 256, 1024)),
    ("DOP853", dop853, "rtol", (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12, 1e-13)),
    ("path solver", path_solver, "rtol", (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)),
    ("exact solver", exact, "paths", (1, 100, 10_000)),
)


def error_at_b(found: State) -> float:
    """Largest error of E1, E2, s1 at B."""
    return max(abs(value - true) for value, true in zip(found, POINT_B, strict=True))


def path_methods(quick: bool) -> Rows:
    """Error at point B and time per path of every integrator."""
    rows, most = Rows("paths", "quadrature, 20 digits", quick), 1000 if quick else 100_000
    for method, solver, control, values in METHODS:
        chosen = [value for value in values if control != "steps" or value <= most]
        for value in chosen[:: 4 if quick else 1]:
            call, default = partial(solver, value), solver is path_solver and value == DEFAULT
            items, gap = int(value) if control == "paths" else 1, error_at_b(call())
            rows.add(method, f"{control} {value:g}", call, gap, items, default)
    return rows
