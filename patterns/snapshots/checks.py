"""Checks of a snapshot against its own numbers: each function looks for one family of faults.

Each limit lies between what 89 clean files of Yade, LAMMPS and LIGGGHTS give and what the same
snapshots give with a fault; both stand beside it. Every check looks at all contacts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from loops import (
    GrainGraph,
    HertzMindlin,
    LinearFrictional,
    Regime,
    branch_vectors,
    contact_state,
)
from loops.arrays import Flags, Floats, Integers, in_threads
from patterns.snapshots.geometry import index_of

if TYPE_CHECKING:
    from patterns.snapshots.snapshot import Snapshot

Severity = Literal["ok", "doubt", "error"]
# Weaker contacts, in mean normal forces, hold mostly rounding and damping.
LOADED = 0.1
# Fewer contacts or grains than these are not judged together.
FEWEST = 20
# Powers of ten and ratios of 1 are recognised within this.
NEAR_ROUND = 0.05
# Multiples of the rounding of coordinates: for directions and radii, all overlaps, one overlap.
ROUNDINGS, OVERLAP_ROUNDINGS, SURE_ROUNDINGS = 5.0, 2.0, 20.0


class Finding(NamedTuple):
    """Result of one check: its number, a sentence with the likely cause, and the remedy."""

    check: str
    number: float
    says: str
    severity: Severity = "ok"
    remedy: str = ""

    def __str__(self) -> str:
        return f"{self.says}. {self.remedy}"

    def doubt(self, cause: str, remedy: str, holds: bool = True) -> Finding:
        """The finding as a doubt with its likely cause, if `holds`."""
        said = self._replace(says=f"{self.says}{cause}", severity="doubt", remedy=remedy)
        return said if holds else self

    def error(self, cause: str, remedy: str) -> Finding:
        """The finding as an error, after which no result means anything."""
        return self._replace(says=f"{self.says}{cause}", severity="error", remedy=remedy)


@dataclass(eq=False)
class Checked:
    """Contacts between grains with their branches, law and regimes, as the checks need them.

    `given` (C, 2) are the branches or normals of the file, `walls` the grains that walls touch and
    the forces on them (W, 2), `ids` (G,) those of the grains. Forces may be known without a law.
    """

    graph: GrainGraph
    d: Floats
    length: Floats
    law: LinearFrictional | HertzMindlin | None
    regime: NDArray[np.int8] | None
    given: Floats | None
    walls: tuple[Integers, Floats] | None
    ids: Integers
    forces_known: bool = False

    def __post_init__(self) -> None:
        graph = self.graph
        self.x, self.radii, self.contacts = graph.x, graph.radii, graph.contacts
        self.normal, self.shear = graph.normal_force, graph.shear_force
        self.sliding = None if self.regime is None else self.regime == Regime.SLIDING
        self.degree = np.bincount(self.contacts.ravel(), minlength=len(self.x))
        self.inner = self.degree > 0
        if graph.cell is None and self.walls is None:
            # Walls whose forces are not known may push on the rim.
            self.inner &= ~on_rim(self.x, self.radii, self.inner)
        self.reach = self.radii[self.contacts].sum(axis=1)
        self.overlap = self.reach - self.length
        limit = LOADED * float(self.normal.mean())
        self.loaded = self.normal > limit if limit > 0 else np.ones(len(self.normal), dtype=bool)

    @property
    def mu(self) -> Floats:
        """(C,) array: friction of the contacts."""
        assert self.law is not None
        return np.broadcast_to(self.law.mu, len(self.contacts))

    @cached_property
    def stiffnesses(self) -> tuple[Floats, Floats]:
        """`kn` and `kt`, (C,) each; under Hertz's law of the tangents of `N`."""
        assert self.law is not None
        if isinstance(self.law, LinearFrictional):
            kn, kt = self.law.kn, self.law.kt
        else:
            kn, kt = self.law.stiffnesses(contact_state(self.graph))
        return np.broadcast_to(kn, len(self.contacts)), np.broadcast_to(kt, len(self.contacts))

    @property
    def overlapping(self) -> Integers:
        """Loaded contacts whose overlap tells a stiffness, none if the centres are too coarse."""
        coarse = OVERLAP_ROUNDINGS * rounding(self.x)
        if not self.loaded.any() or np.median(self.overlap[self.loaded]) <= coarse:
            return np.zeros(0, dtype=np.int64)
        return np.flatnonzero(self.loaded & (self.overlap > 0))

    def names(self, contacts: Integers) -> str:
        """Grains of the first three of some contacts."""
        pairs = self.ids[self.contacts[contacts[:3]]].tolist()
        return ", ".join(f"{one} and {two}" for one, two in pairs) + ", ..." * (len(contacts) > 3)

    @cached_property
    def parts(self) -> tuple[Floats, Floats]:
        """Normal and shear force on grain 2 of each contact, (C, 2) each."""
        n = self.d / self.length[:, None]
        t = np.column_stack([-n[:, 1], n[:, 0]])
        return self.normal[:, None] * n, self.shear[:, None] * t

    @cached_property
    def residuals(self) -> tuple[Floats, Floats]:
        """Forces that the normal forces with the walls', and the shear forces, leave on the grains.

        (G, 2) each, of inner grains, less a uniform body force.
        """
        one, two = self.contacts.T
        count = len(self.x)
        area = np.where(self.inner, self.radii**2, 0.0)
        found: list[Floats] = []
        for force in self.parts:
            sums = [np.bincount(two, f, count) - np.bincount(one, f, count) for f in force.T]
            rest = np.column_stack(sums)
            if not found and self.walls is not None:
                np.add.at(rest, *self.walls)
            rest[~self.inner] = 0.0
            found.append(rest - area[:, None] * ((area @ rest) / (area @ area)))
        return found[0], found[1]


