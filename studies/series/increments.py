"""What every loop that survived an interval went through: strain, stress, second-order work.

Let `x0` be the centres of a loop at the earlier snapshot, `V0` the area of its polygon and `d0` its
branches. Over the interval

    H  = -(1/V0) sum (x - x0)_i (x) B_i          displacement gradient, boundary formula
    dP = (1/(2 V0)) sum (f - f0)_c (x) d0_c      nominal stress increment

each contact shared half and half between its two loops, as in the table of a snapshot. Hill's
second-order work is `dP : H` with these nominal increments.

It is not blind to rotation. A loop that only turns by `theta`, its forces with it, has
`dP : H = -theta^2 tr P0 + O(theta^3)`, negative under pressure: what dead loads do to any body,
and nothing about its stability. So the work is also given *corotated*, in the frame that turns with
the loop: with `1 - H = R U` (polar decomposition)

    W2 = (R^T P - P0) : (1 - U)

which no rigid rotation between the snapshots changes. It is the work in the `symmetric` subspace,
where a loop of a packing is judged. The tangent of the earlier snapshot predicts it as
`e . A e / 2`, `e = 1 - U` (half, for the contacts are shared), in four ways: either closure with
spins blocked, as in the table of a snapshot, and with free spins. (Spins that turn with the loop
are blocked in the frame that turns with it.) Grains of a packing do turn: blocked spins overrate
the work of loops that roll.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from loops import (
    GrainGraph,
    LoopBatch,
    Regime,
    branch_vectors,
    contact_forces,
    loop_batches,
    macroscopic_tangent,
    polygon_area,
)
from loops.arrays import Floats
from loops.closures import Closure, Spins
from loops.loop_strain import loop_strain, rotation_and_stretch, rotation_minus_one
from loops.tracking import Fate, LoopFates, loop_fates, match_contacts
from patterns import Snapshot
from stability import COMPONENTS

# Column of a prediction: its closure and what the spins do.
PREDICTIONS: dict[str, tuple[Closure, Spins]] = {
    "affine_W2": ("affine", "blocked"),
    "affine_free_W2": ("affine", "free"),
    "traction_W2": ("traction", "blocked"),
    "traction_free_W2": ("traction", "free"),
}
STRAIN = (*(f"H{ij}" for ij in COMPONENTS), "rotation")
WORK = (
    *(f"dP{ij}" for ij in COMPONENTS),
    *("hill_work", "hill_cosine", "W2", "w2"),
    *PREDICTIONS,
)


def track_loops(before: Snapshot, after: Snapshot) -> LoopFates:
    """Say what became of every loop between two snapshots, by the contacts that they share."""
    contacts = match_contacts(before.graph, before.ids, after.graph, after.ids)
    return loop_fates(contacts, before.faces, after.faces)


def increments(before: Snapshot, after: Snapshot, fates: LoopFates) -> dict[str, Any]:
    """Table of the loops that survived from one snapshot to the next, by their earlier number.

    `loop_before`, `loop_after` as the tables of the snapshots number them, `order`, `area` of the
    earlier polygon, `H11..H22` and `rotation` (degrees, anticlockwise); with forces `dP11..dP22`
    (force per length), `hill_work` and `hill_cosine` (over `|dP||H|`), corotated `W2` and `w2`, the
    predictions (not a number where the tangent is not trusted), earlier `sliding_contacts`.
    """
    survived = np.flatnonzero(fates.before == Fate.SURVIVED)
    mechanical = before.mechanical and after.mechanical
    names = ("area", *STRAIN, *(WORK if mechanical else ()))
    table: dict[str, Any] = {
        "loop_before": survived,
        "loop_after": fates.successor[survived],
        "order": fates.order_before[survived],
        **{name: np.empty(len(survived)) for name in names},
        **({"sliding_contacts": np.empty(len(survived), dtype=np.int64)} if mechanical else {}),
    }
    chosen = before.faces.loops[survived]
    row = np.full(len(before.faces.kind), -1)
    row[chosen] = np.arange(len(survived))
    contacts = _both_times(before.graph, after.graph, fates)
    for loops in loop_batches(before.graph, before.faces, loops=chosen):
        columns, H = _strain(loops, contacts)
        if mechanical:
            columns |= _work(before, loops, H, contacts)
        for name, values in columns.items():
            table[name][row[loops.face]] = values
    return table


class _Contacts(NamedTuple):
    """Branches and forces of the earlier contacts, then and later; not numbers if opened."""

    branches: Floats
    later_branches: Floats
    forces: Floats
    later_forces: Floats


def _both_times(before: GrainGraph, after: GrainGraph, fates: LoopFates) -> _Contacts:
    match = fates.contacts
    later_branches, later_forces = (np.full((before.contact_count, 2), np.nan) for _ in range(2))
    c = match.shared
    sign = np.where(match.reversed[c], -1.0, 1.0)[:, None]
    later_branches[c] = sign * branch_vectors(after)[match.after[c]]
    later_forces[c] = sign * contact_forces(after)[match.after[c]]
    return _Contacts(branch_vectors(before), later_branches, contact_forces(before), later_forces)


def _along(loops: LoopBatch, contacts: _Contacts) -> Floats:
    """(L, n, 1) signs: whether a loop's sides run along its contacts or against them."""
    x = loops.graph.x
    sides = np.roll(x, -1, axis=1) - x
    return np.sign(np.sum(sides * contacts.branches[loops.contacts], axis=2, keepdims=True))


