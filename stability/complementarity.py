"""The linear complementarity problem `w = q + M z`, `w >= 0`, `z >= 0`, `w.z = 0`.

`z` are slip rates of contacts at yield, `w` rates at which each leaves its friction limit. `M` is
neither symmetric nor, in general, a P-matrix, because slip is not normal to the friction limit.
There may be one solution, none or several.

Over all directions of a plane `q = Q h`, with `h = (cos a, sin a)`, and the solutions are traced
from one of them. With the set of sliding contacts fixed, `z` and `w` are linear in `h`: a segment
of the circle on which all stay positive. Where one of them vanishes, its contact changes regime.
With `d` the diagonal entry of the principal transform of `M` there, the branch of solutions goes on
in the same sense if `d > 0` and turns back if `d < 0`, a fold: two solutions on one side of that
direction, none of this branch on the other. Theory, equations (11.15) and (11.16).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, cholesky, lapack, lu_solve
from scipy.linalg.blas import dger
from scipy.optimize import linprog

from loops.arrays import Flags, Floats, Integers
from loops.shown import Shown

# Up to this many unknowns every combination is tried.
ENUMERATED = 12
# So many of them at a time.
SETS_AT_ONCE = 4096
# Rounding of an entry of `M` over the largest, where no more is known of it.
ENTRY = 1e-14
# Singular sets, and pairs of solutions, that are looked at for a family.
MOST_FAMILIES = 64
# Beyond, so many active sets to start from: three miss solutions that ten find.
STARTS = 10
NAMED_STARTS = 3
# Over the largest entry of q: wrong signs within it are rounding.
SIGN = 1e-9
# Solutions whose slips differ by less than this share are one.
SAME_SLIP = 1e-6
NEWTON_STEPS = 15
# Pivots below this share of their column, and blocks of this reciprocal condition, are singular.
PIVOT = 1e-11
# A variable this close to zero, in the angle to it, is zero.
ZERO_ANGLE = 1e-7
# Over the largest entry of Q: parts zeros that fall together by far more than SAME_ANGLE, or some
# stay tied and the exchange by pivots leads in circles.
TIE_BREAK = 1e-8
# Of a load that is raised: pivots below this share of their column soften.
SOFT_PIVOT = 1e-9
# Slopes below this share of the largest are zero then.
SLOPE = 1e-14
# Times that a contact changes its regime then, at most.
MOST_CHANGES = 12
# Determinant over the product of the rows' sizes below which a matrix is taken as singular.
SINGULAR_SET = 1e-13
# Share of a slip that errors of `M` may change before its set counts as singular.
LOST = 0.1
# Share of the unit matrix by which a scaled matrix is definite.
DEFINITE_MARGIN = 1e-9
# Steps of the search for a scaling.
BARRIER_STEPS = 60
# Slip over the largest entry of q that stands for any amount.
UNBOUNDED_SLIP = 1e3


class Errors(NamedTuple):
    """Bounds on the errors of `q` and of the columns of `M`, (m,) each; 0 where none is known.

    It comes with the problem: from the rates of all contacts, of which `q` may be next to nothing.
    """

    q: float = 0.0
    M: Floats | float = 0.0

    def of(self, q: Floats, M: Floats) -> Errors:
        """These, or a share of the largest entry; and the rounding of the entries of `M`."""
        low = self.q or SIGN * float(np.abs(q).max(initial=0.0))
        return Errors(low, np.broadcast_to(ENTRY * np.abs(M).max(initial=0.0) + self.M, q.shape))


EXACT = Errors()


@dataclass(frozen=True, eq=False, repr=False)
class Family(Shown):
    """Solutions in unbroken succession: any slips between the corners, or along a ray from one.

    Attributes
    ----------
    sliding : (m,) array of bool
        Contacts that stay at their friction limit all along; the others stick.
    corners : (k, m) array
        Slip rates `z` where it ends, one row each; of a line two, of a ray one. Of a plane or more,
        those that are farthest along `directions`.
    directions : (d, m) array
        Orthonormal rows: the solutions differ by multiples of these. One row for a line.
    """

    sliding: Flags
    corners: Floats
    directions: Floats


@dataclass(frozen=True, eq=False)
class Complementarity:
    """Active sets (k, m) of the distinct solutions, that of least slip first.

    `proof` says what stands behind their number: 'enumeration', 'positive definite' (there is
    one), 'infeasible' (there is none), or nothing: then the starts that were tried found so many.
    `families` are those to which some of them belong, `singular` the sets that have no single
    answer, both as far as all sets were tried.
    """

    active: Flags
    proof: str
    families: tuple[Family, ...] = ()
    singular: int = 0


def solve_complementarity(
    q: Floats,
    M: Floats,
    starts: int = STARTS,
    known: Sequence[Flags] = (),
    feasible: bool = False,
    enumerated: int | None = None,
    errors: Errors = EXACT,
) -> Complementarity:
    """All solutions by enumeration where that is short; else Newton and Lemke from several starts.

    A start is an active set: none, all, those of negative `q`, then random ones, unless no `z >= 0`
    has `q + M z >= 0`, which is not asked if `feasible`. Active sets that are `known`, as from a
    branch of solutions, take the place of the random ones; without a start they are all.
    Enumeration is short for up to `enumerated` unknowns, `ENUMERATED` of them if left out.
    Entries of `q` within their `errors` count as zero.
    """
    q = np.where(np.abs(q) <= errors.q, 0.0, q)
    if len(q) <= (ENUMERATED if enumerated is None else enumerated):
        every, singular = _every_solution(q, M, errors)
        kept = _distinct(every, len(q))
        lines = families(q, M, kept, singular, errors)
        return Complementarity(kept, "enumeration", lines, len(singular))
    if starts == 0:
        return known_solutions(q, M, known, "")
    certain = positive_definite(M)
    found = [active for active in known if violation(q, M, active) <= SIGN]
    if certain and found:
        return Complementarity(np.array(found[:1]), "positive definite")
    for number, start in enumerate(_starts(q, min(starts, NAMED_STARTS) if found else starts)):
        if number == NAMED_STARTS and not (found or feasible) and _infeasible(q, M):
            return known_solutions(q, M, found, "infeasible")
        active = solve_from(q, M, start)
        found += [] if active is None else [active]
        if certain and found:
            return Complementarity(np.array(found), "positive definite")
    if not found and (active := lemke(q, M)) is not None:
        found = [active]
    none = not (found or feasible) and starts <= NAMED_STARTS and _infeasible(q, M)
    return known_solutions(q, M, found, "infeasible" if none else "")


def known_solutions(q: Floats, M: Floats, known: Sequence[Flags], proof: str) -> Complementarity:
    """Known sets that solve the problem, each solution once."""
    once = {active.tobytes(): active for active in known}.values()
    found = [active for active in once if violation(q, M, active) <= SIGN]
    slips = [np.where(active, basic_values(q, M, active), 0.0) for active in found]
    kept = _distinct(list(zip(found, slips, strict=True)), len(q))
    return Complementarity(kept, proof, families(q, M, kept))


def families(
    q: Floats, M: Floats, found: Flags, singular: Flags | None = None, errors: Errors = EXACT
) -> tuple[Family, ...]:
    """Families among the solutions: of singular sets, and between two that a set has in common.

    Between two solutions all points are solutions if each contact sticks in both, or is at its
    friction limit in both; the set of those at the limit is singular then.
    """
    if len(found) < 2 and singular is None:
        return ()
    errors = errors.of(q, M)
    sets = [] if singular is None else list(singular[:MOST_FAMILIES])
    values = [basic_values(q, M, active) for active in found]
    slip, slack = (
        [np.where(active == slides, one, 0.0) for active, one in zip(found, values, strict=True)]
        for slides in (True, False)
    )
    for a, b in combinations(range(len(found)), 2):
        tol = errors.q + float(errors.M @ np.maximum(slip[a], slip[b]))
        sticks = np.maximum(slip[a], slip[b]) <= tol
        slides = np.maximum(slack[a], slack[b]) <= tol
        if (sticks | slides).all():
            sets.append(slides & ~sticks)
    once = {sliding.tobytes(): sliding for sliding in sets}.values()
    lines = [_family(q, M, sliding, errors) for sliding in list(once)[:MOST_FAMILIES]]
    kept = [line for line in lines if line is not None]

    def bounds(one: Family, other: Family) -> bool:
        """Whether one is a side of the other: its contacts at the limit are among the other's."""
        rates = np.vstack([one.corners @ M.T + q, one.directions @ M.T])[:, other.sliding]
        within = one.sliding.sum() < other.sliding.sum() and other.sliding[one.sliding].all()
        return bool(within and np.abs(rates).max() <= max(errors.q, SIGN * np.abs(M).max()))

    return tuple(one for one in kept if not any(bounds(one, other) for other in kept))


