"""Regions of directions on which a packing's response is linear, and the cones where W2 < 0."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from loops.arrays import Flags, Floats, Integers
from stability.complementarity import (
    ENUMERATED,
    NAMED_STARTS,
    known_solutions,
    positive_definite,
    scaled_definite,
    solve_from,
)
from stability.directional.branches import plane_directions, works
from stability.packing.response import (
    CRITICAL,
    SCALED,
    SOLVED,
    STARTED,
    TRUSTED,
    WHOLE_CIRCLE,
    PackingRates,
    PackingResponse,
    Solved,
)
from stability.programmes import MixedControl, direction_control
from stability.regimes import HELD_STUCK
from stability.second_order_work import plane_cone
from stability.solution_branch import TURN, SolutionBranch, solutions_over_slip, trace_branch
from stability.spectra import subspace_basis

Driven = Literal["strain", "stress"]
Subspace = Literal["diagonal", "symmetric"]

# Normalised W2 within this has no sign.
NEUTRAL = 1e-9
# Directions closer than this, in radians, are one.
SAME_DIRECTION = 1e-10
HALVINGS = 40
# Strain directions in which solutions are sought whose images may be missed otherwise.
SEEDS = 24
# Segments of a branch of few contacts at most.
FEW_SEGMENTS = 500
# Contacts that are tried as the critical one.
CRITICAL_TRIED = 3
# With more contacts at yield branches take the place of such trials, and of most starts.
MANY_CONTACTS = 300
# Where both components fall nearly all contacts at yield stick: a solution is found at once.
UNLOADING = -np.sqrt([0.5, 0.5])


class DirectionAnswer(NamedTuple):
    """Response along a direction, its normalised W2 and its region; nan and -1 if undetermined.

    `rates` (k, 2, 4) are strain and stress rates of all solutions that are known, `slides` (k,) the
    number of contacts that slide; the first one is that of the response.
    """

    response: PackingResponse
    normalised: float
    piece: int
    rates: Floats
    slides: Integers


class Cones(NamedTuple):
    """(M, 2) angles between which `W2 < 0`, and whether it vanishes there."""

    ends: Floats
    refined: Flags


class RegimeRegions:
    """Responses in a subspace by direction, and the regions of constant regimes found on the way.

    `tangents` are those of the subspace; `arcs`, in the plane, the angles that bound each region.
    In the plane each solution is followed around the circle as soon as it is found: `branches` tell
    the solutions of all other directions, folds included.
    """

    def __init__(
        self, rates: PackingRates, control: Driven, subspace: Subspace, starts: int
    ) -> None:
        self.rates, self.driven, self.starts = rates, control, starts
        self.subspace, self.basis = subspace, subspace_basis(subspace)
        self.number: dict[bytes, int] = {}
        self.tangents: list[Floats] = []
        self.arcs: list[Floats] = []
        self.branches: list[SolutionBranch] = []
        self.answered: list[tuple[Floats, Flags]] = []
        self.complete = ""
        self.critical: int | None = None
        self.traced = len(self.basis) == 2 and rates.small and len(rates.every) > 0
        if not self.traced:
            return
        # `Q` and `M` of all directions of the plane.
        units = [rates.problem(self.control(e)) for e in np.eye(2)]
        self.circle = np.column_stack([q for q, _ in units]), units[0][1]
        unloading = solve_from(self.circle[0] @ UNLOADING, self.circle[1], rates.none)
        if unloading is not None:
            self._trace(UNLOADING, unloading)
        self._prove()
        if control == "stress" and not self.complete:
            self._map_strains()

    def _prove(self) -> None:
        """Tell whether directions have one solution, or all are counted over a contact's slip."""
        M = self.circle[1]
        if not ENUMERATED < len(M) <= STARTED or self.rates.slips_left > TRUSTED:
            return
        single, scale, blame = scaled_definite(M)
        # The branch from the unloading direction tells the solution of each where it closes.
        around = [branch for branch in self.branches if branch.closed and branch.winding == 1]
        if single and len(around) == 1:
            self.complete = SCALED
        tried = 0 if single or len(M) > MANY_CONTACTS else CRITICAL_TRIED
        for k in np.argsort(-blame)[:tried]:
            rest = np.arange(len(M)) != k
            if scaled_definite(M[np.ix_(rest, rest)], scale[rest])[0]:
                self.critical = int(k)
                return

    def _map_strains(self) -> None:
        """Follow the images of the strain directions' solutions over the stress directions.

        With the regimes fixed `P' = A H'`, so a branch over strains is one over stresses too. Where
        each strain direction has one solution, its image is all that there is.
        """
        strains = RegimeRegions(self.rates, "strain", "diagonal", self.starts)
        strains.seek()
        for branch in strains.branches:
            middle, sliding = branch.longest
            control = strains.control(plane_directions(np.asarray(middle)))
            stress = self.basis @ self.rates.rates_of(control, sliding)[1]
            if not self._known(stress, sliding):
                self._trace(stress, sliding)
        single = strains.complete or positive_definite(strains.circle[1])
        if single and len(strains.branches) == 1:
            if strains.branches[0].closed and strains.branches[0].winding == 1:
                if [branch.closed for branch in self.branches] == [True]:
                    self.complete = WHOLE_CIRCLE

    def seek(self, count: int = SEEDS) -> None:
        """Search from some directions around the circle, besides the one that unloads."""
        if self.complete or positive_definite(self.circle[1]):
            return
        for angle in TURN * np.arange(count) / count:
            direction = plane_directions(np.asarray(angle))
            found = solve_from(self.circle[0] @ direction, self.circle[1], self.rates.none)
            if found is not None and not self._known(direction, found):
                self._trace(direction, found)

    def sets(self, direction: Floats, first: int = 0) -> list[Flags]:
        """Return sliding contacts of solutions of branches, from one on, along a direction."""
        angle = float(np.arctan2(*direction[1::-1]))
        return [branch.sliding[k] for branch in self.branches[first:] for k in branch.at(angle)]

    def _known(self, direction: Floats, sliding: Flags) -> bool:
        return any(np.array_equal(sliding, other) for other in self.sets(direction))

    def _trace(self, direction: Floats, sliding: Flags) -> None:
        """Follow a solution around the circle."""
        few = len(self.rates.every) <= ENUMERATED
        # Where every combination is tried branches only tell folds; in a lattice they don't close.
        if few and not all(branch.closed for branch in self.branches):
            return
        angle = float(np.arctan2(direction[1], direction[0]))
        most = FEW_SEGMENTS if few else 20_000
        self.branches.append(trace_branch(*self.circle, angle, sliding, most))

    @property
    def folds(self) -> Floats:
        """(k,) angles at which branches turn back, sorted, in [0, 2 pi)."""
        angles = [branch.folds for branch in self.branches]
        return np.unique(np.concatenate([np.empty(0), *angles]))

    def control(self, direction: Floats) -> MixedControl:
        """Return the control along a direction; strain outside of the subspace is zero."""
        return direction_control(direction, self.subspace, self.driven)

    def at(self, direction: Floats, starts: int | None = None) -> DirectionAnswer:
        """Return the response along a direction; with zero starts from the known branches alone."""
        control = self.control(direction)
        solved = self._solved(direction, control, starts)
        response = solved.response
        if self.traced and response.proof != HELD_STUCK and not self.complete:
            for active in solved.solutions:
                if not self._known(direction, active):
                    self._trace(direction, active)
        if response.status not in SOLVED:
            none = np.empty((0, 2, 4)), np.empty(0, dtype=np.int64)
            return DirectionAnswer(response, np.nan, -1, *none)
        self.answered.append((direction, solved.active))
        # The region of these regimes, entered for the first time or known.
        region = self.number.setdefault(solved.active.tobytes(), len(self.number))
        if region == len(self.tangents):
            factor = self.rates.factor(solved.active)
            tangent = self.basis @ factor.tangent @ self.basis.T
            lines = self.rates.leaving(solved.active, factor.relative) @ self.basis.T
            if self.driven == "stress":
                lines = lines @ np.linalg.inv(tangent)
            plane = len(self.basis) == 2
            self.tangents.append(tangent)
            self.arcs.append(_arc(lines, direction) if plane else np.full(2, np.nan))
        own = response.strain_rate.ravel(), response.stress_rate.ravel()
        others = [self.rates.rates_of(control, active) for active in solved.solutions[1:]]
        rates = np.array([own, *others])
        slides = np.count_nonzero(solved.solutions, axis=1)
        normalised = float(self.normalised(rates)[0])
        return DirectionAnswer(response, normalised, region, rates, slides)

    def normalised(self, rates: Floats) -> Floats:
        """Return W2 over the sizes of strain and stress rates (k, 2, 4) in the subspace, (k,)."""
        strain, stress = np.moveaxis(rates @ self.basis.T, 1, 0)
        size = np.linalg.norm(strain, axis=1, keepdims=True)
        return works(strain / np.where(size > 0, size, 1.0), stress)[1]

    def _solved(self, direction: Floats, control: MixedControl, starts: int | None) -> Solved:
        """Answer a direction from known branches, new starts or the nearest answer."""
        rates, known = self.rates, self.sets(direction)
        complete = self.complete if len(rates.every) > ENUMERATED else ""
        if self.critical is not None and not complete:
            # All solutions, counted over the slip of the critical contact.
            (Q, M), k = self.circle, self.critical
            q, rest = Q @ direction, np.arange(len(M)) != k
            start = solve_from(q[rest], M[np.ix_(rest, rest)], rates.none[rest])
            sets = None
            if start is not None:
                slides = rates.none.copy()
                slides[rest] = start
                sets = solutions_over_slip(q, M, k, slides)
            # Each set must solve the problem to rounding; otherwise nothing was shown.
            if sets is not None and len(known_solutions(q, M, sets, "").active) == len(sets):
                known, complete = sets, CRITICAL
        if starts is None:
            few = self.traced and len(rates.every) > MANY_CONTACTS
            starts = min(self.starts, NAMED_STARTS) if few else self.starts
        solved = rates.solved(control, starts, known, complete)
        if solved.response.status not in SOLVED and not solved.response.proof:
            solved = self._from_nearest(direction, control) or solved
        return solved

    def _from_nearest(self, direction: Floats, control: MixedControl) -> Solved | None:
        """Follow the solution of the nearest answered direction along the great circle to here."""
        if len(self.basis) == 2 or not (self.answered and self.rates.small):
            return None
        first, sliding = max(self.answered, key=lambda one: float(one[0] @ direction))
        if np.linalg.norm(direction - first) < SAME_DIRECTION:
            return self.rates.solved(control, 1, [sliding])
        units = [self.rates.problem(self.control(one)) for one in (first, direction)]
        Q, M = np.column_stack([q for q, _ in units]), units[0][1]
        branch = trace_branch(Q, M, 0.0, sliding)
        ends = branch.at(0.5 * np.pi)
        found = known_solutions(Q[:, 1], M, list(branch.sliding[ends]), "")
        if not len(found.active):
            return None
        return self.rates.solved(control, 1, list(found.active))

    def elastic(self, direction: Floats) -> Floats:
        """Return `H'` and `P'` (2, 2, 2) with all contacts at yield sticking."""
        rates = self.rates.rates_of(self.control(direction), self.rates.none)
        return np.reshape(rates, (2, 2, 2))

    def tangent_along(self, direction: Floats) -> tuple[Floats, Floats]:
        """Return the tangent and the strain along a direction."""
        found = self.at(direction)
        return self.tangents[found.piece], self.basis @ found.response.strain_rate.ravel()

    def root(self, found: DirectionAnswer, a: float, b: float) -> float | None:
        """Return the angle nearest to `a` in the region up to `b` where W2 vanishes, if any."""
        tangent, arc = self.tangents[found.piece], self.arcs[found.piece]
        form = tangent if self.driven == "strain" else np.linalg.inv(tangent)
        low, high = min(a, b) - SAME_DIRECTION, max(a, b) + SAME_DIRECTION
        ends = plane_cone(form, rtol=0.0).edges
        angles = ends + np.pi * np.arange(-4, 7)[:, None]
        inside = (angles >= low) & (angles <= high)
        middle = 0.5 * (arc[0] + arc[1])
        off = np.abs(np.mod(angles - middle + np.pi, TURN) - np.pi)
        inside &= off <= 0.5 * (arc[1] - arc[0]) + SAME_DIRECTION
        near = angles[inside]
        return float(near[np.argmin(np.abs(near - a))]) if len(near) else None


