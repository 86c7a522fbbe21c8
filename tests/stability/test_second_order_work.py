import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from loops import InputError
from stability import (
    alpha_e,
    normalised_second_order_work,
    plane_cone,
    polar_diagram,
    second_order_work,
    symmetric_modes,
)
from tests.oracles.stability_operators import isotropic_diamond

ALPHA0, KAPPA = np.radians(35.0), 0.24  # Table 2 of the source
CRITICAL, STATE_A = KAPPA / (1.0 + KAPPA), 0.24507


def test_second_order_work_by_hand():
    K = [[1.0, 2.0], [3.0, 4.0]]
    assert second_order_work(K, [1.0, -1.0]) == 0.0
    assert second_order_work(K, [2.0, 1.0]) == 4.0 + 10.0 + 4.0


def test_only_the_symmetric_part_works():
    rng = np.random.default_rng(1)
    K, e = rng.standard_normal((5, 3, 3)), rng.standard_normal((5, 3))
    values, vectors = symmetric_modes(K)
    coordinates = np.einsum("...ik,...i->...k", vectors, e)
    np.testing.assert_allclose(
        second_order_work(K, e), (values * coordinates**2).sum(-1), atol=1e-13
    )


@given(st.floats(-1.5, 1.5))
def test_normalised_work_is_a_cosine(angle):
    """A rotation by an angle turns every direction by it."""
    c, s = np.cos(angle), np.sin(angle)
    directions = np.random.default_rng(2).standard_normal((20, 2))
    w2 = normalised_second_order_work(3.0 * np.array([[c, -s], [s, c]]), directions)
    np.testing.assert_allclose(w2, c, atol=1e-15)


def test_length_of_the_direction_does_not_matter():
    K, e = np.array([[1.0, 2.0], [0.0, -1.0]]), np.array([0.3, -0.8])
    w2 = [float(normalised_second_order_work(K, factor * e)) for factor in (1e-8, 1.0, -1e8)]
    np.testing.assert_allclose(w2, w2[1], rtol=1e-14)
    np.testing.assert_allclose(
        second_order_work(K, 3.0 * e), 9.0 * second_order_work(K, e), rtol=1e-15
    )


def test_zero_stress_rate_is_neutral():
    assert normalised_second_order_work([[1.0, 1.0], [1.0, 1.0]], [1.0, -1.0]) == 0.0


def test_normalised_work_never_leaves_its_bounds():
    directions = np.random.default_rng(3).standard_normal((10_000, 3))
    for sign in (-1.0, 1.0):
        w2 = normalised_second_order_work(sign * np.eye(3), directions)
        assert np.abs(w2).max() <= 1.0
        np.testing.assert_allclose(w2, sign, atol=1e-15)


def test_batches_broadcast():
    rng = np.random.default_rng(4)
    K, e = rng.standard_normal((4, 1, 3, 3)), rng.standard_normal((6, 3))
    assert second_order_work(K, e).shape == (4, 6)
    assert second_order_work(K, e)[2, 5] == pytest.approx(e[5] @ K[2, 0] @ e[5], rel=1e-13)


def test_polar_diagram_follows_the_printed_formula():
    """tan alphaE = E1'/E2': abscissa with E2', ordinate with E1'."""
    K = np.array([[1.0, 0.4], [-0.2, -0.3]])
    diagram = polar_diagram(K, directions=8)
    np.testing.assert_allclose(
        diagram.direction, np.stack([np.sin(diagram.angle), np.cos(diagram.angle)], -1), atol=1e-16
    )
    np.testing.assert_allclose(
        diagram.work, normalised_second_order_work(K, diagram.direction), atol=1e-16
    )
    np.testing.assert_allclose(
        diagram.points, (2.0 + diagram.work)[:, None] * diagram.direction[:, ::-1], atol=1e-15
    )
    straight_up = diagram.points[2]  # alphaE = 90 degrees: E1' alone
    np.testing.assert_allclose(straight_up, [0.0, 2.0 + 1.0 / np.hypot(1.0, 0.2)], atol=1e-15)


def test_polar_diagram_is_that_of_a_double_cone():
    diagram = polar_diagram(np.random.default_rng(5).standard_normal((3, 2, 2)), directions=360)
    assert diagram.work.shape == (3, 360)
    assert diagram.points.shape == (3, 360, 2)
    np.testing.assert_allclose(diagram.work[:, :180], diagram.work[:, 180:], atol=1e-13)


def test_points_inside_the_circle_are_the_cone():
    K = isotropic_diamond(ALPHA0, KAPPA, STATE_A)
    diagram, cone = polar_diagram(K, directions=7200), plane_cone(K)
    inside = np.linalg.norm(diagram.points, axis=-1) < 2.0
    np.testing.assert_allclose(inside.mean(), cone.opening / np.pi, atol=2.0 / 7200)
    alpha = np.sort(alpha_e(cone.edges))
    distance = np.mod(diagram.angle[inside] - alpha[0], np.pi)
    assert distance.max() < alpha[1] - alpha[0]


def test_cone_of_the_source_opens_at_the_kernel_of_K():
    """Fig. 11, point I: a single direction, (E1', E2') along (tan^2 alpha0, -1) by (42)."""
    diagram = polar_diagram(isotropic_diamond(ALPHA0, KAPPA, CRITICAL), directions=36_000)
    lowest = diagram.angle[np.argmin(diagram.work[:18_000])]
    expected = np.pi - np.arctan(np.tan(ALPHA0) ** 2)
    assert abs(lowest - expected) < 2 * np.pi / 36_000


def test_loading_direction_enters_the_cone_at_point_A():
    """Fig. 12: outside on the isotropic path, inside once the drained path starts."""
    K = isotropic_diamond(ALPHA0, KAPPA, STATE_A)
    drained = [1.0, -K[1, 0] / K[1, 1]]
    assert normalised_second_order_work(K, [1.0, 1.0]) > 0.0
    np.testing.assert_allclose(
        second_order_work(K, drained), np.linalg.det(K) / K[1, 1], rtol=1e-13
    )
    assert second_order_work(K, drained) < 0.0


@pytest.mark.parametrize(
    ("direction", "message"),
    [
        ([0.0, 0.0], "direction: got a zero vector"),
        ([[1.0, 0.0], [0.0, 0.0]], r"direction \[1\]: got a zero vector"),
        ([1.0, 0.0, 0.0], r"direction: got shape \(3,\), expected shape \(\.\.\., 2\)"),
        (1.0, r"direction: got shape \(\)"),
    ],
)
@pytest.mark.parametrize("function", [second_order_work, normalised_second_order_work])
def test_bad_directions(function, direction, message):
    with pytest.raises(InputError, match=message):
        function(np.eye(2), direction)


@pytest.mark.parametrize(
    ("options", "where"), [({"r": 1.0}, "r: "), ({"directions": 0}, "directions: ")]
)
def test_bad_polar_options(options, where):
    with pytest.raises(InputError, match=where):
        polar_diagram(np.eye(2), **options)


def test_polar_diagram_needs_the_plane():
    with pytest.raises(InputError, match=r"\(\.\.\., 2, 2\)"):
        polar_diagram(np.eye(3))
