"""Loops over an interval (fates, strain, stress, work, chains that bend), rows of `evolution`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
import pyarrow as pa

from loops import (
    InputError,
    LoopBatch,
    Regime,
    contact_forces,
    euler_check,
    force_chains,
    loop_batches,
    love_weber_stress,
    macroscopic_tangent,
    outline_area,
    polygon_area,
)
from loops.arrays import Floats, Integers
from loops.closures import Closure, Spins
from loops.stress_strain import (
    best_fit_strain,
    loop_strain,
    rotation_and_stretch,
    turning_change,
)
from loops.tracking import Fate, LoopFates, loop_fates, match_contacts
from patterns import Snapshot
from patterns.snapshots.walls import box_sides
from stability import COMPONENTS
from stability.packing import probe
from studies.output import Columns, Row, Summary, components
from studies.snapshot.in_packing import sample_edge
from studies.snapshot.sample import stress
from studies.snapshot.summary import judges, verdict_shares
from studies.snapshot.table import LAST_ORDER, share_of

# A segment that bends by more (degrees) buckles: Tordesillas and Muthuswamy 2009.
BUCKLES = 1.0
PLACES = ("buckled", "straight", "elsewhere")
# Closure and spins of each column of predictions.
PREDICTIONS: dict[str, tuple[Closure, Spins]] = {
    "affine_W2": ("affine", "blocked"),
    "affine_free_W2": ("affine", "free"),
    "traction_W2": ("traction", "blocked"),
    "traction_free_W2": ("traction", "free"),
}
STRAIN_COLUMNS = (*(f"H{ij}" for ij in COMPONENTS), "rotation")
WORK_COLUMNS = (
    *(f"dP{ij}" for ij in COMPONENTS),
    *("hill_work", "hill_cosine", "W2", "w2"),
    *PREDICTIONS,
)
# Fields of `Stress` in a row of the evolution.
INVARIANTS = ("p", "p_error", "q", "q_error", "q_over_p", "q_over_p_error", "wall_share", "volume")
CONE = ("probe_cone_begin_deg", "probe_cone_end_deg")
PROBE = ("probe_w2", "probe_theta_deg", "probe_unstable_fraction", *CONE, "probe_undetermined")


def track_loops(before: Snapshot, after: Snapshot) -> LoopFates:
    """Fate of every loop between two snapshots, by the contacts that they share."""
    contacts = match_contacts(before.graph, before.ids, after.graph, after.ids)
    return loop_fates(contacts, before.faces, after.faces)


def fate_columns(fates: LoopFates, bend: Floats) -> dict[str, Any]:
    """Table of fates: one row per earlier loop, then one per born loop (number -1, order 0).

    `bend` (L,) is the largest of a chain beside each earlier loop.
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
        "chain_bend": np.append(bend, np.full(len(born), np.nan)),
    }


def loop_increments(before: Snapshot, after: Snapshot, fates: LoopFates) -> dict[str, Any]:
    """Table of the loops that survived from one snapshot to the next, by their earlier number.

    Predictions are not numbers where the tangent is not trusted.
    """
    survived = np.flatnonzero(fates.before == Fate.SURVIVED)
    mechanical = before.mechanical and after.mechanical
    names = ("area", *STRAIN_COLUMNS, *(WORK_COLUMNS if mechanical else ()))
    table: dict[str, Any] = {
        "loop_before": survived,
        "loop_after": fates.successor[survived],
        "order": fates.order_before[survived],
        **{name: np.empty(len(survived)) for name in names},
        **({"sliding_contacts": np.empty(len(survived), dtype=np.int64)} if mechanical else {}),
    }
    match, c = fates.contacts, fates.contacts.shared
    branches, forces = before.graph.branches, contact_forces(before.graph)
    # Contacts that opened are nan at the later snapshot.
    later_branches, later_forces = (np.full_like(branches, np.nan) for _ in range(2))
    sign = np.where(match.reversed[c], -1.0, 1.0)[:, None]
    later_branches[c] = sign * after.graph.branches[match.after[c]]
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
        columns = components("H", H)
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
    turned, e = turning_change(P0, dP, H)
    columns = components("dP", dP)
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


def _product(stress: Floats, strain: Floats) -> tuple[Floats, Floats]:
    """`stress : strain`, and the same over the norms; 0 where one of them is zero."""
    work = np.sum(stress * strain, axis=(1, 2))
    scale = np.linalg.norm(stress, axis=(1, 2)) * np.linalg.norm(strain, axis=(1, 2))
    return work, np.divide(work, scale, out=np.zeros_like(work), where=scale > 0)


