"""The traction tangent of a ring by its saddle system, where the force method loses digits."""

from __future__ import annotations

import math

import numpy as np

from loops.arrays import Flags, Floats, Integers
from loops.compiled.kernel import kernel
from loops.compiled.ring_tangents import block_and_sizes
from loops.null_space import NULL_TOLERANCE, ROUNDING


@kernel
def ring_saddles(
    rows: Floats, offsets: Integers, contacts: Integers, forward: Flags, loops: Integers
) -> tuple[Floats, Floats, Floats]:
    """Traction tangents (L, 4, 4), condition and residual (L,) as `relax_centres` has them.

    Spins blocked; arguments as in `ring_tangents`. The condition is infinite where the system has
    no inverse.
    """
    count, largest = len(loops), 0
    for loop in loops:
        largest = max(largest, offsets[loop + 1] - offsets[loop])
    traction = np.full((count, 4, 4), np.nan)
    condition, residual = np.full(count, np.inf), np.full(count, np.inf)
    size = 2 * largest + 4
    rooms = np.empty((3, size * size))
    solution, rest = np.empty((size, 4)), np.empty((size, 4))
    k, sizes = np.empty((2, 2)), np.empty((2, 2))
    pivots = np.empty(size, dtype=np.int64)
    for loop in range(count):
        begin, end = offsets[loops[loop]], offsets[loops[loop] + 1]
        size = 2 * (end - begin) + 4
        # Contiguous whatever the order of the loop.
        system = rooms[0, : size * size].reshape((size, size))
        terms = rooms[1, : size * size].reshape((size, size))
        inverse = rooms[2, : size * size].reshape((size, size))
        volume, growth, stiffness = _assemble(
            rows, contacts, forward, begin, end, system, terms, k, sizes
        )
        _with_border(system, inverse)
        norm = _frobenius(inverse)
        if not (math.isfinite(norm) and _invert(inverse, pivots)):
            continue
        # What the singular values see as null is left to them.
        if not norm * _frobenius(inverse) * NULL_TOLERANCE < 1.0:
            continue
        residual[loop] = _solve(system, inverse, solution, rest)
        stress = solution[size - 4 : size]
        least = _frobenius(stress)
        if least > 0.0:
            bound = _bound(terms, inverse, solution, rest)
            condition[loop] = max(1.0, bound / (ROUNDING * least)) + growth
            traction[loop] = stress * (stiffness / volume)
    return traction, condition, residual


@kernel
def _assemble(
    rows: Floats,
    contacts: Integers,
    forward: Flags,
    begin: int,
    end: int,
    system: Floats,
    terms: Floats,
    k: Floats,
    sizes: Floats,
) -> tuple[float, float, float]:
    """Scaled system `[K, B; B^T, 0]` of a loop and the sizes of its terms.

    Returns its area, `area_growth` and the stiffness that it is scaled by.
    """
    n = end - begin
    system[:], terms[:] = 0.0, 0.0
    x, y, double, products = 0.0, 0.0, 0.0, 0.0
    for c in range(n):
        row = rows[contacts[begin + c]]
        sign = 1.0 if forward[begin + c] else -1.0
        next_x, next_y = x + sign * row[0], y + sign * row[1]
        double += x * next_y - y * next_x
        products += abs(x * next_y) + abs(y * next_x)
        x, y = next_x, next_y
        block_and_sizes(row, k, sizes)
        i, j = 2 * c, 2 * ((c + 1) % n)
        for a in range(2):
            for b in range(2):
                for p, q, side in ((i, i, 1.0), (j, j, 1.0), (i, j, -1.0), (j, i, -1.0)):
                    system[p + a, q + b] += side * k[a, b]
                    terms[p + a, q + b] += sizes[a, b]
    volume = 0.5 * double
    largest = 0.0
    for i in range(2 * n):
        for j in range(2 * n):
            largest = max(largest, abs(system[i, j]))
    for i in range(2 * n):
        for j in range(2 * n):
            system[i, j] /= largest if largest > 0.0 else 1.0
            terms[i, j] /= largest if largest > 0.0 else 1.0
    _load(rows, contacts, forward, begin, end, math.sqrt(volume), system)
    for i in range(2 * n):
        for j in range(2 * n, 2 * n + 4):
            terms[i, j], terms[j, i] = abs(system[i, j]), abs(system[j, i])
    return volume, products / double, largest * volume


