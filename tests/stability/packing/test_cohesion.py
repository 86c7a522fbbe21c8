"""Cohesive laws in packings: no cohesion is the linear law, the energy closes, flags not forces."""

from dataclasses import replace

import numpy as np
import pytest

from grainloops import hold, replay
from loops import FrictionalLaw, GrainGraph, RollingResistance, Scene, contact_state
from stability import follow
from stability.packing.rattlers import carrying_nothing
from tests.packings import LAW, contacts_of, jammed, start_state, strained

SHEAR = np.array([[2e-3, 2e-4], [0.0, -2e-3]])
EXTENSION = np.array([[-6e-3, 2e-3], [0.0, 2e-3]])


class Cohesive(FrictionalLaw):
    """A constant attraction while grains touch, friction of the force beyond it."""

    shear_increment = "radii"

    def closed_force(self, state):
        return self.kn * state.overlap - self.adhesion

    def strength(self, state):
        return self.mu * (state.normal_force + self.adhesion) + self.bond


def glued(adhesion, bond=0.0):
    return Cohesive(kn=1.0, kt=0.5, mu=0.5, adhesion=adhesion, bond=bond)


def at_rest(adhesion, bond=0.0, rolls=False):
    """The packing of 12 held under an attraction of this share of its mean force, and its law."""
    graph = jammed(12, 1)
    law = glued(adhesion * graph.normal_force[graph.normal_force > 0].mean(), bond)
    law = RollingResistance(law, 0.02, 0.1) if rolls else law
    forces = law.normal_force(contact_state(graph))
    held = hold(Scene(graph.replace(normal_force=forces), law), unbalanced=1e-8)
    assert held.status == "at rest"
    return held.graph, held.law


@pytest.mark.parametrize("strain", [SHEAR, EXTENSION], ids=["shear", "extension"])
def test_without_attraction_the_path_is_that_of_the_linear_law_bit_by_bit(strain):
    graph, how = jammed(12, 1), {"closure": "packing", "interval": 4e-5}
    one, other = (follow(Scene(graph, law), strained(strain), **how) for law in (glued(0.0), LAW))
    assert one.events == other.events and len(one.events) > 3
    for name in ("forces", "x", "closed"):
        a, b = (getattr(path.states[-1], name) for path in (one, other))
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(one.P, other.P)


CASES = [(0.1, False, SHEAR), (0.3, True, EXTENSION), (1.0, False, EXTENSION), (3.0, True, SHEAR)]


@pytest.mark.parametrize(("adhesion", "rolls", "strain"), CASES)
def test_the_energy_of_a_cohesive_path_closes(adhesion, rolls, strain):
    graph, law = at_rest(adhesion, rolls=rolls)
    path = follow(Scene(graph, law), strained(strain), closure="packing", interval=4e-5)
    assert path.status == "finished" and (path.states[-1].normal_force < 0).any()
    assert path.balance_error < 1e-11


@pytest.mark.slow
@pytest.mark.parametrize("adhesion", [0.1, 1.0])
def test_slow_replays_come_to_the_forces_of_a_cohesive_path(adhesion):
    """Half the rate has half the distance."""
    graph, law = at_rest(adhesion)
    path = follow(Scene(graph, law), strained(SHEAR), closure="packing", interval=5e-6)
    first = np.arange(graph.contact_count)
    wanted = path.states[-1].forces[first]
    ends = [replay(Scene(graph, law), SHEAR, duration=t, viscous=0.02).state for t in (2e3, 4e3)]
    fast, slow = (np.linalg.norm(end.forces[first] - wanted) for end in ends)
    assert 1.8 < fast / slow < 2.2 and slow < 2e-4 * np.linalg.norm(wanted)


def test_contacts_without_a_force_are_closed_where_they_overlap():
    """Where the spring balances the attraction, and none is open for being pulled."""
    graph = jammed(12, 1)
    overlap = contact_state(graph).overlap
    law = glued(float(overlap[3]))
    state = contacts_of(start_state(graph), law).with_normal_forces()
    assert state.normal_force[3] == 0.0 and state.closed[3]
    np.testing.assert_array_equal(state.closed, overlap > 0)
    assert (state.normal_force[state.closed] < 0).any()
    path = follow(Scene(graph, law), strained(0 * SHEAR + 1e-9), closure="packing")
    np.testing.assert_array_equal(path.states[0].closed[: len(overlap)], overlap > 0)


def two(overlap, shear=0.0):
    return GrainGraph(
        x=[[0, 0], [1.0 - overlap, 0]], radii=[0.4, 0.6], contacts=[[0, 1]], images=[[0, 0]],
        cell=4 * np.eye(2), normal_force=[1.0], shear_force=[shear],
    )  # fmt: skip


@pytest.mark.parametrize("overlap", [0.05, 1e-5, -0.01])
@pytest.mark.parametrize("reach", [0.0, 1e-3])
@pytest.mark.parametrize("bond", [0.0, 0.002])
def test_records_of_a_cohesive_law(overlap, reach, bond):
    """They open with the force at touch; within reach force and strength are secants to it."""
    law = RollingResistance(glued(0.01, bond), 0.02, 0.1)
    state = contacts_of(start_state(two(overlap)), law).with_normal_forces()
    assert state.closed[0] == (overlap > 0)
    free, rolling = state.records(reach)
    assert free["at_touch"] == -0.01
    # An open pair has its tangents at the reach, none without.
    known = overlap > 0 or reach > 0
    assert [free["kn"], free["mu"]] == pytest.approx([known * 1.0, known * 0.5], rel=1e-9)
    assert free["mu"] * -0.01 + free["cohesion"] == pytest.approx(bond, abs=1e-16)
    N = state.normal_force[0]
    assert N == pytest.approx(max(overlap, 0) - 0.01 * (overlap > 0), rel=1e-12)
    if overlap > 0:
        assert state.strength[0] == pytest.approx(0.5 * overlap + bond, rel=1e-11)
        reached = state.rolling_strength[0]
        assert reached == pytest.approx(0.1 * 0.24 * overlap, rel=1e-9)
        unit = state.mean_radius
        assert unit * (rolling["mu"] * N + rolling["cohesion"]) == pytest.approx(reached, rel=1e-9)
    size = 1e-6
    at = np.array([[0.05 + size], [0.05 - size]])
    rise = (state.law.normal_energy(at[0]) - state.law.normal_energy(at[1])) / (2 * size)
    np.testing.assert_allclose(rise, state.law.normal_force(np.array([0.05])), rtol=1e-8)


def test_a_grain_that_hangs_on_an_attraction_is_held():
    """One contact that can pull holds as two do; without attraction the grain carries nothing."""
    free, held = (
        replace(contacts_of(start_state(two(0.02)), glued(a)), normal_force=np.array([-0.004]))
        for a in (0.0, 0.01)
    )
    assert carrying_nothing(free, 1e-4).tolist() == [True, True]
    assert carrying_nothing(held, 1e-4).tolist() == [False, False]
    # At rest under its attraction alone.
    assert not carrying_nothing(replace(held, normal_force=np.zeros(1)), 1e-4).any()
