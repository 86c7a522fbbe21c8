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
from studies.reading import read_planar
from studies.series.evolution import track_loops
from studies.series.skill import survival, survival_rows, verdict_codes
from studies.snapshot.summary import JUDGE_TITLES
from tests.command import run_series
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
