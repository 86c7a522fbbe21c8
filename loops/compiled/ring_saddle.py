"""The traction tangent of a ring by its saddle system, where the force method loses digits."""

from __future__ import annotations

import math

import numpy as np

from loops.arrays import Flags, Floats, Integers
from loops.compiled.kernel import kernel
from loops.compiled.ring_tangents import block_and_inverse


@kernel
def ring_saddles(
    rows: Floats, offsets: Integers, contacts: Integers, forward: Flags, loops: Integers
) -> tuple[Floats, Floats, Floats]:
    """Traction tangents as `saddle_solve` has them, spins blocked.

    Parameters
    ----------
    rows : (C, 8) array
        Contacts, see `ring_tangents`.
    offsets, contacts, forward : arrays
        As in `Faces`.
    loops : (L,) array of int
        Faces to take, each counter-clockwise.

    Returns
    -------
    traction : (L, 4, 4) array
        Tangents in the order (11, 12, 21, 22).
    condition : (L,) array
        As in `saddle_solve`; infinite where the system has no inverse.
    residual : (L,) array
        Relative residual.
    """
    count, largest = len(loops), 0
    for loop in loops:
        largest = max(largest, offsets[loop + 1] - offsets[loop])
    traction = np.full((count, 4, 4), np.nan)
    condition, residual = np.full(count, np.inf), np.full(count, np.inf)
    size = 2 * largest + 4
    room, inverse_room = np.empty(size * size), np.empty(size * size)
    solution, rest = np.empty((size, 4)), np.empty((size, 4))
    k, s = np.empty((2, 2)), np.empty((2, 2))
    pivots = np.empty(size, dtype=np.int64)
    for loop in range(count):
        begin, end = offsets[loops[loop]], offsets[loops[loop] + 1]
        size = 2 * (end - begin) + 4
        # Contiguous whatever the order of the loop.
        system = room[: size * size].reshape((size, size))
        inverse = inverse_room[: size * size].reshape((size, size))
        volume, stiffness = _assemble(rows, contacts, forward, begin, end, system, k, s)
        _with_border(system, inverse)
        norm = _frobenius(inverse)
        if not (math.isfinite(norm) and _invert(inverse, pivots)):
            continue
        norm *= _frobenius(inverse)
        if not math.isfinite(norm):
            continue
        residual[loop] = _solve(system, inverse, solution, rest)
        stress = solution[size - 4 : size]
        least = _frobenius(stress)
        if least > 0.0:
            condition[loop] = norm * max(1.0, 1.0 / least)
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
    k: Floats,
    s: Floats,
) -> tuple[float, float]:
    """Scaled system `[K, B; B^T, 0]` of a loop; its area and the stiffness that it is scaled by."""
    n = end - begin
    system[:] = 0.0
    x, y, double = 0.0, 0.0, 0.0
    for c in range(n):
        row = rows[contacts[begin + c]]
        sign = 1.0 if forward[begin + c] else -1.0
        double += x * (sign * row[1]) - y * (sign * row[0])
        x += sign * row[0]
        y += sign * row[1]
        block_and_inverse(row, k, s)
        i, j = 2 * c, 2 * ((c + 1) % n)
        for a in range(2):
            for b in range(2):
                system[i + a, i + b] += k[a, b]
                system[j + a, j + b] += k[a, b]
                system[i + a, j + b] -= k[a, b]
                system[j + a, i + b] -= k[a, b]
    volume = 0.5 * double
    largest = 0.0
    for i in range(2 * n):
        for j in range(2 * n):
            largest = max(largest, abs(system[i, j]))
    for i in range(2 * n):
        for j in range(2 * n):
            system[i, j] /= largest if largest > 0.0 else 1.0
    _load(rows, contacts, forward, begin, end, math.sqrt(volume), system)
    return volume, largest * volume


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
