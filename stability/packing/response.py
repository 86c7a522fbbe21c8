"""The rate problem of a packing: motion, spins and force rates under a strain rate.

Contact c at yield has `w_c = s (T'_sliding - T')`, the rate at which it leaves the friction limit,
and `z_c`, the reduction of its shear force by slip, `s T' = s T'_sticking - z_c`; both are not
negative and one is zero. From the relative motion `r` they are `w_c - z_c = g_c . r`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Flags, Floats, Integers, Regimes
from loops.assembly import contact_regime, contact_tangent
from loops.boundary import Boundary, boundary_of, former_boundary, plane_stiffness
from loops.errors import InputError
from loops.graph import ContactState, GrainGraph, branch_vectors, contact_state
from loops.laws.frictional import ContactLaw, Regime, edge_of, require_law
from loops.lazy import warn_of_old_name
from loops.packing import (
    REFINEMENTS,
    Changed,
    Factor,
    System,
    balancing_forces,
    factorised,
    in_freedoms,
    packing_stress,
    packing_stress_rate,
    packing_system,
    relative_motion,
    stiffness_matrix,
)
from loops.scene import Scene
from loops.shown import Shown
from loops.stress_strain import cauchy_rate
from stability.complementarity import (
    SIGN,
    STARTS,
    Complementarity,
    Family,
    feasible_for_all,
    known_solutions,
    nearest_regimes,
    regular_factors,
    solve_complementarity,
    solve_from,
)
from stability.packing.pairs import AT_YIELD
from stability.programmes import Programme

ResponseStatus = Literal[
    "unique",
    "one found",
    "several",
    "family",
    "none",
    "none found",
    "not converged",
    "nearest",
    "given",
]
SOLVED: tuple[ResponseStatus, ...] = ("unique", "one found", "several", "family")

# Share of its strength from which a contact may slide, as simulations of some 1e-5 of strain show.
YIELD_BAND = 0.99

# In place of a proof: a mechanism moves under the strain or under slip with all contacts sticking.
MECHANISM = "mechanism"
# Proof: each strain direction has one solution, and the image of them all closed.
WHOLE_CIRCLE = "whole circle"
# Proof: scaled, the matrix of the contacts at yield is definite; there is one solution.
SCALED = "scaled definite"
# Proof: without one contact the others are; all solutions over its slip were followed.
CRITICAL = "one critical contact"
# In place of a proof: contacts at yield of grains with two contacts were kept from sliding.
HELD_STUCK = "two-contact grains stick"

# In place of a proof: regimes that were told, not searched.
GIVEN = "given"

# H' = e_i (x) e_j for the four components in the order 11, 12, 21, 22.
UNIT_STRAINS: Floats = np.moveaxis(np.eye(4).reshape(4, 2, 2), 0, -1)
# Forces left out of balance beyond this share: a mechanism that no regime stops.
TRUSTED = 1e-6
# Up to so many candidates one matrix of them all is solved; beyond, rounds of parts.
CONDENSED = 2000
# Up to so many several starts are worth their time.
STARTED = 600
# Most candidates of one part; of more, all wrong ones change sides.
PART = 300
# Contacts between a wrong candidate and those of its part.
RINGS = 3
# Rounds of parts after which the best regimes that were found are told as not agreeing.
ROUNDS = 14
# Smallest scale of residuals, over the contacts' forces: in a lattice grain loads are rounding.
IDLE = 1e-8
# Entries of `M`, one less what the packing gives way, below this are rounding (rows: 9e-16).
ROUNDED = 1e-13


@dataclass(frozen=True, eq=False)
class YieldResponse:
    """Contacts at yield, the candidates for sliding; in `system` they stick.

    `rows` (m,) are their rows among the system's contacts, `gauge` (m, 4) the vectors `g`,
    `push` (m, 4) the contact forces of a unit of `s T'`, `sliding` (m, 4, 4) their blocks when
    they slide, `distance` (m,) what `|T|` lacks to the strength. `of_two` (m,) marks candidates
    on a grain with two contacts. Both carry the same force, so their ratio `T/N` is one of the
    geometry and hardly changes: those that the yield band alone would make candidates,
    `settled` in number, are inside the cone and stick.
    """

    system: System
    rows: Integers
    gauge: Floats
    push: Floats
    sliding: Floats
    distance: Floats
    of_two: Flags
    settled: int


@dataclass(frozen=True, eq=False)
class LinearAnswer:
    """Response of the packing to unit `H'` with given regimes, `(..., 4)` in 11, 12, 21, 22.

    `loads` (size, 4) are the forces of the affine motion, `unbalanced` what no motion
    balances.
    """

    factor: Factor | Changed
    loads: Floats
    unbalanced: Floats
    motion: Floats
    relative: Floats
    forces: Floats
    stress: Floats


def yield_response(
    graph: GrainGraph,
    law: ContactLaw,
    *,
    yield_band: float,
    regime: ArrayLike | None = None,
    boundary: Boundary | None = None,
) -> YieldResponse:
    """Find the contacts within the yield band, and those that `regime` marks as sliding."""
    require_law(law)
    checked_band(yield_band)
    state = contact_state(graph)
    given = contact_regime(state, law, regime)
    regimes = np.where(given == Regime.ELASTIC, law.regime(state), given).astype(np.int8)
    near = [_near_yield(law, state, regimes, yield_band)]
    base = np.where(near[0].may_slide, Regime.ELASTIC, near[0].regimes).astype(np.int8)
    boundary = boundary_of(graph) if boundary is None else boundary
    planes = boundary.walls
    if planes is not None:
        walls = planes.law(law), planes.state(graph.radii)
        near.append(_near_yield(*walls, planes.regime, yield_band))
        may_slide = near[1].may_slide & (planes.kt > 0)
        near[1] = near[1]._replace(may_slide=may_slide)
        slides = (near[1].regimes == Regime.SLIDING) & ~may_slide
        planes = replace(planes, sliding=slides)
        boundary = replace(boundary, walls=planes)
    system = packing_system(graph, law, regime=base, boundary=boundary)
    grains, picked = [graph.contacts], [system.contacts]
    if planes is not None:
        grains.append(planes.grain[:, None])
        picked.append(np.flatnonzero(system.carrying.grains[planes.grain]))
    degree = np.bincount(
        np.concatenate([g[c].ravel() for g, c in zip(grains, picked, strict=True)]),
        minlength=graph.grain_count,
    )
    rows, of_two, settled, first = [], [], 0, 0
    for k, (one, g, c) in enumerate(zip(near, grains, picked, strict=True)):
        two = (degree[g] == 2).any(axis=1)
        inside = one.may_slide & two & ~one.full
        settled += int(np.count_nonzero(inside[c]))
        own = np.flatnonzero((one.may_slide & ~inside)[c])
        rows.append(first + own)
        near[k], first = one.take(c[own]), first + len(c)
        of_two.append(two[c[own]])
    scale = np.array([1.0, 1.0, 1.0 / system.length, 1.0 / system.length])
    gauge, push, sliding, distance = (
        np.concatenate(parts) for parts in zip(*(one.slips() for one in near), strict=True)
    )
    if planes is not None:
        sliding[len(rows[0]) :] = plane_stiffness(
            replace(planes, sliding=np.ones(len(planes.grain), dtype=bool)), graph.radii, law
        )[near[1].number]
    return YieldResponse(
        system,
        np.concatenate(rows),
        gauge * scale,
        push * scale,
        scale[:, None] * sliding * scale,
        distance,
        np.concatenate(of_two),
        settled,
    )


class _NearYield(NamedTuple):
    """Contacts of one kind, (C,) each: which may slide, which stand at their strength in full."""

    law: ContactLaw
    state: ContactState
    regimes: Regimes
    may_slide: Flags
    full: Flags
    number: Integers

    def take(self, c: Integers) -> _NearYield:
        """Return the picked contacts."""
        at = self.state
        forces, radii = (at.normal_force[c], at.shear_force[c]), (at.radii_i[c], at.radii_j[c])
        state = ContactState(at.length[c], at.n[c], at.t[c], *forces, *radii)
        flags = self.regimes[c], self.may_slide[c], self.full[c]
        return _NearYield(self.law.take(c), state, *flags, self.number[c])

    def slips(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Return gauge (m, 4), push (m, 4), sliding block (m, 4, 4), distance (m,) of contacts."""
        law, state = self.law, self.state
        sign = np.sign(state.shear_force)[:, None]
        stuck = np.full(len(sign), Regime.ELASTIC, dtype=np.int8)
        change = (
            law.local_stiffness(state, stuck)[:, 1] - law.local_stiffness(state, self.regimes)[:, 1]
        )
        g, b_i, b_j = law.shear_kinematics(state)
        normal = np.hstack([state.n, np.zeros_like(state.n)])
        shear = np.column_stack([g[:, None] * state.t, -b_i, -b_j])
        push = np.column_stack([state.t, -state.arm_i, -state.arm_j])
        distance = np.maximum(law.strength(state) - np.abs(state.shear_force), 0.0)
        return (
            sign * (change[:, :1] * normal + change[:, 1:] * shear),
            sign * push,
            contact_tangent(state, law, self.regimes),
            np.where(np.isfinite(distance), distance, 0.0),
        )


