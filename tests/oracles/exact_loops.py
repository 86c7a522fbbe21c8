"""Tangents of plain loops under every closure and spin rule, with 32 digits (or mpmath's).

From the grains' balance with the first one held, in other unknowns and by other formulas than the
platform's. Spins that no contact feels (gear modes, chains between sliding contacts) are
Lagrange's: of all solutions that leave the moments on them standing, the one without them.
"""

from typing import NamedTuple

import numpy as np

from tests.oracles.double_double import Pair, pair, solve, zeros


class Loops(NamedTuple):
    """B loops of n grains; a loop with sliding contacts has the last one sliding.

    x, x0 (B, n, 2), radii, normal, shear, regime (B, n), kn, mu (B,), kt (B,) or (B, n), increment
    a word.
    """

    x: np.ndarray
    x0: np.ndarray
    radii: np.ndarray
    normal: np.ndarray
    shear: np.ndarray
    regime: np.ndarray
    kn: np.ndarray
    kt: np.ndarray
    mu: np.ndarray
    increment: str


def exact_tangent(loops, closure, spins, solver=solve):
    """(B, 4, 4) `Pair`."""
    count, n = loops.radii.shape
    following = np.roll(np.arange(n), -1)
    x0 = pair(loops.x0)
    d0 = [[x0[:, following[c], a] - x0[:, c, a] for a in (0, 1)] for c in range(n)]
    volume = area(x0)
    contacts = [Contact(loops, c, following[c]) for c in range(n)]
    boundary = [
        [(x0[:, following[i], 1] - x0[:, i - 1, 1]) * 0.5,
         (x0[:, i - 1, 0] - x0[:, following[i], 0]) * 0.5]
        for i in range(n)
    ]  # fmt: skip
    turn = None
    if spins == "affine":
        turn = loop_turn(loops, boundary, volume)
    if closure == "affine":
        return _affine(loops, contacts, d0, volume, spins, turn, solver)
    free = spins == "free"
    size = 2 * n + (2 * n if free else 0) + 4
    stress = size - 4
    system, rhs = zeros((count, size, size)), zeros((count, size, 4))
    for c, contact in enumerate(contacts):
        i, j = c, following[c]
        # Columns of u_i, u_j and spins: branch rates and forces per unit of each.
        moved = [(2 * g + a, _unit(a, s, count)) for g, s in ((i, -1.0), (j, 1.0)) for a in (0, 1)]
        spun = [(2 * n + i, (1, 0)), (2 * n + j, (0, 1))]
        rates = [(col, contact.rates(d, None)) for col, d in moved]
        if free:
            rates += [(col, contact.rates(None, w)) for col, w in spun]
        for col, (force, moment_i, moment_j) in rates:
            for a in (0, 1):
                _add(system, 2 * i + a, col, force[a])
                _add(system, 2 * j + a, col, -force[a])
            if free:
                _add(system, 2 * n + i, col, -moment_i)
                _add(system, 2 * n + j, col, -moment_j)
        if turn is not None:
            force, _, _ = contact.rates(None, (1, 1))
            for q in range(4):
                for a in (0, 1):
                    _add(rhs, 2 * i + a, q, -(force[a] * turn[q]))
                    _add(rhs, 2 * j + a, q, force[a] * turn[q])
    for i in range(n):
        for a in (0, 1):
            for b in (0, 1):
                _add(system, 2 * i + a, stress + 2 * a + b, boundary[i][b])
                _add(system, stress + 2 * a + b, 2 * i + a, boundary[i][b])
    for q in range(4):
        rhs[:, stress + q, q] = -volume
    if free:
        _border(loops, contacts, system, 2 * n, 3 * n)
    found = solver(system[:, 2:, 2:], rhs[:, 2:])
    return found[:, stress - 2 :]


def area(x0):
    n, total = x0.hi.shape[1], 0.0
    for i in range(n):
        p, q = x0[:, i] - x0[:, 0], x0[:, (i + 1) % n] - x0[:, 0]
        total = total + (p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]) * 0.5
    return total


