"""Result folders, written whole or not at all; their files, and the meaning of columns and keys."""

from __future__ import annotations

import errno
import json
import os
import shutil
import time
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from fnmatch import fnmatchcase
from functools import cache
from glob import escape
from hashlib import blake2b
from pathlib import Path
from typing import Any, BinaryIO
from uuid import uuid4

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from numpy.typing import NDArray

from loops import InputError
from loops.arrays import Floats
from loops.errors import path_of
from stability.spectra import COMPONENTS
from studies import __version__

try:
    import fcntl
except ImportError:  # Windows has no such locks: two runs at once are not told apart there
    fcntl = None  # type: ignore[assignment]

SIGNS = "forces, stresses and strains positive in compression; angles counter-clockwise"
SUMMARY = "summary.json"
# Readers of a folder of Parquet files skip names that begin with a dot.
UNFINISHED = ".unfinished"
# File that describes a series in its folder.
SERIES = "series.json"
# Folders of its parts.
DATASETS = ("loops", "increments", "packing", "fates")
# Seconds in which a folder beside the results may belong to a run that has just started.
JUST_MADE = 2.0
PACKAGES = ("loops", "patterns", "stability", "studies")
# A table on its way from the kernels to a file: arrays by column. Tables in which rows are
# selected, grouped or joined are pandas data frames, which take .2 s to load.
Columns = dict[str, NDArray[Any]]
# A study's summary: plain values by the keys of summary.json, which `definitions` explains.
Summary = dict[str, Any]
# One row of a table, by the names of its columns.
Row = dict[str, Any]
# Commands whose columns are described; tables of other commands share names, not meanings.
DESCRIBED_COMMANDS = (
    *("snapshot", "series", "probe", "sustain", "evolve", "forecast"),
    *("diamond", "polygon", "domain", "material"),
)


def components(name: str, values: Floats) -> Columns:
    """Columns `name11`, `name12`, `name21`, `name22` of (n, 2, 2) tensors."""
    return {
        f"{name}{ij}": part for ij, part in zip(COMPONENTS, values.reshape(-1, 4).T, strict=True)
    }


def values_of(owner: object, *names: str) -> dict[str, Any]:
    """Attributes by name."""
    return {name: getattr(owner, name) for name in names}


def provenance(
    command: str, configuration: Mapping[str, Any], units: str | None = None
) -> dict[str, Any]:
    """Command, configuration, version and conventions of a result, as plain values.

    Units left out are those of the command in `definitions.toml`.
    """
    return {
        "command": f"grainloops {command}",
        "configuration": dict(configuration),
        "version": __version__,
        "units": definitions("units")[command.split()[0]] if units is None else units,
        "signs": SIGNS,
    }


@cache
def code_version() -> str:
    """Version and a digest of all sources, which changes with every change of the code."""
    root, digest = Path(__file__).resolve().parents[1], blake2b(digest_size=6)
    for file in sorted(file for room in PACKAGES for file in (root / room).rglob("*.py")):
        digest.update(file.relative_to(root).as_posix().encode() + b"\0" + file.read_bytes())
    return f"{__version__} (code {digest.hexdigest()})"


@contextmanager
def result_folder(out: Path, *, force: bool) -> Iterator[Path]:
    """Folder beside `out` to write into; it replaces `out` when everything has been written.

    With `force` the results of an earlier run in `out`, of any command, are removed; other files
    stay. If two runs write to one place, the one that ends first keeps it.
    """
    require_folder(out, force=force)
    with errors_of(out):
        out = out.resolve()
        out.parent.mkdir(parents=True, exist_ok=True)
        # Nobody holds the lock of a folder that a killed run left beside `out`.
        for left in out.parent.glob(f".{escape(out.name)}-{'[0-9a-f]' * 8}"):
            with suppress(InputError, OSError), folder_lock(left) as locked:
                # A run that has just started has not locked its folder yet.
                if locked and time.time() - left.stat().st_mtime > JUST_MADE:
                    shutil.rmtree(left, ignore_errors=True)
        partial = out.parent / f".{out.name}-{uuid4().hex[:8]}"
    try:
        with errors_of(out):
            # From here on an interruption leaves a folder to remove.
            partial.mkdir()
            with folder_lock(partial):
                yield partial
                list_files(partial)
                _put_in_place(partial, out, force=force)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


@contextmanager
def folder_within(out: Path) -> Iterator[Path]:
    """Folder within `out` to write into; its files move to `out` when all have been written."""
    partial = out / UNFINISHED
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir()
    try:
        yield partial
        list_files(partial)
        move_files(partial, out)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


@contextmanager
def folder_for_files(folder: str | os.PathLike[str]) -> Iterator[Path]:
    """Folder to write files into that join what is in `folder`, which is made if it is not there.

    Nothing is left behind by an error; `InputError` for a file in its place.
    """
    out = path_of("folder", folder, "Name a folder.")
    require_folder(out, force=True)
    fresh = not out.exists()
    try:
        with errors_of(out):
            out.mkdir(parents=True, exist_ok=True)
            with folder_within(out) as partial:
                yield partial
    except BaseException:
        if fresh and out.is_dir() and not any(out.iterdir()):
            out.rmdir()
        raise


