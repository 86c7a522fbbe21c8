"""The packing of a snapshot: boundary, rate problem, state at rest, and every loop inside it."""

from __future__ import annotations

import copy
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from loops import InputError
from loops.arrays import Floats, Integers
from loops.errors import counted
from loops.scene import Scene, Subject, scene_of
from patterns import Snapshot, WallContacts, planar
from patterns.snapshots.walls import box_corners
from stability.spectra import subspace_basis
from stability.verdict import loop_spectra, loop_stability
from studies.output import Columns, definitions
from studies.snapshot.table import EIGENVALUES, PLACE, share

if TYPE_CHECKING:
    from loops.in_place import LoopsInPlace, Method
    from stability.packing.hold import HeldPacking, HoldControl
    from stability.packing.loop_regimes import LoopsAtYield
    from stability.packing.response import PackingRates

# Shares of their strength from which contacts slide: at it, within a thousandth, a hundredth.
AT_LIMIT = 1.0 - 1e-6
BANDS = (AT_LIMIT, 0.999, 0.99)
WITHIN = {AT_LIMIT: "within a millionth", 0.999: "within a thousandth", 0.99: "within a hundredth"}
# Columns of the loops at rest.
AT_REST = ("lambda_min_held", "confirmed", *(f"direction_{ij}" for ij in ("11", "12", "22")))
# Unbalanced force over the mean contact force above which a note says so.
UNBALANCED = 1e-3
# Unbalanced force over the mean contact force above which the sample flows and isn't followed.
FLOWS = 0.1


def fixed_point(before: Snapshot, after: Snapshot, H: Floats) -> Floats | None:
    """(2,) point at rest of the strain `H` of a box of plates, whichever of them moved.

    The lower left corner where the first length stays; None without four plates along the axes.
    """
    if before.walls is None or after.walls is None:
        return None
    corners = box_corners(before.graph.x, before.walls), box_corners(after.graph.x, after.walls)
    if corners[0] is None or corners[1] is None:
        return None
    moved, strain = corners[1][0] - corners[0][0], np.diag(H)
    return np.asarray(corners[0][0] + np.divide(moved, strain, out=0.0 * moved, where=strain != 0))


def sample_edge(snapshot: Snapshot, yield_band: float, fixed: Floats | None = None) -> PackingRates:
    """Rate problem of the packing; contacts with |T| of at least `yield_band` mu N may slide.

    Plates strain about the point `fixed`, by default the lower left corner.
    """
    from stability.packing.response import rate_problem

    scene = snapshot.scene
    boundary = scene.boundary
    if boundary.walls is not None:
        boundary = replace(boundary, walls=replace(boundary.walls, fixed=fixed))
    return rate_problem(replace(scene, boundary=boundary), yield_band=yield_band)


def balance_notes(subject: Subject) -> list[str]:
    """Notes on the unbalanced force of a state to be followed; `InputError` if the sample flows."""
    from loops.contacts import contacts_at_start

    # Paths begin with the normal forces of the overlaps.
    share = contacts_at_start(scene_of(subject)).with_normal_forces().unbalanced
    told = f"an unbalanced force of {share:.2g} of the mean contact force"
    if share > FLOWS:
        expected = f"{FLOWS:g} at most: a state near rest"
        raise InputError("snapshot", told, expected, "Bring the sample to rest first.")
    kept = "it stays as a constant load, and the motion it stands for is not followed"
    return [f"{told}: {kept}"] if share > UNBALANCED else []


@dataclass(frozen=True, eq=False)
class InPacking:
    """Method of judging loops in their packing, and the loops (R,) of the state at rest.

    Smallest eigenvalues are over the mean kn; not numbers where no share counts them.
    """

    method: dict[str, Any]
    at_rest: dict[str, Any]
    order: Integers
    smallest: Floats