def _near_yield(law: ContactLaw, state: ContactState, given: Regimes, band: float) -> _NearYield:
    """Return contacts that may slide: from a share of their strength on, or said to slide."""
    near = edge_of(law, state, given == Regime.ELASTIC, band).at_yield
    regimes = np.where(near, Regime.SLIDING, given).astype(np.int8)
    # Without a shear force there is no side to slide to: frictionless contacts always slide.
    may_slide = (state.shear_force != 0) & (regimes == Regime.SLIDING)
    full = edge_of(law, state, regimes != Regime.OPEN, max(band, AT_YIELD)).at_yield
    return _NearYield(law, state, regimes, may_slide, full, np.arange(len(regimes)))


def checked_band(share: float, name: str = "yield_band", usual: float = YIELD_BAND) -> float:
    """Check the share of its strength from which a contact may slide."""
    if not 0.0 < share <= 1.0:
        remedy = f"Leave it out: {usual:g} is what was compared with simulations."
        raise InputError(name, f"{share:g}", "a share in (0, 1]", remedy)
    return float(share)


def stiffness_of(yielding: YieldResponse, active: Flags) -> Floats:
    """Return the blocks (E, 4, 4) with the active candidates sliding."""
    blocks = yielding.system.stiffness.copy()
    blocks[yielding.rows[active]] = yielding.sliding[active]
    return blocks


