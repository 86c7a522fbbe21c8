"""Is a loop of a real packing a typical one among random loops of its order and shape?

Random loops: grains of the snapshots' sizes on a random closed polygon, convex or re-entrant, that
just overlap; uniform stress on the polygon, isotropic or deviatoric, and contact forces that
balance it, drawn uniformly from all that friction allows, or with one or two contacts at yield.
Each real loop is ranked among the random ones of its order and number of sliding contacts, convex
beside convex, that are next to it in elongation and mobilisation, the mean of |T|/(mu N): the rank
is uniform if it is one of them.

    python -m studies.examples.loop_ensembles DIR [--cells TABLE] [SNAPSHOT...]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from scipy.spatial import cKDTree

from loops import (
    GrainGraph,
    LinearFrictional,
    Regime,
    loop_batches,
    polygon_shape,
    traction_tangent,
)
from loops.arrays import Flags, Floats, Integers
from loops.geometry import from_centroid, outward
from loops.laws.frictional import linear_springs
from patterns import Snapshot, read_snapshot, sample_cell, sample_path
from stability.verdict import loop_stability
from studies.examples import save
from studies.output import as_json
from studies.reading import cell_reader
from studies.style import BLACK, BLUE, GREY, TWO_COLUMNS, VERMILION, new_figure, styled

ORDERS = tuple(range(3, 13))
LOOPS = 200_000
SEED = 20261123
# Deviatoric stress over the mean one, at most.
MOST_DEVIATOR = 0.6
# Passes of lengths and forces.
PASSES = 4
# Chords of a draw.
CHORDS = 6
# Spread of the turns (radians) of the rings that random loops start from, at most.
MOST_BENT = 1.3
# Their stretch, at most.
MOST_STRETCHED = 4.0
CLOSING_STEPS = 12
CENTRE_STEPS = 60
# Random loops that a real one is ranked among.
NEIGHBOURS = 100
# How far off they may be: natural logarithm of the elongation and mobilisation.
NEAR_SHAPES = 0.15
RESAMPLES = 400
# Loops of a bin that is drawn, at least.
FEWEST_DRAWN = 100
# Order whose shapes are compared.
SHOWN_ORDER = 5


class Draw(NamedTuple):
    """Random loops of one order n: state (batch axis L), stress (L, 2, 2), sliding contacts."""

    graph: GrainGraph
    stress: Floats
    sliding: Floats


def random_rings(
    rng: np.random.Generator, lengths: Floats, headings: Floats | None = None
) -> Floats:
    """(L, n, 2) centres of rings with these branch lengths; nan where none closes.

    Headings of the branches are turned by the least that closes the ring (Newton). Half of the
    rings start from positive turns at the corners (a Dirichlet draw), half from turns of any sign,
    and all are stretched first.
    """
    count, order = lengths.shape
    if headings is None:
        evenness = np.exp(rng.uniform(-1.0, 4.0, count))[:, None]
        turns = rng.standard_gamma(np.broadcast_to(evenness, lengths.shape))
        turns *= 2.0 * np.pi / turns.sum(axis=1, keepdims=True)
        bent = 2.0 * np.pi / order + rng.uniform(0.0, MOST_BENT, (count, 1)) * rng.normal(
            size=turns.shape
        )
        bent += (2.0 * np.pi - bent.sum(axis=1, keepdims=True)) / order
        turns = np.where((np.arange(count) % 2 == 0)[:, None], turns, bent)
        headings = np.cumsum(turns, axis=1) + rng.uniform(0.0, 2.0 * np.pi, (count, 1))
        stretch = np.exp(rng.uniform(0.0, np.log(MOST_STRETCHED), (count, 1)))
        headings = np.arctan2(np.sin(headings), stretch * np.cos(headings))
    for _ in range(CLOSING_STEPS):
        c, s = np.cos(headings), np.sin(headings)
        slope = np.stack([-lengths * s, lengths * c], axis=1)
        gap = np.stack([(lengths * c).sum(axis=1), (lengths * s).sum(axis=1)], axis=1)
        normal = slope @ slope.swapaxes(1, 2) + 1e-12 * np.eye(2)
        headings = (
            headings - (slope.swapaxes(1, 2) @ np.linalg.solve(normal, gap[..., None]))[..., 0]
        )
    d = lengths[..., None] * np.stack([np.cos(headings), np.sin(headings)], axis=-1)
    closed = np.abs(d.sum(axis=1)).max(axis=1) < 1e-12 * lengths.sum(axis=1)
    return np.where(closed[:, None, None], np.cumsum(d, axis=1) - d, np.nan)


def exterior_angles(x: Floats) -> Floats:
    """(L, n) turns at the corners, in (-pi, pi]."""
    d = np.roll(x, -1, axis=1) - x
    before = np.roll(d, 1, axis=1)
    cross = before[..., 0] * d[..., 1] - before[..., 1] * d[..., 0]
    return np.arctan2(cross, (before * d).sum(axis=-1))


def is_loop(x: Floats, radii: Floats) -> Flags:
    """(L,) whether a ring turns once, counter-clockwise, and no grains but neighbours overlap."""
    order = x.shape[1]
    turns = np.abs(exterior_angles(np.nan_to_num(x)).sum(axis=1) - 2.0 * np.pi) < 1e-6
    good = np.isfinite(x).all(axis=(1, 2)) & turns
    i, j = np.triu_indices(order, 2)
    apart = (i > 0) | (j < order - 1)
    i, j = i[apart], j[apart]
    gap = np.linalg.norm(x[:, i] - x[:, j], axis=-1) - radii[:, i] - radii[:, j]
    return good & (np.nan_to_num(gap, nan=-1.0) >= 0.0).all(axis=1)


def friction_limits(x: Floats, stress: Floats, mu: float) -> tuple[Floats, Floats, Floats]:
    """Contact forces `f = f^ - P m` (L, n, 2) at `f^ = 0`, and `g = a + B f^ >= 0` within friction.

    `a` (L, 2 n) and `B` (L, 2 n, 2): `mu N - T`, then `mu N + T`.
    """
    centred = from_centroid(x)
    m = outward(x, 0.5 * (centred + np.roll(centred, -1, axis=1)))
    force = -np.einsum("lij,lnj->lni", stress, m)
    d = np.roll(x, -1, axis=1) - x
    n = d / np.linalg.norm(d, axis=-1, keepdims=True)
    t = np.stack([-n[..., 1], n[..., 0]], axis=-1)
    B = np.concatenate([mu * n - t, mu * n + t], axis=1)
    return force, (B * np.concatenate([force, force], axis=1)).sum(axis=-1), B


def chord(f: Floats, a: Floats, B: Floats, direction: Floats) -> tuple[Floats, Floats, Floats]:
    """Ends of the chord through `f` within the limits, lengths along `direction`; the limit."""
    g, rate = a + (B @ f[..., None])[..., 0], (B @ direction[..., None])[..., 0]
    with np.errstate(divide="ignore"):
        to = -g / rate
    high = np.where(rate < 0.0, to, np.inf)
    return np.where(rate > 0.0, to, -np.inf).max(axis=1), high.min(axis=1), high.argmin(axis=1)


def balanced_forces(
    rng: np.random.Generator, a: Floats, B: Floats, wanted: Integers
) -> tuple[Floats, Flags, Flags]:
    """Redundant forces `f^` (L, 2) within friction, contacts that slide (L, n), and which exist.

    Uniform by hit and run from the point that the limits are farthest from (subgradients); where
    sliding is `wanted`, on to the limit along one more direction, and along it to the next one.
    """
    count, n = len(a), a.shape[1] // 2
    every, size = np.arange(count), np.abs(a).mean(axis=1)
    f = np.zeros((count, 2))
    best, best_g = f, np.full(count, -np.inf)
    for k in range(CENTRE_STEPS):
        g = a + (B @ f[..., None])[..., 0]
        worst = g.argmin(axis=1)
        better = g[every, worst] > best_g
        best, best_g = np.where(better[:, None], f, best), np.maximum(g[every, worst], best_g)
        f = f + (size / (1.0 + 0.3 * k))[:, None] * B[every, worst]
    good = best_g > 1e-6 * size
    f, sliding = best, np.zeros((count, n), dtype=bool)
    for _ in range(CHORDS):
        angle = rng.uniform(0.0, 2.0 * np.pi, count)
        direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        low, high, _ = chord(f, a, B, direction)
        f = (
            f
            + np.where(good, rng.uniform(size=count) * (high - low) + low, 0.0)[:, None] * direction
        )
    angle = rng.uniform(0.0, 2.0 * np.pi, count)
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for step in (1, 2):
        go = good & (wanted >= step)
        _, high, limit = chord(f, a, B, direction)
        f = f + np.where(go, high, 0.0)[:, None] * direction
        sliding[every[go], limit[go] % n] = True
        # Along the limit just reached, to one side of it; it takes no further part.
        row = B[every, limit]
        side = rng.choice([-1.0, 1.0], count)[:, None]
        turned = side * np.stack([-row[:, 1], row[:, 0]], axis=1)
        direction = turned / np.linalg.norm(turned, axis=1, keepdims=True)
        a, B = a.copy(), B.copy()
        a[every[go], limit[go]], B[every[go], limit[go]] = np.inf, 0.0
    return f, sliding, good & np.isfinite(f).all(axis=1)


def random_loops(
    rng: np.random.Generator, order: int, count: int, radii: Floats, law: LinearFrictional,
    overlap: float, deviator: float,
) -> Draw:  # fmt: skip
    """Random loops in balance under uniform stress.

    `radii` are drawn from, `overlap` is the mean overlap over the mean diameter, `deviator` the
    largest half difference of the principal stresses over their mean.
    """
    parts, left, tries = [], count, 0
    c = np.arange(order)
    while left > 0 and tries < 200:
        tries += 1
        size = min(2 * left + 64, 20_000)
        r = rng.choice(radii, (size, order))
        touching = r + np.roll(r, -1, axis=1)
        x = random_rings(rng, touching)
        x, r, touching = (each[is_loop(x, r)] for each in (x, r, touching))
        share, turn = rng.uniform(0.0, deviator, len(x)), rng.uniform(0.0, np.pi, len(x))
        half = np.stack([np.cos(2 * turn), np.sin(2 * turn)])
        stress = np.eye(2) + share[:, None, None] * np.moveaxis(
            np.array([[half[0], half[1]], [half[1], -half[0]]]), -1, 0
        )
        wanted, seed = rng.integers(0, 3, len(x)), int(rng.integers(2**62))
        good = np.ones(len(x), dtype=bool)
        for _ in range(PASSES):
            force, a, B = friction_limits(x, stress, float(law.mu))
            # The same draw in each pass: overlaps change lengths by a thousandth.
            f, slides, good = balanced_forces(np.random.default_rng(seed), a, B, wanted)
            force = force + f[:, None]
            d = np.roll(x, -1, axis=1) - x
            n = d / np.linalg.norm(d, axis=-1, keepdims=True)
            N = (force * n).sum(axis=-1)
            scale = float(law.kn) * overlap * touching.mean(axis=1) / np.abs(N).mean(axis=1)
            lengths = touching - N * scale[:, None] / float(law.kn)
            x = random_rings(rng, lengths, np.arctan2(d[..., 1], d[..., 0]))
            good &= np.isfinite(x).all(axis=(1, 2))
        T = (force * np.stack([-n[..., 1], n[..., 0]], axis=-1)).sum(axis=-1)
        kept = np.flatnonzero(good & is_loop(x, r))[:left]
        parts.append((x[kept], r[kept], (N * scale[:, None])[kept], (T * scale[:, None])[kept],
                      slides[kept], stress[kept] * scale[kept, None, None]))  # fmt: skip
        left -= len(kept)
    x, r, N, T, slides, stress = (np.concatenate(each) for each in zip(*parts, strict=True))
    graph = GrainGraph(
        x=x, radii=r, contacts=np.column_stack([c, (c + 1) % order]), normal_force=N, shear_force=T,
        regime=np.where(slides, Regime.SLIDING, Regime.ELASTIC).astype(np.int8),
    )  # fmt: skip
    return Draw(graph, stress, slides.sum(axis=1))


def measures(graph: GrainGraph, law: Any, kn: float, mu: Any) -> dict[str, Floats]:
    """Shape, mobilisation and stability of loops: traction closure, spins blocked."""
    tangent = traction_tangent(graph, law, regime=graph.regime)
    found = loop_stability(np.where(tangent.trusted[:, None, None], tangent.matrix / kn, np.nan))
    with np.errstate(divide="ignore", invalid="ignore"):
        mobilised = np.abs(graph.shear_force) / (mu * graph.normal_force)
    assert graph.regime is not None
    return {
        "elongation": polygon_shape(graph.x)[0],
        "mobilisation": np.clip(np.nan_to_num(mobilised), 0.0, 1.0).mean(axis=1),
        "sliding": np.count_nonzero(graph.regime == Regime.SLIDING, axis=1),
        "convex": (exterior_angles(graph.x) > 0.0).all(axis=1),
        "lambda_min": found.eigenvalues[:, 0],
        "unstable": found.unstable_fraction,
    }


def real_loops(snapshots: Sequence[Snapshot]) -> pd.DataFrame:
    """Measures of the loops of snapshots, by `order`; `sample` counts the snapshots."""
    parts = []
    for sample, snapshot in enumerate(snapshots):
        law, regime = snapshot.mechanics()
        graph = snapshot.graph.replace(regime=regime)
        for batch in loop_batches(graph, snapshot.faces):
            own = law.take(batch.contacts)
            found = measures(batch.graph, own, snapshot.mean_kn, np.asarray(own.mu))
            parts.append(pd.DataFrame(found).assign(order=batch.grains.shape[1], sample=sample))
    return pd.concat(parts, ignore_index=True)


def ranked(real: pd.DataFrame, random: pd.DataFrame) -> pd.DataFrame:
    """The real loops with their ranks `rank_lambda`, `rank_unstable` in [0, 1], nan without match.

    Ties count half.
    """
    real = real.assign(rank_lambda=np.nan, rank_unstable=np.nan)
    places = {"rank_lambda": "lambda_min", "rank_unstable": "unstable"}
    alike = ["order", "sliding", "convex"]
    for key, own in real.groupby(alike):
        like = random[(random[alike] == list(key)).all(axis=1)]
        like = like[np.isfinite(like.lambda_min)]
        if len(like) < NEIGHBOURS:
            continue
        tree, at = (np.column_stack([np.log(t.elongation), t.mobilisation]) for t in (like, own))
        distance, near = cKDTree(tree).query(at, NEIGHBOURS)
        good = (distance[:, -1] <= NEAR_SHAPES) & np.isfinite(own.lambda_min.to_numpy())
        for name, column in places.items():
            values, here = like[column].to_numpy()[near], own[column].to_numpy()[:, None]
            rank = ((values < here) + 0.5 * (values == here)).mean(axis=1)
            real.loc[own.index, name] = np.where(good, rank, np.nan)
    return real


def order_medians(
    real: pd.DataFrame, random: pd.DataFrame, rng: np.random.Generator
) -> pd.DataFrame:
    """By order: medians and unstable shares of both, ranks with 95 % intervals by resampling."""
    rows: list[dict[str, Any]] = []
    for order, own in real.groupby("order"):
        like, matched = random[random.order == order], own.dropna(subset="rank_lambda")
        if len(like) == 0 or len(matched) < 20:
            continue
        rank = matched.rank_lambda.to_numpy()
        means = rng.choice(rank, (RESAMPLES, len(rank))).mean(axis=1)
        rows.append({
            "order": order, "real": len(own), "random": len(like), "matched": len(matched),
            "real_lambda": own.lambda_min.median(), "random_lambda": like.lambda_min.median(),
            "real_negative": (own.lambda_min < 0.0).mean(),
            "random_negative": (like.lambda_min < 0.0).mean(),
            "real_unstable": own.unstable.mean(), "random_unstable": like.unstable.mean(),
            "rank": rank.mean(), "rank_low": np.quantile(means, 0.025),
            "rank_high": np.quantile(means, 0.975),
            "real_convex": own.convex.mean(), "random_convex": like.convex.mean(),
            "below_5": (rank < 0.05).mean(), "above_95": (rank > 0.95).mean(),
        })  # fmt: skip
    columns = ["order"] if not rows else list(rows[0])
    return pd.DataFrame(rows, columns=columns)


def ensembles(snapshots: Sequence[Snapshot], loops: int, seed: int) -> tuple[pd.DataFrame, ...]:
    """Random loops, ranked real ones, and the table by order."""
    rng, first = np.random.default_rng(seed), snapshots[0]
    kn, graph = first.mean_kn, first.graph
    law, _ = first.mechanics()
    assert linear_springs(law)
    radii = np.concatenate([s.graph.radii / s.graph.radii.mean() for s in snapshots]) / 2.0
    closed = graph.normal_force > 0.0
    overlap = float((graph.normal_force[closed] / kn).mean() / (2.0 * graph.radii.mean()))
    own = LinearFrictional(1.0, float(np.mean(law.kt)) / kn, float(np.max(law.mu)))
    parts = []
    for order in ORDERS:
        for stress, deviator in (("isotropic", 0.0), ("deviatoric", MOST_DEVIATOR)):
            count = loops // (2 * len(ORDERS))
            draw = random_loops(rng, order, count, radii, own, overlap, deviator)
            found = measures(draw.graph, own, 1.0, float(own.mu))
            parts.append(pd.DataFrame(found).assign(order=order, stress=stress))
    random = pd.concat(parts, ignore_index=True)
    real = ranked(real_loops(snapshots), random)
    return random, real, order_medians(real, random, rng)


def binned(data: pd.DataFrame, by: str, edges: Floats) -> pd.DataFrame:
    """Smallest eigenvalue (quantiles) and unstable share (mean, 95 % interval) in bins of `by`."""
    middle = 0.5 * (edges[1:] + edges[:-1])
    rows = []
    for x, (_, part) in zip(
        middle, data.groupby(pd.cut(data[by], edges), observed=False), strict=True
    ):
        if len(part) < FEWEST_DRAWN:
            continue
        low, mid, high = part.lambda_min.quantile([0.05, 0.5, 0.95])
        rows.append((x, low, mid, high, part.unstable.mean(), 1.96 * part.unstable.sem()))
    return pd.DataFrame(rows, columns=["x", "low", "mid", "high", "unstable", "error"])


@styled()
def draw(random: pd.DataFrame, real: pd.DataFrame, table: pd.DataFrame) -> Figure:
    """Smallest eigenvalue and unstable share over order and shape; ranks of real loops."""
    figure = new_figure(TWO_COLUMNS, 6.4)
    axes = figure.subplots(3, 3)
    groups = [(random[random.stress == "isotropic"], GREY, "random, isotropic", -0.2),
              (random[random.stress == "deviatoric"], BLUE, "random, deviatoric", 0.0),
              (real, VERMILION, "real", 0.2)]  # fmt: skip
    labels = {"order": "order $n$ (–)", "elongation": "elongation (–)",
              "mobilisation": r"mean of $|T|/(\mu N)$ (–)"}  # fmt: skip
    edges = {"order": np.arange(2.5, 13.0), "elongation": np.array([1.0, 1.2, 1.5, 2.0, 2.7, 4.0]),
             "mobilisation": np.linspace(0.0, 1.0, 6)}  # fmt: skip
    for (by, label), (top, below) in zip(labels.items(), axes[:2].T, strict=True):
        for data, colour, name, shift in groups:
            # Over shape and mobilisation loops of one order are compared.
            same = data if by == "order" else data[data.order == SHOWN_ORDER]
            found = binned(same, by, edges[by])
            at = found.x + shift * np.diff(edges[by]).min()
            spread = [found.mid - found.low, found.high - found.mid]
            top.errorbar(at, found.mid, spread, fmt="o", markersize=3, color=colour, label=name)
            least = found.error.clip(upper=found.unstable)
            below.errorbar(at, 1e3 * found.unstable, 1e3 * np.array([least, found.error]), fmt="o",
                           markersize=3, color=colour)  # fmt: skip
        top.set(yscale="log", xlabel=label)
        below.set(xlabel=label)
        if by != "order":
            top.set_title(f"$n$ = {SHOWN_ORDER}")
            below.set_title(f"$n$ = {SHOWN_ORDER}")
    axes[0, 0].set_ylabel(r"$\lambda_{\min}(K_s)/k_n$ (–): 5, 50, 95 %")
    axes[1, 0].set_ylabel(r"unstable directions ($10^{-3}$)")
    bins, ranks = np.linspace(0.0, 1.0, 11), axes[2, 0]
    for order, style in ((3, "-"), (4, "--"), (5, "-."), (6, ":")):
        own = real[(real.order == order)].rank_lambda.dropna()
        if len(own):
            ranks.hist(own, bins, density=True, histtype="step", linestyle=style, color=VERMILION)
            ranks.plot([], [], style, color=VERMILION, label=f"$n$ = {order}")
    ranks.axhline(1.0, color=BLACK, linewidth=0.5)
    ranks.set(xlabel=r"rank of the real loop's $\lambda_{\min}$ (–)", ylabel="density (–)")
    ranks.legend()
    mean, convex = axes[2, 1:]
    if len(table):
        spread = [table["rank"] - table.rank_low, table.rank_high - table["rank"]]
        mean.errorbar(table.order, table["rank"], spread, fmt="o", markersize=3, color=VERMILION)
        for part, colour in ((table.random_convex, BLUE), (table.real_convex, VERMILION)):
            convex.plot(table.order, part, "o", markersize=3, color=colour)
    mean.axhline(0.5, color=BLACK, linewidth=0.5)
    mean.set(xlabel="order $n$ (–)", ylabel="mean rank (–), 95 % interval", ylim=(0.0, 1.0))
    convex.set(xlabel="order $n$ (–)", ylabel="share of convex loops (–)", ylim=(0.0, 1.05))
    for axis in (*axes[:2, 0], mean, convex):
        axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def main(
    out: Path,
    paths: Sequence[Path] = (),
    loops: int = LOOPS,
    seed: int = SEED,
    cells: Path | None = None,
) -> dict[str, Any]:
    """Draw the ensembles, rank the real loops, and write table and figure."""
    if cells is not None:
        cell_of = cell_reader(cells)
        read = [(path, np.reshape(cell_of(path, None), (2, 2))) for path in paths]
        snapshots = [read_snapshot(path, cell=cell) for path, cell in read]
    elif paths:
        snapshots = [read_snapshot(path) for path in paths]
    else:
        snapshots = [read_snapshot(sample_path(), cell=sample_cell())]
    random, real, table = ensembles(snapshots, loops, seed)
    matched = int(real.rank_lambda.notna().sum())
    numbers = {"seed": seed, "random": len(random), "real": len(real), "matched": matched,
               "by_order": table.to_dict("records")}  # fmt: skip
    return save(out, "loop_ensembles", draw(random, real, table), numbers, table)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m studies.examples.loop_ensembles")
    parser.add_argument("out", type=Path, help="Folder of the results.")
    parser.add_argument("--loops", type=int, default=LOOPS, help="Number of random loops.")
    parser.add_argument("--seed", type=int, default=SEED, help="Seed of the random numbers.")
    parser.add_argument("--cells", type=Path, help="Table of periodic cells by snapshot.")
    parser.add_argument("snapshots", nargs="*", type=Path, help="Snapshots. Default: the sample.")
    asked = parser.parse_args()
    print(as_json(main(asked.out, asked.snapshots, asked.loops, asked.seed, asked.cells)))
