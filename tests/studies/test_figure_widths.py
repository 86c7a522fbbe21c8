"""Words stay inside their figures, in one column of a journal and in two."""

from functools import cache

import numpy as np
import pandas as pd
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

import grainloops as gl
from studies import style
from studies.material import draw_material
from studies.packing_figures import forecast_figure, order_shares, stress_and_volume
from studies.paths.diamond import follow_diamond
from studies.paths.figures import draw_polar_figure, draw_split
from studies.paths.options import DiamondOptions
from studies.series.figures import kinetics_figure, skill_by_predictor
from studies.series.skill import TARGETS
from tests.packings import LAW, jammed


@pytest.fixture(params=[None, "single", "double"], autouse=True)
def width(request):
    gl.plot.figure_width(request.param)
    yield
    gl.plot.figure_width(None)


def path():
    driven = np.linspace(0.0, 2e-4, 5)
    along = {"H11": driven, "H22": -0.5 * driven, "P11": 400.0 + 2e5 * driven, "P22": 0 * driven}
    events = {"driven": driven[2:3], "kind": np.array(["instability"])}
    tables = {"path": along | {"driven": driven}, "events": events}
    return stress_and_volume({name: pd.DataFrame(one) for name, one in tables.items()}, "H11")


def forecast():
    """Without a drop and without instabilities."""
    scene = gl.Scene(jammed(16, 2), LAW)
    return forecast_figure(gl.forecast(scene, "oedometric", to=1e-5, rows=2, spread=False))


def kinetics():
    return kinetics_figure(kinetics_tables())


def kinetics_tables():
    pairs = {"order_1": [3, 3], "order_2": [3, 4], "order_merged": [4, 5]}
    counts = {"openings": [40, 2], "closings": [31, 5], "balance_p": [0.2, 0.3]}
    orders = {"order": [3, 4, 5], "observed_share": [0.5, 0.3, 0.2]}
    orders |= {"steady_share": [0.5, 0.3, 0.2], "steady_error": [0.1, 0.1, 0.1]}
    tables = {"kinetics": pairs | counts, "kinetics_orders": orders}
    return {name: pd.DataFrame(one) for name, one in tables.items()}


def test_without_a_steady_state_there_is_no_panel_for_it():
    arrays = kinetics_tables()
    arrays["kinetics_orders"]["steady_share"] = np.full(3, np.nan)
    assert len(kinetics_figure(arrays).axes) == 1 and len(kinetics().axes) == 2


def skill():
    rows = [(target, "order", 0.7, 0.1, 1) for target in TARGETS]
    names = ("target", "predictor", "auc", "base", "snapshot_after")
    return skill_by_predictor(pd.DataFrame(rows, columns=names))


@cache
def diamond():
    return follow_diamond(DiamondOptions(table=2))


def polar():
    return draw_polar_figure(diamond())


def split():
    return draw_split(diamond())


def marched():
    strain = np.linspace(0.0, 0.1, 4)
    rows = {"strain": strain, "stress_ratio": 1.0, "volume_change": -strain, "w2": 0.5}
    rows |= {"stage": "programme", "cone_status": "closed", "failed": [0, 0, 1, 1]}
    rows |= {"cone_axis_deg": 0.0, "cone_opening_deg": 0.0}
    return draw_material(pd.concat([pd.DataFrame(rows | {"set": s}) for s in ("mean", "single")]))


@pytest.mark.parametrize("draw", [path, forecast, kinetics, skill, polar, split, marched])
def test_no_word_is_cut(draw, request):
    figure = draw()
    if request.node.callspec.params["width"] == "single":
        assert figure.get_figwidth() * 25.4 == pytest.approx(86.0)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    right, top = figure.bbox.size
    keys = [*figure.legends, *(ax.get_legend() for ax in figure.axes if ax.get_legend())]
    words = [text for key in keys for text in key.findobj(Text)]
    for ax in figure.axes:  # numbers of axes apart: some stand outside and aren't drawn
        words += [ax.title, ax.xaxis.label, ax.yaxis.label, *ax.texts]
    boxes = {
        text.get_text(): text.get_window_extent(canvas.get_renderer())
        for text in words
        if text.get_text() and text.get_visible()
    }
    assert len(boxes) > 4
    cut = {
        said: box.extents
        for said, box in boxes.items()
        if box.x0 < -1 or box.y0 < -1 or box.x1 > right + 1 or box.y1 > top + 1
    }
    assert not cut
    # A layout that fails leaves next to nothing of them.
    assert all(ax.get_position().width > 0.15 for ax in figure.axes[:2])
    inches = figure.get_figheight()
    assert all(ax.get_position().height * inches > 0.6 for ax in figure.axes if ax.lines)


def test_nothing_marks_the_edge_where_nothing_is():
    figure = style.new_figure()
    ax = figure.add_subplot()
    style.edge_ticks(ax, [])
    style.edge_ticks(ax, [0.5], "lost")
    (line,) = ax.lines
    assert line.get_label() == "lost" and line.get_xydata().tolist() == [[0.5, 0.0]]


def test_shares_of_work_are_of_the_sum_of_sizes():
    """Where orders work against one another, no share exceeds 1."""
    rows = {"3": (0.2, 2.0, 0.0), "4": (0.5, -3.0, 0.9), "5": (0.3, 2.0, 0.1)}
    names = ("area_share", "W2_share", "negative_share")
    ax = order_shares({n: dict(zip(names, row, strict=True)) for n, row in rows.items()})
    heights = [[bar.get_height() for bar in bars] for bars in ax.containers]
    np.testing.assert_allclose(heights[1], [2 / 7, -3 / 7, 2 / 7], rtol=1e-15)
    np.testing.assert_allclose(heights[2], [0.0, 0.9, 0.1])
