"""LIGGGHTS: `dump custom` of the atoms with `dump local` of `compute pair/gran/local`."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from loops import InputError
from patterns.snapshots.dumps.columns import LIGGGHTS_NAMES, NONE, Contacts, read_contacts
from patterns.snapshots.dumps.dump_files import (
    ATOM_NAMES,
    Atoms,
    DumpFrame,
    contacts_beside,
    first_frame,
    frames_of_dumps,
    is_dump,
    read_atoms,
)
from patterns.snapshots.dumps.pairs import (
    Forces,
    Pairs,
    Space,
    frame_of,
    normals,
    pairs_of,
    space_of,
)
from patterns.snapshots.frame import Frame, Frames, Notes, Source, check_names
from patterns.snapshots.text import head_of

# Headers of LIGGGHTS give this many digits: the cell is known to 1e-6 of its size.
COARSE = 9
STEPS = 5  # of Newton's method for the cell; it converges in two
# Overlaps must fit the cell to this share of its size, better than the header.
FIT = 1e-7


def recognises(path: Path, head: bytes) -> bool:
    """Whether the contacts beside this dump are columns of one compute, as LIGGGHTS' are."""
    if not is_dump(head):
        return False
    contacts = contacts_beside(path)
    if contacts is None:
        return False
    try:
        names = first_frame(contacts, head_of(contacts)).names
    except InputError:
        return False
    numbered = {f"[{k + 1}]" for k in range(len(names))}
    stems = {name.rpartition("[")[0] for name in names}
    return len(names) >= 3 and len(stems) == 1 and {n[n.rfind("[") :] for n in names} == numbered


def frames(source: Source) -> Frames:
    """Frames of a dump of atoms with all columns of `compute pair/gran/local` (docs/lammps.md).

    Which hold the forces is told from the grains, or by a map of `LIGGGHTS_NAMES`. Headers have six
    digits: the cell is found from the overlaps of the contacts that cross its border.
    """
    check_names(source, (*ATOM_NAMES, *LIGGGHTS_NAMES))
    return frames_of_dumps(source, partial(_frame, source))


def _frame(source: Source, own: DumpFrame, local: DumpFrame, notes: Notes) -> Frame:
    atoms = read_atoms(own, source.columns)
    space, said = space_of(own.box, atoms, source.cell)
    contacts = read_contacts(local.read(), atoms, space, dict(source.columns))
    found = ", ".join(f"{name}={c}" for name, c in contacts.columns.items() if c != NONE)
    said = (f"columns in the order of pair/gran/local: {found}", *notes, *said)
    box = own.box
    if box is not None and box.digits < COARSE and source.cell is None and any(space.periodic):
        space, note = finer_cell(atoms, space, contacts)
        said = (*said, note)
    pairs = pairs_of(atoms, space, contacts.pairs.i, contacts.pairs.j, contacts.pairs.d)
    if not all(space.periodic):
        said = (*said, "contacts with walls are not in the dumps: their share is unknown")
    forces = Forces(None if contacts.force is None else -contacts.force)
    return frame_of((own, local), atoms, space, pairs, forces, notes=said)


def finer_cell(atoms: Atoms, space: Space, contacts: Contacts) -> tuple[Space, str]:
    """The edges of a rectangular cell from the overlaps across its border.

    Centres of a contact with images are `r1 + r2 - delta` apart: least squares for the lengths of
    the edges, by Newton's method from those of the header.
    """
    coarse = "cell from a header of six digits: branches across its border are as coarse"
    across = np.flatnonzero(contacts.pairs.images.any(axis=1))
    cell = space.cell
    if cell is None or contacts.overlap is None or len(across) == 0 or cell[0, 1] or cell[1, 0]:
        return space, f"{coarse}; give --cell or dump delta"
    pairs: Pairs = contacts.pairs.take(across)
    length = (atoms.radii[pairs.i] + atoms.radii[pairs.j]) - contacts.overlap[across]
    raw = atoms.x[pairs.j] - atoms.x[pairs.i]
    edges = np.diag(cell).copy()
    # An edge that no contact crosses stays as it is.
    crossed = pairs.images.any(axis=0)
    for _ in range(STEPS):
        d = raw + pairs.images * edges
        distance = np.hypot(*d.T)
        slope = (normals(d) * pairs.images)[:, crossed]
        edges[crossed] += np.linalg.lstsq(slope, length - distance, rcond=None)[0]
    misfit = np.abs(np.hypot(*(raw + pairs.images * edges).T) - length).max()
    change = np.abs(edges / np.diag(cell) - 1).max()
    if misfit > FIT * edges.max() or change > 1e-5:
        return space, f"{coarse}; overlaps don't fit it better ({misfit:.2g}); give --cell"
    return Space(np.diag(edges), space.periodic), (
        f"cell {edges.tolist()} from the overlaps of {len(across)} contacts across its border, "
        f"which it fits to {misfit:.1g}: the header has six digits"
    )
