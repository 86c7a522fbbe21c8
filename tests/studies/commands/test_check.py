"""`grainloops check`: what it prints, writes and exits with."""

import json

import pandas as pd
import pyarrow
import pyarrow.parquet
import pytest

from patterns import sample_path
from tests.command import refusal, run
from tests.patterns import snapshot_faults as faults


@pytest.fixture
def spoilt(tmp_path):
    deck = faults.Tables("csv", sample_path())
    faults.turn_fn(deck)
    faults.other_units(deck)
    return deck.write(tmp_path)


def test_findings_are_printed_and_written(capsys, spoilt, tmp_path):
    out = tmp_path / "out"
    assert run("check", spoilt, "--out", out, "--csv") == 0
    shown = capsys.readouterr().out
    assert "doubt  stiffness      N is 1e+04 times" in shown and "fn is tension positive" in shown
    summary = json.loads((out / "summary.json").read_text())
    assert summary["verdict"] == "doubt" and summary["findings"]["doubt"] == 2
    table = pd.read_parquet(out / "findings.parquet")
    assert set(table["check"][table["severity"] == "doubt"]) == {"stiffness", "fn"}
    assert (out / "findings.csv").exists()


@pytest.mark.parametrize(("options", "status"), [((), 1), (("--exit-zero",), 0)])
def test_status_of_an_error(capsys, tmp_path, options, status):
    deck = faults.Tables("csv", sample_path())
    faults.flip(deck)
    path = deck.write(tmp_path)
    assert run("check", path, "--json", *options) == status
    summary = json.loads(capsys.readouterr().out)
    assert summary["verdict"] == "error"
    (error,) = [row for row in summary["checks"] if row["severity"] == "error"]
    assert error["check"] == "directions" and error["number"] < -0.9


@pytest.mark.parametrize("options", [(), ("--exit-zero",)])
def test_every_unreadable_file_is_explained(capsys, tmp_path, options):
    names = [tmp_path / f"grains_{k}.csv" for k in (1, 2)]
    assert run("check", names[0], sample_path(), names[1], *options) == 2
    captured = capsys.readouterr()
    assert "1 snapshot: " in captured.out
    told = captured.err.splitlines()
    assert len(told) == 2 and all(str(name) in line for name, line in zip(names, told, strict=True))
    assert all("no such file" in line and "Check the path." in line for line in told)


@pytest.fixture(scope="module")
def slow(tmp_path_factory):
    """Write Yade's slow samples with kt times a factor, with or without rotations."""

    def write(factor, rotations):
        folder = tmp_path_factory.mktemp("slow")
        paths = []
        for path in sorted(sample_path("slow").glob("grains_*.parquet"))[:2]:
            deck = faults.Tables("parquet", path)
            deck["ks"] = factor * deck["ks"]
            if not rotations:
                del deck.fields["grains", "theta_z"]
            number = path.stem.split("_")[1]
            for kind in ("grains", "contacts"):
                table = pyarrow.table({n: v for (f, n), v in deck.fields.items() if f == kind})
                pyarrow.parquet.write_table(table, folder / f"{kind}_{number}.parquet")
            paths.append(folder / path.name)
        return paths

    return write


@pytest.mark.parametrize("rotations", [True, False])
@pytest.mark.parametrize(("factor", "verdict"), [(0.5, "doubt"), (1.0, "ok"), (2.0, "doubt")])
def test_kt_of_a_series(capsys, slow, factor, verdict, rotations):
    """T increments say what kt is, from the grains' own motion."""
    cells = ("--cells", sample_path("slow/cells.csv"), "--shear-increment", "radii")
    assert run("check", *slow(factor, rotations), *cells, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    told = [row for row in found["checks"] if row["check"] == "kt"]
    assert [row["severity"] for row in told] == [verdict]
    # Measured: 1e-6 with the rotations, 1e-4 with fitted ones.
    rel = 1e-5 if rotations else 1e-3
    assert [row["number"] for row in told] == pytest.approx([1 / factor], rel=rel)
    assert found["verdict"] == verdict


def test_cells_of_other_snapshots(capsys):
    cells = sample_path("slow/cells.csv")
    assert run("check", sample_path("grains_periodic.parquet"), "--cells", cells) == 2
    assert "no number in it" in capsys.readouterr().err
    assert run("check", sample_path(), "--cell", "1,0,0,1", "--cells", cells) == 2
    assert "--cell, --cells" in capsys.readouterr().err


def test_snapshot_refuses_an_error_of_check(capsys, tmp_path):
    deck = faults.Tables("csv", sample_path())
    faults.flip(deck)
    path = deck.write(tmp_path)
    assert "they pull" in refusal(capsys, "snapshot", path, "--out", tmp_path / "o")
    assert not (tmp_path / "o").exists()
