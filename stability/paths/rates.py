"""Rates of a state under a control: the direction in which a path goes on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loops.arrays import Floats
from loops.contact_state import ContactState
from loops.laws.frictional import edge_rates
from loops.laws.protocol import Regime
from stability.paths.equations import (
    Equations,
    Gauge,
    Solution,
    closure_equations,
    closure_kind,
    solve_rates,
)
from stability.paths.model import PathModel
from stability.paths.state import (
    Mode,
    PathState,
    contacts_of,
    displacement_gradient,
    pack,
    unpack,
    with_signs,
)
from stability.paths.unknowns import Kind
from stability.programmes import Programme


@dataclass(frozen=True, eq=False)
class Rates:
    """Rates of everything, in some unit of time.

    `H`, `P` (4,): Displacement gradient and nominal stress; `parameter`: Loading parameter; `un`,
    `ut` (C,): Relative displacements at the contacts; `normal_force`, `shear_force` (C,): `N'` and
    `T'`; `branch` (C, 2): Branch rates `d'`; `spin` (G,): Spins; `condition`: Condition number of
    the solve; `trusted`: Whether the solve has one answer.
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

    The loading parameter is an unknown like the others, so a limit of the control (`parameter' =
    0`) is an ordinary point for a gauge that is not `UNIT_PARAMETER`.
    """
    return local_rates(linearise(model, state, mode), programme, gauge)


@dataclass(frozen=True, eq=False)
class Linearised:
    """A state with its contacts and closure equations.

    `model`, `mode`: Constants, and the regimes that the equations assume; `H` (4,): Displacement
    gradient; `contacts`, `signed`: Contacts with their forces; and with the signs of `T` that the
    law reads; `kind`: Closure equations that serve; `equations`: Those of the rates.
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


def unit_rates(local: Linearised, programme: Programme, gauge: Gauge) -> Rates:
    """Rates per unit length of the path in the space of `H`, `|H'| = 1`.

    The arc length is a regular parameter where the loading parameter turns back.
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
    """Right-hand side `y'` per unit length of the path."""
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
