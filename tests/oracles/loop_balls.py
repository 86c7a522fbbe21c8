"""Tangents of rings in balls of 260 bits (python-flint), from the balance of the grains.

Unknowns are displacements of the centres and spins times radii: nothing is shared with the
package's equations. Every number that comes in is taken as exact.
"""

import mpmath as mp
import numpy as np
from flint import arb, arb_mat, ctx

from loops import Regime, contact_state

BITS = 260
# Of what is rounded for mpmath.
DIGITS = 50
# A product of ratios of arms that is one within so much is one: rings of equal grains, mirrored
# rings, arms by the radii.
ONE = 1e-60


def exact_tangent(graph, law, regime=None, closure="traction", spins="blocked"):
    """Tangent of a ring under a linear frictional law, rounded; its doubles are taken as exact."""
    return rounded(ring_rows(graph, law, regime, closure, spins))


def ring_rows(graph, law, regime, closure, spins):
    """Tangent of a ring under a linear frictional law as balls, rows of (4, 4)."""
    ctx.prec = BITS
    regime = law.regime(contact_state(graph)) if regime is None else regime
    parameters = (np.broadcast_to(p, graph.contact_count) for p in (law.kn, law.kt, law.mu))
    blocks = []
    for kn, kt, mu, T, own in zip(*parameters, graph.shear_force, regime, strict=True):
        normal, none = arb(float(kn)), arb(0)
        if own == Regime.SLIDING:
            blocks.append([[normal, none], [int(np.sign(T)) * arb(float(mu)) * normal, none]])
        else:
            blocks.append([[normal, none], [none, arb(float(kt))]])
    return tangent_rows(graph, blocks, law.shear_increment == "radii", closure, spins)


def rounded(rows):
    """Middles of balls as doubles."""
    return np.array([[float(value.mid()) for value in row] for row in rows])


def to_mpmath(rows):
    """Middles of balls in 50 digits."""
    with mp.workdps(DIGITS):
        return mp.matrix([[mp.mpf(v.mid().str(DIGITS + 5, radius=False)) for v in r] for r in rows])


def ball_tangent(graph, blocks, by_radii, closure, spins):
    """Tangent of one loop (4, 4) as doubles, and the largest radius of its balls."""
    rows = tangent_rows(graph, blocks, by_radii, closure, spins)
    return rounded(rows), max(float(value.rad()) for row in rows for value in row)