def linear_answer(
    yielding: YieldResponse, active: Flags, factor: Factor | Changed | None = None
) -> LinearAnswer:
    """Solve for the four unit strains with the active candidates sliding."""
    system, blocks = yielding.system, stiffness_of(yielding, active)
    factor = factor or factorised(system, blocks)
    affine = relative_motion(system, np.zeros((system.size, 4)), UNIT_STRAINS)
    loads = balancing_forces(system, blocks @ affine)
    motion = factor.solve(loads)
    relative = relative_motion(system, motion, UNIT_STRAINS)
    forces = -blocks @ relative
    stress = packing_stress_rate(system, forces).reshape(4, 4)
    return LinearAnswer(
        factor, loads, loads - factor.matrix @ motion, motion, relative, forces, stress
    )


def slip_motion(
    yielding: YieldResponse, answer: LinearAnswer, chosen: Integers, refine: int = REFINEMENTS
) -> tuple[Floats, Floats]:
    """Return the motion per unit of slip `z` of each chosen candidate (size, k).

    Also (k,) the share of each load that no motion balances, above rounding with a mechanism.
    """
    loads = -in_freedoms(yielding.system, yielding.rows[chosen], yielding.push[chosen]).T.toarray()
    motion = answer.factor.solve(loads, refine=refine)
    left = np.linalg.norm(loads - answer.factor.matrix @ motion, axis=0)
    return motion, left / np.linalg.norm(loads, axis=0)


def updated_factor(
    yielding: YieldResponse, elastic: LinearAnswer, active: Flags, slips: Floats
) -> Changed:
    """Return factors with active candidates sliding, as an update of those with all sticking."""
    gauge = in_freedoms(yielding.system, yielding.rows[active], yielding.gauge[active])
    matrix = stiffness_matrix(yielding.system, stiffness_of(yielding, active))
    assert isinstance(elastic.factor, Factor)
    return elastic.factor.changed(matrix, -slips[:, active], gauge)


def condensed(
    yielding: YieldResponse, active: Flags, answer: LinearAnswer, chosen: Integers, motion: Floats
) -> tuple[Floats, Floats]:
    """Return matrix (k, k) and stress (4, k) of the chosen candidates' complementary variables.

    The variable of a sticking candidate is its `z`, that of a sliding one its `w`; either reduces
    `s T'`. The matrix gives the other one of each pair.
    """
    system, rows = yielding.system, yielding.rows[chosen]
    side = np.where(active[chosen], -1.0, 1.0)[:, None]
    matrix = np.eye(len(chosen)) + side * (
        in_freedoms(system, rows, yielding.gauge[chosen]) @ motion
    )
    blocks = stiffness_of(yielding, active)
    lines = np.einsum("eij,ek->ejik", blocks[:, :2], system.branches)
    stress = balancing_forces(system, lines.reshape(len(blocks), 4, 4)).T @ motion
    own = np.einsum("ki,kj->ijk", yielding.push[chosen, :2], system.branches[rows]).reshape(4, -1)
    return matrix, (stress - own) / system.volume


