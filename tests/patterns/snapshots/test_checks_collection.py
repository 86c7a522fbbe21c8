"""No false alarm on a collection of DEM snapshots, and every fault in it noticed.

Set GRAINLOOPS_DEM to the folder and run with -m slow.
"""

import csv
import dataclasses
import functools
import itertools
import os
import re
from pathlib import Path

import numpy as np
import pytest

from loops import InputError
from patterns import read_frames, read_snapshot, snapshot_from_tables
from patterns.snapshots.slip_check import check_kt
from tests.patterns import snapshot_faults as faults
from tests.patterns.snapshots.test_checks import (
    CASES,
    SOFT,
    lammps,
    liggghts,
    named,
    noticed,
    suspicious,
)

FOLDER = Path(os.environ.get("GRAINLOOPS_DEM") or "none")
SAVES = re.compile(r"\.xml(\.gz)?$")
# A flow: not jammed and out of balance.
FLOWING = {"yade-periodic/grains_13.parquet"}

pytestmark = pytest.mark.collection


def cells_of(folder):
    with open(folder / "macro.csv") as file:
        return {
            int(row["snap"]): [[float(row[f"h_{i}{j}"]) for j in "xy"] for i in "xy"]
            for row in csv.DictReader(file)
            if "h_xx" in row
        }


def collection():
    for folder in sorted(FOLDER.glob("yade-*")):
        if (folder / "macro.csv").exists():
            cells = cells_of(folder)
            for path in sorted(folder.glob("grains_*")):
                number = int(re.findall(r"\d+", path.name)[0])
                if "plain" not in path.name:
                    law = {"law": "hertz"} if "hertz" in folder.name else {}
                    yield path, {"cell": cells.get(number), **law}
        for path in sorted((folder / "native").glob("*")):
            if SAVES.search(path.name):
                yield path, {}
    for path in sorted(FOLDER.glob("lammps/*/dump.atoms*")):
        yield path, SOFT | ({"mu": 0.3} if path.parent.name == "walls" else {})
    for path in sorted((FOLDER / "liggghts").glob("atoms*")):
        yield path, SOFT | {"mu": 0.3}
    for path in sorted((FOLDER / "liggghts/gravity").glob("atoms*")):
        yield path, SOFT


HEALTHY = [pytest.param(*one, id=f"{one[0].parent.name}-{one[0].name}") for one in collection()]


@pytest.mark.parametrize(("path", "options"), HEALTHY)
def test_no_false_alarm(path, options):
    for snapshot in read_frames(path, **options):
        wanted = {"balance", "jammed"} if f"{path.parent.name}/{path.name}" in FLOWING else set()
        # The dumps have no contacts with the planes that hold the grains.
        wanted |= {"walls"} if path.parent.name == "gravity" else set()
        assert suspicious(snapshot) == wanted


FORCES = ("fx_on_2", "fy_on_2")


def scaled(columns, factor):
    def change(tables, snapshot, rng):
        for name in columns:
            tables["contacts"][name] = factor * np.asarray(tables["contacts"][name])

    return change


def other_radius(factor):
    def change(tables, snapshot, rng):
        degree = np.bincount(snapshot.graph.contacts.ravel(), minlength=len(snapshot.ids))
        radii = np.array(tables["grains"]["radius"])
        radii[rng.choice(np.flatnonzero(degree >= 2))] *= factor
        tables["grains"]["radius"] = radii

    return change


def lost(share, across_border=False):
    """A contact of the weakest ones; None where there is no border."""

    def change(tables, snapshot, rng):
        graph = snapshot.graph
        N = graph.normal_force
        weak = (N > 0) & (N < np.quantile(N[N > 0], share))
        if across_border:
            if graph.images is None:
                return False
            weak &= graph.images.any(axis=1)
        row = rng.choice(np.flatnonzero(weak))
        tables["contacts"] = {n: np.delete(v, row, axis=0) for n, v in tables["contacts"].items()}

    return change


def no_walls(tables, snapshot, rng):
    if tables["walls"] is None:
        return False
    tables["walls"] = None


# Check that tells it, what is changed, and how often in each state.
ONE_SNAPSHOT = {
    "forces x 0.985": ("stiffness", scaled(FORCES, 0.985), 1),
    "forces x 0.9": ("stiffness", scaled(FORCES, 0.9), 1),
    "kn, ks x 1.05": ("stiffness", scaled(("kn", "ks"), 1.05), 1),
    "radius x 1.01": ("radius", other_radius(1.01), 3),
    "radius x 0.99": ("radius", other_radius(0.99), 3),
    "radius x 1.0005": ("radius", other_radius(1.0005), 3),
    "weak contact lost": ("lost", lost(0.1), 3),
    "image lost": ("lost", lost(0.3, across_border=True), 2),
    "no walls": ("walls", no_walls, 1),
}