def loop_turn(loops, boundary, volume):
    """Four `Pair`s: spin of the loop per component of H, `F = 1 + (1/V0) sum u (x) B`."""
    f = [[pair(np.full(len(loops.kn), float(a == b))) for b in (0, 1)] for a in (0, 1)]
    for i, b_i in enumerate(boundary):
        u = pair(loops.x[:, i]) - pair(loops.x0[:, i])
        for a in (0, 1):
            for b in (0, 1):
                f[a][b] = f[a][b] + u[:, a] * b_i[b] / volume
    det = (f[0][0] * f[1][1] - f[0][1] * f[1][0]) * 2.0
    return [-f[0][1] / det, f[0][0] / det, -f[1][1] / det, f[1][0] / det]


class Contact:
    """Law of one contact of every loop, between grains i and j."""

    def __init__(self, loops, i, j):
        d = [pair(loops.x[:, j, a]) - pair(loops.x[:, i, a]) for a in (0, 1)]
        self.length = (d[0] * d[0] + d[1] * d[1]).sqrt()
        self.n = [d[0] / self.length, d[1] / self.length]
        self.t = [-self.n[1], self.n[0]]
        r_i, r_j = pair(loops.radii[:, i]), pair(loops.radii[:, j])
        self.arms = [(self.length + r_i - r_j) * 0.5, (self.length + r_j - r_i) * 0.5]
        self.roll = [r_i, r_j] if loops.increment == "radii" else self.arms
        self.g = (self.roll[0] + self.roll[1]) / self.length
        self.normal, self.shear = pair(loops.normal[:, i]), pair(loops.shear[:, i])
        slides = loops.regime[:, i] == 2
        kt = loops.kt if loops.kt.ndim == 1 else loops.kt[:, i]
        self.kn, self.kt = pair(loops.kn), pair(np.where(slides, 0.0, kt))
        self.mu = pair(np.where(slides, np.sign(loops.shear[:, i]) * loops.mu, 0.0))

    def rates(self, d, w):
        """Force on j, moments on i and j, for a branch rate and spins (either may be None)."""
        zero = self.kn * 0.0
        un = zero if d is None else self.n[0] * d[0] + self.n[1] * d[1]
        across = zero if d is None else self.t[0] * d[0] + self.t[1] * d[1]
        ut = self.g * across
        if w is not None:
            ut = ut - self.roll[0] * float(w[0]) - self.roll[1] * float(w[1])
        normal = -(self.kn * un)
        shear = self.mu * normal - self.kt * ut
        # The frame turns with the branch: n' = t across/l.
        along = normal - self.shear * across / self.length
        over = shear + self.normal * across / self.length
        force = [along * self.n[a] + over * self.t[a] for a in (0, 1)]
        moments = [-(arm * shear + un * self.shear * 0.5) for arm in self.arms]
        return force, *moments


