"""Options of contacts at the edge of their law, and their orbits, by hand."""

from dataclasses import replace

import numpy as np
import pytest

from loops import GrainGraph, LinearFrictional, Regime, contact_state
from patterns import diamond, regular_polygon
from stability import programmes
from stability.paths.model import path_model
from stability.paths.regimes import (
    edge_choices,
    edge_orbits,
    edge_problem,
    first_regimes,
    path_symmetry,
    rate_vector,
)
from stability.paths.state import Mode, initial_state
from stability.paths.state_rates import UNIT_PARAMETER, StateRates
from stability.regimes import CHOICES, LEFT, OPEN, RIGHT, STICKS

STICK, SLIDE, APART = (int(r) for r in (Regime.ELASTIC, Regime.SLIDING, Regime.OPEN))
UNITS = [(1.0, 1.0), (2.0**-9, 2.0**30), (2.0**9, 2.0**-30)]
# Over the strength: inside the cone, on either side of it, frictionless.
SHARES = np.array([0.2, 1.0, -1.0, 0.0])


def loaded(length=1.0, kn=1.0, mu=(0.3, 0.3, 0.3, 0.0), closure="affine"):
    """A square with an overlap of a fiftieth whose contacts carry shares of their strength."""
    loop, law = regular_polygon(4), LinearFrictional(kn, 0.3 * kn, np.array(mu))
    graph = GrainGraph(x=length * loop.x, radii=1.02 * length * loop.radii, contacts=loop.contacts)
    graph = graph.replace(normal_force=law.normal_force(contact_state(graph)))
    model = path_model(graph, contact_state(graph), law, closure, "blocked", None)
    y = initial_state(model, contact_state(graph))
    y[model.shears] = SHARES * law.mu * graph.normal_force
    return model, y


def mode_of(*regimes, side=1.0):
    return Mode(np.array(regimes, dtype=np.int8), np.full(len(regimes), side))


@pytest.mark.parametrize(("length", "kn"), UNITS)
def test_options_of_contacts_at_the_edge(length, kn):
    model, y = loaded(length, kn)
    mode = mode_of(STICK, STICK, STICK, SLIDE)
    at_edge = {1: {STICKS, LEFT}, 2: {STICKS, RIGHT}}

    def chosen(model, mode, fired):
        here = StateRates(model, y, mode, programmes.isotropic_strain(), UNIT_PARAMETER)
        return named(edge_choices(here, fired))

    assert chosen(model, mode, {}) == at_edge
    # Contacts whose event fired are at the edge, whatever their forces.
    assert chosen(model, mode, {0: LEFT}) == {0: {STICKS, LEFT}, **at_edge}
    assert chosen(model, mode, {0: OPEN}) == {0: {STICKS, OPEN}, **at_edge}
    assert chosen(model, mode, {0: STICKS}) == at_edge
    searched = replace(model, search_all=True)
    assert chosen(searched, mode, {}) == {0: {STICKS, LEFT, RIGHT}, **at_edge}
    gone = mode_of(APART, STICK, STICK, SLIDE)
    assert chosen(model, gone, {}) == at_edge
    assert chosen(searched, gone, {}) == at_edge
    assert chosen(model, gone, {0: STICKS}) == {0: {STICKS, OPEN}, **at_edge}


def named(options):
    """Options of the contacts that have some."""
    return {c: set(CHOICES[can].tolist()) for c, can in enumerate(options) if can.any()}


def options_of(contacts):
    """Options (4, 4) of some of four contacts."""
    return np.array([np.isin(CHOICES, contacts.get(c, ())) for c in range(4)])


def symmetric(mu):
    """A flat diamond with its mirrors, one of which turns each contact into another one."""
    graph = diamond(np.radians(40.0))
    law = LinearFrictional(1.0, 0.3, mu)
    model = path_model(graph, contact_state(graph), law, "affine", "blocked", None)
    y = initial_state(model, contact_state(graph))
    mode = mode_of(STICK, STICK, STICK, STICK, side=0.0)
    programme = programmes.isotropic_strain()
    group = path_symmetry(StateRates(model, y, mode, programme, UNIT_PARAMETER), [programme])
    return replace(model, symmetry=group)


