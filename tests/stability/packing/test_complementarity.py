"""Complementarity problems with a known number of solutions."""

import numpy as np
import pytest

from stability import complementarity
from stability.complementarity import (
    Errors,
    _newton,
    basic_values,
    lemke,
    nearest_regimes,
    scaled_definite,
    solve_complementarity,
    solve_from,
    violation,
)
from stability.solution_branch import solutions_over_slip


def random_problem(m, seed):
    """A positive definite, nonsymmetric problem: it has one solution."""
    rng = np.random.default_rng(seed)
    half, turn = rng.normal(size=(m, m)), rng.normal(size=(m, m))
    return rng.normal(size=m), half @ half.T / m + 0.05 * np.eye(m) + turn - turn.T


@pytest.mark.parametrize("seed", range(5))
def test_lemke_and_newton_agree_with_enumeration(seed):
    q, M = random_problem(8, seed)
    exact = solve_complementarity(q, M)
    assert exact.proof == "enumeration" and len(exact.active) == 1
    assert np.array_equal(lemke(q, M), exact.active[0])
    for start in (np.zeros(8, bool), np.ones(8, bool), q < 0):
        assert np.array_equal(solve_from(q, M, start), exact.active[0])


def test_a_large_definite_problem_has_one_solution_and_says_so():
    q, M = random_problem(60, 1)
    found = solve_complementarity(q, M)
    assert found.proof == "positive definite" and len(found.active) == 1
    assert violation(q, M, found.active[0]) < 1e-12


@pytest.mark.parametrize("seed", range(3))
def test_newton_alone_solves_weakly_coupled_contacts(seed, monkeypatch):
    def unused(q, M):
        raise AssertionError("Lemke's method is the slower one")

    monkeypatch.setattr(complementarity, "lemke", unused)
    rng = np.random.default_rng(seed)
    q, M = rng.normal(size=60), np.eye(60) + 0.06 * rng.normal(size=(60, 60))
    assert violation(q, M, solve_from(q, M, np.zeros(60, bool))) < 1e-12


def test_one_contact_has_none_one_or_two_solutions():
    def count(q, m):
        return len(solve_complementarity(np.array([q]), np.array([[m]])).active)

    assert (count(1.0, 1.0), count(-1.0, 1.0)) == (1, 1)
    assert (count(1.0, -1.0), count(-1.0, -1.0)) == (2, 0)


def test_many_contacts_without_a_solution_are_proved_to_have_none(monkeypatch):
    q, M = random_problem(30, 2)
    q, M = np.append(q, -1.0), np.pad(M, (0, 1))
    tried = []
    monkeypatch.setattr(complementarity, "solve_from", lambda *problem: tried.append(problem))
    for starts in (2, 10):
        found = solve_complementarity(q, M, starts)
        assert len(found.active) == 0 and found.proof == "infeasible"
    # After the proof no random start is tried.
    assert len(tried) == 2 + 3


def test_two_solutions_are_found_from_different_starts():
    q, M = random_problem(30, 3)
    q, M = np.append(q, 1.0), np.pad(M, (0, 1))
    M[-1, -1] = -1.0
    found = solve_complementarity(q, M)
    assert len(found.active) == 2 and found.proof == ""
    assert not found.active[0][-1] and found.active[1][-1]


@pytest.mark.parametrize("seed", [0, 1, 4, 9])
def test_only_the_contact_that_softens_is_kept_from_sliding(seed):
    """Its slip would load all others, whose own problem has a solution."""
    q, M = random_problem(20, seed)
    q, M = np.append(q, -1.0), np.pad(M, (0, 1))
    M[-1, -1], M[:-1, -1] = -0.5, 2 * np.random.default_rng(seed).normal(size=20)
    values = basic_values(q, M, nearest_regimes(q, M))
    assert values[-1] == pytest.approx(-1.0) and (values[:-1] >= 0).all()


def test_where_every_contact_softens_none_slides():
    active = nearest_regimes(np.array([-1.0, 0.5]), np.array([[-1.0, 0.2], [0.0, -0.5]]))
    assert not active.any()


@pytest.mark.parametrize("enumerated", [12, 0])
def test_a_wrong_sign_within_a_billionth_is_rounding(enumerated, monkeypatch):
    monkeypatch.setattr(complementarity, "ENUMERATED", enumerated)
    for wrong, slides in ((1e-10, False), (1e-8, True)):
        found = solve_complementarity(np.array([1.0, -wrong]), np.eye(2), 1)
        assert found.active.tolist()[0] == [False, slides]


