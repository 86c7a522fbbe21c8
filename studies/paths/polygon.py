"""Regular loops of any order: the path, its peak, its thresholds and what it comes down to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np
from scipy.optimize import brentq

from loops import ContactLaw, GrainGraph, contact_state, macroscopic_tangent
from loops.arrays import Floats
from loops.closures import Closure, Spins
from stability import Event, Path, judge, operator_norm, restrict, symmetric_spectrum
from studies.columns import definitions
from studies.paths.followed import SUBSPACES, Followed, follow_options
from studies.paths.options import PolygonOptions
from studies.paths.tables import table_rows

# Slopes of s1 over E1 below this, and steps of E1, are none.
FLAT, STILL = 1e-10, 1e-12
# Strains that are looked at before a root is refined: none beyond the last; so many together.
FIRST, LAST, COUNT, CHUNKS = 1e-6, 0.99, 100, 9
# What is printed of an event, and lines of them beyond which they are told by kind.
VALUES, MOST_LINES = ("E1", "E2", "s1", "s2"), 40
# A smallest eigenvalue at the first load that is not above this share of the norm is a loss.
LOST = 1e-12


def follow_polygon(options: PolygonOptions, subspaces: tuple[str, ...] = SUBSPACES) -> Followed:
    """Confine a polygon and load it; `marks` are A and end. Spectra are watched in the subspaces.

    >>> found = follow_polygon(PolygonOptions(4, confine=0.2, end=0.25))
    >>> [(event.kind, event.subspace) for event in found.path.events][:3]
    [('det_Ks_zero', 'diagonal'), ('det_K_zero', 'diagonal'), ('det_Ks_zero', 'symmetric')]
    """
    path = follow_options(options, subspaces)
    confined = np.flatnonzero(path.stage == 0)
    at_A = {"A": int(confined[-1])} if options.confine > 0.0 and len(confined) else {}
    marks = {**at_A, "end": len(path) - 1}
    with np.errstate(invalid="ignore"):
        return Followed(options, path, marks, path.K, path.det_K, path.det_Ks)


def described(found: Followed, event: Event) -> dict[str, Any]:
    """An event as plain values; `subspace` is null where it depends on none."""
    return {
        "kind": event.kind,
        "subspace": event.subspace or None,
        **dict(zip(VALUES, (event.H[0], event.H[3], event.P[0], event.P[3]), strict=True)),
        "stage": str(found.stage_names[event.stage]),
        "parameter": event.parameter,
        "contacts": list(event.contacts),
        "detail": event.detail,
    }


def axial_peak(found: Followed) -> dict[str, float] | None:
    """Largest axial stress of the loading stage; None if s1 only falls, or rises to the end.

    It is a row where the response turns over at an event, else it lies between two, on the cubic
    through their values and slopes.

    >>> found = follow_polygon(PolygonOptions(6, closure="traction"), ("diagonal",))
    >>> round(axial_peak(found)["E1"], 6)
    0.132639
    """
    rows = found.loading
    if len(rows) == 0:
        return None
    s1 = found.s1[rows]
    k = int(np.argmax(s1))
    # Rows twice recorded, before and after a change, are one.
    if s1[k] <= s1[0] + STILL or (s1[k] <= s1[-1] + STILL):
        return None
    row = int(rows[k])
    at_row = {"E1": found.E1[row], "E2": found.E2[row], "s1": found.s1[row]}
    return _between(found, row) or {name: float(value) for name, value in at_row.items()}


def _between(found: Followed, row: int) -> dict[str, float] | None:
    """The peak beside a row, on the side where s1 still rises; none if it is the row itself."""
    path = found.path
    rate = path.H_rate[row, 0]
    if abs(rate) < STILL or abs(path.P_rate[row, 0] / rate) < FLAT:
        return None
    a, b = (row, row + 1) if path.P_rate[row, 0] > 0.0 else (row - 1, row)
    rates, E1 = path.H_rate[[a, b]], path.H[[a, b], 0]
    if path.stage[a] != path.stage[b] or E1[1] - E1[0] < STILL or not (rates[:, 0] > STILL).all():
        return None
    # Slow to load, and a diamond needs none.
    from scipy.interpolate import CubicHermiteSpline

    axial = CubicHermiteSpline(E1, path.P[[a, b], 0], path.P_rate[[a, b], 0] / rates[:, 0])
    lateral = CubicHermiteSpline(E1, path.H[[a, b], 3], rates[:, 3] / rates[:, 0])
    inner = [x for x in axial.derivative().roots(extrapolate=False) if np.isfinite(x)]
    if not inner:
        return None
    best = max(inner, key=lambda x: float(axial(x)))
    return {"E1": float(best), "E2": float(lateral(best)), "s1": float(axial(best))}


# ---- isotropic thresholds


def thresholds(options: PolygonOptions) -> dict[str, float | None]:
    """Isotropic threshold by subspace; the confinement plays no part.

    None as well where isotropic strain doesn't keep the loop's shape.
    """
    law, o = options.law(), options
    if not o.keeps_shape:
        return dict.fromkeys(SUBSPACES)
    return {
        subspace: isotropic_threshold(o.graph, law, o.closure, o.spins, subspace)
        for subspace in SUBSPACES
    }


def isotropic_threshold(
    strained: Callable[[Floats | float], GrainGraph],
    law: ContactLaw,
    closure: Closure,
    spins: Spins = "blocked",
    subspace: str = "diagonal",
) -> float | None:
    """First isotropic strain at which Ks of a loop that keeps its shape isn't positive definite.

    0 where Ks is not definite from the first load on, None where it stays so up to `LAST`. A root
    is refined to 1e-15 where an eigenvalue changes sign between two of `COUNT` strains; one that is
    gained again between them is missed.

    >>> from loops import LinearFrictional
    >>> law = LinearFrictional(kn=1.0, kt=0.25)
    >>> pentagon = PolygonOptions(5).graph
    >>> isotropic_threshold(pentagon, law, "traction", "free")
    0.0
    >>> round(isotropic_threshold(pentagon, law, "traction"), 12)
    0.2
    """

    def smallest(strain: Floats | float) -> Floats:
        """Smallest eigenvalue of Ks over the norm of K; NaN where there is no single answer."""
        loop = strained(strain)
        loop = loop.replace(normal_force=law.normal_force(contact_state(loop)))
        K = restrict(macroscopic_tangent(loop, law, closure, spins=spins).matrix, subspace)
        norm = operator_norm(K)
        return np.asarray(symmetric_spectrum(K)[..., 0] / np.where(norm > 0.0, norm, 1.0))

    # The stiffness of spheres vanishes at touching: the first load, not none at all.
    if not float(smallest(FIRST)) > LOST:
        return 0.0
    below = FIRST
    for strains in np.array_split(np.linspace(0.0, LAST, COUNT)[1:], CHUNKS):
        lost = np.flatnonzero(~(smallest(strains) > 0.0))
        if len(lost):
            k = int(lost[0])
            return _root(smallest, below if k == 0 else float(strains[k - 1]), float(strains[k]))
        below = float(strains[-1])
    return None


def _root(smallest: Callable[[Floats | float], Floats], start: float, end: float) -> float | None:
    """Zero between two strains; none where an operator between them is not known."""
    if not np.isfinite(float(smallest(end))):
        return None
    return float(brentq(lambda E: float(smallest(E)), start, end, xtol=1e-15, rtol=1e-14))


# ---- summary


def polygon_summary(found: Followed) -> dict[str, Any]:
    """Summary of the study, without its provenance; `states` are A and end."""
    path, options = found.path, found.options
    critical = thresholds(options)  # type: ignore[arg-type]
    peak = axial_peak(found)
    return {
        "parameters": options.described(),
        "critical_strain": critical,
        "events": [described(found, event) for event in path.events],
        "peak": peak,
        "states": {name: _state(found, row) for name, row in found.marks.items()},
        "status": path.status,
        "message": path.message,
        "rows": len(path),
        "model": asdict(path.model),
        "verification": _verification(found, critical),
        "notes": _notes(found, critical, peak),
        "definitions": definitions("polygon"),
    }


def event_lines(summary: dict[str, Any]) -> list[str]:
    """One line for the events of a kind at one state; beyond `MOST_LINES` one for each kind.

    The loss of stability names its subspace; contacts, or pairs of grains that touch, are counted.
    """
    events = summary["events"]
    places = {(e["kind"], e["subspace"], *(f"{e[key]:.8f}" for key in VALUES)) for e in events}
    by_kind = len(places) > MOST_LINES
    groups: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for event in events:
        place = () if by_kind else tuple(f"{event[key]:.8f}" for key in VALUES)
        groups.setdefault((event["kind"], event["subspace"] or "", *place), []).append(event)
    return [_event_line(group) for group in groups.values()]


def _event_line(group: list[dict[str, Any]]) -> str:
    first, last = group[0], group[-1]
    pairs = first["kind"] == "opposite_contact"
    count = len(group) if pairs else sum(len(event["contacts"]) for event in group)
    values = []
    for key in VALUES:
        start, end = f"{first[key]:.8f}", f"{last[key]:.8f}"
        values.append(f"{key} = {start}" + (f" to {end}" if end != start else ""))
    said = f"  {count} {'pairs' if pairs else 'contacts'}" if count else ""
    return f"{first['kind']:<16} {first['subspace'] or '':<10} {'  '.join(values)}{said}"


def _state(found: Followed, row: int) -> dict[str, Any]:
    path = found.path
    verdicts = {subspace: judge(path.A[row], subspace) for subspace in SUBSPACES}
    return {
        **{name: float(getattr(found, name)[row]) for name in ("E1", "E2", "s1", "s2")},
        "N": path.normal_force[row],
        "T": path.shear_force[row],
        "det_K": float(found.det_K[row]),
        "det_Ks": float(found.det_Ks[row]),
        "eigenvalues_Ks": path.symmetric_eigenvalues[row],
        "verdict": {
            subspace: {"status": verdict.status, "mode": verdict.mode, "margin": verdict.margin}
            for subspace, verdict in verdicts.items()
        },
    }


def _verification(found: Followed, critical: dict[str, float | None]) -> dict[str, Any]:
    """Two routes to the critical strain where the confinement passes it; drift of the path."""
    path: Path = found.path
    differences: dict[str, float | None] = {}
    for subspace, wanted in critical.items():
        on_way = [
            float(path.H[event.index, 0])
            for event in path.events
            if (event.kind, event.subspace, event.stage) == ("det_Ks_zero", subspace, 0)
        ]
        known = bool(on_way and wanted and "A" in found.marks)
        differences[subspace] = abs(on_way[0] - (wanted or 0.0)) if known else None
    n = path.imbalance
    return {
        "critical_strain_path_against_root": differences,
        "energy_error_max": float(np.abs(path.energy_error).max()),
        "imbalance_max": float(np.nanmax(n)) if np.isfinite(n).any() else None,
    }


def _notes(
    found: Followed, critical: dict[str, float | None], peak: dict[str, float] | None
) -> list[str]:
    path, rows = found.path, found.loading
    lost = [name for name, strain in critical.items() if strain == 0.0]
    notes = [f"unstable from the first load on in the subspace {name}" for name in lost]
    if not found.options.keeps_shape:  # type: ignore[union-attr]
        notes.append(
            "no critical isotropic strain: isotropic strain changes this loop's shape; the events "
            "tell where stability is lost on the way"
        )
    if path.status != "finished":
        notes.append(f"the path ends early ({path.status}): {path.message}")
    if peak is None and len(rows) > 1:
        s1 = found.s1[rows]
        falls = s1.max() <= s1[0] + STILL
        notes.append("no peak: s1 " + ("falls from A on" if falls else "still rises at the end"))
    if path.of_kind("opposite_contact"):
        notes.append("grains without a contact touch on the way and overlap from there on")
    if len(table_rows(found)) < len(path):
        notes.append(f"the table holds {len(table_rows(found))} of {len(path)} rows of the path")
    if path.of_kind("branching"):
        notes.append("other paths branch off: the path followed keeps the loop's symmetry")
    return notes