# Grains this near the bounding box, in mean radii, may touch a wall whose force is not known.
RIM = 0.05


def on_rim(x: Floats, radii: Floats, touched: Flags) -> Flags:
    """(G,) array: grains at the border of the box around those touched, where walls may be."""
    low, high = x - radii[:, None], x + radii[:, None]
    margin = RIM * radii.mean()
    near_low = low < low[touched].min(axis=0) + margin
    near_high = high > high[touched].max(axis=0) - margin
    return np.asarray((near_low | near_high).any(axis=1))


# Centres' distance over the sum of radii (median): clean 0.99 to 1; soft grains 0.9; diameters 0.5.
DIAMETERS, SOFT, APART, FAR = (0.25, 0.6), 0.85, 1.02, 1.5


def distances(state: Checked) -> Finding:
    """Distances of the centres against the radii: diameters for radii, other units."""
    reach = float(np.median(state.length / state.reach))
    says = f"centres in contact are {reach:.4g} times the sum of their radii apart (median)"
    found = Finding("distances", reach, says)
    remedy = "Give radii and positions in one unit of length."
    if DIAMETERS[0] < reach < DIAMETERS[1]:
        return found.error(": the radii look like diameters", "Halve the radii.")
    if reach <= DIAMETERS[0] or reach > FAR:
        unit = _power_of_ten(reach)
        cause = f"another unit, {unit} times as long" if unit else "another column or unit"
        return found.error(f": the radii look like {cause}", remedy)
    if reach < SOFT or reach > APART:
        return found.doubt(", which is far from touching", remedy)
    return found


# Share of loaded contacts across a gap: clean none.
GAPS = 0.01


def touching(state: Checked) -> Finding | None:
    """Contacts that carry load across a gap."""
    gap = -state.overlap[state.loaded]
    if len(gap) == 0:
        return None
    share = float(np.mean(gap > rounding(state.x) + 1e-9 * state.length[state.loaded]))
    says = f"{100 * share:.3g} % of the contacts that carry load are apart"
    return Finding("touching", share, says).doubt(
        ": positions and contacts of different snapshots, radii too small, or cohesion",
        "Take both tables from one snapshot.",
        share > GAPS,
    )


# Directions of the file against the centres, in radians: 1e-9 if saved within a step.
DIRECTIONS_OFF = 3e-6


