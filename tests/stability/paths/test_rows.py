"""Rows of a path within a step, and rates of its contacts, against closed forms."""

import numpy as np
import pytest

from loops import LinearFrictional, contact_state
from patterns import random_loop
from stability.paths.model import path_model
from tests.oracles.path_rates import relative_motion
from tests.stability.paths.driven import drive


def exact(s):
    """The solution of `y0' = 1`, `y1' = 2 y0`, `y2' = -y2`."""
    s = np.asarray(s, dtype=float)
    return np.stack([s, s**2, np.exp(-s)], axis=-1)


def rows_until(end, spacing, max_step=1.0):
    """Rows of this spacing up to an event at `end`."""
    return drive(
        lambda y: np.array([1.0, 2.0 * y[0], -y[2]]), lambda y: [y[0] - end], [0.0, 0.0, 1.0],
        row_step=spacing, max_step=max_step,
    ).rows  # fmt: skip


@pytest.mark.parametrize(
    ("end", "spacing", "max_step"), [(1.5, 0.1, 1.0), (0.7, 0.25, 0.1), (1.15, 0.1, 0.03)]
)
def test_rows_stand_at_the_multiples_of_their_spacing(end, spacing, max_step):
    marks = [k * spacing for k in range(1, 100) if k * spacing < end - 1e-9]
    found = rows_until(end, spacing, max_step)
    assert len(found) == len(marks)
    np.testing.assert_allclose(found, exact(marks), rtol=1e-11)


def test_rows_end_before_an_event():
    """A row within a millionth of the spacing of the event is the event itself."""
    assert len(rows_until(0.55, 0.1)) == 5
    assert len(rows_until(0.5 + 0.5e-7, 0.1)) == 4
    assert len(rows_until(0.5 + 2e-7, 0.1)) == 5


def test_relative_displacements_are_those_of_branches_and_spins():
    """Of a law that shears by the radii, spins times radii."""
    rng = np.random.default_rng(1)
    loop = random_loop(5, 3, polydispersity=0.3, strain=0.02)
    law = LinearFrictional(1.0, 0.4, 0.3, "radii")
    contacts = contact_state(loop)
    model = path_model(loop, contacts, law, "traction", "free", None)
    motion = rng.standard_normal((5, 4))
    rows = relative_motion(model, contacts)
    for c, (i, j) in enumerate(loop.contacts):
        d = loop.x[j] - loop.x[i]
        length, n = np.hypot(*d), d / np.hypot(*d)
        t = np.array([-n[1], n[0]])
        own = n @ motion[c, :2]
        turned = loop.radii[[i, j]].sum() / length * (t @ motion[c, :2]) - motion[c, 2:].sum()
        np.testing.assert_allclose(rows[c] @ motion[c], [own, turned], rtol=0, atol=1e-14)
