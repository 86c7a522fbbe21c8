"""One stage of a path: pieces joined by rate problems."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from loops.arrays import Floats
from loops.laws.frictional import TOUCHING
from loops.laws.protocol import Regime
from stability.paths.edge import EdgeTrial, edge_problem, rate_vector
from stability.paths.equations import UNIT_PARAMETER
from stability.paths.events import (
    SINGULAR,
    hints_of,
    record_changes,
    record_fired,
    record_jumps,
    record_start,
    touched_pairs,
)
from stability.paths.look import Look
from stability.paths.model import with_contact, without_pairs
from stability.paths.path import PathStatus
from stability.paths.piece import PieceEnd, Task, run_piece
from stability.paths.rates import shear_stiffness, stress
from stability.paths.state import (
    Mode,
    contacts_of,
    displacement_gradient,
    overlaps,
    pack,
    relative_displacements,
    unpack,
)
from stability.paths.walk import Walk
from stability.programmes import QUANTITIES, Stage
from stability.rate_problem import ELASTIC, SEARCH_LIMIT, Choice, RateProblem

# Rate problems in a row without progress after which no regime is said to hold.
CHATTER = 12
# Longest steps to try, over that asked for, where a singular state is in the way.
RETRIES = (1.0, 0.86, 0.74, 0.62)
# A target this close, in strain or in stress over kn, is reached.
REACHED = 1e-15
# Change of H below which nothing has moved.
STILL = 1e-13
FINISHED: tuple[PathStatus, str] = ("finished", "every stage reached its target")
# Force that a parting contact may drop, over kn times length.
RELEASE = 1e-9


def walk_stage(walk: Walk, stage: Stage) -> tuple[PathStatus, str]:
    """Follow one stage to its target or to where it ends."""
    start = walk.parameter
    way = stage.target - _quantity_now(walk, stage)
    unit = walk.model.stiffness if stage.quantity.startswith("P") else 1.0
    if walk.record.rows and abs(way) <= REACHED * unit:
        return FINISHED
    sense = float(np.sign(way))
    hints: dict[int, Choice] = {}
    before: Look | None = None
    idle, reach = 0, np.inf
    while True:
        problem = _rate_problem(walk, stage, hints, before)
        if problem.status == "none" and walk.model.symmetry is not None:
            problem = _asymmetric(walk, stage, hints, before)
        if problem.status == "none":
            # A loop that has not begun to carry has not come apart.
            if walk.record.rows and _carries_nothing(walk):
                return _came_apart(walk)
            return _no_continuation(walk, stage, problem, hints)
        seen, gauge = _enter(walk, stage, problem, before)
        if sense == 0.0:
            return FINISHED
        if before is None:
            if not stage.approaches(sense):
                return "lost", f"{stage.programme.name} leads away from {stage.quantity}'s target"
            reach = _reach(walk, stage, seen)
        task = walk.task(stage, start, sense, reach, float(np.abs(seen.H).max()))
        end = _run(walk, task, gauge)
        walk.y, walk.steps_left = end.y, walk.steps_left - end.steps
        if not end.fired:
            if _carries_nothing(walk):
                return _came_apart(walk)
            return "lost", f"{stage.programme.name} to {stage.quantity}: {end.message}"
        walk.row(end.seen)
        record_fired(walk.record, end, walk.subspaces)
        outcome = _outcome(walk, stage, end)
        if outcome is not None:
            return outcome
        hints, before = hints_of(end), end.seen
        _take_on_contacts(walk, end, hints)
        moved = float(np.abs(end.seen.H - seen.H).max()) > STILL
        idle = 0 if moved else idle + 1
        if idle > CHATTER:
            if _carries_nothing(walk):
                return _came_apart(walk)
            return _nothing_holds(walk, stage, hints)


def _run(walk: Walk, task: Task, gauge: Floats) -> PieceEnd:
    """Integrate to the next event; where strain alone drives, step over a singular point.

    The closure's system may be singular in a single state. Steps of other lengths pass it.
    """
    rows, events = len(walk.record.rows), len(walk.record.events)
    for shorter in RETRIES:
        end = run_piece(
            replace(task, max_step=shorter * task.max_step),
            walk.y,
            gauge,
            walk.row,
            walk.record.branching,
            walk.steps_left,
        )
        stuck = not end.fired or ("singular", -1) in end.fired
        if not stuck or task.stage.programme.stress.any():
            break
        if shorter != RETRIES[-1]:
            del walk.record.rows[rows:], walk.record.events[events:]
    return end


def _rate_problem(
    walk: Walk, stage: Stage, hints: dict[int, Choice], before: Look | None
) -> RateProblem[EdgeTrial]:
    state = unpack(walk.model, walk.y)
    direction = None
    if before is not None and len(before.mode.regime) == walk.model.contact_count:
        direction = rate_vector(walk.model, before.rates)
    problem = edge_problem(
        walk.model, state, walk.mode, stage.programme, preferred=hints, direction=direction
    )
    walk.searches.add(problem)
    return problem


def _asymmetric(
    walk: Walk, stage: Stage, hints: dict[int, Choice], before: Look | None
) -> RateProblem[EdgeTrial]:
    """The rate problem of the full model, taken on if it goes on where no symmetric motion does."""
    small, kept = walk.model, walk.kept
    walk.drop_symmetry()
    problem = _rate_problem(walk, stage, hints, before)
    if problem.status == "none":
        walk.model, walk.kept = small, kept
    return problem


def _enter(
    walk: Walk, stage: Stage, problem: RateProblem[EdgeTrial], before: Look | None
) -> tuple[Look, Floats]:
    """Take the regimes of the rate problem's solution, with forces exactly on the cone."""
    trial = problem.taken.rates
    old, walk.mode = walk.mode, trial.mode
    _set_forces(walk, old)
    gauge = trial.rates.gauge
    seen = walk.look(stage.programme, gauge)
    if not walk.record.rows:
        walk.row(seen)
        record_start(walk.record, walk.model, walk.mode)
        return seen, gauge
    record_changes(walk.record, old, walk.mode, walk.parameter, problem)
    if before is not None:
        record_jumps(walk.record, before.A, seen.A, walk.parameter, walk.subspaces)
    if before is None or (old.regime != walk.mode.regime).any():
        walk.row(seen)
    return seen, gauge


