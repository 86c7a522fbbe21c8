"""Events of a path: what happens, exactly where, and how the path goes on."""

import functools

import numpy as np
import pytest
from scipy.optimize import brentq

from loops import GrainGraph, InputError, LinearFrictional, Regime, Scene, boundary_of
from patterns import diamond, regular_polygon
from stability import Stage, follow, programmes, rates_at
from tests.oracles.diamond import (
    DIAMOND_SHEAR_SIGNS,
    TABLE_1,
    DiamondParameters,
    determinant_elastic,
    opposite_contact_strain,
    overlap_ratio,
)
from tests.oracles.drained import drained_path as exact_drained_path
from tests.oracles.drained import drained_states

CLOSURES = ("affine", "traction")
LAW = LinearFrictional(kn=1.0, kt=TABLE_1.kappa, mu=TABLE_1.mu)
POINT_B = (0.40973434897033423289, 0.164934999828385506)
SQUARE_BOX = 2.0


def isotropic(E):
    return Stage(programmes.isotropic_strain(), "H11", E)


def drained(E, rate=1.0):
    return Stage(programmes.drained_biaxial(rate=rate), "H11", E)


def at_45(stages, law=LAW, closure="affine", **options):
    return follow(
        Scene(diamond(np.pi / 4), law, boundary_of(diamond(np.pi / 4), volume=SQUARE_BOX)),
        stages,
        closure=closure,
        **options,
    )


@pytest.mark.parametrize("closure", CLOSURES)
def test_opening_on_extension_and_closing_on_return(closure):
    back = Stage(programmes.oedometric(), "H11", 0.1)
    path = at_45(
        [isotropic(0.1), Stage(programmes.oedometric(rate=-1), "H11", -0.2), back], closure=closure
    )
    assert path.status == "finished"
    # The contacts part where (1 - E1)^2 + (1 - E2)^2 = 2 at 45 degrees.
    parted = 1 - np.sqrt(2 - 0.9**2)
    for kind in ("opening", "closing"):
        (event,) = path.of_kind(kind)
        assert event.contacts == (0, 1, 2, 3)
        assert path.H[event.index, 0] == pytest.approx(parted, abs=1e-14)
    apart = (path.regime == Regime.OPEN).all(axis=1)
    assert apart.any()
    for force in (path.normal_force, path.shear_force, path.P):
        assert not force[apart].any()
    assert path.normal_force[-1] == pytest.approx(0.1, abs=1e-14)
    # The friction at the first touch on return is the full one: T/N is not that of loading.
    assert np.abs(path.energy_error).max() < 1e-12


@pytest.mark.parametrize(
    ("alpha0", "pairs"), [(35.0, {(1, 3)}), (45.0, {(0, 2), (1, 3)}), (59.0, {(0, 2)})]
)
@pytest.mark.parametrize("closure", CLOSURES)
def test_opposite_grains_touch_at_the_closed_form(alpha0, pairs, closure):
    angle = np.radians(alpha0)
    path = follow(Scene(diamond(angle), LAW), isotropic(0.3), closure=closure)
    touch = path.of_kind("opposite_contact")
    assert {event.contacts for event in touch} == pairs
    expected = float(opposite_contact_strain(angle))
    assert path.H[touch[0].index, [0, 3]] == pytest.approx([expected, expected], abs=1e-14)


@pytest.mark.parametrize(
    "alpha0", [50.0, 60.0, *(pytest.param(a, marks=pytest.mark.slow) for a in (55.0, 65.0))]
)
def test_singular_relaxation_is_met_or_passed_where_other_paths_branch_off(alpha0):
    # Under prescribed strain the relaxed centres of a soft loop branch: the rhombus shears.
    loop = diamond(np.radians(alpha0))
    small = follow(Scene(loop, LAW), isotropic(0.5), closure="traction")
    assert small.status == "finished"
    (branching,) = small.of_kind("branching")
    if alpha0 == 60.0:
        assert branching.parameter == pytest.approx(8 / 23, abs=1e-10)
    # With all unknowns a step meets the very state or passes it: that is rounding.
    full = follow(Scene(loop, LAW), isotropic(0.5), closure="traction", model="full")
    met = full.status == "control_limit"
    (event,) = full.of_kind("control_limit" if met else "branching")
    assert event.parameter == pytest.approx(branching.parameter, abs=1e-6 if met else 1e-10)
    if met:
        assert event.cause == "singular"
        # Its stiffness against the shear H21, held at zero, vanishes there.
        assert full.A[event.index, 1, 1] == pytest.approx(0, abs=1e-4)
    else:
        np.testing.assert_allclose(full.x[-1], 0.5 * full.x[0], atol=1e-13)


