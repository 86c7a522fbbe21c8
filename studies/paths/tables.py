"""The tables of the study of paths: one row a state, a direction or an angle."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from loops import Regime
from loops.arrays import Floats, Integers
from patterns.diamond import DiamondParameters, opposite_gaps
from patterns.diamond.geometry import work_compress_then_shear, work_shear_then_compress
from stability import (
    COMPONENTS,
    RTOL,
    alpha_e,
    normalised_second_order_work,
    operator_norm,
    plane_cone,
    restrict,
    spectrum,
    statuses,
    symmetric_spectrum,
    unstable_fraction,
)
from studies.paths.diamond import FollowedDiamond
from studies.paths.followed import SUBSPACES, Followed
from studies.paths.states import DiamondStates, Operators

# Grains times rows of a table.
MOST_NUMBERS = 100_000
# Compression of Fig. 4 where the study has no confinement to take it from; its largest turn.
COMPRESSION, LAST_ANGLE = 0.2, np.pi / 4
ROUTES = {
    "shear_then_compress": ("shear", "compress"),
    "compress_then_shear": ("compress", "shear"),
}


def diamond_table(found: FollowedDiamond) -> dict[str, Any]:
    """Table of a diamond's path.

    `stage, regime`; `E1, E2, alpha_deg, l, N, T, s1, s2`; K, Kmat (27), Kgeo (28) by components;
    `det_K, det_Ks`; eigenvalues of Ks, `lambda_*`, and of K; `status` of the second-order work; the
    cone, angles from E1 towards E2; `loading_alphaE_deg, w2_loading` along the path's own
    direction; `gap_*` between opposite grains, `chord_*` forces of contacts added there; energies.
    """
    loop, direction = found.loop, found.direction
    gaps = opposite_gaps(found.E1, found.E2, loop.alpha0)
    moves = np.isfinite(direction[:, 0])
    w2 = normalised_second_order_work(found.K, np.where(moves[:, None], direction, 1.0))
    return {
        **state_columns(found.states, found.operators),
        "loading_alphaE_deg": np.degrees(alpha_e(np.arctan2(direction[:, 1], direction[:, 0]))),
        "w2_loading": np.where(moves, w2, np.nan),
        **{f"gap_{axis}": gap for axis, gap in enumerate(gaps, start=1)},
        **{f"chord_{axis}": found.added_forces[:, axis - 1] for axis in (1, 2)},
        **found.energies,
    }


def state_columns(states: DiamondStates, found: Operators) -> dict[str, Any]:
    """Columns that follow from the states and their operators alone."""
    K, cone = found.K, plane_cone(found.K)
    ray = cone.status == "ray"
    edges = np.where(ray[:, None], cone.axis[:, None], cone.edges)
    plane = plane_columns(K, found.det_K, found.det_Ks)
    return {
        "stage": states.stage,
        "regime": states.regime,
        "E1": states.E1,
        "E2": states.E2,
        "alpha_deg": np.degrees(states.alpha),
        "l": states.length,
        "N": states.N,
        "T": states.T,
        "s1": states.s1,
        "s2": states.s2,
        **_components("K", K),
        **_components("Kmat", found.material),
        **_components("Kgeo", found.geometric),
        **plane,
        "status": statuses(plane["lambda_1"], operator_norm(K)),
        "cone_edge_1_deg": np.degrees(edges[:, 0]),
        "cone_edge_2_deg": np.degrees(edges[:, 1]),
        "unstable_fraction": plane["cone_opening_deg"] / 180.0,
    }


def polygon_table(found: Followed) -> dict[str, Any]:
    """Table of a polygon's path.

    `stage, parameter`; `E1, E2, H12, H21`; stresses `s1, s2, s12, s21`; lists `N, T, regime` by
    contact and `x, y` by grain; the tangent `A11_11 ..`; columns of (11, 22) as in
    `plane_columns`; `lambda_min_*` and `unstable_fraction_*` of every subspace; `work` from outside
    and `dissipated` over `kn` and the reference area, the path's `energy_error`, `imbalance`.
    """
    path, H, P = found.path, found.path.H, found.path.P
    rows = table_rows(found)
    names = np.array([regime.name.lower() for regime in Regime])
    table: dict[str, Any] = {
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
        **plane_columns(found.K, found.det_K, found.det_Ks),
    }  # fmt: skip
    table |= subspace_columns(found)
    table |= {
        "work": path.work[:, 0] / path.volume,
        "dissipated": path.work[:, 3] / path.volume,
        "energy_error": path.energy_error,
        "imbalance": path.imbalance,
    }
    if len(rows) == len(path):
        return table
    return {
        name: [values[k] for k in rows] if isinstance(values, list) else values[rows]
        for name, values in table.items()
    }


def subspace_columns(found: Followed) -> dict[str, Floats]:
    """`lambda_min_*` and `unstable_fraction_*` of every subspace at every row."""
    table: dict[str, Floats] = {}
    for subspace in SUBSPACES:
        # Eigenvalues within the round-off of the norm are zero.
        K = restrict(found.path.A, subspace)
        values = symmetric_spectrum(K)
        values = np.where(np.abs(values) <= RTOL * operator_norm(K)[..., None], 0.0, values)
        table[f"lambda_min_{subspace}"] = values[:, 0]
        table[f"unstable_fraction_{subspace}"] = unstable_fraction(values)
    return table


def table_rows(found: Followed) -> Integers:
    """Rows of a path that its table holds: all, or of large loops the ends of stages and some."""
    count, grains = found.path.x.shape[:2]
    most = max(MOST_NUMBERS // grains, 2)
    if count <= most:
        return np.arange(count)
    ends = np.flatnonzero(np.diff(found.path.stage))
    return np.unique(np.concatenate([np.linspace(0, count - 1, most).astype(int), ends, ends + 1]))


def plane_columns(K: Floats, det_K: Floats, det_Ks: Floats) -> dict[str, Any]:
    """Determinants, eigenvalues of Ks (ascending) and of K, and the instability cone in (11, 22).

    A cone that closes within the tolerance is a single direction, of opening 0.
    """
    values, symmetric, cone = spectrum(K), symmetric_spectrum(K), plane_cone(K)
    return {
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


def snapshot_tables(found: FollowedDiamond, row: int) -> dict[str, dict[str, Any]]:
    """The loop at a row as the two tables of a plain snapshot, `grains` and `contacts`."""
    path = found.path
    closed = np.flatnonzero(path.regime[row] != Regime.OPEN)
    x, (i, j) = path.x[row], path.contacts[closed].T
    branch = x[j] - x[i]
    normal = branch / np.linalg.norm(branch, axis=1, keepdims=True)
    tangent = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
    shear = path.shear_force[row, closed][:, None] * tangent
    grains = {"id": np.arange(len(x)), "x": x[:, 0], "y": x[:, 1], "radius": np.full(len(x), 0.5)}
    contacts = {
        "id1": i,
        "id2": j,
        "branch_x": branch[:, 0],
        "branch_y": branch[:, 1],
        "fn": path.normal_force[row, closed],
        "fsx": shear[:, 0],
        "fsy": shear[:, 1],
        "kn": np.ones(len(closed)),
        "ks": np.full(len(closed), found.loop.kappa),
        "mu": np.full(len(closed), found.loop.mu),
    }
    return {"grains": grains, "contacts": contacts}


def path_dependence_table(loop: DiamondParameters, angles: int = 46) -> dict[str, Floats]:
    """Fig. 4: work along both routes over the turn of the branch, (9), (10) and integrated.

    `kn = l0 = 1`, `kt = kappa`; the compression is the confinement, where there is one.
    """
    D = loop.confinement or COMPRESSION
    alpha = np.linspace(0.0, LAST_ANGLE, angles)
    return {
        "alpha_deg": np.degrees(alpha),
        "compression": np.full(angles, D),
        "shear_then_compress": work_shear_then_compress(1.0, alpha, D, 1.0, loop.kappa),
        "compress_then_shear": work_compress_then_shear(1.0, alpha, D, 1.0, loop.kappa),
        **{f"{route}_integrated": _route_work(loop.kappa, alpha, D, route) for route in ROUTES},
    }


def _route_work(kappa: float, alpha: Floats, D: float, route: str) -> Floats:
    """Work along a route by integrating the rate law (8a), (8b), all angles at once."""
    y = np.stack([np.ones_like(alpha), *np.zeros((3, alpha.size))])
    for leg in ROUTES[route]:
        stretching, turning = (0.0, alpha) if leg == "shear" else (-D, 0.0)

        def slope(_: float, flat: Floats, a: float = stretching, b: Any = turning) -> Floats:
            length, N, T, _work = flat.reshape(4, -1)
            still = np.zeros_like(N)
            arc = length * b
            return np.concatenate([still + a, still - a, kappa * arc, T * arc - N * a])

        legs = solve_ivp(slope, (0.0, 1.0), y.ravel(), method="DOP853", rtol=1e-12, atol=1e-14)
        y = legs.y[:, -1].reshape(4, -1)
    return np.asarray(y[-1])


def _components(name: str, K: Floats) -> dict[str, Floats]:
    return {f"{name}{i + 1}{j + 1}": K[:, i, j] for i in range(2) for j in range(2)}
