"""One loop followed through its programme: named states, operators, its tables and summary."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from loops import (
    ContactLaw,
    GrainGraph,
    InputError,
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
    BranchFraction,
    DirectionalWork,
    Event,
    PolarDiagram,
    Verdict,
    branch_fraction,
    directional_work,
    follow,
    judge,
    operator_norm,
    plane_cone,
    polar_diagram,
    restrict,
    spectrum,
    statuses,
    symmetric_part,
    symmetric_spectrum,
    unstable_fraction,
)
from stability import Path as LoopPath
from stability.path import describe
from studies.output import Columns, Summary, definitions, values_of
from studies.paths.options import DiamondOptions, LoopOptions, PolygonOptions, file_notes

SUBSPACES = ("diagonal", "symmetric", "full")
# Strains between which the threshold is bracketed: the first, the last, and their count.
FIRST_STRAIN = 1e-6
LAST_STRAIN = 0.99
BRACKETS = 100
# Parts in which they are tried.
STRAIN_PARTS = 9
# Ks is not definite if its smallest eigenvalue at the first load is at most this share of the norm.
DEFINITE_RTOL = 1e-12
# States named in every study: det K = 0 in the confinement, its end, the first yield.
NAMED = ("I", "A", "B")
# A path of so many steps is given up with the status `lost`.
PATH_STEPS = 2000
# Contacts are at yield if |T| lacks at most this share of mu N.
YIELD_RTOL = 1e-9
# Slopes of s1 over E1 up to this are zero.
SLOPE_ATOL = 1e-10
# Differences of E1 or s1 up to this are zero.
STEP_ATOL = 1e-12
# Directions of a polar diagram: one each half degree.
DIRECTIONS = 720
# Forces over kn l0 up to this are round-off.
FORCE_ATOL = 1e-12
# Radius of a polar diagram where the second-order work is zero: 2 + w2 lies between 1 and 3.
RADIUS = 2.0
# Degrees that rounding opens where a cone closes: the square root of some roundings.
CLOSED = 1e-5
# Share of a shear force that keeps its sign, and with it the side on which a contact slides.
SIGN_ALONE = 1e-200
# Grains with free spins up to which the parts of K are computed: their systems are not sparse.
MOST_SPLIT = 60
# Most numbers in a list column of a table, grains times rows.
MOST_NUMBERS = 100_000
REGIME_NAMES = np.array([regime.name.lower() for regime in Regime])


class Directions(NamedTuple):
    """Second-order work of a state in every direction of (11, 22), in the regimes it activates.

    `share` are shares of all directions, exact.
    """

    diagram: PolarDiagram
    work: DirectionalWork
    share: BranchFraction


@dataclass(frozen=True, eq=False)
class Followed:
    """A path of a loop; E1, E2 are H11, H22, and s1, s2 are P11, P22.

    `stages` are names; `marks` are rows by name; `K (R, 2, 2)` is the tangent in (11, 22), NaN
    where it is not known.
    """

    options: Any
    path: LoopPath
    stages: tuple[str, ...]
    marks: dict[str, int]
    K: Floats
    det_K: Floats
    det_Ks: Floats

    area: ClassVar[str] = "the barely touching polygon"

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
    def loaded(self) -> bool:
        """Whether a contact carries a force in any state; without one there is nothing to judge."""
        forces = np.abs([self.path.normal_force, self.path.shear_force])
        return bool(forces.max(initial=0.0) > FORCE_ATOL)

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

        >>> from studies.paths.options import PolygonOptions
        >>> from studies.paths.followed import follow_loop
        >>> found = follow_loop(PolygonOptions(6, closure="traction"), ("diagonal",))
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

    @cached_property
    def energies(self) -> dict[str, Floats]:
        """`work` from outside, `stored` in the contacts and `dissipated`, over kn and the area."""
        path = self.path
        stored = path.normal_energy + path.tangential_energy
        given = {"work": path.work[:, 0], "stored": stored, "dissipated": path.work[:, 3]}
        return {name: values / path.volume for name, values in given.items()}

    def broken(self, values: Floats) -> Floats:
        """One column or several with a NaN at each jump, which interrupts a drawn line."""
        return np.insert(np.asarray(values, dtype=float), self.jumps, np.nan, axis=0)

    @property
    def closure(self) -> Closure:
        """Closure under which directions are looked at."""
        return self.options.closure

    def graph_at(self, rows: Integers | slice | int) -> GrainGraph:
        """The loop at rows, with their forces and regimes."""
        path, graph = self.path, self.options.graph()
        forces = {name: getattr(path, name)[rows] for name in ("normal_force", "shear_force")}
        return GrainGraph(x=path.x[rows], x0=graph.x0, radii=graph.radii, contacts=path.contacts,
                          regime=path.regime[rows], **forces)  # fmt: skip

    def tangents(self, graph: GrainGraph, closure: Closure | None = None) -> Floats:
        """Tangents (..., 4, 4) of loops in the regimes that they carry."""
        o = self.options
        closure = closure or o.closure
        return macroscopic_tangent(graph, o.law(), closure, spins=o.spins, volume=o.volume).matrix

    def parts(self, graph: GrainGraph) -> tuple[Floats, Floats]:
        """Part of K that the contacts have without their forces, and what the forces add."""
        forces = {"normal_force": 0.0 * graph.normal_force,
                  "shear_force": SIGN_ALONE * graph.shear_force}  # fmt: skip
        bare = graph.replace(**forces, regime=graph.regime)
        material, K = (restrict(self.tangents(loop), "diagonal") for loop in (bare, graph))
        return material, K - material

    @cached_property
    def split(self) -> tuple[Floats, Floats]:
        """Parts (R, 2, 2) of K along the path, material and geometric; NaN where not computed."""
        if self.options.spins == "free" and len(self.path.x[0]) > MOST_SPLIT:
            return np.full_like(self.K, np.nan), np.full_like(self.K, np.nan)
        return self.parts(self.graph_at(slice(None)))

    @cached_property
    def directions(self) -> dict[str, Directions]:
        """Work in all directions at the named states, unless combinations of regimes are many."""
        directions, options = dict[str, Directions](), self.options
        for name, row in self.marks.items():
            graph, grid = self.graph_at(row), operator_diagram(self.K[row])
            about: Any = {"spins": options.spins, "volume": options.volume}
            about |= {"closure": self.closure, "regime": self.path.regime[row]}
            with suppress(InputError):
                work = directional_work(graph, options.law(), grid.direction, **about)
                share = branch_fraction(graph, options.law(), **about)
                diagram = operator_diagram(self.K[row], work.normalised[:, 0])
                directions[name] = Directions(diagram, work, share)
        return directions

    def sliding(self, name: str) -> GrainGraph | None:
        """A named state with all contacts at yield sliding; None if none is at yield."""
        edge = self.directions[name].work.edge if name in self.directions else None
        if edge is None or not edge.at_yield.any():
            return None
        regime = np.where(edge.at_yield, Regime.SLIDING, edge.regime)
        return self.graph_at(self.marks[name]).replace(regime=regime)

    def polar_table(self) -> Columns:
        """Normalised second-order work in every direction at the named states (45).

        `x, y` are points `(2 + w2) (cos alphaE, sin alphaE)`, `tan(alphaE) = E1'/E2'`.
        """
        names = ("state", "alphaE_deg", "w2", "x", "y", "regime", "solutions")
        none, ring = np.zeros(0), len(self.path.x[0])
        rows = [(none.astype(str), none, none, none, none, none.astype(str), none.astype(str))]
        for state, (diagram, work, _) in self.directions.items():
            slips = (work.regime == Regime.SLIDING).any(axis=1)
            opens = (work.regime[:, :ring] == Regime.OPEN).any(axis=1)
            kinds = [work.status == "none", slips, opens]
            regime = np.select(kinds, ["none", "sliding", "open"], "elastic")
            angle, (x, y) = np.degrees(diagram.angle), diagram.points.T
            states = np.full(len(angle), state)
            rows.append((states, angle, diagram.work, x, y, regime, work.status))
        return dict(zip(names, map(np.concatenate, zip(*rows, strict=True)), strict=True))

    def degrees(self, name: str) -> dict[str, float] | None:
        """Degrees of 360 with negative work, without and with several solutions, at a state."""
        kinds = ("unstable", "none", "several")
        if name not in self.directions:
            return None
        share = self.directions[name].share
        known = {f"{kind}_deg": 360.0 * float(getattr(share, kind)) for kind in kinds}
        return {kind: degrees if degrees > CLOSED else 0.0 for kind, degrees in known.items()}

    @cached_property
    def plane(self) -> Columns:
        """Spectra and cone in (11, 22) of every row, see `plane_columns`."""
        return plane_columns(self.K, self.det_K, self.det_Ks)

    @cached_property
    def subspaces(self) -> Columns:
        """`lambda_min_*` and `unstable_fraction_*` of every subspace at every row."""
        columns: dict[str, Floats] = {}
        for subspace in SUBSPACES:
            # Eigenvalues within the round-off of the norm are zero.
            K = restrict(self.path.A, subspace)
            values = symmetric_spectrum(K)
            values = np.where(np.abs(values) <= RTOL * operator_norm(K)[..., None], 0.0, values)
            columns[f"lambda_min_{subspace}"] = values[:, 0]
            columns[f"unstable_fraction_{subspace}"] = unstable_fraction(values)
        return columns

    @cached_property
    def critical(self) -> dict[str, float | None]:
        """Critical isotropic strain by subspace."""
        return thresholds(self.options)

    @cached_property
    def table(self) -> Columns:
        """Table of the path, one row per state; work is over `kn` and the reference area."""
        path, H, P = self.path, self.path.H, self.path.P
        columns: dict[str, Any] = {
            "stage": self.stage,
            "parameter": path.parameter,
            **{"E1": H[:, 0], "E2": H[:, 3], "H12": H[:, 1], "H21": H[:, 2]},
            **{"s1": P[:, 0], "s2": P[:, 3], "s12": P[:, 1], "s21": P[:, 2]},
            "N": path.normal_force,
            "T": path.shear_force,
            "regime": REGIME_NAMES[path.regime],
            "x": path.x[..., 0],
            "y": path.x[..., 1],
            **{f"A{a}_{b}": path.A[:, i, j] for i, a in enumerate(COMPONENTS)
               for j, b in enumerate(COMPONENTS)},
            **part_columns(**dict(zip(("Kmat", "Kgeo"), self.split, strict=True))),
            **self.plane,
            **self.subspaces,
            "work": self.energies["work"],
            "dissipated": self.energies["dissipated"],
            "energy_error": path.energy_error,
            "imbalance": path.imbalance,
        }  # fmt: skip
        rows = self.written_rows()
        return {name: np.asarray(column)[rows] for name, column in columns.items()}

    def written_rows(self) -> Integers:
        """Rows of the table: all of the path; of large loops ends of stages and a selection."""
        count, grains = self.path.x.shape[:2]
        most = max(MOST_NUMBERS // grains, 2)
        if count <= most:
            return np.arange(count)
        ends, picked = np.flatnonzero(np.diff(self.path.stage)), np.linspace(0, count - 1, most)
        return np.unique(np.concatenate([picked.astype(int), ends, ends + 1]))

    def tables(self) -> dict[str, Columns]:
        """Tables by name; none of a loop that takes no load."""
        return {"path": self.table, "polar": self.polar_table()} if self.loaded else {}

    def state(self, name: str) -> dict[str, Any]:
        """A named state with its operators, and those beyond it where contacts start to slide."""
        path, row, slides = self.path, self.marks[name], self.sliding(name)
        beyond = None
        if slides is not None and (slides.regime != path.regime[row]).any():
            values = self.operators(self.tangents(slides), slides)
            beyond = {"regime": REGIME_NAMES[slides.regime].tolist(), **values}
        return {
            **self.values_at(name),
            "N": path.normal_force[row],
            "T": path.shear_force[row],
            "regime": REGIME_NAMES[path.regime[row]].tolist(),
            **self.operators(path.A[row], self.graph_at(row)),
            "beyond": beyond,
            "directions": self.degrees(name),
        }

    def values_at(self, name: str) -> dict[str, float]:
        """Strains and stresses of a named state."""
        row = self.marks[name]
        return {key: float(getattr(self, key)[row]) for key in ("E1", "E2", "s1", "s2")}

    def operators(self, A: Floats, graph: GrainGraph) -> dict[str, Any]:
        """Operators of one state in (11, 22), and verdicts in every subspace."""
        K = restrict(A, "diagonal")
        determinants = np.linalg.det([[K], [symmetric_part(K)]])
        values = operator_values(K, self.parts(graph), determinants)
        return values | {"verdict": {name: verdict_values(judge(A, name)) for name in SUBSPACES}}

    def event(self, event: Event) -> dict[str, Any]:
        """An event as plain values; `subspace` is null where it depends on none."""
        places = event.H[0], event.H[3], event.P[0], event.P[3]
        return {
            "kind": event.kind,
            "subspace": event.subspace or None,
            **dict(zip(("E1", "E2", "s1", "s2"), places, strict=True)),
            "stage": self.stages[event.stage],
            "parameter": event.parameter,
            "contacts": list(event.contacts),
            "detail": describe(event),
        }

    def summary(self) -> Summary:
        """Summary without its provenance; `states` are null where not reached."""
        first = ("start",) if "start" in self.marks else ()
        states = dict[str, Any].fromkeys((*first, *NAMED))
        return {
            "parameters": self.options.described(),
            "reference_area": {"value": float(self.path.volume), "of": self.area},
            "states": states | {name: self.state(name) for name in self.marks},
            "model": self.model(),
            "verification": self.verification(),
            "notes": self.notes(),
            **self.further(),
        }

    def further(self) -> Summary:
        """Keys of the summary of a polygon alone."""
        path, loaded, reached = self.path, self.loaded, np.abs(self.E1).max()
        ended = "" if path.status == "finished" else f"; {path.message}"
        unloaded = "there is no path, the loop takes no load: no contact carries a force up to "
        return {
            "critical_strain": self.critical,
            "events": [self.event(event) for event in path.events if loaded],
            "peak": self.peak,
            "status": path.status if loaded or path.status != "finished" else "no_load",
            "message": path.message if loaded else f"{unloaded}E1 = {reached:.3g}{ended}",
            "rows": len(path) if loaded else 0,
            "definitions": definitions("polygon"),
        }

    def model(self) -> Summary:
        """Degrees of freedom."""
        return asdict(self.path.model)

    def verification(self) -> dict[str, Any]:
        """Critical strain on the path against its root, where passed; errors of energy, balance."""
        path, roots = self.path, self.critical if "A" in self.marks else {}
        # The first loss in the confinement, by subspace.
        met = {
            event.subspace: abs(float(event.H[0]) - root)
            for event in reversed(path.of_kind("det_Ks_zero"))
            if event.stage == 0 and (root := roots.get(event.subspace))
        }
        imbalance = path.imbalance
        return {
            "critical_strain_path_against_root": {name: met.get(name) for name in SUBSPACES},
            "energy_error_max": float(np.abs(path.energy_error).max()),
            "imbalance_max": float(np.nanmax(imbalance)) if np.isfinite(imbalance).any() else None,
        }

    def notes(self) -> list[str]:
        """Notes of the file and of the path."""
        path, rows, notes = self.path, self.loading, file_notes(self.options)
        if not self.loaded:
            return notes
        lost = [name for name, strain in self.critical.items() if strain == 0.0]
        notes += [f"unstable from the first load on in the subspace {name}" for name in lost]
        written, s1 = len(self.written_rows()), self.s1[rows]
        rises = len(rows) > 1 and s1.max() > s1[0] + STEP_ATOL
        known = {
            "no critical isotropic strain: isotropic strain changes this loop's shape; the events "
            "say where stability is lost on the path": not self.options.keeps_shape,
            f"the path ends early ({path.status}): {path.message}": path.status != "finished",
            f"no peak: s1 {'still rises at the end' if rises else 'falls from A on'}": (
                self.peak is None and len(rows) > 1
            ),
            "grains that are not in contact touch during the path and overlap from then on": (
                path.of_kind("opposite_contact")
            ),
            f"the table holds {written} of {len(path)} rows of the path": written < len(path),
            "other paths branch off: the path followed keeps the loop's symmetry": (
                path.of_kind("branching")
            ),
        }
        return [*notes, *(note for note, holds in known.items() if holds)]


def follow_loop(options: PolygonOptions, subspaces: tuple[str, ...] = SUBSPACES) -> Followed:
    """Confine a loop and load it; `marks` are I, A, B and end, of a snapshot's loop start too.

    Spectral events are of the subspaces. A loop that takes no load has no marks.

    >>> found = follow_loop(PolygonOptions(4, confine=0.2, end=0.25))
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
        followed = Followed(options, path, stages, marks, path.K, path.det_K, path.det_Ks)
    return followed if followed.loaded else replace(followed, marks={})


