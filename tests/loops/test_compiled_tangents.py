"""Compiled tangents: within 1e-12 of numpy's, and of 50 digits."""

import numpy as np
import pytest

from loops import (
    GrainGraph,
    HertzMindlin,
    LinearFrictional,
    Regime,
    find_faces,
    loop_batches,
    macroscopic_tangent,
    traction_tangent,
)
from loops.closures.traction import FORCE_METHOD_LIMIT
from loops.compiled.loop_tangents import loop_tangents
from loops.compiled.packing import compiled_packing
from patterns.synthetic import synthetic_network
from studies.fifty_digits import affine_tangent_50, as_array, traction_tangent_50

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
    return faces, loop_tangents(packing, graph, faces, law, faces.loops)


def assert_same_tangents(graph, law, regime):
    faces, tangents = compiled(graph, law, regime)
    row = np.full(len(faces.kind), -1)
    row[faces.loops] = np.arange(len(faces.loops))
    for batch in loop_batches(graph, faces):
        own, regimes = law.take(batch.contacts), regime[batch.contacts]
        for closure, fast in zip(("affine", "traction"), tangents, strict=True):
            plain = macroscopic_tangent(batch.graph, own, closure, regime=regimes)
            at = row[batch.face]
            np.testing.assert_array_equal(fast.trusted[at], plain.trusted)
            size = np.linalg.norm(plain.matrix, axis=(1, 2))
            error = np.linalg.norm(fast.matrix[at] - plain.matrix, axis=(1, 2))
            # Both err by their condition times rounding at most, and far less as a rule.
            assert np.nanmax(error / size / np.maximum(plain.condition, 1e3)) < 1e-15
            good = plain.trusted
            # What the saddle system leaves over is rounding, and counts.
            np.testing.assert_allclose(fast.condition[at][good], plain.condition[good], rtol=0.3)
            if closure == "traction":
                force = traction_tangent(batch.graph, own, regime=regimes, method="force")
                good &= force.condition <= FORCE_METHOD_LIMIT
            np.testing.assert_allclose(fast.condition[at][good], plain.condition[good], rtol=1e-6)
            np.testing.assert_allclose(fast.volume[at], plain.volume, rtol=1e-12)


@pytest.mark.parametrize("overlap", [1e-1, 1e-3, 1e-8])
@pytest.mark.parametrize("periodic", [False, True])
def test_against_the_plain_closures(overlap, periodic):
    graph, regime = stiff_network(overlap, periodic=periodic)
    assert_same_tangents(graph, LinearFrictional(KN, KT, MU), regime)


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
    faces, tangents = compiled(graph, LinearFrictional(KN, KT, MU), regime)
    rng = np.random.default_rng(3)
    for row in rng.choice(np.flatnonzero(faces.order[faces.loops] <= 6), 12, replace=False):
        face = faces.loops[row]
        at = slice(faces.offsets[face], faces.offsets[face + 1])
        x, c = graph.x[faces.grains[at]], faces.contacts[at]
        state = (x, x, graph.normal_force[c], graph.shear_force[c], KN, KT, MU, regime[c])
        for exact_tangent, fast in zip(
            (affine_tangent_50, traction_tangent_50), tangents, strict=True
        ):
            exact = as_array(exact_tangent(*state))
            error = np.linalg.norm(fast.matrix[row] - exact) / np.linalg.norm(exact)
            assert error < 1e-12, (fast.closure, faces.order[face], fast.condition[row])


def test_singular_loops_are_left_to_the_plain_way():
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
        faces, (_, fast) = compiled(graph, law, regimes)
        (batch,) = loop_batches(graph, faces)
        plain = macroscopic_tangent(
            batch.graph, law.take(batch.contacts), "traction", regime=regimes[batch.contacts]
        )
        np.testing.assert_array_equal(fast.trusted, plain.trusted)
        np.testing.assert_allclose(fast.matrix, plain.matrix, atol=1e-14)
        np.testing.assert_allclose(fast.residual, plain.residual, atol=1e-14)
