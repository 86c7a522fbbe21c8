"""The cone's surface: its rays, its picture, and what the script writes."""

import json

import matplotlib.image
import numpy as np
import pandas as pd
import pytest

from loops import InputError
from stability import second_order_work, symmetric_spectrum, unstable_fraction
from studies.cone_surface import cone_edge, draw_cone_surface, draw_states
from studies.cone_surface.__main__ import hexagon_states, main


def random_indefinite(seed, count=50):
    operators = np.random.default_rng(seed).standard_normal((4 * count, 3, 3))
    values = symmetric_spectrum(operators)
    return operators[(values[:, 0] < -0.05) & (values[:, 2] > 0.05)][:count]


def test_edge_is_where_the_work_vanishes_and_the_axis_has_the_sign_of_its_own():
    kinds = set()
    for K in random_indefinite(1):
        axis, edge, inside = cone_edge(K)
        norm = np.linalg.norm(K)
        np.testing.assert_allclose(np.linalg.norm(edge, axis=1), 1, rtol=1e-14)
        np.testing.assert_allclose(second_order_work(K, edge), 0, atol=3e-15 * norm)
        np.testing.assert_allclose(edge[0], edge[-1], atol=1e-14)
        assert (second_order_work(K, axis) < 0) == inside and (edge @ axis > 0).all()
        kinds.add(inside)
    assert kinds == {True, False}


def test_solid_angle_of_the_nappes_is_the_unstable_fraction():
    # Over the azimuth phi the nappe takes 1 - cos(polar angle) of the sphere: even steps in phi.
    for K in random_indefinite(2, 10):
        axis, edge, inside = cone_edge(K, count=4001)
        nappes = float(np.mean(1 - edge[:-1] @ axis))
        expected = unstable_fraction(symmetric_spectrum(K))
        assert (nappes if inside else 1 - nappes) == pytest.approx(expected, abs=1e-7)


def test_circular_cone_in_closed_form():
    axis, edge, inside = cone_edge(np.diag([3.0, 3.0, -1.0]))
    assert axis.tolist() == [0, 0, 1] and inside
    np.testing.assert_allclose(edge @ axis, np.sqrt(3) / 2, rtol=1e-14)  # tan(30 deg)^2 = 1/3
    axis, edge, inside = cone_edge(np.diag([-1.0, -1.0, 3.0]))
    assert axis.tolist() == [0, 0, 1] and not inside
    np.testing.assert_allclose(edge @ axis, 0.5, rtol=1e-14)


def test_no_edge_without_a_cone():
    for K in (np.eye(3), -np.eye(3), np.diag([0.0, 1.0, 2.0]), np.zeros((3, 3))):
        assert cone_edge(K)[1].shape == (0, 3)
    # A neutral direction within the cone's plane: the nappe opens flat, and stays finite.
    _, edge, inside = cone_edge(np.diag([-1.0, 0.0, 2.0]))
    assert np.isfinite(edge).all() and inside
    with pytest.raises(InputError, match="operator"):
        cone_edge(np.eye(2))
    with pytest.raises(InputError, match="operator"):
        cone_edge(np.zeros((2, 3, 3)))
    with pytest.raises(InputError, match="not finite"):
        cone_edge(np.full((3, 3), np.nan))


@pytest.mark.parametrize(
    ("K", "said"),
    [
        (np.eye(3), "0.0 %"),
        (-np.eye(3), "100.0 %"),
        (np.diag([-1.0, 0.0, 0.0]), "100.0 %"),
        (np.diag([3.0, 3.0, -1.0]), f"{100 * (1 - np.sqrt(3) / 2):.1f} %"),
    ],
)
def test_title_says_the_fraction(K, said):
    ax = draw_cone_surface(K, title="state")
    assert ax.get_title() == f"state\nunstable: {said} of directions"
    assert draw_cone_surface(K, ax) is ax


def test_hexagon_beyond_its_threshold():
    states = hexagon_states(6, 0.2, 5.0, 0.2, 0.1, 0.2)
    isotropic, drained = (symmetric_spectrum(K) for K in states.values())
    # Both shear modes are lost together; sliding on the biaxial path costs one.
    np.testing.assert_allclose(isotropic[0], isotropic[1], rtol=1e-9)
    assert isotropic[1] < 0 < isotropic[2] and drained[0] < 0 < drained[1]
    assert len(draw_states(states).axes) == 2


def test_script_writes_its_picture_and_numbers(tmp_path):
    main(tmp_path / "out")
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "summary.json", "cone_surface.parquet", "cone_surface.csv",
        "cone_surface.png", "cone_surface.svg",
    }  # fmt: skip
    summary = json.loads((tmp_path / "out/summary.json").read_text())
    table = pd.read_parquet(tmp_path / "out/cone_surface.parquet")
    for name, state in summary["states"].items():
        rays = table[table["state"] == name][["E11", "E22", "sqrt2_E12"]].to_numpy()
        assert len(rays) > 100
        np.testing.assert_allclose(second_order_work(state["K"], rays), 0, atol=1e-14)
    picture = matplotlib.image.imread(tmp_path / "out/cone_surface.png")[..., :3]
    # Vermilion and blue: both kinds of directions are there to see.
    red, blue = picture[..., 0] - picture[..., 2], picture[..., 2] - picture[..., 0]
    assert (red > 0.2).mean() > 0.02 and (blue > 0.1).mean() > 0.02
