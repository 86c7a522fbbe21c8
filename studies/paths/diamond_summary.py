"""What the diamond study comes down to: states I, A and B, events, verification, comparisons."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any

import numpy as np
from scipy.optimize import brentq

from loops import GrainGraph, LinearFrictional, Regime, macroscopic_tangent
from loops.arrays import Floats
from patterns.diamond import (
    DiamondParameters,
    diamond,
    drained_path,
    drained_states_after_turn,
    isotropic_tangent,
    opposite_gaps,
)
from patterns.diamond.tangents import drained_slope
from stability import (
    Verdict,
    bromwich_margin,
    judge,
    operator_norm,
    restrict,
    symmetric_part,
)
from studies.columns import definitions
from studies.paths.added_contact import added_summary
from studies.paths.diamond import (
    PAIRS,
    ROUNDING,
    FollowedDiamond,
    beyond_yield,
    follow_diamond,
    touching_strains,
)
from studies.paths.rules import rules_summary
from studies.paths.states import DiamondStates, Operators, operators, states_at
from studies.paths.tables import state_columns

STATES = ("I", "A", "B")
EVENT_VALUES = ("E1", "E2", "alpha_deg", "s1", "s2", "N", "T", "det_K", "det_Ks")
STATE_VALUES = ("E1", "E2", "alpha_deg", "l", "N", "T", "s1", "s2", "det_K", "det_Ks")


def diamond_summary(found: FollowedDiamond) -> dict[str, Any]:
    """Summary of the study, without its provenance.

    `states` are null where not reached; `sliding_rules`, `added_contact` where they say nothing.
    """
    values = _values(found.states, found.operators)
    added = found.options.contact_on_touch == "add"
    return {
        "parameters": found.options.described(),
        "states": {name: _state(found, values, name) for name in STATES},
        "events": [
            {"kind": kind, **{key: float(values[key][row]) for key in EVENT_VALUES}}
            for kind, row in found.listed
        ],
        "end": {
            **{key: float(values[key][-1]) for key in STATE_VALUES},
            **{key: float(energy[-1]) for key, energy in found.energies.items()},
        },
        "model": model_summary(found),
        "verification": verification(found),
        "sliding_rules": rules_summary(found.options),
        "added_contact": added_summary(found.loop) if added else None,
        "figures": _figure_files(found),
        "notes": _notes(found),
        "definitions": definitions("diamond"),
    }


def _values(states: DiamondStates, found: Operators) -> dict[str, Floats]:
    columns = {name: getattr(states, name) for name in ("E1", "E2", "N", "T", "s1", "s2")}
    angles = {"alpha_deg": np.degrees(states.alpha), "l": states.length}
    return {**columns, **angles, "det_K": found.det_K, "det_Ks": found.det_Ks}


def _state(found: FollowedDiamond, values: dict[str, Floats], name: str) -> dict[str, Any] | None:
    """A named state with its operators; B has those of sliding contacts too, as `beyond`."""
    if name not in found.marks:
        return None
    row = found.marks[name]
    here = found.states.take([row])
    gaps = opposite_gaps(here.E1, here.E2, found.loop.alpha0)
    state = {
        **{key: float(values[key][row]) for key in STATE_VALUES},
        **_operators(found, here),
        **{key: float(energy[row]) for key, energy in found.energies.items()},
        "gaps": [float(gap[0]) for gap in gaps],
    }
    sliding = beyond_yield(found) if name == "B" else None
    return state if sliding is None else {**state, "beyond": _operators(found, sliding)}


def _operators(found: FollowedDiamond, state: DiamondStates) -> dict[str, Any]:
    """Operators of one state, and what they tell."""
    tangents = operators(found.loop, state)
    columns = {key: values[0] for key, values in state_columns(state, tangents).items()}
    K = tangents.K[0]
    verdict, eigenvalues = judge(K), judge(K).eigenvalues
    return {
        "regime": str(state.regime[0]),
        "det_K": float(tangents.det_K[0]),
        "det_Ks": float(tangents.det_Ks[0]),
        "K": K,
        "Kmat": tangents.material[0],
        "Kgeo": tangents.geometric[0],
        "Ks": symmetric_part(K),
        "eigenvalues_K": [[float(value.real), float(value.imag)] for value in eigenvalues],
        "eigenvalues_Ks": verdict.symmetric_eigenvalues,
        "cone": {
            "status": str(columns["cone_status"]),
            "edges_deg": [float(columns["cone_edge_1_deg"]), float(columns["cone_edge_2_deg"])],
            "opening_deg": float(columns["cone_opening_deg"]),
            "axis_deg": float(columns["cone_axis_deg"]),
            "unstable_fraction": float(columns["unstable_fraction"]),
        },
        "verdict": _verdict(verdict),
        "generic": _generic(found, state),
    }


def _generic(found: FollowedDiamond, state: DiamondStates) -> dict[str, Any] | None:
    """The generic tangent; none where the printed rule leaves Coulomb's law."""
    if state.slip[0] * state.T[0] < 0.0:
        return None
    closure = found.options.closure
    A = generic_tangent(found.loop, state, closure)[0]
    return {"closure": closure, "tangent": A, "verdict": _verdict(judge(A, "symmetric"))}