def follow_path(
    options: DiamondOptions | PolygonOptions,
    subspaces: tuple[str, ...] = ("diagonal",),
    **end: float,
) -> tuple[LoopPath, tuple[str, ...]]:
    """Path of a study, with the spectral events of every subspace, and the names of its stages."""
    names, stages = zip(*options.stages(**end), strict=True)
    graph = options.graph()
    path = follow(
        Scene(graph, options.law(), boundary_of(graph, volume=options.volume)),
        stages,
        subspace=subspaces,
        max_steps=PATH_STEPS,
        **values_of(options, "closure", "spins", "contact_on_touch", "rows", "model"),
    )
    return path, names


def first_yield(path: LoopPath, mu: Floats | float) -> Event | None:
    """First event at which contacts reach `|T| = mu N`, a control limit where it ends the path."""
    friction = np.broadcast_to(np.asarray(mu, dtype=float), path.regime.shape[1])
    for event in path.events:
        contacts, reached = list(event.contacts), event.kind == "yield"
        if event.kind == "control_limit" and contacts:
            N, T = (force[event.index, contacts] for force in (path.normal_force, path.shear_force))
            least = np.maximum(friction[contacts] * N * (1.0 - YIELD_RTOL), STEP_ATOL)
            reached = bool((np.abs(T) >= least).all())
        if reached:
            return event
    return None


