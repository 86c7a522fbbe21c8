"""AUC for negative work over the share of its strength from which a contact is a candidate.

`python -m tests.tools.interval_candidates OUT.csv NAME GRAINS...` adds the rows of a series;
`python -m tests.tools.interval_candidates --draw TABLE.csv FIGURE.png` draws them.
"""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd

from patterns import read_snapshot
from stability.packing import PackingIncrements, loop_rates
from studies.series.evolution import loop_increments, sample_strain, track_loops
from studies.series.skill import score_skill
from studies.snapshot.in_packing import fixed_point, sample_edge
from studies.style import LINE_COLOURS, ONE_COLUMN, new_figure, styled

SHARES = (0.97, 0.95, 0.9, 0.8, 0.7, 0.5)


def measured(name: str, paths: list[str]) -> pd.DataFrame:
    """One row a share: mean of the AUC over the intervals, weighted by loops."""
    snapshots = [read_snapshot(path) for path in paths]
    found: dict[float, list[tuple[float, int]]] = {share: [] for share in SHARES}
    for before, after in pairwise(snapshots):
        H, fates = sample_strain(before, after)[0], track_loops(before, after)
        table, value = loop_increments(before, after, fates), np.full(len(fates.before), np.nan)
        value[table["loop_before"]] = table["w2"]
        for share in SHARES:
            edge = sample_edge(before, share, fixed_point(before, after, H))
            response = PackingIncrements(edge).response(H)
            score = -loop_rates(response, before.faces).normalised_work
            skill = score_skill(score, value, signed=True)
            found[share].append((skill["auc"], skill["loops"]))
    means = {share: np.average(*np.transpose(rows)) for share, rows in found.items()}
    return pd.DataFrame({"series": name, "share": list(means), "auc": list(means.values())})


@styled()
def drawn(table: pd.DataFrame, path: Path) -> None:
    """Curve of each series."""
    figure = new_figure(ONE_COLUMN, 3.4)
    ax = figure.subplots()
    names = table["series"].drop_duplicates().tolist()
    for k, name in enumerate(names):
        rows = table[table["series"] == name]
        style = "s--" if name.endswith("1e-4") else "o-"
        colour = LINE_COLOURS[k // 2 % len(LINE_COLOURS)]
        ax.plot(rows["share"], rows["auc"], style, color=colour, markersize=3, label=name)
    ax.set(xlabel="candidates from this share of the strength", ylabel="AUC for W2 < 0")
    ax.set_ylim(0.82, 1.05)
    ax.legend(fontsize=5.5, ncols=2, loc="upper left")
    figure.savefig(path, dpi=200)


if __name__ == "__main__":
    if sys.argv[1] == "--draw":
        drawn(pd.read_csv(sys.argv[2]), Path(sys.argv[3]))
    else:
        out, name, *paths = sys.argv[1:]
        rows, file = measured(name, paths), Path(out)
        rows.to_csv(file, mode="a", header=not file.exists(), index=False)
