"""The diamond study under isotropic strain: events, states, verification, arguments."""

import mpmath
import numpy as np
import pandas as pd
import pytest

from loops import InputError
from studies.paths.followed import operator_diagram
from studies.paths.options import DiamondOptions
from tests.oracles.diamond import diamond_states
from tests.studies.paths.followed import followed, summary_of


def strains(path):
    """Strain of the first event of each kind in the isotropic stage."""
    found = {}
    for kind, row in path.listed:
        if path.stage[row] == "isotropic":
            found.setdefault(kind, float(path.states.E1[row]))
    return found


def isotropic_rows(path):
    """Columns of the rows of the isotropic stage."""
    rows = pd.DataFrame(path.table).query("stage == 'isotropic'")
    return {key: values.to_numpy() for key, values in rows.items()}


# Events


@pytest.mark.parametrize(
    ("table", "I", "touch", "A"),
    [
        (1, 1 / mpmath.mpf(6), 1 - 1 / mpmath.sqrt(2), mpmath.mpf("0.3")),
        (
            2,
            mpmath.mpf(6) / 31,
            1 - 1 / (2 * mpmath.sin(mpmath.radians(35))),
            mpmath.mpf("0.35") * mpmath.tan(mpmath.radians(35)),
        ),
    ],
)
def test_events_of_the_tables(table, I, touch, A):  # noqa: E741
    found = strains(followed(table=table))
    expected = {"det_K_zero": I, "det_Ks_zero": I, "opposite_contact": touch, "programme_change": A}
    assert set(found) == set(expected)
    for kind, E in expected.items():
        assert abs(found[kind] - E) < 1e-15


def test_events_stand_in_path_order():
    kinds = [[kind for kind, _ in followed(table=k).listed] for k in (1, 2)]
    assert kinds == [
        ["det_Ks_zero", "det_K_zero", "opposite_contact", "programme_change", "yield"],
        [
            "opposite_contact", "det_Ks_zero", "det_K_zero", "programme_change",
            "opposite_contact", "yield",
        ],
    ]  # fmt: skip


def test_a_confinement_short_of_I_has_no_I():
    summary = summary_of(confine=0.1)
    assert summary["states"]["I"] is None
    kinds = [event["kind"] for event in summary["events"]]
    assert kinds == ["programme_change", "yield", "opposite_contact"]
    assert summary["states"]["A"]["verdict"]["status"] == "stable"


def test_grains_that_overlap_from_the_start_have_no_event_but_a_note():
    summary = summary_of(alpha0_deg=20.0)
    assert "opposite_contact" not in strains(followed(alpha0_deg=20.0))
    assert any("overlap from the start" in note for note in summary["notes"])
    assert summary["states"]["A"]["gaps"][1] < 0.0


def test_without_shear_stiffness_the_unloaded_diamond_is_already_at_I():
    assert strains(followed(kappa=0.0))["det_K_zero"] == 0.0


# The path and its states


@pytest.mark.parametrize("table", [1, 2])
def test_path_follows_equations_39_and_40(table):
    path = followed(table=table)
    loop, rows = path.loop, isotropic_rows(path)
    E, t0 = rows["E1"], np.tan(loop.alpha0)
    x = E / (1.0 - E)
    c2 = np.cos(loop.alpha0) ** 2
    expected = {
        "E2": E, "l": 1.0 - E, "N": E, "T": 0.0 * E, "s1": E / t0, "s2": E * t0,
        "alpha_deg": np.degrees(loop.alpha0) + 0.0 * E,
        "K11": c2 * (1.0 / t0 + (loop.kappa - x) * t0), "K12": c2 * (1.0 - loop.kappa + x) * t0,
        "K21": c2 * (1.0 - loop.kappa + x) * t0, "K22": c2 * (t0**2 + loop.kappa - x) * t0,
        "det_K": loop.kappa - x, "det_Ks": loop.kappa - x,
    }  # fmt: skip
    for name, values in expected.items():
        np.testing.assert_allclose(rows[name], values, rtol=2e-15, atol=8e-15, err_msg=name)
    assert np.all(np.diff(E) > 1e-6)
    np.testing.assert_allclose([E[0], E[-1]], [0.0, loop.confinement], atol=1e-15)


def test_determinants_of_a_sheared_state_are_those_of_its_operator():
    loop = DiamondOptions(table=2).parameters
    found = diamond_states(loop, [0.2], [0.2], s1=np.array([0.4]), s2=np.array([0.1]))
    symmetric = 0.5 * (found.K + np.swapaxes(found.K, 1, 2))
    np.testing.assert_allclose(found.det_K, np.linalg.det(found.K), rtol=1e-13)
    np.testing.assert_allclose(found.det_Ks, np.linalg.det(symmetric), rtol=1e-13)
    assert found.det_Ks < found.det_K - 1e-3


