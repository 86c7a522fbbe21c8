"""Which loops flutter, and is W2 positive while they do?

Irregular loops with random forces, spins blocked. A complex pair of eigenvalues of K needs shear
forces or sliding; it comes with W2 > 0 in every direction as well, so second-order work does not
tell flutter. `assigned` forces are drawn contact by contact, as a packing may load a loop;
`balanced` ones are in equilibrium with a uniform symmetric stress.
"""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from loops import GrainGraph, LinearFrictional, Regime, macroscopic_tangent
from loops.arrays import Floats, Regimes
from loops.geometry import outward
from patterns import random_loop
from stability import flutter_pairs, operator_norm, restrict, spectrum, statuses, symmetric_spectrum
from studies.examples import run_example, save
from studies.style import LINE_COLOURS, TWO_COLUMNS, figure_key, new_figure, styled

ORDERS = (3, 4, 5, 6, 7, 8)
BALANCES = ("assigned", "balanced")
REGIMES = ("elastic", "sliding")
# Entries of K are taken as known to this: what rounding splits does not count.
UNCERTAINTY = 1e-10


def random_forces(rng: np.random.Generator, x: Floats, forces: str) -> tuple[Floats, Floats]:
    """(N, T) without or with little shear, and more of it to add in any amount."""
    size = x.shape[:-1]
    if forces == "assigned":
        N = 1.0 + 0.8 * rng.uniform(-1, 1, size)
        zero, T = np.zeros(size), N * rng.uniform(-1, 1, size)
        return np.stack([N, zero], axis=-1), np.stack([zero, T], axis=-1)
    side = np.roll(x, -1, axis=1) - x
    n = side / np.linalg.norm(side, axis=-1, keepdims=True)
    t = np.stack([-n[..., 1], n[..., 0]], axis=-1)
    m = outward(x, x + 0.5 * side - x.mean(axis=1, keepdims=True))
    a, b = rng.uniform(-1, 1, (2, len(x)))
    P = np.moveaxis(np.array([[a, b], [b, -a]]), -1, 0)
    # f_c = f^ - P m_c, under a unit pressure and under a random deviator.
    more = rng.uniform(-0.7, 0.7, (len(x), 1, 2)) - np.einsum("bij,bcj->bci", P, m)
    base, extra = (np.stack([(f * n).sum(-1), (f * t).sum(-1)], -1) for f in (-m, more))
    return base, extra


def flutter_loops(
    order: int, forces: str, contacts: str, loops: int, seed: int = 1
) -> tuple[GrainGraph, LinearFrictional, Regimes]:
    """Loops with the largest |T|/N uniform from 0.01 to 1.2, N/l log-uniform from 1e-4 to 0.5."""
    rng = np.random.default_rng([seed, order, BALANCES.index(forces), REGIMES.index(contacts)])
    drawn = random_loop(order, int(rng.integers(2**31)), polydispersity=0.3, size=loops)
    x, radii = drawn.x, drawn.radii
    (N, T), (dN, dT) = (np.moveaxis(f, -1, 0) for f in random_forces(rng, x, forces))
    friction = rng.uniform(0.01, 1.2, (loops, 1))
    # The least share of the second set that brings a contact to |T| = friction N.
    side = np.array([1.0, -1.0])[:, None, None]
    room, rate = friction * N - side * T, side * dT - friction * dN
    share = np.divide(room, rate, out=np.full_like(rate, np.inf), where=rate > 0).min(axis=(0, 2))
    kept = (room > 0).all(axis=(0, 2)) & np.isfinite(share)
    x, radii, share = x[kept], radii[kept], share[kept, None]
    N, T = N[kept] + share * dN[kept], T[kept] + share * dT[kept]
    length = np.linalg.norm(np.roll(x, -1, axis=1) - x, axis=-1)
    overlap = 10.0 ** rng.uniform(-4.0, np.log10(0.5), (len(x), 1))
    scale = overlap / (N / length).mean(axis=1, keepdims=True)
    graph = GrainGraph(x, radii, drawn.contacts, scale * N, scale * T)
    slides = rng.random(N.shape) < (rng.uniform(0.1, 1.0, (len(x), 1)) * (contacts == "sliding"))
    regime = np.where(slides, Regime.SLIDING, Regime.ELASTIC).astype(np.int8)
    kappa = rng.uniform(0.05, 1.0, (len(x), 1))
    return graph, LinearFrictional(kn=1.0, kt=kappa, mu=np.abs(T) / N), regime


def flutter_of(K: Floats) -> tuple[Floats, Any]:
    """Largest |Im|/|eigenvalue| of the complex pairs, 0 without one; whether W2 > 0 everywhere."""
    pairs, values = flutter_pairs(K, UNCERTAINTY), spectrum(K)
    ratio = np.where(pairs, np.abs(values.imag) / np.where(pairs, np.abs(values), 1.0), 0.0)
    return ratio.max(axis=-1), statuses(symmetric_spectrum(K)[:, 0], operator_norm(K)) == "stable"


def search(orders: tuple[int, ...] = ORDERS, loops: int = 4000) -> list[dict[str, Any]]:
    """Shares with flutter, and with flutter while W2 > 0, by closure, forces, contacts, order."""
    rows, closures = [], ("affine", "traction")
    for forces, contacts, order in product(BALANCES, REGIMES, orders):
        graph, law, regime = flutter_loops(order, forces, contacts, loops)
        for closure in closures:
            name: Any = closure
            A = macroscopic_tangent(graph, law, name, regime=regime).matrix
            known = np.isfinite(A).all(axis=(-2, -1))
            ratio, stable = flutter_of(restrict(A[known], "symmetric"))
            row = {"closure": closure, "forces": forces, "contacts": contacts, "order": order}
            shares = {"share": float((ratio > 0).mean()), "largest_ratio": float(ratio.max())}
            both = {"share_with_positive_W2": float(((ratio > 0) & stable).mean())}
            rows.append(row | {"loops": int(known.sum())} | shares | both)
    return rows


@styled()
def draw(rows: list[dict[str, Any]]) -> Figure:
    """Share of loops that flutter over the order; dashed: with W2 > 0 in every direction."""
    figure = new_figure(TWO_COLUMNS, 2.8)
    axes, table = figure.subplots(1, 2, sharey=True), pd.DataFrame(rows)
    for ax, (closure, both) in zip(axes, table.groupby("closure"), strict=True):
        families = both.groupby(["forces", "contacts"])
        for ((forces, contacts), own), colour in zip(families, LINE_COLOURS, strict=False):
            for key, look in (("share", "o-"), ("share_with_positive_W2", "--")):
                label = f"{forces} forces, {contacts}" if key == "share" else None
                ax.semilogy(own.order, own[key].replace(0, np.nan), look, color=colour, label=label)
        ax.set(xlabel="order", ylabel="share with flutter (dashed: W2 > 0)", title=closure)
    figure_key(figure, ncols=4)
    return figure


def main(out: Path, loops: int = 4000) -> dict[str, Any]:
    """Search every family; write the shares and the figure."""
    rows = search(loops=loops)
    table = pd.DataFrame(rows)
    with_W2 = float(np.average(table.share_with_positive_W2, weights=table.loops))
    numbers = {"operators": int(table.loops.sum()), "share_with_positive_W2": with_W2,
               "largest_ratio": float(table.largest_ratio.max())}  # fmt: skip
    return save(out, "flutter", draw(rows), numbers, table, "kn = 1")


if __name__ == "__main__":
    run_example(main)
