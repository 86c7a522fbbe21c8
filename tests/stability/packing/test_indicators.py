"""Indicators of loops against dense linear algebra, lattices and least squares."""

import numpy as np
import pytest

from grainloops import indicators
from loops import (
    GrainGraph,
    LinearFrictional,
    Regime,
    Scene,
    branch_vectors,
    contact_state,
    contact_tangent,
    find_faces,
    loop_batches,
)
from loops.in_place import inverse_at_contacts
from loops.system import stiffness_matrix
from stability.packing.loop_quantities import (
    EXPECTED,
    least_squares_nonaffinity,
    local_density,
    soft_participation,
    steric_order,
)
from tests.oracles.lattices import lattice
from tests.packings import LAW, packing, packing_system


def dense(system):
    """Inverse of the whole matrix on motions without translations, and the translations.

    Spins that no contact resists are left out: their rows and columns of the inverse are zero.
    """
    matrix = stiffness_matrix(system).toarray()
    kept = np.flatnonzero(np.abs(matrix).sum(axis=0) > 0)
    T = np.zeros((system.size, 2))
    for axis in (0, 1):
        T[system.freedom[system.carrying.grains, axis], axis] = 1.0
    T /= np.sqrt(np.count_nonzero(system.carrying.grains))
    inverse = np.zeros(matrix.shape)
    inverse[np.ix_(kept, kept)] = np.linalg.pinv(matrix[np.ix_(kept, kept)])
    return inverse, matrix, T


@pytest.mark.parametrize(("seed", "sliding"), [(0, 0.0), (1, 0.2), (2, 0.3)])
def test_entries_of_the_inverse(seed, sliding):
    """Equal to the dense pseudo-inverse, with sliding contacts too: K is then nonsymmetric."""
    held_to_dense(packing_system(Scene(packing(30, seed=seed, sliding=sliding), LAW)))


def test_entries_of_the_inverse_of_two_components():
    """Two packings of unequal numbers of grains in one cell, no contact between them."""
    one, two = packing(16, seed=1), packing(11, seed=2)
    both = {
        name: np.concatenate([getattr(one, name), getattr(two, name)])
        for name in ("x", "radii", "images", "normal_force", "shear_force")
    }
    contacts = np.concatenate([one.contacts, one.grain_count + two.contacts])
    system = packing_system(Scene(GrainGraph(contacts=contacts, cell=one.cell, **both), LAW))
    assert len(system.carrying.anchors) == 2
    held_to_dense(system)


def held_to_dense(system):
    inverse = dense(system)[0]
    found = inverse_at_contacts(system)
    pairs = system.graph.contacts[system.contacts]
    ends = np.column_stack(
        [system.freedom[pairs[:, 0], :2], system.freedom[pairs[:, 1], :2], system.freedom[pairs, 2]]
    )
    true = inverse[ends[:, :, None], ends[:, None, :]]
    assert np.allclose(found, true, rtol=0.0, atol=1e-9 * np.abs(true).max())


def test_vibralities_and_criticalities_of_loops():
    graph = packing(30, seed=1, sliding=0.2)
    faces, system = find_faces(graph), packing_system(Scene(graph, LAW))
    found = indicators(Scene(graph, LAW), faces)
    inverse, matrix, T = dense(system)
    blocks = system.stiffness[:, :2, :2]
    typical = np.mean(np.sqrt(np.sum(blocks**2, axis=(1, 2)) / 2.0))
    diagonal = np.append(np.diag(inverse), 0.0) * typical
    motion = diagonal[system.freedom[:, 0]] + diagonal[system.freedom[:, 1]]
    spin = diagonal[system.freedom[:, 2]]
    slip, opening = np.full((2, graph.contact_count), np.inf)
    regular = np.linalg.slogdet(matrix + T @ T.T)
    for c in range(graph.contact_count):
        for out, regime in ((slip, Regime.SLIDING), (opening, Regime.OPEN)):
            changed = system.regime.copy()
            if regime == Regime.SLIDING and changed[c] == Regime.SLIDING:
                continue
            changed[c] = regime
            blocks = system.stiffness.copy()
            scale = np.array([1.0, 1.0, 1.0 / system.length, 1.0 / system.length])
            own = contact_tangent(contact_state(graph), LAW, changed)[system.contacts]
            # Nothing is left of a contact that is lost, the geometric part neither.
            blocks[c] = 0.0 if regime == Regime.OPEN else scale[:, None] * own[c] * scale
            now = np.linalg.slogdet(stiffness_matrix(system, blocks).toarray() + T @ T.T)
            out[c] = now[0] * regular[0] * np.exp(now[1] - regular[1])
    row = np.full(len(faces.kind), -1)
    row[faces.loops] = np.arange(len(faces.loops))
    for batch in loop_batches(graph, faces):
        at = row[batch.face]
        for name, true in (
            ("vibrality", motion[batch.grains].mean(axis=1)),
            ("spin_vibrality", spin[batch.grains].mean(axis=1)),
            ("slip_criticality", slip[batch.contacts].min(axis=1)),
            ("opening_criticality", opening[batch.contacts].min(axis=1)),
        ):
            known = np.isfinite(true)
            assert known.all() or name == "slip_criticality"
            assert np.allclose(found[name][at][known], true[known], rtol=1e-8, atol=1e-10), name
            assert np.isnan(found[name][at][~known]).all()


