"""Branches of solutions of a complementarity problem, over directions or over one slip."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from loops.arrays import Flags, Floats, Integers
from stability.complementarity import (
    PIVOT,
    TIE_BREAK,
    ZERO_ANGLE,
    exchange,
    principal_transform,
)

# Begin, end, sliding contacts, line of the watched contact's rate.
Segment = tuple[float, float, Flags, Floats]
BranchStatus = Literal["closed", "degenerate", "too long", "reached"]
TURN = 2.0 * np.pi
# Angles closer than this are one: contacts that change regime together are exchanged in turn.
SAME_ANGLE = 1e-11
# Exchanges after which the transform is made anew from `M`.
REFRESH = 64
# A variable whose largest value over the circle is below this share of the largest is zero.
ZERO_ROW = 1e-12


@dataclass(frozen=True, eq=False)
class SolutionBranch:
    """A branch of solutions, segment by segment.

    Attributes
    ----------
    angle : (n, 2) array, radians
        Where each segment begins and ends along the branch, unwrapped; it ends at a smaller angle
        than it begins where the branch runs backwards.
    sliding : (n, m) array of bool
        Contacts that slide on each segment.
    status : {'closed', 'degenerate', 'too long'}
        `closed`: the branch returned to its start, nothing of it is missing. `degenerate`: it was
        left where a contact neither goes on nor turns back to any digit. `too long`: more segments
        than asked for.
    """

    angle: Floats
    sliding: Flags
    status: BranchStatus

    @property
    def closed(self) -> bool:
        """Whether nothing of the branch is missing."""
        return self.status == "closed"

    @property
    def winding(self) -> int:
        """Times that a closed branch runs around the circle; 0 if it covers only a part twice."""
        return round(float(np.sum(self.angle[:, 1] - self.angle[:, 0])) / TURN)

    @property
    def longest(self) -> tuple[float, Flags]:
        """The middle of the longest segment, and its sliding contacts."""
        k = int(np.argmax(np.abs(self.angle[:, 1] - self.angle[:, 0])))
        return float(self.angle[k].mean()), self.sliding[k]

    @property
    def folds(self) -> Floats:
        """(k,) angles at which the branch turns back, in [0, 2 pi)."""
        way = self.angle[:, 1] - self.angle[:, 0]
        moves = np.flatnonzero(np.abs(way) > SAME_ANGLE)
        forwards = way[moves] > 0
        after = np.roll(forwards, -1) if self.closed else np.append(forwards[1:], forwards[-1:])
        return np.mod(self.angle[moves[forwards != after], 1], TURN)

    def at(self, angle: float) -> Integers:
        """Segments that hold a solution at an angle."""
        low, high = np.sort(self.angle, axis=1).T
        turns = np.ceil((low - SAME_ANGLE - angle) / TURN)
        return np.flatnonzero(angle + TURN * turns <= high + SAME_ANGLE)


def trace_branch(
    Q: Floats, M: Floats, angle: float, sliding: Flags, most: int = 20_000
) -> SolutionBranch:
    """Follow the solution with these contacts sliding around the circle, both ways if need be.

    `Q` (m, 2), `M` (m, m). The set `sliding` must solve the problem at `angle`.
    """
    if len(Q) == 0:
        none = np.zeros((1, 0), dtype=bool)
        return SolutionBranch(np.array([[0.0, TURN]]), none, "closed")
    found = _both_ways(Q, M, angle, sliding, most)
    if found.closed:
        return found
    # In a symmetric packing contacts change regime together; apart by next to nothing they don't.
    apart = np.random.default_rng(0).standard_normal(Q.shape) * np.abs(Q).max()
    parted = _both_ways(Q + TIE_BREAK * apart, M, angle, sliding, most)
    return parted if parted.closed else found


def _both_ways(Q: Floats, M: Floats, angle: float, sliding: Flags, most: int) -> SolutionBranch:
    """The branch from an angle on, and backwards too where it doesn't close."""
    segments, status = _follow(Q, M, angle, sliding, 1.0, most)
    if status != "closed":
        behind, _ = _follow(Q, M, angle, sliding, -1.0, most)
        backwards = [(end, begin, active, line) for begin, end, active, line in behind[::-1]]
        segments = backwards + segments
    return SolutionBranch(
        angle=np.array([[begin, end] for begin, end, *_ in segments]).reshape(-1, 2),
        sliding=np.array([active for _, _, active, _ in segments]).reshape(-1, len(Q)),
        status=status,
    )