def test_a_continuum_of_solutions_is_several():
    """Two contacts share one slip; a pair that slides freely, whose other end is open."""
    shared = solve_complementarity(-np.ones(2), np.ones((2, 2)))
    assert len(shared.active) == 3 and shared.active[0].all()
    free = solve_complementarity(np.array([0.0, 0.0, 1.0]), np.diag([0.0, 0.0, 1.0]))
    assert len(free.active) > 1
    none = solve_complementarity(np.array([-1.0, 1.0]), np.ones((2, 2)) - 1.0)
    assert len(none.active) == 0 and none.proof == "enumeration"


def test_a_singular_block_is_no_solution_of_the_search():
    """What slides there would slide without end, kept by rounding alone."""
    block = np.array([[1.0, -1.0], [-1.0, 1.0 + 1e-13]])
    q, M = np.append(np.ones(11), [-1.0, -1.0]), np.eye(13)
    M[-2:, -2:] = block
    assert solve_from(q, M, np.append(np.zeros(11, bool), [True, True])) is None
    assert len(solve_complementarity(q, M).active) == 0


@pytest.mark.parametrize("unit", [1.0, 2.0**9, 2.0**-9])
def test_violation_is_the_worst_sign_over_the_largest_rate(unit):
    q, M = np.array([1.0, -0.25, 4.0]), np.eye(3)
    assert violation(unit * q, M, np.zeros(3, bool)) == 0.25 / 4.0
    assert violation(unit * q, M, np.array([False, True, False])) == 0.0
    assert violation(0 * q, M, np.zeros(3, bool)) == 0.0


def test_newton_stops_where_a_block_is_singular():
    """The second set has no values: the best set met before it is kept."""
    found, wrong = _newton(np.array([-1.0, 1.0]), np.zeros((2, 2)), np.zeros(2, bool))
    assert not found.any() and wrong == 1


def test_newton_ends_where_sets_recur(monkeypatch):
    """One contact that softens on its own: sliding and sticking disagree in turn."""
    asked = []
    values = complementarity.basic_values
    monkeypatch.setattr(
        complementarity, "basic_values", lambda *given: asked.append(given[2]) or values(*given)
    )
    found, wrong = _newton(np.array([-1.0]), np.array([[-1.0]]), np.zeros(1, bool))
    assert not found.any() and wrong == 1
    assert [one.tolist() for one in asked] == [[False], [True]]


def test_all_solutions_are_met_over_the_slip_of_one_critical_contact():
    """Held to every combination: none, one, two and more solutions."""
    rng, met = np.random.default_rng(4), dict.fromkeys(range(4), 0)
    for _ in range(300):
        m = int(rng.integers(2, 7))
        q, M = rng.standard_normal(m), np.eye(m) + 0.3 * rng.standard_normal((m, m))
        M[:, 0] *= rng.choice([-2.0, 1.0])
        rest = np.arange(m) > 0
        if not scaled_definite(M[np.ix_(rest, rest)])[0]:
            continue
        start = np.insert(solve_from(q[1:], M[1:, 1:], np.zeros(m - 1, bool)), 0, False)
        found = {one.tobytes() for one in solutions_over_slip(q, M, 0, start)}
        assert found == {one.tobytes() for one in solve_complementarity(q, M).active}
        met[min(len(found), 3)] += 1
    assert met[0] > 20 and met[1] > 20 and met[2] > 20


def test_a_regular_set_stands_for_a_singular_one_with_the_same_slips():
    """The third contact neither is loaded nor resists, but by the rounding of its entries."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        M = np.pad(np.eye(2) + 0.3 * rng.normal(size=(2, 2)), (0, 1))
        q = -M @ np.array([*rng.uniform(0.1, 1.0, 2), 0.0])
        found = solve_complementarity(
            q, M + 1e-14 * rng.normal(size=M.shape), errors=Errors(1e-13, 1e-13)
        )
        assert found.active[0].tolist() == [True, True, False]
        assert found.singular and len(found.families) == 1


@pytest.mark.parametrize("beyond", [1e-11, 1e-6])
def test_errors_grow_in_the_inverse_of_a_set(beyond):
    """The second contact sticks and slides alike, as far as the slip of the first is known."""
    q, M = np.array([-1.0, -1e6 * (1.0 + beyond)]), np.array([[1e-6, 0.0], [1.0, -1.0]])
    found = solve_complementarity(q, M, errors=Errors(1e-10))
    assert len(found.active) == int(beyond < 1e-9)
