"""VTKRecorder's files: encodings, faults, damage, wrong pairs."""

import gzip
import shutil
import sys

import numpy as np
import pytest

from loops import InputError
from patterns.snapshots.build import build_snapshot
from patterns.snapshots.formats import FORMATS
from patterns.snapshots.laws import Parameters
from patterns.snapshots.yade_vtk import is_yade_vtk, read_vtk
from tests.patterns.snapshots.yade_samples import (
    BOX,
    PERIODIC,
    changed,
    cycles,
    frame_of,
    snapshot_of,
    table_of,
)

SPHERES, LINES = BOX / "appended-spheres.77504.vtu", BOX / "appended-intrs.77504.vtp"
TEXT = BOX / "ascii-intrs.77504.vtp"


def written(folder, mode, compressor, words, order="<", lines=None):
    """The pair as VTK itself writes it, in another encoding."""
    from vtkmodules import vtkIOXML

    for path, kind in ((SPHERES, "UnstructuredGrid"), (LINES, "PolyData")):
        reader = getattr(vtkIOXML, f"vtkXML{kind}Reader")()
        reader.SetFileName(str(path))
        reader.Update()
        writer = getattr(vtkIOXML, f"vtkXML{kind}Writer")()
        writer.SetInputData(reader.GetOutput())
        writer.SetFileName(str(folder / path.name))
        getattr(writer, f"SetDataModeTo{mode.removesuffix('Raw')}")()
        writer.SetEncodeAppendedData(0 if mode.endswith("Raw") else 1)
        getattr(writer, f"SetCompressorTypeTo{compressor}")()
        getattr(writer, f"SetHeaderTypeToUInt{words}")()
        getattr(writer, f"SetByteOrderTo{'Little' if order == '<' else 'Big'}Endian")()
        writer.Write()
    return folder / SPHERES.name, folder / LINES.name


@pytest.mark.parametrize("compressor", ["None", "ZLib", "LZ4", "LZMA"])
@pytest.mark.parametrize("mode", ["Ascii", "Binary", "Appended", "AppendedRaw"])
@pytest.mark.parametrize(("words", "order"), [(32, "<"), (64, "<"), (32, ">")])
def test_every_encoding_of_vtk(tmp_path, mode, compressor, words, order):
    frame = frame_of(FORMATS["yade-vtk"], written(tmp_path, mode, compressor, words, order)[0])
    expected = frame_of(FORMATS["yade-vtk"], SPHERES)
    for table, other in ((frame.grains, expected.grains), (frame.contacts, expected.contacts)):
        assert table.names == other.names
        for name in table.names:
            # Text has enough digits to give back the numbers.
            assert (table.column(name) == other.column(name)).all()


@pytest.mark.parametrize("mode", ["Ascii", "Binary", "Appended", "AppendedRaw"])
@pytest.mark.parametrize("compressor", ["None", "ZLib"])
def test_surplus_values_are_seen_in_every_encoding(tmp_path, mode, compressor):
    """A line less in the header than there are values: what the periodic fault looks like."""
    _, lines = written(tmp_path, mode, compressor, 32)
    copy = changed(lines, tmp_path, b'NumberOfLines="57"', b'NumberOfLines="56"', "less.vtp")
    with pytest.raises(InputError, match=r"56 lines and 57 values of forceN.*periodic"):
        read_vtk(copy)


@pytest.mark.parametrize("name", ["appended-spheres.134672.vtu", "ascii-spheres.134672.vtu.gz"])
def test_periodic_fault_is_refused_with_reason_and_remedy(name):
    # 32 lines inside the cell, 11 contacts across its border with two values each.
    with pytest.raises(InputError, match="32 lines and 54 values of forceN") as error:
        frame_of(FORMATS["yade-vtk"], PERIODIC / name)
    assert "periodic cell" in error.value.remedy
    assert "docs/yade.md" in error.value.remedy


def test_ghosts_of_a_periodic_border_are_refused(tmp_path):
    """Lines that end beyond the border, as a recorder without the fault would draw them."""
    copy = changed(TEXT, tmp_path, *point_moved())
    with pytest.raises(InputError, match=r"\d+ of 57 lines that end at no sphere"):
        frame_of(FORMATS["yade-vtk"], SPHERES, contacts=copy)


