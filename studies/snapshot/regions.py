"""Loops inside a region of a sample beside all others: a band, a polygon, force chains."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from loops.arrays import Flags, Floats, Integers, median
from loops.errors import InputError, number
from studies.output import Columns, Summary
from studies.snapshot.table import group_rows, share

# A column of the table of loops and a threshold, `nonaffinity>2`.
THRESHOLD = re.compile(r"\s*(\w+)\s*([<>])\s*(\S+)\s*")
ELSEWHERE, UNKNOWN = "elsewhere", "unknown"
Strings = NDArray[np.str_]


class Property(NamedTuple):
    """Property of loops: (L,) which have it, (L,) where it is known, the eigenvalues behind it."""

    flags: Flags
    known: Flags
    smallest: Floats | None = None


def loop_regions(table: Columns, regions: str) -> tuple[Integers, Strings]:
    """Return the number of the region of each loop (L,), and the names of the regions.

    `regions` is a threshold on a column of the table, `deviator>120`, or a table of corners `x`,
    `y` of polygons, in order, with their names in `region`: loops with their centroid inside
    belong to a polygon, to the first of several. Loops without a number in the column of a
    threshold are neither inside nor elsewhere, but `unknown`.
    """
    asked = parsed(regions)
    if isinstance(asked, tuple):
        column, sign, value = asked
        values = np.asarray(table[column]) if column in table else np.empty(0, dtype=object)
        if values.dtype.kind not in "iuf":
            named = [name for name in table if np.asarray(table[name]).dtype.kind in "iuf"]
            near = get_close_matches(column, named)
            remedy = f"Did you mean {near[0]}?" if near else "Correct the name."
            expected = f"a column of numbers: {', '.join(named)}"
            raise InputError("--regions", f"column {column}", expected, remedy)
        inside = values > value if sign == ">" else values < value
        known = ~np.isnan(values)
        names = [regions.strip(), ELSEWHERE, *(() if known.all() else (UNKNOWN,))]
        return np.where(known, np.where(inside, 0, 1), 2), np.array(names)
    if "x" not in table:
        remedy = "Give a threshold, nonaffinity>2."
        raise InputError("--regions", regions, "a threshold: these loops have no places", remedy)
    from matplotlib.path import Path as Outline

    at, place = np.column_stack([table["x"], table["y"]]), np.full(len(table["x"]), len(asked))
    for number_of, corners in reversed(list(enumerate(asked.values()))):
        place[Outline(corners).contains_points(at)] = number_of
    return place, np.array([*asked, ELSEWHERE])


def parsed(regions: str) -> tuple[str, str, float] | dict[str, Floats]:
    """Return a column, sign and threshold, or corners of polygons; `InputError` for neither."""
    found = THRESHOLD.fullmatch(regions)
    if found is None:
        return _polygons(Path(regions))
    try:
        return found[1], found[2], number("--regions", float(found[3]))
    except ValueError:
        remedy = "Write deviator>120, or name a table of corners."
        raise InputError("--regions", regions, "a column and a number", remedy) from None


def _polygons(path: Path) -> dict[str, Floats]:
    """Return the corners of each polygon of a file by its name."""
    import pandas as pd

    try:
        table = pd.read_csv(path, comment="#")
        names = table["region"].astype(str) if "region" in table else ["inside"] * len(table)
        corners = table[["x", "y"]].astype(float)
    except (OSError, KeyError, ValueError) as error:
        expected = "a threshold, deviator>120, or a table of corners with columns x, y and region"
        raise InputError("--regions", f"{path}: {error}", expected, "Correct it.") from None
    parts = {str(k): one.to_numpy() for k, one in corners.groupby(np.asarray(names), sort=False)}
    for name, part in parts.items():
        if len(part) < 3 or not np.isfinite(part).all():
            expected = "three finite corners at least"
            raise InputError("--regions", f"{path}: region {name}", expected, "Add its corners.")
    return parts


def places_table(
    order: Integers,
    place: Integers,
    names: Sequence[str] | Strings,
    properties: Mapping[str, Property],
) -> dict[str, list[Any]]:
    """Return a row a place and group of orders: loops, share with each property, its error.

    Of a verdict `<judge>_unstable` also `<judge>_lambda_min`, the median of its eigenvalues, and
    `<judge>_undetermined`, the share of loops without one.
    """
    rows = list[dict[str, Any]]()
    for k, name in enumerate(names):
        here = np.flatnonzero(place == k)
        for orders, own in group_rows(order[here]).items():
            part = here[own]
            count = len(part)
            mean = float(order[part].mean()) if count else np.nan
            row = {"place": name, "orders": orders, "loops": count, "mean_order": mean}
            for column, (flags, known, smallest) in properties.items():
                of_them = share(flags[part][known[part]])
                if smallest is not None:
                    values, judge = smallest[part], column.removesuffix("_unstable")
                    row[f"{judge}_lambda_min"] = median(values[np.isfinite(values)])
                    unknown = (count - of_them["count"]) / count if count else np.nan
                    row[f"{judge}_undetermined"] = unknown
                row[column], row[f"{column}_error"] = of_them["mean"], of_them["std_error"]
            rows.append(row)
    return {name: [row[name] for row in rows] for name in rows[0]}


def compared(
    table: Any, regions: str, properties: Mapping[str, Property]
) -> tuple[dict[str, list[Any]], Summary]:
    """Add the column `region` to a table of loops; return the rows by region, and their summary."""
    place, names = loop_regions(table, regions)
    table["region"] = names[place]
    places = places_table(np.asarray(table["order"]), place, names, properties)
    return places, region_summary(places, table)


def region_summary(places: Mapping[str, list[Any]], table: Columns) -> Summary:
    """Return what `places_table` has of all loops of each region, and the region's area share."""
    whole, found = float(np.sum(table["area"])), Summary()
    for values in zip(*places.values(), strict=True):
        row = dict(zip(places, values, strict=True))
        if row.pop("orders") == "all":
            name = row.pop("place")
            area = float(np.sum(table["area"][table["region"] == name]))
            known = {key: None if value != value else value for key, value in row.items()}
            found[name] = {**known, "area_share": area / whole}
    return found
