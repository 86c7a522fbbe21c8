"""One exact drained path: 20-digit values, an integrated rate law, and what holds along it."""

import numpy as np
import pytest
from mpmath import mp
from scipy.integrate import solve_ivp

from tests.oracles.diamond import (
    TABLE_1,
    TABLE_2,
    DiamondParameters,
    branch_from_sides,
    contact_displacement_rates,
    drained_slope,
    elastic_moduli,
    external_forces,
    side_lengths,
    sliding_moduli,
    stresses,
    tangent,
)
from tests.oracles.diamond_mpmath import yield_state
from tests.oracles.drained import drained_path, drained_states

FALLING = DiamondParameters(alpha0=0.5, kappa=1.5, phi=0.1, confinement=0.65)
STEEP = DiamondParameters(alpha0=1.2, kappa=0.7, phi=0.3, confinement=0.1)
FLAT = DiamondParameters(alpha0=0.15, kappa=0.4, phi=0.25, confinement=0.02)
STIFF = DiamondParameters(alpha0=0.7, kappa=0.5, phi=0.4, confinement=1e-8)
PATHS = {
    "Table 1": TABLE_1,
    "Table 2": TABLE_2,
    "falling": FALLING,
    "steep": STEEP,
    "flat": FLAT,
    "stiff grains": STIFF,
}


def angles(path, count, end):
    """Angles from `alpha0` to `end`, ends included."""
    return np.linspace(path.parameters.alpha0, end, count)


def moduli(path, state, sliding):
    p = path.parameters
    if sliding:
        return sliding_moduli(state.alpha, p.mu, float(path.direction))
    return elastic_moduli(p.kappa)


@pytest.mark.parametrize("name", PATHS)
def test_point_b_in_25_digits(name):
    p, path = PATHS[name], drained_path(PATHS[name])
    with mp.workdps(25):
        exact = yield_state(
            p.alpha0, p.kappa, p.phi, p.confinement, float(path.end.alpha), path.direction
        )
        for field, value in zip(("alpha", "E1", "E2", "s1", "N", "T"), exact, strict=True):
            found = float(getattr(path.end, field))
            assert abs(found - value) < 1e-14 * max(abs(value), p.confinement), field


@pytest.mark.parametrize(
    ("alpha0", "kappa", "phi", "confinement", "status"),
    [
        (0.3, 0.4, 0.5, 0.0, "yield"),
        (0.3, 0.4, 0.2, 0.0, "opening"),
        (0.8, 0.0, 0.5, 0.2, "none"),
        (0.8, 0.4, 0.5 * np.pi, 0.2, "none"),
        (0.8, 0.4, 0.0, 0.2, "yield"),
        (0.3, 0.0, 0.5, 0.0, "opening"),
    ],
)
def test_ends_in_closed_form(alpha0, kappa, phi, confinement, status):
    path = drained_path(DiamondParameters(alpha0, kappa, phi, confinement))
    assert path.status == status
    slides = status == "yield" and phi > 0
    if status != "none":
        assert path.end.alpha == pytest.approx(phi if slides else alpha0, abs=1e-15)
        assert slides or path.end.N == pytest.approx(confinement, abs=1e-16)


@pytest.mark.parametrize("name", PATHS)
def test_elastic_part_is_the_integral_of_the_rate_law(name):
    # E1 as the clock, K of (26) as the law: neither the quadrature nor the angle's direction.
    p, path = PATHS[name], drained_path(PATHS[name])
    L10, L20 = side_lengths(1.0, p.alpha0)

    def rates(E1, y):
        length, alpha = branch_from_sides((1 - E1) * L10, (1 - y[0]) * L20)
        s1, s2 = stresses(*external_forces(1 - length, y[1], alpha), L10, L20)
        K = tangent(E1, y[0], s1, s2, p.alpha0, *elastic_moduli(p.kappa))
        E2_rate = -K[1, 0] / K[1, 1]
        _, ut_rate = contact_displacement_rates(L10, E2_rate * L20, alpha)
        return [E2_rate, -p.kappa * ut_rate]

    start = [p.confinement, 0.0]
    span = (p.confinement, float(path.end.E1))
    solution = solve_ivp(rates, span, start, method="DOP853", rtol=1e-12, atol=1e-15)
    scale = span[1]
    assert solution.y[0, -1] == pytest.approx(float(path.end.E2), abs=1e-11 * scale)
    assert solution.y[1, -1] == pytest.approx(float(path.end.T), abs=1e-11 * scale)


@pytest.mark.parametrize("sliding", [False, True])
@pytest.mark.parametrize("name", ["Table 1", "Table 2", "falling", "steep", "flat"])
def test_slope_of_the_path_is_the_papers(name, sliding):
    # (33) with the tangent of either regime, against central differences along the path.
    path = drained_path(PATHS[name])
    span = float(path.end.alpha) - path.parameters.alpha0
    middle = path.parameters.alpha0 + (1.1 if sliding else 0.6) * span
    state, _ = drained_states(path, middle)
    K = tangent(
        state.E1, state.E2, state.s1, state.s2, path.parameters.alpha0,
        *moduli(path, state, sliding),
    )  # fmt: skip
    steps = 0.05 * span * 0.5 ** np.arange(4)
    near, _ = drained_states(path, middle + np.multiply.outer([-1.0, 1.0], steps))
    errors = np.abs(np.diff(near.s1, axis=0) / np.diff(near.E1, axis=0) - drained_slope(K))[0]
    assert errors[-1] < 1e-2 * abs(drained_slope(K))
    assert np.polyfit(np.log(np.abs(steps)), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.1)
    other = np.diff(near.E2, axis=0) / np.diff(near.E1, axis=0)
    assert other[0, -1] == pytest.approx(-K[1, 0] / K[1, 1], rel=1e-2)


def test_falling_contacts_stick_again():
    path = drained_path(FALLING)
    p, stick = path.parameters, path.stick_angle
    assert path.direction == -1
    assert stick < float(path.end.alpha) < p.alpha0
    state, regime = drained_states(path, stick + np.array([1e-3, 1e-9, -1e-9, -5e-3, -1e-2]))
    assert regime.tolist() == ["sliding"] * 2 + ["elastic"] * 3
    # The slip rate l - mu (dN/d|turn|)/kappa vanishes there, and the path is continuous.
    h = 1e-6
    near, _ = drained_states(path, stick + np.array([2 * h, h]))
    slip = near.length.mean() - p.mu * (near.N[1] - near.N[0]) / h / p.kappa
    assert abs(slip) < 1e-4
    np.testing.assert_allclose(state.T[1], state.T[2], atol=1e-8)
    assert np.all(np.diff(state.E1) > 0)
    ratio = np.abs(state.T) / (p.mu * state.N)
    np.testing.assert_allclose(ratio[:3], 1.0, rtol=1e-12)
    assert np.all(np.diff(ratio[2:]) < 0)


def test_strain_control_reaches_its_limit():
    path = drained_path(DiamondParameters(alpha0=0.1, kappa=6.0, phi=1.5, confinement=0.1))
    assert path.status == "limit"
    assert path.snaps_back
    E = path.end
    K = tangent(E.E1, E.E2, E.s1, E.s2, 0.1, 6.0, 6.0)
    assert abs(K[1, 1] / np.tan(0.1)) < 1e-12
    state, _ = drained_states(path, angles(path, 50, float(E.alpha)))
    assert np.all(np.diff(state.E1) > 0)
