"""One loop of a graph of networkx, a list of grains, a graph or a scene."""

import networkx as nx
import numpy as np
import pytest

import grainloops as gl
from tests.packings import LAW

SEEDS = range(5)


def ring_of(seed, strain=0.01):
    order = 4 + seed
    return gl.random_loop(order, seed, convex=order < 6, polydispersity=0.2, strain=strain)


def network_of(graph, seed):
    """The same grains and contacts, nodes and edges in another order; x and y apart."""
    rng = np.random.default_rng(seed)
    own, network = gl.to_networkx(graph), nx.Graph()
    for node in rng.permutation(graph.grain_count).tolist():
        x, y = own.nodes[node]["x"]
        network.add_node(f"g{node}", x=x, y=y, radius=own.nodes[node]["radius"])
    edges = list(own.edges(data=True))
    for k in rng.permutation(len(edges)):
        i, j, data = edges[k]
        forces = {name: data[name] for name in ("normal_force", "shear_force")}
        network.add_edge(f"g{j}", f"g{i}", **forces)
    return network


@pytest.mark.parametrize("seed", SEEDS)
def test_the_loop_of_a_shuffled_network_has_the_tangents_of_the_ring(seed):
    graph = ring_of(seed)
    # The reference of a network without x0 is the present state.
    known = gl.traction_tangent(graph.replace(x0=graph.x), LAW, spins="free")
    found = gl.loop(network_of(graph, seed), law=LAW)
    ids = [int(name[1:]) for name in found.ids]
    first = ids.index(0)
    assert np.roll(ids, -first).tolist() == [*range(graph.grain_count)]
    difference = gl.traction_tangent(found, spins="free").matrix - known.matrix
    assert np.abs(difference).max() <= 2.0 * float(known.error)
    assert np.array_equal(found.graph.x, graph.x[ids])


@pytest.mark.parametrize("law", [LAW, gl.HertzMindlin(young=10.0, poisson=0.3, mu=0.5)])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_list_of_grains_has_the_forces_of_its_overlaps(seed, law):
    graph = ring_of(seed)
    rows = np.column_stack([graph.x, graph.radii])
    mixed = np.random.default_rng(seed).permutation(len(rows))
    found = gl.loop(rows[mixed], law=law)
    assert np.array_equal(found.graph.x, rows[mixed[found.ids], :2])
    state = gl.contact_state(found)
    assert (state.overlap > 0.0).all()
    assert np.array_equal(state.normal_force, law.normal_force(state))
    assert not state.shear_force.any() and (found.regime == gl.Regime.ELASTIC).all()
    without = gl.loop(graph.replace(normal_force=0.0 * graph.normal_force), law=law)
    assert np.array_equal(without.graph.normal_force, law.normal_force(gl.contact_state(graph)))


def test_overlaps_without_friction_slide():
    rows = np.column_stack([gl.regular_polygon(5, strain=0.1).x, np.full(5, 0.5)])
    assert (gl.loop(rows, law=gl.LinearFrictional(1.0, 0.2, 0.0)).regime == 2).all()


def test_forces_regimes_and_the_reference_of_a_scene_stay():
    graph = ring_of(3).replace(regime=[2, 1, 1, 1, 1, 1, 2])
    found = gl.loop(gl.Scene(graph, LAW))
    for name in ("x", "x0", "normal_force", "shear_force", "regime", "contacts"):
        assert np.array_equal(getattr(found.graph, name), getattr(graph, name)), name
    again = gl.loop(found)
    assert np.array_equal(again.graph.x, graph.x) and again.ids.tolist() == [*range(7)]


def test_a_ring_across_a_border_is_unrolled():
    graph = ring_of(2)
    inside = np.mod(graph.x, 4.0)
    shift = np.floor(graph.x / 4.0).astype(int)
    i, j = graph.contacts.T
    cell = {"cell": 4.0 * np.eye(2), "images": shift[j] - shift[i]}
    assert cell["images"].any()
    periodic = graph.replace(x=inside, x0=inside, **cell)
    known = gl.traction_tangent(graph.replace(x0=graph.x), LAW)
    difference = gl.traction_tangent(gl.loop(gl.to_networkx(periodic), law=LAW)).matrix
    assert np.abs(difference - known.matrix).max() <= 1e-14 * np.abs(known.matrix).max()


