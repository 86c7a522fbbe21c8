import mpmath as mp
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from loops import InputError
from stability import plane_cone, second_order_work, symmetric_spectrum, unstable_fraction
from tests.oracles.stability_operators import isotropic_diamond

OPERATORS = arrays(np.float64, (2, 2), elements=st.floats(-1.0, 1.0, allow_subnormal=False))


def exact_cone(K):
    """Opening and edges of the float entries taken as exact: roots of q in tan(theta - axis)."""
    with mp.workdps(60):
        p, s = mp.mpf(float(K[0, 0])), mp.mpf(float(K[1, 1]))
        q = (mp.mpf(float(K[0, 1])) + mp.mpf(float(K[1, 0]))) / 2
        mean, radius = (p + s) / 2, mp.hypot((p - s) / 2, q)
        half = mp.acos(mean / radius) / 2
        axis = mp.fmod(mp.atan2(q, (p - s) / 2) / 2 + mp.pi / 2, mp.pi)
        return 2 * half, axis, (axis - half, axis + half)


@pytest.mark.parametrize("mu", [1e-12, 1e-8, 1e-3, 0.25, 1.0, 50.0, 1e6])
def test_sliding_contact(mu):
    """Opening arctan mu: W2 = E1 (E1 + mu E2), so the edges are E1 = 0 and E1 = -mu E2."""
    cone = plane_cone([[1.0, 0.0], [mu, 0.0]], rtol=0.0)
    assert cone.status == "open"
    np.testing.assert_allclose(cone.opening, np.arctan(mu), rtol=4e-16)
    np.testing.assert_allclose(cone.edges, [np.pi / 2, np.pi / 2 + np.arctan(mu)], rtol=4e-16)


@pytest.mark.parametrize("scale", [1e-8, 1.0, 1e8])
@pytest.mark.parametrize("turn", [0.0, 0.4, 1.3])
def test_eigenvalues_of_very_different_size(scale, turn):
    c, s = np.cos(turn), np.sin(turn)
    Q = np.array([[c, -s], [s, c]])
    K = Q @ np.diag([1.0, -scale]) @ Q.T + np.array([[0.0, 0.1], [-0.1, 0.0]])
    cone, (opening, axis, edges) = plane_cone(K), exact_cone(K)
    np.testing.assert_allclose(cone.opening, float(opening), rtol=1e-15)
    np.testing.assert_allclose(cone.axis, float(axis), rtol=1e-15)
    np.testing.assert_allclose(cone.edges, [float(edge) for edge in edges], atol=1e-15, rtol=0)


@given(st.integers(0, 10**6))
def test_accurate_as_the_cone_closes(seed):
    """Entries whose determinant cancels almost wholly still give the opening to round-off."""
    rng = np.random.default_rng(seed)
    t = rng.uniform(0.1, 10.0)
    K = np.array([[1.0, t], [t, t * t]]) * rng.uniform(0.5, 2.0)
    K += rng.choice([1e-8, 1e-13, 1e-15]) * rng.standard_normal((2, 2))
    cone = plane_cone(K, rtol=0.0)
    with mp.workdps(60):
        (a, b), (c, d) = [[mp.mpf(float(entry)) for entry in row] for row in K]
        det = a * d - (b + c) ** 2 / 4
    if det > 0:
        assert (cone.status, cone.opening) == ("empty", 0.0)
    elif det < 0:
        assert cone.status == "open"
        np.testing.assert_allclose(cone.opening, float(exact_cone(K)[0]), rtol=2e-15)


@given(OPERATORS)
def test_edges_are_neutral_and_the_axis_is_the_lowest(K):
    cone = plane_cone(K)
    assume(cone.status == "open")
    edges = np.stack([np.cos(cone.edges), np.sin(cone.edges)], -1)
    scale = np.abs(K).max()
    np.testing.assert_allclose(second_order_work(K, edges), 0.0, atol=4e-15 * scale)
    lowest = second_order_work(K, [np.cos(cone.axis), np.sin(cone.axis)])
    np.testing.assert_allclose(lowest, symmetric_spectrum(K)[0], atol=4e-15 * scale)
    assert 0.0 <= cone.axis < np.pi
    np.testing.assert_allclose(cone.edges.mean(), cone.axis, atol=1e-15)