def complementary_rates(yielding: YieldResponse, active: Flags, relative: Floats) -> Floats:
    """Return `w` of sticking and `z` of sliding candidates under motions `r`: (m,) or (m, k)."""
    side = np.where(active, -1.0, 1.0).reshape(-1, *[1] * (relative.ndim - 2))
    return side * np.einsum("ci,ci...->c...", yielding.gauge, relative[yielding.rows])


def forces_of_motion(yielding: YieldResponse, branch_rate: Floats, spin: Floats) -> Floats:
    """Return changes of force (C, 2) under those of branches and angles, which decide on slip."""
    system = yielding.system
    kept = system.contacts
    turns = spin[system.graph.contacts[kept]] * system.length
    relative = np.zeros((len(system.branches), 4))
    relative[: len(kept)] = np.concatenate([branch_rate[kept], turns], axis=1)
    rates = complementary_rates(yielding, np.zeros(len(yielding.rows), dtype=bool), relative)
    slip = np.maximum(-(yielding.distance + rates), 0.0)
    out = np.zeros_like(branch_rate)
    forces = -np.einsum("eij,ej->ei", system.stiffness, relative)
    forces[yielding.rows] -= yielding.push * slip[:, None]
    out[kept] = forces[: len(kept), :2]
    return out


@dataclass(frozen=True, eq=False, repr=False)
class PackingResponse(Shown):
    """Rates of a packing under a strain rate `H'`, compression positive.

    Attributes
    ----------
    status : {'unique', 'one found', 'several', 'family', 'none', 'none found', 'not converged', \
'given'}
        `unique`: a solution, and a proof that there is no other. `one found`: a solution; every
        start of the search led to it, or failed (one start alone beyond 600 contacts at yield).
        `several`: more than one solution; this one slips least. `family`: solutions in unbroken
        rows, see `families`; this one slips least of their corners and any others. `none`: a proof
        that no combination of regimes agrees. `none found`: every start failed, without a proof.
        `not converged`: a mechanism moves, forces stay out of balance. `given`: the regimes were
        told, and `disagreeing` contacts have others by their rates.

        After `none`, `none found` and `not converged` the rates are those of the best regimes met:
        a few contacts, `disagreeing`, are kept from sliding. They have softened so far that nothing
        quasi-static holds them.
    proof : str
        Proof behind `unique` and `none`: 'enumeration' (up to 12 contacts at yield), 'positive
        definite', 'infeasible'; of probes besides 'scaled definite' (the matrix of the contacts at
        yield times a diagonal one is definite), 'one critical contact' (so it is without one
        contact, and all solutions over its slip were followed), 'whole circle' (of stress
        directions: each strain direction has one solution, proved, and their image was followed
        until it closed). Otherwise '', or what limits the answer: 'two-contact grains stick' (no
        solution was found until their contacts were kept from sliding, an assumption), 'mechanism'
        (with all contacts sticking a mechanism moves).
    residual : float
        Out-of-balance force rate with every contact in the regime that its own rates ask for, over
        that of the affine motion.
    disagreeing : int
        Candidates whose regime doesn't agree with their rates.
    strain_rate, stress_rate : (2, 2) array
        `H'` and nominal stress rate `P'` (force per length), whichever was given; `cauchy_rate` is
        the rate of the Cauchy stress.
    motion : (G, 2) array
        `u'` of the centres beyond the affine motion `-H' x`; 0 for grains that carry nothing.
    spin : (G,) array
        Rates of rotation, counter-clockwise; 0 for grains that carry nothing.
    branch_rate, force_rate : (C, 2) array
        `d'` and `f'` of every contact; those that carry nothing follow `H'` and have no force.
    regime : (C,) array of int8
        `Regime` taken by each contact.
    sliding, candidates, settled : int
        Contacts that slide, that might, and those of grains with two contacts that stick: they are
        within the yield band and inside the cone, or kept from sliding (see `proof`).
    solutions : int
        Distinct solutions found; of a continuum some.
    families : tuple of Family
        Rows of solutions (`stability.Family`), slips in force per time; one entry for each of
        `at_yield`.
    at_yield : (m,) array
        Numbers of the candidates among the contacts; contacts with walls follow those of grains.
    system : System
        The carrying part; `system.carrying` counts rattlers and floating clusters.
    reached : float
        Of an increment (`packing_increment`) the share at which the first contact softened and was
        kept from sliding, else 1.
    beyond : int
        Of an increment, contacts that end beyond their strength and were no candidates.
    """

    status: ResponseStatus
    proof: str
    residual: float
    disagreeing: int
    strain_rate: Floats
    stress_rate: Floats
    motion: Floats
    spin: Floats
    branch_rate: Floats
    force_rate: Floats
    regime: Regimes
    sliding: int
    candidates: int
    settled: int
    solutions: int
    system: System
    reached: float = 1.0
    beyond: int = 0
    families: tuple[Family, ...] = ()
    at_yield: Integers | None = None

    @property
    def cauchy_rate(self) -> Floats:
        """(2, 2) rate of the Cauchy stress (force per length), compression positive."""
        P = packing_stress(self.system)
        return cauchy_rate(np.zeros((2, 2)), P, self.strain_rate, self.stress_rate)

    def __str__(self) -> str:
        return (
            f"packing response: {self.status}, residual {self.residual:.1e}, {self.sliding} of "
            f"{self.candidates} contacts at yield slide"
        )


