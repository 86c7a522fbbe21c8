"""The macroscopic tangent of a state on a path, and where other paths branch off."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from loops.laws.protocol import Regime
from loops.null_space import solve_through_null_space
from stability.paths.equations import Equations, closure_equations, saddle_equations
from stability.paths.rates import Linearised
from stability.paths.solve import Gauge, control_system, is_trusted
from stability.programmes import Programme

Floats = NDArray[np.float64]

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
    everything = model.unknowns["saddle"].everything
    equations = saddle_equations(model, local.H, local.signed, regime, everything)
    system, _ = control_system(model, equations, programme.equations(local.H), gauge)
    sign, size = np.linalg.slogdet(system)
    return float(sign * np.exp(size / len(system)))
