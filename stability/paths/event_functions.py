"""Event functions of a path: smooth numbers that change sign at an event, and where they do so."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, TypeVar

import numpy as np
from scipy.optimize import brentq
from scipy.spatial import cKDTree

from loops.arrays import Flags, Floats, Integers
from loops.laws.protocol import Regime
from stability.paths.model import PathModel, pair_keys
from stability.paths.state import Mode
from stability.paths.state_rates import StateRates
from stability.programmes import Stage
from stability.spectra import subspace_basis

Anything = TypeVar("Anything")
# Points at which the polynomial through the samples looks for an excursion between them.
EXCURSION_POINTS = np.linspace(0.0, 1.0, 41)
# An event function has changed its sign once it is beyond zero by more than its rounding.
CROSSING_TOLERANCE = {
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
# Pairs of grains are watched whose gap is below this fraction of r_i + r_j.
WATCHED_GAP = 0.1
# An eigenvalue of K whose imaginary part is below this fraction of |K| is real.
REAL_RTOL = 1e-7


@dataclass(frozen=True, eq=False)
class EventFunctions:
    """Event functions of a segment, each giving the values of a state.

    `kinds`: Kind of event, one per value; `items` (M,): Contact, pair or eigenvalue that it belongs
    to, four eigenvalues a subspace; -1 for none.
    """

    kinds: list[str]
    items: Integers
    functions: Sequence[Callable[[StateRates], Sequence[float] | Floats]]

    @cached_property
    def two_sided(self) -> Flags:
        """(M,) whether a change of sign either way is the event; the others are negative before."""
        return np.isin(self.kinds, SPECTRAL)

    @cached_property
    def tolerance(self) -> Floats:
        """(M,) largest value beyond zero that may be rounding."""
        return np.array([CROSSING_TOLERANCE[kind] for kind in self.kinds])

    def values(self, here: StateRates) -> Floats:
        """(M,) dimensionless values in a state, the pairs' left out."""
        return np.concatenate([function(here) for function in self.functions])

    def with_pairs(self, count: int) -> EventFunctions:
        """These functions, then the overlaps of `count` pairs of grains."""
        kinds = [*self.kinds, *["opposite_contact"] * count]
        return EventFunctions(kinds, np.concatenate([self.items, np.arange(count)]), self.functions)


def event_functions(
    model: PathModel, mode: Mode, stage: Stage, start: float, sense: float, size: float,
    subspaces: tuple[str, ...],
) -> EventFunctions:  # fmt: skip
    """Event functions of a segment with these regimes.

    The stage began at the loading parameter `start` and its quantity grows by `sense`; strains are
    of that `size`.
    """
    law, force, unit = model.law, model.stiffness * model.length, model.touching * size
    elastic = np.flatnonzero((mode.regime == Regime.ELASTIC) & model.has_cone)
    sliding = np.flatnonzero((mode.regime == Regime.SLIDING) & model.has_cone)
    closed = np.flatnonzero(mode.regime != Regime.OPEN)
    is_open = np.flatnonzero(mode.regime == Regime.OPEN)
    programme, none = stage.programme, [-1]
    # Size of the loading parameter per unit of strain.
    driven = np.abs(programme.rate).argmax()
    strain = np.abs(programme.equations(np.zeros(4))[1][driven]).max()
    weight = max(np.abs(programme.stress[driven]).max() * model.stiffness, strain)
    parameter_unit = float(weight / np.abs(programme.rate[driven]))

    def beyond_strength(here: StateRates) -> Floats:
        beyond = np.abs(here.contacts.shear_force) - law.strength(here.contacts)
        return np.asarray(beyond[elastic] / (force * size))

    def beyond_target(here: StateRates) -> list[float]:
        value = stage.value(here.H, here.P, here.state.parameter - start)
        return [sense * (value - stage.target)]

    watched: list[tuple[Sequence[str], Any, Callable[[StateRates], Any]]] = [
        (["yield"], elastic, beyond_strength),
        (["unloading"], sliding, lambda here: -here.slip[sliding] / force),
        (["opening"], closed, lambda here: (law.gap(here.contacts) / unit)[closed]),
        (["closing"], is_open, lambda here: (here.contacts.overlap / unit)[is_open]),
        *(
            (SPECTRAL, 4 * k + np.arange(len(subspace_basis(one))), partial(_spectra, subspace=one))
            for k, one in enumerate(subspaces)
        ),
        (["collapse"], none, lambda here: [-area_ratio(here.H)]),
        (["control_limit"], none, lambda here: [-here.rates.parameter / parameter_unit]),
        (["stage_end"], none, beyond_target),
    ]
    return EventFunctions(
        kinds=[kind for kinds, items, _ in watched for kind in kinds for _ in items],
        items=np.concatenate([items for kinds, items, _ in watched for _ in kinds]).astype(int),
        functions=[function for *_, function in watched],
    )


def eigenvalue_kind(A: Floats, subspace: str, item: int) -> str:
    """Kind of event where the real part of an eigenvalue of K vanishes: det_K_zero or flutter."""
    basis = subspace_basis(subspace)
    K = basis @ A @ basis.T
    if not np.isfinite(K).all():
        # In a singular state itself the operator is not known, and neither is its spectrum.
        return "det_K_zero"
    values = np.sort(np.linalg.eigvals(K).astype(complex))
    real = abs(values[item].imag) <= REAL_RTOL * np.linalg.norm(K)
    return "det_K_zero" if real else "flutter"


def area_ratio(H: Floats) -> float:
    """`det F`, zero where the loop collapses to a line."""
    return float((1.0 - H[0]) * (1.0 - H[3]) - H[1] * H[2])


