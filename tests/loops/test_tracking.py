"""Loops followed between snapshots: by hand, against sets of half-edges, and under renaming."""

import networkx as nx
import numpy as np
import pytest

from loops import (
    FaceKind,
    Fate,
    GrainGraph,
    InputError,
    exchange_counts,
    exchange_matrix,
    find_faces,
    loop_fates,
    match_contacts,
)
from patterns import synthetic_network

SQUARE = [[0, 1], [1, 2], [2, 3], [3, 0]]
CORNERS = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]


def network(x, contacts, **more):
    return GrainGraph(x=x, radii=[0.5] * len(x), contacts=contacts, **more)


def with_contacts(graph, keep):
    """The graph with the picked contacts alone."""
    return graph.replace(
        contacts=graph.contacts[keep],
        images=None if graph.images is None else graph.images[keep],
        normal_force=graph.normal_force[keep],
        shear_force=graph.shear_force[keep],
    )


def follow(before, after, before_ids=None, after_ids=None):
    one = np.arange(before.grain_count) if before_ids is None else before_ids
    two = np.arange(after.grain_count) if after_ids is None else after_ids
    match = match_contacts(before, one, after, two)
    return loop_fates(match, find_faces(before), find_faces(after))


def names(fates):
    return [Fate(k).name for k in fates.before], [Fate(k).name for k in fates.after]


def entries(fates):
    return list(zip(*(part.tolist() for part in exchange_counts(fates)), strict=True))


# --- by hand ------------------------------------------------------------------------------------


def test_a_diagonal_closes_and_opens():
    square = network(CORNERS, SQUARE)
    crossed = network(CORNERS, [*SQUARE, [0, 2]])
    closing = follow(square, crossed)
    assert names(closing) == (["SPLIT"], ["SPLIT", "SPLIT"])
    assert entries(closing) == [(4, 3, 1)]
    assert (closing.contacts.opened, closing.contacts.closed) == (0, 1)
    assert closing.successor.tolist() == [0]  # the first of two that share two sides each
    assert closing.predecessor.tolist() == [0, 0]
    assert closing.shared.tolist() == [2]
    opening = follow(crossed, square)
    assert names(opening) == (["MERGED", "MERGED"], ["MERGED"])
    assert entries(opening) == [(3, 4, 2)]
    assert (opening.contacts.opened, opening.contacts.closed) == (1, 0)


def test_an_exchange_of_neighbours_is_a_change():
    one, other = (network(CORNERS, [*SQUARE, diagonal]) for diagonal in ([0, 2], [1, 3]))
    fates = follow(one, other)
    assert names(fates) == (["CHANGED"] * 2, ["CHANGED"] * 2)
    assert entries(fates) == [(3, 3, 2)]
    assert (fates.contacts.opened, fates.contacts.closed) == (1, 1)


def two_squares(contacts):
    x = [*CORNERS, [2.0, 0.0], [2.0, 1.0]]
    return network(x, contacts)


def test_on_the_border():
    """Grains 1 and 2 are shared; 4 and 5 belong to the right square alone."""
    both = [*SQUARE, [1, 4], [4, 5], [5, 2]]
    opened = follow(two_squares(both), two_squares([*SQUARE, [1, 4], [5, 2]]))
    assert names(opened) == (["SURVIVED", "DIED"], ["SURVIVED"])
    assert entries(opened) == [(4, 0, 1), (4, 4, 1)]
    assert opened.successor.tolist() == [0, -1]
    closed = follow(two_squares([*SQUARE, [1, 4], [5, 2]]), two_squares(both))
    assert names(closed) == (["SURVIVED"], ["SURVIVED", "BORN"])
    assert entries(closed) == [(0, 4, 1), (4, 4, 1)]
    # The contact between the two opens, and one of the border with it: both are open outside.
    gone = follow(two_squares(both), two_squares([c for c in both if c not in ([1, 2], [4, 5])]))
    assert names(gone) == (["DIED"] * 2, [])


