"""Files of many snapshots, of LAMMPS, LIGGGHTS and MercuryDPM: the one asked for is read alone."""

import gzip
import re
import sys

import numpy as np
import pytest

from loops import GrainGraph, InputError
from patterns import count_frames, read_snapshot, synthetic_network
from tests.patterns.dump_writers import (
    Packing,
    assert_same,
    write_lammps,
    write_liggghts,
    write_mercury,
)

LAW = {"kn": 1.0, "kt": 0.5, "mu": 0.5}
COUNT = 4
CELL = synthetic_network(50, periodic=True).cell


def packing(number):
    """Grains that move from one snapshot to the next, in one cell."""
    graph = synthetic_network(50, seed=number, periodic=True, jitter=0.1)
    graph = GrainGraph(
        x=np.linalg.solve(graph.cell, graph.x.T).T @ CELL.T, radii=graph.radii,
        contacts=graph.contacts, images=graph.images, cell=CELL,
        normal_force=graph.normal_force, shear_force=graph.shear_force,
    )  # fmt: skip
    return Packing(graph, np.arange(50))


PACKINGS = [packing(number) for number in range(COUNT)]


def gathered(paths):
    """Dumps of one step each behind those of the steps before, in `atoms.dump`, `contacts.dump`."""
    together = [path.with_name(path.name.split(".")[0] + ".dump") for path in paths]
    for path, whole in zip(paths, together, strict=True):
        with open(whole, "a") as file:
            file.write(path.read_text())
    return together


def write_each(code, folder):
    for step, own in enumerate(PACKINGS):
        if code == "lammps":
            paths = write_lammps(folder, own, step)
        elif code == "liggghts":
            groups = ("pos", "id", "force", "delta")
            paths = gathered(write_liggghts(folder, own, groups, step, box_digits=17))
        else:
            paths = write_mercury(folder, own, float(step))
    return paths


@pytest.fixture(params=["lammps", "liggghts", "mercury"])
def dumps(request, tmp_path):
    """Paths of a file of four snapshots, steps 0 to 3, and of its contacts."""
    return write_each(request.param, tmp_path)


@pytest.fixture
def parsed(monkeypatch):
    """The places whose rows are parsed."""
    places = []
    own = sys.modules["patterns.snapshots.frame"].read_body

    def spy(where, *rest):
        places.append(where)
        return own(where, *rest)

    monkeypatch.setattr("patterns.snapshots.frame.read_body", spy)
    return places


def read(path, frame):
    return read_snapshot(path, cell=CELL, frame=frame, **LAW)


def test_counting_parses_nothing(dumps, parsed):
    assert count_frames(dumps[0]) == COUNT
    assert parsed == []


@pytest.mark.parametrize("frame", [0, 2, -1, -COUNT])
def test_one_snapshot_is_parsed_alone(dumps, parsed, frame):
    snapshot = read(dumps[0], frame)
    step = frame % COUNT
    assert snapshot.step == step
    assert {re.sub(r".*(step|time) ", "", place) for place in parsed} == {str(step)}
    # Atoms and contacts once each; LAMMPS' walls may be columns of the atoms.
    assert {place.split(",")[0] for place in parsed} == {str(path) for path in dumps}
    assert len(parsed) == 2


def test_numbers_out_of_range(dumps, parsed):
    for frame in (COUNT, -COUNT - 1):
        with pytest.raises(InputError, match=f"--frame.*{frame}.*(below 4|-4 or more)"):
            read(dumps[0], frame)
    with pytest.raises(InputError, match=r"4 snapshots, expected one.*--frame 0"):
        read(dumps[0], None)
    assert parsed == []


def test_gzip(dumps, parsed):
    for path in dumps:
        path.with_name(f"{path.name}.gz").write_bytes(gzip.compress(path.read_bytes()))
        path.unlink()
    zipped = dumps[0].with_name(f"{dumps[0].name}.gz")
    assert count_frames(zipped) == COUNT
    assert_same(read(zipped, 2), PACKINGS[2], 1e-12)
    assert len(parsed) == 2


@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.99])
def test_last_snapshot_cut_short(dumps, which, share):
    """From within its header to within its last number: the others are read, it is refused."""
    text = dumps[which].read_text()
    start = [match.start() for match in re.finditer(START[dumps[0].name, which], text)][-1]
    rest = text[start:]
    dumps[which].write_text(text[:start] + rest[: max(6, int(share * len(rest)))])
    assert count_frames(dumps[0]) == COUNT
    for number in range(COUNT - 1):
        assert_same(read(dumps[0], number), PACKINGS[number], 1e-12)
    with pytest.raises(InputError, match=str(dumps[which])) as error:
        read(dumps[0], -1)
    assert "\n" not in str(error.value)


START = {
    **{("dump.atoms", which): "ITEM: TIMESTEP" for which in (0, 1)},
    **{("atoms.dump", which): "ITEM: TIMESTEP" for which in (0, 1)},
    ("box.data", 0): r"(?m)^50 \d 0 0 1 1",
    ("box.data", 1): r"(?m)^# \d 1$",
}


@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.parametrize("old", ["ITEM: BOX BOUNDS", "ITEM: NUMBER OF", "ITEM: TIMESTEP"])
def test_a_damaged_header_among_others(tmp_path, which, old):
    """Dumps name their frames: those after the damaged one are found."""
    dumps = write_each("lammps", tmp_path)
    parts = dumps[which].read_text().split("ITEM: TIMESTEP")
    whole = ["ITEM: TIMESTEP" + part for part in parts[1:]]
    damaged = whole[1].replace(old, "oops")
    if old == "ITEM: TIMESTEP":
        damaged = whole[1].replace("1\n", "one\n", 1)
    elif old == "ITEM: BOX BOUNDS":
        damaged = re.sub(r"(BOX BOUNDS.*\n)\S+", r"\1oops", whole[1])
    dumps[which].write_text("".join([whole[0], damaged, *whole[2:]]))
    assert count_frames(dumps[0]) == COUNT
    for number in (0, 2, 3):
        assert_same(read(dumps[0], number), PACKINGS[number], 1e-12)
    with pytest.raises(InputError, match=str(dumps[which])):
        read(dumps[0], 1)


def test_snapshots_without_contacts_are_not_counted(tmp_path, parsed):
    dumps = write_each("lammps", tmp_path)
    frames = dumps[1].read_text().split("ITEM: TIMESTEP\n")[1:]
    for number in (0, 2):
        header = re.sub(r"ENTRIES\n\d+", "ENTRIES\n0", frames[number])
        frames[number] = re.sub(r"(ITEM: ENTRIES.*\n)[\s\S]*", r"\1", header)
    dumps[1].write_text("".join("ITEM: TIMESTEP\n" + frame for frame in frames))
    assert count_frames(dumps[0]) == 2
    last = read(dumps[0], 1)
    assert last.step == 3 and len(parsed) == 2
    assert "2 earlier snapshots without contacts left out" in last.notes
    assert "1 earlier snapshots without contacts left out" in read(dumps[0], 0).notes


def test_mercury_snapshots_without_contacts_are_not_counted(tmp_path, parsed):
    dumps = write_each("mercury", tmp_path)
    frames = re.split(r"(?m)^(?=# \d 1$)", dumps[1].read_text())[1:]
    frames[0] = "".join(frames[0].splitlines(keepends=True)[:3])
    dumps[1].write_text("".join(frames))
    assert count_frames(dumps[0]) == COUNT - 1
    first = read(dumps[0], 0)
    assert first.step == 1 and len(parsed) == 2
    assert "1 earlier snapshots without contacts left out" in first.notes
