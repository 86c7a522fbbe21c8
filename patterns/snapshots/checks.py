"""What is wrong with a snapshot, told from its own numbers: one family of faults a function.

Limits lie between what 60 snapshots of Yade, LAMMPS and LIGGGHTS show and what the faults give; the
figures stand beside each. All sums are over all contacts, medians over a sample of them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from loops import GrainGraph, LinearFrictional, Regime
from loops.arrays import Floats, Integers, in_threads
from patterns.snapshots.yade.shear import on_rim

Severity = Literal["ok", "doubt", "error"]
SAMPLE = 100_000  # contacts that medians are taken over
LOADED = 0.1  # contacts with more than this share of the mean N tell more than rounding
# Share of the forces along the branches: 0.97 to 1; exchanged components 0 to 0.3, signs -1.
ALONG, PULLING = 0.4, 0.02
# Out of balance over the mean force: to 0.063; flowing 0.27; shear of the other sign 0.2 to 1.2.
BALANCE, TURNED = 0.1, 0.3
# Share of loaded contacts beyond Coulomb's limit: none (one flow: 0.9 %).
BEYOND, BEYOND_SHARE = 1.01, 0.02
DEGREES = (5.0, 90.0)  # no friction, but angles
# N over kn times overlap: 1 for linear laws, 2/3 for Hertz' tangent stiffness.
STIFF, ROUND_NUMBER = (0.6, 1.6), 0.05
# Distances over sums of radii: 0.99 to 1; soft grains 0.7; diameters for radii 0.5.
DIAMETERS, SOFT, APART, FAR = (0.25, 0.6), 0.85, 1.02, 1.5
GAPS = 0.01  # share of loaded contacts that may be apart: none
# Directions of the file against the centres, in radians: 1e-9 if saved within a step.
TURNED_BY = 3e-6
# Constraints over freedoms: 1.03 and more where load is carried, 0.89 in a flow.
JAMMED, FEWEST = 0.95, 20


class Finding(NamedTuple):
    """What a check found: the number that tells it, a sentence on the cause, what to do."""

    check: str
    number: float
    says: str
    severity: Severity = "ok"
    remedy: str = ""

    def __str__(self) -> str:
        return f"{self.says}. {self.remedy}"

    def doubt(self, cause: str, remedy: str, holds: bool = True) -> Finding:
        """The same as a doubt, with its likely cause, if one holds."""
        return self._worse("doubt", cause, remedy) if holds else self

    def error(self, cause: str, remedy: str) -> Finding:
        """The same as an error, after which nothing meaningful can follow."""
        return self._worse("error", cause, remedy)

    def _worse(self, severity: Severity, cause: str, remedy: str) -> Finding:
        return Finding(self.check, self.number, f"{self.says}{cause}", severity, remedy)


class Checked:
    """What the checks look at: the contacts between grains, their branches, law and regimes.

    `given` (C, 2) are the branches or normals of the file, `walls` the grains that walls touch and
    the forces on them (W, 2).
    """

    def __init__(
        self,
        graph: GrainGraph,
        d: Floats,
        length: Floats,
        law: LinearFrictional | None,
        regime: NDArray[np.int8] | None,
        given: Floats | None,
        walls: tuple[Integers, Floats] | None,
    ) -> None:
        self.x, self.radii, self.contacts = graph.x, graph.radii, graph.contacts
        self.normal, self.shear = graph.normal_force, graph.shear_force
        self.d, self.length, self.law, self.given, self.walls = d, length, law, given, walls
        self.sliding = None if regime is None else regime == Regime.SLIDING
        self.degree = np.bincount(self.contacts.ravel(), minlength=len(self.x))
        self.inner = self.degree > 0
        if graph.cell is None and walls is None:
            # Walls whose forces are not known may push on the rim.
            self.inner &= ~on_rim(self.x, self.radii, self.inner)
        count = len(self.contacts)
        self.rows = slice(None, None, max(1, count // SAMPLE))
        limit = LOADED * float(self.normal.mean())
        self.loaded = self.normal > limit if limit > 0 else np.ones(count, dtype=bool)

    def parameter(self, name: str) -> Floats:
        """(C,) array of `kn`, `kt` or `mu`."""
        return np.broadcast_to(getattr(self.law, name), len(self.contacts))


def check_state(state: Checked) -> tuple[Finding, ...]:
    """All findings on a state, also what is as it should be."""
    checks: list[Callable[[Checked], Finding | None]] = [distances, touching, same_snapshot]
    forces: tuple[Finding, ...] = ()
    if state.law is not None and not (state.normal.any() or state.shear.any()):
        forces = (Finding("forces", 0.0, "all contact forces are zero", "doubt", "Export them."),)
    elif state.law is not None:
        checks += [directions, pulling, balance, friction, sliding, stiffness, jammed]

    @np.errstate(over="ignore", divide="ignore", invalid="ignore")
    def told(check: Callable[[Checked], Finding | None]) -> Finding | None:
        return check(state)

    return (*(found for found in in_threads(told, checks) if found is not None), *forces)


def distances(state: Checked) -> Finding:
    """Distances of the centres against the radii: diameters, other units."""
    rows = state.rows
    reach = float(np.median(state.length[rows] / state.radii[state.contacts[rows]].sum(axis=1)))
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


def touching(state: Checked) -> Finding | None:
    """Contacts that carry load across a gap."""
    rows = np.flatnonzero(state.loaded)[state.rows]
    if len(rows) == 0:
        return None
    gap = state.length[rows] - state.radii[state.contacts[rows]].sum(axis=1)
    share = float(np.mean(gap > rounding(state.x) + 1e-9 * state.length[rows]))
    says = f"{100 * share:.3g} % of the contacts that carry load are apart"
    return Finding("touching", share, says).doubt(
        ": positions and contacts of different snapshots, radii too small, or cohesion",
        "Take both tables from one snapshot.",
        share > GAPS,
    )


def same_snapshot(state: Checked) -> Finding | None:
    """Branches or normals of the file against the centres."""
    if state.given is None:
        return None
    rows = state.rows
    given, d = state.given[rows], state.d[rows]
    size = np.hypot(*given.T)
    turned = np.abs(d[:, 0] * given[:, 1] - d[:, 1] * given[:, 0])
    off = float(np.median(turned / np.where(size > 0, size, 1.0) / state.length[rows]))
    coarse = 2 * rounding(state.x) / float(np.median(state.length[rows]))
    coarse += rounding(given) / float(np.median(size) or 1.0)
    says = f"contact directions are {off:.2g} rad off the lines of centres (median)"
    return Finding("same_snapshot", off, says).doubt(
        f", and the numbers are good to {coarse:.1g}: positions and contacts of different "
        "snapshots, or positions moved on before they were saved",
        "Take both tables from one snapshot.",
        off > TURNED_BY + 5 * coarse,
    )


def directions(state: Checked) -> Finding:
    """Forces along the branches: signs, exchanged columns."""
    size = float(np.hypot(state.normal, state.shear).sum())
    share = float(state.normal.sum()) / size
    says = f"the forces act along the branches to {share:.3g} of their size, push positive"
    found = Finding("directions", share, says)
    if share >= ALONG:
        return found
    if share <= -ALONG:
        return found.error(
            ": they pull, as with tension positive, with forces on grain 1, or with id1 and id2 "
            "exchanged",
            "Turn the sign of the forces, or exchange id1 and id2.",
        )
    n = state.d / state.length[:, None]
    # The force with its components exchanged, along the branch.
    exchanged = 2 * n[:, 0] * n[:, 1] * state.normal + (n[:, 0] ** 2 - n[:, 1] ** 2) * state.shear
    other = float(exchanged.sum()) / size
    if abs(other) > 2 * ALONG:
        return found.error(f": x and y exchanged give {other:.3g}", "Exchange fx and fy.")
    remedy = "Check the columns of the force and of the ids."
    return found.error(": forces of other contacts", remedy)


def pulling(state: Checked) -> Finding:
    """Share of the normal force that pulls."""
    size = np.abs(state.normal)
    share = float(size[state.normal < 0].sum() / (float(size.sum()) or 1.0))
    found = Finding("pulling", share, f"{100 * share:.3g} % of the normal force pulls")
    return found.doubt(
        ": cohesion, damping, or rows whose grains are exchanged",
        "The law of the contacts here carries no tension.",
        PULLING < share <= 0.5,
    )


def balance(state: Checked) -> Finding | None:
    """What the forces leave on a sample of grains, a uniform body force aside."""
    chosen = np.flatnonzero(state.inner)[:: max(1, 5 * len(state.x) // SAMPLE)]
    if len(chosen) < 3:
        return None
    place = np.full(len(state.x), len(chosen))
    place[chosen] = np.arange(len(chosen))
    taken = place < len(chosen)
    one, two = state.contacts.T
    rows = np.flatnonzero(taken[one] | taken[two])
    ends = place[state.contacts[rows]]
    n = state.d[rows] / state.length[rows, None]
    push = _on_grains(ends, state.normal[rows, None] * n, len(chosen))
    turned = np.column_stack([-n[:, 1], n[:, 0]])
    turn = _on_grains(ends, state.shear[rows, None] * turned, len(chosen))
    if state.walls is not None:
        grain, force = state.walls
        np.add.at(push, place[grain[taken[grain]]], force[taken[grain]])
    area = state.radii[chosen] ** 2
    mean = float(np.hypot(state.normal[state.rows], state.shear[state.rows]).mean())
    rest = [_rest(area, push + sign * turn) / mean for sign in (1, -1)]
    says = f"contact forces leave the grains {rest[0]:.2g} mean forces out of balance"
    found = Finding("balance", rest[0], says)
    if rest[0] <= BALANCE:
        return found
    if rest[1] < TURNED * rest[0] and len(chosen) >= FEWEST:
        return found.error(
            f", and {rest[1]:.2g} with shear turned around: shear forces on grain 1, or id1 and "
            "id2 exchanged",
            "Turn the sign of the shear forces, or exchange id1 and id2.",
        )
    return found.doubt(
        ": a flow, missing contacts or walls, or forces that are not these grains'",
        "Stability is that of a state at rest.",
    )


def friction(state: Checked) -> Finding | None:
    """Shear against Coulomb's limit; friction that is an angle."""
    every = state.parameter("mu")
    typical = float(np.median(every[state.rows]))
    if DEGREES[0] < typical < DEGREES[1]:
        found = Finding("friction", typical, f"mu is {typical:.4g}")
        tangent = np.tan(np.radians(typical))
        return found.doubt(", as an angle in degrees", f"Give its tangent, {tangent:.4g}.")
    rows = np.flatnonzero(state.loaded & (state.normal > 0))[state.rows]
    if len(rows) == 0 or not np.isfinite(every).any():
        return None
    ratio, mu = np.abs(state.shear[rows]) / state.normal[rows], every[rows]
    beyond = float(np.mean(ratio > BEYOND * mu))
    worst = float((ratio / np.where(mu > 0, mu, np.inf)).max())
    says = f"{100 * beyond:.3g} % of the loaded contacts have |T| > mu N, at most {worst:.3g} times"
    return Finding("friction", beyond, says).doubt(
        ": friction too small, or forces of another snapshot or law",
        f"The forces need mu = {float(np.quantile(ratio, 0.999)):.3g}.",
        beyond > BEYOND_SHARE,
    )


