"""What the commands share: their common options, lists of numbers, the report."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from loops.errors import InputError

Out = Annotated[Path, typer.Option(help="Result folder; created.", show_default=False)]
Force = Annotated[bool, typer.Option("--force", help="Replace results of the same names.")]
Csv = Annotated[bool, typer.Option("--csv", help="Write the tables as CSV too.")]
Json = Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")]


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


def shown(value: float | None) -> str:
    """A number with three digits, a dash for none."""
    return "-" if value is None else f"{value:.3f}"


def report(
    summary: dict[str, Any], out: Path, json: bool, lines: Callable[[dict[str, Any]], list[str]]
) -> None:
    """Print the summary, as JSON or as the lines made of it and the place of the results."""
    if json:
        from studies.output import as_json

        typer.echo(as_json(summary))
        return
    for line in [*lines(summary), f"results in {out}"]:
        typer.echo(line)
