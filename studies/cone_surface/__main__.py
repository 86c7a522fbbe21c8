"""The cone of a loop in two states: `python -m studies.cone_surface --out DIR`.

A hexagon beyond its threshold, compressed isotropically, and one whose contacts slide on a drained
biaxial path.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from loops import InputError, LinearFrictional
from patterns import regular_polygon
from stability import Stage, follow, programmes, symmetric_spectrum, unstable_fraction
from studies.cone_surface.draw import cone_edge, draw_states
from studies.output import provenance, result_folder, write_summary, write_table
from studies.style import save_figure

Floats = NDArray[np.float64]


def hexagon_states(
    order: int, kappa: float, phi: float, compression: float, confine: float, axial: float
) -> dict[str, Floats]:
    """Tangents of a regular loop under the traction closure, in the symmetric subspace.

    Parameters
    ----------
    order : int
        Number of grains.
    kappa, phi : float
        kt/kn; friction angle, degrees.
    compression : float
        Isotropic strain of the first state.
    confine, axial : float
        Isotropic strain, and axial strain to which the drained biaxial path then leads.

    Returns
    -------
    dict of str to (3, 3) array

    Raises
    ------
    InputError
        If the path does not reach its end.
    """
    law = LinearFrictional(kn=1.0, kt=kappa, mu=float(np.tan(np.radians(phi))))
    isotropic = Stage(programmes.isotropic_strain(), "H11", compression)
    drained = [
        Stage(programmes.isotropic_strain(), "H11", confine),
        Stage(programmes.drained_biaxial(), "H11", axial),
    ]
    named = {
        f"isotropic, $E$ = {compression:g}": [isotropic],
        f"drained biaxial, $E_1$ = {axial:g}": drained,
    }
    states = {}
    for name, stages in named.items():
        path = follow(regular_polygon(order), law, stages, closure="traction", subspace="symmetric")
        if path.status != "finished":
            raise InputError(name, path.message, "a path to its end", "Load the loop less.")
        states[name] = path.K[-1]
    return states


def main(
    out: Annotated[Path, typer.Option(help="Result folder.")],
    order: Annotated[int, typer.Option(help="Number of grains.")] = 6,
    kappa: Annotated[float, typer.Option(help="kt/kn.")] = 0.2,
    phi: Annotated[float, typer.Option(help="Friction angle, degrees.")] = 5.0,
    compression: Annotated[float, typer.Option(help="Isotropic strain, first state.")] = 0.2,
    confine: Annotated[float, typer.Option(help="Isotropic strain before the biaxial path.")] = 0.1,
    axial: Annotated[float, typer.Option(help="Axial strain at its end.")] = 0.2,
    force: Annotated[bool, typer.Option("--force", help="Replace results.")] = False,
) -> None:
    """Draw the cone of a loop in two states; write the picture and its numbers."""
    given: dict[str, Any] = {
        "order": order, "kappa": kappa, "phi": phi, "compression": compression,
        "confine": confine, "axial": axial,
    }  # fmt: skip
    try:
        with result_folder(out, force=force) as folder:
            states = hexagon_states(**given)
            made = provenance("cone surface", given, "K over kn")
            write_table(folder, "cone_surface", _edges(states), made, csv=True)
            write_summary(folder, {"states": _numbers(states), "provenance": made})
            save_figure(draw_states(states), folder, "cone_surface", made)
    except InputError as error:
        typer.echo(f"cone surface: {' '.join(str(error).split())}", err=True)
        raise typer.Exit(2) from None
    typer.echo(f"results in {out}")


def _numbers(states: dict[str, Floats]) -> dict[str, Any]:
    return {
        name: {
            "K": K,
            "eigenvalues_Ks": symmetric_spectrum(K),
            "unstable_fraction": float(unstable_fraction(symmetric_spectrum(K))),
        }
        for name, K in states.items()
    }


def _edges(states: dict[str, Floats]) -> dict[str, Any]:
    """One row for each direction of each edge."""
    edges = {name: cone_edge(K)[1] for name, K in states.items()}
    every = np.concatenate(list(edges.values()))
    names = [name for name, edge in edges.items() for _ in edge]
    return {"state": names, "E11": every[:, 0], "E22": every[:, 1], "sqrt2_E12": every[:, 2]}


if __name__ == "__main__":
    typer.run(main)