def plane_columns(K: Floats, det_K: Floats, det_Ks: Floats) -> Columns:
    """Determinants, eigenvalues of Ks (ascending) and of K, verdict and cone in (11, 22).

    A cone that closes within the tolerance is a single direction, of opening 0.
    """
    values, symmetric, cone = spectrum(K), symmetric_spectrum(K), plane_cone(K)
    ray = cone.status == "ray"
    edges = np.degrees(np.where(ray[:, None], cone.axis[:, None], cone.edges))
    opening = np.degrees(np.where(ray, 0.0, cone.opening))
    columns = {
        "det_K": det_K,
        "det_Ks": det_Ks,
        "lambda_1": symmetric[:, 0],
        "lambda_2": symmetric[:, 1],
        **{f"eigenvalue_{k + 1}_{part}": getattr(values[:, k], part)
           for k in (0, 1) for part in ("real", "imag")},
        "status": statuses(symmetric[:, 0], operator_norm(K)),
        "cone_status": cone.status,
        "cone_opening_deg": opening,
        "cone_axis_deg": np.degrees(cone.axis),
        "cone_edge_1_deg": edges[:, 0],
        "cone_edge_2_deg": edges[:, 1],
        "unstable_fraction": opening / 180.0,
    }  # fmt: skip
    return columns


