"""Every limit of the checks between an example just within and one just beyond it.

The packing is a triangular lattice of equal discs in a periodic cell under uniform forces: exactly
balanced, each number known. A limit that is halved or doubled is noticed by one of the examples.
"""

import dataclasses

import numpy as np
import pytest

from loops import CohesiveFrictional, GrainGraph, HertzMindlin, LinearFrictional, Regime
from patterns import Snapshot
from patterns.snapshots import checked, checks, findings, missing, slip_check, stiffness_checks
from patterns.snapshots.slip_check import check_kt

HOMES = (checks, checked, findings, missing, slip_check, stiffness_checks, HertzMindlin)

OVERLAP = 1e-3


def lattice(rows, columns):
    """Cell, centres, contacts, images and branches of a triangular lattice of unit spacing."""
    i, j = (k.ravel() for k in np.meshgrid(np.arange(columns), np.arange(rows)))
    basis = np.array([[1.0, 0.5], [0.0, np.sqrt(0.75)]])
    steps = np.repeat([[1, 0], [0, 1], [-1, 1]], len(i), axis=0)
    own = np.tile(np.column_stack([i, j]), (3, 1))
    other = own + steps
    size = np.array([columns, rows])
    images = other // size
    wrapped = other - images * size
    contacts = np.column_stack([own @ [1, columns], wrapped @ [1, columns]])
    x = np.column_stack([i, j]) @ basis.T
    return basis * size, x, contacts, images, steps @ basis.T


def state(
    *,
    size=(6, 6),
    normal=1.0,
    shear=0.0,
    kn=1 / OVERLAP,
    kt=0.5 / OVERLAP,
    mu=0.5,
    sliding=None,
    radii=1.0,
    length=1.0,
    turned=None,
    pushed=None,
    digits=None,
    kept=None,
):
    """The lattice with some of its numbers changed, as the checks take it.

    Radii, distances and forces are given as factors or values for all contacts or each; `pushed`
    are forces on the grains, `turned` the angle of the file's normals, `kept` the contacts.
    """
    cell, x, contacts, images, d = lattice(*size)
    kept = np.ones(len(contacts), bool) if kept is None else kept
    contacts, images, d = contacts[kept], images[kept], d[kept]
    if digits is not None:
        x = np.array([[float(f"{value:.{digits}g}") for value in row] for row in x])
    each = np.ones(len(contacts))
    graph = GrainGraph(
        x=x,
        radii=np.full(len(x), radii * (1 + OVERLAP) / 2),
        contacts=contacts,
        images=images,
        cell=cell,
        normal_force=normal * each,
        shear_force=shear * each,
    )
    regime = None
    if sliding is not None:
        slides = np.broadcast_to(sliding, each.shape)
        regime = np.where(slides, Regime.SLIDING, Regime.ELASTIC).astype(np.int8)
    law = LinearFrictional(kn=kn * each, kt=kt * each, mu=mu * each)
    given = None
    if turned is not None:
        c, s = np.cos(turned), np.sin(turned)
        given = d @ np.array([[c, s], [-s, c]])
    walls = None if pushed is None else (np.arange(len(x)), pushed)
    return checked.Checked(
        graph,
        (length * each)[:, None] * d,
        length * each,
        law,
        regime,
        given,
        walls,
        np.arange(len(x)),
    )


COUNT = 108
# Share of an edge that stands out of this scatter, as it is found.
EDGE = 3.5e-6


def one(value, rest=1.0, count=1, of=COUNT):
    """One contact, or the first few, with another value."""
    values = np.full(of, float(rest))
    values[:count] = value
    return values


def severity(found):
    return "none" if found is None else found.severity


def residuals(shear, size=(6, 6)):
    """Forces that these shears leave on the grains."""
    made = state(shear=shear, size=size)
    return made.residuals[1]


