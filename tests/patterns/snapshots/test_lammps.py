"""LAMMPS dumps: what is written is read back, and what LAMMPS wrote balances."""

import numpy as np
import pytest

from loops import (
    FaceKind,
    GrainGraph,
    InputError,
    contact_forces,
    euler_check,
    find_crossings,
    find_faces,
    outline_area,
)
from patterns import read_snapshot, sample_path, synthetic_network
from tests.patterns.dump_writers import (
    Packing,
    assert_same,
    columns_of,
    lammps_columns,
    lammps_walls,
    snapshots_of,
    write_lammps,
)


def packing(count=300, seed=0, tilt=0.0, cell=None):
    """A periodic network, ids in disorder; `tilt` shears its cell."""
    if tilt:
        cell = synthetic_network(count, periodic=True).cell @ [[1.0, tilt], [0.0, 1.0]]
    graph = synthetic_network(count, seed=seed, periodic=True, cell=cell, jitter=0.1)
    return Packing(graph, np.random.default_rng(seed).permutation(count) + 5)


def read(path, **how):
    return snapshots_of(path, format="lammps", **how)


def notes(path, **source):
    return " | ".join(read(path, **source)[0].notes)


def test_a_dump_without_distances_takes_the_nearest_images(tmp_path):
    own = packing(200)
    keep = ["patom1", "patom2", "fx", "fy", "p1", "p2"]
    path, _ = write_lammps(tmp_path, own, keep=keep)
    assert_same(read(path)[0], own, 1e-13)


def test_a_small_cell_takes_its_images_from_the_distances(tmp_path):
    own = packing(4, cell=np.diag([2.0, np.sqrt(3)]))
    assert len(np.unique(np.sort(own.graph.contacts), axis=0)) < own.graph.contact_count
    path, _ = write_lammps(tmp_path, own)
    assert_same(read(path)[0], own, 1e-13)


@pytest.mark.parametrize("name", ["xu", "xs", "xsu"])
def test_positions_unwrapped_and_scaled(tmp_path, name):
    own = packing(100, tilt=0.2)
    x = own.wrapped[0]
    if "u" in name:
        x = x + np.random.default_rng(0).integers(-2, 3, x.shape) @ own.graph.cell.T
    if "s" in name:
        x = np.linalg.solve(own.graph.cell, x.T).T
    path, _ = write_lammps(tmp_path, own, place=((name, name.replace("x", "y")), x))
    assert_same(read(path)[0], own, 1e-12)


def test_general_triclinic_box(tmp_path):
    cell = packing(100, tilt=0.2).graph.cell
    turned = np.array([[0.8, -0.6], [0.6, 0.8]]) @ cell
    own = packing(100, cell=turned)
    upright = Packing(own.graph.replace(cell=cell, cell0=cell), own.ids)
    path, contacts = write_lammps(tmp_path, upright, place=(("x", "y"), own.wrapped[0]))
    columns = lammps_columns(own)
    for file in (path, contacts):
        text = file.read_text().splitlines()
        text[4] = "ITEM: BOX BOUNDS abc origin pp pp pp"
        (a, b), (c, d) = turned.tolist()
        text[5:8] = [f"{a!r} {c!r} 0 0", f"{b!r} {d!r} 0 0", "0 0 1 -0.5"]
        file.write_text("\n".join(text) + "\n")
    rows = contacts.read_text().splitlines()[:9]
    keep = list(columns)
    table = np.column_stack([columns[name] for name in keep]).tolist()
    lines = [" ".join(f"{v:.17g}" for v in row) for row in table]
    contacts.write_text("\n".join([*rows, *lines]) + "\n")
    (snapshot,) = read(path)
    assert snapshot.graph.cell.tolist() == turned.tolist()
    assert_same(snapshot, own, 1e-12)


def test_a_strip_periodic_one_way(tmp_path):
    whole = packing(300).graph
    inside = whole.images[:, 1] == 0
    graph = GrainGraph(
        x=whole.x, radii=whole.radii, contacts=whole.contacts[inside],
        normal_force=whole.normal_force[inside], shear_force=whole.shear_force[inside],
        images=whole.images[inside], cell=whole.cell,
    )  # fmt: skip
    own = Packing(graph, np.arange(300))
    keep = ["patom1", "patom2", "fx", "fy", "p1", "p2"]
    x = whole.x - np.floor(whole.x / np.diag(whole.cell)) * [whole.cell[0, 0], 0.0]
    path, _ = write_lammps(tmp_path, own, keep=keep, flags="pp ff pp", place=(("x", "y"), x))
    (snapshot,) = read(path)
    assert_same(snapshot, own, 1e-13)
    cell = snapshot.graph.cell
    top = (whole.x[:, 1] + whole.radii).max() - (whole.x[:, 1] - whole.radii).min()
    assert cell[0, 0] == whole.cell[0, 0] and cell[1, 1] >= top
    assert not snapshot.graph.images[:, 1].any()
    assert euler_check(snapshot.graph, find_faces(snapshot.graph)).ok
    assert len(find_crossings(snapshot.graph)) == 0
    assert "periodic along x alone" in " ".join(snapshot.notes)


