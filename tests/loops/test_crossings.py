"""Crossing branches: hand-made ones, exact arithmetic on random ones, none in planar networks."""

from fractions import Fraction
from itertools import combinations_with_replacement, product

import numpy as np
import pytest

from loops import GrainGraph, InputError, euler_check, find_crossings, find_faces
from patterns import synthetic_network


def network(x, contacts, images=None, cell=None):
    x = np.asarray(x, dtype=float)
    return GrainGraph(x=x, radii=np.full(len(x), 0.5), contacts=contacts, images=images, cell=cell)


SQUARE = [[0, 1], [1, 2], [2, 3], [3, 0]]


def test_both_diagonals_of_a_square():
    graph = network([[0, 0], [1, 0], [1, 1], [0, 1]], [*SQUARE, [0, 2], [1, 3]])
    assert find_crossings(graph).tolist() == [[4, 5]]
    assert not euler_check(graph, find_faces(graph)).ok


def test_one_diagonal_is_no_crossing():
    graph = network([[0, 0], [1, 0], [1, 1], [0, 1]], [*SQUARE, [0, 2]])
    assert find_crossings(graph).shape == (0, 2)


def test_a_figure_of_eight_that_euler_does_not_see():
    graph = network([[0, 0], [1, 1], [1, 0], [0, 1]], SQUARE)
    assert find_crossings(graph).tolist() == [[0, 2]]
    assert euler_check(graph, find_faces(graph)).ok


def test_two_components_that_cross_and_that_euler_does_not_see():
    x = [[0, 0], [2, 0], [1, 2], [0, 1], [2, 1], [1, -1]]
    graph = network(x, [[0, 1], [1, 2], [2, 0], [3, 4], [4, 5], [5, 3]])
    assert find_crossings(graph).tolist() == [[0, 4], [0, 5], [1, 3], [1, 4], [2, 3], [2, 5]]
    assert euler_check(graph, find_faces(graph)).ok


@pytest.mark.parametrize("cell", [np.diag([10.0, 10.0]), [[10.0, 7.0], [1.0, 10.0]]])
@pytest.mark.parametrize("fractional", [(0.5, 0.5), (0.98, 0.5), (0.5, 0.98), (0.98, 0.99)])
def test_a_crossing_anywhere_in_a_periodic_cell(cell, fractional):
    cell = np.asarray(cell)
    u = np.array([[-1, -1], [1, 1], [-1, 1], [1, -1]]) * 0.05 + fractional
    home = np.floor(u).astype(int)
    contacts = np.array([[0, 1], [2, 3]])
    images = home[contacts[:, 1]] - home[contacts[:, 0]]
    graph = network((u - home) @ cell.T, contacts, images, cell)
    assert find_crossings(graph).tolist() == [[0, 1]]
    apart = network((u - home) @ cell.T, [[0, 2], [1, 3]], images=None, cell=cell)
    # Without their images the same grains are joined the long way, which need not cross.
    crossed = exact_crossings(apart, reach=2)
    assert find_crossings(apart).tolist() == crossed


def test_contacts_that_share_a_grain_cross_through_another_image():
    # From grain 0 to grain 1, and from grain 1 to the grain 0 after next, across the next contact.
    x, cell = [[0.0, 0.0], [0.75, 0.5]], np.eye(2)
    graph = network(x, [[0, 1], [1, 0]], [[0, 0], [2, 0]], cell)
    assert find_crossings(graph).tolist() == exact_crossings(graph) == [[0, 1]]


@pytest.mark.parametrize("turn", [0.0, 0.3, 1.0, 2.5])
def test_touching_and_overlapping(turn):
    c, s = np.cos(turn), np.sin(turn)
    x = np.array([[0, 0], [4, 0], [1, 0], [3, 0], [2, 0], [2, 1], [5, 0], [6, 0], [1, 2], [2, 2]])
    x = x @ np.array([[c, s], [-s, c]])
    contacts = [[0, 1], [2, 3], [4, 5], [6, 7], [8, 9]]
    # 0-1 holds 2-3, grain 4 lies on both of them; 6-7 goes on along the same line.
    assert find_crossings(network(x, contacts)).tolist() == [[0, 1], [0, 2], [1, 2]]
    # Two branches from grain 0 one way, one the other way.
    folded = network(x, [[2, 0], [2, 3], [1, 2]])
    assert find_crossings(folded).tolist() == [[1, 2]]


