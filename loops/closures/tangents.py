"""Macroscopic tangents of a loop under both closures, with bounds on their error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops.arrays import ROUNDING, Flags, Floats, all_finite, frobenius
from loops.assembly import contact_regime, local_sizes, translational_blocks
from loops.closures.null_space import AMBIGUITY_LIMIT, RESIDUAL_LIMIT
from loops.closures.ring import ERROR_LIMIT
from loops.closures.rings import Solved, is_ring, tangents_of_rings
from loops.closures.system import (
    Closure,
    HasLaw,
    Spins,
    named_closure,
    relaxed_loop,
    with_law,
)
from loops.errors import InputError, check_choice
from loops.geometry import (
    checked_volume,
    polygon_area,
    reference_volume,
    require_loop,
    volume_growth,
)
from loops.graph import GrainGraph, contact_state
from loops.laws.frictional import ContactLaw
from loops.shown import Shown


@dataclass(frozen=True, eq=False, repr=False)
class MacroTangent(Shown):
    """Macroscopic tangent `A` of a graph, `P' = A H'`, batch axes `...` first.

    Components in the order (11, 12, 21, 22); `P` is the nominal stress and `H` the displacement
    gradient on the reference, both positive in compression.

    Attributes
    ----------
    matrix : (..., 4, 4) array
        The operator (force per length). Not a number where `trusted` is false.
    closure : {'affine', 'traction'}
        How the surrounding medium drives the grains.
    spins : {'blocked', 'affine', 'free'}
        Rule of the grains' spins: held, turning with the loop, relaxed.
    volume : (...) array
        Reference area V0 (length squared).
    condition : (...) array
        Factor by which rounding of the data and of the solve is amplified, relative to the
        operator's norm: contacts that cancel, soft directions, gradients of a loop that left its
        reference, a polygon with next to no area, and the residual of the solve.
    residual : (...) array
        Relative residual of the solve; 0 where nothing is solved.
    trusted : (...) array of bool
        False where the solve has no answer (residual above 1e-8), more than one (a null vector of
        the system that changes the stress), or no digit left (error a tenth of the operator).
    sensitivity : (...) array
        Even loops with free spins: how far the smallest eigenvalue of Ks, in (11, 22) or in the
        symmetric subspace, goes to zero and beyond when two grains share the lever arms of their
        spins by the radii instead of by the point of contact, or the other way round, which
        moves them by less than the overlap (force per length). Loops of four change sign: their
        gear mode has next to no stiffness and next to no load. 0 where the change leads away
        from zero, and for odd loops.
    """

    matrix: Floats
    closure: Closure
    spins: Spins
    volume: Floats
    condition: Floats
    residual: Floats
    trusted: Flags
    sensitivity: Floats

    @property
    def rounding(self) -> Floats:
        """(...) bound on the error of the operator from rounding, `8 eps condition |A|`."""
        # Tables judge many at once, nearly all of them trusted: no copy then.
        matrix = self.matrix
        if not self.trusted.all():
            matrix = np.where(self.trusted[..., None, None], matrix, 0.0)
        bound = ROUNDING * np.where(self.trusted, self.condition, 0.0) * frobenius(matrix)
        return np.where(self.trusted, bound, np.inf)

    @property
    def error(self) -> Floats:
        """(...) bound on the error of the operator, Frobenius (force per length).

        Bound on rounding plus `sensitivity`: an eigenvalue of Ks within it has no sign. Infinite
        where the operator is not trusted.
        """
        return self.rounding + self.sensitivity

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """The operator: numpy accepts a tangent as a matrix."""
        return np.array(self.matrix, dtype, copy=copy)

    def facts(self) -> dict[str, object]:
        """Names and values shown at the prompt and in a notebook."""
        good = f"{int(np.count_nonzero(self.trusted))} of {self.trusted.size}"
        error = np.max(self.error, initial=0.0, where=self.trusted)
        shape = self.matrix.shape
        return {"closure": self.closure, "spins": self.spins, "shape": shape, "trusted": good,
                "unit": "force/length", "error up to": f"{error:.1e} force/length"}  # fmt: skip

    def __str__(self) -> str:
        facts = self.facts()
        good, error = facts["trusted"], facts["error up to"]
        return f"{self.closure} tangent, spins {self.spins}: {good} trusted, error up to {error}"


def amplification(bound: Floats, matrix: Floats) -> Floats:
    """(...) error bound over rounding times the operator's norm, at least 1; 1 for a zero one."""
    size = ROUNDING * frobenius(matrix)
    with np.errstate(divide="ignore", invalid="ignore"):
        factor = np.where((size == 0) & (bound == 0), 1.0, bound / size)
    return np.where(np.isfinite(factor), np.maximum(factor, 1.0), np.inf)


