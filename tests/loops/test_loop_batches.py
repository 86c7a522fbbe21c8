import numpy as np
import pytest

from loops import (
    FaceKind,
    GrainGraph,
    branch_vectors,
    contact_forces,
    find_faces,
    loop_batches,
    love_weber_stress,
    outline_area,
    polygon_area,
)
from patterns import read_snapshot, sample_cell, sample_path, synthetic_network


def periodic_networks():
    yield read_snapshot(sample_path("grains_periodic.parquet"), cell=sample_cell()).graph
    yield synthetic_network(400, seed=3, periodic=True)


@pytest.mark.parametrize("graph", list(periodic_networks()), ids=["yade", "synthetic"])
def test_loops_tile_a_periodic_cell(graph):
    faces = find_faces(graph)
    # One cluster spans the cell; clusters nested in its loops would count twice.
    spanning = np.bincount(faces.component).argmax()
    own = (faces.kind == FaceKind.LOOP) & (faces.component == spanning)
    total = faces.area[own].sum()
    assert abs(total / outline_area(graph, faces) - 1) < 1e-12
    parts = [polygon_area(batch.graph.x) for batch in loop_batches(graph, faces)]
    assert abs(np.concatenate(parts).sum() / faces.area[faces.loops].sum() - 1) < 1e-12


@pytest.mark.parametrize("graph", list(periodic_networks()), ids=["yade", "synthetic"])
def test_half_shared_stress_of_the_loops_adds_up_to_the_sample(graph):
    """Every contact lies between two faces; those between two loops share it half and half.

    What dangling contacts and the outer sides of nested clusters carry is added apart.
    """
    faces = find_faces(graph)
    total = np.zeros((2, 2))
    for batch in loop_batches(graph, faces):
        area = polygon_area(batch.graph.x)
        share = 0.5 * love_weber_stress(batch.graph) * area[:, None, None]
        total += share.sum(axis=0)
    moment = contact_forces(graph)[:, :, None] * branch_vectors(graph)[:, None, :]
    in_loops = np.isin(np.repeat(np.arange(len(faces.kind)), faces.order), faces.loops)
    shares = np.bincount(faces.contacts[in_loops], minlength=graph.contact_count)
    rest = np.einsum("c,cij->ij", 1 - 0.5 * shares, moment)
    sample = love_weber_stress(graph) * outline_area(graph, faces)
    np.testing.assert_allclose(total + rest, sample, rtol=0, atol=1e-12 * np.abs(sample).max())
    # The rest is the dangling contacts' alone where there is one cluster, a small part of it all.
    if len(np.unique(faces.component)) == 1:
        assert set(np.unique(shares)) <= {0, 2}
    assert np.abs(rest).max() < 0.05 * np.abs(sample).max()


def test_rolling_moments_of_loops_are_those_on_the_same_grains():
    """Contacts that the loop's ring turns around have the moment of the other grain."""
    graph = next(periodic_networks())
    rng = np.random.default_rng(2)
    moment = rng.normal(size=graph.contact_count)
    regime = rng.integers(0, 3, graph.contact_count)
    graph = graph.replace(rolling_moment=moment, regime=regime)
    on_grain = {}
    for c, (i, j) in enumerate(graph.contacts.tolist()):
        on_grain[c, i], on_grain[c, j] = -moment[c], moment[c]
    turned = 0
    for batch in loop_batches(graph, find_faces(graph)):
        np.testing.assert_array_equal(batch.graph.regime, graph.regime[batch.contacts])
        seconds = np.roll(batch.grains, -1, axis=1)
        for k, row in enumerate(batch.contacts.tolist()):
            expected = [on_grain[c, g] for c, g in zip(row, seconds[k].tolist(), strict=True)]
            assert batch.graph.rolling_moment[k].tolist() == expected
            turned += np.count_nonzero(expected != moment[row])
    assert turned > 1000


def test_a_loop_across_the_border_is_unrolled():
    cell = np.array([[2.0, 0.3], [0.0, 2.0]])
    x = np.array([[0.1, 0.1], [1.1, 0.1], [0.1, 1.1], [1.1, 1.1]])
    graph = GrainGraph(
        x=x,
        radii=[0.6] * 4,
        contacts=[[0, 1], [1, 0], [2, 3], [3, 2], [0, 2], [2, 0], [1, 3], [3, 1]],
        images=[[0, 0], [1, 0], [0, 0], [1, 0], [0, 0], [0, 1], [0, 0], [0, 1]],
        normal_force=np.arange(1.0, 9.0),
        shear_force=np.linspace(-0.3, 0.4, 8),
        cell=cell,
    )
    (batch,) = loop_batches(graph, find_faces(graph))
    assert len(batch.face) == 4
    np.testing.assert_allclose(polygon_area(batch.graph.x).sum(), 4.0, rtol=1e-15)
    # Forces on the unrolled loops are the packing's, reversed with the direction.
    packing = contact_forces(graph)[batch.contacts]
    own = contact_forces(batch.graph)
    sign = np.sign(np.einsum("lck,lck->lc", packing, own))
    np.testing.assert_allclose(own, sign[..., None] * packing, atol=1e-15)
    forward = batch.grains == graph.contacts[batch.contacts][..., 0]
    np.testing.assert_array_equal(sign > 0, forward)


def test_batches_are_bounded():
    graph = synthetic_network(400, seed=4)
    faces = find_faces(graph)
    sizes = [len(batch.face) for batch in loop_batches(graph, faces, size=10)]
    assert max(sizes) == 10
    assert sum(sizes) == len(faces.loops)


def test_outline_of_nested_and_separate_clusters():
    triangle = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    square = 6.0 * np.array([[0.0, 0.0], [1, 0], [1, 1], [0, 1]]) - 2.0
    ring = [[0, 1], [1, 2], [2, 3], [3, 0], [4, 5], [5, 6], [6, 4]]
    for shift, area in ((0.0, 36.0), (100.0, 36.5)):
        graph = GrainGraph(
            x=np.vstack([square, triangle + shift]), radii=np.full(7, 3.0), contacts=ring
        )
        assert outline_area(graph, find_faces(graph)) == pytest.approx(area, rel=1e-14)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (30.0, -20.0), (-7.0, 9.0)])
def test_a_cluster_in_the_notch_of_another_stands_outside_it(shift):
    """An L of three squares of side 2, a square of side 1 in its notch, another in its foot."""
    L = np.array([[0, 0], [4, 0], [4, 2], [2, 2], [2, 4], [0, 4.0]])
    notch = np.array([[2.5, 2.5], [3.5, 2.5], [3.5, 3.5], [2.5, 3.5]])
    x = np.vstack([L, notch, notch - np.array([0.0, 2.0])]) + shift
    rings = ((0, 6), (6, 4), (10, 4))
    contacts = [[a + k, a + (k + 1) % n] for a, n in rings for k in range(n)]
    graph = GrainGraph(x=x, radii=np.full(14, 2.0), contacts=contacts)
    assert outline_area(graph, find_faces(graph)) == pytest.approx(12.0 + 1.0, rel=1e-13)
