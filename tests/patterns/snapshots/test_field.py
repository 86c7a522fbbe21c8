"""Files as people have them: each kind with its variants, tables made here of samples at rest."""

import bz2
import gzip
import lzma
import os
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest

import grainloops as gl
from loops import InputError
from loops.errors import counted
from patterns import count_frames, read_frames, read_snapshot, snapshot_from_tables
from tests.command import run
from tests.patterns.dump_writers import Packing, write_lammps, write_liggghts
from tests.patterns.resting import KN, resting

LAW = {"kn": KN, "mu": 0.0}
PERIODIC, BOX = (True, True), (False, False)


def text(table, mark=",", names=None, header=True, end="\n"):
    """A table as text, numbers with all their digits."""
    names = [(names or {}).get(name, name) for name in table]
    rows = [
        [repr(value) for value in row] for row in zip(*map(list_of, table.values()), strict=True)
    ]
    return "".join(mark.join(row) + end for row in ([names] if header else []) + rows)


def list_of(values):
    return np.asarray(values).tolist()


def put(folder, sample, grains=None, contacts=None, walls=None, change=str, **how):
    """Files of a sample, its walls too; `change` is what is done to each text."""
    tables = {"grains": grains or sample.grains(), "contacts": contacts or sample.contacts()}
    if len(sample.grain) and walls is not False:
        tables["walls"] = walls or sample.walls()
    for name, table in tables.items():
        written = change(text(table, **how))
        data = written if isinstance(written, bytes) else written.encode()
        (folder / f"{name}_1.csv").write_bytes(data)
    return folder / "grains_1.csv"


def read(path, sample, **how):
    cell = sample.cell if any(sample.periodic) else None
    given = {"cell": cell, **LAW, **how}
    return read_snapshot(path, **given)


def same(found, sample, rtol=1e-12, forces=True, clean=True):
    """Assert that a snapshot is the sample: centres, contacts, loops, forces, stress, no doubt."""
    np.testing.assert_allclose(found.graph.x, sample.x, rtol=rtol)
    np.testing.assert_allclose(found.graph.radii, sample.radii, rtol=rtol)
    pairs = np.sort(found.graph.contacts, axis=1)
    assert sorted(map(tuple, pairs.tolist())) == sorted(map(tuple, sample.pairs.tolist()))
    # Euler's formula for a network of one piece: E - V loops on a torus, E - V + 1 in the plane;
    # of a strip both outer faces are none.
    touched = len(np.unique(sample.pairs))
    more = {2: 0, 1: 0, 0: 1}[sum(sample.periodic)]
    assert len(found.faces.loops) == len(sample.pairs) - touched + more
    if forces:
        stress = gl.stress(found)
        np.testing.assert_allclose(stress.tensor, sample.stress, rtol=0, atol=1e-9 * stress.p)
    if clean:
        assert [one for one in found.findings if one.severity != "ok"] == []


# Pairs listed from both grains, and twice.


@pytest.mark.parametrize("periodic", [PERIODIC, BOX])
@pytest.mark.parametrize("columns", ["scalars", "vectors"])
def test_pairs_from_both_grains_count_once(tmp_path, periodic, columns):
    sample = resting(periodic)
    one, two = sample.pairs.T
    contacts = {"id1": np.append(one, two), "id2": np.append(two, one)}
    force = sample.force[:, None] * sample.normal
    if columns == "scalars":
        contacts |= {"fn": np.tile(sample.force, 2), "ft": np.zeros(2 * len(one))}
    else:
        contacts |= dict(zip(("fx_on_2", "fy_on_2"), np.vstack([force, -force]).T, strict=True))
    found = read(put(tmp_path, sample, contacts=contacts), sample)
    same(found, sample)
    assert any(f"{2 * len(one)} rows, {len(one)} contacts" in note for note in found.notes)
    contacts["fn" if columns == "scalars" else "fx_on_2"][-1] += 0.01
    with pytest.raises(InputError, match=r"1 of them with another force, such as row \d+ and row"):
        read(put(tmp_path, sample, contacts=contacts), sample)


# Texts: 16 bits a letter, packed, lines before the names, units, no names.


@pytest.mark.parametrize("kind", ["utf-16-le", "utf-16-be"])
def test_texts_of_16_bits_a_letter(tmp_path, kind):
    mark = {"utf-16-le": b"\xff\xfe", "utf-16-be": b"\xfe\xff"}[kind]
    sample = resting()
    path = put(tmp_path, sample, mark="\t", end="\r\n", change=lambda t: mark + t.encode(kind))
    same(read(path, sample), sample)


def zstd(data):
    return pa.compress(data, codec="zstd", asbytes=True)


@pytest.mark.parametrize(
    ("ending", "pack"),
    [("gz", gzip.compress), ("bz2", bz2.compress), ("xz", lzma.compress), ("zst", zstd)],
)
def test_packed_files(tmp_path, ending, pack):
    sample = resting(BOX)
    plain = put(tmp_path, sample)
    for path in list(tmp_path.iterdir()):
        path.with_name(f"{path.name}.{ending}").write_bytes(pack(path.read_bytes()))
        path.unlink()
    path = plain.with_name(f"{plain.name}.{ending}")
    same(read(path, sample), sample)
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(InputError, match=r"complete|truncated|last line"):
        read(path, sample)


@pytest.mark.parametrize(
    "above",
    [
        "EXPORT 2024-05-03 10:11\nTime: 0.5 s\n\n",
        "Ball list\n-----------\n",
        "# made by hand\nQuery 1: Particle Position X, Particle Position Y\nTIME: 0.5\n",
        "EXTRACTED,,,\nTime,0.5,,\n,,,\n",
    ],
)
@pytest.mark.parametrize("mark", [",", ";", "\t", " "])
def test_lines_before_the_names(tmp_path, above, mark):
    sample = resting()
    same(read(put(tmp_path, sample, mark=mark, change=lambda t: above + t), sample), sample)


