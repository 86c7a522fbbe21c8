"""The numbers that the diamond study comes down to."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stability import Verdict, judge, symmetric_part
from studies.diamond.events import ROUNDING, event_row, touching_strain
from studies.diamond.path import DiamondPath, path_table
from studies.diamond.verification import generic_tangent, verification

STATE_VALUES = ("E1", "E2", "alpha_deg", "l", "N", "T", "s1", "s2", "det_K", "det_Ks")
DEFINITIONS = {
    "I": "first state of the confinement where det K = 0",
    "A": "end of the confinement, where the drained biaxial test starts",
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
        `parameters`; `states` I and A, null where not reached; `events` in path order;
        `verification`; `notes`; `definitions`.
    """
    return {
        "parameters": path.parameters.described(),
        "states": {name: state_summary(path, name) for name in ("I", "A")},
        "events": [event_row(path.loop, event) for event in path.events],
        "verification": verification(path),
        "notes": _notes(path),
        "definitions": DEFINITIONS,
    }


def state_summary(path: DiamondPath, name: str) -> dict[str, Any] | None:
    """A named state with its operators, spectra, cone and verdicts.

    Parameters
    ----------
    path : DiamondPath
        From `follow`.
    name : {'I', 'A'}
        Which state.

    Returns
    -------
    dict or None
        None where the path does not reach the state.
    """
    if name not in path.marks:
        return None
    row = path.marks[name]
    here = {key: values[row] for key, values in path_table(path).items()}
    K = path.operators.K[row]
    verdict = judge(K)
    return {
        **{key: float(here[key]) for key in STATE_VALUES},
        "regime": str(here["regime"]),
        "K": K,
        "Kmat": path.operators.material[row],
        "Kgeo": path.operators.geometric[row],
        "Ks": symmetric_part(K),
        "eigenvalues_K": _pairs(verdict.eigenvalues),
        "eigenvalues_Ks": verdict.symmetric_eigenvalues,
        "cone": {
            "status": str(here["cone_status"]),
            "edges_deg": [float(here["cone_edge_1_deg"]), float(here["cone_edge_2_deg"])],
            "opening_deg": float(here["cone_opening_deg"]),
            "axis_deg": float(here["cone_axis_deg"]),
            "unstable_fraction": float(here["unstable_fraction"]),
        },
        "gaps": [float(here["gap_1"]), float(here["gap_2"])],
        "verdict": _verdict(verdict),
        "generic": _generic(path, row),
    }


def _generic(path: DiamondPath, row: int) -> dict[str, Any]:
    closure = path.parameters.closure
    tangent = generic_tangent(path.loop, path.states, closure)[row]
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
    notes, touch = [], touching_strain(path.loop)
    if touch < 0.0:
        notes.append("opposite grains overlap from the start: below 30 or above 60 degrees")
    if abs(np.sin(path.loop.alpha0) - np.cos(path.loop.alpha0)) <= ROUNDING:
        notes.append("at 45 degrees both pairs of opposite grains meet at once")
    if "A" not in path.marks:
        notes.append("the path ends where opposite grains meet, before A")
    return notes
