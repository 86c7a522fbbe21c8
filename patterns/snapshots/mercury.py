"""MercuryDPM: `.data` with the grains and `.fstat` with their contacts."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from loops import InputError
from loops.errors import counted
from patterns.snapshots.columns import TABLE, components
from patterns.snapshots.files import Text, line_at, open_text
from patterns.snapshots.frame import (
    Frame,
    Frames,
    Listing,
    Notes,
    contacts_path,
    frame_of_tables,
    paired,
)
from patterns.snapshots.source import Source
from patterns.snapshots.tables import Table

# Columns by the number of numbers in the header of a frame: 6 in two dimensions, else 8.
DATA_COLUMNS = {width: tuple(TABLE["mercury"][str(width)].split()) for width in (6, 8)}
FSTAT_COLUMNS = tuple(TABLE["mercury"]["fstat"].split())
COMMENT_LINES = 3  # lines before the rows of a frame in .fstat


class Head(NamedTuple):
    """First line of a frame of `.data`: number of grains, time, numbers in the line."""

    grains: int
    time: float
    width: int


def data_head(line: bytes) -> Head | None:
    """The header `N time xmin ... zmax` of a frame of `.data`, None if it is none."""
    words = line.split()
    try:
        numbers = [float(word) for word in words]
        return Head(int(words[0]), numbers[1], len(words)) if len(words) in DATA_COLUMNS else None
    except ValueError:
        return None


def _until_fault(blocks: Iterator[Listing]) -> Iterator[Listing | InputError]:
    try:
        yield from blocks
    except InputError as error:
        yield error


def _data_listings(path: Path, text: Text) -> Iterator[Listing]:
    # Only the number of rows gives the end of a frame: find the ends of all lines.
    ends = np.flatnonzero(np.frombuffer(text, dtype=np.uint8) == ord("\n"))
    line = 0
    while line < len(ends):
        start = 0 if line == 0 else int(ends[line - 1]) + 1
        first = text[start : int(ends[line])]
        if not first.strip():
            line += 1
            continue
        head = data_head(first)
        if head is None:
            expected = "a header N time xmin ymin [zmin] xmax ymax [zmax]"
            remedy = "The frame before has other rows than it says: write the file again."
            raise InputError(f"{path}, line {line + 1}", repr(first[:60]), expected, remedy)
        where, names = f"{path}, time {head.time:g}", DATA_COLUMNS[head.width]
        if head.grains < 0 or line + head.grains >= len(ends):
            received = f"{counted(len(ends) - line - 1, 'row')} to the end of the file"
            remedy = "The file is cut short at this time: write it again."
            raise InputError(where, received, f"{head.grains} as the header says", remedy)
        span = (int(ends[line]) + 1, int(ends[line + head.grains]) + 1)
        # Without rows, grains are inserted later.
        if head.grains and len(names) != (width := len(line_at(text, span[0])[0].split())):
            received = f"{head.width} numbers in the header and {width} a row"
            remedy = "Write the file with the layout of 8 or of 14 columns."
            raise InputError(where, received, "6 and 8 in two dimensions, or 8 and 14", remedy)
        yield Listing(where, head.time, names, text, span)
        line += head.grains + 1
    rest = text[int(ends[-1]) + 1 if len(ends) else 0 :]
    if rest.strip():
        received = f"a last line {rest[:60]!r} without its end"
        raise InputError(str(path), received, "complete lines", "Write it again.")


def _fstat_listings(path: Path, text: Text) -> Iterator[Listing]:
    at = 0
    while at < len(text):
        first, at = line_at(text, at)
        if not first.strip():
            continue
        words = first.split()
        try:
            time = float(words[1]) if words[0] == b"#" else float("x")
        except (ValueError, IndexError):
            raise InputError(
                str(path), repr(first[:60]), "a comment '# time ...'", "Give MercuryDPM's .fstat."
            ) from None
        for _ in range(COMMENT_LINES - 1):
            line, at = line_at(text, at)
            if not line.startswith(b"#") or text[at - 1 : at] != b"\n":
                where, remedy = f"{path}, time {time:g}", "The file is cut short: write it again."
                received = "a header that breaks off"
                raise InputError(where, received, f"{COMMENT_LINES} lines of comments", remedy)
        stop = text.find(b"#", at)
        stop = len(text) if stop < 0 else stop
        yield Listing(f"{path}, time {time:g}", time, FSTAT_COLUMNS, text, (at, stop))
        at = stop


# Times of the two files are printed alike.
TIME_TOLERANCE = 1e-6


def is_mercury(path: Path, head: bytes) -> bool:
    """Whether this is a `.data` file: a header of numbers, then rows."""
    lines = head.split(b"\n")
    while len(lines) > 2 and (first := data_head(lines[0])) is not None and first.grains == 0:
        lines = lines[1:]
    first = data_head(lines[0])
    if first is None or len(lines) < 3:
        return False
    return len(lines[1].split()) == len(DATA_COLUMNS[first.width])


def mercury_frames(source: Source) -> Frames:
    """Frames of a `.data` file, with the `.fstat` file beside it.

    Grains are numbered from 0 in the order of the file, walls from -1 down; in three dimensions the
    packing lies in one plane of constant z, or of constant y: then z is taken for y.
    """
    name = source.path.name.replace(".data", ".fstat")
    hint = "Write them (fStatFile.setFileType) or name the file by --contacts."
    lacks, wanted = "no .fstat file beside it", "the contacts in a file named alike"
    path = contacts_path(source, [name] if ".fstat" in name else [], lacks, wanted, hint)
    grains = _until_fault(_data_listings(source.path, open_text(source.path)))
    contacts = _until_fault(_fstat_listings(path, open_text(path)))
    return paired(grains, contacts, _mercury_frame, path, "time", TIME_TOLERANCE)


def _mercury_frame(data: Listing, fstat: Listing, notes: Notes, source: Source) -> Frame:
    axes = "xyz" if "z" in data.names else "xy"
    grains, table = data.read([*axes, "radius"]), fstat.read(FSTAT_COLUMNS[1:])
    x, radii = grains.columns(*axes), grains.column("radius")
    i, j = table.integers("i"), table.integers("j")
    highest = np.maximum(i, j)
    row = int(np.argmax(highest))
    if highest[row] >= len(radii) or i.min() < 0:
        raise InputError(
            f"{table.path}, row {row}",
            f"grains {i[row]} and {j[row]}",
            f"grains 0 to {len(radii) - 1} of the .data file, walls negative in the second",
            "Higher numbers are ghosts of a periodic border, as old versions of MercuryDPM write: "
            "run a later version, or export plain tables.",
        )
    n, t, point = (table.columns(*(f"{v}{a}" for a in axes)) for v in "ntc")
    between = j >= 0
    # Normals and forces are those of the first body, from the second one; of walls normal and
    # tangent may be reversed: their sign follows from the contact point.
    inwards = np.sign(np.einsum("ck,ck->c", x[i] - point, n))
    sign = np.where(between, -1.0, inwards)[:, None]
    reach = radii[i] + np.where(between, radii[j], 0.0) - table.column("delta")
    force = sign * (table.column("fn")[:, None] * n + table.column("ft")[:, None] * t)
    n = sign * n

    branch = components("branch_@", reach[:, None] * n)
    contacts = components("f@_on_2", force) | components("n@", n) | branch
    bodies = {"id": np.arange(len(x)), "radius": radii} | components("@", x)
    tables = {
        "grains": Table(data.where, bodies),
        "contacts": Table(fstat.where, {"id1": i, "id2": j} | contacts).take(between),
    }
    if not between.all():
        walls = np.flatnonzero(~between)[np.argsort(-j[~between], kind="stable")]
        columns = {"id": i} | components("f@", force) | branch
        tables["walls"] = Table(fstat.where, columns).take(walls)
    if source.cell is None:
        notes = (*notes, "taken as not periodic: the files don't tell; --cell makes it so")
    if not between.all():
        counts = np.bincount(-1 - j[~between]).tolist()
        each = ", ".join(
            f"{-1 - k} ({counted(count, 'contact')})" for k, count in enumerate(counts)
        )
        notes = (*notes, f"walls: {each}")
    return frame_of_tables(source, tables, step=data.step, time=data.step, notes=notes)
