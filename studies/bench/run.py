"""From the methods and the hard cases to tables, figures and the page."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from patterns.hard_cases import HARD_CASES
from studies.bench.groups import GROUPS, HARD, SMALLEST, chosen_groups, knee
from studies.bench.hard_cases import loop_letters, path_rows, read_letters, tangent_rows
from studies.bench.measure import Row, grouped, machine
from studies.bench.smallest import rows as smallest_model_rows
from studies.output import provenance, result_folder, write_results

UNITS = "seconds of processor time per item, bytes; errors relative or absolute as each row says"


class Results(NamedTuple):
    """What a run found."""

    rows: list[Row]
    tangents: list[dict[str, Any]]
    paths: list[dict[str, Any]]
    letters: dict[str, dict[str, str]]
    smallest: list[dict[str, Any]]


def run_bench(
    out: Path,
    *,
    quick: bool = False,
    only: str | None = None,
    force: bool = False,
    progress: Callable[[str], None] | None = None,
) -> dict[str, Any]:
    """Measure every method with a choice, run the hard cases, write what came out."""
    names = chosen_groups(only)
    with result_folder(out, force=force) as folder:
        results = collect(names, quick, progress)
        asked: dict[str, Any] = {"quick": True} if quick else {}
        asked |= {} if only is None else {"only": only}
        made = provenance("bench", {**machine("numpy"), **asked}, UNITS)
        summary = summarise(results) | {"provenance": made}
        tables = {
            "bench": [asdict(row) for row in results.rows],
            "hard_tangents": results.tangents,
            "hard_paths": results.paths,
            "smallest_model": results.smallest,
        }
        write_results(folder, summary, tables, csv=True)
        # Drawing is loaded only when there is something to draw.
        from studies.bench.figures import all_figures
        from studies.style import save_figures

        save_figures(all_figures(results), folder, made)
    return summary


def collect(
    names: tuple[str, ...], quick: bool, progress: Callable[[str], None] | None = None
) -> Results:
    """Run groups."""
    results = Results([], [], [], {}, [])
    for name in names:
        if progress is not None:
            progress(name)
        for methods in GROUPS.get(name, ()):
            results.rows.extend(methods(quick))
        for case in HARD_CASES if name == HARD else ():
            if case.kind == "tangent":
                results.tangents.extend(tangent_rows(case, 3 if quick else 1))
                results.letters[case.name] = read_letters(case)
            elif case.kind == "faces":
                results.letters[case.name] = {"loops": loop_letters(case)}
            elif not quick:
                results.paths.extend(path_rows(case))
        if name == SMALLEST and not quick:
            results.smallest.extend(smallest_model_rows())
    return results


def summarise(results: Results) -> dict[str, Any]:
    """Defaults and knees by group, and the hard cases' answers."""
    groups = {}
    for name, rows in grouped(results.rows, "group").items():
        defaults = [row for row in rows if row.default]
        groups[name] = {"knee": asdict(knee(rows)), "defaults": [asdict(row) for row in defaults]}
    wrong = [row for row in results.tangents if row["answer"] != row["expected"]]
    missed = [row for row in results.paths if not row["expected_met"]]
    bounded = [r for r in results.tangents if np.isfinite(r["operator_error"])]
    return {
        "groups": groups,
        "hard_cases": {
            "cases": len({r["case"] for r in results.tangents + results.paths}),
            "tangents": len(results.tangents),
            "unexpected": [f"{r['case']} {r['value']:g} {r['closure']}" for r in wrong],
            "wrong_signs": sum(
                r["answer"] in "su" and r["exact"] in "su" and r["answer"] != r["exact"]
                for r in results.tangents
            ),
            "over_bound": sum(r["operator_error"] > r["bound"] for r in bounded),
            "paths_missed": [f"{r['case']} {r['value']:g}" for r in missed],
            "letters": results.letters,
        },
    }
