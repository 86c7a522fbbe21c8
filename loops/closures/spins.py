"""Spins of the grains of a loop: those that turn with it, and gear modes that no contact feels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from loops.arrays import ROUNDING, Flags, Floats, Integers, Regimes
from loops.errors import InputError
from loops.geometry import area_growth, boundary_vectors, polygon_area, require_loop
from loops.graph import ContactState, GrainGraph
from loops.laws.frictional import ContactLaw

# Singular values of the spins' shear, whose rows are of order one, below which they are rounding.
GEAR_TOLERANCE = 2e-15
# Those below which a mode has next to no stiffness and a load in proportion: held it gives another
# tangent (measured on loops of four, theory 11.1).
SOFT_GEAR = 1e-2


class LoopSpin(NamedTuple):
    """Spin `w = row . (H11, H12, H21, H22)` of all grains, (..., 4), and the error of the row."""

    row: Floats
    error: Floats


def spin_of_gradient(f: Floats) -> Floats:
    """Return (..., 4) the spin `(L21 - L12)/2` per component of `H'`; `L = -H' F^-1`."""
    det = f[..., 0, 0] * f[..., 1, 1] - f[..., 0, 1] * f[..., 1, 0]
    row = np.stack([-f[..., 0, 1], f[..., 0, 0], -f[..., 1, 1], f[..., 1, 0]], axis=-1)
    return np.asarray(0.5 * row / det[..., None])


def affine_spin(graph: GrainGraph) -> LoopSpin:
    """Return the spin of grains that turn with the loop, counter-clockwise positive.

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
        # `F = 1 + (1/V0) sum u_i (x) B_i`.
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
        f, doubt = np.eye(2) + h, ROUNDING * (doubt + np.eye(2))
    return LoopSpin(spin_of_gradient(f), _spin_error(f, doubt))


def _spin_error(f: Floats, doubt: Floats) -> Floats:
    """Return the error of the spin of a gradient `F` that errs by `doubt`, to first order.

    Entries of `F^-1` err by `|F^-1| |dF| |F^-1|`, the determinant by its rounding.
    """
    det = np.abs(f[..., 0, 0] * f[..., 1, 1] - f[..., 0, 1] * f[..., 1, 0])[..., None, None]
    adjugate = np.abs(f[..., ::-1, ::-1])
    adjugate[..., 0, 1], adjugate[..., 1, 0] = np.abs(f[..., 0, 1]), np.abs(f[..., 1, 0])
    inverse = adjugate / det
    error = inverse @ (doubt + ROUNDING * np.abs(f)) @ inverse
    return 0.5 * np.stack(
        [error[..., 0, 1], error[..., 1, 1], error[..., 0, 0], error[..., 1, 0]], axis=-1
    )


def other_arms(state: ContactState, law: ContactLaw) -> tuple[Floats, Floats]:
    """Return the arms `b_i, b_j` of spins by the other rule of sharing them between the grains.

    By the point of contact (arms) if the law shares them by the radii, and vice versa: a change of
    less than the overlap, as objective as the law's own rule; `b_i + b_j` stays.
    """
    _, b_i, b_j = law.shear_kinematics(state)
    total = b_i + b_j
    share = state.radii_i / state.touching_length + state.arm_i / state.length - b_i / total
    return share * total, (1.0 - share) * total


def gear_projector(
    contacts: Integers,
    radii: Floats,
    state: ContactState,
    law: ContactLaw,
    regime: Regimes,
    arms: tuple[Floats, Floats] | None = None,
) -> tuple[Floats, Flags]:
    """Return the projector (..., G, G) on gear modes, in spins times radii, and (...) soft ones.

    Gear modes are spins that no contact feels: in an even loop of a law that shears by the radii,
    and between contacts that slide. They are null vectors of the tangent, exactly; of its transpose
    only if the law balances moments with the same arms. A soft one is null but for next to nothing,
    as in even loops of a law that shears by the branch.
    """
    stiffness, (_, b_i, b_j) = law.local_stiffness(state, regime), law.shear_kinematics(state)
    b_i, b_j = (b_i, b_j) if arms is None else arms
    felt = (stiffness[..., 0, 1] != 0) | (stiffness[..., 1, 1] != 0)
    rolls = np.broadcast_to(law.rolling_stiffness(state, regime) != 0, felt.shape)
    grains, c, (i, j) = radii.shape[-1], np.arange(len(contacts)), contacts.T
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
    null = s <= GEAR_TOLERANCE
    if grains == len(c) and (np.bincount(contacts.ravel()) == 2).all():
        # Around a ring that shears everywhere arms cancel two by two (equal grains, mirror images),
        # or by chance.
        uneven = np.sort(np.abs(b_i - b_j) / np.maximum(b_i, b_j), axis=-1)
        paired = (uneven[..., 1::2] - uneven[..., : len(c) - 1 : 2] <= ROUNDING).all(axis=-1)
        null &= ~(felt.all(axis=-1) & ~paired)[..., None]
    v = vt * null[..., None]
    soft = np.asarray((~null & (s < SOFT_GEAR)).any(axis=-1))
    return np.asarray(np.swapaxes(v, -1, -2) @ v), soft
