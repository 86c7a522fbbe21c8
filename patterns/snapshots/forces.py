"""Forces of the contacts of a snapshot from the columns that a file has, and which are contacts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from loops import InputError
from loops.arrays import Flags, Floats, Integers, median
from loops.validation import repeated_contacts
from patterns.snapshots.checked import ROUNDINGS
from patterns.snapshots.checks import ALONG, repeated, same_force
from patterns.snapshots.findings import Finding, rounding
from patterns.snapshots.geometry import Bodies, ContactBranches, some
from patterns.snapshots.laws import frictionless
from patterns.snapshots.source import COHESIVE, Source
from patterns.snapshots.tables import Table, require_columns

# Shear forces that are all below this share of the mean normal force are rounding; without friction
# those that digits of a text leave.
NO_SHEAR = 1e-9
NO_SHEAR_OF_TEXT = 1e-4
# Columns whose vectors act on one of the two grains, as one of these codes has it.
OF_EITHER = (("fnx", "fny"), ("fx", "fy"))
# Without forces a list whose gaps are as large as its overlaps is one of measured centres: from
# this share of pairs on that are apart, by gaps of so many overlaps (medians) at most.
MEASURED = 0.2
AS_LARGE = 3.0
# This many times as many gaps across the border of a cell as elsewhere show that it is wrong.
MORE_ACROSS = 5.0


class Forces(NamedTuple):
    """Forces of a table: `total` (rows, 2) on the second body of all rows, None if a part lacks.

    `normal` and `shear` (C,) are those of the contacts between grains; without a total force
    `normal` is what the file has, else zeros. `notes` name assumptions.
    """

    total: Floats | None
    normal: Floats
    shear: Floats
    notes: list[str]

    @property
    def known(self) -> bool:
        """Whether some contact carries a force."""
        return bool(self.normal.any() or self.shear.any())


def read_forces(
    table: Table,
    rows: Integers,
    every: Integers,
    bodies: Bodies,
    n: Floats,
    source: Source,
) -> Forces:
    """Forces of all rows; `n` (C, 2) are the normals of the chosen ones, `every` the pairs of all.

    A code's shear vector may lean out of the tangent by its own rounding (1e-9 of the force in
    Yade's): the total force keeps that share in `N`. A force of which the file does not say on
    which grain it acts is taken on the second one if it pushes then, else on the first.
    """
    smooth, notes = frictionless(table, source.mu), list[str]()
    force = table.optional("fx_on_2", "fy_on_2")
    vectors = table.optional("fsx", "fsy") if force is None else None
    if vectors is not None and not any(table.has(*names) for names in OF_EITHER):
        require_columns((table, ("fn",)))
    if force is None and table.has("fn") and (vectors is not None or table.has("ft") or smooth):
        normals = _normals(table, rows, every, bodies, n)
        force = table.column("fn")[:, None] * normals
        if vectors is not None:
            force = force + vectors
        elif table.has("ft"):
            turned = np.stack([-normals[:, 1], normals[:, 0]], axis=1)
            force = force + table.column("ft")[:, None] * turned
    if force is None and smooth and table.has("force") and not table.has("fn"):
        force = table.column("force")[:, None] * _normals(table, rows, every, bodies, n)
        notes.append("column 'force' taken as the normal force: there is no friction")
    if force is None and (found := _of_either(table, smooth)):
        names, force = found
        f = some(force, rows)
        along = np.einsum("ck,ck->c", f, n)
        share = float(np.mean(along / np.where(f.any(axis=1), np.hypot(*f.T), 1.0)))
        if source.law in COHESIVE or abs(share) < ALONG:
            remedy = "Name it: --columns fx_on_2=COLUMN,fy_on_2=COLUMN, of the force on grain 2."
            received = f"forces that push by {share:.3g} of their size (mean)"
            where = f"columns {names} of {table.path}"
            raise InputError(where, received, "to tell the grain that they act on", remedy)
        force = force if share > 0 else -force
        notes.append(f"columns {names} taken as forces on grain {1 + (share > 0)}: they push it")
    normal, shear = np.zeros(len(rows)), np.zeros(len(rows))
    if force is not None:
        f = some(force, rows)
        normal = np.einsum("ck,ck->c", f, n)
        shear = n[:, 0] * f[:, 1] - n[:, 1] * f[:, 0]
        none = NO_SHEAR_OF_TEXT if smooth else NO_SHEAR
        if np.abs(shear).max() <= none * float(np.abs(normal).mean()):
            shear = np.zeros(len(rows))
    elif table.has("fn"):
        normal = some(table.column("fn"), rows)
    return Forces(force, normal, shear, notes)


def _of_either(table: Table, smooth: bool) -> tuple[str, Floats] | None:
    """The force as a vector on one of the two grains, of two parts or whole, and its columns."""
    normal, whole = (table.optional(*names) for names in OF_EITHER)
    if normal is not None:
        shear = table.optional("ftx", "fty")
        if shear is not None:
            return "fnx, fny, ftx, fty", normal + shear
        if smooth and whole is None:
            return "fnx, fny", normal
    return None if whole is None else ("fx, fy", whole)


def _normals(table: Table, rows: Integers, every: Integers, bodies: Bodies, n: Floats) -> Floats:
    """(rows, 2) normals: from the centres between grains, from the file at walls."""
    if len(rows) == len(table):
        normals = np.empty_like(n)
    else:
        given = table.optional("nx", "ny")
        if given is None:
            given = table.optional("branch_x", "branch_y")
        if given is None and (points := table.optional("cx", "cy")) is not None:
            wall_first = every[:, :1] < 0
            given = np.where(wall_first, 1.0, -1.0) * (bodies.x[every.max(axis=1)] - points)
        given = np.zeros((len(table), 2)) if given is None else given
        length = np.hypot(*given.T)
        normals = given / np.where(length > 0, length, 1.0)[:, None]
    normals[rows] = n
    return normals


def contacts_among(
    bodies: Bodies, branches: ContactBranches, forces: Forces, *, measured: bool
) -> tuple[Flags | None, str]:
    """Which rows are contacts, None if all are, and a note: no pair across a gap without a force.

    Where no force is known, no pair across a gap, but for measured centres, and contacts across the
    border of a cell that others than these show to be wrong.
    """
    apart = branches.reach > 1.0
    if not apart.any():
        return None, ""
    if forces.known:
        apart &= (forces.normal == 0) & (forces.shear == 0)
        return ~apart if apart.any() else None, (
            f"{np.count_nonzero(apart)} pairs without overlap and force are no contacts"
        )
    gap = branches.reach - 1.0
    apart = gap > ROUNDINGS * rounding(bodies.x) / branches.length
    if measured or not apart.any() or apart.all():
        return None, ""
    if branches.images is not None:
        across = branches.images.any(axis=1)
        if across.any() and apart[across].mean() > MORE_ACROSS * apart[~across].mean():
            return None, ""
    if apart.mean() > MEASURED and median(gap[apart]) < AS_LARGE * median(-gap[~apart]):
        return None, ""
    return ~apart, (
        f"{np.count_nonzero(apart)} pairs across a gap are no contacts: without forces, by the "
        "distance of the centres"
    )


def once(
    table: Table,
    rows: Integers,
    pairs: Integers,
    images: Integers | None,
    forces: Forces,
    ids: Integers,
) -> tuple[Integers, str, Finding] | None:
    """Rows of contacts that stand in an earlier row, a note and a finding; None if none do."""
    again, first = repeated_contacts(pairs, images, len(ids))
    if not len(again):
        return None
    same = pairs[again, 0] == pairs[first, 0]
    off = np.hypot(
        forces.normal[again] - forces.normal[first], forces.shear[again] - forces.shear[first]
    )
    mean = float(np.hypot(forces.normal, forces.shear).mean()) or 1.0
    contacts = len(pairs) - len(again)
    words = f"{len(again)} contacts are in two rows and were taken once"
    if len(again) == contacts:
        words = f"each contact in two rows: {len(pairs)} rows, {contacts} contacts"
    twins = int(np.count_nonzero(same))
    worst = int(np.argmax(off))
    one, two = ids[pairs[again[worst]]].tolist()
    places = [table.number(rows[k[worst]]) for k in (again, first)]
    such = f"row {places[0]} and row {places[1]} (grains {one} and {two})"
    return again, words, repeated(twins, len(again) - twins, contacts, off / mean, such)


def resultants(pairs: Integers, n: Floats, forces: Forces, count: int) -> Floats:
    """(G, 2) sums of the forces of contacts between grains on each of them."""
    t = np.stack([-n[:, 1], n[:, 0]])
    on_2 = forces.normal * n.T + forces.shear * t
    one, two = pairs.T
    return np.stack([np.bincount(two, f, count) - np.bincount(one, f, count) for f in on_2], axis=1)


def redundant(
    table: Table, rows: Integers, n: Floats, used: tuple[Floats, Floats]
) -> list[Finding]:
    """Columns of forces that the file holds besides those that are used, against these."""
    normal, shear = used
    scale = float(np.abs(normal).mean())
    found = []
    if table.has("fn"):
        found.append(same_force("fn", some(table.column("fn"), rows), normal, scale, rows))
    if table.has("fsx", "fsy"):
        fs = some(table.columns("fsx", "fsy"), rows)
        along = n[:, 0] * fs[:, 1] - n[:, 1] * fs[:, 0]
        found.append(same_force("fsx, fsy", along, shear, scale, rows))
    if table.has("ft"):
        ft = some(table.column("ft"), rows)
        # Magnitudes beside a vector have no sign.
        wanted = shear if (ft < 0).any() else np.abs(shear)
        found.append(same_force("ft", ft, wanted, scale, rows))
    return found
