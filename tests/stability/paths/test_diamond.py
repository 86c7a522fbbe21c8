"""Paths of the diamond under both closures, against closed forms and quadratures.

Under the affine closure the diamond has its two strains as freedoms, under the traction closure the
eight of four free grains; the volume L10 L20 makes P the paper's stresses.
"""

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from loops import LinearFrictional, Regime, Scene, boundary_of
from patterns import diamond
from stability import Stage, follow, programmes
from stability.paths import loop_path
from tests.oracles.diamond import (
    DIAMOND_SHEAR_SIGNS,
    TABLE_1,
    TABLE_2,
    DiamondParameters,
    angle_from_strains,
    elastic_moduli,
    external_forces,
    overlap_ratio,
    tangent,
)
from tests.oracles.drained import drained_path as exact_drained_path
from tests.oracles.drained import drained_states

CLOSURES = ("affine", "traction")
# Twenty digits, by tests.oracles.diamond_mpmath: E1, E2, s1.
POINT_B = {
    "table 1": (TABLE_1, 0.40973434897033423289, 0.164934999828385506, 0.25400990008305293503),
    "table 2": (TABLE_2, 0.41619122318013548716, -0.072382919123994869769, 0.31215593602737202138),
}


def box(alpha0):
    return 4.0 * np.cos(alpha0) * np.sin(alpha0)


def follow_diamond(alpha0, kappa, mu, stages, closure="affine", **options):
    law = LinearFrictional(kn=1.0, kt=kappa, mu=mu)
    return follow(
        Scene(diamond(alpha0), law, boundary_of(diamond(alpha0), volume=box(alpha0))),
        stages,
        closure=closure,
        **options,
    )


@cache
def drained_biaxial(p, closure, end, **options):
    stages = [
        Stage(programmes.isotropic_strain(), "H11", p.confinement),
        Stage(programmes.drained_biaxial(), "H11", end),
    ]
    return follow_diamond(p.alpha0, p.kappa, p.mu, stages, closure=closure, **options)


def only(path, kind):
    (event,) = path.of_kind(kind)
    return event.index


@pytest.mark.parametrize("closure", CLOSURES)
@pytest.mark.parametrize("table", POINT_B)
def test_point_b_equals_twenty_digits(table, closure):
    p, E1, E2, s1 = POINT_B[table]
    path = drained_biaxial(p, closure, 0.45)
    assert path.status == "finished"
    (event,) = path.of_kind("yield")
    assert event.contacts == (0, 1, 2, 3)
    # Contacts soft in shear, kt/kn - N/(kn l) from .05 on, have compliances that amplify rounding.
    atol = 2e-15 if closure == "affine" else 2e-14
    assert path.H[event.index] == pytest.approx([E1, 0, 0, E2], abs=atol)
    assert path.P[event.index, [0, 3]] == pytest.approx([s1, path.P[-1, 3]], abs=atol)


@pytest.mark.parametrize("closure", CLOSURES)
def test_sliding_branch_is_the_algebraic_one(closure):
    p = TABLE_1
    path = drained_biaxial(p, closure, 0.6)
    after = slice(only(path, "yield") + 2, None)
    alpha = angle_from_strains(path.H[after, 0], path.H[after, 3], p.alpha0)
    state, regime = drained_states(exact_drained_path(p), alpha)
    assert set(regime.tolist()) == {"sliding"}
    assert path.regime[after].tolist() == [[Regime.SLIDING] * 4] * len(alpha)
    assert path.H[after, 0] == pytest.approx(state.E1, abs=1e-12)
    assert path.P[after, 0] == pytest.approx(state.s1, abs=1e-12)
    assert path.normal_force[after] == pytest.approx(np.outer(state.N, np.ones(4)), abs=1e-12)
    slack = np.abs(path.shear_force[after]) - p.mu * path.normal_force[after]
    assert np.abs(slack).max() < 1e-16


STRAIN_PATHS = {
    "oedometric": (programmes.oedometric(), lambda t: (0.1 + t, 0.1 + 0 * t)),
    "oedometric along 2": (programmes.oedometric(axis=2), lambda t: (0.1 + 0 * t, 0.1 + t)),
    "proportional strain": (
        programmes.proportional_strain(1.0, -0.4),
        lambda t: (0.1 + t, 0.1 - 0.4 * t),
    ),
    "undrained": (programmes.undrained(), lambda t: (0.1 + t, 1 - 0.81 / (0.9 - t))),
    "extension": (programmes.proportional_strain(-0.5, 1.0), lambda t: (0.1 - 0.5 * t, 0.1 + t)),
}


NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)


def elastic_shear(strains, alpha0, kappa, t):
    """`T = kappa Int l d(alpha)` along a known strain path, by quadrature."""
    E1, E2 = strains(0.5 * t * (NODES + 1) + 1e-30j)
    ratio = np.tan(alpha0) * (1 - E2) / (1 - E1)
    turn = ratio.imag / 1e-30 / (1 + ratio.real**2)
    length = 1 - overlap_ratio(E1.real, E2.real, alpha0)
    return kappa * 0.5 * t * (WEIGHTS @ (length * turn))


