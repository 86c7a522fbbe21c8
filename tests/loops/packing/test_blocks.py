"""Blocks of a packing grain by grain, and the error that held grains make, by hand."""

import numpy as np
import pytest

from loops import (
    Boundary,
    GrainGraph,
    LinearFrictional,
    Scene,
    assemble_tangent,
    find_faces,
    in_place,
)
from loops.in_place import _edges, _truncation, inverse_at_contacts, packing_blocks, polygons_of
from patterns import synthetic_network
from tests.packings import LAW, frobenius, loops_in_place, packing, packing_system

UNITS = [1.0, 2.0**20, 2.0**-20]


def in_units(graph, unit):
    cell = {} if graph.cell is None else {"cell": unit * graph.cell, "images": graph.images}
    return GrainGraph(
        x=unit * graph.x, radii=unit * graph.radii, contacts=graph.contacts,
        normal_force=graph.normal_force, shear_force=graph.shear_force, **cell,
    )  # fmt: skip


def sheared(grains=260):
    """A wide cell with a slant, grains of all sizes."""
    cell = [[17.0, 4.0], [0.0, 9.0]]
    return synthetic_network(grains, seed=4, cell=cell, coordination=4.6)


def cut_open(graph):
    """The contacts inside the cell, three away from the origin."""
    kept = (graph.images == 0).all(axis=1)
    return GrainGraph(
        x=graph.x + np.array([3.0, -5.0]), radii=graph.radii, contacts=graph.contacts[kept],
        normal_force=graph.normal_force[kept], shear_force=graph.shear_force[kept],
    )  # fmt: skip


def nearest_image(cell, d):
    """Differences of places in the cell's coordinates, in their image around zero."""
    parts = np.linalg.solve(cell, d.T).T
    return parts - np.round(parts)