def test_a_branch_longer_than_the_cell_overlaps_itself():
    x = [[0.5, 0.5], [0.75, 0.5]]
    around = network(x, [[0, 1], [1, 0]], [[1, 0], [0, 0]], np.eye(2))
    assert [0, 0] in find_crossings(around).tolist()
    once = network(x, [[0, 0]], [[1, 0]], np.eye(2))
    assert find_crossings(once).shape == (0, 2)


def test_no_contacts():
    assert find_crossings(network([[0, 0], [1, 0]], [])).shape == (0, 2)
    assert find_crossings(network([[0, 0], [1, 0]], [], cell=np.eye(2))).shape == (0, 2)


def test_batches_are_refused():
    x = np.zeros((3, 2, 2)) + np.array([[0, 0], [1, 0]])
    with pytest.raises(InputError, match="graph: got batch axes"):
        find_crossings(GrainGraph(x=x, radii=np.ones(2), contacts=[[0, 1]]))


# Random graphs, exact arithmetic


def exact_crossings(graph, reach=3):
    """All pairs that meet elsewhere than in a common grain, in integers of 2^-80."""
    cell = np.zeros((2, 2)) if graph.cell is None else graph.cell
    columns = [[int(Fraction(v) * 2**80) for v in column] for column in cell.T.tolist()]
    images = np.zeros((graph.contact_count, 2), int) if graph.images is None else graph.images
    x = [[int(Fraction(v) * 2**80) for v in point] for point in graph.x.tolist()]
    shifts = [(0, 0)] if graph.cell is None else product(range(-reach, reach + 1), repeat=2)
    shifts = list(shifts)

    def at(grain, p, q):
        return tuple(x[grain][k] + p * columns[0][k] + q * columns[1][k] for k in (0, 1))

    def ends(c, p, q):
        (i, j), (a, b) = graph.contacts[c].tolist(), images[c].tolist()
        return {(i, p, q): at(i, p, q), (j, p + a, q + b): at(j, p + a, q + b)}

    pairs = []
    for c, d in combinations_with_replacement(range(graph.contact_count), 2):
        others = [ends(d, p, q) for p, q in shifts if c != d or (p, q) != (0, 0)]
        if any(meet_beyond_grains(ends(c, 0, 0), other) for other in others):
            pairs.append([c, d])
    return pairs


def meet_beyond_grains(one, other):
    (a, b), (c, d) = one.values(), other.values()
    for k in (0, 1):
        if max(min(a[k], b[k]), min(c[k], d[k])) > min(max(a[k], b[k]), max(c[k], d[k])):
            return False
    common = one.keys() & other.keys()
    if len(common) == 2:
        return True
    if common:
        (hub,) = (one[key] for key in common)
        u = minus(a if b == hub else b, hub)
        v = minus(c if d == hub else d, hub)
        return cross(u, v) == 0 and u[0] * v[0] + u[1] * v[1] > 0
    sides = [cross(minus(b, a), minus(p, a)) for p in (c, d)]
    other_sides = [cross(minus(d, c), minus(p, c)) for p in (a, b)]
    return min(sides) <= 0 <= max(sides) and min(other_sides) <= 0 <= max(other_sides)


def minus(a, b):
    return a[0] - b[0], a[1] - b[1]


def cross(a, b):
    return a[0] * b[1] - a[1] * b[0]


def drawn(rng, grains, contacts, size):
    """Distinct grid points and distinct contacts between them, in units of 1/8."""
    x = rng.choice(size * size, grains, replace=False)
    pairs = rng.permutation([(i, j) for i in range(grains) for j in range(i)])
    return np.column_stack(np.divmod(x, size)) / 8, pairs[:contacts]


