"""Paths under every contact law: spheres, rolling resistance, a law of the user's own."""

from importlib import import_module

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from loops import (
    CohesiveFrictional,
    HertzMindlin,
    InputError,
    LinearFrictional,
    RollingResistance,
    Scene,
    contact_state,
)
from patterns import diamond, regular_polygon
from stability import Stage, directional_work, follow, programmes, rates_at
from tests.oracles.cohesive import Cohesive
from tests.oracles.polygon_thresholds import critical_strain

KAPPA, MU, ADHESION = 0.3, 0.05, 0.01


COHESIVE = Cohesive(kn=1.0, kt=KAPPA, mu=MU, adhesion=ADHESION)


def loaded(graph, law):
    return graph.replace(normal_force=law.normal_force(contact_state(graph)))


def isotropic(E):
    return Stage(programmes.isotropic_strain(), "H11", E)


def lost_at(path):
    event = path.of_kind("det_Ks_zero")[0]
    return float(path.H[event.index, 0])


@pytest.mark.parametrize(("order", "poisson"), [(4, 0.0), (5, 0.3)])
def test_spheres_lose_stability_at_their_threshold(order, poisson):
    law = HertzMindlin(young=1.0, poisson=poisson)
    kappa = 2 * (1 - poisson) / (2 - poisson)
    graph = loaded(regular_polygon(order, strain=0.01), law)
    path = follow(Scene(graph, law), isotropic(0.65), closure="traction")
    # The event is located to 1e-12 of the tangent; the path itself is a straight line.
    assert lost_at(path) == pytest.approx(kappa / (kappa + 2 / 3), abs=1e-11)


def test_rolling_resistance_gives_free_spins_their_threshold_back(order=6, k_r=0.3):
    law = RollingResistance(LinearFrictional(kn=1.0, kt=KAPPA), k_r=k_r)
    path = follow(
        Scene(regular_polygon(order), law), isotropic(0.3), closure="traction", spins="free"
    )
    expected = critical_strain(order, KAPPA, "traction", rolling=lambda E: k_r / (1 - E) ** 2)
    assert lost_at(path) == pytest.approx(expected, abs=1e-11)


def hand(law, graph, H_of, end):
    """T and N of every contact of an affine motion with spins blocked, integrated by hand."""
    d0 = graph.x[np.roll(np.arange(4), -1)] - graph.x
    touching = 2 * graph.radii[0]
    T, side = np.zeros(4), np.zeros(4)

    def contact(c, H, rate):
        d, d_rate = d0[c] - H.reshape(2, 2) @ d0[c], -rate.reshape(2, 2) @ d0[c]
        length = np.hypot(*d)
        n = d / length
        N = touching - length - ADHESION
        return N, n @ d_rate, np.array([-n[1], n[0]]) @ d_rate

    found = []
    for c in range(4):

        def rates(s, T, c=c):
            return [-KAPPA * contact(c, *H_of(s))[2]]

        def excess(s, T, c=c):
            return abs(T[0]) - MU * (contact(c, *H_of(s))[0] + ADHESION)

        excess.terminal, excess.direction = True, 1.0
        run = solve_ivp(
            rates, (0.0, end), [0.0], "DOP853", rtol=1e-12, atol=1e-15, events=excess, max_step=0.01
        )
        T[c], side[c] = run.y[0, -1], np.sign(run.y[0, -1])
        N = contact(c, *H_of(end))[0]
        if len(run.t_events[0]):
            # From here on the contact slides: its T is its strength.
            T[c] = side[c] * MU * (N + ADHESION)
        found.append((N, T[c], run.t_events[0]))
    return found