def same_snapshot(state: Checked) -> Finding | None:
    """Branches or normals of the file against the centres."""
    if state.given is None:
        return None
    given, d = state.given, state.d
    size = np.hypot(*given.T)
    turned = np.abs(d[:, 0] * given[:, 1] - d[:, 1] * given[:, 0])
    off = float(np.median(turned / np.where(size > 0, size, 1.0) / state.length))
    coarse = 2 * rounding(state.x) / float(np.median(state.length))
    coarse += rounding(given) / float(np.median(size) or 1.0)
    says = f"contact directions differ from the lines of centres by {off:.2g} rad (median)"
    return Finding("same_snapshot", off, says).doubt(
        f", more than their precision, {coarse:.1g}: positions and contacts of different "
        "snapshots, or positions that moved before they were saved",
        "Take both tables from one snapshot.",
        off > DIRECTIONS_OFF + ROUNDINGS * coarse,
    )


# Share of the forces along the branches: clean 0.97 to 1; exchanged components 0 to 0.3; signs -1.
ALONG = 0.4


def directions(state: Checked) -> Finding:
    """Forces along the branches: signs, exchanged columns."""
    size = float(np.hypot(state.normal, state.shear).sum())
    share = float(state.normal.sum()) / size
    says = f"the component along the branch is {share:.3g} of the force, positive if it pushes"
    found = Finding("directions", share, says)
    if share >= ALONG:
        return found
    if share <= -ALONG:
        return found.error(
            ": they pull, as with tension positive, with forces on grain 1, or with id1 and id2 "
            "exchanged",
            "Change the sign of the forces, or exchange id1 and id2.",
        )
    n = state.d / state.length[:, None]
    # The force with its components exchanged, along the branch.
    exchanged = 2 * n[:, 0] * n[:, 1] * state.normal + (n[:, 0] ** 2 - n[:, 1] ** 2) * state.shear
    other = float(exchanged.sum()) / size
    if abs(other) > 2 * ALONG:
        return found.error(f": x and y exchanged give {other:.3g}", "Exchange fx and fy.")
    remedy = "Check the columns of the force and of the ids."
    return found.error(": forces of other contacts", remedy)


# Share of the normal force that pulls: clean 0; damping in a flow 0.1 %.
PULLING = 0.02


def pulling(state: Checked) -> Finding:
    """Share of the normal force that pulls."""
    size = np.abs(state.normal)
    share = float(size[state.normal < 0].sum() / (float(size.sum()) or 1.0))
    found = Finding("pulling", share, f"{100 * share:.3g} % of the normal forces is tension")
    return found.doubt(
        ": cohesion, damping, or rows whose grains are exchanged",
        "The contact law here has no tension: expect errors.",
        PULLING < share <= 0.5,
    )


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
    mean = float(np.hypot(state.normal, state.shear).mean())
    both = [normal + sign * shear for sign in (1, -1)]
    rest, other = (float(np.sqrt(np.einsum("gk,gk->", r, r) / inner)) / mean for r in both)
    says = f"the resultant force on a grain is {rest:.2g} of the mean contact force"
    found = Finding("balance", rest, says)
    if rest <= BALANCE:
        return found
    if other < SHEAR_TURNED * rest and inner >= FEWEST:
        return found.error(
            f", and {other:.2g} with the opposite shear: shear forces on grain 1, or id1 and "
            "id2 exchanged",
            "Change the sign of the shear forces, or exchange id1 and id2.",
        )
    return found.doubt(
        ": a flow, missing contacts or walls, or forces of other grains",
        "Stability is defined for a state at rest.",
    )


# Residual left at both grains when one contact is turned, over the change: clean 0.48 and more.
CONTACT_TURNED = 0.3
# That change over the median residual of a grain, below which a contact is not judged.
TOLD = 20.0
# The same in mean normal forces, where grains are balanced to rounding.
WEAKEST = 1e-3


