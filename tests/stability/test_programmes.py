"""Loading programmes: what they control, and what they refuse."""

import numpy as np
import pytest

from loops import InputError, LinearFrictional, Scene, contact_state
from patterns import regular_polygon
from stability import COMPONENTS, Programme, Stage, follow, programmes

ZERO = np.zeros(4)


def controlled(programme):
    """Name and rate of the single component that each row controls."""
    names = {}
    for row in range(4):
        (column,) = np.flatnonzero(np.hstack([programme.stress[row], programme.strain[row]]))
        name = ("P" if column < 4 else "H") + COMPONENTS[column % 4]
        names[name] = float(programme.rate[row])
    return names


@pytest.mark.parametrize(
    ("programme", "expected"),
    [
        (programmes.isotropic_strain(2.0), {"H11": 2.0, "H12": 0.0, "H21": 0.0, "H22": 2.0}),
        (programmes.isotropic_stress(), {"P11": 1.0, "H12": 0.0, "H21": 0.0, "P22": 1.0}),
        (programmes.drained_biaxial(), {"H11": 1.0, "H12": 0.0, "H21": 0.0, "P22": 0.0}),
        (programmes.drained_biaxial(2, -1.0), {"P11": 0.0, "H12": 0.0, "H21": 0.0, "H22": -1.0}),
        (programmes.oedometric(), {"H11": 1.0, "H12": 0.0, "H21": 0.0, "H22": 0.0}),
        (programmes.oedometric(axis=2), {"H11": 0.0, "H12": 0.0, "H21": 0.0, "H22": 1.0}),
        (programmes.proportional_strain(1, -2), {"H11": 1.0, "H12": 0.0, "H21": 0.0, "H22": -2.0}),
        (programmes.proportional_stress(0, 3), {"P11": 0.0, "H12": 0.0, "H21": 0.0, "P22": 3.0}),
    ],
)
def test_each_programme_controls_what_its_name_says(programme, expected):
    assert controlled(programme) == expected


@pytest.mark.parametrize("axis", [1, 2])
def test_undrained_rates_keep_the_determinant(axis):
    H = np.array([0.2, 0.05, -0.1, -0.3])
    stress, strain, rate = programmes.undrained(axis=axis).equations(H, ZERO)
    assert not stress.any()
    H_rate = np.linalg.solve(strain, rate)
    F, F_rate = np.eye(2) - H.reshape(2, 2), -H_rate.reshape(2, 2)
    assert np.trace(np.linalg.solve(F, F_rate)) == pytest.approx(0, abs=1e-15)
    assert H_rate[0 if axis == 1 else 3] == 1.0


def test_undrained_starts_as_opposite_strains():
    _, strain, rate = programmes.undrained().equations(ZERO, ZERO)
    assert np.linalg.solve(strain, rate).tolist() == [1.0, 0.0, 0.0, -1.0]


def test_programmes_are_read_only():
    programme = programmes.oedometric()
    with pytest.raises(ValueError, match="read-only"):
        programme.strain[0, 0] = 2.0


@pytest.mark.parametrize(
    ("stress", "strain", "rate", "match"),
    [
        (np.zeros((4, 4)), np.diag([1.0, 1, 1, 0]), [1, 0, 0, 0], "3 independent equations"),
        (np.zeros((4, 4)), np.eye(4), np.zeros(4), "rate that is not zero"),
        (np.zeros((3, 4)), np.eye(4), [1, 0, 0, 0], "stress of the programme"),
        (np.zeros((4, 4)), np.full((4, 4), np.nan), [1, 0, 0, 0], "strain of the programme"),
        (np.zeros((4, 4)), np.eye(4), [1, 0, np.inf, 0], "rate of the programme"),
    ],
)
def test_bad_combinations_are_refused(stress, strain, rate, match):
    with pytest.raises(InputError, match=match):
        programmes.combination(stress, strain, rate)


def test_bad_axis_quantity_and_target_are_refused():
    with pytest.raises(InputError, match="axis"):
        programmes.oedometric(axis=3)
    with pytest.raises(InputError, match="quantity"):
        Stage(programmes.oedometric(), "E11", 0.1)
    with pytest.raises(InputError, match="target"):
        Stage(programmes.oedometric(), "H11", np.nan)


def test_one_component_may_be_given_in_both_tensors():
    mixed = Programme("mixed", np.diag([0, 0, 0, 1.0]), np.diag([1.0, 1, 1, 2]), [1, 0, 0, 0])
    assert mixed.equations(ZERO, ZERO)[0][3, 3] == 1.0


