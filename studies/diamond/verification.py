"""The paper's closed forms against the operators of any loop, and against each other."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from loops import LinearFrictional, Regime, macroscopic_tangent
from patterns.diamond import DiamondParameters as LoopParameters
from patterns.diamond import isotropic_tangent
from patterns.diamond.tangents import drained_slope
from stability import bromwich_margin, restrict
from stability.spectra import operator_norm
from studies.diamond.drained import drained_pieces
from studies.diamond.operators import operators
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
        Where; sliding contacts by Coulomb's law.
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
    sides = np.where(states.slip == 0.0, Regime.ELASTIC, Regime.SLIDING)
    regime = np.repeat(sides[:, None], 4, axis=1)
    if states.chords.any():
        across = np.where(states.chords, Regime.ELASTIC, Regime.OPEN)
        regime = np.concatenate([regime, across], axis=1)
    tangent = macroscopic_tangent(loop_graph(loop, states), law, closure, regime=regime, volume=box)
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
        (11, 22) against (26), Frobenius norms, where Coulomb's law holds; `*_untrusted`: states
        where a closure's solve has no answer; `isotropic_vs_closed_form_max_relative`: (38)
        against (26); `det_K_max_difference`: (35), (36) against the determinant of (26);
        `bromwich_margin_min`: least of `min Re eig(K) - lambda_min(Ks)`;
        `det_K_zero_by_root_difference`: (41) against a root search on the generic operator, null
        where I is not reached; `energy_balance_max_relative`: external work less stored energy
        and heat, over the largest work; `slope_at_A`: `ds1/dE1` of the exact path by differences,
        by (33), and their `difference`; `states`: how many were compared.
    """
    K, norm = path.operators.K, operator_norm(path.operators.K)
    lawful = np.flatnonzero(path.states.slip * path.states.T >= 0.0)
    errors, untrusted = [], {}
    for closure in get_args(Closure):
        generic = generic_tangent(path.loop, path.states.take(lawful), closure)
        error = operator_norm(restrict(generic, "diagonal") - K[lawful]) / norm[lawful]
        errors.append(float(np.nanmax(error)))
        untrusted[f"generic_{closure}_untrusted"] = int(np.count_nonzero(np.isnan(error)))
    return {
        "generic_vs_closed_form_max_relative": max(errors),
        **untrusted,
        "isotropic_vs_closed_form_max_relative": _isotropic_error(path),
        "det_K_max_difference": float(np.max(np.abs(np.linalg.det(K) - path.operators.det_K))),
        "bromwich_margin_min": float(np.min(bromwich_margin(K))),
        "det_K_zero_by_root_difference": _root_difference(path),
        "energy_balance_max_relative": energy_imbalance(path),
        "slope_at_A": slope_at_A(path),
        "states": len(lawful),
    }


def energy_imbalance(path: DiamondPath) -> float:
    """Largest `|work - stored - dissipated|` over the largest work; 0 on an unloaded path.

    Parameters
    ----------
    path : DiamondPath
        From `follow`.

    Returns
    -------
    float
    """
    largest = float(np.max(np.abs(path.work)))
    imbalance = np.max(np.abs(path.work - path.stored - path.dissipated))
    return float(imbalance) / largest if largest > 0.0 else 0.0


def slope_at_A(path: DiamondPath) -> dict[str, float] | None:
    """Slope of the axial stress where the drained test starts, by differences and by (33).

    Parameters
    ----------
    path : DiamondPath
        From `follow`.

    Returns
    -------
    dict or None
        `differences`, of the exact path without added contacts; `closed_form`, `det K/K22`;
        `difference`. None where A is not reached, or the path opens or slides at once.
    """
    piece = drained_pieces(path.loop, "coulomb")[0][0]
    if "A" not in path.marks or piece.end == 0.0:
        return None
    # Chebyshev points on a short stretch of the elastic path: the slope of the interpolant.
    turn = 0.5 * np.clip(piece.end, -0.1, 0.1) * (1.0 - np.cos(np.pi * np.arange(15) / 14))
    states = piece.states(turn)
    s1, E1 = (
        np.polynomial.Polynomial.fit(turn, y, 14).deriv()(0.0) for y in (states.s1, states.E1)
    )
    at_A = isotropic_states(path.loop, path.loop.confinement)
    closed = float(drained_slope(operators(path.loop, at_A).K[0]))
    return {
        "differences": float(s1 / E1),
        "closed_form": closed,
        "difference": float(abs(s1 / E1 - closed)),
    }


def _isotropic_error(path: DiamondPath) -> float:
    """(38) against (26) on the rows of isotropic strain without added contacts."""
    states = path.states
    rows = (states.stage == "isotropic") & ~states.chords.any(axis=1)
    K = path.operators.K[rows]
    closed = isotropic_tangent(states.E1[rows], path.loop.alpha0, path.loop.kappa)
    return float(np.max(operator_norm(closed - K) / operator_norm(K)))


def _root_difference(path: DiamondPath) -> float | None:
    if "I" not in path.marks or path.loop.kappa == 0.0 or path.states.chords[path.marks["I"]].any():
        return None
    at_I = float(path.states.E1[path.marks["I"]])

    def det(E: float) -> float:
        tangent = generic_tangent(path.loop, isotropic_states(path.loop, E), "affine")[0]
        return float(np.linalg.det(restrict(tangent, "diagonal")))

    root = brentq(det, 0.0, 0.5 * (1.0 + at_I), xtol=1e-15, rtol=4 * np.finfo(float).eps)
    return abs(float(root) - at_I)
