"""What the figures over the axial strain share: stages, named states, opposite grains."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from patterns.diamond import opposite_gaps
from studies.diamond.path import DiamondPath
from studies.style import BLACK, GREY, LIGHT_GREY, write_above

Floats = NDArray[np.float64]
STRAIN = r"axial strain $E_1$ (–)"
DASHED = (0, (4, 3))


def smooth_rows(path: DiamondPath) -> Iterator[slice]:
    """Rows of the path between jumps of the operator, where the regime or the contacts change.

    Parameters
    ----------
    path : DiamondPath
        From `follow`.

    Yields
    ------
    slice
    """
    states = path.states
    jumps = np.diff(states.slip) != 0.0
    jumps |= (states.chords[1:] != states.chords[:-1]).any(axis=1)
    bounds = [0, *(np.flatnonzero(jumps) + 1), len(states.E1)]
    for start, end in pairwise(bounds):
        yield slice(int(start), int(end))


def broken(path: DiamondPath, values: Floats) -> Floats:
    """A column with NaN between the rows of a jump, so that no line joins them.

    Parameters
    ----------
    path : DiamondPath
        From `follow`.
    values : ndarray (n, ...)
        One of its columns, or several side by side.

    Returns
    -------
    ndarray (m, ...)
    """
    _, *jumps = (rows.start for rows in smooth_rows(path))
    return np.insert(values, jumps, np.nan, axis=0)


def mark_states(path: DiamondPath, ax: Axes, values: Floats, below: str = "") -> None:
    """Points I, A and B on a curve.

    Parameters
    ----------
    path : DiamondPath
        From `follow`.
    ax : Axes
        Axes over E1.
    values : ndarray (n,)
        The curve.
    below : str
        Names of the states to write below their points.
    """
    for name, row in path.marks.items():
        at = path.states.E1[row], values[row]
        ax.plot(*at, "o", color=BLACK, zorder=3)
        offset, side = ((0, -5), "top") if name in below else ((0, 5), "bottom")
        text = ax.annotate(
            name, at, offset, textcoords="offset points", fontweight="bold", ha="center", va=side
        )
        text.set_path_effects([withStroke(linewidth=2.0, foreground="white")])


def mark_overlap(path: DiamondPath, ax: Axes) -> None:
    """Shade where opposite grains overlap; say so above the axes, where no curve runs.

    Parameters
    ----------
    path : DiamondPath
        From `follow`.
    ax : Axes
        Axes over E1.
    """
    E1 = path.states.E1
    gaps = opposite_gaps(E1, path.states.E2, path.loop.alpha0)
    overlap = np.minimum(*gaps) < 0.0
    if not overlap.any():
        return
    edges = np.flatnonzero(np.diff(np.concatenate([[0], overlap.astype(np.int64), [0]])))
    for first, last in edges.reshape(-1, 2):
        ax.axvspan(E1[first], E1[last - 1], color=LIGHT_GREY, alpha=0.45, linewidth=0.0, zorder=0)
    first, last = edges[0], edges[-1] - 1
    said = "share a contact" if path.states.chords.any() else "overlap"
    middle = 0.5 * (E1[first] + E1[last])
    write_above(ax, middle, f"opposite grains {said}", color=GREY, fontsize=7)
