"""The number of a loop is the same whatever the reader and the order of rows."""

import numpy as np
import pyarrow.csv
import pytest

from patterns import read_snapshot, sample_path
from studies.snapshot.table import loop_columns


def rows_of_loops(snapshot, compiled):
    return loop_columns(snapshot, compiled=compiled)


@pytest.mark.parametrize("folder", ["box", "periodic"])
def test_the_same_from_xml_and_csv(folder):
    place = sample_path().parent / "yade_native" / folder
    csv = rows_of_loops(read_snapshot(place / "grains_00.csv.gz"), False)
    xml = rows_of_loops(read_snapshot(place / "state.xml.gz"), False)
    assert len(csv["loop"]) > 15
    assert csv["grains"].to_pylist() == xml["grains"].to_pylist()
    # Positions in text differ from Yade's own in the last places.
    np.testing.assert_allclose(csv["area"], xml["area"], rtol=1e-9)


@pytest.mark.parametrize("compiled", [False, True])
def test_the_same_from_rows_in_any_order(tmp_path, compiled):
    rng = np.random.default_rng(4)
    for table in ("grains", "contacts"):
        rows = pyarrow.csv.read_csv(sample_path(f"{table}_biaxial.csv.gz"))
        shuffled = rows.take(rng.permutation(len(rows)))
        pyarrow.csv.write_csv(shuffled, tmp_path / f"{table}_1.csv")
    one = rows_of_loops(read_snapshot(sample_path("grains_biaxial.csv.gz")), False)
    other = rows_of_loops(read_snapshot(tmp_path / "grains_1.csv"), compiled)
    members = one["grains"].to_pylist()
    assert other["grains"].to_pylist() == members
    assert members == sorted(members, key=lambda ring: ring[:2])
    assert all(ring[0] == min(ring) for ring in members)
    np.testing.assert_allclose(other["area"], one["area"], rtol=1e-14)
