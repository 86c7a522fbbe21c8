"""Figures are those that are wanted, in the format that is, as matplotlib saves them."""

import json
import tomllib
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import grainloops as gl
from studies import style
from tests.command import run


def save_figure(figure, folder, name, source, kind="png"):
    (folder / f"{name}.{kind}").write_bytes(style.drawn_file(figure, name, source, kind)())


def drawn(panels):
    figure = style.new_figure(2.0, 1.5)
    with style.styled():
        for k, ax in enumerate(figure.subplots(1, panels, squeeze=False)[0]):
            ax.plot([0, 10.0**k], label="$K_s$")
            ax.set(title="title", xlabel="strain $E_1$ (–)")
            ax.legend()
    return figure


@pytest.mark.parametrize("panels", [1, 2])
def test_pictures_are_matplotlib_s_own(tmp_path, panels):
    save_figure(drawn(panels), tmp_path, "a", {})
    saved, own = Image.open(tmp_path / "a.png"), BytesIO()
    with style.styled():
        drawn(panels).savefig(own, format="png")
    assert np.array_equal(np.asarray(saved), np.asarray(Image.open(own)))
    assert saved.info["dpi"] == pytest.approx((300, 300), abs=0.1)
    assert saved.text["Title"] == "a"


@pytest.mark.parametrize("kind", ["png", "svg", "pdf"])
def test_the_same_numbers_give_the_same_files(tmp_path, kind):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        for panels, figure in ((2, "a"), (1, "b")):
            save_figure(drawn(panels), tmp_path / name, figure, {"command": "here"}, kind)
    files = sorted(file.name for file in (tmp_path / "one").iterdir())
    assert files == [f"a.{kind}", f"b.{kind}"]
    for file in files:
        content = (tmp_path / "one" / file).read_bytes()
        assert content == (tmp_path / "two" / file).read_bytes()
        assert b"here" in content and b"CreationDate" not in content
    if kind == "svg":
        assert "<dc:title>a</dc:title>" in (tmp_path / "one" / "a.svg").read_text()


def snapshot(*asked):
    return ("snapshot", gl.sample_path(), *asked)


COMMANDS = (
    ("domain", "--directions", 5),
    ("domain", "--compare", "3,4", "--closure", "affine", "--directions", 3),
    ("diamond",),
    ("polygon", "--order", 5),
    ("polygon", "--compare", "3,4"),
)
LOOPS = [
    pytest.param(words, marks=[pytest.mark.slow] * (k != 1), id=" ".join(map(str, words)))
    for k, words in enumerate(COMMANDS)
]
TABLES = {".parquet", ".json"}
CAPTIONS = Path(style.__file__).with_name("captions.toml")


@pytest.mark.parametrize("command", [snapshot(), *LOOPS])
def test_no_figure_is_drawn_if_none_is_wanted(command, tmp_path, monkeypatch):
    monkeypatch.setattr(style, "drawn_file", None)
    for number, none in enumerate((("--figures", "none"), ("--no-figures",))):
        out = tmp_path / f"{number}"
        assert run(*command, *none, "--out", out) == 0
        assert {file.suffix for file in out.iterdir()} <= TABLES


@pytest.mark.parametrize("command", LOOPS)
def test_every_figure_has_a_name_that_can_be_asked_for(command, tmp_path, unsaved):
    assert run(*command, "--out", tmp_path / "all") == 0
    drawn = {file.stem for file in (tmp_path / "all").glob("*.png")}
    assert drawn and drawn <= tomllib.loads(CAPTIONS.read_text())[command[0]].keys()
    one = min(drawn)
    assert run(*command, "--figures", one, "--out", tmp_path / "one") == 0
    assert [file.name for file in (tmp_path / "one").glob("*.png")] == [f"{one}.png"]


@pytest.mark.parametrize(("kind", "start"), [("svg", "svg+xml"), ("pdf", "png")])
def test_wanted_figures_alone_are_made_and_stand_on_the_page(tmp_path, monkeypatch, kind, start):
    monkeypatch.setattr("studies.snapshot.figures.loop_map", None)
    out = tmp_path / "out"
    asked = snapshot("--figures", "orders,in_packing", "--figure-format", kind, "--out", out)
    assert run(*asked) == 0
    drawn = {file.name for file in out.iterdir() if file.suffix not in TABLES}
    assert drawn == {f"orders.{kind}", "report.html"}
    page = (out / "report.html").read_text()
    assert page.count(f'<img src="data:image/{start};base64,') == 1
    # Loops are judged in their packing with an option alone.
    said = json.loads((out / "summary.json").read_text())["notes"]
    assert said[-1] == "nothing to draw in figures in_packing"


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (("--figures", "map,maps"), "--figures: got 'maps', expected none, map, orders"),
        (("--figures", ""), "--figures: got '', expected none, map, orders"),
        (("--figure-format", "jpg"), "--figure-format: got 'jpg', expected png, svg or pdf"),
        (("--figures", "map", "--no-figures"), "--figures, --no-figures: got both"),
    ],
)
def test_other_words_are_refused(asked, said, tmp_path, capsys):
    assert run(*snapshot(*asked, "--out", tmp_path / "out")) == 2
    assert said in capsys.readouterr().err and not (tmp_path / "out").exists()
