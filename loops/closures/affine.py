"""The affine closure: every centre follows the displacement gradient."""

from __future__ import annotations

from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Floats
from loops.closures.macro_tangent import MacroTangent, Spins, check_choice, solved
from loops.closures.spins import affine_spin
from loops.contact_state import contact_state
from loops.contact_tangent import (
    ContactTangent,
    contact_regime,
    contact_tangent,
    translational_blocks,
)
from loops.geometry import reference_volume
from loops.graph import GrainGraph, reference_branch_vectors
from loops.laws.protocol import ContactLaw
from loops.null_space import solve_through_null_space


def affine_tangent(
    graph: GrainGraph,
    law: ContactLaw,
    *,
    spins: Spins = "blocked",
    regime: ArrayLike | None = None,
    volume: ArrayLike | None = None,
) -> MacroTangent:
    """Macroscopic tangent under the affine closure, `A = (1/V0) sum k_ik d0_j d0_l`.

    Every centre follows `H`: `d' = -H' d0`. One sum over the contacts; `free` spins are relaxed
    to zero moment first (theory note, section 4).

    Parameters
    ----------
    graph : GrainGraph
        A loop or a packing, batch axes `...` allowed.
    law : ContactLaw
        Contact law.
    spins : {'blocked', 'affine', 'free'}
        Spins held; turning with the loop; relaxed.
    regime : (..., C) array of Regime, optional
        Regime of each contact; read from the state by the law if left out.
    volume : (...) array, optional
        Reference area V0 (length squared). The cell's if periodic, else the loop's polygon.

    Returns
    -------
    MacroTangent
        The operator, (..., 4, 4), in the order (11, 12, 21, 22).

    Raises
    ------
    InputError
        If the volume is left out and the graph is neither a loop nor periodic.

    Examples
    --------
    >>> from loops import GrainGraph, LinearFrictional, affine_tangent
    >>> x = [[0, 0], [1, 0], [1, 1], [0, 1]]
    >>> square = GrainGraph(x=x, radii=[0.5] * 4, contacts=[[0, 1], [1, 2], [2, 3], [3, 0]])
    >>> tangent = affine_tangent(square, LinearFrictional(kn=1.0, kt=0.5))
    >>> tangent.matrix.diagonal().tolist()
    [2.0, 1.0, 1.0, 2.0]
    """
    check_choice("spins", spins, get_args(Spins))
    v0 = np.asarray(reference_volume(graph) if volume is None else volume, dtype=float)
    state = contact_state(graph)
    regimes = contact_regime(state, law, regime)
    d0 = reference_branch_vectors(graph)
    if spins == "blocked":
        matrix = _blocked(translational_blocks(state, law, regimes), d0) / v0[..., None, None]
        none = np.zeros(matrix.shape[:-2])
        return solved(matrix, "affine", spins, v0, none + 1.0, none, none)
    blocks = contact_tangent(state, law, regimes)
    matrix = _blocked(blocks.k, d0)
    if spins == "affine":
        row = affine_spin(graph)[..., None, None, :]
        matrix = matrix + _stress(((blocks.q_i + blocks.q_j)[..., None] * row), d0)
        none = np.zeros(matrix.shape[:-2])
        return solved(matrix / v0[..., None, None], "affine", spins, v0, none + 1.0, none, none)
    return _free(graph, blocks, d0, matrix, v0)


def _blocked(k: Floats, d0: Floats) -> Floats:
    """(..., 4, 4): sum over contacts of `k_ik d0_j d0_l`."""
    pair = d0[..., :, None] * d0[..., None, :]
    total = np.einsum("...cik,...cjl->...ijkl", k, pair, optimize=True)
    return total.reshape(*total.shape[:-4], 4, 4)


def _stress(rates: Floats, d0: Floats) -> Floats:
    """(..., 4, R): sum over contacts of `f'_i d0_j` for force rates (..., C, 2, R)."""
    total = np.einsum("...cir,...cj->...ijr", rates, d0, optimize=True)
    return total.reshape(*total.shape[:-3], 4, total.shape[-1])


def _free(
    graph: GrainGraph, blocks: ContactTangent, d0: Floats, blocked: Floats, v0: Floats
) -> MacroTangent:
    """Relax the spins to zero moment: `K_ww w = sum p_k d0_l H_kl`."""
    i, j = graph.contacts.T
    grains = np.arange(graph.grain_count)
    at_i, at_j = (i == grains[:, None]).astype(float), (j == grains[:, None]).astype(float)
    spin_block = _scatter(blocks.c[..., 0, 0], at_i, at_i) + _scatter(
        blocks.c[..., 0, 1], at_i, at_j
    )
    spin_block += _scatter(blocks.c[..., 1, 0], at_j, at_i) + _scatter(
        blocks.c[..., 1, 1], at_j, at_j
    )
    moments = at_i @ _outer(blocks.p_i, d0) + at_j @ _outer(blocks.p_j, d0)
    rates = np.swapaxes(at_i, -1, -2)[..., None, :] * blocks.q_i[..., None]
    rates = rates + np.swapaxes(at_j, -1, -2)[..., None, :] * blocks.q_j[..., None]
    stress = _stress(rates, d0)
    scale = np.linalg.norm(spin_block, axis=(-2, -1), keepdims=True)
    scale = np.where(scale > 0, scale, 1.0)
    unit = np.linalg.norm(stress, axis=(-2, -1), keepdims=True)
    seen = stress / np.where(unit > 0, unit, 1.0)
    found = solve_through_null_space(spin_block / scale, moments / scale, seen)
    # Without shear stiffness nothing loads the spins: no residual to speak of.
    residual = np.where(np.linalg.norm(moments, axis=(-2, -1)) > 0, found.residual, 0.0)
    matrix = (blocked + stress @ found.x) / v0[..., None, None]
    return solved(matrix, "affine", "free", v0, found.condition, residual, found.ambiguity)


def _scatter(values: Floats, at_row: Floats, at_column: Floats) -> Floats:
    return np.einsum("...c,gc,hc->...gh", values, at_row, at_column, optimize=True)


def _outer(p: Floats, d0: Floats) -> Floats:
    """(..., C, 4) moments per component of H."""
    return (p[..., :, None] * d0[..., None, :]).reshape(*p.shape[:-1], 4)
