"""Is a loop of a real packing a typical one among random loops of its order and shape?

Random loops: `patterns.random_loop`, convex and re-entrant, with grains in the snapshots' range of
sizes; a uniform stress on the polygon, and contact forces that balance it: any that friction
allows. Each real loop whose contacts all stick is ranked among the random ones of its order, convex
among convex, that are next to it in elongation and mobilisation, the mean of |T|/(mu N): the rank
is uniform if it is one of them.

    python -m studies.examples.loop_ensembles DIR [SNAPSHOT...]

A periodic snapshot has its cell from the table `macro.csv` beside it.
"""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from loops import (
    GrainGraph,
    LinearFrictional,
    Regime,
    boundary_vectors,
    contact_state,
    loop_batches,
    polygon_shape,
    traction_tangent,
)
from loops.arrays import Floats
from patterns import random_loop, read_snapshot, sample_path
from stability import restrict, symmetric_spectrum
from studies.examples import read, run_example, save
from studies.style import BLACK, ONE_COLUMN, VERMILION, new_panels, styled

ORDERS = range(3, 13)
# Discs of nearly one size have no re-entrant loop below this order.
FIRST_REENTRANT = 6
# Loops of an order that are drawn at once, and how often, convex ones and re-entrant ones.
BATCH, BATCHES, SEED = 2000, 10, 20261128
# Deviatoric stress over the mean one, and mean overlap over the mean diameter, at most.
MOST_DEVIATOR, OVERLAP = 0.6, 1e-3
# Random loops that a real one is ranked among, and how far off they may be (natural logarithm of
# the elongation, and mobilisation).
NEIGHBOURS, NEAR_SHAPES = 100, 0.15
FEWEST_RANKS = 20


def drawn_forces(rng: np.random.Generator, a: Floats, B: Floats) -> Floats:
    """Redundant forces `f` (L, 2) with `a + B f > 0`, nan where there are none.

    The forces that friction allows are a polygon: a mean of its corners with random weights.
    """
    i, j = np.triu_indices(a.shape[1], 1)
    corners = np.linalg.solve(B[:, [i, j]].swapaxes(1, 2), -a[:, [i, j]].swapaxes(1, 2)[..., None])
    least = (a[:, None] + corners[..., 0] @ B.swapaxes(1, 2)).min(axis=2)
    allowed = least > -1e-9 * np.abs(a).mean(axis=1, keepdims=True)
    weight = allowed * rng.exponential(size=allowed.shape)
    with np.errstate(invalid="ignore"):
        return (weight[..., None] * corners[..., 0]).sum(axis=1) / weight.sum(axis=1, keepdims=True)


def random_loops(
    rng: np.random.Generator, order: int, count: int, law: LinearFrictional, **how: Any
) -> GrainGraph:
    """Draw `count` random loops of mean diameter 1; keep those that a uniform stress can load.

    `how` are options of `patterns.random_loop`. Overlaps of a thousandth are left out: grains just
    touch.
    """
    loops = random_loop(order, int(rng.integers(2**31)), size=count, **how)
    # Axis 1 has the larger stress: the loops themselves lie at any angle.
    stress = np.eye(2) + rng.uniform(0.0, MOST_DEVIATOR, (count, 1, 1)) * np.diag([1.0, -1.0])
    # Each contact carries what loads the grains before it, and the same force `f` as all others.
    force, contacts = -np.cumsum(boundary_vectors(loops.x) @ stress, axis=1), contact_state(loops)
    n, t = contacts.n, contacts.t
    # Within friction `mu N - T` and `mu N + T` are positive.
    B = np.concatenate([law.mu * n - t, law.mu * n + t], axis=1)
    f = drawn_forces(rng, np.vecdot(B, np.tile(force, (2, 1))), B)
    N, T = (np.vecdot(force + f[:, None], axis) for axis in (n, t))
    scale = law.kn * OVERLAP / np.abs(N).mean(axis=1, keepdims=True)
    x, radii, N, T = (v[np.isfinite(f[:, 0])] for v in (loops.x, loops.radii, scale * N, scale * T))
    return GrainGraph(x=x, radii=radii, contacts=loops.contacts, normal_force=N, shear_force=T)


def measures(graph: GrainGraph, law: Any, kn: float) -> pd.DataFrame:
    """Shape, mobilisation and stability of loops: traction closure, spins blocked."""
    tangent = traction_tangent(graph, law)
    K = restrict(np.where(tangent.trusted[:, None, None], tangent.matrix, np.nan), "symmetric")
    largest = np.maximum(np.asarray(law.mu) * graph.normal_force, np.finfo(float).tiny)
    d = np.roll(graph.x, -1, axis=1) - graph.x
    after = np.roll(d, -1, axis=1)
    return pd.DataFrame({
        "order": graph.grain_count,
        "elongation": polygon_shape(graph.x)[0],
        "mobilisation": np.minimum(np.abs(graph.shear_force) / largest, 1.0).mean(axis=1),
        "convex": (d[..., 0] * after[..., 1] > d[..., 1] * after[..., 0]).all(axis=1),
        "lambda_min": symmetric_spectrum(K)[:, 0] / kn,
    })  # fmt: skip


