"""The H-model's cell: a hexagon that its normal strains drive, its shoulders free along the axis.

F. Nicot, F. Darve, The H-microdirectional model: Accounting for a mesoscopic scale, Mechanics of
Materials 43 (2011) 918-929; from its geometry and balance, equations (12.6) and (12.7).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loops.arrays import Flags, Floats
from loops.errors import InputError
from stability.material.contact_model import ContactSteps
from stability.material.kernels import FX, FY, KXX, KXY, KYX, KYY, REGIME
from stability.material.loop_set import LoopSet

# Rows of a hexagon that stand for its four inclined contacts, and for its two axial ones.
CONTACT_ROWS = (2, 1)
CONTACT_COUNTS = np.array([4, 2])
# Sides that differ by no more than this share of the longest are equal.
EQUAL = 1e-9
# Change of an axial branch, over its length, that is rounding.
ROUNDED_CHANGE = 1e-15
# Halvings and Newton steps in which the axial branch is found to rounding.
MOST_AXIAL_STEPS = 100


@dataclass(frozen=True, eq=False)
class Cells:
    """Hexagons of a block: axes (L, 2, 2), extents `L10`, `L20` (L, 2) and areas (L,)."""

    axes: Floats
    extent: Floats
    area: Floats

    def take(self, loops: slice) -> Cells:
        """Return the picked cells."""
        return Cells(self.axes[loops], self.extent[loops], self.area[loops])


def cells_of(loops: LoopSet) -> tuple[Cells, Floats]:
    """Return the cells of a set of hexagons, and their branches (L, 2, 2) in the cells' frames.

    The axis runs from grain 3 to grain 0; `InputError` unless the hexagon is its own mirror image
    about it and across it.
    """
    if (loops.orders != 6).any():
        received = f"loops of orders {np.unique(loops.orders).tolist()}"
        raise InputError("loops of a cell closure", received, "hexagons", "Use 'traction'.")
    x = loops.x.reshape(-1, 6, 2)
    axis = x[:, 0] - x[:, 3]
    axis = axis / np.linalg.norm(axis, axis=-1, keepdims=True)
    axes = np.stack([axis, np.stack([-axis[:, 1], axis[:, 0]], axis=-1)], axis=1)
    branches = np.einsum("lij,lcj->lci", axes, loops.branches.reshape(-1, 6, 2))
    size = np.abs(branches).max(axis=(1, 2))
    inclined = np.abs(branches[:, [0, 2, 3, 5]])
    wrong = np.abs(inclined - inclined[:, :1]).max(axis=(1, 2)) > EQUAL * size
    wrong |= np.abs(branches[:, [1, 4], 1]).max(axis=1) > EQUAL * size
    force = loops.shear_force.reshape(-1, 6)
    wrong |= (force != 0.0).any(axis=1)
    if wrong.any():
        received = f"loop {int(wrong.argmax())} without these mirror planes, or with shear forces"
        expected = "hexagons with mirror planes along and across the axis from grain 3 to grain 0"
        raise InputError("loops of a cell closure", received, expected, "See patterns.hexagon.")
    extent = np.stack([x[:, 0] - x[:, 3], x[:, 1] - x[:, 5]], axis=1)
    extent = np.abs(np.einsum("lij,lij->li", axes, extent))
    first = np.abs(branches[:, CONTACT_ROWS, :])
    return Cells(axes, extent, loops.areas), first


def cell_steps(
    cells: Cells, steps: ContactSteps, touching: Floats, U: Floats, start: Floats, shear: Floats
) -> tuple[Floats, Floats, Floats, Floats, Flags]:
    """Take one step of cells under the stretch `U` (q, 2, 2).

    `start` (q, 2 L, 2) and `shear` (q, 2 L) are those of an inclined and the axial contact of each
    cell, `touching` (2 L,) their lengths at touch. The axial branch `d2` is found from
    `N2 = N1 cos(alpha) + T1 sin(alpha)`, the balance of a shoulder along the axis. Returns
    branches, answers, stress (q, L, 4), tangent (q, L, 16) over `1 - U`, and cells without an
    answer (q, L).
    """
    normal = np.einsum("lai,qij,laj->qla", cells.axes, U, cells.axes)
    length = cells.extent * normal
    q, count = length.shape[:2]

    def at(axial: Floats) -> tuple[Floats, Floats]:
        end = np.zeros((q, count, 2, 2))
        end[..., 0, 0], end[..., 0, 1] = 0.5 * (length[..., 0] - axial), 0.5 * length[..., 1]
        end[..., 1, 0] = axial
        end = end.reshape(q, 2 * count, 2)
        return end, steps(start, end, shear).reshape(q, count, 2, -1)

    # Between the touch of the axial grains, where N2 = 0, and half of it N2 overtakes.
    high = np.broadcast_to(touching[1::2], (q, count)).copy()
    low = 0.5 * high
    _, answer = at(high)
    is_open = answer[..., 0, FX] <= 0.0
    _, answer = at(low)
    lost = ~is_open & (answer[..., 1, FX] < answer[..., 0, FX])
    axial = np.clip(start.reshape(q, count, 2, 2)[..., 1, 0], low, high)
    for _ in range(MOST_AXIAL_STEPS):
        end, answer = at(axial)
        excess = answer[..., 1, FX] - answer[..., 0, FX]
        slope = answer[..., 1, KXX] + 0.5 * answer[..., 0, KXX]
        low, high = np.where(excess > 0.0, axial, low), np.where(excess > 0.0, high, axial)
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = axial + excess / slope
        inside = (newton >= low) & (newton <= high)
        step = np.where(inside, newton, 0.5 * (low + high))
        change = np.where(is_open | lost, 0.0, step - axial)
        if not np.abs(change).max(initial=0.0) > ROUNDED_CHANGE * np.abs(axial).max(initial=0.0):
            break
        axial = axial + change
    is_open |= (answer[..., REGIME] == 0.0).any(axis=-1)
    answer[is_open] = 0.0
    one, two = answer[..., 0, :], answer[..., 1, :]
    # Motions of the two branches for unit changes of the extents.
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = 0.5 / (two[..., KXX] + 0.5 * one[..., KXX])
    rate = np.where(is_open, 0.0, rate)[..., None] * one[..., [KXX, KXY]]
    across = 0.5 * one[..., KYX, None] * (np.array([1.0, 0.0]) - rate)
    across[..., 1] += 0.5 * one[..., KYY]
    moduli = np.stack([two[..., KXX, None] * rate, across], axis=-2)
    force = np.stack([two[..., FX], one[..., FY]], axis=-1)
    share = 2.0 * cells.extent / cells.area[:, None]
    stress = np.einsum("qla,la,lai,laj->qlij", force, share, cells.axes, cells.axes)
    tangent = np.einsum(
        "qlab,la,lb,lai,laj,lbk,lbm->qlijkm",
        moduli, share, cells.extent, cells.axes, cells.axes, cells.axes, cells.axes,
        optimize=True,
    )  # fmt: skip
    whole = answer.reshape(q, 2 * count, -1)
    return end, whole, stress.reshape(q, count, 4), tangent.reshape(q, count, 16), lost
