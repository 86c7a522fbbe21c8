"""Result folders: whole, one run at a time, nothing stale; what the command prints."""

import errno
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from loops import InputError
from patterns import sample_path
from studies import output
from studies.output import folder_lock, result_folder, write_summary
from tests.command import run


def write(out, *names, force=False, value=0):
    with result_folder(out, force=force) as folder:
        for name in names:
            (folder / name).write_text(name)
        write_summary(folder, {"value": value})


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_folder_is_written_whole_and_lists_its_files(tmp_path):
    write(tmp_path / "deep" / "out", "b.txt", "a.txt", value=3)
    assert names(tmp_path / "deep" / "out") == ["a.txt", "b.txt", "summary.json"]
    assert names(tmp_path / "deep") == ["out"]
    summary = json.loads((tmp_path / "deep" / "out" / "summary.json").read_text())
    assert summary == {"files": ["a.txt", "b.txt"], "value": 3}


def test_force_leaves_nothing_of_another_command_and_all_that_is_not_ours(tmp_path):
    out = tmp_path / "out"
    write(out, "map.png", "loops.parquet")
    (out / "notes.txt").write_text("mine")
    (out / "loops").mkdir()
    (out / "loops" / "part-00000.parquet").touch()
    (out / "series.json").touch()
    with pytest.raises(InputError, match="--force"):
        write(out, "path.parquet")
    write(out, "path.parquet", force=True)
    assert names(out) == ["notes.txt", "path.parquet", "summary.json"]


def test_a_listed_file_outside_the_folder_stays(tmp_path):
    out = tmp_path / "out"
    write(out)
    (tmp_path / "kept.txt").touch()
    (out / "summary.json").write_text(json.dumps({"files": ["../kept.txt", "..", 3, "gone"]}))
    write(out, force=True)
    assert names(tmp_path) == ["kept.txt", "out"]


@pytest.mark.parametrize("there", [False, True])
def test_of_two_runs_into_one_place_the_first_to_end_wins(tmp_path, there):
    out = tmp_path / "out"
    if there:
        out.mkdir()
    with (
        pytest.raises(InputError, match="another run, which ended first"),
        result_folder(out, force=False) as slow,
    ):
        (slow / "slow.txt").touch()
        write(out, "quick.txt")
    assert names(out) == ["quick.txt", "summary.json"]
    assert names(tmp_path) == ["out"]


def test_what_a_killed_run_left_goes_and_a_live_one_stays(tmp_path):
    dead, fresh, other = (tmp_path / name for name in (".out-0123abcd", ".out-89abcdef", ".out-x"))
    for folder in (dead, fresh, other):
        folder.mkdir()
        (folder / "half.txt").touch()
        os.utime(folder, (0, 0))
    with folder_lock(fresh):
        write(tmp_path / "out")
    assert names(tmp_path) == [".out-89abcdef", ".out-x", "out"]


def test_a_folder_that_a_run_holds_is_refused(tmp_path):
    out = tmp_path / "out"
    write(out)
    with folder_lock(out), pytest.raises(InputError, match="another run writes to"):
        write(out, force=True)


def test_without_locks_everything_else_still_holds(tmp_path, monkeypatch):
    def refuse(file, how):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(output.fcntl, "flock", refuse)
    (tmp_path / ".out-0123abcd").mkdir()
    os.utime(tmp_path / ".out-0123abcd", (0, 0))
    write(tmp_path / "out", "a.txt")
    write(tmp_path / "out", "b.txt", force=True)
    assert names(tmp_path) == [".out-0123abcd", "out"]  # nobody knows whose it is
    assert names(tmp_path / "out") == ["b.txt", "summary.json"]


def test_a_full_disk_is_one_line_and_leaves_nothing(tmp_path):
    with (
        pytest.raises(InputError, match="No space left on device"),
        result_folder(tmp_path / "out", force=False) as folder,
    ):
        (folder / "a.txt").touch()
        raise OSError(errno.ENOSPC, "No space left on device")
    assert names(tmp_path) == []


def test_a_folder_removed_meanwhile_is_one_line(tmp_path):
    with (
        pytest.raises(InputError, match="removed while the run went on"),
        result_folder(tmp_path / "out", force=False) as folder,
    ):
        (folder / "gone" / "a.txt").write_text("a")


