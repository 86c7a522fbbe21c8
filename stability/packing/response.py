"""A packing under a strain: the rate problem, and a whole increment in one solve.

Contact c at yield has `w_c = s (T'_sliding - T')`, the rate at which it leaves the friction limit,
and `z_c`, the reduction of its shear force by slip, `s T' = s T'_sticking - z_c`; both are not
negative and one is zero. From the relative motion `r` they are `w_c - z_c = g_c . r`.

In the rate problem a yield band says beforehand which contacts stand at their strength. In an
increment each keeps its distance to it: with `w` the distance that a contact has left at the end
and `z` what slip has taken off its shear force,

    w = (strength - |T|) + q + M z,  w >= 0,  z >= 0,  w z = 0,

`q` and `M` those of the rate problem, `q` times the increment. The load is raised from zero, where
nothing slips, and its solution is followed. Where that would turn back to smaller loads the packing
snaps: the contact that softens is kept from sliding, as in a path past an instability, and counted.
Theory, equation (11.24).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Flags, Floats, Integers, Regimes, one_blas_thread
from loops.assembly import contact_kinematics, contact_tangent
from loops.contacts import AT_YIELD
from loops.errors import counted, number
from loops.graph import ContactState
from loops.laws.frictional import ContactLaw, Regime, edge_of, edge_rates
from loops.scene import Scene, of_scene
from loops.shown import Shown
from loops.stress_strain import cauchy_rate
from loops.system import (
    System,
    balancing_forces,
    in_freedoms,
    packing_stress,
    relative_motion,
    system_of,
)
from stability.complementarity import (
    SIGN,
    STARTS,
    Complementarity,
    Family,
    feasible_for_all,
    nearest_regimes,
    positive_definite,
    raise_load,
    solve_from,
)
from stability.factor import Edge, Factor
from stability.programmes import ROUNDED, MixedControl, component_control
from stability.regimes import HELD_STUCK, RateStatus, SlipProblem, agreeing, of_sets
from stability.regimes import Regimes as Found

ResponseStatus = RateStatus | Literal["not converged", "nearest"]
SOLVED: tuple[ResponseStatus, ...] = ("unique", "one found", "several", "family")
# In place of a proof: a mechanism moves under the strain or under slip with all contacts sticking.
MECHANISM = "mechanism"
# Proof: each strain direction has one solution, and the image of them all closed.
WHOLE_CIRCLE = "whole circle"
# Proof: scaled, the matrix of the contacts at yield is definite; there is one solution.
SCALED = "scaled definite"
# Proof: without one contact the others are; all solutions over its slip were followed.
CRITICAL = "one critical contact"
# In place of a proof: regimes that were told, not searched.
GIVEN = "given"
# Forces left out of balance beyond this share, of all forces or of those on one grain: a mechanism
# that no regime stops.
TRUSTED = 1e-6
# Candidates up to which several starts of a search are worth their time.
STARTED = 600
# Up to so many candidates one matrix of them all is solved; beyond, rounds of parts.
CONDENSED = 2000
# Most candidates of one part; of more, all wrong ones change sides.
PART = 300
# Contacts between a wrong candidate and those of its part.
RINGS = 3
# Rounds of parts after which the best regimes that were found are told as not agreeing.
ROUNDS = 14
# Smallest scale of residuals, over the contacts' forces: in a lattice grain loads are rounding.
IDLE = 1e-8
# Over the largest force of the affine motion: what a grain carries at least where it is judged by
# its own forces.
LIGHT = 1e-6
# Share of its strength from which a contact may slide, as simulations of some 1e-5 of strain show.
YIELD_BAND = 0.99
# The same over a whole increment.
CANDIDATES = 0.7
# Over its strength: a contact this far beyond it disagrees.
BEYOND_STRENGTH = 1e-6


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
        `u'` of the centres beyond the affine motion `-H' x`, relative to its mean where nothing
        holds the packing; 0 for grains that carry nothing.
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
    neutral : (k,) array
        Those whose rates agree with sticking and sliding alike; `regime` has one of both.
    system : System
        The carrying part; `system.carrying` counts rattlers and floating clusters.
    reached : float
        Of an increment (`packing_increment`) the share at which the first contact softened and was
        kept from sliding, else 1.
    beyond : int
        Of an increment, contacts that end beyond their strength and were no candidates.
    """

    shown = ("status", "proof", "strain_rate", "stress_rate", "sliding", "residual")

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
    neutral: Integers | None = None

    @property
    def cauchy_rate(self) -> Floats:
        """(2, 2) rate of the Cauchy stress (force per length), compression positive."""
        P = packing_stress(self.system)
        return cauchy_rate(np.zeros((2, 2)), P, self.strain_rate, self.stress_rate)

    def __str__(self) -> str:
        return (
            f"packing response: {self.status}, residual {self.residual:.1e}, {self.sliding} of "
            f"{counted(self.candidates, 'contact')} at yield slide"
        )