def test_walls_of_a_box(tmp_path):
    snapshot = read_snapshot(sample_path())
    own = Packing.of(snapshot)
    path, _ = write_lammps(tmp_path, own, extra=lammps_walls(own))
    (again,) = read(path)
    assert_same(again, own, 1e-13)
    assert again.wall_contacts == snapshot.wall_contacts
    ours, theirs = (
        np.lexsort((again.walls.branch[:, 0], again.walls.grain)),
        np.lexsort((snapshot.walls.branch[:, 0], snapshot.walls.grain)),
    )
    assert again.walls.force[ours] == pytest.approx(snapshot.walls.force[theirs], rel=1e-13)
    assert again.walls.branch[ours] == pytest.approx(
        snapshot.walls.branch[theirs], rel=1e-9, abs=1e-14
    )
    assert "walls recognised: f_w0 (" in " ".join(again.notes)
    one = {
        f"wall_{k}": f"f_w2[{n}]"
        for k, n in zip(("flag", "fx", "fy", "x", "y"), "12356", strict=True)
    }
    assert 0 < read(path, columns=one)[0].wall_contacts < snapshot.wall_contacts
    with pytest.raises(InputError, match="Give all five"):
        read(path, columns={"wall_flag": "f_w2[1]"})
    with pytest.raises(InputError, match="contact points beyond their grains"):
        read(path, columns=one | {"wall_x": "f_w2[2]"})


def test_padded_columns_time_and_units(tmp_path):
    own = packing(60)
    path, contacts = write_lammps(tmp_path, own)
    for file in (path, contacts):
        rows = file.read_text().splitlines()
        rows[9:] = [f"  {row.replace(' ', '   ')}" for row in rows[9:]]
        rows[:2] = ["ITEM: UNITS", "si", *rows[:2], "ITEM: TIME", "0.5"]
        file.write_text("\n".join(rows) + "\n")
    assert_same(read(path)[0], own, 1e-13)


def test_the_sample_of_lammps_balances():
    """The forces that LAMMPS says act on each grain are those of its contacts.

    To 2e-5 of the mean force: damping is taken at half a time step's distance.
    """
    path = sample_path("lammps") / "dump.atoms.0.gz"
    (snapshot,) = read(path)
    graph, said = snapshot.graph, " ".join(snapshot.notes)
    assert (graph.contact_count, snapshot.wall_contacts) == (776, 62)
    assert euler_check(graph, find_faces(graph)).ok
    force = contact_forces(graph)
    total = np.zeros(graph.x.shape)
    np.add.at(total, graph.contacts[:, 1], force)
    np.add.at(total, graph.contacts[:, 0], -force)
    np.add.at(total, snapshot.walls.grain, snapshot.walls.force)
    written = columns_of(path, "fx", "fy")
    assert np.abs(total - written).max() < 2e-5 * np.abs(force).mean()
    assert "f_wl (12 contacts), f_wb (16 contacts)" in said
    assert "include damping" in said


def test_loops_fill_a_periodic_cell(tmp_path):
    path, _ = write_lammps(tmp_path, packing(300))
    graph = read(path)[0].graph
    faces = find_faces(graph)
    loops = (faces.kind == FaceKind.LOOP) & (
        faces.component == np.bincount(faces.component).argmax()
    )
    assert faces.area[loops].sum() == pytest.approx(outline_area(graph, faces), rel=1e-13)


def test_diameters_and_a_cell_from_the_user(tmp_path):
    own = packing(100)
    wide = Packing(own.graph.replace(radii=2 * own.graph.radii), own.ids)
    path, _ = write_lammps(tmp_path, wide, flags="ff ff pp")
    path.write_text(path.read_text().replace("radius", "diameter"))
    assert_same(read(path, cell=own.graph.cell)[0], own, 1e-13)


def test_normals_of_walls_point_into_the_grains(tmp_path):
    own = Packing.of(read_snapshot(sample_path()))
    path, _ = write_lammps(tmp_path, own, extra=lammps_walls(own))
    walls = read(path)[0].walls
    assert len(walls.grain) == 61 and np.hypot(*walls.branch.T).min() > 0
    assert np.einsum("wk,wk->w", walls.branch, walls.force).min() > 0


def test_ids_of_dumps_keep_every_digit(tmp_path):
    """Ids that are one number as floats; beyond 64 bits they are refused."""
    own = packing()
    own = own._replace(ids=own.ids + 2**62)
    path, contacts = write_lammps(tmp_path, own)
    (snapshot,) = read(path)
    assert_same(snapshot, own, 1e-13)
    assert np.array_equal(snapshot.ids, np.sort(own.ids))
    longer = {str(one): f"{one}0" for one in own.ids.tolist()}
    for file in (path, contacts):
        text = file.read_text()
        for one, other in longer.items():
            text = text.replace(one, other)
        file.write_text(text)
    with pytest.raises(InputError, match=r"below 2\*\*63"):
        read(path)
