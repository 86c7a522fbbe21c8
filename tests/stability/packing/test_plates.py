"""Plates of an apparatus in the rate problem: rigid, with springs and Coulomb's limit."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from loops import GrainGraph, LinearFrictional, PlaneContacts, Scene
from stability import Stage, follow, programmes, rates_at
from tests.stability.packing.walled_packings import JAMMED, between, jammed_in_box, some_of

ROUGH = [which for which in JAMMED if which[3][1] > 0]
STRAINS = [np.diag([1.0, 0.0]), np.diag([-0.7, 1.0]), np.array([[0.2, 0.5], [-0.3, 0.1]])]


def box(graph, planes):
    feet = graph.x[planes.grain] + planes.branch
    return feet.min(axis=0), feet.max(axis=0)


def response(graph, law, planes, H, volume=None, **how):
    low, high = box(graph, planes)
    boundary = between(planes, volume=volume or float(np.prod(high - low)))
    return rates_at(Scene(graph, law, boundary), H=H, **how)


# One disc between four plates, off the middle; left and right ones are smooth.
RADIUS, SIDES, MU = 0.5, np.array([0.98, 0.96]), 0.3
KN, KT, OVERLAP = 3.0, 1.2, 0.02


def one_grain(T, mu=MU):
    """The disc, its plates (left, right, below, above), shear forces `T` on it of the last two."""
    graph = GrainGraph(x=[[0.49, 0.48]], radii=[RADIUS], contacts=np.empty((0, 2), dtype=int))
    branch = np.array([[-0.49, 0.0], [0.49, 0.0], [0.0, -0.48], [0.0, 0.48]])
    overlap = RADIUS - np.linalg.norm(branch, axis=1)
    force = -2.0 * overlap[:, None] * branch / np.linalg.norm(branch, axis=1, keepdims=True)
    force[2:] *= KN / 2.0
    force[2, 0], force[3, 0] = T
    planes = PlaneContacts(
        np.zeros(4, dtype=int), branch, np.array([2.0, 2.0, KN, KN]), np.array([0, 0, KT, KT]),
        np.array([0.0, 0.0, mu, mu]), force,
    )  # fmt: skip
    return graph, planes


def by_hand(H, T, slides):
    """Velocity, spin and rates of N of the lower and upper plate, with the given ones sliding.

    The left and the lower plate stand still.
    """
    right, above = -H[0] * SIDES[0], -H[1] * SIDES[1]
    arm = 0.5 * (0.48 + RADIUS)
    # Below, the disc's edge goes by v + arm w along the plate, above by v - arm w.
    normal_below, normal_above = np.array([[-KN, 0.0], [KN, -KN * above]])
    side = np.sign(T)
    rows, right_side = np.zeros((3, 3)), np.zeros(3)
    rows[0, 0], right_side[0] = -4.0, 2.0 * -right
    rows[1, 1], right_side[1] = normal_below[0] - normal_above[0], normal_above[1]
    shear = []
    for k, (turn, normal) in enumerate(((1.0, normal_below), (-1.0, normal_above))):
        if slides[k]:
            line = np.array([0.0, side[k] * MU * normal[0], 0.0, side[k] * MU * normal[1]])
        else:
            line = np.array([-KT, 0.0, -KT * turn * arm, 0.0])
        shear.append(line)
        rows[0] += line[:3]
        rows[2] += turn * arm * line[:3]
        right_side[0] -= line[3]
        right_side[2] -= turn * arm * line[3]
    # The arms grow with the distance to the plates.
    rows[2, 1] += 0.5 * (T[0] + T[1])
    right_side[2] += 0.5 * T[1] * above
    v, u, w = np.linalg.solve(rows, right_side)
    normals = [normal_below[0] * u, normal_above[0] * u + normal_above[1]]
    return v, u, w, normals


# Both at their strength would leave nothing that resists the spin.
@pytest.mark.parametrize("T", [(0.4, -0.3), (1.0, 0.3), (-1.0, 0.4), (0.2, 1.0), (-0.4, -1.0)])
@pytest.mark.parametrize("H", [(1.0, 0.0), (-1.0, 0.3), (0.2, -1.0), (0.0, 1.0)])
def test_one_grain_between_plates_by_hand(H, T):
    limit = MU * KN * OVERLAP
    T = limit * np.array(T)
    graph, planes = one_grain(T)
    at_yield = np.abs(T) >= 0.999 * limit
    found = response(graph, LinearFrictional(1.0, 0.5), planes, np.diag(H))
    agree = []
    for slides in product(*((False, True) if one else (False,) for one in at_yield)):
        v, u, w, normals = by_hand(H, T, slides)
        arm = 0.5 * (0.48 + RADIUS)
        ok = True
        for k, turn in enumerate((1.0, -1.0)):
            stuck, edge = -KT * (v + turn * arm * w), np.sign(T[k]) * MU * normals[k]
            leaves = np.sign(T[k]) * (stuck - edge)
            ok &= (leaves >= -1e-12) if slides[k] else (not at_yield[k] or leaves <= 1e-12)
        if ok:
            agree.append((v, u, w))
    assert found.status == "unique" and len(agree) == found.solutions == 1
    v, u, w = agree[0]
    # The disc's own motion is told beyond the mean one, about the lower left corner.
    moved = found.motion[0] - np.array(H) * graph.x[0]
    assert np.allclose([*moved, found.spin[0]], [v, u, w], rtol=0, atol=1e-12)


@pytest.mark.parametrize("which", ROUGH)
@pytest.mark.parametrize("k", [0, 1])
def test_rates_are_those_of_the_first_step_of_a_path(which, k):
    graph, planes, force = jammed_in_box(*which)
    programme = programmes.oedometric() if k == 0 else programmes.drained_biaxial()
    stage = Stage(programme, "H11", 1e-8)
    path = follow(
        Scene(graph, which[2], between(planes, force)), stage, closure="packing", past="stop"
    )
    assert path.status == "finished"
    driven = [[1.0, 0.0], [0.0, 0.0 if k == 0 else np.nan]]
    first = path.states[0]
    count = graph.contact_count
    start = graph.replace(normal_force=first.normal_force[:count])
    planes = replace(planes, force=-first.forces[count:][: len(planes.grain)])
    found = response(start, which[2], planes, driven, yield_band=1 - 1e-6)
    rate = (path.P[-1] - path.P[0]) / 1e-8
    # Paths keep grains of two contacts on springs of 1e-4 kn.
    assert np.allclose(found.stress_rate.ravel()[[0, 3]], rate.ravel()[[0, 3]], rtol=0, atol=2e-4)


@pytest.mark.parametrize("which", ROUGH)
def test_a_plate_does_not_stretch(which):
    """Feet of a plate move as one: the slip of the stretch is in no contact."""
    graph, planes, _ = jammed_in_box(*which)
    low, high = box(graph, planes)
    for fixed in (None, high, 0.3 * low + 0.7 * high):
        to = replace(planes, fixed=low if fixed is None else fixed).to_plates(graph.x)
        points = graph.x[planes.grain] + to
        n = -planes.branch / np.linalg.norm(planes.branch, axis=1, keepdims=True)
        for normal in ([1, 0], [-1, 0], [0, 1], [0, -1]):
            own = points[n @ normal > 0.99]
            assert len(own) and np.ptp(own, axis=0).max() < 1e-12


@pytest.mark.parametrize("which", ROUGH)
@pytest.mark.parametrize("H", STRAINS[:2])
def test_the_plate_that_moves_is_the_mirror_image(which, H):
    """A sample seen in a mirror, with the fixed point there too, answers as in the mirror."""
    graph, planes, force = jammed_in_box(*which)
    planes = replace(planes, force=force)
    low, high = box(graph, planes)
    right_still = replace(planes, fixed=np.array([high[0], low[1]]))
    flip = np.diag([-1.0, 1.0])
    mirrored = replace(planes, branch=planes.branch @ flip, force=force @ flip)
    image = graph.replace(x=graph.x @ flip, shear_force=-graph.shear_force)
    one, two, other = (
        response(*state, H)
        for state in (
            (graph, which[2], right_still), (image, which[2], mirrored),
            (graph, which[2], planes),
        )
    )  # fmt: skip
    assert one.status == two.status
    size = np.abs(one.stress_rate).max()
    assert np.allclose(one.stress_rate, flip @ two.stress_rate @ flip, rtol=0, atol=1e-9 * size)
    assert np.abs(one.stress_rate - other.stress_rate).max() > 1e-4 * size


@pytest.mark.parametrize("which", ROUGH)
@pytest.mark.parametrize("H", STRAINS)
def test_frame_numbers_and_units_change_nothing(which, H):
    graph, planes, force = jammed_in_box(*which)
    low, _ = box(graph, planes)
    planes = replace(planes, force=force, fixed=low)
    first = response(graph, which[2], planes, H)
    R = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    rng = np.random.default_rng(0)
    order = rng.permutation(graph.grain_count)
    back = np.argsort(order)
    rows, feet = rng.permutation(graph.contact_count), rng.permutation(len(planes.grain))
    length, unit = 3.0, 0.02
    law = LinearFrictional(unit * 1.0, unit * 0.5, which[2].mu, which[2].shear_increment)
    turned = GrainGraph(
        x=length * (graph.x @ R.T)[order] + 7.0, radii=length * graph.radii[order],
        contacts=back[graph.contacts[rows]],
        normal_force=unit * length * graph.normal_force[rows],
        shear_force=unit * length * graph.shear_force[rows],
    )  # fmt: skip
    plates = some_of(PlaneContacts(
        back[planes.grain], length * planes.branch @ R.T, unit * planes.kn, unit * planes.kt,
        planes.mu, unit * length * force @ R.T, None, length * R @ low + 7.0,
    ), feet)  # fmt: skip
    volume = first.system.volume * length**2
    found = response(turned, law, plates, R @ H @ R.T, volume=volume)
    size = unit * np.abs(first.stress_rate).max()
    assert found.status == first.status and found.sliding == first.sliding
    back_again = R.T @ found.stress_rate @ R
    assert np.allclose(back_again, unit * first.stress_rate, rtol=0, atol=1e-8 * size)
