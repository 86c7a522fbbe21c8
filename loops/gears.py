"""The matrix of a packing made regular: free spins, gear modes, rings of gears that nearly close.

Spins `m` that roll on each other at all their contacts make no force, `K m = 0`: a gear mode. Where
the ratios of spins around a ring miss 1 by a mismatch `e`, the mode slips by `e` and its stiffness
is `e^2`, which `K` has but for a rounding. With motions `v + a m`, `v` beside `m`, it is written

    K v + (K m) a + m b = f,   (m K) v + (m K m) a = m f,   m v = 0,

the loads f of loops have no moments (`m f = 0`), so that b is zero but for rounding of `K`. From
the slips of the contacts `K m`, `m K` and `m K m` are known to the rounding over `e`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import breadth_first_order, connected_components

from loops.arrays import Flags, Floats, Integers
from loops.system import System, in_freedoms, stiffness_matrix

# Ratios of spins, multiplied around a ring of gears, miss 1 by its mismatch: from here on the ring
# locks as any other.
NEARLY = 1e-3
# Below this the mismatch may be rounding.
UNKNOWN = 64 * float(np.finfo(np.float64).eps)
# Rounding of a spin's share in a slip over its size: of its arm and of two products.
SLIP = 2 * float(np.finfo(np.float64).eps)
# Mismatch below which rounding of `K`, over its square, hides what resists the gears.
HIDDEN = 1e-7


@dataclass(frozen=True, eq=False)
class RegularMatrix:
    """Nonsingular `K` of the free grains of a block, with the freedoms (G, 5) of each in it.

    `coupled` (E, 2): pairs of grains that gears couple. `amplitudes`: freedoms of the rings that
    nearly close; rounding of each slip changes their columns and rows by `rounding` (c, size).
    `known`: no ring closes, or doesn't, by rounding.
    """

    matrix: sparse.csr_array
    freedom: Integers
    coupled: Integers
    amplitudes: Integers
    rounding: tuple[sparse.csr_array, sparse.csr_array]
    known: bool


def regular_matrix(
    system: System, free: Flags, whole: bool, *, slips: bool = True
) -> RegularMatrix:
    """Border the matrix by its gear modes; without `slips` only by those that rounding hides.

    All but the free grains are held. In the whole packing one grain of each component that nothing
    holds is on springs without load. A spin that no contact resists is left out. A gear mode of
    several spins is balanced by moments in proportion to it, an unknown of its own (the fourth
    freedom of one grain), with the mode as row and column at the border of `K`: the limit of `K +
    eps` for `eps` to zero. Where its rings nearly close its amplitude is one more (the fifth).
    """
    grains, size = system.graph.grain_count, system.size
    kept = np.zeros(size + 1, dtype=bool)
    kept[system.freedom[free]] = True
    kept[-1] = False
    ends = np.where(kept[system.ends], system.ends, -1)
    touched = (ends >= 0).any(axis=1)
    part = replace(system, ends=ends[touched], stiffness=system.stiffness[touched])
    springs = np.zeros(size)
    if whole:
        springs[system.freedom[system.carrying.anchors, :2].ravel()] = system.unit
    grain_of = np.empty(size, dtype=np.int64)
    where = np.nonzero(system.freedom >= 0)
    grain_of[system.freedom[where]] = where[0]
    mode, motion, mismatch = spin_modes(part.stiffness, part.ends, size)
    if not slips:
        mode = np.where(np.append(mismatch, 0.0)[mode] < HIDDEN, mode, -1)
    gears = (mode >= 0) & (np.bincount(mode[mode >= 0], minlength=1)[mode] > 1)
    kept[:-1] &= (mode < 0) | gears
    spins = np.flatnonzero(gears)
    modes, first, column = np.unique(mode[spins], return_index=True, return_inverse=True)
    mismatch = np.where(_closes(system, grain_of[spins], column), 0.0, mismatch[modes])
    nearly = np.flatnonzero(slips & (mismatch >= UNKNOWN))
    ring = np.full(len(modes), -1)
    ring[nearly] = np.arange(len(nearly))
    label = np.full(size + 1, -1)
    label[spins] = ring[column]
    state = system.rows.state.take(system.kept[touched])
    growth = 0.5 / system.length * state.shear_force[:, None] * state.n
    forces = _slip_forces(part, growth, label, np.append(motion, 0.0), len(nearly))
    border = sparse.csr_array((system.unit * motion[spins], (spins, column)), (size, len(modes)))
    beside, below = sparse.hstack([forces.right.T, border]), sparse.vstack([forces.left, border.T])
    corner = sparse.diags_array(np.append(forces.work, np.zeros(len(modes))))
    stiffness = stiffness_matrix(part) + sparse.diags_array(springs)
    matrix = sparse.block_array([[stiffness, beside], [below, corner]]).tocsr()

    own = np.concatenate([np.flatnonzero(kept[:-1]), np.arange(size, matrix.shape[0])])
    number = np.full(matrix.shape[0] + 1, -1)
    number[own] = np.arange(len(own))
    amplitudes, unknowns = np.split(number[size:-1], [len(nearly)])
    freedom, at = np.full((grains, 5), -1), grain_of[spins[first]]
    freedom[:, :3] = number[system.freedom]
    freedom[at, 3], freedom[at[nearly], 4] = unknowns, amplitudes
    rows, columns = np.concatenate([beside.nonzero(), below.nonzero()[::-1]], axis=1)
    coupled = np.column_stack([np.append(at[nearly], at)[columns], grain_of[rows]])
    for one in forces.rounding:
        one.resize(one.shape[0], matrix.shape[0])
    return RegularMatrix(
        matrix=matrix[own][:, own],
        freedom=freedom,
        coupled=coupled[coupled[:, 0] != coupled[:, 1]],
        amplitudes=amplitudes,
        rounding=(forces.rounding[0][:, own], forces.rounding[1][:, own]),
        known=not (slips & (0 < mismatch) & (mismatch < UNKNOWN)).any(),
    )


def _closes(system: System, grains: Integers, mode: Integers) -> Flags:
    """(modes,) whether all rings of grains that roll on each other close exactly.

    Spins go by the radii, or by equal shares of the branch where radii are the same.
    """
    count = int(mode.max(initial=-1)) + 1
    if getattr(system.law, "shear_increment", None) == "radii":
        return np.ones(count, dtype=bool)
    least, most = np.full(count, np.inf), np.zeros(count)
    np.minimum.at(least, mode, system.graph.radii[grains])
    np.maximum.at(most, mode, system.graph.radii[grains])
    return least == most


@dataclass(frozen=True, eq=False)
class SlipForces:
    """Forces `K m` and `m K` (k, size) of spins `m` over their largest, and `m K m` over both.

    `rounding`: what rounding of the slip of each contact adds to the forces and to the work,
    (c, size + k) each.
    """

    right: sparse.csr_array
    left: sparse.csr_array
    work: Floats
    rounding: tuple[sparse.csr_array, sparse.csr_array]


def _slip_forces(
    part: System, growth: Floats, label: Integers, motion: Floats, count: int
) -> SlipForces:
    """Forces of rings that nearly close; `label` has the ring of each spin, -1 for none.

    A contact of two spins of a ring shears by their slip, a small difference of large terms: forces
    are its slip times what one spin makes, so that rounding is relative to the slip and changes no
    direction. `growth` (E, 2): moments on both grains as the arms grow with the branch.
    """
    turns = part.ends[:, 4:]
    owner, spin = label[turns], motion[turns]
    sides, same = owner >= 0, owner[:, 0] == owner[:, 1]
    sides[:, 1] &= ~same
    rows, side = np.nonzero(sides)
    both, each = same[rows], np.arange(len(rows))
    spin = spin[rows] * (both[:, None] | (side[:, None] == [0, 1]))
    # What the spins make, and their moments, without those of growing arms: both of rank one.
    S, grown = part.stiffness[rows], np.zeros((len(rows), 2, 4))
    grown[:, :, :2] = growth[rows][:, None] * both[:, None, None]
    parts, pushes, slips, sizes, spins = [S.mT[:, 2:], S[:, 2:] - grown], [], [], [], []
    for pair in parts:
        at, entry = np.divmod(np.argmax(np.abs(pair).reshape(-1, 8), axis=1), 4)
        at = np.where(both, at, side)
        pivot = pair[each, at, entry][:, None]
        terms = spin * np.divide(pair[each, :, entry], pivot, out=spin * 0.0, where=pivot != 0.0)
        pushes.append(pair[each, at])
        slips.append(np.where(both, terms.sum(axis=1), spin[each, side]))
        sizes.append(SLIP * np.where(both, np.abs(terms).sum(axis=1), 0.0))
        spins.append(2 + at)
    found = [slip[:, None] * push for slip, push in zip(slips, pushes, strict=True)]
    found[1] += np.sum(spin[:, :, None] * grown, axis=1)

    of = sparse.csr_array((np.ones(len(rows)), (each, owner[rows, side])), (len(rows), count))
    forces = [of.T @ in_freedoms(part, rows, one) for one in found]
    scales = [abs(one).max(axis=1).toarray().ravel() / part.unit for one in forces]
    stiff = np.where(both, S[each, spins[1], spins[0]], 0.0) / (of @ (scales[0] * scales[1]))
    rounding = []
    for k, size in enumerate(sizes):
        loads = in_freedoms(part, rows, (size / (of @ scales[k]))[:, None] * pushes[k])
        more = of * (size * stiff * slips[1 - k])[:, None]
        rounding.append(sparse.hstack([loads, more]).tocsr())
    right, left = (sparse.diags_array(1.0 / k) @ f for k, f in zip(scales, forces, strict=True))
    work = of.T @ (slips[0] * stiff * slips[1])
    return SlipForces(right.tocsr(), left.tocsr(), work, (rounding[0], rounding[1]))


def spin_modes(stiffness: Floats, ends: Integers, size: int) -> tuple[Integers, Floats, Floats]:
    """(size,) number of the mode that moves each freedom, -1 for none, and how far it does so.

    A contact whose shear both spins make couples them, `S_w_i w_i + S_w_j w_j = 0`; one that
    resists a single spin, or both apart, stops them. Coupled spins are a mode where none is
    stopped and all ratios nearly agree: by how much not, relative to the spins, is the mismatch
    (modes,), at least one rounding, and zero without a ring. Modes without a mismatch are null
    vectors of `K`; no two share a freedom.
    """
    i, j = ends[:, 4], ends[:, 5]
    a, b = stiffness[:, :, 2], stiffness[:, :, 3]
    of_i, of_j = ((np.abs(s).max(axis=1) > 0) & (w >= 0) for s, w in ((a, i), (b, j)))
    both = of_i & of_j & (i != j)
    square = np.where(both, np.sum(b * b, axis=1), 1.0)
    ratio = -np.sum(a * b, axis=1) / square
    apart = np.abs(a + ratio[:, None] * b).max(axis=1) > UNKNOWN * np.abs(a).max(axis=1)
    both &= ~apart & (ratio != 0)
    stopped = np.concatenate([i[of_i & ~both], j[of_j & ~both]])
    i, j, ratio = i[both], j[both], ratio[both]

    spin = np.zeros(size + 1, dtype=bool)
    spin[ends[:, 4:]] = True
    spins = np.flatnonzero(spin[:size])
    # One entry per pair of grains: their contacts through other images are compared below.
    low, high = np.minimum(i, j), np.maximum(i, j)
    _, first = np.unique(low * size + high, return_index=True)
    rows, columns = np.concatenate([i[first], j[first]]), np.concatenate([j[first], i[first]])
    turns = np.concatenate([ratio[first], 1.0 / ratio[first]])
    coupled = sparse.csr_array((turns, (rows, columns)), (size, size))
    _, label = connected_components(coupled, directed=False)
    _, starts = np.unique(label[spins], return_index=True)
    # An extra root joined to one spin of each component makes one tree of all components.
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

    locked = np.zeros(size, dtype=bool)
    locked[label[stopped]] = True
    off, count = np.zeros(size), np.bincount(label[spins], minlength=size)
    np.maximum.at(off, label[i], np.abs(motion[j] - ratio * motion[i]) / np.abs(motion[j]))
    rings = np.bincount(label[i], minlength=size) >= count
    off = np.where(rings, np.maximum(off, np.finfo(float).eps), 0.0)
    locked |= off >= NEARLY
    mode = np.full(size, -1)
    free = spins[~locked[label[spins]]]
    labels, mode[free] = np.unique(label[free], return_inverse=True)
    largest = np.zeros(size)
    np.maximum.at(largest, mode[free], np.abs(motion[free]))
    motion = np.where(mode >= 0, motion[:size] / np.where(mode >= 0, largest[mode], 1.0), 0.0)
    return mode, motion, off[labels]