class HeldAndDriven(NamedTuple):
    """`held @ H' = strain`, `driven @ P' = stress`; all rows are orthonormal, in 11, 12, 21, 22."""

    held: Floats
    strain: Floats
    driven: Floats
    stress: Floats


class Mixed(NamedTuple):
    """`stress @ P' + strain @ H' = rate`, rows of either or of both."""

    stress: Floats
    strain: Floats
    rate: Floats


Control = HeldAndDriven | Mixed


class Solved(NamedTuple):
    """A response, the candidates that slide in it and the linear answer that it belongs to.

    `solutions` (k, m) are the candidates that slide in each solution found.
    """

    response: PackingResponse
    active: Flags
    answer: LinearAnswer
    solutions: Flags


class PackingRates:
    """The rate problem of one state, prepared for any number of strain rates.

    `refine`: refinements of the motions under slip; one leaves some 1e-9 of them.
    """

    def __init__(self, yielding: YieldResponse, refine: int = REFINEMENTS) -> None:
        self.yielding = yielding
        self.none = np.zeros(len(yielding.rows), dtype=bool)
        self.every = np.arange(len(yielding.rows))
        self.elastic = linear_answer(yielding, self.none)
        self.refine = refine
        self.last = (self.none, self.elastic)
        # The last matrix under which no direction is infeasible.
        self.feasible: Floats = np.empty((0, 0))

    @property
    def small(self) -> bool:
        """Whether one matrix of all candidates is solved."""
        return len(self.every) <= CONDENSED

    @cached_property
    def _slips(self) -> tuple[Floats, float]:
        motion, left = slip_motion(self.yielding, self.elastic, self.every, self.refine)
        return motion, float(left.max(initial=0.0))

    @property
    def slips(self) -> Floats:
        """Motions (size, m) under a unit of slip of each candidate."""
        return self._slips[0]

    @property
    def slips_left(self) -> float:
        """Largest share of such a load that no motion balances; zero where it is not asked."""
        return self._slips[1] if self.small else 0.0

    @cached_property
    def whole(self) -> tuple[Floats, Floats]:
        """Matrix and stress of all candidates' complementary variables, with all sticking."""
        return condensed(self.yielding, self.none, self.elastic, self.every, self.slips)

    def response(
        self, strain_rate: ArrayLike, stress_rate: ArrayLike | None = None, starts: int = STARTS
    ) -> PackingResponse:
        """Answer one control by components."""
        return self.solved(component_control(strain_rate, stress_rate), starts).response

    def given(self, control: Control, active: Flags) -> PackingResponse:
        """Answer one control with these candidates sliding, whether that agrees or not."""
        answer = linear_answer(self.yielding, active) if active.any() else self.elastic
        told = Complementarity(active[None], GIVEN)
        return self._response(answer, active, told, control)

    def problem(self, control: Control) -> tuple[Floats, Floats]:
        """Return `q` and `M` of the complementarity problem of all candidates."""
        return controlled(self.yielding, self.none, self.elastic, self.every, self.whole, control)

    def solved(
        self,
        control: Control,
        starts: int = STARTS,
        known: Sequence[Flags] = (),
        complete: str = "",
    ) -> Solved:
        """Answer one control; `known` are sets of sliding candidates to try first.

        They are all that there are if `complete` names a proof of it, and all that are tried
        without a start.
        """
        free = ~self.yielding.of_two
        if not self.small:
            first = self._by_parts(control, ~self.none, "")
            if first.response.status in SOLVED or free.all():
                return first
            second = self._by_parts(control, free, HELD_STUCK)
            return second if second.response.status in SOLVED else first
        q, M = self.problem(control)
        starts = starts if len(q) <= STARTED else min(starts, 1)
        if complete:
            found = known_solutions(q, M, known, complete)
        else:
            feasible = np.array_equal(M, self.feasible)
            found = solve_complementarity(q, M, starts, known, feasible)
            if not (starts == 0 or feasible or len(found.active) or found.proof):
                self.feasible = M if feasible_for_all(M) else self.feasible
        if starts and not len(found.active) and not found.proof and not free.all():
            others = solve_complementarity(q[free], M[np.ix_(free, free)], starts).active
            if len(others):
                sets = np.zeros((len(others), len(q)), dtype=bool)
                sets[:, free] = others
                found = Complementarity(sets, HELD_STUCK)
        active = self.none
        if len(found.active):
            active = found.active[0]
        elif starts:
            active = nearest_regimes(q, M)
        answer = self._answer(active)
        response = self._response(answer, active, found, control)
        return Solved(response, active, answer, found.active)

    def rates_of(self, control: Control, active: Flags) -> tuple[Floats, Floats]:
        """Return strain and stress rate (4,) of the solution with these candidates sliding."""
        answer = self._answer(active)
        H = controlled_strain(answer, control)
        return H, answer.stress @ H

    def _by_parts(self, control: Control, free: Flags, proof: str) -> Solved:
        active, answer, done = regimes_by_parts(self.yielding, control, free)
        found = Complementarity(active[None][: int(done)], proof if done else "")
        response = self._response(answer, active, found, control)
        return Solved(response, active, answer, found.active)

    def _answer(self, active: Flags) -> LinearAnswer:
        """Answer with these candidates sliding, from the factorisation with none.

        Where they slide without resistance the packing is factorised anew, with its regularisation.
        """
        if not active.any():
            return self.elastic
        if not np.array_equal(active, self.last[0]):
            factor = None
            if regular_factors(self.whole[0][np.ix_(active, active)]) is not None:
                factor = updated_factor(self.yielding, self.elastic, active, self.slips)
            self.last = (active, linear_answer(self.yielding, active, factor=factor))
        return self.last[1]

    def _response(
        self, answer: LinearAnswer, active: Flags, found: Complementarity, control: Control
    ) -> PackingResponse:
        yielding = self.yielding
        system, graph = yielding.system, yielding.system.graph
        H = controlled_strain(answer, control).reshape(2, 2)
        relative, forces = answer.relative @ H.ravel(), answer.forces @ H.ravel()
        wrong = complementary_rates(yielding, active, relative)
        scale = np.abs(wrong).max(initial=0.0)
        disagreeing = wrong < -SIGN * scale
        if found.proof == HELD_STUCK:
            disagreeing &= ~yielding.of_two
        lawful = stiffness_of(yielding, active ^ disagreeing)
        left = balancing_forces(system, -np.einsum("eij,ej->ei", lawful, relative))
        affine = system.stiffness[:, :, :2] @ (system.branches @ H.T)[..., None]
        size = float(np.linalg.norm(balancing_forces(system, affine)))
        # Where grains move affinely, as in a lattice, loads and residual are rounding.
        size = max(size, IDLE * float(np.linalg.norm(affine)))
        size = size if size > 0 else 1.0
        residual = float(np.linalg.norm(left)) / size
        # With all contacts sticking: otherwise q and M are those of the regularised packing.
        moves = float(np.linalg.norm(self.elastic.unbalanced @ H.ravel())) / size
        told = found.proof == GIVEN
        moves = float(np.linalg.norm(answer.unbalanced @ H.ravel())) / size if told else moves
        certain = moves if told else max(moves, self.slips_left)
        proof = found.proof if certain <= TRUSTED else MECHANISM
        v = np.append(answer.motion @ H.ravel(), 0.0)[system.freedom]
        n = len(system.contacts)
        branch_rate = -branch_vectors(graph) @ H.T
        branch_rate[system.contacts] = relative[:n, :2]
        force_rate = np.zeros((graph.contact_count, 2))
        force_rate[system.contacts] = forces[:n, :2]
        regime = np.full(graph.contact_count, Regime.ELASTIC, dtype=np.int8)
        regime[system.contacts] = system.regime[:n]
        slides = yielding.rows[active]
        regime[system.contacts[slides[slides < n]]] = Regime.SLIDING
        return PackingResponse(
            status=_status(found, proof, residual),
            proof=proof,
            residual=residual,
            disagreeing=int(np.count_nonzero(disagreeing)),
            strain_rate=H,
            stress_rate=(answer.stress @ H.ravel()).reshape(2, 2),
            motion=v[:, :2],
            spin=v[:, 2] / system.length,
            branch_rate=branch_rate,
            force_rate=force_rate,
            regime=regime,
            sliding=int(np.count_nonzero(active)),
            candidates=len(yielding.rows),
            settled=yielding.settled
            + int(found.proof == HELD_STUCK) * int(np.count_nonzero(yielding.of_two)),
            solutions=len(found.active),
            system=system,
            families=found.families,
            at_yield=np.append(system.contacts, np.arange(len(forces) - n) + graph.contact_count)[
                yielding.rows
            ],
        )


