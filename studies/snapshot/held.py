"""A snapshot that is brought to rest before it is probed or followed."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np

from loops import InputError, Regime
from patterns import Snapshot, WallContacts
from stability.packing.hold import SLIDING_SHARE, HoldControl, hold, unbalanced_force
from studies.snapshot.in_packing import box_area, followed_walls, sample_boundary
from studies.snapshot.run import planar

# Above this unbalanced force the rates of a state are not those of an equilibrium.
MOVING = 5e-4
# Above this spread of the stress the state at rest depends on the way to it.
SPREAD = 0.03


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
    law, _ = snapshot.mechanics()
    _, outline, _ = sample_boundary(snapshot)
    walls = snapshot.walls
    if control is None:
        if outline is not None:
            return snapshot, None
        before = unbalanced_force(snapshot.graph, *followed_walls(snapshot))
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
    if outline is not None:
        expected = "a periodic cell or known walls, no free surface"
        remedy = (
            "Give --cell, or the wall contacts. A sample that rests under its weight cannot be "
            "held: probe it as it is, its outline follows the strain."
        )
        raise InputError("--hold", "a sample whose walls are not known", expected, remedy)
    area = None if walls is None else box_area(snapshot.graph.x, walls)
    planes, force = followed_walls(snapshot)
    held = hold(snapshot.graph, law, control=control, planes=planes, plane_force=force, volume=area)
    if held.status != "at rest":
        expected = "a sample that comes to rest"
        raise InputError("--hold", str(held), expected, "Take another state of the series.")
    notes = [str(held)]
    if held.spread > SPREAD:
        notes.append(
            "the state at rest depends on how it is reached: with two values of damping the "
            f"stresses differ by {100 * held.spread:.2g} %; all results apply only to "
            "the state at rest that was found"
        )
    graph, limit = held.graph, SLIDING_SHARE * held.law.mu * held.graph.normal_force
    regime = np.where(np.abs(graph.shear_force) >= limit, Regime.SLIDING, Regime.ELASTIC)
    if held.planes is not None:
        walls = WallContacts(
            held.planes.grain,
            held.plane_force,
            -held.planes.branch,
            held.planes.kn,
            held.planes.kt,
            held.planes.mu,
        )
    at_rest = Snapshot(
        graph=graph.replace(regime=regime.astype(np.int8)),
        law=held.law,
        regime=regime.astype(np.int8),
        ids=snapshot.ids,
        wall_contacts=0 if walls is None else len(walls.grain),
        notes=(*snapshot.notes, *notes),
        walls=walls,
        step=snapshot.step,
        findings=snapshot.findings,
        mass=snapshot.mass,
        time=snapshot.time,
    )
    arrays = ("graph", "law", "planes", "plane_force")
    changes = {one.name: getattr(held, one.name) for one in fields(held) if one.name not in arrays}
    return planar(at_rest, "the held sample"), changes
