"""The quasi-static path of a packing, followed from event to event."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from loops.errors import InputError, check_choice, check_type, number, whole_number
from loops.scene import Scene
from stability.packing.past import OTHER_WAYS, PassBy, Viscous, past_of
from stability.packing.past import stop as end_there
from stability.packing.path_solver import PackingPathSolver, Stop
from stability.path import FINISHED, Past, Path, follow_stages
from stability.programmes import Stage

# Share of the intervals before the end of a path that is gone through again in halves, and the
# least number of them.
STRETCH = 0.5
LEAST_STRETCH = 4
# Change of a limit by half the interval, over itself, from which on it counts as converged.
CONVERGED = 0.01
# Halvings after which a limit is said to be not converged.
MOST_HALVINGS = 5


@dataclass(frozen=True)
class PackingPathOptions:
    """Options of `follow` under the packing closure, see there."""

    interval: float = 5e-6
    instabilities: int = 20
    past: Past | PassBy = "viscous"
    load_kept: float = 1.0
    spread: bool = False
    progress: Callable[[float], None] | None = None
    pathologies: bool = False

    def __post_init__(self) -> None:
        number("interval", self.interval, 0.0, open_low=True)
        whole_number("instabilities", self.instabilities, 1)
        if not (callable(self.past) or isinstance(self.past, Viscous)):
            check_choice("past", self.past, get_args(Past))
        number("load_kept", self.load_kept, 0.0, 1.0)
        if self.progress is not None:
            check_type("progress", self.progress, Callable, "Give a function, or leave it out.")
        if self.spread and past_of(self.past) not in OTHER_WAYS:
            received = f"True with past={self.past!r}"
            remedy = "Leave it out: other paths have no second choice at instabilities."
            raise InputError("spread", received, "past='viscous' or 'dynamic'", remedy)


def follow_packing(
    scene: Scene,
    stages: Sequence[Stage],
    options: PackingPathOptions,
    *,
    rows: int = 0,
    max_steps: int = 20_000,
) -> Path:
    """Follow a packing through its stages: `stability.follow` with the packing closure."""
    o = options
    solver = PackingPathSolver(scene, stages, o.interval, o.past, o.load_kept, o.pathologies)

    def through(number: int, stage: Stage) -> Stop:
        away = solver.start_stage(number, stage, max(rows, 1))
        return away or solver.run(o.interval, o.instabilities, max_steps, o.progress)

    stop = follow_stages(through, stages)
    path = solver.path(*stop)
    if o.spread:
        again = path
        if any(event.passed for event in path.events):
            other = OTHER_WAYS[solver.past]
            asked = replace(o, past=other, spread=False, pathologies=False)
            again = follow_packing(scene, stages, asked, rows=rows, max_steps=max_steps)
        path = replace(path, stress_spread=_stress_spread(path, again))
    met = stop[0] == "control_limit" or (stop[0] == "instabilities" and solver.past is end_there)
    if not (met and solver.history):
        return path

    def ends(size: float) -> bool:
        return solver.run(size, o.instabilities) != FINISHED

    limit, spread = halved(solver, ends, lambda: solver.point.parameter)
    message = f"{path.message}; the limit has not converged" if spread > CONVERGED else path.message
    return replace(path, message=message, limit=limit, limit_spread=spread)


def _stress_spread(path: Path, other: Path) -> float:
    """Largest difference of the stress of two paths where both have rows, over its change."""
    both = path.parameter <= other.parameter[-1] * (1.0 + 1e-12)
    P = np.array([np.interp(path.parameter[both], other.parameter, p) for p in other.P.T]).T
    apart = np.linalg.norm(path.P[both] - P, axis=1).max()
    return float(apart / max(np.linalg.norm(path.P - path.P[0], axis=1).max(), 1e-300))


def halved(
    solver: PackingPathSolver, ends: Callable[[float], bool], value: Callable[[], float]
) -> tuple[float, float]:
    """Go through the last intervals again, in halves: the limit, and its change over itself.

    `ends` goes on at intervals of a size, and tells whether the path ends before its target. They
    are halved until the limit changes by less than 1 %; else the change is infinite.
    """
    limit = value()
    for _ in range(MOST_HALVINGS):
        end = solver.point
        back = min(max(LEAST_STRETCH, math.ceil(STRETCH * end.intervals)), len(solver.history))
        for _ in range(back):
            solver.point = solver.history.pop()
        # Half of what the intervals were in the mean: one that a limit ends is shorter.
        size = 0.5 * float(np.linalg.norm(end.F - solver.point.F)) / back
        if not (size > 0 and ends(size)):
            # In halves it goes on, or nothing moved.
            solver.point = end
            return limit, math.inf if size > 0 else 0.0
        coarse, limit = limit, value()
        if abs(coarse - limit) <= CONVERGED * abs(limit):
            return limit, abs(coarse - limit) / max(abs(limit), 1e-300)
    return limit, math.inf