def test_a_loop_that_loses_some_sides_to_the_outside_has_changed():
    """A hexagon with one corner cut off by a chord; the corner's contacts open."""
    angle = np.radians(60.0 * np.arange(6))
    x = np.column_stack([np.cos(angle), np.sin(angle)])
    ring = [[k, (k + 1) % 6] for k in range(6)]
    fates = follow(network(x, ring), network(x, [*ring[2:], [0, 2]]))
    assert names(fates) == (["CHANGED"], ["CHANGED"])
    assert entries(fates) == [(6, 5, 1)]
    # The same corner with the chord there from the start: its triangle dies, the rest survives.
    fates = follow(network(x, [*ring, [0, 2]]), network(x, [*ring[2:], [0, 2]]))
    assert sorted(names(fates)[0]) == ["DIED", "SURVIVED"]


@pytest.mark.parametrize("joined", [0, 1, 2])
def test_a_grain_inside_a_loop(joined):
    """A rattler gets contacts: with one it dangles, two split the loop."""
    x = [*CORNERS, [0.4, 0.5]]
    contacts = [*SQUARE, [4, 0], [4, 2]][: 4 + joined]
    there = follow(network(x, SQUARE), network(x, contacts))
    back = follow(network(x, contacts), network(x, SQUARE))
    if joined < 2:
        assert names(there) == names(back) == (["SURVIVED"], ["SURVIVED"])
    else:
        assert names(there) == (["SPLIT"], ["SPLIT"] * 2)
        assert entries(there) == [(4, 4, 1)]
        assert names(back) == (["MERGED"] * 2, ["MERGED"])


def test_a_cluster_that_comes_loose_changes_the_loop():
    inner = [[0.4, 0.4], [0.6, 0.4], [0.5, 0.6]]
    triangle = [[4, 5], [5, 6], [6, 4]]
    loose = network([*CORNERS, *inner], [*SQUARE, *triangle])
    bridged = network([*CORNERS, *inner], [*SQUARE, *triangle, [0, 4]])
    fates = follow(loose, bridged)
    orders = fates.order_before.tolist()
    assert dict(zip(orders, names(fates)[0], strict=True)) == {4: "CHANGED", 3: "SURVIVED"}
    assert sorted(fates.order_after.tolist()) == [3, 9]


def test_a_cluster_that_joins_or_comes_loose_while_a_diagonal_closes_is_no_split():
    """The loop's own half-edges go, or those of the cluster's outside come, besides the chord."""
    x = [*CORNERS, [0.7, 0.1], [0.9, 0.1], [0.8, 0.3]]
    triangle = [[4, 5], [5, 6], [6, 4]]
    loose = network(x, [*SQUARE, *triangle])
    bridged = network(x, [*SQUARE, *triangle, [1, 5]])
    divided = network(x, [*SQUARE, *triangle, [0, 2]])
    held = network(x, [*SQUARE, *triangle, [0, 4], [2, 6]])
    for before, after in ((bridged, divided), (loose, held)):
        for fates in (follow(before, after), follow(after, before)):
            small = fates.order_before == 3
            survived = (fates.before == Fate.SURVIVED) & small
            # The triangle, which the network keeps in either snapshot.
            assert np.count_nonzero(survived) == 1
            assert (fates.before[~survived] == Fate.CHANGED).all()
            assert np.count_nonzero(fates.after == Fate.CHANGED) == len(fates.after) - 1


def test_nothing_in_common_and_nothing_at_all():
    square, chain = network(CORNERS, SQUARE), network(CORNERS, SQUARE[:2])
    assert names(follow(square, square, after_ids=np.arange(10, 14))) == (["DIED"], ["BORN"])
    assert names(follow(square, chain)) == (["DIED"], [])
    assert names(follow(chain, square)) == ([], ["BORN"])
    nothing = follow(chain, chain)
    assert names(nothing) == ([], [])
    assert entries(nothing) == []
    assert exchange_matrix(exchange_counts(nothing)).tolist() == [[0]]


