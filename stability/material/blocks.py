"""Blocks of loops whose steps are taken together, under each closure."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from loops.arrays import Flags, Floats, Integers
from loops.closures.ring import BALANCED, LOST, MOVING, RELAXED
from loops.closures.rings import kernels
from loops.laws.frictional import ContactLaw, require_law
from loops.shown import Shown
from stability.material.cell import CONTACT_PARTS, CONTACT_ROWS, Cells, cell_steps, cells_of
from stability.material.contact_steps import ContactSteps, lengths_at_touch, material_law
from stability.material.kernels import (
    A11,
    FX,
    KXX,
    P11,
    SHEAR,
    STUCK,
    SUMS,
    regime_sums,
    strained,
)
from stability.material.loop_set import LoopSet

# Newton steps after which a loop that is not in balance has no solution.
MOST_RELAXATIONS = 40
# Contacts of a block, times points: the arrays of a step stay in the cache.
BLOCK_CONTACTS = 8192


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
    loop in the block, `count` (L,) of them; `branches` (m, 2), `answer` (8, m): Of the contacts at
    the start; `part` (m,): Of its loop's contacts that each stands for; `size` (L,): Roots of the
    areas; `weight` (L,); `share`: Of a contact's force; `steps`: Of the contacts.
    """

    loops: slice
    rows: slice
    offsets: Integers
    count: Integers
    branches: Floats
    answer: Floats
    part: Floats
    size: Floats
    weight: Floats
    share: float
    steps: ContactSteps
    cells: Cells | None

    def spread(self, numbers: Floats | Flags, axis: int = 0) -> Any:
        """Return numbers of the loops for each of their contacts."""
        return np.repeat(numbers, self.count, axis=axis)

    @cached_property
    def columns(self) -> tuple[Floats, Floats]:
        """Return the weights of contacts in stress and tangent, (m, 6), and in regimes, (1, m).

        Those are the d_j, then the d_j d_l, times the densities.
        """
        d, density = self.branches, self.share * self.weight / self.size**2
        outer = (d[:, :, None] * d[:, None]).reshape(-1, 4)
        columns = self.spread(density)[:, None] * np.hstack([d, outer])
        return columns, (self.spread(self.weight) * self.part)[None]

    @cached_property
    def balance(self) -> tuple[Floats, Floats, Floats]:
        """Return stress (L, 4), levers (m, 2) and loads (m, 2) of loops at the start.

        The stress is Love and Weber's, `(1/V0) sum f (x) d`; whole contacts. Cells, of which two
        contacts are known, start at zero. The levers m are those of `f + load = f^ - P m`, over
        the size.
        """
        begins, force, d = self.offsets[:-1], self.answer[FX:KXX].T, self.branches

        def centred(rows: Floats) -> Floats:
            mean = np.add.reduceat(rows, begins) / self.count[:, None]
            return np.asarray(rows - self.spread(mean))

        outer = (force[:, :, None] * d[:, None, :]).reshape(-1, 4)
        whole = 1.0 if self.cells is None else 0.0
        stress = whole * np.add.reduceat(outer, begins) / self.size[:, None] ** 2
        # The middle of a branch, turned by a quarter, from the first grain of all.
        middle = np.cumsum(d, axis=0) - 0.5 * d
        size = self.spread(self.size)[:, None]
        levers = centred(np.stack([middle[:, 1], -middle[:, 0]], axis=1)) / size
        pushed = np.einsum("mij,mj->mi", self.spread(stress).reshape(-1, 2, 2), size * levers)
        loads = -centred(force + pushed)
        # Loops in balance have loads that are rounding.
        rounding = BALANCED * size * np.abs(self.answer[KXX:SHEAR]).max()
        return stress, levers, np.where(np.abs(loads) > rounding, loads, 0.0)


def blocks_of(loops: LoopSet, weight: Floats, law: ContactLaw, closure: str) -> list[LoopBlock]:
    """Return the loops in blocks, the laws of their contacts checked."""
    for count in loops.graph_contacts:
        require_law(law, (count,))
    blocks: list[LoopBlock] = []
    while not blocks or blocks[-1].loops.stop < len(weight):
        begin = blocks[-1].loops.stop if blocks else 0
        most = loops.offsets[begin] + BLOCK_CONTACTS
        end = max(int(np.searchsorted(loops.offsets, most, side="right")) - 1, begin + 1)
        blocks.append(_block(loops, slice(begin, end), weight[begin:end], law, closure))
    return blocks


