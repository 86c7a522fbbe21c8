"""The study behind `grainloops probe`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from loops import InputError
from loops.errors import check_choice, counted, number, whole_number
from loops.scene import Scene, Subject
from stability import Path as FollowedPath
from stability import Stage, follow
from stability.packing import Probe
from stability.packing import probe as probe_packing
from stability.packing.hold import HoldControl
from stability.packing.probe import probe_by_increment, probe_to, search_step
from stability.packing.regime_regions import NEUTRAL, Driven, Subspace
from stability.path import Past
from studies.frames import loop_work_table, order_work_table, work_shares
from studies.output import Columns, Summary, components, readable, values_of
from studies.questions import Holding, Probing, taken
from studies.reading import read_planar, reading
from studies.series.workers import do_all, open_runner
from studies.snapshot.in_packing import (
    balance_notes,
    held_snapshot,
    sample_edge,
    scene_at_rest,
)
from studies.study import files_of, study

# Way to an amplitude.
By = Literal["events", "increment"]
# What is told of the control that destabilises.
CONTROL = ("status", "direction", "held", "work", "reaction")
OUTLINE = (
    "walls and cell are unknown: the outline's grains follow the strain, which stiffens the sample"
)


def run_probe(
    path: Path,
    out: Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[int], None] | None = None,
    **how: Any,
) -> Summary:
    """Probe a snapshot, write tables, figures and a report; return the summary.

    `how` are the options of `Probing`, `Holding` and `read_planar`, and files of `study`.
    `progress` is called with how many directions are done.
    """
    # The words are checked here, each with what is expected.
    asked: Any = taken(Probing, how)
    amplitude, by = asked.amplitude, asked.by
    check_choice("--by", by, get_args(By))
    if amplitude is not None:
        number("amplitude", amplitude, 0.0, open_low=True)
    elif by == "increment":
        remedy = "Give --amplitude, or leave --by out."
        raise InputError("--by", "increment of the rates alone", "an amplitude", remedy)
    if scheduler is not None and (amplitude is None or by == "increment"):
        received = "rates alone" if amplitude is None else "one solve a direction"
        remedy = "Give --amplitude, or leave it out."
        raise InputError("--scheduler", received, "directions to follow", remedy)
    whole_number("--workers", 1 if workers is None else workers, 1)
    check_choice("--past", asked.past, get_args(Past))
    told = asdict(asked) | {"by": by if amplitude is not None else None}
    share = told.pop("candidates")
    told["candidates_from"] = share if by == "increment" else None
    control, files = taken(Holding, how).control, files_of(how)
    configuration = {"path": path, **reading(**how), **told, "hold": control}
    with study("probe", out, configuration, **files) as results:
        snapshot, held = held_snapshot(read_planar(path, **how), control)
        faces, notes = snapshot.faces, list(snapshot.notes)
        edge = sample_edge(snapshot, asked.yield_band)
        way = {"control": asked.control, "subspace": asked.subspace, "progress": progress}
        found = probe_packing(edge, asked.directions, faces=faces, **way)
        paths, reached = list[FollowedPath](), list[float]()
        if amplitude is not None and by == "increment":
            number("candidates", share, 0.0, 1.0, open_low=True)
            wide = sample_edge(snapshot, share)
            found = probe_by_increment(found, wide, faces, amplitude)
        elif amplitude is not None:
            notes += balance_notes(snapshot)

            def shared(stages: Sequence[Stage]) -> Sequence[FollowedPath]:
                one = partial(_follow, snapshot.scene, asked.past)
                with open_runner(workers, scheduler, []) as runner:
                    paths[:], reached[:] = zip(*do_all(runner, one, stages), strict=True)
                return paths

            found = probe_to(found, snapshot.scene, amplitude, shared)
        if found.system.held:
            notes.append(OUTLINE)
        step = search_step(found.candidates, len(found.directions))
        if step > 1 and asked.subspace == "diagonal":
            notes.append(
                f"{counted(found.candidates, 'contact')} at yield: solutions were searched in one "
                f"of {step} directions, the others were read from the branches of those"
            )
        softest, theta_deg = found.softest, np.degrees(found.theta)
        orders = order_work_table(theta_deg, found.loop_work, found.order, found.area, found.work)
        unknown = np.full(len(found.order), np.nan)
        work = unknown if softest is None else found.loop_work[softest]
        loops = loop_work_table(found.order, found.area, work, found.system.volume)
        tables = {"probe": probe_table(found), "orders": orders, "loops": loops}
        if amplitude is None:
            tables |= {"pieces": piece_table(found), "solutions": solution_table(found)}
        elif by == "events":
            tables["paths"] = direction_paths(found, paths)
        told |= probe_summary(found, orders) | {"held": held, "notes": notes}
        told["ended"] = [
            {"direction": k, "reached": far, "status": path.status, "message": path.message}
            for k, (path, far) in enumerate(zip(paths, reached, strict=True))
            if path.status != "finished"
        ]
        title = f"Probes of {readable(path.name)}"
        return results.write_packing(title, snapshot, found, tables, told)


def probe(
    scene: Subject,
    directions: ArrayLike = 72,
    *,
    control: Driven = "strain",
    subspace: Subspace = "diagonal",
    yield_band: float = 0.99,
    hold: HoldControl | None = None,
) -> Probe:
    """Probe a packing: its response in many directions, from this one state.

    The sample ends at its periodic cell or at its walls, which are planes that move with the
    strain; without either the grains of the outline follow the strain. Theory, section 11.

    Parameters
    ----------
    scene : Scene or Snapshot
        The packing, with forces.
    directions : int or (D, m) array_like
        How many, evenly spread; or the directions themselves (m = 2, or 3 with shear).
    control : {'strain', 'stress'}
        Whether the directions are those of `H'` or of `P'`, compression positive.
    subspace : {'diagonal', 'symmetric'}
        Components (11, 22), or (11, 22, (12 + 21)/sqrt 2).
    yield_band : float
        Contacts with `|T| >= yield_band mu N` may slide, 0 to 1.
    hold : {'strain', 'stress'}, optional
        Bring the sample to rest first, at a fixed cell (between walls that stand still) or at
        fixed stress.

    Returns
    -------
    Probe
        Rates, second-order work and status of every direction; see `stability.packing.Probe`.

    Raises
    ------
    InputError
        If a snapshot has no forces, an option is unknown, or the sample does not come to rest.

    Examples
    --------
    >>> import grainloops as gl
    >>> snapshot = gl.read_snapshot(gl.sample_path())
    >>> found = gl.probe(snapshot, 8, hold="strain")
    >>> int(found.determined.sum())
    8
    """
    at_rest = scene_at_rest(scene, hold)
    how: dict[str, Any] = {"control": control, "subspace": subspace, "yield_band": yield_band}
    return probe_packing(at_rest, directions, **how)


def _follow(scene: Scene, past: Past, stage: Stage) -> tuple[FollowedPath, float]:
    """The path of a direction, and what it has reached: its last row may lie before."""
    reached = [0.0]
    path = follow(
        scene, stage, closure="packing", past=past,
        progress=lambda done: reached.__setitem__(0, done),
    )  # fmt: skip
    return path, max(reached[0], float(path.parameter[-1]))


def probe_table(found: Probe) -> Columns:
    """One row per direction: strain and stress rates, second-order work, status."""
    names = ("status", "proof", "sliding", "disagreeing", "residual", "piece")
    return {
        "theta_deg": np.degrees(found.theta),
        **components("H", found.strain_rate),
        **components("P", found.stress_rate),
        **components("elastic_H", found.elastic_strain),
        **components("elastic_P", found.elastic_stress),
        "W2": found.work,
        "w2": found.normalised,
        **values_of(found, *names),
        "fold_before_deg": np.degrees(found.between_folds[:, 0]),
        "fold_after_deg": np.degrees(found.between_folds[:, 1]),
    }


def direction_paths(found: Probe, paths: Sequence[FollowedPath]) -> pd.DataFrame:
    """Every recorded row of the directions' paths, those that ended on the way too."""
    angles = np.degrees(found.theta).tolist()
    parts = [
        pd.DataFrame({
            **{"direction": k, "theta_deg": angle, "row": np.arange(len(path))},
            **{"driven": path.parameter, **components("H", path.H), **components("P", path.P)},
            **values_of(path, "status", "message"),
        })
        for k, (angle, path) in enumerate(zip(angles, paths, strict=True))
    ]  # fmt: skip
    return pd.concat(parts, ignore_index=True)


