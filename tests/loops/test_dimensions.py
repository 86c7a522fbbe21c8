"""Spheres through the functions of discs: what a cluster of three dimensions is held to."""

import numpy as np
import pytest

from loops import (
    GrainGraph,
    InputError,
    LinearFrictional,
    affine_tangent,
    assemble_tangent,
    contact_frame,
    find_faces,
    love_weber_stress,
    nominal_stress,
    traction_tangent,
)
from loops.fabric import direction_tensors

TETRAHEDRON = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
OCTAHEDRON = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
# Volume over the cubed edge, and c of the closed forms times V0/l0^2.
CLUSTERS = {
    "tetrahedron": (TETRAHEDRON, 1 / (6 * np.sqrt(2)), 1.0),
    "octahedron": (OCTAHEDRON, np.sqrt(2) / 3, 2.0),
}
KN = 3.0


def rotation(seed):
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def cluster(corners, strain, edge=1.3):
    """Spheres that touch along the edges of a solid, pressed by an isotropic strain."""
    distance = np.linalg.norm(corners[:, None] - corners, axis=-1)
    shortest = distance[distance > 0].min()
    pairs = [(i, j) for i, j in np.argwhere(np.isclose(distance, shortest)) if i < j]
    x0 = corners @ rotation(1).T * edge / shortest + [0.4, -2.0, 7.0]
    return GrainGraph(
        x=x0 * (1.0 - strain),
        radii=np.full(len(corners), edge / 2),
        contacts=pairs,
        normal_force=np.full(len(pairs), KN * strain * edge),
        x0=x0,
    )


def symmetric_eigenvalues(matrix):
    """Eigenvalues of Ks over the six symmetric gradients."""
    axes = [(i, j) for i in range(3) for j in range(i, 3)]
    basis = np.zeros((6, 3, 3))
    for row, (i, j) in enumerate(axes):
        basis[row, i, j] += 0.5
        basis[row, j, i] += 0.5
        basis[row] /= np.linalg.norm(basis[row])
    flat = basis.reshape(6, 9)
    return np.linalg.eigvalsh(flat @ (0.5 * (matrix + matrix.T)) @ flat.T)


@pytest.mark.parametrize("name", CLUSTERS)
@pytest.mark.parametrize(("strain", "kappa"), [(0.0, 0.5), (0.05, 0.5), (0.3, 0.2), (0.12, 0.9)])
def test_affine_tangent_of_spheres(name, strain, kappa):
    """Theory, section on three dimensions: c {2, (1 + 3 k')/2 twice, 1 + k' three times}."""
    corners, volume, factor = CLUSTERS[name]
    edge = 1.3
    graph = cluster(corners, strain, edge)
    v0 = volume * edge**3
    tangent = affine_tangent(graph, LinearFrictional(kn=KN, kt=kappa * KN), volume=v0)
    assert tangent.matrix.shape == (9, 9)
    assert tangent.trusted
    reduced = kappa - strain / (1.0 - strain)
    wanted = [2.0, *[(1 + 3 * reduced) / 2] * 2, *[1 + reduced] * 3]
    found = symmetric_eigenvalues(tangent.matrix) / (KN * factor * edge**2 / v0)
    # Sums of six or twelve contacts, each rounded a few times.
    np.testing.assert_allclose(found, np.sort(wanted), rtol=0, atol=1e-12)


def test_the_tangent_is_the_slope_of_the_nominal_stress():
    """The stress of the same grains moved affinely, without shear springs: order of the step."""
    corners, volume, _ = CLUSTERS["octahedron"]
    graph, law = cluster(corners, 0.07), LinearFrictional(kn=KN, kt=0.0)
    v0 = volume * 1.3**3
    matrix = affine_tangent(graph, law, volume=v0).matrix
    H = np.random.default_rng(3).normal(size=(3, 3))

    def stress(step):
        moved = graph.replace(x=graph.x - step * graph.x0 @ H.T)
        length, _, _ = contact_frame(moved)
        return nominal_stress(moved.replace(normal_force=KN * (1.3 - length)), v0)

    errors = []
    for step in (1e-2, 1e-3, 1e-4):
        slope = (stress(step) - stress(-step)) / (2 * step)
        errors.append(np.abs(slope - (matrix @ H.ravel()).reshape(3, 3)).max())
    assert errors[0] > 90 * errors[1] > 8100 * errors[2]
    assert errors[2] < 3e-6


def test_stress_and_fabric_of_spheres():
    corners, volume, _ = CLUSTERS["tetrahedron"]
    graph = cluster(corners, 0.1)
    v = volume * (1.3 * 0.9) ** 3
    # Six edges of length l0 (1 - E), force kn E l0 along each, isotropic.
    pressure = 6 * KN * 0.1 * 1.3 * 1.3 * 0.9 / (3 * v)
    np.testing.assert_allclose(love_weber_stress(graph, v), pressure * np.eye(3), atol=1e-13)
    _, n, t = contact_frame(graph)
    np.testing.assert_allclose((n * t).sum(axis=-1), 0.0, atol=1e-15)
    np.testing.assert_allclose(direction_tensors(n).mean(axis=0), np.eye(3) / 3, atol=1e-15)


def test_what_asks_for_the_plane_says_so():
    graph = cluster(TETRAHEDRON, 0.1)
    law = LinearFrictional(kn=KN, kt=1.0)
    asked = [
        lambda: affine_tangent(graph, law),
        lambda: affine_tangent(graph, law, spins="free", volume=1.0),
        lambda: traction_tangent(graph, law),
        lambda: assemble_tangent(graph, law),
        lambda: find_faces(graph),
    ]
    for ask in asked:
        with pytest.raises(InputError, match="plane"):
            ask()
    with pytest.raises(InputError, match="three dimensions"):
        graph.replace(shear_force=np.ones(6))
    with pytest.raises(InputError, match=r"shape \(\.\.\., 4, 3\)"):
        graph.replace(x0=graph.x0[:, :2])