def test_a_scale_changes_nothing():
    """Units of length and force: indicators are numbers without a dimension."""
    graph = packing(30, seed=3, sliding=0.2)
    large = graph.replace(
        x=1e3 * graph.x, radii=1e3 * graph.radii, cell=1e3 * graph.cell,
        normal_force=1e8 * graph.normal_force, shear_force=1e8 * graph.shear_force,
    )  # fmt: skip
    law = LinearFrictional(1e5, 0.5e5, 0.5, "radii")
    past = np.random.default_rng(0).random(graph.grain_count)
    one, two = (
        indicators(Scene(state, own), find_faces(state), nonaffinity=past)
        for state, own in ((graph, LAW), (large, law))
    )
    assert tuple(one) == tuple(EXPECTED)
    assert set(indicators(Scene(graph, LAW), find_faces(graph))) == set(EXPECTED) - {
        "past_nonaffinity"
    }
    for name, values in one.items():
        assert np.allclose(values, two[name], rtol=1e-6, atol=1e-9, equal_nan=True), name


@pytest.mark.parametrize("turned", [True, False])
def test_the_frame_the_images_and_the_cell_change_nothing(turned):
    graph, angle = packing(30, seed=3, sliding=0.2), 0.7 * turned
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    (i, j), away = graph.contacts.T, np.random.default_rng(1).integers(-2, 3, (30, 2))
    # Grains of other images, and a tilted cell of the same lattice.
    tilt = np.array([[1, 2], [0, 1]])
    images = (graph.images - away[j] + away[i]) @ np.linalg.inv(tilt).T
    other = GrainGraph(
        x=(graph.x + away @ graph.cell.T) @ rotation.T, radii=graph.radii, contacts=graph.contacts,
        images=np.rint(images).astype(int), cell=rotation @ graph.cell @ tilt,
        normal_force=graph.normal_force, shear_force=graph.shear_force,
    )  # fmt: skip
    one, two = (indicators(Scene(state, LAW)) for state in (graph, other))
    for name, values in one.items():
        assert np.allclose(np.sort(two[name]), np.sort(values), rtol=1e-6, atol=1e-9), name


def test_soft_modes_are_those_of_the_dense_matrix():
    system = packing_system(Scene(packing(30, seed=2, sliding=0.2), LAW))
    found = soft_participation(system, 5)
    matrix = stiffness_matrix(system).toarray()
    values, modes = np.linalg.eigh(0.5 * (matrix + matrix.T))
    x = system.freedom[:, :2]
    motion = modes[x] - modes[x].mean(axis=0)
    share = np.sum(motion**2, axis=1)
    kept = [k for k in range(len(values)) if share[:, k].sum() > 1e-6][:5]
    assert np.allclose(found, 30 * share[:, kept].mean(axis=1), rtol=1e-6, atol=1e-9)
    # The participation of all grains in a mode of centres alone is one.
    assert 0.0 < found.mean() <= 1.0


