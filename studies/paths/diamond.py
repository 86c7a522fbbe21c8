"""The paper's diamond: the path to A (isotropic strain) and B (drained), its tables and summary.

Strains and shear forces are those of the path; operators follow by the paper's closed forms.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from loops import GrainGraph, Regime, contact_state
from loops.arrays import Floats
from loops.closures import Closure
from patterns.diamond import (
    DiamondParameters,
    diamond,
    isotropic_tangent,
    opposite_gaps,
)
from patterns.diamond.closed_form import (
    OPPOSITE,
    TOUCHING_ATOL,
    drained_slope,
    work_compress_then_shear,
    work_shear_then_compress,
)
from patterns.diamond.states import (
    DiamondStates,
    definite_intervals,
    diamond_states,
    touching_strains,
)
from stability import Path as LoopPath
from stability import (
    alpha_e,
    bromwich_margin,
    judge,
    normalised_second_order_work,
    operator_norm,
    restrict,
)
from studies.output import Columns, Summary
from studies.paths.followed import (
    NAMED,
    YIELD_RTOL,
    Followed,
    first_yield,
    follow_path,
    operator_values,
    part_columns,
    verdict_values,
)
from studies.paths.options import DiamondOptions

# Named states by the event at which each is reached.
NAMED_BY = {"det_K_zero": "I", "programme_change": "A", "yield": "B"}
# E1 up to which B is looked for.
LATEST = 0.99
DETERMINANTS = ("det_Ks_zero", "det_K_zero")
# Kinds of events in the summary; the remaining events of a path follow from these.
LISTED_KINDS = (
    "opposite_contact", *DETERMINANTS, "programme_change", "yield", "unloading", "opening",
    "control_limit",
)  # fmt: skip
# Compression of Fig. 4 if the confinement is zero.
COMPRESSION = 0.2
# Largest turn of the branch in Fig. 4.
LAST_ANGLE = np.pi / 4
ROUTES = {
    "shear_then_compress": ("shear", "compress"),
    "compress_then_shear": ("compress", "shear"),
}
# Columns of the comparison of paths with and without added contacts.
ADDED_COLUMNS = [
    "stage", "regime", "E1", "E2", "s1", "s2", "lambda_1", "lambda_2", "det_K", "det_Ks",
    "chord_1", "chord_2",
]  # fmt: skip
EVENT_VALUES = ("E1", "E2", "alpha_deg", "s1", "s2", "N", "T", "det_K", "det_Ks")
STATE_VALUES = ("E1", "E2", "alpha_deg", "l", "N", "T", "s1", "s2", "det_K", "det_Ks")


@dataclass(frozen=True, eq=False)
class FollowedDiamond(Followed):
    """A diamond's path; `marks` are I (det K = 0 in the confinement), A and B, where reached.

    `listed` are the events as (kind, row), every row the state as the path arrives there.
    """

    options: DiamondOptions
    states: DiamondStates
    listed: tuple[tuple[str, int], ...]

    area: ClassVar[str] = "L10 L20, twice the rhombus"

    @property
    def loop(self) -> DiamondParameters:
        """Shape, law and confinement."""
        return self.options.parameters

    @property
    def closure(self) -> Closure:
        """Affine: with the symmetry that the path keeps both closures are the same."""
        return "affine"

    @cached_property
    def gaps(self) -> tuple[Floats, Floats]:
        """Gaps (R,) between opposite grains on axis 1 and on axis 2, over l0."""
        return opposite_gaps(self.states.E1, self.states.E2, self.loop.alpha0)

    @property
    def split(self) -> tuple[Floats, Floats]:
        """Parts (R, 2, 2) of K, (27) and (28)."""
        return self.states.material, self.states.geometric

    @cached_property
    def beyond(self) -> DiamondStates | None:
        """State B with sliding contacts, as they are beyond it; None if the path has no B."""
        if "B" not in self.marks:
            return None
        row, states = self.marks["B"], self.states
        at = (states.E1[row], states.E2[row], states.T[row])
        return diamond_states(self.loop, *at, sliding=True, added=states.added[row])

    @cached_property
    def table(self) -> Columns:
        """Table of the path, one row per state; the cone's angles are from E1 towards E2."""
        direction, chords = self.direction, on_axes(self.path, self.path.normal_force)
        moves, states = np.isfinite(direction[:, 0]), self.states
        w2 = normalised_second_order_work(self.K, np.where(moves[:, None], direction, 1.0))
        alpha = alpha_e(np.arctan2(direction[:, 1], direction[:, 0]))
        names = ("regime", "E1", "E2", "alpha_deg", "l", "N", "T", "s1", "s2")
        values = (states.regime, states.E1, states.E2, np.degrees(states.alpha), states.length,
                  states.N, states.T, states.s1, states.s2)  # fmt: skip
        columns: dict[str, Any] = {
            "stage": self.stage,
            **dict(zip(names, values, strict=True)),
            **part_columns(K=states.K, Kmat=states.material, Kgeo=states.geometric),
            **self.plane,
            "loading_alphaE_deg": np.degrees(alpha),
            "w2_loading": np.where(moves, w2, np.nan),
            **{f"gap_{axis}": gap for axis, gap in enumerate(self.gaps, start=1)},
            **{f"chord_{axis}": chords[:, axis - 1] for axis in (1, 2)},
            **self.energies,
        }
        return columns

    @cached_property
    def ignored(self) -> FollowedDiamond | None:
        """The path without added contacts, if they are added."""
        if self.options.contact_on_touch != "add":
            return None
        return follow_diamond(replace(self.options, contact_on_touch="ignore"))

    def tables(self) -> dict[str, Columns]:
        """Every table by its name."""
        tables = {"path": self.table, "polar": self.polar_table()}
        tables["path_dependence"] = path_dependence_table(self.loop)
        if "A" in self.marks:
            tables |= {f"{name}_A": table for name, table in self.snapshot("A").items()}
        if self.ignored is not None:
            both = self.ignored.table, self.table
            joined = {key: np.concatenate([one[key] for one in both]) for key in ADDED_COLUMNS}
            opposite = np.repeat(["ignored", "added"], [len(one["E1"]) for one in both])
            tables["added_contact"] = {"opposite": opposite, **joined}
        return tables

    def snapshot(self, name: str) -> dict[str, Columns]:
        """A named state as the two tables of a plain snapshot, `grains` and `contacts`."""
        graph = self.graph_at(self.marks[name])
        closed, state, x = graph.regime != Regime.OPEN, contact_state(graph), graph.x
        branch, (i, j) = graph.branches[closed], graph.contacts[closed].T
        shear = (state.shear_force[:, None] * state.t)[closed]
        grains = {"id": np.arange(len(x)), "x": x[:, 0], "y": x[:, 1], "radius": 0.5}
        contacts = {
            **{"id1": i, "id2": j, "branch_x": branch[:, 0], "branch_y": branch[:, 1]},
            **{"fn": state.normal_force[closed], "fsx": shear[:, 0], "fsy": shear[:, 1]},
            **{"kn": 1.0, "ks": self.loop.kappa, "mu": self.loop.mu},
        }
        # Constants fill their columns.
        return {
            name: dict(zip(table, np.broadcast_arrays(*table.values()), strict=True))
            for name, table in (("grains", grains), ("contacts", contacts))
        }

    def state(self, name: str) -> dict[str, Any]:
        """A named state with its operators; B also as it is beyond, with sliding contacts."""
        row, beyond = self.marks[name], self.beyond if name == "B" else None
        values = {
            **{key: float(self.table[key][row]) for key in (*STATE_VALUES, *self.energies)},
            **self.closed_form(self.states.take([row]), self.graph_at(row)),
            "gaps": [float(gap[row]) for gap in self.gaps],
            "directions": self.degrees(name),
        }
        if beyond is not None:
            ring = np.arange(len(self.path.contacts)) < 4
            regime = np.where(ring, Regime.SLIDING, self.path.regime[row])
            values["beyond"] = self.closed_form(beyond, self.graph_at(row).replace(regime=regime))
        return values

    def closed_form(self, state: DiamondStates, graph: GrainGraph) -> dict[str, Any]:
        """Operators of one state with their spectra, cone and verdicts, and that of any loop."""
        closure, parts = self.options.closure, (state.material[0], state.geometric[0])
        A = self.tangents(graph, closure)
        generic = {"closure": closure, "tangent": A}
        return {
            "regime": state.regime[0],
            **operator_values(state.K[0], parts, np.stack([state.det_K, state.det_Ks])),
            "generic": generic | {"verdict": verdict_values(judge(A, "symmetric"))},
        }

    def further(self) -> Summary:
        """Keys of the summary of a diamond alone."""
        table, loop = self.table, self.loop
        # Files by the number of the paper's figure; those of Table 1 for other diamonds too.
        stress, determinant = ("8", "9") if self.options.table == 2 else ("6", "7")
        figures = {"4": "path_dependence", stress: "axial_stress", determinant: "determinant"}
        figures |= {"10": "eigenvalues", **({"11": "polar"} if self.marks else {}), "12": "cone"}
        added = {
            "touching_strains": list(touching_strains(loop)),
            "definite_ignored": definite_intervals(loop, added=False),
            "definite_added": definite_intervals(loop, added=True),
        }
        return {
            "events": [
                {"kind": kind, **{key: float(table[key][row]) for key in EVENT_VALUES}}
                for kind, row in self.listed
            ],
            "end": {key: float(table[key][-1]) for key in (*STATE_VALUES, *self.energies)},
            "added_contact": None if self.ignored is None else added,
            "figures": figures,
        }

    def model(self) -> Summary:
        """Degrees of freedom; with `--model full` the differences from the smallest model."""
        model: Summary = super().model() | {"check": None}
        if self.options.model == "full":
            small, differences = follow_diamond(replace(self.options, model="auto")), {}
            for name in (name for name in NAMED if name in self.marks and name in small.marks):
                full, least = self.values_at(name), small.values_at(name)
                differences[name] = max(abs(full[key] - least[key]) for key in full)
            check = {"status": self.path.status, "rows": len(self.path)}
            model["check"] = check | {"differences": differences}
        return model

    def verification(self) -> dict[str, Any]:
        """Differences of independent routes to the same numbers on a path.

        The operator of any loop against (26), (38) against (26), (35), (36) against the
        determinant, `min Re eig(K) - lambda_min(Ks)`, (41) against a root, work less stored energy
        and heat.
        """
        loop, states, K, norm = self.loop, self.states, self.K, operator_norm(self.K)
        graph, errors, untrusted = self.graph_at(slice(None)), [], {}
        for closure in get_args(Closure):
            generic = restrict(self.tangents(graph, closure), "diagonal")
            error = operator_norm(generic - K) / norm
            errors.append(float(np.nanmax(error)))
            untrusted[f"generic_{closure}_untrusted"] = int(np.count_nonzero(np.isnan(error)))
        rows = (self.stage == "isotropic") & ~states.added.any(axis=1) & ~states.sliding
        closed = isotropic_tangent(states.E1[rows], loop.alpha0, loop.kappa)
        isotropic = operator_norm(closed - K[rows]) / norm[rows]
        return {
            "generic_vs_closed_form_max_relative": max(errors),
            **untrusted,
            "isotropic_vs_closed_form_max_relative": float(np.max(isotropic, initial=0.0)),
            "det_K_max_difference": float(np.max(np.abs(np.linalg.det(K) - self.det_K))),
            "bromwich_margin_min": float(np.min(bromwich_margin(K))),
            "det_K_zero_by_root_difference": self.root_difference(),
            "energy_balance_max_relative": self.energy_imbalance(),
            "slope_at_A": self.slope_at_A(),
            "states": len(K),
        }

    def root_difference(self) -> float | None:
        """Difference of I from a root of det K under isotropic strain; None without I."""
        at_I, loop, eps = self.marks.get("I"), self.loop, float(np.finfo(float).eps)
        if at_I is None or loop.kappa == 0.0 or self.states.added[at_I].any():
            return None

        def det(E: float) -> float:
            A = self.tangents(diamond(loop.alpha0, E1=E, E2=E), "affine")
            return float(np.linalg.det(restrict(A, "diagonal")))

        strain = float(self.E1[at_I])
        exact = brentq(det, 0.0, 0.5 * (1.0 + strain), xtol=1e-15, rtol=4 * eps)
        return abs(float(exact) - strain)

    def energy_imbalance(self) -> float:
        """Largest `|work - stored - dissipated|` over the largest work; 0 on an unloaded path."""
        work, stored, heat = (self.energies[name] for name in ("work", "stored", "dissipated"))
        largest = float(np.max(np.abs(work)))
        return float(np.max(np.abs(work - stored - heat))) / largest if largest > 0.0 else 0.0

    def slope_at_A(self) -> dict[str, float] | None:
        """`ds1/dE1` where the drained test starts: of the path's own rates, and det K/K22 (33).

        None where A is not reached, or the path opens or slides at once.
        """
        rows, path = self.loading, self.path
        if "A" not in self.marks or len(self.stages) == 1 or self.loop.mu == 0.0 or not len(rows):
            return None
        rate = float(path.P_rate[rows[0], 0] / path.H_rate[rows[0], 0])
        closed = float(drained_slope(self.K[rows[0]]))
        return {"differences": rate, "closed_form": closed, "difference": abs(rate - closed)}

    def notes(self) -> list[str]:
        """Notes on grains that touch and part, and on the jump at B."""
        loop, beyond, notes = self.loop, self.beyond, list[str]()
        if min(touching_strains(loop)) < 0.0:
            notes.append("opposite grains overlap from the start: below 30 or above 60 degrees")
        if abs(np.sin(loop.alpha0) - np.cos(loop.alpha0)) <= TOUCHING_ATOL:
            notes.append("at 45 degrees both pairs of opposite grains touch at the same strain")
            if self.ignored is not None:
                notes.append(
                    "both contacts are added: their branches cross, the loop is not planar"
                )
        if "A" not in self.marks:
            notes.append("the path ends where opposite grains touch, before A")
        for axis, gap in enumerate(self.gaps, start=1):
            # Between two rows by linear interpolation.
            for k in np.flatnonzero((gap[:-1] < -TOUCHING_ATOL) & (gap[1:] > TOUCHING_ATOL)):
                share = gap[k] / (gap[k] - gap[k + 1])
                parting = self.E1[k] + share * (self.E1[k + 1] - self.E1[k])
                notes.append(f"opposite grains on axis {axis} separate at E1 = {parting:.6f}")
        if beyond is not None and self.det_Ks[self.marks["B"]] > 0.0 and beyond.det_Ks[0] < 0.0:
            notes.append("det K and det Ks jump below zero at B, where the contacts start to slide")
        return notes


