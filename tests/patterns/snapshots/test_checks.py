"""Every fault in every format is noticed; healthy snapshots raise no alarm.

A fault counts as noticed where reading refuses it or a check that speaks of it finds it.
"""

import functools
import tempfile
from pathlib import Path

import numpy as np
import pytest

from loops import InputError
from patterns import read_snapshot, sample_cell, sample_path
from patterns.snapshots.checks import rounding
from patterns.snapshots.snapshot import SAMPLE
from tests.patterns import snapshot_faults as faults
from tests.patterns.dump_writers import Packing, write_lammps, write_liggghts
from tests.patterns.snapshots.yade_samples import BOX, LAW

BOX_LAW = {"kn": LAW.kn, "kt": LAW.kt, "mu": LAW.mu}
SOFT = {"kn": 1e6, "kt": 5e5, "mu": 0.5}
PAIR_NAMES = ("dist", "dx", "dy", "force", "fx", "fy", "p1", "p2", "p4")
LAMMPS_COLUMNS = ("patom1", "patom2", *PAIR_NAMES)
LAMMPS_NAMES = {"c_prop[1]": "id1", "c_prop[2]": "id2"} | {
    f"c_pair[{k}]": name for k, name in enumerate(PAIR_NAMES, start=1)
}
LIGGGHTS_NAMES = {
    f"c_cpgl[{k}]": name for k, name in ((7, "id1"), (8, "id2"), (10, "fx"), (11, "fy"))
}


def lammps(grains, contacts):
    roles = {"force": ("force", "fx", "fy", "p1", "p2"), "xy": (("fx", "fy"), ("p1", "p2"))}
    roles |= {"shear": ("p1", "p2"), "again": "p4"}
    return faults.Dumps(roles, LAMMPS_NAMES, grains, contacts, **SOFT)


def liggghts(grains, contacts, mu=0.3):
    roles = {"force": ("fx", "fy"), "xy": (("fx", "fy"),)}
    return faults.Dumps(roles, LIGGGHTS_NAMES, grains, contacts, **SOFT | {"mu": mu})


DECKS = {
    ending: lambda ending=ending: faults.Tables(ending, sample_path())
    for ending in ("csv", "parquet", "npz", "h5")
} | {
    "lammps": lambda: lammps(
        SAMPLE / "lammps/dump.atoms.0.gz", SAMPLE / "lammps/dump.contacts.0.gz"
    ),
    "liggghts": lambda: liggghts(
        SAMPLE / "liggghts/atoms.0.dump.gz", SAMPLE / "liggghts/contacts.0.dump.gz"
    ),
    "mercury": lambda: faults.Mercury(
        SAMPLE / "mercury/box.data.gz", SAMPLE / "mercury/box.fstat.gz", **BOX_LAW
    ),
    "yade-xml": lambda: faults.Save(BOX / "state.xml.gz"),
    "yade-exporter": lambda: faults.Legacy(
        BOX / "exporter-spheres-00000000.vtk", BOX / "exporter-intrs-00000000.vtk.gz", mu=0.5
    ),
}
# Columns that a format has not got: VTKExporter has no flags, ...
NO_COLUMN = {"stiff_contact", "rough_half", "no_flags", "other_shear", "other_normals"}
ROUGH = {"much_friction"}  # can't be told where no contacts share one |T|/N
NOT = {
    "yade-exporter": NO_COLUMN | {"turn_fn", "repeat", "large_radii"},
    "yade-xml": {"turn_fn", "no_flags", "other_shear", "other_normals", "repeat"},
    "lammps": (NO_COLUMN - {"other_shear"}) | {"turn_fn", "turn_shear"},
    "liggghts": NO_COLUMN | {"turn_fn", "turn_shear", "turn_one_shear"},
    "mercury": NO_COLUMN,
}
# Contacts of the sample of these formats that slide: too few or none.
AT_REST = {"yade-xml": ROUGH | {"rough_half"}} | {
    name: ROUGH for name in ("yade-exporter", "lammps", "liggghts", "mercury")
}
CASES = [
    (name, fault)
    for name in DECKS
    for fault in faults.FAULTS
    if fault.__name__ not in NOT.get(name, ())
]


