"""What a mechanism cannot carry is left out of balance; all else moves as without springs."""

import numpy as np
import pytest
from scipy.linalg import null_space

import loops.system
from loops import LinearFrictional, Regime, Scene
from loops.system import balancing_forces, factorised, packing_system, relative_motion
from tests.packings import LAW, jammed

SMOOTH = LinearFrictional(1.0, 0.5, 0.0, "radii")
UNIT_STRAINS = np.moveaxis(np.eye(4).reshape(4, 2, 2), 0, -1)


def spinning(graph, count):
    """Regimes in which all contacts of some grains slide: nothing resists their spins."""
    regime = np.full(graph.contact_count, Regime.ELASTIC, dtype=np.int8)
    regime[graph.normal_force == 0] = Regime.OPEN
    degree = np.bincount(graph.contacts[regime != Regime.OPEN].ravel(), minlength=len(graph.x))
    chosen = []
    for grain in np.argsort(-degree, kind="stable"):
        if len(chosen) == count:
            return regime
        touching = (graph.contacts == grain).any(axis=1)
        if not np.isin(graph.contacts[touching], chosen).any():
            chosen.append(int(grain))
            regime[touching & (regime != Regime.OPEN)] = Regime.SLIDING
    raise AssertionError("too few grains apart")


def limit(K, loads):
    """Motions under springs that vanish, by null vectors at the border, and what they leave."""
    R, L = null_space(K, rcond=1e-13), null_space(K.T, rcond=1e-13)
    m = R.shape[1]
    bordered = np.block([[K, R], [L.T, np.zeros((m, m))]])
    found = np.linalg.solve(bordered, np.vstack([loads, np.zeros((m, loads.shape[1]))]))
    return found[: len(K)], R @ found[len(K) :], m


def loaded(spins):
    """The system of a packing with so many spins that nothing resists, and unit strains as loads.

    The loads turn the spins: shear forces of sliding contacts grow with their normal forces.
    """
    graph = jammed(36, 5, LAW)
    system = packing_system(Scene(graph, LAW), regime=spinning(graph, spins))
    affine = relative_motion(system, np.zeros((system.size, 4)), UNIT_STRAINS)
    return system, balancing_forces(system, system.stiffness @ affine)


@pytest.mark.parametrize("spins", [0, 1, 3, 5])
def test_motions_beside_mechanisms_are_those_of_no_springs(spins):
    """Two translations that nothing loads, and the spins, which a load moves by a given spring."""
    system, loads = loaded(spins)
    factor = factorised(system)
    motion, (R, L, compliance) = factor.solve(loads), factor.mechanisms
    wanted, left, mechanisms = limit(factor.matrix.toarray(), loads)
    assert mechanisms == 2 + spins == R.shape[1]
    assert (np.linalg.norm(left) > 1e-3 * np.linalg.norm(loads)) == (spins > 0)
    unbalanced = loads - factor.matrix @ motion
    np.testing.assert_allclose(unbalanced, left, rtol=0, atol=1e-9 * np.abs(loads).max())
    moved = R @ (compliance * (L @ loads))
    assert (np.abs(moved).max(initial=0.0) > 1e3) == (spins > 0)
    size = max(np.abs(moved).max(), np.abs(wanted).max())
    np.testing.assert_allclose(motion, wanted + moved, rtol=0, atol=1e-14 * size + 1e-12)
    np.testing.assert_allclose(R @ (L @ left), left, rtol=0, atol=1e-13 * np.abs(loads).max())
    # Nothing holds the packing: its grains stay in place on average.
    mean = motion[system.freedom[system.carrying.grains, :2]].mean(axis=0)
    assert np.abs(mean).max() < 1e-14 * size
    forces = [
        system.stiffness @ relative_motion(system, one, UNIT_STRAINS) for one in (motion, wanted)
    ]
    np.testing.assert_allclose(*forces, rtol=0, atol=1e-9 * np.abs(forces[1]).max())
    np.testing.assert_allclose(factor.solve(loads[:, 2]), motion[:, 2], rtol=0, atol=1e-14 * size)


def test_more_mechanisms_than_are_told_apart_leave_the_others_right(monkeypatch):
    """Then they move by the weak springs alone, and forces have the rounding of that motion."""
    system, loads = loaded(5)
    monkeypatch.setattr(loops.system, "TRIED", (2, 4))
    factor = factorised(system)
    assert factor.mechanisms.R.shape[1] == 2
    wanted = limit(factor.matrix.toarray(), loads)[0]
    forces = [
        system.stiffness @ relative_motion(system, motion, UNIT_STRAINS)
        for motion in (factor.solve(loads), wanted)
    ]
    np.testing.assert_allclose(*forces, rtol=0, atol=1e-4 * np.abs(forces[1]).max())


def test_spins_that_nothing_resists_or_loads_stay():
    """Without shear stiffness all spins are free: they are no mechanisms to look for."""
    graph = jammed(16, 2, SMOOTH)
    system = packing_system(Scene(graph, SMOOTH))
    factor = factorised(system)
    affine = relative_motion(system, np.zeros((system.size, 4)), UNIT_STRAINS)
    motion = factor.solve(balancing_forces(system, system.stiffness @ affine))
    assert factor.mechanisms.R.shape[1] == 2
    spins = system.freedom[system.carrying.grains, 2]
    assert (motion[spins] == 0).all() and np.abs(motion).max() > 0.01
