"""Frequencies with which forecasts of loops came true, and what is likely by them."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from loops.arrays import Floats, Integers

# What may happen to a loop, and the target of `series.skill` that it is.
KINDS = {"opens": "contact_lost", "lost": "topology", "unstable": "W2_negative"}
WAYS = {"path": "events", "replay": "replay"}
# Parts of the way that places are told by; 1 to 8 forecast losses alike (docs/knobs.md).
PARTS = 4
NEVER = PARTS
# Ends of the classes of reach (driven strain over p/kn), each about one step of the series.
REACHES = (0.02, 0.1, 0.6, 4.0)
# Factor beyond the outer mean reaches up to which there are probabilities; 5 kept the skill.
BEYOND = 2.0
CALIBRATION = Path(__file__).with_name("forecast.json")


def parts_of(place: Floats) -> Integers:
    """Return the part of the way of each place, `NEVER` where there is none, -1 if unknown."""
    part = np.where(np.isfinite(place), np.minimum(place, 1.0 - 1e-9) * PARTS, NEVER)
    return np.where(np.isnan(place), -1, part).astype(int)


def parts_cells(path: Integers, replayed: Integers) -> Integers:
    """Return the cell of each pair of parts: both say so by a part, one of them does, or none.

    Where one way is unknown: the parts of the other. Cells count from 0 within these two kinds,
    those of single ways from `2 PARTS + 1`.
    """
    both = np.maximum(path, replayed)
    one = PARTS + np.minimum(path, replayed)
    cell = np.where(both < NEVER, both, np.minimum(one, 2 * PARTS))
    single = 2 * PARTS + 1 + both
    return np.where(both < 0, -1, np.where(np.minimum(path, replayed) < 0, single, cell))


class Calibration(NamedTuple):
    """Loops that a forecast called lost, and those that were: a row a series, reach, kind and cell.

    `table` has `series, level, reach, kind, path, replay, loops, true`; parts of the way by `path`
    and `replay`, `true` of the `loops` were really lost.
    """

    table: pd.DataFrame
    provenance: dict[str, Any]

    def without(self, series: str) -> Calibration:
        """Return the calibration by all other series."""
        return self._replace(table=self.table[self.table["series"] != series])

    def range(self) -> tuple[float, float]:
        """Return the least and the largest mean reach of its classes."""
        reach = self.table.groupby("level")["reach"].mean()
        return float(reach.min()), float(reach.max())

    def shares(self, kind: str, way: str) -> pd.DataFrame:
        """Return `loops`, `true` and the `probability` by level and cell of both ways or of one.

        Each cell has one loop more, with the share of its level: `base`.
        """
        own = self.table[self.table["kind"] == kind]
        path, again = own["path"].to_numpy(), own["replay"].to_numpy()
        nobody = np.full(len(own), -1)
        told = {"both": (path, again), "path": (path, nobody), "replay": (nobody, again)}[way]
        known = (path >= 0) & (again >= 0) if way == "both" else np.maximum(*told) >= 0
        rows = own.assign(cell=parts_cells(*told))[known]
        sums = rows.groupby(["level", "cell"])[["loops", "true"]].sum().reset_index()
        every = own.groupby("level")[["loops", "true"]].sum()
        base = sums["level"].map(every["true"] / every["loops"])
        return sums.assign(base=base, probability=(sums["true"] + base) / (sums["loops"] + 1))

    def probability(
        self, kind: str, path: Floats, replayed: Floats, reach: float
    ) -> tuple[Floats, Floats]:
        """Return the probability that each loop (L,) is lost so, and the base rate.

        Between the mean reaches of two classes they change evenly with its logarithm. Not numbers
        beyond the outer ones, and where no way reached its end.
        """
        low, high = self.range()
        if not low / BEYOND <= reach <= high * BEYOND:
            return np.full(len(path), np.nan), np.full(len(path), np.nan)
        parts = parts_of(path), parts_of(replayed)
        cell, known = parts_cells(*parts), [(part >= 0).any() for part in parts]
        way = "both" if all(known) else "path" if known[0] else "replay"
        shares, found, bases = self.shares(kind, way), [], []
        for _, own in shares.groupby("level"):
            bases.append(own["base"].iloc[0])
            # A cell that no loop was in has the base rate.
            values = np.full(3 * PARTS + 2, bases[-1])
            values[own["cell"]] = own["probability"]
            found.append(np.where(cell < 0, np.nan, values[cell]))
        at = np.log(self.table.groupby("level")["reach"].mean().loc[shares["level"].unique()])
        place = np.log(reach)
        told = [np.interp(place, at, column) for column in np.array(found).T]
        return np.array(told), np.full(len(path), np.interp(place, at, bases))

    def left_out(self, kind: str) -> Floats:
        """Return what each series is told by all others, (n, 3): probability, loops, true ones.

        A row a cell of both ways.
        """
        rows = [np.zeros((0, 3))]
        known = (self.table[[*WAYS]] >= 0).all(axis=1)
        own = self.table[(self.table["kind"] == kind) & known]
        for (series, _), some in own.groupby(["series", "level"]):
            path, again = (
                np.where(some[way] < NEVER, (some[way] + 0.5) / PARTS, np.inf) for way in WAYS
            )
            reach = float(some["reach"].mean())
            said, _ = self.without(str(series)).probability(kind, path, again, reach)
            rows.append(np.column_stack([said, some["loops"], some["true"]]))
        found = np.concatenate(rows)
        return found[np.isfinite(found[:, 0])]


@cache
def calibration() -> Calibration:
    """Return the calibration that is stored beside this module."""
    stored = json.loads(CALIBRATION.read_text(encoding="utf-8"))
    return Calibration(pd.DataFrame(stored["rows"], columns=stored["columns"]), stored["made"])
