"""The bench behind `grainloops bench`: measure the chosen groups, write tables, draw figures."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from loops import InputError
from studies.study import study
from studies.style import (
    BLACK,
    GREY,
    LINE_COLOURS,
    axes_or_new,
    figure_of,
    key_columns,
    new_panels,
    styled,
)
from tests.benchmarks.hard_cases import hard_path_rows, loop_letters, read_letters, tangent_rows
from tests.benchmarks.methods import METHOD_GROUPS, machine, smallest_model_rows
from tests.benchmarks.options import OPTIONS, option_methods
from tests.oracles.hard_cases import HARD_CASES

HARD, SMALLEST = "hard-cases", "smallest-model"
GROUPS = METHOD_GROUPS | {"options": option_methods}
# Seconds of the groups on two busy cores, 29 November 2026.
SECONDS = {
    **{"paths": 5, "closures": 106, "directions": 8, "batches": 7, "compiled": 5},
    **{"options": 170, HARD: 12, SMALLEST: 21},
}
UNITS = "seconds of processor time per item, bytes; errors relative or absolute as each row says"
# Methods with an error below this, rounding, are ranked by their time alone.
KNEE_ERROR = 1e-14
# If no method is below, those within this factor of the least error are ranked by time.
KNEE_FACTOR = 10.0
# Drawn in place of an error of zero.
LEAST = 1e-17
UNIT_ROUND_OFF = float(np.finfo(float).eps)
# The group with a figure of its own, and the groups without a panel in `pareto`.
BATCH_GROUP = "batch or one by one"
OWN_FIGURE = (BATCH_GROUP, "compiled or plain")
STIFF_CASES = {
    "stiff-grains": "hexagon, elastic",
    "stiff-sliding-grains": "hexagon, all sliding",
    "stiff-sliding-diamond": "diamond, all sliding",
}
ERROR_LABELS = {
    "operator_error": "operator",
    "eigenvalue_error": "eigenvalues of Ks",
    "cone_error": "cone's edges (rad)",
    "fraction_error": "unstable fraction",
}
MARKERS = "osD^vPX"


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
    progress: Callable[[str], None] | None = None,
    **files: Any,
) -> dict[str, Any]:
    """Measure the methods that a user chooses between, run the hard cases, write the results.

    `files` are `force` and `figures` of a study.
    """
    names = chosen_groups(only)
    asked: dict[str, Any] = {"quick": True} if quick else {}
    asked |= {} if only is None else {"only": only}
    configuration = {**machine("numpy"), **asked}
    with study("bench", out, configuration, UNITS, **files | {"csv": True}) as results:
        measured = collect(names, quick, progress)
        tables = {
            "bench": measured.methods,
            "hard_tangents": measured.tangents,
            "hard_paths": measured.paths,
            "smallest_model": measured.smallest,
        }
        written = {name: table for name, table in tables.items() if len(table)}
        found, drawn = summarise(measured), all_figures(measured)
        return results.write_results(written, found, drawn, "Speed against error")


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
    """Measure the groups of these names; `progress` gets a line before and one after each."""
    if progress is not None and not quick:
        expected = sum(SECONDS[name] for name in names) / 60
        progress(f"{len(names)} parts ({', '.join(names)}) take about {expected:.1f} minutes")
    methods: list[dict[str, Any]] = []
    tangents: list[dict[str, Any]] = []
    paths: list[dict[str, Any]] = []
    smallest: list[dict[str, Any]] = []
    letters: dict[str, dict[str, str]] = {}
    for name in names:
        begin = time.perf_counter()
        if name == HARD:
            for case in HARD_CASES:
                if case.kind == "tangent":
                    tangents += tangent_rows(case, 3 if quick else 1)
                    letters[case.name] = read_letters(case)
                elif case.kind == "faces":
                    letters[case.name] = {"loops": loop_letters(case)}
                elif not quick:
                    paths += hard_path_rows(case)
        elif name == SMALLEST:
            smallest += [] if quick else smallest_model_rows()
        else:
            methods += [asdict(row) for row in GROUPS[name](quick)]
        if progress is not None:
            progress(f"{name} finished in {time.perf_counter() - begin:.0f} s")
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


def all_figures(measured: Measured) -> Iterator[tuple[str, Figure]]:
    """Figures of the groups that were measured, with their names."""
    methods, tangents = measured.methods, measured.tangents
    if len(methods):
        turned = methods.group.isin(OPTIONS)
        fronts = methods[~methods.group.isin(OWN_FIGURE) & ~turned]
        if len(fronts):
            yield "pareto", pareto(fronts)
        if turned.any():
            yield "options", pareto(methods[turned])
        sizes = methods[methods.group == BATCH_GROUP]
        if len(sizes):
            yield "batches", figure_of(batches(sizes))
    if len(tangents) and tangents.case.isin(STIFF_CASES).any():
        yield "stiff", stiff(tangents)


@styled()
def pareto(rows: pd.DataFrame) -> Figure:
    """Error over time, a panel for each group; the default is ringed."""
    groups = rows.groupby("group", sort=False)
    columns = min(3, groups.ngroups)
    lines = -(-groups.ngroups // columns)
    figure, axes = new_panels(lines, columns, 2.75 * lines)
    for ax, (name, own) in zip(axes.flat, groups, strict=False):
        methods = own.groupby("method", sort=False)
        for k, (method, one) in enumerate(methods):
            colour, marker = LINE_COLOURS[k % len(LINE_COLOURS)], MARKERS[k % len(MARKERS)]
            at = one.seconds_per_item, one.error.clip(lower=LEAST)
            ax.loglog(*at, marker + "-", color=colour, label=method, markersize=3.5)
        default = own[own.default]
        at = default.seconds_per_item, default.error.clip(lower=LEAST)
        ax.plot(*at, "o", markersize=9, markerfacecolor="none", color=BLACK, zorder=5)
        ax.axhline(UNIT_ROUND_OFF, color=GREY, linewidth=0.7, linestyle=":")
        ax.set(title=str(name), xlabel="time per item (s)", ylim=(0.3 * LEAST, 9.0))
        # From a power of ten to a power of ten: labels of narrow ranges would overlap.
        low, high = own.seconds_per_item.min(), own.seconds_per_item.max()
        ax.set_xlim(0.7 * 10.0 ** np.floor(np.log10(low)), 1.4 * 10.0 ** np.ceil(np.log10(high)))
        ax.xaxis.set_minor_formatter(NullFormatter())
        below: Any = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.24), "fontsize": 5.8}
        ax.legend(**below, ncols=2 if methods.ngroups > 3 else 1)
    for ax in axes.flat[groups.ngroups :]:
        ax.set_visible(False)
    for ax in axes[:, 0]:
        ax.set_ylabel("error")
    return figure


@styled()
def batches(rows: pd.DataFrame, ax: Axes | None = None) -> Axes:
    """Time per loop over the number of loops in one call."""
    ax = axes_or_new(ax)
    for k, (method, own) in enumerate(rows.groupby("method", sort=False)):
        style: Any = {"color": LINE_COLOURS[k], "label": method}
        ax.loglog(own["items"], own.seconds_per_item, MARKERS[k] + "-", **style)
    ax.set(xlabel="hexagons at once", ylabel="time per hexagon (s)")
    ax.legend()
    return ax


@styled()
def stiff(rows: pd.DataFrame) -> Figure:
    """Errors over the overlap: elastic and sliding loops, both closures."""
    figure, axes = new_panels(3, 2, 6.2, sharex=True, sharey=True)
    for down, (case, what) in enumerate(STIFF_CASES.items()):
        for across, closure in enumerate(("affine", "traction")):
            own = rows[(rows.case == case) & (rows.closure == closure)]
            ax = axes[down, across]
            for k, (name, label) in enumerate(ERROR_LABELS.items()):
                at = own.value, own[name].clip(lower=LEAST)
                ax.loglog(*at, MARKERS[k] + "-", color=LINE_COLOURS[k], label=label)
            ax.loglog(own.value, own.bound, "--", color=GREY, label="stated bound of the operator")
            ax.set(title=f"{what}, {closure} closure", ylim=(0.3 * LEAST, 1.0))
    for ax in axes[-1]:
        ax.set_xlabel("overlap $N/(k_n l_0)$")
    for ax in axes[:, 0]:
        ax.set_ylabel("error")
    handles, labels = axes[1, 1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=key_columns(figure, 5))
    return figure
