"""Arrays of pairs of doubles, 32 digits, and the solution of linear systems in them."""

import numpy as np

SPLITTER = 2.0**27 + 1.0


class Pair:
    """`hi + lo`, |lo| at most half a unit of hi; operations after Dekker and Knuth."""

    def __init__(self, hi, lo=None):
        self.hi = np.asarray(hi, dtype=float)
        self.lo = np.zeros_like(self.hi) if lo is None else lo

    def __getitem__(self, at):
        return Pair(self.hi[at], self.lo[at])

    def __setitem__(self, at, value):
        value = pair(value)
        self.hi[at], self.lo[at] = value.hi, value.lo

    def __neg__(self):
        return Pair(-self.hi, -self.lo)

    def __add__(self, other):
        other = pair(other)
        s, e = two_sum(self.hi, other.hi)
        t, f = two_sum(self.lo, other.lo)
        s, e = fast_two_sum(s, e + t)
        return Pair(*fast_two_sum(s, e + f))

    def __sub__(self, other):
        return self + (-pair(other))

    def __mul__(self, other):
        other = pair(other)
        p, e = two_product(self.hi, other.hi)
        return Pair(*fast_two_sum(p, e + (self.hi * other.lo + self.lo * other.hi)))

    def __truediv__(self, other):
        other = pair(other)
        first = Pair(self.hi / other.hi)
        second = Pair((self - first * other).hi / other.hi)
        third = (self - first * other - second * other).hi / other.hi
        return first + second + third

    __radd__, __rmul__ = __add__, __mul__

    def __rsub__(self, other):
        return pair(other) - self

    def sqrt(self):
        root = Pair(np.sqrt(self.hi))
        root = root + (self - root * root) / (root * 2.0)
        return root + (self - root * root) / (root * 2.0)


def pair(value):
    return value if isinstance(value, Pair) else Pair(value)


def zeros(shape):
    return Pair(np.zeros(shape))


def two_sum(a, b):
    s = a + b
    c = s - a
    return s, (a - (s - c)) + (b - c)


def fast_two_sum(a, b):
    s = a + b
    return s, b - (s - a)


def two_product(a, b):
    p = a * b
    a1, b1 = SPLITTER * a, SPLITTER * b
    ah, bh = a1 - (a1 - a), b1 - (b1 - b)
    al, bl = a - ah, b - bh
    return p, ((ah * bh - p) + ah * bl + al * bh) + al * bl


def solve(matrix, rhs):
    """Systems (B, N, N) with (B, N, R) by elimination with row pivots, rows and columns scaled."""
    count, size = matrix.hi.shape[:2]
    columns = 2.0 ** -np.round(np.log2(np.abs(matrix.hi).max(axis=1)))
    matrix = matrix * columns[:, None, :]
    rows = 2.0 ** -np.round(np.log2(np.abs(matrix.hi).max(axis=2)))
    work = zeros((count, size, size + rhs.hi.shape[2]))
    work[:, :, :size] = matrix * rows[:, :, None]
    work[:, :, size:] = rhs * rows[:, :, None]
    each = np.arange(count)
    for k in range(size):
        pivot = k + np.abs(work.hi[:, k:, k]).argmax(axis=1)
        for part in (work.hi, work.lo):
            upper = part[:, k].copy()
            part[:, k] = part[each, pivot]
            part[each, pivot] = upper
        work[:, k, k:] = work[:, k, k:] / work[:, k, k][:, None]
        below = work[:, k + 1 :, k]
        work[:, k + 1 :, k:] = work[:, k + 1 :, k:] - below[:, :, None] * work[:, k, k:][:, None, :]
    for k in range(size - 1, 0, -1):
        above = work[:, :k, k]
        work[:, :k, size:] = work[:, :k, size:] - above[:, :, None] * work[:, k, size:][:, None, :]
    return work[:, :, size:] * columns[:, :, None]
