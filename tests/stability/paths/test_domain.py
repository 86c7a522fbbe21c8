"""First limits along straight programmes: units, starts, states after a jump, contacts at yield."""

import numpy as np
import pytest

from loops import GrainGraph, LinearFrictional, Regime, Scene, contact_state
from patterns import random_loop, regular_polygon
from stability import Stage, follow
from stability.paths.domain import CONTROLS, LIMITS, Fan, FanLimits

KAPPA = 0.3


def lopsided():
    return random_loop(5, seed=2)


def fan_of(loop, closure, control, degrees, mu=np.inf, *, length=1.0, kn=1.0, overlap=0.0,
           reach=0.95, T=0.0):  # fmt: skip
    """Fan of a loop whose grains overlap by a share of their distance, in some units."""
    law = LinearFrictional(kn, KAPPA * kn, mu)
    loop = GrainGraph(
        x=length * loop.x, radii=(1.0 + overlap) * length * loop.radii, contacts=loop.contacts
    )
    N = law.normal_force(contact_state(loop))
    loop = loop.replace(normal_force=N, shear_force=T * N)
    return Fan(Scene(loop, law), closure, "blocked", control, np.radians(degrees), reach)


def limits_of(fan):
    limits = FanLimits.none(fan)
    for row in range(len(fan.programme)):
        limits.follow(fan, row)
    return limits


SCENES = {
    "affine": (regular_polygon(5), "affine", "strain", (33.0, -40.0), 0.2, 0.0),
    "slips": (lopsided(), "traction", "strain", (62.0,), 0.3, 0.01),
    "lost by a slip": (lopsided(), "traction", "strain", (33.0,), 0.3, 0.01),
    "stress": (lopsided(), "traction", "stress", (20.0,), 0.3, 0.01),
    "affine stress": (regular_polygon(5), "affine", "stress", (62.0,), 0.3, 0.01),
}


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize(("length", "kn"), [(2.0**-9, 2.0**30), (2.0**9, 2.0**-30)])
def test_limits_are_the_same_in_other_units(scene, length, kn):
    loop, closure, control, degrees, mu, overlap = SCENES[scene]
    plain, limits = (
        limits_of(fan_of(loop, closure, control, degrees, mu, overlap=overlap, **units))
        for units in ({}, {"length": length, "kn": kn})
    )
    assert any(plain.found[kind].any() for kind in LIMITS)
    for kind in (*LIMITS, "end"):
        there = plain.found[kind]
        np.testing.assert_array_equal(limits.found[kind], there)
        (H, P, x, regime), other = plain.states[kind], limits.states[kind]
        np.testing.assert_array_equal(other.regime[there], regime[there])
        for one, two, unit in ((H, other.H, 1.0), (P, other.P, kn), (x, other.x, length)):
            np.testing.assert_allclose(two[there] / unit, one[there], rtol=0, atol=1e-12)


@pytest.mark.parametrize("scene", SCENES)
def test_limits_are_events_of_the_whole_path(scene):
    """Where regimes change at a limit the state is the one after it."""
    loop, closure, control, degrees, mu, overlap = SCENES[scene]
    fan = fan_of(loop, closure, control, degrees[:1], mu, overlap=overlap)
    limits, b = limits_of(fan), np.radians(degrees[0])
    stage = Stage(CONTROLS[control](np.cos(b), np.sin(b)), "parameter", 0.95)
    path = follow(fan.loop, [stage], closure=closure, subspace=("diagonal", "symmetric"), rows=50)
    names = {"cone_opening": ("det_Ks_zero", "symmetric"), "limit": ("control_limit", "")}
    names |= {kind: (kind, "diagonal") for kind in ("det_Ks_zero", "det_K_zero")}
    seen = [kind for kind in LIMITS if limits.found[kind][0]]
    assert seen
    for kind in seen:
        found = [e for e in path.events if (e.kind, e.subspace) == names.get(kind, (kind, ""))]
        np.testing.assert_allclose(limits.states[kind].H[0], found[0].H, rtol=0, atol=1e-11)
        same = np.abs(path.H - np.array(found[0].H)).max(axis=1) < 1e-11
        after = np.flatnonzero(same)[-1]
        np.testing.assert_allclose(limits.states[kind].P[0], path.P[after], rtol=0, atol=1e-11)
        if kind != "limit":
            np.testing.assert_array_equal(limits.states[kind].regime[0], path.regime[after])


