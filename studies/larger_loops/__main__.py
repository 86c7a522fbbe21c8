"""Write the page and its figures: `python -m studies.larger_loops --out docs`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from studies.larger_loops.cost import (
    PATH_ORDERS,
    TANGENT_ORDERS,
    exponent,
    path_seconds,
    tangent_seconds,
)
from studies.larger_loops.figures import all_figures
from studies.larger_loops.numbers import collect
from studies.larger_loops.page import page
from studies.style import styled

DPI = 110


def write_page(out: Path) -> None:
    """Write `larger-loops.md` and its figures under `figures`.

    Parameters
    ----------
    out : Path
        Folder; files of the same names are replaced.
    """
    folder = out / "figures"
    folder.mkdir(parents=True, exist_ok=True)
    numbers = collect()
    cost = {"tangent": tangent_seconds(), "path": path_seconds()[0]}
    slopes = {
        "tangent": exponent(TANGENT_ORDERS, cost["tangent"], 80),
        "path": exponent(PATH_ORDERS, cost["path"], 50),
    }
    (out / "larger-loops.md").write_text(page(numbers, slopes))
    for name, figure in all_figures(numbers, cost).items():
        with styled():
            file = folder / f"larger-{name}.png"
            figure.savefig(file, dpi=DPI, metadata={"Title": name})


def main(out: Annotated[Path, typer.Option(help="Folder of the documentation.")]) -> None:
    """Compute what becomes of the diamond's threshold in larger loops, and write the page."""
    write_page(out)
    typer.echo(f"wrote {out / 'larger-loops.md'}")


if __name__ == "__main__":
    typer.run(main)
