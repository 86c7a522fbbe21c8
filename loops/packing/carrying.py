"""Which grains of a packing carry: the others move with nothing and are left out of its system."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loops.arrays import Flags, Integers
from loops.errors import InputError
from loops.graph import GrainGraph
from loops.pruning import component_labels, winding_ranks


@dataclass(frozen=True, eq=False)
class Carrying:
    """Grains and contacts that carry, and how many do not.

    `anchors` has one grain of each component that nothing holds: its translations are fixed.
    `rattlers` have fewer than two contacts, pruned recursively; `clusters` and `clustered` count
    the components, and their grains, that touch no border and don't wind around the cell.
    """

    grains: Flags
    contacts: Flags
    anchors: Integers
    rattlers: int
    clusters: int
    clustered: int


def carrying_grains(graph: GrainGraph, closed: Flags, supports: Integers) -> Carrying:
    """Prune what hangs or floats; `supports` (G,) counts wall contacts, or how a grain is held."""
    kept, contacts = _pruned(graph, closed, supports)
    count, label = component_labels(graph.grain_count, graph.contacts[contacts], kept)
    held = np.bincount(label[kept], weights=supports[kept], minlength=count) > 0
    winds = np.zeros(count, dtype=bool)
    if graph.images is not None:
        winds = winding_ranks(graph.contacts[contacts], graph.images[contacts], label, count) > 0
    good = held | winds
    if not good.any():
        raise InputError(
            "packing",
            f"{count} clusters that float" if count else "grains that all float",
            "contacts that span the periodic cell, walls, or grains that are held",
            "Give the cell or the walls, or hold the outline's grains.",
        )
    grains = kept & np.append(good, False)[label]
    free = np.flatnonzero(good & ~held)
    first = np.full(count, graph.grain_count)
    np.minimum.at(first, label[kept], np.flatnonzero(kept))
    return Carrying(
        grains=grains,
        contacts=contacts & grains[graph.contacts[:, 0]],
        anchors=first[free],
        rattlers=int(np.count_nonzero(~kept)),
        clusters=int(np.count_nonzero(~good)),
        clustered=int(np.count_nonzero(kept & ~grains)),
    )


def _pruned(graph: GrainGraph, closed: Flags, supports: Integers) -> tuple[Flags, Flags]:
    kept, contacts = np.ones(graph.grain_count, dtype=bool), closed.copy()
    while True:
        degree = supports + np.bincount(graph.contacts[contacts].ravel(), minlength=len(kept))
        loose = kept & (degree < 2)
        if not loose.any():
            return kept, contacts
        kept &= ~loose
        contacts &= kept[graph.contacts].all(axis=1)
