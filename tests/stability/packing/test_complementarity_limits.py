"""Complementarity problems at their limits: units, rounding, ties, continua, singular sets."""

import numpy as np
import pytest

from stability import complementarity
from stability.complementarity import (
    _infeasible,
    _starts,
    exchange,
    feasible_for_all,
    lemke,
    nearest_regimes,
    positive_definite,
    principal_transform,
    solve_complementarity,
    solve_from,
)
from stability.solution_branch import trace_branch
from tests.stability.packing.test_complementarity import random_problem

UNITS = [1.0, 2.0**20, 2.0**-20]
# Two contacts of which the second has one row or column with the first, up to a sign.
SHARED, OPPOSED = np.ones((2, 2)), np.array([[1.0, -1.0], [-1.0, 1.0]])


def beside(M, entry=1.0):
    """One more contact, on its own."""
    M = np.pad(M, (0, 1))
    M[-1, -1] = entry
    return M


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("enumerated", [12, 0])
def test_a_wrong_sign_is_rounding_in_any_unit(enumerated, unit, monkeypatch):
    monkeypatch.setattr(complementarity, "ENUMERATED", enumerated)
    for wrong, slides in ((1e-10, False), (1e-8, True)):
        found = solve_complementarity(unit * np.array([1.0, -wrong]), np.eye(2), 1)
        assert found.active[0].tolist() == [False, slides]


@pytest.mark.parametrize("unit", UNITS)
def test_a_contact_at_its_limit_counts_once(unit):
    """The second one may slide by nothing: two sets, one solution; so close to zero too."""
    for rest in (0.0, -1e-10):
        found = solve_complementarity(unit * np.array([-1.0, rest]), np.eye(2))
        assert found.active.tolist() == [[True, False]]


@pytest.mark.parametrize("unit", UNITS)
def test_solutions_of_a_continuum_in_any_unit(unit):
    """The smallest slip, then both ends; of contacts that push each other on, one end."""
    q = -unit * np.array([1.0, 1.0, 1e-10])
    shared = solve_complementarity(q, beside(SHARED))
    sets = [[True, True, False], [True, False, False], [False, True, False]]
    assert shared.active.tolist() == sets
    q = unit * np.array([-1.0, 1.0, -1.0])
    opposed = solve_complementarity(q, beside(OPPOSED))
    assert opposed.active.tolist() == [[True, False, True], [True, True, True]]


@pytest.mark.parametrize("unit", [1.0, 1e4, 1e-4])
def test_singular_is_a_share_of_the_rows_in_any_unit(unit):
    """Rows that differ by 3e-14 are one row."""
    M = unit * np.add(SHARED, [[0.0, 0.0], [0.0, 2.0**-45]])
    assert len(solve_complementarity(-np.ones(2), M).active) == 3


def test_a_set_whose_wrong_sign_is_certain_is_not_searched(monkeypatch):
    """Two contacts that share a slip of zero; the third can't slide with them."""
    calls, real = [], complementarity.linprog

    def counted(*args, **kwargs):
        calls.append(args)
        return real(*args, **kwargs)

    monkeypatch.setattr(complementarity, "linprog", counted)
    found = solve_complementarity(np.array([0.0, 0.0, 1.0]), beside(SHARED))
    assert found.active.tolist() == [[False, False, False]] and len(calls) == 1


def test_lemke_in_any_unit():
    q, M = random_problem(14, 2)
    exact = lemke(q, M)
    assert exact.any() and not exact.all()
    for unit in (1e-12, 1e12):
        assert np.array_equal(lemke(unit * q, M), exact)
    for unit in (1e-6, 1e6):
        assert np.array_equal(lemke(q, unit * M), exact)


def test_lemke_where_contacts_do_not_see_each_other():
    assert lemke(-np.ones(3), np.eye(3)).all()
    assert lemke(np.array([-1.0, 2.0, -3.0]), np.eye(3)).tolist() == [True, False, True]
    assert not lemke(np.array([1.0, 2.0]), np.eye(2)).any()
    assert lemke(np.array([1.0, -2.0]), -np.eye(2)) is None


def test_lemke_ends_at_a_limit_that_rounding_hides():
    """`z = (1, 0)`, `w = 0`: by rounding the second contact comes first, and ends on a ray."""
    M = np.array([[1.0, -1.0], [0.4 - 1e-15, -0.7]])
    assert lemke(np.array([-1.0, -0.4]), M).tolist() == [True, False]


def test_many_pivots():
    """A chain in which each slip loads the next contact: one pivot after the other."""
    m = 70
    M = np.eye(m) - np.eye(m, k=-1)
    q = np.append(-1.0, np.full(m - 1, 0.5 / m))
    assert lemke(q, M).all()
    assert solve_from(q, M, np.zeros(m, bool)).all()


