"""Linear systems with null vectors, solved through them and never around them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loops.arrays import Floats, Integers

# Singular values below this fraction of the largest count as zero. Rounding leaves about
# size * eps = 1e-15 to 1e-13 there (loops of 3 to 200 grains).
NULL_TOLERANCE = 1e-13


@dataclass(frozen=True, eq=False)
class LeastSquares:
    """Least-squares solution of smallest norm, batch axes `...` first.

    Attributes
    ----------
    x : (..., N, R) array
        Solution.
    nullity : (...) array of int
        Number of null vectors met.
    condition : (...) array
        Condition number of the system off its null vectors.
    residual : (...) array
        `|M x - b| / |b|`, Frobenius; 0 if `b` is zero.
    ambiguity : (...) array
        Largest part of a unit null vector that the observed rows see; 0 if there is none.
    """

    x: Floats
    nullity: Integers
    condition: Floats
    residual: Floats
    ambiguity: Floats


def solve_through_null_space(
    matrix: Floats,
    rhs: Floats,
    observed: Floats,
    known: Floats | None = None,
    tolerance: float = NULL_TOLERANCE,
) -> LeastSquares:
    """Solve `M x = b` in the least-squares sense, with the solution of smallest norm.

    Where the known null vectors Z are all there are, the inverse of `M + Z Z^T` gives it at the
    cost of one elimination; elsewhere the singular values do, at ten times the cost.

    Parameters
    ----------
    matrix : (..., N, N) array
        System, scaled so that its rows and columns are comparable.
    rhs : (..., N, R) array
        Right-hand sides.
    observed : (..., O, N) array
        Rows that map `x` to what is wanted of it: a null vector that they do not see is harmless.
    known : (..., N, Z) array, optional
        Orthonormal null vectors of `M` and of its transpose that are known beforehand and that
        `observed` does not see.
    tolerance : float
        Singular values below this fraction of the largest are null.

    Returns
    -------
    LeastSquares
        Solution, nullity, condition, residual and ambiguity. A system that is not finite has no
        solution (nan) and an infinite residual.

    Examples
    --------
    >>> import numpy as np
    >>> from loops.null_space import solve_through_null_space
    >>> matrix = np.array([[1.0, -1.0], [-1.0, 1.0]])
    >>> found = solve_through_null_space(matrix, np.array([[2.0], [-2.0]]), np.eye(2))
    >>> found.x.round(12).ravel().tolist(), int(found.nullity), round(float(found.ambiguity), 3)
    ([1.0, -1.0], 1, 1.0)
    """
    batch = matrix.shape[:-2]
    matrix = matrix.reshape(-1, *matrix.shape[-2:])
    rhs = np.broadcast_to(rhs, (*batch, *rhs.shape[-2:])).reshape(-1, *rhs.shape[-2:])
    observed = np.broadcast_to(observed, (*batch, *observed.shape[-2:]))
    observed = observed.reshape(-1, *observed.shape[-2:])
    finite = np.asarray(np.isfinite(matrix).all(axis=(-2, -1)))
    finite &= np.isfinite(rhs).all(axis=(-2, -1))
    matrix = np.where(finite[:, None, None], matrix, 0.0)
    inverse, condition = _bordered_inverse(matrix, known)
    regular = condition * tolerance < 1
    inverse = np.where(regular[:, None, None], inverse, 0.0)
    x = inverse @ rhs
    # One step of refinement: an inverse alone leaves a residual of condition times rounding.
    x = x + inverse @ (rhs - matrix @ x)
    nullity = np.full(len(matrix), 0 if known is None else known.shape[-1])
    ambiguity = np.zeros(len(matrix))
    rest = np.flatnonzero(~regular)
    if len(rest):
        x[rest], nullity[rest], condition[rest], ambiguity[rest] = _by_singular_values(
            matrix[rest], rhs[rest], observed[rest], tolerance
        )
    size = np.linalg.norm(rhs, axis=(-2, -1))
    residual = np.linalg.norm(matrix @ x - rhs, axis=(-2, -1)) / np.where(size > 0, size, 1.0)
    x[~finite] = np.nan
    condition[~finite] = residual[~finite] = ambiguity[~finite] = np.inf
    return LeastSquares(
        x=x.reshape(*batch, *x.shape[-2:]),
        nullity=nullity.reshape(batch),
        condition=condition.reshape(batch),
        residual=residual.reshape(batch),
        ambiguity=ambiguity.reshape(batch),
    )


def _bordered_inverse(matrix: Floats, known: Floats | None) -> tuple[Floats, Floats]:
    """Inverse of `M + Z Z^T` and its condition number, infinite where there is none."""
    bordered = matrix if known is None else matrix + known @ np.swapaxes(known, -1, -2)
    try:
        inverse: Floats = np.asarray(np.linalg.inv(bordered), dtype=float)
    except np.linalg.LinAlgError:
        return np.zeros_like(matrix), np.full(len(matrix), np.inf)
    condition = _frobenius(bordered) * _frobenius(inverse)
    return inverse, np.where(np.isfinite(condition), condition, np.inf)


def _by_singular_values(
    matrix: Floats, rhs: Floats, observed: Floats, tolerance: float
) -> tuple[Floats, Integers, Floats, Floats]:
    u, s, vt = np.linalg.svd(matrix)
    null = s <= tolerance * s[:, :1]
    inverse = np.where(null, 0.0, 1.0 / np.where(null, 1.0, s))
    x = np.swapaxes(vt, -1, -2) @ (inverse[..., None] * (np.swapaxes(u, -1, -2) @ rhs))
    seen = observed @ np.swapaxes(vt * null[..., None], -1, -2)
    smallest = np.min(np.where(null, np.inf, s), axis=-1)
    ambiguity = np.max(np.linalg.norm(seen, axis=-2), axis=-1)
    return x, null.sum(axis=-1), s[:, 0] / smallest, ambiguity


def _frobenius(matrix: Floats) -> Floats:
    return np.asarray(np.linalg.norm(matrix, axis=(-2, -1)), dtype=float)
