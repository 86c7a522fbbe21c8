"""Straight strain paths of the diamond: quadrature, Coulomb's law, the tangent."""

import numpy as np
import pytest
from mpmath import mp, mpf

from patterns.diamond import angle_from_strains, opposite_gaps, tangent
from tests.oracles.strain_lines import (
    half_diagonals,
    line_states,
    sticking_shear,
    strain_line,
    yield_position,
)


def random_lines(seed, count):
    rng = np.random.default_rng(seed)
    alpha0, angle = np.radians(rng.uniform(5, 85, count)), rng.uniform(-np.pi, np.pi, count)
    E = rng.uniform(0.0, 0.6, count)
    return strain_line(alpha0, E, E, angle), rng


def shear_by_quadrature(line, row, u, kappa, increment):
    """`kappa Int l d(alpha)` or `kappa Int d(alpha)` from the positions, in 25 digits."""
    (qx, qy), (fx, fy) = line.direction[row], line.foot[row]

    def rate(s):
        x, y = mpf(fx) + s * mpf(qx), mpf(fy) + s * mpf(qy)
        turn = (x * mpf(qy) - y * mpf(qx)) / (x**2 + y**2)
        return turn * mp.sqrt(x**2 + y**2) if increment == "branch" else turn

    with mp.workdps(25):
        return kappa * mp.quad(rate, mp.linspace(mpf(line.start[row]), mpf(u), 5))


@pytest.mark.parametrize("increment", ["branch", "radii"])
def test_sticking_shear_is_the_quadrature_of_the_law(increment):
    line, rng = random_lines(50, 20)
    u = line.start + rng.uniform(0.0, 1.0, 20) * (line.opening - line.start)
    kappa = rng.uniform(0.05, 1.5, 20)
    T = sticking_shear(line, u, kappa, increment)
    for row in range(20):
        exact = float(shear_by_quadrature(line, row, u[row], kappa[row], increment))
        assert T[row] == pytest.approx(exact, abs=2e-15)


def test_positions_and_stresses():
    line, rng = random_lines(51, 200)
    # Half the way to the axis that the branch may fold onto.
    room = 0.5 * np.min(line.foot + line.start[:, None] * line.direction, axis=-1)
    u = line.start + room * rng.random(200)
    state = line_states(line, u, 0.3)
    X = half_diagonals(line.alpha0, state.E1, state.E2)
    np.testing.assert_allclose(np.sum(X * line.direction, axis=-1), u, atol=4e-15)
    np.testing.assert_allclose(np.linalg.norm(X, axis=-1), state.length, atol=4e-15)
    alpha = angle_from_strains(state.E1, state.E2, line.alpha0)
    np.testing.assert_allclose(state.alpha, alpha, atol=2e-15)
    gap, _ = opposite_gaps(state.E1, state.E2, line.alpha0)
    np.testing.assert_allclose(gap, 2.0 * X[:, 0] - 1.0, atol=4e-15)


@pytest.mark.parametrize("increment", ["branch", "radii"])
def test_contacts_yield_once_and_then_slip_dissipates(increment):
    line, rng = random_lines(52, 300)
    kappa, mu = rng.uniform(0.05, 1.5, 300), rng.uniform(0.01, 1.0, 300)
    yields = yield_position(line, kappa, mu, increment)
    assert np.all(np.isfinite(yields))
    at = line_states(line, yields, kappa, mu, increment)
    np.testing.assert_allclose(np.abs(at.T), mu * at.N, atol=4e-15)
    for share in np.linspace(0.02, 0.98, 25):
        before = line.start + share * (yields - line.start)
        N = 1.0 - np.hypot(line.distance, before)
        assert np.all(np.abs(sticking_shear(line, before, kappa, increment)) < mu * N)
        after = yields + share * (line.opening - yields)
        state = line_states(line, after, kappa, mu, increment)
        np.testing.assert_allclose(state.T, line.sense * mu * state.N, rtol=1e-12)
        arm = 1.0 if increment == "radii" else state.length
        slip = kappa * arm * line.distance / state.length**2 + mu * after / state.length
        assert np.all(slip > 0.0)


def test_stress_rates_are_the_tangent():
    # K E' against central differences of the closed form: the slope of the error is 2.
    line = strain_line(0.6, 0.2, 0.2, 2.5)
    u, errors = line.start + 0.05, []
    state = line_states(line, u, 0.3)
    K = tangent(state.E1, state.E2, state.s1, state.s2, 0.6, 0.3, 0.3)
    rate = -line.direction / half_diagonals(0.6, 0.0, 0.0)
    for h in (4e-2, 2e-2, 1e-2):
        ahead, behind = (line_states(line, u + side * h, 0.3) for side in (1, -1))
        slope = np.array([ahead.s1 - behind.s1, ahead.s2 - behind.s2]) / (2 * h)
        errors.append(np.abs(slope - K @ rate).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 2.0, atol=0.05)


def test_radial_lines_never_turn_and_open_contacts_carry_nothing():
    line = strain_line(np.radians([20.0, 45.0, 70.0]), 0.0, 0.0, np.pi / 4)
    assert line.distance.tolist() == line.sense.tolist() == [0.0, 0.0, 0.0]
    assert np.all(np.isnan(yield_position(line, 0.2, 0.1)))
    state = line_states(line, line.start + 0.3, 0.2, 0.1)
    np.testing.assert_allclose(state.N, 0.3, atol=1e-15)
    assert np.all(state.T == 0.0)
    out = strain_line(0.7, 0.1, 0.1, 2.0)
    gone = line_states(out, out.opening + 0.01, 0.2)
    assert float(gone.N) == float(gone.T) == float(gone.s1) == 0.0
