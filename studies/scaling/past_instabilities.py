"""Ways past an instability of a packing's path, against slow replays that keep the start's load.

`python -m studies.scaling.past_instabilities --out DIR --collection DEM`: steps of 1e-4 and of 2e-5
of Yade's slow compression (`yade-slow`), and probes along the softest direction. Times are the
processor's.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
import typer

from loops import LinearFrictional, find_faces
from loops.arrays import Floats
from patterns import Snapshot
from stability.packing import loop_changes, replay
from studies.examples.probing import state
from studies.output import provenance, result_folder, write_table
from studies.scaling.packing_paths import (
    UNITS,
    _auc,
    _slow,
    _spent,
    _strain,
    followed,
    one_spring,
    strained,
)
from studies.series.plan import cells_by_number

# Snapshots before the steps of 1e-4 and of 2e-5; degrees of the direction; inertial number.
STEPS, SOFTEST, SLOW = (*range(22, 30), 12, 18, 20), 150.0, 2.5e-7


def by_way(collection: Path) -> Iterator[dict[str, Any]]:
    """Ways past instabilities, against replays at 2.5e-7 that keep the load of the start."""
    cells = cells_by_number(collection / "yade-slow/macro.csv")
    for number in STEPS:
        one, two = (_slow(collection, cells, k) for k in (number, number + 1))
        yield from _ways(str(number), one, two, one.mechanics()[0], _strain(one, two))
    for name in ("before", "after"):
        held = state(name)[0]
        angle = np.radians(SOFTEST)
        yield from _ways(
            f"probe {name} the peak",
            held,
            None,
            one_spring(held),
            5e-5 * np.diag([np.cos(angle), np.sin(angle)]),
        )


def _ways(
    name: str, one: Snapshot, two: Snapshot | None, law: LinearFrictional, H: Floats
) -> Iterator[dict[str, Any]]:
    graph, faces = one.graph, find_faces(one.graph)
    slow, spent = _spent(replay, graph, law, H, inertial_number=SLOW, balanced=True)
    told = loop_changes(graph, slow.state, faces).normalised_work
    row = {"start": name, "strain": float(np.linalg.norm(H)), "replay_seconds": spent}
    row["replay_auc"] = _auc(one, two, told)
    for past in ("viscous", "dynamic"):
        path, spent = _spent(followed, graph, law, strained(H), instabilities=1000, past=past)
        first, last, wanted = (
            end.forces[: graph.contact_count] for end in (*path.states, slow.state)
        )
        work = loop_changes(graph, path.states[-1], faces).normalised_work
        known = np.isfinite(work) & np.isfinite(told)
        unstable = path.of_kind("instability")
        yield row | {
            "past": past,
            "status": path.status,
            "from_replay": np.linalg.norm(last - wanted) / np.linalg.norm(wanted - first),
            "signs_of_replay": float(np.mean((work < 0)[known] == (told < 0)[known])),
            "auc": _auc(one, two, work),
            "instabilities": len(unstable),
            "unstable": len({event.contacts for event in unstable}),
            "released": path.work[-1, 3] / path.work[-1, 0],
            "events": len(path.events),
            "cpu_seconds": spent,
        }


def main(
    out: Annotated[Path, typer.Option(help="Result folder.")],
    collection: Annotated[Path, typer.Option(help="The DEM samples.")] = Path("dem"),
    force: Annotated[bool, typer.Option("--force", help="Replace results.")] = False,
) -> None:
    """Measure; write the table."""
    with result_folder(out, force=force) as folder:
        rows = []
        for row in by_way(collection):
            typer.echo(row)
            rows.append(row)
        made = provenance("past-instabilities study", {}, UNITS)
        table = pd.DataFrame(rows)
        columns = {name: table[name].to_numpy() for name in table}
        write_table(folder, "past", columns, made, csv=True)


if __name__ == "__main__":
    typer.run(main)
