"""A snapshot from its plain tables: forces, law, walls, checks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from loops import (
    CohesiveFrictional,
    GrainGraph,
    HertzMindlin,
    InputError,
    LinearFrictional,
    Regime,
)
from loops.arrays import Floats, Integers, Regimes, median
from loops.compiled import load_ahead, use_compiled
from loops.laws.frictional import ShearHistory, ShearIncrement
from loops.laws.hertz_mindlin import HERTZ, HERTZ_BAND
from loops.validation import repeated_contacts
from patterns.snapshots.checked import Checked, goes_with_root, touching_lengths
from patterns.snapshots.checks import SLIDING_SHARE, check_state, same_force
from patterns.snapshots.findings import Finding, rounding
from patterns.snapshots.frame import Frame
from patterns.snapshots.geometry import (
    Bodies,
    check_cell,
    index_of,
    read_bodies,
    read_branches,
    read_pairs,
    rows_between_grains,
    some,
)
from patterns.snapshots.snapshot import Snapshot
from patterns.snapshots.tables import Table, require_columns
from patterns.snapshots.walls import WallContacts

LawName = Literal["linear", "hertz", "cohesive", "bonded"]
# Those of `CohesiveFrictional`: attraction, and bonds.
COHESIVE = ("cohesive", "bonded")
# Shear forces that are all below this share of the mean normal force are rounding; without friction
# those that digits of a text leave.
NO_SHEAR = 1e-9
NO_SHEAR_OF_TEXT = 1e-4
# Multiples of the rounding of centres above which an overlap tells a law.
SURE_ROUNDINGS = 20.0
TOLD = (
    "Hertz's law, told by the columns: kn goes with the root of the overlap, and N is 2/3 of kn "
    "times it; --law linear if it is another"
)


class Parameters(NamedTuple):
    """The law as the user gives it, and its parameters for columns that a file lacks.

    Under Hertz's law `kn` and `ks` of a file are tangents, which `young` and `poisson` replace.
    """

    kn: float | None = None
    kt: float | None = None
    mu: float | None = None
    shear_increment: ShearIncrement | None = None
    law: LawName | None = None
    young: float | None = None
    poisson: float | None = None
    shear_history: ShearHistory | None = None
    adhesion: float | None = None
    cohesion: float | None = None


def build_snapshot(frame: Frame, parameters: Parameters, *, strict: bool = True) -> Snapshot:
    """Check the tables of one saved state and make the snapshot of them.

    Without forces, or with normal forces alone on frictional grains, only the geometry. Findings
    that leave no meaningful result are refused if `strict`; doubts become notes.
    """
    table = frame.contacts
    require_columns((frame.grains, ("id", "x", "y", "radius")), (table, ("id1", "id2")))
    load_ahead(len(table))
    table.read_ahead()
    large = use_compiled(None, len(table))
    bodies = read_bodies(frame.grains, along_space=large)
    every = read_pairs(table, bodies)
    rows = rows_between_grains(table, every, along_space=large)
    pairs = some(every, rows)
    cell = check_cell(frame.cell, bodies.radii)
    branches = read_branches(table, rows, pairs, bodies, cell)
    force, normal, shear = _forces(table, rows, branches.n, parameters.mu)
    if frame.walls is None:
        walls, wall_count = _walls(table, bodies, every, force), len(every) - len(rows)
    else:
        walls, wall_count = _walls_of_table(frame.walls, bodies), len(frame.walls)
    notes = list(frame.notes)
    if parameters.law is None:
        parameters = parameters._replace(law=frame.law, shear_history=frame.shear_history)
    else:
        if parameters.law in COHESIVE and parameters.adhesion is None and not table.has("adhesion"):
            expected = f"the largest pull of a contact under --law {parameters.law}"
            raise InputError("adhesion", "none", expected, "Give --adhesion, or such a column.")
    if parameters.law is None and force is not None:
        told, words = _told_law(table, rows, bodies, pairs, branches.length, normal)
        parameters = parameters._replace(law=told)
        notes += words
    lacks, law, regime = _lacks(parameters, table), None, None
    if force is None:
        lacks = ["shear forces" if table.has("fn") else "forces", *lacks]
        lone = "normal forces without shear forces" if table.has("fn") else "no contact forces"
        notes.append(f"{lone}: the geometry of the loops alone, no stress and no stability")
    elif not lacks:
        grains, forces, increment = (bodies.radii, pairs), (normal, shear), frame.shear_increment
        law, regime = _law(table, rows, grains, forces, parameters, increment, notes)
    graph = _graph(table, rows, bodies, (pairs, normal, shear, branches.images, cell, regime))
    if branches.images is not None and not branches.images.any():
        notes.append("no contact crosses the border of the periodic cell")
    geometry = (graph, branches.d, branches.length)
    pushed = None if walls is None else (walls.grain, walls.force)
    ids, known = bodies.grain_ids, force is not None
    state = Checked(*geometry, law, regime, branches.given, pushed, ids, forces_known=known)
    redundant = _redundant(table, rows, branches.n, (normal, shear)) if known else []
    findings = (*frame.findings, *check_state(state), *redundant)
    for found in findings if strict else ():
        if found.severity == "error":
            raise InputError(table.path, found.says, "a packing of grains in contact", found.remedy)
    said = [one for one in findings if one.check == "balance" and frame.measured and known]
    if any(one.severity != "ok" for one in said):
        law = regime = None
        graph, said = graph.replace(regime=None), []
        lacks.append("balance")
    notes += [one.says for one in said] + _notes_of(findings, lacks, known)
    # Codes that move no grain may write zeros.
    mass = None if bodies.mass is None or not (bodies.mass > 0).all() else bodies.mass
    return Snapshot(
        *(graph, law, regime, ids, wall_count, tuple(notes), walls, frame.step, findings),
        *(bodies.rotation, tuple(lacks), mass, frame.time),
        *((None, None) if bodies.motion is None else (bodies.motion[:, :2], bodies.motion[:, 2])),
    )


def _told_law(
    table: Table,
    rows: Integers,
    bodies: Bodies,
    pairs: Integers,
    length: Floats,
    normal: Floats,
) -> tuple[LawName | None, list[str]]:
    """Return the law that stiffnesses and forces tell, and a note; None where they tell none."""
    # Springs that are all alike are not Hertz's.
    if table.has("kn", "ks") and np.ptp(table.column("kn")):
        kn, coarse = some(table.column("kn"), rows), SURE_ROUNDINGS * rounding(bodies.x)
        if _of_hertz(kn, normal, bodies.radii, pairs, length, coarse):
            return "hertz", [TOLD]
    if table.has("kn", "adhesion"):
        kn, pull = (some(table.column(name), rows) for name in ("kn", "adhesion"))
        if pull.any():
            overlap = bodies.radii[pairs].sum(axis=1) - length
            # Most forces are those of the springs less the adhesion, or those of the springs.
            pulls, spring = pull > 0, kn * overlap
            less = np.abs(normal - spring + pull)[pulls]
            attract = median(less) < median(np.abs(normal - spring)[pulls])
            law: LawName = "cohesive" if attract else "bonded"
            return law, [f"law {law!r}, told by the column 'adhesion' and the forces"]
    return None, []


def _lacks(parameters: Parameters, table: Table) -> list[str]:
    """List the options of the law that neither the call nor the table gives."""
    wanted = [("kn", "kn", parameters.kn)]
    if not _frictionless(table, parameters.mu):
        wanted.append(("kt", "ks", parameters.kt))
    lacks = [name for name, column, value in wanted if value is None and not table.has(column)]
    if parameters.law == "hertz" and (lacks or parameters.young is not None):
        lacks = [n for n in ("young", "poisson") if getattr(parameters, n) is None]
    if parameters.law in COHESIVE and parameters.adhesion is None and not table.has("adhesion"):
        lacks.append("adhesion")
    return lacks


def _of_hertz(
    kn: Floats, normal: Floats, radii: Floats, pairs: Integers, length: Floats, coarse: float
) -> bool:
    """Whether stiffnesses and forces are Hertz's: `kn` with the root of the overlap, N 2/3 of both.

    Overlaps that are not above `coarse` say nothing.
    """
    overlap = touching_lengths(radii, pairs) - length
    told = np.flatnonzero((kn > 0) & (normal > 0) & (overlap > coarse))
    kn, N, overlap = kn[told], normal[told], overlap[told]
    with np.errstate(divide="ignore", over="ignore"):
        share = N / (kn * overlap)
    if len(kn) == 0 or not abs(median(share) / HERTZ - 1) <= HERTZ_BAND:
        return False
    return goes_with_root(kn, radii[pairs[told]], overlap)


def _graph(
    table: Table,
    rows: Integers,
    bodies: Bodies,
    contacts: tuple[Integers, Floats, Floats, Integers | None, Floats | None, Regimes | None],
) -> GrainGraph:
    """The graph of contacts, cell and regimes; a repeated contact is named by its rows and ids."""
    pairs, normal, shear, images, cell, regime = contacts
    for array in (bodies.x, bodies.radii, pairs, normal, shear):
        array.flags.writeable = False  # not copied then
    try:
        return GrainGraph(
            x=bodies.x,
            radii=bodies.radii,
            contacts=pairs,
            normal_force=normal,
            shear_force=shear,
            images=images,
            cell=cell,
            regime=regime,
            rolling_moment=some(table.column("mz_on_2"), rows) if table.has("mz_on_2") else None,
        )
    except InputError:
        again, first = repeated_contacts(pairs, images, len(bodies.x))
        if not len(again):
            raise
        one, two = bodies.grain_ids[pairs[again[0]]].tolist()
        where = f"{table.path}, row {rows[again[0]]} (grains {one} and {two})"
        received, expected = f"the same contact as row {rows[first[0]]}", "each contact once"
        raise InputError(where, received, expected, "Drop one of the two rows.") from None


def _notes_of(findings: Sequence[Finding], lacks: Sequence[str], forces_known: bool) -> list[str]:
    """Notes on the stiffness that known forces lack, and on all findings that are not as wanted."""
    notes = []
    if forces_known and {"kn", "kt", "young", "poisson"} & {*lacks}:
        needed = [one.says for one in findings if one.check == "stiffness"]
        stiffness = [name for name in lacks if name != "balance"]
        given = " and ".join(f"--{name}" for name in stiffness)
        lone = f"forces without {' and '.join(stiffness)}: no stability of the loops"
        notes.append("; ".join([lone, *needed, f"give {given}"]))
    return notes + [str(one) for one in findings if one.severity != "ok"]


def _frictionless(table: Table, mu: float | None) -> bool:
    return not table.column("mu").any() if table.has("mu") else mu == 0


def _forces(
    table: Table, rows: Integers, n: Floats, mu: float | None
) -> tuple[Floats | None, Floats, Floats]:
    """Total force (C, 2) on the second body of all rows, and N and T of the chosen ones.

    No total force if the file lacks a part: then only N, if it has that, and zeros. A code's shear
    vector may lean out of the tangent by its own rounding (1e-9 of the force in Yade's): the total
    force keeps that share in `N`.
    """
    frictionless = _frictionless(table, mu)
    force = table.optional("fx_on_2", "fy_on_2")
    vectors = table.optional("fsx", "fsy") if force is None else None
    if force is None and (vectors is not None or table.has("fn")):
        # Normals of all rows: from the centres between grains, from the file at walls.
        if len(rows) == len(table):
            normals = np.empty_like(n)
        else:
            given = table.optional("nx", "ny")
            if given is None:
                branches = table.optional("branch_x", "branch_y")
                given = np.zeros((len(table), 2)) if branches is None else branches
                length = np.hypot(*given.T)
                given = given / np.where(length > 0, length, 1.0)[:, None]
            normals = given.copy()
        normals[rows] = n
        push = table.column("fn")[:, None] * normals
        if vectors is not None:
            force = vectors + push
        elif table.has("ft"):
            turned = np.stack([-normals[:, 1], normals[:, 0]], axis=1)
            force = push + table.column("ft")[:, None] * turned
        elif frictionless:
            force = push
    normal, shear = np.zeros(len(rows)), np.zeros(len(rows))
    if force is not None:
        f = some(force, rows)
        normal = np.einsum("ck,ck->c", f, n)
        shear = n[:, 0] * f[:, 1] - n[:, 1] * f[:, 0]
        none = NO_SHEAR_OF_TEXT if frictionless else NO_SHEAR
        if np.abs(shear).max() <= none * float(np.abs(normal).mean()):
            shear = np.zeros(len(rows))
    elif table.has("fn"):
        normal = some(table.column("fn"), rows)
    return force, normal, shear


def _redundant(
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


def _walls(
    table: Table, bodies: Bodies, pairs: Integers, force: Floats | None
) -> WallContacts | None:
    """Contacts of a grain with a wall; None where the file lacks the force or the branch."""
    single = np.flatnonzero((pairs[:, 0] >= 0) != (pairs[:, 1] >= 0))
    if force is None or not len(single):
        return None
    wall_first = pairs[single, 0] < 0
    grain = np.where(wall_first, pairs[single, 1], pairs[single, 0])
    sign = np.where(wall_first, 1.0, -1.0)[:, None]
    branches, points = table.optional("branch_x", "branch_y"), table.optional("cx", "cy")
    if branches is not None:
        branch = sign * branches[single]
    elif points is not None:
        branch = bodies.x[grain] - points[single]
    else:
        return None
    given = {k: table.column(k)[single] for k in ("kn", "ks", "mu", "sliding") if table.has(k)}
    flags = given["sliding"] != 0 if "sliding" in given else None
    kn = kt = mu = None
    if "kn" in given and "ks" in given:
        kn, kt, mu = given["kn"], given["ks"], given.get("mu")
        # Nothing sticks without friction; where the file has none, where it flags sliding.
        free = flags if mu is None else ~(mu > 0)
        kt = kt if free is None else np.where(free, 0.0, kt)
    return WallContacts(grain, sign * force[single], branch, kn, kt, mu, flags)


def _walls_of_table(table: Table, bodies: Bodies) -> WallContacts:
    """Contacts with walls from a table of their own, `id` the grain of each."""
    named = table.integers("id")
    grain = index_of(bodies.grain_ids, named)
    if grain.min() < 0:
        row = int(np.argmin(grain))
        where, received = f"column 'id' of {table.path}, row {row}", f"grain {named[row]}"
        raise InputError(where, received, "an id of the table of grains", "Correct or drop it.")
    kn, ks, mu = (table.column(k) if table.has(k) else None for k in ("kn", "ks", "mu"))
    flags = table.column("sliding") != 0 if table.has("sliding") else None
    force, branch = table.columns("fx", "fy"), table.columns("branch_x", "branch_y")
    return WallContacts(grain, force, branch, kn, ks, mu, flags)


def _law(
    table: Table,
    rows: Integers,
    grains: tuple[Floats, Integers],
    forces: tuple[Floats, Floats],
    parameters: Parameters,
    of_source: ShearIncrement | None,
    notes: list[str],
) -> tuple[LinearFrictional | CohesiveFrictional | HertzMindlin, NDArray[np.int8]]:
    """Law and regime of every contact; assumptions are added to the notes.

    A contact is sliding where the table flags it, else from the forces. `grains` are all radii and
    (C, 2) the grains of the contacts.
    """
    normal, shear = forces
    mu: Floats | None = None
    if table.has("mu") or parameters.mu is not None:
        mu = _parameter(table, rows, "mu", parameters.mu, "--mu", notes)
    adhesion = cohesion = np.zeros(len(rows))
    cohesive = parameters.law in COHESIVE
    if cohesive:
        adhesion = _parameter(table, rows, "adhesion", parameters.adhesion, "--adhesion", notes)
        cohesion = np.where(np.isfinite(mu), mu, 0.0) * adhesion if mu is not None else cohesion
        if table.has("cohesion") or parameters.cohesion is not None:
            given = parameters.cohesion
            cohesion = _parameter(table, rows, "cohesion", given, "--cohesion", notes)
        else:
            notes.append("cohesion = mu times the adhesion: friction knows N + adhesion")
    slides_at = "cohesion + mu N" if cohesive else "mu N"
    strength = cohesion + (normal if mu is None else mu * normal)
    carries = strength > 0
    if table.has("sliding"):
        sliding = (some(table.column("sliding"), rows) != 0) & carries
    elif mu is not None:
        sliding = (np.abs(shear) >= SLIDING_SHARE * strength) & carries
        notes.append(f"no column 'sliding': sliding where |T| >= {SLIDING_SHARE} {slides_at}")
    else:
        sliding = np.zeros(len(rows), dtype=bool)
        notes.append("neither 'sliding' nor 'mu': every contact is taken as elastic")
    if mu is None:
        # Only the sliding blocks need the friction: |T|/N where the file flags sliding.
        loaded = np.where(normal > 0, normal, 1.0)
        mu = np.where(sliding, np.abs(shear) / loaded, np.inf)
        if sliding.any():
            notes.append("no column 'mu': friction of sliding contacts taken as |T|/N")
    # Nothing sticks without friction, and nothing slides: there is no shear force.
    free = (mu == 0) & (cohesion == 0)
    sliding &= ~free
    chosen = parameters.shear_increment
    increment = chosen or of_source or "branch"
    if chosen is None and of_source == "radii":
        notes.append(
            "shear increment 'radii', Yade's default: --shear-increment branch if the simulation "
            "had avoidGranularRatcheting=False"
        )
    elif chosen is not None and "radii" in (chosen, of_source):
        other = "" if of_source in (None, chosen) else f", not {of_source!r}"
        notes.append(f"shear increment {chosen!r} as given{other}")
    regime = np.where(sliding, Regime.SLIDING, Regime.ELASTIC).astype(np.int8)
    if parameters.law == "hertz":
        radii, pairs = grains
        young, poisson, ratio = _moduli(table, rows, radii[pairs], normal, parameters, notes)
        history = parameters.shear_history or "force"
        rule = "T stays" if history == "force" else "T goes with kt"
        notes.append(f"Hertz's law, shear history {history!r}: {rule} while the overlap changes")
        law = HertzMindlin(young, poisson, mu, increment, history, ratio)
        ratio = np.where(free, 0.0, law.stiffness_ratio) if free.any() else ratio
        return replace(law, ratio=ratio), regime
    kn = _parameter(table, rows, "kn", parameters.kn, "--kn", notes)
    kt = 0.0 if free.all() else _parameter(table, rows, "ks", parameters.kt, "--kt", notes)
    if free.any():
        kt = np.where(free, 0.0, kt)
        notes.append(f"mu = 0 of {np.count_nonzero(free)} contacts: no shear stiffness, no sliding")
    if cohesive:
        bonded = parameters.law == "bonded"
        notes.append(f"law {parameters.law!r}: see CohesiveFrictional")
        return CohesiveFrictional(kn, kt, mu, adhesion, cohesion, bonded, increment), regime
    return LinearFrictional(kn=kn, kt=kt, mu=mu, shear_increment=increment), regime


def _moduli(
    table: Table,
    rows: Integers,
    radii: Floats,
    normal: Floats,
    parameters: Parameters,
    notes: list[str],
) -> tuple[Floats | float, Floats | float, Floats | None]:
    """Young's modulus, Poisson's ratio, and kt/kn where the file gives tangents.

    A tangent `kn = (6 E*^2 R* N)^(1/3)` tells `E*` without the overlap, which a file may round.
    """
    if parameters.young is not None and parameters.poisson is not None:
        if table.has("kn") or table.has("ks"):
            notes.append("columns 'kn' and 'ks' not used: --young and --poisson are given")
        return parameters.young, parameters.poisson, None
    kn, ks = some(table.column("kn"), rows), some(table.column("ks"), rows)
    told = (kn > 0) & (normal > 0)
    if not told.any():
        remedy = "Give --young and --poisson."
        raise InputError(f"column 'kn' of {table.path}", "no tangent", "one at a force", remedy)
    reduced = radii.prod(axis=1) / radii.sum(axis=1)
    modulus, ratio = np.empty(len(rows)), np.empty(len(rows))
    # At Poisson's ratio 0 Young's modulus is E/(1 - nu^2) = 2 E*.
    modulus[told] = 2.0 * np.sqrt(kn[told] ** 3 / (6.0 * reduced[told] * normal[told]))
    ratio[told] = ks[told] / kn[told]
    for values in (modulus, ratio):
        values[~told] = median(values[told])
    notes.append(
        f"E/(1 - nu^2) = {median(modulus):.4g} and kt/kn = {median(ratio):.4g} (medians), "
        "from the columns 'kn' and 'ks' as tangents"
    )
    return modulus, 0.0, ratio


def _parameter(
    table: Table, rows: Integers, column: str, value: float | None, option: str, notes: list[str]
) -> Floats:
    if table.has(column):
        if value is not None:
            notes.append(f"{option} {value} not used: the table has the column {column!r}")
        values = table.column(column)
        return some(values, rows)
    assert value is not None  # a law is made where nothing lacks
    notes.append(f"{column} = {value} for every contact, from {option}")
    return np.full(len(rows), float(value))
