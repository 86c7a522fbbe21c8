"""From a snapshot on by events: the path, its events, what every loop did, the DEM beside it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from loops import Faces, InputError
from loops.arrays import Floats
from patterns import Snapshot
from stability import COMPONENTS, Stage, follow
from stability.packing import LoopRates, PackingPath, loop_changes
from stability.packing.state import start_state
from stability.paths.path import Event, Past
from studies.columns import definitions
from studies.output import provenance, readable, result_folder, write_results
from studies.paths.options import PROGRAMMES
from studies.series.evolution import cell_strain
from studies.series.plan import PlannedSnapshot, plan_series
from studies.snapshot.edge import balance_notes
from studies.snapshot.source import read_planar, reading

Columns = dict[str, NDArray[Any]]

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
    cells: Path | None = None,
    force: bool = False,
    csv: bool = False,
    figures: bool = True,
    animation: bool = False,
    **how: Any,
) -> dict[str, Any]:
    """Follow the first snapshot, write tables, figures and a report; the summary.

    Snapshots are read with the options `how` of `read_planar`; the later ones are laid over.
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
    stage = stage_of(programme, axis, to)
    with result_folder(out, force=force) as folder:
        first, *later = plan_series(paths, cells, reading(**how))
        snapshot = read_planar(first.path, **first.how)
        law, _ = snapshot.mechanics()
        notes = balance_notes(snapshot)
        path = follow(
            snapshot.graph,
            law,
            stage,
            closure="packing",
            rows=rows,
            interval=interval,
            instabilities=instabilities,
            past=past,
        )
        faces = snapshot.faces
        changes = [loop_changes(snapshot.graph, state, faces) for state in path.states[1:]]
        driven = np.sign(to) * path.parameter
        tables = {
            "path": path_table(path, driven),
            "events": event_table(path, snapshot.ids, np.sign(to)),
            "loops": loop_table(changes, faces, driven),
        }
        if later:
            tables["dem"] = dem_table(snapshot, later)
        made = provenance(
            "evolve", {"paths": [*paths], "cells": cells, **reading(**how), **asked}, UNITS
        )
        summary = asked | path_summary(snapshot, path, tables, _driven(programme, axis))
        summary |= {"notes": [*snapshot.notes, *notes], "provenance": made}
        write_results(folder, summary, tables, csv=csv)
        if animation:
            from studies.evolve.figures import animate_path

            # Nothing has moved at the start.
            works = [0.0 * tables["loops"]["area"], *(one.normalised_work for one in changes)]
            animate_path(snapshot, faces, np.array(works), tables["path"], summary, folder)
        if figures:
            _draw(snapshot, tables, summary, folder, first.name)
    return summary


def stage_of(programme: str, axis: int, to: float) -> Stage:
    """The programme from where the snapshot is until what it drives has changed by `to`."""
    if programme not in PROGRAMMES:
        raise InputError(
            "--programme", repr(programme), f"one of {', '.join(PROGRAMMES)}", "Name one of them."
        )
    if not (np.isfinite(to) and to):
        remedy = "Give the strain to reach, negative in extension."
        raise InputError("--to", f"{to:g}", "a finite number other than zero", remedy)
    if axis not in (1, 2):
        raise InputError("--axis", f"{axis}", "1 or 2", "Name the axis that is driven.")
    sense = float(np.sign(to))
    isotropic = programme.startswith("isotropic")
    given = {"rate": sense} if isotropic else {"rate": sense, "axis": axis}
    return Stage(PROGRAMMES[programme](**given), "parameter", abs(to))


def _driven(programme: str, axis: int) -> str:
    """Name of the component that the programme drives."""
    if programme.startswith("isotropic"):
        return "P11" if programme == "isotropic-stress" else "H11"
    return f"H{axis}{axis}"


def _components(name: str, values: Floats) -> Columns:
    parts = values.reshape(-1, 4).T
    return {f"{name}{ij}": part for ij, part in zip(COMPONENTS, parts, strict=True)}


def path_table(path: PackingPath, driven: Floats) -> Columns:
    """One row a row of the path."""
    terms = ("work", "slip_work", "shear_work", "released")
    work = dict(zip(terms, path.work.T, strict=True))
    ends = np.array([event.parameter for event in path.events])
    return {
        "row": np.arange(len(path)),
        "driven": driven,
        **_components("H", path.H),
        **_components("P", path.P),
        **work,
        "energy": path.energy,
        "imbalance": path.imbalance,
        "contacts": np.array([np.count_nonzero(state.closed) for state in path.states]),
        "events": np.searchsorted(np.sort(ends), path.parameter, side="right"),
    }