def _affine(loops, contacts, d0, volume, spins, turn, solver):
    count, n = loops.radii.shape
    out, load = zeros((count, 4, 4)), zeros((count, 2 * n, 4))
    system, seen = zeros((count, 2 * n, 2 * n)), zeros((count, 4, n))
    for c, contact in enumerate(contacts):
        i, j = c, (c + 1) % n
        zero = volume * 0.0
        for q in range(4):
            d = [zero, zero]
            d[q // 2] = -d0[c][q % 2]
            force, moment_i, moment_j = contact.rates(d, None)
            if turn is not None:
                spun, _, _ = contact.rates(None, (1, 1))
                force = [force[a] + spun[a] * turn[q] for a in (0, 1)]
            for p in range(4):
                _add(out, p, q, force[p // 2] * d0[c][p % 2])
            _add(load, i, q, moment_i)
            _add(load, j, q, moment_j)
        for grain, w in ((i, (1, 0)), (j, (0, 1))):
            force, moment_i, moment_j = contact.rates(None, w)
            _add(system, i, grain, -moment_i)
            _add(system, j, grain, -moment_j)
            for p in range(4):
                _add(seen, p, grain, force[p // 2] * d0[c][p % 2])
    if spins == "free":
        _border(loops, contacts, system, 0, n)
        spin = solver(system, load)
        for g in range(n):
            for p in range(4):
                for q in range(4):
                    _add(out, p, q, seen[:, p, g] * spin[:, g, q])
    return out / volume[:, None, None]


def _border(loops, contacts, system, spins, multipliers):
    """Rows and columns for the chains of spins that nothing resists; empty ones are held."""
    count, n = loops.radii.shape
    cut = loops.regime == 2
    whole = ~cut.any(axis=1)
    chain, value = np.zeros(count, dtype=int), pair(np.ones(count))
    for i in range(n):
        at = (np.arange(count), multipliers + chain, spins + i)
        weight = value * pair(loops.radii[:, i]) * pair(loops.radii[:, i])
        # A closed chain comes round with its own value only if shear goes by the radii.
        gear = ~whole | (loops.increment == "radii" and n % 2 == 0)
        weight = weight * gear.astype(float)
        for part, new in ((system.hi, weight.hi), (system.lo, weight.lo)):
            part[at] = new
            part[at[0], at[2], at[1]] = new
        arms = contacts[i].roll
        value = -(value * arms[0] / arms[1])
        value = Pair(np.where(cut[:, i], 1.0, value.hi), np.where(cut[:, i], 0.0, value.lo))
        chain = chain + cut[:, i]
    for m in range(multipliers, multipliers + n):
        empty = (system.hi[:, m] == 0).all(axis=1)
        system.hi[empty, m, m] = 1.0


def _unit(a, sign, count):
    d = [pair(np.zeros(count)), pair(np.zeros(count))]
    d[a] = pair(np.full(count, sign))
    return d


def _add(matrix, row, column, value):
    matrix[:, row, column] = matrix[:, row, column] + value


def positive_definite(tangent):
    """(B,) whether Ks is positive definite in the symmetric subspace, by its minors."""
    basis = [((0, 1.0),), ((3, 1.0),), ((1, 1.0), (2, 1.0))]
    k = [
        [sum((tangent[:, p, q] for p, _ in left for q, _ in right), pair(0.0)) for right in basis]
        for left in basis
    ]
    s = [[(k[p][q] + k[q][p]) * 0.5 for q in range(3)] for p in range(3)]
    two = s[0][0] * s[1][1] - s[0][1] * s[0][1]
    three = (
        s[2][2] * two
        - s[1][2] * (s[0][0] * s[1][2] - s[0][1] * s[0][2])
        + s[0][2] * (s[0][1] * s[1][2] - s[1][1] * s[0][2])
    )
    return (s[0][0].hi > 0) & (two.hi > 0) & (three.hi > 0)


def mp_solve(matrix, rhs, digits=60):
    """The same systems by mpmath; the sums of pairs are exact."""
    import mpmath as mp

    out = zeros(rhs.hi.shape)
    with mp.workdps(digits):
        for b in range(len(out.hi)):
            size, columns = rhs.hi.shape[1:]
            m = mp.matrix(size, size)
            for i in range(size):
                for j in range(size):
                    m[i, j] = mp.mpf(matrix.hi[b, i, j]) + mp.mpf(matrix.lo[b, i, j])
            for q in range(columns):
                r = mp.matrix(
                    [mp.mpf(rhs.hi[b, i, q]) + mp.mpf(rhs.lo[b, i, q]) for i in range(size)]
                )
                x = mp.lu_solve(m, r)
                for i in range(size):
                    out.hi[b, i, q] = float(x[i])
                    out.lo[b, i, q] = float(x[i] - mp.mpf(out.hi[b, i, q]))
    return out
