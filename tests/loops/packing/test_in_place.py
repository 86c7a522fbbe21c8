"""Operators in place against dense inverses, and what blocks and buffers leave out."""

import numpy as np
import pytest
from scipy import sparse

from loops import (
    InputError,
    LinearFrictional,
    assemble_tangent,
    contact_state,
    find_faces,
    loop_batches,
    traction_tangent,
)
from loops.geometry import boundary_vectors, polygon_area
from loops.packing import loops_in_place
from loops.packing.dissection import dissection
from loops.packing.selected_inverse import eliminate, inverse_on_fronts
from patterns.synthetic import synthetic_network
from tests.packings import LAW, packing, with_idle_triangle


def dense_operators(graph, law, regime):
    """`A_in` from a pseudo-inverse of the dense tangent: the loads are in balance."""
    K = np.linalg.pinv(assemble_tangent(graph, law, spins=True, regime=regime), rcond=1e-10)
    faces = find_faces(graph)
    out = {}
    for batch in loop_batches(graph, faces):
        vectors, area = boundary_vectors(batch.graph.x), polygon_area(batch.graph.x)
        for face, grains, v, size in zip(batch.face, batch.grains, vectors, area, strict=True):
            B = np.zeros((len(K), 4))
            for grain, vector in zip(grains, v, strict=True):
                B[2 * grain, :2] += vector
                B[2 * grain + 1, 2:] += vector
            out[face] = np.linalg.inv(B.T @ K @ B / size)
    return np.array([out[face] for face in faces.loops])


@pytest.mark.parametrize("sliding", [0.0, 0.15])
def test_in_place_is_the_dense_inverse(sliding):
    graph = packing(30, seed=2, sliding=sliding)
    regime = LAW.regime(contact_state(graph))
    found = loops_in_place(graph, LAW, find_faces(graph))
    dense = dense_operators(graph, LAW, regime)
    # The regularisation of 1e-12 weighs in the softest modes.
    assert np.allclose(found.matrix, dense, rtol=1e-8, atol=1e-9)
    assert (found.error == 0).all()


def test_surroundings_are_what_the_loop_alone_lacks():
    law = LinearFrictional(1.0, 0.5)
    graph = packing(30, seed=2, share=0.0)
    faces = find_faces(graph)
    found = loops_in_place(graph, law, faces)
    row = {face: k for k, face in enumerate(faces.loops)}
    for batch in loop_batches(graph, faces):
        alone = traction_tangent(batch.graph, law, spins="free").matrix
        rows = [row[face] for face in batch.face]
        assert np.array_equal(found.alone[rows], alone, equal_nan=True)
    assert np.allclose(found.surroundings, found.matrix - found.alone, equal_nan=True)
    # Springs without shear forces: whatever stands around a loop can only stiffen it.
    values = np.linalg.eigvalsh(found.surroundings + np.swapaxes(found.surroundings, 1, 2))
    assert np.nanmin(values) > -1e-6


def test_blocks_tend_to_the_whole_and_keep_their_bound():
    graph = synthetic_network(1600, seed=3, periodic=True, coordination=4.6)
    graph = graph.replace(shear_force=0.5 * graph.shear_force)
    faces, law = find_faces(graph), LinearFrictional(1.0, 0.5)
    whole = loops_in_place(graph, law, faces, method="whole").matrix
    median = []
    for buffer in (3.0, 6.0):
        part = loops_in_place(graph, law, faces, method="blocks", block=10.0, buffer=buffer)
        size = np.linalg.norm(whole, axis=(1, 2))
        error = np.linalg.norm(part.matrix - whole, axis=(1, 2)) / size
        assert np.mean(error <= part.error) > 0.99
        assert (part.error > 0).all() and np.isfinite(part.matrix).all()
        median.append(np.median(error))
    assert 2.0 < median[0] / median[1] < 8.0


def test_a_loop_that_carries_nothing_has_no_operator():
    more = with_idle_triangle(packing(24, seed=3))
    found = loops_in_place(more, LAW, find_faces(more))
    assert np.isnan(found.matrix).all(axis=(1, 2)).sum() == 1
    with pytest.raises(InputError, match="method"):
        loops_in_place(more, LAW, find_faces(more), method="patch")


def test_selected_inverse_of_any_matrix_on_any_tree():
    rng = np.random.default_rng(0)
    x = rng.random((150, 2))
    near = np.argsort(np.linalg.norm(x[:, None] - x, axis=2), axis=1)[:, 1:5]
    edges = np.unique(
        np.sort(np.column_stack([np.repeat(np.arange(150), 4), near.ravel()]), axis=1), axis=0
    )
    freedom = np.arange(450).reshape(150, 3)
    freedom[rng.random((150, 3)) < 0.1] = -1
    freedom[freedom >= 0] = np.arange(np.count_nonzero(freedom >= 0))
    size = freedom.max() + 1
    dense = np.zeros((size, size))
    for i, j in np.vstack([edges, np.column_stack([np.arange(150)] * 2)]):
        a, b = freedom[i][freedom[i] >= 0], freedom[j][freedom[j] >= 0]
        dense[np.ix_(a, b)] += rng.normal(size=(len(a), len(b)))
        dense[np.ix_(b, a)] += rng.normal(size=(len(b), len(a)))
    dense += 8.0 * np.eye(size)
    fronts = dissection(x, edges)
    assert np.array_equal(np.sort(np.concatenate([front.own for front in fronts])), np.arange(150))
    done = eliminate(sparse.csr_array(dense), fronts, freedom)
    inverse, met = np.linalg.inv(dense), 0
    for _, at, z in inverse_on_fronts(fronts, done):
        assert np.allclose(z, inverse[np.ix_(at, at)], atol=1e-12)
        met += 1
    assert met == len(fronts) > 5
