"""The pairs of a packing at one geometry, as the kernels of rates take them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stability.packing.pairs import Pairs
from stability.packing.state import PackingState

if TYPE_CHECKING:
    from stability.compiled.packing_rates import PairFrame

# Columns of `PairFrame.rows`.
KN, KT, MU, SLIDES = 14, 15, 16, 17


def frame_of(state: PackingState, pairs: Pairs, by_radii: bool) -> PairFrame:
    """The pairs at the geometry of a state."""
    from stability.compiled.packing_rates import PairFrame

    d = state.branches
    length = np.linalg.norm(d, axis=1)
    n = d / length[:, None]
    t = np.column_stack([-n[:, 1], n[:, 0]])
    radii = state.radii[pairs.grains]
    arms = 0.5 * (length[:, None] + radii - radii[:, ::-1])
    unit = float(state.radii.mean())
    N, T = state.normal_force, state.shear_force
    slides = np.isfinite(pairs.mu)
    rows = [
        d,
        n,
        t,
        (radii.sum(axis=1) / length if by_radii else np.ones_like(length))[:, None],
        (radii if by_radii else arms) / unit,
        arms / unit,
        (N[:, None] * t - T[:, None] * n) / length[:, None],
        np.column_stack(
            [0.5 * T / unit, pairs.kn, pairs.kt, np.where(slides, pairs.mu, 0), slides]
        ),
    ]
    return PairFrame(np.ascontiguousarray(pairs.grains), np.hstack(rows))
