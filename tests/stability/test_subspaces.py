import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from loops import InputError
from stability import restrict, rotate_tangent, subspace_basis, symmetric_part, symmetric_spectrum

SUBSPACES = ("diagonal", "symmetric", "full")
ANGLES = st.floats(-10.0, 10.0)


def random_tangents(seed, *shape):
    return np.random.default_rng(seed).standard_normal((*shape, 4, 4))


@pytest.mark.parametrize(("subspace", "size"), [("diagonal", 2), ("symmetric", 3), ("full", 4)])
def test_bases_are_orthonormal(subspace, size):
    basis = subspace_basis(subspace)
    assert basis.shape == (size, 4)
    np.testing.assert_allclose(basis @ basis.T, np.eye(size), atol=3e-16)


def test_symmetric_holds_no_rotation():
    rotation = np.array([0.0, 1.0, -1.0, 0.0])
    assert np.all(subspace_basis("symmetric") @ rotation == 0.0)


def test_basis_is_the_callers_own():
    subspace_basis("full")[0, 0] = 7.0
    assert subspace_basis("full")[0, 0] == 1.0


@pytest.mark.parametrize("subspace", SUBSPACES)
def test_restriction_keeps_second_order_work(subspace):
    A = random_tangents(1, 3, 5)
    K, basis = restrict(A, subspace), subspace_basis(subspace)
    e = np.random.default_rng(2).standard_normal(len(basis))
    H = (e @ basis).reshape(2, 2)
    stress = np.einsum("...ijkl,kl->...ij", A.reshape(3, 5, 2, 2, 2, 2), H)
    np.testing.assert_allclose(
        np.einsum("i,...ij,j", e, K, e), np.einsum("...ij,ij", stress, H), rtol=1e-12, atol=1e-13
    )


def test_restriction_commutes_with_the_symmetric_part():
    A = random_tangents(3)
    for subspace in SUBSPACES:
        K = restrict(A, subspace)
        np.testing.assert_allclose(
            symmetric_part(K), restrict(symmetric_part(A), subspace), atol=4e-16
        )
    assert np.abs(K - K.T).max() > 0.1  # and is itself left nonsymmetric


def test_symmetric_components_by_hand():
    A = np.zeros((4, 4))
    A[0, 1], A[0, 2], A[1, 2], A[3, 0] = 2.0, 4.0, 6.0, 5.0
    expected = [[0.0, 0.0, 6.0 * np.sqrt(0.5)], [5.0, 0.0, 0.0], [0.0, 0.0, 3.0]]
    np.testing.assert_allclose(restrict(A, "symmetric"), expected, atol=1e-15)


@given(ANGLES)
def test_rotated_components_are_those_of_the_tensor(angle):
    A = random_tangents(4)
    Q = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    tensor = A.reshape(2, 2, 2, 2)
    rotated = np.einsum("ijkl,ia,jb,kc,ld->abcd", tensor, Q, Q, Q, Q).reshape(4, 4)
    np.testing.assert_allclose(rotate_tangent(A, angle), rotated, atol=1e-14)


@given(ANGLES)
@pytest.mark.parametrize("subspace", ["symmetric", "full"])
def test_rotation_keeps_the_spectrum(subspace, angle):
    A = random_tangents(5)
    np.testing.assert_allclose(
        symmetric_spectrum(restrict(rotate_tangent(A, angle), subspace)),
        symmetric_spectrum(restrict(A, subspace)),
        atol=1e-14,
    )


def test_rotations_compose_and_broadcast():
    A, angles = random_tangents(6, 2, 1), np.linspace(0.0, 3.0, 4)
    turned = rotate_tangent(A, angles)
    assert turned.shape == (2, 4, 4, 4)
    np.testing.assert_allclose(turned[1, 2], rotate_tangent(A[1, 0], angles[2]), atol=1e-15)
    np.testing.assert_allclose(
        rotate_tangent(turned, 0.7), rotate_tangent(A, angles + 0.7), atol=1e-14
    )


def test_an_isotropic_tangent_does_not_turn():
    trace = np.array([1.0, 0.0, 0.0, 1.0])
    A = 2.0 * np.eye(4) + 3.0 * np.outer(trace, trace)
    np.testing.assert_allclose(rotate_tangent(A, 0.3), A, atol=2e-15)


def test_unknown_subspace():
    with pytest.raises(InputError, match=r"subspace: got 'shear'.*diagonal, symmetric or full"):
        subspace_basis("shear")


@pytest.mark.parametrize("A", [np.eye(3), np.ones(4), np.ones((4, 3)), 1j * np.eye(4)])
def test_not_a_macroscopic_tangent(A):
    with pytest.raises(
        InputError, match=r"operator: got (shape .*\(\.\.\., 4, 4\)|.*real numbers)"
    ):
        restrict(A, "diagonal")
