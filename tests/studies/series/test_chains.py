"""Force chains that bend between two snapshots, and the loops beside them."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import grainloops as gl
from loops import force_chains
from studies.commands import printed
from studies.series.evolution import BUCKLES, PLACES, chain_bends, chain_summary
from studies.series.figures import buckling
from tests.golden.answers import write_series
from tests.studies.series.test_run import run


def column(turn=0.0, flipped=()):
    """Seven grains pressed along a line at 30 degrees to axis 1, some contacts listed backwards."""
    along = np.array([np.cos(np.pi / 6), np.sin(np.pi / 6)])
    pairs = [[k + 1, k] if k in flipped else [k, k + 1] for k in range(6)]
    x = np.arange(7.0)[:, None] * along
    if turn:
        x[3] += np.tan(turn) * np.array([-along[1], along[0]])
    return gl.GrainGraph(x=x, radii=[0.5] * 7, contacts=pairs, normal_force=[1.0] * 6)


@pytest.mark.parametrize("flipped", [(), (1,), (0, 2, 3)])
def test_a_column_that_buckles(flipped):
    """Its middle moved aside by tan(angle): the middle segment bends by it, those beside by half.

    Both neighbours of the middle grain see one of their branches turn, the middle one both.
    """
    straight, angle = column(flipped=flipped), 0.1
    bent = column(angle, flipped)
    links, bend = force_chains(straight).bending(straight, bent.branches)
    middle = [sorted(set(straight.contacts[a]) & set(straight.contacts[b]))[0] for a, b in links]
    found = dict(zip(middle, bend, strict=True))
    # The grains at the ends carry half the stress.
    assert sorted(found) == [2, 3, 4]
    assert found[3] == pytest.approx(angle, abs=1e-14)
    assert found[2] == found[4] == pytest.approx(0.5 * angle, abs=1e-14)
    # Back again it straightens by as much.
    _, back = force_chains(straight).bending(bent, straight.branches)
    np.testing.assert_allclose(np.sort(back), np.sort(-bend), rtol=0.0, atol=1e-14)


def test_a_turn_of_the_whole_is_no_bend():
    straight, cos, sin = column(0.1), np.cos(0.4), np.sin(0.4)
    turned = straight.branches @ np.array([[cos, sin], [-sin, cos]])
    _, bend = force_chains(column()).bending(straight, turned)
    assert np.abs(bend).max() < 1e-14


@pytest.fixture(scope="module")
def states():
    """The sample of Yade, and its grains moved at random by a few hundredths of their size."""
    before = gl.read_snapshot(gl.sample_path())
    rng = np.random.default_rng(5)
    x = before.graph.x + 0.05 * before.graph.radii.mean() * rng.normal(size=before.graph.x.shape)
    return before, replace(before, graph=before.graph.replace(x=x))


def test_bends_are_those_of_the_angles_between_three_grains(states):
    before, after = states
    bend, beside = chain_bends(before, after)
    chains, expected = force_chains(before.graph), {}
    pairs = before.graph.contacts[chains.links].tolist()
    for k, (a, b) in enumerate(pairs):
        for c, d in pairs[k + 1 :]:
            shared = {a, b} & {c, d}
            if shared:
                (m,) = shared
                i, j = {a, b} - shared, {c, d} - shared
                i, j = i.pop(), j.pop()
                angle = []
                for x in (before.graph.x, after.graph.x):
                    u, v = x[i] - x[m], x[j] - x[m]
                    angle.append(np.arccos(u @ v / np.linalg.norm(u) / np.linalg.norm(v)))
                expected[frozenset((i, m)), frozenset((j, m))] = np.degrees(angle[0] - angle[1]) / 2
    assert len(bend) == len(expected) > 20
    # The arc cosine of nearly straight branches keeps half the digits.
    np.testing.assert_allclose(np.sort(bend), np.sort([*expected.values()]), rtol=0.0, atol=2e-6)
    # A loop has the largest bend of the segments whose links are among its contacts.
    of_pair = {}
    for links, value in expected.items():
        for link in links:
            of_pair[link] = max(value, of_pair.get(link, -np.inf))
    for loop, value in zip(before.faces.loops, beside, strict=True):
        at = before.faces.contacts[before.faces.offsets[loop] : before.faces.offsets[loop + 1]]
        own = [of_pair.get(frozenset(pair)) for pair in before.graph.contacts[at].tolist()]
        largest = max((one for one in own if one is not None), default=np.nan)
        assert value == pytest.approx(largest, abs=2e-6, nan_ok=True)


def test_a_cell_that_flips_or_is_renumbered_bends_nothing():
    sample = gl.read_snapshot(gl.sample_path("grains_periodic.parquet"), cell=gl.sample_cell())
    cell = sample.graph.cell
    other = cell @ np.array([[1.0, 1.0], [0.0, 1.0]])
    # The same lattice by other vectors: images follow.
    images = sample.graph.images @ np.linalg.inv([[1, 1], [0, 1]]).T.round().astype(int)
    flipped = replace(sample, graph=sample.graph.replace(cell=other, images=images))
    for later in (sample, flipped):
        bend, beside = chain_bends(sample, later)
        assert len(bend) > 10 and np.abs(bend).max() < 1e-9
        assert np.isfinite(beside).any() and len(beside) == len(sample.faces.loops)


def test_the_table_of_fates_has_the_bend_beside_each_loop(states):
    table = gl.fates(*states)
    _, beside = chain_bends(*states)
    old = table["loop_before"] >= 0
    np.testing.assert_array_equal(table["chain_bend"][old], beside)
    assert table["chain_bend"][~old].isna().all()


def test_a_series_counts_loops_by_place(tmp_path):
    out = tmp_path / "out"
    folder = tmp_path / "run"
    folder.mkdir()
    run(write_series(folder, 3), out)
    summary = json.loads((out / "summary.json").read_text())["chains"]
    fates = pd.read_parquet(out / "fates.parquet")
    work = pd.read_parquet(out / "increments")
    old = fates[fates["loop_before"] >= 0].merge(
        work[["snapshot_before", "loop_before", "W2"]], how="left"
    )
    bend, lost = old["chain_bend"], old["fate"] != "survived"
    places = {"buckled": bend > BUCKLES, "straight": bend <= BUCKLES, "elsewhere": bend.isna()}
    for place, here in places.items():
        assert summary[place]["loops"] == here.sum()
        if here.any():
            assert summary[place]["lost"]["mean"] == pytest.approx(lost[here].mean(), rel=1e-14)
            assert summary[place]["mean_order"] == pytest.approx(old["order_before"][here].mean())
            own = (old["W2"] < 0)[here & ~lost]
            found = summary[place]["negative_W2"]["mean"]
            assert found == pytest.approx(own.mean() if len(own) else None, nan_ok=True)
    assert summary["segments"] >= summary["segments_buckled"] >= 0
    assert sum(summary[place]["loops"] for place in places) == len(old) > 0


def interval(**counts):
    """Numbers of an interval: all zero but these."""
    names = [
        f"{place}_{name}" for place in PLACES for name in ("loops", "grains", "lost", "negative_W2")
    ]
    return dict.fromkeys(["segments", "segments_buckled", *names], 0) | counts


def test_each_place_has_a_line_and_a_column_if_it_has_loops():
    """Three in a hundred lost: 100 sqrt(.03 .97/100) = 1.7 % is the error of the share."""
    beside = {"straight_loops": 100, "straight_grains": 400, "straight_lost": 3}
    calm = chain_summary([interval(segments=20, **beside)])
    buckles = {"buckled_loops": 4, "buckled_grains": 20, "buckled_lost": 1}
    bent = chain_summary([interval(segments=20, segments_buckled=1, **beside, **buckles)])
    head = "of 20 segments of force chains buckle (bend by more than 1 degree over an interval)"
    straight = "loops beside other segments alone: 3.0 +- 1.7 % of 100 are lost over an interval"
    buckled = "loops beside a segment that buckles: 25.0 +- 21.7 % of 4 are lost over an interval"
    said = [
        [line for line in printed("series", {"chains": found}) if "segment" in line]
        for found in (calm, bent)
    ]
    assert said == [[f"0 {head}", straight], [f"1 {head}", buckled, straight]]
    for found, named in ((calm, ["straight"]), (bent, ["buckled", "straight"])):
        ticks = [label.get_text() for label in buckling(found).get_xticklabels()]
        assert [tick.split("\n")[0] for tick in ticks] == named
        assert not any("nan" in tick for tick in ticks)
