"""Curves through the rows of a path, and its columns as the theory writes them."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

from loops.arrays import Floats, Integers
from stability import Path

DETERMINANT_LABELS = {"det_K": r"$\det K$", "det_Ks": r"$\det K_s$"}


def cubics(path: Path, part: Integers, columns: tuple[dict[str, Any], str, str]) -> Floats:
    """(2, n) points of a curve through rows, over the length of `H`'s way, and a gap behind it."""
    table, *names = columns
    along = np.cumsum(
        np.linalg.norm(np.diff(path.H[part], axis=0, prepend=path.H[part[:1]]), axis=1)
    )
    part, s = part[(moved := np.diff(along, prepend=-1.0) > 0)], along[moved]
    fine = np.interp(np.linspace(0, len(s) - 1, 12 * len(s)), np.arange(len(s)), s)
    points = []
    for name in names:
        values = np.asarray(table[name], dtype=float)[part]
        if len(s) < 2 or not np.isfinite(values).all():
            drawn = np.interp(fine, s, values)
        elif f"{name}_rate" in table:
            drawn = CubicHermiteSpline(s, values, np.asarray(table[f"{name}_rate"])[part])(fine)
        else:
            drawn = PchipInterpolator(s, values)(fine)
        points.append(np.append(drawn, np.nan))
    return np.stack(points)


def symbol(column: str) -> str:
    """A column as the theory writes it, else its words."""
    component = re.fullmatch(r"([HPNT])_?(\d*)", column)
    if component:
        return f"${component[1]}_{{{component[2]}}}$"
    return DETERMINANT_LABELS.get(column, column.replace("_", " "))


def with_unit(column: str) -> str:
    """A column with its unit."""
    units = {"H": "–", "P": "force / length", "N": "force", "T": "force"}
    unit = units.get(column.split("_")[0].rstrip("12"))
    return f"{symbol(column)} ({unit})" if unit else symbol(column)