def _set_forces(walk: Walk, old: Mode) -> None:
    """Write the forces of the regimes into `y`; what a parting contact drops is dissipated."""
    model, state = walk.model, unpack(walk.model, walk.y)
    shear = contacts_of(model, state, walk.mode).shear_force
    parting = (walk.mode.regime == Regime.OPEN) & (old.regime != Regime.OPEN)
    work = state.work
    if parting.any():
        before = contacts_of(model, state, old)
        elastic = state.shear_force**2 / (2 * shear_stiffness(model, before))
        stored = model.law.normal_energy(before)
        lost = np.where(parting, stored, 0.0).sum()
        work = work + np.array([0.0, 0.0, lost, lost + np.where(parting, elastic, 0.0).sum()])
    walk.y = pack(state.place, shear, state.parameter, work)


def _outcome(walk: Walk, stage: Stage, end: PieceEnd) -> tuple[PathStatus, str] | None:
    """Status if the events end the stage."""
    kinds = {kind for kind, _ in end.fired}
    if "collapse" in kinds:
        return "lost", f"the loop collapses to a line at parameter {walk.parameter:.15g}"
    if "stage_end" in kinds:
        return FINISHED
    if "singular" in kinds:
        return (
            "control_limit",
            f"{stage.programme.name} at parameter {walk.parameter:.15g}: {SINGULAR}",
        )
    if "control_limit" in kinds:
        return (
            "control_limit",
            f"{stage.programme.name}: the loading parameter has an extremum at "
            f"{walk.parameter:.15g}; {stage.quantity} = {stage.target:.6g} was not reached",
        )
    if "opposite_contact" in kinds and walk.on_touch == "stop":
        return "opposite_contact", f"grains {touched_pairs(end).tolist()} touch"
    torn = _torn_contacts(walk, end)
    if torn:
        return "lost", f"contacts {torn} part while they carry a force: the loop is out of balance"
    return None


def _carries_nothing(walk: Walk) -> bool:
    """Whether no contact carries a force worth the name."""
    contacts = contacts_of(walk.model, unpack(walk.model, walk.y), walk.mode)
    force = np.maximum(np.abs(contacts.normal_force), np.abs(contacts.shear_force))
    return bool(force.max(initial=0.0) <= RELEASE * walk.model.stiffness * walk.model.length)


def _came_apart(walk: Walk) -> tuple[PathStatus, str]:
    parted = int((walk.mode.regime == Regime.OPEN).sum())
    return (
        "no_load",
        f"the loop comes apart at parameter {walk.parameter:.15g}: its contacts carry no force"
        f" ({parted} of {walk.model.contact_count} open) and nothing resists the control",
    )