def test_a_law_of_ones_own_against_a_hand_integration():
    graph = loaded(diamond(np.radians(40), E1=0.05, E2=0.05), COHESIVE)
    assert graph.normal_force[0] == pytest.approx(0.05 - ADHESION, abs=1e-15)
    path = follow(
        Scene(graph, COHESIVE), Stage(programmes.oedometric(), "H11", 0.25), closure="affine"
    )
    assert path.status == "finished"
    assert [event.kind for event in path.events if event.contacts] == ["yield"]
    start, rate = np.array([0.05, 0, 0, 0.05]), np.array([1.0, 0, 0, 0])
    found = hand(COHESIVE, graph.replace(x=graph.x0), lambda s: (start + s * rate, rate), 0.2)
    # Both integrators keep 1e-12 of forces of order 0.1.
    np.testing.assert_allclose(path.normal_force[-1], [N for N, _, _ in found], atol=1e-13)
    np.testing.assert_allclose(path.shear_force[-1], [T for _, T, _ in found], atol=1e-12)
    at = path.of_kind("yield")[0].index
    assert path.H[at, 0] - 0.05 == pytest.approx(found[0][2][0], abs=1e-11)
    # What the springs store, what slip dissipates and what comes in from outside add up.
    assert np.abs(path.energy_error).max() < 1e-11
    linear = follow(
        Scene(loaded(graph, (plain := LinearFrictional(1.0, KAPPA, MU))), plain),
        Stage(programmes.oedometric(), "H11", 0.25),
        closure="affine",
    )
    assert np.abs(linear.P[-1] - path.P[-1]).max() > 0.5 * ADHESION


def test_a_cohesive_contact_breaks_where_its_grains_part():
    graph = loaded(diamond(np.radians(45), E1=0.05, E2=0.05), COHESIVE)
    stages = [Stage(programmes.isotropic_strain(-1.0), "H11", -0.01), isotropic(0.02)]
    path = follow(Scene(graph, COHESIVE), stages, closure="affine")
    opening, closing = path.of_kind("opening")[0].index, path.of_kind("closing")[0].index
    assert path.H[opening, 0] == pytest.approx(0.0, abs=1e-13)
    np.testing.assert_allclose(path.normal_force[opening], -ADHESION, atol=1e-13)
    np.testing.assert_array_equal(path.normal_force[opening + 1], 0.0)
    np.testing.assert_allclose(path.normal_force[closing + 1], -ADHESION, atol=1e-13)
    assert np.abs(path.energy_error).max() < 1e-11


def test_a_bond_breaks_at_its_pull_for_good():
    """It holds beyond touch; where the grains touch again it is a contact without cohesion."""
    law = CohesiveFrictional(1.0, KAPPA, MU, adhesion=ADHESION, bonded=True)
    graph = loaded(diamond(np.radians(45), E1=0.05, E2=0.05), law)
    apart, together = (programmes.isotropic_strain(way) for way in (-1.0, 1.0))
    ends = ((apart, -0.02), (together, 0.02), (apart, -0.02))
    path = follow(
        Scene(graph, law), [Stage(way, "H11", end) for way, end in ends], closure="affine"
    )
    opening, closing, again = (
        event.index for event in path.events if event.kind in ("opening", "closing")
    )
    # Side length 1: the gap of a/kn = 0.01 is a strain of 0.01.
    touching = float(graph.radii[0] + graph.radii[1])
    assert path.H[opening, 0] == pytest.approx(-ADHESION / touching, abs=1e-13)
    np.testing.assert_allclose(path.normal_force[opening], -ADHESION, atol=1e-13)
    for touch in (closing, again):
        assert path.H[touch, 0] == pytest.approx(0.0, abs=1e-13)
        np.testing.assert_allclose(path.normal_force[touch], 0.0, atol=1e-13)
    # Four bonds let go of a^2/(2 kn) each.
    released = path.work[again, 3] - path.work[opening, 3]
    assert released == pytest.approx(4 * ADHESION**2 / 2, rel=1e-11)
    assert np.abs(path.energy_error).max() < 1e-11


