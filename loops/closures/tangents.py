"""Macroscopic tangents of a loop under both closures, with bounds on their error."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops.arrays import ROUNDING, Flags, Floats, all_finite, frobenius
from loops.assembly import (
    compliance_growth,
    contact_regime,
    local_sizes,
    translational_blocks,
    translational_compliances,
)
from loops.closures.system import (
    Closure,
    HasLaw,
    Relaxed,
    Spins,
    closure_form,
    contact_springs,
    named_closure,
    relax,
    relaxed_loop,
    spring_sizes,
    with_law,
)
from loops.errors import InputError, check_choice
from loops.geometry import (
    area_growth,
    checked_volume,
    from_centroid,
    outward,
    polygon_area,
    reference_volume,
    require_loop,
    require_plane,
    volume_growth,
)
from loops.graph import GrainGraph, contact_state
from loops.laws.frictional import ContactLaw
from loops.shown import Shown

# Limits within which a solve is trusted; see `MacroTangent`.
RESIDUAL_LIMIT = 1e-8
AMBIGUITY_LIMIT = 1e-6
# Beyond this share of the operator a bound of first order in rounding means nothing.
ERROR_LIMIT = 0.1


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
        condition = f"{np.max(self.condition, initial=1.0):.1e}"
        shape = self.matrix.shape
        return {"closure": self.closure, "spins": self.spins, "shape": shape, "trusted": good,
                "unit": "force/length", "condition up to": condition}  # fmt: skip

    def __str__(self) -> str:
        good = int(np.count_nonzero(self.trusted))
        return (
            f"{self.closure} tangent, spins {self.spins}: {good} of {self.trusted.size} trusted, "
            f"condition up to {np.max(self.condition, initial=1.0):.1e}"
        )


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


TractionMethod = Literal["auto", "force", "saddle"]
# Beyond this amplification of the force method the saddle system is solved as well.
FORCE_METHOD_LIMIT = 1e4
# The saddle system replaces the force method if its error is smaller by this factor: the force
# method keeps the directions of soft operators.
SADDLE_GAIN = 100.0
# Fields of the tangent that it replaces.
REPLACED = ("matrix", "condition", "residual", "trusted")


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
    state = contact_state(graph)
    regimes = contact_regime(state, law, regime)
    growth = volume_growth(graph) if volume is None else 0.0
    if spins != "blocked":
        require_plane(graph.x, "centres of the grains")
        relaxed, turned = relaxed_loop(graph, law, "affine", spins, state, regimes, v0)
        return of_relaxed(relaxed, "affine", spins, v0, growth, turned)
    d0 = graph.reference_branches
    blocks, pair = translational_blocks(state, law, regimes), d0[..., :, None] * d0[..., None, :]
    total = np.einsum("...cik,...cjl->...ijkl", blocks, pair, optimize=True)
    components = d0.shape[-1] ** 2
    matrix = total.reshape(*total.shape[:-4], components, components)
    sizes = frobenius(local_sizes(state, law, regimes))
    bound = ROUNDING * (sizes * (d0 * d0).sum(axis=-1)).sum(axis=-1)
    matrix = matrix / v0[..., None, None]
    return solved(matrix, "affine", spins, v0, amplification(bound / v0, matrix) + growth)


def traction_tangent(
    graph: GrainGraph | HasLaw,
    law: ContactLaw | None = None,
    *,
    spins: Spins = "blocked",
    regime: ArrayLike | None = None,
    volume: ArrayLike | None = None,
    method: TractionMethod = "auto",
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
    graph, law = with_law(graph, law)
    check_choice("spins", spins, get_args(Spins))
    check_choice("method", method, get_args(TractionMethod))
    require_loop(graph)
    polygon = np.abs(polygon_area(graph.x0))
    if not np.all(polygon > 0):
        where = "reference polygon of the loop"
        remedy = "Uniform traction needs a polygon: the centres must not lie on a line."
        raise InputError(where, f"area {np.min(polygon)}", "a positive area", remedy)
    v0 = polygon if volume is None else checked_volume(volume, graph)
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
    # The area of the polygon stands in the strain, and in V0 once more where that is not its own.
    growth = area_growth(graph.x0) * (1.0 if volume is None else 2.0)
    if method == "saddle" or not applies:
        relaxed, turned = relaxed_loop(graph, law, "traction", spins, state, regimes, v0)
        return of_relaxed(relaxed, "traction", spins, v0, growth, turned)
    compliance = translational_compliances(state, law, regimes)
    batch = np.broadcast_shapes(compliance.shape[:-3], graph.x0.shape[:-2])
    compliance = np.broadcast_to(compliance, (*batch, *compliance.shape[-3:]))
    x0, v0 = np.broadcast_to(graph.x0, (*batch, *graph.x0.shape[-2:])), np.broadcast_to(v0, batch)
    matrix, condition = force_method(compliance, x0, compliance_growth(state, law, regimes))
    matrix = matrix * (np.abs(polygon_area(x0)) / v0)[..., None, None]
    found = solved(matrix, "traction", "blocked", v0, condition + (growth - area_growth(x0)))
    poor = ~(condition <= FORCE_METHOD_LIMIT)
    if method == "force" or not poor.any():
        return found
    radii = np.broadcast_to(graph.radii, x0.shape[:-1])[poor]
    form = closure_form("blocked", graph.contacts, radii, v0[poor], x0=x0[poor])
    S, sizes = (
        np.broadcast_to(of(state, law, regimes, "blocked"), (*batch, graph.contact_count, 4, 4))
        for of in (contact_springs, spring_sizes)
    )
    part = np.broadcast_to(growth, batch)[poor]
    relaxed = relax(form, S[poor], sizes[poor])
    other = of_relaxed(relaxed, "traction", "blocked", v0[poor], part)
    answered = other.residual <= RESIDUAL_LIMIT
    # Without an answer of the force method, the status by the saddle system is kept.
    better = answered & (SADDLE_GAIN * other.condition < found.condition[poor])
    better |= ~np.isfinite(found.condition[poor])
    place = np.zeros(batch, dtype=bool)
    place[poor] = better
    fields: dict[str, Any] = {name: np.array(getattr(found, name)) for name in REPLACED}
    for name, values in fields.items():
        values[place] = getattr(other, name)[better]
    return replace(found, **fields)


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
    'affine tangent, spins blocked: 1 of 1 trusted, condition up to 2.4e+00'
    """
    tangent = affine_tangent if named_closure(closure) == "affine" else traction_tangent
    return tangent(graph, law, spins=spins, regime=regime, volume=volume)