def follow_diamond(options: DiamondOptions) -> FollowedDiamond:
    """Follow a diamond through the whole programme.

    >>> found = follow_diamond(DiamondOptions(table=1))
    >>> {name: round(float(found.E1[row]), 6) for name, row in found.marks.items()}
    {'I': 0.166667, 'A': 0.3, 'B': 0.409734}
    """
    (path, stages), loop = diamond_path(options), options.parameters
    added = on_axes(path, path.regime != Regime.OPEN) > 0.0
    states = diamond_states(
        *(loop, path.H[:, 0], path.H[:, 3], path.shear_force[:, 0]),
        sliding=path.regime[:, 0] == Regime.SLIDING,
        added=added,
        N=path.normal_force[:, 0],
        s1=path.P[:, 0],
        s2=path.P[:, 3],
    )
    touching = touching_strains(loop)
    listed, marks = list[tuple[str, int]](), dict[str, int]()
    for event in path.events:
        row = event.index
        if event.kind == "opposite_contact" and touching[event.contacts[0]] < 0.0:
            continue
        if event.kind not in LISTED_KINDS or event.jump or (event.kind, row) in listed:
            continue
        at_yield = abs(states.T[row]) >= loop.mu * states.N[row] * (1.0 - YIELD_RTOL)
        if event.kind == "control_limit" and event.contacts and at_yield:
            listed.append(("yield", row))
        listed.append((event.kind, row))
    # The state A is among the events however the path ends.
    if len(stages) == 1:
        listed += [("programme_change", 0), ("opening", 0)]
    elif min(loop.kappa, loop.mu) == 0.0:
        # Without shear stiffness or friction det K = -N/l: never positive.
        listed = [*((kind, 0) for kind in DETERMINANTS), *listed]
        if loop.mu == 0.0:
            at_A = next(k for k, (kind, _) in enumerate(listed) if kind == "programme_change")
            listed.insert(at_A + 1, ("yield", listed[at_A][1]))
    for kind, row in listed:
        name = NAMED_BY.get(kind)
        if name and name not in marks and (name != "I" or path.stage[row] == 0):
            marks[name] = row
    operators = states.K, states.det_K, states.det_Ks
    return FollowedDiamond(options, path, stages, marks, *operators, states, tuple(listed))