RANDOM = np.random.default_rng(1).uniform(-0.3, 0.3, COUNT)
SPREAD = np.random.default_rng(2).uniform(0.0, 0.45, COUNT)
UNEVEN = np.random.default_rng(3).uniform(0.3, 2.0, COUNT)


def out_of_balance(ratio, size=(6, 6)):
    """A lattice whose residual with shear turned around is a share of the one as given."""
    shear = RANDOM[: 3 * size[0] * size[1]]
    rest = (1 - ratio) / (1 + ratio) * residuals(shear, size)
    return state(shear=shear, size=size, pushed=rest)


def alternating(force):
    """Forces of one size on all grains, in both directions by turns."""
    return np.outer(np.where(np.arange(36) % 2 == 0, 1.0, -1.0), [force, 0.0])


def alike(count, spread=0.0, size=(6, 6)):
    """Contacts of which a few share one ratio |T|/N up to a spread."""
    of = 3 * size[0] * size[1]
    shear = np.random.default_rng(2).uniform(0.0, 0.45, of)
    shear[:count] = 0.3 * (1 + np.linspace(0, spread, count))
    return state(shear=shear, size=size)


def off_radii(share, noise=0.0, overlap=OVERLAP, **options):
    """Distances that fit the forces, with radii too large by a share."""
    uneven = UNEVEN + noise * np.random.default_rng(4).normal(size=COUNT)
    length = (1 + OVERLAP) - overlap * UNEVEN
    return state(normal=uneven, length=length, radii=1 + share, kn=1 / overlap, **options)


def weak(size):
    """Result of the friction check for ten weak contacts beyond their limit."""
    return severity(checks.friction(state(normal=one(size, count=10), shear=one(size, 0, 10))))


def unflagged(count, ratio=1.0, flagged=0):
    shear = one(0.5 * ratio, 0.1, count + flagged)
    flags = np.zeros(COUNT, bool)
    flags[count : count + flagged] = True
    return state(shear=shear, sliding=flags)


def flagged(ratio, count=COUNT):
    return state(shear=0.5 * one(ratio, 1.0, count), sliding=np.ones(COUNT, bool))


def without(count):
    """Contacts that all slide, without some."""
    kept = np.arange(COUNT) >= count
    return state(kept=kept, shear=0.5, sliding=np.ones(COUNT - count, bool))


def snapshots(factor=1.0, wrong=0.0, size=8, rotations=True, kt=0.5 / OVERLAP):
    """A lattice before and after small motions, T as the motions and a factor on kt give it."""
    rng = np.random.default_rng(5)
    cell, x, contacts, images, _ = lattice(size, size)
    count = len(contacts)
    radii = np.full(len(x), (1 + OVERLAP) / 2)
    shift, spin = 1e-5 * rng.normal(size=x.shape), 1e-5 * rng.normal(size=len(x))
    law = LinearFrictional(kn=1 / OVERLAP, kt=kt, mu=0.5, shear_increment="radii")
    regime = np.zeros(count, np.int8)
    found, branches = [], []
    for moved in (0.0, 1.0):
        there = x + moved * shift
        branches.append(there[contacts[:, 1]] - there[contacts[:, 0]] + images @ cell.T)
        shear = np.zeros(count)
        if moved:
            (ax, ay), (bx, by) = (b.T for b in branches)
            turn = np.arctan2(ax * by - ay * bx, ax * bx + ay * by)
            slip = radii[0] * (2 * turn - spin[contacts].sum(axis=1))
            shear = -factor * kt * slip
            other = rng.random(count) < wrong
            shear[other] *= rng.choice([-3, -2, 3, 4], np.count_nonzero(other))
        graph = GrainGraph(
            x=there,
            radii=radii,
            contacts=contacts,
            images=images,
            cell=cell,
            normal_force=np.ones(count),
            shear_force=shear,
        )
        angles = moved * spin if rotations else None
        ids = np.arange(len(x))
        found.append(Snapshot(graph, law, regime, ids, 0, (), rotation=angles))
    return found


