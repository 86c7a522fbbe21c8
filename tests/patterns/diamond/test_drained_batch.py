"""Sweeps of drained paths against mpmath, closed forms and the single path."""

import numpy as np
import pytest
from mpmath import mp
from scipy.special import gamma

from loops import InputError
from patterns.diamond import tangent
from tests.oracles import diamond_mpmath as oracle
from tests.oracles.drained import _Bracket, advance_shear, drained_end


def random_sweep(seed, count):
    rng = np.random.default_rng(seed)
    return (
        np.radians(rng.uniform(5.0, 85.0, count)),
        rng.uniform(0.05, 1.5, count),
        np.radians(rng.uniform(1.0, 35.0, count)),
        rng.uniform(1e-4, 0.5, count),
    )


def extreme_sweep(seed, count):
    """Flat and tall diamonds, soft and stiff shear, stiff grains, little and much friction."""
    rng = np.random.default_rng(seed)
    alpha0 = np.radians(45.0 * 10 ** rng.uniform(-7, 0, count))
    alpha0 = np.where(rng.random(count) < 0.5, 0.5 * np.pi - alpha0, alpha0)
    return (
        alpha0,
        10 ** rng.uniform(-4, 1.5, count),
        np.radians(10 ** rng.uniform(-6, 1.9, count)),
        10 ** rng.uniform(-10, -0.05, count),
    )


def errors_against_mpmath(sweep, digits):
    """Errors of (alpha, E1, E2, s1, N, T) over their own size, yielding rows only."""
    end, errors = drained_end(*sweep), []
    state = end.state
    with mp.workdps(digits):
        for row in np.flatnonzero(end.status == "yield"):
            alpha0, kappa, phi, confinement = (float(x[row]) for x in sweep)
            exact = oracle.yield_state(
                alpha0, kappa, phi, confinement, float(state.alpha[row]), int(end.direction[row])
            )
            got = (getattr(state, name)[row] for name in ("alpha", "E1", "E2", "s1", "N", "T"))
            errors.append(
                [float(abs(float(g) - x) / abs(x)) for g, x in zip(got, exact, strict=True)]
            )
    return np.array(errors)


@pytest.mark.slow
def test_random_sweep_against_mpmath():
    errors = errors_against_mpmath(random_sweep(40, 40), 25)
    assert len(errors) > 20
    # E2 changes its sign in the sweep: its error is relative to a small number at times.
    assert errors[:, [0, 1, 3, 4, 5]].max() < 1e-14
    assert errors[:, 2].max() < 1e-12


@pytest.mark.slow
def test_extreme_sweep_against_mpmath():
    errors = errors_against_mpmath(extreme_sweep(41, 16), 40)
    assert len(errors) > 8
    assert errors[:, [0, 1, 3, 4, 5]].max() < 2e-14
    assert errors[:, 2].max() < 1e-12


def test_falling_sweep_against_mpmath():
    rng = np.random.default_rng(42)
    sweep = (
        rng.uniform(0.1, 0.5, 16),
        rng.uniform(0.1, 1.5, 16),
        rng.uniform(0.001, 0.05, 16),
        rng.uniform(0.6, 0.7, 16),
    )
    end, errors = drained_end(*sweep), errors_against_mpmath(sweep, 25)
    assert np.count_nonzero((end.direction < 0) & (end.status == "yield")) > 8
    assert errors.max() < 1e-12


@pytest.mark.parametrize("alpha0", [1e-12, 1e-6, 0.3, 1.5])
@pytest.mark.parametrize("kappa", [0.0, 1e-6, 0.2, 1.0, 7.0, 60.0])
def test_shear_at_90_degrees_is_a_beta_function(alpha0, kappa):
    # Without lateral force T(90 deg) = kappa Int sin^kappa, complete up to alpha0^(kappa + 1).
    one = np.ones(1)
    T = advance_shear(0 * one, alpha0 * one, (0.5 * np.pi - alpha0) * one, 0 * one, kappa * one)
    whole = kappa * 0.5 * np.sqrt(np.pi) * gamma(0.5 * kappa + 0.5) / gamma(0.5 * kappa + 1.0)
    with mp.workdps(30):
        missing = kappa * float(mp.quad(lambda b: mp.sin(b) ** kappa, [0, alpha0]))
    assert T[0] == pytest.approx(whole - missing, rel=2e-14, abs=1e-15)


def test_shear_is_additive_along_the_path():
    rng = np.random.default_rng(43)
    alpha0, f = rng.uniform(0.01, 1.0, 200), 0.0
    kappa, turn = rng.uniform(0, 8, 200), rng.uniform(0.0, 0.5, 200)
    zero, f = np.zeros(200), 0.4 * np.sin(alpha0)
    half = advance_shear(zero, alpha0, 0.3 * turn, f, kappa)
    whole = advance_shear(half, alpha0 + 0.3 * turn, 0.7 * turn, f, kappa)
    np.testing.assert_allclose(
        whole, advance_shear(zero, alpha0, turn, f, kappa), rtol=1e-13, atol=1e-16
    )


def test_states_meet_coulomb_and_no_other_event_is_missed():
    for sweep in (random_sweep(44, 20_000), extreme_sweep(45, 2_000)):
        _, _, phi, confinement = sweep
        end = drained_end(*sweep)
        state, at_yield = end.state, end.status == "yield"
        assert 0.3 < at_yield.mean() < 1.0
        friction = np.abs(state.T) - np.tan(phi) * state.N
        size = np.tan(phi) * state.N
        assert np.abs(friction / size)[at_yield].max() < 1e-9
        assert np.all(state.turn[at_yield] * end.direction[at_yield] > 0)
        assert np.all(np.isnan(state.E1) == (end.status == "none"))
        assert np.all(state.E1[at_yield] > confinement[at_yield])


