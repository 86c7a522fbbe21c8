"""Controls of rates, contacts at yield, the candidates for sliding, and answers of regimes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Flags, Floats, Integers, Regimes, one_blas_thread
from loops.assembly import contact_kinematics, contact_tangent
from loops.contacts import AT_YIELD
from loops.errors import InputError, number
from loops.graph import ContactState
from loops.laws.frictional import ContactLaw, Regime, edge_of
from loops.scene import Scene
from loops.system import (
    System,
    in_freedoms,
    system_of,
)
from stability.factor import Factor
from stability.programmes import NOTHING
from stability.spectra import subspace_basis

# Share of its strength from which a contact may slide, as simulations of some 1e-5 of strain show.
YIELD_BAND = 0.99


# Entries of `M`, one less what the packing gives way, below this are rounding (rows: 9e-16).
ROUNDED = 1e-13


class MixedControl(NamedTuple):
    """`stress @ P' + strain @ H' = rate`, four rows of either or of both; 11, 12, 21, 22."""

    stress: Floats
    strain: Floats
    rate: Floats

    def matrix(self, tangent: Floats) -> Floats:
        """Return what the strain rate of a packing with this tangent (4, 4) is multiplied by."""
        return self.stress @ tangent + self.strain

    def require_regular(self, tangent: Floats) -> None:
        """Raise `InputError` where stress rates leave strain rates of this tangent (4, 4) open."""
        rows = self.matrix(tangent)
        rows = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-300)
        if np.linalg.cond(rows) > 1.0 / ROUNDED:
            received = "stress rates that do not determine the strain rates"
            raise InputError("P", received, "a sample that is stiff in all directions", "Give H.")

    def strains(self, tangent: Floats, offset: Floats = NOTHING) -> Floats:
        """Return strain rates (4,) at which the stress rate is `tangent @ H' + offset`."""
        right = self.rate - self.stress @ offset
        return np.asarray(np.linalg.solve(self.matrix(tangent), right))


class Edge(NamedTuple):
    """Contacts at yield in a linear packing: rates at which they leave the friction limit, or slip.

    Of them all under unit strains (m, 4) and unit slips (m, k); the stress rates (4, 4), (4, k) of
    these, and the motions under unit slips, in columns; `left` is the largest share of their loads
    that no motion balances. Then rates (m,) and stress rates (4,) of a load that is there besides.
    """

    of_strain: Floats
    of_slip: Floats
    stress: Floats
    stress_of_slip: Floats
    motion: Floats
    left: float = 0.0
    of_load: Floats | float = 0.0
    stress_of_load: Floats = NOTHING

    def problem(self, control: MixedControl) -> tuple[Floats, Floats]:
        """Return `q` and `M` of `w = q + M z`, strain that the stress drives eliminated."""
        still = control._replace(rate=np.zeros((4, 1)))
        driven = self.of_strain @ still.strains(self.stress, self.stress_of_slip)
        M = self.of_slip + driven
        M = np.where(np.abs(M) < ROUNDED * (1.0 + np.abs(driven)), 0.0, M)
        h = control.strains(self.stress, self.stress_of_load)
        return self.of_strain @ h + self.of_load, M


def component_control(strain: ArrayLike, stress: ArrayLike | None) -> MixedControl:
    """Return the control of components of `H'` where they are numbers, else of `P'`."""
    H = np.asarray(strain, dtype=float)
    P = np.zeros((2, 2)) if stress is None else np.asarray(stress, dtype=float)
    driven = np.isnan(H)
    if H.shape != (2, 2) or np.isinf(H).any():
        expected = "(2, 2) finite numbers, or nan for stress control"
        remedy = "Give a number for each component that is prescribed, nan for the others."
        raise InputError("strain_rate", f"{H.tolist()}", expected, remedy)
    if P.shape != (2, 2) or not np.isfinite(P[driven]).all():
        expected = "finite numbers of shape (2, 2) where the strain is nan"
        remedy = "Give zero to hold the stress."
        raise InputError("stress_rate", f"{P.tolist()}", expected, remedy)
    by_stress = np.diag(1.0 * driven.ravel())
    return MixedControl(by_stress, np.eye(4) - by_stress, np.where(driven, P, H).ravel())


def direction_control(direction: Floats, subspace: str, driven: str) -> MixedControl:
    """Return the control that drives strain or stress along a direction of a subspace.

    Strain outside of it is zero.
    """
    basis = subspace_basis(subspace)
    m = len(basis)
    # The rest of an orthonormal basis.
    rows = np.vstack([basis, np.linalg.svd(basis)[2][m:]])
    of_stress = np.diag((np.arange(4) < m) * float(driven == "stress"))
    rate = np.append(direction, np.zeros(4 - m))
    return MixedControl(of_stress @ rows, rows - of_stress @ rows, rate)


@dataclass(frozen=True, eq=False)
class YieldResponse:
    """Contacts at yield, the candidates for sliding; in `system` they stick.

    `rows` (m,) are their rows among the system's contacts, `gauge` (m, 4) the vectors `g`,
    `push` (m, 4) the contact forces of a unit of `s T'`, `sliding` (m, 4, 4) their blocks when
    they slide, `distance` (m,) what `|T|` lacks to the strength. `of_two` (m,) marks candidates
    on a grain with two contacts. Both carry the same force, so their ratio `T/N` is one of the
    geometry and hardly changes: those that the yield band alone would make candidates,
    `settled` in number, are inside the cone and stick.
    """

    system: System
    rows: Integers
    gauge: Floats
    push: Floats
    sliding: Floats
    distance: Floats
    of_two: Flags
    settled: int


@one_blas_thread()
def yield_response(scene: Scene, *, yield_band: float, by_forces: bool = False) -> YieldResponse:
    """Find the contacts within the yield band, and those whose known regime is sliding.

    With `by_forces` closed contacts have regimes by their forces, whatever is known of them.
    """
    number("yield_band", yield_band, 0.0, 1.0, open_low=True)
    rows = scene.rows
    regimes, may_slide, full, *parts = rows.each(partial(_near_yield, yield_band, by_forces))
    system = system_of(scene, np.where(may_slide, Regime.ELASTIC, regimes))
    kept = system.kept
    degree = np.bincount(rows.ends[kept].ravel(), minlength=int(rows.ends.max(initial=0)) + 1)
    two = (degree[rows.ends] == 2).any(axis=1)
    inside = may_slide & two & ~full
    found = np.flatnonzero((may_slide & ~inside)[kept])
    gauge, push, sliding, distance = (part[kept[found]] for part in parts)
    scale = np.array([1.0, 1.0, 1.0 / system.length, 1.0 / system.length])
    return YieldResponse(
        system,
        found,
        gauge * scale,
        push * scale,
        scale[:, None] * sliding * scale,
        distance,
        two[kept[found]],
        int(np.count_nonzero(inside[kept])),
    )


def _near_yield(
    band: float, by_forces: bool, law: ContactLaw, state: ContactState
) -> tuple[Regimes, Flags, Flags, Floats, Floats, Floats, Floats]:
    """Return regimes (E,), which contacts may slide, which are at their strength in full.

    They may from a share of their strength on, or where they are known to slide. The others are
    `gauge`, `push`, `sliding` and `distance` of `YieldResponse`, without its scale.
    """
    known = state.regime
    assert known is not None
    judged = known != Regime.OPEN if by_forces else known == Regime.ELASTIC
    given = np.where(judged, law.regime(state), known)
    near = edge_of(law, state, given == Regime.ELASTIC, band).at_yield
    regimes = np.where(near, Regime.SLIDING, given).astype(np.int8)
    strength, size = law.strength(state), np.abs(state.shear_force)
    # Without a shear force there is no side to slide to. Frictionless contacts always slide: the
    # shear that they carry is rounding.
    rough = (np.asarray(law.mu) > 0) | (strength > 0)
    may_slide = rough & (state.shear_force != 0) & (regimes == Regime.SLIDING)
    full = edge_of(law, state, regimes != Regime.OPEN, max(band, AT_YIELD)).at_yield
    sign, stuck = np.sign(state.shear_force)[:, None], np.full_like(regimes, Regime.ELASTIC)
    change = law.local_stiffness(state, stuck)[:, 1] - law.local_stiffness(state, regimes)[:, 1]
    distance = np.where(np.isfinite(strength), np.maximum(strength - size, 0.0), 0.0)
    return (
        regimes,
        may_slide,
        full,
        sign * np.einsum("ci,cij->cj", change, contact_kinematics(state, law)),
        sign * np.column_stack([state.t, -state.arm_i, -state.arm_j]),
        contact_tangent(state, law, regimes),
        distance,
    )


def stiffness_of(yielding: YieldResponse, active: Flags) -> Floats:
    """Return the blocks (E, 4, 4) with the active candidates sliding."""
    blocks = yielding.system.stiffness.copy()
    blocks[yielding.rows[active]] = yielding.sliding[active]
    return blocks


def condensed(yielding: YieldResponse, active: Flags, factor: Factor, chosen: Integers) -> Edge:
    """Return the chosen candidates at yield, with a factor in which the active ones slide.

    The variable of a sticking candidate is its `z`, that of a sliding one its `w`; either reduces
    `s T'`. What is given of each is the other one.
    """
    system, rows, push = yielding.system, yielding.rows[chosen], yielding.push[chosen]
    loads = -in_freedoms(system, rows, push).T.toarray()
    motion, sizes = factor.solve(loads), np.linalg.norm(loads, axis=0)
    left = np.linalg.norm(loads - factor.matrix @ motion, axis=0) / sizes
    side = np.where(active[chosen], -1.0, 1.0)[:, None]
    leaving = in_freedoms(system, rows, yielding.gauge[chosen]) @ motion
    own = np.einsum("ki,kj->ijk", push[:, :2], system.branches[rows]).reshape(4, -1)
    return Edge(
        complementary_rates(yielding, active, factor.relative)[chosen],
        np.eye(len(chosen)) + side * leaving,
        factor.tangent,
        factor.stress(motion) - own / system.volume,
        motion,
        float(left.max(initial=0.0)),
    )


def complementary_rates(yielding: YieldResponse, active: Flags, relative: Floats) -> Floats:
    """Return `w` of sticking and `z` of sliding candidates under motions `r`: (m,) or (m, k)."""
    side = np.where(active, -1.0, 1.0).reshape(-1, *[1] * (relative.ndim - 2))
    return side * np.einsum("ci,ci...->c...", yielding.gauge, relative[yielding.rows])


def forces_of_motion(yielding: YieldResponse, branch_rate: Floats, spin: Floats) -> Floats:
    """Return changes of force (C, 2) under those of branches and angles, which decide on slip."""
    system = yielding.system
    kept = system.contacts
    turns = spin[system.graph.contacts[kept]] * system.length
    relative = np.zeros((len(system.branches), 4))
    relative[: len(kept)] = np.concatenate([branch_rate[kept], turns], axis=1)
    rates = complementary_rates(yielding, np.zeros(len(yielding.rows), dtype=bool), relative)
    slip = np.maximum(-(yielding.distance + rates), 0.0)
    out = np.zeros_like(branch_rate)
    out[kept] = forces_with_slip(yielding, relative, slip)[: len(kept), :2]
    return out


def forces_with_slip(yielding: YieldResponse, relative: Floats, slip: Floats) -> Floats:
    """Return changes of forces `s` (E, 4) under motions `r` (E, 4) and slips (m,) of candidates."""
    forces = -np.einsum("eij,ej->ei", yielding.system.stiffness, relative)
    forces[yielding.rows] -= yielding.push * slip[:, None]
    return forces
