"""The study of polygons: a loop followed along its programme, its table and summary."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import brentq

from loops import ContactLaw, GrainGraph, Regime, contact_state, macroscopic_tangent
from loops.arrays import Floats, Integers
from loops.closures import Closure, Spins
from loops.shown import counted
from stability import (
    COMPONENTS,
    Event,
    judge,
    operator_norm,
    restrict,
    symmetric_part,
    symmetric_spectrum,
)
from stability.path import describe
from studies.output import Row, Summary, definitions, values_of
from studies.paths.followed import (
    NAMED,
    STEP_ATOL,
    SUBSPACES,
    Followed,
    first_yield,
    follow_path,
    operator_values,
    part_columns,
    verdict_values,
)
from studies.paths.options import ComparisonOptions, LoopOptions, PolygonOptions, file_notes

# Strains between which the threshold is bracketed: the first, the last, and their count.
FIRST_STRAIN = 1e-6
LAST_STRAIN = 0.99
BRACKETS = 100
# Parts in which they are tried.
STRAIN_PARTS = 9
# Values printed of an event.
EVENT_VALUES = ("E1", "E2", "s1", "s2")
# Lines of events, at most; beyond, one line for each kind.
MOST_LINES = 40
EVENT_WORDS = {
    "det_K_zero": "det K = 0",
    "det_Ks_zero": "det Ks = 0",
    "opposite_contact": "opposite grains touch",
    "programme_change": "next stage",
    "control_limit": "limit of the control",
}
# Ks is not definite if its smallest eigenvalue at the first load is at most this share of the norm.
DEFINITE_RTOL = 1e-12
# Most numbers in a list column of a table, grains times rows.
MOST_NUMBERS = 100_000
REGIME_NAMES = np.array([regime.name.lower() for regime in Regime])


def follow_polygon(options: PolygonOptions, subspaces: tuple[str, ...] = SUBSPACES) -> Followed:
    """Confine a polygon and load it; `marks` are I, A, B and end, of a snapshot's loop start too.

    Spectral events are of the subspaces. A loop that takes no load has no marks.

    >>> found = follow_polygon(PolygonOptions(4, confine=0.2, end=0.25))
    >>> [(event.kind, event.subspace) for event in found.path.events][:3]
    [('det_Ks_zero', 'diagonal'), ('det_K_zero', 'diagonal'), ('det_Ks_zero', 'symmetric')]
    """
    path, stages = follow_path(options, subspaces)
    marks, confined = dict[str, int](), np.flatnonzero(path.stage == 0)
    if isinstance(options, LoopOptions):
        marks["start"] = 0
    elif options.confine > 0.0 and len(confined):
        for event in path.of_kind("det_K_zero"):
            if (event.subspace, event.stage) == (subspaces[0], 0) and not event.jump:
                marks.setdefault("I", event.index)
        marks["A"] = int(confined[-1])
    slipped = first_yield(path, np.asarray(options.law().mu))
    if slipped is not None:
        marks["B"] = slipped.index
    marks["end"] = len(path) - 1
    with np.errstate(invalid="ignore"):
        found = Followed(options, path, stages, marks, path.K, path.det_K, path.det_Ks)
    return found if found.loaded else replace(found, marks={})


def event_values(found: Followed, event: Event) -> dict[str, Any]:
    """An event as plain values; `subspace` is null where it depends on none."""
    return {
        "kind": event.kind,
        "subspace": event.subspace or None,
        **dict(zip(EVENT_VALUES, (event.H[0], event.H[3], event.P[0], event.P[3]), strict=True)),
        "stage": found.stages[event.stage],
        "parameter": event.parameter,
        "contacts": list(event.contacts),
        "detail": describe(event),
    }


# ---- isotropic thresholds


def thresholds(options: PolygonOptions) -> dict[str, float | None]:
    """Isotropic threshold by subspace, from the barely touching loop on.

    Also None where isotropic strain does not keep the loop's shape.
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

    0 where Ks is not definite from the first load on, None where it stays so up to `LAST_STRAIN`.
    A root is refined to 1e-15 where an eigenvalue changes sign between two of `BRACKETS` strains;
    one that is gained again between them is missed.

    >>> from loops import boundary_of, LinearFrictional
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

    # Spheres have no stiffness where they just touch: take the first load instead.
    if not float(smallest(FIRST_STRAIN)) > DEFINITE_RTOL:
        return 0.0
    below = FIRST_STRAIN
    for strains in np.array_split(np.linspace(0.0, LAST_STRAIN, BRACKETS)[1:], STRAIN_PARTS):
        lost = np.flatnonzero(~(smallest(strains) > 0.0))
        if len(lost):
            k = int(lost[0])
            bracket = below if k == 0 else float(strains[k - 1]), float(strains[k])
            if not np.isfinite(float(smallest(bracket[1]))):
                return None
            return float(brentq(lambda E: float(smallest(E)), *bracket, xtol=1e-15, rtol=1e-14))
        below = float(strains[-1])
    return None


