"""The traction tangent of a ring with spins blocked, with 50 digits.

By the primal system rather than the force method: unknown grain velocities and stress, with the
first grain held, so that nothing is shared with either method under test.
"""

import mpmath as mp
import numpy as np


def traction_tangent_50(x, x0, normal, shear, kn, kt, mu, regime):
    """(4, 4) list of mpmath numbers in the order (11, 12, 21, 22)."""
    with mp.workdps(50):
        n = len(x)
        x = [[mp.mpf(float(value)) for value in row] for row in x]
        x0 = [[mp.mpf(float(value)) for value in row] for row in x0]
        system = mp.zeros(2 * n + 4, 2 * n + 4)
        for c in range(n):
            i, j = c, (c + 1) % n
            k = _block(x[i], x[j], normal[c], shear[c], _at(kn, c), _at(kt, c), mu, regime[c])
            for a in range(2):
                for b in range(2):
                    system[2 * i + a, 2 * i + b] += k[a, b]
                    system[2 * j + a, 2 * j + b] += k[a, b]
                    system[2 * i + a, 2 * j + b] -= k[a, b]
                    system[2 * j + a, 2 * i + b] -= k[a, b]
        volume = sum(
            x0[c][0] * x0[(c + 1) % n][1] - x0[c][1] * x0[(c + 1) % n][0] for c in range(n)
        )
        volume /= 2
        for i in range(n):
            before, after = x0[i - 1], x0[(i + 1) % n]
            boundary = [(after[1] - before[1]) / 2, -(after[0] - before[0]) / 2]
            for a in range(2):
                for b in range(2):
                    system[2 * i + a, 2 * n + 2 * a + b] += boundary[b]
                    system[2 * n + 2 * a + b, 2 * i + a] += boundary[b]
        # Hold grain 0: its two rows follow from the others.
        kept = list(range(2, 2 * n + 4))
        small = mp.matrix(len(kept), len(kept))
        for p, row in enumerate(kept):
            for q, column in enumerate(kept):
                small[p, q] = system[row, column]
        out = mp.matrix(4, 4)
        for q in range(4):
            rhs = mp.zeros(len(kept), 1)
            rhs[2 * n - 2 + q] = -volume
            solution = mp.lu_solve(small, rhs)
            for p in range(4):
                out[p, q] = solution[2 * n - 2 + p]
        return out


def as_array(matrix):
    """Rounded to doubles."""
    return np.array([[float(matrix[i, j]) for j in range(4)] for i in range(4)])


def _at(value, c):
    return mp.mpf(float(value if np.ndim(value) == 0 else value[c]))


def _block(xi, xj, normal, shear, kn, kt, mu, regime):
    d = [xj[0] - xi[0], xj[1] - xi[1]]
    length = mp.sqrt(d[0] ** 2 + d[1] ** 2)
    n = mp.matrix([d[0] / length, d[1] / length])
    t = mp.matrix([-n[1], n[0]])
    normal, shear, mu = mp.mpf(float(normal)), mp.mpf(float(shear)), mp.mpf(float(mu))
    geometric = -normal / length * t * t.T + shear / length * n * t.T
    if regime == 1:
        return kn * n * n.T + kt * t * t.T + geometric
    return kn * n * n.T + mp.sign(shear) * mu * kn * t * n.T + geometric