def regimes_by_parts(
    yielding: YieldResponse, control: Control, free: Flags
) -> tuple[Flags, LinearAnswer, bool]:
    """Find regimes of too many candidates to condense; and the answer, and whether they agree.

    Candidates that are not `free` stick whatever their rates are.

    Newton's flips from all sliding, each with a factorisation; when few candidates are left wrong,
    a complementarity problem of these and those near them, with the others as they are.
    """
    system, graph = yielding.system, yielding.system.graph
    contacts = graph.contacts[system.contacts]
    if system.planes is not None:
        contacts = np.concatenate([contacts, np.tile(system.planes.grain[:, None], 2)])
    active = free.copy()
    best, least = active, len(active) + 1
    for _ in range(ROUNDS):
        answer = linear_answer(yielding, active)
        values = complementary_rates(
            yielding, active, answer.relative @ controlled_strain(answer, control)
        )
        wrong = free & (values < -SIGN * np.abs(values).max(initial=0.0))
        count = int(np.count_nonzero(wrong))
        improves = count < 0.7 * least
        if count < least:
            best, least = active, count
        if count == 0:
            return active, answer, True
        active = active.copy()
        # Candidates within a few contacts of the wrong ones.
        reached = np.zeros(graph.grain_count, dtype=bool)
        reached[contacts[yielding.rows[wrong]]] = True
        for _ in range(RINGS):
            reached[contacts[reached[contacts].any(axis=1)]] = True
        chosen = np.flatnonzero(free & (reached[contacts[yielding.rows]].all(axis=1) | wrong))
        if improves or len(chosen) > PART:
            active[wrong] ^= True
            continue
        pair = condensed(yielding, active, answer, chosen, slip_motion(yielding, answer, chosen)[0])
        q, M = controlled(yielding, active, answer, chosen, pair, control)
        flips = solve_from(q, M, np.zeros(len(chosen), dtype=bool))
        active[chosen] ^= nearest_regimes(q, M) if flips is None else flips
    return best, linear_answer(yielding, best), False


