"""What probes of the whole sample add to the row of a snapshot."""

from __future__ import annotations

from typing import Any

import numpy as np

from loops import InputError
from patterns import Snapshot
from stability.packing.probe import probe_edge
from studies.snapshot.in_packing import sample_edge

CONE = ("probe_cone_begin_deg", "probe_cone_end_deg")
NAMES = ("probe_w2", "probe_theta_deg", "probe_unstable_fraction", *CONE, "probe_undetermined")


def probe_row(
    state: Snapshot, directions: int, yield_band: float
) -> tuple[dict[str, Any], list[str]]:
    """Columns of one snapshot and notes; None where there is no such number."""
    row: dict[str, Any] = dict.fromkeys(NAMES)
    try:
        edge = sample_edge(state, yield_band)
    except InputError as error:
        return row, [f"not probed: {error}"]
    found = probe_edge(edge, directions, faces=state.faces)
    row["probe_undetermined"] = int(np.count_nonzero(~found.determined))
    if found.softest is not None:
        row["probe_w2"] = float(found.normalised[found.softest])
        row["probe_theta_deg"] = float(np.degrees(found.theta[found.softest]))
        row["probe_unstable_fraction"] = found.unstable_fraction
    if len(found.cones):
        widest = np.degrees(found.cones[np.argmax(np.ptp(found.cones, axis=1))])
        row |= dict(
            zip(("probe_cone_begin_deg", "probe_cone_end_deg"), widest.tolist(), strict=True)
        )
    return row, []
