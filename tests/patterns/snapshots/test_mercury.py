"""MercuryDPM files: written as its code describes them, and read back."""

import numpy as np
import pytest

from loops import InputError
from patterns import count_frames, read_snapshot, sample_path, synthetic_network
from tests.patterns.dump_writers import (
    Packing,
    assert_same,
    edit,
    wall_numbers,
    write_mercury,
)
from tests.patterns.dump_writers import snapshots_of as read


def packing(count=100, seed=0):
    """A periodic network, grains numbered as MercuryDPM does."""
    graph = synthetic_network(count, seed=seed, periodic=True, jitter=0.1)
    return Packing(graph, np.arange(count))


@pytest.fixture(scope="module")
def box():
    """The biaxial sample with its walls, grains numbered from 0."""
    snapshot = read_snapshot(sample_path())
    graph = snapshot.graph
    return Packing(graph, np.arange(graph.grain_count), snapshot.walls)


@pytest.mark.parametrize("layout", [8, 14])
def test_written_files_are_read_back(tmp_path, layout):
    own = packing()
    path, _ = write_mercury(tmp_path, own, layout=layout)
    (snapshot,) = read(path, cell=own.graph.cell)
    assert_same(snapshot, own, 1e-13)
    assert "each contact in two rows" in " ".join(snapshot.notes)


@pytest.mark.parametrize(("layout", "plane"), [(8, "xy"), (14, "xy"), (14, "xz")])
def test_walls_of_a_box(tmp_path, box, layout, plane):
    path, _ = write_mercury(tmp_path, box, layout=layout, plane=plane)
    (snapshot,) = read(path)
    assert_same(snapshot, box, 1e-13)
    assert snapshot.graph.cell is None and "taken as not periodic" in " ".join(snapshot.notes)
    assert ("z was taken for y" in " ".join(snapshot.notes)) == (plane == "xz")
    order = np.argsort(wall_numbers(box), kind="stable")
    assert snapshot.walls.grain.tolist() == box.walls.grain[order].tolist()
    for found, given in (
        (snapshot.walls.force, box.walls.force),
        (snapshot.walls.branch, box.walls.branch),
    ):
        assert found == pytest.approx(given[order], rel=1e-11, abs=1e-13)
    counts = np.bincount(wall_numbers(box))
    assert f"walls: -1 ({counts[0]} contacts), -2 ({counts[1]} contacts)" in " ".join(
        snapshot.notes
    )


def test_walls_whose_normals_are_not_turned_round(tmp_path, box):
    """The code calls its turned normals an old bug: without it the files mean the same."""
    path, contacts = write_mercury(tmp_path, box)
    (before,) = read(path)
    rows = contacts.read_text().splitlines()
    for k, row in enumerate(rows):
        words = row.split()
        if words[0] != "#" and int(words[2]) < 0:
            turned = [repr(-float(word)) for word in words[10:]]
            rows[k] = " ".join([*words[:10], *turned])
    contacts.write_text("\n".join(rows) + "\n")
    (after,) = read(path)
    assert after.walls.force.tolist() == before.walls.force.tolist()
    assert after.walls.branch.tolist() == before.walls.branch.tolist()


