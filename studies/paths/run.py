"""The studies behind `grainloops diamond` and `polygon`: one loop, or loops of several orders."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from loops.lazy import named
from studies.output import Columns, Row, Summary, definitions, values_of
from studies.paths.diamond import follow_diamond
from studies.paths.followed import Followed, first_yield, follow_loop
from studies.paths.options import ComparisonOptions, DiamondOptions, LoopOptions, PolygonOptions
from studies.study import study

CURVES = ("E1", "E2", "s1", "s2", "det_K", "det_Ks")


@dataclass(frozen=True, eq=False)
class Compared:
    """Loops of several orders, followed."""

    options: ComparisonOptions
    paths: tuple[Followed, ...]

    @cached_property
    def loops(self) -> list[dict[str, Any]]:
        """Plain values of each loop."""
        rows = []
        for order, path in zip(self.options.orders, self.paths, strict=True):
            slipped = first_yield(path.path, np.asarray(path.options.law().mu))
            rows.append({
                "order": order,
                "critical_strain": path.critical,
                "first_yield": path.event(slipped) if slipped and path.loaded else None,
                "peak": path.peak,
                **values_of(path.path, "status", "message"),
                "end": {name: float(getattr(path, name)[-1]) for name in ("E1", "E2", "s1")},
            })  # fmt: skip
        return rows

    @cached_property
    def table(self) -> Columns:
        """One row per order; NaN where a loop has no such state."""
        rows = []
        for loop in self.loops:
            row: Row = {"order": loop["order"]}
            for subspace, strain in loop["critical_strain"].items():
                row[f"critical_strain_{subspace}"] = np.nan if strain is None else strain
            for name in ("first_yield", "peak"):
                values = loop[name] or {}
                row |= {f"{name}_{key}": values.get(key, np.nan) for key in ("E1", "E2", "s1")}
            rows.append(row | {"end_E1": loop["end"]["E1"], "status": loop["status"]})
        return {name: np.array([row[name] for row in rows]) for name in rows[0]}

    def tables(self) -> dict[str, Columns]:
        """A row per order; strains, stresses, determinants, smallest eigenvalue of Ks of paths."""
        parts = []
        for order, path in zip(self.options.orders, self.paths, strict=True):
            columns = {"order": np.full(len(path.path), order), "stage": np.asarray(path.stage)}
            columns |= values_of(path, *CURVES)
            parts.append(columns | {"lambda_min": path.path.symmetric_eigenvalues[:, 0]})
        joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        return {"compare": self.table, "paths": joined}

    def summary(self) -> Summary:
        """Summary of the study, without its provenance."""
        early = [str(loop["order"]) for loop in self.loops if loop["status"] != "finished"]
        notes = [f"paths that end before their target: orders {', '.join(early)}"] if early else []
        return {
            "parameters": self.options.described(),
            "loops": self.loops,
            "notes": notes,
            "definitions": definitions("polygon", "compare"),
        }


def compare_orders(options: ComparisonOptions) -> Compared:
    """Follow a loop of every order."""
    loops = (options.of(order) for order in options.orders)
    return Compared(options, tuple(follow_loop(loop, ("diagonal",)) for loop in loops))


# Command, title, what follows its loops, and figures, by the kind of options.
QUESTIONS: dict[type, tuple[str, str, Any, str]] = {
    DiamondOptions: ("diamond", "Diamond", follow_diamond, "diamond"),
    PolygonOptions: ("polygon", "Loop of {.order} grains", follow_loop, "polygon"),
    LoopOptions: ("polygon", "Loop of {.order} grains", follow_loop, "polygon"),
    ComparisonOptions: ("polygon --compare", "Loops by order", compare_orders, "comparison"),
}


def run_paths(
    options: DiamondOptions | PolygonOptions | ComparisonOptions, out: Path, **how: Any
) -> Summary:
    """Follow a diamond, a loop or several orders; write `summary.json`, tables and figures."""
    command, title, follow_all, figures = QUESTIONS[type(options)]
    with study(command, out, options.described(), **how) as results:
        followed = follow_all(options)
        tables, summary, title = followed.tables(), followed.summary(), title.format(options)
        # matplotlib is loaded only if something is drawn.
        drawn = (
            named(f"studies.paths.figures.{figures}_figures")(followed) if results.figures else ()
        )
        return results.write_results(tables, summary, drawn, title)
