"""Rates of a state under a control: the direction in which a path goes on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from loops.contact_state import ContactState
from loops.laws.protocol import Regime
from loops.null_space import solve_through_null_space
from stability.paths.equations import Equations, closure_equations, saddle_equations
from stability.paths.model import PathModel
from stability.paths.state import (
    Mode,
    PathState,
    contacts_of,
    displacement_gradient,
    with_signs,
)
from stability.programmes import Programme

Floats = NDArray[np.float64]

# A solve is trusted while its residual and the stress of its null vectors stay below these.
RESIDUAL_LIMIT = 1e-8
AMBIGUITY_LIMIT = 1e-6


# Loops longer than this are not searched for branching points.
MOST_GRAINS = 60


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
    normal_force, trial_shear, shear_force : (C,) array
        `N'`, `T'` as if no contact slid, and `T'`.
    slip : (C,) array
        `s T'_trial - mu N'`: how fast a contact at yield would leave the cone; positive when it
        must slide, negative when it must not; 0 where the contact never slides.
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
    trial_shear: Floats
    shear_force: Floats
    slip: Floats
    branch: Floats
    spin: Floats
    condition: float
    trusted: bool


@dataclass(frozen=True, eq=False)
class Gauge:
    """What fixes the unit of time: `H . H' + parameter * parameter' = 1`."""

    H: Floats
    parameter: float


UNIT_PARAMETER = Gauge(np.zeros(4), 1.0)
RECEDING = Gauge(np.zeros(4), -1.0)


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
    contacts : ContactState
        Contacts with their forces.
    equations : Equations
        Closure equations.
    """

    model: PathModel
    mode: Mode
    H: Floats
    contacts: ContactState
    equations: Equations


def linearise(model: PathModel, state: PathState, mode: Mode) -> Linearised:
    """Contacts and closure equations of a state, see `Linearised`."""
    H = displacement_gradient(model, state.place)
    contacts = contacts_of(model, state, mode)
    signed = with_signs(contacts, mode)
    equations = closure_equations(model, H, signed, mode.regime)
    return Linearised(model, mode, H, contacts, equations)


def local_rates(local: Linearised, programme: Programme, gauge: Gauge) -> Rates:
    """Rates of a linearised state, see `state_rates`."""
    control = programme.equations(local.H)
    solution = _solve(local.model, local.equations, control, gauge)
    return _contact_rates(local, solution)


def local_tangent(local: Linearised) -> Floats:
    """(4, 4) macroscopic tangent `A`, `P' = A H'`, of a linearised state; nan if not trusted."""
    E, unit = local.equations.matrix, local.model.stiffness
    if len(E) == 4:
        return E[:, :4] * unit
    rest = E[:, 4:]
    found = solve_through_null_space(rest, -E[:, :4], np.eye(4, len(rest)))
    trusted = found.residual <= RESIDUAL_LIMIT and found.ambiguity <= AMBIGUITY_LIMIT
    return found.x[:4] * unit if trusted else np.full((4, 4), np.nan)


@dataclass(frozen=True, eq=False)
class _Solution:
    """Scaled unknowns, rate of the parameter, condition, and whether to trust them."""

    z: Floats
    parameter: float
    condition: float
    trusted: bool


def branching_number(local: Linearised, programme: Programme, gauge: Gauge) -> float:
    """A number that changes its sign where other paths branch off.

    The determinant of the grains' balance, control and gauge together, its root of the order of
    their number. At a limit of the control it does not vanish.

    Parameters
    ----------
    local : Linearised
        Where the path is.
    programme : Programme
        Control.
    gauge : Gauge
        Direction of the path.

    Returns
    -------
    float
        Not a number where it says nothing: affine closure (its equations determine the rates),
        free spins (the gear mode is a null vector), open contacts, more than 60 grains.
    """
    model, regime = local.model, local.mode.regime
    small = model.grain_count <= MOST_GRAINS and (regime != Regime.OPEN).all()
    if model.closure == "affine" or model.spins == "free" or not small:
        return np.nan
    signed = with_signs(local.contacts, local.mode)
    equations = saddle_equations(model, local.H, signed, regime)
    system, _ = _system(model, equations, programme.equations(local.H), gauge)
    sign, size = np.linalg.slogdet(system)
    return float(sign * np.exp(size / len(system)))


def _solve(
    model: PathModel, equations: Equations, control: tuple[Floats, Floats, Floats], gauge: Gauge
) -> _Solution:
    system, unit = _system(model, equations, control, gauge)
    size = len(system) - 1
    if not np.isfinite(system).all():
        return _Solution(np.full(size, np.nan), np.nan, np.inf, False)
    scale = np.abs(system[size]).max()
    system[size] /= scale
    rhs = np.zeros((size + 1, 1))
    rhs[size] = 1.0 / scale
    seen = np.zeros((9, size + 1))
    seen[:8, :8] = np.eye(8)
    seen[8, size] = 1.0
    found = solve_through_null_space(system, rhs, seen)
    trusted = bool(found.residual <= RESIDUAL_LIMIT and found.ambiguity <= AMBIGUITY_LIMIT)
    z = found.x[:, 0]
    return _Solution(z[:size], float(z[size] * unit), float(found.condition), trusted)


def _system(
    model: PathModel, equations: Equations, control: tuple[Floats, Floats, Floats], gauge: Gauge
) -> tuple[Floats, float]:
    """Closure, control and gauge as one square system, and the unit of the loading parameter."""
    stress, strain, rate = control
    rows, size = equations.matrix.shape
    stress = stress * model.stiffness
    weight = np.maximum(np.abs(stress).max(axis=1), np.abs(strain).max(axis=1))
    drive = rate / weight
    unit = 1.0 / np.abs(drive).max()
    system = np.zeros((size + 1, size + 1))
    system[:rows, :size] = equations.matrix
    system[rows:size, :4] = strain / weight[:, None]
    system[rows:size, 4:8] = stress / weight[:, None]
    system[rows:size, size] = -drive * unit
    system[size, :4] = gauge.H
    system[size, size] = gauge.parameter * unit
    return system, float(unit)


def _contact_rates(local: Linearised, solution: _Solution) -> Rates:
    model, mode, contacts, equations = local.model, local.mode, local.contacts, local.equations
    law, (i, j), z = model.law, model.contacts.T, solution.z
    branch, spin = equations.branch_rate @ z, equations.spin @ z
    g, arm_i, arm_j = law.shear_kinematics(contacts)
    un = (contacts.n * branch).sum(axis=1)
    ut = g * (contacts.t * branch).sum(axis=1) - arm_i * spin[i] - arm_j * spin[j]
    closed = mode.regime != Regime.OPEN
    normal = np.where(closed, -model.kn * un, 0.0)
    trial = np.where(closed, -model.kt * ut, 0.0)
    sliding = mode.regime == Regime.SLIDING
    slid = mode.side * model.friction * normal
    side = np.where(sliding, mode.side, np.sign(contacts.shear_force))
    slip = np.where(np.isfinite(model.mu), side * trial - model.friction * normal, 0.0)
    return Rates(
        H=z[:4],
        P=z[4:8] * model.stiffness,
        parameter=solution.parameter,
        un=un,
        ut=ut,
        normal_force=normal,
        trial_shear=trial,
        shear_force=np.where(sliding, slid, trial),
        slip=slip,
        branch=branch,
        spin=spin,
        condition=solution.condition,
        trusted=solution.trusted,
    )
