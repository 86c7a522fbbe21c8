"""The packing of a snapshot: boundary, rate problem, state at rest, and every loop inside it."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from loops import InputError
from loops.arrays import Floats
from loops.scene import Scene, Subject, scene_of
from patterns import Snapshot, WallContacts, planar
from patterns.snapshots.walls import box_area, box_corners
from stability.verdict import loop_spectra, loop_stability
from studies.output import Columns
from studies.snapshot.table import EIGENVALUES

if TYPE_CHECKING:
    from loops.in_place import LoopsInPlace, Method
    from stability.packing.hold import HeldPacking, HoldControl
    from stability.packing.yielding import YieldResponse

PLACE = "packing"
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


def sample_edge(
    snapshot: Snapshot, yield_band: float, fixed: Floats | None = None
) -> YieldResponse:
    """Rate problem of the packing; contacts with |T| of at least `yield_band` mu N may slide.

    Plates strain about the point `fixed`, by default the lower left corner.
    """
    from stability.packing.yielding import yield_response

    scene = snapshot.scene
    boundary = scene.boundary
    if boundary.walls is not None:
        boundary = replace(boundary, walls=replace(boundary.walls, fixed=fixed))
    return yield_response(replace(scene, boundary=boundary), yield_band=yield_band)


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


def add_in_packing(
    snapshot: Snapshot, table: Columns, method: Method
) -> tuple[dict[str, Any], list[str]]:
    """Add the columns of the loops in place to the table; return the method used, and notes."""
    # Loaded only when loops are judged in place.
    from loops.in_place import loops_in_place

    place, notes = loops_in_place(snapshot.scene, method=method), [*snapshot.boundary_and_notes[1]]
    for name, values in place_columns(place, snapshot.mean_kn).items():
        table[name] = values
    if not np.isfinite(place.matrix).any():
        notes.append(
            "no loop could be judged in the packing: each has a grain that is held or carries "
            "no force"
        )
    carrying = place.system.carrying
    left_out = {name: getattr(carrying, name) for name in ("rattlers", "clusters", "clustered")}
    return {"method": method, "boundary": place.system.boundary, **left_out}, notes


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


def hold_control(hold: bool, hold_stress: bool) -> HoldControl | None:
    """Control of the options `--hold` and `--hold-stress`; `InputError` if both are given."""
    if hold and hold_stress:
        raise InputError("--hold, --hold-stress", "both", "one of them", "Leave one out.")
    return "strain" if hold else "stress" if hold_stress else None


def held_snapshot(
    snapshot: Snapshot, control: HoldControl | None
) -> tuple[Snapshot, dict[str, Any] | None]:
    """The snapshot at rest, and what holding changed, for the summary.

    Without a control the snapshot itself, with a note if it moves. `InputError` if the sample does
    not come to rest.
    """
    from stability.packing.hold import hold, unbalanced_force

    scene, walls = snapshot.scene, snapshot.walls
    boundary, outline = scene.boundary, scene.boundary.kind == "outline"
    if control is None:
        if outline:
            return snapshot, None
        before = unbalanced_force(snapshot.graph, boundary)
        if not before > MOVING:
            return snapshot, None
        note = (
            f"the state moves: its unbalanced force is {before:.2g} of the mean contact force, so "
            "that its rates are not those of an equilibrium; bring it to rest first with --hold"
        )
        noted = replace(snapshot, notes=(*snapshot.notes, note))
        if "faces" in vars(snapshot):
            # A copy would look for its loops again.
            vars(noted)["faces"] = snapshot.faces
        return noted, None
    if outline:
        expected = "a periodic cell or known walls, no free surface"
        remedy = (
            "Give --cell, or the wall contacts. A sample that rests under its weight cannot be "
            "held: probe it as it is, its outline follows the strain."
        )
        raise InputError("--hold", "a sample whose walls are not known", expected, remedy)
    if walls is not None and snapshot.graph.cell is None:
        boundary = replace(boundary, volume=box_area(snapshot.graph.x, walls))
    held = hold(replace(scene, boundary=boundary), control=control)
    _require_rest(held)
    notes = [str(held)]
    if held.spread > REST_SPREAD:
        notes.append(
            "the state at rest depends on how it is reached: with two values of damping the "
            f"stresses differ by {100 * held.spread:.2g} %; all results apply only to "
            "the state at rest that was found"
        )
    planes = held.boundary.walls
    if planes is not None:
        force, springs = np.asarray(planes.force), (planes.kn, planes.kt, planes.mu)
        walls = WallContacts(planes.grain, force, -planes.branch, *springs)
    at_rest = Snapshot(
        graph=held.scene.graph,
        law=held.law,
        regime=held.scene.graph.regime,
        ids=snapshot.ids,
        wall_contacts=0 if walls is None else len(walls.grain),
        notes=(*snapshot.notes, *notes),
        walls=walls,
        step=snapshot.step,
        findings=snapshot.findings,
        mass=snapshot.mass,
        time=snapshot.time,
    )
    arrays = ("graph", "law", "boundary")
    changes = {one.name: getattr(held, one.name) for one in fields(held) if one.name not in arrays}
    return planar(at_rest, "the held sample"), changes


def _require_rest(held: HeldPacking) -> None:
    """Raise `InputError` where a sample does not come to rest."""
    if held.status != "at rest":
        expected = "a sample that comes to rest"
        raise InputError("--hold", str(held), expected, "Take another state of the series.")


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
