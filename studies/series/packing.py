"""Predictions of the packing for every loop over an interval, and the loading of the sample.

The strain of the sample over the interval is put on the earlier snapshot (`packing_increment`):
works are per interval, times are shares of it. Where solutions end before (`packing_status` is
'nearest') contacts that soften are kept from sliding, and predictions are those of the others.

The grains' own motion needs the later snapshot: the motion of all centres and spins is that of the
code, and the tangents are those of the earlier state. Over short steps only the tangents are in
error, which makes it the best that a rate can do; over long ones it is no bound on any other.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path as File
from typing import Any, NamedTuple

import numpy as np

from loops import InputError, Regime, loop_batches
from loops.arrays import Floats
from loops.contacts import Contacts, contacts_at_start, start_state
from loops.in_place import loops_in_place
from loops.stress_strain import rotation_and_stretch
from loops.tracking import Fate, LoopFates
from patterns import Snapshot
from patterns.snapshots.cells import CELL_COLUMNS
from patterns.snapshots.tables import read_table
from patterns.snapshots.walls import box_corners
from stability import COMPONENTS, Path, Programme, Stage, follow
from stability.packing import (
    LoopRates,
    indicators,
    loop_changes,
    loop_rates,
    replay,
)
from stability.packing.equations_of_motion import duration_of, masses_of, step_of
from stability.packing.loop_quantities import EXPECTED, least_squares_nonaffinity
from stability.packing.response import CANDIDATES
from stability.path import Past
from stability.programmes import component_control, nominal
from studies.output import Columns, Row
from studies.questions import Replaying
from studies.series.evolution import cell_strain, common_grains, moved_branches, sample_strain
from studies.snapshot.in_packing import (
    balance_notes,
    fixed_point,
    motion_note,
    place_columns,
    sample_edge,
)

# Field of `LoopRates` of each column of predictions.
PREDICTED = {
    "packing_W2": "second_order_work",
    "packing_w2": "normalised_work",
    "packing_work": "additive_work",
    "packing_nonaffinity": "nonaffinity",
    "packing_opening": "opening",
    "packing_closing": "closing",
}
EVENT_FIELDS = {"w2": "normalised_work"} | {n: n for n in ("nonaffinity", "opening", "closing")}
OWN_FIELDS = {"own_w2": "normalised_work", "own_opening": "opening", "own_closing": "closing"}
# Smallest eigenvalues in the packing: of the state as written, and where that is at rest.
SMALLEST = ("packing_lambda_min", "packing_lambda_min_held")
WITHHELD = (
    "where a state moves there is no share of loops unstable in their packing: bring it to rest, "
    "grainloops snapshot --in-packing auto --hold"
)
# Fields of the response in the row of an interval.
RESPONSE_FIELDS = (
    *("proof", "residual", "reached", "disagreeing", "beyond", "sliding", "candidates"),
    "settled",
)
# Largest number of instabilities that a path passes: more than occur.
PASSED = 1000
# Inertial number of a replay where the series tells none.
DEFAULT_RATE = 2e-6
# Steps after which a replay is given up.
REPLAY_STEPS = 1_000_000
# A replay that ends farther from the stress of the later snapshot, over its mean stress, is not
# believed: three of 83 intervals of Yade did, the others by 0.0028 at most
# (docs/evidence/series.md).
STRESS_ERROR = 5e-3
WAYS = ("straight", "1-first", "2-first", "mixed-1", "mixed-2")
# Strains of a table and of the snapshots differ by at most this share of the largest on the way:
# tables round, and their times may be a step off.
AGREE = 0.1
# Rows of a table this near to an end of the interval, over its time, are at the end.
AT_END = 1e-6


class Following(NamedTuple):
    """Options of paths and replays: continuation after an instability, rate of the replay, way.

    `programme` is one of `WAYS`, or the name of the `table` of strains.
    """

    past: Past = "viscous"
    inertial_number: float | None = None
    time_step: float | None = None
    mean_mass: float | None = None
    damping: float = 0.3
    programme: str = "straight"
    table: StrainTable | None = None


class Rate(NamedTuple):
    """Rate of a replay: its inertial number, where this is from, and the options of `replay`."""

    inertial_number: float
    source: str
    options: dict[str, Any]

    @classmethod
    def from_rest(cls, inertial_number: float, source: str) -> Rate:
        """Return the rate of an inertial number, the grains at rest."""
        return cls(inertial_number, source, {"inertial_number": inertial_number})


def interval_rate(
    before: Snapshot,
    after: Snapshot,
    H: Floats,
    times: Sequence[float | None],
    asked: Following | Replaying,
    loading: IntervalLoading | None = None,
) -> Rate:
    """Rate at which the code strained its sample by `H` from one snapshot to the next.

    Listed `times` come before those of the files.
    """
    if asked.inertial_number is not None:
        return Rate.from_rest(asked.inertial_number, "as given")
    start, end = times_of(before, after, times, asked)
    masses = before.mass
    if masses is None and asked.mean_mass is not None:
        square = before.graph.radii**2
        masses = asked.mean_mass * square / square.mean()
    if masses is None:
        return Rate.from_rest(DEFAULT_RATE, "no masses")
    if start is None or end is None:
        return Rate.from_rest(DEFAULT_RATE, "no times")
    if not end > start:
        return Rate.from_rest(DEFAULT_RATE, "no growing times")
    state = contacts_at_start(before.scene)
    step = step_of(*masses_of(before.graph.radii, masses), state)
    longest = REPLAY_STEPS * step
    duration = min(end - start, longest)
    size = float(np.linalg.norm(H)) if loading is None else loading.size
    inertial_number = duration_of(size, masses, state, 1.0) / duration
    options = {"duration": duration, "mass": masses}
    if duration < end - start:
        return Rate(inertial_number, f"slower in fact: {REPLAY_STEPS} steps at most", options)
    if before.velocity is None:
        return Rate(inertial_number, "times and masses", options)
    velocity = velocity_beyond(before, after, H if loading is None else loading.start, duration)
    options |= {"velocity": velocity, "spin": before.spin}
    return Rate(inertial_number, "times, masses and velocities", options)


def times_of(
    before: Snapshot,
    after: Snapshot,
    times: Sequence[float | None],
    asked: Following | Replaying,
) -> tuple[float | None, float | None]:
    """Times of both snapshots as far as known: of a table, else of the file, else by the steps."""
    known = [*times]
    for k, one in enumerate((before, after)):
        if known[k] is None:
            known[k] = one.time
        if known[k] is None and one.step is not None and asked.time_step is not None:
            known[k] = one.step * asked.time_step
    return known[0], known[1]


def velocity_beyond(before: Snapshot, after: Snapshot, H: Floats, duration: float) -> Floats:
    """(G, 2) velocities of the grains beyond the affine motion that strains the sample by `H`.

    Some codes leave the affine motion of a periodic sample out: the smaller ones are taken.
    """
    given, x, rate = np.asarray(before.velocity), before.graph.x, H / duration
    if before.walls is not None and after.walls is not None:
        corners = box_corners(x, before.walls), box_corners(after.graph.x, after.walls)
        if corners[0] is not None and corners[1] is not None:
            corner, moved = corners[0][0], corners[1][0]
            return np.asarray(given - (moved - corner) / duration + (x - corner) @ rate.T)
    x, given = x - x.mean(axis=0), given - given.mean(axis=0)
    return min(given, given + x @ rate.T, key=lambda velocity: float(np.linalg.norm(velocity)))


def packing_predictions(
    before: Snapshot,
    after: Snapshot,
    fates: LoopFates,
    candidates: float = CANDIDATES,
    following: Following | None = None,
    times: Sequence[float | None] = (None, None),
) -> tuple[Columns, dict[str, Any], list[str]]:
    """Predictions and fates of all earlier loops, columns of the interval, notes.

    A packing without a rate problem, as one that floats, is `refused` and a note says why; without
    forces there is an `InputError`.
    """
    graph = before.graph
    before.mechanics()
    H, source = sample_strain(before, after)
    columns = facts(before, fates)
    blank = np.full(len(fates.before), np.nan)
    columns |= dict.fromkeys((*PREDICTED, *OWN_FIELDS, *SMALLEST), blank)
    ways = ("path", "replay") if following else ()
    columns |= {f"{way}_{name}": blank for way in ways for name in EVENT_FIELDS}
    try:
        if source == "unknown":
            raise InputError("strain of the interval", "unknown", "grains in both", "Check ids.")
        edge = sample_edge(before, candidates, fixed_point(before, after, H))
    except InputError as error:
        return columns, {"packing_status": "refused"}, [f"no packing response: {error}"]
    rates = edge.nearest
    response = rates.increment(component_control(H))
    if response.status != "not converged":
        columns |= _picked(loop_rates(response, before.faces), PREDICTED)
    if before.rotation is not None and after.rotation is not None:
        # The packing under the grains' actual motion. Codes give angles up to a full turn; a grain
        # turns by less than half of one in an interval.
        here, there = common_grains(before, after)
        turned = after.rotation[there] - before.rotation[here]
        spin = np.full(graph.grain_count, np.nan)
        spin[here] = turned - 2 * np.pi * np.round(turned / (2 * np.pi))
        moved = moved_branches(before, after, response.strain_rate) - graph.branches
        force = rates.forces_of_motion(moved, spin)
        own = replace(response, branch_rate=moved, force_rate=force)
        columns |= _picked(loop_rates(own, before.faces), OWN_FIELDS)
    _, notes = before.boundary_and_notes
    by_events: dict[str, Any] = {}
    if following is not None:
        found, by_events, why = _by_events(before, after, H, times, following)
        columns, notes = columns | found, [*notes, *why]
    place = place_columns(loops_in_place(before.scene), before.mean_kn)
    columns |= dict.fromkeys(SMALLEST, place[SMALLEST[0]])
    # Whether slip drives a contact on that is flagged as sliding (`M_cc <= 0`).
    _, regime = before.mechanics()
    flagged = np.flatnonzero(regime[rates.system.contacts] == Regime.SLIDING)
    growing = np.diag(rates.whole.of_slip) <= 0
    if motion_note(before) or growing[np.isin(rates.rows, flagged)].any():
        columns[SMALLEST[1]] = blank
        notes = [*notes, WITHHELD]
    row = {
        "packing_status": response.status,
        **{f"packing_{name}": getattr(response, name) for name in RESPONSE_FIELDS},
        "packing_rattlers": response.system.carrying.rattlers,
        "packing_boundary": response.system.boundary,
        **by_events,
    }
    return columns, row, notes


def _by_events(
    before: Snapshot,
    after: Snapshot,
    H: Floats,
    times: Sequence[float | None],
    following: Following,
) -> tuple[Columns, dict[str, Any], list[str]]:
    """Predictions of the packing's path and of its replay, columns, notes on failures."""
    graph = before.graph
    ends, notes = dict[str, Contacts](), list[str]()
    row: Row = {"replay_inertial_number": None, "replay_rate_from": None}
    row |= {"path_status": "refused", "path_instabilities": 0}
    row |= {"path_released": None, "path_from_replay": None, "replay_stress_error": None}
    try:
        known = times_of(before, after, times, following)
        loading = loading_between(before, after, H, following.programme, following.table, known)
        rate = interval_rate(before, after, H, times, following, loading)
        row |= {"replay_inertial_number": rate.inertial_number, "replay_rate_from": rate.source}
        notes += balance_notes(before)
        path = follow(
            before, loading.stages, closure="packing", instabilities=PASSED, past=following.past
        )
        work = path.work[-1]
        row |= {
            "path_status": path.status,
            "path_instabilities": len(path.of_kind("instability")),
            "path_released": float(work[3] / work[0]) if work[0] else None,
        }
        if path.status == "finished":
            ends["path"] = path.states[-1]
        else:
            notes.append(f"path by events {path.status}: {path.message}")
        ends["replay"] = replay(
            before, loading.strain, shares=loading.shares, damping=following.damping,
            **rate.options,
        ).state  # fmt: skip
        row["replay_stress_error"] = stress_error(ends["replay"], after)
        if "path" in ends:
            row["path_from_replay"] = path_from_replay(path, ends["replay"], graph.contact_count)
    except InputError as error:
        notes.append(f"not followed by events: {error}")
    columns: Columns = {}
    for name, end in ends.items():
        changes = loop_changes(graph, end, before.faces)
        columns |= _picked(changes, {f"{name}_{key}": field for key, field in EVENT_FIELDS.items()})
    return columns, row, notes


