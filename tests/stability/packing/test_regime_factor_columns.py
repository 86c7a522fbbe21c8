"""Columns of a packing of unequal contacts, in any unit of force, against dense systems."""

import numpy as np
import pytest

from stability.compiled.packing_system import Order, structure
from stability.packing import regime_factor
from stability.packing.regime_factor import (
    ELASTIC,
    OPEN,
    REGULARISATION,
    SLIDING,
    RegimeFactor,
)
from stability.programmes import MixedControl
from tests.packings import contacts_of, start_state
from tests.stability.packing.test_regime_factor import ALL, CHANGES, HELD, NONE, OPENS, stiffness
from tests.stability.packing.test_units import unequal

UNITS = [1.0, 2.0**30, 2.0**-30]
STRAIN = MixedControl(NONE, ALL, np.array([1.0, 0.2, 0.1, -0.7]))


def held(unit):
    """P11 grows, the other strains are given."""
    return MixedControl(HELD, ALL - HELD, np.array([0.2 * unit, 0.1, 0.0, 1.0]))


def pieces_of(unit=1.0, changes=(), more=0.0):
    """A packing of `kn` 3 and unequal `kt` and `mu`, forces in some unit; `more` is loaded too."""
    graph, law = unequal(36, 5)
    # The contact that opens carries nothing.
    left = unit * (np.arange(graph.contact_count) != OPENS)
    graph = graph.replace(
        normal_force=left * graph.normal_force, shear_force=left * graph.shear_force
    )
    law = type(law)(unit * law.kn, unit * law.kt, law.mu, law.shear_increment)
    state, count = contacts_of(start_state(graph), law), graph.contact_count
    regime, side = np.full(count, ELASTIC, dtype=np.int8), np.ones(count)
    for c, to, on in changes:
        regime[c], side[c] = to, on
    load = np.random.default_rng(0).normal(size=(graph.grain_count, 3))
    load = 1e-3 * unit * (load - load.mean(axis=0)).ravel() + more
    factor = RegimeFactor(state, regime, side)
    factor.set_load(load)
    return factor


def dense(pieces):
    """Stiffness in the present regimes, with its springs."""
    K, size = stiffness(pieces), 3 * pieces.count
    unit = pieces.frame["kn"].mean()
    own = np.maximum(REGULARISATION, pieces.ground_spring)
    K[np.arange(size), np.arange(size)] += np.repeat(own, 3) * unit
    return K


def relative(motion, touched):
    """A motion in the frame of the mean motion of grains with contacts."""
    motion = motion.reshape(-1, 3).copy()
    motion[touched, :2] -= motion[touched, :2].mean(axis=0)
    return motion.ravel()


@pytest.mark.parametrize("unit", UNITS)
def test_columns_are_a_new_factorisation_in_any_unit(unit):
    changed, anew, plain = pieces_of(unit), pieces_of(unit, CHANGES), pieces_of()
    for change in CHANGES:
        changed.set_regime(*change)
        plain.set_regime(*change)
        changed.solve(held(unit))
        plain.solve(held(1.0))
    for control, other in ((STRAIN, STRAIN), (held(unit), held(1.0))):
        found, wanted, same = changed.solve(control), anew.solve(control), plain.solve(other)
        np.testing.assert_allclose(found[:4], wanted[:4], rtol=0, atol=1e-10)
        motions = changed.motion(found), anew.motion(wanted)
        np.testing.assert_allclose(*motions, rtol=0, atol=1e-9 * np.abs(motions[1]).max())
        np.testing.assert_array_equal(found[:4], same[:4])
        np.testing.assert_array_equal(changed.motion(found), plain.motion(same))


@pytest.mark.parametrize("unit", UNITS)
def test_motions_are_those_of_a_dense_system(unit):
    """Every grain has the same weak spring, whatever its contacts; some are held harder."""
    opens = [(c, OPEN, 0.0) for c in range(0, 60, 2)]
    pieces = pieces_of(unit, opens)
    closed = pieces.regime != OPEN
    degree = np.bincount(pieces.frame["grains"][closed].ravel(), minlength=pieces.count)
    assert min((degree < 2).sum(), (degree == 2).sum(), (degree > 2).sum()) > 0
    for spring in (None, 1e-2):
        if spring:
            pieces.add_ground_springs(np.array([1, 4, 7]), spring)
            pieces.add_ground_springs(np.array([4]), 0.1 * spring)
            assert pieces.ground_spring[[1, 4, 7]].tolist() == [spring] * 3
        # Grains without a contact bear no load, and nothing holds the resultant of the others.
        load = np.where(degree[:, None] > 0, pieces.load.reshape(-1, 3), 0.0)
        load[degree > 0, :2] -= load[degree > 0, :2].mean(axis=0)
        # What the springs alone hold is rounding.
        wanted = relative(np.linalg.solve(dense(pieces), load.ravel()), degree > 0)
        np.testing.assert_allclose(
            pieces.motions[4], wanted, rtol=0, atol=1e-7 * np.abs(wanted).max()
        )


