"""The system of a packing with frozen geometry, from the records of its pairs to its motions.

The stiffness has blocks 3 x 3, one for each pair of bodies that touch; a body's freedoms are `u`
and the spin times a length, levers of pairs `loops.contacts.PAIR` are over it. Regimes are those
of `loops.Regime`: 0 open, 1 stuck, 2 sliding. In factors `L U` bodies are numbered in the order of
elimination. The pattern is symmetric, the matrix is not: below the diagonal column k of `L` has
blocks `lower` in the `rows` from `begin[k]` on, and row k of `U` blocks `upper` in the same
columns. Pivots are whole blocks, without exchanges between bodies. All kernels that a kernel calls
stand in this file.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from loops.arrays import Floats, Integers, Regimes
from loops.compiled import inlined, kernel

# Right-hand sides that are solved at once.
LOADS_AT_ONCE = 4
# An order of elimination is kept until the factors have grown by this.
FILL = 1.25
# Products and sums in one instruction, rounded once.
fused = partial(kernel, fastmath={"contract"})


class Order(NamedTuple):
    """An order of elimination: the place of each body, and the number of blocks in `L`."""

    place: Integers
    entries: int


class Factors(NamedTuple):
    """Factors of the stiffness; freedom f of a motion is row `into[f]`.

    They are `regular` if no pivot is singular. `strained` (2, 4, 3B) are the loads of bodies at
    rest under unit strain rates 11, 12, 21, 22, and those of the transposed stiffness; `affine`
    (4, 4) is `V P'` then.
    """

    order: Order
    into: Integers
    begin: Integers
    rows: Integers
    lower: Floats
    upper: Floats
    pivot: Floats
    swap: Integers
    regular: bool
    strained: Floats
    affine: Floats

    def stress(self, motions: Floats) -> Floats:
        """Return `V P'` (4, k) under motions (k, 3B) at a strain rate of zero."""
        return np.asarray(-self.strained[1] @ motions.T)

    def motions(self, loads: Floats, freedoms: Integers | slice = slice(None)) -> Floats:
        """Return motions (k, 3B) under loads (n, k) on these freedoms."""
        count = loads.shape[1]
        x = np.zeros((len(self.into), count + -count % LOADS_AT_ONCE))
        x[self.into[freedoms], :count] = loads
        return self._solved(x, count, 0)

    def motions_of_rows(self, pairs: NDArray[Any], rows: Integers) -> Floats:
        """Return motions (k, 3B) under unit forces of pairs, or shear forces beyond the pairs."""
        shear, some, count = rows[:, None] >= len(pairs), pairs[rows % len(pairs)], len(rows)
        force = np.where(shear, some["t"], some["n"])
        moments = np.where(shear, some["arm"], 0.0)
        x, start = np.zeros((len(self.into), count + -count % LOADS_AT_ONCE)), len(self.into)
        for side, sense in enumerate((-1.0, 1.0)):
            at = self.into[3 * some["grains"][:, side, None] + np.arange(3)]
            x[at, np.arange(count)[:, None]] += np.column_stack([sense * force, -moments[:, side]])
            start = min(start, int(at.min()))
        return self._solved(x, count, start)

    def _solved(self, x: Floats, count: int, start: int) -> Floats:
        """Return motions (count, 3B) under loads in the order of elimination."""
        out = np.empty((count, len(x)))
        system = self.begin, self.rows, self.lower, self.upper, self.pivot, self.swap
        solve(*system, self.into, x, start, out)
        return out


def factorise(
    ends: Integers, elements: Floats, d: Floats, springs: Floats, order: Order | None
) -> Factors:
    """Return factors of the stiffness on `springs` (B, 3), in this order or one that fills less.

    `elements` (P, 6, 6) are those of pairs of bodies `ends` (P, 2), `d` (P, 2) their branches. A
    freedom on a spring of infinite stiffness is held.
    """
    count = len(springs)
    if order is not None:
        begin, rows = structure(ends, order.place)
    if order is None or len(rows) > FILL * order.entries:
        place = elimination_order(ends, count)
        begin, rows = structure(ends, place)
        order = Order(place, len(rows))
    parts = np.zeros((2 * len(rows) + count, 3, 3))
    lower, upper, pivot = np.split(parts, [len(rows), 2 * len(rows)])
    system = begin, rows, lower, upper, pivot
    assemble(ends, elements, springs, order.place, *system)
    swap = np.empty((count, 3), dtype=np.int64)
    regular = eliminate(*system, swap)
    into = (3 * order.place[:, None] + np.arange(3)).ravel()
    strained, affine = np.zeros((2, 4, 3 * count)), np.zeros((4, 4))
    strain_loads(ends, elements, d, strained, affine)
    return Factors(order, into, *system, swap, regular, strained, affine)


def elimination_order(ends: Integers, bodies: int) -> Integers:
    """Return the number of each body in an order of minimum degree; `ends` (P, 2) touch."""
    i, j = ends[ends[:, 0] != ends[:, 1]].T
    at = np.concatenate([i, j]), np.concatenate([j, i])
    degree = np.bincount(at[0], minlength=bodies)
    # SuperLU's order, of a matrix that it factorises in any order.
    graph = sparse.csc_array((np.full(len(at[0]), -1.0), at), (bodies, bodies))
    graph = (graph + sparse.diags_array(degree + 1.0)).tocsc()
    lu = splu(graph, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return np.asarray(lu.perm_c, dtype=np.int64)


@inlined
def _unite(added: Integers, k: int, met: Integers, rows: Integers, end: int) -> int:
    """Add to the rows of column `k` those that it has not met; return their end."""
    for row in added:
        if met[row] != k:
            met[row] = k
            rows[end] = row
            end += 1
    return end


@kernel
def structure(ends: Integers, place: Integers) -> tuple[Integers, Integers]:
    """Begin of each column (B + 1,) and sorted rows of the blocks below the diagonal of `L`.

    `ends` (P, 2) are bodies that touch, `place` (B,) their numbers in the order of elimination.
    """
    bodies = len(place)
    start = np.zeros(bodies + 1, dtype=np.int64)
    for p in range(len(ends)):
        start[min(place[ends[p, 0]], place[ends[p, 1]]) + 1] += 1
    for k in range(bodies):
        start[k + 1] += start[k]
    later, at = np.empty(len(ends), dtype=np.int64), start.copy()
    for p in range(len(ends)):
        i, j = place[ends[p, 0]], place[ends[p, 1]]
        low = min(i, j)
        later[at[low]] = max(i, j)
        at[low] += 1
    begin, rows = np.zeros(bodies + 1, dtype=np.int64), np.empty(8 * bodies, dtype=np.int64)
    met = np.full(bodies, -1)
    # Columns whose first row is k: the first of them, then the next of each.
    child, sibling = np.full(bodies, -1), np.full(bodies, -1)
    for k in range(bodies):
        first = end = begin[k]
        met[k] = k
        if end + bodies > len(rows):
            longer = np.empty(2 * len(rows) + bodies, dtype=np.int64)
            for q in range(end):
                longer[q] = rows[q]
            rows = longer
        end = _unite(later[start[k] : start[k + 1]], k, met, rows, end)
        c = child[k]
        while c >= 0:
            end = _unite(rows[begin[c] : begin[c + 1]], k, met, rows, end)
            c = sibling[c]
        for q in range(first + 1, end):
            row, to = rows[q], q
            while to > first and rows[to - 1] > row:
                rows[to] = rows[to - 1]
                to -= 1
            rows[to] = row
        begin[k + 1] = end
        if end > first:
            sibling[k] = child[rows[first]]
            child[rows[first]] = k
    return begin, rows[: begin[bodies]]


@kernel
def _pair_resultants(
    pair: Any, regime: int, side: float, a: int, s: float
) -> tuple[float, float, float, float]:
    """Force rate on the second grain of a closed pair, and what is taken from both moments.

    Freedom `a` moves by `s`: of the first grain the other way, from 3 on of the second.
    """
    b = a % 3
    un = s * pair["n"][b] if b < 2 else 0.0
    across = s * pair["t"][b] if b < 2 else 0.0
    ut = pair["turning"] * across if b < 2 else -pair["lever"][a // 3]
    dn = -pair["kn"] * un
    # Without a branch: regimes of pairs come in no order that could be predicted.
    stuck, slides = -pair["kt"] * ut - pair["coupling"] * un, side * pair["mu"] * dn
    dt = stuck if regime == 1 else slides
    dn *= pair["push"]
    # Forces, and those that turn with the pair.
    f0 = dn * pair["n"][0] + dt * pair["t"][0] + pair["rotation"][0] * across
    f1 = dn * pair["n"][1] + dt * pair["t"][1] + pair["rotation"][1] * across
    grown = pair["growth"] * un
    return f0, f1, pair["arm"][0] * dt + grown, pair["arm"][1] * dt + grown


@kernel
def strain_loads(
    ends: Integers, elements: Floats, d: Floats, strained: Floats, affine: Floats
) -> None:
    """Add the loads and the stress of bodies at rest, see `Factors`."""
    for p in range(len(ends)):
        for k in range(4):
            # The other body goes against the first by -d[k % 2] along k // 2.
            b, rate = 3 + k // 2, d[p, k % 2]
            for a in range(6):
                f = 3 * ends[p, a // 3] + a % 3
                strained[0, k, f] += rate * elements[p, a, b]
                strained[1, k, f] += rate * elements[p, b, a]
            for m in range(4):
                affine[k, m] += rate * elements[p, b, 3 + m // 2] * d[p, m % 2]


@kernel
def stiffnesses(pairs: NDArray[Any], regime: Regimes, side: Floats) -> tuple[Integers, Floats]:
    """Bodies (P', 2) of closed pairs, and their stiffness (P', 6, 6) in the freedoms of both."""
    ends, K, k = np.empty((len(pairs), 2), dtype=np.int64), np.empty((len(pairs), 6, 6)), 0
    for p in range(len(pairs)):
        if regime[p] == 0:
            continue
        ends[k, 0], ends[k, 1] = pairs[p]["grains"][0], pairs[p]["grains"][1]
        for a in range(6):
            # Unit motions one after the other.
            s = -1.0 if a < 3 else 1.0
            f0, f1, m0, m1 = _pair_resultants(pairs[p], regime[p], side[p], a, s)
            K[k, 0, a], K[k, 1, a], K[k, 2, a] = f0, f1, m0
            K[k, 3, a], K[k, 4, a], K[k, 5, a] = -f0, -f1, m1
        k += 1
    return ends[:k], K[:k]


@kernel
def assemble(
    ends: Integers,
    elements: Floats,
    springs: Floats,
    place: Integers,
    begin: Integers,
    rows: Integers,
    lower: Floats,
    upper: Floats,
    pivot: Floats,
) -> None:
    """Add the stiffness of pairs on `springs` (B, 3) to the blocks, zero so far."""
    for g in range(len(place)):
        for a in range(3):
            pivot[place[g], a, a] += springs[g, a]
    for p in range(len(ends)):
        K, i, j = elements[p], place[ends[p, 0]], place[ends[p, 1]]
        low, high = begin[min(i, j)], begin[min(i, j) + 1]
        while low < high:
            middle = (low + high) // 2
            if rows[middle] < max(i, j):
                low = middle + 1
            else:
                high = middle
        for a in range(3):
            for b in range(3):
                pivot[i, a, b] += K[a, b]
                pivot[j, a, b] += K[3 + a, 3 + b]
                if i == j:
                    pivot[i, a, b] += K[3 + a, b] + K[a, 3 + b]
                else:
                    lower[low, a, b] += K[3 + a, b] if i < j else K[a, 3 + b]
                    upper[low, a, b] += K[a, 3 + b] if i < j else K[3 + a, b]


@kernel
def _eliminate_block(D: Floats, swap: Integers) -> bool:
    """`L U` in place of a block with its rows in the order `swap`; False if it is singular.

    On the diagonal stand the reciprocals of U's. An inverse would square the block's condition.
    """
    for c in range(3):
        swap[c] = c
    for c in range(3):
        best = c
        for i in range(c + 1, 3):
            if abs(D[i, c]) > abs(D[best, c]):
                best = i
        if not abs(D[best, c]) > 0.0:
            return False
        swap[c], swap[best] = swap[best], swap[c]
        for k in range(3):
            D[c, k], D[best, k] = D[best, k], D[c, k]
        D[c, c] = 1.0 / D[c, c]
        for i in range(c + 1, 3):
            D[i, c] *= D[c, c]
            for k in range(c + 1, 3):
                D[i, k] -= D[i, c] * D[c, k]
    return True


@inlined
def _entries(x: Floats, q: int) -> tuple[float, ...]:
    """The nine entries of a block, read at once."""
    return (
        x[q, 0, 0], x[q, 0, 1], x[q, 0, 2],
        x[q, 1, 0], x[q, 1, 1], x[q, 1, 2],
        x[q, 2, 0], x[q, 2, 1], x[q, 2, 2],
    )  # fmt: skip


@fused
def eliminate(
    begin: Integers, rows: Integers, lower: Floats, upper: Floats, pivot: Floats, swap: Integers
) -> bool:
    """The factors in place of the blocks, with rows of pivots in the order `swap` (B, 3).

    False if one of them is singular.

    Column by column: a list leads from each to the columns before with a block in its row.
    """
    bodies = len(pivot)
    first, following, at = np.full(bodies, -1), np.full(bodies, -1), begin.copy()
    below, right = np.empty((2, bodies, 3, 3))
    for k in range(bodies):
        for q in range(begin[k], begin[k + 1]):
            for a in range(3):
                for b in range(3):
                    below[rows[q], a, b] = lower[q, a, b]
                    right[rows[q], a, b] = upper[q, a, b]
        D, c = pivot[k], first[k]
        while c >= 0:
            after, p = following[c], at[c]
            low, u = _entries(lower, p), _entries(upper, p)
            for a in range(3):
                d, e, f = low[3 * a], low[3 * a + 1], low[3 * a + 2]
                for b in range(3):
                    D[a, b] -= d * u[b] + e * u[3 + b] + f * u[6 + b]
            for q in range(p + 1, begin[c + 1]):
                i, v, w = rows[q], _entries(lower, q), _entries(upper, q)
                for a in range(3):
                    d, e, f = 3 * a, 3 * a + 1, 3 * a + 2
                    for b in range(3):
                        below[i, a, b] -= v[d] * u[b] + v[e] * u[3 + b] + v[f] * u[6 + b]
                        right[i, a, b] -= low[d] * w[b] + low[e] * w[3 + b] + low[f] * w[6 + b]
            at[c] = p + 1
            if p + 1 < begin[c + 1]:
                following[c], first[rows[p + 1]] = first[rows[p + 1]], c
            c = after
        if not _eliminate_block(D, swap[k]):
            return False
        for q in range(begin[k], begin[k + 1]):
            i = rows[q]
            for a in range(3):
                y0 = below[i, a, 0] * D[0, 0]
                y1 = (below[i, a, 1] - y0 * D[0, 1]) * D[1, 1]
                y2 = (below[i, a, 2] - y0 * D[0, 2] - y1 * D[1, 2]) * D[2, 2]
                y1 -= y2 * D[2, 1]
                lower[q, a, swap[k, 0]] = y0 - y1 * D[1, 0] - y2 * D[2, 0]
                lower[q, a, swap[k, 1]], lower[q, a, swap[k, 2]] = y1, y2
                for b in range(3):
                    upper[q, a, b] = right[i, a, b]
        if begin[k] < begin[k + 1]:
            following[k], first[rows[begin[k]]] = first[rows[begin[k]]], k
    return True


@fused
def solve(
    begin: Integers,
    rows: Integers,
    lower: Floats,
    upper: Floats,
    pivot: Floats,
    swap: Integers,
    into: Integers,
    x: Floats,
    start: int,
    out: Floats,
) -> None:
    """Motions `out` (k, 3 B) under loads `x` (3 B, m), which are overwritten.

    Loads are zero before row `start` and numbered by the order of elimination, in which freedom f
    of the motions is row `into[f]`.
    """
    if x.shape[1] % LOADS_AT_ONCE or x.shape[1] < len(out):
        raise ValueError("a number of right-hand sides that is no multiple of LOADS_AT_ONCE")
    bodies, left = len(pivot), np.empty((3, LOADS_AT_ONCE))
    for e in range(0, len(out), LOADS_AT_ONCE):
        for k in range(start // 3, bodies):
            j = 3 * k
            s = x[j, e], x[j, e + 1], x[j, e + 2], x[j, e + 3]
            t = x[j + 1, e], x[j + 1, e + 1], x[j + 1, e + 2], x[j + 1, e + 3]
            u = x[j + 2, e], x[j + 2, e + 1], x[j + 2, e + 2], x[j + 2, e + 3]
            for q in range(begin[k], begin[k + 1]):
                for a in range(3):
                    l0, l1, l2 = lower[q, a, 0], lower[q, a, 1], lower[q, a, 2]
                    for r in range(LOADS_AT_ONCE):
                        x[3 * rows[q] + a, e + r] -= l0 * s[r] + l1 * t[r] + l2 * u[r]
        for k in range(bodies - 1, -1, -1):
            for a in range(3):
                for r in range(LOADS_AT_ONCE):
                    left[a, r] = x[3 * k + a, e + r]
            for q in range(begin[k], begin[k + 1]):
                j = 3 * rows[q]
                s = x[j, e], x[j, e + 1], x[j, e + 2], x[j, e + 3]
                t = x[j + 1, e], x[j + 1, e + 1], x[j + 1, e + 2], x[j + 1, e + 3]
                u = x[j + 2, e], x[j + 2, e + 1], x[j + 2, e + 2], x[j + 2, e + 3]
                for a in range(3):
                    u0, u1, u2 = upper[q, a, 0], upper[q, a, 1], upper[q, a, 2]
                    for r in range(LOADS_AT_ONCE):
                        left[a, r] -= u0 * s[r] + u1 * t[r] + u2 * u[r]
            D, i, j, m = pivot[k], swap[k, 0], swap[k, 1], swap[k, 2]
            for r in range(LOADS_AT_ONCE):
                y0 = left[i, r]
                y1 = left[j, r] - D[1, 0] * y0
                y2 = (left[m, r] - D[2, 0] * y0 - D[2, 1] * y1) * D[2, 2]
                y1 = (y1 - D[1, 2] * y2) * D[1, 1]
                y0 = (y0 - D[0, 1] * y1 - D[0, 2] * y2) * D[0, 0]
                x[3 * k, e + r], x[3 * k + 1, e + r], x[3 * k + 2, e + r] = y0, y1, y2
    for r in range(len(out)):
        for f in range(len(into)):
            out[r, f] = x[into[f], r]