def one_contact_turned(state: Checked) -> Finding | None:
    """Contacts whose force, or its normal or shear part, balances both grains with its sign turned.

    A grain on the rim does not count: walls may push on it.
    """
    inner = np.count_nonzero(state.inner)
    if inner < FEWEST:
        return None
    normal, shear = state.parts
    rest = np.add(*state.residuals)
    size = np.hypot(*rest.T)
    least = max(
        TOLD * float(np.median(size[state.inner])), WEAKEST * float(np.abs(state.normal).mean())
    )
    one, two = state.contacts.T
    rows = np.flatnonzero(state.inner[one] | state.inner[two])
    one, two = one[rows], two[rows]
    turned = np.zeros(len(rows), dtype=bool)
    for part in (normal[rows] + shear[rows], normal[rows], shear[rows]):
        change = np.hypot(*part.T) * 2
        left = [
            np.where(state.inner[end], np.hypot(*(rest[end] - sign * part).T), 0.0)
            for end, sign in ((one, -2), (two, 2))
        ]
        turned |= (change > least) & (np.maximum(*left) < CONTACT_TURNED * change)
    count = int(np.count_nonzero(turned))
    found = Finding(
        "turned", count, f"{count} contacts balance their grains if their sign is changed"
    )
    return found.doubt(
        f": the force, or its normal or shear part, between grains {state.names(rows[turned])}",
        "Change the sign of these forces, or export them again.",
        count > 0,
    )


# Angles of friction in degrees; tangents are smaller.
DEGREES = (5.0, 90.0)
# Contacts beyond Coulomb's limit, and their share: clean none; a flow 0.9 %.
BEYOND, BEYOND_SHARE = 1.01, 0.02


def friction(state: Checked) -> Finding | None:
    """Shear against Coulomb's limit; friction that is an angle."""
    typical = float(np.median(state.mu))
    if DEGREES[0] < typical < DEGREES[1]:
        found = Finding("friction", typical, f"mu is {typical:.4g}")
        tangent = np.tan(np.radians(typical))
        return found.doubt(", as an angle in degrees", f"Give its tangent, {tangent:.4g}.")
    rows = np.flatnonzero(state.loaded & (state.normal > 0))
    if len(rows) == 0 or not np.isfinite(state.mu).any():
        return None
    ratio, mu = np.abs(state.shear[rows]) / state.normal[rows], state.mu[rows]
    beyond = float(np.mean(ratio > BEYOND * mu))
    worst = float((ratio / np.where(mu > 0, mu, np.inf)).max())
    says = f"{100 * beyond:.3g} % of the loaded contacts have |T| > mu N, at most {worst:.3g} times"
    return Finding("friction", beyond, says).doubt(
        ": friction too small, or forces of another snapshot or law",
        f"The forces need mu = {float(np.quantile(ratio, 0.999)):.3g}.",
        beyond > BEYOND_SHARE,
    )


# Contacts at one ratio |T|/N, to this share of it, slide; at rest at most 2 of 7,000 agree so far.
ONE_RATIO, AT_ONE_RATIO = 1e-6, 5
# The same of a large packing, where ratios agree by chance.
AT_ONE_RATIO_SHARE = 1e-3
# |T| / (mu N) of a sliding contact, and the share of them below: clean 1 to 1e-6 and none.
AT_LIMIT, FEW_BELOW = (0.95, 1.05), 0.05


def one_ratio(state: Checked) -> Finding | None:
    """Contacts that share one ratio |T| / (mu N) below 1: they slide, and their mu is smaller."""
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
        return Finding("one_ratio", 0.0, "no contacts below mu N share one ratio |T|/N")
    count = int(sharing[below].max())
    shared = float(alike[below][np.argmax(sharing[below])])
    there = (ratio >= shared) & (ratio <= (1 + ONE_RATIO) * shared)
    needed = shared * float(np.median(mu[rows[there]]))
    says = f"{count} contacts share |T| = {shared:.4g} mu N"
    return Finding("one_ratio", shared, says).doubt(
        ": they slide, and their mu is too large", f"The forces need mu = {needed:.4g} there."
    )


