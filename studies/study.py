"""The frame of every study: one folder with its tables, summary and figures, and its page."""

from __future__ import annotations

import base64
import json
import mimetypes
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from loops.arrays import Floats, Integers
from loops.errors import Counting, check_choice
from loops.lazy import named
from studies.output import (
    Summary,
    folder_within,
    provenance,
    result_folder,
    words,
    write_summary,
    write_table,
)

# Figures of a study by name: each a figure, or a function that makes it or its axes.
Drawings = Iterable[tuple[str, Any]]
FigureFormat = Literal["png", "svg", "pdf"]


class Figures(NamedTuple):
    """Which figures a study draws: their names, all of them if there are none, and the format."""

    names: tuple[str, ...] = ()
    format: FigureFormat = "png"


ALL_FIGURES = Figures()


class Picture(NamedTuple):
    """A picture or video of a page: name, MIME type, bytes."""

    name: str
    kind: str
    content: bytes


@dataclass(frozen=True)
class Results:
    """Files of one study in `folder`; each keeps the provenance `source`."""

    folder: Path
    source: dict[str, Any]
    csv: bool = False
    figures: Figures | None = ALL_FIGURES

    @property
    def command(self) -> str:
        """Name of the command."""
        return str(self.source["command"].split()[1])

    def write_tables(self, tables: Mapping[str, Any]) -> None:
        """Write tables by name as Parquet (and CSV if `csv`): data frames, or arrays by column."""
        for name, table in tables.items():
            write_table(self.folder, name, table, self.source, csv=self.csv)

    def write_summary(self, summary: Mapping[str, Any]) -> Summary:
        """Write `summary.json`; return the summary with its provenance and what its keys mean."""
        told = words("definitions").get(self.command)
        own = {} if told is None else {"definitions": told}
        whole = own | {**summary, "provenance": self.source}
        write_summary(self.folder, whole)
        return whole

    def write_results(
        self,
        tables: Mapping[str, Any],
        summary: Mapping[str, Any],
        drawings: Drawings = (),
        title: str = "",
    ) -> Summary:
        """Write tables by name and the summary, which is returned with its provenance.

        With drawings their figures too, and a report with that title and without a map.
        """
        self.write_tables(tables)
        whole = self.write_summary(summary)
        if drawings and self.figures is not None:
            self.write_report(title, whole, drawings, [], largest=0)
        return whole

    def save_figures(self, drawings: Drawings) -> list[Picture]:
        """Make and save the figures that are wanted; return them for a page, a PDF as PNG.

        A generator of functions keeps one figure in memory at a time.
        """
        if self.figures is None:
            return []
        # matplotlib is loaded only if something is drawn.
        from studies.style import drawn_file

        (names, kind), files = self.figures, dict[str, list[Future[bytes]]]()
        kinds = dict.fromkeys([kind, "png" if kind == "pdf" else kind])
        # Packing releases the interpreter, so that the next figure is drawn meanwhile.
        with ThreadPoolExecutor(1) as packer:
            for name, draw in drawings:
                if names and name not in names:
                    continue
                drawn = draw() if callable(draw) else draw
                figure: Any = getattr(drawn, "figure", drawn)
                files[name] = [
                    packer.submit(drawn_file(figure, name, self.source, one)) for one in kinds
                ]
        for name, packed in files.items():
            (self.folder / f"{name}.{kind}").write_bytes(packed[0].result())
        shown = PAGE_KINDS[kind]
        return [Picture(name, shown, packed[-1].result()) for name, packed in files.items()]

    def write_report(
        self,
        title: str,
        summary: Summary,
        drawings: Drawings,
        maps: Sequence[LoopsForMap],
        largest: int | None = None,
        animation: Sequence[Path] = (),
    ) -> None:
        """Save the figures, and write `report.html` with their captions and the maps of loops.

        `largest` is the number of loops of the largest snapshot, by default `summary["loops"]`.
        """
        told = words("captions")[self.command]
        pictures = self.save_figures(drawings)
        missing = {*(self.figures.names if self.figures else ())} - {one.name for one in pictures}
        if missing:
            summary.setdefault("notes", []).append(
                f"nothing to draw in figures {', '.join(sorted(missing))}"
            )
            self.write_summary(summary)
        pictures += [
            Picture(file.stem, mimetypes.guess_type(file.name)[0] or "", file.read_bytes())
            for file in animation
        ]
        said = ((*told[one.name], one) for one in pictures)
        figures = [(name, Counting().format(text, **summary), one) for name, text, one in said]
        write_report(self.folder, title, summary, figures, maps, self.source, largest)

    def write_packing(
        self,
        title: str,
        snapshot: Any,
        found: Any,
        tables: Mapping[str, Any],
        told: Mapping[str, Any],
    ) -> Summary:
        """Write what was `found` of a packing, its report with the map of `tables["loops"]` too."""
        summary = self.write_results(tables, {"mean_kn": snapshot.mean_kn, **told})
        if self.figures is not None:
            draw = named(f"studies.packing_figures.{self.command}_figures")
            drawings = draw(snapshot, found, tables, summary)
            maps = named("studies.snapshot.table.loops_for_map")(snapshot, tables["loops"])
            self.write_report(title, summary, drawings, maps)
        return summary


