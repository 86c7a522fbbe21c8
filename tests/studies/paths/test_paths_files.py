"""What the diamond study writes: tables, summary and figures."""

import json
from dataclasses import replace

import matplotlib.image
import numpy as np
import pandas as pd
import pyarrow.parquet
import pytest
from matplotlib.figure import Figure

from loops import find_faces
from patterns import read_snapshot
from studies.paths.figures import (
    draw_cone,
    draw_operators,
    draw_polar,
    draw_stress,
    overlaps,
)
from studies.paths.followed import operator_diagram
from studies.paths.options import DiamondOptions
from studies.paths.run import run_paths
from studies.style import STYLE
from tests.conftest import leave_undrawn
from tests.studies.paths.followed import followed, summary_of
from tests.unsaved import leave_files_empty

EVENT_KEYS = {
    "kind", "E1", "E2", "alpha_deg", "s1", "s2", "N", "T", "det_K", "det_Ks"
}  # fmt: skip
STATE_KEYS = {
    "E1", "E2", "alpha_deg", "l", "N", "T", "s1", "s2", "det_K", "det_Ks", "regime",
    "K", "Kmat", "Kgeo", "Ks", "eigenvalues_K", "eigenvalues_Ks", "cone", "gaps", "verdict",
    "generic", "work", "stored", "dissipated", "directions",
}  # fmt: skip
SUMMARY_KEYS = {
    "parameters", "states", "events", "end", "model", "verification", "reference_area",
    "added_contact", "figures", "notes", "definitions", "provenance",
}  # fmt: skip
COLUMNS = {
    "stage", "regime", "E1", "E2", "alpha_deg", "l", "N", "T", "s1", "s2",
    *(f"{name}{ij}" for name in ("K", "Kmat", "Kgeo") for ij in ("11", "12", "21", "22")),
    "det_K", "det_Ks", "lambda_1", "lambda_2", "eigenvalue_1_real", "eigenvalue_1_imag",
    "eigenvalue_2_real", "eigenvalue_2_imag", "status", "cone_status", "cone_edge_1_deg",
    "cone_edge_2_deg", "cone_axis_deg", "cone_opening_deg", "unstable_fraction", "gap_1", "gap_2",
    "chord_1", "chord_2", "loading_alphaE_deg", "w2_loading", "work", "stored", "dissipated",
}  # fmt: skip
FIGURES = (
    "path_dependence", "axial_stress", "determinant", "eigenvalues", "split", "cone", "polar",
    "loop_A",
)  # fmt: skip
FILES = {
    "summary.json", "report.html", "path.parquet", "polar.parquet", "path_dependence.parquet",
    "grains_A.parquet", "contacts_A.parquet",
    *(f"{name}.png" for name in FIGURES),
}  # fmt: skip


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The study of both tables, written once; figures of Table 1 alone, which are not saved."""
    folder = tmp_path_factory.mktemp("diamond")
    with pytest.MonkeyPatch.context() as patch:
        leave_files_empty(patch)
        found = {1: (folder / "1", run_paths(DiamondOptions(table=1), folder / "1"))}
    with pytest.MonkeyPatch.context() as patch:
        leave_undrawn(patch)
        found[2] = folder / "2", run_paths(DiamondOptions(table=2), folder / "2")
    return found


@pytest.mark.parametrize("table", [1, 2])
def test_files(written, table):
    folder, summary = written[table]
    tables = {name for name in FILES if name.endswith((".json", ".html", ".parquet"))}
    assert {file.name for file in folder.iterdir()} == (FILES if table == 1 else tables)
    read = json.loads((folder / "summary.json").read_text())
    assert set(read) - {"files"} == SUMMARY_KEYS
    assert set(read["states"]) == {"I", "A", "B"}
    assert set(read["states"]["B"].pop("beyond")) < STATE_KEYS
    assert all(set(state) == STATE_KEYS for state in read["states"].values())
    assert set(read["figures"].values()) <= set(FIGURES)
    assert all(set(event) == EVENT_KEYS for event in read["events"])
    assert read["events"] == summary["events"]
    assert read["parameters"]["table"] == table


def test_tables_carry_rows_and_provenance(written):
    folder, summary = written[2]
    table = pyarrow.parquet.read_table(folder / "path.parquet")
    assert set(table.column_names) == COLUMNS
    assert json.loads(table.schema.metadata[b"grainloops"]) == summary["provenance"]
    polar = pyarrow.parquet.read_table(folder / "polar.parquet").to_pandas()
    assert polar.groupby("state").size().to_dict() == {"I": 720, "A": 720, "B": 720}
    radius = np.hypot(polar["x"], polar["y"])
    np.testing.assert_allclose(radius, 2.0 + polar["w2"], rtol=1e-14)


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """Table 1 with its figures."""
    folder = tmp_path_factory.mktemp("saved") / "1"
    run_paths(DiamondOptions(table=1), folder)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("name", FIGURES)
def test_figures_are_drawn_and_say_what_made_them(saved, name):
    image = matplotlib.image.imread(saved / f"{name}.png")
    assert min(image.shape[:2]) > 600
    assert 0.01 < np.mean(image[..., :3].min(axis=-1) < 0.9) < 0.6
    data = (saved / f"{name}.png").read_bytes()
    assert b"grainloops diamond" in data and b"alpha0_deg" in data


def test_loop_at_A_is_a_snapshot(written):
    folder, summary = written[2]
    snapshot = read_snapshot(folder / "grains_A.parquet")
    A = summary["states"]["A"]
    np.testing.assert_allclose(snapshot.graph.normal_force, A["N"], rtol=1e-15)
    assert find_faces(snapshot.graph).order[find_faces(snapshot.graph).loops].tolist() == [4]


def test_shear_forces_survive_the_way_through_a_snapshot(tmp_path):
    path = followed(table=2)
    signs = np.array([1.0, -1.0, 1.0, -1.0])
    sheared = replace(path.path, shear_force=0.01 * signs + 0.0 * path.path.shear_force)
    path = replace(path, path=sheared)
    for name, columns in path.snapshot("A").items():
        pd.DataFrame(columns).to_csv(tmp_path / f"{name}.csv", index=False)
    shear = read_snapshot(tmp_path / "grains.csv").graph.shear_force
    np.testing.assert_allclose(shear, [0.01, -0.01, 0.01, -0.01], rtol=1e-14)


def test_opposite_grains_overlap_from_the_event_on():
    """The band begins where they touch, and ends where the note says that they separate."""
    for table, parted in ((1, None), (2, 0.295383)):
        path, summary = followed(table=table), summary_of(table=table)
        bands = overlaps(path.E1, np.minimum(*path.gaps))
        touch = {e["E1"] for e in summary["events"] if e["kind"] == "opposite_contact"}
        assert [first for first, _ in bands] == pytest.approx(sorted(touch), abs=1e-14)
        assert bands[-1][1] == path.E1[-1]
        if parted is not None:
            assert f"separate at E1 = {parted}" in "".join(summary["notes"])
            assert bands[0][1] == pytest.approx(parted, abs=5.1e-7)


def test_drawing_functions_use_the_axes_they_are_given():
    path = followed(table=1)
    before = {key: matplotlib.rcParams[key] for key in STYLE}
    for draw in (
        lambda ax: draw_operators(path, "determinant", ax=ax),
        lambda ax: draw_operators(path, "eigenvalues", ax=ax),
        lambda ax: draw_stress(path, ax=ax),
        lambda ax: draw_cone(path, ax=ax),
        lambda ax: draw_polar(operator_diagram(path.K[-1]), ax=ax),
    ):
        ax = Figure().add_subplot()
        assert draw(ax) is ax
        assert ax.has_data()
        assert ax.get_xlabel() and ax.get_ylabel()
        assert draw(None) is not ax
    assert {key: matplotlib.rcParams[key] for key in STYLE} == before