def _torn_contacts(walk: Walk, end: PieceEnd) -> list[int]:
    """Parting contacts whose shear force would have to be balanced at once."""
    if walk.model.closure == "affine":
        return []
    limit = RELEASE * walk.model.stiffness * walk.model.length
    contacts = end.seen.contacts
    force = np.maximum(np.abs(contacts.shear_force), np.abs(contacts.normal_force))
    return [c for kind, c in end.fired if kind == "opening" and force[c] > limit]


def _take_on_contacts(walk: Walk, end: PieceEnd, hints: dict[int, Choice]) -> None:
    """Let grains that have come to touch overlap from now on, or give them a contact."""
    pairs = touched_pairs(end)
    if len(pairs) == 0:
        return
    walk.model = without_pairs(walk.model, pairs)
    if walk.on_touch != "add":
        return
    state, old, new = unpack(walk.model, walk.y), walk.mode, len(pairs)
    for k in range(new):
        hints[walk.model.contact_count + k] = ELASTIC
    walk.model = with_contact(walk.model, pairs)
    shear = np.concatenate([state.shear_force, np.zeros(new)])
    walk.y = pack(state.place, shear, state.parameter, state.work)
    overlap = overlaps(walk.model, relative_displacements(walk.model, state.place))[-new:]
    # Grains that overlap from the start press on each other at once.
    pressed = overlap > TOUCHING * walk.model.touching[-new:]
    regime = np.where(pressed, Regime.ELASTIC, Regime.OPEN).astype(np.int8)
    walk.mode = Mode(
        np.concatenate([old.regime, regime]), np.concatenate([old.side, np.zeros(new)])
    )
    walk.find_symmetry()


def _no_continuation(
    walk: Walk, stage: Stage, problem: RateProblem[EdgeTrial], hints: dict[int, Choice]
) -> tuple[PathStatus, str]:
    """No regimes agree with the control: a limit of the control, or a contradiction."""
    status: PathStatus = "control_limit"
    if _turns_back(walk, stage, hints):
        reason = "the loading parameter has an extremum where the regimes change"
    elif problem.singular:
        reason = "the controlled system is singular"
    else:
        status = "no_solution"
        reason = "no choice of regimes agrees with the rates it causes"
    if not problem.exhaustive:
        reason += (
            f" (of {problem.combinations:.3g} combinations pivoting from three starts found none;"
            f" more than {SEARCH_LIMIT} are not all tried)"
        )
    if not walk.record.rows:
        # No direction is known.
        walk.row(walk.look(stage.programme, UNIT_PARAMETER))
    walk.record.event("control_limit", walk.parameter, tuple(sorted(hints)), reason)
    return status, f"{stage.programme.name} at parameter {walk.parameter:.15g}: {reason}"


def _nothing_holds(walk: Walk, stage: Stage, hints: dict[int, Choice]) -> tuple[PathStatus, str]:
    """The contacts leave at once whatever regimes agree with the rates."""
    contacts = tuple(sorted(hints))
    reason = f"contacts {list(contacts)} leave at once every regime that agrees with its rates"
    walk.record.event("control_limit", walk.parameter, contacts, reason)
    return "no_solution", f"{stage.programme.name} at parameter {walk.parameter:.15g}: {reason}"


def _turns_back(walk: Walk, stage: Stage, hints: dict[int, Choice]) -> bool:
    """Whether the contacts go on as they came, but with a falling loading parameter."""
    if not hints:
        return False
    back = edge_problem(
        walk.model,
        unpack(walk.model, walk.y),
        walk.mode,
        stage.programme,
        preferred=hints,
        direction=None,
        gauge=-UNIT_PARAMETER,
    )
    return any(
        all(int(found.rates.mode.regime[c]) == choice.regime for c, choice in hints.items())
        for found in back.solutions
    )


def _reach(walk: Walk, stage: Stage, seen: Look) -> float:
    """Length of a stage in the space of `H`, judged from its start."""
    rates = np.concatenate([seen.rates.H, seen.rates.P, [seen.rates.parameter]])
    rate = abs(rates[(*QUANTITIES, "parameter").index(stage.quantity)])
    way = abs(stage.target - _quantity_now(walk, stage))
    return float(way / rate) if rate > 0 else np.inf


def _quantity_now(walk: Walk, stage: Stage) -> float:
    if stage.quantity == "parameter":
        return 0.0
    state = unpack(walk.model, walk.y)
    contacts = contacts_of(walk.model, state, walk.mode)
    H, P = displacement_gradient(walk.model, state.place), stress(walk.model, contacts)
    return float(np.concatenate([H, P])[QUANTITIES.index(stage.quantity)])
