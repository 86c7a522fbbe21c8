"""The study of polygons: a loop followed along its programme, and several orders side by side."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import brentq

from loops import (
    ContactLaw,
    GrainGraph,
    Regime,
    Scene,
    boundary_of,
    contact_state,
    macroscopic_tangent,
)
from loops.arrays import Flags, Floats, Integers
from loops.closures import Closure, Spins
from stability import (
    COMPONENTS,
    RTOL,
    Event,
    PolarDiagram,
    follow,
    judge,
    operator_norm,
    plane_cone,
    polar_diagram,
    restrict,
    spectrum,
    symmetric_spectrum,
    unstable_fraction,
)
from stability import Path as LoopPath
from stability.path import describe
from studies.output import Summary, definitions
from studies.paths.options import DiamondOptions, LoopOptions, PolygonOptions, file_notes

SUBSPACES = ("diagonal", "symmetric", "full")
# A tenth of the default tolerances of a path: strains and energies to 2e-15, for 5 % more steps.
TOLERANCES = {"rtol": 1e-13, "atol": 1e-15}
# A path of so many steps is given up with the status `lost`.
PATH_STEPS = 2000
# Contacts are at yield if |T| lacks at most this share of mu N.
YIELD_RTOL = 1e-9
# Slopes of s1 over E1 up to this are zero.
SLOPE_ATOL = 1e-10
# Differences of E1 or s1 up to this are zero.
STEP_ATOL = 1e-12
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
# Directions of a polar diagram: one each half degree.
DIRECTIONS = 720
# Radius of a polar diagram where the second-order work is zero: 2 + w2 lies between 1 and 3.
RADIUS = 2.0
# Most numbers in a list column of a table, grains times rows.
MOST_NUMBERS = 100_000


@dataclass(frozen=True, eq=False)
class Followed:
    """A path of a loop; E1, E2 are H11, H22, and s1, s2 are P11, P22.

    `stages` are names; `marks` are rows by name; `K (R, 2, 2)` is the tangent in (11, 22), NaN
    where it is not known.
    """

    options: DiamondOptions | PolygonOptions
    path: LoopPath
    stages: tuple[str, ...]
    marks: dict[str, int]
    K: Floats
    det_K: Floats
    det_Ks: Floats

    @property
    def E1(self) -> Floats:
        """(R,) H11."""
        return self.path.H[:, 0]

    @property
    def E2(self) -> Floats:
        """(R,) H22."""
        return self.path.H[:, 3]

    @property
    def s1(self) -> Floats:
        """(R,) P11."""
        return self.path.P[:, 0]

    @property
    def s2(self) -> Floats:
        """(R,) P22."""
        return self.path.P[:, 3]

    @cached_property
    def stage(self) -> NDArray[np.str_]:
        """(R,) name of each row's stage."""
        return np.array(self.stages)[self.path.stage]

    @cached_property
    def slides(self) -> Flags:
        """(R,) whether a contact slides."""
        return np.asarray((self.path.regime == Regime.SLIDING).any(axis=1))

    @cached_property
    def opens(self) -> Flags:
        """(R,) whether a contact of the loop has opened."""
        ring = self.path.regime[:, : len(self.path.x[0])]
        return (ring == Regime.OPEN).any(axis=1) & (np.arange(len(self.path)) > 0)

    @property
    def loading(self) -> Integers:
        """Rows of the programme that follows the confinement."""
        return np.flatnonzero(self.path.stage == len(self.stages) - 1)

    @cached_property
    def direction(self) -> Floats:
        """(R, 2) direction of the path `(E1', E2')`, of unit length; NaN where it stands still."""
        rate = self.path.H_rate[:, [0, 3]]
        size = np.linalg.norm(rate, axis=-1, keepdims=True)
        return rate / np.where(size > 0.0, size, np.nan)

    @cached_property
    def jumps(self) -> Integers:
        """Rows before which the regimes change and the operator jumps."""
        regime = self.path.regime
        return np.flatnonzero((regime[1:] != regime[:-1]).any(axis=1)) + 1

    @cached_property
    def peak(self) -> dict[str, float] | None:
        """Largest axial stress of the loading stage; None if s1 only falls, or rises to the end.

        It is a row where the response turns over at an event, else it lies between that row and its
        neighbour on the rising side, on the cubic through their values and slopes.

        >>> found = follow_polygon(PolygonOptions(6, closure="traction"), ("diagonal",))
        >>> round(found.peak["E1"], 6)
        0.132639
        """
        path, rows, s1 = self.path, self.loading, self.s1[self.loading]
        # A state recorded twice, before and after a change of regime, counts once.
        if len(rows) == 0 or s1.max() <= max(s1[0], s1[-1]) + STEP_ATOL:
            return None
        row = int(rows[np.argmax(s1)])
        at_row = {name: float(getattr(self, name)[row]) for name in ("E1", "E2", "s1")}
        rate = path.H_rate[row, 0]
        if abs(rate) < STEP_ATOL or abs(path.P_rate[row, 0] / rate) < SLOPE_ATOL:
            return at_row
        a, b = (row, row + 1) if path.P_rate[row, 0] > 0.0 else (row - 1, row)
        rates, E1 = path.H_rate[[a, b]], path.H[[a, b], 0]
        onward = E1[1] - E1[0] >= STEP_ATOL and (rates[:, 0] > STEP_ATOL).all()
        if path.stage[a] != path.stage[b] or not onward:
            return at_row
        # Loaded here: slow to import, and few paths need it.
        from scipy.interpolate import CubicHermiteSpline

        axial = CubicHermiteSpline(E1, path.P[[a, b], 0], path.P_rate[[a, b], 0] / rates[:, 0])
        lateral = CubicHermiteSpline(E1, path.H[[a, b], 3], rates[:, 3] / rates[:, 0])
        inner = [x for x in axial.derivative().roots(extrapolate=False) if np.isfinite(x)]
        if not inner:
            return at_row
        best = max(inner, key=lambda x: float(axial(x)))
        return {"E1": float(best), "E2": float(lateral(best)), "s1": float(axial(best))}

    @property
    def gaps(self) -> tuple[Floats, Floats] | None:
        """Gaps (R,) between opposite grains of a diamond; None for other loops."""
        return None

    def broken(self, values: Floats) -> Floats:
        """One column or several with a NaN at each jump, which interrupts a drawn line."""
        return np.insert(np.asarray(values, dtype=float), self.jumps, np.nan, axis=0)

    @cached_property
    def plane(self) -> pd.DataFrame:
        """Spectra and cone in (11, 22) of every row, see `plane_columns`."""
        return plane_columns(self.K, self.det_K, self.det_Ks)

    @cached_property
    def subspaces(self) -> pd.DataFrame:
        """`lambda_min_*` and `unstable_fraction_*` of every subspace at every row."""
        columns: dict[str, Floats] = {}
        for subspace in SUBSPACES:
            # Eigenvalues within the round-off of the norm are zero.
            K = restrict(self.path.A, subspace)
            values = symmetric_spectrum(K)
            values = np.where(np.abs(values) <= RTOL * operator_norm(K)[..., None], 0.0, values)
            columns[f"lambda_min_{subspace}"] = values[:, 0]
            columns[f"unstable_fraction_{subspace}"] = unstable_fraction(values)
        return pd.DataFrame(columns)


