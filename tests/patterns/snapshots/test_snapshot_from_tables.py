"""Snapshots from data frames and arrays, and back: what files take, tables in memory take."""

import numpy as np
import pandas as pd
import polars
import pyarrow
import pytest

from grainloops import loop_table
from loops import InputError, branch_vectors
from patterns import read_snapshot, sample_cell, sample_path, snapshot_from_tables

SLOW = np.diag([0.914723458490276, 0.897826511170329])
SAMPLES = {
    "between walls": lambda: read_snapshot(sample_path()),
    "periodic": lambda: read_snapshot(sample_path("grains_periodic.parquet"), cell=sample_cell()),
    "shear increment radii": lambda: read_snapshot(
        sample_path("slow/grains_10.parquet"), cell=SLOW
    ),
    "LIGGGHTS, walls not in the dumps": lambda: read_snapshot(
        sample_path("liggghts/atoms.0.dump.gz"), kn=1e5, kt=5e4, mu=0.5
    ),
    "Yade's box, native": lambda: read_snapshot(sample_path("yade_native/box/state.xml.gz")),
}
KINDS = {
    "pandas": pd.DataFrame,
    "polars": polars.DataFrame,
    "pyarrow": pyarrow.table,
    "arrays": dict,
    "structured": lambda table: pd.DataFrame(table).to_records(index=False),
}
GRAINS = {"id": [1, 2, 3], "x": [0.0, 0.9, 0.4], "y": [0.0, 0.0, 0.8], "radius": [0.5] * 3}
CONTACTS = {
    "id1": [1, 2, 3],
    "id2": [2, 3, 1],
    "fn": [3.0, 2.0, 2.0],
    "ft": [0.1, 0.0, -0.1],
    "kn": [30.0] * 3,
    "ks": [15.0] * 3,
    "mu": [0.5] * 3,
}


def same(one, other):
    """Equal to the last bit but for forces, which are divided into N and T once more."""
    for name in ("x", "radii", "contacts", "images", "cell", "regime"):
        np.testing.assert_array_equal(getattr(one.graph, name), getattr(other.graph, name), name)
    size = np.hypot(one.graph.normal_force, one.graph.shear_force)
    # Branches through a periodic border round the coordinates once more: that turns them by
    # eps |x| / l, and the forces with them.
    turn = (
        4 * np.finfo(float).eps * np.abs(one.graph.x).max() / np.hypot(*branch_vectors(one.graph).T)
    )
    for name in ("normal_force", "shear_force"):
        off = np.abs(getattr(one.graph, name) - getattr(other.graph, name))
        assert (off <= turn * size).all()
    np.testing.assert_array_equal(one.ids, other.ids)
    for name in ("rotation", "mass", "velocity", "spin"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), name)
    assert (one.law is None) == (other.law is None)
    if one.law is not None:
        for name in ("kn", "kt", "mu"):
            mine, yours = (
                np.broadcast_to(getattr(s.law, name), one.graph.contact_count) for s in (one, other)
            )
            np.testing.assert_array_equal(mine, yours)
        assert one.law.shear_increment == other.law.shear_increment
    assert (one.walls is None) == (other.walls is None)
    if one.walls is not None:
        assert one.wall_contacts == other.wall_contacts
        for name in ("grain", "force", "branch", "kn", "kt"):
            np.testing.assert_array_equal(getattr(one.walls, name), getattr(other.walls, name))


@pytest.mark.parametrize("sample", SAMPLES)
def test_tables_give_the_snapshot_back(sample):
    snapshot = SAMPLES[sample]()
    same(snapshot, snapshot_from_tables(**snapshot.tables()))


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_table_is_taken(kind):
    snapshot = read_snapshot(sample_path())
    tables = snapshot.tables()
    for name in ("grains", "contacts", "walls"):
        tables[name] = KINDS[kind](tables[name])
    again = snapshot_from_tables(**tables)
    same(snapshot, again)
    if kind == "pandas":
        own, theirs = loop_table(snapshot), loop_table(again)
        assert (own["order"] == theirs["order"]).all()
        # Eigenvalues over kn, of order one: the forces differ by rounding.
        columns = [name for name in own if "lambda" in name]
        np.testing.assert_allclose(own[columns], theirs[columns], rtol=0, atol=1e-11)


def test_a_file_and_its_data_frames_read_alike():
    """Aliases, walls among the grains, notes and findings are those of the file."""
    grains, contacts = (
        pd.read_csv(sample_path(f"{name}_biaxial.csv.gz")) for name in ("grains", "contacts")
    )
    contacts = contacts.rename(columns={"id1": "i", "id2": "J"})
    file, frames = read_snapshot(sample_path()), snapshot_from_tables(grains, contacts)
    same(file, frames)
    assert set(file.notes) < set(frames.notes)
    assert "column 'J' of contacts read as 'id2'" in frames.notes
    assert [one.check for one in file.findings] == [one.check for one in frames.findings]