def add_in_packing(
    snapshot: Snapshot,
    table: Columns,
    method: Method,
    *,
    hold: bool = False,
    yield_band: float | None = None,
) -> tuple[InPacking, list[str]]:
    """Add the columns of the loops in place to the table; return how they were judged, and notes.

    Contacts of each of `BANDS` slide at rest, or of one `yield_band`.
    """
    # Loaded only when loops are judged in place.
    from loops.in_place import loops_in_place
    from loops.tracking import Fate, loop_fates, match_contacts
    from stability.packing.loop_regimes import loops_at_yield

    kn, bands = snapshot.mean_kn, BANDS if yield_band is None else (yield_band,)
    rest, held = held_snapshot(snapshot, "strain" if hold else None)
    place, notes = loops_in_place(snapshot.scene, method=method), [*snapshot.boundary_and_notes[1]]
    stuck = loops_at_yield(snapshot, None, method=method).smallest
    table |= place_columns(place, kn) | {f"{PLACE}_lambda_min_stuck": stuck / kn}
    if not np.isfinite(place.matrix).any():
        notes.append(
            "no loop could be judged in the packing: each has a grain that is held or carries "
            "no force"
        )
    row = np.arange(len(stuck))
    if hold:
        notes += rest.notes[len(snapshot.notes) :]
        stuck = loops_at_yield(rest, None, method=method).smallest
        contacts = match_contacts(snapshot.graph, snapshot.ids, rest.graph, rest.ids)
        fates = loop_fates(contacts, snapshot.faces, rest.faces)
        row = np.where(fates.before == Fate.SURVIVED, fates.successor, -1)
    moves = "" if hold else motion_note(snapshot)
    found = [] if moves else [loops_at_yield(rest, band, method=method) for band in bands]
    shares = [_share_of_band(one, hold) for one in found]
    columns, main = np.full((len(AT_REST), len(stuck)), np.nan), len(found) // 2
    if found and not shares[main]["withheld"]:
        one = found[main]
        confirmed = np.where(one.unstable, one.confirmed, np.nan)
        H = one.direction @ subspace_basis("symmetric")
        columns = np.array([one.smallest / kn, confirmed, *H[:, [0, 1, 3]].T])
    for name, values in zip(AT_REST, columns, strict=True):
        table[f"{PLACE}_{name}"] = np.where(row < 0, np.nan, values[row])
    carrying = place.system.carrying
    left_out = {name: getattr(carrying, name) for name in ("rattlers", "clusters", "clustered")}
    told = {"method": method, "boundary": place.system.boundary, **left_out}
    at_rest = {
        "withheld": moves,
        "held": held,
        "loops": len(stuck),
        "judged": int(np.count_nonzero(np.isfinite(columns[0]))),
        "loops_in_table": int(np.count_nonzero(row >= 0)),
        "stuck": None if moves else _share_of(stuck),
        "bands": shares,
    }
    at_rest["says"] = said_at_rest(at_rest)
    order = rest.faces.order[rest.faces.loops]
    return InPacking(told, at_rest, order, columns[0]), notes


def _share_of(smallest: Floats) -> dict[str, Any]:
    """Return number and share of the loops with a negative eigenvalue, of those with one."""
    unstable = smallest[np.isfinite(smallest)] < 0
    return {"unstable": int(np.count_nonzero(unstable)), **share(unstable)}


def _share_of_band(found: LoopsAtYield, hold: bool) -> dict[str, Any]:
    """Return the share of unstable loops with the contacts of a band sliding, or why none."""
    soft, contacts, why = found.softening, len(found.rates.rows), ""
    if soft:
        remedy = "take another state" if hold else "bring the state to rest first with --hold"
        why = (
            f"their slip drives on {soft} of {contacts} contacts that may slide (M_cc <= 0), "
            f"so that next to no rates agree; {remedy}"
        )
    return {
        "band": found.band,
        "contacts": contacts,
        **_share_of(found.smallest[:0] if why else found.smallest),
        "confirmed": None if soft is None else int(np.count_nonzero(found.confirmed)),
        "withheld": why,
    }


def said_at_rest(at_rest: dict[str, Any]) -> str:
    """Say the share of unstable loops at rest in one sentence, and what it hangs on."""
    if at_rest["withheld"]:
        return (
            f"The share of loops unstable in their packing is withheld, as {at_rest['withheld']}."
        )
    stuck, (first, *wider) = at_rest["stuck"], at_rest["bands"]
    stable = "every loop is stable in its packing"
    if stuck["unstable"] or not stuck["count"]:
        stable = f"{_said(stuck)} do negative work in some direction"
    said, bands = f"At rest, if all contacts stick, {stable}", [first, *wider]
    if first["band"] == AT_LIMIT and not first["contacts"]:
        said, bands = f"At rest no contact stands at its friction limit and {stable}", wider
    slide, do = "if contacts {} of their limit slide", " would do negative work in some direction"
    for one in bands:
        within = WITHIN.get(one["band"]) or f"within {1.0 - one['band']:.3g}"
        if one["withheld"]:
            said += f"; {slide.format(within)}, the share is withheld: {one['withheld']}"
        elif do:
            said, do = f"{said}; {slide.format(within)}, {_said(one)}{do}", ""
        else:
            said += f", {_said(one)} if those {within} do"
    return f"{said}: {definitions('assumptions')['rank']}."


def _said(one: dict[str, Any]) -> str:
    """Share of the unstable loops with its error, the numbers of loops, and of those confirmed."""
    if not one["unstable"]:
        return f"none of {counted(one['count'], 'loop')}"
    confirmed = "" if "confirmed" not in one else "; regimes not sought"
    if one.get("confirmed") is not None:
        confirmed = f"; {one['confirmed']} confirmed"
    numbers = f"({one['unstable']} of {one['count']}{confirmed})"
    return f"{100 * one['mean']:.2g} +- {100 * one['std_error']:.1g} % {numbers}"


