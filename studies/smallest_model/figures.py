"""Figure of what the smallest model saves."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator

from studies.style import BLACK, LINE_COLOURS, TWO_COLUMNS, new_figure, save_figure, styled


def draw(rows: list[dict[str, Any]], folder: Path, source: Mapping[str, Any]) -> None:
    """Draw the time of a path and the size of its linear system over the number of grains.

    Parameters
    ----------
    rows : list of dict
        From `measure.rows`.
    folder : Path
        Where to write `smallest_model` as PNG and SVG.
    source : mapping
        Provenance.
    """
    with styled():
        figure = new_figure(TWO_COLUMNS, 3.1)
        left, right = figure.subplots(1, 2)
        _draw(rows, "seconds", left)
        left.set(ylabel="processor time of a path (s)")
        left.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        left.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        _draw(rows, "unknowns", right)
        right.set(ylabel="unknowns of the rates")
        figure.legend(handles=_legend(rows), loc="outside lower center", ncols=3)
        save_figure(figure, folder, "smallest_model", source)


def _draw(rows: list[dict[str, Any]], quantity: str, ax: Axes) -> None:
    for scene, colour in zip(_scenes(rows), LINE_COLOURS, strict=False):
        own = [row for row in rows if row["scene"] == scene]
        orders = [row["order"] for row in own]
        ax.loglog(orders, [row[f"{quantity}_auto"] for row in own], "o-", color=colour, ms=3)
        ax.loglog(orders, [row[f"{quantity}_full"] for row in own], "s--", color=colour, ms=3)
    ax.set_xticks([4, 10, 40, 100], ["4", "10", "40", "100"])
    ax.minorticks_off()
    ax.set(xlabel="number of grains n")


def _legend(rows: list[dict[str, Any]]) -> list[Line2D]:
    scenes = [
        Line2D([], [], color=colour, label=scene)
        for scene, colour in zip(_scenes(rows), LINE_COLOURS, strict=False)
    ]
    small = Line2D([], [], color=BLACK, marker="o", ms=3, label="smallest model")
    full = Line2D([], [], color=BLACK, marker="s", ms=3, ls="--", label="full model")
    return [*scenes, small, full]


def _scenes(rows: list[dict[str, Any]]) -> list[str]:
    return list(dict.fromkeys(row["scene"] for row in rows))
