"""`docs/first-steps.md`: its blocks run, print what stands below them, and are as short as said."""

import base64
import io
import os
import re
import runpy
import sys
from itertools import pairwise
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from matplotlib import pyplot
from PIL import Image

import grainloops as gl
from loops import contact_forces
from studies import cli
from tests.docs.pages import page

TEXT = page("first-steps")
BLOCK = re.compile(r"```python\n(.*?)```(?:\n```text\n(.*?)```)?", re.DOTALL)
# Statements that do the task, its printed line aside.
LINES = {
    "Read a snapshot": 1,
    "A table of loops": 1,
    "One loop: tangent, verdict, cone, plot": 4,
    "The eigenvalues of all pentagons": 2,
    "The loops of a grain": 1,
    "Second-order work on a map, in your own axes": 2,
    "The drained path of a pentagon": 3,
    "A contact law of your own": 10,
    "A loop by hand, its forces from its overlaps": 4,
    "networkx": 1,
    "Arrays in, a snapshot out, and back": 2,
    "A table of several snapshots, and a plot": 5,
    "The smallest eigenvalue by order, at three stiffness ratios": 7,
    "A cohesive law in a path and in a snapshot": 10,
    "Fates of the unstable loops": 3,
    "Strain, stress and work of each loop": 1,
    "The envelope of a snapshot": 1,
    "A loop of seven given grains": 3,
}


def sections():
    return {part.split("\n")[0]: BLOCK.findall(part) for part in TEXT.split("\n## ")}


@pytest.fixture(scope="module")
def session():
    """Names of the page after all its blocks, and what each printed."""
    names, printed = {}, []
    lines = []
    names["print"] = lambda *said, sep=" ": lines.append(sep.join(map(str, said)))
    for blocks in sections().values():
        for code, said in blocks:
            lines.clear()
            exec(compile(code, "first-steps.md", "exec"), names)
            # As after a cell of a notebook.
            pyplot.close("all")
            printed.append((code, "\n".join(lines), said.rstrip("\n")))
    return names, printed


def test_every_block_prints_what_stands_below_it(session):
    for code, found, said in session[1]:
        assert found == said, code


def test_the_tasks_are_as_short_as_said():
    found = sections()
    assert found.keys() >= LINES.keys()
    for title, most in LINES.items():
        lines = [line for line in found[title][0][0].splitlines() if line.strip()]
        task = [
            line
            for line in lines
            if not line.startswith(("print(", "law, ", "pentagon =", "own = "))
        ]
        assert len(task) <= most, title


def test_the_lines_for_the_shell_are_options_of_the_commands():
    """One command each, and no option that its help does not know."""
    lines = re.findall(r"^- `grainloops (.*?)`", TEXT.split("## From the shell")[1], re.MULTILINE)
    assert len(lines) == 3
    for line in lines:
        command, *words = line.split()
        arguments = cli.app[command].assemble_argument_collection()
        known = {name for argument in arguments for name in argument.names}
        for word in words:
            assert not word.startswith("--") or word in known, line