def place_columns(place: LoopsInPlace, kn: float) -> dict[str, Floats]:
    """Eigenvalues over `kn` and the stated error; a sign within its error is not a number."""
    found, eigenvalues = loop_stability(place.matrix), loop_spectra(place.matrix)
    sure = np.abs(eigenvalues) > place.matrix_error[:, None]
    columns = {
        f"{PLACE}_{name}": np.where(own, values, np.nan)
        for name, values, own in zip(EIGENVALUES, eigenvalues.T / kn, sure.T, strict=True)
    }
    columns[f"{PLACE}_unstable_fraction"] = np.where(
        sure.all(axis=1), found.unstable_fraction, np.nan
    )
    for name in ("cone_opening", "soft_angle"):
        angle = np.degrees(getattr(found, name))
        columns[f"{PLACE}_{name}"] = np.where(sure[:, 0], angle, np.nan)
    around = loop_spectra(place.surroundings)[:, 0]
    known = np.abs(around) > place.surroundings_error
    columns["surroundings_lambda_min"] = np.where(known, around / kn, np.nan)
    columns[f"{PLACE}_error"] = np.where(np.isnan(place.matrix[:, 0, 0]), np.nan, place.error)
    return columns


# Above this unbalanced force the rates of a state are not those of an equilibrium.
MOVING = 5e-4
# Above this spread of the stress the state at rest depends on the way to it.
REST_SPREAD = 0.03


def motion_note(snapshot: Snapshot) -> str:
    """Say that a state moves, and what to do; nothing at rest, or where no walls are known."""
    from stability.packing.hold import unbalanced_force

    boundary = snapshot.scene.boundary
    if boundary.kind == "outline" or not (
        (before := unbalanced_force(snapshot.graph, boundary)) > MOVING
    ):
        return ""
    return (
        f"the state moves: its unbalanced force is {before:.2g} of the mean contact force, so "
        "that its rates are not those of an equilibrium; bring it to rest first with --hold"
    )


def held_snapshot(
    snapshot: Snapshot, control: HoldControl | None
) -> tuple[Snapshot, dict[str, Any] | None]:
    """The snapshot at rest, and what holding changed, for the summary.

    Without a control the snapshot itself, with a note if it moves. `InputError` if the sample does
    not come to rest.
    """
    from stability.packing.hold import hold

    scene, walls = snapshot.scene, snapshot.walls
    if control is None:
        if not (note := motion_note(snapshot)):
            return snapshot, None
        # With its loops, and the area and walls of what it was taken out of.
        noted = copy.copy(snapshot)
        vars(noted)["notes"] = (*snapshot.notes, note)
        return noted, None
    if scene.boundary.kind == "outline":
        expected = "a periodic cell or known walls, no free surface"
        remedy = (
            "Give --cell, or the wall contacts. A sample that rests under its weight cannot be "
            "held: probe it as it is, its outline follows the strain."
        )
        raise InputError("--hold", "a sample whose walls are not known", expected, remedy)
    held = hold(scene, control=control)
    _require_rest(held)
    notes = [str(held)]
    if held.spread > REST_SPREAD:
        notes.append(
            "the state at rest depends on how it is reached: with two values of damping the "
            f"stresses differ by {100 * held.spread:.3g} %; all results apply only to "
            "the state at rest that was found"
        )
    planes = held.boundary.walls
    if planes is not None:
        force, springs = np.asarray(planes.force), (planes.kn, planes.kt, planes.mu)
        walls = WallContacts(planes.grain, force, -planes.branch, *springs)
    at_rest = replace(
        snapshot, graph=held.scene.graph, law=held.law, regime=held.scene.graph.regime,
        wall_contacts=0 if walls is None else len(walls.grain), walls=walls,
        notes=(*snapshot.notes, *notes), velocity=None, spin=None, rotation=None,
    )  # fmt: skip
    if walls is not None:
        vars(at_rest)["area"] = snapshot.area
    arrays = ("graph", "law", "boundary", "ids")
    changes = {one.name: getattr(held, one.name) for one in fields(held) if one.name not in arrays}
    return planar(at_rest, "the held sample"), changes


def _require_rest(held: HeldPacking) -> None:
    """Raise `InputError` where a sample does not come to rest."""
    if held.status == "at rest":
        return
    strain, left = float(np.linalg.norm(held.strain)), len(held.graph.contacts)
    if held.status == "not at rest":
        received = f"an unbalanced force of {held.unbalanced:.1e} after {held.steps} steps"
        remedy = "Let hold of stability.packing take more steps (most_steps), or another sample."
    elif held.control == "stress" and left:
        received = f"a flow: the cell strains by {strain:.2g}"
        remedy = "Hold the cell in place of the stress, or take a sample that bears this stress."
    else:
        kept = left - held.gained
        received = f"a flow: {kept} of {held.lost + kept} contacts between grains are left"
        remedy = "Look for grains and contacts that are missing, or take a sample that is jammed."
    where = f"the sample, which was brought to rest first ({held.place})"
    raise InputError(where, received, "a state at rest", remedy)


def scene_at_rest(subject: Subject, control: HoldControl | None) -> Scene:
    """Return the scene of a question, brought to rest first where a control is named."""
    if isinstance(subject, Snapshot):
        return held_snapshot(subject, control)[0].scene
    scene = scene_of(subject)
    if control is None:
        return scene
    from stability.packing.hold import hold

    held = hold(scene, control=control)
    _require_rest(held)
    return held.scene
