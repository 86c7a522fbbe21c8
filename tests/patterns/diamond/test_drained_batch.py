"""Sweeps of drained paths against mpmath, closed forms and the single path."""

import numpy as np
import pytest
from mpmath import mp

from tests.oracles import diamond_mpmath as oracle
from tests.oracles.drained import drained_end


def random_sweep(seed, count):
    rng = np.random.default_rng(seed)
    return (
        np.radians(rng.uniform(5.0, 85.0, count)),
        rng.uniform(0.05, 1.5, count),
        np.radians(rng.uniform(1.0, 35.0, count)),
        rng.uniform(1e-4, 0.5, count),
    )


def extreme_sweep(seed, count):
    """Flat and tall diamonds, soft and stiff shear, stiff grains, little and much friction."""
    rng = np.random.default_rng(seed)
    alpha0 = np.radians(45.0 * 10 ** rng.uniform(-7, 0, count))
    alpha0 = np.where(rng.random(count) < 0.5, 0.5 * np.pi - alpha0, alpha0)
    return (
        alpha0,
        10 ** rng.uniform(-4, 1.5, count),
        np.radians(10 ** rng.uniform(-6, 1.9, count)),
        10 ** rng.uniform(-10, -0.05, count),
    )


def errors_against_mpmath(sweep, digits):
    """Errors of (alpha, E1, E2, s1, N, T) over their own size, yielding rows only."""
    end, errors = drained_end(*sweep), []
    state = end.state
    with mp.workdps(digits):
        for row in np.flatnonzero(end.status == "yield"):
            alpha0, kappa, phi, confinement = (float(x[row]) for x in sweep)
            exact = oracle.yield_state(
                alpha0, kappa, phi, confinement, float(state.alpha[row]), int(end.direction[row])
            )
            got = (getattr(state, name)[row] for name in ("alpha", "E1", "E2", "s1", "N", "T"))
            errors.append(
                [float(abs(float(g) - x) / abs(x)) for g, x in zip(got, exact, strict=True)]
            )
    return np.array(errors)


@pytest.mark.slow
def test_random_sweep_against_mpmath():
    errors = errors_against_mpmath(random_sweep(40, 40), 25)
    assert len(errors) > 20
    # E2 changes its sign in the sweep: its error is relative to a small number at times.
    assert errors[:, [0, 1, 3, 4, 5]].max() < 1e-14
    assert errors[:, 2].max() < 1e-12


@pytest.mark.slow
def test_extreme_sweep_against_mpmath():
    errors = errors_against_mpmath(extreme_sweep(41, 16), 40)
    assert len(errors) > 8
    assert errors[:, [0, 1, 3, 4, 5]].max() < 2e-14
    assert errors[:, 2].max() < 1e-12


def test_closed_cases():
    alpha0 = np.array([0.3, 0.3, 0.8, 0.8, 0.8, 0.8, 0.3])
    kappa = np.array([0.4, 0.4, 0.0, 0.4, 0.4, 0.0, 0.0])
    phi = np.array([0.5, 0.2, 0.5, 0.5 * np.pi, 0.0, 0.0, 0.5])
    confinement = np.array([0.0, 0.0, 0.2, 0.2, 0.2, 0.2, 0.0])
    end = drained_end(alpha0, kappa, phi, confinement)
    status = ["yield", "opening", "none", "none", "yield", "yield", "opening"]
    assert end.status.tolist() == status
    np.testing.assert_allclose(end.state.alpha[[0, 1, 4, 5]], [0.5, 0.3, 0.8, 0.8], atol=1e-15)
    assert end.state.N[[1, 4]].tolist() == [0.0, pytest.approx(0.2, abs=1e-16)]
