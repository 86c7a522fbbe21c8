"""Blocks of code of every page: which test runs them, and those that no page's own test runs."""

import ast
import importlib.util
import json
import re
import shlex
import shutil
import sys
import types
from inspect import signature

import numpy as np
import pytest

import grainloops as gl
from patterns.snapshots import yade_export
from studies.cli import app
from tests.docs.pages import DOCS
from tests.patterns.snapshots.yade.test_export import stand_in
from tests.patterns.snapshots.yade_samples import BOX, PERIODIC
from tests.stability.packing.walled_packings import small_sample

ROOT = DOCS.parent
PAGES = {
    path.relative_to(DOCS).with_suffix("").as_posix(): path.read_text()
    for path in sorted(DOCS.rglob("*.md"))
    if "gallery" not in path.parts
} | {"../README": (ROOT / "README.md").read_text()}
# Fenced blocks of a page: (language, text).
FENCED = {
    name: re.findall(r"^```([^\n]*)\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    for name, text in PAGES.items()
}
CODE = ("python", "sql", "json")
LAW = gl.LinearFrictional(1.0, 0.5, 0.5)
# The test file that runs the code of a page, and what it takes as its sample.
TESTED = {
    "accuracy": "test_how_to",  # the sample of the package, and one loop of it
    "adding": "test_how_to",  # a ring and the sample of the package
    "benchmark": "test_benchmark_page",  # two snapshots of the slow series
    "evidence/probing": "test_blocks",  # in a cell and between walls
    "fabric": "test_how_to",  # in a cell, between walls, cut out, the sample of the package
    "first-steps": "test_first_steps",  # the sample of the package
    "forecast": "test_how_to",  # in a cell, between walls; cut out it is refused
    "formats": "test_blocks",  # in a cell, between walls, cut out
    "index": "test_blocks",  # the diamond
    "input-error": "test_blocks",  # the sample of the package
    "larger-loops": "test_how_to",  # a hexagon
    "material": "test_blocks",  # hexagons, and loops of three kinds of samples
    "one-loop": "test_blocks",  # in a cell, between walls, cut out
    "packing": "test_how_to",  # in a cell, between walls, cut out
    "packing-paths": "test_how_to",  # the same; cut out it is refused
    "probing": "test_how_to",
    "published": "test_blocks",  # three discs
    "questions": "test_blocks",  # the sample of the package
    "series": "test_how_to",  # two snapshots of the slow series
    "sustaining": "test_how_to",
    "symbols": "test_blocks",  # a triangle, a pentagon, a loop of the sample of the package
    "yade": "test_blocks",  # a stand-in for Yade with its own saves, in a cell and between walls
    "../README": "test_readme",
}
# Pages with lines that are input or output of other programs.
OTHERS = {"lammps"}
# The first words of lines for a shell.
SHELL = ("grainloops", "python", "pip", "make", "git", ". ", "dask", "NUMBA_", "SAMPLE=")
BLANK = re.compile(r"HXX,HXY,HYX,HYY|LX,0,0,LY")


def blocks(name, language="python"):
    return [code for kind, code in FENCED[name] if kind == language]


def lines(name):
    """Lines for a shell of a page: those of its blocks without a language, and indented ones."""
    fenced = "\n".join(code for kind, code in FENCED[name] if kind in ("", "sh"))
    text = re.sub(r"^```.*?^```", "", PAGES[name], flags=re.DOTALL | re.MULTILINE)
    indented = re.findall(r"^ {4}((?:grainloops|python|pip|dask|NUMBA).*)$", text, re.MULTILINE)
    return [line.strip() for line in (*fenced.splitlines(), *indented) if line.strip()]


COMMANDS = sorted(
    {
        (name, line.split("  #")[0].strip())
        for name in PAGES
        for line in lines(name)
        if line.startswith(("grainloops ", "python -m "))
    }
)


def test_the_code_of_every_page_has_a_test_that_runs_it():
    """A new block goes to a test, its page to the list above."""
    with_code = {name for name, found in FENCED.items() if any(kind in CODE for kind, _ in found)}
    assert with_code == TESTED.keys()
    for name, file in TESTED.items():
        folder = ROOT / "tests" if file == "test_readme" else ROOT / "tests" / "docs"
        text = (folder / f"{file}.py").read_text()
        assert name.removeprefix("../") in text or name == "evidence/probing", name


def test_every_line_for_a_shell_is_one_that_is_known():
    """Lines of `grainloops` and `python -m` are looked at below, those of others named above."""
    unknown = {
        name: [line for line in lines(name) if not line.startswith(SHELL)]
        for name in PAGES.keys() - OTHERS
    }
    assert {name: found for name, found in unknown.items() if found} == {}
    assert len(COMMANDS) > 40


@pytest.mark.parametrize(("name", "line"), COMMANDS)
def test_commands_of_the_pages_are_commands(name, line):
    command, *words = shlex.split(BLANK.sub("1,0,0,1", line))
    if command == "python":
        module = words[1]
        assert module == "tests" or importlib.util.find_spec(module) is not None
        return
    if words[0] in ("--version", "--install-completion"):
        return
    # Alone, `--in-packing` of a series means the rates.
    line = re.sub(r"(series .*--in-packing)(?! events)", r"\1=rates", " ".join(words))
    app.parse_args(shlex.split(line), exit_on_error=False, print_error=False)


def test_the_diamond_of_the_landing_page_is_unstable_in_the_cone_of_its_quadratic_form(capsys):
    names = {}
    exec("\n".join(blocks("index")), names)
    verdict, opening = capsys.readouterr().out.strip().splitlines()
    assert verdict.startswith("unstable")
    K = gl.restrict(names["tangent"], "diagonal")
    # Second-order work vanishes at E2 = t E1.
    t = np.roots([K[1, 1], K[0, 1] + K[1, 0], K[0, 0]])
    ends = np.degrees(np.arctan(t)) % 180.0
    assert float(opening) == pytest.approx(np.ptp(ends), rel=1e-12)


@pytest.mark.parametrize("name", ["evidence/probing", "questions"])
def test_blocks_that_ask_a_snapshot_run(name, capsys):
    names = {"snapshot": small_sample("cell", LAW)}
    exec("\n".join(blocks(name)), names)
    said = capsys.readouterr().out
    assert "at rest" in said if "held" in names else said.startswith("unstable")


@pytest.mark.parametrize("ends", ["walls", "outline"])
def test_the_block_on_held_states_runs_between_walls_or_asks_for_them(ends):
    names = {"snapshot": small_sample(ends, LAW)}
    (code,) = blocks("evidence/probing")
    if ends == "walls":
        exec(code, names)
        assert names["held"].status == "at rest"
    else:
        with pytest.raises(gl.InputError, match="walls"):
            exec(code, names)


def test_the_block_on_three_discs_says_what_the_page_says(capsys):
    names = {}
    exec("\n".join(blocks("published")), names)
    said = capsys.readouterr().out
    assert said.startswith("family")
    # The ends of the line: one contact slides alone, by the sum that the table has.
    assert names["found"].families[0].corners.max() == pytest.approx(1.56124648, abs=5e-9)
    assert "any two slips with the sum 1.56124648" in PAGES["published"]


@pytest.mark.slow
def test_shares_of_certain_signs_are_those_of_the_page():
    names = {}
    exec("\n".join(blocks("input-error")), names)
    rows = re.findall(r"^\| (\d+) % \| (.*) \|$", PAGES["input-error"], re.MULTILINE)
    assert [row[0] for row in rows] == ["1", "3", "10", "30"]
    for force, told in rows:
        table = gl.loop_table(names["snapshot"], input_error=int(force) / 100)
        error = table["traction_error"] + table["traction_input_error"]
        certain = table["traction_lambda_min"].abs() > error
        by_order = certain.groupby(table["order"].clip(upper=8)).mean()
        shown = [float(x) for x in told.replace(" %", "").split(" | ")]
        np.testing.assert_allclose(shown[:1], 100 * certain.mean(), atol=0.051)
        np.testing.assert_allclose(shown[1:], 100 * by_order, atol=0.51)
        if force == "1":
            moved = table["traction_input_error"] / table["traction_lambda_min"].abs()
            assert 1e-6 < moved.median() < 2e-5
    assert f"Of the {len(table)} loops" in PAGES["input-error"]


@pytest.mark.slow
def test_the_matrices_of_the_page_on_symbols_are_what_its_code_finds():
    sp, names = pytest.importorskip("sympy"), {}
    exec("\n".join(blocks("symbols")), names)
    page = re.sub(r"\s+", " ", PAGES["symbols"])
    for name, matrix in (("A", "A"), ("S", "S"), ("K", "K"), ("K", "K5")):
        wanted = f"{name} = {sp.latex(names[matrix])} "
        assert re.sub(r"\s+", " ", wanted.replace(r"\\", "\\\\ ")) in page
    (shown,) = re.findall(r"A/l = \\left\[\\begin{matrix}(.*?)\\end", PAGES["symbols"], re.DOTALL)
    rows = [[float(x) for x in row.split("&")] for row in shown.split("\\\\")]
    length = next(iter(names["A5"].free_symbols))
    known = np.array(names["A5"] / length, dtype=float)
    np.testing.assert_allclose(rows, known, atol=5e-5)
    difference = np.linalg.inv(names["C"]) - names["known"]
    assert np.abs(difference).max() < 1e-9 * np.abs(names["known"]).max()
    # Twice kn, and kn + kt - N/l, times the tangent of 180/n degrees.
    l, kn, kt, N = (sp.Symbol(name, real=True) for name in ("l", "kn", "kt", "N"))  # noqa: E741
    for K, factor in ((names["K"], sp.sqrt(3)), (names["K5"], sp.sqrt(5 - 2 * sp.sqrt(5)))):
        plane = ((K + K.T) / 2).extract([0, 3], [0, 3])
        for way, value in (((1, 1), 2 * kn), ((1, -1), kn + kt - N / l)):
            vector = sp.Matrix(way)
            assert sp.simplify(plane * vector - factor * value * vector) == sp.zeros(2, 1)


def test_the_block_on_a_material_runs():
    names = {}
    exec("\n".join(blocks("material")), names)
    response = names["response"]
    shapes = [response.stress.shape, response.tangent.shape, response.regimes.shape]
    assert shapes == [(1000, 2, 2), (1000, 2, 2, 2, 2), (1000, 3)]
    assert np.array_equal(names["fe"].stress, -response.stress)


@pytest.mark.parametrize("ends", ["cell", "walls", "outline"])
def test_loops_of_any_sample_are_a_material_as_the_page_says(ends):
    (call,) = re.findall(r"`gl\.loops_of\((snapshot.*?)\)`", PAGES["material"])
    given = eval(f"gl.loops_of({call})", {"gl": gl, "snapshot": small_sample(ends, LAW)})
    material = gl.LoopMaterial(given, closure="traction")
    assert np.isfinite(material.update(np.eye(2)[None], material.start(1)).stress).all()


@pytest.mark.parametrize("ends", ["cell", "walls", "outline"])
def test_the_file_beside_the_grains_is_read(tmp_path, ends):
    """Cell and shear increment of the block of `formats.md`, beside a sample of each kind."""
    sample = small_sample(ends, LAW)
    gl.write_snapshot(tmp_path / "grains_05.csv", sample)
    (code,) = blocks("formats", "json")
    told = json.loads(code)
    cell = sample.graph.cell
    told["cell"] = None if cell is None else cell.tolist()
    for given in ("radii", "branch"):
        (tmp_path / "cell_05.json").write_text(json.dumps({**told, "shear_increment": given}))
        found = gl.read_snapshot(tmp_path / "grains_05.csv")
        assert found.law.shear_increment == given
        assert (found.graph.cell is None) == (cell is None)
        assert cell is None or np.array_equal(found.graph.cell, cell)


@pytest.mark.parametrize("ends", ["cell", "walls", "outline"])
def test_blocks_on_one_loop_run_wherever_a_sample_ends(ends):
    """Loops of four in place of hexagons, and a domain of nine programmes."""
    code = "\n".join(blocks("one-loop"))
    for whole, small in (
        ("gl.read_snapshot(gl.sample_path())", "sample"),
        ("order == 6", "order == 4"),
        ('gl.loop_domain(loop, "traction")', 'gl.loop_domain(loop, "traction", directions=9)'),
    ):
        assert code.count(whole) == 1
        code = code.replace(whole, small)
    names = {"sample": small_sample(ends, LAW)}
    exec(code, names)
    assert len(names["domain"].rows) == 9 and names["path"].status != "lost"
    assert names["ax"].get_title() == "" and len(names["ax"].lines) > 1


@pytest.mark.parametrize("folder", [BOX, PERIODIC], ids=lambda folder: folder.name)
@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")
def test_the_script_of_yade_writes_tables_that_are_read(tmp_path, monkeypatch, folder):
    """Engines are stand-ins that keep what they are given; the runner's command is run."""
    module = types.ModuleType("yade")
    monkeypatch.setitem(sys.modules, "yade", module)
    monkeypatch.chdir(tmp_path)
    shutil.copy(yade_export.__file__, tmp_path)
    module.O = stand_in(folder)
    kept = {}

    def engine(name):
        return lambda *given, **named: kept.setdefault(name, (given, named))

    script = blocks("yade")[0]
    names = {name: engine(name) for name in re.findall(r"^ {4}(\w+)\(", script, re.MULTILINE)}
    names["O"] = module.O
    exec(script, names)
    assert len(module.O.engines) == 5
    module.O.engines = []
    exec(kept["PyRunner"][1]["command"], names)
    line = next(line for line in lines("yade") if line.startswith("grainloops snapshot out/grains"))
    found = gl.read_snapshot(tmp_path / shlex.split(line)[2])
    told = gl.read_snapshot(folder / "state.xml.gz")
    assert np.array_equal(np.sort(found.ids), np.sort(told.ids))
    assert found.graph.contact_count == told.graph.contact_count


def test_lines_of_lammps_name_columns_that_its_readers_know():
    """The options of a block of its own are options of `snapshot`."""
    from studies.cli import snapshot_command

    known = {name.replace("_", "-") for name in signature(snapshot_command).parameters}
    options = set(re.findall(r"^--(\w+)", "\n".join(lines("lammps")), re.MULTILINE))
    assert options and options <= known | {"columns"}


def test_pages_quote_python_that_compiles():
    """Calls in the running text too: `gl.name(...)` is a name of the front door."""
    for name in PAGES:
        for code in blocks(name):
            ast.parse(code)
        used = set(re.findall(r"`gl\.([a-z]\w+)", PAGES[name]))
        missing = {one for one in used if not hasattr(gl, one)}
        assert missing == set(), name
