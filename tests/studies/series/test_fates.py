"""Fates of a series: the file against the tracking, survival against counts."""

import shutil
from itertools import pairwise

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet
import pytest
from scipy.stats import norm

from loops import Fate
from patterns import sample_path
from stability import RTOL
from studies.reading import plan_series, read_planar, reading, with_fingerprints
from studies.series.evolution import track_loops
from studies.series.figures import maps_of
from studies.series.run import run_series
from studies.series.skill import ENDS, pooled, survival, survival_rows, verdict_codes
from studies.series.tasks import Series
from studies.snapshot.summary import JUDGE_TITLES
from tests.studies.series.test_run import write_series


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """Four snapshots that lose many contacts, and what a run makes of them."""
    folder = tmp_path_factory.mktemp("fates")
    paths = write_series(folder / "run", 4, opened=25)
    # The last interval runs back: contacts close, loops split and are born.
    for name in ("grains", "contacts"):
        shutil.copy(folder / "run" / f"{name}_01.csv", folder / "run" / f"{name}_03.csv")
    summary = run_series(paths, folder / "out", workers=1, figures=False)
    states = list(map(read_planar, paths))
    return folder / "out", summary, [track_loops(*pair) for pair in pairwise(states)]


def test_the_file_is_what_the_tracking_says(ran):
    out, _, tracked = ran
    frame = pd.read_parquet(out / "fates.parquet")
    assert pyarrow.parquet.ParquetFile(out / "fates.parquet").num_row_groups == len(tracked)
    seen = set()
    for k, fates in enumerate(tracked):
        own = frame[(frame.snapshot_before == k) & (frame.snapshot_after == k + 1)]
        earlier, born = own[own.loop_before >= 0], own[own.loop_before < 0]
        assert earlier.loop_before.tolist() == list(range(len(fates.before)))
        assert earlier.fate.tolist() == [Fate(f).name.lower() for f in fates.before]
        assert born.fate.tolist() == ["born"] * len(born)
        assert born.successor.tolist() == np.flatnonzero(fates.after == Fate.BORN).tolist()
        later = {a: fates.links[fates.links[:, 0] == a, 1].tolist() for a in earlier.loop_before}
        assert earlier.successors.map(list).tolist() == list(later.values())
        assert born.successors.map(list).tolist() == [[b] for b in born.successor]
        # Every later loop is somebody's successor, and all that a loop split into come from it.
        assert set(np.concatenate(own.successors.tolist())) == set(range(len(fates.after)))
        assert (own.successors.map(len)[own.fate == "split"] >= 2).all()
        orders = np.append(fates.order_after, 0)
        assert own.order_after.tolist() == orders[own.successor].tolist()
        assert earlier.order_before.tolist() == fates.order_before.tolist()
        seen |= set(own.fate)
    assert seen >= {"survived", "split", "merged"}


def test_verdicts_are_those_of_the_earlier_snapshot(ran):
    out, _, _ = ran
    frame, loops = pd.read_parquet(out / "fates.parquet"), pd.read_parquet(out / "loops")
    earlier = frame[frame.loop_before >= 0].merge(
        loops, left_on=["snapshot_before", "loop_before"], right_on=["snapshot", "loop"]
    )
    for judge in list(JUDGE_TITLES)[1:]:
        smallest, verdict = earlier[f"{judge}_lambda_min"], earlier[f"{judge}_verdict"]
        assert (verdict[smallest.isna()] == "undetermined").all()
        assert (verdict[smallest < -1e-9] == "unstable").all()
        assert (verdict[smallest > 0] == "stable").all()
        assert (frame[frame.loop_before < 0][f"{judge}_verdict"] == "").all()
    assert set(earlier.traction_free_verdict) == {"stable", "unstable", "undetermined"}


def test_survival_counts_every_loop_once(ran):
    out, summary, _ = ran
    table = pd.read_parquet(out / "survival.parquet")
    evolution = pd.read_parquet(out / "evolution.parquet").set_index("snapshot")
    for (judge, number), rows in table.groupby(["judge", "snapshot_after"]):
        whole, by_order = rows[rows.order == 0], rows[rows.order > 0]
        for name in (*ENDS, "loops"):
            assert whole[name].sum() == by_order[name].sum()
        for name in ENDS:
            assert whole[name].sum() == evolution[name][number]
        frame = pd.read_parquet(out / "fates.parquet")
        own = frame[(frame.snapshot_after == number) & (frame.loop_before >= 0)]
        assert whole.loops.tolist() == [
            n for v in ("stable", "unstable", "undetermined")
            if (n := int((own[f"{judge}_verdict"] == v).sum()))
        ]  # fmt: skip
    # Row by row against the loops themselves.
    loops = pd.read_parquet(out / "fates.parquet")
    for row in table[table.judge == "traction_free"].itertuples():
        own = loops[(loops.snapshot_after == row.snapshot_after) & (loops.loop_before >= 0)]
        own = own[own.traction_free_verdict == row.verdict]
        pooled_order = own.order_before.clip(upper=8)
        own = own[(pooled_order == row.order) | (row.order == 0)]
        assert [getattr(row, name) for name in ENDS] == [(own.fate == n).sum() for n in ENDS]
    found = summary["survival"]["traction_free"]["unstable"]
    rows = table[(table.judge == "traction_free") & (table.verdict == "unstable")]
    rows = rows[rows.order == 0]
    assert found["share"] == rows.survived.sum() / rows.loops.sum()
    assert found["over_intervals"]["mean"] == pytest.approx(rows.share.mean(), rel=1e-14)
    assert found["over_intervals"]["std"] == pytest.approx(rows.share.std(ddof=0), rel=1e-12)
    assert pooled(table, "affine", "unheard of", 0) is None
    # Loops of eight grains and more are one group.
    assert table.order.max() == 8
    orders = pd.read_parquet(out / "fates.parquet").order_before
    assert (orders > 8).any()


