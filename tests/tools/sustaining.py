"""First large motions and limits beside Yade's, and limits over interval and numbering.

`python -m tests.tools.sustaining` computes both tables of docs/sustaining.md anew, and draws their
figures. The column `before` of the intervals is that of the springs that the code had until
November 2026, and is kept.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from loops import Scene
from stability.packing import sustain
from stability.packing.sustain import renumbered
from studies.style import BLUE, GREY, ORANGE, TWO_COLUMNS, VERMILION, new_panels, styled
from tests.stability.packing.yade_rest import STATES, bracket, yade_rest

FIGURES = Path(__file__).parents[2] / "docs/figures"
LOADS, INTERVALS = FIGURES / "sustaining.csv", FIGURES / "sustaining_intervals.csv"
# State, direction in degrees and largest load (N/m) of the limits over interval and numbering.
VARIED = "slow", 150.0, 20.0
# Largest load over the one under which Yade's sample moved.
BEYOND = 1.5
TITLES = {
    "slow": "slow sample at its peak",
    "dense": "after a pronounced peak",
    "held": "medium density, strain 0.030",
}


def loads_beside_yade() -> Iterator[dict[str, object]]:
    """One row a direction of every state that Yade loaded."""
    for state in STATES:
        graph, law, levels = yade_rest(state)
        for degrees, own in levels.items():
            low, high = bracket(own)
            theta = np.radians(degrees)
            largest = BEYOND * high
            along = [[np.cos(theta), np.sin(theta)]]
            (path,) = sustain(Scene(graph, law), along, largest=largest).paths
            row = {
                "state": state,
                "degrees": degrees,
                "held": low,
                "moved": high,
                "yade_strain": own["strain"].iloc[-1],
                "status": path.status,
                "limit": path.limit,
                "limit_spread": path.limit_spread,
                "first_large_load": path.first_large_load,
                "first_large_strain": path.first_large_strain,
                "first_large_spread": path.first_large_spread,
                "seconds": path.seconds,
                "spread_seconds": path.spread_seconds,
            }
            print(*row.values(), flush=True)
            yield row


def limits_anew(table: pd.DataFrame) -> pd.DataFrame:
    """The table of intervals and numberings with the limits of today."""
    state, degrees, largest = VARIED
    graph, law, _ = yade_rest(state)
    theta = np.radians(degrees)
    after = []
    for row in table.itertuples():
        scene = Scene(graph, law)
        if row.numbering:
            scene = renumbered(scene, row.numbering)
        how = {"largest": largest, "interval": row.interval, "spread": False}
        (path,) = sustain(scene, [[np.cos(theta), np.sin(theta)]], **how).paths
        print(row.interval, row.numbering, path.limit, flush=True)
        after.append(path.limit)
    return table.assign(after=after)


@styled()
def figure_of_loads(table: pd.DataFrame) -> Figure:
    """Bars of Yade from held to moved, limits, spreads, first large motions, one panel a state."""
    states = [state for state in TITLES if (table["state"] == state).any()]
    figure, (panels,) = new_panels(1, len(states), 2.9, width=TWO_COLUMNS)
    for ax, state in zip(panels, states, strict=True):
        own = table[table["state"] == state].reset_index(drop=True)
        place, high = np.arange(len(own)), own["moved"].replace(np.inf, np.nan)
        ax.bar(place, high - own["held"], 0.6, own["held"], color="0.75", label="Yade: held, moved")
        limit, spread = own["limit"], own["limit"] * own["limit_spread"]
        look = {"color": BLUE, "markersize": 4, "capsize": 3}
        ax.errorbar(place, limit, spread, fmt="o", label="equilibrium lost, its spread", **look)
        large = own["first_large_load"]
        ax.plot(place, large, "X", color=VERMILION, markersize=5, label="first large motion")
        ax.set_xticks(place, [f"{d:g}" for d in own["degrees"]])
        ends = own["held"].min(), max(own["moved"].max(), large.max())
        ax.set(title=TITLES[state], xlabel="direction of stress (degrees)")
        ax.set_ylim(ends[0] - 0.08 * np.ptp(ends), ends[1] + 0.08 * np.ptp(ends))
    panels[0].set_ylabel("load (N/m)")
    handles = panels[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=3)
    return figure


@styled()
def figure_of_intervals(table: pd.DataFrame) -> Figure:
    """Limits over the interval, and over the numbering at one interval, before and after."""
    figure, ((over, across),) = new_panels(1, 2, 2.6, width=TWO_COLUMNS)
    plain, other = table[table["numbering"] == 0], table[table["interval"] == 5e-6]
    for ax, rows, key in ((over, plain, "interval"), (across, other, "numbering")):
        for name, colour, label in (
            ("before", ORANGE, "springs that hold grains"),
            ("after", BLUE, "one weak spring a grain, halved"),
        ):
            line = "-" if key == "interval" else ""
            ax.plot(rows[key], rows[name], f"o{line}", color=colour, markersize=4, label=label)
        ax.axhline(plain["after"].iloc[-1], color=GREY, linewidth=0.6)
        ax.set(ylabel="limit (N/m)", ylim=(0.0, 3.4))
    over.set(xscale="log", xlabel="interval of strain")
    across.set(xlabel="numbering of grains and contacts")
    over.legend(loc="lower left")
    return figure


if __name__ == "__main__":
    loads = pd.DataFrame(loads_beside_yade())
    loads.to_csv(LOADS, index=False, float_format="%.6g")
    limits = limits_anew(pd.read_csv(INTERVALS))
    limits.to_csv(INTERVALS, index=False, float_format="%.7g")
    figure_of_loads(loads).savefig(LOADS.with_suffix(".png"))
    figure_of_intervals(limits).savefig(INTERVALS.with_suffix(".png"))