def controlled(
    yielding: YieldResponse,
    active: Flags,
    answer: LinearAnswer,
    chosen: Integers,
    pair: tuple[Floats, Floats],
    control: Control,
) -> tuple[Floats, Floats]:
    """Return `q` and `M` of the chosen candidates, strain that the stress drives eliminated."""
    unit = complementary_rates(yielding, active, answer.relative)[chosen]
    matrix, stress = pair
    if isinstance(control, Mixed):
        A = control.stress @ answer.stress + control.strain
        solved = np.linalg.solve(A, np.column_stack([control.rate, -control.stress @ stress]))
        q, driven = unit @ solved[:, 0], unit @ solved[:, 1:]
        M = matrix + driven
        return q, np.where(np.abs(M) < ROUNDED * (1.0 + np.abs(driven)), 0.0, M)
    held, B = control.held.T @ control.strain, control.driven
    imposed = control.stress - B @ answer.stress @ held
    solved = np.linalg.solve(B @ answer.stress @ B.T, np.column_stack([imposed, -B @ stress]))
    q, driven = unit @ (held + B.T @ solved[:, 0]), unit @ B.T @ solved[:, 1:]
    M = matrix + driven
    return q, np.where(np.abs(M) < ROUNDED * (1.0 + np.abs(driven)), 0.0, M)