def path_from_replay(path: Path, replayed: Contacts, contacts: int) -> float:
    """Distance of the contact forces at both ends, over their change on the replay."""
    ends = path.states[0], replayed, path.states[-1]
    first, last, other = (state.forces[:contacts] for state in ends)
    return float(np.linalg.norm(other - last) / np.linalg.norm(last - first))


def stress_error(end: Contacts, after: Snapshot) -> float | None:
    """Difference of a final stress to that of the later snapshot, over its mean stress."""
    own = stress_of(after)
    pressure = 0.5 * abs(float(np.trace(own)))
    return float(np.linalg.norm(end.stress - own)) / pressure if pressure > 0 else None


def _picked(rates: LoopRates, names: dict[str, str]) -> Columns:
    return {name: getattr(rates, field) for name, field in names.items()}


def facts(before: Snapshot, fates: LoopFates) -> Columns:
    """Order, fate, lost contacts and smallest force of every earlier loop."""
    graph, faces = before.graph, before.faces
    lost = np.ones(graph.contact_count, dtype=bool)
    lost[fates.contacts.shared] = False
    opened, smallest = np.zeros(len(faces.loops), dtype=bool), np.empty(len(faces.loops))
    scale = float(graph.normal_force.mean()) or 1.0
    for batch in loop_batches(graph, faces):
        opened[batch.row] = lost[batch.contacts].any(axis=1)
        smallest[batch.row] = graph.normal_force[batch.contacts].min(axis=1) / scale
    names = np.array([fate.name.lower() for fate in Fate])
    return {
        "loop": np.arange(len(faces.loops)),
        "order": fates.order_before,
        "fate": names[fates.before],
        "contact_lost": opened,
        "smallest_N": smallest,
    }


