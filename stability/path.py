"""A path and its events, and the run through the stages of a programme."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence, Sized
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from loops.arrays import Flags, Floats, Integers, Regimes
from loops.errors import InputError, counted
from loops.shown import Shown, brief
from stability.programmes import Stage
from stability.regimes import SEARCH_LIMIT
from stability.spectra import COMPONENTS, restrict, spectrum, symmetric_part, symmetric_spectrum

if TYPE_CHECKING:
    from loops.contacts import Contacts

EventKind = Literal[
    "yield",
    "unloading",
    "opening",
    "closing",
    "opposite_contact",
    "det_Ks_zero",
    "det_K_zero",
    "flutter",
    "control_limit",
    "branching",
    "programme_change",
    "instability",
]
# Antisymmetric parts of a matrix of candidates below this share are rounding of its columns.
SYMMETRIC = 1e-8
# Kinds that change the regimes of contacts.
CHANGES: tuple[EventKind, ...] = ("yield", "unloading", "opening", "closing")
Spring = Literal["shear", "rolling"]
How = Literal["", "dragged", "held", "replayed", "stopped", "lost"]
Cause = Literal[
    "",
    "start",
    "stage_end",
    "extremum",
    "turns_back",
    "singular",
    "inconsistent",
    "never_consistent",
    "no_regimes",
    "none_found",
    "undecided",
    "chatters",
    "rattles",
    "unloaded",
    "pulls_off",
]
# Each cause of an event in words.
CAUSES: dict[Cause, str] = {
    "": "",
    "start": "from the start",
    "stage_end": "at the end of the stage",
    "extremum": "the loading parameter has an extremum",
    "turns_back": "the loading parameter has an extremum where the regimes change",
    "singular": "the controlled system is singular",
    "inconsistent": "no choice of regimes is consistent with its own rates",
    "never_consistent": "have no regime that stays consistent with its rates",
    "no_regimes": "no regimes agree",
    "none_found": "no regimes that agree were found",
    "undecided": "neither sticking nor sliding agrees",
    "chatters": "it changes regime again and again",
    "rattles": "a loose grain rattles",
    "unloaded": "its grain carries nothing",
    "pulls_off": "it pulls off",
}
# What `Event.count` counts, in words, where it isn't eigenvalues.
COUNTED: dict[EventKind, str] = {
    "opposite_contact": "{} pairs of grains at once",
    **dict.fromkeys(CHANGES, "the rate problem has {} solutions"),
}
PathStatus = Literal[
    "finished",
    "control_limit",
    "opposite_contact",
    "no_solution",
    "no_load",
    "instabilities",
    "lost",
    "held",
    "large motion, at rest again",
    "large motion, no rest",
    "unfinished",
]
# Statuses of paths under a growing load that end with a large motion.
LARGE_MOTION: tuple[PathStatus, ...] = ("large motion, at rest again", "large motion, no rest")
MotionStatus = Literal["at rest", "no rest"]
# Grains that move by this share of the largest displacement take part in a mode.
TAKES_PART = 0.1
ModelOption = Literal["auto", "full"]
# Terms of the work along a path, see `Path.work`.
WORK_TERMS = ("external_work", "moment_work", "tangential_work", "dissipation")
FINISHED: tuple[PathStatus, str] = ("finished", "every stage reached its target")
# Ways past an instability of a packing.
Past = Literal["viscous", "dynamic", "stop"]


@dataclass(frozen=True, repr=False)
class ModelChoice(Shown):
    """Model of a path: what was left out for its symmetry; counts as 'part of whole'.

    `choice`: 'auto' for the smallest model, 'full' for all of it; `symmetry`: Point group that
    the path keeps, 'D2 (order 4)' for example, or 'none'; `freedoms`: Independent displacements of
    the centres; `spins`: Independent spins, or why there are none; `unknowns`: Size of the linear
    system of the balance, control included; `contact_orbits`: Contacts that differ;
    `branch_search`: Combinations of regimes that were solved for. Under a symmetry, of those
    motions alone that keep it: `rates_at` counts all; `branch_solves`: How many these were, those
    of rate problems without a choice included; `kernels`: 'compiled' where kernels integrate the
    path, 'plain' where numpy computes its rates; `kept`: Whether the symmetry served to the end of
    the path.
    """

    choice: ModelOption
    symmetry: str
    freedoms: str
    spins: str
    unknowns: str
    contact_orbits: str
    branch_search: str
    branch_solves: int
    kernels: str
    kept: str


@dataclass(frozen=True, repr=False)
class Event(Shown):
    """Event of a path; `describe` puts it in words.

    Attributes
    ----------
    kind : str
        'yield', 'unloading', 'opening', 'closing' (of contacts), 'opposite_contact' (grains without
        a contact touch), 'det_Ks_zero', 'det_K_zero' (an eigenvalue passes zero, continuously or in
        a jump), 'flutter' (the real part of a complex pair of K does), 'control_limit',
        'instability' (in a packing: no regimes of the contact agree),
        'branching' (the relaxed grains' balance is singular: other paths branch off, this one goes
        on), 'programme_change'.
    parameter : float
        Loading parameter, counted from the start of the path.
    stage : int
        Stage.
    index : int
        Row of the path at the event (the row before it for 'branching', and in a packing); if the
        event changes regimes or programme, this is the row before the change and the next row the
        same state after it.
    contacts : tuple of int
        Contacts concerned, or the two grains that touch, pair by pair where many do at once.
    cause : str
        Why it happened, where its kind leaves that open; a key of `CAUSES`.
    count : float
        Eigenvalues or pairs of grains that pass at once, if many do; solutions of the rate problem,
        if several; of a limit the combinations of regimes, if not all of them were tried. Else 0.
    jump : (before, after)
        Determinants of K ('det_K_zero') or numbers of negative eigenvalues of Ks ('det_Ks_zero')
        where they jump over zero with the regimes; empty where they pass it continuously.
    programme : str
        Name of the programme that begins.
    subspace : str
        Subspace whose spectrum passes zero; empty for other events.
    H, P : tuple of float
        Displacement gradient and nominal stress (11, 12, 21, 22) at the event itself, whatever the
        rows are; empty in a packing.
    spring : {'shear', 'rolling'}
        Spring of the contact that yields or unloads.
    grains : tuple of int
        Of an instability: grains that move most in its mode.
    taking_part : float
        Of an instability: participation number of the mode, in grains; nan if it has none.
    sign_changes : bool or None
        Of an instability: whether the determinant of the packing's K changes sign.
    passed : {'dragged', 'held', 'replayed', 'stopped', 'lost', ''}
        How the path went on past an instability.
    released : float
        Energy that the grains of an instability released until the interval, or the motion, ended
        (force times length); nan if it is not known.
    """

    kind: EventKind
    parameter: float
    stage: int = 0
    index: int = 0
    contacts: tuple[int, ...] = ()
    cause: Cause = ""
    count: float = 0
    jump: tuple[float, ...] = ()
    programme: str = ""
    subspace: str = ""
    H: tuple[float, ...] = ()
    P: tuple[float, ...] = ()
    spring: Spring = "shear"
    grains: tuple[int, ...] = ()
    taking_part: float = math.nan
    sign_changes: bool | None = None
    passed: How = ""
    released: float = math.nan


def describe(event: Event) -> str:
    """Return an event's further facts in words, for people alone: nothing reads them."""
    words = [reason(event), event.passed]
    if math.isfinite(event.released):
        words.append(f"{event.released:.2g} released")
    return "; ".join(word for word in words if word)