def packing_rates(
    scene: Scene,
    control: Control | Programme,
    *,
    regime: Literal["elastic", "sliding"] | None = None,
    yield_band: float = YIELD_BAND,
    starts: int = STARTS,
) -> PackingResponse:
    """Return rates of all grains and contacts of a packing, see `stability.rates_at`.

    Centres move by `x' = -H' x + u'`, `u'` periodic, and `K [u', w] = -F_aff(H')` with the
    contacts' tangents. Contacts at yield slide where that dissipates and stick otherwise: a
    complementarity problem, condensed on these contacts. Theory, equations (11.1) and (11.2).
    """
    around = scene.boundary
    yielding = yield_response(scene.graph, scene.law, yield_band=yield_band, boundary=around)
    rates = PackingRates(yielding)
    if isinstance(control, Programme):
        control = control_of(control, packing_stress(yielding.system))
    if regime is None:
        return rates.solved(control, starts).response
    return rates.given(control, rates.none if regime == "elastic" else ~rates.none)


def packing_response(
    graph: GrainGraph,
    law: ContactLaw,
    strain_rate: ArrayLike,
    *,
    stress_rate: ArrayLike | None = None,
    regime: ArrayLike | None = None,
    boundary: Boundary | None = None,
    yield_band: float = YIELD_BAND,
    starts: int = STARTS,
    **former: Any,
) -> PackingResponse:
    """Old form of `stability.rates_at(scene, H=strain_rate, P=stress_rate)`, for one release."""
    warn_of_old_name("packing_response", "rates_at(Scene(graph, law, boundary), H=, P=)")
    around = former_boundary(graph, former) if boundary is None else boundary
    given = graph if regime is None else graph.replace(regime=regime)
    control = component_control(strain_rate, stress_rate)
    scene = Scene(given, law, boundary_of(given) if around is None else around)
    return packing_rates(scene, control, yield_band=yield_band, starts=starts, **former)


def component_control(strain: ArrayLike, stress: ArrayLike | None) -> HeldAndDriven:
    """Return the control of components of `H'` where they are numbers, else of `P'`."""
    H = np.asarray(strain, dtype=float)
    P = np.zeros((2, 2)) if stress is None else np.asarray(stress, dtype=float)
    driven = np.isnan(H)
    if H.shape != (2, 2) or np.isinf(H).any():
        expected = "(2, 2) finite numbers, or nan for stress control"
        remedy = "Give a number for each component that is prescribed, nan for the others."
        raise InputError("strain_rate", f"{H.tolist()}", expected, remedy)
    if P.shape != (2, 2) or not np.isfinite(P[driven]).all():
        expected = "finite numbers of shape (2, 2) where the strain is nan"
        remedy = "Give zero to hold the stress."
        raise InputError("stress_rate", f"{P.tolist()}", expected, remedy)
    rows = np.eye(4)
    return HeldAndDriven(rows[~driven.ravel()], H[~driven], rows[driven.ravel()], P[driven])


def control_of(programme: Programme, stress: Floats) -> Control:
    """Return the control of a programme in a first state; rows of strain or of stress apart."""
    stress, strain, rate = programme.equations(np.zeros(4), stress.ravel())
    driven, held = stress.any(axis=1), strain.any(axis=1)
    if (driven & held).any():
        return Mixed(stress, strain, rate)
    return HeldAndDriven(
        *_orthonormal(strain[held], rate[held]), *_orthonormal(stress[driven], rate[driven])
    )


def _orthonormal(rows: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Return equations `rows @ a = values` with orthonormal rows; as they are if they are so."""
    if np.array_equal(rows @ rows.T, np.eye(len(rows))):
        return rows, values
    Q, R = np.linalg.qr(rows.T)
    return np.ascontiguousarray(Q.T), np.linalg.solve(R.T, values)


def controlled_strain(answer: LinearAnswer, control: Control) -> Floats:
    """Return the strain rate (4,), its driven part as the stress asks for."""
    if isinstance(control, Mixed):
        A = control.stress @ answer.stress + control.strain
        return np.asarray(np.linalg.solve(A, control.rate))
    held, B = control.held.T @ control.strain, control.driven
    imposed = control.stress - B @ answer.stress @ held
    return np.asarray(held + B.T @ np.linalg.solve(B @ answer.stress @ B.T, imposed))


def _status(found: Complementarity, proof: str, residual: float) -> ResponseStatus:
    solutions = len(found.active)
    if proof == GIVEN:
        return "given"
    if solutions and residual <= TRUSTED:
        proved = proof in (
            "enumeration", "positive definite", WHOLE_CIRCLE, SCALED, CRITICAL
        )  # fmt: skip
        if found.families:
            return "family"
        return "several" if solutions > 1 else "unique" if proved else "one found"
    if solutions or proof == MECHANISM:
        return "not converged"
    return "none" if proof else "none found"