@pytest.mark.parametrize("units", ["-,m,m,m", "[-],[m],[m],[m]", ",(m),(m),(m)"])
def test_a_row_of_units(tmp_path, units):
    sample = resting()

    def insert(written):
        name, rest = written.split("\n", 1)
        row = units if name.startswith("id,x") else "-,-,N,N"
        return f"{name}\n{row}\n{rest}"

    same(read(put(tmp_path, sample, change=insert), sample), sample)


@pytest.mark.parametrize(
    ("names", "factors"),
    [
        ({"x": "X (m)", "y": "Y (m)", "radius": "Radius (m)", "fn": "Fn [N]"}, {}),
        ({"x": "x [mm]", "y": "y [mm]", "radius": "r_mm"}, {}),
        ({"x": "X (m)", "y": "Y (m)", "radius": "Radius (mm)"}, {"radius": 1e3}),
        ({"x": "x/m", "y": "y/mm", "radius": "radius/µm"}, {"y": 1e3, "radius": 1e6}),
        ({"x": "x [px]", "y": "y [px]", "radius": "radius [px]"}, {}),
        ({"x": "x (mm)", "fn": "Normal Force (kN)", "ft": "Tangential Force (N)"}, {"ft": 1e3}),
    ],
)
def test_units_in_the_names(tmp_path, names, factors):
    sample = resting()
    tables = [sample.grains(), sample.contacts()]
    for table in tables:
        table.update({name: factors[name] * table[name] for name in factors if name in table})
    path = put(tmp_path, sample, *tables, names=names)
    same(read(path, sample), sample)


def test_units_of_stiffness_and_angle_go_with_lengths_and_forces(tmp_path):
    sample = resting()
    count, contacts = len(sample.x), sample.contacts()
    angle = np.linspace(-170, 170, count)
    contacts["kn"] = np.full(len(sample.pairs), KN * 1e6)
    names = {"x": "x (mm)", "fn": "fn (kN)", "kn": "kn (N/m)", "theta": "theta_z [deg]"}
    path = put(tmp_path, sample, sample.grains() | {"theta": angle}, contacts, names=names)
    found = read(path, sample, kn=None)
    # A kN/mm is 10^6 N/m.
    np.testing.assert_allclose(found.law.kn, KN, rtol=1e-12)
    np.testing.assert_allclose(found.rotation, np.radians(angle), rtol=1e-12)
    same(found, sample)


def test_lengths_of_unknown_unit_beside_others_are_refused(tmp_path):
    sample = resting()
    path = put(tmp_path, sample, names={"x": "x (px)", "radius": "radius (mm)"})
    with pytest.raises(InputError, match=r"radius.*mm, px.*can be converted"):
        read(path, sample)


@pytest.mark.parametrize(
    ("of_grains", "of_contacts"),
    [
        ({"id": "Particle Identifier", "x": "Position.X", "y": "Position.Y", "radius": "Radius"},
         {"id1": "Particle Identifiers.1", "id2": "Particle Identifiers.2"}),
        ({"id": "ball.id", "x": "ball.pos.x", "y": "ball.pos.y", "radius": "ball.radius"},
         {"id1": "end1", "id2": "end2", "fn": "contact.force.normal"}),
        ({"id": "Particle ID", "x": "Position X", "y": "Position Y", "radius": "Particle Radius"},
         {"id1": "Element 1 ID", "id2": "Element 2 ID", "fn": "Normal Force"}),
        ({"id": "node", "x": "Points:0", "y": "Points:1", "radius": "radii"},
         {"id1": "source", "id2": "target", "fn": "force_n", "ft": "force_t"}),
        ({"id": "GRAIN_ID", "x": "PosX", "y": "PosY", "radius": "RAD"},
         {"id1": "grain1", "id2": "grain2", "fn": "F_N", "ft": "F_T"}),
    ],
)  # fmt: skip
def test_names_of_other_codes(tmp_path, of_grains, of_contacts):
    sample = resting()
    same(read(put(tmp_path, sample, names=of_grains | of_contacts), sample), sample)


def test_names_in_a_comment_with_quotes(tmp_path):
    sample = resting()
    names = {"id": '"Particle Identifier"', "x": '"Position.X"', "y": '"Position.Y"'}
    path = put(tmp_path, sample, mark=" ", names=names, change=lambda t: "# " + t)
    same(read(path, sample), sample)


@pytest.mark.parametrize("mark", [",", " ", "\t", ";"])
def test_tables_without_names(tmp_path, mark):
    sample = resting(BOX)
    path = put(tmp_path, sample, mark=mark, header=False, walls=False)
    with pytest.raises(InputError, match=r"number those of a table without header from 0"):
        read(path, sample)
    columns = {"id": 0, "x": 1, "y": 2, "radius": 3, "id1": 0, "id2": 1, "fn": 2, "ft": 3}
    found = read(path, sample, columns=columns)
    same(found, sample, forces=False, clean=False)
    np.testing.assert_allclose(np.sort(found.graph.normal_force), np.sort(sample.force), rtol=1e-12)
    lines = ",".join(f"{name}={place}" for name, place in columns.items())
    assert run("check", path, "--columns", lines, "--kn", 1, "--mu", 0) == 0


# Ids.


@pytest.mark.parametrize("shift", [1, -1])
@pytest.mark.parametrize("loose", [False, True])
def test_ids_off_by_one(tmp_path, shift, loose):
    sample = resting(BOX)
    grains, contacts, walls = sample.grains(), sample.contacts(), sample.walls()
    grains["id"] = grains["id"] + 5
    if loose:
        # A grain that nothing touches has the id that would else be unknown.
        for name, value in (("id", 4 if shift < 0 else 5 + len(sample.x)), ("x", -9.0),
                            ("y", -9.0), ("radius", 1.0)):  # fmt: skip
            grains[name] = np.append(grains[name], value)
    for name in ("id1", "id2"):
        contacts[name] = contacts[name] + 5 + shift
    walls["id"] = walls["id"] + 5 + shift
    found = read(put(tmp_path, sample, grains, contacts, walls), sample)
    assert any(f"one {'more' if shift > 0 else 'less'} than" in note for note in found.notes)
    stress = gl.stress(found).tensor
    np.testing.assert_allclose(stress, sample.stress, rtol=0, atol=1e-9)


