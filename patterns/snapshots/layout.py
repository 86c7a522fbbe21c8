"""How a text table is laid out: comments, header, delimiter, decimal mark."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import NamedTuple

from loops import InputError
from patterns.snapshots.text import Text, line_at, single_blanks

COMMENTS = (b"#", b"%", b"//", b"sep=")  # the last is Excel's
NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?|[+-]?(nan|inf)", re.IGNORECASE)


class Layout(NamedTuple):
    """Names of the columns, what parts them, and where the rows start."""

    names: list[str]
    delimiter: str  # one character; a blank stands for any number of blanks
    decimal: str
    start: int


def layout_of(path: Path, text: Text) -> Layout:
    """Find the layout of a table from its first lines.

    The header is the first line that is no comment; where that one holds numbers, the last
    comment before it (`# id x y radius`). `InputError` for a table without a header, and where
    commas part columns and decimals alike.
    """
    comment, start, line = b"", 0, b""
    while start < len(text):
        line, after = line_at(text, start)
        line = line.removeprefix(b"\xef\xbb\xbf").strip()
        if line and not line.startswith(COMMENTS):
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
    """The fields of a line, blanks around them left out."""
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


def rows_of(text: Text, layout: Layout) -> bytes | memoryview:
    """The rows below the header, one delimiter between columns; comments are left out."""
    body: bytes | memoryview = memoryview(text)[layout.start :]
    if any(text.find(b"\n" + mark, max(layout.start - 1, 0)) >= 0 for mark in COMMENTS):
        lines = bytes(body).splitlines(keepends=True)
        body = b"".join(line for line in lines if not line.lstrip().startswith(COMMENTS))
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