@pytest.mark.parametrize(
    ("name", "closure"),
    [*((name, "affine") for name in STRAIN_PATHS), ("undrained", "traction"),
     ("extension", "traction")],
)  # fmt: skip
def test_strain_programmes_against_quadrature(name, closure):
    programme, strains = STRAIN_PATHS[name]
    alpha0, kappa, mu = 0.7, 0.3, 0.1
    stages = [
        Stage(programmes.isotropic_strain(), "H11", 0.1),
        Stage(programme, "parameter", 0.15),
    ]
    path = follow_diamond(alpha0, kappa, mu, stages, closure=closure)
    start = only(path, "programme_change")
    slid = only(path, "yield")
    for row in range(start, len(path)):
        t = path.parameter[row] - path.parameter[start]
        E1, E2 = strains(t)
        assert path.H[row] == pytest.approx([E1, 0, 0, E2], abs=1e-13)
        N = float(overlap_ratio(E1, E2, alpha0))
        trial = elastic_shear(strains, alpha0, kappa, t)
        T = trial if row <= slid else np.sign(trial) * mu * N
        assert path.normal_force[row] == pytest.approx(N, abs=1e-13)
        assert path.shear_force[row] == pytest.approx(T * DIAMOND_SHEAR_SIGNS, abs=1e-12)
        F1, F2 = external_forces(N, T, angle_from_strains(E1, E2, alpha0))
        assert path.P[row, 0] == pytest.approx(F1 / (2 * np.sin(alpha0)), abs=1e-12)
        assert path.P[row, 3] == pytest.approx(F2 / (2 * np.cos(alpha0)), abs=1e-12)


@pytest.mark.parametrize(
    ("alpha0", "ratio", "closure"),
    [
        (np.radians(44.0), 1.0, "affine"), (np.radians(46.0), 1.05, "traction"),
        (np.pi / 4, 1.0, "traction"),
    ],
)  # fmt: skip
def test_stress_programmes_against_the_two_strain_equations(alpha0, ratio, closure):
    kappa, end = 0.3, 0.12
    programme = programmes.proportional_stress(1.0, ratio)
    law = LinearFrictional(kn=1.0, kt=kappa, mu=0.2)
    path = follow(
        Scene(diamond(alpha0), law, boundary_of(diamond(alpha0), volume=box(alpha0))),
        Stage(programme, "P11", end),
        closure=closure,
    )
    assert path.status == "finished"

    def rates(s1, E):
        K = tangent(E[0], E[1], s1, ratio * s1, alpha0, *elastic_moduli(kappa))
        return np.linalg.solve(K, [1.0, ratio])

    oracle = solve_ivp(rates, (0.0, end), [0.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-14)
    assert path.H[-1, [0, 3]] == pytest.approx(oracle.y[:, -1], abs=1e-11)
    assert path.P[:, 3] == pytest.approx(ratio * path.P[:, 0], abs=1e-14)


def test_isotropic_stress_from_the_first_touch_beyond_friction_has_no_path():
    # T/N = -cot(2 alpha0) = -0.36 at 35 degrees, beyond tan 14 degrees (docs/paper.md).
    path = follow_diamond(
        TABLE_2.alpha0, 0.24, TABLE_2.mu, Stage(programmes.isotropic_stress(), "P11", 0.1)
    )
    assert path.status in ("control_limit", "no_solution")
    assert len(path) == 1


@pytest.mark.parametrize("closure", CLOSURES)
def test_contacts_that_slide_from_the_first_touch(closure):
    # The strain ratio turns the branches faster than friction can hold.
    mu, ratio, alpha0 = 0.1, -1.0, np.pi / 4
    stage = Stage(programmes.proportional_strain(1.0, ratio * 0.6), "H11", 0.1)
    path = follow_diamond(alpha0, 0.5, mu, stage, closure=closure)
    assert [event.kind for event in path.events][:1] == ["yield"]
    assert path.regime[0].tolist() == [Regime.SLIDING] * 4
    T, N = path.shear_force * DIAMOND_SHEAR_SIGNS, path.normal_force
    assert pytest.approx(mu * N, abs=1e-16) == T
    assert N[-1, 0] == pytest.approx(float(overlap_ratio(0.1, -0.06, alpha0)), abs=1e-14)


# A flat diamond whose drained path is long: E2 falls to -2 before the contacts yield.
FLAT = DiamondParameters(np.radians(4.0), 0.2, np.radians(10.0), 0.1)


def error_at_yield(monkeypatch, step, atol):
    monkeypatch.setattr(loop_path, "LONGEST_STEP", step)
    monkeypatch.setattr(loop_path, "ATOL", atol)
    path = drained_biaxial.__wrapped__(FLAT, "affine", 0.3)
    exact = exact_drained_path(FLAT).end
    (event,) = path.of_kind("control_limit")
    return np.hypot(*(path.H[event.index, [0, 3]] - [float(exact.E1), float(exact.E2)]))


def test_error_falls_with_the_eighth_order_of_the_step(monkeypatch):
    coarse, fine = (error_at_yield(monkeypatch, step, 1.0) for step in (0.2, 0.1))
    # 2^7 and 2^7.8 are measured; order 7 would leave 2^6.5 barely out of reach.
    assert np.log2(coarse / fine) > 6.5
