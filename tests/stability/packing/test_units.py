"""Packings and paths in other units of force and length: the same answers, bit for bit or nearly.

Units differ by powers of two, so that every number is the same but for its exponent. A length that
is compared with a force, or with a number, shows.
"""

from dataclasses import replace

import numpy as np
import pytest

from grainloops import hold, probe, replay
from loops import (
    Boundary,
    GrainGraph,
    HertzMindlin,
    LinearFrictional,
    PlaneContacts,
    RollingResistance,
    Scene,
    find_faces,
)
from stability import follow, rates_at
from stability.packing import sustain
from stability.packing.loop_quantities import LoopRates
from tests.laws import hertz_of
from tests.packings import (
    BRANCH,
    LAW,
    jammed,
    loop_changes,
    loop_rates,
    packing,
    start_state,
    strained,
)
from tests.stability.packing.walled_packings import JAMMED, between, jammed_in_box

# Unit discs have masses of r^2: the unit of time is a power of two as well.
FORCE, LENGTH = 2.0**12, 2.0**-8
TIME = LENGTH**1.5 * FORCE**-0.5
H = np.array([[2e-3, 2e-4], [0.0, -2e-3]])


def graph_in_units(graph):
    scaled = {"x": LENGTH * graph.x, "radii": LENGTH * graph.radii}
    if graph.cell is not None:
        scaled["cell"], scaled["images"] = LENGTH * graph.cell, graph.images
    return GrainGraph(
        contacts=graph.contacts,
        normal_force=FORCE * graph.normal_force,
        shear_force=FORCE * graph.shear_force,
        **scaled,
    )


def law_in_units(law):
    unit = FORCE / LENGTH
    if isinstance(law, RollingResistance):
        return RollingResistance(law_in_units(law.law), FORCE * LENGTH * law.k_r, law.mu_r)
    if isinstance(law, HertzMindlin):
        how = law.mu, law.shear_increment, law.shear_history
        return HertzMindlin(unit / LENGTH * law.young, law.poisson, *how)
    return LinearFrictional(unit * law.kn, unit * law.kt, law.mu, law.shear_increment)


def walls_in_units(walls):
    planes, unit = walls["boundary"].walls, FORCE / LENGTH
    stiffness = unit * planes.kn, unit * planes.kt
    branch, force = LENGTH * planes.branch, FORCE * planes.force
    return {"boundary": between(PlaneContacts(planes.grain, branch, *stiffness, planes.mu), force)}


def unequal(grains, seed, increment="radii"):
    """A jammed packing in balance, `kn` 3, other `kt` and `mu` at each contact."""
    graph, rng = jammed(grains, seed, LAW if increment == "radii" else BRANCH), np.random
    kt, mu = (
        rng.default_rng(seed).uniform(*ends, graph.contact_count)
        for ends in ((0.4, 1.2), (0.5, 0.7))
    )
    graph = graph.replace(
        normal_force=3.0 * graph.normal_force, shear_force=3.0 * graph.shear_force
    )
    return graph, LinearFrictional(3.0, kt, mu, increment)


def scene(name):
    """A packing, its law, walls and a strain, in either units."""
    strain, walls = 4 * H, {}
    if name == "box":
        grains, seed, law, wall = JAMMED[3]
        graph, planes, force = jammed_in_box(grains, seed, law, wall)
        strain, walls = np.diag([4e-3, -4e-3]), {"boundary": between(planes, force)}
    else:
        graph, law = unequal(12, 1, "branch" if name == "branch" else "radii")
    if name == "Hertz":
        law = hertz_of(graph, "displacement")
    if name == "rolling":
        law = RollingResistance(law, 0.1, 0.02)
    other = graph_in_units(graph), law_in_units(law), walls_in_units(walls) if walls else {}
    return (graph, law, walls), other, strain


def same(found, other, unit=1.0, rtol=1e-9, atol=0.0):
    np.testing.assert_allclose(np.asarray(other) / unit, found, rtol=rtol, atol=atol)


@pytest.mark.parametrize("law", [LAW, BRANCH], ids=["radii", "branch"])
def test_rates_of_a_packing(law):
    graph = packing(30, seed=4, sliding=0.2, law=law)
    other = graph_in_units(graph)
    found = [
        rates_at(Scene(graph, law), H=H),
        rates_at(Scene(other, law_in_units(law)), H=H),
    ]
    assert found[0].status == found[1].status and found[0].proof == found[1].proof
    units = {
        "stress_rate": FORCE / LENGTH,
        "motion": LENGTH,
        "spin": 1.0,
        "branch_rate": LENGTH,
        "force_rate": FORCE,
    }
    for name, unit in units.items():
        one, two = (np.asarray(getattr(response, name)) for response in found)
        same(one, two, unit, atol=1e-10 * np.abs(one).max())
    assert (found[0].regime == found[1].regime).all()
    compare_loops(*(loop_rates(one, find_faces(graph)) for one in found))