@pytest.mark.parametrize("first", [0, 1])
def test_without_ids_the_row_is_the_id(tmp_path, first):
    sample = resting()
    grains, contacts = sample.grains(), sample.contacts()
    del grains["id"]
    contacts["id1"], contacts["id2"] = contacts["id1"] + first, contacts["id2"] + first
    same(read(put(tmp_path, sample, grains, contacts), sample), sample)
    contacts["id2"] = contacts["id2"] + 1000
    with pytest.raises(InputError, match=r"column 'id' of .*grains"):
        read(put(tmp_path, sample, grains, contacts), sample)


# Forces that stand out.


@pytest.mark.parametrize("value", [-999.0, -9999.0, -1e30])
def test_a_missing_value_is_named_by_its_row(tmp_path, value):
    sample = resting()
    contacts = sample.contacts()
    contacts["fn"] = np.where(np.arange(len(sample.pairs)) == 7, value, sample.force)
    with pytest.raises(InputError, match=r"row 7, grains \d+ and \d+ .*as a missing value") as told:
        read(put(tmp_path, sample, contacts=contacts), sample)
    assert "sign" not in str(told.value)


@pytest.mark.parametrize("name", ["fn", "ft"])
@pytest.mark.parametrize("rows", [[3], [3, 40, 90]])
def test_fits_that_failed_are_doubted_and_spoil_no_other_check(tmp_path, name, rows):
    sample = resting()
    contacts = sample.contacts()
    contacts[name] = np.array(contacts[name], dtype=float)
    contacts[name][rows] = 300 * sample.force.mean()
    found = read(put(tmp_path, sample, contacts=contacts), sample, mu=0.5, kt=1.0)
    doubts = {one.check: one for one in found.findings if one.severity != "ok"}
    assert set(doubts) - {"kn", "friction", "sliding"} == {"unbalanced"}
    assert counted(len(rows), "force stands", "forces stand") + " out" in doubts["unbalanced"].says
    assert all(f"row {row}, " in doubts["unbalanced"].says for row in rows)


# Planes.


@pytest.mark.parametrize("plane", ["xz", "yz"])
@pytest.mark.parametrize("across", [True, False])
@pytest.mark.parametrize("periodic", [PERIODIC, BOX])
def test_samples_in_another_plane(tmp_path, plane, across, periodic):
    sample = resting(periodic)
    (other,) = {*"xyz"} - {*plane}
    new = dict(zip("xy", plane, strict=True))

    def turn(table, vectors):
        renamed = {}
        for name, values in table.items():
            found = next((v for v in vectors if name in (v + "x", v + "y")), None)
            renamed[name if found is None else found + new[name[-1]]] = values
        if across:
            rows = len(next(iter(table.values())))
            renamed |= {v + other: np.full(rows, 0.5 * (v == "")) for v in vectors}
        return renamed

    contacts = sample.contacts(normals=True)
    force = sample.force[:, None] * sample.normal
    contacts |= {"fsx": 0 * force[:, 0], "fsy": 0 * force[:, 1]}
    walls = turn(sample.walls(), ["f", "branch_"]) if len(sample.grain) else None
    if walls and not across:
        walls["id"] = sample.grain
    tables = turn(sample.grains(), [""]), turn(contacts, ["n", "fs"])
    found = read(put(tmp_path, sample, *tables, walls), sample)
    same(found, sample)
    assert any(f"plane of {plane[0]} and {plane[1]}" in note for note in found.notes)


@pytest.mark.parametrize(
    ("plane", "axis", "sign"), [("xz", "y", -1), ("yz", "x", 1), ("xy", "z", 1)]
)
def test_rotations_and_spins_turn_with_the_plane(tmp_path, plane, axis, sign):
    """Anticlockwise in the plane as it is read: x, z and -y are right-handed, as y, z and x are."""
    sample = resting(PERIODIC)
    grains = sample.grains()
    x, y = (grains.pop(name) for name in "xy")
    grains |= dict(zip(plane, (x, y), strict=True)) | {axis: np.zeros(len(x))}
    angle = np.linspace(-1.0, 1.0, len(x))
    for other in "xyz":
        grains |= {f"theta_{other}": angle if other == axis else 0 * angle}
        grains |= {f"omega_{other}": 2 * angle if other == axis else 0 * angle}
        grains |= {f"v{other}": 0 * angle}
    found = read(put(tmp_path, sample, grains=grains), sample)
    np.testing.assert_array_equal(found.rotation, sign * angle)
    np.testing.assert_array_equal(found.spin, 2 * sign * angle)


@pytest.mark.parametrize(("scatter", "read_it"), [(1e-3, True), (1e-2, True), (0.2, False)])
def test_scatter_across_the_plane(tmp_path, scatter, read_it):
    sample = resting()
    z = scatter * sample.radii.min() * np.random.default_rng(0).uniform(-1, 1, len(sample.x))
    path = put(tmp_path, sample, sample.grains() | {"z": z})
    if not read_it:
        with pytest.raises(InputError, match="two dimensions"):
            read(path, sample)
        return
    found = read(path, sample)
    same(found, sample)
    assert any("centres scatter by" in note for note in found.notes)


