"""The methods that a user chooses between: time and error of each setting, by group."""

from __future__ import annotations

import math
import os
import platform
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from time import process_time
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np

from loops import (
    Closure,
    GrainGraph,
    LinearFrictional,
    Regime,
    Scene,
    Spins,
    boundary_of,
    find_faces,
    macroscopic_tangent,
)
from loops.arrays import Floats, Regimes
from patterns import diamond, regular_polygon, synthetic_network
from stability import (
    Path,
    Stage,
    follow,
    plane_cone,
    polar_diagram,
    programmes,
    restrict,
    symmetric_spectrum,
)
from stability.verdict import loop_stability
from tests.oracles.diamond import TABLE_1
from tests.oracles.loop_balls import DIGITS, exact_tangent

# Least total time of the repeated runs in seconds; the fastest run counts.
LONG_ENOUGH, LONG_ENOUGH_QUICK = 0.15, 0.01
# Calls longer than this (seconds) are not run again for their memory: tracing slows Python down.
TRACED = 2.0
# E1, E2, s1 at B of Table 1, from the quadrature in 20 digits.
POINT_B = (0.40973434897033423289, 0.164934999828385506, 0.25400990008305293503)
# Increase of E1 from A to a strain beyond B.
SPAN = 0.11
DIRECTION_COUNTS = (36, 360, 3600, 36_000)
BATCH_SIZES = (1, 10, 100, 1000, 10_000)
# Names of `compiled=False` and `compiled=True`.
COMPILED_NAMES = ("numpy", "compiled")
KN, KT, MU, SLIDING_SHARE = 1.0, 0.4, 0.5, 0.2


# ---- paths
BENCH_LAW = LinearFrictional(kn=1.0, kt=0.8, mu=float(np.tan(np.radians(20.0))))
STAGES = (
    Stage(programmes.isotropic_strain(), "H11", 0.1),
    Stage(programmes.drained_biaxial(), "H11", 0.25),
)
STATE_FIELDS = (
    "parameter", "H", "P", "x", "normal_force", "shear_force", "A", "H_rate", "P_rate", "work"
)  # fmt: skip


@dataclass(frozen=True)
class Row:
    """Time, error and memory of one method at one setting."""

    group: str
    method: str
    setting: str
    items: int
    seconds_per_item: float
    error: float
    peak_bytes: float
    oracle: str
    default: bool = False


class Rows(list[Row]):
    """Rows of one group and oracle."""

    def __init__(self, group: str, oracle: str, quick: bool) -> None:
        super().__init__()
        self.group, self.oracle, self.quick = group, oracle, quick

    def add(
        self,
        method: str,
        setting: str,
        call: Callable[[], Any],
        gap: Any,
        items: int = 1,
        default: bool = False,
    ) -> None:
        """Run a method for its time, once more for its memory; `gap` is its error."""
        seconds = least_seconds(call, quick=self.quick)
        peak = peak_bytes(call) if seconds < TRACED else float("nan")
        measured = (items, seconds / items, largest(np.abs(gap)), peak)
        self.append(Row(self.group, method, setting, *measured, self.oracle, default))


def least_seconds(call: Callable[[], Any], *, quick: bool) -> float:
    """Processor time of the fastest of several runs, the least disturbed by other work."""
    enough = LONG_ENOUGH_QUICK if quick else LONG_ENOUGH
    times: list[float] = []
    while sum(times) < enough or (len(times) < 3 and times[0] < enough):
        start = time.process_time()
        call()
        times.append(max(time.process_time() - start, 1e-9))
    return min(times)


def peak_bytes(call: Callable[[], Any]) -> float:
    """Peak of the memory that a call asks for, beyond the memory held before."""
    tracemalloc.start()
    try:
        call()
        return float(tracemalloc.get_traced_memory()[1])
    finally:
        tracemalloc.stop()


def machine(*packages: str) -> dict[str, Any]:
    """Interpreter, processor, cores and packages: times depend on them."""
    found: dict[str, Any] = {"python": platform.python_version(), "cores": os.cpu_count()}
    found["processor"] = platform.machine()
    for name in packages:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def largest(errors: Any) -> float:
    """Largest error, 1 where there is no answer."""
    return float(np.max(np.where(np.isfinite(errors), errors, 1.0)))


