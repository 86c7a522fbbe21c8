"""One self-contained page for a run: figures, numbers, configuration, a map to explore."""

from __future__ import annotations

import base64
import json
import mimetypes
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.colors import to_hex
from numpy.typing import NDArray

from loops import Faces
from loops.arrays import Floats, Integers
from patterns import Snapshot
from studies.snapshot.polygons import half_edges_of_loops, loop_corners
from studies.style import DIVERGING, ORDER_COLOURS, SEQUENTIAL

# Of a figure's pixels, of which there are 300 to the inch.
SHOWN = 0.5
# Pixels from which on a figure is scrolled on a phone, where its letters would be too small.
WIDE = 640
# The page asks nothing of any network, and browsers hold it to that.
POLICY = "default-src 'none'; img-src data:; media-src data:; style-src 'unsafe-inline'; "
POLICY += "script-src 'unsafe-inline'"

# Beyond so many loops a page gets too slow to handle.
MOST_LOOPS = 50_000
SHADES = 64
# Columns offered first for the colours.
FIRST = (
    *("order", "packing_lambda_min", "surroundings_lambda_min", "traction_lambda_min"),
    *("traction_free_lambda_min", "affine_lambda_min", "w2", "fate"),
)
# A row of more values is turned into a column.
WIDEST = 9
# Keys that have places of their own.
APART = ("definitions", "notes", "provenance")


