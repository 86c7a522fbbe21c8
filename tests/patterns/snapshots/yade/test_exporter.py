"""VTKExporter's legacy files."""

import numpy as np
import pytest

from loops import InputError
from patterns.snapshots.files import open_text
from patterns.snapshots.formats import FORMATS
from patterns.snapshots.yade_vtk import read_vtk
from tests.patterns.snapshots.yade_samples import BOX, changed, cycles, frame_of, snapshot_of

pytest.importorskip("vtkmodules")

SPHERES = BOX / "exporter-spheres-00000000.vtk"
LINES = BOX / "exporter-intrs-00000000.vtk.gz"


def test_arrays_of_other_names_come_by_the_column_map(tmp_path):
    copy = changed(LINES, tmp_path, b"VECTORS fn", b"VECTORS push")
    copy = changed(copy, tmp_path, b"VECTORS fs", b"VECTORS drag")
    copy = changed(copy, tmp_path, b"SCALARS kn", b"SCALARS spring")
    names = {"fn": "push", "fsx": "drag_x", "fsy": "drag_y", "kn": "spring"}
    given = frame_of(FORMATS["yade-vtk"], SPHERES, contacts=copy, columns=names)
    expected = frame_of(FORMATS["yade-vtk"], SPHERES)
    for name in ("fn", "fsx", "fsy", "kn", "ks", "branch_x"):
        assert (given.contacts.column(name) == expected.contacts.column(name)).all()
    with pytest.raises(InputError, match="no_such"):
        frame_of(FORMATS["yade-vtk"], SPHERES, columns={"kn": "no_such"})


def test_without_the_force_vector_walls_and_images_look_alike(tmp_path):
    copy = changed(LINES, tmp_path, b"VECTORS fn", b"VECTORS other")
    with pytest.raises(InputError, match="18 of 75 lines that end at no sphere"):
        frame_of(FORMATS["yade-vtk"], SPHERES, contacts=copy)


def test_images_beyond_a_periodic_border_are_refused(tmp_path):
    """Lines along their force whose first end is no sphere: grains, not walls."""
    piece = read_vtk(LINES)
    fn = piece.lines_data["fn"]
    walls = [k for k in range(len(fn)) if (fn[k, :2] == 0).any()]
    assert len(walls) == 18
    text = bytes(open_text(LINES)).split(b"\n")
    first = next(k for k, line in enumerate(text) if line.startswith(b"POINTS")) + 1
    for k in walls:
        start, stop = piece.lines[k]
        image = piece.points[stop] - 0.1 * fn[k] / np.linalg.norm(fn[k])
        text[first + start] = b"%g %g %g" % tuple(image)
    copy = tmp_path / "shifted-intrs.vtk"
    copy.write_bytes(b"\n".join(text))
    with pytest.raises(InputError, match="periodic border"):
        frame_of(FORMATS["yade-vtk"], SPHERES, contacts=copy)


def test_files_of_two_snapshots(tmp_path):
    text = bytes(open_text(LINES)).replace(b"0.", b"1.")
    (tmp_path / "other-intrs.vtk").write_bytes(text)
    with pytest.raises(InputError, match=r"one snapshot|no sphere"):
        frame_of(FORMATS["yade-vtk"], SPHERES, contacts=tmp_path / "other-intrs.vtk")


def test_ids_exported_by_the_user(tmp_path):
    ids = "\n".join(str(100 - k) for k in range(40))
    copy = tmp_path / SPHERES.name
    array = f"\nSCALARS id double 1\nLOOKUP_TABLE default\n{ids}\n"
    copy.write_bytes(SPHERES.read_bytes() + array.encode())
    named = snapshot_of(FORMATS["yade-vtk"], copy, contacts=LINES)
    assert named.ids.tolist() == list(range(61, 101))
    order = snapshot_of(FORMATS["yade-vtk"], SPHERES)
    assert cycles(named) == {frozenset(100 - k for k in loop) for loop in cycles(order)}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"ASCII", b"BINARY", "no ASCII legacy VTK file"),
        (b"\n2 0 1\n", b"\n2 0 900\n", "lines that do not join two|damaged"),
        (b"\n2 0 1\n", b"\n3 0 1\n", "lines that do not join two|damaged"),
        (b"LINES 75 225", b"LINES 76 228", "damaged|lines that"),
        (b"POINTS 150", b"POINTS many", "damaged"),
        (b"SCALARS kn", b"VECTORS kn", "arrays that break off"),
    ],
)
def test_damage_is_named(tmp_path, old, new, message):
    copy = changed(LINES, tmp_path, old, new)
    with pytest.raises(InputError, match=message):
        frame_of(FORMATS["yade-vtk"], SPHERES, contacts=copy)


def test_truncated_files(tmp_path):
    content = bytes(open_text(LINES))
    last = content.rindex(b"VECTORS")
    copy = tmp_path / "cut-intrs.vtk"
    for stop in [*np.linspace(0, last - 2, 30).astype(int), last + 30, len(content) - 1]:
        copy.write_bytes(content[:stop])
        try:
            frame = frame_of(FORMATS["yade-vtk"], SPHERES, contacts=copy)
        except InputError:
            continue
        # A cut right between two arrays is a file with one array less.
        assert (
            content[:stop].rstrip().endswith(content[: content.index(b"\nVECTORS")].rstrip()[-20:])
        )
        assert not frame.contacts.has("fsx")
