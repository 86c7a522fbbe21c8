"""Multifrontal LU of a packing's matrix: solves, and entries of its inverse (Takahashi).

Nested dissection orders the grains into a tree of fronts, dense matrices. With a front's own
freedoms J and the remaining S, and `K` reduced to them by the fronts below,

    Z_SJ = -Z_SS F_SJ F_JJ^-1,  Z_JS = -F_JJ^-1 F_JS Z_SS,
    Z_JJ = F_JJ^-1 + F_JJ^-1 F_JS Z_SS F_SJ F_JJ^-1

`Z_SS` is a part of the parent's inverse: one sweep up the tree factorises, one sweep down inverts.
`K` may be nonsymmetric; pivots are taken within a front's own block. Where such a block is nearly
singular the sweep down amplifies rounding more than a solve does: the variance of its rounding goes
down with it. Subtrees are independent, so threads share them; each front is computed in the same
way by any thread.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import maximum_bipartite_matching

from loops.arrays import Flags, Floats, Integers

# Grains in a leaf: smaller fronts cost more calls, larger ones more arithmetic.
LEAF = 32
# Added to the diagonal of a front without an inverse, over the largest entry of the matrix: a
# mechanism that carries nothing.
EPS = 1e-12
# Largest subtree that is one task of a thread, as a share of all grains.
TASK = 1 / 32
# Number of random vectors by which norms are estimated, for all loops at once.
SKETCH = 16
# Above this norm of the residual `R = 1 - K Z` errors are not of first order in it: a mode may be
# softer than EPS shows.
LARGEST_RESIDUAL = 0.1
# Eigenvalue of the softest mode there may be then, over the largest.
SOFTEST = 1e-16
# Variance of the rounding of one product, over its square.
PRODUCT = float(np.finfo(np.float64).eps) ** 2


@dataclass(frozen=True, eq=False)
class Front:
    """Grains that a front eliminates (`own`) or leaves to its parent (`rest`), and its children."""

    own: Integers
    rest: Integers
    children: tuple[int, ...]


def dissection(x: Floats, edges: Integers) -> list[Front]:
    """Fronts of the graph of `edges` (E, 2) on grains at `x` (G, 2), children before parents.

    A separator is the smallest set of grains that touches every edge across a straight cut; a front
    leaves to its parent the later neighbours of its grains and what its children left to it.
    """
    own: list[Integers] = []
    children: list[tuple[int, ...]] = []

    def cut(grains: Integers, edges: Integers) -> int | None:
        if len(grains) == 0:
            return None
        if len(grains) <= LEAF:
            return place(grains, ())
        along = x[grains, int(np.argmax(np.ptp(x[grains], axis=0)))]
        side = np.zeros(len(x), dtype=np.int8)
        half = np.argsort(along, kind="stable")
        side[grains[half[: len(half) // 2]]] = 1
        side[grains[half[len(half) // 2 :]]] = 2
        ends = side[edges]
        across = edges[ends[:, 0] != ends[:, 1]]
        first = side[across[:, 0]] == 1
        side[_vertex_cover(np.where(first[:, None], across, across[:, ::-1]))] = 3
        ends = side[edges]
        inside = [edges[(ends == s).all(axis=1)] for s in (1, 2)]
        below = [
            cut(grains[side[grains] == s], part) for s, part in zip((1, 2), inside, strict=True)
        ]
        return place(grains[side[grains] == 3], tuple(k for k in below if k is not None))

    def place(grains: Integers, below: tuple[int, ...]) -> int:
        own.append(grains)
        children.append(below)
        return len(own) - 1

    cut(np.arange(len(x)), edges)
    turn = _turns(own)
    pairs = np.concatenate([edges, edges[:, ::-1]])
    pairs = pairs[turn[pairs[:, 0]] < turn[pairs[:, 1]]]
    pairs = pairs[np.argsort(turn[pairs[:, 0]], kind="stable")]
    start = np.searchsorted(turn[pairs[:, 0]], np.arange(len(own) + 1))
    fronts: list[Front] = []
    for k, grains in enumerate(own):
        later = [pairs[start[k] : start[k + 1], 1]]
        later += [fronts[c].rest[turn[fronts[c].rest] > k] for c in children[k]]
        fronts.append(Front(grains, np.unique(np.concatenate(later)), children[k]))
    return fronts


def _turns(own: list[Integers]) -> Integers:
    """Return the number of the front that eliminates each grain."""
    turn = np.empty(sum(map(len, own)), dtype=np.int64)
    for k, grains in enumerate(own):
        turn[grains] = k
    return turn


def _vertex_cover(edges: Integers) -> Integers:
    """Smallest set of vertices that touches all `edges` (E, 2) from one side to the other.

    By König's theorem from a maximum matching: vertices of the first side that no alternating path
    from an unmatched one reaches, and vertices of the second side that one reaches.
    """
    (left, i), (right, j) = (np.unique(ends, return_inverse=True) for ends in edges.T)
    graph = sparse.csr_array((np.ones(len(edges), dtype=np.int8), (i, j)), (len(left), len(right)))
    partner = np.asarray(maximum_bipartite_matching(graph, perm_type="column"), dtype=np.int64)
    back = np.zeros(len(right), dtype=np.int64)
    back[partner[partner >= 0]] = np.flatnonzero(partner >= 0)
    reached_left, reached_right = partner < 0, np.zeros(len(right), dtype=bool)
    new: Flags = reached_left
    while new.any():
        reached = (graph.T @ new.astype(np.int64) > 0) & ~reached_right
        reached_right |= reached
        # Every vertex that is reached is matched, since the matching is maximum.
        new = np.zeros(len(left), dtype=bool)
        new[back[reached]] = True
        reached_left |= new
    return np.concatenate([left[~reached_left], right[reached_right]])


class Rows(NamedTuple):
    """Grains (R, n), numbered as in the fronts; their freedoms (R, m), -1 for none; rows asked."""

    grains: Integers
    freedoms: Integers
    asked: Flags


class Eliminated(NamedTuple):
    """A front's own and remaining freedoms, `F_JJ^-1`, `F_JJ^-1 F_JS` and `F_SJ F_JJ^-1`."""

    own: Integers
    rest: Integers
    inverse: Floats
    right: Floats
    left: Floats


