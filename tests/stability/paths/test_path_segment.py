"""Parts of a path's segment: event functions in any units, first crossings, roots, branchings."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stability.paths.path_segment import eigenvalue_kind
from stability.paths.segment import SINGULAR, TOO_LONG
from tests.stability.paths.driven import drive


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e9])
def test_a_pair_of_eigenvalues_is_real_within_a_share_of_the_operator(size):
    """`1 +- i e` in the plane of H11, H22: a tenth of the share, and ten times it."""
    for e, kind in ((1e-8, "det_K_zero"), (1e-6, "flutter")):
        A = size * np.diag([1.0, 2.0, 2.0, 1.0])
        A[0, 3], A[3, 0] = size * e, -size * e
        assert eigenvalue_kind(A, "diagonal", 0) == kind
    assert eigenvalue_kind(np.nan * A, "diagonal", 0) == "det_K_zero"


def clock(y):
    return np.ones_like(y)


def lines(slopes, roots):
    """Functions `slope (t - root)` of a clock."""
    return lambda y: np.array(slopes) * (y[0] - np.array(roots))


@pytest.mark.parametrize(("until", "count"), [(1.0, 2), (0.5, 1), (0.05, 0)])
def test_branchings_are_the_changes_of_sign_before_an_event(until, count):
    found = drive(
        clock, lines([1.0], [until]), balance=lambda y: (y[0] - 0.1) * (y[0] - 0.6) * (y[0] + 2.0)
    )
    np.testing.assert_allclose(found.branchings[:, 0], [0.1, 0.6][:count], rtol=0, atol=1e-12)
    quiet = drive(clock, lines([1.0], [until]), balance=lambda y: -1.0 - y[0])
    assert len(quiet.branchings) == 0


def test_a_root_that_no_bracket_holds_is_found_by_halving():
    """No number before .3, negative up to .6."""
    found = drive(
        clock, lambda y: [np.nan if 0.0 < y[0] < 0.3 else y[0] - 0.6], max_step=0.65, y=[0.0]
    )
    assert found.y[0] == pytest.approx(0.6, rel=0, abs=1e-14)


@pytest.mark.parametrize("slopes", [[1.0, 1.0, 1.0], [50.0, 1.0, 1e-3], [1e-3, 1.0, 50.0]])
def test_the_first_of_several_functions_is_found_whatever_their_slopes(slopes):
    found = drive(clock, lines(slopes, [0.7, 0.4, 0.3]))
    assert (found.fired, found.event) == ([2], True)
    assert found.y[0] == pytest.approx(0.3, rel=0, abs=1e-14)


def test_a_function_that_starts_at_its_event_has_it_there():
    """By rounding it is above zero at the start, and rises."""
    found = drive(clock, lines([1.0, 1.0], [-1e-14, 0.9]))
    assert (found.fired, found.y.tolist()) == ([0], [0.0])


def test_functions_that_vanish_together_have_their_events_together():
    found = drive(clock, lines([1.0, 1.0, 1.0], [0.4, 0.4 + 1e-12, 0.4 + 1e-9]))
    assert found.fired == [0, 1]


@pytest.mark.parametrize(
    "function",
    [lambda t: t - 0.5, lambda t: 0.5 - t, lambda t: t * (t - 0.5), lambda t: t * (0.5 - t)],
)
def test_a_two_sided_function_has_its_event_either_way(function):
    """Also one that starts at a zero: it takes the side to which it goes."""
    found = drive(clock, lambda y: [function(y[0])], two_sided=True)
    assert found.fired == [0] and found.y[0] == pytest.approx(0.5, rel=0, abs=1e-14)


def test_a_function_positive_between_its_samples_is_found():
    """Below zero at all five samples of a step it rises above it at .36 and .39 of the step."""
    found = drive(
        clock, lambda y: [-(y[0] - 0.36) * (y[0] - 0.39), y[0] - 0.99], y=[-2.0], max_step=3.0
    )
    assert found.fired == [0]
    assert found.y[0] == pytest.approx(0.36, rel=0, abs=1e-12)


def test_an_event_is_where_the_integrator_finds_it_not_the_interpolant():
    """Of long steps the interpolant is off by far more; the state is that of the solution."""

    def rates(y):
        return np.array([1.0, -4.0 * y[1]])

    found = drive(rates, lambda y: [0.1 - y[1]], y=[0.0, 1.0])
    assert found.y[0] == pytest.approx(0.25 * np.log(10.0), rel=0, abs=1e-9)
    exact = solve_ivp(lambda _, y: rates(y), (0, found.y[0]), [0.0, 1.0], rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(found.y, exact.y[:, -1], rtol=0, atol=1e-9)
    assert abs(found.y[1] - 0.1) < 1e-15


def test_what_the_rates_raise_is_raised():
    def broken(y):
        raise ZeroDivisionError("no rates")

    with pytest.raises(ZeroDivisionError, match="no rates"):
        drive(broken, lines([1.0], [0.5]))


def test_steps_that_creep_where_the_rates_are_ill_conditioned_end_at_a_singular_point():
    found = drive(
        lambda y: np.array([1.0 if y[0] < 0.3 else np.nan]), lines([1.0], [0.5]), condition=1e7
    )
    assert (found.code, found.fired) == (SINGULAR, [])
    assert found.y[0] == pytest.approx(0.3, rel=0, abs=1e-5)


def test_the_number_of_steps_is_limited():
    found = drive(clock, lines([1.0], [0.5]), max_step=0.01, most=20)
    assert (found.code, found.steps) == (TOO_LONG, 20)
    assert found.y[0] == pytest.approx(found.rows[-1, 0])
