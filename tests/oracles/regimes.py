"""Solutions of a small packing's rate problem by trying every combination of regimes, densely."""

from itertools import product

import numpy as np
from scipy.optimize import linprog

from loops import Regime, assemble_tangent, branch_vectors, contact_state, contact_tangent

# Singular values below this share of the largest are zero; so are wrong signs, over the largest.
ZERO, SIGN = 1e-10, 1e-8


def solutions(graph, law, H, at_yield):
    """Distinct slips `z` (k, m) of the solutions; `graph` has carrying contacts alone.

    `at_yield` (m,) are numbers of contacts. Each combination of sticking and sliding is solved
    through its null vectors; it counts if the loads are carried and every sign agrees with it.
    """
    state, (i, j), count = contact_state(graph), graph.contacts.T, graph.grain_count
    affine = -branch_vectors(graph) @ H.T

    def rates(v):
        u, w = v[: 2 * count].reshape(count, 2, -1), v[2 * count :]
        d = u[j] - u[i]
        un = np.einsum("ci,cik->ck", state.n, d)
        turn = np.einsum("ci,cik->ck", state.t, d)
        return un, turn - state.arm_i[:, None] * w[i] - state.arm_j[:, None] * w[j]

    s = np.sign(state.shear_force)[at_yield, None]
    un0, ut0 = (np.sum(axis * affine, axis=1) for axis in (state.n, state.t))
    found = []
    for slides in product((False, True), repeat=len(at_yield)):
        side = np.where(slides, -1.0, 1.0)[:, None]
        regime = np.full(graph.contact_count, Regime.ELASTIC, dtype=np.int8)
        regime[at_yield[list(slides)]] = Regime.SLIDING
        K = assemble_tangent(graph, law, regime=regime, spins=True)
        load = _affine_load(graph, law, regime, affine)
        U, sizes, V = np.linalg.svd(K)
        rank = int(np.count_nonzero(sizes > ZERO * sizes[0]))
        v = V[:rank].T @ ((U[:, :rank].T @ -load) / sizes[:rank])
        if np.linalg.norm(K @ v + load) > SIGN * max(np.linalg.norm(load), 1e-12):
            continue
        (un, ut), (dun, dut) = rates(v[:, None]), rates(V[rank:].T)
        un, ut = un + un0[:, None], ut + ut0[:, None]
        kn, kt, mu = law.kn, law.kt, law.mu
        own = side * (-mu * kn * un[at_yield] + s * kt * ut[at_yield])
        free = side * (-mu * kn * dun[at_yield] + s * kt * dut[at_yield])
        scale = SIGN * max(np.abs(un).max(), np.abs(ut).max())
        if np.abs(free).max(initial=0.0) > 1e-7:
            # Null vectors that move contacts at yield: any amount of them may be added.
            ask = linprog(-free.sum(axis=0), A_ub=-free, b_ub=own[:, 0] + scale, bounds=(-1e3, 1e3))
            if ask.status == 0:
                found.append(np.where(slides, own[:, 0] + free @ ask.x, 0.0))
        elif (own >= -scale).all():
            found.append(np.where(slides, own[:, 0], 0.0))
    distinct = []
    for z in found:
        if all(np.linalg.norm(z - one) > 1e-5 * max(np.linalg.norm(z), 1e-9) for one in distinct):
            distinct.append(z)
    return np.array(distinct).reshape(len(distinct), len(at_yield))


def _affine_load(graph, law, regime, affine):
    S = contact_tangent(contact_state(graph), law, regime)
    force = -np.einsum("cij,cj->ci", S[:, :, :2], affine)
    load = np.zeros((graph.grain_count, 3))
    i, j = graph.contacts.T
    np.add.at(load[:, :2], i, force[:, :2])
    np.add.at(load[:, :2], j, -force[:, :2])
    np.add.at(load[:, 2], i, -force[:, 2])
    np.add.at(load[:, 2], j, -force[:, 3])
    return np.concatenate([load[:, :2].ravel(), load[:, 2]])
