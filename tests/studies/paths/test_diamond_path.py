"""The diamond's drained stage: point B, energies, events, Coulomb's law, polar at B."""

import mpmath
import numpy as np
import pandas as pd
import pytest

from loops import Regime
from stability import symmetric_part
from studies.paths.diamond import path_dependence_table
from studies.paths.options import DiamondOptions
from tests.oracles.diamond import work_compress_then_shear
from tests.oracles.diamond import work_shear_then_compress as shear_then_compress
from tests.oracles.drained import drained_path
from tests.studies.paths.followed import followed, summary_of

POINT_B = {
    1: ("0.40973434897033423289", "0.164934999828385506", "0.25400990008305293503"),
    2: ("0.41619122318013548716", "-0.072382919123994869769", "0.31215593602737202138"),
}
SWEEP = [
    {"table": 1},
    {"table": 2},
    {"confine": 0.1},
    {"phi_deg": 0.0},
    {"phi_deg": 90.0},
    {"alpha0_deg": 10.0, "confine": 0.0, "phi_deg": 30.0},
    {"alpha0_deg": 18.0, "kappa": 1.26, "confine": 0.0, "phi_deg": 89.0},
    {"alpha0_deg": 42.0, "confine": 0.0, "phi_deg": 43.0},
    {"alpha0_deg": 28.0, "kappa": 1.5, "phi_deg": 6.0, "confine": 0.65},
    {"alpha0_deg": 6.0, "kappa": 6.0, "phi_deg": 85.0, "confine": 0.1},
    {"kappa": 0.0},
]


def shear_ratio(path):
    """`|T|/(mu N)`, NaN where the contacts carry no force."""
    with np.errstate(invalid="ignore"):
        return np.abs(path.states.T) / (path.loop.mu * path.states.N)


def kinds(path, stage="drained"):
    """Kinds of the events of a stage, in order."""
    return [kind for kind, row in path.listed if path.stage[row] == stage]


# Point B and the path around it


@pytest.mark.parametrize("table", [1, 2])
def test_point_B_to_20_digits(table):
    (event,) = [one for one in summary_of(table=table)["events"] if one["kind"] == "yield"]
    found = {key: value for key, value in event.items() if key != "kind"}
    for key, digits in zip(("E1", "E2", "s1"), POINT_B[table], strict=True):
        # Steps have a tolerance of 1e-12; measured: 1.5e-15.
        assert abs(mpmath.mpf(found[key]) - mpmath.mpf(digits)) < 2e-15
    state = summary_of(table=table)["states"]["B"]
    assert {key: state[key] for key in found} == found
    assert (state["regime"], state["beyond"]["regime"]) == ("elastic", "sliding")


@pytest.mark.parametrize("table", [1, 2])
def test_slope_at_A_is_det_K_over_K22(table):
    path = followed(table=table)
    K = path.states.K[path.marks["A"]]
    found = path.verification()["slope_at_A"]
    assert found["closed_form"] == pytest.approx(np.linalg.det(K) / K[1, 1], rel=1e-12)
    assert found["difference"] < 1e-11


def test_axial_stress_follows_the_slope_everywhere():
    path = followed(table=2)
    drained = path.stage == "drained"
    slope = (path.det_K / path.K[:, 1, 1])[drained]
    rates = path.path.P_rate[drained, 0] / path.path.H_rate[drained, 0]
    np.testing.assert_allclose(rates, slope, rtol=2e-14)
    # And by differences, of second order over rows that are a hundredth apart.
    for slides in (False, True):
        rows = drained & (path.states.sliding == slides)
        measured = np.gradient(path.states.s1[rows], path.states.E1[rows], edge_order=2)
        np.testing.assert_allclose(measured, path.det_K[rows] / path.K[rows, 1, 1], rtol=2e-2)


@pytest.mark.slow
def test_lateral_stress_is_held_and_the_path_goes_on_in_E1():
    for arguments in SWEEP:
        path = followed(**arguments)
        drained = path.stage == "drained"
        s2 = path.states.s2[drained]
        # Steps lengthen until the integrator's tolerance where the path is flat: 2e-13 at 0.65.
        rtol = 1e-12 if arguments.get("confine") == 0.65 else 1e-13
        np.testing.assert_allclose(s2, s2[0], rtol=rtol, atol=1e-14)
        # Both rows of a state at a change come from formulas of their own: the last bit may differ.
        assert np.all(np.diff(path.states.E1) > -2e-16)


