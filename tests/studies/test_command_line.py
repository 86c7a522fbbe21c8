"""What all commands share: where results go, silence, an interruption, a clock."""

import os
import pty
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

import grainloops as gl
from loops.compiled import compiling, kernel
from studies.cli import COMMANDS
from studies.clock import clock, of_parts, paced
from studies.commands import Answer, out_or
from tests.command import refusal, run

SAMPLE = str(gl.sample_path())
ROOT = str(gl.sample_path().parents[3])


@pytest.fixture
def said(tmp_path, monkeypatch, capsys):
    """Runs a command in an empty folder; exit status and what it printed."""
    monkeypatch.chdir(tmp_path)

    def say(*arguments):
        status = run(*arguments)
        return status, *capsys.readouterr()

    return say


@pytest.mark.parametrize(
    ("path", "name"),
    [
        ("run/grains_05.csv.gz", "grains_05-snapshot"),
        ("grains.parquet", "grains-snapshot"),
        ("dump.atoms.160000", "dump.atoms.160000-snapshot"),
    ],
)
def test_names_of_results(path, name):
    assert str(out_or(None, "snapshot", Path(path))) == name


def test_quiet_prints_nothing_but_errors(said):
    assert said("snapshot", SAMPLE, "--no-figures", "--quiet") == (0, "", "")
    status, out, error = said("check", "grains_none.csv", "--quiet")
    assert (status, out, error.count("\n")) == (2, "", 1)


@pytest.mark.parametrize(
    ("given", "asked"),
    [
        (["--in-packing", "a.csv", "b.csv"], "rates"),
        (["a.csv", "b.csv", "--in-packing"], "rates"),
        (["--in-packing", "events", "a.csv", "b.csv"], "events"),
        (["--in-packing=events", "a.csv", "b.csv"], "events"),
        (["a.csv", "b.csv"], ""),
        (["--in-packing=odd", "a.csv", "b.csv"], "odd"),
    ],
)
def test_in_packing_may_stand_alone(given, asked, monkeypatch):
    """The word after it is an answer to it, or a file."""
    seen = {}
    monkeypatch.setattr(
        "studies.series.run.run_series",
        lambda paths, out, **how: seen.update(how, paths=paths) or {"notes": []},
    )
    monkeypatch.setattr("studies.commands.answer", lambda *_: Answer([]))
    monkeypatch.setattr("studies.commands.snapshot._series_lines", lambda _: [])
    assert run("series", *given) == 0 and seen["in_packing"] == asked
    assert [str(path) for path in seen["paths"]] == ["a.csv", "b.csv"]


@pytest.mark.parametrize("given", ["6.5", "nan", "six", "1e-3"])
def test_whole_numbers_are_not_rounded(said, given):
    asked = (("polygon", "--order"), ("series", SAMPLE, "--workers"), ("probe", SAMPLE, "--frame"))
    for words in asked:
        status, out, error = said(*words, given)
        assert (status, out) == (2, "")
        assert error.startswith(f"grainloops: Invalid value for {words[-1]}: got {given}, expected")


