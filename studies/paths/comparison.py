"""Loops of several orders under one programme, side by side."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from studies.output import Row, Summary, definitions, values_of
from studies.paths.followed import Followed, first_yield
from studies.paths.options import ComparisonOptions
from studies.paths.polygon import event_values, follow_polygon, thresholds


@dataclass(frozen=True, eq=False)
class Compared:
    """Loops of several orders, followed; `loops` holds a row of plain values of each."""

    options: ComparisonOptions
    found: tuple[Followed, ...]
    loops: tuple[dict[str, Any], ...]

    @cached_property
    def table(self) -> pd.DataFrame:
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
        return pd.DataFrame(rows)

    def curves(self) -> pd.DataFrame:
        """Strains, stresses, determinants and smallest eigenvalue of Ks along every path."""
        tables, names = [], ("E1", "E2", "s1", "s2", "det_K", "det_Ks")
        for order, found in zip(self.options.orders, self.found, strict=True):
            columns: dict[str, Any] = {"order": order, "stage": found.stage}
            columns |= {name: getattr(found, name) for name in names}
            columns["lambda_min"] = found.path.symmetric_eigenvalues[:, 0]
            tables.append(pd.DataFrame(columns))
        return pd.concat(tables, ignore_index=True)

    def summary(self) -> Summary:
        """Summary of the study, without its provenance."""
        early = [str(loop["order"]) for loop in self.loops if loop["status"] != "finished"]
        notes = [f"paths that end before their target: orders {', '.join(early)}"] if early else []
        return {
            "parameters": self.options.described(),
            "loops": list(self.loops),
            "notes": notes,
            "definitions": definitions("polygon", "compare"),
        }


def compare_orders(options: ComparisonOptions) -> Compared:
    """Follow a loop of every order."""
    found, rows = [], []
    for order in options.orders:
        one = follow_polygon(options.of(order), ("diagonal",))
        slipped = first_yield(one.path, np.asarray(one.options.law().mu))
        row = {
            "order": order,
            "critical_strain": thresholds(options.of(order)),
            "first_yield": event_values(one, slipped) if slipped else None,
            "peak": one.peak,
            **values_of(one.path, "status", "message"),
            "end": {name: float(getattr(one, name)[-1]) for name in ("E1", "E2", "s1")},
        }
        found.append(one)
        rows.append(row)
    return Compared(options, tuple(found), tuple(rows))
