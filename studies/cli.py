"""The command line: `grainloops`."""

from __future__ import annotations

import sys
from typing import Any

import typer

from loops.errors import InputError
from studies.commands import bench, diamond, domain, polygon, series, snapshot

app = typer.Typer(
    invoke_without_command=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Stability of grain loops in two-dimensional granular media. Angles in degrees; "
    "forces, stresses and strains positive in compression.",
)


@app.callback()
def grainloops(context: typer.Context) -> None:
    """Show the help when no command is given."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


for command in (snapshot, series, diamond, polygon, domain, bench):
    command.register(app)


# click's UsageError, wherever typer keeps it.
UsageError: Any = typer.BadParameter.__base__


def main() -> None:
    """Run the command; bad input gives one line on stderr and exit status 2."""
    try:
        status = app(standalone_mode=False)
    except InputError as error:
        _fail(str(error))
    except UsageError as error:
        _fail(f"{error.format_message().rstrip('.')}. Try 'grainloops --help'.")
    except (typer.Abort, KeyboardInterrupt):
        typer.echo("grainloops: interrupted; nothing was written.", err=True)
        sys.exit(130)
    sys.exit(status if isinstance(status, int) else 0)


def _fail(message: str) -> None:
    typer.echo(f"grainloops: {' '.join(message.split())}", err=True)
    sys.exit(2)


if __name__ == "__main__":
    main()
