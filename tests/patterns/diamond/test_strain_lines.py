"""Straight strain paths of the diamond: quadrature, Coulomb's law, the tangent."""

import numpy as np
import pytest
from mpmath import mp, mpf

from tests.oracles.diamond import tangent
from tests.oracles.strain_lines import (
    half_diagonals,
    line_states,
    sticking_shear,
    strain_line,
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
