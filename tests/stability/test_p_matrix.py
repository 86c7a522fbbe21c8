"""P-matrices against all their minors."""

import numpy as np
import pytest

from stability.complementarity import solve_complementarity
from stability.p_matrix import is_p_matrix
from tests.oracles.minors import principal_minors


def matrices(count, seed):
    """Random matrices of one to eight rows, about half of them P-matrices, few definite."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        m = 1 + k % 8
        A, skew = rng.standard_normal((2, m, m))
        kinds = (
            np.eye(m) * rng.uniform(0.5, 3) + A,
            A @ A.T / m + rng.uniform(0, 6) * (skew - skew.T) - 0.1 * np.eye(m),
            np.eye(m) + 0.6 * A,
        )
        yield kinds[k % 3]


def test_answers_are_those_of_all_principal_minors():
    answers = []
    for M in matrices(480, 0):
        minors = principal_minors(M)
        answers.append(bool((minors > 0).all()))
        assert is_p_matrix(M) is answers[-1]
    assert 0.3 < np.mean(answers) < 0.8


def test_rows_and_columns_may_have_units_and_any_order():
    rng = np.random.default_rng(1)
    for M in matrices(80, 1):
        m = len(M)
        left, right = 10.0 ** rng.uniform(-6, 6, (2, m))
        order = rng.permutation(m)
        assert is_p_matrix((left[:, None] * M * right)[np.ix_(order, order)]) is is_p_matrix(M)


def test_a_p_matrix_has_one_solution_for_every_load():
    """Murty 1972; every other matrix has a load with none or several, found by its own column."""
    rng = np.random.default_rng(2)
    for M in matrices(40, 3):
        counts = {
            len(solve_complementarity(q, M).active) for q in rng.standard_normal((20, len(M)))
        }
        if is_p_matrix(M):
            assert counts == {1}


@pytest.mark.parametrize("m", [12, 20, 29])
def test_large_ones_with_a_known_answer(m):
    rng = np.random.default_rng(m)
    skew = rng.standard_normal((m, m))
    M = np.eye(m) + 3.0 * (skew - skew.T)
    assert is_p_matrix(M) is True
    # One negative minor of two, hidden by units.
    M[0, 1], M[1, 0] = 2.0, 0.7
    scale = 10.0 ** rng.uniform(-3, 3, m)
    assert is_p_matrix(scale[:, None] * M / scale) is False


def test_what_is_not_decided():
    assert is_p_matrix(np.ones((3, 3))) is None
    assert is_p_matrix(np.zeros((1, 1))) is None
    rng = np.random.default_rng(0)
    A, skew = rng.standard_normal((2, 20, 20))
    hard = A @ A.T / 20 + 0.2 * (skew - skew.T) - 0.05 * np.eye(20)
    assert is_p_matrix(hard, most=5) is None
    # A vanishing minor beside a negative one is no matter.
    assert is_p_matrix(np.diag([0.0, -1.0, 1.0])) is False
    assert is_p_matrix(np.zeros((0, 0))) is True
    for bad in (np.ones((2, 3)), np.full((2, 2), np.nan)):
        with pytest.raises(ValueError, match="square matrix"):
            is_p_matrix(bad)