class Solved(NamedTuple):
    """A response, the candidates that slide in it, and those (k, m) of each solution found."""

    response: PackingResponse
    active: Flags
    solutions: Flags


@dataclass(eq=False, repr=False)
class PackingRates(Shown):
    """The rate problem of one state, for any number of controls, and its increments.

    Candidates for sliding are contacts within a band of their strength; in `system` they stick.
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

    def __post_init__(self) -> None:
        self.none = np.zeros(len(self.rows), dtype=bool)
        self.every = np.arange(len(self.rows))
        # The last factor with some candidates sliding.
        self._last: dict[bytes, Factor] = {}
        # The last matrix under which no control is infeasible.
        self._feasible: Floats = np.empty((0, 0))

    @cached_property
    def elastic(self) -> Factor:
        """The factor with all candidates sticking."""
        return Factor(self.system)

    @property
    def small(self) -> bool:
        """Whether one matrix of all candidates is solved."""
        return len(self.rows) <= CONDENSED

    @cached_property
    def nearest(self) -> PackingRates:
        """The problem of the candidates that one matrix holds: of too many the nearest to yield."""
        if self.small:
            return self
        kept = np.sort(np.argsort(self.distance, kind="stable")[:CONDENSED])
        names = ("rows", "gauge", "push", "sliding", "distance", "of_two")
        return replace(self, **{name: getattr(self, name)[kept] for name in names})

    @property
    def slips_left(self) -> float:
        """Largest share of a slip's load that no motion balances; zero where it is not asked."""
        return self.whole.left if self.small else 0.0

    @cached_property
    def whole(self) -> Edge:
        """All candidates at yield, with all sticking."""
        return self.condensed(self.none, self.every)

    def stiffness(self, active: Flags) -> Floats:
        """Return the blocks (E, 4, 4) with the active candidates sliding."""
        blocks = self.system.stiffness.copy()
        blocks[self.rows[active]] = self.sliding[active]
        return blocks

    def factor(self, active: Flags) -> Factor:
        """Return the factor with these candidates sliding."""
        if not active.any():
            return self.elastic
        key = active.tobytes()
        if key not in self._last:
            self._last = {key: Factor(self.system, self.stiffness(active), self.elastic.order)}
        return self._last[key]

    def condensed(self, active: Flags, chosen: Integers) -> Edge:
        """Return the chosen candidates at yield, where the active ones slide.

        The variable of a sticking candidate is its `z`, that of a sliding one its `w`; either
        reduces `s T'`. What is given of each is the other one.
        """
        system, rows, push = self.system, self.rows[chosen], self.push[chosen]
        factor, loads = self.factor(active), -in_freedoms(system, rows, push).T.toarray()
        motion, sizes = factor.solve(loads), np.linalg.norm(loads, axis=0)
        left = np.linalg.norm(loads - factor.matrix @ motion, axis=0) / sizes
        side = np.where(active[chosen], -1.0, 1.0)[:, None]
        leaving = in_freedoms(system, rows, self.gauge[chosen]) @ motion
        own = np.einsum("ki,kj->ijk", push[:, :2], system.branches[rows]).reshape(4, -1)
        return Edge(
            self.leaving(active, factor.relative)[chosen],
            np.eye(len(chosen)) + side * leaving,
            factor.tangent,
            factor.stress(motion) - own / system.volume,
            motion,
            float(left.max(initial=0.0)),
        )

    def leaving(self, active: Flags, relative: Floats) -> Floats:
        """Return `w` of sticking and `z` of sliding candidates under motions `r`: (m,), (m, k)."""
        side = np.where(active, -1.0, 1.0).reshape(-1, *[1] * (relative.ndim - 2))
        return side * np.einsum("ci,ci...->c...", self.gauge, relative[self.rows])

    def forces(self, relative: Floats, slip: Floats) -> Floats:
        """Return changes of forces `s` (E, 4) under motions `r` (E, 4) and slips (m,)."""
        forces = -np.einsum("eij,ej->ei", self.system.stiffness, relative)
        forces[self.rows] -= self.push * slip[:, None]
        return forces

    def forces_of_motion(self, branch_rate: Floats, spin: Floats) -> Floats:
        """Return changes of force (C, 2) under those of branches, angles, which decide on slip."""
        system = self.system
        kept = system.contacts
        turns = spin[system.graph.contacts[kept]] * system.length
        relative = np.zeros((len(system.branches), 4))
        relative[: len(kept)] = np.concatenate([branch_rate[kept], turns], axis=1)
        slip = np.maximum(-(self.distance + self.leaving(self.none, relative)), 0.0)
        out = np.zeros_like(branch_rate)
        out[kept] = self.forces(relative, slip)[: len(kept), :2]
        return out

    def problem(self, control: MixedControl) -> tuple[Floats, Floats]:
        """Return `q` and `M` of the complementarity problem of all candidates."""
        control.require_regular(self.elastic.tangent)
        return self.whole.problem(control)

    def rounding(self, factor: Factor, H: Floats) -> float:
        """Return what rates of candidates err by: rounding of the largest motion of all."""
        affine = self.system.branches @ H.reshape(2, 2).T
        largest = np.abs(factor.motion @ H).max(initial=0.0) + np.abs(affine).max(initial=0.0)
        return float(ROUNDED * np.abs(self.gauge).max(initial=0.0) * largest)

    def given(self, control: MixedControl, active: Flags) -> PackingResponse:
        """Answer one control with these candidates sliding, whether that agrees or not."""
        return self._solved(active, of_sets(Complementarity(active[None], GIVEN)), control).response

    def solved(
        self,
        control: MixedControl,
        starts: int = STARTS,
        known: Sequence[Flags] = (),
        complete: str = "",
    ) -> Solved:
        """Answer one control; `known` and `complete` as in `agreeing`."""
        free = ~self.of_two
        if not self.small:
            first = self._by_parts(control, ~self.none, "")
            if first.response.status in SOLVED or free.all():
                return first
            second = self._by_parts(control, free, HELD_STUCK)
            return second if second.response.status in SOLVED else first
        q, M = self.problem(control)
        starts = starts if len(q) <= STARTED else min(starts, 1)
        feasible = np.array_equal(M, self._feasible)
        low = self.rounding(self.elastic, control.strains(self.elastic.tangent))
        problem = SlipProblem(q, M, free, feasible, low)
        found = agreeing(problem, starts=starts, known=known, complete=complete)
        missed = found.status == "none found" or found.proof == HELD_STUCK
        if starts and missed and not feasible and feasible_for_all(M):
            self._feasible = M
        active = self.none
        if found.solutions:
            active = found.taken.rates
        elif starts:
            active = nearest_regimes(q, M)
        return self._solved(active, found, control)

    def rates_of(self, control: MixedControl, active: Flags) -> tuple[Floats, Floats]:
        """Return strain and stress rate (4,) of the solution with these candidates sliding."""
        tangent = self.factor(active).tangent
        H = control.strains(tangent)
        return H, tangent @ H

    def _by_parts(self, control: MixedControl, free: Flags, proof: str) -> Solved:
        """Answer a control with too many candidates to condense; others than `free` ones stick.

        Newton's flips from all sliding, each with a factorisation; when few candidates are left
        wrong, a complementarity problem of these and those near them, with the others as they are.
        """
        contacts = self.system.rows.ends[self.system.kept]
        active = free.copy()
        best, least = active, len(active) + 1
        for _ in range(ROUNDS):
            factor = self.factor(active)
            values = self.leaving(active, factor.relative @ control.strains(factor.tangent))
            wrong = free & (values < -SIGN * np.abs(values).max(initial=0.0))
            count = int(np.count_nonzero(wrong))
            improves = count < 0.7 * least
            if count < least:
                best, least = active, count
            if count == 0:
                return self._solved(active, of_sets(Complementarity(active[None], proof)), control)
            # Candidates within a few contacts of the wrong ones.
            reached = np.zeros(int(contacts.max()) + 1, dtype=bool)
            reached[contacts[self.rows[wrong]]] = True
            for _ in range(RINGS):
                reached[contacts[reached[contacts].any(axis=1)]] = True
            chosen = np.flatnonzero(free & (reached[contacts[self.rows]].all(axis=1) | wrong))
            flips = wrong.copy()
            if not improves and len(chosen) <= PART:
                q, M = self.condensed(active, chosen).problem(control)
                slips = solve_from(q, M, np.zeros(len(chosen), dtype=bool))
                flips[chosen] = nearest_regimes(q, M) if slips is None else slips
            active = active ^ flips
        return self._solved(best, of_sets(Complementarity(best[None][:0], "")), control)

    def _solved(self, active: Flags, found: Found[Flags], control: MixedControl) -> Solved:
        """Return the response with these candidates sliding, and what a search tells of it."""
        factor, system = self.factor(active), self.system
        h = control.strains(factor.tangent)
        H, motion = h.reshape(2, 2), factor.motion @ h
        relative = relative_motion(system, motion, H)
        wrong = self.leaving(active, relative)
        slip, unsure = np.where(active, wrong, -wrong), self.rounding(factor, h)
        disagreeing = wrong < -SIGN * np.abs(wrong).max(initial=0.0) - unsure
        stuck = self.of_two & (found.proof == HELD_STUCK)
        disagreeing &= ~stuck
        pushes = self.forces(relative, np.where(active ^ disagreeing, slip, 0.0))
        left = balancing_forces(system, pushes)
        affine = system.stiffness[:, :, :2] @ (system.branches @ H.T)[..., None]
        size = float(np.linalg.norm(self.elastic.loads @ h))
        # Where grains move affinely, as in a lattice, loads and residual are rounding.
        size = max(size, IDLE * float(np.linalg.norm(affine))) or 1.0
        residual = float(np.linalg.norm(left)) / size
        moved, sizes = system.ends >= 0, np.abs(pushes)[:, [0, 1, 0, 1, 2, 3]]
        own = np.bincount(system.ends[moved], sizes[moved], system.size)
        own += LIGHT * np.abs(affine).max(initial=0.0)
        apart = np.abs(left) / np.where(own > 0, own, 1.0)
        # With all contacts sticking: otherwise q and M are those of the regularised packing.
        told = found.proof == GIVEN
        of_all = factor if told else self.elastic
        left_over = of_all.loads @ h - of_all.matrix @ (of_all.motion @ h)
        moves = float(np.linalg.norm(left_over)) / size
        certain = moves if told else max(moves, self.slips_left)
        proof = found.proof if certain <= TRUSTED else MECHANISM
        at_yield = system.kept[self.rows]
        response = self._response(
            (H, motion, np.where(active, slip, 0.0)),
            active,
            status=_status(found, proof, float(apart.max(initial=residual))),
            proof=proof,
            residual=residual,
            disagreeing=int(np.count_nonzero(disagreeing)),
            stress_rate=(factor.tangent @ h).reshape(2, 2),
            settled=self.settled + int(np.count_nonzero(stuck)),
            solutions=len(found.solutions),
            families=found.families,
            at_yield=at_yield,
            neutral=at_yield[np.abs(wrong) <= unsure],
        )
        sets = np.array([one.rates for one in found.solutions], dtype=bool)
        return Solved(response, active, sets.reshape(len(sets), len(self.rows)))

    def increment(self, control: MixedControl) -> PackingResponse:
        """Answer one control whose strain and stress are whole increments: `packing_increment`."""
        if not self.small:
            return self.nearest.increment(control)
        q, M = self.problem(control)
        raised = raise_load(self.distance, q, M)
        slip, elastic, system = raised.slip, self.elastic, self.system
        stress_of_slip = self.whole.stress_of_slip @ slip
        h = control.strains(elastic.tangent, stress_of_slip)
        H, motion = h.reshape(2, 2), elastic.motion @ h + self.whole.motion @ slip
        relative = relative_motion(system, motion, H)
        left = balancing_forces(system, self.forces(relative, slip))
        residual = float(np.linalg.norm(left)) / (float(np.linalg.norm(elastic.loads @ h)) or 1.0)
        status: ResponseStatus = "nearest" if raised.held.any() else "one found"
        if status == "one found" and positive_definite(M):
            status = "unique"
        return self._response(
            (H, motion, slip),
            slip > 0,
            status=status if residual <= TRUSTED else "not converged",
            proof="positive definite" if status == "unique" else "",
            residual=residual,
            disagreeing=int(np.count_nonzero(raised.held)),
            stress_rate=(elastic.tangent @ h + stress_of_slip).reshape(2, 2),
            settled=self.settled,
            solutions=int(status != "nearest"),
            reached=raised.first,
            beyond=int(np.count_nonzero(self._beyond(relative))),
        )

    def _beyond(self, relative: Floats) -> Flags:
        """Return contacts, no candidates, that end beyond their strength (E,)."""
        system = self.system
        motion = np.zeros((len(system.rows.ends), 4))
        motion[system.kept] = relative / np.array([1.0, 1.0, system.length, system.length])
        (beyond,) = system.rows.each(_beyond_strength, motion)
        beyond = beyond[system.kept] & (system.regime == Regime.ELASTIC)
        beyond[self.rows] = False
        return np.asarray(beyond)

    def _response(
        self, moved: tuple[Floats, Floats, Floats], active: Flags, **told: Any
    ) -> PackingResponse:
        """Return a response with what a search told of it.

        `moved` are the strain (2, 2), the motion (size,) of the freedoms, and the slips (m,) of the
        candidates; `active` (m,) those that slide.
        """
        (H, motion, slip), system = moved, self.system
        relative = relative_motion(system, motion, H)
        forces = self.forces(relative, slip)
        graph, n = system.graph, len(system.contacts)
        v = np.append(motion, 0.0)[system.freedom]
        branch_rate, force_rate = -graph.branches @ H.T, np.zeros((graph.contact_count, 2))
        branch_rate[system.contacts] = relative[:n, :2]
        force_rate[system.contacts] = forces[:n, :2]
        regime = np.full(graph.contact_count, Regime.ELASTIC, dtype=np.int8)
        regime[system.contacts] = system.regime[:n]
        slides = self.rows[active]
        regime[system.contacts[slides[slides < n]]] = Regime.SLIDING
        return PackingResponse(
            strain_rate=H,
            motion=v[:, :2],
            spin=v[:, 2] / system.length,
            branch_rate=branch_rate,
            force_rate=force_rate,
            regime=regime,
            sliding=int(np.count_nonzero(active)),
            candidates=len(self.rows),
            system=system,
            **told,
        )


