"""The two dumps of a run, its atoms and its contacts, frame by frame."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from loops import InputError
from patterns.snapshots.bodies import refuse_repeated
from patterns.snapshots.dumps.dump_text import Box, DumpFrame, dump_frames, read_rows
from patterns.snapshots.frame import Frame, Source
from patterns.snapshots.instants import Instants, refusal

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Frames = list[DumpFrame | InputError]
ReadPair = Callable[[Source, DumpFrame, DumpFrame, tuple[str, ...]], Frame]

ATOM_WORDS = ("atoms", "atom", "grains", "particles")
CONTACT_WORDS = ("contacts", "contact", "local", "pairs", "pair")
# Plain names of the atoms' columns that a column map may give.
ATOM_NAMES = ("id", "x", "y", "z", "radius")
# Boxes of one step agree to what six digits print.
BOX_TOLERANCE = 1e-5


class Atoms(NamedTuple):
    """Grains of a frame: `ids` (G,), `x` (G, 2), `radii` (G,), `z` (G,) or None (length)."""

    ids: Integers
    x: Floats
    radii: Floats
    z: Floats | None


def contacts_beside(path: Path) -> Path | None:
    """Path of the dump of contacts beside that of the atoms, if there is one.

    Parameters
    ----------
    path : Path
        Such as `dump.atoms.0` or `atoms.0.dump.gz`.

    Returns
    -------
    Path or None
        Such as `dump.contacts.0` or `contacts.0.dump`.
    """
    for word in ATOM_WORDS:
        if word not in path.name:
            continue
        for other in CONTACT_WORDS:
            name = path.name.replace(word, other)
            for found in (name, f"{name}.gz", name.removesuffix(".gz")):
                if path.with_name(found).is_file():
                    return path.with_name(found)
    return None


def dump_instants(source: Source, read: ReadPair) -> Instants:
    """Frames of the atoms with those of the contacts at the same step.

    Instants without contacts, as before the grains meet, are left out.

    Parameters
    ----------
    source : Source
        What the user gave.
    read : callable
        Reads one instant from `source`, its frame of atoms, that of its contacts, and notes.

    Returns
    -------
    Instants
        One a step. Reading it raises `InputError` if it is damaged or missing among the contacts.

    Raises
    ------
    InputError
        If a dump is missing, of the other kind, or without contacts at any instant.
    """
    atoms, contacts, contacts_path = _both_dumps(source)
    of_step = {frame.step: frame for frame in contacts if isinstance(frame, DumpFrame)}
    steps = {frame.step for frame in atoms if isinstance(frame, DumpFrame)}
    unused = sorted(set(of_step) - steps)
    notes: tuple[str, ...] = ()
    if unused:
        notes = (f"{len(unused)} steps of {contacts_path} have no atoms, such as {unused[0]}",)
    readers: list[Callable[[], Frame]] = []
    empty = 0
    for frame in atoms:
        if isinstance(frame, InputError):
            readers.append(refusal(frame))
        elif frame.step not in of_step:
            readers.append(refusal(_no_step(source, frame, contacts, contacts_path)))
        elif is_empty(of_step[frame.step]):
            empty += 1
        else:
            said = notes + left_out(empty)
            readers.append(partial(_read_pair, source, read, frame, of_step[frame.step], said))
    if not readers:
        raise no_contacts(contacts_path)
    return Instants(readers)


def _both_dumps(source: Source) -> tuple[Frames, Frames, Path]:
    """Headers of the atoms, of their contacts, and where those are."""
    path = source.contacts or contacts_beside(source.path)
    if path is None:
        raise InputError(
            f"contacts of {source.path}",
            "no dump of contacts beside it",
            "a 'dump local', such as dump.contacts.0 beside dump.atoms.0",
            "Name it by --contacts.",
        )
    atoms, contacts = dump_frames(source.path), dump_frames(path)
    _require_kind(atoms, atom=True)
    _require_kind(contacts, atom=False)
    return atoms, contacts, path


def _no_step(source: Source, frame: DumpFrame, contacts: Frames, path: Path) -> InputError:
    """What is wrong with contacts that lack a step: a damaged header, else the step itself."""
    damaged = [other for other in contacts if isinstance(other, InputError)]
    if damaged:
        return damaged[0]
    return InputError(
        str(path),
        f"steps {_some(sorted(f.step for f in contacts if isinstance(f, DumpFrame)))}",
        f"step {frame.step} of {source.path}",
        "Take both dumps from the same steps of one run.",
    )


def _read_pair(
    source: Source, read: ReadPair, atoms: DumpFrame, contacts: DumpFrame, notes: tuple[str, ...]
) -> Frame:
    _require_one_box(atoms, contacts)
    return read(source, atoms, contacts, notes)


def is_empty(frame: DumpFrame) -> bool:
    """Whether the frame has no rows, and says so."""
    return frame.count == 0 and frame.span[0] == frame.span[1]


def left_out(count: int) -> tuple[str, ...]:
    """Note on the instants without contacts before this one."""
    return (f"{count} earlier instants without contacts left out",) if count else ()


def no_contacts(path: Path) -> InputError:
    """Error for a file whose instants all lack contacts."""
    return InputError(str(path), "no contacts at any instant", "contacts", "Check the export.")


def _some(steps: list[int]) -> str:
    shown = ", ".join(str(step) for step in steps[:3])
    return shown if len(steps) <= 3 else f"{shown}, ..., {steps[-1]}"


def _require_kind(frames: Frames, *, atom: bool) -> None:
    for frame in frames:
        if isinstance(frame, DumpFrame) and (frame.label == "ATOMS") != atom:
            raise InputError(
                frame.where,
                f"a dump of {frame.label}",
                "the dump of atoms" if atom else "the dump of contacts ('dump local')",
                "Give the atoms first, their contacts by --contacts.",
            )


def _require_one_box(atoms: DumpFrame, contacts: DumpFrame) -> None:
    one, other = atoms.box, contacts.box
    if one is None or other is None:
        return
    size = np.abs(one.cell).max()
    gap = max(np.abs(one.cell - other.cell).max(), np.abs(one.origin - other.origin).max())
    if gap > BOX_TOLERANCE * size:
        raise InputError(
            contacts.where,
            f"box {other.cell.tolist()} from {other.origin.tolist()}",
            f"{one.cell.tolist()} from {one.origin.tolist()} as {atoms.where}",
            "Take both dumps from one run.",
        )


def read_atoms(frame: DumpFrame, columns: Mapping[str, str]) -> Atoms:
    """Grains of a frame of atoms.

    Positions may be wrapped (`x`), unwrapped (`xu`) or scaled by the box (`xs`, `xsu`); for a
    radius the diameter will do.

    Parameters
    ----------
    frame : DumpFrame
        The frame.
    columns : mapping of str to str
        Plain name to column, coming first; entries for other tables are left alone.

    Returns
    -------
    Atoms
        In the order of the dump.

    Raises
    ------
    InputError
        If a column is missing or holds anything but finite numbers.
    """
    found = {name: _find(frame, columns, name) for name in ATOM_NAMES}
    for name in ("id", "x", "y", "radius"):
        if found[name] is None:
            raise InputError(
                f"{frame.where}, columns {' '.join(frame.names)}",
                f"no column for the {name}",
                f"the {name} of each grain",
                f"Add {name} to the 'dump custom', or name its column: --columns {name}=COLUMN.",
            )
    wanted = [name for name in found.values() if name is not None]
    table = read_rows(frame, wanted)
    x = np.column_stack([table.column(str(found[name])) for name in "xy"])
    z = None if found["z"] is None else table.column(found["z"])
    if str(found["x"]) in ("xs", "xsu"):
        x = _unscaled(frame, x)
    if z is not None and str(found["z"]) in ("zs", "zsu"):
        z = z * (1.0 if frame.box is None else frame.box.height)
    radii = table.column(str(found["radius"])) * (0.5 if found["radius"] == "diameter" else 1.0)
    ids = table.integers(str(found["id"]))
    refuse_repeated(table, ids)
    if len(radii) and radii.min() <= 0:
        g = int(np.argmin(radii))
        raise InputError(
            f"radius of grain {ids[g]} in {frame.where}",
            str(radii[g]),
            "a positive length",
            "Correct the dump; leave points out of it by a group.",
        )
    return Atoms(ids, x, radii, z)


def _find(frame: DumpFrame, columns: Mapping[str, str], name: str) -> str | None:
    if name in columns:
        if columns[name] not in frame.names:
            raise InputError(
                f"--columns {name}={columns[name]}",
                f"no such column in {frame.where}",
                f"one of {' '.join(frame.names)}",
                "Correct the name.",
            )
        return columns[name]
    others = ("diameter",) if name == "radius" else (f"{name}u", f"{name}s", f"{name}su")
    return next((column for column in (name, *others) if column in frame.names), None)


def _unscaled(frame: DumpFrame, scaled: Floats) -> Floats:
    box: Box | None = frame.box
    if box is None:
        raise InputError(frame.where, "scaled positions and no box", "a box", "Dump x y instead.")
    return box.origin + scaled @ box.cell.T
