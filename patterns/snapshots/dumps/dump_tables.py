"""Plain tables of a frame of dumps: grains, contacts between them and with walls."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from patterns.snapshots.dumps.dump_files import Atoms
from patterns.snapshots.dumps.dump_geometry import Pairs, normals
from patterns.snapshots.tables import Table

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class Forces(NamedTuple):
    """Forces on the second grain of each pair, (C, 2) or None; `normal` is the part along n."""

    total: Floats | None
    normal: Floats | None = None

    @property
    def any(self) -> Floats | None:
        """What there is."""
        return self.normal if self.total is None else self.total


class Wall(NamedTuple):
    """Contacts of one wall: indices of the `grains` (W,), forces on them and branches (W, 2).

    Branches go from the foot on the wall to the centre (length).
    """

    grains: Integers
    force: Floats
    branch: Floats


def grain_table(where: str, atoms: Atoms, walls: Sequence[Wall] = ()) -> Table:
    """Grains, and a row for each wall; walls are numbered from below the ids down.

    Parameters
    ----------
    where : str
        The place, for messages.
    atoms : Atoms
        Grains.
    walls : sequence of Wall
        Walls.

    Returns
    -------
    Table
        `id, type, x, y, radius` and `z` where the dump has it.
    """
    count = len(walls)
    zeros = np.zeros(count)
    columns = {
        "id": np.append(atoms.ids, wall_ids(atoms, count)),
        "type": np.append(np.zeros(len(atoms.ids), dtype=np.int64), np.ones(count, dtype=int)),
        "x": np.append(atoms.x[:, 0], zeros),
        "y": np.append(atoms.x[:, 1], zeros),
        "radius": np.append(atoms.radii, zeros),
    }
    if atoms.z is not None:
        columns["z"] = np.append(atoms.z, zeros)
    return Table(where, columns)


def wall_ids(atoms: Atoms, count: int) -> Integers:
    """(count,) array: ids for walls that the code does not number."""
    return min(0, int(atoms.ids.min(initial=0))) - 1 - np.arange(count)


def contact_table(
    where: str,
    atoms: Atoms,
    pairs: Pairs,
    forces: Forces,
    walls: Sequence[Wall] = (),
    *,
    periodic: bool = False,
) -> Table:
    """Contacts between grains, then those with walls.

    Parameters
    ----------
    where : str
        The place, for messages.
    atoms : Atoms
        Grains.
    pairs : Pairs
        Contacts between grains.
    forces : Forces
        Forces on their second grains; a normal force alone becomes `fn`.
    walls : sequence of Wall
        Walls.
    periodic : bool
        Whether there are images to give.

    Returns
    -------
    Table
        `id1, id2, branch_x, branch_y, nx, ny`, images and forces as far as they are there.
    """
    ids = wall_ids(atoms, len(walls))
    ones = [np.full(len(wall.grains), own) for own, wall in zip(ids, walls, strict=True)]
    d = np.concatenate([pairs.d, *[wall.branch for wall in walls]])
    n = normals(d)
    columns: dict[str, NDArray[np.generic]] = {
        "id1": np.concatenate([atoms.ids[pairs.i], *ones]),
        "id2": np.concatenate([atoms.ids[pairs.j], *[atoms.ids[wall.grains] for wall in walls]]),
        "branch_x": d[:, 0],
        "branch_y": d[:, 1],
        "nx": n[:, 0],
        "ny": n[:, 1],
    }
    if periodic:
        images = np.concatenate([pairs.images, np.zeros((len(d) - len(pairs.i), 2), dtype=int)])
        columns |= {"cell_dx": images[:, 0], "cell_dy": images[:, 1]}
    if forces.total is not None:
        total = np.concatenate([forces.total, *[wall.force for wall in walls]])
        columns |= {"fx_on_2": total[:, 0], "fy_on_2": total[:, 1]}
    elif forces.normal is not None:
        normal = np.concatenate([forces.normal, *[wall.force for wall in walls]])
        columns["fn"] = np.einsum("ck,ck->c", normal, n)
    return Table(where, columns)
