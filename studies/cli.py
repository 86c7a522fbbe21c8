"""The command line: `grainloops`."""

from __future__ import annotations

import io
import os
import sys
import warnings
from collections.abc import Iterator
from itertools import islice
from typing import Annotated, Any

import typer

from loops.errors import InputError
from studies.commands import common
from studies.commands.bench import bench
from studies.commands.check import check
from studies.commands.clock import clock
from studies.commands.common import forget_output, print_error
from studies.commands.diamond import diamond
from studies.commands.domain import domain
from studies.commands.evolve import evolve
from studies.commands.polygon import polygon
from studies.commands.probe import probe
from studies.commands.series import series
from studies.commands.snapshot import snapshot

app = typer.Typer(
    invoke_without_command=True,
    add_completion=True,
    # Plain help: rich takes longer to load than all that is shown here.
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    help="Stability of grain loops in two-dimensional granular media. Angles in degrees; "
    "forces, stresses and strains positive in compression.",
)
WIDTH = "--figure-width="
INTERRUPTED = 130
# Whoever shows its progress itself, or none.
SHOWN_OTHERWISE = {"series", "bench", "--quiet", "--help", "--version"}


@app.callback()
def grainloops(
    context: typer.Context,
    show_version: Annotated[bool, typer.Option("--version", help="Show the version.")] = False,
    quiet: Annotated[
        bool, typer.Option("--quiet", help="Print errors alone, and --json; anywhere in the line.")
    ] = False,
    figure_width: Annotated[
        str | None,
        typer.Option(
            metavar="single|double",
            help="Figures of one or two columns of a journal, 86 or 178 mm; anywhere in the line.",
        ),
    ] = None,
) -> None:
    """Show the version, or the help when no command is given."""
    common.quiet = quiet
    if figure_width is not None:
        from studies.style import figure_width as ask_for

        ask_for(figure_width)
    if quiet:
        os.environ["TTY_COMPATIBLE"] = "0"  # no progress bars of rich
    if show_version:
        from studies.version import __version__

        typer.echo(f"grainloops {__version__}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


for command in (check, snapshot, series, probe, evolve, diamond, polygon, domain, bench):
    app.command()(command)


# click's UsageError, wherever typer keeps it.
UsageError: Any = typer.BadParameter.__base__


def main() -> None:
    """Run the command; bad input gives one line on stderr and exit status 2."""
    # Arrays here live briefly: clearing huge pages for them takes longer than what they save.
    os.environ.setdefault("NUMPY_MADVISE_HUGEPAGE", "0")
    if not sys.warnoptions:
        # Warnings are for who writes code; what a user should know stands in the notes.
        warnings.simplefilter("ignore")
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        # Common options may stand anywhere.
        arguments = _common_first(sys.argv[1:])
        if not SHOWN_OTHERWISE & {*arguments}:
            clock.start("grainloops")
        status = app(list(_with_rates(arguments)), standalone_mode=False)
    except InputError as error:
        _fail(str(error))
    except UsageError as error:
        _fail(f"{error.format_message().rstrip('.')}. Try 'grainloops --help'.")
    except (typer.Abort, KeyboardInterrupt):
        status = INTERRUPTED
    except MemoryError as error:
        said = str(error)
        said = said if said.startswith("out of memory") else f"out of memory. {said}"
        _fail(said.rstrip(". "), status=1)
    except OSError as error:
        forget_output()
        _fail(str(error), status=1)
    if status == INTERRUPTED:  # typer may have turned Ctrl-C into this already
        _fail(f"interrupted; {common.interrupted}.", status=INTERRUPTED)
    sys.exit(status if isinstance(status, int) else 0)


def _with_rates(arguments: list[str]) -> Iterator[str]:
    """`series --in-packing` alone means its rates: the next word may be a file."""
    for word, follows in zip(arguments, [*arguments[1:], ""], strict=False):
        alone = word == "--in-packing" and follows not in ("rates", "events")
        yield "--in-packing=rates" if alone and "series" in arguments else word


def _common_first(arguments: list[str]) -> list[str]:
    common: list[str] = []
    own: list[str] = []
    rest = iter(arguments)
    for one in rest:
        if one == "--figure-width":
            common += [one, *islice(rest, 1)]
        else:
            to = common if one in ("--quiet", "--version") or one.startswith(WIDTH) else own
            to.append(one)
    return common + own


def _fail(message: str, status: int = 2) -> None:
    clock.stop()
    print_error(message)
    sys.exit(status)


if __name__ == "__main__":
    main()