def sliding(state: Checked) -> Finding | None:
    """Contacts flagged as sliding against Coulomb's limit."""
    if state.sliding is None:
        return None
    rows = np.flatnonzero(state.sliding)[state.rows]
    mu = state.parameter("mu")[rows]
    limit = mu * state.normal[rows]
    known = np.isfinite(limit) & (limit > 0)
    if not known.any():
        return None
    ratio = float(np.median(np.abs(state.shear[rows][known]) / limit[known]))
    found = Finding("sliding", ratio, f"sliding contacts have |T| = {ratio:.3g} mu N (median)")
    return found.doubt(
        f": mu too {'large' if ratio < 1 else 'small'}, or flags of another snapshot",
        f"The forces need mu = {ratio * float(np.median(mu[known])):.3g}.",
        abs(ratio - 1) > 0.1,
    )


def stiffness(state: Checked) -> Finding | None:
    """N against kn times overlap: units, exchanged stiffnesses."""
    rows = np.flatnonzero(state.loaded)[state.rows]
    overlap = state.radii[state.contacts[rows]].sum(axis=1) - state.length[rows]
    # Coarser coordinates, and grains that are apart, say nothing of the stiffness.
    if len(rows) == 0 or float(np.median(overlap)) <= 2 * rounding(state.x):
        return None
    positive = overlap > 0
    secant = state.normal[rows][positive] / overlap[positive]
    kn, kt = (state.parameter(name)[rows][positive] for name in ("kn", "kt"))
    needed, exceeds = float(np.median(secant)), float(np.median(kt / kn))
    ratio, shear_ratio = float(np.median(secant / kn)), float(np.median(secant / kt))
    found = Finding("stiffness", ratio, f"N is {ratio:.4g} times kn times the overlap (median)")
    if abs(shear_ratio - 1) < ROUND_NUMBER < abs(exceeds - 1):
        cause = f" and {shear_ratio:.4g} times kt times it: kn and kt exchanged"
        return found.doubt(cause, "Exchange them.")
    if not STIFF[0] <= ratio <= STIFF[1]:
        unit = _power_of_ten(ratio)
        cause = f"units differ by {unit}, or another kn" if unit else "another kn, or units"
        return found.doubt(f": {cause}", f"Forces and overlaps need kn = {needed:.4g}.")
    if exceeds > 1 + ROUND_NUMBER:
        found = Finding("stiffness", exceeds, f"kt is {exceeds:.4g} kn")
        return found.doubt(", where grains are softer to shear", "Check kn and kt.")
    return found


