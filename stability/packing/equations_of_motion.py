"""A packing replayed by the equations of motion of a DEM code, from a snapshot on."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm, logm

from loops.arrays import Floats
from loops.contact_state import contact_state
from loops.errors import InputError
from loops.graph import GrainGraph
from loops.laws import ContactLaw
from stability.arguments import number
from stability.packing.pairs import Pairs, contact_pairs, require_replayable, with_near
from stability.packing.state import PackingState, start_state
from stability.programmes import Stage
from stability.subspaces import COMPONENTS

if TYPE_CHECKING:
    from loops.compiled.replay import Motion, Servo

# Pairs closer than this share of the mean diameter stand in the list.
NEAR = 0.02
# Of the smallest sqrt(m/kn), as Yade's samples were made.
TIME_STEP = 0.3
# In `sqrt(m/kn)`, of the means: what a servo lags behind. An affine strain needs no waves.
LAG = 5.0


@dataclass(frozen=True, eq=False)
class Replay:
    """Where the equations of motion have led.

    Attributes
    ----------
    state : PackingState
        The packing at the end; its first contacts are those of the start.
    velocity, spin : (G, 2), (G,) array
        Velocities beyond the affine motion, and spins, half a step before the end.
    steps, time_step
        Steps made and their length.
    duration : float
        Time that it took, in the unit of the masses.
    """

    state: PackingState
    velocity: Floats
    spin: Floats
    steps: int
    time_step: float
    duration: float


def replay(
    graph: GrainGraph,
    law: ContactLaw,
    strain: ArrayLike | Stage,
    *,
    inertial_number: float = 2e-6,
    duration: float | None = None,
    time_step: float | None = None,
    mass: ArrayLike | None = None,
    inertia: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    spin: ArrayLike | None = None,
    damping: float = 0.3,
    viscous: float = 0.0,
    balanced: bool = False,
) -> Replay:
    """Strain a periodic packing as a DEM code would: inertia, damping, explicit steps.

    Normal forces are those of the geometry, shear forces start from the stored ones.

    Parameters
    ----------
    graph : GrainGraph
        One periodic state.
    law : LinearFrictional
        Contact law.
    strain : (2, 2) array or Stage
        Displacement gradient `H` of the cell at the end, compression positive: `h = (1 - H) h0`,
        reached at a constant velocity gradient. Or a programme and its end, 'parameter' or a
        component that is driven alone: strains are prescribed, stresses held by a servo on `H'`.
    inertial_number : float
        Rate: `|H| / duration * sqrt(mean mass / pressure)`; of a programme with the elastic affine
        estimate of `H`. Slower is closer to quasi-static.
    duration : float, optional
        Time of the whole strain, in place of the inertial number.
    time_step : float, optional
        Length of a step; 0.3 of the smallest `sqrt(m/kn)` if left out.
    mass, inertia : (G,) array, optional
        Masses, those of discs of unit density if left out; moments of inertia, `2/5 m r^2` if left
        out.
    velocity, spin : (G, 2), (G,) array, optional
        Velocities beyond the affine motion, and spins, to start with; rest if left out.
    damping : float
        Cundall's: a resultant is less by this share with the motion, more against it.
    viscous : float
        Drag of every grain over its momentum, 1/time.
    balanced : bool
        Keep what is out of balance at the start as a constant load, as a path by events does.

    Returns
    -------
    Replay

    Raises
    ------
    InputError
        If the law is another, the packing is not periodic, a number has the wrong sign, or the
        programme ends by what it doesn't drive.

    Examples
    --------
    >>> import numpy as np
    >>> from loops import GrainGraph, LinearFrictional
    >>> row = GrainGraph(x=[[0, 0], [1, 0]], radii=[0.505] * 2, contacts=[[0, 1], [1, 0]],
    ...     images=[[0, 0], [1, 0]], cell=[[2, 0], [0, 3]], normal_force=[0.01] * 2)
    >>> end = replay(row, LinearFrictional(1.0, 0.5, 0.5), [[0.001, 0], [0, 0]]).state
    >>> end.normal_force.round(6).tolist()
    [0.011, 0.011]
    """
    from loops.compiled.replay import Discs, Motion, contact_forces, run

    checked = require_replayable(graph, law)
    masses, inertias = _masses(graph, mass, inertia)
    number("damping", damping, 0.0)
    number("viscous", viscous, 0.0)
    pairs, count = contact_pairs(graph, checked), graph.grain_count
    dt = time_step or TIME_STEP * math.sqrt(float((masses.min()) / pairs.kn.max()))
    lag = LAG * math.sqrt(masses.mean() / pairs.kn.mean())
    servo, H = _steered(graph, pairs, strain, lag)
    if duration is None:
        number("inertial_number", inertial_number, 0.0, open_low=True)
        pressure = _pressure(graph)
        duration = float(np.linalg.norm(H)) * math.sqrt(masses.mean() / pressure) / inertial_number
    steps = max(1, round(duration / dt))
    if servo.on:
        servo = servo._replace(rate=servo.rate / (steps * dt))
        gradient = -(servo.gain @ servo.rate).reshape(2, 2)
    else:
        gradient = (np.real(expm(logm(np.eye(2) - H) / steps)) - np.eye(2)) / dt
    zero = np.zeros((count, 2))
    motion = Motion(
        np.array(graph.x),
        np.array(zero if velocity is None else velocity, dtype=float),
        np.zeros(count),
        np.array(zero[:, 0] if spin is None else spin, dtype=float),
        np.array(graph.cell),
        np.array(graph.shear_force),
        np.zeros((count, 3)),
        np.zeros((count, 2)),
        gradient,
        np.zeros((count, 3)),
    )
    gap = NEAR * 2.0 * float(graph.radii.mean())
    radii = np.array(graph.radii)
    by_radii, done, singles = checked.shear_increment == "radii", 0, 0
    while done < steps:
        pairs = with_near(pairs, motion.x, motion.cell, graph.radii, gap)
        fresh = np.zeros(len(pairs) - len(motion.shear))
        motion = motion._replace(shear=np.append(motion.shear, fresh))
        grains, images = pairs.grains.astype(np.uint32), pairs.images.astype(float)
        wraps = np.asarray(images.any(axis=1))
        discs = Discs(radii, 1.0 / masses, 1.0 / inertias, grains, images, wraps, *pairs[2:])
        if done == 0:
            moment = contact_forces(motion, discs, 0.0, by_radii, servo.on)
            if balanced:
                motion.load[:] = -motion.resultant
                motion.resultant[:] = 0.0
            servo.start[:] = np.array(moment) / abs(np.linalg.det(motion.cell))
        made = run(motion, discs, servo, steps - done, dt, damping, viscous, by_radii, gap)
        singles = singles + 1 if made == 1 else 0
        if singles > 100:
            found = f"grains that move {gap:.2g} in one of {steps} steps"
            raise InputError("replay", found, "a stable motion", "Take shorter steps.")
        done += made
    state = _state(graph, pairs, motion)
    return Replay(state, motion.velocity, motion.spin, steps, dt, steps * dt)


def _steered(
    graph: GrainGraph, pairs: Pairs, strain: ArrayLike | Stage, lag: float
) -> tuple[Servo, Floats]:
    """A servo whose rates are per whole way, off for a strain, and the strain of the way."""
    from loops.compiled.replay import Servo

    assert graph.cell is not None
    back = np.ascontiguousarray(np.linalg.inv(graph.cell))
    none, nothing = np.zeros((4, 4)), np.zeros(4)
    own = (np.zeros(count) for count in (4, 4, 4, 1))
    servo = Servo(False, back, none, none, nothing, none, lag, -1, *own)
    if isinstance(strain, Stage):
        programme, span = strain.programme, _span(strain)
        stress, rows, rate = (np.array(part) for part in programme.equations(nothing))
        matrix = stress @ _affine_stiffness(graph, pairs) + rows
        if not np.linalg.cond(matrix) < 1e16:
            remedy = "Hold strains, or start from a packing that carries."
            raise InputError("packing", "no stiffness", "one that a servo can load", remedy)
        gain, row = np.array(np.linalg.inv(matrix), dtype=float), programme.isochoric_row
        servo = servo._replace(on=True, stress=stress, strain=rows, rate=rate * span, gain=gain)
        servo = servo._replace(isochoric=-1 if row is None else row)
        return servo, span * (gain @ rate).reshape(2, 2)
    H = np.asarray(strain, dtype=float)
    if H.shape != (2, 2) or not np.isfinite(H).all() or not np.linalg.det(np.eye(2) - H) > 0:
        raise InputError(
            "strain", f"{H.tolist()}", "(2, 2) finite numbers that leave a cell", "Take less."
        )
    return servo, H


def _span(stage: Stage) -> float:
    """Loading parameter at the end of a stage."""
    rate = 1.0
    if stage.quantity != "parameter":
        p, column = stage.programme, COMPONENTS.index(stage.quantity[1:])
        controls = np.hstack([p.strain, p.stress])
        alone = (controls != 0).sum(axis=1) == 1
        driven = np.flatnonzero(alone & (controls[:, column] != 0) & (p.rate != 0))
        if not len(driven) or stage.quantity[0] == "P":
            received, expected = f"{stage.quantity} at the end", "'parameter', or a driven strain"
            raise InputError("stage", received, expected, "End it by the parameter.")
        rate = float(p.rate[driven[0]] / controls[driven[0], column])
    if not stage.target / rate > 0:
        remedy = "Turn the sign of the target or of the rate."
        raise InputError("stage", f"target {stage.target:g}", "a target that lies ahead", remedy)
    return stage.target / rate


def _affine_stiffness(graph: GrainGraph, pairs: Pairs) -> Floats:
    """`P' = C H'` (4, 4) if all grains went with the cell and none turned: too stiff."""
    state = contact_state(graph)
    d, frames = state.length[:, None] * state.n, (state.n, state.t)
    K = sum(
        k[:, None, None] * a[:, :, None] * a[:, None, :]
        for k, a in zip((pairs.kn, pairs.kt), frames, strict=True)
    )
    assert graph.cell is not None
    C = np.einsum("kac,kb,kd->abcd", K, d, d) / abs(np.linalg.det(graph.cell))
    return np.asarray(C.reshape(4, 4))


def _masses(
    graph: GrainGraph, mass: ArrayLike | None, inertia: ArrayLike | None
) -> tuple[Floats, Floats]:
    masses = np.pi * graph.radii**2 if mass is None else np.asarray(mass, dtype=float)
    inertias = 0.4 * masses * graph.radii**2 if inertia is None else np.asarray(inertia, float)
    for name, values in (("mass", masses), ("inertia", inertias)):
        if values.shape != graph.radii.shape or not (values > 0).all():
            raise InputError(name, f"shape {values.shape}", "a positive number a grain", ".")
    return np.ascontiguousarray(masses), np.ascontiguousarray(inertias)


def _pressure(graph: GrainGraph) -> float:
    pressure = 0.5 * float(np.trace(start_state(graph).stress))
    if not pressure > 0:
        raise InputError("pressure", f"{pressure:g}", "forces", "Give the duration of the strain.")
    return pressure


def _state(graph: GrainGraph, pairs: Pairs, motion: Motion) -> PackingState:
    state = PackingState(
        radii=graph.radii,
        x=motion.x,
        angle=motion.angle,
        cell=motion.cell,
        contacts=pairs.grains,
        images=pairs.images,
        normal_force=np.zeros(len(pairs)),
        shear_force=motion.shear,
    )
    i, j = pairs.grains.T
    overlap = graph.radii[i] + graph.radii[j] - np.linalg.norm(state.branches, axis=1)
    return replace(state, normal_force=np.maximum(pairs.kn * overlap, 0.0))
