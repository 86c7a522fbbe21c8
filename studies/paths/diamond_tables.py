"""Tables and summary of the diamond study: polar diagrams, Fig. 4, added contacts, states."""

from __future__ import annotations

from dataclasses import asdict, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from loops import LinearFrictional, Regime, macroscopic_tangent
from loops.arrays import Floats
from patterns.diamond import (
    DiamondParameters,
    critical_strain,
    diamond,
    drained_path,
    drained_states_after_turn,
    isotropic_tangent,
    opposite_gaps,
)
from patterns.diamond.closed_form import (
    drained_slope,
    work_compress_then_shear,
    work_shear_then_compress,
)
from stability import (
    Verdict,
    bromwich_margin,
    judge,
    operator_norm,
    restrict,
    symmetric_part,
    symmetric_spectrum,
)
from studies.output import definitions
from studies.paths.diamond import (
    OPPOSITE,
    TOUCHING_ATOL,
    DiamondStates,
    FollowedDiamond,
    diamond_states,
    follow_diamond,
    state_columns,
    touching_strains,
)

# Compression of Fig. 4 if the confinement is zero, and its largest turn of the branch.
COMPRESSION, LAST_ANGLE = 0.2, np.pi / 4
ROUTES = {
    "shear_then_compress": ("shear", "compress"),
    "compress_then_shear": ("compress", "shear"),
}
# Columns of the comparison of paths with and without added contacts.
ADDED_COLUMNS = [
    "stage", "regime", "E1", "E2", "s1", "s2", "lambda_1", "lambda_2", "det_K", "det_Ks",
    "chord_1", "chord_2",
]  # fmt: skip
# Strains of a curve between two meetings of opposite grains.
CURVE_STRAINS = 401
NAMED_STATES = ("I", "A", "B")
EVENT_VALUES = ("E1", "E2", "alpha_deg", "s1", "s2", "N", "T", "det_K", "det_Ks")
STATE_VALUES = ("E1", "E2", "alpha_deg", "l", "N", "T", "s1", "s2", "det_K", "det_Ks")


def diamond_tables(
    found: FollowedDiamond, ignored: FollowedDiamond | None
) -> dict[str, pd.DataFrame]:
    """Every table by its name; `ignored` is the path without added contacts, if they are added."""
    tables = {
        "path": found.table,
        "polar": polar_table(found),
        "path_dependence": path_dependence_table(found.loop),
    }
    if "A" in found.marks:
        loop = snapshot_tables(found, found.marks["A"])
        tables |= {f"{name}_A": table for name, table in loop.items()}
    if ignored is not None:
        both = {"ignored": ignored.table[ADDED_COLUMNS], "added": found.table[ADDED_COLUMNS]}
        joined = pd.concat(both, names=["opposite"])
        tables["added_contact"] = joined.reset_index("opposite").reset_index(drop=True)
    return tables


def snapshot_tables(found: FollowedDiamond, row: int) -> dict[str, pd.DataFrame]:
    """The loop at a row as the two tables of a plain snapshot, `grains` and `contacts`."""
    path = found.path
    closed = np.flatnonzero(path.regime[row] != Regime.OPEN)
    x, (i, j) = path.x[row], path.contacts[closed].T
    branch = x[j] - x[i]
    normal = branch / np.linalg.norm(branch, axis=1, keepdims=True)
    tangent = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
    shear = path.shear_force[row, closed][:, None] * tangent
    grains = {"id": np.arange(len(x)), "x": x[:, 0], "y": x[:, 1], "radius": 0.5}
    contacts = {
        "id1": i,
        "id2": j,
        "branch_x": branch[:, 0],
        "branch_y": branch[:, 1],
        "fn": path.normal_force[row, closed],
        "fsx": shear[:, 0],
        "fsy": shear[:, 1],
        "kn": 1.0,
        "ks": found.loop.kappa,
        "mu": found.loop.mu,
    }
    return {"grains": pd.DataFrame(grains), "contacts": pd.DataFrame(contacts)}


# ---- polar diagrams


def polar_table(found: FollowedDiamond) -> pd.DataFrame:
    """Normalised second-order work in every direction at the named states (45).

    `alphaE_deg`, `tan(alphaE) = E1'/E2'`; `w2`; `x, y`, the points of the polar diagram,
    `(2 + w2) (cos alphaE, sin alphaE)`; `regime` that the direction activates.
    """
    none = {"state": np.array([], dtype=str), "alphaE_deg": np.zeros(0), "w2": np.zeros(0)}
    none |= {"x": np.zeros(0), "y": np.zeros(0), "regime": np.array([], dtype=str)}
    tables = []
    for name, (diagram, slides) in found.diagrams.items():
        columns: dict[str, Any] = {"state": name, "alphaE_deg": np.degrees(diagram.angle)}
        columns |= {"w2": diagram.work, "x": diagram.points[:, 0], "y": diagram.points[:, 1]}
        columns["regime"] = np.where(slides, "sliding", "elastic")
        tables.append(pd.DataFrame(columns))
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame(none)


# ---- Fig. 4


