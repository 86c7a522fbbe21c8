"""States of a packing: jumps of stress and centres in a short strain."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from loops import GrainGraph, PlaneContacts
from loops.laws.of_pairs import as_known
from stability.packing.point import PackingPoint
from tests.packings import jammed, start_state
from tests.stability.packing.walled_packings import between

STATE = start_state(jammed(16, 2))
SIZE = float(np.linalg.norm(STATE.stress))


def jump(before, after, first_stress):
    """The jump from a point with this state, on a path with this stress at its start."""
    return PackingPoint.jump_to(SimpleNamespace(state=before, first_stress=first_stress), after)


def scaled(factor):
    return replace(
        STATE, normal_force=factor * STATE.normal_force, shear_force=factor * STATE.shear_force
    )


@pytest.mark.parametrize(
    ("before", "after", "start", "found"),
    [
        (1.0, 1.45, 0.0, ""),
        (1.0, 1.55, 0.0, "the stress jumped by 0.55 of what it was"),
        (1.0, 0.45, 0.0, "the stress jumped by 0.55 of what it was"),
        (0.01, 0.02, 0.0, "the stress jumped by 1 of what it was"),
        (0.01, 0.02, 1.0, ""),
        (1.0, 1.55, 0.1, "the stress jumped by 0.55 of what it was"),
    ],
)
def test_half_of_the_stress_is_too_much(before, after, start, found):
    """Measured by the larger of the stresses before and at the start of the path."""
    assert jump(scaled(before), scaled(after), start * SIZE) == found


@pytest.mark.parametrize(("contacts", "lost"), [(0, False), (1, False), (2, True)])
def test_a_carrying_grain_moves_less_than_a_fiftieth_of_a_diameter(contacts, lost):
    """Measured beyond the affine motion; grains with fewer than two contacts may move more."""
    touches = (STATE.contacts == 3).any(axis=1)
    keeps = ~touches | (np.cumsum(touches) <= contacts)
    forces = {"normal_force": keeps * 1.0, "shear_force": 0.0 * STATE.shear_force}
    before = replace(STATE, closed=keeps, **forces)
    F = np.array([[0.9, 0.2], [0.1, 1.1]])
    step = 2.0 * STATE.radii.mean() * np.array([0.0, 1.0]) * (np.arange(16)[:, None] == 3)
    for share, leaps in ((0.0, False), (0.019, False), (-0.021, True)):
        after = replace(before, x=before.x @ F.T + share * step, cell=F @ before.cell)
        wanted = "a grain leapt by 0.021 diameters" if leaps and lost else ""
        assert jump(before, after, 1e9) == wanted


def walled(shift=0.0, angle=0.3):
    """Three discs on a tilted floor, the last against another one at right angles."""
    c, s = np.cos(angle), np.sin(angle)
    turn, radii = np.array([[c, -s], [s, c]]), np.array([0.5, 0.4, 0.6])
    overlap = np.array([0.01, 0.02, 0.03, 0.04])
    grain, away = np.array([0, 1, 2, 2]), np.array([[0, -1], [0, -1], [0, -1], [1, 0]]) @ turn.T
    places = np.column_stack([[0.0, 1.5, 3.0], radii - overlap[:3]])
    graph = GrainGraph(x=shift + places @ turn.T, radii=radii, contacts=np.zeros((0, 2), int))
    branch = (radii[grain] - overlap)[:, None] * away
    return graph, PlaneContacts(grain, branch, np.array([1.0, 2.0, 3.0, 4.0]), np.ones(4)), overlap


@pytest.mark.parametrize("shift", [0.0, 1e9])
def test_contacts_with_walls_join_grains_to_planes(shift):
    """Two walls, near or far from the origin, where their places are known to 1e-7 alone."""
    graph, planes, overlap = walled(shift)
    made = start_state(graph, between(planes, volume=2.0), still=True)
    assert len(made.walls) == 2 and made.count == 3
    own = made.contacts
    assert own[:, 0].tolist() == [0, 1, 2, 2] and own[0, 1] == own[1, 1] == own[2, 1] != own[3, 1]
    np.testing.assert_allclose(made.normal_force, planes.kn * overlap, rtol=1e-9)
    np.testing.assert_allclose(made.shear_force, 0.0, atol=1e-12)
    for c in range(4):
        n = made.walls[own[c, 1] - 3]
        length = np.hypot(*planes.branch[c])
        np.testing.assert_allclose(n, -planes.branch[c] / length, atol=1e-12)
        # The place of a wall is a point of it: as far from the grain as the branch is long.
        away = n @ (graph.x[planes.grain[c]] - made.x[own[c, 1]])
        assert away == pytest.approx(length, abs=1e-12 + 1e-15 * shift)


def test_given_forces_of_walls_are_resolved_along_and_across():
    graph, planes, _ = walled()
    force = np.random.default_rng(1).normal(size=(4, 2))
    made = start_state(graph, between(planes, force, volume=2.0), still=True)
    for c in range(4):
        n = -planes.branch[c] / np.hypot(*planes.branch[c])
        assert made.normal_force[c] == pytest.approx(force[c] @ n)
        assert made.shear_force[c] == pytest.approx(n[0] * force[c, 1] - n[1] * force[c, 0])


@pytest.mark.parametrize("gap", [0.3e-6, 3e-6])
def test_planes_closer_than_a_millionth_of_the_sample_are_one_wall(gap):
    """Relative to the reach of the sample: its largest coordinate and radius, 3.5."""
    x = [[0.0, 0.0], [3.0, 3.5 * gap]]
    graph = GrainGraph(x=x, radii=[0.5, 0.5], contacts=np.zeros((0, 2), int))
    planes = PlaneContacts(np.array([0, 1]), np.full((2, 2), [0.0, -0.49]), np.ones(2), np.ones(2))
    assert len(start_state(graph, between(planes, volume=2.0), still=True).walls) == (
        1 if gap < 1e-6 else 2
    )


@pytest.mark.parametrize("length", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("stiffness", [1e-3, 1.0, 1e3])
def test_stiffness_of_new_contacts_grows_with_the_radii_where_that_varies_less(length, stiffness):
    """In any units: nearly proportional values, nearly constant ones."""
    radii, others = length * np.array([1.0, 2.0, 3.0]), length * np.array([1.5, 6.0])
    slope = stiffness * np.array([1.0, 1.02, 0.98])
    found = as_known(slope * radii, radii, others)
    np.testing.assert_allclose(found, stiffness * others, rtol=1e-12)
    found = as_known(slope, radii, others)
    np.testing.assert_allclose(found, stiffness, rtol=1e-12)
    assert np.all(as_known(np.full(3, np.inf), radii, others) == np.inf)
