"""The differential equation of a path between two events."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from loops.contact_state import ContactState
from loops.laws.protocol import Regime
from stability.paths.model import PathModel
from stability.paths.rates import Linearised, Rates, linearise, local_rates
from stability.paths.solve import Gauge
from stability.paths.state import Mode, pack, unpack
from stability.programmes import Programme

Floats = NDArray[np.float64]


def unit_rates(local: Linearised, programme: Programme, gauge: Gauge) -> Rates:
    """Rates per unit length of the path in the space of `H`, `|H'| = 1`.

    The arc length is a regular parameter where the loading parameter turns back.

    Parameters
    ----------
    local : Linearised
        Where the path is.
    programme : Programme
        Control.
    gauge : Gauge
        Earlier direction: the path goes on, never back.

    Returns
    -------
    Rates
    """
    rates = local_rates(local, programme, gauge)
    return scaled_rates(rates, 1.0 / float(np.linalg.norm(rates.H)))


def scaled_rates(rates: Rates, factor: float) -> Rates:
    """The same rates in another unit of time."""
    kept = {"condition": rates.condition, "trusted": rates.trusted}
    values = {name: factor * value for name, value in vars(rates).items() if name not in kept}
    return Rates(**values, **kept)  # type: ignore[arg-type]


def gauge_along(rates: Rates) -> Gauge:
    """Gauge that keeps the sense of given rates while `H'` turns by less than a right angle."""
    return Gauge(rates.H / (rates.H @ rates.H), 0.0)


def y_rates(model: PathModel, y: Floats, mode: Mode, programme: Programme, gauge: Gauge) -> Floats:
    """Right-hand side `y'` per unit length of the path.

    Parameters
    ----------
    model, y, mode
        Where the path is and what its contacts do.
    programme : Programme
        Control.
    gauge : Gauge
        Earlier direction.

    Returns
    -------
    (Y,) array
        Not a number where the solve cannot be trusted.
    """
    state = unpack(model, y)
    local = linearise(model, state, mode)
    rates = unit_rates(local, programme, gauge)
    if not rates.trusted:
        return np.full_like(y, np.nan)
    place = rates.H if model.closure == "affine" else velocities(model, rates)
    work = power(local, rates)
    return pack(place, rates.shear_force, rates.parameter, work)


def stress(model: PathModel, contacts: ContactState) -> Floats:
    """(4,) nominal stress `P = (1/V0) sum f (x) d0`."""
    return (forces(contacts).T @ model.d0).ravel() / model.volume


def forces(contacts: ContactState) -> Floats:
    """(C, 2) `f = N n + T t`."""
    return contacts.normal_force[:, None] * contacts.n + contacts.shear_force[:, None] * contacts.t


def power(local: Linearised, rates: Rates) -> Floats:
    """(4,) rates of the work terms.

    External work `V0 P:H'`; work of the moments that hold the spins, `sum T (a_i w_i + a_j w_j)`;
    work spent on the shear of the contacts, `-sum T (t.d' - a_i w_i - a_j w_j)`; of this the part
    dissipated by slip, `-T (ut' + T'/kt)`. The moments are those that hold the spins and those of
    rolling springs.

    Parameters
    ----------
    local : Linearised
        State.
    rates : Rates
        In any unit of time.

    Returns
    -------
    (4,) array
        In the order `state.WORK_TERMS`.
    """
    model, contacts, mode = local.model, local.contacts, local.mode
    i, j = model.contacts.T
    T = contacts.shear_force
    rolled = contacts.arm_i * rates.spin[i] + contacts.arm_j * rates.spin[j]
    shear = (contacts.t * rates.branch).sum(axis=1) - rolled
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
    velocity[1:] = np.cumsum(rates.branch[: model.grain_count - 1], axis=0)
    return velocity - velocity.mean(axis=0)