@functools.cache
def sheared(code):
    """Dumps of a sheared sample, in which contacts slide."""
    snapshot = read_snapshot(sample_path("grains_periodic.parquet"), cell=sample_cell())
    folder = Path(tempfile.mkdtemp())
    packing = Packing.of(snapshot)
    if code == "lammps":
        return write_lammps(folder, packing, keep=["index", *LAMMPS_COLUMNS])
    return write_liggghts(folder, packing, ("pos", "id", "force", "delta"), box_digits=17)


SHEARED = {
    "sheared-lammps": lambda: lammps(*sheared("lammps")),
    "sheared-liggghts": lambda: liggghts(*sheared("liggghts"), mu=0.5),
}
SHEARED_CASES = [(name, faults.much_friction) for name in SHEARED]


def named(cases):
    return [pytest.param(*case, id=f"{case[0]}-{case[1].__name__}") for case in cases]


def suspicious(snapshot):
    return {found.check for found in snapshot.findings if found.severity != "ok"}


@functools.cache
def healthy_of(make):
    with tempfile.TemporaryDirectory() as folder:
        deck = make()
        return read_snapshot(deck.write(Path(folder)), **deck.options)


def noticed(make, fault, folder):
    """Whether reading refuses the spoilt snapshot, a check tells it, or it was healed.

    `make` returns the snapshot's files, unspoilt. Columns that a reader tells by what they hold
    heal: then the snapshot is the healthy one.
    """
    healthy, deck = healthy_of(make), make()
    assert healthy.mechanical and not suspicious(healthy), healthy.notes
    fault(deck)
    path = deck.write(folder)
    try:
        spoilt = read_snapshot(path, strict=False, **deck.options)
    except InputError:
        return True
    if faults.FAULTS[fault] & suspicious(spoilt) or not spoilt.mechanical:
        return True
    same = [
        np.array_equal(getattr(healthy.graph, name), getattr(spoilt.graph, name))
        for name in ("x", "radii", "normal_force")
    ]
    # With grains exchanged a shear force keeps its sign: both directions turn.
    same.append(np.allclose(healthy.graph.shear_force, spoilt.graph.shear_force))
    return fault in faults.HEALED and all(same)


@pytest.mark.parametrize(
    ("name", "fault"),
    named([case for case in CASES if case[1].__name__ not in AT_REST.get(case[0], ())]),
)
def test_fault_is_noticed(name, fault, tmp_path):
    if name == "h5":
        pytest.importorskip("h5py")
    assert noticed(DECKS[name], fault, tmp_path)


@pytest.mark.parametrize(("name", "fault"), named(SHEARED_CASES))
def test_fault_of_a_sheared_sample_is_noticed(name, fault, tmp_path):
    assert noticed(SHEARED[name], fault, tmp_path)


@pytest.mark.parametrize("name", ["directions", "balance", "distances"])
def test_snapshots_without_meaningful_results_are_refused(name, tmp_path):
    fault = {
        "directions": faults.flip,
        "balance": faults.turn_shear,
        "distances": faults.diameters,
    }[name]
    deck = DECKS["csv"]()
    for column in ("branch_x", "branch_y"):
        del deck.fields["contacts", column]
    fault(deck)
    path = deck.write(tmp_path)
    with pytest.raises(InputError) as caught:
        read_snapshot(path)
    found = {one.check: one for one in read_snapshot(path, strict=False).findings}[name]
    assert found.severity == "error" and found.says in str(caught.value)
    assert f"{found.number:.2g}" in found.says or f"{found.number:.4g}" in found.says


def test_doubts_are_notes(tmp_path):
    deck = DECKS["csv"]()
    faults.other_units(deck)
    notes = read_snapshot(deck.write(tmp_path)).notes
    (note,) = [note for note in notes if "times kn times the overlap" in note]
    assert note.startswith("N is 1e+04 times") and "units differ by 10^4" in note


