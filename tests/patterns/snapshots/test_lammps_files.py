"""Dumps that are damaged, mixed or mapped wrongly: one line that says what and where."""

import gzip
import re

import numpy as np
import pytest

from loops import InputError
from patterns import read_frames, synthetic_network
from patterns.snapshots.columns import names_beside
from patterns.snapshots.dump_files import dump_frames
from patterns.snapshots.files import beside
from tests.patterns.dump_writers import (
    LAW,
    Packing,
    edit,
    lammps_columns,
    snapshots_of,
    write_lammps,
)


@pytest.fixture
def dumps(tmp_path):
    """Two frames, steps 0 and 500."""
    for step in (0, 500):
        graph = synthetic_network(60, seed=step, periodic=True, jitter=0.1)
        path, contacts = write_lammps(tmp_path, Packing(graph, np.arange(60)), step)
    return path, contacts


def read(path, **how):
    return snapshots_of(path, format="lammps", **how)


def drop_radius(rows):
    for k, row in enumerate(rows):
        if row.startswith("ITEM: ATOMS"):
            rows[k] = row.replace("radius", "c_size")


def body_of(rows, frame=0):
    """Line of the first row of a frame."""
    return [k for k, row in enumerate(rows) if row.startswith(("ITEM: ATOMS", "ITEM: ENTR"))][
        frame
    ] + 1


