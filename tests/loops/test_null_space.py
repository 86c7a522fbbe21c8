import numpy as np
import pytest

from loops.closures.null_space import solve_through_null_space


def singular_system(rng, singular_values):
    """A matrix with these singular values, and its right null vectors."""
    size = len(singular_values)
    u, v = (np.linalg.qr(rng.normal(size=(size, size)))[0] for _ in range(2))
    return u @ np.diag(singular_values) @ v.T, v[:, np.asarray(singular_values) == 0]


@pytest.mark.parametrize("small", [1e-2, 1e-6, 1e-10])
def test_small_is_not_null(small):
    """A soft direction counts, however soft, until rounding hides it."""
    rng = np.random.default_rng(1)
    matrix, null = singular_system(rng, [1.0, 0.7, 0.3, small, 0.0])
    exact = rng.normal(size=(5, 2))
    exact -= null @ (null.T @ exact)
    found = solve_through_null_space(matrix, matrix @ exact, np.eye(5))
    assert found.nullity == 1
    np.testing.assert_allclose(found.x, exact, atol=1e-14 / small)
    assert found.condition == pytest.approx(1 / small, rel=1e-4)
    # A hundred roundings: |M||x| is larger than |b|.
    assert found.residual < 2.5e-14


def test_ambiguity_is_what_the_observer_sees_of_the_null_vectors():
    rng = np.random.default_rng(2)
    matrix, null = singular_system(rng, [1.0, 0.7, 0.3, 0.0])
    blind = np.eye(4) - null @ null.T
    assert solve_through_null_space(matrix, matrix, blind).ambiguity < 1e-14
    seen = solve_through_null_space(matrix, matrix, 0.5 * null.T)
    assert seen.ambiguity == pytest.approx(0.5, rel=1e-12)


def test_inconsistent_systems_show_in_the_residual():
    rng = np.random.default_rng(3)
    matrix, _ = singular_system(rng, [1.0, 0.7, 0.0])
    left = np.linalg.svd(matrix)[0][:, -1:]
    assert solve_through_null_space(matrix, left, np.eye(3)).residual == pytest.approx(1.0)


def test_known_null_vectors_give_the_same_answer():
    """Free springs: translations known beforehand, by elimination instead of singular values."""
    rng = np.random.default_rng(4)
    laplacian = np.array([[1.0, -1, 0], [-1, 2, -1], [0, -1, 1]])
    batch = rng.uniform(1, 2, (5, 1, 1)) * laplacian
    known = np.full((3, 1), 3**-0.5)
    rhs = np.array([[1.0], [0.0], [-1.0]])
    plain = solve_through_null_space(batch, rhs, np.eye(3))
    quick = solve_through_null_space(batch, rhs, np.eye(3), known)
    assert (quick.nullity == 1).all()
    each = np.broadcast_to(known, (*batch.shape[:-2], 3, 1))
    assert (solve_through_null_space(batch, rhs, np.eye(3), each).nullity == 1).all()
    np.testing.assert_allclose(quick.x, plain.x, atol=1e-14)
    assert plain.nullity.tolist() == quick.nullity.tolist() == [1] * 5
    # Observed as a whole the translation is an ambiguity; known ones are vouched for.
    assert plain.ambiguity.min() > 0.9
    assert quick.ambiguity.max() == 0.0


def test_one_singular_member_does_not_spoil_its_batch():
    batch = np.stack([np.eye(2), np.zeros((2, 2)), np.diag([1.0, 0.0])])
    found = solve_through_null_space(batch, np.ones((2, 1)), np.eye(2))
    assert found.nullity.tolist() == [0, 2, 1]
    np.testing.assert_allclose(found.x[..., 0], [[1, 1], [0, 0], [1, 0]], atol=1e-15)
    assert found.residual.round(12).tolist() == [0.0, 1.0, round(0.5**0.5, 12)]


def test_a_system_that_is_not_finite_has_no_solution():
    batch = np.stack([np.eye(2), np.full((2, 2), np.nan)])
    found = solve_through_null_space(batch, np.ones((2, 1)), np.eye(2))
    assert found.x[0, :, 0].tolist() == [1.0, 1.0]
    assert np.isnan(found.x[1]).all()
    assert found.residual.tolist() == [0.0, np.inf]


def test_a_moderate_solution_of_an_ill_conditioned_system_has_a_small_residual():
    """An inverse alone leaves condition times rounding, 1e-6 here; one refinement removes it."""
    rng = np.random.default_rng(8)
    left, right = (np.linalg.qr(rng.standard_normal((12, 12)))[0] for _ in range(2))
    matrix = left * np.logspace(0, -10, 12) @ right
    rhs = matrix @ np.ones((12, 1))
    found = solve_through_null_space(matrix, rhs, np.eye(12))
    assert 1e9 < found.condition < 1e12
    assert found.residual < 1e-14
