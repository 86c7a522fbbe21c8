"""Rotation and stretch of a deformation gradient, and stresses and tangents between them."""

from __future__ import annotations

import numpy as np

from loops.arrays import Floats
from loops.compiled import kernel


def polar(F: Floats) -> tuple[Floats, Floats]:
    """Return the rotation `R` and the stretch `U`, (Q, 2, 2), of `F = R U`."""
    angle = np.arctan2(F[:, 1, 0] - F[:, 0, 1], F[:, 0, 0] + F[:, 1, 1])
    cos, sin = np.cos(angle), np.sin(angle)
    R = np.stack([cos, -sin, sin, cos], axis=-1).reshape(-1, 2, 2)
    U = np.swapaxes(R, 1, 2) @ F
    return R, 0.5 * (U + np.swapaxes(U, 1, 2))


def nominal_response(R: Floats, U: Floats, B: Floats, A: Floats) -> tuple[Floats, Floats]:
    """Return the nominal stress (Q, 2, 2) and its tangent (Q, 2, 2, 2, 2) `dP/dH`, `H = 1 - F`.

    `B` (Q, 2, 2) is the stress in the frame of `U` and `A` (Q, 2, 2, 2, 2) its tangent over
    `1 - U`. Of `B` only the symmetric part does work on `U'`; the rest is the couple by which the
    spins are held, and has no place in a stress that does no work under a rotation. So
    `P = R (sym B + c E)`, with `c` such that the Cauchy stress is symmetric.
    """
    stress, tangent = np.empty_like(B), np.empty_like(A)
    turn_all(R, U, B, A, stress, tangent)
    return stress, tangent


@kernel
def turn_all(R: Floats, U: Floats, B: Floats, A: Floats, stress: Floats, tangent: Floats) -> None:
    """Fill `stress` and `tangent` of `nominal_response`."""
    X, dX, G, dB = np.empty((2, 2)), np.empty((2, 2)), np.empty((2, 2)), np.empty((2, 2))
    for q in range(len(U)):
        u11, u12, u22 = U[q, 0, 0], U[q, 0, 1], U[q, 1, 1]
        trace, b12 = u11 + u22, 0.5 * (B[q, 0, 1] + B[q, 1, 0])
        b11, b22 = B[q, 0, 0], B[q, 1, 1]
        # (sym B + c E) U is symmetric, E = (0, 1; -1, 0).
        c = -(u12 * (b11 - b22) + b12 * (u22 - u11)) / trace
        X[0, 0], X[0, 1], X[1, 0], X[1, 1] = b11, b12 + c, b12 - c, b22
        for i in range(2):
            for j in range(2):
                stress[q, i, j] = R[q, i, 0] * X[0, j] + R[q, i, 1] * X[1, j]
        for k in range(2):
            for m in range(2):
                # Of a unit change of F_km: R^T dF, the angle, U, sym B and c.
                G[:] = 0.0
                G[0, m], G[1, m] = R[q, k, 0], R[q, k, 1]
                angle = -(G[0, 1] - G[1, 0]) / trace
                # R' = angle R J, J = (0, -1; 1, 0), so dU = R^T dF - angle J U.
                d11, d22 = G[0, 0] + angle * u12, G[1, 1] - angle * u12
                d12 = 0.5 * (G[0, 1] + G[1, 0] + angle * (u22 - u11))
                for i in range(2):
                    for j in range(2):
                        a = A[q, i, j]
                        dB[i, j] = -(a[0, 0] * d11 + (a[0, 1] + a[1, 0]) * d12 + a[1, 1] * d22)
                e12 = 0.5 * (dB[0, 1] + dB[1, 0])
                first = u12 * (dB[0, 0] - dB[1, 1]) + e12 * (u22 - u11)
                second = d12 * (b11 - b22) + b12 * (d22 - d11)
                dc = -(first + second + c * (d11 + d22)) / trace
                dX[0, 0], dX[0, 1] = dB[0, 0] - angle * X[1, 0], e12 + dc - angle * X[1, 1]
                dX[1, 0], dX[1, 1] = e12 - dc + angle * X[0, 0], dB[1, 1] + angle * X[0, 1]
                for i in range(2):
                    for j in range(2):
                        turned = R[q, i, 0] * dX[0, j] + R[q, i, 1] * dX[1, j]
                        tangent[q, i, j, k, m] = -turned
