"""The bench behind `grainloops bench`: measure the chosen groups, write tables and figures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from loops import InputError
from patterns.hard_cases import HARD_CASES
from studies.bench.hard_cases import loop_letters, path_rows, read_letters, tangent_rows
from studies.bench.measure import machine
from studies.bench.methods import GROUPS
from studies.bench.smallest import smallest_model_rows
from studies.study import study

HARD, SMALLEST = "hard-cases", "smallest-model"
UNITS = "seconds of processor time per item, bytes; errors relative or absolute as each row says"
# Methods with an error below this, rounding, are ranked by their time alone.
KNEE_ERROR = 1e-14
# Where none is below, methods within this factor of the least error are.
KNEE_FACTOR = 10.0


class Measured(NamedTuple):
    """Tables of a run, and the letters of the hard cases by case."""

    methods: pd.DataFrame
    tangents: pd.DataFrame
    paths: pd.DataFrame
    smallest: pd.DataFrame
    letters: dict[str, dict[str, str]]


def run_bench(
    out: Path,
    *,
    quick: bool = False,
    only: str | None = None,
    force: bool = False,
    progress: Callable[[str], None] | None = None,
) -> dict[str, Any]:
    """Measure the methods that a user chooses between, run the hard cases, write the results."""
    names = chosen_groups(only)
    asked: dict[str, Any] = {"quick": True} if quick else {}
    asked |= {} if only is None else {"only": only}
    configuration = {**machine("numpy"), **asked}
    with study("bench", out, configuration, UNITS, force=force, csv=True) as results:
        measured = collect(names, quick, progress)
        tables = {
            "bench": measured.methods,
            "hard_tangents": measured.tangents,
            "hard_paths": measured.paths,
            "smallest_model": measured.smallest,
        }
        results.write_tables({name: table for name, table in tables.items() if len(table)})
        summary = results.write_summary(summarise(measured))
        # matplotlib is loaded only when there is something to draw.
        from studies.bench.figures import all_figures

        results.save_figures(all_figures(measured))
    return summary


def chosen_groups(only: str | None) -> tuple[str, ...]:
    """Names of the groups to run."""
    every = (*GROUPS, HARD, SMALLEST)
    names = every if only is None else tuple(name.strip() for name in only.split(","))
    for name in names:
        if name not in every:
            raise InputError("--only", repr(name), f"names from {', '.join(every)}", "Name these.")
    return names


def collect(
    names: tuple[str, ...], quick: bool, progress: Callable[[str], None] | None = None
) -> Measured:
    """Measure the groups of these names; `progress` is called with each name."""
    methods: list[dict[str, Any]] = []
    tangents: list[dict[str, Any]] = []
    paths: list[dict[str, Any]] = []
    smallest: list[dict[str, Any]] = []
    letters: dict[str, dict[str, str]] = {}
    for name in names:
        if progress is not None:
            progress(name)
        if name == HARD:
            for case in HARD_CASES:
                if case.kind == "tangent":
                    tangents += tangent_rows(case, 3 if quick else 1)
                    letters[case.name] = read_letters(case)
                elif case.kind == "faces":
                    letters[case.name] = {"loops": loop_letters(case)}
                elif not quick:
                    paths += path_rows(case)
        elif name == SMALLEST:
            smallest += [] if quick else smallest_model_rows()
        else:
            methods += [asdict(row) for row in GROUPS[name](quick)]
    return Measured(
        methods=pd.DataFrame(methods),
        tangents=pd.DataFrame(tangents),
        paths=pd.DataFrame(paths),
        smallest=pd.DataFrame(smallest),
        letters=letters,
    )


def summarise(measured: Measured) -> dict[str, Any]:
    """Default and knee of every group, and the answers to the hard cases."""
    groups: dict[str, Any] = {}
    for name, rows in (
        measured.methods.groupby("group", sort=False) if len(measured.methods) else ()
    ):
        defaults = rows[rows.default].to_dict("records")
        groups[str(name)] = {"knee": knee(rows).to_dict(), "defaults": defaults}
    return {"groups": groups, "hard_cases": hard_case_summary(measured)}


def hard_case_summary(measured: Measured) -> dict[str, Any]:
    """Counts of wrong signs, of errors over their bound and of answers that are not expected."""
    tangents, paths = measured.tangents, measured.paths
    told = {"cases": 0, "tangents": len(tangents), "unexpected": [], "wrong_signs": 0}
    told |= {"over_bound": 0, "paths_missed": [], "letters": measured.letters}
    if len(tangents):
        wrong = tangents[tangents.answer != tangents.expected]
        judged = tangents[tangents.answer.isin(["s", "u"]) & tangents.exact.isin(["s", "u"])]
        told["cases"] += tangents.case.nunique()
        told["unexpected"] = [f"{r.case} {r.value:g} {r.closure}" for r in wrong.itertuples()]
        told["wrong_signs"] = int((judged.answer != judged.exact).sum())
        told["over_bound"] = int((tangents.operator_error > tangents.bound).sum())
    if len(paths):
        missed = paths[~paths.expected_met]
        told["cases"] += paths.case.nunique()
        told["paths_missed"] = [f"{r.case} {r.value:g}" for r in missed.itertuples()]
    return told


def knee(rows: pd.DataFrame) -> pd.Series:
    """The cheapest row of a group that reaches round-off, or comes near the least error."""
    accurate = rows[rows.error <= max(KNEE_ERROR, KNEE_FACTOR * rows.error.min())]
    cheapest: pd.Series = accurate.loc[accurate.seconds_per_item.idxmin()]
    return cheapest
