"""Operators of loops in their packing with 90 digits, straight from the rates of the forces."""

from decimal import Decimal, localcontext

import numpy as np

from loops import Regime, loop_batches

DIGITS = 90
# The limit that a loop's operator is defined by: a resistance of all freedoms that goes to zero.
EPS = Decimal(10) ** -35

exactly = np.vectorize(Decimal, otypes=[object])


def contact_rates(d, forces, law, radii, regime):
    """(4, 4) minus the rates of force and moments per motion `(d', w_i, w_j)` of one contact."""
    kn, kt, mu, increment = law
    N, T = forces
    length = (d[0] * d[0] + d[1] * d[1]).sqrt()
    n, t = [d[0] / length, d[1] / length], [-d[1] / length, d[0] / length]
    arms = [(length + radii[0] - radii[1]) / 2, (length + radii[1] - radii[0]) / 2]
    lever, turns = (sum(radii) / length, radii) if increment == "radii" else (Decimal(1), arms)
    out = []
    for column in range(4):
        motion = [Decimal(int(column == k)) for k in range(4)]
        stretch = n[0] * motion[0] + n[1] * motion[1]
        across = t[0] * motion[0] + t[1] * motion[1]
        more_N = -kn * stretch
        if regime == Regime.SLIDING:
            more_T = (T.compare(Decimal(0))) * mu * more_N
        else:
            more_T = -kt * (lever * across - turns[0] * motion[2] - turns[1] * motion[3])
        # n turns with the branch by across / length, and t with it.
        turn = across / length
        rate = [more_N * n[k] + more_T * t[k] + (N * t[k] - T * n[k]) * turn for k in range(2)]
        rate += [-(arm * more_T + stretch / 2 * T) for arm in arms]
        out.append([-value for value in rate])
    return np.array(out, dtype=object).T


def stiffness(graph, law, regime):
    """(3 G, 3 G) tangent in the order x, y, spin of each grain."""
    G = graph.grain_count
    x, radii, cell = exactly(graph.x), exactly(graph.radii), exactly(graph.cell)
    parameters = [
        exactly(np.broadcast_to(np.asarray(p, float), regime.shape))
        for p in (law.kn, law.kt, law.mu)
    ]
    N, T = exactly(graph.normal_force), exactly(graph.shear_force)
    K = np.full((3 * G, 3 * G), Decimal(0), dtype=object)
    for c, (i, j) in enumerate(graph.contacts.tolist()):
        if regime[c] == Regime.OPEN:
            continue
        image = [Decimal(int(k)) for k in graph.images[c]]
        d = [x[j, k] - x[i, k] + cell[k, 0] * image[0] + cell[k, 1] * image[1] for k in range(2)]
        own = (*(p[c] for p in parameters), law.shear_increment)
        S = contact_rates(d, (N[c], T[c]), own, (radii[i], radii[j]), regime[c])
        # Motion d' = u_j - u_i; the resultants on the grains that the contact asks for.
        at = [3 * i, 3 * i + 1, 3 * j, 3 * j + 1, 3 * i + 2, 3 * j + 2]
        relative = np.array(
            [[-1, 0, 1, 0, 0, 0], [0, -1, 0, 1, 0, 0], [0, 0, 0, 0, 1, 0], [0, 0, 0, 0, 0, 1]]
        )
        element = relative.T.astype(object).dot(S).dot(relative.astype(object))
        for a, row in enumerate(at):
            for b, column in enumerate(at):
                K[row, column] += element[a, b]
    return K


def solved(matrix, rhs):
    """Gaussian elimination with pivoting by rows, in decimals."""
    size, a = len(matrix), np.concatenate([matrix, rhs], axis=1)
    for k in range(size):
        pivot = k + int(np.argmax(np.abs(a[k:, k])))
        a[[k, pivot]] = a[[pivot, k]]
        a[k + 1 :, k + 1 :] -= np.outer(a[k + 1 :, k] / a[k, k], a[k, k + 1 :])
    x = a[:, size:].copy()
    for k in range(size - 1, -1, -1):
        x[k] = (x[k] - a[k, k + 1 : size].dot(x[k + 1 :])) / a[k, k]
    return x


def operators(graph, law, faces, regime):
    """(L, 4, 4) `A_in` of the loops of a periodic packing, rounded to doubles.

    Grains that carry nothing need open contacts; not a number where a compliance has no inverse.
    """
    G, out = graph.grain_count, {}
    with localcontext() as context:
        context.prec = DIGITS
        K = stiffness(graph, law, regime)
        unit, radius = Decimal(float(np.mean(law.kn))), Decimal(float(graph.radii.mean()))
        for k in range(3 * G):
            K[k, k] += EPS * unit * (radius * radius if k % 3 == 2 else 1)
        loads, areas, loops = [], [], []
        x, cell = exactly(graph.x), exactly(graph.cell)
        for batch in loop_batches(graph, faces):
            for face, grains, local in zip(batch.face, batch.grains, batch.graph.x, strict=True):
                # Corners from the exact positions, through the images that the batch went by.
                near = [
                    np.round(np.linalg.solve(graph.cell, p))
                    for p in local - local[0] - (graph.x[grains] - graph.x[grains[0]])
                ]
                corner = np.array(
                    [
                        [
                            x[g, k]
                            + cell[k, 0] * Decimal(int(m[0]))
                            + cell[k, 1] * Decimal(int(m[1]))
                            for k in range(2)
                        ]
                        for g, m in zip(grains, near, strict=True)
                    ],
                    dtype=object,
                )
                after, before = np.roll(corner, -1, axis=0), np.roll(corner, 1, axis=0)
                # B_i: half the outward normals of the two edges at corner i.
                side = after - before
                v = np.stack([side[:, 1], -side[:, 0]], axis=1) / Decimal(2)
                area = np.sum(corner[:, 0] * after[:, 1] - after[:, 0] * corner[:, 1]) / Decimal(2)
                B = np.full((3 * G, 4), Decimal(0), dtype=object)
                for g, vector in zip(grains, v, strict=True):
                    B[3 * g, :2] += vector
                    B[3 * g + 1, 2:] += vector
                loads.append(B), areas.append(area), loops.append(face)
        u = solved(K, np.concatenate(loads, axis=1))
        for k, (B, area, face) in enumerate(zip(loads, areas, loops, strict=True)):
            C = B.T.dot(u[:, 4 * k : 4 * k + 4]) / area
            try:
                A = solved(C, np.diag([Decimal(1)] * 4) + Decimal(0))
                out[face] = A.astype(float)
            except (ArithmeticError, ValueError):
                out[face] = np.full((4, 4), np.nan)
    return np.array([out[face] for face in faces.loops])
