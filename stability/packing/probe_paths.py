"""A probe integrated to an amplitude: each direction followed from event to event."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Flags, Floats
from loops.errors import number
from loops.faces import Faces
from loops.graph import GrainGraph
from loops.laws.protocol import ContactLaw
from loops.packing import PlaneContacts
from stability.destabilising import no_control
from stability.packing.equations_of_motion import require_upright
from stability.packing.incremental_packing import AT_YIELD
from stability.packing.loop_rates import loop_changes
from stability.packing.pairs import Pairs, contact_pairs, require_movable, strength
from stability.packing.path import PackingPath
from stability.packing.probe import NO_SOLUTIONS, Probe
from stability.packing.regime_regions import NEUTRAL, Driven, Subspace
from stability.packing.state import PackingState, start_state
from stability.paths import follow as path_of
from stability.programmes import Programme, Stage
from stability.spectra import subspace_basis

Follow = Callable[[Sequence[Stage]], Sequence[PackingPath]]


def probe_to(
    found: Probe,
    graph: GrainGraph,
    law: ContactLaw,
    faces: Faces,
    amplitude: float,
    follow: Follow | None = None,
    planes: PlaneContacts | None = None,
    plane_force: ArrayLike | None = None,
) -> Probe:
    """The probe with each direction followed by events until what is driven has grown so much.

    Parameters
    ----------
    found : Probe
        Directions, control, subspace and elastic answers are kept.
    graph, law, faces
        The packing that was probed, under `LinearFrictional`.
    amplitude : float
        Strain, or stress under stress control.
    follow : callable, optional
        Function that follows the stages, one a direction, and returns their paths in order; by
        default `stability.follow`, one after the other.
    planes, plane_force
        Contacts with walls, as in `stability.follow`.

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
    checked = require_movable(graph, law)
    number("amplitude", amplitude, 0.0, open_low=True)
    at_start = start_state(graph, planes, plane_force)
    pairs = contact_pairs(at_start, checked, planes)
    stages = [
        stage_along(direction, found.subspace, found.control, amplitude)
        for direction in found.directions
    ]
    for stage in stages:
        require_upright(at_start, *stage.programme.equations(np.zeros(4)))
    if follow is None:
        paths: Sequence[PackingPath] = [
            path_of(graph, law, stage, closure="packing", planes=planes, plane_force=plane_force)
            for stage in stages
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
    loops = [loop_changes(start, path.states[-1], faces).additive_work for path in paths]
    basis = subspace_basis(found.subspace).T
    work = np.sum(strain * stress, axis=1)
    sizes = np.linalg.norm(strain @ basis, axis=1) * np.linalg.norm(stress @ basis, axis=1)
    normalised = work / sizes
    known, m = normalised[done], found.directions.shape[1]
    return replace(
        found,
        status=np.array([path.status for path in paths]),
        residual=np.array([path.imbalance[-1] for path in paths]),
        sliding=np.array([_sliding(path.states[-1], pairs) for path in paths]),
        disagreeing=np.array(
            [len({event.contacts for event in path.of_kind("instability")}) for path in paths]
        ),
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
        solutions=NO_SOLUTIONS,
        unstable_fraction=float(np.mean(known < -NEUTRAL)) if len(known) else float("nan"),
        destabilising=no_control("undetermined", m),
        loop_work=_of_finished(done, loops) * found.area / (found.system.volume * amplitude**2),
    )


def _of_finished(done: Flags, rows: list[Floats]) -> Floats:
    values = np.array(rows)
    values[~done] = np.nan
    return values


def _sliding(state: PackingState, pairs: Pairs) -> int:
    """Number of contacts of the start that are at yield."""
    rows = ("contacts", "images", "normal_force", "shear_force", "rolling_moment")
    first = replace(state, **{name: getattr(state, name)[: len(pairs)] for name in rows})
    slides = np.abs(first.shear_force) >= AT_YIELD * strength(pairs, first)
    return int(np.count_nonzero(first.closed & slides))


def stage_along(direction: Floats, subspace: Subspace, control: Driven, amplitude: float) -> Stage:
    """Stage that drives one direction of the subspace, with no strain outside of it."""
    basis = subspace_basis(subspace)
    m = len(basis)
    # The rest of an orthonormal basis.
    outside = np.linalg.svd(basis)[2][m:]
    driven, other = np.vstack([basis, 0.0 * outside]), np.vstack([0.0 * basis, outside])
    stress, strain = (0.0 * driven, driven + other) if control == "strain" else (driven, other)
    rate = np.append(direction, np.zeros(4 - m))
    return Stage(Programme("probe", stress, strain, rate), "parameter", amplitude)