@one_blas_thread()
def rate_problem(
    scene: Scene, *, yield_band: float = YIELD_BAND, by_forces: bool = False
) -> PackingRates:
    """Prepare the rate problem of a packing: one factorisation for any number of controls.

    Parameters
    ----------
    scene : Scene
        The packing, one state.
    yield_band : float
        Contacts with `|T|` of at least this share of their strength may slide, and those whose
        known regime is sliding.
    by_forces : bool
        Closed contacts have regimes by their forces, whatever is known of them.

    Returns
    -------
    PackingRates
        `solved(control)` answers with rates, `increment(control)` with a whole increment.

    Raises
    ------
    InputError
        If the packing floats, or the band is no such share.
    """
    number("yield_band", yield_band, 0.0, 1.0, open_low=True)
    rows = scene.rows
    regimes, may_slide, full, *parts = rows.each(partial(_near_yield, yield_band, by_forces))
    system = system_of(scene, np.where(may_slide, Regime.ELASTIC, regimes))
    kept = system.kept
    degree = np.bincount(rows.ends[kept].ravel(), minlength=int(rows.ends.max(initial=0)) + 1)
    two = (degree[rows.ends] == 2).any(axis=1)
    inside = may_slide & two & ~full
    found = np.flatnonzero((may_slide & ~inside)[kept])
    gauge, push, sliding, distance = (part[kept[found]] for part in parts)
    scale = np.array([1.0, 1.0, 1.0 / system.length, 1.0 / system.length])
    return PackingRates(
        system,
        found,
        gauge * scale,
        push * scale,
        scale[:, None] * sliding * scale,
        distance,
        two[kept[found]],
        int(np.count_nonzero(inside[kept])),
    )