def kt(*arguments, **options):
    return severity(check_kt(*snapshots(*arguments, **options)))


def told(*arguments, **options):
    return check_kt(*snapshots(*arguments, **options)).says.endswith("(median)")


def says(text, function):
    return lambda made: text in function(made).says


def of(function):
    return lambda made: severity(function(made))


def coarse_directions(multiple):
    """Normals turned by a multiple of what six digits of the centres tell."""
    coarse = 2 * findings.rounding(state(digits=6).x) + findings.rounding(lattice(6, 6)[4])
    return state(digits=6, turned=multiple * coarse)


def coarse_overlaps(multiple, kn=10.0):
    """Overlaps of a multiple of the rounding of centres with six digits, and kn that are off."""
    overlap = multiple * findings.rounding(state(digits=6).x)
    return state(digits=6, length=1 + OVERLAP - overlap, kn=kn / overlap)


def on_rim(gap):
    """Whether a grain so many radii from the border of the box counts as on it."""
    x = np.array([[0.0, 0.0], [10.0, 10.0], [gap, 5.0]])
    return bool(checked.on_rim(x, np.ones(3), np.ones(3, bool))[2])


def scattered(ratio, spread=0.02):
    """Forces above and below what overlaps give, by turns."""
    return state(normal=ratio * (1 + spread * by_turns(COUNT)))


def by_turns(count):
    return np.where(np.arange(count) % 2 == 0, 1.0, -1.0)


def hertzian(ratio, power=0.5, spread=None, size=(6, 6)):
    """Stiffnesses that go with a power of the overlap, and N a share of kn times it."""
    overlap = OVERLAP * UNEVEN[: 3 * size[0] * size[1]]
    if spread is not None:
        overlap = OVERLAP * np.exp(spread * by_turns(COUNT))
    kn = overlap**power
    made = {"kn": kn, "kt": 0.5 * kn, "normal": ratio * kn * overlap}
    return state(length=1 + OVERLAP - overlap, size=size, **made)


def odd(share, noise):
    """Forces with some noise, one of them larger by a share."""
    return np.append(1 + share, (1 + noise * by_turns(COUNT))[1:])


def large_grain(share, noise=0.0, right=0):
    """A grain whose radius is too large by a share; a few of its contacts fit nevertheless."""
    contacts = lattice(6, 6)[2]
    length = np.ones(COUNT)
    length[np.flatnonzero((contacts == 8).any(axis=1))[:right]] += share * (1 + OVERLAP) / 2
    normal = 1 + noise * by_turns(COUNT)
    return state(radii=np.where(np.arange(36) == 8, 1 + share, 1.0), length=length, normal=normal)


def thin(multiple):
    """A contact left out that overlaps by so many times what may be lost."""
    kept = np.arange(COUNT) > 0
    return state(radii=(1 + 1e-6) / (1 + OVERLAP), length=1 + 1e-6 - 0.01 / multiple, kept=kept)


def barely(multiple):
    """A contact left out that overlaps by so many times what six digits tell."""
    overlap = 2 * multiple * state(digits=6, radii=np.pi / 3).rounded
    kept = np.arange(COUNT) > 0
    return state(digits=6, radii=(1 + overlap) / (1 + OVERLAP), kept=kept)


def across_gaps(count):
    """A contact left out, where some others carry their load across a gap."""
    return state(length=one(1.5, count=count, of=COUNT - 1), kept=np.arange(COUNT) > 0)


def coarse(multiple):
    """Overlaps of which six digits leave so many hundredths open."""
    typical = state(digits=6).rounded / (0.01 * multiple)
    return state(digits=6, length=1 + OVERLAP - typical, kn=1 / typical)


