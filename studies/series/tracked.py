"""Loops followed from one snapshot to the next."""

from __future__ import annotations

from typing import NamedTuple

from loops import Faces
from loops.contact_matching import match_contacts
from loops.tracking import LoopFates, loop_fates
from patterns import Snapshot


class TrackedState(NamedTuple):
    """One instant of a series.

    Attributes
    ----------
    snapshot : Snapshot
        Grains, contacts and their ids.
    faces : Faces
        Its faces, from `find_faces`.
    """

    snapshot: Snapshot
    faces: Faces


def track_loops(before: TrackedState, after: TrackedState) -> LoopFates:
    """Say what became of every loop between two snapshots, by the contacts that they share.

    Parameters
    ----------
    before, after : TrackedState
        The two instants.

    Returns
    -------
    LoopFates
        See `loop_fates`.

    Raises
    ------
    InputError
        If ids repeat in a snapshot.
    """
    one, two = before.snapshot, after.snapshot
    contacts = match_contacts(one.graph, one.ids, two.graph, two.ids)
    return loop_fates(contacts, before.faces, after.faces)
