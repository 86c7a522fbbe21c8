"""Paths and replays between walls: mirror images, slow motion, halving, energy, forces on walls."""

import functools

import numpy as np
import pytest

from grainloops import hold, replay
from loops import (
    GrainGraph,
    HertzMindlin,
    InputError,
    LinearFrictional,
    PlaneContacts,
    Scene,
    contact_state,
)
from stability import Programme, Stage, follow, programmes, rates_at
from tests.packings import LAW, jammed, strained
from tests.stability.packing.walled_packings import (
    JAMMED,
    SMOOTH,
    between,
    jammed_in_box,
    mirrored,
    some_of,
)

SMOOTH_ONES = [which for which in JAMMED if which[3] == SMOOTH]
DRAINED = Stage(programmes.drained_biaxial(), "H11", 2e-3)


def walked(which, stage=DRAINED, interval=1e-5, **options):
    graph, planes, force = jammed_in_box(*which)
    scene, how = Scene(graph, which[2], between(planes, force)), {"past": "stop"} | options
    return follow(scene, stage, closure="packing", interval=interval, **how)


@functools.cache
def drained(which, interval=1e-5):
    return walked(which, interval=interval)


def box_of(state):
    """((left, right), (low, high)) from the feet of a state's contacts with walls."""
    rows = state.contacts[:, 1] >= state.count
    feet, branch = state.x[state.contacts[rows, 0]] + state.branches[rows], state.branches[rows]
    sides = []
    for axis in range(2):
        own = np.abs(branch[:, axis]) > 0.1
        sides.append((feet[own, axis].min(), feet[own, axis].max()))
    return sides


@pytest.mark.parametrize("which", SMOOTH_ONES)
def test_a_walled_packing_goes_as_one_with_its_mirror_images(which):
    # A smooth wall is a plane of symmetry: the grain and its image press on each other through
    # two springs in a row, each as stiff as the wall.
    graph, planes, force = jammed_in_box(*which)
    image = mirrored(graph, planes, force, box_of(drained(which).states[0]))
    law = which[2]
    whole = LinearFrictional(
        np.where(np.arange(image.contact_count) < 4 * graph.contact_count, 1.0, SMOOTH[0] / 2),
        law.kt, law.mu, law.shear_increment,
    )  # fmt: skip
    # Of two solutions the images may take one that isn't symmetric, once several contacts slide.
    stage = strained((2e-4 if which[0] < 36 else 1e-6) * np.diag([1.0, -0.85]))
    one = walked(which, stage, interval=1e-6)
    other = follow(Scene(image, whole), stage, closure="packing", interval=1e-6, past="stop")
    assert one.status == other.status == "finished"
    starts = [path.states[0].stress for path in (one, other)]
    np.testing.assert_allclose(*starts, rtol=1e-12, atol=1e-15)
    assert len(other.events) == 4 * len(one.events)
    # Ground springs are shares of the mean stiffness, which differs; they fade with the interval.
    np.testing.assert_allclose(one.P[-1], other.P[-1], rtol=1e-6, atol=1e-9)
    assert one.energy[-1] == pytest.approx(other.energy[-1] / 4, rel=1e-7)
    walls = {"boundary": between(planes, force)}
    ends = [
        replay(
            Scene(packing, own, **there), np.diag([1e-4, 0]), time_step=0.1
        ).state.stress.diagonal()
        for packing, own, there in ((graph, law, walls), (image, whole, {}))
    ]
    # Loose grains and their images soon move differently.
    np.testing.assert_allclose(*ends, rtol=3e-6)


@pytest.mark.parametrize("which", JAMMED)
def test_strain_and_stress_are_those_of_the_walls(which):
    path = drained(which)
    end = path.states[-1]
    first, last = box_of(path.states[0]), box_of(end)
    sides = np.array([np.ptp(side) for side in first]), np.array([np.ptp(side) for side in last])
    np.testing.assert_allclose(path.H[-1][[0, 3]], 1 - sides[1] / sides[0], rtol=0, atol=1e-12)
    # The lower left corner stays where the affine motion takes it; only the right wall carries P11.
    rows = end.contacts[:, 1] >= end.count
    branch, onto = end.branches[rows], end.forces[rows]
    right, top = branch[:, 0] > 0.1, branch[:, 1] > 0.1
    nominal = onto[right, 0].sum() / sides[0][1], onto[top, 1].sum() / sides[0][0]
    np.testing.assert_allclose(path.P[-1][[0, 3]], nominal, rtol=1e-5)
    if which[3] == SMOOTH:
        love_weber = end.forces.T @ end.branches / np.prod(sides[1])
        np.testing.assert_allclose(np.diag(end.stress), np.diag(love_weber), rtol=1e-12)