def _verdict(verdict: Verdict) -> dict[str, Any]:
    names = ("status", "mode", "margin", "tolerance", "witness")
    return {name: getattr(verdict, name) for name in names}


def generic_tangent(loop: DiamondParameters, states: DiamondStates, closure: Any) -> Floats:
    """(n, 4, 4) tangent of any loop applied to the diamond, over `L10 L20`; NaN if not trusted."""
    law = LinearFrictional(kn=1.0, kt=loop.kappa, mu=loop.mu)
    sides = np.where(states.slip == 0.0, Regime.ELASTIC, Regime.SLIDING)
    regime = np.repeat(sides[:, None], 4, axis=1)
    if states.added.any():
        across = np.where(states.added, Regime.ELASTIC, Regime.OPEN)
        regime = np.concatenate([regime, across], axis=1)
    box = 2.0 * np.sin(2.0 * loop.alpha0)
    graph = _graph(loop, states)
    return macroscopic_tangent(graph, law, closure, regime=regime, volume=box).matrix


def _graph(loop: DiamondParameters, states: DiamondStates) -> GrainGraph:
    """Grain graph of the states; where some have added contacts there are six, those last."""
    graph = diamond(loop.alpha0, E1=states.E1, E2=states.E2, T=states.T)
    if not states.added.any():
        return graph
    overlap = -np.stack(opposite_gaps(states.E1, states.E2, loop.alpha0), axis=-1)
    force = np.where(states.added, np.maximum(overlap, 0.0), 0.0)
    return graph.replace(
        contacts=np.concatenate([graph.contacts, PAIRS]),
        normal_force=np.concatenate([graph.normal_force, force], axis=-1),
        shear_force=np.concatenate([graph.shear_force, 0.0 * force], axis=-1),
    )


# ---- verification


def verification(found: FollowedDiamond) -> dict[str, Any]:
    """How far independent routes to the same numbers lie apart on a path.

    `generic_vs_closed_form`: the operator of any loop, both closures, in (11, 22) against (26)
    where Coulomb's law holds, `*_untrusted` its states without an answer; `isotropic`: (38) against
    (26); `det_K`: (35), (36) against the determinant; `bromwich_margin_min`: of
    `min Re eig(K) - lambda_min(Ks)`; `det_K_zero_by_root`: (41) against a root search;
    `energy_balance`: work less stored energy and heat; `slope_at_A`: see there.
    """
    K, norm = found.K, operator_norm(found.K)
    lawful = np.flatnonzero(found.states.slip * found.states.T >= 0.0)
    errors, untrusted = [], {}
    for closure in ("affine", "traction"):
        generic = generic_tangent(found.loop, found.states.take(lawful), closure)
        error = operator_norm(restrict(generic, "diagonal") - K[lawful]) / norm[lawful]
        errors.append(float(np.nanmax(error)))
        untrusted[f"generic_{closure}_untrusted"] = int(np.count_nonzero(np.isnan(error)))
    return {
        "generic_vs_closed_form_max_relative": max(errors),
        **untrusted,
        "isotropic_vs_closed_form_max_relative": _isotropic_error(found),
        "det_K_max_difference": float(np.max(np.abs(np.linalg.det(K) - found.det_K))),
        "bromwich_margin_min": float(np.min(bromwich_margin(K))),
        "det_K_zero_by_root_difference": _root_difference(found),
        "energy_balance_max_relative": energy_imbalance(found),
        "slope_at_A": slope_at_A(found),
        "states": len(lawful),
    }


def energy_imbalance(found: FollowedDiamond) -> float:
    """Largest `|work - stored - dissipated|` over the largest work; 0 on an unloaded path."""
    work, stored, heat = (found.energies[name] for name in ("work", "stored", "dissipated"))
    largest = float(np.max(np.abs(work)))
    return float(np.max(np.abs(work - stored - heat))) / largest if largest > 0.0 else 0.0


