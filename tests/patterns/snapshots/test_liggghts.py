"""LIGGGHTS dumps: every set of keywords, the cell from overlaps, and what LIGGGHTS wrote."""

import numpy as np
import pytest

from loops import InputError, contact_forces, euler_check, find_faces, love_weber_stress
from patterns import read_snapshot, sample_path, synthetic_network
from patterns.snapshots.dump_files import dump_frames
from patterns.snapshots.lammps import is_lammps
from patterns.snapshots.liggghts import is_liggghts
from tests.patterns.dump_writers import (
    GROUPS,
    LATER,
    LAW,
    Packing,
    assert_same,
    columns_of,
    write_liggghts,
)

RECIPE = ("pos", "id", "force")  # 12 columns
DEFAULT = ("pos", "vel", "id", "force", "torque", "history", "contactArea")
LONG = ("pos", "id", "force", "force_normal", "force_tangential", "torque", "delta", "contactPoint")
HEAD = b"ITEM: TIMESTEP\n0\n"


def packing(count=300, seed=0, cell=None):
    """A periodic network whose cell needs more than six digits."""
    size = np.sqrt(count * np.sqrt(3) / 2)
    cell = np.diag([size * 1.0123456789, size / 1.0123456789]) if cell is None else cell
    graph = synthetic_network(count, seed=seed, cell=cell, jitter=0.1)
    return Packing(graph, np.random.default_rng(seed).permutation(count) + 5)


def read(path, **how):
    return read_snapshot(path, **{"format": "liggghts"} | LAW | how)


def sets_of_keywords():
    """With and without each keyword, as long as there is a force."""
    for groups in (RECIPE, DEFAULT, LONG, (*GROUPS, *LATER)):
        for left_out in (None, *groups):
            kept = tuple(name for name in groups if name != left_out)
            parts = {"force_normal", "force_tangential"}
            if "id" in kept and ("force" in kept or parts <= set(kept)):
                yield kept


@pytest.mark.parametrize("groups", sorted(set(sets_of_keywords())), ids=" ".join)
def test_written_files_are_read_back(tmp_path, groups):
    own = packing(100)
    path, _ = write_liggghts(tmp_path, own, groups, box_digits=17)
    assert is_liggghts(path, HEAD)
    snapshot = read(path)
    assert_same(snapshot, own, 1e-13)
    assert snapshot.graph.cell.tolist() == own.graph.cell.tolist()


def test_the_cell_from_overlaps(tmp_path):
    """Six digits in the header, the rest from the contacts across the border."""
    own = packing(200)
    path, _ = write_liggghts(tmp_path, own, LONG)
    snapshot = read(path)
    coarse = np.diag(dump_frames(path)[0].box.cell)[:2]
    exact = np.diag(own.graph.cell)
    assert np.abs(coarse / exact - 1).max() > 1e-7
    assert np.abs(np.diag(snapshot.graph.cell) / exact - 1).max() < 1e-14
    assert_same(snapshot, own, 1e-13)
    assert "from the overlaps of" in " ".join(snapshot.notes)
    given = read(path, cell=own.graph.cell)
    assert_same(given, own, 1e-13)
    assert "six digits" not in " ".join(given.notes)


def test_overlaps_of_another_cell_are_not_fitted(tmp_path):
    own = packing(200)
    path, contacts = write_liggghts(tmp_path, own, LONG)
    rows = contacts.read_text().splitlines()
    for k, row in enumerate(rows[9:], start=9):
        words = row.split()
        if words[8] == "1":
            words[21] = repr(1.01 * float(words[21]))
            rows[k] = " ".join([*words, ""])
    contacts.write_text("\n".join(rows) + "\n")
    assert "overlaps don't fit it better" in " ".join(read(path, strict=False).notes)


def test_the_default_writes_no_parts_of_the_force(tmp_path):
    path, _ = write_liggghts(tmp_path, packing(100), DEFAULT)
    said = read(path).notes[0]
    assert said.endswith("id1=c_cpgl[13], id2=c_cpgl[14], fx=c_cpgl[16], fy=c_cpgl[17]")


def test_a_map_comes_before_the_order(tmp_path):
    own = packing(100)
    path, contacts = write_liggghts(tmp_path, own, LONG, box_digits=17)
    # Columns turned round: nothing stands where LIGGGHTS writes it.
    rows = contacts.read_text().splitlines()
    rows[8] = "ITEM: ENTRIES " + " ".join(f"c_c[{k + 1}]" for k in range(25))
    rows[9:] = [" ".join([*row.split()[::-1], ""]) for row in rows[9:]]
    contacts.write_text("\n".join(rows) + "\n")
    with pytest.raises(InputError, match=r"no ids of two grains that touch.*--columns id1=COLUMN"):
        read(path)
    names = {"id1": 7, "id2": 8, "fx": 10, "fy": 11}
    columns = {name: f"c_c[{26 - k}]" for name, k in names.items()}
    assert_same(read(path, columns=columns), own, 1e-13)
    parts = {"fnx": 13, "fny": 14, "ftx": 16, "fty": 17, "delta": 22}
    parts = {name: f"c_c[{26 - k}]" for name, k in ({"id1": 7, "id2": 8} | parts).items()}
    assert_same(read(path, columns=parts), own, 1e-13)
    assert not read(path, columns=columns | {"fx": "none"}).mechanical
    for wrong, message in (
        (columns | {"id1": columns["id2"], "id2": columns["id1"]}, "they pull"),
        (parts | {"fnx": parts["ftx"], "fny": parts["fty"]}, "forces of other contacts"),
        (parts | {"delta": columns["fx"]}, "other values than the overlaps"),
        ({**columns, "fx": "c_d[1]"}, r"--columns fx=c_d\[1\]: got no such column"),
        ({name: columns[name] for name in ("id1", "id2", "fx")}, "Give the others as well"),
        ({"p1": columns["fx"]}, "the name 'p1', expected one of"),
    ):
        with pytest.raises(InputError, match=message):
            read(path, columns=wrong)


