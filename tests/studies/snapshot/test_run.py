import json
import shutil

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet
import pytest

from loops import (
    LinearFrictional,
    Regime,
    branch_vectors,
    find_faces,
    loop_batches,
    love_weber_stress,
    traction_tangent,
)
from patterns import read_snapshot, sample_cell, sample_path
from stability import restrict, symmetric_part
from studies.snapshot.quadrons import quadron_figure
from tests.command import run, run_snapshot
from tests.oracles.loop_balls import exact_tangent
from tests.oracles.rings import through
from tests.oracles.stability_fraction import imhof_in_doubles
from tests.patterns.snapshots.test_read_snapshot import CONTACTS, GRAINS, at, changed, write
from tests.unsaved import leave_files_empty

KEYS = [
    "loop",
    "order",
    "x",
    "y",
    "area",
    "perimeter",
    "elongation",
    "orientation",
    "sliding_contacts",
    "pressure",
    "deviator",
    "affine_lambda_min",
    "traction_lambda_min",
    "affine_unstable_fraction",
    "traction_unstable_fraction",
]
SUMMARY_KEYS = """grains contacts dangling_grains components vertices edges faces euler_ok
coordination loops orders mean_order area_sum stress sliding_fraction unstable_loops""".split()
FIGURES = ("map", "orders", "fabric", "chains", "eigenvalues")
FILES = {
    "loops.parquet",
    "orders.parquet",
    "fabric.parquet",
    "chains.parquet",
    "summary.json",
    "report.html",
    *(f"{name}.png" for name in FIGURES),
}
PERIODIC = sample_path("grains_periodic.parquet")
CELL = ",".join(repr(float(value)) for value in sample_cell().ravel())
SYMMETRIC = np.array([[1, 0, 0, 0], [0, 0, 0, 1], [0, 0.5**0.5, 0.5**0.5, 0]])


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """The command on the periodic sample, run once; its figures are not saved."""
    out = tmp_path_factory.mktemp("results") / "periodic"
    with pytest.MonkeyPatch.context() as patch:
        leave_files_empty(patch)
        assert run("snapshot", PERIODIC, "--cell", CELL, "--out", out, "--csv") == 0
    return out


def test_files_and_keys(results):
    tables = {f"{name}.csv" for name in ("loops", "orders", "fabric", "chains")}
    assert {path.name for path in results.iterdir()} == FILES | tables
    summary = json.loads((results / "summary.json").read_text())
    assert set(SUMMARY_KEYS) <= set(summary)
    assert list(summary) == sorted(summary)
    table = pd.read_parquet(results / "loops.parquet")
    assert set(KEYS) <= set(table.columns)
    assert len(table) == summary["loops"]
    assert (table["grains"].str.len() == table["order"]).all()
    csv = pd.read_csv(results / "loops.csv")
    np.testing.assert_allclose(csv[KEYS], table[KEYS], rtol=1e-15)


def test_summary_of_the_periodic_sample(results):
    """Counts by an independent tool of the sample's makers, and exact relations."""
    s = json.loads((results / "summary.json").read_text())
    assert (s["grains"], s["contacts"], s["wall_contacts"]) == (2000, 2682, 0)
    assert s["vertices"] + s["dangling_grains"] == s["grains"]
    assert s["euler_ok"]
    assert s["vertices"] - s["edges"] + s["faces"] == 2 * (s["components"] - 1)
    assert sum(s["orders"].values()) == s["loops"]
    assert s["mean_order"] == pytest.approx(s["mean_order_from_coordination"], rel=1e-12)
    area = np.linalg.det(sample_cell())
    assert s["area_sum"] == pytest.approx(area, rel=1e-12)
    expected = np.array(json.loads(sample_path("macro.json").read_text())["stress"])
    np.testing.assert_allclose(s["stress"], expected, rtol=0, atol=1e-12 * expected.max())
    assert (s["untrusted_loops"]["affine"], s["untrusted_loops"]["traction"]) == (0, 0)
    assert s["provenance"]["configuration"]["cell"] == sample_cell().ravel().tolist()