@dataclass(frozen=True, eq=False)
class FrontalLU:
    """Factors of a matrix by fronts, children before parents."""

    fronts: list[Front]
    parts: list[Eliminated]
    size: int
    threads: int

    def solve(self, b: Floats, *, transposed: bool = False) -> Floats:
        """(size, k) solutions `K^-1 b`, or `K^-T b`."""
        v = b.copy()
        for part in self.parts:
            v[part.rest] -= (part.right.T if transposed else part.left) @ v[part.own]
        for part in reversed(self.parts):
            inverse, right = part.inverse, part.right
            if transposed:
                inverse, right = inverse.T, part.left.T
            v[part.own] = inverse @ v[part.own] - right @ v[part.rest]
        return v

    def refined(self, matrix: sparse.csr_array, b: Floats) -> Floats:
        """Return solutions (size, k) of the matrix, refined once."""
        u = self.solve(b)
        return u + self.solve(b - matrix @ u)

    def entries(
        self, groups: list[Rows], use: Callable[[int, Integers, Floats, Floats], None]
    ) -> None:
        """Call `use(group, rows, inverse, variance)` with entries (r, m, m) between m freedoms.

        All grains of a row are in its first front. Entries without a freedom have no meaning.
        """
        turn = _turns([front.own for front in self.fronts])
        at: list[list[tuple[int, Integers]]] = [[] for _ in self.fronts]
        for group, (grains, _, asked) in enumerate(groups):
            rows = np.flatnonzero(asked)
            first = turn[grains[rows]].min(axis=1)
            order = np.argsort(first, kind="stable")
            where, start = np.unique(first[order], return_index=True)
            for k, some in zip(where.tolist(), np.split(rows[order], start[1:]), strict=False):
                at[k].append((group, some))

        def pick(k: int, freedoms: Integers, z: Floats, spread: Floats) -> None:
            order = np.argsort(freedoms)
            for group, rows in at[k]:
                asked = groups[group].freedoms[rows].reshape(len(rows), -1).clip(0)
                place = order[np.searchsorted(freedoms, asked, sorter=order) % len(order)]
                between = place[:, :, None], place[:, None, :]
                use(group, rows, z[between], spread[between])

        self.on_fronts(pick)

    def on_fronts(self, use: Callable[[int, Integers, Floats, Floats], None]) -> None:
        """Call `use(front, freedoms, inverse, variance)` for each front, its own freedoms first.

        The variance is that of the entries' rounding in this sweep, taken as independent. Threads
        call it for several fronts at a time.
        """
        starts = dict(_tasks(self.fronts))
        waiting: list[Future[None]] = []

        def down(k: int, outer: Floats, variance: Floats) -> None:
            place = np.empty(self.size, dtype=np.int64)
            todo = [(k, outer, variance)]
            while todo:
                k, outer, variance = todo.pop()
                z, spread = _inverse_of(self.parts[k], outer, variance)
                freedoms = np.concatenate([self.parts[k].own, self.parts[k].rest])
                use(k, freedoms, z, spread)
                place[freedoms] = np.arange(len(freedoms))
                for child in self.fronts[k].children:
                    at = place[self.parts[child].rest]
                    below = (child, z[at[:, None], at], spread[at[:, None], at])
                    if child in starts:
                        waiting.append(pool.submit(down, *below))
                    else:
                        todo.append(below)

        with ThreadPoolExecutor(self.threads) as pool:
            if self.fronts:
                none = np.empty((0, 0))
                waiting.append(pool.submit(down, len(self.fronts) - 1, none, none))
            while waiting:
                waiting.pop().result()