def in_xz(path):
    """The dump with z in place of y."""
    lines = []
    for line in path.read_text().splitlines():
        if line.startswith("ITEM: BOX BOUNDS"):
            words = line.split()
            line = " ".join([*words[:-2], words[-1], words[-2]])
        lines.append(line.replace(" x y z ", " x z y "))
    at = next(k for k, line in enumerate(lines) if line.startswith("ITEM: BOX")) + 2
    lines[at], lines[at + 1] = lines[at + 1], lines[at]
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize("code", ["lammps", "liggghts"])
def test_dumps_in_the_plane_of_x_and_z(tmp_path, code):
    sample = resting()
    own = read(put(tmp_path, sample), sample)
    packing = Packing.of(own)
    if code == "lammps":
        paths = write_lammps(tmp_path, packing)
    else:
        paths = write_liggghts(tmp_path, packing, ("pos", "id", "force", "delta"), box_digits=17)
    for path in paths:
        in_xz(path)
    if code == "liggghts":
        swap_columns(paths[1], [(1, 2), (4, 5), (10, 11)])
    # Along the branches the force may be the whole or a part of it.
    columns = {"fx": "c_cpgl[10]", "fy": "c_cpgl[12]"} if code == "liggghts" else None
    found = read_snapshot(paths[0], kn=KN, mu=0.0, columns=columns)
    np.testing.assert_allclose(gl.stress(found).tensor, sample.stress, rtol=0, atol=1e-9)
    assert len(found.faces.loops) == len(own.faces.loops)
    assert any("plane of x and z" in note for note in found.notes)


def swap_columns(path, pairs):
    lines = path.read_text().splitlines()
    at = next(k for k, line in enumerate(lines) if line.startswith("ITEM: ENTRIES")) + 1
    for k in range(at, len(lines)):
        words = lines[k].split()
        for a, b in pairs:
            words[a], words[b] = words[b], words[a]
        lines[k] = " ".join(words) + " "
    path.write_text("\n".join(lines) + "\n")


def test_ids_that_lammps_prints_by_six_digits(tmp_path):
    sample = resting()
    own = Packing.of(read(put(tmp_path, sample), sample))
    own = own._replace(ids=1234567 + 11 * np.arange(len(sample.x)))
    atoms, contacts = write_lammps(tmp_path, own)
    rows = contacts.read_text().splitlines()
    for k in range(9, len(rows)):
        words = rows[k].split()
        words[1:3] = [f"{float(word):g}" for word in words[1:3]]
        rows[k] = " ".join(words) + " "
    contacts.write_text("\n".join(rows) + "\n")
    with pytest.raises(InputError, match=r"six digits, LAMMPS's %g: .*format float %.15g"):
        read_snapshot(atoms, **LAW)


# A column `type`.


@pytest.mark.parametrize("periodic", [PERIODIC, BOX])
@pytest.mark.parametrize("share", [0.1, 0.5, 1.0])
@pytest.mark.parametrize("kinds", [(1, 2), (0, 1), ("small", "large")])
@pytest.mark.parametrize("forces", [True, False])
def test_types_that_are_kinds_of_grains(tmp_path, periodic, share, kinds, forces):
    sample = resting(periodic)
    chosen = np.arange(len(sample.x)) < share * len(sample.x)
    kind = np.where(chosen, kinds[0] if kinds[0] else kinds[1], kinds[1] if kinds[0] else 0)
    contacts = sample.contacts()
    if not forces:
        contacts = {name: contacts[name] for name in ("id1", "id2")}
    grains = sample.grains() | {"type": kind.tolist()}
    path = put(tmp_path, sample, grains, contacts, change=lambda t: t.replace("'", ""))
    found = read(path, sample, **({} if forces else {"kn": None, "mu": None}))
    same(found, sample, forces=forces)


def with_walls_as_bodies(sample):
    """Tables in which each wall is a body of type 1."""
    count = len(sample.x)
    grains, contacts = sample.grains(), sample.contacts(normals=True)
    grains = {name: np.append(values, 0.0 if name != "id" else count)
              for name, values in grains.items()}  # fmt: skip
    grains["type"] = np.append(np.zeros(count, int), 1)
    push = np.linalg.norm(sample.push, axis=1)
    n = sample.push / push[:, None]
    more = {"id1": np.full(len(push), count), "id2": sample.grain, "nx": n[:, 0], "ny": n[:, 1],
            "fn": push, "ft": 0 * push}  # fmt: skip
    contacts = {name: np.append(values, more[name]) for name, values in contacts.items()}
    return grains, contacts


def test_walls_that_are_bodies_of_type_1(tmp_path):
    sample = resting(BOX)
    grains, contacts = with_walls_as_bodies(sample)
    same(read(put(tmp_path, sample, grains, contacts, False), sample), sample)
    # Contact points in place of the normals.
    inner, foot = np.zeros((len(sample.pairs), 2)), sample.x[sample.grain] - sample.foot
    points = contacts | dict(zip(("cx", "cy"), np.vstack([inner, foot]).T, strict=True))
    points = {name: values for name, values in points.items() if name not in ("nx", "ny")}
    same(read(put(tmp_path, sample, grains, points, False), sample), sample)
    # A row from each of the two bodies.
    turned = {**contacts, "id1": contacts["id2"], "id2": contacts["id1"],
              "nx": -contacts["nx"], "ny": -contacts["ny"]}  # fmt: skip
    both = {name: np.append(values, turned[name]) for name, values in contacts.items()}
    found = read(put(tmp_path, sample, grains, both, False), sample)
    same(found, sample)
    assert found.wall_contacts == len(sample.grain)
    # Without normals and points: the columns that lack are named.
    bare = {name: v for name, v in contacts.items() if name not in ("nx", "ny")}
    found = read(put(tmp_path, sample, grains, bare, False), sample, kt=0.5, mu=0.5, strict=False)
    assert any("cx, cy" in str(one) for one in found.findings if one.check == "wall_branches")
    half = {name: v for name, v in contacts.items() if name != "ny"}
    with pytest.raises(InputError, match="column 'ny'"):
        read(put(tmp_path, sample, grains, half, False), sample)


def test_the_user_says_what_type_is(tmp_path):
    sample = resting()
    grains = sample.grains() | {"type": (np.arange(len(sample.x)) % 2).tolist()}
    path = put(tmp_path, sample, grains)
    same(read(path, sample, columns={"type": "none"}), sample)
    half = read(path, sample, columns={"type": "type"}, strict=False)
    assert half.graph.grain_count == len(sample.x) // 2
    # A few discs of type 1 that touch no other one may be either.
    box = resting(BOX)
    lone = box.grains() | {"type": (np.arange(len(box.x)) == 3).astype(int).tolist()}
    found = read(put(tmp_path, box, lone, walls=False), box, strict=False)
    assert any("--columns type=none" in str(one) for one in found.findings)