def tangent_rows(graph, blocks, by_radii, closure, spins):
    """Tangent of one loop as balls, rows of (4, 4).

    `blocks` (n, 2, 2) are the law's stiffnesses; `by_radii` whether spins shear by the radii.
    """
    ctx.prec = BITS
    n, free, traction = graph.grain_count, spins == "free", closure == "traction"
    x, x0, N, T = (balls(a) for a in (graph.x, graph.x0, graph.normal_force, graph.shear_force))
    radii, D = balls(graph.radii), balls(blocks)
    B = [[(x0[(i + 1) % n][1] - x0[i - 1][1]) / 2, (x0[i - 1][0] - x0[(i + 1) % n][0]) / 2]
         for i in range(n)]  # fmt: skip
    after = [x0[(i + 1) % n] for i in range(n)]
    area = sum((x0[i][0] * after[i][1] - x0[i][1] * after[i][0] for i in range(n)), arb(0)) / 2
    # Columns: P, centres but the first, spins; at last H.
    first_spin = 4 + 2 * (n - 1) if traction else 0
    unknowns = first_spin + n * free
    width, turn = unknowns + 4, spin_of_loop(x, x0, B, area)
    contacts = []
    for c in range(n):
        i, j = c, (c + 1) % n
        d, d0 = ([a[j][k] - a[i][k] for k in (0, 1)] for a in (x, x0))
        length = (d[0] ** 2 + d[1] ** 2).sqrt()
        normal = [d[0] / length, d[1] / length]
        tangent = [-normal[1], normal[0]]
        a_i, a_j = (length + radii[i] - radii[j]) / 2, (length + radii[j] - radii[i]) / 2
        b_i, b_j = (radii[i], radii[j]) if by_radii else (a_i, a_j)
        e = [[arb(0)] * width for _ in (0, 1)]
        for k in (0, 1):
            if traction and j > 0:
                e[k][4 + 2 * (j - 1) + k] += 1
            if traction and i > 0:
                e[k][4 + 2 * (i - 1) + k] -= 1
            for b in (0, 1):
                e[k][unknowns + 2 * k + b] -= 0 if traction else d0[b]
        z = [arb(0)] * width
        if free:
            z[first_spin + i] += b_i / radii[i]
            z[first_spin + j] += b_j / radii[j]
        elif spins == "affine":
            for k in range(4):
                z[unknowns + k] += (b_i + b_j) * turn[k]
        en = combine((normal[0], e[0]), (normal[1], e[1]))
        et = combine((tangent[0], e[0]), (tangent[1], e[1]))
        ut = combine(((b_i + b_j) / length, et), (-1, z))
        more_N = combine((-D[c][0][0], en), (-D[c][0][1], ut))
        more_T = combine((-D[c][1][0], en), (-D[c][1][1], ut))
        along = combine((1, more_N), (-T[c] / length, et))
        across = combine((1, more_T), (N[c] / length, et))
        force = [combine((normal[k], along), (tangent[k], across)) for k in (0, 1)]
        moments = [combine((-a / r, more_T), (-T[c] / (2 * r), en))
                   for a, r in ((a_i, radii[i]), (a_j, radii[j]))]  # fmt: skip
        felt = any(value != 0 for row in blocks[c] for value in row[1:])
        contacts.append((force, moments, d0, felt, (b_i / radii[i], b_j / radii[j])))
    rows = balance(contacts, B, area, n, unknowns, width) if traction else []
    if free:
        rows += moment_balance(contacts, n, first_spin, width)
    found = solution(rows, unknowns)
    if traction:
        return [[found[i, k] for k in range(4)] for i in range(4)]
    out = [[arb(0)] * 4 for _ in range(4)]
    for p in range(4):
        for k in range(4):
            for force, _, d0, *_ in contacts:
                out[p][k] += force[p // 2][unknowns + k] * d0[p % 2] / area
                for h in range(unknowns):
                    out[p][k] += force[p // 2][h] * found[h, k] * d0[p % 2] / area
    return out


def balance(contacts, B, area, n, unknowns, width):
    """Rows of the strain of the polygon and of the forces on the grains but the first."""
    rows = []
    for a in (0, 1):
        for b in (0, 1):
            row = [arb(0)] * width
            for i in range(1, n):
                row[4 + 2 * (i - 1) + a] = B[i][b]
            row[unknowns + 2 * a + b] = area
            rows.append(row)
    for i in range(1, n):
        for k in (0, 1):
            row = combine((1, contacts[i - 1][0][k]), (-1, contacts[i][0][k]))
            for b in (0, 1):
                row[2 * k + b] -= B[i][b]
            rows.append(row)
    return rows


def moment_balance(contacts, n, first_spin, width):
    """Rows of the moments; what no contact feels is held: the limit of a vanishing resistance."""
    still = []
    gaps = [c for c in range(n) if not contacts[c][3]]
    for at, gap in enumerate(gaps):
        stop, grain = gaps[(at + 1) % len(gaps)], (gap + 1) % n
        chain = [arb(0)] * n
        chain[grain] = arb(1)
        while grain != stop:
            b_i, b_j = contacts[grain][4]
            chain[(grain + 1) % n] = -chain[grain] * b_i / b_j
            grain = (grain + 1) % n
        still.append(chain)
    if not gaps:
        chain = [arb(1)]
        for c in range(n):
            b_i, b_j = contacts[c][4]
            chain.append(-chain[c] * b_i / b_j)
        if abs(float((chain[n] - 1).mid())) < ONE:
            still.append(chain[:n])
    rows = []
    for i in range(n):
        row = combine((1, contacts[i - 1][1][1]), (1, contacts[i][1][0]))
        for chain in still:
            square = sum((value**2 for value in chain), arb(0))
            for h in range(n):
                row[first_spin + h] += chain[i] * chain[h] / square
        rows.append(row)
    return rows


def spin_of_loop(x, x0, B, area):
    """Spin `(L21 - L12)/2` per component of H, `F = 1 + (1/V0) sum u (x) B`."""
    F = [[arb(int(a == b)) + sum(((x[i][a] - x0[i][a]) * B[i][b] for i in range(len(x))), arb(0))
          / area for b in (0, 1)] for a in (0, 1)]  # fmt: skip
    twice = 2 * (F[0][0] * F[1][1] - F[0][1] * F[1][0])
    return [-F[0][1] / twice, F[0][0] / twice, -F[1][1] / twice, F[1][0] / twice]


def solution(rows, unknowns):
    """Unknowns per component of H."""
    if not unknowns:
        return None
    matrix = arb_mat([row[:unknowns] for row in rows])
    return matrix.solve(arb_mat([[-value for value in row[unknowns:]] for row in rows]))


def combine(*parts):
    """Sum of multiples of rows."""
    columns = zip(*([factor * value for value in row] for factor, row in parts), strict=True)
    return [sum(column, arb(0)) for column in columns]


def balls(a):
    """Nested lists of an array's numbers as balls."""
    if np.ndim(a):
        return [balls(part) for part in a]
    return a if isinstance(a, arb) else arb(float(a))
