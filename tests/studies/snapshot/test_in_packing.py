"""`snapshot --in-packing`: columns, summary and figures of loops in place; what is refused."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import grainloops as gl
from loops import GrainGraph, InputError, LinearFrictional, Regime, Scene, find_faces
from patterns import Snapshot, read_snapshot, sample_path, write_snapshot
from stability import restrict, symmetric_part
from stability.packing import loops_at_yield
from studies.output import described
from studies.snapshot import figures
from studies.snapshot.in_packing import add_in_packing, held_snapshot, place_columns
from studies.snapshot.summary import snapshot_summary
from studies.snapshot.table import loop_columns
from tests.command import run
from tests.packings import LAW, loops_in_place, outline_grains, packing
from tests.unsaved import leave_files_empty

SLOW = sample_path("slow/grains_10.parquet")
ROUGH = Path(__file__).parents[1] / "series/rough/grains_04.csv.gz"
CELL = (0.914723458490276, 0.0, 0.0, 0.897826511170329)
COLUMNS = [
    *(f"packing_lambda_{name}" for name in ("min", "mid", "max")),
    "packing_unstable_fraction",
    "packing_cone_opening",
    "packing_soft_angle",
    "surroundings_lambda_min",
    "packing_error",
    "packing_lambda_min_stuck",
    "packing_lambda_min_held",
    "packing_confirmed",
    *(f"packing_direction_{ij}" for ij in ("11", "12", "22")),
]


def eigenvalues(matrix):
    known = np.isfinite(matrix[:, 0, 0])
    out = np.full((len(matrix), 3), np.nan)
    out[known] = np.linalg.eigvalsh(symmetric_part(restrict(matrix[known], "symmetric")))
    return out


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    out = tmp_path_factory.mktemp("place") / "whole"
    drawn = figures.snapshot_figures
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            figures,
            "snapshot_figures",
            lambda *a, **b: (one for one in drawn(*a, **b) if one[0] == "in_packing"),
        )
        leave_files_empty(patch)
        cell = ",".join(map(repr, CELL))
        asked = ("--cell", cell, "--in-packing", "whole", "--yield-band", "0.999", "--out", out)
        assert run("snapshot", SLOW, *asked) == 0
    return out


@pytest.fixture(scope="module")
def place():
    snapshot = read_snapshot(SLOW, cell=np.reshape(CELL, (2, 2)))
    return loops_in_place(Scene(snapshot.graph, snapshot.law), find_faces(snapshot.graph))


def test_columns_are_the_operators_eigenvalues(results, place):
    table = pd.read_parquet(results / "loops.parquet")
    added = [name for name in table if name.split("_")[0] in ("packing", "surroundings")]
    assert added == COLUMNS
    kn = 1e6
    np.testing.assert_allclose(table[COLUMNS[:3]], eigenvalues(place.matrix) / kn, rtol=1e-9)
    around = eigenvalues(place.surroundings)[:, 0] / kn
    np.testing.assert_allclose(table["surroundings_lambda_min"], around, rtol=1e-9, atol=1e-12)
    negative = table["packing_lambda_min"] < 0
    assert ((table["packing_unstable_fraction"] > 0) == negative).all()
    np.testing.assert_array_equal(table["packing_error"], place.error)
    assert 0 < place.error.min() and place.error.max() < 1e-8


def test_summary_of_loops_in_place(results, place):
    summary = json.loads((results / "summary.json").read_text())
    table = pd.read_parquet(results / "loops.parquet")
    share = (table["packing_lambda_min_held"] < 0).mean()
    assert summary["unstable_by_order"]["packing"]["all"]["mean"] == pytest.approx(share)
    assert summary["untrusted_loops"]["packing"] == 0
    assert summary["in_packing"]["method"] == "whole"
    assert summary["in_packing"]["boundary"] == "periodic cell"
    assert summary["in_packing"]["rattlers"] == place.system.carrying.rattlers > 0
    positive = table["surroundings_lambda_min"] > 0
    known = table["surroundings_lambda_min"].notna()
    found = summary["surroundings_positive"]["all"]
    assert found["mean"] == pytest.approx(positive[known].mean()) and found["count"] == known.sum()
    # By the traces of the matrices, where the loop alone is trusted.
    P = restrict(place.matrix, "symmetric"), restrict(place.alone, "symmetric")
    inside, alone = (np.trace(one, axis1=1, axis2=2) for one in P)
    three = (table["order"] == 3) & table["traction_free_lambda_min"].notna()
    median = summary["surroundings_share"]["3"]["median"]
    assert median == pytest.approx(np.median((1 - alone / inside)[three]), rel=1e-9)
    orders = pd.read_parquet(results / "orders.parquet").set_index("order")
    assert orders.loc[3, "surroundings_median"] == pytest.approx(median, rel=1e-12)
    assert orders.loc[5, "packing_unstable_loops"] == pytest.approx(
        (table["packing_lambda_min_held"] < 0)[table["order"] == 5].mean()
    )


def test_columns_of_the_state_at_rest(results, place):
    """293 contacts are flagged from 0.999 of their strength on: the band of the columns."""
    table = pd.read_parquet(results / "loops.parquet")
    at_rest = json.loads((results / "summary.json").read_text())["packing_at_rest"]
    assert at_rest["held"] is None and at_rest["withheld"] == ""
    assert (at_rest["loops"], at_rest["judged"], at_rest["stuck"]["unstable"]) == (1254, 1254, 0)
    (band,) = at_rest["bands"]
    assert (band["band"], band["contacts"], band["unstable"]) == (0.999, 293, 61)
    assert band["mean"] == 61 / 1254
    assert band["std_error"] == pytest.approx(np.sqrt(61 * 1193 / 1254**3), rel=1e-12)
    held = table["packing_lambda_min_held"]
    np.testing.assert_allclose(held, table["packing_lambda_min"], rtol=1e-6, atol=1e-9)
    assert (table["packing_lambda_min_stuck"] > 0).all()
    # The plane of the axes sees a sixth of the unstable loops, as its description says.
    negative, coned = (table["packing_lambda_min"] < 0).sum(), (table["packing_cone_opening"] > 0)
    assert f"({coned.sum()} of {negative})" in described("snapshot/loops", coned.name)[1]
    confirmed = table["packing_confirmed"]
    assert confirmed.notna().equals(held < 0) and confirmed.sum() == band["confirmed"] == 33
    H = table[[f"packing_direction_{ij}" for ij in ("11", "12", "12", "22")]]
    assert H.notna().all(axis=1).equals(confirmed == 1)
    np.testing.assert_allclose(np.linalg.norm(H[confirmed == 1], axis=1), 1.0, rtol=1e-14)
    assert at_rest["says"] in (results / "report.html").read_text()


def test_what_is_said_of_a_state_at_rest():
    """200 grains between rough plates, over the bands."""
    summary = judged(read_snapshot(ROUGH))[2]
    at_rest = summary["packing_at_rest"]
    assert [one["band"] for one in at_rest["bands"]] == [1 - 1e-6, 0.999, 0.99]
    assert [one["contacts"] for one in at_rest["bands"]] == [24, 28, 32]
    assert at_rest["says"] == (
        "At rest, if all contacts stick, every loop is stable in its packing; if contacts within a "
        "millionth of their limit slide, 3.5 +- 2 % (3 of 85; 1 confirmed) would do negative work "
        "in some direction, 5.9 +- 3 % (5 of 85; 1 confirmed) if those within a thousandth do, "
        "36 +- 5 % (31 of 85; 1 confirmed) if those within a hundredth do: a rank of loops, not a "
        "forecast; a third of all loops do negative work in the next step anyway."
    )
    # The table by order is that of the middle band.
    assert summary["unstable_by_order"]["packing"]["all"]["mean"] == 5 / 85


def test_a_state_at_rest_whose_contacts_stand_below_their_limit(tmp_path, capsys):
    asked = ("--in-packing", "whole", "--hold", "--out", tmp_path / "r", "--figures", "none")
    assert run("snapshot", ROUGH, *asked) == 0
    assert (
        "At rest no contact stands at its friction limit and every loop is stable in its packing; "
        "if contacts within a thousandth of their limit slide, none of 85 loops would do negative "
        "work in some direction, 11 +- 3 % (9 of 85; 0 confirmed) if those within a hundredth do: "
    ) in capsys.readouterr().out
    summary = json.loads((tmp_path / "r" / "summary.json").read_text())
    held = summary["packing_at_rest"]["held"]
    assert held["unbalanced"] < 1e-6 < held["unbalanced_before"]
    table = pd.read_parquet(tmp_path / "r" / "loops.parquet")
    again = gl.loop_table(read_snapshot(ROUGH), in_packing=True, hold=True)
    for name in COLUMNS[8:]:
        np.testing.assert_allclose(again[name], table[name], rtol=1e-9, err_msg=name)


def test_a_state_that_moves_has_no_share(monkeypatch, tmp_path, capsys):
    """The box of 600 grains is on its way; its columns stay, and `--hold` is the remedy."""
    leave_files_empty(monkeypatch)
    asked = ("--in-packing", "whole", "--out", tmp_path / "r", "--figures", "orders,in_packing")
    assert run("snapshot", sample_path(), *asked) == 0
    said = capsys.readouterr().out
    assert "is withheld, as the state moves: its unbalanced force is 0.011 of" in said
    assert "bring it to rest first with --hold" in said
    summary = json.loads((tmp_path / "r" / "summary.json").read_text())
    at_rest, shares = summary["packing_at_rest"], summary["unstable_by_order"]["packing"]
    assert at_rest["bands"] == [] and at_rest["stuck"] is None and at_rest["judged"] == 0
    assert all(share["mean"] is None and share["count"] == 0 for share in shares.values())
    table = pd.read_parquet(tmp_path / "r" / "loops.parquet")
    assert table[COLUMNS[:3]].notna().all(axis=None)
    assert table["packing_lambda_min_stuck"].notna().all() and table[COLUMNS[9:]].isna().all(
        axis=None
    )
    orders = pd.read_parquet(tmp_path / "r" / "orders.parquet")
    assert orders["packing_unstable_loops"].isna().all()
    assert (orders["packing_undetermined_loops"] == 1).all()
    chains = pd.read_parquet(tmp_path / "r" / "chains.parquet")
    assert chains["packing_unstable"].isna().all() and chains["packing_lambda_min"].notna().any()


@pytest.mark.slow
def test_a_state_brought_to_rest_has_a_share(box, tmp_path, capsys):
    """Seven contacts are lost, six gained: loops that have changed have no verdict in the table."""
    asked = ("--in-packing", "whole", "--hold", "--out", tmp_path / "r", "--figures", "none")
    assert run("snapshot", sample_path(), *asked) == 0
    said = capsys.readouterr().out
    assert (
        "At rest no contact stands at its friction limit and every loop is stable in its packing; "
        "if contacts within a thousandth of their limit slide, none of 310 loops would do negative "
        "work in some direction, 0.65 +- 0.5 % (2 of 310; 2 confirmed) if those within a hundredth"
    ) in said
    summary = json.loads((tmp_path / "r" / "summary.json").read_text())
    at_rest = summary["packing_at_rest"]
    assert at_rest["held"]["lost"] == 7 and at_rest["held"]["gained"] == 6
    assert summary["loops"] == 309 and at_rest["loops"] == at_rest["judged"] == 310
    table = pd.read_parquet(tmp_path / "r" / "loops.parquet")
    held = table["packing_lambda_min_held"]
    assert held.notna().sum() == at_rest["loops_in_table"] < 309
    rest, _ = held_snapshot(box, "strain")
    found, number = loops_at_yield(rest.scene, 0.999), {}
    for loop, face in enumerate(rest.faces.loops):
        ends = slice(*rest.faces.offsets[face : face + 2])
        number[frozenset(rest.ids[rest.faces.grains[ends]].tolist())] = loop
    smallest = eigenvalues(found.matrix)[:, 0] / box.mean_kn
    for ids, value in zip(table["grains"][held.notna()], held[held.notna()], strict=True):
        assert value == pytest.approx(smallest[number[frozenset(ids)]], rel=1e-9)
    again = gl.loop_table(box, in_packing=True, hold=True)
    np.testing.assert_allclose(again["packing_lambda_min_held"], held, rtol=1e-9)


def test_one_band_alone(tmp_path, capsys):
    asked = ("--in-packing", "whole", "--out", tmp_path / "r", "--figures", "none")
    assert run("snapshot", ROUGH, *asked, "--yield-band", "0.97") == 0
    summary = json.loads((tmp_path / "r" / "summary.json").read_text())
    (one,) = summary["packing_at_rest"]["bands"]
    assert one["band"] == 0.97 and (one["unstable"], one["count"], one["confirmed"]) == (26, 85, 1)
    assert "if contacts within 0.03 of their limit slide, 31 +- 5 % (26 of 85; 1 confirmed)" in (
        capsys.readouterr().out
    )
    held = pd.read_parquet(tmp_path / "r" / "loops.parquet")["packing_lambda_min_held"]
    assert (held < 0).sum() == 26


def test_contacts_that_their_slip_drives_on_leave_no_share():
    """A packing at rest by its forces' sum, with a contact of `M_cc < 0` in the widest band."""
    graph = packing(60, seed=2, sliding=0.4)
    driven = snapshot_of(graph)
    found = loops_at_yield(driven.scene, 0.999)
    assert found.softening == 1 and found.unstable.any() and not found.confirmed.any()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("studies.snapshot.in_packing.MOVING", np.inf)
        _, table, summary = judged(driven)
    at_rest = summary["packing_at_rest"]
    assert "their slip drives on 1 of 60 contacts that may slide" in at_rest["bands"][1]["withheld"]
    assert "bring the state to rest first with --hold" in at_rest["says"]
    assert at_rest["bands"][1]["count"] == 0 and at_rest["judged"] == 0
    assert np.isnan(table["packing_lambda_min_held"]).all()
    assert np.isfinite(table["packing_lambda_min"]).all()