def list_files(folder: Path) -> None:
    """Add the names of the other files to the summary: `--force` removes these."""
    if (folder / SUMMARY).is_file():
        summary = json.loads((folder / SUMMARY).read_text())
        files = sorted(file.name for file in folder.iterdir() if file.name != SUMMARY)
        write_summary(folder, summary | {"files": files})


def require_folder(out: Path, *, force: bool) -> None:
    """Refuse a file, and without `force` a folder that holds anything."""
    if out.exists() and not out.is_dir():
        raise InputError(f"--out {out}", "a file", "a folder", "Name another place.")
    if (name := readable(out.absolute())) != str(out.absolute()):
        # Parquet files can't be written to such a path.
        raise InputError(f"--out {name}", "bytes that are no text", "UTF-8", "Name another place.")
    if not force and out.is_dir() and any(out.iterdir()):
        remedy = "Name another place, or give --force to replace the results in it."
        received = "a folder that holds files"
        raise InputError(f"--out {out}", received, "a new or empty folder", remedy)


@contextmanager
def errors_of(out: Path) -> Iterator[None]:
    """Turn errors of writing into an `InputError`; errors of reading are such errors already."""
    try:
        yield
    except FileNotFoundError as error:
        said = f"no {error.filename or error}: removed while the run went on"
        remedy = "Give the same command again."
        raise InputError(f"--out {out}", said, "a folder that stays", remedy) from None
    except OSError as error:
        if error.errno == errno.ENOMEM:
            raise MemoryError("out of memory") from None
        said, remedy = error.strerror or str(error), "Make room, or name another place."
        raise InputError(f"--out {out}", said, "a place to write", remedy) from None


@contextmanager
def folder_lock(folder: Path) -> Iterator[bool]:
    """Lock a folder until the block or the process ends; False if the system has no locks.

    Raises `InputError` if another run holds the lock.
    """
    file = os.open(folder, os.O_RDONLY) if fcntl is not None else None
    try:
        try:
            if file is not None:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            locked = file is not None
        except BlockingIOError:
            received, remedy = "a folder that another run writes to", "Wait, or name another place."
            raise InputError(f"--out {folder}", received, "a free one", remedy) from None
        except OSError:  # a file system without locks
            locked = False
        yield locked
    finally:
        if file is not None:
            os.close(file)


def _put_in_place(partial: Path, out: Path, *, force: bool) -> None:
    if not out.exists():
        try:
            partial.rename(out)
            return
        except OSError as error:  # in the meantime another run has ended
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                raise
    with folder_lock(out):
        if force:
            remove_results(out)
        elif any(out.iterdir()):
            raise InputError(
                f"--out {out}",
                "the results of another run, which ended first",
                "a new or empty folder",
                "Name another place, or give --force to replace them.",
            )
        move_files(partial, out)


def move_files(partial: Path, out: Path) -> None:
    """Move every file of a folder to another one, the summary last."""
    for file in sorted(partial.iterdir(), key=lambda file: (file.name == SUMMARY, file.name)):
        os.replace(file, out / file.name)


def remove_results(out: Path) -> None:
    """Remove the results of any command in a folder, the parts of a series included."""
    remove_listed(out)
    if (out / SERIES).is_file():
        (out / SERIES).unlink()
        for dataset in DATASETS:
            for part in (out / dataset).glob("part-*.parquet"):
                part.unlink()
            with suppress(OSError):
                (out / dataset).rmdir()


def remove_listed(out: Path) -> None:
    """Remove the summary of a folder and the files that it lists."""
    try:
        files = json.loads((out / SUMMARY).read_text())["files"]
    except (OSError, ValueError, KeyError, TypeError):
        files = []
    for name in (*files, SUMMARY):
        path = out / str(name)
        if path.parent == out and path.is_file():
            path.unlink()


def write_whole(file: Path, write: Callable[[BinaryIO], Any]) -> None:
    """Write a file under another name, then rename it: it is there whole or not at all."""
    file.parent.mkdir(parents=True, exist_ok=True)
    # Two workers may write the same part if one of them was believed lost.
    partial = file.with_name(f"{UNFINISHED}-{uuid4().hex}")
    try:
        with open(partial, "wb") as stream:
            write(stream)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(partial, file)
    finally:
        partial.unlink(missing_ok=True)


def write_summary(folder: Path, summary: Mapping[str, Any]) -> None:
    """Write `summary.json` with sorted plain keys; numbers that are not finite become null."""
    (folder / SUMMARY).write_text(as_json(summary) + "\n")


def as_json(summary: Mapping[str, Any]) -> str:
    """Strict JSON with sorted keys; arrays become lists, numbers that are not finite null.

    >>> as_json({"b": np.array([1.0, np.nan]), "a": np.int64(3)}).split()
    ['{', '"a":', '3,', '"b":', '[', '1.0,', 'null', ']', '}']
    """
    return json.dumps(_plain(summary), indent=2, sort_keys=True, allow_nan=False)