def sliding(state: Checked) -> Finding | None:
    """Contacts flagged as sliding against Coulomb's limit."""
    if state.sliding is None:
        return None
    mu, limit = state.mu, state.mu * state.normal
    rows = np.flatnonzero(state.sliding & state.loaded & np.isfinite(limit) & (limit > 0))
    if len(rows) == 0:
        return None
    ratio = np.abs(state.shear[rows]) / limit[rows]
    below, typical = ratio < AT_LIMIT[0], float(np.median(ratio))
    share = float(np.mean(below))
    says = f"sliding contacts have |T| = {typical:.3g} mu N (median), {100 * share:.3g} % of them "
    found = Finding("sliding", typical, f"{says}less than mu N")
    if share > FEW_BELOW:
        needed = float(np.median(ratio[below])) * float(np.median(mu[rows[below]]))
        cause, remedy = "large", f"These need mu = {needed:.3g}."
    elif typical > AT_LIMIT[1]:
        cause, remedy = "small", f"The forces need mu = {typical * float(np.median(mu[rows])):.3g}."
    else:
        return found
    return found.doubt(f": mu too {cause}, or flags of another snapshot", remedy)


# A contact without a flag counts as sliding from this share of mu N on, as Yade's own tables do.
SLIDING_SHARE = 0.999


def flags(state: Checked) -> Finding | None:
    """Contacts at Coulomb's limit that the file does not flag as sliding."""
    if state.sliding is None:
        return None
    limit = state.mu * state.normal
    rows = np.flatnonzero(np.isfinite(limit) & (limit > 0))
    at_limit = np.abs(state.shear[rows]) >= SLIDING_SHARE * limit[rows]
    count = int(np.count_nonzero(at_limit))
    missing = int(np.count_nonzero(at_limit & ~state.sliding[rows]))
    says = f"{missing} of {count} contacts at |T| = mu N are not flagged as sliding"
    return Finding("flags", missing, says).doubt(
        ": an empty column, or another mu",
        "Leave out the column 'sliding': then it follows from the forces.",
        missing >= AT_ONE_RATIO and 2 * missing > count,
    )


# N over kn times overlap (median): 1 for linear laws, 2/3 for Hertz' tangent stiffness.
STIFF_RATIO = (0.6, 1.6)
HERTZ, HERTZ_BAND = 2.0 / 3.0, 0.01


def stiffness(state: Checked) -> Finding | None:
    """N against kn times overlap: units, exchanged stiffnesses."""
    rows = state.overlapping
    if len(rows) == 0:
        return None
    secant = state.normal[rows] / state.overlap[rows]
    kn, kt = (values[rows] for values in state.stiffnesses)
    needed, exceeds = float(np.median(secant)), float(np.median(kt / kn))
    ratio, shear_ratio = float(np.median(secant / kn)), float(np.median(secant / kt))
    found = Finding("stiffness", ratio, f"N is {ratio:.4g} times kn times the overlap (median)")
    tangents = abs(ratio / HERTZ - 1) < HERTZ_BAND
    if isinstance(state.law, HertzMindlin):
        reduced = state.radii[state.contacts[rows]].prod(axis=1) / state.reach[rows]
        modulus = float(np.median(1.5 * secant / np.sqrt(reduced * state.overlap[rows])))
        cause = f", Hertz's tangents give {HERTZ:.4g}: another law, modulus or units"
        remedy = f"Forces and overlaps need E/(1 - nu^2) = {modulus:.4g}."
        return found.doubt(cause, remedy, not tangents)
    if tangents:
        says = f"{found.says}, as Hertz's tangents give it: --law hertz for strains"
        return Finding("stiffness", ratio, says)
    if abs(shear_ratio - 1) < NEAR_ROUND < abs(exceeds - 1):
        cause = f" and {shear_ratio:.4g} times kt times it: kn and kt exchanged"
        return found.doubt(cause, "Exchange them.")
    if not STIFF_RATIO[0] <= ratio <= STIFF_RATIO[1]:
        unit = _power_of_ten(ratio)
        cause = f"units differ by {unit}, or another kn" if unit else "another kn, or units"
        return found.doubt(f": {cause}", f"Forces and overlaps need kn = {needed:.4g}.")
    if exceeds > 1 + NEAR_ROUND:
        found = Finding("stiffness", exceeds, f"kt is {exceeds:.4g} kn")
        return found.doubt(": contacts are usually softer in shear", "Check kn and kt.")
    return found