@pytest.mark.parametrize("size", [pytest.param(4, marks=pytest.mark.slow), 8, 1000])
def test_random_graphs_in_the_plane(size):
    """Few grid points make touching, folding and overlapping frequent."""
    for seed in range(15):
        graph = network(*drawn(np.random.default_rng(seed), 12, 16, size))
        exact = exact_crossings(graph)
        for compiled in (False, True):
            assert find_crossings(graph, compiled=compiled).tolist() == exact


@pytest.mark.parametrize("cell", [[[1, 0], [0, 1]], [[1, 0.5], [0, 2]], [[1, -0.25], [0.5, 1]]])
@pytest.mark.parametrize("scale", [1, 4])
def test_random_graphs_in_periodic_cells(cell, scale):
    """Cells a few branches wide, grains anywhere, images up to one cell away."""
    for seed in range(30):
        rng = np.random.default_rng(seed)
        x, contacts = drawn(rng, 6, 6, 8 * scale)
        box = np.array(cell, dtype=float) * scale
        # Grains that coincide through the cell would touch at their centres: shift them apart.
        x = x + np.arange(6)[:, None] / 64
        images = rng.integers(-1, 2, size=(6, 2)) * (rng.random((6, 1)) * scale < 1)
        home = rng.integers(-1, 2, size=(6, 2))
        graph = network(x + home @ box.T, contacts, images, box)
        plain = find_crossings(graph, compiled=False).tolist()
        assert find_crossings(graph, compiled=True).tolist() == plain
        assert seed >= 12 or plain == exact_crossings(graph, reach=6)


def test_the_search_stops_at_the_given_number():
    graph = network(*drawn(np.random.default_rng(0), 60, 1000, 1000))
    everything = find_crossings(graph, max_pairs=10**6, compiled=False)
    np.testing.assert_array_equal(everything, find_crossings(graph, 10**6, compiled=True))
    assert len(everything) > 20_000
    for compiled in (False, True):
        some = find_crossings(graph, max_pairs=100, compiled=compiled)
        assert some.shape == (100, 2)
        assert {tuple(p) for p in some.tolist()} <= {tuple(p) for p in everything.tolist()}
        assert (np.sort(some, axis=1) == some).all() and (np.diff(some[:, 0]) >= 0).all()


# Planar networks, and one contact too many


@pytest.mark.parametrize("seed", range(50))
def test_synthetic_networks_are_planar(seed):
    kind = [{}, {"periodic": True}, {"cell": [[30, 11], [-2, 20]]}, {"cell": np.diag([2, 50.0])}]
    coordination = [3.0, 3.7, 6.0][seed % 3]
    graph = synthetic_network(
        [12, 100, 1000][seed % 3],
        seed=seed,
        coordination=coordination,
        jitter=0.43,
        **kind[seed % 4],
    )
    assert find_crossings(graph).shape == (0, 2)


@pytest.mark.parametrize("seed", range(10))
def test_a_single_long_contact_through_a_network(seed):
    """As many crossings as the straight line has intersections with the other branches."""
    rng = np.random.default_rng(seed)
    graph = synthetic_network(3000, seed=seed, coordination=4)
    i, j = rng.choice(graph.grain_count, 2, replace=False)
    contacts = np.concatenate([graph.contacts, [[i, j]]])
    contacts = contacts[(np.sort(contacts, axis=1) != np.sort([i, j])).any(axis=1)]
    contacts = np.concatenate([contacts, [[i, j]]])
    a, b = graph.x[contacts[:-1, 0]], graph.x[contacts[:-1, 1]]
    line = graph.x[j] - graph.x[i]
    sides = [
        line[0] * (p[:, 1] - graph.x[i, 1]) - line[1] * (p[:, 0] - graph.x[i, 0]) for p in (a, b)
    ]
    d = b - a
    sides += [d[:, 0] * (p[1] - a[:, 1]) - d[:, 1] * (p[0] - a[:, 0]) for p in graph.x[[i, j]]]
    crossed = (sides[0] * sides[1] < 0) & (sides[2] * sides[3] < 0)
    crossed &= ~np.isin(contacts[:-1], [i, j]).any(axis=1)
    expected = [[c, len(contacts) - 1] for c in np.flatnonzero(crossed).tolist()]
    assert len(expected) > 5 or np.hypot(*line) < 20
    assert find_crossings(network(graph.x, contacts)).tolist() == expected


