"""LAMMPS: `dump custom` of the atoms with `dump local` of their contacts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from loops import InputError
from patterns.snapshots.dumps.column_guess import Guess, guess_columns
from patterns.snapshots.dumps.column_search import CONTACT_NAMES, NONE
from patterns.snapshots.dumps.dump_files import ATOM_NAMES, dump_instants, read_atoms
from patterns.snapshots.dumps.dump_geometry import contact_rows, space_of
from patterns.snapshots.dumps.dump_tables import Forces, contact_table, grain_table
from patterns.snapshots.dumps.dump_text import DumpFrame, is_dump, read_rows
from patterns.snapshots.dumps.lammps_walls import WALL_NAMES, read_walls
from patterns.snapshots.frame import Frame, Source
from patterns.snapshots.instants import Instants

Floats = NDArray[np.float64]

DAMPING = "forces of LAMMPS include damping: elastic and viscous parts can't be told apart"


def recognises(path: Path, head: bytes) -> bool:
    """Whether this is a text dump; ask LIGGGHTS first, whose dumps of atoms look alike."""
    return is_dump(head)


def frames(source: Source) -> Instants:
    """Instants of a dump of atoms, with the dump of their contacts beside it.

    Instants without contacts, as before the grains meet, are left out.

    The contacts are a `dump local` of `compute property/local patom1 patom2` and
    `compute pair/local` with as many of `dist dx dy force fx fy p1 p2 p4` as possible; its
    columns are told from the grains, and said in the notes. A map gives them by the plain names
    `id1, id2, dx, dy, dist, force, fx, fy, p1, p2, p4`; 'none' for what the dump lacks. Walls are
    the per-atom columns of `fix wall/gran ... contacts`.

    Parameters
    ----------
    source : Source
        What the user gave.

    Returns
    -------
    Instants
        One per step, total forces on grain 2. Reading it raises `InputError` for a frame that is
        damaged, cut or of another step, columns that can't be told or don't hold what the map
        says.

    Raises
    ------
    InputError
        For a missing dump or one without contacts, a name of the map that nothing reads.
    """
    check_names(source, (*ATOM_NAMES, *WALL_NAMES, *CONTACT_NAMES))
    return dump_instants(source, _frame)


def check_names(source: Source, known: tuple[str, ...]) -> None:
    """Raise `InputError` for plain names in the map that this format has not."""
    unknown = [name for name in source.columns if name not in known]
    if unknown:
        raise InputError(
            f"--columns {unknown[0]}={source.columns[unknown[0]]}",
            f"the name {unknown[0]!r}",
            f"one of {', '.join(known)}",
            "Name the columns by these.",
        )


def _frame(
    source: Source, atom_frame: DumpFrame, contact_frame: DumpFrame, notes: tuple[str, ...]
) -> Frame:
    atoms = read_atoms(atom_frame, source.columns)
    space, cell_notes = space_of(atom_frame.box, atoms, source.cell)
    table = read_rows(contact_frame, contact_frame.names)
    guess = guess_columns(table, atoms, space, source.columns)
    forces, force_notes = _forces(guess)
    rows, row_notes = contact_rows(atoms, guess.pairs, forces.any)
    pairs = guess.pairs.take(rows)
    forces = Forces(*(part if part is None else part[rows] for part in forces))
    walls, wall_notes = read_walls(atom_frame, atoms, source.columns)
    if not walls and not all(space.periodic):
        wall_notes = ("no columns of walls: their forces are unknown",)
    said = _columns_note(source, guess)
    return Frame(
        grain_table(atom_frame.where, atoms, walls),
        contact_table(
            contact_frame.where, atoms, pairs, forces, walls, periodic=space.cell is not None
        ),
        space.cell,
        float(atom_frame.step),
        (said, *notes, *cell_notes, *force_notes, *row_notes, *wall_notes),
    )


def _columns_note(source: Source, guess: Guess) -> str:
    found = [(name, guess.columns[name]) for name in CONTACT_NAMES if name in guess.columns]
    shown = ", ".join(f"{name}={column}" for name, column in found if column != NONE)
    if all(name in source.columns or name == column for name, column in found):
        return f"columns: {shown}"
    return f"columns guessed: {shown}; give --columns to overrule"


def _forces(guess: Guess) -> tuple[Forces, tuple[str, ...]]:
    """Forces on grain 2, the opposite of what LAMMPS gives for atom 1."""
    if guess.normal is None:
        return Forces(None), ()
    if guess.shear is None:
        missing = "no tangential force (p1, p2) among the columns; --mu 0 for frictionless grains"
        return Forces(None, -guess.normal), (DAMPING, missing)
    return Forces(-(guess.normal + guess.shear)), (DAMPING,)