def test_hertz_mindlin_shear_against_its_own_quadrature():
    law = HertzMindlin(young=1.0, poisson=0.3)
    graph = loaded(diamond(np.radians(40), E1=0.05, E2=0.05), law)
    path = follow(Scene(graph, law), Stage(programmes.oedometric(), "H11", 0.25), closure="affine")
    d0 = graph.x0[1] - graph.x0[0]
    stiff, kappa = 1.0 / (2 * (1 - 0.3**2)), 1.4 / 1.7

    def rate(s, T):
        d, d_rate = d0 * [1 - s, 0.95], d0 * [-1.0, 0.0]
        length = np.hypot(*d)
        overlap = 2 * graph.radii[0] - length
        kt = kappa * 2 * stiff * np.sqrt(0.5 * graph.radii[0] * overlap)
        return [-kt * (d[0] * d_rate[1] - d[1] * d_rate[0]) / length]

    run = solve_ivp(rate, (0.05, 0.25), [0.0], "DOP853", rtol=1e-12, atol=1e-15)
    assert path.shear_force[-1, 0] == pytest.approx(run.y[0, -1], abs=1e-12)
    assert np.abs(path.energy_error).max() < 1e-11


class LawWithoutEdge:
    """Law without the methods that describe its edge."""

    def regime(self, state, rates=None):
        raise AssertionError("nothing is computed")

    shear_kinematics = local_stiffness = rolling_stiffness = normal_force = take = regime


def test_a_law_without_an_edge_is_refused_before_anything_is_computed():
    graph, law = regular_polygon(4), LawWithoutEdge()
    for call in (
        lambda: follow(Scene(graph, law), isotropic(0.1), closure="affine"),
        lambda: rates_at(Scene(graph, law), programmes.isotropic_strain(), closure="affine"),
        lambda: directional_work(graph, law, [[1.0, 0.0]], closure="affine"),
        lambda: RollingResistance(law, k_r=0.1),
    ):
        with pytest.raises(InputError, match=r"LawWithoutEdge, expected a law derived"):
            call()


@pytest.mark.parametrize(
    "options",
    [
        {"max_steps": 0}, {"max_steps": 1.5}, {"rtol": 1e-9}, {"atol": 1e-9}, {"max_step": 0.1},
    ],
)  # fmt: skip
def test_accuracies_that_mean_nothing_are_refused(options):
    law = LinearFrictional(kn=1.0, kt=KAPPA)
    with pytest.raises(InputError, match=next(iter(options))):
        follow(Scene(regular_polygon(4), law), isotropic(0.1), closure="affine", **options)


# ---- from the first touch of spheres


def sphere_contacts(graph, law, E, poisson=0.3):
    """N and T of contacts that never slide, driven affinely to H11 = E from rest, by quadrature."""
    kappa = 2 * (1 - poisson) / (2 - poisson)
    d0 = np.roll(graph.x0, -1, axis=0) - graph.x0

    def lengths(s):
        d = d0 * [1.0 - s, 1.0]
        return d, np.hypot(*d.T)

    def rates(s, T):
        # kn = 2 E* sqrt(R* overlap), E* = E/(2 (1 - nu^2)), R* = 1/4; ut' = t . d'.
        d, length = lengths(s)
        kn = law.young / (1 - poisson**2) * 0.5 * np.sqrt(np.maximum(1.0 - length, 0.0))
        return -kappa * kn * d[:, 1] * d0[:, 0] / length

    run = solve_ivp(rates, (0.0, E), np.zeros(len(d0)), "DOP853", rtol=1e-12, atol=1e-16)
    _, length = lengths(E)
    N = law.young / (1 - poisson**2) / 3 * np.maximum(1.0 - length, 0.0) ** 1.5
    return N, run.y[:, -1]


@pytest.mark.parametrize("order", [3, 5])
def test_spheres_are_followed_from_their_first_touch(order, monkeypatch):
    """Against the path from rest; what the first strain changes is in proportion to it."""
    law, graph, off = HertzMindlin(young=1.0, poisson=0.3), regular_polygon(order), []
    N, T = sphere_contacts(graph, law, 0.1)
    for first in (1e-8, 1e-6):
        monkeypatch.setattr(import_module("stability.paths.state"), "FIRST_STRAIN", first)
        path = follow(
            Scene(graph, law), Stage(programmes.oedometric(), "H11", 0.1), closure="affine"
        )
        assert path.status == "finished"
        found = path.normal_force[-1] - N, path.shear_force[-1] - T
        off.append(max(np.abs(part).max() for part in found))
    assert off[0] < 1e-8
    assert off[1] / off[0] == pytest.approx(100.0, rel=0.1)