@pytest.mark.parametrize("asked", [("--hold",), ("--yield-band", "0.99")])
def test_a_state_at_rest_is_asked_of_loops_in_place_alone(asked, tmp_path, capsys):
    assert run("snapshot", sample_path(), *asked, "--out", tmp_path / "r") == 2
    assert "Add --in-packing" in capsys.readouterr().err and not (tmp_path / "r").exists()
    with pytest.raises(InputError, match="in_packing=True"):
        gl.loop_table(read_snapshot(sample_path()), hold=True)


@pytest.mark.parametrize("band", ["0", "1.1", "nan"])
def test_bands_are_shares(band, tmp_path, capsys):
    asked = ("--in-packing", "whole", "--yield-band", band, "--out", tmp_path / "r")
    assert run("snapshot", ROUGH, *asked) == 2
    assert "above 0, at most 1" in capsys.readouterr().err and not (tmp_path / "r").exists()


@pytest.mark.parametrize("asked", ["foo", "", "0", "8", "nan", "patches", "whole,8"])
def test_nonsense_is_refused(tmp_path, capsys, asked):
    cell = ",".join(map(repr, CELL))
    out = tmp_path / "r"
    options = ("--cell", cell, f"--in-packing={asked}", "--out", out, "--no-figures")
    assert run("snapshot", SLOW, *options) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "--in-packing" in said
    assert "expected" in said and not out.exists()


