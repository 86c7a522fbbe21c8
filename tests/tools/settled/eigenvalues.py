"""Eigenvalues of many symmetric 3 x 3 operators: closed form, Jacobi's rotations, LAPACK."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from loops.arrays import Floats
from stability import symmetric_spectrum
from tests.benchmarks.methods import Rows
from tests.oracles.fifty_digits import DIGITS

ORACLE = "mpmath eigsy, 50 digits"
SWEEPS = (2, 3, 4, 5, 6)
PAIRS = ((0, 1), (0, 2), (1, 2))
# Gaps of the lower two eigenvalues over the largest, and the smallest eigenvalue itself.
SPLITS = (0.3, 1e-4, 1e-8, 1e-12, 0.0)


def eigenvalue_methods(quick: bool) -> Rows:
    """Time and error, over the largest eigenvalue, of operators with wide, narrow and no gaps."""
    operators = sample(2000 if quick else 50_000)
    checked = operators[: 10 if quick else 40]
    exact = np.array([_exact(K) for K in checked])
    size = np.abs(exact).max(axis=1, keepdims=True)
    rows = Rows("eigenvalues", ORACLE, quick)
    ways: list[tuple[str, str, Callable[[Floats], Floats]]] = [
        ("closed form", "cubic by cosines", closed_form),
        ("LAPACK", "eigvalsh", symmetric_spectrum),
        *(("Jacobi, numpy", f"{n} sweeps", partial(jacobi, sweeps=n)) for n in SWEEPS),
    ]
    for method, setting, way in ways:
        gap, default = (way(checked) - exact) / size, way is symmetric_spectrum
        rows.add(method, setting, partial(way, operators), gap, len(operators), default)
    return rows


def sample(count: int) -> Floats:
    """Rotated operators, the two lower eigenvalues apart by one of `SPLITS`, by turns."""
    rng = np.random.default_rng(11)
    frame = np.linalg.qr(rng.standard_normal((count, 3, 3)))[0]
    split = np.resize(SPLITS, count)
    low = np.where(np.arange(count) % 2 == 0, 0.2, 1e-9)
    values = np.stack([low, low + split, np.ones(count)], axis=-1)
    K = (frame * values[:, None, :]) @ np.swapaxes(frame, 1, 2)
    return 0.5 * (K + np.swapaxes(K, 1, 2))


def closed_form(K: Floats) -> Floats:
    """Eigenvalues by the cosines of a third of an angle (Smith 1961), ascending."""
    mean = np.trace(K, axis1=-2, axis2=-1) / 3.0
    rest = K - mean[..., None, None] * np.eye(3)
    size = np.sqrt((rest * rest).sum(axis=(-2, -1)) / 6.0)
    scaled = rest / np.where(size > 0.0, size, 1.0)[..., None, None]
    third = np.arccos(np.clip(0.5 * np.linalg.det(scaled), -1.0, 1.0)) / 3.0
    turns = third[..., None] + 2.0 * np.pi / 3.0 * np.array([1.0, 2.0, 0.0])
    return np.asarray(mean[..., None] + 2.0 * size[..., None] * np.cos(turns))


def jacobi(K: Floats, sweeps: int) -> Floats:
    """Eigenvalues by cyclic rotations, the whole batch at once, ascending."""
    a = K.copy()
    for _ in range(sweeps):
        for p, q in PAIRS:
            r = 3 - p - q
            _rotate(a, p, q, r)
    return np.sort(np.diagonal(a, axis1=-2, axis2=-1), axis=-1)


def _rotate(a: Floats, p: int, q: int, r: int) -> None:
    off, gap = a[..., p, q].copy(), a[..., q, q] - a[..., p, p]
    # The smaller root of t^2 + 2 (gap / 2 off) t - 1 = 0, safe where off is zero.
    bottom = np.abs(gap) + np.sqrt(gap * gap + 4.0 * off * off)
    signed = np.where(gap < 0.0, -2.0 * off, 2.0 * off)
    t = np.divide(signed, bottom, out=np.zeros_like(off), where=bottom > 0.0)
    c = 1.0 / np.sqrt(1.0 + t * t)
    s = t * c
    a[..., p, p] -= t * off
    a[..., q, q] += t * off
    a[..., p, q] = a[..., q, p] = 0.0
    rp, rq = a[..., r, p].copy(), a[..., r, q].copy()
    a[..., r, p] = a[..., p, r] = c * rp - s * rq
    a[..., r, q] = a[..., q, r] = s * rp + c * rq


def _exact(K: Floats) -> list[float]:
    import mpmath as mp

    with mp.workdps(DIGITS):
        return sorted(float(value) for value in mp.eigsy(mp.matrix(K.tolist()), eigvals_only=True))
