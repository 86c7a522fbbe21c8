"""Signs of shear from the balance of the grains: exact states of self-stress as oracles."""

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

from loops import GrainGraph, contact_frame
from patterns.snapshots.yade.shear import shear_signs


def lattice(rows=7, seed=0):
    """Touching discs on a triangular lattice, some contacts open."""
    rng = np.random.default_rng(seed)
    x = np.array([[2 * i + j % 2, 3**0.5 * j] for j in range(rows) for i in range(rows)], float)
    near = np.linalg.norm(x[:, None] - x[None], axis=-1) < 2.1
    pairs = np.argwhere(np.triu(near, 1))
    return x, np.ones(len(x)), pairs[rng.random(len(pairs)) < 0.85]


def in_balance(x, radii, pairs, seed):
    """Random N, T that leave force and moment of all inner grains zero, by the null space.

    Built from cross products of whole vectors, apart from the code under test.
    """
    graph = GrainGraph(x=x, radii=radii, contacts=pairs)
    _, n, t = contact_frame(graph)
    count = len(pairs)
    force = np.zeros((len(x), 3, 2 * count))
    for c, (one, two) in enumerate(pairs):
        for column, f in ((c, n[c]), (count + c, t[c])):
            for grain, sign, arm in ((one, -1, n[c] * radii[one]), (two, 1, -n[c] * radii[two])):
                force[grain, :2, column] += sign * f
                force[grain, 2, column] += arm[0] * sign * f[1] - arm[1] * sign * f[0]
    inner = np.ones(len(x), bool)
    inner[(x - x.min(axis=0) < 1e-9).any(axis=1) | (x.max(axis=0) - x < 1e-9).any(axis=1)] = False
    rows = np.ones((len(x), 3), bool)
    rows[~inner, :2] = False
    free = scipy.linalg.null_space(force.reshape(-1, 2 * count)[rows.ravel()])
    state = free @ np.random.default_rng(seed).normal(size=free.shape[1])
    return state[:count], state[count:]


@pytest.mark.parametrize("seed", range(6))
def test_signs_of_a_state_in_balance(seed):
    x, radii, pairs = lattice(seed=seed)
    normal, shear = in_balance(x, radii, pairs, seed)
    found = shear_signs(x, radii, pairs, normal, np.abs(shear))
    sure = found.decided & (np.abs(shear) > 1e-9)
    assert sure.mean() > 0.6
    assert found.residual < 1e-6
    assert (found.sign[sure] == np.sign(shear)[sure]).all()


def test_noise_makes_small_ones_undecided_and_leaves_the_others_right():
    x, radii, pairs = lattice(rows=10, seed=3)
    normal, shear = in_balance(x, radii, pairs, 3)
    noise = np.random.default_rng(4).normal(size=len(normal)) * 0.01 * np.abs(normal).mean()
    found = shear_signs(x, radii, pairs, normal + noise, np.abs(shear))
    wrong = found.sign != np.sign(shear)
    assert 1e-3 < found.residual < 0.05
    assert not wrong[found.decided].any()
    assert np.abs(shear)[~found.decided].max() < np.abs(shear)[found.decided].max()


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1000), quarter=st.integers(0, 3))
def test_order_of_grains_and_contacts_does_not_matter(seed, quarter):
    x, radii, pairs = lattice(seed=1)
    normal, shear = in_balance(x, radii, pairs, 2)
    found = shear_signs(x, radii, pairs, normal, np.abs(shear))
    rng = np.random.default_rng(seed)
    grains, contacts = rng.permutation(len(x)), rng.permutation(len(pairs))
    renamed = np.argsort(grains)[pairs][contacts]
    flip = rng.random(len(pairs)) < 0.5
    renamed[flip] = renamed[flip][:, ::-1]
    turn = np.linalg.matrix_power(np.array([[0.0, -1.0], [1.0, 0.0]]), quarter)
    other = shear_signs(
        x[grains] @ turn.T, radii[grains], renamed, normal[contacts], np.abs(shear)[contacts]
    )
    sure = found.decided & (np.abs(shear) > 1e-6)
    assert (other.sign == found.sign[contacts])[sure[contacts]].all()


def test_mirrored_signs_change():
    x, radii, pairs = lattice(seed=1)
    normal, shear = in_balance(x, radii, pairs, 2)
    found = shear_signs(x, radii, pairs, normal, np.abs(shear))
    mirrored = shear_signs(x * [-1, 1], radii, pairs, normal, np.abs(shear))
    sure = found.decided & (np.abs(shear) > 1e-6)
    assert (mirrored.sign == -found.sign)[sure].all()


def test_forces_out_of_balance_show_in_the_residual():
    x, radii, pairs = lattice(seed=1)
    normal, shear = in_balance(x, radii, pairs, 2)
    rng = np.random.default_rng(0)
    loose = shear_signs(x, radii, pairs, np.abs(rng.normal(size=len(pairs))), np.abs(shear))
    assert loose.residual > 0.1
    assert shear_signs(x, radii, pairs, normal, np.abs(shear)).residual < 1e-6


def test_no_shear_and_no_force_at_all():
    x, radii, pairs = lattice(seed=1)
    zero = np.zeros(len(pairs))
    found = shear_signs(x, radii, pairs, zero, zero)
    assert found.residual == 0
    assert not found.decided.any()
