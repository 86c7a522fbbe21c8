"""A packing probed along many directions: stress envelope, second-order work, cones, loops.

`probe` answers with rates, `probe_to` follows each direction by events to an amplitude.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops import Faces, find_faces
from loops.arrays import Flags, Floats, Integers, one_blas_thread
from loops.contacts import contacts_at_start
from loops.errors import InputError, check_choice, counted, number, short, whole_number
from loops.scene import Scene, Subject, scene_of
from loops.shown import Shown
from loops.system import System
from loops.validation import finite, real
from stability.complementarity import STARTS
from stability.destabilising import LinearControl, control_along, no_control
from stability.directional.branches import plane_directions, unit_directions
from stability.packing.equations_of_motion import require_upright
from stability.packing.loop_quantities import loop_changes, loop_sums
from stability.packing.regime_regions import (
    NEUTRAL,
    Cones,
    DirectionAnswer,
    Driven,
    RegimeRegions,
    Subspace,
    cones,
)
from stability.packing.response import YIELD_BAND, PackingRates, PackingResponse, rate_problem
from stability.path import Path
from stability.programmes import NOTHING, Programme, Stage, direction_control
from stability.solution_branch import TURN
from stability.spectra import subspace_basis

# Turn from one point of the spiral on the sphere to the next.
GOLDEN = np.pi * (3.0 - 5.0**0.5)
# What each direction's response tells of its search.
TOLD = ("status", "proof", "residual", "sliding", "disagreeing")
# Searches times the cube of the contacts at yield: some 20 s of a processor.
SEARCH_WORK = 1.5e10


class Solutions(NamedTuple):
    """S solutions of all directions, compression positive.

    `direction` (S,) is the number of each one's direction, `strain_rate` and `stress_rate`
    (S, 2, 2) are its `H'` and nominal `P'`, `normalised` (S,) is its second-order work over the
    sizes of both in the subspace, `sliding` (S,) the number of contacts that slide.
    """

    direction: Integers
    strain_rate: Floats
    stress_rate: Floats
    normalised: Floats
    sliding: Integers

    @property
    def work(self) -> Floats:
        """(S,) `W2 = P':H'`."""
        return np.asarray(np.sum(self.strain_rate * self.stress_rate, axis=(1, 2)))


@dataclass(frozen=True, eq=False, repr=False)
class Probe(Shown):
    """Answers of a packing along D directions of an m-dimensional subspace, compression positive.

    Values that depend on the regimes are not numbers where `determined` is False.

    Attributes
    ----------
    control : {'strain', 'stress'}
        Which of `H'` and `P'` runs over the unit circle or sphere.
    subspace : {'diagonal', 'symmetric'}
        `diagonal`: (11, 22) on a circle. `symmetric`: (11, 22, (12 + 21)/sqrt 2) on a sphere.
        Strain outside of it is zero under either control.
    directions : (D, m) array
        Unit directions.
    status, proof : (D,) array of str
        As `PackingResponse.status` and `.proof`: what the status stands on.
    residual : (D,) array
        Out-of-balance force rate over that of the affine motion.
    sliding, disagreeing : (D,) array of int
        Contacts that slide; candidates whose regime doesn't agree with their rates.
    strain_rate, stress_rate : (D, 2, 2) array
        `H'` and the nominal `P'` (force per length, times a strain).
    work, normalised : (D,) array
        `W2 = P':H'` of the sample, and over the sizes of both rates in the subspace.
    elastic_strain, elastic_stress : (D, 2, 2) array
        The same with all contacts at yield sticking.
    elastic_tangent : (4, 4) array
        Its `A` of `P' = A H'`, order 11, 12, 21, 22.
    piece : (D,) array of int
        Number of the set of regimes; -1 where undetermined.
    tangents : (N, m, m) array
        Tangent of each piece on the subspace.
    arcs : (N, 2) array, radians
        In the plane, the angles between which the regimes of each piece hold: pieces join where one
        arc ends and the next begins. Not numbers in more dimensions.
    cones : (M, 2) array
        In the plane, the angles between which `W2 < 0`; those narrower than the step between
        directions may be missed.
    refined : (M, 2) array of bool
        Whether `W2` vanishes there; False where it jumps from one solution to another, where the
        next directions are undetermined, or where there is no end: the last angle with `W2 < 0`.
    unstable_fraction : float
        Share of directions with `W2 < 0`: in the plane the width of the cones, a lower bound where
        others are undetermined; else of the sampled directions that are determined.
    destabilising : LinearControl
        In the plane that of the cone's edge with the weaker reaction; else that along the softest
        direction. 'definite' where `W2 > 0` in all directions, 'undetermined' where it is in those
        that are determined.
    loop_work : (D, L) array
        `V_l w_l / V`, each loop's additive share of `work`; what is left belongs to contacts that
        are in no loop, or in one alone.
    order : (L,) array of int
        Grains of each loop.
    area : (L,) array
        Area of each loop.
    folds : (K,) array, radians
        In the plane, the angles at which a branch of solutions turns back: two solutions on one
        side, none of this branch on the other. They bound the directions without a solution.
    closed : bool
        Whether all branches that were followed returned to their start.
    solutions : Solutions
        All solutions that are known, the one reported first in each direction.
    candidates, settled : int
        Contacts that might slide; those of grains with two contacts that are within the yield band
        and inside the cone: they stick.
    system : System
        The carrying part.
    """

    shown = ("control", "directions", "status", "work", "normalised", "unstable_fraction")

    control: Driven
    subspace: Subspace
    directions: Floats
    status: NDArray[np.str_]
    proof: NDArray[np.str_]
    residual: Floats
    sliding: Integers
    disagreeing: Integers
    strain_rate: Floats
    stress_rate: Floats
    work: Floats
    normalised: Floats
    elastic_strain: Floats
    elastic_stress: Floats
    elastic_tangent: Floats
    piece: Integers
    tangents: Floats
    arcs: Floats
    cones: Floats
    refined: Flags
    unstable_fraction: float
    destabilising: LinearControl
    loop_work: Floats
    order: Integers
    area: Floats
    folds: Floats
    closed: bool
    solutions: Solutions
    candidates: int
    settled: int
    system: System

    @property
    def theta(self) -> Floats:
        """(D,) angle of the direction in the (11, 22) plane, 0 to 2 pi."""
        return np.asarray(np.mod(np.arctan2(self.directions[:, 1], self.directions[:, 0]), TURN))

    @property
    def determined(self) -> Flags:
        """(D,) whether the rate problem has a solution that could be found."""
        return self.piece >= 0

    @property
    def softest(self) -> int | None:
        """Number of the direction with the smallest normalised work; None if none is determined."""
        return int(np.nanargmin(self.normalised)) if self.determined.any() else None

    @property
    def between_folds(self) -> Floats:
        """(D, 2) folds before and after each direction without a solution; else not numbers.

        Nor where a branch did not close: what lies beyond its end is unknown.
        """
        bounds = np.full((len(self.directions), 2), np.nan)
        if self.closed and len(self.folds):
            around = np.concatenate([self.folds[-1:] - TURN, self.folds, self.folds[:1] + TURN])
            open_ones = np.isin(self.status, ("none", "none found"))
            after = np.searchsorted(around, self.theta[open_ones], side="right")
            bounds[open_ones] = np.mod(np.column_stack([around[after - 1], around[after]]), TURN)
        return bounds

    def __str__(self) -> str:
        unknown = int(np.count_nonzero(~self.determined))
        least = "unknown" if self.softest is None else f"{self.normalised[self.softest]:.3g}"
        return (
            f"probe: {counted(len(self.directions), 'direction')}, {unknown} undetermined, "
            f"smallest w2 {least}, W2 < 0 in {100 * self.unstable_fraction:.3g} % of directions"
        )


@one_blas_thread()
def probe(
    subject: Subject | PackingRates,
    directions: ArrayLike = 72,
    *,
    control: Driven = "strain",
    subspace: Subspace = "diagonal",
    yield_band: float = YIELD_BAND,
    faces: Faces | None = None,
    starts: int = STARTS,
    progress: Callable[[int], None] | None = None,
) -> Probe:
    """Probe a packing: its response in many directions from one state.

    Each direction is the rate problem of `rates_at` with its own regimes. One factorisation
    serves them all: what slides is an update of small rank.

    Parameters
    ----------
    subject : Scene, Snapshot or PackingRates
        The packing, in one state; or its rate problem, whose yield band is chosen.
    directions : int or (D, m) array_like
        Number of directions, evenly around the circle from axis 11 on (`diagonal`) or on a spiral
        over the sphere (`symmetric`); or the directions themselves, of any length.
    control : {'strain', 'stress'}
        Whether the directions are those of `H'` or of `P'`.
    subspace : {'diagonal', 'symmetric'}
        Where the directions live, m = 2 or 3.
    yield_band : float
        Contacts with `|T| >= yield_band mu N` may slide, 0 to 1. It stands for the amplitude.
    faces : Faces, optional
        Faces of the graph; found if left out.
    starts : int
        As in `rates_at`.
    progress : callable, optional
        Called after each direction with the number of those that are done.

    Returns
    -------
    Probe

    Raises
    ------
    InputError
        If the packing floats, an option is unknown, there is no direction, or one is zero.

    Examples
    --------
    A square lattice of discs carries either axis alone:

    >>> import numpy as np
    >>> from loops import GrainGraph, LinearFrictional, Scene
    >>> lattice = GrainGraph(x=[[0, 0], [1, 0], [0, 1], [1, 1]], radii=[0.5] * 4,
    ...     contacts=[[0, 1], [1, 0], [2, 3], [3, 2], [0, 2], [2, 0], [1, 3], [3, 1]],
    ...     images=[[0, 0], [1, 0], [0, 0], [1, 0], [0, 0], [0, 1], [0, 0], [0, 1]],
    ...     cell=2 * np.eye(2), normal_force=np.full(8, 0.01))
    >>> found = probe(Scene(lattice, LinearFrictional(1.0, 0.5, 0.5)), 8)
    >>> print(found)
    probe: 8 directions, 0 undetermined, smallest w2 1, W2 < 0 in 0 % of directions
    """
    if isinstance(subject, PackingRates):
        rates, found = subject, faces or find_faces(subject.system.graph)
    else:
        scene = scene_of(subject)
        rates, found = rate_problem(scene, yield_band=yield_band), faces or scene.faces
    check_choice("control", control, get_args(Driven))
    check_choice("subspace", subspace, get_args(Subspace))
    pieces = RegimeRegions(rates, control, subspace, starts)
    wanted = probe_directions(directions, subspace)
    answers = _answers(pieces, wanted, progress)
    rows = [answer.response for answer in answers]
    piece = np.array([answer.piece for answer in answers])
    loop_work = np.array([additive_work(row, found) for row in rows])
    strain, stress = (
        np.array([getattr(row, name) for row in rows]) for name in ("strain_rate", "stress_rate")
    )
    for values in (strain, stress, loop_work):
        values[piece < 0] = np.nan
    elastic = np.array([pieces.elastic(direction) for direction in wanted])
    normalised = np.array([answer.normalised for answer in answers])
    around, known = cones(pieces, wanted, answers), normalised[piece >= 0]
    every = np.concatenate([answer.rates for answer in answers])
    solutions = Solutions(
        np.repeat(np.arange(len(answers)), [len(answer.slides) for answer in answers]),
        every[:, 0].reshape(-1, 2, 2),
        every[:, 1].reshape(-1, 2, 2),
        pieces.normalised(every),
        np.concatenate([answer.slides for answer in answers]),
    )
    if around is None:
        around = Cones(np.empty((0, 2)), np.empty((0, 2), dtype=bool))
        share = np.sum(known < -NEUTRAL) / max(len(known), 1)
    else:
        share = np.ptp(around.ends, axis=1).sum() / TURN
    return Probe(
        control=control,
        subspace=subspace,
        directions=wanted,
        **{name: np.array([getattr(row, name) for row in rows]) for name in TOLD},
        strain_rate=strain,
        stress_rate=stress,
        work=np.sum(strain * stress, axis=(1, 2)),
        normalised=normalised,
        elastic_strain=elastic[:, 0],
        elastic_stress=elastic[:, 1],
        elastic_tangent=rates.elastic.tangent,
        piece=piece,
        tangents=np.array(pieces.tangents).reshape(-1, *[len(pieces.basis)] * 2),
        arcs=np.array(pieces.arcs).reshape(-1, 2),
        cones=around.ends,
        refined=around.refined,
        unstable_fraction=float(share) if len(known) else float("nan"),
        destabilising=_destabilising(pieces, around, wanted, normalised),
        loop_work=loop_work,
        order=found.order[found.loops],
        area=found.area[found.loops],
        folds=pieces.folds,
        closed=all(branch.closed for branch in pieces.branches),
        solutions=solutions,
        candidates=len(rates.rows),
        settled=rates.settled,
        system=rates.system,
    )


def _answers(
    pieces: RegimeRegions, wanted: Floats, progress: Callable[[int], None] | None
) -> list[DirectionAnswer]:
    """Answer all directions; `progress` is told how many are done."""
    answers: list[DirectionAnswer] = []
    branches: list[int] = []
    step = search_step(len(pieces.rates.every), len(wanted)) if pieces.traced else 1
    for k, direction in enumerate(wanted):
        branches.append(len(pieces.branches))
        answers.append(pieces.at(direction, None if k % step == 0 else 0))
        if progress is not None:
            progress(len(answers))
    # A branch that this or a later direction led to may have more solutions here.
    for k, direction in enumerate(wanted):
        if pieces.traced and pieces.sets(direction, branches[k]):
            again = pieces.at(direction, 0)
            answers[k] = again if again.piece >= 0 else answers[k]
    return answers


def search_step(candidates: int, directions: int) -> int:
    """Return every how many directions solutions are searched, besides those of branches.

    1 up to 592 contacts at yield, with 72 directions.
    """
    return max(1, int(np.ceil(directions * candidates**3 / SEARCH_WORK)))


def probe_directions(directions: ArrayLike, subspace: Subspace) -> Floats:
    """Return unit directions (D, m), given or evenly spread."""
    given, m = real("directions", directions), len(subspace_basis(subspace))
    if given.ndim == 0:
        count = whole_number("directions", directions, 1)
        k = np.arange(count)
        if m == 2:
            return plane_directions(TURN * k / count)
        z = 1.0 - (2.0 * k + 1.0) / count
        ring, phi = np.sqrt(1.0 - z**2), GOLDEN * k
        return np.column_stack([ring * np.cos(phi), ring * np.sin(phi), z])
    finite("directions", given, None, m)
    if not (len(given) and np.abs(given).max(axis=1).all()):
        expected = f"(D, {m}) components of {subspace!r}, none all zero"
        raise InputError("directions", short(directions), expected, "Give them, or a number.")
    return unit_directions(given)


def additive_work(response: PackingResponse, faces: Faces) -> Floats:
    """Return `V_l w_l / V = -(1/(2 V)) sum f'.d'` of every loop (L,)."""
    contact = np.sum(response.force_rate * response.branch_rate, axis=1)
    return -0.5 / response.system.volume * loop_sums(contact, faces)


def _destabilising(
    pieces: RegimeRegions, around: Cones, directions: Floats, normalised: Floats
) -> LinearControl:
    edges = [plane_directions(angle) for angle in around.ends[around.refined]]
    controls = [control_along(*pieces.tangent_along(edge)) for edge in edges]
    if controls:
        return min(controls, key=lambda one: one.reaction)
    negative = np.flatnonzero(normalised < -NEUTRAL)
    if len(negative) == 0:
        known = np.isfinite(normalised).all()
        return no_control("definite" if known else "undetermined", len(pieces.basis))
    softest = directions[negative[np.argmin(normalised[negative])]]
    return control_along(*pieces.tangent_along(softest))


# Function that follows stages and returns their paths in order.
FollowStages = Callable[[Sequence[Stage]], Sequence[Path]]


def probe_to(found: Probe, scene: Scene, amplitude: float, follow: FollowStages) -> Probe:
    """Follow each direction of the probe by events until what is driven has grown so much.

    Parameters
    ----------
    found : Probe
        Directions, control, subspace and elastic answers are kept.
    scene : Scene
        The packing that was probed.
    amplitude : float
        Strain, or stress under stress control.
    follow : callable
        Function that follows the stages, one a direction, as `stability.follow` does, and returns
        their paths in order.

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
    paths = follow(stages)
    # Forces at the start of a path are those of the geometry.
    first, count = paths[0].states[0], graph.contact_count
    start = graph.replace(
        normal_force=first.normal_force[:count], shear_force=first.shear_force[:count]
    )
    changes = [loop_changes(start, path.states[-1], scene.faces) for path in paths]
    slides = [path.state.at_limit()[: len(at_start.contacts)] for path in paths]
    kept = [{event.contacts for event in path.of_kind("instability")} for path in paths]
    return _over_amplitude(
        found,
        np.array([path.status == "finished" for path in paths]),
        [(path.H[-1] - path.H[0]) / amplitude for path in paths],
        [(path.P[-1] - path.P[0]) / amplitude for path in paths],
        [one.additive_work * found.area / found.system.volume / amplitude**2 for one in changes],
        status=np.array([path.status for path in paths]),
        residual=np.array([path.imbalance[-1] for path in paths]),
        sliding=np.count_nonzero(slides, axis=1),
        disagreeing=np.array([len(contacts) for contacts in kept]),
    )


