"""Frames of MercuryDPM's `.data` and `.fstat` files."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from loops import InputError
from patterns.snapshots.tables import Table
from patterns.snapshots.text import Text, line_at, open_text, read_body

# Columns by the number of numbers in a row; the header of a frame has 6 numbers in 2D, else 8.
DATA_COLUMNS = {
    8: ("x", "y", "vx", "vy", "radius", "angle", "omega", "info"),
    14: (
        *("x", "y", "z", "vx", "vy", "vz", "radius", "alpha", "beta", "gamma"),
        *("omega_x", "omega_y", "omega_z", "info"),
    ),
}
HEADERS = {8: 6, 14: 8}
FSTAT_COLUMNS = (
    *("time", "i", "j", "cx", "cy", "cz", "delta", "delta_t", "fn", "ft"),
    *("nx", "ny", "nz", "tx", "ty", "tz"),
)
COMMENTS = 3  # lines before the rows of a frame in .fstat


@dataclass(frozen=True, eq=False)
class Block:
    """Where the rows of one instant stand: `where` and `time`, `columns`, `text` and `span`."""

    where: str
    time: float
    columns: tuple[str, ...]
    text: Text
    span: tuple[int, int]

    def read(self, *wanted: str) -> Table:
        """Columns of the rows."""
        return Table(self.where, read_body(self.where, self.text, self.span, self.columns, wanted))


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
        return Head(int(words[0]), numbers[1], len(numbers)) if len(words) in (6, 8) else None
    except ValueError:
        return None


def data_blocks(path: Path) -> list[Block | InputError]:
    """Frames of a `.data` file; their rows are counted, not read.

    Parameters
    ----------
    path : Path
        The file, plain or gzip.

    Returns
    -------
    list of Block or InputError
        Rows of the grains, in the order of the file. The last may be what is wrong with a frame:
        of another layout, or cut. What follows it can't be found.

    Raises
    ------
    InputError
        If the file is missing or empty.
    """
    return _until_fault(_data_blocks(path, open_text(path)))


def _until_fault(blocks: Iterator[Block]) -> list[Block | InputError]:
    found: list[Block | InputError] = []
    try:
        for block in blocks:
            found.append(block)
    except InputError as error:
        found.append(error)
    return found


def _data_blocks(path: Path, text: Text) -> Iterator[Block]:
    # A frame has no mark but its length: the ends of all lines tell where it stops.
    ends = np.flatnonzero(np.frombuffer(text, dtype=np.uint8) == ord("\n"))
    line = 0
    while line < len(ends):
        start = 0 if line == 0 else int(ends[line - 1]) + 1
        first = text[start : int(ends[line])]
        head = data_head(first)
        if head is None:
            if not first.strip():
                line += 1
                continue
            raise InputError(
                f"{path}, line {line + 1}",
                repr(first[:60]),
                "a header N time xmin ymin [zmin] xmax ymax [zmax]",
                "The frame before has other rows than it says: write the file again.",
            )
        where = f"{path}, time {head.time:g}"
        if head.grains < 1 or line + head.grains >= len(ends):
            raise InputError(
                where,
                f"{len(ends) - line - 1} rows to the end of the file",
                f"{head.grains} as the header says, at least one",
                "The file is cut short or empty at this time: write it again.",
            )
        span = (int(ends[line]) + 1, int(ends[line + head.grains]) + 1)
        width = len(line_at(text, span[0])[0].split())
        if HEADERS.get(width) != head.width:
            raise InputError(
                where,
                f"{head.width} numbers in the header and {width} a row",
                "6 and 8 in two dimensions, or 8 and 14",
                "Write the file with the layout of 8 or of 14 columns.",
            )
        yield Block(where, head.time, DATA_COLUMNS[width], text, span)
        line += head.grains + 1
    rest = text[int(ends[-1]) + 1 if len(ends) else 0 :]
    if rest.strip():
        raise InputError(
            str(path),
            f"a last line {rest[:60]!r} without its end",
            "complete lines",
            "Write it again.",
        )


def fstat_blocks(path: Path) -> list[Block | InputError]:
    """Frames of an `.fstat` file; their rows are passed over, not read.

    Parameters
    ----------
    path : Path
        The file, plain or gzip.

    Returns
    -------
    list of Block or InputError
        Rows of the contacts, in the order of the file. The last may be what is wrong with a frame
        that doesn't begin with comments; what follows it is not looked at.

    Raises
    ------
    InputError
        If the file is missing or empty.
    """
    return _until_fault(_fstat_blocks(path, open_text(path)))


def _fstat_blocks(path: Path, text: Text) -> Iterator[Block]:
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
        for _ in range(COMMENTS - 1):
            line, at = line_at(text, at)
            if not line.startswith(b"#") or text[at - 1 : at] != b"\n":
                raise InputError(
                    f"{path}, time {time:g}",
                    "a header that breaks off",
                    f"{COMMENTS} lines of comments",
                    "The file is cut short: write it again.",
                )
        stop = text.find(b"#", at)
        stop = len(text) if stop < 0 else stop
        yield Block(f"{path}, time {time:g}", time, FSTAT_COLUMNS, text, (at, stop))
        at = stop