def test_programmes_without_a_limit_end_at_their_reach():
    fan = fan_of(regular_polygon(4), "affine", "strain", (44.0,), reach=0.21)
    limits = limits_of(fan)
    assert limits.found["end"][0] and not any(limits.found[kind].any() for kind in LIMITS)
    assert np.hypot(*limits.states["end"].H[0, [0, 3]]) == pytest.approx(0.21, rel=1e-12)


AT_ODDS = [(1.0, 1.0), (2.0**-9, 2.0**30), (2.0**9, 2.0**-30)]


@pytest.mark.parametrize(("length", "kn"), AT_ODDS)
def test_a_contact_slides_at_once_where_it_loads(length, kn):
    """Affine rates `H' d` along n and t: |T|' exceeds the strength's by 1e-7 of it, or not."""
    mu, loop = 0.2, regular_polygon(6)
    d = loop.reference_branches[1]
    n = d / np.hypot(*d)
    t = np.array([-n[1], n[0]])
    # KAPPA H' d.t = mu H' d.n of H' = (cos b, sin b).
    a, b = (KAPPA * t - mu * n) * n
    neutral = np.degrees(np.arctan2(-a, b)) + np.array([-1e-5, 1e-5])
    grows = np.sign(b * np.cos(np.radians(neutral[1])) - a * np.sin(np.radians(neutral[1])))
    T = np.where(np.arange(6) == 1, mu, 0.0)
    fan = fan_of(loop, "affine", "strain", neutral, mu, length=length, kn=kn, overlap=0.05,
                 reach=0.01, T=T)  # fmt: skip
    limits = limits_of(fan)
    at_once = limits.found["yield"] & (limits.states["yield"].H == 0.0).all(axis=1)
    slides = limits.states["yield"].regime[:, 1] == Regime.SLIDING
    np.testing.assert_array_equal(at_once & slides, [grows < 0, grows > 0])


@pytest.mark.parametrize(("length", "kn"), AT_ODDS)
def test_branches_that_keep_their_length_do_not_part(length, kn):
    """Those of a hexagon along the first axis: not at all but for rounding, then by 1e-9."""
    degrees = 90.0 + np.degrees([0.0, 1e-9])
    options = {"length": length, "kn": kn, "reach": 0.01}
    limits = limits_of(fan_of(regular_polygon(6), "affine", "strain", degrees, **options))
    assert limits.found["opening"].tolist() == [False, True]
    assert (limits.states["opening"].H[1] == 0.0).all()


def test_a_programme_ends_where_contacts_part_at_once():
    """A ring that just touches, drawn apart: nothing behind its start is followed."""
    fan = fan_of(regular_polygon(6), "traction", "strain", (-135.0,), 0.3)
    limits = limits_of(fan)
    assert limits.found["opening"][0] and not limits.found["yield"][0]
    for kind in ("opening", "end"):
        assert not limits.states[kind].H[0].any()
    assert (limits.states["opening"].regime[0] == 0).all()


@pytest.mark.parametrize(("overlap", "begins_lost"), [(0.29, False), (0.31, True)])
def test_a_programme_that_begins_beyond_the_loss_of_det_k_is_not_followed(overlap, begins_lost):
    """A diamond loses det K at the strain kappa/(1 + kappa): at this overlap over the distance."""
    assert (1.0 + overlap > 1.0 + KAPPA) == begins_lost
    fan = fan_of(regular_polygon(4), "affine", "strain", (10.0, 130.0), overlap=overlap, reach=0.01)
    limits = limits_of(fan)
    assert (limits.states["end"].H == 0.0).all() == begins_lost
    found = limits.found["det_K_zero"] & (limits.states["det_K_zero"].H == 0.0).all(axis=1)
    assert found.all() == begins_lost