def follow_path(
    options: DiamondOptions | PolygonOptions, subspaces: tuple[str, ...] = ("diagonal",)
) -> tuple[LoopPath, tuple[str, ...]]:
    """Path of a study, with the spectral events of every subspace, and the names of its stages."""
    names, stages = zip(*options.stages(), strict=True)
    graph = options.graph()
    path = follow(
        Scene(graph, options.law(), boundary_of(graph, volume=options.volume)),
        stages,
        closure=options.closure,
        spins=options.spins,
        subspace=subspaces,
        contact_on_touch=options.contact_on_touch,
        **TOLERANCES,
        max_steps=PATH_STEPS,
        rows=options.rows,
        model=options.model,
    )
    return path, names


def plane_columns(K: Floats, det_K: Floats, det_Ks: Floats) -> pd.DataFrame:
    """Determinants, eigenvalues of Ks (ascending) and of K, and the instability cone in (11, 22).

    A cone that closes within the tolerance is a single direction, of opening 0.
    """
    values, symmetric, cone = spectrum(K), symmetric_spectrum(K), plane_cone(K)
    columns = {
        "det_K": det_K,
        "det_Ks": det_Ks,
        "lambda_1": symmetric[:, 0],
        "lambda_2": symmetric[:, 1],
        "eigenvalue_1_real": values[:, 0].real,
        "eigenvalue_1_imag": values[:, 0].imag,
        "eigenvalue_2_real": values[:, 1].real,
        "eigenvalue_2_imag": values[:, 1].imag,
        "cone_status": cone.status,
        "cone_opening_deg": np.degrees(np.where(cone.status == "ray", 0.0, cone.opening)),
        "cone_axis_deg": np.degrees(cone.axis),
    }
    return pd.DataFrame(columns)


def follow_polygon(options: PolygonOptions, subspaces: tuple[str, ...] = SUBSPACES) -> Followed:
    """Confine a polygon and load it; `marks` are A and end, of a loop of a snapshot start and end.

    Spectral events are of the subspaces.

    >>> found = follow_polygon(PolygonOptions(4, confine=0.2, end=0.25))
    >>> [(event.kind, event.subspace) for event in found.path.events][:3]
    [('det_Ks_zero', 'diagonal'), ('det_K_zero', 'diagonal'), ('det_Ks_zero', 'symmetric')]
    """
    path, stages = follow_path(options, subspaces)
    confined = np.flatnonzero(path.stage == 0)
    first = {"A": int(confined[-1])} if options.confine > 0.0 and len(confined) else {}
    if isinstance(options, LoopOptions):
        first = {"start": 0}
    marks = {**first, "end": len(path) - 1}
    with np.errstate(invalid="ignore"):
        return Followed(options, path, stages, marks, path.K, path.det_K, path.det_Ks)


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