ROWS = {
    "cauchy 22": programmes.cauchy_drained(),
    "cauchy 11": programmes.cauchy_drained(axis=2),
    "fluid": programmes.undrained(fluid_bulk_modulus=0.7),
    "area": programmes.undrained(axis=2),
    "nominal": programmes.drained_biaxial(),
}


@pytest.mark.parametrize("name", ROWS)
def test_equations_are_the_slopes_of_the_controlled_values(name):
    """Sheared states too; central differences of step h have an error of h^2 and rounding / h."""
    programme, rng = ROWS[name], np.random.default_rng(4)
    h = 1e-5
    for _ in range(5):
        H, P, dH, dP = (0.3 * rng.standard_normal(4) for _ in range(4))
        stress, strain, _ = programme.equations(H, P)
        above, below = (programme.values(H + s * h * dH, P + s * h * dP) for s in (1, -1))
        slope = (above - below) / (2 * h)
        np.testing.assert_allclose(stress @ dP + strain @ dH, slope, rtol=1e-8, atol=1e-8)


def test_cauchy_stress_is_that_of_the_nominal_one_turned_and_stretched():
    H, P = np.array([0.2, 0.05, -0.1, -0.3]), np.array([1.0, 0.2, 0.3, 2.0])
    F = np.eye(2) - H.reshape(2, 2)
    sigma = P.reshape(2, 2) @ F.T / np.linalg.det(F)
    assert programmes.cauchy_drained().values(H, P)[3] == pytest.approx(sigma[1, 1], rel=1e-15)
    assert programmes.cauchy_drained(2).values(H, P)[0] == pytest.approx(sigma[0, 0], rel=1e-15)


@pytest.mark.parametrize(
    "given", [{"cauchy_row": 1}, {"cauchy_row": 3, "fluid_bulk_modulus": -1.0}]
)
def test_bad_cauchy_rows_are_refused(given):
    held = programmes.oedometric()
    with pytest.raises(InputError, match=r"cauchy_row|fluid_bulk_modulus"):
        Programme("bad", held.stress, held.strain, held.rate, **given)


@pytest.mark.parametrize("modulus", [np.nan, -1.0])
def test_bad_bulk_moduli_are_refused(modulus):
    with pytest.raises(InputError, match="fluid_bulk_modulus"):
        programmes.undrained(fluid_bulk_modulus=modulus)


def test_names_are_those_of_the_module_and_of_the_command():
    pairs = {
        "drained": programmes.drained_biaxial, "isotropic": programmes.isotropic_strain,
        "cauchy-drained": programmes.cauchy_drained, "simple_shear": programmes.simple_shear,
        "isotropic-stress": programmes.isotropic_stress, "undrained": programmes.undrained,
    }  # fmt: skip
    for name, make in pairs.items():
        assert Stage(name, "H11", 0.1).programme.name == make().name
    with pytest.raises(InputError, match=r"proportional-strain.*drained_biaxial"):
        Stage("proportional-strain", "H11", 0.1)
    with pytest.raises(InputError, match="programme: got 3"):
        Stage(3, "H11", 0.1)


@pytest.mark.parametrize(("length", "kn"), [(1.0, 1.0), (2.0**-9, 2.0**30), (2.0**9, 2.0**-30)])
def test_a_control_may_join_stress_and_strain(length, kn):
    """A loop between springs: `P11 + kn H11` grows by kn times the parameter, P22 stays."""
    loop, law = regular_polygon(4), LinearFrictional(kn, 0.3 * kn, 0.2)
    x = length * loop.x
    graph = loop.replace(x=x, x0=x, radii=1.02 * length * loop.radii)
    graph = graph.replace(normal_force=law.normal_force(contact_state(graph)))
    rows = np.diag([1.0, 0.0, 0.0, 1.0]), np.diag([kn, 1.0, 1.0, 0.0])
    springs = programmes.combination(*rows, [kn, 0.0, 0.0, 0.0], "springs")
    path = follow(Scene(graph, law), Stage(springs, "parameter", 0.01), closure="traction")
    assert path.status == "finished" and path.H[-1, 0] > 1e-3
    joined = path.P[:, 0] / kn + path.H[:, 0]
    np.testing.assert_allclose(joined - joined[0], path.parameter, rtol=0, atol=1e-14)
    np.testing.assert_allclose(path.P[:, 3] / kn, path.P[0, 3] / kn, rtol=0, atol=1e-14)
