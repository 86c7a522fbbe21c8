"""Run the study: `python -m tests.tools.scaling --out DIR [--page docs]`."""

from __future__ import annotations

import os
import shutil
from datetime import date
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import cyclopts
import pandas as pd
from cyclopts import Parameter

from studies.study import study
from tests.benchmarks.methods import machine
from tests.tools.scaling.measure import (
    FLOORS,
    command_row,
    floor_seconds,
    in_a_process,
    triad_bandwidth,
)
from tests.tools.scaling.methods import COMMANDS, METHODS
from tests.tools.scaling.page import markdown, scaling_figure, update

PACKAGES = ("numpy", "scipy", "numba", "pyarrow", "networkx", "shapely")
ABOUT = "Measured on {}, triad on one thread {:.1f} GB/s; {}."
UNITS = "seconds, MB = 2^20 bytes, bytes per grain"


def main(
    out: Annotated[Path, Parameter(help="Result folder.")],
    grains: Annotated[str, Parameter(help="Sizes, by commas.")] = "1000,10000,100000,1000000",
    repeats: Annotated[int, Parameter(help="Timed calls, after a first one.")] = 2,
    slow_up_to: Annotated[int, Parameter(help="Largest size for shapely.")] = 100_000,
    page: Annotated[Path | None, Parameter(help="Folder of the pages to update.")] = None,
    force: Annotated[bool, Parameter(negative=(), help="Replace results.")] = False,
) -> None:
    """Measure; write the table and the figure, and with --page those of docs/performance.md."""
    # As the command line has it.
    os.environ.setdefault("NUMPY_MADVISE_HUGEPAGE", "0")
    sizes = [int(size) for size in grains.split(",")]
    on = machine(*PACKAGES)
    asked = {"grains": sizes, "repeats": repeats, "slow_up_to": slow_up_to, "machine": on}
    with study("scaling study", out, asked, UNITS, force=force, csv=True) as results:
        bandwidth, rows = triad_bandwidth(), []
        for size, ((what, how), (_, most)) in product(sizes, METHODS.items()):
            if size <= (slow_up_to if how == "shapely" else most):
                rows.append(in_a_process(what, how, size, repeats))
                tell(rows[-1])
        for how in COMMANDS:
            rows.append(command_row(how, repeats))
            tell(rows[-1])
        least = {n: floor_seconds(n, bandwidth) for n in {row["grains"] for row in rows} - {0}}
        rows = [{**row, "floor": least.get(row["grains"], {}).get(row["what"])} for row in rows]
        results.write_tables({"scaling": pd.DataFrame(rows)})
        results.write_summary({"rows": rows, "bandwidth": bandwidth})
        floors = {what: {n: seconds[what] for n, seconds in least.items()} for what in FLOORS}
        results.save_figures([("scaling", scaling_figure(rows, floors))])
        (results.folder / "rows.md").write_text("\n".join(markdown(rows)) + "\n")
        if page is not None:
            packages = ", ".join(f"{name} {version}" for name, version in on.items())
            update(page, ABOUT.format(date.today(), 1e-9 * bandwidth, packages), rows)
            shutil.copy(results.folder / "scaling.png", page / "figures")


def tell(row: dict[str, Any]) -> None:
    """Show a row as soon as it is there."""
    print(
        f"{row['what']:<10} {row['how']:<22} {row['grains']:>9} grains {row['seconds']:9.4f} s "
        f"({row['cpu_seconds']:.4f} CPU)"
    )


if __name__ == "__main__":
    cyclopts.run(main)
