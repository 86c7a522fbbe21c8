"""Faces of networks: sums of areas, Euler, and the same faces however the network is written."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from loops import FaceKind, GrainGraph, euler_check, find_faces, prune_dangling
from loops.pruning import component_labels, winding_ranks
from patterns import synthetic_network

MATRICES = st.sampled_from([np.eye(2), np.diag([1.0, -1.0]), np.array([[0.0, -1.0], [1.0, 0.0]])])


@st.composite
def networks(draw, periodic):
    return synthetic_network(
        draw(st.integers(6, 120)),
        seed=draw(st.integers(0, 10_000)),
        periodic=periodic,
        coordination=draw(st.floats(2.2, 5.5)),
        jitter=draw(st.floats(0.0, 0.4)),
    )


def rewritten(graph, rng, matrix):
    """Grains and contacts renumbered, contacts reversed, the plane turned or mirrored."""
    grain = rng.permutation(graph.grain_count)
    order, back = rng.permutation(graph.contact_count), rng.random(graph.contact_count) < 0.5
    x, radii = np.empty_like(graph.x), np.empty_like(graph.radii)
    x[grain], radii[grain] = graph.x @ matrix.T, graph.radii
    contacts = grain[graph.contacts]
    contacts = np.where(back[:, None], contacts[:, ::-1], contacts)[order]
    images = graph.images
    if images is not None:
        images = (np.where(back[:, None], -1, 1) * images)[order]
    cell = None if graph.cell is None else matrix @ graph.cell
    return GrainGraph(x=x, radii=radii, contacts=contacts, images=images, cell=cell)


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


def counts(graph):
    """How many faces of every kind and order, and the sorted areas of those that have one."""
    faces = find_faces(graph)
    kinds, number = np.unique(np.stack([faces.kind, faces.order]), axis=1, return_counts=True)
    table = {tuple(key): int(n) for key, n in zip(kinds.T.tolist(), number, strict=True)}
    return table, np.sort(faces.area[faces.kind != FaceKind.WINDING])


def winds_both_ways(graph):
    """Whether a component of the pruned network winds around the torus both ways."""
    grains, kept = prune_dangling(graph)
    count, label = component_labels(graph.grain_count, graph.contacts[kept], grains)
    ranks = winding_ranks(graph.contacts[kept], graph.images[kept], label, count)
    return bool((ranks == 2).any())


@settings(max_examples=40)
@given(networks(periodic=False))
def test_loops_in_the_plane_fill_the_outlines(graph):
    faces = find_faces(graph)
    assert euler_check(graph, faces).ok
    inside = faces.area[faces.kind == FaceKind.LOOP].sum()
    outside = faces.area[faces.kind == FaceKind.OUTER].sum()
    assert inside == pytest.approx(-outside, rel=1e-12, abs=1e-12)
    assert not (faces.kind == FaceKind.WINDING).any()
    for component in range(int(faces.component.max(initial=-1)) + 1):
        own = faces.component == component
        assert np.count_nonzero(faces.kind[own] == FaceKind.OUTER) == 1
        assert faces.area[own].sum() == pytest.approx(0.0, abs=1e-11)


@settings(max_examples=40)
@given(networks(periodic=True))
def test_loops_on_the_torus_fill_the_cell(graph):
    faces = find_faces(graph)
    assert euler_check(graph, faces).ok
    if winds_both_ways(graph):
        # Clusters inside loops count twice as loops, once less as outlines.
        assert not (faces.kind == FaceKind.WINDING).any()
        assert faces.area.sum() == pytest.approx(np.linalg.det(graph.cell), rel=1e-12)


@settings(max_examples=30)
@given(st.booleans().flatmap(lambda periodic: networks(periodic)), st.integers(0, 10**6), MATRICES)
def test_faces_do_not_depend_on_how_the_network_is_written(graph, seed, matrix):
    table, areas = counts(graph)
    other, found = counts(rewritten(graph, np.random.default_rng(seed), matrix))
    assert other == table
    np.testing.assert_allclose(found, areas, rtol=0, atol=1e-11)


@settings(max_examples=30)
@given(networks(periodic=True), st.integers(0, 10**6), st.floats(-50, 50), st.floats(-50, 50))
def test_faces_do_not_depend_on_the_cells_origin(graph, seed, shift_x, shift_y):
    """Shifted as a whole, and every grain counted in any image of the cell."""
    rng = np.random.default_rng(seed)
    home = rng.integers(-3, 4, size=(graph.grain_count, 2))
    i, j = graph.contacts.T
    x = graph.x + np.array([shift_x, shift_y]) + home @ graph.cell.T
    images = graph.images + home[i] - home[j]
    shifted = GrainGraph(
        x=x, radii=graph.radii, contacts=graph.contacts, images=images, cell=graph.cell
    )
    table, areas = counts(graph)
    other, found = counts(shifted)
    assert other == table
    np.testing.assert_allclose(found, areas, rtol=0, atol=1e-10)


@settings(max_examples=25)
@given(networks(periodic=True), st.sampled_from([2, 3]))
def test_copies_of_a_cell_have_as_many_times_the_loops(graph, times):
    if not winds_both_ways(graph):
        # A strip winds around the larger cell once for every `times` of its copies.
        return
    table, areas = counts(graph)
    other, found = counts(replicated(graph, times))
    assert other == {key: times**2 * number for key, number in table.items()}
    np.testing.assert_allclose(found, np.repeat(areas, times**2), rtol=0, atol=1e-11)
