"""Small packings by brute force.

Every combination of sticking and sliding contacts is solved densely for all directions at once and
kept on the arc where its signs agree. Probes are asked as if there were too many contacts at yield
to try all combinations; what they say is compared: statuses, solutions found and missed.
"""

from collections import Counter
from contextlib import suppress
from itertools import count

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from grainloops import probe
from loops import (
    InputError,
    LinearFrictional,
    Regime,
    Scene,
    assemble_tangent,
    branch_vectors,
    contact_state,
    contact_tangent,
)
from tests.packings import packing
from tests.stability.packing.test_statuses import AT_YIELD, at_yield, small

DIRECTIONS, CHUNK = 24, 4096
SINGULAR, SIGN, SAME_ANGLE, SAME_RATE = 1e-10, 1e-9, 1e-8, 1e-6
AXES = np.array([[1.0, 0, 0, 0], [0, 0, 0, 1.0]])


def dense_problem(graph, law, rows):
    """`Q`, `M` of `w = Q h + M z`, `A`, `S` of the stress `A h + S z`; None with a mechanism."""
    state, (i, j), size = contact_state(graph), graph.contacts.T, graph.grain_count
    elastic = np.full(graph.contact_count, Regime.ELASTIC, dtype=np.int8)
    K = assemble_tangent(graph, law, regime=elastic, spins=True)
    blocks = contact_tangent(state, law, elastic)
    branches, volume = branch_vectors(graph), abs(np.linalg.det(graph.cell))
    sizes = np.linalg.svd(K, compute_uv=False)
    if sizes[-3] < 1e-8 * sizes[0]:
        return None

    def relative(v):
        """Motion at the contacts of centres and spins `v` beyond the affine one."""
        u, w = v[: 2 * size].reshape(size, 2, -1), v[2 * size :].reshape(size, 1, -1)
        return np.concatenate([u[j] - u[i], w[i], w[j]], axis=1)

    def resultant(forces):
        """Loads on centres and spins of contact forces (C, 4, k)."""
        load = np.zeros((size, 3, forces.shape[2]))
        np.add.at(load[:, :2], i, forces[:, :2])
        np.add.at(load[:, :2], j, -forces[:, :2])
        np.add.at(load[:, 2], i, -forces[:, 2])
        np.add.at(load[:, 2], j, -forces[:, 3])
        return np.concatenate([load[:, :2].reshape(2 * size, -1), load[:, 2]])

    affine = np.zeros((len(blocks), 4, 2))
    affine[:, [0, 1], [0, 1]] = -branches
    push = np.zeros((len(blocks), 4, len(rows)))
    side = np.sign(state.shear_force[rows])
    own = np.column_stack([state.t, -state.arm_i, -state.arm_j])[rows]
    push[rows, :, np.arange(len(rows))] = -side[:, None] * own
    given = np.concatenate([-np.einsum("cij,cjk->cik", blocks, affine), push], axis=2)
    motion = relative(-np.linalg.pinv(K, rcond=1e-12) @ resultant(given))
    motion[:, :, :2] += affine
    forces = -np.einsum("cij,cjk->cik", blocks, motion)
    forces[:, :, 2:] += push
    gauge = -law.mu * law.kn * state.n[rows, :, None] * np.ones(2 + len(rows))
    w = np.sum(gauge * motion[rows, :2], axis=1)
    turn = np.einsum("ci,cik->ck", state.t[rows], motion[rows, :2])
    spin = own[:, 2:, None] * motion[rows, 2:]
    w += side[:, None] * law.kt * (turn + spin.sum(axis=1))
    w[:, 2:] += np.eye(len(rows))
    stress = np.einsum("cik,cj->ijk", forces[:, :2], branches).reshape(4, -1) / volume
    return w[:, :2], w[:, 2:], AXES @ stress[:, :2], AXES @ stress[:, 2:]


def every_segment(Q, M):
    """Sets of sliding contacts that solve some direction: set, lines of `w` and `z`, ends of arc.

    None where a set is singular: it may have a continuum of solutions.
    """
    m, found = len(Q), []
    for first in range(0, 2**m, CHUNK):
        numbers = np.arange(first, min(first + CHUNK, 2**m))
        sets = (numbers[:, None] >> np.arange(m) & 1).astype(bool)
        matrices = np.where(sets[:, None, :], M, -np.eye(m))
        if np.linalg.cond(matrices).max() > 1.0 / SINGULAR:
            return None
        lines = np.linalg.solve(matrices, np.broadcast_to(-Q, (len(sets), m, 2)))
        # The ends of an arc are zeros of a line at which no other is negative.
        ends = np.stack([-lines[..., 1], lines[..., 0]], axis=-1)
        ends /= np.linalg.norm(ends, axis=-1, keepdims=True)
        ends = np.concatenate([ends, -ends], axis=1)
        values = np.einsum("skd,sed->ske", lines, ends)
        values[:, np.arange(2 * m) % m, np.arange(2 * m)] = 0.0
        inside = values.min(axis=1) >= -1e-12 * np.abs(values).max(axis=1)
        for k in np.flatnonzero(inside.sum(axis=1) >= 2):
            angles = np.arctan2(ends[k, inside[k], 1], ends[k, inside[k], 0])
            found.append((sets[k], lines[k], angles))
    return found