@pytest.mark.parametrize("closure", CLOSURES)
def test_added_contact_carries_its_overlap(closure):
    angle, end = np.radians(35), 0.2
    path = follow(
        Scene(diamond(angle), LAW, boundary_of(diamond(angle), volume=1.0)),
        isotropic(end),
        contact_on_touch="add",
        closure=closure,
    )
    assert path.contacts.tolist()[-1] == [1, 3]
    before, after = path.regime[0, 4], path.regime[-1, 4]
    assert (before, after) == (Regime.OPEN, Regime.ELASTIC)
    chord = 1 - 2 * np.sin(angle) * (1 - end)
    assert path.normal_force[-1] == pytest.approx([end] * 4 + [chord], abs=2e-14)
    # It stands along axis 2: P22 gains its force times its reference length.
    gained = path.P[-1, 3] - 4 * end * np.sin(angle) ** 2
    assert gained == pytest.approx(chord * 2 * np.sin(angle), abs=1e-13)
    assert np.abs(path.energy_error).max() < 1e-12


@pytest.mark.parametrize("closure", CLOSURES)
def test_limit_of_force_control_is_the_exact_one(closure):
    # Nothing slides; confined beyond I, s1 falls to a minimum where det K comes back to zero.
    p = DiamondParameters(np.radians(20), 0.2, np.pi / 2, 0.18)
    exact = exact_drained_path(p)

    def det_K(alpha):
        state, _ = drained_states(exact, alpha)
        return float(determinant_elastic(state.E1, state.E2, state.s1, state.s2, alpha, p.kappa))

    alpha = brentq(det_K, p.alpha0, np.radians(60), xtol=1e-15)
    peak, _ = drained_states(exact, alpha)
    force = Stage(programmes.proportional_stress(-1, 0), "P11", -0.5)
    path = follow(
        Scene(
            diamond(p.alpha0),
            LinearFrictional(kn=1.0, kt=0.2),
            boundary_of(diamond(p.alpha0), volume=4 * np.cos(p.alpha0) * np.sin(p.alpha0)),
        ),
        [isotropic(0.18), force],
        closure=closure,
    )
    assert path.status == "control_limit"
    (event,) = path.of_kind("control_limit")
    assert path.P[event.index, 0] == pytest.approx(float(peak.s1), abs=1e-14)
    assert path.H[event.index, [0, 3]] == pytest.approx([float(peak.E1), float(peak.E2)], abs=1e-11)
    assert path.parameter_rate[event.index] == pytest.approx(0, abs=1e-11)
    assert path.det_K[event.index] == pytest.approx(0, abs=1e-11)


@pytest.mark.parametrize("closure", CLOSURES)
def test_peak_where_contacts_yield_and_the_fallback_beyond_it(closure):
    force = Stage(programmes.proportional_stress(1, 0), "P11", 0.5)
    beyond = Stage(programmes.drained_biaxial(), "H11", 0.2, fallback=True)
    stopped = at_45([isotropic(0.05), force], closure=closure)
    assert stopped.status == "control_limit"
    exact = exact_drained_path(DiamondParameters(np.pi / 4, TABLE_1.kappa, TABLE_1.phi, 0.05))
    assert stopped.H[-1, 0] == pytest.approx(float(exact.end.E1), abs=1e-13)
    path = at_45([isotropic(0.05), force, beyond], closure=closure)
    assert path.status == "finished"
    assert path.stage[-1] == 2
    alpha = np.arctan((1 - path.H[-1, 3]) / (1 - path.H[-1, 0]))
    state, _ = drained_states(exact, alpha)
    assert path.P[-1, 0] == pytest.approx(float(state.s1), abs=1e-13)


