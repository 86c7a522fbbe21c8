"""The load that a packing sustains along directions of stress, and the motion past its limits."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops.arrays import Flags, Floats, Integers
from loops.errors import InputError, check_choice, number, whole_number
from loops.faces import Faces, find_faces
from loops.graph import GrainGraph
from loops.laws import ContactLaw
from loops.packing import PlaneContacts
from loops.shown import Shown
from stability.packing.equations_of_motion import (
    Moving,
    lasting,
    masses_of,
    rests,
    servo_of,
    steered,
    step_of,
    stored_energy,
    work_of,
)
from stability.packing.loop_quantities import loop_sums
from stability.packing.pairs import Pairs, at_limit, require_movable
from stability.packing.path import PackingPathSolver, Stop
from stability.packing.probe import probe_directions, stage_along
from stability.packing.regime_regions import Subspace
from stability.packing.state import PackingState, start_state
from stability.packing.strain_increment import Found, InstabilityError, MixedControl
from stability.paths.path import FINISHED
from stability.programmes import Stage

LoadStatus = Literal["held", "snapped", "failed", "unfinished"]
MotionStatus = Literal["at rest", "failed", "not at rest"]

# Load by which a limit is passed: over the load there, and over the stress of the start.
PUSH, SMALLEST_PUSH = 0.02, 1e-5
# Steps over which this load is added, between two looks at the motion, and the largest number.
PUSH_STEPS, LOOK, MOST_STEPS = 500, 100, 60_000
# Time step over that of a replay.
STRIDE = 5.0 / 3.0
# Inertial number of the strain at rest.
STILL = 2e-8
# Motions after which the load grows in the equations of motion, by this share between two looks at
# an inertial number of the strain. Faster strains let it grow less, and stand still from so many
# times the number on; slower ones more, up to the share by which a limit is passed.
BY_EVENTS, GROWTH, PACE, FAST = 3, 0.01, 2e-5, 2.0
# Loads that are kept, each larger by this share, and how many of them a search for the largest one
# in equilibrium goes back first.
KEPT, APART, BACK = 40, 0.02, 4
# Before a limit is believed the interval is cut by this, so many times.
CUT, CUTS = 4.0, 3
# Strains: up to which a motion tells its mode, from which on it may be a failure, and flow.
MODE_STRAIN, FAILURE_STRAIN, FLOW_STRAIN = 2e-5, 1e-3, 0.02
# Grains that move by this share of the largest displacement take part in a mode.
TAKES_PART = 0.1
# Contacts with less than this share of the mean normal force do not count as opened or closed.
CARRIES = 0.01
# Default of the largest load over the mean stress; rows, and intervals and events without end.
REACH, ROWS, MANY = 0.1, 20, 1_000_000


MESSAGES = {
    "failed": "strain rate and kinetic energy keep growing at constant load",
    "not at rest": f"neither rest nor failure in {MOST_STEPS} steps",
}


@dataclass(frozen=True, eq=False, repr=False)
class Motion(Shown):
    """A motion from an equilibrium that was lost, at constant load or under one that grows slowly.

    Attributes
    ----------
    status : {'at rest', 'failed', 'not at rest'}
        'at rest': the packing found another equilibrium under the same load, a snap. 'failed':
        strain rate and kinetic energy grew over the last two doublings of the strain, beyond a
        strain of 1e-3. 'not at rest': neither within 60,000 steps.
    lost, load : float
        Load of the direction at which the equilibrium was lost, and under which it moved: a
        fiftieth more. Of a load that grew slowly, its first and last value.
    cause : str
        Why the equilibrium was lost.
    contact : int
        Contact without agreeing regimes; -1 where the control met its limit.
    strain : (4,) array
        Displacement gradient of the cell in the motion, 11, 12, 21, 22.
    released : float
        Energy that damping took, and that the motion still had (force times length).
    kinetic : float
        Largest kinetic energy at a look at the motion.
    steps : int
        Steps of the motion.
    displacement : (G, 2) array
        Of the grains beyond the affine motion until the strain was 2e-5, or until rest: the mode.
    opened, closed, slid : int
        Contacts that opened or closed in the mode, and that slide at its end and did not before.
    loop_work : (L,) array
        Area times additive work `w` of each loop in the mode (force times length).
    """

    status: MotionStatus
    lost: float
    load: float
    cause: str
    contact: int
    strain: Floats
    released: float
    kinetic: float
    steps: int
    displacement: Floats
    opened: int
    closed: int
    slid: int
    loop_work: Floats

    @property
    def grains(self) -> Integers:
        """Grains that move by at least a tenth of the largest displacement."""
        size = np.linalg.norm(self.displacement, axis=1)
        return np.flatnonzero(size >= TAKES_PART * size.max())


@dataclass(frozen=True, eq=False, repr=False)
class LoadPath(Shown):
    """A packing under growing load along one direction of stress.

    Attributes
    ----------
    direction : (m,) array
        Unit direction of `P'`.
    status : {'held', 'snapped', 'failed', 'unfinished'}
        'held': the largest load is reached on one path of equilibria; 'snapped': it is reached
        through snaps; 'failed': no rest was found beyond `limit`; 'unfinished': the path ended for
        another reason at `limit`, see `message`.
    message : str
        The status in words.
    first_event : float
        Load at which the first contact changed its regime; nan if none did.
    first_instability : float
        Load at which the equilibrium was first lost; nan if it never was.
    limit : float
        Largest load in equilibrium.
    failed_under : float
        Load under which the packing failed, above `limit` by a fiftieth; nan if it did not.
    motions : tuple of Motion
        Motions past lost equilibria, in their order.
    load : (R,) array
        Loads of the rows: the start, and after each step of the load and each snap.
    H, P : (R, 4) array
        Displacement gradient and nominal stress.
    work : (R, 4) array
        As `PackingPath.work`.
    energy : (R,) array
        Energy of the springs.
    """

    direction: Floats
    status: LoadStatus
    message: str
    first_event: float
    first_instability: float
    limit: float
    failed_under: float
    motions: tuple[Motion, ...]
    load: Floats
    H: Floats
    P: Floats
    work: Floats
    energy: Floats

    @property
    def snaps(self) -> tuple[Motion, ...]:
        """Motions that came to rest."""
        return tuple(motion for motion in self.motions if motion.status == "at rest")

    @property
    def mode(self) -> Motion | None:
        """The motion that failed, else the snap of largest strain; None without any."""
        if self.status == "failed":
            return self.motions[-1]
        return max(self.motions, key=lambda one: float(np.linalg.norm(one.strain)), default=None)

    @property
    def balance_error(self) -> float:
        """Largest error of the energy balance over the largest work."""
        work, *spent = self.work.T
        error = work - sum(spent) - (self.energy - self.energy[0])
        return float(np.abs(error).max() / max(np.abs(work).max(), 1e-300))


@dataclass(frozen=True, eq=False, repr=False)
class Sustained(Shown):
    """The loads that a packing sustains around a state.

    Attributes
    ----------
    subspace : {'diagonal', 'symmetric'}
        Plane (11, 22) of the stress directions, or with shear.
    directions : (D, m) array
        Unit directions of `P'`.
    largest : float
        Load up to which each was followed (force per length).
    paths : tuple of LoadPath
        One a direction.
    stress : (2, 2) array
        Stress of the start.
    """

    subspace: Subspace
    directions: Floats
    largest: float
    paths: tuple[LoadPath, ...]
    stress: Floats

    @property
    def theta(self) -> Floats:
        """(D,) angle of the direction in the (11, 22) plane, 0 to 2 pi."""
        return np.asarray(
            np.mod(np.arctan2(self.directions[:, 1], self.directions[:, 0]), math.tau)
        )

    @property
    def status(self) -> NDArray[np.str_]:
        """(D,) status of the paths."""
        return np.array([path.status for path in self.paths])

    @property
    def limit(self) -> Floats:
        """(D,) largest loads in equilibrium."""
        return np.array([path.limit for path in self.paths])

    @property
    def failed(self) -> Flags:
        """(D,) whether the packing failed."""
        return self.status == "failed"


# A function that follows directions to a load, and returns their paths in order.
Follow = Callable[[Floats, float], Sequence[LoadPath]]


def sustain(
    graph: GrainGraph,
    law: ContactLaw,
    directions: ArrayLike = 24,
    *,
    subspace: Subspace = "diagonal",
    largest: float | None = None,
    interval: float = 5e-6,
    most_snaps: int = 30,
    faces: Faces | None = None,
    follow: Follow | None = None,
    planes: PlaneContacts | None = None,
    plane_force: ArrayLike | None = None,
    damping: float = 0.3,
) -> Sustained:
    """Load a packing along directions of stress until it fails.

    Each direction of `P'`, with no strain outside of the subspace, is followed from event to event.
    Where the equilibrium is lost (no regimes of a contact agree, or the control asks for ever more
    strain) the load is raised by a fiftieth and kept constant, and the equations of motion decide:
    the packing comes to rest in another equilibrium, a snap, and is loaded further; or its strain
    rate and its kinetic energy keep growing, and it has failed. After three motions the load grows
    slowly in the equations of motion themselves, and waits while the packing moves; where it fails
    so, loads before are kept constant until one comes to rest and the next one does not.

    Parameters
    ----------
    graph : GrainGraph
        One state in equilibrium, periodic or between walls: bring another to rest with `hold`
        first.
    law : FrictionalLaw
        Contact law: linear, Hertz and Mindlin's, or one of your own.
    directions : int or (D, m) array_like
        How many, evenly spread; or the directions themselves (m = 2, or 3 with shear).
    subspace : {'diagonal', 'symmetric'}
        Components (11, 22), or (11, 22, (12 + 21)/sqrt 2).
    largest : float, optional
        Load (force per length) up to which each direction is followed; by default a tenth of the
        mean stress.
    interval : float
        Strain over which the geometry is kept.
    most_snaps : int
        Snaps, of at most three by events, after which a direction is left 'unfinished'.
    faces : Faces, optional
        Faces of the graph, if known.
    follow : callable, optional
        Follows the directions (D, m) to the largest load, by default one after the other.
    planes, plane_force
        Contacts with walls, as in `stability.follow`; between walls the subspace is diagonal.
    damping : float
        Cundall's damping of the motions. Limits with two values tell how far they depend on it.

    Returns
    -------
    Sustained

    Raises
    ------
    InputError
        If the law is another, the packing has neither cell nor walls, or an option is out of its
        range.

    Examples
    --------
    >>> import numpy as np
    >>> from loops import GrainGraph, LinearFrictional
    >>> lattice = GrainGraph(x=[[0, 0], [1, 0], [0, 1], [1, 1]], radii=[0.505] * 4,
    ...     contacts=[[0, 1], [1, 0], [2, 3], [3, 2], [0, 2], [2, 0], [1, 3], [3, 1]],
    ...     images=[[0, 0], [1, 0], [0, 0], [1, 0], [0, 0], [0, 1], [0, 0], [0, 1]],
    ...     cell=2 * np.eye(2), normal_force=np.full(8, 0.01))
    >>> found = sustain(lattice, LinearFrictional(1.0, 0.5, 0.5), [[-1, 0], [1, 0]],
    ...                 largest=0.02, interval=1e-4)
    >>> found.status.tolist(), found.limit.round(6).tolist()
    (['failed', 'held'], [0.01, 0.02])
    """
    checked = require_movable(graph, law)
    check_choice("subspace", subspace, get_args(Subspace))
    number("interval", interval, 0.0, open_low=True)
    whole_number("most_snaps", most_snaps, 0)
    if not 0.0 < damping < 1.0:
        raise InputError("damping", f"{damping}", "a share between 0 and 1", "Correct it.")
    unit = probe_directions(directions, subspace)
    stress = start_state(graph, planes, plane_force).stress
    if largest is None:
        largest = REACH * 0.5 * float(np.trace(stress))
    number("largest", largest, 0.0, open_low=True)
    found = find_faces(graph) if faces is None else faces
    if follow is None:
        paths: Sequence[LoadPath] = [
            load_path(
                graph,
                checked,
                direction,
                subspace,
                largest,
                interval,
                most_snaps,
                found,
                planes,
                plane_force,
                damping,
            )
            for direction in unit
        ]
    else:
        paths = follow(unit, largest)
    return Sustained(subspace, unit, largest, tuple(paths), stress)


def load_path(
    graph: GrainGraph,
    law: ContactLaw,
    direction: Floats,
    subspace: Subspace,
    largest: float,
    interval: float,
    most_snaps: int,
    faces: Faces,
    planes: PlaneContacts | None = None,
    plane_force: ArrayLike | None = None,
    damping: float = 0.3,
) -> LoadPath:
    """One direction of `sustain`."""
    stage = stage_along(direction, subspace, "stress", largest)
    solver = _LoadPathSolver(graph, law, stage, interval, planes, plane_force)
    solver.faces, solver.most_snaps, solver.damping = faces, most_snaps, damping
    stop, message = solver.follow(0, stage, ROWS, MANY, MANY, None)
    motions = tuple(solver.motions)
    failed = bool(motions) and motions[-1].status == "failed"
    held: LoadStatus = "snapped" if motions else "held"
    path = solver.path(stop, message)
    return LoadPath(
        direction=direction,
        status="failed" if failed else held if stop == "finished" else "unfinished",
        message=message,
        first_event=min((event.parameter for event in solver.events), default=math.nan),
        first_instability=motions[0].lost if motions else math.nan,
        limit=solver.parameter,
        failed_under=motions[-1].load if failed else math.nan,
        motions=motions,
        load=path.parameter,
        H=path.H,
        P=path.P,
        work=path.work,
        energy=path.energy,
    )


class _LoadPathSolver(PackingPathSolver):
    """A path by events that goes on by the equations of motion where its equilibrium is lost."""

    faces: Faces
    most_snaps: int
    damping: float

    def __init__(
        self,
        graph: GrainGraph,
        law: ContactLaw,
        stage: Stage,
        interval: float,
        planes: PlaneContacts | None,
        plane_force: ArrayLike | None,
    ) -> None:
        super().__init__(graph, law, [stage], interval, "stop", planes, plane_force)
        self.count = graph.contact_count
        self.whole_interval = interval
        self.motions: list[Motion] = []
        self.ended = False

    def _step(self, stage: Stage, target: float, instabilities: int) -> Stop | None:
        """An interval, a shorter one where that ends in no equilibrium, or a motion."""
        events, cause = len(self.events), ""
        for _ in range(CUTS + 1):
            stop = super()._step(stage, target, instabilities)
            if stop is None or self.ended:
                self.size = min(2.0 * self.size, self.whole_interval)
                return stop
            del self.events[events:]
            cause = stop[1]
            self.size = max(self.size / CUT, self.whole_interval / CUT**CUTS)
        return self._move(stage, -1, cause)

    def _pass(
        self, met: InstabilityError, duration: float, stage: Stage, target: float
    ) -> Stop | None:
        self._add_events([Found("instability", 0.0, met.contact, met.why)])
        return self._move(stage, met.contact, met.why)

    def _move(self, stage: Stage, contact: int, cause: str) -> Stop | None:
        """Raise the load a little and keep it: at rest again the path goes on, else it ends."""
        if len(self.motions) == self.most_snaps:
            self.ended = True
            return "instabilities", f"more than {self.most_snaps} motions before the largest load"
        if len(self.motions) == BY_EVENTS:
            return self._grow(stage)
        lost = self.parameter
        load = lost + min(max(PUSH * lost, self._least_push()), stage.target - lost)
        moved = self._moved(stage, load)
        status = moved.hold()
        motion = moved.told(status, lost, load, self.faces)
        return self._take(replace(motion, cause=cause, contact=contact), moved)

    def _grow(self, stage: Stage) -> Stop:
        """Let the load grow slowly, to the last or to the largest one that comes to rest."""
        self.ended, target = True, stage.target
        first, cause = self.parameter, f"load that grows slowly, after {BY_EVENTS} motions"
        moved = self._moved(stage, target)
        status, reached, kept = moved.grow(first, target, self._least_push() / PUSH)
        if status == "at rest":
            motion = moved.told(status, first, target, self.faces)
            return self._take(replace(motion, cause=cause), moved) or FINISHED
        rests, fails, back = -1, len(kept), BACK
        while fails - rests > 1:
            # Back by more and more until one comes to rest, then between the two.
            k = (rests + fails) // 2 if rests >= 0 else max(fails - back, 0)
            back *= 2
            trial = copy(kept[k][1])
            trial.start_again()
            found = trial.hold()
            if found == "at rest":
                rests, best = k, trial
            else:
                fails, status, moved = k, found, trial
        if rests >= 0:
            load = kept[rests][0]
            best.since = best.origin
            motion = best.told("at rest", first, load, self.faces)
            self._take(replace(motion, cause=cause), best)
        load = reached if fails == len(kept) else kept[fails][0]
        motion = moved.told(status, self.parameter, load, self.faces)
        return self._take(replace(motion, cause=cause), moved) or FINISHED

    def _least_push(self) -> float:
        return SMALLEST_PUSH * self.first_stress

    def _moved(self, stage: Stage, load: float) -> _Moved:
        """The packing as it starts to move under another load."""
        stress, strain, rate = stage.programme.equations(self.H)
        # There is one stage: its strains are those of the path.
        done = stress @ (self.P - self.P_start) + strain @ self.H
        control = self._control(stage, 0.0)._replace(rate=rate * load - done)
        where = self.state, self.pairs, -self.balance
        return _Moved(*where, control, self.by_radii, self.count, self.damping)

    def _take(self, motion: Motion, moved: _Moved) -> Stop | None:
        """Go on from the end of a motion that came to rest."""
        self.motions.append(motion)
        if motion.status != "at rest":
            self.ended = True
            return "lost", f"{motion.cause}; {MESSAGES[motion.status]}"
        end, work = moved.moving.state(), moved.work()
        self.F = end.cell @ np.linalg.inv(self.state.cell) @ self.F
        self.pairs = moved.moving.pairs
        self._accept(end, motion.load - self.parameter, work)
        self._find_regimes()
        self._list_pairs()
        self._record()
        return None


class _Moved:
    """A packing that moves as its control changes by its `rate`, and while it is kept then."""

    def __init__(
        self,
        state: PackingState,
        pairs: Pairs,
        load: Floats,
        control: MixedControl,
        by_radii: bool,
        count: int,
        damping: float,
    ) -> None:
        self.masses, self.inertias = masses_of(state.radii[: state.count])
        servo = servo_of(state, pairs, self.masses)
        servo = steered(servo, state, pairs, control.stress, control.strain, control.rate)
        self.dt = step_of(self.masses, self.inertias, pairs, state, by_radii, STRIDE)
        servo = lasting(servo, PUSH_STEPS * self.dt)
        self.moving = Moving(state, pairs, self.masses, self.inertias, servo, by_radii)
        self.moving.load(load)
        self.load, self.count, self.damping, self.rate = load, count, damping, control.rate
        # Strain rate of an inertial number of one.
        self.pace = math.sqrt(0.5 * float(np.trace(state.stress)) / self.masses.mean())
        self.energy, self.steps = stored_energy(state, pairs), 0
        self.origin = self.since = state, pairs, 0.0, 0
        self.strains, self.kinetic = [0.0], [0.0]
        self.mode: tuple[PackingState, Pairs] | None = None

    def __copy__(self) -> _Moved:
        """Another packing that moves from here on its own."""
        other = object.__new__(_Moved)
        vars(other).update(vars(self))
        other.moving = copy(self.moving)
        for name in ("motion", "servo"):
            parts = getattr(self.moving, name)
            own = (part.copy() if isinstance(part, np.ndarray) else part for part in parts)
            setattr(other.moving, name, type(parts)(*own))
        return other

    def start_again(self) -> None:
        """Count strain, energies and the mode from here."""
        moving = self.moving
        self.since = moving.state(), moving.pairs, float(self.work()[3]), self.steps
        self.strains, self.kinetic, self.mode = [0.0], [0.0], None

    def work(self) -> Floats:
        """Work since the first state, as `PackingPath.work`."""
        return work_of(self.moving, self.moving.state(), self.load, self.energy)

    def look(self) -> MotionStatus:
        """Make some steps, and judge the motion since it was counted."""
        ran, motion = self.moving.run(LOOK, self.dt, self.damping), self.moving.motion
        self.steps += LOOK
        grown = motion.cell @ np.linalg.inv(self.since[0].cell) - np.eye(2)
        self.strains.append(float(np.linalg.norm(grown)))
        velocity, spin = motion.velocity[: len(self.masses)], motion.spin[: len(self.masses)]
        square = np.sum(velocity**2, axis=1)
        self.kinetic.append(0.5 * float(self.masses @ square + self.inertias @ spin**2))
        if self.mode is None and self.strains[-1] >= MODE_STRAIN:
            self.mode = self.moving.state(), self.moving.pairs
        if not ran or self.strains[-1] > FLOW_STRAIN or keeps_growing(self.strains, self.kinetic):
            return "failed"
        waited = LOOK * (len(self.strains) - 1) > PUSH_STEPS
        return "at rest" if waited and rests(self.moving, STILL * self.pace) else "not at rest"

    def hold(self) -> MotionStatus:
        """Move until rest or failure."""
        status: MotionStatus = "not at rest"
        while status == "not at rest" and LOOK * (len(self.strains) - 1) < MOST_STEPS:
            status = self.look()
        return status

    def grow(
        self, first: float, last: float, least: float
    ) -> tuple[MotionStatus, float, Sequence[tuple[float, _Moved]]]:
        """Let the control change slowly; the end, its load, and the packing under loads before.

        Control and load change together, the load from `first` to `last`, so fast that the strain
        goes at one pace.
        """
        moving, load = self.moving, first
        status: MotionStatus = "not at rest"
        kept: deque[tuple[float, _Moved]] = deque(maxlen=KEPT)
        moving.motion.gradient[:] = 0.0
        while status == "not at rest" and LOOK * (len(self.strains) - 1) < MOST_STEPS:
            speed = float(np.linalg.norm(moving.motion.gradient)) / (PACE * self.pace)
            grows = load < last and speed < FAST
            if grows:
                share = min(GROWTH / max(speed, 1e-9), PUSH)
                step = min(share * max(load, least), last - load)
                duration = LOOK * self.dt
                moving.servo.rate[:] = self.rate * step / ((last - first) * duration)
                # The servo's clock tells its load: the two go on together.
                moving.servo.clock[0] = (load - first) / step * duration
                load = load + step if step < last - load else last
                whole = (load - first) / step * duration
                moving.servo = moving.servo._replace(whole=whole)
                self.strains, self.kinetic = [0.0], [0.0]
                here = replace(self.origin[0], cell=moving.motion.cell.copy())
                self.since = here, *self.origin[1:]
            status = self.look()
            before = kept[-1][0] if kept else first
            if grows and before + APART * max(load, least) <= load < last:
                kept.append((load, copy(self)))
        self.since = self.origin
        return status, load, kept

    def told(self, status: MotionStatus, lost: float, load: float, faces: Faces) -> Motion:
        """The motion since it was counted."""
        moving, count = self.moving, self.count
        (state, pairs, spent, steps), end = self.since, self.moving.state()
        back = np.linalg.inv(state.cell)
        then, listed = (end, moving.pairs) if self.mode is None else self.mode
        force = then.forces[:count] - state.forces[:count]
        branch = then.branches[:count] - state.branches[:count]
        carries, carried = (
            one.normal_force >= CARRIES * one.normal_force[one.closed].mean()
            for one in (then, state)
        )
        slides, old = at_limit(listed, then), len(pairs)
        slides[:old] &= ~at_limit(pairs, state)
        return Motion(
            status=status,
            lost=lost,
            load=load,
            cause="",
            contact=-1,
            strain=(np.eye(2) - end.cell @ back).ravel(),
            released=float(self.work()[3]) - spent,
            kinetic=max(self.kinetic),
            steps=self.steps - steps,
            displacement=(then.x - state.x @ (then.cell @ back).T)[: state.count],
            opened=int(np.count_nonzero(carried & ~then.closed[:old])),
            closed=int(np.count_nonzero(carries) - np.count_nonzero(carries[:old] & state.closed)),
            slid=int(np.count_nonzero(slides)),
            loop_work=loop_sums(-0.5 * np.sum(force * branch, axis=1), faces),
        )


def keeps_growing(strains: Sequence[float], kinetic: Sequence[float]) -> bool:
    """Whether strain rate and mean kinetic energy did not fall over two doublings of the strain."""
    e = np.array(strains)
    if not e[-1] >= FAILURE_STRAIN:
        return False
    half, quarter = int(np.argmax(e >= 0.5 * e[-1])), int(np.argmax(e >= 0.25 * e[-1]))
    if half == quarter:
        # The strain doubled between two looks.
        return True
    rate = (e[-1] - e[half]) / max(len(e) - 1 - half, 1)
    rate_before = (e[half] - e[quarter]) / (half - quarter)
    faster = rate >= rate_before
    return bool(faster and np.mean(kinetic[half:]) >= np.mean(kinetic[quarter:half]))