@pytest.mark.parametrize(("survived", "loops"), [(0, 4), (7, 7), (5, 9), (980, 1000)])
def test_the_interval_is_wilsons(survived, loops):
    """At its ends the observed share is 1.96 standard deviations of the end's own share away."""
    found = survival({"survived": survived, "died": loops - survived})
    share = survived / loops
    assert found["share"] == share and found["loops"] == loops
    assert found["share_low"] <= share <= found["share_high"]
    for end in (found["share_low"], found["share_high"]):
        score = (share - end) ** 2 * loops
        # Rounding of an end of order one; an end that is the share itself has no variance left.
        assert score == pytest.approx(norm.ppf(0.975) ** 2 * end * (1 - end), abs=1e-13 * loops)


def test_the_page_has_a_map_of_every_snapshot_with_the_fates(ran, monkeypatch):
    out, _, tracked = ran
    planned = plan_series(sorted((out.parent / "run").glob("grains*")), None, reading())
    planned = with_fingerprints(planned)
    counts = [len(fates.before) for fates in tracked]
    counts.append(len(tracked[-1].after))
    maps = maps_of(Series(planned, out), counts, 2)
    assert [one.number for one in maps] == [0, 1, 2, 3]
    assert [one.first for one in maps] == [False, False, True, False]
    assert [len(one) for one in maps] == counts
    names = np.array([fate.name.lower() for fate in Fate])
    for one, fates in zip(maps, tracked, strict=False):
        assert one.columns["fate"].tolist() == names[fates.before].tolist()
        lived = one.columns["fate"] == "survived"
        assert np.isfinite(one.columns["w2"]).tolist() == lived.tolist()
    assert "fate" not in maps[-1].columns
    # Where not all fit, some are shown, the chosen one among them, and the page says so.
    monkeypatch.setattr("studies.series.figures.MOST_LOOPS", 2 * max(counts))
    some = maps_of(Series(planned, out), counts, 2)
    assert [one.number for one in some] == [0, 2, 3]
    assert some[0].about.startswith("3 of 4 snapshots are shown")
    monkeypatch.setattr("studies.series.figures.MOST_LOOPS", min(counts) - 1)
    assert maps_of(Series(planned, out), counts, 2) == []


def test_without_forces_there_are_fates_and_no_verdicts(tmp_path):
    grains = pd.read_csv(sample_path())[["id", "type", "x", "y", "radius"]]
    contacts = pd.read_csv(sample_path("contacts_biaxial.csv.gz"))[["id1", "id2"]]
    for k in range(2):
        grains.to_csv(tmp_path / f"grains_{k}.csv", index=False)
        contacts[20 * k :].to_csv(tmp_path / f"contacts_{k}.csv", index=False)
    paths = [tmp_path / f"grains_{k}.csv" for k in range(2)]
    summary = run_series(paths, tmp_path / "out", workers=1, figures=False)
    assert "survival" not in summary
    assert not (tmp_path / "out" / "survival.parquet").exists()
    frame = pd.read_parquet(tmp_path / "out" / "fates.parquet")
    assert (frame.loop_before >= 0).sum() == summary["first"]["loops"]
    assert not [name for name in frame if name.endswith("_verdict")]


def test_verdicts_on_either_side_of_the_tolerance(tmp_path):
    """Unstable beyond the tolerance alone; what was withheld is undetermined, born loops last."""
    smallest = [-2.0 * RTOL, -0.5 * RTOL, 0.5 * RTOL, 2.0 * RTOL, np.nan]
    file = tmp_path / "loops.parquet"
    pyarrow.parquet.write_table(pyarrow.table({"traction_lambda_min": smallest}), file)
    ((judge, codes),) = verdict_codes(file, np.array([0, 1, 2, 3, 4, -1])).items()
    assert judge == "traction" and codes.tolist() == [1, 0, 0, 0, 2, 3]


def test_survival_by_hand():
    """Six earlier loops, and a later one: by verdict and order, and all orders together."""
    fates = ["survived", "died", "survived", "survived", "merged", "split", "born"]
    columns = {
        "snapshot_before": pa.chunked_array([[4] * 7]),
        "snapshot_after": pa.chunked_array([[5] * 7]),
        "loop_before": pa.chunked_array([[0, 1, 2, 3, 4, 5, -1]]),
        "order_before": pa.chunked_array([[3, 3, 12, 3, 4, 3, 0]]),
        "fate": pa.chunked_array([fates]),
    }
    verdict = np.array([0, 0, 0, 1, 1, 2, 3])
    rows = pd.DataFrame(survival_rows(columns, {"affine": verdict}))
    assert (rows["judge"] == "affine").all() and (rows["snapshot_after"] == 5).all()
    found = rows.set_index(["verdict", "order"])[["loops", "survived", "share"]]
    told = {
        ("stable", 0): (3, 2), ("stable", 3): (2, 1), ("stable", 8): (1, 1),
        ("unstable", 0): (2, 1), ("unstable", 3): (1, 1), ("unstable", 4): (1, 0),
        ("undetermined", 0): (1, 0), ("undetermined", 3): (1, 0),
    }  # fmt: skip
    assert set(found.index) == told.keys()
    for key, (loops, survived) in told.items():
        assert tuple(found.loc[key]) == (loops, survived, survived / loops)