def polygon_table(found: Followed) -> pd.DataFrame:
    """Table of a polygon's path, one row per state.

    `stage, parameter`; `E1, E2, H12, H21`; stresses `s1, s2, s12, s21`; lists `N, T, regime` by
    contact and `x, y` by grain; the tangent `A11_11 ..`; spectra and cone in (11, 22);
    `lambda_min_*` and `unstable_fraction_*` of every subspace; `work` from outside and `dissipated`
    over `kn` and the reference area, the path's `energy_error`, `imbalance`.
    """
    path, H, P = found.path, found.path.H, found.path.P
    names = np.array([regime.name.lower() for regime in Regime])
    columns: dict[str, Any] = {
        "stage": found.stage,
        "parameter": path.parameter,
        **{"E1": H[:, 0], "E2": H[:, 3], "H12": H[:, 1], "H21": H[:, 2]},
        **{"s1": P[:, 0], "s2": P[:, 3], "s12": P[:, 1], "s21": P[:, 2]},
        "N": list(path.normal_force),
        "T": list(path.shear_force),
        "regime": names[path.regime].tolist(),
        "x": list(path.x[..., 0]),
        "y": list(path.x[..., 1]),
        **{f"A{a}_{b}": path.A[:, i, j] for i, a in enumerate(COMPONENTS)
           for j, b in enumerate(COMPONENTS)},
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
    """Summary of the study, without its provenance; `states` are A and end."""
    path, options = found.path, found.options
    critical = thresholds(options)  # type: ignore[arg-type]
    peak, states = found.peak, dict[str, Any]()
    for name, row in found.marks.items():
        verdicts = {subspace: judge(path.A[row], subspace) for subspace in SUBSPACES}
        states[name] = {
            **{key: float(getattr(found, key)[row]) for key in ("E1", "E2", "s1", "s2")},
            "N": path.normal_force[row],
            "T": path.shear_force[row],
            "det_K": float(found.det_K[row]),
            "det_Ks": float(found.det_Ks[row]),
            "eigenvalues_Ks": path.symmetric_eigenvalues[row],
            "verdict": {
                subspace: {"status": one.status, "mode": one.mode, "margin": one.margin}
                for subspace, one in verdicts.items()
            },
        }
    return {
        "parameters": options.described(),
        "critical_strain": critical,
        "events": [event_values(found, event) for event in path.events],
        "peak": peak,
        "states": states,
        "status": path.status,
        "message": path.message,
        "rows": len(path),
        "model": asdict(path.model),
        "verification": _verification(found, critical),
        "notes": [*file_notes(options), *_notes(found, critical, peak)],
        "definitions": definitions("polygon"),
    }


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
        said = f"  {count} {'pairs' if pairs else 'contacts'}" if count else ""
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


def _notes(
    found: Followed, critical: dict[str, float | None], peak: dict[str, float] | None
) -> list[str]:
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


# ---- polar diagrams


def operator_diagram(K: Floats, work: Floats | None = None) -> PolarDiagram:
    """Polar diagram of one operator, or of a given second-order work along its directions.

    `w2 = 0` along directions that K annuls within the tolerance: where det K vanishes, round-off
    alone decides the sign of w2 in the kernel of K.
    """
    diagram = polar_diagram(K, r=RADIUS, directions=DIRECTIONS)
    stress = np.einsum("ij,nj->ni", K, diagram.direction)
    annulled = np.linalg.norm(stress, axis=-1) <= RTOL * operator_norm(K)
    work = np.where(annulled, 0.0, diagram.work if work is None else work)
    outward = np.stack([np.cos(diagram.angle), np.sin(diagram.angle)], axis=-1)
    return PolarDiagram(diagram.angle, diagram.direction, work, (RADIUS + work)[:, None] * outward)


def polygon_diagrams(found: Followed, critical: float | None) -> dict[str, PolarDiagram]:
    """Polar diagrams at the critical strain, if there is one, and at the named states."""
    operators = {name: found.K[row] for name, row in found.marks.items()}
    if critical:
        o: PolygonOptions = found.options  # type: ignore[assignment]
        loop, law = o.graph(critical), o.law()
        loop = loop.replace(normal_force=law.normal_force(contact_state(loop)))
        A = macroscopic_tangent(loop, law, o.closure, spins=o.spins).matrix
        operators = {"critical": restrict(A, "diagonal"), **operators}
    finite = {name: K for name, K in operators.items() if np.isfinite(K).all()}
    return {name: operator_diagram(K) for name, K in finite.items()}