def evolution_row(state: Snapshot, table: Mapping[str, Any]) -> Row:
    """Sum up one snapshot of a series; unknown values are None.

    Stresses `S*` are over the network's area, invariants of the whole sample, walls included.
    """
    graph, faces = state.graph, state.faces
    order, loop_area = np.asarray(table["order"]), np.asarray(table["area"])
    euler, area = euler_check(graph, faces), outline_area(graph, faces)
    row: Row = {
        "step": state.step,
        "grains": graph.grain_count,
        "contacts": graph.contact_count,
        "loops": len(faces.loops),
        "area": area,
        "coordination": _ratio(2 * euler.edges, euler.vertices),
        "mean_order": _ratio(float(np.sum(order)), len(order)),
    }
    groups = {n: np.minimum(order, LAST_ORDER) == n for n in range(3, LAST_ORDER + 1)}
    for n, rows in groups.items():
        row[f"share_{n}"] = _ratio(int(np.count_nonzero(rows)), len(order))
    for n, rows in groups.items():
        row[f"area_share_{n}"] = _ratio(float(loop_area[rows].sum()), float(loop_area.sum()))
    if state.regime is None:
        return row
    loops_stress = love_weber_stress(graph, area).ravel().tolist() if area > 0 else [None] * 4
    row |= {f"S{ij}": value for ij, value in zip(COMPONENTS, loops_stress, strict=True)}
    whole = stress(state) if state.area[0] > 0 else None
    row |= {name: None if whole is None else getattr(whole, name) for name in INVARIANTS}
    sliding = int(np.count_nonzero(state.regime == Regime.SLIDING))
    row["sliding_fraction"] = _ratio(sliding, graph.contact_count)
    for judge in judges(table):
        row |= verdict_row(judge, np.asarray(table[f"{judge}_lambda_min"]))
    return row


def verdict_row(judge: str, smallest: Floats) -> dict[str, float | None]:
    """Return the columns of a judge: unstable share of the judged loops, undetermined of all."""
    shares = zip(("unstable", "undetermined"), verdict_shares(smallest), strict=True)
    return {f"{judge}_{name}": None if np.isnan(share) else share for name, share in shares}


def probe_row(state: Snapshot, yield_band: float, directions: int) -> tuple[Row, list[str]]:
    """Columns of the probes of one snapshot (None if unknown) and notes."""
    row: Row = dict.fromkeys(PROBE)
    try:
        edge = sample_edge(state, yield_band)
    except InputError as error:
        return row, [f"not probed: {error}"]
    found = probe(edge, directions, faces=state.faces)
    row["probe_undetermined"] = int(np.count_nonzero(~found.determined))
    if found.softest is not None:
        row["probe_w2"] = float(found.normalised[found.softest])
        row["probe_theta_deg"] = float(np.degrees(found.theta[found.softest]))
        row["probe_unstable_fraction"] = found.unstable_fraction
    if len(found.cones):
        widest = np.degrees(found.cones[np.argmax(np.ptp(found.cones, axis=1))])
        row |= dict(zip(CONE, widest.tolist(), strict=True))
    return row, []


def interval_row(
    before: Snapshot, after: Snapshot, fates: LoopFates, table: Mapping[str, Any]
) -> Row:
    """Sum up one interval: strain, opened and closed contacts, number of loops by fate.

    With forces also numbers of loops by the signs of actual and predicted work.
    """
    H, source = sample_strain(before, after)
    row: Row = dict(zip((f"dH{ij}" for ij in COMPONENTS), H.ravel().tolist(), strict=True))
    row |= {"strain_from": source, "opened": fates.contacts.opened, "closed": fates.contacts.closed}
    for fate in Fate:
        loops = fates.after if fate == Fate.BORN else fates.before
        row[fate.name.lower()] = int(np.count_nonzero(loops == fate))
    if "W2" in table:
        actual = np.asarray(table["W2"])
        row["negative_W2"] = int(np.count_nonzero(actual < 0))
        for name in PREDICTIONS:
            predicted = np.asarray(table[name])
            known = np.isfinite(predicted) & (actual != 0)
            for a, own in (("negative", actual < 0), ("positive", actual >= 0)):
                for p, told in (("negative", predicted < 0), ("positive", predicted >= 0)):
                    row[f"{name}_{a}_{p}"] = int(np.count_nonzero(known & own & told))
    return row