def ring(count=10, push=1.0, stopped=0, cosine=1.0):
    """Grains around one that pushes them outward; walls push back but for a share.

    Each has another contact, tangential in all but a few of them, which carries nothing.
    """
    angle = 2 * np.pi * np.arange(count) / count
    u, t = (
        np.column_stack([np.cos(angle), np.sin(angle)]),
        np.column_stack([-np.sin(angle), np.cos(angle)]),
    )
    along = np.where(np.arange(count) < stopped, cosine, 0.0)[:, None]
    d = np.concatenate([u, along * u + np.sqrt(1 - along**2) * t])
    own = np.arange(count)
    contacts = np.concatenate(
        [np.column_stack([np.full(count, 2 * count), own]), np.column_stack([own, own + count])]
    )
    x = np.concatenate([3 * u, 4 * u, np.zeros((1, 2))])
    normal = np.repeat([1.0, 0.0], count)
    graph = GrainGraph(x=x, radii=np.ones(len(x)), contacts=contacts, normal_force=normal)
    law = LinearFrictional(1.0, 0.5, 0.5)
    length = np.ones(2 * count)
    walls = own, (push - 1) * u
    return checked.Checked(graph, d, length, law, None, None, walls, np.arange(len(x)))


# Limit, its place if it is one of two; what is looked at, within and beyond; the two answers.
balance, turned = of(checks.balance), of(checks.one_contact_turned)
ratio, sliding, flags = of(checks.one_ratio), of(checks.sliding), of(checks.flags)
stiffness, distances, radii = (
    of(stiffness_checks.stiffness),
    of(checks.distances),
    of(stiffness_checks.radii),
)
friction, same = of(checks.friction), of(checks.same_snapshot)
one_radius, one_contact = of(stiffness_checks.one_radius), of(stiffness_checks.one_contact)
hertz_told = says("Hertz", stiffness_checks.stiffness)
lost, outward = of(missing.lost_contacts), of(missing.walls)


def pulled(share):
    """A state in which one contact pulls with this share of its adhesion."""
    law = CohesiveFrictional(1.0, 0.5, 0.5, 1.0)
    return dataclasses.replace(state(normal=one(-share)), law=law)


def one_force(size, left=1.0):
    """A state in which one contact carries a force, which its grains balance but for a share."""
    normal = one(size)
    pushed = (left - 1.0) * state(normal=normal).resultants[0]
    return state(normal=normal, pushed=pushed)


def long_cell(share, noise=0.0):
    """Branches across the border along x as an edge gives them that is too long by a share."""
    made = state()
    across = made.graph.images[:, 0] * (made.d @ made.graph.cell[:, 0])
    scatter = noise * np.random.default_rng(5).normal(size=COUNT)
    return state(length=1 + share * across + scatter)