def test_unstable_loops_count_the_tables_negative_eigenvalues(results):
    summary = json.loads((results / "summary.json").read_text())
    table = pd.read_parquet(results / "loops.parquet")
    orders = pd.read_parquet(results / "orders.parquet")
    assert not [name for name in orders.columns if name.endswith("unstable_fraction")]
    for closure in ("affine", "traction", "traction_free"):
        known = table[table[f"{closure}_lambda_min"].notna()]
        share = (known[f"{closure}_lambda_min"] < 0).groupby(known["order"]).mean()
        found = {n: one for n, one in summary["unstable_loops"][closure].items() if one is not None}
        assert found == {str(n): pytest.approx(value) for n, value in share.items()}
        column = orders.set_index("order")[f"{closure}_unstable_loops"].dropna()
        assert found == {str(n): value for n, value in column.items()}
    for closure in ("affine", "traction"):
        share = (table[f"{closure}_lambda_min"] < 0).groupby(table["order"]).mean()
        found = summary["unstable_loops"][closure]
        assert found == {str(n): pytest.approx(value) for n, value in share.items()}
        unstable = table[f"{closure}_lambda_min"] < 0
        assert ((table[f"{closure}_unstable_fraction"] > 0) == unstable).all()
    assert (table["traction_lambda_min"] < 0).sum() == 7


def test_free_spins_beside_blocked_ones(results, capsys):
    """Cut out of its packing every known loop of five and more is unstable, none of three."""
    table = pd.read_parquet(results / "loops.parquet")
    smallest, order = table["traction_free_lambda_min"], table["order"]
    snapshot = read_snapshot(PERIODIC, cell=sample_cell())
    natural = np.full(len(table), np.nan)
    faces = find_faces(snapshot.graph)
    for batch in loop_batches(snapshot.graph, faces):
        own, regime = snapshot.law.take(batch.contacts), snapshot.regime[batch.contacts]
        tangent = traction_tangent(batch.graph, own, spins="free", regime=regime)
        trusted = np.isfinite(tangent.matrix[:, 0, 0])
        values = np.full(len(trusted), np.nan)
        Ks = symmetric_part(restrict(tangent.matrix[trusted], "symmetric"))
        values[trusted] = np.linalg.eigvalsh(Ks)[:, 0]
        values[np.abs(values) <= tangent.error] = np.nan
        natural[np.searchsorted(faces.loops, batch.face)] = values / np.mean(snapshot.law.kn)
    np.testing.assert_allclose(smallest, natural, rtol=1e-9, atol=1e-12)
    assert (smallest[(order == 3) & smallest.notna()] > 0).all()
    assert (smallest[(order >= 5) & smallest.notna()] < 0).all()
    ordered = ("traction_free_lambda_min", "traction_free_lambda_mid", "traction_free_lambda_max")
    known = table.loc[smallest.notna(), list(ordered)].to_numpy()
    assert (np.diff(known, axis=1) >= 0).all()
    assert run("snapshot", PERIODIC, "--cell", CELL, "--out", results / "again",
               "--no-figures") == 0  # fmt: skip
    said = capsys.readouterr().out
    assert "no grain is allowed to rotate" in said
    assert "cut out of its packing" in said
    shutil.rmtree(results / "again")