def reason(event: Event) -> str:
    """Return in words why an event happened; empty where its kind says all."""
    said = CAUSES[event.cause]
    if math.isfinite(event.taking_part):
        sign = "changes sign" if event.sign_changes else "keeps its sign"
        return f"{said}: {counted(round(event.taking_part), 'grain')} taking part, det K {sign}"
    if event.cause == "never_consistent":
        return f"contacts {list(event.contacts)} {said}"
    if event.kind == "control_limit" and event.count:
        return (
            f"{said} (of {event.count:.3g} combinations pivoting from three starts found"
            f" none; more than {SEARCH_LIMIT} are not all tried)"
        )
    if event.kind == "branching":
        return f"other paths branch off at H11 = {event.H[0]:.15g}, H22 = {event.H[3]:.15g}"
    if event.kind == "programme_change":
        return f"to {event.programme}"
    if event.jump:
        before, after = event.jump
        if event.kind == "det_K_zero":
            return f"jump: from {before:.3g} to {after:.3g}"
        return f"jump: {before:.0f} to {after:.0f} negative eigenvalues"
    if event.count:
        return COUNTED.get(event.kind, "{} eigenvalues at once").format(event.count)
    if event.spring == "rolling" and not event.cause:
        return "rolling"
    return said


def _none() -> Any:
    """Return an empty array, for what a kind of path does not have."""
    return np.zeros(0)


