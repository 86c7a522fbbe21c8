"""How the loops of a snapshot are drawn: one by one, or as pixels where they are many."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from matplotlib.cm import ScalarMappable

from loops import Faces
from patterns import Snapshot
from studies.snapshot.loop_map import LAST_ORDER, ORDER_COLOURS, PAINT_LIMIT, _drawer, _painter

__all__ = ["LAST_ORDER", "ORDER_COLOURS", "loop_drawer"]


def loop_drawer(snapshot: Snapshot, faces: Faces) -> Callable[..., ScalarMappable]:
    """Prepare the loops of a snapshot for drawing, once for all panels.

    Parameters
    ----------
    snapshot : Snapshot
        Grains and contacts.
    faces : Faces
        Their faces.

    Returns
    -------
    callable
        `draw(ax, values, colours, scale)` with one value a loop, in the order of `faces.loops`,
        a colour map and its scale; returns what was drawn.
    """
    many = len(faces.loops) > PAINT_LIMIT
    drawer: Any = _painter if many else _drawer
    draw: Callable[..., ScalarMappable] = drawer(snapshot, faces)
    return draw
