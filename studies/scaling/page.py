"""The measurement that docs/performance.md shows, stored beside its figure."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from textwrap import fill
from typing import Any

from studies.output import as_json

STORED, PAGE = "figures/scaling.json", "performance.md"
BEGIN, END = "<!-- measured: python -m studies.scaling --page docs -->\n", "<!-- end -->\n"
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
HEAD = "|  | grains | way | time (s) | CPU (s) | bytes per grain | floor (s) | to before |\n"
PEERS = ("shapely", "networkx", "numpy")


def stored(docs: Path) -> dict[str, Any]:
    """The measurement of the page: `about` the machine, and `rows`."""
    found: dict[str, Any] = json.loads((docs / STORED).read_text())
    return found


def update(docs: Path, about: str, rows: list[dict[str, Any]]) -> None:
    """Store a measurement and put it on the page; what was before stays what it was."""
    before = {_key(row): row["before"] for row in stored(docs)["rows"]}
    rows = [{**row, "before": before.get(_key(row))} for row in rows]
    (docs / STORED).write_text(as_json({"about": about, "rows": rows}) + "\n")
    text = (docs / PAGE).read_text()
    start, end = text.index(BEGIN) + len(BEGIN), text.index(END)
    (docs / PAGE).write_text(text[:start] + measured_part(docs) + text[end:])


def _key(row: dict[str, Any]) -> tuple[str, int, str]:
    return row["what"], row["grains"], row["how"]


def measured_part(docs: Path) -> str:
    """What of the page follows from the stored measurement."""
    found = stored(docs)
    rows = found["rows"]
    table = HEAD + "|---" * 8 + "|\n" + "".join(f"{line}\n" for line in markdown(rows))
    return f"{fill(found['about'], 100)}\n\n{table}\n{_peers(rows)}\n"


def markdown(rows: list[dict[str, Any]]) -> Iterator[str]:
    """One row of the page's table for each measurement, `to before` the time over that before."""
    for row in sorted(rows, key=lambda row: (list(NAMES).index(row["what"]), row["grains"])):
        before = row.get("before")
        yield (
            f"| {NAMES[row['what']]} | {_shown(row['grains'] or None, ',')} | {row['how']} "
            f"| {row['seconds']:.3g} | {row['cpu_seconds']:.3g} "
            f"| {_shown(row['bytes_per_grain'], '.0f')} | {_shown(row['floor'], '.2g')} "
            f"| {_shown(before and row['seconds'] / before, '.2f')} |"
        )


def _shown(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def _peers(rows: list[dict[str, Any]]) -> str:
    """How many times faster the compiled faces are than others, at the largest size of each."""
    faces = {(row["how"], row["grains"]): row["seconds"] for row in rows if row["what"] == "faces"}
    said = []
    for how in PEERS:
        grains = max(n for other, n in faces if other == how)
        ratio = faces[how, grains] / faces["compiled", grains]
        said.append(f"{ratio:.3g} times faster than {how} at {grains:,} grains")
    return f"The compiled faces are {', '.join(said)}, in the same run."