BAD = {
    "a missing row": ("atoms", lambda r: r.pop(20), "step 0: got 59 rows, expected 60"),
    "a row too many": ("contacts", lambda r: r.insert(20, r[20]), r"step 0: got \d+ rows"),
    "cut in a frame": ("contacts", lambda r: r.__delitem__(slice(-7, None)), "step 500.*rows"),
    "cut in a header": ("atoms", lambda r: r.__delitem__(slice(74, None)), "header that breaks"),
    "a row cut short": ("atoms", lambda r: r.__setitem__(20, "7 1 0.5"), "step 0.*no table"),
    "a word": (
        "contacts",
        lambda r: r.__setitem__(20, r[20].replace(r[20].split()[4], "oops")),
        "step 0.*oops",
    ),
    "not a number": (
        "atoms",
        lambda r: r.__setitem__(20, r[20].replace(r[20].split()[2], "nan")),
        r"column 'x' of .*step 0, row 11.*finite",
    ),
    "fewer names than columns": (
        "atoms",
        lambda r: r.__setitem__(8, "ITEM: ATOMS id type x y radius"),
        "a line of 6 numbers, expected 5",
    ),
    "no radius": ("atoms", drop_radius, "no column for the radius.*--columns radius=COLUMN"),
    "a step of another run": (
        "contacts",
        lambda r: r.__setitem__(1, "100"),
        "steps 100, 500, expected step 0 of",
    ),
    "a step twice": ("atoms", lambda r: r.__setitem__(70, "0"), "step 0 twice"),
    "another box": ("contacts", lambda r: r.__setitem__(5, "0 9"), "contacts, step 0: got box"),
    "a box of words": ("atoms", lambda r: r.__setitem__(5, "0 x"), "three lines of bounds"),
    "a box turned round": ("atoms", lambda r: r.__setitem__(5, "9 0"), "bounds, low and high"),
    "a radius of zero": (
        "atoms",
        lambda r: r.__setitem__(9, " ".join([*r[9].split()[:5], "0", ""])),
        "radius of grain 0 in .*step 0: got 0.0",
    ),
    "a grain far away": (
        "atoms",
        lambda r: r.__setitem__(9, " ".join(["0 1 1e100", *r[9].split()[3:], ""])),
        "periodic cells apart",
    ),
    "a step of words": ("atoms", lambda r: r.__setitem__(1, "zero"), "header that breaks off"),
    "text between frames": ("atoms", lambda r: r.insert(0, "hello"), "expected ITEM: TIMESTEP"),
    "an unknown grain": (
        "atoms",
        lambda r: r.__setitem__(9, re.sub(r"^\d+", "777", r[9])),
        r"column 'c_prop\[\d\]' of .*step 0, row \d+: got grain \d+, expected an id",
    ),
    "an id twice": ("atoms", lambda r: r.__setitem__(10, r[9]), "id 0 2 times"),
    "a third dimension": (
        "atoms",
        lambda r: r.__setitem__(9, " ".join([*r[9].split()[:4], "3.0", r[9].split()[5]])),
        r"no table|a line of|two dimensions",
    ),
    "no rows, which the header denies": (
        "contacts",
        lambda r: r.__delitem__(slice(9, body_of(r, 1) - 9)),
        "step 0: got 0 rows, expected",
    ),
    "rows that the header denies": (
        "contacts",
        lambda r: r.__setitem__(3, "0"),
        r"step 0: got \d+ rows, expected at least one",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_dumps(dumps, case):
    which, change, message = BAD[case]
    edit(dumps[which == "contacts"], change)
    with pytest.raises(InputError, match=message) as error:
        read(dumps[0])
    assert "\n" not in str(error.value)


def test_bytes_that_are_no_text_are_named(dumps):
    rows = dumps[1].read_bytes().split(b"\n")
    words = rows[20].split()
    words[4] = b"\xff" + words[4][1:]
    rows[20] = b" ".join(words)
    dumps[1].write_bytes(b"\n".join(rows))
    with pytest.raises(InputError, match=r"row 11: got .*xff.*expected a number"):
        read(dumps[0])


def test_a_number_cut_short_is_not_read(dumps):
    dumps[1].write_text(dumps[1].read_text().rstrip()[:-3])
    with pytest.raises(InputError, match=r"step 500.*a last line without its end"):
        read(dumps[0])


def test_frames_before_the_fault_are_read(dumps):
    edit(dumps[1], lambda rows: rows.pop(-2))
    found = read_frames(dumps[0], **LAW)
    assert next(found).step == 0
    with pytest.raises(InputError, match="step 500"):
        next(found)


def test_three_dimensions_are_refused(tmp_path):
    graph = synthetic_network(60, periodic=True, jitter=0.1)
    path, _ = write_lammps(tmp_path, Packing(graph, np.arange(60)))
    text = path.read_text().splitlines()
    text[9:] = [re.sub(r" 0 (\S+ )$", rf" {k / 7} \1", row) for k, row in enumerate(text[9:])]
    path.write_text("\n".join(text) + "\n")
    with pytest.raises(InputError, match="two dimensions"):
        read(path)


NAMES = list(lammps_columns(Packing(synthetic_network(9, periodic=True), np.arange(9))))
COLUMN = {name: f"c_pair[{k + 1}]" for k, name in enumerate(NAMES[3:])}
WRONG = {
    "shear for the normal force": (("fx", "fy"), ("p1", "p2"), "off the branches of the grains"),
    "normal for the shear force": (("p1", "p2"), ("fx", "fy"), "off the branches of the grains"),
    "force for the distance": (("dx", "dy"), ("fx", "fy"), "off the branches of the grains"),
    "axes exchanged": (("dx", "dy"), ("dy", "dx"), "off the branches of the grains"),
    "another size": (("force",), ("p4",), "other sizes than those of the vectors"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_column_map_is_refused(dumps, case):
    names, taken, message = WRONG[case]
    columns = {name: COLUMN[column] for name, column in zip(names, taken, strict=True)}
    with pytest.raises(InputError, match=message):
        read(dumps[0], columns=columns)


def test_maps_that_name_nothing(dumps):
    for columns, message in (
        ({"fx": "c_pear[1]"}, r"--columns fx=c_pear\[1\]: got no such column"),
        ({"radius": "r"}, r"--columns radius=r: got no such column"),
        ({"fz": "c_pair[7]"}, "the name 'fz', expected one of id, x, y"),
        ({"id1": "c_pair[1]"}, "no ids of two grains that touch with id1"),
        ({"id1": "c_prop[1]", "id2": "c_prop[1]"}, "no ids of two grains that touch"),
    ):
        with pytest.raises(InputError, match=message):
            read(dumps[0], columns=columns)


def test_files_of_another_kind(dumps, tmp_path):
    lone = tmp_path / "dump.simple"
    lone.write_bytes(dumps[0].read_bytes())
    with pytest.raises(InputError, match=r"no dump of contacts beside it.*--contacts"):
        read(lone)
    assert len(read(lone, contacts=dumps[1])) == 2
    with pytest.raises(InputError, match="a dump of ENTRIES, expected the dump of atoms"):
        read(dumps[1], contacts=dumps[1])
    with pytest.raises(InputError, match="a dump of ATOMS, expected the dump of contacts"):
        read(dumps[0], contacts=dumps[0])
    with pytest.raises(InputError, match="no such file"):
        read(dumps[0], contacts=tmp_path / "nothing")


def test_contacts_are_found_beside(tmp_path):
    for atoms, contacts in (
        ("dump.atoms.0", "dump.contacts.0"),
        ("atoms.5.dump.gz", "contacts.5.dump"),
        ("a.atom.7", "a.local.7.gz"),
    ):
        (tmp_path / contacts).write_text("x")
        names = names_beside(tmp_path / atoms, "contacts")
        assert beside(tmp_path / atoms, *names) == tmp_path / contacts
    assert names_beside(tmp_path / "dump.lammpstrj", "contacts") == []


def test_boxes(tmp_path):
    """Bounds of the corners, as LAMMPS documents them, and the edges that made them."""
    path = tmp_path / "dump"
    body = "ITEM: ATOMS id x y\n1 0.5 0.5\n"
    start = "ITEM: TIMESTEP\n7\nITEM: NUMBER OF ATOMS\n1\nITEM: BOX BOUNDS "
    low, lx, ly, xy, xz, yz = np.array([1.0, 2.0]), 4.0, 3.0, -1.5, 0.25, -0.5
    bounds = (
        f"{low[0] + min(0, xy, xz, xy + xz)} {low[0] + lx + max(0, xy, xz, xy + xz)} {xy}\n"
        f"{low[1] + min(0, yz)} {low[1] + ly + max(0, yz)} {xz}\n0 1 {yz}\n"
    )
    for text, cell, periodic, digits in (
        ("pp pp ff\n1 5\n2 5\n0 1\n", [[4, 0], [0, 3]], (True, True), 1),
        ("fs pp pp\n1 5.000001\n2 5\n0 1\n", [[4.000001, 0], [0, 3]], (False, True), 7),
        ("\n1 5\n2 5\n0 1.25e-10\n", [[4, 0], [0, 3]], (False, False), 3),
        (f"xy xz yz pp pp pp\n{bounds}", [[lx, xy], [0, ly]], (True, True), 3),
    ):
        path.write_text(start + text + body)
        (frame,) = dump_frames(path)
        found, repeated = frame.box.plane([0, 1])
        assert found == pytest.approx(np.array(cell), abs=1e-12)
        assert frame.box.origin[:2] == pytest.approx(low, abs=1e-12)
        assert (repeated, frame.box.digits, frame.step) == (periodic, digits, 7)
        assert frame.read(["y", "id"]).columns("id", "y").tolist() == [[1, 0.5]]


def test_a_damaged_gzip_file(dumps):
    content = gzip.compress(dumps[0].read_bytes())
    zipped = dumps[0].with_name("dump.atoms.gz")
    for damaged in (content[: len(content) // 2], content[:40] + b"\x00" * 20 + content[60:]):
        zipped.write_bytes(damaged)
        with pytest.raises(InputError, match="unreadable or truncated"):
            read(zipped, contacts=dumps[1])


def test_snapshots_without_contacts_are_left_out(dumps):
    def empty(rows):
        rows[3] = "0"
        del rows[9 : body_of(rows, 1) - 9]

    edit(dumps[1], empty)
    (found,) = read(dumps[0])
    assert found.step == 500 and "1 earlier snapshots without contacts" in " ".join(found.notes)
    edit(dumps[1], lambda rows: (rows.__setitem__(12, "0"), rows.__delitem__(slice(18, None))))
    with pytest.raises(InputError, match="no contacts in any snapshot"):
        read(dumps[0])
