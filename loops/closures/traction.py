"""The traction closure: uniform nominal stress on the polygon, centres relax."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Floats, Regimes, frobenius
from loops.closures.affine import affine_tangent
from loops.closures.force_method import force_method
from loops.closures.macro_tangent import (
    RESIDUAL_LIMIT,
    Closure,
    MacroTangent,
    Spins,
    amplification,
    check_choice,
    solved,
)
from loops.closures.spins import affine_spin
from loops.closures.system import Relaxed, contact_terms, relax_centres, sensitivity
from loops.contact_state import ContactState, contact_state
from loops.contact_tangent import compliance_growth, contact_regime, translational_compliances
from loops.errors import InputError
from loops.geometry import area_growth, checked_volume, polygon_area, require_loop
from loops.graph import GrainGraph
from loops.laws.protocol import ContactLaw

Method = Literal["auto", "force", "saddle"]
# Beyond this amplification of the force method the saddle system competes.
FORCE_METHOD_LIMIT = 1e4
# It must state a hundredth of the error: the force method keeps the directions of soft operators.
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

    Uniform nominal stress acts on the polygon, `F_i = -P B_i`, and the centres relax. With free
    spins a gear mode whose moments nothing balances stands still: the limit of a vanishing
    resistance of the spins. Theory, equations (4.8) and (4.11).

    Parameters
    ----------
    graph : GrainGraph
        A loop: contacts 0..n-1 are the ring, chords may follow; batch axes `...` allowed.
    law : ContactLaw
        Contact law.
    spins : {'blocked', 'affine', 'free'}
        Spins held; turning with the loop; relaxed to zero moment.
    regime : (..., C) array of Regime, optional
        Regime of each contact; the graph's, or read from the state by the law, if left out.
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
        If the graph is no loop, its polygon has no area, a volume is not positive, a regime is
        none of `Regime`, the law's parameters don't fit the contacts, or the force method is asked
        for where it does not apply.

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
        where = "reference polygon of the loop"
        remedy = "Uniform traction needs a polygon: the centres must not lie on a line."
        raise InputError(where, f"area {np.min(polygon)}", "a positive area", remedy)
    v0 = polygon if volume is None else checked_volume(volume)
    applies = spins == "blocked" and graph.contact_count == graph.grain_count
    if method == "force" and not applies:
        raise InputError(
            "method 'force'",
            f"spins {spins!r} and {graph.contact_count} contacts of {graph.grain_count} grains",
            "blocked spins and a plain ring",
            "Use 'auto' or 'saddle'.",
        )
    state = contact_state(graph)
    regimes = contact_regime(state, law, regime)
    if method == "saddle" or not applies:
        found = _by_saddle(graph, law, spins, state, regimes)
    else:
        found = _by_force(graph, law, state, regimes, fall_back=method == "auto")
    # The boundary formula holds on the polygon; another V0 only rescales the stress.
    ratio = polygon / v0
    growth = 0.0 if volume is None else area_growth(graph.x0)
    return solved(
        found.matrix * ratio[..., None, None],
        "traction",
        spins,
        v0,
        found.condition + growth,
        found.residual,
        found.ambiguity,
        found.sensitivity * ratio,
    )


def macroscopic_tangent(
    graph: GrainGraph,
    law: ContactLaw,
    closure: Closure,
    *,
    spins: Spins = "blocked",
    regime: ArrayLike | None = None,
    volume: ArrayLike | None = None,
) -> MacroTangent:
    """Macroscopic tangent under the closure of that name, see `affine_tangent`, `traction_tangent`.

    Parameters
    ----------
    graph : GrainGraph
        A loop, or a packing for the affine closure; batch axes `...` allowed.
    law : ContactLaw
        Contact law.
    closure : {'affine', 'traction'}
        How the surrounding medium drives the grains.
    spins : {'blocked', 'affine', 'free'}
        Spins held; turning with the loop; relaxed.
    regime : (..., C) array of Regime, optional
        Regime of each contact; the graph's, or read from the state by the law, if left out.
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
    'affine tangent, spins blocked: 1 of 1 trusted, condition up to 2.4e+00'
    """
    check_choice("closure", closure, get_args(Closure))
    tangent = affine_tangent if closure == "affine" else traction_tangent
    return tangent(graph, law, spins=spins, regime=regime, volume=volume)


class _Found(NamedTuple):
    """Operator over the polygon's area, and its status."""

    matrix: Floats
    condition: Floats
    residual: Floats
    ambiguity: Floats
    sensitivity: Floats


def _by_saddle(
    graph: GrainGraph, law: ContactLaw, spins: Spins, state: ContactState, regime: Regimes
) -> _Found:
    spin = affine_spin(graph) if spins == "affine" else None
    relax = partial(relax_centres, graph.x0, spins=spins, spin=spin)
    relaxed = relax(contact_terms(graph, law, spins, state, regime))
    found = _found(relaxed, graph.x0)
    if spins != "free":
        return found
    turned = sensitivity(relax, relaxed, 0.0, graph, law, state, regime)
    return found._replace(sensitivity=turned / np.abs(polygon_area(graph.x0)))


def _found(relaxed: Relaxed, x0: Floats) -> _Found:
    area = np.abs(polygon_area(x0))
    matrix = relaxed.stress / area[..., None, None]
    bound = frobenius(relaxed.error) / area
    condition = amplification(bound, matrix) + area_growth(x0)
    residual = relaxed.found.residual
    return _Found(matrix, condition, residual, relaxed.found.ambiguity, np.zeros(condition.shape))


def _by_force(
    graph: GrainGraph, law: ContactLaw, state: ContactState, regime: Regimes, fall_back: bool
) -> _Found:
    compliance = translational_compliances(state, law, regime)
    growth = compliance_growth(state, law, regime)
    batch = np.broadcast_shapes(compliance.shape[:-3], graph.x0.shape[:-2])
    compliance = np.broadcast_to(compliance, (*batch, *compliance.shape[-3:]))
    x0 = np.broadcast_to(graph.x0, (*batch, *graph.x0.shape[-2:]))
    matrix, condition = force_method(compliance, x0, np.abs(polygon_area(x0)), growth)
    found = _Found(matrix, condition, np.zeros(batch), np.zeros(batch), np.zeros(batch))
    poor = ~(condition <= FORCE_METHOD_LIMIT)
    if fall_back and poor.any():
        blocks = contact_terms(graph, law, "blocked", state, regime)
        k, sizes = (
            replace(part, k=np.broadcast_to(part.k, compliance.shape)[poor])
            for part in (blocks.tangent, blocks.sizes)
        )
        radii = np.broadcast_to(blocks.radii, x0.shape[:-1])[poor]
        part = blocks._replace(tangent=k, sizes=sizes, radii=radii)
        other = _found(relax_centres(x0[poor], part, "blocked", None), x0[poor])
        answered = other.residual <= RESIDUAL_LIMIT
        # Where the force method has no answer at all, what the saddle system says of it stands.
        better = answered & (SADDLE_GAIN * other.condition < condition[poor])
        better |= ~np.isfinite(condition[poor])
        place = np.zeros(batch, dtype=bool)
        place[poor] = better
        for own, new in zip(found[:4], other[:4], strict=True):
            own[place] = new[better]
    return found
