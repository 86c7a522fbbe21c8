"""From the files of a series to one dataset, its evolution and figures."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from loops import InputError
from studies.output import SERIES, errors_of, folder_lock, require_folder
from studies.series.contents import has_parts, open_folder
from studies.series.gather import gather
from studies.series.plan import PlannedSnapshot, SeriesInput, plan_series
from studies.series.scheduler import Runner, do_tasks, open_runner
from studies.series.tasks import Failure, SnapshotTask, do_pair, do_snapshot, pairs


def run_series(
    series: SeriesInput,
    out: Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    skip_bad: bool = False,
    force: bool = False,
    csv: bool = False,
    figures: bool = True,
    animation: bool = False,
) -> dict[str, Any]:
    """Find the loops of every snapshot of a series and what becomes of them.

    What is finished in `out` is not done again: an interrupted run goes on with the same call. A
    script calls this under `if __name__ == "__main__"`, for the processes import it.

    Parameters
    ----------
    series : SeriesInput
        What to read.
    out : Path
        Result folder: the datasets `loops/` and `increments/`, `evolution.parquet`,
        `exchange.parquet`, `summary.json`, figures.
    workers : int, optional
        Number of processes; by default as many as cores.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers then do the work.
    skip_bad : bool
        Whether snapshots that can't be read are left out, and named in the summary.
    force : bool
        Whether the results of another series may be replaced.
    csv : bool
        Whether to write the tables as CSV too.
    figures, animation : bool
        Whether to draw.

    Returns
    -------
    dict
        The summary.

    Raises
    ------
    InputError
        For bad input, a cluster that can't do it, or an `out` that holds other files.
    """
    planned = plan_series(series)
    out = out.absolute()
    require_folder(out, force=True)
    with errors_of(out):
        new = not out.exists()
        out.mkdir(parents=True, exist_ok=True)
        with folder_lock(out):
            open_folder(out, series, planned, force=force)
            try:
                with open_runner(workers, scheduler, _needed(planned, out)) as runner:
                    good, failures = _do_all(runner, planned, out, skip_bad=skip_bad)
            except InputError:
                if new and not has_parts(out):
                    shutil.rmtree(out)
                raise
            return gather(
                series, good, failures, out, csv=csv, figures=figures, animation=animation
            )


def _needed(planned: Sequence[PlannedSnapshot], out: Path) -> list[Path]:
    """Files that whoever does the tasks must see."""
    return [out / SERIES, *dict.fromkeys(one.source.path for one in planned)]


def _do_all(
    runner: Runner, planned: Sequence[PlannedSnapshot], out: Path, *, skip_bad: bool
) -> tuple[list[PlannedSnapshot], list[Failure]]:
    """Snapshots that could be read, and why the others could not."""
    tasks = [SnapshotTask(one, out) for one in planned]
    failures = do_tasks(runner, do_snapshot, tasks, "snapshots", skip_bad=skip_bad)
    bad = {failure.number for failure in failures}
    good = [one for one in planned if one.number not in bad]
    if not good:
        raise failures[0].error()
    do_tasks(runner, do_pair, pairs(good, out), "pairs", skip_bad=False)
    return good, failures
