"""Figures as a reader sees them: whole points, keys with entries, no panel without a content."""

from io import BytesIO

import matplotlib.figure
import numpy as np
import pandas as pd
import pytest
from PIL import Image

import grainloops as gl
from studies.material import draw_material
from studies.packing_figures import draw_cycle
from studies.series.figures import fates_over_strain, kinetics_figure, skill_by_predictor
from studies.snapshot.figures import both_signs, in_packing
from studies.snapshot.table import group_rows
from studies.style import drawn_file, new_panels


def in_axes(ax, points):
    """Whether points are within the axes, at least a marker's radius from the axes' lines."""
    ax.figure.draw_without_rendering()
    pixels, box = ax.transData.transform(points), ax.bbox
    radius = 1.75 * ax.figure.dpi / 72.0
    return (pixels >= box.min + radius).all() and (pixels <= box.max - radius).all()


def test_points_of_kinetics_at_zero_are_whole_and_orders_without_one_have_no_key():
    pairs = {"order_1": [3, 3], "order_2": [3, 4], "order_merged": [4, 5], "balance_p": [0.5, 0.5]}
    table = pd.DataFrame(pairs | {"openings": [0, 3], "closings": [2, 0]})
    orders = pd.DataFrame({"steady_share": [np.nan]})
    figure = kinetics_figure({"kinetics": table, "kinetics_orders": orders})
    assert in_axes(figure.axes[0], [[2.0, 0.0], [0.0, 3.0]])
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert words == ["balance", "order 4", "order 5"]
    bars = [each for drawn in figure.axes[0].containers for each in drawn.lines[2]]
    assert min(np.min(bar.get_segments()) for bar in bars) == 0.0


def test_crosses_of_born_loops_at_zero_are_whole():
    rows = {"snapshot": [0, 1, 2], "survived": [0, 90, 80], "born": [0, 0, 1]}
    rows |= {name: [0, 5, 5] for name in ("split", "merged", "changed", "died")}
    ax = fates_over_strain(pd.DataFrame(rows))
    (born,) = (line for line in ax.lines if line.get_label() == "born")
    assert born.get_ydata()[0] == 0.0 and not born.get_clip_on()


def test_the_ends_of_a_logarithmic_axis_of_both_signs_have_room():
    ax = matplotlib.figure.Figure().add_subplot()
    values = np.array([-0.3, -1e-3, 0.02, 1.0])
    both_signs(ax, "x", values)
    both_signs(ax, "y", values)
    assert in_axes(ax, np.stack([values, values], axis=1))
    assert all("-" not in text.get_text() for text in ax.get_xticklabels())


def test_withheld_shares_have_no_panel():
    count = 40
    table = {
        "order": np.arange(count) % 6 + 3,
        "traction_free_lambda_min": np.linspace(-1, 1, count),
    }
    table |= {f"packing_lambda_min{end}": np.linspace(-1, 1, count) for end in ("", "_held")}
    share, groups = np.linspace(0.0, 1.0, count), group_rows(table["order"])
    told = {"judged": False, "stuck": None, "bands": []}
    assert len(in_packing(table, groups, share, told).axes) == 2
    band = {"count": count, "mean": 0.1, "std_error": 0.02, "band": 0.99, "confirmed": 2}
    figure = in_packing(table, groups, share, told | {"judged": True, "bands": [band]})
    assert figure.axes[0].get_ylabel() == "unstable loops at rest (%)" and len(figure.axes) == 3


def march(name, failed, status="closed"):
    strain = np.linspace(0.0, 0.1, 11)
    rows = {"strain": strain, "stress_ratio": 1.0 + strain, "volume_change": -strain, "w2": 0.5}
    cone = {"cone_status": status, "cone_axis_deg": 120.0, "cone_opening_deg": 30.0}
    return pd.DataFrame(rows | cone | {"set": name, "stage": "programme", "failed": failed})


