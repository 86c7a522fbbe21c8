"""The order of half-edges around a grain: by angle, by key and exact predicate, by fractions."""

from __future__ import annotations

from fractions import Fraction
from functools import cmp_to_key, partial
from typing import Any

import numpy as np

from loops import GrainGraph, branch_vectors
from loops.arrays import Integers
from loops.faces import next_half_edge
from patterns import synthetic_network
from tests.benchmarks.methods import Rows
from tests.oracles.hard_cases import parallel_half_edges

ORACLE = "orientation by fractions"
PAIRS = 200
ULPS = 1.0


def half_edge_methods(quick: bool) -> Rows:
    """Time per half-edge of a packing, and wrong half-edges of a hub with parallel spokes."""
    packing = synthetic_network(2000 if quick else 50_000, coordination=4.0, seed=3)
    hub = parallel_half_edges(ULPS, PAIRS).graph
    exact = follow_exactly(hub)
    small = synthetic_network(500, coordination=4.0, seed=3)
    cases: tuple[tuple[str, str, Any, GrainGraph, bool], ...] = (
        ("sort by angle", "arctan2, float64", follow_by_angle, packing, False),
        (
            "sort by angle",
            "arctan2, float32",
            partial(follow_by_angle, dtype=np.float32),
            packing,
            False,
        ),
        ("key, then exact", "next_half_edge", follow_by_key, packing, True),
        ("fractions throughout", "Fraction, sorted", follow_exactly, small, False),
    )
    rows = Rows("half-edges", ORACLE, quick)
    for method, setting, follower, graph, default in cases:
        wrong = (follower(hub) != exact).mean()
        rows.add(method, setting, partial(follower, graph), wrong, 2 * graph.contact_count, default)
    return rows


def follow_by_key(graph: GrainGraph) -> Integers:
    """Followers by the code's own order."""
    branches, numbers = branch_vectors(graph), np.arange(graph.contact_count)
    return next_half_edge(graph.grain_count, graph.contacts, numbers, branches)


def follow_by_angle(graph: GrainGraph, dtype: Any = np.float64) -> Integers:
    """Followers where half-edges are sorted by their angle in floating point."""
    d = branch_vectors(graph).astype(dtype)
    both = np.stack([d, -d], axis=1).reshape(-1, 2)
    angle = np.arctan2(both[:, 1], both[:, 0])
    origin = graph.contacts.ravel()
    return _followers(np.lexsort((angle, origin)), origin)


def follow_exactly(graph: GrainGraph) -> Integers:
    """Followers by rational arithmetic, half-edge by half-edge."""
    d, origin = branch_vectors(graph).tolist(), graph.contacts.ravel()
    vector = []
    for x, y in d:
        fx, fy = Fraction(x), Fraction(y)
        vector += [(fx, fy), (-fx, -fy)]

    def compare(a: int, b: int) -> int:
        if origin[a] != origin[b]:
            return int(origin[a] - origin[b])
        (ax, ay), (bx, by) = vector[a], vector[b]
        upper_a, upper_b = ay > 0 or (ay == 0 and ax > 0), by > 0 or (by == 0 and bx > 0)
        if upper_a != upper_b:
            return 1 if upper_a else -1
        return -1 if ax * by - ay * bx > 0 else 1

    order = sorted(range(len(vector)), key=cmp_to_key(compare))
    return _followers(np.array(order), origin)


def _followers(order: Integers, origin: Integers) -> Integers:
    """The half-edge that follows at its end: the next one clockwise from the way back."""
    starts = np.flatnonzero(np.diff(origin[order], prepend=-1))
    before = np.roll(order, 1)
    before[starts] = order[np.append(starts[1:], len(order)) - 1]
    clockwise = np.empty_like(order)
    clockwise[order] = before
    return clockwise.reshape(-1, 2)[:, ::-1].ravel()
