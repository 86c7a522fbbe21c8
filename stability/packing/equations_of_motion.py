"""A packing replayed by the equations of motion of a DEM code, from a snapshot on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm, logm

from loops.arrays import Floats
from loops.errors import InputError
from loops.graph import GrainGraph
from loops.laws import ContactLaw
from stability.arguments import number
from stability.packing.motion import Moving, duration_of, lasting, servo_of, steered, step_of
from stability.packing.pairs import Pairs, contact_pairs, require_replayable
from stability.packing.state import PackingState, start_state
from stability.programmes import Stage

if TYPE_CHECKING:
    from loops.compiled.replay import Servo


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
    checked = require_replayable(graph, law)
    masses, inertias = masses_of(graph.radii, mass, inertia)
    number("damping", damping, 0.0)
    number("viscous", viscous, 0.0)
    pairs, start = contact_pairs(graph, checked), start_state(graph)
    dt = time_step or step_of(masses, pairs)
    servo, H = _steering(start, pairs, masses, strain)
    if duration is None:
        number("inertial_number", inertial_number, 0.0, open_low=True)
        duration = duration_of(H, masses, start, inertial_number)
    steps = max(1, round(duration / dt))
    servo = lasting(servo, steps * dt)
    moving = Moving(start, pairs, masses, inertias, servo, checked.shear_increment == "radii")
    motion = moving.motion
    if not servo.on:
        motion.gradient[:] = (np.real(expm(logm(np.eye(2) - H) / steps)) - np.eye(2)) / dt
    motion.velocity[:] = 0.0 if velocity is None else velocity
    motion.spin[:] = 0.0 if spin is None else spin
    if balanced:
        moving.load(-motion.resultant)
    if not moving.run(steps, dt, damping, viscous):
        found = f"grains that move {moving.gap:.2g} in one of {steps} steps"
        raise InputError("replay", found, "a stable motion", "Take shorter steps.")
    return Replay(moving.state(), motion.velocity, motion.spin, steps, dt, steps * dt)


def _steering(
    start: PackingState, pairs: Pairs, masses: Floats, strain: ArrayLike | Stage
) -> tuple[Servo, Floats]:
    """A servo whose rates are per whole way, off for a strain, and the strain of the way."""
    servo = servo_of(start, pairs, masses)
    if isinstance(strain, Stage):
        programme, span = strain.programme, _span(strain)
        stress, rows, rate = (np.array(part) for part in programme.equations(np.zeros(4)))
        servo = steered(servo, start, pairs, stress, rows, rate * span)
        row = programme.isochoric_row
        servo = servo._replace(isochoric=-1 if row is None else row)
        return servo, (servo.gain @ servo.rate).reshape(2, 2)
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
        rate = stage.programme.driven(stage.quantity)
        if not abs(rate) > 0 or stage.quantity[0] == "P":
            received, expected = f"{stage.quantity} at the end", "'parameter', or a driven strain"
            raise InputError("stage", received, expected, "End it by the parameter.")
    if not stage.target / rate > 0:
        remedy = "Turn the sign of the target or of the rate."
        raise InputError("stage", f"target {stage.target:g}", "a target that lies ahead", remedy)
    return stage.target / rate


def masses_of(
    radii: Floats, mass: ArrayLike | None = None, inertia: ArrayLike | None = None
) -> tuple[Floats, Floats]:
    """Masses and moments of inertia, those of discs of unit density if left out."""
    masses = np.pi * radii**2 if mass is None else np.asarray(mass, dtype=float)
    inertias = 0.4 * masses * radii**2 if inertia is None else np.asarray(inertia, float)
    for name, values in (("mass", masses), ("inertia", inertias)):
        if values.shape != radii.shape or not (values > 0).all():
            raise InputError(name, f"shape {values.shape}", "a positive number a grain", ".")
    return np.ascontiguousarray(masses), np.ascontiguousarray(inertias)
