"""`python -m tests.docs.columns_page > docs/columns.md` writes the page anew."""

from __future__ import annotations

from studies.output import definitions, words

# Keys of the summary of a command, by their parts.
KEYS = {
    "snapshot": ("snapshot", "snapshot_forces", "snapshot_in_packing", "snapshot_input_error"),
    **{
        name: (name,)
        for name in (
            *("series", "probe", "sustain", "evolve", "forecast"),
            *("diamond", "polygon", "material"),
        )
    },
}


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
        "`table:name` or `command:name` applies only to that table or command. Units are those of "
        "the input; `kn`, `l0` say what a number was divided by.",
        "Other tables (`bench`, `check`, the examples) explain themselves on their pages.",
    ]
    for title, columns in words("columns").items():
        rows = [(f"`{name}`", unit, said) for name, (unit, said) in columns.items()]
        lines += _table(title, ("column", "unit", "meaning"), rows)
    for command, parts in KEYS.items():
        rows = [(f"`{key}`", said) for key, said in definitions(*parts).items()]
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
