"""Files of runs under Hertz and Mindlin's law, and contacts with walls: read, checked, written."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from loops import HertzMindlin, InputError, Regime, Scene, contact_state, match_contacts
from loops.laws.kinds import HERTZ
from patterns import Snapshot, WallContacts, read_snapshot, snapshot_from_tables, write_snapshot
from patterns.snapshots.checks import SLIDING_SHARE
from stability import follow
from tests.packings import jammed, strained
from tests.stability.packing.walled_packings import jammed_in_box

# Of the run: the files don't tell these numbers.
YOUNG, POISSON = 5.0, 0.2
LAW = HertzMindlin(YOUNG, POISSON, 0.5, "branch")


def tables():
    """Tables as a code writes them under Hertz's law, tangents from the overlap."""
    graph = jammed(24, 3)
    state = contact_state(graph)
    i, j = graph.contacts.T
    reduced = graph.radii[i] * graph.radii[j] / (graph.radii[i] + graph.radii[j])
    overlap = np.maximum(state.overlap, 0.0)
    effective = YOUNG / (2 * (1 - POISSON**2))
    N = 4 / 3 * effective * np.sqrt(reduced) * overlap**1.5
    kn = 2 * effective * np.sqrt(reduced * overlap)
    kt = 8 * YOUNG / (4 * (1 + POISSON) * (2 - POISSON)) * np.sqrt(reduced * overlap)
    T = np.clip(graph.shear_force, -0.5 * N, 0.5 * N)
    grains = {"id": np.arange(graph.grain_count), "x": graph.x[:, 0], "y": graph.x[:, 1]}
    contacts = {"id1": i, "id2": j, "fn": N, "ft": T, "kn": kn, "ks": kt, "mu": 0.5 + 0 * N}
    if graph.images is not None:
        contacts |= {"cell_dx": graph.images[:, 0], "cell_dy": graph.images[:, 1]}
    return {"grains": grains | {"radius": graph.radii}, "contacts": contacts, "cell": graph.cell}


def given_without_tangents():
    given = tables()
    for name in ("kn", "ks"):
        del given["contacts"][name]
    return given


@pytest.mark.parametrize("told", ["tangents", "moduli"])
def test_the_law_of_the_run_is_found(told):
    """Forces and both tangents of the law that is read are those of the file."""
    if told == "tangents":
        snapshot = snapshot_from_tables(**tables(), law="hertz")
    else:
        how = {"law": "hertz", "young": YOUNG, "poisson": POISSON}
        snapshot = snapshot_from_tables(**given_without_tangents(), **how)
    contacts, state = tables()["contacts"], contact_state(snapshot.graph)
    np.testing.assert_allclose(snapshot.law.normal_force(state), contacts["fn"], rtol=1e-9)
    for found, name in zip(snapshot.law.stiffnesses(state), ("kn", "ks"), strict=True):
        np.testing.assert_allclose(found, contacts[name], rtol=1e-9)
    assert snapshot.law.shear_history == "force"
    assert any("shear history 'force'" in note for note in snapshot.notes)


def stiffness_found(**how):
    return next(one for one in snapshot_from_tables(**how).findings if one.check == "stiffness")


def test_tangents_secants_and_linear_springs_are_told_apart():
    found = stiffness_found(**tables(), law="linear")
    assert found.number == pytest.approx(2 / 3, rel=1e-9) and "--law hertz" in found.says
    secants = tables()
    for name in ("kn", "ks"):
        secants["contacts"][name] = 2 / 3 * secants["contacts"][name]
    linear = stiffness_found(**secants)
    assert linear.number == pytest.approx(1, rel=1e-9) and "ertz" not in linear.says
    assert stiffness_found(**tables(), law="hertz").severity == "ok"
    wrong = stiffness_found(**secants, law="hertz")
    assert wrong.severity == "doubt"
    modulus = float(wrong.remedy.split("nu^2) = ")[1].split(")")[0])
    assert modulus == pytest.approx(YOUNG / (1 - POISSON**2), rel=1e-3)
    how = {"law": "hertz", "young": 2 * YOUNG, "poisson": POISSON}
    assert stiffness_found(**given_without_tangents(), **how).severity == "doubt"


TOLD_NOTE = "Hertz's law, told by the columns"


def is_hertz(given, **how):
    snapshot = snapshot_from_tables(**given, **how)
    told = any(note.startswith(TOLD_NOTE) for note in snapshot.notes)
    assert told == (isinstance(snapshot.law, HertzMindlin) and "law" not in how)
    return told


