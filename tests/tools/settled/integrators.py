"""Integrators of a script on the drained path to point B of Table 1: steps or tolerance.

Explicit Euler and the classical Runge-Kutta method march E2 and s1 over E1 by (33) in plain
Python; DOP853 adapts its steps. Yield, `|T| = mu N`, is located to each method's own order.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from scipy.optimize import brentq

from patterns.diamond import TABLE_1
from tests.benchmarks.methods import SPAN, Rows, error_at_b
from tests.tools.settled.sweep import by_scipy, drained

State = tuple[float, float, float]
START: State = (
    TABLE_1.confinement,
    TABLE_1.confinement,
    TABLE_1.confinement / math.tan(TABLE_1.alpha0),
)
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


METHODS: tuple[tuple[str, Callable[[Any], State], str, Sequence[float]], ...] = (
    ("explicit Euler", euler, "steps", (100, 1000, 10_000, 100_000)),
    ("Runge-Kutta 4", runge_kutta, "steps", (2, 4, 8, 16, 32, 64, 128, 256, 1024)),
    ("DOP853", dop853, "rtol", (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12, 1e-13)),
)


def integrator_methods(quick: bool) -> Rows:
    """Error at point B and time of a path by every integrator."""
    rows, most = Rows("integrators", "quadrature, 20 digits", quick), 1000 if quick else 100_000
    for method, solver, control, values in METHODS:
        chosen = [value for value in values if control != "steps" or value <= most]
        for value in chosen[:: 4 if quick else 1]:
            call = partial(solver, value)
            rows.add(method, f"{control} {value:g}", call, error_at_b(call()))
    return rows
