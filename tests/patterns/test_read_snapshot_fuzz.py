"""Damaged files: a snapshot or one clear line, whatever the damage."""

import gzip

import numpy as np
import pytest

from loops import InputError
from patterns import Snapshot, read_snapshot
from tests.patterns.test_read_snapshot import write

TOKENS = [b"nan", b"inf", b"-1", b"1e400", b",", b"\n", b'"', b"0", b"9" * 20, b"\xff\xfe", b" "]


def damaged(rng, content):
    """One to five bytes changed, put in, taken out or cut off, or tokens written over."""
    kind, content = rng.integers(5), bytearray(content)
    for _ in range(rng.integers(1, 6)):
        place = rng.integers(len(content)) if len(content) else 0
        if kind == 0 and len(content):
            content[place] = rng.integers(256)
        elif kind == 1:
            content[place:place] = rng.integers(0, 256, 3).astype(np.uint8).tobytes()
        elif kind == 2:
            del content[place : place + rng.integers(1, 20)]
        elif kind == 3:
            content = content[:place]
        else:
            token = TOKENS[rng.integers(len(TOKENS))]
            content[place : place + len(token)] = token
    return bytes(content)


def read_damaged(folder, ending, count):
    """Outcomes of reading `count` damaged pairs of tables."""
    rng = np.random.default_rng(0)
    grains = write(folder, ending=ending)
    paths = (grains, grains.with_name(f"contacts_1.{ending}"))
    whole = [path.read_bytes() for path in paths]
    outcomes = []
    for number in range(count):
        for path, content in zip(paths, whole, strict=True):
            path.write_bytes(content)
        chosen = number % 2
        content = whole[chosen]
        if ending == "csv.gz" and rng.random() < 0.5:
            content = gzip.compress(damaged(rng, gzip.decompress(content)))
        else:
            content = damaged(rng, content)
        paths[chosen].write_bytes(content)
        try:
            outcomes.append(read_snapshot(grains))
        except InputError as error:
            assert "\n" not in str(error)
            outcomes.append(error)
    return outcomes


@pytest.mark.parametrize("ending", ["csv", "csv.gz", "parquet"])
def test_damaged_files(tmp_path, ending):
    outcomes = read_damaged(tmp_path, ending, 150)
    assert sum(isinstance(outcome, InputError) for outcome in outcomes) > 100
    for outcome in outcomes:
        if isinstance(outcome, Snapshot):
            assert np.isfinite(outcome.graph.x).all()


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["csv", "csv.gz", "parquet"])
def test_many_damaged_files(tmp_path, ending):
    assert len(read_damaged(tmp_path, ending, 5000)) == 5000
