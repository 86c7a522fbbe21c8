"""Operators of loops in place: error against time, by method and number of grains.

`python -m tests.tools.scaling.in_place --out DIR [--grains 2000,8000,32000,128000]`. The packing is
a state of a slow biaxial compression (Yade, 2000 discs), its cell repeated; errors are those of
`A_in` relative to the whole packing of the same size. Times are the processor's.
"""

from __future__ import annotations

import multiprocessing
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import cyclopts
import numpy as np
from cyclopts import Parameter
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator
from scipy.sparse.linalg import spsolve

from loops import Faces, GrainGraph, LinearFrictional, Regime, Scene, find_faces, loop_batches
from loops.arrays import Floats
from loops.geometry import boundary_vectors
from loops.in_place import loops_in_place
from loops.system import packing_system, stiffness_matrix
from patterns import read_snapshot, sample_path
from studies.output import provenance, result_folder, write_table
from studies.style import LINE_COLOURS, TWO_COLUMNS, new_figure, save_figure, styled
from tests.tools.scaling.measure import MB, _peak, _reset_peak, _timed

CELL = ((0.914723458490276, 0.0), (0.0, 0.897826511170329))
# Method and setting: options, and the largest packing it is timed on.
METHODS: dict[str, tuple[dict[str, Any], int]] = {
    "whole": ({"method": "whole"}, 400_000),
    "blocks 100, buffer 8": ({"method": "blocks"}, 200_000),
    "blocks 50, buffer 8": ({"method": "blocks", "block": 50.0}, 40_000),
    "blocks 25, buffer 4": ({"method": "blocks", "block": 25.0, "buffer": 4.0}, 40_000),
    "blocks 25, buffer 8": ({"method": "blocks", "block": 25.0, "buffer": 8.0}, 40_000),
    "blocks 6, buffer 8": ({"method": "blocks", "block": 6.0, "buffer": 8.0}, 40_000),
}
# What a script would do; solves of so many loops are timed, and the others taken alike.
PEERS = {"dense inverse": 2_000, "spsolve": 8_000}
SOLVED = 5
# Of the loops: quantiles of the error, the median of what is stated, the share within it.
ERRORS = ("median", "q90", "largest", "stated", "within")
UNITS = "seconds of the processor, MB = 2^20 bytes"
KINDS = {"blocks": "s"}


