"""Every fault in every format is noticed; healthy snapshots raise no alarm.

A fault counts as noticed where reading refuses it or a check that speaks of it finds it.
"""

import functools
import tempfile
from pathlib import Path

import numpy as np
import pytest

from loops import InputError, contact_forces
from patterns import read_snapshot, sample_cell, sample_path, snapshot_from_tables
from patterns.snapshots.findings import finding, rounding
from tests.patterns import snapshot_faults as faults
from tests.patterns.dump_writers import Packing, write_lammps, write_liggghts
from tests.patterns.snapshots.yade_samples import BOX

# Median of the file's kn, which go with the radii.
BOX_LAW = {"kn": 4.833e5, "kt": 2.416e5, "mu": float(np.tan(0.4636))}
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
        sample_path("lammps/dump.atoms.0.gz"), sample_path("lammps/dump.contacts.0.gz")
    ),
    "liggghts": lambda: liggghts(
        sample_path("liggghts/atoms.0.dump.gz"), sample_path("liggghts/contacts.0.dump.gz")
    ),
    "mercury": lambda: faults.Mercury(
        sample_path("mercury/box.data.gz"), sample_path("mercury/box.fstat.gz"), **BOX_LAW
    ),
    "yade-xml": lambda: faults.Save(BOX / "state.xml.gz"),
}
# Columns that a format has not got.
NO_COLUMN = {"stiff_contact", "rough_half", "no_flags", "other_shear", "other_normals"}
ROUGH = {"much_friction"}  # can't be told where no contacts share one |T|/N
NOT = {
    "yade-xml": {"turn_fn", "no_flags", "other_shear", "other_normals", "repeat"},
    "lammps": (NO_COLUMN - {"other_shear"}) | {"turn_fn", "turn_shear"},
    "liggghts": NO_COLUMN | {"turn_fn", "turn_shear", "turn_one_shear"},
    "mercury": NO_COLUMN,
}
# Contacts of the sample of these formats that slide: too few or none.
AT_REST = {"yade-xml": ROUGH | {"rough_half"}} | {
    name: ROUGH for name in ("lammps", "liggghts", "mercury")
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
    assert note.startswith("doubt: N is 1e+04 times") and "units differ by 10^4" in note


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
    healthy = read_snapshot(sample_path("liggghts/atoms.0.dump.gz"), **SOFT)
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
    (sample_path("yade_native/periodic/state.xml.gz"), {}),
    (BOX / "grains_00.csv.gz", {}),
]


@pytest.mark.parametrize(("path", "options"), HEALTHY)
def test_no_alarm_on_samples(path, options):
    assert not suspicious(read_snapshot(path, **options))


FORCES = ("fx_on_2", "fy_on_2")


def spoilt(snapshot, **columns):
    """Findings on a snapshot's tables with columns, given by table and name, changed."""
    tables = snapshot.tables()
    for name, change in columns.items():
        table = {"radius": "grains"}.get(name, "contacts")
        names = FORCES if name == "force" else [name]
        tables[table] = tables[table] | {n: change(np.array(tables[table][n])) for n in names}
    return snapshot_from_tables(**tables, strict=False)


def found(snapshot, check):
    return next(one for one in snapshot.findings if one.check == check)


@pytest.mark.parametrize(("path", "options"), HEALTHY[:2])
@pytest.mark.parametrize(
    ("column", "factor", "ratio"),
    [("force", 0.985, 0.985), ("force", 0.9, 0.9), ("kn", 1.05, 1 / 1.05)],
)
def test_scales_of_forces_and_stiffness_are_told(path, options, column, factor, ratio):
    healthy = read_snapshot(path, **options)
    told = found(spoilt(healthy, **{column: lambda values: factor * values}), "stiffness")
    assert told.severity == "doubt" and told.number == pytest.approx(ratio, rel=1e-9)
    assert f"the forces are {ratio:.4g} times what" in told.says
    assert f"or kn is {1 / ratio:.4g} times what" in told.says
    kn = float(np.median(healthy.law.kn)) * ratio * (factor if column == "kn" else 1)
    assert float(told.remedy.split("kn = ")[1].split(",")[0]) == pytest.approx(kn, rel=0.05)
    assert told.remedy.endswith("one snapshot does not show which of the two.")


