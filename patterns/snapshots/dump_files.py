"""The two dumps of a run, atoms and contacts: headers, boxes, grains, pairs and their ids."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from loops import InputError
from loops.arrays import Floats, Integers
from loops.errors import counted
from patterns.snapshots.columns import NONE, components, names_beside
from patterns.snapshots.files import Text, line_at, open_text
from patterns.snapshots.frame import (
    Frame,
    Frames,
    Listing,
    Notes,
    contacts_path,
    paired,
    require_column,
)
from patterns.snapshots.geometry import (
    Bodies,
    Contacts,
    axis_across,
    index_of,
    nearest_images,
    plane_note,
    read_contacts,
    refuse_radii,
    refuse_repeated,
    refuse_unknown,
    sample_rows,
)
from patterns.snapshots.source import Source
from patterns.snapshots.tables import Table, listed

ITEM = b"ITEM: "
START = b"ITEM: TIMESTEP"


class Box(NamedTuple):
    """Simulation box of a frame.

    `origin` (3,), `cell` (3, 3) with the edges as columns (length); `periodic` of the edges;
    `digits`, the significant ones that the header prints.
    """

    origin: Floats
    cell: Floats
    periodic: tuple[bool, ...]
    digits: int

    def plane(self, axes: list[int]) -> tuple[Floats, tuple[bool, bool]]:
        """Cell (2, 2) in the plane of two axes, and which of its edges are periodic."""
        one, two = axes
        return self.cell[np.ix_(axes, axes)], (self.periodic[one], self.periodic[two])


@dataclass(frozen=True, eq=False)
class DumpFrame(Listing):
    """Place of one frame in a dump, the kind of its rows, and its box."""

    label: str = ""
    box: Box | None = None


def is_dump(head: bytes) -> bool:
    """Whether a file with these first bytes is a text dump."""
    return head.startswith((START, b"ITEM: UNITS"))


def dump_frames(path: Path) -> list[DumpFrame | InputError]:
    """Headers of all frames of a dump; their rows are passed over, not read."""
    text, at = open_text(path), 0
    found: list[DumpFrame | InputError] = []
    seen: set[float] = set()
    while 0 <= at < len(text):
        try:
            frame = frame_at(path, text, at)
        except InputError as error:
            if text[at:].strip():
                found.append(error)
            # Skip the TIMESTEP of the damaged header, which may follow UNITS.
            if is_dump(text[at : at + len(START)]):
                at = text.find(START, at) + 1 or len(text)
            at = text.find(START, at)
            continue
        if frame.step in seen:
            raise InputError(
                str(path), f"step {frame.step} twice", "each step once", "Part the runs."
            )
        seen.add(frame.step)
        found.append(frame)
        at = frame.span[1]
    return found


def frame_at(path: Path, text: Text, at: int = 0) -> DumpFrame:
    """Read the header that starts at the byte `at`."""
    if not is_dump(text[at : at + len(START)]):
        raise InputError(str(path), f"{text[at : at + 40]!r}", START.decode(), "Give a text dump.")
    values: dict[bytes, list[bytes]] = {}
    label = b""
    while True:
        line, at = line_at(text, at)
        if not line.startswith(ITEM):
            raise _cut(path, values)
        key = line.removeprefix(ITEM)
        if label and key.split(b" ")[0] == label.split(b" ")[0]:
            break
        if key.startswith(b"NUMBER OF "):
            label = key.removeprefix(b"NUMBER OF ").strip()
        stop = text.find(ITEM, at)
        if stop < 0 or (b"TIMESTEP" in values and key.strip() == b"TIMESTEP"):
            raise _cut(path, values)
        values[key.strip()] = text[at:stop].splitlines()
        at = stop
    stop = text.find(ITEM, at)
    names = tuple(key.removeprefix(label).decode(errors="replace").split())
    try:
        step, count = (int(values[name][0]) for name in (b"TIMESTEP", b"NUMBER OF " + label))
    except (KeyError, IndexError, ValueError):
        raise _cut(path, values) from None
    if not (0 <= step < 2**63 and 0 <= count < 2**63):
        raise _cut(path, values)
    span = (at, len(text) if stop < 0 else stop)
    where = f"{path}, step {step}"
    of = label.decode(errors="replace")
    return DumpFrame(where, step, names, text, span, count, of, _box(where, values))


def _cut(path: Path, values: dict[bytes, list[bytes]]) -> InputError:
    step = b" ".join(values.get(b"TIMESTEP", [b"?"])).decode(errors="replace")
    where = f"{path}, step {step}"
    expected = "ITEM: TIMESTEP, NUMBER OF ..., BOX BOUNDS and the names of the columns"
    return InputError(where, "a header that breaks off", expected, "Dump or copy it again.")


def _box(where: str, values: dict[bytes, list[bytes]]) -> Box | None:
    found = [(key, lines) for key, lines in values.items() if key.startswith(b"BOX BOUNDS")]
    if not found:
        return None
    words = found[0][0].decode(errors="replace").split()[2:]
    fields = [line.split() for line in found[0][1][:3]]
    try:
        rows = np.array([[float(value) for value in line] for line in fields])
        if rows.shape != ((3, 4) if "abc" in words else (3, 3) if "xy" in words else (3, 2)):
            raise ValueError
        if "abc" in words:
            origin, cell = rows[:, 3], rows[:, :3].T.copy()
        else:
            low, high = rows[:, 0].copy(), rows[:, 1].copy()
            xy, xz, yz = rows[:, 2] if "xy" in words else np.zeros(3)
            # The header has the bounds of the tilted box: subtract the tilt.
            corners = (0.0, xy, xz, xy + xz)
            low -= [min(corners), min(0.0, yz), 0.0]
            high -= [max(corners), max(0.0, yz), 0.0]
            origin, cell = low, np.diag(high - low)
            cell[np.triu_indices(3, 1)] = xy, xz, yz
        if not (np.isfinite(rows).all() and np.linalg.det(cell) > 0):
            raise ValueError
    except ValueError:
        shown = [line.decode(errors="replace") for line in found[0][1][:3]]
        raise InputError(
            where, f"box {shown}", "three lines of bounds, low and high", "Dump or copy it again."
        ) from None
    # pp is periodic; f, s and m, also of one side alone, are not. Old dumps don't say.
    flags = [word for word in words if len(word) == 2 and set(word) <= set("pfsm")]
    periodic = tuple(flag == "pp" for flag in flags) if len(flags) == 3 else (False,) * 3
    mantissas = [v.lower().split(b"e")[0].lstrip(b"+-") for line in fields for v in line]
    digits = max(len(mantissa.replace(b".", b"").lstrip(b"0")) for mantissa in mantissas)
    return Box(origin, cell, periodic, digits)


# Plain names of the atoms' columns that a column map may give.
ATOM_NAMES = ("id", "x", "y", "z", "radius")
# Boxes of both dumps of a step agree to six printed digits.
BOX_TOLERANCE = 1e-5


class Atoms(NamedTuple):
    """Grains of a frame in the plane of the two `axes`, and its periodic cell (2, 2) or None.

    `z` (G,) are distances along the third axis, or None (length).
    """

    bodies: Bodies
    z: Floats | None
    axes: list[int]
    cell: Floats | None
    periodic: tuple[bool, bool]

    def contacts(self, where: str, pairs: Integers, branch: Floats | None = None) -> Contacts:
        """Contacts of pairs of grains, to the image nearest to a `branch` (C, 2), else nearest."""
        columns = dict(zip(("id1", "id2"), self.bodies.ids[pairs].T, strict=True))
        if branch is not None:
            columns |= components("branch_@", branch)
        table = Table(where, columns)
        return read_contacts(table, pairs, self.bodies, self.cell, self.periodic)

    def nearest(self, gap: Floats) -> Floats:
        """(C, 2) array: vectors `gap` (C, 2) less whole cells."""
        if self.cell is None:
            return gap
        # Vectors below half the cell's least singular value are the nearest ones.
        far = np.flatnonzero(np.hypot(*gap.T) >= 0.5 * np.linalg.norm(self.cell, -2))
        nearest = gap.copy()
        nearest[far] -= nearest_images(gap[far], self.cell, self.periodic) @ self.cell.T
        return nearest


class FoundContacts(NamedTuple):
    """Contacts and the columns of their forces on grain 2; the atoms with their cell; notes."""

    atoms: Atoms
    contacts: Contacts
    forces: Mapping[str, Floats]
    notes: Notes


# Finds the contacts of a table whose columns have no names.
FindContacts = Callable[[Table, Atoms, DumpFrame, Source], FoundContacts]


def frames_of_dumps(source: Source, find: FindContacts) -> Frames:
    """Frames of the dump of atoms with those of the contacts at the same step."""
    wanted = "a 'dump local', such as dump.contacts.0 beside dump.atoms.0"
    lacks, hint = "no dump of contacts beside it", "Name it by --contacts."
    path = contacts_path(source, names_beside(source.path, "contacts"), lacks, wanted, hint)
    atoms, contacts = dump_frames(source.path), dump_frames(path)
    _require_kind(atoms, atom=True)
    _require_kind(contacts, atom=False)
    of_atoms, of_contacts = (
        {frame.step for frame in frames if isinstance(frame, DumpFrame)}
        for frames in (atoms, contacts)
    )
    unused = sorted(of_contacts - of_atoms)
    notes: tuple[str, ...] = ()
    if unused:
        notes = (f"{counted(len(unused), 'step')} of {path} without atoms, such as {unused[0]}",)

    def read(own: DumpFrame, local: DumpFrame, notes: Notes, source: Source) -> Frame:
        _require_one_box(own, local)
        atoms, contacts, forces, said = find(local.read(), read_atoms(own, source), own, source)
        walls, of_walls = read_walls(own, atoms, source.columns)
        if walls is None and not all(atoms.periodic):
            of_walls = ("no columns of walls: their forces are missing from the stress",)
        notes = (said[0], *notes, *said[1:], *of_walls)
        if atoms.axes != [0, 1]:
            notes = (*notes, plane_note("xyz"[3 - sum(atoms.axes)]))
        bodies = atoms.bodies
        grains = components("@", bodies.x) | {"id": bodies.ids, "radius": bodies.radii}
        if atoms.z is not None:
            grains["z"] = atoms.z
        table = contacts.table
        columns = {name: table.integers(name) for name in ("id1", "id2")} | dict(forces)
        columns |= components("branch_@", contacts.d)
        periodic = (True, True) if atoms.cell is None else atoms.periodic
        own_walls = None if walls is None else Table(own.where, walls)
        tables = Table(own.where, grains), Table(local.where, columns)
        return Frame(*tables, atoms.cell, own.step, notes, walls=own_walls, periodic=periodic)

    return paired(atoms, contacts, read, path, "step", notes=notes)


def _require_one_box(atoms: DumpFrame, contacts: DumpFrame) -> None:
    one, other = atoms.box, contacts.box
    if one is None or other is None:
        return
    gap = max(np.abs(one.cell - other.cell).max(), np.abs(one.origin - other.origin).max())
    if gap > BOX_TOLERANCE * np.abs(one.cell).max():
        received = f"box {other.cell.tolist()} from {other.origin.tolist()}"
        expected = f"{one.cell.tolist()} from {one.origin.tolist()} as {atoms.where}"
        raise InputError(contacts.where, received, expected, "Take both dumps from one run.")


def _require_kind(frames: list[DumpFrame | InputError], *, atom: bool) -> None:
    for frame in frames:
        if isinstance(frame, DumpFrame) and (frame.label == "ATOMS") != atom:
            expected = "the dump of atoms" if atom else "the dump of contacts ('dump local')"
            remedy = "Give the atoms first, their contacts by --contacts."
            raise InputError(frame.where, f"a dump of {frame.label}", expected, remedy)


def read_atoms(frame: DumpFrame, source: Source) -> Atoms:
    """Grains of a frame of atoms, in the cell of the user, else in the box where it is periodic.

    Positions may be wrapped (`x`), unwrapped (`xu`) or scaled by the box (`xs`, `xsu`); a diameter
    is accepted instead of a radius.
    """
    found: dict[str, str | None] = {}
    columns = source.columns
    for name in ATOM_NAMES:
        others = ("diameter",) if name == "radius" else (f"{name}u", f"{name}s", f"{name}su")
        found[name] = next((one for one in (name, *others) if one in frame.names), None)
        if name in columns:
            require_column(name, columns[name], frame.names, frame.where)
            found[name] = columns[name]
    for name in ("id", "x", *("y" * (found["z"] is None)), "radius"):
        if found[name] is None:
            raise InputError(
                f"{frame.where}, columns {' '.join(frame.names)}",
                f"no column for the {name}",
                f"the {name} of each grain",
                f"Add {name} to the 'dump custom', or name its column: --columns {name}=COLUMN.",
            )
    own = {name: column for name, column in found.items() if column is not None}
    table = frame.read(list(own.values()))
    place = {axis: table.column(own[axis]) for axis in "xyz" if axis in own}
    if own["x"] in ("xs", "xsu"):
        if frame.box is None:
            received, remedy = "scaled positions and no box", "Dump x y instead."
            raise InputError(frame.where, received, "a box", remedy)
        shares = np.stack([place.get(axis, np.zeros(len(table))) for axis in "xyz"])
        whole = frame.box.origin[:, None] + frame.box.cell @ shares
        place = {axis: whole["xyz".index(axis)] for axis in place}
    radii = table.column(own["radius"]) * (0.5 if own["radius"] == "diameter" else 1.0)
    ids = table.integers(own["id"])
    refuse_repeated(table, ids)
    refuse_radii(table, ids, radii, "Correct the dump; leave points out of it by a group.")
    across = axis_across(place, radii, frame.where)
    axes = [k for k in range(3) if k != across]
    x = np.column_stack([place["xyz"[k]] for k in axes])
    cell, periodic = source.cell, (True, True)
    if cell is None and frame.box is None:
        periodic = (False, False)
    elif cell is None and frame.box is not None:
        cell, periodic = frame.box.plane(axes)
    periodic = source.periodic or periodic
    bodies = Bodies(ids, x, radii)
    return Atoms(bodies, place.get("xyz"[across]), axes, cell if any(periodic) else None, periodic)


Map = dict[str, str]
KNOWN = 0.5  # share of a column that must be ids of grains
# Centres of a pair are at most this many times the sum of the radii apart: pair lists may hold
# neighbours beside contacts.
PAIR_REACH = 1.5


def given_columns(table: Table, given: Mapping[str, str], names: Collection[str]) -> Map:
    """Columns of contacts in the user's map; `InputError` for one that is not in the table."""
    columns = {name: column for name, column in given.items() if name in names}
    for name, column in columns.items():
        if column != NONE:
            require_column(name, column, table.names, table.path, ", or none")
    return columns


