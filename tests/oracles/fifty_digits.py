"""Tangents of rings with 50 digits, by mpmath."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from loops import LinearFrictional, contact_state
from loops.assembly import contact_regime
from tests.oracles.hard_cases import CaseState

Floats = np.ndarray

DIGITS = 50
# Rings up to this long are solved grain by grain; longer ones by their compliance.
SHORT = 12


def tangent_50(scene: CaseState, closure: str) -> Any:
    """Tangent of a ring under a closure with 50 digits, its doubles taken as exact."""
    graph, law = scene.graph, scene.law
    assert isinstance(law, LinearFrictional)
    regime = contact_regime(contact_state(graph), law, scene.regime)
    # Infinite friction never slides; its value does not enter.
    mu = np.where(np.isfinite(law.mu), law.mu, 0.0)
    state = (graph.x, graph.x0, graph.normal_force, graph.shear_force, law.kn, law.kt)
    short = graph.grain_count <= SHORT
    if scene.spins == "free":
        return _free(scene, regime, closure) if short else None
    if closure == "affine":
        return affine_tangent_50(*state, mu, regime)
    if short:
        return traction_tangent_50(*state, mu, regime)
    return compliance_tangent_50(*state, mu, regime)


def compliance_tangent_50(x: Floats, x0: Floats, *contacts: Any) -> Any:
    """Traction tangent of a ring by its one redundant force, 50 digits."""
    import mpmath as mp

    with mp.workdps(DIGITS):
        now, reference = exact_points(x), exact_points(x0)
        n = len(reference)
        total, double = mp.zeros(2, 2), mp.zeros(4, 4)
        single, moments = mp.zeros(2, 4), mp.zeros(4, 2)
        for c, k in enumerate(contact_blocks_50(now, *contacts)):
            a, b = reference[c], reference[(c + 1) % n]
            m = [(a[1] + b[1]) / 2, -(a[0] + b[0]) / 2]
            # Row (k, l): the stress loads the contact with P_kl m_l along k.
            lever = mp.matrix([[m[0], 0], [m[1], 0], [0, m[0]], [0, m[1]]])
            soft = k**-1
            total += soft
            single += soft * lever.T
            moments += lever * soft
            double += lever * soft * lever.T
        compliance = (double - moments * total**-1 * single) / area_50(reference)
        return compliance**-1


def _free(scene: CaseState, regime: NDArray[np.int8], closure: str) -> Any:
    """Relaxed spins, elastic contacts, equal radii; the gear mode of even ones is held."""
    import mpmath as mp

    graph, law = scene.graph, scene.law
    assert isinstance(law, LinearFrictional)
    with mp.workdps(DIGITS):
        now, reference = exact_points(graph.x), exact_points(graph.x0)
        n = len(now)
        forces = (graph.normal_force, graph.shear_force)
        full = mp.zeros(3 * n + 4, 3 * n + 4)
        for c, k in enumerate(contact_blocks_50(now, *forces, law.kn, law.kt, 0.0, regime)):
            i, j = c, (c + 1) % n
            assemble_50(full, k, i, j)
            _add_rolling(full, now, i, j, n, mp.mpf(float(graph.shear_force[c])), law, c)
        load_50(full, reference)
        held = 2 * n + 1 if n % 2 == 0 else 2 * n
        if closure == "traction":
            return stress_50(full, [*range(2, 2 * n), *range(held, 3 * n + 4)], reference)
        # Centres follow `u = -H x0`; stress by virtual work, `V P_ij = -sum F_i x0_j`.
        centres, spins = range(2 * n), range(held, 3 * n)
        motion = mp.zeros(2 * n, 4)
        for row in centres:
            for b in range(2):
                motion[row, 2 * (row % 2) + b] = -reference[row // 2][b]
        relaxed = part_50(full, spins, spins) ** -1 * (part_50(full, spins, centres) * motion)
        forces = part_50(full, centres, centres) * motion
        forces -= part_50(full, centres, spins) * relaxed
        return motion.T * forces / area_50(reference)


def _add_rolling(
    full: Any, x: Any, i: int, j: int, n: int, T: Any, law: LinearFrictional, c: int
) -> None:
    """Add the spins of one elastic contact to the system `(forces, moments) = K (u, w)`."""
    import mpmath as mp

    length, normal, tangent = frame_50(x[i], x[j])
    kt = mp.mpf(float(np.broadcast_to(law.kt, n)[c]))
    arm = length / 2
    for a in range(2):
        for grain in (i, j):
            full[2 * j + a, 2 * n + grain] -= kt * arm * tangent[a]
            full[2 * i + a, 2 * n + grain] += kt * arm * tangent[a]
            moment = T * normal[a] / 2 - arm * kt * tangent[a]
            full[2 * n + grain, 2 * j + a] += moment
            full[2 * n + grain, 2 * i + a] -= moment
    for grain in (i, j):
        for other in (i, j):
            full[2 * n + grain, 2 * n + other] += arm * arm * kt


def affine_tangent_50(x: Floats, x0: Floats, *contacts: Any) -> Any:
    """Affine tangent of a ring, `(1/V0) sum k_ik d0_j d0_l`, with 50 digits, as mpmath.matrix.

    Centres `x`, `x0` (n, 2) counter-clockwise; the arguments of `contact_blocks_50` for
    the contacts (c, c+1); order (11, 12, 21, 22).
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
    x: list[list[Any]],
    normal: Floats,
    shear: Floats,
    kn: Any,
    kt: Any,
    mu: Any,
    regime: Any,
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
