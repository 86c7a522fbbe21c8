"""The numbers that the polygon study comes down to."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from stability import judge
from studies.polygon.parameters import SUBSPACES, PolygonParameters
from studies.polygon.path import PolygonPath, determinants, found_events
from studies.polygon.peak import axial_peak
from studies.polygon.thresholds import LAST, critical_strain

DEFINITIONS = {
    "critical_strain": "isotropic strain at which Ks first loses definiteness in the subspace: 0 "
    f"where from the first load on, null where not below {LAST:g}",
    "diagonal, symmetric, full": "components (11, 22); (11, 22, (12 + 21)/sqrt 2); all four",
    "E1, E2": "H11 and H22, displacement gradient on the barely touching loop",
    "s1, s2": "nominal stress P11/kn and P22/kn over the area of the barely touching polygon",
    "A": "end of the isotropic strain, where the programme starts",
    "peak": "largest s1 on the stage after A, null if s1 only falls or still rises at its end",
    "K": "tangent of the regimes that the path arrives with",
    "model": "what was modelled, and how much of it the loop's symmetry left out: part of whole",
    "status": "of the path: finished, or why and where it ends before its target",
}


def polygon_summary(found: PolygonPath) -> dict[str, Any]:
    """Summary of the study, without its provenance.

    Parameters
    ----------
    found : PolygonPath
        From `follow_polygon`.

    Returns
    -------
    dict
        `parameters, critical_strain, events, peak, states` A and end, `status, message, rows,
        model, verification, notes, definitions`.
    """
    path = found.path
    critical = critical_strains(found.parameters)
    peak = axial_peak(found)
    return {
        "parameters": found.parameters.described(),
        "critical_strain": critical,
        "events": found_events(found),
        "peak": peak,
        "states": {name: _state(found, row) for name, row in found.marks.items()},
        "status": path.status,
        "message": path.message,
        "rows": len(path),
        "model": asdict(path.model),
        "verification": _verification(found, critical),
        "notes": _notes(found, critical, peak),
        "definitions": DEFINITIONS,
    }


def critical_strains(parameters: PolygonParameters) -> dict[str, float | None]:
    """Critical isotropic strain by subspace.

    Parameters
    ----------
    parameters : PolygonParameters
        The loop; its confinement plays no part.

    Returns
    -------
    dict
        See `thresholds.critical_strain`.
    """
    law, p = parameters.law(), parameters
    return {
        subspace: critical_strain(p.order, law, p.closure, p.spins, subspace, p.orientation)
        for subspace in SUBSPACES
    }


def _state(found: PolygonPath, row: int) -> dict[str, Any]:
    path = found.path
    det_K, det_Ks = determinants(path)
    verdicts = {subspace: judge(path.A[row], subspace) for subspace in SUBSPACES}
    return {
        "E1": float(path.H[row, 0]),
        "E2": float(path.H[row, 3]),
        "s1": float(path.P[row, 0]),
        "s2": float(path.P[row, 3]),
        "N": path.normal_force[row],
        "T": path.shear_force[row],
        "det_K": float(det_K[row]),
        "det_Ks": float(det_Ks[row]),
        "eigenvalues_Ks": path.symmetric_eigenvalues[row],
        "verdict": {
            subspace: {"status": verdict.status, "mode": verdict.mode, "margin": verdict.margin}
            for subspace, verdict in verdicts.items()
        },
    }


def _verification(found: PolygonPath, critical: dict[str, float | None]) -> dict[str, Any]:
    """Two routes to the critical strain where the confinement passes it; drift of the path."""
    differences: dict[str, float | None] = {}
    for subspace, path in found.paths.items():
        wanted = critical[subspace]
        on_way = [event for event in path.of_kind("det_Ks_zero") if event.stage == 0]
        known = bool(on_way and wanted and "A" in found.marks)
        there = float(path.H[on_way[0].index, 0]) if on_way else np.nan
        differences[subspace] = abs(there - (wanted or 0.0)) if known else None
    path, n = found.path, found.path.imbalance
    return {
        "critical_strain_path_against_root": differences,
        "energy_error_max": float(np.abs(path.energy_error).max()),
        "imbalance_max": float(np.nanmax(n)) if np.isfinite(n).any() else None,
    }


def _notes(
    found: PolygonPath, critical: dict[str, float | None], peak: dict[str, float] | None
) -> list[str]:
    lost = [name for name, strain in critical.items() if strain == 0.0]
    notes = [f"unstable from the first load on in the subspace {name}" for name in lost]
    if found.path.status != "finished":
        notes.append(f"the path ends early ({found.path.status}): {found.path.message}")
    rows = found.loading
    if peak is None and len(rows) > 1:
        s1 = found.path.P[rows, 0]
        falls = s1.max() <= s1[0] + 1e-12
        notes.append("no peak: s1 " + ("falls from A on" if falls else "still rises at the end"))
    if found.path.of_kind("opposite_contact"):
        notes.append("grains without a contact touch on the way and overlap from there on")
    if found.path.of_kind("branching"):
        notes.append("other paths branch off: the path followed keeps the loop's symmetry")
    return notes
