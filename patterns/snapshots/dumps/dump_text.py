"""Text dumps of LAMMPS and LIGGGHTS: frames of `ITEM: ...` headers and columns of numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from loops import InputError
from patterns.snapshots.tables import Table
from patterns.snapshots.text import Text, line_at, open_text, read_body

Floats = NDArray[np.float64]

ITEM = b"ITEM: "
START = b"ITEM: TIMESTEP"


class Box(NamedTuple):
    """Simulation box of a frame, in the plane.

    `origin` (2,), `cell` (2, 2) with the edges as columns and `height` along z (length);
    `periodic` of the two edges; `digits`, the significant ones that the header prints.
    """

    origin: Floats
    cell: Floats
    height: float
    periodic: tuple[bool, bool]
    digits: int


@dataclass(frozen=True, eq=False)
class DumpFrame:
    """Where one frame stands in a dump.

    Attributes
    ----------
    where : str
        File and step, for messages.
    step : int
        Time step.
    count : int
        Number of rows that the header promises.
    label : str
        What the rows are: ATOMS, ENTRIES.
    names : tuple of str
        Columns.
    box : Box or None
        Simulation box, if the header has one.
    text : bytes or mmap
        The file.
    span : (int, int)
        Bytes of the rows.
    """

    where: str
    step: int
    count: int
    label: str
    names: tuple[str, ...]
    box: Box | None
    text: Text
    span: tuple[int, int]


def is_dump(head: bytes) -> bool:
    """Whether a file that begins so is a text dump."""
    return head.startswith((START, b"ITEM: UNITS"))


def first_frame(path: Path, head: bytes) -> DumpFrame:
    """Header of the first frame, from the first bytes of a dump; `InputError` if it is none."""
    return _frame(path, head, 0)


def dump_frames(path: Path) -> list[DumpFrame | InputError]:
    """Headers of all frames of a dump; their rows are passed over, not read.

    Parameters
    ----------
    path : Path
        The dump, plain or gzip.

    Returns
    -------
    list of DumpFrame or InputError
        In the order of the file; the error is what is wrong with a header, such as of a file that
        ends within one.

    Raises
    ------
    InputError
        If the file is missing or empty, or has a step twice.
    """
    frames = list(_walk(path, open_text(path)))
    seen: set[int] = set()
    for frame in frames:
        if isinstance(frame, InputError):
            continue
        if frame.step in seen:
            raise InputError(
                str(path), f"step {frame.step} twice", "each step once", "Part the runs."
            )
        seen.add(frame.step)
    return frames


def read_rows(frame: DumpFrame, wanted: Sequence[str]) -> Table:
    """Columns of a frame.

    Parameters
    ----------
    frame : DumpFrame
        The frame.
    wanted : sequence of str
        Names of columns.

    Returns
    -------
    Table
        Those columns.

    Raises
    ------
    InputError
        If there are more or fewer rows than the header says, or anything but numbers.
    """
    start, stop = frame.span
    table = None
    if stop > start:
        table = Table(
            frame.where, read_body(frame.where, frame.text, frame.span, frame.names, wanted)
        )
    if table is None or len(table) != frame.count:
        raise InputError(
            frame.where,
            f"{0 if table is None else len(table)} rows",
            f"{frame.count} as the header says" if frame.count else "at least one row",
            "The frame is cut short or mixed with another one: dump or copy it again.",
        )
    return table


def _walk(path: Path, text: Text) -> Iterator[DumpFrame | InputError]:
    at = 0
    while 0 <= at < len(text):
        try:
            frame = _frame(path, text, at)
        except InputError as error:
            if text[at:].strip():
                yield error
            at = _next_start(text, at)
        else:
            yield frame
            at = frame.span[1]


def _next_start(text: Text, at: int) -> int:
    """Where the frame after a damaged one starts, -1 for nowhere."""
    # The damaged header has a TIMESTEP of its own, perhaps after UNITS.
    if is_dump(text[at : at + len(START)]):
        at = text.find(START, at) + 1 or len(text)
    return text.find(START, at)


def _frame(path: Path, text: Text, at: int) -> DumpFrame:
    """Read the header that starts there."""
    if not is_dump(text[at : at + len(START)]):
        raise InputError(str(path), f"{text[at : at + 40]!r}", START.decode(), "Give a text dump.")
    values: dict[bytes, list[bytes]] = {}
    label = b""
    while True:
        line, at = line_at(text, at)
        if not line.startswith(ITEM):
            raise _cut(path, values)
        key = line.removeprefix(ITEM)
        if label and key.split(b" ")[0] == label.split(b" ")[0]:
            break
        if key.startswith(b"NUMBER OF "):
            label = key.removeprefix(b"NUMBER OF ").strip()
        stop = text.find(ITEM, at)
        if stop < 0:
            raise _cut(path, values)
        if b"TIMESTEP" in values and key.strip() == b"TIMESTEP":
            raise _cut(path, values)
        values[key.strip()] = text[at:stop].splitlines()
        at = stop
    stop = text.find(ITEM, at)
    names = tuple(key.removeprefix(label).decode(errors="replace").split())
    step, count = (_whole(path, values, name) for name in (b"TIMESTEP", b"NUMBER OF " + label))
    span = (at, len(text) if stop < 0 else stop)
    where = f"{path}, step {step}"
    return DumpFrame(
        where, step, count, label.decode(errors="replace"), names, _box(where, values), text, span
    )


def _whole(path: Path, values: dict[bytes, list[bytes]], name: bytes) -> int:
    try:
        number = int(values[name][0])
    except (KeyError, IndexError, ValueError):
        raise _cut(path, values) from None
    if not 0 <= number < 2**63:
        raise _cut(path, values)
    return number


def _cut(path: Path, values: dict[bytes, list[bytes]]) -> InputError:
    step = b" ".join(values.get(b"TIMESTEP", [b"?"])).decode(errors="replace")
    return InputError(
        f"{path}, step {step}",
        "a header that breaks off",
        "ITEM: TIMESTEP, NUMBER OF ..., BOX BOUNDS and the names of the columns",
        "Dump or copy it again.",
    )


def _box(where: str, values: dict[bytes, list[bytes]]) -> Box | None:
    found = [(key, lines) for key, lines in values.items() if key.startswith(b"BOX BOUNDS")]
    if not found:
        return None
    words = found[0][0].decode(errors="replace").split()[2:]
    fields = [line.split() for line in found[0][1][:3]]
    try:
        rows = np.array([[float(value) for value in line] for line in fields])
        if rows.shape != ((3, 4) if "abc" in words else (3, 3) if "xy" in words else (3, 2)):
            raise ValueError
        origin, cell, height = _edges(rows)
        if not (np.isfinite(rows).all() and np.linalg.det(cell) > 0):
            raise ValueError
    except ValueError:
        shown = [line.decode(errors="replace") for line in found[0][1][:3]]
        raise InputError(
            where, f"box {shown}", "three lines of bounds, low and high", "Dump or copy it again."
        ) from None
    # pp is periodic; f, s and m, also of one side alone, are not. Old dumps don't say.
    flags = [word for word in words if len(word) == 2 and set(word) <= set("pfsm")]
    periodic = (flags[0] == "pp", flags[1] == "pp") if len(flags) == 3 else (False, False)
    digits = max(_digits(value) for line in fields for value in line)
    return Box(origin, cell, height, periodic, digits)


def _edges(rows: Floats) -> tuple[Floats, Floats, float]:
    """Origin, edges in the plane and height, from the three kinds of `BOX BOUNDS`."""
    if rows.shape[1] == 4:
        return rows[:2, 3].copy(), rows[:2, :2].T.copy(), float(rows[2, 2])
    low, high = rows[:, 0].copy(), rows[:, 1].copy()
    xy = 0.0
    if rows.shape[1] == 3:
        # The header has the bounds of the tilted box: take the tilt off them.
        xy, xz, yz = rows[:, 2]
        corners = (0.0, xy, xz, xy + xz)
        low -= [min(corners), min(0.0, yz), 0.0]
        high -= [max(corners), max(0.0, yz), 0.0]
    lx, ly, lz = high - low
    return low[:2], np.array([[lx, xy], [0.0, ly]]), float(lz)


def _digits(value: bytes) -> int:
    mantissa = value.lower().split(b"e")[0].lstrip(b"+-").replace(b".", b"")
    return len(mantissa.lstrip(b"0"))