def readable(name: str | Path) -> str:
    """Name of a file as text, also if its bytes are no UTF-8."""
    return str(name).encode("utf-8", "backslashreplace").decode()


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float):  # the sum takes the sign off a zero
        return value + 0.0 if np.isfinite(value) else None
    if isinstance(value, Path):
        return readable(value)
    return value


def write_table(
    folder: Path, name: str, columns: Mapping[str, Any], source: Mapping[str, Any], *, csv: bool
) -> None:
    """Write a table as Parquet, its provenance in the metadata, and as CSV on request.

    Lists are joined by blanks in the CSV.
    """
    arrays = {key: as_arrow(value) for key, value in columns.items()}
    command = source.get("command", "").removeprefix("grainloops ").split(" ")[0]
    about = {b"grainloops": as_json(source).encode()}
    table = described_table(f"{command}/{name}", arrays, about)
    # Measured values hardly repeat: a dictionary of them only costs time.
    repeating = [field.name for field in table.schema if not pa.types.is_floating(field.type)]
    pyarrow.parquet.write_table(table, folder / f"{name}.parquet", use_dictionary=repeating)
    if csv:
        flat_frame(table).to_csv(folder / f"{name}.csv", index=False)


def flat_frame(table: pa.Table) -> Any:
    """A table as a data frame, its lists joined by blanks."""
    frame = table.to_pandas()
    for field in table.schema:
        if pa.types.is_large_list(field.type) or pa.types.is_list(field.type):
            frame[field.name] = [" ".join(map(str, row)) for row in frame[field.name]]
    return frame


def described_table(
    place: str, arrays: Mapping[str, Any], metadata: Mapping[bytes, bytes]
) -> pa.Table:
    """Arrow table whose fields hold unit and meaning; `place` is `command/table`."""
    fields = [
        pa.field(key, array.type, metadata=field_metadata(place, key))
        for key, array in arrays.items()
    ]
    return pa.table(list(arrays.values()), schema=pa.schema(fields, metadata=metadata))


def as_arrow(values: Any) -> Any:
    """Column of a table; arrays keep their memory, which loads no pandas."""
    if isinstance(values, (pa.Array, pa.ChunkedArray)):
        return values
    if hasattr(values, "to_numpy"):  # a column of a data frame
        if hasattr(values.dtype, "pyarrow_dtype"):
            return values.array.__arrow_array__()
        values = values.to_numpy()
    if isinstance(values, list) and values:
        kinds = {type(value) for value in values}
        if kinds in ({int}, {str}) or kinds <= {float, np.float64}:
            values = np.array(values)
    if isinstance(values, np.ndarray) and values.ndim == 2:  # a list in each row
        starts = np.arange(len(values) + 1, dtype=np.int32) * values.shape[1]
        return pa.ListArray.from_arrays(as_arrow(starts), as_arrow(values.ravel()))
    if not isinstance(values, np.ndarray) or values.ndim != 1 or values.dtype.kind not in "fibU":
        return pa.array(values)
    parts = [np.ascontiguousarray(values)]
    kind = pa.from_numpy_dtype(values.dtype)
    if kind == pa.bool_():
        parts = [np.packbits(values, bitorder="little")]
    elif kind == pa.string():
        words = [word.encode() for word in values.tolist()]
        ends = np.cumsum([0, *map(len, words)], dtype=np.int32)
        parts = [ends, np.frombuffer(b"".join(words), dtype=np.uint8)]
    return pa.Array.from_buffers(kind, len(values), [None, *map(pa.py_buffer, parts)])


@cache
def words(name: str) -> dict[str, dict[str, Any]]:
    """Parts of columns.toml, definitions.toml, captions.toml or lines.toml."""
    return tomllib.loads((Path(__file__).parent / f"{name}.toml").read_text(encoding="utf-8"))


def definitions(*parts: str) -> dict[str, str]:
    """Meaning of the keys of a summary with these parts."""
    return {key: said for part in parts for key, said in words("definitions")[part].items()}


@cache
def described(place: str, column: str) -> tuple[str, str] | None:
    """Unit and meaning of a column of `command/table`; None if it has no description."""
    command, _, table = place.partition("/")
    if command not in DESCRIBED_COMMANDS:
        return None
    known, patterns = _column_words()
    for name in (f"{command}:{column}", f"{table}:{column}", column):
        if name in known:
            return known[name]
        for pattern in patterns:
            if (":" in pattern) == (":" in name) and fnmatchcase(name, pattern):
                return known[pattern]
    return None


@cache
def _column_words() -> tuple[dict[str, tuple[str, str]], list[str]]:
    """Unit and meaning by the name of a column, and which names are patterns."""
    parts = words("columns").values()
    known = {name: (unit, said) for part in parts for name, (unit, said) in part.items()}
    return known, [name for name in known if {*"*?["} & {*name}]


def field_metadata(place: str, column: str) -> dict[bytes, bytes] | None:
    """Unit and meaning of a column as metadata of a Parquet field."""
    said = described(place, column)
    return None if said is None else {b"unit": said[0].encode(), b"meaning": said[1].encode()}
