"""CSV as students write it: delimiters, decimal commas, comments, aliases, scalar shear."""

import numpy as np
import pandas as pd
import pytest

from loops import InputError
from patterns import read_snapshot, sample_path
from tests.patterns.snapshots.test_read_snapshot import CONTACTS, GRAINS, write

TABLES = ("grains", "contacts")
GRAIN_ROWS = [list(map(str, row)) for row in zip(*GRAINS.values(), strict=True)]
CONTACT_ROWS = [list(map(str, row)) for row in zip(*CONTACTS.values(), strict=True)]


def text(names, rows, mark, decimal="."):
    return "".join(mark.join(row) + "\n" for row in [names, *rows]).replace(".", decimal)


def deck(folder, mark=",", decimal=".", change=lambda written: written, ending="csv", names=None):
    """The same two tables in another hand."""
    names = names or {}
    for name, columns, rows in (
        ("grains", GRAINS, GRAIN_ROWS),
        ("contacts", CONTACTS, CONTACT_ROWS),
    ):
        header = [names.get(column, column) for column in columns]
        (folder / f"{name}_1.{ending}").write_text(change(text(header, rows, mark, decimal)))
    return folder / f"grains_1.{ending}"


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return read_snapshot(write(tmp_path_factory.mktemp("plain")))


def same(found, plain):
    for name in ("x", "radii", "contacts", "normal_force", "shear_force", "regime"):
        assert np.array_equal(getattr(found.graph, name), getattr(plain.graph, name)), name
    assert np.array_equal(found.ids, plain.ids) and np.array_equal(found.law.kn, plain.law.kn)


@pytest.mark.parametrize(
    ("mark", "decimal"),
    [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), (" ", "."), ("   ", "."),
     (" ", ","), (", ", "."), (" ; ", ",")],
)  # fmt: skip
@pytest.mark.parametrize("ending", ["csv", "txt"])
def test_delimiters_and_decimal_marks(tmp_path, plain, mark, decimal, ending):
    same(read_snapshot(deck(tmp_path, mark, decimal, ending=ending)), plain)


@pytest.mark.parametrize(
    "change",
    [
        lambda written: "# Biaxial test, 5 % strain\n\n" + written,
        lambda written: f"sep={written[2]}\n" + written,
        lambda written: "% one\n% two\n" + written,
        lambda written: written.replace("\n", "\n# between\n"),
        lambda written: "\ufeff" + written,
        lambda written: written.replace("\n", "\r\n"),
        lambda written: "# " + written,  # as numpy.savetxt writes its header
        lambda written: "".join(f"  {line}\n" for line in written.splitlines()),
        lambda written: written + "\n\n",
    ],
)
@pytest.mark.parametrize("mark", [",", ";", " "])
def test_comments_headers_and_margins(tmp_path, plain, change, mark):
    same(read_snapshot(deck(tmp_path, mark, change=change)), plain)


def test_aliases_are_read_and_noted(tmp_path, plain):
    names = {"id": "ID", "x": "pos_x", "y": "Pos_Y", "radius": "rad", "fn": "F_n", "ks": "kt",
             "id1": "i", "id2": "j", "mu": "friction"}  # fmt: skip
    found = read_snapshot(deck(tmp_path, names=names))
    same(found, plain)
    for name, other in names.items():
        assert any(f"column {other!r}" in note and f"read as {name!r}" in note
                   for note in found.notes), name  # fmt: skip
    assert set(plain.notes) <= set(found.notes)


def test_the_plain_name_and_the_column_map_come_before_an_alias(tmp_path):
    grains = {**GRAINS, "rad": [0.52] * 5}
    assert read_snapshot(write(tmp_path, grains)).graph.radii[0] == 0.51
    assert read_snapshot(write(tmp_path, grains), columns={"radius": "rad"}).graph.radii[0] == 0.52
    two = {("rad" if name == "radius" else name): values for name, values in GRAINS.items()}
    with pytest.raises(InputError, match="a column 'radius'"):
        read_snapshot(write(tmp_path, two | {"R": [1.0] * 5}))


def test_scalar_shear_along_the_turned_normal(tmp_path, plain):
    n = np.column_stack([CONTACTS["nx"], CONTACTS["ny"]])
    shear = np.column_stack([CONTACTS["fsx"], CONTACTS["fsy"]])
    along = n[:, 0] * shear[:, 1] - n[:, 1] * shear[:, 0]
    contacts = {name: v for name, v in CONTACTS.items() if name not in ("fsx", "fsy")}
    same(read_snapshot(write(tmp_path, contacts=contacts | {"ft": along.tolist()})), plain)


def test_decimal_commas_between_commas_are_named(tmp_path):
    rows = [[f"1{k},5" for k in range(5)], [f"2{k},5" for k in range(5)]]
    (tmp_path / "grains_1.csv").write_text(text(["id", "type", "x", "y", "radius"], rows, ","))
    (tmp_path / "contacts_1.csv").write_text("id1,id2\n10,11\n")
    with pytest.raises(InputError, match=r"rows of 10 numbers .* 5 names.*decimal commas"):
        read_snapshot(tmp_path / "grains_1.csv")


def test_table_without_a_header_has_its_columns_numbered(tmp_path, plain):
    path = deck(tmp_path, change=lambda written: written.partition("\n")[2])
    with pytest.raises(InputError, match=r"got columns 0, 1, 2.*without header from 0, such as"):
        read_snapshot(path)
    places = {name: k for table in (GRAINS, CONTACTS) for k, name in enumerate(table)}
    same(read_snapshot(path, columns=places), plain)


def test_a_folder_is_no_snapshot(tmp_path):
    with pytest.raises(InputError, match="got a folder, expected a snapshot's file"):
        read_snapshot(tmp_path)


def test_contacts_of_another_snapshot_are_refused(tmp_path):
    path = write(tmp_path, GRAINS | {"x": [0.0, 3.0, 3.0, 0.0, -0.5]})
    with pytest.raises(InputError, match="take both tables of one snapshot"):
        read_snapshot(path)


def test_scalar_shear_with_the_other_sign_is_found_by_the_balance(tmp_path):
    grains, contacts = (pd.read_csv(sample_path(f"{name}_biaxial.csv.gz")) for name in TABLES)
    contacts["ft"] = contacts["ny"] * contacts["fsx"] - contacts["nx"] * contacts["fsy"]
    grains.to_csv(tmp_path / "grains_1.csv", index=False, sep=";", decimal=",")
    kept = contacts.drop(columns=["fsx", "fsy", "fx_on_2", "fy_on_2"])
    kept.to_csv(tmp_path / "contacts_1.csv", index=False, sep=";", decimal=",")
    with pytest.raises(InputError, match="with the opposite shear"):
        read_snapshot(tmp_path / "grains_1.csv")
    kept.assign(ft=-kept["ft"]).to_csv(tmp_path / "contacts_1.csv", index=False)
    found, plain = (
        read_snapshot(tmp_path / "grains_1.csv").graph,
        read_snapshot(sample_path()).graph,
    )
    size = np.abs(plain.normal_force).max()
    # The file's normals and shear vectors agree with the branches to 1e-9 of the force.
    np.testing.assert_allclose(found.shear_force, plain.shear_force, rtol=0, atol=1e-8 * size)


def test_rows_may_end_with_a_delimiter_that_the_header_lacks(tmp_path, plain):
    def ended(written):
        head, *rows = written.splitlines()
        return "\n".join([head, *(f"{row};" for row in rows)]) + "\n"

    same(read_snapshot(deck(tmp_path, ";", change=ended)), plain)