@pytest.mark.parametrize("unit", UNITS)
def test_blocks_of_a_periodic_packing(unit):
    """Sides of about four diameters, buffers of two, measured between lines of the cell."""
    graph = in_units(sheared(), unit)
    system = packing_system(Scene(graph, LAW))
    polygons = polygons_of(graph, find_faces(graph))
    carries = system.carrying.grains
    diameter = 2.0 * graph.radii[carries].mean()
    # Distances between opposite sides of the cell, area over base.
    (a, b), area = graph.cell.T, abs(np.linalg.det(graph.cell))
    across = np.array([area / np.hypot(*b), area / np.hypot(*a)]) / diameter
    counts = np.maximum(1, np.round(across / 4.0)).astype(int)
    blocks = list(packing_blocks(system, polygons, 4.0, 2.0))
    assert len(blocks) == counts.prod() > 4 and counts[0] != counts[1]
    met = np.concatenate([block.loops for block in blocks])
    assert sorted(met.tolist()) == list(range(len(polygons.centre)))
    of_loop = {
        int(row): grains
        for rows, group in ((group.row, group.grains) for group in polygons.groups)
        for row, grains in zip(rows, group, strict=True)
    }
    for k, block in enumerate(blocks):
        middle = graph.cell @ ((np.array([k // counts[1], k % counts[1]]) + 0.5) / counts)
        away = np.abs(nearest_image(graph.cell, graph.x - middle)) * across
        inside = carries & (away <= 0.5 * across / counts + 2.0).all(axis=1)
        off = np.abs(nearest_image(graph.cell, polygons.centre - middle)) * across
        assert (off[block.loops] <= 0.5 * across / counts + 1e-9).all()
        freed = inside.copy()
        for loop, rho in zip(block.loops, block.rho, strict=True):
            beyond = not inside[of_loop[loop]].all()
            assert (rho == 0.0) == beyond
            freed[of_loop[loop]] = True
            if not beyond:
                wanted = (0.5 * across / counts + 2.0 - off[loop]).min()
                assert rho == pytest.approx(wanted, abs=1e-9)
        np.testing.assert_array_equal(block.free, freed & carries)
        assert not block.whole
        d = block.x - (graph.x - middle)
        np.testing.assert_allclose(nearest_image(graph.cell, d), 0.0, rtol=0, atol=1e-12)
        assert (np.abs(np.linalg.solve(graph.cell, block.x.T)) <= 0.5 + 1e-12).all()


@pytest.mark.parametrize("unit", UNITS)
def test_blocks_between_walls(unit):
    """The box holds all grains with their radii; nothing returns from its other side."""
    graph = in_units(cut_open(sheared()), unit)
    held = np.zeros(graph.grain_count, dtype=bool)
    held[np.argsort(graph.x[:, 1])[:6]] = True
    system = packing_system(Scene(graph, LAW, Boundary(held=held, volume=1.0)))
    polygons = polygons_of(graph, find_faces(graph))
    carries = system.carrying.grains
    low = (graph.x - graph.radii[:, None]).min(axis=0)
    box = (graph.x + graph.radii[:, None]).max(axis=0) - low
    diameter = 2.0 * graph.radii[carries].mean()
    counts = np.maximum(1, np.round(box / diameter / 4.0)).astype(int)
    blocks = list(packing_blocks(system, polygons, 4.0, 2.0))
    assert len(blocks) == counts.prod() > 4
    for k, block in enumerate(blocks):
        middle = low + box * (np.array([k // counts[1], k % counts[1]]) + 0.5) / counts
        np.testing.assert_allclose(block.x, graph.x - middle, rtol=0, atol=1e-12 * box.max())
        reach = 0.5 * box / counts + 2.0 * diameter
        inside = carries & (np.abs(graph.x - middle) <= reach).all(axis=1)
        assert (block.free | ~inside).all()
        off = np.abs(polygons.centre - middle)
        assert (off[block.loops] <= 0.5 * box / counts + 1e-9 * unit).all()
        known = block.rho > 0
        wanted = (reach - off[block.loops[known]]).min(axis=1) / diameter
        np.testing.assert_allclose(block.rho[known], wanted, rtol=0, atol=1e-9)


def test_one_block_is_the_whole():
    graph = packing(30, seed=2)
    system, polygons = packing_system(Scene(graph, LAW)), polygons_of(graph, find_faces(graph))
    (block,) = packing_blocks(system, polygons, np.inf, 0.0)
    assert block.whole and np.isinf(block.rho).all() and block.free.all()


def test_the_error_of_held_grains_is_a_power_of_their_distance():
    """Of operators that are off by a share c rho^-1.9, 3/2 of it is stated; none for the whole."""
    graph = packing(30, seed=2)
    faces = find_faces(graph)
    system, polygons = packing_system(Scene(graph, LAW)), polygons_of(graph, faces)
    exact = loops_in_place(Scene(graph, LAW), faces).matrix
    rng = np.random.default_rng(0)
    rho = rng.uniform(2.0, 9.0, len(exact))
    found = _truncation(system, polygons, exact * (1.0 + 0.3 * rho**-1.9)[:, None, None], rho)
    np.testing.assert_allclose(found, 1.5 * 0.3 * rho**-1.9, rtol=1e-4)
    rho[:2], rho[2:4] = np.inf, 0.0
    matrix = exact.copy()
    matrix[5:] *= (1.0 + 0.2 * rho[5:] ** -1.9)[:, None, None]
    found = _truncation(system, polygons, matrix, rho)
    np.testing.assert_allclose(found[4:], 0.3 * rho[4:] ** -1.9, rtol=1e-4)
    assert found[:2].tolist() == [0.0, 0.0] and np.isinf(found[2:4]).all()
    # Without a loop to ask, what is unknown stays so.
    rho[4:] = np.inf
    assert _truncation(system, polygons, matrix, rho).tolist() == [0.0] * 2 + [np.inf] * 2 + [
        0.0
    ] * (len(rho) - 4)


def test_the_error_is_taken_from_loops_spread_over_all(monkeypatch):
    """Three of them are asked: the first, the middle one, the last."""
    monkeypatch.setattr(in_place, "CHECKED", 3)
    graph = packing(30, seed=2)
    faces = find_faces(graph)
    system, polygons = packing_system(Scene(graph, LAW)), polygons_of(graph, faces)
    exact = loops_in_place(Scene(graph, LAW), faces).matrix
    rho, count = np.full(len(exact), 4.0), len(exact)
    for k in range(count):
        matrix = exact.copy()
        matrix[k] *= 1.5
        found = _truncation(system, polygons, matrix, rho)
        asked = k in (0, (count - 1) // 2, count - 1)
        assert found == pytest.approx(0.75 if asked else 0.0, abs=1e-4)


def test_pairs_of_grains_with_a_contact_or_a_loop_in_common():
    graph = packing(30, seed=2)
    system, polygons = packing_system(Scene(graph, LAW)), polygons_of(graph, find_faces(graph))
    free = np.arange(30) % 5 > 0
    wanted = {tuple(sorted(pair)) for pair in graph.contacts.tolist()}
    for group, *_ in polygons.groups:
        for grains in group.tolist():
            wanted |= {tuple(sorted((a, b))) for a in grains for b in grains}
    found = [tuple(pair) for pair in _edges(system, polygons, free).tolist()]
    assert len(found) == len(set(found))
    assert set(found) == {(a, b) for a, b in wanted if a != b and free[a] and free[b]}


@pytest.mark.parametrize("kn", UNITS)
def test_entries_of_the_inverse_at_contacts(kn):
    """Against the pseudo-inverse of the dense tangent, spins times the system's length."""
    graph = packing(30, seed=2, share=0.0).replace(normal_force=None, shear_force=None)
    law = LinearFrictional(kn, 0.4 * kn, shear_increment="radii")
    system = packing_system(Scene(graph, law))
    dense = np.linalg.pinv(assemble_tangent(graph, law, spins=True), rcond=1e-10)
    count = graph.grain_count
    size = np.append(np.ones(2 * count), np.full(count, system.length))
    dense = dense * size[:, None] * size
    # Without the motions of all grains at once, which nothing resists.
    for axis in (0, 1):
        all_move = np.zeros(3 * count)
        all_move[axis : 2 * count : 2] = 1.0 / np.sqrt(count)
        gone = np.eye(3 * count) - np.outer(all_move, all_move)
        dense = gone @ dense @ gone
    found = inverse_at_contacts(system)
    for (i, j), entries in zip(graph.contacts[system.contacts], found, strict=True):
        at = [2 * i, 2 * i + 1, 2 * j, 2 * j + 1, 2 * count + i, 2 * count + j]
        np.testing.assert_allclose(entries, dense[np.ix_(at, at)], rtol=0, atol=1e-9 / kn)


def test_frobenius_error_of_what_is_stated():
    graph = packing(30, seed=2)
    found = loops_in_place(Scene(graph, LAW), find_faces(graph))
    np.testing.assert_array_equal(found.matrix_error, found.error * frobenius(found.matrix))
    np.testing.assert_array_equal(found.surroundings_error, found.matrix_error + found.alone_error)
