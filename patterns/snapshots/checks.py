"""Checks of a snapshot against its own numbers: each function looks for one family of faults.

Each limit lies between what 89 clean files of Yade, LAMMPS and LIGGGHTS give and what the same
snapshots give with a fault; both stand beside it. Every check looks at all contacts.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from loops.arrays import Floats, Integers, in_threads, median, quantiles
from loops.graph import contact_state
from patterns.snapshots.checked import FEWEST, ROUNDINGS, Checked
from patterns.snapshots.findings import Finding, few, finding, power_of_ten, rounding, sentences
from patterns.snapshots.missing import cell, lost_contacts, walls
from patterns.snapshots.stiffness_checks import (
    needed_stiffness,
    one_contact,
    one_radius,
    radii,
    stiffness,
)

# Centres' distance over the sum of radii (median), clean 0.99 to 1: diameters in place of radii
# give 0.5.
DIAMETERS = (0.25, 0.6)
# Soft grains have 0.9.
SOFT_GRAINS = 0.85
# From here on grains that carry load are apart.
LOADED_APART = 1.02
# From here on the tables are of different snapshots, or units.
OTHER_UNITS = 1.5


def distances(state: Checked) -> Finding:
    """Distances of the centres against the radii: diameters for radii, other units."""
    reach = median(state.length / state.reach)
    case = "ok"
    if DIAMETERS[0] < reach < DIAMETERS[1]:
        case = "diameters"
    elif reach <= DIAMETERS[0] or reach > OTHER_UNITS:
        case = "unit" if power_of_ten(reach) else "column"
    elif reach > LOADED_APART:
        case = "small"
    elif reach < SOFT_GRAINS:
        case = "far"
    percent = 100 * (1 - 1 / reach)
    return finding("distances", reach, case, unit=power_of_ten(reach), percent=percent)


# Share of loaded contacts across a gap: clean none.
GAPS = 0.01


def touching(state: Checked) -> Finding | None:
    """Contacts that carry load across a gap, beyond that at which a bond breaks."""
    gap = -state.overlap
    if state.law is not None and state.law.cohesive:
        gap = state.law.gap(contact_state(state.graph))
    gap = gap[state.loaded]
    if len(gap) == 0:
        return None
    share = float(np.mean(gap > rounding(state.x) + 1e-9 * state.length[state.loaded]))
    case = "ok" if share <= GAPS else "loaded" if state.normal.any() else "all"
    contacts = "contacts that carry load" if state.normal.any() else "contacts"
    return finding("touching", share, case, percent=100 * share, contacts=contacts)


# Directions of the file against the centres, in radians: 1e-9 if saved within a step.
DIRECTIONS_OFF = 3e-6


def same_snapshot(state: Checked) -> Finding | None:
    """Branches or normals of the file against the centres."""
    if state.given is None:
        return None
    given, d = state.given, state.d
    size = np.hypot(*given.T)
    turned = np.abs(d[:, 0] * given[:, 1] - d[:, 1] * given[:, 0])
    off = median(turned / np.where(size > 0, size, 1.0) / state.length)
    coarse = 2 * rounding(state.x) / median(state.length)
    coarse += rounding(given) / (median(size) or 1.0)
    case = "off" if off > DIRECTIONS_OFF + ROUNDINGS * coarse else "ok"
    return finding("same_snapshot", off, case, coarse=coarse)


# Numbers that stand for a missing value.
MISSING = (999.0, 9999.0, 99999.0, 999999.0, 1e30)


def unbalanced(state: Checked) -> Finding:
    """Forces far beyond the others that their grains don't balance: missing values, failed fits."""
    rows = state.odd
    if not len(rows):
        return finding("unbalanced", 0)
    size = np.hypot(state.normal[rows], state.shear[rows])
    rows, typical = rows[np.argsort(-size)], median(np.hypot(state.normal, state.shear))

    def each(c: int) -> str:
        row = "" if state.rows is None else f"row {state.rows[c]}, "
        force = f"(N = {state.normal[c]:.4g}, T = {state.shear[c]:.4g})"
        return f"{row}grains {state.names(np.array([c]))} {force}"

    each_part = np.abs([state.normal[rows], state.shear[rows]])
    missing = np.isclose(each_part[..., None], MISSING, rtol=1e-9).any()
    case, times = "missing" if missing else "failed", size.max() / typical
    return finding("unbalanced", len(rows), case, each=few(rows, each), times=times)


# Share of the forces along the branches: clean 0.97 to 1; exchanged components 0 to 0.3; signs -1.
ALONG = 0.4


