"""Faces: hand-made graphs, exact facts, invariances, and two other ways to find them."""

from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest

from loops import (
    FaceKind,
    GrainGraph,
    InputError,
    euler_check,
    faces_by_order,
    find_faces,
    prune_dangling,
)
from loops.faces import ANGLE_STEPS, cycles, half_edges_by_grain, next_half_edge
from loops.pruning import winding_ranks
from patterns import synthetic_network
from tests.loops.test_crossings import network
from tests.oracles.faces import half_edge_cycles

SHEARED = np.array([[1.0, 0.3], [0.0, 1.1]])


def polygon(n, radius=1.0, first=0, centre=(0, 0)):
    angle = 2 * np.pi * np.arange(n) / n
    x = radius * np.column_stack([np.cos(angle), np.sin(angle)]) + centre
    return x, [[first + k, first + (k + 1) % n] for k in range(n)]


def orders(graph):
    faces = find_faces(graph)
    assert euler_check(graph, faces).ok
    return sorted(faces.order[faces.loops].tolist())


# Hand-made graphs


def test_triangle_has_a_loop_and_an_outside():
    faces = find_faces(network([[0, 0], [2, 0], [0, 2]], [[0, 1], [2, 1], [2, 0]]))
    assert faces.grains.tolist() == [0, 1, 2, 0, 2, 1]
    assert faces.contacts.tolist() == [0, 1, 2, 2, 1, 0]
    assert faces.forward.tolist() == [True, False, True, False, True, False]
    assert faces.offsets.tolist() == [0, 3, 6]
    assert faces.area.tolist() == [2.0, -2.0]
    assert faces.kind.tolist() == [FaceKind.LOOP, FaceKind.OUTER]
    assert faces.component.tolist() == [0, 0]


def test_hexagon_fan():
    x, rim = polygon(6)
    faces = find_faces(network([*x, [0, 0]], rim + [[k, 6] for k in range(6)]))
    assert faces.order[faces.loops].tolist() == [3] * 6
    assert faces.area[faces.loops] == pytest.approx(np.sqrt(3) / 4, rel=1e-14)
    assert faces.area[faces.kind == FaceKind.OUTER] == pytest.approx(-1.5 * np.sqrt(3), rel=1e-14)


def test_loops_are_counter_clockwise_whatever_the_direction_of_the_contacts():
    faces = find_faces(network([[0, 0], [1, 0], [1, 1], [0, 1]], [[1, 0], [1, 2], [3, 2], [0, 3]]))
    (loop,) = faces.loops
    grains = faces.grains[faces.offsets[loop] : faces.offsets[loop + 1]].tolist()
    assert grains in ([0, 1, 2, 3], [1, 2, 3, 0], [2, 3, 0, 1], [3, 0, 1, 2])


def test_two_triangles_apart_are_two_components():
    x, one = polygon(3)
    y, other = polygon(3, first=3, centre=(5, 0))
    graph = network([*x, *y], one + other)
    faces = find_faces(graph)
    assert faces.component.tolist() == [0, 0, 1, 1]
    assert faces.kind.tolist().count(FaceKind.OUTER) == 2
    check = euler_check(graph, faces)
    assert (check.components, check.vertices, check.edges, check.faces) == (2, 6, 6, 4)
    assert check.characteristic.tolist() == [2, 2]


def test_a_cluster_inside_a_loop_leaves_the_loop_alone():
    x, hexagon = polygon(6, radius=4)
    y, triangle = polygon(3, first=6)
    faces = find_faces(network([*x, *y], hexagon + triangle))
    groups = faces_by_order(faces)
    assert sorted(groups) == [3, 6]
    assert sorted(groups[6].grains[0].tolist()) == [0, 1, 2, 3, 4, 5]
    assert faces.area[groups[6].face] == pytest.approx(24 * np.sqrt(3), rel=1e-14)


