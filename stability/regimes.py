"""The rate problem of contacts at the edge of their law: regimes that agree with their rates.

A contact inside Coulomb's cone has one regime. At yield it may slide or stick; just touching, it
may part, stick or slide to either side. Its rates decide, and these depend on the regimes of all
contacts: a piecewise linear complementarity problem with one solution, none or several.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import compress, cycle, islice, product
from math import prod
from typing import Any, Generic, Literal, NamedTuple, Protocol, TypeVar

import numpy as np

from loops.arrays import Flags, Floats, Integers
from loops.arrays import Regimes as RegimeArray
from loops.laws.frictional import Regime
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
# Number of combinations up to which all are solved in full if pivoting finds nothing.
SEARCH_LIMIT = 8192
# Contacts at yield up to which all combinations of sticking and sliding are tried in the small
# system of their slips: half a second for 16.
MOST_SLIPS = 16
# In place of a proof: contacts at yield of grains with two contacts were kept from sliding.
HELD_STUCK = "two-contact grains stick"
# Difference within which two solutions are the same, over their norm.
SOLUTION_RTOL = 1e-8


@dataclass(frozen=True, repr=False)
class Choice(Shown):
    """One regime that a contact may take: `Regime` and, when it slides, the sign of `T`."""

    regime: Regime
    side: float = 0.0


OPEN = Choice(Regime.OPEN)
ELASTIC = Choice(Regime.ELASTIC)
LEFT = Choice(Regime.SLIDING, 1.0)
RIGHT = Choice(Regime.SLIDING, -1.0)
# Options of a contact at yield; of a `SlipProblem` either side is called the left one.
SLIPS = (ELASTIC, LEFT)
# Options of a contact inside its cone where all contacts are tried: only sticking can agree.
INSIDE = (ELASTIC, LEFT, RIGHT)


def edge_options(
    *, touching: bool, at_yield: bool, apex: bool, frictionless: bool, side: float
) -> tuple[Choice, ...]:
    """Regimes open to a contact at the edge of its law, `side` the sign of its `T`."""
    parts = (OPEN,) if touching else ()
    if frictionless:
        return (LEFT, *parts)
    if apex:
        return (ELASTIC, *parts, LEFT, RIGHT)
    return (ELASTIC, LEFT if side > 0 else RIGHT, *parts) if at_yield else (ELASTIC, *parts)


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
AnyRates = TypeVar("AnyRates", bound=Trial, covariant=True)


class EdgeProblem(Protocol[AnyRates]):
    """Problem of a search for regimes: those that contacts may take, and the rates they cause."""

    @property
    def options(self) -> Sequence[Sequence[Choice]]:
        """Regimes that each contact at the edge may take."""
        ...

    @property
    def in_full(self) -> int:
        """Number of combinations up to which each is solved in full, without a smaller problem."""
        ...

    def rates(self, choices: tuple[Choice, ...]) -> AnyRates:
        """Rates for one combination of regimes, one full solve."""
        ...

    @property
    def condensed(self) -> tuple[Floats, Floats, Errors] | None:
        """`q` (m,), `M` (m, m) of `w = q + M z`; None where contacts do more than stick or slide.

        `z` are the rates by which the shear forces would leave the cone if the contacts stuck, `w`
        those of their distances from it.
        """
        ...


@dataclass(frozen=True, eq=False)
class FullProblem(Generic[AnyTrial]):
    """A problem of which only full solves are known; the smaller one follows from `m + 1` of them.

    `options` and `rates` are those of `EdgeProblem`.
    """

    options: Sequence[Sequence[Choice]]
    rates: Callable[[tuple[Choice, ...]], AnyTrial]
    in_full: int = ENUMERATION_LIMIT

    @cached_property
    def condensed(self) -> tuple[Floats, Floats, Errors] | None:
        """Rates are linear in the slips: those of each contact that slides alone give a column."""
        if any([c.regime for c in can] != [Regime.ELASTIC, Regime.SLIDING] for can in self.options):
            return None
        side = np.array([can[1].side for can in self.options])
        stuck = tuple(can[0] for can in self.options)
        rates = self.rates(stuck)
        q = rates.edge.strength - side * rates.edge.shear
        M, error = np.empty((len(q), len(q))), np.empty(len(q))
        for k, can in enumerate(self.options):
            one = self.rates((*stuck[:k], can[1], *stuck[k + 1 :]))
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
    """One solution: a choice per contact at the edge, and the rates.

    `agreeing` are all choices of each contact that agree with these rates: more than one where
    these are those of sticking and of sliding alike.
    """

    choices: tuple[Choice, ...]
    rates: Answer
    agreeing: tuple[tuple[Choice, ...], ...] = ()


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
        return self.contacts[[len(can) > 1 for can in self.taken.agreeing]]

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
    preferred: Sequence[Choice] = (),
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
    (continuity), then the one with most preferred choices. Of combinations with the same rates,
    differing in neutral contacts, that with most preferred choices stands for all.

    Of a `SlipProblem` the smaller problem is all there is: sets that are `known`, as from a branch
    of solutions, are tried first. They are all if `complete` names a proof of it, and all that are
    tried without a start. The first solution is that of least slip.
    """
    if isinstance(problem, SlipProblem):
        return of_sets(_sliding_sets(problem, starts, known, complete))
    options, preferred = problem.options, tuple(preferred)
    count = prod(float(len(choices)) for choices in options)
    search = _Search(problem)
    exhaustive, proof = count <= problem.in_full, ""
    lines: tuple[Family, ...] = ()
    if exhaustive:
        search.all_of(product(*options))
    elif len(options) <= MOST_SLIPS and (pair := problem.condensed) is not None:
        found = solve_complementarity(*pair[:2], enumerated=MOST_SLIPS, errors=pair[2])
        search.condensed(found, preferred)
        exhaustive, proof, lines = True, found.proof, found.families
    else:
        ends = [tuple(can[k] for can in options) for k in (0, -1)]
        for start in dict.fromkeys([preferred, *ends]):
            if not search.agreeing:
                search.all_of(_pivots(problem, start))
        if not search.agreeing and count <= SEARCH_LIMIT:
            search.all_of(product(*options))
            exhaustive = True
        elif not search.agreeing and (pair := problem.condensed) is not None:
            found = solve_complementarity(*pair[:2], starts, errors=pair[2])
            search.condensed(found, preferred)
            exhaustive, proof, lines = bool(found.proof), found.proof, found.families
    distinct = _distinct(search.agreeing, preferred)
    if not lines and len(options) <= MOST_SLIPS and (search.singular or len(distinct) > 1):
        if count > 1 and (pair := problem.condensed) is not None:
            found = solve_complementarity(*pair[:2], enumerated=MOST_SLIPS, errors=pair[2])
            lines = found.families
    distinct.sort(key=lambda found: _rank(found, options, direction, preferred))
    return Regimes(
        _status(len(distinct), exhaustive, lines),
        tuple(distinct),
        exhaustive,
        search.singular,
        search.tried,
        count,
        proof,
        tuple(lines) if distinct else (),
    )


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
    sets = tuple(RateSolution(tuple(SLIPS[s] for s in one.tolist()), one) for one in found.active)
    status = _status(len(sets), exhaustive, found.families)
    numbers = found.singular, 0, prod([2.0] * len(found.active.T))
    return Regimes(status, sets, exhaustive, *numbers, found.proof, found.families)


