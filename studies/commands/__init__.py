"""The commands of `grainloops`: their shared options, the printed answer.

Its lines are the templates of `lines.toml`, filled with the values of a summary.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any, get_args

from cyclopts import Parameter

from loops.errors import Counting, InputError, check_choice
from loops.lazy import named
from studies.clock import clock
from studies.questions import EVERYDAY, FURTHER, Cells, Whole

# Listed here, since the readers themselves are loaded only by the commands that read.
FORMAT_NAMES = ("table", "yade-xml", "lammps", "liggghts", "mercury", "pegs")
# File endings that are removed where a result folder is named after its input.
NAME_ENDINGS = {
    *(".gz", ".bz2", ".xz", ".zst", ".csv", ".tsv", ".dat", ".txt", ".parquet", ".npz", ".h5"),
    *(".hdf5", ".xml"),
}
# Module of a command's study, where it is not that of the name.
PLACES = {"series": "studies.series.run"}
# How a note on a check of the file that is not as wanted begins.
DOUBT = ("doubt: ", "error: ")
# Conditions of a part of a line: a value holds, is unknown, does not hold throughout.
CONDITIONS = {
    "?": bool,
    "!": lambda value: value is None,
    "~": lambda value: not (all(value) if isinstance(value, list) else value),
}
CONDITION = re.compile(r"([?!~])([\w\[\] ]+):")
# Counts by name, what stands between them, and words behind each count.
COUNTS_AS = {"counts": ("{1}{2} {0}", ", "), "counted": ("{0}: {1}{2}", ", "),
             "spaced": ("{0}: {1}{2}", "  "), "met": ("{0} on {1}{2}", ", ")}  # fmt: skip
COUNTS = re.compile("|".join(COUNTS_AS))
# A zero with a minus: a number that is rounded to zero from below.
MINUS_ZERO = re.compile(r"(?<![\w.)-])-(?=0(?:\.0+)?(?:e[+-]\d+)?(?!\.?\w))")
# Digits and width of a number that may be unknown: '3' or '3>7'.
DIGITS = re.compile(r"(\d)([<>]\d+)?")

Out = Annotated[Path | None, Parameter(help="Result folder. Default: named after the input.")]
Force = Annotated[bool, Parameter(help="Replace the earlier results in the folder.")]
Csv = Annotated[bool, Parameter(group=FURTHER, help="Write each table as CSV too.")]
Json = Annotated[bool, Parameter(group=FURTHER, help="Print the summary as JSON.")]
Contacts = Annotated[
    Path | None,
    Parameter(group=FURTHER, help="File of the contacts. Default: the one beside PATH."),
]


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Writing:
    """Options of the results.

    Parameters
    ----------
    figures
        Figures to draw; none: no report either. Default: all.
    no_figures
        The same as --figures none.
    figure_format
        png, svg or pdf.
    """

    out: Out = None
    force: Force = False
    csv: Csv = False
    json: Json = False
    figures: Annotated[str | None, Parameter(group=FURTHER, metavar="NAME,...|none")] = None
    no_figures: Annotated[bool, Parameter(group=FURTHER)] = False
    figure_format: Annotated[str, Parameter(group=FURTHER, metavar="NAME")] = "png"

    def files(self) -> dict[str, Any]:
        """The options that a study takes."""
        from studies.study import FigureFormat, Figures

        if self.no_figures and self.figures is not None:
            raise InputError("--figures, --no-figures", "both", "one of them", "Leave one out.")
        check_choice("--figure-format", self.figure_format, get_args(FigureFormat))
        none = self.no_figures or self.figures == "none"
        names = () if self.figures is None else tuple(self.figures.split(","))
        figures = False if none else Figures(names, self.figure_format)  # type: ignore[arg-type]
        return {"force": self.force, "csv": self.csv, "figures": figures}


@Parameter(name="*", group=FURTHER)
@dataclass(frozen=True, kw_only=True)
class Sharing:
    """Workers of a study, by the names of its options.

    Parameters
    ----------
    workers
        Number of processes. Default: one per core.
    scheduler
        Address of a Dask scheduler that shares the work.
    """

    workers: Whole | None = None
    scheduler: Annotated[str | None, Parameter(metavar="tcp://HOST:PORT")] = None


@Parameter(name="*", group=FURTHER)
@dataclass(frozen=True, kw_only=True)
class Reading:
    """Options of reading that every command with an input takes.

    Parameters
    ----------
    cell
        Periodic cell; its columns are the cell vectors.
    kn
        Normal stiffness, if the input has none.
    kt
        Shear stiffness, if the input has none.
    mu
        Coefficient of friction, if the input has none.
    shear_increment
        Lever arm in the shear increment: branch length, or sum of the radii (Yade).
    law
        Contact law: linear, hertz, cohesive (attraction while grains touch), bonded (until a bond
        breaks). Default: the input's.
    young
        Young's modulus, for --law hertz.
    poisson
        Poisson's ratio, for --law hertz.
    shear_history
        Shear quantity that --law hertz keeps as N changes: T (default) or T/kt.
    adhesion
        Largest tensile force of a contact, for --law cohesive or bonded.
    cohesion
        Shear strength at N = 0, for --law cohesive or bonded. Default: mu times --adhesion.
    periodic
        Along which cell vectors the sample is periodic.
    columns
        Columns by name or number: radius=size, id=0.
    strict
        Refuse files with a doubt (exit status 2).
    """

    cell: Annotated[
        str | None, Parameter(group=EVERYDAY, metavar="HXX,HXY,HYX,HYY", allow_leading_hyphen=True)
    ] = None
    periodic: Annotated[str | None, Parameter(metavar="x|y|xy")] = None
    kn: float | None = None
    kt: float | None = None
    mu: float | None = None
    shear_increment: Annotated[str | None, Parameter(metavar="branch|radii")] = None
    law: Annotated[str | None, Parameter(metavar="NAME")] = None
    young: float | None = None
    poisson: float | None = None
    shear_history: Annotated[str | None, Parameter(metavar="force|displacement")] = None
    adhesion: float | None = None
    cohesion: float | None = None
    format: Annotated[
        str, Parameter(help=f"Format of the input: auto, {', '.join(FORMAT_NAMES)}.")
    ] = "auto"
    columns: Annotated[str | None, Parameter(metavar="NAME=COLUMN,...")] = None
    strict: bool = False

    def how(self) -> dict[str, Any]:
        """The options as `read_planar` names them, cell and columns as numbers and names."""
        given = {one.name: getattr(self, one.name) for one in fields(self)}
        return given | {"cell": cell_of(self.cell), "columns": columns_of(self.columns)}

    def given(self) -> list[str]:
        """Names of the options that are not left out."""
        return [one.name for one in fields(self) if getattr(self, one.name) != one.default]

    def how_of(self, path: Path) -> dict[str, Any]:
        """The options for this file."""
        return self.how()


@Parameter(name="*", group=FURTHER)
@dataclass(frozen=True, kw_only=True)
class PlaneReading(Reading):
    """Reading where loops are looked for.

    Parameters
    ----------
    drop_crossings
        Leave out one of two contacts that cross.
    """

    drop_crossings: bool = False


@Parameter(name="*", group=FURTHER)
@dataclass(frozen=True, kw_only=True)
class OneReading(PlaneReading):
    """Reading of one snapshot.

    Parameters
    ----------
    frame
        Number of the snapshot in a file with several: 0 the first, -1 the last.
    """

    contacts: Contacts = None
    frame: Whole | None = None
    cells: Cells = None

    def how_of(self, path: Path) -> dict[str, Any]:
        """The options for this file: its cell from the table of `--cells`, if that is given."""
        from patterns.snapshots.cells import cell_reader

        given = self.how()
        cell = cell_reader(given.pop("cells"), given["cell"])(path, self.frame)
        return given | {"cell": cell}


@dataclass(frozen=True)
class Answer:
    """Printed answer of a command: JSON or lines of text, errors, and the exit status."""

    lines: list[str]
    json: str | None = None
    errors: tuple[str, ...] = ()
    status: int = 0
    out: Path | None = None


def answer(
    summary_json: bool, out: Path, lines: Sequence[str], notes: Sequence[str] = (), most: int = 1000
) -> Answer:
    """Answer of a study whose results are in `out`: its summary as JSON, or these lines.

    Doubts about the file come first, `most` other notes last.
    """
    if summary_json:
        return Answer([], (out / "summary.json").read_text().rstrip(), out=out)
    page = out / "report.html"
    where = f"results in {out}" + (f"; open {page} first" if page.is_file() else "")
    doubts = [note for note in notes if note.startswith(DOUBT)]
    others = [f"note: {note}" for note in notes if note not in doubts]
    more = [f"{len(others) - most} more notes are in summary.json"] if len(others) > most else []
    return Answer([*doubts, *lines, *others[:most], *more, where], out=out)


def answered(
    command: str,
    paths: Path | Sequence[Path],
    lines: Callable[[dict[str, Any]], Sequence[str]],
    writing: Writing,
    reading: Reading,
    *groups: Any,
    progress: Callable[[Any], Any] | None = None,
    unanswered: Callable[[dict[str, Any]], bool] | None = None,
    kept: str = "",
    clocked: bool = True,
    most: int = 1000,
    **options: Any,
) -> Answer:
    """Run the study of a packing, and answer: `run_NAME` of `studies.NAME`, from the first path.

    `groups` are dataclasses of options; `kept` is what an interruption leaves. Exit status 1 if
    `unanswered`.
    """
    first = paths if isinstance(paths, Path) else paths[0]
    out = out_or(writing.out, command, first)
    for group in groups:
        options |= asdict(group)
    with clock(f"grainloops {command}", line=clocked) as tell:
        if progress is not None:
            options["progress"] = progress(tell)
        run = named(f"{PLACES.get(command, f'studies.{command}')}.run_{command}")
        try:
            summary = run(paths, out, **options, **writing.files(), **reading.how_of(first))
        except KeyboardInterrupt:
            raise KeyboardInterrupt(kept) from None
    said = answer(writing.json, out, lines(summary), summary["notes"], most)
    return replace(said, status=int(unanswered is not None and unanswered(summary)))


def out_or(out: Path | None, command: str, path: Path | None = None) -> Path:
    """The folder asked for, or one named after input and command in the current folder.

    >>> out_or(None, "snapshot", Path("run/grains_05.csv.gz")).name
    'grains_05-snapshot'
    """
    if out is not None or path is None:
        return out or Path(command)
    while path.suffix.lower() in NAME_ENDINGS:
        path = path.with_suffix("")
    return Path(f"{path.name}-{command}")


def flags(names: Sequence[str], by: str = ", ") -> str:
    """Names of options as the command line has them."""
    short = (name.removesuffix("_deg").removeprefix("contact_") for name in names)
    return by.join(f"--{name.replace('_', '-')}" for name in short)


def numbers(name: str, text: str | None) -> tuple[float, ...] | None:
    """Numbers of an option, separated by commas; `InputError` for anything else."""
    if text is None:
        return None
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise InputError(
            name, repr(text), "numbers separated by commas", "Write 35,45 for example."
        ) from None


def cell_of(text: str | None) -> tuple[float, float, float, float] | None:
    """Cell of an option; `InputError` for anything but four numbers."""
    if text is None:
        return None
    try:
        xx, xy, yx, yy = (float(part) for part in text.split(","))
    except ValueError:
        remedy = "Separate them by commas; a table of cells goes to --cells."
        raise InputError("--cell", repr(text), "four numbers HXX,HXY,HYX,HYY", remedy) from None
    return xx, xy, yx, yy


def columns_of(text: str | None) -> dict[str, str] | None:
    """Column map of an option; `InputError` for anything but NAME=COLUMN by commas."""
    if text is None:
        return None
    pairs = [part.split("=", 1) for part in text.split(",")]
    names = [pair[0].strip() for pair in pairs]
    if not all(len(pair) == 2 and all(part.strip() for part in pair) for pair in pairs):
        received, remedy = repr(text), "Write x=COLUMN,y=COLUMN."
    elif len(set(names)) < len(names):
        received, remedy = f"{text!r}, a name twice", "Give each name one column."
    else:
        return {name.strip(): column.strip() for name, column in pairs}
    raise InputError("--columns", received, "NAME=COLUMN separated by commas", remedy)


# ---- printed lines


def _words(part: str) -> dict[str, Any]:
    """Part of `lines.toml`, which is read only where something is printed."""
    found: dict[str, Any] = named("studies.output.words")("lines")[part]
    return found


class Filling(Counting):
    """Format strings over a summary, with formats of their own (see `lines.toml`)."""

    def get_field(self, field_name: str, args: Any, kwargs: Any) -> Any:
        """Value of a name such as `replay[end]`; None where there is none."""
        try:
            return super().get_field(field_name, args, kwargs)
        except (KeyError, TypeError):
            return None, field_name

    def value(self, name: str, row: Mapping[str, Any]) -> Any:
        """Value of a name in a row."""
        return self.get_field(name, (), row)[0]

    def format_field(self, value: Any, spec: str) -> str:
        """A value in one of the formats of printed lines, else in Python's."""
        kind, _, table = spec.partition("/")
        known = _words("words").get(table, {})
        if kind == "word":
            return str(known.get(value, value))
        if counting := COUNTS.match(kind):
            template, between = COUNTS_AS[counting[0]]
            counts = ((known.get(name, name), count) for name, count in value.items())
            words = (template.format(*count, kind[counting.end() :]) for count in counts)
            return between.join(words) or "none"
        if kind == "values":
            numbers = {n: "-" if number is None else f"{number:.6g}" for n, number in value.items()}
            return "  ".join(f"{name} = {number}" for name, number in numbers.items())
        if kind == "spread":
            return f" (spread {100 * value:.3g} %)"
        if kind == "axes":
            return str(value[1:])
        if kind.startswith("%"):
            return format(100 * value, kind[1:])
        if isinstance(value, tuple):
            return ", ".join(format(one, spec) for one in value)
        if digits := DIGITS.fullmatch(kind):
            number = "-" if value is None else f"{value:.{digits[1]}f}"
            return format(number, digits[2] or "")
        return str(super().format_field(value, spec))

    def filled(self, template: str, row: Mapping[str, Any]) -> str | None:
        """Text of a template; None where its first part is left out."""
        parts = [self._part(part, row) for part in template.split("|")]
        return None if parts[0] is None else MINUS_ZERO.sub("", "".join(p or "" for p in parts))

    def _part(self, part: str, row: Mapping[str, Any]) -> str | None:
        """Text of a part of a line; None where its condition fails or a value is unknown."""
        if condition := CONDITION.match(part):
            sign, name = condition.groups()
            if not CONDITIONS[sign](self.value(name, row)):
                return None
            part = part[condition.end() :]
        for _, name, spec, _ in self.parse(part):
            if name and self.value(name, row) is None and not DIGITS.fullmatch(spec or ""):
                return None
        return self.vformat(part, (), row)


