import gzip
import json
import sys

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest

from loops import InputError, Regime, contact_forces, love_weber_stress
from patterns import (
    count_frames,
    read_frames,
    read_snapshot,
    sample_cell,
    sample_path,
    snapshot_from_tables,
)
from tests.packings import jammed

GRAINS = {
    "id": [10, 11, 12, 13, 99],
    "type": [0, 0, 0, 0, 1],
    "x": [0.0, 1.0, 1.0, 0.0, -0.5],
    "y": [0.0, 0.0, 1.0, 1.0, 0.0],
    "radius": [0.51, 0.51, 0.51, 0.51, 0.0],
}
CONTACTS = {
    "id1": [10, 12, 12, 13, 99],
    "id2": [11, 11, 13, 10, 10],
    "nx": [1.0, 0.0, -1.0, 0.0, 1.0],
    "ny": [0.0, -1.0, 0.0, -1.0, 0.0],
    "fn": [2.0, 3.0, 4.0, 5.0, 1.0],
    "fsx": [0.0, 0.3, 0.0, -0.5, 0.0],
    "fsy": [0.2, 0.0, -0.4, 0.0, 0.0],
    "kn": [100.0] * 5,
    "ks": [50.0] * 5,
    "mu": [0.5] * 5,
    "sliding": [0, 0, 1, 0, 0],
}


def write(folder, grains=GRAINS, contacts=CONTACTS, ending="csv"):
    for name, columns in (("grains", grains), ("contacts", contacts)):
        path, table = folder / f"{name}_1.{ending}", pa.table(columns)
        if ending == "parquet":
            pyarrow.parquet.write_table(table, path)
        else:
            pyarrow.csv.write_csv(table, path)
            if ending == "csv.gz":
                path.write_bytes(gzip.compress(path.read_bytes()))
    return folder / f"grains_1.{ending}"


def changed(columns, **changes):
    out = {name: list(values) for name, values in columns.items()} | changes
    return {name: values for name, values in out.items() if values is not None}


def at(columns, name, row, value):
    values = list(columns[name])
    values[row] = value
    return columns | {name: values}


@pytest.mark.parametrize("ending", ["csv", "csv.gz", "parquet"])
def test_plain_tables(tmp_path, ending):
    snapshot = read_snapshot(write(tmp_path, ending=ending))
    graph = snapshot.graph
    assert snapshot.ids.tolist() == [10, 11, 12, 13]
    assert graph.contacts.tolist() == [[0, 1], [2, 1], [2, 3], [3, 0]]
    assert snapshot.wall_contacts == 1
    np.testing.assert_allclose(graph.normal_force, [2, 3, 4, 5], rtol=1e-15)
    # T along the normal turned counter-clockwise: (0,1), (1,0), (0,-1), (1,0).
    np.testing.assert_allclose(graph.shear_force, [0.2, 0.3, 0.4, -0.5], rtol=1e-15)
    assert snapshot.regime.tolist() == [1, 1, 2, 1]
    assert snapshot.law.kn.tolist() == [100.0] * 4
    # Four grains made up for this test are in no balance; the wall's foot follows from its normal.
    doubts = [f"{one.severity}: {one}" for one in snapshot.findings if one.severity != "ok"]
    foot = "branches of contacts with walls from the radii along the normals"
    assert snapshot.notes == (foot, *doubts)
    assert graph.cell is None


def test_total_force_on_grain_two_serves_as_well(tmp_path):
    force = np.array([[2.0, 0.2], [0.3, -3.0], [-4.0, -0.4], [-0.5, -5.0], [1.0, 0.0]])
    contacts = changed(
        CONTACTS, fsx=None, fsy=None, fx_on_2=force[:, 0].tolist(), fy_on_2=force[:, 1].tolist()
    )
    graph = read_snapshot(write(tmp_path, contacts=contacts)).graph
    np.testing.assert_allclose(contact_forces(graph), force[:4], atol=1e-15)
    np.testing.assert_allclose(graph.shear_force, [0.2, 0.3, 0.4, -0.5], rtol=1e-15)


