"""Paths of packings against paths of loops, where both have the same solution.

A grain that is a centre of symmetry stays where the cell takes it: lattices of such grains are
affine with free spins, whatever the strain. In a honeycomb the forces follow from the stress, as
they do in a hexagon under uniform traction.
"""

from functools import partial

import numpy as np
import pytest

from loops import (
    GrainGraph,
    HertzMindlin,
    LinearFrictional,
    PlaneContacts,
    Regime,
    Scene,
    contact_state,
)
from stability import Stage, follow
from tests.oracles.lattices import lattice
from tests.packings import strained, touching_lattice
from tests.stability.packing.walled_packings import between

followed = partial(follow, closure="packing")
LENGTH, ROOT = 0.99, np.sqrt(3)
TURN = np.array([[np.cos(0.2), -np.sin(0.2)], [np.sin(0.2), np.cos(0.2)]])
STRAIN = np.array([[8e-3, 3e-3], [1e-3, -4e-3]])
INTERVALS = (2e-4, 1e-4, 5e-5)
TRIANGLES = touching_lattice(
    TURN @ [[1, 0.5], [0, ROOT / 2]], [(1, 0), (0, 1), (-1, 1)], cells=(1, 1)
)


def honeycomb_and_kagome():
    """Two grains a cell and three."""
    comb = {"contacts": [(0, 1)] * 3, "images": [(0, 0), (0, -1), (1, -1)]}
    kagome = {
        "contacts": [(0, 1), (1, 0), (0, 2), (2, 0), (1, 2), (1, 2)],
        "images": [(0, 0), (1, 0), (0, 0), (0, 1), (0, 0), (1, -1)],
    }
    upright = LENGTH * np.array([[ROOT, ROOT / 2], [0, 1.5]])
    turned = 2 * LENGTH * TURN @ [[1, 0.5], [0, ROOT / 2]]
    for cell, sites, pattern in (
        (upright, [[0, 0], [-1 / 3, 2 / 3]], comb),
        (turned, [[0, 0], [0.5, 0], [0, 0.5]], kagome),
    ):
        yield GrainGraph(
            x=np.array(sites) @ cell.T,
            radii=[0.5] * len(sites),
            cell=cell,
            normal_force=[0.01] * len(pattern["contacts"]),
            **pattern,
        )


COMB, KAGOME = honeycomb_and_kagome()


def in_order(path):
    """Events sorted by place, then kind and contact; and their places."""
    rows = [
        (round(event.parameter, 3), event.kind, contact, event.parameter)
        for event in path.events
        if event.kind != "programme_change"
        for contact in event.contacts
    ]
    return [row[1:3] for row in sorted(rows)], np.array([row[3] for row in sorted(rows)])


@pytest.mark.parametrize("increment", ["branch", "radii"])
def test_triangles_event_by_event(increment):
    """Loading, unloading until a contact opens, and loading again."""
    law = LinearFrictional(1.0, 0.5, 0.2, increment)
    stages = [strained(factor * STRAIN) for factor in (1.0, -3.2, 2.0)]
    whole = follow(Scene(TRIANGLES, law), stages, closure="affine", spins="free")
    told, places = in_order(whole)
    assert {kind for kind, _ in told} == {"yield", "unloading", "opening", "closing"}
    assert len(told) == 13
    error = []
    for interval in 4 * np.array(INTERVALS):
        path = followed(Scene(TRIANGLES, law), stages, interval=interval)
        found, at = in_order(path)
        assert path.status == "finished" and found == told
        np.testing.assert_allclose(path.P[-1], whole.P[-1], rtol=0, atol=1e-5 * whole.P[-1, 0])
        error.append(np.abs(at - places).sum())
    np.testing.assert_allclose(np.divide(error[:-1], error[1:]), 2.0, rtol=0.1)
    assert error[0] < 1e-3


def test_a_honeycomb_is_a_hexagon_under_traction():
    """Up to yield of both inclined contacts, four of the loop; the stress is half of its."""
    law, strain = LinearFrictional(1.0, 0.5, 0.1), np.diag([8e-3, -4e-3])
    angles = np.radians(90 + 60 * np.arange(6))
    ring = LENGTH * np.column_stack([np.cos(angles), np.sin(angles)])
    sides = [(k, (k + 1) % 6) for k in range(6)]
    hexagon = GrainGraph(x=ring, radii=[0.5] * 6, contacts=sides, normal_force=[0.01] * 6)
    loop = partial(follow, Scene(hexagon, law), closure="traction", spins="blocked")
    (first, *_) = loop(strained(strain)).of_kind("yield")
    assert len(first.contacts) == 4
    part = strained(0.9 * first.parameter * strain)
    wanted, error, place = loop(part).P[-1] / 2, [], []
    for interval in INTERVALS:
        path = followed(Scene(COMB, law), part, interval=interval)
        assert path.status == "finished" and path.events == ()
        error.append(np.abs(path.P[-1] - wanted).max() / np.abs(wanted).max())
        events = followed(
            Scene(COMB, law), strained(strain), interval=interval, instabilities=1
        ).events
        place.append(abs(events[0].parameter - first.parameter))
    np.testing.assert_allclose(np.divide(error[:-1], error[1:]), 2.0, rtol=0.1)
    np.testing.assert_allclose(np.divide(place[:-1], place[1:]), 2.0, rtol=0.1)
    assert error[0] < 2e-5 and place[0] < 2e-4


