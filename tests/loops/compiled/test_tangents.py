"""Tangents by kernels: within their bounds of numpy's, within 1e-12 of 50 digits."""

from unittest.mock import patch

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
from loops.loop_batches import TANGENTS, loops_of_packing
from patterns import synthetic_network
from stability.verdict import loop_spectra
from tests.oracles.loop_balls import exact_tangent
from tests.oracles.rings import random_rings, slide, through

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


def by_kernels(graph, law, regime=None):
    faces = find_faces(graph)
    packing = loops_of_packing(graph, faces, law, regime, threads=2)
    return faces, packing, packing.tangents(slice(None), TANGENTS, True)


def assert_same_tangents(graph, law, regime):
    """Both err by their own bound at most; where one has no answer the other has none."""
    faces, packing, fast = by_kernels(graph, law, regime)
    plain = packing.tangents(slice(None), TANGENTS, False)
    for one, other in zip(fast, plain, strict=True):
        np.testing.assert_array_equal(one.trusted, other.trusted)
        error = np.linalg.norm(one.matrix - other.matrix, axis=(1, 2))
        assert (error <= one.rounding + other.rounding)[one.trusted].all()
        np.testing.assert_allclose(one.volume, other.volume, rtol=1e-12)
        # Kernels take norms of rows; numpy keeps a contact's motion if it is soft in any loop, and
        # looks for null vectors of what is nearly singular.
        ratio = (one.rounding / other.rounding)[one.trusted]
        assert (
            np.quantile(ratio, 0.02) > 0.1 and ratio.max() < 100.0 and 0.8 < np.median(ratio) < 4.0
        )
        (sign, known), (also, too) = signs(one), signs(other)
        assert (sign == also)[known & too].all()
        assert np.count_nonzero(known != too) <= 0.01 * len(known)
    row = np.full(len(faces.kind), -1)
    row[faces.loops] = np.arange(len(faces.loops))
    for batch in loop_batches(graph, faces):
        own, regimes, at = law.take(batch.contacts), regime[batch.contacts], row[batch.face]
        for (closure, spins), one in zip(TANGENTS, fast, strict=True):
            cut = macroscopic_tangent(batch.graph, own, closure, spins=spins, regime=regimes)
            error = np.linalg.norm(one.matrix[at] - cut.matrix, axis=(1, 2))
            assert (error <= one.rounding[at] + cut.rounding)[one.trusted[at] & cut.trusted].all()
    assert all(tangent.trusted.all() for tangent in fast[:2])
    assert np.count_nonzero(~fast[2].trusted) <= 0.01 * len(faces.loops)


def signs(tangent):
    """Sign of the smallest eigenvalue, and whether it is known."""
    smallest = loop_spectra(np.nan_to_num(tangent.matrix))[:, 0]
    return smallest > 0, tangent.trusted & (np.abs(smallest) > tangent.error)


@pytest.mark.parametrize(
    ("overlap", "periodic", "increment"),
    [
        (1e-1, False, "branch"), (1e-1, True, "radii"), (1e-3, True, "branch"),
        (1e-8, False, "radii"), (1e-8, True, "branch"),
    ],
)  # fmt: skip
def test_against_numpy(overlap, periodic, increment):
    graph, regime = stiff_network(overlap, periodic=periodic)
    assert_same_tangents(graph, LinearFrictional(KN, KT, MU, increment), regime)


def test_rolling_springs_are_left_to_the_saddle_system():
    """They act on the spins themselves, which the equations of a ring never have as unknowns."""
    graph, regime = stiff_network(1e-3, grains=100)
    law = RollingResistance(LinearFrictional(KN, KT, MU), k_r=0.1)
    faces, _, (_, traction, free) = by_kernels(graph, law, regime)
    _, _, (_, same, other) = by_kernels(graph, law.law, regime)
    np.testing.assert_array_equal(traction.matrix, same.matrix)
    stiffer = loop_spectra(np.nan_to_num(free.matrix - other.matrix))[:, 2]
    assert free.trusted.all() and np.median(stiffer) > 1e-3
    for batch in loop_batches(graph, faces):
        at = np.searchsorted(faces.loops, batch.face)
        regimes = regime[batch.contacts]
        own = macroscopic_tangent(
            batch.graph, law.take(batch.contacts), "traction", spins="free", regime=regimes
        )
        np.testing.assert_array_equal(free.matrix[at], own.matrix)


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
    _, packing, _ = by_kernels(graph, law)
    assert set(packing.regime.tolist()) == {Regime.ELASTIC, Regime.SLIDING}
    assert_same_tangents(graph, law, packing.regime)


@pytest.mark.parametrize("overlap", [1e-1, 1e-3, 1e-8])
def test_against_fifty_digits(overlap):
    graph, regime = stiff_network(overlap, sliding=0.3)
    law = LinearFrictional(KN, KT, MU)
    faces, _, tangents = by_kernels(graph, law, regime)
    rng = np.random.default_rng(3)
    for row in rng.choice(np.flatnonzero(faces.order[faces.loops] <= 6), 12, replace=False):
        face = faces.loops[row]
        at = slice(faces.offsets[face], faces.offsets[face + 1])
        grains, c = faces.grains[at], faces.contacts[at]
        loop = through(graph.x[grains], graph.normal_force[c], graph.shear_force[c])
        for fast in tangents[:2]:
            exact = exact_tangent(loop, law, regime[c], fast.closure)
            error = np.linalg.norm(fast.matrix[row] - exact) / np.linalg.norm(exact)
            assert error < 1e-12, (fast.closure, faces.order[face], fast.condition[row])


def test_singular_loops_are_solved_through_their_null_vectors():
    """Open contacts carry nothing; a hexagon of frictionless contacts has mechanisms."""
    angle = np.pi / 3 * np.arange(6)
    x = np.column_stack([np.cos(angle), np.sin(angle)])
    ring = np.column_stack([np.arange(6), np.roll(np.arange(6), -1)])
    graph = GrainGraph(x=x, radii=[0.5] * 6, contacts=ring)
    for law, regime in (
        (LinearFrictional(1.0, 0.0, 0.0), Regime.ELASTIC),
        (LinearFrictional(1.0, 0.5, 0.5), Regime.OPEN),
    ):
        _, packing, found = by_kernels(graph, law, np.full(6, regime, dtype=np.int8))
        for one, other in zip(found, packing.tangents(slice(None), TANGENTS, False), strict=True):
            np.testing.assert_allclose(one.matrix, other.matrix, rtol=0, atol=1e-14)
            assert one.trusted.all()


def test_bounds_of_long_loops_count_what_the_elimination_adds():
    """All but a few contacts slide: 60 unknowns and more, whose elimination rounds on its own."""
    rng = np.random.default_rng(0)
    for order in (20, 40, 60):
        graph, regime = slide(rng, random_rings(rng, 40, order, overlap=1e-3), 0.9)
        law = LinearFrictional(KN, KT, MU, "radii")
        with patch("loops.compiled.COMPILED_FROM", 1):
            fast = macroscopic_tangent(graph, law, "traction", spins="free", regime=regime)
        plain = macroscopic_tangent(graph, law, "traction", spins="free", regime=regime)
        error = np.linalg.norm(fast.matrix - plain.matrix, axis=(1, 2))
        assert (error <= fast.rounding + plain.rounding)[fast.trusted & plain.trusted].all()
