"""`series --probe`: the columns of the evolution are those of single probes."""

import json

import numpy as np
import pandas as pd
import pytest

from loops import InputError
from studies.series.figures import probes_over_strain
from tests.command import run_probe
from tests.studies.series.test_packing import CELLS, PATHS, predict


def test_undetermined_directions_are_marked():
    """Hollow with their number where there are some, a tick where no direction is determined."""
    evolution = pd.DataFrame(
        {
            **dict.fromkeys(("H11", "H12", "H21"), [0.0] * 3),
            "H22": [0.0, 1e-5, 2e-5],
            "probe_w2": [0.2, -0.1, np.nan],
            "probe_unstable_fraction": [0.0, 0.05, np.nan],
            "probe_undetermined": [0, 3, 12],
        }
    )
    for ax, value in zip(probes_over_strain(evolution).axes, (-0.1, 5.0), strict=True):
        (hollow,) = (line for line in ax.lines if line.get_markerfacecolor() == "white")
        assert hollow.get_xydata().tolist() == [[1e-5, pytest.approx(value)]]
        assert [text.get_text() for text in ax.texts] == ["3"]
        (cross,) = (line for line in ax.lines if line.get_marker() == "|")
        assert cross.get_xydata().tolist() == [[2e-5, 0.0]]
        assert len(ax.get_legend().get_texts()) == 2
    evolution["probe_undetermined"] = 0
    for ax in probes_over_strain(evolution).axes:
        assert ax.get_legend() is None and not ax.texts


@pytest.mark.slow
def test_each_snapshot_has_the_numbers_of_its_own_probe(tmp_path, unsaved):
    out = tmp_path / "out"
    predict(out, PATHS[:2], in_packing=False, probe=12, figures=True)
    table = pd.read_parquet(out / "evolution.parquet")
    cells = pd.read_csv(CELLS)[["h_xx", "h_xy", "h_yx", "h_yy"]].to_numpy()
    for k in (1,):
        how = {"cell": cells[k], "shear_increment": "radii", "figures": False}
        one = run_probe(PATHS[k], tmp_path / f"{k}", directions=12, **how)
        assert table["probe_w2"][k] == pytest.approx(one["smallest_w2"], rel=1e-9)
        assert table["probe_theta_deg"][k] == pytest.approx(one["softest_theta_deg"])
        assert table["probe_unstable_fraction"][k] == pytest.approx(one["unstable_fraction"])
        ends = table[["probe_cone_begin_deg", "probe_cone_end_deg"]].iloc[k].to_numpy()
        wanted = [[cone["begin_deg"], cone["end_deg"]] for cone in one["cones"]]
        assert np.allclose(ends, wanted[0]) if wanted else np.isnan(ends.astype(float)).all()
        assert table["probe_undetermined"][k] == one["undetermined"] == 0
    assert table["probe_w2"].min() < 0.05
    assert (out / "probes.png").is_file()
    assert "probe" in json.loads((out / "summary.json").read_text())["definitions"]
    # The same call goes on; another number of directions is another series.
    predict(out, PATHS[:2], in_packing=False, probe=12)
    with pytest.raises(InputError, match="--force"):
        predict(out, PATHS[:2], in_packing=False, probe=13)
    with pytest.raises(InputError, match="--probe"):
        predict(out, PATHS[:2], in_packing=False)