def test_forces_along_the_branches_alone_are_asked_about(tmp_path):
    own = packing(100)
    smooth = Packing(own.graph.replace(shear_force=0 * own.graph.shear_force), own.ids)
    path, _ = write_liggghts(tmp_path, smooth, RECIPE, box_digits=17)
    with pytest.raises(InputError, match=r"Say which: --columns fx=c_cpgl\[10\],fy=c_cpgl\[11\]"):
        read(path)
    columns = {"fx": "c_cpgl[10]", "fy": "c_cpgl[11]"}
    assert_same(read(path, columns=columns), smooth, 1e-13)
    # With the normal part beside it, the total force is known to be all.
    path, _ = write_liggghts(tmp_path, smooth, LONG, 1, box_digits=17)
    assert_same(read(path), smooth, 1e-13)


def test_dumps_without_forces_or_ids(tmp_path):
    own = packing(100)
    path, _ = write_liggghts(tmp_path, own, ("pos", "id", "torque", "delta"))
    assert not read(path).mechanical
    path, _ = write_liggghts(tmp_path, own, ("pos", "force", "delta"), 1)
    with pytest.raises(InputError, match="with 'id' among them"):
        read(path)


def test_contacts_of_another_snapshot(tmp_path):
    path, _ = write_liggghts(tmp_path, packing(100), LONG)
    moved = packing(100)
    moved = Packing(moved.graph.replace(x=moved.graph.x + 0.01), moved.ids)
    write_liggghts(tmp_path, moved, LONG, mode="w")
    rows = path.read_text()
    write_liggghts(tmp_path, packing(100), LONG, mode="w")
    path.write_text(rows)
    with pytest.raises(InputError, match=r"row \d+: got position .* expected .* of grain"):
        read(path)


def test_dumps_of_lammps_are_not_taken(tmp_path):
    atoms = sample_path("lammps") / "dump.atoms.0.gz"
    assert not is_liggghts(atoms, HEAD) and is_lammps(atoms, HEAD)
    assert not is_liggghts(atoms, b"id,x,y\n")
    assert not is_liggghts(tmp_path / "dump.atoms.0", HEAD)
    (tmp_path / "dump.contacts.0").write_text("ITEM: TIMESTEP\n")
    assert not is_liggghts(tmp_path / "dump.atoms.0", HEAD)


def test_lammps_reads_the_long_form_all_the_same(tmp_path):
    """Parts of the force are told by their directions, whoever wrote them."""
    own = packing(100)
    path, _ = write_liggghts(tmp_path, own, LONG, box_digits=17)
    columns = {"p1": "c_cpgl[16]", "p2": "c_cpgl[17]"}
    assert_same(read(path, columns=columns, format="lammps"), own, 1e-13)


def test_the_sample_of_liggghts_balances():
    path = sample_path("liggghts") / "atoms.0.dump.gz"
    assert is_liggghts(path, HEAD)
    snapshot = read(path)
    graph = snapshot.graph
    assert graph.contact_count == 1069 and euler_check(graph, find_faces(graph)).ok
    # The box of the code's log, which has all digits; the sample has nine.
    assert np.diag(graph.cell) == pytest.approx([0.4757188072, 0.50154643559176], rel=1e-9)
    stress = love_weber_stress(graph)
    said = [[6541.75047932906, 118.89945699735], [118.89945699735, 6334.89450580649]]
    assert np.abs(stress - said).max() < 1e-8 * 6541
    force = contact_forces(graph)
    total = np.zeros(graph.x.shape)
    np.add.at(total, graph.contacts[:, 1], force)
    np.add.at(total, graph.contacts[:, 0], -force)
    written = columns_of(path, "fx", "fy")
    assert np.abs(total - written).max() < 1e-7 * np.abs(force).mean()


def test_a_force_that_is_not_the_sum_of_its_parts(tmp_path):
    """One contact's whole force with its sign turned, its parts as they were."""
    own = packing(100)
    _, contacts = write_liggghts(tmp_path, own, LONG)
    lines = contacts.read_text().splitlines()
    row = lines[9 + 30].split()
    # After pos, vel and id comes the force.
    row[15], row[16] = (str(-float(value)) for value in row[15:17])
    lines[9 + 30] = " ".join(row)
    contacts.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match="row 30: got a force that is not the sum"):
        read(tmp_path / "atoms.0.dump")
