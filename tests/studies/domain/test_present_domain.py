"""Domain of one loop in its present state: programmes in all directions, by closed forms."""

import json

import matplotlib.figure
import numpy as np
import pandas as pd
import pytest

import grainloops as gl
from studies.domain import (
    ENDS,
    LoopDomainParameters,
    goes_on,
    loop_domain_figure,
    loop_domains,
    stretches,
)
from studies.paths.options import PolygonOptions
from tests.command import run

KAPPA, START = 0.2, 0.3


@pytest.fixture(scope="module")
def pentagon():
    """A compressed regular pentagon without shear forces, every programme ended by itself."""
    scene = gl.Scene(gl.regular_polygon(5, strain=START), gl.LinearFrictional(1.0, KAPPA, 0.4))
    return gl.loop_domain(scene, "affine", directions=72)


def row_at(found, degrees):
    angle = found.rows["programme_deg"].to_numpy()
    k = np.argmin(np.abs((angle - degrees + 180.0) % 360.0 - 180.0))
    assert angle[k] % 360.0 == pytest.approx(degrees)
    return found.rows.iloc[k]


def test_isotropic_extension_opens_all_contacts_where_they_part(pentagon):
    row = row_at(pentagon, 225.0)
    # Branches of 1 - START grow to 1.
    assert row["kind"] == "opening"
    assert row["E1"] == pytest.approx(1.0 - 1.0 / (1.0 - START), rel=1e-9)
    assert row["s1"] == pytest.approx(0.0, abs=1e-12)


def test_isotropic_compression_loses_stability_where_the_paper_has_it(pentagon):
    row = row_at(pentagon, 45.0)
    critical = (1.0 + KAPPA) / (2.0 + KAPPA)
    assert row["kind"] == "det_Ks_zero"
    assert (1.0 - row["E1"]) * (1.0 - START) == pytest.approx(1.0 - critical, rel=1e-8)


def test_every_programme_ends_once_and_is_counted(pentagon):
    rows = pentagon.rows
    assert len(rows) == 72 and set(rows["kind"]) <= set(ENDS)
    assert np.isfinite(rows[["E1", "E2", "s1", "s2"]]).all(axis=None)
    angle = np.degrees(np.arctan2(rows["E2"], rows["E1"]))
    apart = (angle - rows["programme_deg"] + 180.0) % 360.0 - 180.0
    np.testing.assert_allclose(apart, 0.0, atol=1e-6)
    assert pentagon.table().equals(rows) and "present state: stable" in repr(pentagon)


@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_the_boundary_goes_around_and_its_line_says_what_ended_it(pentagon, plane):
    ax = gl.plot.domain(pentagon, plane=plane, ax=matplotlib.figure.Figure().add_subplot())
    # Programmes are straight in the plane of strains.
    border = ax.collections[1:] if plane == "strain" else ax.collections
    lines = [path.vertices for drawn in border for path in drawn.get_paths()]
    # At 239 degrees it jumps by a fifth, from det Ks = 0 to where a programme has no continuation.
    assert sum(len(line) - 1 for line in lines) == 71
    ends = {tuple(point) for line in lines for point in (line[0], line[-1])}
    # Each line begins where another one ends.
    assert len(ends) <= len(lines) + 1
    words = [text.get_text() for text in ax.get_legend().get_texts()]
    shares = [float(word.split("(")[1].split(" ")[0]) for word in words if "%" in word]
    assert sum(shares) == pytest.approx(100.0, abs=1.5)
    origin = np.zeros(2) if plane == "strain" else pentagon.start
    np.testing.assert_array_equal(np.ravel(ax.lines[-1].get_xydata()), origin)


def test_what_is_no_loop_or_has_no_closure_is_refused():
    snapshot = gl.read_snapshot(gl.sample_path())
    with pytest.raises(gl.InputError, match=r"one loop. Cut one out: gl\.loop"):
        gl.loop_domain(snapshot, "traction")
    with pytest.raises(gl.InputError, match="closure: got None"):
        gl.loop_domain(gl.loop(snapshot, 62))


