"""`packing-paths.md` of `docs` and of `docs/evidence`: numbers are those of code and series."""

import numpy as np
import pytest

from grainloops import replay
from loops import Scene
from stability import follow
from stability.packing import (
    equations_of_motion,
    path,
    point,
    rattlers,
    regime_factor,
    strain_increment,
)
from stability.packing.path import PackingPathOptions
from tests.docs.pages import page, says, sections, tables
from tests.packings import loop_changes, strained
from tests.yade_slow import in_collection, predicted, slow, strain_between

PAGE = " ".join((page("packing-paths") + page("evidence/packing-paths")).split())
TABLES = {section: tables(part) for section, part in sections(page("evidence/packing-paths"))}
TABLE, FORETOLD = TABLES["What it predicts"]


def test_settings():
    usual = PackingPathOptions()
    assert f"Intervals of strain {usual.interval:.0e}".replace("e-06", "e-6") in PAGE
    assert f"At {usual.instabilities} unstable contacts" in PAGE
    assert f"gap below {point.MAY_CLOSE_GAP} mean diameters" in PAGE
    assert f"Beyond {regime_factor.RANK} columns" in PAGE
    assert regime_factor.REGULARISATION == 1e-11 and "a ground spring of 1e-11 kn" in PAGE
    shares = rattlers.LOADED_SHARE, rattlers.UNLOADED_SHARE, rattlers.LIGHT_SHARE
    assert shares == (1e-4, 1e-5, 1e-2)
    assert rattlers.CAUGHT_SHARE == 2e-3 and "at a force of at most 2e-3 of the mean" in PAGE
    assert "no force above 1e-4 of the mean" in PAGE and "until 1e-5 of the mean force" in PAGE
    assert path.HISTORY == 64 and path.STRETCH == 0.5 and "half of them, at most 64" in PAGE
    assert path.MOST_HALVINGS == 5 and path.CONVERGED == 0.01 and "After five halvings" in PAGE
    assert (
        strain_increment.GROUND_SPRINGS[:3] == (1e-3, 1e-2, 1e-1) and "1e-3, 1e-2, 1e-1 kn" in PAGE
    )
    assert f"more than {strain_increment.CHATTER} events of a contact in an interval" in PAGE
    motion = equations_of_motion
    assert (motion.SNAP_RATE, motion.REST_FORCE, motion.REST_STRAIN) == (2.5e-7, 1e-6, 1e-2)
    assert f"after {motion.CHECK_STEPS * motion.MAX_CHECKS:,} steps without rest" in PAGE
    assert strain_increment.MAX_SPEED_RATIO == 1e3 and "1000 times the strain" in PAGE
    assert point.JUMP == 0.5 and f"leaps by {point.LEAP} diameters" in PAGE


@pytest.mark.slow
@in_collection
@pytest.mark.parametrize("row", [5, 6])
def test_slow_replays(row):
    """The same loops, and forces as near as the page says; replays turn on rounding."""
    told = TABLES["What is quasi-static about Yade"][0][row]
    number = int(told["snapshot"])
    (one, _), (two, _) = slow(number), slow(number + 1)
    H, graph = strain_between(one, two), one.graph
    way = follow(Scene(graph, one.law), strained(H), closure="packing", instabilities=1000)
    end = replay(Scene(graph, one.law), H, inertial_number=2.5e-7, balanced=True).state
    for title, reached in (("AUC: path", way.states[-1]), ("AUC: slow replay", end)):
        found = predicted(one, two, lambda faces, s=reached: loop_changes(graph, s, faces))
        assert found == pytest.approx(float(told[title]), abs=3e-3)
    first, last, other = (s.forces[: graph.contact_count] for s in (*way.states, end))
    apart = np.linalg.norm(last - other) / np.linalg.norm(other - first)
    assert apart == pytest.approx(float(told["distance of the forces"]), rel=0.3)


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
        way = follow(Scene(one.graph, one.law), stage, closure="packing", instabilities=1000)
        end, events = way.states[-1], events + len(way.events)
        areas.append(predicted(one, two, lambda f, g=one.graph, e=end: loop_changes(g, e, f)))
    assert len(areas) == int(told["steps"])
    assert says(told["AUC: mean"], np.mean(areas))
    assert says(told["AUC: median"], np.median(areas))
    assert says(told["AUC: smallest"], np.min(areas))
    assert events == pytest.approx(int(told["events"]), rel=0.02)
