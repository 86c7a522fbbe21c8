"""Yade's `export.text` and `export.textExt`: recognised, and refused."""

from __future__ import annotations

from pathlib import Path

from loops import InputError
from patterns.snapshots.frame import Frames, Source

START = b"#format "


def recognises(path: Path, head: bytes) -> bool:
    """Whether this is a list of spheres by `export.text` or `export.textExt`."""
    return head.startswith(START)


def frames(source: Source) -> Frames:
    """Refuse: these files have no contacts, and six digits are too few to find them."""
    raise InputError(
        str(source.path),
        "spheres without contacts (export.text)",
        "contacts and their forces",
        "Contacts can't be found again: six digits of the centres are too coarse for overlaps. "
        "Export tables from inside Yade instead, see docs/yade.md.",
    )