def test_tangents_are_told_by_their_content():
    """The law is that of `--law hertz`, in any unit; a series of it is followed."""
    told, asked = snapshot_from_tables(**tables()), snapshot_from_tables(**tables(), law="hertz")
    np.testing.assert_array_equal(told.law.young, asked.law.young)
    np.testing.assert_array_equal(told.law.ratio, asked.law.ratio)
    assert is_hertz(tables()) and not is_hertz(tables(), law="linear")
    path = follow(Scene(told.graph, told.law), strained(np.diag([1e-5, 0])), closure="packing")
    assert path.status == "finished"
    again = tables()
    for name, unit in (("fn", 1e6), ("ft", 1e6), ("kn", 1e9), ("ks", 1e9)):
        again["contacts"][name] = unit * again["contacts"][name]
    for name in ("x", "y", "radius"):
        again["grains"][name] = 1e-3 * again["grains"][name]
    again["cell"] = 1e-3 * again["cell"]
    assert is_hertz(again)


def test_two_materials_are_told_and_springs_are_not():
    """Moduli of grains 1:4 leave the root of the overlap; kn of the radii alone does not."""
    two, linear, even, secants = (tables() for _ in range(4))
    softer = np.where(np.arange(len(two["contacts"]["id1"])) % 3 == 0, 0.25, 1.0)
    for name in ("fn", "ft", "kn", "ks"):
        two["contacts"][name] = softer * two["contacts"][name]
    assert is_hertz(two)
    # Secants are those of springs.
    secants["contacts"]["kn"] = 2 / 3 * secants["contacts"]["kn"]
    assert not is_hertz(secants)
    # Forces that are off by 0.5 and 3 %.
    for factor, told in ((1.005, True), (1.03, False)):
        scaled = tables()
        for name in ("fn", "ft"):
            scaled["contacts"][name] = factor * scaled["contacts"][name]
        assert is_hertz(scaled, strict=False) == told
    # Springs of which forces are 2/3, as in another unit; constant, or of the radii.
    radii = linear["grains"]["radius"]
    ij = linear["contacts"]["id1"], linear["contacts"]["id2"]
    for kn in (np.ones(len(ij[0])), radii[ij[0]] * radii[ij[1]] / (radii[ij[0]] + radii[ij[1]])):
        overlap = linear["contacts"]["fn"] / linear["contacts"]["kn"] / HERTZ
        linear["contacts"] |= {"fn": HERTZ * kn * overlap, "kn": kn, "ks": 0.5 * kn, "ft": 0 * kn}
        assert not is_hertz(linear, strict=False)
    # Forces of one size tell no root.
    few = np.arange(9)
    even["contacts"] = {name: values[few] for name, values in even["contacts"].items()}
    assert not is_hertz(even, strict=False)


@pytest.mark.parametrize("history", ["force", "displacement"])
def test_tables_and_files_keep_the_law(tmp_path, history):
    first = snapshot_from_tables(**tables(), law="hertz", shear_history=history)
    again = snapshot_from_tables(**first.tables())
    write_snapshot(tmp_path / "grains_3.parquet", first)
    for other in (again, read_snapshot(tmp_path / "grains_3.parquet")):
        assert other.law.shear_history == history
        np.testing.assert_allclose(other.law.young, first.law.young, rtol=1e-12)
        np.testing.assert_allclose(other.law.ratio, first.law.ratio, rtol=1e-12)
    # Whoever reads asks for another law.
    assert not isinstance(
        read_snapshot(tmp_path / "grains_3.parquet", law="linear").law, HertzMindlin
    )


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"law": "cundall"}, "linear, hertz"),
        ({"young": 1.0, "poisson": 0.2}, "young, poisson under no named law"),
        ({"law": "linear", "shear_history": "force"}, "shear_history under linear"),
        ({"law": "hertz", "young": 1.0}, "young alone"),
        ({"law": "hertz", "young": -1.0, "poisson": 0.2}, "young: got -1.0"),
        ({"law": "hertz", "young": 1.0, "poisson": 0.7}, "poisson of the contact law"),
        ({"law": "hertz", "kn": 1.0}, "one kn or kt under Hertz's law"),
        ({"law": "hertz", "shear_history": "none"}, "force or displacement"),
    ],
)
def test_bad_options(how, message):
    with pytest.raises(InputError, match=message):
        snapshot_from_tables(**given_without_tangents(), **how)


def test_what_hertz_lacks_is_named():
    snapshot = snapshot_from_tables(**given_without_tangents(), law="hertz")
    assert snapshot.lacks == ("young", "poisson") and snapshot.has_forces
    with pytest.raises(InputError, match="Give --young and --poisson"):
        snapshot.mechanics()


def boxed(**springs):
    graph, planes, force = jammed_in_box(24, 1)
    walls = WallContacts(planes.grain, force, -planes.branch, planes.kn, planes.kt)
    bare = Snapshot(
        graph, None, None, np.arange(24), len(walls.grain), (), walls, lacks=("kn", "kt")
    )
    given = bare.tables()
    given["walls"] |= springs
    return snapshot_from_tables(**given, kn=1.0, kt=0.5, mu=0.5), walls


