"""`series --probe`: the columns of the evolution are those of single probes."""

import json

import numpy as np
import pandas as pd
import pytest

from loops import InputError
from studies.probe import run_probe
from studies.series.evolution import PROBE
from tests.studies.series.test_packing import CELLS, PATHS, predict
from tests.studies.series.test_run import run, write_series


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
    assert {"probes.png", "probes.svg"} <= {path.name for path in out.iterdir()}
    assert "probe" in json.loads((out / "summary.json").read_text())["definitions"]
    # The same call goes on; another number of directions is another series.
    predict(out, PATHS[:2], in_packing=False, probe=12)
    with pytest.raises(InputError, match="--force"):
        predict(out, PATHS[:2], in_packing=False, probe=13)
    with pytest.raises(InputError, match="--probe"):
        predict(out, PATHS[:2], in_packing=False)


def test_without_probes_nothing_is_added(tmp_path):
    paths = write_series(tmp_path, 2)
    run(paths, tmp_path / "out")
    assert not set(PROBE) & set(pd.read_parquet(tmp_path / "out" / "evolution.parquet"))
    for wrong in (0, -1, 2.5):
        with pytest.raises(InputError, match="probe: got"):
            run(paths, tmp_path / "other", probe=wrong)