@pytest.mark.parametrize("command", COMMANDS)
def test_help_is_two_screens_everyday_options_first(command, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")
    assert run(command, "--help") == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 90 and max(map(len, lines)) <= 80
    titles = [line.strip("╭╮─ ") for line in lines if line.startswith("╭")]
    assert titles[-2:] == ["Parameters", "Further options"]
    assert set(titles) <= {"Arguments", "Parameters", "Further options"}
    begin = [k for k, line in enumerate(lines) if line.startswith("╭")][-2:]
    everyday, further = lines[begin[0] : begin[1]], lines[begin[1] :]
    assert any("--out" in line for line in everyday)
    assert any("--json" in line for line in further)


def test_the_version_stands_anywhere(said):
    assert said("snapshot", "--version")[1] == f"grainloops {gl.__version__}\n"


@pytest.mark.parametrize(
    ("then", "said"),
    [
        ("raise", "grainloops: interrupted; nothing was written.\n"),
        # Compiled code of a library may turn the exception into one of its own.
        ("raise ImportError('initialization failed') from None", "grainloops: interrupted.\n"),
    ],
)
def test_an_interruption_leaves_a_sentence_and_no_folder(tmp_path, then, said):
    """Ctrl-C while the summary is written: no folder stays, and the exit status is 130."""
    # A shell may have told the tests, hence this process, to ignore the signal.
    code = f"""
import signal, sys
from studies.study import Results
def interrupt(*_):
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:
        {then}
signal.signal(signal.SIGINT, signal.default_int_handler)
Results.write_summary = interrupt
sys.argv = ["grainloops", "snapshot", {SAMPLE!r}, "--no-figures"]
from studies.commands import Answer, out_or
from studies.cli import COMMANDS, main
main()
"""
    environment = {**os.environ, "PYTHONPATH": ROOT}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert (done.stderr, done.stdout, done.returncode) == (said, "", 130)
    assert list(tmp_path.iterdir()) == []


def test_a_terminal_sees_the_seconds(tmp_path):
    # The clock stands, and the work lasts until the line is shown: no race with the machine.
    code = """
import sys, time
from studies import clock as c
c.CLOCK_PATIENCE, c.TICK, lines = 0.01, 0.02, []
c.time.monotonic = lambda: 0.0
c.print = lambda line, **how: (print(line, **how), lines.append(line))
with c.clock("work") as tell:
    tell("0.3 of 1")
    while not any("0.3" in line for line in lines):
        time.sleep(0.01)
print("done", file=sys.stderr)
"""
    above, below = pty.openpty()
    environment = {**os.environ, "PYTHONPATH": ROOT}
    subprocess.run([sys.executable, "-c", code], stderr=below, env=environment, check=True)
    os.close(below)
    shown = ""
    # Linux ends with an error, others with nothing.
    with suppress(OSError):
        while some := os.read(above, 4096):
            shown += some.decode()
    os.close(above)
    assert "work: 0 s, 0.3 of 1" in shown
    # The line is cleared before anything else is said.
    assert shown.endswith("\r\x1b[Kdone\r\n")


def test_python_runs_the_package_as_the_command(tmp_path):
    environment = {**os.environ, "PYTHONPATH": ROOT}
    done = subprocess.run(
        [sys.executable, "-m", "grainloops", "polygon", "--order", "2"],
        cwd=tmp_path, env=environment, capture_output=True, text=True,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("grainloops: --order: got 2, expected a whole number from 3")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["evolve", "a.csv"], "Missing option '--to'. Try 'grainloops evolve --help'."),
        (["evolve"], "Missing argument 'PATHS'. Try 'grainloops evolve --help'."),
        (["check", "a.csv", "--outt", "3"], "mean --out? Try 'grainloops check --help'."),
        (["nosuch"], "Try 'grainloops --help'."),
        (["snapshot", "a.csv", "--hold"], "grainloops: --hold: got no --in-packing"),
        (["snapshot", "a.csv", "--yield-band", "0.9"], ": --yield-band: got no --in-packing"),
        (["snapshot", "a.csv", "--hold", "--yield-band", "0.9"], ": --hold, --yield-band: got no"),
    ],
)
def test_a_refusal_names_the_command_and_what_was_given(words, told, capsys):
    assert told in refusal(capsys, *words)


@pytest.mark.parametrize(("quiet", "told"), [(False, True), (True, False)])
def test_a_wait_for_kernels_is_told_once(quiet, told, tmp_path, monkeypatch, capsys):
    """While numba compiles, and after two seconds."""
    monkeypatch.setenv("TTY_COMPATIBLE", "0" if quiet else "")
    monkeypatch.setattr("studies.clock.TICK", 0.01)
    monkeypatch.setattr("studies.clock.CLOCK_PATIENCE", 60.0)
    with clock("grainloops snapshot"):
        assert compiled_anew(0.05) == 2.0
    assert capsys.readouterr().err == ""
    monkeypatch.setattr("studies.clock.CLOCK_PATIENCE", 0.01)
    with clock("grainloops snapshot", line=False):
        time.sleep(0.05)
        assert capsys.readouterr().err == ""
        for _ in range(2):
            assert compiled_anew(0.1) == 2.0
        assert not compiling
    line = "grainloops snapshot: compiling kernels, once: about half a minute\n"
    assert capsys.readouterr().err == line * told