def compare_loops(one, other):
    units = {"stress": FORCE / LENGTH, "second_order_work": FORCE / LENGTH, "area": LENGTH**2}
    units["additive_work"] = FORCE / LENGTH
    for name in LoopRates.__annotations__:
        a, b = np.asarray(getattr(one, name)), np.asarray(getattr(other, name))
        unit = units.get(name, 1.0)
        same(
            a, b, unit, atol=1e-9 * np.nanmax(np.abs(np.where(np.isfinite(a), a, 0.0)), initial=0.0)
        )


@pytest.mark.parametrize("control", ["strain", "stress"])
def test_probes(control):
    graph = packing(16, seed=1, sliding=0.3)
    one = probe(Scene(graph, LAW), 12, control=control)
    other = probe(Scene(graph_in_units(graph), law_in_units(LAW)), 12, control=control)
    assert list(one.status) == list(other.status)
    assert (one.piece == other.piece).all() and (one.order == other.order).all()
    stiffness = FORCE / LENGTH
    size = np.abs(one.elastic_tangent).max()
    same(one.elastic_tangent, other.elastic_tangent, stiffness, atol=1e-9 * size)
    same(one.tangents, other.tangents, stiffness, atol=1e-9 * size)
    for name in ("arcs", "cones", "unstable_fraction"):
        same(getattr(one, name), getattr(other, name), atol=1e-9)
    strain, stress = (1.0, stiffness) if control == "strain" else (1 / stiffness, 1.0)
    same(one.strain_rate, other.strain_rate, strain, atol=1e-9)
    same(one.stress_rate, other.stress_rate, stress, atol=1e-9)
    same(one.area, other.area, LENGTH**2)
    same(one.loop_work, other.loop_work, strain * stress, atol=1e-9 * np.abs(one.loop_work).max())


def test_a_packing_comes_to_rest():
    graph = jammed(12, 1, LAW)
    shaken = graph.replace(shear_force=0.97 * graph.shear_force)
    one = hold(Scene(shaken, LAW))
    other = hold(Scene(graph_in_units(shaken), law_in_units(LAW)))
    assert one.status == other.status == "at rest" and one.steps == other.steps
    same(one.graph.x, other.graph.x, LENGTH)
    same(one.graph.normal_force, other.graph.normal_force, FORCE)
    for name in ("unbalanced", "spread"):
        same(getattr(one, name), getattr(other, name), rtol=1e-6)


def test_a_replay_and_what_its_loops_do():
    graph = jammed(12, 1, LAW)
    one = replay(Scene(graph, LAW), H, inertial_number=1e-3)
    other = replay(Scene(graph_in_units(graph), law_in_units(LAW)), H, inertial_number=1e-3)
    assert one.steps == other.steps and one.duration == one.steps * one.time_step
    for name, unit in (("time_step", TIME), ("duration", TIME), ("velocity", LENGTH / TIME)):
        same(getattr(one, name), getattr(other, name), unit)
    same(one.spin, other.spin, 1 / TIME)
    same(one.state.normal_force, other.state.normal_force, FORCE)
    faces = find_faces(graph)
    changes = [
        loop_changes(graph, one.state, faces),
        loop_changes(graph_in_units(graph), other.state, faces),
    ]
    compare_loops(*changes)


SCENES = ["radii", "branch", "rolling", "Hertz", "box"]
PASSED = list(zip(SCENES, ["dynamic", "viscous"] * 3, strict=False))


@pytest.mark.parametrize(("name", "past"), PASSED)
def test_paths_under_each_law(name, past):
    *both, strain = scene(name)
    one, other = (
        follow(
            Scene(graph, law, **walls),
            strained(strain),
            closure="packing",
            interval=2e-4,
            past=past,
        )
        for graph, law, walls in both
    )
    assert one.status == other.status == "finished" and len(one.events) > 5
    assert [(e.kind, e.contacts) for e in one.events] == [
        (e.kind, e.contacts) for e in other.events
    ]
    assert one.intervals == other.intervals
    same(one.P, other.P, FORCE / LENGTH, rtol=1e-7, atol=1e-9 * np.abs(one.P).max())
    size = 1e-9 * np.abs(one.work).max()
    same(one.work, other.work, FORCE * LENGTH, rtol=1e-6, atol=size)
    same(one.energy, other.energy, FORCE * LENGTH, rtol=1e-7)
    # Work is stored, lost by slip, or released.
    work, *spent = one.work[-1]
    assert abs(work - sum(spent) - one.energy[-1] + one.energy[0]) < 1e-9 * abs(work)


