"""Spin rules: how the spins of the grains follow the loop, or which of them nothing resists."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from loops.arrays import Floats, Regimes
from loops.contact_state import ContactState
from loops.errors import InputError
from loops.geometry import area_growth, boundary_vectors, polygon_area, require_loop
from loops.graph import GrainGraph
from loops.laws.protocol import ContactLaw
from loops.null_space import ROUNDING

# Rows of the spins' shear are of order one: below this a singular value is rounding.
GEAR_TOLERANCE = 1e-13


class LoopSpin(NamedTuple):
    """Spin `w = row . (H11, H12, H21, H22)` of all grains, (..., 4), and the error of the row."""

    row: Floats
    error: Floats


def spin_of_gradient(f: Floats) -> Floats:
    """(..., 4) spin `(L21 - L12)/2` per component of `H'`, `L = -H' F^-1`, F (..., 2, 2)."""
    det = f[..., 0, 0] * f[..., 1, 1] - f[..., 0, 1] * f[..., 1, 0]
    row = np.stack([-f[..., 0, 1], f[..., 0, 0], -f[..., 1, 1], f[..., 1, 0]], axis=-1)
    return np.asarray(0.5 * row / det[..., None])


def affine_spin(graph: GrainGraph) -> LoopSpin:
    """Spin of grains that turn with the loop, counter-clockwise positive.

    `F = 1 - H` is the mean over the polygon, `H` by the boundary formula (see `loop_strain`), or
    that of the cell; the identity where the reference is the current configuration.
    """
    if graph.x0 is graph.x and graph.cell0 is graph.cell:
        row = spin_of_gradient(np.eye(2))
        return LoopSpin(row, np.zeros(4))
    if graph.cell is not None and graph.cell0 is not None:
        f = graph.cell @ np.linalg.inv(graph.cell0)
        doubt = ROUNDING * np.abs(graph.cell) @ np.abs(np.linalg.inv(graph.cell0))
    else:
        f, doubt = _boundary_gradient(graph)
    return LoopSpin(spin_of_gradient(f), _spin_error(f, doubt))


def _boundary_gradient(graph: GrainGraph) -> tuple[Floats, Floats]:
    """`F = 1 + (1/V0) sum u_i (x) B_i` and its error, (..., 2, 2)."""
    try:
        require_loop(graph)
    except InputError:
        raise InputError(
            "spins 'affine'",
            "a packing without a cell, away from its reference",
            "a loop, a periodic cell, or the reference as it stands",
            "The rotation of a loop is that of its polygon.",
        ) from None
    start = graph.x0 - graph.x0[..., :1, :]
    end = graph.x - graph.x[..., :1, :]
    b = boundary_vectors(graph.x0)
    area = np.abs(polygon_area(graph.x0))[..., None, None]
    h = np.swapaxes(end - start, -1, -2) @ b / area
    terms = np.swapaxes(np.abs(start) + np.abs(end), -1, -2) @ np.abs(b) / area
    doubt = terms + np.abs(h) * area_growth(graph.x0)[..., None, None]
    return np.eye(2) + h, ROUNDING * (doubt + np.eye(2))


def _spin_error(f: Floats, doubt: Floats) -> Floats:
    """First order: `|F^-1| |dF| |F^-1|` for every entry, and the rounding of the determinant."""
    det = np.abs(f[..., 0, 0] * f[..., 1, 1] - f[..., 0, 1] * f[..., 1, 0])[..., None, None]
    adjugate = np.abs(f[..., ::-1, ::-1])
    adjugate[..., 0, 1], adjugate[..., 1, 0] = np.abs(f[..., 0, 1]), np.abs(f[..., 1, 0])
    inverse = adjugate / det
    error = inverse @ (doubt + ROUNDING * np.abs(f)) @ inverse
    return 0.5 * np.stack(
        [error[..., 0, 1], error[..., 1, 1], error[..., 0, 0], error[..., 1, 0]], axis=-1
    )


def other_arms(state: ContactState, law: ContactLaw) -> tuple[Floats, Floats]:
    """Arms `b_i, b_j` of spins, shared between the grains in the other way.

    By the point of contact (arms) where the law shares them by the radii, and the other way round:
    a change of less than the overlap, as objective as the law's own, `b_i + b_j` stays.
    """
    _, b_i, b_j = law.shear_kinematics(state)
    total = b_i + b_j
    share = state.radii_i / state.touching_length + state.arm_i / state.length - b_i / total
    return share * total, (1.0 - share) * total


def gear_projector(
    graph: GrainGraph,
    state: ContactState,
    law: ContactLaw,
    regime: Regimes,
    arms: tuple[Floats, Floats] | None = None,
) -> Floats:
    """(..., G, G) projector on the spins times radii that no contact feels.

    Gear modes: in an even loop of a law that shears by the radii, and between contacts that slide.
    They are null vectors of the tangent, exactly; of its transpose only if the law balances
    moments with the same arms.
    """
    stiffness, (_, b_i, b_j) = law.local_stiffness(state, regime), law.shear_kinematics(state)
    b_i, b_j = (b_i, b_j) if arms is None else arms
    felt = (stiffness[..., 0, 1] != 0) | (stiffness[..., 1, 1] != 0)
    rolls = np.broadcast_to(law.rolling_stiffness(state, regime) != 0, felt.shape)
    grains, radii, c = graph.grain_count, graph.radii, np.arange(graph.contact_count)
    i, j = graph.contacts.T
    batch = np.broadcast_shapes(felt.shape[:-1], b_i.shape[:-1], radii.shape[:-1])
    rows = np.zeros((*batch, max(grains, (1 + rolls.any()) * len(c)), grains))
    # Shear and roll per spin times radius of either grain, of order one.
    b_i, b_j = b_i / radii[..., i], b_j / radii[..., j]
    scale = np.where(felt, np.maximum(b_i, b_j), np.inf)
    rows[..., c, i] = b_i / scale
    rows[..., c, j] += b_j / scale
    if rolls.any():
        least = np.where(rolls, np.minimum(radii[..., i], radii[..., j]), 0.0)
        rows[..., len(c) + c, i] = least / radii[..., i]
        rows[..., len(c) + c, j] -= least / radii[..., j]
    _, s, vt = np.linalg.svd(rows, full_matrices=False)
    v = vt * (s <= GEAR_TOLERANCE)[..., None]
    return np.asarray(np.swapaxes(v, -1, -2) @ v)