def indicator_columns(before: Snapshot, previous: Snapshot | None) -> Columns:
    """Columns `indicator_*` of every loop of the earlier snapshot; no numbers where it floats."""
    graph = before.graph
    nonaffinity = np.full(graph.grain_count, np.nan)
    if previous is not None:
        strain, _ = sample_strain(previous, before)
        moved = least_squares_nonaffinity(previous.graph, moved_branches(previous, before, strain))
        here, there = common_grains(before, previous)
        nonaffinity[here] = moved[there]
    try:
        found = indicators(before, nonaffinity=nonaffinity)
    except InputError:
        found = {name: np.full(len(before.faces.loops), np.nan) for name in EXPECTED}
    return {f"indicator_{name}": values for name, values in found.items()}


def increment_columns(table: Columns, row: Mapping[str, Any], columns: Columns) -> dict[str, Any]:
    """Columns of the increments with `--in-packing`: actual non-affinity and predictions."""
    at = table["loop_before"]
    predicted = {name: columns[name][at] for name in PREDICTED}
    status = np.full(len(at), row["packing_status"])
    return {"nonaffinity": nonaffinity(table, row)} | predicted | {"packing_status": status}


def nonaffinity(table: Columns, row: Mapping[str, Any]) -> Floats:
    """`|strain of a loop - strain of the sample| / |strain of the sample|` of survived loops."""
    H, whole = (
        np.stack([values[f"{name}{ij}"] for ij in COMPONENTS], axis=-1).reshape(-1, 2, 2)
        for name, values in (("H", table), ("dH", row))
    )
    own, sample = rotation_and_stretch(H)[1], rotation_and_stretch(whole)[1]
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.linalg.norm(own - sample, axis=(1, 2)) / np.linalg.norm(sample))


