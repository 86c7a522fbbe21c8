"""The page docs/performance.md: its stored measurement, its table and its figure."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from textwrap import fill
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies.output import as_json
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

STORED, PAGE = "figures/scaling.json", "performance.md"
BEGIN, END = "<!-- measured: python -m tests.tools.scaling --page docs -->\n", "<!-- end -->\n"
NAMES = {
    "faces": "faces",
    "crossings": "search for crossings",
    "read": "reading, with all checks",
    "table": "table of all loops",
    "summary": "summary",
    "write": "writing the table",
    "snapshot": "whole snapshot, no figures",
    "command": "the same by the command line, start and all",
    "start": "command line",
}
HEAD = "|  | grains | way | time (s) | CPU (s) | bytes per grain | floor (s) |\n"
PEERS = ("shapely", "networkx", "numpy")
COLOURS = {
    "compiled": BLUE,
    "numpy": VERMILION,
    "networkx": PURPLE,
    "shapely": ORANGE,
    "by size": BLACK,
}
TITLES = {"faces": "faces", "table": "table of all loops, both closures"}
Rows = list[dict[str, Any]]


def stored(docs: Path) -> dict[str, Any]:
    """The measurement of the page: `about` the machine, and `rows`."""
    found: dict[str, Any] = json.loads((docs / STORED).read_text())
    return found


def update(docs: Path, about: str, rows: list[dict[str, Any]]) -> None:
    """Store a measurement in place of the last one and write it into the page."""
    (docs / STORED).write_text(as_json({"about": about, "rows": rows}) + "\n")
    text = (docs / PAGE).read_text()
    start, end = text.index(BEGIN) + len(BEGIN), text.index(END)
    (docs / PAGE).write_text(text[:start] + measured_part(docs) + text[end:])


def measured_part(docs: Path) -> str:
    """The part of the page that is written from the stored measurement."""
    found = stored(docs)
    rows = found["rows"]
    table = HEAD + "|---" * 7 + "|\n" + "".join(f"{line}\n" for line in markdown(rows))
    return f"{fill(found['about'], 100)}\n\n{table}\n{_peers(rows)}\n"


def markdown(rows: list[dict[str, Any]]) -> Iterator[str]:
    """One row of the page's table for each measurement."""
    for row in sorted(rows, key=lambda row: (list(NAMES).index(row["what"]), row["grains"])):
        yield (
            f"| {NAMES[row['what']]} | {_shown(row['grains'] or None, ',')} | {row['how']} "
            f"| {row['seconds']:.3g} | {row['cpu_seconds']:.3g} "
            f"| {_shown(row['bytes_per_grain'], '.0f')} | {_shown(row['floor'], '.2g')} |"
        )


def _shown(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def _peers(rows: list[dict[str, Any]]) -> str:
    """A sentence: the compiled faces against the other ways, at the largest size of each."""
    faces = {(row["how"], row["grains"]): row["seconds"] for row in rows if row["what"] == "faces"}
    said = []
    for how in PEERS:
        grains = max(n for other, n in faces if other == how)
        ratio = faces[how, grains] / faces["compiled", grains]
        said.append(f"{ratio:.3g} times faster than {how} at {grains:,} grains")
    return f"The compiled faces are {', '.join(said)}, in the same run."


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
        if how in COLOURS:
            _line(ax, rows, (what, how), "seconds", how)


def _line(
    ax: Axes, rows: Rows, method: tuple[str, str], key: str, label: str, colour: str | None = None
) -> None:
    own = sorted((row["grains"], row[key]) for row in rows if (row["what"], row["how"]) == method)
    x, y = [point[0] for point in own], [point[1] for point in own]
    ax.loglog(x, y, "o-", color=colour or COLOURS[method[1]], label=label)
