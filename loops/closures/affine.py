"""The affine closure: every centre follows the displacement gradient."""

from __future__ import annotations

from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Floats, frobenius
from loops.closures.macro_tangent import MacroTangent, Spins, amplification, check_choice, solved
from loops.closures.system import of_relaxed, relaxed_loop
from loops.contact_state import contact_state
from loops.contact_tangent import contact_regime, local_sizes, translational_blocks
from loops.geometry import checked_volume, reference_volume, volume_growth
from loops.graph import GrainGraph, reference_branch_vectors
from loops.laws.protocol import ContactLaw
from loops.null_space import ROUNDING


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
    to zero moment first. Theory, equation (4.4).

    Parameters
    ----------
    graph : GrainGraph
        A loop or a packing, batch axes `...` allowed.
    law : ContactLaw
        Contact law.
    spins : {'blocked', 'affine', 'free'}
        Spins held; turning with the loop; relaxed.
    regime : (..., C) array of Regime, optional
        Regime of each contact; the graph's, or read from the state by the law, if left out.
    volume : (...) array, optional
        Reference area V0 (length squared). The cell's if periodic, else the loop's polygon.

    Returns
    -------
    MacroTangent
        The operator, (..., 4, 4), in the order (11, 12, 21, 22).

    Raises
    ------
    InputError
        If the volume is left out and the graph is neither a loop nor periodic, a volume is not
        positive, a regime is none of `Regime`, or the law's parameters don't fit the contacts.

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
    v0 = reference_volume(graph) if volume is None else checked_volume(volume)
    state = contact_state(graph)
    regimes = contact_regime(state, law, regime)
    growth = volume_growth(graph) if volume is None else 0.0
    if spins != "blocked":
        relaxed, turned = relaxed_loop(graph, law, "affine", spins, state, regimes, v0)
        return of_relaxed(relaxed, "affine", spins, v0, growth, turned)
    d0 = reference_branch_vectors(graph)
    matrix = _sum(translational_blocks(state, law, regimes), d0)
    sizes = frobenius(local_sizes(state, law, regimes))
    bound = ROUNDING * (sizes * (d0 * d0).sum(axis=-1)).sum(axis=-1)
    matrix = matrix / v0[..., None, None]
    return solved(matrix, "affine", spins, v0, amplification(bound / v0, matrix) + growth)


def _sum(k: Floats, d0: Floats) -> Floats:
    """(..., 4, 4): sum over contacts of `k_ik d0_j d0_l`."""
    pair = d0[..., :, None] * d0[..., None, :]
    total = np.einsum("...cik,...cjl->...ijkl", k, pair, optimize=True)
    return total.reshape(*total.shape[:-4], 4, 4)
