"""Numbers of grains and contacts, names of the axes and the place of the cell change no load."""

import sys
from collections import defaultdict

import numpy as np
import pytest

from loops import GrainGraph, Scene
from stability.packing import path as path_solver
from stability.packing import sustain
from stability.packing.sustain import Loading, load_path, renumbered
from tests.packings import LAW, jammed, start_state

sustain_module = sys.modules[sustain.__module__]
PACKINGS = ((12, 1), (16, 2), (24, 3), (36, 5))
# Loads of events before the first motion; a motion to rest leaves 1e-7 of the forces.
ROUNDING, AFTER_MOTIONS = 1e-6, 1e-4


def turned(graph, seed):
    """The packing in other numbers, its axes exchanged, moved; old numbers of the grains."""
    rng = np.random.default_rng(seed)
    grains, rows = rng.permutation(graph.grain_count), rng.permutation(graph.contact_count)
    place = np.argsort(grains)
    ends, images = place[graph.contacts[rows]], graph.images[rows, ::-1]
    other = rng.random(len(rows)) < 0.5
    ends[other], images[other] = ends[other, ::-1], -images[other]
    return GrainGraph(
        x=graph.x[grains, ::-1] + rng.uniform(-3, 3, 2),
        radii=graph.radii[grains],
        contacts=ends,
        images=images,
        cell=graph.cell[::-1, ::-1],
        normal_force=graph.normal_force[rows],
        # A mirror image turns the tangents round.
        shear_force=-graph.shear_force[rows],
    ), grains


def named(solver, grains, exchanged):
    """Loads of the events of a path by kind, grains and image."""
    found = defaultdict(list)
    for event in solver.point.events:
        c = event.contacts[0]
        i, j = grains[solver.point.state.contacts[c]]
        image = solver.point.state.images[c][:: -1 if exchanged else 1]
        key = (i, j, *image) if i < j else (j, i, *-image)
        found[event.kind, tuple(map(int, key))].append(event.parameter)
    return {name: np.sort(loads) for name, loads in found.items()}


def differences(graph, seed, angle, monkeypatch):
    """What differs between a direction and the same one after `turned`; the statuses."""
    solvers = []

    class Kept(path_solver.PackingPathSolver):
        def __init__(self, *given, **options):
            super().__init__(*given, **options)
            solvers.append(self)

    monkeypatch.setattr(sustain_module, "PackingPathSolver", Kept)
    largest = 0.3 * np.trace(start_state(graph).stress)
    loading = Loading("diagonal", largest, 1e-4, 3e-4, 3, False)
    other, grains = turned(graph, seed)
    direction = np.array([np.cos(angle), np.sin(angle)])
    paths = [
        load_path(Scene(packing, LAW), towards, loading, None)
        for packing, towards in ((graph, direction), (other, direction[::-1]))
    ]
    one, two = paths
    wrong = []
    if one.status != two.status or len(one.motions) != len(two.motions):
        wrong.append((one.status, two.status, len(one.motions), len(two.motions)))
    for name in ("limit", "first_event", "first_instability"):
        a, b = getattr(one, name), getattr(two, name)
        if not np.isclose(a, b, rtol=ROUNDING, equal_nan=True):
            wrong.append((name, a, b))
    if not np.isclose(
        one.first_large_load, two.first_large_load, rtol=AFTER_MOTIONS, equal_nan=True
    ):
        wrong.append(("large", one.first_large_load, two.first_large_load))
    first, second = (
        named(solvers[0], np.arange(graph.grain_count), False),
        named(solvers[1], grains, True),
    )
    lost = np.array([motion.lost for motion in one.motions])
    end = lost.min(initial=np.inf)
    for name in first.keys() | second.keys():
        # Where no regimes agree rounding decides which contacts the search for them turns.
        a, b = (
            loads[np.all(np.abs(loads[:, None] / lost - 1) > ROUNDING, axis=1)]
            for loads in (told.get(name, np.zeros(0)) for told in (first, second))
        )
        if len(a) != len(b):
            wrong.append((name, a, b))
            continue
        rtol = np.where(a <= end * (1 + ROUNDING), ROUNDING, AFTER_MOTIONS)
        if (np.abs(a - b) > rtol * np.maximum(a, 1e-3 * largest)).any():
            wrong.append((name, a, b))
    return wrong, one.status


def directions(count):
    """Packing, and angle, in turn: a third of them unload an axis, where equilibrium is lost."""
    for k in range(count):
        grains, seed = PACKINGS[k % len(PACKINGS)]
        yield grains, seed, 2 * np.pi * (k + 0.5) / count


@pytest.mark.parametrize(("grains", "seed", "turn"), [(12, 1, 6), (24, 3, 6)])
@pytest.mark.parametrize("number", range(4))
def test_numbers_and_axes_change_no_load(grains, seed, turn, number, monkeypatch):
    """Same events of the same contacts, limits and statuses; each of these meets a motion."""
    wrong, status = differences(jammed(grains, seed, LAW), number, np.pi * turn / 4, monkeypatch)
    assert wrong == [] and status != "held"


@pytest.mark.slow
def test_numbers_and_axes_change_no_load_in_192_directions(monkeypatch):
    found, statuses = {}, set()
    for k, (grains, seed, angle) in enumerate(directions(192)):
        wrong, status = differences(jammed(grains, seed, LAW), k, angle, monkeypatch)
        statuses.add(status)
        if wrong:
            found[grains, k, angle] = wrong
    assert found == {} and len(statuses) > 1


def test_a_packing_in_another_order_has_its_regimes_and_moments():
    graph = jammed(24, 3, LAW)
    rng = np.random.default_rng(1)
    count = graph.contact_count
    graph = graph.replace(
        normal_force=np.arange(count),
        regime=rng.integers(0, 3, count),
        rolling_moment=rng.normal(size=count),
    )
    other = renumbered(Scene(graph, LAW), 2).graph
    rows = other.normal_force.astype(int).tolist()
    assert rows != list(range(count))
    np.testing.assert_array_equal(other.regime, graph.regime[rows])
    np.testing.assert_array_equal(other.rolling_moment, graph.rolling_moment[rows])
