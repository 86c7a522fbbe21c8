"""Force chains of packings laid by hand, and the loops beside them."""

import numpy as np
import pytest

from loops import (
    FaceKind,
    GrainGraph,
    InputError,
    find_faces,
    force_chains,
    love_weber_stress,
)
from patterns import read_snapshot, sample_path

SIDE = 5


def lattice(turn=0.0, **forces):
    """A square lattice of 5 x 5 grains; `row_k` and `column_k` carry a force, the others 0.1."""
    x = np.array([[k % SIDE, k // SIDE] for k in range(SIDE**2)], dtype=float)
    rows = [(k, k + 1) for k in range(SIDE**2) if k % SIDE < SIDE - 1]
    columns = [(k, k + SIDE) for k in range(SIDE**2 - SIDE)]
    normal = [forces.get(f"row_{i // SIDE}", 0.1) for i, _ in rows]
    normal += [forces.get(f"column_{i % SIDE}", 0.1) for i, _ in columns]
    c, s = np.cos(turn), np.sin(turn)
    return GrainGraph(
        x=x @ np.array([[c, s], [-s, c]]), radii=[0.5] * SIDE**2, contacts=rows + columns,
        normal_force=normal,
    )  # fmt: skip


@pytest.mark.parametrize("turn", [0.0, 0.3, np.pi / 2, 2.0])
def test_a_loaded_row_is_a_chain_whatever_its_direction(turn):
    graph = lattice(turn, row_1=10.0)
    found = force_chains(graph)
    assert np.flatnonzero(found.chain >= 0).tolist() == [5, 6, 7, 8, 9]
    assert set(found.chain[5:10]) == {0}
    assert {tuple(pair) for pair in graph.contacts[found.links]} == {(5, 6), (6, 7), (7, 8), (8, 9)}
    # Axes are those of the row, up to the sign.
    assert np.abs(np.sin(found.axis[5:10] - turn)).max() < 1e-7


def test_two_chains_are_numbered_by_their_smallest_grains():
    found = force_chains(lattice(row_3=10.0, row_1=9.0))
    assert found.chain[[5, 9, 15, 19]].tolist() == [0, 0, 1, 1]
    assert (found.chain[[0, 10, 20]] == -1).all()


def test_the_loops_beside_a_chain():
    graph = lattice(row_1=10.0)
    faces = find_faces(graph)
    beside = force_chains(graph).on_loops(faces)
    rows = [int(graph.x[faces.grains[faces.offsets[face]]][1]) for face in faces.loops]
    assert beside.tolist() == [int(row in (0, 1)) for row in rows]
    assert (faces.kind[faces.loops] == FaceKind.LOOP).all()


def zigzag(angle, grains=6):
    """A row of grains whose branches go up and down by an angle, beside unloaded ones."""
    steps = np.array([[np.cos(angle), (-1) ** k * np.sin(angle)] for k in range(grains - 1)])
    x = np.concatenate([[[0.0, 0.0]], np.cumsum(steps, axis=0)])
    far = np.column_stack([np.arange(9.0), np.full(9, 9.0)])
    pairs = [(k, k + 1) for k in range(grains + 8) if k != grains - 1]
    forces = [1.0] * (grains - 1) + [0.01] * 8
    return GrainGraph(
        x=np.concatenate([x, far]), radii=[0.5] * (grains + 9), contacts=pairs, normal_force=forces
    )


@pytest.mark.parametrize(("degrees", "length"), [(0, 6), (20, 6), (29, 6)])
def test_a_bent_chain_goes_on_within_the_angle(degrees, length):
    found = force_chains(zigzag(np.radians(degrees)))
    assert np.count_nonzero(found.chain == 0) == length


def test_a_chain_ends_where_it_bends_by_more_than_the_angle():
    graph = zigzag(np.radians(20))
    assert (force_chains(graph, angle=np.radians(19)).chain == -1).all()
    # Inner grains have the axis of the row: their branches deviate by 20 degrees.
    assert force_chains(graph, angle=np.radians(21)).chain.max() == 0


def test_two_grains_are_no_chain_unless_asked_for():
    graph = zigzag(0.0, grains=2)
    assert (force_chains(graph).chain == -1).all() and len(force_chains(graph).links) == 0
    assert np.count_nonzero(force_chains(graph, least=2).chain == 0) == 2


def test_a_chain_does_not_fork():
    # From grain 1 two branches go on, 10 and 25 degrees off its axis: the straighter one is taken.
    a, b = np.radians(10), np.radians(-45)
    x = [[-1.0, 0.0], [0.0, 0.0], [np.cos(a), np.sin(a)], [np.cos(b), np.sin(b)],
         [0.0, 9.0], [1.0, 9.0], [2.0, 9.0], [3.0, 9.0], [4.0, 9.0]]  # fmt: skip
    graph = GrainGraph(
        x=x, radii=[0.5] * 9, contacts=[[0, 1], [1, 2], [1, 3], [4, 5], [5, 6], [6, 7], [7, 8]],
        normal_force=[2.0, 1.5, 1.5, 0.01, 0.01, 0.01, 0.01],
    )  # fmt: skip
    found = force_chains(graph)
    assert np.bincount(graph.contacts[found.links].ravel(), minlength=9).max() <= 2
    assert found.chain.tolist()[:4] == [0, 0, 0, -1]


def test_stresses_of_the_grains_add_up_to_that_of_the_sample():
    snapshot = read_snapshot(sample_path())
    found = force_chains(snapshot.graph)
    areas = np.pi * snapshot.graph.radii**2
    whole = love_weber_stress(snapshot.graph, 1.0)
    total = np.einsum("g,gij->ij", areas, found.stress)
    np.testing.assert_allclose(total, whole, rtol=0, atol=1e-12 * np.abs(whole).max())
    inside = found.chain >= 0
    assert (found.major[inside] > found.major[found.major != 0].mean()).all()
    assert (np.bincount(found.chain[inside]) >= 3).all()


def test_a_periodic_row_is_one_chain_round_the_cell():
    snapshot = GrainGraph(
        x=[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [0.0, 1.0], [1.0, 1.0], [2.0, 1.0]],
        radii=[0.5] * 6, contacts=[[0, 1], [1, 2], [2, 0], [3, 4], [4, 5], [5, 3]],
        images=[[0, 0], [0, 0], [1, 0], [0, 0], [0, 0], [1, 0]], cell=[[3.0, 0.0], [0.0, 2.0]],
        normal_force=[9.0, 9.0, 9.0, 1.0, 1.0, 1.0],
    )  # fmt: skip
    found = force_chains(snapshot)
    assert found.chain.tolist() == [0, 0, 0, -1, -1, -1] and found.links.tolist() == [0, 1, 2]


def test_a_batch_is_refused():
    graph = lattice()
    with pytest.raises(InputError):
        force_chains(graph.replace(normal_force=np.ones((2, graph.contact_count))))