def snapshot_of(graph, law=LAW, regime=Regime.ELASTIC, **more):
    law = LinearFrictional(*np.broadcast_arrays(law.kn, law.kt, law.mu, np.ones(
        graph.contact_count))[:3], law.shear_increment)  # fmt: skip
    regimes = np.full(graph.contact_count, regime, dtype=np.int8)
    graph = graph.replace(regime=regimes)
    return Snapshot(graph, law, regimes, np.arange(graph.grain_count), 0, (), **more)


def judged(snapshot, asked="whole"):
    """Notes, table and summary."""
    table = loop_columns(snapshot)
    method, notes = add_in_packing(snapshot, table, asked)
    return notes, table, snapshot_summary(snapshot, table, method)


def square(**more):
    x = [[0, 0], [1, 0], [1, 1], [0, 1.0]]
    return GrainGraph(
        x, [0.5] * 4, [[0, 1], [1, 2], [2, 3], [3, 0]], normal_force=[0.1] * 4, **more
    )


def test_a_packing_that_floats():
    floats = square(images=[[0, 0]] * 4, cell=[[5.0, 0], [0, 5.0]])
    with pytest.raises(InputError, match="1 floating cluster"):
        judged(snapshot_of(floats))


def test_a_single_loop_stands_in_no_packing():
    notes, table, summary = judged(snapshot_of(square()))
    assert np.isnan(table["packing_lambda_min"]).all() and np.isnan(table["packing_error"]).all()
    assert summary["untrusted_loops"]["packing"] == 1
    assert "no loop could be judged in the packing" in notes[-1]
    assert summary["in_packing"]["boundary"] == "4 grains held to the affine motion"


