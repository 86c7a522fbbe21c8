"""Summary of the diamond study: states I, A and B, events, model, verification, notes."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import brentq

from loops import LinearFrictional, Regime, macroscopic_tangent
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
from studies.paths.diamond import (
    OPPOSITE,
    TOUCHING_ATOL,
    DiamondStates,
    FollowedDiamond,
    beyond_yield,
    diamond_states,
    follow_diamond,
    state_columns,
    touching_strains,
)
from studies.paths.diamond_tables import added_summary

NAMED_STATES = ("I", "A", "B")
EVENT_VALUES = ("E1", "E2", "alpha_deg", "s1", "s2", "N", "T", "det_K", "det_Ks")
STATE_VALUES = ("E1", "E2", "alpha_deg", "l", "N", "T", "s1", "s2", "det_K", "det_Ks")


def diamond_summary(found: FollowedDiamond) -> dict[str, Any]:
    """Summary of the study, without its provenance.

    `states` are null where not reached; `added_contact` where none is added.
    """
    options, table = found.options, found.table
    # Files by the number of the paper's figure; those of Table 1 for diamonds of other parameters.
    stress, determinant = ("8", "9") if options.table == 2 else ("6", "7")
    figures = {"4": "path_dependence", stress: "axial_stress", determinant: "determinant"}
    figures |= {"10": "eigenvalues", **({"11": "polar"} if found.marks else {}), "12": "cone"}
    end = table.iloc[-1]
    return {
        "parameters": options.described(),
        "states": {name: _state(found, name) for name in NAMED_STATES},
        "events": [
            {"kind": kind, **{key: float(table[key][row]) for key in EVENT_VALUES}}
            for kind, row in found.listed
        ],
        "end": {key: float(end[key]) for key in (*STATE_VALUES, *found.energies)},
        "model": model_summary(found),
        "verification": verification(found),
        "added_contact": added_summary(found.loop) if options.contact_on_touch == "add" else None,
        "figures": figures,
        "notes": _notes(found),
        "definitions": definitions("diamond"),
    }


def _state(found: FollowedDiamond, name: str) -> dict[str, Any] | None:
    """A named state with its operators; B has those of sliding contacts too, as `beyond`."""
    if name not in found.marks:
        return None
    row = found.marks[name]
    here = found.table.iloc[row]
    state = {
        **{key: float(here[key]) for key in (*STATE_VALUES, *found.energies)},
        **_operators(found, found.states.take([row]), here),
        "gaps": [float(here["gap_1"]), float(here["gap_2"])],
    }
    sliding = beyond_yield(found) if name == "B" else None
    if sliding is not None:
        state["beyond"] = _operators(found, sliding, state_columns(sliding).iloc[0])
    return state


def _operators(found: FollowedDiamond, state: DiamondStates, columns: pd.Series) -> dict[str, Any]:
    """Operators of one state with their spectra, cone and verdicts."""
    K, closure = state.K[0], found.options.closure
    verdict, A = judge(K), generic_tangent(found.loop, state, closure)[0]
    return {
        "regime": columns["regime"],
        "det_K": float(state.det_K[0]),
        "det_Ks": float(state.det_Ks[0]),
        "K": K,
        "Kmat": state.material[0],
        "Kgeo": state.geometric[0],
        "Ks": symmetric_part(K),
        "eigenvalues_K": [[float(one.real), float(one.imag)] for one in verdict.eigenvalues],
        "eigenvalues_Ks": verdict.symmetric_eigenvalues,
        "cone": {
            "status": columns["cone_status"],
            "edges_deg": [float(columns[f"cone_edge_{k}_deg"]) for k in (1, 2)],
            "opening_deg": float(columns["cone_opening_deg"]),
            "axis_deg": float(columns["cone_axis_deg"]),
            "unstable_fraction": float(columns["unstable_fraction"]),
        },
        "verdict": _verdict(verdict),
        "generic": {"closure": closure, "tangent": A, "verdict": _verdict(judge(A, "symmetric"))},
    }


def _verdict(verdict: Verdict) -> dict[str, Any]:
    names = ("status", "mode", "margin", "tolerance", "witness")
    return {name: getattr(verdict, name) for name in names}


def generic_tangent(loop: DiamondParameters, states: DiamondStates, closure: Any) -> Floats:
    """(n, 4, 4) tangent of any loop applied to the diamond, over `L10 L20`; NaN if not trusted."""
    law = LinearFrictional(kn=1.0, kt=loop.kappa, mu=loop.mu)
    graph = diamond(loop.alpha0, E1=states.E1, E2=states.E2, T=states.T)
    sides = np.where(states.sliding, Regime.SLIDING, Regime.ELASTIC)
    regime = np.repeat(sides[:, None], 4, axis=1)
    if states.added.any():
        overlap = -np.stack(opposite_gaps(states.E1, states.E2, loop.alpha0), axis=-1)
        force = np.where(states.added, np.maximum(overlap, 0.0), 0.0)
        across = np.where(states.added, Regime.ELASTIC, Regime.OPEN)
        regime = np.concatenate([regime, across], axis=1)
        graph = graph.replace(
            contacts=np.concatenate([graph.contacts, OPPOSITE]),
            normal_force=np.concatenate([graph.normal_force, force], axis=-1),
            shear_force=np.concatenate([graph.shear_force, 0.0 * force], axis=-1),
        )
    box = 2.0 * np.sin(2.0 * loop.alpha0)
    return macroscopic_tangent(graph, law, closure, regime=regime, volume=box).matrix


# ---- verification


def verification(found: FollowedDiamond) -> dict[str, Any]:
    """Differences of independent routes to the same numbers on a path.

    `generic_vs_closed_form`: the operator of any loop, both closures, in (11, 22) against (26),
    `*_untrusted` its states without an answer; `isotropic`: (38) against (26); `det_K`: (35), (36)
    against the determinant; `bromwich_margin_min`: of `min Re eig(K) - lambda_min(Ks)`;
    `det_K_zero_by_root`: (41) against a root search; `energy_balance`: work less stored energy and
    heat; `slope_at_A`: see there.
    """
    loop, states, K, norm = found.loop, found.states, found.K, operator_norm(found.K)
    errors, untrusted = [], {}
    for closure in ("affine", "traction"):
        generic = generic_tangent(loop, states, closure)
        error = operator_norm(restrict(generic, "diagonal") - K) / norm
        errors.append(float(np.nanmax(error)))
        untrusted[f"generic_{closure}_untrusted"] = int(np.count_nonzero(np.isnan(error)))
    rows = (found.stage == "isotropic") & ~states.added.any(axis=1) & ~states.sliding
    closed = isotropic_tangent(states.E1[rows], loop.alpha0, loop.kappa)
    isotropic = operator_norm(closed - K[rows]) / norm[rows]
    root, at_I = None, found.marks.get("I")
    if at_I is not None and loop.kappa > 0.0 and not states.added[at_I].any():
        strain = float(found.E1[at_I])

        def det(E: float) -> float:
            A = generic_tangent(loop, diamond_states(loop, E, E), "affine")[0]
            return float(np.linalg.det(restrict(A, "diagonal")))

        eps = float(np.finfo(float).eps)
        exact = brentq(det, 0.0, 0.5 * (1.0 + strain), xtol=1e-15, rtol=4 * eps)
        root = abs(float(exact) - strain)
    return {
        "generic_vs_closed_form_max_relative": max(errors),
        **untrusted,
        "isotropic_vs_closed_form_max_relative": float(np.max(isotropic, initial=0.0)),
        "det_K_max_difference": float(np.max(np.abs(np.linalg.det(K) - found.det_K))),
        "bromwich_margin_min": float(np.min(bromwich_margin(K))),
        "det_K_zero_by_root_difference": root,
        "energy_balance_max_relative": energy_imbalance(found),
        "slope_at_A": slope_at_A(found),
        "states": len(K),
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
    closed = float(drained_slope(diamond_states(found.loop, confinement, confinement).K[0]))
    difference = float(abs(s1 / E1 - closed))
    return {"differences": float(s1 / E1), "closed_form": closed, "difference": difference}


def model_summary(found: FollowedDiamond) -> dict[str, Any]:
    """The model in words; with `--model full` its differences from the smallest model."""
    model = asdict(found.path.model)
    if found.options.model == "auto":
        return {**model, "check": None}
    small = follow_diamond(replace(found.options, model="auto"))
    differences = {}
    for name in (name for name in NAMED_STATES if name in found.marks and name in small.marks):
        ours, theirs = (
            np.array([values[path.marks[name]] for values in (path.E1, path.E2, path.s1, path.s2)])
            for path in (found, small)
        )
        differences[name] = float(np.abs(ours - theirs).max())
    check = {"status": found.path.status, "rows": len(found.path), "differences": differences}
    return {**model, "check": check}


def _notes(found: FollowedDiamond) -> list[str]:
    loop, touching, notes = found.loop, touching_strains(found.loop), []
    if min(touching) < 0.0:
        notes.append("opposite grains overlap from the start: below 30 or above 60 degrees")
    if abs(np.sin(loop.alpha0) - np.cos(loop.alpha0)) <= TOUCHING_ATOL:
        notes.append("at 45 degrees both pairs of opposite grains meet at once")
        if found.options.contact_on_touch == "add":
            notes.append("both contacts are added: their branches cross, the loop is not planar")
    if "A" not in found.marks:
        notes.append("the path ends where opposite grains meet, before A")
    for axis in (1, 2):
        # Between two rows by linear interpolation.
        gap = found.table[f"gap_{axis}"].to_numpy()
        for k in np.flatnonzero((gap[:-1] < -TOUCHING_ATOL) & (gap[1:] > TOUCHING_ATOL)):
            share = gap[k] / (gap[k] - gap[k + 1])
            parting = found.E1[k] + share * (found.E1[k + 1] - found.E1[k])
            notes.append(f"opposite grains on axis {axis} part at E1 = {parting:.6f}")
    if "B" in found.marks and found.det_Ks[found.marks["B"]] > 0.0:
        sliding = beyond_yield(found)
        if sliding is not None and sliding.det_Ks[0] < 0.0:
            notes.append("det K and det Ks jump below zero at B, where the contacts start to slide")
    return notes
