"""Faces against other ways to find them, and their invariances."""

from itertools import pairwise

import numpy as np
import pytest
import shapely

from loops import FaceKind, GrainGraph, euler_check, find_faces
from patterns import synthetic_network
from tests.loops.test_crossings import network
from tests.oracles.faces import half_edge_cycles, reference_faces

# Other ways to the same faces


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("grains", [10, 20, 60])
def test_against_a_walk_over_dictionaries(grains, periodic):
    for seed in range(60):
        coordination = [2.5, 3.0, 3.7, 5.0][seed % 4]
        graph = synthetic_network(grains, seed=seed, periodic=periodic, coordination=coordination)
        graph = renumbered(graph, seed)
        faces, expected = find_faces(graph), reference_faces(graph)
        assert half_edge_cycles(faces) == [face.half_edges for face in expected]
        assert faces.grains.tolist() == [g for face in expected for g in face.grains]
        wound = np.array([any(face.winding) for face in expected], dtype=bool)
        assert (faces.kind == FaceKind.WINDING).tolist() == wound.tolist()
        area = np.array([face.area for face in expected])
        assert np.abs(faces.area - area)[~wound] == pytest.approx(0, abs=1e-12)
        assert ((faces.kind == FaceKind.LOOP) == ((area > 0) & ~wound)).all()


@pytest.mark.parametrize("coordination", [2.3, 2.6, 3.2, 3.7, 5.0])
def test_against_polygonize_face_by_face(coordination):
    """Shapely's polygons are the loops, less bridges (dropped) and clusters inside (holes)."""
    bridges, hung_holes, clusters = 0, 0, 0
    for seed in range(8):
        graph = synthetic_network(400, seed=seed, coordination=coordination)
        faces = find_faces(graph)
        cycles = [set(cycle) for cycle in half_edge_cycles(faces)]
        face_of = {h: f for f, cycle in enumerate(cycles) for h in cycle}
        found = []
        for polygon, (shell, *holes) in polygonized(graph):
            (loop,) = {face_of[h] for h in shell}
            walls, inside = set(shell), set()
            for hole in holes:
                (around,) = {face_of[h] for h in hole}
                if around == loop:  # hung up by a bridge or a pinch
                    hung_holes += 1
                    walls |= hole
                else:  # a cluster with bridges of its own makes several holes
                    assert faces.kind[around] == FaceKind.OUTER
                    inside.add(around)
            clusters += len(inside)
            area = faces.area[loop] + faces.area[list(inside)].sum()
            bridge = {
                (c, forward) for c, forward in cycles[loop] if (c, not forward) in cycles[loop]
            }
            bridges += len(bridge) // 2
            assert cycles[loop] - bridge == walls
            assert polygon.area == pytest.approx(area, rel=1e-11)
            found.append(loop)
        assert sorted(found) == faces.loops.tolist()
    if coordination < 2.5:
        assert min(bridges, hung_holes, clusters) > 0


def polygonized(graph):
    """Shapely's polygons, each with its rings as sets of half-edges that have it on their left."""
    grain = {tuple(point): g for g, point in enumerate(graph.x.tolist())}
    contact = {tuple(pair): (c, True) for c, pair in enumerate(graph.contacts.tolist())}
    contact |= {(j, i): (c, False) for (i, j), (c, _) in contact.items()}
    for polygon in shapely.polygonize(shapely.linestrings(graph.x[graph.contacts])).geoms:
        turned = shapely.geometry.polygon.orient(polygon)
        walks = [[grain[p] for p in ring.coords] for ring in (turned.exterior, *turned.interiors)]
        yield polygon, [{contact[pair] for pair in pairwise(walk)} for walk in walks]


# Invariance


def renumbered(graph, seed):
    """The same graph with grains and contacts renumbered and half the contacts reversed."""
    rng = np.random.default_rng(seed)
    order, contact = rng.permutation(graph.grain_count), rng.permutation(graph.contact_count)
    number = np.argsort(order)
    contacts = number[graph.contacts][contact]
    images = None if graph.images is None else graph.images[contact].copy()
    back = rng.random(len(contacts)) < 0.5
    contacts[back] = contacts[back, ::-1]
    if images is not None:
        images[back] *= -1
    return network(graph.x[order], contacts, images, graph.cell)


def assert_same(graph, expected):
    """The same faces: kinds, orders and areas (of those that have one)."""
    assert euler_check(graph, find_faces(graph)).ok
    (kinds, areas), (expected_kinds, expected_areas) = measured(graph), measured(expected)
    assert kinds == expected_kinds
    assert areas == pytest.approx(expected_areas, rel=1e-9, abs=1e-9)