@pytest.mark.parametrize("which", SMOOTH_ONES)
def test_the_first_increment_is_that_of_the_rate_problem(which):
    graph, planes, _ = jammed_in_box(*which)
    area = abs(np.linalg.det(drained(which).states[0].cell))
    H = np.array([[1.0, 0.0], [0.0, -0.4]])
    rates = rates_at(Scene(graph, which[2], between(planes, volume=area)), H=H, yield_band=1 - 1e-6)
    path = walked(which, strained(1e-8 * H), interval=1e-8)
    change = (path.P[-1] - path.P[0])[[0, 3]] / 1e-8
    # Ground springs of 1e-4 kn hold grains of two contacts.
    np.testing.assert_allclose(change, rates.stress_rate[[0, 1], [0, 1]], rtol=2e-3)


def test_a_column_between_walls_in_closed_form():
    # Two discs one above the other: three springs in a row, of 1 and twice 2.
    graph = GrainGraph(
        x=[[0.5, 0.49], [0.5, 1.47]], radii=[0.5] * 2, contacts=[[0, 1]], normal_force=[0.02]
    )
    grain = [0, 1, 0, 1, 0, 1]
    branch = [[0, -0.49], [0, 0.49], [-0.49, 0], [-0.49, 0], [0.49, 0], [0.49, 0]]
    kn = np.array([2.0, 2.0, 1.0, 1.0, 1.0, 1.0])
    planes = PlaneContacts(np.array(grain), np.array(branch), kn, np.zeros(6))
    law, height = LinearFrictional(1.0, 0.5, 0.5), 1.96
    stage = strained(np.diag([0.0, 1e-4]))
    path = follow(Scene(graph, law, between(planes)), stage, closure="packing")
    stiffness = 1.0 / (1.0 + 2 / 2.0)
    grown = stiffness * 1e-4 * height
    np.testing.assert_allclose(path.states[-1].normal_force[:3], [0.02 + grown] * 3, rtol=1e-12)
    assert path.P[-1][3] - path.P[0][3] == pytest.approx(grown / 0.98, rel=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"stage": strained([[0, 1e-5], [0, 0]])}, "H12 = H21 = 0 between walls"),
        ({"stage": Stage(Programme("free", np.diag([0, 1.0, 0, 0]), np.diag([1.0, 0, 1, 1]),
          [1, 0, 0, 0]), "parameter", 1e-5)}, "turn or shear the box"),
        ({"left_out": 0}, "one wall on each side"),
        ({"turned": 0.01}, "one wall on each side"),
        ({"boundary": None}, "no cell and no walls"),
    ],
)  # fmt: skip
def test_bad_input(change, message):
    which = SMOOTH_ONES[0]
    graph, planes, force = jammed_in_box(*which)
    if "left_out" in change:
        kept = planes.branch[:, 0] < 0.1
        planes, force = some_of(planes, kept), force[kept]
    if "turned" in change:
        c, s = np.cos(change["turned"]), np.sin(change["turned"])
        R = np.array([[c, -s], [s, c]])
        graph, force = graph.replace(x=graph.x @ R.T), force @ R.T
        planes = PlaneContacts(planes.grain, planes.branch @ R.T, planes.kn, planes.kt, planes.mu)
    boundary = change.get("boundary", between(planes, force))
    stage = change.get("stage", DRAINED)
    with pytest.raises(InputError, match=message):
        follow(Scene(graph, LAW, boundary), stage, closure="packing")
    with pytest.raises(InputError, match=message):
        given = stage if "stage" in change else np.diag([1e-5, 0])
        replay(Scene(graph, LAW, boundary), given)


def test_tangents_of_hertz_are_not_taken_for_springs():
    hertz = HertzMindlin(5.0, 0.2, 0.5)
    for graph, walls in ((jammed(16, 2), {}), (jammed_in_box(24, 1)[0], None)):
        if walls is None:
            _, planes, force = jammed_in_box(24, 1)
            walls = {"boundary": between(planes, force, volume=1.0)}
        graph = graph.replace(normal_force=hertz.normal_force(contact_state(graph)))
        kn, kt = hertz.stiffnesses(contact_state(graph))
        tangents = LinearFrictional(np.maximum(kn, 1e-9), kt, 0.5)
        with pytest.raises(InputError, match="2/3 of kn times the overlap"):
            follow(Scene(graph, tangents, **walls), DRAINED, closure="packing")
        with pytest.raises(InputError, match="2/3 of kn times the overlap"):
            replay(Scene(graph, tangents, **walls), np.diag([1e-6, 0]))
        with pytest.raises(InputError, match="2/3 of kn times the overlap"):
            hold(Scene(graph, tangents, **walls))