def test_the_command_writes_the_boundary(capsys, tmp_path):
    out = tmp_path / "out"
    asked = ("domain", "--snapshot", gl.sample_path(), "--loop", 62, "--directions", 9)
    assert run(*asked, "--closure", "traction", "--out", out) == 0
    rows = pd.read_parquet(out / "boundary.parquet")
    (loop,) = json.loads((out / "summary.json").read_text())["loops"]
    assert loop["ended_by"] == rows["kind"].value_counts().to_dict()
    assert loop["present_state"] == "stable" and "present state stable" in capsys.readouterr().out
    found = gl.loop_domain(
        gl.loop(gl.read_snapshot(gl.sample_path()), 62), "traction", directions=9
    )
    assert rows["kind"].tolist() == found.rows["kind"].tolist()
    np.testing.assert_allclose(rows["E1"], found.rows["E1"], rtol=1e-6, atol=1e-12)


@pytest.fixture(scope="module")
def unstable():
    """A pentagon compressed beyond its threshold, which isotropic strain has in closed form."""
    critical = (1.0 + KAPPA) / (2.0 + KAPPA)
    ring = gl.regular_polygon(5, strain=critical + 0.05)
    scene = gl.Scene(ring, gl.LinearFrictional(1.0, KAPPA, 0.4))
    return scene, gl.loop_domain(scene, "affine", directions=72)


@pytest.mark.parametrize("control", ["strain", "stress"])
def test_a_loop_that_is_unstable_at_its_start_is_not_followed(unstable, monkeypatch, control):
    """Which directions have negative work is told by finite differences of the stress."""

    def refused(*_, **__):
        raise AssertionError("a programme was followed")

    monkeypatch.setattr("stability.paths.domain.FanLimits.follow", refused)
    scene, _ = unstable
    found = gl.loop_domain(scene, "affine", control=control, directions=72)
    rows = found.rows
    assert found.status == "unstable" and set(rows["kind"]) == {"start"} and len(rows) == 72
    assert (rows[["E1", "E2"]] == 0.0).all(axis=None)
    assert (rows[["s1", "s2"]] == found.start).all(axis=None)
    assert "negative second-order work there: along" in repr(found)
    assert "unstable" in repr(found)
    step = 1e-6
    for _, row in rows.iloc[::5].iterrows():
        angle = np.radians(row["programme_deg"])
        way = np.array([np.cos(angle), np.sin(angle)])
        strain = way if control == "strain" else np.linalg.solve(found.tangent, way)
        stress = stress_after(scene, step * strain) - stress_after(scene, -step * strain)
        size = np.linalg.norm(strain) * np.linalg.norm(stress)
        assert row["start_w2"] == pytest.approx(strain @ stress / size, abs=1e-6)


def stress_after(scene, strain):
    """Normal stresses of a pentagon whose centres and branches follow a small strain."""
    graph, (i, j) = scene.graph, scene.graph.contacts.T
    d = graph.x[j] - graph.x[i]
    new = d * (1.0 - strain)
    length, touching = np.linalg.norm(new, axis=1), graph.radii[i] + graph.radii[j]
    n, old = new / length[:, None], d / np.linalg.norm(d, axis=1)[:, None]
    turn = np.arctan2(old[:, 0] * n[:, 1] - old[:, 1] * n[:, 0], (old * n).sum(axis=1))
    N, T = touching - length, -KAPPA * length * turn
    force = N[:, None] * n + T[:, None] * np.stack([-n[:, 1], n[:, 0]], axis=1)
    (x, y), (after_x, after_y) = graph.x.T, np.roll(graph.x, -1, axis=0).T
    return (force * d).sum(axis=0) / (0.5 * abs((x * after_y - y * after_x).sum()))


@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_the_figure_of_an_unstable_loop_shows_its_directions(unstable, plane):
    _, found = unstable
    ax = gl.plot.domain(found, plane=plane, ax=matplotlib.figure.Figure().add_subplot())
    words = [text.get_text() for text in ax.get_legend().get_texts()]
    cone = gl.plane_cone(found.tangent)
    share = 100.0 * float(cone.opening) / np.pi
    assert 1.0 < share and words[0] == f"negative second-order work ({share:.1f} % of the strains)"
    assert words[-1] == "present state, unstable"


@pytest.fixture(scope="module")
def square():
    """Domains of the square diamond without load, contacts that stick and that slide."""
    options = PolygonOptions(4, kappa=0.2, phi_deg=20.0, closure="affine")
    _, _, alone = loop_domains(LoopDomainParameters((options,), directions=21))
    return alone


