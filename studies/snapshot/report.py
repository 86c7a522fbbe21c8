"""One self-contained page for a run: figures, numbers, configuration, a map to explore."""

from __future__ import annotations

import base64
import mimetypes
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from studies.snapshot.report_map import MOST_LOOPS, LoopsForMap, packed
from studies.snapshot.report_tables import definitions_list, plain_table, summary_tables

HERE = Path(__file__).parent
# Of a figure's pixels, of which there are 300 to the inch.
SHOWN = 0.5
# The page asks nothing of any network, and browsers hold it to that.
POLICY = "default-src 'none'; img-src data:; media-src data:; style-src 'unsafe-inline'; "
POLICY += "script-src 'unsafe-inline'"

PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>
{style}</style>
</head>
<body>
<h1>{title}</h1>
<p class="about">{made_by}. {units}. Sign convention: {signs}.</p>
<nav>{links}</nav>
{sections}
</body>
</html>
"""
MAP = """<div class="tools">
<label>colour <select id="map-colour"></select></label>
<span class="scale"><span id="map-low"></span><span class="bar" id="map-bar"></span>
<span id="map-high"></span></span>
<label>loop <input id="map-find" type="number" min="0"></label>
<button id="map-closer" type="button">+</button>
<button id="map-farther" type="button">&minus;</button>
<button id="map-reset" type="button">whole sample</button>
</div>
<div id="map-view"><canvas id="map-canvas"></canvas><div class="row" id="map-row"></div></div>
<p class="about">Point at a loop to see its row; click to keep it. The wheel zooms, dragging moves.
Grey: not known. One value in a hundred lies beyond either end of the colours. Lengths in {unit};
numbers with six digits, in full in the table beside this page.</p>
<script type="application/json" id="map-data">{data}</script>
<script>
{script}</script>"""


def write_report(
    folder: Path,
    title: str,
    summary: Mapping[str, Any],
    figures: Sequence[tuple[str, str, Path]],
    loops: LoopsForMap | None,
    provenance: Mapping[str, Any],
    count: int | None = None,
) -> Path:
    """Write `report.html`: one file that needs nothing else, no network either.

    Parameters
    ----------
    folder : Path
        Where.
    title : str
        Heading of the page.
    summary : mapping
        Plain values, arrays and mappings of them; `definitions` and `notes` get sections of
        their own, `loops` tells how many loops there are.
    figures : sequence of tuple of str, str, Path
        Title, caption and file of each: PNG, GIF, JPEG or MP4.
    loops : LoopsForMap, optional
        Loops of the interactive map, from `loops_for_map`; for more than 50,000 loops a sentence
        stands in its place.
    provenance : mapping
        From `studies.output.provenance`.
    count : int, optional
        Loops of the snapshot on the map, if the summary tells of several.

    Returns
    -------
    Path
        The page.
    """
    sections = {
        "Map": _map_section(loops, summary.get("loops", 0) if count is None else count),
        "Figures": "\n".join(_figure(*figure) for figure in figures),
        "Notes": "".join(f"<p>{escape(str(note))}.</p>" for note in summary.get("notes", ())),
        "Numbers": summary_tables(summary),
        "Definitions": definitions_list(summary.get("definitions", {})),
        "Configuration": plain_table(_plain(provenance)),
    }
    present = {name: text for name, text in sections.items() if text}
    made_by = f"{provenance.get('command', 'grainloops')}, version {provenance.get('version', '-')}"
    page = PAGE.format(
        policy=POLICY,
        title=escape(title),
        style=(HERE / "report.css").read_text(encoding="utf-8"),
        made_by=escape(made_by),
        units=escape(f"Units: {provenance.get('units', 'as the input')}"),
        signs=escape(str(provenance.get("signs", ""))),
        links=" ".join(f'<a href="#{name.lower()}">{name}</a>' for name in present),
        sections="\n".join(
            f'<section id="{name.lower()}">\n<h2>{name}</h2>\n{text}\n</section>'
            for name, text in present.items()
        ),
    )
    path = folder / "report.html"
    path.write_text(page, encoding="utf-8", errors="backslashreplace")
    return path


def _map_section(loops: LoopsForMap | None, count: int) -> str:
    count = count if loops is None else len(loops)
    if count > MOST_LOOPS:
        return (
            f"<p>{count} loops are more than the {MOST_LOOPS} that a page can handle: the figures "
            "show them, and the table beside this page holds every one.</p>"
        )
    if loops is None or count == 0:
        return ""
    script = (HERE / "report.js").read_text(encoding="utf-8")
    return MAP.format(unit=escape(loops.unit), data=packed(loops), script=script)


def _figure(title: str, caption: str, path: Path) -> str:
    kind = mimetypes.guess_type(path.name)[0] or "image/png"
    content = path.read_bytes()
    data = f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"
    said = escape(f"{title}. {caption}")
    shown = (
        f'<video controls src="{data}"></video>'
        if kind.startswith("video/")
        else f'<img src="{data}" alt="{said}"{_width(kind, content)}>'
    )
    told = f"<b>{escape(title)}.</b> {escape(caption)}"
    return f"<figure>{shown}<figcaption>{told}</figcaption></figure>"


def _width(kind: str, content: bytes) -> str:
    """Width of a PNG on the page, so that letters are of one size in all figures."""
    if kind != "image/png":
        return ""
    pixels = int.from_bytes(content[16:20], "big")
    return f' width="{round(SHOWN * pixels)}"'


def _plain(provenance: Mapping[str, Any]) -> dict[str, Any]:
    """Provenance with its configuration's entries in the same column."""
    values = {key: value for key, value in provenance.items() if key != "configuration"}
    for key, value in provenance.get("configuration", {}).items():
        if isinstance(value, Mapping):
            value = ", ".join(f"{name}={column}" for name, column in value.items())
        values[f"configuration: {key}"] = value
    return values
