"""Do loops of real packings split and merge in detailed balance, and are their quadrons alike?

From a collection of Yade samples (the folder of the tests on a collection). Kinetics: two stretches
of a slow compression, with intervals short enough for rates; every transition `m + n <-> m + n - 2`
with its excess of mergers over splits (Wanjura et al., arXiv 2404.05059; Sun et al., 2105.01355),
and the orders that the rates lead to. Errors are Poisson's: one packing has such a series. Quadrons
(Matsushima and Blumenfeld, arXiv 1207.2988): areas over their mean by the order of the loop, with
errors from packing to packing.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from loops import OrderKinetics, find_faces, loop_fates, match_contacts, order_kinetics
from loops.arrays import Floats
from patterns import Snapshot, planar, read_snapshot
from studies.examples import run_example, save
from studies.output import Columns
from studies.reading import cell_reader
from studies.snapshot.quadrons import BINS, DRAWN_ORDERS, densities, quadron_columns
from studies.style import BLACK, BLUE, GREY, ORDER_COLOURS, VERMILION, new_panels, styled

# Snapshots of the slow sample: strains of 2e-5 and of 1e-4 apart.
STRETCHES = {"2e-5 apart": range(2, 23), "1e-4 apart": range(22, 33)}
LOOKS = {"2e-5 apart": (BLUE, "o"), "1e-4 apart": (VERMILION, "s")}
SAMPLES = "yade-small", "yade-medium", "yade-periodic", "yade-slow"
LAST_ORDER = 10
FEWEST_EVENTS = 5


def read(path: Path) -> Snapshot:
    """Return a snapshot, its cell from the table `macro.csv` beside it where it has one."""
    macro = path.parent / "macro.csv"
    periodic = "h_xx" in macro.read_text().split("\n", 1)[0]
    cell = np.reshape(cell_reader(macro)(path, None), (2, 2)) if periodic else None
    return planar(read_snapshot(path, cell=cell))


def kinetics(folder: Path, numbers: range) -> OrderKinetics:
    """Return the kinetics of a stretch of the slow sample, over its accumulated shear strain."""
    macro = pd.read_csv(folder / "macro.csv").set_index("snap")
    strain = 0.5 * (macro.eps_y_eng - macro.eps_x_eng)
    fates, before = [], read(folder / f"grains_{numbers[0]:02d}.parquet")
    for number in numbers[1:]:
        after = read(folder / f"grains_{number:02d}.parquet")
        match = match_contacts(before.graph, before.ids, after.graph, after.ids)
        fates.append(loop_fates(match, find_faces(before.graph), find_faces(after.graph)))
        before = after
    return order_kinetics(fates, np.diff(strain.loc[list(numbers)].to_numpy()))


def quadrons_of(folder: Path) -> Columns:
    """Return the quadrons of all snapshots of a sample, each over its own mean."""
    parts = [quadron_columns(read(path)) for path in sorted(folder.glob("grains_??.*"))]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def means(tables: dict[str, Columns]) -> tuple[dict[int, Floats], pd.DataFrame]:
    """Return densities (samples, bins) by order, and mean areas by order with their errors."""
    found = [densities(one["relative_area"], one["order"]) for one in tables.values()]
    rows = []
    for n in range(DRAWN_ORDERS[0], LAST_ORDER + 1):
        own = [one["relative_area"][one["order"] == n].mean() for one in tables.values()]
        error = np.std(own, ddof=1) / np.sqrt(len(own))
        rows.append({"order": n, "mean_area": np.mean(own), "error": error})
    return {n: np.array([one[n] for one in found]) for n in found[0]}, pd.DataFrame(rows)


@styled()
def draw_kinetics(found: dict[str, OrderKinetics]) -> Figure:
    """Draw rates by order, the excess of each transition, and steady beside observed orders."""
    figure, ((rates, excess, orders),) = new_panels(1, 3, 3.2)
    tables = {name: pd.DataFrame(one.table()) for name, one in found.items()}
    both = pd.concat(tables.values())
    seen = both[both.openings + both.closings >= FEWEST_EVENTS]
    kinds = sorted({(int(m), int(n)) for m, n in zip(seen.order_1, seen.order_2, strict=True)})
    order = np.arange(3, LAST_ORDER + 1)
    for shift, (name, one) in zip((-0.12, 0.12), found.items(), strict=True):
        colour, marker = LOOKS[name]
        how: Any = {"fmt": marker, "color": colour, "markersize": 3.5, "elinewidth": 0.7}
        table, pairs, steady = one.by_order(), tables[name], one.steady()
        for kind, fill in (("split", colour), ("merger", "white")):
            rate, low, high = (table[f"{kind}_rate{end}"][order] for end in ("", "_low", "_high"))
            known = rate > 0
            limits = np.array([rate - low, high - rate])[:, known]
            label = f"{kind}s, {name}"
            at = (order + shift)[known]
            rates.errorbar(at, rate[known], limits, mfc=fill, label=label, **how)
        rows = pairs[[pair in kinds for pair in zip(pairs.order_1, pairs.order_2, strict=True)]]
        place = [kinds.index((m, n)) for m, n in zip(rows.order_1, rows.order_2, strict=True)]
        excess.errorbar(np.array(place) + shift, rows.balance_excess, rows.balance_error, **how)
        observed = (one.loops / one.loops.sum())[order]
        label = f"observed, {name}"
        orders.plot(order + shift, observed, "_", color=colour, markersize=8, label=label)
        orders.errorbar(order + shift, steady.share[order], steady.error[order], **how)
    rates.set(xlabel="loop order", ylabel="rate per loop and shear strain", yscale="log")
    excess.axhline(0.0, color=GREY, linewidth=0.8)
    excess.set_xticks(range(len(kinds)), [f"{m}+{n}" for m, n in kinds], rotation=60)
    excess.set(xlabel="orders that merge", ylabel="excess of mergers over splits")
    orders.set(xlabel="loop order", ylabel="share of the loops, steady", yscale="log")
    orders.set_ylim(1e-3, 1.0)
    (marks, names), (more, others) = (a.get_legend_handles_labels() for a in (rates, orders))
    figure.legend(marks + more, names + others, loc="outside lower center", ncols=3)
    return figure


@styled()
def draw_quadrons(parts: dict[int, Floats], by_order: pd.DataFrame) -> Figure:
    """Draw the density of the areas over the mean, by order, and the mean areas of the orders."""
    figure, ((left, right),) = new_panels(1, 2, 2.9)
    middle = 0.5 * (BINS[:-1] + BINS[1:])
    for n, values in parts.items():
        mean, error = values.mean(axis=0), values.std(axis=0, ddof=1) / np.sqrt(len(values))
        shown = mean > 0
        colour = BLACK if n == 0 else ORDER_COLOURS[n - DRAWN_ORDERS[0]]
        label = "all" if n == 0 else f"order {n}{'+' if n == DRAWN_ORDERS[-1] else ''}"
        left.errorbar(middle[shown], mean[shown], error[shown], color=colour, elinewidth=0.6,
                      linewidth=1.0, label=label)  # fmt: skip
    left.set(yscale="log", xlabel="area of a quadron over the mean", ylabel="density")
    left.set_ylim(bottom=1e-3)
    left.legend(ncols=2)
    right.errorbar(by_order.order, by_order.mean_area, by_order.error, fmt="o", color=BLACK)
    right.axhline(1.0, color=GREY, linewidth=0.8)
    right.set(xlabel="loop order", ylabel="mean area over that of all")
    return figure


def main(out: Path, collection: Path) -> dict[str, Any]:
    """Measure kinetics and quadrons; write tables, numbers and both figures."""
    found = {name: kinetics(collection / "yade-slow", s) for name, s in STRETCHES.items()}
    tables = {name: quadrons_of(collection / name) for name in SAMPLES}
    parts, by_order = means(tables)
    pairs = pd.concat(
        [pd.DataFrame(one.table()).assign(stretch=name) for name, one in found.items()]
    )
    balance = {name: one.balance() for name, one in found.items()}
    numbers = {
        "chi2": {name: [one.chi2, one.pairs, one.p_all] for name, one in balance.items()},
        "cycles": {
            name: [one.cycles_chi2, one.cycles, one.p_cycles] for name, one in balance.items()
        },
        "variation": {name: float(one["relative_area"].std()) for name, one in tables.items()},
        "quadrons": {name: len(one["area"]) for name, one in tables.items()},
    }
    drawn = draw_kinetics(found), draw_quadrons(parts, by_order)
    save(out / "kinetics", "cells_kinetics", drawn[0], numbers, pairs, units="1/strain")
    return save(out / "quadrons", "cells_quadrons", drawn[1], numbers, by_order)


if __name__ == "__main__":
    run_example(main, "COLLECTION")