def test_table_against_fifty_digits(results):
    """Rows drawn at random, and every unstable one: traction operator by 50-digit arithmetic."""
    snapshot = read_snapshot(PERIODIC, cell=sample_cell())
    graph, mean_kn = snapshot.graph, float(np.mean(snapshot.law.kn))
    table = pd.read_parquet(results / "loops.parquet")
    number = {grain: k for k, grain in enumerate(snapshot.ids.tolist())}
    contact = {}
    for c, (i, j) in enumerate(graph.contacts.tolist()):
        contact[i, j], contact[j, i] = (c, 1), (c, -1)
    rng = np.random.default_rng(1)
    short = table["order"] <= 7
    rows = [
        *rng.choice(np.flatnonzero(short), 6, replace=False),
        *np.flatnonzero(short & (table["traction_lambda_min"] < 0)),
    ]
    inverse = np.linalg.inv(sample_cell())
    length = np.hypot(*branch_vectors(graph).T)
    reach = graph.radii[graph.contacts].sum(axis=1)
    for row in rows:
        members = [number[grain] for grain in table["grains"][row]]
        x, picked = [graph.x[members[0]]], []
        for i, j in zip(members, members[1:] + members[:1], strict=True):
            c, _ = contact[i, j]
            picked.append(c)
            step = graph.x[j] - graph.x[i]
            x.append(x[-1] + step - sample_cell() @ np.rint(inverse @ step))
        # Spins blocked, Yade's increment over the radii is a factor of kt.
        kt = (snapshot.law.kt * reach / length)[picked]
        law = LinearFrictional(snapshot.law.kn[picked], kt, 0.5)
        loop = through(x[:-1], graph.normal_force[picked], graph.shear_force[picked])
        a = exact_tangent(loop, law, snapshot.regime[picked])
        k = SYMMETRIC @ a @ SYMMETRIC.T / mean_kn
        spectrum = np.linalg.eigvalsh(0.5 * (k + k.T))
        scale = np.abs(spectrum).max()
        assert abs(table["traction_lambda_min"][row] - spectrum[0]) < 1e-11 * scale
        share = table["traction_unstable_fraction"][row]
        assert share == pytest.approx(imhof_in_doubles(spectrum), abs=1e-9)
        slides = np.count_nonzero(snapshot.regime[picked] == Regime.SLIDING)
        assert table["sliding_contacts"][row] == slides


def test_half_shared_pressures_make_the_samples(results):
    """Area-weighted mean pressure of the loops against the sample's, dangling contacts aside."""
    snapshot = read_snapshot(PERIODIC, cell=sample_cell())
    table = pd.read_parquet(results / "loops.parquet")
    faces = find_faces(snapshot.graph)
    assert len(faces.loops) == len(table)
    kept = np.isin(np.arange(snapshot.graph.contact_count), faces.contacts)
    graph = snapshot.graph
    network = graph.replace(
        normal_force=np.where(kept, graph.normal_force, 0.0),
        shear_force=np.where(kept, graph.shear_force, 0.0),
    )
    expected = np.trace(love_weber_stress(network)) / 2
    mean = np.average(table["pressure"], weights=table["area"])
    assert mean == pytest.approx(expected, rel=1e-12)


def test_json_on_stdout(tmp_path, capsys):
    arguments = ("--out", tmp_path / "r", "--json", "--no-figures")
    assert run("snapshot", write(tmp_path), *arguments) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((tmp_path / "r" / "summary.json").read_text())
    assert printed["orders"] == {"4": 1}
    # One square of side 1, areas and stress by hand: sum f (x) d over the polygon's area.
    assert printed["area_sum"] == pytest.approx(1.0)
    d = np.array([[1, 0], [0, -1], [-1, 0], [0, -1]])
    f = np.array([[2.0, 0.2], [0.3, -3.0], [-4.0, -0.4], [-0.5, -5.0]])
    np.testing.assert_allclose(printed["stress"], f.T @ d, rtol=1e-14)


def test_provenance_is_in_every_table(results):
    for name in ("loops", "orders", "fabric"):
        metadata = pyarrow.parquet.read_schema(results / f"{name}.parquet").metadata
        assert json.loads(metadata[b"grainloops"])["command"] == "grainloops snapshot"