def test_programmes_of_a_loop_without_load_end_once_each(square):
    assert list(square) == ["contacts never slide", r"contacts slide at $|T| = \mu N$"]
    for found in square.values():
        rows = found.rows
        assert len(rows) == 21 and np.isfinite(rows[["E1", "E2", "s1", "s2"]]).all(axis=None)
        angle = np.degrees(np.arctan2(rows["E2"], rows["E1"]))
        # Contacts far from the isotropic programme slide from the first touch, and are lost there.
        away = np.hypot(rows["E1"], rows["E2"]) > 0
        np.testing.assert_allclose(angle[away], rows["programme_deg"][away], atol=1e-6)
        assert away.all() == ("never" in next(c for c, one in square.items() if one is found))
    # On the isotropic programme the diamond is lost at kappa/(1 + kappa), whether or not it slides.
    for found in square.values():
        row = row_at(found, 45.0)
        assert row["kind"] == "det_Ks_zero" and row["E1"] == pytest.approx(0.2 / 1.2, rel=1e-9)


@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_the_figure_of_a_loop_without_load_has_its_fan_and_an_open_boundary(square, plane):
    figure = loop_domain_figure(square, plane)
    for ax, (contacts, found) in zip(figure.axes, square.items(), strict=True):
        boundary = list(ax.collections)
        if plane == "strain":
            fan = boundary.pop(0)
            assert all(np.array_equal(path.vertices[0], [0.0, 0.0]) for path in fan.get_paths())
        lines = [path.vertices for drawn in boundary for path in drawn.get_paths()]
        # Of the sticking one the curve of det Ks ends far within the range, on either side.
        jumps = 2 if "never" in contacts else 0
        assert sum(len(line) - 1 for line in lines) == len(found.rows) - 1 - jumps
        words = [text.get_text() for text in ax.get_legend().get_texts()]
        assert words[-1] == "no load" and ax.get_legend().get_title().get_text() == contacts
    figure.draw_without_rendering()


def border(reach, **changed):
    """Ends of programmes all around at these strains, three to a degree."""
    angle = np.linspace(0.0, 360.0, len(reach), endpoint=False)
    turn = np.radians(angle)
    ends = {"E1": reach * np.cos(turn), "E2": reach * np.sin(turn), "programme_deg": angle}
    return pd.DataFrame(ends | changed)


def test_no_line_crosses_a_notch_of_the_border():
    """A notch of 3 programmes, one programme alone, one of unknown end, one that is missing."""
    reach = 1.0 + 0.3 * np.cos(np.linspace(0.0, 2.0 * np.pi, 90, endpoint=False))
    reach[20:23] *= 0.8
    reach[40] *= 1.2
    reach[60] = np.nan
    rows = border(reach).drop(index=70)
    on = goes_on(rows)
    stops = [19, 22, 39, 40, 59, 60, 69]
    assert rows.index[~on].tolist() == stops
    lines = stretches(rows, ["E1", "E2"], np.isfinite(rows["E1"]).to_numpy())
    assert sum(len(line) - 1 for line in lines) == len(rows) - len(stops) + 1
    # The programme alone is a dot.
    assert [len(line) for line in lines if np.ptp(line) == 0.0 or (line[0] == line[-1]).all()] == [
        2
    ]


@pytest.mark.parametrize("corner", [0.0, 0.5])
def test_a_border_with_corners_goes_on(corner):
    """Of a square, and of one whose sides are bent, every programme joins the next one."""
    turn = np.linspace(0.0, 2.0 * np.pi, 90, endpoint=False)
    reach = 1.0 / np.maximum(np.abs(np.cos(turn)), np.abs(np.sin(turn)) * (1.0 + corner))
    assert goes_on(border(reach)).all()


@pytest.mark.slow
def test_a_hexagon_is_lost_earlier_once_its_contacts_slide():
    """The border of the sliding hexagon has one notch, across which there is no line."""
    options = PolygonOptions(6, kappa=0.2, phi_deg=5.0, closure="affine")
    _, _, alone = loop_domains(LoopDomainParameters((options,), directions=91))
    never, slides = (~goes_on(found.rows) for found in alone.values())
    assert never.sum() == 1 and slides.sum() == 2  # the open ends of the fan are one of them
