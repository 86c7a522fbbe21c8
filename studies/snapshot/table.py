"""One row a loop: shape, stress and stability of every loop of a snapshot."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from loops import (
    Faces,
    LoopBatch,
    Regime,
    loop_batches,
    love_weber_stress,
    macroscopic_tangent,
    polygon_area,
    polygon_centroid,
    polygon_perimeter,
    polygon_shape,
)
from patterns import Snapshot
from stability import restrict, symmetric_spectrum, unstable_fraction

Floats = NDArray[np.float64]
CLOSURES: tuple[Literal["affine", "traction"], ...] = ("affine", "traction")
MEASURES = (
    *("x", "y", "area", "perimeter", "elongation", "orientation"),
    *("sliding_contacts", "pressure", "deviator"),
    *("affine_lambda_min", "traction_lambda_min"),
    *("affine_unstable_fraction", "traction_unstable_fraction", "traction_condition"),
)


def loop_table(
    snapshot: Snapshot, faces: Faces, progress: Callable[[int], None] | None = None
) -> dict[str, Any]:
    """Table of the loops of a snapshot.

    Parameters
    ----------
    snapshot : Snapshot
        Grains, contacts, law and regimes.
    faces : Faces
        Its faces, from `find_faces`.
    progress : callable, optional
        Told the number of loops done since the last call.

    Returns
    -------
    dict of str to array
        Columns, one row a loop in the order of `faces.loops`: `loop`, `order`, centroid `x, y`,
        `area`, `perimeter`, `elongation`, `orientation` (degrees in (-90, 90] from axis 1),
        `sliding_contacts`; `pressure` and `deviator` of the loop's Love-Weber stress, each contact
        shared half and half between its two loops; for both closures `*_lambda_min`, the smallest
        eigenvalue of Ks over the mean kn, in the symmetric subspace, spins blocked, contacts
        flagged sliding in their sliding block, `*_unstable_fraction`, the share of directions with
        negative second-order work, and `traction_condition`, see `MacroTangent`; `grains`, ids in
        order. Not a number where the tangent is not trusted.
    """
    kn = float(np.mean(snapshot.law.kn))
    count = len(faces.loops)
    row = np.full(len(faces.kind), -1)
    row[faces.loops] = np.arange(count)
    table: dict[str, Any] = {"loop": np.arange(count), "order": faces.order[faces.loops]}
    for name in MEASURES:
        table[name] = np.empty(count, dtype=np.int64 if name == "sliding_contacts" else np.float64)
    for batch in loop_batches(snapshot.graph, faces):
        columns = _shape(batch) | _mechanics(snapshot, batch, kn)
        at = row[batch.face]
        for name, values in columns.items():
            table[name][at] = values
        if progress is not None:
            progress(len(at))
    table["grains"] = _members(snapshot, faces)
    return table


def _shape(batch: LoopBatch) -> dict[str, NDArray[Any]]:
    x = batch.graph.x
    centre = polygon_centroid(x)
    elongation, orientation = polygon_shape(x)
    return {
        "x": centre[:, 0],
        "y": centre[:, 1],
        "area": polygon_area(x),
        "perimeter": polygon_perimeter(x),
        "elongation": elongation,
        "orientation": np.degrees(orientation),
    }


def _mechanics(snapshot: Snapshot, batch: LoopBatch, kn: float) -> dict[str, NDArray[Any]]:
    law, regime = snapshot.law.take(batch.contacts), snapshot.regime[batch.contacts]
    stress = 0.5 * love_weber_stress(batch.graph)
    mean = 0.5 * (stress[:, 0, 0] + stress[:, 1, 1])
    half = 0.5 * (stress[:, 0, 0] - stress[:, 1, 1])
    columns: dict[str, NDArray[Any]] = {
        "sliding_contacts": np.count_nonzero(regime == Regime.SLIDING, axis=1),
        "pressure": mean,
        "deviator": np.hypot(half, 0.5 * (stress[:, 0, 1] + stress[:, 1, 0])),
    }
    for closure in CLOSURES:
        tangent = macroscopic_tangent(batch.graph, law, closure, regime=regime)
        spectrum = symmetric_spectrum(restrict(tangent.matrix, "symmetric")) / kn
        columns[f"{closure}_lambda_min"] = spectrum[:, 0]
        columns[f"{closure}_unstable_fraction"] = unstable_fraction(spectrum)
    columns["traction_condition"] = tangent.condition
    return columns


def _members(snapshot: Snapshot, faces: Faces) -> pa.ListArray:
    """Grain ids of each loop, in order."""
    order, loops = faces.order, faces.loops
    inside = np.zeros(len(faces.kind), dtype=bool)
    inside[loops] = True
    ids = snapshot.ids[faces.grains[np.repeat(inside, order)]]
    offsets = np.concatenate([[0], np.cumsum(order[loops])])
    return pa.LargeListArray.from_arrays(offsets, ids)