cell = of(missing.cell)
LIMITS = [
    ("STANDS_OUT", of(checks.unbalanced), one_force(18.0), one_force(22.0)),
    ("UNBALANCED", of(checks.unbalanced), one_force(80.0, 0.25), one_force(80.0, 0.36)),
    ("EDGE_ERRORS", cell, *(long_cell(s, 1e-5) for s in (0.8 * EDGE, 1.25 * EDGE))),
    ("EDGE_SHIFT", cell, *(long_cell(s * OVERLAP / 6) for s in (0.25, 0.36))),
    ("LOADED", weak, 0.08, 0.12),
    ("ALONG", of(checks.directions), *(state(shear=np.sqrt(s**-2 - 1)) for s in (0.48, 0.33))),
    ("PULLING", of(checks.pulling), state(normal=one(-1.74)), state(normal=one(-2.74))),
    ("PULL", of(checks.pulling), pulled(0.9), pulled(1.5)),
    ("BALANCE", balance, state(normal=one(1.34)), state(normal=one(1.53))),
    ("SHEAR_TURNED", balance, out_of_balance(0.375), out_of_balance(0.24)),
    ("CONTACT_TURNED", turned, state(normal=one(-0.571)), state(normal=one(-0.676))),
    ("JUDGED", turned, *(state(normal=one(-1.0), pushed=alternating(f)) for f in (0.125, 0.08))),
    (
        "WEAKEST",
        turned,
        *(state(shear=one(a, 0), pushed=residuals(one(a, 0))) for a in (4e-4, 6.25e-4)),
    ),
    ("BEYOND_COULOMB", friction, *(state(shear=0.5 * one(q, 0.1, 6)) for q in (1.005, 1.02))),
    ("BEYOND_SHARE", friction, *(state(shear=0.5 * one(1.1, 0.1, n)) for n in (2, 3))),
    (("DEGREES", 0), friction, state(mu=4.0), state(mu=6.0)),
    (("DEGREES", 1), friction, state(mu=100.0), state(mu=80.0)),
    ("ONE_RATIO", ratio, alike(5, 1.25e-6), alike(5, 0.8e-6)),
    ("AT_ONE_RATIO", ratio, alike(4), alike(6)),
    ("AT_ONE_RATIO", flags, unflagged(4), unflagged(6)),
    ("AT_ONE_RATIO_SHARE", ratio, alike(7, size=(52, 52)), alike(9, size=(52, 52))),
    (("AT_LIMIT", 0), sliding, flagged(0.97), flagged(0.93)),
    (("AT_LIMIT", 1), sliding, flagged(1.04), flagged(1.06)),
    (
        ("AT_LIMIT", 0),
        ratio,
        *(state(shear=np.append(SPREAD[6:], 6 * [q / 2])) for q in (0.97, 0.93)),
    ),
    ("FEW_BELOW", sliding, flagged(0.8, 5), flagged(0.8, 6)),
    ("SLIDING_SHARE", flags, unflagged(10, 0.9985), unflagged(10, 0.9995)),
    ("STIFFNESS_OFF", stiffness, state(normal=0.996), state(normal=0.994)),
    ("ERRORS", stiffness, scattered(1.013), scattered(1.021)),
    (
        "overlap_power",
        says("--law hertz", stiffness_checks.stiffness),
        hertzian(0.7),
        hertzian(2 / 3),
    ),
    ("ROOT_BAND", hertz_told, *(hertzian(2 / 3, power=p) for p in (0.75, 0.65))),
    ("LEAST_SPREAD", hertz_told, *(hertzian(2 / 3, spread=s) for s in (0.08, 0.125))),
    (
        "NEAR_ROUND",
        says("10^4", stiffness_checks.stiffness),
        state(normal=10**4.07),
        state(normal=10**4.04),
    ),
    ("NEAR_ROUND", stiffness, state(kt=1.04 / OVERLAP), state(kt=1.06 / OVERLAP)),
    ("ODD_SHARE", one_radius, *(large_grain(s) for s in (1.6e-5, 2.5e-5))),
    ("OF_GRAIN", one_radius, *(large_grain(s, noise=0.01) for s in (1.6e-4, 2.9e-4))),
    ("AGREEING_CONTACTS", one_radius, *(large_grain(1e-3, right=n) for n in (2, 1))),
    ("OF_CONTACT", one_contact, *(state(normal=odd(k, 0.002)) for k in (0.09, 0.14))),
    ("FEW_WRONG", one_contact, *(state(normal=one(2.0, count=n)) for n in (13, 9))),
    ("LOST_OVERLAP", lost, *(thin(k) for k in (0.8, 1.25))),
    ("LOST_ROUNDINGS", lost, *(barely(k) for k in (0.8, 1.25))),
    ("FEW_APART", lost, *(across_gaps(n) for n in (2, 1))),
    ("PUSHED", outward, ring(push=0.12), ring(push=0.19)),
    ("AGAINST", outward, ring(stopped=10, cosine=0.8), ring(stopped=10, cosine=0.6)),
    ("BARE_SHARE", outward, ring(stopped=4), ring(stopped=2)),
    ("FEWEST_BARE", outward, ring(4), ring(6)),
    ("OPEN_DIGITS", says("digits", checks.unseen), *(coarse(k) for k in (0.8, 1.25))),
    (
        ("DIAMETERS", 0),
        says("diameters", checks.distances),
        state(radii=1 / 0.24),
        state(radii=1 / 0.26),
    ),
    (("DIAMETERS", 1), distances, state(radii=1 / 0.62), state(radii=1 / 0.58)),
    ("SOFT_GRAINS", distances, state(radii=1 / 0.86), state(radii=1 / 0.84)),
    ("LOADED_APART", distances, state(radii=1 / 1.015), state(radii=1 / 1.025)),
    ("OTHER_UNITS", distances, state(radii=1 / 1.4), state(radii=1 / 1.6)),
    ("GAPS", of(checks.touching), *(state(length=one(1.01, count=n)) for n in (1, 2))),
    ("RADII_OFF", radii, off_radii(1.5e-4), off_radii(2.5e-4)),
    ("EXPLAINED", radii, off_radii(1e-3, 0.1), off_radii(1e-3, 0.05)),
    ("DIRECTIONS_OFF", same, state(turned=2.4e-6), state(turned=3.75e-6)),
    ("JAMMED", of(checks.jammed), without(4), without(7)),
    ("FEWEST", balance, out_of_balance(0.1, (4, 4)), out_of_balance(0.1, (5, 5))),
    ("FEWEST", turned, state(size=(4, 4)), state(size=(5, 5))),
    ("FEWEST", of(checks.jammed), *(state(size=(n, n), sliding=False) for n in (4, 5))),
    ("FEWEST", radii, state(size=(2, 3)), state(size=(2, 4))),
    ("FEWEST", one_radius, state(size=(2, 3)), state(size=(2, 4))),
    ("FEWEST", one_contact, state(size=(2, 3)), state(size=(2, 4))),
    (
        "FEWEST",
        hertz_told,
        *(hertzian(2 / 3, size=(2, n)) for n in (3, 4)),
    ),
    ("FEWEST", lambda size: kt(size=size), 2, 3),
    (
        "SAME_FORCE",
        lambda off: severity(checks.same_force("fn", one(1 + off), one(1), 1.0, np.arange(COUNT))),
        8e-4,
        1.25e-3,
    ),
    ("REPEATED", lambda again: severity(checks.repeated(0, again, 100, np.zeros(1))), 60, 40),
    ("ROUNDINGS", same, *(coarse_directions(k) for k in (4, 6.25))),
    ("ROUNDINGS", radii, *(off_radii(s, digits=6, overlap=0.02) for s in (3e-4, 5e-4))),
    ("OVERLAP_ROUNDINGS", stiffness, *(coarse_overlaps(k) for k in (1.6, 2.5))),
    ("RIM", on_rim, 0.06, 0.04),
    ("KT", kt, 1.08, 1.13),
    ("AGREEING", lambda wrong: told(1.0, wrong), 0.6, 0.4),
]


