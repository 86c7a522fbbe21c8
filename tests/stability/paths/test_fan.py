"""Fans of programmes: units, cost, singular states, event places, contacts at their strength."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from loops import GrainGraph, LinearFrictional, Regime, contact_state
from loops.symmetry import loop_symmetry
from patterns import random_loop, regular_polygon
from stability.paths.fan import Fan, LoopStates
from stability.paths.fan_limits import (
    LIMITS,
    MAX_STEP,
    FanLimits,
    _pending,
    _set_balance,
    _to_event,
    first_limits,
    followed_limits,
)
from stability.paths.model import path_model

KAPPA = 0.3


def fan_of(loop, closure, control, degrees, mu=np.inf, *, length=1.0, kn=1.0, overlap=0.0,
           reach=0.95):  # fmt: skip
    """Fan of a loop whose grains overlap by a share of their distance, in some units."""
    law = LinearFrictional(kn, KAPPA * kn, mu)
    loop = GrainGraph(
        x=length * loop.x, radii=(1.0 + overlap) * length * loop.radii, contacts=loop.contacts
    )
    loop = loop.replace(normal_force=law.normal_force(contact_state(loop)))
    model = path_model(loop, contact_state(loop), law, closure, "blocked", None)
    model = replace(model, symmetry=loop_symmetry(loop).along_axes())
    return Fan(model, control, np.radians(degrees), reach)


@pytest.mark.parametrize(("length", "kn"), [(1.0, 1.0), (2.0**-9, 2.0**30)])
def test_distances_to_events_are_shares_of_the_reach(length, kn):
    """Overlap over the touching distance; strength less `|T|` over kn times the distance."""
    mu, reach = 0.3, 0.25
    fan = fan_of(lopsided(), "affine", "strain", (33.0,), mu, length=length, kn=kn, overlap=0.02,
                 reach=reach)  # fmt: skip
    C = fan.model.contact_count
    T = 1e-3 * kn * length * np.arange(C)
    values, _, columns = fan.functions(LoopStates.at_rest(1, C, T), np.array([0]))
    overlap = fan.model.touching - fan.model.length0
    np.testing.assert_allclose(
        values[0, columns["opening"]], overlap / (fan.model.touching * reach), rtol=1e-9
    )
    left = (mu * kn * overlap - T) / (fan.model.stiffness * fan.model.length * reach)
    np.testing.assert_allclose(values[0, columns["yield"]], left, rtol=1e-9)


def test_contacts_that_stick_tend_to_slide_the_way_they_are_loaded():
    """`s T' - mu N'`, with the sign `s` of `T`, and that of `T'` where `T` is zero."""
    fan = fan_of(lopsided(), "affine", "strain", (33.0,), 0.3, overlap=0.02)
    T = 1e-3 * np.array([1.0, -1.0, 0.0, 1.0, -1.0])
    states = LoopStates.at_rest(1, 5, T)
    rates, shift = fan.rates(states, np.array([0]))
    normal, beyond = fan.edges(states, rates, shift)
    way = np.where(T == 0.0, np.sign(rates.shear_force), np.sign(T))
    assert set(np.sign(T * rates.shear_force[0]).tolist()) == {-1.0, 0.0, 1.0}
    np.testing.assert_allclose(beyond, way * rates.shear_force - 0.3 * normal, rtol=1e-12)


def lopsided():
    return random_loop(5, 3, polydispersity=0.3, strain=0.0)


@pytest.fixture
def steps(monkeypatch):
    """Every step of a fan: lengths, and errors over the tolerance."""
    taken, step = [], Fan.step

    def counted(self, states, rows, h):
        after, error = step(self, states, rows, h)
        taken.append((h.copy(), error))
        return after, error

    monkeypatch.setattr(Fan, "step", counted)
    return taken


SCENES = {
    "affine": (regular_polygon(5), "affine", "strain", (33.0, -40.0), 0.2, 0.0),
    "slips": (lopsided(), "traction", "strain", (62.0,), 0.3, 0.01),
    "lost by a slip": (lopsided(), "traction", "strain", (33.0,), 0.3, 0.01),
    "stress": (lopsided(), "traction", "stress", (20.0,), 0.3, 0.01),
    "affine stress": (regular_polygon(5), "affine", "stress", (62.0,), 0.3, 0.01),
}


@pytest.mark.parametrize("scene", SCENES)
def test_a_fan_has_the_same_limits_and_steps_in_other_units(scene, steps):
    loop, closure, control, degrees, mu, overlap = SCENES[scene]
    found = []
    length, kn = 2.0**-9, 2.0**30
    for units in ({}, {"length": length, "kn": kn}):
        steps.clear()
        fan = fan_of(loop, closure, control, degrees, mu, overlap=overlap, **units)
        limits = first_limits(fan, LoopStates.at_rest(1, fan.model.contact_count))
        found.append((limits, len(steps)))
    (plain, count), (limits, other_count) = found
    assert any(plain.found[kind].any() for kind in LIMITS)
    # Rounding decides on the last correction of an event's place.
    assert abs(other_count - count) <= 3
    np.testing.assert_array_equal(limits.open_question, plain.open_question)
    for kind in LIMITS:
        there = plain.found[kind]
        np.testing.assert_array_equal(limits.found[kind], there)
        one, other = plain.states[kind].take(there), limits.states[kind].take(there)
        np.testing.assert_array_equal(other.regime, one.regime)
        for name, unit in (("H", 1.0), ("moved", length), ("shear_force", kn * length)):
            np.testing.assert_allclose(
                getattr(other, name) / unit, getattr(one, name), rtol=0, atol=1e-12
            )


def test_steps_use_the_error_that_they_may_make(steps):
    """Each next one, but for bounds, aims at 0.9^8 of the tolerance with an error of order 8."""
    fan = fan_of(lopsided(), "traction", "strain", (40.0,), overlap=0.01)
    limits = first_limits(fan, LoopStates.at_rest(1, 5))
    # Before the first event.
    (h, error), longest = np.array(steps[:30])[..., 0].T, MAX_STEP * fan.reach
    assert h[error <= 1.0].sum() < np.hypot(*limits.states["cone_opening"].H[0, [0, 3]])
    aimed = h * (0.9**8 / error) ** 0.125
    np.testing.assert_allclose(h[1:], np.minimum(aimed, longest)[:-1], rtol=1e-12)
    assert h[0] == longest and np.count_nonzero(error > 1.0) > 3


def test_the_last_step_ends_at_the_reach(steps):
    fan = fan_of(lopsided(), "traction", "strain", (40.0,), overlap=0.01, reach=0.4)
    limits = first_limits(fan, LoopStates.at_rest(1, 5))
    assert not any(limits.found[kind].any() for kind in LIMITS)
    lengths = np.concatenate([h[error <= 1.0] for h, error in steps])
    assert lengths.sum() == pytest.approx(fan.reach, rel=1e-12)
    assert 0.5 < lengths[-1] / lengths[-2] < 0.95


@pytest.mark.parametrize("reach", [0.21, 0.3])
def test_smooth_programmes_take_their_longest_steps_and_end_at_their_reach(reach, steps):
    fan = fan_of(regular_polygon(4), "affine", "strain", (44.0,), reach=reach)
    limits = first_limits(fan, LoopStates.at_rest(1, 4))
    lengths = np.concatenate([h for h, _ in steps])
    np.testing.assert_allclose(lengths, np.full(25, MAX_STEP * reach), rtol=1e-12)
    assert not limits.open_question.any()


def test_a_fan_of_programmes_without_regimes_at_the_start_is_left_open(monkeypatch):
    """After each contact has had its regime changed twice, and once more."""
    asked, edges = [], Fan.edges
    monkeypatch.setattr(Fan, "edges", lambda *args: asked.append(1) or edges(*args))
    fan = fan_of(lopsided(), "traction", "stress", (62.0,), 0.3)
    limits = first_limits(fan, LoopStates.at_rest(1, 5))
    if not limits.open_question.all():
        pytest.skip("on this processor rounding finds regimes at this edge")
    assert not any(limits.found[kind].any() for kind in LIMITS)
    # And once for the events of no programme.
    assert len(asked) == 2 * 5 + 2 + 1


def test_a_singular_state_leaves_the_others_their_rates():
    """Without any stiffness there are no rates; those beside it are the ones found alone."""
    fan = fan_of(lopsided(), "traction", "strain", (40.0, 50.0), overlap=0.01)
    k = fan.stiffnesses(LoopStates.at_rest(3, 5))
    alone = fan.blocks[0].solve(k[:1], fan.model.volume)
    k[1] = 0.0
    found = fan.blocks[0].solve(k, fan.model.volume)
    np.testing.assert_array_equal(found[[0, 2]], alone[[0, 0]])
    assert np.isnan(found[1]).all()


def test_balances_are_compared_with_those_of_the_last_step():
    """The ratio of the determinants, within what a number holds; 1 at the state itself."""
    fan = fan_of(regular_polygon(5), "traction", "strain", (40.0,))
    rows, limits = np.arange(1), FanLimits.none(1, 5)
    start = LoopStates.at_rest(1, 5)
    later = fan.step(start, rows, np.array([0.1]))[0]
    balance = np.zeros((1, len(fan.blocks), 2))
    _set_balance(fan, balance, start, rows)

    def ratios(states):
        values, columns = _pending(fan, limits, balance, states, rows)
        return values[0, columns["balance"]]

    before, after = (
        [np.linalg.det(block.balance(fan.stiffnesses(states)))[0] for block in fan.blocks]
        for states in (start, later)
    )
    np.testing.assert_array_equal(ratios(start), 1.0)
    np.testing.assert_allclose(ratios(later), np.divide(after, before), rtol=1e-9)
    balance[..., 1] += 1e4
    np.testing.assert_array_equal(ratios(start), np.exp(-700.0))
    balance[..., 1] -= 2e4
    np.testing.assert_array_equal(ratios(start), np.exp(50.0))


@pytest.mark.parametrize("h", [0.1, 0.25])
def test_events_within_a_long_step_are_where_the_integration_finds_them(h):
    """The interpolant is off by far more than the place that is returned."""
    fan = fan_of(lopsided(), "traction", "strain", (20.0, 40.0), 0.25, overlap=0.02)
    start, rows = LoopStates.at_rest(2, 5), np.arange(2)
    size = np.full(2, h)
    after = fan.step(start, rows, size)[0]
    balance, limits = np.zeros((2, len(fan.blocks), 2)), FanLimits.none(2, 5)
    _set_balance(fan, balance, start, rows)
    pending = partial(_pending, fan, limits, balance)
    there, share, fired = _to_event(fan, pending, start, after, rows, size, np.zeros(2))
    inside, every = share < 1.0, np.arange(2)
    assert inside.all() == (h > 0.2) and (fired >= 0).tolist() == inside.tolist()
    np.testing.assert_array_equal(there.moved, fan.step(start, rows, share * size)[0].moved)
    between = fan.interpolant(start, rows, size)(share, rows)
    found, off = (pending(states, rows)[0][every, fired][inside] for states in (there, between))
    np.testing.assert_allclose(found, 0.0, rtol=0, atol=1e-13)
    assert (np.abs(off) > 1e-7).all()


@pytest.mark.parametrize("scene", SCENES)
def test_a_single_path_has_the_limits_and_their_states(scene):
    """Where regimes change at a limit the state is the one after it."""
    loop, closure, control, degrees, mu, overlap = SCENES[scene]
    fan = fan_of(loop, closure, control, degrees[:1], mu, overlap=overlap)
    limits = first_limits(fan, LoopStates.at_rest(1, 5))
    start = GrainGraph(x=loop.x, radii=(1.0 + overlap) * loop.radii, contacts=loop.contacts)
    start = start.replace(normal_force=fan.model.law.normal_force(contact_state(start)))
    single = FanLimits.none(1, 5)
    single.open_question[:] = True
    followed_limits(fan, 0, single, "blocked", start)
    assert not single.open_question[0]
    seen = [kind for kind in LIMITS if limits.found[kind][0]]
    # The fan ends where det K is lost, and tells no limit of the stress there.
    assert seen == [kind for kind in LIMITS if single.found[kind][0] and kind != "limit"] or (
        limits.found["limit"][0] and single.found["limit"][0]
    )
    for kind in seen:
        # At a limit no regimes agree: neither has those after it.
        for name in ("H", "moved", "shear_force", *(("regime", "side") if kind != "limit" else ())):
            one, other = (getattr(each.states[kind], name) for each in (limits, single))
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-11, err_msg=f"{kind} {name}")


def test_forces_of_sliding_contacts_change_as_their_strength():
    """Central differences of T over steps to either side."""
    fan, rows = fan_of(lopsided(), "traction", "strain", (35.0,), 0.3, overlap=0.02), np.arange(1)
    start = LoopStates.at_rest(1, 5)
    start.regime[0, [1, 3]], start.side[0, [1, 3]] = Regime.SLIDING, (1.0, -1.0)
    start = replace(start, shear_force=fan.contacts(start).shear_force)
    wanted = fan.rates(start, rows)[0].shear_force
    errors = []
    for h in (2e-3, 1e-3):
        low, high = (
            fan.contacts(fan.step(start, rows, np.array([way]))[0]).shear_force for way in (-h, h)
        )
        errors.append(np.abs((high - low) / (2 * h) - wanted).max())
    assert np.abs(wanted[0, [1, 3]]).min() > 0.01
    assert errors[0] < 1e-4 and np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)


def test_a_step_forwards_gives_the_heading():
    fan, rows = fan_of(lopsided(), "traction", "stress", (35.0, 50.0, 20.0)), np.arange(3)
    start = LoopStates.at_rest(3, 5)
    start.heading[:] = 1.0
    after = fan.step(start, rows, np.array([0.1, 0.0, -0.1]))[0]
    np.testing.assert_allclose(after.heading[0], after.H[0, [0, 3]], rtol=0, atol=1e-15)
    np.testing.assert_array_equal(after.heading[1:], start.heading[1:])


def test_the_strain_goes_on_to_the_side_of_its_heading():
    """`H' = A^-1 P'` of unit length, or its opposite where the angle to the heading is obtuse."""
    headings = np.array([[1.0, -3.0], [-1.0, 3.0], [1.0, -0.5], [-1.0, 0.5], [0.0, 0.0]])
    fan, rows = fan_of(lopsided(), "traction", "stress", np.full(5, 35.0)), np.arange(5)
    A = np.tile(np.eye(4), (5, 1, 1))
    A[:, 0, 0], A[:, 0, 3], A[:, 3, 0] = 2.0, 0.5, -0.3
    P = np.array([np.cos(fan.programme[0]), np.sin(fan.programme[0])])
    forwards = np.linalg.solve(A[0][np.ix_([0, 3], [0, 3])], P)
    forwards /= np.hypot(*forwards)
    side = np.append(np.sign(headings[:4] @ forwards), 1.0)
    found = fan.strain_rate(A, rows, headings)
    np.testing.assert_allclose(found[:, [0, 3]], side[:, None] * forwards, rtol=0, atol=1e-15)


@pytest.mark.parametrize("closure", ["affine", "traction"])
def test_without_a_tangent_stability_is_lost(closure):
    """Nothing of a loop without contacts resists; its tangent is zero or not a number."""
    fan, rows = fan_of(lopsided(), closure, "strain", (35.0,), overlap=0.02), np.arange(1)
    apart = LoopStates.at_rest(1, 5)
    apart.regime[:] = Regime.OPEN
    values, _, columns = fan.functions(apart, rows)
    wanted = [0.0, -1.0, -1.0] if closure == "traction" else np.zeros(3)
    np.testing.assert_array_equal(values[0, columns["spectral"]], wanted)


AT_ODDS = [(1.0, 1.0), (2.0**-9, 2.0**30), (2.0**9, 2.0**-30)]


@pytest.mark.parametrize(("length", "kn"), AT_ODDS)
def test_a_contact_that_neither_loads_nor_unloads_keeps_its_regime(length, kn):
    """Affine rates `H' d` along n and t: |T|' is that of the strength, or off by 1e-9 of it."""
    mu, loop = 0.2, regular_polygon(6)
    options = {"length": length, "kn": kn, "overlap": 0.05, "reach": 0.01}
    d = fan_of(loop, "affine", "strain", (0.0,), mu, **options).model.d0[1]
    n = d / np.hypot(*d)
    t = np.array([-n[1], n[0]])
    # KAPPA H' d.t = mu H' d.n of H' = (cos b, sin b).
    a, b = (KAPPA * t - mu * n) * n
    neutral = np.degrees(np.arctan2(-a, b)) + np.array([-1e-7, 0.0, 1e-7])
    grows = np.sign(b * np.cos(np.radians(neutral[1])) - a * np.sin(np.radians(neutral[1])))
    for regime in (Regime.ELASTIC, Regime.SLIDING):
        fan = fan_of(loop, "affine", "strain", neutral, mu, **options)
        start = LoopStates.at_rest(1, 6)
        start.regime[0, 1], start.side[0, 1] = regime, float(regime == Regime.SLIDING)
        N = fan.contacts(start).normal_force[0, 1]
        start.shear_force[0, 1] = mu * N
        limits = first_limits(fan, start)
        at_once = limits.found["yield"] & (limits.states["yield"].H == 0.0).all(axis=1)
        expected = [grows < 0, regime == Regime.SLIDING, grows > 0]
        np.testing.assert_array_equal(at_once, expected)


@pytest.mark.parametrize(("length", "kn"), AT_ODDS)
def test_branches_that_keep_their_length_do_not_part(length, kn):
    """Those of a hexagon along the first axis: not at all but for rounding, then by 1e-10."""
    options = {"length": length, "kn": kn, "reach": 0.01}
    degrees = 90.0 + np.degrees([0.0, 1e-10])
    fan = fan_of(regular_polygon(6), "affine", "strain", degrees, **options)
    limits = first_limits(fan, LoopStates.at_rest(1, 6))
    at_once = limits.found["opening"] & (limits.states["opening"].H == 0.0).all(axis=1)
    assert at_once.tolist() == [False, True]