@dataclass(frozen=True, eq=False)
class StrainTable:
    """Deformation gradient over time, (n, 2, 2) from the first row on, of a table."""

    name: str
    time: Floats
    F: Floats

    def __repr__(self) -> str:
        # A part of a series knows the table that it was made with by this.
        digest = hashlib.blake2b(self.time.tobytes() + self.F.tobytes(), digest_size=16)
        return f"StrainTable({digest.hexdigest()})"

    def between(self, start: float, end: float) -> tuple[Floats, Floats]:
        """Displacement gradients (K, 2, 2) at rows between two times and at the last, and shares.

        `InputError` where the table doesn't reach so far.
        """
        near = AT_END * (end - start)
        if not (end > start and self.time[0] <= start + near and end <= self.time[-1] + near):
            raise InputError(
                f"--programme {self.name}",
                f"times from {self.time[0]:.10g} to {self.time[-1]:.10g}",
                f"those of the snapshots, {start:.10g} to {end:.10g}, within them",
                "Add rows, or give the times of the snapshots by --times.",
            )
        inside = (self.time > start + near) & (self.time < end - near)
        at = np.append(self.time[inside], end)
        rows = self.F.reshape(-1, 4).T
        F = np.stack([np.interp([start, *at], self.time, row) for row in rows], axis=-1)
        first, *F_at = F.reshape(-1, 2, 2)
        shares = (at - start) / (end - start)
        return np.eye(2) - np.array(F_at) @ np.linalg.inv(first), np.append(shares[:-1], 1.0)