@pytest.mark.parametrize(("path", "options"), HEALTHY[:2])
@pytest.mark.parametrize("digits", ["single", 8, 6])
def test_rounded_centres_and_radii_raise_no_alarm(path, options, digits):
    """Forces that are off are told nevertheless, as far as overlaps have a digit."""

    def rounded(values):
        if digits == "single":
            return values.astype(np.float32).astype(float)
        return np.array([float(f"{value:.{digits}g}") for value in values])

    tables = read_snapshot(path, **options).tables()
    for name in ("x", "y", "radius"):
        tables["grains"][name] = rounded(np.array(tables["grains"][name]))
    del tables["contacts"]["branch_x"], tables["contacts"]["branch_y"]
    healthy = snapshot_from_tables(**tables)
    assert not suspicious(healthy)
    says = found(healthy, "unseen").says
    # Six digits of the larger sample are as coarse as its overlaps.
    blind = digits == 6 and healthy.graph.cell is not None
    assert ("no overlap is larger than the digits" in says) == blind
    assert "overlap open" in says or digits == 8 or blind
    told = suspicious(spoilt(healthy, force=lambda values: 0.9 * values))
    assert told == (set() if blind else {"stiffness"})


@pytest.mark.parametrize(("path", "options"), HEALTHY[:2])
@pytest.mark.parametrize("factor", [1.01, 0.99, 1.0005])
def test_one_radius_is_told(path, options, factor):
    healthy = read_snapshot(path, **options)
    degree = np.bincount(healthy.graph.contacts.ravel())
    grain = int(np.flatnonzero(degree == 4)[7])

    def change(radii):
        radii[grain] *= factor
        return radii

    told = spoilt(healthy, radius=change)
    assert suspicious(told) == {"radius"}
    says = found(told, "radius").says
    assert f"that of grain {healthy.ids[grain]} is {factor:.6g} times what they need" in says


def without_contact(snapshot, row):
    tables = snapshot.tables()
    tables["contacts"] = {n: np.delete(v, row, axis=0) for n, v in tables["contacts"].items()}
    return snapshot_from_tables(**tables, strict=False)


@pytest.mark.parametrize(("path", "options"), HEALTHY[:2])
def test_a_weak_contact_that_is_lost_is_told(path, options):
    """Also one across the border of the cell; its overlap is told."""
    healthy = read_snapshot(path, **options)
    graph = healthy.graph
    order = np.argsort(np.where(graph.normal_force > 0, graph.normal_force, np.inf))
    rows = [order[3]]
    if graph.images is not None:
        rows.append(order[graph.images[order].any(axis=1)][3])
    for row in rows:
        told = without_contact(healthy, row)
        assert suspicious(told) == {"lost"}
        pair = " and ".join(map(str, sorted(healthy.ids[graph.contacts[row]].tolist())))
        assert (
            f"1 pair of grains overlaps and has no contact: {pair} (by" in found(told, "lost").says
        )


def turned(snapshot, angle, mirror, order):
    """The same snapshot in another frame, its grains and contacts in another order, no walls."""
    graph = snapshot.graph
    c, s = np.cos(angle), np.sin(angle)
    Q = np.array([[c, -s], [s, c]]) @ np.diag([1, -1 if mirror else 1])
    force = contact_forces(graph) @ Q.T
    x = graph.x @ Q.T + [3.0, -7.0]
    rows = np.random.default_rng(order).permutation(graph.contact_count) if order else slice(None)
    ids = np.random.default_rng(order).permutation(1000 + np.arange(graph.grain_count))
    one, two = graph.contacts[rows].T
    law = snapshot.law
    return snapshot_from_tables(
        {"id": ids, "x": x[:, 0], "y": x[:, 1], "radius": graph.radii},
        {
            **{"id1": ids[one], "id2": ids[two], "fx_on_2": force[rows, 0]},
            **{"fy_on_2": force[rows, 1], "kn": law.kn[rows], "ks": law.kt[rows]},
            "mu": law.mu[rows],
        },
    )


@pytest.mark.parametrize(
    ("angle", "mirror", "order"), [(0.0, False, 0), (0.5, False, 3), (np.pi / 4, True, 4)]
)
def test_missing_walls_are_told_in_any_frame(angle, mirror, order):
    healthy = read_snapshot(sample_path())
    assert found(healthy, "walls").says == "61 contacts with walls hold the sample"
    told = found(turned(healthy, angle, mirror, order), "walls")
    assert told.severity == "doubt" and told.says.startswith("no walls known, and ")
    # Frictionless walls push on 61 contacts of grains, some of them with less than 0.3 of the mean.
    assert 45 <= told.number <= 61


