"""Everything there is to know of one state of a path, for its record and for its events."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from loops.contact_state import ContactState
from stability.paths.model import PathModel
from stability.paths.motion import forces, stress, unit_rates
from stability.paths.rates import Rates, linearise, slip_rates
from stability.paths.solve import Gauge
from stability.paths.state import Mode, PathState, centres, unpack
from stability.paths.tangent import branching_number, local_tangent
from stability.programmes import Programme

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Look:
    """A state with what follows from it.

    Attributes
    ----------
    state, mode, contacts
        Integrated variables, regimes, contacts with their forces.
    H, P : (4,) array
        Displacement gradient and nominal stress.
    A : (4, 4) array
        Tangent in these regimes.
    rates : Rates
        Per unit length of the path.
    x : (G, 2) array
        Centres.
    branching : float
        See `rates.branching_number`.
    slip : (C,) array
        See `rates.slip_rates`.
    """

    state: PathState
    mode: Mode
    contacts: ContactState
    H: Floats
    P: Floats
    A: Floats
    rates: Rates
    x: Floats
    branching: float
    slip: Floats


def look(model: PathModel, y: Floats, mode: Mode, programme: Programme, gauge: Gauge) -> Look:
    """Evaluate a state completely, see `Look`."""
    state = unpack(model, y)
    local = linearise(model, state, mode)
    rates = unit_rates(local, programme, gauge)
    return Look(
        state=state,
        mode=mode,
        contacts=local.contacts,
        H=local.H,
        P=stress(model, local.contacts),
        A=local_tangent(local),
        rates=rates,
        x=centres(model, state.place),
        branching=branching_number(local, programme, gauge),
        slip=slip_rates(local, rates),
    )


def imbalance(model: PathModel, contacts: ContactState, P: Floats) -> float:
    """Largest force on a grain that `-P b_i` leaves unbalanced, over `kn` times length.

    Not a number under the affine closure, which does not balance the grains.
    """
    if model.closure == "affine":
        return np.nan
    i, j = model.contacts.T
    f = forces(contacts)
    unbalanced = -model.b @ P.reshape(2, 2).T
    np.add.at(unbalanced, i, -f)
    np.add.at(unbalanced, j, f)
    return float(np.abs(unbalanced).max() / (model.stiffness * model.length))
