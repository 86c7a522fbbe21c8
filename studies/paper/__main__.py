"""Write the page and its figures: `python -m studies.paper --out docs`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from studies.diamond.figures import all_figures
from studies.diamond.parameters import DiamondParameters
from studies.diamond.path import follow
from studies.paper.numbers import collect
from studies.paper.page import figure_file, page
from studies.paper.text import FIGURES
from studies.style import styled

DPI = 150


def write_page(out: Path) -> None:
    """Write `paper.md` and its figures under `figures`.

    Parameters
    ----------
    out : Path
        Folder; files of the same names are replaced.
    """
    folder = out / "figures"
    folder.mkdir(parents=True, exist_ok=True)
    (out / "paper.md").write_text(page(collect()))
    for table in (1, 2):
        plain = all_figures(follow(DiamondParameters(table=table)))
        added = all_figures(follow(DiamondParameters(table=table, contact_on_touch="add")))
        figures = plain | {"added_contact": added["added_contact"]}
        for _, wanted, name, _ in FIGURES:
            if wanted == table:
                with styled():
                    figures[name].savefig(
                        folder / figure_file(table, name), dpi=DPI, metadata={"Title": name}
                    )


def main(out: Annotated[Path, typer.Option(help="Folder of the documentation.")]) -> None:
    """Reproduce the paper and write the page that says how well."""
    write_page(out)
    typer.echo(f"wrote {out / 'paper.md'}")


if __name__ == "__main__":
    typer.run(main)