def _strain(loops: LoopBatch, contacts: _Contacts) -> tuple[dict[str, Floats], Floats]:
    along = _along(loops, contacts)
    # Both polygons from their sides alone: what didn't move has no strain, not even by rounding.
    start, end = (
        np.cumsum(along * branches[loops.contacts], axis=1)
        for branches in (contacts.branches, contacts.later_branches)
    )
    H = loop_strain(start, end)
    angle, _ = rotation_and_stretch(H)
    columns = _components("H", H)
    return columns | {"area": polygon_area(start), "rotation": np.degrees(angle)}, H


def _work(
    snapshot: Snapshot, loops: LoopBatch, H: Floats, contacts: _Contacts
) -> dict[str, NDArray[Any]]:
    volume = polygon_area(loops.graph.x)[:, None, None]
    c = loops.contacts
    # A contact against the loop has both its force and its branch reversed.
    branches = contacts.branches[c]
    P0 = 0.5 * np.swapaxes(contacts.forces[c], 1, 2) @ branches / volume
    change = contacts.later_forces[c] - contacts.forces[c]
    dP = 0.5 * np.swapaxes(change, 1, 2) @ branches / volume
    angle, e = rotation_and_stretch(H)
    turned = dP + rotation_minus_one(-angle) @ (P0 + dP)
    columns: dict[str, NDArray[Any]] = _components("dP", dP)
    columns["hill_work"], columns["hill_cosine"] = _product(dP, H)
    columns["W2"], columns["w2"] = _product(turned, e)
    assert snapshot.law is not None and snapshot.regime is not None  # a mechanical snapshot
    law, regime = snapshot.law.take(loops.contacts), snapshot.regime[loops.contacts]
    columns["sliding_contacts"] = np.count_nonzero(regime == Regime.SLIDING, axis=1)
    strain = e.reshape(len(e), 4)
    for name, (closure, spins) in PREDICTIONS.items():
        A = macroscopic_tangent(loops.graph, law, closure, spins=spins, regime=regime).matrix
        columns[name] = 0.5 * np.einsum("li,lij,lj->l", strain, A, strain)
    return columns


def _components(name: str, values: Floats) -> dict[str, Floats]:
    flat = values.reshape(len(values), 4)
    return {f"{name}{ij}": flat[:, k] for k, ij in enumerate(COMPONENTS)}


def _product(stress: Floats, strain: Floats) -> tuple[Floats, Floats]:
    """`stress : strain`, and the same over the norms; 0 where one of them is zero."""
    work = np.sum(stress * strain, axis=(1, 2))
    scale = np.linalg.norm(stress, axis=(1, 2)) * np.linalg.norm(strain, axis=(1, 2))
    return work, np.divide(work, scale, out=np.zeros_like(work), where=scale > 0)
