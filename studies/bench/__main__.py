"""Write the page on accuracy and its figures: `python -m studies.bench --out docs`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from studies.bench.figures import all_figures
from studies.bench.groups import chosen_groups
from studies.bench.page import page
from studies.bench.run import UNITS, collect, machine
from studies.output import provenance
from studies.style import styled

DPI = 110


def write_page(out: Path, quick: bool = False) -> None:
    """Write `accuracy.md` and its figures under `figures`.

    Parameters
    ----------
    out : Path
        Folder; files of the same names are replaced.
    quick : bool
        Smaller sizes.
    """
    folder = out / "figures"
    folder.mkdir(parents=True, exist_ok=True)
    results = collect(chosen_groups(None), quick, lambda name: typer.echo(name, err=True))
    made = provenance("bench", machine() | ({"quick": True} if quick else {}), UNITS)
    drawn = all_figures(results)
    for name, figure in drawn.items():
        with styled():
            file = folder / f"accuracy-{name}.png"
            figure.savefig(file, dpi=DPI, metadata={"Title": name})
    written = page(results, made, tuple(drawn), prefix="figures/accuracy-")
    (out / "accuracy.md").write_text(written)


def main(
    out: Annotated[Path, typer.Option(help="Folder of the documentation.")],
    quick: Annotated[bool, typer.Option("--quick", help="Smaller sizes.")] = False,
) -> None:
    """Measure speed against error, run the hard cases, write the page."""
    write_page(out, quick)
    typer.echo(f"wrote {out / 'accuracy.md'}")


if __name__ == "__main__":
    typer.run(main)