class Pathologies(NamedTuple):
    """Answers on the matrix of the candidates, `w = q + M z`, at one state under a control.

    Candidates are the contacts at their friction limit, `z` their slip rates (length) and `w` the
    rates at which they leave the limit (force). `asymmetry` is the size of `M - M^T` over that of
    `M`, `definite` whether the symmetric part of `M` is positive definite; `p_matrix` whether all
    principal minors are positive, so that there is exactly one solution for every `q`, None where
    it was not decided. `solutions` is the number of those found, all of them if `proved`; -1 where
    none were looked for. `w2` is the second-order work `P':H'` of the state's regimes under the
    control, over the sizes of both. `withheld` says what was not asked, and why.
    """

    candidates: int
    asymmetry: float
    definite: bool | None
    p_matrix: bool | None
    solutions: int
    proved: bool
    w2: float
    withheld: str

    @property
    def symmetric(self) -> bool | None:
        """Whether `M` is symmetric to rounding; None without a matrix."""
        return None if np.isnan(self.asymmetry) else self.asymmetry <= SYMMETRIC


@dataclass(frozen=True, eq=False, repr=False)
class Motion(Shown):
    """A motion from an equilibrium that was lost, under a constant load.

    Attributes
    ----------
    status : {'at rest', 'no rest'}
        'at rest': the packing found another equilibrium under the same load. 'no rest': it strained
        by more than 0.02, or still moved after 60,000 steps.
    lost, load : float
        Stress along the direction, less that of the start, where the equilibrium was lost, and the
        load under which it moved: a two-hundredth more.
    cause : str
        Why the equilibrium was lost.
    contact : int
        Contact without agreeing regimes; -1 where the control met its limit.
    strain : (4,) array
        Displacement gradient of the cell in the motion, 11, 12, 21, 22.
    released : float
        Energy that damping took, and that the motion still had (force times length).
    kinetic : float
        Largest kinetic energy at a look at the motion, all grains having the mean mass of discs of
        unit density.
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


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Path(Shown):
    """Path of a loop or a packing, or a replay: rows of what was met, and the events between.

    Of a loop `follow` gives a row at every event and, with `rows`, between; of a packing, and
    `replay`, a row at the start and wherever `rows` asks. Components in the order (11, 12, 21, 22);
    forces, stresses and strains positive in compression. Arrays that a kind does not have are
    empty.

    Attributes
    ----------
    status : str
        'finished'; 'control_limit': the control has no continuation: the loading parameter reaches
        an extremum, or asks for ever more strain; 'no_solution': the rate problem has none, or the
        control moves nothing; 'no_load': it has come apart and carries no force; 'opposite_contact'
        (loops): stopped there, by the option; 'instabilities' (packings): stopped at the stated
        number of them, or at the first as asked; 'lost': the integration failed, forces or centres
        jumped, or there was no rest after an instability, see `message`. The last row of a packing
        is the state before; at 'control_limit' that of the event within the interval which met it.
        Under a growing load (`sustain`): 'held': no large motion up to the largest load; 'large
        motion, at rest again' and 'large motion, no rest': how the first one ended; 'unfinished':
        given up before.
    message : str
        The status in words.
    events : tuple of Event
        In the order of the path; a replay has none. Events of a rejected interval are dropped,
        except when the path is lost: then they lie beyond the last row.
    parameter : (R,) array
        Loading parameter, counted from the start of the path; of a replay of given strains the
        share of the duration.
    stage : (R,) array of int
        Stage.
    H, P : (R, 4) array
        Displacement gradient, and nominal stress over `volume` (the reference cell of a packing).
        Between walls their displacements over the sides of the box, and the forces on the right and
        on the upper wall over its first sides.
    work : (R, 4) array
        Of a loop: external work `V0 Int P:H'`, work of the moments that hold the spins, work spent
        on shear at the contacts, and the part of it that slip dissipates; all since the start.
        Of a packing: external work, with that of the load that balances the start; slip; `T` times
        the difference between the motion at the contact and the law's shear increment (`branch`:
        next to nothing), with what shear springs lose as their `kt` changes; and the work of
        unbalanced forces, at instabilities and by rattlers. The first is the change of `energy` and
        the other three, to rounding (Theory, equations (11.12) and (11.13)).
    imbalance : (R,) array
        Of a loop: largest unbalanced force on a grain over `kn sqrt(V0)`, the drift of the traction
        closure; nan under the affine closure, which does not balance the grains. Of a packing:
        largest drift of a grain's resultant over the mean contact force.
    x : (R, G, 2) array
        Loops: centres.
    normal_force, shear_force : (R, C) array
        Loops: `N` and `T`. Contacts that were added on the way are open before.
    regime : (R, C) array of int8
        Loops: `loops.Regime`.
    contacts : (C, 2) array of int
        Loops: grains of the contacts, added ones last.
    A : (R, 4, 4) array
        Loops: tangent in the regimes of the row; nan where the closure has no single answer.
    H_rate, P_rate : (R, 4) array
        Loops: direction of the path, per unit of its length in the space of `H`.
    parameter_rate : (R,) array
        Loops: rate of the loading parameter in the same unit; zero at a limit of the control.
    normal_energy, tangential_energy : (R,) array
        Loops: `sum N^2/(2 kn)` and `sum T^2/(2 kt)`.
    condition : (R,) array
        Loops: condition number of closure and control together, solved for the rates; large at a
        limit of the control.
    turns : tuple of float
        Packings that `gl.evolve` drives: driven strain or stress at which each stage ends; none of
        other paths.
    volume : float
        Loops: reference area V0.
    subspace : str
        Loops: where K is taken.
    model : ModelChoice
        Loops: model that was solved, see `follow`.
    states : tuple of Contacts
        Packings, replays: the packing at every row. Events number contacts as these do: those of
        the graph first.
    energy : (R,) array
        Packings: energy of the springs, `sum N^2/(2 kn) + T^2/(2 kt) + M^2/(2 k_r)`; of Hertz's,
        `2/5 N overlap`, of other laws their `normal_energy`.
    intervals : int
        Packings: number of intervals.
    pathologies : tuple of Pathologies
        Packings, where asked for: of each row, whether the matrix of the contacts at yield is
        symmetric, positive definite, a P-matrix, and the number of solutions of the rate problem.
    limit, limit_spread : float
        Packings: loading parameter at which the path met its limit, by the smallest interval, and
        its change as the interval was halved, over itself: infinite where it has not converged to
        1 %. nan of paths that end otherwise than by 'control_limit' or a first instability.
        Under a growing load: stress along the direction, less that of the start, of the last state
        before the equilibrium was first lost by a motion of 1e-5 or more; and how much it changed
        as the interval was halved over the second half of the path, by other numberings, by grains
        without load that coast, and where motions of a third or three times 1e-5 count, over
        itself. nan if it never was.
    stress_spread : float
        Packings, where it was asked for: largest difference of the stress, over its largest change,
        to the same path with the other choice past instabilities, as far as both go; 0 where none
        was met; nan if not asked for.
    direction : (m,) array
        Growing load: unit direction of `P'`; the parameter is the load along it.
    motions : tuple of Motion
        Growing load: motions past lost equilibria, in their order; the large one is the last.
    resting : (R,) array of bool
        Growing load: whether the packing is in equilibrium at the row (the start, the end of each
        interval and of each motion): not at the end of a motion without rest.
    first_large_strain, first_large_spread : float
        Growing load: strain of the first large motion (of all motions over the last 5 % of the
        load), nan if there was none; largest change of its load by other numberings, by a third
        of the damping, by grains without load that coast, and where motions of a third of its
        least strain count, over itself: nan if it was not asked for. A run without a large motion
        counts with the largest load.
    seconds, spread_seconds : float
        Growing load: seconds of the processor up to the end of the direction; and those that the
        spreads took beside, for halves of the interval and the runs of the spreads.
    velocity, spin : (G, 2), (G,) array
        Replays: velocities beyond the affine motion, and spins, half a step before the end.
    steps, time_step : int, float
        Replays: steps made and their length, in the unit of time of the masses.
    law_asked : str
        Replays: 'kernel' of a known law, 'compiled' of one's own, or 'numpy', in every step, with
        the reason where numba cannot compile it.
    """

    status: PathStatus
    message: str
    events: tuple[Event, ...]
    parameter: Floats
    stage: Integers
    H: Floats
    P: Floats
    work: Floats = field(default_factory=_none)
    imbalance: Floats = field(default_factory=_none)
    x: Floats = field(default_factory=_none)
    normal_force: Floats = field(default_factory=_none)
    shear_force: Floats = field(default_factory=_none)
    regime: Regimes = field(default_factory=_none)
    contacts: Integers = field(default_factory=_none)
    A: Floats = field(default_factory=_none)
    H_rate: Floats = field(default_factory=_none)
    P_rate: Floats = field(default_factory=_none)
    parameter_rate: Floats = field(default_factory=_none)
    normal_energy: Floats = field(default_factory=_none)
    tangential_energy: Floats = field(default_factory=_none)
    condition: Floats = field(default_factory=_none)
    turns: tuple[float, ...] = ()
    volume: float = math.nan
    subspace: str = ""
    model: ModelChoice = None  # type: ignore[assignment]
    states: tuple[Contacts, ...] = ()
    energy: Floats = field(default_factory=_none)
    intervals: int = 0
    pathologies: tuple[Pathologies, ...] = ()
    limit: float = math.nan
    limit_spread: float = math.nan
    stress_spread: float = math.nan
    direction: Floats = field(default_factory=_none)
    motions: tuple[Motion, ...] = ()
    resting: Flags = field(default_factory=_none)
    first_large_strain: float = math.nan
    first_large_spread: float = math.nan
    seconds: float = math.nan
    spread_seconds: float = math.nan
    velocity: Floats = field(default_factory=_none)
    spin: Floats = field(default_factory=_none)
    steps: int = 0
    time_step: float = math.nan
    law_asked: str = ""

    def __len__(self) -> int:
        return len(self.parameter)

    def facts(self) -> dict[str, object]:
        """Facts shown at the prompt and in a notebook."""
        kinds = dict(Counter(event.kind for event in self.events))
        ends = {"H": brief(self.H), "P": f"{brief(self.P)} force/length"}
        return {"status": self.status, "rows": len(self), "events": kinds, **ends}

    def _require(self, name: str, values: Sized, closures: str) -> None:
        if not len(values):
            remedy = f"Follow it with {closures}; `gl.path_table(path)` has what this one knows."
            raise InputError(name, "a path that has none", f"a path under {closures}", remedy)

    @property
    def state(self) -> Contacts:
        """The packing at the end."""
        self._require("state", self.states, "closure='packing'")
        return self.states[-1]

    def driven(self, parameter: Floats, stage: Integers) -> Floats:
        """Driven strain or stress at loading parameters of stages; of other paths the parameter."""
        if not self.turns:
            return parameter
        ends = np.array([0.0, *self.turns])
        reached = np.append(0.0, np.cumsum(np.abs(np.diff(ends))))
        return ends[stage] + np.sign(np.diff(ends))[stage] * (parameter - reached[stage])

    @property
    def duration(self) -> float:
        """Duration of a replay."""
        return self.steps * self.time_step

    @property
    def first_event(self) -> float:
        """Parameter at which the first contact changed its regime; nan if none did."""
        return min((event.parameter for event in self.events), default=math.nan)

    @property
    def first_instability(self) -> float:
        """Load at which the equilibrium was first lost, by a motion of any strain; else nan."""
        return self.motions[0].lost if self.motions else math.nan

    @property
    def first_large_load(self) -> float:
        """Load of the first large motion, nan if there was none."""
        return self.motions[-1].load if self.status in LARGE_MOTION else math.nan

    @property
    def mode(self) -> Motion | None:
        """The large motion, else the motion of largest strain; None without any."""
        if self.status in LARGE_MOTION:
            return self.motions[-1]
        return max(self.motions, key=lambda one: float(np.linalg.norm(one.strain)), default=None)

    @property
    def balance_error(self) -> float:
        """Largest error of a packing's energy balance over the largest work."""
        self._require("balance_error", self.energy, "closure='packing'")
        work, *spent = self.work.T
        error = work - sum(spent) - (self.energy - self.energy[0])
        return float(np.abs(error).max() / max(np.abs(work).max(), 1e-300))

    @cached_property
    def K(self) -> Floats:
        """(R, m, m) tangent restricted to the subspace."""
        self._require("K", self.A, "'affine' or 'traction'")
        return restrict(self.A, self.subspace)

    @cached_property
    def det_K(self) -> Floats:
        """(R,) determinant of K."""
        return np.linalg.det(self.K)

    @cached_property
    def det_Ks(self) -> Floats:
        """(R,) determinant of the symmetric part of K."""
        return np.linalg.det(symmetric_part(self.K))

    @cached_property
    def eigenvalues(self) -> NDArray[np.complex128]:
        """(R, m) eigenvalues of K."""
        return spectrum(self.K)

    @cached_property
    def symmetric_eigenvalues(self) -> Floats:
        """(R, m) eigenvalues of the symmetric part of K, ascending."""
        return symmetric_spectrum(self.K)

    @cached_property
    def energy_error(self) -> Floats:
        """(R,) error of the balance of work, over the largest term of the path.

        External work and the work of the moments against the energy of the normal springs, which
        follows from the state, and the work on shear, which does not (9), (10).
        """
        self._require("energy_error", self.normal_energy, "'affine' or 'traction'")
        external, moment, shear, _ = self.work.T
        stored = self.normal_energy - self.normal_energy[0]
        terms = np.abs(np.stack([external, moment, shear, stored]))
        return (external + moment - shear - stored) / max(float(terms.max()), 1e-300)

    def of_kind(self, kind: EventKind) -> tuple[Event, ...]:
        """Events of one kind."""
        return tuple(event for event in self.events if event.kind == kind)

    def columns(self) -> dict[str, NDArray[np.generic]]:
        """Columns of a table, one row per row of the path; complex eigenvalues in two columns."""
        table: dict[str, NDArray[np.generic]] = {
            "parameter": self.parameter,
            "stage": self.stage,
        }
        for name in ("H", "P", "H_rate", "P_rate"):
            values = getattr(self, name)
            head, _, tail = name.partition("_")
            for k, component in enumerate(COMPONENTS):
                table[f"{head}{component}{'_' + tail if tail else ''}"] = values[:, k]
        table["parameter_rate"] = self.parameter_rate
        for name, force in (("N", self.normal_force), ("T", self.shear_force)):
            for c in range(force.shape[1]):
                table[f"{name}_{c}"] = force[:, c]
        for c in range(self.regime.shape[1]):
            table[f"regime_{c}"] = self.regime[:, c]
        for a in range(4):
            for b in range(4):
                table[f"A{COMPONENTS[a]}_{COMPONENTS[b]}"] = self.A[:, a, b]
        table["det_K"], table["det_Ks"] = self.det_K, self.det_Ks
        for k in range(self.K.shape[-1]):
            table[f"eig_K_{k}_real"] = self.eigenvalues[:, k].real
            table[f"eig_K_{k}_imag"] = self.eigenvalues[:, k].imag
            table[f"eig_Ks_{k}"] = self.symmetric_eigenvalues[:, k]
        for k, name in enumerate(WORK_TERMS):
            table[name] = self.work[:, k]
        table["normal_energy"] = self.normal_energy
        table["tangential_energy"] = self.tangential_energy
        table["energy_error"], table["imbalance"] = self.energy_error, self.imbalance
        table["condition"] = self.condition
        return table


def follow_stages(
    follow_stage: Callable[[int, Stage], tuple[PathStatus, str]], stages: Sequence[Stage]
) -> tuple[PathStatus, str]:
    """Follow stages in turn; a fallback where the stage before met a limit, and only there.

    `follow_stage` goes through one of them, given with its number, from where the path stands and
    returns its status and message. The path of a loop and that of a packing are both led by this.
    """
    outcome = FINISHED
    for number, stage in enumerate(stages):
        limited = outcome[0] in ("control_limit", "no_solution")
        if limited and not stage.fallback:
            break
        if stage.fallback and not limited:
            continue
        outcome = follow_stage(number, stage)
        if outcome[0] in ("opposite_contact", "no_load", "instabilities", "lost"):
            break
    return outcome
