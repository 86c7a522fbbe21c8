"""Saves of Yade: damage, other serialisations, walls of other shapes."""

import bz2
import gzip
import re

import pytest

from loops import InputError
from patterns import read_snapshot
from patterns.snapshots.source import Source
from patterns.snapshots.yade_save import frame_of_save, read_save
from tests.patterns.snapshots.yade_samples import (
    BOX,
    PERIODIC,
    cycles,
    snapshot_of,
    table_of,
)

SAVE = BOX / "state.xml.gz"
TEXT = gzip.decompress(SAVE.read_bytes())


def saved(folder, text, name="state.xml"):
    (folder / name).write_bytes(text)
    return folder / name


@pytest.mark.parametrize("ending", ["", ".bz2", ".gz"])
def test_plain_and_packed(tmp_path, ending):
    pack = {"": bytes, ".bz2": bz2.compress, ".gz": gzip.compress}[ending]
    path = saved(tmp_path, pack(TEXT), f"state.xml{ending}")
    assert cycles(read_snapshot(path)) == cycles(table_of(BOX))


def test_step_and_notes():
    snapshot = snapshot_of(SAVE)
    assert snapshot.step == 77504
    assert snapshot.graph.cell is None
    assert "bodies taken as walls: Wall" in snapshot.notes
    assert "taken as walls" not in " ".join(snapshot_of(PERIODIC / "state.xml.gz").notes)


@pytest.mark.parametrize("share", [0.001, 0.2, 0.5, 0.9, 0.9999])
def test_truncated(tmp_path, share):
    path = saved(tmp_path, TEXT[: int(share * len(TEXT))])
    with pytest.raises(InputError, match=r"ends or breaks|no <boost|no <scene>"):
        snapshot_of(path)
    packed = SAVE.read_bytes()
    path = saved(tmp_path, packed[: int(share * len(packed))], "state.xml.gz")
    with pytest.raises(InputError, match=r"truncated|ends or breaks"):
        snapshot_of(path)
    packed = bz2.compress(TEXT)
    path = saved(tmp_path, packed[: int(share * len(packed))], "state.xml.bz2")
    with pytest.raises(InputError, match=r"truncated|ends or breaks|no <boost"):
        snapshot_of(path)


def test_missing_and_empty(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        snapshot_of(tmp_path / "state.xml")
    with pytest.raises(InputError, match="an empty file"):
        snapshot_of(saved(tmp_path, b""))


def test_entities_are_refused(tmp_path):
    bomb = b'<!DOCTYPE boost_serialization [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]>'
    assert b"<!DOCTYPE boost_serialization>" in TEXT
    path = saved(tmp_path, TEXT.replace(b"<!DOCTYPE boost_serialization>", bomb))
    with pytest.raises(InputError, match="declarations of entities"):
        snapshot_of(path)
    path = saved(tmp_path, b" " * 70000 + TEXT.replace(b"<!DOCTYPE boost_serialization>", bomb))
    with pytest.raises(InputError, match="no <boost_serialization>"):
        snapshot_of(path)


def vtk(kind):
    return f'<?xml version="1.0"?>\n<VTKFile type="{kind}" version="0.1">\n</VTKFile>\n'.encode()


@pytest.mark.parametrize(
    ("name", "content", "lack"),
    [
        ("spheres.txt", (BOX / "spheres.txt").read_bytes(), "spheres alone"),
        ("e-spheres-0.vtk", b"# vtk DataFile Version 3.0.\ncomment\nASCII\n", "six digits"),
        ("s-spheres.1.vtu", vtk("UnstructuredGrid"), "without shear forces"),
        ("s-intrs.1.vtp", vtk("PolyData"), "without shear forces"),
        ("s-1.vtm", vtk("vtkMultiBlockDataSet"), "without shear forces"),
        ("state.yade", b"\x16" + bytes(7) + b"serialization::archive\x12" + bytes(500), "binary"),
    ],
)
@pytest.mark.parametrize("pack", [bytes, gzip.compress, bz2.compress])
def test_files_without_mechanics_are_refused_with_the_way_out(tmp_path, name, content, lack, pack):
    ending = {bytes: "", gzip.compress: ".gz", bz2.compress: ".bz2"}[pack]
    path = saved(tmp_path, pack(content), f"{name}{ending}")
    with pytest.raises(InputError, match=rf"{lack}.*export_tables.*docs/yade\.md"):
        read_snapshot(path, kn=1.0, kt=0.5, mu=0.5)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("shearForce", "tangentForce", r"no <shearForce> in interaction .*ScGeom, FrictPhys"),
        ("normal", "direction", "no <normal> in interaction"),
        ("kn", "stiffness", "FrictPhys lacks kn"),
        ("cellDist", "image", "no <cellDist>"),
        ("radius", "size", "no <radius> in shape of body 0"),
        ("position", "place", "no <position> in body 0"),
        ("isPeriodic", "periodic", "no <scene>"),
    ],
)
def test_errors_of_other_serialisations_name_the_missing_element(tmp_path, old, new, message):
    with pytest.raises(InputError, match=message) as error:
        renamed = re.sub(rf"(</?){old}\b".encode(), rf"\1{new}".encode(), TEXT)
        snapshot_of(saved(tmp_path, renamed))
    assert "docs/yade.md" in error.value.remedy


def test_numbers_that_are_none(tmp_path):
    start, stop = re.search(rb"<kn>[\d.e+]+</kn>", TEXT).span()
    for wrong in (b"<kn>nan</kn>", b"<kn>soft</kn>", b"<kn></kn>"):
        path = saved(tmp_path, TEXT[:start] + wrong + TEXT[stop:])
        with pytest.raises(InputError, match="<kn>"):
            snapshot_of(path)