# What a check may answer.
WORSE = ("none", "ok", "doubt", "error")


def answers(one):
    # A state keeps what was computed with other limits.
    _, look, *made = one
    made = [dataclasses.replace(m) if isinstance(m, checked.Checked) else m for m in made]
    return look(made[0]), look(made[1])


IDS = [f"{one[0] if isinstance(one[0], str) else one[0][0]}-{k}" for k, one in enumerate(LIMITS)]


@pytest.mark.parametrize("limit", LIMITS, ids=IDS)
def test_examples_on_both_sides(limit):
    """The answer beyond a limit is the worse one, or a statement that holds there alone."""
    within, beyond = answers(limit)
    if isinstance(within, str):
        within, beyond = (WORSE.index(answer) for answer in (within, beyond))
    assert within < beyond


@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.parametrize("limit", LIMITS, ids=IDS)
def test_a_limit_that_moves_is_noticed(limit, factor, monkeypatch):
    before = answers(limit)
    name, place = limit[0] if isinstance(limit[0], tuple) else (limit[0], None)
    holders = [module for module in HOMES if hasattr(module, name)]
    value = getattr(holders[0], name)
    if place is None:
        moved = factor * value
    else:
        moved = tuple(factor * v if k == place else v for k, v in enumerate(value))
    for module in holders:
        monkeypatch.setattr(module, name, moved)
    assert answers(limit) != before


