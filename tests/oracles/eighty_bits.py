"""Operators of loops in packings of thousands of grains with 80 bits, straight from the contacts.

Solves by the factors of doubles, refined against a matrix of 80 bits until nothing changes. Gears
are given as modes (`spin_modes`), a border of the matrix.
"""

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from loops import Regime, loop_batches

LONG = np.longdouble
# Right-hand sides at a time, and refinements at most; each gains some digits.
PANEL, REFINEMENTS = 16, 60


def contact_blocks(system):
    """(E, 4, 4) minus the rates of force and moments per motion `(d', w_i, w_j)` of contacts."""
    graph, law, own = system.graph, system.law, system.contacts
    x, radii = graph.x.astype(LONG), graph.radii.astype(LONG)
    i, j = graph.contacts[own].T
    d = x[j] - x[i]
    if graph.cell is not None:
        d = d + graph.images[own].astype(LONG) @ graph.cell.astype(LONG).T
    kn, kt, mu = (
        np.broadcast_to(np.asarray(p, float), graph.contacts.shape[:1])[own].astype(LONG)
        for p in (law.kn, law.kt, law.mu)
    )
    N, T = (f[own].astype(LONG) for f in (graph.normal_force, graph.shear_force))
    length = np.sqrt(np.sum(d * d, axis=1))
    n = d / length[:, None]
    t = np.stack([-n[:, 1], n[:, 0]], axis=1)
    arms = [(length + radii[i] - radii[j]) / 2, (length + radii[j] - radii[i]) / 2]
    lever, turns = np.ones_like(length), arms
    if law.shear_increment == "radii":
        lever, turns = (radii[i] + radii[j]) / length, [radii[i], radii[j]]
    slides = system.regime == Regime.SLIDING
    out = np.zeros((len(own), 4, 4), LONG)
    for k, motion in enumerate(np.eye(4, dtype=LONG)):
        stretch, across = n @ motion[:2], t @ motion[:2]
        more_N = -kn * stretch
        slip = lever * across - turns[0] * motion[2] - turns[1] * motion[3]
        more_T = np.where(slides, np.sign(T) * mu * more_N, -kt * slip)
        turn = across / length
        along, beside = more_N - T * turn, more_T + N * turn
        out[:, :2, k] = -(along[:, None] * n + beside[:, None] * t)
        out[:, 2:, k] = np.stack([arm * more_T + stretch / 2 * T for arm in arms], axis=1)
    scale = np.array([1, 1, 1 / LONG(system.length), 1 / LONG(system.length)])
    return scale[:, None] * out * scale


def matrix_of(system, modes):
    """Matrix with its border, and the number of each freedom in it, -1 for a free spin's."""
    relative = np.eye(4, 6, 2, dtype=LONG) - np.eye(4, 6, dtype=LONG) * [[1], [1], [0], [0]]
    blocks = np.einsum("ka,ekl,lb->eab", relative, contact_blocks(system), relative)
    rows, columns = np.broadcast_arrays(system.ends[:, :, None], system.ends[:, None])
    inside, size = (rows >= 0) & (columns >= 0), system.size
    entries = [blocks[inside]], [rows[inside]], [columns[inside]]
    anchors = system.freedom[system.carrying.anchors, :2].ravel()
    mode, motion = modes[:2]
    gear = (mode >= 0) & (np.bincount(mode[mode >= 0], minlength=1)[mode] > 1)
    spins = np.flatnonzero(gear)
    at = size + np.unique(mode[spins], return_inverse=True)[1]
    unit = LONG(system.unit)
    for value, row, column in (
        (np.full(len(anchors), unit), anchors, anchors),
        (unit * motion[spins].astype(LONG), spins, at),
        (unit * motion[spins].astype(LONG), at, spins),
    ):
        for part, more in zip(entries, (value, row, column), strict=True):
            part.append(more)
    values, rows, columns = (np.concatenate(part) for part in entries)
    total = int(rows.max()) + 1
    kept = np.ones(total, dtype=bool)
    kept[:size] = (mode < 0) | gear
    K = sparse.coo_array((values, (rows, columns)), (total, total)).tocsr()
    return K[kept][:, kept], np.where(kept, np.cumsum(kept) - 1, -1)


def refined(K, lu, loads):
    """Solutions, refined until the residual halves no more."""
    u, left, before = np.zeros_like(loads), loads, np.inf
    for _ in range(REFINEMENTS):
        size = np.max(np.abs(left), axis=0)
        size = np.where(size > 0, size, 1)
        more = (left / size).astype(float)
        for k in range(0, loads.shape[1], 4):
            u[:, k : k + 4] += lu.solve(more[:, k : k + 4]) * size[k : k + 4]
        left = loads - K @ u
        worst = float(np.max(np.abs(left)))
        if not 0 < worst < 0.5 * before:
            break
        before = worst
    return u


def operators(system, faces, modes, *, some=None):
    """(L, 4, 4) `A_in` of the loops (or `some` rows) of grains that all move; else not numbers."""
    graph, (K, number) = system.graph, matrix_of(system, modes)
    lu = splu(K.astype(float).tocsc())
    out = np.full((len(faces.loops), 4, 4), np.nan, LONG)
    row = np.zeros(len(faces.kind), dtype=int)
    row[faces.loops] = np.arange(len(faces.loops))
    x, loops = graph.x.astype(LONG), []
    for batch in loop_batches(graph, faces):
        for face, grains, local in zip(batch.face, batch.grains, batch.graph.x, strict=True):
            if (system.freedom[grains] < 0).any() or (some is not None and row[face] not in some):
                continue
            corner = x[grains] - x[grains[0]]
            if graph.cell is not None:
                # Corners from the exact positions, through the images that the batch went by.
                gap = local - local[0] - corner.astype(float)
                image = np.round(np.linalg.solve(graph.cell, gap.T).T)
                corner = corner + image.astype(LONG) @ graph.cell.astype(LONG).T
            loops.append((row[face], grains, corner))
    for start in range(0, len(loops), PANEL // 4):
        part = loops[start : start + PANEL // 4]
        B, areas = np.zeros((K.shape[0], 4 * len(part)), LONG), []
        for k, (_, grains, corner) in enumerate(part):
            after, before = np.roll(corner, -1, axis=0), np.roll(corner, 1, axis=0)
            side = after - before
            v = np.stack([side[:, 1], -side[:, 0]], axis=1) / 2
            areas.append(np.sum(corner[:, 0] * after[:, 1] - after[:, 0] * corner[:, 1]) / 2)
            moves = number[system.freedom[grains, :2]]
            np.add.at(B[:, 4 * k : 4 * k + 2], moves[:, 0], v)
            np.add.at(B[:, 4 * k + 2 : 4 * k + 4], moves[:, 1], v)
        u = refined(K, lu, B)
        for k, (at, _, _) in enumerate(part):
            own = slice(4 * k, 4 * k + 4)
            out[at] = inverse(B[:, own].T @ u[:, own] / areas[k])
    return out


def inverse(C):
    """Inverse of a small matrix by Newton's steps from that of doubles."""
    X = np.linalg.inv(C.astype(float)).astype(LONG)
    for _ in range(5):
        X = X + X @ (np.eye(len(C), dtype=LONG) - C @ X)
    return X
