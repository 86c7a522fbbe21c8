"""Contacts at yield of a path: their regimes one after the other, or all at once; pathologies."""

from __future__ import annotations

from typing import Any

import numpy as np

from loops.arrays import Floats, Integers
from stability.complementarity import positive_definite
from stability.p_matrix import has_definite_scaling, is_p_matrix
from stability.packing.point import PackingPoint
from stability.packing.regime_factor import ELASTIC, SLIDING, Combination, Memory, RegimeFactor
from stability.packing.yielding import MixedControl
from stability.path import Pathologies
from stability.regimes import SlipProblem, agreeing

# Grains that move by more than this share of the largest displacement are in an unstable mode.
MODE_SHARE = 0.1
# Changes of regime within one pivot.
PIVOT_STEPS = 40
# Candidates up to which minors and solutions are looked for.
FEW_CANDIDATES = 30
# Candidates up to which there is a matrix: twice the columns that a factor keeps at most.
MOST_CANDIDATES = 192
# Random and named starts of the search for solutions where not all sets are tried.
FEW_STARTS = 5


def unstable_mode(motion: Floats, turns: bool) -> dict[str, Any]:
    """Facts of a motion that nothing stops, as `Event` has them: its grains, and what det K does.

    `turns` tells whether det K changes sign.
    """
    square = np.sum(motion.reshape(-1, 3)[:, :2] ** 2, axis=1)
    size = np.linalg.norm(motion.reshape(-1, 3), axis=1)
    return {
        "taking_part": float(square.sum() ** 2 / max(float(np.sum(square**2)), 1e-300)),
        "sign_changes": turns,
        "grains": tuple(np.flatnonzero(size > MODE_SHARE * size.max()).tolist()),
    }


def pivot(
    packing: RegimeFactor,
    control: MixedControl,
    c: int,
    critical: Integers,
    rounding: float,
) -> tuple[list[int] | None, dict[str, Any]]:
    """Bring one contact at yield to agree with its rates; all pairs that changed regime.

    The method of Cottle and Dantzig: the slip rate of the contact (or the distance of its rates
    from the cone) is raised from zero until it agrees with its regime, and others change regime
    where they would disagree. `critical` are the pairs at yield that agree, or have an event to
    come. Where that meets no end regimes are as before: None, and the facts of `unstable_mode`.
    """
    others = critical[critical != c]
    every = np.append(others, c)
    changed: list[int] = []
    column = packing.column(len(packing.frame) + c)
    raised, base = 0.0, packing.solve(control)
    for _ in range(PIVOT_STEPS):
        (unit,) = packing.driven(control, [column])
        # A force -s on the shear row is one unit of slip, or of the distance from the cone.
        push = -packing.side[c]
        value, along = packing.edge((base, unit), every).T
        sticks = np.where(packing.regime[every] == ELASTIC, 1.0, -1.0)
        value, along = sticks * value, push * sticks * along
        along[-1] += 1.0
        now = value + raised * along
        if now[-1] >= -rounding:
            packing.flip(c)
            return [*changed, c], {}
        own = raised - now[-1] / along[-1] if along[-1] > 1e-12 else np.inf
        falls = (along[:-1] < -1e-12) & (now[:-1] > -rounding)
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = np.where(falls, raised + np.maximum(now[:-1], 0.0) / -along[:-1], np.inf)
        if changed:
            reach[others == changed[-1]] = np.inf
        k = int(np.argmin(reach)) if len(reach) else -1
        if k >= 0 and reach[k] < own:
            raised = float(reach[k])
            packing.flip(int(others[k]))
            base = packing.solve(control)
            changed.append(int(others[k]))
        elif np.isfinite(own):
            packing.flip(c)
            return [*changed, c], {}
        else:
            break
    for other in changed:
        packing.flip(other)
    turns = packing.sign(control)
    packing.flip(c)
    turns *= packing.sign(control)
    packing.flip(c)
    return None, unstable_mode(packing.motion(unit), bool(turns < 0))


def seek(
    packing: RegimeFactor, control: MixedControl, contacts: Integers, rounding: float
) -> tuple[list[int] | None, str]:
    """Seek regimes of all contacts at yield that agree, where a pivot meets no end.

    All that changed regime, or None and the cause: a proof that there are none, or not.
    """
    found = agreeing(SlipProblem(*packing.problem(control, contacts), low=rounding))
    if not found.solutions:
        return None, "no_regimes" if found.proof else "none_found"
    active = found.taken.rates
    changed = contacts[active != (packing.regime[contacts] == SLIDING)].tolist()
    packing.set_regimes(contacts, np.where(active, SLIDING, ELASTIC))
    return changed, ""


def disagreeing(
    packing: RegimeFactor, rates: Combination, critical: Integers, rounding: float
) -> Integers:
    """Pairs at yield whose regime disagrees with their rates, the worst first."""
    sticks = np.where(packing.regime[critical] == ELASTIC, 1.0, -1.0)
    value = sticks * packing.edge((rates,), critical)[:, 0]
    wrong = np.flatnonzero(value < -rounding)
    return critical[wrong[np.argsort(value[wrong])]]


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