def test_clumps_are_refused(tmp_path):
    path = saved(tmp_path, TEXT.replace(b"<clumpId>-1<", b"<clumpId>7<", 1))
    with pytest.raises(InputError, match="body 0 belongs to a clump"):
        snapshot_of(path)


def test_no_interactions(tmp_path):
    scene = TEXT.replace(b"<id1>", b"<first>").replace(b"</id1>", b"</first>")
    with pytest.raises(InputError, match="no real interaction"):
        snapshot_of(saved(tmp_path, scene))


def test_friction_is_left_out_where_a_law_has_none(tmp_path):
    text = TEXT.replace(b"tangensOfFrictionAngle>", b"cohesion>")
    smooth, rough = snapshot_of(saved(tmp_path, text)), snapshot_of(SAVE)
    assert "neither 'sliding' nor 'mu'" in " ".join(smooth.notes)
    assert (smooth.law.kn == rough.law.kn).all() and (smooth.law.kt == rough.law.kt).all()


def test_older_class_names(tmp_path):
    older = snapshot_of(saved(tmp_path, TEXT.replace(b'"yade::', b'"')))
    assert (older.graph.normal_force == snapshot_of(SAVE).graph.normal_force).all()


def test_shared_shapes(tmp_path):
    """Two bodies of one shape: the second refers to the first."""
    objects = [TEXT.index(b"<shape>")]
    objects.append(TEXT.index(b"<shape>", objects[0] + 1))
    start, stop = objects[1], TEXT.index(b"</shape>", objects[1])
    name = TEXT[TEXT.index(b'object_id="', objects[0]) + 11 :].split(b'"')[0]
    shared = b'<shape><px class_id_reference="1" object_id_reference="' + name + b'"></px>'
    path = saved(tmp_path, TEXT[:start] + shared + TEXT[stop:])
    first = snapshot_of(SAVE).graph.radii[0]
    assert snapshot_of(path, strict=False).graph.radii[:2].tolist() == [first, first]
    lost = shared.replace(name, b"_x")
    with pytest.raises(InputError, match="no shape _x"):
        snapshot_of(saved(tmp_path, TEXT[:start] + lost + TEXT[stop:]))


@pytest.mark.parametrize("shape", ["Wall", "Box", "Facet"])
def test_branch_from_the_foot_on_the_wall(shape):
    """A sphere of radius 1 whose centre is 0.9 from the wall, overlap 0.1.

    Yade's contact point lies on a Wall, and halfway through the overlap of a Box or Facet.
    """
    scene = read_save(SAVE)
    grain, wall = (next(iter(scene.bodies)) for _ in range(2)), scene.bodies[43]
    grain, contact = next(grain), scene.interactions[0]
    assert type(wall.shape).__name__ == "Wall"
    vector, point = type(contact.geom.normal), 0.0 if shape == "Wall" else -0.05
    grain.state.pos, grain.shape.radius = vector((5.0, 0.9, 0.0)), 1.0
    wall.shape = type(shape, (), {})()
    contact.id1, contact.id2 = wall.id, grain.id
    contact.geom.normal, contact.geom.contactPoint = vector((0, 1, 0)), vector((5.0, point, 0))
    contact.phys.normalForce, contact.phys.shearForce = vector((0, 50, 0)), vector((7, 0, 0))
    scene.interactions = [contact]
    contacts = frame_of_save(Source(SAVE), scene).contacts
    assert contacts.column("branch_y")[0] == pytest.approx(0.9, rel=1e-15)
    assert contacts.column("branch_x")[0] == 0
    assert contacts.column("fx_on_2")[0] == 7
    assert contacts.column("fy_on_2")[0] == 50


def test_masses_and_velocities_are_read():
    snapshot = snapshot_of(SAVE)
    (mass,) = re.findall(rb"<mass>(.*?)</mass>", TEXT)[:1]
    (spin,) = re.findall(rb"<angVel>\s*<x>.*?</x>\s*<y>.*?</y>\s*<z>(.*?)</z>", TEXT)[:1]
    assert snapshot.mass[0] == float(mass)
    assert snapshot.spin[0] == float(spin)
    assert snapshot.time == float(re.findall(rb"<time>(.*?)</time>", TEXT)[0])


def test_bonds_are_those_of_the_law():
    """As `CohFrictPhys` has them, one of them broken."""
    scene = read_save(SAVE)
    kinds = ("unp", "unpMax", "fragile", "cohesionDisablesFriction", "momentRotationLaw")
    for k, i in enumerate(scene.interactions):
        vars(i.phys).update({**dict.fromkeys(kinds, 0.0), "cohesionBroken": float(k == 0)})
        i.phys.normalAdhesion, i.phys.shearAdhesion = 3.0, 2.0
    frame = frame_of_save(Source(SAVE), scene)
    assert frame.law == "bonded"
    assert sorted(set(frame.contacts.column("adhesion"))) == [0.0, 3.0]
    del scene.interactions[-1].phys.unp
    with pytest.raises(InputError, match=r"unp.*docs/yade\.md"):
        frame_of_save(Source(SAVE), scene)


def test_an_interaction_with_a_body_that_is_not_there():
    scene = read_save(SAVE)
    pair = scene.interactions[0]
    pair.id1 = 4711
    with pytest.raises(InputError, match="no body 4711 of an interaction"):
        frame_of_save(Source(SAVE), scene)
