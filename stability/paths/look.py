"""Everything there is to know of one state of a path, for its record and for its events."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loops.arrays import Floats
from loops.contact_state import ContactState
from loops.laws.protocol import Regime
from loops.null_space import solve_through_null_space
from stability.paths.equations import (
    Equations,
    Gauge,
    closure_equations,
    control_system,
    is_trusted,
    saddle_equations,
)
from stability.paths.model import PathModel
from stability.paths.rates import (
    Linearised,
    Rates,
    forces,
    linearise,
    slip_rates,
    stress,
    unit_rates,
)
from stability.paths.state import Mode, PathState, centres, unpack
from stability.programmes import Programme


@dataclass(frozen=True, eq=False)
class Look:
    """A state with what follows from it.

    `state`, `mode`, `contacts`: Integrated variables, regimes, contacts with their forces; `H`, `P`
    (4,): Displacement gradient and nominal stress; `A` (4, 4): Tangent in these regimes; `rates`:
    Per unit length of the path; `x` (G, 2): Centres; `branching`: See `rates.branching_number`;
    `slip` (C,): See `rates.slip_rates`.
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


# Loops longer than this are not searched for branching points.
MOST_GRAINS = 60


def local_tangent(local: Linearised) -> Floats:
    """(4, 4) macroscopic tangent `A`, `P' = A H'`, of a linearised state; nan if not trusted."""
    blocks = local.model.unknowns[local.kind].tangent
    A = np.zeros((4, 4))
    for unknowns in blocks:
        equations = local.equations
        if unknowns is not equations.unknowns:
            equations = closure_equations(
                local.model, local.H, local.signed, local.mode.regime, local.kind, unknowns
            )
        A += _block_tangent(equations)
    return A * local.model.stiffness


def _block_tangent(equations: Equations) -> Floats:
    """(4, 4) what the unknowns' strains do to their stresses, over `kn`."""
    E, z = equations.matrix, equations.unknowns
    t = z.strains
    if E.shape == (4, 8):
        # Affine, spins not free: E reads A H' - P' = 0.
        return E[:, :4]
    stress = z.P[:, t:]
    if z.rows is not None:
        E = z.rows @ E
    found = solve_through_null_space(E[:, t:], -E[:, :t], stress)
    if not is_trusted(found):
        return np.full((4, 4), np.nan)
    return np.asarray(stress @ found.x @ z.H[:, :t].T)


def branching_number(local: Linearised, programme: Programme, gauge: Gauge) -> float:
    """A number that changes its sign where other paths branch off.

    The determinant of the grains' balance, control and gauge together, its root of the order of
    their number. At a limit of the control it does not vanish.
    """
    model, regime = local.model, local.mode.regime
    small = model.grain_count <= MOST_GRAINS and (regime != Regime.OPEN).all()
    if model.closure == "affine" or model.spins == "free" or not small:
        return np.nan
    everything = model.unknowns["saddle"].everything
    equations = saddle_equations(model, local.H, local.signed, regime, everything)
    system, _ = control_system(model, equations, programme.equations(local.H), gauge)
    sign, size = np.linalg.slogdet(system)
    return float(sign * np.exp(size / len(system)))
