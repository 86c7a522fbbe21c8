"""Damaged dumps and MercuryDPM files: an `InputError` or a snapshot, never another error."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from loops import InputError
from patterns.snapshots.build import build_snapshot
from patterns.snapshots.formats import FORMATS
from patterns.snapshots.frame import Source
from patterns.snapshots.laws import Parameters
from patterns.synthetic import synthetic_network
from tests.patterns.dump_writers import Packing, write_lammps, write_liggghts, write_mercury

CELL = synthetic_network(30, periodic=True).cell
LONG = ("pos", "id", "force", "force_normal", "force_tangential", "delta")


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Reader and the two files of one packing for each code."""
    own = Packing(synthetic_network(30, periodic=True, jitter=0.1), np.arange(30))
    folders = [tmp_path_factory.mktemp(name) for name in ("lammps", "liggghts", "mercury")]
    paths = (
        write_lammps(folders[0], own),
        write_liggghts(folders[1], own, LONG),
        write_mercury(folders[2], own),
    )
    return [
        (reader, files, [file.read_bytes() for file in files])
        for reader, files in zip(
            map(FORMATS.get, ("lammps", "liggghts", "mercury")), paths, strict=True
        )
    ]


@settings(max_examples=80, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    code=st.integers(0, 2),
    which=st.integers(0, 1),
    place=st.floats(0, 1, exclude_max=True),
    length=st.integers(0, 120),
    put=st.one_of(st.binary(max_size=8), st.sampled_from([b"\n", b" ", b"-", b"1e400", b"nan"])),
)
def test_any_damage(written, code, which, place, length, put):
    reader, files, contents = written[code]
    content = contents[which]
    at = int(place * len(content))
    files[which].write_bytes(content[:at] + put + content[at + length :])
    try:
        for read in reader.frames(
            Source(files[0], cell=CELL if reader is FORMATS["mercury"] else None)
        ):
            reader.recognises(files[0], content[:4096])
            build_snapshot(read(), Parameters(1.0, 0.5, 0.5))
    except InputError as error:
        assert "\n" not in str(error)
    finally:
        files[which].write_bytes(content)
