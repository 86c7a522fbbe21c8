"""How well each prediction foresees what the loops really did: the rows of `skill.parquet`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from loops.arrays import Flags, Floats
from studies.series.targets import OTHERS, TARGET, part_columns, targets
from studies.snapshot.statistics import LAST_ORDER

Table = dict[str, list[Any]]
MEASURES = ("base", "coverage", "agreement", "precision", "recall", "auc", "rank_correlation")
COLUMNS = ("snapshot_before", "snapshot_after", "predictor", "target", *MEASURES, "loops")
ORDERS = range(3, LAST_ORDER + 1)


def skill_tables(
    loops: Sequence[Path], increments: Sequence[Path], packing: Sequence[Path] = ()
) -> tuple[Table, Table]:
    """One row an interval, predictor and target, from the parts of a series; the same by `order`.

    Empty without forces; by order only where the packing foretells.
    """
    rows: list[dict[str, Any]] = []
    by_order: list[dict[str, Any]] = []
    earlier = None
    for k, (pair, snapshot) in enumerate(zip(increments, loops, strict=False)):
        own, state = part_columns(pair), part_columns(snapshot)
        if "w2" not in own:
            break
        state |= part_columns(packing[k]) if packing else {}
        order = np.minimum(state["order"], ORDERS[-1])
        for target, predictor, score, value, signed in targets(own, state, earlier):
            numbers = [own[name][0] for name in COLUMNS[:2]] if len(own["w2"]) else []
            if not numbers:
                continue
            place = dict(zip(COLUMNS[:4], (*numbers, predictor, target), strict=True))
            rows.append(place | skill(score, value, signed=signed))
            for n in ORDERS if packing else ():
                some = skill(score[order == n], value[order == n], signed=signed)
                by_order.append(place | {"order": n} | some)
        earlier = own
    return _table(rows, COLUMNS), _table(by_order, (*COLUMNS[:4], "order", *COLUMNS[4:]))


def _table(rows: Sequence[Mapping[str, Any]], names: Sequence[str]) -> Table:
    return {name: [row[name] for row in rows] for name in names}


def skill(score: Floats, value: Floats, *, signed: bool) -> dict[str, Any]:
    """Hits of a score over one interval; not a number where there is nothing to divide by.

    `base`: share of the loops with `value < 0` among those that have one, not zero; `coverage`:
    share of these that have a score, over which the rest is taken; `agreement`, `precision`,
    `recall`: of the sign; `auc`: chance that of two loops of either sign the negative one has the
    higher score, one half for ties (Mann and Whitney); `rank_correlation`: Spearman's, of the score
    with -value.
    """
    moved = np.isfinite(value) & (value != 0)
    known = moved & np.isfinite(score)
    actual, foretold = value[known] < 0, score[known] > 0
    hits = np.count_nonzero(actual & foretold)
    ranks = _ranks(score[known])
    return {
        "base": _share(np.count_nonzero(value[moved] < 0), np.count_nonzero(moved)),
        "coverage": _share(np.count_nonzero(known), np.count_nonzero(moved)),
        "agreement": _share(np.count_nonzero(actual == foretold) if signed else None, len(actual)),
        "precision": _share(hits if signed else None, np.count_nonzero(foretold)),
        "recall": _share(hits if signed else None, np.count_nonzero(actual)),
        "auc": _auc(ranks, actual),
        "rank_correlation": _correlation(ranks, _ranks(-value[known])),
        "loops": int(np.count_nonzero(known)),
    }


def _share(part: Any, whole: Any) -> float:
    return float("nan") if part is None or not whole else float(part / whole)


def _ranks(values: Floats) -> Floats:
    """Ranks from 1, the mean rank for ties."""
    _, place, count = np.unique(values, return_inverse=True, return_counts=True)
    ranks: Floats = (np.cumsum(count) - 0.5 * (count - 1))[place]
    return ranks


def _auc(ranks: Floats, actual: Flags) -> float:
    positive = int(np.count_nonzero(actual))
    pairs = positive * (len(actual) - positive)
    return _share(float(ranks[actual].sum()) - 0.5 * positive * (positive + 1), pairs)


def _correlation(a: Floats, b: Floats) -> float:
    a, b = a - a.mean() if len(a) else a, b - b.mean() if len(b) else b
    return _share(float(a @ b), float(np.sqrt((a @ a) * (b @ b))))


def mean_skill(table: Mapping[str, Sequence[Any]], target: str = TARGET) -> dict[str, Any]:
    """Means over the intervals by predictor, each weighted by its loops; the spread of the AUC."""
    found: dict[str, dict[str, Any]] = {}
    loops, of_target = np.array(table["loops"], dtype=float), np.array(table["target"]) == target
    predictor = np.array(table["predictor"])
    for name in dict.fromkeys(predictor[of_target].tolist()):
        own = of_target & (predictor == name) & (loops > 0)
        row: dict[str, Any] = {"loops": int(loops[own].sum())}
        for key in MEASURES:
            row[key] = _mean(np.array(table[key], dtype=float)[own], loops[own])
        auc = np.array(table["auc"], dtype=float)[own]
        auc = auc[np.isfinite(auc)]
        row |= {"auc_min": float(auc.min()), "auc_max": float(auc.max())} if len(auc) else {}
        found[name] = row
    return found


def _mean(values: Floats, weights: Floats) -> float | None:
    known = np.isfinite(values)
    return float(np.average(values[known], weights=weights[known])) if known.any() else None


def summarised(table: Table, by_order: Table) -> dict[str, Any]:
    """Skill for the summary: means over the intervals by target, and by order."""
    summary: dict[str, Any] = {"skill": mean_skill(table)}
    if not by_order["order"]:
        return summary
    summary["skill_of_targets"] = {target: mean_skill(table, target) for target in OTHERS}
    order = np.array(by_order["order"])
    parts = {
        n: {name: np.array(values)[order == n] for name, values in by_order.items()} for n in ORDERS
    }
    means = {n: mean_skill(part) for n, part in parts.items()}
    summary["skill_by_order"] = {
        name: {f"order_{n}": means[n][name]["auc"] for n in ORDERS} for name in means[ORDERS[0]]
    }
    return summary
