"""Limits of two states by direction of stress, Yade and path: the figure of docs/sustaining.md.

`python -m tests.tools.sustaining` computes the paths anew, and writes docs/figures/sustaining.csv
and sustaining.png. What Yade held and moved under is kept in the table.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.projections.polar import PolarAxes

from loops import GrainGraph, LinearFrictional
from stability.packing import sustain
from studies.style import BLUE, LIGHT_GREY, TWO_COLUMNS, VERMILION, new_figure, styled

ROOT = Path(__file__).parents[2]
TABLE = ROOT / "docs/figures/sustaining.csv"
STATES = ROOT / "tests/stability/packing/yade_stress_steps.npz"
LAW = LinearFrictional(1e6, 5e5, 0.5, "radii")
# Letter of the stored state, and the loads at the rim and the centre of its panel.
OF_STATE = {
    "0.003": ("b", 96.0, 0.5),
    "0.030": ("a", 32.0, 0.02),
    "0.030 restarted": ("c", 32.0, 0.02),
}


def state_of(name: str) -> GrainGraph:
    """A state that Yade held at rest."""
    parts = ("x", "radii", "contacts", "images", "cell", "normal_force", "shear_force")
    with np.load(STATES) as stored:
        return GrainGraph(**{part: stored[f"{OF_STATE[name][0]} {part}"] for part in parts})


def with_paths(table: pd.DataFrame) -> pd.DataFrame:
    """The table with the path's columns computed anew."""
    rows = []
    for row in table.itertuples():
        theta = np.radians(row.degrees)
        largest = 1.5 * row.moved if row.moved > 0 else row.held
        direction = [[np.cos(theta), np.sin(theta)]]
        (path,) = sustain(state_of(row.state), LAW, direction, largest=largest).paths
        rows.append((path.status, path.first_instability, path.limit, path.failed_under))
        print(row.state, row.degrees, *rows[-1], flush=True)
    own = ["status", "first_instability", "limit", "failed_under"]
    return table[["state", "degrees", "held", "moved"]].join(pd.DataFrame(rows, columns=own))


@styled()
def figure_of_limits(table: pd.DataFrame) -> Figure:
    """Bars of Yade from held to moved, and the limits of the paths, on logarithmic radii."""
    figure = new_figure(TWO_COLUMNS, 2.7)
    for place, (state, (_, largest, centre)) in enumerate(OF_STATE.items(), start=1):
        own = table[table["state"] == state]
        ax = figure.add_subplot(1, 3, place, projection="polar")
        assert isinstance(ax, PolarAxes)
        theta, held = np.radians(own["degrees"]), np.maximum(own["held"], centre)
        moved = own["moved"].fillna(1.2 * own["held"])
        low, high = np.log10(held / centre), np.log10(moved / centre)
        ax.bar(theta, high - low, 0.26, low, color="0.72")
        for failed, marker, colour in ((True, "X", VERMILION), (False, "o", BLUE)):
            some = own[(own["status"] == "failed") == failed]
            radius = np.log10(some["limit"] / centre)
            ax.plot(np.radians(some["degrees"]), radius, marker, color=colour, markersize=3.5)
        decades = 10.0 ** np.arange(np.ceil(np.log10(centre)), np.log10(largest) + 1e-9)
        ax.set_rticks(np.log10(decades / centre), [f"{load:g}" for load in decades])
        ax.set_ylim(0.0, np.log10(1.4 * largest / centre))
        ax.set_rlabel_position(-22.5)
        ax.set_thetagrids(range(0, 360, 45))
        ax.grid(color=LIGHT_GREY, linewidth=0.5)
        ax.set_title(f"strain {state}")
    (fails,) = ax.plot([], [], "X", color=VERMILION, label="path: limit (N/m)")
    (holds,) = ax.plot([], [], "o", color=BLUE, label="path: held throughout")
    bars = Patch(color="0.72", label="Yade: held to moved (N/m)")
    figure.legend(handles=[bars, fails, holds], loc="outside lower center", ncols=3)
    return figure


if __name__ == "__main__":
    found = with_paths(pd.read_csv(TABLE, dtype={"state": str}))
    found.to_csv(TABLE, index=False, float_format="%.6g")
    figure_of_limits(found).savefig(TABLE.with_suffix(".png"))