def given_regimes(problem: EdgeProblem[AnyTrial], choices: Sequence[Choice]) -> Regimes[AnyTrial]:
    """Return the rates with regimes that were told, whether they agree or not."""
    taken, count = tuple(choices), prod(float(len(can)) for can in problem.options)
    rates = problem.rates(taken)
    found = (RateSolution(taken, rates),) if rates.trusted else ()
    status: RateStatus = "given" if found else "none"
    return Regimes(status, found, False, int(not found), 1, count)


class _Search(Generic[AnyTrial]):
    """Combinations solved in full, and those that agree with their rates."""

    def __init__(self, problem: EdgeProblem[AnyTrial]) -> None:
        self.problem = problem
        self.singular, self.tried = 0, 0
        self.agreeing: list[RateSolution[AnyTrial]] = []

    def all_of(self, combinations: Iterable[tuple[Choice, ...]]) -> None:
        """Solve combinations and keep those that agree."""
        for choices in combinations:
            self.judge(choices, self.problem.rates(choices))

    def judge(self, choices: tuple[Choice, ...], rates: AnyTrial) -> None:
        """Keep a combination that agrees with its rates."""
        self.tried += 1
        if not rates.trusted:
            # The state itself forbids regimes in which a contact slides inside its cone.
            slides = [choice.regime == Regime.SLIDING for choice in choices]
            self.singular += not np.isposinf(rates.edge.strength[slides]).any()
        elif all(_agreement(self.problem.options, choices, rates.edge)):
            alike = _alike(self.problem.options, rates.edge)
            self.agreeing.append(RateSolution(choices, rates, alike))

    def condensed(self, found: Complementarity, preferred: tuple[Choice, ...]) -> None:
        """Confirm the solutions of the smaller problem, also with neutral contacts as preferred."""
        options = self.problem.options
        self.tried += 1 + len(options)
        for active in found.active:
            choices = tuple(can[int(s)] for can, s in zip(options, active, strict=True))
            rates = self.problem.rates(choices)
            self.judge(choices, rates)
            wished = _agreement(options, preferred, rates.edge)
            named = tuple(p if w else c for p, c, w in zip(preferred, choices, wished, strict=True))
            if rates.trusted and named != choices:
                self.judge(named, self.problem.rates(named))
        self.singular = found.singular


