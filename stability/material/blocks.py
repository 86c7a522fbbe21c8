"""Blocks of loops whose steps are taken together, under each closure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from loops.arrays import Flags, Floats, Integers
from loops.laws import ContactLaw
from loops.laws.frictional import require_law
from loops.shown import Shown
from stability.material.cell import CONTACT_COUNTS, CONTACT_ROWS, Cells, cell_steps, cells_of
from stability.material.contact_model import (
    ContactSteps,
    Touching,
    length_at_touch,
    require_steps,
    steps_of,
)
from stability.material.kernels import (
    BALANCED,
    DENSITY,
    FX,
    KXX,
    LOST,
    MOVING,
    OPEN,
    REGIME,
    SHARE,
    SHEAR,
    SUMS,
    X,
    Y,
    affine_steps,
    affine_sums,
    relax_centres,
    relaxed_sums,
)
from stability.material.loop_set import LoopSet

# Newton steps after which a loop that is not in balance has no solution.
MOST_RELAXATIONS = 40
# Contacts of a block, times points: the arrays of a step stay in the cache.
BLOCK_CONTACTS = 4096


@dataclass(frozen=True, eq=False, repr=False)
class MaterialState(Shown):
    """State of Q material points; a step gives a new one and leaves this one as it is.

    Attributes
    ----------
    stretch : (Q, 2, 2) array
        Right stretch `U` of `F = R U`.
    shear_force : (Q, M) array
        Shear forces of the contacts, loop by loop (force). Of a hexagon's cell two stand for six.
    branches : (Q, M, 2) array
        Branch vectors in the frame of `U`, of a cell in its own (length). None under the affine
        closure, whose branches are `U d0`.
    loop_stress : (Q, L, 4) array
        Nominal stress of each loop in that frame, components 11, 12, 21, 22 (force per length).
        None under the affine closure.
    failed : (Q, L) array of bool
        Loops that have lost their equilibrium, and are left out from there on.
    """

    stretch: Floats
    shear_force: Floats
    branches: Floats
    loop_stress: Floats
    failed: Flags

    def part(self, points: slice, block: LoopBlock) -> MaterialState:
        """Return views of some points and one block of loops."""
        loops = self.loop_stress[points, block.loops], self.failed[points, block.loops]
        rows = self.shear_force[points, block.rows], self.branches[points, block.rows]
        return MaterialState(self.stretch[points], *rows, *loops)

    def freeze(self) -> MaterialState:
        """Make the arrays read-only."""
        for array in vars(self).values():
            array.flags.writeable = False
        return self


@dataclass(frozen=True, eq=False)
class LoopBlock:
    """Loops one after the other, with what a step needs of them.

    `loops`, `rows`: Where they stand in the arrays of a state; `offsets` (L + 1,): Rows of each
    loop in the block; `branches`, `shear`: At the start, (m, 2) and (m,), and the loops' `stress`
    (L, 4); `weight` (L,); `share`: Of a contact's force; `steps`: Of the contacts. Under traction
    boundary vectors over `size` (L,), the root of the area, and loads `dead` on the grains (m, 2).
    """

    loops: slice
    rows: slice
    offsets: Integers
    branches: Floats
    shear: Floats
    stress: Floats
    size: Floats
    weight: Floats
    share: float
    steps: ContactSteps
    boundary: Floats
    dead: Floats
    cells: Cells | None = field(default=None)

    @cached_property
    def columns(self) -> Floats:
        """Return the columns (8, m) of the contacts under the affine closure."""
        count, known = np.diff(self.offsets), self.steps.compiled
        columns = np.zeros((8, len(self.branches)))
        if known is not None:
            columns[:X] = known.parameters.T
        columns[X], columns[Y] = self.branches.T
        columns[DENSITY] = np.repeat(self.share * self.weight / self.size**2, count)
        columns[SHARE] = np.repeat(self.weight / count, count)
        return columns


def blocks_of(loops: LoopSet, weight: Floats, law: ContactLaw, closure: str) -> list[LoopBlock]:
    """Return the loops in blocks, the laws of their contacts checked."""
    for count in loops.graph_contacts:
        require_law(law, (count,))
    offsets, rows, branches = loops.offsets, np.arange(len(loops.x)), loops.branches
    cells = None
    if closure == "cell":
        cells, branches = cells_of(loops)
        rows = (loops.offsets[:-1, None] + np.array(CONTACT_ROWS)).ravel()
        offsets, branches = 2 * np.arange(len(weight) + 1), branches.reshape(-1, 2)
    following = np.arange(len(loops.x)) + 1
    following[loops.offsets[1:] - 1] = loops.offsets[:-1]
    radii = loops.radii[rows], loops.radii[following[rows]]
    touching = Touching(*radii, radii[0] + radii[1])
    own = law.take(loops.contacts[rows])
    require_steps(own, touching)
    if loops.law is not None:
        normal = loops.normal_force[rows]
        touching = Touching(*radii, length_at_touch(own, touching, branches, normal))
    shear = loops.shear_force[rows]
    size, boundary = np.sqrt(loops.areas), loops.boundary
    blocks, begin = [], 0
    while begin < len(weight):
        end = max(
            int(np.searchsorted(offsets, offsets[begin] + BLOCK_CONTACTS, side="right")) - 1,
            begin + 1,
        )
        which, part = slice(begin, end), slice(int(offsets[begin]), int(offsets[end]))
        numbers = np.arange(part.start, part.stop)
        touch = Touching(radii[0][part], radii[1][part], touching.length[part])
        steps = steps_of(own.take(numbers), touch)
        answer = steps(branches[None, part], branches[None, part], shear[None, part])[0]
        block = LoopBlock(
            which, part, offsets[begin : end + 1] - offsets[begin], branches[part],
            answer[:, SHEAR], np.zeros((end - begin, 4)), size[which], weight[which], loops.share,
            steps, boundary[part], np.zeros_like(branches[part]),
            None if cells is None else cells.take(which),
        )  # fmt: skip
        if closure == "traction":
            _balance_start(block, answer)
        blocks.append(block)
        begin = end
    return blocks


def _balance_start(block: LoopBlock, answer: Floats) -> None:
    """Fill the stress of the loops at the start, and the loads that balance their grains.

    The stress is Love and Weber's, `(1/V0) sum f (x) d`; whole contacts.
    """
    count, force = np.diff(block.offsets), answer[:, FX:KXX]
    outer = (force[:, :, None] * block.branches[:, None, :]).reshape(-1, 4)
    block.stress[:] = np.add.reduceat(outer, block.offsets[:-1]) / block.size[:, None] ** 2
    block.boundary[:] /= np.repeat(block.size, count)[:, None]
    before = np.arange(len(force)) - 1
    before[block.offsets[:-1]] = block.offsets[1:] - 1
    stress = np.repeat(block.stress * block.size[:, None], count, axis=0).reshape(-1, 2, 2)
    pushed = np.einsum("mij,mj->mi", stress, block.boundary)
    loads = force[before] - force - pushed
    # Loops in balance have loads that are rounding.
    size = np.repeat(block.size, count) * np.abs(answer[:, KXX:SHEAR]).max()
    block.dead[:] = np.where(np.abs(loads) > BALANCED * size[:, None], loads, 0.0)


def affine(block: LoopBlock, U: Floats, old: MaterialState, new: MaterialState) -> Floats:
    """Step under `d = U d0`; fill the new state, return the sums (q, 24) of the loops."""
    sums, known = np.zeros((len(U), SUMS)), block.steps.compiled
    if known is not None:
        affine_steps(
            known.kind, known.by_radii, known.parameters, block.columns, old.stretch.reshape(-1, 4),
            U.reshape(-1, 4), old.shear_force, new.shear_force, sums,
        )  # fmt: skip
        return sums
    end = block.branches @ np.swapaxes(U, 1, 2)
    start = block.branches @ np.swapaxes(old.stretch, 1, 2)
    answer = block.steps(start, end, old.shear_force)
    new.shear_force[:] = answer[..., SHEAR]
    affine_sums(answer, block.columns, sums)
    return sums


def traction(block: LoopBlock, U: Floats, old: MaterialState, new: MaterialState) -> Floats:
    """Step of loops in balance under uniform stresses; as `affine`."""
    change = np.swapaxes(U - old.stretch, 1, 2)
    end = old.branches + block.branches @ change
    # Centres from the first grain of each loop: running sums of the branches.
    before = np.cumsum(end, axis=1) - end
    x = before - np.repeat(before[:, block.offsets[:-1]], np.diff(block.offsets), axis=1)
    stress, stretch = old.loop_stress.copy(), U.reshape(-1, 4)
    tangent = np.zeros((*stress.shape[:2], 16))
    status = np.where(old.failed, LOST, MOVING)
    for _ in range(MOST_RELAXATIONS):
        answer = block.steps(old.branches, end, old.shear_force)
        moving = relax_centres(
            answer, block.offsets, stretch, block.boundary, block.dead, block.size, x, end, stress,
            tangent, status,
        )  # fmt: skip
        if not moving:
            break
    lost = status != 1
    if lost.any():
        _part(block, U, old, lost, answer, end, stress, tangent)
    rows = np.repeat(lost, np.diff(block.offsets), axis=1)
    new.shear_force[:] = np.where(rows, old.shear_force, answer[..., SHEAR])
    new.branches[:] = np.where(rows[..., None], old.branches, end)
    new.loop_stress[:] = np.where(lost[..., None], old.loop_stress, stress)
    new.failed[:] = lost
    sums = np.zeros((len(U), SUMS))
    relaxed_sums(answer, block.offsets, block.weight, block.share, stress, tangent, lost, sums)
    return sums


def _part(
    block: LoopBlock, U: Floats, old: MaterialState, lost: Flags, answer: Floats, end: Floats,
    stress: Floats, tangent: Floats,
) -> None:  # fmt: skip
    """Let loops that are not in balance come apart where the strain parts all their contacts."""
    apart = block.branches @ np.swapaxes(U, 1, 2)
    open_rows = np.hypot(apart[..., 0], apart[..., 1]) >= block.steps.touching.length
    begins = block.offsets[:-1]
    free = np.logical_and.reduceat(open_rows, begins, axis=1) & lost & ~old.failed
    free &= np.add.reduceat((block.dead != 0.0).any(axis=1), begins) == 0
    rows = np.repeat(free, np.diff(block.offsets), axis=1)
    answer[rows], end[rows], answer[rows, REGIME] = 0.0, apart[rows], OPEN
    stress[free], tangent[free] = 0.0, 0.0
    lost &= ~free


def cell(block: LoopBlock, U: Floats, old: MaterialState, new: MaterialState) -> Floats:
    """Step of the H-model's cells; as `affine`."""
    assert block.cells is not None
    end, answer, stress, tangent, lost = cell_steps(
        block.cells, block.steps, block.steps.touching.length, U, old.branches, old.shear_force
    )
    lost |= old.failed
    rows = np.repeat(lost, 2, axis=1)
    new.shear_force[:] = np.where(rows, old.shear_force, answer[..., SHEAR])
    new.branches[:] = np.where(rows[..., None], old.branches, end)
    new.loop_stress[:] = np.where(lost[..., None], old.loop_stress, stress)
    new.failed[:] = lost
    sums = np.zeros((len(U), SUMS))
    # Four inclined contacts and two axial ones.
    six = np.repeat(answer, np.tile(CONTACT_COUNTS, len(block.weight)), axis=1)
    offsets = 6 * np.arange(len(block.weight) + 1)
    relaxed_sums(six, offsets, block.weight, block.share, stress, tangent, lost, sums)
    return sums


CLOSURES: dict[str, Callable[[LoopBlock, Floats, MaterialState, MaterialState], Floats]] = {
    "affine": affine,
    "traction": traction,
    "cell": cell,
}