def write_report(
    folder: Path,
    title: str,
    summary: Mapping[str, Any],
    figures: Sequence[tuple[str, str, Path]],
    loops: LoopsForMap | Sequence[LoopsForMap] | None,
    provenance: Mapping[str, Any],
    count: int | None = None,
) -> Path:
    """Write `report.html`: one file that needs nothing else, no network either.

    Of several maps the first is shown, the others can be chosen; `count` is the number of loops of
    the largest snapshot, `loops` of the summary if left out.
    """
    maps = [loops] if isinstance(loops, LoopsForMap) else list(loops or ())
    most = max(map(len, maps), default=summary.get("loops", 0) if count is None else count)
    sections = {
        "Map": _map_section(maps, most),
        "Figures": "\n".join(_figure(*figure) for figure in figures),
        "Notes": "".join(f"<p>{escape(str(note))}.</p>" for note in summary.get("notes", ())),
        "Numbers": summary_tables(summary),
        "Definitions": definitions_list(summary.get("definitions", {})),
        "Configuration": plain_table(_plain(provenance)),
    }
    present = {name: text for name, text in sections.items() if text}
    made_by = f"{provenance.get('command', 'grainloops')}, version {provenance.get('version', '-')}"
    page = _template("report.html").format(
        policy=POLICY,
        title=escape(title),
        style=_template("report.css"),
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


def _template(name: str) -> str:
    return (Path(__file__).parent / name).read_text(encoding="utf-8")


def _map_section(maps: Sequence[LoopsForMap], count: int) -> str:
    if count > MOST_LOOPS:
        return (
            f"<p>{count} loops are more than the {MOST_LOOPS} that a page can handle: the figures "
            "show them, and the table beside this page holds every one.</p>"
        )
    if not maps or count == 0:
        return ""
    return _template("report_map.html").format(
        unit=escape(maps[0].unit),
        about=escape(maps[0].about),
        hidden=" hidden" if len(maps) == 1 else "",
        unlinked="" if any(len(one.links) for one in maps) else " hidden",
        snapshots="".join(
            f'<option value="{k}" data-number="{one.number}"{" selected" if one.first else ""}>'
            f"{escape(one.name)}</option>"
            for k, one in enumerate(maps)
        ),
        data="\n".join(
            f'<script type="application/json" id="map-data-{k}">{packed(one)}</script>'
            for k, one in enumerate(maps)
        ),
        script=_template("report.js"),
    )


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
    wide = round(SHOWN * int.from_bytes(content[16:20], "big"))
    return f' width="{wide}"' + (' class="wide"' if wide > WIDE else "")


def _plain(provenance: Mapping[str, Any]) -> dict[str, Any]:
    """Provenance with its configuration's entries in the same column."""
    values = {key: value for key, value in provenance.items() if key != "configuration"}
    for key, value in provenance.get("configuration", {}).items():
        if isinstance(value, Mapping):
            value = ", ".join(f"{name}={column}" for name, column in value.items())
        values[f"configuration: {key}"] = value
    return values


@dataclass(frozen=True, eq=False)
class LoopsForMap:
    """Polygons and rows of the loops of one packing.

    Of a series also the `name` and number of the snapshot, whether it is shown `first`, and what
    there is to say `about` the maps. `links (L, 2, 2)` are the ends of those of force chains.
    """

    offsets: Integers
    corners: Floats
    grains: Integers
    columns: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    unit: str = "length unit of the input"
    name: str = ""
    number: int = 0
    first: bool = False
    about: str = ""
    links: Floats = field(default_factory=lambda: np.zeros((0, 2, 2)))

    def __len__(self) -> int:
        return len(self.offsets) - 1


def loops_for_map(
    snapshot: Snapshot, faces: Faces, table: Mapping[str, Any], **series: Any
) -> LoopsForMap | None:
    """Polygons and rows of the loops of a snapshot; None for more than a page can handle."""
    if len(faces.loops) > MOST_LOOPS:
        return None
    offsets, at = half_edges_of_loops(faces)
    return LoopsForMap(
        offsets,
        loop_corners(snapshot.graph, faces, offsets, at),
        snapshot.ids[faces.grains[at]],
        {name: np.asarray(values) for name, values in table.items() if name != "grains"},
        **series,
    )


def packed(loops: LoopsForMap) -> str:
    """The loops as JSON whose arrays are little-endian bytes in base64.

    Corners are single precision, relative to `origin`; so are columns of floats, which are shown
    with six digits. Integers have four bytes, ids eight-byte floats if four are too few.
    """
    origin = loops.corners.mean(axis=0) if len(loops.corners) else np.zeros(2)
    ahead = [name for name in FIRST if name in loops.columns]
    content = {
        "count": len(loops),
        "origin": origin.tolist(),
        "unit": loops.unit,
        "name": loops.name,
        "snapshot": loops.number,
        "offsets": encoded(loops.offsets),
        "corners": encoded((loops.corners - origin).ravel()),
        "grains": encoded(loops.grains),
        "links": encoded((loops.links - origin).ravel()),
        "columns": {name: encoded(values) for name, values in loops.columns.items()},
        "colour_by": [*ahead, *(n for n in loops.columns if n not in (*ahead, "loop"))],
        "palettes": {
            "order": ORDER_COLOURS,
            "sequential": _shades(SEQUENTIAL),
            "diverging": _shades(DIVERGING),
        },
    }
    return json.dumps(content, separators=(",", ":")).replace("<", "\\u003c")


def encoded(values: NDArray[Any]) -> dict[str, Any]:
    """Type and bytes of an array; of words the places in their list, which stands beside."""
    if values.dtype.kind in "UO":
        words, values = np.unique(values.astype(str), return_inverse=True)
        return encoded(values) | {"words": words.tolist()}
    if np.issubdtype(values.dtype, np.floating):
        kind = "f4"
    else:
        wide = len(values) and np.abs(values).max() >= 2**31
        kind = "f8" if wide else "i4"
    data = values.astype(f"<{kind}").tobytes()
    return {"type": kind, "data": base64.b64encode(data).decode("ascii")}


def _shades(name: str) -> list[str]:
    return [to_hex(colour) for colour in mpl.colormaps[name](np.linspace(0, 1, SHADES))]


def summary_tables(summary: Mapping[str, Any]) -> str:
    """Every key of a summary: plain values in one table, the others in one each."""
    told = summary.get("definitions", {})
    shown = {key: summary[key] for key in sorted(summary) if key not in APART}
    plain = {key: value for key, value in shown.items() if not isinstance(value, Mapping)}
    parts = [plain_table(plain, told)]
    for key, value in shown.items():
        if isinstance(value, Mapping) and value:
            about = f'<p class="about">{escape(told[key])}.</p>' if key in told else ""
            parts.append(f"<h3>{escape(key)}</h3>{about}{mapping_table(value)}")
    return "\n".join(parts)


def mapping_table(values: Mapping[str, Any]) -> str:
    """A table of nested mappings: a row for each innermost one, its path in front."""
    rows = list(_innermost(values, ()))
    if not rows:
        return "<p>–</p>"
    if len(rows) == 1 and not rows[0][0] and len(rows[0][1]) > WIDEST:
        return plain_table(rows[0][1])
    columns = list(dict.fromkeys(name for _, row in rows for name in row))
    depth = max(len(path) for path, _ in rows)
    return _table(depth, rows, columns)


def definitions_list(told: Mapping[str, str]) -> str:
    """Definitions of the keys, as a table."""
    lines = "".join(
        f'<tr><td>{escape(key)}</td><td class="text">{escape(told[key])}</td></tr>'
        for key in sorted(told)
    )
    return f'<div class="scroll"><table><tbody>{lines}</tbody></table></div>'


def value_text(value: Any) -> str:
    """A value with six digits; a dash for what is not known."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(value_text, value)) + "]"
    if value is None or (isinstance(value, (float, np.floating)) and not np.isfinite(value)):
        return "–"
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if isinstance(value, (float, np.floating)):
        return f"{value:.6g}"
    return str(value)


def plain_table(values: Mapping[str, Any], told: Mapping[str, str] | None = None) -> str:
    """A table with one row a key, and what it means."""
    said = told or {}
    lines = "".join(
        f"<tr><td>{escape(key)}</td><td>{escape(value_text(value))}</td>"
        f'<td class="text">{escape(said.get(key, ""))}</td></tr>'
        for key, value in values.items()
    )
    return f'<div class="scroll"><table><tbody>{lines}</tbody></table></div>'


def _innermost(
    values: Mapping[str, Any], path: tuple[str, ...]
) -> Iterator[tuple[tuple[str, ...], Mapping[str, Any]]]:
    """Mappings without mappings in them, with the keys that lead there."""
    plain = {key: value for key, value in values.items() if not isinstance(value, Mapping)}
    if plain:
        yield path, plain
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from _innermost(value, (*path, str(key)))


def _table(
    depth: int,
    rows: list[tuple[tuple[str, ...], Mapping[str, Any]]],
    columns: list[str],
) -> str:
    head = "".join(f"<th>{escape(str(name))}</th>" for name in [*([""] * depth), *columns])
    lines = []
    for path, row in rows:
        front = [*path, *([""] * (depth - len(path)))]
        cells = [escape(name) for name in front]
        cells += [escape(value_text(row[name])) if name in row else "" for name in columns]
        lines.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    return (
        f'<div class="scroll"><table><thead><tr>{head}</tr></thead>'
        f"<tbody>{''.join(lines)}</tbody></table></div>"
    )