def test_rolling_moments_are_kept_and_written(tmp_path):
    moment = [0.1, -0.2, 0.3, 0.4, 9.0]
    snapshot = read_snapshot(write(tmp_path, contacts=changed(CONTACTS, mz_on_2=moment)))
    assert snapshot.graph.rolling_moment.tolist() == moment[:4]
    tables = snapshot.tables()
    assert tables["contacts"]["mz_on_2"].tolist() == moment[:4]
    renamed = changed(CONTACTS, rolling_moment=moment)
    assert read_snapshot(write(tmp_path, contacts=renamed)).graph.rolling_moment[2] == 0.3
    assert read_snapshot(write(tmp_path)).graph.rolling_moment is None
    with pytest.raises(InputError, match="rolling moment of contact 1"):
        snapshot.graph.replace(rolling_moment=[0.0, np.nan, 0.0, 0.0])


def test_missing_optional_columns_cost_only_what_depends_on_them(tmp_path):
    contacts = changed(CONTACTS, sliding=None)
    snapshot = read_snapshot(write(tmp_path, contacts=contacts))
    assert snapshot.regime.tolist() == [1, 1, 1, 1]
    assert "sliding where |T| >= 0.999 mu N" in snapshot.notes[0]

    slides = changed(CONTACTS, sliding=None, fsy=[1.0, 0.0, -1.9979, 0.0, 0.0])
    snapshot = read_snapshot(write(tmp_path, contacts=slides))
    assert snapshot.regime.tolist() == [2, 1, 1, 1]  # 1.9979 < 0.999 * 2

    frictionless = changed(CONTACTS, mu=None)
    snapshot = read_snapshot(write(tmp_path, contacts=frictionless))
    np.testing.assert_allclose(snapshot.law.mu, [np.inf, np.inf, 0.1, np.inf], rtol=1e-15)
    assert "|T|/N" in snapshot.notes[0]

    bare = changed(CONTACTS, mu=None, sliding=None, kn=None, ks=None)
    snapshot = read_snapshot(write(tmp_path, contacts=bare), kn=7.0, kt=3.0)
    assert snapshot.regime.tolist() == [1, 1, 1, 1]
    assert snapshot.law.kt.tolist() == [3.0] * 4
    assert "need kn = 175" in snapshot.notes[-1]

    grains = changed(GRAINS, type=None, radius=[0.51] * 5)
    assert read_snapshot(write(tmp_path, grains=grains)).graph.contact_count == 5


def test_a_given_parameter_does_not_replace_a_column(tmp_path):
    snapshot = read_snapshot(write(tmp_path), kn=7.0)
    assert snapshot.law.kn.tolist() == [100.0] * 4
    assert "--kn 7.0 not used" in snapshot.notes[0]


def periodic():
    """The square as a 2 x 2 periodic cell; contacts wrap in both directions, branches given."""
    grains = {"id": [0, 1], "x": [0.1, 1.1], "y": [0.2, 0.2], "radius": [0.51, 0.51]}
    contacts = {
        "id1": [0, 1, 0],
        "id2": [1, 0, 0],
        "cell_dx": [0, 1, 0],
        "cell_dy": [0, 0, 1],
        "branch_x": [1.0, 1.0, 0.2],
        "branch_y": [0.0, 0.0, 1.0],
        "fn": [1.0, 1.0, 2.0],
        "fsx": [0.0] * 3,
        "fsy": [0.0] * 3,
        "kn": [1.0] * 3,
        "ks": [1.0] * 3,
    }
    return grains, contacts, [[2.0, 0.2], [0.0, 1.0]]


def test_images_given_or_reconstructed(tmp_path):
    grains, contacts, cell = periodic()
    given = read_snapshot(write(tmp_path, grains, contacts), cell=cell)
    assert given.graph.images.tolist() == [[0, 0], [1, 0], [0, 1]]
    without = changed(contacts, cell_dx=None, cell_dy=None)
    found = read_snapshot(write(tmp_path, grains, without), cell=cell)
    assert found.graph.images.tolist() == given.graph.images.tolist()


