"""A loop's tangent with 50 digits, for measuring the error of the fast methods.

The traction tangent is taken from the primal system, unknown grain velocities and stress with the
first grain held, so that it shares nothing with the force method. mpmath comes with the extra
`test`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from loops.arrays import Floats

DIGITS = 50


def affine_tangent_50(x: Floats, x0: Floats, *contacts: Any) -> Any:
    """Affine tangent of a ring, `(1/V0) sum k_ik d0_j d0_l`, with 50 digits, as mpmath.matrix.

    Centres `x`, `x0` (n, 2) counter-clockwise; of the contacts (c, c+1) what `contact_blocks_50`
    takes; order (11, 12, 21, 22).
    """
    import mpmath as mp

    with mp.workdps(DIGITS):
        now, reference = exact_points(x), exact_points(x0)
        out = mp.zeros(4, 4)
        volume, n = area_50(reference), len(reference)
        for c, k in enumerate(contact_blocks_50(now, *contacts)):
            d0 = [reference[(c + 1) % n][a] - reference[c][a] for a in range(2)]
            for p in range(4):
                for q in range(4):
                    out[p, q] += k[p // 2, q // 2] * d0[p % 2] * d0[q % 2] / volume
        return out


def traction_tangent_50(x: Floats, x0: Floats, *contacts: Any) -> Any:
    """Traction tangent of a ring with spins blocked, with 50 digits."""
    import mpmath as mp

    with mp.workdps(DIGITS):
        now, reference = exact_points(x), exact_points(x0)
        n = len(reference)
        system = mp.zeros(2 * n + 4, 2 * n + 4)
        for c, k in enumerate(contact_blocks_50(now, *contacts)):
            assemble_50(system, k, c, (c + 1) % n)
        load_50(system, reference)
        # Hold grain 0: its two rows follow from the others.
        return stress_50(system, range(2, 2 * n + 4), reference)


def stress_50(system: Any, kept: Iterable[int], reference: list[list[Any]]) -> Any:
    """Stress of unit displacement gradients: the last four of the unknowns that are kept."""
    kept = list(kept)
    inverse = part_50(system, kept, kept) ** -1
    return -area_50(reference) * inverse[len(kept) - 4 :, len(kept) - 4 :]


def part_50(matrix: Any, rows: Iterable[int], columns: Iterable[int]) -> Any:
    """Rows and columns of a matrix."""
    import mpmath as mp

    return mp.matrix([[matrix[row, column] for column in columns] for row in rows])


def as_array(matrix: Any) -> Floats:
    """Round a 50-digit matrix to doubles."""
    rows, columns = matrix.rows, matrix.cols
    return np.array([[float(matrix[i, j]) for j in range(columns)] for i in range(rows)])


def exact_points(points: Floats) -> list[list[Any]]:
    """Points (n, 2) as 50-digit numbers, taken as exact."""
    import mpmath as mp

    return [[mp.mpf(float(value)) for value in row] for row in points]


def area_50(x0: list[list[Any]]) -> Any:
    """Area of a polygon."""
    n = len(x0)
    pairs = [(x0[c], x0[(c + 1) % n]) for c in range(n)]
    return sum(a[0] * b[1] - a[1] * b[0] for a, b in pairs) / 2


def contact_blocks_50(
    x: list[list[Any]], normal: Floats, shear: Floats, kn: Any, kt: Any, mu: Any, regime: Any
) -> list[Any]:
    """Tangent blocks of a ring's contacts, `f' = -k d'`, 2 x 2 each.

    Numbers for each contact or one for all; regimes 1 (elastic) or 2 (sliding).
    """
    import mpmath as mp

    blocks = []
    for c in range(len(x)):
        N, T, own_kn, own_kt, own_mu = (
            mp.mpf(float(value if np.ndim(value) == 0 else value[c]))
            for value in (normal, shear, kn, kt, mu)
        )
        length, n, t = frame_50(x[c], x[(c + 1) % len(x)])
        across = own_kt * t * t.T if regime[c] == 1 else mp.sign(T) * own_mu * own_kn * t * n.T
        blocks.append(own_kn * n * n.T + across - N / length * t * t.T + T / length * n * t.T)
    return blocks


def frame_50(xi: list[Any], xj: list[Any]) -> tuple[Any, Any, Any]:
    """Length, normal and tangent of the branch from `xi` to `xj`."""
    import mpmath as mp

    d = mp.matrix([xj[0] - xi[0], xj[1] - xi[1]])
    length = mp.sqrt(d[0] ** 2 + d[1] ** 2)
    n = d / length
    return length, n, mp.matrix([-n[1], n[0]])


def assemble_50(system: Any, k: Any, i: int, j: int) -> None:
    """Add the block `f' = -k d'` of the contact of grains i and j to a ring's system."""
    for a in range(2):
        for b in range(2):
            system[2 * i + a, 2 * i + b] += k[a, b]
            system[2 * j + a, 2 * j + b] += k[a, b]
            system[2 * i + a, 2 * j + b] -= k[a, b]
            system[2 * j + a, 2 * i + b] -= k[a, b]


def load_50(system: Any, x0: list[list[Any]]) -> None:
    """Boundary vectors: forces `-P B_i`, and the displacement gradient of the polygon.

    They go into the last four rows and columns.
    """
    n, first = len(x0), system.rows - 4
    for i in range(n):
        before, after = x0[i - 1], x0[(i + 1) % n]
        boundary = [(after[1] - before[1]) / 2, -(after[0] - before[0]) / 2]
        for a in range(2):
            for b in range(2):
                system[2 * i + a, first + 2 * a + b] += boundary[b]
                system[first + 2 * a + b, 2 * i + a] += boundary[b]
