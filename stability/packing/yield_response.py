"""Contacts of a packing at yield, and the packing's linear response for given regimes of them.

Contact c at yield has `w_c = s (T'_sliding - T')`, the rate at which it leaves the friction limit,
and `z_c`, the reduction of its shear force by slip, `s T' = s T'_sticking - z_c`; both are not
negative and one is zero.
From the relative motion `r` they are `w_c - z_c = g_c . r`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Flags, Floats, Integers
from loops.assembly import contact_regime, contact_tangent
from loops.errors import InputError
from loops.graph import GrainGraph, contact_state
from loops.laws.frictional import edge_of
from loops.laws.protocol import ContactLaw, Regime, require_law
from loops.packing import (
    Factor,
    PackingSystem,
    PlaneContacts,
    UpdatedFactors,
    balancing_forces,
    factorised,
    in_freedoms,
    packing_stress_rate,
    packing_system,
    relative_motion,
    stiffness_matrix,
)

# H' = e_i (x) e_j for the four components in the order 11, 12, 21, 22.
UNIT_STRAINS: Floats = np.moveaxis(np.eye(4).reshape(4, 2, 2), 0, -1)

# Shear force over strength from which a contact is at yield and not only near: rounding.
AT_YIELD = 1.0 - 1e-6


@dataclass(frozen=True, eq=False)
class YieldResponse:
    """Contacts at yield, the candidates for sliding; in `system` they stick.

    `rows` (m,) are their rows among the system's contacts, `gauge` (m, 4) the vectors `g`,
    `push` (m, 4) the contact forces of a unit of `s T'`, `sliding` (m, 4, 4) their blocks when
    they slide. `of_two` (m,) marks candidates on a grain with two contacts. Both carry the same
    force, so their ratio `T/N` is one of the geometry and hardly changes: those that the yield band
    alone would make candidates, `settled` in number, are inside the cone and stick.
    """

    system: PackingSystem
    rows: Integers
    gauge: Floats
    push: Floats
    sliding: Floats
    of_two: Flags
    settled: int


@dataclass(frozen=True, eq=False)
class LinearAnswer:
    """Response of the packing to unit `H'` with given regimes, `(..., 4)` in 11, 12, 21, 22.

    `loads` (size, 4) are the forces of the affine motion, `unbalanced` what no motion
    balances.
    """

    factor: Factor
    loads: Floats
    unbalanced: Floats
    motion: Floats
    relative: Floats
    forces: Floats
    stress: Floats


def yield_response(
    graph: GrainGraph,
    law: ContactLaw,
    *,
    yield_band: float,
    regime: ArrayLike | None = None,
    planes: PlaneContacts | None = None,
    held: ArrayLike | None = None,
    volume: float | None = None,
) -> YieldResponse:
    """Find the contacts within the yield band, and those that `regime` marks as sliding."""
    require_law(law)
    checked_band(yield_band)
    state = contact_state(graph)
    given = contact_regime(state, law, regime)
    regimes = np.where(given == Regime.ELASTIC, law.regime(state), given).astype(np.int8)
    near = edge_of(law, state, regimes == Regime.ELASTIC, yield_band).at_yield
    regimes = np.where(near, Regime.SLIDING, regimes).astype(np.int8)
    # Without a shear force there is no side to slide to: frictionless contacts always slide.
    at_yield = (state.shear_force != 0) & (regimes == Regime.SLIDING)
    base = np.where(at_yield, Regime.ELASTIC, regimes).astype(np.int8)
    system = packing_system(graph, law, regime=base, planes=planes, held=held, volume=volume)
    of_two = _of_two_contact_grains(system)
    elastic_or_flagged = regimes != Regime.OPEN
    full = edge_of(law, state, elastic_or_flagged, max(yield_band, AT_YIELD)).at_yield
    settled = at_yield & of_two & ~full
    rows = np.flatnonzero((at_yield & ~settled)[system.contacts])
    c = system.contacts[rows]
    sign = np.sign(state.shear_force[c])
    scale = np.array([1.0, 1.0, 1.0 / system.length, 1.0 / system.length])
    elastic = law.local_stiffness(state, base)[c, 1]
    slides = law.local_stiffness(state, regimes)[c, 1]
    g, b_i, b_j = (factor[c] for factor in law.shear_kinematics(state))
    zero = np.zeros((len(c), 2))
    normal = np.hstack([state.n[c], zero])
    shear = np.column_stack([g[:, None] * state.t[c], -b_i, -b_j])
    gauge = (elastic - slides)[:, :1] * normal + (elastic - slides)[:, 1:] * shear
    push = np.column_stack([state.t[c], -state.arm_i[c], -state.arm_j[c]])
    sliding = contact_tangent(state, law, regimes)[c]
    return YieldResponse(
        system,
        rows,
        sign[:, None] * gauge * scale,
        sign[:, None] * push * scale,
        scale[:, None] * sliding * scale,
        of_two[c],
        int(np.count_nonzero(settled[system.contacts])),
    )


def checked_band(yield_band: float) -> float:
    """Check the share of its strength from which a contact may slide."""
    if not 0.0 < yield_band <= 1.0:
        remedy = "Leave it out: 0.99 is what was compared with simulations."
        raise InputError("yield_band", f"{yield_band:g}", "a share in (0, 1]", remedy)
    return float(yield_band)


def stiffness_of(yielding: YieldResponse, active: Flags) -> Floats:
    """(E, 4, 4) blocks with the active candidates sliding."""
    blocks = yielding.system.stiffness.copy()
    blocks[yielding.rows[active]] = yielding.sliding[active]
    return blocks


def linear_answer(
    yielding: YieldResponse, active: Flags, factor: Factor | None = None
) -> LinearAnswer:
    """Solve for the four unit strains with the active candidates sliding."""
    system, blocks = yielding.system, stiffness_of(yielding, active)
    factor = factor or factorised(system, blocks)
    affine = relative_motion(system, np.zeros((system.size, 4)), UNIT_STRAINS)
    loads = balancing_forces(system, blocks @ affine)
    motion = factor.solve(loads)
    relative = relative_motion(system, motion, UNIT_STRAINS)
    forces = -blocks @ relative
    stress = packing_stress_rate(system, forces).reshape(4, 4)
    return LinearAnswer(
        factor, loads, loads - factor.matrix @ motion, motion, relative, forces, stress
    )


def slip_motion(
    yielding: YieldResponse, answer: LinearAnswer, chosen: Integers
) -> tuple[Floats, Floats]:
    """(size, k) motion per unit of slip `z` of each chosen candidate.

    Also (k,) the share of each load that no motion balances, above rounding with a mechanism.
    """
    loads = -in_freedoms(yielding.system, yielding.rows[chosen], yielding.push[chosen]).T.toarray()
    motion = answer.factor.solve(loads)
    left = np.linalg.norm(loads - answer.factor.matrix @ motion, axis=0)
    return motion, left / np.linalg.norm(loads, axis=0)


def updated_factor(
    yielding: YieldResponse, elastic: LinearAnswer, active: Flags, slips: Floats, matrix: Floats
) -> Factor:
    """Factors with the active candidates sliding, as an update of those with all sticking."""
    gauge = in_freedoms(yielding.system, yielding.rows[active], yielding.gauge[active])
    small = np.linalg.inv(matrix[np.ix_(active, active)])
    lu = UpdatedFactors(elastic.factor.lu, -slips[:, active], small @ gauge)
    return Factor(stiffness_matrix(yielding.system, stiffness_of(yielding, active)), lu)


def condensed(
    yielding: YieldResponse, active: Flags, answer: LinearAnswer, chosen: Integers, motion: Floats
) -> tuple[Floats, Floats]:
    """(k, k) matrix and (4, k) stress of the chosen candidates' complementary variables.

    The variable of a sticking candidate is its `z`, that of a sliding one its `w`; either reduces
    `s T'`. The matrix gives the other one of each pair.
    """
    system, rows = yielding.system, yielding.rows[chosen]
    side = np.where(active[chosen], -1.0, 1.0)[:, None]
    matrix = np.eye(len(chosen)) + side * (
        in_freedoms(system, rows, yielding.gauge[chosen]) @ motion
    )
    blocks = stiffness_of(yielding, active)
    lines = np.einsum("eij,ek->ejik", blocks[:, :2], system.branches)
    stress = balancing_forces(system, lines.reshape(len(blocks), 4, 4)).T @ motion
    own = np.einsum("ki,kj->ijk", yielding.push[chosen, :2], system.branches[rows]).reshape(4, -1)
    return matrix, (stress - own) / system.volume


def complementary_rates(yielding: YieldResponse, active: Flags, relative: Floats) -> Floats:
    """(m,) or (m, k): `w` of sticking and `z` of sliding candidates under motions `r`."""
    side = np.where(active, -1.0, 1.0).reshape(-1, *[1] * (relative.ndim - 2))
    return side * np.einsum("ci,ci...->c...", yielding.gauge, relative[yielding.rows])


def forces_of_motion(yielding: YieldResponse, branch_rate: Floats, spin: Floats) -> Floats:
    """(C, 2) force rates under given branch rates and spins, which decide on the regimes."""
    system = yielding.system
    kept = system.contacts
    turns = spin[system.graph.contacts[kept]] * system.length
    relative = np.zeros((len(system.branches), 4))
    relative[: len(kept)] = np.concatenate([branch_rate[kept], turns], axis=1)
    active = complementary_rates(yielding, np.zeros(len(yielding.rows), dtype=bool), relative) < 0
    out = np.zeros_like(branch_rate)
    forces = -np.einsum("eij,ej->ei", stiffness_of(yielding, active), relative)
    out[kept] = forces[: len(kept), :2]
    return out


def _of_two_contact_grains(system: PackingSystem) -> Flags:
    graph = system.graph
    degree = np.bincount(graph.contacts[system.contacts].ravel(), minlength=graph.grain_count)
    if system.planes is not None:
        degree += np.bincount(system.planes.grain, minlength=graph.grain_count)
    return np.asarray((degree[graph.contacts] == 2).any(axis=1))
