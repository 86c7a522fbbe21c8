"""One stage of a path: phases joined by rate problems."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from loops import GrainGraph, InputError
from loops.contact_state import contact_state
from loops.laws.protocol import Regime
from stability.paths.edge import EdgeTrial, edge_problem, rate_vector
from stability.paths.events import hints_of, record_changes, record_fired, touched_pairs
from stability.paths.look import look
from stability.paths.model import PathModel, with_contact
from stability.paths.monitors import stage_quantity
from stability.paths.motion import gauge_along
from stability.paths.path import PathStatus
from stability.paths.phase import PhaseEnd, Settings, Task, run_phase
from stability.paths.record import Record
from stability.paths.state import Mode, contacts_of, pack, scales, unpack
from stability.programmes import QUANTITIES, Stage
from stability.rate_problem import ELASTIC, Choice, RateProblem

Floats = NDArray[np.float64]

# Rate problems in a row without progress after which the regimes are said to chatter.
CHATTER = 12

# Shear force that a parting contact may drop, over kn times length.
RELEASE = 1e-9


@dataclass
class Walk:
    """Where a path is, and how it is followed."""

    model: PathModel
    y: Floats
    mode: Mode
    record: Record
    subspace: str
    on_touch: str
    rtol: float
    atol: float
    max_step: float
    steps_left: int

    @property
    def parameter(self) -> float:
        """Loading parameter."""
        return unpack(self.model, self.y).parameter

    @property
    def settings(self) -> Settings:
        """Accuracy of the phases."""
        atol = self.atol * scales(self.model)
        return Settings(self.rtol, atol, self.max_step, self.steps_left, self.subspace)


def start_mode(model: PathModel, graph: GrainGraph) -> Mode:
    """Regimes of the initial graph.

    Parameters
    ----------
    model : PathModel
        Constants.
    graph : GrainGraph
        Initial state.

    Returns
    -------
    Mode

    Raises
    ------
    InputError
        If a shear force lies outside the cone.
    """
    contacts = contact_state(graph)
    excess = np.abs(contacts.shear_force) - np.where(np.isfinite(model.mu), model.mu, 0.0) * (
        contacts.normal_force
    )
    wrong = np.isfinite(model.mu) & (excess > 1e-9 * model.stiffness * model.length)
    if wrong.any():
        c = int(wrong.argmax())
        raise InputError(
            f"shear force of contact {c}",
            f"{graph.shear_force[c]:.6g}",
            f"at most mu N = {model.mu[c] * graph.normal_force[c]:.6g}",
            "Correct it, or raise mu.",
        )
    return Mode(model.law.regime(contacts), np.sign(contacts.shear_force))


def walk_stage(walk: Walk, stage: Stage) -> tuple[PathStatus, str]:
    """Follow one stage to its target or to where it ends.

    Parameters
    ----------
    walk : Walk
        Updated in place.
    stage : Stage
        Programme and target.

    Returns
    -------
    status, message
        As in `Path`; 'finished' if the target was reached.
    """
    start, sense = walk.parameter, None
    hints: dict[int, Choice] = {}
    before: Floats | None = None
    idle, fresh = 0, True
    while True:
        state = unpack(walk.model, walk.y)
        problem = edge_problem(
            walk.model, state, walk.mode, stage.programme, preferred=hints, direction=before
        )
        if problem.status == "none":
            return _no_continuation(walk, stage, problem)
        trial = problem.taken.rates
        if before is not None or walk.record.rows:
            record_changes(walk.record, walk.mode, trial.mode, walk.parameter, problem)
        released = _enter(walk, trial.mode)
        if released:
            return "lost", released
        seen = look(
            walk.model, walk.y, walk.mode, stage.programme, gauge_along(trial.rates)
        )
        if fresh or trial.mode is not walk.mode:
            walk.record.row(walk.model, seen)
        fresh = False
        if sense is None:
            sense = np.sign(stage.target - stage_quantity(stage, seen, start))
            if sense == 0:
                return "finished", "every stage reached its target"
        task = Task(walk.model, walk.mode, stage, start, float(sense), walk.settings)
        end = run_phase(
            task,
            walk.y,
            gauge_along(trial.rates),
            lambda seen: walk.record.row(walk.model, seen),
            walk.steps_left,
        )
        moved = float(np.abs(end.seen.H - seen.H).max())
        walk.y, walk.steps_left = end.y, walk.steps_left - end.steps
        if not end.fired:
            return "lost", _lost(end, stage)
        walk.record.row(walk.model, end.seen)
        record_fired(walk.record, end, walk.model, walk.subspace)
        kinds = {kind for kind, _ in end.fired}
        if "stage_end" in kinds:
            return "finished", "every stage reached its target"
        if "control_limit" in kinds:
            return "control_limit", _limit(stage, end)
        hints, before = hints_of(end), rate_vector(walk.model, end.seen.rates)
        if "opposite_contact" in kinds and walk.on_touch != "ignore":
            pairs = touched_pairs(end, walk.model)
            if walk.on_touch == "stop":
                return "opposite_contact", f"grains {pairs.tolist()} touch"
            _add_contacts(walk, pairs, hints)
            before = None
        idle = idle + 1 if moved < 1e-13 else 0
        if idle > CHATTER:
            return "lost", f"the regimes keep switching at parameter {walk.parameter:.17g}"
