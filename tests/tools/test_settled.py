"""The settled choices: orders of convergence, and where the other methods agree."""

import json

import numpy as np
import pandas as pd
import pytest

from loops import affine_tangent, traction_tangent
from patterns import synthetic_network
from patterns.diamond import TABLE_1, tangent
from stability import restrict, symmetric_spectrum
from tests.benchmarks.methods import POINT_B, Row, error_at_b, irregular_rings
from tests.oracles.hard_cases import hard_case, parallel_half_edges
from tests.tools.settled.__main__ import GROUPS, main
from tests.tools.settled.closures import least_squares
from tests.tools.settled.eigenvalues import closed_form, jacobi, sample
from tests.tools.settled.fractions import SPECTRA, fraction_50, imhof
from tests.tools.settled.half_edges import follow_by_angle, follow_by_key, follow_exactly
from tests.tools.settled.integrators import (
    START,
    dop853,
    euler,
    friction_left,
    rates,
    runge_kutta,
)
from tests.tools.settled.precision import kernel_inputs, plain_kernel

KAPPA, MU = TABLE_1.kappa, TABLE_1.mu


def orders(solver, steps):
    errors = [error_at_b(solver(n)) for n in steps]
    return np.diff(np.log(errors)) / -np.diff(np.log(steps))


def test_rates_are_those_of_the_tangent():
    E1, E2, s1 = 0.35, 0.27, 0.28
    K = tangent(E1, E2, s1, TABLE_1.confinement, TABLE_1.alpha0, KAPPA, KAPPA)
    slope = [-K[1, 0] / K[1, 1], np.linalg.det(K) / K[1, 1]]
    np.testing.assert_allclose(rates(E1, E2, s1), slope, rtol=1e-13)


def test_point_b_is_at_yield():
    assert friction_left(*POINT_B) == pytest.approx(0.0, abs=1e-16)
    assert friction_left(*START) == pytest.approx(MU * TABLE_1.confinement, rel=1e-14)


def test_orders_of_convergence():
    np.testing.assert_allclose(orders(euler, [100, 1_000, 10_000]), 1.0, atol=0.01)
    np.testing.assert_allclose(orders(runge_kutta, [16, 32, 64, 128]), 4.0, atol=0.1)
    assert error_at_b(runge_kutta(512)) < 1e-13


def test_tolerance_bounds_the_error_of_dop853():
    errors = np.array([error_at_b(dop853(10.0**-k)) for k in range(4, 14)])
    assert np.all(errors[1:] <= errors[:-1])
    assert np.all(errors < 0.1 * 10.0 ** -np.arange(4.0, 14.0) + 2e-15)


def test_oracle_of_the_fraction_agrees_with_imhof():
    exact = [fraction_50(spectrum) for spectrum in SPECTRA]
    np.testing.assert_allclose(imhof(SPECTRA, 0.25), exact, atol=1e-15)
    assert np.abs(imhof(SPECTRA, 2.0) - exact).max() > 1e-4


def test_methods_of_eigenvalues_agree_as_far_as_they_reach():
    K = sample(50)
    exact = symmetric_spectrum(K)
    np.testing.assert_allclose(jacobi(K, 5), exact, atol=3e-15)
    np.testing.assert_allclose(closed_form(K), exact, atol=1e-7)
    assert np.abs(jacobi(K, 2) - exact).max() > 1e-8


def test_least_squares_agrees_with_the_closure():
    batch = irregular_rings(5, 6, seed=2)
    found = traction_tangent(batch.graph, batch.law, regime=batch.regime).matrix
    gap = np.linalg.norm(least_squares(batch) - found, axis=(1, 2))
    assert (gap < 1e-10 * np.linalg.norm(found, axis=(1, 2))).all()


def test_the_plain_kernel_is_the_affine_tangent():
    scene = hard_case("stiff-sliding-grains").build(1e-2)
    K = restrict(affine_tangent(scene.graph, scene.law).matrix, "symmetric")
    found = plain_kernel(*kernel_inputs(scene.graph, 2, np.float64))
    np.testing.assert_allclose(found[1], symmetric_spectrum(K), atol=1e-14)
    assert plain_kernel(*kernel_inputs(scene.graph, 1, np.float32)).dtype == np.float32


def test_orders_of_half_edges():
    network = synthetic_network(60, coordination=4.0, seed=1)
    exact = follow_exactly(network)
    assert (follow_by_key(network) == exact).all()
    assert (follow_by_angle(network) == exact).all()
    hub = parallel_half_edges(1.0).graph
    assert (follow_by_key(hub) == follow_exactly(hub)).all()
    # Angles in floating point put spokes a rounding apart in the wrong order.
    assert (follow_by_angle(hub) != follow_exactly(hub)).any()


@pytest.mark.slow
def test_a_quick_run_measures_every_group(tmp_path, unsaved):
    main(out=tmp_path / "out", quick=True)
    table = pd.read_parquet(tmp_path / "out" / "settled.parquet")
    assert set(table) == set(Row.__dataclass_fields__)
    assert set(table.group) == set(GROUPS) and (table.seconds_per_item > 0.0).all()
    knees = json.loads((tmp_path / "out" / "summary.json").read_text())["knees"]
    assert knees["half-edges"]["method"] == "key, then exact"
    assert (tmp_path / "out" / "settled.png").exists()