def path_methods(quick: bool) -> Rows:
    """The drained path to point B of Table 1 by `follow`."""
    rows = Rows("paths", "quadrature, 20 digits", quick)
    rows.add("path solver", "paths 1", path_solver, error_at_b(path_solver()), 1, True)
    return rows


def path_solver() -> tuple[float, float, float]:
    """E1, E2, s1 at B by `stability.follow` on the graph of four grains."""
    E = TABLE_1.confinement
    path = follow(
        Scene(
            diamond(TABLE_1.alpha0, E1=E, E2=E),
            LinearFrictional(1.0, TABLE_1.kappa, TABLE_1.mu),
            boundary_of(
                diamond(TABLE_1.alpha0, E1=E, E2=E), volume=2.0 * math.sin(2.0 * TABLE_1.alpha0)
            ),
        ),
        Stage(programmes.drained_biaxial(), "H11", E + SPAN),
        closure="affine",
    )
    row = next(event.index for event in path.events if event.kind == "yield")
    return float(path.H[row, 0]), float(path.H[row, 3]), float(path.P[row, 0])


def error_at_b(found: tuple[float, float, float]) -> float:
    """Largest error of E1, E2, s1 at B."""
    return max(abs(value - true) for value, true in zip(found, POINT_B, strict=True))


# ---- closures, and loops in batches


class Rings(NamedTuple):
    """Loops of one order, their law and the regimes of their contacts."""

    graph: GrainGraph
    law: LinearFrictional
    regime: Regimes

    def first(self, count: int) -> Rings:
        """The first loops; a single one without batch axes."""
        g, at = self.graph, 0 if count == 1 else slice(count)
        part = GrainGraph(g.x[at], g.radii[at], g.contacts, g.normal_force[at], g.shear_force[at])
        return Rings(part, self.law, self.regime[at])

    def exact(self, k: int, closure: Closure) -> Floats:
        """Tangent of one loop with 50 digits, rounded."""
        g = self.graph
        one = GrainGraph(g.x[k], g.radii[k], g.contacts, g.normal_force[k], g.shear_force[k])
        return exact_tangent(one, self.law, self.regime[k], closure)

    def tangents(self, closure: Closure) -> Floats:
        """(L, 4, 4) tangents of all loops."""
        found = macroscopic_tangent(self.graph, self.law, closure, regime=self.regime).matrix
        return found.reshape(-1, 4, 4)