def solutions_over_slip(q: Floats, M: Floats, k: int, start: Flags) -> list[Flags] | None:
    """Sliding contacts of all solutions where the others have one for every load.

    `start` (m,) are those that slide while contact `k` sticks. They are followed over the slip of
    `k` from zero to infinity: each change of sign of its rate `w_k` on the way is a solution. None
    where they can't be followed so far.
    """
    # Rates without slip and those of a unit slip have units of their own.
    lines, end = np.column_stack([q, M[:, k]]), 0.5 * np.pi
    lines /= np.where(lines.any(axis=0), np.abs(lines).max(axis=0), 1.0)
    segments, status = _follow(lines, M, 0.0, start, 1.0, 20_000, end, k)
    if status != "reached":
        return None
    loads = bool(segments[0][3][0] >= 0)
    found = [start] if loads else []
    for _, last, slides, rate in segments:
        if bool(rate @ [np.cos(min(last, end)), np.sin(min(last, end))] >= 0) != loads:
            loads = not loads
            found.append(slides | (np.arange(len(q)) == k))
    return found


def _follow(
    Q: Floats,
    M: Floats,
    angle: float,
    start: Flags,
    sense: float,
    most: int,
    until: float = np.inf,
    watched: int | None = None,
) -> tuple[list[Segment], BranchStatus]:
    """Segments from an angle on, up to the angle `until`.

    The contact that is `watched` sticks, whatever the sign of its rate.
    """
    # In the unit of slip in which `M` is of order one, slips compare with rates.
    M = M / (np.abs(M).max() or 1.0)
    whole = _tableau(Q, M, start)
    if whole is None:
        return [], "degenerate"
    sliding, at, changed = start.copy(), angle, -1
    first_sense = sense
    segments: list[Segment] = []
    for step in range(most):
        table, lines = whole[:, : len(M)], whole[:, len(M) :]
        # Angle from here to the zero of every variable that is not zero all around.
        size = np.hypot(lines[:, 0], lines[:, 1])
        ahead = np.mod(sense * (np.arctan2(lines[:, 1], lines[:, 0]) - at) + 0.5 * np.pi, TURN)
        ahead[ahead > TURN - ZERO_ANGLE] = 0.0
        if changed >= 0:
            ahead[changed] = np.pi
        ahead[size <= ZERO_ROW * size.max()] = np.pi
        if watched is not None:
            ahead[watched] = np.pi
        if ahead.max() > np.pi + ZERO_ANGLE:
            return segments, "degenerate"
        reach = float(ahead.min())
        if step > 0 and sense == first_sense and np.array_equal(sliding, start):
            back = float(np.mod(sense * (angle - at), TURN))
            if back <= reach + SAME_ANGLE:
                segments.append((at, at + sense * back, sliding.copy(), lines[0].copy()))
                return segments, "closed"
        end = at + sense * reach
        segments.append((at, end, sliding.copy(), lines[watched or 0].copy()))
        if end >= until:
            return segments, "reached"
        ties = np.flatnonzero(ahead <= reach + SAME_ANGLE)
        column = np.abs(table[:, ties]).max(axis=0)
        share = table[ties, ties] / np.where(column > 0, column, 1.0)
        changed = int(ties[np.argmax(np.abs(share))])
        if np.abs(share).max() < PIVOT:
            return segments, "degenerate"
        if table[changed, changed] < 0:
            sense = -sense
        sliding[changed] ^= True
        at = end
        if step % REFRESH == REFRESH - 1:
            whole = _tableau(Q, M, sliding)
            if whole is None:
                return segments, "degenerate"
        else:
            exchange(whole, changed, changed)
    return segments, "too long"


def _tableau(Q: Floats, M: Floats, sliding: Flags) -> Floats | None:
    """`M`, then `Q`, with `w` and `z` exchanged where contacts slide; None where singular."""
    transform = principal_transform(Q, M, sliding)
    return None if transform is None else np.asfortranarray(np.hstack(transform[::-1]))