def ids_in(table: Table, name: str, rows: Integers, atoms: Atoms) -> Integers | None:
    """Grains of some rows of a column, -1 for none, if it holds ids.

    Some unknown ids are reported as a fault later; a column of few known ids holds something else.
    """
    try:
        grains = index_of(atoms.bodies.ids, table.integers(name)[rows])
    except InputError:
        return None
    return grains if np.mean(grains >= 0) > KNOWN else None


def reach_of(atoms: Atoms, one: Integers, two: Integers) -> float:
    """Largest distance of the centres over the sum of the radii, the worst 10 % left out."""
    pairs = np.stack([one, two], axis=1)[(one >= 0) & (two >= 0)]
    if len(pairs) == 0 or (pairs[:, 0] == pairs[:, 1]).any():
        return np.inf
    return float(np.quantile(atoms.contacts("", pairs).reach, 0.9))


SIX_DIGITS = (
    "Ids of a million and more have six digits, LAMMPS's %g: dump again with dump_modify format "
    "float %.15g."
)


def _six_digits(values: Floats) -> bool:
    """Whether whole numbers of seven digits and more all end in zeros after the sixth."""
    large = values[(values >= 1e6) & (np.rint(values) == values)]
    unit = 10.0 ** (np.floor(np.log10(large)) - 5)
    return bool(len(large) and (large % unit == 0).all())


