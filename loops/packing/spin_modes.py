"""Motions of spins alone that no contact resists: gear modes, and grains that slide everywhere."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import breadth_first_order, connected_components

from loops.arrays import Floats, Integers

# Ratios of radii multiplied around a ring of gears return to 1 within rounding, or the ring locks.
CLOSES = 1e-11


def spin_modes(stiffness: Floats, ends: Integers, size: int) -> tuple[Integers, Floats]:
    """(size,) number of the mode that moves each freedom, -1 for none, and how far it does so.

    A contact whose shear both spins make couples them, `S_w_i w_i + S_w_j w_j = 0`; one that
    resists a single spin, or both apart, stops them. Coupled spins are a mode where none is
    stopped and all ratios agree. Modes are null vectors of `K`; no two share a freedom.
    """
    i, j = ends[:, 4], ends[:, 5]
    a, b = stiffness[:, :, 2], stiffness[:, :, 3]
    of_i, of_j = ((np.abs(s).max(axis=1) > 0) & (w >= 0) for s, w in ((a, i), (b, j)))
    both = of_i & of_j & (i != j)
    square = np.where(both, np.sum(b * b, axis=1), 1.0)
    ratio = -np.sum(a * b, axis=1) / square
    apart = np.abs(a + ratio[:, None] * b).max(axis=1) > CLOSES * np.abs(a).max(axis=1)
    both &= ~apart & (ratio != 0)
    stopped = np.concatenate([i[of_i & ~both], j[of_j & ~both]])
    i, j, ratio = i[both], j[both], ratio[both]

    spin = np.zeros(size + 1, dtype=bool)
    spin[ends[:, 4:]] = True
    spins = np.flatnonzero(spin[:size])
    # One entry a couple: contacts of one pair through several images are compared below.
    low, high = np.minimum(i, j), np.maximum(i, j)
    _, first = np.unique(low * size + high, return_index=True)
    rows, columns = np.concatenate([i[first], j[first]]), np.concatenate([j[first], i[first]])
    turns = np.concatenate([ratio[first], 1.0 / ratio[first]])
    coupled = sparse.csr_array((turns, (rows, columns)), (size, size))
    _, label = connected_components(coupled, directed=False)
    _, starts = np.unique(label[spins], return_index=True)
    # A root that reaches one spin of each component makes one tree of all.
    roots = spins[starts]
    to_roots = sparse.csr_array(
        (np.ones(len(roots)), (np.zeros(len(roots), dtype=np.int64), roots)), (1, size)
    )
    tree = sparse.block_array([[coupled, sparse.csr_array((size, 1))], [to_roots, None]]).tocsr()
    order, before = breadth_first_order(tree, size)
    inner = order[1:]
    factor = np.asarray(tree[before[inner], inner]).ravel().tolist()
    motion = np.zeros(size + 1)
    motion[size] = 1.0
    for node, parent, turn in zip(inner.tolist(), before[inner].tolist(), factor, strict=True):
        motion[node] = turn * motion[parent]

    locked = np.zeros(label.max(initial=-1) + 1, dtype=bool)
    locked[label[stopped]] = True
    off = np.abs(motion[j] - ratio * motion[i]) > CLOSES * np.abs(motion[j])
    locked[label[i[off]]] = True
    mode = np.full(size, -1)
    free = spins[~locked[label[spins]]]
    mode[free] = np.unique(label[free], return_inverse=True)[1]
    largest = np.zeros(mode.max(initial=-1) + 2)
    np.maximum.at(largest, mode[free], np.abs(motion[free]))
    return mode, np.where(mode >= 0, motion[:size] / np.where(mode >= 0, largest[mode], 1.0), 0.0)
