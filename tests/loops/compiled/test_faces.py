"""Compiled faces: the same as numpy's, half-edge by half-edge."""

from fractions import Fraction

import numpy as np
import pytest

from loops import InputError, euler_check, find_faces
from loops.compiled import given
from loops.compiled.network import UNDECIDED, following_half_edges, spatial_order, turn
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
    """Few are ordered by counting, many by merging."""
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


def test_directions_a_few_units_of_rounding_apart_are_ordered_exactly():
    """Angles of doubles alone would put some of them in the wrong order."""
    rng = np.random.default_rng(0)
    star = np.column_stack([np.zeros(9), np.arange(1, 10)]).astype(np.int32)
    degree = np.array([9, *[1] * 9], dtype=np.int32)
    by_angle_alone = 0
    for _ in range(300):
        slope = rng.uniform(0.2, 5) * (1 + np.arange(-4, 5) * 2.0**-52)
        length = rng.uniform(0.1, 10, 9)
        d = np.column_stack([length, length * slope])[rng.permutation(9)]
        ratio = [Fraction(y) / Fraction(x) for x, y in d.tolist()]
        if len(set(ratio)) < 9:
            continue
        exact = sorted(range(9), key=ratio.__getitem__)
        following, good = following_half_edges(star, degree, d)
        assert good
        # From the tip of branch k back to the hub, then out along the next one clockwise.
        assert [following[2 * k + 1] // 2 for k in exact] == [exact[-1], *exact[:-1]]
        angle = 1 - d[:, 0] / (d[:, 0] + d[:, 1])
        by_angle_alone += np.argsort(angle, kind="stable").tolist() == exact
    assert by_angle_alone < 100


def test_coincident_branches_are_named():
    graph = network([[0, 0], [1, 1], [2, 2], [3, 0]], [[3, 0], [0, 1], [1, 2], [2, 0], [2, 3]])
    with pytest.raises(InputError, match="contacts 1 and 3: got the same direction from grain 0"):
        find_faces(graph, compiled=True)


@pytest.mark.parametrize("scale", [1e-130, 1e151])
def test_sizes_beyond_exact_products_are_left_to_the_plain_way(scale):
    x = scale * np.array([[0.0, 0.0], [1.0, 0.5], [2.0, 1.0 + 2e-16], [0.0, 1.0]])
    assert_same_faces(network(x, [[0, 1], [0, 2], [1, 2], [1, 3], [3, 0]]))


def test_turns_against_rational_arithmetic():
    rng = np.random.default_rng(0)
    decided = 0
    for _ in range(3000):
        ax, ay, factor = rng.normal(size=3) * 10.0 ** rng.integers(-6, 6)
        bx, by = ax * factor, ay * factor
        by = np.nextafter(by, rng.choice([-1, 1]) * np.inf) if rng.random() < 0.7 else by
        exact = Fraction(ax) * Fraction(by) - Fraction(ay) * Fraction(bx)
        found = turn(ax, ay, bx, by)
        assert found == (exact > 0) - (exact < 0)
        decided += found != 0 and ax * by == ay * bx
    assert decided > 100  # products alike, told apart by their rounding errors
    assert turn(1e-200, 1e-200, 1e-200, 1e-200) == UNDECIDED
    assert turn(0.0, 1.0, 0.0, -2.0) == 0


def test_the_order_along_space_is_a_permutation_that_keeps_neighbours_close():
    rng = np.random.default_rng(0)
    x = rng.random((5000, 2)) * [3.0, 1.0] - 7.0
    order = spatial_order(given(x, np.float64))
    assert np.sort(order).tolist() == list(range(5000))
    step = np.hypot(*np.diff(x[order], axis=0).T)
    assert np.median(step) < 3 * np.sqrt(3.0 / 5000)
    alike = np.ones((7, 2))
    assert spatial_order(given(alike, np.float64)).tolist() == list(range(7))
