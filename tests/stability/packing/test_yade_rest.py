"""The stored states of Yade are at rest, and their levels are what the driver says they are."""

import numpy as np
import pytest

from loops import contact_forces, contact_state, love_weber_stress
from tests.stability.packing.yade_rest import STATES, bracket, yade_rest

REST, WITHIN, LEAST, MOST_STEPS, FLOWS = 1e-6, 1e-3, 5e-4, 20_000, 1e-2


@pytest.mark.parametrize("state", STATES)
def test_a_held_state_is_at_rest(state):
    """Overlaps differ by what the grains moved in the last step: positions are those after it."""
    graph, law, _ = yade_rest(state)
    forces, (i, j) = contact_forces(graph), graph.contacts.T
    left = np.zeros((graph.grain_count, 2))
    np.add.at(left, j, forces)
    np.add.at(left, i, -forces)
    assert np.linalg.norm(left, axis=1).mean() < 1e-7 * np.linalg.norm(forces, axis=1).mean()
    np.testing.assert_allclose(
        graph.normal_force, law.kn * contact_state(graph).overlap, rtol=0, atol=3e-5
    )
    assert (np.abs(graph.shear_force) <= law.mu * graph.normal_force * (1 + 1e-9)).all()
    stress = love_weber_stress(graph)
    assert abs(stress[0, 1] - stress[1, 0]) < 1e-6 * np.trace(stress)


@pytest.mark.parametrize("state", STATES)
def test_levels_are_dead_loads_and_end_where_no_rest_was_found(state):
    _, _, directions = yade_rest(state)
    for degrees, levels in directions.items():
        rest = levels[levels["at_rest"]]
        assert (levels["load"].diff()[1:] > 0).all() and levels["at_rest"][:-1].all()
        assert (rest["unbalanced"] < REST).all()
        theta = np.radians(degrees)
        for name, share in (("P11", np.cos(theta)), ("P22", np.sin(theta))):
            off = (rest[name] - share * rest["load"]).abs()
            assert (off < np.maximum(WITHIN * rest["load"], LEAST)).all()
        steps = np.diff(levels[["H11", "H22"]], axis=0, prepend=[[0.0, 0.0]])
        np.testing.assert_allclose(np.linalg.norm(steps, axis=1), levels["strain"], rtol=1e-12)
        if not (last := levels.iloc[-1])["at_rest"]:
            assert last["steps"] >= MOST_STEPS or last["strain"] > FLOWS
        # The last level is the one that moves.
        assert bracket(levels) == (levels["load"].iloc[-2], levels["load"].iloc[-1])