def test_fallback_is_skipped_where_it_is_not_needed():
    spare = Stage(programmes.isotropic_strain(), "H11", 0.2, fallback=True)
    path = at_45([isotropic(0.1), spare])
    assert path.status == "finished"
    assert path.H[-1, 0] == pytest.approx(0.1, abs=1e-15)


@functools.cache
def sliding(closure):
    """Table 1 beyond its point B."""
    return at_45([isotropic(0.3), drained(0.45)], closure=closure)


@pytest.mark.parametrize("closure", CLOSURES)
def test_contacts_at_yield_from_the_start(closure):
    reference = sliding(closure)
    row = reference.of_kind("yield")[0].index
    T = float(TABLE_1.mu * reference.normal_force[row, 0])
    start = diamond(np.pi / 4, E1=POINT_B[0], E2=POINT_B[1], T=T)
    onward = follow(
        Scene(start, LAW, boundary_of(start, volume=SQUARE_BOX)), drained(0.45), closure=closure
    )
    assert onward.events[0].kind == "yield"
    assert onward.P[-1] == pytest.approx(reference.P[-1], abs=1e-13)
    backward = follow(
        Scene(start, LAW, boundary_of(start, volume=SQUARE_BOX)), drained(0.4, -1), closure=closure
    )
    assert not backward.of_kind("yield")
    assert (backward.regime == Regime.ELASTIC).all()


def test_two_eigenvalues_that_vanish_together_are_not_missed():
    # Both shears of an isotropic ring soften at once: det Ks does not change its sign.
    for closure, expected in (("affine", 1.2 / 2.2), ("traction", 0.2 / 1.2)):
        path = follow(
            Scene(regular_polygon(6), LAW),
            isotropic(expected + 0.01),
            closure=closure,
            subspace="symmetric",
        )
        event = path.of_kind("det_Ks_zero")[0]
        assert path.H[event.index, 0] == pytest.approx(expected, abs=1e-12)
        assert event.count == 2


def test_a_programme_that_leads_away_from_its_target_ends_at_once():
    """The message names the rate where the other sense leads there."""
    for stage, helps in (
        (isotropic(-0.1), True),
        (Stage("drained", "H11", 0.01), True),
        (Stage(programmes.oedometric(), "H22", 0.1), False),
        (Stage(programmes.oedometric(), "parameter", -1.0), False),
        (Stage(programmes.isotropic_stress(-1.0), "P11", 0.5), True),
    ):
        path = follow(Scene(diamond(np.pi / 4, E1=0.05, E2=0.05), LAW), stage, closure="affine")
        assert (path.status, len(path)) == ("lost", 1)
        assert "away from" in path.message and ("rate=-1" in path.message) == helps


class Parabola(programmes.Programme):
    """`H22' = 20 (H11 - 0.1) H11'`: the branch turns one way, then back."""

    def equations(self, H, P):
        strain = self.strain.copy()
        strain[3, 0] = -20.0 * (H[0] - 0.1)
        return self.stress, strain, self.rate


def test_shear_that_touches_the_cone_and_turns_back_within_a_step():
    turning = Parabola("parabola", np.zeros((4, 4)), np.eye(4), np.array([1.0, 0, 0, 0]))
    stages = [isotropic(0.1), Stage(turning, "H11", 0.2)]
    # E2 = 0.1 + 10 (E1 - 0.1)^2; T = kt Int l d(alpha) by the trapezoidal rule.
    E1 = np.linspace(0.1, 0.2, 20_001)
    L1, L2 = 1 - E1, 0.9 - 10 * (E1 - 0.1) ** 2
    length, alpha = np.hypot(L1, L2) / np.sqrt(2), np.arctan2(L2, L1)
    T = 0.2 * np.cumsum(0.5 * (length[1:] + length[:-1]) * np.diff(alpha))
    top = (np.abs(T) / (1 - length[1:])).max()
    law = LinearFrictional(kn=1.0, kt=0.2, mu=top * (1 - 1e-5))
    path = at_45(stages, law)
    (first,), (last,) = path.of_kind("yield"), path.of_kind("unloading")
    # The friction cut off 1e-5 of the peak: both events lie sqrt(1e-5) around it.
    first, last = path.H[first.index, 0], path.H[last.index, 0]
    assert 0 < last - first < 1e-2
    untouched = at_45(stages, LinearFrictional(kn=1.0, kt=0.2, mu=top * (1 + 2e-4)))
    assert not untouched.of_kind("yield")