def find_ids(
    table: Table,
    atoms: Atoms,
    columns: Map,
    choices: list[tuple[str, str]],
    expected: str,
    remedy: str,
) -> Integers:
    """(C, 2) grains of the pairs; `id1`, `id2` of the choice with the nearest ones join the map."""
    rows = sample_rows(len(table))
    names = dict.fromkeys(n for pair in choices for n in pair)
    found = {n: ids_in(table, n, rows, atoms) for n in names}
    known = {n: ids for n, ids in found.items() if ids is not None}
    reach = [
        (reach_of(atoms, known[one], known[two]), (one, two))
        for one, two in choices
        if one in known and two in known
    ]
    best = min(reach, default=(np.inf, ("", "")), key=lambda item: item[0])
    coarse = any(_six_digits(table.column(n)) for n in names)
    if coarse:
        remedy += f". {SIX_DIGITS}"
    if best[0] > PAIR_REACH:
        given = ", ".join(f"{n}={columns[n]}" for n in ("id1", "id2") if n in columns)
        raise InputError(
            f"columns {listed(table.names)} of {table.path}",
            f"no ids of two grains that touch{' with ' + given if given else ''}",
            expected,
            f"Name them: --columns id1=COLUMN,id2=COLUMN{remedy}.",
        )
    columns["id1"], columns["id2"] = best[1]
    other = "Take both dumps from one step of one run, with all the atoms."
    other = SIX_DIGITS if coarse else other
    named = np.column_stack([table.integers(name) for name in best[1]])
    grains = index_of(atoms.bodies.ids, named)
    refuse_unknown(table, best[1], named, grains, other, "an id of the dump of atoms")
    return grains


