"""Skill of predictions: targets of an interval, predictors, and how well each ranks the loops.

Targets of survived loops are negative second-order work and, with the packing, the upper tenth of
the actual non-affinity; targets of all earlier loops, with the packing, are the loss of a contact
and any change of topology. Beside them: the share of loops that survive, by the verdicts on them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet
from scipy.stats import binomtest, rankdata, spearmanr

from loops.arrays import Floats, Integers
from loops.stress_strain import rotation_and_stretch
from loops.tracking import Fate
from stability import RTOL
from stability.packing.loop_quantities import EXPECTED
from studies.output import Columns, Row, Summary, as_json, described_table, words
from studies.series.evolution import PREDICTIONS
from studies.series.packing import EVENT_FIELDS
from studies.series.tasks import KEY
from studies.snapshot.summary import judges, spread
from studies.snapshot.table import LAST_ORDER

MEASURES = ("base", "coverage", "agreement", "precision", "recall", "auc", "rank_correlation")
SKILL_COLUMNS = ("snapshot_before", "snapshot_after", "predictor", "target", *MEASURES, "loops")
ORDERS = range(3, LAST_ORDER + 1)
# Targets and predictors in figures, by their columns.
TARGETS, PREDICTORS = words("lines")["labels"]["targets"], words("lines")["labels"]["predictors"]
TARGET, *OTHERS = TARGETS
# Predictors by their source; a higher score predicts the target. Closures predict from the strain
# of the loop over the interval; `*_lambda_min` and the counts know the earlier snapshot only,
# persistence the interval before. The grains' own motion is known afterwards.
CLOSURE_PREDICTORS = {column.removesuffix("_W2"): column for column in PREDICTIONS}
EIGENVALUE_PREDICTORS = (
    *("affine_lambda_min", "traction_lambda_min", "traction_free_lambda_min"),
    "packing_lambda_min",
)
# The strain of a loop that came apart is unknown: closures have no prediction there.
SURVIVED_TARGETS = ("W2_negative", "nonaffine")
# Predictors of the packing, by the beginning of their columns.
TIMES = {"packing": "packing", "own_motion": "own", "packing_path": "path", "replay": "replay"}
IN_PACKING = (*TIMES, "persistence")
# Predictors whose score is positive where they predict the target.
SIGNED: dict[str, tuple[str, ...]] = {
    "W2_negative": (*IN_PACKING, *CLOSURE_PREDICTORS, *EIGENVALUE_PREDICTORS),
    "nonaffine": (),
    "contact_lost": IN_PACKING,
    "topology": IN_PACKING,
}
# Columns of the structural indicators; `EXPECTED` has the sign of each as a predictor, fixed by its
# meaning before anything was compared.
INDICATORS = {name: f"indicator_{name}" for name in EXPECTED}
GRADIENT = ("H11", "H12", "H21", "H22")
READ = (
    *("snapshot_before", "snapshot_after", "loop_before", "loop_after", "order", "w2"),
    *("nonaffinity", "sliding_contacts", "smallest_N", "fate", "contact_lost"),
    *(f"{by}_{what}" for by in TIMES.values() for what in EVENT_FIELDS),
    *(*GRADIENT, *CLOSURE_PREDICTORS.values(), *INDICATORS.values()),
    *(*EIGENVALUE_PREDICTORS, "packing_lambda_min_held"),
)
# Principal strain of an interval beyond which no rate of its start speaks for it: 1e-4, and a tenth
# for codes that write after whole time steps (docs/evidence/packing.md, table of the steps).
LONG_STEP = 1.1e-4
# Shortest time to an event, over the interval: the score of an earlier event is finite.
SOONEST = 1e-12
VERDICTS = ("stable", "unstable", "undetermined")
# Fates of earlier loops; a born loop is a later one.
ENDS = tuple(fate.name.lower() for fate in Fate if fate < Fate.BORN)
# Stands for all orders in the column of orders.
ALL = 0
SNAPSHOTS = ("snapshot_before", "snapshot_after")


def skill_tables(
    loops: Sequence[Path], increments: Sequence[Path], packing: Sequence[Path] = ()
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Tables of skill from the parts of a series, by interval, predictor and target, and by order.

    Both are empty without forces, the second one unless the packing predicts.
    """
    rows: list[Row] = []
    by_order: list[Row] = []
    for own, state, earlier in interval_columns(loops, increments, packing):
        order = np.minimum(state["order"], ORDERS[-1])
        for target, predictor, score, value, signed in targets(own, state, earlier):
            numbers = [own[name][0] for name in SKILL_COLUMNS[:2]]
            place = dict(zip(SKILL_COLUMNS[:4], (*numbers, predictor, target), strict=True))
            rows.append(place | score_skill(score, value, signed=signed))
            for n in ORDERS if packing else ():
                some = score_skill(score[order == n], value[order == n], signed=signed)
                by_order.append(place | {"order": n} | some)
    ordered = [*SKILL_COLUMNS[:4], "order", *SKILL_COLUMNS[4:]]
    return pd.DataFrame(rows, columns=list(SKILL_COLUMNS)), pd.DataFrame(by_order, columns=ordered)


