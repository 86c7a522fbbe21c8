"""The linear complementarity problem `w = q + M z`, `w >= 0`, `z >= 0`, `w.z = 0`.

`z` are slip rates of contacts at yield, `w` how far each stays inside its cone. `M` is neither
symmetric nor, in general, a P-matrix: friction doesn't follow its own normal. There may be one
solution, none or several.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cholesky
from scipy.optimize import linprog

from loops.arrays import Flags, Floats

# Up to this many unknowns every combination is tried.
ENUMERATED = 10
# Over the largest entry of q: wrong signs within it are rounding; solutions within SAME are one.
SIGN = 1e-9
SAME = 1e-6
NEWTON_STEPS = 15
# Pivot elements below this share of their column would lose the digits.
PIVOT = 1e-11


@dataclass(frozen=True, eq=False)
class Complementarity:
    """Active sets (k, m) of the distinct solutions, that of least slip first.

    `proof` says what stands behind their number: 'enumeration', 'positive definite' (there is
    one), 'infeasible' (there is none), or nothing: then the starts that were tried found so many.
    """

    active: Flags
    proof: str
    pivots: int


def solve_complementarity(q: Floats, M: Floats, starts: int = 3) -> Complementarity:
    """All solutions by enumeration where that is short; else Newton and Lemke from several starts.

    A start is an active set: none, all, those of negative `q`, then random ones.
    """
    if len(q) <= ENUMERATED:
        number = np.arange(2 ** len(q))[:, None] >> np.arange(len(q)) & 1
        found = [active for active in number.astype(bool) if violation(q, M, active) <= SIGN]
        return Complementarity(_distinct(q, M, found), "enumeration", len(number))
    certain = _positive_definite(M)
    found, pivots = [], 0
    for active in _starts(q, starts):
        answer, steps = solve_from(q, M, active)
        pivots += steps
        found += [] if answer is None else [answer]
        if certain and found:
            return Complementarity(np.array(found), "positive definite", pivots)
    if not found:
        answer, steps = lemke(q, M)
        pivots += steps
        found = [] if answer is None else [answer]
    proof = "infeasible" if not found and _infeasible(q, M) else ""
    return Complementarity(_distinct(q, M, found), proof, pivots)


def solve_from(q: Floats, M: Floats, active: Flags) -> tuple[Flags | None, int]:
    """The active set of a solution, by Newton, then by Lemke's pivots from the best set met."""
    best, wrong, steps = _newton(q, M, active)
    if wrong == 0:
        return best, steps
    transformed = principal_transform(q, M, best)
    if transformed is None:
        return None, steps
    flips, pivots = lemke(*transformed)
    if flips is None or violation(q, M, best ^ flips) > SIGN:
        return None, steps + pivots
    return best ^ flips, steps + pivots