@pytest.mark.slow
def test_provenance_is_in_every_figure(tmp_path):
    run_snapshot(PERIODIC, tmp_path / "out", cell=sample_cell().ravel())
    for name in FIGURES:
        assert b"grainloops snapshot" in (tmp_path / "out" / f"{name}.png").read_bytes()


# The first contact again, with another force.
TWICE = {k: [*v, v[0] + (k == "fn")] for k, v in CONTACTS.items()}
BAD = [
    ({"grains": changed(GRAINS, radius=None)}, "column 'radius'"),
    ({"grains": at(GRAINS, "x", 1, float("nan"))}, "column 'x'"),
    ({"grains": at(at(GRAINS, "x", 1, 0.0), "y", 1, 0.0)}, "grains 10 and 11"),
    ({"contacts": at(CONTACTS, "id1", 0, 5)}, "grain 5"),
    ({"grains": at(GRAINS, "radius", 0, -1.0)}, "radius of grain 10"),
    ({"contacts": TWICE}, "row 5 and row 0 (grains 10 and 11)"),
    ({"contacts": {k: v[4:] for k, v in CONTACTS.items()}}, "no contact between grains"),
]


@pytest.mark.parametrize(("tables", "word"), BAD)
def test_bad_input_gives_one_line_and_writes_nothing(tmp_path, capsys, tables, word):
    path, out = write(tmp_path, **tables), tmp_path / "out"
    before = sorted(tmp_path.iterdir())
    assert run("snapshot", path, "--out", out) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert captured.err.startswith("grainloops: ")
    assert word in captured.err
    assert sorted(tmp_path.iterdir()) == before


def test_crossing_branches_are_named(tmp_path, capsys):
    diagonal = 0.5**0.5
    extra = {
        "id1": [10, 11],
        "id2": [12, 13],
        "nx": [diagonal, -diagonal],
        "ny": [diagonal, diagonal],
        "fn": [1.0, 1.0],
        "fsx": [0.0, 0.0],
        "fsy": [0.0, 0.0],
        "kn": [1.0, 1.0],
        "ks": [1.0, 1.0],
        "mu": [0.5, 0.5],
        "sliding": [0, 0],
    }
    contacts = {name: [*values, *extra[name]] for name, values in CONTACTS.items()}
    path = write(tmp_path, contacts=contacts)
    assert run("snapshot", path, "--out", tmp_path / "out") == 2
    message = capsys.readouterr().err
    assert "1 pair of crossing branches" in message
    assert "10-12" in message
    assert "11-13" in message
    assert not (tmp_path / "out").exists()

    # On request the lighter one goes; its mate closes two triangles.
    contacts["fn"][-1] = 0.5
    path = write(tmp_path, contacts=contacts)
    arguments = ("--out", tmp_path / "out", "--drop-crossings", "--no-figures")
    assert run("snapshot", path, *arguments) == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["orders"] == {"3": 2}
    assert summary["contacts"] == 5
    assert "of grains 11-13" in " ".join(summary["notes"])


def test_without_forces_the_geometry_comes_out(tmp_path, capsys):
    path = write(tmp_path, contacts=changed(CONTACTS, fn=None, fsx=None, fsy=None, kn=None))
    assert run("snapshot", path, "--out", tmp_path / "out", "--no-figures") == 0
    assert "no contact forces" in capsys.readouterr().out
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["orders"] == {"4": 1}
    absent = ("stress", "sliding_fraction", "unstable_loops", "mean_kn")
    assert not set(absent) & set(summary)
    columns = pd.read_parquet(tmp_path / "out" / "loops.parquet").columns
    assert "area" in columns
    assert not [name for name in columns if "lambda" in name or "pressure" in name]