def slope_at_A(found: FollowedDiamond) -> dict[str, float] | None:
    """`ds1/dE1` where the drained test starts: exact path by differences, and det K/K22 (33).

    None where A is not reached, or the path opens or slides at once.
    """
    exact = drained_path(found.loop)
    last = float(np.nan_to_num(exact.end.turn, nan=exact.direction))
    if "A" not in found.marks or exact.status == "opening" or last == 0.0:
        return None
    # Chebyshev points on a short part of the elastic path: the slope of the interpolant.
    short = min(0.1, 0.2 * found.loop.alpha0, 0.2 * (0.5 * np.pi - found.loop.alpha0))
    turn = 0.5 * np.clip(last, -short, short) * (1.0 - np.cos(np.pi * np.arange(15) / 14))
    states, _ = drained_states_after_turn(exact, turn)
    s1, E1 = (
        np.polynomial.Polynomial.fit(turn, y, 14).deriv()(0.0) for y in (states.s1, states.E1)
    )
    confinement = found.loop.confinement
    at_A = operators(found.loop, states_at(found.loop, confinement, confinement))
    closed = float(drained_slope(at_A.K[0]))
    difference = float(abs(s1 / E1 - closed))
    return {"differences": float(s1 / E1), "closed_form": closed, "difference": difference}


def _isotropic_error(found: FollowedDiamond) -> float:
    states = found.states
    rows = (states.stage == "isotropic") & ~states.added.any(axis=1) & (states.slip == 0.0)
    if not rows.any():
        return 0.0
    K = found.K[rows]
    closed = isotropic_tangent(states.E1[rows], found.loop.alpha0, found.loop.kappa)
    return float(np.max(operator_norm(closed - K) / operator_norm(K)))


def _root_difference(found: FollowedDiamond) -> float | None:
    loop, row = found.loop, found.marks.get("I")
    if row is None or loop.kappa == 0.0 or found.states.added[row].any():
        return None
    at_I = float(found.E1[row])

    def det(E: float) -> float:
        A = generic_tangent(loop, states_at(loop, E, E), "affine")[0]
        return float(np.linalg.det(restrict(A, "diagonal")))

    eps = float(np.finfo(float).eps)
    return abs(float(brentq(det, 0.0, 0.5 * (1.0 + at_I), xtol=1e-15, rtol=4 * eps)) - at_I)


def model_summary(found: FollowedDiamond) -> dict[str, Any]:
    """The model in words; with all freedoms asked for, how far the smallest model lies away."""
    model = asdict(found.path.model)
    if found.options.model == "auto":
        return {**model, "check": None}
    small = follow_diamond(replace(found.options, model="auto"))
    differences = {}
    for name in (name for name in STATES if name in found.marks and name in small.marks):
        ours, theirs = (
            np.array([values[path.marks[name]] for values in (path.E1, path.E2, path.s1, path.s2)])
            for path in (found, small)
        )
        differences[name] = float(np.abs(ours - theirs).max())
    check = {"status": found.path.status, "rows": len(found.path), "differences": differences}
    return {**model, "check": check}


def _figure_files(found: FollowedDiamond) -> dict[str, str]:
    """Which file holds which of the paper's figures; any diamond but Table 2 stands for Table 1."""
    stress, determinant = ("8", "9") if found.options.table == 2 else ("6", "7")
    return {
        "4": "path_dependence",
        stress: "axial_stress",
        determinant: "determinant",
        "10": "eigenvalues",
        **({"11": "polar"} if found.marks else {}),
        "12": "cone",
    }


def _notes(found: FollowedDiamond) -> list[str]:
    loop, touching, notes = found.loop, touching_strains(found.loop), []
    if min(touching) < 0.0:
        notes.append("opposite grains overlap from the start: below 30 or above 60 degrees")
    if abs(np.sin(loop.alpha0) - np.cos(loop.alpha0)) <= ROUNDING:
        notes.append("at 45 degrees both pairs of opposite grains meet at once")
        if found.options.contact_on_touch == "add":
            notes.append("both contacts are added: their branches cross, the loop is not planar")
    if "A" not in found.marks:
        notes.append("the path ends where opposite grains meet, before A")
    notes += [
        f"opposite grains on axis {axis} part at E1 = {E1:.6f}" for axis, E1 in _parting(found)
    ]
    if "B" in found.marks and found.det_Ks[found.marks["B"]] > 0.0:
        sliding = beyond_yield(found)
        if sliding is not None and operators(loop, sliding).det_Ks[0] < 0.0:
            notes.append("det K and det Ks jump below zero at B, where the contacts start to slide")
    return notes


def _parting(found: FollowedDiamond) -> list[tuple[int, float]]:
    """Where opposite grains that overlapped part again, by linear interpolation between rows."""
    E1, parted = found.E1, []
    for axis, gap in enumerate(opposite_gaps(E1, found.E2, found.loop.alpha0), start=1):
        for k in np.flatnonzero((gap[:-1] < -ROUNDING) & (gap[1:] > ROUNDING)):
            share = gap[k] / (gap[k] - gap[k + 1])
            parted.append((axis, float(E1[k] + share * (E1[k + 1] - E1[k]))))
    return parted
