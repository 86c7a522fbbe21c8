"""Run the study: `python -m studies.scaling --out DIR [--grains 1000,10000,100000]`."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import typer

from studies.bench.measure import machine
from studies.output import provenance, result_folder, write_summary, write_table
from studies.scaling.figure import scaling_figure
from studies.scaling.measure import FLOORS, floor_seconds, in_a_process, triad_bandwidth
from studies.scaling.methods import METHODS
from studies.style import save_figure

PACKAGES = ("numpy", "scipy", "numba", "pyarrow", "networkx", "shapely")
NAMES = {
    "faces": "faces",
    "crossings": "search for crossings",
    "table": "table of all loops",
    "snapshot": "whole snapshot, no figures",
}
UNITS = "seconds, MB = 2^20 bytes, bytes per grain"


def main(
    out: Annotated[Path, typer.Option(help="Result folder.")],
    grains: Annotated[str, typer.Option(help="Sizes, by commas.")] = "1000,10000,100000,1000000",
    repeats: Annotated[int, typer.Option(help="Timed calls.")] = 3,
    slow_up_to: Annotated[int, typer.Option(help="Largest size for shapely.")] = 100_000,
    force: Annotated[bool, typer.Option("--force", help="Replace results.")] = False,
) -> None:
    """Measure; write the table, the figure and the rows for docs/performance.md."""
    sizes = [int(size) for size in grains.split(",")]
    with result_folder(out, force=force) as folder:
        bandwidth, rows = triad_bandwidth(), []
        for size, ((what, how), (_, most)) in product(sizes, METHODS.items()):
            if size > (slow_up_to if how == "shapely" else most):
                continue
            rows.append(in_a_process(what, how, size, repeats))
            seconds, cpu, each = (
                rows[-1][k] for k in ("seconds", "cpu_seconds", "bytes_per_grain")
            )
            typer.echo(
                f"{what:<10} {how:<9} {rows[-1]['grains']:>9} grains {seconds:9.4f} s "
                f"({cpu:.4f} CPU) {each:7.0f} bytes per grain"
            )
        least = {row["grains"]: floor_seconds(row["grains"], bandwidth) for row in rows}
        floors = {what: {n: seconds[what] for n, seconds in least.items()} for what in FLOORS}
        configuration = {"grains": sizes, "repeats": repeats, "slow_up_to": slow_up_to}
        made = provenance("scaling study", {**configuration, "machine": machine(*PACKAGES)}, UNITS)
        columns = {name: [row[name] for row in rows] for name in rows[0]}
        write_table(folder, "scaling", columns, made, csv=True)
        summary = {"rows": rows, "floors": floors, "bandwidth": bandwidth, "provenance": made}
        write_summary(folder, summary)
        save_figure(scaling_figure(rows, floors), folder, "scaling", made)
        (folder / "rows.md").write_text("\n".join(_markdown(rows, floors)) + "\n")


def _markdown(rows: list[dict[str, Any]], floors: dict[str, dict[int, float]]) -> Iterator[str]:
    """One row of the page's table for each measurement."""
    for row in sorted(rows, key=lambda row: (list(NAMES).index(row["what"]), row["grains"])):
        floor = floors.get(row["what"], {}).get(row["grains"])
        yield (
            f"| {NAMES[row['what']]} | {row['grains']:,} | {row['how']} | {row['seconds']:.3g} "
            f"| {row['cpu_seconds']:.3g} | {row['bytes_per_grain']:.0f} "
            f"| {'-' if floor is None else f'{floor:.2g}'} |"
        )


if __name__ == "__main__":
    typer.run(main)