# ---- table and summary


def polygon_tables(found: Followed) -> dict[str, pd.DataFrame]:
    """Tables `path` and `polar`; none of a loop that takes no load."""
    if not found.loaded:
        return {}
    return {"path": polygon_table(found), "polar": found.polar_table()}


def polygon_table(found: Followed) -> pd.DataFrame:
    """Table of a polygon's path, one row per state; work is over `kn` and the reference area."""
    path, H, P = found.path, found.path.H, found.path.P
    columns: dict[str, Any] = {
        "stage": found.stage,
        "parameter": path.parameter,
        **{"E1": H[:, 0], "E2": H[:, 3], "H12": H[:, 1], "H21": H[:, 2]},
        **{"s1": P[:, 0], "s2": P[:, 3], "s12": P[:, 1], "s21": P[:, 2]},
        "N": list(path.normal_force),
        "T": list(path.shear_force),
        "regime": REGIME_NAMES[path.regime].tolist(),
        "x": list(path.x[..., 0]),
        "y": list(path.x[..., 1]),
        **{f"A{a}_{b}": path.A[:, i, j] for i, a in enumerate(COMPONENTS)
           for j, b in enumerate(COMPONENTS)},
        **part_columns(**dict(zip(("Kmat", "Kgeo"), found.split, strict=True))),
        **found.plane,
        **found.subspaces,
        "work": path.work[:, 0] / path.volume,
        "dissipated": path.work[:, 3] / path.volume,
        "energy_error": path.energy_error,
        "imbalance": path.imbalance,
    }  # fmt: skip
    return pd.DataFrame(columns).iloc[written_rows(found)]


