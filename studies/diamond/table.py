"""The tables of a diamond's path: one row a state, and the loop at a state as a snapshot."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from patterns.diamond import opposite_gaps
from stability import (
    alpha_e,
    normalised_second_order_work,
    plane_cone,
    spectrum,
    statuses,
    symmetric_spectrum,
)
from stability.cones import PlaneCone
from stability.spectra import operator_norm
from studies.diamond.operators import Operators
from studies.diamond.path import DiamondPath, loading_rates
from studies.diamond.states import States, chord_forces, loop_graph

Floats = NDArray[np.float64]


def path_table(path: DiamondPath) -> dict[str, NDArray[Any]]:
    """Table of a path, one row a state.

    Parameters
    ----------
    path : DiamondPath
        From `follow`.

    Returns
    -------
    dict of str to array
        `stage, regime`; `E1, E2, alpha_deg, l, N, T, s1, s2`; `K11..K22`, `Kmat11..Kmat22`,
        `Kgeo11..Kgeo22`; `det_K, det_Ks`; `lambda_1, lambda_2`, eigenvalues of Ks ascending;
        `eigenvalue_1_real ..`, those of K; `status` of the second-order work; the cone, angles
        from E1 towards E2; `loading_alphaE_deg` and `w2_loading`, the path's own direction and
        its normalised second-order work; `gap_1, gap_2`, gaps between opposite grains over `l0`;
        `chord_1, chord_2`, forces of contacts added there; `work, stored, dissipated`.
    """
    states, loop = path.states, path.loop
    gap1, gap2 = opposite_gaps(states.E1, states.E2, loop.alpha0)
    chord = chord_forces(loop, states)
    direction = loading_rates(path)
    alphaE = alpha_e(np.arctan2(direction[:, 1], direction[:, 0]))
    return {
        **state_columns(states, path.operators),
        "loading_alphaE_deg": np.degrees(alphaE),
        "w2_loading": normalised_second_order_work(path.operators.K, direction),
        "gap_1": gap1,
        "gap_2": gap2,
        "chord_1": chord[:, 0],
        "chord_2": chord[:, 1],
        "work": path.work,
        "stored": path.stored,
        "dissipated": path.dissipated,
    }


def state_columns(states: States, found: Operators) -> dict[str, NDArray[Any]]:
    """Columns that follow from the states and their operators alone; see `path_table`.

    Parameters
    ----------
    states : States
        Where.
    found : Operators
        Tangents there.

    Returns
    -------
    dict of str to array
    """
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
        **_components("K", found.K),
        **_components("Kmat", found.material),
        **_components("Kgeo", found.geometric),
        "det_K": found.det_K,
        "det_Ks": found.det_Ks,
        **_spectra(found.K),
        **_cones(found.K),
    }


def closed_cone(K: Floats) -> PlaneCone:
    """Instability cones; one that closes within the tolerance is a single direction.

    Parameters
    ----------
    K : ndarray (..., 2, 2)
        Tangents.

    Returns
    -------
    PlaneCone
        With opening 0 and both edges on the axis where the status is 'ray'.
    """
    cone = plane_cone(K)
    ray = cone.status == "ray"
    return PlaneCone(
        status=cone.status,
        opening=np.where(ray, 0.0, cone.opening),
        axis=cone.axis,
        edges=np.where(ray[..., None], cone.axis[..., None], cone.edges),
    )


def snapshot_tables(path: DiamondPath, name: str) -> dict[str, dict[str, Any]]:
    """The loop at a named state as the two tables of a plain snapshot.

    Parameters
    ----------
    path : DiamondPath
        From `follow`.
    name : {'I', 'A', 'B'}
        Which state.

    Returns
    -------
    dict
        Columns of `grains` (`id, x, y, radius`) and of `contacts` (`id1, id2, branch_x,
        branch_y, fn`, the shear force `fsx, fsy` on grain 2, `kn, ks, mu`).
    """
    graph = loop_graph(path.loop, path.states.take([path.marks[name]]))
    x, (i, j), count = graph.x[0], graph.contacts.T, graph.contact_count
    branch = x[j] - x[i]
    normal = branch / np.linalg.norm(branch, axis=1, keepdims=True)
    shear = graph.shear_force[0][:, None] * np.stack([-normal[:, 1], normal[:, 0]], axis=1)
    grains = {"id": np.arange(4), "x": x[:, 0], "y": x[:, 1], "radius": graph.radii[0]}
    contacts = {
        "id1": i,
        "id2": j,
        "branch_x": branch[:, 0],
        "branch_y": branch[:, 1],
        "fn": graph.normal_force[0],
        "fsx": shear[:, 0],
        "fsy": shear[:, 1],
        "kn": np.ones(count),
        "ks": np.full(count, path.loop.kappa),
        "mu": np.full(count, path.loop.mu),
    }
    return {"grains": grains, "contacts": contacts}


def _components(name: str, K: Floats) -> dict[str, Floats]:
    return {f"{name}{i + 1}{j + 1}": K[:, i, j] for i in range(2) for j in range(2)}


def _spectra(K: Floats) -> dict[str, NDArray[Any]]:
    values, symmetric = spectrum(K), symmetric_spectrum(K)
    return {
        "lambda_1": symmetric[:, 0],
        "lambda_2": symmetric[:, 1],
        "eigenvalue_1_real": values[:, 0].real,
        "eigenvalue_1_imag": values[:, 0].imag,
        "eigenvalue_2_real": values[:, 1].real,
        "eigenvalue_2_imag": values[:, 1].imag,
        "status": statuses(symmetric[:, 0], operator_norm(K)),
    }


def _cones(K: Floats) -> dict[str, NDArray[Any]]:
    cone = closed_cone(K)
    return {
        "cone_status": cone.status,
        "cone_edge_1_deg": np.degrees(cone.edges[:, 0]),
        "cone_edge_2_deg": np.degrees(cone.edges[:, 1]),
        "cone_axis_deg": np.degrees(cone.axis),
        "cone_opening_deg": np.degrees(cone.opening),
        "unstable_fraction": cone.opening / np.pi,
    }