def _inverse_of(part: Eliminated, outer: Floats, variance: Floats) -> tuple[Floats, Floats]:
    """Entries of the inverse in a front, own freedoms first, and the variance of their rounding.

    `outer` and `variance` are those of its remaining freedoms.
    """
    j, size = len(part.own), len(part.own) + len(part.rest)
    z, spread = np.empty((size, size)), np.empty((size, size))
    z[j:, j:], spread[j:, j:] = outer, variance
    z[j:, :j] = -outer @ part.left
    z[:j, j:] = -part.right @ outer
    z[:j, :j] = part.inverse - part.right @ z[j:, :j]
    with np.errstate(over="ignore", invalid="ignore"):
        products = variance + PRODUCT * outer**2
        spread[j:, :j] = products @ part.left**2
        spread[:j, j:] = part.right**2 @ products
        spread[:j, :j] = part.right**2 @ (spread[j:, :j] + PRODUCT * z[j:, :j] ** 2)
        spread[:j, :j] += PRODUCT * part.inverse**2
    return z, spread


def frontal_lu(
    matrix: sparse.csr_array, fronts: list[Front], freedom: Integers, threads: int = 1
) -> FrontalLU:
    """Factorise front by front; `freedom` (G, k) has -1 where a grain has no freedom."""
    columns, size = matrix.tocsc(), matrix.shape[0]
    unit = float(np.abs(matrix.data).max(initial=0.0))
    parts: dict[int, Eliminated] = {}
    updates: dict[int, Floats] = {}

    def up(some: range, below: list[Future[None]]) -> None:
        for future in below:
            future.result()
        place = np.full(size, -1)
        for k in some:
            front = fronts[k]
            own, rest = _free(freedom, front.own), _free(freedom, front.rest)
            j, n = len(own), len(own) + len(rest)
            place[own], place[rest] = np.arange(j), np.arange(j, n)
            dense = np.zeros((n, n))
            for child in front.children:
                at = place[parts[child].rest]
                dense[at[:, None], at] += updates.pop(child)
            _add_lines(dense, matrix, own, place)
            _add_lines(dense.T, columns, own, place, after=j)
            try:
                inverse = np.asarray(np.linalg.inv(dense[:j, :j]))
            except np.linalg.LinAlgError:
                inverse = np.asarray(np.linalg.inv(dense[:j, :j] + EPS * unit * np.eye(j)))
            right = inverse @ dense[:j, j:]
            updates[k] = dense[j:, j:] - dense[j:, :j] @ right
            parts[k] = Eliminated(own, rest, inverse, right, dense[j:, :j] @ inverse)
            place[own], place[rest] = -1, -1

    tasks: dict[int, Future[None]] = {}
    with ThreadPoolExecutor(threads) as pool:
        for k, first in _tasks(fronts):
            below = [tasks[child] for child in fronts[k].children if child < first]
            tasks[k] = pool.submit(up, range(first, k + 1), below)
        for task in tasks.values():
            task.result()
    return FrontalLU(fronts, [parts[k] for k in range(len(fronts))], size, threads)


