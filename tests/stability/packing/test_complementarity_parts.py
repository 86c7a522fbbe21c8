"""Parts of the complementarity solver by themselves: units, Newton's barrier, branches by hand."""

import numpy as np
import pytest

from stability.complementarity import (
    feasible_for_all,
    scaled_definite,
    solve_complementarity,
    solve_from,
)
from stability.solution_branch import TURN, SolutionBranch, solutions_over_slip, trace_branch

UNITS = [2.0**20, 2.0**-20, 2.0**44, 2.0**-44]


def problem(rng, most=8):
    m = int(rng.integers(2, most))
    return rng.standard_normal((m, 2)), np.eye(m) + 0.9 * rng.standard_normal((m, m))


@pytest.mark.parametrize("unit", UNITS)
def test_a_branch_is_the_same_whatever_the_unit_of_slip(unit):
    """In one branch slips and rates, which are not of one kind, both end segments."""
    rng, folds = np.random.default_rng(11), 0
    for _ in range(10):
        Q, M = problem(rng)
        start = solve_from(Q[:, 0], M, np.zeros(len(Q), bool))
        if start is None:
            continue
        one = trace_branch(Q, M, 0.0, start)
        for slips, loads in ((unit, 1.0), (1.0, unit)):
            other = trace_branch(loads * Q, slips * M, 0.0, start)
            assert other.status == one.status
            np.testing.assert_array_equal(other.sliding, one.sliding)
            np.testing.assert_allclose(other.angle, one.angle, rtol=0, atol=1e-9)
        folds += len(one.folds)
    assert folds > 3


@pytest.mark.parametrize("unit", UNITS)
def test_solutions_over_the_slip_of_one_contact_are_the_same_in_any_unit_of_load(unit):
    rng, counts = np.random.default_rng(4), set()
    for _ in range(25):
        q, M = rng.standard_normal(5), np.eye(5) + 0.3 * rng.standard_normal((5, 5))
        M[:, 0] *= rng.choice([-2.0, 1.0])
        if scaled_definite(M[1:, 1:])[0]:
            start = np.insert(solve_from(q[1:], M[1:, 1:], np.zeros(4, bool)), 0, False)
            found = {one.tobytes() for one in solutions_over_slip(unit * q, M, 0, start)}
            assert found == {one.tobytes() for one in solve_complementarity(q, M).active}
            counts.add(len(found))
    assert counts >= {0, 1, 2}


def test_branches_of_mirrored_contacts_are_parted_in_any_unit():
    """Two equal pairs of contacts, which change regime together."""
    rng, parted = np.random.default_rng(5), 0
    for _ in range(10):
        one, other = 0.5 * rng.standard_normal((2, 2, 2)) + np.eye(2) * [[[1.0]], [[0.0]]]
        Q, M = np.tile(rng.standard_normal((2, 2)), (2, 1)), np.block([[one, other], [other, one]])
        start = solve_from(Q[:, 0], M, np.zeros(4, bool))
        if start is None:
            continue
        first = trace_branch(Q, M, 0.0, start)
        for unit in (2.0**30, 2.0**-30):
            found = trace_branch(unit * Q, M, 0.0, start)
            assert found.status == first.status == "closed"
            np.testing.assert_array_equal(found.sliding, first.sliding)
            np.testing.assert_allclose(found.angle, first.angle, rtol=0, atol=1e-12)
        parted += 1
    assert parted > 6


@pytest.mark.parametrize(("least", "definite"), [(2e-9, True), (5e-10, False)])
def test_definite_by_less_than_a_billionth_is_not_certain(least, definite):
    assert scaled_definite(np.diag([1.0, least]))[0] == definite


def test_a_rate_that_rises_by_less_than_rounding_is_not_enough():
    """The largest rise is 1e-6, of a matrix of 1e4; and of 1e-2."""
    assert not feasible_for_all(np.diag([1e4, 1e-6]))
    assert feasible_for_all(np.diag([1e-2, 1e-6]))


def test_longest_segment_and_folds_of_a_branch_by_hand():
    """Forwards by 1, a tie, backwards by 2, on to where it began: folds at 1 and at -1."""
    ends = [[0.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, 0.0]]
    sliding = np.eye(4, dtype=bool)
    closed = SolutionBranch(np.array(ends), sliding, "closed")
    angle, slides = closed.longest
    assert angle == 0.0 and slides.tolist() == [False, False, True, False]
    np.testing.assert_allclose(closed.folds, [1.0, TURN - 1.0], rtol=0, atol=1e-15)
    assert closed.winding == 0 and closed.closed
    # Both ends of a segment belong to it, in any turn.
    for angle, segments in ((0.0, [0, 2, 3]), (1.0, [0, 1, 2]), (TURN - 1.0, [2, 3]), (2.0, [])):
        for turn in (-TURN, 0.0, TURN):
            assert closed.at(angle + turn).tolist() == segments
    # One that is cut open turns back only where it goes on.
    cut = SolutionBranch(np.array(ends[:3]), sliding[:3], "degenerate")
    np.testing.assert_allclose(cut.folds, [1.0], rtol=0, atol=1e-15)
    away = SolutionBranch(np.array([[5.0, 5.5], [5.5, 5.4]]), sliding[:2], "too long")
    assert away.longest[0] == 5.25


@pytest.mark.parametrize("start", [0.3, 0.0, 0.5 * np.pi, np.pi])
def test_a_branch_may_begin_where_a_segment_ends(start):
    """Two contacts on their own: each slides on one half of the circle."""
    sliding = np.array([np.cos(start) < -1e-9, np.sin(start) < -1e-9])
    found = trace_branch(np.eye(2), np.eye(2), start, sliding)
    assert found.status == "closed" and found.winding == 1
    assert found.angle[0, 0] == start
    assert found.angle[-1, 1] == pytest.approx(start + TURN, abs=1e-12)
    np.testing.assert_allclose(found.angle[1:, 0], found.angle[:-1, 1], rtol=0, atol=1e-14)
    for (low, high), slides in zip(found.angle, found.sliding, strict=True):
        if high - low > 1e-9:
            middle = 0.5 * (low + high)
            assert slides.tolist() == [np.cos(middle) < 0, np.sin(middle) < 0]