def test_a_loop_that_is_lost_is_marked_on_the_curve_of_its_own_set():
    """Of the mean one loop is lost at 5 %, of the single one none: one mark a panel."""
    table = pd.concat([march("mean", [0] * 5 + [1] * 6), march("single", 0)])
    figure = draw_material(table)
    # Without a cone there is no panel for it.
    assert len(figure.axes) == 3
    for ax in figure.axes:
        marks = [line for line in ax.lines if line.get_marker() == "|"]
        assert [line.get_xdata().tolist() for line in marks] == [[pytest.approx(5.0)]]
        assert marks[0].get_color() == ax.lines[0].get_color()
    cone = draw_material(pd.concat([march("mean", 0, "open"), march("single", 0)]))
    assert len(cone.axes) == 4 and len(cone.axes[3].collections) == 3


def test_arrows_along_the_legs_of_a_cycle_point_the_way_it_goes():
    ax = matplotlib.figure.Figure().add_subplot()
    driven = [0.0, 1.0, 2.0, 3.0, 2.0, 1.0, 0.0, -1.0, 0.0, 1.0]
    draw_cycle(ax, driven, np.arange(10.0), color="black")
    assert ax.lines[1].get_xdata().tolist() == [3.0, -1.0]
    ways = [(arrow.xy[0] - arrow.xyann[0], arrow.xy[1] - arrow.xyann[1]) for arrow in ax.texts]
    assert ways == [(1.0, 1.0), (-1.0, 1.0), (1.0, 1.0)]
    straight = matplotlib.figure.Figure().add_subplot()
    draw_cycle(straight, driven[:4], np.arange(4.0), color="black")
    assert not straight.texts and len(straight.lines) == 1


@pytest.mark.parametrize("height", [2.3, 2.6, 2.65])
def test_labels_of_maps_are_on_the_page(height):
    """Axes of equal units in a figure that is low for them: nothing is cut at its border."""
    figure, (axes,) = new_panels(1, 2, height, sharey=True)
    for ax in axes:
        ax.set(aspect="equal", xlabel="$x_1$", ylabel="$x_2$")
        figure.colorbar(ax.pcolormesh(np.eye(2)), ax=ax, shrink=0.75).set_label("a\nb\nc\nd\ne")
    axes[1].label_outer()
    line = axes[1].plot([0.0, 2.0], [0.0, 2.1], label="key")
    axes[1].legend(handles=line, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)
    picture = np.asarray(Image.open(BytesIO(drawn_file(figure, "map", {})())).convert("L"))
    edges = picture[0], picture[-1], picture[:, 0], picture[:, -1]
    assert min(edge.min() for edge in edges) == 255


@pytest.mark.slow
def test_the_domain_of_a_studied_loop_names_the_unit_of_its_stresses():
    """The loop's mean stiffness is one: its stresses are over kn."""
    found = gl.study(gl.read_snapshot(gl.sample_path()), 62, in_packing=False)
    ax = gl.plot.domain(found.domain, plane="stress", ax=matplotlib.figure.Figure().add_subplot())
    assert ax.get_xlabel() == "stress $P_{11}$ (over $k_n$)"
    stress = found.path.P[0, [0, 3]]
    np.testing.assert_allclose(found.domain.start, stress, rtol=1e-9)


def test_a_series_without_the_packing_has_skill_of_its_own_target_and_predictors():
    rows = {"target": "W2_negative", "predictor": ["order", "traction", "order", "traction"]}
    rows |= {"auc": [0.6, 0.8, 0.5, 0.9], "base": 0.1, "snapshot_after": [1, 1, 2, 2]}
    table = pd.DataFrame(rows)
    panel, bar = skill_by_predictor(table).axes
    assert len(panel.get_yticklabels()) == 2 and bar.get_ylabel().startswith("interval")
    means = [line.get_xdata()[0] for line in panel.lines if line.get_marker() == "|"]
    assert means == pytest.approx([0.85, 0.55])
    # Dots of an interval have its colour.
    shades = [dots.get_facecolor()[:, :3].tolist() for dots in panel.collections]
    assert shades[0] == shades[1] and shades[0][0] != shades[0][1]
