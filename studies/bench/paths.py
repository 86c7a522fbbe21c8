"""Path integrators to point B of Table 1: steps or tolerance."""

from __future__ import annotations

from functools import partial

from studies.bench.measure import Row, measured
from studies.integrators import METHODS, error_at_b, path_solver

ORACLE = "quadrature, 20 digits"
# Tolerances of the path solver; the last is the default of `stability.follow`.
TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
DEFAULT = 1e-12
MOST_STEPS, MOST_STEPS_QUICK = 100_000, 1000


def path_methods(quick: bool) -> list[Row]:
    """Error at point B and time per path of every integrator.

    Parameters
    ----------
    quick : bool
        Fewer settings.

    Returns
    -------
    list of Row
    """
    rows, most = [], MOST_STEPS_QUICK if quick else MOST_STEPS
    for method, solver, control, values in METHODS:
        chosen = TOLERANCES if solver is path_solver else values
        chosen = [value for value in chosen if control != "steps" or value <= most]
        for value in chosen[:: 4 if quick else 1]:
            paths = int(value) if control == "paths" else 1
            rows.append(
                measured(
                    partial(solver, value),
                    paths,
                    quick=quick,
                    group="paths",
                    method=method,
                    setting=f"{control} {value:g}",
                    error=error_at_b(solver(value)),
                    oracle=ORACLE,
                    default=solver is path_solver and value == DEFAULT,
                )
            )
    return rows
