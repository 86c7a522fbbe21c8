"""The state that a path integrates, and the contacts as the law sees them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from loops import ContactLaw, InputError
from loops.arrays import Floats, Integers, Regimes
from loops.graph import ContactState
from loops.laws.frictional import Regime
from stability.path import WORK_TERMS
from stability.paths.model import (
    JUST_TOUCHING,
    START_MISMATCH,
    PathModel,
    compressed_state,
    pair_keys,
)
from stability.paths.ring_rates import WATCHED_GAP

# Isotropic strain at which a path starts where its law has no stiffness at first touch.
FIRST_STRAIN = 1e-8
# The same of even loops of unequal grains with free spins: there a gear mode has no stiffness yet,
# and stiffnesses next to it are known to rounding over the strain.
FIRST_STRAIN_OF_GEARS = 1e-6
# Absolute tolerance of such a path over that strain, by which its start is off. Loops with free
# spins are all but mechanisms there: rounding of their rates is beyond tighter ones.
FIRST_ATOL = 1e-4
NO_PAIRS: Integers = np.zeros((0, 2), dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Mode:
    """Regime of every contact and, where it slides, the side of the cone.

    `regime` (C,): `Regime`; `side` (C,): Sign of the shear force where sliding, +1 or -1.
    """

    regime: Regimes
    side: Floats


def initial_state(model: PathModel, contacts: ContactState) -> Floats:
    """Vector `y` of the initial graph, from the state of its contacts."""
    rest = np.zeros(1 + len(WORK_TERMS))
    return np.concatenate([model.first_place, contacts.shear_force, rest])


def first_state(model: PathModel, contacts: ContactState) -> tuple[PathModel, Floats, float]:
    """Vector `y` at the start, and the least absolute tolerance of a path from there.

    Where no contact has any stiffness yet, or unequal grains with free spins have yet to leave a
    gear mode, the state is lifted to a first overlap, and the scale of the stiffness follows it.
    """
    y = initial_state(model, contacts)
    elastic = np.full(model.contact_count, Regime.ELASTIC, dtype=np.int8)
    stiffness = model.law.local_stiffness(contacts, elastic)[:, 0, 0]
    even = model.grain_count % 2 == 0 and np.ptp(model.radii) > 0.0
    gears = (
        model.spins == "free"
        and even
        and not np.any(model.law.rolling_stiffness(contacts, elastic))
    )
    gears &= bool((contacts.overlap <= JUST_TOUCHING * contacts.touching_length).all())
    if not model.contact_count or ((stiffness > 0.0).any() and not gears):
        return model, y, 0.0
    first = FIRST_STRAIN_OF_GEARS if gears else FIRST_STRAIN
    if model.closure == "affine":
        y[:4] += first * (np.eye(2).ravel() - y[:4])
    else:
        y[: model.places] -= first * centres(model, y).ravel()
    pressed = compressed_state(contacts, model.law, 1.0 - first)
    kn = float(model.law.local_stiffness(pressed, elastic)[:, 0, 0].mean())
    # Between the first stiffness, for what is singular, and the later ones, for tolerances.
    model = replace(model, stiffness=float(np.sqrt(kn * model.stiffness)))
    return model, y, FIRST_ATOL * first


def start_mode(model: PathModel, contacts: ContactState) -> Mode:
    """Regimes of the initial contacts; their shear forces must be within their strength."""
    regime, side = model.law.regime(contacts), np.sign(contacts.shear_force)
    strength = np.where(regime == Regime.OPEN, 0.0, model.law.strength(contacts))
    limit = strength + START_MISMATCH * model.stiffness * model.length
    wrong = np.abs(contacts.shear_force) > limit
    if wrong.any():
        c = int(wrong.argmax())
        where, expected = f"shear force of contact {c}", f"at most its strength {strength[c]:.6g}"
        received = f"{contacts.shear_force[c]:.6g}"
        raise InputError(where, received, expected, "Correct it, or raise mu.")
    # Without friction a closed contact slides, whichever way.
    frictionless = (model.mu == 0) & (regime != Regime.OPEN)
    return Mode(
        np.where(frictionless, Regime.SLIDING, regime).astype(np.int8),
        np.where(frictionless, 1.0, side),
    )


def scales(model: PathModel) -> Floats:
    """(Y,) natural size of every integrated variable, for absolute tolerances."""
    force = model.stiffness * model.length
    return np.concatenate(
        [
            np.full(model.places, 1.0 if model.closure == "affine" else model.length),
            np.full(model.contact_count, force),
            [1.0],
            np.full(len(WORK_TERMS), force * model.length),
        ]
    )


def centres(model: PathModel, y: Floats) -> Floats:
    """(G, 2) centres in a state; `x = (I - H) x0` under the affine closure."""
    place = y[: model.places].reshape(-1, 2)
    return model.x0 + (-model.x0 @ place.T if model.closure == "affine" else place)


def with_forces(law: ContactLaw, contacts: ContactState, mode: Mode) -> ContactState:
    """Contacts with the forces that they have in these regimes.

    `N` is that of the geometry, `T` at its strength on its side where they slide. `N` of a closed
    contact may be negative, so that it stays smooth beyond an opening that is yet to be located.
    """
    is_open, sliding = mode.regime == Regime.OPEN, mode.regime == Regime.SLIDING
    contacts = replace(contacts, shear_force=np.where(is_open, 0.0, contacts.shear_force))
    normal = np.where(is_open, 0.0, law.closed_force(contacts))
    contacts = replace(contacts, normal_force=normal)
    if not (sliding.any() and law.keeps_strength):
        return contacts
    T = mode.side * np.where(sliding, law.strength(contacts), 0.0)
    return replace(contacts, shear_force=np.where(sliding, T, contacts.shear_force))


@dataclass(frozen=True, eq=False)
class Rates:
    """Rates of everything, in some unit of time.

    `H`, `P` (4,): Displacement gradient and nominal stress; `parameter`: Loading parameter; `un`,
    `ut` (C,): Relative displacements at the contacts; `normal_force`, `shear_force` (C,): `N'` and
    `T'`; `motion` (C, 4): Branch rates `d'` and the spins of both grains; `condition`: Condition
    number of the solve; `trusted`: Whether the solve has one answer.
    """

    H: Floats
    P: Floats
    parameter: float
    un: Floats
    ut: Floats
    normal_force: Floats
    shear_force: Floats
    motion: Floats
    condition: float
    trusted: bool

    @property
    def gauge(self) -> Floats:
        """Gauge that keeps the sense of these rates while `H'` turns by less than a right angle."""
        return np.append(self.H / (self.H @ self.H), 0.0)

    def scaled(self, factor: float) -> Rates:
        """The same rates in another unit of time."""
        kept = {"condition": self.condition, "trusted": self.trusted}
        values = {name: factor * value for name, value in vars(self).items() if name not in kept}
        return Rates(**values, **kept)  # type: ignore[arg-type]


def shear_stiffness(model: PathModel, contacts: ContactState) -> Floats:
    """(C,) `kt` of sticking contacts; infinite where they have none: no elastic shear."""
    sticking = np.full(model.contact_count, Regime.ELASTIC, dtype=np.int8)
    kt = model.law.local_stiffness(contacts, sticking)[:, 1, 1]
    return np.where(kt > 0.0, kt, np.inf)


def pairs_in_reach(model: PathModel, x: Floats) -> Integers:
    """(Q, 2) pairs of grains without a contact that are near where the grains are at x (G, 2)."""
    # Beside a singular state the interpolant may have left the numbers.
    if not model.watches_pairs or not np.isfinite(x).all():
        return NO_PAIRS
    reach = (1.0 + WATCHED_GAP) * 2.0 * float(model.radii.max())
    pairs = cKDTree(x).query_pairs(reach, output_type="ndarray")
    pairs = pairs[np.lexsort(pairs.T[::-1])]
    met = np.isin(pair_keys(model, pairs), model.met)
    near = pair_overlaps(model, pairs, x) > -WATCHED_GAP
    return np.asarray(pairs[near & ~met], dtype=np.int64)


def closest_pair(model: PathModel, x: Floats) -> float:
    """Largest overlap of these pairs; at least that of grains that are far apart."""
    overlaps = pair_overlaps(model, pairs_in_reach(model, x), x)
    return float(overlaps.max(initial=-WATCHED_GAP))


def pair_overlaps(model: PathModel, pairs: Integers, x: Floats) -> Floats:
    """(Q,) overlaps of pairs of grains over `r_i + r_j`."""
    i, j = pairs.T
    d = x[j] - x[i]
    touching = model.radii[i] + model.radii[j]
    return np.asarray((touching - np.hypot(d[:, 0], d[:, 1])) / touching)
