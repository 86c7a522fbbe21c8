import numpy as np
import pytest
import shapely

from loops import (
    InputError,
    LinearFrictional,
    branch_vectors,
    contact_frame,
    contact_state,
    polygon_area,
)
from patterns import opposite_gap, random_loop

KINDS = [
    (3, True, 0.5),
    (4, True, 0.0),
    (5, True, 0.8),
    (12, True, 0.3),
    (40, True, 0.1),
    (4, False, 0.8),
    (6, False, 0.0),
    (7, False, 0.5),
    (12, False, 0.3),
    (40, False, 0.0),
]


def turns(loops):
    """Turning angle at every corner."""
    d = branch_vectors(loops)
    following = np.roll(d, -1, axis=-2)
    cross = d[..., 0] * following[..., 1] - d[..., 1] * following[..., 0]
    return np.arctan2(cross, (d * following).sum(axis=-1))


@pytest.mark.parametrize(("order", "convex", "polydispersity"), KINDS)
def test_loops_have_the_requested_properties(order, convex, polydispersity):
    loops = random_loop(
        order, seed=order, convex=convex, polydispersity=polydispersity, radius=2.0, size=30
    )
    touching = loops.radii + np.roll(loops.radii, -1, axis=-1)
    np.testing.assert_allclose(contact_frame(loops)[0], touching, rtol=0, atol=4e-15 * order)
    assert (np.abs(loops.radii / 2.0 - 1.0) <= polydispersity).all()
    assert (opposite_gap(loops) > -1e-12).all()
    assert shapely.is_valid(shapely.polygons(loops.x)).all()
    assert (polygon_area(loops.x) > 0).all()
    np.testing.assert_allclose(turns(loops).sum(axis=-1), 2 * np.pi, rtol=1e-12)
    assert ((turns(loops).min(axis=-1) > 0) == convex).all()
    assert np.abs(turns(loops).min(axis=-1)).min() > 0.019


def test_same_seed_same_loops():
    one, same, other = (random_loop(8, seed, polydispersity=0.2, strain=0.1) for seed in (5, 5, 6))
    for name in ("x", "radii", "normal_force", "shear_force"):
        np.testing.assert_array_equal(getattr(one, name), getattr(same, name))
        assert np.abs(getattr(one, name) - getattr(other, name)).max() > 1e-3


@pytest.mark.parametrize("strain", [1e-8, 1e-3, 0.3])
def test_contacts_are_consistent(strain):
    loops = random_loop(6, seed=7, polydispersity=0.5, strain=strain, mu=0.3, kn=5.0, size=200)
    law = LinearFrictional(kn=5.0, kt=1.0, mu=0.3)
    overlap = law.normal_force(contact_state(loops))
    # Lengths of about 1 carry the rounding of six branches.
    np.testing.assert_allclose(loops.normal_force, overlap, rtol=0, atol=5.0 * 1e-14)
    touching = loops.radii + np.roll(loops.radii, -1, axis=-1)
    np.testing.assert_allclose(loops.normal_force, 5.0 * strain * touching, rtol=1e-15)
    mobilised = loops.shear_force / (0.3 * loops.normal_force)
    assert (np.abs(mobilised) < 1).all()
    # Uniform in (-1, 1): mean 0 and variance 1/3, 1200 values.
    assert abs(mobilised.mean()) < 0.06
    assert abs(mobilised.var() - 1 / 3) < 0.03


def test_unstrained_loops_carry_nothing():
    loop = random_loop(6, seed=8)
    assert not loop.normal_force.any()
    assert not loop.shear_force.any()
    np.testing.assert_array_equal(loop.x, loop.x0)


def test_batch_axes():
    assert random_loop(5).batch_shape == ()
    assert random_loop(5, size=3).batch_shape == (3,)
    assert random_loop(5, size=(2, 3), strain=[0.0, 0.1, 0.2]).batch_shape == (2, 3)
    many = random_loop(5, size=(), strain=[[0.0], [0.1]])
    assert many.batch_shape == (2, 1)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"order": 2}, "order"),
        ({"order": 4.5}, "order"),
        ({"order": 5, "polydispersity": 1.0}, "polydispersity"),
        ({"order": 5, "mu": np.inf}, "mu"),
        ({"order": 5, "strain": 1.0}, "strain"),
        ({"order": 5, "radius": 0.0}, "radius"),
        ({"order": 3, "convex": False}, "non-convex"),
        ({"order": 4, "convex": False}, "non-convex"),
    ],
)
def test_bad_loops(arguments, word):
    with pytest.raises(InputError, match=word):
        random_loop(**arguments)
