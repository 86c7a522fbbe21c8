"""The traction closure: uniform nominal stress on the polygon, centres relax."""

from __future__ import annotations

from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Floats
from loops.assembly import assemble_elements, assemble_tangent, translational_elements
from loops.closures.force_method import force_method
from loops.closures.macro_tangent import (
    RESIDUAL_LIMIT,
    MacroTangent,
    Spins,
    check_choice,
    solved,
)
from loops.closures.saddle import saddle_solve
from loops.closures.spins import affine_spin
from loops.contact_state import contact_state
from loops.contact_tangent import (
    compliance_growth,
    contact_regime,
    translational_blocks,
    translational_compliances,
)
from loops.errors import InputError
from loops.geometry import polygon_area, require_loop
from loops.graph import GrainGraph
from loops.laws.protocol import ContactLaw

Method = Literal["auto", "force", "saddle"]

# Up to this amplification the force method's error stays below 1e-13 (stiff sliding rings, against
# 50 digits); beyond it the saddle system competes.
FORCE_METHOD_LIMIT = 1e4
# For the same stated amplification the force method errs less, by a factor of 10 to 100.
SADDLE_GAIN = 100.0


def traction_tangent(
    graph: GrainGraph,
    law: ContactLaw,
    *,
    spins: Spins = "blocked",
    regime: ArrayLike | None = None,
    volume: ArrayLike | None = None,
    method: Method = "auto",
) -> MacroTangent:
    """Macroscopic tangent under the traction closure.

    Uniform nominal stress acts on the polygon, `F_i = -P B_i`, and the centres relax (theory
    note, section 4).

    Parameters
    ----------
    graph : GrainGraph
        A loop: contacts 0..n-1 are the ring, chords may follow; batch axes `...` allowed.
    law : ContactLaw
        Contact law.
    spins : {'blocked', 'affine', 'free'}
        Spins held; turning with the loop; relaxed to zero moment.
    regime : (..., C) array of Regime, optional
        Regime of each contact; read from the state by the law if left out.
    volume : (...) array, optional
        Reference area V0 that `P` is taken over (length squared); the polygon's if left out.
    method : {'auto', 'force', 'saddle'}
        `force` needs a plain ring with blocked spins and invertible blocks, and costs O(n);
        `saddle` solves any loop through its null vectors; `auto` takes the force method where it
        applies and the saddle system for the rest.

    Returns
    -------
    MacroTangent
        The operator, (..., 4, 4), in the order (11, 12, 21, 22), nan where not trusted.

    Raises
    ------
    InputError
        If the graph is no loop, its polygon has no area, or the force method is asked for where
        it does not apply.

    Examples
    --------
    >>> from loops import GrainGraph, LinearFrictional, traction_tangent
    >>> x = [[0, 0], [1, 0], [1, 1], [0, 1]]
    >>> square = GrainGraph(x=x, radii=[0.5] * 4, contacts=[[0, 1], [1, 2], [2, 3], [3, 0]])
    >>> tangent = traction_tangent(square, LinearFrictional(kn=1.0, kt=0.5))
    >>> tangent.matrix.diagonal().round(12).tolist()
    [2.0, 1.0, 1.0, 2.0]
    """
    check_choice("spins", spins, get_args(Spins))
    check_choice("method", method, get_args(Method))
    require_loop(graph)
    polygon = np.abs(polygon_area(graph.x0))
    if not np.all(polygon > 0):
        raise InputError(
            "reference polygon of the loop",
            f"area {np.min(polygon)}",
            "a positive area",
            "Uniform traction needs a polygon: the centres must not lie on a line.",
        )
    v0 = np.asarray(polygon if volume is None else volume, dtype=float)
    applies = spins == "blocked" and graph.contact_count == graph.grain_count
    if method == "force" and not applies:
        raise InputError(
            "method 'force'",
            f"spins {spins!r} and {graph.contact_count} contacts of {graph.grain_count} grains",
            "blocked spins and a plain ring",
            "Use 'auto' or 'saddle'.",
        )
    if method == "saddle" or not applies:
        solution = _by_saddle(graph, law, spins, regime, polygon)
    else:
        solution = _by_force(graph, law, regime, polygon, fall_back=method == "auto")
    # The boundary formula holds on the polygon; another V0 only rescales the stress.
    matrix = solution.matrix * (polygon / v0)[..., None, None]
    return solved(matrix, "traction", spins, v0, *solution.status)


class _Solution(NamedTuple):
    matrix: Floats
    status: tuple[Floats, Floats, Floats]
    """Condition, residual, ambiguity."""


def _by_saddle(
    graph: GrainGraph, law: ContactLaw, spins: Spins, regime: ArrayLike | None, polygon: Floats
) -> _Solution:
    tangent = assemble_tangent(graph, law, spins=spins != "blocked", regime=regime)
    polygon = np.broadcast_to(polygon, tangent.shape[:-2])
    spin = affine_spin(graph) if spins == "affine" else None
    matrix, condition, found = saddle_solve(tangent, graph.x0, polygon, spin)
    return _Solution(matrix, (condition, found.residual, found.ambiguity))


def _by_force(
    graph: GrainGraph, law: ContactLaw, regime: ArrayLike | None, polygon: Floats, fall_back: bool
) -> _Solution:
    state = contact_state(graph)
    regimes = contact_regime(state, law, regime)
    compliance = translational_compliances(state, law, regimes)
    batch = compliance.shape[:-3]
    x0 = np.broadcast_to(graph.x0, (*batch, *graph.x0.shape[-2:]))
    polygon = np.broadcast_to(polygon, batch)
    growth = compliance_growth(state, law, regimes)
    matrix, condition = force_method(compliance, x0, polygon, growth)
    residual, ambiguity = np.zeros(batch), np.zeros(batch)
    poor = ~(condition <= FORCE_METHOD_LIMIT)
    if fall_back and poor.any():
        k = translational_blocks(state, law, regimes)[poor]
        tangent = assemble_elements(translational_elements(k), graph.contacts, graph.grain_count)
        other, other_condition, found = saddle_solve(tangent, x0[poor], polygon[poor])
        answered = found.residual <= RESIDUAL_LIMIT
        better = answered & (SADDLE_GAIN * other_condition < condition[poor])
        # Where the force method has no answer at all, what the saddle system says of it stands.
        better |= ~np.isfinite(condition[poor])
        place = np.zeros(batch, dtype=bool)
        place[poor] = better
        matrix[place], condition[place] = other[better], other_condition[better]
        residual[place], ambiguity[place] = found.residual[better], found.ambiguity[better]
    return _Solution(matrix, (condition, residual, ambiguity))
