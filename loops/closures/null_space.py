"""Least-squares solutions of systems that have null vectors, with a bound on their error.

The matrix `M` is a sum of terms, `size` the sum of their sizes: it is known to `e size`, `e` the
rounding. Let `Y` be the observed rows of its inverse. To first order in `e` the observed part of
`x` errs by at most

    |Y| (|M x - b| + e (size |x| + |b|) + doubt)

and by what each null vector `v` may have added: `|p| |b_u| / s`, where `p` is the part of `v` that
is observed, `b_u` the part of `b` that loads it, and `s` the least that its singular value may be.
If `s` may be zero that is anything; but systems with known null vectors (translations) have others
like them (mechanisms), exactly null, which add nothing where `p` and `b_u` are rounding.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loops.arrays import ROUNDING, Flags, Floats, Integers, all_finite, frobenius

# Singular values below this fraction of the largest count as zero. Rounding leaves about
# size * eps = 1e-15 to 1e-13 there (loops of 3 to 200 grains).
NULL_TOLERANCE = 1e-13
# Limits within which a solve is trusted; see `MacroTangent`.
RESIDUAL_LIMIT = 1e-8
AMBIGUITY_LIMIT = 1e-6


@dataclass(frozen=True, eq=False)
class LeastSquares:
    """Least-squares solution of smallest norm, batch axes `...` first.

    `x` (..., N, R); `nullity`, `condition` (Frobenius, off the null vectors), `residual`
    (`|M x - b| / |b|`), `ambiguity` (largest part of a unit null vector that the observed rows
    see), all (...); `error` (..., O, R) bounds the error of the observed rows, None unless asked.
    """

    x: Floats
    nullity: Integers
    condition: Floats
    residual: Floats
    ambiguity: Floats
    error: Floats | None = None


def solve_through_null_space(
    matrix: Floats,
    rhs: Floats,
    observed: Floats,
    known: Floats | None = None,
    *,
    size: Floats | None = None,
    doubt: Floats | None = None,
    soft: Flags | bool = False,
) -> LeastSquares:
    """Solve `M x = b`, (..., N, N) and (..., N, R), for the solution of smallest norm.

    `observed` (..., O, N) are the rows that map `x` to what is wanted of it: a null vector that
    they do not see is harmless. `known` (..., N, Z) are orthonormal null vectors of `M` and of its
    transpose that they do not see either; where these are all there are, the inverse of
    `M + Z Z^T` solves it, elsewhere the singular values do, at ten times the cost.

    With `size` (..., N, N) comes the bound on the error, see above; `doubt` (..., N, R) is what
    else `b` may err by. Where `soft` (...) a vector is null but for a stiffness below rounding, and
    what it may add is not left out. A system that is not finite has the solution nan and an
    infinite residual.
    """
    batch = matrix.shape[:-2]
    matrix, rhs, observed = (_flat(a, batch) for a in (matrix, rhs, observed))
    finite = all_finite(matrix) & all_finite(rhs)
    every = bool(finite.all())
    if not every:
        matrix = np.where(finite[:, None, None], matrix, 0.0)
    # Where other singular values are as small the known null vectors mix with theirs.
    bordered = matrix if known is None else matrix + known @ np.swapaxes(known, -1, -2)
    try:
        inverse: Floats = np.asarray(np.linalg.inv(bordered), dtype=float)
        condition = frobenius(bordered) * frobenius(inverse)
        condition = np.where(np.isfinite(condition), condition, np.inf)
    except np.linalg.LinAlgError:
        inverse, condition = np.zeros_like(bordered), np.full(len(bordered), np.inf)
    nullity = np.full(len(matrix), 0 if known is None else known.shape[-1])
    ambiguity = np.zeros(len(matrix))
    added = np.zeros((len(matrix), observed.shape[-2], rhs.shape[-1]))
    rest = np.flatnonzero(~(condition * NULL_TOLERANCE < 1))
    if len(rest):
        null = _null_vectors(bordered[rest])
        inverse[rest], condition[rest] = null.inverse, null.condition
        nullity[rest] += null.count
        seen = np.abs(observed[rest] @ null.right)
        ambiguity[rest] = np.max(np.linalg.norm(seen, axis=-2), axis=-1)
        if size is not None:
            mechanisms = ~np.broadcast_to(soft, batch).reshape(-1)[rest] & (known is not None)
            own = observed[rest], seen, _flat(size, batch)[rest], mechanisms
            added[rest] = _added_by_null_vectors(null, rhs[rest], *own)
    x = inverse @ rhs
    # One step of refinement: an inverse alone leaves a residual of condition times rounding.
    x += inverse @ (rhs - matrix @ x)
    left = np.abs(matrix @ x - rhs)
    load = frobenius(rhs)
    residual = frobenius(left) / np.where(load > 0, load, 1.0)
    if not every:
        x[~finite] = np.nan
        condition[~finite] = residual[~finite] = ambiguity[~finite] = np.inf
    error = None
    if size is not None:
        unsure = _flat(size, batch) @ np.abs(x if every else np.nan_to_num(x))
        unsure += np.abs(rhs)
        unsure *= ROUNDING
        unsure += left
        if doubt is not None:
            unsure += _flat(doubt, batch)
        error = (np.abs(observed @ inverse) @ unsure + added).reshape(*batch, *added.shape[1:])
    return LeastSquares(
        x=x.reshape(*batch, *x.shape[-2:]),
        nullity=nullity.reshape(batch),
        condition=condition.reshape(batch),
        residual=residual.reshape(batch),
        ambiguity=ambiguity.reshape(batch),
        error=error,
    )


def _flat(a: Floats, batch: tuple[int, ...]) -> Floats:
    """Return an array with its batch axes as one."""
    own = a if a.shape[:-2] == batch else np.broadcast_to(a, (*batch, *a.shape[-2:]))
    return own.reshape(-1, *a.shape[-2:])


@dataclass(frozen=True, eq=False)
class _NullVectors:
    """Null vectors of B matrices, and their inverses beside them.

    `values` (B, N) are all singular values, `null` (B, N) marks those that count as zero; `left`
    (B, N, N) has their left vectors as rows, `right` (B, N, N) the right ones as columns, zero at
    the other values. `inverse` is the pseudo-inverse, `condition` (B,) its own, `count` (B,).
    """

    values: Floats
    null: Flags
    left: Floats
    right: Floats
    inverse: Floats
    condition: Floats
    count: Integers


def _null_vectors(matrix: Floats) -> _NullVectors:
    """Return the null vectors of matrices (B, N, N) by their singular values."""
    u, s, vt = np.linalg.svd(matrix)
    null = s <= NULL_TOLERANCE * s[:, :1]
    scale = np.where(null, 0.0, 1.0 / np.where(null, 1.0, s))
    smallest = np.min(np.where(null, np.inf, s), axis=-1)
    return _NullVectors(
        values=s,
        null=null,
        left=np.swapaxes(u * null[:, None, :], -1, -2),
        right=np.swapaxes(vt * null[..., None], -1, -2),
        inverse=(np.swapaxes(vt, -1, -2) * scale[:, None, :]) @ np.swapaxes(u, -1, -2),
        condition=s[:, 0] / smallest,
        count=null.sum(axis=-1),
    )


def _added_by_null_vectors(
    of: _NullVectors, rhs: Floats, observed: Floats, seen: Floats, size: Floats, mechanisms: Flags
) -> Floats:
    """Return what null vectors might have added to the observed part of the solution (B, O, R).

    The matrix errs by `E = e size`: so a singular value by `|u| E |v| + e s_max`, the load on its
    vector by `|u| (E |x| + e |b|)`, and what the observed rows see of it by `|Y| E |v|`. Where
    there are `mechanisms` (B,) vectors that may be null exactly add nothing if what is `seen` of
    them and what loads them are rounding.
    """
    E, left, right = ROUNDING * size, np.abs(of.left), np.abs(of.right)
    largest = of.values[:, :1]
    loaded = np.abs(of.left @ rhs)
    unsure = left @ (E @ np.abs(of.inverse @ rhs) + ROUNDING * np.abs(rhs))
    least = of.values - np.einsum("bsi,bij,bjs->bs", left, E, right) - ROUNDING * largest
    vanishing = of.null & (least <= 0)
    known = of.null & ~vanishing
    weight = np.where(known, 1.0 / np.where(known, least, 1.0), 0.0)[:, None, :]
    reach = np.abs(observed @ of.inverse) @ (E @ right)
    added = ((seen + reach) * weight) @ (loaded + unsure)
    product = np.linalg.norm(seen, axis=-2) * np.linalg.norm(loaded, axis=-1)
    harmless = mechanisms[:, None] & (product <= (ROUNDING * largest) ** 2)
    added[(vanishing & ~harmless).any(axis=-1)] = np.inf
    return np.asarray(added)
