"""Short studies: one question, one figure and the numbers behind it.

Run one with `python -m studies.examples.NAME RESULT_FOLDER`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from patterns import Snapshot, planar, read_snapshot
from studies.output import as_json
from studies.study import study

# Samples of the collection of tests.
YADE_SAMPLES = "yade-small", "yade-medium", "yade-periodic", "yade-slow"


def read(path: Path) -> Snapshot:
    """Return a snapshot, its cell from the table `macro.csv` beside it where it has one."""
    macro = path.parent / "macro.csv"
    periodic = macro.is_file() and "h_xx" in macro.read_text().split("\n", 1)[0]
    return planar(read_snapshot(path, cells=macro if periodic else None))


def save(
    out: Path,
    name: str,
    figure: Figure,
    numbers: Mapping[str, Any],
    table: pd.DataFrame,
    units: str = "dimensionless",
    **more: pd.DataFrame,
) -> dict[str, Any]:
    """Write figure, tables and `summary.json` with their provenance; return the numbers.

    The table has the name of the figure, those in `more` their own.
    """
    with study(f"example {name}", out, {}, units, force=True, csv=True) as results:
        results.write_results({name: table, **more}, numbers)
        results.save_figures([(name, figure)])
    return dict(numbers)


def run_example(main: Callable[..., Mapping[str, Any]], inputs: str = "") -> None:
    """Run an example on the folder that the command line names, and print its numbers.

    An example with `inputs` takes more paths after the folder.
    """
    if len(sys.argv) < 2 or (len(sys.argv) > 2 and not inputs):
        name = main.__globals__["__spec__"].name
        sys.exit(f"usage: python -m {name} RESULT_FOLDER {inputs}".rstrip())
    print(as_json(main(*map(Path, sys.argv[1:]))))
