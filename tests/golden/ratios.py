"""Times and errors beside the stored record: `python -m tests.golden.ratios RESULT_FOLDER`.

The folder is that of `grainloops bench --out RESULT_FOLDER`; the record is `performance.json`.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pandas as pd

RECORD = Path(__file__).parent / "performance.json"


def ratios(bench: pd.DataFrame) -> pd.DataFrame:
    """Each row that both have: seconds before and now, their ratio, errors before and now."""
    before = pd.DataFrame(json.loads(RECORD.read_text())["accuracy"])
    keys = ["group", "method", "setting"]
    both = before.merge(bench.assign(group=bench.group.str.lower()), on=keys)
    both["ratio"] = both.seconds_per_item_y / both.seconds_per_item_x
    names = {"seconds_per_item_x": "before", "seconds_per_item_y": "now"}
    shown = [*keys, "before", "now", "ratio", "error_x", "error_y"]
    return both.rename(columns=names)[shown]


if __name__ == "__main__":
    table = ratios(pd.read_csv(Path(sys.argv[1]) / "bench.csv"))
    print(table.to_string(index=False, float_format="{:.2g}".format))
    print(f"median ratio {table.ratio.median():.2f}, largest {table.ratio.max():.2f}")
