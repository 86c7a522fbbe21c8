import numpy as np

from loops import GrainGraph, crossing_contacts_to_drop, find_crossings


def crossed_grid(side, rng):
    """Square grid with both diagonals in some squares and long chords across, random forces."""
    x = np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2) * 1.0
    number = np.arange(side * side).reshape(side, side)
    pairs = [
        np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()], axis=1),
        np.stack([number[:-1].ravel(), number[1:].ravel()], axis=1),
        np.stack([number[:-1, :-1].ravel(), number[1:, 1:].ravel()], axis=1),
        np.stack([number[:-1, 1:].ravel(), number[1:, :-1].ravel()], axis=1)[::2],
        np.stack([number[:-1, :-2].ravel(), number[1:, 2:].ravel()], axis=1)[::5],
    ]
    contacts = np.concatenate(pairs)
    force = rng.uniform(0, 1, len(contacts))
    return GrainGraph(x=x, radii=np.full(len(x), 0.5), contacts=contacts, normal_force=force)


def without(graph, dropped):
    kept = np.delete(np.arange(graph.contact_count), dropped)
    force = np.zeros(len(kept))
    return graph.replace(
        contacts=graph.contacts[kept], normal_force=graph.normal_force[kept], shear_force=force
    )


def test_nothing_crosses_afterwards_and_nothing_is_dropped_in_vain():
    graph = crossed_grid(12, np.random.default_rng(0))
    pairs = find_crossings(graph, 10**6)
    dropped = crossing_contacts_to_drop(graph, pairs)
    assert len(find_crossings(without(graph, dropped), 10)) == 0
    # Each one left out crosses at least one that stays, or one that was left out after it.
    assert set(dropped.tolist()) <= set(pairs.ravel().tolist())
    assert len(dropped) < 0.6 * len(np.unique(pairs))


def test_of_two_the_lighter_goes():
    rng = np.random.default_rng(1)
    square = [[0, 0], [1, 0], [1, 1], [0, 1]]
    for _ in range(10):
        force = rng.uniform(0, 1, 6)
        graph = GrainGraph(
            x=square,
            radii=[0.5] * 4,
            contacts=[[0, 1], [1, 2], [2, 3], [3, 0], [0, 2], [1, 3]],
            normal_force=force,
        )
        dropped = crossing_contacts_to_drop(graph, find_crossings(graph))
        assert dropped.tolist() == [4 + int(np.argmin(force[4:]))]


def test_nothing_to_drop():
    graph = crossed_grid(3, np.random.default_rng(0))
    assert crossing_contacts_to_drop(graph, np.empty((0, 2), dtype=np.int64)).tolist() == []
