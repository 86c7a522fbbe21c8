"""Text files, plain or gzip: their bytes, their layout, and parts of them as columns."""

from __future__ import annotations

import csv
import gzip
import mmap
import os
import re
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import pyarrow
import pyarrow.csv

from loops import InputError
from loops.errors import out_of_memory

# Content of a text file: memory-mapped, or unpacked from gzip.
Text = bytes | mmap.mmap
HEAD = 4096  # first bytes of a file, by which its format is recognised
# Highest accepted compression ratio, a guard against zip bombs.
PACKING = 1100
UNCOUNTED_BYTES = 1 << 24  # up to this size the ratio is not checked
SHARE = 0.5  # largest share of the machine's memory for the content of a file
FLOAT = pyarrow.float64()
SHOWN = 12  # number of names in a message


def require_file(path: Path) -> None:
    """Raise `InputError` if there is no such file or nothing in it."""
    if path.is_dir():
        remedy = "Name the file of the grains; of many snapshots, all of them to grainloops series."
        raise InputError(str(path), "a folder", "a snapshot's file", remedy)
    if not path.is_file():
        raise InputError(str(path), "no such file", "a snapshot's file", "Check the path.")
    if path.stat().st_size == 0:
        raise InputError(str(path), "an empty file", "a snapshot's file", "Export it again.")


def require_room(path: str | Path, size: int, packed: int) -> None:
    """Raise `InputError` if `size` bytes exceed the memory, or what `packed` bytes can hold."""
    room = int(SHARE * _memory())
    if size <= min(room, max(UNCOUNTED_BYTES, PACKING * packed)):
        return
    limit = f"{PACKING} times the {packed} of the file" if size <= room else f"{room / 1e9:.3g}e9"
    expected = f"at most {limit} bytes (half of this machine's memory at most)"
    remedy = "Export the columns that are needed, or a part of the sample."
    raise InputError(str(path), f"numbers of {size / 1e9:.3g}e9 bytes", expected, remedy)


def _memory() -> int:
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        return 1 << 34


def beside(path: Path, *names: str) -> Path | None:
    """The first file of these names beside another, gzip or not; None if there is none."""
    for name in names:
        for found in (name, f"{name}.gz", name.removesuffix(".gz")):
            if path.with_name(found).is_file():
                return path.with_name(found)
    return None


@contextmanager
def whole_file(path: Path) -> Iterator[None]:
    """Turn errors of libraries on damaged files into one `InputError`; lack of memory is named."""
    try:
        yield
    except InputError:
        raise
    except MemoryError as error:
        raise MemoryError(f"out of memory while {path} was read ({error})") from None
    except (
        *(pyarrow.ArrowException, OSError, EOFError, zlib.error, zipfile.BadZipFile),
        *(ValueError, LookupError, RuntimeError, TypeError, AttributeError, ArithmeticError),
    ) as error:
        if out_of_memory(error):
            raise MemoryError(f"out of memory while {path} was read") from None
        where = str(path)
        received = f"an unreadable or truncated file ({str(error)[:200] or type(error).__name__})"
        raise InputError(where, received, "a complete file", "Export or copy it again.") from None


def listed(names: Sequence[str]) -> str:
    """Names for a message; of many the first ones."""
    shown = ", ".join(name if len(name) < 60 else f"{name[:57]}..." for name in names[:SHOWN])
    return shown if len(names) <= SHOWN else f"{shown}, ... ({len(names)} in all)"


def open_text(path: Path) -> Text:
    """Bytes of a text file, plain or gzip, without reading more of a plain one than is used."""
    require_file(path)
    with open(path, "rb") as file:
        zipped = file.read(2) == b"\x1f\x8b"
        if not zipped:
            return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    content = bytearray()
    with whole_file(path), gzip.open(path) as unzipped:
        while part := unzipped.read(1 << 24):
            content += part
            require_room(path, len(content), path.stat().st_size)
    if not content:
        raise InputError(str(path), "an empty file", "a snapshot's file", "Export it again.")
    return bytes(content)


def head_of(path: Path) -> bytes:
    """First bytes of a file, at most `HEAD`, unpacked if it is gzip."""
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


def require_line_end(where: str, text: Text, stop: int) -> None:
    """Raise `InputError` unless a line ends there: a number cut short still reads as a number."""
    if text[stop - 1 : stop] != b"\n":
        remedy = "Export or copy it again; if the line is complete, end it."
        raise InputError(where, "a last line without its end", "complete lines", remedy)