@pytest.mark.parametrize("name", ["diameter", "Diam", "d", "D"])
def test_diameters_are_halved_with_a_note(name):
    table = {**GRAINS, name: [1.0] * 3}
    del table["radius"]
    snapshot = snapshot_from_tables(table, CONTACTS)
    assert snapshot.graph.radii.tolist() == [0.5] * 3
    assert "radius is half the column 'diameter' of grains" in snapshot.notes


def test_radii_come_before_diameters_and_own_names_can_be_mapped():
    both = snapshot_from_tables({**GRAINS, "d": [9.0] * 3}, CONTACTS)
    assert both.graph.radii.tolist() == [0.5] * 3
    mapped = {**GRAINS, "D50": [1.0] * 3}
    del mapped["radius"]
    snapshot = snapshot_from_tables(mapped, CONTACTS, columns={"diameter": "D50"})
    assert snapshot.graph.radii.tolist() == [0.5] * 3


def test_diameters_of_a_file_are_halved(tmp_path):
    (tmp_path / "grains_1.csv").write_text("id,x,y,D\n1,0,0,1\n2,0.9,0,1\n3,0.4,0.8,1\n")
    (tmp_path / "contacts_1.csv").write_text("i,j,fn,mu\n1,2,3,0\n2,3,2,0\n3,1,2,0\n")
    snapshot = read_snapshot(tmp_path / "grains_1.csv", kn=30.0, kt=0.0)
    assert snapshot.graph.radii.tolist() == [0.5] * 3
    assert any("radius is half the column 'diameter'" in note for note in snapshot.notes)


@pytest.mark.parametrize(
    ("grains", "contacts", "options", "said"),
    [
        ([1, 2], CONTACTS, {}, "grains: got list, expected a data frame, or a dict of arrays"),
        (np.eye(3), CONTACTS, {}, "grains: got numpy.ndarray, expected a data frame"),
        ({**GRAINS, "x": [0.0]}, CONTACTS, {}, r"grains: got columns of 3 \(id\), 1 \(x\)"),
        ({**GRAINS, "x": ["a", "b", "c"]}, CONTACTS, {}, "column 'x' of grains, row 0: got 'a'"),
        ({**GRAINS, "x": [0.0, None, 1.0]}, CONTACTS, {}, "column 'x' of grains, row 1: got nan"),
        ({"id": [1], "x": [0.0], "y": [0.0]}, CONTACTS, {}, "column 'radius' of grains"),
        (
            GRAINS,
            {**CONTACTS, "id2": [2, 3, 7]},
            {},
            "column 'id2' of contacts, row 2: got grain 7",
        ),
        (GRAINS, CONTACTS, {"columns": {"radius": "size"}}, "--columns radius=size"),
        (
            GRAINS,
            CONTACTS,
            {"walls": {"id": [9], "fx": [1], "fy": [0], "branch_x": [0.5], "branch_y": [0]}},
            "column 'id' of walls, row 0: got grain 9",
        ),
        (GRAINS, CONTACTS, {"walls": {"id": [1], "fx": [1]}}, "column 'fy' of walls"),
    ],
)
def test_bad_tables_are_told(grains, contacts, options, said):
    with pytest.raises(InputError, match=said):
        snapshot_from_tables(grains, contacts, **options)


def test_a_spreadsheet_is_told_to_be_saved_as_csv(tmp_path):
    (tmp_path / "grains.csv").write_text("id,x,y,r\n1,0,0,1\n")
    for name in ("grains.xlsx", "Packing.XLSX", "contacts.ods"):
        (tmp_path / name).write_bytes(b"PK\x03\x04" + bytes(40))
    for path, contacts in (
        ("grains.xlsx", None),
        ("Packing.XLSX", None),
        ("grains.csv", "contacts.ods"),
    ):
        with pytest.raises(InputError, match=r"got a spreadsheet, .*save as CSV"):
            beside = None if contacts is None else tmp_path / contacts
            read_snapshot(tmp_path / path, beside)


def test_tables_for_files_are_told_where_they_go():
    frames = pd.DataFrame(GRAINS), pd.DataFrame(CONTACTS)
    for path, contacts in (frames, ("grains_1.csv", frames[1])):
        with pytest.raises(InputError, match=r"got DataFrame.*call snapshot_from_tables"):
            read_snapshot(path, contacts)


@pytest.mark.parametrize("ids", [[0, 1, 2], [2, 0, 1], [5, 7, 9], [9, 5, 7], [3, 10**12, -4]])
@pytest.mark.parametrize("unknown", [6, -5, 10, 2**62])
def test_an_id_that_no_grain_has_is_named(ids, unknown):
    grains = {"id": ids, "x": [0.0, 0.9, 0.4], "y": [0.0, 0.0, 0.8], "d": [1.0, 1.0, 1.0]}
    contacts = {"i": [*ids[:2], ids[0]], "j": [*ids[1:], unknown], "fn": [1.0, 1.0, 1.0]}
    with pytest.raises(InputError, match=rf"column 'id2' of contacts, row 2: got grain {unknown},"):
        snapshot_from_tables(grains, contacts, kn=10.0, mu=0.0)
