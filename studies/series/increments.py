"""Fates of all loops over an interval; strain, stress and second-order work of those that survive.

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

from typing import Any

import numpy as np
import pyarrow as pa

from loops import (
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
from studies.columns import Columns

# Closure and spins of each column of predictions.
PREDICTIONS: dict[str, tuple[Closure, Spins]] = {
    "affine_W2": ("affine", "blocked"),
    "affine_free_W2": ("affine", "free"),
    "traction_W2": ("traction", "blocked"),
    "traction_free_W2": ("traction", "free"),
}
STRAIN_COLUMNS = (*(f"H{ij}" for ij in COMPONENTS), "rotation")
WORK = (
    *(f"dP{ij}" for ij in COMPONENTS),
    *("hill_work", "hill_cosine", "W2", "w2"),
    *PREDICTIONS,
)


def track_loops(before: Snapshot, after: Snapshot) -> LoopFates:
    """Fate of every loop between two snapshots, by the contacts that they share."""
    contacts = match_contacts(before.graph, before.ids, after.graph, after.ids)
    return loop_fates(contacts, before.faces, after.faces)


def fate_columns(fates: LoopFates) -> dict[str, Any]:
    """Table of fates: one row an earlier loop, then one row a born loop.

    `loop_before`, `fate`, `successor` (the one that shares most half-edges), `successors` (all that
    share any), `order_before`, `order_after` (of the successor). A born loop has no earlier number
    (-1) and order (0).
    """
    born = np.flatnonzero(fates.after == Fate.BORN)
    count = np.bincount(fates.links[:, 0], minlength=len(fates.before))
    ends = np.cumsum([0, *count, *np.ones_like(born)], dtype=np.int32)
    successors = np.concatenate([fates.links[:, 1], born])
    none = np.full(len(born), -1)
    # A loop without successor (-1) finds the order 0 at the end.
    order = np.append(fates.order_after, 0)
    successor = np.concatenate([fates.successor, born])
    names = np.array([fate.name.lower() for fate in Fate])
    return {
        "loop_before": np.concatenate([np.arange(len(fates.before)), none]),
        "fate": names[np.concatenate([fates.before, fates.after[born]])],
        "successor": successor,
        "successors": pa.ListArray.from_arrays(pa.array(ends), pa.array(successors)),
        "order_before": np.concatenate([fates.order_before, np.zeros_like(born)]),
        "order_after": order[successor],
    }


def increments(before: Snapshot, after: Snapshot, fates: LoopFates) -> dict[str, Any]:
    """Table of the loops that survived from one snapshot to the next, by their earlier number.

    `loop_before`, `loop_after` as the tables of the snapshots number them, `order`, `area` of the
    earlier polygon, `H11..H22` and `rotation` (degrees, anticlockwise); with forces `dP11..dP22`
    (force per length), `hill_work` and `hill_cosine` (over `|dP||H|`), corotated `W2` and `w2`, the
    predictions (not a number where the tangent is not trusted), earlier `sliding_contacts`.
    """
    survived = np.flatnonzero(fates.before == Fate.SURVIVED)
    mechanical = before.mechanical and after.mechanical
    names = ("area", *STRAIN_COLUMNS, *(WORK if mechanical else ()))
    table: dict[str, Any] = {
        "loop_before": survived,
        "loop_after": fates.successor[survived],
        "order": fates.order_before[survived],
        **{name: np.empty(len(survived)) for name in names},
        **({"sliding_contacts": np.empty(len(survived), dtype=np.int64)} if mechanical else {}),
    }
    match, c = fates.contacts, fates.contacts.shared
    branches, forces = branch_vectors(before.graph), contact_forces(before.graph)
    # Contacts that opened are nan at the later snapshot.
    later_branches, later_forces = (np.full_like(branches, np.nan) for _ in range(2))
    sign = np.where(match.reversed[c], -1.0, 1.0)[:, None]
    later_branches[c] = sign * branch_vectors(after.graph)[match.after[c]]
    later_forces[c] = sign * contact_forces(after.graph)[match.after[c]]
    chosen = before.faces.loops[survived]
    row = np.full(len(before.faces.kind), -1)
    row[chosen] = np.arange(len(survived))
    for loops in loop_batches(before.graph, before.faces, loops=chosen):
        at, x = loops.contacts, loops.graph.x
        # Signs (L, n, 1): +1 for a contact along the loop's side, -1 against it.
        sides = np.roll(x, -1, axis=1) - x
        along = np.sign(np.sum(sides * branches[at], axis=2, keepdims=True))
        # Both polygons are summed from their sides: a loop that didn't move has exactly no strain.
        start, end = (np.cumsum(along * d[at], axis=1) for d in (branches, later_branches))
        H = loop_strain(start, end)
        columns = _components("H", H)
        columns["area"] = polygon_area(start)
        columns["rotation"] = np.degrees(rotation_and_stretch(H)[0])
        if mechanical:
            columns |= _work(before, loops, H, branches[at], (forces[at], later_forces[at]))
        for name, values in columns.items():
            table[name][row[loops.face]] = values
    return table


def _work(
    snapshot: Snapshot, loops: LoopBatch, H: Floats, branches: Floats, forces: tuple[Floats, Floats]
) -> Columns:
    """Second-order work of a batch of loops, actual and predicted."""
    volume = polygon_area(loops.graph.x)[:, None, None]
    # A contact against the loop has both its force and its branch reversed.
    P0 = 0.5 * np.swapaxes(forces[0], 1, 2) @ branches / volume
    dP = 0.5 * np.swapaxes(forces[1] - forces[0], 1, 2) @ branches / volume
    angle, e = rotation_and_stretch(H)
    turned = dP + rotation_minus_one(-angle) @ (P0 + dP)
    columns = _components("dP", dP)
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


def _components(name: str, values: Floats) -> Columns:
    flat = values.reshape(len(values), 4)
    return {f"{name}{ij}": flat[:, k] for k, ij in enumerate(COMPONENTS)}


def _product(stress: Floats, strain: Floats) -> tuple[Floats, Floats]:
    """`stress : strain`, and the same over the norms; 0 where one of them is zero."""
    work = np.sum(stress * strain, axis=(1, 2))
    scale = np.linalg.norm(stress, axis=(1, 2)) * np.linalg.norm(strain, axis=(1, 2))
    return work, np.divide(work, scale, out=np.zeros_like(work), where=scale > 0)
