"""Geometry and balance of the hexagon of the H-model, in closed form.

Four branches of length `l` at +-alpha to axis 1, two of length `l2` along it. The inclined
contacts carry `N1` and `T1` (positive when alpha grows, as in the diamond), the axial ones `N2`;
symmetry leaves them no shear force. Forces are positive in compression, angles are radians, all
arguments broadcast (hexagon after Nicot and Darve 2011, the H-microdirectional model).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


class HexagonForces(NamedTuple):
    """External forces on the hexagon, all pushing inward."""

    F1: Floats
    F2: Floats
    G: Floats


def hexagon_lengths(length: ArrayLike, axial: ArrayLike, alpha: ArrayLike) -> tuple[Floats, Floats]:
    """Extent of the hexagon, `L1 = l2 + 2 l cos(alpha)` and `L2 = 2 l sin(alpha)`."""
    side = np.asarray(length, dtype=float)
    return np.asarray(axial, dtype=float) + 2.0 * side * np.cos(alpha), 2.0 * side * np.sin(alpha)


def hexagon_external_forces(
    N1: ArrayLike, T1: ArrayLike, N2: ArrayLike, alpha: ArrayLike
) -> HexagonForces:
    """External forces that hold the contact forces in balance.

    `F1 = 2 (N1 cos a + T1 sin a)`, `F2 = 2 (N1 sin a - T1 cos a)`, as in the diamond, and
    `G = N2 - F1/2`. The H-model pushes along axis 1 on the two outer grains alone, `G = 0`:
    `N2 = N1 cos a + T1 sin a`. A uniform stress on the polygon pushes half as much on each of
    the four others, `G = F1/2`: `N2 = 2 (N1 cos a + T1 sin a)`.
    """
    normal, shear = np.asarray(N1, dtype=float), np.asarray(T1, dtype=float)
    c, s = np.cos(alpha), np.sin(alpha)
    along = normal * c + shear * s
    across = normal * s - shear * c
    return HexagonForces(2.0 * along, 2.0 * across, np.asarray(N2, dtype=float) - along)


def hexagon_contact_forces(
    F1: ArrayLike, F2: ArrayLike, alpha: ArrayLike, G: ArrayLike = 0.0
) -> tuple[Floats, Floats, Floats]:
    """Contact forces in balance with external ones: the hexagon is statically determinate.

    `N1 = (F1 cos a + F2 sin a)/2`, `T1 = (F1 sin a - F2 cos a)/2`, `N2 = F1/2 + G`.
    """
    f1, f2 = np.asarray(F1, dtype=float), np.asarray(F2, dtype=float)
    c, s = np.cos(alpha), np.sin(alpha)
    return 0.5 * (f1 * c + f2 * s), 0.5 * (f1 * s - f2 * c), 0.5 * f1 + np.asarray(G, dtype=float)


def hexagon_stress(
    forces: HexagonForces, L10: ArrayLike, L20: ArrayLike, axial0: ArrayLike
) -> tuple[Floats, Floats]:
    """Nominal stress over the reference polygon.

    `P11 = (F1 L10 + 2 G l20)/V0` and `P22 = F2 L20/V0` with `V0 = L20 (L10 + l20)/2`; under
    uniform stress `P11 = 2 F1/L20`.
    """
    w1, w2, axial = (np.asarray(value, dtype=float) for value in (L10, L20, axial0))
    volume = 0.5 * w2 * (w1 + axial)
    return (forces.F1 * w1 + 2.0 * forces.G * axial) / volume, forces.F2 * w2 / volume