def test_the_path_ends_where_the_followed_strain_is_used_up():
    assert followed(table=1).states.E1[-1] == pytest.approx(0.6, abs=1e-15)
    late = followed(table=2)
    assert late.states.E1[-1] == pytest.approx(float(POINT_B[2][0]) + 0.15, abs=1e-15)


# Energy


@pytest.mark.slow
def test_without_lateral_force_yield_is_the_end_of_strain_control():
    # T = N tan(alpha) there: sliding contacts hold alpha at phi, and slip would have to go back.
    for alpha0, phi in ((10.0, 30.0), (18.0, 89.0), (44.0, 84.0), (60.0, 85.0)):
        path = followed(alpha0_deg=alpha0, confine=0.0, phi_deg=phi)
        assert kinds(path)[-2:] == ["yield", "control_limit"]
        assert np.degrees(path.states.alpha[-1]) == pytest.approx(phi, abs=1e-11)


@pytest.mark.parametrize("arguments", SWEEP, ids=str)
def test_energy_balance_closes(arguments):
    path = followed(**arguments)
    assert path.energy_imbalance() < 3e-14
    assert np.all(np.diff(path.energies["dissipated"]) >= 0.0)


def test_work_of_isotropic_strain_in_closed_form():
    path = followed(table=2)
    rows, t0 = path.stage == "isotropic", np.tan(np.radians(35.0))
    expected = 0.5 * path.states.E1[rows] ** 2 * (t0 + 1.0 / t0)
    np.testing.assert_allclose(path.energies["work"][rows], expected, rtol=1e-14, atol=1e-18)


# Events


def test_second_pair_of_opposite_grains_meets_where_its_diagonal_is_two_radii():
    path = followed(table=2)
    rows = [row for kind, row in path.listed if kind == "opposite_contact"]
    E1 = path.states.E1[rows[-1]]
    assert abs(E1 - (1 - 1 / (2 * mpmath.cos(mpmath.radians(35))))) < 1e-15


def test_sticking_again_is_an_event_and_the_path_goes_on():
    path = followed(alpha0_deg=28.0, kappa=1.5, phi_deg=6.0, confine=0.65)
    assert kinds(path) == ["yield", "unloading"]
    row = path.listed[-1][1]
    exact = drained_path(path.loop)
    # Where slip stops smoothly its zero is known to the integrator's tolerance: 2e-13.
    assert abs(path.states.alpha[row] - exact.stick_angle) < 5e-13
    assert path.states.T[row] < 0.0
    assert (path.states.sliding[row], path.states.sliding[row + 1]) == (True, False)
    ratio = shear_ratio(path)
    assert np.all(ratio[row + 2 :] < 1.0)
    # Nothing slips at that instant: slip stops without a kink.
    heat = path.energies["dissipated"]
    assert abs(heat[row] - heat[row - 1]) < 2e-2 * heat[row]


def test_without_lateral_force_contacts_open_at_once():
    path = followed(confine=0.0)
    assert [kind for kind, _ in path.listed] == ["programme_change", "opening"]
    assert not path.energies["work"].any()


def test_a_path_that_snaps_back_ends_at_B():
    path = followed(alpha0_deg=10.0, confine=0.0, phi_deg=30.0)
    assert kinds(path) == ["yield", "control_limit"]
    assert path.marks["B"] == len(path.energies["work"]) - 1
    K22 = beyond_yield_operator(path)[1, 1]
    assert K22 < 0.0 < path.states.K[-1, 1, 1]


# Coulomb's law


def test_coulombs_law_holds_beyond_B():
    for table in (1, 2):
        path = followed(table=table)
        slides = path.states.sliding
        np.testing.assert_allclose(shear_ratio(path)[slides], 1.0, rtol=1e-14)
        assert np.all(shear_ratio(path)[~slides][1:] <= 1.0 + 1e-14)


# Operators and directions


def beyond_yield_operator(path):
    return path.beyond.K[0]


@pytest.mark.parametrize("table", [1, 2])
def test_generic_operator_agrees_on_the_whole_path(table):
    found = followed(table=table).verification()
    assert found["generic_vs_closed_form_max_relative"] < 2e-14
    assert found["det_K_max_difference"] < 1e-14
    assert found["bromwich_margin_min"] > -1e-15
    assert found["generic_affine_untrusted"] == found["generic_traction_untrusted"] == 0


