"""The paper's closed forms against the operators of any loop, and against each other."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from loops import LinearFrictional, Regime, macroscopic_tangent
from patterns.diamond import DiamondParameters as LoopParameters
from patterns.diamond import isotropic_tangent
from stability import bromwich_margin, restrict
from stability.spectra import operator_norm
from studies.diamond.parameters import Closure
from studies.diamond.path import DiamondPath
from studies.diamond.states import States, isotropic_states, loop_graph

Floats = NDArray[np.float64]


def generic_tangent(loop: LoopParameters, states: States, closure: Closure) -> Floats:
    """The macroscopic tangent of any loop, applied to the diamond's grain graph.

    Parameters
    ----------
    loop : patterns.diamond.DiamondParameters
        The diamond.
    states : States
        Where.
    closure : {'affine', 'traction'}
        How the surroundings drive the grains.

    Returns
    -------
    ndarray (n, 4, 4)
        Components (11, 12, 21, 22), spins blocked, over the bounding box `L10 L20` as the
        paper's; NaN where the solve is not trusted.
    """
    law = LinearFrictional(kn=1.0, kt=loop.kappa, mu=loop.mu)
    box = 2.0 * np.sin(2.0 * loop.alpha0)
    tangent = macroscopic_tangent(
        loop_graph(loop, states),
        law,
        closure,
        regime=np.full((len(states.E1), 4), Regime.ELASTIC),
        volume=box,
    )
    return tangent.matrix


def verification(path: DiamondPath) -> dict[str, Any]:
    """How far independent routes to the same numbers lie apart on a path.

    Parameters
    ----------
    path : DiamondPath
        From `follow`.

    Returns
    -------
    dict
        `generic_vs_closed_form_max_relative`: the generic operator of both closures restricted to
        (11, 22) against (26), Frobenius norms; `*_untrusted`: states where a closure's solve has
        no answer; `isotropic_vs_closed_form_max_relative`: (38) against (26);
        `det_K_max_difference`: (35) against the determinant of (26); `bromwich_margin_min`: least
        of `min Re eig(K) - lambda_min(Ks)`; `det_K_zero_by_root_difference`: (41) against a root
        search on the generic operator, null where I is not reached.
    """
    K, norm = path.operators.K, operator_norm(path.operators.K)
    errors, untrusted = [], {}
    for closure in get_args(Closure):
        generic = restrict(generic_tangent(path.loop, path.states, closure), "diagonal")
        error = operator_norm(generic - K) / norm
        errors.append(float(np.nanmax(error)))
        untrusted[f"generic_{closure}_untrusted"] = int(np.count_nonzero(np.isnan(error)))
    isotropic = isotropic_tangent(path.states.E1, path.loop.alpha0, path.loop.kappa)
    return {
        "generic_vs_closed_form_max_relative": max(errors),
        **untrusted,
        "isotropic_vs_closed_form_max_relative": float(np.max(operator_norm(isotropic - K) / norm)),
        "det_K_max_difference": float(np.max(np.abs(np.linalg.det(K) - path.operators.det_K))),
        "bromwich_margin_min": float(np.min(bromwich_margin(K))),
        "det_K_zero_by_root_difference": _root_difference(path),
        "states": len(K),
    }


def _root_difference(path: DiamondPath) -> float | None:
    if "I" not in path.marks or path.loop.kappa == 0.0:
        return None
    at_I = float(path.states.E1[path.marks["I"]])

    def det(E: float) -> float:
        tangent = generic_tangent(path.loop, isotropic_states(path.loop, E), "affine")[0]
        return float(np.linalg.det(restrict(tangent, "diagonal")))

    root = brentq(det, 0.0, 0.5 * (1.0 + at_I), xtol=1e-15, rtol=4 * np.finfo(float).eps)
    return abs(float(root) - at_I)