@pytest.mark.parametrize(
    ("cell", "words"),
    [
        (None, ["row 1", "[1, 0]", "--cell"]),
        ([[2.1, 0.2], [0.0, 1.0]], ["row 1", "branch [1.0, 0.0]", "cell of this snapshot"]),
        ([[2.0, 0.0], [0.0, 1.0]], ["row 2", "branch [0.2, 1.0]"]),
        ([[1.0, 1.0], [1.0, 1.0]], ["cell", "independent"]),
        ([[2.0, np.nan], [0.0, 1.0]], ["cell", "nan"]),
        ([2.0, 1.0], ["cell", "HXX"]),
        ([[1.0, 0.0], [0.0, 1.0]], ["cell", "1.63 times filled"]),
    ],
)
def test_a_wrong_cell_is_refused(tmp_path, cell, words):
    grains, contacts, _ = periodic()
    message = refused(tmp_path, grains, contacts, cell=cell)
    for word in words:
        assert word in message


def refused(tmp_path, grains=GRAINS, contacts=CONTACTS, **arguments):
    with pytest.raises(InputError) as caught:
        read_snapshot(write(tmp_path, grains, contacts), **arguments)
    message = str(caught.value)
    assert "\n" not in message
    return message


TWICE = {name: [*values, values[0]] for name, values in CONTACTS.items()}
BACK = {"id1": [*CONTACTS["id1"], 11], "id2": [*CONTACTS["id2"], 10], "nx": [*CONTACTS["nx"], -1.0]}
NONE = {"id1": pa.array([], pa.int64())} | {
    name: pa.array([], pa.float64()) for name in CONTACTS if name != "id1"
}
BAD_GRAINS = [
    *((changed(GRAINS, **{n: None}), [f"column '{n}'", "grains_1.csv"]) for n in ("id", "x", "y")),
    (changed(GRAINS, radius=None), ["column 'radius'", "grains_1.csv"]),
    (at(GRAINS, "x", 2, float("nan")), ["column 'x'", "row 2"]),
    (at(at(GRAINS, "x", 1, 0.0), "y", 1, 0.0), ["grains 10 and 11 at the same place"]),
    (at(GRAINS, "radius", 2, 0.0), ["radius of grain 12", "0.0"]),
    (at(GRAINS, "radius", 2, -0.5), ["radius of grain 12", "-0.5"]),
    (at(GRAINS, "id", 3, 10), ["id 10 2 times"]),
    (changed(GRAINS, type=[1] * 5), ["walls alone"]),
    (GRAINS | {"z": [0.0, 0.1, 0.2, 0.3, 0.0]}, ["two dimensions", "z = 0 to 0.3"]),
]
BAD_CONTACTS = [
    *(
        (changed(CONTACTS, **{name: None}), [f"column '{name}'", "contacts_1.csv"])
        for name in ("id1", "id2", "nx", "ny", "fn", "fsy")
    ),
    (at(CONTACTS, "fn", 1, None), ["column 'fn'", "row 1"]),
    (changed(CONTACTS, kn=["a"] * 5), ["column 'kn'"]),
    (at(CONTACTS, "id1", 0, 10.5), ["10.5", "whole number"]),
    (at(CONTACTS, "id2", 1, 77), ["row 1", "grain 77"]),
    (changed(TWICE, **BACK), ["row 5 and row 0 (grains 11 and 10)", "with another force"]),
    ({name: values[4:] for name, values in CONTACTS.items()}, ["no contact between grains"]),
    (NONE, ["no rows"]),
    (at(at(CONTACTS, "nx", 0, -1.0), "ny", 0, 0.0), ["row 0 (grains 10 and 11)"]),
    (at(CONTACTS, "kn", 0, 0.0), ["kn of the contact law"]),
]