def interval_columns(
    loops: Sequence[Path], increments: Sequence[Path], packing: Sequence[Path] = ()
) -> Iterator[tuple[Columns, Columns, Columns | None]]:
    """Arguments of `targets` for each interval in which a loop survived; none without forces."""
    earlier = None
    for k, (pair, snapshot) in enumerate(zip(increments, loops, strict=False)):
        own, state = part_columns(pair, READ), part_columns(snapshot, READ)
        if "w2" not in own:
            return
        state |= part_columns(packing[k], READ) if packing else {}
        if len(own["w2"]):
            yield own, state, earlier
        earlier = own


def part_columns(part: Path, wanted: Sequence[str] | None = None) -> Columns:
    """Read columns of a part of a dataset: those wanted that it has, or all but lists."""
    there = pyarrow.parquet.read_schema(part)
    kinds = zip(there.names, there.types, strict=True)
    plain = [name for name, kind in kinds if not pa.types.is_nested(kind)]
    names = plain if wanted is None else [name for name in wanted if name in plain]
    table = pyarrow.parquet.read_table(part, columns=names)
    return {name: table.column(name).to_numpy() for name in names}


def targets(
    own: Columns, state: Columns, earlier: Columns | None
) -> Iterator[tuple[str, str, Floats, Floats, bool]]:
    """Target, predictor, score, value, and whether the sign of the score is a prediction.

    The value is negative where the target came true; there is one of each for each loop.
    """
    # Over the square of the strain: a larger step has more work of either sign.
    H = np.stack([own[name] for name in GRADIENT], axis=1).reshape(-1, 2, 2)
    square = np.sum(rotation_and_stretch(H)[1] ** 2, axis=(1, 2))
    size = np.where(square > 0, square, np.nan)
    closures = {
        name: _of_all(state, -own[column] / size, own["loop_before"])
        for name, column in CLOSURE_PREDICTORS.items()
    }
    known = {name: -state[name] for name in EIGENVALUE_PREDICTORS if name in state}
    known |= {
        name: EXPECTED[name] * state[column]
        for name, column in INDICATORS.items()
        if column in state
    }
    counts = {"order": state["order"].astype(float)}
    counts["sliding"] = state["sliding_contacts"].astype(float)
    if "smallest_N" in state:
        counts["smallest_N"] = -state["smallest_N"]
    for target, value, predicted, past in _predicted(own, state, earlier):
        strained = closures if target in SURVIVED_TARGETS else {}
        scores = predicted | strained | known | {"persistence": past} | counts
        for name, score in scores.items():
            yield target, name, score, value, name in SIGNED[target]


def actual_values(own: Columns, state: Columns) -> dict[str, Floats]:
    """Value of each target for every earlier loop: negative where it came true.

    Targets other than the work need the columns of `facts`.
    """
    at = own["loop_before"]
    found = {TARGET: _of_all(state, own["w2"], at)}
    if "fate" in state:
        # Over a strain of zero: infinite, or not a number.
        moved = np.where(np.isfinite(own["nonaffinity"]), own["nonaffinity"], np.nan)
        known = moved[np.isfinite(moved)]
        tenth = np.quantile(known, 0.9) - moved if len(known) else moved
        found["nonaffine"] = _of_all(state, tenth, at)
        found["contact_lost"] = np.where(state["contact_lost"], -1.0, 1.0)
        found["topology"] = np.where(state["fate"] == "survived", 1.0, -1.0)
    return found


