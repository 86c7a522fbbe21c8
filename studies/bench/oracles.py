"""Oracles of the bench: tangents of rings with 50 digits, long and freely rolling ones too."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from loops import LinearFrictional, contact_state
from loops.arrays import Floats
from loops.contact_tangent import contact_regime
from patterns.hard_cases import Scene
from studies.fifty_digits import (
    DIGITS,
    affine_tangent_50,
    area_50,
    assemble_50,
    contact_blocks_50,
    exact_points,
    frame_50,
    load_50,
    part_50,
    stress_50,
    traction_tangent_50,
)

# Rings up to this long are solved grain by grain; longer ones by their compliance.
SHORT = 12


def tangent_50(scene: Scene, closure: str) -> Any:
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


def _free(scene: Scene, regime: NDArray[np.int8], closure: str) -> Any:
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
        return _affine_free(full, reference, range(held, 3 * n))


def _add_rolling(
    full: Any, x: Any, i: int, j: int, n: int, T: Any, law: LinearFrictional, c: int
) -> None:
    """What `assemble_50` leaves of one elastic contact in `(forces, moments) = K (u, w)`."""
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


def _affine_free(full: Any, reference: Any, spins: range) -> Any:
    """Centres follow `u = -H x0`; stress by virtual work, `V P_ij = -sum F_i x0_j`."""
    import mpmath as mp

    centres = range(2 * len(reference))
    motion = mp.zeros(len(centres), 4)
    for row in centres:
        for b in range(2):
            motion[row, 2 * (row % 2) + b] = -reference[row // 2][b]
    relaxed = part_50(full, spins, spins) ** -1 * (part_50(full, spins, centres) * motion)
    forces = part_50(full, centres, centres) * motion - part_50(full, centres, spins) * relaxed
    return motion.T * forces / area_50(reference)
