"""Files opened within bounds: not empty, not truncated, no larger than the memory."""

from __future__ import annotations

import bz2
import gzip
import lzma
import mmap
import os
import re
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import pyarrow
import pyarrow.csv
import pyarrow.parquet

from loops import InputError
from loops.errors import out_of_memory

# Content of a text file: memory-mapped, or unpacked.
Text = bytes | mmap.mmap


def _open_zstd(path: Path, mode: str) -> Any:
    return pyarrow.CompressedInputStream(open(path, mode), "zstd")


# First bytes of packed files, and what opens them.
PACKED: dict[bytes, Callable[[Path, str], Any]] = {
    b"\x1f\x8b": gzip.open,
    b"BZh": bz2.open,
    b"\xfd7zXZ": lzma.open,
    b"\x28\xb5\x2f\xfd": _open_zstd,
}
PACKED_ENDINGS = (".gz", ".bz2", ".xz", ".zst")
# Texts of 16 bits a letter: Excel's "Unicode text".
WIDE = {b"\xff\xfe": "utf-16-le", b"\xfe\xff": "utf-16-be"}
HEAD = 4096  # first bytes of a file, by which its format is recognised
# Highest accepted compression ratio, a guard against zip bombs.
PACKING = 1100
UNCOUNTED_BYTES = 1 << 24  # up to this size the ratio is not checked
SHARE = 0.5  # largest share of the machine's memory for the content of a file
# Errors of libraries on damaged files.
DAMAGED = (
    *(pyarrow.ArrowException, OSError, EOFError, zlib.error, lzma.LZMAError, zipfile.BadZipFile),
    *(ValueError, LookupError, RuntimeError, TypeError, AttributeError, ArithmeticError),
)


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
    try:
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        memory = 1 << 34
    room = int(SHARE * memory)
    if size <= min(room, max(UNCOUNTED_BYTES, PACKING * packed)):
        return
    limit = f"{PACKING} times the {packed} of the file" if size <= room else f"{room / 1e9:.3g}e9"
    expected = f"at most {limit} bytes (half of this machine's memory at most)"
    remedy = "Export the columns that are needed, or a part of the sample."
    raise InputError(str(path), f"numbers of {size / 1e9:.3g}e9 bytes", expected, remedy)


def beside(path: Path, *names: str) -> Path | None:
    """The first file of these names beside another, packed or not; None if there is none."""
    for name in names:
        for ending in ("", *PACKED_ENDINGS):
            found = path.with_name(unpacked_name(name) + ending)
            if found.is_file():
                return found
    return None


def unpacked_name(name: str) -> str:
    """Name of a file without the ending of a packed one."""
    return re.sub(rf"({'|'.join(map(re.escape, PACKED_ENDINGS))})$", "", name, flags=re.I)


@contextmanager
def whole_file(path: Path) -> Iterator[None]:
    """Turn errors of libraries on damaged files into one `InputError`; lack of memory is named."""
    try:
        yield
    except InputError:
        raise
    except MemoryError as error:
        raise MemoryError(f"out of memory while {path} was read ({error})") from None
    except DAMAGED as error:
        if out_of_memory(error):
            raise MemoryError(f"out of memory while {path} was read") from None
        where = str(path)
        received = f"an unreadable or truncated file ({str(error)[:200] or type(error).__name__})"
        raise InputError(where, received, "a complete file", "Export or copy it again.") from None


def open_text(path: Path) -> Text:
    """Bytes of a text file, packed or not, without reading more of a plain one than is used."""
    require_file(path)
    with open(path, "rb") as file:
        head = file.read(8)
        if not head.startswith((*PACKED, *WIDE)):
            return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    content = bytearray()
    with whole_file(path), opened(path) as unpacked:
        while part := unpacked.read(1 << 24):
            content += part
            require_room(path, len(content), path.stat().st_size)
        if not content:
            raise InputError(str(path), "an empty file", "a snapshot's file", "Export it again.")
        return _narrow(bytes(content))
    raise AssertionError


def opened(path: Path) -> BinaryIO:
    """A file, unpacked as its first bytes say."""
    with open(path, "rb") as file:
        head = file.read(8)
    unpack = next((unpack for start, unpack in PACKED.items() if head.startswith(start)), open)
    found: BinaryIO = unpack(path, "rb")
    return found


def _narrow(content: bytes) -> bytes:
    """Text as UTF-8; one of 16 bits a letter begins with a mark of the order of its bytes."""
    kind = WIDE.get(content[:2])
    return content if kind is None else content[2:].decode(kind).encode()


def head_of(path: Path) -> bytes:
    """First bytes of a file, at most `HEAD`, unpacked."""
    try:
        with opened(path) as file:
            head = file.read(HEAD)
    except (OSError, EOFError, zlib.error, lzma.LZMAError, pyarrow.ArrowException):
        head = path.read_bytes()[:HEAD]
    try:
        return _narrow(head)
    except UnicodeDecodeError:
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
