"""Search loops for flutter: `python -m studies.flutter --out DIR`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from loops import InputError
from studies.flutter.run import FlutterSearch, run_flutter


def main(
    out: Annotated[Path, typer.Option(help="Result folder.")],
    orders: Annotated[str, typer.Option(help="First and last order, as 3-8.")] = "3-8",
    loops: Annotated[int, typer.Option(help="Loops in each family.")] = 4000,
    map_order: Annotated[int, typer.Option(help="Order of the maps.")] = 6,
    map_loops: Annotated[int, typer.Option(help="Loops of the maps.")] = 150,
    kappa: Annotated[tuple[float, float], typer.Option(help="Range of kt/kn.")] = (0.05, 1.0),
    seed: Annotated[int, typer.Option(help="Seed.")] = 1,
    force: Annotated[bool, typer.Option("--force", help="Replace results.")] = False,
) -> None:
    """Search loops of several orders for complex eigenvalues; write tables and figures."""
    try:
        given = FlutterSearch(_orders(orders), loops, map_order, map_loops, seed, kappa)
        summary = run_flutter(given, out, force=force)
    except InputError as error:
        typer.echo(f"flutter: {' '.join(str(error).split())}", err=True)
        raise typer.Exit(2) from None
    for operator, groups in summary["families"].items():
        for family, row in groups.items():
            typer.echo(
                f"{operator:<19} {family:<29} {row['flutter']:>6} of {row['known']:>6}, "
                f"{row['flutter_stable']:>5} with W2 > 0, ratio to {row['largest_ratio']:.3f}"
            )
    typer.echo(f"results in {out}")


def _orders(text: str) -> tuple[int, ...]:
    first, dash, last = text.partition("-")
    if not (dash and first.isdecimal() and last.isdecimal() and 3 <= int(first) <= int(last)):
        raise InputError("--orders", repr(text), "two orders from 3 on, as 3-8", "Correct it.")
    return tuple(range(int(first), int(last) + 1))


if __name__ == "__main__":
    typer.run(main)
