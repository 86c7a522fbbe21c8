"""Force chains that bend between two snapshots, and what becomes of the loops beside them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from loops import force_chains
from loops.arrays import Floats
from loops.tracking import Fate, LoopFates
from patterns import Snapshot
from studies.output import Row, Summary
from studies.series.evolution import moved_branches
from studies.snapshot.table import share_of

# A segment that bends by more (degrees) buckles: Tordesillas and Muthuswamy 2009.
BUCKLES = 1.0
PLACES = ("buckled", "straight", "elsewhere")


def chain_bends(before: Snapshot, after: Snapshot) -> tuple[Floats, Floats]:
    """Return the bend of every segment of a chain (S,), and the largest beside each loop (L,).

    Degrees; nan for a segment of which a grain is lost, and for a loop that is beside no segment.
    """
    graph, faces, bend = before.graph, before.faces, np.empty(0)
    of_contact = np.full(graph.contact_count, np.nan)
    if before.mechanical:
        moved = moved_branches(before, after, np.zeros((2, 2)))
        links, bend = force_chains(graph).bending(graph, moved)
        bend = np.degrees(bend)
        np.fmax.at(of_contact, links, bend[:, None])
    if not len(faces.contacts):
        return bend, np.empty(0)
    return bend, np.fmax.reduceat(of_contact[faces.contacts], faces.offsets[:-1])[faces.loops]


def chain_row(bend: Floats, beside: Floats, fates: LoopFates, table: Mapping[str, Any]) -> Row:
    """Return numbers of an interval: segments, loops by place, those lost, those of negative W2."""
    known, lost = bend[np.isfinite(bend)], fates.before != Fate.SURVIVED
    row: Row = {"segments": len(known), "segments_buckled": int(np.sum(known > BUCKLES))}
    negative = np.zeros(len(beside), dtype=bool)
    if "W2" in table:
        negative[table["loop_before"]] = np.asarray(table["W2"]) < 0
    there = (beside > BUCKLES, beside <= BUCKLES, np.isnan(beside))
    for name, here in zip(PLACES, there, strict=True):
        counts = {"loops": 1, "grains": fates.order_before, "lost": lost, "negative_W2": negative}
        row |= {f"{name}_{what}": int(np.sum(here * each)) for what, each in counts.items()}
    return row


def chain_summary(intervals: Sequence[Row]) -> Summary:
    """Return segments that buckled, and by place of the loops their fate and work, all together."""

    def total(name: str) -> int:
        return sum(row[name] for row in intervals)

    found: Summary = {name: total(name) for name in ("segments", "segments_buckled")}
    for place in PLACES:
        loops, lost = total(f"{place}_loops"), total(f"{place}_lost")
        found[place] = {
            "loops": loops,
            "mean_order": total(f"{place}_grains") / loops if loops else None,
            "lost": share_of(lost, loops) if loops else None,
            "negative_W2": share_of(total(f"{place}_negative_W2"), loops - lost) if loops else None,
        }
    return found
