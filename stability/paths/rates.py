"""Rates of a state under a control: the direction in which a path goes on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from loops.contact_state import ContactState
from loops.laws.frictional import edge_rates
from stability.paths.equations import Equations, closure_equations, closure_kind
from stability.paths.model import PathModel
from stability.paths.solve import Gauge, Solution, solve_rates
from stability.paths.state import (
    Mode,
    PathState,
    contacts_of,
    displacement_gradient,
    with_signs,
)
from stability.paths.unknowns import Kind
from stability.programmes import Programme

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Rates:
    """Rates of everything, in some unit of time.

    Attributes
    ----------
    H, P : (4,) array
        Displacement gradient and nominal stress.
    parameter : float
        Loading parameter.
    un, ut : (C,) array
        Relative displacements at the contacts.
    normal_force, shear_force : (C,) array
        `N'` and `T'`.
    branch : (C, 2) array
        Branch rates `d'`.
    spin : (G,) array
        Spins.
    condition : float
        Condition number of the solve.
    trusted : bool
        Whether the solve has one answer.
    """

    H: Floats
    P: Floats
    parameter: float
    un: Floats
    ut: Floats
    normal_force: Floats
    shear_force: Floats
    branch: Floats
    spin: Floats
    condition: float
    trusted: bool


def state_rates(
    model: PathModel, state: PathState, mode: Mode, programme: Programme, gauge: Gauge
) -> Rates:
    """Solve closure and control together.

    The loading parameter is an unknown like the others, so a limit of the control
    (`parameter' = 0`) is an ordinary point for a gauge that is not `UNIT_PARAMETER`.

    Parameters
    ----------
    model, state, mode
        Where the path is and what its contacts do.
    programme : Programme
        Control.
    gauge : Gauge
        Unit of time.

    Returns
    -------
    Rates
    """
    return local_rates(linearise(model, state, mode), programme, gauge)


@dataclass(frozen=True, eq=False)
class Linearised:
    """A state with its contacts and closure equations.

    Attributes
    ----------
    model, mode
        Constants, and the regimes that the equations assume.
    H : (4,) array
        Displacement gradient.
    contacts, signed : ContactState
        Contacts with their forces; and with the signs of `T` that the law reads.
    kind : {'affine', 'ring', 'saddle'}
        Closure equations that serve.
    equations : Equations
        Those of the rates.
    """

    model: PathModel
    mode: Mode
    H: Floats
    contacts: ContactState
    signed: ContactState
    kind: Kind
    equations: Equations


def linearise(model: PathModel, state: PathState, mode: Mode) -> Linearised:
    """Contacts and closure equations of a state, see `Linearised`."""
    H = displacement_gradient(model, state.place)
    contacts = contacts_of(model, state, mode)
    signed = with_signs(contacts, mode)
    kind = closure_kind(model, signed, mode.regime)
    rates = model.unknowns[kind].rates
    equations = closure_equations(model, H, signed, mode.regime, kind, rates)
    return Linearised(model, mode, H, contacts, signed, kind, equations)


def local_rates(local: Linearised, programme: Programme, gauge: Gauge) -> Rates:
    """Rates of a linearised state, see `state_rates`."""
    control = programme.equations(local.H)
    solution = solve_rates(local.model, local.equations, control, gauge)
    return _contact_rates(local, solution)


def _contact_rates(local: Linearised, solution: Solution) -> Rates:
    model, mode, contacts, equations = local.model, local.mode, local.contacts, local.equations
    law, (i, j), z = model.law, model.contacts.T, solution.z
    branch, spin = equations.branch_rate @ z, equations.spin @ z
    g, arm_i, arm_j = law.shear_kinematics(contacts)
    un = (contacts.n * branch).sum(axis=1)
    ut = g * (contacts.t * branch).sum(axis=1) - arm_i * spin[i] - arm_j * spin[j]
    D = law.local_stiffness(local.signed, mode.regime)
    return Rates(
        H=equations.unknowns.H @ z,
        P=equations.unknowns.P @ z * model.stiffness,
        parameter=solution.parameter,
        un=un,
        ut=ut,
        normal_force=-(D[:, 0, 0] * un + D[:, 0, 1] * ut),
        shear_force=-(D[:, 1, 0] * un + D[:, 1, 1] * ut),
        branch=branch,
        spin=spin,
        condition=solution.condition,
        trusted=solution.trusted,
    )


def slip_rates(local: Linearised, rates: Rates) -> Floats:
    """(C,) how fast contacts at yield would leave the cone if they stuck, force per unit of time.

    Positive when a contact must slide, negative when it must not; minus infinity where it never
    slides.
    """
    side = np.where(local.mode.side != 0.0, local.mode.side, np.sign(local.contacts.shear_force))
    law = local.model.law
    _, sticking, strength = edge_rates(law, local.signed, side, rates.un, rates.ut)
    return np.asarray(np.where(side == 0.0, 1.0, side) * sticking - strength)