@kernel
def _bound(terms: Floats, inverse: Floats, solution: Floats, rest: Floats) -> float:
    """Frobenius bound on the error of the stress, see `solve_through_null_space`."""
    size, square = len(terms), 0.0
    doubt = np.empty((size, 4))
    for i in range(size):
        for q in range(4):
            doubt[i, q] = ROUNDING if i == size - 4 + q else 0.0
            doubt[i, q] += abs(rest[i, q])
        for j in range(size):
            for q in range(4):
                doubt[i, q] += ROUNDING * terms[i, j] * abs(solution[j, q])
    for p in range(4):
        for q in range(4):
            error = 0.0
            for i in range(size):
                error += abs(inverse[size - 4 + p, i]) * doubt[i, q]
            square += error * error
    return math.sqrt(square)


@kernel
def _load(
    rows: Floats,
    contacts: Integers,
    forward: Flags,
    begin: int,
    end: int,
    length: float,
    system: Floats,
) -> None:
    """Boundary vectors: half the outward normals of the two edges at each corner."""
    n = end - begin
    for c in range(n):
        row = rows[contacts[begin + c]]
        half = (0.5 if forward[begin + c] else -0.5) / length
        normal = (half * row[1], -half * row[0])
        for corner in (c, (c + 1) % n):
            for a in range(2):
                for b in range(2):
                    system[2 * corner + a, 2 * n + 2 * a + b] += normal[b]
                    system[2 * n + 2 * a + b, 2 * corner + a] += normal[b]


@kernel
def _with_border(system: Floats, out: Floats) -> None:
    """Add `Z Z^T`, Z the two rigid translations: the system then has an inverse."""
    out[:] = system
    n = (len(system) - 4) // 2
    for i in range(n):
        for j in range(n):
            out[2 * i, 2 * j] += 1.0 / n
            out[2 * i + 1, 2 * j + 1] += 1.0 / n


@kernel
def _invert(a: Floats, pivots: Integers) -> bool:
    """Inverse in place by elimination with pivots; False if there is none."""
    size = len(a)
    for column in range(size):
        pivot = column
        for i in range(column + 1, size):
            if abs(a[i, column]) > abs(a[pivot, column]):
                pivot = i
        if not abs(a[pivot, column]) > 0.0:
            return False
        pivots[column] = pivot
        if pivot != column:
            for j in range(size):
                a[column, j], a[pivot, j] = a[pivot, j], a[column, j]
        inverse = 1.0 / a[column, column]
        a[column, column] = 1.0
        for j in range(size):
            a[column, j] *= inverse
        row = a[column]
        for i in range(size):
            factor = a[i, column]
            if i != column and factor != 0.0:
                other = a[i]
                other[column] = 0.0
                for j in range(size):
                    other[j] -= factor * row[j]
    for column in range(size - 1, -1, -1):
        pivot = pivots[column]
        if pivot != column:
            for i in range(size):
                a[i, column], a[i, pivot] = a[i, pivot], a[i, column]
    return True


@kernel
def _frobenius(a: Floats) -> float:
    square = 0.0
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            square += a[i, j] * a[i, j]
    return math.sqrt(square)


@kernel
def _solve(system: Floats, inverse: Floats, solution: Floats, rest: Floats) -> float:
    """Solve for four unit strains, refine once; relative residual."""
    size = len(system)
    solution[:] = 0.0
    _rest(system, solution, rest)
    for _ in range(2):
        for i in range(size):
            for j in range(size):
                for column in range(4):
                    solution[i, column] += inverse[i, j] * rest[j, column]
        _rest(system, solution, rest)
    square = 0.0
    for i in range(size):
        for column in range(4):
            square += rest[i, column] * rest[i, column]
    return 0.5 * math.sqrt(square)


@kernel
def _rest(system: Floats, solution: Floats, rest: Floats) -> None:
    """Right-hand sides, minus one in the last four rows, less what the solution gives."""
    size = len(system)
    for i in range(size):
        for column in range(4):
            rest[i, column] = -1.0 if i == size - 4 + column else 0.0
        for j in range(size):
            for column in range(4):
                rest[i, column] -= system[i, j] * solution[j, column]
