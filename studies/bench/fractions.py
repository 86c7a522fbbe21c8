"""Unstable fractions of three eigenvalues: closed form, Imhof's integral, sampled directions."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from scipy.integrate import quad
from scipy.stats import norm, qmc

from loops.arrays import Floats
from stability import imhof_fraction, unstable_fraction
from studies.bench.measure import Row, largest, measured
from studies.fifty_digits import DIGITS

ORACLE = "mean over the azimuth, 50 digits"
STEPS = (2.0, 1.0, 0.5, 0.25, 0.125)
DEFAULT_STEP = 0.25
DIRECTIONS = (8, 11, 14, 17)
# Operators at a time, as in the code.
CHUNK = 1024

# Wide, narrow and nearly closed cones, one with a soft positive eigenvalue.
SPECTRA = np.array(
    [
        [-0.2, 0.4, 1.0],
        [-1.0, 0.5, 0.7],
        [-1e-3, 0.3, 1.0],
        [-1e-6, 0.2, 0.2],
        [-1e-9, 0.9, 1.0],
        [-0.3, 1e-4, 1.0],
    ]
)


def fraction_methods(quick: bool) -> list[Row]:
    """Time and absolute error of the unstable fraction."""
    exact = np.array([fraction_50(spectrum) for spectrum in SPECTRA])
    many = np.tile(SPECTRA, (100 if quick else 2000, 1))
    rows = [
        _row("closed form", "Carlson's integrals", partial(unstable_fraction, many), len(many),
             unstable_fraction(SPECTRA) - exact, quick, default=True),
    ]  # fmt: skip
    for step in STEPS:
        call = partial(imhof, many, step)
        label = f"step {step:g}{', the default' if step == DEFAULT_STEP else ''}"
        rows.append(
            _row("Imhof, trapezoid in ln u", label, call, len(many), imhof(SPECTRA, step) - exact,
                 quick)
        )  # fmt: skip
    rows.append(
        _row("imhof_fraction", "as in the code", partial(imhof_fraction, many), len(many),
             imhof_fraction(SPECTRA) - exact, quick)
    )  # fmt: skip
    rows.append(
        _row("Imhof, scipy quad", "adaptive", partial(_by_quad, SPECTRA), len(SPECTRA),
             _by_quad(SPECTRA) - exact, quick)
    )  # fmt: skip
    for power in DIRECTIONS[: 2 if quick else None]:
        for name, sequence in (("random directions", _normals), ("Sobol directions", _sobol)):
            found = sampled(SPECTRA, sequence(power))
            call = partial(_sampled_anew, sequence, power)
            rows.append(_row(name, f"{2**power:,}", call, len(SPECTRA), found - exact, quick))
    return rows


def imhof(spectra: Floats, step: float) -> Floats:
    """Imhof's integral by the trapezoidal rule in `ln u`, any step."""
    nodes = np.exp(np.arange(-40.0, 80.0 + step, step))
    pieces = [_imhof(spectra[k : k + CHUNK], nodes) for k in range(0, len(spectra), CHUNK)]
    return 0.5 - step * np.concatenate(pieces) / np.pi


def _imhof(spectra: Floats, nodes: Floats) -> Floats:
    scaled = spectra / np.abs(spectra).max(axis=1, keepdims=True)
    angle, amplitude = np.zeros((len(spectra), len(nodes))), 1.0
    for value in scaled.T:
        x = np.multiply.outer(value, nodes)
        angle += 0.5 * np.arctan(x)
        amplitude = amplitude / np.sqrt(np.sqrt(1.0 + x * x))
    return np.asarray((np.sin(angle) * amplitude).sum(axis=-1))


def sampled(spectra: Floats, directions: Floats) -> Floats:
    """Share of directions with a negative form."""
    return np.asarray((spectra @ (directions * directions).T < 0.0).mean(axis=1))


def fraction_50(spectrum: Floats) -> float:
    """Fraction of one negative and two positive eigenvalues: a mean over the azimuth.

    With `z^2 > g(phi) (x^2 + y^2)`, `g = a cos^2 + b sin^2`, the fraction is the mean of
    `1 - sqrt(g/(1 + g))`, a periodic function: the trapezoidal rule converges geometrically.
    """
    import mpmath as mp

    with mp.workdps(DIGITS):
        low, a, b = (mp.mpf(float(value)) for value in spectrum)
        a, b = -a / low, -b / low

        def share(phi: Any) -> Any:
            g = a * mp.cos(phi) ** 2 + b * mp.sin(phi) ** 2
            return 1 / (1 + g) / (1 + mp.sqrt(g / (1 + g)))

        points = [0, mp.pi / 64, mp.pi / 8, mp.pi / 2]
        points = points if a <= b else [mp.pi / 2 - point for point in reversed(points)]
        return float(2 / mp.pi * mp.quad(share, points))


def _by_quad(spectra: Floats) -> Floats:
    def integrand(u: float, values: Floats) -> float:
        angle = 0.5 * np.arctan(values * u).sum()
        return float(np.sin(angle) / (u * np.prod((1.0 + (values * u) ** 2) ** 0.25)))

    scaled = spectra / np.abs(spectra).max(axis=1, keepdims=True)
    areas = [quad(integrand, 0.0, np.inf, args=(row,), limit=200)[0] for row in scaled]
    return 0.5 - np.array(areas) / np.pi


def _normals(power: int) -> Floats:
    return np.random.default_rng(power).standard_normal((2**power, 3))


def _sobol(power: int) -> Floats:
    points = qmc.Sobol(3, rng=np.random.default_rng(power)).random_base2(power)
    return np.asarray(norm.ppf(np.maximum(points, 2.0**-64)))


def _sampled_anew(sequence: Any, power: int) -> Floats:
    return sampled(SPECTRA, sequence(power))


def _row(
    method: str,
    setting: str,
    call: Any,
    items: int,
    gap: Floats,
    quick: bool,
    default: bool = False,
) -> Row:
    return measured(
        call,
        items,
        quick=quick,
        group="cone fractions",
        method=method,
        setting=setting,
        error=largest(np.abs(gap)),
        oracle=ORACLE,
        default=default,
    )
