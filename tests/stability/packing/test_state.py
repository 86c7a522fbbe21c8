"""States of a packing: jumps of stress and centres in a short strain."""

from dataclasses import replace

import numpy as np
import pytest

from stability.packing.state import jumped, start_state
from tests.packings import jammed

STATE = start_state(jammed(16, 2))
SIZE = float(np.linalg.norm(STATE.stress))


def scaled(factor):
    return replace(
        STATE, normal_force=factor * STATE.normal_force, shear_force=factor * STATE.shear_force
    )


@pytest.mark.parametrize(
    ("before", "after", "start", "found"),
    [
        (1.0, 1.45, 0.0, ""),
        (1.0, 1.55, 0.0, "the stress jumped by 0.55 of what it was"),
        (1.0, 0.45, 0.0, "the stress jumped by 0.55 of what it was"),
        (0.01, 0.02, 0.0, "the stress jumped by 1 of what it was"),
        (0.01, 0.02, 1.0, ""),
        (1.0, 1.55, 0.1, "the stress jumped by 0.55 of what it was"),
    ],
)
def test_half_of_the_stress_is_too_much(before, after, start, found):
    """Measured by the larger of the stresses before and at the start of the path."""
    assert jumped(scaled(before), scaled(after), start * SIZE) == found


@pytest.mark.parametrize(("contacts", "lost"), [(0, False), (1, False), (2, True)])
def test_a_carrying_grain_moves_less_than_a_fiftieth_of_a_diameter(contacts, lost):
    """Measured beyond the affine motion; grains with fewer than two contacts may move more."""
    touches = (STATE.contacts == 3).any(axis=1)
    keeps = ~touches | (np.cumsum(touches) <= contacts)
    before = replace(STATE, normal_force=keeps * 1.0, shear_force=0.0 * STATE.shear_force)
    F = np.array([[0.9, 0.2], [0.1, 1.1]])
    step = 2.0 * STATE.radii.mean() * np.array([0.0, 1.0]) * (np.arange(16)[:, None] == 3)
    for share, leaps in ((0.0, False), (0.019, False), (-0.021, True)):
        after = replace(before, x=before.x @ F.T + share * step, cell=F @ before.cell)
        wanted = "a grain leapt by 0.021 diameters" if leaps and lost else ""
        assert jumped(before, after, 1e9) == wanted
