"""Matrix of the contacts that may slide: symmetric, definite, a P-matrix; solutions and W2."""

from __future__ import annotations

import numpy as np

from loops.arrays import Floats
from stability.complementarity import positive_definite
from stability.p_matrix import has_definite_scaling, is_p_matrix
from stability.packing.controls import MixedControl
from stability.packing.point import PackingPoint
from stability.packing.regime_factor import ELASTIC, Memory, RegimeFactor
from stability.path import Pathologies
from stability.regimes import SlipProblem, agreeing

# Candidates up to which minors and solutions are looked for.
FEW_CANDIDATES = 30
# Candidates up to which there is a matrix: twice the columns that a factor keeps at most.
MOST_CANDIDATES = 192
# Random and named starts of the search for solutions where not all sets are tried.
FEW_STARTS = 5


def pathologies(point: PackingPoint, before: Memory | None = None) -> tuple[Pathologies, Memory]:
    """Look at the matrix of the candidates of a state, with a factor of its own.

    Its memory is `before` of the next call. Pairs of grains that carry nothing have no regimes.
    """
    state, regime, control = point.state, point.regime, point.control()
    N = np.tile(state.normal_force, state.law.springs)
    T = state.law.of_springs(state.shear_force, state.rolling_moment / state.mean_radius)
    packing = RegimeFactor(state, regime, point.side, memory=before)
    held = np.resize(point.absent, len(regime))
    candidates = packing.at_yield(N, T, held)
    stuck = candidates[regime[candidates] == ELASTIC]
    packing.side[stuck] = np.sign(T[stuck])
    w2, m = _second_order_work(packing, control), len(candidates)
    if m > MOST_CANDIDATES:
        said = f"{m} candidates, {MOST_CANDIDATES} at most"
        return Pathologies(m, np.nan, None, None, -1, False, w2, said), packing.memory
    if m == 0:
        return _judged(np.zeros(0), np.eye(0), w2), packing.memory
    low = packing.rounding(packing.solve(control))
    q, M = packing.problem(control, candidates)
    # Of slips, not of slips times stiffness: work-conjugate to the forces.
    return _judged(q, M * packing.frame["kt"][candidates], w2, low), packing.memory


def _judged(q: Floats, M: Floats, w2: float, low: float = 0.0) -> Pathologies:
    """Return what `w = q + M z` says of itself."""
    m, size = len(q), float(np.linalg.norm(M)) or 1.0
    asymmetry, definite = float(np.linalg.norm(M - M.T)) / size, m == 0 or positive_definite(M)
    if m < FEW_CANDIDATES:
        sure, told = is_p_matrix(M), "minors vanish to rounding, or are too many to decide"
    else:
        sure = True if definite or has_definite_scaling(M) else None
        told = f"{m} candidates, fewer than {FEW_CANDIDATES} wanted for the minors"
    told = "" if sure is not None else told
    solutions, proved = (1, True) if sure else (-1, False)
    if not sure and m < FEW_CANDIDATES:
        found = agreeing(SlipProblem(q, M, low=low), starts=FEW_STARTS)
        solutions, proved = len(found.solutions), found.exhaustive
    return Pathologies(m, asymmetry, definite, sure, solutions, proved, w2, told)


def _second_order_work(packing: RegimeFactor, control: MixedControl) -> float:
    """Return `P':H'` over the sizes of both, in the present regimes under a control."""
    from stability.compiled.packing_rates import stress_rate

    rates, stress = packing.solve(control), np.zeros(4)
    strain = rates.h[:4]
    stress_rate(packing.frame, packing.regime, packing.side, packing.motion(rates), rates.h, stress)
    size = float(np.linalg.norm(stress) * np.linalg.norm(strain))
    return float(stress @ strain) / size if size > 0 else np.nan


def columns(found: tuple[Pathologies, ...]) -> dict[str, Floats]:
    """Return columns of a table: flags as 1, 0, nan where they are not known."""
    names = ("candidates", "asymmetry", "symmetric", "definite", "p_matrix", "solutions", "proved")
    kinds = {"candidates": int, "solutions": int, "proved": bool, "withheld": str}
    out: dict[str, Floats] = {}
    for name in (*names, "w2", "withheld"):
        values = [getattr(one, name) for one in found]
        # None becomes not a number.
        out["path_w2" if name == "w2" else name] = np.array(values, kinds.get(name, float))
    return out