def solved(
    matrix: Floats,
    closure: Closure,
    spins: Spins,
    volume: ArrayLike,
    condition: Floats,
    residual: ArrayLike = 0.0,
    ambiguity: ArrayLike = 0.0,
    sensitivity: ArrayLike = 0.0,
) -> MacroTangent:
    """Tangent from a solve; not a number where it is inconsistent, ambiguous or without a digit.

    `ambiguity` (...) is the largest relative stress of a null vector of the system.
    """
    trusted = all_finite(matrix)
    trusted &= (np.asarray(residual) <= RESIDUAL_LIMIT) & (np.asarray(ambiguity) <= AMBIGUITY_LIMIT)
    trusted &= ROUNDING * condition < ERROR_LIMIT
    if not np.all(trusted):
        matrix = np.where(trusted[..., None, None], matrix, np.nan)
    volume, condition, residual, sensitivity = (
        np.broadcast_to(a, trusted.shape) for a in (volume, condition, residual, sensitivity)
    )
    return MacroTangent(matrix, closure, spins, volume, condition, residual, trusted, sensitivity)


def affine_tangent(
    graph: GrainGraph | HasLaw,
    law: ContactLaw | None = None,
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
    graph : GrainGraph, or loop or scene
        A loop or a packing, batch axes `...` allowed.
    law : ContactLaw, optional
        Contact law; that of the loop or scene if left out.
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
    graph, law = with_law(graph, law)
    check_choice("spins", spins, get_args(Spins))
    v0 = reference_volume(graph) if volume is None else checked_volume(volume, graph)
    return tangent_of(graph, law, "affine", spins, regime, v0, 1 if volume is None else 0)


def traction_tangent(
    graph: GrainGraph | HasLaw,
    law: ContactLaw | None = None,
    *,
    spins: Spins = "blocked",
    regime: ArrayLike | None = None,
    volume: ArrayLike | None = None,
) -> MacroTangent:
    """Macroscopic tangent under the traction closure.

    Uniform nominal stress acts on the polygon, `F_i = -P B_i`, and the centres relax. With free
    spins a gear mode whose moments nothing balances stands still: the limit of a vanishing
    resistance of the spins. Theory, equations (4.8) and (4.11).

    Parameters
    ----------
    graph : GrainGraph, or loop or scene
        A loop: contacts 0..n-1 are the ring, chords may follow; batch axes `...` allowed.
    law : ContactLaw, optional
        Contact law; that of the loop or scene if left out.
    spins : {'blocked', 'affine', 'free'}
        Spins held; turning with the loop; relaxed to zero moment.
    regime : (..., C) array of Regime, optional
        Regime of each contact; the graph's, or read from the state by the law, if left out.
    volume : (...) array, optional
        Reference area V0 that `P` is taken over (length squared); the polygon's if left out.

    Returns
    -------
    MacroTangent
        The operator, (..., 4, 4), in the order (11, 12, 21, 22), nan where not trusted.

    Raises
    ------
    InputError
        If the graph is no loop, its polygon has no area, a volume is not positive, a regime is
        none of `Regime`, or the law's parameters don't fit the contacts.

    Examples
    --------
    >>> from loops import GrainGraph, LinearFrictional, traction_tangent
    >>> x = [[0, 0], [1, 0], [1, 1], [0, 1]]
    >>> square = GrainGraph(x=x, radii=[0.5] * 4, contacts=[[0, 1], [1, 2], [2, 3], [3, 0]])
    >>> tangent = traction_tangent(square, LinearFrictional(kn=1.0, kt=0.5))
    >>> tangent.matrix.diagonal().round(12).tolist()
    [2.0, 1.0, 1.0, 2.0]
    """
    graph, law = with_law(graph, law)
    check_choice("spins", spins, get_args(Spins))
    require_loop(graph)
    polygon = np.abs(polygon_area(graph.x0))
    if not np.all(polygon > 0):
        where = "reference polygon of the loop"
        remedy = "Uniform traction needs a polygon: the centres must not lie on a line."
        raise InputError(where, f"area {np.min(polygon)}", "a positive area", remedy)
    v0 = polygon if volume is None else checked_volume(volume, graph)
    # The area of the polygon stands in the strain, and in V0 once more where that is not its own.
    return tangent_of(graph, law, "traction", spins, regime, v0, 1 if volume is None else 2)


def macroscopic_tangent(
    graph: GrainGraph,
    law: ContactLaw,
    closure: Closure | None = None,
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
        Without a closure or for an unknown one, and as the closures do.

    Examples
    --------
    >>> from loops import GrainGraph, LinearFrictional, macroscopic_tangent
    >>> x = [[0, 0], [1, 0], [1, 1], [0, 1]]
    >>> square = GrainGraph(x=x, radii=[0.5] * 4, contacts=[[0, 1], [1, 2], [2, 3], [3, 0]])
    >>> str(macroscopic_tangent(square, LinearFrictional(kn=1.0, kt=0.5), "affine"))
    'affine tangent, spins blocked: 1 of 1 trusted, error up to 2.2e-14 force/length'
    """
    tangent = affine_tangent if named_closure(closure) == "affine" else traction_tangent
    return tangent(graph, law, spins=spins, regime=regime, volume=volume)


def tangent_of(
    graph: GrainGraph,
    law: ContactLaw,
    closure: Closure,
    spins: Spins,
    regime: ArrayLike | None,
    volume: Floats,
    areas: int,
) -> MacroTangent:
    """Tangent of a ring by its own equations, of another graph by the closure system.

    The rounding of the area of the polygon or cell stands in the operator so many times.
    """
    state = contact_state(graph)
    regimes = contact_regime(state, law, regime)
    if is_ring(graph, law, spins, state, regimes):
        found = tangents_of_rings(graph, law, closure, spins, state, regimes)
        return of_ring(found, closure, spins, volume, areas * found.growth)
    growth = areas * volume_growth(graph) if areas else 0.0
    if closure == "affine" and spins == "blocked":
        # One sum over the contacts, in little memory: packings are large.
        d0, blocks = graph.reference_branches, translational_blocks(state, law, regimes)
        pair = d0[..., :, None] * d0[..., None, :]
        total = np.einsum("...cik,...cjl->...ijkl", blocks, pair, optimize=True)
        matrix = total.reshape(*total.shape[:-4], 4, 4) / volume[..., None, None]
        sizes = frobenius(local_sizes(state, law, regimes)) * (d0 * d0).sum(axis=-1)
        bound = ROUNDING * sizes.sum(axis=-1) / volume
        return solved(matrix, closure, spins, volume, amplification(bound, matrix) + growth)
    relaxed, turned = relaxed_loop(graph, law, closure, spins, state, regimes, volume)
    condition = amplification(frobenius(relaxed.error), relaxed.stress) + growth
    status = relaxed.residual, relaxed.ambiguity, turned
    return solved(relaxed.stress, closure, spins, volume, condition, *status)


def of_ring(
    found: Solved, closure: Closure, spins: Spins, volume: Floats | None, growth: Floats | float
) -> MacroTangent:
    """Tangent of loops that were solved over the areas of their polygons, over another `volume`."""
    matrix, error, sensitivity, area = found.matrix, found.error, found.sensitivity, found.area
    if volume is not None:
        share = area / volume
        matrix, error = share[..., None, None] * matrix, share * error
        sensitivity, area = share * sensitivity, volume + 0.0 * area
    condition = amplification(error, matrix) + growth
    status = found.residual, found.ambiguity, sensitivity
    return solved(matrix, closure, spins, area, condition, *status)
