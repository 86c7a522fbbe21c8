"""From the files of a snapshot to its response envelope, cones and the loops behind them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from loops import GrainGraph, InputError
from loops.laws import ContactLaw
from patterns import Snapshot
from stability import COMPONENTS, Stage, follow
from stability.arguments import number
from stability.packing import PackingPath, Probe
from stability.packing.pieces import Driven, Subspace
from stability.packing.probe import probe_edge
from stability.packing.probe_paths import probe_to
from studies.columns import definitions
from studies.output import provenance, readable, result_folder, write_results
from studies.series.tasks import one_blas_thread
from studies.series.workers import open_runner
from studies.snapshot.edge import balance_notes, sample_edge
from studies.snapshot.source import read_planar, reading

Columns = dict[str, NDArray[Any]]

UNITS = (
    "as the input's: stress = force/length (two dimensions); P', H' and W2 are rates per unit of "
    "the direction; angles in degrees"
)
OUTLINE = (
    "no walls and no cell are known: the outline's grains follow the strain, which stiffens the "
    "sample"
)


def run_probe(
    path: Path,
    out: Path,
    *,
    directions: int = 72,
    control: Driven = "strain",
    subspace: Subspace = "diagonal",
    yield_band: float = 0.99,
    amplitude: float | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    force: bool = False,
    csv: bool = False,
    figures: bool = True,
    **how: Any,
) -> dict[str, Any]:
    """Probe a snapshot, write tables, figures and a report; the summary.

    It is read with the options `how` of `read_planar`. Directions that are followed to an amplitude
    are shared by so many processes, one a core if left out, or by the workers of a Dask scheduler.
    """
    if amplitude is not None:
        number("amplitude", amplitude, 0.0, open_low=True)
    elif workers is not None or scheduler is not None:
        which, remedy = "--workers, --scheduler", "Give --amplitude, or leave them out."
        raise InputError(which, "rates alone", "directions to follow", remedy)
    asked: dict[str, Any] = {
        "directions": directions,
        "control": control,
        "subspace": subspace,
        "yield_band": yield_band,
        "amplitude": amplitude,
    }
    with result_folder(out, force=force) as folder:
        snapshot = read_planar(path, **how)
        notes: list[str] = []
        edge = sample_edge(snapshot, snapshot.faces, yield_band)
        found = probe_edge(edge, directions, control, subspace, snapshot.faces)
        if amplitude is not None:
            shared = partial(_followed, snapshot, workers, scheduler)
            law, notes = snapshot.mechanics()[0], balance_notes(snapshot)
            found = probe_to(found, snapshot.graph, law, snapshot.faces, amplitude, shared)
        made = provenance("probe", {"path": path, **reading(**how), **asked}, UNITS)
        summary = probe_summary(snapshot, found) | asked | {"provenance": made}
        summary["notes"] += notes
        tables = {
            "probe": direction_table(found),
            **({"pieces": piece_table(found)} if amplitude is None else {}),
            "orders": order_table(found),
            "loops": loop_table(found),
        }
        write_results(folder, summary, tables, csv=csv)
        if figures:
            _draw(snapshot, found, tables["loops"], summary, folder)
    return summary


@dataclass(frozen=True, eq=False)
class _Direction:
    """What a worker needs to follow one direction."""

    number: int
    graph: GrainGraph
    law: ContactLaw
    stage: Stage

    @property
    def name(self) -> str:
        return f"direction {self.number}"


def _follow(one: _Direction) -> tuple[int, PackingPath]:
    with one_blas_thread():
        return one.number, follow(one.graph, one.law, one.stage, closure="packing")


def _followed(
    snapshot: Snapshot, workers: int | None, scheduler: str | None, stages: Sequence[Stage]
) -> list[PackingPath]:
    """Paths of all directions, whoever follows which: the same numbers."""
    graph, (law, _) = snapshot.graph, snapshot.mechanics()
    tasks = [_Direction(k, graph, law, stage) for k, stage in enumerate(stages)]
    with open_runner(workers, scheduler, []) as runner:
        found = dict(runner(_follow, tasks))
    return [found[k] for k in range(len(stages))]


def direction_table(found: Probe) -> Columns:
    """One row a direction."""
    columns: Columns = {"theta_deg": np.degrees(found.theta)}
    for name, values in (
        ("H", found.strain_rate),
        ("P", found.stress_rate),
        ("elastic_H", found.elastic_strain),
        ("elastic_P", found.elastic_stress),
    ):
        parts = values.reshape(-1, 4).T
        columns |= {f"{name}{ij}": part for ij, part in zip(COMPONENTS, parts, strict=True)}
    return columns | {
        "W2": found.work,
        "w2": found.normalised,
        "status": found.status,
        "sliding": found.sliding,
        "disagreeing": found.disagreeing,
        "residual": found.residual,
        "piece": found.piece,
    }


def piece_table(found: Probe) -> Columns:
    """One row a piece: where it holds, how many directions met it, its tangent."""
    m = found.directions.shape[1]
    count = np.bincount(found.piece[found.determined], minlength=len(found.tangents))
    tangents = found.tangents.reshape(-1, m * m).T
    names = [f"K{i + 1}{j + 1}" for i in range(m) for j in range(m)]
    return {
        "piece": np.arange(len(found.tangents)),
        "begin_deg": np.degrees(found.arcs[:, 0]),
        "end_deg": np.degrees(found.arcs[:, 1]),
        "directions": count,
        **dict(zip(names, tangents, strict=True)),
    }


def order_table(found: Probe) -> Columns:
    """One row a direction and order: what the loops add to the sample's W2, and its negative part.

    Order 0 stands for the contacts that are in no loop, or in one alone.
    """
    orders, at = np.unique(found.order, return_inverse=True)
    member = at == np.arange(len(orders))[:, None]
    work = found.loop_work @ member.T
    negative = np.minimum(found.loop_work, 0.0) @ member.T
    rest = (found.work - work.sum(axis=1))[:, None]
    work, negative = np.hstack([rest, work]), np.hstack([0.0 * rest, negative])
    shape = work.shape
    with np.errstate(invalid="ignore", divide="ignore"):
        shares = work / found.work[:, None], negative / negative.sum(axis=1, keepdims=True) + 0.0
    area = np.bincount(at, found.area, minlength=len(orders)) / found.area.sum()
    columns = {
        "theta_deg": np.degrees(found.theta)[:, None],
        "order": np.append(0, orders),
        "loops": np.append(0, member.sum(axis=1)),
        "area_share": np.append(0.0, area),
        "W2": work,
        "W2_share": shares[0],
        "negative": negative,
        "negative_share": shares[1],
    }
    return {name: np.broadcast_to(value, shape).ravel() for name, value in columns.items()}


def loop_table(found: Probe) -> Columns:
    """One row a loop: what it adds in the softest direction, and per area of its own."""
    softest = found.softest
    work = np.full(len(found.order), np.nan) if softest is None else found.loop_work[softest]
    return {
        "loop": np.arange(len(found.order)),
        "order": found.order,
        "area": found.area,
        "W2": work,
        "additive_w": work * found.system.volume / found.area,
    }


def probe_summary(snapshot: Snapshot, found: Probe) -> dict[str, Any]:
    """The numbers that a probe comes down to."""
    law, _ = snapshot.mechanics()
    statuses, counts = np.unique(found.status, return_counts=True)
    softest, control = found.softest, found.destabilising
    carrying = found.system.carrying
    theta = np.degrees(found.theta)
    return {
        "boundary": found.system.boundary,
        "candidates": found.candidates,
        "clusters": carrying.clusters,
        "cones": [
            {"begin_deg": begin, "end_deg": end, "refined": sure.tolist()}
            for (begin, end), sure in zip(np.degrees(found.cones), found.refined, strict=True)
        ],
        "definitions": definitions("probe"),
        "destabilising": {
            "status": control.status,
            "direction": control.direction,
            "held": control.held,
            "work": control.work,
            "reaction": control.reaction,
        },
        "elastic_tangent": found.elastic_tangent,
        "loops": len(found.order),
        "mean_kn": float(np.mean(law.kn)),
        "notes": [*snapshot.notes, *([OUTLINE] if found.system.held else [])],
        "orders": {} if softest is None else _softest_orders(found, softest),
        "pieces": len(found.tangents),
        "pieces_cover": _cover(found),
        "rattlers": carrying.rattlers,
        "settled": found.settled,
        "smallest_w2": None if softest is None else float(found.normalised[softest]),
        "softest_theta_deg": None if softest is None else float(theta[softest]),
        "statuses": dict(zip(statuses.tolist(), counts.tolist(), strict=True)),
        "undetermined": int(np.count_nonzero(~found.determined)),
        "unstable_fraction": found.unstable_fraction,
    }


def _softest_orders(found: Probe, softest: int) -> dict[str, dict[str, float]]:
    table = order_table(found)
    rows = np.arange(len(table["order"])).reshape(len(found.work), -1)[softest]
    names = ("loops", "area_share", "W2_share", "negative_share")
    return {
        str(table["order"][row]): {name: table[name][row].item() for name in names} for row in rows
    }


def _cover(found: Probe) -> float | None:
    """Share of the circle on the arcs of the pieces; they overlap only where solutions do."""
    if found.directions.shape[1] != 2 or not len(found.arcs):
        return None
    return float(min(np.ptp(found.arcs, axis=1).sum() / (2.0 * np.pi), 1.0))


def _draw(
    snapshot: Snapshot,
    found: Probe,
    loops: Columns,
    summary: dict[str, Any],
    folder: Path,
) -> None:
    # Drawing is loaded only when there is something to draw.
    from studies.probe.figures import probe_drawings
    from studies.snapshot.report import loops_for_map, write_report
    from studies.style import save_drawings

    made = summary["provenance"]
    drawings = probe_drawings(snapshot, found, loops, summary)
    title = f"Probes of {readable(made['configuration']['path'].name)}"
    shown = loops_for_map(snapshot, snapshot.faces, loops)
    write_report(folder, title, summary, save_drawings(drawings, folder, made), shown, made)