def path_dependence_table(loop: DiamondParameters, angles: int = 46) -> pd.DataFrame:
    """Fig. 4: work along both routes over the turn of the branch, (9), (10) and integrated.

    `kn = l0 = 1`, `kt = kappa`; the compression is the confinement, where there is one.
    """
    D = loop.confinement or COMPRESSION
    alpha = np.linspace(0.0, LAST_ANGLE, angles)
    columns = {
        "alpha_deg": np.degrees(alpha),
        "compression": D,
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

            found = solve_ivp(slope, (0.0, 1.0), y.ravel(), "DOP853", rtol=1e-12, atol=1e-14)
            y = found.y[:, -1].reshape(4, -1)
        columns[f"{route}_integrated"] = y[-1]
    return pd.DataFrame(columns)


# ---- contacts added between opposite grains


def added_summary(loop: DiamondParameters) -> dict[str, Any]:
    """Strains between which the diamond is stable under isotropic strain, without and with."""
    return {
        "touching_strains": list(touching_strains(loop)),
        "definite_ignored": definite_intervals(loop, added=False),
        "definite_added": definite_intervals(loop, added=True),
    }


def added_critical_strain(loop: DiamondParameters, added: tuple[bool, bool]) -> float:
    """Isotropic strain at which `det K` vanishes with contacts on axis 1, on axis 2.

    From (40) with `1/tan(alpha0)` added to K11 and `tan(alpha0)` to K22. With both it is
    `(1 + kappa)/(2 + kappa)` whatever the angle: that of the triangle.
    """
    cos2, sin2 = np.cos(loop.alpha0) ** 2, np.sin(loop.alpha0) ** 2
    reserve = {
        (False, False): 0.0,
        (True, False): sin2 / (1.0 + cos2),
        (False, True): cos2 / (1.0 + sin2),
        (True, True): 1.0,
    }[added]
    return float(critical_strain(loop.kappa + reserve))


def definite_intervals(loop: DiamondParameters, *, added: bool) -> list[tuple[float, float]]:
    """Isotropic strains over which Ks is positive definite, in rising order."""
    found: list[tuple[float, float]] = []
    for start, end, contacts in _between_meetings(loop, 1.0, added):
        end = min(end, added_critical_strain(loop, contacts))
        if end > start:
            joined = found and found[-1][1] == start
            found[-1:] = [(found[-1][0], end)] if joined else [*found[-1:], (start, end)]
    return found


def isotropic_eigenvalues(loop: DiamondParameters, *, added: bool) -> tuple[Floats, Floats]:
    """Strains (n,) and eigenvalues of Ks (n, 2) under isotropic strain, past the last stable one.

    NaN separates the parts of the path where a contact is added.
    """
    last = 1.05 * definite_intervals(loop, added=True)[-1][1]
    strains, eigenvalues = [], []
    for start, end, contacts in _between_meetings(loop, last, added):
        E = np.linspace(start, end, CURVE_STRAINS)
        K = diamond_states(loop, E, E, added=contacts).K
        strains += [E, np.full(1, np.nan)]
        eigenvalues += [symmetric_spectrum(K), np.full((1, 2), np.nan)]
    return np.concatenate(strains), np.concatenate(eigenvalues)


def _between_meetings(
    loop: DiamondParameters, last: float, added: bool
) -> list[tuple[float, float, tuple[bool, bool]]]:
    """Start and end of each part of the isotropic path, and the contacts added on axis 1 and 2."""
    on1, on2 = touching_strains(loop)
    meetings = sorted({E for E in (on1, on2) if 0.0 < E < last}) if added else []
    return [
        (start, end, (added and on1 <= start, added and on2 <= start))
        for start, end in pairwise([0.0, *meetings, last])
    ]


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
    if name == "B" and found.beyond is not None:
        beyond = found.beyond
        state["beyond"] = _operators(found, beyond, state_columns(beyond).iloc[0])
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
    heat; `slope_at_A`: see the function of that name.
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
    """Degrees of freedom; with `--model full` the differences from the smallest model."""
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
        notes.append("at 45 degrees both pairs of opposite grains touch at the same strain")
        if found.options.contact_on_touch == "add":
            notes.append("both contacts are added: their branches cross, the loop is not planar")
    if "A" not in found.marks:
        notes.append("the path ends where opposite grains touch, before A")
    for axis in (1, 2):
        # Between two rows by linear interpolation.
        gap = found.table[f"gap_{axis}"].to_numpy()
        for k in np.flatnonzero((gap[:-1] < -TOUCHING_ATOL) & (gap[1:] > TOUCHING_ATOL)):
            share = gap[k] / (gap[k] - gap[k + 1])
            parting = found.E1[k] + share * (found.E1[k + 1] - found.E1[k])
            notes.append(f"opposite grains on axis {axis} separate at E1 = {parting:.6f}")
    beyond = found.beyond
    if beyond is not None and found.det_Ks[found.marks["B"]] > 0.0 and beyond.det_Ks[0] < 0.0:
        notes.append("det K and det Ks jump below zero at B, where the contacts start to slide")
    return notes
