"""The rate problem of contacts at the edge of their law: regimes that agree with their rates.

A contact inside Coulomb's cone has one regime. At yield it may slide or stick; just touching, it
may part, stick or slide to either side. Its rates decide, and these depend on the regimes of all
contacts: a piecewise linear complementarity problem with one solution, none or several.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice, product
from math import prod
from typing import Generic, Literal, Protocol, TypeVar

import numpy as np

from loops.arrays import Floats
from loops.laws.frictional import Regime
from loops.shown import Shown

RateStatus = Literal["unique", "one found", "several", "none", "none found"]
# Number of combinations of regimes up to which all are tried; beyond it, pivoting.
ENUMERATION_LIMIT = 256
# Number of combinations up to which all are tried if pivoting finds nothing.
SEARCH_LIMIT = 8192
# Contacts at yield up to which all combinations of sticking and sliding are tried in the small
# system of their slips, 2,048 at a time: half a second for 16.
MOST_SLIPS, AT_ONCE = 16, 2048
# Determinant over the product of the rows' sizes below which such a system is singular, and the
# wrong sign over the largest rate beyond which a combination is not asked for its rates.
SINGULAR, CLEARLY_WRONG = 1e-13, 1e-6
# Rounding of rates in sign conditions, over the largest rate.
SIGN_TOLERANCE = 1e-10
# Difference within which two solutions are the same, over their norm.
SOLUTION_RTOL = 1e-8


@dataclass(frozen=True, repr=False)
class Choice(Shown):
    """One regime that a contact may take: `Regime` and, when it slides, the sign of `T`."""

    regime: Regime
    side: float = 0.0


OPEN, ELASTIC = Choice(Regime.OPEN), Choice(Regime.ELASTIC)
LEFT, RIGHT = Choice(Regime.SLIDING, 1.0), Choice(Regime.SLIDING, -1.0)
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
    whatever the rates.
    """

    un: Floats
    shear: Floats
    strength: Floats


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


AnyTrial = TypeVar("AnyTrial", bound=Trial)


@dataclass(frozen=True, eq=False, repr=False)
class RateSolution(Shown, Generic[AnyTrial]):
    """One solution: a choice per contact at the edge, and the rates."""

    choices: tuple[Choice, ...]
    rates: AnyTrial


@dataclass(frozen=True, eq=False, repr=False)
class RateProblem(Shown, Generic[AnyTrial]):
    """Solutions of a rate problem.

    Attributes
    ----------
    status : {'unique', 'one found', 'several', 'none', 'none found'}
        Number of solutions. Combinations of regimes that give the same rates count once. 'unique'
        and 'none' are known: every combination was tried. 'one found' and 'none found': not every
        one was, and there may be more.
    solutions : tuple of RateSolution
        All that were found, the one that a path takes first: see `solve_rate_problem`.
    exhaustive : bool
        Whether every combination of regimes was tried, or what says as much about the
        complementarity problem of contacts at yield.
    singular : int
        Combinations whose equations have no single answer.
    tried : int
        Combinations whose rates were solved for; 1 where no contact has a choice.
    combinations : float
        Number of combinations of regimes of the contacts at the edge.
    """

    status: RateStatus
    solutions: tuple[RateSolution[AnyTrial], ...]
    exhaustive: bool
    singular: int
    tried: int
    combinations: float

    @property
    def taken(self) -> RateSolution[AnyTrial]:
        """The solution that a path takes; `IndexError` if there is none."""
        return self.solutions[0]


def solve_rate_problem(
    options: Sequence[Sequence[Choice]],
    rates_for: Callable[[tuple[Choice, ...]], AnyTrial],
    *,
    preferred: Sequence[Choice],
    direction: Floats | None = None,
) -> RateProblem[AnyTrial]:
    """Find the regimes that agree with the rates they cause.

    If no contact has a choice, one solve is enough. Sticking agrees while the shear rate stays
    within the cone, sliding while sticking would leave it, parting while the branch lengthens.

    Of several solutions the first is the one in which contacts with as many options take the same
    regime (the symmetric one), then the one whose rates are closest in direction to `direction`
    (continuity), then the one with most preferred choices. Of combinations with the same rates,
    differing in neutral contacts, that with most preferred choices stands for all.
    """
    count = prod(float(len(choices)) for choices in options)
    singular, trials = 0, 0
    agreeing: list[RateSolution[AnyTrial]] = []

    def search(combinations: Iterable[tuple[Choice, ...]]) -> None:
        nonlocal singular, trials
        for choices in combinations:
            rates = rates_for(choices)
            trials += 1
            if not rates.trusted:
                # The state itself forbids regimes in which a contact slides inside its cone.
                slides = [choice.regime == Regime.SLIDING for choice in choices]
                singular += not np.isposinf(rates.edge.strength[slides]).any()
            elif all(_agreement(options, choices, rates.edge)):
                agreeing.append(RateSolution(choices, rates))

    exhaustive = count <= ENUMERATION_LIMIT
    if not exhaustive:
        starts = [tuple(preferred), *(tuple(can[k] for can in options) for k in (0, -1))]
        for start in dict.fromkeys(starts):
            if not agreeing:
                search(_pivots(options, rates_for, start))
        slips = _slip_problem(options, rates_for)
        if slips is not None:
            trials += 1 + len(options)
            possible, singular = _possible_slips(*slips)
            search(tuple(can[k] for can, k in zip(options, one, strict=True)) for one in possible)
            exhaustive = True
        elif not agreeing and count <= SEARCH_LIMIT:
            search(product(*options))
            exhaustive = True
    else:
        search(product(*options))
    distinct = _distinct(agreeing, preferred)
    distinct.sort(key=lambda found: _rank(found, options, direction, preferred))
    known: tuple[RateStatus, RateStatus] = ("none", "unique")
    if not exhaustive:
        known = ("none found", "one found")
    status: RateStatus = "several" if len(distinct) > 1 else known[len(distinct)]
    return RateProblem(status, tuple(distinct), exhaustive, singular, trials, count)


