"""Time and memory of faces and tangents over the number of grains, against the usual tools.

Run as `python -m studies.scaling --out DIR [--grains 1000,10000,100000]`. Each measurement has a
process of its own, so that its peak memory is its own; its time is the median of the repeats,
input and imports aside. shapely, the tool a user would take for the faces, comes with the extra
`test`.
"""

from __future__ import annotations

import multiprocessing
import resource
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from loops import GrainGraph, LinearFrictional, Regime, find_faces
from patterns import Snapshot, synthetic_network
from studies.output import provenance, result_folder, write_summary, write_table
from studies.snapshot.table import loop_table

KN, KT, MU, SLIDING = 1.0, 0.5, 0.5, 0.06
Work = Callable[[], Any]


def faces_numpy(graph: GrainGraph) -> Work:
    """Faces by half-edges in numpy: the platform's own."""
    return lambda: find_faces(graph)


def faces_shapely(graph: GrainGraph) -> Work:
    """Faces by shapely's polygonize, corners mapped back to grains by their coordinates."""
    import shapely

    lines = shapely.linestrings(graph.x[graph.contacts])

    def work() -> list[list[int]]:
        polygons = shapely.get_parts(shapely.polygonize(lines))
        grain = {tuple(x): g for g, x in enumerate(graph.x.tolist())}
        rings = [ring.tolist() for ring in map(shapely.get_coordinates, polygons)]
        return [[grain[tuple(corner)] for corner in ring[:-1]] for ring in rings]

    return work


def tangents(graph: GrainGraph) -> Work:
    """Table of all loops: shape, stress, both tangents, eigenvalues, unstable fractions."""
    rng = np.random.default_rng(0)
    slides = rng.random(graph.contact_count) < SLIDING
    shear = np.where(slides, MU * graph.normal_force, graph.shear_force)
    snapshot = Snapshot(
        graph=graph.replace(shear_force=shear),
        law=LinearFrictional(kn=np.full(graph.contact_count, KN), kt=KT, mu=MU),
        regime=np.where(slides, Regime.SLIDING, Regime.ELASTIC).astype(np.int8),
        ids=np.arange(graph.grain_count),
        wall_contacts=0,
        notes=(),
    )
    faces = find_faces(graph)
    return lambda: loop_table(snapshot, faces)


METHODS = {"faces": faces_numpy, "faces, shapely": faces_shapely, "table of loops": tangents}


def measure(method: str, grains: int, repeats: int) -> dict[str, Any]:
    """Time one method on a network of its own.

    Parameters
    ----------
    method : str
        Key of `METHODS`.
    grains : int
        Size of the network.
    repeats : int
        Number of timed calls, after one that is not counted.

    Returns
    -------
    dict
        `method`, `grains`, `contacts`, `seconds` (median), `peak_mb` of the process.
    """
    graph = synthetic_network(grains, seed=1)
    work = METHODS[method](graph)
    seconds = []
    for _ in range(repeats + 1):
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    return {
        "method": method,
        "grains": graph.grain_count,
        "contacts": graph.contact_count,
        "seconds": statistics.median(seconds[1:]),
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


def main(
    out: Annotated[Path, typer.Option(help="Result folder.")],
    grains: Annotated[str, typer.Option(help="Sizes, by commas.")] = "1000,10000,100000",
    repeats: Annotated[int, typer.Option(help="Timed calls.")] = 3,
    force: Annotated[bool, typer.Option("--force", help="Replace results.")] = False,
) -> None:
    """Measure every method at every size; write the table and the figure."""
    sizes = [int(size) for size in grains.split(",")]
    context = multiprocessing.get_context("spawn")
    rows = []
    for size in sizes:
        for method in METHODS:
            with context.Pool(1) as pool:
                row = pool.apply(measure, (method, size, repeats))
            rows.append(row)
            typer.echo(
                f"{method:<16} {size:>9} grains {row['seconds']:10.4f} s {row['peak_mb']:8.0f} MB"
            )
    with result_folder(out, force=force) as folder:
        made = provenance("scaling study", {"grains": sizes, "repeats": repeats}, "seconds, MB")
        columns = {name: [row[name] for row in rows] for name in rows[0]}
        write_table(folder, "scaling", columns, made, csv=True)
        write_summary(folder, {"rows": rows, "provenance": made})
        draw(rows, folder, made)


def draw(rows: list[dict[str, Any]], folder: Path, source: dict[str, Any]) -> None:
    """Draw time and peak memory over the number of grains.

    Parameters
    ----------
    rows : list of dict
        From `measure`.
    folder : Path
        Where to write `scaling` as PNG and SVG.
    source : dict
        Provenance.
    """
    from studies.style import LINE_COLOURS, TWO_COLUMNS, new_figure, save_figure, styled

    with styled():
        figure = new_figure(TWO_COLUMNS, 2.8)
        panels = figure.subplots(1, 2)
        labels = (("seconds", "time (s)"), ("peak_mb", "peak memory of the process (MB)"))
        for ax, (key, label) in zip(panels, labels, strict=True):
            for method, colour in zip(METHODS, LINE_COLOURS, strict=False):
                own = [row for row in rows if row["method"] == method]
                x, y = [row["grains"] for row in own], [row[key] for row in own]
                ax.loglog(x, y, "o-", color=colour, label=method)
            ax.set(xlabel="number of grains", ylabel=label)
        panels[0].legend()
        save_figure(figure, folder, "scaling", source)


if __name__ == "__main__":
    typer.run(main)
