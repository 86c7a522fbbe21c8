"""`grainloops polygon`: what it writes, and what it finds."""

import json
from dataclasses import replace
from typing import get_args

import numpy as np
import pandas as pd
import pytest

from loops import (
    InputError,
    Scene,
    contact_state,
    love_weber_stress,
    traction_tangent,
)
from patterns import loop_of_snapshot, read_snapshot, sample_path
from stability import rates_at, restrict
from stability.programmes import proportional_strain
from studies.commands.loops import event_lines, state_lines
from studies.paths.figures import draw_operators
from studies.paths.followed import follow_loop, thresholds
from studies.paths.options import (
    ComparisonOptions,
    LoopOptions,
    PolygonOptions,
    ProgrammeName,
    orders_of,
    ring_of_lengths,
)
from studies.paths.run import run_paths
from studies.style import axes_or_new
from tests.oracles.diamond import DiamondParameters
from tests.oracles.drained import drained_path as exact_drained_path
from tests.studies.paths.followed import followed, summary_of
from tests.unsaved import leave_files_empty

SUMMARY_KEYS = {
    "critical_strain", "definitions", "events", "message", "model", "notes", "parameters", "peak",
    "provenance", "reference_area", "rows", "states", "status", "verification",
}  # fmt: skip
EVENT_KEYS = {
    "kind", "subspace", "E1", "E2", "s1", "s2", "stage", "parameter", "contacts", "detail"
}  # fmt: skip
COLUMNS = {
    "stage", "parameter", "E1", "E2", "H12", "H21", "s1", "s2", "s12", "s21", "N", "T", "regime",
    "x", "y", "det_K", "det_Ks", "lambda_1", "lambda_2", "cone_status", "cone_opening_deg",
    "cone_axis_deg", "work", "dissipated", "energy_error", "imbalance", "A11_11", "A22_22",
    "eigenvalue_1_real", "eigenvalue_2_imag", "status", "cone_edge_1_deg", "Kmat11", "Kgeo22",
    *(f"{name}_{subspace}" for name in ("lambda_min", "unstable_fraction")
      for subspace in ("diagonal", "symmetric", "full")),
}  # fmt: skip
FIGURES = (
    "loop", "stress_strain", "determinant", "eigenvalues", "split", "polar", "cone",
    "unstable_fraction",
)  # fmt: skip
BAD = [
    ({"order": 2}, "--order"),
    ({"order": 2000}, "--order"),
    ({"kappa": -0.1}, "--kappa"),
    ({"kappa": np.nan}, "--kappa"),
    ({"phi_deg": 91.0}, "--phi"),
    ({"confine": 1.0}, "--confine"),
    ({"confine": -0.1}, "--confine"),
    ({"end": 0.05}, "--end"),
    ({"orientation": "corner"}, "--orientation"),
    ({"closure": "rigid"}, "--closure"),
    ({"spins": "up"}, "--spins"),
    ({"programme": "drianed"}, "--programme"),
    ({"programme": "proportional-strain"}, "--strain-ratio"),
    ({"fluid_bulk_modulus": 1.0}, "--fluid-bulk-modulus"),
]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A hexagon past its threshold, under the traction closure; its figures are not saved."""
    folder = tmp_path_factory.mktemp("polygon") / "6"
    parameters = PolygonOptions(6, kappa=0.2, phi_deg=5.0, closure="traction", confine=0.2)
    with pytest.MonkeyPatch.context() as patch:
        leave_files_empty(patch)
        return folder, run_paths(parameters, folder, csv=True)


def test_files(written):
    folder, _ = written
    tables = {"path.parquet", "path.csv", "polar.parquet", "polar.csv"}
    written = {"summary.json", "report.html", *tables}
    drawn = {f"{name}.png" for name in FIGURES}
    assert {file.name for file in folder.iterdir()} == written | drawn
    assert all((folder / name).stat().st_size > 500 for name in written)


def test_summary(written):
    folder, summary = written
    read = json.loads((folder / "summary.json").read_text())
    assert set(read) - {"files"} == set(summary) - {"files"} == SUMMARY_KEYS
    assert set(read["critical_strain"]) == {"diagonal", "symmetric", "full"}
    assert read["critical_strain"]["diagonal"] == pytest.approx(0.2 / 1.2, abs=1e-12)
    assert all(set(event) == EVENT_KEYS for event in read["events"])
    parameters = [event["parameter"] for event in read["events"]]
    assert np.all(np.diff(parameters) > -1e-8)
    difference = read["verification"]["critical_strain_path_against_root"]
    assert all(difference[subspace] < 1e-13 for subspace in ("diagonal", "symmetric", "full"))
    assert read["verification"]["energy_error_max"] < 1e-13
    assert read["verification"]["imbalance_max"] < 1e-14
    assert set(read["states"]) == {"I", "A", "B", "end"}
    assert read["states"]["A"]["verdict"]["diagonal"]["status"] == "unstable"


def test_table(written):
    folder, summary = written
    table = pd.read_parquet(folder / "path.parquet")
    assert set(table.columns) >= COLUMNS
    assert len(table) == summary["rows"]
    assert all(len(row) == 6 for row in table["N"])
    isotropic = table[table["stage"] == "confinement"]
    # P = (1/V0) sum N l0 n (x) n with N = E, over the hexagon's area 3 sqrt(3)/2.
    stress = 2.0 / np.sqrt(3.0) * isotropic["E1"]
    np.testing.assert_allclose(isotropic["s1"], stress, atol=1e-14)
    np.testing.assert_allclose(isotropic["s2"], stress, atol=1e-14)
    drained = table[table["stage"] == "drained"]
    assert np.ptp(drained["s2"]) < 1e-13
    assert (drained[["H12", "H21"]].abs() < 1e-12).all().all()
    for event in summary["events"]:
        row = table[["E1", "E2", "s1", "s2"]] - [event[key] for key in ("E1", "E2", "s1", "s2")]
        if event["kind"] == "branching":
            # It lies between two rows of its stage, within what a chord between them misses.
            rows = table[table["stage"] == event["stage"]]
            k = int(np.searchsorted(rows["E1"], event["E1"]))
            assert rows["E1"].iloc[k - 1] < event["E1"] <= rows["E1"].iloc[k]
            for key in ("E2", "s1", "s2"):
                chord = np.interp(
                    event["E1"], rows["E1"].iloc[k - 1 : k + 1], rows[key].iloc[k - 1 : k + 1]
                )
                assert event[key] == pytest.approx(chord, abs=1e-4)
        elif event["subspace"] in (None, "diagonal"):
            assert row.abs().max(axis=1).min() == 0.0


def test_unstable_fractions_are_those_of_the_operators(written):
    table = pd.read_parquet(written[0] / "path.parquet")
    ratio = np.maximum(-table["lambda_1"] / table["lambda_2"], 0.0)
    share = 2.0 / np.pi * np.arctan(np.sqrt(ratio))
    past = table["E1"] > 0.2 / 1.2 + 1e-6
    assert past.any()
    np.testing.assert_allclose(table["unstable_fraction_diagonal"][past], share[past], rtol=1e-12)
    opening = table["cone_opening_deg"][past] / 180.0
    np.testing.assert_allclose(opening, share[past], rtol=1e-12)
    assert (table["unstable_fraction_full"][table["E1"] < 0.16] == 0.0).all()


def test_the_square_on_its_side_is_lost_in_shear_alone():
    found = thresholds(PolygonOptions(4, orientation="edge", closure="traction"))
    assert found["diagonal"] is None
    assert found["symmetric"] == pytest.approx(0.2 / 1.2, abs=1e-12)


def test_peak_of_the_drained_diamond_is_point_B():
    """All four contacts yield at B and the axial stress turns over: the closed path of Table 1."""
    found = follow_loop(PolygonOptions(4, confine=0.1, end=0.3), ("diagonal",))
    peak = found.peak
    exact = exact_drained_path(DiamondParameters(np.pi / 4, 0.2, np.radians(5.0), 0.1)).end
    assert peak["E1"] == pytest.approx(float(exact.E1), abs=1e-13)
    assert peak["E2"] == pytest.approx(float(exact.E2), abs=1e-13)
    # Over the rhombus, half of the paper's box.
    assert peak["s1"] == pytest.approx(2 * float(exact.s1), abs=1e-13)


def test_peak_between_rows_of_an_undrained_path():
    parameters = PolygonOptions(4, phi_deg=90.0, kappa=0.2, programme="undrained", confine=0.05)
    found = follow_loop(parameters, ("diagonal",))
    peak = found.peak

    def slope(end):
        path = follow_loop(
            PolygonOptions(
                4, phi_deg=90.0, kappa=0.2, programme="undrained", confine=0.05, end=end
            ),
            ("diagonal",),
        ).path
        return path.P_rate[-1, 0] / path.H_rate[-1, 0]

    assert slope(peak["E1"] - 1e-5) > 0 > slope(peak["E1"] + 1e-5)


@pytest.mark.parametrize("programme", sorted({*get_args(ProgrammeName)} - {"proportional-strain"}))
def test_programmes_hold_what_they_say(programme):
    given = PolygonOptions(5, programme=programme, confine=0.05, end=0.12, phi_deg=25.0)
    found = follow_loop(given, ("diagonal",))
    path, A = found.path, found.marks["A"]
    H, P = path.H[A:], path.P[A:]
    area = (1 - H[:, 0]) * (1 - H[:, 3]) - H[:, 1] * H[:, 2]
    held = {
        "drained": P[:, 3] - P[0, 3],
        "cauchy-drained": P[:, 3] / (1 - H[:, 0]) - P[0, 3] / 0.95,
        "biaxial": P[:, 3] / (1 - H[:, 0]) - P[0, 3] / 0.95,
        "isotropic": H[:, 0] - H[:, 3],
        "isotropic-stress": P[:, 0] - P[:, 3],
        "oedometric": H[:, 3] - 0.05,
        "undrained": area - 0.95**2,
    }[programme]
    assert np.abs(held).max() < 1e-12
    assert path.status == "finished"
    assert H[-1, 0] == pytest.approx(0.12, abs=1e-12)


@pytest.mark.parametrize(("arguments", "word"), BAD)
def test_bad_parameters(arguments, word):
    with pytest.raises(InputError, match=word):
        PolygonOptions(**{"order": 4, **arguments})


def test_orders():
    assert orders_of("3-6,9") == (3, 4, 5, 6, 9)
    for text in ("", "6-3", "three", "3-9999999", "3..5"):
        with pytest.raises(InputError, match="--compare"):
            orders_of(text)
    with pytest.raises(InputError, match="--order"):
        ComparisonOptions((2, 3), PolygonOptions(3))


@pytest.mark.slow
def test_comparison(tmp_path, unsaved):
    shared = PolygonOptions(3, closure="traction", kappa=0.25, confine=0.05, end=0.2)
    summary = run_paths(ComparisonOptions((3, 4, 8), shared), tmp_path / "c")
    table = pd.read_parquet(tmp_path / "c" / "compare.parquet").set_index("order")
    critical = table["critical_strain_diagonal"]
    np.testing.assert_allclose(critical, [1.25 / 2.25, 0.2, 0.2], atol=1e-12)
    assert [loop["order"] for loop in summary["loops"]] == [3, 4, 8]
    curves = pd.read_parquet(tmp_path / "c" / "paths.parquet")
    assert set(curves["order"]) == {3, 4, 8}
    # A path without a way on is kept up to there, and where its contacts yield is told.
    end = curves[curves["order"] == 8].iloc[-1]
    assert table.loc[8, "status"] in ("control_limit", "no_solution")
    assert table.loc[8, "end_E1"] == end["E1"] >= table.loc[8, "first_yield_E1"]
    names = {file.name for file in (tmp_path / "c").iterdir()}
    assert {"critical_strain.png", "first_loss.png", "stress_strain.png"} <= names


def test_what_is_printed_and_tabled_of_a_large_loop_is_bounded(monkeypatch):
    found = follow_loop(PolygonOptions(6, confine=0.05, end=0.3), ("diagonal",))
    monkeypatch.setattr("studies.paths.followed.MOST_NUMBERS", 60)
    table = found.table
    ends = {0, found.marks["A"], len(found.path) - 1}
    assert 10 <= len(table["E1"]) == len(table["N"]) <= 13 < len(found.path)
    assert {found.E1[row] for row in ends} <= set(table["E1"])
    assert any("rows of the path" in note for note in found.summary()["notes"])
    place = {"subspace": None, "E2": 0.0, "s1": 0.0, "s2": 0.0, "contacts": [0, 1]}
    events = [{"kind": "yield", "E1": 0.1 + 0.001 * k, **place} for k in range(60)]
    (line,) = event_lines(events)
    assert "E1 = 0.10000000 to 0.15900000" in line and line.endswith("120 contacts")
    assert len(event_lines(events[:30])) == 30


# ---- unequal grains, other laws, loops of a snapshot


def test_unequal_radii_under_isotropic_strain():
    """N = (r_i + r_j) E over the mean diameter, whatever the shape, and P their virial."""
    radii = np.array([1.0, 0.8, 1.2, 0.9])
    given = PolygonOptions(4, radii=tuple(radii), confine=0.0, programme="isotropic", end=0.1)
    path = follow_loop(given, ("diagonal",)).path
    sides = (radii + np.roll(radii, -1)) / (2 * radii.mean())
    assert path.normal_force[-1] == pytest.approx(0.1 * sides, abs=1e-13)
    x = given.graph().x
    d, area = np.roll(x, -1, axis=0) - x, path.volume
    wanted = np.einsum("c,ci,cj->ij", 0.1 * sides / sides, d, d).ravel() / area
    assert path.P[-1] == pytest.approx(wanted, abs=1e-13)


SPHERES = 2 * (1 - 0.3) / (2 - 0.3)
LOST = SPHERES / (SPHERES + 2 / 3)


def spheres():
    ways = {"closure": "traction", "confine": 0.0, "programme": "isotropic", "end": 0.6}
    return PolygonOptions(5, kappa=SPHERES, contact_law="hertz", **ways)


def test_spheres_have_their_threshold():
    """That of Hertz-Mindlin contacts, by the root."""
    assert thresholds(spheres())["diagonal"] == pytest.approx(
        SPHERES / (SPHERES + 2 / 3), abs=1e-12
    )


@pytest.mark.slow
def test_spheres_reach_their_threshold_on_the_way():
    found = follow_loop(spheres(), ("diagonal",))
    lost = found.path.of_kind("det_Ks_zero")[0].index
    assert found.E1[lost] == pytest.approx(LOST, abs=1e-10)


def test_rolling_springs_give_free_spins_a_threshold():
    """That of blocked spins with 1/kt + l^2 cot^2(2 pi/n)/(4 k_r) in place of 1/kt, l = 1 - E."""
    given = PolygonOptions(5, spins="free", closure="traction", rolling=0.1, kappa=0.3)
    found = thresholds(given)["diagonal"]
    softer = 1 / (1 / 0.3 + (1 - found) ** 2 / np.tan(2 * np.pi / 5) ** 2 / 0.4)
    assert found == pytest.approx(softer / (1 + softer), abs=1e-10)


def test_a_loop_of_a_snapshot_starts_as_the_simulation_left_it():
    snapshot = read_snapshot(sample_path())
    loop = loop_of_snapshot(snapshot, 17)
    options = LoopOptions(5, confine=0.0, closure="traction", snapshot=snapshot, loop=17)
    path = follow_loop(options, ("diagonal",)).path
    length, kn = 2 * loop.graph.radii.mean(), loop.law.kn.mean()
    # Overlaps of the file hold the forces to some 1e-10 of the mean, by which grains are moved.
    assert options.taken[2] < 1e-13
    assert path.normal_force[0] * kn * length == pytest.approx(loop.graph.normal_force, rel=1e-9)
    assert path.shear_force[0] * kn * length == pytest.approx(loop.graph.shear_force, rel=1e-12)
    assert path.P[0] * kn == pytest.approx(love_weber_stress(loop.graph).ravel(), rel=1e-9)
    want = traction_tangent(loop.graph, loop.law).matrix
    assert path.A[0] * kn == pytest.approx(want, rel=1e-8, abs=1e-8 * kn)
    assert follow_loop(options).summary()["critical_strain"]["full"] is None


def test_rounded_positions_are_moved_until_they_fit_the_forces():
    """Positions of seven digits, overlaps of 1e-4: the forces stay, centres move by 1e-7."""
    snapshot = read_snapshot(sample_path())
    loop = loop_of_snapshot(snapshot, 17).graph
    wanted = loop.radii + np.roll(loop.radii, -1) - 1e-4 * loop.radii.mean()
    x = ring_of_lengths(loop.x.round(7), wanted)
    assert np.hypot(*(np.roll(x, -1, axis=0) - x).T) == pytest.approx(wanted, rel=1e-15)
    assert np.abs(x - loop.x).max() < 1e-3 * loop.radii.mean()


# ---- directions, parts of K, both sides of an event


@pytest.fixture(scope="module")
def pentagon():
    """A relaxed pentagon that ends with four contacts sliding."""
    given = PolygonOptions(5, kappa=0.3, phi_deg=20.0, closure="traction", end=0.3)
    return follow_loop(given, ("diagonal",))


def test_polar_diagrams_have_the_regimes_that_directions_activate(pentagon):
    """Unstable over 69 degrees of 360; with all contacts at yield sliding it would be 138."""
    end = pentagon.directions["end"]
    assert pentagon.degrees("end") == {
        "unstable_deg": pytest.approx(69.0452524, abs=1e-6), "none_deg": 0.0, "several_deg": 0.0
    }  # fmt: skip
    assert 360.0 * float(end.share.sliding) == pytest.approx(138.0905048, abs=1e-6)
    table = pd.DataFrame(pentagon.polar_table()).query("state == 'end'")
    assert 0.5 * (table["w2"] < 0.0).sum() == pytest.approx(69.0, abs=0.51)
    assert set(table["solutions"]) == {"unique"} and set(table["regime"]) == {"elastic", "sliding"}
    # Along every sixtieth direction the rates of the loop itself, from a search of its own.
    row, law = pentagon.marks["end"], pentagon.options.law()
    scene = Scene(pentagon.graph_at(row), law)
    for k in range(0, 720, 60):
        programme = proportional_strain(*end.diagram.direction[k])
        rates = rates_at(scene, programme, closure="traction", spins="blocked")
        P = rates.stress_rate.ravel()[[0, 3]]
        w2 = P @ end.diagram.direction[k] / np.linalg.norm(P)
        assert rates.status == "unique"
        assert end.diagram.work[k] == pytest.approx(w2, abs=1e-10)


def test_states_of_a_polygon_have_both_sides_of_the_first_yield(pentagon):
    summary = pentagon.summary()
    states = summary["states"]
    assert list(states) == ["I", "A", "B", "end"] and states["I"] is None
    path, row = pentagon.path, pentagon.marks["B"]
    for state, K in ((states["B"], pentagon.K[row]), (states["B"]["beyond"], pentagon.K[row + 1])):
        np.testing.assert_allclose(state["K"], K, rtol=0, atol=1e-12)
        np.testing.assert_allclose(state["Kmat"] + state["Kgeo"], K, rtol=0, atol=1e-12)
    assert states["B"]["verdict"]["diagonal"]["status"] == "stable"
    assert states["B"]["beyond"]["verdict"]["diagonal"]["status"] == "unstable"
    assert states["B"]["beyond"]["regime"].count("sliding") == 2 and path.regime[row].max() == 1
    *lines, _ = state_lines(summary)
    assert [line[:12].strip() for line in lines] == ["state A", "state B", "", "", "state end", ""]
    assert "arriving: stable in the normal strains (11, 22), no unstable" in lines[1]
    assert "going on" in lines[2] and "42.35 degrees wide" in lines[2]
    assert lines[-1].endswith("69.05 of 360 degrees of (11, 22) unstable")


def test_a_verdict_names_its_subspace():
    """Affine pentagons lose det Ks in all four components alone, at the first yield."""
    found = follow_loop(PolygonOptions(5, end=0.2))
    lost = {event.subspace for event in found.path.events if event.kind == "det_Ks_zero"}
    share = {name: column[-1] for name, column in found.subspaces.items()}
    assert lost == {"full"} and share["unstable_fraction_full"] > 0.0
    assert share["unstable_fraction_symmetric"] == share["unstable_fraction_diagonal"] == 0.0
    lines = state_lines(found.summary())
    before, after = lines[0], next(line for line in lines if line.startswith("state end"))
    assert before.endswith(": stable in the normal strains (11, 22), no unstable direction there")
    assert after.endswith("direction there; unstable in all four strain components")
    ax = draw_operators(found, "determinant", ax=axes_or_new(None))
    assert ax.get_ylabel() == "determinant in (11, 22) (–)"


def test_the_parts_of_K_are_those_of_the_paper():
    """Of a diamond (27), (28), sliding and with an added contact; of branches that follow H.

    Then the geometric part of a contact is `-N/l t(x)t + T/l n(x)t`.
    """
    for given in ({"table": 2}, {"table": 2, "contact_on_touch": "add"}):
        found = followed(**given)
        material, geometric = found.parts(found.graph_at(slice(None)))
        np.testing.assert_allclose(material, found.states.material, rtol=0, atol=2e-15)
        np.testing.assert_allclose(geometric, found.states.geometric, rtol=0, atol=2e-15)
    given = PolygonOptions(5, kappa=0.3, phi_deg=20.0, end=0.45)
    found = follow_loop(given, ("diagonal",))
    assert found.slides.any()
    graph, (_, geometric) = found.graph_at(len(found.path) - 1), found.split
    state, d0 = contact_state(graph), graph.reference_branches
    turn = -state.normal_force[:, None] * state.t + state.shear_force[:, None] * state.n
    blocks = np.einsum("ci,cj,c,ck,cl->ikjl", turn, state.t, 1 / state.length, d0, d0)
    wanted = restrict(blocks.reshape(4, 4) / found.path.volume, "diagonal")
    np.testing.assert_allclose(geometric[-1], wanted, rtol=0, atol=1e-14)


def test_stresses_say_the_area_that_they_are_over():
    """The rhombus of four grains, of which the paper takes twice the area."""
    polygon = follow_loop(PolygonOptions(4, end=0.2), ("diagonal",)).summary()
    diamond = summary_of(table=1)
    areas = [summary["reference_area"]["value"] for summary in (polygon, diamond)]
    assert areas == [pytest.approx(1.0, rel=1e-15), pytest.approx(2.0, rel=1e-15)]
    assert "polygon, an area of 1 l0^2" in state_lines(polygon)[-1]
    assert "L10 L20, twice the rhombus, an area of 2 l0^2" in state_lines(diamond)[-1]


def test_a_state_with_many_contacts_at_yield_has_no_directions():
    """More than 256 combinations of regimes are not tried: nine contacts, each slides or sticks."""
    how = {"closure": "traction", "confine": 0.0, "programme": "isotropic", "end": 0.05}
    given = PolygonOptions(9, kappa=0.3, phi_deg=20.0, **how)
    found = follow_loop(given, ("diagonal",))
    row, path = len(found.path) - 1, found.path
    slipping = 0.36397023426620234 * path.normal_force
    found = replace(found, path=replace(path, shear_force=slipping), marks={"end": row})
    assert found.directions == {} and found.degrees("end") is None
    assert len(found.polar_table()["w2"]) == 0
    assert state_lines(found.summary())[0].startswith("state end")
