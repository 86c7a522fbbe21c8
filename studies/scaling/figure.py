"""Time and memory over the number of grains, drawn."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    TWO_COLUMNS,
    VERMILION,
    new_figure,
    styled,
)

COLOURS = {
    "compiled": BLUE,
    "numpy": VERMILION,
    "networkx": PURPLE,
    "shapely": ORANGE,
    "by size": BLACK,
}
TITLES = {"faces": "faces", "table": "table of all loops, both closures"}
Rows = list[dict[str, Any]]


@styled()
def scaling_figure(rows: Rows, floors: dict[str, dict[int, float]]) -> Figure:
    """Time for faces and for the table, and memory per grain."""
    figure = new_figure(TWO_COLUMNS, 2.9)
    panels = figure.subplots(1, 3)
    shown: dict[str, Any] = {}
    for ax, what in zip(panels, TITLES, strict=False):
        _times(ax, rows, what)
        if what == "table":
            _line(ax, rows, ("snapshot", "by size"), "seconds", "whole snapshot, no figures")
        sizes = sorted(floors[what])
        times = [floors[what][n] for n in sizes]
        ax.loglog(sizes, times, "--", color=GREY, label="memory bandwidth")
        ax.set(xlabel="number of grains", ylabel="time (s)", title=TITLES[what])
        handles, labels = ax.get_legend_handles_labels()
        shown |= dict(zip(labels, handles, strict=True))
    figure.legend(shown.values(), shown.keys(), loc="outside lower left", ncols=6)
    for what, how, colour, label in (
        ("faces", "compiled", BLUE, "faces"),
        ("table", "compiled", GREEN, "table"),
        ("snapshot", "by size", BLACK, "whole snapshot"),
    ):
        _line(panels[2], rows, (what, how), "bytes_per_grain", label, colour)
    low, high = panels[2].get_ylim()
    # Room for the legend above the lines.
    panels[2].set(xlabel="number of grains", ylabel="bytes per grain", title="memory taken")
    panels[2].set_ylim(low, high * (high / low) ** 0.6)
    panels[2].legend(loc="upper left")
    return figure


def _times(ax: Axes, rows: Rows, what: str) -> None:
    for how in dict.fromkeys(row["how"] for row in rows if row["what"] == what):
        _line(ax, rows, (what, how), "seconds", how)


def _line(
    ax: Axes, rows: Rows, method: tuple[str, str], key: str, label: str, colour: str | None = None
) -> None:
    own = sorted((row["grains"], row[key]) for row in rows if (row["what"], row["how"]) == method)
    x, y = [point[0] for point in own], [point[1] for point in own]
    ax.loglog(x, y, "o-", color=colour or COLOURS[method[1]], label=label)
