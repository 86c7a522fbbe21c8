"""Fates of all loops beside the verdicts on them, and the share of loops that survive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet
from scipy.stats import binomtest

from loops.tracking import Fate
from stability import RTOL
from studies.output import as_json, described_table
from studies.series.dataset import KEY
from studies.snapshot.statistics import LAST_ORDER, spread
from studies.snapshot.summary import judges

VERDICTS = ("stable", "unstable", "undetermined")
# Fates of earlier loops; a born loop is a later one.
ENDS = tuple(fate.name.lower() for fate in Fate if fate < Fate.BORN)
# Stands for all orders in the column of orders.
ALL = 0
SNAPSHOTS = ("snapshot_before", "snapshot_after")


def write_fates(
    parts: Sequence[Path], loops: Sequence[Path], file: Path, source: Mapping[str, Any]
) -> pd.DataFrame:
    """Write all fates to one file, with the verdicts on the earlier loops; the table of survival.

    Each interval is a row group, and only one is in memory at a time.
    """
    rows: list[dict[str, Any]] = []
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


def survival_rows(columns: Mapping[str, Any], codes: Mapping[str, Any]) -> list[dict[str, Any]]:
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


def survival_summary(table: pd.DataFrame) -> dict[str, Any]:
    """Survival by judge and verdict, of all orders and intervals."""
    summary = {}
    for judge in table["judge"].unique():
        found = {verdict: pooled(table, judge, verdict, ALL) for verdict in VERDICTS}
        summary[judge] = {verdict: one for verdict, one in found.items() if one is not None}
    return summary
