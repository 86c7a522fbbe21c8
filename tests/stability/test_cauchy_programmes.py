"""Paths under a constant Cauchy stress, and with a fluid in the pores: loops and packings."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from grainloops import replay
from loops import LinearFrictional, Scene, boundary_of
from patterns import diamond, regular_polygon
from stability import Path, Stage, follow, programmes
from tests.packings import LAW as PACKED
from tests.packings import jammed

LAW = LinearFrictional(kn=1.0, kt=0.5, mu=0.1)


def cauchy(path: Path):
    """(R, 4) `sigma = P F^T / det F` of each row."""
    F = np.eye(2) - path.H.reshape(-1, 2, 2)
    P = path.P.reshape(-1, 2, 2)
    return (P @ F.transpose(0, 2, 1) / np.linalg.det(F)[:, None, None]).reshape(-1, 4)


def loop_path(programme, closure="traction", n=4, end=0.08, **options):
    stages = [Stage("isotropic_strain", "H11", 0.05), Stage(programme, "parameter", end)]
    path = follow(Scene(regular_polygon(n), LAW), stages, closure=closure, **options)
    assert path.status == "finished", path.message
    return path


@pytest.mark.parametrize("closure", ["affine", "traction"])
@pytest.mark.parametrize(("axis", "across"), [(1, 3), (2, 0)])
def test_cauchy_stress_of_a_loop_stays(closure, axis, across):
    """Through yields, to the tolerance of the integrator; the nominal stress follows the side."""
    path = loop_path(programmes.cauchy_drained(axis), closure=closure)
    assert path.of_kind("yield")
    rows = path.stage == 1
    sigma = cauchy(path)[rows][:, across]
    assert sigma == pytest.approx(sigma[0], rel=1e-10)
    side = 1 - path.H[rows][:, 3 - across]
    assert path.P[rows][:, across] == pytest.approx(sigma[0] * side, rel=1e-10)
    # The nominal programme is another one: 8 % of strain is 8 % of stress.
    assert np.ptp(path.P[rows][:, across]) > 0.05 * sigma[0]


def test_cauchy_drained_diamond_against_its_closed_tangent():
    """Equations (26) to (28), integrated with `s2 = sigma22 (1 - E1)` put in by hand."""
    alpha0, kappa, at_A, end = np.radians(40), 0.3, 0.1, 0.25
    law = LinearFrictional(1.0, kappa, np.inf)
    stages = [
        Stage("isotropic_strain", "H11", at_A),
        Stage("cauchy_drained", "H11", end),
    ]
    volume = 4 * np.cos(alpha0) * np.sin(alpha0)
    loop = diamond(alpha0)
    scene = Scene(loop, law, boundary_of(loop, volume=volume))
    path = follow(scene, stages, closure="affine")
    t0 = np.tan(alpha0)
    sigma = at_A * t0 / (1 - at_A)

    def slopes(E1, y):
        E2, s1 = y
        s2, t = sigma * (1 - E1), t0 * (1 - E2) / (1 - E1)
        K = np.array(
            [
                [(1 + kappa * t**2 - t * s2 / (1 - E1)) / t0, (1 - kappa) * t + s2 / (1 - E1)],
                [
                    (1 - kappa) * t + t**2 * s1 / (1 - E2),
                    (t**2 + kappa - t * s1 / (1 - E2)) * t0,
                ],
            ]
        ) / (1 + t**2)
        E2_rate = (-sigma - K[1, 0]) / K[1, 1]
        return [E2_rate, K[0, 0] + K[0, 1] * E2_rate]

    exact = solve_ivp(slopes, (at_A, end), [at_A, at_A / t0], rtol=1e-12, atol=1e-14).y[:, -1]
    assert path.H[-1, 3] == pytest.approx(exact[0], abs=1e-10)
    assert path.P[-1, 0] == pytest.approx(exact[1], abs=1e-10)


@pytest.mark.slow
def test_fluid_between_drained_and_undrained():
    """Its error falls with `1/K` towards constant area and with `K` towards `cauchy_drained`."""
    ends = {
        K: loop_path(programmes.undrained(fluid_bulk_modulus=K), "affine", end=0.03).P[-1]
        for K in (0.0, 1e-5, 1e-4, 1e4, 1e5, np.inf)
    }
    drained = loop_path("cauchy_drained", "affine", end=0.03).P[-1]
    assert ends[0.0] == pytest.approx(drained, abs=1e-12)
    soft = [np.abs(ends[K] - drained).max() for K in (1e-5, 1e-4)]
    stiff = [np.abs(ends[K] - ends[np.inf]).max() for K in (1e5, 1e4)]
    assert np.log10(soft[1] / soft[0]) == pytest.approx(1, abs=0.01)
    assert np.log10(stiff[1] / stiff[0]) == pytest.approx(1, abs=0.01)
    assert soft[1] < 1e-3 and stiff[1] < 1e-3


@pytest.mark.parametrize("modulus", [0.2, 3.0])
def test_pressure_of_the_fluid_is_that_of_the_lost_area(modulus):
    path = loop_path(programmes.undrained(fluid_bulk_modulus=modulus), "affine")
    rows = path.stage == 1
    F = np.eye(2) - path.H[rows].reshape(-1, 2, 2)
    pressure = -modulus * np.log(np.linalg.det(F) / np.linalg.det(F[0]))
    sigma = cauchy(path)[rows][:, 3]
    assert sigma + pressure == pytest.approx(sigma[0], rel=1e-10)
    assert np.ptp(pressure) > 1e-3 * sigma[0]


def packing_path(programme, interval=2e-5, to=2e-3, **options):
    graph = jammed(12)
    stage = Stage(programme, "parameter", to)
    path = follow(Scene(graph, PACKED), stage, interval=interval, rows=10, **options)
    assert path.status == "finished", path.message
    return path


@pytest.mark.parametrize(("axis", "across"), [(1, 3), (2, 0)])
def test_cauchy_stress_of_a_packing_stays_to_the_error_of_an_interval(axis, across):
    """An interval of strain leaves its square; what it leaves is made good in the next one."""
    left = []
    for interval in (4e-5, 2e-5):
        path = packing_path(programmes.cauchy_drained(axis), interval)
        sigma = cauchy(path)[:, across]
        left.append(np.abs(sigma / sigma[0] - 1).max())
    assert left[0] < 5e-6 and left[1] < 0.5 * left[0]
    assert np.ptp(path.P[:, across]) > 1e-3 * sigma[0]


def test_packing_with_a_fluid_and_its_limits():
    stiffness = float(np.mean(PACKED.kn))
    fluid = packing_path(programmes.undrained(fluid_bulk_modulus=stiffness))
    area = np.linalg.det(np.eye(2) - fluid.H.reshape(-1, 2, 2))
    sigma = cauchy(fluid)[:, 3]
    assert sigma - stiffness * np.log(area) == pytest.approx(sigma[0], rel=2e-5)
    held, stiff = (
        packing_path(programmes.undrained(fluid_bulk_modulus=K)) for K in (np.inf, 1e4 * stiffness)
    )
    assert np.linalg.det(np.eye(2) - held.H[-1].reshape(2, 2)) == pytest.approx(1, abs=1e-9)
    assert stiff.H[-1] == pytest.approx(held.H[-1], abs=1e-6)
    drained, soft = (
        packing_path(programme)
        for programme in ("cauchy_drained", programmes.undrained(fluid_bulk_modulus=1e-9))
    )
    assert soft.H[-1] == pytest.approx(drained.H[-1], abs=1e-8)


def test_replay_holds_the_cauchy_stress():
    graph = jammed(12)
    stage = Stage("biaxial", "H11", 2e-3)
    path = replay(Scene(graph, PACKED), stage, inertial_number=1e-5)
    sigma = cauchy(path)[:, 3]
    assert sigma[-1] == pytest.approx(sigma[0], rel=2e-3)
    exact = packing_path("biaxial")
    assert path.P[-1] == pytest.approx(exact.P[-1], rel=0.02, abs=1e-6)


@pytest.mark.parametrize(("axis", "across"), [(1, 3), (2, 0)])
def test_replay_with_a_fluid_holds_the_total_stress(axis, across):
    stiffness = float(np.mean(PACKED.kn))
    programme = programmes.undrained(axis, fluid_bulk_modulus=stiffness)
    path = replay(Scene(jammed(12), PACKED), Stage(programme, f"H{axis}{axis}", 2e-3),
                  inertial_number=1e-5)  # fmt: skip
    area = np.linalg.det(np.eye(2) - path.H.reshape(-1, 2, 2))
    total = cauchy(path)[:, across] - stiffness * np.log(area)
    assert total[-1] == pytest.approx(total[0], rel=1e-3)
    # Strains are between those of the drained and of the undrained replay, and the path's.
    exact = packing_path(programme) if axis == 1 else None
    if exact is not None:
        assert path.H[-1] == pytest.approx(exact.H[-1], rel=0.02, abs=1e-7)
        assert path.P[-1] == pytest.approx(exact.P[-1], rel=0.02, abs=1e-6)
