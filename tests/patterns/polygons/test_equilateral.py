import numpy as np
import pytest

from loops import (
    InputError,
    LinearFrictional,
    branch_vectors,
    contact_frame,
    contact_state,
    polygon_area,
)
from patterns import diamond, equilateral_polygon, random_loop, regular_polygon


@pytest.mark.parametrize("order", [3, 4, 5, 6, 9, 40])
def test_equal_turns_give_the_regular_polygon(order):
    turns = np.full(order - 2, 2 * np.pi / order)
    turns[0] = np.pi / 2 + np.pi / order
    loop = equilateral_polygon(np.cumsum(turns), strain=[0.0, 0.1], radius=0.7, kn=3.0)
    regular = regular_polygon(order, strain=[0.0, 0.1], radius=0.7, kn=3.0)
    for name in ("x", "x0", "normal_force", "shear_force", "radii"):
        np.testing.assert_allclose(getattr(loop, name), getattr(regular, name), atol=1e-13)
    np.testing.assert_array_equal(loop.contacts, regular.contacts)


def test_four_branches_are_the_diamond():
    alpha = np.radians([20.0, 45.0, 70.0])
    loops = equilateral_polygon(np.stack([np.pi - alpha, np.pi + alpha], axis=-1), strain=0.05)
    expected = diamond(alpha, E1=0.05, E2=0.05)
    np.testing.assert_allclose(loops.x, expected.x, atol=1e-14)
    np.testing.assert_allclose(loops.normal_force, expected.normal_force, rtol=1e-14)


@pytest.mark.parametrize("convex", [True, False])
@pytest.mark.parametrize("order", [6, 7, 12])
def test_directions_of_any_equilateral_loop_give_it_back(order, convex):
    """The closing two are found, numbered from a corner that turns left."""
    loops = random_loop(order, seed=order, convex=convex, size=50)
    d = branch_vectors(loops)
    angles = np.arctan2(d[..., 1], d[..., 0])
    turn = np.sin(angles - np.roll(angles, 1, axis=-1))
    start = np.argmax(turn, axis=-1)[:, None]  # this corner becomes the last one
    angles = np.take_along_axis(angles, (start + 1 + np.arange(order)) % order, axis=-1)
    found = branch_vectors(equilateral_polygon(angles[:, :-2]))
    expected = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    np.testing.assert_allclose(found, expected, atol=1e-11)


def test_branches_are_equal_and_the_reference_barely_touches():
    loops = random_loop(9, seed=2, size=100)
    d = branch_vectors(loops)
    angles = np.arctan2(d[..., 1], d[..., 0])
    left = np.sin(angles[:, -1] - angles[:, -2]) > 0
    loop = equilateral_polygon(angles[left, :-2], strain=0.02, radius=1.5, kn=2.0)
    length = contact_frame(loop.replace(x=loop.x0))[0]
    np.testing.assert_allclose(length, 3.0, rtol=2e-14)
    law = LinearFrictional(kn=2.0, kt=1.0)
    np.testing.assert_allclose(loop.normal_force, law.normal_force(contact_state(loop)), rtol=1e-12)
    assert (polygon_area(loop.x) > 0).all()


def test_closing_branches_may_be_straight():
    """A triangle of sides 2: every second corner is straight, the last one too."""
    loop = equilateral_polygon(np.radians([0.0, 0.0, 120.0, 120.0]))
    angles = np.degrees(np.arctan2(*branch_vectors(loop).T[::-1]))
    np.testing.assert_allclose(angles, [0, 0, 120, 120, -120, -120], atol=1e-6)


@pytest.mark.parametrize(
    ("degrees", "word"),
    [
        ([0.0, 10.0, 20.0], "gap of 2.9"),
        ([0.0, 180.0], "close by themselves"),
        ([0.0, 60.0, 120.0, 180.0, 240.0, 300.0], "close by themselves"),
        ([0.0, 144.0, 288.0], "crosses"),
        ([0.0, -90.0, -120.0], "crosses|clockwise"),
        ([0.0, np.nan], "finite"),
        ([], "finite"),
        (0.0, "finite"),
    ],
)
def test_bad_angles(degrees, word):
    with pytest.raises(InputError, match=word):
        equilateral_polygon(np.radians(degrees))


def test_bad_strain_and_radius():
    with pytest.raises(InputError, match="strain"):
        equilateral_polygon([0.0], strain=1.0)
    with pytest.raises(InputError, match="radius"):
        equilateral_polygon([0.0], radius=-0.5)