def test_every_limit_has_its_examples():
    found = {
        (name, place) if isinstance(value, tuple) else name
        for module in HOMES
        for name, value in vars(module).items()
        if name.isupper() and name not in ("TYPE_CHECKING", "SEVERITIES", "MOST_CROSSINGS")
        for place in (range(len(value)) if isinstance(value, tuple) else (None,))
    }
    found.add("overlap_power")
    # Numbers of the fit of rotations, which the next test holds, laws that files are read with, and
    # numbers that stand for missing values.
    found -= {("MISSING", k) for k in range(len(checks.MISSING))}
    assert found - {"FITTED", "REWEIGHTED", "READ_LAWS", "FEW_FORCES"} == {
        limit[0] for limit in LIMITS
    }


@pytest.mark.parametrize("factor", [0.5, 1.0, 1.5])
def test_kt_is_found_without_rotations(factor, monkeypatch):
    """A contact in fifty slid in between: least squares that weigh it down find the factor."""
    pair = snapshots(factor, 0.02, size=12, rotations=False)
    found = check_kt(*pair)
    assert found.number == pytest.approx(factor, rel=1e-3)
    assert found.severity == ("ok" if factor == 1 else "doubt")
    monkeypatch.setattr(slip_check, "REWEIGHTED", 1)
    assert check_kt(*pair).number != pytest.approx(factor, rel=1e-3)
    monkeypatch.undo()
    # Part of the contacts of a large packing do as well.
    monkeypatch.setattr(slip_check, "FITTED", 200)
    assert check_kt(*pair).number == pytest.approx(factor, rel=1e-2)


def test_kt_is_found_whatever_the_first_angles():
    """Rotations count from those of the first snapshot, grain by grain."""
    before, after = snapshots(1.5)
    start = np.linspace(-3, 3, len(before.ids))
    turned = [dataclasses.replace(one, rotation=one.rotation + start) for one in (before, after)]
    found = [check_kt(*pair).number for pair in ((before, after), turned)]
    assert found == pytest.approx([1.5, 1.5], rel=1e-4)


@pytest.mark.parametrize(
    ("normal", "shear", "cause"),
    [(-1.0, 0.0, "they pull"), (-1.0, 20.0, "forces of other contacts")],
)
def test_forces_that_do_not_push_are_named(normal, shear, cause):
    found = checks.directions(state(normal=normal, shear=shear))
    assert found.severity == "error" and f": {cause}" in found.says


def test_kt_is_not_checked_between_other_grains_or_equal_states():
    before, after = snapshots()
    assert check_kt(before, before) is None
    moved = dataclasses.replace(after, ids=after.ids + 1000)
    assert check_kt(before, moved) is None
    assert check_kt(dataclasses.replace(before, law=None), after) is None


@pytest.mark.parametrize("rotations", [True, False])
def test_kt_is_not_checked_without_shear_forces(rotations):
    """Grains without friction, a law without shear stiffness, and T that stays as it is."""
    assert check_kt(*snapshots(0.0, rotations=rotations)) is None
    before, after = snapshots(rotations=rotations)
    soft = dataclasses.replace(before.law, kt=0.0)
    assert check_kt(dataclasses.replace(before, law=soft), after) is None
    same = dataclasses.replace(before, graph=after.graph)
    assert check_kt(same, dataclasses.replace(after, rotation=before.rotation)) is None


def test_a_regular_packing_may_share_one_ratio():
    assert severity(checks.one_ratio(state(shear=0.2))) == "ok"