# Columns of the fix: flag, force on the atom, contact point.
WALL_NAMES = ("wall_flag", "wall_fx", "wall_fy", "wall_x", "wall_y")
# Largest distance of the foot on a wall outside a grain over its radius: rounding of text.
FOOT_TOLERANCE = 1e-3


def read_walls(
    frame: DumpFrame, atoms: Atoms, columns: Mapping[str, str]
) -> tuple[dict[str, NDArray[Any]] | None, Notes]:
    """Columns of contacts with walls from the dump of atoms, and a note; None without any.

    A fix f with the columns `f_f[1]` (in contact or not), `f_f[2], f_f[3]` (force on the atom),
    `f_f[5], f_f[6]` (contact point) is a wall if its points lie within the grains.
    """
    mapped = [columns[name] for name in WALL_NAMES if name in columns]
    found = [match for name in frame.names if (match := re.fullmatch(r"(f_\w+)\[\d+\]", name))]
    places = (1, *(2 + axis for axis in atoms.axes), *(5 + axis for axis in atoms.axes))
    each = {match[1]: [f"{match[1]}[{k}]" for k in places] for match in found}
    sets = {fix: names for fix, names in each.items() if set(names) <= set(frame.names)}
    if mapped:
        if len(mapped) < len(WALL_NAMES) or not set(mapped) <= set(frame.names):
            where = f"--columns for the wall of {frame.where}"
            expected = f"columns of the dump for {', '.join(WALL_NAMES)}"
            raise InputError(where, ", ".join(mapped), expected, "Give all five.")
        sets = {"wall": mapped}
    walls, notes = [], []
    for fix, names in sets.items():
        flag, fx, fy, x, y = frame.read(names).columns(*names).T
        grains = np.flatnonzero(flag > 0)
        force = np.column_stack([fx, fy])[grains]
        branch = atoms.bodies.x[grains] - np.column_stack([x, y])[grains]
        length = np.hypot(*branch.T)
        inside = (length > 0) & (length <= (1 + FOOT_TOLERANCE) * atoms.bodies.radii[grains])
        if (flag >= 0).all() and inside.all() and np.sum(force * branch) >= 0:
            walls.append(np.column_stack([grains, force, branch]))
            notes.append(f"{fix} ({counted(len(grains), 'contact')})")
        elif mapped:
            where, remedy = f"--columns for the wall of {frame.where}", "Correct the names."
            expected = "flag, force on the atom and contact point of 'fix wall/gran ... contacts'"
            raise InputError(where, "contact points beyond their grains", expected, remedy)
    if not notes:
        return None, ()
    rows, said = np.concatenate(walls), (f"walls recognised: {', '.join(notes)}",)
    own = {"id": atoms.bodies.ids[rows[:, 0].astype(np.int64)], **components("f@", rows[:, 1:3])}
    return (own | components("branch_@", rows[:, 3:]) if len(rows) else None), said