def test_walls_are_needed_or_not():
    """A periodic cell needs none; nor do forces in balance; one side without its wall is told."""
    periodic = read_snapshot(sample_path("grains_periodic.parquet"), cell=sample_cell())
    assert found(periodic, "walls").says == "no walls needed: the sample is periodic"
    healthy = read_snapshot(sample_path())
    tables = healthy.tables()
    top = np.asarray(tables["walls"]["fy"]) < -1e-9
    assert 10 < np.count_nonzero(top) < 30
    tables["walls"] = {name: np.asarray(v)[~top] for name, v in tables["walls"].items()}
    told = found(snapshot_from_tables(**tables), "walls")
    assert told.severity == "doubt" and told.number == pytest.approx(np.count_nonzero(top), abs=6)
    # Four grains whose diagonals pull, or push.
    square = {"id": range(4), "x": [0, 1, 1, 0], "y": [0, 0, 1, 1], "r": [0.51] * 4}
    pairs = {"i": [0, 1, 2, 3, 0, 1], "j": [1, 2, 3, 0, 2, 3], "ft": [0.0] * 6}
    push = [1.0] * 4 + [-np.sqrt(2)] * 2
    still = snapshot_from_tables(square, {**pairs, "fn": push}, strict=False)
    says = found(still, "walls").says
    assert says == "no walls known and none needed: no grain is pushed outward"
    free = snapshot_from_tables(square, {**pairs, "fn": [1.0] * 6}, strict=False)
    assert found(free, "walls").severity == "ok"
    assert "4 of 4 grains out of balance pushed outward, too few" in found(free, "walls").says


def test_one_snapshot_says_what_it_does_not_tell():
    says = found(read_snapshot(sample_path()), "unseen").says
    assert says == "one snapshot does not determine kt, two of them a small step apart do"
    tables = read_snapshot(sample_path()).tables()
    for name in ("x", "y"):
        tables["grains"][name] = np.array([float(f"{v:.6g}") for v in tables["grains"][name]])
    coarse = snapshot_from_tables(**tables, strict=False)
    assert "% of a typical overlap open" in found(coarse, "unseen").says


@pytest.mark.parametrize("magnitude", [1.0, 1e-3, 1e6])
def test_rounding_of_numbers_is_found(magnitude):
    values = magnitude * np.random.default_rng(0).random(500)
    assert rounding(values) < 2e-15 * magnitude
    assert rounding(values.astype(np.float32).astype(float)) == pytest.approx(
        values.max() * 2.0**-24, rel=0.1
    )
    text = np.array([float(f"{v:.6g}") for v in values])
    assert 0.4e-5 * magnitude < rounding(text) < 0.6e-5 * magnitude


def test_a_cell_that_no_contact_crosses():
    """It is wrong for a sample between walls, and doubtful for one without."""
    with pytest.raises(InputError, match=r"between walls.*sample's own cell, or none"):
        read_snapshot(sample_path(), cell=[[1.0, 0.0], [0.0, 1.0]])
    row = snapshot_from_tables(
        {"id": [1, 2, 3], "x": [1.0, 2.0, 1.5], "y": [1.0, 1.0, 1.85], "radius": [0.505] * 3},
        {"id1": [1, 2, 3], "id2": [2, 3, 1], "fn": [1.0, 1.0, 1.0]},
        cell=[[4.0, 0.0], [0.0, 4.0]],
    )
    (found,) = (one for one in row.findings if one.check == "cell")
    assert found.severity == "doubt"
    assert "none of 3 contacts crosses" in found.says
    assert any("none of 3 contacts crosses" in note for note in row.notes)


@pytest.mark.parametrize(("check", "one", "two"), [
    ("unbalanced", "1 force stands out and has no", "2 forces stand out and have no"),
    ("turned", "1 contact balances its grains if", "2 contacts balance their grains if"),
    ("lost", "1 pair of grains overlaps and has no", "2 pairs of grains overlap and have no"),
    ("crossings", "1 pair of branches crosses", "2 pairs of branches cross"),
    ("radius", "1 grain with", "2 grains with"),
])  # fmt: skip
def test_one_thing_that_is_counted_is_no_plural(check, one, two):
    assert finding(check, 1.0).says.startswith(one)
    assert finding(check, 2.0).says.startswith(two)
