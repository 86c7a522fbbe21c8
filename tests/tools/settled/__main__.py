"""Measure them all: `python -m tests.tools.settled --out DIR [--quick]`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import cyclopts
import pandas as pd
from cyclopts import Parameter

from studies.study import study
from tests.benchmarks.methods import Row, machine
from tests.benchmarks.run import UNITS, knee, pareto
from tests.tools.settled.closures import least_squares_methods
from tests.tools.settled.eigenvalues import eigenvalue_methods
from tests.tools.settled.fractions import fraction_methods
from tests.tools.settled.half_edges import half_edge_methods
from tests.tools.settled.integrators import integrator_methods
from tests.tools.settled.precision import precisions

GROUPS: dict[str, Callable[[bool], list[Row]]] = {
    "integrators": integrator_methods,
    "least squares": least_squares_methods,
    "eigenvalues": eigenvalue_methods,
    "cone fractions": fraction_methods,
    "half-edges": half_edge_methods,
    "precision": precisions,
}


def main(
    *,
    out: Annotated[Path, Parameter(help="Result folder.")],
    quick: Annotated[bool, Parameter(negative=(), help="Smaller sizes, fewer settings.")] = False,
    force: Annotated[bool, Parameter(negative=(), help="Replace results.")] = False,
) -> None:
    """Measure; write the table and the figure, and print the knee of every group."""
    made = ("settled choices", out, {**machine("numpy"), "quick": quick}, UNITS)
    with study(*made, force=force, csv=True) as results:
        table = pd.DataFrame([asdict(row) for find in GROUPS.values() for row in find(quick)])
        knees = {str(name): knee(own).to_dict() for name, own in table.groupby("group")}
        results.write_tables({"settled": table})
        results.write_summary({"knees": knees})
        results.save_figures([("settled", pareto(table))])
    print(table.to_string(index=False, columns=["group", "method", "setting", "error"]))


if __name__ == "__main__":
    cyclopts.run(main)
