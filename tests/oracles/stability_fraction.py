"""Unstable fractions of directions in many digits, by routes other than the package's.

In space the solid angle is averaged over the azimuth, without elliptic integrals; with more
eigenvalues Imhof's integral is taken with enough digits to keep the small fractions; forms with two
distinct eigenvalues are ratios of chi-squared variables, hence incomplete beta functions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import mpmath as mp
import numpy as np

DIGITS = 45


def plane_fraction(eigenvalues: Sequence[float]) -> mp.mpf:
    """Two eigenvalues of opposite sign: arccos(m/R)/pi, q = m + R cos 2(theta - theta0)."""
    with mp.workdps(3 * DIGITS):
        low, high = sorted(mp.mpf(value) for value in eigenvalues)
        return mp.acos((low + high) / (high - low)) / mp.pi


def space_fraction(eigenvalues: Sequence[float]) -> mp.mpf:
    """Three eigenvalues, not all of one sign: mean over the azimuth of the polar cap's share."""
    with mp.workdps(DIGITS):
        values = sorted(mp.mpf(value) for value in eigenvalues)
        if values[1] >= 0:
            return _azimuth_mean(values[2] / -values[0], values[1] / -values[0], _cap)
        return _azimuth_mean(-values[0] / values[2], -values[1] / values[2], _rest)


def imhof_fraction(eigenvalues: Sequence[float]) -> mp.mpf:
    """Any number of eigenvalues: Imhof's integral."""
    with mp.workdps(DIGITS):
        largest = max(abs(mp.mpf(value)) for value in eigenvalues)
        values = [mp.mpf(value) / largest for value in eigenvalues]

        def integrand(v: mp.mpf) -> mp.mpf:
            u = mp.exp(v)
            angle = mp.fsum(mp.atan(value * u) for value in values) / 2
            return mp.sin(angle) / mp.fprod(mp.root(1 + (value * u) ** 2, 4) for value in values)

        return mp.mpf(1) / 2 - _trapezoid(integrand, -110, 220) / mp.pi


def imhof_in_doubles(eigenvalues: Sequence[float]) -> float:
    """Imhof's integral by the trapezoidal rule in `ln u`: errors of some roundings."""
    u = np.exp(np.arange(-40.0, 80.25, 0.25))
    x = np.multiply.outer(np.asarray(eigenvalues) / np.abs(eigenvalues).max(), u)
    values = np.sin(0.5 * np.arctan(x).sum(axis=0)) / np.prod((1.0 + x * x) ** 0.25, axis=0)
    return float(0.5 - 0.25 * values.sum() / np.pi)


def two_valued_fraction(ratio: float, positive: int, negative: int) -> mp.mpf:
    """`positive` eigenvalues 1 and `negative` eigenvalues -ratio: P(chi2_p < ratio chi2_n)."""
    with mp.workdps(DIGITS):
        c = mp.mpf(ratio)
        half_p, half_n = mp.mpf(positive) / 2, mp.mpf(negative) / 2
        return mp.betainc(half_p, half_n, 0, c / (1 + c), regularized=True)


def _cap(g: mp.mpf) -> mp.mpf:
    """Twice the polar cap z^2 > g (x^2 + y^2) over the sphere: 1 - sqrt(g/(1 + g))."""
    return 1 / ((1 + g) * (1 + mp.sqrt(g / (1 + g))))


def _rest(g: mp.mpf) -> mp.mpf:
    return mp.sqrt(g / (1 + g))


def _azimuth_mean(a: mp.mpf, b: mp.mpf, share: Callable[[mp.mpf], mp.mpf]) -> mp.mpf:
    """Mean of share(a cos^2 + b sin^2), with the azimuth written as atan(e^v)."""

    def integrand(v: mp.mpf) -> mp.mpf:
        square = mp.exp(2 * v)
        return share((a + b * square) / (1 + square)) / mp.cosh(v)

    return _trapezoid(integrand, -110, 110) / mp.pi


def _trapezoid(integrand: Callable[[mp.mpf], mp.mpf], start: int, stop: int) -> mp.mpf:
    """Step 1/10 for an integrand analytic in |Im v| < pi/2: error exp(-10 pi^2) = 1e-43."""
    return mp.fsum(integrand(mp.mpf(k) / 10) for k in range(10 * start, 10 * stop + 1)) / 10
