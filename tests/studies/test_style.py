"""Widths of figures: those of a journal's columns, by one setting for commands and front door."""

from itertools import pairwise

import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.figure import Figure
from PIL import Image

import grainloops as gl
from studies import style
from tests.command import run

SINGLE, DOUBLE = 86 / 25.4, 178 / 25.4


@pytest.fixture(autouse=True)
def as_before():
    yield
    gl.plot.figure_width(None)


def test_figures_take_the_width_that_was_asked_for():
    for asked, one, two in (
        (None, SINGLE, DOUBLE),
        ("single",) + 2 * (SINGLE,),
        ("double",) + 2 * (DOUBLE,),
    ):
        gl.plot.figure_width(asked)
        assert style.new_figure().get_figwidth() == pytest.approx(one)
        figure, axes = style.new_panels(1, 2, 2.6, sharey=True)
        assert figure.get_figwidth() == pytest.approx(two)
        assert axes.shape == (1, 2)
        assert style.new_figure(fixed=True).get_figwidth() == pytest.approx(SINGLE)
        pyplot.close("all")
        ax = gl.plot.loop(gl.regular_polygon(5, strain=0.1))
        assert ax.figure.get_figwidth() == pytest.approx(one)
        # Axes that are given are drawn into as they are.
        own = Figure(figsize=(5, 4))
        assert gl.plot.loop(gl.regular_polygon(5, strain=0.1), ax=own.add_subplot()).figure is own
        assert own.get_figwidth() == 5


def test_panels_stand_below_one_another_in_a_column():
    gl.plot.figure_width("single")
    figure, axes = style.new_panels(2, 2, 4.6, sharex=True)
    figure.canvas.draw()
    boxes = [ax.get_position() for ax in axes.ravel()]
    assert all(upper.y0 > lower.y1 for upper, lower in pairwise(boxes))
    assert len({round(box.x0, 6) for box in boxes}) == 1
    # Not more than fit on a page: those keep two columns, whatever is asked.
    figure, axes = style.new_panels(3, 3, 6.0)
    assert axes.shape == (3, 3)
    assert figure.get_figwidth() == pytest.approx(DOUBLE)
    assert style.new_panels(3, 2, 20.0)[0].get_figheight() <= style.PAGE


def test_another_word_is_refused():
    with pytest.raises(gl.InputError, match="figure width: got 'wide', expected single or double"):
        gl.plot.figure_width("wide")


@pytest.mark.parametrize("option", [("--figure-width", "single"), ("--figure-width=single",)])
def test_the_option_stands_anywhere_in_the_line(tmp_path, option):
    out = tmp_path / "out"
    line = ("domain", "--directions", "5", *option, "--alpha0", "45", "--out", str(out))
    assert run(*line) == 0
    width = Image.open(out / "domain.png").width
    assert width == pytest.approx(300 * SINGLE, abs=1)
    assert np.isclose(width / 300 * 25.4, 86, atol=0.1)


def test_an_empty_panel_says_why():
    ax = style.new_figure().add_subplot()
    style.say_empty(ax, "no loops")
    assert [text.get_text() for text in ax.texts] == ["no loops"]