@functools.cache
def mechanical():
    """States with a law, by name: once as read, once more for each fault from its tables."""
    return [
        (f"{path.parent.name}/{path.name}", snapshot)
        for path, options in collection()
        for snapshot in read_frames(path, **options)
        if snapshot.law is not None
    ]


@pytest.mark.parametrize("fault", ONE_SNAPSHOT)
def test_faults_of_one_snapshot_are_found(fault):
    """All of them, and all lost contacts but one that moves; too few digits are said."""
    check, change, times = ONE_SNAPSHOT[fault]
    rng = np.random.default_rng(1)
    tried, missed = 0, []
    for name, snapshot in mechanical():
        said = next(one.says for one in snapshot.findings if one.check == "unseen")
        for _ in range(0 if "overlap open" in said else times):
            tables = snapshot.tables()
            if change(tables, snapshot, rng) is False:
                continue
            tried += 1
            other = snapshot_from_tables(**tables, strict=False)
            if check not in suspicious(other) - suspicious(snapshot):
                missed.append(name)
    print(f"{fault}: {tried - len(missed)} of {tried}, missed {missed}")
    assert tried >= 15 and len(missed) <= (1 if check == "lost" else 0)


def tables(folder, ending, name):
    path = FOLDER / folder / name
    cell = cells_of(path.parent).get(int(re.findall(r"\d+", name)[0]))
    return faults.Tables(ending, path, **({} if cell is None else {"cell": cell}))


# Contacts of the relaxed states of these runs share no |T|/N; a kt of the order of kn may be right.
AT_REST = {
    ("lammps", faults.much_friction),
    ("liggghts", faults.much_friction),
}
PLAIN = ("grains", "contacts")
DECKS = {
    "csv": lambda: tables("yade-small", "csv", "grains_08.csv.gz"),
    "parquet": lambda: tables("yade-medium", "parquet", "grains_05.parquet"),
    "npz": lambda: tables("yade-slow", "npz", "grains_10.parquet"),
    "h5": lambda: tables("yade-periodic", "h5", "grains_06.parquet"),
    "lammps": lambda: lammps(
        FOLDER / "lammps/periodic/dump.atoms.40000", FOLDER / "lammps/periodic/dump.contacts.40000"
    ),
    "liggghts": lambda: liggghts_of("liggghts", "40000"),
    "yade-xml": lambda: faults.Save(FOLDER / "yade-small/native/state_08.xml.gz"),
}


def liggghts_of(folder, step):
    """The dump has 25 columns: forces in all, and their parts."""
    deck = liggghts(*(FOLDER / folder / f"{what}.{step}.dump" for what in ("atoms", "contacts")))
    parts = {"fnx": "c_cpgl[13]", "fny": "c_cpgl[14]", "ftx": "c_cpgl[16]", "fty": "c_cpgl[17]"}
    for key in list(deck.fields):
        for name, column in parts.items():
            if key[1] == column:
                deck.fields = {
                    (k[0], name) if k == key else k: values for k, values in deck.fields.items()
                }
    deck.roles = {
        "force": ("fx", "fy", *parts),
        "xy": (("fx", "fy"), ("fnx", "fny"), ("ftx", "fty")),
    }
    return deck


@pytest.mark.parametrize(
    ("name", "fault"), named([case for case in CASES if case[0] in DECKS and case not in AT_REST])
)
def test_fault_is_noticed(name, fault, tmp_path):
    assert noticed(DECKS[name], fault, tmp_path)


@pytest.mark.parametrize("snapshot", [2, 10, 20])
def test_tables_of_neighbouring_snapshots(snapshot):
    """Contacts 2e-5 of strain after the grains: refused, or told by the directions."""
    folder = FOLDER / "yade-slow"
    files = [folder / f"{what}_{snapshot + k:02d}.parquet" for k, what in enumerate(PLAIN)]
    try:
        one = read_snapshot(*files, cell=cells_of(folder)[snapshot], strict=False)
    except InputError as error:
        assert "from the centres" in str(error)
    else:
        assert "same_snapshot" in suspicious(one)


@pytest.mark.parametrize(
    ("folder", "least"), [("small", 9), ("medium", 2), ("periodic", 5), ("slow", 35)]
)
def test_kt_of_a_series(folder, least):
    """No false alarm between neighbours; kt twice as large is found wherever kt is."""
    paths = [one for one in collection() if one[0].parent.name == f"yade-{folder}"]
    read = [read_snapshot(path, **options) for path, options in paths]
    found = 0
    for before, after in itertools.pairwise(read):
        one = check_kt(before, after)
        assert one.severity == "ok"
        twice = dataclasses.replace(before.law, kt=2 * before.law.kt)
        other = check_kt(dataclasses.replace(before, law=twice), after)
        assert (other.severity == "doubt") == one.says.endswith("(median)")
        found += other.severity == "doubt"
    assert found >= least