def force_on(pieces, row):
    """A unit force of a pair on its grains."""
    pair, out = pieces.frame[row % len(pieces.frame)], np.zeros((pieces.count, 3))
    way = pair["t"] if row >= len(pieces.frame) else pair["n"]
    for grain, sign, arm in zip(pair["grains"], (-1.0, 1.0), pair["arm"], strict=True):
        out[grain, :2] += sign * way
        if row >= len(pieces.frame):
            out[grain, 2] -= arm
    return out.ravel()


@pytest.mark.parametrize("stress_held", [False, True], ids=["strain", "P11"])
def test_a_force_on_a_row_adds_its_rates(stress_held):
    """The difference of rates with and without it: motion, strain; columns come afterwards too."""
    pieces, control = pieces_of(), held(1.0) if stress_held else STRAIN
    for change in CHANGES[:3]:
        pieces.set_regime(*change)
    for row in (11, 25, len(pieces.frame) + 3):
        k = pieces.column(row)
        pieces.column(40)
        found = pieces.driven(control, k)
        loaded = pieces_of(more=force_on(pieces, row))
        for change in CHANGES[:3]:
            loaded.set_regime(*change)
        one, other = pieces.solve(control), loaded.solve(control)
        # The force's own stress is no part of the stress of the contacts that the control holds.
        pair = pieces.frame[row % len(pieces.frame)]
        own = np.outer(pair["n" if row < len(pieces.frame) else "t"], pair["d"]).ravel()
        if stress_held:
            rate = control.rate.copy()
            rate[0] -= own[0] / pieces.volume
            other = loaded.solve(control._replace(rate=rate))
        else:
            np.testing.assert_array_equal(found[:5], np.zeros(5))
        wanted = loaded.motion(other) - pieces.motion(one)
        np.testing.assert_allclose(
            pieces.motion(found), wanted, rtol=0, atol=1e-8 * np.abs(wanted).max()
        )
        np.testing.assert_allclose(found[:4], other[:4] - one[:4], rtol=0, atol=1e-9)


def test_signs_are_those_of_dense_determinants():
    """Under strain of the stiffness; under stress also of the stress that strains make."""
    seen = set()
    for seed in range(12):
        rng, pieces = np.random.default_rng(seed), pieces_of()
        first = np.linalg.slogdet(dense(pieces))[0]
        changes = [(int(c), SLIDING, rng.choice([-1.0, 1.0])) for c in rng.permutation(60)[:30]]
        for change in changes:
            pieces.set_regime(*change)
        ratio = np.linalg.slogdet(dense(pieces))[0] * first
        assert pieces.sign(STRAIN) == ratio
        anew = pieces_of(changes=changes)
        for both in ((HELD, ALL - HELD), (-HELD, ALL - HELD), (ALL, NONE)):
            control = MixedControl(*both, STRAIN.rate)
            assert pieces.sign(control) == ratio * anew.sign(control)
        seen.add(float(ratio))
    assert seen == {1.0, -1.0}


def test_there_is_room_for_so_many_columns(monkeypatch):
    monkeypatch.setattr(regime_factor, "ROOM", 5)
    pieces = pieces_of()
    assert [pieces.column(row) for row in (3, 8, 12, 3, 20)] == [0, 1, 2, 0, 3]
    assert pieces.column(30) == 4 and pieces.column(8) == 1
    # The cached rates of a contact: four strains and the load, then every column.
    assert pieces.pair_rates.shape == (2, len(pieces.frame), 5 + 5)
    with pytest.raises(ArithmeticError, match="room"):
        pieces.column(31)


@pytest.mark.parametrize(("growth", "kept"), [(1.0, True), (1.2, True), (1.3, False)])
def test_an_order_of_elimination_is_kept_until_the_factors_grow_by_a_quarter(growth, kept):
    pieces = pieces_of()
    place, entries = pieces.order
    assert entries == len(pieces.factors.rows)
    # An order that fills more: the grains as they are numbered.
    V = pieces.motions[:5].copy()
    plain = np.arange(pieces.count)
    _, rows = structure(pieces.frame["grains"], plain)
    order = pieces.order = Order(plain, len(rows) / growth)
    pieces.factorise()
    assert (pieces.order is order) == kept
    if not kept:
        np.testing.assert_array_equal(pieces.order.place, place)
    np.testing.assert_allclose(pieces.motions[:5], V, rtol=0, atol=1e-10 * np.abs(V).max())


def test_a_regime_that_returns_leaves_no_change():
    pieces = pieces_of()
    before = pieces.solve(STRAIN)
    for c, regime, side in ((3, SLIDING, -1.0), (9, OPEN, 0.0)):
        pieces.set_regime(c, regime, side)
        assert not np.allclose(pieces.motion(pieces.solve(STRAIN)), pieces.motion(before))
        pieces.set_regime(c, ELASTIC, 1.0)
    np.testing.assert_allclose(
        pieces.motion(pieces.solve(STRAIN)), pieces.motion(before), rtol=0, atol=1e-12
    )
    # A contact that sticks on its other side changes nothing: no column is made.
    count = len(pieces.at)
    pieces.set_regime(20, ELASTIC, -1.0)
    assert len(pieces.at) == count and pieces.side[20] == -1.0
