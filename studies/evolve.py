"""The study behind `grainloops evolve`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from loops import Faces, InputError
from loops.arrays import Floats
from patterns import Snapshot
from stability import Stage, follow
from stability.packing import LoopRates, PackingPath, loop_changes
from stability.packing.state import start_state
from stability.paths.path import Event, Past
from studies.output import definitions, readable
from studies.paths.options import PROGRAMMES
from studies.series.evolution import components, sample_strain
from studies.series.plan import PlannedSnapshot, plan_series
from studies.snapshot.held import held_snapshot, hold_control
from studies.snapshot.in_packing import balance_notes, followed_walls
from studies.snapshot.run import reading
from studies.study import one_of, study

# A path is given up after so many strain increments.
INTERVALS = 20_000
# Number of a wall in the table of events.
NO_GRAIN = -1
UNITS = (
    "as the input's: stress = force/length (two dimensions), work = force times length; H and P "
    "over the cell of the first snapshot"
)


def run_evolve(
    paths: Sequence[Path],
    out: Path,
    *,
    to: float,
    programme: str = "drained",
    axis: int = 1,
    rows: int = 20,
    interval: float = 5e-6,
    instabilities: int = 20,
    past: Past = "viscous",
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

    `how` are options of `read_planar`; later snapshots are plotted for comparison. `hold` brings
    the first to rest at fixed cell before it is followed, `hold_stress` at fixed stress.
    `progress` is called with the strain or stress that the path has reached.
    """
    asked = {
        "programme": programme,
        "axis": axis,
        "to": to,
        "rows": rows,
        "interval": interval,
        "instabilities": instabilities,
        "past": past,
    }
    held_control = hold_control(hold, hold_stress)
    require_reach(programme, to, interval)
    stage, sense = stage_of(programme, axis, to), float(np.sign(to))
    if programme.startswith("isotropic"):
        component = "P11" if programme == "isotropic-stress" else "H11"
    else:
        component = f"H{axis}{axis}"
    configuration = {
        "paths": [*paths],
        "cells": cells,
        **reading(**how),
        **asked,
        "hold": held_control,
    }
    with study("evolve", out, configuration, UNITS, force=force, csv=csv) as results:
        first, *later = plan_series(paths, cells, reading(**how))
        snapshot, held = held_snapshot(first.read(), held_control)
        law, _ = snapshot.mechanics()
        notes = [*snapshot.notes, *balance_notes(snapshot)]
        planes, force_of_walls = followed_walls(snapshot)
        path = follow(
            snapshot.graph,
            law,
            stage,
            closure="packing",
            max_steps=INTERVALS,
            rows=rows,
            interval=interval,
            instabilities=instabilities,
            past=past,
            progress=progress,
            planes=planes,
            plane_force=force_of_walls,
        )
        faces, driven = snapshot.faces, sense * path.parameter
        changes = [loop_changes(snapshot.graph, state, faces) for state in path.states[1:]]
        tables = {
            "path": packing_path_table(path, driven),
            "events": event_table(path, snapshot.ids, sense),
            "loops": change_table(changes, faces, driven),
        }
        if later:
            tables["dem"] = dem_table(snapshot, later)
        results.write_tables(tables)
        found = path_summary(path, tables) | {"driven": component, "notes": notes}
        found |= {"dem": len(later), "held": held, "mean_kn": snapshot.mean_kn}
        summary = results.write_summary(asked | found)
        if animation:
            from studies.evolve_figures import animate_path

            # Nothing has moved at the start.
            works = [np.zeros(len(tables["loops"])), *(one.normalised_work for one in changes)]
            animate_path(snapshot, np.array(works), tables["path"], summary, results.folder)
        if figures:
            from studies.evolve_figures import path_figures
            from studies.snapshot.polygons import loops_for_map

            pictures = results.save_figures(path_figures(snapshot, tables, summary))
            maps = loops_for_map(snapshot, tables["loops"])
            results.write_report(f"Path of {readable(first.name)}", summary, pictures, maps)
    return summary


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