def written_rows(found: Followed) -> Integers:
    """Rows of the table: all of the path, or for large loops the ends of stages and a selection."""
    count, grains = found.path.x.shape[:2]
    most = max(MOST_NUMBERS // grains, 2)
    if count <= most:
        return np.arange(count)
    ends = np.flatnonzero(np.diff(found.path.stage))
    return np.unique(np.concatenate([np.linspace(0, count - 1, most).astype(int), ends, ends + 1]))


def polygon_summary(found: Followed) -> Summary:
    """Summary of the study, without its provenance; `states` are I, A, B and end."""
    path, options = found.path, found.options
    critical = thresholds(options)  # type: ignore[arg-type]
    first = ("start",) if "start" in found.marks else ()
    peak, states = found.peak, dict[str, Any].fromkeys((*first, *NAMED))
    for name, row in found.marks.items():
        slides = found.sliding(name)
        state = states[name] = {
            **{key: float(getattr(found, key)[row]) for key in ("E1", "E2", "s1", "s2")},
            "N": path.normal_force[row],
            "T": path.shear_force[row],
            "regime": REGIME_NAMES[path.regime[row]].tolist(),
            **_operators(path.A[row], found.parts(found.graph_at(row))),
            "beyond": None,
            "directions": found.degrees(name),
        }
        if slides is not None and (slides.regime != path.regime[row]).any():
            beyond = _operators(found.tangents(slides), found.parts(slides))
            state["beyond"] = {"regime": REGIME_NAMES[slides.regime].tolist(), **beyond}
    loaded, status = found.loaded, path.status
    return {
        "parameters": options.described(),
        "reference_area": {"value": float(path.volume), "of": "the barely touching polygon"},
        "critical_strain": critical,
        "events": [event_values(found, event) for event in path.events if loaded],
        "peak": peak,
        "states": states,
        "status": status if loaded or status != "finished" else "no_load",
        "message": path.message if loaded else _no_path(found),
        "rows": len(path) if loaded else 0,
        "model": asdict(path.model),
        "verification": _verification(found, critical),
        "notes": [*file_notes(options), *_notes(found, critical, peak)],
        "definitions": definitions("polygon"),
    }


def _operators(A: Floats, parts: tuple[Floats, Floats]) -> dict[str, Any]:
    """Operators of one state in (11, 22), and verdicts in every subspace."""
    K = restrict(A, "diagonal")
    values = operator_values(K, parts, np.linalg.det([[K], [symmetric_part(K)]]))
    return values | {"verdict": {name: verdict_values(judge(A, name)) for name in SUBSPACES}}


def event_lines(summary: Summary) -> list[str]:
    """One line for the events of a kind at one state; beyond `MOST_LINES` one for each kind.

    The loss of stability names its subspace; contacts, or pairs of grains that touch, are counted.
    """
    events = summary["events"]
    places = {
        (e["kind"], e["subspace"], *(f"{e[key]:.8f}" for key in EVENT_VALUES)) for e in events
    }
    by_kind = len(places) > MOST_LINES
    groups: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for event in events:
        place = () if by_kind else tuple(f"{event[key]:.8f}" for key in EVENT_VALUES)
        groups.setdefault((event["kind"], event["subspace"] or "", *place), []).append(event)
    lines = []
    for group in groups.values():
        first, last = group[0], group[-1]
        pairs = first["kind"] == "opposite_contact"
        count = len(group) if pairs else sum(len(event["contacts"]) for event in group)
        values = []
        for key in EVENT_VALUES:
            start, end = f"{first[key]:.8f}", f"{last[key]:.8f}"
            values.append(f"{key} = {start}" + (f" to {end}" if end != start else ""))
        said = f"  {counted(count, 'pair' if pairs else 'contact')}" if count else ""
        kind, subspace = event_words(first["kind"]), first["subspace"] or ""
        lines.append(f"{kind:<22} {subspace:<10} {'  '.join(values)}{said}")
    return lines


def event_words(kind: str) -> str:
    """A kind of event as it is printed."""
    return EVENT_WORDS.get(kind, kind.replace("_", " "))


def _verification(found: Followed, critical: dict[str, float | None]) -> dict[str, Any]:
    """Critical strain on the path against its root, where passed; errors of energy and balance."""
    path = found.path
    differences: dict[str, float | None] = {}
    for subspace, wanted in critical.items():
        on_way = [
            float(path.H[event.index, 0])
            for event in path.events
            if (event.kind, event.subspace, event.stage) == ("det_Ks_zero", subspace, 0)
        ]
        known = bool(on_way and wanted and "A" in found.marks)
        differences[subspace] = abs(on_way[0] - (wanted or 0.0)) if known else None
    imbalance = path.imbalance
    return {
        "critical_strain_path_against_root": differences,
        "energy_error_max": float(np.abs(path.energy_error).max()),
        "imbalance_max": float(np.nanmax(imbalance)) if np.isfinite(imbalance).any() else None,
    }


def _no_path(found: Followed) -> str:
    """Why a loop has no path."""
    said = f"no contact carries a force up to E1 = {np.abs(found.E1).max():.3g}"
    ended = "" if found.path.status == "finished" else f"; {found.path.message}"
    return f"there is no path, the loop takes no load: {said}{ended}"


def _notes(
    found: Followed, critical: dict[str, float | None], peak: dict[str, float] | None
) -> list[str]:
    if not found.loaded:
        return []
    path, rows = found.path, found.loading
    lost = [name for name, strain in critical.items() if strain == 0.0]
    notes = [f"unstable from the first load on in the subspace {name}" for name in lost]
    if not found.options.keeps_shape:  # type: ignore[union-attr]
        notes.append(
            "no critical isotropic strain: isotropic strain changes this loop's shape; the events "
            "say where stability is lost on the path"
        )
    if path.status != "finished":
        notes.append(f"the path ends early ({path.status}): {path.message}")
    if peak is None and len(rows) > 1:
        s1 = found.s1[rows]
        falls = s1.max() <= s1[0] + STEP_ATOL
        notes.append("no peak: s1 " + ("falls from A on" if falls else "still rises at the end"))
    if path.of_kind("opposite_contact"):
        notes.append(
            "grains that are not in contact touch during the path and overlap from then on"
        )
    if len(written_rows(found)) < len(path):
        notes.append(f"the table holds {len(written_rows(found))} of {len(path)} rows of the path")
    if path.of_kind("branching"):
        notes.append("other paths branch off: the path followed keeps the loop's symmetry")
    return notes


@dataclass(frozen=True, eq=False)
class Compared:
    """Loops of several orders, followed; `loops` holds a row of plain values of each."""

    options: ComparisonOptions
    found: tuple[Followed, ...]
    loops: tuple[dict[str, Any], ...]

    @cached_property
    def table(self) -> pd.DataFrame:
        """One row per order; NaN where a loop has no such state."""
        rows = []
        for loop in self.loops:
            row: Row = {"order": loop["order"]}
            for subspace, strain in loop["critical_strain"].items():
                row[f"critical_strain_{subspace}"] = np.nan if strain is None else strain
            for name in ("first_yield", "peak"):
                values = loop[name] or {}
                row |= {f"{name}_{key}": values.get(key, np.nan) for key in ("E1", "E2", "s1")}
            rows.append(row | {"end_E1": loop["end"]["E1"], "status": loop["status"]})
        return pd.DataFrame(rows)

    def curves(self) -> pd.DataFrame:
        """Strains, stresses, determinants and smallest eigenvalue of Ks along every path."""
        tables, names = [], ("E1", "E2", "s1", "s2", "det_K", "det_Ks")
        for order, found in zip(self.options.orders, self.found, strict=True):
            columns: dict[str, Any] = {"order": order, "stage": found.stage}
            columns |= {name: getattr(found, name) for name in names}
            columns["lambda_min"] = found.path.symmetric_eigenvalues[:, 0]
            tables.append(pd.DataFrame(columns))
        return pd.concat(tables, ignore_index=True)

    def summary(self) -> Summary:
        """Summary of the study, without its provenance."""
        early = [str(loop["order"]) for loop in self.loops if loop["status"] != "finished"]
        notes = [f"paths that end before their target: orders {', '.join(early)}"] if early else []
        return {
            "parameters": self.options.described(),
            "loops": list(self.loops),
            "notes": notes,
            "definitions": definitions("polygon", "compare"),
        }


def compare_orders(options: ComparisonOptions) -> Compared:
    """Follow a loop of every order."""
    found, rows = [], []
    for order in options.orders:
        one = follow_polygon(options.of(order), ("diagonal",))
        slipped = first_yield(one.path, np.asarray(one.options.law().mu))
        row = {
            "order": order,
            "critical_strain": thresholds(options.of(order)),
            "first_yield": event_values(one, slipped) if slipped and one.loaded else None,
            "peak": one.peak,
            **values_of(one.path, "status", "message"),
            "end": {name: float(getattr(one, name)[-1]) for name in ("E1", "E2", "s1")},
        }
        found.append(one)
        rows.append(row)
    return Compared(options, tuple(found), tuple(rows))
