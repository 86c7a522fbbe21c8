"""The linear control that makes a loop lose strength, and paths that show it.

Run as `python -m studies.destabilising_control --out DIR`. From a confined loop beyond the loss of
det Ks, the strain combination `held` is held and the loop is driven along `direction`: under the
isotropic control the strength has its peak in the state itself, under the softening control it
falls at once with the slope W2.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import ArrayLike, NDArray

from loops import GrainGraph, LinearFrictional, macroscopic_tangent
from patterns import regular_polygon
from patterns.diamond import TABLE_2, diamond
from stability import (
    LinearControl,
    Stage,
    destabilising_control,
    follow,
    restrict,
    softening_control,
    strain_driven,
    subspace_basis,
)
from studies.output import provenance, result_folder, write_summary, write_table

Floats = NDArray[np.float64]
LENGTH = 0.03
CONTROLS: dict[str, Callable[[ArrayLike], LinearControl]] = {
    "isotropic direction": destabilising_control,
    "inside the cone": softening_control,
}


def confined_loops() -> dict[str, tuple[GrainGraph, LinearFrictional, Any, Any]]:
    """Loops beyond the loss of det Ks: name to graph, law, closure and subspace.

    Returns
    -------
    dict
        The diamond of Table 2 at A, affine, and a hexagon at 1.2 times its threshold, relaxed.
    """
    p = TABLE_2
    kappa = 0.2
    return {
        "diamond, Table 2, at A": (
            diamond(p.alpha0, E1=p.confinement, E2=p.confinement),
            LinearFrictional(1.0, p.kappa),
            "affine",
            "diagonal",
        ),
        "hexagon, relaxed": (
            regular_polygon(6, strain=1.2 * kappa / (1 + kappa)),
            LinearFrictional(1.0, kappa),
            "traction",
            "symmetric",
        ),
    }


def response(
    graph: GrainGraph,
    law: LinearFrictional,
    closure: Any,
    subspace: Any,
    control: LinearControl,
    sense: float,
) -> tuple[Floats, Floats]:
    """Strength gained over the strain driven under a control.

    Parameters
    ----------
    graph, law, closure, subspace
        A confined loop.
    control : LinearControl
        The control.
    sense : {1, -1}
        Sense of the drive.

    Returns
    -------
    strain, strength : (rows,) array
        `direction . (H - H_0)` and `direction . (P - P_0)/kn`, both times the sense.
    """
    stage = Stage(strain_driven(control, subspace, sense), "parameter", LENGTH)
    path = follow(graph, law, [stage], closure=closure, subspace=subspace)
    along = subspace_basis(subspace).T @ control.direction
    return sense * (path.H - path.H[0]) @ along, sense * (path.P - path.P[0]) @ along


def study() -> tuple[dict[str, dict[str, Any]], dict[str, list[tuple[str, Floats, Floats]]]]:
    """Controls of every loop, and its responses in both senses.

    Returns
    -------
    controls : dict
        By loop and control: held combination, direction, slope.
    responses : dict
        By loop: label, strain, strength.
    """
    controls: dict[str, dict[str, Any]] = {}
    responses: dict[str, list[tuple[str, Floats, Floats]]] = {}
    for name, (graph, law, closure, subspace) in confined_loops().items():
        operator = restrict(macroscopic_tangent(graph, law, closure).matrix, subspace)
        for label, make in CONTROLS.items():
            control = make(operator)
            controls.setdefault(name, {})[label] = {
                "status": control.status,
                "held": control.held,
                "direction": control.direction,
                "slope": control.work,
            }
            for sense, mark in ((1.0, "+"), (-1.0, "-")):
                found = response(graph, law, closure, subspace, control, sense)
                responses.setdefault(name, []).append((f"{label}, {mark}", *found))
    return controls, responses


def main(
    out: Annotated[Path, typer.Option(help="Result folder.")],
    force: Annotated[bool, typer.Option("--force", help="Replace results.")] = False,
) -> None:
    """Find the controls, follow the paths, write table, summary and figure."""
    controls, responses = study()
    rows = [
        (name, label, strain, strength)
        for name, found in responses.items()
        for label, e, s in found
        for strain, strength in zip(e.tolist(), s.tolist(), strict=True)
    ]
    with result_folder(out, force=force) as folder:
        made = provenance("destabilising control", {"length": LENGTH}, "dimensionless")
        names = ("loop", "control", "strain", "strength")
        columns = dict(zip(names, map(list, zip(*rows, strict=True)), strict=True))
        write_table(folder, "responses", columns, made, csv=True)
        write_summary(folder, {"controls": controls, "provenance": made})
        draw(responses, folder, made)
    for name, found in controls.items():
        for label, control in found.items():
            typer.echo(f"{name}: {label}: slope of the strength {control['slope']:.3e}")


def draw(
    responses: dict[str, list[tuple[str, Floats, Floats]]], folder: Path, source: dict[str, Any]
) -> None:
    """Draw the strength over the strain driven, loop by loop.

    Parameters
    ----------
    responses : dict
        From `study`.
    folder : Path
        Where to write `destabilising_control` as PNG and SVG.
    source : dict
        Provenance.
    """
    from studies.style import BLUE, GREY, TWO_COLUMNS, VERMILION, new_figure, save_figure, styled

    looks = [(BLUE, "-"), (BLUE, "--"), (VERMILION, "-"), (VERMILION, "--")]
    with styled():
        figure = new_figure(TWO_COLUMNS, 2.7)
        for ax, (name, found) in zip(figure.subplots(1, 2), responses.items(), strict=True):
            for (label, strain, strength), (colour, line) in zip(found, looks, strict=True):
                ax.plot(strain, 1e3 * strength, line, color=colour, label=label)
            ax.axhline(0.0, color=GREY, linewidth=0.6)
            ax.set(
                xlabel="strain driven (–)", ylabel=r"strength gained $\times 10^3$ (–)", title=name
            )
        figure.axes[0].legend()
        save_figure(figure, folder, "destabilising_control", source)


if __name__ == "__main__":
    typer.run(main)