def force_method(compliance: Floats, x0: Floats, growth: Floats) -> tuple[Floats, Floats]:
    """Traction tangent (..., 4, 4) of rings with spins blocked, and its condition (...).

    Equilibrium leaves one unknown vector per loop, `f_c = f^ - P m_c` with
    `m_c = R (x0_c + x0_{c+1})/2`; closure of the ring gives the compliance

        C = (1/V0) [sum k^-1_ik m_j m_l - (sum k^-1 m_j)(sum k^-1)^-1(sum k^-1 m_l)]

    and `A = C^-1`, from 2x2 inverses alone; not finite if a block or C is singular.
    Theory, equation (4.11). `compliance` (..., n, 2, 2) and `growth` (..., n) are those of
    `translational_compliances`.

    A change of one compliance changes C by itself times `(m_c - g)^2`, `g` the change of the
    redundant force: the condition is the sum of these sizes over V0, times `|A|`. Each axis has a
    length unit of its own, so that a flat loop has no larger condition but by the rounding of V0.
    """
    centred, volume = from_centroid(x0), np.abs(polygon_area(x0))
    m = outward(x0, 0.5 * (centred + np.roll(centred, -1, axis=-2)))
    scale = np.sqrt((m * m).mean(axis=-2))
    m = m / scale[..., None, :]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # single[i, a, j] = sum k^-1_ia m_j, and the ring's own compliance, sum k^-1.
        single = np.einsum("...cik,...cj->...ikj", compliance, m, optimize=True)
        total = compliance.sum(axis=-3)
        det = total[..., 0, 0] * total[..., 1, 1] - total[..., 0, 1] * total[..., 1, 0]
        adjugate = np.swapaxes(total[..., ::-1, ::-1], -1, -2) * [[1.0, -1.0], [-1.0, 1.0]]
        closure = np.asarray(adjugate / det[..., None, None])
        pair = m[..., :, None] * m[..., None, :]
        double = np.einsum("...cik,...cjl->...ijkl", compliance, pair, optimize=True)
        left = np.einsum("...iaj,...ab->...ijb", single, closure)
        right = np.einsum("...ijb,...bkl->...ijkl", left, single)
        c = (double - right).reshape(*compliance.shape[:-3], 4, 4) / volume[..., None, None]
        # NaN where C is singular or not finite.
        usable = all_finite(c) & (np.linalg.det(np.nan_to_num(c)) != 0)
        safe = np.where(usable[..., None, None], c, np.eye(4))
        scaled = np.where(usable[..., None, None], np.linalg.inv(safe), np.nan)
        size = frobenius(scaled)
        columns = np.concatenate([scale, scale], axis=-1)
        matrix = scaled / (columns[..., :, None] * columns[..., None, :])
        lever = frobenius(closure) * np.sqrt((single * single).sum(axis=(-3, -2, -1)))
        # The midpoints err by their mean distance from the centroid, one in these units.
        reach = np.linalg.norm(m, axis=-1) + lever[..., None] + 1.0
        terms = growth * frobenius(compliance) * reach * reach
        # The error of the scaled operator, in the norm of the operator itself.
        share = size / (scale.min(axis=-1) ** 2 * frobenius(matrix))
        condition = size * terms.sum(axis=-1) / volume * share + area_growth(x0)
    return matrix, np.where(np.isfinite(condition), condition, np.inf)


def ring_equations(compliance: Floats, m: Floats) -> tuple[Floats, Floats]:
    """Equations of the force method for `(H', P', f^')`, (6, 10), and the motions of the contacts.

    `d' = -k^-1 (f^' - P' m)`, (n, 4, 10) with the spins, which are blocked; `V0 H' = sum d' (x) m`
    and `sum d' = 0`. For one ring, `m` (n, 2) over `sqrt(V0)`.
    """
    motion = np.zeros((len(m), 4, 10))
    pressed = compliance[:, :, :, None] * m[:, None, None, :]
    motion[:, :2, 4:8], motion[:, :2, 8:] = pressed.reshape(-1, 2, 4), -compliance
    gradient = np.einsum("cir,cj->ijr", motion[:, :2], m).reshape(4, 10)
    gradient[:, :4] -= np.eye(4)
    return np.concatenate([gradient, motion[:, :2].sum(axis=0)]), motion


def of_relaxed(
    relaxed: Relaxed,
    closure: Closure,
    spins: Spins,
    volume: Floats,
    growth: Floats | float,
    sensitivity: Floats | float = 0.0,
) -> MacroTangent:
    """Tangent of a solution; `growth` is added to the condition for the rounding of the area."""
    condition = amplification(frobenius(relaxed.error), relaxed.stress) + growth
    status = relaxed.residual, relaxed.ambiguity, sensitivity
    return solved(relaxed.stress, closure, spins, volume, condition, *status)
