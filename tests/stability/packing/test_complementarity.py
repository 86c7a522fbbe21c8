"""Complementarity problems with a known number of solutions."""

import numpy as np
import pytest

from stability.packing.complementarity import lemke, solve_complementarity, solve_from, violation


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


def test_one_contact_has_none_one_or_two_solutions():
    def count(q, m):
        return len(solve_complementarity(np.array([q]), np.array([[m]])).active)

    assert (count(1.0, 1.0), count(-1.0, 1.0)) == (1, 1)
    assert (count(1.0, -1.0), count(-1.0, -1.0)) == (2, 0)


def test_many_contacts_without_a_solution_are_proved_to_have_none():
    q, M = random_problem(30, 2)
    q, M = np.append(q, -1.0), np.pad(M, (0, 1))
    found = solve_complementarity(q, M)
    assert len(found.active) == 0 and found.proof == "infeasible"


def test_two_solutions_are_found_from_different_starts():
    q, M = random_problem(30, 3)
    q, M = np.append(q, 1.0), np.pad(M, (0, 1))
    M[-1, -1] = -1.0
    found = solve_complementarity(q, M)
    assert len(found.active) == 2 and found.proof == ""
    assert not found.active[0][-1] and found.active[1][-1]
