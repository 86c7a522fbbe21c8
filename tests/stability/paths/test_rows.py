"""Rows of a path within a step, and rates of its contacts, against closed forms."""

from types import SimpleNamespace

import numpy as np
import pytest

from loops import LinearFrictional, contact_state
from patterns import random_loop
from stability.paths.model import path_model
from stability.paths.path_segment import _rows
from stability.paths.state_rates import relative_motion


def exact(s):
    """The solution of `y0' = 1`, `y1' = 2 y0`, `y2' = -y2`."""
    s = np.asarray(s, dtype=float)
    return np.stack([s, s**2, np.exp(-s)])


def step(begin, end, spacing):
    """A step whose interpolant misses the solution by an oscillation that integrates to nothing."""

    def at(y, gauge):
        rates = np.array([1.0, 2.0 * y[0], -y[2]])
        return SimpleNamespace(y=y, y_rates=rates)

    segment = SimpleNamespace(row_step=spacing, at=at)
    return SimpleNamespace(
        segment=segment, begin=begin, end=end, y_begin=exact(begin), gauge=None,
        dense=lambda s: exact(s), at=lambda theta: at(exact(begin + theta * (end - begin)), 0),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("begin", "end", "spacing"), [(0.32, 1.5, 0.1), (0.0, 0.7, 0.25), (1.1, 1.15, 0.1)]
)
def test_rows_stand_at_the_multiples_of_their_spacing(begin, end, spacing):
    """After the begin of the step, up to its end."""
    made = step(begin, end, spacing)
    marks = [k * spacing for k in range(100) if begin + 1e-12 < k * spacing <= end + 1e-12]
    found = [row.y for row in _rows(made, 1.0)]
    assert len(found) == len(marks)
    for y, mark in zip(found, marks, strict=True):
        np.testing.assert_allclose(y, exact(mark), rtol=1e-9)


def test_rows_end_before_an_event():
    """A row within a millionth of the spacing of the event is the event itself."""
    made = step(0.0, 1.0, 0.1)
    assert len(_rows(made, 0.55)) == 5
    assert len(_rows(made, 0.5 + 0.5e-7)) == 4
    assert len(_rows(made, 0.5 + 2e-7)) == 5
    assert _rows(step(0.0, 1.0, np.inf), 1.0) == []


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