def sample_strain(
    before: Snapshot, after: Snapshot
) -> tuple[Floats, Literal["cell", "walls", "grains", "unknown"]]:
    """Displacement gradient of the sample between two snapshots, and what it is from."""
    one, two = before.graph, after.graph
    if one.cell is not None and two.cell is not None:
        return cell_strain(one.cell, two.cell), "cell"
    if one.cell is None and before.walls is not None and after.walls is not None:
        sides = box_sides(one.x, before.walls), box_sides(two.x, after.walls)
        if sides[0] is not None and sides[1] is not None:
            return np.diag(1.0 - sides[1] / sides[0]), "walls"
    here, there = common_grains(before, after)
    if len(here) < 3:
        return np.full((2, 2), np.nan), "unknown"
    return best_fit_strain(one.x[here], two.x[there]), "grains"


def common_grains(before: Snapshot, after: Snapshot) -> tuple[Integers, Integers]:
    """Return the grains that are in both snapshots, by their numbers in each."""
    return np.intersect1d(before.ids, after.ids, assume_unique=True, return_indices=True)[1:]


def moved_branches(before: Snapshot, after: Snapshot, strain: Floats) -> Floats:
    """(C, 2) later branches of the contacts of a snapshot; not numbers where a grain is gone.

    In a cell those of the images that are nearest after `strain` (2, 2).
    """
    graph, cell = before.graph, after.graph.cell
    here, there = common_grains(before, after)
    x = np.full((graph.grain_count, 2), np.nan)
    x[here] = after.graph.x[there]
    i, j = graph.contacts.T
    d = graph.branches
    affine = d - d @ strain.T
    beyond = x[j] - x[i] - affine
    if cell is not None:
        away = np.linalg.solve(cell, beyond.T)
        beyond = beyond - (cell @ np.round(away)).T
    return np.asarray(beyond + affine)


def cell_strain(before: Floats, after: Floats) -> Floats:
    """Displacement gradient between two cells, by the lattice vectors nearest to the earlier ones.

    A code may flip a tilted cell.
    """
    lattice = np.rint(np.linalg.solve(after, before))
    return np.asarray(np.eye(2) - after @ lattice @ np.linalg.inv(before))


def _ratio(part: float, whole: float) -> float | None:
    return part / whole if whole else None


def chain_bends(before: Snapshot, after: Snapshot) -> tuple[Floats, Floats]:
    """Return the bend of every segment of a chain (S,), and the largest beside each loop (L,).

    Degrees; nan for a segment of which a grain is lost, and for a loop that is beside no segment.
    """
    graph, faces, bend = before.graph, before.faces, np.empty(0)
    of_contact = np.full(graph.contact_count, np.nan)
    if before.mechanical:
        moved = moved_branches(before, after, np.zeros((2, 2)))
        links, bend = force_chains(graph).bending(graph, moved)
        bend = np.degrees(bend)
        np.fmax.at(of_contact, links, bend[:, None])
    if not len(faces.contacts):
        return bend, np.empty(0)
    return bend, np.fmax.reduceat(of_contact[faces.contacts], faces.offsets[:-1])[faces.loops]


def chain_row(bend: Floats, beside: Floats, fates: LoopFates, table: Mapping[str, Any]) -> Row:
    """Return numbers of an interval: segments, loops by place, those lost, those of negative W2."""
    known, lost = bend[np.isfinite(bend)], fates.before != Fate.SURVIVED
    row: Row = {"segments": len(known), "segments_buckled": int(np.sum(known > BUCKLES))}
    negative = np.zeros(len(beside), dtype=bool)
    if "W2" in table:
        negative[table["loop_before"]] = np.asarray(table["W2"]) < 0
    there = (beside > BUCKLES, beside <= BUCKLES, np.isnan(beside))
    for name, here in zip(PLACES, there, strict=True):
        counts = {"loops": 1, "grains": fates.order_before, "lost": lost, "negative_W2": negative}
        row |= {f"{name}_{what}": int(np.sum(here * each)) for what, each in counts.items()}
    return row


def chain_summary(intervals: Sequence[Row]) -> Summary:
    """Return segments that buckled, and by place of the loops their fate and work, all together."""

    def total(name: str) -> int:
        return sum(row[name] for row in intervals)

    found: Summary = {name: total(name) for name in ("segments", "segments_buckled")}
    for place in PLACES:
        loops, lost = total(f"{place}_loops"), total(f"{place}_lost")
        found[place] = {
            "loops": loops,
            "mean_order": total(f"{place}_grains") / loops if loops else None,
            "lost": share_of(lost, loops) if loops else None,
            "negative_W2": share_of(total(f"{place}_negative_W2"), loops - lost) if loops else None,
        }
    return found
