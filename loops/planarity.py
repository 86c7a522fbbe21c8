"""Make a contact graph planar: which contacts to leave out where branches cross."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from loops.graph import GrainGraph, branch_vectors


def crossing_contacts_to_drop(graph: GrainGraph, pairs: NDArray[np.int64]) -> NDArray[np.int64]:
    """Contacts whose removal leaves none of the given pairs of crossing branches.

    Of two that cross, the one with more crossings goes; of equal ones the one with the smaller
    normal force, then the longer branch, then the larger number.

    Parameters
    ----------
    graph : GrainGraph
        One state.
    pairs : (M, 2) array of int
        From `find_crossings`.

    Returns
    -------
    (K,) array of int
        Contacts to leave out, ascending.

    Examples
    --------
    >>> from loops import GrainGraph, crossing_contacts_to_drop, find_crossings
    >>> square = GrainGraph(x=[[0, 0], [1, 0], [1, 1], [0, 1]], radii=[0.5] * 4,
    ...                     contacts=[[0, 1], [1, 2], [2, 3], [3, 0], [0, 2], [1, 3]],
    ...                     normal_force=[1, 1, 1, 1, 0.2, 0.3])
    >>> crossing_contacts_to_drop(square, find_crossings(square)).tolist()
    [4]
    """
    named, pair = np.unique(pairs, return_inverse=True)
    pair = pair.reshape(-1, 2)
    length = np.hypot(*branch_vectors(graph)[named].T)
    crossings = np.bincount(pair.ravel(), minlength=len(named))
    order = np.lexsort((named, length, -graph.normal_force[named], crossings))
    rank = np.empty(len(named), dtype=np.int64)
    rank[order] = np.arange(len(named))
    dropped = np.zeros(len(named), dtype=bool)
    while len(pair):
        # The first of its neighbourhood goes; among all pairs left there is always one.
        worst = np.full(len(named), -1)
        np.maximum.at(worst, pair, rank[pair].max(axis=1)[:, None])
        dropped |= worst == rank
        pair = pair[~dropped[pair].any(axis=1)]
    return named[dropped]