def pairs_in_reach(model: PathModel, places: list[Floats]) -> Integers:
    """(Q, 2) pairs of grains without a contact that are near in one of the places (G, 2)."""
    # Beside a singular state the interpolant may have left the numbers.
    if not model.watches_pairs or not np.isfinite(places).all():
        return np.zeros((0, 2), dtype=np.int64)
    reach = (1.0 + WATCHED_GAP) * 2.0 * float(model.radii.max())
    found = [cKDTree(x).query_pairs(reach, output_type="ndarray") for x in places]
    pairs = np.unique(np.concatenate(found), axis=0)
    gaps = np.max([pair_overlaps(model, pairs, x) for x in places], axis=0, initial=-np.inf)
    met = np.isin(pair_keys(model, pairs), model.met)
    return np.asarray(pairs[(gaps > -WATCHED_GAP) & ~met], dtype=np.int64)


def pair_overlaps(model: PathModel, pairs: Integers, x: Floats) -> Floats:
    """(Q,) overlaps of pairs of grains over `r_i + r_j`."""
    i, j = pairs.T
    d = x[j] - x[i]
    touching = model.radii[i] + model.radii[j]
    return np.asarray((touching - np.hypot(d[:, 0], d[:, 1])) / touching)


def _spectra(here: StateRates, subspace: str) -> Floats:
    """Eigenvalues of Ks, then real parts of those of K, ascending, over the norm of K."""
    basis = subspace_basis(subspace)
    K = basis @ here.A @ basis.T
    norm = np.linalg.norm(K)
    if not np.isfinite(norm) or norm == 0.0:
        return np.full(2 * len(basis), np.nan)
    symmetric = np.linalg.eigvalsh(0.5 * (K + K.T))
    return np.asarray(np.concatenate([symmetric, np.sort(np.linalg.eigvals(K).real)]) / norm)


def first_crossing(
    table: Floats, thetas: Floats, tolerance: Floats, values: Callable[[float], Floats]
) -> tuple[float, int] | None:
    """First place within a step where a function rises through zero, and which one.

    Excursions between the samples are looked for along the polynomial through them.
    """
    places, rows = _with_excursions(table, thetas, tolerance, values)
    for k in range(1, len(places)):
        crossed = np.flatnonzero(rows[k] > tolerance)
        if len(crossed):
            return _earliest(values, crossed, tolerance, places[k - 1 : k + 1], rows[k - 1 : k + 1])
    return None


def polish(
    at: Callable[[float], tuple[Floats, Anything, Floats]],
    which: int,
    theta: float,
    interpolated: Callable[[float], float],
) -> tuple[Floats, Anything, Floats]:
    """Correct a root of the interpolant by integrating to it: Newton with a fixed slope."""
    low, high = max(theta - 1e-4, 0.0), min(theta + 1e-4, 1.0)
    slope = (interpolated(high) - interpolated(low)) / (high - low)
    best = at(theta)
    for _ in range(3):
        error = float(best[2][which])
        if not slope > 0 or not abs(error) > 1e-16:
            break
        moved = min(max(theta - error / slope, 0.0), 1.0)
        trial = at(moved)
        if not abs(trial[2][which]) < abs(error):
            break
        theta, best = moved, trial
    return best


def _earliest(
    values: Callable[[float], Floats],
    crossed: Integers,
    tolerance: Floats,
    places: Floats,
    rows: Floats,
) -> tuple[float, int]:
    """Earliest root of the functions that cross within an interval, and which it is.

    The root of the likeliest function bounds the interval for those that cross before it.
    """
    a, b = float(places[0]), float(places[1])
    low, high = np.minimum(rows[0, crossed], 0.0), rows[1, crossed]
    while True:
        # A function that starts above zero, by rounding, has its root at the start.
        first = int(np.argmin(-low / (high - low)))
        which = int(crossed[first])
        if not low[first] < 0:
            return a, which
        b = _root(values, which, a, b)
        here = values(b)
        earlier = np.flatnonzero((here[crossed] > tolerance[crossed]) & (crossed != which))
        if len(earlier) == 0:
            return b, which
        crossed, low, high = crossed[earlier], low[earlier], here[crossed[earlier]]


def _root(values: Callable[[float], Floats], which: int, a: float, b: float) -> float:
    """Root of one function within an interval at whose start it is negative."""
    try:
        return float(brentq(lambda theta: values(theta)[which], a, b, xtol=1e-15, rtol=1e-14))
    except ValueError:
        # Next to a singular state the interpolant is rough: not a number somewhere, or not of the
        # signs that its samples have. Halve the interval towards where it stops being negative.
        while b - a > np.finfo(float).eps:
            middle = 0.5 * (a + b)
            a, b = (middle, b) if values(middle)[which] < 0 else (a, middle)
        return b


def _with_excursions(
    table: Floats, thetas: Floats, tolerance: Floats, values: Callable[[float], Floats]
) -> tuple[Floats, Floats]:
    """Samples, and places between them where a function is above zero."""
    quiet = np.flatnonzero((table <= tolerance).all(axis=0))
    if len(quiet) == 0:
        return thetas, table
    powers = np.linalg.solve(np.vander(thetas), table[:, quiet])
    peaks = np.vander(EXCURSION_POINTS, len(thetas)) @ powers
    above = np.flatnonzero((peaks > tolerance[quiet]).any(axis=0))
    places, rows = list(thetas), list(table)
    for column in above:
        theta = float(EXCURSION_POINTS[np.argmax(peaks[:, column])])
        row = values(theta)
        if row[quiet[column]] > tolerance[quiet[column]]:
            places.append(theta)
            rows.append(row)
    order = np.argsort(places, kind="stable")
    return np.asarray(places)[order], np.asarray(rows)[order]
