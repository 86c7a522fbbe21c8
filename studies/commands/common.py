"""What the commands share: their common options, lists of numbers, the report."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import wraps
from importlib import import_module
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any

import typer

from loops.errors import InputError
from studies.commands.clock import clock

# The readers themselves are loaded only by the commands that read.
FORMATS = ("table", "yade-vtk", "yade-xml", "yade-text", "lammps", "liggghts", "mercury")
Out = Annotated[
    Path | None,
    typer.Option(help="Result folder; created. By default named after the input, here."),
]
Force = Annotated[bool, typer.Option("--force", help="Replace results of the same names.")]
Csv = Annotated[bool, typer.Option("--csv", help="Write the tables as CSV too.")]
Json = Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")]
NoFigures = Annotated[
    bool, typer.Option("--no-figures", help="Tables and summary alone, no figures, no report.")
]
YieldBand = Annotated[
    float, typer.Option(help="Contacts from this share of their strength on may slide.")
]
Workers = Annotated[
    int | None, typer.Option(help="Processes on this machine; by default one a core.")
]
Scheduler = Annotated[
    str | None,
    typer.Option(metavar="tcp://HOST:PORT", help="Dask scheduler whose workers do the work."),
]
# What commands ask of a snapshot to be read, as `read_planar` names it.
READING: dict[str, Any] = {
    "contacts": Annotated[
        Path | None, typer.Option(help="File of contacts; found beside PATH by its name.")
    ],
    "cell": Annotated[
        str | None,
        typer.Option(metavar="HXX,HXY,HYX,HYY", help="Periodic cell; columns are its vectors."),
    ],
    "kn": Annotated[float | None, typer.Option(help="Normal stiffness the input lacks.")],
    "kt": Annotated[float | None, typer.Option(help="Shear stiffness the input lacks.")],
    "mu": Annotated[float | None, typer.Option(help="Friction (tan) the input lacks.")],
    "shear_increment": Annotated[
        str | None,
        typer.Option(
            metavar="branch|radii",
            help="What the code turns shear by; else what the source tells: radii for Yade.",
        ),
    ],
    "format": Annotated[str, typer.Option(help=f"auto, by the content; or {', '.join(FORMATS)}.")],
    "columns": Annotated[
        str | None, typer.Option(metavar="NAME=COLUMN,...", help="Columns by their plain names.")
    ],
    "frame": Annotated[
        int | None,
        typer.Option(help="Which snapshot of a file with several: 0 the first, -1 the last."),
    ],
    "drop_crossings": Annotated[
        bool, typer.Option("--drop-crossings", help="Leave out contacts whose branches cross.")
    ],
}
DEFAULTS: dict[str, Any] = {
    **{"format": "auto", "drop_crossings": False},
    **{"force": False, "csv": False, "json": False},
}
# What commands ask of their results; where they go comes behind the input.
WRITING: dict[str, Any] = {"force": Force, "csv": Csv, "json": Json}
# What no name of a result folder keeps of its input's.
ENDINGS = {".gz", ".csv", ".parquet", ".npz", ".h5", ".hdf5", ".xml", ".txt", ".vtu", ".vtp"}
# No error is longer than a screen: the middle of what was received is left out.
LONGEST = 1000
M_ARENA_MAX = -8  # of malloc.h
# Whether summaries are left out: `grainloops --quiet`.
quiet = False
# What an interruption leaves.
interrupted = "nothing was written"


def out_or(out: Path | None, command: str, path: Path | None = None) -> Path:
    """The folder asked for, or one named after input and command in the current folder.

    >>> out_or(None, "snapshot", Path("run/grains_05.csv.gz")).name
    'grains_05-snapshot'
    """
    if out is not None or path is None:
        return out or Path(command)
    while path.suffix.lower() in ENDINGS:
        path = path.with_suffix("")
    return Path(f"{path.name}-{command}")


def reads(*left_out: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command that takes them as `**how` the options of reading, but those left out."""

    def with_reading(command: Callable[..., None]) -> Callable[..., None]:
        @wraps(command)
        def run(**given: Any) -> None:
            command(**_read(given))

        *own, _ = signature(command, eval_str=True).parameters.values()
        _declare(run, own, {name: READING[name] for name in READING if name not in left_out})
        return run

    return with_reading