def solution_table(found: Probe) -> Columns:
    """One row per solution that is known: its direction, rates, second-order work."""
    listed = found.solutions
    return {
        "direction": listed.direction,
        "theta_deg": np.degrees(found.theta)[listed.direction],
        **components("H", listed.strain_rate),
        **components("P", listed.stress_rate),
        "W2": listed.work,
        "w2": listed.normalised,
        "sliding": listed.sliding,
    }


def piece_table(found: Probe) -> Columns:
    """One row per piece: the arc where it holds, the number of its directions, its tangent."""
    m, determined = found.directions.shape[1], found.piece[found.determined]
    names = [f"K{i + 1}{j + 1}" for i in range(m) for j in range(m)]
    return {
        "piece": np.arange(len(found.tangents)),
        "begin_deg": np.degrees(found.arcs[:, 0]),
        "end_deg": np.degrees(found.arcs[:, 1]),
        "directions": np.bincount(determined, minlength=len(found.tangents)),
        **dict(zip(names, found.tangents.reshape(-1, m * m).T, strict=True)),
    }


def probe_summary(found: Probe, orders: pd.DataFrame) -> Summary:
    """Summary of a probe and its table of orders."""
    statuses, counts = np.unique(found.status, return_counts=True)
    softest, theta, shares, cover = found.softest, np.degrees(found.theta), {}, None
    listed = found.solutions
    least = int(np.argmin(listed.normalised)) if len(listed.normalised) else None
    unstable = listed.direction[listed.normalised < -NEUTRAL]
    if softest is not None:
        # Every direction has the same number of rows.
        per_direction = len(orders) // len(theta)
        shares = work_shares(orders[softest * per_direction :][:per_direction])
    if found.directions.shape[1] == 2 and len(found.arcs):
        # Arcs overlap only where a direction has several solutions.
        cover = float(min(np.ptp(found.arcs, axis=1).sum() / (2.0 * np.pi), 1.0))
    return {
        **values_of(found, "candidates", "elastic_tangent", "settled", "unstable_fraction"),
        **values_of(found.system.carrying, "clusters", "rattlers"),
        "boundary": found.system.boundary,
        "cones": [
            {"begin_deg": begin, "end_deg": end, "refined": sure.tolist()}
            for (begin, end), sure in zip(np.degrees(found.cones), found.refined, strict=True)
        ],
        "destabilising": values_of(found.destabilising, *CONTROL),
        "folds_deg": np.degrees(found.folds),
        "loops": len(found.order),
        "orders": shares,
        "pieces": len(found.tangents),
        "pieces_cover": cover,
        "smallest_w2": None if softest is None else float(found.normalised[softest]),
        "softest_theta_deg": None if softest is None else float(theta[softest]),
        "solutions": len(listed.direction),
        "solutions_smallest_w2": None if least is None else float(listed.normalised[least]),
        "solutions_softest_theta_deg": (
            None if least is None else float(theta[listed.direction[least]])
        ),
        "solutions_unstable_directions": len(np.unique(unstable)),
        "statuses": dict(zip(statuses.tolist(), counts.tolist(), strict=True)),
        "undetermined": int(np.count_nonzero(~found.determined)),
    }
