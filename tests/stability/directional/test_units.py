"""Branches of the rate problem: lines that part the regimes, batches, and units of stiffness."""

import numpy as np
import pytest

from loops import LinearFrictional
from patterns import diamond, regular_polygon
from stability import directional_work
from stability.directional.branches import line_angles
from stability.directional.work import law_branches
from tests.oracles.diamond import TABLE_1
from tests.oracles.drained import drained_path

ANGLES = 2 * np.pi * (np.arange(53) + 0.3) / 53
CIRCLE = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=-1)


def at_yield(side, unit=1.0):
    """Graph, law and volume of the diamond with `T = side mu N`; forces and moduli in a unit."""
    B, a0 = drained_path(TABLE_1).end, TABLE_1.alpha0
    graph = diamond(a0, E1=B.E1, E2=B.E2, T=side * abs(B.T))
    graph = graph.replace(
        normal_force=unit * graph.normal_force, shear_force=unit * graph.shear_force
    )
    law = LinearFrictional(kn=unit, kt=unit * TABLE_1.kappa, mu=TABLE_1.mu)
    return graph, law, 2 * np.sin(2 * a0)


@pytest.mark.parametrize("closure", ["affine", "traction"])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_line_of_sliding_parts_the_plane(closure, side):
    graph, law, volume = at_yield(side)
    a0, alpha = TABLE_1.alpha0, drained_path(TABLE_1).end.alpha
    branches, edge = law_branches(graph, law, closure, "blocked", "diagonal", None, volume)
    assert edge.at_yield.all()
    turn = np.array([np.cos(a0) * np.sin(alpha), -np.sin(a0) * np.cos(alpha)])
    shorten = np.array([np.cos(a0) * np.cos(alpha), np.sin(a0) * np.sin(alpha)])
    line = side * TABLE_1.kappa * turn - TABLE_1.mu * shorten
    found = branches.critical_angles()
    for angle in line_angles(line[None]):
        assert np.abs(found - angle).min() < 1e-12


@pytest.mark.parametrize(("closure", "spins"), [("traction", "blocked"), ("affine", "free")])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_regimes_of_one_contact_change_at_critical_angles_alone(closure, spins, side):
    # A single contact at yield: no other one, mirrored, brings in its line.
    graph = regular_polygon(5, strain=0.2)
    law = LinearFrictional(kn=1.0, kt=0.3, mu=0.5)
    graph = graph.replace(shear_force=side * 0.5 * graph.normal_force * (np.arange(5) == 1))
    branches, edge = law_branches(graph, law, closure, spins, "diagonal", None, None)
    assert edge.at_yield.tolist() == [False, True, False, False, False]
    angle = 2 * np.pi * (np.arange(4001) + 0.5) / 4001
    answer = branches.solve(np.stack([np.cos(angle), np.sin(angle)], axis=-1))
    # One solution: its W2 is the smallest and the largest, whatever the other branch would do.
    one = answer.count == 1
    assert one.any()
    np.testing.assert_array_equal(answer.work[one, 0], answer.work[one, 1])
    regime = answer.regime[:, 1]
    changes = np.flatnonzero(regime[1:] != regime[:-1])
    found = branches.critical_angles()
    assert len(changes) >= 2
    for k in changes:
        assert ((found > angle[k]) & (found < angle[k + 1])).any()


@pytest.mark.parametrize("closure", ["affine", "traction"])
@pytest.mark.parametrize("unit", [1e-9, 1e9])
def test_answers_scale_with_the_unit_of_stiffness(closure, unit):
    graph, law, volume = at_yield(1.0)
    one = directional_work(graph, law, CIRCLE, closure=closure, volume=volume)
    graph, law, volume = at_yield(1.0, unit)
    other = directional_work(graph, law, CIRCLE, closure=closure, volume=volume)
    assert (one.status == "unique").all() and other.singular == one.singular == 0
    np.testing.assert_array_equal(other.status, one.status)
    np.testing.assert_array_equal(other.regime, one.regime)
    np.testing.assert_allclose(other.work / unit, one.work, atol=1e-12)


def test_both_works_of_a_batch_have_the_solutions_last():
    graph, law, volume = at_yield(1.0)
    batch = graph.replace(normal_force=np.stack([graph.normal_force] * 3))
    alone = directional_work(graph, law, CIRCLE, volume=volume, closure="affine")
    found = directional_work(batch, law, CIRCLE, volume=volume, closure="affine")
    for rows, one in ((found.work, alone.work), (found.normalised, alone.normalised)):
        assert rows.shape == (3, len(CIRCLE), 2)
        np.testing.assert_allclose(rows, np.broadcast_to(one, rows.shape), atol=1e-14)