def measured(graph):
    faces = find_faces(graph)
    area = np.where(faces.kind == FaceKind.WINDING, 0.0, faces.area)
    rows = sorted(zip(faces.kind.tolist(), faces.order.tolist(), area.tolist(), strict=True))
    return [row[:2] for row in rows], [row[2] for row in rows]


def moved(graph, matrix, shift=0.0):
    cell = None if graph.cell is None else matrix @ graph.cell
    return network(graph.x @ np.transpose(matrix) + shift, graph.contacts, graph.images, cell)


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_faces_do_not_depend_on_numbering_rotation_mirror_or_the_cells_origin(periodic, seed):
    graph = synthetic_network(200, seed=seed, periodic=periodic)
    angle = 0.3 + seed
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    assert_same(renumbered(graph, seed), graph)
    assert_same(moved(graph, turn), graph)
    assert_same(moved(graph, turn, [1e3, -1e4]), graph)
    assert_same(moved(graph, np.diag([-1.0, 1.0])), graph)
    if periodic:
        rng = np.random.default_rng(seed)
        home = rng.integers(-3, 4, size=(graph.grain_count, 2))
        i, j = graph.contacts.T
        images = graph.images + home[i] - home[j]
        shifted = network(graph.x + home @ graph.cell.T, graph.contacts, images, graph.cell)
        assert_same(shifted, graph)
        # The same lattice of cells, spanned by other vectors.
        other = np.array([[1, 1], [0, 1]])
        back = np.array([[1, -1], [0, 1]])
        images = graph.images @ back.T
        assert_same(network(graph.x, graph.contacts, images, graph.cell @ other), graph)


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("periodic", [False, True])
def test_neither_order_nor_direction_of_contacts_numbers_the_faces(periodic, compiled):
    """Pinches, bridges and, in small cells, several contacts between the same two grains."""
    for seed, grains in enumerate([3, 5, 8, 60, 300]):
        graph = synthetic_network(grains, seed=seed, periodic=periodic, coordination=3.2)
        faces = find_faces(graph, compiled=compiled)
        first = faces.grains[faces.offsets[:-1]]
        assert (np.diff(first) >= 0).all()
        assert (first == np.minimum.reduceat(faces.grains, faces.offsets[:-1])).all()
        rng = np.random.default_rng(seed)
        order = rng.permutation(graph.contact_count)
        contacts, back = graph.contacts[order], rng.random(graph.contact_count) < 0.5
        images = None if graph.images is None else graph.images[order]
        contacts[back] = contacts[back, ::-1]
        if images is not None:
            images[back] *= -1
        other = find_faces(network(graph.x, contacts, images, graph.cell), compiled=compiled)
        for name in ("offsets", "grains", "area", "kind", "component"):
            np.testing.assert_array_equal(getattr(other, name), getattr(faces, name), name)
        np.testing.assert_array_equal(order[other.contacts], faces.contacts)


def replicated(graph, times):
    """`times` by `times` copies of a periodic network in one cell as many times as large."""
    copies = np.stack(np.meshgrid(np.arange(times), np.arange(times)), axis=-1).reshape(-1, 2)
    count = graph.grain_count
    x = np.concatenate([graph.x + graph.cell @ copy for copy in copies])
    contacts, images = [], []
    for number, copy in enumerate(copies):
        wide, there = np.divmod(copy + graph.images, times)
        target = there[:, 1] * times + there[:, 0]
        i, j = graph.contacts.T
        contacts.append(np.column_stack([number * count + i, target * count + j]))
        images.append(wide)
    return GrainGraph(
        x=x,
        radii=np.tile(graph.radii, len(copies)),
        contacts=np.concatenate(contacts),
        images=np.concatenate(images),
        cell=times * graph.cell,
    )


@pytest.mark.parametrize("times", [2, 3])
@pytest.mark.parametrize("coordination", [3.0, 3.7, 5.0])
def test_copies_of_a_cell_have_as_many_times_the_faces(times, coordination):
    """Networks that wind both ways: a strip winds around the larger cell once for all copies."""
    for seed in range(4):
        graph = synthetic_network(
            12 + 20 * seed, seed=seed, periodic=True, coordination=coordination
        )
        (kinds, areas), (many, sums) = measured(graph), measured(replicated(graph, times))
        if FaceKind.WINDING not in {kind for kind, _ in kinds}:
            assert many == sorted(kinds * times**2)
            np.testing.assert_allclose(np.sort(sums), np.sort(areas * times**2), atol=1e-11)
