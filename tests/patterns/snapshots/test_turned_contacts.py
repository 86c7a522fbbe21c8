"""Contacts that a table lists turned, and grains that stop, against one contact at a time."""

import numpy as np
import pytest

from loops import contact_frame
from patterns import synthetic_network
from patterns.snapshots import checks, missing
from patterns.snapshots.checked import Checked
from patterns.snapshots.geometry import some
from tests.loops.test_faces_compared import renumbered


def loaded(grains, seed):
    """A network with forces, its grains in random order."""
    graph = renumbered(synthetic_network(grains, seed=seed), seed)
    normal, shear = np.random.default_rng(seed).normal(
        [[1.0], [0.0]], 0.4, (2, graph.contact_count)
    )
    return graph.replace(normal_force=normal, shear_force=shear)


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
def test_forces_on_grains_and_what_they_tell(seed, walls):
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


def test_some_rows():
    rng = np.random.default_rng(0)
    rows = rng.permutation(1000)
    for values in (rng.random(1000), rng.random((1000, 2)), rng.integers(0, 9, 1000)):
        for picked in (rows, rows[:77], np.arange(1000)):
            np.testing.assert_array_equal(some(values, picked), values[picked])