def stage_of(programme: str, axis: int, to: float) -> Stage:
    """Stage that runs a programme from the snapshot until its driven component changes by `to`."""
    one_of("--programme", programme, tuple(PROGRAMMES))
    if not (np.isfinite(to) and to):
        remedy = "Give the strain to reach, negative in extension."
        raise InputError("--to", f"{to:g}", "a finite number other than zero", remedy)
    if axis not in (1, 2):
        raise InputError("--axis", f"{axis}", "1 or 2", "Name the axis that is driven.")
    sense = float(np.sign(to))
    isotropic = programme.startswith("isotropic")
    given = {"rate": sense} if isotropic else {"rate": sense, "axis": axis}
    return Stage(PROGRAMMES[programme](**given), "parameter", abs(to))


def packing_path_table(path: PackingPath, driven: Floats) -> pd.DataFrame:
    """One row per recorded state of the path."""
    terms = ("work", "slip_work", "shear_work", "released")
    work = dict(zip(terms, path.work.T, strict=True))
    ends = np.array([event.parameter for event in path.events])
    return pd.DataFrame(
        {
            "row": np.arange(len(path)),
            "driven": driven,
            **components("H", path.H),
            **components("P", path.P),
            **work,
            "energy": path.energy,
            "imbalance": path.imbalance,
            "contacts": np.array([np.count_nonzero(state.closed) for state in path.states]),
            "events": np.searchsorted(np.sort(ends), path.parameter, side="right"),
        }
    )


def event_table(path: PackingPath, ids: NDArray[np.int64], sense: float) -> pd.DataFrame:
    """One row per event: kind, driven value, grains, continuation after an instability.

    A wall has the number -1.
    """
    contact = np.array([event.contacts[0] for event in path.events], dtype=int)
    end = path.states[-1]
    # Walls are the bodies behind the grains.
    grains = np.append(ids, np.full(len(end.walls), NO_GRAIN))[end.contacts[contact]]
    return pd.DataFrame(
        {
            "kind": np.array([event.kind for event in path.events], dtype=str),
            "driven": sense * np.array([event.parameter for event in path.events], dtype=float),
            "row": np.array([event.index for event in path.events], dtype=int),
            "contact": contact,
            "id1": grains[:, 0],
            "id2": grains[:, 1],
            "passed": np.array([_passed(event) for event in path.events], dtype=str),
            "detail": np.array([event.detail for event in path.events], dtype=str),
        }
    )


def _passed(event: Event) -> str:
    """Continuation after an instability (dragged, held, ...); '' for other events."""
    words = event.detail.split("; ")[1:] if event.kind == "instability" else []
    return next((word for word in words if not word.endswith("released")), "")


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


def dem_table(snapshot: Snapshot, later: Sequence[PlannedSnapshot]) -> pd.DataFrame:
    """Strain and nominal stress of the later snapshots, over the cell of the first."""
    strains, stresses = [], []
    for one in later:
        after = one.read()
        after.mechanics()
        H, source = sample_strain(snapshot, after)
        if source not in ("cell", "walls"):
            raise InputError(one.name, "no cell", "the cell of a later state", "Give --cells.")
        F = np.eye(2) - H
        stress = start_state(after.graph, *followed_walls(after)).stress
        strains.append(H)
        stresses.append(np.linalg.det(F) * stress @ np.linalg.inv(F).T)
    return pd.DataFrame(
        {
            "snapshot": [one.name for one in later],
            **components("H", np.array(strains)),
            **components("P", np.array(stresses)),
        }
    )


def path_summary(path: PackingPath, tables: dict[str, pd.DataFrame]) -> dict[str, Any]:
    """Summary of a path and its tables."""
    end, work = tables["path"].iloc[-1], tables["loops"]["W2"].dropna()
    instabilities = path.of_kind("instability")
    passed = Counter(_passed(event) for event in instabilities)
    return {
        "definitions": definitions("evolve"),
        "end": {name: float(end[name]) for name in ("H11", "H22", "P11", "P22")},
        "events": dict(Counter(event.kind for event in path.events)),
        "intervals": path.intervals,
        "loops": len(tables["loops"]),
        "message": path.message,
        "negative_loops": float((work < 0).mean()) if len(work) else None,
        "passed": {name or "other": count for name, count in passed.items()},
        "reached": float(end["driven"]),
        "status": path.status,
        "unstable_contacts": len({event.contacts for event in instabilities}),
        "work": path.work[-1, 0],
    }
