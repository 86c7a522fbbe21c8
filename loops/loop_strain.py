"""Displacement gradients: of a loop from its boundary, of a cloud of grains, and their rotation."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Floats
from loops.errors import InputError
from loops.geometry import boundary_vectors, polygon_area


def loop_strain(x0: ArrayLike, x: ArrayLike) -> Floats:
    """Displacement gradient (..., 2, 2) of loops whose corners (..., n, 2) moved from `x0` to `x`.

    By the boundary formula (Theory, equation (4.6)), `H = -(1/V0) sum u_i (x) B_i` with the
    boundary vectors of the reference: the mean over the polygon of a displacement that is linear
    along every side; exact for an affine motion `x = F x0 + c`, where `H = 1 - F`. `InputError` for
    a polygon without area.

    >>> square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    >>> loop_strain(square, square * [0.75, 1.0]).tolist()
    [[0.25, 0.0], [0.0, 0.0]]
    """
    start, end = np.asarray(x0, dtype=float), np.asarray(x, dtype=float)
    if start.shape != end.shape or start.ndim < 2 or start.shape[-1] != 2:
        where, expected = "corners of the loops", "two arrays of one shape (..., n, 2)"
        received = f"shapes {start.shape} and {end.shape}"
        raise InputError(where, received, expected, "Give the same grains in the same order.")
    area = np.abs(polygon_area(start))
    if not np.all(area > 0):
        where, received = "reference polygon of a loop", f"area {np.min(area)}"
        raise InputError(where, received, "a positive area", "The centres must not lie on a line.")
    u = (end - end[..., :1, :]) - (start - start[..., :1, :])
    return -np.swapaxes(u, -1, -2) @ boundary_vectors(start) / area[..., None, None]


def best_fit_strain(x0: ArrayLike, x: ArrayLike) -> Floats:
    """Displacement gradient (..., 2, 2) that fits the motion of grains (..., G, 2) best.

    Minimises `sum |x - c - (1 - H) x0|^2` over `H` and `c`: for a sample without a cell, whose
    walls are not known. `InputError` for centres on a line.
    """
    start, end = np.asarray(x0, dtype=float), np.asarray(x, dtype=float)
    if start.shape != end.shape or start.ndim < 2 or start.shape[-1] != 2:
        received = f"shapes {start.shape} and {end.shape}"
        raise InputError("centres", received, "one shape (..., G, 2)", "Pair them.")
    if start.shape[-2] < 3:
        raise InputError("centres", f"{start.shape[-2]} grains", "at least 3", "Add grains.")
    r = start - start.mean(axis=-2, keepdims=True)
    u = end - start
    u = u - u.mean(axis=-2, keepdims=True)
    spread = np.swapaxes(r, -1, -2) @ r
    trace = np.trace(spread, axis1=-2, axis2=-1)
    # Centres on a line leave the gradient across it open.
    if not np.all(np.linalg.det(spread) > 1e-20 * trace**2):
        raise InputError(
            "centres", "all on a line", "grains that span the plane", "Give more grains."
        )
    moment = np.swapaxes(u, -1, -2) @ r
    return -np.swapaxes(np.linalg.solve(spread, np.swapaxes(moment, -1, -2)), -1, -2)


def rotation_and_stretch(H: ArrayLike) -> tuple[Floats, Floats]:
    """Split `F = 1 - H` into rotation and stretch, `F = R U`: the angle of `R` (...), and `1 - U`.

    Radians in (-pi, pi], counter-clockwise positive; `1 - U` (..., 2, 2), compression positive, is
    what `H` becomes without the rotation.

    >>> turned = np.array([[0.0, -1.0], [1.0, 0.0]]) @ np.diag([0.5, 1.0])
    >>> angle, strain = rotation_and_stretch(np.eye(2) - turned)
    >>> round(float(np.degrees(angle)), 12), strain.round(12).tolist()
    (90.0, [[0.5, 0.0], [0.0, 0.0]])
    """
    # 1 - U from H itself: with U from F, strains of 1e-10 would lose ten digits.
    gradient = np.asarray(H, dtype=float)
    spin = gradient[..., 0, 1] - gradient[..., 1, 0]
    trace = 2.0 - gradient[..., 0, 0] - gradient[..., 1, 1]
    angle = np.arctan2(spin, trace)
    back = rotation_minus_one(-angle)
    strain = gradient + back @ gradient - back
    return angle, 0.5 * (strain + np.swapaxes(strain, -1, -2))


def rotation_minus_one(angle: ArrayLike) -> Floats:
    """`R - 1` of rotations by `angle`, to full relative precision for small ones."""
    turn = np.asarray(angle, dtype=float)
    s, versine = np.sin(turn), 2.0 * np.sin(0.5 * turn) ** 2
    return np.stack([np.stack([-versine, -s], axis=-1), np.stack([s, -versine], axis=-1)], axis=-2)