@pytest.mark.parametrize(("mu", "mirror"), [(0.1, 1), (0.1, -1), (0.5, -1), (np.inf, 1)])
def test_a_contact_that_closes_sticks_or_slides_at_once(mu, mirror):
    """Opposite grains of a rhombus touch along their short diagonal."""
    angle = 2 * np.arcsin(0.5 * 1.001 / LENGTH)
    vectors = LENGTH * np.array([[mirror, mirror * np.cos(angle)], [0, np.sin(angle)]])
    steps = [(1, 0), (0, 1), (-1, 1)]
    graph = lattice(vectors, steps, [0.01, 0.01, 0.0], np.zeros(3), cells=(1, 1))
    graph = graph.replace(radii=[0.5], regime=[Regime.ELASTIC, Regime.ELASTIC, Regime.OPEN])
    n = vectors @ steps[2] / 1.001
    strain = 2.5e-3 * np.outer(n, n) + 1.5e-3 * mirror * np.outer([-n[1], n[0]], n)
    law = LinearFrictional(1.0, 0.5, mu)
    whole = follow(Scene(graph, law), strained(strain), closure="affine", spins="free")
    error = []
    for interval in INTERVALS[:2]:
        path = followed(Scene(graph, law), strained(strain), interval=interval)
        (event,) = path.events
        assert (event.kind, event.contacts) == ("closing", (2,))
        assert event.parameter == pytest.approx(whole.events[0].parameter, rel=1e-5)
        last = path.states[-1]
        ratio = last.shear_force[2] / last.normal_force[2]
        assert ratio * mirror == pytest.approx(min(mu, 0.1483), rel=1e-3)
        error.append(np.abs(path.P[-1] - whole.P[-1]).max() / whole.P[-1, 0])
    assert error[0] < 4e-6 and error[0] / error[1] == pytest.approx(2.0, rel=0.2)


def between_walls(law, stage, interval):
    """A diamond between four smooth walls that balance it, and its path."""
    half = LENGTH * np.array([np.cos(np.radians(35)), np.sin(np.radians(35))])
    way = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
    graph = GrainGraph(way * half, [0.5] * 4, contacts=[[0, 1], [1, 2], [2, 3], [3, 0]])
    graph = graph.replace(normal_force=law.normal_force(contact_state(graph)))
    push = 2.0 * graph.normal_force * np.abs(way @ half) / LENGTH
    power = 1.5 if isinstance(law, HertzMindlin) else 1.0
    overlap = push ** (1.0 / power)
    kn = power * push / overlap
    planes = PlaneContacts(np.arange(4), (0.5 - overlap)[:, None] * way, kn, np.zeros(4))
    scene = Scene(graph, law, between(planes, -push[:, None] * way))
    return graph, followed(scene, stage, interval=interval)


@pytest.mark.parametrize(
    ("law", "target"),
    [(LinearFrictional(1.0, 0.5, 0.1), 6e-3), (HertzMindlin(1.0, 0.2, 0.2), 6e-3)],
    ids=["linear", "hertz"],
)
def test_a_lattice_between_walls_follows_the_path_of_the_loop(law, target):
    """Walls at four grains are uniform traction; forces and strain of the centres, past yield."""
    errors = []
    for interval in INTERVALS[1:]:
        stage = Stage("drained_biaxial", "H11", target)
        graph, path = between_walls(law, stage, interval)
        end = path.states[-1]
        # Free spins may let one contact slip for all four.
        assert path.status == "finished" and 1 <= len(path.of_kind("yield")) <= 4
        spans = [x[[0, 1], [0, 1]] - x[[2, 3], [0, 1]] for x in (graph.x, end.x)]
        strain = 1.0 - spans[1] / spans[0]
        drained = Stage("drained_biaxial", "H11", strain[0])
        loop = follow(Scene(graph, law), drained, closure="traction", spins="blocked")
        (event,) = loop.of_kind("yield")
        assert loop.status == "finished" and len(event.contacts) == 4
        N, T = loop.normal_force[-1], loop.shear_force[-1]
        errors.append([
            np.abs(end.normal_force[:4] / N - 1.0).max(),
            np.abs(end.shear_force[:4] / T - 1.0).max(),
            abs(strain[1] / loop.H[-1][3] - 1.0),
        ])  # fmt: skip
    # Forces follow from those of the walls, so errors fall with the interval squared.
    assert np.max(errors[0]) < 5e-6 and np.min(np.divide(*errors)) > 3.5
