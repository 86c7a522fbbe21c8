"""Pairs of grains of a dump: cell, images, branches, which are contacts, and their plain tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from loops import InputError
from loops.arrays import Flags, Floats, Integers
from loops.validation import repeated_contacts
from patterns.snapshots.checks import Finding, repeated
from patterns.snapshots.dumps.dump_files import Atoms, Box
from patterns.snapshots.frame import Frame
from patterns.snapshots.listing import Listing
from patterns.snapshots.tables import Table

FAR = 1e9  # cells that a grain may have wandered; beyond it digits are lost


class Space(NamedTuple):
    """Cell (2, 2) with the vectors as columns, or None; which of them are `periodic`."""

    cell: Floats | None
    periodic: tuple[bool, bool]

    def images(self, gap: Floats) -> Integers:
        """(C, 2) array: the whole cells nearest to the vectors `gap` (C, 2)."""
        if self.cell is None:
            return np.zeros(gap.shape, dtype=np.int64)
        nearest = np.rint(gap @ np.linalg.inv(self.cell).T)
        if np.abs(nearest).max(initial=0.0) > FAR:
            received = f"centres {np.abs(nearest).max():.3g} periodic cells apart"
            remedy = "Check the cell and the positions."
            raise InputError("positions of the grains", received, f"at most {FAR:.3g}", remedy)
        return np.where(self.periodic, nearest, 0.0).astype(np.int64)

    def shift(self, images: Integers) -> Floats:
        """(C, 2) array: the vectors of whole cells (length)."""
        return np.zeros(images.shape) if self.cell is None else images @ self.cell.T


def space_of(box: Box | None, atoms: Atoms, given: Floats | None) -> tuple[Space, tuple[str, ...]]:
    """The periodic cell of a frame.

    A box that is periodic one way alone becomes a cell in which nothing crosses the other way;
    it is made as high as the grains need.
    """
    if given is not None:
        return Space(np.asarray(given, dtype=float), (True, True)), ()
    if box is None or not any(box.periodic):
        return Space(None, (False, False)), ()
    if all(box.periodic):
        return Space(box.cell, box.periodic), ()
    free = box.periodic.index(False)
    across = np.linalg.solve(box.cell, (atoms.x - box.origin).T)[free]
    reach = 2 * atoms.radii.max() * np.linalg.norm(np.linalg.inv(box.cell)[free])
    cell = box.cell.copy()
    cell[:, free] *= max(1.0, float(np.ptp(across) + reach))
    note = (
        f"periodic along {'xy'[1 - free]} alone: stress refers to the cell {cell.tolist()}, "
        "which may hold more than the packing"
    )
    return Space(cell, box.periodic), (note,)


class Pairs(NamedTuple):
    """Pairs of grains: indices `i`, `j` (C,), `images` of the second and branches `d` (C, 2)."""

    i: Integers
    j: Integers
    images: Integers
    d: Floats

    def take(self, rows: Flags | Integers) -> Pairs:
        """Some of the pairs."""
        return Pairs(self.i[rows], self.j[rows], self.images[rows], self.d[rows])


def pairs_of(
    atoms: Atoms, space: Space, i: Integers, j: Integers, branch: Floats | None = None
) -> Pairs:
    """Images and branches of pairs."""
    raw = atoms.x[j] - atoms.x[i]
    images = space.images((0.0 if branch is None else branch) - raw)
    return Pairs(i, j, images, raw + space.shift(images))


def normals(d: Floats) -> Floats:
    """(C, 2) array: unit vectors along `d` (C, 2); of coincident grains zero."""
    length = np.hypot(d[:, 0], d[:, 1])[:, None]
    return d / np.where(length > 0, length, 1.0)


def gaps(atoms: Atoms, pairs: Pairs) -> Floats:
    """(C,) array: distances of the centres less the sums of the radii (length)."""
    reach = atoms.radii[pairs.i] + atoms.radii[pairs.j]
    return np.asarray(np.hypot(pairs.d[:, 0], pairs.d[:, 1]) - reach)


def contact_rows(
    atoms: Atoms, pairs: Pairs, force: Floats | None
) -> tuple[Integers, tuple[str, ...], tuple[Finding, ...]]:
    """Rows of a list of pairs that are contacts, each once; notes and findings on the others."""
    apart = gaps(atoms, pairs) >= 0
    if force is not None:
        apart &= (force == 0).all(axis=1)
    again, first = repeated_contacts(
        np.column_stack([pairs.i, pairs.j]), pairs.images, len(atoms.ids)
    )
    again, first = again[~apart[again]], first[~apart[again]]
    once = ~apart
    once[again] = False
    rows, notes = np.flatnonzero(once), []
    if apart.any():
        notes.append(f"{np.count_nonzero(apart)} pairs without overlap and force are no contacts")
    findings: tuple[Finding, ...] = ()
    if len(again) == len(rows):
        notes.append(f"each contact in two rows: {2 * len(rows)} rows, {len(rows)} contacts")
    elif len(again):
        notes.append(f"{len(again)} contacts stand there twice and were taken once")
    if len(again):
        same = pairs.i[again] == pairs.i[first]
        off = np.zeros(1)
        if force is not None:
            gap = force[again] - np.where(same, 1, -1)[:, None] * force[first]
            off = np.hypot(*gap.T) / (float(np.hypot(*force[rows].T).mean()) or 1.0)
        twins = int(np.count_nonzero(same))
        findings = (repeated(twins, len(again) - twins, len(rows), off),)
    return rows, tuple(notes), findings


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


def frame_of(
    listings: tuple[Listing, Listing],
    atoms: Atoms,
    space: Space,
    pairs: Pairs,
    forces: Forces,
    walls: Sequence[Wall] = (),
    notes: Sequence[str] = (),
) -> Frame:
    """Plain tables of grains and of what is a contact among pairs, walls numbered below the ids."""
    rows, said, findings = contact_rows(atoms, pairs, forces.any)
    forces = Forces(*(part if part is None else part[rows] for part in forces))
    below = min(0, int(atoms.ids.min(initial=0))) - 1 - np.arange(len(walls))
    return Frame(
        Table(listings[0].where, _grains(atoms, below)),
        Table(
            listings[1].where,
            _contacts(atoms, pairs.take(rows), forces, walls, below),
        ),
        space.cell,
        float(listings[0].step),
        (*notes, *said),
        findings,
    )


def _grains(atoms: Atoms, walls: Integers) -> dict[str, NDArray[np.generic]]:
    columns = {"x": atoms.x[:, 0], "y": atoms.x[:, 1], "radius": atoms.radii}
    if atoms.z is not None:
        columns["z"] = atoms.z
    zeros, is_wall = np.zeros(len(walls)), np.arange(len(atoms.ids) + len(walls)) >= len(atoms.ids)
    grown = {name: np.append(values, zeros) for name, values in columns.items()}
    return {"id": np.append(atoms.ids, walls), "type": is_wall.astype(int), **grown}


def _contacts(
    atoms: Atoms,
    pairs: Pairs,
    forces: Forces,
    walls: Sequence[Wall],
    wall_ids: Integers,
) -> dict[str, NDArray[np.generic]]:
    """Contacts between grains, then those with walls."""
    ones = [np.full(len(wall.grains), own) for own, wall in zip(wall_ids, walls, strict=True)]
    twos = [atoms.ids[wall.grains] for wall in walls]
    d = np.concatenate([pairs.d, *[wall.branch for wall in walls]])
    columns: dict[str, NDArray[np.generic]] = {
        "id1": np.concatenate([atoms.ids[pairs.i], *ones]),
        "id2": np.concatenate([atoms.ids[pairs.j], *twos]),
    }
    columns |= {"branch_x": d[:, 0], "branch_y": d[:, 1]}
    if forces.any is not None:
        force = np.concatenate([forces.any, *[wall.force for wall in walls]])
        if forces.total is None:
            columns["fn"] = np.einsum("ck,ck->c", force, normals(d))
        else:
            columns |= {"fx_on_2": force[:, 0], "fy_on_2": force[:, 1]}
    return columns