@pytest.mark.parametrize("mu", [0.3, 0.0])
def test_contacts_of_an_orbit_take_one_choice(mu):
    """A mirror turns the side; without friction there is none to turn."""
    model = symmetric(mu)
    assert model.symmetry.order == 4 and model.symmetry.contact_orbits.tolist() == [0] * 4
    parity = model.symmetry.contact_parity
    sign = parity if mu else np.ones(4)
    assert sorted(parity.tolist()) == [-1.0, -1.0, 1.0, 1.0]
    turned = int(np.flatnonzero(parity < 0)[0])
    options = options_of({turned: [STICKS, LEFT, OPEN]})
    orbits = edge_orbits(model, options)
    first = LEFT if sign[turned] > 0 else RIGHT
    assert orbits.representatives.tolist() == [0]
    assert named(orbits.options) == {0: {STICKS, first, OPEN}}
    assert orbits.contacts.tolist() == [0, 1, 2, 3] and orbits.orbit.tolist() == [0] * 4
    before = mode_of(STICK, STICK, STICK, STICK, side=0.0)
    taken = orbits.mode(before, np.array([LEFT]))
    assert taken.regime.tolist() == [SLIDE] * 4
    np.testing.assert_array_equal(taken.side, sign)
    assert first_regimes(orbits, before, {turned: LEFT}).tolist() == [first]
    assert first_regimes(orbits, before, {0: RIGHT, turned: LEFT}).tolist() == [RIGHT]
    assert first_regimes(orbits, taken, {turned: STICKS}).tolist() == [STICKS]
    assert first_regimes(orbits, taken, {}).tolist() == [LEFT]
    plain = replace(model, symmetry=None)
    alone = edge_orbits(plain, options)
    assert alone.representatives.tolist() == [turned]
    np.testing.assert_array_equal(alone.options, options[[turned]])
    assert alone.mode(before, np.array([RIGHT])).side[turned] == -1.0
    assert first_regimes(alone, before, {turned: LEFT}).tolist() == [LEFT]


def test_nothing_slides_on_a_mirror():
    """A contact that a mirror sends to itself has options without a side alone."""
    model = symmetric(0.3)
    vertical = replace(
        model.symmetry, contacts=np.array([[0, 1, 2, 3], [0, 3, 2, 1]]),
        maps=np.array([np.eye(2), np.diag([-1.0, 1.0])]), grains=model.symmetry.grains[:2],
    )  # fmt: skip
    options = options_of({0: [STICKS, LEFT, OPEN], 3: [LEFT]})
    orbits = edge_orbits(replace(model, symmetry=vertical), options)
    assert orbits.representatives.tolist() == [0, 1]
    assert named(orbits.options) == {0: {STICKS, OPEN}, 1: {RIGHT}}
    assert orbits.contacts.tolist() == [0, 1, 3] and orbits.orbit.tolist() == [0, 1, 1]


@pytest.mark.parametrize(("length", "kn"), UNITS)
def test_rates_that_decide_are_the_same_in_other_units(length, kn):
    """Two contacts at yield under shear: the solution of each combination, tried one by one."""
    shear = programmes.combination(np.zeros((4, 4)), np.eye(4), [0.3, 1, 0.4, -0.2], "shear")
    mode = mode_of(STICK, STICK, STICK, SLIDE)
    model, y = loaded(length, kn)
    found, wanted = (
        edge_problem(StateRates(*one, mode, shear, UNIT_PARAMETER), preferred={}, direction=None)
        for one in ((model, y), loaded())
    )
    assert (found.status, found.tried, found.combinations) == (
        wanted.status, wanted.tried, 4.0
    )  # fmt: skip
    taken = found.taken.rates.mode
    assert taken.regime.tolist() == wanted.taken.rates.mode.regime.tolist()
    np.testing.assert_allclose(
        found.taken.rates.vector, wanted.taken.rates.vector, rtol=0, atol=1e-14
    )
    # Consistent with its own rates: what slides does so on its side, what sticks stays inside.
    rates = StateRates(model, y, taken, shear, found.taken.rates.rates.gauge).raw_rates
    np.testing.assert_allclose(
        rate_vector(model, rates), found.taken.rates.vector, rtol=0, atol=1e-14
    )
    edge = found.taken.rates.edge
    np.testing.assert_allclose(edge.un, kn * rates.un[1:3], rtol=1e-14)
    for k, c in enumerate((1, 2)):
        side = np.sign(SHARES[c])
        beyond = side * edge.shear[k] - edge.strength[k]
        assert (beyond > 0) == (taken.regime[c] == SLIDE)
        assert taken.regime[c] == STICK or taken.side[c] == side
    assert edge.strength[0] == pytest.approx(-0.3 * edge.un[0])


def test_a_present_regime_is_tried_first():
    """Of two contacts at yield, one slides already: that combination is the first one tried."""
    shear = programmes.combination(np.zeros((4, 4)), np.eye(4), [0.3, 1, 0.4, -0.2], "shear")
    mode = mode_of(STICK, STICK, STICK, SLIDE)
    here = StateRates(*loaded(), mode, shear, UNIT_PARAMETER)
    first = edge_problem(here, preferred={}, direction=None)
    again = edge_problem(
        replace(here, mode=first.taken.rates.mode),
        preferred=dict(zip((1, 2), first.taken.regimes, strict=True)), direction=None,
    )  # fmt: skip
    np.testing.assert_array_equal(again.taken.rates.vector, first.taken.rates.vector)
    np.testing.assert_array_equal(again.taken.rates.mode.regime, first.taken.rates.mode.regime)