def runs(
    study: str, lines: Callable[[dict[str, Any]], list[str]], *left_out: str
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Hand the options that a command declares to a study, given as `package.function`.

    The first is the input, which the results are named after. The options of reading but those
    left out, and those of the results, come besides. What the command itself does is done first.
    """

    def with_study(command: Callable[..., None]) -> Callable[..., None]:
        first, *own = signature(command, eval_str=True).parameters.values()

        @wraps(command)
        def run(out: Path | None, json: bool, **given: Any) -> None:
            command(**{one.name: given[one.name] for one in (first, *own)})
            path = given.pop(first.name)
            if "no_figures" in given:
                given["figures"] = not given.pop("no_figures")
            named = path[0] if isinstance(path, list) else path
            out = out_or(out, command.__name__, named)
            package, _, function = study.rpartition(".")
            summary = getattr(import_module(package), function)(path, out, **_read(given))
            report(summary, out, json, lines)

        more = {name: kind for name, kind in READING.items() if name not in left_out}
        place = Parameter("out", Parameter.KEYWORD_ONLY, default=None, annotation=Out)
        _declare(run, [first, place, *own], WRITING | more)
        return run

    return with_study


def _declare(run: Callable[..., None], own: list[Parameter], more: dict[str, Any]) -> None:
    """Options of a command: its own, and those it shares but has none of its own for."""
    known = {one.name for one in own}
    shared = [
        Parameter(name, Parameter.KEYWORD_ONLY, default=DEFAULTS.get(name), annotation=kind)
        for name, kind in more.items()
        if name not in known
    ]
    every = [one.replace(kind=Parameter.KEYWORD_ONLY) for one in (*own, *shared)]
    run.__signature__ = Signature(every)  # type: ignore[attr-defined]


def _read(given: dict[str, Any]) -> dict[str, Any]:
    """The options with cell and columns as what they mean."""
    meant = {"cell": cell_of(given["cell"]), "columns": columns_of(given["columns"])}
    return given | meant


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
        raise InputError(
            "--cell", repr(text), "four numbers HXX,HXY,HYX,HYY", "Separate them by commas."
        ) from None
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


def shown(value: float | None) -> str:
    """A number with three digits, a dash for none."""
    return "-" if value is None else f"{value:.3f}"


def report(
    summary: dict[str, Any], out: Path, json: bool, lines: Callable[[dict[str, Any]], list[str]]
) -> None:
    """Print the summary, as JSON or as the lines made of it and the place of the results.

    The results are in their place by then: who stops reading changes nothing.
    """
    clock.stop()
    if json:
        text = (out / "summary.json").read_text().rstrip()
    elif quiet:
        return
    else:
        page = out / "report.html"
        where = f"results in {out}" + (f"; open {page} first" if page.is_file() else "")
        text = "\n".join([*lines(summary), where])
    try:
        typer.echo(text)
    except OSError as error:
        forget_output()
        if not isinstance(error, BrokenPipeError):
            typer.echo(f"grainloops: {error.strerror}; the results are in {out}", err=True)
            raise typer.Exit(1) from None


def print_error(message: str) -> None:
    """Print an error on one line of stderr."""
    line = " ".join(message.split())
    if len(line) > LONGEST:
        line = f"{line[: LONGEST // 2]} ... {line[-LONGEST // 2 :]}"
    typer.echo(f"grainloops: {line}", err=True)


def forget_output() -> None:
    """What could not be printed is not tried again when the process ends."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def share_memory() -> None:
    """Let threads take memory from one place (glibc); each would keep what it freed."""
    import ctypes

    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).mallopt(M_ARENA_MAX, 1)
