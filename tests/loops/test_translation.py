"""Where a loop lies changes nothing: exact translations by powers of two, the same bits after."""

import numpy as np
import pytest

from loops import (
    GrainGraph,
    LinearFrictional,
    Scene,
    best_fit_strain,
    branch_vectors,
    find_faces,
    loop_batches,
    loop_strain,
    love_weber_stress,
    macroscopic_tangent,
    polygon_shape,
)
from loops.loop_batches import TANGENTS, loops_of_packing
from patterns import regular_polygon, synthetic_network
from stability import Stage, follow, programmes
from tests.oracles.rings import random_rings, slide

SHIFTS = [2.0**10, 2.0**20, 2.0**30]
LAW = LinearFrictional(kn=1.3, kt=0.5, mu=0.5)
# Positions are multiples of this: the shifts are exact, and so are all differences.
GRID = 2.0**-20


def on_grid(x):
    return np.round(np.asarray(x) / GRID) * GRID


def shifted(graph, shift):
    by = np.array([shift, -0.5 * shift])
    return graph.replace(x=graph.x + by, x0=graph.x0 + by)


def loops_on_grid(order):
    rng = np.random.default_rng(order)
    graph, regime = slide(rng, random_rings(rng, 10, order), 0.3)
    moved = on_grid(graph.x * (1 + 0.02 * rng.standard_normal(graph.x.shape)))
    return graph.replace(x=moved, x0=on_grid(graph.x), regime=regime)


@pytest.mark.parametrize("shift", SHIFTS)
@pytest.mark.parametrize("order", [3, 4, 7])
def test_operators(order, shift):
    here = loops_on_grid(order)
    there = shifted(here, shift)
    for closure in ("affine", "traction"):
        for spins in ("blocked", "affine", "free"):
            a, b = (macroscopic_tangent(g, LAW, closure, spins=spins) for g in (here, there))
            np.testing.assert_array_equal(a.matrix, b.matrix)
            np.testing.assert_array_equal(a.error, b.error)
    np.testing.assert_array_equal(love_weber_stress(here), love_weber_stress(there))
    np.testing.assert_array_equal(polygon_shape(here.x), polygon_shape(there.x))
    np.testing.assert_array_equal(loop_strain(here.x0, here.x), loop_strain(there.x0, there.x))
    # Means of far positions round, but cancel from the fit to first order.
    a, b = (best_fit_strain(g.x0[0], g.x[0]) for g in (here, there))
    np.testing.assert_allclose(a, b, rtol=0, atol=1e-14)


@pytest.mark.parametrize("shift", SHIFTS)
@pytest.mark.parametrize("periodic", [False, True])
def test_loops_of_packings_and_their_kernels(periodic, shift):
    network = synthetic_network(150, seed=4, periodic=periodic)
    cell = None if network.cell is None else on_grid(network.cell)
    here = network.replace(x=on_grid(network.x), x0=on_grid(network.x), cell=cell, cell0=cell)
    there = shifted(here, shift)
    np.testing.assert_array_equal(branch_vectors(here), branch_vectors(there))
    faces = find_faces(here)
    for one, two in zip(loop_batches(here, faces), loop_batches(there, faces), strict=True):
        law = LAW.take(one.contacts)
        a, b = (macroscopic_tangent(g, law, "traction") for g in (one.graph, two.graph))
        np.testing.assert_array_equal(a.matrix, b.matrix)
    fast = [
        loops_of_packing(g, faces, LAW).tangents(slice(None), TANGENTS, True) for g in (here, there)
    ]
    for a, b in zip(*fast, strict=True):
        np.testing.assert_array_equal(a.matrix, b.matrix)


def test_branches_across_a_border_are_rounded_once():
    """A small branch between grains on either side of a cell that is large against it."""
    x = np.array([[0.1, 0.3], [4096.7, 0.3 + 1e-3]])
    cell = np.array([[4096.0, 0.0], [0.0, 4096.0]])
    graph = GrainGraph(x=x, radii=[0.5] * 2, contacts=[[0, 1]], images=[[-1, 0]], cell=cell)
    from fractions import Fraction

    exact = Fraction(x[1, 0]) - Fraction(x[0, 0]) - 4096
    assert branch_vectors(graph)[0, 0] == float(exact)


@pytest.mark.parametrize("closure", ["affine", "traction"])
def test_paths(closure):
    graph = regular_polygon(5, strain=0.02)
    # In multiples of the grid the loop is no longer regular: forces as the overlaps give them.
    x = on_grid(graph.x)
    here = GrainGraph(x=x, radii=graph.radii, contacts=graph.contacts)
    length = np.linalg.norm(branch_vectors(here), axis=1)
    force = LAW.kn * (here.radii[graph.contacts].sum(axis=1) - length)
    here = here.replace(normal_force=force)
    stage = Stage(programmes.drained_biaxial(), "H11", 0.05)
    path = follow(Scene(here, LAW), stage, closure=closure)
    for shift in SHIFTS:
        there = follow(Scene(shifted(here, shift), LAW), stage, closure=closure)
        np.testing.assert_array_equal(path.P, there.P)
