"""Every law through every tool: without its own term a law answers as the known one does.

An attraction or a bond of nothing, a rolling spring of no stiffness and a stiffening law that does
not stiffen are linear springs; Hertz's law written anew is `HertzMindlin`. Each law is fitted to
the forces that a small packing, or a hexagon, rests in.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import grainloops as gl
from grainloops import LoopMaterial, hold, oriented, replay
from loops import (
    CohesiveFrictional,
    HertzMindlin,
    InputError,
    LinearFrictional,
    RollingResistance,
    Scene,
    affine_tangent,
    contact_forces,
    contact_state,
    traction_tangent,
)
from loops.system import packing_stress
from patterns import Snapshot, WallContacts, regular_polygon
from patterns.snapshots.walls import wall_plates
from stability import Stage, follow, programmes
from tests.laws import ByDisplacement, Glue, Spheres, Stiffening
from tests.packings import BRANCH, jammed, loops_in_place
from tests.stability.packing.walled_packings import ROUGH, between, jammed_in_box

KT, MU, POISSON = 0.5, 0.5, 0.2
# Attraction, pull of a bond, stiffness against rolling and its limit, stiffening.
PULL, ROLLING, LIMIT, BEND = 1e-4, 0.02, 0.1, 2.0


def fitted(graph, pull=0.0, power=1.0, bend=0.0):
    """Modulus under which contacts have their forces; one number where all are equal."""
    delta = contact_state(graph).overlap
    k = (graph.normal_force + pull) / (delta**power * (1.0 + bend * delta))
    return float(k[0]) if np.ptp(k) < 1e-12 * k[0] else k


def linear(graph, term=1.0):
    return LinearFrictional(fitted(graph), KT, MU, "radii")


def attraction(graph, term=1.0):
    return CohesiveFrictional(
        fitted(graph, term * PULL), KT, MU, term * PULL, shear_increment="radii"
    )


def bonds(graph, term=1.0):
    how = {"bonded": True, "shear_increment": "radii"}
    return CohesiveFrictional(fitted(graph), KT, MU, term * PULL, **how)


def rolling(graph, term=1.0):
    return RollingResistance(linear(graph), term * ROLLING)


def limited(graph, term=1.0):
    return RollingResistance(linear(graph), term * ROLLING, LIMIT)


def stiffening(graph, term=1.0):
    how = {"kt": KT, "mu": MU, "shear_increment": "radii"}
    return Stiffening(k=fitted(graph, bend=term * BEND), b=term * BEND, c=term * BEND, **how)


def young(graph):
    state = contact_state(graph)
    reduced = state.radii_i * state.radii_j / state.touching_length
    k = np.asarray(1.5 * (1.0 - POISSON**2) * fitted(graph, power=1.5)) / np.sqrt(reduced)
    return float(k[0]) if np.ptp(k) < 1e-12 * k[0] else k


def hertz(graph, term=1.0):
    return HertzMindlin(young(graph), POISSON, MU)


def mindlin(graph, term=1.0):
    return HertzMindlin(young(graph), POISSON, MU, shear_history="displacement")


def anew(graph, term=1.0, kind=Spheres):
    ratio = float(hertz(graph).stiffness_ratio)
    return kind(modulus=young(graph) / (1 - POISSON**2), ratio=ratio, mu=MU)


def anew_mindlin(graph, term=1.0):
    return anew(graph, kind=ByDisplacement)


def glue(graph, term=1.0):
    how = {"kt": KT, "mu": MU, "shear_increment": "radii"}
    return Glue(k=fitted(graph, PULL), pull=PULL, **how)


# Each law, and the one that it is without its own term.
LAWS = {
    attraction: linear, bonds: linear, rolling: linear, limited: linear, stiffening: linear,
    anew: hertz, anew_mindlin: mindlin, glue: attraction,
}  # fmt: skip


def in_cell(law):
    graph = jammed(12, 1)
    return Scene(graph, law(graph))


def in_box(law):
    graph, planes, force = jammed_in_box(12, 6, BRANCH)
    return Scene(graph, law(graph), between(planes, force, volume=16.0))


def hexagon(law):
    graph = regular_polygon(6, strain=0.02)
    return Scene(graph, law(graph))


def path(scene):
    stage = Stage(programmes.drained_biaxial(), "H11", 1e-5)
    return follow(scene, stage, closure="packing").P


def loop_path(law):
    stage = Stage(programmes.oedometric(), "H11", 0.021)
    return follow(hexagon(law), stage, closure="traction").P[-1]


def material(law):
    scene = hexagon(law)
    point = LoopMaterial(oriented(scene.graph, 3), None, scene.law, closure="affine")
    return point.update(np.diag([0.999, 1.0005])[None], point.start(1)).stress


def tangents(law):
    scene = hexagon(law)
    how = (scene.graph, scene.law)
    return [affine_tangent(*how).matrix, traction_tangent(*how).matrix]


def moved(scene):
    return replay(scene, 1e-5 * np.diag([1.0, -0.5]), inertial_number=1e-4).state.stress


def in_place(scene):
    return loops_in_place(scene, scene.faces).matrix


def loop_table(law):
    scene = in_cell(law)
    regime, ids = np.ones(scene.graph.contact_count, dtype=np.int8), np.arange(12)
    snapshot = Snapshot(scene.graph, scene.law, regime, ids, 0, ())
    return gl.loop_table(snapshot)["traction_lambda_min"]


TOOLS = {
    "loop table": loop_table,
    "loops in their packing": lambda law: in_place(in_cell(law)),
    "tangents": tangents,
    "path of a loop": loop_path,
    "material": material,
    "path in a cell": lambda law: path(in_cell(law)),
    "path between walls": lambda law: path(in_box(law)),
    "probe": lambda law: gl.probe(in_cell(law), 4).elastic_stress,
    "hold": lambda law: hold(in_cell(law)).stress,
    "hold between walls": lambda law: hold(in_box(law)).stress,
    "replay": lambda law: moved(in_cell(law)),
    "replay between walls": lambda law: moved(in_box(law)),
    "sustain": lambda law: gl.sustain(in_cell(law), 2, largest=2e-4, spread=False).paths[0].H[-1],
}
# What no tool can do for a law, and why.
REFUSED = {
    ("material", bonds): "bonds, which break for good",
    ("material", anew_mindlin): "a stiffness between normal and shear",
    ("path of a loop", limited): "a finite mu_r",
}
SLOW = ("sustain",)


def numbers(tool, law):
    return np.asarray(TOOLS[tool](law), dtype=float)


@cache
def known(tool, law):
    return numbers(tool, law)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
@pytest.mark.parametrize(
    "tool", [pytest.param(tool, marks=[pytest.mark.slow] * (tool in SLOW)) for tool in TOOLS]
)
def test_a_tool_takes_a_law_which_without_its_term_is_the_known_one(tool, law):
    if (tool, law) in REFUSED:
        with pytest.raises(InputError, match=REFUSED[tool, law]):
            TOOLS[tool](law)
        return
    # The whole law is taken, and answered as far as the known one.
    wanted, whole = known(tool, LAWS[law]), numbers(tool, law)
    assert np.isfinite(whole).sum() == np.isfinite(wanted).sum() > 0
    none = numbers(tool, lambda graph: law(graph, term=0.0))
    size = np.nanmax(np.abs(wanted))
    np.testing.assert_allclose(none, wanted, rtol=1e-6, atol=1e-7 * size)


# Tools that see each law's own term in these states: what else is equal to the known law is so by
# the state (a spring against rolling in a hexagon whose grains don't turn, a bond that holds).
ACTS = {
    attraction: {"path in a cell", "path between walls", "replay"},
    rolling: {"path in a cell", "loops in their packing", "probe", "replay"},
    limited: {"path in a cell", "replay"},
    stiffening: {"tangents", "path of a loop", "material", "path in a cell", "probe", "replay"},
}


@pytest.mark.parametrize(
    ("law", "tool"), [(law, tool) for law, tools in ACTS.items() for tool in sorted(tools)],
    ids=lambda one: one if isinstance(one, str) else one.__name__,
)  # fmt: skip
def test_a_tool_sees_the_term_of_a_law(law, tool):
    wanted, whole = known(tool, LAWS[law]), numbers(tool, law)
    assert np.nanmax(np.abs(whole - wanted)) > 1e-6 * np.nanmax(np.abs(wanted))


@pytest.mark.parametrize("sample", [1.0, 1.5], ids=["linear", "Hertzian"])
@pytest.mark.parametrize("law", [*LAWS, linear, hertz, mindlin], ids=lambda law: law.__name__)
def test_forces_of_walls_start_as_they_are_given(law, sample):
    """Of a Hertzian sample the stiffness of a wall is a tangent, 3/2 of force over overlap."""
    graph, planes, force = jammed_in_box(16, 6, BRANCH, ROUGH)
    boundary = between(replace(planes, kn=sample * planes.kn), force, volume=16.0)
    scene = Scene(graph, law(graph), boundary)
    stage, still = Stage(programmes.drained_biaxial(), "H11", 1e-9), np.zeros((2, 2))
    first = follow(scene, stage, closure="packing").states[0]
    held = hold(scene, unbalanced=1e-6)
    starts = [first, replay(scene, still, duration=1e-9, time_step=1e-9).state]
    forces = [-start.forces[start.at_wall & start.closed] for start in starts]
    for given in (*forces, held.boundary.walls.force):
        np.testing.assert_allclose(given, force, rtol=0, atol=1e-6 * np.abs(force).max())
    # At rest as given: nothing moves. Rates have the stress of the forces that they are given.
    np.testing.assert_allclose(held.stress, held.stress_before, rtol=0, atol=1e-9)
    total = contact_forces(graph).T @ graph.branches - force.T @ planes.to_plates(graph.x)
    system = gl.rates_at(scene, H=np.diag([1.0, -1.0])).system
    np.testing.assert_allclose(packing_stress(system), total / 16.0, rtol=0, atol=1e-12)


def rolling_hertz(graph, term=1.0):
    return RollingResistance(hertz(graph), ROLLING)


@pytest.mark.parametrize(
    "law", [*LAWS, linear, hertz, mindlin, rolling_hertz], ids=lambda law: law.__name__
)
def test_walls_without_a_stiffness_have_the_tangent_of_the_law(law):
    """The force over the overlap times the power of the overlap that it goes with."""
    graph, planes, force = jammed_in_box(16, 6, BRANCH, ROUGH)
    found, _ = wall_plates(graph, WallContacts(planes.grain, force, -planes.branch), law(graph))
    overlap = graph.radii[planes.grain] - np.linalg.norm(planes.branch, axis=1)
    power = 1.5 if law in (anew, anew_mindlin, hertz, mindlin, rolling_hertz) else 1.0
    if law is stiffening:
        power = (1.0 + 2.0 * BEND * overlap) / (1.0 + BEND * overlap)
    np.testing.assert_allclose(found.kn, power * planes.kn, rtol=1e-8)
