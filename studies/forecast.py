"""Which loops a packing will lose, how likely, and its next drop; needs no later snapshot.

The packing is followed by its path and by its replay (`studies.evolve`). What they say of a loop
becomes a probability by how often the same was true of samples whose later states are known.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from loops import Faces, find_faces
from loops.arrays import Flags, Floats, Integers
from loops.contacts import contacts_at_start
from loops.errors import counted, number, whole_number
from loops.scene import Scene, Subject
from loops.shown import Shown
from loops.tracking import Fate, loop_fates, match_contacts
from patterns import Snapshot, planar
from stability import COMPONENTS, follow
from stability import Path as FollowedPath
from stability.packing import loop_changes
from stability.packing.sustain import renumbered
from studies.evolve import DROP, INTERVALS, Evolution, Programmed, followed, start_of
from studies.output import Summary, readable
from studies.questions import Holding, options_of, taken
from studies.reading import read_planar, reading
from studies.series.packing import DEFAULT_RATE, Rate
from studies.snapshot.in_packing import balance_notes, held_snapshot
from studies.study import files_of, study

# Options of the ways where they are left out. Places are known to a row, and 20 or 80 give the same
# likely losses (docs/knobs.md); no path of the samples met so many instabilities.
DEFAULTS: dict[str, Any] = {"by": "both", "rows": 40, "instabilities": 1000}
# Steps of a replay, by the number of grains across the sample, that are its start from rest: a wave
# crosses it some six times in them. With 7 the start itself is told as a drop (docs/knobs.md).
START_STEPS = 20.0


# ---- what one way says of the loops
# What is looked for ahead: columns of `Next`.
NEXT = ("drop", "instability", "limit")
# What may happen to a loop, and the target of `series.skill` that it is.
KINDS = {"opens": "contact_lost", "lost": "topology", "unstable": "W2_negative"}
WAYS = {"path": "events", "replay": "replay"}
# Parts of the way that places are told by; 1 to 8 forecast losses alike (docs/knobs.md).
PARTS = 4
NEVER = PARTS
# Factor beyond the outer mean reaches up to which there are probabilities; 5 kept the skill.
BEYOND = 2.0
CALIBRATION = Path(__file__).with_name("forecast.json")


def since(flags: Flags) -> Integers:
    """Return the row from which a flag (R, ...) holds until the last row; R where it never does."""
    held = np.logical_and.accumulate(flags[::-1])
    return np.asarray(len(flags) - held.sum(axis=0))


def opening_places(way: FollowedPath, faces: Faces, contacts: int) -> tuple[Floats, Integers]:
    """Return where the first contact of each loop opens for good, share of the way; the contact.

    Between two rows the overlap is taken to change evenly. Infinite, and -1, where none does.
    """
    closed = np.array([state.closed[:contacts] for state in way.states])
    row = since(~closed)
    opens = np.flatnonzero((row > 0) & (row < len(closed)))
    overlap = np.array([(state.law.touching - state.length)[opens] for state in way.states])
    one, k = np.arange(len(opens)), row[opens]
    before, after = overlap[k - 1, one], overlap[k, one]
    part = np.clip(before / np.where(before > after, before - after, 1.0), 0.0, 1.0)
    place = np.full(contacts, np.inf)
    place[opens] = (k - 1 + part) / (len(closed) - 1)
    face, values = np.repeat(np.arange(len(faces.kind)), faces.order), place[faces.contacts]
    first, which = np.full(len(faces.kind), np.inf), np.full(len(faces.kind), -1)
    # The earliest is written last.
    late = np.argsort(-values, kind="stable")
    late = late[np.isfinite(values[late])]
    first[face[late]], which[face[late]] = values[late], faces.contacts[late]
    return first[faces.loops], which[faces.loops]


class Places(NamedTuple):
    """Places at which a way loses each loop (L,): shares of the way by kind, infinite for never.

    `contact` is the one that opens first, -1 for none, `fate` what became of the loop at the end.
    Not numbers, and unknown, of a way that does not reach its end.
    """

    opens: Floats
    lost: Floats
    unstable: Floats
    contact: Integers
    fate: NDArray[np.str_]


def places(found: Evolution, name: str) -> Places:
    """Return where a way loses each loop; a state counts that lasts to the end: so a snapshot."""
    scene, faces = found.scene, found.scene.faces
    way, count = found.ways.get(name), len(faces.loops)
    if way is None or way.status != "finished":
        unknown = np.full(count, np.nan)
        none, fate = np.full(count, -1), np.full(count, "unknown")
        return Places(unknown, unknown, unknown, none, fate)
    graph, rows = scene.graph, len(way.states) - 1
    opens, contact = opening_places(way, faces, graph.contact_count)
    fates, negative = np.empty((rows, count), dtype=int), np.empty((rows, count), dtype=bool)
    for k, state in enumerate(way.states[1:]):
        later = state.graph()
        match = match_contacts(graph, found.ids, later, found.ids)
        fates[k] = loop_fates(match, faces, find_faces(later)).before
        negative[k] = loop_changes(graph, state, faces).normalised_work < 0
    # In the middle of two rows.
    lost, unstable = (
        np.where(row < rows, (row + 0.5) / rows, np.inf)
        for row in (since(fates != Fate.SURVIVED), since(negative))
    )
    names = np.array([fate.name.lower() for fate in Fate])
    return Places(opens, lost, unstable, contact, names[fates[-1]])


# ---- how far


def forecast_reach(scene: Scene, to: float, driven: str) -> float:
    """Return the driven strain over p/kn: how far a packing goes in units of its mean overlaps."""
    state = contacts_at_start(scene)
    kn = float(state.law.stiffnesses(state.overlap)[0][state.closed].mean())
    return abs(to) / state.pressure * (kn if driven[0] == "H" else 1.0)


# ---- the next drop and instability


class Next(NamedTuple):
    """Next instability, drop and limit by one way of following the packing, nan for none.

    Values are of the driven component; `drop_size` is over the driven stress of the start,
    `residual` over the mean force.
    """

    way: str
    status: str
    message: str
    reached: float
    instability: float
    drop: float
    drop_size: float
    limit: float
    limit_spread: float
    residual: float


def next_of(name: str, way: FollowedPath, driven: str, sense: float) -> Next:
    """Return the next instability and drop on a way."""
    at, begin = sense * way.parameter, 0
    if way.steps:
        across = np.sqrt(len(way.velocity))
        begin = int(np.ceil(START_STEPS * across / way.steps * (len(at) - 1)))
    lost = [sense * event.parameter for event in way.of_kind("instability")]
    drop = size = np.nan
    if driven[0] == "H":
        stress = sense * way.P[:, COMPONENTS.index(driven[1:])]
        top = np.maximum.accumulate(stress[begin:])
        fall = top - stress[begin:]
        falls = np.flatnonzero(fall > DROP * abs(stress[0]))
        if len(falls):
            drop = at[begin + int(np.argmax(top == top[falls[0]]))]
            size = float(fall[top == top[falls[0]]].max() / abs(stress[0]))
    residual = way.imbalance.max() if len(way.imbalance) else way.states[-1].unbalanced
    first = lost[0] if lost else np.nan
    limit = sense * way.limit, way.limit_spread
    told = name, way.status, way.message, float(at[-1])
    return Next(*told, first, drop, size, *limit, float(residual))


def next_rows(found: Evolution, asked: Programmed, *, spread: bool) -> pd.DataFrame:
    """Return a row a way; with `spread` also paths of half the interval and another numbering."""
    ways = {name: found.ways[way] for name, way in WAYS.items() if way in found.ways}
    if spread and "path" in ways:
        how: dict[str, Any] = {"closure": "packing", "max_steps": INTERVALS, "rows": asked.rows}
        how |= {"instabilities": asked.instabilities, "past": asked.past}
        half, same = asked.interval / 2, asked.interval
        ways["path, interval halved"] = follow(found.scene, asked.stages, interval=half, **how)
        other = renumbered(found.scene, 1)
        ways["path, grains renumbered"] = follow(other, asked.stages, interval=same, **how)
    driven = found.driven, found.sense
    return pd.DataFrame(next_of(name, way, *driven) for name, way in ways.items())


def spread_of(rows: pd.DataFrame, what: str) -> dict[str, Any]:
    """Return a value by the path, and the range of the ways that have one of those asked."""
    known = rows[what].dropna()
    first = rows[what].iloc[0]
    return {
        "value": None if np.isnan(first) else float(first),
        "low": float(known.min()) if len(known) else None,
        "high": float(known.max()) if len(known) else None,
        "found": len(known),
        "ways": len(rows),
    }


# ---- the forecast


@dataclass(frozen=True, eq=False, repr=False)
class Forecast(Shown):
    """Forecast of a packing under a programme, by its path and its replay.

    Attributes
    ----------
    evolution : Evolution
        Path and replay.
    reach : float
        Driven strain over p/kn, the strain of a mean overlap; driven stress over p.
    loops : DataFrame
        A row a loop, in the order of `loop_table`: `path_*_at` and `replay_*_at`, the driven strain
        or stress (force/length) from which a contact is open ('opens'), the loop lost ('lost': it
        doesn't survive, contacts open, or close across it) or its second-order work negative
        ('unstable') to the end; `*_probability` of each, in [0, 1], nan where there is none.
    base : dict of float
        Share of all loops of which each came true in the samples that the forecast is calibrated
        on, at this reach: 'opens', 'lost', 'unstable'.
    next : DataFrame
        A row a way: driven strain or stress at the next instability, drop of the driven stress and
        limit of the control, nan for none; `residual` over the mean force.
    """

    evolution: Evolution
    reach: float
    loops: pd.DataFrame
    base: dict[str, float]
    next: pd.DataFrame

    @property
    def answered(self) -> bool:
        """Return whether a way reached its end."""
        return any(way.status == "finished" for way in self.evolution.ways.values())

    def facts(self) -> dict[str, object]:
        """Return the facts that the prompt and a notebook show."""
        unit = "strain" if self.evolution.driven[0] == "H" else "force/length"
        told: dict[str, object] = {
            "to": f"{self.evolution.driven} = {self.evolution.to:g} ({unit})"
        }
        told |= {name: way.status for name, way in self.evolution.ways.items()}
        for kind in KINDS:
            likely = int((self.loops[f"{kind}_probability"] > 0.5).sum())
            told[kind] = f"{likely} of {counted(len(self.loops), 'loop')} at p > 0.5"
        for what in NEXT:
            one = spread_of(self.next, what)
            none = f"none in {one['ways'] - one['found']} of {one['ways']} ways"
            said = f"{one['low']:.3g} to {one['high']:.3g}" if one["found"] else none
            told[f"next {what}"] = said
        return told


def forecast(
    subject: Subject,
    programme: str = "drained",
    *,
    to: float,
    spread: bool = True,
    inertial_number: float = DEFAULT_RATE,
    progress: Callable[[float], None] | None = None,
    **options: Any,
) -> Forecast:
    """Say which loops of a packing will be lost under a programme, how likely, and the next drop.

    The packing is followed from its present state by its path, from event to event, and by its
    replay, by the equations of motion. A loop that both lose early is more likely lost than one
    that either loses late: how much more is counted on samples whose later states are known
    (docs/forecast.md).

    Parameters
    ----------
    subject : Scene or Snapshot
        A packing with forces, periodic or between known walls.
    programme : str
        As in `evolve`. Probabilities were counted under biaxial compression.
    to : float
        Change of the driven strain, or stress (force/length); positive in compression.
    spread : bool
        Whether the path is followed again with half the interval and with another numbering of the
        grains, which tells the spread of the next drop and instability; three times the cost.
    inertial_number : float
        Rate of the replay, `|H'| sqrt(mean mass / p)`; above 0.
    progress : callable, optional
        Called with the strain or stress that the first path has reached.
    **options
        As in `evolve`; `rows` (40, 1 or more) is how finely places along the way are told,
        `instabilities` is 1000.

    Returns
    -------
    Forecast
        `.table()` has a row a loop with the ids of its grains, `.next` a row a way. Places `*_at`
        are values of the driven component, with the sign of `to`; nan for never, and where a way
        does not reach its end. Where of n loops of which path and replay said the same k were lost,
        `*_probability` is `(k + b) / (n + 1)`, b the base rate of all.

    Raises
    ------
    InputError
        If an option is unknown or out of its range, the packing has no forces, neither cell nor
        walls, or it flows (unbalanced force above 0.1 of the mean contact force).

    Examples
    --------
    >>> import grainloops as gl
    >>> import numpy as np
    >>> lattice = gl.GrainGraph(x=[[0, 0], [1, 0], [0, 1], [1, 1]], radii=[0.5005] * 4,
    ...     contacts=[[0, 1], [1, 0], [2, 3], [3, 2], [0, 2], [2, 0], [1, 3], [3, 1]],
    ...     images=[[0, 0], [1, 0], [0, 0], [1, 0], [0, 0], [0, 1], [0, 0], [0, 1]],
    ...     cell=2 * np.eye(2), normal_force=np.full(8, 0.001))
    >>> scene = gl.Scene(lattice, gl.LinearFrictional(1.0, 0.5, 0.5))
    >>> found = gl.forecast(scene, "oedometric", to=-2e-3, interval=1e-4)
    >>> found.table()["path_opens_at"].round(4).tolist()
    [-0.001, -0.001, -0.001, -0.001]
    """
    asked = options_of(Programmed, DEFAULTS | {"programme": programme, "to": to, **options})
    snapshot = planar(subject)
    balance_notes(snapshot)
    asked = asked.along(snapshot.scene)
    return forecast_of(snapshot, asked, inertial_number, spread=spread, progress=progress)


def forecast_of(
    snapshot: Snapshot,
    asked: Programmed,
    inertial_number: float,
    *,
    spread: bool,
    progress: Callable[[float], None] | None = None,
) -> Forecast:
    """Return the forecast of a packing."""
    to = number("--to", asked.to)
    whole_number("--rows", asked.rows, 1)
    number("inertial_number", inertial_number, 0.0, open_low=True)
    rate = Rate.from_rest(inertial_number, "as given")
    found, graph = followed(snapshot, asked, rate, progress), snapshot.graph
    told = {name: places(found, way) for name, way in WAYS.items()}
    loops = found.loops()[["loop", "order", "area", "grains"]]
    reach, base = forecast_reach(snapshot.scene, to, asked.driven), {}
    for kind in KINDS:
        both = getattr(told["path"], kind), getattr(told["replay"], kind)
        for name, place in zip(WAYS, both, strict=True):
            loops[f"{name}_{kind}_at"] = np.where(np.isfinite(place), asked.to * place, np.nan)
        loops[f"{kind}_probability"], rates = calibration().probability(kind, *both, reach)
        base[kind] = float(rates[0]) if len(rates) else np.nan
    for name, one in told.items():
        loops[f"{name}_fate"], contact = one.fate, one.contact
        ends = np.where(contact[:, None] < 0, -1, snapshot.ids[graph.contacts[contact]])
        loops[f"{name}_id1"], loops[f"{name}_id2"] = ends.T
    return Forecast(found, reach, loops, base, next_rows(found, asked, spread=spread))


# ---- the study behind the command


def run_forecast(
    path: Path,
    out: Path,
    *,
    spread: bool = True,
    inertial_number: float = DEFAULT_RATE,
    progress: Callable[[float], None] | None = None,
    **how: Any,
) -> Summary:
    """Forecast a snapshot, write tables, a figure and a report; return the summary.

    `how` are options of `evolve`, of `Holding` and `read_planar`, and files of `study`.
    """
    files = files_of(how)
    how = DEFAULTS | how
    asked = taken(Programmed, how)
    control = taken(Holding, how).control
    configuration = {"path": path, **reading(**how), **asked.described(), "hold": control}
    configuration |= {"spread": spread, "inertial_number": inertial_number}
    with study("forecast", out, configuration, **files) as results:
        snapshot, held = held_snapshot(read_planar(path, **how), control)
        notes = [*snapshot.notes, *balance_notes(snapshot)]
        asked = asked.along(snapshot.scene)
        found = forecast_of(snapshot, asked, inertial_number, spread=spread, progress=progress)
        tables = {"loops": found.loops, "next": found.next}
        told = asked.described() | {"held": held, "inertial_number": inertial_number}
        told |= forecast_summary(found, notes, spread=spread)
        title = f"Forecast of {readable(path.name)}"
        return results.write_packing(title, snapshot, found, tables, told)


def forecast_summary(found: Forecast, notes: Sequence[str], *, spread: bool) -> Summary:
    """Return the summary of a forecast."""
    known, (low, high) = calibration(), calibration().range()
    ends = {
        row.way: {"status": row.status, "message": row.message, "reached": row.reached,
                  "residual": row.residual}
        for row in found.next.itertuples()
    }  # fmt: skip
    lost = [f"{name} {one['status']} at {one['reached']:.3g}: {one['message']}"
            for name, one in ends.items() if one["status"] != "finished"]  # fmt: skip
    told: dict[str, dict[str, Any]] = {}
    for kind in KINDS:
        likely, base = found.loops[f"{kind}_probability"], found.base[kind]
        told[kind] = {
            "expected": float(likely.sum()) if likely.notna().any() else None,
            "likely": int((likely > 0.5).sum()),
            "base": None if np.isnan(base) else base,
        }
        for name in WAYS:
            reached = ends.get(name, {}).get("status") == "finished"
            count = int(found.loops[f"{name}_{kind}_at"].notna().sum())
            told[kind][name] = count if reached else None
    if not low / BEYOND <= found.reach <= high * BEYOND:
        counted = f"{low / BEYOND:.2g} to {high * BEYOND:.2g}, where forecasts were counted"
        said = f"no probabilities: {found.reach:.2g} times p/kn is outside of {counted}"
        notes = [*notes, said]
    return {
        "driven": found.evolution.driven,
        **start_of(contacts_at_start(found.evolution.scene).stress),
        "reach": found.reach,
        "answered": found.answered,
        "loops": len(found.loops),
        "kinds": told,
        "next": {what: spread_of(found.next, what) for what in NEXT},
        "ways": ends,
        "calibration": known.provenance,
        "spread": spread,
        "notes": [*notes, *lost],
    }


def parts_of(place: Floats) -> Integers:
    """Return the part of the way of each place, `NEVER` where there is none, -1 if unknown."""
    part = np.where(np.isfinite(place), np.minimum(place, 1.0 - 1e-9) * PARTS, NEVER)
    return np.where(np.isnan(place), -1, part).astype(int)


def parts_cells(path: Integers, replayed: Integers) -> Integers:
    """Return the cell of each pair of parts: both say so by a part, one of them does, or none.

    Where one way is unknown: the parts of the other. Cells count from 0 within these two kinds,
    those of single ways from `2 PARTS + 1`.
    """
    both = np.maximum(path, replayed)
    one = PARTS + np.minimum(path, replayed)
    cell = np.where(both < NEVER, both, np.minimum(one, 2 * PARTS))
    single = 2 * PARTS + 1 + both
    return np.where(both < 0, -1, np.where(np.minimum(path, replayed) < 0, single, cell))


class Calibration(NamedTuple):
    """Loops that a forecast called lost, and those that were: a row a series, reach, kind and cell.

    `table` has `series, level, reach, kind, path, replay, loops, true`; parts of the way by `path`
    and `replay`, `true` of the `loops` were really lost.
    """

    table: pd.DataFrame
    provenance: dict[str, Any]

    def without(self, series: str) -> Calibration:
        """Return the calibration by all other series."""
        return self._replace(table=self.table[self.table["series"] != series])

    def range(self) -> tuple[float, float]:
        """Return the least and the largest mean reach of its classes."""
        reach = self.table.groupby("level")["reach"].mean()
        return float(reach.min()), float(reach.max())

    def shares(self, kind: str, way: str) -> pd.DataFrame:
        """Return `loops`, `true` and the `probability` by level and cell of both ways or of one.

        Each cell has one loop more, with the share of its level: `base`.
        """
        own = self.table[self.table["kind"] == kind]
        path, again = own["path"].to_numpy(), own["replay"].to_numpy()
        nobody = np.full(len(own), -1)
        told = {"both": (path, again), "path": (path, nobody), "replay": (nobody, again)}[way]
        known = (path >= 0) & (again >= 0) if way == "both" else np.maximum(*told) >= 0
        rows = own.assign(cell=parts_cells(*told))[known]
        sums = rows.groupby(["level", "cell"])[["loops", "true"]].sum().reset_index()
        every = own.groupby("level")[["loops", "true"]].sum()
        base = sums["level"].map(every["true"] / every["loops"])
        return sums.assign(base=base, probability=(sums["true"] + base) / (sums["loops"] + 1))

    def probability(
        self, kind: str, path: Floats, replayed: Floats, reach: float
    ) -> tuple[Floats, Floats]:
        """Return the probability that each loop (L,) is lost so, and the base rate.

        Between the mean reaches of two classes they change evenly with its logarithm. Not numbers
        beyond the outer ones, and where no way reached its end.
        """
        low, high = self.range()
        if not low / BEYOND <= reach <= high * BEYOND:
            return np.full(len(path), np.nan), np.full(len(path), np.nan)
        parts = parts_of(path), parts_of(replayed)
        cell, known = parts_cells(*parts), [(part >= 0).any() for part in parts]
        way = "both" if all(known) else "path" if known[0] else "replay"
        shares, found, bases = self.shares(kind, way), [], []
        for _, own in shares.groupby("level"):
            bases.append(own["base"].iloc[0])
            # A cell that no loop was in has the base rate.
            values = np.full(3 * PARTS + 2, bases[-1])
            values[own["cell"]] = own["probability"]
            found.append(np.where(cell < 0, np.nan, values[cell]))
        at = np.log(self.table.groupby("level")["reach"].mean().loc[shares["level"].unique()])
        place = np.log(reach)
        told = [np.interp(place, at, column) for column in np.array(found).T]
        return np.array(told), np.full(len(path), np.interp(place, at, bases))

    def left_out(self, kind: str) -> Floats:
        """Return what each series is told by all others, (n, 3): probability, loops, true ones.

        A row a cell of both ways.
        """
        rows = [np.zeros((0, 3))]
        known = (self.table[[*WAYS]] >= 0).all(axis=1)
        own = self.table[(self.table["kind"] == kind) & known]
        for (series, _), some in own.groupby(["series", "level"]):
            path, again = (
                np.where(some[way] < NEVER, (some[way] + 0.5) / PARTS, np.inf) for way in WAYS
            )
            reach = float(some["reach"].mean())
            said, _ = self.without(str(series)).probability(kind, path, again, reach)
            rows.append(np.column_stack([said, some["loops"], some["true"]]))
        found = np.concatenate(rows)
        return found[np.isfinite(found[:, 0])]


@cache
def calibration() -> Calibration:
    """Return the calibration that is stored beside this module."""
    stored = json.loads(CALIBRATION.read_text(encoding="utf-8"))
    return Calibration(pd.DataFrame(stored["rows"], columns=stored["columns"]), stored["made"])