def directions(state: Checked) -> Finding:
    """Forces along the branches, or as the springs of a cohesive law: signs, exchanged columns."""
    normal, shear = state.judged
    side: Floats | float = 1.0
    if state.law is not None and state.law.cohesive:
        side = np.sign(state.stiffnesses[0] * state.overlap - state.law.attraction)
    size = float(np.hypot(normal, shear).sum())
    share = float((side * normal).sum()) / size
    if abs(share) >= ALONG:
        return finding("directions", share, "ok" if share > 0 else "pull")
    n = state.d / state.length[:, None]
    # The force with its components exchanged, along the branch.
    exchanged = 2 * n[:, 0] * n[:, 1] * normal + (n[:, 0] ** 2 - n[:, 1] ** 2) * shear
    other = float((side * exchanged).sum()) / size
    case = "exchanged" if abs(other) > 2 * ALONG else "others"
    return finding("directions", share, case, other=other)


# Share of the normal force that pulls: clean 0; damping in a flow 0.1 %.
PULLING = 0.02


# Pull over the adhesion of the law that is allowed: rounding of the file.
PULL = 1.0 + 1e-5


def pulling(state: Checked) -> Finding:
    """Share of the normal force that pulls; under a cohesive law the pull over the adhesion."""
    if state.law is not None and state.law.cohesive:
        adhesion = np.broadcast_to(state.law.adhesion, len(state.normal))
        beyond = -state.normal > PULL * adhesion + rounding(state.normal)
        count = int(np.count_nonzero(beyond))
        most = float((-state.normal[adhesion > 0] / adhesion[adhesion > 0]).max(initial=0.0))
        case, each = "beyond" if count else "adhesion", state.names(np.flatnonzero(beyond))
        return finding("pulling", float(count), case, most=most, each=each)
    normal = state.judged[0]
    size = np.abs(normal)
    share = float(size[normal < 0].sum() / (float(size.sum()) or 1.0))
    case = "tension" if PULLING < share <= 0.5 else "ok"
    return finding("pulling", share, case, percent=100 * share)


# Residual force on a grain over the mean force (root mean square): clean 0 to 0.065; a flow 0.28.
BALANCE = 0.1
# Residual with the shear forces turned around over the residual as given: clean above 1.
SHEAR_TURNED = 0.3


def balance(state: Checked) -> Finding | None:
    """Residual force on the grains, a uniform body force aside."""
    inner = np.count_nonzero(state.inner)
    if inner < 3:
        return None
    normal, shear = state.residuals
    mean = state.mean_force
    both = normal + shear, normal - shear
    rest, other = (float(np.sqrt(np.einsum("gk,gk->", r, r) / inner)) / mean for r in both)
    case = "ok" if rest <= BALANCE else "flow"
    if rest > BALANCE and other < SHEAR_TURNED * rest and inner >= FEWEST:
        case = "shear"
    return finding("balance", rest, case, other=other)


# Residual left at both grains when one contact is turned, over the change: clean 0.48 and more.
CONTACT_TURNED = 0.3
# That change over the median residual of a grain, below which a contact is not judged.
JUDGED = 20.0
# The same in mean normal forces, where grains are balanced to rounding.
WEAKEST = 1e-3


def one_contact_turned(state: Checked) -> Finding | None:
    """Contacts whose force, or its normal or shear part, balances both grains with its sign turned.

    A grain on the rim does not count: walls may push on it.
    """
    inner = np.count_nonzero(state.inner)
    if inner < FEWEST:
        return None
    rest = np.add(*state.residuals)
    size = np.hypot(*rest.T)
    least = max(JUDGED * median(size[state.inner]), WEAKEST * state.mean_force)
    rows = _turned(state, rest, least)
    return finding("turned", len(rows), "some" if len(rows) else "ok", each=state.names(rows))


def _turned(state: Checked, rest: Floats, least: float) -> Integers:
    """Return the contacts that balance both grains turned, of those that change more than `least`.

    `rest` (G, 2) are the resultants.
    """
    one, two = state.contacts.T
    # Only between grains that are left with nearly such a change.
    left = ~state.inner | (np.hypot(*rest.T) > (1 - CONTACT_TURNED) * least)
    rows = np.flatnonzero(left[one] & left[two] & (state.inner[one] | state.inner[two]))
    one, two, turned = one[rows], two[rows], np.zeros(len(rows), dtype=bool)
    normal, shear = state.parts(rows)
    for force in (normal + shear, normal, shear):
        change = np.hypot(*force.T) * 2
        rests = [
            np.where(state.inner[end], np.hypot(*(rest[end] - sign * force).T), 0.0)
            for end, sign in ((one, -2), (two, 2))
        ]
        turned |= (change > least) & (np.maximum(*rests) < CONTACT_TURNED * change)
    return rows[turned]


