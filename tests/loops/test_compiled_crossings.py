"""Compiled search for crossings: the same pairs as numpy's and as exact arithmetic."""

import numpy as np
import pytest

from loops import GrainGraph, find_crossings
from patterns.synthetic import synthetic_network
from tests.loops.test_crossings import drawn, exact_crossings, network, wheel


@pytest.mark.parametrize("size", [4, 8, 1000])
def test_random_graphs_in_the_plane(size):
    """Few grid points make touching, folding and overlapping frequent."""
    for seed in range(30):
        graph = network(*drawn(np.random.default_rng(seed), 12, 16, size))
        assert find_crossings(graph, compiled=True).tolist() == exact_crossings(graph)


@pytest.mark.parametrize("cell", [[[1, 0], [0, 1]], [[1, 0.5], [0, 2]], [[1, -0.25], [0.5, 1]]])
@pytest.mark.parametrize("scale", [1, 4])
def test_random_graphs_in_periodic_cells(cell, scale):
    for seed in range(30):
        rng = np.random.default_rng(seed)
        x, contacts = drawn(rng, 6, 6, 8 * scale)
        box = np.array(cell, dtype=float) * scale
        x = x + np.arange(6)[:, None] / 64
        images = rng.integers(-1, 2, size=(6, 2)) * (rng.random((6, 1)) * scale < 1)
        home = rng.integers(-1, 2, size=(6, 2))
        graph = network(x + home @ box.T, contacts, images, box)
        plain = find_crossings(graph, compiled=False).tolist()
        assert find_crossings(graph, compiled=True).tolist() == plain


@pytest.mark.parametrize("periodic", [False, True])
def test_planar_networks_and_one_contact_too_many(periodic):
    graph = synthetic_network(3000, seed=1, periodic=periodic, jitter=0.43)
    assert find_crossings(graph, compiled=True).shape == (0, 2)
    far = np.concatenate([graph.contacts, [[3, 1500]]])
    images = None if graph.images is None else np.concatenate([graph.images, [[0, 0]]])
    crossed = network(graph.x, far, images, graph.cell)
    found = find_crossings(crossed, compiled=True)
    assert len(found) > 10
    np.testing.assert_array_equal(found, find_crossings(crossed, compiled=False))


def test_the_search_stops_at_the_given_number():
    graph = network(*drawn(np.random.default_rng(0), 60, 1000, 1000))
    everything = find_crossings(graph, max_pairs=10**6, compiled=True)
    np.testing.assert_array_equal(everything, find_crossings(graph, 10**6, compiled=False))
    some = find_crossings(graph, max_pairs=100, compiled=True)
    assert some.shape == (100, 2)
    assert {tuple(p) for p in some.tolist()} <= {tuple(p) for p in everything.tolist()}


@pytest.mark.parametrize("count", [300, 30_000])
def test_crowded_bins_are_left_to_the_plain_way(count):
    """A fan of branches, all in one bin at its hub."""
    x, contacts = wheel(1000.0, count)
    chord = [[1, 3]]
    found = find_crossings(network(x, np.concatenate([contacts, chord])), compiled=True)
    assert found.tolist() == [[count + 2, 2 * count]]


def test_a_contact_of_two_grains_through_two_images_may_overlap():
    graph = GrainGraph(
        x=[[0.1, 0.5], [0.6, 0.5]],
        radii=[0.3, 0.3],
        contacts=[[0, 1], [1, 0], [0, 1]],
        images=[[0, 0], [1, 0], [1, 0]],
        cell=np.eye(2),
    )
    plain = find_crossings(graph, compiled=False).tolist()
    assert find_crossings(graph, compiled=True).tolist() == plain
    assert len(plain) > 0