@pytest.mark.parametrize("ending", ["parquet", "csv"])
def test_walls_are_written_and_read_back(tmp_path, ending):
    count = len(jammed_in_box(24, 1)[1].grain)
    first, walls = boxed(mu=np.full(count, 0.3), sliding=np.arange(count) % 3 == 0)
    path = tmp_path / f"grains_1.{ending}"
    write_snapshot(path, first)
    second = read_snapshot(path)
    assert second.wall_contacts == len(walls.grain)
    for name in ("grain", "force", "branch", "kn", "kt", "mu", "sliding"):
        np.testing.assert_array_equal(getattr(second.walls, name), getattr(first.walls, name))
    # A later snapshot of that name without walls leaves none behind.
    write_snapshot(path, snapshot_from_tables(**first.tables() | {"walls": None}))
    assert read_snapshot(path).walls is None
    # So does one whose walls touch no grain.
    write_snapshot(path, first)
    none = {f.name: v[:0] for f in fields(walls) if (v := getattr(walls, f.name)) is not None}
    write_snapshot(path, replace(first, walls=WallContacts(**none), wall_contacts=0))
    assert read_snapshot(path).walls is None


def test_friction_of_walls_decides_what_slides():
    """Contacts of a wall at yield slide, and keep its shear stiffness for when they stick."""
    _, planes, force = jammed_in_box(24, 1)
    count = len(planes.grain)
    n = -planes.branch / np.linalg.norm(planes.branch, axis=1, keepdims=True)
    N = np.sum(force * n, axis=1)
    share = np.where(np.arange(count) < 3, 1.0, 0.5)
    T = 0.3 * share * N
    leaning = force + T[:, None] * np.column_stack([-n[:, 1], n[:, 0]])
    snapshot, _ = boxed(
        fx=leaning[:, 0], fy=leaning[:, 1], ks=np.full(count, 1.5), mu=np.full(count, 0.3)
    )
    planes = snapshot.boundary_and_notes[0].walls
    at_yield = share * 1.0000001 >= SLIDING_SHARE
    assert np.count_nonzero(at_yield) == 3
    slides = np.where(at_yield, Regime.SLIDING, Regime.ELASTIC)
    np.testing.assert_array_equal(planes.regime, slides)
    np.testing.assert_array_equal(planes.kt, 1.5)
    np.testing.assert_array_equal(planes.mu, 0.3)


def test_contacts_with_walls_without_a_force_are_left_out_of_paths_in_step():
    snapshot, walls = boxed()
    none = walls.force.copy()
    none[0] = 0.0
    snapshot = Snapshot(
        snapshot.graph, snapshot.law, snapshot.regime, snapshot.ids, len(none), (),
        WallContacts(walls.grain, none, walls.branch),
    )  # fmt: skip
    planes = snapshot.boundary_and_notes[0].walls
    np.testing.assert_array_equal(planes.grain, walls.grain[1:])
    np.testing.assert_array_equal(planes.force, none[1:])


RUN = Path(__file__).parent / "samples" / "liggghts-hertz"


def test_a_run_of_liggghts_is_read_and_followed():
    """`model hertz tangential history`, 100 discs sheared by 1e-4 (LIGGGHTS 3.8, `in.hertz`)."""
    how = {"law": "hertz", "young": 1e9, "poisson": 0.25, "mu": 0.3}
    before, after = (
        read_snapshot(
            RUN / f"atoms.{step}.dump.gz",
            RUN / f"contacts.{step}.dump.gz",
            shear_history="displacement",
            **how,
        )
        for step in (0, 20000)
    )
    N = before.law.normal_force(contact_state(before.graph))
    np.testing.assert_allclose(before.graph.normal_force, N, rtol=1e-9)
    H = np.eye(2) - after.graph.cell @ np.linalg.inv(before.graph.cell)
    path = follow(Scene(before.graph, before.law), strained(H), closure="packing", past="dynamic")
    match = match_contacts(before.graph, before.ids, after.graph, after.ids)
    kept = match.shared
    assert path.status == "finished" and len(kept) == before.graph.contact_count
    for name in ("normal_force", "shear_force"):
        first, last = getattr(before.graph, name), getattr(after.graph, name)[match.after]
        moved = getattr(path.states[-1], name)[: len(first)]
        # Forces change by some percent; LIGGGHTS strained at an inertial number near 1e-6.
        assert np.linalg.norm(moved - last) < 1e-3 * np.linalg.norm(last - first)
    other = read_snapshot(RUN / "atoms.0.dump.gz", RUN / "contacts.0.dump.gz", **how)
    T = follow(Scene(other.graph, other.law), strained(H), closure="packing").states[-1].shear_force
    assert np.linalg.norm(T[: len(first)] - last) > 3e-3 * np.linalg.norm(last - first)
