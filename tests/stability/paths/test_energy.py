"""Work on a path: the balance, and the two orders of loading of one contact, (9) and (10)."""

import numpy as np
import pytest

from loops import GrainGraph, LinearFrictional, Scene, boundary_of
from patterns import diamond, regular_polygon
from stability import Programme, Stage, follow, programmes

CLOSURES = ("affine", "traction")
SPINS = ("blocked", "affine", "free")
SHEAR = programmes.combination(np.zeros((4, 4)), np.eye(4), [0.3, 1.0, -0.2, 0.0], "shear")


def confined_then(programme, quantity, target):
    return [
        Stage(programmes.isotropic_strain(), "H11", 0.08),
        Stage(programme, quantity, target),
    ]


@pytest.mark.parametrize(
    ("closure", "spins", "mu"),
    [
        *((closure, spins, 0.05) for closure in CLOSURES for spins in SPINS),
        *(("affine", "affine", np.inf), ("traction", "free", np.inf)),
    ],
)
def test_balance_closes_on_sheared_rings(mu, closure, spins):
    law = LinearFrictional(kn=1.0, kt=0.3, mu=mu)
    stages = confined_then(SHEAR, "H12", 0.04)
    path = follow(Scene(regular_polygon(6), law), stages, closure=closure, spins=spins)
    assert path.parameter[-1] > 0.1
    assert np.abs(path.energy_error).max() < 1e-12
    # Of the work on shear, what is not stored is dissipated.
    _, _, shear, dissipated = path.work.T
    lost = shear - path.tangential_energy - dissipated
    assert np.abs(lost).max() < 1e-13 * max(path.normal_energy.max(), 1e-3)
    assert (np.diff(dissipated) >= -1e-18).all()
    assert (dissipated[-1] > 1e-6) == bool(path.of_kind("yield"))
    if closure == "traction":
        assert path.imbalance.max() < 1e-13


@pytest.mark.parametrize("closure", CLOSURES)
def test_external_work_is_that_of_the_recorded_stress(closure):
    # The integral of P:dH over the rows, by Simpson's rule on the recorded path, converges to it.
    law = LinearFrictional(kn=1.0, kt=0.2, mu=0.1)
    stages = confined_then(programmes.drained_biaxial(), "H11", 0.2)
    path = follow(Scene(diamond(0.7), law), stages, closure=closure, rows=100)
    dH, P = np.diff(path.H, axis=0), 0.5 * (path.P[1:] + path.P[:-1])
    trapezoid = path.volume * (dH * P).sum()
    assert path.work[-1, 0] == pytest.approx(trapezoid, rel=4e-5)


def test_dissipation_of_a_sliding_diamond_is_friction_times_slip():
    law = LinearFrictional(kn=1.0, kt=0.2, mu=0.05)
    path = follow(
        Scene(diamond(np.pi / 4), law),
        confined_then(programmes.drained_biaxial(), "H11", 0.2),
        closure="affine",
    )
    slid = path.of_kind("yield")[0].index + 1
    alpha = np.arctan((1 - path.H[slid:, 3]) / (1 - path.H[slid:, 0]))
    N = path.normal_force[slid:, 0]
    # Slip: l d(alpha) less the elastic part dT/kt, T = mu N; trapezoidal over the rows.
    turned = np.cumsum(0.5 * (2 - N[1:] - N[:-1]) * np.diff(alpha))
    slip = turned - law.mu * (N[1:] - N[0]) / law.kt
    T = law.mu * N
    dissipated = 4 * np.cumsum(0.5 * (T[1:] + T[:-1]) * np.diff(np.concatenate([[0.0], slip])))
    gained = path.work[-1, 3] - path.work[slid, 3]
    assert gained == pytest.approx(dissipated[-1], rel=1e-3)


class Turn(Programme):
    """Turns the branch of a pair at constant length: `d . d' = 0`, driven by `-t . d'`."""

    def equations(self, H, P):
        d = np.array([1.0 - H[0], -H[2]])
        strain = np.eye(4)
        strain[0] = [d[0], 0.0, d[1], 0.0]
        strain[2] = np.array([d[1], 0.0, -d[0], 0.0]) / np.hypot(*d)
        return self.stress, strain, self.rate


class Press(Programme):
    """Shortens the branch of a pair in its own direction: `t . d' = 0`, `-n . d' = 1`."""

    def equations(self, H, P):
        d = np.array([1.0 - H[0], -H[2]])
        strain = np.eye(4)
        strain[0] = np.array([d[0], 0.0, d[1], 0.0]) / np.hypot(*d)
        strain[2] = [d[1], 0.0, -d[0], 0.0]
        return self.stress, strain, self.rate


TURN = Turn("turn", np.zeros((4, 4)), np.eye(4), np.array([0.0, 0.0, 1.0, 0.0]))
PRESS = Press("press", np.zeros((4, 4)), np.eye(4), np.array([1.0, 0.0, 0.0, 0.0]))


def test_two_orders_of_loading_one_contact(gap=1e-3):
    """(9), (10): the same end state up to its shear force, different work.

    With an overlap `gap` at the start, the normal springs take `kn gap D` more in either order.
    """
    kn, kt, angle, D = 1.0, 0.4, 0.2, 0.1
    pair = GrainGraph(
        x=[[0, 0], [1, 0]],
        radii=[0.5 + gap / 2] * 2,
        contacts=[[0, 1]],
        normal_force=[kn * gap],
    )
    law = LinearFrictional(kn=kn, kt=kt)
    extra = kn * gap * D
    arc, shortened_arc = angle, (1 - D) * angle
    first = [Stage(TURN, "parameter", arc), Stage(PRESS, "parameter", D)]
    second = [Stage(PRESS, "parameter", D), Stage(TURN, "parameter", shortened_arc)]
    shear_first = follow(Scene(pair, law, boundary_of(pair, volume=1.0)), first, closure="affine")
    press_first = follow(Scene(pair, law, boundary_of(pair, volume=1.0)), second, closure="affine")
    assert shear_first.status == press_first.status == "finished"
    E1, E2 = (0.5 * (kt * turned**2 + kn * D**2) for turned in (arc, shortened_arc))
    assert shear_first.work[-1, 0] == pytest.approx(E1 + extra, abs=1e-14)
    assert press_first.work[-1, 0] == pytest.approx(E2 + extra, abs=1e-14)
    assert shear_first.H[-1] == pytest.approx(press_first.H[-1], abs=1e-13)
    assert abs(shear_first.shear_force[-1, 0]) == pytest.approx(kt * angle, abs=1e-14)
    assert abs(press_first.shear_force[-1, 0]) == pytest.approx(kt * (1 - D) * angle, abs=1e-14)


def test_energy_left_in_a_parting_contact_is_dissipated():
    """Without a friction limit contacts part with shear force left in their springs."""
    stages = [
        Stage(programmes.isotropic_strain(), "H11", 0.05),
        Stage(programmes.proportional_strain(0.5, -0.5), "H11", 0.09),
        Stage(programmes.isotropic_strain(rate=-1.0), "H11", -0.03),
    ]
    path = follow(
        Scene(regular_polygon(4), LinearFrictional(kn=1.0, kt=0.3, mu=np.inf)),
        stages,
        closure="affine",
    )
    (opening,) = path.of_kind("opening")
    held = path.shear_force[opening.index]
    assert np.abs(held).min() > 0.01
    assert np.abs(path.shear_force[-1]).max() == 0.0
    assert path.work[-1, 3] == pytest.approx((held**2 / (2 * 0.3)).sum(), rel=1e-13)
    assert np.abs(path.energy_error).max() < 1e-14
