"""Paths of packings under every law, in cells and between walls: error, energy, slow motion."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from grainloops import replay
from loops import RollingResistance, Scene
from stability import Stage, follow, programmes, rates_at
from tests.laws import hertz_of, power_of, stiffening_of
from tests.packings import BRANCH, LAW, LIMITS, jammed, strained
from tests.stability.packing.walled_packings import JAMMED, ROUGH, between, jammed_in_box

H = np.array([[2e-3, 2e-4], [0.0, -2e-3]])
ROUGH_BOX = next(which for which in JAMMED if which[3] == ROUGH)


def linear(graph):
    return LAW


def mindlin(graph):
    return hertz_of(graph, "displacement")


def rolling(k_r, mu_r, inner=linear):
    return lambda graph: RollingResistance(inner(graph), k_r, mu_r)


# The packing, its law, and the largest difference to half the interval and to a slow replay.
CASES = {
    "12": ((12, 1), linear, 1e-6, 1e-5),
    "16": ((16, 2, BRANCH), lambda graph: BRANCH, 1e-6, 1e-5),
    "24": ((24, 3), linear, 1e-6, 1e-5),
    "36": ((36, 5), linear, 1e-6, 1e-5),
    "frictionless": ((16, 2, LIMITS[0]), lambda graph: LIMITS[0], 1e-5, 1e-5),
    "never slides": ((16, 2, LIMITS[1]), lambda graph: LIMITS[1], 1e-5, 1e-5),
    "no shear stiffness": ((16, 2, LIMITS[2]), lambda graph: LIMITS[2], 1e-5, 2e-6),
    "Hertz, 12": ((12, 1), hertz_of, 5e-5, 3e-5),
    "Hertz, 24": ((24, 3), hertz_of, 5e-5, 3e-5),
    "Mindlin": ((24, 3), mindlin, 5e-5, 3e-5),
    "stiffening": ((12, 1), stiffening_of, 1e-4, 4e-5),
    "rolls": ((12, 1), rolling(0.02, np.inf), 3e-5, 2e-5),
    "rolls and slides": ((24, 3), rolling(0.1, 0.01), 3e-5, 2e-5),
    "Hertz, rolls": ((24, 3), rolling(0.02, 0.05, hertz_of), 3e-5, 2e-5),
    "power, rolls": ((12, 1), rolling(0.02, 0.05, power_of), 3e-5, 2e-5),
    "box": (JAMMED[0], linear, 3e-5, 2e-5),
    "rough box": (ROUGH_BOX, linear, 3e-5, 2e-5),
    "rough box, Hertz": (ROUGH_BOX, hertz_of, 5e-5, 2e-5),
    "rough box, rolls": (ROUGH_BOX, rolling(0.02, 0.05), 3e-5, 2e-5),
}
OWN = ("stiffening", "power, rolls")


@cache
def scene_of(name):
    """Scene and strain of a case."""
    which, law, *_ = CASES[name]
    if "box" in name:
        graph, planes, force = jammed_in_box(*which)
        return Scene(graph, law(graph), between(planes, force)), np.diag([2e-3, -1e-3])
    graph = jammed(*which)
    return Scene(graph, law(graph)), H


def carried(state, count):
    """Forces and moments of the first contacts."""
    return np.column_stack([state.forces, state.rolling_moment])[:count]


def left_over(path):
    """What the energy balance leaves at the end, over the work."""
    work, *spent = path.work[-1]
    return abs(work - sum(spent) - (path.energy[-1] - path.energy[0])) / abs(work)


@pytest.mark.parametrize("name", CASES)
def test_the_error_halves_the_energy_closes_and_a_slow_replay_comes_to_it(name):
    """In a cell the first increment is that of the rate problem."""
    (scene, strain), (*_, most, slowly) = scene_of(name), CASES[name]
    count, stage = len(scene.graph.contacts), strained(strain)
    how = {"closure": "packing"}
    paths = [follow(scene, stage, interval=size, **how) for size in (4e-5, 2e-5, 1e-5)]
    assert {path.status for path in paths} == {"finished"}
    told = [sorted((event.kind, event.contacts) for event in path.events) for path in paths[1:]]
    assert told[0] == told[1] and len(told[0]) > 0
    ends = [carried(path.states[-1], count) for path in paths]
    size = np.linalg.norm(ends[-1])
    coarse, fine = (np.linalg.norm(a - b) / size for a, b in pairwise(ends))
    assert coarse / fine > 1.9 and fine < most
    assert max(left_over(path) for path in paths) < 1e-10
    times = (2e3, 4e3) if name in OWN else (2e4, 2e5)
    states = [replay(scene, strain, duration=time, viscous=0.02).state for time in times]
    fast, slow = (np.linalg.norm(carried(state, count) - ends[-1]) / size for state in states)
    assert slow < 1.01 * fast and slow < slowly
    if scene.graph.cell is None:
        return
    rates = rates_at(scene, H=strain, yield_band=1 - 1e-6)
    if name == "no shear stiffness":
        # A mechanism moves: its rates hang on a spring, and the status says so.
        assert rates.status == "not converged"
        return
    first = follow(scene, strained(1e-6 * strain), interval=1e-9, **how)
    change = (first.P[-1] - first.P[0]) / 1e-6
    np.testing.assert_allclose(change, rates.stress_rate.ravel(), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("past", ["viscous", "dynamic"])
@pytest.mark.parametrize(
    ("name", "target"), [("rough box", 4e-3), ("rough box, Hertz", 6e-3), ("rolls", 0.04)]
)
def test_the_energy_closes_through_instabilities(name, target, past):
    stage = Stage(programmes.drained_biaxial(), "H11", target)
    path = follow(scene_of(name)[0], stage, closure="packing", past=past, interval=4e-5)
    assert path.status == "finished" and left_over(path) < 1e-10