def test_ids_are_checked():
    square = network(CORNERS, SQUARE)
    with pytest.raises(InputError, match="7 twice"):
        match_contacts(square, [7, 8, 7, 9], square, range(4))
    with pytest.raises(InputError, match="shape"):
        match_contacts(square, range(3), square, range(4))


# --- periodic images ----------------------------------------------------------------------------


def two_grain_cell(images, x=((0.0, 0.0), (0.5, 0.45)), cell=((1.0, 0.0), (0.0, 0.9))):
    """Two grains that touch through four images, a square lattice on its tip."""
    return network(x, [[0, 1]] * 4, images=images, cell=cell)


def test_two_grains_that_touch_through_several_images():
    images = np.array([[0, 0], [-1, 0], [-1, -1], [0, -1]])
    one = two_grain_cell(images)
    moved = [[0.02, -0.01], [0.52, 0.46]]
    # Grain 1 leaves the cell and is wrapped to its other side: every image changes.
    wrapped = two_grain_cell(images + 1, x=[moved[0], [-0.48, -0.44]])
    match = match_contacts(one, [0, 1], wrapped, [0, 1])
    assert match.after.tolist() == [0, 1, 2, 3]
    # Listed the other way round, in another order, one contact opened.
    order = [2, 0, 3]
    turned = network(moved, [[1, 0]] * 3, images=-images[order], cell=[[1.0, 0.0], [0.0, 0.9]])
    match = match_contacts(one, [0, 1], turned, [0, 1])
    assert match.after.tolist() == [1, -1, 0, 2]
    assert match.reversed.tolist() == [True, False, True, True]


def test_long_cell_vectors_of_a_short_lattice():
    """The same lattice by vectors three and four times as long: images still differ by its own."""
    basis = np.array([[3, 4], [1, 1]])
    inverse = np.array([[-1, 4], [1, -3]])
    images = np.array([[0, 0], [-1, 0], [-1, -1], [0, -1]])
    short = two_grain_cell(images)
    long = two_grain_cell(images @ inverse.T, cell=short.cell @ basis)
    for one, two in ((short, long), (long, long)):
        assert match_contacts(one, [0, 1], two, [0, 1]).after.tolist() == [0, 1, 2, 3]


def test_a_flipped_cell_is_the_same_cell():
    """A code that keeps its tilted cell short adds one cell vector to another."""
    graph = synthetic_network(100, seed=4, periodic=True)
    shear = np.array([[1, 1], [0, 1]])
    flipped = graph.replace(
        cell=graph.cell @ shear, images=graph.images @ np.linalg.inv(shear).T.round().astype(int)
    )
    match = match_contacts(graph, range(100), flipped, range(100))
    assert match.after.tolist() == list(range(graph.contact_count))


def test_a_grain_that_touches_its_own_image():
    cell = [[1.0, 0.0], [0.0, 0.9]]
    one = network([[0.0, 0.0]], [[0, 0], [0, 0]], images=[[1, 0], [0, 1]], cell=cell)
    two = network([[0.3, 0.0]], [[0, 0], [0, 0]], images=[[0, -1], [1, 0]], cell=cell)
    match = match_contacts(one, [0], two, [0])
    assert match.after.tolist() == [1, 0]
    assert match.reversed.tolist() == [False, True]


# --- random networks ----------------------------------------------------------------------------


def changed_network(seed, periodic, lost=0.06, gained=0.06):
    """Two networks of the same grains: some contacts of each are not in the other."""
    rng = np.random.default_rng(seed)
    graph = synthetic_network(300, seed=seed, periodic=periodic, coordination=4.4)
    draw = rng.random(graph.contact_count)
    return with_contacts(graph, draw > gained), with_contacts(graph, draw < 1 - lost), rng