def test_the_digest_tells_changed_code(tmp_path, monkeypatch):
    """The same sources elsewhere have the same digest, one changed character another one."""
    ours = output.code_version()
    root = Path(output.__file__).parents[1]
    for room in output.PACKAGES:
        for file in (root / room).rglob("*.py"):
            copy = tmp_path / file.relative_to(root)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes(file.read_bytes())
    monkeypatch.setattr(output, "__file__", str(tmp_path / "studies" / "output.py"))
    assert output.code_version.__wrapped__() == ours
    with open(tmp_path / "loops" / "errors.py", "a") as file:
        file.write("#")
    assert output.code_version.__wrapped__() != ours


def command(*arguments, **how):
    given = [os.fsencode(argument) for argument in arguments]
    return subprocess.run([sys.executable, "-m", "studies.cli", *given], text=True, **how)


@pytest.mark.slow
def test_output_that_cannot_be_printed(tmp_path):
    """A reader that went away is no failure; a full disk behind the pipe is said in one line."""
    asked = "snapshot", sample_path(), "--no-figures", "--out"
    reader, writer = os.pipe()
    os.close(reader)
    done = command(*asked, tmp_path / "a", stdout=writer, stderr=subprocess.PIPE)
    assert (done.returncode, done.stderr) == (0, "")
    with open("/dev/full", "w") as full:
        done = command(*asked, tmp_path / "b", stdout=full, stderr=subprocess.PIPE)
    assert done.returncode == 1
    assert "No space left on device; the results are in" in done.stderr
    assert done.stderr.count("\n") == 1
    assert all("summary.json" in names(tmp_path / name) for name in "ab")


@pytest.mark.slow
def test_a_file_whose_name_is_no_text(tmp_path):
    grains = os.fsencode(tmp_path) + b"/grains_\xff.csv.gz"
    contacts = os.fsencode(tmp_path) + b"/contacts_\xff.csv.gz"
    for path, name in ((grains, "grains_biaxial.csv.gz"), (contacts, "contacts_biaxial.csv.gz")):
        with open(path, "wb") as file:
            file.write(sample_path(name).read_bytes())
    out = os.fsencode(tmp_path / "out")
    done = command("snapshot", grains, "--out", out, capture_output=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert "results in" in done.stdout
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert "report.html" in summary["files"]
    assert "udcff" in summary["provenance"]["configuration"]["path"]


def test_a_place_whose_name_is_no_text(tmp_path):
    with pytest.raises(InputError, match="UTF-8"):
        write(tmp_path / os.fsdecode(b"out\xfe"))


def test_the_version(capsys):
    assert run("--version") == 0
    assert capsys.readouterr().out.startswith("grainloops ")


def test_no_error_is_longer_than_a_screen(capsys, tmp_path):
    place = "x" * 4000
    assert run("polygon", "--compare", place, "--out", tmp_path / "o") == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert len(said) < 1100
    assert " ... " in said


def test_what_the_system_refuses_is_one_line(monkeypatch, capsys):
    def refuse(*args, **how):
        raise MemoryError

    monkeypatch.setattr("studies.domain.run_domain", refuse)
    assert run("domain") == 1
    assert capsys.readouterr().err == "grainloops: out of memory\n"


def test_little_address_space_is_said_at_once():
    """As `ulimit -v` limits it: below, the linear algebra asks for its buffers without end."""
    code = (
        "import resource, studies.cli as cli\n"
        "def limit(size): resource.setrlimit(resource.RLIMIT_AS, (size, -1))\n"
        "limit(700_000_000)\n"
        "cli.main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, "diamond"], capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 1
    said = "grainloops: out of memory: 0.7 GB of address space; at least 0.8 GB, see ulimit -v.\n"
    assert done.stderr == said


def test_threads_and_libraries_without_room_are_out_of_memory(monkeypatch, capsys):
    """Any other error of these kinds is a fault of the code, and shown in full."""
    for kind, words in (
        (RuntimeError, "can't start new thread"),
        (ImportError, "a.so: failed to map segment from shared object"),
    ):

        def refuse(*args, kind=kind, words=words, **how):
            raise kind(words)

        monkeypatch.setattr("studies.domain.run_domain", refuse)
        assert run("domain") == 1
        assert capsys.readouterr().err == f"grainloops: out of memory. {words}\n"

    def fault(*args, **how):
        raise RuntimeError("a fault")

    monkeypatch.setattr("studies.domain.run_domain", fault)
    with pytest.raises(RuntimeError, match="a fault"):
        run("domain")