def ranked(real: pd.DataFrame, random: pd.DataFrame) -> pd.DataFrame:
    """The real loops with their `rank` in [0, 1] by the smallest eigenvalue, nan without match.

    Ties count half.
    """
    real, alike = real.assign(rank=np.nan), ["order", "convex"]
    groups = dict(iter(random[np.isfinite(random.lambda_min)].groupby(alike)))
    for key, some in real.groupby(alike):
        if len(like := groups.get(key, ())) < NEIGHBOURS:
            continue
        tree, at = (np.column_stack([np.log(t.elongation), t.mobilisation]) for t in (like, some))
        distance, near = cKDTree(tree).query(at, NEIGHBOURS)
        values, here = like.lambda_min.to_numpy()[near], some.lambda_min.to_numpy()[:, None]
        rank = ((values < here) + 0.5 * (values == here)).mean(axis=1)
        good = (distance[:, -1] <= NEAR_SHAPES) & np.isfinite(here[:, 0])
        real.loc[some.index, "rank"] = np.where(good, rank, np.nan)
    return real


def by_order(real: pd.DataFrame, random: pd.DataFrame) -> pd.DataFrame:
    """By order: numbers, medians and shares of both, mean ranks with 1.96 standard errors."""
    found = real.dropna(subset="rank").groupby("order")["rank"]
    table = found.agg(matched="count", rank="mean", below_5=lambda rank: (rank < 0.05).mean())
    table["rank_low"], table["rank_high"] = (table["rank"] + k * found.sem() for k in (-1.96, 1.96))
    for name, loops in {"real": real, "random": random}.items():
        whole = loops.groupby("order")
        table[name], table[f"{name}_lambda"] = whole.size(), whole["lambda_min"].median()
        table[f"{name}_convex"] = whole["convex"].mean()
    return table[table.matched >= FEWEST_RANKS].reset_index()


@styled()
def draw(table: pd.DataFrame) -> Figure:
    """Mean ranks of real loops by order."""
    figure, ((ax,),) = new_panels(1, 1, 2.6, ONE_COLUMN)
    away = table["rank_high"] - table["rank"]
    ax.errorbar(table.order, table["rank"], away, fmt="o", color=VERMILION)
    ax.axhline(0.5, color=BLACK, linewidth=0.5)
    ax.set(xlabel="order $n$ (–)", ylabel="mean rank (–)", ylim=(0.0, 1.0), xticks=table.order)
    return figure


def main(out: Path, *paths: Path, batches: int = BATCHES) -> dict[str, Any]:
    """Draw the ensembles, rank the real loops, and write table and figure."""
    snapshots = [read(path) for path in paths] or [read_snapshot(sample_path())]
    parts, drawn = list[pd.DataFrame](), list[pd.DataFrame]()
    for snapshot in snapshots:
        law, regime = snapshot.mechanics()
        for batch in loop_batches(snapshot.graph.replace(regime=regime), snapshot.faces):
            found = measures(batch.graph, law.take(batch.contacts), snapshot.mean_kn)
            parts.append(found[np.all(batch.graph.regime == Regime.ELASTIC, axis=1)])
    kt, mu = float(np.mean(law.kt)) / snapshots[-1].mean_kn, float(np.max(law.mu))  # type: ignore
    plain, rng = LinearFrictional(1.0, kt, mu), np.random.default_rng(SEED)
    radii = np.concatenate([snapshot.graph.radii for snapshot in snapshots])
    sizes = float(np.ptp(radii) / (radii.max() + radii.min()))
    for convex, order, _ in product((True, False), ORDERS, range(batches)):
        if convex or order >= FIRST_REENTRANT:
            how: dict[str, Any] = {"convex": convex, "polydispersity": sizes}
            graph = random_loops(rng, order, BATCH, plain, **how)
            drawn.append(measures(graph, plain, 1.0))
    random = pd.concat(drawn, ignore_index=True)
    real = ranked(pd.concat(parts, ignore_index=True), random)
    table = by_order(real, random)
    numbers = {"seed": SEED, "random": len(random), "real": len(real)}
    numbers |= {"matched": int(real["rank"].notna().sum()), "by_order": table.to_dict("records")}
    return save(out, "loop_ensembles", draw(table), numbers, table)


if __name__ == "__main__":
    run_example(main, "[SNAPSHOT ...]")
