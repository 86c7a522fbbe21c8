"""Fabric tensors against closed forms, rotations, and statistics of axes against SciPy's."""

import numpy as np
import pytest
import scipy.stats

from loops import (
    GrainGraph,
    InputError,
    axial_mean,
    branch_vectors,
    direction_tensors,
    edge_tensors,
    find_faces,
    mean_tensor,
    polygon_shape,
    principal,
)
from patterns import synthetic_network

# So many grains fill their lattice: every loop is a triangle.
FULL = 70


def turned(graph, angle):
    """The packing turned about the origin."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    x = graph.x @ turn.T
    cell = None if graph.cell is None else turn @ graph.cell
    return graph.replace(x=x, x0=x, cell=cell, cell0=cell), turn


def fabric_of(graph, by_length=False):
    """Mean of n (x) n over the contacts, weighted by branch length or not."""
    d = branch_vectors(graph)
    return mean_tensor(direction_tensors(d), np.hypot(*d.T) if by_length else None)


def lattice(stretch):
    """Triangular lattice under an affine map."""
    plain = synthetic_network(FULL, periodic=True, coordination=6, jitter=0)
    return synthetic_network(
        FULL, periodic=True, coordination=6, jitter=0, cell=stretch @ plain.cell
    )


def test_lattice_is_isotropic():
    graph = lattice(np.eye(2))
    assert graph.contact_count == 3 * FULL
    for by_length in (False, True):
        fabric = fabric_of(graph, by_length=by_length)
        np.testing.assert_allclose(fabric.mean, np.eye(2) / 2, atol=1e-14)
        # Of cos^2 at 0, 60 and 120 degrees: mean 1/2, variance 1/8; so for cos sin.
        np.testing.assert_allclose(fabric.std, np.full((2, 2), 8**-0.5), rtol=1e-12)
        assert fabric.number == 3 * FULL
        assert principal(fabric.mean)[0] < 1e-14
    shapes = edge_tensors(branch_vectors(graph), find_faces(graph))
    np.testing.assert_allclose(shapes, np.broadcast_to(np.eye(2) / 2, (2 * FULL, 2, 2)), atol=1e-13)


def test_stretched_lattice_in_closed_form():
    stretch = np.array([[1.2, 0.1], [0.0, 0.9]])
    graph = lattice(stretch)
    angle = np.radians([0, 60, 120])
    d = stretch @ np.array([np.cos(angle), np.sin(angle)])
    length = np.hypot(*d)
    n = d / length
    np.testing.assert_allclose(fabric_of(graph).mean, n @ n.T / 3, atol=1e-14)
    weighted = (n * length) @ n.T / length.sum()
    np.testing.assert_allclose(fabric_of(graph, by_length=True).mean, weighted, atol=1e-14)
    # Three edges of a regular triangle: sum e (x) e = 3/2 I, hence F F^T once stretched.
    square = stretch @ stretch.T
    shapes = edge_tensors(branch_vectors(graph), find_faces(graph))
    expected = np.broadcast_to(square / np.trace(square), shapes.shape)
    np.testing.assert_allclose(shapes, expected, atol=1e-13)


@pytest.mark.parametrize("periodic", [True, False])
def test_a_turned_packing_turns_its_tensors(periodic):
    graph = synthetic_network(300, seed=2, periodic=periodic)
    other, turn = turned(graph, 0.7)
    for by_length in (False, True):
        before = fabric_of(graph, by_length=by_length).mean
        after = fabric_of(other, by_length=by_length).mean
        np.testing.assert_allclose(after, turn @ before @ turn.T, atol=1e-14)
    before, after = (edge_tensors(branch_vectors(g), find_faces(g)) for g in (graph, other))
    np.testing.assert_allclose(after, turn @ before @ turn.T, atol=1e-12)
    assert not np.allclose(after, before, atol=1e-3)


def test_edge_tensors_of_regular_polygons_and_their_numbering():
    """A hexagon of unit side cut in two by a long diagonal, and whole."""
    angle = np.radians(60 * np.arange(6))
    x = 2 * np.column_stack([np.cos(angle), np.sin(angle)])
    ring = np.column_stack([np.arange(6), np.roll(np.arange(6), -1)])
    whole = GrainGraph(x=x, radii=np.ones(6), contacts=ring)
    np.testing.assert_allclose(
        edge_tensors(branch_vectors(whole), find_faces(whole)), [np.eye(2) / 2], atol=1e-15
    )
    cut = GrainGraph(x=x, radii=np.ones(6), contacts=[*ring.tolist(), [0, 3]])
    faces = find_faces(cut)
    shapes = edge_tensors(branch_vectors(cut), faces)
    # Each half: edges 2 along x, 2 and 2 along +-60 degrees, 4 along x.
    half = np.array([[4 + 2 * 4 / 4 + 16, 0], [0, 2 * 4 * 3 / 4]])
    np.testing.assert_allclose(shapes, [half / np.trace(half)] * 2, atol=1e-15)
    long = polygon_shape(x[faces.grains[:4]])[1]
    assert float(abs(principal(shapes[0])[1] - long)) < 1e-12


def test_no_loops_and_no_contacts():
    pair = GrainGraph(x=[[0, 0], [1, 0]], radii=[0.5, 0.5], contacts=[[0, 1]])
    assert edge_tensors(branch_vectors(pair), find_faces(pair)).shape == (0, 2, 2)
    alone = GrainGraph(x=[[0, 0]], radii=[0.5], contacts=np.empty((0, 2), dtype=int))
    fabric = fabric_of(alone)
    assert np.isnan(fabric.mean).all()
    assert fabric.number == 0


def test_weighted_tensors_are_repeated_ones():
    rng = np.random.default_rng(3)
    tensors, weights = rng.normal(size=(20, 2, 2)), rng.integers(0, 4, 20)
    found = mean_tensor(tensors, weights)
    repeated = np.repeat(tensors, weights, axis=0)
    np.testing.assert_allclose(found.mean, repeated.mean(axis=0), rtol=1e-13)
    np.testing.assert_allclose(found.std, repeated.std(axis=0), rtol=1e-13)


def test_principal_values_by_the_eigenvalues():
    rng = np.random.default_rng(4)
    s = rng.normal(size=(50, 2, 2))
    s = s + np.swapaxes(s, -1, -2)
    anisotropy, direction = principal(s)
    values, vectors = np.linalg.eigh(s)
    np.testing.assert_allclose(anisotropy, values[:, 1] - values[:, 0], rtol=1e-12)
    along = np.column_stack([np.cos(direction), np.sin(direction)])
    aligned = np.abs(np.einsum("ij,ij->i", along, vectors[:, :, 1]))
    np.testing.assert_allclose(aligned, 1.0, atol=1e-12)
    assert (direction > -np.pi / 2).all()
    with pytest.raises(InputError, match="2, 2"):
        principal(np.eye(3))


def test_amplitude_of_a_density_with_two_lobes():
    """Directions drawn by quantiles of (1 + a cos 2(theta - b))/pi: anisotropy a/2, direction b."""
    a, b, count = 0.3, 0.4, 20_000
    theta = np.linspace(0, np.pi, 400_001)
    mass = (theta + 0.5 * a * (np.sin(2 * (theta - b)) + np.sin(2 * b))) / np.pi
    drawn = np.interp((np.arange(count) + 0.5) / count, mass, theta)
    tensors = direction_tensors(np.column_stack([np.cos(drawn), np.sin(drawn)]))
    anisotropy, direction = principal(mean_tensor(tensors).mean)
    assert float(anisotropy) == pytest.approx(a / 2, abs=1e-7)
    assert float(direction) == pytest.approx(b, abs=1e-7)


def test_axes_against_scipy():
    rng = np.random.default_rng(5)
    angles = rng.normal(1.4, 0.5, 200)
    direction, resultant = axial_mean(angles)
    expected = scipy.stats.circmean(angles, high=np.pi / 2, low=-np.pi / 2)
    assert direction == pytest.approx(expected, abs=1e-12)
    variance = scipy.stats.circvar(angles, high=np.pi / 2, low=-np.pi / 2)
    assert resultant == pytest.approx(1 - variance, abs=1e-12)
    # An axis is the same from either end.
    assert axial_mean(angles + np.pi * rng.integers(-2, 3, 200)) == pytest.approx(
        (direction, resultant), abs=1e-12
    )
    assert axial_mean([0.0, np.pi / 2])[1] == pytest.approx(0.0, abs=1e-15)
    assert np.isnan(axial_mean([])).all()
    assert axial_mean([0.1, 1.0], [1.0, 0.0]) == pytest.approx((0.1, 1.0))