def needed_stiffness(state: Checked) -> Finding | None:
    """Kn that forces and overlaps need, of an input that has none."""
    rows = state.overlapping
    if len(rows) == 0:
        return None
    needed = float(np.median(state.normal[rows] / state.overlap[rows]))
    return Finding("stiffness", needed, f"forces and overlaps need kn = {needed:.4g} (median)")


# kn of one contact over the median, and N over kn times overlap as far the other way: clean 2.
ODD_STIFFNESS = 100.0


def odd_stiffness(state: Checked) -> Finding | None:
    """Contacts whose kn is far from the others' and from what their force and overlap need."""
    kn, _ = state.stiffnesses
    rows = np.flatnonzero(state.overlap > SURE_ROUNDINGS * rounding(state.x))
    if len(rows) == 0:
        return None
    stiffer = kn[rows] / np.median(kn[rows])
    secant = np.abs(state.normal[rows]) / (kn[rows] * state.overlap[rows])
    secant /= np.median(secant)
    odd = (stiffer > ODD_STIFFNESS) & (secant < 1 / ODD_STIFFNESS)
    odd |= (stiffer < 1 / ODD_STIFFNESS) & (secant > ODD_STIFFNESS)
    count = int(np.count_nonzero(odd))
    found = Finding("kn", count, f"{count} contacts have a kn that does not fit their force")
    return found.doubt(
        f": between grains {state.names(rows[odd])}; the median is {float(np.median(kn)):.3g}",
        "Correct kn of these contacts.",
        count > 0,
    )


# Share of the radii by which all of them are off: clean 1e-4 (kn not known), else 1e-7.
RADII_OFF = 2e-4
# That change must leave so much less of N - kn times overlap unexplained.
EXPLAINED = 3.0


def radii(state: Checked) -> Finding | None:
    """Radii that are all off by one factor: N is then linear in the overlap but not proportional.

    Least squares for `N / kn = a overlap + b (r1 + r2)`; radii too large by a share s give
    `b = -a s`.
    """
    rows = state.overlapping
    if len(rows) < FEWEST:
        return None
    needed = state.normal[rows] / state.stiffnesses[0][rows]
    overlap, reach = state.overlap[rows], state.reach[rows]
    squares = [[overlap @ overlap, overlap @ reach], [overlap @ reach, reach @ reach]]
    slope, offset = np.linalg.lstsq(squares, [overlap @ needed, reach @ needed], rcond=None)[0]
    share = float(-offset / slope)
    says = f"overlaps and forces fit radii {1 - share:.6g} times as large"
    found = Finding("radii", share, says)
    coarse = ROUNDINGS * rounding(state.x) / float(reach.mean())
    if slope <= 0 or abs(share) <= RADII_OFF + coarse:
        return found
    without = np.median(np.abs(needed - overlap * np.median(needed / overlap)))
    left = np.median(np.abs(needed - slope * overlap - offset * reach))
    return found.doubt(
        ": radii of another precision or unit, or forces that are not proportional to overlaps",
        f"Divide the radii by {1 / (1 - share):.6g}, or give kn of each contact.",
        bool(EXPLAINED * left < without),
    )


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
    says = f"the contacts give {ratio:.3g} constraints per degree of freedom of the loaded grains"
    cause = ": the sample isn't jammed, or contacts are missing"
    remedy = "In a flow, loops carry load only briefly: take a snapshot at rest."
    return Finding("jammed", ratio, says).doubt(cause, remedy, ratio < JAMMED)


def check_state(state: Checked) -> tuple[Finding, ...]:
    """All findings on a state, also those that are as they should be."""
    # Those of one group share what they compute, and run one after the other.
    groups: list[list[Callable[[Checked], Finding | None]]]
    groups = [[distances, touching, same_snapshot]]
    zero: list[Finding] = []
    known = state.forces_known or state.law is not None
    if known and not (state.normal.any() or state.shear.any()):
        says = "all contact forces are zero"
        zero.append(Finding("forces", 0.0, says, "doubt", "Export them."))
    elif state.law is not None:
        groups += [
            [balance, one_contact_turned],
            [directions, pulling, friction, one_ratio, sliding, flags],
            [stiffness, odd_stiffness, radii, jammed],
        ]
    elif state.forces_known:
        groups += [[balance, one_contact_turned], [directions, pulling, needed_stiffness]]

    @np.errstate(over="ignore", divide="ignore", invalid="ignore")
    def run(group: list[Callable[[Checked], Finding | None]]) -> list[Finding | None]:
        return [check(state) for check in group]

    found = [one for several in in_threads(run, groups) for one in several if one is not None]
    return (*found, *zero)