def test_several_instants_and_column_maps(tmp_path, capsys):
    path = write(tmp_path, grains={("px" if k == "x" else k): v for k, v in GRAINS.items()})
    arguments = ("snapshot", path, "--out", tmp_path / "out", "--no-figures")
    assert run(*arguments) == 2
    assert "--columns x=COLUMN" in capsys.readouterr().err
    assert run(*arguments, "--columns", "x=px", "--frame", "-1") == 0
    assert {file.name for file in (tmp_path / "out").iterdir()} == {
        *("chains.parquet", "loops.parquet", "orders.parquet", "summary.json")
    }
    for wrong in ("x", "x=", "x=px,x=y", "=px"):
        assert run(*arguments, "--force", "--columns", wrong) == 2
        assert "--columns" in capsys.readouterr().err


def test_results_are_never_lost(tmp_path, capsys):
    path, out = write(tmp_path), tmp_path / "out"
    out.mkdir()
    (out / "notes.txt").write_text("mine")
    assert run("snapshot", path, "--out", out) == 2
    assert "--force" in capsys.readouterr().err
    assert [file.name for file in out.iterdir()] == ["notes.txt"]
    assert run("snapshot", path, "--out", out, "--force", "--no-figures") == 0
    plain = {"chains.parquet", "loops.parquet", "orders.parquet", "summary.json"}
    assert {file.name for file in out.iterdir()} == plain | {"notes.txt"}
    before = (out / "summary.json").read_bytes()
    # A failing run with --force leaves what was there.
    broken = write(tmp_path, contacts=at(CONTACTS, "id1", 0, 5))
    assert run("snapshot", broken, "--out", out, "--force") == 2
    assert (out / "summary.json").read_bytes() == before
    assert run("snapshot", path, "--out", path, "--force") == 2
    assert not [file for file in tmp_path.iterdir() if file.name.startswith(".")]


def test_wrong_usage_is_one_line(capsys):
    for arguments in (["snapshot"], ["nothing"], ["snapshot", "--kn", "abc", "x", "--out", "y"]):
        assert run(*arguments) == 2
        assert capsys.readouterr().err.count("\n") == 1
    assert run("snapshot", "grains.csv", "--out", "y", "--cell", "1,2") == 2
    assert "--cell: got '1,2'" in capsys.readouterr().err
    assert run() == 0
    assert "snapshot" in capsys.readouterr().out


def test_a_snapshot_without_loops_still_gives_its_counts(tmp_path):
    chain = {name: values[:2] for name, values in CONTACTS.items()}
    out = tmp_path / "out"
    assert run("snapshot", write(tmp_path, contacts=chain), "--out", out) == 0
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["loops"], summary["mean_order"], summary["stress"]) == (0, None, None)
    assert summary["dangling_grains"] == 4


def test_the_page_holds_the_figures_and_the_map(results):
    text = (results / "report.html").read_text(encoding="utf-8")
    assert text.count("data:image/png;base64,") == 5
    assert "<title>Loops of grains_periodic.parquet</title>" in text
    assert 'id="map-data-0"' in text
    assert "Love-Weber" in text


def test_table_is_a_plain_arrow_table(results):
    schema = pyarrow.parquet.read_schema(results / "loops.parquet")
    assert pa.types.is_integer(schema.field("order").type)
    assert pa.types.is_floating(schema.field("traction_lambda_min").type)


def test_quadrons_of_a_snapshot(tmp_path):
    out = tmp_path / "out"
    run_snapshot(sample_path(), out, quadrons=True, figures=False)
    table, loops = (pd.read_parquet(out / f"{name}.parquet") for name in ("quadrons", "loops"))
    area = table.groupby("loop")["area"].sum()
    np.testing.assert_allclose(area, loops["area"], rtol=1e-12)
    assert (table.groupby("loop").size() == loops["order"]).all()
    assert table["relative_area"].mean() == pytest.approx(1.0, rel=1e-12)
    summary = json.loads((out / "summary.json").read_text())
    assert summary["quadrons"]["count"] == len(table) == loops["order"].sum()
    figure = quadron_figure({name: table[name].to_numpy() for name in table})
    assert [ax.get_xlabel() for ax in figure.axes][1] == "loop order (number of grains)"
