"""The study behind `grainloops forecast`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from loops.contacts import contacts_at_start
from studies.calibration import BEYOND, KINDS, WAYS, calibration
from studies.evolve import Programmed, start_of
from studies.forecast import DEFAULTS, NEXT, Forecast, forecast_of, spread_of
from studies.output import UNITS, Summary, definitions, readable
from studies.questions import taken
from studies.reading import read_planar, reading
from studies.series.packing import DEFAULT_RATE
from studies.snapshot.in_packing import balance_notes, held_snapshot, hold_control
from studies.study import files_of, study


def run_forecast(
    path: Path,
    out: Path,
    *,
    spread: bool = True,
    inertial_number: float = DEFAULT_RATE,
    hold: bool = False,
    hold_stress: bool = False,
    progress: Callable[[float], None] | None = None,
    **how: Any,
) -> Summary:
    """Forecast a snapshot, write tables, a figure and a report; return the summary.

    `how` are options of `evolve`, of `read_planar` and files of `study`.
    """
    files = files_of(how)
    how = DEFAULTS | how
    asked = taken(Programmed, how)
    control = hold_control(hold, hold_stress)
    configuration = {"path": path, **reading(**how), **asked.described(), "hold": control}
    configuration |= {"spread": spread, "inertial_number": inertial_number}
    with study("forecast", out, configuration, UNITS["evolve"], **files) as results:
        snapshot, held = held_snapshot(read_planar(path, **how), control)
        notes = [*snapshot.notes, *balance_notes(snapshot)]
        asked = asked.along(snapshot.scene)
        given = snapshot.scene, snapshot.ids, asked, inertial_number
        found = forecast_of(*given, spread=spread, progress=progress)
        tables = {"loops": found.loops, "next": found.next}
        summary = results.write_results(
            tables,
            asked.described()
            | {"held": held, "mean_kn": snapshot.mean_kn, "inertial_number": inertial_number}
            | forecast_summary(found, notes, spread=spread),
        )
        if results.figures:
            from studies.forecast_figures import forecast_figure
            from studies.snapshot.table import loops_for_map

            drawn = [("forecast", lambda: forecast_figure(found))]
            maps = loops_for_map(snapshot, found.loops)
            title = f"Forecast of {readable(path.name)}"
            results.write_report(title, summary, drawn, maps)
    return summary


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
        "definitions": definitions("forecast"),
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