def test_no_yield_means_too_little_shear_at_90_degrees():
    alpha0, kappa, phi, confinement = sweep = random_sweep(46, 5_000)
    end = drained_end(*sweep)
    f, zero = confinement * np.sin(alpha0), np.zeros_like(alpha0)
    last = advance_shear(zero, alpha0, 0.5 * np.pi - alpha0, f, kappa)
    growing = end.direction > 0
    np.testing.assert_array_equal(
        (end.status == "yield")[growing], (last > f * np.tan(phi))[growing]
    )


def test_direction_is_the_sign_of_K22():
    rng = np.random.default_rng(47)
    alpha0, kappa, phi = rng.uniform([[0.1], [0.0], [0.0]], [[1.0], [1.5], [0.5]], (3, 2_000))
    confinement = rng.uniform(0.0, 0.95, 2_000)
    end = drained_end(alpha0, kappa, phi, confinement)
    s1, s2 = confinement / np.tan(alpha0), confinement * np.tan(alpha0)
    K = tangent(confinement, confinement, s1, s2, alpha0, kappa, kappa)
    np.testing.assert_array_equal(end.direction, np.sign(K[:, 1, 1]))
    assert 100 < np.count_nonzero(end.direction < 0) < 1900


def test_K22_zero_at_the_start_follows_the_growing_angle():
    # tan^2 a0 + kappa = E/(1 - E) at kappa = 1/2, up to rounding; both sides of it differ.
    end = drained_end(np.pi / 4, [0.5 - 1e-9, 0.5, 0.5 + 1e-9], 0.02, 0.6)
    assert end.direction[[0, 2]].tolist() == [-1.0, 1.0]
    assert end.status.tolist() == ["yield"] * 3
    assert np.all(end.state.E1 > 0.6)


def test_limit_of_strain_control_comes_before_yield():
    rng = np.random.default_rng(48)
    alpha0, kappa = rng.uniform(0.05, 1.2, 300), rng.uniform(2.0, 30.0, 300)
    end = drained_end(alpha0, kappa, 1.55, rng.uniform(0.0, 0.5, 300))
    state, limited = end.state, end.status == "limit"
    assert 100 < limited.sum() < 290
    assert kappa[limited].min() > 3.0
    measures = (getattr(state, name)[limited] for name in ("E1", "E2", "s1", "s2"))
    K = tangent(*measures, alpha0[limited], kappa[limited], kappa[limited])
    assert np.abs(K[:, 1, 1] / np.tan(alpha0[limited])).max() < 1e-11
    assert np.all((state.T / state.N)[limited] < np.tan(1.55))
    assert np.all((state.T / (3 * state.length * np.tan(state.alpha)))[limited] > 1 - 1e-12)


def test_closed_cases():
    alpha0 = np.array([0.3, 0.3, 0.8, 0.8, 0.8, 0.8, 0.3])
    kappa = np.array([0.4, 0.4, 0.0, 0.4, 0.4, 0.0, 0.0])
    phi = np.array([0.5, 0.2, 0.5, 0.5 * np.pi, 0.0, 0.0, 0.5])
    confinement = np.array([0.0, 0.0, 0.2, 0.2, 0.2, 0.2, 0.0])
    end = drained_end(alpha0, kappa, phi, confinement)
    status = ["yield", "opening", "none", "none", "yield", "yield", "opening"]
    assert end.status.tolist() == status
    np.testing.assert_allclose(end.state.alpha[[0, 1, 4, 5]], [0.5, 0.3, 0.8, 0.8], atol=1e-15)
    assert end.state.N[[1, 4]].tolist() == [0.0, pytest.approx(0.2, abs=1e-16)]


def test_bracket_halves_where_newton_leaves_it():
    # No path is known on which it must, so its parts are asked directly.
    bracket = _Bracket(np.zeros(1), np.ones(1), np.ones(1), np.zeros(1, dtype=bool))
    row, flat, one = np.arange(1), np.full(1, 1e-9), np.ones(1)
    assert bracket.next_turn(row, 0.2 * one, -one, flat).tolist() == [1.0]  # the ceiling, unseen
    assert bracket.next_turn(row, 1.0 * one, one, flat).tolist() == [0.6]
    assert bracket.next_turn(row, 0.6 * one, -one, flat).tolist() == [0.8]
    assert not bracket.fails[0]


def test_shapes_and_chunks():
    sweep = random_sweep(49, 9_000)
    whole = drained_end(*sweep)
    part = drained_end(*(x[4_000:4_200] for x in sweep))
    np.testing.assert_allclose(whole.state.E1[4_000:4_200], part.state.E1, rtol=1e-15)
    grid = drained_end(0.7, np.array([0.1, 0.2])[:, None], 0.3, [0.1, 0.2, 0.3])
    assert grid.status.shape == grid.state.s1.shape == (2, 3)
    assert drained_end(0.7, 0.1, 0.3, 0.2).state.E1.shape == ()
    assert drained_end(np.zeros(0) + 0.7, 0.1, 0.3, 0.2).status.shape == (0,)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0.0, 0.2, 0.1, 0.1), r"alpha0: got 0,"),
        ((0.7, -0.2, 0.1, 0.1), r"kappa: got -0\.2"),
        ((0.7, 1e6, 0.1, 0.1), r"kappa: got 1000000, expected a stiffness ratio from 0 to 1000"),
        ((0.7, 0.2, [0.1, 2.0], 0.1), r"phi\[1\]: got 2,"),
        ((0.7, 0.2, 0.1, 1.0), r"confinement: got 1,"),
    ],
)
def test_bad_sweeps_are_named(arguments, message):
    with pytest.raises(InputError, match=message):
        drained_end(*arguments)
