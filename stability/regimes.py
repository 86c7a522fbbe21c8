"""The rate problem of contacts at the edge of their law: regimes that agree with their rates.

A contact inside Coulomb's cone has one regime. At yield it may slide or stick; just touching, it
may part, stick or slide to either side. Its rates decide, and these depend on the regimes of all
contacts: a piecewise linear complementarity problem with one solution, none or several.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any, Generic, Literal, NamedTuple, Protocol, TypeVar

import numpy as np

from loops.arrays import Flags, Floats, Integers
from loops.arrays import Regimes as RegimeArray
from loops.shown import Shown
from stability.complementarity import (
    STARTS,
    Complementarity,
    Errors,
    Family,
    known_solutions,
    solve_complementarity,
)

RateStatus = Literal["unique", "one found", "several", "family", "none", "none found", "given"]
# Number of combinations of regimes up to which all are solved in full, where that is cheap.
ENUMERATION_LIMIT = 256
# And of contacts that stick or slide: for more the smaller problem of their slips takes less.
FEW = 16
# Number of combinations up to which all are solved in full if pivoting finds nothing.
SEARCH_LIMIT = 8192
# Contacts at yield up to which all combinations of sticking and sliding are tried in the small
# system of their slips: half a second for 16.
MOST_SLIPS = 16
# In place of a proof: contacts at yield of grains with two contacts were kept from sliding.
HELD_STUCK = "two-contact grains stick"
# Difference within which two solutions are the same, over their norm.
SOLUTION_RTOL = 1e-8


# Regimes of a contact at the edge, int8: `Regime`, times the sign of `T` where it slides.
OPEN, STICKS, LEFT, RIGHT = (np.int8(code) for code in (0, 1, 2, -2))
# Columns of options, in the order in which they are tried.
CHOICES = np.array([STICKS, OPEN, LEFT, RIGHT])
# Options of a contact inside its cone where all contacts are tried: only sticking can agree.
INSIDE = np.array([True, False, True, True])


def edge_options(
    touching: Flags, at_yield: Flags, apex: Flags, frictionless: Flags, side: Floats
) -> Flags:
    """Return which of `CHOICES` contacts at the edge may take, (m, 4); `side` the sign of `T`."""
    slides = [apex | (at_yield & (side > 0)), apex | (at_yield & ~(side > 0))]
    return np.column_stack(
        [~frictionless, touching, frictionless | slides[0], ~frictionless & slides[1]]
    )


def sides(regimes: RegimeArray) -> Integers:
    """Return the sign of `T` where contacts slide, 0 elsewhere."""
    return regimes // LEFT


def first_option(options: Flags, wished: Flags) -> RegimeArray:
    """Return the first of the options (m, 4) that is wished for, (m,); where none is the first."""
    wished = options & wished
    return CHOICES[np.where(wished.any(axis=1), wished.argmax(axis=1), options.argmax(axis=1))]


def combinations_of(options: Flags) -> RegimeArray:
    """Return all combinations of the options (m, 4), (R, m)."""
    every = list(product(*(CHOICES[can] for can in options)))
    return np.array(every, dtype=np.int8).reshape(len(every), len(options))


@dataclass(frozen=True, eq=False)
class EdgeRates:
    """Rates that decide on the regimes, one entry per contact at the edge of its law.

    `un` (m,): Normal displacement, positive when the contact opens (times kn, force per time);
    `shear` (m,): Shear force as if the contact stuck; `strength` (m,): Shear force it could carry,
    `mu N'`, with `N' = -kn un'` as if closed; infinite for a contact inside its cone, which sticks
    whatever the rates; `error`: What they may err by, from the rates of all contacts.
    """

    un: Floats
    shear: Floats
    strength: Floats
    error: Floats | float = 0.0


class Trial(Protocol):
    """Rates for one combination of regimes."""

    @property
    def edge(self) -> EdgeRates:
        """Rates of the contacts at the edge."""
        ...

    @property
    def vector(self) -> Floats:
        """(q,) rates by which solutions are compared: `H'`, then the rest in comparable units."""
        ...

    @property
    def trusted(self) -> bool:
        """Whether the rates are the only answer of their equations."""
        ...


Answer = TypeVar("Answer")
AnyTrial = TypeVar("AnyTrial", bound=Trial)


def slip_sides(options: Flags) -> RegimeArray | None:
    """Return the side to which each contact may slide; None if one does more than that or stick."""
    sticks, parts, left, right = options.T
    return left - right * np.int8(1) if (sticks & (left ^ right) & ~parts).all() else None


# `q` (m,), `M` (m, m) and the errors of `w = q + M z`, if known: `z` are the rates by which shear
# forces would leave the cone if the contacts stuck, `w` those of their distances from it.
Slips = tuple[Floats, Floats, Errors] | None


@dataclass(frozen=True, eq=False)
class EdgeProblem(Generic[AnyTrial]):
    """Problem of a search for regimes: those that contacts may take, and the rates they cause.

    `options` (m, 4) are flags of `CHOICES`; `rates` solves for the rates of one combination in
    full. `own_slips` takes the sides (m,) on which contacts may slide; without it the smaller
    problem follows from `m + 1` full solves. Up to `in_full` combinations are all solved in full,
    up to `few` also where that problem is known.
    """

    options: Flags
    rates: Callable[[RegimeArray], AnyTrial]
    in_full: int = ENUMERATION_LIMIT
    few: int = FEW
    own_slips: Callable[[RegimeArray], Slips] | None = None

    @cached_property
    def slips(self) -> Slips:
        """The smaller problem; None where contacts do more than stick or slide.

        Rates are linear in the slips: those of each contact that slides alone give a column.
        """
        side = slip_sides(self.options)
        if side is None:
            return None
        if self.own_slips is not None:
            return self.own_slips(side)
        stuck = np.full(len(side), STICKS)
        rates = self.rates(stuck)
        q = rates.edge.strength - side * rates.edge.shear
        M, error = np.empty((len(q), len(q))), np.empty(len(q))
        for k in range(len(q)):
            one = self.rates(np.where(np.arange(len(q)) == k, side * LEFT, stuck))
            slack = one.edge.strength - side * one.edge.shear
            slip, unsure = -slack[k], float(np.add(rates.edge.error, one.edge.error))
            if not (rates.trusted and one.trusted) or abs(slip) <= unsure:
                return None
            M[:, k] = (slack - q) / slip
            M[k, k] = -q[k] / slip
            error[k] = unsure * (1.0 + np.abs(M[:, k]).max()) / abs(slip)
        return q, M, Errors(float(rates.edge.error), error)


class SlipProblem(NamedTuple):
    """A problem of contacts at yield of which `q` (m,) and `M` (m, m) are known, see `EdgeProblem`.

    What agrees are sets of sliding contacts, (m,) flags in the place of rates: whoever asks solves
    for the rates of those that it needs, with factors of its own. `free` (m,) are the contacts that
    may slide in any case: where there is no solution the others are kept from it. `feasible` tells
    that some slip is known to be enough under every load, `low` what entries of `q` may err by.
    """

    q: Floats
    M: Floats
    free: Flags | None = None
    feasible: bool = False
    low: float = 0.0


@dataclass(frozen=True, eq=False, repr=False)
class RateSolution(Shown, Generic[Answer]):
    """One solution: regimes (m,) of the contacts at the edge, and the rates.

    `agreeing` (m, 4) are all of `CHOICES` that agree with these rates: more than one of a contact
    where these are those of sticking and of sliding alike.
    """

    regimes: RegimeArray
    rates: Answer
    agreeing: Flags


@dataclass(frozen=True, eq=False, repr=False)
class Regimes(Shown, Generic[Answer]):
    """Regimes that agree with the rates they cause: the solutions of a rate problem.

    Attributes
    ----------
    status : {'unique', 'one found', 'several', 'family', 'none', 'none found', 'given'}
        Number of solutions. Combinations of regimes that give the same rates count once: where
        rounding decides between them the contacts are `neutral`. 'unique' and 'none' are known:
        every combination was tried, or there is a proof. 'one found' and 'none found': not every
        one was tried, and there may be more. 'family': a line of solutions at least, see
        `families`; those listed are its corners and any others. 'given': the regimes were told, and
        may disagree with their rates.
    solutions : tuple of RateSolution
        All that were found, the one that a path takes first: see `agreeing`.
    exhaustive : bool
        Whether every combination of regimes was tried, or what says as much about the
        complementarity problem of contacts at yield.
    singular : int
        Combinations whose equations have no single answer.
    tried : int
        Combinations whose rates were solved for; 1 where no contact has a choice.
    combinations : float
        Number of combinations of regimes of the contacts at the edge.
    proof : str
        What the number of solutions stands on where not every combination was solved in full:
        'enumeration' (of the smaller problem), 'positive definite', 'infeasible', or nothing; or
        what limits the answer: 'two-contact grains stick'.
    families : tuple of Family
        Unbroken rows of solutions: contacts at the friction limit (one flag an option list of the
        problem), slip rates at the corners, directions in between.
    contacts : (m,) array or None
        Contacts of these option lists; of several that symmetry maps on each other the first.
    """

    shown = ("status", "proof", "strain_rate", "stress_rate", "tried", "combinations", "singular")

    status: RateStatus
    solutions: tuple[RateSolution[Answer], ...]
    exhaustive: bool
    singular: int
    tried: int
    combinations: float
    proof: str = ""
    families: tuple[Family, ...] = ()
    contacts: Integers | None = None

    @property
    def taken(self) -> RateSolution[Answer]:
        """The solution that a path takes; `IndexError` if there is none."""
        return self.solutions[0]

    @property
    def neutral(self) -> Integers:
        """Contacts whose rates, in the solution that a path takes, agree with other regimes too."""
        if self.contacts is None or not self.solutions:
            return np.empty(0, dtype=np.int64)
        return self.contacts[self.taken.agreeing.sum(axis=1) > 1]

    @property
    def strain_rate(self) -> Floats:
        """`H'` (2, 2), compression positive; not numbers without a solution."""
        return self._mean("strain_rate")

    @property
    def stress_rate(self) -> Floats:
        """Nominal stress rate `P'` (2, 2), compression positive; not numbers without a solution."""
        return self._mean("stress_rate")

    @property
    def cauchy_rate(self) -> Floats:
        """Rate of the Cauchy stress (2, 2), compression positive; not numbers as above."""
        return self._mean("cauchy_rate")

    def _mean(self, name: str) -> Floats:
        """Return a mean rate of the solution that a path takes; nan of a supported cluster."""
        rates = self.taken.rates if self.solutions else None
        return np.asarray(getattr(rates, name, np.full((2, 2), np.nan)))


def agreeing(
    problem: EdgeProblem[Any] | SlipProblem,
    *,
    preferred: RegimeArray | None = None,
    direction: Floats | None = None,
    starts: int = STARTS,
    known: Sequence[Flags] = (),
    complete: str = "",
) -> Regimes[Any]:
    """Find the regimes that agree with the rates they cause.

    If no contact has a choice, one solve is enough. Sticking agrees while the shear rate stays
    within the cone, sliding while sticking would leave it, parting while the branch lengthens.
    Few combinations are all solved in full; more of sticking and sliding in the smaller problem of
    the slips, whose solutions are confirmed by full solves; else pivots from three combinations.

    Of several solutions the first is the one in which contacts with as many options take the same
    regime (the symmetric one), then the one whose rates are closest in direction to `direction`
    (continuity), then the one with most preferred regimes. Of combinations with the same rates,
    differing in neutral contacts, that with most preferred regimes stands for all.

    Of a `SlipProblem` the smaller problem is all there is: sets that are `known`, as from a branch
    of solutions, are tried first. They are all if `complete` names a proof of it, and all that are
    tried without a start. The first solution is that of least slip.
    """
    if isinstance(problem, SlipProblem):
        return of_sets(_sliding_sets(problem, starts, known, complete))
    options = problem.options
    first, last = (CHOICES[can] for can in (options.argmax(1), 3 - options[:, ::-1].argmax(1)))
    preferred = first if preferred is None else preferred
    count, few = combination_count(options), len(options) <= MOST_SLIPS
    search, found = _Search(problem), None
    exhaustive = count <= problem.in_full
    if few and count > min(problem.in_full, problem.few):
        found = search.slips(starts, preferred)
    if found is None and exhaustive:
        search.all_of(combinations_of(options))
    elif found is None:
        for start in {each.tobytes(): each for each in (preferred, first, last)}.values():
            if not search.agreeing:
                search.pivots(start)
        if not search.agreeing and count <= SEARCH_LIMIT:
            search.all_of(combinations_of(options))
            exhaustive = True
        elif not search.agreeing:
            found = search.slips(starts, preferred)
    distinct = _distinct(search.agreeing, preferred)
    proof, lines = (found.proof, found.families) if found else ("", ())
    if not found and few and count > 1 and (search.singular or len(distinct) > 1):
        other = solutions_of_slips(problem, starts)
        lines = other.families if other else ()
    distinct.sort(key=lambda found: _rank(found, options, direction, preferred))
    return Regimes(
        _status(len(distinct), exhaustive or bool(proof), lines),
        tuple(distinct),
        exhaustive or bool(proof),
        search.singular,
        search.tried,
        count,
        proof,
        tuple(lines) if distinct else (),
    )


def solutions_of_slips(problem: EdgeProblem[Any], starts: int) -> Complementarity | None:
    """Solve the smaller problem of contacts that stick or slide; None where there is none."""
    if (pair := problem.slips) is None:
        return None
    return solve_complementarity(*pair[:2], starts, enumerated=MOST_SLIPS, errors=pair[2])


def combination_count(options: Flags) -> float:
    """Return the number of combinations of regimes."""
    return float(np.prod(options.sum(axis=1), dtype=float))


def _status(solutions: int, exhaustive: bool, lines: Sequence[Family]) -> RateStatus:
    """Return in a word how many solutions there are, and whether that is known."""
    if solutions > 1 or (solutions and lines):
        return "family" if lines else "several"
    known: tuple[RateStatus, RateStatus] = ("none", "unique")
    return known[solutions] if exhaustive else ("none found", "one found")[solutions]


def _sliding_sets(
    problem: SlipProblem, starts: int, known: Sequence[Flags], complete: str
) -> Complementarity:
    """Find the sets that slide in each solution."""
    q, M, free, feasible, low = problem
    if complete:
        return known_solutions(q, M, known, complete)
    found = solve_complementarity(q, M, starts, known, feasible, errors=Errors(low))
    if starts == 0 or len(found.active) or found.proof or free is None or free.all():
        return found
    left = q[free], M[np.ix_(free, free)]
    others = solve_complementarity(*left, starts, errors=Errors(low)).active
    sets = np.zeros((len(others), len(q)), dtype=bool)
    sets[:, free] = others
    return Complementarity(sets, HELD_STUCK) if len(others) else found


def of_sets(found: Complementarity) -> Regimes[Flags]:
    """Return sets of sliding contacts as the regimes that agree."""
    exhaustive = found.proof not in ("", HELD_STUCK)
    regimes = np.where(found.active, LEFT, STICKS)
    alone = regimes[..., None] == CHOICES
    sets = tuple(map(RateSolution, regimes, found.active, alone))
    status = _status(len(sets), exhaustive, found.families)
    numbers = found.singular, 0, float(min(2 ** len(found.active.T), 2**1023))
    return Regimes(status, sets, exhaustive, *numbers, found.proof, found.families)


def given_regimes(problem: EdgeProblem[AnyTrial], regimes: RegimeArray) -> Regimes[AnyTrial]:
    """Return the rates with regimes that were told, whether they agree or not."""
    rates = problem.rates(regimes)
    found = (RateSolution(regimes, rates, regimes[:, None] == CHOICES),) if rates.trusted else ()
    status: RateStatus = "given" if found else "none"
    return Regimes(status, found, False, int(not found), 1, combination_count(problem.options))


class _Search(Generic[AnyTrial]):
    """Combinations solved in full, and those that agree with their rates."""

    def __init__(self, problem: EdgeProblem[AnyTrial]) -> None:
        self.problem = problem
        self.singular, self.tried = 0, 0
        self.agreeing: list[RateSolution[AnyTrial]] = []

    def all_of(self, combinations: RegimeArray) -> None:
        """Solve combinations and keep those that agree."""
        for regimes in combinations:
            self.judge(regimes, self.problem.rates(regimes))

    def judge(self, regimes: RegimeArray, rates: AnyTrial) -> None:
        """Keep a combination that agrees with its rates."""
        self.tried += 1
        options, edge = self.problem.options, rates.edge
        if not rates.trusted:
            # The state itself forbids regimes in which a contact slides inside its cone.
            self.singular += not np.isposinf(edge.strength[sides(regimes) != 0]).any()
        elif agreement(options, regimes, edge).all():
            alike = options & agreement(options, CHOICES[:, None], edge).T
            self.agreeing.append(RateSolution(regimes, rates, alike))

    def slips(self, starts: int, preferred: RegimeArray) -> Complementarity | None:
        """Confirm the solutions of the smaller problem, also with neutral contacts as preferred."""
        if (found := solutions_of_slips(self.problem, starts)) is None:
            return None
        options = self.problem.options
        self.tried += 1 + len(options)
        slides = first_option(options, sides(CHOICES) != 0)
        for active in found.active:
            regimes = np.where(active, slides, STICKS)
            rates = self.problem.rates(regimes)
            self.judge(regimes, rates)
            named = np.where(agreement(options, preferred, rates.edge), preferred, regimes)
            if rates.trusted and (named != regimes).any():
                self.judge(named, self.problem.rates(named))
        self.singular = found.singular
        return found

    def pivots(self, regimes: RegimeArray) -> None:
        """Pivot by a semismooth Newton iteration, by single contacts once it cycles."""
        options, seen, single = self.problem.options, set[bytes](), False
        for _ in range(20 + 4 * len(options)):
            rates = self.problem.rates(regimes)
            wrong = np.flatnonzero(~agreement(options, regimes, rates.edge))
            if len(wrong) == 0:
                # The regimes of an untrusted solve may agree with its rates: the search ends there.
                if rates.trusted:
                    self.judge(regimes, rates)
                return
            single = single or regimes.tobytes() in seen
            seen.add(regimes.tobytes())
            wrong = wrong[: 1 if single else None]
            regimes = regimes.copy()
            regimes[wrong] = _natural(options, regimes, rates.edge)[wrong]


def agreement(options: Flags, regimes: RegimeArray, edge: EdgeRates) -> Flags:
    """Tell of each contact whether its regime agrees with its rates, batch axes (..., m) first."""
    sticks, parts, left, right = options.T
    un, shear, strength, tol = edge.un, edge.shear, edge.strength, edge.error
    held = ~left | (shear <= strength + tol)
    held &= ~right | (-shear <= strength + tol)
    # Without friction there is no sticking to compare with.
    slid = ~sticks | (sides(regimes) * shear >= strength - tol)
    closed = np.where(regimes == STICKS, held, slid) & ~(parts & (un > tol))
    return np.asarray(np.where(regimes == OPEN, un >= -tol, closed))


def _natural(options: Flags, regimes: RegimeArray, edge: EdgeRates) -> RegimeArray:
    """Return the regimes that contacts take under the given rates."""
    sticks, parts, left, right = options.T
    beyond = [left & (edge.shear > edge.strength), right & (-edge.shear > edge.strength)]
    return np.select([parts & (edge.un > 0), *beyond, sticks], [OPEN, LEFT, RIGHT, STICKS], regimes)


def _distinct(
    agreeing: list[RateSolution[AnyTrial]], preferred: RegimeArray
) -> list[RateSolution[AnyTrial]]:
    """Solutions with different rates; of equal ones that with most preferred regimes."""
    groups: list[list[RateSolution[AnyTrial]]] = []
    for found in agreeing:
        for group in groups:
            a, b = group[0].rates.vector, found.rates.vector
            size = max(np.linalg.norm(a), np.linalg.norm(b))
            if np.linalg.norm(a - b) <= SOLUTION_RTOL * size:
                group.append(found)
                break
        else:
            groups.append([found])

    return [max(group, key=lambda found: _matches(found, preferred)) for group in groups]


def _matches(found: RateSolution[AnyTrial], preferred: RegimeArray) -> int:
    return int(np.count_nonzero(found.regimes == preferred))


def _rank(
    found: RateSolution[AnyTrial],
    options: Flags,
    direction: Floats | None,
    preferred: RegimeArray,
) -> tuple[int, float, int]:
    """Number of different regimes, turn from the previous direction, preferences missed."""
    kinds = np.unique([options.sum(axis=1), np.abs(found.regimes)], axis=1).shape[1]
    missed = -_matches(found, preferred)
    if direction is None:
        return kinds, 0.0, missed
    vector = found.rates.vector
    size = float(np.linalg.norm(vector) * np.linalg.norm(direction))
    return kinds, -float(vector @ direction) / size if size > 0 else 0.0, missed