def _tasks(fronts: list[Front]) -> list[tuple[int, int]]:
    """Last and first front of each task: small subtrees, then one by one the fronts above them.

    Children stand before their parents and a subtree is a range of fronts.
    """
    weight, first = np.zeros(len(fronts)), np.arange(len(fronts))
    for k, front in enumerate(fronts):
        weight[k] = len(front.own) + weight[list(front.children)].sum()
        first[k] = min([k, *first[list(front.children)]])
    small = weight <= TASK * weight.max(initial=0.0)
    inside = np.zeros(len(fronts), dtype=bool)
    for front, whole in zip(fronts, small, strict=True):
        inside[list(front.children)] |= whole
    return [(k, int(first[k]) if small[k] else k) for k in np.flatnonzero(~inside).tolist()]


def _free(freedom: Integers, grains: Integers) -> Integers:
    every = freedom[grains].ravel()
    return every[every >= 0]


def _add_lines(
    dense: Floats, lines: sparse.csr_array, own: Integers, place: Integers, after: int = 0
) -> None:
    """Add the matrix's entries of the own lines, from local place `after` on, to a front."""
    count = lines.indptr[own + 1] - lines.indptr[own]
    row = np.repeat(np.arange(len(own)), count)
    shift = np.repeat(lines.indptr[own] - np.concatenate([[0], np.cumsum(count)[:-1]]), count)
    at = np.arange(len(row)) + shift
    column = place[lines.indices[at]]
    inside = column >= after
    dense[row[inside], column[inside]] += lines.data[at][inside]


def solve_sketches(matrix: sparse.csr_array, lu: FrontalLU) -> list[Floats]:
    """Return (size, SKETCH) `Z d g`, `Z^T c g`, `R^T g / d`, random signs g over sqrt(SKETCH).

    Scalar products with such vectors estimate norms. Columns of `K` have the size `c` and its
    rows, over `c`, the size `d`: rounding of `K` changes `a.Kb` by about `ROUNDING |d a| |c b|`,
    even where its entries differ much in size.
    """
    sizes = abs(matrix)
    c = np.where(sizes.sum(axis=0) > 0, sizes.sum(axis=0), 1.0)
    d = np.where(sizes.sum(axis=1) > 0, sizes @ (1.0 / c), 1.0)[:, None]
    signs = _random_signs(len(c), seed=0)
    loads = np.hstack([c[:, None] * signs, matrix.T @ (signs / d)])
    right, back = np.hsplit(lu.solve(loads, transposed=True), 2)
    residual = signs / d - back
    if not np.linalg.norm(d * residual) < LARGEST_RESIDUAL:
        residual *= EPS / SOFTEST
    return [lu.solve(d * signs), right, residual]


def slip_sketches(
    lu: FrontalLU, amplitudes: Integers, rounding: tuple[sparse.csr_array, sparse.csr_array]
) -> list[Floats]:
    """Return (size, SKETCH) `Z E g`, `Z e g`, `Z^T e g`, `Z^T F g` of rings that nearly close.

    `E` and `F` are what rounding of each slip adds to columns and rows, `e` their amplitudes:
    rounding changes `a.Kb` by about `|a.E| |e.b| + |a.e| |F.b|`.
    """
    if not len(amplitudes):
        return [np.zeros((lu.size, 0))] * 4
    columns, rows = (one.T @ _random_signs(one.shape[0], seed=1) for one in rounding)
    on_rings = np.zeros((lu.size, SKETCH))
    on_rings[amplitudes] = _random_signs(len(amplitudes), seed=2)
    left = lu.solve(np.hstack([columns, on_rings]))
    right = lu.solve(np.hstack([on_rings, rows]), transposed=True)
    return [*np.hsplit(left, 2), *np.hsplit(right, 2)]


def _random_signs(count: int, *, seed: int) -> Floats:
    """Return (count, SKETCH) signs over sqrt(SKETCH)."""
    return np.random.default_rng(seed).choice([-1.0, 1.0], (count, SKETCH)) / np.sqrt(SKETCH)
