"""MercuryDPM: `.data` with the grains and `.fstat` with their contacts."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from loops import InputError
from patterns.snapshots.bodies import PLANE_TOLERANCE
from patterns.snapshots.dumps.dump_files import Atoms, left_out, no_contacts
from patterns.snapshots.dumps.dump_geometry import Pairs, Space, contact_rows, normals, pairs_of
from patterns.snapshots.dumps.dump_tables import Forces, Wall, contact_table, grain_table
from patterns.snapshots.frame import Frame, Source
from patterns.snapshots.instants import Instants, refusal
from patterns.snapshots.mercury.files import (
    DATA_COLUMNS,
    HEADERS,
    Block,
    data_blocks,
    data_head,
    fstat_blocks,
)
from patterns.snapshots.tables import Table

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# Times of the two files print alike; normals lie along the branches to what six digits tell.
TIME_TOLERANCE = 1e-6
NORMAL_TOLERANCE = 1e-3


def recognises(path: Path, head: bytes) -> bool:
    """Whether a file that begins so is a `.data` file: a header of numbers, then rows."""
    lines = head.split(b"\n")
    first = data_head(lines[0])
    if first is None or len(lines) < 3:
        return False
    width = len(lines[1].split())
    return width in DATA_COLUMNS and HEADERS[width] == first.width


def frames(source: Source) -> Instants:
    """Instants of a `.data` file, with the `.fstat` file beside it.

    Instants without contacts, as before the grains meet, are left out. Grains are numbered from 0
    in the order of the file, walls from -1 down. The files don't say whether the sample is
    periodic: the user's cell does. In three dimensions the packing must lie in one plane of
    constant z, or of constant y: then z is taken for y.

    Parameters
    ----------
    source : Source
        What the user gave.

    Returns
    -------
    Instants
        One per time, total forces on grain 2. Reading it raises `InputError` for a frame that is
        damaged, cut or missing in the other file, unknown grains, normals that don't lie along
        the branches.

    Raises
    ------
    InputError
        For a missing file, or one without contacts.
    """
    path = source.contacts or fstat_beside(source.path)
    blocks = fstat_blocks(path)
    readers: list[Callable[[], Frame]] = []
    start = empty = 0
    for grains in data_blocks(source.path):
        if isinstance(grains, InputError):
            readers.append(refusal(grains))
            continue
        start, block = _at_time(grains, blocks, start, path)
        if isinstance(block, InputError):
            readers.append(refusal(block))
        elif block.span[0] == block.span[1]:
            empty += 1
        else:
            readers.append(partial(_frame, source, grains, block, left_out(empty)))
    if not readers:
        raise no_contacts(path)
    return Instants(readers)


def fstat_beside(path: Path) -> Path:
    """Path of the `.fstat` file beside a `.data` file, or `InputError` if there is none."""
    name = path.name.replace(".data", ".fstat")
    for found in (name, f"{name}.gz", name.removesuffix(".gz")):
        if ".fstat" in found and path.with_name(found).is_file():
            return path.with_name(found)
    raise InputError(
        f"contacts of {path}",
        "no .fstat file beside it",
        "the contacts in a file named alike",
        "Write them (fStatFile.setFileType) or name the file by --contacts.",
    )


def _at_time(
    grains: Block, blocks: list[Block | InputError], start: int, path: Path
) -> tuple[int, Block | InputError]:
    """Contacts at the time of the grains, at `start` or later, and where to go on from.

    Earlier ones are passed over; without any, what is wrong.
    """
    passed: list[float] = []
    for k in range(start, len(blocks)):
        block = blocks[k]
        if isinstance(block, InputError):
            return start, block
        if abs(block.time - grains.time) <= TIME_TOLERANCE * max(abs(grains.time), 1e-300):
            return k + 1, block
        passed.append(block.time)
        if block.time > grains.time:
            break
    return start, InputError(
        str(path),
        f"frames at {', '.join(f'{time:g}' for time in passed[:3])}" if passed else "no frame",
        f"one at {grains.where}",
        "Write both files at the same times of one run.",
    )


def _frame(
    source: Source, grain_block: Block, contact_block: Block, said: tuple[str, ...]
) -> Frame:
    atoms, axes = _atoms(grain_block)
    space = Space(source.cell, (True, True))
    table = contact_block.read(*(name for name in contact_block.columns if name != "time"))
    i, j = table.integers("i"), table.integers("j")
    _require_known(table, atoms, i, j)
    force = _force(table, axes)
    between = np.flatnonzero(j >= 0)
    normal = -table.columns(*(f"n{a}" for a in axes))[between]
    # Normals of grains point from the second to the first, of walls from the grain to the wall.
    reach = atoms.radii[i[between]] + atoms.radii[j[between]] - table.column("delta")[between]
    pairs = pairs_of(atoms, space, i[between], j[between], reach[:, None] * normal)
    _check_normals(table, between, pairs, normal)
    rows, notes = contact_rows(atoms, pairs, -force[between])
    walls = _walls(table, atoms, axes, i, j, force)
    twice = f"each contact in two rows: {len(between)} rows, {len(rows)} contacts"
    notes = (*said, *((twice,) if len(between) == 2 * len(rows) else notes))
    if source.cell is None:
        notes = (*notes, "taken as not periodic: the files don't tell; --cell makes it so")
    if axes != "xy":
        notes = (*notes, "a packing in the plane of x and z: z was taken for y")
    if walls:
        counts = ", ".join(f"{-1 - k} ({len(w.grains)} contacts)" for k, w in enumerate(walls))
        notes = (*notes, f"walls: {counts}")
    forces = Forces(-force[between][rows])
    return Frame(
        grain_table(grain_block.where, atoms, walls),
        contact_table(
            contact_block.where,
            atoms,
            pairs.take(rows),
            forces,
            walls,
            periodic=source.cell is not None,
        ),
        source.cell,
        grain_block.time,
        notes,
    )


def _atoms(block: Block) -> tuple[Atoms, str]:
    """Grains, and the two axes of their plane."""
    flat = "z" not in block.columns
    table = block.read(*("xy" if flat else "xyz"), "radius")
    radii, ids = table.column("radius"), np.arange(len(table))
    if flat:
        return Atoms(ids, table.columns("x", "y"), radii, None), "xy"
    y, z = table.column("y"), table.column("z")
    limit = PLANE_TOLERANCE * np.abs(radii).min()
    if np.ptp(z) > limit and np.ptp(y) <= limit:
        return Atoms(ids, table.columns("x", "z"), radii, y), "xz"
    return Atoms(ids, table.columns("x", "y"), radii, z), "xy"


def _require_known(table: Table, atoms: Atoms, i: Integers, j: Integers) -> None:
    highest = np.maximum(i, j)
    row = int(np.argmax(highest))
    if highest[row] >= len(atoms.ids) or i.min() < 0:
        raise InputError(
            f"{table.path}, row {row}",
            f"grains {i[row]} and {j[row]}",
            f"grains 0 to {len(atoms.ids) - 1} of the .data file, walls negative in the second",
            "Higher numbers are ghosts of a periodic border, as old versions of MercuryDPM write: "
            "run a later version, or export plain tables.",
        )


def _force(table: Table, axes: str) -> Floats:
    """Force on the first body of each row; on a grain the opposite with walls."""
    normal, tangent = (table.columns(*(f"{v}{a}" for a in axes)) for v in "nt")
    return np.asarray(table.column("fn")[:, None] * normal + table.column("ft")[:, None] * tangent)


def _check_normals(table: Table, rows: Integers, pairs: Pairs, normal: Floats) -> None:
    d = normals(pairs.d)
    off = np.hypot(*(normal - d).T)
    if len(off) == 0 or off.max() <= NORMAL_TOLERANCE:
        return
    c = int(np.argmax(off))
    raise InputError(
        f"{table.path}, row {rows[c]} (grains {pairs.i[c]} and {pairs.j[c]})",
        f"normal {(-normal[c]).tolist()}",
        f"{(-d[c]).tolist()} from the centres, the second to the first",
        "Give --cell HXX,HXY,HYX,HYY if the sample is periodic; else take both files of one run.",
    )


def _walls(
    table: Table, atoms: Atoms, axes: str, i: Integers, j: Integers, force: Floats
) -> tuple[Wall, ...]:
    """Contacts with walls by their numbers; the normal runs into the wall, or out of it.

    MercuryDPM turns normal and tangent of walls around; which way they point is told by the
    contact point, and the force with them.
    """
    rows = np.flatnonzero(j < 0)
    if len(rows) == 0:
        return ()
    grain = i[rows]
    normal = table.columns(*(f"n{a}" for a in axes))[rows]
    point = table.columns(*(f"c{a}" for a in axes))[rows]
    inwards = np.sign(np.einsum("wk,wk->w", atoms.x[grain] - point, normal))[:, None]
    foot = (atoms.radii[grain] - table.column("delta")[rows])[:, None]
    branch, onto = foot * inwards * normal, inwards * force[rows]
    walls = []
    for number in range(-int(j.min())):
        own = j[rows] == -1 - number
        walls.append(Wall(grain[own], onto[own], branch[own]))
    return tuple(walls)
