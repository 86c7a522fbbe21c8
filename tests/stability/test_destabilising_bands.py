"""The band within which an operator is undecided: relative to its norm, and on both sides of it."""

import numpy as np
import pytest

from stability import destabilising_control, softening_control

TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_band_is_relative_to_the_operator(unit):
    # Norm 1 in these units, so that the band is rtol itself.
    above, below = unit * np.diag([1.0, -1e-2]), unit * np.diag([1.0, -1e-4])
    assert destabilising_control(above, rtol=1e-3).status == "found"
    assert destabilising_control(below, rtol=1e-3).status == "singular"
    assert softening_control(above, rtol=1e-3).status == "found"
    np.testing.assert_allclose(softening_control(above, rtol=1e-3).work, -1e-2 * unit, rtol=1e-12)
    assert softening_control(below, rtol=1e-3).status == "undetermined"


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_within_the_band_nothing_is_determined(sign):
    # Regular through the skew part alone: Ks is zero, or has one zero eigenvalue.
    for Ks in ([0.0, 0.0], [0.0, 0.5], [1e-4, 0.5]):
        assert destabilising_control(TURN + sign * np.diag(Ks), rtol=1e-3).status == "undetermined"
    definite = destabilising_control(TURN + sign * np.diag([0.1, 0.5]), rtol=1e-3)
    assert definite.status == "definite"


def test_extreme_eigenvalues_decide_in_space():
    cases = ((-1, -1, 2), "found"), ((-2, 1, 1), "found"), ((-3, -2, -1), "definite")
    for values, status in cases:
        assert destabilising_control(np.diag(values)).status == status