@pytest.mark.slow
def test_the_page_runs_as_a_notebook_with_its_pictures(tmp_path, monkeypatch):
    """Cells of its results show a table, cells of its plots a picture; none prints an error."""
    nbclient = pytest.importorskip("nbclient")
    nbformat = pytest.importorskip("nbformat")
    builder = runpy.run_path(str(Path(__file__).parents[2] / "docs/site/notebooks.py"))
    book = nbformat.reads(builder["notebook"](builder["cells_of_page"](TEXT)), as_version=4)
    own = nbformat.v4.new_code_cell("gl.plot.map(snapshot)\nsnapshot")
    book.cells.append(own)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, sys.path)))
    monkeypatch.delenv("MPLBACKEND", raising=False)  # the kernel's own draws into the notebook
    nbclient.NotebookClient(book, timeout=300, kernel_name="python3").execute()
    shown = {}
    for cell in book.cells:
        if cell.cell_type == "code":
            kinds = [kind for out in cell.outputs for kind in out.get("data", {})]
            assert not [out for out in cell.outputs if out.output_type == "error"]
            for plot in re.findall(r"gl\.plot\.\w+|(?<!gl)\.plot\(", cell.source):
                shown.setdefault(plot, []).append("image/png" in kinds)
    assert shown.keys() >= {"gl.plot.map", "gl.plot.loop", "gl.plot.cone", "gl.plot.path",
                            "gl.plot.envelope", ".plot("}  # fmt: skip
    assert all(all(pictures) for pictures in shown.values()), shown
    rich = {kind: out["data"][kind] for out in book.cells[-1].outputs for kind in out["data"]}
    assert rich["text/html"].startswith("<table><caption>Snapshot</caption>")
    picture = Image.open(io.BytesIO(base64.b64decode(rich["image/png"])))
    # A map of loops, not an empty sheet: many colours, few of them white.
    pixels = np.asarray(picture.convert("RGB")).reshape(-1, 3)
    assert min(picture.size) > 300 and (pixels != 255).any(axis=1).mean() > 0.3


def test_pentagons_are_those_of_the_table(session):
    names = session[0]
    table = names["table"][names["table"]["order"] == 5]
    columns = [f"traction_lambda_{which}" for which in ("min", "mid", "max")]
    scaled = names["pentagons"] / names["snapshot"].law.kn.mean()
    # Eigenvalues over kn, of order one: rounding alone is between them.
    np.testing.assert_allclose(scaled, table[columns].to_numpy(), rtol=0, atol=1e-13)


def test_work_is_the_component_of_the_tangents(session):
    names = session[0]
    assert (names["work"] == names["tangents"].matrix[:, 3, 3]).all()


def test_a_grain_is_in_its_loops_and_in_no_other(session):
    names = session[0]
    faces, snapshot = names["snapshot"].faces, names["snapshot"]
    held = [
        number for number, face in enumerate(faces.loops)
        if 17 in snapshot.ids[faces.grains[faces.offsets[face] : faces.offsets[face + 1]]]
    ]  # fmt: skip
    assert names["of_grain"]["loop"].tolist() == held


def test_the_cone_in_turned_axes_holds_the_softest_mode(session):
    names = session[0]
    K = gl.restrict(names["turned"], "diagonal")
    smallest = np.linalg.eigvalsh(0.5 * (K + K.T))[0]
    whole = names["verdict"].symmetric_eigenvalues[0]
    # The softest mode is diagonal in its own axes: the plane holds its eigenvalue.
    assert smallest == pytest.approx(whole, rel=1e-9)


def test_the_law_with_the_first_power_is_the_linear_one(session):
    names = session[0]
    pentagon = gl.regular_polygon(5, strain=0.1)
    linear = gl.LinearFrictional(kn=1.0, kt=0.2, mu=0.3)
    first = names["Power"](k=1.0, kt=0.2, mu=0.3, m=1.0)
    paths = [
        gl.follow(gl.Scene(pentagon, law), names["drained"], closure="affine")
        for law in (linear, first)
    ]
    np.testing.assert_allclose(paths[0].P[-1], paths[1].P[-1], rtol=1e-12, atol=1e-15)
    # Five equal contacts under isotropic strain, the power 3/2: P = n N l0 / (2 V0).
    area = 5 / (4 * np.tan(np.pi / 5))
    assert names["own"].P[0, 0] == pytest.approx(5 * 2 * 0.1**1.5 / (2 * area), rel=1e-12)


def test_plots_draw_into_the_axes_that_they_are_given(session):
    names = session[0]
    figure = matplotlib.figure.Figure()
    for ax, plot, arguments in zip(
        figure.subplots(1, 5),
        (gl.plot.map, gl.plot.loop, gl.plot.cone, gl.plot.path, gl.plot.envelope),
        (
            *((names["snapshot"],), (names["loop"].graph,), (names["tangent"],), (names["path"],)),
            (names["loop"].graph, names["loop"].law, "traction"),
        ),
        strict=True,
    ):
        assert plot(*arguments, ax=ax) is ax
        assert ax.get_xlabel() and ax.get_ylabel()
    figure.canvas.draw()