def test_a_gap_within_the_tolerance_is_closed_without_force():
    rows = [(0, 0, 0.5), (1, 0, 0.5), (1, 1, 0.5), (0, 1 + 1e-4, 0.5)]
    found = gl.loop(rows, law=LAW, tolerance=2e-4)
    assert (found.regime == gl.Regime.ELASTIC).all() and (found.graph.normal_force == 0.0).all()
    scene = gl.Scene(found.graph.replace(regime=None), LAW)
    assert (gl.loop(scene, tolerance=2e-4).regime == gl.Regime.ELASTIC).all()
    with pytest.raises(gl.InputError, match="no contact across the gaps 3-0"):
        gl.loop(scene)


def square(**changes):
    network = nx.cycle_graph(4)
    for node, (x, y) in enumerate([(0, 0), (0.95, 0), (0.95, 0.95), (0, 0.95)]):
        network.nodes[node].update(x=x, y=y, radius=0.5)
    for node, values in changes.get("nodes", {}).items():
        network.add_node(node, **values)
    network.add_edges_from(changes.get("add", ()))
    network.remove_edges_from(changes.get("remove", ()))
    for node in changes.get("bare", ()):
        network.nodes[node].clear()
    return network


ELSEWHERE = {f"e{k}": {"x": 9 + k % 2, "y": k // 2, "radius": 0.5} for k in range(4)}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"add": [(0, 2)]}, "chords among contacts 0-2; no contact across the gaps 0-2"),
        ({"remove": [(0, 1)]}, "grains 0, 1 without two neighbours in contact"),
        ({"nodes": ELSEWHERE}, r"5 separate parts.*grains e0, e1, e2, \.\.\. without"),
        ({"add": [(0, "t")], "nodes": {"t": {"x": -0.9, "y": 0, "radius": 0.5}}},
         "grains t without two neighbours.*grains 0 with three contacts"),
        ({"bare": [1, 3]}, "node 1 without 'y', 'radius'|node 1 without 'x'"),
        ({"nodes": {2: {"radius": 0.0}}}, "node 2 with radius 0.0, expected .*positive radius"),
        ({"nodes": {2: {"radius": "a"}}}, "node 2 with radius 'a'"),
        ({"nodes": {2: {"x": (0.95, 0.95, 0.0)}}}, "x: got"),
        ({"nodes": {1: {"x": 0.95, "y": 0.95}, 2: {"x": 0.95, "y": 0.0}}},
         "no contact across the gaps 0-1, 2-3"),
    ],
)  # fmt: skip
def test_what_is_no_ring_is_named(changes, said):
    with pytest.raises(gl.InputError, match=said):
        gl.loop(square(**changes), law=LAW)


def test_one_of_several_loops_has_a_number():
    found = gl.loop(square(add=[(0, 2)]), 1, law=LAW)
    assert found.ids.tolist() == [0, 2, 3]


def test_rings_that_cross_and_grains_without_a_law():
    # Pushed through each other: both diagonals are longer than the sides allow.
    rows = np.array([(0, 0, 0.8), (1, 1, 0.8), (1, 0, 0.8), (0, 1, 0.8)])
    crossed = nx.cycle_graph(4)
    for node in crossed:
        crossed.nodes[node].update(x=tuple(rows[node, :2]), radius=0.8)
    with pytest.raises(gl.InputError, match="crossing branches"):
        gl.loop(crossed, law=LAW)
    with pytest.raises(gl.InputError, match=r"law: got none.*law=gl\.LinearFrictional"):
        gl.loop(crossed)
    with pytest.raises(gl.InputError, match="law: got LinearFrictional with a snapshot or scene"):
        gl.loop(gl.Scene(ring_of(1), LAW), law=LAW)
    with pytest.raises(gl.InputError, match="loop: got none, expected a number from 0 to"):
        gl.loop(gl.read_snapshot(gl.sample_path()))
    with pytest.raises(gl.InputError, match=r"source: got .*rows x, y, radius"):
        gl.loop(rows[:, :2], law=LAW)


def test_a_network_in_the_place_of_a_graph_names_the_remedy():
    with pytest.raises(gl.InputError, match=r"got networkx\.Graph.*gl\.loop\(network, law=law\)"):
        gl.affine_tangent(square(), LAW)
    with pytest.raises(gl.InputError, match=r"Order it by gl\.loop\(graph, law=law\)"):
        gl.traction_tangent(gl.from_networkx(square()), LAW)
