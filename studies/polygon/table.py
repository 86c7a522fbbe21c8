"""The table of a polygon's path: one row a state."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from loops import Regime
from stability import (
    RTOL,
    Path,
    operator_norm,
    plane_cone,
    restrict,
    symmetric_spectrum,
    unstable_fraction,
)
from stability.subspaces import COMPONENTS
from studies.polygon.parameters import SUBSPACES
from studies.polygon.path import PolygonPath, determinants

Floats = NDArray[np.float64]


def path_table(found: PolygonPath) -> dict[str, Any]:
    """Table of a path, one row a state.

    Parameters
    ----------
    found : PolygonPath
        From `follow_polygon`.

    Returns
    -------
    dict of str to array
        `stage, parameter`; `E1, E2, H12, H21`; `s1, s2, s12, s21`, stresses `P/kn`; lists `N, T,
        regime` by contact and `x, y` by grain; `A11_11 ..`, the tangent; `det_K, det_Ks`, of the
        tangent restricted to (11, 22), with `lambda_1, lambda_2`, eigenvalues of Ks, and
        `eigenvalue_1_real ..`, those of K; the cone in the plane, angles from E1 towards E2;
        `lambda_min_*` and `unstable_fraction_*` of every subspace; `work` from outside over `kn`
        and the reference area, `dissipated`, and the path's own `energy_error`, `imbalance`.
    """
    path = found.path
    names = np.array(found.stage_names)
    det_K, det_Ks = determinants(path)
    return {
        "stage": names[path.stage],
        "parameter": path.parameter,
        **_strain_and_stress(path),
        "N": list(path.normal_force),
        "T": list(path.shear_force),
        "regime": [[Regime(int(r)).name.lower() for r in row] for row in path.regime],
        "x": list(path.x[..., 0]),
        "y": list(path.x[..., 1]),
        **{
            f"A{COMPONENTS[a]}_{COMPONENTS[b]}": path.A[:, a, b] for a in range(4) for b in range(4)
        },
        "det_K": det_K,
        "det_Ks": det_Ks,
        **_plane(path),
        **_subspaces(path),
        "work": path.work[:, 0] / path.volume,
        "dissipated": path.work[:, 3] / path.volume,
        "energy_error": path.energy_error,
        "imbalance": path.imbalance,
    }


def settled_eigenvalues(K: Floats) -> Floats:
    """Eigenvalues of Ks, those within the round-off of the norm set to zero.

    Parameters
    ----------
    K : (..., m, m) array
        Operators; NaN stays NaN.

    Returns
    -------
    (..., m) array
        Ascending.
    """
    values = symmetric_spectrum(K)
    return np.where(np.abs(values) <= RTOL * operator_norm(K)[..., None], 0.0, values)


def _strain_and_stress(path: Path) -> dict[str, Floats]:
    H, P = path.H, path.P
    strains = {"E1": H[:, 0], "E2": H[:, 3], "H12": H[:, 1], "H21": H[:, 2]}
    return strains | {"s1": P[:, 0], "s2": P[:, 3], "s12": P[:, 1], "s21": P[:, 2]}


def _plane(path: Path) -> dict[str, Any]:
    symmetric, values, cone = path.symmetric_eigenvalues, path.eigenvalues, plane_cone(path.K)
    return {
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


def _subspaces(path: Path) -> dict[str, Floats]:
    columns = {}
    for subspace in SUBSPACES:
        values = settled_eigenvalues(restrict(path.A, subspace))
        columns[f"lambda_min_{subspace}"] = values[:, 0]
        columns[f"unstable_fraction_{subspace}"] = unstable_fraction(values)
    return columns
