"""Integrators on the drained path: their orders of convergence, and where they agree."""

import numpy as np
import pytest

from patterns.diamond import tangent
from studies.bench.paths import (
    KAPPA,
    MU,
    POINT_B,
    START,
    TABLE_1,
    dop853,
    error_at_b,
    euler,
    exact,
    friction_left,
    path_solver,
    rates,
    runge_kutta,
)


def orders(solver, steps):
    errors = [error_at_b(solver(n)) for n in steps]
    return np.diff(np.log(errors)) / -np.diff(np.log(steps))


def test_rates_are_those_of_the_tangent():
    E1, E2, s1 = 0.35, 0.27, 0.28
    K = tangent(E1, E2, s1, TABLE_1.confinement, TABLE_1.alpha0, KAPPA, KAPPA)
    slope = [-K[1, 0] / K[1, 1], np.linalg.det(K) / K[1, 1]]
    np.testing.assert_allclose(rates(E1, E2, s1), slope, rtol=1e-13)


def test_point_b_is_at_yield():
    assert friction_left(*POINT_B) == pytest.approx(0.0, abs=1e-16)
    assert friction_left(*START) == pytest.approx(MU * TABLE_1.confinement, rel=1e-14)


def test_orders_of_convergence():
    np.testing.assert_allclose(orders(euler, [100, 1_000, 10_000]), 1.0, atol=0.01)
    np.testing.assert_allclose(orders(runge_kutta, [16, 32, 64, 128]), 4.0, atol=0.1)
    assert error_at_b(runge_kutta(512)) < 1e-13


def test_tolerance_bounds_the_error_of_dop853():
    errors = np.array([error_at_b(dop853(10.0**-k)) for k in range(4, 14)])
    assert np.all(errors[1:] <= errors[:-1])
    assert np.all(errors < 0.1 * 10.0 ** -np.arange(4.0, 14.0) + 2e-15)


def test_path_solver_and_exact_solver():
    assert error_at_b(path_solver(1e-10)) < 1e-10
    assert error_at_b(exact(1)) < 1e-14
    assert error_at_b(exact(50)) < 1e-14