def replicated(times: int, *, sliding: bool) -> tuple[GrainGraph, LinearFrictional]:
    """The sample's cell repeated `times` along either axis."""
    snapshot = read_snapshot(sample_path("slow/grains_10.parquet"), cell=np.array(CELL))
    graph, (law, regime) = snapshot.graph, snapshot.mechanics()
    assert graph.images is not None and graph.cell is not None
    at = np.array([(a, b) for a in range(times) for b in range(times)])
    count, copies = graph.grain_count, len(at)
    there = at[:, None] + graph.images
    copy = (there % times) @ np.array([times, 1])
    first = np.repeat(np.arange(copies), graph.contact_count).reshape(copies, -1)
    pairs = np.stack([graph.contacts[:, 0] + count * first, graph.contacts[:, 1] + count * copy])
    flags = regime if sliding else np.full_like(regime, Regime.ELASTIC)
    large = GrainGraph(
        x=(graph.x + (at @ graph.cell.T)[:, None]).reshape(-1, 2),
        radii=np.tile(graph.radii, copies),
        contacts=np.moveaxis(pairs, 0, -1).reshape(-1, 2),
        normal_force=np.tile(graph.normal_force, copies),
        shear_force=np.tile(graph.shear_force, copies),
        images=(there // times).reshape(-1, 2),
        cell=times * graph.cell,
        regime=np.tile(flags, copies),
    )
    return large, law.take(np.tile(np.arange(graph.contact_count), copies))


@cache
def scene(times: int, sliding: bool) -> tuple[GrainGraph, LinearFrictional, Faces]:
    """A replicated packing and its faces."""
    graph, law = replicated(times, sliding=sliding)
    return graph, law, find_faces(graph)


def measured(name: str, times: int, sliding: bool) -> tuple[dict[str, Any], Floats, Floats]:
    """Time and memory of a method, the operators and their stated errors."""
    options = METHODS[name][0]
    loops_in_place(Scene(*replicated(1, sliding=False)), **options)
    graph, law, faces = scene(times, sliding)
    before, found = _reset_peak(), []
    _, seconds = _timed(lambda: found.append(loops_in_place(Scene(graph, law), faces, **options)))
    row = _row(name, graph, faces, sliding, seconds) | {"peak_mb": (_peak() - before) / MB}
    return row, found[0].matrix, found[0].error


def _row(
    name: str, graph: GrainGraph, faces: Faces, sliding: bool, seconds: float
) -> dict[str, Any]:
    row = {"grains": graph.grain_count, "sliding": sliding, "method": name}
    return row | {"loops": len(faces.loops), "cpu_seconds": seconds}


def peer(name: str, times: int, sliding: bool) -> dict[str, Any]:
    """Seconds that a script takes without the platform, all loops."""
    graph, law, faces = scene(times, sliding)
    system = packing_system(Scene(graph, law))
    K = stiffness_matrix(system)
    held = system.freedom[system.carrying.anchors, :2].ravel()
    free = np.setdiff1d(np.arange(system.size), held)
    matrix = K[free][:, free]
    if name == "dense inverse":
        seconds = _timed(lambda: np.linalg.inv(matrix.toarray()))[1]
    else:
        batch = next(iter(loop_batches(graph, faces)))
        loads = np.zeros((SOLVED, system.size, 4))
        vectors = boundary_vectors(batch.graph.x)
        for load, grains, v in zip(loads, batch.grains, vectors, strict=False):
            load[system.freedom[grains, 0], :2], load[system.freedom[grains, 1], 2:] = v, v
        each = _timed(lambda: [spsolve(matrix, load[free]) for load in loads])[1] / SOLVED
        seconds = each * len(faces.loops)
    return _row(name, graph, faces, sliding, seconds)


def compared(times: int, sliding: bool, tell: Any) -> list[dict[str, Any]]:
    """All methods at one size, each in a process of its own, against the whole packing."""
    grains, rows, exact = 2000 * times**2, [], None
    for name, (_, most) in METHODS.items():
        if grains > most:
            continue
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            row, matrix, stated = pool.apply(measured, (name, times, sliding))
        exact = matrix if name == "whole" else exact
        error = np.full(len(matrix), np.nan)
        if exact is not None:
            error = np.linalg.norm(matrix - exact, axis=(1, 2)) / np.linalg.norm(exact, axis=(1, 2))
        numbers = (
            *np.quantile(error, [0.5, 0.9, 1.0]),
            np.median(stated),
            np.nan if exact is None else np.mean(error <= stated),
        )
        row |= dict(zip(ERRORS, map(float, numbers), strict=True))
        rows.append(row)
        tell(row)
    for name, most in PEERS.items():
        if grains <= most:
            nothing = dict.fromkeys(("peak_mb", *ERRORS), np.nan)
            rows.append(peer(name, times, sliding) | nothing)
            tell(rows[-1])
    return rows


@styled()
def in_place_figure(rows: list[dict[str, Any]]) -> Figure:
    """Error against time by number of grains, and time over the number of grains."""
    figure = new_figure(TWO_COLUMNS, 3.4)
    left, right = figure.subplots(1, 2)
    own = [row for row in rows if not row["sliding"]]
    sizes = sorted({row["grains"] for row in own})
    colours = dict(zip(sizes, LINE_COLOURS, strict=False))
    for row in own:
        colour, each = colours[row["grains"]], 1e3 * row["cpu_seconds"] / row["loops"]
        kind = row["method"].replace(",", "").split()[0]
        if kind == "whole":
            left.axvline(each, color=colour, linewidth=0.8)
        elif row["median"] > 0:
            left.loglog(each, row["median"], KINDS[kind], color=colour)
    for size, colour in colours.items():
        left.plot([], [], "o", color=colour, label=f"{size:,} grains")
    for kind, marker in KINDS.items():
        left.plot([], [], marker, color="0.5", label=kind)
    left.plot([], [], color="0.5", label="whole")
    left.set(xlabel="processor time (ms a loop)", ylabel=r"median error of $A_{in}$")
    left.set_xticks([0.2, 0.5, 1.0, 2.0, 5.0], ["0.2", "0.5", "1", "2", "5"])
    left.xaxis.set_minor_locator(NullLocator())
    left.legend(ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.2))
    drawn = (*list(METHODS)[:4], *PEERS)
    for name, colour in zip(drawn, LINE_COLOURS, strict=False):
        points = [(row["grains"], row["cpu_seconds"]) for row in own if row["method"] == name]
        right.loglog(*zip(*points, strict=True), "o-", color=colour, label=name)
    right.set(xlabel="number of grains", ylabel="processor time of all loops (s)")
    right.set_xticks(sizes, [f"{size:,}" for size in sizes])
    right.xaxis.set_minor_locator(NullLocator())
    right.legend(ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.2))
    return figure


def main(
    out: Annotated[Path, Parameter(help="Result folder.")],
    grains: Annotated[str, Parameter(help="Sizes 2000 k^2, by commas.")] = "2000,8000,32000",
    sliding: Annotated[str, Parameter(help="Sizes with flagged contacts sliding too.")] = "8000",
    force: Annotated[bool, Parameter(negative=(), help="Replace results.")] = False,
) -> None:
    """Measure; write the table, the rows for docs/evidence/accuracy.md and the figure."""
    asked = [(int(n), False) for n in grains.split(",")]
    asked += [(int(n), True) for n in sliding.split(",") if n]
    with result_folder(out, force=force) as folder:
        rows: list[dict[str, Any]] = []
        for size, slides in asked:
            times = round((size / 2000) ** 0.5)
            rows += compared(times, slides, lambda row: print(_line(row)))
        made = provenance("in-place study", {"grains": grains, "sliding": sliding}, UNITS)
        columns = {name: [row[name] for row in rows] for name in rows[0]}
        write_table(folder, "in_place", columns, made, csv=True)
        (folder / "rows.md").write_text("\n".join(map(_line, rows)) + "\n")
        save_figure(in_place_figure(rows), folder, "in_place", made)


def _line(row: dict[str, Any]) -> str:
    """A row of the page's table."""
    numbers = [_digits(100 * row[name], 2) for name in ERRORS[:4]]
    cells = [f"{row['grains']:,}", row["method"], _digits(row["cpu_seconds"], 3)]
    cells += [f"{row['peak_mb']:.0f}", *numbers, f"{100 * row['within']:.1f}"]
    return "| " + " | ".join(cell.replace("nan", "-") for cell in cells) + " |"


def _digits(value: float, count: int) -> str:
    return f"{float(f'{value:.{count}g}'):g}"


if __name__ == "__main__":
    cyclopts.run(main)
