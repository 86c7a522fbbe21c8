"""Which control makes a loop lose strength?

From a confined loop beyond the loss of det Ks one strain combination is held and the loop driven
along the other. Along the isotropic direction of Ks the strength has its peak in the state itself;
inside the cone it falls at once, in both senses, with the slope W2.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from loops import LinearFrictional, Scene, macroscopic_tangent
from loops.arrays import Floats
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
from studies.examples import run_example, save
from studies.style import BLUE, GREY, TWO_COLUMNS, VERMILION, new_figure, styled

LENGTH = 0.03
KAPPA = 0.2
CONTROL_BY_NAME: dict[str, Callable[[Floats], LinearControl]] = {
    "isotropic direction": destabilising_control,
    "inside the cone": softening_control,
}
E = TABLE_2.confinement
# Name: graph, law, closure, subspace.
LOOPS: dict[str, Any] = {
    "diamond, Table 2, at A": (
        *(diamond(TABLE_2.alpha0, E1=E, E2=E), LinearFrictional(1.0, TABLE_2.kappa)),
        *("affine", "diagonal"),
    ),
    "hexagon, relaxed": (
        *(regular_polygon(6, strain=1.2 * KAPPA / (1 + KAPPA)), LinearFrictional(1.0, KAPPA)),
        *("traction", "symmetric"),
    ),
}


def responses(name: str) -> list[dict[str, Any]]:
    """Strength gained over the strain driven: each control of a loop, in both senses."""
    graph, law, closure, subspace = LOOPS[name]
    operator = restrict(macroscopic_tangent(graph, law, closure).matrix, subspace)
    found = []
    for label, make in CONTROL_BY_NAME.items():
        control = make(operator)
        along = subspace_basis(subspace).T @ control.direction
        for sense in (1.0, -1.0):
            stage = Stage(strain_driven(control, subspace, sense), "parameter", LENGTH)
            path = follow(Scene(graph, law), [stage], closure=closure, subspace=subspace)
            strain, strength = (sense * (a - a[0]) @ along for a in (path.H, path.P))
            row = {"loop": name, "control": label, "sense": sense, "slope": control.work}
            found.append({**row, "strain": strain, "strength": strength})
    return found


@styled()
def draw(found: list[dict[str, Any]]) -> Figure:
    """Strength over strain, loop by loop."""
    figure = new_figure(TWO_COLUMNS, 2.7)
    for ax, name in zip(figure.subplots(1, 2), LOOPS, strict=True):
        for row in (row for row in found if row["loop"] == name):
            colour = BLUE if row["control"] == "isotropic direction" else VERMILION
            label = f"{row['control']}, {'+' if row['sense'] > 0 else '-'}"
            look = "-" if row["sense"] > 0 else "--"
            ax.plot(row["strain"], 1e3 * row["strength"], look, color=colour, label=label)
        ax.axhline(0.0, color=GREY, linewidth=0.6)
        ax.set(xlabel="strain driven", ylabel=r"strength gained $\times 10^3$", title=name)
    figure.axes[0].legend()
    return figure


def main(out: Path) -> dict[str, Any]:
    """Follow every response; write curves, slopes and the figure."""
    found = [row for name in LOOPS for row in responses(name)]
    names = ("loop", "control", "sense", "strain", "strength")
    table = pd.concat([pd.DataFrame({name: row[name] for name in names}) for row in found])
    slopes = {f"{row['loop']}: {row['control']}": row["slope"] for row in found}
    return save(out, "destabilising_control", draw(found), {"slopes": slopes}, table)


if __name__ == "__main__":
    run_example(main)