def shown(value: float | None) -> str:
    """A number with three digits, a dash for none."""
    return Filling().format_field(value, "3")


def printed(command: str, summary: Mapping[str, Any], **more: Any) -> list[str]:
    """Printed lines of a command: its templates over the keys of the summary, and `more` values.

    A template in a pair with the name of a mapping, or of a list, has a line for each of its items.
    """
    whole, lines = {**summary, **more}, list[str]()
    for line in _words("lines")[command]:
        each, template = ("", line) if isinstance(line, str) else line
        rows = _rows(whole, each) if each else [whole]
        told = (Filling().filled(template, row) for row in rows)
        lines += [text for text in told if text is not None]
    return lines


def driven_line(summary: Mapping[str, Any]) -> str:
    """Line that names the driven axis and that of the major stress at the start."""
    axial = not summary["programme"].startswith("isotropic")
    major = summary["axis"] == summary["major_axis"]
    kinds = {"axial": axial, "along": axial and major, "across": axial and not major}
    return printed("driven", summary, **kinds)[0]


def _rows(whole: Mapping[str, Any], each: str) -> list[dict[str, Any]]:
    """Values of each item: its own, its `name` in a mapping, and those of the whole."""
    items = whole.get(each) or ()
    if isinstance(items, Mapping):
        items = [_item(value) | {"name": name} for name, value in items.items()]
    return [{**whole, **_item(value)} for value in items]


def _item(value: Any) -> dict[str, Any]:
    """Keys of an item; one that has none is the `value`."""
    return dict(value) if isinstance(value, Mapping) else {"value": value}