def test_a_command_on_one_triangle_draws_no_loop_in_its_packing(tmp_path):
    angle = np.radians([90, 210, 330])
    x = (1 - 5e-4) / np.sqrt(3) * np.column_stack([np.cos(angle), np.sin(angle)])
    graph = GrainGraph(x, [0.5] * 3, [[0, 1], [1, 2], [2, 0]], normal_force=[5e-4] * 3)
    write_snapshot(tmp_path / "grains_1.csv", snapshot_of(graph))
    out = tmp_path / "out"
    asked = ("--in-packing", "whole", "--out", out)
    assert run("snapshot", tmp_path / "grains_1.csv", *asked) == 0
    assert np.isnan(pd.read_parquet(out / "loops.parquet")["packing_lambda_min"]).all()
    assert not (out / "in_packing.png").exists() and (out / "map.png").exists()


def test_no_forces_are_refused():
    snapshot = replace(snapshot_of(packing(30, seed=2)), law=None, regime=None)
    with pytest.raises(InputError, match="no forces"):
        judged(snapshot)


def test_contacts_that_carry_nothing_still_have_springs():
    graph = packing(30, seed=2)
    nothing = np.zeros(graph.contact_count)
    _, table, _ = judged(snapshot_of(graph.replace(normal_force=nothing, shear_force=nothing)))
    assert (table["packing_lambda_min"] > 0).all()


