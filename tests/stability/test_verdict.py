import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from loops import InputError, LinearFrictional, affine_tangent
from patterns import regular_polygon
from stability import RTOL, judge, operator_norm, restrict, statuses, symmetric_spectrum
from tests.oracles.stability_operators import PAIRWISE_POSITIVE, isotropic_diamond, rotation


def test_definiteness_is_not_a_matter_of_pairs():
    pairs = [PAIRWISE_POSITIVE[np.ix_(p, p)] for p in ([0, 1], [0, 2], [1, 2])]
    assert {judge(K).status for K in pairs} == {"stable"}
    verdict = judge(PAIRWISE_POSITIVE)
    assert verdict.status == "unstable"
    np.testing.assert_allclose(verdict.symmetric_eigenvalues, [-0.8, 1.9, 1.9], atol=1e-14)
    np.testing.assert_allclose(np.abs(verdict.witness), np.full(3, 3**-0.5), atol=1e-14)


def test_the_smallest_eigenvalue_is_given_in_the_unit_of_the_tangent():
    """Eigenvalues 0.45 + 0.55 and 0.45 - 0.55, times kn = 1e6."""
    K = 1e6 * np.array([[0.45, 0.55], [0.55, 0.45]])
    verdict = judge(K)
    assert verdict.lambda_min == pytest.approx(-1e5, rel=1e-13)
    assert verdict.lambda_min == pytest.approx(verdict.margin * np.linalg.norm(K), rel=1e-14)


@pytest.mark.parametrize("alpha0", np.radians([20.0, 35.0, 45.0, 70.0]))
@pytest.mark.parametrize("kappa", [0.05, 0.24, 1.5])
def test_diamond_changes_status_at_its_critical_strain(alpha0, kappa):
    critical = kappa / (1.0 + kappa)
    before, at, after = (
        judge(isotropic_diamond(alpha0, kappa, critical + step)) for step in (-1e-9, 0.0, 1e-9)
    )
    assert (before.status, before.mode) == ("stable", "none")
    assert (at.status, at.mode) == ("undetermined", "divergence")
    assert (after.status, after.mode) == ("unstable", "divergence")
    kernel = np.array([np.tan(alpha0) ** 2, -1.0])  # of (42)
    along = abs(at.witness @ kernel) / np.linalg.norm(kernel)
    np.testing.assert_allclose(along, 1.0, atol=1e-14)


def test_margin_and_witness_show_the_loss():
    K = np.random.default_rng(1).standard_normal((4, 4))
    verdict = judge(K, "symmetric")
    restricted = restrict(K, "symmetric")
    work = verdict.witness @ restricted @ verdict.witness
    np.testing.assert_allclose(work / operator_norm(restricted), verdict.margin, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(verdict.witness), 1.0, atol=1e-15)
    assert verdict.subspace == "symmetric"


def test_the_subspace_decides():
    A = np.diag([1.0, 0.0, 0.0, 1.0])
    A[1:3, 1:3] = [[1.0, 2.0], [2.0, 1.0]]  # 3 in shear, -1 in rotation
    assert [judge(A, name).status for name in ("diagonal", "symmetric", "full")] == [
        "stable",
        "stable",
        "unstable",
    ]
    np.testing.assert_allclose(
        np.abs(judge(A, "full").witness), [0.0, 0.5**0.5, 0.5**0.5, 0.0], atol=1e-15
    )


def test_the_tangent_of_a_closure_is_judged_without_its_rotation():
    """A pentagon between the threshold of its rotation and that of its strains; an array as it is.

    With spins blocked: kappa/(1 + kappa) and (1 + kappa)/(2 + kappa) under the affine closure.
    """
    law, loop = LinearFrictional(1.0, 0.2), regular_polygon(5, strain=0.3)
    tangent = affine_tangent(loop, law)
    verdict = judge(tangent)
    assert (verdict.subspace, verdict.status) == ("symmetric", "stable")
    assert "symmetric" in str(verdict) and verdict.facts()["subspace"] == "symmetric"
    named = judge(tangent, "symmetric")
    assert (verdict.margin, verdict.tolerance) == (named.margin, named.tolerance)
    assert judge(tangent, "full").status == judge(tangent.matrix).status == "unstable"
    assert judge(tangent.matrix).subspace == "given"