# Sizes far apart


def wheel(radius, count, centre=(0.0, 0.0)):
    """A large grain with small ones all around it, each touching its neighbours."""
    angle = 2 * np.pi * np.arange(count) / count
    x = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    rim = np.column_stack([np.arange(count), np.roll(np.arange(count), -1)])
    spokes = np.column_stack([np.arange(count), np.full(count, count)])
    return np.concatenate([x, [[0, 0]]]) + centre, np.concatenate([rim, spokes])


@pytest.mark.parametrize("extra", [0, 1])
def test_a_grain_a_thousand_times_larger_than_its_neighbours(extra):
    count = 3000
    x, contacts = wheel(1000.0, count)
    y, more = wheel(1000.0, count, centre=(2000.0 + 2.0, 0.0))
    contacts = np.concatenate([contacts, more + count + 1, [[1, 3]]])[: 4 * count + extra]
    found = find_crossings(network(np.concatenate([x, y]), contacts))
    # The chord over grain 2 passes inside it, across its spoke.
    assert found.tolist() == [[count + 2, len(contacts) - 1]] * extra


@pytest.mark.parametrize("extra", [0, 1])
def test_a_fine_cluster_in_a_coarse_packing(extra):
    coarse = synthetic_network(200, seed=1)
    fine = synthetic_network(3000, seed=2)
    # Within the first bounded loop: about one coarse grain in size at 1/1000 of its scale.
    faces = find_faces(coarse)
    loop = faces.loops[np.argmax(faces.area[faces.loops])]
    corners = coarse.x[faces.grains[faces.offsets[loop] : faces.offsets[loop + 1]]]
    x = np.concatenate([coarse.x, corners.mean(axis=0) + 1e-3 * (fine.x - fine.x.mean(axis=0))])
    contacts = np.concatenate([coarse.contacts, fine.contacts + coarse.grain_count])
    shortcut = fine.contacts[0] + coarse.grain_count
    far = [[shortcut[0], len(x) - 1]]
    found = find_crossings(network(x, np.concatenate([contacts, far])[: len(contacts) + extra]))
    assert (len(found) > 10) == bool(extra)
    assert (found[:, 1] == len(contacts)).all()


# Compiled


@pytest.mark.parametrize("periodic", [False, True])
def test_planar_networks_and_one_contact_too_many(periodic):
    graph = synthetic_network(3000, seed=1, periodic=periodic, jitter=0.43)
    assert find_crossings(graph, compiled=True).shape == (0, 2)
    far = np.concatenate([graph.contacts, [[3, 1500]]])
    images = None if graph.images is None else np.concatenate([graph.images, [[0, 0]]])
    crossed = network(graph.x, far, images, graph.cell)
    found = find_crossings(crossed, compiled=True)
    assert len(found) > 10
    np.testing.assert_array_equal(found, find_crossings(crossed, compiled=False))


@pytest.mark.parametrize("count", [300, 30_000])
def test_crowded_bins_are_left_to_the_plain_way(count):
    """A fan of branches, all in one bin at its hub."""
    x, contacts = wheel(1000.0, count)
    chord = [[1, 3]]
    found = find_crossings(network(x, np.concatenate([contacts, chord])), compiled=True)
    assert found.tolist() == [[count + 2, 2 * count]]


def test_a_contact_of_two_grains_through_two_images_may_overlap():
    graph = GrainGraph(
        x=[[0.1, 0.5], [0.6, 0.5]],
        radii=[0.3, 0.3],
        contacts=[[0, 1], [1, 0], [0, 1]],
        images=[[0, 0], [1, 0], [1, 0]],
        cell=np.eye(2),
    )
    plain = find_crossings(graph, compiled=False).tolist()
    assert find_crossings(graph, compiled=True).tolist() == plain
    assert len(plain) > 0
