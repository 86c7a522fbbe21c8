"""How well each prediction foresees the loops that really did negative second-order work."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
from numpy.typing import NDArray

from loops.arrays import Flags, Floats
from loops.loop_strain import rotation_and_stretch

TARGET = "W2_negative"
# Predictors by what they are read from. A higher score means likelier; where a sign is foretold
# the score is positive for negative work. Closures foretell from the strain that the loop really
# took; `*_lambda_min` and the others know the earlier snapshot alone, persistence the loop's past.
OF_INCREMENTS = {
    "affine": "affine_W2",
    "traction": "traction_W2",
    "traction_free": "traction_free_W2",
}
OF_LOOPS = ("affine_lambda_min", "traction_lambda_min", "traction_free_lambda_min")
SIGNED = (*OF_INCREMENTS, *OF_LOOPS, "persistence")
STRAIN = ("H11", "H12", "H21", "H22")
COLUMNS = (
    *("snapshot_before", "snapshot_after", "predictor", "target"),
    *("base", "coverage", "agreement", "precision", "recall", "auc", "rank_correlation", "loops"),
)


def skill_table(increments: Sequence[Path], loops: Sequence[Path]) -> dict[str, list[Any]]:
    """One row an interval and predictor, from the parts of a series; empty without forces."""
    rows: list[dict[str, Any]] = []
    earlier: dict[str, NDArray[Any]] | None = None
    for pair, snapshot in zip(increments, loops, strict=False):
        own = _columns(pair)
        if "w2" not in own:
            break
        scores = _scores(own, _columns(snapshot), earlier)
        numbers = {name: own[name][0] for name in COLUMNS[:2]} if len(own["w2"]) else {}
        rows += [
            {**numbers, "predictor": name, "target": TARGET}
            | skill(score, own["w2"], signed=name in SIGNED)
            for name, score in scores.items()
            if numbers
        ]
        earlier = own
    return {name: [row[name] for row in rows] for name in COLUMNS}


def _columns(part: Path) -> dict[str, NDArray[Any]]:
    wanted = (
        *COLUMNS[:2],
        *("loop_before", "loop_after", "order", "w2", "sliding_contacts"),
        *STRAIN,
        *OF_INCREMENTS.values(),
        *OF_LOOPS,
    )
    there = pyarrow.parquet.read_schema(part).names
    table = pyarrow.parquet.read_table(part, columns=[name for name in wanted if name in there])
    return {name: table.column(name).to_numpy() for name in table.column_names}


def _scores(
    own: Mapping[str, NDArray[Any]],
    loops: Mapping[str, NDArray[Any]],
    earlier: Mapping[str, NDArray[Any]] | None,
) -> dict[str, Floats]:
    at = own["loop_before"]
    # Over the square of the strain: a larger step has more work of either sign.
    H = np.stack([own[name] for name in STRAIN], axis=1).reshape(-1, 2, 2)
    square = np.sum(rotation_and_stretch(H)[1] ** 2, axis=(1, 2))
    size = np.where(square > 0, square, np.nan)
    scores = {name: -own[column] / size for name, column in OF_INCREMENTS.items()}
    scores |= {name: -loops[name][at] for name in OF_LOOPS}
    past = np.full(max(len(loops["order"]), 1), np.nan)
    if earlier is not None:
        past[earlier["loop_after"]] = -earlier["w2"]
    scores["persistence"] = past[at]
    scores["order"] = own["order"].astype(float)
    scores["sliding"] = own["sliding_contacts"].astype(float)
    return scores


def skill(score: Floats, w2: Floats, *, signed: bool) -> dict[str, Any]:
    """Hits of a score over one interval; not a number where there is nothing to divide by.

    `base`: share of the loops with `w2 < 0` among those that moved; `coverage`: share of these
    that have a score, over which the rest is taken; `agreement`, `precision`, `recall`: of the
    sign; `auc`: chance that a loop of negative work has the higher score of two, one half for ties
    (Mann and Whitney); `rank_correlation`: Spearman's, of the score with -w2.
    """
    moved = np.isfinite(w2) & (w2 != 0)
    known = moved & np.isfinite(score)
    actual, foretold = w2[known] < 0, score[known] > 0
    hits = np.count_nonzero(actual & foretold)
    ranks = _ranks(score[known])
    return {
        "base": _share(np.count_nonzero(w2[moved] < 0), np.count_nonzero(moved)),
        "coverage": _share(np.count_nonzero(known), np.count_nonzero(moved)),
        "agreement": _share(np.count_nonzero(actual == foretold) if signed else None, len(actual)),
        "precision": _share(hits if signed else None, np.count_nonzero(foretold)),
        "recall": _share(hits if signed else None, np.count_nonzero(actual)),
        "auc": _auc(ranks, actual),
        "rank_correlation": _correlation(ranks, _ranks(-w2[known])),
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


def mean_skill(table: Mapping[str, Sequence[Any]]) -> dict[str, dict[str, Any]]:
    """Means over the intervals by predictor, each weighted by its loops."""
    found: dict[str, dict[str, Any]] = {}
    predictor, loops = np.array(table["predictor"]), np.array(table["loops"], dtype=float)
    for name in dict.fromkeys(table["predictor"]):
        own = predictor == name
        row: dict[str, Any] = {"loops": int(loops[own].sum())}
        for key in COLUMNS[4:-1]:
            values = np.array(table[key], dtype=float)[own]
            known = np.isfinite(values) & (loops[own] > 0)
            row[key] = (
                float(np.average(values[known], weights=loops[own][known])) if known.any() else None
            )
        found[name] = row
    return found