def _slip_problem(
    options: Sequence[Sequence[Choice]], rates_for: Callable[[tuple[Choice, ...]], AnyTrial]
) -> tuple[Floats, Floats] | None:
    """`q` (m,), `M` (m, m) of `w = q + M z` where every contact sticks or slides on one side.

    `z` are the rates by which the shear forces would leave the cone if the contacts stuck, `w` the
    rates of their distances from it. Rates are linear in the slips, so those of each contact that
    slides alone give a column. None where other regimes are open, or a column is not determined.
    """
    if len(options) > MOST_SLIPS or any(
        [c.regime for c in can] != [Regime.ELASTIC, Regime.SLIDING] for can in options
    ):
        return None
    side = np.array([can[1].side for can in options])
    stuck = tuple(can[0] for can in options)
    rates = rates_for(stuck)
    q = rates.edge.strength - side * rates.edge.shear
    M = np.empty((len(q), len(q)))
    least = SIGN_TOLERANCE * np.abs(q).max(initial=0.0)
    for k, can in enumerate(options):
        one = rates_for((*stuck[:k], can[1], *stuck[k + 1 :]))
        slack = one.edge.strength - side * one.edge.shear
        slip = -slack[k]
        if not (rates.trusted and one.trusted) or abs(slip) <= least:
            return None
        M[:, k] = (slack - q) / slip
        M[k, k] = -q[k] / slip
    return q, M


def _possible_slips(q: Floats, M: Floats) -> tuple[list[list[int]], int]:
    """Combinations, 1 for a contact that slides, without a clearly wrong sign; singular ones."""
    m, size = len(q), np.abs(q).max(initial=0.0)
    possible: list[list[int]] = []
    singular = 0
    for first in range(0, 2**m, AT_ONCE):
        numbers = np.arange(first, min(first + AT_ONCE, 2**m))
        sliding = (numbers[:, None] >> np.arange(m) & 1).astype(bool)
        systems = np.where(sliding[:, None, :], M, -np.eye(m))
        rows = np.linalg.norm(systems, axis=2).prod(axis=1)
        regular = np.abs(np.linalg.det(systems)) > SINGULAR * rows
        right = np.broadcast_to(-q[:, None], (int(regular.sum()), m, 1))
        rates = np.linalg.solve(systems[regular], right)[..., 0]
        agrees = (rates >= -CLEARLY_WRONG * size).all(axis=1)
        possible += sliding[regular][agrees].astype(int).tolist()
        singular += int(np.count_nonzero(~regular))
    return possible, singular


def _agreement(
    options: Sequence[Sequence[Choice]], choices: tuple[Choice, ...], edge: EdgeRates
) -> list[bool]:
    """Whether each contact's choice agrees with the rates."""
    every = np.abs(np.concatenate([edge.un, edge.shear, edge.strength]))
    tol = SIGN_TOLERANCE * max(every[~np.isinf(every)].max(initial=0.0), 1e-300)
    agreement = []
    for k, (can, choice) in enumerate(zip(options, choices, strict=True)):
        un, shear, strength = edge.un[k], edge.shear[k], edge.strength[k]
        if choice == OPEN:
            agrees = un >= -tol
        elif OPEN in can and un > tol:
            agrees = False
        elif choice == ELASTIC:
            sides = [other.side for other in can if other.regime == Regime.SLIDING]
            agrees = all(side * shear <= strength + tol for side in sides)
        else:
            # Without friction there is no sticking to compare with.
            agrees = ELASTIC not in can or choice.side * shear >= strength - tol
        agreement.append(bool(agrees))
    return agreement


def _pivots(
    options: Sequence[Sequence[Choice]],
    rates_for: Callable[[tuple[Choice, ...]], AnyTrial],
    start: tuple[Choice, ...],
) -> Iterator[tuple[Choice, ...]]:
    """Combinations by a semismooth Newton iteration, then by single pivots once it cycles."""
    limit = 20 + 4 * len(options)
    seen: set[tuple[Choice, ...]] = set()
    choices, single = start, False
    for _ in range(limit):
        rates = rates_for(choices)
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