# Forces by other names.


@pytest.mark.parametrize(
    "names", [("fx", "fy"), ("force_x", "force_y"), ("Force X (N)", "Force Y (N)")]
)
@pytest.mark.parametrize("side", [1, -1])
def test_forces_on_one_of_the_two_grains(tmp_path, names, side):
    sample = resting()
    one, two = sample.pairs.T
    force = side * sample.force[:, None] * sample.normal
    contacts = {"id1": one, "id2": two, **dict(zip(names, force.T, strict=True))}
    found = read(put(tmp_path, sample, contacts=contacts), sample)
    same(found, sample)
    assert any(f"forces on grain {2 if side > 0 else 1}" in note for note in found.notes)
    mixed = contacts | {names[0]: np.where(one % 2, 1, -1) * force[:, 0],
                        names[1]: np.where(one % 2, 1, -1) * force[:, 1]}  # fmt: skip
    with pytest.raises(InputError, match="to tell the grain that they act on"):
        read(put(tmp_path, sample, contacts=mixed), sample)


def test_parts_of_the_force_as_vectors(tmp_path):
    sample = resting()
    one, two = sample.pairs.T
    n, t = sample.normal, np.stack([-sample.normal[:, 1], sample.normal[:, 0]], axis=1)
    shear = 0.1 * sample.force
    vectors = np.hstack([sample.force[:, None] * n, shear[:, None] * t])
    names = ("nfx", "nfy", "tfx", "tfy")
    contacts = {"id1": one, "id2": two, **dict(zip(names, vectors.T, strict=True))}
    found = read(put(tmp_path, sample, contacts=contacts), sample, mu=0.5, kt=1.0, strict=False)
    np.testing.assert_allclose(found.graph.normal_force, sample.force, rtol=1e-12)
    np.testing.assert_allclose(found.graph.shear_force, shear, rtol=1e-12)


def test_columns_that_are_not_used_are_listed(tmp_path, capsys):
    sample = resting()
    contacts = sample.contacts()
    contacts = {"id1": contacts["id1"], "id2": contacts["id2"], "force": contacts["fn"],
                "colour": contacts["id1"]}  # fmt: skip
    path = put(tmp_path, sample, contacts=contacts)
    found = read(path, sample, mu=None, kn=None)
    (columns,) = [one for one in found.findings if one.check == "columns"]
    assert columns.severity == "doubt" and found.law is None
    assert "colour of contacts" in columns.says and "force of contacts" in columns.says
    # Between frictionless grains the size of the force is N.
    found = read(path, sample)
    same(found, sample)
    (columns,) = [one for one in found.findings if one.check == "columns"]
    assert columns.says == "columns not used: colour of contacts"
    cell = ",".join(map(str, sample.cell.ravel()))
    run("check", path, "--cell", cell, "--kn", 1, "--mu", 0)
    assert "columns not used: colour of contacts" in capsys.readouterr().out


# Pairs within a cutoff.


@pytest.mark.parametrize("periodic", [PERIODIC, BOX])
@pytest.mark.parametrize("forces", [True, False])
def test_pairs_within_a_cutoff_are_no_contacts(tmp_path, periodic, forces):
    sample = resting(periodic)
    one, two = np.triu_indices(len(sample.x), 1)
    d = sample.x[two] - sample.x[one]
    d -= np.where(periodic, sample.size * np.rint(d / sample.size), 0.0)
    gap = np.linalg.norm(d, axis=1) - sample.radii[one] - sample.radii[two]
    near = (gap > 0) & (gap < 0.25 * sample.radii.min())
    contacts = sample.contacts()
    more = {"id1": one[near], "id2": two[near]} | {n: np.zeros(near.sum()) for n in ("fn", "ft")}
    contacts = {name: np.append(values, more[name]) for name, values in contacts.items()}
    if not forces:
        contacts = {name: contacts[name] for name in ("id1", "id2")}
    how = {} if forces else {"kn": None, "mu": None}
    found = read(put(tmp_path, sample, contacts=contacts), sample, **how)
    same(found, sample, forces=forces)
    said = "without overlap and force" if forces else "without forces, by the distance"
    assert any(f"{near.sum()} pairs" in note and said in note for note in found.notes)


def test_measured_centres_keep_contacts_across_a_gap(tmp_path):
    sample = resting()
    noise = 0.05 * np.random.default_rng(0).normal(size=sample.x.shape)
    grains = sample.grains()
    grains["x"], grains["y"] = (sample.x + noise).T
    grains["radius"] = 0.96 * grains["radius"]
    contacts = {name: sample.contacts()[name] for name in ("id1", "id2")}
    found = read(put(tmp_path, sample, grains, contacts), sample, kn=None, mu=None)
    assert found.graph.contact_count == len(sample.pairs)


# Several snapshots in a table; orders of files; names of pairs.


@pytest.mark.parametrize("name", ["step", "time", "Time (s)", "frame", "TimeStep"])
@pytest.mark.parametrize("periodic", [PERIODIC, BOX])
def test_tables_with_a_column_of_steps(tmp_path, name, periodic):
    sample = resting(periodic)
    moments = [100, 200, 300]

    def long(table, moments=moments):
        rows = len(next(iter(table.values())))
        joined = {name: np.repeat(moments, rows)}
        return joined | {n: np.tile(values, len(moments)) for n, values in table.items()}

    grains = long(sample.grains())
    grains["x"] = grains["x"] + np.repeat([0.0, 1e-13, 2e-13], len(sample.x))
    contacts = long(sample.contacts(), moments[1:])
    walls = long(sample.walls(), moments[1:]) if len(sample.grain) else None
    path = put(tmp_path, sample, grains, contacts, walls)
    assert count_frames(path) == 2
    with pytest.raises(InputError, match=r"2 snapshots.*--frame"):
        read(path, sample)
    found = read(path, sample, frame=0)
    same(found, sample)
    assert any("1 snapshot without contacts left out" in note for note in found.notes)
    cell = sample.cell if any(periodic) else None
    assert [one.step or one.time for one in read_frames(path, cell=cell, **LAW)] == [200.0, 300.0]
    with pytest.raises(InputError, match=r"a column '(step|time)', as in the other table"):
        read(put(tmp_path, sample, grains, sample.contacts(), walls), sample, frame=0)


