"""The loops of a report's interactive map, packed into text."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.colors import to_hex
from numpy.typing import NDArray

from loops import Faces, GrainGraph
from patterns import Snapshot
from studies.snapshot.loop_map import ORDER_COLOURS
from studies.style import DIVERGING, SEQUENTIAL

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# Beyond so many loops a page gets too slow to handle.
MOST_LOOPS = 50_000
SHADES = 64
# Columns offered first for the colours.
FIRST = ("order", "traction_lambda_min", "traction_free_lambda_min", "affine_lambda_min", "w2")


@dataclass(frozen=True, eq=False)
class LoopsForMap:
    """Polygons and rows of the loops of one packing.

    Attributes
    ----------
    offsets : (L + 1,) array of int
        Where each loop starts in `corners` and `grains`.
    corners : (H, 2) array
        Corners of the loops in order, unrolled through periodic images (length).
    grains : (H,) array of int
        Ids of the grains at the corners.
    columns : mapping of str to (L,) array
        What is shown of a loop: integers or floats.
    unit : str
        Unit of the corners, for the axes.
    """

    offsets: Integers
    corners: Floats
    grains: Integers
    columns: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    unit: str = "length unit of the input"

    def __len__(self) -> int:
        return len(self.offsets) - 1


def loops_for_map(snapshot: Snapshot, faces: Faces, table: Mapping[str, Any]) -> LoopsForMap | None:
    """Polygons and rows of the loops of a snapshot.

    Parameters
    ----------
    snapshot : Snapshot
        Grains and contacts.
    faces : Faces
        Their faces.
    table : mapping of str to array
        From `loop_table`, with columns of one's own if wanted; `grains` is left out.

    Returns
    -------
    LoopsForMap or None
        In the order of the table; None for more loops than a page can handle.
    """
    if len(faces.loops) > MOST_LOOPS:
        return None
    offsets, at = half_edges_of_loops(faces)
    return LoopsForMap(
        offsets,
        loop_corners(snapshot.graph, faces, offsets, at),
        snapshot.ids[faces.grains[at]],
        {name: np.asarray(values) for name, values in table.items() if name != "grains"},
    )


def half_edges_of_loops(faces: Faces) -> tuple[Integers, Integers]:
    """The half-edges of the loops alone.

    Parameters
    ----------
    faces : Faces
        All faces.

    Returns
    -------
    offsets : (L + 1,) array of int
        Where each loop starts in `at`.
    at : (H,) array of int
        Half-edges, in the order of `faces.loops`.
    """
    order = faces.order[faces.loops]
    offsets = np.concatenate([[0], np.cumsum(order)])
    first = faces.offsets[faces.loops] - offsets[:-1]
    return offsets, np.repeat(first, order) + np.arange(offsets[-1])


def loop_corners(graph: GrainGraph, faces: Faces, offsets: Integers, at: Integers) -> Floats:
    """Corners of the loops, unrolled through periodic images from each loop's first grain.

    Parameters
    ----------
    graph : GrainGraph
        The packing.
    faces : Faces
        Its faces.
    offsets, at : arrays of int
        From `half_edges_of_loops`.

    Returns
    -------
    (H, 2) array
        Corners (length).
    """
    x = graph.x[faces.grains[at]]
    if graph.cell is None or graph.images is None or len(at) == 0:
        return x
    image = graph.images[faces.contacts[at]] * np.where(faces.forward[at], 1, -1)[:, None]
    passed = np.cumsum(image, axis=0) - image
    passed -= np.repeat(passed[offsets[:-1]], np.diff(offsets), axis=0)
    return x + passed @ graph.cell.T


def packed(loops: LoopsForMap) -> str:
    """The loops as JSON whose arrays are little-endian bytes in base64.

    Corners are single precision, relative to `origin`; so are columns of floats, which are shown
    with six digits. Integers have four bytes, ids eight-byte floats if four are too few.

    Parameters
    ----------
    loops : LoopsForMap
        Loops, at most `MOST_LOOPS` for a page that stays quick.

    Returns
    -------
    str
        JSON without `<`, fit for a script element.
    """
    origin = loops.corners.mean(axis=0) if len(loops.corners) else np.zeros(2)
    ahead = [name for name in FIRST if name in loops.columns]
    content = {
        "count": len(loops),
        "origin": origin.tolist(),
        "unit": loops.unit,
        "offsets": encoded(loops.offsets),
        "corners": encoded((loops.corners - origin).ravel()),
        "grains": encoded(loops.grains),
        "columns": {name: encoded(values) for name, values in loops.columns.items()},
        "colour_by": [*ahead, *(n for n in loops.columns if n not in (*ahead, "loop"))],
        "palettes": {
            "order": ORDER_COLOURS,
            "sequential": _shades(SEQUENTIAL),
            "diverging": _shades(DIVERGING),
        },
    }
    return json.dumps(content, separators=(",", ":")).replace("<", "\\u003c")


def encoded(values: NDArray[Any]) -> dict[str, str]:
    """Type and bytes of an array."""
    if np.issubdtype(values.dtype, np.floating):
        kind = "f4"
    else:
        wide = len(values) and np.abs(values).max() >= 2**31
        kind = "f8" if wide else "i4"
    data = values.astype(f"<{kind}").tobytes()
    return {"type": kind, "data": base64.b64encode(data).decode("ascii")}


def _shades(name: str) -> list[str]:
    return [to_hex(colour) for colour in mpl.colormaps[name](np.linspace(0, 1, SHADES))]
