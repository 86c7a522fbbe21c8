"""Widths of figures: those of a journal's columns, by one setting for commands and front door."""

import pytest
from matplotlib import pyplot
from matplotlib.figure import Figure

import grainloops as gl
from studies import style

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


def test_another_word_is_refused():
    with pytest.raises(gl.InputError, match="figure width: got 'wide', expected single or double"):
        gl.plot.figure_width("wide")
