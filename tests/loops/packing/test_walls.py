"""Packings between walls, and packings whose outline is held."""

import numpy as np
import pytest

from loops import (
    Boundary,
    GrainGraph,
    InputError,
    LinearFrictional,
    PlaneContacts,
    Scene,
    find_faces,
)
from patterns import synthetic_network
from stability import rates_at
from tests.packings import outline_grains, plane_contacts
from tests.stability.packing.walled_packings import between

LAW = LinearFrictional(1.0, 0.5)


def lattice(n=3):
    """A square lattice of n x n touching discs between four planes."""
    number = np.arange(n * n).reshape(n, n)
    contacts = [(a, b) for a, b in zip(number[:-1].ravel(), number[1:].ravel(), strict=True)]
    contacts += [(a, b) for a, b in zip(number[:, :-1].ravel(), number[:, 1:].ravel(), strict=True)]
    x = np.array([[i, j] for i in range(n) for j in range(n)], dtype=float)
    graph = GrainGraph(x, np.full(n * n, 0.5), contacts)
    feet = [(number[0], [-0.5, 0]), (number[-1], [0.5, 0])]
    feet += [(number[:, 0], [0, -0.5]), (number[:, -1], [0, 0.5])]
    grain = np.concatenate([grains for grains, _ in feet])
    branch = np.concatenate([np.tile(foot, (len(grains), 1)) for grains, foot in feet])
    return graph, grain, branch


def test_a_lattice_between_walls_is_springs_in_series():
    graph, grain, branch = lattice()
    planes = PlaneContacts(grain, branch, np.full(len(grain), 3.0), np.zeros(len(grain)))
    found = rates_at(Scene(graph, LAW, between(planes, volume=9.0)), H=[[1.0, 0], [0, 0]])
    # Three rows of two walls' and two contacts' springs over a length of three.
    force = 3.0 / (2 / 3.0 + 2 / 1.0)
    assert np.allclose(found.stress_rate, [[3 * force * 3.0 / 9.0, 0], [0, 0]], atol=1e-12)
    assert found.status == "unique" and found.residual < 1e-12
    assert found.system.boundary == "12 wall contacts"


def test_rough_walls_resist_shear_and_smooth_ones_do_not():
    graph, grain, branch = lattice()
    shear = [[0.0, 0.5], [0.5, 0.0]]
    stiff = np.full(len(grain), 3.0)
    smooth, rough = (
        rates_at(
            Scene(graph, LAW, between(PlaneContacts(grain, branch, stiff, kt), volume=9.0)), H=shear
        )
        for kt in (0.0 * stiff, 0.5 * stiff)
    )
    assert np.sum(rough.stress_rate * shear) > 0.1
    assert np.sum(rough.stress_rate * shear) > np.sum(smooth.stress_rate * shear) + 1e-3


def test_wall_stiffness_is_read_from_force_and_overlap():
    graph = GrainGraph([[0, 0], [1, 0]], [0.5, 0.5], [[0, 1]])
    found = plane_contacts(graph, [0, 1], [[0.3, 0.0], [0.0, 0.0]], [[0.4, 0.0], [-0.6, 0.0]])
    assert found.grain.tolist() == [0] and found.branch.tolist() == [[-0.4, 0.0]]
    assert found.kn[0] == pytest.approx(3.0)
    with pytest.raises(InputError, match="wall contact 0"):
        plane_contacts(graph, [0], [[-0.3, 0.0]], [[0.4, 0.0]])
    with pytest.raises(InputError, match="wall contact 0"):
        plane_contacts(graph, [0], [[0.3, 0.0]], [[0.6, 0.0]])


def test_a_held_outline_strains_a_sample_without_walls():
    graph = synthetic_network(200, seed=1, coordination=4.6)
    faces = find_faces(graph)
    held = outline_grains(graph, faces)
    H = np.array([[0.4, 0.1], [0.2, -0.3]])
    boundary = Boundary(held=held, volume=float(faces.area[faces.loops].sum()))
    found = rates_at(Scene(graph, LAW, boundary), H=H)
    assert 20 < held.sum() < 100 and np.abs(found.motion[held]).max() == 0
    assert found.residual < 1e-9 and "held to the affine motion" in found.system.boundary
    assert np.abs(found.motion[~held]).max() > 0.01
