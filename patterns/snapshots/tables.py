"""Columns of numbers, and the files they come from: text, plain or gzip, Parquet, npz, HDF5."""

from __future__ import annotations

import csv
import math
import re
import tokenize
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from loops import InputError
from loops.arrays import Flags, Floats, Integers, in_threads
from loops.compiled import load_ahead
from loops.errors import library
from patterns.snapshots.files import (
    Text,
    line_at,
    open_text,
    require_file,
    require_line_end,
    require_room,
    unpacked_name,
    whole_file,
)

Wanted = Callable[[str], bool]  # whether a column of this name is read
NAMES_SHOWN = 12  # number of names in a message


def listed(names: Sequence[str]) -> str:
    """Names for a message; of many the first ones."""
    shown = ", ".join(name if len(name) < 60 else f"{name[:57]}..." for name in names[:NAMES_SHOWN])
    return shown if len(names) <= NAMES_SHOWN else f"{shown}, ... ({len(names)} in all)"


def read_body(
    where: str,
    text: Text,
    span: tuple[int, int],
    names: Sequence[str],
    wanted: Sequence[str],
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
    # A blank before the line end is a column without a name.
    body, all_names = memoryview(text)[start:stop], [*names, *[""] * first.endswith(b" ")]
    try:
        try:
            return parsed(body, all_names, wanted)
        except (pyarrow.ArrowInvalid, UnicodeDecodeError):
            # Columns may be padded with blanks, which costs another pass.
            return parsed(single_blanks(text[start:stop]), names, wanted)
    except MemoryError:
        raise
    except (pyarrow.ArrowException, UnicodeDecodeError) as error:
        received = f"lines that are no table ({str(error)[:200]})"
        raise InputError(where, received, "numbers in columns", "Dump it again.") from None


def parsed(
    body: bytes | memoryview,
    names: Sequence[str],
    wanted: Sequence[str],
    delimiter: str = " ",
    decimal: str = ".",
) -> pyarrow.Table:
    """Columns `wanted` of rows of text, all of them if none is named."""
    return pyarrow.csv.read_csv(
        pyarrow.BufferReader(pyarrow.py_buffer(body)),
        read_options=pyarrow.csv.ReadOptions(column_names=list(names)),
        parse_options=pyarrow.csv.ParseOptions(delimiter=delimiter),
        convert_options=pyarrow.csv.ConvertOptions(
            include_columns=list(dict.fromkeys(wanted)) or None, decimal_point=decimal
        ),
    )


def single_blanks(body: bytes) -> bytes:
    """The lines with one blank between columns, and none around them."""
    body = re.sub(rb"[ \t\r]+", b" ", body)
    return body.replace(b" \n", b"\n").replace(b"\n ", b"\n").lstrip()


COMMENT_MARKS = ("#", "%", "//", "sep=")  # the last one is used by Excel
NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?|[+-]?(nan|inf)", re.IGNORECASE)
RULE = re.compile(r"[-=_+*|\s;,]*")  # lines that part or fill
# First lines by which a layout is told, a header among them.
FIRST_LINES = 200
# Lines below the names that may hold units.
UNIT_LINES = 2


class Layout(NamedTuple):
    """Names of the columns, their delimiter, and the start of the rows."""

    names: list[str]
    delimiter: str  # one character; a blank means any number of blanks
    decimal: str
    start: int


class Line(NamedTuple):
    """A line of text, where it starts, and the comments before it."""

    text: str
    start: int
    comments: list[str]


def layout_of(path: Path, text: Text, known: Wanted | None = None) -> Layout:
    """Find the layout of a table from its first lines.

    The header is the first line of words above one of as many fields with numbers; lines before it
    are left out, lines of units below it join its names. Without such a line the last comment of
    `known` names is it (`# id x y radius`), else columns are numbered from 0. `InputError` if
    commas are both delimiter and decimal mark.
    """
    lines = list(_first_lines(text))
    splits = {mark: [split(line.text, mark) for line in lines] for mark in (";", "\t", ",", " ")}
    words = [re.split(r"[;,\s]+", line.text) for line in lines]
    # Numbers on top have no header but a comment; below lines of words only if no names do.
    for stop, numbers in ((1, True), (len(lines), False), (len(lines), True)):
        for mark, fields in splits.items():
            for k, row in enumerate(fields[:stop]):
                alike = len(row) > 1 and len(row) == len(fields[min(k + 1, len(fields) - 1)])
                if not alike or not any(NUMBER.fullmatch(word) for word in row):
                    continue
                if not numbers:
                    names = _header(fields, k)
                elif k == 0 or (known and not any(map(known, chain(*words[:k])))):
                    names = _numbered(row, lines[k], known)
                else:
                    break
                if names:
                    return _layout(path, lines[k], names, row, mark)
    header = lines[0].text if lines else ""
    mark = _delimiter(header)
    names, rows = split(header, mark), lines[1:]
    return _layout(path, rows[0] if rows else Line("", len(text), []), names, [], mark)


def _header(fields: Sequence[list[str]], first: int) -> list[str] | None:
    """Names, with their units, of the columns of a row by the lines of words above it."""
    row = fields[first]
    for k in range(max(first - UNIT_LINES - 1, 0), first):
        names, *units = fields[k:first]
        if len(row) == len(names) + 1 and not row[-1]:
            names = [*names, ""]
        words = [word for line in (names, *units) for word in line]
        sound = not any(NUMBER.fullmatch(word) for word in words) and names.count("") <= 1
        if sound and len(words) == len(row) * (1 + len(units)):
            for line in units:
                named = zip(names, line, strict=True)
                names = [f"{n} ({unit.strip('[]() ')})" if unit else n for n, unit in named]
            return names
    return None


def _numbered(row: list[str], line: Line, known: Wanted | None) -> list[str] | None:
    """Names of a row of numbers by the last comment of as many, else places of the columns."""
    if not all(NUMBER.fullmatch(word) for word in row):
        return None
    for comment in reversed(line.comments):
        names = split(comment, _delimiter(comment))
        if len(names) == len(row) and (known is None or any(map(known, names))):
            return names
    return [str(k) for k in range(len(row))]


def _first_lines(text: Text) -> Iterator[Line]:
    """First lines that are neither blank nor comments."""
    comments: list[str] = []
    after = 0
    for _ in range(FIRST_LINES):
        if after >= len(text):
            return
        start = after
        raw, after = line_at(text, start)
        raw = raw.removeprefix(b"\xef\xbb\xbf").strip()
        try:
            line = raw.decode()
        except UnicodeDecodeError:
            line = raw.decode("latin-1")
        if line.startswith(COMMENT_MARKS):
            comments.append(line.lstrip("#%/").strip())
        elif not RULE.fullmatch(line):
            yield Line(line, start, comments)


def _layout(path: Path, first: Line, names: list[str], fields: list[str], mark: str) -> Layout:
    """Layout with the decimal mark of the first row."""
    fields = fields or split(first.text, mark)
    if mark != ",":
        decimal = "," if any("," in word for word in fields) else "."
        return Layout(names, mark, decimal, first.start)
    if len(fields) > len(names) and "." not in first.text and '"' not in first.text:
        raise InputError(
            str(path),
            f"rows of {len(fields)} numbers between commas under {len(names)} names",
            "as many numbers as names",
            "If these are decimal commas, part the columns by ';', or write decimal points.",
        )
    return Layout(names, mark, ".", first.start)


def split(line: str, delimiter: str) -> list[str]:
    """Fields of a line, without blanks around them."""
    if delimiter == " " and '"' not in line:
        return line.split()
    if '"' in line:
        csv.field_size_limit(max(len(line), csv.field_size_limit()))
        with suppress(csv.Error):
            return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
    return [word.strip(" \t") for word in line.split(delimiter)] if line else []


def _delimiter(header: str) -> str:
    return next((mark for mark in (";", "\t", ",", " ") if mark in header), ",")


def table_rows(text: Text, layout: Layout) -> bytes | memoryview:
    """The rows below the header, one delimiter between columns; comments are left out."""
    body: bytes | memoryview = memoryview(text)[layout.start :]
    marks = tuple(mark.encode() for mark in COMMENT_MARKS)
    if any(text.find(b"\n" + mark, max(layout.start - 1, 0)) >= 0 for mark in marks):
        lines = bytes(body).splitlines(keepends=True)
        body = b"".join(line for line in lines if not line.lstrip().startswith(marks))
    if layout.delimiter == " ":
        body = single_blanks(bytes(body))
    return body


Arrays = dict[str, NDArray[Any]]
ARRAY_FILES = (".npz", ".h5", ".hdf5")
TEXTS = (".csv", ".tsv", ".txt", ".dat")
TABLE_ENDINGS = (*TEXTS, ".parquet", *ARRAY_FILES)
SPREADSHEETS = (".xlsx", ".xls", ".xlsm", ".ods")
# Squares of larger numbers overflow.
HUGE = 1e150
# A float64 rounds larger whole numbers.
LARGEST_WHOLE = 2.0**53


class Table:
    """Columns taken by name as arrays of float64; `names` may be more than were read.

    `rows` are those of the file, by which messages name them, if not all of them are here.
    """

    def __init__(
        self,
        path: str | Path,
        columns: pyarrow.Table | Mapping[str, Any],
        names: Sequence[str] | None = None,
        rows: Integers | None = None,
    ) -> None:
        self.path, self._rows = str(path), rows
        if isinstance(columns, pyarrow.Table):
            require_once(self.path, columns.column_names)
            read = in_threads(as_array, columns.columns)
            columns = dict(zip(columns.column_names, read, strict=True))
        self._columns: Arrays = {name: as_array(values) for name, values in columns.items()}
        self.names = list(self._columns if names is None else names)
        self._known = set(self.names)
        self._read: dict[str, Floats] = {}
        self._length = len(next(iter(self._columns.values()))) if self._columns else 0
        if self._length == 0 and (self._columns or not self.names):
            raise InputError(self.path, "no rows", "at least one row", "Check the export.")

    def __len__(self) -> int:
        return self._length

    def has(self, *names: str) -> bool:
        """Whether all these columns are there."""
        return self._known.issuperset(names)

    def renamed(self, columns: Mapping[str, str]) -> Table:
        """Return the table with the plain names of a column map: `{plain name: column}`.

        A column that already has the plain name, and is not the one mapped, gives way. Entries
        whose column is not here are left alone: a map may speak of two tables.
        """
        new = {column: name for name, column in columns.items() if column in self._known}
        given = set(new.values())
        kept = [name for name in self.names if name in new or name not in given]
        found = {new.get(n, n): self._columns[n] for n in kept if n in self._columns}
        return Table(self.path, found, [new.get(name, name) for name in kept], rows=self._rows)

    def with_column(self, name: str, values: Floats) -> Table:
        """Return the table with a column more, or with other numbers in it."""
        names = self.names if name in self._known else [*self.names, name]
        return Table(self.path, self._columns | {name: values}, names, rows=self._rows)

    def take(self, rows: Flags | Integers) -> Table:
        """Return some of the rows; itself if these are all rows in order."""
        rows = np.flatnonzero(rows) if rows.dtype == bool else rows
        if len(rows) == len(self) and bool((rows[1:] > rows[:-1]).all()):
            return self
        found = {name: values[rows] for name, values in self._columns.items()}
        return Table(self.path, found, self.names, rows=self.number(rows))

    def number(self, row: Any) -> Any:
        """Number of a row in the file, from 0."""
        return row if self._rows is None else self._rows[row]

    def column(self, name: str) -> Floats:
        """Numbers of a column; `InputError` if it is missing or holds anything else."""
        if name in self._read:
            return self._read[name]
        if name not in self._columns:
            require_columns((self, (name,)))
        where, values = f"column {name!r} of {self.path}", self._columns[name]
        if values.dtype.kind not in "iufb":
            values = np.array(
                [self._number_of(where, row, word) for row, word in enumerate(values)]
            )
        with np.errstate(over="ignore"):  # of longer floats
            values = np.asarray(values, dtype=np.float64)
        # NaN fails both comparisons.
        if not (values.max() <= HUGE and values.min() >= -HUGE):
            row = int(np.argmin(np.abs(values) <= HUGE))
            received, expected = str(values[row]), f"a finite number, at most {HUGE:g}"
            raise InputError(
                f"{where}, row {self.number(row)}", received, expected, "Correct or drop the row."
            )
        self._read[name] = values
        return values

    def _number_of(self, where: str, row: int, word: Any) -> float:
        try:
            return float(word if isinstance(word, bytes) else str(word))
        except ValueError:
            where, received = f"{where}, row {self.number(row)}", repr(str(word)[:60])
            raise InputError(where, received, "a number", "Correct the file.") from None

    def are(self, name: str, word: str) -> Flags | None:
        """Whether each text of a column is a word; None if it holds numbers."""
        values = self._columns.get(name)
        if values is None or values.dtype.kind != "U":
            return None
        return np.asarray(np.char.lower(np.char.strip(values)) == word)

    def columns(self, *names: str) -> Floats:
        """(rows, names) array of several columns."""
        return np.column_stack([self.column(name) for name in names])

    def optional(self, *names: str) -> Floats | None:
        """`columns`, or None if none of them is there; some without the others is an error."""
        return self.columns(*names) if any(name in self._known for name in names) else None

    def integers(self, name: str) -> Integers:
        """Whole numbers of a column, every digit; `InputError` as `column`, and for others."""
        stored = self._columns.get(name)
        if stored is not None and stored.dtype.kind in "iu":
            whole = stored.astype(np.int64)
            if (whole == stored).all() and (stored.dtype.kind == "i" or whole.min() >= 0):
                return whole
        values = self.column(name)
        fractions, large = np.rint(values) != values, np.abs(values) > LARGEST_WHOLE
        if not (fractions.any() or large.any()):
            return values.astype(np.int64)
        row = int(np.argmax(fractions if fractions.any() else large))
        where = f"column {name!r} of {self.path}, row {self.number(row)}"
        if fractions.any():
            raise InputError(where, str(values[row]), "a whole number", "Correct the file.")
        expected = "a whole number below 2**63 (stored as a float: up to 2**53)"
        remedy = "Store it as a 64-bit integer, or number the grains anew."
        raise InputError(where, f"{values[row]:.17g}", expected, remedy)


def as_array(column: Any) -> NDArray[Any]:
    """Column as an array: whole numbers, floats with NaN for gaps, or texts."""
    if not isinstance(column, pyarrow.ChunkedArray):
        return np.asarray(column)
    kind = column.type
    numbers = pyarrow.types.is_floating(kind) or pyarrow.types.is_integer(kind)
    if numbers and not column.null_count and column.num_chunks:
        # Pyarrow's own `to_numpy` would load pandas.
        return np.asarray(np.from_dlpack(pyarrow.concat_arrays(column.chunks)))
    if numbers or pyarrow.types.is_null(kind) or pyarrow.types.is_boolean(kind):
        return np.asarray(column.cast(pyarrow.float64(), safe=False).to_numpy())
    # Bytes of a damaged file stay bytes: `column` names the first that is no number.
    return np.array(column.to_pylist(), dtype=None if pyarrow.types.is_binary(kind) else str)


def require_columns(*wanted: tuple[Table, tuple[str, ...]]) -> None:
    """Raise `InputError` that names all columns that these tables lack."""
    lacking = [(table, [n for n in names if not table.has(n)]) for table, names in wanted]
    lacking = [(table, names) for table, names in lacking if names]
    if not lacking:
        return
    every = [name for _, names in lacking for name in names]
    word, them, holds = ("column", "it", "the one that holds it")
    if len(every) > 1:
        word, them, holds = ("columns", "them", "those that hold them")
    quoted = [", ".join(map(repr, names)) for _, names in lacking]
    bare = any(table.names[:1] == ["0"] for table, _ in lacking)
    named = ",".join(f"{name}=COLUMN" for name in every)
    named += ", or number those of a table without header from 0, such as radius=3" * bare
    places = zip(quoted, (table.path for table, _ in lacking), strict=True)
    raise InputError(
        f"{word} {' and '.join(f'{names} of {path}' for names, path in places)}",
        "; ".join(f"columns {listed(table.names)}" for table, _ in lacking),
        f"{'a ' * (len(every) == 1)}{word} {', '.join(map(repr, every))}",
        f"Add {them}, or name {holds}: --columns {named}.",
    )


def require_once(path: str, names: Sequence[str]) -> None:
    """Raise `InputError` for a repeated name."""
    if len(set(names)) == len(names):
        return
    repeated = next(name for name, count in Counter(names).items() if count > 1)
    where, received = f"header of {path}", f"the column {repeated[:60]!r} more than once"
    raise InputError(where, received, "each column once", "Rename or drop one of them.")


def read_table(path: Path, wanted: Wanted | None = None) -> Table:
    """Columns of a file that holds one table, those that are `wanted` if not None.

    Files end in one of `TABLE_ENDINGS`. `InputError` if the file is missing, empty, truncated, of
    another kind, too large or no such table.
    """
    require_file(path)
    name = unpacked_name(path.name.lower())
    if name.endswith(ARRAY_FILES):
        names, arrays = read_arrays(path, wanted)
        return table_of_arrays(str(path), names, arrays)
    if name.endswith(".parquet"):
        return _read_parquet(path, wanted)
    if name.endswith(TEXTS):
        return _read_text(path, wanted)
    if name.endswith(SPREADSHEETS):
        remedy = "In the spreadsheet: save as CSV, the grains in one file, the contacts in another."
        raise InputError(str(path), "a spreadsheet", f"{', '.join(TEXTS)} or .parquet", remedy)
    received = f"a file ending in {path.suffix[:20]!r}"
    expected = f"{', '.join(TABLE_ENDINGS[:-1])} or {TABLE_ENDINGS[-1]}"
    raise InputError(str(path), received, expected, "Convert it, or name its format by --format.")


def given_table(label: str, given: Any) -> Table:
    """Table of a data frame of pandas, polars or pyarrow, a dict of arrays or a structured array.

    `InputError` for anything else, and for columns of different lengths.
    """
    if isinstance(given, pyarrow.Table):
        return Table(label, given)
    if isinstance(given, np.ndarray) and given.dtype.names:
        names = list(given.dtype.names)
    elif isinstance(given, Mapping) or hasattr(given, "columns"):
        names = [*getattr(given, "columns", given)]
    else:
        received = f"{type(given).__module__}.{type(given).__name__}".removeprefix("builtins.")
        raise InputError(label, received, "a data frame, or a dict of arrays", "Name the columns.")
    require_once(label, [str(name) for name in names])
    arrays: dict[str, Any] = {}
    for name in names:
        values = np.asarray(given[name])
        if values.dtype.kind == "O":  # missing values, or words
            try:
                values = pyarrow.chunked_array([pyarrow.array(list(values), from_pandas=True)])
            except pyarrow.ArrowException:
                values = values.astype(str)
        arrays[str(name)] = values
    lengths = {name: len(values) for name, values in arrays.items()}
    if len({*lengths.values()}) > 1:
        received = f"columns of {', '.join(f'{n} ({name})' for name, n in lengths.items())} rows"
        raise InputError(label, received[:200], "columns of one length", "Give each all its rows.")
    return Table(label, arrays)


def table_of_arrays(label: str, names: Sequence[str], arrays: Arrays) -> Table:
    """Arrays of one axis and one length as a table; `names` of all that the file has."""
    if not arrays:
        received = f"arrays {listed(names)}" if names else "no arrays"
        remedy = "Check the export, or name the columns: --columns NAME=COLUMN."
        raise InputError(label, received, "one array a column", remedy)
    first = next(iter(arrays.values()))
    rows = len(first) if first.ndim else 0
    for name, values in arrays.items():
        if values.shape != (rows,):
            where = f"array {name!r} of {label}"
            received, remedy = f"shape {values.shape}", "Store each column as an array of one axis."
            raise InputError(where, received, f"shape ({rows},), as the first column", remedy)
    return Table(label, arrays, names)


def read_arrays(path: Path, wanted: Wanted | None = None) -> tuple[list[str], Arrays]:
    """Names of all arrays in an npz or HDF5 file, and those `wanted`, by the end of their names.

    Those of groups are called `group/name`.
    """
    require_file(path)
    entries = _npz_entries if path.suffix.lower() == ".npz" else _hdf5_entries
    names, arrays, size = list[str](), Arrays(), 0
    with whole_file(path):
        for name, own, read in entries(path):
            names.append(name)
            if wanted is None or wanted(name) or wanted(name.rpartition("/")[2]):
                # Chunks of HDF5 that were never written take no space in the file.
                require_room(path, size := size + own, path.stat().st_size)
                arrays[name] = read()
        require_once(str(path), names)
    return names, arrays


# Name of an array in a file, its size in bytes, and what reads it.
Entries = Iterator[tuple[str, int, Callable[[], NDArray[Any]]]]


def _npz_entries(path: Path) -> Entries:
    with zipfile.ZipFile(path) as archive:
        for member in archive.infolist():
            if member.filename.endswith(".npy"):
                name = member.filename.removesuffix(".npy")
                yield name, member.file_size, partial(_npy_array, archive, member)


def _npy_array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> NDArray[Any]:
    form = np.lib.format
    header = {(1, 0): form.read_array_header_1_0, (2, 0): form.read_array_header_2_0}
    try:
        with archive.open(member) as file:
            shape, _, dtype = header[form.read_magic(file)](file)
        if math.prod(shape) * dtype.itemsize > member.file_size:
            raise ValueError("an array that is cut short")
        with archive.open(member) as file:
            return np.asarray(form.read_array(file, allow_pickle=False))
    except (SyntaxError, tokenize.TokenError) as error:  # headers are parsed as Python
        raise ValueError(f"a damaged header, {error}") from None


def _hdf5_entries(path: Path) -> Entries:
    with library(str(path), "h5py"):
        import h5py
    found: list[tuple[str, Any]] = []
    with open(path, "rb") as raw, h5py.File(raw, "r") as file:
        file.visititems(lambda name, item: found.append((name, item)))
        for name, item in found:
            if isinstance(item, h5py.Dataset) and item.dtype.kind in "iufb":
                yield name, item.size * max(8, item.dtype.itemsize), partial(item.__getitem__, ())


def _read_parquet(path: Path, wanted: Wanted | None) -> Table:
    # Opened here, since pyarrow takes no file names that are not UTF-8.
    with whole_file(path), open(path, "rb") as raw:
        file = pyarrow.parquet.ParquetFile(raw)
        names = file.schema_arrow.names
        require_once(str(path), names)
        read = [name for name in names if wanted is None or wanted(name)]
        require_room(path, 8 * len(read) * file.metadata.num_rows, path.stat().st_size)
        load_ahead(file.metadata.num_rows)
        # The table has rows but none of the wanted columns.
        none: dict[str, Any] = {} if file.metadata.num_rows else {"": np.zeros(0)}
        return Table(path, file.read(columns=read) if read else none, names)
    raise AssertionError


def _read_text(path: Path, wanted: Wanted | None) -> Table:
    text = open_text(path)
    require_line_end(str(path), text, len(text))
    with whole_file(path):
        layout = layout_of(path, text, wanted)
        require_once(str(path), layout.names)
        body = table_rows(text, layout)
        if not bytes(body[:1000]).strip():
            return Table(path, {})
        read = [name for name in layout.names if wanted is None or wanted(name)]
        table = parsed(body, layout.names, read, layout.delimiter, layout.decimal)
        return Table(path, table, layout.names)
    raise AssertionError