@pytest.mark.parametrize(
    ("grains", "contacts", "words"),
    [(table, CONTACTS, words) for table, words in BAD_GRAINS]
    + [(GRAINS, table, words) for table, words in BAD_CONTACTS],
)
def test_bad_tables(tmp_path, grains, contacts, words):
    message = refused(tmp_path, grains, contacts)
    for word in words:
        assert word in message


def test_missing_and_truncated_files(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_snapshot(tmp_path / "grains_none.csv")
    (tmp_path / "positions.csv").write_text("id,x,y\n1,0,0\n")
    with pytest.raises(InputError, match=r"no table of contacts beside it, expected contacts\.csv"):
        read_snapshot(tmp_path / "positions.csv")
    (tmp_path / "positions.csv").rename(tmp_path / "sample.csv")
    with pytest.raises(InputError, match=r"expected contacts_\.\.\. beside grains_"):
        read_snapshot(tmp_path / "sample.csv")
    for ending in ("csv", "csv.gz", "parquet"):
        path = write(tmp_path, ending=ending)
        whole = path.read_bytes()
        path.write_bytes(b"")
        with pytest.raises(InputError, match="empty file"):
            read_snapshot(path)
        for cut in (len(whole) // 3, len(whole) // 2, len(whole) - 2):
            path.write_bytes(whole[:cut])
            with pytest.raises(InputError, match=r"complete|truncated"):
                read_snapshot(path)
    other = tmp_path / "grains_1.xyz"
    other.write_text("id x y\n")
    with pytest.raises(InputError, match="unknown format"):
        read_snapshot(other)


def test_without_forces_only_the_geometry(tmp_path):
    bare = changed(CONTACTS, fn=None, fsx=None, fsy=None)
    for contacts in (bare, changed(bare, nx=None, ny=None, kn=None, ks=None)):
        snapshot = read_snapshot(write(tmp_path, contacts=contacts))
        assert not snapshot.mechanical
        assert snapshot.law is None and snapshot.regime is None and snapshot.walls is None
        assert snapshot.graph.contact_count == 4
        assert "no contact forces" in snapshot.notes[0]
        with pytest.raises(InputError, match="no forces"):
            snapshot.mechanics()


def test_normal_forces_alone_suffice_without_friction(tmp_path):
    alone = changed(CONTACTS, fsx=None, fsy=None)
    snapshot = read_snapshot(write(tmp_path, contacts=alone))
    assert not snapshot.mechanical
    assert "without shear forces" in snapshot.notes[0]
    smooth = changed(alone, mu=[0.0] * 5, sliding=None)
    graph = read_snapshot(write(tmp_path, contacts=smooth)).graph
    assert graph.normal_force.tolist() == [2.0, 3.0, 4.0, 5.0]
    assert graph.shear_force.tolist() == [0.0] * 4
    given = changed(smooth, mu=None)
    assert read_snapshot(write(tmp_path, contacts=given), mu=0.0).mechanical


def test_forces_of_walls(tmp_path):
    branch = [[1.0, 0.0], [0.0, -1.0], [-1.0, 0.0], [0.0, -1.0], [0.5, 0.0]]
    columns = dict(zip(("branch_x", "branch_y"), np.transpose(branch).tolist(), strict=True))
    walls = read_snapshot(write(tmp_path, contacts=CONTACTS | columns)).walls
    assert walls.grain.tolist() == [0]
    assert walls.force.tolist() == [[1.0, 0.0]]
    assert walls.branch.tolist() == [[0.5, 0.0]]
    # The same contact named the other way round.
    turned = at(at(CONTACTS | columns, "id1", 4, 10), "id2", 4, 99)
    turned = at(at(turned, "nx", 4, -1.0), "branch_x", 4, -0.5)
    walls = read_snapshot(write(tmp_path, contacts=turned)).walls
    assert walls.force.tolist() == [[1.0, 0.0]]
    assert walls.branch.tolist() == [[0.5, 0.0]]
    points = CONTACTS | {"cx": [0.0] * 4 + [-0.4], "cy": [0.0] * 5}
    assert read_snapshot(write(tmp_path, contacts=points)).walls.branch.tolist() == [[0.4, 0.0]]
    # Without either, along the normal, as long as the radius less N/kn.
    normals = read_snapshot(write(tmp_path)).walls.branch
    np.testing.assert_allclose(normals, [[0.51 - 1.0 / CONTACTS["kn"][4], 0.0]], rtol=1e-15)


def test_boundary_and_grains_balance_in_the_sample():
    """Yade's walls push, the grains next to them push back: each residual is the code's own."""
    snapshot = read_snapshot(sample_path())
    graph, residual = snapshot.graph, np.zeros_like(snapshot.graph.x)
    force = contact_forces(graph)
    np.add.at(residual, graph.contacts[:, 0], -force)
    np.add.at(residual, graph.contacts[:, 1], force)
    np.add.at(residual, snapshot.walls.grain, snapshot.walls.force)
    grains = pa.csv.read_csv(sample_path()).to_pandas()
    expected = grains.loc[grains["type"] == 0, ["fx_res", "fy_res"]].to_numpy()
    np.testing.assert_allclose(residual, expected, atol=1e-11 * np.abs(force).max())


@pytest.mark.parametrize("ending", ["npz", "h5"])
def test_arrays_as_one_file_or_two(tmp_path, ending):
    expected = read_snapshot(write(tmp_path))
    both = tmp_path / f"packing.{ending}"
    write_arrays(both, {"grains": GRAINS, "contacts": CONTACTS})
    write_arrays(tmp_path / f"grains_2.{ending}", GRAINS)
    write_arrays(tmp_path / f"contacts_2.{ending}", CONTACTS)
    for path in (both, tmp_path / f"grains_2.{ending}"):
        snapshot = read_snapshot(path)
        assert snapshot.graph.contacts.tolist() == expected.graph.contacts.tolist()
        assert snapshot.graph.shear_force.tolist() == expected.graph.shear_force.tolist()
        whole = path.read_bytes()
        path.write_bytes(whole[: len(whole) // 2])
        with pytest.raises(InputError, match="truncated"):
            read_snapshot(path)


def write_arrays(path, columns):
    flat = {
        f"{name}/{inner}" if isinstance(values, dict) else name: np.array(array)
        for name, values in columns.items()
        for inner, array in (values.items() if isinstance(values, dict) else [("", values)])
    }
    if path.suffix == ".npz":
        np.savez(path, **flat)
        return
    import h5py

    with h5py.File(path, "w") as file:
        for name, values in flat.items():
            file[name] = values


def test_arrays_that_are_no_columns(tmp_path):
    path = tmp_path / "grains_1.npz"
    np.savez(path, id=np.arange(3), x=np.zeros((3, 2)))
    np.savez(tmp_path / "contacts_1.npz", id1=np.arange(3))
    with pytest.raises(InputError, match=r"array 'x'.*shape"):
        read_snapshot(path)


def test_column_map(tmp_path):
    names = {"x": "px", "fn": "normal_force", "id1": "a"}
    grains = {names.get(name, name): values for name, values in GRAINS.items()}
    contacts = {names.get(name, name): values for name, values in CONTACTS.items()}
    path = write(tmp_path, grains, contacts)
    with pytest.raises(InputError, match="--columns x=COLUMN,id1=COLUMN"):
        read_snapshot(path)
    snapshot = read_snapshot(path, columns=names)
    assert snapshot.graph.normal_force.tolist() == [2.0, 3.0, 4.0, 5.0]
    with pytest.raises(InputError, match="'elsewhere'"):
        read_snapshot(path, columns=names | {"mu": "elsewhere"})
    with pytest.raises(InputError, match="'friction'"):
        read_snapshot(path, columns=names | {"friction": "mu"})


def test_cell_beside_the_tables(tmp_path):
    grains, contacts, cell = periodic()
    path = write(tmp_path, grains, contacts)
    file = tmp_path / "cell_1.json"
    file.write_text(json.dumps({"cell": cell}))
    assert read_snapshot(path).graph.cell.tolist() == cell
    file.write_text(json.dumps({"cell": cell, "iteration": 1200}))
    assert read_snapshot(path).step == 1200
    file.write_text("{}")
    with pytest.raises(InputError, match=r"cell_1\.json"):
        read_snapshot(path)


def test_centres_leave_the_plane_by_rounding_alone(tmp_path):
    flat = GRAINS | {"z": [0.3, 0.3, 0.3 + 1e-9, 0.3, 7.0]}
    assert read_snapshot(write(tmp_path, flat)).graph.grain_count == 4


def test_contacts_of_distant_grains_are_refused(tmp_path):
    contacts = changed(at(CONTACTS, "id2", 0, 12), nx=None, ny=None)
    grains = GRAINS | {"radius": [0.3] * 4 + [0.0]}
    assert "2.36 times the sum of the radii" in refused(tmp_path, grains, contacts)


def test_formats_are_known_by_name_and_content(tmp_path):
    path = write(tmp_path)
    assert read_snapshot(path, format="table").graph.grain_count == 4
    with pytest.raises(InputError, match="--format"):
        read_snapshot(path, format="abaqus")


def test_frames_of_a_file_with_one(tmp_path):
    path = write(tmp_path)
    assert count_frames(path) == 1
    (snapshot,) = read_frames(path)
    assert snapshot.graph.contact_count == 4
    for frame in (0, -1):
        assert read_snapshot(path, frame=frame).graph.contact_count == 4
    for frame in (1, -2):
        with pytest.raises(InputError, match=f"--frame.*{frame}"):
            read_snapshot(path, frame=frame)


def test_contacts_elsewhere(tmp_path):
    path = write(tmp_path)
    other = tmp_path / "elsewhere.csv"
    (tmp_path / "contacts_1.csv").rename(other)
    assert read_snapshot(path, other).graph.contact_count == 4
    with pytest.raises(InputError, match=r"beside it, expected contacts_1\.csv"):
        read_snapshot(path)


def test_periodic_sample_has_the_stress_that_yade_gives():
    """Love-Weber over every contact against Yade's own, sheared cell: 1e-12 relative is asked."""
    snapshot = read_snapshot(sample_path("grains_periodic.parquet"), cell=sample_cell())
    expected = np.array(json.loads(sample_path("macro.json").read_text())["stress"])
    error = np.abs(love_weber_stress(snapshot.graph) - expected).max()
    assert error < 1e-14 * np.abs(expected).max()
    assert np.mean(snapshot.regime == Regime.SLIDING) == pytest.approx(
        0.0589112602535421, rel=1e-12
    )


def test_walls_out_of_the_plane_and_out_of_order(tmp_path):
    """Grains come by their ids; a wall's z is nobody's business."""
    rows = len(GRAINS["id"])
    wall = GRAINS["type"].index(1)
    z = [0.5] * rows
    z[wall] = 70.0
    for order in (range(rows), range(rows)[::-1]):
        grains = {name: [values[k] for k in order] for name, values in (GRAINS | {"z": z}).items()}
        assert read_snapshot(write(tmp_path, grains)).ids.tolist() == [10, 11, 12, 13]


# Neighbours that are one number as floats, up to the ends of what 64 bits hold.
LARGE = [2**53 + 1, 2**53 + 2, 2**63 - 2, 2**63 - 1, -(2**63)]
RENUMBERED = dict(zip(GRAINS["id"], LARGE, strict=True))


@pytest.mark.parametrize("ending", ["csv", "csv.gz", "parquet", "npz"])
def test_ids_keep_every_digit(tmp_path, ending):
    grains = GRAINS | {"id": LARGE}
    pairs = {name: [RENUMBERED[one] for one in CONTACTS[name]] for name in ("id1", "id2")}
    contacts = CONTACTS | pairs
    if ending == "npz":
        path = tmp_path / "grains_1.npz"
        for name, columns in (("grains", grains), ("contacts", contacts)):
            arrays = {key: np.array(values) for key, values in columns.items()}
            np.savez(tmp_path / f"{name}_1.npz", **arrays)
    else:
        path = write(tmp_path, grains, contacts, ending)
    snapshot, plain = read_snapshot(path), read_snapshot(write(tmp_path))
    assert snapshot.ids.tolist() == LARGE[:4]
    assert np.array_equal(snapshot.graph.contacts, plain.graph.contacts)


@pytest.mark.parametrize(
    ("ids", "ending"),
    [
        (np.array([10, 11, 12, 13, 2**63], dtype=np.uint64), "csv"),
        (np.array([10, 11, 12, 13, 2**63], dtype=np.uint64), "parquet"),
        ([10.0, 11.0, 12.0, 13.0, 2.0**53 + 2], "parquet"),
    ],
)
def test_ids_that_would_lose_digits_are_refused(tmp_path, ids, ending):
    with pytest.raises(InputError) as caught:
        read_snapshot(write(tmp_path, GRAINS | {"id": ids}, ending=ending))
    said = str(caught.value)
    assert "column 'id'" in said
    assert "row 4" in said
    assert "below 2**63" in said
    assert "64-bit integer" in said


def test_lack_of_memory_is_named(tmp_path, monkeypatch):
    """Neither an unreadable file nor a damaged one, whatever part of a reader wants it."""
    path = write(tmp_path)

    def refuse(*args, **how):
        raise pa.ArrowMemoryError("malloc of size 800 failed")

    for name in ("pyarrow.csv.read_csv", "patterns.snapshots.tables.as_array"):
        with monkeypatch.context() as patched:
            patched.setattr(name, refuse)
            with pytest.raises(MemoryError, match="malloc of size 800 failed"):
                read_snapshot(path)
    monkeypatch.setitem(sys.modules["patterns.snapshots.files"].PACKED, b"\x1f\x8b", refuse)
    with pytest.raises(MemoryError, match=r"out of memory while .*grains_1.csv.gz was read"):
        read_snapshot(write(tmp_path, ending="csv.gz"))
    for said in ("can't start new thread", "Failed to launch worker thread: Resource temporarily"):

        def refuse_thread(*args, said=said, **how):
            raise RuntimeError(said)

        monkeypatch.setattr("pyarrow.csv.read_csv", refuse_thread)
        with pytest.raises(MemoryError, match=r"out of memory while .*grains_1.csv was read"):
            read_snapshot(path)


def test_an_id_beyond_64_bits_far_down_a_long_table_is_told(tmp_path):
    """Beyond the first block, by which the columns' types are told."""
    count = 40_000
    lines = [f"{k},{k}.000000000,1.000000000,0.5000000000" for k in range(count)]
    lines[-7] = lines[-7].replace(f"{count - 7},", f"{2**63},", 1)
    path = tmp_path / "grains_1.csv"
    path.write_text("\n".join(["id,x,y,radius", *lines, ""]))
    assert path.stat().st_size > 1 << 20
    (tmp_path / "contacts_1.csv").write_text("id1,id2,fn,ft\n0,1,1.0,0.0\n")
    with pytest.raises(InputError, match=r"column 'id' .*, row 39993: .* below 2\*\*63"):
        read_snapshot(path)


@pytest.mark.parametrize("tilt", [[[1, 12], [0, 1]], [[5, 3], [3, 2]], [[0, 1], [1, -7]]])
def test_contacts_without_images_in_a_tilted_cell(tilt):
    """The same lattice by other vectors: nearest images are those of short branches."""
    graph = jammed(36, 5)
    grains = dict(zip(("x", "y"), graph.x.T, strict=True)) | {"radius": graph.radii}
    contacts = dict(zip(("id1", "id2"), graph.contacts.T, strict=True))
    found = snapshot_from_tables(grains, contacts, cell=graph.cell @ tilt).graph
    np.testing.assert_allclose(found.branches, graph.branches, rtol=0.0, atol=1e-13)
