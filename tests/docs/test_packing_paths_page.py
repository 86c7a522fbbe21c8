"""`docs/packing-paths.md`: settings and numbers are those of the code and of the series."""

import inspect

import numpy as np
import pytest

from stability import follow
from stability.packing import interval, linear_pieces, loop_changes, path
from tests.docs.pages import page, says, tables
from tests.stability.packing.test_path import in_collection, strained
from tests.stability.packing.test_replay import foreseen, slow, strain_between

PAGE = " ".join(page("packing-paths").split())
(TABLE,) = tables(page("packing-paths"))


def test_settings():
    usual = inspect.signature(follow).parameters
    assert f"Intervals of strain {usual['interval'].default:.0e}".replace("e-06", "e-6") in PAGE
    assert f"At {usual['instabilities'].default} unstable contacts" in PAGE
    assert f"gap below {path.NEAR} mean diameters" in PAGE
    assert f"Beyond {linear_pieces.RANK} columns" in PAGE
    springs = linear_pieces.RATTLERS, linear_pieces.PAIRED, linear_pieces.GEARS
    assert springs == (1e-3, 1e-4, 1e-7)
    assert "springs of 1e-3 kn, those with two 1e-4, all others 1e-7" in PAGE
    assert interval.DRAGS[:3] == (1e-3, 1e-2, 1e-1) and "1e-3, 1e-2, 1e-1 kn" in PAGE
    assert f"more than {interval.CHATTER} events of a contact in an interval" in PAGE
    assert f"or {interval.IDLE} in a row" in PAGE
    assert path.JUMP == 0.5 and f"leaps by {path.LEAP} diameters" in PAGE


@pytest.mark.slow
@in_collection
@pytest.mark.parametrize(
    ("row", "numbers", "step"),
    [(0, range(2, 22), 1), (1, range(22, 32), 1), (2, range(22, 32, 2), 2), (3, (22, 27), 5)],
)
def test_skill(row, numbers, step):
    """Events by pivots turn on rounding: their count within 2 per cent, areas to their digits."""
    told, areas, events = TABLE[row], [], 0
    for number in numbers:
        (one, _), (two, _) = slow(number), slow(number + step)
        stage = strained(strain_between(one, two))
        way = follow(one.graph, one.law, stage, closure="packing", instabilities=1000)
        end, events = way.states[-1], events + len(way.events)
        areas.append(foreseen(one, two, lambda f, g=one.graph, e=end: loop_changes(g, e, f)))
    assert len(areas) == int(told["steps"])
    assert says(told["AUC: mean"], np.mean(areas))
    assert says(told["median"], np.median(areas))
    assert says(told["smallest"], np.min(areas))
    assert events == pytest.approx(int(told["events"]), rel=0.02)