def read_strains(path: File) -> StrainTable:
    """Read strains over time: `time` with the cell `h_xx`, ... or with `H11`, `H22` (`H12`, `H21`).

    `InputError` if columns lack, times don't grow, or a cell has no area.
    """
    if not path.is_file():
        expected = f"{', '.join(WAYS)}, or a table of strains over time"
        raise InputError("--programme", f"{str(path)!r}", expected, "Check the word, or the path.")
    table = read_table(path)
    time = table.column("time")
    if not (len(time) > 1 and np.isfinite(time).all() and (np.diff(time) > 0).all()):
        received = f"{len(time)} rows, or times that do not grow"
        remedy = "Sort the rows, and drop repeated ones."
        raise InputError(f"column 'time' of {path}", received, "growing times of 2 rows", remedy)
    if table.has(*CELL_COLUMNS):
        cells = table.columns(*CELL_COLUMNS).reshape(-1, 2, 2)
        moved = [np.eye(2)]
        for before, after in pairwise(cells):
            moved.append((np.eye(2) - cell_strain(before, after)) @ moved[-1])
        return StrainTable(path.name, time, np.array(moved))
    none = np.zeros(len(time))
    names = [f"H{ij}" for ij in COMPONENTS]
    needed = {"H11", "H22"}
    H = [table.column(name) if name in needed or table.has(name) else none for name in names]
    F = np.eye(2) - np.column_stack(H).reshape(-1, 2, 2)
    if not (np.isfinite(F).all() and (np.linalg.det(F) > 0).all()):
        remedy = "Strains are positive in compression, shares of the first sides."
        raise InputError(f"strains of {path}", "no area left", "finite, below 1", remedy)
    return StrainTable(path.name, time, F)