def test_eigenvalues_of_table_1_are_one_and_the_determinant():
    rows = isotropic_rows(followed(table=1))
    for largest, smallest in (
        ("lambda_2", "lambda_1"),
        ("eigenvalue_2_real", "eigenvalue_1_real"),
    ):
        np.testing.assert_allclose(rows[largest], 1.0, rtol=4e-15)
        np.testing.assert_allclose(rows[smallest], rows["det_K"], rtol=0.0, atol=2e-15)
    assert not rows["eigenvalue_1_imag"].any()


def test_cone_of_table_1_at_A():
    cone = summary_of(table=1)["states"]["A"]["cone"]
    half = np.degrees(np.arctan(np.sqrt(3.0 / 7.0 - 0.2)))
    assert cone["status"] == "open"
    assert cone["axis_deg"] == pytest.approx(135.0, abs=1e-12)
    assert cone["opening_deg"] == pytest.approx(2.0 * half, abs=1e-11)
    assert cone["edges_deg"] == pytest.approx([135.0 - half, 135.0 + half], abs=1e-11)
    assert cone["unstable_fraction"] == pytest.approx(half / 90.0, abs=1e-13)


@pytest.mark.parametrize("table", [1, 2])
def test_second_order_work_vanishes_on_the_edges_of_the_cone(table):
    state = summary_of(table=table)["states"]["A"]
    edges = np.radians(state["cone"]["edges_deg"])
    e = np.stack([np.cos(edges), np.sin(edges)], axis=-1)
    np.testing.assert_allclose(np.einsum("ni,ij,nj->n", e, state["K"], e), 0.0, atol=1e-14)


@pytest.mark.parametrize("table", [1, 2])
def test_cone_closes_on_one_direction_at_I(table):
    state = summary_of(table=table)["states"]["I"]
    assert state["cone"]["status"] == "ray"
    assert state["cone"]["opening_deg"] == 0.0
    # The kernel of (42): E1'/E2' = -tan(alpha0)^2.
    theta = np.radians(state["cone"]["axis_deg"])
    slope = -(np.tan(np.radians(state["alpha_deg"])) ** 2)
    assert np.cos(theta) / np.sin(theta) == pytest.approx(slope, rel=1e-12)


@pytest.mark.parametrize("table", [1, 2])
def test_verdicts(table):
    states = summary_of(table=table)["states"]
    assert states["I"]["verdict"]["status"] == "undetermined"
    assert abs(states["I"]["verdict"]["margin"]) < 1e-15
    assert (states["A"]["verdict"]["status"], states["A"]["verdict"]["mode"]) == (
        "unstable",
        "divergence",
    )


# Verification


# Polar diagrams


def test_no_direction_is_unstable_at_I():
    for table in (1, 2):
        K = np.array(summary_of(table=table)["states"]["I"]["K"])
        work = operator_diagram(K).work
        assert 0.0 <= work.min() < 0.02


def test_share_of_unstable_directions_is_the_cones():
    for table in (1, 2):
        state = summary_of(table=table)["states"]["A"]
        work = operator_diagram(np.array(state["K"])).work
        share = np.count_nonzero(work < 0.0) / work.size
        assert share == pytest.approx(state["cone"]["unstable_fraction"], abs=2 / work.size)


# Arguments


def test_without_arguments_the_study_is_table_1s():
    assert DiamondOptions().parameters == DiamondOptions(table=1).parameters
    own = DiamondOptions(alpha0_deg=45.0, kappa=0.2, phi_deg=5.0, confine=0.3)
    assert own.parameters == DiamondOptions(table=1).parameters


@pytest.mark.parametrize(
    ("arguments", "where", "expected"),
    [
        ({"table": 3}, "--table", "1 or 2"),
        ({"table": 1, "kappa": 0.3}, "--table", "one or the other"),
        ({"alpha0_deg": 90.0}, "--alpha0", r"degrees in \(0, 90\)"),
        ({"alpha0_deg": float("nan")}, "--alpha0", "degrees"),
        ({"kappa": -0.1}, "--kappa", "zero or more"),
        ({"phi_deg": 91.0}, "--phi", "degrees"),
        ({"confine": 1.0}, "--confine", "strain"),
        ({"closure": "voigt"}, "--closure", "affine or traction"),
        ({"contact_on_touch": "go"}, "--contact-on-touch", "ignore, stop or add"),
        ({"contact_on_touch": "add", "alpha0_deg": 20.0}, "--alpha0", "30 to 60 degrees"),
    ],
)
def test_bad_arguments_are_named(arguments, where, expected):
    with pytest.raises(InputError, match=f"(?s){where}.*{expected}"):
        DiamondOptions(**arguments)
