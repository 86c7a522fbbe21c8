"""What became of every loop, beside what had been judged of it; which verdicts survive."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet

from loops.tracking import Fate, LoopFates
from stability import RTOL
from studies.output import as_json, described_table
from studies.series.dataset import KEY
from studies.snapshot.statistics import LAST_ORDER, spread
from studies.snapshot.summary import judges

NAMES = np.array([fate.name.lower() for fate in Fate])
VERDICTS = ("stable", "unstable", "undetermined")
# Of all fates but born, which is not one of an earlier loop.
ENDS = tuple(NAMES[: Fate.BORN].tolist())
ALL = 0
NUMBERS = ("snapshot_before", "snapshot_after")
# Half the width of a normal distribution that holds 95 %.
Z95 = 1.959963984540054
Table = dict[str, list[Any]]


def fate_columns(fates: LoopFates) -> dict[str, Any]:
    """One row an earlier loop, then one a loop that was born, with -1 and 0 for what isn't there.

    `loop_before`, `fate`, `successor` (the one that shares most half-edges), `successors` (all that
    share any), `order_before`, `order_after` (of the successor).
    """
    born = np.flatnonzero(fates.after == Fate.BORN)
    count = np.bincount(fates.links[:, 0], minlength=len(fates.before))
    ends = np.cumsum([0, *count, *np.ones_like(born)], dtype=np.int32)
    successors = np.concatenate([fates.links[:, 1], born])
    none = np.full(len(born), -1)
    # What has no successor finds the order 0 at the end.
    order = np.append(fates.order_after, 0)
    successor = np.concatenate([fates.successor, born])
    return {
        "loop_before": np.concatenate([np.arange(len(fates.before)), none]),
        "fate": NAMES[np.concatenate([fates.before, fates.after[born]])],
        "successor": successor,
        "successors": pa.ListArray.from_arrays(pa.array(ends), pa.array(successors)),
        "order_before": np.concatenate([fates.order_before, np.zeros_like(born)]),
        "order_after": order[successor],
    }


def write_fates(
    parts: Sequence[Path], loops: Sequence[Path], file: Path, source: Mapping[str, Any]
) -> Table:
    """All fates as one file, the verdicts on the earlier loops beside them; who survived.

    An interval is one row group, and no more is held at a time.
    """
    rows: list[dict[str, Any]] = []
    writer = None
    for part, earlier in zip(parts, loops, strict=False):
        read = pyarrow.parquet.read_table(part)
        columns = {name: read.column(name).combine_chunks() for name in read.column_names}
        verdicts = dict(_verdicts(earlier, columns["loop_before"].to_numpy()))
        words = np.array([*VERDICTS, ""])
        columns |= {f"{judge}_verdict": pa.array(words[k]) for judge, k in verdicts.items()}
        about = {KEY: as_json(source).encode()}
        table = described_table("series/fates", columns, about)
        if writer is None:
            writer = pyarrow.parquet.ParquetWriter(file, table.schema)
        writer.write_table(table)
        rows += _survivals(columns, verdicts)
    if writer is not None:
        writer.close()
    return {name: [row[name] for row in rows] for name in (rows[0] if rows else ())}


def _verdicts(earlier: Path, loop: Any) -> Iterator[tuple[str, Any]]:
    """By judge: the place of what is said of each loop, behind the last of one that was born."""
    names = pyarrow.parquet.read_schema(earlier).names
    found = judges(dict.fromkeys(names))
    table = pyarrow.parquet.read_table(earlier, columns=[f"{judge}_lambda_min" for judge in found])
    for judge, column in zip(found, table.columns, strict=True):
        smallest = column.to_numpy()
        said = np.where(smallest < -RTOL, 1, np.where(np.isfinite(smallest), 0, 2))
        yield judge, np.append(said, len(VERDICTS))[loop]


def _survivals(columns: Mapping[str, Any], verdicts: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Of one interval: how many loops of each verdict and order met which fate."""
    earlier = columns["loop_before"].to_numpy() >= 0
    ends = columns["fate"].filter(pa.array(earlier))
    fate = pc.index_in(ends, value_set=pa.array(ENDS)).to_numpy()
    order = np.minimum(columns["order_before"].to_numpy()[earlier], LAST_ORDER)
    numbers = {name: columns[name][0].as_py() for name in NUMBERS if len(fate)}
    shape = len(VERDICTS), LAST_ORDER + 1, len(ENDS)
    for judge, codes in verdicts.items():
        place = (codes[earlier] * shape[1] + order) * shape[2] + fate
        found = np.bincount(place, minlength=np.prod(shape)).reshape(shape)
        # Nothing has no grains: the first place takes all orders together.
        found[:, ALL] = found.sum(axis=1)
        for verdict, by_order in zip(VERDICTS, found, strict=True):
            for n in (ALL, *range(3, LAST_ORDER + 1)):
                if loops := int(by_order[n].sum()):
                    key = {"judge": judge, "verdict": verdict, "order": n}
                    counts = dict(zip(ENDS, by_order[n].tolist(), strict=True))
                    yield numbers | key | survival(loops, counts)


def survival(loops: int, counts: Mapping[str, int]) -> dict[str, Any]:
    """Loops by fate, the share that survived and its interval by Wilson's score, 95 %."""
    p, z2 = counts["survived"] / loops, Z95**2 / loops
    middle = (p + 0.5 * z2) / (1 + z2)
    half = np.sqrt(z2 * (p * (1 - p) + 0.25 * z2)) / (1 + z2)
    # Of none or all of the loops one end is that share itself, but for rounding.
    low, high = min(max(middle - half, 0.0), p), max(min(middle + half, 1.0), p)
    return {
        "loops": loops,
        **counts,
        "share": p,
        "share_low": float(low),
        "share_high": float(high),
    }


def pooled(table: Table, judge: str, verdict: str, order: int) -> dict[str, Any] | None:
    """`survival` of all intervals together, and its `spread` over them; None without loops."""
    asked = (judge, verdict, order)
    key = zip(table["judge"], table["verdict"], table["order"], strict=True)
    rows = [k for k, one in enumerate(key) if one == asked]
    if not rows:
        return None
    counts = {name: sum(table[name][k] for k in rows) for name in ENDS}
    over = spread([table["share"][k] for k in rows])
    return survival(sum(counts.values()), counts) | {"over_intervals": over}


def survival_summary(table: Table) -> dict[str, Any]:
    """By judge and verdict, of all orders and intervals."""
    found = {
        judge: {verdict: pooled(table, judge, verdict, ALL) for verdict in VERDICTS}
        for judge in dict.fromkeys(table.get("judge", ()))
    }
    return {
        judge: {verdict: one for verdict, one in by_verdict.items() if one is not None}
        for judge, by_verdict in found.items()
    }
