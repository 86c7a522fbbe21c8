"""Rates of a state under a control: the direction in which a path goes on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loops.arrays import Floats
from loops.contact_state import ContactState
from loops.laws.protocol import Regime
from stability.paths.model import PathModel
from stability.paths.state import Mode


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


def contact_rates(
    model: PathModel, contacts: ContactState, stiffness: Floats, motion: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """`un'`, `ut'`, `N'` and `T'` of the contacts (C,) from their motions and the law's tangent."""
    g, b_i, b_j = model.law.shear_kinematics(contacts)
    branch, (w_i, w_j) = motion[:, :2], motion[:, 2:].T
    un = (contacts.n * branch).sum(axis=1)
    ut = g * (contacts.t * branch).sum(axis=1) - b_i * w_i - b_j * w_j
    normal = -(stiffness[:, 0, 0] * un + stiffness[:, 0, 1] * ut)
    return un, ut, normal, -(stiffness[:, 1, 0] * un + stiffness[:, 1, 1] * ut)


def stress(model: PathModel, contacts: ContactState) -> Floats:
    """(4,) nominal stress `P = (1/V0) sum f (x) d0`."""
    return (forces(contacts).T @ model.d0).ravel() / model.volume


def forces(contacts: ContactState) -> Floats:
    """(C, 2) `f = N n + T t`."""
    return contacts.normal_force[:, None] * contacts.n + contacts.shear_force[:, None] * contacts.t


def power(model: PathModel, mode: Mode, contacts: ContactState, rates: Rates) -> Floats:
    """(4,) rates of the work terms.

    External work `V0 P:H'`; work of the moments that hold the spins, `sum T (a_i w_i + a_j w_j)`;
    work spent on the shear of the contacts, `-sum T (t.d' - a_i w_i - a_j w_j)`; of this the part
    dissipated by slip, `-T (ut' + T'/kt)`. The moments are those that hold the spins and those of
    rolling springs.
    """
    T, (w_i, w_j) = contacts.shear_force, rates.motion[:, 2:].T
    rolled = contacts.arm_i * w_i + contacts.arm_j * w_j
    shear = (contacts.t * rates.motion[:, :2]).sum(axis=1) - rolled
    sliding = mode.regime == Regime.SLIDING
    slipped = np.zeros(1)
    if sliding.any():
        elastic = -rates.shear_force / shear_stiffness(model, contacts)
        slipped = np.where(sliding, -T * (rates.ut - elastic), 0.0)
    external = model.volume * (stress(model, contacts) @ rates.H)
    return np.array([external, T @ rolled, -T @ shear, slipped.sum()])


def shear_stiffness(model: PathModel, contacts: ContactState) -> Floats:
    """(C,) `kt` of sticking contacts; infinite where they have none: no elastic shear."""
    sticking = np.full(model.contact_count, Regime.ELASTIC, dtype=np.int8)
    kt = model.law.local_stiffness(contacts, sticking)[:, 1, 1]
    return np.where(kt > 0.0, kt, np.inf)


def velocities(model: PathModel, rates: Rates) -> Floats:
    """(G, 2) velocities of the grains; their mean is zero under the traction closure."""
    if model.closure == "affine":
        return -model.x0 @ rates.H.reshape(2, 2).T
    velocity = np.zeros((model.grain_count, 2))
    # The ring's contacts come first, from grain to grain.
    velocity[1:] = np.cumsum(rates.motion[: model.grain_count - 1, :2], axis=0)
    return velocity - velocity.mean(axis=0)
