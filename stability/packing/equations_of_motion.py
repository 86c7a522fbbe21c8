"""A packing replayed by the equations of motion of a DEM code, from a snapshot on."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm, logm

from loops.arrays import Floats
from loops.errors import InputError
from loops.graph import GrainGraph
from loops.laws import ContactLaw
from stability.arguments import number
from stability.packing.pairs import Pairs, contact_pairs, require_replayable, with_near
from stability.packing.state import PackingState, start_state

if TYPE_CHECKING:
    from loops.compiled.replay import Motion

# Pairs closer than this share of the mean diameter stand in the list.
NEAR = 0.02
# Of the smallest sqrt(m/kn), as Yade's samples were made.
TIME_STEP = 0.3


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
    unbalanced : float
        Mean resultant on a grain over the mean contact force, as Yade tells it; nan without forces.
    """

    state: PackingState
    velocity: Floats
    spin: Floats
    steps: int
    time_step: float
    unbalanced: float


def replay(
    graph: GrainGraph,
    law: ContactLaw,
    strain: ArrayLike,
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
) -> Replay:
    """Strain a periodic packing as a DEM code would: inertia, damping, explicit steps.

    Normal forces are those of the geometry, shear forces start from the stored ones.

    Parameters
    ----------
    graph : GrainGraph
        One periodic state.
    law : LinearFrictional
        Contact law.
    strain : (2, 2) array
        Displacement gradient `H` of the cell at the end, compression positive: `h = (1 - H) h0`,
        reached at a constant velocity gradient.
    inertial_number : float
        Rate: `|H| / duration * sqrt(mean mass / pressure)`. Slower is closer to quasi-static.
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

    Returns
    -------
    Replay

    Raises
    ------
    InputError
        If the law is another, the packing is not periodic, or a number has the wrong sign.

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
    from loops.compiled.replay import Discs, Motion, resultants, run

    checked = require_replayable(graph, law)
    H, masses, inertias = _inputs(graph, strain, mass, inertia)
    number("damping", damping, 0.0)
    number("viscous", viscous, 0.0)
    pairs = contact_pairs(graph, checked)
    dt = time_step or TIME_STEP * math.sqrt(float((masses.min()) / pairs.kn.max()))
    if duration is None:
        number("inertial_number", inertial_number, 0.0, open_low=True)
        pressure = _pressure(graph)
        duration = float(np.linalg.norm(H)) * math.sqrt(masses.mean() / pressure) / inertial_number
    steps = max(1, round(duration / dt))
    gradient = (np.real(expm(logm(np.eye(2) - H) / steps)) - np.eye(2)) / dt
    count = graph.grain_count
    zero = np.zeros((count, 2))
    motion = Motion(
        np.array(graph.x),
        np.array(zero if velocity is None else velocity, dtype=float),
        np.zeros(count),
        np.array(zero[:, 0] if spin is None else spin, dtype=float),
        np.array(graph.cell),
        np.array(graph.shear_force),
    )
    gap = NEAR * 2.0 * float(graph.radii.mean())
    resultant = np.zeros((count, 3))
    by_radii, done = checked.shear_increment == "radii", 0
    singles = 0
    while done < steps:
        pairs = with_near(pairs, motion.x, motion.cell, graph.radii, gap)
        fresh = np.zeros(len(pairs) - len(motion.shear))
        motion = motion._replace(shear=np.append(motion.shear, fresh))
        discs = Discs(np.array(graph.radii), masses, inertias, *pairs)
        if done == 0:
            resultants(motion, discs, by_radii, resultant)
        left = steps - done
        made = run(motion, discs, gradient, left, dt, damping, viscous, by_radii, gap, resultant)
        singles = singles + 1 if made == 1 else 0
        if singles > 100:
            found = f"grains that move {gap:.2g} in one of {steps} steps"
            raise InputError("replay", found, "a stable motion", "Take shorter steps.")
        done += made
    state = _state(graph, pairs, motion)
    carried = np.hypot(state.normal_force, state.shear_force)[state.closed].sum()
    left = np.linalg.norm(resultant[:, :2], axis=1).mean() * np.count_nonzero(state.closed)
    unbalanced = float(left / carried) if carried > 0 else math.nan
    return Replay(state, motion.velocity, motion.spin, steps, dt, unbalanced)


def _inputs(
    graph: GrainGraph, strain: ArrayLike, mass: ArrayLike | None, inertia: ArrayLike | None
) -> tuple[Floats, Floats, Floats]:
    H = np.asarray(strain, dtype=float)
    if H.shape != (2, 2) or not np.isfinite(H).all() or not np.linalg.det(np.eye(2) - H) > 0:
        raise InputError(
            "strain", f"{H.tolist()}", "(2, 2) finite numbers that leave a cell", "Take less."
        )
    masses = np.pi * graph.radii**2 if mass is None else np.asarray(mass, dtype=float)
    inertias = 0.4 * masses * graph.radii**2 if inertia is None else np.asarray(inertia, float)
    for name, values in (("mass", masses), ("inertia", inertias)):
        if values.shape != graph.radii.shape or not (values > 0).all():
            raise InputError(name, f"shape {values.shape}", "a positive number a grain", ".")
    return H, np.ascontiguousarray(masses), np.ascontiguousarray(inertias)


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
