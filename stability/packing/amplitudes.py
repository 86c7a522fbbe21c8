"""A probe over an amplitude: each direction followed by events, or in one solve."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from loops import Faces
from loops.arrays import Flags, Floats
from loops.contacts import contacts_at_start
from loops.errors import number
from loops.scene import Scene
from stability.destabilising import no_control
from stability.packing.equations_of_motion import require_upright
from stability.packing.increment import PackingIncrements
from stability.packing.loop_quantities import loop_changes
from stability.packing.path import PackingPathOptions, follow_packing
from stability.packing.probe import TOLD, Probe, Solutions, additive_work
from stability.packing.regime_regions import NEUTRAL, Driven, Subspace
from stability.packing.yielding import YieldResponse, direction_control
from stability.path import Path
from stability.programmes import NOTHING, Programme, Stage
from stability.spectra import subspace_basis

# Function that follows stages and returns their paths in order.
FollowStages = Callable[[Sequence[Stage]], Sequence[Path]]


def probe_to(
    found: Probe, scene: Scene, amplitude: float, follow: FollowStages | None = None
) -> Probe:
    """Follow each direction of the probe by events until what is driven has grown so much.

    Parameters
    ----------
    found : Probe
        Directions, control, subspace and elastic answers are kept.
    scene : Scene
        The packing that was probed.
    amplitude : float
        Strain, or stress under stress control.
    follow : callable, optional
        Function that follows the stages, one a direction, and returns their paths in order; by
        default `stability.follow`, one after the other.

    Returns
    -------
    Probe
        `H'`, `P'` and works are increments over the amplitude (works over its square), `status` is
        that of the path and only what is 'finished' is determined; `sliding` counts contacts of the
        start that slide at the end, `disagreeing` the unstable ones, `residual` is the imbalance.
        There are no pieces, folds, lists of solutions, cones or destabilising control.

    Raises
    ------
    InputError
        If the amplitude isn't positive, or where `follow` refuses.
    """
    graph, at_start = scene.graph, contacts_at_start(scene)
    number("amplitude", amplitude, 0.0, open_low=True)
    stages = [
        stage_along(direction, found.subspace, found.control, amplitude)
        for direction in found.directions
    ]
    for stage in stages:
        require_upright(at_start, *stage.programme.equations(NOTHING, NOTHING))
    if follow is None:
        paths: Sequence[Path] = [
            follow_packing(scene, [stage], PackingPathOptions()) for stage in stages
        ]
    else:
        paths = follow(stages)
    done = np.array([path.status == "finished" for path in paths])
    strain, stress = (
        _of_finished(done, [(values[-1] - values[0]) / amplitude for values in parts])
        for parts in ([path.H for path in paths], [path.P for path in paths])
    )
    # Forces at the start of a path are those of the geometry.
    first, count = paths[0].states[0], graph.contact_count
    start = graph.replace(
        normal_force=first.normal_force[:count], shear_force=first.shear_force[:count]
    )
    loops = [loop_changes(start, path.states[-1], scene.faces).additive_work for path in paths]
    slides = [path.state.at_limit()[: len(at_start.contacts)] for path in paths]
    return _over_amplitude(
        found,
        done,
        strain,
        stress,
        status=np.array([path.status for path in paths]),
        residual=np.array([path.imbalance[-1] for path in paths]),
        sliding=np.count_nonzero(slides, axis=1),
        disagreeing=np.array(
            [len({event.contacts for event in path.of_kind("instability")}) for path in paths]
        ),
        loop_work=_of_finished(done, loops) * found.area / (found.system.volume * amplitude**2),
    )


def probe_by_increment(
    found: Probe, yielding: YieldResponse, faces: Faces, amplitude: float
) -> Probe:
    """Answer each direction of the probe over an amplitude in one solve.

    Parameters
    ----------
    found : Probe
        Directions, control, subspace and elastic answers are kept.
    yielding : YieldResponse
        The packing with its candidates for sliding, as `packing_increment` has them.
    faces : Faces
        Faces of the packing.
    amplitude : float
        Strain, or stress under stress control.

    Returns
    -------
    Probe
        As `probe_to`, with the status of each increment; `sliding` counts contacts that have slid,
        `disagreeing` those that are kept from sliding.

    Raises
    ------
    InputError
        If the amplitude isn't positive.
    """
    number("amplitude", amplitude, 0.0, open_low=True)
    increments = PackingIncrements(yielding)
    answers = [
        increments.solved(direction_control(one, found.subspace, found.control))
        for one in amplitude * found.directions
    ]
    done = np.array([answer.status != "not converged" for answer in answers])
    strain, stress = (
        _of_finished(done, [getattr(answer, name).ravel() / amplitude for answer in answers])
        for name in ("strain_rate", "stress_rate")
    )
    loops = [additive_work(answer, faces) / amplitude**2 for answer in answers]
    return _over_amplitude(
        found,
        done,
        strain,
        stress,
        **{name: np.array([getattr(answer, name) for answer in answers]) for name in TOLD},
        loop_work=_of_finished(done, loops),
        candidates=len(increments.yielding.rows),
        settled=increments.yielding.settled,
    )


def _over_amplitude(
    found: Probe, done: Flags, strain: Floats, stress: Floats, **rest: Any
) -> Probe:
    """Return the probe with increments (D, 4) over the amplitude, and nothing of the rates."""
    basis = subspace_basis(found.subspace).T
    work = np.sum(strain * stress, axis=1)
    sizes = np.linalg.norm(strain @ basis, axis=1) * np.linalg.norm(stress @ basis, axis=1)
    normalised = work / sizes
    known, m = normalised[done], found.directions.shape[1]
    none: list[Any] = [part[:0] for part in found.solutions]
    return replace(
        found,
        strain_rate=strain.reshape(-1, 2, 2),
        stress_rate=stress.reshape(-1, 2, 2),
        work=work,
        normalised=normalised,
        piece=np.where(done, 0, -1),
        tangents=np.empty((0, m, m)),
        arcs=np.empty((0, 2)),
        cones=np.empty((0, 2)),
        refined=np.empty((0, 2), dtype=bool),
        folds=np.empty(0),
        solutions=Solutions(*none),
        unstable_fraction=float(np.mean(known < -NEUTRAL)) if len(known) else float("nan"),
        destabilising=no_control("undetermined", m),
        **rest,
    )


def _of_finished(done: Flags, rows: list[Floats]) -> Floats:
    values = np.array(rows)
    values[~done] = np.nan
    return values


def stage_along(direction: Floats, subspace: Subspace, driven: Driven, amplitude: float) -> Stage:
    """Return the stage that drives one direction of the subspace, with no strain outside of it."""
    control = direction_control(direction, subspace, driven)
    return Stage(Programme("probe", *control), "parameter", amplitude)
