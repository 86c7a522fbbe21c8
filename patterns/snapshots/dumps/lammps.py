"""LAMMPS: `dump custom` of the atoms, perhaps with walls, and `dump local` of their contacts."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np

from loops import InputError
from patterns.snapshots.dumps.columns import CONTACT_NAMES, NONE, Guess, guess_columns
from patterns.snapshots.dumps.dump_files import (
    ATOM_NAMES,
    Atoms,
    DumpFrame,
    frames_of_dumps,
    is_dump,
    read_atoms,
)
from patterns.snapshots.dumps.pairs import Forces, Wall, frame_of, space_of
from patterns.snapshots.frame import Frame, Frames, Notes, Source, check_names

DAMPING = "forces of LAMMPS include damping: elastic and viscous parts can't be told apart"


def recognises(path: Path, head: bytes) -> bool:
    """Whether this is a text dump; ask LIGGGHTS first, whose dumps of atoms look alike."""
    return is_dump(head)


def frames(source: Source) -> Frames:
    """Frames of a dump of atoms with the dump of their contacts, as docs/lammps.md has them.

    Columns of contacts are told from the grains, or by a map of `CONTACT_NAMES`; walls are the
    per-atom columns of `fix wall/gran ... contacts`.
    """
    check_names(source, (*ATOM_NAMES, *WALL_NAMES, *CONTACT_NAMES))
    return frames_of_dumps(source, partial(_frame, source))


def _frame(source: Source, own: DumpFrame, local: DumpFrame, notes: Notes) -> Frame:
    atoms = read_atoms(own, source.columns)
    space, cell_notes = space_of(own.box, atoms, source.cell)
    guess = guess_columns(local.read(), atoms, space, source.columns)
    forces, force_notes = _forces(guess)
    walls, wall_notes = read_walls(own, atoms, source.columns)
    if not walls and not all(space.periodic):
        wall_notes = ("no columns of walls: their forces are unknown",)
    found = [(name, guess.columns[name]) for name in CONTACT_NAMES if name in guess.columns]
    columns = ", ".join(f"{name}={column}" for name, column in found if column != NONE)
    given = all(name in source.columns or name == column for name, column in found)
    told = f"columns{'' if given else ' guessed'}: {columns}"
    told += "" if given else "; give --columns to overrule"
    said = (told, *notes, *cell_notes, *force_notes, *wall_notes)
    return frame_of((own, local), atoms, space, guess.pairs, forces, walls, said)


def _forces(guess: Guess) -> tuple[Forces, tuple[str, ...]]:
    """Forces on grain 2, the opposite of what LAMMPS gives for atom 1."""
    if guess.normal is None:
        return Forces(None), ()
    if guess.shear is None:
        missing = "no tangential force (p1, p2) among the columns; --mu 0 for frictionless grains"
        return Forces(None, -guess.normal), (DAMPING, missing)
    return Forces(-(guess.normal + guess.shear)), (DAMPING,)


# Columns of the fix: flag, force on the atom, contact point.
WALL_NAMES = ("wall_flag", "wall_fx", "wall_fy", "wall_x", "wall_y")
NUMBERS = ("1", "2", "3", "5", "6")
# A foot lies within the radius of its grain, up to what text rounds.
ROUNDING = 1e-3


def read_walls(
    frame: DumpFrame, atoms: Atoms, columns: Mapping[str, str]
) -> tuple[tuple[Wall, ...], tuple[str, ...]]:
    """Contacts with walls from the dump of atoms.

    A fix f with the columns `f_f[1]` (in contact or not), `f_f[2], f_f[3]` (force on the atom),
    `f_f[5], f_f[6]` (contact point) is a wall if its points lie within the grains.
    """
    mapped = [columns[name] for name in WALL_NAMES if name in columns]
    found = [match for name in frame.names if (match := re.fullmatch(r"(f_\w+)\[\d+\]", name))]
    each = {match[1]: [f"{match[1]}[{k}]" for k in NUMBERS] for match in found}
    sets = {fix: names for fix, names in each.items() if set(names) <= set(frame.names)}
    if mapped:
        if len(mapped) < len(WALL_NAMES) or not set(mapped) <= set(frame.names):
            raise InputError(
                f"--columns for the wall of {frame.where}",
                ", ".join(mapped),
                f"columns of the dump for {', '.join(WALL_NAMES)}",
                "Give all five.",
            )
        sets = {"wall": mapped}
    walls, notes = [], []
    for fix, names in sets.items():
        wall = _wall(frame, atoms, names)
        if wall is not None:
            walls.append(wall)
            notes.append(f"{fix} ({len(wall.grains)} contacts)")
        elif mapped:
            raise InputError(
                f"--columns for the wall of {frame.where}",
                "contact points beyond their grains",
                "flag, force on the atom and contact point of 'fix wall/gran ... contacts'",
                "Correct the names.",
            )
    if not notes:
        return (), ()
    return tuple(walls), (f"walls recognised: {', '.join(notes)}",)


def _wall(frame: DumpFrame, atoms: Atoms, names: list[str]) -> Wall | None:
    """The wall of these columns, None if they hold something else."""
    flag, fx, fy, x, y = frame.read(names).columns(*names).T
    grains = np.flatnonzero(flag > 0)
    force = np.column_stack([fx, fy])[grains]
    branch = atoms.x[grains] - np.column_stack([x, y])[grains]
    length = np.hypot(*branch.T)
    inside = (length > 0) & (length <= (1 + ROUNDING) * atoms.radii[grains])
    if (flag < 0).any() or not inside.all() or np.sum(force * branch) < 0:
        return None
    return Wall(grains, force, branch)