@pytest.mark.parametrize("name", SCENES)
def test_packings_of_each_law_come_to_rest(name):
    *both, _ = scene(name)
    held = []
    for (graph, law, walls), length in zip(both, (1.0, LENGTH), strict=True):
        kick = 1e-3 * np.random.default_rng(1).standard_normal(graph.x.shape)
        shaken = graph.replace(x=graph.x + length * kick)
        control = "strain" if walls else "stress"
        if walls:
            walls = {"boundary": replace(walls["boundary"], volume=12.0 * length**2)}
        held.append(hold(Scene(shaken, law, **walls), control=control, unbalanced=1e-4))
    one, other = held
    assert one.status == other.status == "at rest" and one.steps == other.steps
    assert (one.lost, one.gained, one.sliding) == (other.lost, other.gained, other.sliding)
    # The servo mixes stress and strain, whose units differ: rounding is another one.
    same(one.graph.x, other.graph.x, LENGTH, rtol=0, atol=1e-6)
    same(one.stress, other.stress, FORCE / LENGTH, rtol=1e-4, atol=1e-5 * one.stress[0, 0])
    same(one.strain, other.strain, rtol=1e-4, atol=1e-8)
    for name in ("unbalanced_before", "spread", "forces_changed"):
        same(getattr(one, name), getattr(other, name), rtol=1e-3, atol=1e-7)


@pytest.mark.parametrize("name", ["radii", "box", "Hertz"])
def test_loads_that_are_sustained(name):
    *both, _ = scene(name)
    paths = []
    for graph, law, walls in both:
        largest = 0.3 * np.trace(start_state(graph, *walls.values()).stress)
        how = {"largest": largest, "interval": 1e-4, "spread": False}
        paths += sustain(Scene(graph, law, **walls), [[0.2, -1]], **how).paths
    one, other = paths
    assert one.status == other.status and len(one.motions) == len(other.motions) > 0
    unit = FORCE / LENGTH
    same(one.first_event, other.first_event, unit, rtol=1e-9)
    # The box softens until the control meets its limit: rounding of the mean stiffness decides
    # which intervals are cut, and loads part within the spread that is stated.
    box = name == "box"
    for name in ("limit", "first_large_load"):
        same(getattr(one, name), getattr(other, name), unit, one.limit_spread if box else 1e-7)
    for first, second in zip(one.motions, other.motions, strict=True):
        assert (first.status, first.contact) == (second.status, second.contact)
        if box:
            continue
        for name in ("steps", "opened", "closed"):
            assert getattr(first, name) == getattr(second, name)
        same(first.strain, second.strain, rtol=1e-3, atol=1e-8)
        same(first.kinetic, second.kinetic, FORCE * LENGTH, rtol=1e-3)
        same(first.displacement, second.displacement, LENGTH, rtol=1e-3, atol=1e-7)


def test_walls_resist_along_and_across():
    """`N' = -kn n.d'`, `T' = -kt (t.d' - r w)` and the moment `-r T`, motion by motion."""
    rng = np.random.default_rng(1)
    radii, grain = np.array([0.3, 9.0, 0.8]), np.array([2, 0])
    # Grains that just touch: the arm is the radius.
    branch = rng.normal(size=(2, 2))
    branch *= (radii[grain] / np.hypot(*branch.T))[:, None]
    planes = PlaneContacts(grain, branch, np.array([3.0, 5.0]), np.array([0.7, 1.1]))
    graph = GrainGraph(np.zeros((3, 2)), radii, np.empty((0, 2), dtype=int))
    rows = Scene(graph, LinearFrictional(1.0, 0.5, 0.5), Boundary(walls=planes)).rows
    S = rows.tangents(np.ones(2, dtype=np.int8))
    for c in range(2):
        n = planes.branch[c] / np.hypot(*planes.branch[c])
        t = np.array([-n[1], n[0]])
        r = radii[planes.grain[c]]
        for k in range(3):
            motion = np.eye(4)[k]
            d, w = motion[:2], motion[2]
            N, T = -planes.kn[c] * (n @ d), -planes.kt[c] * (t @ d - r * w)
            np.testing.assert_allclose(-S[c, :, k], [*(N * n + T * t), -r * T, 0.0], atol=1e-14)