def branch_numbers(segments):
    """Number of the branch of each segment: those that join differ in one contact."""
    pairs = [
        (a, b)
        for a, (one, _, ends) in enumerate(segments)
        for b, (other, _, others) in enumerate(segments)
        if np.count_nonzero(one ^ other) == 1
        and np.abs(np.exp(1j * ends[:, None]) - np.exp(1j * others)).min() < SAME_ANGLE
    ]
    rows, columns = np.array(pairs, dtype=int).reshape(-1, 2).T
    size = len(segments)
    links = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(size, size))
    return connected_components(links)[1]


def compared(graph, law, control):
    """What a probe says against all solutions: counts by name; None if uncountable."""
    rows = at_yield(graph, law)
    dense = dense_problem(graph, law, rows)
    segments = every_segment(*dense[:2]) if dense else None
    if segments is None:
        return None
    A, S = dense[2:]
    branch, found = (
        branch_numbers(segments),
        probe(Scene(graph, law), DIRECTIONS, control=control, yield_band=AT_YIELD),
    )
    listed, counts, known, missed = found.solutions, Counter(), set(), []
    for k, direction in enumerate(found.directions):
        true = []
        for number, (slides, lines, _) in enumerate(segments):
            tangent = A + S @ np.where(slides[:, None], lines, 0.0)
            H = direction if control == "strain" else np.linalg.solve(tangent, direction)
            values = lines @ H
            if values.min() >= -SIGN * np.abs(values).max():
                true.append((branch[number], np.concatenate([H, tangent @ H])))
        diagonal = np.concatenate(
            [
                rate[listed.direction == k][:, [0, 1], [0, 1]]
                for rate in (listed.strain_rate, listed.stress_rate)
            ],
            axis=1,
        )
        status, told = str(found.status[k]), [False] * len(true)
        if found.proof[k] == "two-contact grains stick":
            # Says that it assumes what the enumeration does not.
            counts["said two-contact grains stick"] += 1
            counts["false"] += len(true) > 0
            continue
        for one in diagonal:
            near = [np.abs(one - rate).max() < SAME_RATE * np.abs(rate).max() for _, rate in true]
            counts["invented"] += not any(near)
            told = [a or b for a, b in zip(told, near, strict=True)]
        known |= {number for (number, _), is_told in zip(true, told, strict=True) if is_told}
        missed += [number for (number, _), is_told in zip(true, told, strict=True) if not is_told]
        false = {
            "unique": len(true) != 1,
            "one found": len(true) < 1,
            "several": len(true) < 2,
            "none": len(true) > 0,
        }
        counts["false"] += false.get(status, False)
        counts["directions"] += 1
        counts["solutions"] += len(true)
        counts["found"] += sum(told)
        counts[f"said {status}"] += 1
        counts[f"truly {min(len(true), 2)}, {status}"] += 1
    counts["missed"] = len(missed)
    counts["missed on a known branch"] = sum(number in known for number in missed)
    return counts


def packings(most=13):
    """Packings of 8 to 24 grains with 3 to `most` contacts at yield, soft and stiff."""
    for seed in count(0):
        grains, share = (8, 12, 16, 20, 24)[seed % 5], (0.15, 0.3, 0.5)[seed // 5 % 3]
        law = LinearFrictional(1.0, (0.1, 0.5)[seed // 15 % 2], 0.5)
        with suppress(InputError):
            graph = packing(grains, seed, sliding=share, law=law)
            if seed % 2:
                graph, law = small(8 if grains < 16 else 12, seed, share, 0.03, law.kt)
            else:
                size = (1.0, 3.0, 10.0)[seed // 2 % 3]
                forces = size * graph.normal_force, size * graph.shear_force
                graph = graph.replace(normal_force=forces[0], shear_force=forces[1])
            if 3 <= len(at_yield(graph, law)) <= most:
                yield seed, graph, law
