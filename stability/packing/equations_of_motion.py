"""Equations of motion of a DEM code: a packing in motion, through an instability, in a replay."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.linalg import expm, logm
from scipy.sparse.linalg import eigsh

from loops.arrays import Floats
from loops.contacts import Contacts, contacts_at_start
from loops.errors import InputError, counted, number, short, whole_number
from loops.laws.compiled import COMPILED_STEPS
from loops.laws.frictional import Regime
from loops.laws.of_pairs import SMALL_OVERLAP
from loops.scene import Scene, of_scene
from loops.validation import finite, positive
from stability.path import Path
from stability.programmes import NOTHING, MixedControl, Stage, nominal

if TYPE_CHECKING:
    from loops.compiled.motion import Servo

# Pairs closer than this share of the mean diameter are listed.
LISTED_GAP = 0.02
# Time step over the smallest sqrt(m/kn), as Yade's samples were made.
TIME_STEP = 0.3
# Its largest share of the stable one at the start.
STABLE = 0.8
# Lag of a servo, over `sqrt(m/kn)` of the means; an affine strain needs no waves.
LAG = 5.0
# Steps in a row in each of which the pairs had to be listed anew.
SINGLES = 100
# Parts of a motion by pair, which listing makes anew.
OF_PAIRS = ("shear", "kt", "overlap", "before", "place", "answer", "rolled")
# Through an instability: inertial number of the strain.
SNAP_RATE = 2.5e-7
# Mean resultant over the mean contact force of a packing at rest, after an instability and under a
# dead load: there 1e-5 takes the bottleneck after a fold for rest, and the next loss of equilibrium
# comes at once (docs/sustaining.md). A strain that is prescribed has no such bottleneck.
REST_FORCE = 1e-6
REST_FORCE_LOADED = 1e-7
# Strain rate of a packing at rest after an instability, over the rate of the motion through it.
REST_STRAIN = 1e-2
# Steps between checks of the rest.
CHECK_STEPS = 1000
# The largest number of checks.
MAX_CHECKS = 200


def require_upright(start: Contacts, stress: Floats, strain: Floats, rate: Floats) -> None:
    """Raise `InputError` where `stress @ P' + strain @ H' = rate` would turn or shear a box."""
    if not len(start.walls):
        return
    rows, asked = np.hstack([stress, strain]), np.eye(8)[[5, 6]]
    # Combinations of the equations that are H12' = 0 and H21' = 0.
    share = np.linalg.lstsq(rows.T, asked.T, rcond=None)[0].T
    if np.abs(share @ rows - asked).max() > 1e-9 or np.abs(share @ rate).max() > 1e-9:
        expected = "H12 = H21 = 0 between walls, which keep their directions"
        remedy = "Drive or hold the components 11 and 22 alone."
        raise InputError("control", "strains that turn or shear the box", expected, remedy)


def snap_through(
    state: Contacts, load: Floats, control: MixedControl, damping: float
) -> tuple[Contacts, Floats]:
    """Strain slowly by the whole of a control under a load (B, 3), then hold until at rest.

    The packing at rest again, and the work until then, as `Path.work`.
    Masses are those of discs of unit density, `damping` is Cundall's. `ArithmeticError` where
    grains run off, or don't come to rest.
    """
    masses, inertias = masses_of(state.radii[: state.count])
    servo = servo_of(state, masses)
    servo = steered(servo, state, *control, lost=True)
    H, dt = servo.gain @ servo.rate, step_of(masses, inertias, state)
    steps = max(1, round(duration_of(H, masses, state, SNAP_RATE) / dt))
    moving = Moving(state, masses, inertias, lasting(servo, steps * dt))
    moving.load(load)
    ran, checks = moving.run(steps, dt, damping), 0
    slow = REST_STRAIN * float(np.linalg.norm(H)) / (steps * dt)
    while ran and not rests(moving, slow, REST_FORCE):
        if checks == MAX_CHECKS:
            raise ArithmeticError(
                f"no rest in {MAX_CHECKS * CHECK_STEPS} steps after an instability"
            )
        ran, checks = moving.run(CHECK_STEPS, dt, damping), checks + 1
    end = moving.state()
    if not ran or not np.isfinite(end.x).all():
        raise ArithmeticError("grains ran off at an instability")
    return end, work_of(moving, end)


def work_of(moving: Moving, end: Contacts) -> Floats:
    """Work until the end of a motion, as `Path.work`.

    The last term is what damping took, and what the motion still has.
    """
    start, load, work = moving.start, moving.motion.load, np.append(moving.motion.work, 0.0)
    moved = end.x - start.x @ (end.cell @ np.linalg.inv(start.cell)).T
    work[0] += float(np.sum(load[:, :2] * moved) + load[:, 2] @ (end.angle - start.angle))
    work[3] = work[0] - work[1] - work[2] - (end.stored_energy - start.stored_energy)
    return work


def rests(moving: Moving, slow: float, force: float) -> bool:
    """Whether resultants are small over forces and the cell strains no faster than `slow`."""
    motion, still = moving.motion, bool(np.linalg.norm(moving.motion.gradient) < slow)
    # Without contacts there is no moment, and nothing to wait for.
    if motion.moment.any() and not still:
        return False
    state = moving.state()
    return not state.closed.any() or (still and moving.unbalanced(state) < force)


def masses_of(
    radii: Floats, mass: ArrayLike | None = None, inertia: ArrayLike | None = None
) -> tuple[Floats, Floats]:
    """Masses and moments of inertia, those of discs of unit density if left out."""
    count = len(radii)
    masses = positive("mass", np.pi * radii**2 if mass is None else mass, count)
    own = 0.4 * masses * radii**2
    inertias = positive("inertia", own if inertia is None else inertia, count)
    return np.ascontiguousarray(masses), np.ascontiguousarray(inertias)


def step_of(masses: Floats, inertias: Floats, state: Contacts, stride: float = 1.0) -> float:
    """Length of a step; `stride` times that of a replay where this is stable."""
    stiffest = state.law.typical_stiffness(state.overlap).max()
    # Springs against rolling of pairs that touch later are in no frequency of the start.
    smaller = state.radii[state.contacts[~state.at_wall]].min(axis=1)
    rolling = state.law.k_r[~state.at_wall] / smaller**2
    stiffest = max(stiffest, rolling.max(initial=0.0))
    usual = stride * TIME_STEP * math.sqrt(float(masses.min() / stiffest))
    if not state.closed.any():
        return usual
    return min(usual, STABLE * largest_step(masses, inertias, state))


def largest_step(masses: Floats, inertias: Floats, state: Contacts) -> float:
    """Length from which on steps are unstable: two over the largest frequency of the contacts."""
    from stability.compiled.packing_system import stiffnesses

    frame = state.records()
    regime = np.where(state.closed, Regime.ELASTIC, Regime.OPEN).astype(np.int8)
    regime = np.resize(regime, len(frame))
    size = 3 * len(state.x)
    ends, K = stiffnesses(frame, regime, np.zeros(len(frame)))
    at = (3 * ends[:, :, None] + np.arange(3)).reshape(-1, 6)
    # Walls don't move. Rotations are in units of the mean radius.
    lightness = np.zeros((len(state.x), 3))
    lightness[: state.count, :2] = 1.0 / masses[:, None]
    lightness[: state.count, 2] = state.mean_radius**2 / inertias
    root = np.sqrt(lightness).ravel()
    scaled = root[at][:, :, None] * K * root[at][:, None, :]
    places = np.repeat(at, 6, axis=1).ravel(), np.tile(at, (1, 6)).ravel()
    matrix = sparse.csr_array((scaled.ravel(), places), (size, size))
    # No mode of a regular packing is orthogonal to random numbers.
    first = np.random.default_rng(0).standard_normal(size)
    found = eigsh(matrix, k=1, which="LM", v0=first, tol=1e-2, return_eigenvectors=False)
    return 2.0 / math.sqrt(abs(float(found[0])))


def duration_of(H: ArrayLike, masses: Floats, state: Contacts, inertial_number: float) -> float:
    """Duration of a strain, or of one of this size, at an inertial number."""
    pressure = state.pressure
    if not pressure > 0:
        raise InputError("pressure", f"{pressure:g}", "forces", "Give the duration of the strain.")
    return float(np.linalg.norm(H)) * math.sqrt(masses.mean() / pressure) / inertial_number


def servo_of(state: Contacts, masses: Floats) -> Servo:
    """A servo that is off, with the first cell and its lag."""
    from loops.compiled.motion import Servo

    back = np.ascontiguousarray(np.linalg.inv(state.cell))
    lag = LAG * math.sqrt(masses.mean() / state.law.typical_stiffness(state.overlap).mean())
    none, nothing = np.zeros((4, 4)), np.zeros(4)
    start, z, ask = np.zeros((3, 4))
    steering = (none, none, nothing, none)
    rows = (-1, -1, 0.0)
    return Servo(False, back, *steering, lag, *rows, start, z, ask, np.inf, np.zeros(1))


def steered(
    servo: Servo,
    state: Contacts,
    stress: Floats,
    strain: Floats,
    rate: Floats,
    *,
    lost: bool = False,
) -> Servo:
    """The servo for `stress @ P' + strain @ H' = rate`, as stiff as the affine estimate.

    Where the equilibrium is `lost` all contacts of an axis may have opened: as if they touched.
    """
    for near in (False, True)[: 1 + lost]:
        matrix = stress @ _affine_stiffness(state, near) + strain
        if np.linalg.cond(matrix) < 1e16:
            gain = np.array(np.linalg.inv(matrix), dtype=float)
            return servo._replace(on=True, stress=stress, strain=strain, rate=rate, gain=gain)
    remedy = "Hold strains, or start from a packing that carries."
    raise InputError("packing", "no stiffness", "one that a servo can load", remedy)


def lasting(servo: Servo, duration: float) -> Servo:
    """The servo with its rates spread over a duration, after which they are zero."""
    return servo._replace(rate=servo.rate / duration, whole=duration)


def _affine_stiffness(state: Contacts, near: bool = False) -> Floats:
    """`P' = C H'` (4, 4) if all grains went with the cell and none turned: too stiff.

    Of `near` pairs as well, as if they hardly touched.
    """
    d, length, law = state.apart, state.length, state.law
    touch, overlap = (length <= law.touching) | near, state.overlap
    if near:
        overlap = np.maximum(overlap, SMALL_OVERLAP * law.touching)
    K = sum(
        (touch * k)[:, None, None] * a[:, :, None] * a[:, None, :]
        for k, a in zip(law.stiffnesses(overlap), state.axes, strict=True)
    )
    C = np.einsum("kac,kb,kd->abcd", K, d, d) / abs(np.linalg.det(state.cell))
    return np.asarray(C.reshape(4, 4))


class Moving:
    """A packing in motion; its pairs are listed anew where grains come closer.

    The velocity gradient of the cell is that of the servo if it isn't given. Masses, inertias,
    velocities and spins (zero if left out) are those of the grains; walls go with the cell.
    """

    def __init__(
        self,
        start: Contacts,
        masses: Floats,
        inertias: Floats,
        servo: Servo,
        *,
        velocity: ArrayLike | None = None,
        spin: ArrayLike | None = None,
        gradient: Floats | None = None,
        steps: int = 0,
    ) -> None:
        from loops.compiled.motion import MovingDiscs, update_forces

        self.start, self.servo = start, servo
        self.by_radii = start.law.by_radii
        self.gap = LISTED_GAP * 2.0 * start.mean_radius
        # How the law is asked; steps that are known of, and those made.
        self.asks, self.steps, self.made = "", steps, 0
        bodies, grains = len(start.radii), slice(start.count)
        # Nothing accelerates a wall.
        self.lightness = np.zeros(bodies), np.zeros(bodies)
        self.lightness[0][grains], self.lightness[1][grains] = 1.0 / masses, 1.0 / inertias
        velocities, spins = np.zeros((bodies, 2)), np.zeros(bodies)
        if velocity is not None:
            velocities[grains] = finite("velocity", velocity, start.count, 2)
        if spin is not None:
            spins[grains] = finite("spin", spin, start.count)
        pairs = {name: np.zeros(0) for name in OF_PAIRS}
        self.motion = MovingDiscs(
            x=np.array(start.x),
            velocity=velocities,
            angle=np.array(start.angle),
            spin=spins,
            cell=np.array(start.cell),
            resultant=np.zeros((bodies, 3)),
            speed=np.zeros((bodies, 2)),
            gradient=-(servo.gain @ servo.rate).reshape(2, 2) if gradient is None else gradient,
            load=np.zeros((bodies, 3)),
            moment=np.zeros(4),
            work=np.zeros(3),
            closer=np.zeros(1),
            **pairs,
        )
        self._list(start)
        self._ask()
        update_forces(self.law, self.motion, self.discs, 0.0, self.by_radii, servo.on)
        servo.start[:] = self.motion.moment / abs(np.linalg.det(start.cell))

    def _list(self, contacts: Contacts) -> None:
        """List the pairs that are close, and hand them to the kernels."""
        from loops.compiled.motion import Discs, place

        self.listed = now = contacts.with_near(self.gap)
        law, ends, none = now.law, now.contacts, np.zeros(len(now.contacts))
        self.motion = self.motion._replace(
            shear=np.array(now.shear_force),
            kt=law.stiffnesses(now.overlap)[1],
            rolled=np.where(law.k_r > 0, now.rolling_moment, 0.0),
            overlap=none,
            before=none.copy(),
            place=np.zeros((3, len(ends))),
            answer=np.zeros((4, len(ends))),
        )
        self.motion.closer[:] = 0.0
        self.discs = Discs(
            radii=np.array(now.radii),
            widest=2.0 * float(now.radii.max()),
            walls=np.array(now.walls),
            lightness=self.lightness[0],
            slenderness=self.lightness[1],
            pairs=ends.astype(np.uint32),
            images=now.images.astype(float),
            wraps=now.images.any(axis=1) | now.at_wall,
            spans=law.radii,
            reach=np.array(law.reach),
            constants=np.zeros((0, len(ends))),
            remembers=law.remembers,
            k_r=law.k_r,
            rolling_reach=law.rolling_reach,
            at_touch=np.array(law.at_touch),
        )
        place(self.motion, self.discs)
        self.motion.before[:] = self.motion.overlap
        self._hand_law()

    def _hand_law(self) -> None:
        """Hand the law to the kernel, or tell why numpy is asked in its place."""
        from loops.compiled.laws import Pointer, given

        law, wanted = self.listed.law, self.listed.law.compiled
        filling = law.filling(self.steps >= COMPILED_STEPS if wanted is None else wanted)
        if not isinstance(filling, str):
            self.law, constants = filling
            self.asks = "compiled" if self.law.made else "kernel"
        elif wanted:
            received, expected = f"compiled=True; {filling}", "methods that numba can compile"
            raise InputError("law", received, expected, "Leave compiled out.")
        else:
            self.asks = filling if filling == "numpy" else f"numpy: {filling}"
            self.law, constants = Pointer(given), np.zeros((4, len(law)))
        self.discs = self.discs._replace(constants=constants)

    def _part(self) -> None:
        """Take the bonds of pairs that have parted."""
        now = replace(self.listed, x=self.motion.x, cell=self.motion.cell)
        self.listed = self.listed.parted((now.law.reach > 0) & (now.overlap == 0))
        law = self.listed.law
        self.discs.reach[:], self.discs.at_touch[:] = law.reach, law.at_touch
        self._hand_law()

    def _ask(self) -> None:
        """Ask numpy for the forces where the pairs are placed, if the kernel can't ask the law."""
        motion = self.motion
        if self.asks.startswith("numpy"):
            now = motion.overlap, motion.before, motion.shear
            self.discs.constants[:] = self.listed.law.answer(*now)

    def load(self, load: Floats) -> None:
        """Add constant forces and moments (B, 3) on the bodies, from now on."""
        self.motion.load[:] += load
        self.motion.resultant[:] += load

    def run(self, steps: int, dt: float, damping: float = 0.3, viscous: float = 0.0) -> bool:
        """Integrate some steps; False where pairs had to be listed in too many steps in a row."""
        from loops.compiled.motion import run

        done = singles = 0
        long = self.steps >= COMPILED_STEPS
        self.made += steps
        self.steps = max(self.steps, self.made)
        if self.asks == "numpy" and not long and self.steps >= COMPILED_STEPS:
            self._hand_law()
        while done < steps:
            if self.motion.closer[0] > self.gap:
                self._list(self.state())
            how = (dt, damping, viscous)
            if self.asks.startswith("numpy"):
                made = self._asking_step(*how)
            else:
                made = run(
                    self.law, self.motion, self.discs, self.servo, steps - done, *how,
                    self.by_radii, self.gap,
                )  # fmt: skip
            if made < 0:
                self._part()
            made = abs(made)
            again = self.motion.closer[0] > self.gap and made == 1 < steps - done
            singles = singles + 1 if again else 0
            if singles > SINGLES:
                return False
            done += made
        return True

    def _asking_step(self, dt: float, damping: float, viscous: float) -> int:
        """Make a step as the kernel does, with the law asked in numpy."""
        from loops.compiled.motion import finish, move, place

        motion, discs = self.motion, self.discs
        motion.closer[0] += dt * (2.0 * move(motion, discs, dt, damping, viscous))
        before = motion.overlap.copy()
        place(motion, discs)
        self._ask()
        motion.overlap[:] = before
        parted = finish(self.law, motion, discs, self.servo, dt, self.by_radii)
        return -1 if parted else 1

    def unbalanced(self, state: Contacts) -> float:
        """Mean resultant on a grain, walls included, over the mean contact force."""
        left = np.linalg.norm(self.motion.resultant[: state.count, :2], axis=1)
        return float(left.mean() / state.mean_force) if state.closed.any() else np.inf

    def state(self) -> Contacts:
        """The current packing; its first pairs are those of the start."""
        motion = self.motion
        state = replace(
            self.listed,
            x=motion.x.copy(),
            angle=motion.angle.copy(),
            cell=motion.cell.copy(),
            normal_force=np.zeros(len(motion.shear)),
            shear_force=motion.shear.copy(),
            rolling_moment=motion.rolled.copy(),
        )
        return state.with_normal_forces()


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
                found = f"grains that move {moving.gap:.2g} in one of {counted(steps, 'step')}"
                raise InputError("replay", found, "a stable motion", "Take shorter steps.")
            done += part
        states.append(moving.state())
    whole = _span(strain) if isinstance(strain, Stage) else 1.0
    return Path(
        status="finished",
        message=f"replayed in {counted(steps, 'step')}",
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
