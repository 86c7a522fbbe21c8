"""Photoelastic experiments: positions and adjacency lists of PeGS2 and of RigidLibrary."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import numpy as np

from loops import InputError
from loops.arrays import Floats
from loops.errors import counted
from patterns.snapshots.files import beside, require_file, whole_file
from patterns.snapshots.frame import Frame, Frames, Moment, contacts_path
from patterns.snapshots.geometry import WALL
from patterns.snapshots.source import Source
from patterns.snapshots.tables import Table

# Columns of `particle_positions.txt`, where the first may be missing, and of the list of contacts.
POSITIONS = ("frame", "id", "x", "y", "r", "edge")
ADJACENCY = ("frame", "id1", "id2", "tangential", "normal")
LIST = "Adjacency_list.txt"
DECIMAL = rb"\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*"
LISTED = re.compile(rb"\s*\d+\s*(," + DECIMAL + rb"){4,5}\r?\n")
OUTSIDE = -1  # id of a wall in the list


def is_pegs(path: Path, head: bytes) -> bool:
    """Whether the first line has six numbers between commas, or five with the list beside it."""
    found = LISTED.match(head)
    return found is not None and (found[0].count(b",") == 5 or beside(path, LIST) is not None)


def pegs_frames(source: Source) -> Frames:
    """Frames of `particle_positions.txt` with `Adjacency_list.txt` beside it.

    Lengths in pixels, y of the image turned upwards; forces in newtons, those of a contact that
    both grains have are averaged. The list has no direction of contacts with walls.
    """
    if source.columns:
        remedy = "PeGS2 writes no names of columns: leave --columns out."
        raise InputError("--columns", str(dict(source.columns)), "none for PeGS2", remedy)
    wanted, hint = f"{LIST} of PeGS2's adjacencyMatrix", "Name it by --contacts."
    lists = contacts_path(source, [LIST], "no list of contacts beside it", wanted, hint)
    contacts, grains = _rows(lists, ADJACENCY), _rows(source.path, POSITIONS[1:], POSITIONS)
    if grains.shape[1] < len(POSITIONS):
        if len(numbers := np.unique(contacts[:, 0])) > 1:
            received = f"no column of frames, and {counted(len(numbers), 'frame')} in {lists}"
            remedy = "Take a list of one frame, or positions with their frame in front."
            raise InputError(str(source.path), received, "one frame", remedy)
        grains = np.insert(grains, 0, numbers[0], axis=1)
    found = [number for number in np.unique(grains[:, 0]) if (contacts[:, 0] == number).any()]
    if not found:
        where, received = str(lists), "no contacts in any frame of the positions"
        raise InputError(where, received, "contacts", "Take both files of one run.")

    def read(number: float, _: Source) -> Frame:
        x = grains[grains[:, 0] == number]
        rows = contacts[contacts[:, 0] == number]
        bodies = {
            "id": np.append(x[:, 1], OUTSIDE),
            "type": np.append(np.zeros(len(x)), WALL),
            "x": np.append(x[:, 2], 0.0),
            "y": np.append(-x[:, 3], 0.0),
            "radius": np.append(x[:, 4], 0.0),
        }
        # One row a pair, whichever grain it was solved on.
        ends = np.sort(rows[:, 1:3], axis=1)
        ends[ends[:, 0] == OUTSIDE] = ends[ends[:, 0] == OUTSIDE][:, ::-1]
        pairs, which, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
        which = which.ravel()
        force = np.stack([np.bincount(which, f) / count for f in (rows[:, 4], rows[:, 3])], axis=1)
        apart = np.hypot(*(rows[:, [4, 3]] - force[which]).T)[count[which] > 1]
        between = pairs[:, 1] != OUTSIDE
        mean = float(np.hypot(*force[between].T).mean()) if between.any() else 1.0
        single, walls = np.count_nonzero(between & (count == 1)), np.count_nonzero(~between)
        spread = float(np.sqrt(np.mean(apart**2))) / mean if len(apart) else 0.0
        notes = [
            "PeGS2: lengths in pixels, y turned upwards; N and T as of its force balance",
            "the force of a contact is the mean of those solved on its two grains, which differ by "
            f"{spread:.2g} mean forces from it (root mean square); "
            f"{counted(single, 'contact was', 'contacts were')} solved on one grain alone",
        ]
        if walls:
            notes.append(f"{counted(int(walls), 'contact')} with walls left out: no direction")
        table = {"id1": pairs[:, 0], "id2": pairs[:, 1], "fn": force[:, 0], "ft": force[:, 1]}
        return Frame(
            Table(source.path, bodies),
            Table(lists, table),
            step=float(number),
            notes=tuple(notes),
            measured=True,
            has_types=True,
        )

    return [Moment(partial(read, number), float(number)) for number in found]


def _rows(path: Path, *layouts: tuple[str, ...]) -> Floats:
    require_file(path)
    with whole_file(path):
        rows = np.loadtxt(path, delimiter=",", ndmin=2)
    if rows.shape[1] not in map(len, layouts):
        received = counted(rows.shape[1], "column")
        expected = " or ".join(f"{len(names)}: {', '.join(names)}" for names in layouts)
        raise InputError(str(path), received, expected, "Write it by PeGS2 again.")
    return rows
