"""Quadrons: their areas add up to those of the loops, or of the sample."""

import numpy as np
import pytest

from loops import FaceKind, GrainGraph, InputError, find_faces, quadrons
from patterns import regular_polygon, synthetic_network
from tests.oracles.lattices import lattice
from tests.packings import jammed, packing


@pytest.mark.parametrize("graph", [jammed(36, 5), packing(24, 3), regular_polygon(7, strain=0.1)])
def test_quadrons_of_a_loop_fill_it(graph):
    faces = find_faces(graph)
    found = quadrons(graph, faces)
    total = np.bincount(found.face, found.area, minlength=len(faces.area))[faces.loops]
    np.testing.assert_allclose(total, faces.area[faces.loops], rtol=1e-12, atol=0)
    assert (np.bincount(found.face)[faces.loops] == faces.order[faces.loops]).all()


def test_published_quadrons_fill_a_periodic_sample():
    """About the means of contacts each loop differs, all together don't."""
    graph = synthetic_network(40, seed=2, cell=[[6.0, 0.5], [0.0, 5.0]], coordination=4.8)
    faces = find_faces(graph)
    assert (faces.kind == FaceKind.LOOP).all()
    found = quadrons(graph, faces, about="contacts")
    area = abs(np.linalg.det(graph.cell))
    assert found.area.sum() == pytest.approx(area, rel=1e-12)
    total = np.bincount(found.face, found.area)
    assert np.abs(total / faces.area - 1).max() > 1e-3


@pytest.mark.parametrize("n", [3, 4, 5, 8])
def test_regular_polygons(n):
    """Kites of the radius' chord `l cos(pi/n)` and the polygon's circumradius."""
    found = quadrons(regular_polygon(n, strain=0.05))
    side = 0.95
    circum = side / (2 * np.sin(np.pi / n))
    assert np.linalg.norm(found.reach, axis=1) == pytest.approx(circum, rel=1e-12)
    assert np.linalg.norm(found.chord, axis=1) == pytest.approx(side * np.cos(np.pi / n), rel=1e-12)
    assert found.skew == pytest.approx(0, abs=1e-12)
    assert found.elongation == pytest.approx(circum / side / np.cos(np.pi / n), rel=1e-12)


def test_contacts_are_in_the_middle_of_overlaps():
    """Two sizes: the chord of the small disc between the large ones, by hand."""
    graph = GrainGraph(x=[[0, 0], [3, 0], [3, 4]], radii=[2.1, 1.1, 3.1],
                       contacts=[[0, 1], [2, 1], [0, 2]])  # fmt: skip
    found = quadrons(graph)
    # Middles: x = 2.0 (from 1.9 to 2.1); y = 1.0 (from .9 to 1.1); 5 - 3.1 = 1.9 to 2.1 of 5.
    points = np.array([[2.0, 0], [3, 1.0], [1.2, 1.6]])
    middle = points.mean(axis=0)
    for grain, (a, b) in zip(range(3), ((2, 0), (0, 1), (1, 2)), strict=True):
        row = found.grain == grain
        assert found.chord[row][0] == pytest.approx(points[b] - points[a])
        assert found.reach[row][0] == pytest.approx(middle - graph.x[grain])


def test_numbering_frame_and_units_don_t_matter():
    graph = packing(24, 3)
    base = np.sort(quadrons(graph, about="contacts").area)
    rng = np.random.default_rng(0)
    order, flip = rng.permutation(graph.contact_count), rng.random(graph.contact_count) < 0.5
    contacts = np.where(flip[:, None], graph.contacts[:, ::-1], graph.contacts)[order]
    images = (graph.images * np.where(flip, -1, 1)[:, None])[order]
    turn = 1e3 * np.array([[0.6, -0.8], [0.8, 0.6]])
    other = GrainGraph(x=graph.x @ turn.T + 7.0, radii=1e3 * graph.radii, contacts=contacts,
                       images=images, cell=turn @ graph.cell)  # fmt: skip
    assert np.sort(quadrons(other, about="contacts").area) / 1e6 == pytest.approx(base, rel=1e-9)


def test_about_contacts_a_grain_is_at_the_mean_of_the_middles_of_its_overlaps():
    """Three unequal discs: corners of each quadron by hand."""
    x, radii = np.array([[0.0, 0.0], [1.4, 0.1], [0.5, 1.2]]), np.array([0.5, 1.0, 0.9])
    found = quadrons(GrainGraph(x, radii, [[0, 1], [1, 2], [2, 0]]), about="contacts")
    ring = [(0, 1), (1, 2), (2, 0)]
    touch = {}
    for i, j in ring:
        d, length = x[j] - x[i], np.linalg.norm(x[j] - x[i])
        # Half-way between where the discs end on the branch.
        touch[i, j] = x[i] + 0.5 * (radii[i] + length - radii[j]) / length * d
    middle = np.mean(list(touch.values()), axis=0)
    for grain in range(3):
        before, after = touch[(grain - 1) % 3, grain], touch[grain, (grain + 1) % 3]
        point = 0.5 * (before + after)
        chord, reach = after - before, middle - point
        area = 0.5 * abs(chord[0] * reach[1] - chord[1] * reach[0])
        (row,) = np.flatnonzero((found.grain == grain) & (found.order == 3) & (found.area > 0))[:1]
        assert found.area[row] == pytest.approx(area, rel=1e-12)


def test_nothing_and_bad_words():
    chain = GrainGraph(x=[[0, 0], [1, 0]], radii=[0.5] * 2, contacts=[[0, 1]])
    assert len(quadrons(chain).area) == 0
    with pytest.raises(InputError, match="about"):
        quadrons(regular_polygon(4), about="corners")


def test_lattice_of_triangles():
    """Three quadrons a triangle, each a third of it, whatever the grain's point."""
    vectors = [[1, 0.5], [0, np.sqrt(0.75)]]
    graph = lattice(vectors, [[1, 0], [0, 1], [-1, 1]], [1e-3] * 3, [0.0] * 3, (3, 3))
    for about in ("centres", "contacts"):
        found = quadrons(graph, about=about)
        assert found.area == pytest.approx(np.sqrt(0.75) / 6, rel=1e-12)