def test_all_contacts_sliding_are_judged_or_not_numbers():
    for mu in (0.0, 0.5):
        law = replace(LAW, mu=mu)
        _, table, _ = judged(snapshot_of(packing(30, seed=2), law, Regime.SLIDING))
        known = np.isfinite(table["packing_lambda_min"])
        assert known.any()
        assert np.abs(table["packing_lambda_max"][known]).max() < 1e6


def test_all_contacts_open_are_refused():
    with pytest.raises(InputError, match="grains that all float"):
        judged(snapshot_of(packing(30, seed=2), regime=Regime.OPEN))


def test_a_cell_of_one_grain_has_loops_without_a_strain():
    one = GrainGraph([[0.0, 0.0]], [0.5], [[0, 0], [0, 0]], images=[[1, 0], [0, 1]], cell=np.eye(2))
    place = loops_in_place(Scene(one, LAW), find_faces(one))
    assert np.isnan(place.matrix).all()


def test_a_singular_cell_is_refused():
    with pytest.raises(InputError, match="cell"):
        read_snapshot(SLOW, cell=[[1.0, 1.0], [1.0, 1.0]])


@pytest.fixture(scope="module")
def box():
    return read_snapshot(sample_path())


def test_walls_that_barely_touch_are_as_stiff_as_force_over_overlap(box):
    """Two of the 61 overlap by less than 1e-4 of the radius; lengths have fifteen digits."""
    bare = replace(box, walls=replace(box.walls, kn=None, kt=None))
    np.testing.assert_allclose(bare.scene.boundary.walls.kn, box.walls.kn, rtol=1e-8)


def test_walls_are_planes_of_the_files_stiffness(box):
    contacts = pd.read_csv(sample_path("contacts_biaxial.csv.gz"))
    grains = pd.read_csv(sample_path()).set_index("id")
    own = contacts[grains.loc[contacts["id1"], "type"].to_numpy() == 1]
    assert len(own) == box.wall_contacts == 61
    np.testing.assert_array_equal(box.walls.kn, own["kn"])
    # The walls have no friction, whatever their shear stiffness.
    assert (own["ks"] > 0).all() and (box.walls.kt == 0).all()
    _, table, summary = judged(box)
    assert summary["in_packing"]["boundary"] == "61 wall contacts"
    assert np.isfinite(table["packing_lambda_min"]).all()
    # Yade's law is N = kn times overlap, and tables have fifteen digits of lengths.
    notes, again, _ = judged(replace(box, walls=replace(box.walls, kn=None, kt=None)))
    assert (
        notes[-1] == "walls: frictionless, with the stiffness that their forces and overlaps give"
    )
    for name in COLUMNS[:3]:
        np.testing.assert_allclose(again[name], table[name], rtol=1e-6, atol=1e-9)


