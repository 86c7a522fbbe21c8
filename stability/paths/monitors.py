"""Event functions of a path: smooth numbers that change sign where something happens."""

from __future__ import annotations

from dataclasses import dataclass

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
# Pairs of grains are watched where their gap is below this fraction of r_i + r_j.
NEAR = 0.1
# An eigenvalue of K whose imaginary part is below this fraction of |K| is real.
REAL = 1e-7


@dataclass(frozen=True, eq=False)
class Monitors:
    """Event functions of one piece, regimes fixed.

    `kinds`: Kind of event, one per function; `items` (M,): Contact, pair or eigenvalue that it
    belongs to, four eigenvalues a subspace; -1 for none; `two_sided` (M,): Whether a change of sign
    either way is the event; otherwise the function is negative until the event.
    """

    kinds: list[str]
    items: Integers
    two_sided: Flags
    tolerance: Floats

    def with_pairs(self, count: int) -> Monitors:
        """These functions, then the gaps of so many pairs of grains."""
        two_sided = np.concatenate([self.two_sided, np.zeros(count, dtype=bool)])
        tolerance = np.concatenate([self.tolerance, np.full(count, ROUNDING["opposite_contact"])])
        kinds = [*self.kinds, *["opposite_contact"] * count]
        items = np.concatenate([self.items, np.arange(count)])
        return Monitors(kinds, items, two_sided, tolerance)


def monitors_of(model: PathModel, mode: Mode, subspaces: tuple[str, ...]) -> Monitors:
    """Event functions that a piece with these regimes watches."""
    elastic = np.flatnonzero((mode.regime == Regime.ELASTIC) & model.has_cone)
    sliding = np.flatnonzero((mode.regime == Regime.SLIDING) & model.has_cone)
    closed = np.flatnonzero(mode.regime != Regime.OPEN)
    is_open = np.flatnonzero(mode.regime == Regime.OPEN)
    eigenvalues = [4 * k + np.arange(len(subspace_basis(s))) for k, s in enumerate(subspaces)]
    groups = [
        ("yield", elastic, False),
        ("unloading", sliding, False),
        ("opening", closed, False),
        ("closing", is_open, False),
        *((kind, each, True) for each in eigenvalues for kind in ("det_Ks_zero", "det_K_zero")),
        ("collapse", np.array([-1]), False),
        ("control_limit", np.array([-1]), False),
        ("stage_end", np.array([-1]), False),
    ]
    kinds = [kind for kind, items, _ in groups for _ in items]
    return Monitors(
        kinds=kinds,
        items=np.concatenate([items for _, items, _ in groups]).astype(np.int64),
        two_sided=np.concatenate([np.full(len(items), two) for _, items, two in groups]),
        tolerance=np.array([ROUNDING[kind] for kind in kinds]),
    )


def monitor_values(
    model: PathModel,
    seen: Look,
    subspaces: tuple[str, ...],
    stage: Stage,
    start: float,
    sense: float,
    size: float,
) -> Floats:
    """Values of the event functions but the pairs', as in `monitors_of`, dimensionless."""
    contacts, mode = seen.contacts, seen.mode
    elastic = (mode.regime == Regime.ELASTIC) & model.has_cone
    sliding = (mode.regime == Regime.SLIDING) & model.has_cone
    closed = mode.regime != Regime.OPEN
    force = model.stiffness * model.length
    reach = force * size
    strength = np.where(elastic, model.law.strength(contacts), 0.0)
    beyond = (np.abs(contacts.shear_force) - strength) / reach
    unit = model.touching * size
    forward = -seen.rates.parameter / _parameter_unit(model, stage)
    target = sense * (stage_quantity(stage, seen, start) - stage.target)
    return np.concatenate(
        [
            beyond[elastic],
            -seen.slip[sliding] / force,
            (model.law.gap(contacts) / unit)[closed],
            (contacts.overlap / unit)[~closed],
            *(values for subspace in subspaces for values in _spectra(seen.A, subspace)),
            [-_area_ratio(seen.H), forward, target],
        ]
    )


def stage_quantity(stage: Stage, seen: Look, start: float) -> float:
    """Value of the quantity that ends a stage."""
    if stage.quantity == "parameter":
        return seen.state.parameter - start
    return float(np.concatenate([seen.H, seen.P])[QUANTITIES.index(stage.quantity)])


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


def _spectra(A: Floats, subspace: str) -> tuple[Floats, Floats]:
    """Eigenvalues of Ks and real parts of those of K, ascending, over the norm of K."""
    basis = subspace_basis(subspace)
    K = basis @ A @ basis.T
    norm = np.linalg.norm(K)
    if not np.isfinite(norm) or norm == 0.0:
        none = np.full(len(basis), np.nan)
        return none, none
    symmetric = np.linalg.eigvalsh(0.5 * (K + K.T)) / norm
    return symmetric, np.sort(np.linalg.eigvals(K).real) / norm