def part_columns(**parts: Floats) -> dict[str, Floats]:
    """Columns of operators (R, 2, 2) by their components."""
    return {f"{name}{i + 1}{j + 1}": part[:, i, j]
            for name, part in parts.items() for i in (0, 1) for j in (0, 1)}  # fmt: skip


def operator_values(
    K: Floats, parts: tuple[Floats, Floats], determinants: Floats
) -> dict[str, Any]:
    """Operators of one state with their spectra, cone and verdict in (11, 22).

    `determinants` (2, 1): Of K and of Ks.
    """
    columns, verdict = plane_columns(K[None], *determinants), judge(K)
    plane = {name: column[0] for name, column in columns.items()}
    return {
        **{name: float(plane[name]) for name in ("det_K", "det_Ks")},
        "K": K,
        "Kmat": parts[0],
        "Kgeo": parts[1],
        "Ks": symmetric_part(K),
        "eigenvalues_K": [[float(z.real), float(z.imag)] for z in verdict.eigenvalues],
        "eigenvalues_Ks": verdict.symmetric_eigenvalues,
        "cone": {
            "status": plane["cone_status"],
            "edges_deg": [float(plane[f"cone_edge_{k}_deg"]) for k in (1, 2)],
            **{f"{name}_deg": float(plane[f"cone_{name}_deg"]) for name in ("opening", "axis")},
            "unstable_fraction": float(plane["unstable_fraction"]),
        },
        "verdict": verdict_values(verdict),
    }


def verdict_values(verdict: Verdict) -> dict[str, Any]:
    """A verdict as plain values."""
    return values_of(verdict, "status", "mode", "margin", "tolerance", "witness")


def operator_diagram(K: Floats, work: Floats | None = None) -> PolarDiagram:
    """Polar diagram of one operator, or of a given second-order work along its directions.

    `w2 = 0` along directions that K annuls within the tolerance: there round-off has the sign.
    """
    diagram = polar_diagram(K, r=RADIUS, directions=DIRECTIONS)
    stress = np.einsum("ij,nj->ni", K, diagram.direction)
    annulled = np.linalg.norm(stress, axis=-1) <= RTOL * operator_norm(K)
    work = np.where(annulled, 0.0, diagram.work if work is None else work)
    outward = np.stack([np.cos(diagram.angle), np.sin(diagram.angle)], axis=-1)
    return PolarDiagram(diagram.angle, diagram.direction, work, (RADIUS + work)[:, None] * outward)


# ---- thresholds of a loop that keeps its shape


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