def test_rough_walls_hold_until_they_slide(tmp_path):
    contacts = pd.read_csv(sample_path("contacts_biaxial.csv.gz"))
    wall = contacts["id1"].isin(range(600, 604))
    contacts.loc[wall, "mu"] = 0.3
    first = np.flatnonzero(wall)[0]
    contacts.loc[first, "mu"] = np.hypot(*contacts.loc[first, ["fsx", "fsy"]]) / contacts.fn[first]
    shutil.copy(sample_path(), tmp_path / "grains_biaxial.csv.gz")
    contacts.to_csv(tmp_path / "contacts_biaxial.csv.gz", index=False)
    planes = read_snapshot(tmp_path / "grains_biaxial.csv.gz").boundary_and_notes[0].walls
    ratio = np.hypot(contacts.fsx, contacts.fsy)[wall] / contacts.fn[wall]
    stick = (ratio < 0.3).to_numpy() & (np.arange(wall.sum()) > 0)
    np.testing.assert_array_equal(planes.kt, np.where(stick, contacts["ks"][wall], 0.0))


def test_a_wall_sample_without_walls_is_held_at_its_outline(box):
    _, table, _ = judged(box)
    notes, held, summary = judged(replace(box, walls=None))
    faces = find_faces(box.graph)
    count = outline_grains(box.graph, faces).sum()
    assert summary["in_packing"]["boundary"] == f"{count} grains held to the affine motion"
    assert f"the {count} grains of the outline follow the affine motion" in notes[-1]
    known = np.isfinite(held["packing_lambda_min"])
    assert np.count_nonzero(~known) > 50
    # The outline is stiffer than walls: that tells on its neighbours alone.
    change = held["packing_lambda_max"][known] / table["packing_lambda_max"][known] - 1
    assert -0.01 < np.median(change) < 0.05


@pytest.mark.collection
@pytest.mark.parametrize("name", ["yade-small/grains_08.csv.gz", "yade-medium/grains_05.parquet"])
def test_loops_between_walls(name):
    snapshot = read_snapshot(Path(os.environ["GRAINLOOPS_DEM"]) / name)
    _, table, summary = judged(snapshot, "auto")
    assert summary["in_packing"]["boundary"] == f"{snapshot.wall_contacts} wall contacts"
    assert 0.03 < np.mean(table["packing_lambda_min"] < 0) < 0.13
    order, smallest = table["order"], table["traction_free_lambda_min"]
    assert (smallest[(order >= 5) & np.isfinite(smallest)] < 0).all()


def test_signs_within_the_error_are_withheld(place):
    """Errors of the two parts of the surroundings add up; Ks errs by no more than the operator."""
    sure = place_columns(place, 1e6)
    assert all(np.isfinite(sure[name]).all() for name in COLUMNS[:4])
    least = np.abs(eigenvalues(place.matrix))
    size = np.linalg.norm(place.matrix, axis=(1, 2))
    rough = replace(place, error=1.001 * least[:, 1] / size)
    found = place_columns(rough, 1e6)
    for k, name in enumerate(COLUMNS[:3]):
        withheld = np.isnan(found[name])
        np.testing.assert_array_equal(withheld, least[:, k] <= 1.001 * least[:, 1])
        np.testing.assert_array_equal(found[name][~withheld], sure[name][~withheld])
    assert np.isnan(found["packing_unstable_fraction"]).all()
    around = np.abs(eigenvalues(place.surroundings)[:, 0])
    for share, kept in ((0.45, True), (0.55, False)):
        both = replace(place, error=share * around / size, alone_error=share * around)
        known = np.isfinite(place_columns(both, 1e6)["surroundings_lambda_min"])
        assert (known == kept)[np.isfinite(around)].all()