def irregular_rings(loops: int, order: int, seed: int) -> Rings:
    """Irregular rings: overlaps log-uniform from 1e-8 to 0.3, a fifth of the contacts sliding."""
    rng = np.random.default_rng(seed)
    angle = 2 * np.pi * (np.arange(order) + rng.uniform(-0.3, 0.3, (loops, order))) / order
    distance = rng.uniform(0.8, 1.2, (loops, order))
    x = distance[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    length = np.linalg.norm(np.roll(x, -1, axis=1) - x, axis=-1)
    overlap = 10.0 ** rng.uniform(-8, np.log10(0.3), (loops, 1))
    normal = KN * overlap * length * rng.uniform(0.5, 1.5, (loops, order))
    sliding = rng.random((loops, order)) < SLIDING_SHARE
    share = np.where(sliding, rng.choice([-1.0, 1.0], (loops, order)), rng.uniform(-0.95, 0.95))
    graph = GrainGraph(
        x=x,
        radii=length.max(axis=1, keepdims=True) * np.full(order, 0.8),
        contacts=np.column_stack([np.arange(order), np.roll(np.arange(order), -1)]),
        normal_force=normal,
        shear_force=share * MU * normal,
    )
    regime = np.where(sliding, Regime.SLIDING, Regime.ELASTIC).astype(np.int8)
    return Rings(graph, LinearFrictional(KN, KT, MU), regime)


def closure_methods(quick: bool) -> list[Row]:
    """The traction closure of rings, soft and stiff together, by numpy and by kernels."""
    cases = ((6, 200, 8),) if quick else ((6, 2000, 60), (20, 300, 12))
    found: list[Row] = []
    for order, loops, checked in cases:
        batch = irregular_rings(loops, order, seed=7)
        rows = Rows(f"closures, n = {order}", "primal system, 50 digits", quick)
        exact = np.array([batch.exact(k, "traction") for k in range(checked)])
        for name, least in (("numpy", 10**9), ("kernels", 1)):
            call = partial(solved_from, least, batch)
            error = relative_error(call(), exact)
            setting = f"{'below' if name == 'numpy' else 'from'} 40,000 contacts"
            rows.add(name, setting, call, error, loops, name == "numpy")
        found += rows
    return found


def solved_from(least: int, batch: Rings) -> Floats:
    """(L, 4, 4) traction tangents, kernels taken from so many contacts on."""
    with patch("loops.compiled.COMPILED_FROM", least):
        return batch.tangents("traction")


def relative_error(found: Floats, exact: Floats) -> float:
    """Largest error of the first operators over their norm, 1 for one without an answer."""
    gap = np.linalg.norm(found[: len(exact)] - exact, axis=(1, 2))
    return largest(gap / np.linalg.norm(exact, axis=(1, 2)))


def batch_sizes(quick: bool) -> Rows:
    """Time of a hexagon's tangent over the number of hexagons in one call."""
    rows = Rows("batch or one by one", "50 digits, first loop", quick)
    whole = irregular_rings(BATCH_SIZES[-1], 6, seed=9)
    closures: tuple[Closure, ...] = ("affine", "traction")
    for closure in closures:
        exact = whole.exact(0, closure)[None]
        for size in BATCH_SIZES[: 3 if quick else None]:
            call = partial(whole.first(size).tangents, closure)
            error = relative_error(call(), exact)
            rows.add(f"{closure} tangent", f"{size:,} at once", call, error, size)
    return rows


# ---- directions


def direction_methods(quick: bool) -> Rows:
    """Unstable fraction and smallest W2: sampled along directions, and from the cone."""
    operators = np.random.default_rng(2).standard_normal((40, 2, 2)) + 0.5 * np.eye(2)
    exact = np.array([cone_50(K) for K in operators])
    open_cone = (exact[:, 0] > 0.0) & (exact[:, 0] < 1.0)
    operators, exact = operators[open_cone], exact[open_cone]
    ways: list[tuple[str, str, Callable[[], Floats]]] = [
        ("sampled", f"{count:,} directions", partial(cone_by_directions, operators, count))
        for count in DIRECTION_COUNTS[: 2 if quick else None]
    ]
    ways.append(("closed", "plane_cone, eigvalsh", partial(cone_in_closed_form, operators)))
    rows = Rows("directions", "cone in closed form, 50 digits", quick)
    for way, setting, call in ways:
        for what, gap in zip(("fraction", "smallest W2"), (call() - exact).T, strict=True):
            rows.add(f"{way}: {what}", setting, call, gap, len(operators), way == "closed")
    return rows


def cone_by_directions(operators: Floats, count: int) -> Floats:
    """(K, 2) share of directions with W2 < 0, and the smallest W2 per unit strain rate."""
    diagram = polar_diagram(operators, directions=count)
    e = diagram.direction
    work = np.einsum("di,kij,dj->kd", e, operators, e, optimize=True)
    return np.stack([(diagram.work < 0.0).mean(axis=1), work.min(axis=1)], axis=1)


def cone_in_closed_form(operators: Floats) -> Floats:
    """(K, 2) opening of the cone over pi, and the smallest eigenvalue of Ks."""
    opening = plane_cone(operators).opening / np.pi
    return np.stack([opening, symmetric_spectrum(operators)[:, 0]], axis=1)


def cone_50(K: Floats) -> tuple[float, float]:
    """Unstable fraction and smallest W2 of one operator with 50 digits."""
    import mpmath as mp

    with mp.workdps(DIGITS):
        (a, b), (c, d) = ((mp.mpf(float(v)) for v in row) for row in K)
        mean, radius = (a + d) / 2, mp.sqrt(((a - d) / 2) ** 2 + ((b + c) / 2) ** 2)
        if radius <= abs(mean):
            return float(mean < 0), float(mean - radius)
        return float(mp.acos(mean / radius) / mp.pi), float(mean - radius)


# ---- compiled kernels


def compiled_methods(quick: bool) -> list[Row]:
    """Faces of a packing and modes of its loops by numpy and, unless quick, by compiled kernels."""
    kernels = (False,) if quick else (False, True)
    graph = synthetic_network(2000 if quick else 50_000, coordination=4.0, seed=3)
    plain, rows = (
        find_faces(graph, compiled=False),
        Rows("compiled or plain", "the plain way", quick),
    )
    for compiled in kernels:
        call: Callable[[], Any] = partial(find_faces, graph, compiled=compiled)
        found = call()
        same = np.array_equal(found.offsets, plain.offsets)
        wrong = float((found.contacts != plain.contacts).mean()) if same else 1.0
        name, setting = f"faces, {COMPILED_NAMES[compiled]}", f"{graph.contact_count:,} contacts"
        rows.add(name, setting, call, wrong, len(plain.contacts))
    matrices = irregular_rings(200 if quick else 20_000, 6, seed=13).tangents("affine")
    exact, count = symmetric_spectrum(restrict(matrices, "symmetric")), len(matrices)
    modes = Rows("compiled or plain", "LAPACK", quick)
    for compiled in kernels:
        call = partial(loop_stability, matrices, compiled=compiled)
        gap = (call().eigenvalues - exact) / np.abs(exact).max(axis=1, keepdims=True)
        modes.add(f"modes, {COMPILED_NAMES[compiled]}", f"{count:,} loops", call, gap, count)
    return rows + modes


METHOD_GROUPS: dict[str, Callable[[bool], list[Row]]] = {
    "paths": path_methods,
    "closures": closure_methods,
    "directions": direction_methods,
    "batches": batch_sizes,
    "compiled": compiled_methods,
}


@dataclass(frozen=True)
class Family:
    """Regular polygons, a corner on axis 1, confined to 10 % and loaded to 25 %."""

    closure: Closure
    spins: Spins
    orders: tuple[int, ...]

    @property
    def name(self) -> str:
        """Closure and spins in words."""
        return f"{self.closure}, spins {self.spins}"


FAMILIES = (
    Family("affine", "blocked", (4, 6, 8, 12, 20, 40, 100)),
    Family("traction", "blocked", (4, 6, 8, 12, 20, 40, 100)),
    Family("traction", "affine", (4, 6, 8, 12, 20, 40, 100)),
    Family("traction", "free", (4, 6, 8, 12, 20, 40)),
)


def smallest_model_rows() -> list[dict[str, Any]]:
    """One row for each family and order."""
    return [compared(family, order) for family in FAMILIES for order in family.orders]


def compared(family: Family, order: int) -> dict[str, Any]:
    """Cost of one loop by both models, and their largest difference."""
    small, seconds_small = _timed(family, order, "auto")
    full, seconds_full = _timed(family, order, "full")
    unknowns, of_all = small.model.unknowns.split(" of ")
    return {
        "scene": family.name,
        "order": order,
        "symmetry": small.model.symmetry,
        "freedoms": small.model.freedoms,
        "seconds_auto": seconds_small,
        "seconds_full": seconds_full,
        "saved": seconds_full / seconds_small,
        "unknowns_auto": int(unknowns),
        "unknowns_full": int(of_all),
        "solves_auto": small.model.branch_solves,
        "solves_full": full.model.branch_solves,
        "difference": largest_difference(small, full),
        "status": small.status,
    }


def largest_difference(small: Path, full: Path) -> float:
    """Largest difference of two paths at their events and ends, over the size of each quantity.

    States, tangents and rates; sizes below 1 count as 1. The steps between are each path's own.
    """
    told = [[(each.kind, each.contacts) for each in path.events] for path in (small, full)]
    if told[0] != told[1] or small.status != full.status:
        return float("inf")
    at = [[*(event.index for event in path.events), -1] for path in (small, full)]
    apart = 0.0
    for name in STATE_FIELDS:
        a, b = getattr(small, name)[at[0]], getattr(full, name)[at[1]]
        if not np.array_equal(np.isnan(a), np.isnan(b)):
            return float("inf")
        size = max(1.0, float(np.nanmax(np.abs(b), initial=0.0)))
        apart = max(apart, float(np.nanmax(np.abs(a - b), initial=0.0)) / size)
    return apart


def _timed(family: Family, order: int, model: Any) -> tuple[Path, float]:
    how: Any = {"closure": family.closure, "spins": family.spins, "model": model}
    start = process_time()
    path = follow(Scene(regular_polygon(order), BENCH_LAW), STAGES, **how)
    return path, process_time() - start
