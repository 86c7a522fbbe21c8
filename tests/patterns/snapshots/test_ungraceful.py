"""Files that are no snapshots, in ways that once ended in a traceback, a warning or minutes."""

import gzip
import io
import json
import os
import tracemalloc
import zipfile

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest

from loops import InputError
from patterns import read_snapshot, sample_path, write_snapshot
from patterns.snapshots.tables import read_table
from tests.patterns.snapshots.test_read_snapshot import CONTACTS, GRAINS, write, write_arrays
from tests.patterns.snapshots.yade_samples import BOX

LONGEST = 2000


def refusal(path, **options):
    with pytest.raises(InputError) as caught:
        read_snapshot(path, **options)
    message = str(caught.value)
    assert "\n" not in message and len(message) < LONGEST
    return message


@pytest.mark.parametrize("encoding", ["martian", "utf-7", "", "rot13"])
def test_unknown_encoding_of_xml(tmp_path, encoding):
    text = gzip.decompress((BOX / "state.xml.gz").read_bytes())
    _, rest = text.split(b"?>", 1)
    path = tmp_path / "state.xml"
    path.write_bytes(f'<?xml version="1.0" encoding="{encoding}" ?>'.encode() + rest)
    refusal(path)


def flat(tables=None):
    tables = tables or {"grains": GRAINS, "contacts": CONTACTS}
    return {f"{g}/{n}": np.array(v) for g, t in tables.items() for n, v in t.items()}


@pytest.mark.parametrize("kind", [">f8", ">f4", "longdouble", "float16"])
def test_other_floats_of_npz_are_numbers(tmp_path, kind):
    arrays = flat()
    path = tmp_path / "packing.npz"
    np.savez(path, **{n: v.astype(kind) if v.dtype.kind == "f" else v for n, v in arrays.items()})
    plain = tmp_path / "plain.npz"
    np.savez(plain, **arrays)
    one, two = (read_snapshot(p).graph.normal_force for p in (path, plain))
    np.testing.assert_allclose(one, two, rtol=1e-3)


@pytest.mark.parametrize(
    "values",
    [
        np.zeros(5, complex),
        np.zeros(5, [("a", float), ("b", int)]),
        np.array(["a"] * 5),
        np.zeros(5, "M8[s]"),
        np.full(5, np.longdouble("1e4000")),
    ],
    ids=["complex", "structured", "text", "dates", "huge"],
)
def test_other_types_of_npz_are_refused(tmp_path, values):
    path = tmp_path / "packing.npz"
    np.savez(path, **flat() | {"grains/x": values})
    assert "'x'" in refusal(path)


def test_objects_in_npz_are_refused(tmp_path):
    path = tmp_path / "packing.npz"
    np.savez(path, **flat() | {"grains/x": np.array([{}] * 5, dtype=object)})
    refusal(path)


def test_renamed_npy(tmp_path):
    path = tmp_path / "packing.npz"
    with open(path, "wb") as file:
        np.save(file, np.zeros(4))
    refusal(path)


def test_foreign_members_of_npz_are_passed_over(tmp_path):
    path = tmp_path / "packing.npz"
    np.savez(path, **flat())
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("README.txt", "a packing")
        archive.writestr("contacts/notes", b"\x93NUMPY")
    assert read_snapshot(path).graph.contact_count == 4


def test_array_that_promises_more_than_it_has(tmp_path):
    path = tmp_path / "packing.npz"
    np.savez(path, **flat())
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        head, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)}
    )
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("grains/radius2.npy", head.getvalue())
    tables = {"grains": {n: v for n, v in GRAINS.items() if n != "radius"}, "contacts": CONTACTS}
    np.savez(path, **flat(tables))
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("grains/radius.npy", head.getvalue())
    assert "cut short" in refusal(path)


