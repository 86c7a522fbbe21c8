"""Are the quadrons of loops of every order alike?

From a collection of Yade samples (the folder of the tests on a collection), with errors from
packing to packing: areas of quadrons over their mean by the order of the loop (Matsushima and
Blumenfeld, arXiv 1207.2988).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from loops.arrays import Floats
from studies.examples import YADE_SAMPLES, read, run_example, save
from studies.output import Columns
from studies.snapshot.quadrons import densities, draw_densities, quadron_columns
from studies.style import BLACK, GREY, new_panels, styled

ORDERS = range(3, 11)


def quadrons_of(folder: Path) -> Columns:
    """Return the quadrons of all snapshots of a sample, each over its own mean."""
    parts = [quadron_columns(read(path)) for path in sorted(folder.glob("grains_??.*"))]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def means(tables: dict[str, Columns]) -> tuple[dict[int, Floats], pd.DataFrame]:
    """Return densities (samples, bins) by order, and mean areas by order with their errors."""
    samples = [densities(one["relative_area"], one["order"]) for one in tables.values()]
    areas = pd.DataFrame([pd.Series(one["relative_area"]).groupby(one["order"]).mean()
                          for one in tables.values()])[[*ORDERS]]  # fmt: skip
    by_order = pd.DataFrame({"order": ORDERS, "mean_area": areas.mean().to_numpy(),
                             "error": areas.sem().to_numpy()})  # fmt: skip
    return {n: np.array([one[n] for one in samples]) for n in samples[0]}, by_order


@styled()
def draw(parts: dict[int, Floats], by_order: pd.DataFrame) -> Figure:
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
    """Measure the quadrons; write table, numbers and figure."""
    tables = {name: quadrons_of(collection / name) for name in YADE_SAMPLES}
    parts, by_order = means(tables)
    numbers = {
        "variation": {name: float(one["relative_area"].std()) for name, one in tables.items()},
        "quadrons": {name: len(one["area"]) for name, one in tables.items()},
    }
    return save(out, "quadrons", draw(parts, by_order), numbers, by_order)


if __name__ == "__main__":
    run_example(main, "COLLECTION")