def cones(
    pieces: RegimeRegions, directions: Floats, answers: list[DirectionAnswer]
) -> Cones | None:
    """Return cones of negative W2 in the plane; None elsewhere, or with half a turn left out."""
    if directions.shape[1] != 2:
        return None
    theta = np.mod(np.arctan2(directions[:, 1], directions[:, 0]), TURN)
    turn = np.argsort(theta, kind="stable")
    theta, around = theta[turn], [answers[k] for k in turn]
    steps = np.diff(theta, append=theta[:1] + TURN)
    if steps.max() >= np.pi:
        return None
    negative = np.array([answer.normalised < -NEUTRAL for answer in around])
    if negative.all():
        return Cones(np.array([[theta[0], theta[0] + TURN]]), np.zeros((1, 2), dtype=bool))
    ends, refined, count = [], [], len(theta)
    for first in np.flatnonzero(negative & ~np.roll(negative, 1)):
        length = int(np.argmin(np.roll(negative, -first)))
        last, after = (first + length - 1) % count, (first + length) % count
        begin, sure = _end(
            pieces, around[first], around[first - 1], theta[first], theta[first] - steps[first - 1]
        )
        width = float(steps[(first + np.arange(length - 1)) % count].sum())
        at = theta[first] + width
        end, certain = _end(pieces, around[last], around[after], at, at + steps[last])
        ends.append([begin, end])
        refined.append([sure, certain])
    return Cones(np.array(ends).reshape(-1, 2), np.array(refined, dtype=bool).reshape(-1, 2))


