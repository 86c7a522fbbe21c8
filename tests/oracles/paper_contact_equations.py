"""Equations (1)-(16) of contacts, kinematics and balance against independent derivations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import quad

from loops import GrainGraph, contact_forces, contact_frame
from tests.oracles.diamond import (
    TABLE_1,
    TABLE_2,
    contact_displacement_rates,
    force_rates,
    side_lengths,
    side_rates,
    work_compress_then_shear,
    work_shear_then_compress,
)
from tests.oracles.drained import drained_path, drained_states_after_turn
from tests.oracles.paper_samples import Samples, difference, random_samples

Floats = NDArray[np.float64]
# Step of complex-step derivatives: no difference is formed, so that none is lost.
STEP = 1e-30


def contact_residuals() -> dict[str, float]:
    """Largest difference of each group of equations from its independent derivation."""
    elastic = random_samples(sliding=False)
    return {
        "1-5": _relative_motion(),
        "8a": _normal_law(elastic),
        "8b": _shear_law(),
        "9-10": _route_works(),
        "11, 15, 16": _kinematics(elastic),
        "12": _balance(elastic),
        "13": _force_rates(elastic),
    }


def _relative_motion() -> float:
    """Rates n . d' and t . d' against complex-step derivatives of the branch."""
    rng = np.random.default_rng(1)
    branch, rate = rng.uniform(0.2, 1.0, (200, 2)), rng.normal(size=(200, 2))
    x = np.stack([np.zeros_like(branch), branch], axis=1)
    graph = GrainGraph(x=x, radii=[0.6, 0.6], contacts=[[0, 1]])
    length, n, t = (part[:, 0] for part in contact_frame(graph))
    moved = branch + 1j * STEP * rate
    stretching = np.sqrt(np.sum(moved**2, axis=1)).imag / STEP
    turning = np.arctan(moved[:, 1] / moved[:, 0]).imag / STEP
    normal, shear = np.sum(n * rate, axis=1), np.sum(t * rate, axis=1)
    return max(difference(normal, stretching), difference(shear, length * turning))


def _normal_law(samples: Samples) -> float:
    """N of the grain graph against `kn (2 r - l)` from the state it was built for."""
    return difference(samples.graph.normal_force[:, 0], 1.0 - samples.length)


def _shear_law() -> float:
    """`dT/d(alpha) = kt l` on the exact drained paths, by Chebyshev interpolation."""
    errors = []
    for loop in (TABLE_1, TABLE_2):
        path = drained_path(loop)
        turn = 0.5 * float(path.end.turn) * (1.0 - np.cos(np.pi * np.arange(17) / 16))
        states, _ = drained_states_after_turn(path, turn)
        slope = np.polynomial.Polynomial.fit(turn, states.T, 16).deriv()(turn)
        errors.append(difference(slope, loop.kappa * states.length))
    return max(errors)


def _route_works() -> float:
    """(9), (10): `T' = kt l alpha'` and `N = kn D` integrated over the two routes."""
    errors = []
    for loop in (TABLE_1, TABLE_2):
        D, kappa = loop.confinement, loop.kappa
        for alpha in np.linspace(0.1, np.pi / 4, 5):
            push = quad(lambda u: u, 0.0, D)[0]
            for work, length in (
                (work_shear_then_compress, 1.0),
                (work_compress_then_shear, 1.0 - D),
            ):
                turn = quad(lambda a, c=kappa * length**2: c * a, 0.0, alpha)[0]
                errors.append(difference(push + turn, work(1.0, alpha, D, 1.0, kappa)))
    return max(errors)


def _kinematics(samples: Samples) -> float:
    """Diagonals as distances of opposite grains; their rates by complex steps; (16) back again."""
    x = samples.graph.x
    across = [np.linalg.norm(x[:, i] - x[:, i + 2], axis=1) for i in (0, 1)]
    length = samples.length + 1j * STEP * samples.length_rate
    alpha = samples.alpha + 1j * STEP * samples.alpha_rate
    rates = [(2.0 * length * f(alpha)).imag / STEP for f in (np.cos, np.sin)]
    found = side_rates(samples.length, samples.alpha, samples.length_rate, samples.alpha_rate)
    back = contact_displacement_rates(-found[0], -found[1], samples.alpha)
    arc = -samples.length * samples.alpha_rate
    return max(
        difference(side_lengths(samples.length, samples.alpha), across),
        difference(found, rates),
        difference(back, (samples.length_rate, arc)),
    )


def _balance(samples: Samples) -> float:
    """External forces against the resultants of contact forces on grains 0 and 1."""
    graph = samples.graph
    force, resultant = contact_forces(graph), np.zeros_like(graph.x)
    for c, (i, j) in enumerate(graph.contacts):
        resultant[:, i] -= force[:, c]
        resultant[:, j] += force[:, c]
    return difference(samples.forces, (resultant[:, 0, 0], resultant[:, 1, 1]))


def _force_rates(samples: Samples) -> float:
    N_rate, T_rate = samples.law_rates
    N, T = samples.N + 1j * STEP * N_rate, samples.T + 1j * STEP * T_rate
    alpha = samples.alpha + 1j * STEP * samples.alpha_rate
    expected = (
        2.0 * (N * np.cos(alpha) + T * np.sin(alpha)).imag / STEP,
        2.0 * (N * np.sin(alpha) - T * np.cos(alpha)).imag / STEP,
    )
    found = force_rates(N_rate, T_rate, samples.alpha_rate, *samples.forces, samples.alpha)
    return difference(found, expected)
