"""How the contacts of one graph move per unit of `H'` under a closure that relaxes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from loops import (
    ContactState,
    GrainGraph,
    LinearFrictional,
    assemble_tangent,
    boundary_vectors,
    contact_state,
    polygon_area,
)
from loops.closures import Closure, Spins
from loops.closures.macro_tangent import AMBIGUITY_LIMIT, RESIDUAL_LIMIT
from loops.closures.spins import affine_spin
from loops.null_space import solve_through_null_space

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


def contact_rates(
    graph: GrainGraph,
    law: LinearFrictional,
    closure: Closure,
    spins: Spins,
    regime: NDArray[np.int8],
    which: NDArray[np.int64],
) -> tuple[Floats, Floats, Mask]:
    """Relative displacement rates of some contacts per component of `H'`.

    Parameters
    ----------
    graph : GrainGraph
        A loop in R copies, which differ in shear forces alone.
    law, closure, spins
        As in `macroscopic_tangent`; affine only with free spins.
    regime : (R, C) array of int8
        Regimes of each copy.
    which : (E,) array of int
        Contacts.

    Returns
    -------
    un, ut : (R, E, 4) array
        Positive when the contact opens; along `t`, spins included.
    known : (R,) array of bool
        Whether the equations determine them.
    """
    tangent = assemble_tangent(graph, law, spins=spins != "blocked", regime=regime)
    rows = _rows(graph, contact_state(graph), law, which, spins != "blocked")
    if closure == "affine":
        rates, known = _affine(graph, tangent, rows)
    else:
        rates, known = _traction(graph, tangent, rows, spins)
    return rates[:, : len(which)], rates[:, len(which) :], known


def _rows(
    graph: GrainGraph,
    state: ContactState,
    law: LinearFrictional,
    which: NDArray[np.int64],
    spins: bool,
) -> Floats:
    """(2 E, 2 G) or (2 E, 3 G): `un'`, then `ut'`, per rate of the freedoms."""
    grains, each = graph.grain_count, np.arange(len(which))
    i, j = graph.contacts[which].T
    g, b_i, b_j = (np.broadcast_to(a, state.length.shape) for a in law.shear_kinematics(state))
    vectors = np.concatenate([state.n[which], g[which, None] * state.t[which]])
    rows = np.zeros((2 * len(which), (3 if spins else 2) * grains))
    for k, axis in enumerate((0, 1)):
        for half in (0, len(which)):
            part = vectors[half : half + len(which), k]
            rows[half + each, 2 * i + axis] -= part
            rows[half + each, 2 * j + axis] += part
    if spins:
        rows[len(which) + each, 2 * grains + i] -= b_i[which]
        rows[len(which) + each, 2 * grains + j] -= b_j[which]
    return rows


def _affine(graph: GrainGraph, tangent: Floats, rows: Floats) -> tuple[Floats, Mask]:
    """Centres follow `x' = -H' x0`; the spins relax to zero moment."""
    moves = 2 * graph.grain_count
    motion = np.zeros((moves, 4))
    motion[0::2, :2] = motion[1::2, 2:] = -graph.x0
    scale = np.abs(tangent).max(axis=(-2, -1), keepdims=True)
    scale = np.where(scale > 0.0, scale, 1.0)
    found = solve_through_null_space(
        tangent[:, moves:, moves:] / scale,
        -(tangent[:, moves:, :moves] / scale) @ motion,
        rows[:, moves:],
    )
    # Where nothing loads the spins there is no residual to speak of.
    idle = np.abs(tangent[:, moves:]).max(axis=(-2, -1)) == 0.0
    known = (found.residual <= RESIDUAL_LIMIT) | idle
    rates = rows[:, :moves] @ motion + rows[:, moves:] @ found.x
    return rates, known & (found.ambiguity <= AMBIGUITY_LIMIT)


def _traction(
    graph: GrainGraph, tangent: Floats, rows: Floats, spins: Spins
) -> tuple[Floats, Mask]:
    """Uniform stress loads the polygon, the centres relax: unknown moves, spins and stress."""
    grains, moves = graph.grain_count, 2 * graph.grain_count
    area = abs(float(polygon_area(graph.x0)))
    length = np.sqrt(area)
    kept = moves if spins == "affine" else tangent.shape[-1]
    scale = np.where(np.arange(tangent.shape[-1]) < moves, length, 1.0)
    scaled = scale[:, None] * tangent * scale
    size = np.abs(scaled).max(axis=(-2, -1), keepdims=True)
    k = scaled / np.where(size > 0.0, size, 1.0)
    border = _boundary(graph.x0 / length, kept)
    system = np.zeros((len(k), kept + 4, kept + 4))
    system[:, :kept, :kept] = k[:, :kept, :kept]
    system[:, :kept, kept:], system[:, kept:, :kept] = border, border.T
    rhs = np.zeros((len(k), kept + 4, 4))
    rhs[:, kept:] = -np.eye(4)
    given = np.zeros((len(rows), 4))
    if spins == "affine":
        spin = affine_spin(graph)
        rhs[:, :kept] -= k[:, :kept, kept:].sum(axis=-1)[..., None] * spin
        given = rows[:, kept:].sum(axis=-1)[:, None] * spin
    observed = np.zeros((len(rows) + 4, kept + 4))
    observed[: len(rows), :kept] = rows[:, :kept] * scale[:kept] / length
    observed[len(rows) :, kept:] = np.eye(4)
    found = solve_through_null_space(system, rhs, observed, _translations(grains, kept + 4))
    rates = length * (observed[: len(rows)] @ found.x) + given
    known = (found.residual <= RESIDUAL_LIMIT) & (found.ambiguity <= AMBIGUITY_LIMIT)
    return rates, known


def _boundary(x0: Floats, size: int) -> Floats:
    """(size, 4): force on the freedoms per component of P."""
    vectors = boundary_vectors(x0)
    matrix = np.zeros((size, 4))
    for axis in (0, 1):
        matrix[axis : 2 * len(x0) : 2, 2 * axis : 2 * axis + 2] = vectors
    return matrix


def _translations(grains: int, size: int) -> Floats:
    """(size, 2) orthonormal rigid translations, null vectors that no contact sees."""
    z = np.zeros((size, 2))
    z[0 : 2 * grains : 2, 0] = z[1 : 2 * grains : 2, 1] = grains**-0.5
    return z