@dataclass(frozen=True, eq=False)
class LoopsForMap:
    """Polygons and table of the loops of one snapshot, for the map on a page.

    `links (L, 2, 2)` are the ends of the links of chains.
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


def files_of(how: dict[str, Any]) -> dict[str, Any]:
    """Take the options of a study's files out of others: `force`, `csv`, `figures`."""
    return {name: how.pop(name) for name in ("force", "csv", "figures") if name in how}


@contextmanager
def study(
    command: str,
    out: Path,
    configuration: Mapping[str, Any],
    units: str | None = None,
    *,
    force: bool = False,
    csv: bool = False,
    figures: Figures | bool = True,
    continued: bool = False,
) -> Iterator[Results]:
    """Open the results of a study; they appear in `out` when the block has ended without error.

    Units left out are those of the command in `definitions.toml`. A study that is `continued` keeps
    what else is in the folder.
    """
    wanted = (ALL_FIGURES if figures else None) if isinstance(figures, bool) else figures
    for name in wanted.names if wanted else ():
        check_choice("--figures", name, ("none", *words("captions")[command.split()[0]]))
    place = folder_within(out) if continued else result_folder(out, force=force)
    with place as folder:
        yield Results(folder, provenance(command, configuration, units), csv, wanted)


# MIME types on a page of figures by the format of their files.
PAGE_KINDS = {"png": "image/png", "svg": "image/svg+xml", "pdf": "image/png"}
# Pixels on the page for one pixel of a figure, which has 300 to the inch.
SCALE = 0.5
# A figure wider than this (pixels) scrolls on a phone, where its letters would be too small.
WIDE = 640
# The page asks nothing of any network, and browsers hold it to that.
POLICY = "default-src 'none'; img-src data:; media-src data:; style-src 'unsafe-inline'; "
POLICY += "script-src 'unsafe-inline'"
# A row of more values is turned into a column.
WIDEST = 9
# A page with more loops reacts too slowly.
MOST_LOOPS = 50_000
SHADES = 64
# Columns that the page offers first for the colours.
OFFERED_FIRST = (
    *("order", "packing_lambda_min", "surroundings_lambda_min", "traction_lambda_min"),
    *("traction_free_lambda_min", "affine_lambda_min", "w2", "fate"),
)
# Text of more letters may be broken into lines.
LONG = 32
NOTHING: Mapping[str, str] = {}
# Keys of a summary with a section of their own.
OWN_SECTIONS = ("definitions", "notes", "provenance")