def renamed(graph, rng):
    """The same network with grains and contacts in another order and direction, and its ids."""
    new_of_old = rng.permutation(graph.grain_count)
    order = rng.permutation(graph.contact_count)
    turned = rng.random(graph.contact_count) < 0.5
    contacts = new_of_old[graph.contacts[order]]
    contacts = np.where(turned[:, None], contacts[:, ::-1], contacts)
    x, radii = np.empty_like(graph.x), np.empty_like(graph.radii)
    x[new_of_old], radii[new_of_old] = graph.x, graph.radii
    ids = np.empty(graph.grain_count, dtype=int)
    ids[new_of_old] = np.arange(graph.grain_count) + 1000
    more = {}
    if graph.images is not None:
        images = graph.images[order] * np.where(turned, -1, 1)[:, None]
        # Every grain somewhere else in the lattice, and all of them shifted.
        home = rng.integers(-2, 3, (graph.grain_count, 2))
        i, j = contacts.T
        more = {"images": images + home[i] - home[j], "cell": graph.cell}
        x = x + home @ graph.cell.T + rng.random(2) * 50
    return GrainGraph(x=x, radii=radii, contacts=contacts, **more), ids


def half_edge_sets(graph, ids):
    """Loops as frozen sets of pairs of ids: unique here, for no pair touches twice."""
    faces = find_faces(graph)
    sets = []
    for face in faces.loops:
        part = slice(faces.offsets[face], faces.offsets[face + 1])
        start = ids[faces.grains[part]]
        c, forward = faces.contacts[part], faces.forward[part]
        end = ids[np.where(forward, graph.contacts[c, 1], graph.contacts[c, 0])]
        sets.append(frozenset(zip(start.tolist(), end.tolist(), strict=True)))
    assert (faces.kind[faces.loops] == FaceKind.LOOP).all()
    return sets


def fates_by_sets(old, new):
    """The definition of `loop_fates`, read off sets."""
    overlap = nx.Graph()
    overlap.add_nodes_from([("old", k) for k in range(len(old))])
    overlap.add_nodes_from([("new", k) for k in range(len(new))])
    owner = {edge: k for k, loop in enumerate(new) for edge in loop}
    for a, loop in enumerate(old):
        overlap.add_edges_from((("old", a), ("new", owner[e])) for e in loop if e in owner)
    found = {}
    for part in nx.connected_components(overlap):
        olds = [old[k] for side, k in part if side == "old"]
        news = [new[k] for side, k in part if side == "new"]
        here, there = frozenset().union(*olds), frozenset().union(*news)
        inner_old = all((j, i) in here for i, j in here - there)
        inner_new = all((j, i) in there for i, j in there - here)
        if not news:
            fate = Fate.DIED
        elif not olds:
            fate = Fate.BORN
        elif len(olds) == len(news) == 1 and here == there:
            fate = Fate.SURVIVED
        elif len(olds) == 1 and len(news) > 1 and here <= there and inner_new:
            fate = Fate.SPLIT
        elif len(news) == 1 and len(olds) > 1 and there <= here and inner_old:
            fate = Fate.MERGED
        else:
            fate = Fate.CHANGED
        found.update(dict.fromkeys(part, fate))
    return ([found["old", k] for k in range(len(old))], [found["new", k] for k in range(len(new))])


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_fates_against_sets_of_half_edges(seed, periodic):
    before, after, rng = changed_network(seed, periodic)
    one, two = renamed(before, rng), renamed(after, rng)
    fates = follow(one[0], two[0], one[1], two[1])
    old, new = half_edge_sets(*one), half_edge_sets(*two)
    expected = fates_by_sets(old, new)
    assert fates.before.tolist() == expected[0]
    assert fates.after.tolist() == expected[1]
    # Every kind of fate occurs, so that every branch is tested.
    kinds = set(expected[0]) | set(expected[1])
    assert kinds >= {Fate.SURVIVED, Fate.SPLIT, Fate.MERGED, Fate.CHANGED}
    for a, loop in enumerate(old):
        common = [len(loop & other) for other in new]
        best = int(np.argmax(common))
        assert fates.successor[a] == (best if common[best] else -1)
        assert fates.shared[a] == common[best]
    linked = [[a, b] for a, one in enumerate(old) for b, other in enumerate(new) if one & other]
    assert fates.links.tolist() == linked
    for b, loop in enumerate(new):
        common = [len(loop & other) for other in old]
        assert fates.predecessor[b] == (int(np.argmax(common)) if max(common) else -1)


