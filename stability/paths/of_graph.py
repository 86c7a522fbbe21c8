"""Path and rates of a loop, from its scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from loops import Scene
from loops.closures import Closure, Spins
from loops.laws.of_pairs import require_unlimited_rolling
from stability.path import Path, follow_stages
from stability.paths.loop_path import LoopPathOptions, LoopPathSolver
from stability.paths.model import path_model
from stability.paths.record import model_choice
from stability.paths.regimes import EdgeTrial, Held, edge_problem
from stability.paths.segment import ATOL
from stability.paths.state import first_state, initial_state, start_mode, unpack
from stability.programmes import Programme, Stage
from stability.regimes import ENUMERATION_LIMIT, Regimes


def follow_loop(
    scene: Scene,
    stages: Sequence[Stage],
    closure: Closure,
    options: LoopPathOptions,
    *,
    rows: int = 0,
    max_steps: int = 20_000,
    stop: tuple[str, ...] = (),
) -> Path:
    """Follow a loop through its stages, see `stability.follow`; to the first event to `stop` at."""
    graph, law = scene.graph, scene.law
    require_unlimited_rolling(law)
    contacts = scene.contact_state
    model = path_model(graph, contacts, law, closure, options.spins, scene.given_volume)
    mode = start_mode(model, contacts)
    model, y, least = first_state(model, contacts)
    solver = LoopPathSolver(
        model=replace(model, search_all=options.model == "full"),
        y=y,
        mode=mode,
        options=options,
        atol=max(ATOL, least),
        rows=rows,
        steps_left=max_steps,
        programmes=tuple(stage.programme for stage in stages),
        stop=stop,
        in_full=1 if stop else ENUMERATION_LIMIT,
    )
    solver.find_symmetry()
    start = solver.model
    status, message = follow_stages(solver.follow_stage, stages)
    chosen = model_choice(start, options.model, solver.searches, solver.symmetry_kept)
    return solver.record.path(solver.model, status, message, options.subspaces[0], chosen)


def rates_of_loop(
    scene: Scene, programme: Programme, closure: Closure, spins: Spins, regime: Held | None
) -> Regimes[EdgeTrial]:
    """Find the rates of a loop under a programme, see `stability.rates_at`."""
    graph, law = scene.graph, scene.law
    contacts = scene.contact_state
    model = path_model(graph, contacts, law, closure, spins, scene.given_volume)
    mode, state = start_mode(model, contacts), unpack(model, initial_state(model, contacts))
    return edge_problem(model, state, mode, programme, preferred={}, direction=None, held=regime)
