"""Every result of the front door: its table is the command's, its figure is on the page, units."""

import inspect
import re
from functools import partial
from io import BytesIO

import numpy as np
import pandas as pd
import pytest
from matplotlib import pyplot
from matplotlib.legend import Legend
from matplotlib.text import Text

import grainloops as gl
from loops import Regime
from loops.shown import Shown
from patterns import Snapshot, write_snapshot
from stability import Path
from tests.command import run
from tests.packings import LAW, jammed

NO_FIGURES = ("--figures", "none", "--shear-increment", "radii")
PROGRAMME = ("--programme", "oedometric", "--to", -2e-3, "--interval", 1e-4, "--rows", 4)
PROGRAMME_HERE = {"to": -2e-3, "interval": 1e-4, "rows": 4}
SLOWLY = ("--inertial-number", 1e-4)
STAGE = gl.Stage("oedometric", "H11", 1e-4)


@pytest.fixture(scope="module")
def state(tmp_path_factory):
    """Two files of a jammed packing of 24 grains; between them it is strained."""
    graph, folder = jammed(24, 3, LAW), tmp_path_factory.mktemp("state")
    n = graph.contact_count
    law = gl.LinearFrictional(np.ones(n), np.full(n, 0.5), np.full(n, 0.5), "radii")
    for k, stretch in enumerate(([1.0, 1.0], [1.0001, 0.9999])):
        cell = graph.cell * np.array(stretch)[:, None]
        moved = graph.replace(x=graph.x * stretch, cell=cell)
        regime = np.full(n, Regime.ELASTIC, dtype=np.int8)
        write_snapshot(
            folder / f"grains_{k}.parquet", Snapshot(moved, law, regime, np.arange(24), 0, ())
        )
    return [folder / f"grains_{k}.parquet" for k in (0, 1)]


@pytest.fixture(scope="module")
def answers(state):
    """Results of the front door by name."""
    before = gl.read_snapshot(state[0], shear_increment="radii")
    loop, loops = gl.loop(before, 3), gl.loops_of(before)
    tangents = gl.loop_tangents(before, closure="traction", faces=before.faces)
    scene = before.scene
    pentagon = gl.Scene(gl.regular_polygon(5, strain=0.1), gl.LinearFrictional(1.0, 0.2, 0.0875))
    evolved = gl.evolve(before, "oedometric", **PROGRAMME_HERE)
    replayed = gl.evolve(before, "oedometric", by="replay", inertial_number=1e-4, **PROGRAMME_HERE)
    sustained = gl.sustain(before, 1, largest=1e-4, interval=1e-4, spread=False)
    drained = gl.Stage("drained_biaxial", "H11", 0.3)
    with pytest.MonkeyPatch.context() as patch:
        few = partial(gl.loop_domain, directions=9)
        patch.setattr("studies.one_loop.loop_domain", few)
        study = gl.study(pentagon)
    return {
        "snapshot": before,
        "scene": scene,
        "loop": loop,
        "graph": loop.graph,
        "check": gl.check(before),
        "stress": gl.stress(before),
        "fabric": gl.fabric(before),
        "faces": gl.find_faces(before),
        "chains": gl.force_chains(before),
        "contacts": gl.contact_state(before),
        "tangent": gl.traction_tangent(loop),
        "tangents": tangents,
        "verdict": gl.judge(gl.traction_tangent(loop), "symmetric"),
        "cone": gl.plane_cone(gl.restrict(tangents, "diagonal")),
        "control": gl.destabilising_control(gl.restrict(gl.traction_tangent(loop), "diagonal")),
        "work": gl.directional_work(loop, directions=np.eye(2), closure="traction"),
        "loop_path": gl.follow(pentagon, drained, closure="affine"),
        "loop_rates": gl.rates_at(pentagon, "drained_biaxial", closure="affine"),
        "domain": gl.loop_domain(pentagon, "traction", directions=9),
        "study": study,
        "rates": gl.rates_at(scene, H=[[1e-3, 0], [0, 0]]),
        "packing_path": gl.follow(scene, STAGE, closure="packing", rows=2),
        "replay": gl.replay(scene, [[1e-6, 0], [0, 0]], duration=1.0),
        "probe": gl.probe(before, 8),
        "held": gl.hold(scene),
        "evolved": evolved,
        "way": evolved.way,
        "replayed": replayed,
        "replayed_way": replayed.way,
        "sustained": sustained,
        "load_path": sustained.paths[0],
        "forecast": gl.forecast(
            before, "oedometric", spread=False, inertial_number=1e-4, **PROGRAMME_HERE
        ),
        "material_loops": loops,
        "march": gl.march(gl.LoopMaterial(loops, None, None, "traction"), STAGE, 5),
    }  # fmt: skip