def test_one_grain_among_its_images_has_no_soft_modes():
    graph = GrainGraph([[0.0, 0.0]], [0.5], [[0, 0], [0, 0]], images=[[1, 0], [0, 1]],
                       cell=0.99 * np.eye(2), normal_force=[0.01, 0.01])  # fmt: skip
    found = indicators(Scene(graph, LinearFrictional(1.0, 0.5, 0.5)))
    assert np.isnan(found["soft_modes"]).all() and np.isfinite(found["coordination"]).all()


@pytest.mark.parametrize("stretch", [1.0, 1.1])
def test_steric_order_of_a_triangular_lattice(stretch):
    """None where all neighbours touch; else the angles of the stretched triangles."""
    sides = np.array([[1.0, 0.5], [0.0, np.sqrt(0.75)]]) * [[stretch], [1.0]]
    forces = np.full(3, 0.01)
    graph = lattice(sides, [(1, 0), (0, 1), (1, -1)], forces, 0 * forces, (4, 4))
    base = np.arctan2(np.sqrt(0.75), 0.5 * stretch)
    angles = np.array([base, base, np.pi - 2 * base])
    true = np.abs(angles - np.pi / 3).mean()
    assert np.allclose(steric_order(graph.replace(radii=[0.5] * 16)), true, atol=1e-12)


def test_densities_share_the_area_of_the_sample():
    graph = packing(30, seed=5)
    found = local_density(graph, find_faces(graph))
    shares = np.pi * graph.radii**2 / found
    assert shares.sum() == pytest.approx(abs(np.linalg.det(graph.cell)), rel=1e-12)


def test_nonaffinity_is_what_the_best_map_leaves():
    graph = packing(30, seed=6)
    d = branch_vectors(graph)
    F = np.array([[1.02, 0.1], [-0.05, 0.97]])
    affine = least_squares_nonaffinity(graph, d @ F.T)
    assert np.nanmax(affine) < 1e-14
    noise = np.random.default_rng(0).standard_normal(d.shape)
    # Of a step of 1e-8 beyond a map that hardly moves, squares of 1e-16 are left: six digits.
    small = least_squares_nonaffinity(graph, d + 1e-8 * noise)
    whole = least_squares_nonaffinity(graph, d + noise)
    assert np.allclose(small * 1e16, whole, rtol=1e-6, equal_nan=True)
    moved = d @ F.T + 0.01 * noise
    found = least_squares_nonaffinity(graph, moved)
    radius = graph.radii.mean()
    for grain in range(graph.grain_count):
        own = np.flatnonzero((graph.contacts == grain).any(axis=1))
        if len(own) < 3:
            assert np.isnan(found[grain])
            continue
        best, *_ = np.linalg.lstsq(d[own], moved[own], rcond=None)
        left = np.sum((moved[own] - d[own] @ best) ** 2) / len(own) / radius**2
        assert found[grain] == pytest.approx(left, rel=1e-9)


def test_past_of_a_loop_is_the_mean_of_its_grains():
    """Over the grains whose past is known; nothing where none is."""
    graph = packing(30, seed=6)
    faces = find_faces(graph)
    past = np.where(np.arange(30) % 3 == 0, np.nan, np.arange(30.0) ** 2)
    found = indicators(Scene(graph, LAW), faces, nonaffinity=past)["past_nonaffinity"]
    for batch in loop_batches(graph, faces):
        at = np.searchsorted(faces.loops, batch.face)
        for k, grains in zip(at, batch.grains, strict=True):
            known = [past[grain] for grain in grains if grain % 3]
            assert found[k] == pytest.approx(np.mean(known), rel=1e-14)
    nothing = indicators(Scene(graph, LAW), faces, nonaffinity=np.full(30, np.nan))
    assert np.isnan(nothing["past_nonaffinity"]).all()


def test_mobilisation_is_one_at_yield():
    graph = packing(30, seed=7, sliding=0.3)
    faces = find_faces(graph)
    found = indicators(Scene(graph, LAW), faces)
    ratio = np.abs(graph.shear_force) / (float(LAW.mu) * graph.normal_force)
    for k, face in enumerate(faces.loops):
        own = faces.contacts[faces.offsets[face] : faces.offsets[face + 1]]
        assert found["largest_mobilisation"][k] == pytest.approx(ratio[own].max(), rel=1e-12)
        assert found["mobilisation"][k] == pytest.approx(ratio[own].mean(), rel=1e-12)
    assert found["largest_mobilisation"].max() == pytest.approx(1.0, rel=1e-12)
