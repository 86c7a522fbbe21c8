"""Statistics of loops by order: means, shares and directions, each with its spread."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops.arrays import Flags, Floats, Integers
from loops.fabric import TensorMean, axial_mean, principal

Groups = dict[str, Integers | slice]

# Loops of this order and beyond form one group, in every table, figure and report.
LAST_ORDER = 8
GROUPS = (*map(str, range(3, LAST_ORDER)), f"{LAST_ORDER}+")
QUARTILES = {"q25": 0.25, "median": 0.5, "q75": 0.75}


def spread(values: ArrayLike, weights: ArrayLike | None = None) -> dict[str, Any]:
    """Mean, standard deviation, quartiles and number of the values that are not nan."""
    value = np.asarray(values, dtype=float)
    weight = None if weights is None else np.asarray(weights, dtype=float)
    known = ~np.isnan(value)
    if not known.all():
        value, weight = value[known], None if weight is None else weight[known]
    if len(value) == 0 or (weight is not None and not weight.sum() > 0):
        return dict.fromkeys(("mean", "std", *QUARTILES), float("nan")) | {"count": len(value)}
    mean = np.average(value, weights=weight)
    at = np.multiply(len(value) - 1, list(QUARTILES.values()))
    low = at.astype(np.int64)
    high = np.minimum(low + 1, len(value) - 1)
    # Quartiles of many loops: a partition takes a third of the time of sorting.
    placed = np.partition(value, [*low, *high])
    quartiles = placed[low] + (at - low) * (placed[high] - placed[low])
    return {
        "mean": float(mean),
        "std": float(np.sqrt(np.average((value - mean) ** 2, weights=weight))),
        **dict(zip(QUARTILES, quartiles.tolist(), strict=True)),
        "count": len(value),
    }


def group_rows(order: Integers) -> Groups:
    """Rows of the loops of each group of orders, and of `all`."""
    grouped = np.minimum(order, LAST_ORDER).astype(np.int8)
    rows: Groups = {name: np.flatnonzero(grouped == 3 + k) for k, name in enumerate(GROUPS)}
    return rows | {"all": slice(None)}


def spread_by_group(
    groups: Groups, values: Floats, weights: Floats | None = None
) -> dict[str, dict[str, Any]]:
    """`spread` of a column for each group of orders."""
    return {
        name: spread(values[rows], None if weights is None else weights[rows])
        for name, rows in groups.items()
    }


def share_by_group(groups: Groups, having: Flags, known: Flags) -> dict[str, Any]:
    """Share of the loops of each group that have a property."""
    return {name: share(having[rows][known[rows]]) for name, rows in groups.items()}


def share(having: Flags) -> dict[str, Any]:
    """Share of loops that have a property, its standard error `sqrt(p (1 - p)/n)` and number n."""
    if len(having) == 0:
        return {"mean": float("nan"), "std_error": float("nan"), "count": 0}
    p = float(having.mean())
    error = float(np.sqrt(p * (1 - p) / len(having)))
    return {"mean": p, "std_error": error, "count": len(having)}


def mean_by_order(order: Integers, values: NDArray[Any], known: Flags) -> dict[str, float]:
    """Mean of the known values for each order."""
    number = np.bincount(order, known)
    total = np.bincount(order, np.where(known, values, 0.0))
    orders = np.flatnonzero(np.bincount(order))
    with np.errstate(invalid="ignore"):
        means = total[orders] / number[orders]
    return dict(zip(map(str, orders.tolist()), means.tolist(), strict=True))


def tensor_block(average: TensorMean) -> dict[str, Any]:
    """A mean tensor with its spread, anisotropy and direction."""
    anisotropy, direction = principal(average.mean)
    return {
        "tensor": average.mean,
        "std": average.std,
        "anisotropy": float(anisotropy),
        "direction": float(np.degrees(direction)),
        "count": average.number,
    }


def axes_block(angles: Floats, weights: Floats | None = None) -> dict[str, Any]:
    """Mean of axes, by doubled angles, with its spread."""
    known = np.isfinite(angles)
    direction, resultant = axial_mean(
        np.radians(angles[known]), None if weights is None else weights[known]
    )
    with np.errstate(divide="ignore"):
        std = np.degrees(0.5 * np.sqrt(np.maximum(-2 * np.log(resultant), 0.0)))
    return {
        "direction": float(np.degrees(direction)),
        "resultant": resultant,
        "std": float(std),
        "count": int(np.count_nonzero(known)),
    }


def axes_density(axes: Floats, width: float) -> dict[str, NDArray[Any]]:
    """Density of axes (degrees) over half a turn, in bins of this width."""
    bins = round(180 / width)
    # Bins centred on the axes of coordinates, where regular packings have their peaks.
    at = np.floor(np.mod(axes + 0.5 * width, 180.0) / width).astype(np.int64) % bins
    count = np.bincount(at, minlength=bins)
    return {
        "angle": width * np.arange(bins),
        "count": count,
        "density": count / max(len(axes), 1) / (2 * np.radians(width)),
    }
