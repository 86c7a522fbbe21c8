"""What the packing makes of each loop: its operator in place, and that of what surrounds it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from loops import Faces, InputError
from loops.arrays import Flags, Floats
from patterns import Snapshot
from stability.loop_stability import loop_spectra, loop_stability
from studies.snapshot.statistics import Groups, share_by_group, spread, spread_by_group
from studies.snapshot.table import EIGENVALUES, FREE

if TYPE_CHECKING:
    from loops.packing import LoopsInPlace, PlaneContacts

Table = dict[str, Any]
PLACE = "packing"
WHERE = "--in-packing"
# Blocks are good in packings with up to 8 % of their loops unstable in place, from 11 % on poor.
LOST = 0.1


def place_options(asked: str) -> dict[str, Any]:
    """Options of `loops_in_place`: a method by its name, or extrapolated patches."""
    if asked in ("auto", "whole", "blocks"):
        return {"method": asked}
    try:
        return {"method": "extrapolated", "radius": float(asked)}
    except ValueError:
        raise InputError(
            WHERE,
            repr(asked),
            "auto, whole, blocks or a radius in mean diameters",
            "Write --in-packing whole for example.",
        ) from None


def add_in_packing(
    snapshot: Snapshot, faces: Faces, table: Table, asked: str
) -> tuple[Snapshot, dict[str, Any]]:
    """Add the columns of the loops in place; what was assumed, as notes and for the summary."""
    # Loaded only when loops are to be judged in place.
    from loops.packing import loops_in_place

    how = place_options(asked)
    law, _ = snapshot.mechanics()
    planes, held, notes = sample_boundary(snapshot, faces)
    place = loops_in_place(snapshot.graph, law, faces, planes=planes, held=held, **how)
    kn = float(np.mean(law.kn))
    found = loop_stability(place.matrix / kn)
    for name, values in zip(EIGENVALUES, found.eigenvalues.T, strict=True):
        table[f"{PLACE}_{name}"] = values
    table[f"{PLACE}_unstable_fraction"] = found.unstable_fraction
    table["surroundings_lambda_min"] = loop_spectra(place.surroundings / kn)[:, 0]
    table[f"{PLACE}_error"] = np.where(np.isnan(found.eigenvalues[:, 0]), np.nan, place.error)
    if not np.isfinite(place.matrix).any():
        notes.append("no loop stands in a packing: each has a grain that is held, or carries none")
    unstable = np.mean(found.eigenvalues[:, 0] < 0)
    if (place.error > 0).any() and unstable > LOST:
        notes.append(
            f"{100 * unstable:.0f} % of the loops are unstable in place: soft modes reach through "
            "the whole packing, and blocks and patches say little; --in-packing whole is exact"
        )
    told = {**how, "boundary": place.system.boundary, **_left_out(place)}
    return replace(snapshot, notes=(*snapshot.notes, *notes)), told


def _left_out(place: LoopsInPlace) -> dict[str, int]:
    carrying = place.system.carrying
    return {
        "rattlers": carrying.rattlers,
        "clusters": carrying.clusters,
        "clustered": carrying.clustered,
    }


def sample_boundary(
    snapshot: Snapshot, faces: Faces
) -> tuple[PlaneContacts | None, Flags | None, list[str]]:
    """Walls as planes; where a sample without a cell has none, its outline's grains held."""
    from loops.packing import PlaneContacts, outline_grains, plane_contacts

    walls = snapshot.walls
    if walls is not None and walls.kn is not None and walls.kt is not None:
        return PlaneContacts(walls.grain, -walls.branch, walls.kn, walls.kt), None, []
    if walls is not None:
        planes = plane_contacts(snapshot.graph, walls.grain, walls.force, walls.branch)
        return planes, None, ["walls: smooth, as stiff as their forces over the overlaps"]
    if snapshot.graph.cell is not None:
        return None, None, []
    held = outline_grains(snapshot.graph, faces)
    note = (
        f"no walls known: the {np.count_nonzero(held)} grains of the outline follow the affine "
        "motion; their own loops are not judged in the packing, the next ones are judged too stiff"
    )
    return None, held, [note]


def surroundings_share(table: Table) -> Floats:
    """What the surroundings give of the trace of `A_in`: 1 - tr A_loop / tr A_in."""
    inside, alone = (sum(table[f"{j}_{name}"] for name in EIGENVALUES) for j in (PLACE, FREE))
    share: Floats = 1.0 - alone / inside
    return share


def share_by_order(table: Table, orders: list[int]) -> Table:
    """Quartiles of `surroundings_share` over the loops of each order."""
    share = surroundings_share(table)
    found = [spread(share[table["order"] == n]) for n in orders]
    names = {"q25": "surroundings_q25", "median": "surroundings_median", "q75": "surroundings_q75"}
    return {column: [one[key] for one in found] for key, column in names.items()}


def packing_summary(table: Table, groups: Groups, told: dict[str, Any]) -> dict[str, Any]:
    """Keys beside those that every judge of loops has."""
    smallest, error = table["surroundings_lambda_min"], table[f"{PLACE}_error"]
    known = ~np.isnan(smallest)
    return {
        "in_packing": told,
        "packing_error": spread(np.where(np.isfinite(error), error, np.nan)),
        "surroundings_positive": share_by_group(groups, smallest > 0, known),
        "surroundings_share": spread_by_group(groups, surroundings_share(table)),
    }