def test_dumbbell_passes_its_bridge_twice_outside():
    x, one = polygon(3)
    y, other = polygon(3, first=3, centre=(5, 0))
    graph = network([*x, *y], [*one, *other, [0, 4]])
    faces = find_faces(graph)
    assert orders(graph) == [3, 3]
    (outer,) = np.flatnonzero(faces.kind == FaceKind.OUTER)
    around = faces.contacts[faces.offsets[outer] : faces.offsets[outer + 1]].tolist()
    assert sorted(around) == [0, 1, 2, 3, 4, 5, 6, 6]


def test_a_cluster_hung_into_a_loop_by_a_bridge_lengthens_it():
    x, hexagon = polygon(6, radius=4)
    y, triangle = polygon(3, first=6)
    graph = network([*x, *y], [*hexagon, *triangle, [0, 6]])
    faces = find_faces(graph)
    assert orders(graph) == [3, 6 + 3 + 2]
    assert max(faces.area) == pytest.approx(24 * np.sqrt(3) - 0.75 * np.sqrt(3), rel=1e-14)


def test_pinch_is_passed_twice_by_the_outside_only():
    x, bow = [[0, 0], [1, 1], [-1, 1], [1, -1], [-1, -1]], [[0, 1], [1, 2], [2, 0]]
    graph = network(x, [*bow, [0, 3], [3, 4], [4, 0]])
    faces = find_faces(graph)
    assert orders(graph) == [3, 3]
    assert sorted(faces.grains[faces.kind.repeat(faces.order) == FaceKind.OUTER].tolist()) == [
        0,
        0,
        1,
        2,
        3,
        4,
    ]