def compiled_anew(seconds: float) -> float:
    """Result of a kernel that no cache has, and that takes so long to compile at least."""
    from numba.core import event

    class Slow(event.Listener):
        def on_start(self, event):
            time.sleep(seconds)

        def on_end(self, event):
            pass

    with event.install_listener("numba:compile", Slow()):
        return kernel(eval("lambda x: 2.0 * x"))(1.0)


def test_the_time_left_is_told_after_some_seconds_of_long_work(monkeypatch, capsys):
    """Forty parts, once their pace is steady; those that are done before don't count for it."""
    now = [0.0]
    monkeypatch.setattr("studies.clock.time.monotonic", lambda: now[0])
    monkeypatch.setattr("studies.clock.CLOCK_PATIENCE", 60.0)
    with clock("grainloops sustain") as tell:
        after_one = paced(of_parts(tell, "directions"), 40)
        for _ in range(4):
            now[0] += 2.0
            after_one()
    said = capsys.readouterr().err
    assert said == "grainloops sustain: 3 of 40 directions, about 1 min left\n"
    told = []
    after_one = paced(lambda *given: told.append(given), 9, 6)
    for seconds in (3.0, 5.0):
        now[0] += seconds
        after_one()
    assert told == [(7, 6.0, 2), (8, 4.0, 1)]
    with pytest.raises(gl.InputError, match="progress: got 3, expected"):
        paced(3, 2)


def test_python_is_told_of_directions_and_programmes():
    lattice = gl.GrainGraph(
        x=[[0, 0], [1, 0], [0, 1], [1, 1]], radii=[0.5005] * 4,
        contacts=[[0, 1], [1, 0], [2, 3], [3, 2], [0, 2], [2, 0], [1, 3], [3, 1]],
        images=[[0, 0], [1, 0], [0, 0], [1, 0], [0, 0], [0, 1], [0, 0], [0, 1]],
        cell=[[2, 0], [0, 2]], normal_force=[0.001] * 8,
    )  # fmt: skip
    scene, told = gl.Scene(lattice, gl.LinearFrictional(1.0, 0.5, 0.5)), []
    how = {"largest": 0.002, "interval": 1e-4, "spread": False}
    found = gl.sustain(scene, [[-1, 0], [1, 0]], **how, progress=lambda *now: told.append(now))
    assert [(done, left) for done, _, left in told] == [(1, 1), (2, 0)]
    assert found.limit[0] == gl.sustain(scene, [[-1, 0]], **how).limit[0]
    one = gl.loop(gl.read_snapshot(SAMPLE), 6)
    told.clear()
    gl.loop_domain(one, "traction", directions=5, progress=lambda *now: told.append(now))
    assert [(done, left) for done, _, left in told] == [(1, 4), (2, 3), (3, 2), (4, 1), (5, 0)]
    with pytest.raises(gl.InputError, match="progress: got 3"):
        gl.loop_domain(one, "traction", directions=5, progress=3)


@pytest.mark.slow
@pytest.mark.parametrize("words", [["diamond"], ["polygon", "--order", "6"]])
def test_without_figures_nothing_that_draws_is_loaded(words, tmp_path):
    asked = [*words, "--figures", "none", "--out", str(tmp_path / "out")]
    script = f"import sys; from studies.cli import main; sys.argv[1:] = {asked}\n"
    script += "try: main()\nexcept SystemExit as left: assert not left.code\n"
    script += "assert not {'matplotlib', 'pandas'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", script], check=True, cwd=ROOT, capture_output=True)
