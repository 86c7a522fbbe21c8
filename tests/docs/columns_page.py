"""`python -m tests.docs.columns_page > docs/columns.md` writes the page anew."""

from __future__ import annotations

from collections.abc import Mapping

from studies.columns import COLUMNS
from studies.evolve.run import DEFINITIONS as EVOLVE
from studies.paths.diamond_summary import DEFINITIONS as DIAMOND
from studies.paths.polygon import DEFINITIONS as POLYGON
from studies.probe.run import DEFINITIONS as PROBE
from studies.series.run import DEFINITIONS as SERIES
from studies.snapshot.definitions import GEOMETRY, MECHANICS, PACKING


def page() -> str:
    """`docs/columns.md`."""
    lines = [
        "# Columns and keys of the results",
        "",
        "Written by `python -m tests.docs.columns_page` from the table that also gives every "
        "Parquet field its unit and meaning:",
        '`pyarrow.parquet.read_schema("loops.parquet").field("area").metadata`. Forces, stresses '
        "and strains are positive in",
        "compression, angles counter-clockwise. A name is a pattern: `*` stands for any letters, "
        "`[12]` for one of them;",
        "`table:name` or `command:name` holds there alone. Units are those of the input; `kn`, "
        "`l0` say by what a number was divided.",
        "Other tables (`bench`, `check`, the examples) explain themselves on their pages.",
    ]
    for title, columns in COLUMNS.items():
        rows = [(f"`{name}`", unit, said) for name, (unit, said) in columns.items()]
        lines += _table(title, ("column", "unit", "meaning"), rows)
    parts: dict[str, Mapping[str, str]] = {
        "snapshot": GEOMETRY | MECHANICS | PACKING,
        "series": SERIES,
        "probe": PROBE,
        "evolve": EVOLVE,
        "diamond": DIAMOND,
        "polygon": POLYGON,
    }
    for command, keys in parts.items():
        rows = [(f"`{key}`", said) for key, said in keys.items()]
        lines += _table(f"Keys of `summary.json`: {command}", ("key", "meaning"), rows)
    return "\n".join(lines) + "\n"


def _table(
    title: str, head: tuple[str, ...], rows: list[tuple[str, str, str]] | list[tuple[str, str]]
) -> list[str]:
    cells = [[cell.replace("|", "\\|") for cell in row] for row in rows]
    return ["", f"## {title}", "", *(f"| {' | '.join(row)} |" for row in
            (list(head), ["---"] * len(head), *cells))]  # fmt: skip


if __name__ == "__main__":
    print(page(), end="")