def test_dataset_of_terabytes(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "packing.h5"
    write_arrays(path, {"grains": GRAINS, "contacts": CONTACTS})
    with h5py.File(path, "a") as file:
        file.create_dataset("unused", shape=(10**12,), dtype="f8", chunks=(10**6,))
        file.create_dataset("grains/unused", shape=(10**12,), dtype="f8", chunks=(10**6,))
    assert read_snapshot(path).graph.contact_count == 4
    with h5py.File(path, "a") as file:
        del file["grains/x"]
        file.create_dataset("grains/x", shape=(10**12,), dtype="f8", chunks=(10**6,))
    assert "at most" in refusal(path)


def test_nested_json(tmp_path):
    path = write(tmp_path)
    (tmp_path / "cell_1.json").write_text('{"cell": ' + "[" * 100_000 + "]" * 100_000 + "}")
    assert "cell_1.json" in refusal(path)


@pytest.mark.parametrize("size", [1e308, 1e160, 5e-324, 1e-200])
def test_cells_beyond_numbers(tmp_path, size):
    refusal(write(tmp_path), cell=[[size, 0], [0, size]])
    (tmp_path / "cell_1.json").write_text(json.dumps({"cell": [[size, 0.0], [0.0, size]]}))
    refusal(tmp_path / "grains_1.csv")


@pytest.mark.parametrize("column", ["x", "radius", "kn", "fn", "mu"])
@pytest.mark.parametrize("value", [1e308, -1e308, 1e200, 5e-324, 0.0])
def test_numbers_that_overflow_are_refused_or_read(tmp_path, column, value):
    """No warning of numpy: the tests turn them into errors."""
    grains, contacts = dict(GRAINS), dict(CONTACTS)
    table = grains if column in grains else contacts
    table[column] = [value, *table[column][1:]]
    try:
        read_snapshot(write(tmp_path, grains, contacts), strict=False)
    except InputError as error:
        assert "\n" not in str(error)


@pytest.mark.parametrize("ending", ["csv", "csv.gz", "parquet", "npz", "h5"])
def test_names_that_are_no_utf_8(tmp_path, ending):
    folder = os.fsdecode(os.fsencode(tmp_path) + b"/\xff\xfe")
    os.mkdir(folder)
    if ending in ("npz", "h5"):
        pytest.importorskip("h5py")
        path = tmp_path / f"packing.{ending}"
        write_arrays(path, {"grains": GRAINS, "contacts": CONTACTS})
        files = [path]
    else:
        path = write(tmp_path, ending=ending)
        files = [path, path.with_name(path.name.replace("grains", "contacts"))]
    for file in files:
        file.rename(os.path.join(folder, file.name))
    snapshot = read_snapshot(os.path.join(folder, path.name))
    assert snapshot.graph.contact_count == 4
    for suffix in ("csv", "parquet"):
        write_snapshot(os.path.join(folder, f"grains_2.{suffix}"), snapshot)
        again = read_snapshot(os.path.join(folder, f"grains_2.{suffix}"))
        assert again.graph.contact_count == 4


def test_a_long_header_makes_a_short_message(tmp_path):
    names = [f"column_{k:06d}" for k in range(20_000)]
    (tmp_path / "grains_1.csv").write_text(",".join(names) + "\n" + ",".join("1" * 20_000) + "\n")
    (tmp_path / "contacts_1.csv").write_text("id1,id2\n1,2\n")
    assert "20000 in all" in refusal(tmp_path / "grains_1.csv")
    assert "20000 in all" in refusal(tmp_path / "grains_1.csv", columns={"x": "none"})
    (tmp_path / "grains_1.csv").write_text("x" * 600_000 + "\n1\n")
    refusal(tmp_path / "grains_1.csv")
    (tmp_path / "grains_1.csv").write_text("id,x,y,radius\n1," + "z" * 600_000 + ",0,1\n")
    refusal(tmp_path / "grains_1.csv")


def test_many_columns_cost_no_square_of_their_number(tmp_path):
    """20,000 columns took 22 s; a square of their number would stop the tests here."""
    many = {f"c{k}": np.zeros(4) for k in range(20_000)}
    grains = {name: values[:4] for name, values in GRAINS.items()}
    contacts = {name: values[:4] for name, values in CONTACTS.items()}
    path = write(tmp_path, grains | many, contacts, ending="parquet")
    assert read_snapshot(path, columns={"fn": "fn"}).graph.grain_count == 4
    path = write(tmp_path, grains | many, contacts)
    assert read_snapshot(path).graph.grain_count == 4


def test_unused_columns_are_not_read(tmp_path):
    rows, wide = 20_000, 100
    rng = np.random.default_rng(0)
    columns = {"id": np.arange(rows)} | {f"c{k}": rng.random(rows) for k in range(wide)}
    path = tmp_path / "grains_1.parquet"
    pyarrow.parquet.write_table(pyarrow.table(columns), path)
    before = pyarrow.total_allocated_bytes()
    table = read_table(path, {"id", "x"}.__contains__)
    assert pyarrow.total_allocated_bytes() - before < 8 * rows * 4
    assert table.names == list(columns) and len(table) == rows


def test_a_small_file_of_too_many_rows(tmp_path):
    """337 kB that unpack to 3.1 GB are refused before anything is unpacked."""
    path = write(tmp_path, ending="parquet")
    rows = 30_000_000
    constant = pyarrow.DictionaryArray.from_arrays(
        pyarrow.array(np.zeros(rows, np.int8)), pyarrow.array([1.0])
    )
    names = ["id", "x", "y", "radius"]
    pyarrow.parquet.write_table(pyarrow.table([constant] * 4, names), path, compression="zstd")
    del constant
    assert path.stat().st_size < 600_000
    tracemalloc.start()
    before = pyarrow.total_allocated_bytes()
    assert "at most" in refusal(path)
    assert pyarrow.total_allocated_bytes() - before < 1e6
    assert tracemalloc.get_traced_memory()[1] < 1e7
    tracemalloc.stop()


def test_a_bomb_of_gzip(tmp_path, monkeypatch):
    # A machine of 2^26 bytes.
    monkeypatch.setattr("os.sysconf", lambda name: 1 << 13)
    path = tmp_path / "grains_1.csv.gz"
    path.write_bytes(gzip.compress(b"id,x,y,radius\n" + b"1,0,0,1\n" * (1 << 23)))
    (tmp_path / "contacts_1.csv").write_text("id1,id2\n1,2\n")
    assert "half of this machine's memory" in refusal(tmp_path / "contacts_1.csv", contacts=path)


def test_the_sample_is_not_a_case():
    assert read_snapshot(sample_path()).graph.grain_count == 600
    assert read_snapshot(BOX / "state.xml.gz").step == 77504
