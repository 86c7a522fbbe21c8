"""Pages of tasks: short, with the evidence apart; their blocks run, their commands are commands."""

import ast
import re

import duckdb
import pytest

import grainloops as gl
from tests.command import run
from tests.docs.pages import DOCS, page
from tests.stability.packing.walled_packings import small_sample

LAW = gl.LinearFrictional(1.0, 0.5, 0.5)
PAGES = (
    *("accuracy", "forecast", "larger-loops", "laws-and-boundaries", "packing"),
    *("packing-paths", "probing", "series", "sustaining"),
)
# Pages of tasks without an evidence of their own.
SHORT = (
    *("adding", "check", "fabric", "formats", "installation", "lammps", "material", "one-loop"),
    "yade",
)
CODE = re.compile(r"```(python|sql)\n(.*?)```", re.DOTALL)
SAMPLE = "gl.read_snapshot(gl.sample_path())"


def words(text):
    """Words outside of code and of the targets of links."""
    text = re.sub(r"```.*?```|^ {4}.*?$|\]\([^)]*\)", "", text, flags=re.DOTALL | re.MULTILINE)
    return sum(any(letter.isalnum() for letter in word) for word in text.split())


def blocks(name, language="python"):
    return [code for kind, code in CODE.findall(page(name)) if kind == language]


@pytest.mark.parametrize("name", (*PAGES, *SHORT))
def test_a_page_is_short(name):
    assert words(page(name)) <= 1200


@pytest.mark.parametrize("name", PAGES)
def test_a_page_names_its_evidence(name):
    text = page(name)
    assert f"(evidence/{name}.md)" in text and f"(../{name}.md)" in page(f"evidence/{name}")


@pytest.mark.parametrize("name", PAGES)
def test_the_validation_of_a_page_stands_in_its_evidence(name):
    worth = " ".join(re.findall(r"\*\*Validation:\*\*(.*?)\n\n", page(name) + "\n\n", re.DOTALL))
    told = set(re.findall(r"\d+[.,]\d+", re.sub(r"\([^)]*\)", "", worth)))
    assert worth and [n for n in sorted(told) if n not in page(f"evidence/{name}")] == []


@pytest.mark.parametrize("ends", ["cell", "walls", "outline"])
def test_blocks_on_a_packing_run_wherever_a_sample_ends(ends):
    code = "\n".join(blocks("packing"))
    assert code.count(SAMPLE) == 1
    names = {"sample": small_sample(ends, LAW)}
    exec(code.replace(SAMPLE, "sample"), names)
    assert names["scene"].boundary.kind == ends
    assert names["rates"].strain.shape[0] == len(names["scene"].faces.loops)
    assert names["drained"].strain_rate[1, 1] == 1.0 and names["step"].status != "none"


# What the pages ask of thousands of grains, asked of a dozen.
SMALLER = ((", 72,", ", 4,"), ("24, largest=20.0", "4, largest=1e-3, interval=1e-4"))


@pytest.mark.parametrize("ends", ["cell", "walls", "outline"])
@pytest.mark.parametrize("name", ["forecast", "packing-paths", "probing", "sustaining"])
def test_blocks_on_a_sample_at_rest_run_or_say_what_is_missing(tmp_path, monkeypatch, name, ends):
    monkeypatch.chdir(tmp_path)
    sample = small_sample(ends, LAW)
    gl.write_snapshot("grains.parquet", sample)
    code = "\n".join(blocks(name))
    for large, small in SMALLER:
        code = code.replace(large, small)
    names = {"cell": sample.graph.cell, "snapshot": sample, "faces": sample.faces}
    if ends == "outline":
        with pytest.raises(gl.InputError, match="walls"):
            exec(code, names)
        return
    exec(code, names)
    status = {
        "forecast": lambda: names["found"].answered and len(names["loops"]) > 5,
        "packing-paths": lambda: (
            names["path"].status == "finished"
            and names["end"].steps > 0
            and names["held"].steps > 0
        ),
        "probing": lambda: len(names["found"].status) == 4 and names["held"].status == "at rest",
        "sustaining": lambda: len(names["found"].status) == 4,
    }
    assert status[name]()


def test_blocks_on_one_loop_say_what_the_page_says(capsys):
    exec("\n".join(blocks("larger-loops")), {})
    assert capsys.readouterr().out == "0.2307692308\n"
    names = {}
    exec("\n".join(blocks("accuracy")), names)
    said = capsys.readouterr().out.splitlines()
    assert 0.0 < float(said[0]) < 1e-6 and said[2].startswith("unstable")


@pytest.mark.parametrize("ends", ["cell", "walls", "outline", "sample"])
def test_blocks_on_stress_and_fabric_run(tmp_path, monkeypatch, ends):
    monkeypatch.chdir(tmp_path)
    sample = gl.read_snapshot(gl.sample_path()) if ends == "sample" else small_sample(ends, LAW)
    names = {"sample": sample}
    exec("\n".join(blocks("fabric")).replace(SAMPLE, "sample"), names)
    assert names["stress"].p > 0 and (tmp_path / "roses.png").stat().st_size > 10_000
    if ends == "sample":
        rows = names["fabric"].table().set_index("of").round(3)
        for which in ("strong contacts", "weak contacts"):
            row = rows.loc[which]
            told = f"{row.anisotropy} ± {row.anisotropy_error} at {row.direction_deg:.0f}°"
            assert told in page("fabric")


def test_blocks_of_what_is_added_run(capsys):
    exec("\n".join(blocks("adding")), {})
    law, boundary, question = capsys.readouterr().out.splitlines()
    assert law.startswith("finished") and boundary.startswith("outline")
    assert all(0.0 < share < 1.0 for share in ast.literal_eval(question))
    files = re.findall(r"`([\w/]+\.(?:py|toml|md))`", page("adding"))
    assert len(files) > 15
    assert [name for name in files if not (DOCS.parent / name).is_file()] == []


def test_blocks_on_a_series_read_its_tables(tmp_path, monkeypatch, capsys):
    folder = gl.sample_path("slow")
    how = ("--cells", folder / "cells.csv", "--workers", 1, "--no-figures")
    files = sorted(folder.glob("grains_*.parquet"))[:2]
    assert run("series", *files, *how, "--out", tmp_path / "series") == 0
    capsys.readouterr()
    monkeypatch.chdir(tmp_path)
    exec("\n".join(blocks("series")), {})
    printed = capsys.readouterr().out
    assert "snapshot" in printed and "order" in printed
    (query,) = blocks("series", "sql")
    ((after, missed, loops),) = duckdb.sql(query).fetchall()
    assert after == 1 and 0 < missed < loops