def _predicted(
    own: Columns, state: Columns, earlier: Columns | None
) -> Iterator[tuple[str, Floats, dict[str, Floats], Floats]]:
    """Target, value, scores of the packing and of the grains' own motion, and score of the past."""
    actual = actual_values(own, state)
    unknown = np.full(len(state["order"]), np.nan)

    def past(name: str) -> Floats:
        return unknown if earlier is None else _of_all(state, earlier[name], earlier["loop_after"])

    def by(what: str) -> dict[str, Floats]:
        columns = {name: f"{way}_{what}" for name, way in TIMES.items()}
        return {name: state[column] for name, column in columns.items() if column in state}

    work = {name: -values for name, values in by("w2").items()}
    yield TARGET, actual[TARGET], work, -past("w2")
    if "fate" not in state:
        return
    yield "nonaffine", actual["nonaffine"], by("nonaffinity"), past("nonaffinity")
    # Persistence: a loop that was not there before the last interval changes again.
    new = unknown if earlier is None else np.where(np.isnan(past("w2")), 1.0, -1.0)
    opening, closing = by("opening"), by("closing")
    soon = {name: _soon(time) for name, time in opening.items()}
    yield "contact_lost", actual["contact_lost"], soon, new
    soon = {name: _soon(np.minimum(opening[name], closing[name])) for name in opening}
    yield "topology", actual["topology"], soon, new


def _of_all(state: Columns, values: Floats, rows: Integers) -> Floats:
    """Values of some loops, nan for the others."""
    every = np.full(len(state["order"]), np.nan)
    every[rows] = values
    return every


def _soon(time: Floats) -> Floats:
    """Score of a time to an event: positive within the interval, larger for earlier events."""
    return 1.0 / np.maximum(time, SOONEST) - 1.0


def score_skill(score: Floats, value: Floats, *, signed: bool) -> dict[str, Any]:
    """Skill of a score over one interval; nan where a share has no denominator.

    `base`: share of the loops with `value < 0` among those with a value other than zero;
    `coverage`: share of these that have a score; all others are over loops with both. `agreement`,
    `precision`, `recall`: of the sign; `auc`: chance that of two loops of either sign the negative
    one has the higher score, one half for ties (Mann and Whitney); `rank_correlation`: Spearman's,
    of the score with -value.
    """
    moved = np.isfinite(value) & (value != 0)
    known = moved & np.isfinite(score)
    scores, values = score[known], value[known]
    actual, predicted = values < 0, scores > 0
    hits, negative = np.count_nonzero(actual & predicted), int(np.count_nonzero(actual))
    # Rank sum of the negative loops, less its least value: the number of pairs ranked rightly.
    pairs = float(rankdata(scores)[actual].sum()) - 0.5 * negative * (negative + 1)
    constant = not len(scores) or np.ptp(scores) == 0 or np.ptp(values) == 0
    return {
        "base": _share(np.count_nonzero(value[moved] < 0), np.count_nonzero(moved)),
        "coverage": _share(len(scores), np.count_nonzero(moved)),
        "agreement": _share(np.count_nonzero(actual == predicted) if signed else None, len(actual)),
        "precision": _share(hits if signed else None, np.count_nonzero(predicted)),
        "recall": _share(hits if signed else None, negative),
        "auc": _share(pairs, negative * (len(actual) - negative)),
        "rank_correlation": float("nan") if constant else spearmanr(scores, -values).statistic,
        "loops": len(scores),
    }


def _share(part: Any, whole: Any) -> float:
    return float("nan") if part is None or not whole else float(part / whole)


def mean_skill(table: pd.DataFrame, target: str = TARGET) -> dict[str, Any]:
    """Means over the intervals by predictor, weighted by loops, and the range of the AUC."""
    found: dict[str, dict[str, Any]] = {}
    for name, every in table[table["target"] == target].groupby("predictor", sort=False):
        rows = every[every["loops"] > 0]
        row: Row = {"loops": int(rows["loops"].sum())}
        for key in MEASURES:
            known = rows[rows[key].notna()]
            mean = np.average(known[key], weights=known["loops"]) if len(known) else None
            row[key] = None if mean is None else float(mean)
        auc = rows["auc"].dropna()
        row |= {"auc_min": float(auc.min()), "auc_max": float(auc.max())} if len(auc) else {}
        found[str(name)] = row
    return found


def skill_summary(table: pd.DataFrame, by_order: pd.DataFrame) -> Summary:
    """Skill for the summary: means over the intervals by target, and by order."""
    summary: Summary = {"skill": mean_skill(table)}
    if len(by_order):
        summary["skill_of_targets"] = {target: mean_skill(table, target) for target in OTHERS}
        means = {n: mean_skill(by_order[by_order["order"] == n]) for n in ORDERS}
        summary["skill_by_order"] = {
            name: {f"order_{n}": means[n][name]["auc"] for n in ORDERS} for name in means[ORDERS[0]]
        }
    return summary