# Two columns of one quantity agree to this share of the mean force: clean 5e-9, text 1e-6.
SAME_FORCE = 1e-3


def same_force(name: str, column: Floats, used: Floats, scale: float, rows: Integers) -> Finding:
    """Forces in a column of the file, of its `rows`, against those that are used."""
    off = np.abs(column - used) / (scale or 1.0)
    wrong = off > SAME_FORCE
    says = (
        f"{name} differs from the force that is used by at most {float(off.max()):.2g} mean forces"
    )
    found = Finding(name, float(off.max()), says)
    if not wrong.any():
        return found
    turned = bool(np.median(np.abs(column + used)) <= SAME_FORCE * scale)
    cause = "tension positive" if turned else "of other contacts, units or snapshots"
    return found.doubt(
        f", and more than {SAME_FORCE:g} in {np.count_nonzero(wrong)} rows, the first is "
        f"{rows[wrong].min()}: {name} is {cause}",
        "Correct one of the two.",
    )


# Share of contacts in two rows: all where rows are of grains, but for some with fixed grains.
REPEATED = 0.5


def repeated(same: int, turned: int, count: int, off: Floats) -> Finding:
    """Rows of contacts that stand in an earlier row, with the same first grain or the other one.

    A list may have each of `count` contacts once from each of its grains, but for fixed grains.
    `off` (rows,) are the forces in such rows less those in the earlier one, in mean forces.
    """
    says = f"{same + turned} of {count} contacts are also in an earlier row"
    found = Finding("repeated", (same + turned) / count, says)
    wrong = int(np.count_nonzero(off > SAME_FORCE))
    if wrong:
        return found.doubt(f", {wrong} of them with another force", "Dump it again.")
    cause = ": rows of two processors, or files that were joined"
    return found.doubt(cause, "Dump each contact once.", same > 0 or turned < REPEATED * count)


# Change of T over kt times slip, between snapshots: clean 1 to 1e-7 in steps of 2e-5 of strain.
KT = 0.1
# Share of the contacts whose change of T must agree to KT for a judgement on kt.
AGREEING = 0.5
# Contacts to which unknown rotations are fitted at most, and how often they are weighted anew.
FITTED, REWEIGHTED = 50_000, 12