def diamond_path(options: DiamondOptions) -> tuple[LoopPath, tuple[str, ...]]:
    """Path and names of its stages; its end depends on B, which may lie beyond a first end."""
    (path, stages), mu = follow_path(options), options.parameters.mu
    if len(stages) == 1 or options.contact_on_touch == "add":
        return path, stages
    slipped, tried = first_yield(path, mu), options.last_strain()
    if slipped is None and path.status == "finished" and np.isfinite(mu):
        slipped = first_yield(follow_path(options, end=LATEST)[0], mu)
    last = options.last_strain(float(slipped.H[0]) if slipped else None)
    return (path, stages) if last == tried else follow_path(options, end=last)


def on_axes(path: LoopPath, values: NDArray[np.generic]) -> Floats:
    """(R, 2) values of the contacts added on axis 1 and on axis 2, zero where there is none."""
    columns = np.zeros((len(path), 2))
    for axis, grains in enumerate(OPPOSITE):
        here = np.flatnonzero((np.sort(path.contacts, axis=1) == grains).all(axis=1))
        columns[:, axis] = values[:, here].sum(axis=1)
    return columns


# ---- Fig. 4


def path_dependence_table(loop: DiamondParameters, angles: int = 46) -> Columns:
    """Fig. 4: work along both routes over the turn of the branch, (9), (10) and integrated.

    `kn = l0 = 1`, `kt = kappa`; the compression is the confinement, where there is one.
    """
    D = loop.confinement or COMPRESSION
    alpha = np.linspace(0.0, LAST_ANGLE, angles)
    columns = {
        "alpha_deg": np.degrees(alpha),
        "compression": np.full(angles, D),
        "shear_then_compress": work_shear_then_compress(1.0, alpha, D, 1.0, loop.kappa),
        "compress_then_shear": work_compress_then_shear(1.0, alpha, D, 1.0, loop.kappa),
    }
    for route, legs in ROUTES.items():
        # Integrate the rate law (8a), (8b) for all angles at once: length, N, T and work.
        y = np.stack([np.ones_like(alpha), *np.zeros((3, alpha.size))])
        for leg in legs:
            stretching, turning = (0.0, alpha) if leg == "shear" else (-D, 0.0)

            def slope(_: float, flat: Floats, a: float = stretching, b: Any = turning) -> Floats:
                length, N, T, _work = flat.reshape(4, -1)
                still = np.zeros_like(N)
                arc = length * b
                return np.concatenate([still + a, still - a, loop.kappa * arc, T * arc - N * a])

            way = solve_ivp(slope, (0.0, 1.0), y.ravel(), "DOP853", rtol=1e-12, atol=1e-14)
            y = way.y[:, -1].reshape(4, -1)
        columns[f"{route}_integrated"] = y[-1]
    return columns