def write_report(
    folder: Path,
    title: str,
    summary: Mapping[str, Any],
    figures: Sequence[tuple[str, str, Picture]],
    maps: Sequence[LoopsForMap],
    provenance: Mapping[str, Any],
    largest: int | None = None,
) -> Path:
    """Write `report.html`, which loads nothing else; figures are title, caption, picture."""
    if maps:
        largest = max(map(len, maps))
    elif largest is None:
        largest = summary.get("loops", 0)
    configuration = {key: value for key, value in provenance.items() if key != "configuration"}
    for key, value in provenance.get("configuration", {}).items():
        if isinstance(value, Mapping):
            value = ", ".join(f"{name}={column}" for name, column in value.items())
        configuration[f"configuration: {key}"] = value
    told = summary.get("definitions", {})
    sections = {
        "Map": map_section(maps, largest),
        "Figures": "\n".join(figure_html(*figure) for figure in figures),
        "Notes": "".join(f"<p>{escape(str(note))}.</p>" for note in summary.get("notes", ())),
        "Numbers": summary_tables(summary),
        "Definitions": text_table((key, "", text) for key, text in sorted(told.items())),
        "Configuration": plain_table(configuration),
    }
    present = {name: text for name, text in sections.items() if text}
    made_by = f"{provenance.get('command', 'grainloops')}, version {provenance.get('version', '-')}"
    page = template("report.html").format(
        policy=POLICY,
        title=escape(title),
        style=template("report.css"),
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


def template(name: str) -> str:
    """Text of a file beside this one."""
    return (Path(__file__).parent / name).read_text(encoding="utf-8")


def map_section(maps: Sequence[LoopsForMap], largest: int) -> str:
    """Interactive map of the loops, or a sentence that says why there is none."""
    if largest > MOST_LOOPS:
        return (
            f"<p>{largest} loops are more than the {MOST_LOOPS} that a page can handle: the "
            "figures show them, and the table beside this page holds every one.</p>"
        )
    if not maps or largest == 0:
        return ""
    return template("report_map.html").format(
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
        script=template("report.js"),
    )


def figure_html(title: str, caption: str, shown: Picture) -> str:
    """Figure or video with its caption; letters of all PNG figures have one size."""
    _, kind, content = shown
    data = f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"
    width = ""
    if kind == "image/png":
        wide = round(SCALE * int.from_bytes(content[16:20], "big"))
        width = f' width="{wide}"' + (' class="wide"' if wide > WIDE else "")
    if kind.startswith("video/"):
        picture = f'<video controls src="{data}"></video>'
    else:
        picture = f'<img src="{data}" alt="{escape(f"{title}. {caption}")}"{width}>'
    said = f"<b>{escape(title)}.</b> {escape(caption)}"
    return f"<figure>{picture}<figcaption>{said}</figcaption></figure>"


def summary_tables(summary: Mapping[str, Any]) -> str:
    """Every key of a summary: plain values in one table, each nested value in its own."""
    told = summary.get("definitions", {})
    shown = {key: summary[key] for key in sorted(summary) if key not in OWN_SECTIONS}
    plain = {key: value for key, value in shown.items() if not isinstance(value, Mapping)}
    parts = [plain_table(plain, told)]
    for key, value in shown.items():
        if isinstance(value, Mapping) and value:
            about = f'<p class="about">{escape(told[key])}.</p>' if key in told else ""
            parts.append(f"<h3>{escape(key)}</h3>{about}{mapping_table(value)}")
    return "\n".join(parts)


def mapping_table(values: Mapping[str, Any]) -> str:
    """Table of nested mappings: a row for each innermost mapping, the keys to it in front."""
    rows = list(innermost(values, ()))
    if not rows:
        return "<p>–</p>"
    if len(rows) == 1 and not rows[0][0] and len(rows[0][1]) > WIDEST:
        return plain_table(rows[0][1])
    columns = list(dict.fromkeys(name for _, row in rows for name in row))
    depth = max(len(path) for path, _ in rows)
    titles = [escape(str(name)).replace("_", "_<wbr>") for name in [*([""] * depth), *columns]]
    lines = [[f"<th>{title}</th>" for title in titles]]
    for path, row in rows:
        names = [f"<td>{escape(name)}</td>" for name in (*path, *([""] * (depth - len(path))))]
        lines.append(names + [value_cell(row[name]) if name in row else "<td></td>"
                              for name in columns])  # fmt: skip
    # Wider than high: the columns become rows.
    if len(columns) > max(WIDEST, len(rows)):
        lines = [list(line) for line in zip(*lines, strict=True)]
    head, *body = ("<tr>" + "".join(line) + "</tr>" for line in lines)
    return (
        f'<div class="scroll"><table><thead>{head}</thead>'
        f"<tbody>{''.join(body)}</tbody></table></div>"
    )


def innermost(
    values: Mapping[str, Any], path: tuple[str, ...]
) -> Iterator[tuple[tuple[str, ...], Mapping[str, Any]]]:
    """Mappings that contain no mapping, each with the keys that lead to it."""
    plain = {key: value for key, value in values.items() if not isinstance(value, Mapping)}
    if plain:
        yield path, plain
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from innermost(value, (*path, str(key)))


def plain_table(values: Mapping[str, Any], told: Mapping[str, str] = NOTHING) -> str:
    """A table with one row per key: its value and its definition."""
    return text_table((key, value_cell(value), told.get(key, "")) for key, value in values.items())


def text_table(rows: Iterable[tuple[str, str, str]]) -> str:
    """A table with one row per key: cells as they are, and text."""
    lines = "".join(
        f'<tr><td>{escape(key)}</td>{cells}<td class="text">{escape(text)}</td></tr>'
        for key, cells, text in rows
    )
    return f'<div class="scroll"><table class="plain"><tbody>{lines}</tbody></table></div>'


def value_cell(value: Any) -> str:
    """A value in a cell: a matrix as rows of numbers; long text may be broken."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, (list, tuple)) and any(isinstance(row, (list, tuple)) for row in value):
        rows = (row if isinstance(row, (list, tuple)) else [row] for row in value)
        lines = ("".join(value_cell(number) for number in row) for row in rows)
        inside = "".join(f"<tr>{line}</tr>" for line in lines)
        return f'<td><table class="matrix"><tbody>{inside}</tbody></table></td>'
    text = value_text(value)
    broken = ' class="long"' if len(text) > LONG else ""
    return f"<td{broken}>{escape(text)}</td>"


def value_text(value: Any) -> str:
    """A value with six digits; a dash for an unknown one."""
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


def packed(loops: LoopsForMap) -> str:
    """JSON of the loops for the page; arrays are little-endian bytes in base64.

    Corners are in single precision, relative to `origin`; so are columns of floats.
    """
    import matplotlib as mpl
    from matplotlib.colors import to_hex

    from studies.style import DIVERGING, ORDER_COLOURS, SEQUENTIAL

    origin = loops.corners.mean(axis=0) if len(loops.corners) else np.zeros(2)
    ahead = [name for name in OFFERED_FIRST if name in loops.columns]
    shades = np.linspace(0, 1, SHADES)
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
            "sequential": [to_hex(colour) for colour in mpl.colormaps[SEQUENTIAL](shades)],
            "diverging": [to_hex(colour) for colour in mpl.colormaps[DIVERGING](shades)],
        },
    }
    return json.dumps(content, separators=(",", ":")).replace("<", "\\u003c")


def encoded(values: NDArray[Any]) -> dict[str, Any]:
    """Type and bytes of an array; words are encoded as places in a list of `words`."""
    if values.dtype.kind in "UO":
        words, values = np.unique(values.astype(str), return_inverse=True)
        return encoded(values) | {"words": words.tolist()}
    if np.issubdtype(values.dtype, np.floating):
        kind = "f4"
    else:
        widest = max(int(values.max()), -int(values.min())) if len(values) else 0
        kind = "i4" if widest < 2**31 else "f8" if widest < 2**53 else "i8"
    data = values.astype(f"<{kind}").tobytes()
    return {"type": kind, "data": base64.b64encode(data).decode("ascii")}
