"""Event functions of a path: smooth numbers that change sign where something happens."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from loops.arrays import Flags, Floats, Integers
from loops.laws.protocol import Regime
from stability.paths.look import Look
from stability.paths.model import PathModel, pair_keys
from stability.paths.state import Mode
from stability.programmes import QUANTITIES, Stage
from stability.subspaces import subspace_basis

# A function has changed its sign once it is beyond zero by this much: rounding stays below.
ROUNDING = {
    "yield": 1e-13,
    "unloading": 1e-12,
    "opening": 1e-14,
    "closing": 1e-14,
    "opposite_contact": 1e-14,
    "det_Ks_zero": 1e-12,
    "det_K_zero": 1e-12,
    "flutter": 1e-12,
    "collapse": 0.0,
    "control_limit": 1e-12,
    "stage_end": 0.0,
}
SPECTRAL = ("det_Ks_zero", "det_K_zero")
# Pairs of grains are watched where their gap is below this fraction of r_i + r_j.
NEAR = 0.1
# An eigenvalue of K whose imaginary part is below this fraction of |K| is real.
REAL = 1e-7


@dataclass(frozen=True, eq=False)
class Monitors:
    """Event functions of one piece, regimes fixed: `functions` of a state give their values.

    `kinds`: Kind of event, one per value; `items` (M,): Contact, pair or eigenvalue that it belongs
    to, four eigenvalues a subspace; -1 for none.
    """

    kinds: list[str]
    items: Integers
    functions: Sequence[Callable[[Look], Sequence[float] | Floats]]

    @cached_property
    def two_sided(self) -> Flags:
        """(M,) whether a change of sign either way is the event; else it is negative until then."""
        return np.isin(self.kinds, SPECTRAL)

    @cached_property
    def tolerance(self) -> Floats:
        """(M,) what a value may be beyond zero by rounding."""
        return np.array([ROUNDING[kind] for kind in self.kinds])

    def values(self, seen: Look) -> Floats:
        """(M,) dimensionless values in a state, the pairs' left out."""
        return np.concatenate([function(seen) for function in self.functions])

    def with_pairs(self, count: int) -> Monitors:
        """These functions, then the gaps of so many pairs of grains."""
        kinds = [*self.kinds, *["opposite_contact"] * count]
        return Monitors(kinds, np.concatenate([self.items, np.arange(count)]), self.functions)


def monitors_of(
    model: PathModel, mode: Mode, stage: Stage, start: float, sense: float, size: float,
    subspaces: tuple[str, ...],
) -> Monitors:  # fmt: skip
    """Event functions that a piece with these regimes watches; strains are of that `size`."""
    law, force, unit = model.law, model.stiffness * model.length, model.touching * size
    elastic = np.flatnonzero((mode.regime == Regime.ELASTIC) & model.has_cone)
    sliding = np.flatnonzero((mode.regime == Regime.SLIDING) & model.has_cone)
    closed = np.flatnonzero(mode.regime != Regime.OPEN)
    is_open = np.flatnonzero(mode.regime == Regime.OPEN)
    parameter_unit, none = _parameter_unit(model, stage), [-1]

    def beyond_strength(seen: Look) -> Floats:
        beyond = np.abs(seen.contacts.shear_force) - law.strength(seen.contacts)
        return np.asarray(beyond[elastic] / (force * size))

    watched: list[tuple[Sequence[str], Any, Callable[[Look], Any]]] = [
        (["yield"], elastic, beyond_strength),
        (["unloading"], sliding, lambda seen: -seen.slip[sliding] / force),
        (["opening"], closed, lambda seen: (law.gap(seen.contacts) / unit)[closed]),
        (["closing"], is_open, lambda seen: (seen.contacts.overlap / unit)[is_open]),
        *(
            (SPECTRAL, 4 * k + np.arange(len(subspace_basis(one))), partial(_spectra, subspace=one))
            for k, one in enumerate(subspaces)
        ),
        (["collapse"], none, lambda seen: [-_area_ratio(seen.H)]),
        (["control_limit"], none, lambda seen: [-seen.rates.parameter / parameter_unit]),
        (["stage_end"], none, lambda seen: [sense * _left(stage, seen, start)]),
    ]
    return Monitors(
        kinds=[kind for kinds, items, _ in watched for kind in kinds for _ in items],
        items=np.concatenate([items for kinds, items, _ in watched for _ in kinds]).astype(int),
        functions=[function for *_, function in watched],
    )