def _near_yield(
    band: float, by_forces: bool, law: ContactLaw, state: ContactState
) -> tuple[Regimes, Flags, Flags, Floats, Floats, Floats, Floats]:
    """Return regimes (E,), which contacts may slide, which are at their strength in full.

    They may from a share of their strength on, or where they are known to slide. The others are
    `gauge`, `push`, `sliding` and `distance` of `PackingRates`, without its scale.
    """
    known = state.regime
    assert known is not None
    judged = known != Regime.OPEN if by_forces else known == Regime.ELASTIC
    given = np.where(judged, law.regime(state), known)
    near = edge_of(law, state, given == Regime.ELASTIC, band).at_yield
    regimes = np.where(near, Regime.SLIDING, given).astype(np.int8)
    strength, size = law.strength(state), np.abs(state.shear_force)
    # Without a shear force there is no side to slide to. Frictionless contacts always slide: the
    # shear that they carry is rounding.
    rough = (np.asarray(law.mu) > 0) | (strength > 0)
    may_slide = rough & (state.shear_force != 0) & (regimes == Regime.SLIDING)
    full = edge_of(law, state, regimes != Regime.OPEN, max(band, AT_YIELD)).at_yield
    sign, stuck = np.sign(state.shear_force)[:, None], np.full_like(regimes, Regime.ELASTIC)
    change = law.local_stiffness(state, stuck)[:, 1] - law.local_stiffness(state, regimes)[:, 1]
    distance = np.where(np.isfinite(strength), np.maximum(strength - size, 0.0), 0.0)
    return (
        regimes,
        may_slide,
        full,
        sign * np.einsum("ci,cij->cj", change, contact_kinematics(state, law)),
        sign * np.column_stack([state.t, -state.arm_i, -state.arm_j]),
        contact_tangent(state, law, regimes),
        distance,
    )