# Angles of friction in degrees; tangents are smaller.
DEGREES = (5.0, 90.0)
# |T| over Coulomb's limit of a contact that is beyond it.
BEYOND_COULOMB = 1.01
# Share of such contacts: clean none; a flow 0.9 %.
BEYOND_SHARE = 0.02


def friction(state: Checked) -> Finding | None:
    """Shear against Coulomb's limit; friction that is an angle."""
    typical = median(state.mu)
    if DEGREES[0] < typical < DEGREES[1]:
        return finding("friction", typical, "degrees", tangent=np.tan(np.radians(typical)))
    rows = np.flatnonzero(state.loaded & (state.normal > 0))
    if len(rows) == 0 or not np.isfinite(state.mu).any():
        return None
    if state.cohesive:
        beyond = float(np.mean(np.abs(state.shear) > BEYOND_COULOMB * np.abs(state.strength)))
        case = "cohesive_beyond" if beyond > BEYOND_SHARE else "cohesive"
        return finding("friction", beyond, case, percent=100 * beyond)
    ratio, mu = np.abs(state.shear[rows]) / state.normal[rows], state.mu[rows]
    beyond = float(np.mean(ratio > BEYOND_COULOMB * mu))
    worst = float(np.divide(ratio, mu, out=np.zeros(len(mu)), where=mu > 0).max())
    case, needed = "beyond" if beyond > BEYOND_SHARE else "ok", quantiles(ratio, [0.999])[0]
    values = {"percent": 100 * beyond, "worst": worst, "needed": needed}
    return finding("friction", beyond, case, **values)


# Contacts at one ratio |T|/N, to this share of it, slide.
ONE_RATIO = 1e-6
# Contacts that make it one: at rest at most 2 of 7,000 agree so far.
AT_ONE_RATIO = 5
# The same of a large packing, where ratios agree by chance.
AT_ONE_RATIO_SHARE = 1e-3
# |T| / (mu N) of a sliding contact: clean 1 to 1e-6.
AT_LIMIT = (0.95, 1.05)
# Share of flagged contacts below: clean none.
FEW_BELOW = 0.05


def one_ratio(state: Checked) -> Finding | None:
    """Contacts that share one ratio |T| / (mu N) below 1: they slide, and their mu is smaller."""
    if state.cohesive:
        return None
    mu = state.mu
    rows = np.flatnonzero(state.loaded & (state.normal > 0) & (mu > 0) & np.isfinite(mu))
    least = int(max(np.ceil(AT_ONE_RATIO), np.ceil(AT_ONE_RATIO_SHARE * len(rows))))
    if len(rows) < least:
        return None
    ratio = np.abs(state.shear[rows]) / (mu[rows] * state.normal[rows])
    ordered = np.sort(ratio)
    low, high = ordered[: len(rows) - least + 1], ordered[least - 1 :]
    alike = low[(low > 0) & (high <= (1 + ONE_RATIO) * low)]
    sharing = np.searchsorted(ordered, (1 + ONE_RATIO) * alike, side="right")
    sharing -= np.searchsorted(ordered, alike)
    # In a regular packing most contacts are alike.
    regular = 2 * (len(alike) + least) > len(rows)
    below = alike < AT_LIMIT[0]
    if regular or not below.any():
        return finding("one_ratio", 0.0)
    count = int(sharing[below].max())
    shared = float(alike[below][np.argmax(sharing[below])])
    there = (ratio >= shared) & (ratio <= (1 + ONE_RATIO) * shared)
    needed = shared * median(mu[rows[there]])
    return finding("one_ratio", shared, "shared", count=count, needed=needed)


def sliding(state: Checked) -> Finding | None:
    """Contacts flagged as sliding against Coulomb's limit."""
    if state.sliding is None:
        return None
    mu, limit = state.mu, state.strength
    rows = np.flatnonzero(state.sliding & state.loaded & np.isfinite(limit) & (limit > 0))
    if len(rows) == 0:
        return None
    ratio = np.abs(state.shear[rows]) / limit[rows]
    below, typical = ratio < AT_LIMIT[0], median(ratio)
    share = float(np.mean(below))
    case, needed = "ok", 0.0
    if share > FEW_BELOW:
        case, needed = "large", median(ratio[below]) * median(mu[rows[below]])
    elif typical > AT_LIMIT[1]:
        case, needed = "small", typical * median(mu[rows])
    return finding("sliding", typical, case, percent=100 * share, needed=needed)


# A contact without a flag counts as sliding from this share of mu N on, as Yade's own tables do.
SLIDING_SHARE = 0.999


def flags(state: Checked) -> Finding | None:
    """Contacts at Coulomb's limit that the file does not flag as sliding."""
    if state.sliding is None:
        return None
    limit = state.strength
    at_limit = np.isfinite(limit) & (limit > 0)
    at_limit &= np.abs(state.shear) >= SLIDING_SHARE * limit
    count = int(np.count_nonzero(at_limit))
    missing = int(np.count_nonzero(at_limit & ~state.sliding))
    case = "missing" if missing >= AT_ONE_RATIO and 2 * missing > count else "ok"
    return finding("flags", missing, case, count=count)


