"""Unstable fractions of three eigenvalues: closed form, Imhof's integral, sampled directions."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from scipy.integrate import quad
from scipy.stats import norm, qmc

from loops.arrays import Floats
from stability import unstable_fraction
from tests.benchmarks.methods import Rows
from tests.oracles.fifty_digits import DIGITS

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


def fraction_methods(quick: bool) -> Rows:
    """Time and absolute error of the unstable fraction."""
    exact = np.array([fraction_50(spectrum) for spectrum in SPECTRA])
    many = np.tile(SPECTRA, (100 if quick else 2000, 1))
    ways: list[tuple[str, str, Callable[[Floats], Floats], Floats]] = [
        ("closed form", "Carlson's integrals", unstable_fraction, many)
    ]
    for step in STEPS:
        label = f"step {step:g}{', the default' if step == DEFAULT_STEP else ''}"
        ways.append(("Imhof, trapezoid in ln u", label, partial(imhof, step=step), many))
    ways.append(("Imhof, scipy quad", "adaptive", _by_quad, SPECTRA))
    for power in DIRECTIONS[: 2 if quick else None]:
        for name, drawn in (("random directions", _normals), ("Sobol directions", _sobol)):
            sampled = partial(_sampled, sequence=drawn, power=power)
            ways.append((name, f"{2**power:,}", sampled, SPECTRA))
    rows = Rows("cone fractions", ORACLE, quick)
    for method, setting, way, spectra in ways:
        call, default = partial(way, spectra), way is unstable_fraction
        rows.add(method, setting, call, way(SPECTRA) - exact, len(spectra), default)
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


def _sampled(spectra: Floats, sequence: Callable[[int], Floats], power: int) -> Floats:
    """Share of so many directions, drawn anew, with a negative form."""
    directions = sequence(power)
    return np.asarray((spectra @ (directions * directions).T < 0.0).mean(axis=1))
