"""Compiled faces: the same as numpy's, half-edge by half-edge."""

from fractions import Fraction

import numpy as np
import pytest

from loops import InputError, euler_check, find_faces
from loops.compiled import given
from loops.compiled.network import following_half_edges, spatial_order
from loops.faces import next_half_edge
from patterns import synthetic_network
from tests.loops.test_crossings import network, wheel
from tests.loops.test_faces_compared import renumbered


def assert_same_faces(graph):
    plain, fast = find_faces(graph, compiled=False), find_faces(graph, compiled=True)
    for name in ("offsets", "grains", "contacts", "forward", "kind", "component"):
        one, other = getattr(plain, name), getattr(fast, name)
        assert one.dtype == other.dtype, name
        np.testing.assert_array_equal(one, other, err_msg=name)
    # Another order of summation: a few units of rounding of the largest terms.
    size = np.ptp(graph.x, axis=0).max(initial=1.0) ** 2
    np.testing.assert_allclose(fast.area, plain.area, rtol=1e-12, atol=1e-13 * size)
    one = euler_check(graph, plain, compiled=False)
    other = euler_check(graph, fast, compiled=True)
    assert one.components == other.components and one.vertices == other.vertices
    assert one.edges == other.edges and one.faces == other.faces
    np.testing.assert_array_equal(one.characteristic, other.characteristic)
    np.testing.assert_array_equal(one.expected, other.expected)
    return fast


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("coordination", [2.2, 2.6, 3.7, 5.5])
def test_random_networks(periodic, coordination):
    """Bridges, pinches, clusters inside loops, dangling chains; grains numbered at random."""
    for seed in range(6):
        graph = synthetic_network(
            [10, 60, 400][seed % 3], seed=seed, periodic=periodic, coordination=coordination
        )
        assert_same_faces(renumbered(graph, seed))


def test_sheared_cells_a_few_grains_wide():
    for seed in range(12):
        graph = synthetic_network(6 + seed, seed=seed, cell=[[2.0, 3.0], [0.0, 2.5]])
        assert_same_faces(renumbered(graph, seed))


@pytest.mark.parametrize("direction", [(1, 0), (1, 1), (2, -1)])
@pytest.mark.parametrize("length", [2, 5])
def test_chains_around_the_cell(direction, length):
    """A strip winds one way; with a second chain across it, both ways."""
    cell = np.array([[1.0, 0.3], [0.0, 1.1]])
    x = np.arange(length)[:, None] / length * (cell @ direction) + 0.1
    contacts = [[k, (k + 1) % length] for k in range(length)]
    images = np.zeros((length, 2), dtype=int)
    images[-1] = direction
    strip = network(x, contacts, images, cell)
    assert_same_faces(strip)
    assert euler_check(strip, find_faces(strip), compiled=True).expected.tolist() == [2]
    across = network(x, [*contacts, [0, 0]], [*images, [0, 1]], cell)
    faces = find_faces(across, compiled=True)
    assert euler_check(across, faces, compiled=True).expected.tolist() == [0]
    assert euler_check(across, faces, compiled=False).expected.tolist() == [0]


@pytest.mark.parametrize("contacts", [[], [[0, 1]], [[0, 1], [1, 2], [1, 3]]])
def test_trees_have_no_faces(contacts):
    assert_same_faces(network([[0, 0], [1, 0], [2, 0], [1, 1]], contacts))


@pytest.mark.parametrize("count", [15, 16, 17, 33, 1000])
def test_a_grain_with_many_contacts(count):
    """Few are ordered by counting, many by numpy."""
    faces = assert_same_faces(network(*wheel(10.0, count)))
    assert faces.order[faces.loops].tolist() == [3] * count


@pytest.mark.parametrize("gap", [1e-7, 1e-12, 1e-14, 3e-16])
def test_needle_triangles_are_ordered_exactly(gap):
    for angle in np.linspace(0, 2 * np.pi, 23):
        c, s = np.cos(angle), np.sin(angle)
        fan = np.column_stack([[1.0, 2.0, 1.0, 2.0], gap * np.array([0.0, 2.0, 2.0, 6.0])])
        x = np.array([[0.0, 0.0], *fan]) @ np.array([[c, s], [-s, c]])
        graph = network(x, [[0, 3], [0, 1], [4, 0], [0, 2], [1, 2], [3, 2], [4, 3]])
        try:
            find_faces(graph, compiled=False)
        except InputError:
            continue
        assert_same_faces(graph)


@pytest.mark.parametrize("count", [9, 30])
def test_directions_within_their_rounding_are_left_to_exact_arithmetic(count):
    """Angles of doubles alone would put some of them in the wrong order."""
    rng = np.random.default_rng(0)
    tips = np.arange(1, count + 1)
    star = np.column_stack([np.zeros(count), tips]).astype(np.int32)
    degree = np.array([count, *[1] * count], dtype=np.int32)
    by_angle_alone, tried = 0, 0
    for _ in range(300):
        slope = rng.uniform(0.2, 5) * (1 + (tips - tips.mean()) * 2.0**-52)
        length = rng.uniform(0.1, 10, count)
        d = np.column_stack([length, length * slope])[rng.permutation(count)]
        ratio = [Fraction(y) / Fraction(x) for x, y in d.tolist()]
        if len(set(ratio)) < count:
            continue
        tried += 1
        assert not following_half_edges(star, degree, d)[1]
        exact = sorted(range(count), key=ratio.__getitem__)
        following = next_half_edge(count + 1, star.astype(np.int64), tips - 1, d)
        # From the tip of branch k back to the hub, then out along the next one clockwise.
        assert [following[2 * k + 1] // 2 for k in exact] == [exact[-1], *exact[:-1]]
        angle = 1 - d[:, 0] / (d[:, 0] + d[:, 1])
        by_angle_alone += np.argsort(angle, kind="stable").tolist() == exact
    assert tried > 10 and by_angle_alone < tried / 2


def test_coincident_branches_are_named():
    graph = network([[0, 0], [1, 1], [2, 2], [3, 0]], [[3, 0], [0, 1], [1, 2], [2, 0], [2, 3]])
    with pytest.raises(InputError, match="contacts 1 and 3: got the same direction from grain 0"):
        find_faces(graph, compiled=True)


@pytest.mark.parametrize("scale", [1e-130, 1e151])
def test_sizes_far_from_one_have_the_same_faces(scale):
    x = scale * np.array([[0.0, 0.0], [1.0, 0.5], [2.0, 1.0 + 2e-16], [0.0, 1.0]])
    assert_same_faces(network(x, [[0, 1], [0, 2], [1, 2], [1, 3], [3, 0]]))


def test_the_order_along_space_is_a_permutation_that_keeps_neighbours_close():
    rng = np.random.default_rng(0)
    x = rng.random((5000, 2)) * [3.0, 1.0] - 7.0
    order = spatial_order(given(x, np.float64))
    assert np.sort(order).tolist() == list(range(5000))
    step = np.hypot(*np.diff(x[order], axis=0).T)
    assert np.median(step) < 3 * np.sqrt(3.0 / 5000)
    alike = np.ones((7, 2))
    assert spatial_order(given(alike, np.float64)).tolist() == list(range(7))
