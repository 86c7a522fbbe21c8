"""A batch of loops of one order under both closures: speed, and error against 50 digits.

Run as `python -m studies.loop_batch --out DIR [--loops 100000 --order 6]`. Random convex rings,
elastic and sliding contacts, overlaps from stiff (1e-8) to soft (0.3): operator, eigenvalues of Ks
in the symmetric subspace and unstable fraction; the error of a random hundred is measured against
50-digit arithmetic and set beside the condition that the solver states.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import typer
from numpy.typing import NDArray

from loops import GrainGraph, LinearFrictional, MacroTangent, Regime, macroscopic_tangent
from stability import imhof_fraction, restrict, symmetric_spectrum, unstable_fraction
from studies.fifty_digits import (
    affine_tangent_50,
    as_array,
    symmetric_spectrum_50,
    traction_tangent_50,
)
from studies.output import provenance, result_folder, write_summary, write_table

Floats = NDArray[np.float64]
KN, KT, MU, SLIDING = 1.0, 0.4, 0.5, 0.2
EXACT = {"affine": affine_tangent_50, "traction": traction_tangent_50}


class Batch(NamedTuple):
    """Loops, their law and the regimes of their contacts."""

    graph: GrainGraph
    law: LinearFrictional
    regime: NDArray[np.int8]


def random_batch(loops: int, order: int, seed: int) -> Batch:
    """Draw irregular rings with forces on them.

    Parameters
    ----------
    loops, order : int
        How many, and of how many grains.
    seed : int
        Seed of the draw.

    Returns
    -------
    Batch
        Overlaps `N/(kn l)` log-uniform from 1e-8 to 0.3 by loop, a fifth of the contacts sliding.
    """
    rng = np.random.default_rng(seed)
    angle = 2 * np.pi * (np.arange(order) + rng.uniform(-0.3, 0.3, (loops, order))) / order
    distance = rng.uniform(0.8, 1.2, (loops, order))
    x = distance[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    edges = np.roll(x, -1, axis=1) - x
    length = np.hypot(edges[..., 0], edges[..., 1])
    overlap = 10.0 ** rng.uniform(-8, np.log10(0.3), (loops, 1))
    normal = KN * overlap * length * rng.uniform(0.5, 1.5, (loops, order))
    sliding = rng.random((loops, order)) < SLIDING
    share = np.where(sliding, rng.choice([-1.0, 1.0], (loops, order)), rng.uniform(-0.95, 0.95))
    graph = GrainGraph(
        x=x,
        radii=length.max(axis=1, keepdims=True) * np.full(order, 0.8),
        contacts=np.column_stack([np.arange(order), np.roll(np.arange(order), -1)]),
        normal_force=normal,
        shear_force=share * MU * normal,
    )
    regime = np.where(sliding, Regime.SLIDING, Regime.ELASTIC).astype(np.int8)
    return Batch(graph, LinearFrictional(KN, KT, MU), regime)


def judge_batch(batch: Batch, closure: str) -> tuple[MacroTangent, Floats, Floats]:
    """Operator, eigenvalues of Ks (symmetric subspace) and unstable fraction of every loop.

    Parameters
    ----------
    batch : Batch
        Loops.
    closure : {'affine', 'traction'}
        Closure.

    Returns
    -------
    MacroTangent, (L, 3) array, (L,) array
        The three.
    """
    name: Any = closure
    tangent = macroscopic_tangent(batch.graph, batch.law, name, regime=batch.regime)
    spectrum = symmetric_spectrum(restrict(tangent.matrix, "symmetric"))
    return tangent, spectrum, unstable_fraction(spectrum)


def errors(batch: Batch, closure: str, rows: NDArray[np.int64]) -> dict[str, Floats]:
    """Errors of picked loops against 50 digits.

    Parameters
    ----------
    batch : Batch
        Loops.
    closure : {'affine', 'traction'}
        Closure.
    rows : (R,) array of int
        Loops to check.

    Returns
    -------
    dict of str to (R,) array
        `operator` and `eigenvalues`, relative to the operator's norm; `fraction`, absolute;
        `bound`, the stated condition times the unit of rounding.
    """
    tangent, spectrum, fraction = judge_batch(batch, closure)
    out: dict[str, list[float]] = {"operator": [], "eigenvalues": [], "fraction": [], "bound": []}
    graph = batch.graph
    for row in rows.tolist():
        state = (graph.x[row], graph.x0[row], graph.normal_force[row], graph.shear_force[row])
        exact = EXACT[closure](*state, KN, KT, MU, batch.regime[row])
        matrix, values = as_array(exact), symmetric_spectrum_50(exact)
        size = float(np.linalg.norm(matrix))
        out["operator"].append(float(np.linalg.norm(tangent.matrix[row] - matrix)) / size)
        out["eigenvalues"].append(float(np.abs(spectrum[row] - values).max()) / size)
        out["fraction"].append(abs(float(fraction[row]) - float(imhof_fraction(values))))
        out["bound"].append(float(tangent.condition[row]) * np.finfo(float).eps)
    return {name: np.array(values) for name, values in out.items()}


def main(
    out: Annotated[Path, typer.Option(help="Result folder.")],
    loops: Annotated[int, typer.Option(help="Size of the batch.")] = 100_000,
    order: Annotated[int, typer.Option(help="Grains of a loop.")] = 6,
    checked: Annotated[int, typer.Option(help="Loops checked with 50 digits.")] = 100,
    seed: Annotated[int, typer.Option(help="Seed of the draw.")] = 1,
    force: Annotated[bool, typer.Option("--force", help="Replace results.")] = False,
) -> None:
    """Time the batch, check a random hundred, write the tables and the figure."""
    batch = random_batch(loops, order, seed)
    rows = np.random.default_rng(seed).choice(loops, min(checked, loops), replace=False)
    summary: dict[str, Any] = {"loops": loops, "order": order}
    found = {}
    for closure in EXACT:
        judge_batch(batch, closure)
        start = time.perf_counter()
        judge_batch(batch, closure)
        seconds = time.perf_counter() - start
        found[closure] = errors(batch, closure, rows)
        worst = {name: float(values.max()) for name, values in found[closure].items()}
        summary[closure] = {"seconds": seconds, "largest": worst}
        typer.echo(
            f"{closure:<9} {seconds:6.3f} s  largest error: operator {worst['operator']:.1e}, "
            f"eigenvalues {worst['eigenvalues']:.1e}, fraction {worst['fraction']:.1e}; "
            f"stated bound up to {worst['bound']:.1e}"
        )
    with result_folder(out, force=force) as folder:
        configuration = {"loops": loops, "order": order, "checked": checked, "seed": seed}
        made = provenance("batch of loops", configuration, "errors relative to the operator's norm")
        for closure, columns in found.items():
            write_table(folder, closure, {"loop": rows, **columns}, made, csv=True)
        write_summary(folder, {**summary, "provenance": made})
        draw(batch, rows, found, folder, made)


def draw(
    batch: Batch,
    rows: NDArray[np.int64],
    found: dict[str, dict[str, Floats]],
    folder: Path,
    source: dict[str, Any],
) -> None:
    """Draw the errors over the overlap, with the bound that the solver states.

    Parameters
    ----------
    batch : Batch
        Loops.
    rows : (R,) array of int
        The loops checked.
    found : dict of str to dict of str to array
        From `errors`, by closure.
    folder : Path
        Where to write `loop_batch` as PNG and SVG.
    source : dict
        Provenance.
    """
    from studies.style import BLUE, GREY, TWO_COLUMNS, new_figure, save_figure, styled

    edges = np.roll(batch.graph.x[rows], -1, axis=1) - batch.graph.x[rows]
    overlap = (batch.graph.normal_force[rows] / np.hypot(*np.moveaxis(edges, -1, 0))).mean(axis=1)
    with styled():
        figure = new_figure(TWO_COLUMNS, 2.6)
        for ax, (closure, columns) in zip(
            figure.subplots(1, 2, sharey=True), found.items(), strict=True
        ):
            floor = np.finfo(float).eps / 10
            ax.loglog(
                overlap, np.maximum(columns["bound"], floor), "_", color=GREY, label="stated bound"
            )
            ax.loglog(
                overlap,
                np.maximum(columns["operator"], floor),
                "o",
                color=BLUE,
                markersize=3,
                label="error",
            )
            ax.set(xlabel=r"mean overlap $N/(k_n l)$", title=f"{closure} closure")
        figure.axes[0].set_ylabel("relative error of the operator")
        figure.axes[1].legend()
        save_figure(figure, folder, "loop_batch", source)


if __name__ == "__main__":
    typer.run(main)
