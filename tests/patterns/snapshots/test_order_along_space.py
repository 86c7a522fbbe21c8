"""Grains in any order: a large snapshot is sorted along space when it is read, its ids are kept."""

import gzip

import numpy as np
import pyarrow
import pyarrow.csv
import pyarrow.parquet
import pytest

import grainloops as gl
from loops import InputError
from patterns import read_snapshot, sample_cell, sample_path, synthetic_network

WALLS, PERIODIC = sample_path(), sample_path("grains_periodic.parquet")


@pytest.fixture
def sorts(monkeypatch):
    """The samples count as large, and a jump across them as far."""
    monkeypatch.setattr("loops.compiled.COMPILED_FROM", 100)
    monkeypatch.setattr("patterns.snapshots.geometry.FAR_IN_LISTS", 4.0)


def table_of(path):
    if path.suffix == ".parquet":
        return pyarrow.parquet.read_table(path)
    with gzip.open(path) as file:
        return pyarrow.csv.read_csv(file)


def shuffled_copy(grains, folder, seed=5):
    """Both tables with other ids and rows: neither follows space any more."""
    rng = np.random.default_rng(seed)
    bodies = table_of(grains)
    contacts = table_of(grains.with_name(grains.name.replace("grains", "contacts")))
    ids = bodies["id"].to_numpy()
    renamed = dict(zip(ids.tolist(), rng.permutation(len(ids)).tolist(), strict=True))

    def renumber(table, names):
        for name in names:
            new = pyarrow.array([renamed[k] for k in table[name].to_pylist()])
            table = table.set_column(table.schema.get_field_index(name), name, new)
        return table.take(rng.permutation(len(table)))

    pyarrow.parquet.write_table(renumber(bodies, ["id"]), folder / "grains_1.parquet")
    # Forces by their parts: each is put together with the normal of its own row.
    contacts = contacts.drop_columns(["fx_on_2", "fy_on_2"])
    pyarrow.parquet.write_table(renumber(contacts, ["id1", "id2"]), folder / "contacts_1.parquet")
    return folder / "grains_1.parquet"


def loops_by_grains(snapshot):
    """Order, area, eigenvalues and stress of each loop, by the ids of its grains."""
    faces = snapshot.faces
    table = gl.loop_table(snapshot)
    names = ("order", "area", "sliding_contacts", "affine_lambda_min", "stress_11", "stress_12")
    rows = {}
    for row, face in enumerate(faces.loops.tolist()):
        grains = faces.grains[faces.offsets[face] : faces.offsets[face + 1]]
        key = tuple(sorted(snapshot.ids[grains].tolist()))
        rows[key] = [table[name][row] for name in names]
    return rows


@pytest.mark.parametrize(
    "sample, cell", [(WALLS, None), (PERIODIC, sample_cell())], ids=["walls", "periodic"]
)
def test_a_shuffled_file_gives_the_same_loops(sample, cell, tmp_path, sorts, monkeypatch):
    grains = shuffled_copy(sample, tmp_path)
    sorted_along_space = read_snapshot(grains, cell=cell)
    monkeypatch.setattr("loops.compiled.COMPILED_FROM", 10**9)
    as_numbered = read_snapshot(grains, cell=cell)
    # Grains that touch are close in memory, which by their ids they are not.
    near, far = (np.abs(np.diff(s.graph.contacts)) for s in (sorted_along_space, as_numbered))
    assert np.median(near) < 0.1 * np.median(far)
    assert (np.diff(sorted_along_space.graph.contacts[:, 0]) >= 0).all()
    assert sorted_along_space.wall_contacts == as_numbered.wall_contacts
    if as_numbered.walls is not None:
        for name in ("force", "branch"):
            one, other = (getattr(s.walls, name) for s in (sorted_along_space, as_numbered))
            assert one.sum(axis=0) == pytest.approx(other.sum(axis=0), rel=1e-11, abs=1e-11)
    if as_numbered.rotation is not None:
        turned = dict(zip(as_numbered.ids.tolist(), as_numbered.rotation.tolist(), strict=True))
        own = [turned[k] for k in sorted_along_space.ids.tolist()]
        np.testing.assert_array_equal(sorted_along_space.rotation, own)
    expected = loops_by_grains(as_numbered)
    found = loops_by_grains(sorted_along_space)
    assert len(expected) > 100 and found.keys() == expected.keys()
    for key, values in expected.items():
        # Sums over a loop begin at another grain: rounding alone differs.
        assert found[key] == pytest.approx(values, rel=1e-7, abs=1e-9, nan_ok=True), key


def test_a_file_in_order_stays_as_it_is(tmp_path, sorts):
    graph = synthetic_network(2000, seed=2)
    given = written_as_tables(graph, tmp_path)
    read = read_snapshot(given)
    assert (np.diff(read.ids) > 0).all()
    np.testing.assert_array_equal(read.graph.contacts, graph.contacts)


def written_as_tables(graph, folder):
    """The graph as two tables, grains in the order of their rows."""
    ids, (i, j) = np.arange(graph.grain_count), graph.contacts.T
    grains = {"id": ids, "x": graph.x[:, 0], "y": graph.x[:, 1], "radius": graph.radii}
    pyarrow.parquet.write_table(pyarrow.table(grains), folder / "grains_1.parquet")
    contacts = pyarrow.table({"id1": i, "id2": j})
    pyarrow.parquet.write_table(contacts, folder / "contacts_1.parquet")
    return folder / "grains_1.parquet"


def test_a_repeated_contact_of_a_shuffled_file_is_named_by_its_rows(tmp_path, sorts):
    grains = shuffled_copy(PERIODIC, tmp_path)
    path = grains.with_name("contacts_1.parquet")
    contacts = pyarrow.parquet.read_table(path)
    pyarrow.parquet.write_table(pyarrow.concat_tables([contacts, contacts.slice(17, 1)]), path)
    one, two = contacts["id1"][17].as_py(), contacts["id2"][17].as_py()
    found = read_snapshot(grains, cell=sample_cell())
    assert found.graph.contact_count == len(contacts)
    (told,) = [one.says for one in found.findings if one.check == "repeated"]
    assert f"row {len(contacts)} and row 17 (grains {one} and {two})" in told


def test_a_wrong_radius_is_named_by_the_id_of_its_grain(sorts, tmp_path):
    """Also where grains are sorted along space: radii and ids stand in one order."""
    path = shuffled_copy(PERIODIC, tmp_path)
    grains = pyarrow.parquet.read_table(path).to_pydict()
    grains["radius"][7] = -1.0
    pyarrow.parquet.write_table(pyarrow.table(grains), path)
    with pytest.raises(InputError, match=rf"radius of grain {grains['id'][7]} in .* -1\.0"):
        read_snapshot(path, cell=sample_cell())
