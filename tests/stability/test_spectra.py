import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from loops import InputError
from stability import (
    bromwich_margin,
    flutter_pairs,
    operator_norm,
    spectrum,
    symmetric_modes,
    symmetric_part,
    symmetric_spectrum,
)
from tests.oracles.stability_operators import isotropic_diamond, rotation

ENTRIES = st.floats(-1.0, 1.0, allow_subnormal=False)
OPERATORS = st.integers(1, 5).flatmap(lambda m: arrays(np.float64, (m, m), elements=ENTRIES))


def test_spectrum_is_that_of_the_operator_not_of_its_symmetric_part():
    K = np.array([[1.0, 4.0], [0.0, 1.0]])
    np.testing.assert_allclose(spectrum(K), [1.0, 1.0], atol=1e-15)
    np.testing.assert_allclose(symmetric_spectrum(K), [-1.0, 3.0], atol=1e-15)


def test_spectrum_with_known_roots():
    roots = np.array([-2.0, 0.5, 3.0])
    S = np.random.default_rng(1).standard_normal((3, 3))
    values = spectrum(S @ np.diag(roots) @ np.linalg.inv(S))
    np.testing.assert_allclose(values, roots, atol=1e-12)


@pytest.mark.parametrize("alpha0", np.radians([10.0, 35.0, 45.0, 80.0]))
@pytest.mark.parametrize("E", [0.05, 0.19, 0.30])
def test_diamond_on_the_isotropic_path(alpha0, E):
    kappa = 0.24
    K = isotropic_diamond(alpha0, kappa, E)
    det = kappa - E / (1.0 - E)
    np.testing.assert_allclose(np.prod(spectrum(K)), det, atol=1e-14)
    np.testing.assert_allclose(symmetric_spectrum(K), spectrum(K).real, atol=1e-14)
    if alpha0 == np.radians(45.0):
        np.testing.assert_allclose(symmetric_spectrum(K), sorted([1.0, det]), atol=1e-15)


def test_modes_reconstruct_the_symmetric_part():
    K = np.random.default_rng(2).standard_normal((6, 3, 3))
    values, vectors = symmetric_modes(K)
    np.testing.assert_allclose(values, symmetric_spectrum(K), atol=1e-14)
    assert np.all(np.diff(values) >= 0.0)
    rebuilt = np.einsum("...ik,...k,...jk->...ij", vectors, values, vectors)
    np.testing.assert_allclose(rebuilt, symmetric_part(K), atol=1e-14)


def test_sign_of_a_mode_does_not_hang_on_round_off():
    for noise in (-1e-15, 0.0, 1e-15):
        _, vectors = symmetric_modes([[1.0 + noise, 2.0], [2.0, 1.0]])
        np.testing.assert_allclose(vectors[:, 0], np.sqrt(0.5) * np.array([1.0, -1.0]), atol=1e-14)


@given(OPERATORS)
def test_bromwich(K):
    """Up to the backward error of the eigenvalues, defective operators included."""
    assert bromwich_margin(K) >= -2e-14 * operator_norm(K)


@pytest.mark.parametrize("coupling", [0.0, 1e-3, 1.0])
def test_bromwich_gap_of_a_jordan_block(coupling):
    K = np.array([[2.0, coupling], [0.0, 2.0]])
    np.testing.assert_allclose(bromwich_margin(K), coupling / 2.0, atol=1e-15)


@given(arrays(np.float64, (2, 2), elements=ENTRIES))
def test_flutter_in_the_plane_is_a_negative_discriminant(K):
    discriminant = 0.25 * (K[0, 0] - K[1, 1]) ** 2 + K[0, 1] * K[1, 0]
    scale = operator_norm(K) ** 2
    if abs(discriminant) > 2e-12 * scale:
        assert flutter_pairs(K).all() == (discriminant < 0.0)


@pytest.mark.parametrize("weight", [1.0, 1e-4, 1e-9, 1e-11])
def test_a_weak_pair_of_a_plain_root_is_flutter(weight):
    assert flutter_pairs([[1.0, weight], [-weight, 1.0]]).all()


@pytest.mark.parametrize("size", [2, 3, 4])
@pytest.mark.parametrize("seed", range(10))
def test_a_defective_double_root_is_no_flutter(size, seed):
    rng = np.random.default_rng(seed)
    jordan = np.diag(np.array([1.0, 1.0, 2.0, 3.0])[:size])
    jordan[0, 1] = 1.0
    Q = rotation(size, seed)
    K = Q @ (jordan + 1e-15 * rng.standard_normal((size, size))) @ Q.T
    assert not flutter_pairs(K).any()
    jordan[1, 0] = -1e-10  # a pair well beyond round-off
    assert flutter_pairs(Q @ jordan @ Q.T).sum() == 2


def test_some_defective_roots_do_split_into_complex_pairs():
    """Otherwise the tolerance above would not be tested."""
    K = np.array([[1.0, 1.0], [-1e-15, 1.0]])
    np.testing.assert_allclose(np.abs(spectrum(K).imag), 1e-15**0.5, rtol=1e-6)


def test_flutter_marks_the_pair_in_the_order_of_the_spectrum():
    K = np.zeros((3, 3))
    K[:2, :2], K[2, 2] = [[2.0, 1.0], [-1.0, 2.0]], -1.0
    np.testing.assert_allclose(spectrum(K), [-1.0, 2.0 - 1.0j, 2.0 + 1.0j], atol=1e-15)
    assert flutter_pairs(K).tolist() == [False, True, True]


def test_batches_agree_with_single_operators():
    K = np.random.default_rng(3).standard_normal((2, 5, 4, 4))
    for function in (spectrum, symmetric_spectrum, bromwich_margin, flutter_pairs, operator_norm):
        one_by_one = [[function(K[i, j]) for j in range(5)] for i in range(2)]
        np.testing.assert_allclose(function(K), one_by_one, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_operators_that_are_not_finite_leave_the_others_alone(bad):
    K = np.stack([np.diag([1.0, 2.0]), np.diag([bad, 2.0])])
    assert symmetric_spectrum(K)[0].tolist() == [1.0, 2.0]
    for numbers in (spectrum(K), symmetric_spectrum(K), *symmetric_modes(K), bromwich_margin(K)):
        assert np.isfinite(numbers[0]).all()
        assert np.isnan(numbers[1]).all()
    assert not flutter_pairs(K).any()


@pytest.mark.parametrize("unit", [1e-200, 1.0, 1e200])
def test_norm_in_any_unit(unit):
    np.testing.assert_allclose(operator_norm(unit * np.diag([3.0, 4.0])), 5.0 * unit, rtol=1e-15)


def test_norm_of_zero():
    assert operator_norm(np.zeros((2, 2))) == 0.0


def test_not_an_operator():
    with pytest.raises(InputError, match=r"operator: got shape \(2, 3\)"):
        spectrum(np.ones((2, 3)))
