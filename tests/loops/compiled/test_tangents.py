"""Compiled tangents: within their bounds of numpy's, within 1e-12 of 50 digits."""

import numpy as np
import pytest

from loops import (
    GrainGraph,
    HertzMindlin,
    LinearFrictional,
    Regime,
    RollingResistance,
    find_faces,
    loop_batches,
    macroscopic_tangent,
)
from loops.compiled import given
from loops.loop_batches import TANGENTS, compiled_packing
from patterns.synthetic import synthetic_network
from stability.verdict import loop_spectra
from tests.oracles.fifty_digits import affine_tangent_50, as_array, traction_tangent_50

KN, KT, MU = 1.0, 0.4, 0.5


def stiff_network(overlap, *, periodic=False, sliding=0.1, grains=600):
    """A synthetic network with forces of the given mean `N/(kn l)`."""
    graph = synthetic_network(grains, seed=2, periodic=periodic)
    rng = np.random.default_rng(0)
    slides = rng.random(graph.contact_count) < sliding
    normal = graph.normal_force * (overlap / 1e-3)
    share = np.where(slides, np.sign(graph.shear_force), rng.uniform(-0.9, 0.9, len(normal)))
    graph = graph.replace(normal_force=normal, shear_force=share * MU * normal)
    return graph, np.where(slides, Regime.SLIDING, Regime.ELASTIC).astype(np.int8)


def compiled(graph, law, regime):
    faces = find_faces(graph)
    packing = compiled_packing(graph, faces, law, regime, threads=2)
    tangents, poor = packing.tangents(given(faces.loops, np.int64))
    return faces, tangents, poor.any(axis=0)


def assert_same_tangents(graph, law, regime):
    """Both err by their own bound at most; of the free ones a few are left to the plain closure."""
    faces, tangents, poor = compiled(graph, law, regime)
    row = np.full(len(faces.kind), -1)
    row[faces.loops] = np.arange(len(faces.loops))
    undecided = np.zeros((2, len(faces.loops)), dtype=bool)
    for batch in loop_batches(graph, faces):
        own, regimes, at = law.take(batch.contacts), regime[batch.contacts], row[batch.face]
        for (closure, spins), fast in zip(TANGENTS, tangents, strict=True):
            plain = macroscopic_tangent(batch.graph, own, closure, spins=spins, regime=regimes)
            size = np.linalg.norm(plain.matrix, axis=(1, 2))
            error = np.linalg.norm(fast.matrix[at] - plain.matrix, axis=(1, 2))
            good = fast.trusted[at] & plain.trusted
            np.testing.assert_allclose(fast.volume[at], plain.volume, rtol=1e-12)
            assert (error <= fast.rounding[at] + plain.rounding)[good].all()
            if spins == "blocked":
                # The plain closure loses digits where contacts slide, the kernel's slips do not.
                assert good.all()
                assert (fast.rounding[at] < 1e-10 * size).all()
                continue
            sign, known = signs(plain)
            other, too = signs(fast, at)
            assert (sign == other)[known & too].all()
            undecided[:, at] = ~known, ~too & ~poor[at]
    assert np.count_nonzero(poor) <= 0.06 * len(poor)
    lost, more = np.count_nonzero(undecided[0]), np.count_nonzero(undecided[1])
    assert more <= lost + 0.04 * len(poor)


def signs(tangent, at=slice(None)):
    """Sign of the smallest eigenvalue, and whether it is known."""
    smallest = loop_spectra(np.nan_to_num(tangent.matrix[at]))[:, 0]
    return smallest > 0, tangent.trusted[at] & (np.abs(smallest) > tangent.error[at])


@pytest.mark.parametrize(
    ("overlap", "periodic", "increment"),
    [
        (1e-1, False, "branch"), (1e-1, True, "radii"), (1e-3, True, "branch"),
        (1e-8, False, "radii"), (1e-8, True, "branch"),
    ],
)  # fmt: skip
def test_against_the_plain_closures(overlap, periodic, increment):
    graph, regime = stiff_network(overlap, periodic=periodic)
    assert_same_tangents(graph, LinearFrictional(KN, KT, MU, increment), regime)


def test_other_spins_are_left_to_the_plain_closure():
    """Rolling resistance couples spins in a way that the kernel does not know."""
    graph, regime = stiff_network(1e-3, grains=100)
    law = RollingResistance(LinearFrictional(KN, KT, MU), k_r=0.1)
    _, (_, traction, free), poor = compiled(graph, law, regime)
    assert poor.all()
    assert traction.trusted.all()
    assert not free.trusted.any()


def test_a_law_with_a_stiffness_for_each_contact():
    graph, regime = stiff_network(1e-3)
    rng = np.random.default_rng(1)
    kn = rng.uniform(0.5, 2.0, graph.contact_count)
    assert_same_tangents(graph, LinearFrictional(kn, KT * kn, MU, "radii"), regime)


def test_spheres():
    graph, regime = stiff_network(1e-3)
    assert_same_tangents(graph, HertzMindlin(young=1.0, poisson=0.2, mu=MU), regime)


def test_regimes_read_from_the_state():
    graph, _ = stiff_network(1e-3)
    law = LinearFrictional(KN, KT, MU)
    faces = find_faces(graph)
    packing = compiled_packing(graph, faces, law)
    assert set(packing.regime.tolist()) == {Regime.ELASTIC, Regime.SLIDING}
    assert_same_tangents(graph, law, packing.regime)


@pytest.mark.parametrize("overlap", [1e-1, 1e-3, 1e-8])
def test_against_fifty_digits(overlap):
    graph, regime = stiff_network(overlap, sliding=0.3)
    faces, tangents, _ = compiled(graph, LinearFrictional(KN, KT, MU), regime)
    rng = np.random.default_rng(3)
    for row in rng.choice(np.flatnonzero(faces.order[faces.loops] <= 6), 12, replace=False):
        face = faces.loops[row]
        at = slice(faces.offsets[face], faces.offsets[face + 1])
        x, c = graph.x[faces.grains[at]], faces.contacts[at]
        state = (x, x, graph.normal_force[c], graph.shear_force[c], KN, KT, MU, regime[c])
        for exact_tangent, fast in zip(
            (affine_tangent_50, traction_tangent_50), tangents[:2], strict=True
        ):
            exact = as_array(exact_tangent(*state))
            error = np.linalg.norm(fast.matrix[row] - exact) / np.linalg.norm(exact)
            assert error < 1e-12, (fast.closure, faces.order[face], fast.condition[row])


def test_singular_loops_are_left_to_the_plain_closure():
    """Open contacts have no compliance; a hexagon of frictionless contacts has mechanisms."""
    angle = np.pi / 3 * np.arange(6)
    x = np.column_stack([np.cos(angle), np.sin(angle)])
    ring = np.column_stack([np.arange(6), np.roll(np.arange(6), -1)])
    graph = GrainGraph(x=x, radii=[0.5] * 6, contacts=ring)
    for law, regime in (
        (LinearFrictional(1.0, 0.0, 0.0), Regime.ELASTIC),
        (LinearFrictional(1.0, 0.5, 0.5), Regime.OPEN),
    ):
        regimes = np.full(6, regime, dtype=np.int8)
        _, _, poor = compiled(graph, law, regimes)
        assert poor.tolist() == [True]
