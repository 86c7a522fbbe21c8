"""Either closure by its name."""

from __future__ import annotations

from typing import get_args

from numpy.typing import ArrayLike

from loops.closures.affine import affine_tangent
from loops.closures.macro_tangent import Closure, MacroTangent, Spins, check_choice
from loops.closures.traction import traction_tangent
from loops.graph import GrainGraph
from loops.laws.protocol import ContactLaw


def macroscopic_tangent(
    graph: GrainGraph,
    law: ContactLaw,
    closure: Closure,
    *,
    spins: Spins = "blocked",
    regime: ArrayLike | None = None,
    volume: ArrayLike | None = None,
) -> MacroTangent:
    """Macroscopic tangent under the closure of that name.

    Parameters
    ----------
    graph : GrainGraph
        A loop, or a packing for the affine closure; batch axes `...` allowed.
    law : ContactLaw
        Contact law.
    closure : {'affine', 'traction'}
        See `affine_tangent` and `traction_tangent`.
    spins : {'blocked', 'affine', 'free'}
        Spins held; turning with the loop; relaxed.
    regime : (..., C) array of Regime, optional
        Regime of each contact; read from the state by the law if left out.
    volume : (...) array, optional
        Reference area V0 (length squared).

    Returns
    -------
    MacroTangent
        The operator, (..., 4, 4), in the order (11, 12, 21, 22).

    Raises
    ------
    InputError
        For an unknown closure, and as the closures do.

    Examples
    --------
    >>> from loops import GrainGraph, LinearFrictional, macroscopic_tangent
    >>> x = [[0, 0], [1, 0], [1, 1], [0, 1]]
    >>> square = GrainGraph(x=x, radii=[0.5] * 4, contacts=[[0, 1], [1, 2], [2, 3], [3, 0]])
    >>> str(macroscopic_tangent(square, LinearFrictional(kn=1.0, kt=0.5), "affine"))
    'affine tangent, spins blocked: 1 of 1 trusted, condition up to 1.0e+00'
    """
    check_choice("closure", closure, get_args(Closure))
    tangent = affine_tangent if closure == "affine" else traction_tangent
    return tangent(graph, law, spins=spins, regime=regime, volume=volume)