def _family(q: Floats, M: Floats, sliding: Flags, errors: Errors) -> Family | None:
    """Solutions with these contacts at their friction limit; None for a single one, or none."""
    scale, a = float(np.abs(q).max()) or 1.0, np.flatnonzero(sliding)
    left, sizes, right = np.linalg.svd(M[np.ix_(a, a)])
    # The part that moves is judged by its own size.
    null = max(SIGN * sizes.max(initial=0.0), np.linalg.norm(errors.M * sliding) * len(a) ** 0.5)
    rank = int(np.count_nonzero(sizes > null))
    directions = np.zeros((len(a) - rank, len(q)))
    directions[:, a] = right[rank:]
    if rank == len(a):
        return None
    slip = np.zeros(len(q))
    slip[a] = right[:rank].T @ (left[:, :rank].T @ -q[a] / sizes[:rank])
    tol = errors.q + errors.M @ np.abs(slip)
    if np.abs(q + M @ slip)[a].max() > tol:
        return None
    # From there, `slip + t directions` keeps the signs of `z` where sliding and of `w` elsewhere.
    start = np.where(sliding, slip, q + M @ slip) / scale
    slopes = np.where(sliding, directions, directions @ M.T).T
    corners, rays = [], 0
    for row in (*np.eye(len(directions)), *-np.eye(len(directions))):
        if len(directions) == 1:
            along = slopes @ row
            falls = along < -SIGN * np.abs(slopes).max()
            reach = np.min(start[falls] / -along[falls], initial=np.inf)
            end = row * reach if np.isfinite(reach) else None
            values = start + slopes[:, 0] * (end[0] if end is not None else 0.0)
            if end is not None and values.min() < -SIGN * max(1.0, np.abs(values).max()):
                return None
        else:
            limits = [(None, None)] * len(row)
            answer = linprog(-row, A_ub=-slopes, b_ub=start, bounds=limits, method="highs")
            if answer.status not in (0, 3):
                return None
            end = answer.x if answer.status == 0 else None
        rays += end is None
        corners += [] if end is None else [slip + scale * end @ directions]
    size = max((float(np.linalg.norm(corner)) for corner in corners), default=0.0)
    kept: list[Floats] = []
    for corner in corners:
        if all(np.linalg.norm(corner - one) > SAME_SLIP * size for one in kept):
            kept.append(np.maximum(corner, 0.0))
    if len(kept) + rays < 2:
        return None
    return Family(sliding, np.array(kept).reshape(len(kept), len(q)), directions)