def _left(stage: Stage, seen: Look, start: float) -> float:
    """The quantity that ends a stage, less its target."""
    if stage.quantity == "parameter":
        return seen.state.parameter - start - stage.target
    return float(np.concatenate([seen.H, seen.P])[QUANTITIES.index(stage.quantity)]) - stage.target


def eigenvalue_kind(A: Floats, subspace: str, item: int) -> str:
    """What the zero of the real part of an eigenvalue of K is: 'det_K_zero' or 'flutter'."""
    basis = subspace_basis(subspace)
    K = basis @ A @ basis.T
    if not np.isfinite(K).all():
        # In a singular state itself the operator is not known, and neither is its spectrum.
        return "det_K_zero"
    values = np.sort(np.linalg.eigvals(K).astype(complex))
    real = abs(values[item].imag) <= REAL * np.linalg.norm(K)
    return "det_K_zero" if real else "flutter"


def _parameter_unit(model: PathModel, stage: Stage) -> float:
    """Size of the loading parameter per unit of strain."""
    programme = stage.programme
    driven = np.abs(programme.rate).argmax()
    strain = np.abs(programme.equations(np.zeros(4))[1][driven]).max()
    weight = max(np.abs(programme.stress[driven]).max() * model.stiffness, strain)
    return float(weight / np.abs(programme.rate[driven]))


def _area_ratio(H: Floats) -> float:
    """`det F`, zero where the loop collapses to a line."""
    return float((1.0 - H[0]) * (1.0 - H[3]) - H[1] * H[2])


def near_pairs(model: PathModel, places: list[Floats]) -> Integers:
    """(Q, 2) watched pairs of grains that are or come close in some of the places (G, 2)."""
    # Beside a singular state the interpolant may have left the numbers.
    if not model.watches_pairs or not np.isfinite(places).all():
        return np.zeros((0, 2), dtype=np.int64)
    reach = (1.0 + NEAR) * 2.0 * float(model.radii.max())
    found = [cKDTree(x).query_pairs(reach, output_type="ndarray") for x in places]
    pairs = np.unique(np.concatenate(found), axis=0)
    gaps = np.max([pair_overlaps(model, pairs, x) for x in places], axis=0, initial=-np.inf)
    met = np.isin(pair_keys(model, pairs), model.met)
    return np.asarray(pairs[(gaps > -NEAR) & ~met], dtype=np.int64)


def pair_overlaps(model: PathModel, pairs: Integers, x: Floats) -> Floats:
    """(Q,) overlaps of pairs of grains over `r_i + r_j`."""
    i, j = pairs.T
    d = x[j] - x[i]
    touching = model.radii[i] + model.radii[j]
    return np.asarray((touching - np.hypot(d[:, 0], d[:, 1])) / touching)


def _spectra(seen: Look, subspace: str) -> Floats:
    """Eigenvalues of Ks, then real parts of those of K, ascending, over the norm of K."""
    basis = subspace_basis(subspace)
    K = basis @ seen.A @ basis.T
    norm = np.linalg.norm(K)
    if not np.isfinite(norm) or norm == 0.0:
        return np.full(2 * len(basis), np.nan)
    symmetric = np.linalg.eigvalsh(0.5 * (K + K.T))
    return np.asarray(np.concatenate([symmetric, np.sort(np.linalg.eigvals(K).real)]) / norm)