def _block(
    every: LoopSet, which: slice, weight: Floats, law: ContactLaw, closure: str
) -> LoopBlock:
    """Return some loops as a block."""
    loops, cells = every.part(which), None
    offsets, rows, branches = loops.offsets, np.arange(len(loops.x)), loops.branches
    part = np.repeat(1.0 / loops.orders, loops.orders)
    first = int(every.offsets[which.start])
    if closure == "cell":
        cells, branches = cells_of(loops, which.start)
        rows = (offsets[:-1, None] + np.array(CONTACT_ROWS)).ravel()
        offsets, part = 2 * np.arange(len(weight) + 1), np.tile(CONTACT_PARTS, len(weight))
        first = 2 * which.start
    radii = np.stack([loops.radii[rows], loops.radii[loops.following[rows]]])
    own = material_law(law.take(loops.contacts[rows]), radii)
    opens = own.touching
    if loops.law is not None:
        opens = lengths_at_touch(own, branches, loops.normal_force[rows])
    steps = ContactSteps(own, np.stack([opens - own.reach, opens]))
    answer = steps(branches[None], branches[None], loops.shear_force[None, rows])[0]
    at, size = slice(first, first + len(rows)), np.sqrt(loops.areas)
    return LoopBlock(
        which, at, offsets, np.diff(offsets), branches, answer, part, size, weight, loops.share,
        steps, cells,
    )  # fmt: skip


def affine(block: LoopBlock, U: Floats, old: MaterialState, new: MaterialState) -> Floats:
    """Step under `d = U d0`; fill the new state, return the sums (q, 23) of the loops."""
    sums, (start, end) = np.zeros((len(U), SUMS)), np.empty((2, len(U), *block.branches.shape))
    strained(old.stretch, block.branches, start)
    strained(U, block.branches, end)
    answer = block.steps(start, end, old.shear_force)
    new.shear_force[:] = answer[:, SHEAR]
    # Forces and k_ik, each times d_j and d_j d_l.
    total = answer[:, FX:SHEAR] @ block.columns[0]
    sums[:, P11:A11] = total[:, :2, :2].reshape(-1, 4)
    sums[:, A11:STUCK] = total[:, 2:, 2:].reshape(-1, 2, 2, 2, 2).swapaxes(2, 3).reshape(-1, 16)
    regime_sums(answer, block.columns[1], sums)
    return sums


def traction(block: LoopBlock, U: Floats, old: MaterialState, new: MaterialState) -> Floats:
    """Step of loops in balance under uniform stresses; as `affine`."""
    end, stress = np.empty_like(old.branches), old.loop_stress.copy()
    strained(U - old.stretch, block.branches, end)
    end += old.branches
    tangent, (_, levers, loads) = np.zeros((*stress.shape[:2], 16)), block.balance
    status = np.where(old.failed, LOST, MOVING)
    for _ in range(MOST_RELAXATIONS):
        answer = block.steps(old.branches, end, old.shear_force)
        moving = kernels().relax(
            answer, block.offsets, U.reshape(-1, 4), levers, loads, block.size, end, stress,
            tangent, status,
        )  # fmt: skip
        if not moving:
            break
    lost = status != RELAXED
    if lost.any():
        # Loops come apart where the strain parts all their contacts.
        apart, begins = block.branches @ np.swapaxes(U, 1, 2), block.offsets[:-1]
        parts = np.hypot(apart[..., 0], apart[..., 1]) >= block.steps.touching[1]
        free = np.logical_and.reduceat(parts, begins, axis=1) & lost & ~old.failed
        free &= np.add.reduceat(loads.any(axis=1), begins) == 0
        rows = block.spread(free, axis=1)
        end[rows] = apart[rows]
        answer[np.broadcast_to(rows[:, None], answer.shape)] = 0.0
        stress[free], tangent[free] = 0.0, 0.0
        lost &= ~free
    return _taken(block, old, new, lost, end, answer, stress, tangent)


def cell(block: LoopBlock, U: Floats, old: MaterialState, new: MaterialState) -> Floats:
    """Step of the H-model's cells; as `affine`."""
    assert block.cells is not None
    end, answer, stress, tangent, lost = cell_steps(
        block.cells, block.steps, U, old.branches, old.shear_force
    )
    return _taken(block, old, new, lost | old.failed, end, answer, stress, tangent)


def _taken(
    block: LoopBlock, old: MaterialState, new: MaterialState, lost: Flags, end: Floats,
    answer: Floats, stress: Floats, tangent: Floats,
) -> Floats:  # fmt: skip
    """Fill the new state, that of lost loops as it was; return the sums of the others."""
    rows = block.spread(lost, axis=1)
    new.shear_force[:] = np.where(rows, old.shear_force, answer[:, SHEAR])
    new.branches[:] = np.where(rows[..., None], old.branches, end)
    new.loop_stress[:] = np.where(lost[..., None], old.loop_stress, stress)
    new.failed[:] = lost
    sums, share = np.zeros((len(lost), SUMS)), np.where(lost, 0.0, block.weight)
    sums[:, P11:A11] = block.share * np.einsum("ql,qlk->qk", share, new.loop_stress)
    sums[:, A11:STUCK] = block.share * np.einsum("ql,qlk->qk", share, tangent)
    regime_sums(answer, block.spread(share, axis=1) * block.part, sums)
    return sums


CLOSURES = {"affine": affine, "traction": traction, "cell": cell}