# Their numbers have a figure elsewhere, or none.
NO_FIGURE = {
    *("check", "stress", "faces", "chains", "contacts", "verdict", "cone", "control", "work"),
    *("loop_rates", "rates", "material_loops"),
}
# Counts and words alone.
NO_UNITS = {"snapshot", "scene", "loop", "graph", "check", "faces", "chains", "material_loops"}
UNIT = re.compile(r"force|length|strain|rad|°|unit of K")


def test_every_kind_of_result_is_walked(answers):
    returned = {
        kind.split("[")[0].strip()
        for one in map(gl.__getattr__, gl.__all__)
        if inspect.isfunction(one)
        for kind in str(inspect.signature(one).return_annotation).split("|")
    }
    kinds = {one.__name__ for one in subclasses(Shown)} & returned
    walked = {type(one).__name__ for one in answers.values()}
    # Of a series, in test_kinetics.py.
    assert len(kinds) > 20 and kinds - walked == {"OrderKinetics"}


def test_numbers_that_a_path_does_not_have_are_refused_by_name(answers):
    refused = set()
    for name, path in answers.items():
        if type(path) is Path:
            for each in dir(Path):
                try:
                    getattr(path, each)
                except gl.InputError as error:
                    assert str(error).startswith(("K: ", f"{each}: "))
                    refused.add((name, each))
    names = {each for _, each in refused}
    assert {"K", "det_K", "eigenvalues", "energy_error", "balance_error", "state"} <= names


def subclasses(kind):
    return {one for own in kind.__subclasses__() for one in (own, *subclasses(own))}