def test_cells_of_the_snapshots_of_a_table_are_read_once(tmp_path, monkeypatch):
    sample, read_files = resting(PERIODIC), []

    def long(table):
        rows = len(next(iter(table.values())))
        return {"step": np.repeat([5, 6, 7], rows)} | {n: np.tile(v, 3) for n, v in table.items()}

    path = put(tmp_path, sample, long(sample.grains()), long(sample.contacts()))
    matrix = [",".join(map(repr, map(float, sample.cell.ravel())))] * 3
    rows = [f"{k},{row}\n" for k, row in enumerate(matrix)]
    (tmp_path / "cells.csv").write_text("".join(["snap,h_xx,h_xy,h_yx,h_yy\n", *rows]))

    for module in ("frame", "cells"):
        target = f"patterns.snapshots.{module}.read_table"
        whole = sys.modules[f"patterns.snapshots.{module}"].read_table

        def spy(file, *wanted, whole=whole):
            read_files.append(file.name)
            return whole(file, *wanted)

        monkeypatch.setattr(target, spy)
    found = list(read_frames(path, cells=tmp_path / "cells.csv", **LAW))
    assert [one.step for one in found] == [5.0, 6.0, 7.0]
    assert all((one.graph.cell == sample.cell).all() for one in found)
    assert sorted(read_files) == ["cells.csv", "contacts_1.csv", "grains_1.csv"]


@pytest.mark.slow
def test_series_are_taken_by_their_steps(tmp_path, capsys):
    sample = resting()
    own = read(put(tmp_path, sample), sample)
    for step in (9000, 10000, 110000):
        folder = tmp_path / str(step)
        folder.mkdir()
        for path in write_lammps(folder, Packing.of(own), step):
            path.rename(tmp_path / f"{path.name}.{step}")
    given = [str(tmp_path / f"dump.atoms.{step}") for step in (10000, 110000, 9000)]
    law = ["--kn", "1", "--mu", "0"]
    for more, steps in (([], [9000, 10000, 110000]), (["--as-given"], [10000, 110000, 9000])):
        out = tmp_path / f"out{len(more)}"
        run("series", *given, *law, *more, "--workers", 1, "--no-figures", "--out", out)
        table = pa.parquet.read_table(out / "evolution.parquet")
        assert [int(name.split(".")[-1]) for name in table["name"].to_pylist()] == steps
        assert ("order of the steps" in capsys.readouterr().out) == (not more)


@pytest.mark.slow
def test_series_are_taken_by_the_numbers_in_their_names(tmp_path, capsys):
    sample = resting()
    plain = put(tmp_path, sample)
    numbers = [8, 9, 10, 11, 100]
    for number in numbers:
        for name in ("grains", "contacts"):
            other = tmp_path / f"{name}_{number}.csv"
            other.write_bytes(plain.with_name(f"{name}_1.csv").read_bytes())
    cell = ",".join(map(str, sample.cell.ravel()))
    given = sorted(str(tmp_path / f"grains_{number}.csv") for number in numbers)
    how = ["--cell", cell, "--kn", "1", "--mu", "0"]
    run("series", *given, *how, "--workers", 1, "--no-figures", "--out", tmp_path / "out")
    names = pa.parquet.read_table(tmp_path / "out/evolution.parquet")["name"].to_pylist()
    assert names == [f"grains_{number}.csv" for number in numbers]
    assert "order of the numbers in their names" in capsys.readouterr().out
    run("check", *given, *how)
    lines = [line for line in capsys.readouterr().out.splitlines() if ", snapshot 0" in line]
    assert [line.split("grains_")[1].split(".")[0] for line in lines] == list(map(str, numbers))


@pytest.mark.parametrize(
    ("grains", "contacts"),
    [
        ("particles_7.csv", "contacts_7.csv"), ("spheres_7.csv", "intrs_7.csv"),
        ("grain_7.csv", "contact_7.csv"), ("positions-7.txt", "contacts-7.txt"),
        ("PosVel7.dat", "Contact7.dat"), ("atoms.csv", "interactions.csv"),
        ("balls.csv", "contacts.csv"), ("nodes.csv", "edges.csv"), ("DISCS.TXT", "FORCES.TXT"),
        ("run2_Particles_5.csv.gz", "run2_Contacts_5.csv"), ("bodies.tsv", "bonds.tsv"),
    ],
)  # fmt: skip
def test_other_names_of_pairs(tmp_path, grains, contacts):
    sample = resting()
    for name, table in ((grains, sample.grains()), (contacts, sample.contacts())):
        data = text(table).encode()
        (tmp_path / name).write_bytes(gzip.compress(data) if name.endswith("gz") else data)
    same(read(tmp_path / grains, sample), sample)


def test_positions_and_contacts_of_a_known_layout(tmp_path):
    """Positions `id x y radius`; contacts with two types, normal and tangential force, moment."""
    sample = resting(BOX)
    grains = sample.grains()
    grains["id"] = grains["id"] + 1
    one, two = sample.pairs.T + 1
    force = sample.force[:, None] * sample.normal
    side = np.select([sample.push[:, 0] > 0, sample.push[:, 0] < 0, sample.push[:, 1] > 0],
                     [1, 2, 3], 4)  # fmt: skip
    rows = {
        "id1": np.append(one, sample.grain + 1),
        "id2": np.append(two, side),
        "type1": np.ones(len(one) + len(side), int),
        "type2": np.append(np.ones(len(one), int), np.full(len(side), 2)),
        "nfx": np.append(force[:, 0], -sample.push[:, 0]),
        "nfy": np.append(force[:, 1], -sample.push[:, 1]),
    }
    rows |= {name: np.zeros(len(one) + len(side)) for name in ("tfx", "tfy", "moment")}
    (tmp_path / "positions-1.txt").write_text(text(grains, " ", header=False))
    (tmp_path / "contacts-1.txt").write_text(text(rows, " ", header=False))
    found = read(tmp_path / "positions-1.txt", sample)
    same(found, sample)
    assert found.wall_contacts == len(sample.grain)
    names = {"id": 0, "x": 1, "y": 2, "radius": 3, "id1": 0, "id2": 1, "type1": 2, "type2": 3,
             "fnx": 4, "fny": 5, "ftx": 6, "fty": 7}  # fmt: skip
    same(read(tmp_path / "positions-1.txt", sample, columns=names), sample)