def test_tables_of_two_close_snapshots(tmp_path):
    """Contacts 2e-5 of strain after the grains: their normals have 15 digits and tell."""
    folder = Path(__file__).parent / "samples"
    one, two = (folder / f"contacts_slow_0{k}.csv.gz" for k in (2, 3))
    grains = folder / "grains_slow_02.csv.gz"
    assert "same_snapshot" not in suspicious(read_snapshot(grains, one))
    assert "same_snapshot" in suspicious(read_snapshot(grains, two))


@pytest.mark.parametrize(
    ("groups", "noticed_as"),
    [
        ("f_x f_z f_y", "refused"),
        ("f_y f_x f_z", "refused"),
        ("t_x t_y t_z n_x n_y n_z", "healed"),
        ("n_x n_y n_z t_x t_y t_z", "right"),
        ("n_x n_z n_y t_x t_z t_y", "refused"),
    ],
)
def test_exchanged_columns_of_liggghts(groups, noticed_as, tmp_path):
    """The total force or its parts, in other orders than LIGGGHTS writes them."""
    healthy = read_snapshot(SAMPLE / "liggghts/atoms.0.dump.gz", **SOFT)
    deck = DECKS["liggghts"]()
    own = {k: v for (f, k), v in deck.fields.items() if f == "contacts"}
    f = {"x": own.pop("fx"), "y": own.pop("fy")}
    f["z"] = own.pop("c_cpgl[12]")
    i, j = (np.searchsorted(np.sort(deck["id"]), own[name]) for name in ("id1", "id2"))
    x = np.column_stack([deck["x"], deck["y"]])[np.argsort(deck["id"])]
    d = x[j] - x[i]
    d -= np.rint(d @ np.linalg.inv(healthy.graph.cell).T) @ healthy.graph.cell.T
    n = d / np.hypot(*d.T)[:, None]
    along = np.einsum("ck,ck->c", n, np.column_stack([f["x"], f["y"]]))
    parts = {"f": f, "n": {"x": along * n[:, 0], "y": along * n[:, 1], "z": 0 * along}}
    parts["t"] = {axis: f[axis] - parts["n"][axis] for axis in "xyz"}
    columns = [*list(own.values())[:9], *(parts[word[0]][word[2]] for word in groups.split())]
    names = [f"c_cpgl[{k + 1}]" for k in range(len(columns))]
    name, head = deck.raw["contacts"]
    deck.raw["contacts"] = name, [*head[:8], "ITEM: ENTRIES " + " ".join(names)]
    deck.fields = {key: v for key, v in deck.fields.items() if key[0] == "grains"}
    deck.fields |= {("contacts", k): v for k, v in zip(names, columns, strict=True)}
    path = deck.write(tmp_path)
    if noticed_as == "refused":
        with pytest.raises(InputError):
            read_snapshot(path, **SOFT)
    else:
        graph = read_snapshot(path, **SOFT).graph
        scale = healthy.graph.normal_force.mean()
        assert np.abs(graph.normal_force - healthy.graph.normal_force).max() < 1e-4 * scale
        assert np.abs(graph.shear_force - healthy.graph.shear_force).max() < 1e-4 * scale


HEALTHY = [
    (sample_path(), {}),
    (sample_path("grains_periodic.parquet"), {"cell": sample_cell()}),
    (SAMPLE / "yade_native/periodic/state.xml.gz", {}),
    (BOX / "grains_00.csv.gz", {}),
]


@pytest.mark.parametrize(("path", "options"), HEALTHY)
def test_no_alarm_on_samples(path, options):
    assert not suspicious(read_snapshot(path, **options))


@pytest.mark.parametrize("magnitude", [1.0, 1e-3, 1e6])
def test_rounding_of_numbers_is_found(magnitude):
    values = magnitude * np.random.default_rng(0).random(500)
    assert rounding(values) < 2e-15 * magnitude
    assert rounding(values.astype(np.float32).astype(float)) == pytest.approx(
        values.max() * 2.0**-24, rel=0.1
    )
    text = np.array([float(f"{v:.6g}") for v in values])
    assert 0.4e-5 * magnitude < rounding(text) < 0.6e-5 * magnitude
