"""One stiffness matrix from two places: blocks of the rates, and the kernel of paths."""

import numpy as np
import pytest

from loops import GrainGraph, HertzMindlin, LinearFrictional, Regime, RollingResistance, Scene
from loops.system import stiffness_matrix
from stability.compiled.packing_system import stiffnesses
from stability.packing.regime_factor import RegimeFactor
from tests.packings import contacts_of, jammed, packing_system, start_state

BY_RADII = LinearFrictional(1.0, 0.4, 0.5, "radii")
LAWS = {
    "linear": LinearFrictional(1.0, 0.4, 0.5),
    "by radii": BY_RADII,
    "rolling": RollingResistance(BY_RADII, 0.03),
    "displacement": HertzMindlin(5.0, 0.2, 0.5, shear_history="displacement"),
}


@pytest.mark.parametrize("name", LAWS)
def test_rates_and_paths_have_one_stiffness_matrix(name):
    """Sticking and sliding contacts under shear; each adds its blocks in an order of its own."""
    law, rng = LAWS[name], np.random.default_rng(3)
    graph = jammed(24, 3)
    contacts = contacts_of(start_state(graph), law)
    N = contacts.law.normal_force(contacts.overlap)
    T = 0.4 * rng.uniform(-1, 1, len(N)) * N
    slides = rng.random(len(N)) < 0.3
    regime = np.where(slides, Regime.SLIDING, Regime.ELASTIC).astype(np.int8)
    graph = GrainGraph(
        x=graph.x, radii=graph.radii, contacts=graph.contacts, images=graph.images,
        cell=graph.cell, normal_force=N, shear_force=T, regime=regime,
    )  # fmt: skip
    system = packing_system(Scene(graph, law))
    assert len(system.contacts) > 30 and (system.regime == Regime.SLIDING).any()
    contacts = contacts_of(start_state(graph), law)
    # Pairs that carry nothing are no part of the one, and open in the other.
    pairs = np.full(len(N), Regime.OPEN, dtype=np.int8)
    pairs[system.contacts] = system.regime
    springs = [pairs, np.where(pairs == Regime.OPEN, Regime.OPEN, Regime.ELASTIC).astype(np.int8)]
    regimes = np.concatenate(springs[: contacts.law.springs])
    sides = np.tile(np.sign(T), contacts.law.springs)
    factor = RegimeFactor(contacts, regimes, sides)
    of_path = np.zeros((3 * factor.count, 3 * factor.count))
    ends, elements = stiffnesses(factor.frame, regimes, sides)
    at = (3 * ends[:, :, None] + np.arange(3)).reshape(-1, 6)
    np.add.at(of_path, (at[:, :, None], at[:, None, :]), elements)
    moves = system.freedom >= 0
    at = system.freedom[moves]
    carried = of_path[np.ix_(moves.ravel(), moves.ravel())]
    of_rates = stiffness_matrix(system).toarray()[np.ix_(at, at)]
    # Spins are over the mean radius of grains that carry in the one, of all in the other.
    spin = np.broadcast_to([1.0, 1.0, contacts.mean_radius / system.length], moves.shape)[moves]
    difference = carried * spin[:, None] * spin - of_rates
    assert np.abs(difference).max() < 4e-16 * np.abs(of_rates).max()
