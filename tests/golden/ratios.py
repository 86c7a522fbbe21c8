"""Times and errors beside the stored record: `python -m tests.golden.ratios RESULT_FOLDER [PAGE]`.

The folder is that of `grainloops bench --out RESULT_FOLDER`; the record is `performance.json`.
With the path of docs/accuracy.md its times become those of the folder, each with its ratio.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import pandas as pd

RECORD = Path(__file__).parent / "performance.json"
KEYS = ["group", "method", "setting"]
TIME, RATIO = "s per item", "to before"


def ratios(bench: pd.DataFrame) -> pd.DataFrame:
    """Each row that both have: seconds before and now, their ratio, errors before and now."""
    before = pd.DataFrame(json.loads(RECORD.read_text())["accuracy"])
    both = before.merge(bench.assign(group=bench.group.str.lower()), on=KEYS)
    both["ratio"] = both.seconds_per_item_y / both.seconds_per_item_x
    names = {"seconds_per_item_x": "before", "seconds_per_item_y": "now"}
    shown = [*KEYS, "before", "now", "ratio", "error_x", "error_y"]
    return both.rename(columns=names)[shown]


def renewed(text: str, bench: pd.DataFrame) -> str:
    """A page whose tables of methods have the times of a bench, and their ratios to the record."""
    rows = bench.assign(group=bench.group.str.lower()).set_index(KEYS).seconds_per_item
    ratio = ratios(bench).set_index(KEYS).ratio
    parts = re.split(r"(?m)^(?=##)", text)
    for k, part in enumerate(parts):
        group = part.split("\n")[0].lstrip("# ").lower()
        if group in rows.index.get_level_values("group") and f"| {TIME} |" in part:
            parts[k] = _section(group, part, rows, ratio)
    return "".join(parts)


def _section(group: str, part: str, rows: pd.Series, ratio: pd.Series) -> str:
    lines, columns = [], []
    for line in part.split("\n"):
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if TIME in cells:
            columns = [name for name in cells if name != RATIO]
            line = "| " + " | ".join([*columns, RATIO]) + " |"
        elif line.startswith("|---"):
            line = "|" + "---|" * (len(columns) + 1)
        elif columns and line.startswith("|"):
            row = dict(zip(columns, cells, strict=False))
            key = (group, row["method"], row["setting"].replace(" **(default)**", ""))
            told = "-" if key not in ratio.index else f"{ratio[key]:.2f}"
            if key in rows.index:
                old, row[TIME] = row[TIME], f"{rows[key]:.1e}"
                # The text above the table tells some of them.
                lines = [one.replace(f"({old} s,", f"({row[TIME]} s,") for one in lines]
            line = "| " + " | ".join([*(row[name] for name in columns), told]) + " |"
        lines.append(line)
    return "\n".join(lines)


if __name__ == "__main__":
    bench = pd.read_csv(Path(sys.argv[1]) / "bench.csv")
    if len(sys.argv) > 2:
        Path(sys.argv[2]).write_text(renewed(Path(sys.argv[2]).read_text(), bench))
    table = ratios(bench)
    print(table.to_string(index=False, float_format="{:.2g}".format))
    print(f"median ratio {table.ratio.median():.2f}, largest {table.ratio.max():.2f}")