def solve_from(q: Floats, M: Floats, active: Flags) -> Flags | None:
    """The active set of a solution, by Newton, then by Lemke's pivots from the best set met."""
    best, wrong = _newton(q, M, active)
    if wrong == 0:
        return best
    transformed = principal_transform(q, M, best)
    flips = None if transformed is None else lemke(*transformed)
    if flips is None or violation(q, M, best ^ flips) > SIGN:
        return None
    return best ^ flips


def nearest_regimes(q: Floats, M: Floats) -> Flags:
    """Active set for a problem without a solution: a few contacts are kept from sliding.

    First those that soften on their own (`M_cc <= 0`), then the worst third of those that disagree,
    again until the others have a solution; none slides if no others are left.
    """
    active, allowed = np.zeros(len(q), dtype=bool), np.diag(M) > 0
    while allowed.any():
        kept = np.flatnonzero(allowed)
        part, block = q[kept], M[np.ix_(kept, kept)]
        none = np.zeros(len(kept), dtype=bool)
        found = solve_from(part, block, none)
        if found is not None:
            active[kept[found]] = True
            break
        best, _ = _newton(part, block, none)
        values = basic_values(part, block, best)
        wrong = np.flatnonzero(values < 0)
        worst = wrong[np.argsort(values[wrong])[: max(1, len(wrong) // 3)]]
        allowed[kept[worst]] = False
    return active


def lemke(q: Floats, M: Floats) -> Flags | None:
    """Lemke's method with the covering vector of ones: the active set, None if it ends on a ray.

    The tableau holds the columns of the nonbasic variables alone, so a pivot is one update of rank
    one. Variables are numbered w, z, then the artificial one.
    """
    m = len(q)
    if (q >= 0).all():
        return np.zeros(m, dtype=bool)
    table = np.asfortranarray(np.column_stack([M, np.ones(m), q / np.abs(q).max()]))
    basic, nonbasic = np.arange(m), np.arange(m, 2 * m + 1)
    row, column = int(np.argmin(q)), m
    for _ in range(20 * m):
        exchange(table, row, column)
        left = int(basic[row])
        basic[row], nonbasic[column] = nonbasic[column], left
        if left == 2 * m:
            active = np.zeros(m, dtype=bool)
            active[basic[basic >= m] - m] = True
            return active
        column = int(np.flatnonzero(nonbasic == (left + m if left < m else left - m))[0])
        falling = table[:, column]
        rows = np.flatnonzero(falling < -PIVOT * np.abs(falling).max())
        if len(rows) == 0:
            return None
        ratio = table[rows, -1] / -falling[rows]
        ties = rows[ratio <= ratio.min() + 1e-13]
        last = ties[basic[ties] == 2 * m]
        row = int(last[0] if len(last) else ties[np.argmin(falling[ties])])
    return None


@dataclass(frozen=True, eq=False)
class RaisedLoad:
    """Slips `z` (m,) under a whole load, `w = distance + q + M z`, and contacts kept from sliding.

    `held` (m,) are contacts that softened and end beyond their strength; without any, `z` solves
    the problem. `first` is the share of the load at which the first one was held, 1 if none was.
    """

    slip: Floats
    held: Flags
    first: float


def raise_load(distance: Floats, q: Floats, M: Floats) -> RaisedLoad:
    """Raise the load from zero, where nothing slips, and follow the solution.

    `distance` (m,), not negative, is what each contact has left. Contacts change regime one by one
    where their `w` or `z` vanishes. A pivot that is not positive would turn the solution back to
    smaller loads, a snap: that contact sticks from there on, whatever its `w`.
    """
    m = len(q)
    size = max(float(np.abs(distance).max(initial=0.0)), float(np.abs(q).max(initial=0.0)))
    # Contacts that reach their strength together are parted.
    apart = TIE_BREAK * size * (1.0 + np.random.default_rng(0).random(m))
    # `y = table x + lines (1, share)`.
    whole = np.asfortranarray(np.column_stack([M, distance + apart, q]))
    table, lines = whole[:, :m], whole[:, m:]
    slides, held = np.zeros((2, m), dtype=bool)
    changes, first, share, changed = np.zeros(m, dtype=np.int64), 1.0, 0.0, -1
    while True:
        value, slope = lines[:, 0] + share * lines[:, 1], lines[:, 1]
        rounding = SLOPE * np.abs(slope).max(initial=0.0)
        falls = (slope < -rounding) & ~held
        if changed >= 0 and slope[changed] > -ZERO_ANGLE * np.abs(slope).max():
            falls[changed] = False
        ahead = np.flatnonzero(falls)
        step = np.maximum(value[ahead], 0.0) / -slope[ahead]
        if share + step.min(initial=np.inf) >= 1.0:
            break
        k = int(ahead[np.argmin(step)])
        share, changes[k] = share + float(step.min()), changes[k] + 1
        pivot = table[k, k] / np.abs(table[:, k]).max()
        changed = -1
        if pivot < SOFT_PIVOT or changes[k] > MOST_CHANGES:
            held[k], first = True, min(first, share)
        if abs(pivot) >= SOFT_PIVOT and (slides[k] or not held[k]):
            slides[k] ^= True
            exchange(whole, k, k)
            changed = k
    end = basic_values(distance + q, M, slides)
    # Some are within their strength again.
    held &= end < -SIGN * size
    return RaisedLoad(np.where(slides, np.maximum(end, 0.0), 0.0), held, first)


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
    if not active.any():
        return q.copy()
    values = np.full(len(q), np.nan)
    if (factors := regular_factors(M[np.ix_(active, active)])) is None:
        return values
    values[active] = lu_solve(factors, -q[active], check_finite=False)
    values[~active] = q[~active] + M[np.ix_(~active, active)] @ values[active]
    return values


def regular_factors(matrix: Floats) -> tuple[Floats, Integers] | None:
    """LU factors of a matrix; None where its reciprocal condition (1-norm) is rounding."""
    factors, pivots, info = lapack.dgetrf(matrix)
    size = np.abs(matrix).sum(axis=0).max()
    if info > 0 or lapack.dgecon(factors, size)[0] < PIVOT:
        return None
    return factors, pivots


def violation(q: Floats, M: Floats, active: Flags) -> float:
    """Largest wrong sign over the largest entry of `q`; infinite where the block is singular."""
    scale = float(np.abs(q).max(initial=0.0))
    worst = float(-np.minimum(basic_values(q, M, active), 0.0).min(initial=0.0))
    return np.inf if np.isnan(worst) else worst / scale if scale > 0 else 0.0


def _every_solution(
    q: Floats, M: Floats, errors: Errors = EXACT
) -> tuple[list[tuple[Flags, Floats]], Flags]:
    """Active sets and slips of all solutions, and the singular sets that may have a continuum.

    A set with a singular matrix has none or a continuum: its smallest one, and one more where there
    would be no other. So is one whose slips the errors of the columns of `M` may change at will.
    """
    m, errors = len(q), errors.of(q, M)
    scale = float(np.abs(q).max(initial=0.0)) or 1.0
    found: list[tuple[Flags, Floats]] = []
    parts = []
    for first in range(0, 2**m, SETS_AT_ONCE):
        numbers = np.arange(first, min(first + SETS_AT_ONCE, 2**m))
        actives = (numbers[:, None] >> np.arange(m) & 1).astype(bool)
        matrices = np.where(actives[:, None, :], M, -np.eye(m))
        sizes = np.linalg.norm(matrices, axis=2).prod(axis=1)
        regular = np.abs(np.linalg.det(matrices)) > SINGULAR_SET * sizes
        inverse = np.linalg.inv(matrices[regular])
        values, reach = -inverse @ q, np.abs(inverse).sum(axis=2)
        slips = np.where(actives[regular], values, 0.0)
        sure = reach.max(axis=1, initial=0.0) * (actives[regular] @ errors.M) < LOST
        low = errors.q + np.abs(slips) @ errors.M
        agrees = sure & (values >= -reach * low[:, None]).all(axis=1)
        found += zip(actives[regular][agrees], slips[agrees], strict=True)
        regular[regular] = sure
        parts.append(actives[~regular])
    singular = np.concatenate(parts)
    rest = np.where(singular[:, None, :], M, -np.eye(m))
    inverse = np.linalg.pinv(rest, rcond=PIVOT)
    smallest = -inverse @ q
    low = errors.q + (singular * np.abs(smallest)) @ errors.M
    carried = np.abs(rest @ smallest[..., None] + q[:, None]).max(axis=(1, 2), initial=0.0)
    fixed = np.einsum("kij,kji->ki", inverse, rest) > 1.0 - SIGN
    wrong = smallest < -np.abs(inverse).sum(axis=2) * low[:, None]
    possible = np.flatnonzero((carried <= low) & ~(wrong & fixed).any(axis=1))
    for k in possible[~wrong[possible].any(axis=1)]:
        found.append((singular[k], np.where(singular[k], smallest[k], 0.0)))
    for k in possible:
        if len(_distinct(found, m)) > 1:
            break
        # The bound keeps the answer finite where any amount of slip agrees.
        answer = linprog(-np.ones(m), A_eq=rest[k], b_eq=-q / scale, bounds=(0.0, UNBOUNDED_SLIP))
        if answer.status == 0:
            found.append((singular[k], np.where(singular[k], scale * answer.x, 0.0)))
    return found, singular[possible]


def _newton(q: Floats, M: Floats, active: Flags) -> tuple[Flags, int]:
    """Flip every wrong sign until none is left; the best set met, how many signs are wrong."""
    best, least = active, len(q)
    met = set[bytes]()
    for _ in range(NEWTON_STEPS):
        # From a set that was met before the same ones follow again.
        if active.tobytes() in met:
            break
        met.add(active.tobytes())
        values = basic_values(q, M, active)
        wrong = ~(values >= -SIGN * np.abs(q).max())
        if (count := int(np.count_nonzero(wrong))) < least:
            best, least = active, count
        if count == 0 or np.isnan(values).any():
            break
        active = active ^ wrong
    return best, least


def _starts(q: Floats, count: int) -> list[Flags]:
    rng = np.random.default_rng(0)
    named = [np.zeros(len(q), dtype=bool), np.ones(len(q), dtype=bool), q < 0]
    return (named + [rng.random(len(q)) < 0.5 for _ in range(count)])[:count]


def exchange(table: Floats, row: int, column: int) -> None:
    """Exchange the basic variable of a row with the nonbasic one of a column, in place.

    `table` is in Fortran's order, so that BLAS adds the matrix of rank one where it stands.
    """
    pivot = table[row, column]
    factor = table[:, column].copy()
    factor[row] = 0.0
    line = table[row] / -pivot
    line[column] = 1.0 / pivot
    table[:, column] = 0.0
    dger(1.0, factor, line, a=table, overwrite_a=1)
    table[row] = line


def positive_definite(M: Floats) -> bool:
    """Whether the symmetric part is positive definite: then there is one solution for every `q`."""
    try:
        cholesky(M + M.T, lower=True, check_finite=False)
    except LinAlgError:
        return False
    return True


def scaled_definite(M: Floats, start: Floats | None = None) -> tuple[bool, Floats, Floats]:
    """Whether `D M + M^T D > 0` for a diagonal `D > 0`: there is one solution for every `q`.

    Also (m,) `D`, or where the search for it ended, and (m,) which contacts stand in its way.
    Newton's method for the least `s` with `D M + M^T D + s 1 > 0`, `0 < D < 1`, behind a barrier.
    """
    m, one = len(M), np.eye(len(M))
    d = np.full(m, 0.5) if start is None else start
    if m == 0:
        return True, d, d
    sums = d[:, None] * M
    s = 1e-3 - 1.1 * float(np.linalg.eigvalsh(sums + sums.T)[0])
    weight, blame = 2.0 * m / abs(s), np.zeros(m)
    for _ in range(BARRIER_STEPS):
        if positive_definite(d[:, None] * (M - DEFINITE_MARGIN * one)):
            return True, d, np.zeros(m)
        scaled = d[:, None] * M
        inverse = np.linalg.inv(scaled + scaled.T + s * one)
        rows = M @ inverse
        blame = np.diag(inverse)
        slope = np.append(-2.0 * np.diag(rows) - 1.0 / d + 1.0 / (1.0 - d), weight - blame.sum())
        curve = np.empty((m + 1, m + 1))
        curve[:m, :m] = 2.0 * (rows * rows.T + (rows @ M.T) * inverse)
        curve[:m, :m] += np.diag(1.0 / d**2 + 1.0 / (1.0 - d) ** 2)
        curve[:m, m] = curve[m, :m] = 2.0 * np.einsum("ij,ji->i", rows, inverse)
        curve[m, m] = np.sum(inverse**2)
        step = -np.linalg.solve(curve, slope)
        decrease = float(-slope @ step)
        # Within this length the step stays inside, and the barrier falls.
        length = 1.0 / (1.0 + np.sqrt(max(decrease, 0.0)))
        d, s = d + length * step[:m], s + length * float(step[m])
        if decrease < 1.0:
            weight *= 8.0
    return False, d, blame


def _infeasible(q: Floats, M: Floats) -> bool:
    """Whether no `z >= 0` has `q + M z >= 0`: then there is no solution at all."""
    answer = linprog(np.zeros(len(q)), A_ub=-M, b_ub=q / np.abs(q).max(), method="highs")
    return bool(answer.status == 2)


def feasible_for_all(M: Floats) -> bool:
    """Whether some `z >= 0` has `M z > 0`: then a multiple has `q + M z >= 0`, for every `q`."""
    m = len(M)
    rows = np.column_stack([-M, np.ones(m)])
    limits = [(0.0, 1.0)] * m + [(None, 1.0)]
    answer = linprog(-np.eye(m + 1)[m], A_ub=rows, b_ub=np.zeros(m), bounds=limits, method="highs")
    if answer.status != 0:
        return False
    slip = np.maximum(answer.x[:m], 0.0)
    return bool((M @ slip).min() > SIGN * np.abs(M).max())


def _distinct(found: list[tuple[Flags, Floats]], count: int) -> Flags:
    """Active sets whose slips differ, by increasing slip; of equal ones the first stands."""
    kept, norm = list[tuple[Flags, Floats]](), np.linalg.norm
    for active, slip in found:
        if all(norm(slip - other) > SAME_SLIP * norm([slip, other]) for _, other in kept):
            kept.append((active, slip))
    kept.sort(key=lambda one: float(norm(one[1])))
    return np.array([active for active, _ in kept], dtype=bool).reshape(len(kept), count)
