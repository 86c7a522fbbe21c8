"""Which loops of a packing does its own rate problem foresee?

Four snapshots of a slow biaxial compression (Yade, 2000 discs, steps of 2e-5): the packing's answer
to the cell's strain, loop by loop, against what the loops did until the next snapshot; beside it a
loop cut out of its packing, its order, and what it did the step before.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from loops import Fate, find_faces
from loops.arrays import Floats
from loops.loop_strain import rotation_and_stretch
from patterns import Snapshot, read_snapshot, sample_path
from stability.packing import loop_rates, packing_response
from studies.examples import run, save
from studies.series.increments import TrackedState, increments, track_loops
from studies.series.plan import cells_by_number
from studies.series.skill import skill
from studies.style import LINE_COLOURS, TWO_COLUMNS, new_figure, styled

# The target of each predictor's score; higher is likelier.
TARGETS = ("W2_negative", "nonaffine", "topology")


def snapshots(folder: Path, cells: Path) -> list[Snapshot]:
    """Snapshots `grains_KK` of a folder with their cells, law over the radii as Yade has it."""
    found = []
    for number, (xx, xy, yx, yy) in sorted(cells_by_number(cells).items()):
        path = folder / f"grains_{number:02d}.parquet"
        found.append(read_snapshot(path, cell=[[xx, xy], [yx, yy]], shear_increment="radii"))
    return found


def interval(
    before: TrackedState, after: TrackedState, past: Floats | None = None
) -> tuple[dict[str, Any], list[dict[str, Any]], Floats]:
    """How the response was found, skill by predictor and target, and the later loops' `w2`."""
    graph, law = before.snapshot.graph, before.snapshot.law
    assert law is not None and graph.cell is not None and after.snapshot.graph.cell is not None
    H = np.eye(2) - after.snapshot.graph.cell @ np.linalg.inv(graph.cell)
    fates = track_loops(before, after)
    own = increments(before, after, fates)
    response = packing_response(graph, law, H)
    rates = loop_rates(response, before.faces)
    at = own["loop_before"]
    actual = rotation_and_stretch(_gradients(own))[1]
    whole = rotation_and_stretch(H)[1]
    nonaffine = np.linalg.norm(actual - whole, axis=(1, 2))
    square = np.sum(actual**2, axis=(1, 2))
    work = {
        "packing": -rates.normalised_work[at],
        "traction_free": -own["traction_free_W2"] / square,
        "persistence": np.full(len(at), np.nan) if past is None else -past[at],
        "order": own["order"].astype(float),
    }
    tenth = np.quantile(nonaffine, 0.9) - nonaffine
    lost = np.where(fates.before == Fate.SURVIVED, 1.0, -1.0)
    rows = [_row(name, TARGETS[0], score, own["w2"]) for name, score in work.items()]
    rows.append(_row("packing", TARGETS[1], rates.nonaffinity[at], tenth))
    soonest = np.minimum(rates.opening, rates.closing)
    rows.append(_row("packing", TARGETS[2], 1.0 / np.maximum(soonest, 1e-12), lost))
    later = np.full(len(after.faces.loops), np.nan)
    later[own["loop_after"]] = own["w2"]
    how = {"status": response.status, "residual": response.residual}
    return how | {"disagreeing": response.disagreeing, "sliding": response.sliding}, rows, later


def _gradients(own: dict[str, Any]) -> Floats:
    H: Floats = np.stack([own[f"H{ij}"] for ij in ("11", "12", "21", "22")], axis=1)
    return H.reshape(-1, 2, 2)


def _row(predictor: str, target: str, score: Floats, value: Floats) -> dict[str, Any]:
    """Skill of a score for the loops whose value is negative."""
    return {"predictor": predictor, "target": target} | skill(score, value, signed=False)


def series_skill(found: Sequence[Snapshot]) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """How each interval's response was found; skill, a row an interval, predictor and target."""
    how, rows, past = [], [], None
    before = TrackedState(found[0], find_faces(found[0].graph))
    for k, snapshot in enumerate(found[1:]):
        after = TrackedState(snapshot, find_faces(snapshot.graph))
        one, own, past = interval(before, after, past)
        how.append({"interval": k} | one)
        rows += [{"interval": k} | row for row in own]
        before = after
    return how, rows


@styled()
def draw(rows: Sequence[dict[str, Any]]) -> Figure:
    """AUC by predictor over the intervals, for each target."""
    figure = new_figure(TWO_COLUMNS, 2.6)
    for ax, target in zip(figure.subplots(1, len(TARGETS), sharey=True), TARGETS, strict=True):
        own = [row for row in rows if row["target"] == target]
        names = list(dict.fromkeys(row["predictor"] for row in own))
        for name, colour in zip(names, LINE_COLOURS, strict=False):
            points = [(row["interval"], row["auc"]) for row in own if row["predictor"] == name]
            ax.plot(*zip(*points, strict=True), "o-", color=colour, label=name)
        ax.axhline(0.5, color="0.7", linewidth=0.8)
        ax.set(xlabel="interval", title=f"{target}, base {own[0]['base']:.2f}")
        ax.legend()
    figure.axes[0].set_ylabel("AUC")
    return figure


def main(out: Path) -> dict[str, Any]:
    """Predict, compare, write the table and the figure."""
    cells = sample_path("slow/cells.csv")
    how, rows = series_skill(snapshots(cells.parent, cells))
    columns = {name: [row[name] for row in rows] for name in rows[0]}
    numbers = {"intervals": how, "skill": _means(rows)}
    return save(out, "packing_skill", draw(rows), numbers, columns)


def _means(rows: Sequence[dict[str, Any]]) -> dict[str, dict[str, float]]:
    keys = dict.fromkeys((row["predictor"], row["target"]) for row in rows)
    out: dict[str, dict[str, float]] = {}
    for key in keys:
        own = [row for row in rows if (row["predictor"], row["target"]) == key]
        values = {name: [row[name] for row in own] for name in ("base", "auc", "rank_correlation")}
        out[" ".join(key)] = {name: float(np.nanmean(value)) for name, value in values.items()}
    return out


if __name__ == "__main__":
    run(main)
