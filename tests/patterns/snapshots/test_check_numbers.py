"""The numbers and sentences of the checks against sums over contacts, one at a time.

The packings are no packings: lengths, forces, stiffnesses and radii are drawn one by one, so that
nothing cancels. Units are changed by powers of two, which change no digit.
"""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from loops import (
    CohesiveFrictional,
    GrainGraph,
    HertzMindlin,
    LinearFrictional,
    Regime,
    branch_vectors,
    contact_state,
)
from patterns import Snapshot
from patterns.snapshots import checked, checks, findings, missing, stiffness_checks
from patterns.snapshots.slip_check import check_kt
from tests.patterns.snapshots import test_check_limits as limits

COUNT = 60


def uneven(seed=0, *, walls=True, forces=None, **changes):
    """Contacts of 7 x 7 grains, each number of its own; `changes` replace what is drawn."""
    rng = np.random.default_rng(seed)
    x = np.column_stack([k.ravel() for k in np.meshgrid(np.arange(7.0), np.arange(7.0))])
    x += rng.uniform(-0.2, 0.2, x.shape)
    pairs = np.array([(i, j) for i in range(49) for j in range(i + 1, 49) if j - i in (1, 7, 8)])
    contacts = rng.permutation(pairs)[:COUNT]
    contacts = np.where(rng.random(COUNT)[:, None] < 0.5, contacts, contacts[:, ::-1])
    angle = rng.uniform(0, 2 * np.pi, COUNT)
    drawn = {
        "radii": rng.uniform(2.0, 4.0, 49),
        "share": rng.uniform(1e-3, 3e-3, COUNT),
        "normal": rng.uniform(20.0, 60.0, COUNT),
        "shear": rng.uniform(-9.0, 9.0, COUNT),
        "kn": rng.uniform(4e3, 8e3, COUNT),
        "kt": rng.uniform(1e3, 2e3, COUNT),
        "mu": rng.uniform(0.4, 0.7, COUNT),
        "sliding": rng.random(COUNT) < 0.2,
        "given": None,
    } | changes
    length = drawn["radii"][contacts].sum(axis=1) * (1 - drawn["share"])
    d = length[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    if forces is not None:
        n = d / length[:, None]
        drawn["normal"] = (forces * n).sum(axis=1)
        drawn["shear"] = n[:, 0] * forces[:, 1] - n[:, 1] * forces[:, 0]
    graph = GrainGraph(
        x=x,
        radii=drawn["radii"],
        contacts=contacts,
        normal_force=drawn["normal"],
        shear_force=drawn["shear"],
    )
    pushed = (np.array([0, 3, 3, 48]), rng.uniform(-9.0, 9.0, (4, 2))) if walls is True else walls
    return checked.Checked(
        graph,
        d,
        length,
        LinearFrictional(drawn["kn"], drawn["kt"], drawn["mu"]),
        np.where(drawn["sliding"], Regime.SLIDING, Regime.ELASTIC).astype(np.int8),
        drawn["given"],
        pushed or None,
        100 + np.arange(49),
    )


def in_units(made, force, length):
    """The same state in other units of force and length."""
    graph = GrainGraph(
        x=length * made.x,
        radii=length * made.radii,
        contacts=made.contacts,
        normal_force=force * made.normal,
        shear_force=force * made.shear,
        images=made.graph.images,
        cell=None if made.graph.cell is None else length * made.graph.cell,
    )
    each = np.ones(len(made.contacts))
    kn, kt = (force / length * k * each for k in (made.law.kn, made.law.kt))
    law = LinearFrictional(kn, kt, made.law.mu * each)
    if isinstance(made.law, CohesiveFrictional):
        law = CohesiveFrictional(kn, kt, made.law.mu * each, force * made.law.adhesion * each)
    regime = None
    if made.sliding is not None:
        regime = np.where(made.sliding, Regime.SLIDING, Regime.ELASTIC).astype(np.int8)
    return checked.Checked(
        graph,
        length * made.d,
        length * made.length,
        law,
        regime,
        None if made.given is None else length * made.given,
        None if made.walls is None else (made.walls[0], force * made.walls[1]),
        made.ids,
    )


def frame(made, c):
    n = made.d[c] / made.length[c]
    return n, np.array([-n[1], n[0]])


def total_forces(made, sign=1.0):
    """Resultants on the grains that count, contact by contact, less the best body force."""
    found = {g: np.zeros(2) for g in range(len(made.x))}
    for c, (i, j) in enumerate(made.contacts.tolist()):
        n, t = frame(made, c)
        force = made.normal[c] * n + sign * made.shear[c] * t
        found[j] = found[j] + force
        found[i] = found[i] - force
    for g, force in zip(*(made.walls or ((), ())), strict=True):
        found[int(g)] = found[int(g)] + force
    kept = [g for g in found if made.inner[g]]
    areas = np.array([made.radii[g] ** 2 for g in kept])
    rows = np.array([found[g] for g in kept])
    body = np.linalg.lstsq(areas[:, None], rows, rcond=None)[0]
    return dict(zip(kept, rows - areas[:, None] * body, strict=True))


def out_of_balance(made, sign=1.0):
    left = np.array(list(total_forces(made, sign).values()))
    sizes = [np.hypot(n, t) for n, t in zip(made.normal, made.shear, strict=True)]
    return np.sqrt((left**2).sum() / len(left)) / np.mean(sizes)


@pytest.mark.parametrize("walls", [True, False])
def test_balance_is_the_sum_over_the_contacts_of_a_grain(walls):
    made = uneven(walls=walls)
    found = checks.balance(made)
    assert found.number == pytest.approx(out_of_balance(made), rel=1e-12)
    assert found.severity == "doubt"
    # Weight leaves nothing.
    heavy = uneven(walls=(np.arange(49), made.radii[:, None] ** 2 * np.array([0.3, -2.0])))
    none = uneven(walls=(np.arange(49), np.zeros((49, 2))))
    assert checks.balance(heavy).number == pytest.approx(checks.balance(none).number, rel=1e-12)


def test_balance_with_shear_turned_is_told():
    bare = uneven(walls=(np.arange(49), np.zeros((49, 2))))
    # Walls that balance the grains with the shear forces turned around, but for a hundredth.
    turned = total_forces(bare, -1.0)
    push = np.array([-0.99 * turned.get(g, np.zeros(2)) for g in range(49)])
    made = uneven(walls=(np.arange(49), push))
    other = out_of_balance(made, -1.0)
    found = checks.balance(made)
    assert found.severity == "error"
    assert (
        f" {found.number:.2g} of the mean" in found.says and f"and {other:.2g} with" in found.says
    )
    assert found.number == pytest.approx(out_of_balance(made), rel=1e-12)


def test_grains_on_the_rim_are_those_near_the_box_of_those_touched():
    rng = np.random.default_rng(3)
    seen = set()
    for _ in range(20):
        radii = rng.uniform(2.0, 6.0, 60)
        # Grains that nearly touch a box, and some beyond it that no contact touches.
        x = rng.uniform(0, 40, (60, 2))
        side = rng.integers(0, 4, 40)
        gap = np.append(0.0, rng.uniform(0, 0.6, 39))
        for g, (s, far) in enumerate(zip(side, gap, strict=True)):
            x[g, s % 2] = far + radii[g] if s < 2 else 40.0 - far - radii[g]
        x = np.clip(x, radii[:, None], 40.0 - radii[:, None])
        touched = rng.random(60) < 0.9
        x[~touched] += rng.choice([-50.0, 50.0])
        inside = np.flatnonzero(touched)
        low = [min(x[g, a] - radii[g] for g in inside) for a in (0, 1)]
        high = [max(x[g, a] + radii[g] for g in inside) for a in (0, 1)]
        margin = checked.RIM * sum(radii) / 60
        expected = [
            any(
                x[g, a] - radii[g] - low[a] < margin or high[a] - x[g, a] - radii[g] < margin
                for a in (0, 1)
            )
            for g in range(60)
        ]
        assert checked.on_rim(x, radii, touched).tolist() == expected
        seen.update(expected)
    assert seen == {True, False}


@pytest.mark.parametrize(("gap", "share"), [(0.5e-9, 0.0), (2e-9, 1.0)])
def test_a_gap_of_a_billionth_of_the_length_is_rounding(gap, share):
    made = uneven(share=np.full(COUNT, -gap))
    assert checks.touching(made).number == share


@pytest.mark.parametrize(("roundings", "share"), [(0.5, 0.0), (1.5, 1.0)])
def test_a_gap_of_less_than_the_rounding_of_centres_is_none(roundings, share):
    made = uneven()
    made.x = 1e3 * made.x.astype(np.float32)
    made.overlap = np.full(COUNT, -roundings * np.abs(made.x).max() * 2.0**-24)
    assert checks.touching(made).number == share


@pytest.mark.parametrize("turn", [0.0, np.pi])
def test_exchanged_components_of_the_forces_are_told(turn):
    """Forces along the branches whose x and y are exchanged, all signs turned or not."""
    rng = np.random.default_rng(1)
    made = uneven()
    angle = np.arctan2(made.d[:, 1], made.d[:, 0]) + turn + rng.uniform(-0.5, 0.5, COUNT)
    force = rng.uniform(20, 60, COUNT)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    along = sum(f @ frame(made, c)[0] for c, f in enumerate(force)) / sum(np.hypot(*force.T))
    found = checks.directions(uneven(forces=force[:, ::-1]))
    assert found.severity == "error" and f"x and y exchanged give {along:.3g}" in found.says
    assert abs(found.number) < checks.ALONG


def test_directions_and_pulling_are_shares_of_the_sums():
    normal = np.random.default_rng(2).uniform(-5.0, 60.0, COUNT)
    made = uneven(normal=normal)
    sizes = [np.hypot(n, t) for n, t in zip(made.normal, made.shear, strict=True)]
    assert checks.directions(made).number == pytest.approx(sum(normal) / sum(sizes), rel=1e-12)
    pulls = -sum(n for n in normal if n < 0) / sum(abs(normal))
    assert checks.pulling(made).number == pytest.approx(pulls, rel=1e-12) and pulls > 0


def test_contacts_turned_are_named():
    """A balanced packing: walls carry what the contacts leave; then four forces turn."""
    sheared = np.linspace(-50.0, 50.0, COUNT)
    bare = uneven(walls=(np.arange(49), np.zeros((49, 2))), shear=sheared)
    push = np.zeros((49, 2))
    for c, (i, j) in enumerate(bare.contacts.tolist()):
        n, t = frame(bare, c)
        force = bare.normal[c] * n + bare.shear[c] * t
        push[i] += force
        push[j] -= force
    apart: list[int] = []
    for c in range(COUNT):
        if not np.isin(bare.contacts[c], bare.contacts[apart]).any():
            apart.append(c)
    for turned in (apart[:1], apart[1:4], apart[:4]):
        normal, shear = bare.normal.copy(), bare.shear.copy()
        normal[turned] *= -1
        shear[turned[0]] *= -1
        made = uneven(normal=normal, shear=shear, walls=(np.arange(49), push))
        found = checks.one_contact_turned(made)
        pairs = [f"{100 + i} and {100 + j}" for i, j in bare.contacts[turned[:3]]]
        named = ", ".join(pairs) + (", ..." if len(turned) > 3 else "")
        assert found.number == len(turned) and found.says.endswith(f"grains {named}")


def test_friction_quotes_what_the_forces_need():
    shear = np.zeros(COUNT)
    shear[:30] = np.linspace(0.71, 0.9, 30)
    made = uneven(shear=shear * 30, normal=np.full(COUNT, 30.0))
    found = checks.friction(made)
    beyond = [
        abs(t) > 1.01 * m * n for t, m, n in zip(made.shear, made.law.mu, made.normal, strict=True)
    ]
    worst = max(
        abs(t) / (m * n) for t, m, n in zip(made.shear, made.law.mu, made.normal, strict=True)
    )
    assert found.number == sum(beyond) / COUNT == 0.5
    assert f"at most {worst:.3g} times" in found.says
    assert found.remedy == f"The forces need mu = {np.quantile(shear, 0.999):.3g}."


def one_ratio_of(ratios, mu=None):
    """Contacts with these ratios |T| / (mu N)."""
    made = uneven()
    mu = np.asarray(made.law.mu) if mu is None else mu
    return checks.one_ratio(uneven(shear=np.asarray(ratios) * mu * made.normal, mu=mu)), mu


def test_the_contacts_of_one_ratio_are_counted_with_their_own_mu():
    ratios = np.linspace(0.02, 0.9, COUNT)
    ratios[10:17] = -0.3 * (1 + np.linspace(0, 0.9e-6, 7))
    # Others near them, and a smaller group.
    ratios[17:19] = 0.3 * (1 + 2e-6), 0.3 * (1 - 2e-6)
    ratios[30:35] = 0.6
    found, mu = one_ratio_of(ratios)
    assert found.says.startswith("7 contacts at |T| = 0.3 mu N")
    assert found.remedy == f"The forces need mu = {0.3 * np.median(mu[10:17]):.4g} there."
    assert found.number == pytest.approx(0.3, rel=1e-12)


@pytest.mark.parametrize(("ratio", "cause"), [(0.7, "large"), (1.3, "small")])
def test_flags_of_another_friction_quote_what_they_need(ratio, cause):
    sliding = np.arange(COUNT) < 20
    made = uneven()
    ratios = np.where(sliding, ratio * np.linspace(0.99, 1.02, COUNT), 0.2)
    shear = ratios * made.law.mu * made.normal
    found = checks.sliding(uneven(shear=shear, sliding=sliding))
    needed = np.median(ratios[:20]) * np.median(made.law.mu[:20])
    assert f"mu too {cause}" in found.says and f"mu = {needed:.3g}." in found.remedy
    assert found.number == pytest.approx(np.median(ratios[:20]), rel=1e-12)
    below = "100" if cause == "large" else "0"
    assert f"{np.median(ratios[:20]):.3g} mu N (median), {below} %" in found.says


@pytest.mark.parametrize(("at_limit", "told"), [(9, True), (10, False)])
def test_flags_are_missing_where_most_at_the_limit_have_none(at_limit, told):
    """Five without a flag: more than half of those at the limit, or half of them."""
    made = uneven()
    slides = np.arange(COUNT) < at_limit
    shear = np.where(slides, made.law.mu * made.normal, 1.0)
    found = checks.flags(uneven(shear=shear, sliding=slides & (np.arange(COUNT) >= 5)))
    assert found.number == 5 and found.says.startswith(f"5 of {at_limit} contacts")
    assert (found.severity == "doubt") == told


def elastic(factor=1.0, **changes):
    """Forces that are kn times the overlap times a factor."""
    made = uneven(**changes)
    return uneven(normal=factor * made.law.kn * made.overlap, **changes)


def test_stiffness_is_the_median_over_the_loaded_contacts():
    made = elastic(np.random.default_rng(4).uniform(2.0, 4.0, COUNT))
    secants = [n / o for n, o in zip(made.normal, made.overlap, strict=True)]
    ratios = [s / k for s, k in zip(secants, made.law.kn, strict=True)]
    found = stiffness_checks.stiffness(made)
    assert found.number == pytest.approx(np.median(ratios), rel=1e-12)
    ratio = np.median(ratios)
    assert f"the forces are {ratio:.4g} times what" in found.says
    assert f"kn is {1 / ratio:.4g} times what" in found.says
    needed = f"Forces and overlaps need kn = {np.median(secants):.4g}, "
    assert found.remedy.startswith(f"{needed}or the forces divided by {ratio:.4g};")


@pytest.mark.parametrize(
    ("kt", "factor", "cause"),
    [
        (2.0, 2.08, "exchanged"),
        (2.0, 2.12, "or kn is 0.4717"),
        (2.0, 1.92, "exchanged"),
        (1.04, 1.0, "(median)"),
        (0.5, 0.52, "exchanged"),
        (0.5, 0.55, "or kn is 1.818"),
        (2.0, 1.0, "2 kn"),
    ],
)
def test_stiffnesses_are_exchanged_where_the_other_one_fits(kt, factor, cause):
    kn = uneven().law.kn
    found = stiffness_checks.stiffness(elastic(factor, kt=kt * kn))
    assert cause in found.says


@pytest.mark.parametrize("law", ["springs", "modulus", "tangents"])
def test_forces_against_overlaps_in_numbers(law):
    """Ratio, its error, overlaps that the forces need and their noise, contact by contact."""
    factor = np.random.default_rng(4).uniform(0.8, 0.9, COUNT)
    made = elastic(factor)
    power = 1.0
    if law != "springs":
        # One modulus for all, or those that the tangents of each contact give.
        modulus, ratio = (1e7, None) if law == "modulus" else (np.full(COUNT, 1e7), 0.5)
        of_hertz = HertzMindlin(modulus, 0.0, 0.5, ratio=ratio)
        force = factor * of_hertz.closed_force(SimpleNamespace(**hertz_state(made)))
        made = dataclasses.replace(uneven(normal=force), law=of_hertz)
        # kn goes with the third root of N: what N needs goes with the other two thirds.
        factor, power = factor ** (2 / 3), 1.5 if law == "modulus" else 1.0
    fit, scale = made.fit, np.median(factor)
    np.testing.assert_allclose(fit.needed, factor / scale * made.overlap, rtol=1e-9)
    np.testing.assert_allclose(fit.off, fit.needed - made.overlap, atol=1e-15)
    typical = np.median(made.overlap)
    larger = np.maximum(fit.needed, made.overlap)
    noise = [np.quantile(np.abs(fit.off) / of, 0.9) for of in (larger, typical)]
    np.testing.assert_allclose(fit.noise, noise, rtol=1e-9)
    low, high = np.quantile(factor, [0.25, 0.75])
    error = power * (3 * (high - low) / np.sqrt(COUNT) + noise[1] ** 2)
    assert (fit.ratio, fit.error) == pytest.approx((scale**power, error), rel=1e-9)
    assert fit.power == (1.0 if law == "springs" else 1.5) and fit.typical == pytest.approx(typical)


@pytest.mark.parametrize(("x", "radius"), [(8, 8), (8, 6), (6, 8)])
def test_digits_of_centres_and_radii_leave_overlaps_open(x, radius):
    """Radii count by their own digits, at most by those of the centres."""
    made = uneven()
    made.x = np.array([[float(f"{v:.{x}g}") for v in row] for row in made.x + 10.0])
    made.radii = np.array([float(f"{v:.{radius}g}") for v in made.radii])
    centres, radii = findings.rounding(made.x), findings.rounding(made.radii)
    assert made.rounded == pytest.approx(2 * np.sqrt(2) * centres + 2 * min(centres, radii))
    assert (radii > centres) == (radius < x)


def test_grains_that_walls_should_hold_are_named_from_the_most_pushed_on():
    made = limits.ring(push=np.linspace(0.5, 1.0, 10)[:, None])
    says = missing.walls(made).says
    assert says.startswith("10 contacts with walls are known, and 10 grains at the outline")
    # Twice the mean of all contacts, less a uniform force on all grains.
    assert says.endswith("by up to 1.98 mean normal forces: grains 9, 8, 7, ...")


def test_contacts_of_an_odd_stiffness_are_named():
    """Their kn, or their forces, are not what the overlaps need; all forces are scaled."""
    right = elastic()
    kn = right.law.kn.copy()
    kn[[3, 9]] *= 300.0, 1.06
    made = uneven(normal=0.8 * right.normal, kn=kn)
    found = stiffness_checks.one_contact(made)
    (a, b), (c, d) = 100 + made.contacts[[3, 9]]
    assert found.number == 2 and found.severity == "doubt"
    first = f"grains {a} and {b} (N is {1 / 300:.4g} times what they give)"
    assert f": {first}, grains {c} and {d} (N is {1 / 1.06:.4g} times what they give)" in found.says
    needed = [f"kn = {right.law.kn[k]:.4g}" for k in (3, 9)]
    assert f"{needed[0]}, {needed[1]} would fit" in found.remedy
    normal = right.normal.copy()
    normal[[3, 9]] *= 300.0, 0.9
    assert stiffness_checks.one_contact(uneven(normal=normal)).number == 2
    gap = right.length.copy()
    gap[3] = 1.01 * right.reach[3]
    told = stiffness_checks.one_contact(dataclasses.replace(right, length=gap))
    assert told.number == 1 and "N acts across a gap" in told.says and "N = 0" in told.remedy


def test_contacts_as_stiff_as_their_forces_need_are_not_odd():
    """Overlaps of a twentieth and of twenty times the others'."""
    kn = uneven().law.kn.copy()
    kn[[3, 9]] *= 300.0, 1 / 300.0
    share = np.full(COUNT, 1e-3)
    share[[3, 9]] = 5e-5, 2e-2
    assert stiffness_checks.one_contact(elastic(kn=kn, share=share)).number == 0


@pytest.mark.parametrize("hertz", [False, True])
@pytest.mark.parametrize("factors", [(1.01,), (0.99,), (1.0005, 0.98)])
def test_radii_of_single_grains_are_told_with_what_they_need(factors, hertz):
    """No contact of theirs is called odd besides."""
    right = elastic()
    if hertz:
        law = HertzMindlin(1e7, 0.0, 0.5)
        right = dataclasses.replace(right, law=law)
        force = law.closed_force(SimpleNamespace(**hertz_state(right)))
        right = dataclasses.replace(uneven(normal=force), law=law)
    degree = np.bincount(right.contacts.ravel(), minlength=49)
    grains = np.flatnonzero(degree == 2)[[0, -1]][: len(factors)].tolist()
    radii = right.radii.copy()
    radii[grains] *= factors
    made = dataclasses.replace(right, graph=right.graph.replace(radii=radii))
    found = stiffness_checks.one_radius(made)
    assert found.number == len(grains) and found.severity == "doubt"
    # Under Hertz's law kn knows the radius as well.
    which, change = stiffness_checks.wrong_radii(made)
    assert which.tolist() == grains
    rtol = 1e-4 if hertz else 1e-9
    np.testing.assert_allclose(radii[which] + change, right.radii[which], rtol=rtol)
    old, new = radii[which], radii[which] + change
    for g, ratio, needed in zip(grains, old / new, new, strict=True):
        assert f"that of grain {100 + g} is {ratio:.6g} times what they need" in found.says
        assert f"grain {100 + g} the radius {needed:.8g}" in found.remedy
    assert stiffness_checks.one_contact(made).number == 0
    assert stiffness_checks.one_radius(right).number == 0


def hertz_state(made):
    one, two = made.radii[made.contacts].T
    return {"radii_i": one, "radii_j": two, "touching_length": one + two, "overlap": made.overlap}


def test_the_first_three_are_named_and_the_others_counted():
    """Five grains with wrong radii, five odd contacts and five lost ones of 144 grains."""
    count, size = 432, (12, 12)
    contacts = limits.lattice(*size)[2]
    five = np.array([13, 40, 67, 94, 121])
    for k, ending in ((3, "need"), (5, ", ...")):
        radii = np.where(np.isin(np.arange(144), five[:k]), 1.01, 1.0)
        found = stiffness_checks.one_radius(limits.state(size=size, radii=radii))
        named = [f"that of grain {g} is 1.01 times what they need" for g in five[:3]]
        assert found.number == k and f": {', '.join(named)}" in found.says
        assert found.says.endswith(ending) and found.remedy.endswith(", ...." if k > 3 else "5.")
        pairs = [f"grains {a} and {b} (N is 2 times" for a, b in contacts[five[:3]]]
        normal = np.where(np.isin(np.arange(count), five[:k]), 2.0, 1.0)
        odd = stiffness_checks.one_contact(limits.state(size=size, normal=normal))
        assert odd.number == k and all(pair in odd.says for pair in pairs)
        assert odd.says.count("grains") == 3 and odd.says.endswith("..." if k > 3 else ")")
        kept = ~np.isin(np.arange(count), five[:k])
        lost = missing.lost_contacts(limits.state(size=size, kept=kept))
        assert lost.number == k and lost.says.count("typical overlaps") == 3
        assert lost.says.endswith("..." if k > 3 else ")")


def all_pairs(x, radii, cell):
    """Overlaps of each pair through each image."""
    found = {}
    span = np.arange(-10, 11)
    images = np.stack(np.meshgrid(span, span), axis=-1).reshape(-1, 2)
    shifts = np.zeros((1, 2)) if cell is None else images @ cell.T
    for i in range(len(x)):
        for j in range(i + 1, len(x)):
            overlap = radii[i] + radii[j] - np.linalg.norm(x[j] + shifts - x[i], axis=1)
            if (overlap > 0).any():
                found[i, j] = np.sort(overlap[overlap > 0])
    return found


@pytest.mark.parametrize(
    "cell", [None, [[6.0, 0.0], [0.0, 5.0]], [[6.0, 2.5], [-0.7, 5.0]], [[1.5, 0.3], [0.0, 12.0]]]
)
@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_overlapping_pairs_are_those_of_a_search_one_by_one(cell, seed, compiled):
    """Unequal grains anywhere, also far out of the cell; a cell narrower than a grain."""
    rng = np.random.default_rng(seed)
    x, radii = rng.uniform(-3, 9, (40, 2)) - 20.0 * (seed == 2), rng.uniform(0.1, 0.8, 40)
    cell = None if cell is None else np.array(cell)
    pairs, overlap = missing.overlapping_pairs(x, radii, cell, 0.0, compiled=compiled)
    found = {}
    for pair, value in zip(pairs.tolist(), overlap, strict=True):
        found.setdefault(tuple(pair), []).append(value)
    wanted = all_pairs(x, radii, cell)
    assert found.keys() == wanted.keys() and len(wanted) > 5
    for pair, overlaps in wanted.items():
        np.testing.assert_allclose(sorted(found[pair]), overlaps, atol=1e-12)
    some = missing.overlapping_pairs(x, radii, cell, 0.3, compiled=compiled)[1]
    np.testing.assert_allclose(np.sort(some), np.sort(overlap[overlap > 0.3]), atol=1e-12)


@pytest.mark.parametrize("off", [-3e-3, -1e-3, 1e-3, 3e-3])
def test_radii_that_are_off_are_told_with_their_factor(off):
    made = uneven(share=np.random.default_rng(6).uniform(5e-3, 2e-2, COUNT))
    other = checked.Checked.__new__(checked.Checked)
    other.__dict__.update(made.__dict__)
    other.normal = 0.8 * made.law.kn * made.overlap
    other.reach = (1 + off) * made.reach
    other.overlap = other.reach - made.length
    found = stiffness_checks.radii(other)
    assert found.severity == "doubt"
    assert found.number == pytest.approx(1 - 1 / (1 + off), rel=1e-6)
    assert found.says.startswith(f"overlaps and forces fit radii {1 / (1 + off):.6g} times")
    assert found.remedy.startswith(f"Divide the radii by {1 + off:.6g}, or")


def test_radii_are_judged_by_what_the_digits_of_the_centres_allow():
    """Radii off by 1e-3 where single precision leaves 7e-4 of the sum of two."""
    made = uneven(share=np.random.default_rng(6).uniform(5e-3, 2e-2, COUNT))
    normal = made.law.kn * made.overlap
    made = uneven(share=np.random.default_rng(6).uniform(6e-3, 2.1e-2, COUNT), normal=normal)
    for size, severity in ((1.2e3, "doubt"), (4e3, "ok")):
        made.x = (size * uneven().x).astype(np.float32).astype(float)
        assert stiffness_checks.radii(made).severity == severity


@pytest.mark.parametrize("rough", [True, False])
@pytest.mark.parametrize("walls", [True, False])
def test_constraints_are_counted_grain_by_grain(rough, walls):
    made = uneven(walls=walls, shear=np.full(COUNT, float(rough)))
    walls = [int(g) for g in made.walls[0]] if made.walls else []
    shared, freedoms = 0.0, 0
    for g in range(49):
        own = [c for c in range(COUNT) if g in made.contacts[c]]
        held = len(own) + walls.count(g)
        if made.inner[g] and held >= (2 if rough else 3):
            slips = sum(bool(made.sliding[c]) for c in own)
            shared += (2 * len(own) - slips if rough else len(own)) / 2 + walls.count(g)
            freedoms += 3 if rough else 2
    found = checks.jammed(made)
    if freedoms < 20 * (3 if rough else 2):
        assert found is None
    else:
        assert found.number == pytest.approx(shared / freedoms, rel=1e-12)


@pytest.mark.parametrize(
    ("sign", "cause"), [(-1.0, "tension positive"), (0.5, "of other contacts")]
)
def test_columns_that_differ_are_told_by_their_first_row(sign, cause):
    used = np.linspace(20.0, 60.0, 7)
    column, rows = used.copy(), np.array([40, 30, 20, 12, 11, 10, 5])
    column[1:5] *= sign
    found = checks.same_force("fn", column, used, 40.0, rows)
    worst = max(abs(column - used)) / 40.0
    assert found.number == pytest.approx(worst) and f"at most {worst:.2g} mean" in found.says
    assert "0.001 in 4 rows, the first is 11:" in found.says and cause in found.says
    # Of a column of zeros against zeros nothing is said.
    assert checks.same_force("fn", used * 0, used * 0, 0.0, rows).severity == "ok"


@pytest.mark.parametrize(
    ("same", "turned", "severity"),
    [(0, 0, "doubt"), (0, 20, "ok"), (0, 19, "doubt"), (1, 39, "doubt"), (0, 40, "ok")],
)
def test_rows_that_repeat_are_counted(same, turned, severity):
    found = checks.repeated(same, turned, 40, np.full(same + turned, 0.9e-3))
    assert found.number == (same + turned) / 40 and found.severity == severity
    assert found.says.startswith(f"{same + turned} of 40 contacts")
    other = checks.repeated(same, turned, 40, np.array([0.0, 1.1e-3, 2.0]))
    assert ", 2 of them with another force" in other.says and other.severity == "error"


def test_directions_of_the_file_are_measured_as_angles():
    made = uneven()
    rng = np.random.default_rng(8)
    angle = rng.uniform(-1e-2, 1e-2, COUNT)
    size = rng.uniform(0.2, 3.0, COUNT)
    c, s = np.cos(angle), np.sin(angle)
    turned = np.column_stack(
        [c * made.d[:, 0] - s * made.d[:, 1], s * made.d[:, 0] + c * made.d[:, 1]]
    )
    given = (size / made.length)[:, None] * turned
    found = checks.same_snapshot(uneven(given=given))
    assert found.number == pytest.approx(np.median(np.abs(s)), rel=1e-9)
    # Numbers of single precision are good to this, of lengths and of directions of their own size.
    single = given.astype(np.float32).astype(float)
    made = uneven(given=single)
    made.x = made.x.astype(np.float32).astype(float)
    coarse = 2 * np.abs(made.x).max() * 2.0**-24 / np.median(made.length)
    coarse += np.abs(single).max() * 2.0**-24 / np.median(np.hypot(*single.T))
    assert f"precision, {coarse:.1g}:" in checks.same_snapshot(made).says


UNITS = [one for one in limits.LIMITS if isinstance(one[2], checked.Checked)]
CHECKS = (
    *(checks.distances, checks.touching, checks.same_snapshot, checks.directions, checks.pulling),
    *(checks.balance, checks.one_contact_turned, checks.friction, checks.one_ratio),
    *(checks.sliding, checks.flags, checks.jammed, checks.unseen, missing.walls),
    missing.lost_contacts,
    *(stiffness_checks.stiffness, stiffness_checks.one_contact, stiffness_checks.one_radius),
    stiffness_checks.radii,
)


@pytest.mark.parametrize("force", [2.0**10, 2.0**-20])
@pytest.mark.parametrize("length", [2.0**7, 2.0**-7])
def test_units_change_no_finding(force, length):
    """All examples of the limits but those with coordinates of six digits, and uneven ones."""
    examples = [made for one in UNITS for made in one[2:]]
    examples += [uneven(k, walls=k % 2 == 0) for k in range(6)]
    for made in examples:
        if findings.rounding(made.x) > 1e-14 * np.abs(made.x).max():
            continue
        other = in_units(made, force, length)
        for check in CHECKS:
            before, after = check(made), check(other)
            if before is None:
                assert after is None
                continue
            assert after.severity == before.severity
            assert after.number == pytest.approx(before.number, rel=1e-9, abs=1e-9)


def turned_contacts(snapshot, rows):
    """The same snapshot with the grains of some contacts exchanged."""
    graph = snapshot.graph
    contacts, images = graph.contacts.copy(), graph.images.copy()
    contacts[rows], images[rows] = contacts[rows, ::-1], -images[rows]
    parts = {name: getattr(graph, name) for name in ("x", "radii", "cell", "normal_force")}
    other = GrainGraph(contacts=contacts, images=images, shear_force=graph.shear_force, **parts)
    assert np.allclose(branch_vectors(other)[rows], -branch_vectors(graph)[rows])
    return dataclasses.replace(snapshot, graph=other)


@pytest.mark.parametrize("increment", ["radii", "branch"])
def test_kt_is_that_of_the_slip_contact_by_contact(increment):
    """Contacts turned around, grains that leave, unequal kt; slip by either rule."""
    before, after = limits.snapshots(1.4)
    rng = np.random.default_rng(9)
    count = before.graph.contact_count
    kt = 500.0 * rng.uniform(0.5, 2.0, count)
    law = LinearFrictional(kn=1e3, kt=kt, mu=0.5, shear_increment=increment)
    radii = before.graph.radii * rng.uniform(0.9, 1.1, len(before.ids))
    spin = after.rotation - before.rotation
    d, e = branch_vectors(before.graph), branch_vectors(after.graph)
    shear = np.empty(count)
    for c, (i, j) in enumerate(before.graph.contacts.tolist()):
        angle = np.arctan2(e[c, 1], e[c, 0]) - np.arctan2(d[c, 1], d[c, 0])
        angle = (angle + np.pi) % (2 * np.pi) - np.pi
        reach = radii[i] + radii[j]
        length = (np.hypot(*d[c]) + np.hypot(*e[c])) / 2 if increment == "branch" else reach
        slip = length * angle - length / reach * (radii[i] * spin[i] + radii[j] * spin[j])
        shear[c] = -1.4 * kt[c] * slip
    graphs = []
    for one, force in ((before, np.zeros(count)), (after, shear)):
        parts = {n: getattr(one.graph, n) for n in ("x", "contacts", "images", "cell")}
        graphs.append(
            GrainGraph(radii=radii, normal_force=np.ones(count), shear_force=force, **parts)
        )
    before = dataclasses.replace(before, graph=graphs[0], law=law)
    after = turned_contacts(
        dataclasses.replace(after, graph=graphs[1], law=law), np.arange(0, count, 3)
    )
    found = check_kt(before, after)
    assert found.number == pytest.approx(1.4, rel=1e-6)
    assert found.remedy == f"The forces need kt = {1.4 * np.median(kt):.4g}."
    assert found.says.endswith(": kt is too small")
    # The last grain of the first snapshot is another one in the second.
    ids = after.ids.copy()
    ids[-1] = 1000
    assert check_kt(before, dataclasses.replace(after, ids=ids)).number == pytest.approx(
        1.4, rel=1e-6
    )


@pytest.mark.parametrize("rotations", [True, False])
@pytest.mark.parametrize("history", ["force", "displacement"])
def test_kt_of_hertz_goes_with_the_force(history, rotations):
    """T grows by the mean kt of both states, or is kt times a displacement that grows."""
    before, after = limits.snapshots(1.0, rotations=rotations)
    slip = -after.graph.shear_force / 500.0
    rng = np.random.default_rng(11)
    law = HertzMindlin(1e5, 0.2, 0.5, "radii", history)
    count = len(slip)
    graphs = [
        one.graph.replace(normal_force=rng.uniform(0.5, 2.0, count)) for one in (before, after)
    ]
    kt = [law.stiffnesses(contact_state(graph))[1] for graph in graphs]
    start = rng.uniform(-1e-3, 1e-3, count) * kt[0]
    end = start - 1.4 * slip * (kt[0] + kt[1]) / 2
    if history == "displacement":
        end = kt[1] * (start / kt[0] - 1.4 * slip)
    pair = [
        dataclasses.replace(one, law=law, graph=graph.replace(shear_force=T))
        for one, graph, T in zip((before, after), graphs, (start, end), strict=True)
    ]
    found = check_kt(*pair)
    assert found.number == pytest.approx(1.4, rel=1e-6 if rotations else 1e-3)
    assert found.remedy == f"The forces need kt = {found.number * np.median(kt):.4g}."
    assert check_kt(pair[0], dataclasses.replace(pair[1], law=None)) is None


def test_a_snapshot_of_a_part_is_checked_by_what_it_shares():
    """The grains with the largest ids are gone: none of them has an angle in the second."""
    before, after = limits.snapshots(0.7)
    kept = np.flatnonzero((after.graph.contacts < 50).all(axis=1))
    graph = after.graph
    part = GrainGraph(
        x=graph.x[:50],
        radii=graph.radii[:50],
        contacts=graph.contacts[kept],
        images=graph.images[kept],
        cell=graph.cell,
        normal_force=graph.normal_force[kept],
        shear_force=graph.shear_force[kept],
    )
    left = Snapshot(
        part, after.law, after.regime[kept], after.ids[:50], 0, (), rotation=after.rotation[:50]
    )
    found = check_kt(before, left)
    assert found.number == pytest.approx(0.7, rel=1e-5)
    assert found.says.endswith(": kt is too large")


@pytest.mark.parametrize("ends_at_zero", [True, False])
def test_contacts_that_never_carry_shear_say_nothing_of_kt(ends_at_zero):
    """Three in five contacts have T = 0 in both snapshots; the others in one of them at most."""
    before, after = limits.snapshots(1.5)
    rough = np.arange(before.graph.contact_count) % 5 > 2
    change = np.where(rough, after.graph.shear_force, 0.0)
    start, end = (-change, 0 * change) if ends_at_zero else (0 * change, change)
    before = dataclasses.replace(before, graph=before.graph.replace(shear_force=start))
    after = dataclasses.replace(after, graph=after.graph.replace(shear_force=end))
    assert check_kt(before, after).number == pytest.approx(1.5, rel=1e-4)


def test_stiffness_is_that_of_the_contacts_that_overlap():
    """A third of the contacts carry their load across a gap."""
    share = np.where(np.arange(COUNT) % 3 == 0, -2e-3, 1e-3)
    made = uneven(share=share)
    rows = [c for c in range(COUNT) if share[c] > 0]
    ratios = [made.normal[c] / (made.law.kn[c] * made.overlap[c]) for c in rows]
    assert stiffness_checks.stiffness(made).number == pytest.approx(np.median(ratios), rel=1e-12)
