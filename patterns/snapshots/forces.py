"""Forces of the contacts of a snapshot from the columns that a file has, and which are contacts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from loops import InputError
from loops.arrays import Flags, Floats, Integers, median
from loops.errors import counted
from loops.validation import repeated_contacts
from patterns.snapshots.checked import ROUNDINGS
from patterns.snapshots.checks import ALONG, repeated, same_force
from patterns.snapshots.findings import Finding, rounding
from patterns.snapshots.geometry import Bodies, Contacts, sums_on_grains
from patterns.snapshots.laws import frictionless
from patterns.snapshots.source import COHESIVE, Source
from patterns.snapshots.tables import Table, require_columns

# Shear forces that are all below this share of the mean normal force are rounding; without friction
# those that digits of a text leave.
NO_SHEAR = 1e-9
NO_SHEAR_OF_TEXT = 1e-4
# Columns whose vectors act on one of the two grains, as one of these codes has it.
OF_EITHER = ("fnx, fny, ftx, fty", "fnx, fny", "fx, fy")
# Without forces a list whose gaps are as large as its overlaps is one of measured centres: from
# this share of pairs on that are apart, by gaps of so many overlaps (medians) at most.
MEASURED = 0.2
AS_LARGE = 3.0
# This many times as many gaps across the border of a cell as elsewhere show that it is wrong.
MORE_ACROSS = 5.0


class Forces(NamedTuple):
    """Forces of a table: `normal` and `shear` (C,) of the contacts between grains.

    `known` is whether the file has both; if not, `normal` is what it has, else zeros. `at_walls`
    (W, 2) are those on the second body of the contacts with walls; `notes` name assumptions.
    """

    known: bool
    normal: Floats
    shear: Floats
    at_walls: Floats | None
    notes: list[str]

    @property
    def zero(self) -> bool:
        """Whether no contact carries a force."""
        return not (self.normal.any() or self.shear.any())


def read_forces(contacts: Contacts, walls: Table | None, ends: Integers, source: Source) -> Forces:
    """Forces between grains, and those of the rows with `walls`, between the bodies `ends` (W, 2).

    A code's shear vector may lean out of the tangent by its own rounding (1e-9 of the force in
    Yade's): the total force keeps that share in `N`. A force of which the file does not say on
    which grain it acts is taken on the second one if it pushes then, else on the first.
    """
    table, n, notes = contacts.table, contacts.n, list[str]()
    smooth = all(frictionless(one, source.mu) for one in (table, walls) if one is not None)
    force, names = _on_second(table, n, smooth)
    sign = 1.0
    if force is not None and names in OF_EITHER:
        along = np.einsum("ck,ck->c", force, n)
        share = float(np.mean(along / np.where(force.any(axis=1), np.hypot(*force.T), 1.0)))
        if source.law in COHESIVE or abs(share) < ALONG:
            remedy = "Name it: --columns fx_on_2=COLUMN,fy_on_2=COLUMN, of the force on grain 2."
            received = f"forces that push by {share:.3g} of their size (mean)"
            where = f"columns {names} of {table.path}"
            raise InputError(where, received, "to tell the grain that they act on", remedy)
        sign = 1.0 if share > 0 else -1.0
        notes.append(f"columns {names} taken as forces on grain {1 + (share > 0)}: they push it")
    elif force is not None and names == "force":
        notes.append("column 'force' taken as the normal force: there is no friction")
    normal, shear = np.zeros(len(n)), np.zeros(len(n))
    if force is not None:
        f = sign * force
        normal = np.einsum("ck,ck->c", f, n)
        shear = n[:, 0] * f[:, 1] - n[:, 1] * f[:, 0]
        none = NO_SHEAR_OF_TEXT if smooth else NO_SHEAR
        if np.abs(shear).max() <= none * float(np.abs(normal).mean()):
            shear = np.zeros(len(n))
    elif table.has("fn"):
        normal = table.column("fn")
    at_walls = None
    if force is not None and walls is not None:
        at_walls, _ = _on_second(walls, _wall_normals(walls, ends, contacts.bodies), smooth)
        at_walls = None if at_walls is None else sign * at_walls
    return Forces(force is not None, normal, shear, at_walls, notes)


def _on_second(table: Table, n: Floats, smooth: bool) -> tuple[Floats | None, str]:
    """(C, 2) forces on the second body, or those of `OF_EITHER`, and the columns that they are of.

    `n` (C, 2) are the normals; None if a part lacks, which `smooth` contacts have not.
    """
    force = table.optional("fx_on_2", "fy_on_2")
    if force is not None:
        return force, "fx_on_2, fy_on_2"
    parts, whole = table.optional("fnx", "fny"), table.optional("fx", "fy")
    vectors = table.optional("fsx", "fsy")
    if vectors is not None and parts is None and whole is None:
        require_columns((table, ("fn",)))
    if table.has("fn") and (vectors is not None or table.has("ft") or smooth):
        force = table.column("fn")[:, None] * n
        if vectors is not None:
            force = force + vectors
        elif table.has("ft"):
            force = force + table.column("ft")[:, None] * np.stack([-n[:, 1], n[:, 0]], axis=1)
        return force, "fn"
    if smooth and table.has("force") and not table.has("fn"):
        return table.column("force")[:, None] * n, "force"
    if parts is not None and (shear := table.optional("ftx", "fty")) is not None:
        return parts + shear, "fnx, fny, ftx, fty"
    if parts is not None and smooth and whole is None:
        return parts, "fnx, fny"
    return whole, "fx, fy"


def _wall_normals(walls: Table, ends: Integers, bodies: Bodies) -> Floats:
    """(W, 2) normals of contacts with walls as the file has them, zero if it has none."""
    given = walls.optional("nx", "ny")
    if given is None:
        given = walls.optional("branch_x", "branch_y")
    if given is None and (points := walls.optional("cx", "cy")) is not None:
        wall_first = ends[:, :1] < 0
        given = np.where(wall_first, 1.0, -1.0) * (bodies.x[ends.max(axis=1)] - points)
    given = np.zeros((len(walls), 2)) if given is None else given
    length = np.hypot(*given.T)
    return np.asarray(given / np.where(length > 0, length, 1.0)[:, None])


def contacts_among(
    contacts: Contacts, forces: Forces, *, measured: bool
) -> tuple[Flags | None, str]:
    """Which rows are contacts, None if all are, and a note: no pair across a gap without a force.

    Where no force is known, no pair across a gap, but for measured centres, and contacts across the
    border of a cell that others than these show to be wrong.
    """
    apart = contacts.reach > 1.0
    if not apart.any():
        return None, ""
    if not forces.zero:
        apart &= (forces.normal == 0) & (forces.shear == 0)
        return ~apart if apart.any() else None, (
            counted(np.count_nonzero(apart), "pair", "pairs")
            + " without overlap and force left out"
        )
    gap = contacts.reach - 1.0
    apart = gap > ROUNDINGS * rounding(contacts.bodies.x) / contacts.length
    if measured or not apart.any() or apart.all():
        return None, ""
    if contacts.images is not None:
        across = contacts.images.any(axis=1)
        if across.any() and apart[across].mean() > MORE_ACROSS * apart[~across].mean():
            return None, ""
    if apart.mean() > MEASURED and median(gap[apart]) < AS_LARGE * median(-gap[~apart]):
        return None, ""
    return ~apart, (
        f"{counted(np.count_nonzero(apart), 'pair')} across a gap left out: without forces, by the "
        "distance of the centres"
    )


def once(contacts: Contacts, forces: Forces) -> tuple[Integers, str, Finding] | None:
    """Contacts that stand in an earlier row, a note and a finding; None if none do."""
    pairs, ids = contacts.pairs, contacts.bodies.ids
    again, first = repeated_contacts(pairs, contacts.images, len(ids))
    if not len(again):
        return None
    same = pairs[again, 0] == pairs[first, 0]
    off = np.hypot(
        forces.normal[again] - forces.normal[first], forces.shear[again] - forces.shear[first]
    )
    mean = float(np.hypot(forces.normal, forces.shear).mean()) or 1.0
    count = len(pairs) - len(again)
    words = f"{counted(len(again), 'contact')} in two rows, taken once"
    if len(again) == count:
        words = f"each contact in two rows: {len(pairs)} rows, {counted(count, 'contact')}"
    twins = int(np.count_nonzero(same))
    worst = int(np.argmax(off))
    one, two = ids[pairs[again[worst]]].tolist()
    places = [contacts.table.number(k[worst]) for k in (again, first)]
    such = f"row {places[0]} and row {places[1]} (grains {one} and {two})"
    return again, words, repeated(twins, len(again) - twins, count, off / mean, such)


def resultants(contacts: Contacts, forces: Forces) -> Floats:
    """(G, 2) sums of the forces of contacts between grains on each of them."""
    n = contacts.n
    on_2 = forces.normal * n.T + forces.shear * np.stack([-n[:, 1], n[:, 0]])
    return sums_on_grains(contacts.pairs, on_2, len(contacts.bodies.x))


def redundant(contacts: Contacts, forces: Forces) -> list[Finding]:
    """Columns of forces that the file holds besides those that are used, against these."""
    table, n, shear = contacts.table, contacts.n, forces.shear
    columns: list[tuple[str, Floats, Floats]] = []
    if table.has("fn"):
        columns.append(("fn", table.column("fn"), forces.normal))
    if table.has("fsx", "fsy"):
        fs = table.columns("fsx", "fsy")
        columns.append(("fsx, fsy", n[:, 0] * fs[:, 1] - n[:, 1] * fs[:, 0], shear))
    if table.has("ft"):
        ft = table.column("ft")
        # Magnitudes beside a vector have no sign.
        columns.append(("ft", ft, shear if (ft < 0).any() else np.abs(shear)))
    scale, rows = float(np.abs(forces.normal).mean()), table.number(np.arange(len(table)))
    return [same_force(name, given, used, scale, rows) for name, given, used in columns]
