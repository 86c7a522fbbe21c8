"""Loading programmes: what they control, and what they refuse."""

import numpy as np
import pytest

from loops import InputError
from stability import Programme, Stage, programmes
from stability.spectra import COMPONENTS

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
    stress, strain, rate = programmes.undrained(axis=axis).equations(H)
    assert not stress.any()
    H_rate = np.linalg.solve(strain, rate)
    F, F_rate = np.eye(2) - H.reshape(2, 2), -H_rate.reshape(2, 2)
    assert np.trace(np.linalg.solve(F, F_rate)) == pytest.approx(0, abs=1e-15)
    assert H_rate[0 if axis == 1 else 3] == 1.0


def test_undrained_starts_as_opposite_strains():
    _, strain, rate = programmes.undrained().equations(ZERO)
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
    assert mixed.equations(ZERO)[0][3, 3] == 1.0
