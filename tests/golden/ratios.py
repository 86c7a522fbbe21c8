"""Times beside the stored record: `python -m tests.golden.ratios RESULT_TABLE [PAGE]`.

The table is `bench.csv` of `grainloops bench --out DIR`, or `settled.csv` of
`python -m tests.tools.settled --out DIR`; the record is `performance.json`. With the path of
docs/evidence/accuracy.md the times of the page become those of the table.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import pandas as pd

RECORD = Path(__file__).parent / "performance.json"
KEYS = ["group", "method", "setting"]
TIME = "s per item"


def ratios(bench: pd.DataFrame) -> pd.DataFrame:
    """Rows that both have: seconds of the record and now, their ratio, errors of both."""
    record = pd.DataFrame(json.loads(RECORD.read_text())["accuracy"])
    both = record.merge(bench.assign(group=bench.group.str.lower()), on=KEYS)
    both["ratio"] = both.seconds_per_item_y / both.seconds_per_item_x
    names = {"seconds_per_item_x": "record", "seconds_per_item_y": "now"}
    shown = [*KEYS, "record", "now", "ratio", "error_x", "error_y"]
    return both.rename(columns=names)[shown]


def renewed(text: str, bench: pd.DataFrame) -> str:
    """A page whose tables of methods have the times of a bench."""
    seconds = bench.assign(group=bench.group.str.lower()).set_index(KEYS).seconds_per_item
    parts = re.split(r"(?m)^(?=##)", text)
    for k, part in enumerate(parts):
        group = part.split("\n")[0].lstrip("# ").lower()
        lines: list[str] = []
        columns: list[str] = []
        for line in part.split("\n"):
            cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
            if TIME in cells:
                columns = cells
            elif columns and line.startswith("|") and not line.startswith("|---"):
                row = dict(zip(columns, cells, strict=True))
                setting, _, default = row["setting"].partition(" **")
                key = (group, row["method"], setting)
                if key in seconds.index:
                    row[TIME] = f"{seconds[key]:.1e}"
                    # The text above the table quotes the knee and the default.
                    named = row["method"] if default else f"{row['method']}, {setting}"
                    quoted = rf"({re.escape(named)}\s+)\([^ ]+ s,"
                    told = re.sub(quoted, rf"\1({row[TIME]} s,", "\n".join(lines))
                    lines = told.split("\n")
                line = "| " + " | ".join(row.values()) + " |"
            lines.append(line)
        parts[k] = "\n".join(lines)
    return "".join(parts)


if __name__ == "__main__":
    bench = pd.read_csv(sys.argv[1])
    if len(sys.argv) > 2:
        Path(sys.argv[2]).write_text(renewed(Path(sys.argv[2]).read_text(), bench))
    table = ratios(bench)
    print(table.to_string(index=False, float_format="{:.2g}".format))
    print(f"median ratio {table.ratio.median():.2f}, largest {table.ratio.max():.2f}")
