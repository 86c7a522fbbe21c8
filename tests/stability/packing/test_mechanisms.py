"""What a mechanism cannot carry is left out of balance; all else moves as without springs."""

import numpy as np
import pytest
from scipy import sparse
from scipy.linalg import null_space
from scipy.sparse.linalg import splu

from loops import LinearFrictional, Regime, Scene
from loops.system import balancing_forces, relative_motion
from stability import factor as room
from stability.factor import Factor
from stability.packing import rate_problem
from tests.loops.packing.test_carrying import strips
from tests.oracles import eighty_bits
from tests.packings import LAW, jammed, packing, packing_system

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
    factor = Factor(system)
    motion, (R, L, compliance) = factor.solve(loads), factor.mechanisms
    wanted, left, mechanisms = limit(factor.matrix.toarray(), loads)
    assert mechanisms == 2 + spins == R.shape[1]
    assert (np.linalg.norm(left) > 1e-3 * np.linalg.norm(loads)) == (spins > 0)
    unbalanced = loads - factor.matrix @ motion
    # Rounding of `K` by the motion of the mechanisms.
    rounding = 2.0**-52 / room.MECHANISM * np.abs(loads).max()
    np.testing.assert_allclose(unbalanced, left, rtol=0, atol=rounding)
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
    np.testing.assert_allclose(
        factor.solve(loads[:, 2:3])[:, 0], motion[:, 2], rtol=0, atol=1e-14 * size
    )


def test_more_mechanisms_than_are_told_apart_leave_the_others_right(monkeypatch):
    """Then they move by the weak springs alone, and forces have the rounding of that motion."""
    system, loads = loaded(5)
    monkeypatch.setattr(room, "MOST", 4)
    factor = Factor(system)
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
    factor = Factor(system)
    affine = relative_motion(system, np.zeros((system.size, 4)), UNIT_STRAINS)
    motion = factor.solve(balancing_forces(system, system.stiffness @ affine))
    assert factor.mechanisms.R.shape[1] == 2
    spins = system.freedom[system.carrying.grains, 2]
    assert (motion[spins] == 0).all() and np.abs(motion).max() > 0.01


class Counted(Factor):
    """Factors that count their solves."""

    def once(self, loads, factors=None):
        vars(self)["solves"] = vars(self).get("solves", 0) + 1
        return super().once(loads, factors)


def test_refinement_ends_at_rounding():
    system = packing_system(Scene(strips(1), LAW))
    factor = Factor(system)
    rng = np.random.default_rng(0)
    loads = factor.matrix @ rng.normal(size=(system.size, 1))
    rough = factor.once(loads)
    counted = Counted(system)
    assert counted.mechanisms.R.shape == (system.size, 2)
    looked, fine = counted.solves, counted.solve(loads)
    left = [
        np.linalg.norm(loads - factor.matrix @ v) / np.linalg.norm(loads) for v in (rough, fine)
    ]
    assert 1e-12 < left[0] < 1e-9 and left[1] < 2e-15
    # One step of eleven digits is enough, and no second is taken for nothing.
    assert counted.solves == looked + 2
    # In any unit of force.
    counted.solve(2.0**40 * loads)
    counted.solve(2.0**-40 * loads)
    assert counted.solves == looked + 6


def test_a_load_that_nothing_carries_moves_nothing():
    """All grains pushed across, where the band floats: what is left of the load is all of it."""
    system = packing_system(Scene(strips(1), LAW))
    factor = Factor(system)
    loads = np.zeros((system.size, 1))
    loads[system.freedom[:, 1]] = 1.0
    assert np.abs(factor.solve(loads)).max() < 1e-12
    balanced = factor.matrix @ np.cos(np.arange(system.size))[:, None]
    both, alone = factor.solve(loads + balanced), factor.solve(balanced)
    np.testing.assert_allclose(both, alone, rtol=0, atol=1e-12)
    assert np.abs(alone[system.freedom[:, :2]].mean(axis=0)).max() < 1e-15


@pytest.mark.parametrize("band", [0.9, 0.99])
def test_motions_are_those_of_superlu_refined_in_eighty_bits(band):
    """Candidates sticking and sliding, against another factorisation; loads in many columns."""
    yielding = rate_problem(Scene(packing(16, 2, sliding=0.3), LAW), yield_band=band)
    for slides in (False, True):
        blocks = yielding.stiffness(np.full(len(yielding.rows), slides))
        factor = Factor(yielding.system, blocks)
        (R, L, _), K = factor.mechanisms, factor.matrix
        loads = K @ np.random.default_rng(0).normal(size=(len(R), 11))
        bordered = sparse.block_array([[K, sparse.csr_array(R)], [sparse.csr_array(L), None]])
        right = np.vstack([loads, np.zeros((R.shape[1], 11))]).astype(eighty_bits.LONG)
        wanted = eighty_bits.refined(bordered.tocsr(), splu(bordered.tocsc()), right)
        # Forces: a spin that next to nothing resists moves by rounding.
        wanted, found = (
            blocks @ relative_motion(yielding.system, motion)
            for motion in (wanted[: len(R)].astype(float), factor.solve(loads))
        )
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-13 * np.abs(wanted).max())