def _status(found: Found[Flags], proof: str, residual: float) -> ResponseStatus:
    """Return the status of a search whose answer leaves a residual; a mechanism proves nothing."""
    if proof == GIVEN:
        return "given"
    if found.solutions and residual <= TRUSTED:
        doubted = found.status == "unique" and proof == MECHANISM
        return "one found" if doubted else found.status
    return "not converged" if found.solutions or proof == MECHANISM else found.status


def _beyond_strength(law: ContactLaw, state: ContactState, motion: Floats) -> tuple[Flags]:
    """Return contacts (C,) that end beyond their strength under motions `r` (C, 4)."""
    un, ut = np.einsum("cij,cj->ic", contact_kinematics(state, law), motion)
    _, shear, grown = edge_rates(law, state, np.sign(state.shear_force), un, ut)
    strength = law.strength(state)
    with np.errstate(invalid="ignore"):
        most = (strength + grown) + BEYOND_STRENGTH * strength
        return (np.abs(state.shear_force + shear) > most,)


@of_scene
def packing_increment(
    scene: Scene,
    strain: ArrayLike,
    *,
    stress: ArrayLike | None = None,
    candidates: float = CANDIDATES,
) -> PackingResponse:
    """Return the motion of a packing over an increment of strain, in one solve.

    Geometry and stiffness are those of the start. Each contact slides from where it reaches its
    strength, at the cost of one linear complementarity problem. Theory, equation (11.24).

    Parameters
    ----------
    scene : Scene or Snapshot
        The packing, in one state; contacts whose regime says that they slide may slide as well.
    strain : (2, 2) array
        Increment of `H`, compression positive; not a number where the stress is controlled instead.
    stress : (2, 2) array, optional
        Increment of the nominal stress `P` of these components; zero if left out.
    candidates : float
        Contacts with `|T|` of at least this share of their strength may come to slide, 0 to 1.

    Returns
    -------
    PackingResponse
        Increments in place of rates. `status` is 'unique', 'one found' or, where solutions end
        before the whole increment, 'nearest': `disagreeing` contacts that soften, the first one at
        the share `reached`, are kept from sliding and end beyond their strength. `beyond` are
        contacts that end beyond their strength and were no candidates.

    Raises
    ------
    InputError
        If the packing floats, a control is not a number, or the boundary has no volume.

    Examples
    --------
    >>> import numpy as np
    >>> from loops import GrainGraph, LinearFrictional, Scene
    >>> lattice = GrainGraph(x=[[0, 0], [1, 0], [0, 1], [1, 1]], radii=[0.5] * 4,
    ...     contacts=[[0, 1], [1, 0], [2, 3], [3, 2], [0, 2], [2, 0], [1, 3], [3, 1]],
    ...     images=[[0, 0], [1, 0], [0, 0], [1, 0], [0, 0], [0, 1], [0, 0], [0, 1]],
    ...     cell=2 * np.eye(2), normal_force=np.full(8, 0.01))
    >>> scene = Scene(lattice, LinearFrictional(1.0, 0.5, 0.5))
    >>> found = packing_increment(scene, [[1e-3, 0], [0, 0]])
    >>> found.status, found.stress_rate.round(9).tolist()
    ('unique', [[0.001, 0.0], [0.0, 0.0]])
    """
    control = component_control(strain, stress)
    number("candidates", candidates, 0.0, 1.0, open_low=True)
    return rate_problem(scene, yield_band=candidates).increment(control)
