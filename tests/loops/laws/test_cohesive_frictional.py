"""The law with cohesion: attraction while grains touch, and bonds that break for good."""

from dataclasses import replace

import numpy as np
import pytest

from loops import (
    CohesiveFrictional,
    InputError,
    LinearFrictional,
    Regime,
    RollingResistance,
    contact_state,
)
from patterns import regular_polygon
from tests.oracles.cohesive import Cohesive

KN, KT, MU, A, C = 2.0, 0.7, 0.3, 0.05, 0.04


def states(overlap, T=0.0):
    """Contacts of the given overlaps (C,) with the force of a law."""
    state = contact_state(regular_polygon(5))
    state = replace(state, length=state.touching_length - np.asarray(overlap, dtype=float))
    return replace(state, shear_force=np.broadcast_to(T, state.length.shape).astype(float))


OVERLAPS = np.array([-0.03, -0.02, -1e-3, 0.0, 0.1])


def test_attraction_is_that_of_ten_lines():
    law, own = CohesiveFrictional(KN, KT, MU, A), Cohesive(KN, KT, MU, A)
    state = states(OVERLAPS, 0.01)
    for name in ("closed_force", "normal_force", "gap", "strength", "normal_energy"):
        state = replace(state, normal_force=own.normal_force(state))
        found, wanted = (getattr(one, name)(state) for one in (law, own))
        np.testing.assert_allclose(found, wanted, rtol=1e-13, atol=1e-16, err_msg=name)
    for regime in Regime:
        D = [one.local_stiffness(state, np.full(5, regime)) for one in (law, own)]
        np.testing.assert_array_equal(*D)
    assert law.parted(np.ones(5, dtype=bool)) is law


def test_a_bond_holds_beyond_touch_until_its_pull():
    law = CohesiveFrictional(KN, KT, MU, A, cohesion=C, bonded=True)
    state = states(OVERLAPS)
    # It breaks at a gap of a/kn = 0.025.
    wanted = KN * np.array([0.0, -0.02, -1e-3, 0.0, 0.1])
    np.testing.assert_allclose(law.normal_force(state), wanted, atol=1e-15)
    np.testing.assert_allclose(law.gap(state), [5e-3, -5e-3, -0.024, -0.025, -0.125], atol=1e-15)
    state = replace(state, normal_force=law.normal_force(state))
    np.testing.assert_allclose(law.strength(state), C + MU * wanted, atol=1e-15)
    np.testing.assert_allclose(law.normal_energy(state), 0.5 * KN * OVERLAPS**2, atol=1e-16)
    assert law.regime(state).tolist() == [Regime.OPEN] + 4 * [Regime.ELASTIC]


@pytest.mark.parametrize("wrapped", [False, True])
def test_broken_bonds_are_contacts_without_cohesion(wrapped):
    law = CohesiveFrictional(KN, KT, MU, A, cohesion=C, bonded=True)
    opened = np.array([False, True, True, False, True])
    law = RollingResistance(law, 0.1).parted(opened).law if wrapped else law.parted(opened)
    state, plain = states(OVERLAPS), LinearFrictional(KN, KT, MU)
    whole = CohesiveFrictional(KN, KT, MU, A, cohesion=C, bonded=True)
    for name in ("normal_force", "gap", "strength"):
        wanted = np.where(opened, getattr(plain, name)(state), getattr(whole, name)(state))
        np.testing.assert_allclose(getattr(law, name)(state), wanted, atol=1e-15, err_msg=name)
    picked = law.take(np.array([1, 3]))
    assert picked.adhesion.tolist() == [0.0, A] and picked.bonded
    assert law.parted(~opened).adhesion.tolist() == 5 * [0.0]


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"adhesion": -1.0}, "adhesion of the contact law"),
        ({"adhesion": np.inf}, "adhesion of the contact law"),
        ({"adhesion": 1.0, "cohesion": 0.1}, "at least mu times the adhesion"),
    ],
)
def test_parameters_out_of_range_are_named(given, says):
    with pytest.raises(InputError, match=says):
        CohesiveFrictional(KN, KT, MU, **given)
