"""Do loops of real packings split and merge in detailed balance, and are their quadrons alike?

From a collection of Yade samples (the folder of the tests on a collection), with errors from
packing to packing. Kinetics: every transition `m + n <-> m + n - 2` with its excess of mergers,
the orders that the rates lead to, and the orders of neighbours (Wanjura et al., arXiv 2404.05059;
Sun et al., 2105.01355), at the start of the shear and beyond. Quadrons (Matsushima and Blumenfeld,
arXiv 1207.2988): areas over their mean by the order of the loop.
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
from patterns import Snapshot, planar, read_snapshot
from studies.examples import run_example, save
from studies.output import Columns
from studies.reading import cell_reader
from studies.snapshot.quadrons import DRAWN_ORDERS, densities, draw_densities, quadron_columns
from studies.style import BLACK, BLUE, GREY, ORDER_COLOURS, VERMILION, new_panels, styled

# Intervals that begin at an axial strain below START_STRAIN, and those beyond.
STRETCHES = "start", "beyond"
START_STRAIN = 1.95e-3
LOOKS = dict(zip(STRETCHES, ((BLUE, "o"), (VERMILION, "s")), strict=True))
YADE_SAMPLES = "yade-small", "yade-medium", "yade-periodic", "yade-slow"
LAST_ORDER = 10
FEWEST_EVENTS = 10
ORDERS = np.arange(3, LAST_ORDER + 1)
# Orders whose neighbours are drawn.
WITH_NEIGHBOURS = 3, 4, 5, 6
Given = tuple[list[OrderEvents], list[float]]


def read(path: Path) -> Snapshot:
    """Return a snapshot, its cell from the table `macro.csv` beside it where it has one."""
    macro = path.parent / "macro.csv"
    periodic = macro.is_file() and "h_xx" in macro.read_text().split("\n", 1)[0]
    cell = np.reshape(cell_reader(macro)(path, None), (2, 2)) if periodic else None
    return planar(read_snapshot(path, cell=cell))


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
        found = order_neighbours(faces)[: LAST_ORDER + 1, : LAST_ORDER + 1]
        neighbours[: len(found), : len(found)] += found
        if before is not None:
            match = match_contacts(before[1].graph, before[1].ids, state.graph, state.ids)
            one = order_events(loop_fates(match, before[2], faces))
            name = STRETCHES[int(macro.eps_y_eng[before[0]] > START_STRAIN)]
            events[name].append(one)
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


def quadrons_of(folder: Path) -> Columns:
    """Return the quadrons of all snapshots of a sample, each over its own mean."""
    parts = [quadron_columns(read(path)) for path in sorted(folder.glob("grains_??.*"))]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def means(tables: dict[str, Columns]) -> tuple[dict[int, Floats], pd.DataFrame]:
    """Return densities (samples, bins) by order, and mean areas by order with their errors."""
    found = [densities(one["relative_area"], one["order"]) for one in tables.values()]
    areas = pd.DataFrame([pd.Series(one["relative_area"]).groupby(one["order"]).mean()
                          for one in tables.values()])[ORDERS.tolist()]  # fmt: skip
    by_order = pd.DataFrame({"order": ORDERS, "mean_area": areas.mean().to_numpy(),
                             "error": areas.sem().to_numpy()})  # fmt: skip
    return {n: np.array([one[n] for one in found]) for n in found[0]}, by_order


@styled()
def draw_kinetics(
    given: dict[str, list[Given]], pairs: dict[str, pd.DataFrame], neighbours: tuple[Floats, Floats]
) -> Figure:
    """Draw rates by order, excess of each transition, steady beside observed orders, neighbours."""
    figure, ((rate, balance), (orders, near)) = new_panels(2, 2, 6.0)
    both = pd.concat(pairs.values())
    kinds = sorted(set(zip(both.order_1, both.order_2, strict=True)))
    for shift, (name, (colour, marker)) in zip((-0.12, 0.12), LOOKS.items(), strict=True):
        how = {"fmt": marker, "color": colour, "markersize": 3.5}
        for kind, fill, *values in zip(
            ("splits", "mergers"), (colour, "white"), *over_packings(short(given[name]), rates),
            strict=True,
        ):  # fmt: skip
            rate.errorbar(ORDERS + shift, *values, mfc=fill, label=f"{kind}, {name}", **how)
        rows = pairs[name]
        at = shift + np.array([*map(kinds.index, zip(rows.order_1, rows.order_2, strict=True))])
        balance.errorbar(at, rows.balance_excess, rows.error_by_packing, label=name, **how)
        poisson = {"fmt": "none", "ecolor": GREY, "elinewidth": 0.8}
        balance.errorbar(at + shift, rows.balance_excess, rows.balance_error, **poisson,
                         label="Poisson's error" if shift > 0 else None)  # fmt: skip
    (observed, apart), (own, error) = over_packings(given[STRETCHES[1]], steady)
    orders.errorbar(ORDERS - 0.12, observed, own, fmt="o", color=BLACK, label="observed, beyond")
    orders.errorbar(ORDERS + 0.12, observed + apart, error, fmt="s", color=VERMILION,
                    label="steady, error of the difference")  # fmt: skip
    for n in WITH_NEIGHBOURS:
        look = {"fmt": "o-", "color": ORDER_COLOURS[n - DRAWN_ORDERS[0]], "linewidth": 0.8}
        near.errorbar(ORDERS + 0.1 * (n - 4.5), *(one[n - 3] for one in neighbours), markersize=3,
                      label=f"of order {n}", **look)  # fmt: skip
    rate.set(xlabel="loop order", ylabel="rate per loop and shear strain", yscale="log")
    rate.set_ylim(0.1, 5e3)
    balance.axhline(0.0, color=GREY, linewidth=0.8)
    balance.set_xticks(range(len(kinds)), [f"{m}+{n}" for m, n in kinds], rotation=60)
    balance.set(xlabel="orders that merge", ylabel="excess of mergers over splits")
    orders.set(xlabel="loop order", ylabel="share of the loops", yscale="log", ylim=(1e-3, 1.0))
    near.axhline(1.0, color=GREY, linewidth=0.8)
    near.set(xlabel="order of the neighbour", ylabel="probability over that of any loop")
    for axes in (rate, balance, orders, near):
        axes.legend(ncols=2 if axes in (rate, near) else 1)
    return figure


@styled()
def draw_quadrons(parts: dict[int, Floats], by_order: pd.DataFrame) -> Figure:
    """Draw the density of the areas over the mean, by order, and the mean areas of the orders."""
    figure, ((left, right),) = new_panels(1, 2, 2.9)
    error = {n: one.std(axis=0, ddof=1) / np.sqrt(len(one)) for n, one in parts.items()}
    draw_densities(left, {n: one.mean(axis=0) for n, one in parts.items()}, error, linewidth=1.0)
    left.set_ylim(bottom=1e-3)
    right.errorbar(by_order.order, by_order.mean_area, by_order.error, fmt="o", color=BLACK)
    right.axhline(1.0, color=GREY, linewidth=0.8)
    right.set(xlabel="loop order", ylabel="mean area over that of all")
    return figure


def main(out: Path, collection: Path) -> dict[str, Any]:
    """Measure kinetics and quadrons; write tables, numbers and both figures."""
    found = {name: intervals_of(collection / name) for name in YADE_SAMPLES}
    given = {name: [(one.events[name], one.strains[name]) for one in found.values()]
             for name in STRETCHES}  # fmt: skip
    given[STRETCHES[0]] = short(given[STRETCHES[0]])
    kinetics = {name: transitions(packings) for name, packings in given.items()}
    pairs = {name: table for name, (table, _) in kinetics.items()}
    tables = {name: quadrons_of(collection / name) for name in YADE_SAMPLES}
    parts, by_order = means(tables)
    ratio, spread = likeness([*found.values()])
    numbers: dict[str, Any] = {
        "neighbours_of_the_same_order": [np.diag(ratio)[:4].tolist(), np.diag(spread)[:4].tolist()],
        "variation": {name: float(one["relative_area"].std()) for name, one in tables.items()},
        "quadrons": {name: len(one["area"]) for name, one in tables.items()},
    }
    for name, (table, whole) in kinetics.items():
        balance, events = whole.balance(), [one for one, _ in given[name]]
        numbers[name] = {
            "intervals": [len(one) for one in events],
            "events": [sum(int((e.opened + e.closed).sum()) for e in one) for one in events],
            "once_several": [whole.once, whole.several],
            "mergers_splits": [int(whole.opened.sum()), int(whole.closed.sum())],
            "chi2": [balance.chi2, balance.pairs, balance.p_all],
            "largest": float((table.balance_excess / table.error_by_packing).abs().max()),
        }
    (observed, apart), (_, error) = over_packings(given[STRETCHES[1]], steady)
    shares = {"observed": observed, "less": apart, "error": error}
    numbers["steady"] = {name: values.tolist() for name, values in shares.items()}
    table = pd.concat([one.assign(stretch=name) for name, one in pairs.items()])
    drawn = draw_kinetics(given, pairs, (ratio, spread)), draw_quadrons(parts, by_order)
    save(out / "kinetics", "cells_kinetics", drawn[0], numbers, table, units="1/strain")
    return save(out / "quadrons", "cells_quadrons", drawn[1], numbers, by_order)


if __name__ == "__main__":
    run_example(main, "COLLECTION")
