"""Do loops of real packings split and merge in detailed balance?

From a collection of Yade samples (the folder of the tests on a collection), with errors from
packing to packing: every transition `m + n <-> m + n - 2` with its excess of mergers, the orders
that the rates lead to, and the orders of neighbours (Wanjura et al., arXiv 2404.05059; Sun et al.,
2105.01355), at the start of the shear and beyond.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from loops import OrderKinetics, find_faces, loop_fates, match_contacts, order_kinetics
from loops.arrays import Floats, Integers
from loops.kinetics import OrderEvents, order_events, order_neighbours, over_packings
from studies.examples import YADE_SAMPLES, read, run_example, save
from studies.style import BLACK, BLUE, GREY, VERMILION, new_panels, styled

# Intervals that begin at an axial strain below START_STRAIN, and those beyond.
STRETCHES = "start", "beyond"
START_STRAIN = 1.95e-3
LOOKS = dict(zip(STRETCHES, ((BLUE, "o"), (VERMILION, "s")), strict=True))
LAST_ORDER = 10
FEWEST_EVENTS = 10
ORDERS = np.arange(3, LAST_ORDER + 1)
Given = tuple[list[OrderEvents], list[float]]


class SampleIntervals(NamedTuple):
    """Intervals of a sample by stretch, their shear strains; neighbours by order, all snapshots."""

    events: dict[str, list[OrderEvents]]
    strains: dict[str, list[float]]
    neighbours: Floats


def intervals_of(folder: Path) -> SampleIntervals:
    """Return the events of a sample between successive snapshots."""
    macro = pd.read_csv(folder / "macro.csv").set_index("snap")
    sheared = 0.5 * (macro.eps_y_eng - macro.eps_x_eng + macro.get("gamma", 0.0))
    events: dict[str, list[OrderEvents]] = {name: [] for name in STRETCHES}
    strains: dict[str, list[float]] = {name: [] for name in STRETCHES}
    neighbours, before = np.zeros((LAST_ORDER + 1,) * 2), None
    for path in sorted(folder.glob("grains_??.*")):
        number, state = int(path.name[7:9]), read(path)
        faces = find_faces(state.graph)
        counts = order_neighbours(faces)[: LAST_ORDER + 1, : LAST_ORDER + 1]
        neighbours[: len(counts), : len(counts)] += counts
        if before is not None:
            match = match_contacts(before[1].graph, before[1].ids, state.graph, state.ids)
            name = STRETCHES[int(macro.eps_y_eng[before[0]] > START_STRAIN)]
            events[name].append(order_events(loop_fates(match, before[2], faces)))
            strains[name].append(abs(sheared[number] - sheared[before[0]]))
        before = number, state, faces
    return SampleIntervals(events, strains, neighbours)


def short(packings: list[Given]) -> list[Given]:
    """Return the packings with intervals short enough for rates, and these alone.

    In them at most half as many loops went through several events as through one.
    """
    kept = []
    for events, strains in packings:
        rows = [k for k, one in enumerate(events) if 2 * one.several <= one.once]
        if rows:
            kept.append(([events[k] for k in rows], [strains[k] for k in rows]))
    return kept


def rates(found: OrderKinetics) -> Floats:
    """Return the rates (2, orders) of splits and of mergers."""
    table = found.by_order()
    return np.stack([_of_orders(table[f"{kind}_rate"]) for kind in ("split", "merger")])


def steady(found: OrderKinetics) -> Floats:
    """Return the shares (2, orders) of the loops, observed, and less those that the rates imply."""
    observed = _of_orders(found.loops / found.loops.sum())
    return np.stack([observed, _of_orders(found.steady().share) - observed])


def excess(found: OrderKinetics, pairs: Integers) -> Floats:
    """Return the excess (P,) of mergers over splits of some pairs of orders."""
    known = pd.Series(found.columns()["balance_excess"], [*map(tuple, found.pairs.tolist())])
    return known.reindex([*map(tuple, pairs.tolist())]).to_numpy(float)


def _of_orders(values: Floats) -> Floats:
    return np.pad(values, (0, LAST_ORDER + 1), constant_values=np.nan)[ORDERS]


def transitions(packings: list[Given]) -> tuple[pd.DataFrame, OrderKinetics]:
    """Return pairs of orders of ten events and more, with both errors, and the whole kinetics."""
    events, strains = ([one for part in column for one in part]
                       for column in zip(*packings, strict=True))  # fmt: skip
    whole = order_kinetics(events, strains)
    table = pd.DataFrame(whole.columns())
    table = table[table.openings + table.closings >= FEWEST_EVENTS].reset_index(drop=True)
    pairs = table[["order_1", "order_2"]].to_numpy()
    table["error_by_packing"] = over_packings(packings, lambda found: excess(found, pairs))[1]
    return table, whole


def likeness(packings: list[SampleIntervals]) -> tuple[Floats, Floats]:
    """Return `P(n | m)/P(n)` (orders, orders) of neighbours, mean of packings, and its error."""
    ratios = []
    for one in packings:
        counts = one.neighbours[3:, 3:]
        share = counts / counts.sum(axis=1, keepdims=True)
        ratios.append(share / (counts.sum(axis=0) / counts.sum()))
    return np.mean(ratios, axis=0), np.std(ratios, axis=0, ddof=1) / np.sqrt(len(ratios))


@styled()
def draw(given: dict[str, list[Given]], pairs: dict[str, pd.DataFrame]) -> Figure:
    """Draw rates by order, the excess of each transition, steady beside observed orders."""
    figure, ((rate, balance, orders),) = new_panels(1, 3, 3.2)
    every = pd.concat(pairs.values())
    kinds = sorted(set(zip(every.order_1, every.order_2, strict=True)))
    for shift, (name, (colour, marker)) in zip((-0.12, 0.12), LOOKS.items(), strict=True):
        look = {"fmt": marker, "color": colour, "markersize": 3.5}
        means, errors = over_packings(short(given[name]), rates)
        rate.errorbar(ORDERS + shift, means[0], errors[0], label=f"splits, {name}", **look)
        label = f"mergers, {name}"
        rate.errorbar(ORDERS + shift, means[1], errors[1], mfc="white", label=label, **look)
        rows = pairs[name]
        at = shift + np.array([*map(kinds.index, zip(rows.order_1, rows.order_2, strict=True))])
        balance.errorbar(at, rows.balance_excess, rows.error_by_packing, label=name, **look)
    (observed, apart), (error, error_apart) = over_packings(given[STRETCHES[1]], steady)
    orders.errorbar(ORDERS - 0.12, observed, error, fmt="o", color=BLACK, label="observed, beyond")
    orders.errorbar(ORDERS + 0.12, observed + apart, error_apart, fmt="s", label="steady, beyond")
    rate.set(xlabel="loop order", ylabel="rate per loop and strain", yscale="log", ylim=(0.1, 5e3))
    balance.axhline(0.0, color=GREY, linewidth=0.8)
    balance.set_xticks(range(len(kinds)), [f"{m}+{n}" for m, n in kinds], rotation=60)
    balance.set(xlabel="orders that merge", ylabel="excess of mergers over splits")
    orders.set(xlabel="loop order", ylabel="share of the loops", yscale="log", ylim=(1e-3, 1.0))
    for axes in (rate, balance, orders):
        axes.legend()
    return figure


def main(out: Path, collection: Path) -> dict[str, Any]:
    """Measure the kinetics; write tables, numbers and the figure."""
    samples = [intervals_of(collection / name) for name in YADE_SAMPLES]
    given = {name: [(sample.events[name], sample.strains[name]) for sample in samples]
             for name in STRETCHES}  # fmt: skip
    given[STRETCHES[0]] = short(given[STRETCHES[0]])
    numbers, pairs = dict[str, Any](), dict[str, pd.DataFrame]()
    for name, packings in given.items():
        pairs[name], whole = transitions(packings)
        balance = whole.balance()
        numbers[name] = {
            "intervals": [len(events) for events, _ in packings],
            "once_several": [whole.once, whole.several],
            "mergers_splits": [int(whole.opened.sum()), int(whole.closed.sum())],
            "chi2": [balance.chi2, balance.pairs, balance.p_all],
        }
    numbers["steady"] = [values.tolist() for values in over_packings(given["beyond"], steady)]
    numbers["same_neighbours"] = [np.diag(values)[:4].tolist() for values in likeness(samples)]
    table = pd.concat([rows.assign(stretch=name) for name, rows in pairs.items()])
    return save(out, "cells", draw(given, pairs), numbers, table, units="1/strain")


if __name__ == "__main__":
    run_example(main, "COLLECTION")
