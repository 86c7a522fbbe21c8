"""A packing strained as a DEM code would: its equations of motion under a given strain."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm, logm

from loops.arrays import Floats
from loops.contacts import Contacts, contacts_at_start
from loops.errors import InputError, number, short, whole_number
from loops.scene import Scene, of_scene
from loops.validation import finite
from stability.packing.equations_of_motion import (
    Moving,
    duration_of,
    lasting,
    masses_of,
    require_upright,
    servo_of,
    steered,
    step_of,
)
from stability.path import Path
from stability.programmes import NOTHING, Stage, nominal

if TYPE_CHECKING:
    from loops.compiled.motion import Servo


@of_scene
def replay(
    scene: Scene,
    strain: ArrayLike | Stage,
    *,
    inertial_number: float = 2e-6,
    steps: int | None = None,
    duration: float | None = None,
    time_step: float | None = None,
    mass: ArrayLike | None = None,
    inertia: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    spin: ArrayLike | None = None,
    shares: ArrayLike | None = None,
    damping: float = 0.3,
    viscous: float = 0.0,
    balanced: bool = False,
    rows: int = 1,
) -> Path:
    """Strain a packing as a DEM code would: inertia, damping, explicit steps.

    Normal forces are those of the geometry, shear forces start from the stored ones.

    Parameters
    ----------
    scene : Scene or Snapshot
        One state, periodic or between four walls along the axes, with their forces where walls are
        rough. Grains that touch a wall later have its mean stiffness over the radius, or its mean
        stiffness where that varies less. Walls are springs, under `HertzMindlin` of that law with
        the modulus that their forces tell. The law is linear, Hertz and Mindlin's, cohesive, or one
        of your own, which is compiled where the replay is long (`FrictionalLaw.compiled`); with
        rolling springs between grains, whose moments start from the graph's.
    strain : (2, 2) or (K, 2, 2) array, or Stage
        Displacement gradient `H` of the cell, or of the box between walls, at the end, compression
        positive: `h = (1 - H) h0`, reached at a constant velocity gradient. Or `H` at the ends of K
        parts, each at a velocity gradient of its own. Or a programme and its end, 'parameter' or a
        component that is driven alone: strains are prescribed, stresses held by a servo on `H'`.
        Walls don't turn: `H12 = H21 = 0`.
    inertial_number : float
        Rate: `|H| / duration * sqrt(mean mass / pressure)`; of parts with the sum of their strains,
        of a programme with the elastic affine estimate of `H`. Slower is closer to quasi-static.
    steps : int, optional
        Number of steps, in place of the inertial number or the duration.
    duration : float, optional
        Time of the whole strain, in place of the inertial number.
    time_step : float, optional
        Length of a step; if left out 0.3 of the smallest `sqrt(m/kn)`, and at most 0.8 of the
        largest stable one, both of the start.
    mass, inertia : (G,) array, optional
        Masses, those of discs of unit density if left out; moments of inertia, `2/5 m r^2` if left
        out.
    velocity, spin : (G, 2), (G,) array, optional
        Velocities beyond the affine motion, and spins, to start with; rest if left out.
    shares : (K,) array, optional
        Shares of the duration at which the parts end, rising to 1; by default the parts take times
        as their strains are.
    damping : float
        Cundall's: a resultant is less by this share with the motion, more against it.
    viscous : float
        Drag of every grain over its momentum, 1/time.
    balanced : bool
        Balance the resultants of the start by a constant load.
    rows : int
        Number of states that are kept after the start, 1 or more.

    Returns
    -------
    Path
        Its `state` is the packing at the end, whose first contacts are those of the start.

    Raises
    ------
    InputError
        If the law is another, the packing has neither a cell nor a box of walls, a number has the
        wrong sign, the stage ends by a quantity that its programme doesn't drive, or walls would
        turn.

    Examples
    --------
    >>> import numpy as np
    >>> from loops import GrainGraph, LinearFrictional, Scene
    >>> row = GrainGraph(x=[[0, 0], [1, 0]], radii=[0.505] * 2, contacts=[[0, 1], [1, 0]],
    ...     images=[[0, 0], [1, 0]], cell=[[2, 0], [0, 3]], normal_force=[0.01] * 2)
    >>> scene = Scene(row, LinearFrictional(1.0, 0.5, 0.5))
    >>> end = replay(scene, [[0.001, 0], [0, 0]]).state
    >>> end.normal_force.round(6).tolist()
    [0.011, 0.011]
    """
    start = contacts_at_start(scene)
    masses, inertias = masses_of(scene.graph.radii, mass, inertia)
    number("damping", damping, 0.0)
    number("viscous", viscous, 0.0)
    number("inertial_number", inertial_number, 0.0, open_low=True)
    whole_number("rows", rows, 1)
    if time_step is None:
        dt = step_of(masses, inertias, start)
    else:
        dt = number("time_step", time_step, 0.0, open_low=True)
    servo, ends = _steering(start, masses, strain)
    sizes = np.array([np.linalg.norm(part) for part in np.diff(ends, axis=0, prepend=0.0)])
    if steps is not None:
        if duration is not None:
            raise InputError("replay", "steps and duration", "one of them", "Leave one out.")
        whole_number("steps", steps, 1)
        duration = steps * dt
    if duration is None:
        duration = duration_of(sizes.sum(), masses, start, inertial_number)
    number("duration", duration, 0.0)
    steps = max(1, round(duration / dt))
    servo = lasting(servo, steps * dt)
    at = _shares(sizes, shares)
    gradients = {} if servo.on else _gradients(ends, at, steps, dt)
    moving = Moving(
        start, masses, inertias, servo, velocity=velocity, spin=spin,
        gradient=gradients.get(0), steps=steps,
    )  # fmt: skip
    motion = moving.motion
    if balanced:
        moving.load(-motion.resultant)
    count, states, done = start.count, [moving.state()], 0
    for last in np.linspace(0, steps, rows + 1).round().astype(int)[1:].tolist():
        while done < last:
            motion.gradient[:] = gradients.get(done, motion.gradient)
            part = min([last, *(turn for turn in gradients if turn > done)]) - done
            if not moving.run(part, dt, damping, viscous):
                found = f"grains that move {moving.gap:.2g} in one of {steps} steps"
                raise InputError("replay", found, "a stable motion", "Take shorter steps.")
            done += part
        states.append(moving.state())
    whole = _span(strain) if isinstance(strain, Stage) else 1.0
    return Path(
        status="finished",
        message=f"replayed in {steps} steps",
        events=(),
        parameter=np.linspace(0.0, whole, len(states)),
        stage=np.zeros(len(states), dtype=np.int64),
        H=np.array([state.strain.ravel() for state in states]),
        P=np.array([nominal(state.stress, state.strain).ravel() for state in states]),
        states=tuple(states),
        velocity=motion.velocity[:count],
        spin=motion.spin[:count],
        steps=steps,
        time_step=dt,
        law_asked=moving.asks,
    )


def _steering(start: Contacts, masses: Floats, strain: ArrayLike | Stage) -> tuple[Servo, Floats]:
    """A servo with rates over the whole duration, off for a given strain; `H` of parts (K, 2, 2).

    Under a servo these are one part, the strain that is expected.
    """
    servo = servo_of(start, masses)
    if isinstance(strain, Stage):
        programme, span = strain.programme, _span(strain)
        at_start = programme.equations(NOTHING, start.stress.ravel())
        stress, rows, rate = (np.array(part) for part in at_start)
        require_upright(start, stress, rows, rate)
        servo = steered(servo, start, stress, rows, rate * span)
        held = (programme.isochoric_row, programme.cauchy_row)
        isochoric, cauchy = (-1 if row is None else row for row in held)
        fluid = programme.fluid_bulk_modulus
        servo = servo._replace(isochoric=isochoric, cauchy=cauchy, fluid=fluid)
        return servo, (servo.gain @ servo.rate).reshape(1, 2, 2)
    ends = finite("strain", strain)
    ends = ends[None] if ends.ndim == 2 else ends
    fits = ends.ndim == 3 and len(ends) > 0 and ends.shape[1:] == (2, 2)
    if not (fits and (np.linalg.det(np.eye(2) - ends) > 0).all()):
        expected = "(2, 2) finite numbers that leave a cell, or (K, 2, 2) of parts"
        raise InputError("strain", short(strain), expected, "Take less.")
    for H in ends:
        require_upright(start, np.zeros((4, 4)), np.eye(4), H.ravel())
    return servo, ends


def _shares(sizes: Floats, given: ArrayLike | None) -> Floats:
    """Shares of the duration at which parts of some strains end."""
    if given is None:
        whole = float(sizes.sum())
        steady = np.linspace(0.0, 1.0, len(sizes) + 1)[1:]
        return np.cumsum(sizes) / whole if whole > 0 else steady
    shares = finite("shares", given, len(sizes))
    if not (shares[-1] == 1.0 and shares[0] > 0 and (np.diff(shares) > 0).all()):
        expected = f"{len(sizes)} numbers that rise to 1, the end of each part of the strain"
        raise InputError("shares", f"{shares.tolist()}", expected, "Leave them out, or correct.")
    return shares


def _gradients(ends: Floats, shares: Floats, steps: int, dt: float) -> dict[int, Floats]:
    """Velocity gradient of each part by the step that it begins with.

    Parts of less than a step are joined to the next one.
    """
    marks = np.rint(shares * steps).astype(int)
    last = np.append(np.diff(marks) > 0, True)
    begin, before, found = 0, np.eye(2), {}
    for end, H in zip(marks[last].tolist(), ends[last], strict=True):
        moved = (np.eye(2) - H) @ np.linalg.inv(before)
        found[begin] = (np.real(expm(logm(moved) / (end - begin))) - np.eye(2)) / dt
        begin, before = end, np.eye(2) - H
    return found


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