def test_without_axes_a_plot_is_pyplots_current_figure(session):
    """`plt.show`, `plt.savefig` and notebooks find it; a second plot goes into the same axes."""
    names = session[0]
    ax = gl.plot.map(names["snapshot"])
    assert pyplot.gca() is ax and pyplot.gcf() is ax.figure
    # The map's own size, where no figure was open.
    assert ax.figure.get_size_inches().tolist() == [4.2, 4.2]
    pyplot.close("all")
    own = pyplot.figure(figsize=(3.0, 2.0))
    assert gl.plot.path(names["path"]).figure is own
    curves = len(pyplot.gca().lines)
    assert gl.plot.path(names["path"]).figure is own
    assert len(pyplot.gca().lines) == 2 * curves
    assert own.get_size_inches().tolist() == [3.0, 2.0]


def test_an_envelope_is_what_each_direction_answers():
    """P' = A H' where all contacts stick; at yield W2 = P'.H' of the directional analysis."""
    loop, law = gl.regular_polygon(5, strain=0.1), gl.LinearFrictional(kn=1.0, kt=0.3, mu=0.2)
    theta = np.linspace(0.0, 2.0 * np.pi, 361)
    e = np.stack([np.cos(theta), np.sin(theta)], axis=1)
    K = gl.restrict(gl.affine_tangent(loop, law), "diagonal")
    for line in gl.plot.envelope(loop, law, "affine").lines[:2]:
        np.testing.assert_allclose(line.get_xydata(), e @ K.T, atol=1e-14)
    at_yield = loop.replace(shear_force=0.2 * loop.normal_force * [1, -1, 1, -1, 1])
    envelope = gl.plot.envelope(at_yield, law, "affine", ax=pyplot.figure().add_subplot())
    answer = envelope.lines[1].get_xydata()
    work = gl.directional_work(at_yield, law, e, closure="affine").work[:, 0]
    np.testing.assert_allclose((answer * e).sum(axis=1), work, atol=1e-14)


def test_signed_values_have_zero_in_the_middle_of_the_colours(session):
    names = session[0]
    smallest = names["table"]["traction_lambda_min"]
    figure = gl.plot.map(names["snapshot"], smallest).figure
    low, high = figure.axes[0].collections[0].get_clim()
    assert low < 0 < high
    assert figure.axes[0].collections[0].norm(0.0) == 0.5


def test_keys_of_a_path_are_symbols_and_words(session):
    path = session[0]["path"]
    for y, label, key in (
        (("P11", "P22"), "$P_{}$ (force/length)", ["$P_{11}$", "$P_{22}$", "yield"]),
        ("det_Ks", r"$\det K_s$", [r"$\det K_s$", "yield"]),
        (("N_0", "T_0"), "$N_{}$ (force)", ["$N_{0}$", "$T_{0}$", "yield"]),
        ("external_work", "external work", ["external work", "yield"]),
    ):
        ax = gl.plot.path(path, y=y, ax=matplotlib.figure.Figure().subplots())
        assert ax.get_xlabel() == "$H_{11}$ (–)"
        assert ax.get_ylabel() == label
        assert [text.get_text() for text in ax.get_legend().get_texts()] == key


def test_wrong_arguments_of_plots_are_named(session):
    names = session[0]
    with pytest.raises(gl.InputError, match=r"values: got shape \(3,\), expected shape"):
        gl.plot.map(names["snapshot"], [1.0, 2.0, 3.0])
    with pytest.raises(gl.InputError, match="column: got 'nothing'"):
        gl.plot.path(names["path"], y="nothing")
    batch = gl.regular_polygon(5, strain=[0.1, 0.2])
    with pytest.raises(gl.InputError, match=r"graph: got batch axes \(2,\)"):
        gl.plot.loop(batch)


