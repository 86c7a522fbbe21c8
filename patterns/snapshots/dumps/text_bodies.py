"""Columns of numbers in text, a stretch of a file at a time."""

from __future__ import annotations

import gzip
import mmap
import re
import zlib
from collections.abc import Sequence
from pathlib import Path

import pyarrow
import pyarrow.csv

from loops import InputError
from patterns.snapshots.table_files import require_file, whole_file
from patterns.snapshots.tables import Table

# What is searched and sliced alike: the map of a file, or what a gzip file holds.
Text = bytes | mmap.mmap

HEAD = 4096  # bytes that tell a format


def open_text(path: Path) -> Text:
    """Bytes of a text file, plain or gzip, without reading more of a plain one than is used.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    bytes or mmap
        Its bytes.

    Raises
    ------
    InputError
        If the file is missing, empty or damaged.
    """
    require_file(path)
    with open(path, "rb") as file:
        zipped = file.read(2) == b"\x1f\x8b"
        if not zipped:
            return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    content = b""
    with whole_file(path), gzip.open(path) as unzipped:
        content = unzipped.read()
    if not content:
        raise InputError(str(path), "an empty file", "a snapshot's file", "Export it again.")
    return content


def head_of(path: Path) -> bytes:
    """First bytes of a file, unpacked if it is gzip.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    bytes
        At most `HEAD` of them.
    """
    with open(path, "rb") as file:
        head = file.read(HEAD)
    if not head.startswith(b"\x1f\x8b"):
        return head
    try:
        return zlib.decompressobj(wbits=31).decompress(head, HEAD)
    except zlib.error:
        return head


def line_at(text: Text, start: int) -> tuple[bytes, int]:
    """Return the line that starts there, without its end, and where the next one starts."""
    stop = text.find(b"\n", start)
    stop = len(text) if stop < 0 else stop
    return text[start:stop].rstrip(b"\r"), min(stop + 1, len(text))


def read_body(
    where: str, text: Text, span: tuple[int, int], names: Sequence[str], wanted: Sequence[str]
) -> Table:
    """Columns of lines of numbers parted by blanks.

    Parameters
    ----------
    where : str
        The place, for messages.
    text : bytes or mmap
        The file.
    span : (int, int)
        First byte of the lines, and the byte after them; at least one line.
    names : sequence of str
        Names of the columns in their order.
    wanted : sequence of str
        Those to read, as numbers.

    Returns
    -------
    Table
        The columns wanted.

    Raises
    ------
    InputError
        For a line cut short, another number of columns, anything but numbers.
    """
    start, stop = span
    if text[stop - 1 : stop] != b"\n":
        # A number cut short still reads as a number: only the missing line end gives it away.
        raise InputError(
            where, "a last line without its end", "complete lines", "Dump or copy it again."
        )
    first = line_at(text, start)[0]
    count = len(first.split())
    if count != len(names):
        raise InputError(
            where, f"a line of {count} numbers", f"{len(names)} as named", "Dump or copy it again."
        )
    wanted = list(dict.fromkeys(wanted))
    # A blank before the line end is a column without a name.
    all_names = [*names, ""] if first.endswith(b" ") else list(names)
    try:
        return Table(where, _parse(memoryview(text)[start:stop], all_names, wanted))
    except (pyarrow.ArrowException, UnicodeDecodeError):
        # Columns may be padded with blanks, which costs another pass.
        pass
    try:
        return Table(where, _parse(_single_blanks(text[start:stop]), list(names), wanted))
    except (pyarrow.ArrowException, UnicodeDecodeError) as error:
        raise InputError(
            where, f"lines that are no table ({error})", "numbers in columns", "Dump it again."
        ) from None


def _single_blanks(body: bytes) -> bytes:
    """The lines with one blank between columns, and none around them."""
    body = re.sub(rb"[ \t\r]+", b" ", body)
    return body.replace(b" \n", b"\n").replace(b"\n ", b"\n").lstrip()


def _parse(body: bytes | memoryview, names: list[str], wanted: list[str]) -> pyarrow.Table:
    return pyarrow.csv.read_csv(
        pyarrow.BufferReader(pyarrow.py_buffer(body)),
        read_options=pyarrow.csv.ReadOptions(column_names=names),
        parse_options=pyarrow.csv.ParseOptions(delimiter=" ", quote_char=False),
        convert_options=pyarrow.csv.ConvertOptions(
            include_columns=wanted, column_types=dict.fromkeys(wanted, pyarrow.float64())
        ),
    )