@pytest.mark.parametrize("periodic", [False, True])
def test_exchange_counts_every_earlier_loop_once(periodic):
    before, after, _ = changed_network(7, periodic, lost=0.2, gained=0.2)
    fates = follow(before, after)
    counts = exchange_counts(fates)
    whole = exchange_matrix(counts)
    orders, loops = np.unique(fates.order_before, return_counts=True)
    assert whole.sum(axis=1)[orders].tolist() == loops.tolist()
    assert whole[1:].sum() == len(fates.before)
    assert whole[0].sum() == np.count_nonzero(fates.after == Fate.BORN)
    assert whole[:, 0].sum() == np.count_nonzero(fates.before == Fate.DIED)
    pooled = exchange_matrix(counts, last=5)
    assert pooled.shape == (6, 6)
    assert pooled[5].sum() == whole[5:].sum()
    assert pooled[3, 5] == whole[3, 5:].sum()


@pytest.mark.parametrize("periodic", [False, True])
def test_every_contact_alone(periodic):
    """Where a contact of two loops opens, they merge to one of order `n1 + n2 - 2 shared`.

    With more than one contact shared by the two, its chain dangles once one of them opens.
    """
    graph = synthetic_network(60, seed=3, periodic=periodic, coordination=4.2)
    loops = half_edge_sets(graph, np.arange(60))
    for c in range(graph.contact_count):
        i, j = graph.contacts[c].tolist()
        sides = [k for e in ((i, j), (j, i)) for k, loop in enumerate(loops) if e in loop]
        fates = follow(graph, with_contacts(graph, np.arange(graph.contact_count) != c))
        touched = np.flatnonzero(fates.before != Fate.SURVIVED).tolist()
        assert touched == sorted(set(sides))
        if len(set(sides)) == 2:
            a, b = sides
            chain = sum((j, i) in loops[b] for i, j in loops[a])
            n = len(loops[a]) + len(loops[b]) - 2 * chain
            assert [Fate(fates.before[k]).name for k in sides] == ["MERGED"] * 2
            assert fates.order_after[fates.successor[sides]].tolist() == [n, n]
            back = follow(with_contacts(graph, np.arange(graph.contact_count) != c), graph)
            assert [Fate(back.after[k]).name for k in sides] == ["SPLIT"] * 2
            assert np.count_nonzero(back.before == Fate.SPLIT) == 1


def test_loops_survive_without_a_change():
    graph = synthetic_network(500, seed=9, periodic=True)
    rng = np.random.default_rng(1)
    one, two = renamed(graph, rng), renamed(graph, rng)
    fates = follow(one[0], two[0], one[1], two[1])
    assert (fates.before == Fate.SURVIVED).all()
    assert (fates.after == Fate.SURVIVED).all()
    old, new = half_edge_sets(*one), half_edge_sets(*two)
    assert [new[k] for k in fates.successor] == old
    matrix = exchange_matrix(exchange_counts(fates))
    assert np.count_nonzero(matrix - np.diag(np.diag(matrix))) == 0


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_contacts_are_matched_in_any_unit_of_length(unit):
    """Half a cell is the limit of a contact's motion, whatever the cell is measured in."""
    graph = synthetic_network(60, seed=3, periodic=True)
    scaled = graph.replace(x=unit * graph.x, radii=unit * graph.radii, cell=unit * graph.cell)
    moved = scaled.replace(x=scaled.x + 0.1 * unit * np.sin(np.arange(60.0))[:, None])
    match = match_contacts(scaled, range(60), moved, range(60))
    assert match.after.tolist() == list(range(graph.contact_count))