@pytest.mark.parametrize(
    ("K", "status", "divergence", "flutter", "mode"),
    [
        ([[2.0, 1.0], [-1.0, 2.0]], "stable", False, True, "flutter"),
        ([[1.0, 4.0], [0.0, 1.0]], "unstable", False, False, "none"),
        ([[1.0, 4.0], [-1.0, 1.0]], "unstable", False, True, "flutter"),
        ([[-1.0, 4.0], [-4.0, -1.0]], "unstable", False, True, "flutter"),
        ([[-1.0, 0.0], [0.0, 1.0]], "unstable", True, False, "divergence"),
        ([[0.0, 1.0], [0.0, 1.0]], "unstable", True, False, "divergence"),
        (
            [[2.0, 1.0, 0.0], [-1.0, 2.0, 0.0], [0.0, 0.0, -1.0]],
            "unstable",
            True,
            True,
            "divergence",
        ),
        ([[0.0, 0.0], [0.0, 0.0]], "undetermined", True, False, "divergence"),
    ],
)
def test_losses_told_apart(K, status, divergence, flutter, mode):
    verdict = judge(K)
    assert (verdict.status, verdict.divergence, verdict.flutter) == (status, divergence, flutter)
    assert verdict.mode == mode


@given(st.integers(0, 10**6), st.integers(1, 4), st.integers(0, 4))
def test_status_survives_congruence(seed, size, negatives):
    """Sylvester: a change of conjugate variables keeps the signs of Ks."""
    rng = np.random.default_rng(seed)
    values = rng.uniform(0.5, 2.0, size) * np.where(np.arange(size) < negatives, -1.0, 1.0)
    skew = rng.standard_normal((size, size))
    K = np.diag(values) + skew - skew.T
    S = rotation(size, seed) @ np.diag(rng.uniform(0.2, 5.0, size)) @ rotation(size, seed + 1)
    transformed = S.T @ K @ S
    assert judge(transformed).status == judge(K).status == ("unstable" if negatives else "stable")
    signs = np.sign(symmetric_spectrum(transformed))
    assert signs.tolist() == sorted(np.sign(values).tolist())


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_distrusted_operator_is_undetermined(bad):
    verdict = judge([[1.0, bad], [0.0, 1.0]])
    assert (verdict.status, verdict.mode) == ("undetermined", "none")
    assert np.isnan(verdict.margin)
    assert np.isnan(verdict.witness).all()
    assert np.isnan(verdict.eigenvalues).all()
    assert "undetermined" in str(verdict)


@pytest.mark.parametrize("unit", [1e-150, 1e-3, 1.0, 1e9, 1e150])
def test_units_do_not_matter(unit):
    base = np.array([[1.0, 0.3], [-0.2, 0.5]])
    for K in (base, base - 0.6 * np.eye(2)):
        assert judge(unit * K).status == judge(K).status
        np.testing.assert_allclose(judge(unit * K).margin, judge(K).margin, rtol=1e-12)
        assert judge(unit * K).mode == judge(K).mode


def test_the_tolerance_is_the_callers():
    K = np.diag([1e-6, 1.0])
    assert judge(K).status == "stable"
    assert judge(K, rtol=1e-5).status == "undetermined"
    assert judge(K, rtol=1e-5).tolerance == 1e-5
    assert judge(-K, rtol=1e-5).status == "unstable"


@pytest.mark.parametrize("seed", range(20))
def test_stable_never_diverges(seed):
    """Round-off at the very edge of the tolerance must not contradict Bromwich."""
    S = np.random.default_rng(seed).standard_normal((4, 4))
    margin = judge(S @ S.T).margin
    verdict = judge(S @ S.T, rtol=margin * (1.0 - 1e-15))
    assert verdict.status == "stable"
    assert not verdict.divergence


def test_statuses_follow_judge():
    K = np.random.default_rng(3).standard_normal((200, 3, 3)) + 1.5 * np.eye(3)
    K[::10] *= np.nan
    K[5] = np.diag([0.0, 1.0, 1.0])
    together = statuses(symmetric_spectrum(K)[:, 0], operator_norm(K))
    assert together.tolist() == [judge(k).status for k in K]
    assert set(together) == {"stable", "unstable", "undetermined"}


@pytest.mark.parametrize(
    ("lambda_min", "status"),
    [(2.1 * RTOL, "stable"), (1.9 * RTOL, "undetermined"), (-2.1 * RTOL, "unstable")],
)
def test_statuses_scale_their_band(lambda_min, status):
    assert statuses(lambda_min, 2.0).item() == status


def test_a_verdict_is_one_line_and_frozen():
    verdict = judge([[1.0, 4.0], [-1.0, -3.0]])  # Ks has -1 +- 5/2, K the defective root -1
    assert str(verdict) == (
        "unstable (given): lambda_min/|K| = -0.6736 (tolerance 1e-12) along (-0.316, 0.949); "
        "spectrum of K: divergence"
    )
    with pytest.raises(dataclasses.FrozenInstanceError):
        verdict.status = "stable"
    with pytest.raises(ValueError, match="read-only"):
        verdict.witness[0] = 1.0


def test_a_batch_is_refused():
    with pytest.raises(InputError, match=r"a batch of shape \(2, 3, 3\).*statuses"):
        judge(np.ones((2, 3, 3)))


def test_a_subspace_needs_a_macroscopic_tangent():
    with pytest.raises(InputError, match=r"\(3, 3\)"):
        judge(np.eye(3), "diagonal")
