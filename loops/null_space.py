"""Linear systems with null vectors, solved through them and never around them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loops.arrays import ROUNDING, Flags, Floats, Integers, all_finite, frobenius

# Singular values below this fraction of the largest count as zero. Rounding leaves about
# size * eps = 1e-15 to 1e-13 there (loops of 3 to 200 grains).
NULL_TOLERANCE = 1e-13


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
    tolerance: float = NULL_TOLERANCE,
) -> LeastSquares:
    """Solve `M x = b`, (..., N, N) and (..., N, R), for the solution of smallest norm.

    `observed` (..., O, N) are the rows that map `x` to what is wanted of it: a null vector that
    they do not see is harmless. `known` (..., N, Z) are orthonormal null vectors of `M` and of its
    transpose that they do not see either; where these are all there are, the inverse of
    `M + Z Z^T` solves it, elsewhere the singular values do, at ten times the cost.

    With `size`, the sum of the sizes of the terms behind every entry of `M`, comes a bound on the
    error of `Y b`, `Y` the observed rows of the inverse, of first order in the rounding `e`:
    `|Y| (|r| + e (size |x| + |b|))`, `r` what is left over. A null vector `v` of which `p` is
    observed adds `|p| |b_u| / s`, `s` the least that its singular value may be and `b_u` what loads
    it; everything if `s` may be zero, but for systems with `known` null vectors, which have others
    like them: nothing if `p` and `b_u` are rounding. Where `soft` (...) a vector is null but for a
    stiffness below rounding, and `p b_u` is rounding as well: everything there. `doubt` is what
    else `b` may err by. A system that is not finite has the solution nan and an infinite residual.
    """
    batch = matrix.shape[:-2]
    matrix, rhs, observed = (_flat(a, batch) for a in (matrix, rhs, observed))
    finite = all_finite(matrix) & all_finite(rhs)
    every = bool(finite.all())
    if not every:
        matrix = np.where(finite[:, None, None], matrix, 0.0)
    # Where other singular values are as small the known null vectors mix with theirs.
    bordered = matrix if known is None else matrix + known @ np.swapaxes(known, -1, -2)
    inverse, condition = _inverse(bordered)
    nullity = np.full(len(matrix), 0 if known is None else known.shape[-1])
    ambiguity = np.zeros(len(matrix))
    dropped = np.zeros((len(matrix), observed.shape[-2], rhs.shape[-1]))
    rest = np.flatnonzero(~(condition * tolerance < 1))
    if len(rest):
        inverse[rest], others, condition[rest], ambiguity[rest], dropped[rest] = (
            _by_singular_values(
                bordered[rest],
                rhs[rest],
                observed[rest],
                tolerance,
                None if size is None else _flat(size, batch)[rest],
                (known is not None) & ~np.broadcast_to(soft, batch).reshape(-1)[rest],
            )
        )
        nullity[rest] += others
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
        error = (np.abs(observed @ inverse) @ unsure + dropped).reshape(*batch, *dropped.shape[1:])
    return LeastSquares(
        x=x.reshape(*batch, *x.shape[-2:]),
        nullity=nullity.reshape(batch),
        condition=condition.reshape(batch),
        residual=residual.reshape(batch),
        ambiguity=ambiguity.reshape(batch),
        error=error,
    )


def _flat(a: Floats, batch: tuple[int, ...]) -> Floats:
    """One batch axis."""
    own = a if a.shape[:-2] == batch else np.broadcast_to(a, (*batch, *a.shape[-2:]))
    return own.reshape(-1, *a.shape[-2:])


def _inverse(matrix: Floats) -> tuple[Floats, Floats]:
    """Inverses and condition numbers, infinite where there is none."""
    try:
        inverse: Floats = np.asarray(np.linalg.inv(matrix), dtype=float)
    except np.linalg.LinAlgError:
        return np.zeros_like(matrix), np.full(len(matrix), np.inf)
    condition = frobenius(matrix) * frobenius(inverse)
    return inverse, np.where(np.isfinite(condition), condition, np.inf)


def _by_singular_values(
    matrix: Floats,
    rhs: Floats,
    observed: Floats,
    tolerance: float,
    size: Floats | None,
    mechanisms: Flags,
) -> tuple[Floats, Integers, Floats, Floats, Floats]:
    """Pseudo-inverse, nullity, condition, ambiguity, and what the null vectors might have added.

    The matrix errs by `E = e size`: so a singular value by `|u| E |v| + e s_max`, the load on its
    vector by `|u| (E |x| + e |b|)`, and what the observed rows see of it by `|Y| E |v|`. Where the
    singular value may vanish its vector may have added anything, unless the system has
    `mechanisms`, which are null exactly: there load and what is seen of them are rounding.
    """
    u, s, vt = np.linalg.svd(matrix)
    null = s <= tolerance * s[:, :1]
    scale = np.where(null, 0.0, 1.0 / np.where(null, 1.0, s))
    inverse = (np.swapaxes(vt, -1, -2) * scale[:, None, :]) @ np.swapaxes(u, -1, -2)
    v, ut = np.swapaxes(vt * null[..., None], -1, -2), np.swapaxes(u * null[:, None, :], -1, -2)
    seen, loaded = np.abs(observed @ v), np.abs(ut @ rhs)
    ambiguity = np.max(np.linalg.norm(seen, axis=-2), axis=-1)
    dropped = np.zeros((len(matrix), observed.shape[-2], rhs.shape[-1]))
    if size is not None:
        E, left, right = ROUNDING * size, np.abs(ut), np.abs(v)
        unsure = left @ (E @ np.abs(inverse @ rhs) + ROUNDING * np.abs(rhs))
        least = s - np.einsum("bsi,bij,bjs->bs", left, E, right) - ROUNDING * s[:, :1]
        lost = null & (least <= 0)
        known = null & ~lost
        weight = np.where(known, 1.0 / np.where(known, least, 1.0), 0.0)[:, None, :]
        reach = np.abs(observed @ inverse) @ (E @ right)
        dropped = ((seen + reach) * weight) @ (loaded + unsure)
        product = np.linalg.norm(seen, axis=-2) * np.linalg.norm(loaded, axis=-1)
        harmless = mechanisms[:, None] & (product <= (ROUNDING * s[:, :1]) ** 2)
        dropped[(lost & ~harmless).any(axis=-1)] = np.inf
    smallest = np.min(np.where(null, np.inf, s), axis=-1)
    return inverse, null.sum(axis=-1), s[:, 0] / smallest, ambiguity, dropped