@pytest.mark.parametrize("unit", UNITS)
def test_no_slip_agrees_in_any_unit(unit):
    assert _infeasible(unit * np.array([-1.0, 1.0]), np.array([[-1.0, 0.0], [0.0, 1.0]]))
    assert not _infeasible(unit * np.array([-1.0, 1.0]), np.array([[1.0, 0.0], [0.0, -1.0]]))


def test_slips_that_raise_all_rates_are_enough_for_any_load():
    """There are none where no slip is enough for a load of -1 everywhere, and only there."""
    rng, seen = np.random.default_rng(0), set()
    for _ in range(40):
        M = rng.standard_normal((5, 5)) - 0.3
        enough = feasible_for_all(M)
        assert enough != _infeasible(-np.ones(5), M)
        assert not (enough and any(_infeasible(q, M) for q in rng.standard_normal((10, 5))))
        seen.add(enough)
    assert seen == {True, False}


def test_without_a_start_only_what_is_known_counts():
    q, M = np.full(13, -1.0), np.eye(13)
    assert len(solve_complementarity(q, M, 0).active) == 0
    (active,) = solve_complementarity(q, M, 0, [q < 0]).active
    assert active.all()


def test_definite_is_the_symmetric_part():
    for M in (np.array([[1.0, -3.0], [0.0, 1.0]]), np.array([[1.0, -3.0], [2.9, 1.0]])):
        definite = np.linalg.eigvalsh(M + M.T)[0] > 0
        assert positive_definite(M) == positive_definite(M.T) == definite
    assert definite


def test_starts_are_none_all_and_the_loaded_ones():
    q = np.array([1.0, -1.0, 2.0, -0.5])
    named = [[False] * 4, [True] * 4, [False, True, False, True]]
    assert [start.tolist() for start in _starts(q, 3)] == named
    several = _starts(q, 40)
    assert [start.tolist() for start in several[:3]] == named and len(several) == 40
    assert 0.3 < np.mean(several[3:]) < 0.7 and len({s.tobytes() for s in several}) > 10
    assert [start.tolist() for start in _starts(q, 1)] == named[:1]


@pytest.mark.parametrize("wrong", [False, True])
def test_a_known_set_is_believed_where_it_solves_the_problem(wrong):
    q, M = random_problem(14, 2)
    exact = solve_complementarity(q, M).active
    found = solve_complementarity(q, M, 3, [exact[0] ^ wrong])
    assert np.array_equal(found.active, exact) and found.proof == "positive definite"


def test_two_contacts_that_push_each_other_on_without_end():
    """Either alone may slide, both may not: one is kept, and the third slides by itself."""
    M = beside(np.array([[1.0, -2.0], [-2.0, 1.0]]))
    assert not len(solve_complementarity(-np.ones(3), M).active)
    assert nearest_regimes(-np.ones(3), M).tolist() == [False, True, True]


def test_a_principal_transform_exchanges_slips_and_rates():
    rng = np.random.default_rng(3)
    q, M, z = rng.normal(size=6), rng.normal(size=(6, 6)), rng.normal(size=6)
    w, active = q + M @ z, np.arange(6) % 2 == 0
    right, table = principal_transform(q, M, active)
    exchanged = right + table @ np.where(active, w, z)
    np.testing.assert_allclose(exchanged, np.where(active, z, w), rtol=0, atol=1e-12)
    assert principal_transform(q, 0.0 * M, active) is None


def test_an_exchange_solves_a_row_for_its_column():
    rng = np.random.default_rng(4)
    table, x = np.asfortranarray(rng.normal(size=(3, 4))), rng.normal(size=4)
    y = table @ x
    exchange(table, 1, 2)
    y[1], x[2] = x[2], y[1]
    np.testing.assert_allclose(table @ x, y, rtol=0, atol=1e-13)


def test_lemke_with_rows_that_do_not_fall():
    """The column of the second slip has a zero: that row bounds nothing."""
    M = np.eye(3) + np.diag([1.0, 1.0], k=-1) * [[0.0], [0.0], [1.0]]
    assert lemke(np.array([-1.0, -0.5, 2.0]), M).tolist() == [True, True, False]


@pytest.mark.parametrize("unit", UNITS)
def test_a_variable_that_is_zero_all_around_ends_no_segment(unit):
    """A third contact with a load of 1e-13 of the largest, of the wrong sign on half the circle."""
    Q, M = unit * np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 1e-13]]), np.eye(3)
    found = trace_branch(Q, M, 0.25 * np.pi, np.zeros(3, dtype=bool))
    assert found.closed and found.winding == 1 and not found.sliding[:, 2].any()
    Q[2] *= 1e3
    assert trace_branch(Q, M, 0.25 * np.pi, np.zeros(3, dtype=bool)).sliding[:, 2].any()