def point_moved():
    lines = TEXT.read_bytes().split(b"\n")
    row = next(k for k, line in enumerate(lines) if b'Name="Points"' in line) + 1
    return lines[row], b" ".join([b"9.5", *lines[row].split()[1:]])


def test_gzip_of_both_files(tmp_path):
    for path in (SPHERES, LINES):
        (tmp_path / f"{path.name}.gz").write_bytes(gzip.compress(path.read_bytes()))
    found = snapshot_of(FORMATS["yade-vtk"], tmp_path / f"{SPHERES.name}.gz")
    assert cycles(found) == cycles(table_of(BOX))


def recorded(folder, order, ids):
    """The spheres in another order, with other ids."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkUnstructuredGrid
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    piece = read_vtk(SPHERES)
    grid, points = vtkUnstructuredGrid(), vtkPoints()
    points.SetData(numpy_to_vtk(piece.points[order].astype(np.float32), deep=True))
    grid.SetPoints(points)
    for name, values in (("radii", piece.points_data["radii"]), ("id", ids)):
        array = numpy_to_vtk(values[order], deep=True)
        array.SetName(name)
        grid.GetPointData().AddArray(array)
    writer = vtkXMLUnstructuredGridWriter()
    writer.SetFileName(str(folder / SPHERES.name))
    writer.SetInputData(grid)
    writer.Write()
    return folder / SPHERES.name


def test_ids_are_those_of_the_file_not_its_order(tmp_path):
    """Spheres recorded in another order: lines go by place, ids by the array."""
    piece = read_vtk(SPHERES)
    order = np.random.default_rng(5).permutation(len(piece.points))
    recorded(tmp_path, order, piece.points_data["id"])
    shuffled = snapshot_of(FORMATS["yade-vtk"], tmp_path / SPHERES.name, contacts=LINES)
    assert cycles(shuffled) == cycles(table_of(BOX))
    assert (shuffled.ids == np.sort(order)).all()


def test_ids_of_19_digits_keep_every_digit(tmp_path):
    """As floats they are refused: each stands for hundreds of whole numbers."""
    count = len(read_vtk(SPHERES).points)
    ids = 2**62 + 1 + 3 * np.arange(count)
    path = recorded(tmp_path, np.arange(count), ids)
    assert (snapshot_of(FORMATS["yade-vtk"], path, contacts=LINES).ids == ids).all()
    path = recorded(tmp_path, np.arange(count), ids.astype(float))
    with pytest.raises(InputError, match=r"column 'id' .*\.vtu, row 0: got 4.6.*below 2\*\*63"):
        snapshot_of(FORMATS["yade-vtk"], path, contacts=LINES)


def test_files_of_two_snapshots(tmp_path):
    with pytest.raises(InputError, match=r"end at none of the spheres.*same iteration"):
        frame_of(FORMATS["yade-vtk"], PERIODIC / "appended-spheres.134672.vtu", contacts=LINES)


def test_no_interactions_beside(tmp_path):
    shutil.copy(SPHERES, tmp_path)
    with pytest.raises(InputError, match=r"appended-intrs.77504.vtp.*Record 'intr'"):
        frame_of(FORMATS["yade-vtk"], tmp_path / SPHERES.name)


def test_lines_given_for_spheres(tmp_path):
    with pytest.raises(InputError, match="file of the spheres"):
        frame_of(FORMATS["yade-vtk"], LINES)
    copy = changed(BOX / "ascii-spheres.77504.vtu", tmp_path, b'"radii"', b'"weight"')
    with pytest.raises(InputError, match=r"points with weight, id.*spheres with 'radii'"):
        frame_of(FORMATS["yade-vtk"], copy, contacts=LINES)


def test_multiblock_needs_both_blocks(tmp_path):
    path = BOX / "multi-77504.vtm"
    copy = changed(path, tmp_path, b"_1.vtp", b"_1.vtu")
    with pytest.raises(InputError, match=r"2 .vtu and 0 .vtp blocks"):
        frame_of(FORMATS["yade-vtk"], copy)
    shutil.copy(path, tmp_path)
    with pytest.raises(InputError, match="no such file"):
        frame_of(FORMATS["yade-vtk"], tmp_path / path.name)


def test_without_vtk_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "vtkmodules.vtkIOXML", None)
    with pytest.raises(InputError, match="pip install vtk"):
        frame_of(FORMATS["yade-vtk"], SPHERES)


def test_a_line_from_a_sphere_to_itself(tmp_path):
    lines = TEXT.read_bytes().split(b"\n")
    section = next(k for k, line in enumerate(lines) if b"<Lines>" in line)
    first = lines[section + 2].split()
    same = b" ".join([first[0], first[0], *first[2:]])
    copy = changed(TEXT, tmp_path, lines[section + 2], same)
    with pytest.raises(InputError, match="from a sphere to itself"):
        frame_of(FORMATS["yade-vtk"], SPHERES, contacts=copy)


def test_forces_that_are_no_numbers(tmp_path):
    lines = TEXT.read_bytes().split(b"\n")
    row = next(k for k, line in enumerate(lines) if b'Name="forceN"' in line) + 1
    copy = changed(TEXT, tmp_path, lines[row], b" ".join([b"nan", *lines[row].split()[1:]]))
    with pytest.raises(InputError, match="no finite forces"):
        frame_of(FORMATS["yade-vtk"], SPHERES, contacts=copy)


def test_without_forces_the_geometry_is_left(tmp_path):
    copy = changed(TEXT, tmp_path, b'"forceN"', b'"something"')
    found = snapshot_of(FORMATS["yade-vtk"], SPHERES, contacts=copy)
    assert cycles(found) == cycles(table_of(BOX))
    assert found.law is None and not found.graph.normal_force.any()


def test_frictionless_grains_have_all_their_forces():
    found = build_snapshot(
        frame_of(FORMATS["yade-vtk"], SPHERES), Parameters(kn=4e5, kt=2e5, mu=0.0)
    )
    assert found.law is not None and found.graph.normal_force.any()


@pytest.mark.parametrize("path", [TEXT, LINES, SPHERES], ids=lambda path: path.name)
def test_truncated_files(tmp_path, path, capfd):
    content = path.read_bytes()
    for stop in np.linspace(0, len(content) - 12, 40).astype(int):
        copy = tmp_path / path.name
        copy.write_bytes(content[:stop])
        with pytest.raises(InputError):
            read_vtk(copy)
    # vtk would write its own lines on the screen.
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("path", [TEXT, LINES, SPHERES], ids=lambda path: path.name)
def test_damaged_files_raise_the_one_error_or_read(tmp_path, path):
    rng = np.random.default_rng(11)
    content = path.read_bytes()
    for _ in range(150):
        damaged = bytearray(content)
        at = int(rng.integers(len(content)))
        damaged[at : at + int(rng.integers(1, 6))] = (
            rng.integers(32, 127, 4).astype(np.uint8).tobytes()
        )
        copy = tmp_path / path.name
        copy.write_bytes(bytes(damaged))
        source = {"contacts": LINES} if path == SPHERES else {"contacts": copy}
        try:
            snapshot_of(FORMATS["yade-vtk"], copy if path == SPHERES else SPHERES, **source)
        except InputError as error:
            assert "\n" not in str(error)


def test_counts_beyond_the_file_are_refused(tmp_path):
    copy = changed(TEXT, tmp_path, b'NumberOfPoints="44"', b'NumberOfPoints="99999999999"')
    with pytest.raises(InputError, match="99999999999 points"):
        read_vtk(copy)


def test_recognised_by_content():
    for path in (
        SPHERES,
        LINES,
        TEXT,
        BOX / "multi-77504.vtm",
        BOX / "exporter-spheres-00000000.vtk",
    ):
        assert is_yade_vtk(path, path.read_bytes()[:4096])
    assert not is_yade_vtk(BOX / "x.vtu", b"<boost_serialization>")
