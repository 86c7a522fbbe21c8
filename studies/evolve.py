"""The study behind `grainloops evolve`."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from loops import Faces, InputError
from loops.arrays import Floats
from patterns import Snapshot
from stability import COMPONENTS, Stage, follow, programmes
from stability import Path as FollowedPath
from stability.packing import LoopRates, loop_changes, replay
from stability.packing.pathologies import columns
from stability.packing.state import nominal
from stability.path import Past, describe
from stability.programmes import NOTHING
from studies.output import UNITS, definitions, readable
from studies.paths.options import PROGRAMMES, programme_named
from studies.reading import plan_series, reading
from studies.series.evolution import components, sample_strain
from studies.series.loading import stress_of
from studies.series.packing import DEFAULT_RATE, Following, Rate, interval_rate
from studies.snapshot.in_packing import balance_notes, held_snapshot, hold_control
from studies.snapshot.table import loop_polygons
from studies.study import Results, one_of, study

By = Literal["events", "replay", "both"]
EVOLVED = (*PROGRAMMES, "proportional-strain", "simple-shear")
# A drop: the driven stress falls between two snapshots by more than this share of itself.
DROP = 1e-4
# Snapshots beyond the end of a path by less than this share of it are at its end: strains over the
# first cell of a compression differ by that from those over the first cell of the forecast.
END = 5e-3
# A path is given up after so many strain increments.
INTERVALS = 20_000
# Number of a wall in the table of events.
NO_GRAIN = -1


def run_evolve(
    paths: Sequence[Path],
    out: Path,
    *,
    to: float,
    programme: str = "drained",
    axis: int = 1,
    fluid_bulk_modulus: float | None = None,
    strain_ratio: float | None = None,
    rows: int = 20,
    interval: float = 5e-6,
    instabilities: int = 20,
    past: Past = "viscous",
    pathologies: bool = False,
    by: By = "events",
    inertial_number: float | None = None,
    times: Path | None = None,
    time_step: float | None = None,
    mean_mass: float | None = None,
    damping: float = 0.3,
    spread: bool = False,
    hold: bool = False,
    hold_stress: bool = False,
    cells: Path | None = None,
    force: bool = False,
    csv: bool = False,
    figures: bool = True,
    animation: bool = False,
    progress: Callable[[float], None] | None = None,
    **how: Any,
) -> dict[str, Any]:
    """Follow the first snapshot, write tables, figures and a report; return the summary.

    `how` are options of `read_planar`; later snapshots are compared with the path `by` events, with
    a `replay` by the equations of motion, or with both. The replay has the rate at which the code
    went on to the next snapshot, as in `run_series`. `hold` brings the first snapshot to rest at
    fixed cell before it is followed, `hold_stress` at fixed stress. `progress` is called with the
    strain or stress that the path has reached.
    """
    asked = {
        "programme": programme, "axis": axis, "to": to, "rows": rows, "interval": interval,
        "instabilities": instabilities, "past": past, "by": by, "damping": damping,
        "spread": spread,
    }  # fmt: skip
    numbers = {"fluid_bulk_modulus": fluid_bulk_modulus, "strain_ratio": strain_ratio}
    asked |= {name: value for name, value in numbers.items() if value is not None}
    asked |= {"pathologies": True} if pathologies else {}
    _require_events(by, {"--pathologies": pathologies, "--spread": spread})
    held_control = hold_control(hold, hold_stress)
    require_reach(programme, to, interval)
    stage, sense = stage_of(programme, axis, to, **numbers), float(np.sign(to))
    driven = driven_component(programme, axis)
    options = reading(**how) | asked | {"hold": held_control}
    configuration = {"paths": [*paths], "cells": cells, **options}
    with study("evolve", out, configuration, UNITS["evolve"], force=force, csv=csv) as results:
        planned = plan_series(paths, cells, reading(**how), times)
        snapshot, held = held_snapshot(planned[0].read(), held_control)
        after = [one.read() for one in planned[1:]]
        notes = [*snapshot.notes, *balance_notes(snapshot)]
        rate, ways = None, dict[str, FollowedPath]()
        if by != "replay":
            path = follow(
                snapshot, stage, closure="packing", max_steps=INTERVALS, rows=rows,
                interval=interval, instabilities=instabilities, past=past, spread=spread,
                progress=progress, pathologies=pathologies,
            )  # fmt: skip
            ways["events"] = path
        if by != "events":
            known = Following(past, inertial_number, time_step, mean_mass)
            rate = replay_rate(snapshot, after, [one.time for one in planned], known, stage)
            done = replay(snapshot, stage, rows=rows, damping=damping, **rate.options)
            said = f"{done.message}, inertial number {rate.inertial_number:.2g}"
            ways["replay"] = replace(done, message=said)
        # Tables and map are those of the first way; a replay beside a path has its own.
        way = next(iter(ways.values()))
        changes, rows_of_path, loops = _way_tables(snapshot, way, sense)
        events = event_table(way, snapshot.ids, sense)
        tables = {"path": rows_of_path, "events": events, "loops": loops}
        tables["grains"] = grain_table(way, snapshot.ids)
        if len(ways) > 1:
            _, replayed, tables["replay_loops"] = _way_tables(snapshot, ways["replay"], sense)
            tables["replay"] = replayed.drop(columns="events")
        if after:
            tables["dem"] = dem_table(snapshot, [one.name for one in planned[1:]], after)
        found = path_summary(way, tables, driven) | {"driven": driven, "notes": notes, "held": held}
        found |= {"dem": len(after), "mean_kn": snapshot.mean_kn, "forecast": None, "replay": None}
        if after and driven[0] == "H":
            tables["forecast"] = forecast_table(ways, tables["dem"], driven, sense)
            found["forecast"] = forecast_summary(tables["forecast"], [*ways])
        if rate is not None:
            rates = {"inertial_number": rate.inertial_number, "source": rate.source}
            contacts = snapshot.graph.contact_count
            beside = replay_summary(ways, tables, driven, contacts) if len(ways) > 1 else {}
            found["replay"] = rates | beside
        summary = results.write_results(tables, asked | found)
        if animation:
            from studies.packing_figures import animate_path

            # Nothing has moved at the start.
            works = [np.zeros(len(tables["loops"])), *(one.normalised_work for one in changes)]
            animate_path(snapshot, np.array(works), tables["path"], summary, results.folder)
        if figures:
            _draw(results, snapshot, f"Path of {readable(planned[0].name)}", tables, summary)
    return summary


def _require_events(by: By, asked: Mapping[str, bool]) -> None:
    """Raise `InputError` for options, by name, that need a path by events where there is none."""
    one_of("--by", by, get_args(By))
    for name, wanted in asked.items():
        if wanted and by == "replay":
            remedy = "Follow by events, or both."
            raise InputError(name, "--by replay", "a path by events", remedy)


def _way_tables(
    snapshot: Snapshot, way: FollowedPath, sense: float
) -> tuple[list[LoopRates], pd.DataFrame, pd.DataFrame]:
    """Return what happens to the loops up to each row, the table of rows and that of the loops."""
    faces = snapshot.faces
    changes = [loop_changes(snapshot.graph, state, faces) for state in way.states[1:]]
    loops = change_table(changes, faces, sense * way.parameter)
    offsets, _, grains = loop_polygons(snapshot.graph, faces)
    loops["grains"] = np.split(snapshot.ids[grains], offsets[1:-1])
    return changes, row_table(way, sense), loops


def _draw(
    results: Results,
    snapshot: Snapshot,
    title: str,
    tables: dict[str, Any],
    summary: dict[str, Any],
) -> None:
    """Draw the figures and the report."""
    from studies.packing_figures import path_figures
    from studies.snapshot.table import loops_for_map

    pictures = results.save_figures(path_figures(snapshot, tables, summary))
    maps = loops_for_map(snapshot, tables["loops"])
    results.write_report(title, summary, pictures, maps)


def require_reach(programme: str, to: float, interval: float) -> None:
    """Raise `InputError` for a strain that no cell can take, or no path of `INTERVALS` reaches."""
    if programme == "isotropic-stress":
        return
    if to >= 1:
        expected = "less than 1: there the cell has no length left (compression is positive)"
        raise InputError("--to", f"a strain of {to:g}", expected, "Give 1e-3, for example.")
    # An interval of zero is refused with the other options of the path.
    if abs(to) > INTERVALS * interval > 0:
        expected = f"at most {INTERVALS * interval:g}: {INTERVALS} intervals of {interval:g}"
        remedy = "Give a smaller strain, or larger intervals by --interval."
        raise InputError("--to", f"a strain of {to:g}", expected, remedy)


def driven_component(programme: str, axis: int) -> str:
    """Component of strain or stress that a programme drives."""
    if programme == "isotropic-stress":
        return "P11"
    if programme == "simple-shear":
        return f"H{axis}{3 - axis}"
    return "H11" if programme == "isotropic" else f"H{axis}{axis}"


def stage_of(programme: str, axis: int, to: float, **numbers: float | None) -> Stage:
    """Return the stage from the snapshot until the driven component has changed by `to`.

    `numbers` are those that the programme asks for (`programme_named`).
    """
    one_of("--programme", programme, EVOLVED)
    if not (np.isfinite(to) and to):
        remedy = "Give the strain to reach, negative in extension."
        raise InputError("--to", f"{to:g}", "a finite number other than zero", remedy)
    if axis not in (1, 2):
        raise InputError("--axis", f"{axis}", "1 or 2", "Name the axis that is driven.")
    sense = float(np.sign(to))
    if programme == "simple-shear":
        loading = programmes.simple_shear(axis, sense)  # type: ignore[arg-type]
    else:
        loading = programme_named(programme, rate=sense, axis=axis, **numbers)
    return Stage(loading, "parameter", abs(to))


def works_of(way: FollowedPath) -> dict[str, Floats]:
    """Return the columns of work, energy and imbalance; a replay has none."""
    if not len(way.work):
        return {}
    works = dict(zip(("work", "slip_work", "shear_work", "released"), way.work.T, strict=True))
    return works | {"energy": way.energy, "imbalance": way.imbalance}


def row_table(way: FollowedPath, sense: float) -> pd.DataFrame:
    """One row per recorded state."""
    ends = np.sort([event.parameter for event in way.events])
    return pd.DataFrame(
        {
            "row": np.arange(len(way.H)),
            "driven": sense * way.parameter,
            **components("H", way.H),
            **components("P", way.P),
            **works_of(way),
            "contacts": np.array([np.count_nonzero(state.closed) for state in way.states]),
            "events": np.searchsorted(ends, way.parameter, side="right"),
            **pathology_columns(way),
        }
    )


def pathology_columns(way: FollowedPath) -> dict[str, NDArray[Any]]:
    """Return the answers of `--pathologies` row by row, and instabilities so far; none without."""
    if not way.pathologies:
        return {}
    lost = np.sort([event.parameter for event in way.of_kind("instability")])
    so_far = np.searchsorted(lost, way.parameter, side="right")
    return {**columns(way.pathologies), "instabilities": so_far}


def event_table(way: FollowedPath, ids: NDArray[np.int64], sense: float) -> pd.DataFrame:
    """One row per event: kind, driven value, grains, continuation after an instability.

    A wall has the number -1.
    """
    contact = np.array([event.contacts[0] for event in way.events], dtype=int)
    end = way.states[-1]
    # Walls are the bodies behind the grains.
    grains = np.append(ids, np.full(len(end.walls), NO_GRAIN))[end.contacts[contact]]
    return pd.DataFrame(
        {
            "kind": np.array([event.kind for event in way.events], dtype=str),
            "driven": sense * np.array([event.parameter for event in way.events], dtype=float),
            "row": np.array([event.index for event in way.events], dtype=int),
            "contact": contact,
            "id1": grains[:, 0],
            "id2": grains[:, 1],
            "passed": np.array([event.passed for event in way.events], dtype=str),
            "detail": np.array([describe(event) for event in way.events], dtype=str),
        }
    )


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
    return pd.DataFrame(
        {
            "loop": np.arange(len(row)),
            "order": faces.order[faces.loops],
            "area": end.area,
            **components("H", end.strain),
            **components("P", end.stress),
            "W2": end.second_order_work,
            "w2": end.normalised_work,
            "additive_w": end.additive_work,
            "nonaffinity": end.nonaffinity,
            "negative_row": row,
            "negative_from": np.where(row > 0, driven[row], np.nan),
        }
    )


def replay_rate(
    snapshot: Snapshot,
    after: Sequence[Snapshot],
    times: Sequence[float | None],
    known: Following,
    stage: Stage,
) -> Rate:
    """Rate of the replay of a stage: that of the code until the next snapshot."""
    if known.inertial_number is None and not after:
        return Rate(DEFAULT_RATE, "no later snapshot", {"inertial_number": DEFAULT_RATE})
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


def forecast_table(
    ways: dict[str, FollowedPath], dem: pd.DataFrame, driven: str, sense: float
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
            beyond = (reached > strain[-1] * (1 + END)) | (reached < 0)
            table[f"{quantity}_{name}"] = np.where(beyond, np.nan, told)
    before = np.append(start.P[0, at], table["stress_dem"][:-1])
    table["drop"] = table["stress_dem"] - before < -DROP * np.abs(before)
    return table


def forecast_summary(table: pd.DataFrame, ways: Sequence[str]) -> dict[str, Any]:
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


def replay_summary(
    ways: Mapping[str, FollowedPath], tables: Mapping[str, pd.DataFrame], driven: str, contacts: int
) -> dict[str, Any]:
    """End of a replay beside a path, and how far their contact forces are apart there.

    The distance is None where the path ended before the replay.
    """
    path, other = ways["events"], ways["replay"]
    work = tables["replay_loops"]["W2"].dropna()
    last, end, first = (
        state.forces[:contacts] for state in (other.states[-1], path.states[-1], path.states[0])
    )
    apart = float(np.linalg.norm(end - last) / np.linalg.norm(last - first))
    return {
        "end": end_of(tables["replay"], driven),
        "negative_loops": float((work < 0).mean()) if len(work) else None,
        "path_from_replay": apart if path.status == "finished" else None,
    }


def end_of(rows: pd.DataFrame, driven: str) -> dict[str, float]:
    """Normal strains and stresses of the last row, and those of the driven axes."""
    names = dict.fromkeys(("H11", "H22", "P11", "P22", f"H{driven[1:]}", f"P{driven[1:]}"))
    return {name: float(rows[name].iloc[-1]) for name in names}


def path_summary(way: FollowedPath, tables: dict[str, pd.DataFrame], driven: str) -> dict[str, Any]:
    """Summary of a way and its tables."""
    last, work = tables["path"].iloc[-1], tables["loops"]["W2"].dropna()
    instabilities = [event for event in way.events if event.kind == "instability"]
    passed = Counter(event.passed for event in instabilities)
    return {
        "definitions": definitions("evolve"),
        "end": end_of(tables["path"], driven),
        "events": dict(Counter(event.kind for event in way.events)),
        "intervals": way.intervals,
        "limit": None if math.isnan(way.limit) else way.limit,
        "limit_spread": way.limit_spread if math.isfinite(way.limit_spread) else None,
        "loops": len(tables["loops"]),
        "message": way.message,
        "negative_loops": float((work < 0).mean()) if len(work) else None,
        "passed": {name or "other": count for name, count in passed.items()},
        "reached": float(last["driven"]),
        "status": way.status,
        "stress_spread": None if math.isnan(way.stress_spread) else way.stress_spread,
        "unstable_contacts": len({event.contacts for event in instabilities}),
        "work": float(last["work"]) if len(way.work) else None,
    }