# Constraints over degrees of freedom: 1.03 and more where load is carried, 0.89 in a flow.
JAMMED = 0.95


def jammed(state: Checked) -> Finding | None:
    """Constraints of the contacts against the degrees of freedom of the grains that carry load."""
    if state.sliding is None:
        return None
    degree = state.degree
    walls = np.zeros(len(degree))
    if state.walls is not None:
        walls += np.bincount(state.walls[0], minlength=len(degree))
    # Two degrees of freedom without friction, three with: shear that is zero throughout is none.
    rough = bool(state.shear.any())
    held = state.inner & (degree + walls >= (2 if rough else 3))
    if np.count_nonzero(held) < FEWEST:
        return None
    slides = np.bincount(state.contacts[state.sliding].ravel(), minlength=len(degree))
    shared = (2 * degree - slides if rough else degree) / 2 + walls
    ratio = float(shared[held].sum() / ((3 if rough else 2) * np.count_nonzero(held)))
    return finding("jammed", ratio, "flow" if ratio < JAMMED else "ok")


# Share of a typical overlap that the digits may leave open without a word.
OPEN_DIGITS = 0.01


def unseen(state: Checked) -> Finding:
    """List the quantities that one snapshot cannot determine, such as kt."""
    unknown, fit, percent = ["kt"], state.fit, 0.0
    if state.sliding is not None and not state.sliding.any():
        unknown.append("mu")
    if fit is None:
        unknown.append("overlaps")
    elif state.rounded > OPEN_DIGITS * fit.typical:
        unknown.append("digits")
        percent = 100 * state.rounded / fit.typical
    lines = "; ".join(sentences()["unseen"][one] for one in unknown).format(percent=percent)
    return finding("unseen", len(unknown), unknown=lines)


def check_state(state: Checked) -> tuple[Finding, ...]:
    """All findings on a state, also those that are as they should be."""
    known = state.forces_known or state.law is not None
    zero = known and not (state.normal.any() or state.shear.any())
    # Those of one group share what they compute, and run one after the other.
    groups: list[list[Callable[[Checked], Finding | None]]]
    groups = [[distances, touching, cell, same_snapshot], [lost_contacts]]
    if known and not zero:
        groups.append([unbalanced, balance, one_contact_turned, walls])
        if state.law is None:
            groups.append([directions, pulling, needed_stiffness])
        else:
            groups.append([directions, pulling, friction, one_ratio, sliding, flags])
            groups.append([stiffness, one_radius, one_contact, radii, jammed, unseen])

    @np.errstate(over="ignore", divide="ignore", invalid="ignore")
    def run(group: list[Callable[[Checked], Finding | None]]) -> list[Finding | None]:
        return [check(state) for check in group]

    found = [one for several in in_threads(run, groups) for one in several if one is not None]
    return (*found, finding("forces", 0.0, "zero")) if zero else tuple(found)


# Two columns of one quantity agree to this share of the mean force: clean 5e-9, text 1e-6.
SAME_FORCE = 1e-3


def same_force(name: str, column: Floats, used: Floats, scale: float, rows: Integers) -> Finding:
    """Forces in a column of the file, of its `rows`, against those that are used."""
    off = np.abs(column - used) / (scale or 1.0)
    wrong = off > SAME_FORCE
    case, values = "ok", dict[str, object]()
    if wrong.any():
        case = "turned" if median(np.abs(column + used)) <= SAME_FORCE * scale else "other"
        values = {"count": np.count_nonzero(wrong), "row": rows[wrong].min(), "limit": SAME_FORCE}
    own = finding("same_force", float(off.max()), case, column=name, **values)
    return own._replace(check=name)


# Share of contacts in two rows: all where rows are of grains, but for some with fixed grains.
REPEATED = 0.5


def repeated(same: int, turned: int, count: int, off: Floats, such: str = "") -> Finding:
    """Rows of contacts that stand in an earlier row, with the same first grain or the other one.

    A list may have each of `count` contacts once from each of its grains, but for fixed grains.
    `off` (rows,) are the forces in such rows less those in the earlier one, in mean forces; `such`
    names the two rows that differ most.
    """
    rows, wrong = same + turned, int(np.count_nonzero(off > SAME_FORCE))
    case = "force" if wrong else "joined" if same > 0 or turned < REPEATED * count else "ok"
    values = {"rows": rows, "count": count, "wrong": wrong, "such": such and f", such as {such}"}
    return finding("repeated", rows / count, case, **values)
