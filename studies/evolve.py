"""A packing followed through a programme: `gl.evolve`, and the study behind the command."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from loops import Faces, InputError
from loops.arrays import Flags, Floats, Integers
from loops.contacts import contacts_at_start
from loops.errors import check_choice, counted, number, whole_number
from loops.lazy import named
from loops.scene import Scene, Subject
from loops.shown import Shown
from patterns import Snapshot, planar
from stability import COMPONENTS, Stage, follow
from stability import Path as FollowedPath
from stability.packing import LoopRates, loop_changes, replay
from stability.packing.loop_quantities import loop_sums
from stability.path import describe
from stability.programmes import NOTHING, nominal
from studies.frames import row_table
from studies.output import Summary, components, readable, values_of
from studies.paths.options import ProgrammeName, programme_named
from studies.questions import Evolving, Holding, Replaying, options_of, taken
from studies.reading import plan_series, reading
from studies.series.evolution import sample_strain
from studies.series.packing import (
    DEFAULT_RATE,
    Rate,
    interval_rate,
    path_from_replay,
    stress_of,
)
from studies.snapshot.in_packing import balance_notes, held_snapshot
from studies.snapshot.regions import Property, compared, loop_regions
from studies.snapshot.table import loop_polygons
from studies.study import files_of, study

By = Literal["events", "replay", "both"]
EVOLVED = (*get_args(ProgrammeName), "simple-shear")
# A path is given up after so many strain increments.
INTERVALS = 20_000
# Programmes that drive one of the axes.
AXIAL = tuple(name for name in EVOLVED if not name.startswith(("isotropic", "simple")))
# Stresses that differ by less of themselves are equal.
EQUAL = 1e-9
# Number of a wall in the table of events.
NO_GRAIN = -1
# Share of itself by which the driven stress falls in a drop: a definition (docs/knobs.md).
DROP = 1e-4
# Snapshots beyond the end of a path by less than this share of it are at its end: strains over the
# first cell of a compression differ by that from those over the first cell of the forecast.
AT_THE_END = 5e-3


@dataclass(frozen=True, kw_only=True)
class Programmed(Evolving):
    """Options of `evolve`, see there; checked, with the stage that they make."""

    def __post_init__(self) -> None:
        check_choice("--by", self.by, get_args(By))
        for turn in self.turns:
            number("--to", turn)
        number("--interval", self.interval, 0.0, open_low=True)
        number("--damping", self.damping, 0.0)
        whole_number("--rows", self.rows, 0)
        for name in ("pathologies", "spread"):
            if getattr(self, name) and self.by == "replay":
                remedy = "Follow by events, or both."
                raise InputError(f"--{name}", "--by replay", "a path by events", remedy)
        if len(self.turns) > 1 and self.by != "events":
            remedy = "Follow by events, or to one value."
            raise InputError("--to", f"{self.to} with --by {self.by}", "one value", remedy)
        require_reach(self)
        _ = self.stages

    @property
    def stages(self) -> list[Stage]:
        """Return the stages from the present state to the end."""
        numbers = {"fluid_bulk_modulus": self.fluid_bulk_modulus, "strain_ratio": self.strain_ratio}
        ways, axis = np.diff([0.0, *self.turns]), 1 if self.axis is None else self.axis
        return [stage_of(self.programme, axis, way, **numbers) for way in ways.tolist()]

    @property
    def driven(self) -> str:
        """Return the component of strain or stress that is driven."""
        axis = self.axis or 1
        if self.programme == "simple-shear":
            return f"H{axis}{3 - axis}"
        named = {"isotropic": "H11", "isotropic-stress": "P11"}
        return named.get(self.programme, f"H{axis}{axis}")

    def along(self, scene: Scene) -> Programmed:
        """Return the options with their axis; left out it is that of the major stress."""
        if self.axis is not None or self.programme not in AXIAL:
            return replace(self, axis=self.axis or 1)
        return replace(self, axis=major_axis(contacts_at_start(scene).stress))

    def described(self) -> dict[str, Any]:
        """Return the options for the summary; those that only some programmes ask for if given."""
        some = ("fluid_bulk_modulus", "strain_ratio", "pathologies")
        return {k: v for k, v in asdict(self).items() if k not in some or v not in (None, False)}


@dataclass(frozen=True, eq=False, repr=False)
class Evolution(Shown):
    """A packing followed through a programme, and what that did to its grains and loops.

    Attributes
    ----------
    scene : Scene
        The packing at the start.
    ids : (G,) array of int
        Ids of its grains, as the file has them; numbers from 0 of a scene.
    driven : str
        Component that the programme drives: 'H11' a strain, 'P11' a stress (force/length).
    to : float or tuple of float
        Change of it that was asked for, positive in compression; where a cycle turns, and its end.
    ways : dict of Path
        'events': from event to event; 'replay': by the equations of motion. Each has R rows with
        the nominal strain `H` and stress `P`, (R, 4), and the packing there (`states`).
    """

    scene: Scene
    ids: Integers
    driven: str
    to: float | tuple[float, ...]
    ways: Mapping[str, FollowedPath]

    @property
    def sense(self) -> float:
        """Return 1 if it begins in compression, -1 in extension."""
        return float(np.sign(self.way.turns[0]))

    @property
    def way(self) -> FollowedPath:
        """Return the path by events, or the replay where there is none."""
        return next(iter(self.ways.values()))

    def facts(self) -> dict[str, object]:
        """Return the facts that the prompt and a notebook show."""
        unit = "strain" if self.driven[0] == "H" else "force/length"
        goals = ", ".join(f"{turn:g}" for turn in self.way.turns)
        told: dict[str, object] = {"driven": f"{self.driven} to {goals} ({unit})"}
        for name, way in self.ways.items():
            reached = way.driven(way.parameter, way.stage)[-1]
            told[name] = f"{way.status} at {reached:.4g}, {counted(len(way.events), 'event')}"
        return told | {"loops": len(self.scene.faces.loops)}

    def changes(self, name: str = "") -> list[LoopRates]:
        """Return what happens to the loops up to each row of a way, by default of the first."""
        way, faces = self.ways[name] if name else self.way, self.scene.faces
        return [loop_changes(self.scene.graph, state, faces) for state in way.states[1:]]

    def open_loops(self, way: FollowedPath) -> Flags:
        """Return which loops have an open contact in each row of a way, (R, L)."""
        contacts, faces = self.scene.graph.contact_count, self.scene.faces
        opened = (~state.closed[:contacts] for state in way.states)
        return np.array([loop_sums(row.astype(float), faces) > 0 for row in opened])

    def loops(self, name: str = "", changes: list[LoopRates] | None = None) -> pd.DataFrame:
        """Return a row a loop: its changes to the end of a way, the ids of its grains."""
        way, scene = self.ways[name] if name else self.way, self.scene
        changes = self.changes(name) if changes is None else changes
        driven = way.driven(way.parameter, way.stage)
        loops = change_table(changes, scene.faces, driven)
        opened = self.open_loops(way)
        some = opened.any(axis=0)
        loops["open_from"] = np.where(some, driven[opened.argmax(axis=0)], np.nan)
        loops["back"] = some & ~opened[-1]
        offsets, _, grains = loop_polygons(scene.graph, scene.faces)
        loops["grains"] = np.split(self.ids[grains], offsets[1:-1])
        return loops


def evolve(
    subject: Subject,
    programme: str = "drained",
    *,
    to: float | Sequence[float],
    inertial_number: float = DEFAULT_RATE,
    progress: Callable[[float], None] | None = None,
    **options: Any,
) -> Evolution:
    """Follow a packing through a programme, as `grainloops evolve` does.

    Parameters
    ----------
    subject : Scene or Snapshot
        A packing with forces, periodic or between known walls. The ids of the grains are kept.
    programme : str
        'drained' (nominal stress across the driven axis constant), 'cauchy-drained' or 'biaxial'
        (Cauchy stress), 'isotropic', 'isotropic-stress', 'oedometric', 'undrained',
        'proportional-strain', 'simple-shear'.
    to : float or sequence of float
        Change of the driven strain, or stress (force/length), positive in compression; of a cycle
        the values where it turns, and at last that of the end.
    inertial_number : float
        Rate of the replay, `|H'| sqrt(mean mass / p)`; above 0.
    progress : callable, optional
        Called with the strain or stress that the path has reached.
    **options
        `by` ('events', 'replay' or 'both'), `axis` (1 or 2; by default that of the major stress,
        for simple shear 1), `rows`, `interval`, `instabilities`,
        `past`, `spread` and `pathologies` of `follow`, `damping` of `replay`;
        `fluid_bulk_modulus` of 'undrained', `strain_ratio` of 'proportional-strain'.

    Returns
    -------
    Evolution
        `.ways` are the paths; `.table()` has a row a loop with the ids of its grains, the changes
        of its strain `H*` and stress `P*` (force/length), its second-order work `W2`
        (force/length; `w2` over the sizes of its factors) and the driven value from which it is
        negative, the driven value `open_from` of the first row with an open contact, and `back`,
        whether all contacts of such a loop are closed at the end.

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
    >>> found = gl.evolve(scene, "oedometric", to=1e-4, rows=2)
    >>> found.way.status, found.table()["H11"].round(9).tolist()
    ('finished', [0.0001, 0.0001, 0.0001, 0.0001])
    """
    turns = tuple(to) if isinstance(to, list | tuple | np.ndarray) and np.ndim(to) else to
    asked = options_of(Programmed, {"programme": programme, "to": turns, **options})
    snapshot = planar(subject)
    balance_notes(snapshot)
    number("inertial_number", inertial_number, 0.0, open_low=True)
    rate = Rate.from_rest(inertial_number, "as given")
    return followed(snapshot, asked.along(snapshot.scene), rate, progress)


def followed(
    snapshot: Snapshot,
    asked: Programmed,
    rate: Rate | None,
    progress: Callable[[float], None] | None = None,
) -> Evolution:
    """Follow a packing as it is asked, the replay at this rate."""
    scene, ways = snapshot.scene, dict[str, FollowedPath]()
    if asked.by != "replay":
        ways["events"] = follow(
            scene, asked.stages, closure="packing", max_steps=INTERVALS, rows=asked.rows,
            interval=asked.interval, instabilities=asked.instabilities, past=asked.past,
            spread=asked.spread, progress=progress, pathologies=asked.pathologies,
        )  # fmt: skip
    if asked.by != "events":
        assert rate is not None
        # Without rows in between the end is kept, as by a path.
        how: dict[str, Any] = {"rows": max(1, asked.rows), "damping": asked.damping}
        done = replay(scene, asked.stages[0], **how, **rate.options)
        said = f"{done.message}, inertial number {rate.inertial_number:.2g}"
        ways["replay"] = replace(done, message=said)
    ways = {name: replace(way, turns=asked.turns) for name, way in ways.items()}
    return Evolution(scene, snapshot.ids, asked.driven, asked.to, ways)


def run_evolve(
    paths: Sequence[Path],
    out: Path,
    *,
    cells: Path | None = None,
    regions: str | None = None,
    animation: bool = False,
    progress: Callable[[float], None] | None = None,
    **how: Any,
) -> Summary:
    """Follow the first snapshot, write tables, figures and a report; return the summary.

    `how` are options of `evolve`, of `Replaying`, `Holding` and `read_planar`, and files of
    `study`; later snapshots are compared with the path `by` events, with a `replay` by the
    equations of motion, or with both. The replay has the rate at which the code went on to the next
    snapshot, as in `run_series`.
    """
    files = files_of(how)
    asked: Any = taken(Programmed, how)
    rates, control = taken(Replaying, how), taken(Holding, how).control
    configuration = {"paths": [*paths], "cells": cells, **reading(**how), **asked.described()}
    configuration |= {"hold": control} | ({} if regions is None else {"regions": regions})
    with study("evolve", out, configuration, **files) as results:
        planned = plan_series(paths, cells, reading(**how), rates.times)
        snapshot, held = held_snapshot(planned[0].read(), control)
        scene, asked = snapshot.scene, asked.along(snapshot.scene)
        if regions is not None:
            # A column that there is not is refused before the path.
            still = [loop_changes(scene.graph, contacts_at_start(scene), scene.faces)]
            loop_regions(change_table(still, scene.faces, np.zeros(1)), regions)
        after = [one.read() for one in planned[1:]]
        notes, rate = [*snapshot.notes, *balance_notes(snapshot)], None
        if asked.by != "events":
            moments = [one.time for one in planned]
            rate = replay_rate(snapshot, after, moments, rates, asked.stages[0])
        found = followed(snapshot, asked, rate, progress)
        changes = found.changes()
        tables = {
            "path": row_table(found.way),
            "events": event_table(found.way, found.ids),
            "loops": found.loops(changes=changes),
            "grains": grain_table(found.way, found.ids),
        }
        if len(found.ways) > 1:
            tables["replay_loops"] = found.loops("replay")
            tables["replay"] = row_table(found.ways["replay"]).drop(columns="events")
        if after:
            tables["dem"] = dem_table(snapshot, [one.name for one in planned[1:]], after)
        told = evolution_summary(found, tables, rate) | {"notes": notes, "held": held}
        told |= asked.described() | {"dem": len(after), "forecast": None}
        if regions is not None:
            tables["regions"], told["regions"] = evolved_regions(tables["loops"], regions)
        if after and found.driven[0] == "H" and len(asked.turns) == 1:
            compared = found.ways, tables["dem"], found.driven, found.sense
            tables["forecast"] = dem_comparison(*compared)
            told["forecast"] = dem_comparison_summary(tables["forecast"], [*found.ways])
        title = f"Path of {readable(planned[0].name)}"
        summary = results.write_packing(title, snapshot, found, tables, told)
        if animation:
            # Nothing has moved at the start.
            works = [np.zeros(len(tables["loops"])), *(one.normalised_work for one in changes)]
            animate = named("studies.packing_figures.animate_path")
            animate(snapshot, np.array(works), tables["path"], summary, results.folder)
    return summary


def evolved_regions(loops: pd.DataFrame, regions: str) -> tuple[pd.DataFrame, Summary]:
    """Return loops inside a region and elsewhere by order: work, contacts lost; their summary."""
    work, opened = loops["W2"].to_numpy(), loops["open_from"].notna().to_numpy()
    found = {
        "negative": Property(work < 0, np.isfinite(work)),
        "opened": Property(opened, np.ones(len(loops), dtype=bool)),
    }
    places, summary = compared(loops, regions, found)
    return pd.DataFrame(places), summary


def evolution_summary(
    found: Evolution, tables: dict[str, pd.DataFrame], rate: Rate | None
) -> Summary:
    """Return the summary of the first way, and of a replay its rate; its end beside a path."""
    way, driven, last = found.way, found.driven, tables["path"].iloc[-1]
    instabilities = way.of_kind("instability")
    passed = Counter(event.passed for event in instabilities)
    again = None
    if rate is not None:
        again = {"inertial_number": rate.inertial_number, "source": rate.source}
        again |= beside_path(found, tables) if len(found.ways) > 1 else {}
    return {
        **start_of(contacts_at_start(found.scene).stress),
        "driven": driven,
        "end": end_of(tables["path"], driven),
        "events": dict(Counter(event.kind for event in way.events)),
        **values_of(way, "intervals", "message", "status"),
        "limit": None if math.isnan(way.limit) else way.limit,
        "limit_spread": way.limit_spread if math.isfinite(way.limit_spread) else None,
        "loops": len(tables["loops"]),
        "opened": int(tables["loops"]["open_from"].notna().sum()),
        "back": int(tables["loops"]["back"].sum()),
        "negative_loops": negative_share(tables["loops"]),
        "passed": {name or "other": count for name, count in passed.items()},
        "reached": float(last["driven"]),
        "replay": again,
        "stress_spread": None if math.isnan(way.stress_spread) else way.stress_spread,
        "unstable_contacts": len({event.contacts for event in instabilities}),
        "work": float(last["work"]) if len(way.work) else None,
    }


def negative_share(loops: pd.DataFrame) -> float | None:
    """Return the share of the loops with negative work, of those with a known one."""
    work = loops["W2"].dropna()
    return float((work < 0).mean()) if len(work) else None


def beside_path(found: Evolution, tables: Mapping[str, pd.DataFrame]) -> Summary:
    """End of a replay beside a path, and how far their contact forces are apart there.

    The distance is None where the path ended before the replay.
    """
    path, end = found.ways["events"], found.ways["replay"].states[-1]
    apart = path_from_replay(path, end, found.scene.graph.contact_count)
    return {
        "end": end_of(tables["replay"], found.driven),
        "negative_loops": negative_share(tables["replay_loops"]),
        "path_from_replay": apart if path.status == "finished" else None,
    }


def start_of(stress: Floats) -> Summary:
    """Return the stress (2, 2) at the start, and its major axis."""
    normal = {"P11": float(stress[0, 0]), "P22": float(stress[1, 1])}
    return {"start": normal, "major_axis": major_axis(stress)}


def require_reach(asked: Programmed) -> None:
    """Raise `InputError` for a strain that no cell can take, or no path of `INTERVALS` reaches."""
    if asked.programme == "isotropic-stress":
        return
    if max(asked.turns) >= 1:
        expected = "less than 1: there the cell has no length left (compression is positive)"
        received = f"a strain of {max(asked.turns):g}"
        raise InputError("--to", received, expected, "Give 1e-3, for example.")
    if asked.length > INTERVALS * asked.interval:
        expected = f"at most {INTERVALS * asked.interval:g}: {INTERVALS} intervals of "
        remedy = "Give a smaller strain, or larger intervals by --interval."
        received = "a strain of " + ", ".join(f"{turn:g}" for turn in asked.turns)
        raise InputError("--to", received, f"{expected}{asked.interval:g}", remedy)


def major_axis(stress: Floats) -> int:
    """Return the axis with the larger normal stress of (2, 2); 1 if they are equal."""
    return 2 if stress[1, 1] > stress[0, 0] + EQUAL * abs(stress[0, 0]) else 1


def stage_of(programme: str, axis: int, to: float, **numbers: float | None) -> Stage:
    """Return the stage from the snapshot until the driven component has changed by `to`.

    `numbers` are those that the programme asks for (`programme_named`).
    """
    check_choice("--programme", programme, EVOLVED)
    if not to:
        remedy = "Give the strain to reach, negative in extension."
        raise InputError("--to", f"{to:g}", "a finite number other than zero", remedy)
    check_choice("--axis", axis, (1, 2))
    sense = float(np.sign(to))
    loading = programme_named(programme, rate=sense, axis=axis, **numbers)
    return Stage(loading, "parameter", abs(to))


def event_table(way: FollowedPath, ids: NDArray[np.int64]) -> pd.DataFrame:
    """One row per event of a contact: kind, driven value, grains, continuation if unstable.

    A wall has the number -1. Turns of a cycle are none.
    """
    events = [event for event in way.events if event.contacts]
    contact = np.array([event.contacts[0] for event in events], dtype=int)
    end = way.states[-1]
    # Walls are the bodies behind the grains.
    grains = np.append(ids, np.full(len(end.walls), NO_GRAIN))[end.contacts[contact]]
    at = np.array([event.parameter for event in events], dtype=float)
    stage = np.array([event.stage for event in events], dtype=int)
    table = {
        "kind": np.array([event.kind for event in events], dtype=str),
        "driven": way.driven(at, stage),
        "row": np.array([event.index for event in events], dtype=int),
        "contact": contact,
        "id1": grains[:, 0],
        "id2": grains[:, 1],
        "passed": np.array([event.passed for event in events], dtype=str),
        "detail": np.array([describe(event) for event in events], dtype=str),
    }
    return pd.DataFrame(table)


def grain_table(way: FollowedPath, ids: NDArray[np.int64]) -> pd.DataFrame:
    """One row per grain with its id in the file: where it ends, and how it got there."""
    start, end, count = way.states[0], way.states[-1], len(ids)
    moved = (end.x - start.x)[:count]
    affine = start.x[:count] @ (end.cell @ np.linalg.inv(start.cell) - np.eye(2)).T
    carrying = end.contacts[end.closed]
    return pd.DataFrame(
        {
            "id": ids, "x": end.x[:count, 0], "y": end.x[:count, 1], "radius": end.radii[:count],
            "theta_z": (end.angle - start.angle)[:count],
            "dx": moved[:, 0], "dy": moved[:, 1],
            "beyond": np.hypot(*(moved - affine).T),
            "contacts": np.bincount(carrying.ravel(), minlength=len(end.x))[:count],
        }
    )  # fmt: skip


def change_table(changes: list[LoopRates], faces: Faces, driven: Floats) -> pd.DataFrame:
    """One row per loop: changes up to the end of the path, and the first row of negative work."""
    end = changes[-1]
    negative = np.array([change.second_order_work < 0 for change in changes])
    row = np.where(negative.any(axis=0), 1 + np.argmax(negative, axis=0), -1)
    e = end.strain
    table = {
        "loop": np.arange(len(row)),
        "order": faces.order[faces.loops],
        "area": end.area,
        **components("H", end.strain),
        **components("P", end.stress),
        "W2": end.second_order_work,
        "w2": end.normalised_work,
        "additive_w": end.additive_work,
        "shear": np.hypot(0.5 * (e[:, 0, 0] - e[:, 1, 1]), 0.5 * (e[:, 0, 1] + e[:, 1, 0])),
        "nonaffinity": end.nonaffinity,
        "negative_row": row,
        "negative_from": np.where(row > 0, driven[row], np.nan),
    }
    return pd.DataFrame(table)


def end_of(rows: pd.DataFrame, driven: str) -> dict[str, float]:
    """Normal strains and stresses of the last row, and those of the driven axes."""
    names = dict.fromkeys(("H11", "H22", "P11", "P22", f"H{driven[1:]}", f"P{driven[1:]}"))
    return {name: float(rows[name].iloc[-1]) for name in names}


def replay_rate(
    snapshot: Snapshot,
    after: Sequence[Snapshot],
    times: Sequence[float | None],
    known: Replaying,
    stage: Stage,
) -> Rate:
    """Rate of the replay of a stage: that of the code until the next snapshot."""
    if known.inertial_number is None and not after:
        return Rate.from_rest(DEFAULT_RATE, "no later snapshot")
    H = np.eye(2) if not after else sample_strain(snapshot, after[0])[0]
    found = interval_rate(snapshot, after[0] if after else snapshot, H, times[:2], known)
    if "duration" not in found.options:
        return found
    # The driven strains of the stage, in the time that the code takes for them.
    driven = stage.programme.equations(NOTHING, NOTHING)[1].T @ stage.programme.rate
    ahead = float(driven @ H.ravel()) / float(driven @ driven) if driven.any() else 0.0
    if ahead > 0:
        duration = found.options["duration"] * stage.target / ahead
        return found._replace(options=found.options | {"duration": duration})
    return found._replace(options={"inertial_number": found.inertial_number})


def dem_table(snapshot: Snapshot, names: Sequence[str], later: Sequence[Snapshot]) -> pd.DataFrame:
    """Strain and nominal stress of the later snapshots, over the cell of the first."""
    strains, stresses = [], []
    for name, after in zip(names, later, strict=True):
        after.mechanics()
        H, source = sample_strain(snapshot, after)
        if source not in ("cell", "walls"):
            raise InputError(name, "no cell", "the cell of a later state", "Give --cells.")
        strains.append(H)
        stresses.append(nominal(stress_of(after), H))
    return pd.DataFrame(
        {
            "snapshot": names,
            **components("H", np.array(strains)),
            **components("P", np.array(stresses)),
        }
    )


def dem_comparison(
    ways: Mapping[str, FollowedPath], dem: pd.DataFrame, driven: str, sense: float
) -> pd.DataFrame:
    """One row per snapshot of the DEM: its driven stress and volume, and those of each way there.

    Empty beyond the end of a way. `persistence` is the stress of the start.
    """
    stress, at = f"P{driven[1:]}", COMPONENTS.index(driven[1:])
    start = next(iter(ways.values()))
    table = pd.DataFrame(
        {
            "snapshot": dem["snapshot"],
            "driven": dem[driven],
            "stress_dem": dem[stress],
            "volume_dem": dem["H11"] + dem["H22"],
            "stress_persistence": start.P[0, at],
        }
    )
    for name, way in ways.items():
        # Ascending, as interpolation wants it.
        strain, reached = sense * way.H[:, at], sense * dem[driven]
        for quantity, values in (("stress", way.P[:, at]), ("volume", way.H[:, [0, 3]].sum(1))):
            told = np.interp(reached, strain, values)
            beyond = (reached > strain[-1] * (1 + AT_THE_END)) | (reached < 0)
            table[f"{quantity}_{name}"] = np.where(beyond, np.nan, told)
    before = np.append(start.P[0, at], table["stress_dem"][:-1])
    table["drop"] = table["stress_dem"] - before < -DROP * np.abs(before)
    return table


def dem_comparison_summary(table: pd.DataFrame, ways: Sequence[str]) -> Summary:
    """Errors of each way and of persistence, drops of stress predicted and missed, and how far.

    `holds_to` is the driven strain up to which the error, over all snapshots until there, is less
    than half of that of persistence; `lead` that of the last drop predicted.
    """
    told, start = {}, table["stress_persistence"].iloc[0]
    rest = start - table["stress_dem"].to_numpy()
    for name in ways:
        stress = table[f"stress_{name}"].to_numpy()
        known = np.isfinite(stress)
        error = (stress - table["stress_dem"].to_numpy())[known]
        better = np.cumsum(error**2) < 0.25 * np.cumsum(rest[known] ** 2)
        ahead = int(np.argmin(better)) if not better.all() else len(better)
        before = np.append(start, stress[:-1])
        falls = known & (stress - before < -DROP * np.abs(before))
        drops = table["drop"].to_numpy() & known
        found = np.flatnonzero(falls & drops)
        told[name] = {
            "snapshots": int(known.sum()),
            "error": float(np.sqrt(np.mean(error**2))) if len(error) else None,
            "persistence_error": float(np.sqrt(np.mean(rest[known] ** 2))) if len(error) else None,
            "holds_to": float(table["driven"].iloc[ahead - 1]) if ahead else 0.0,
            "drops": int(drops.sum()),
            "drops_predicted": len(found),
            "drops_missed": int((drops & ~falls).sum()),
            "drops_false": int((falls & ~drops).sum()),
            "lead": float(table["driven"].iloc[found[-1]]) if len(found) else None,
        }
    return told