def test_rows_of_one_side_alone(tmp_path):
    """Fixed grains have no rows of their own: each contact once, in either order."""
    own = packing()
    path, contacts = write_mercury(tmp_path, own)
    rows = contacts.read_text().splitlines()
    keep = np.random.default_rng(0).integers(0, 2, (len(rows) - 3) // 2)
    rows[3:] = [rows[3 + 2 * k + side] for k, side in enumerate(keep.tolist())]
    contacts.write_text("\n".join(rows) + "\n")
    assert_same(read(path, cell=own.graph.cell)[0], own, 1e-13)


def test_contacts_at_more_times_than_grains(tmp_path):
    own = packing()
    for time in (0.0, 0.5, 1.0):
        path, _ = write_mercury(tmp_path, own, time)
    rows = path.read_text().splitlines()
    path.write_text("\n".join(rows[101:]) + "\n")
    assert [s.step for s in read(path, cell=own.graph.cell)] == [0.5, 1.0]


def put(rows, line, word, text):
    words = rows[line].split()
    words[word] = text
    rows[line] = " ".join(words)


BAD = {
    "a row missing": ("data", lambda r: r.pop(5), "rows to the end of the file, expected 100"),
    "a row too many": (
        "data",
        lambda r: r.insert(5, r[5]),
        r"line 102: got '.*expected a header|at the same place",
    ),
    "grains of none": ("data", lambda r: put(r, 0, 0, "0"), "line 2: .*frame before has other"),
    "a row cut": ("data", lambda r: r.__setitem__(9, "1 2"), "time 0: got lines that are no table"),
    "another layout": (
        "data",
        lambda r: put(r, 0, 5, "1 1 1"),
        "8 numbers in the header and 8 a row",
    ),
    "no header": ("data", lambda r: r.pop(0), "expected a header N time"),
    "a word for a radius": (
        "data",
        lambda r: put(r, 3, 4, "big"),
        "column 'radius' of .*time 0, row 2: got 'big'",
    ),
    "times apart": ("fstat", lambda r: put(r, 0, 1, "0.25"), "times 0.25, expected time 0 of"),
    "no comments": ("fstat", lambda r: r.__delitem__(slice(3)), r"expected a comment '# time"),
    "ghosts": ("fstat", lambda r: put(r, 4, 2, "100"), "grains 0 to 99.*ghosts"),
    "a wall first": ("fstat", lambda r: put(r, 4, 1, "-1"), "walls negative in the second"),
    "a word for a force": (
        "fstat",
        lambda r: put(r, 4, 8, "x"),
        "column 'fn' of .*fstat, time 0, row 1: got 'x'",
    ),
    "not a number": ("fstat", lambda r: put(r, 4, 8, "nan"), "column 'fn' of .*finite"),
    "other normals": ("fstat", lambda r: put(r, 4, 10, "0.5"), "row 1 .*got branch .*cell"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_files(tmp_path, case):
    own = packing()
    paths = write_mercury(tmp_path, own)
    which, change, message = BAD[case]
    edit(paths[which == "fstat"], change)
    with pytest.raises(InputError, match=message) as error:
        read(paths[0], format="mercury", cell=own.graph.cell)
    assert "\n" not in str(error.value)


def test_a_periodic_sample_asks_for_its_cell(tmp_path):
    path, _ = write_mercury(tmp_path, packing())
    with pytest.raises(InputError, match=r"got branch .*Give --cell"):
        read(path)


def test_files_cut_short(tmp_path):
    own = packing()
    path, contacts = write_mercury(tmp_path, own)
    contacts.write_text(contacts.read_text()[:-3])
    with pytest.raises(InputError, match="a last line without its end"):
        read(path, cell=own.graph.cell)
    path.write_text(path.read_text()[:-3])
    with pytest.raises(InputError, match="cut short at this time"):
        read(path, cell=own.graph.cell)


def test_contacts_are_found_beside(tmp_path):
    path, contacts = write_mercury(tmp_path, packing())
    contacts.rename(tmp_path / "box.fstat.7")
    with pytest.raises(InputError, match=r"no .fstat file beside it"):
        read(path)
    path = path.rename(tmp_path / "box.data.7")
    assert count_frames(path) == 1


@pytest.mark.parametrize(
    "head",
    [
        b"id,x,y,radius\n1,0,0,1\n2,2,0,1\n",
        b"ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n",
        b"LAMMPS data file\n\n600 atoms\n",
        b"1 2 3 4 5 6\n1 2 3\n4 5 6\n",
        b"",
    ],
)
def test_other_files_are_not_taken(tmp_path, head):
    path = tmp_path / "a.data"
    path.write_bytes(head)
    with pytest.raises(InputError, match=r"unknown format|an empty file|no dump of contacts"):
        count_frames(path)


def test_without_stiffness_there_is_no_law(tmp_path):
    own = packing()
    path, _ = write_mercury(tmp_path, own)
    snapshot = read_snapshot(path, cell=own.graph.cell)
    assert snapshot.lacks == ("kn", "kt") and snapshot.has_forces
    assert any("give --kn and --kt" in note for note in snapshot.notes)


def test_three_dimensions_are_refused(tmp_path):
    own = packing()
    path, _ = write_mercury(tmp_path, own, layout=14)
    edit(path, lambda rows: put(rows, 1, 2, "3.0"))
    with pytest.raises(InputError, match="two dimensions"):
        read(path, cell=own.graph.cell)


def test_snapshots_without_contacts_are_left_out(tmp_path):
    own = packing()
    path, contacts = write_mercury(tmp_path, own)
    contacts.write_text("# 0 1\n# 0 0 0 1 1 1\n# 0.1 0.2 0 0 0 0\n")
    with pytest.raises(InputError, match="no contacts in any snapshot"):
        read(path, cell=own.graph.cell)
    write_mercury(tmp_path, own, 0.5)
    (found,) = read(path, cell=own.graph.cell)
    assert found.step == 0.5 and "1 earlier snapshots without contacts" in " ".join(found.notes)
