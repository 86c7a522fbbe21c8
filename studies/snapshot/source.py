"""A snapshot read for the study: its options by name, crossing branches refused or left out."""

from __future__ import annotations

import inspect
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow

from loops import InputError, crossing_contacts_to_drop, find_crossings
from loops.arrays import Integers
from patterns import Snapshot, read_snapshot

# Most crossing pairs that are looked for, and that an error names.
MOST, NAMED = 1_000_000, 3


def reading(**how: Any) -> dict[str, Any]:
    """Options of `read_planar` without the path: those given, defaults for all others."""
    asked = list(inspect.signature(read_snapshot).parameters.values())[1:]
    # Contradictory input is always refused here.
    defaults = {one.name: one.default for one in asked if one.name != "strict"}
    return {**defaults, "drop_crossings": False, **how}


def read_planar(path: Path, *, drop_crossings: bool = False, **how: Any) -> Snapshot:
    """As `read_snapshot`, its faces found; `InputError` if branches cross, unless some may go."""
    if how.get("cell") is not None:
        how["cell"] = np.reshape(how["cell"], (2, 2))
    snapshot = read_snapshot(path, **how)
    # Arrow would keep a quarter of the memory of a large file for later tables.
    pyarrow.default_memory_pool().release_unused()
    # Crossings and faces are found on two cores. If branches cross, the result and the errors of
    # the search for faces mean nothing.
    with ThreadPoolExecutor(1) as other:
        found = other.submit(getattr, snapshot, "faces")
        plane = planar(snapshot, str(path), drop=drop_crossings)
    if plane is snapshot:
        found.result()
    return plane


def planar(snapshot: Snapshot, where: str = "the snapshot", *, drop: bool = False) -> Snapshot:
    """Return a snapshot whose network has no crossing branches, so that its loops are defined.

    Parameters
    ----------
    snapshot : Snapshot
    where : str
        Its name in the error.
    drop : bool
        Whether to leave out one contact of each crossing pair, the less loaded one.

    Returns
    -------
    Snapshot
        The same one if no branches cross; its notes name the contacts that were left out.

    Raises
    ------
    InputError
        If branches cross and `drop` is false.
    """
    pairs = find_crossings(snapshot.graph, MOST)
    if len(pairs) == 0:
        return snapshot
    if drop:
        return _without(snapshot, crossing_contacts_to_drop(snapshot.graph, pairs), len(pairs))
    named = snapshot.ids[snapshot.graph.contacts[pairs[:NAMED]]]
    shown = "; ".join(f"{a[0]}-{a[1]} and {b[0]}-{b[1]}" for a, b in named.tolist())
    more = "; ..." if len(pairs) > NAMED else ""
    raise InputError(
        f"contacts of {where}",
        f"{len(pairs)} pairs of crossing branches (grains {shown}{more})",
        "a planar network",
        "Opposite grains of a loop overlap, or the cell is wrong; --drop-crossings (in Python "
        "gl.planar(snapshot, drop=True)) leaves out one contact of each pair, the less loaded one.",
    )


def _without(snapshot: Snapshot, dropped: Integers, crossings: int) -> Snapshot:
    """Leave contacts out, with a note that names the first ten."""
    graph = snapshot.graph
    kept = np.delete(np.arange(graph.contact_count), dropped)
    named = ", ".join(f"{a}-{b}" for a, b in snapshot.ids[graph.contacts[dropped[:10]]].tolist())
    more = ", ..." if len(dropped) > 10 else ""
    law, regime = snapshot.law, snapshot.regime
    return replace(
        snapshot,
        graph=graph.replace(
            contacts=graph.contacts[kept],
            normal_force=graph.normal_force[kept],
            shear_force=graph.shear_force[kept],
            images=None if graph.images is None else graph.images[kept],
            regime=None if regime is None else regime[kept],
        ),
        law=None if law is None else law.take(kept),
        regime=None if regime is None else regime[kept],
        notes=(
            *snapshot.notes,
            f"{crossings} pairs of crossing branches: {len(dropped)} contacts left out, of grains "
            f"{named}{more}; their forces are missing in every stress",
        ),
    )