class IntervalLoading(NamedTuple):
    """Loading of an interval: what `replay` is given, and the stages of a path.

    `start` is the strain of the whole interval at the velocity gradient of its beginning.
    """

    strain: Floats | Stage
    shares: Floats | None
    stages: Sequence[Stage]
    start: Floats
    size: float


def loading_between(
    before: Snapshot,
    after: Snapshot,
    H: Floats,
    programme: str,
    table: StrainTable | None = None,
    times: Sequence[float | None] = (None, None),
) -> IntervalLoading:
    """Loading that strains the sample by `H` from one snapshot to the next; `times` are theirs."""
    size = float(np.linalg.norm(H))
    if table is not None:
        if times[0] is None or times[1] is None:
            remedy = "Give --times, or --time-step where snapshots are numbered by steps."
            raise InputError(f"--programme {table.name}", "no times", "of the snapshots", remedy)
        ends, shares = table.between(times[0], times[1])
        largest = max(size, float(np.linalg.norm(ends, axis=(1, 2)).max()))
        left = H - ends[-1]
        if np.linalg.norm(left) > AGREE * largest:
            told, own = (np.array2string(one, precision=3) for one in (ends[-1], H))
            remedy = "Check units, signs and times of the table."
            raise InputError(f"--programme {table.name}", told, f"{own}, of the snapshots", remedy)
        return in_parts(ends + shares[:, None, None] * left, shares)
    if programme.startswith("mixed"):
        along = int(programme[-1])
        driven, held = f"{along}{along}", f"{3 - along}{3 - along}"
        first, last = (stress_of(one) for one in (before, after))
        change = (nominal(last, H) - first).ravel()
        on = np.array([ij == held for ij in COMPONENTS], dtype=float)
        rate = np.where(on > 0, change, H.ravel())
        name = f"H{driven} and P{held} of the interval"
        mixed = Stage(Programme(name, np.diag(on), np.diag(1.0 - on), rate), "parameter", 1.0)
        return IntervalLoading(mixed, None, [mixed], H, size)
    if programme.endswith("first"):
        k = int(programme[0]) - 1
        first_part = np.zeros((2, 2))
        first_part[k, k] = H[k, k]
        return in_parts(np.array([first_part, H]), None)
    return IntervalLoading(H, None, strain_stages(H[None]), H, size)


def in_parts(ends: Floats, shares: Floats | None) -> IntervalLoading:
    """Loading through displacement gradients (K, 2, 2), at shares of the time or at one speed."""
    sizes = np.linalg.norm(np.diff(ends, axis=0, prepend=0.0), axis=(1, 2))
    moving = np.flatnonzero(sizes > 0)
    if not len(moving):
        return IntervalLoading(ends[-1], None, strain_stages(ends[-1:]), ends[-1], 0.0)
    size, first = float(sizes.sum()), int(moving[0])
    if shares is None:
        # Parts without a strain take no time.
        ends, start = ends[moving], ends[first] * size / sizes[first]
        return IntervalLoading(ends, None, strain_stages(ends), start, size)
    return IntervalLoading(ends, shares, strain_stages(ends[moving]), ends[0] / shares[0], size)


def strain_stages(ends: Floats) -> list[Stage]:
    """Stages that reach displacement gradients (K, 2, 2) one after the other."""
    steps = np.diff(ends, axis=0, prepend=0.0).reshape(-1, 4)
    none, every = np.zeros((4, 4)), np.eye(4)
    name = "strain of the interval"
    return [Stage(Programme(name, none, every, step), "parameter", 1.0) for step in steps]


def stress_of(snapshot: Snapshot) -> Floats:
    """(2, 2) stress of a snapshot, walls included."""
    return start_state(snapshot.graph, snapshot.boundary_and_notes[0]).stress
