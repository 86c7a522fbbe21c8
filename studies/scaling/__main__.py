"""Run the study: `python -m studies.scaling --out DIR [--grains 1000,10000,100000]`."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Annotated, Any

import typer

from studies.output import provenance, result_folder, write_summary, write_table
from studies.scaling.figure import scaling_figure
from studies.scaling.measure import FLOORS, floor_seconds, in_a_process, triad_bandwidth
from studies.scaling.methods import METHODS
from studies.scaling.page import machine, performance_page
from studies.style import save_figure

UNITS = "seconds, MB = 2^20 bytes, bytes per grain"


def run(
    sizes: list[int], repeats: int, limits: dict[str, float], tell: Any = None
) -> tuple[list[dict[str, Any]], dict[str, dict[int, float]], float]:
    """Measure every method at every size that it is meant for.

    Parameters
    ----------
    sizes : list of int
        Numbers of grains.
    repeats : int
        Timed calls of each.
    limits : dict of str to float
        Largest size by way, instead of the usual one.
    tell : callable, optional
        Told each row.

    Returns
    -------
    rows : list of dict
        From `measure`.
    floors : dict of str to dict of int to float
        Seconds that moving the data takes.
    bandwidth : float
        Bytes per second.
    """
    bandwidth = triad_bandwidth()
    rows = []
    for size in sizes:
        for (what, how), (_, most) in METHODS.items():
            if size > limits.get(how, most):
                continue
            rows.append(in_a_process(what, how, size, repeats))
            if tell is not None:
                tell(rows[-1])
    each = {row["grains"]: floor_seconds(row["grains"], bandwidth) for row in rows}
    floors = {what: {n: seconds[what] for n, seconds in each.items()} for what in FLOORS}
    return rows, floors, bandwidth


def main(
    out: Annotated[Path, typer.Option(help="Result folder.")],
    grains: Annotated[str, typer.Option(help="Sizes, by commas.")] = "1000,10000,100000,1000000",
    repeats: Annotated[int, typer.Option(help="Timed calls.")] = 3,
    slow_up_to: Annotated[int, typer.Option(help="Largest size for shapely.")] = 100_000,
    docs: Annotated[Path | None, typer.Option(help="Write performance.md here too.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace results.")] = False,
) -> None:
    """Measure, and write the table, the figure and, if asked for, the page."""
    sizes = [int(size) for size in grains.split(",")]
    limits: dict[str, float] = {"shapely": slow_up_to}
    with result_folder(out, force=force) as folder:
        rows, floors, bandwidth = run(sizes, repeats, limits, _tell)
        configuration = {"grains": sizes, "repeats": repeats, "slow_up_to": slow_up_to}
        made = provenance("scaling study", {**configuration, "machine": machine()}, UNITS)
        columns = {name: [row[name] for row in rows] for name in rows[0]}
        write_table(folder, "scaling", columns, made, csv=True)
        summary = {"rows": rows, "floors": floors, "bandwidth": bandwidth, "provenance": made}
        write_summary(folder, summary)
        save_figure(scaling_figure(rows, floors), folder, "scaling", made)
        if docs is not None:
            (docs / "figures").mkdir(parents=True, exist_ok=True)
            shutil.copyfile(folder / "scaling.png", docs / "figures" / "scaling.png")
            (docs / "performance.md").write_text(performance_page(rows, floors, bandwidth, repeats))


def _tell(row: dict[str, Any]) -> None:
    typer.echo(
        f"{row['what']:<10} {row['how']:<9} {row['grains']:>9} grains {row['seconds']:9.4f} s "
        f"({row['cpu_seconds']:.4f} CPU) {row['bytes_per_grain']:7.0f} bytes per grain"
    )


if __name__ == "__main__":
    typer.run(main)
