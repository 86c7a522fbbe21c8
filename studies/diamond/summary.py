"""The numbers that the diamond study comes down to."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from patterns.diamond import opposite_gaps
from stability import Verdict, judge, symmetric_part
from studies.diamond.added_contact import added_summary
from studies.diamond.events import ROUNDING, event_values, touching_strains
from studies.diamond.model import model_summary
from studies.diamond.operators import operators
from studies.diamond.parameters import DiamondParameters
from studies.diamond.path import DiamondPath, beyond_yield
from studies.diamond.sliding_rules import rules_summary
from studies.diamond.states import States
from studies.diamond.table import path_table, state_columns
from studies.diamond.verification import generic_tangent, verification

STATES = ("I", "A", "B")
STATE_VALUES = ("E1", "E2", "alpha_deg", "l", "N", "T", "s1", "s2", "det_K", "det_Ks")
ENERGIES = ("work", "stored", "dissipated")
DEFINITIONS = {
    "I": "first state of the confinement where det K = 0",
    "A": "end of the confinement, where the drained biaxial test starts",
    "B": "all four contacts reach |T| = mu N; the operators are those of the elastic path that "
    "arrives, 'beyond' holds those of sliding contacts",
    "E1, E2": "strains of the diagonals, 1 - L/L0",
    "s1, s2": "stresses F1/(kn L20), F2/(kn L10)",
    "N, T": "contact forces over kn l0; T positive when alpha grows",
    "l": "branch length over l0",
    "K": "tangent of s' = K E' (26); Kmat (27) from the contact law, Kgeo (28) from the stresses",
    "Ks": "symmetric part of K, which carries the second-order work",
    "cone": "strain rates of negative second-order work; angles from E1 towards E2, so that the "
    "paper's alphaE is 90 degrees less the angle; edges null where there is no cone",
    "generic": "tangent of any loop applied to the diamond, components 11, 12, 21, 22, spins "
    "blocked, over the bounding box; its verdict is on (11, 22, (12 + 21)/sqrt 2)",
    "gaps": "between opposite grains along axes 1 and 2, over l0; negative where they overlap",
    "work, stored, dissipated": "work from outside since the start, elastic energy of the "
    "contacts and heat of sliding, over kn and the reference volume L10 L20",
    "sliding_rules": "Coulomb's law, T' = s mu N' with s = sign(T), against (8c) as printed; "
    "shear_ratio is |T|/(mu N)",
    "added_contact": "intervals of isotropic strain over which Ks is positive definite, with "
    "opposite grains ignored and with a contact added where they meet",
}


def diamond_summary(path: DiamondPath) -> dict[str, Any]:
    """Summary of the study, without its provenance.

    Parameters
    ----------
    path : DiamondPath
        From `follow`.

    Returns
    -------
    dict
        `parameters`; `states` I, A and B, null where not reached; `events` in path order; `end`
        of the path; `model`; `verification`; `sliding_rules`, `added_contact`, null where they say
        nothing; `figures`, the paper's numbers and the files; `notes`; `definitions`.
    """
    rows = path_table(path)
    added = path.parameters.contact_on_touch == "add"
    return {
        "parameters": path.parameters.described(),
        "states": {name: state_summary(path, name) for name in STATES},
        "events": [
            {"kind": event.kind, **event_values(path.loop, path.states, event.row)}
            for event in path.events
        ],
        "end": {key: float(rows[key][-1]) for key in (*STATE_VALUES, *ENERGIES)},
        "model": model_summary(path),
        "verification": verification(path),
        "sliding_rules": rules_summary(path.parameters),
        "added_contact": added_summary(path.parameters) if added else None,
        "figures": figure_files(path.parameters, path.marks),
        "notes": _notes(path),
        "definitions": DEFINITIONS,
    }


def figure_files(parameters: DiamondParameters, marks: dict[str, int]) -> dict[str, str]:
    """Which file holds which figure of the paper.

    Parameters
    ----------
    parameters : DiamondParameters
        Table 2 has Figs. 8 and 9, any other diamond stands for Table 1 with Figs. 6 and 7.
    marks : dict
        Named states that the path reaches.

    Returns
    -------
    dict
        From the paper's figure number to a name without its ending.
    """
    stress, determinant = ("8", "9") if parameters.table == 2 else ("6", "7")
    polar = {"11": "polar"} if marks else {}
    return {
        "4": "path_dependence",
        stress: "axial_stress",
        determinant: "determinant",
        "10": "eigenvalues",
        **polar,
        "12": "cone",
    }


def state_summary(path: DiamondPath, name: str) -> dict[str, Any] | None:
    """A named state with its operators, spectra, cone and verdicts.

    Parameters
    ----------
    path : DiamondPath
        From `follow`.
    name : {'I', 'A', 'B'}
        Which state.

    Returns
    -------
    dict or None
        None where the path does not reach the state. B has a dictionary `beyond` too: the
        operators of sliding contacts.
    """
    if name not in path.marks:
        return None
    row = path.marks[name]
    here = path.states.take([row])
    found = {key: float(path_table(path)[key][row]) for key in STATE_VALUES}
    energies = {key: float(getattr(path, key)[row]) for key in ENERGIES}
    sliding = beyond_yield(path) if name == "B" else None
    beyond = {} if sliding is None else {"beyond": _operators(path, sliding)}
    return {**found, **_operators(path, here), **energies, "gaps": _gaps(path, here), **beyond}


def _operators(path: DiamondPath, state: States) -> dict[str, Any]:
    """Operators of one state, and what they tell."""
    found = operators(path.loop, state)
    columns = {key: values[0] for key, values in state_columns(state, found).items()}
    K = found.K[0]
    verdict = judge(K)
    return {
        "regime": str(state.regime[0]),
        "det_K": float(found.det_K[0]),
        "det_Ks": float(found.det_Ks[0]),
        "K": K,
        "Kmat": found.material[0],
        "Kgeo": found.geometric[0],
        "Ks": symmetric_part(K),
        "eigenvalues_K": _pairs(verdict.eigenvalues),
        "eigenvalues_Ks": verdict.symmetric_eigenvalues,
        "cone": {
            "status": str(columns["cone_status"]),
            "edges_deg": [float(columns["cone_edge_1_deg"]), float(columns["cone_edge_2_deg"])],
            "opening_deg": float(columns["cone_opening_deg"]),
            "axis_deg": float(columns["cone_axis_deg"]),
            "unstable_fraction": float(columns["unstable_fraction"]),
        },
        "verdict": _verdict(verdict),
        "generic": _generic(path, state),
    }


def _gaps(path: DiamondPath, state: States) -> list[float]:
    gaps = opposite_gaps(state.E1, state.E2, path.loop.alpha0)
    return [float(gap[0]) for gap in gaps]


def _generic(path: DiamondPath, state: States) -> dict[str, Any] | None:
    """The generic tangent; none where the printed rule leaves Coulomb's law."""
    if state.slip[0] * state.T[0] < 0.0:
        return None
    closure = path.parameters.closure
    tangent = generic_tangent(path.loop, state, closure)[0]
    return {
        "closure": closure,
        "tangent": tangent,
        "verdict": _verdict(judge(tangent, "symmetric")),
    }


