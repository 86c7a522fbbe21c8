"""Closure, control and gauge as one linear system, and its solution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from loops.null_space import LeastSquares, solve_through_null_space
from stability.paths.equations import Equations
from stability.paths.model import PathModel
from stability.paths.unknowns import Unknowns

Floats = NDArray[np.float64]

# A solve is trusted while its residual and the stress of its null vectors stay below these.
RESIDUAL_LIMIT = 1e-8
AMBIGUITY_LIMIT = 1e-6


@dataclass(frozen=True, eq=False)
class Gauge:
    """What fixes the unit of time: `H . H' + parameter * parameter' = 1`."""

    H: Floats
    parameter: float


UNIT_PARAMETER = Gauge(np.zeros(4), 1.0)
RECEDING = Gauge(np.zeros(4), -1.0)


@dataclass(frozen=True, eq=False)
class Solution:
    """Rates in scaled unknowns.

    Attributes
    ----------
    z : (r,) array
        The numbers that `Unknowns` reads.
    parameter : float
        Rate of the loading parameter.
    condition : float
        Condition number of the solve.
    trusted : bool
        Whether it has one answer.
    """

    z: Floats
    parameter: float
    condition: float
    trusted: bool


def solve_rates(
    model: PathModel, equations: Equations, control: tuple[Floats, Floats, Floats], gauge: Gauge
) -> Solution:
    """Rates of the unknowns under a control, in the unit of time of the gauge."""
    system, unit = control_system(model, equations, control, gauge)
    size = system.shape[1] - 1
    if not np.isfinite(system).all():
        return Solution(np.full(size, np.nan), np.nan, np.inf, False)
    system = _combined(system, equations.unknowns)
    scale = np.abs(system[-1]).max()
    system[-1] /= scale
    rhs = np.zeros((len(system), 1))
    rhs[-1] = 1.0 / scale
    seen = np.zeros((9, size + 1))
    seen[:4, :size], seen[4:8, :size] = equations.unknowns.H, equations.unknowns.P
    seen[8, size] = 1.0
    found = solve_through_null_space(system, rhs, seen)
    z = found.x[:, 0]
    return Solution(z[:size], float(z[size] * unit), float(found.condition), is_trusted(found))


def control_system(
    model: PathModel, equations: Equations, control: tuple[Floats, Floats, Floats], gauge: Gauge
) -> tuple[Floats, float]:
    """Closure, control and gauge as one system, and the unit of the loading parameter."""
    stress, strain, rate = control
    z = equations.unknowns
    rows, size = equations.matrix.shape
    stress = stress * model.stiffness
    weight = np.maximum(np.abs(stress).max(axis=1), np.abs(strain).max(axis=1))
    drive = rate / weight
    unit = 1.0 / np.abs(drive).max()
    system = np.zeros((rows + 5, size + 1))
    system[:rows, :size] = equations.matrix
    system[rows:-1, :size] = (strain @ z.H + stress @ z.P) / weight[:, None]
    system[rows:-1, size] = -drive * unit
    system[-1, :size] = gauge.H @ z.H
    system[-1, size] = gauge.parameter * unit
    return system, float(unit)


def _combined(system: Floats, z: Unknowns) -> Floats:
    """As many rows as unknowns: combinations of closure and control, and the gauge.

    In a symmetric state the other rows agree. They are not looked at: near a singular state they
    hold nothing but the rounding of the forces, times the compliance.
    """
    if z.rows is None:
        return system
    control = system[-5:-1]
    # As many combinations of the control's equations are left as strains; they are alike in size.
    kept = np.linalg.svd(control)[0][:, : z.strains]
    return np.concatenate([z.rows @ system[:-5], kept.T @ control, system[-1:]])


def is_trusted(found: LeastSquares) -> bool:
    """Whether a solve has an answer, and only one."""
    return bool(found.residual <= RESIDUAL_LIMIT and found.ambiguity <= AMBIGUITY_LIMIT)