def check_kt(before: Snapshot, after: Snapshot) -> Finding | None:
    """Changes of T between two snapshots against kt times the slip of the grains.

    Contacts that are elastic in both count. Rotations that the file lacks are fitted to the same
    contacts, with the factor on kt, by reweighted least squares.
    """
    if before.regime is None or after.regime is None:
        return None
    if not isinstance(before.law, LinearFrictional):
        return None
    # Loads sparse matrices, which a snapshot alone needs nowhere else.
    from loops.tracking import match_contacts

    match = match_contacts(before.graph, before.ids, after.graph, after.ids)
    first = match.shared
    second = match.after[first]
    elastic = (before.regime[first] != Regime.SLIDING) & (after.regime[second] != Regime.SLIDING)
    # Contacts without friction or shear stiffness keep T = 0.
    elastic &= (before.graph.shear_force[first] != 0) | (after.graph.shear_force[second] != 0)
    elastic &= np.broadcast_to(before.law.kt, before.graph.contact_count)[first] > 0
    first, second = first[elastic], second[elastic]
    if len(first) < FEWEST:
        return None
    d = branch_vectors(before.graph)[first]
    e = branch_vectors(after.graph)[second] * np.where(match.reversed[first], -1, 1)[:, None]
    turn = np.arctan2(d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0], np.einsum("ck,ck->c", d, e))
    pairs = before.graph.contacts[first]
    arms = before.graph.radii[pairs]
    reach = arms.sum(axis=1)
    kt = np.broadcast_to(before.law.kt, before.graph.contact_count)[first]
    change = after.graph.shear_force[second] - before.graph.shear_force[first]
    needed = -change / kt
    if not needed.any():
        return None
    if before.law.shear_increment == "branch":
        length = (np.hypot(*d.T) + np.hypot(*e.T)) / 2
        arms, reach = arms * (length / reach)[:, None], length
    spare = len(first)
    if before.rotation is None or after.rotation is None:
        strip = np.argsort(before.graph.x[pairs[:, 0], 0])[:FITTED]
        pairs, arms, needed, kt = pairs[strip], arms[strip], needed[strip], kt[strip]
        moved = (reach * turn)[strip]
        spare = len(strip) - len(np.unique(pairs)) - 1
        if spare < FEWEST:
            return None
        spins = _fitted_spins(pairs, arms, moved, needed)
    else:
        spin = after.rotation[index_of(after.ids, before.ids)] - before.rotation
        spins, moved = np.remainder(spin + np.pi, 2 * np.pi) - np.pi, reach * turn
    slip = moved - np.einsum("ck,ck->c", arms, spins[pairs])
    if not slip.any():
        return None
    factor = float(np.median((needed / slip)[slip != 0]))
    wrong = np.count_nonzero(np.abs(needed - factor * slip) > KT * np.abs(factor * slip))
    agreeing = max(1 - wrong / spare, 0.0)
    if agreeing < AGREEING:
        says = f"T of {100 * agreeing:.3g} % of the contacts follows the motion since the snapshot "
        return Finding("kt", agreeing, f"{says}before: the step is too long to check kt")
    says = f"T changed by {factor:.4g} times kt times the slip since the snapshot before (median)"
    return Finding("kt", factor, says).doubt(
        f": kt is too {'small' if factor > 1 else 'large'}",
        f"The forces need kt = {factor * float(np.median(kt)):.4g}.",
        abs(factor - 1) > KT,
    )


def _fitted_spins(pairs: Integers, arms: Floats, moved: Floats, needed: Floats) -> Floats:
    """Spin of each grain from `moved = arms spins + needed / factor`, outliers weighted down."""
    import scipy.sparse as sp
    from scipy.sparse.linalg import spsolve

    grains, place = np.unique(pairs, return_inverse=True)
    place = place.reshape(pairs.shape)
    rows, count = np.arange(len(pairs)), len(grains)
    size = float(arms.mean())
    last = needed / (float(np.abs(needed).mean()) or 1.0)
    values = np.concatenate([arms.T.ravel() / size, last])
    columns = np.concatenate([*place.T, np.full(len(pairs), count)])
    matrix = sp.csr_matrix((values, (np.tile(rows, 3), columns)), shape=(len(pairs), count + 1))
    weight = np.ones(len(pairs))
    for _ in range(REWEIGHTED):
        weighted = matrix.T @ sp.diags_array(weight)
        normal = (weighted @ matrix).tocsc()
        # Grains in rows may turn against one another like gears: held by a millionth of a spring.
        normal += 1e-6 * sp.diags_array(normal.diagonal())
        found = spsolve(normal, weighted @ moved)
        left = np.abs(moved - matrix @ found)
        weight = 1 / (left + 1e-6 * np.abs(moved).mean())
    spins = np.zeros(int(pairs.max()) + 1)
    spins[grains] = found[:-1] / size
    return spins


def rounding(values: Floats) -> float:
    """Half the last digit that numbers show: of single precision, of text of 6 to 9 digits."""
    flat = values.ravel()
    shown = flat[:: max(1, len(flat) // 100)]
    size = float(np.abs(shown).max(initial=0.0))
    if (shown.astype(np.float32) == shown).all():
        return size * 2.0**-24
    for digits in (6, 7, 8, 9):
        if all(float(f"{value:.{digits}g}") == value for value in shown.tolist()):
            return 0.5 * size * 10.0 ** (1 - digits)
    return 1e-15 * size


def _power_of_ten(ratio: float) -> str:
    """The power of ten that a ratio is, as text, or nothing."""
    power = round(np.log10(ratio)) if ratio > 0 else 0
    near = power != 0 and abs(np.log10(ratio) - power) < NEAR_ROUND
    return f"10^{power}" if near else ""