def read_body(
    where: str,
    text: Text,
    span: tuple[int, int],
    names: Sequence[str],
    wanted: Sequence[str],
    kind: pyarrow.DataType = FLOAT,
) -> pyarrow.Table:
    """Columns `wanted` of lines of numbers parted by blanks, bytes `span` of the text.

    `InputError` for a line cut short, another number of columns, anything but numbers.
    """
    start, stop = span
    require_line_end(where, text, stop)
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
        return _parse(memoryview(text)[start:stop], all_names, wanted, kind)
    except MemoryError:
        raise
    except (pyarrow.ArrowException, UnicodeDecodeError):
        # Columns may be padded with blanks, which costs another pass.
        pass
    try:
        return _parse(single_blanks(text[start:stop]), list(names), wanted, kind)
    except MemoryError:
        raise
    except (pyarrow.ArrowException, UnicodeDecodeError) as error:
        received = f"lines that are no table ({str(error)[:200]})"
        raise InputError(where, received, "numbers in columns", "Dump it again.") from None


def single_blanks(body: bytes) -> bytes:
    """The lines with one blank between columns, and none around them."""
    body = re.sub(rb"[ \t\r]+", b" ", body)
    return body.replace(b" \n", b"\n").replace(b"\n ", b"\n").lstrip()


def _parse(
    body: bytes | memoryview, names: list[str], wanted: list[str], kind: pyarrow.DataType
) -> pyarrow.Table:
    return pyarrow.csv.read_csv(
        pyarrow.BufferReader(pyarrow.py_buffer(body)),
        read_options=pyarrow.csv.ReadOptions(column_names=names),
        parse_options=pyarrow.csv.ParseOptions(delimiter=" ", quote_char=False),
        convert_options=pyarrow.csv.ConvertOptions(
            include_columns=wanted, column_types=dict.fromkeys(wanted, kind)
        ),
    )


COMMENT_MARKS = (b"#", b"%", b"//", b"sep=")  # the last one is used by Excel
NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?|[+-]?(nan|inf)", re.IGNORECASE)


class Layout(NamedTuple):
    """Names of the columns, their delimiter, and the start of the rows."""

    names: list[str]
    delimiter: str  # one character; a blank means any number of blanks
    decimal: str
    start: int


def layout_of(path: Path, text: Text) -> Layout:
    """Find the layout of a table from its first lines.

    The header is the first line that is no comment; if that line holds numbers, the last comment
    before it (`# id x y radius`). `InputError` for a table without a header, and if commas are both
    delimiter and decimal mark.
    """
    comment, start, line = b"", 0, b""
    while start < len(text):
        line, after = line_at(text, start)
        line = line.removeprefix(b"\xef\xbb\xbf").strip()
        if line and not line.startswith(COMMENT_MARKS):
            break
        comment, start = line or comment, after
    header = _decoded(path, line)
    delimiter = _delimiter(header)
    words = split(header, delimiter)
    if words and all(NUMBER.fullmatch(word) for word in words):
        header, after = _decoded(path, comment.lstrip(b"#%/").strip()), start
        names = split(header, _delimiter(header))
        if len(names) != len(words):
            received = f"numbers, {','.join(words)[:60]}"
            remedy = "Write them above the numbers, such as id,x,y,radius."
            raise InputError(f"first line of {path}", received, "the names of the columns", remedy)
    else:
        names = words
    first = _decoded(path, line_at(text, after)[0].strip())
    return Layout(names, delimiter, _decimal(path, names, first, delimiter), after)


def split(line: str, delimiter: str) -> list[str]:
    """Fields of a line, without blanks around them."""
    if delimiter == " ":
        return line.split()
    if '"' in line:
        csv.field_size_limit(max(len(line), csv.field_size_limit()))
        return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
    return [word.strip(" \t") for word in line.split(delimiter)] if line else []


def _delimiter(header: str) -> str:
    found = [mark for mark in (";", "\t", ",") if mark in header]
    return found[0] if found else " " if " " in header else ","


def _decimal(path: Path, names: list[str], first: str, delimiter: str) -> str:
    """The decimal mark of the first row of numbers."""
    if delimiter == ",":
        fields = split(first, ",")
        if len(fields) > len(names) and "." not in first and '"' not in first:
            raise InputError(
                str(path),
                f"rows of {len(fields)} numbers between commas under {len(names)} names",
                "as many numbers as names",
                "If these are decimal commas, part the columns by ';', or write decimal points.",
            )
        return "."
    return "," if any("," in word for word in split(first, delimiter)) else "."


def table_rows(text: Text, layout: Layout) -> bytes | memoryview:
    """The rows below the header, one delimiter between columns; comments are left out."""
    body: bytes | memoryview = memoryview(text)[layout.start :]
    if any(text.find(b"\n" + mark, max(layout.start - 1, 0)) >= 0 for mark in COMMENT_MARKS):
        lines = bytes(body).splitlines(keepends=True)
        body = b"".join(line for line in lines if not line.lstrip().startswith(COMMENT_MARKS))
    if layout.delimiter == " ":
        body = single_blanks(bytes(body))
    return body


def _decoded(path: Path, line: bytes) -> str:
    try:
        return line.decode()
    except UnicodeDecodeError as error:
        raise InputError(
            f"header of {path}", f"bytes that are no text ({error})", "column names", "Correct it."
        ) from None