# Walls.


@pytest.mark.parametrize("branch", ["turned", "mm", "turned mm", "point", "normal", "none"])
@pytest.mark.parametrize("force", ["grain", "wall"])
@pytest.mark.parametrize("periodic", [BOX, (True, False)])
def test_branches_and_forces_of_walls(tmp_path, branch, force, periodic):
    sample = resting(periodic)
    walls = sample.walls()
    foot = sample.x[sample.grain] - sample.foot
    given = {
        "turned": -sample.foot,
        "mm": 1e3 * sample.foot,
        "turned mm": -1e3 * sample.foot,
        "point": foot,
        "normal": sample.foot / np.linalg.norm(sample.foot, axis=1)[:, None],
    }
    if branch == "none":
        del walls["branch_x"], walls["branch_y"]
    else:
        walls["branch_x"], walls["branch_y"] = given[branch].T
    if force == "wall":
        walls["fx"], walls["fy"] = -walls["fx"], -walls["fy"]
    how = {} if all(side is False for side in periodic) else {"periodic": "x"}
    found = read(put(tmp_path, sample, walls=walls), sample, **how)
    same(found, sample)
    np.testing.assert_allclose(found.walls.force, sample.push, atol=1e-12)
    np.testing.assert_allclose(found.walls.branch, sample.foot, rtol=1e-9, atol=1e-12)
    assert any("contacts with walls" in note for note in found.notes)


def test_branches_of_walls_that_fit_nothing_are_an_error(tmp_path):
    sample = resting(BOX)
    walls = sample.walls()
    walls["branch_x"], walls["branch_y"] = walls["branch_y"] + 0.3, walls["branch_x"]
    with pytest.raises(InputError, match=r"branches of contacts with walls are .* against the"):
        read(put(tmp_path, sample, walls=walls), sample)
    walls = sample.walls()
    turned = np.where(np.arange(len(sample.grain)) == 0, -1.0, 1.0)
    walls["branch_x"], walls["branch_y"] = (turned[:, None] * sample.foot).T
    found = read(put(tmp_path, sample, walls=walls), sample)
    (doubt,) = [one for one in found.findings if one.severity != "ok"]
    assert doubt.check == "wall_branches" and f"grains {sample.grain[0]}" in doubt.says


# Cells.


@pytest.mark.parametrize("along", ["x", "y"])
@pytest.mark.parametrize("height", [1.0, 10.0])
@pytest.mark.parametrize("walls", [True, False])
def test_periodic_along_one_axis(tmp_path, along, height, walls):
    sample = resting((along == "x", along == "y"))
    cell = sample.cell * [1.0, height] if along == "x" else sample.cell * [height, 1.0]
    path = put(tmp_path, sample, walls=None if walls else False)
    found = read(path, sample, cell=cell, periodic=along)
    same(found, sample, forces=walls, clean=walls)
    assert "lost" not in {one.check for one in found.findings if one.severity != "ok"}
    if not walls:
        # The given cell, which is at least as high as the grains.
        free = 1 if along == "x" else 0
        reach = np.ptp(sample.x[:, free]) + 2 * sample.radii.max()
        side = max(height * sample.size, reach)
        assert found.graph.cell[free, free] == pytest.approx(side, rel=1e-12)
        return
    tables = found.tables()
    again = snapshot_from_tables(**tables)
    np.testing.assert_array_equal(again.graph.cell, found.graph.cell)
    assert again.periodic == found.periodic
    gl.write_snapshot(tmp_path / "grains_2.csv", found)
    written = read_snapshot(tmp_path / "grains_2.csv", mu=0.0)
    np.testing.assert_allclose(gl.stress(written).tensor, sample.stress, rtol=0, atol=1e-9)
    out, given = tmp_path / "out", ",".join(map(str, np.ravel(cell)))
    how = ("--cell", given, "--periodic", along, "--kn", 1, "--mu", 0)
    assert run("snapshot", path, *how, "--no-figures", "--out", out) == 0


def test_a_sample_between_walls_in_a_whole_cell_is_told_the_option(tmp_path):
    sample = resting((True, False))
    found = read(put(tmp_path, sample), sample)
    (lost,) = [one for one in found.findings if one.severity != "ok"]
    assert lost.check == "lost" and "--periodic x" in lost.remedy
    with pytest.raises(InputError, match="--periodic: got no cell"):
        read(put(tmp_path, sample), sample, cell=None, periodic="x")
    with pytest.raises(InputError, match="periodic"):
        read(put(tmp_path, sample), sample, periodic="z")


@pytest.mark.parametrize("share", [0.01, 0.02, 0.05, -0.02])
@pytest.mark.parametrize("forces", [True, False])
@pytest.mark.parametrize("axes", [(1, 1), (1, 0)])
def test_a_cell_that_is_too_large_is_told(tmp_path, share, forces, axes):
    sample = resting()
    contacts = sample.contacts()
    if not forces:
        contacts = {name: contacts[name] for name in ("id1", "id2")}
    cell = sample.cell * (1 + share * np.array(axes))
    how = {} if forces else {"kn": None, "mu": None}
    path = put(tmp_path, sample, contacts=contacts)
    with pytest.raises(InputError, match=r"the cell is along x .* % too (long|short)") as told:
        read(path, sample, cell=cell, **how)
    assert ("too long" in str(told.value)) == (share > 0)
    found = read(path, sample, cell=cell, strict=False, **how)
    assert found.graph.contact_count == len(sample.pairs)
    # With forces overlaps are known, and so is the edge, to what turns the branches leave.
    (cell_told,) = [one for one in found.findings if one.check == "cell"]
    right = [float(word) for word in cell_told.remedy.split()[1].split(",")]
    tolerance = (0.1 if forces else 0.3) * abs(share)
    np.testing.assert_allclose(right[0], sample.size, rtol=tolerance)