def nearest_regimes(q: Floats, M: Floats, rounds: int = 30) -> Flags:
    """Active set for a problem without a solution: a few contacts are kept from sliding.

    First those that soften on their own (`M_cc <= 0`), then, as long as the others have no
    solution, the worst third of those that disagree.
    """
    allowed = np.diag(M) > 0
    active = np.zeros(len(q), dtype=bool)
    for _ in range(rounds):
        kept = np.flatnonzero(allowed)
        part, block = q[kept], M[np.ix_(kept, kept)]
        found, _ = solve_from(part, block, np.zeros(len(kept), dtype=bool))
        if found is not None:
            active[kept[found]] = True
            break
        best, _, _ = _newton(part, block, np.zeros(len(kept), dtype=bool))
        values = np.nan_to_num(basic_values(part, block, best), nan=-np.inf)
        wrong = np.flatnonzero(values < 0)
        worst = wrong[np.argsort(values[wrong])[: max(1, len(wrong) // 3)]]
        allowed[kept[worst]] = False
    return active


def lemke(q: Floats, M: Floats) -> tuple[Flags | None, int]:
    """Lemke's method with the covering vector of ones: the active set, None if it ends on a ray.

    The tableau holds the columns of the nonbasic variables alone, so a pivot is one update of rank
    one. Variables are numbered w, z, then the artificial one.
    """
    m = len(q)
    if (q >= 0).all():
        return np.zeros(m, dtype=bool), 0
    table = np.column_stack([M, np.ones(m), q / np.abs(q).max()])
    basic, nonbasic = np.arange(m), np.arange(m, 2 * m + 1)
    row, column = int(np.argmin(q)), m
    for step in range(10 * m + 50):
        _exchange(table, row, column)
        left = int(basic[row])
        basic[row], nonbasic[column] = nonbasic[column], left
        if left == 2 * m:
            active = np.zeros(m, dtype=bool)
            active[basic[basic >= m] - m] = True
            return active, step
        column = int(np.flatnonzero(nonbasic == (left + m if left < m else left - m))[0])
        falling = table[:, column]
        rows = np.flatnonzero(falling < -PIVOT * np.abs(falling).max())
        if len(rows) == 0:
            return None, step
        ratio = table[rows, -1] / -falling[rows]
        ties = rows[ratio <= ratio.min() + 1e-13]
        last = ties[basic[ties] == 2 * m]
        row = int(last[0] if len(last) else ties[np.argmin(falling[ties])])
    return None, 10 * m + 50


def principal_transform(q: Floats, M: Floats, active: Flags) -> tuple[Floats, Floats] | None:
    """The same problem with `w` and `z` exchanged where `active`; None where that is singular."""
    a, n = np.flatnonzero(active), np.flatnonzero(~active)
    aa, an, na = np.ix_(a, a), np.ix_(a, n), np.ix_(n, a)
    try:
        inverse = np.linalg.inv(M[aa])
    except np.linalg.LinAlgError:
        return None
    table, right = np.empty_like(M), np.empty_like(q)
    table[aa], table[an] = inverse, -inverse @ M[an]
    table[na] = M[na] @ inverse
    table[np.ix_(n, n)] = M[np.ix_(n, n)] + M[na] @ table[an]
    right[a] = -inverse @ q[a]
    right[n] = q[n] + M[na] @ right[a]
    return right, table


def basic_values(q: Floats, M: Floats, active: Flags) -> Floats:
    """`z` where active, `w` elsewhere; not numbers where the active block is singular."""
    values = np.full(len(q), np.nan)
    try:
        values[active] = np.linalg.solve(M[np.ix_(active, active)], -q[active])
    except np.linalg.LinAlgError:
        return values
    values[~active] = q[~active] + M[np.ix_(~active, active)] @ values[active]
    return values


def violation(q: Floats, M: Floats, active: Flags) -> float:
    """Largest wrong sign over the largest entry of `q`; infinite where the block is singular."""
    scale = float(np.abs(q).max(initial=0.0))
    worst = float(-np.minimum(basic_values(q, M, active), 0.0).min(initial=0.0))
    return np.inf if np.isnan(worst) else worst / scale if scale > 0 else 0.0


def _newton(q: Floats, M: Floats, active: Flags) -> tuple[Flags, int, int]:
    """Flip every wrong sign until none is left or nothing improves; the best set, what is wrong."""
    best, least, poor, steps = active, len(q) + 1, 0, 0
    for _ in range(NEWTON_STEPS):
        values = basic_values(q, M, active)
        wrong = ~(values >= -SIGN * np.abs(q).max())
        if (count := int(np.count_nonzero(wrong))) < least:
            best, least, poor = active, count, 0
        poor, steps = poor + 1, steps + 1
        if count == 0 or poor > 5 or np.isnan(values).any():
            break
        active = active ^ wrong
    return best, least, steps


def _starts(q: Floats, count: int) -> list[Flags]:
    rng = np.random.default_rng(0)
    named = [np.zeros(len(q), dtype=bool), np.ones(len(q), dtype=bool), q < 0]
    return (named + [rng.random(len(q)) < 0.5 for _ in range(count - 3)])[:count]


def _exchange(table: Floats, row: int, column: int) -> None:
    """Exchange the basic variable of a row with the nonbasic one of a column, in place."""
    pivot = table[row, column]
    factor = table[:, column].copy()
    factor[row] = 0.0
    line = table[row] / -pivot
    line[column] = 1.0 / pivot
    table[:, column] = 0.0
    table += factor[:, None] * line
    table[row] = line


def _positive_definite(M: Floats) -> bool:
    try:
        cholesky(M + M.T, lower=True, check_finite=False)
    except LinAlgError:
        return False
    return True


def _infeasible(q: Floats, M: Floats) -> bool:
    """Whether no `z >= 0` has `q + M z >= 0`: then there is no solution at all."""
    answer = linprog(np.zeros(len(q)), A_ub=-M, b_ub=q / np.abs(q).max(), method="highs")
    return bool(answer.status == 2)


def _distinct(q: Floats, M: Floats, found: list[Flags]) -> Flags:
    """Sets whose slips differ, by increasing slip."""
    slips = [np.where(active, basic_values(q, M, active), 0.0) for active in found]
    kept: list[int] = []
    for k in sorted(range(len(found)), key=lambda k: float(np.linalg.norm(slips[k]))):
        size = SAME * np.linalg.norm(slips[k])
        if all(np.linalg.norm(slips[k] - slips[other]) > size for other in kept):
            kept.append(k)
    return np.array([found[k] for k in kept], dtype=bool).reshape(len(kept), len(q))