def _verdict(verdict: Verdict) -> dict[str, Any]:
    return {
        "status": verdict.status,
        "mode": verdict.mode,
        "margin": verdict.margin,
        "tolerance": verdict.tolerance,
        "witness": verdict.witness,
    }


def _pairs(values: NDArray[np.complex128]) -> list[list[float]]:
    """Complex numbers as (real, imaginary)."""
    return [[float(value.real), float(value.imag)] for value in values]


def _notes(path: DiamondPath) -> list[str]:
    notes, loop, touching = [], path.loop, touching_strains(path.loop)
    if min(touching) < 0.0:
        notes.append("opposite grains overlap from the start: below 30 or above 60 degrees")
    if abs(np.sin(loop.alpha0) - np.cos(loop.alpha0)) <= ROUNDING:
        notes.append("at 45 degrees both pairs of opposite grains meet at once")
        if path.parameters.contact_on_touch == "add":
            notes.append("both contacts are added: their branches cross, the loop is not planar")
    if "A" not in path.marks:
        notes.append("the path ends where opposite grains meet, before A")
    parted = _parting(path)
    notes += [f"opposite grains on axis {axis} part at E1 = {E1:.6f}" for axis, E1 in parted]
    if "B" in path.marks and path.operators.det_Ks[path.marks["B"]] > 0.0:
        sliding = beyond_yield(path)
        if sliding is not None and operators(loop, sliding).det_Ks[0] < 0.0:
            notes.append("det K and det Ks jump below zero at B, where the contacts start to slide")
    return notes


def _parting(path: DiamondPath) -> list[tuple[int, float]]:
    """Where opposite grains that overlapped part again, between rows by linear interpolation."""
    gaps = opposite_gaps(path.states.E1, path.states.E2, path.loop.alpha0)
    found = []
    for axis, gap in enumerate(gaps, start=1):
        for k in np.flatnonzero((gap[:-1] < -ROUNDING) & (gap[1:] > ROUNDING)):
            share = gap[k] / (gap[k] - gap[k + 1])
            E1 = path.states.E1
            found.append((axis, float(E1[k] + share * (E1[k + 1] - E1[k]))))
    return found