def test_small_excess_of_a_cell_without_forces_drops_no_contact(tmp_path):
    sample = resting()
    contacts = {name: sample.contacts()[name] for name in ("id1", "id2")}
    path = put(tmp_path, sample, contacts=contacts)
    found = read(path, sample, cell=1.001 * sample.cell, kn=None, mu=None, strict=False)
    assert found.graph.contact_count == len(sample.pairs)


# Runs that begin without grains.


@pytest.mark.parametrize("empty", [1, 3])
def test_a_run_that_begins_without_grains(tmp_path, empty):
    sample = resting(BOX)
    own = read(put(tmp_path, sample), sample)
    from tests.patterns.dump_writers import write_mercury

    data, fstat = write_mercury(tmp_path, Packing.of(own), 0.5)
    head = data.read_text().split("\n", 1)[0].split()
    first = "".join(f"0 {0.1 * k:g} {' '.join(head[2:])}\n" for k in range(empty))
    comments = "".join(f"# {0.1 * k:g} 1\n# 0 0 0 1 1 1\n# 1 1 0 0 0 0\n" for k in range(empty))
    data.write_text(first + data.read_text())
    fstat.write_text(comments + fstat.read_text())
    assert count_frames(data) == 1
    found = read_snapshot(data, **LAW)
    np.testing.assert_allclose(gl.stress(found).tensor, sample.stress, rtol=0, atol=1e-9)
    assert any(f"{empty} earlier snapshots" in note for note in found.notes)


# Photoelastic data without a column of frames.


def test_positions_of_discs_without_frames(tmp_path):
    """As RigidLibrary has them: radii of images too small, one fit that failed, rows of both."""
    sample = resting(BOX)
    rng = np.random.default_rng(0)
    pixels = 40.0
    x = np.column_stack([sample.x[:, 0], sample.size - sample.x[:, 1]]) * pixels
    radii = np.rint(0.92 * pixels * sample.radii)
    rows = np.column_stack([np.arange(1, len(x) + 1), x, radii, np.ones(len(x))])
    shear = 0.1 * sample.force * rng.uniform(-1, 1, len(sample.force))
    shear[5] = 250 * np.median(sample.force)
    one, two = sample.pairs.T + 1
    own = [np.column_stack([np.ones(len(one)), a, b, shear, sample.force])
           for a, b in ((one, two), (two, one))]  # fmt: skip
    path = tmp_path / "particle_positions.txt"
    np.savetxt(path, rows, "%.10g", ",")
    np.savetxt(tmp_path / "Adjacency_list.txt", np.vstack(own), "%.10g", ",")
    found = read_snapshot(path)
    assert found.graph.grain_count == len(x)
    assert found.graph.contact_count == len(sample.pairs)
    assert len(found.faces.loops) == len(sample.pairs) - len(np.unique(sample.pairs)) + 1
    told = {one.check: one for one in found.findings if one.severity != "ok"}
    assert "images" in told["distances"].says
    assert f"grains {one[5]} and {two[5]}" in told["unbalanced"].says
    assert "directions" not in told


FIELD = Path(os.environ.get("GRAINLOOPS_FIELD") or "none")


@pytest.mark.published
@pytest.mark.skipif(not FIELD.is_dir(), reason="GRAINLOOPS_FIELD names no folder")
def test_photoelastic_data_as_published():
    (path,) = FIELD.glob("*/particle_positions.txt")
    found = read_snapshot(path)
    counts = found.graph.grain_count, found.graph.contact_count, len(found.faces.loops)
    assert counts == (1772, 738, 23)
    told = {one.check for one in found.findings if one.severity != "ok"}
    assert "unbalanced" in told and "directions" not in told


# Forces that are all zero, and strains that are no compression.


@pytest.mark.filterwarnings("error")
def test_forces_that_are_all_zero_give_no_verdict(tmp_path, capsys):
    sample = resting(BOX)
    contacts = sample.contacts() | {"fn": 0 * sample.force, "ft": 0 * sample.force}
    path = put(tmp_path, sample, contacts=contacts, walls=False)
    stress = gl.stress(read(path, sample, mu=0.5, kt=KN))
    assert stress.p == stress.q == 0.0 and np.isnan(stress.q_over_p)
    law = ("--kn", KN, "--kt", KN, "--mu", 0.5)
    assert run("snapshot", path, *law, "--figures", "none", "--out", tmp_path / "r") == 0
    printed = capsys.readouterr().out
    assert "all contact forces are zero: no verdict on the loops" in printed
    assert "unstable" not in printed


@pytest.mark.slow
def test_a_series_of_simple_shear_prints_its_shear(tmp_path, capsys):
    sample = resting(BOX)
    for k, shear in enumerate((0.0, 1e-3)):
        grains = sample.grains()
        grains["x"] = grains["x"] - shear * grains["y"]
        (tmp_path / f"grains_{k}.csv").write_text(text(grains))
        pairs = {name: sample.contacts()[name] for name in ("id1", "id2")}
        (tmp_path / f"contacts_{k}.csv").write_text(text(pairs))
    files = [tmp_path / f"grains_{k}.csv" for k in (0, 1)]
    how = ("--workers", 1, "--figures", "none", "--out", tmp_path / "r")
    assert run("series", *files, *how) == 0
    (line,) = (x for x in capsys.readouterr().out.splitlines() if x.startswith("strain between"))
    strains = dict(part.split(" = ") for part in line.partition(": ")[2].split("  "))
    assert float(strains["H12"]) == pytest.approx(1e-3, rel=1e-5)
    assert all(abs(float(strains[name])) < 1e-12 for name in ("H11", "H21", "H22"))