@pytest.mark.parametrize("seed", range(20))
def test_pruning_is_that_of_one_grain_after_the_other(seed):
    """Also where some contacts count and walls support grains."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(4, 30))
    pairs = np.array([(i, j) for i in range(count) for j in range(i) if rng.random() < 2.2 / count])
    contacts = pairs.reshape(-1, 2)
    graph = GrainGraph(x=rng.uniform(size=(count, 2)), radii=np.ones(count), contacts=contacts)
    for closed in (None, rng.random(len(contacts)) < 0.8):
        for supports in (None, rng.integers(0, 3, count)):
            kept = np.ones(count, dtype=bool)
            left = np.ones(len(contacts), dtype=bool) if closed is None else closed.copy()
            held = np.zeros(count, dtype=int) if supports is None else supports
            while (
                loose := kept & (np.bincount(contacts[left].ravel(), minlength=count) + held < 2)
            ).any():
                grain = np.flatnonzero(loose)[0]
                kept[grain] = False
                left &= ~(contacts == grain).any(axis=1)
            found = prune_dangling(graph, closed, supports)
            assert np.array_equal(found[0], kept) and np.array_equal(found[1], left)


def test_a_long_chain_is_pruned_grain_by_grain():
    chain = np.column_stack([np.arange(30_000), np.arange(1, 30_001)])
    ring = np.vstack([chain, [[0, 30_001], [30_001, 1]]])
    x = np.random.default_rng(0).uniform(size=(30_002, 2))
    graph = GrainGraph(x=x, radii=np.ones(30_002), contacts=ring)
    assert np.flatnonzero(prune_dangling(graph)[0]).tolist() == [0, 1, 30_001]


def test_dangling_chain_is_pruned_and_numbers_stay_those_of_the_graph():
    x, square = polygon(4, first=3, centre=(9, 0))
    chain = [[0, 1], [1, 2], [2, 3]]
    graph = network([[0, 0], [1, 0], [2, 0], *x, [20, 0]], chain + square)
    kept_grains, kept_contacts = prune_dangling(graph)
    assert np.flatnonzero(kept_grains).tolist() == [3, 4, 5, 6]
    assert np.flatnonzero(kept_contacts).tolist() == [3, 4, 5, 6]
    faces = find_faces(graph)
    assert set(faces.contacts.tolist()) == {3, 4, 5, 6}
    assert faces_by_order(faces)[4].grains.tolist() == [[3, 4, 5, 6]]


@pytest.mark.parametrize("contacts", [[], [[0, 1]], [[0, 1], [1, 2], [1, 3]]])
def test_trees_have_no_faces(contacts):
    graph = network([[0, 0], [1, 0], [2, 0], [1, 1]], contacts)
    faces = find_faces(graph)
    assert faces.offsets.tolist() == [0]
    assert len(faces.loops) == 0 and faces_by_order(faces) == {}
    check = euler_check(graph, faces)
    assert check.ok and check.components == 0


# Periodic cells


def lattice(columns, rows, steps, cell=SHEARED):
    """One grain per unit cell, joined to its neighbours by the given lattice steps."""
    site = np.arange(columns * rows).reshape(rows, columns)
    row, column = np.divmod(site.ravel(), columns)
    contacts, images = [], []
    for p, q in steps:
        image_q, to_row = np.divmod(row + q, rows)
        image_p, to_column = np.divmod(column + p, columns)
        contacts.append(np.column_stack([site.ravel(), site[to_row, to_column]]))
        images.append(np.column_stack([image_p, image_q]))
    x = np.column_stack([column, row]) @ cell.T
    box = cell * [columns, rows]
    return network(x, np.concatenate(contacts), np.concatenate(images), box)


LATTICES = {3: ([(1, 0), (0, 1), (-1, 1)], 2), 4: ([(1, 0), (0, 1)], 1)}


@pytest.mark.parametrize("order", LATTICES)
@pytest.mark.parametrize("size", [(1, 1), (2, 1), (1, 3), (2, 2), (7, 5)])
@pytest.mark.parametrize("cell", [np.eye(2), SHEARED, [[1.0, 3.4], [0.2, 1.0]]])
def test_triangular_and_square_lattice_on_the_torus(order, size, cell):
    steps, loops_per_grain = LATTICES[order]
    cell = np.asarray(cell)
    graph = lattice(*size, steps, cell)
    assert orders(graph) == [order] * (loops_per_grain * graph.grain_count)
    faces = find_faces(graph)
    assert faces.area == pytest.approx(np.linalg.det(cell) / loops_per_grain, rel=1e-13)
    assert euler_check(graph, faces).characteristic.tolist() == [0]


@pytest.mark.parametrize("size", [1, 2, 6])
def test_honeycomb_on_the_torus(size):
    q, p = np.divmod(np.arange(size * size), size)
    a, b = 2 * np.arange(size * size), 2 * np.arange(size * size) + 1
    contacts, images = [np.column_stack([a, b])], [np.zeros((len(a), 2), int)]
    for dp, dq in ((1, 0), (0, 1)):
        image_p, to_p = np.divmod(p + dp, size)
        image_q, to_q = np.divmod(q + dq, size)
        contacts.append(np.column_stack([b, 2 * (to_q * size + to_p)]))
        images.append(np.column_stack([image_p, image_q]))
    cell = np.array([[1.5, 0.0], [np.sqrt(3) / 2, np.sqrt(3)]])
    origin = np.column_stack([p, q]) @ cell.T
    x = np.empty((2 * len(a), 2))
    x[a], x[b] = origin, origin + np.array([0.5, np.sqrt(3) / 2])
    graph = network(x, np.concatenate(contacts), np.concatenate(images), size * cell)
    assert orders(graph) == [6] * size**2
    assert find_faces(graph).area == pytest.approx(1.5 * np.sqrt(3), rel=1e-13)


@pytest.mark.parametrize("direction", [(1, 0), (0, 1), (1, 1), (2, -1)])
@pytest.mark.parametrize("length", [1, 2, 5])
def test_a_chain_around_the_cell_has_no_loop(direction, length):
    end = SHEARED @ direction
    x = np.arange(length)[:, None] / length * end + 0.1
    contacts = [[k, (k + 1) % length] for k in range(length)]
    images = np.zeros((length, 2), dtype=int)
    images[-1] = direction
    graph = network(x, contacts, images, SHEARED)
    faces = find_faces(graph)
    assert faces.kind.tolist() == [FaceKind.WINDING, FaceKind.WINDING]
    check = euler_check(graph, faces)
    assert check.ok and check.characteristic.tolist() == [2]


def test_a_strip_and_a_cluster_inside_the_cell():
    ladder = lattice(4, 1, [(1, 0)], np.array([[1.0, 0.0], [0.0, 6.0]]))
    x = np.concatenate([ladder.x, ladder.x + np.array([0, 1]), [[1, 3], [2, 3], [1, 4]]])
    rungs = [[k, k + 4] for k in range(4)]
    contacts = [*ladder.contacts, *ladder.contacts + 4, *rungs, [8, 9], [9, 10], [10, 8]]
    images = np.zeros((len(contacts), 2), dtype=int)
    images[:4], images[4:8] = ladder.images, ladder.images
    graph = network(x, contacts, images, ladder.cell)
    assert orders(graph) == [3, 4, 4, 4, 4]
    faces = find_faces(graph)
    kinds = [(FaceKind(k).name, int(c)) for k, c in zip(faces.kind, faces.component, strict=True)]
    assert kinds.count(("WINDING", 0)) == 2 and kinds.count(("OUTER", 1)) == 1
    assert euler_check(graph, faces).characteristic.tolist() == [2, 2]


def test_windings_that_leave_only_multiples_of_one_direction_are_a_strip():
    # Two chains along (1, 1) that share a grain wind twice, in one direction.
    x = [[0, 0], [0.5, 0.4], [0.4, 0.5]]
    contacts, images = [[0, 1], [1, 0], [0, 2], [2, 0]], [[0, 0], [1, 1], [0, 0], [1, 1]]
    graph = network(x, contacts, images, np.eye(2))
    faces = find_faces(graph)
    check = euler_check(graph, faces)
    assert check.ok and check.characteristic.tolist() == [2]
    assert sorted(faces.kind.tolist()) == [FaceKind.LOOP, FaceKind.WINDING, FaceKind.WINDING]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("rank", [0, 1, 2])
def test_winding_ranks_whatever_cells_the_grains_are_counted_in(rank, seed):
    rng = np.random.default_rng(seed)
    contacts = np.column_stack([np.arange(40), np.roll(np.arange(40), -1)])
    contacts = np.concatenate([contacts, [[7, 20], [20, 39]]])
    images = np.zeros((42, 2), dtype=int)
    images[39], images[41] = [(0, 0), (2, -1), (2, -1)][rank], [(0, 0), (0, 0), (1, 0)][rank]
    home = rng.integers(-4, 5, size=(40, 2))
    images += home[contacts[:, 0]] - home[contacts[:, 1]]
    number = rng.permutation(40)
    label = np.zeros(40, dtype=int)
    assert winding_ranks(number[contacts], images, label, 1).tolist() == [rank]


@pytest.mark.parametrize("cell", [None, [[9.0, 4.0], [0.0, 7.0]], [[5.0, -1.0], [2.0, 3.0]]])
@pytest.mark.parametrize("seed", range(4))
def test_loops_tile_the_periodic_cell(cell, seed):
    graph = synthetic_network(2000, seed=seed, periodic=True, cell=cell, coordination=4.2)
    faces = find_faces(graph)
    check = euler_check(graph, faces)
    assert check.ok
    (spanning,) = np.flatnonzero(check.expected == 0)
    tiles = faces.loops[faces.component[faces.loops] == spanning]
    # Clusters inside loops add their own loops and take their outsides away.
    assert faces.area[tiles].sum() == pytest.approx(np.linalg.det(graph.cell), rel=1e-12)
    assert faces.area.sum() == pytest.approx(np.linalg.det(graph.cell), rel=1e-12)
    assert FaceKind.WINDING not in faces.kind


@pytest.mark.parametrize("coordination", [3.2, 3.7, 4.5, 5.5])
def test_mean_order_on_the_torus(coordination):
    """`1/z + 1/nbar = 1/2`, z the mean coordination of the pruned, connected graph."""
    graph = synthetic_network(3000, seed=7, periodic=True, coordination=coordination)
    faces = find_faces(graph)
    check = euler_check(graph, faces)
    (spanning,) = np.flatnonzero(check.expected == 0)
    mine = faces.component == spanning
    order = faces.order[mine].mean()
    vertices = len(np.unique(faces.grains[np.repeat(mine, faces.order)]))
    z = faces.order[mine].sum() / vertices
    assert 1 / z + 1 / order == pytest.approx(0.5, abs=1e-14)


@pytest.mark.parametrize("seed", range(10))
def test_a_connected_plane_graph_has_e_minus_v_plus_one_loops(seed):
    graph = synthetic_network(300, seed=seed, coordination=4.0)
    faces = find_faces(graph)
    check = euler_check(graph, faces)
    loops = np.bincount(faces.component[faces.loops], minlength=check.components)
    kept_grains, kept_contacts = prune_dangling(graph)
    bounded = int(kept_contacts.sum()) - int(kept_grains.sum()) + check.components
    assert loops.sum() == bounded
    assert np.count_nonzero(faces.kind == FaceKind.OUTER) == check.components
    by_component = np.bincount(faces.component, faces.area)
    assert by_component == pytest.approx(0.0, abs=1e-11)


# Directions on the axes, nearly and exactly equal


def test_quarter_turns_keep_the_faces_exactly():
    # Directions on the axes sit on the borders of the quantised angle.
    graph = lattice(3, 3, [(1, 0), (0, 1), (1, 1)], np.eye(2))
    expected = half_edge_cycles(find_faces(graph))
    for turn in ([[0.0, -1.0], [1.0, 0.0]], [[-1.0, 0.0], [0.0, -1.0]], [[0.0, 1.0], [-1.0, 0.0]]):
        x, cell = graph.x @ np.transpose(turn), turn @ graph.cell
        turned = network(x, graph.contacts, graph.images, cell)
        assert half_edge_cycles(find_faces(turned)) == expected


@pytest.mark.parametrize("turn", np.linspace(0, 2 * np.pi, 17))
@pytest.mark.parametrize("gap", [1e-7, 1e-9, 1e-11, 1e-14])
def test_needle_triangles_are_ordered_exactly(turn, gap):
    """Four branches closer in direction than the sort key resolves, in 17 directions."""
    c, s = np.cos(turn), np.sin(turn)
    angles = gap * np.array([0.0, 1.0, 2.0, 3.0])
    fan = np.column_stack([np.cos(angles), np.sin(angles)]) * [[1.0], [2.0], [1.0], [2.0]]
    x = np.array([[0.0, 0.0], *fan]) @ np.array([[c, s], [-s, c]])
    graph = network(x, [[0, 3], [0, 1], [4, 0], [0, 2], [1, 2], [3, 2], [4, 3]])
    faces = find_faces(graph)
    exact = sorted(range(1, 5), key=lambda k: np.arctan2(*(fan[k - 1][::-1].astype(np.longdouble))))
    assert exact == [1, 2, 3, 4]
    triangles = {frozenset(row) for row in faces_by_order(faces)[3].grains.tolist()}
    assert triangles == {frozenset((0, k, k + 1)) for k in (1, 2, 3)}


def test_directions_on_either_side_of_a_step_of_the_key_are_ordered_exactly():
    """A few units in the last place apart: rounding gives some of them keys in the wrong order."""
    rng = np.random.default_rng(0)
    for _ in range(300):
        angle = 1 - rng.integers(1, ANGLE_STEPS) / ANGLE_STEPS  # cosine over |cosine| + |sine|
        slope = (1 - angle) / angle * (1 + np.arange(-4, 5) * 2.0**-53)
        length = rng.uniform(0.1, 10, 9)
        d = np.column_stack([length, length * slope])
        exact = sorted(range(9), key=lambda k: Fraction(d[k, 1]) / Fraction(d[k, 0]))
        if len({Fraction(y) / Fraction(x) for x, y in d.tolist()}) < 9:
            continue
        star = np.column_stack([np.zeros(9, dtype=int), np.arange(1, 10)])
        following = next_half_edge(10, star, np.arange(9), d)
        # From the tip of branch k back to the hub, then out along the next one clockwise.
        assert [following[2 * k + 1] // 2 for k in exact] == [exact[-1], *exact[:-1]]


def test_area_is_exact_far_from_the_origin():
    x, contacts = polygon(7, radius=0.1, centre=(1e6, -3e5))
    corners = [[Fraction(v) for v in point] for point in x.tolist()]
    area = (
        sum(
            a[0] * b[1] - a[1] * b[0]
            for a, b in zip(corners, corners[1:] + corners[:1], strict=True)
        )
        / 2
    )
    assert find_faces(network(x, contacts)).area[0] == pytest.approx(float(area), rel=1e-14)


def test_coincident_branches_are_named():
    graph = network([[0, 0], [1, 1], [2, 2], [3, 0]], [[3, 0], [0, 1], [1, 2], [2, 0], [2, 3]])
    with pytest.raises(InputError, match="contacts 1 and 3: got the same direction from grain 0"):
        find_faces(graph)


def test_signed_zeros_do_not_hide_a_coincidence():
    graph = network([[0, 0.0], [-1, 0.0], [-2, -0.0], [0, 1]], [[0, 1], [2, 0], [1, 3], [3, 2]])
    with pytest.raises(InputError, match="contacts 0 and 1"):
        find_faces(graph)


def test_batches_are_refused():
    x, square = polygon(4)
    graph = GrainGraph(x=np.stack([x, x]), radii=np.ones(4), contacts=square)
    with pytest.raises(InputError, match="graph: got batch axes"):
        find_faces(graph)


# Parts


@pytest.mark.parametrize("lengths", [[], [1], [2, 1, 3], [63, 64, 65, 66], [1000, 3, 129, 1]])
@pytest.mark.parametrize("seed", range(3))
def test_cycles_of_a_permutation(lengths, seed):
    parts = np.split(np.random.default_rng(seed).permutation(sum(lengths)), np.cumsum(lengths))
    following = np.empty(sum(lengths), dtype=np.int64)
    for part in parts:
        following[part] = np.roll(part, -1)
    offsets, members = cycles(following)
    got = [members[a:b].tolist() for a, b in pairwise(offsets)]
    turned = (np.roll(p, -int(np.argmin(p))).tolist() for p in parts if len(p))
    assert got == sorted(turned, key=lambda cycle: cycle[0])


def test_groups_hold_every_loop_once_and_in_order():
    graph = synthetic_network(500, seed=3)
    faces = find_faces(graph)
    groups = faces_by_order(faces)
    assert list(groups) == sorted(groups)
    assert np.sort(np.concatenate([g.face for g in groups.values()])).tolist() == (
        faces.loops.tolist()
    )
    for grains, contacts, forward, _ in groups.values():
        ends = np.where(
            forward[..., None], graph.contacts[contacts], graph.contacts[contacts][..., ::-1]
        )
        assert (ends[..., 0] == grains).all()
        assert (ends[..., 1] == np.roll(grains, -1, axis=1)).all()


@pytest.mark.parametrize("periodic", [False, True])
def test_half_edges_are_ordered_by_their_grains_and_images(periodic):
    """Whatever the order and the direction of the contacts."""
    graph = synthetic_network(60, seed=4, periodic=periodic)
    rng = np.random.default_rng(0)
    kept = np.flatnonzero(rng.random(graph.contact_count) < 0.8)
    i, j = graph.contacts[kept].T
    image = np.zeros((len(kept), 2), int) if graph.images is None else graph.images[kept]
    ends = np.stack([np.column_stack([i, j, image]), np.column_stack([j, i, -image])], axis=1)
    found = ends.reshape(-1, 4)[half_edges_by_grain(graph, kept)].tolist()
    assert found == sorted(found)
