"""Operators with known stability: the diamond of the source, defective and indefinite matrices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def elastic_diamond(
    alpha0: float, kappa: float, E1: float, E2: float, s1: float, s2: float
) -> NDArray[np.float64]:
    """Dimensionless tangent (26) in (11, 22), elastic contacts, written out term by term."""
    t0 = np.tan(alpha0)
    t = t0 * (1 - E2) / (1 - E1)
    return np.array(
        [
            [(1 + kappa * t**2 - t * s2 / (1 - E1)) / t0, (1 - kappa) * t + s2 / (1 - E1)],
            [(1 - kappa) * t + t**2 * s1 / (1 - E2), (t**2 + kappa - t * s1 / (1 - E2)) * t0],
        ]
    ) / (1 + t**2)


def isotropic_diamond(alpha0: float, kappa: float, E: float) -> NDArray[np.float64]:
    """The diamond at E1 = E2 = E: no shear force, s1 = E/t0, s2 = E t0 (39)."""
    t0 = np.tan(alpha0)
    return elastic_diamond(alpha0, kappa, E, E, E / t0, E * t0)


def rotation(size: int, seed: int) -> NDArray[np.float64]:
    """A random orthogonal matrix."""
    return np.linalg.qr(np.random.default_rng(seed).standard_normal((size, size)))[0]


PAIRWISE_POSITIVE = np.array([[1.0, -0.9, -0.9], [-0.9, 1.0, -0.9], [-0.9, -0.9, 1.0]])
"""Positive on every pair of axes, eigenvalues (-0.8, 1.9, 1.9)."""
