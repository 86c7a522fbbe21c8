"""Walls of LAMMPS: the per-atom columns of `fix wall/gran ... contacts`."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from loops import InputError
from patterns.snapshots.dumps.dump_files import Atoms
from patterns.snapshots.dumps.dump_tables import Wall
from patterns.snapshots.dumps.dump_text import DumpFrame, read_rows

Floats = NDArray[np.float64]

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

    Parameters
    ----------
    frame : DumpFrame
        Frame of atoms.
    atoms : Atoms
        Grains.
    columns : mapping of str to str
        May name the columns of one wall as `wall_flag, wall_fx, wall_fy, wall_x, wall_y`.

    Returns
    -------
    walls : tuple of Wall
        Those recognised.
    notes : tuple of str
        Which ones.

    Raises
    ------
    InputError
        If a map names some columns of a wall and not the others, or ones that hold no wall.
    """
    mapped = [columns[name] for name in WALL_NAMES if name in columns]
    sets = {fix: [f"{fix}[{k}]" for k in NUMBERS] for fix in _fixes(frame.names)}
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


def _fixes(names: tuple[str, ...]) -> list[str]:
    found: dict[str, set[str]] = {}
    for name in names:
        match = re.fullmatch(r"(f_\w+)\[(\d+)\]", name)
        if match:
            found.setdefault(match[1], set()).add(match[2])
    return [fix for fix, numbers in found.items() if numbers >= set(NUMBERS)]


def _wall(frame: DumpFrame, atoms: Atoms, names: list[str]) -> Wall | None:
    """The wall of these columns, None if they hold something else."""
    flag, fx, fy, x, y = read_rows(frame, names).columns(*names).T
    grains = np.flatnonzero(flag > 0)
    force = np.column_stack([fx, fy])[grains]
    branch = atoms.x[grains] - np.column_stack([x, y])[grains]
    length = np.hypot(*branch.T)
    inside = (length > 0) & (length <= (1 + ROUNDING) * atoms.radii[grains])
    if (flag < 0).any() or not inside.all() or np.sum(force * branch) < 0:
        return None
    return Wall(grains, force, branch)