def test_loading_direction_enters_the_cone_at_A():
    for table in (1, 2):
        path = followed(table=table)
        rows = path.table
        isotropic = rows["stage"] == "isotropic"
        np.testing.assert_allclose(rows["loading_alphaE_deg"][isotropic], 45.0, atol=1e-13)
        assert rows["w2_loading"][isotropic].min() > 0.0
        assert rows["w2_loading"][~isotropic].max() < 0.0
        # Under constant s2 the work is s1' E1': its sign is that of (33).
        slope = rows["det_K"] / rows["K22"]
        assert np.all(np.sign(slope[~isotropic]) == np.sign(rows["w2_loading"][~isotropic]))


def test_polar_diagram_at_B_takes_the_regime_that_a_direction_activates():
    path = followed(table=2)
    diagram, work, _ = path.directions["B"]
    slides = (work.regime == Regime.SLIDING).all(axis=1)
    loading = np.radians(path.table["loading_alphaE_deg"][path.marks["B"] + 1])
    along = int(np.argmin(np.abs(diagram.angle - loading)))
    assert slides[along] and not slides[(along + 360) % 720]
    # Along each direction: the stress rate of a small step by the contact law itself.
    row, loop = path.marks["B"], path.loop
    E, (N, T, a, length) = diagram.direction, (
        path.states.N[row], path.states.T[row], path.states.alpha[row], path.states.length[row]
    )  # fmt: skip
    D1, D2 = 2 * np.cos(loop.alpha0) * E[:, 0], 2 * np.sin(loop.alpha0) * E[:, 1]
    N_rate = 0.5 * (np.cos(a) * D1 + np.sin(a) * D2)
    arc = 0.5 * (np.sin(a) * D1 - np.cos(a) * D2)
    T_rate = np.minimum(loop.kappa * arc, loop.mu * N_rate)
    turn = arc / length
    F1 = 2 * (N_rate * np.cos(a) + T_rate * np.sin(a)) + 2 * turn * (T * np.cos(a) - N * np.sin(a))
    F2 = 2 * (N_rate * np.sin(a) - T_rate * np.cos(a)) + 2 * turn * (N * np.cos(a) + T * np.sin(a))
    s1, s2 = F1 / (2 * np.sin(loop.alpha0)), F2 / (2 * np.cos(loop.alpha0))
    work = (s1 * E[:, 0] + s2 * E[:, 1]) / np.hypot(s1, s2)
    np.testing.assert_allclose(diagram.work, work, atol=1e-13)


def test_cone_beyond_B_is_that_of_the_sliding_operator():
    path = followed(table=1)
    edges = np.radians(summary_of(table=1)["states"]["B"]["beyond"]["cone"]["edges_deg"])
    Ks = symmetric_part(beyond_yield_operator(path))
    for theta in edges:
        e = np.array([np.cos(theta), np.sin(theta)])
        assert abs(e @ Ks @ e) < 1e-14


# Fig. 4


def test_works_of_both_routes_by_integration():
    table = pd.DataFrame(path_dependence_table(DiamondOptions(table=2).parameters, 7))
    alpha, D = np.radians(table["alpha_deg"].to_numpy()), table["compression"].to_numpy()
    for route, closed in (
        ("shear_then_compress", shear_then_compress(1.0, alpha, D, 1.0, 0.24)),
        ("compress_then_shear", work_compress_then_shear(1.0, alpha, D, 1.0, 0.24)),
    ):
        np.testing.assert_allclose(table[f"{route}_integrated"], closed, rtol=1e-11)
        np.testing.assert_allclose(table[route], closed, rtol=1e-15)
    gap = table["shear_then_compress_integrated"] - table["compress_then_shear_integrated"]
    expected = 0.5 * 0.24 * alpha**2 * (1.0 - (1.0 - D) ** 2)
    np.testing.assert_allclose(gap, expected, rtol=1e-9, atol=1e-13)


def test_the_path_goes_on_beyond_a_late_B():
    path = followed(alpha0_deg=75.0, kappa=0.1, phi_deg=10.0, confine=0.05)
    exact = float(drained_path(path.loop).end.E1)
    assert exact > 0.35  # the end if nothing were known of B
    assert path.E1[path.marks["B"]] == pytest.approx(exact, abs=1e-14)
    assert path.E1[-1] == pytest.approx(exact + 0.15, abs=1e-14)
