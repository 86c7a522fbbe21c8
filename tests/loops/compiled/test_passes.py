"""Kernels that pass over the contacts of a large packing: to the bit what numpy does."""

from dataclasses import fields

import numpy as np
import pytest

from loops import GrainGraph, contact_frame, edge_tensors, find_faces, force_chains
from loops.compiled import on_parts
from loops.graph import branches_between
from patterns import read_snapshot, sample_cell, sample_path, synthetic_network
from patterns.snapshots import checks, missing
from patterns.snapshots.checked import Checked
from patterns.snapshots.geometry import some
from tests.loops.test_faces_compared import renumbered
from tests.patterns.snapshots.test_order_along_space import shuffled_copy

NEVER = 10**9


@pytest.fixture(params=[1, 2, 5])
def both(request, monkeypatch):
    """Answer of a function by numpy, and by kernels on so many cores."""
    monkeypatch.setattr("loops.compiled.available_cores", lambda: request.param)

    def run(work):
        answers = []
        for least in (NEVER, 1):
            monkeypatch.setattr("loops.compiled.PASSES_FROM", least)
            answers.append(work())
        return answers

    return run


def assert_equal(one, other):
    """Arrays, tuples and data classes of them, to the bit."""
    assert type(one) is type(other)
    if isinstance(one, np.ndarray):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)
    elif isinstance(one, tuple | list):
        assert len(one) == len(other)
        for a, b in zip(one, other, strict=True):
            assert_equal(a, b)
    elif hasattr(one, "__dataclass_fields__"):
        for field in fields(one):
            assert_equal(getattr(one, field.name), getattr(other, field.name))
    else:
        assert one == other


def loaded(grains, seed, *, periodic=False):
    """A network with forces, its grains in random order."""
    graph = renumbered(synthetic_network(grains, seed=seed, periodic=periodic), seed)
    normal, shear = np.random.default_rng(seed).normal(
        [[1.0], [0.0]], 0.4, (2, graph.contact_count)
    )
    return graph.replace(normal_force=normal, shear_force=shear)


@pytest.mark.parametrize("periodic", [False, True])
def test_branches_and_their_frame(both, periodic):
    graph = loaded(700, 3, periodic=periodic)
    # Far from the origin differences of centres are rounded.
    far = graph.replace(x=np.add(graph.x, [1e3, -3e5]), x0=None)
    for one in (graph, far):
        assert_equal(*both(lambda g=one: branches_between(g.x, g.contacts, g.images, g.cell)))
        assert_equal(*both(lambda g=one: contact_frame(g)))
        assert_equal(*both(lambda g=one: force_chains(g)))


@pytest.mark.parametrize("periodic", [False, True])
def test_shapes_by_edges_are_those_of_numpy_to_round_off(both, periodic):
    graph = loaded(700, 5, periodic=periodic)
    faces = find_faces(graph)
    plain, fast = both(lambda: edge_tensors(graph.branches, faces))
    assert len(plain) == len(faces.loops) > 500
    np.testing.assert_allclose(fast, plain, rtol=1e-13, atol=1e-15)


def test_a_batch_is_left_to_numpy(both):
    rng = np.random.default_rng(0)
    graph = GrainGraph(x=rng.random((4, 3, 2)), radii=[0.5] * 3, contacts=[[0, 1], [1, 2]])
    assert_equal(*both(lambda: contact_frame(graph)))


def test_a_part_has_all_rows_once(monkeypatch):
    for cores in (1, 2, 3, 8):
        monkeypatch.setattr("loops.compiled.available_cores", lambda cores=cores: cores)
        for count in (1, 2, 7, 8, 100):
            seen = np.zeros(count, dtype=int)
            on_parts(lambda part, seen=seen: np.add(seen[part], 1, out=seen[part]), count)
            assert (seen == 1).all()


def state_of(seed, walls):
    """Contacts of a network; grains at the rim count with walls."""
    graph, rng, pushed = loaded(500, seed), np.random.default_rng(seed), None
    if walls:
        grain = rng.integers(0, graph.grain_count, 50)
        pushed = (grain, rng.normal(size=(50, 2)) * graph.normal_force.mean())
    length, n, _ = contact_frame(graph)
    d, ids = length[:, None] * n, np.arange(graph.grain_count)
    return Checked(graph, d, length, None, None, None, pushed, ids, forces_known=True)


def turned_one_by_one(state, rest, least):
    """Contacts that leave both grains with less than a share of the change, if they are turned."""
    found = []
    for c, (i, j) in enumerate(state.contacts.tolist()):
        normal, shear = (part[0] for part in state.parts(np.array([c])))
        for force in (normal + shear, normal, shear):
            change = 2 * np.hypot(*force)
            ends = ((i, rest[i] + 2 * force), (j, rest[j] - 2 * force))
            ends = [np.hypot(*end) for g, end in ends if state.inner[g]]
            if ends and change > least and max(ends) < checks.CONTACT_TURNED * change:
                found.append(c)
                break
    return found


@pytest.mark.parametrize("walls", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_forces_on_grains_and_what_they_tell(both, seed, walls):
    def work():
        state = state_of(seed, walls)
        rest = np.add(*state.residuals)
        pushed = np.hypot(*rest.T) > np.median(np.hypot(*rest.T))
        # What contacts apart from each other leave on grains in balance, some by a part alone.
        left = np.random.default_rng(seed).normal(size=rest.shape) * 1e-3 * np.abs(rest).mean()
        taken = np.zeros(len(rest), dtype=bool)
        normal, shear = state.parts()
        every = (normal + shear, normal, shear)
        for c, (i, j) in enumerate(state.contacts.tolist()):
            if not (taken[i] or taken[j]):
                left[i] -= 2.0 * every[c % 3][c]
                left[j] += 2.0 * every[c % 3][c]
                taken[[i, j]] = True
        least = float(np.median(np.hypot(*shear.T)))
        turned = checks._turned(state, left, least)
        np.testing.assert_array_equal(turned, turned_one_by_one(state, left, least))
        # Both answers occur.
        assert 3 < len(turned) < len(state.contacts)
        stopped = missing._stopped(state, pushed, rest)
        assert 0 < np.count_nonzero(stopped) < np.count_nonzero(pushed)
        return state.reach, state.resultants, turned, stopped

    assert_equal(*both(work))


def test_some_rows(both):
    rng = np.random.default_rng(0)
    rows = rng.permutation(1000)
    for values in (rng.random(1000), rng.random((1000, 2)), rng.integers(0, 9, 1000)):
        for picked in (rows, rows[:77], np.arange(1000)):
            found = both(lambda v=values, p=picked: some(v, p))
            assert_equal(*found)
            np.testing.assert_array_equal(found[0], values[picked])


@pytest.mark.parametrize("name", ["grains_biaxial.csv.gz", "grains_periodic.parquet"])
@pytest.mark.parametrize("shuffles", [False, True])
def test_whole_snapshots(both, monkeypatch, tmp_path, name, shuffles):
    """Arrays, law, walls, notes and all findings."""
    monkeypatch.setattr("loops.compiled.COMPILED_FROM", 100)
    monkeypatch.setattr("patterns.snapshots.geometry.FAR_IN_LISTS", 4.0)
    path = shuffled_copy(sample_path(name), tmp_path) if shuffles else sample_path(name)
    cell = sample_cell() if "periodic" in name else None
    one, other = both(lambda: read_snapshot(path, cell=cell))
    assert_equal(one, other)
    assert one.mean_kn == other.mean_kn and len(one.findings) > 10