def probe_by_increment(found: Probe, rates: PackingRates, faces: Faces, amplitude: float) -> Probe:
    """Answer each direction of the probe over an amplitude in one solve.

    Parameters
    ----------
    found : Probe
        Directions, control, subspace and elastic answers are kept.
    rates : PackingRates
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
    answers = [
        rates.increment(direction_control(one, found.subspace, found.control))
        for one in amplitude * found.directions
    ]
    return _over_amplitude(
        found,
        np.array([answer.status != "not converged" for answer in answers]),
        [answer.strain_rate.ravel() / amplitude for answer in answers],
        [answer.stress_rate.ravel() / amplitude for answer in answers],
        [additive_work(answer, faces) / amplitude**2 for answer in answers],
        **{name: np.array([getattr(answer, name) for answer in answers]) for name in TOLD},
        candidates=len(rates.nearest.rows),
        settled=rates.settled,
    )


def _over_amplitude(
    found: Probe,
    done: Flags,
    strains: Sequence[Floats],
    stresses: Sequence[Floats],
    loop_work: Sequence[Floats],
    **rest: Any,
) -> Probe:
    """Return the probe with increments (4,) over the amplitude, and nothing of the rates.

    They count where they are `done`.
    """
    basis, m = subspace_basis(found.subspace).T, found.directions.shape[1]
    strain, stress, loops = (
        np.where(done[:, None], values, np.nan) for values in (strains, stresses, loop_work)
    )
    work = np.sum(strain * stress, axis=1)
    sizes = np.linalg.norm(strain @ basis, axis=1) * np.linalg.norm(stress @ basis, axis=1)
    normalised = work / sizes
    known = normalised[done]
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
        loop_work=loops,
        **rest,
    )


def stage_along(direction: Floats, subspace: Subspace, driven: Driven, amplitude: float) -> Stage:
    """Return the stage that drives one direction of the subspace, with no strain outside of it."""
    control = direction_control(direction, subspace, driven)
    return Stage(Programme("probe", *control), "parameter", amplitude)