def event_table(path: PackingPath, ids: NDArray[np.int64], sense: float) -> Columns:
    """One row an event: what, where, between which grains, how an instability was passed."""
    contact = np.array([event.contacts[0] for event in path.events], dtype=int)
    grains = ids[path.states[-1].contacts[contact]]
    return {
        "kind": np.array([event.kind for event in path.events], dtype=str),
        "driven": sense * np.array([event.parameter for event in path.events], dtype=float),
        "row": np.array([event.index for event in path.events], dtype=int),
        "contact": contact,
        "id1": grains[:, 0],
        "id2": grains[:, 1],
        "passed": np.array([_passed(event) for event in path.events], dtype=str),
        "detail": np.array([event.detail for event in path.events], dtype=str),
    }


def _passed(event: Event) -> str:
    """'dragged', 'held', 'replayed', 'stopped' or 'lost'; '' if it isn't an instability."""
    words = event.detail.split("; ")[1:] if event.kind == "instability" else []
    return next((word for word in words if not word.endswith("released")), "")


def loop_table(changes: list[LoopRates], faces: Faces, driven: Floats) -> Columns:
    """One row a loop: what it did to the end of the path, and when its work turned negative."""
    end = changes[-1]
    negative = np.array([change.second_order_work < 0 for change in changes])
    row = np.where(negative.any(axis=0), 1 + np.argmax(negative, axis=0), -1)
    return {
        "loop": np.arange(len(row)),
        "order": faces.order[faces.loops],
        "area": end.area,
        **_components("H", end.strain),
        **_components("P", end.stress),
        "W2": end.second_order_work,
        "w2": end.normalised_work,
        "additive_w": end.additive_work,
        "nonaffinity": end.nonaffinity,
        "negative_row": row,
        "negative_from": np.where(row > 0, driven[row], np.nan),
    }


def dem_table(snapshot: Snapshot, later: Sequence[PlannedSnapshot]) -> Columns:
    """Strain and nominal stress of the DEM's own next states, over the first cell."""
    start = snapshot.graph.cell
    assert start is not None
    strains, stresses = [], []
    for one in later:
        after = read_planar(one.path, **one.how)
        after.mechanics()
        if after.graph.cell is None:
            raise InputError(one.name, "no cell", "the cell of a later state", "Give --cells.")
        H = cell_strain(start, after.graph.cell)
        F = np.eye(2) - H
        strains.append(H)
        stresses.append(np.linalg.det(F) * start_state(after.graph).stress @ np.linalg.inv(F).T)
    return {
        "snapshot": np.array([one.name for one in later]),
        **_components("H", np.array(strains)),
        **_components("P", np.array(stresses)),
    }


def path_summary(
    snapshot: Snapshot, path: PackingPath, tables: dict[str, Columns], driven: str
) -> dict[str, Any]:
    """The numbers that a path comes down to."""
    law, _ = snapshot.mechanics()
    loops, reached = tables["loops"], float(tables["path"]["driven"][-1])
    known = np.isfinite(loops["W2"])
    held = Counter(_passed(event) for event in path.of_kind("instability"))
    return {
        "definitions": definitions("evolve"),
        "dem": len(tables["dem"]["snapshot"]) if "dem" in tables else 0,
        "driven": driven,
        "end": {name: tables["path"][name][-1] for name in ("H11", "H22", "P11", "P22")},
        "events": dict(Counter(event.kind for event in path.events)),
        "intervals": path.intervals,
        "loops": len(known),
        "mean_kn": float(np.mean(law.kn)),
        "message": path.message,
        "negative_loops": float(np.mean(loops["W2"][known] < 0)) if known.any() else None,
        "passed": {name or "other": count for name, count in held.items()},
        "reached": reached,
        "status": path.status,
        "unstable_contacts": len({event.contacts for event in path.of_kind("instability")}),
        "work": path.work[-1, 0],
    }


def _draw(
    snapshot: Snapshot,
    tables: dict[str, Columns],
    summary: dict[str, Any],
    folder: Path,
    name: str,
) -> None:
    # Drawing is loaded only when there is something to draw.
    from studies.evolve.figures import path_drawings
    from studies.snapshot.report import loops_for_map, write_report
    from studies.style import save_drawings

    shown = loops_for_map(snapshot, snapshot.faces, tables["loops"])
    title = f"Path of {readable(name)}"
    made = summary["provenance"]
    drawn = save_drawings(path_drawings(snapshot, tables, summary), folder, made)
    write_report(folder, title, summary, drawn, shown, made)
