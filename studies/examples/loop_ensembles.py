"""Is a loop of a real packing a typical one among random loops of its order and shape?

Random loops: `patterns.random_loop`, convex and re-entrant, with grains in the snapshots' range of
sizes; a uniform stress on the polygon, and contact forces that balance it: any that friction
allows, with no, one or two contacts at yield. Each real loop is ranked among the random ones of its
order and number of sliding contacts, convex beside convex, that are next to it in elongation and
mobilisation, the mean of |T|/(mu N): the rank is uniform if it is one of them.

    python -m studies.examples.loop_ensembles DIR [SNAPSHOT...]

A periodic snapshot has its cell from the table `macro.csv` beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
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
    contact_state,
    loop_batches,
    polygon_shape,
    traction_tangent,
)
from loops.arrays import Flags, Floats, Integers
from loops.geometry import from_centroid, outward
from patterns import Snapshot, random_loop, read_snapshot, sample_cell, sample_path
from stability.verdict import loop_stability
from studies.examples import read, run_example, save
from studies.style import BLACK, BLUE, VERMILION, figure_key, new_panels, styled

ORDERS = range(3, 13)
# Discs of nearly one size have no re-entrant loop below this order.
FIRST_REENTRANT = 6
LOOPS, SEED = 100_000, 20261128
# Deviatoric stress over the mean one, and mean overlap over the mean diameter, at most.
MOST_DEVIATOR, OVERLAP = 0.6, 1e-3
# Random loops that a real one is ranked among, and how far off they may be (natural logarithm of
# the elongation, and mobilisation).
NEIGHBOURS, NEAR_SHAPES = 100, 0.15
RESAMPLES = 400
FEWEST_RANKS = 20


def drawn_forces(
    rng: np.random.Generator, a: Floats, B: Floats, wanted: Integers
) -> tuple[Floats, Flags, Flags]:
    """Redundant forces `f` (L, 2) with `a + B f >= 0`, the limits that are met, and which exist.

    The forces that friction allows are a polygon: none at its limit is a mean of its corners with
    random weights, one a point of a side, two a corner, where two contacts reach their limits.
    """
    count, n, every = len(a), a.shape[1] // 2, np.arange(len(a))
    i, j = np.triu_indices(2 * n, 1)
    det = B[:, i, 0] * B[:, j, 1] - B[:, i, 1] * B[:, j, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        met = B[:, i, ::-1] * a[:, j, None] - B[:, j, ::-1] * a[:, i, None]
        corners = [1.0, -1.0] * met / det[..., None]
    least = np.stack([(a + (B @ f[..., None])[..., 0]).min(axis=1)
                      for f in np.moveaxis(corners, 1, 0)], axis=1)  # fmt: skip
    size = np.abs(a).mean(axis=1, keepdims=True)
    good = np.nan_to_num(least, nan=-np.inf) > -1e-9 * size
    weight = rng.exponential(size=good.shape) * good
    # A contact that reaches both of its limits carries nothing: no corner to choose.
    first = (weight * ((j - i) != n)).argmax(axis=1)
    limit = np.where(rng.random(count) < 0.5, i[first], j[first])
    on_side = (i == limit[:, None]) | (j == limit[:, None])
    beside = good & on_side & (np.arange(len(i)) != first[:, None])
    second, share = beside.argmax(axis=1), rng.uniform(size=(count, 1))
    corner = corners[every, first]
    side = corner + share * (corners[every, second] - corner)
    whole = weight.sum(axis=1, keepdims=True)
    with np.errstate(invalid="ignore"):
        inner = (np.where(good[..., None], corners, 0.0) * weight[..., None]).sum(axis=1) / whole
    f = np.choose(wanted[:, None], [inner, side, corner])
    slides = np.zeros((count, n), dtype=bool)
    slides[every, limit % n] = wanted > 0
    for met in (i[first], j[first]):
        slides[every, met % n] |= wanted == 2
    return f, slides, (good.sum(axis=1) > 2) & good[every, first] & beside[every, second]


def random_loops(
    rng: np.random.Generator, order: int, count: int, polydispersity: float, law: LinearFrictional
) -> tuple[GrainGraph, Floats]:
    """Random loops of mean diameter 1 in balance, and the uniform stress (L, 2, 2) of each.

    Overlaps of a thousandth are left out: grains just touch.
    """
    parts, left, reentrant = list[tuple[Any, ...]](), count, False
    while left > 0:
        how: dict[str, Any] = {"convex": not reentrant, "polydispersity": polydispersity}
        loops = random_loop(order, int(rng.integers(2**31)), size=min(2 * left + 64, 4096), **how)
        reentrant = order >= FIRST_REENTRANT and not reentrant
        x, many = loops.x, len(loops.x)
        turn, share = rng.uniform(0.0, 2.0 * np.pi, many), rng.uniform(0.0, MOST_DEVIATOR, many)
        c, s = share * np.cos(turn), share * np.sin(turn)
        stress = np.eye(2) + np.moveaxis(np.array([[c, s], [s, -c]]), -1, 0)
        # Contact forces `f - P m`, within friction where `mu N - T` and `mu N + T` are positive.
        centred, contacts = from_centroid(x), contact_state(loops)
        force = -outward(x, 0.5 * (centred + np.roll(centred, -1, axis=1))) @ stress
        n, t = contacts.n, contacts.t
        B = np.concatenate([law.mu * n - t, law.mu * n + t], axis=1)
        a = (B * np.concatenate([force, force], axis=1)).sum(axis=-1)
        f, slides, good = drawn_forces(rng, a, B, rng.integers(0, 3, many))
        N, T = (((force + f[:, None]) * e).sum(axis=-1) for e in (n, t))
        scale = law.kn * OVERLAP / np.abs(N).mean(axis=1)
        kept = np.flatnonzero(good)[:left]
        own = scale[kept, None]
        parts.append((x[kept], loops.radii[kept], own * N[kept], own * T[kept], slides[kept],
                      own[..., None] * stress[kept]))  # fmt: skip
        left -= len(kept)
    x, radii, N, T, slides, stress = (np.concatenate(each) for each in zip(*parts, strict=True))
    regime = np.where(slides, Regime.SLIDING, Regime.ELASTIC).astype(np.int8)
    graph = GrainGraph(x=x, radii=radii, contacts=loops.contacts, normal_force=N, shear_force=T)
    return graph.replace(regime=regime), stress


def measures(graph: GrainGraph, law: Any, kn: float) -> pd.DataFrame:
    """Shape, mobilisation and stability of loops: traction closure, spins blocked."""
    tangent = traction_tangent(graph, law, regime=graph.regime)
    found = loop_stability(np.where(tangent.trusted[:, None, None], tangent.matrix / kn, np.nan))
    with np.errstate(divide="ignore", invalid="ignore"):
        mobilised = np.abs(graph.shear_force) / (np.asarray(law.mu) * graph.normal_force)
    d = np.roll(graph.x, -1, axis=1) - graph.x
    after = np.roll(d, -1, axis=1)
    return pd.DataFrame({
        "order": graph.grain_count,
        "elongation": polygon_shape(graph.x)[0],
        "mobilisation": np.clip(np.nan_to_num(mobilised), 0.0, 1.0).mean(axis=1),
        "sliding": np.count_nonzero(graph.regime == Regime.SLIDING, axis=1),
        "convex": (d[..., 0] * after[..., 1] > d[..., 1] * after[..., 0]).all(axis=1),
        "lambda_min": found.eigenvalues[:, 0],
    })  # fmt: skip


def real_loops(snapshots: Sequence[Snapshot]) -> pd.DataFrame:
    """Measures of the loops of snapshots."""
    parts = []
    for snapshot in snapshots:
        law, regime = snapshot.mechanics()
        for batch in loop_batches(snapshot.graph.replace(regime=regime), snapshot.faces):
            parts.append(measures(batch.graph, law.take(batch.contacts), snapshot.mean_kn))
    return pd.concat(parts, ignore_index=True)


def ranked(real: pd.DataFrame, random: pd.DataFrame) -> pd.DataFrame:
    """The real loops with their `rank` in [0, 1] by the smallest eigenvalue, nan without match.

    Ties count half.
    """
    real, alike = real.assign(rank=np.nan), ["order", "sliding", "convex"]
    for key, own in real.groupby(alike):
        like = random[(random[alike] == list(key)).all(axis=1)]
        like = like[np.isfinite(like.lambda_min)]
        if len(like) < NEIGHBOURS:
            continue
        tree, at = (np.column_stack([np.log(t.elongation), t.mobilisation]) for t in (like, own))
        distance, near = cKDTree(tree).query(at, NEIGHBOURS)
        values, here = like.lambda_min.to_numpy()[near], own.lambda_min.to_numpy()[:, None]
        rank = ((values < here) + 0.5 * (values == here)).mean(axis=1)
        good = (distance[:, -1] <= NEAR_SHAPES) & np.isfinite(here[:, 0])
        real.loc[own.index, "rank"] = np.where(good, rank, np.nan)
    return real


def order_medians(
    real: pd.DataFrame, random: pd.DataFrame, rng: np.random.Generator
) -> pd.DataFrame:
    """By order: medians and shares of both, ranks with 95 % intervals by resampling."""
    rows = []
    for order, own in real.groupby("order"):
        rank = own["rank"].dropna().to_numpy()
        if len(rank) < FEWEST_RANKS:
            continue
        means = rng.choice(rank, (RESAMPLES, len(rank))).mean(axis=1)
        row: dict[str, Any] = {"order": order, "matched": len(rank), "rank": rank.mean()}
        row |= {"below_5": (rank < 0.05).mean(), "above_95": (rank > 0.95).mean()}
        row |= dict(zip(("rank_low", "rank_high"), np.quantile(means, [0.025, 0.975]), strict=True))
        for name, some in {"real": own, "random": random[random.order == order]}.items():
            row |= {name: len(some), f"{name}_lambda": some.lambda_min.median(),
                    f"{name}_negative": (some.lambda_min < 0.0).mean(),
                    f"{name}_convex": some.convex.mean()}  # fmt: skip
        rows.append(row)
    return pd.DataFrame(rows)


@styled()
def draw(table: pd.DataFrame) -> Figure:
    """Median smallest eigenvalues, mean ranks of real loops and shares of convex ones by order."""
    figure, ((smallest, mean, convex),) = new_panels(1, 3, 2.9)
    for name, colour in (("random", BLUE), ("real", VERMILION)):
        look: Any = {"marker": "o", "linestyle": "none", "color": colour, "label": name}
        smallest.plot(table.order, table[f"{name}_lambda"], **look)
        convex.plot(table.order, table[f"{name}_convex"], **look)
    away = table["rank"] - table.rank_low, table.rank_high - table["rank"]
    mean.errorbar(table.order, table["rank"], away, fmt="o", color=VERMILION)
    mean.axhline(0.5, color=BLACK, linewidth=0.5)
    smallest.set(xlabel="order $n$ (–)", ylabel=r"median $\lambda_{\min}(K_s)/k_n$ (–)")
    mean.set(xlabel="order $n$ (–)", ylabel="mean rank (–), 95 % interval", ylim=(0.0, 1.0))
    convex.set(xlabel="order $n$ (–)", ylabel="share of convex loops (–)", ylim=(0.0, 1.05))
    figure_key(figure, smallest, ncols=2)
    return figure


def main(out: Path, *paths: Path, loops: int = LOOPS) -> dict[str, Any]:
    """Draw the ensembles, rank the real loops, and write table and figure."""
    snapshots = [read(path) for path in paths]
    snapshots = snapshots or [read_snapshot(sample_path(), cell=sample_cell())]
    rng, law, kn = np.random.default_rng(SEED), snapshots[0].mechanics()[0], snapshots[0].mean_kn
    assert isinstance(law, LinearFrictional)
    own = LinearFrictional(1.0, float(np.mean(law.kt)) / kn, float(np.max(law.mu)))
    radii = np.concatenate([snapshot.graph.radii for snapshot in snapshots])
    sizes = float(np.ptp(radii) / (radii.max() + radii.min()))
    drawn = [random_loops(rng, n, loops // len(ORDERS), sizes, own)[0] for n in ORDERS]
    random = pd.concat([measures(graph, own, 1.0) for graph in drawn], ignore_index=True)
    real = ranked(real_loops(snapshots), random)
    table = order_medians(real, random, rng)
    numbers = {"seed": SEED, "random": len(random), "real": len(real)}
    numbers |= {"matched": int(real["rank"].notna().sum()), "by_order": table.to_dict("records")}
    return save(out, "loop_ensembles", draw(table), numbers, table)


if __name__ == "__main__":
    run_example(main, "[SNAPSHOT ...]")
