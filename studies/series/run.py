"""The study behind `grainloops series`."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

from loops import InputError
from loops.errors import number, whole_number
from stability.packing.yield_response import checked_band
from stability.paths.path import Past
from studies.output import SERIES, errors_of, folder_lock, provenance, require_folder
from studies.series.packing import Following
from studies.series.plan import plan_series
from studies.series.tasks import Failure, Series, do_tasks, has_parts, open_folder
from studies.series.workers import Runner, open_runner
from studies.snapshot.run import reading
from studies.study import one_of

UNITS = (
    "as the input's: lengths, forces, stress = force/length (two dimensions); eigenvalues over the "
    "mean kn; work per area; angles in degrees"
)


def run_series(
    paths: Sequence[Path],
    out: Path,
    *,
    cells: Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    skip_bad: bool = False,
    force: bool = False,
    csv: bool = False,
    figures: bool = True,
    animation: bool = False,
    in_packing: bool | str = False,
    yield_band: float = 0.99,
    past: Past = "viscous",
    inertial_number: float | None = None,
    times: Path | None = None,
    time_step: float | None = None,
    mean_mass: float | None = None,
    probe: int | None = None,
    indicators: bool = False,
    **how: Any,
) -> dict[str, Any]:
    """Find the loops of every snapshot of a series and their fates; return the summary.

    `how` are options of `read_planar`; `cells` is a table of the snapshots' cells. With
    `in_packing` the packing's rate problem predicts each interval and `skill.parquet` compares the
    predictions with what happened; with 'events' the packing's path and its replay predict too, the
    path with the way `past` an instability, the replay at the inertial number of the sample: of the
    times of the snapshots (a table `times`, their files, or their numbers by `time_step`) and their
    masses (or the `mean_mass`), unless `inertial_number` is given.
    With `probe` every snapshot is probed along this number of directions of strain. With
    `indicators` the structural indicators of the loops predict too, beside the rate problem.

    Finished parts in `out` are kept: the same call continues an interrupted run. A script calls
    this under `if __name__ == "__main__"`, because the processes import the script.
    """
    how = reading(**how)
    planned = plan_series(paths, cells, how, times)
    read = {name: value for name, value in how.items() if name not in ("contacts", "frame")}
    in_packing = in_packing or indicators
    one_of("--in-packing", in_packing, (False, True, "rates", "events"))
    band, by_events = checked_band(yield_band) if in_packing else None, in_packing == "events"
    following = Following(past, inertial_number, time_step, mean_mass)
    one_of("--past", past, get_args(Past))
    for name, value in following._asdict().items():
        if name != "past" and value is not None:
            number(f"--{name.replace('_', '-')}", value, 0.0, open_low=True)
    if not by_events and (following != Following() or times is not None):
        received = "the rates alone" if in_packing else "no path and no replay"
        remedy = "Add --in-packing events, or leave the options of paths and replays out."
        raise InputError("--in-packing", received, "events", remedy)
    read["in_packing"] = [band, "events", *following] if by_events else band
    if indicators:
        read["indicators"] = True
    probed: tuple[float | None, int | None] = (None, None)
    if probe is not None:
        whole_number("--probe", probe, 1)
        probed = checked_band(yield_band), probe
        read["probe"] = list(probed)
    made = provenance("series", {"paths": paths, "cells": cells, **read}, UNITS)
    read["cells"] = None if cells is None else cells.name
    out = out.absolute()
    require_folder(out, force=True)
    with errors_of(out):
        new = not out.exists()
        out.mkdir(parents=True, exist_ok=True)
        with folder_lock(out):
            open_folder(out, read, [one.name for one in planned], force=force)
            try:
                files = [out / SERIES, *dict.fromkeys(one.path for one in planned)]
                with open_runner(workers, scheduler, files) as runner:
                    followed = following if by_events else None
                    series = Series(planned, out, band, followed, probed, indicators)
                    series, failures = _do_all(runner, series, skip_bad=skip_bad)
            except InputError:
                if new and not has_parts(out):
                    shutil.rmtree(out)
                raise
            # Tables and figures need libraries that the processes of the tasks do not load.
            from studies.series.gather import gather

            return gather(series, failures, made, csv=csv, figures=figures, animation=animation)


def _do_all(runner: Runner, series: Series, *, skip_bad: bool) -> tuple[Series, list[Failure]]:
    """Do all tasks: the series of the readable snapshots, and the failures of the others."""
    failures = do_tasks(runner, series.snapshots, "snapshots", skip_bad=skip_bad)
    bad = {failure.number for failure in failures}
    good = replace(series, planned=[one for one in series.planned if one.number not in bad])
    if not good.planned:
        raise failures[0].error()
    do_tasks(runner, good.intervals, "pairs", skip_bad=False)
    return good, failures
