"""Stresses of the first cell, and jumps between the states of a path."""

from __future__ import annotations

import numpy as np

from loops.arrays import Floats
from loops.contacts import PackingState

# Columns of `Path.work` after that of the control.
SLIP = 1
INCREMENT = 2
RELEASED = 3
# Largest change of the stress in an interval, over itself: beyond, the interval met a jump.
JUMP = 0.5
# Largest motion of a centre against the others in an interval, over the mean diameter.
LEAP = 0.02


def nominal(stress: Floats, H: Floats) -> Floats:
    """Return the nominal stress over the first cell, `det F P F^-T` with `F = 1 - H`."""
    F = np.eye(2) - H
    return np.asarray(np.linalg.det(F) * stress @ np.linalg.inv(F).T)


def jumped(before: PackingState, after: PackingState, stress: float) -> str:
    """Tell the jump of the stress or of a centre in a short strain; empty if there is none.

    `stress` is the norm of the stress at the start of the path.
    """
    # Near zero stress the change is measured by the stress of the start; contacts that pull cancel
    # others in the stress, and count besides.
    size = max(float(np.linalg.norm(before.stress)), stress) + before.pull
    change = np.linalg.norm(after.stress - before.stress) / size
    if not change < JUMP:
        return f"the stress jumped by {change:.2g} of what it was"
    beyond = after.x - before.x @ (after.cell @ np.linalg.inv(before.cell)).T
    carries = np.bincount(after.contacts[after.closed].ravel(), minlength=len(beyond)) > 1
    leap = np.abs(beyond[carries]).max(initial=0.0) / (2.0 * after.mean_radius)
    return f"a grain leapt by {leap:.2g} diameters" if leap > LEAP else ""