def _end(
    pieces: RegimeRegions, inside: DirectionAnswer, outside: DirectionAnswer, a: float, b: float
) -> tuple[float, bool]:
    """Return the angle from `a` (W2 < 0) to `b` where W2 vanishes, and True; else `a`, False."""
    for _ in range(HALVINGS):
        if outside.piece < 0:
            return a, False
        for found in (inside, outside):
            if (angle := pieces.root(found, a, b)) is not None:
                return angle, True
        if abs(b - a) < SAME_DIRECTION:
            break
        middle = 0.5 * (a + b)
        answer = pieces.at(plane_directions(np.asarray(middle)))
        if answer.normalised < -NEUTRAL:
            a, inside = middle, answer
        else:
            b, outside = middle, answer
    return a, False


def _arc(lines: Floats, direction: Floats) -> Floats:
    """Return angles around a direction between which rows of `lines` (k, 2) stay positive."""
    theta = float(np.arctan2(direction[1], direction[0]))
    size = np.linalg.norm(lines, axis=1)
    kept = lines[size > 1e-12 * size.max(initial=0.0)]
    off = theta - np.arctan2(kept[:, 1], kept[:, 0])
    off = np.clip(np.mod(off + np.pi, TURN) - np.pi, -0.5 * np.pi, 0.5 * np.pi)
    reach = [(0.5 * np.pi + off).min(initial=np.pi), (0.5 * np.pi - off).min(initial=np.pi)]
    return np.array([theta - reach[0], theta + reach[1]])