def write_fates(
    parts: Sequence[Path], loops: Sequence[Path], file: Path, source: Mapping[str, Any]
) -> pd.DataFrame:
    """Write all fates to one file, with the verdicts on the earlier loops; the table of survival.

    Each interval is a row group, and only one is in memory at a time.
    """
    rows: list[Row] = []
    writer = None
    for part, earlier in zip(parts, loops, strict=False):
        read = pyarrow.parquet.read_table(part)
        columns = {name: read.column(name).combine_chunks() for name in read.column_names}
        codes = verdict_codes(earlier, columns["loop_before"].to_numpy())
        words = np.array([*VERDICTS, ""])
        columns |= {f"{judge}_verdict": pa.array(words[k]) for judge, k in codes.items()}
        table = described_table("series/fates", columns, {KEY: as_json(source).encode()})
        if writer is None:
            writer = pyarrow.parquet.ParquetWriter(file, table.schema)
        writer.write_table(table)
        rows += survival_rows(columns, codes)
    if writer is not None:
        writer.close()
    return pd.DataFrame(rows)


def verdict_codes(earlier: Path, loop: Any) -> dict[str, Any]:
    """Place of each loop's verdict in `VERDICTS` by judge; one more for a born loop (-1)."""
    found = judges(dict.fromkeys(pyarrow.parquet.read_schema(earlier).names))
    table = pyarrow.parquet.read_table(earlier, columns=[f"{judge}_lambda_min" for judge in found])
    codes = {}
    for judge, column in zip(found, table.columns, strict=True):
        smallest = column.to_numpy()
        said = np.where(smallest < -RTOL, 1, np.where(np.isfinite(smallest), 0, 2))
        codes[judge] = np.append(said, len(VERDICTS))[loop]
    return codes


def survival_rows(columns: Mapping[str, Any], codes: Mapping[str, Any]) -> list[Row]:
    """Rows of one interval: by judge, verdict and order, the number of loops of each fate."""
    earlier = columns["loop_before"].to_numpy() >= 0
    ends = columns["fate"].filter(pa.array(earlier))
    fate = pc.index_in(ends, value_set=pa.array(ENDS)).to_numpy()
    order = np.minimum(columns["order_before"].to_numpy()[earlier], LAST_ORDER)
    shape, rows = (len(VERDICTS), LAST_ORDER + 1, len(ENDS)), []
    for judge, code in codes.items():
        place = (code[earlier] * shape[1] + order) * shape[2] + fate
        found = np.bincount(place, minlength=np.prod(shape)).reshape(shape)
        # No loop has the order 0: its place counts all orders together.
        found[:, ALL] = found.sum(axis=1)
        for verdict, by_order in zip(VERDICTS, found, strict=True):
            for n in np.flatnonzero(by_order.any(axis=1)).tolist():
                row = {name: columns[name][0].as_py() for name in SNAPSHOTS}
                row |= {"judge": judge, "verdict": verdict, "order": n}
                rows.append(row | survival(dict(zip(ENDS, by_order[n].tolist(), strict=True))))
    return rows


def survival(counts: Mapping[str, int]) -> dict[str, Any]:
    """Number of loops by fate, share that survived and its 95 % interval by Wilson's score."""
    loops = sum(counts.values())
    share = counts["survived"] / loops
    low, high = binomtest(counts["survived"], loops).proportion_ci(0.95, method="wilson")
    # An end that is the share itself may miss it by rounding.
    return {
        "loops": loops,
        **counts,
        "share": share,
        "share_low": min(float(low), share),
        "share_high": max(float(high), share),
    }


def pooled(table: pd.DataFrame, judge: str, verdict: str, order: int) -> dict[str, Any] | None:
    """`survival` of all intervals together, and its `spread` over them; None without loops."""
    asked = (table["judge"] == judge) & (table["verdict"] == verdict) & (table["order"] == order)
    rows = table[asked]
    if rows.empty:
        return None
    counts = {name: int(rows[name].sum()) for name in ENDS}
    return survival(counts) | {"over_intervals": spread(rows["share"])}


def survival_summary(table: pd.DataFrame) -> Summary:
    """Survival by judge and verdict, of all orders and intervals."""
    summary = {}
    for judge in table["judge"].unique():
        found = {verdict: pooled(table, judge, verdict, ALL) for verdict in VERDICTS}
        summary[judge] = {verdict: one for verdict, one in found.items() if one is not None}
    return summary