def off_the_page(figure):
    """Words, keys and axes that leave the page; numbers beyond the end of an axis aren't drawn."""
    figure.savefig(BytesIO(), dpi=figure.dpi)
    drawn = figure.canvas.get_renderer()
    keys = [one for one in figure.findobj(Legend) if one.get_visible()]
    words = [text for key in keys for text in key.findobj(Text)]
    for ax in figure.axes:
        ends = [ax.xaxis.get_view_interval(), ax.yaxis.get_view_interval()]
        words += [ax.title, ax.xaxis.label, ax.yaxis.label, *ax.texts]
        for axis, (low, high) in zip((ax.xaxis, ax.yaxis), map(sorted, ends), strict=True):
            shown = [tick for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
            words += [tick.label1 for tick in shown]
    boxes = [one.get_window_extent(drawn) for one in (*keys, *figure.axes)]
    boxes += [text.get_window_extent(drawn) for text in words
              if text.get_text().strip() and text.get_visible()]  # fmt: skip
    width, height = figure.bbox.size
    return [box.extents for box in boxes
            if box.x0 < -1 or box.y0 < -1 or box.x1 > width + 1 or box.y1 > height + 1]  # fmt: skip


def test_figures_are_on_the_page_one_after_another(answers, monkeypatch):
    """As in a script: no axes are given, and `savefig` cuts nothing off."""
    figures = {}
    monkeypatch.setitem(pyplot.rcParams, "figure.max_open_warning", len(answers))
    for name, result in answers.items():
        if name in NO_FIGURE:
            with pytest.raises(gl.InputError, match="a result with a figure"):
                result.plot()
            continue
        figure = result.plot().figure
        assert pyplot.gcf() is figure, name
        # Paths stand over one another, others each in a figure.
        assert figure not in figures or type(result).__name__ in ("Path", "MaterialPath"), name
        figures[figure] = name
    for figure, name in figures.items():
        assert not off_the_page(figure), name
        # A layout that fails leaves next to nothing of the axes.
        assert figure.axes[0].get_position().width > 0.3, name


@pytest.mark.parametrize("name", ["loop", "rose", "domain", "cone", "envelope", "map", "sustained"])
def test_keys_stay_on_the_page_of_any_figure(answers, name):
    """Of figures without a layout that pyplot or the caller made."""
    own = answers
    draw = {
        "loop": lambda **how: gl.plot.loop(own["loop"], **how),
        "rose": lambda **how: gl.plot.rose(own["snapshot"], **how),
        "domain": lambda **how: gl.plot.domain(own["domain"], **how),
        "cone": lambda **how: gl.plot.cone(own["tangent"], **how),
        "envelope": lambda **how: gl.plot.envelope(own["loop"], closure="traction", **how),
        "map": lambda **how: gl.plot.map(own["snapshot"], "pressure", **how),
        "sustained": own["sustained"].plot,
    }[name]
    figure = pyplot.figure(figsize=(3.4, 4.2))
    assert draw().figure is figure and not off_the_page(figure)
    polar = {"projection": "polar"} if name in ("rose", "sustained") else {}
    figure = pyplot.figure()
    draw(ax=figure.add_subplot(**polar))
    assert not off_the_page(figure)


def test_current_axes_serve_while_they_are_empty(answers):
    """Polar axes take the place of others; what is there is never drawn over."""
    snapshot, path = (answers[name] for name in ("snapshot", "loop_path"))
    figure, (left, right) = pyplot.subplots(1, 2)
    assert gl.plot.rose(snapshot).figure is figure
    assert figure.axes[0] is left and figure.axes[-1].name == "polar" and right not in figure.axes
    pyplot.sca(left)
    assert gl.plot.path(path) is left and gl.plot.path(path) is left
    assert gl.plot.map(snapshot).figure is not figure
    other = gl.plot.map(snapshot, "order")
    assert gl.plot.path(path).figure is not other.figure


def test_whole_numbers_have_a_colour_each(answers):
    snapshot = answers["snapshot"]
    ax = gl.plot.map(snapshot, "order")
    same = gl.plot.map(snapshot)
    for one in (ax, same):
        bar = one.figure.axes[-1]
        assert [text.get_text() for text in bar.get_yticklabels()] == "3 4 5 6 7 8+".split()
    count = gl.loop_table(snapshot)["sliding_contacts"].to_numpy()
    ax = gl.plot.map(snapshot, np.arange(len(count)) % 4, "number")
    assert ax.figure.axes[-1].get_yticks().tolist() == [0, 1, 2, 3]
    assert ax.collections[0].cmap.N == 4


def test_the_line_names_the_units(answers):
    for name, result in answers.items():
        line = repr(result)
        assert len(line) < 300 and "\n" not in line, name
        assert UNIT.search(line) or name in NO_UNITS, line


def test_a_table_has_a_row_an_entry(answers):
    for name, result in answers.items():
        table = result.table()
        assert isinstance(table, pd.DataFrame) and len(table) and not table.columns.has_duplicates
        assert not any(re.fullmatch(r"(matrix|strain|A)_\d+", key) for key in table), name
    tangents = answers["tangents"]
    table = tangents.table()
    np.testing.assert_array_equal(table["A11_22"], tangents.matrix[:, 0, 3])
    np.testing.assert_array_equal(table["error"], tangents.error)
    held = answers["held"]
    (row,) = held.table().to_dict("records")
    assert (row["stress12"], row["status"]) == (held.stress[0, 1], "at rest")


# ---- the tables are those of the commands


COMMANDS = {
    "snapshot": ("snapshot", "loops"),
    "probe": ("probe", "probe", "--directions", 8),
    "sustained": ("sustain", "sustain", "--directions", 1, "--largest", 1e-4, "--interval", 1e-4,
                  "--no-spread", "--workers", 1),
    "evolved": ("evolve", "loops", *PROGRAMME),
    "replayed": ("evolve", "loops", *PROGRAMME, "--by", "replay", *SLOWLY),
    "forecast": ("forecast", "loops", *PROGRAMME, *SLOWLY, "--no-spread"),
    "march": ("material", "path", "--programme", "oedometric", "--end", 1e-4, "--steps", 5),
    "check": ("check", "findings"),
}  # fmt: skip
# Tables beside them, in the same folder: that of another result.
BESIDE = {"evolved": ("way", "path"), "replayed": ("replayed_way", "path"),
          "sustained": ("load_path", "paths"), "march": ("material_loops", "loops")}  # fmt: skip
# What a command says of its files, sets and directions, which a single result is one of.
NAMED_BY_THE_COMMAND = {"check": ["path", "snapshot"], "march": ["set"], "paths": ["theta_deg"]}


@pytest.mark.parametrize("name", COMMANDS)
def test_the_table_is_the_commands(name, answers, state, tmp_path):
    command, table, *options = COMMANDS[name]
    figures = NO_FIGURES if command != "check" else NO_FIGURES[2:]
    asked = (command, state[0], *options, *figures, "--out", tmp_path / "out")
    assert run(*asked) == 0
    for result, file in ((name, table), *([BESIDE[name]] if name in BESIDE else [])):
        written = pd.read_parquet(tmp_path / "out" / f"{file}.parquet")
        if name == "march" and file == "path":
            written = written[written["set"] == "mean"]
        extra = NAMED_BY_THE_COMMAND.get(file, []) + NAMED_BY_THE_COMMAND.get(name, [])
        assert_same(answers[result].table(), written.drop(columns=extra, errors="ignore"))


def assert_same(table, written):
    """Columns, values and bits; lists of a file are arrays."""
    assert [*table] == [*written]
    for key in table:
        values, stored = (
            [tuple(one) if isinstance(one, np.ndarray | list) else one for one in frame[key]]
            for frame in (table, written)
        )
        same = [a == b or (a != a and b != b) for a, b in zip(values, stored, strict=True)]
        assert all(same), (key, values, stored)


def test_loops_in_their_packing_are_those_of_the_command(answers, state, tmp_path):
    asked = ("--in-packing", "auto", *NO_FIGURES, "--out", tmp_path / "out")
    assert run("snapshot", state[0], *asked) == 0
    written = pd.read_parquet(tmp_path / "out" / "loops.parquet")
    assert_same(gl.loop_table(answers["snapshot"], in_packing=True), written)


@pytest.mark.slow
def test_the_domain_is_that_of_the_command(answers, state, tmp_path):
    """Lengths over l0 and stresses over kn there: within rounding."""
    asked = ("--loop", 3, "--closure", "traction", "--directions", 3, *NO_FIGURES)
    assert run("domain", "--snapshot", state[0], *asked, "--out", tmp_path / "d") == 0
    written, snapshot = pd.read_parquet(tmp_path / "d/boundary.parquet"), answers["snapshot"]
    table, kn = gl.loop_domain(answers["loop"], "traction", directions=3), snapshot.mean_kn
    rows = table.table().assign(s1=lambda one: one.s1 / kn, s2=lambda one: one.s2 / kn)
    pd.testing.assert_frame_equal(rows, written, check_exact=False, rtol=1e-12, atol=1e-15)


def test_what_became_of_loops_is_that_of_the_command(state, tmp_path):
    """Files of a series name the snapshots too."""
    asked = ("--workers", 1, *NO_FIGURES, "--out", tmp_path / "out")
    assert run("series", *state, *asked) == 0
    before, after = (gl.read_snapshot(path, shear_increment="radii") for path in state)
    pairs = {"fates": gl.fates, "increments": gl.increments}
    for name, ask in pairs.items():
        written = pd.read_parquet(tmp_path / "out" / name / "part-00000-00001.parquet")
        table = ask(before, after)
        assert_same(
            table, written.drop(columns=["snapshot_before", "snapshot_after"], errors="ignore")
        )
        assert len(table) > 10
