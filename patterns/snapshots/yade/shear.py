"""Signs of shear forces from the balance of the grains, where a file has magnitudes alone."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from loops.arrays import Flags, Floats, Integers
from patterns.snapshots.checks import on_rim

if TYPE_CHECKING:
    import scipy.sparse as sp

# A sign is decided if turning it adds so many squares of the residual's root mean square.
DECIDED = 25.0
ROUNDS = 100


class Signs(NamedTuple):
    """Signs (C,), 1 or -1; whether turning one would show; what the balances leave.

    The `residual` is a root mean square over the mean normal force.
    """

    sign: Floats
    decided: Flags
    residual: float


def shear_signs(
    x: Floats, radii: Floats, pairs: Integers, normal: Floats, magnitude: Floats
) -> Signs:
    """Signs of `T` that balance the forces and moments of the grains best.

    From the least-squares solution, then each is turned that betters the balance. Grains on the
    rim, where walls may push, take part with their moments alone: frictionless walls have none.
    """
    from scipy.sparse.linalg import lsqr

    matrix, load = _balances(x, radii, pairs, normal)
    least = lsqr(matrix, -load, atol=1e-10, btol=1e-10, iter_lim=2000)[0]
    sign = np.where(least >= 0, 1.0, -1.0)
    weight = np.asarray(matrix.multiply(matrix).sum(axis=0)).ravel()
    for _ in range(ROUNDS):
        rest = matrix @ (sign * magnitude) + load
        # What turning one sign adds to the sum of squares.
        cost = 4 * magnitude * (magnitude * weight - sign * (matrix.T @ rest))
        turned = _lowest_of_both(cost, pairs, len(x)) & (cost < -1e-12 * np.sum(rest**2))
        if not turned.any():
            break
        sign[turned] *= -1
    mean_square = float(np.mean(rest**2)) if len(rest) else 0.0
    scale = float(np.abs(normal).mean()) or 1.0
    return Signs(sign, cost > DECIDED * mean_square, mean_square**0.5 / scale)


def _balances(
    x: Floats, radii: Floats, pairs: Integers, normal: Floats
) -> tuple[sp.csr_matrix, Floats]:
    """Matrix and load of `A T + b = 0`: force x, force y and moment over radius of each grain.

    A shear force `T t` on grain 2 and `-T t` on grain 1 turn both the same way: the moment over
    the radius is `-T` for either.
    """
    import scipy.sparse as sp

    grains, contacts = len(x), np.arange(len(pairs))
    d = x[pairs[:, 1]] - x[pairs[:, 0]]
    n = d / np.hypot(*d.T)[:, None]
    t = np.column_stack([-n[:, 1], n[:, 0]])
    one, two = pairs.T
    ones = np.ones(len(pairs))
    rows = np.concatenate([3 * g + k for g in (one, two) for k in (0, 1, 2)])
    values = np.concatenate([-t[:, 0], -t[:, 1], -ones, t[:, 0], t[:, 1], -ones])
    matrix = sp.csr_matrix((values, (rows, np.tile(contacts, 6))), shape=(3 * grains, len(pairs)))
    load = np.zeros((grains, 3))
    for k in (0, 1):
        force = normal * n[:, k]
        load[:, k] = np.bincount(two, force, grains) - np.bincount(one, force, grains)
    known = np.repeat(np.bincount(pairs.ravel(), minlength=grains)[:, None] > 0, 3, axis=1)
    known[on_rim(x, radii, known[:, 0]), :2] = False
    keep = np.flatnonzero(known.ravel())
    return matrix[keep], load.ravel()[keep]


def _lowest_of_both(cost: Floats, pairs: Integers, grains: int) -> Flags:
    """Contacts of lowest cost at both of their grains: these can be turned at once."""
    lowest = np.full(grains, np.inf)
    for side in (0, 1):
        np.minimum.at(lowest, pairs[:, side], cost)
    return np.asarray((cost == lowest[pairs[:, 0]]) & (cost == lowest[pairs[:, 1]]))