def test_bad_input_is_named():
    graph = diamond(np.pi / 4, E1=0.1, E2=0.1)
    stage = isotropic(0.2)
    with pytest.raises(InputError, match="closure"):
        follow(Scene(graph, LAW), stage, closure="loose")
    with pytest.raises(InputError, match="contact_on_touch"):
        follow(Scene(graph, LAW), stage, contact_on_touch="merge", closure="affine")
    with pytest.raises(InputError, match="subspace"):
        follow(Scene(graph, LAW), stage, subspace="plane", closure="affine")
    with pytest.raises(InputError, match="stages"):
        follow(Scene(graph, LAW), [], closure="affine")
    with pytest.raises(InputError, match="volume"):
        follow(Scene(graph, LAW, boundary_of(graph, volume=-1.0)), stage, closure="affine")
    with pytest.raises(InputError, match="normal force of contact 0"):
        follow(Scene(graph.replace(normal_force=np.full(4, 0.2)), LAW), stage, closure="affine")
    with pytest.raises(InputError, match="shear force of contact 2"):
        follow(Scene(graph.replace(shear_force=[0, 0, 0.05, 0]), LAW), stage, closure="affine")
    with pytest.raises(InputError, match="batch axes"):
        follow(Scene(diamond([0.7, 0.8]), LAW), stage, closure="affine")
    with pytest.raises(InputError, match="affine image"):
        bent = graph.x + np.array([[0.01, 0.0], [0, 0], [0, 0], [0, 0]])
        sides = np.hypot(*(np.roll(bent, -1, axis=0) - bent).T)
        twisted = GrainGraph(
            x=bent, x0=graph.x0, radii=[0.5] * 4, contacts=graph.contacts, normal_force=1 - sides
        )
        follow(Scene(twisted, LAW), stage, closure="affine")


def test_rates_at_a_state_softening_makes_two_solutions():
    # At the peak under force control a falling force unloads the loop or lets it slide on.
    force = Stage(programmes.proportional_stress(1, 0), "P11", 0.5)
    path = at_45([isotropic(0.05), force])
    graph = diamond(
        np.pi / 4,
        E1=path.H[-1, 0],
        E2=path.H[-1, 3],
        T=TABLE_1.mu * float(overlap_ratio(path.H[-1, 0], path.H[-1, 3], np.pi / 4)),
    )
    assert graph.shear_force == pytest.approx(path.shear_force[-1], abs=1e-13)
    assert (path.shear_force[-1] * DIAMOND_SHEAR_SIGNS > 0).all()
    rising = rates_at(
        Scene(graph, LAW, boundary_of(graph, volume=SQUARE_BOX)),
        programmes.proportional_stress(1, 0),
        closure="affine",
    )
    falling = rates_at(
        Scene(graph, LAW, boundary_of(graph, volume=SQUARE_BOX)),
        programmes.proportional_stress(-1, 0),
        closure="affine",
    )
    assert (rising.status, falling.status) == ("none", "several")
    regimes = sorted(found.rates.mode.regime.tolist() for found in falling.solutions)
    assert regimes == [[Regime.ELASTIC] * 4, [Regime.SLIDING] * 4]
    assert rising.exhaustive
    assert falling.exhaustive


@pytest.mark.parametrize(("order", "closure"), [(5, "affine"), (12, "traction")])
def test_a_loop_that_is_asked_to_pull_comes_apart(closure, order):
    law = LinearFrictional(kn=1.0, kt=0.3, mu=0.3)
    falling = programmes.isotropic_stress(-1.0)
    stages = [
        Stage(programmes.isotropic_strain(), "H11", 0.1),
        Stage(falling, "P11", 0.0),
        # It is there already, and beyond there is nothing.
        Stage(falling, "P11", 0.0),
        Stage(falling, "P11", -0.1),
    ]
    path = follow(Scene(regular_polygon(order), law), stages, closure=closure)
    assert path.status == "no_load", path.message
    assert "carry no force" in path.message
    assert np.abs(path.P[-1]).max() < 1e-12
