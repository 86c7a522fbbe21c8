"""The table of docs/evidence/larger-loops.md: where Ks first loses definiteness in (11, 22)."""

import numpy as np
import pytest
from scipy.optimize import brentq

from loops import InputError, LinearFrictional, macroscopic_tangent, polygon_area
from patterns import regular_polygon
from stability import restrict, symmetric_spectrum

KAPPA = 0.3


def smallest(order, strain, closure, spins, subspace="diagonal", orientation="vertex", kappa=KAPPA):
    loop = regular_polygon(order, strain=strain, orientation=orientation)
    law = LinearFrictional(kn=1.0, kt=kappa)
    tangent = macroscopic_tangent(loop, law, closure, spins=spins)
    return symmetric_spectrum(restrict(tangent.matrix, subspace))[0]


def critical_strain(*arguments, **options):
    return brentq(
        lambda strain: smallest(arguments[0], strain, *arguments[1:], **options),
        1e-9,
        0.65 if arguments[1] == "affine" else 0.4,
        xtol=1e-15,
        rtol=1e-14,
    )


def stable(kappa):
    return (1 + kappa) / (2 + kappa)


def diamond(kappa):
    return kappa / (1 + kappa)


CELLS = [
    ("affine", "blocked", 3, stable),
    ("affine", "blocked", 4, diamond),
    *[("affine", "blocked", n, stable) for n in (5, 6, 7, 8, 12)],
    ("traction", "blocked", 4, diamond),
    *[("traction", "blocked", n, diamond) for n in (5, 6, 7, 8, 12)],
    ("traction", "free", 4, diamond),
]


@pytest.mark.parametrize(("closure", "spins", "order", "expected"), CELLS)
@pytest.mark.parametrize("kappa", [0.1, 0.3, 0.5])
def test_critical_strain(closure, spins, order, expected, kappa):
    found = critical_strain(order, closure, spins, kappa=kappa)
    assert abs(found - expected(kappa)) < 1e-9


@pytest.mark.parametrize("kappa", [0.1, 0.3, 0.5])
def test_the_triangle_is_the_stable_loop(kappa):
    for closure in ("affine", "traction"):
        found = brentq(
            lambda strain, closure=closure: smallest(3, strain, closure, "blocked", kappa=kappa),
            1e-9,
            0.7,
            xtol=1e-15,
        )
        assert abs(found - stable(kappa)) < 1e-9
    found = brentq(
        lambda strain: smallest(3, strain, "traction", "free", kappa=kappa), 1e-9, 0.6, xtol=1e-15
    )
    assert abs(found - 0.5) < 1e-9


@pytest.mark.parametrize("order", [5, 6, 7, 8, 12])
def test_free_spins_make_longer_loops_unstable_from_the_first_load(order):
    """A rolling mechanism: nothing resists it at no load, and the load itself is against it."""
    assert abs(smallest(order, 0.0, "traction", "free")) < 1e-13
    # The eigenvalue falls linearly with the strain: no threshold.
    values = [smallest(order, strain, "traction", "free") for strain in (1e-6, 2e-6)]
    assert values[0] < -1e-7
    assert values[1] / values[0] == pytest.approx(2.0, rel=1e-4)


@pytest.mark.parametrize("order", [3, 4, 5, 6, 9])
def test_the_full_form_is_lost_at_the_diamonds_threshold_for_every_order(order):
    """Blocked spins: in the direction that turns the loop against its held grains."""
    for closure in ("affine", "traction"):
        found = brentq(
            lambda strain, closure=closure: smallest(order, strain, closure, "blocked", "full"),
            1e-9,
            0.3,
            xtol=1e-15,
        )
        assert abs(found - diamond(KAPPA)) < 1e-9
    loop = regular_polygon(order, strain=diamond(KAPPA))
    matrix = macroscopic_tangent(loop, LinearFrictional(kn=1.0, kt=KAPPA), "affine").matrix
    assert np.abs(matrix @ [0, 1, -1, 0]).max() < 1e-14


def test_regular_polygon_closed_forms():
    for order in (3, 4, 6, 11):
        loop = regular_polygon(order, strain=[0.0, 0.1], radius=2.0, kn=3.0, orientation="edge")
        area = order * 16 / (4 * np.tan(np.pi / order))
        np.testing.assert_allclose(polygon_area(loop.x), [area, 0.81 * area], rtol=1e-14)
        np.testing.assert_allclose(loop.normal_force[1], 3.0 * 4.0 * 0.1, rtol=1e-13)
        edge = loop.x[0, 0] - loop.x[0, -1]
        assert abs(edge[0]) < 1e-13  # the edge across axis 1


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"order": 2}, "order"),
        ({"order": 4, "strain": 1.0}, "strain"),
        ({"order": 4, "strain": np.nan}, "strain"),
        ({"order": 4, "orientation": "corner"}, "corner"),
        ({"order": 4, "radius": 0.0}, "radius"),
    ],
)
def test_bad_polygons(arguments, word):
    with pytest.raises(InputError, match=word):
        regular_polygon(**arguments)
