"""Blocks of a law whose normal force answers to shear: the protocol allows it."""

import numpy as np
import pytest

from loops import (
    GrainGraph,
    LinearFrictional,
    Regime,
    RollingResistance,
    contact_state,
    contact_tangent,
    translational_blocks,
)
from loops.assembly import contact_sizes
from patterns import diamond


class Dilating(LinearFrictional):
    """`N' = -kn un' - c ut'`, `T' = -e un' - kt ut'`: all four entries of D differ."""

    def local_stiffness(self, state, regime):
        D = super().local_stiffness(state, regime).copy()
        D[..., 0, 1] += 0.3
        D[..., 1, 0] -= 0.2
        return D


def test_spins_and_translations_meet_every_entry_of_the_law():
    rng = np.random.default_rng(4)
    angle = rng.uniform(0, 2 * np.pi, 6)
    n = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    t = np.stack([-n[:, 1], n[:, 0]], axis=-1)
    length = rng.uniform(0.8, 1.0, 6)
    x = np.concatenate([np.zeros((1, 2)), length[:, None] * n])
    radii = np.concatenate([[0.6], rng.uniform(0.4, 0.6, 6)])
    N, T = rng.uniform(0.1, 0.3, 6), rng.uniform(-0.1, 0.1, 6)
    star = GrainGraph(
        x=x, radii=radii, contacts=[[0, k] for k in range(1, 7)], normal_force=N, shear_force=T
    )
    law, elastic = Dilating(kn=1.2, kt=0.5), np.full(6, Regime.ELASTIC, dtype=np.int8)
    state = contact_state(star)
    blocks = contact_tangent(state, law, elastic)
    D = np.array([[1.2, 0.3], [-0.2, 0.5]])
    # A spin w of grain i shears by ut' = -a_i w: the force on j changes by -D (0, ut').
    for q, arm in ((blocks[:, :2, 2], state.arm_i), (blocks[:, :2, 3], state.arm_j)):
        expected = -arm[:, None] * (D[0, 1] * n + D[1, 1] * t)
        np.testing.assert_allclose(q, expected, rtol=1e-13)
    # A parting d' changes the force by -(D (un', ut')) in (n, t), and (n, t) turns by t.d'/l.
    frame = np.stack([n, t], axis=-1)
    turn = np.zeros((6, 2, 2))
    turn[:, 0, 1], turn[:, 1, 1] = T / length, -N / length
    expected = frame @ (D + turn) @ np.swapaxes(frame, -1, -2)
    found = translational_blocks(state, law, elastic)
    np.testing.assert_allclose(found, expected, atol=1e-13)


def test_sizes_bound_every_entry_by_its_own_terms():
    """Without shear stiffness what is left of spins is the turned force, or a rolling spring."""
    slack, regime = LinearFrictional(kn=1.0, kt=0.0), np.full(4, Regime.ELASTIC, dtype=np.int8)
    state = contact_state(diamond(0.7, E1=0.1, E2=0.1, T=0.05))
    for law, first in ((slack, 0), (RollingResistance(slack, k_r=0.3), 2)):
        entries, sizes = (of(state, law, regime) for of in (contact_tangent, contact_sizes))
        assert np.abs(entries[:, 2:, first : first + 2]).max() > 0.01
        assert (np.abs(entries) <= sizes * (1 + 1e-15)).all()


def test_sizes_are_the_sums_of_the_terms():
    """Of a contact along axis 1: kt and N/l, which the entries subtract, are added."""
    pair = GrainGraph(
        x=[[0.0, 0.0], [0.9, 0.0]], radii=[0.5, 0.5], contacts=[[0, 1]],
        normal_force=[0.1], shear_force=[0.05],
    )  # fmt: skip
    state, regime = contact_state(pair), np.full(1, Regime.ELASTIC, dtype=np.int8)
    law = LinearFrictional(kn=1.2, kt=0.5)
    entries, (sizes,) = (of(state, law, regime) for of in (contact_tangent, contact_sizes))
    wanted = np.array([[1.2, 0.05 / 0.9], [0.0, 0.5 + 0.1 / 0.9]])
    np.testing.assert_allclose(sizes[:2, :2], wanted, rtol=1e-14, atol=1e-16)
    assert abs(entries[0, 1, 1]) == pytest.approx(0.5 - 0.1 / 0.9, rel=1e-14)
