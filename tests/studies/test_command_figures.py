"""What `gl.plot` draws of the figures of commands is what their tables hold."""

import sys

import numpy as np
import pandas as pd
import pytest
from matplotlib import pyplot
from matplotlib.figure import Figure
from PIL import Image

import grainloops as gl
from tests.command import run
from tests.packings import small_series


@pytest.fixture(scope="module")
def sample():
    return gl.read_snapshot(gl.sample_path())


def test_eigenvalues_and_orders_count_the_loops_of_the_table(sample):
    table = gl.loop_table(sample)
    titles = [ax.get_title() for ax in gl.plot.eigenvalues(sample).axes]
    for name, title in zip(("affine", "traction", "traction_free"), titles, strict=True):
        values = table[f"{name}_lambda_min"].dropna()
        assert f"{(values < 0).sum()} of {len(values)} unstable" in title
    ax = gl.plot.orders(sample, ax=Figure().add_subplot())
    heights = [bar.get_height() for bar in ax.containers[0]]
    shares = table["order"].value_counts(normalize=True).sort_index()
    np.testing.assert_allclose(heights, shares[shares > 0], rtol=1e-12)
    pyplot.close("all")


def test_chains_are_the_links_of_the_chains(sample):
    left = gl.plot.chains(sample).axes[0]
    assert len(left.collections[-1].get_segments()) == len(gl.force_chains(sample.graph).links)


def test_stress_and_strain_of_a_path_are_those_of_its_rows(sample):
    found = gl.evolve(gl.hold(sample), "drained", to=2e-5, rows=3)
    stress, volume = gl.plot.stress_strain(found).axes
    rows = gl.path_table(found.way)
    np.testing.assert_allclose(stress.lines[1].get_ydata(), rows["P22"] - rows["P22"][0])
    np.testing.assert_allclose(volume.lines[0].get_ydata(), rows["H11"] + rows["H22"])


def test_figures_of_a_series_are_drawn_from_its_folder(tmp_path):
    files = small_series(tmp_path / "in", 3)
    how = ("--out", tmp_path / "out", "--figures", "none", "--workers", 1)
    assert run("series", *files, *how) == 0
    evolution = pd.read_parquet(tmp_path / "out/evolution.parquet")
    ax = gl.plot.fates(tmp_path / "out", ax=Figure().add_subplot())
    born = (
        100
        * evolution["born"]
        / evolution[["survived", "split", "merged", "changed", "died"]].sum(axis=1)
    )
    np.testing.assert_allclose(ax.lines[-1].get_ydata(), born[1:])
    lines = gl.plot.stress_strain(tmp_path / "out").axes[0].lines
    np.testing.assert_allclose(lines[0].get_ydata(), evolution["S11"])
    skill = pd.read_parquet(tmp_path / "out/skill.parquet")
    targets = skill["target"].nunique()
    assert len(gl.plot.skill(tmp_path / "out").axes) > targets
    one = skill[skill["target"] == skill["target"].iloc[0]]
    assert len(gl.plot.skill(one).axes) >= 1
    with pytest.raises(gl.InputError, match="no column born"):
        gl.plot.fates(evolution.drop(columns="born"))


def test_an_indicator_of_your_own_is_a_line_of_the_figure(sample):
    table = gl.skill([(sample, sample)], lambda one: one.faces.order[one.faces.loops])
    names = [label.get_text() for label in gl.plot.skill(table).axes[0].get_yticklabels()]
    assert names == ["the indicator", "number of grains", "smallest force N"]


def test_animations_and_files_for_paraview_are_those_of_the_commands(sample, tmp_path):
    gl.animate([sample, sample], tmp_path / "moving")
    with Image.open(tmp_path / "moving/animation.gif") as moving:
        assert moving.n_frames == 2
    pytest.importorskip("vtkmodules")
    gl.write_snapshot(tmp_path / "grains.csv", sample)
    run(
        "snapshot", tmp_path / "grains.csv", "--vtk", "--figures", "none", "--out", tmp_path / "out"
    )
    gl.write_vtk(tmp_path / "own", gl.read_snapshot(tmp_path / "grains.csv"))
    names = {file.name for file in (tmp_path / "own").iterdir()}
    assert (
        names
        == {"loops.vtp", "contacts.vtp"}
        <= {file.name for file in (tmp_path / "out").iterdir()}
    )


def test_orders_are_drawn_without_forces_and_polar_axes_are_needed(sample):
    tables = sample.tables()
    pairs = {name: tables["contacts"][name] for name in ("id1", "id2")}
    bare = gl.snapshot_from_tables(grains=tables["grains"], contacts=pairs)
    assert gl.plot.orders(bare, ax=Figure().add_subplot()).get_ylabel() == "share of the loops (–)"
    with pytest.raises(gl.InputError, match="got no forces"):
        gl.plot.eigenvalues(bare)
    with pytest.raises(gl.InputError, match="expected polar axes"):
        gl.plot.polar(gl.probe(sample, 4, hold="strain"), ax=Figure().add_subplot())


def test_a_file_in_place_of_the_folder_is_refused_and_nothing_is_left(
    sample, tmp_path, monkeypatch
):
    (tmp_path / "taken").write_text("mine")
    for write in (
        lambda where: gl.write_vtk(where, sample),
        lambda where: gl.animate([sample], where),
    ):
        with pytest.raises(gl.InputError, match="got a file, expected a folder"):
            write(tmp_path / "taken")
        assert (tmp_path / "taken").read_text() == "mine"
    # Without the library nothing is made.
    monkeypatch.setitem(sys.modules, "vtkmodules.util.numpy_support", None)
    with pytest.raises(gl.InputError, match="vtk"):
        gl.write_vtk(tmp_path / "new", sample)
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]


def test_a_name_that_is_none_points_to_those_that_are():
    with pytest.raises(AttributeError, match="see eigenvalues"):
        _ = gl.plot.eigenvalue
    with pytest.raises(AttributeError, match="see animate"):
        _ = gl.gif
