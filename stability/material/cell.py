"""The H-model's cell: a hexagon that its normal strains drive, its shoulders free along the axis.

F. Nicot, F. Darve, The H-microdirectional model: Accounting for a mesoscopic scale, Mechanics of
Materials 43 (2011) 918-929; from its geometry and balance, equations (12.6) and (12.7).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loops.arrays import Flags, Floats
from loops.errors import InputError
from stability.material.contact_steps import ContactSteps
from stability.material.kernels import FX, FY, KXX, KXY, KYX, KYY, REGIME
from stability.material.loop_set import LoopSet

# Rows of a hexagon that stand for its four inclined contacts, and for its two axial ones.
CONTACT_ROWS = (2, 1)
CONTACT_PARTS = np.array([4, 2]) / 6.0
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


def cells_of(loops: LoopSet, first: int) -> tuple[Cells, Floats]:
    """Return hexagons, numbered from `first`, as cells; their branches (2 L, 2) in these frames.

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
    size = np.abs(branches)
    mirrored = size[:, [0, 1, 0, 0, 1, 0]]
    mirrored[:, [1, 4], 1] = 0.0
    wrong = np.abs(size - mirrored).max(axis=(1, 2)) > EQUAL * size.max(axis=(1, 2))
    wrong |= loops.shear_force.reshape(-1, 6).any(axis=1)
    if wrong.any():
        received = (
            f"loop {first + int(wrong.argmax())} without these mirror planes, or with shear forces"
        )
        expected = "hexagons with mirror planes along and across the axis from grain 3 to grain 0"
        raise InputError("loops of a cell closure", received, expected, "See patterns.hexagon.")
    extent = np.stack([x[:, 0] - x[:, 3], x[:, 1] - x[:, 5]], axis=1)
    extent = np.abs(np.einsum("lij,lij->li", axes, extent))
    return Cells(axes, extent, loops.areas), size[:, CONTACT_ROWS].reshape(-1, 2)


@np.errstate(divide="ignore", invalid="ignore")
def cell_steps(
    cells: Cells, steps: ContactSteps, U: Floats, start: Floats, shear: Floats
) -> tuple[Floats, Floats, Floats, Floats, Flags]:
    """Take one step of cells under the stretch `U` (q, 2, 2).

    `start` (q, 2 L, 2) and `shear` (q, 2 L) are those of an inclined and the axial contact of each
    cell. The axial branch `d2` is found from
    `N2 = N1 cos(alpha) + T1 sin(alpha)`, the balance of a shoulder along the axis. Returns
    branches, answers, stress (q, L, 4), tangent (q, L, 16) over `1 - U`, and cells without an
    answer (q, L).
    """
    normal = np.einsum("lai,qij,laj->qla", cells.axes, U, cells.axes)
    length = cells.extent * normal
    q, count = length.shape[:2]

    def at(axial: Floats) -> tuple[Floats, Floats, Floats]:
        along, across = 0.5 * (length[..., 0] - axial), 0.5 * length[..., 1]
        end = np.stack([along, across, axial, 0.0 * axial], axis=-1).reshape(q, 2 * count, 2)
        answer = steps(start, end, shear)
        # Of the inclined contacts, and of the axial ones.
        return end, answer, np.moveaxis(answer.reshape(q, -1, count, 2), -1, 0)

    # Between the touch of the axial grains, where N2 = 0, and half of it N2 overtakes.
    high = np.broadcast_to(steps.touching[1, 1::2], (q, count)).copy()
    low = 0.5 * high
    is_open = at(high)[2][0][:, FX] <= 0.0
    _, _, (one, two) = at(low)
    lost = ~is_open & (two[:, FX] < one[:, FX])
    axial = np.clip(start.reshape(q, count, 2, 2)[..., 1, 0], low, high)
    for _ in range(MOST_AXIAL_STEPS):
        end, answer, (one, two) = at(axial)
        excess, slope = two[:, FX] - one[:, FX], two[:, KXX] + 0.5 * one[:, KXX]
        low, high = np.where(excess > 0.0, axial, low), np.where(excess > 0.0, high, axial)
        newton = axial + excess / slope
        inside = (newton >= low) & (newton <= high)
        step = np.where(inside, newton, 0.5 * (low + high))
        change = np.where(is_open | lost, 0.0, step - axial)
        if not np.abs(change).max(initial=0.0) > ROUNDED_CHANGE * np.abs(axial).max(initial=0.0):
            break
        axial = axial + change
    is_open |= (one[:, REGIME] == 0.0) | (two[:, REGIME] == 0.0)
    answer[np.broadcast_to(np.repeat(is_open, 2, axis=1)[:, None], answer.shape)] = 0.0
    # Motions of the two branches for unit changes of the extents.
    rate = 0.5 / (two[:, KXX] + 0.5 * one[:, KXX])
    rate = np.where(is_open, 0.0, rate) * one[:, [KXX, KXY]].swapaxes(0, 1)
    across = 0.5 * (one[:, [KYX, KYY]].swapaxes(0, 1) - one[:, KYX] * rate)
    moduli = np.moveaxis(np.stack([two[:, KXX] * rate, across]), (0, 1), (-2, -1))
    force = np.stack([two[:, FX], one[:, FY]], axis=-1)
    share = 2.0 * cells.extent / cells.area[:, None]
    stress = np.einsum("qla,la,lai,laj->qlij", force, share, cells.axes, cells.axes)
    tangent = np.einsum(
        "qlab,la,lb,lai,laj,lbk,lbm->qlijkm",
        moduli, share, cells.extent, cells.axes, cells.axes, cells.axes, cells.axes,
        optimize=True,
    )  # fmt: skip
    return end, answer, stress.reshape(q, count, 4), tangent.reshape(q, count, 16), lost
