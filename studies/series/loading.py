"""Loading of a sample between two snapshots: straight, in parts, by mixed control, by a table.

The net strain of an interval is known; `--programme` says on which way the strain was reached.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from loops import InputError
from loops.arrays import Floats
from loops.contacts import start_state
from patterns import Snapshot
from patterns.snapshots.tables import read_table
from stability import COMPONENTS, Programme, Stage
from stability.programmes import nominal
from studies.reading import CELL_COLUMNS
from studies.series.evolution import cell_strain

WAYS = ("straight", "1-first", "2-first", "mixed-1", "mixed-2")
# Strains of a table and of the snapshots differ by at most this share of the largest on the way:
# tables round, and their times may be a step off.
AGREE = 0.1
# Rows of a table this near to an end of the interval, over its time, are at the end.
AT_END = 1e-6


@dataclass(frozen=True, eq=False)
class StrainTable:
    """Deformation gradient over time, (n, 2, 2) from the first row on, of a table."""

    name: str
    time: Floats
    F: Floats

    def __repr__(self) -> str:
        # A part of a series knows the table that it was made with by this.
        digest = hashlib.blake2b(self.time.tobytes() + self.F.tobytes(), digest_size=16)
        return f"StrainTable({digest.hexdigest()})"

    def between(self, start: float, end: float) -> tuple[Floats, Floats]:
        """Displacement gradients (K, 2, 2) at rows between two times and at the last, and shares.

        `InputError` where the table doesn't reach so far.
        """
        near = AT_END * (end - start)
        if not (end > start and self.time[0] <= start + near and end <= self.time[-1] + near):
            raise InputError(
                f"--programme {self.name}",
                f"times from {self.time[0]:.10g} to {self.time[-1]:.10g}",
                f"those of the snapshots, {start:.10g} to {end:.10g}, within them",
                "Add rows, or give the times of the snapshots by --times.",
            )
        inside = (self.time > start + near) & (self.time < end - near)
        at = np.append(self.time[inside], end)
        rows = self.F.reshape(-1, 4).T
        F = np.stack([np.interp([start, *at], self.time, row) for row in rows], axis=-1)
        first, *F_at = F.reshape(-1, 2, 2)
        shares = (at - start) / (end - start)
        return np.eye(2) - np.array(F_at) @ np.linalg.inv(first), np.append(shares[:-1], 1.0)


def read_strains(path: Path) -> StrainTable:
    """Read strains over time: `time` with the cell `h_xx`, ... or with `H11`, `H22` (`H12`, `H21`).

    `InputError` if columns lack, times don't grow, or a cell has no area.
    """
    if not path.is_file():
        expected = f"{', '.join(WAYS)}, or a table of strains over time"
        raise InputError("--programme", f"{str(path)!r}", expected, "Check the word, or the path.")
    table = read_table(path)
    time = table.column("time")
    if not (len(time) > 1 and np.isfinite(time).all() and (np.diff(time) > 0).all()):
        received = f"{len(time)} rows, or times that do not grow"
        remedy = "Sort the rows, and drop repeated ones."
        raise InputError(f"column 'time' of {path}", received, "growing times of 2 rows", remedy)
    if table.has(*CELL_COLUMNS):
        cells = table.columns(*CELL_COLUMNS).reshape(-1, 2, 2)
        moved = [np.eye(2)]
        for before, after in pairwise(cells):
            moved.append((np.eye(2) - cell_strain(before, after)) @ moved[-1])
        return StrainTable(path.name, time, np.array(moved))
    none = np.zeros(len(time))
    names = [f"H{ij}" for ij in COMPONENTS]
    needed = {"H11", "H22"}
    H = [table.column(name) if name in needed or table.has(name) else none for name in names]
    F = np.eye(2) - np.column_stack(H).reshape(-1, 2, 2)
    if not (np.isfinite(F).all() and (np.linalg.det(F) > 0).all()):
        remedy = "Strains are positive in compression, shares of the first sides."
        raise InputError(f"strains of {path}", "no area left", "finite, below 1", remedy)
    return StrainTable(path.name, time, F)


class IntervalLoading(NamedTuple):
    """Loading of an interval: what `replay` is given, and the stages of a path.

    `start` is the strain of the whole interval at the velocity gradient of its beginning.
    """

    strain: Floats | Stage
    shares: Floats | None
    stages: Sequence[Stage]
    start: Floats
    size: float


def loading_between(
    before: Snapshot,
    after: Snapshot,
    H: Floats,
    programme: str,
    table: StrainTable | None = None,
    times: Sequence[float | None] = (None, None),
) -> IntervalLoading:
    """Loading that strains the sample by `H` from one snapshot to the next; `times` are theirs."""
    size = float(np.linalg.norm(H))
    if table is not None:
        if times[0] is None or times[1] is None:
            remedy = "Give --times, or --time-step where snapshots are numbered by steps."
            raise InputError(f"--programme {table.name}", "no times", "of the snapshots", remedy)
        ends, shares = table.between(times[0], times[1])
        largest = max(size, float(np.linalg.norm(ends, axis=(1, 2)).max()))
        left = H - ends[-1]
        if np.linalg.norm(left) > AGREE * largest:
            told, own = (np.array2string(one, precision=3) for one in (ends[-1], H))
            remedy = "Check units, signs and times of the table."
            raise InputError(f"--programme {table.name}", told, f"{own}, of the snapshots", remedy)
        return in_parts(ends + shares[:, None, None] * left, shares)
    if programme.startswith("mixed"):
        along = int(programme[-1])
        driven, held = f"{along}{along}", f"{3 - along}{3 - along}"
        first, last = (stress_of(one) for one in (before, after))
        change = (nominal(last, H) - first).ravel()
        on = np.array([ij == held for ij in COMPONENTS], dtype=float)
        rate = np.where(on > 0, change, H.ravel())
        name = f"H{driven} and P{held} of the interval"
        mixed = Stage(Programme(name, np.diag(on), np.diag(1.0 - on), rate), "parameter", 1.0)
        return IntervalLoading(mixed, None, [mixed], H, size)
    if programme.endswith("first"):
        k = int(programme[0]) - 1
        first_part = np.zeros((2, 2))
        first_part[k, k] = H[k, k]
        return in_parts(np.array([first_part, H]), None)
    return IntervalLoading(H, None, strain_stages(H[None]), H, size)


def in_parts(ends: Floats, shares: Floats | None) -> IntervalLoading:
    """Loading through displacement gradients (K, 2, 2), at shares of the time or at one speed."""
    sizes = np.linalg.norm(np.diff(ends, axis=0, prepend=0.0), axis=(1, 2))
    moving = np.flatnonzero(sizes > 0)
    if not len(moving):
        return IntervalLoading(ends[-1], None, strain_stages(ends[-1:]), ends[-1], 0.0)
    size, first = float(sizes.sum()), int(moving[0])
    if shares is None:
        # Parts without a strain take no time.
        ends, start = ends[moving], ends[first] * size / sizes[first]
        return IntervalLoading(ends, None, strain_stages(ends), start, size)
    return IntervalLoading(ends, shares, strain_stages(ends[moving]), ends[0] / shares[0], size)


def strain_stages(ends: Floats) -> list[Stage]:
    """Stages that reach displacement gradients (K, 2, 2) one after the other."""
    steps = np.diff(ends, axis=0, prepend=0.0).reshape(-1, 4)
    none, every = np.zeros((4, 4)), np.eye(4)
    name = "strain of the interval"
    return [Stage(Programme(name, none, every, step), "parameter", 1.0) for step in steps]


def stress_of(snapshot: Snapshot) -> Floats:
    """(2, 2) stress of a snapshot, walls included."""
    return start_state(snapshot.graph, snapshot.boundary_and_notes[0]).stress
