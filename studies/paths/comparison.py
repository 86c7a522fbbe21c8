"""Loops of several orders under one programme, side by side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from studies.columns import definitions
from studies.paths.diamond import REACHED
from studies.paths.followed import SUBSPACES, Followed
from studies.paths.options import ComparisonOptions
from studies.paths.polygon import axial_peak, described, follow_polygon, thresholds


@dataclass(frozen=True, eq=False)
class Compared:
    """Loops of several orders, followed; `loops` holds a row of plain values of each."""

    options: ComparisonOptions
    found: tuple[Followed, ...]
    loops: tuple[dict[str, Any], ...]

    def summary(self) -> dict[str, Any]:
        """Summary without its provenance."""
        early = [str(loop["order"]) for loop in self.loops if loop["status"] != "finished"]
        notes = [f"paths that end before their target: orders {', '.join(early)}"] if early else []
        return {
            "parameters": self.options.described(),
            "loops": list(self.loops),
            "notes": notes,
            "definitions": definitions("polygon", "compare"),
        }

    def tables(self) -> dict[str, dict[str, Any]]:
        """`compare`, a row an order, NaN where there is none; `paths`, the curves of all."""
        columns: dict[str, Any] = {"order": [row["order"] for row in self.loops]}
        for subspace in SUBSPACES:
            critical = [row["critical_strain"][subspace] for row in self.loops]
            columns[f"critical_strain_{subspace}"] = np.array(critical, dtype=float)
        for name in ("first_yield", "peak"):
            for key in ("E1", "E2", "s1"):
                values = [(row[name] or {}).get(key) for row in self.loops]
                columns[f"{name}_{key}"] = np.array(values, dtype=float)
        columns["end_E1"] = [row["end"]["E1"] for row in self.loops]
        columns["status"] = [row["status"] for row in self.loops]
        pairs = zip(self.options.orders, self.found, strict=True)
        curves = [_curve(order, found) for order, found in pairs]
        paths = {name: np.concatenate([curve[name] for curve in curves]) for name in curves[0]}
        return {"compare": columns, "paths": paths}


def compare(options: ComparisonOptions) -> Compared:
    """Follow a loop of every order."""
    found = tuple(follow_polygon(options.of(n), ("diagonal",)) for n in options.orders)
    rows = tuple(_row(n, each, options) for n, each in zip(options.orders, found, strict=True))
    return Compared(options, found, rows)


def first_yield(found: Followed) -> dict[str, Any] | None:
    """First event at which contacts reach `|T| = mu N`, a control limit where it ends the path."""
    path, mu = found.path, np.asarray(found.options.law().mu, dtype=float)
    for event in path.events:
        contacts = list(event.contacts)
        reached = event.kind == "yield"
        if event.kind == "control_limit" and contacts:
            N, T = path.normal_force[event.index, contacts], path.shear_force[event.index, contacts]
            reached = bool((np.abs(T) >= mu * N * (1.0 - REACHED)).all())
        if reached:
            return described(found, event)
    return None


def _row(order: int, found: Followed, options: ComparisonOptions) -> dict[str, Any]:
    return {
        "order": order,
        "critical_strain": thresholds(options.of(order)),
        "first_yield": first_yield(found),
        "peak": axial_peak(found),
        "status": found.path.status,
        "message": found.path.message,
        "end": {name: float(getattr(found, name)[-1]) for name in ("E1", "E2", "s1")},
    }


def _curve(order: int, found: Followed) -> dict[str, Any]:
    return {
        "order": np.full(len(found.path), order),
        "stage": found.stage,
        **{name: getattr(found, name) for name in ("E1", "E2", "s1", "s2", "det_K", "det_Ks")},
        "lambda_min": found.path.symmetric_eigenvalues[:, 0],
    }
