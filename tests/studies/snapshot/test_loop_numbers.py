"""The number of a loop is the same whatever the reader and the order of rows."""

import numpy as np
import pyarrow.csv
import pytest

from grainloops import loop_table, read_snapshot, sample_path


@pytest.mark.parametrize("folder", ["box", "periodic"])
def test_the_same_from_xml_and_csv(folder):
    place = sample_path().parent / "yade_native" / folder
    csv, xml = (loop_table(read_snapshot(place / n)) for n in ("grains_00.csv.gz", "state.xml.gz"))
    assert len(csv) > 15
    assert csv["grains"].map(list).tolist() == xml["grains"].map(list).tolist()
    # Positions in text differ from Yade's own in the last places.
    np.testing.assert_allclose(csv["area"], xml["area"], rtol=1e-9)


def test_the_same_from_rows_in_any_order(tmp_path):
    rng = np.random.default_rng(4)
    for table in ("grains", "contacts"):
        rows = pyarrow.csv.read_csv(sample_path(f"{table}_biaxial.csv.gz"))
        shuffled = rows.take(rng.permutation(len(rows)))
        pyarrow.csv.write_csv(shuffled, tmp_path / f"{table}_1.csv")
    one, other = (
        loop_table(read_snapshot(path))
        for path in (sample_path("grains_biaxial.csv.gz"), tmp_path / "grains_1.csv")
    )
    members = one["grains"].map(list).tolist()
    assert other["grains"].map(list).tolist() == members
    assert members == sorted(members, key=lambda ring: ring[:2])
    assert all(ring[0] == min(ring) for ring in members)
    np.testing.assert_allclose(other["area"], one["area"], rtol=1e-14)