def test_what_the_door_shows_tells_itself_in_a_line(session):
    names = session[0]
    told = {name: getattr(gl, name).__doc__ or "" for name in gl.__all__ if name != "__version__"}
    assert not [name for name, text in told.items() if ">>>" not in text]
    for name in ("snapshot", "loop", "tangent", "tangents", "verdict", "path", "square"):
        assert len(repr(names[name])) < 250
        assert names[name]._repr_html_().startswith("<table><caption>")
    assert len(repr(names["snapshot"].faces)) < 250


def test_the_force_of_a_contact_is_drawn_from_centre_to_centre(session):
    loop = session[0]["loop"].graph
    ax = gl.plot.loop(loop)
    ends = [path.vertices for path in ax.collections[2].get_paths()]
    np.testing.assert_array_equal(ends, loop.x[loop.contacts])


def test_the_key_of_a_loop_tells_its_forces(session):
    """Widths and arrows are in proportion to the force that the key names."""
    loop = session[0]["loop"].graph
    ax = gl.plot.loop(loop)
    said = [text.get_text() for text in ax.get_legend().get_texts()]
    forces = np.hypot(loop.normal_force, loop.shear_force)
    assert f"contact force, widest: {forces.max():.3g} force units" in said
    widest = ax.get_legend().get_lines()[said.index(said[-2])].get_linewidth()
    width = ax.collections[2].get_linewidths()
    np.testing.assert_allclose(width, widest * forces / forces.max(), rtol=1e-12)
    force = contact_forces(loop)
    outside = np.zeros_like(loop.x)
    np.add.at(outside, loop.contacts[:, 0], force)
    np.add.at(outside, loop.contacts[:, 1], -force)
    arrows = ax.collections[3]
    length = np.hypot(arrows.U, arrows.V) / arrows.scale
    moved = np.linalg.norm(outside, axis=1) > 1e-12 * forces.max()
    share = np.linalg.norm(outside[moved], axis=1) / forces.max()
    diameters = float(said[-1].split()[2])
    assert said[-1].endswith(f"long: {forces.max():.3g} force units")
    expected = diameters * 2 * loop.radii.mean() * share
    np.testing.assert_allclose(length, expected, rtol=1e-12)


def test_curves_of_a_path_are_those_of_a_dense_one():
    """Cubics through 20 rows against 800, none across a jump; the slopes of P are the path's own.

    Between rows h apart a cubic errs by h^4 times the fourth derivative over 384, one whose slopes
    are estimated by h^3.
    """
    pentagon, law = gl.regular_polygon(5, strain=0.1), gl.LinearFrictional(1.0, 0.2, 0.0875)
    stage = gl.Stage(gl.programmes.drained_biaxial(), "H11", 0.46)
    path, dense = (
        gl.follow(gl.Scene(pentagon, law), stage, rows=rows, closure="affine") for rows in (0, 800)
    )
    assert len(path) < 25 < 800 < len(dense)
    exact = dense.columns()
    for name, tolerance in (("P11", 2e-6), ("det_Ks", 1e-3)):
        line = gl.plot.path(path, y=name, ax=pyplot.figure().add_subplot()).lines[0]
        x, y = (np.asarray(values, dtype=float) for values in line.get_data())
        assert np.count_nonzero(np.isnan(y)) == 1 + len(np.unique(
            [event.index for event in path.events if event.kind in ("yield", "opening")]
        ))  # fmt: skip
        turns = [
            0,
            *np.flatnonzero((np.diff(dense.regime, axis=0) != 0).any(axis=1)) + 1,
            len(dense),
        ]
        seen = 0
        for first, last in pairwise(turns):
            at, values = (np.asarray(exact[key])[first:last] for key in ("H11", name))
            # Either run finds the events to rounding.
            inside = (x > at[0] + 1e-9) & (x < at[-1] - 1e-9)
            seen += np.count_nonzero(inside)
            error = np.abs(y[inside] - np.interp(x[inside], at, values)).max()
            assert error < tolerance * np.ptp(exact[name])
        assert seen > 200