def jammed(state: Checked) -> Finding | None:
    """Constraints of the contacts against the freedoms of the grains that carry load."""
    if state.sliding is None:
        return None
    degree = state.degree
    walls = np.zeros(len(degree))
    if state.walls is not None:
        walls += np.bincount(state.walls[0], minlength=len(degree))
    # Two freedoms without friction, three with: shear that is zero throughout is none.
    rough = bool(state.shear.any())
    held = state.inner & (degree + walls >= (2 if rough else 3))
    if np.count_nonzero(held) < FEWEST:
        return None
    slides = np.bincount(state.contacts[state.sliding].ravel(), minlength=len(degree))
    shared = (2 * degree - slides if rough else degree) / 2 + walls
    ratio = float(shared[held].sum() / ((3 if rough else 2) * np.count_nonzero(held)))
    says = f"contacts give {ratio:.3g} constraints for each freedom of the grains that carry load"
    cause = ": the sample isn't jammed, or contacts are missing"
    remedy = "Loops of a flow carry no load for long."
    return Finding("jammed", ratio, says).doubt(cause, remedy, ratio < JAMMED)


def same_normal_force(fn: Floats, normal: Floats) -> Finding:
    """The column `fn` against the part of the total force along the branch."""
    scale = float(np.abs(normal).mean()) or 1.0
    off, turned = (float(np.median(np.abs(fn - sign * normal))) / scale for sign in (1, -1))
    says = f"fn is {off:.2g} mean forces off the normal part of fx_on_2, fy_on_2 (median)"
    cause = "tension positive" if turned <= 1e-3 else "of other contacts, units or snapshots"
    found = Finding("fn", off, says)
    return found.doubt(f", which are used: fn is {cause}", "Correct one of the two.", off > 1e-3)


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
    near = power != 0 and abs(np.log10(ratio) - power) < ROUND_NUMBER
    return f"10^{power}" if near else ""


def _on_grains(ends: Integers, force: Floats, count: int) -> Floats:
    """Sum on the first `count` grains of forces that act on grain 2 and back on grain 1."""
    one, two = ends.T
    sums = [np.bincount(two, f, count + 1) - np.bincount(one, f, count + 1) for f in force.T]
    return np.column_stack(sums)[:count]


def _rest(area: Any, force: Floats) -> float:
    """Root mean square of forces on grains, less one in proportion to their areas."""
    rest = force - area[:, None] * ((area @ force) / (area @ area))
    return float(np.sqrt(np.einsum("gk,gk->", rest, rest) / len(rest)))