def agreement(
    options: Sequence[Sequence[Choice]], regime: RegimeArray, side: Floats, edge: EdgeRates
) -> Flags:
    """Tell of each contact whether its regime agrees with its rates, batch axes (..., m) first."""
    opens, sticks = (
        np.array([one in can for can in options], dtype=bool) for one in (OPEN, ELASTIC)
    )
    sides = [np.array([one in can for can in options], dtype=bool) for one in (LEFT, RIGHT)]
    un, shear, strength = edge.un, edge.shear, edge.strength
    tol = edge.error
    held = ~sides[0] | (shear <= strength + tol)
    held &= ~sides[1] | (-shear <= strength + tol)
    # Without friction there is no sticking to compare with.
    slid = ~sticks | (side * shear >= strength - tol)
    closed = np.where(regime == Regime.ELASTIC, held, slid) & ~(opens & (un > tol))
    return np.asarray(np.where(regime == Regime.OPEN, un >= -tol, closed))


def _agreement(
    options: Sequence[Sequence[Choice]], choices: tuple[Choice, ...], edge: EdgeRates
) -> list[bool]:
    regime = np.array([choice.regime for choice in choices], dtype=np.int8)
    side = np.array([choice.side for choice in choices], dtype=float)
    return [bool(agrees) for agrees in agreement(options, regime, side, edge)]


def _alike(options: Sequence[Sequence[Choice]], edge: EdgeRates) -> tuple[tuple[Choice, ...], ...]:
    """Return all choices of each contact that agree with its rates."""
    most = max(map(len, options), default=0)
    tried = list(zip(*(islice(cycle(can), most) for can in options), strict=True))
    flags = zip(*(_agreement(options, choices, edge) for choices in tried), strict=True)
    return tuple(tuple(compress(can, row)) for can, row in zip(options, flags, strict=True))


def _pivots(
    problem: EdgeProblem[AnyTrial], start: tuple[Choice, ...]
) -> Iterator[tuple[Choice, ...]]:
    """Combinations by a semismooth Newton iteration, then by single pivots once it cycles."""
    options = problem.options
    limit = 20 + 4 * len(options)
    seen: set[tuple[Choice, ...]] = set()
    choices, single = start, False
    for _ in range(limit):
        rates = problem.rates(choices)
        agreement = _agreement(options, choices, rates.edge)
        if rates.trusted and all(agreement):
            yield choices
            return
        wrong = [k for k, agrees in enumerate(agreement) if not agrees]
        # The regimes of an untrusted solve may agree with its rates: the search ends there.
        if not wrong:
            return
        single = single or choices in seen
        seen.add(choices)
        changed = list(choices)
        for k in islice(wrong, 1 if single else None):
            changed[k] = _natural(options[k], rates.edge, k, choices[k])
        choices = tuple(changed)


def _natural(can: Sequence[Choice], edge: EdgeRates, k: int, choice: Choice) -> Choice:
    """Regime that a contact takes under the given rates."""
    if OPEN in can and edge.un[k] > 0:
        return OPEN
    for other in can:
        if other.regime == Regime.SLIDING and other.side * edge.shear[k] > edge.strength[k]:
            return other
    return ELASTIC if ELASTIC in can else choice


def _distinct(
    agreeing: list[RateSolution[AnyTrial]], preferred: Sequence[Choice]
) -> list[RateSolution[AnyTrial]]:
    """Solutions with different rates; of equal ones that with most preferred choices."""
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


def _matches(found: RateSolution[AnyTrial], preferred: Sequence[Choice]) -> int:
    return sum(a == b for a, b in zip(found.choices, preferred, strict=True))


def _rank(
    found: RateSolution[AnyTrial],
    options: Sequence[Sequence[Choice]],
    direction: Floats | None,
    preferred: Sequence[Choice],
) -> tuple[int, float, int]:
    """Number of different regimes, turn from the previous direction, preferences missed."""
    kinds = {(len(can), choice.regime) for can, choice in zip(options, found.choices, strict=True)}
    missed = -_matches(found, preferred)
    if direction is None:
        return len(kinds), 0.0, missed
    vector = found.rates.vector
    size = float(np.linalg.norm(vector) * np.linalg.norm(direction))
    return len(kinds), -float(vector @ direction) / size if size > 0 else 0.0, missed
