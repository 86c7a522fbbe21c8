"""The load that a packing sustains along directions of stress, and the motion past its limits."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops.arrays import Flags, Floats, Integers
from loops.errors import check_choice, number, whole_number
from loops.faces import Faces, find_faces
from loops.graph import GrainGraph
from loops.laws import ContactLaw
from loops.packing import PlaneContacts
from loops.shown import Shown
from stability.packing.equations_of_motion import (
    Moving,
    Snap,
    lasting,
    masses_of,
    rests,
    servo_of,
    steered,
    step_of,
    stored_energy,
    work_of,
)
from stability.packing.incremental_packing import AT_YIELD
from stability.packing.loop_rates import loop_sums
from stability.packing.pairs import Pairs, require_movable, strength
from stability.packing.path import PackingPathSolver, Stop
from stability.packing.probe import probe_directions
from stability.packing.probe_paths import stage_along
from stability.packing.regime_regions import Subspace
from stability.packing.state import PackingState, start_state
from stability.packing.strain_increment import Found, InstabilityError, MixedControl
from stability.programmes import Stage

LoadStatus = Literal["held", "snapped", "failed", "unfinished"]
MotionStatus = Literal["at rest", "failed", "not at rest"]

# Load by which a limit is passed: over the load there, and over the stress of the start.
PUSH, SMALLEST_PUSH = 0.02, 1e-5
# Steps over which this load is added, between two looks at the motion, and the largest number.
PUSH_STEPS, LOOK, MOST_STEPS = 500, 100, 60_000
# Inertial number of the strain at rest.
STILL = 2e-8
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
    """A motion at constant load, from an equilibrium that was lost.

    Attributes
    ----------
    status : {'at rest', 'failed', 'not at rest'}
        'at rest': the packing found another equilibrium under the same load, a snap. 'failed':
        strain rate and kinetic energy grew over the last two doublings of the strain, beyond a
        strain of 1e-3. 'not at rest': neither within 60,000 steps.
    lost, load : float
        Load of the direction at which the equilibrium was lost, and under which it moved: a
        fiftieth more.
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
) -> Sustained:
    """Load a packing along directions of stress until it fails.

    Each direction of `P'`, with no strain outside of the subspace, is followed from event to event.
    Where the equilibrium is lost (no regimes of a contact agree, or the control asks for ever more
    strain) the load is raised by a fiftieth and kept constant, and the equations of motion decide:
    the packing comes to rest in another equilibrium, a snap, and is loaded further; or its strain
    rate and its kinetic energy keep growing, and it has failed.

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
        Snaps after which a direction is left 'unfinished'.
    faces : Faces, optional
        Faces of the graph, if known.
    follow : callable, optional
        Follows the directions (D, m) to the largest load, by default one after the other.
    planes, plane_force
        Contacts with walls, as in `stability.follow`; between walls the subspace is diagonal.

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
) -> LoadPath:
    """One direction of `sustain`."""
    stage = stage_along(direction, subspace, "stress", largest)
    solver = _LoadPathSolver(graph, law, stage, interval, most_snaps, faces, planes, plane_force)
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

    def __init__(
        self,
        graph: GrainGraph,
        law: ContactLaw,
        stage: Stage,
        interval: float,
        most_snaps: int,
        faces: Faces,
        planes: PlaneContacts | None,
        plane_force: ArrayLike | None,
    ) -> None:
        super().__init__(graph, law, [stage], interval, "stop", planes, plane_force)
        self.faces, self.count, self.most_snaps = faces, graph.contact_count, most_snaps
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
        before, lost = self.state, self.parameter
        push = min(max(PUSH * lost, SMALLEST_PUSH * self.first_stress), stage.target - lost)
        stress, strain, rate = stage.programme.equations(self.H)
        done = stress @ (self.P - self.P_start) + strain @ (self.H - self.H_start)
        control = self._control(stage, 0.0)._replace(rate=rate * (lost + push) - done)
        motion, end = _motion(
            before, self.pairs, -self.balance, control, self.by_radii, self.faces, self.count
        )
        motion = replace(motion, lost=lost, load=lost + push, cause=cause, contact=contact)
        self.motions.append(motion)
        if motion.status != "at rest":
            self.ended = True
            return "lost", f"{cause}; {MESSAGES[motion.status]}"
        self.F = end.state.cell @ np.linalg.inv(before.cell) @ self.F
        self.pairs = end.pairs
        self._accept(end.state, push, end.work)
        self._find_regimes()
        self._list_pairs()
        self._record()
        return None


def _motion(
    state: PackingState,
    pairs: Pairs,
    load: Floats,
    control: MixedControl,
    by_radii: bool,
    faces: Faces,
    count: int,
) -> tuple[Motion, Snap]:
    """Change the control by its `rate` in a few steps, then hold it until rest or failure."""
    masses, inertias = masses_of(state.radii[: state.count])
    servo = servo_of(state, pairs, masses)
    servo = steered(servo, state, pairs, control.stress, control.strain, control.rate)
    dt = step_of(masses, pairs, state)
    moving = Moving(state, pairs, masses, inertias, lasting(servo, PUSH_STEPS * dt), by_radii)
    moving.load(load)
    pressure = 0.5 * float(np.trace(state.stress))
    slow = STILL * math.sqrt(pressure / masses.mean())
    energy, back = stored_energy(state, pairs), np.linalg.inv(state.cell)
    strains, kinetic = [0.0], [0.0]
    mode: tuple[PackingState, Pairs] | None = None
    status: MotionStatus = "not at rest"
    while status == "not at rest" and LOOK * (len(strains) - 1) < MOST_STEPS:
        ran, motion = moving.run(LOOK, dt), moving.motion
        strains.append(float(np.linalg.norm(motion.cell @ back - np.eye(2))))
        velocity, spin = motion.velocity[: state.count], motion.spin[: state.count]
        kinetic.append(0.5 * float(masses @ np.sum(velocity**2, axis=1) + inertias @ spin**2))
        if mode is None and strains[-1] >= MODE_STRAIN:
            mode = moving.state(), moving.pairs
        if not ran or strains[-1] > FLOW_STRAIN or keeps_growing(strains, kinetic):
            status = "failed"
        elif LOOK * (len(strains) - 1) > PUSH_STEPS and rests(moving, slow):
            status = "at rest"
    end = moving.state()
    work = work_of(moving, end, load, energy)
    then, listed = (end, moving.pairs) if mode is None else mode
    force = then.forces[:count] - state.forces[:count]
    branch = then.branches[:count] - state.branches[:count]
    carries, carried = (
        one.normal_force >= CARRIES * one.normal_force[one.closed].mean() for one in (then, state)
    )
    slides, old = _slides(then, listed), len(pairs)
    slides[:old] &= ~_slides(state, pairs)
    found = Motion(
        status=status,
        lost=math.nan,
        load=math.nan,
        cause="",
        contact=-1,
        strain=(np.eye(2) - end.cell @ back).ravel(),
        released=float(work[3]),
        kinetic=max(kinetic),
        steps=LOOK * (len(strains) - 1),
        displacement=(then.x - state.x @ (then.cell @ back).T)[: state.count],
        opened=int(np.count_nonzero(carried & ~then.closed[:old])),
        closed=int(np.count_nonzero(carries) - np.count_nonzero(carries[:old] & state.closed)),
        slid=int(np.count_nonzero(slides)),
        loop_work=loop_sums(-0.5 * np.sum(force * branch, axis=1), faces),
    )
    return found, Snap(end, moving.pairs, work)


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


def _slides(state: PackingState, pairs: Pairs) -> Flags:
    """(P,) contacts on the friction limit."""
    limit = AT_YIELD * strength(pairs, state)
    return np.asarray((state.normal_force > 0) & (np.abs(state.shear_force) >= limit))