@given(OPERATORS)
def test_opening_over_pi_is_the_unstable_fraction(K):
    """To sqrt(eps) only: the fraction starts from rounded eigenvalues."""
    fraction = unstable_fraction(symmetric_spectrum(K))
    assume(np.abs(K).max() > 1e-6)
    np.testing.assert_allclose(plane_cone(K).opening / np.pi, fraction, atol=5e-8)


def test_opening_counts_directions():
    K = np.random.default_rng(1).standard_normal((40, 2, 2))
    theta = np.pi * (np.arange(20_000) + 0.5) / 20_000
    directions = np.stack([np.cos(theta), np.sin(theta)], -1)
    counted = (second_order_work(K[:, None], directions) < 0.0).mean(axis=1)
    np.testing.assert_allclose(plane_cone(K).opening / np.pi, counted, atol=1e-4)
    assert set(plane_cone(K).status) == {"empty", "open", "all"}


@pytest.mark.parametrize(
    ("K", "status", "opening"),
    [
        (np.diag([1.0, 2.0]), "empty", 0.0),
        (np.diag([1.0, 0.0]), "ray", 0.0),
        (np.diag([1.0, -1e-13]), "ray", 2.0 * np.arctan(np.sqrt(1e-13))),
        (np.diag([1.0, -1.0]), "open", np.pi / 2),
        (np.diag([0.0, -1.0]), "all", np.pi),
        (np.diag([-1.0, -2.0]), "all", np.pi),
        (np.eye(2), "empty", 0.0),
        (-np.eye(2), "all", np.pi),
        (np.zeros((2, 2)), "undetermined", 0.0),
        (np.array([[1.0, 1.0], [1.0, 1.0]]), "ray", 0.0),
        (np.array([[0.0, 1.0], [-1.0, 0.0]]), "undetermined", 0.0),
    ],
)
def test_statuses(K, status, opening):
    cone = plane_cone(K)
    assert cone.status == status
    np.testing.assert_allclose(cone.opening, opening, rtol=1e-15)


def test_what_does_not_exist_is_nan():
    empty, alike, ray = (plane_cone(np.diag(d)) for d in ([1.0, 2.0], [-1.0, -1.0], [0.0, 1.0]))
    assert np.isnan(empty.edges).all()
    assert empty.axis == 0.0
    assert np.isnan(alike.axis)
    assert np.isnan(alike.edges).all()
    assert ray.edges.tolist() == [0.0, 0.0]


@pytest.mark.parametrize("alpha0", np.radians([5.0, 35.0, 45.0, 85.0]))
def test_diamond_opens_along_the_kernel(alpha0):
    kappa = 0.24
    critical = kappa / (1.0 + kappa)
    cone = plane_cone([isotropic_diamond(alpha0, kappa, critical + d) for d in (-1e-9, 0.0, 1e-9)])
    assert cone.status.tolist() == ["empty", "ray", "open"]
    kernel = np.pi - np.arctan(np.tan(alpha0) ** -2)  # (42): along (tan^2 alpha0, -1)
    np.testing.assert_allclose(cone.axis, kernel, atol=1e-7)
    det = kappa - (critical + 1e-9) / (1.0 - critical - 1e-9)
    trace = np.trace(isotropic_diamond(alpha0, kappa, critical))
    np.testing.assert_allclose(cone.opening[2], 2.0 * np.sqrt(-det) / trace, rtol=1e-5)


@pytest.mark.parametrize("unit", [1e-160, 1e160])
def test_units_do_not_matter(unit):
    K = np.array([[1.0, 0.4], [-0.1, -0.3]])
    np.testing.assert_allclose(plane_cone(unit * K).edges, plane_cone(K).edges, rtol=1e-15)
    assert plane_cone(unit * K).status == "open"


def test_batches_and_operators_that_are_not_finite():
    K = np.random.default_rng(2).standard_normal((2, 3, 2, 2))
    K[1, 1, 0, 1] = np.nan
    cone = plane_cone(K)
    assert cone.status.shape == cone.opening.shape == cone.axis.shape == (2, 3)
    assert cone.edges.shape == (2, 3, 2)
    assert cone.status[1, 1] == "undetermined"
    assert np.isnan([cone.opening[1, 1], cone.axis[1, 1], *cone.edges[1, 1]]).all()
    np.testing.assert_array_equal(cone.edges[0, 2], plane_cone(K[0, 2]).edges)


def test_needs_the_plane():
    with pytest.raises(InputError, match=r"\(\.\.\., 2, 2\)"):
        plane_cone(np.eye(3))
