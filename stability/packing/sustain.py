"""The load that a packing sustains along directions of stress, and its first large motion."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from time import thread_time
from typing import Any, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops.arrays import Floats, one_blas_thread
from loops.contacts import Contacts, contacts_at_start
from loops.errors import check_choice, counted, number, whole_number
from loops.faces import Faces
from loops.graph import GrainGraph
from loops.scene import Scene, of_scene
from loops.shown import Shown
from stability.packing.equations_of_motion import (
    REST_FORCE_LOADED,
    Moving,
    lasting,
    masses_of,
    rests,
    servo_of,
    steered,
    step_of,
    work_of,
)
from stability.packing.loop_quantities import loop_sums
from stability.packing.path import PackingPathOptions, PackingPathSolver, Stop, halved
from stability.packing.point import RELEASED, PackingPoint
from stability.packing.probe import Probe, probe, probe_directions, stage_along
from stability.packing.regime_regions import Subspace
from stability.path import LARGE_MOTION, Motion, MotionStatus, Path, PathStatus
from stability.programmes import MixedControl

# Share by which the load is raised where the equilibrium is lost: of 0.002, 0.005 and 0.02 all give
# the same motion within its spread, the smaller ones more slowly (docs/sustaining.md).
PUSH = 0.005
# Largest such share: it doubles from motion to motion while they strain the sample by less
# than LITTLE of a large motion.
MOST_PUSH = 0.04
# Least rise of the load, over the stress of the start.
LEAST_PUSH = 1e-6
# Steps over which the load is raised.
PUSH_STEPS = 500
# Steps between two looks at a motion.
LOOK = 100
# Steps after which a motion that does not rest is given up.
MOST_STEPS = 60_000
LITTLE = 0.1
# Rise of the load, over itself, over which motions count as one: of two that follow each
# other within a hundredth of the load a DEM code's level sees one.
WINDOW = 0.05
# Steps after which ten times as much counts as rest: a few grains may go on in a cycle that
# friction feeds. The bottleneck after a fold takes 900. After 4,000, 8,000 and 20,000 seven
# directions of 2,000 grains have the same loads, and strains within 1e-4.
LATE_STEPS = 8_000
LATE = 10.0
# Strain of a motion from which on it is given up: the sample flows.
FLOW_STRAIN = 0.02
# Time step over that of a replay, where this is stable.
STRIDE = 2.5
# Moment of inertia over `m r^2`. All grains have the mean mass of discs of unit density: one that
# is light or turns fast would ask for short steps, and rest alone matters. It comes in 40 % fewer
# steps; strains differ from those with masses of discs by 4 to 7 %, as with another damping.
INERTIA = 0.8
# Inertial number of the strain at rest. With 2e-8 the bottleneck after a fold counted as rest.
STILL = 2e-10
# Largest error of the stress along the direction, over its rise: else the interval is cut.
LOAD_ERROR = 5e-3
# Factor by which an interval is cut, and how often at most, before a lost equilibrium is believed.
CUT = 4.0
MOST_CUTS = 3
# No number of instabilities ends a path: each one does.
MANY = 1_000_000
# A motion of less strain is no loss of the sample's equilibrium, but of a few grains: whether an
# interval meets it hangs on its length.
MICRO_STRAIN = 1e-5
# Strain of a motion up to which its displacements are the mode.
MODE_STRAIN = 2e-5
# Contacts with less than this share of the mean normal force do not count as opened or closed.
CARRIES = 0.01
# Default of the largest load, over the mean stress.
DEFAULT_LARGEST = 0.1
# Default of the strain from which on a motion is large.
LARGE = 3e-4
# Numberings of grains and contacts, and damping, of the runs that tell the spread.
NUMBERINGS = (1, 2)
LESS_DAMPING = 1.0 / 3.0
# Shares of the interval in the runs in which grains without load coast. A grain that is caught or
# not makes limits of one sample fall by 0.6 %, in shorter and shorter intervals and numberings
# alike, so there are two; in whole intervals limits are up to 1 % off those of short ones.
COASTING_INTERVALS = (1.0 / 5.0, 1.0 / 7.0)
# A motion that strains by this share of a large one counts as large too, for the spread.
NEARLY_LARGE = 1.0 / 3.0


@dataclass(frozen=True, eq=False, repr=False)
class Sustained(Shown):
    """The loads that a packing sustains around a state.

    Attributes
    ----------
    scene : Scene
        The packing at the start.
    subspace : {'diagonal', 'symmetric'}
        Plane (11, 22) of the stress directions, or with shear.
    directions : (D, m) array
        Unit directions of `P'`.
    largest : float
        Load up to which each was followed (force per length).
    paths : tuple of Path
        One a direction, without states.
    stress : (2, 2) array
        Stress of the start.
    """

    scene: Scene
    subspace: Subspace
    directions: Floats
    largest: float
    paths: tuple[Path, ...]
    stress: Floats

    def facts(self) -> dict[str, object]:
        """Facts that the prompt and a notebook show."""
        loads = f"{counted(len(self.paths), 'direction')} up to {self.largest:.4g} (force/length)"
        told: dict[str, object] = {"load": loads, **Counter(self.status.tolist())}
        for name in ("first_large_load", "limit"):
            known = getattr(self, name)[~np.isnan(getattr(self, name))]
            if len(known):
                told[f"least {name}"] = f"{known.min():.4g} (force/length)"
        return told

    @cached_property
    def rates(self) -> Probe:
        """Answers of the rate problem of the start along the same directions of stress."""
        return probe(self.scene, self.directions, control="stress", subspace=self.subspace)

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
    def first_large_load(self) -> Floats:
        """(D,) loads of the first large motions, nan where there was none."""
        return np.array([path.first_large_load for path in self.paths])

    @property
    def limit(self) -> Floats:
        """(D,) stresses at which the equilibrium was first lost, nan where it never was."""
        return np.array([path.limit for path in self.paths])


# A function that loads directions, and returns their paths in order.
Follow = Callable[[Floats, "Loading"], Sequence[Path]]


class Loading(NamedTuple):
    """Options of `sustain` that one direction needs; `most_motions` is its `most_snaps`."""

    subspace: Subspace
    largest: float
    interval: float
    large: float
    most_motions: int
    spread: bool
    damping: float = 0.3
    coasting: bool = False


@of_scene
def sustain(
    scene: Scene,
    directions: ArrayLike = 24,
    *,
    subspace: Subspace = "diagonal",
    largest: float | None = None,
    interval: float = 5e-6,
    large: float = LARGE,
    most_snaps: int = 30,
    spread: bool = True,
    faces: Faces | None = None,
    follow: Follow | None = None,
    damping: float = 0.3,
) -> Sustained:
    """Load a packing along directions of stress until its first large motion.

    Each direction of `P'`, with no strain outside of the subspace, is followed from event to event.
    Where the equilibrium is lost (no regimes of a contact agree, or the control asks for ever more
    strain) the load is raised by a two-hundredth and kept constant, and the equations of motion
    decide: the packing comes to rest in another equilibrium and is loaded further, or it does not.
    The first motion with a strain of `large`, those over the last 5 % of the load included, or
    without rest, ends the direction.

    Parameters
    ----------
    scene : Scene or Snapshot
        One state in equilibrium, periodic or between walls, whose subspace is diagonal: bring
        another to rest with `hold` first. The law is linear, Hertz and Mindlin's, or one of your
        own.
    directions : int or (D, m) array_like
        How many, evenly spread; or the directions themselves (m = 2, or 3 with shear).
    subspace : {'diagonal', 'symmetric'}
        Components (11, 22), or (11, 22, (12 + 21)/sqrt 2).
    largest : float, optional
        Load (force per length) up to which each direction is followed; by default a tenth of the
        mean stress.
    interval : float
        Strain over which the geometry is kept. It is cut where the stress leaves the load by more
        than 0.5 %, and halved again before the first loss until that changes by less than 1 %.
    large : float
        Strain from which on a motion is large.
    most_snaps : int
        Smaller motions after which a direction is left 'unfinished'.
    spread : bool
        Whether to load directions with a large motion again: with two other numberings of grains
        and contacts, with a third of the damping, and with grains that carry nothing going on as
        they were pushed, in short intervals; four to fourteen times the cost.
    faces : Faces, optional
        Faces of the graph, if known.
    follow : callable, optional
        Follows the directions (D, m), given a `Loading`, by default one after the other.
    damping : float
        Cundall's damping of the motions.

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
    >>> from loops import GrainGraph, LinearFrictional, Scene
    >>> lattice = GrainGraph(x=[[0, 0], [1, 0], [0, 1], [1, 1]], radii=[0.505] * 4,
    ...     contacts=[[0, 1], [1, 0], [2, 3], [3, 2], [0, 2], [2, 0], [1, 3], [3, 1]],
    ...     images=[[0, 0], [1, 0], [0, 0], [1, 0], [0, 0], [0, 1], [0, 0], [0, 1]],
    ...     cell=2 * np.eye(2), normal_force=np.full(8, 0.01))
    >>> scene = Scene(lattice, LinearFrictional(1.0, 0.5, 0.5))
    >>> found = sustain(scene, [[-1, 0], [1, 0]], largest=0.02, interval=1e-4)
    >>> found.status.tolist(), found.limit.round(6).tolist()
    (['large motion, no rest', 'held'], [0.01, nan])
    """
    start = contacts_at_start(scene)
    check_choice("subspace", subspace, get_args(Subspace))
    number("interval", interval, 0.0, open_low=True)
    number("large", large, 0.0, open_low=True)
    whole_number("most_snaps", most_snaps, 0)
    number("damping", damping, 0.0, 1.0, open_low=True, open_high=True)
    unit = probe_directions(directions, subspace)
    if largest is None:
        largest = DEFAULT_LARGEST * start.pressure
    number("largest", largest, 0.0, open_low=True)
    loading = Loading(subspace, largest, interval, large, most_snaps, spread, damping)
    if follow is None:
        found = scene.faces if faces is None else faces
        paths: Sequence[Path] = [load_path(scene, one, loading, found) for one in unit]
    else:
        paths = follow(unit, loading)
    return Sustained(scene, subspace, unit, largest, tuple(paths), start.stress)


@one_blas_thread()
def load_path(scene: Scene, direction: Floats, loading: Loading, faces: Faces | None) -> Path:
    """Return the path along one direction of `sustain`, with its spread."""
    path = _loaded(scene, direction, loading, faces)
    if not (loading.spread and path.status in LARGE_MOTION):
        return path
    begin = thread_time()
    less = loading._replace(damping=loading.damping * LESS_DAMPING)
    nearly = NEARLY_LARGE * loading.large
    coasting = [
        loading._replace(coasting=True, interval=share * loading.interval, large=nearly)
        for share in COASTING_INTERVALS
    ]
    others = [_loaded(scene, direction, how, None) for how in (less, *coasting)]
    others += [_loaded(renumbered(scene, one), direction, loading, None) for one in NUMBERINGS]
    limits = [abs(other.limit / path.limit - 1.0) for other in others[1:]]
    loads = [other.first_large_load for other in others]
    loads += [_first_load(one.motions, nearly) for one in (path, *others)]
    reached = np.where(np.isnan(loads), loading.largest, loads)
    return replace(
        path,
        limit_spread=float(np.nanmax([path.limit_spread, *limits])),
        first_large_spread=float(np.abs(reached / path.first_large_load - 1.0).max()),
        spread_seconds=path.spread_seconds + thread_time() - begin,
    )


def renumbered(scene: Scene, seed: int) -> Scene:
    """Return the packing with its grains and contacts in another order."""
    graph, boundary = scene.graph, scene.boundary
    rng = np.random.default_rng(seed)
    grains, rows = rng.permutation(graph.grain_count), rng.permutation(graph.contact_count)
    place, images = np.argsort(grains), graph.images
    other = GrainGraph(
        x=graph.x[grains],
        radii=graph.radii[grains],
        contacts=place[graph.contacts[rows]],
        images=None if images is None else images[rows],
        cell=graph.cell,
        **graph.at_contacts(rows),
    )
    return Scene(other, scene.law.take(rows), boundary.of_kept(grains, len(grains)))


def _loaded(scene: Scene, direction: Floats, loading: Loading, faces: Faces | None) -> Path:
    """Load one direction until its first large motion; modes of the loops of these faces."""
    begin, halving = thread_time(), 0.0
    stage = stage_along(direction, loading.subspace, "stress", loading.largest)
    options = PackingPathOptions(loading.interval, MANY, "stop")
    solver = PackingPathSolver(scene, [stage], options, loading.coasting)
    solver.start_stage(0, stage, 1)
    motions: list[Motion] = []
    status: PathStatus = "held"
    message = "no large motion up to the largest load"
    push, load, change, near = PUSH, 0.0, math.nan, math.nan
    while solver.point.targets and load < stage.target:
        stop = _to_loss(solver, loading.interval)
        if stop is not None and math.isnan(_first_loss(motions)):
            halving -= thread_time()
            load_of_loss = partial(_load_of_loss, solver)
            stop, _, change = halved(solver, stop, partial(_to_loss, solver), load_of_loss)
            halving += thread_time()
        if stop is None or not solver.point.targets:
            break
        lost, cause = _load_of_loss(solver), stop[1]
        if len(motions) == loading.most_motions:
            status = "unfinished"
            message = f"more than {counted(loading.most_motions, 'motion')} before the largest load"
            break
        here = solver.point
        rise = max(push * here.parameter, LEAST_PUSH * here.first_stress)
        load = min(here.parameter + rise, stage.target)
        control = here.control_to(load)
        contact = here.events[-1].contacts[0] if stop[0] == "instabilities" else -1
        told = {"lost": lost, "load": load, "cause": cause, "contact": contact}
        motion, end, work = move(here, control, loading.damping, faces, **told)
        motions.append(motion)
        little = float(np.linalg.norm(motion.strain)) < LITTLE * loading.large
        push = min(2.0 * push, MOST_PUSH) if little else PUSH
        solver.go_on_from(end, work, load - here.parameter)
        solver.record()
        rests = motion.status == "at rest"
        near = _strain_of_near(motions if rests else [motion])
        if near >= loading.large or not rests:
            status = LARGE_MOTION[not rests] if near >= loading.large else "unfinished"
            flows = f"; no rest at constant load, strain {near:.2g}"
            message = cause if rests else cause + flows
            break
    limit, spread = _limit(motions, change)
    path = solver.path(status, message)
    resting = np.ones(len(path), dtype=bool)
    resting[-1] = not motions or motions[-1].status == "at rest"
    return replace(
        path,
        direction=direction,
        limit=limit,
        limit_spread=spread,
        first_large_strain=near if status in LARGE_MOTION else math.nan,
        motions=tuple(motions),
        resting=resting,
        states=(),
        seconds=thread_time() - begin - halving,
        spread_seconds=halving,
    )


def _strain_of_near(motions: Sequence[Motion]) -> float:
    """Return the strain of the last motion and of those over the last 5 % of its load together."""
    near = [one.strain for one in motions if one.load > motions[-1].load / (1.0 + WINDOW)]
    return float(np.linalg.norm(np.sum(near, axis=0)))


def _first_load(motions: Sequence[Motion], least: float) -> float:
    """Return the load of the first motion of a strain, those before it included; nan if none."""
    ends = range(1, 1 + len(motions))
    found = (motions[k - 1].load for k in ends if _strain_of_near(motions[:k]) >= least)
    return next(found, math.nan)


def _first_loss(motions: Sequence[Motion], least: float = MICRO_STRAIN) -> float:
    """Return the stress at which the first motion of a strain began; nan if there is none."""
    return next((one.lost for one in motions if np.linalg.norm(one.strain) >= least), math.nan)


def _limit(motions: Sequence[Motion], change: float) -> tuple[float, float]:
    """Return the stress at which the first motion of 1e-5 began, and its spread.

    That is its `change` by half the interval, or how far motions of a third and of three times the
    strain are from it.
    """
    limit, *others = (_first_loss(motions, share * MICRO_STRAIN) for share in (1.0, 1 / 3, 3.0))
    away = [abs(other / limit - 1.0) for other in others if not math.isnan(other)]
    return limit, math.nan if math.isnan(limit) else max(change, *away, 0.0)


def _load_of_loss(solver: PackingPathSolver) -> float:
    """Return the stress along the direction; what stood before a contact pulled off is the load."""
    point = solver.point
    pulled = point.events and point.events[-1].cause == "pulls_off"
    return point.parameter if pulled else _along(point)


def _along(point: PackingPoint) -> float:
    """Stress along the direction of the stage, less that of the start."""
    stress, _, rate = point.leg.stage.programme.equations(point.H, point.P)
    rise = stress @ (point.P - point.leg.P)
    return float(rise @ rate / (rate @ rate))


def _to_loss(solver: PackingPathSolver, interval: float) -> Stop | None:
    """Go on until the equilibrium is lost, and why it was; None at the largest load.

    Shorter intervals are tried where one ends in no equilibrium, or away from its load.
    """
    size, shortest = interval, interval / CUT**MOST_CUTS
    while solver.point.targets:
        before = solver.point
        stop = solver.step(size)
        met = stop is not None and stop[0] == "instabilities"
        error = abs(_along(solver.point) - solver.point.parameter)
        least = LEAST_PUSH * before.first_stress
        away = error > LOAD_ERROR * max(solver.point.parameter, least)
        if size > shortest and ((stop is not None and not met) or away):
            solver.point, size = before, max(size / CUT, shortest)
            continue
        solver.history.append(before)
        solver.record()
        if stop is not None:
            return stop
        size = min(2.0 * size, interval)
    return None


def move(
    here: PackingPoint, control: MixedControl, damping: float, faces: Faces | None, **told: Any
) -> tuple[Motion, Contacts, Floats]:
    """Raise the load within some steps, then keep it until rest, or until the sample flows.

    Return the motion, where it ends, and the work until then as `Path.work`. What is known of the
    motion before, and the faces whose loops it tells, as in `motion_past`.
    """
    start = here.state
    radii = start.radii[: start.count]
    mass = np.full(len(radii), masses_of(radii)[0].mean())
    masses, inertias = masses_of(radii, mass, INERTIA * mass * radii**2)
    dt = step_of(masses, inertias, start, STRIDE)
    servo = steered(servo_of(start, masses), start, *control, lost=True)
    moving = Moving(start, masses, inertias, lasting(servo, PUSH_STEPS * dt))
    moving.load(here.load)
    # Strain rate of an inertial number of one.
    pace = math.sqrt(start.pressure / masses.mean())
    status: MotionStatus = "no rest"
    mode, kinetic, back = None, 0.0, np.linalg.inv(start.cell)
    for steps in range(LOOK, MOST_STEPS + LOOK, LOOK):
        ran, motion = moving.run(LOOK, dt, damping), moving.motion
        square = np.sum(motion.velocity[: start.count] ** 2, axis=1)
        turning = motion.spin[: start.count] ** 2
        kinetic = max(kinetic, 0.5 * float(masses @ square + inertias @ turning))
        strain = float(np.linalg.norm(motion.cell @ back - np.eye(2)))
        if mode is None and strain >= MODE_STRAIN:
            mode = moving.state()
        if not ran or strain > FLOW_STRAIN:
            break
        late = LATE if steps > LATE_STEPS else 1.0
        rest = late * STILL * pace, late * REST_FORCE_LOADED
        if steps > PUSH_STEPS and rests(moving, *rest):
            status = "at rest"
            break
    end = moving.state()
    work = work_of(moving, end)
    told |= {"status": status, "released": float(work[RELEASED]), "kinetic": kinetic}
    then = end if mode is None else mode
    return motion_past(start, then, end, faces, steps=steps, **told), end, work


def motion_past(
    start: Contacts, then: Contacts, end: Contacts, faces: Faces | None, **told: Any
) -> Motion:
    """Return a motion from its start to its end, its mode `then`; without faces none of loops."""
    old, back = len(start.contacts), np.linalg.inv(start.cell)
    change = np.sum((then.forces[:old] - start.forces) * (then.branches[:old] - start.branches), 1)
    carries, carried = (
        np.abs(one.normal_force) >= CARRIES * np.abs(one.normal_force[one.closed]).mean()
        for one in (then, start)
    )
    slides = then.at_limit()
    slides[:old] &= ~start.at_limit()
    return Motion(
        strain=(np.eye(2) - end.cell @ back).ravel(),
        displacement=(then.x - start.x @ (then.cell @ back).T)[: start.count],
        opened=int(np.count_nonzero(carried & ~then.closed[:old])),
        closed=int(np.count_nonzero(carries) - np.count_nonzero(carries[:old] & start.closed)),
        slid=int(np.count_nonzero(slides)),
        loop_work=np.zeros(0) if faces is None else loop_sums(-0.5 * change, faces),
        **told,
    )
