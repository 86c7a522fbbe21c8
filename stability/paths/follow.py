"""Path and rates of a loop, from its graph."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from loops import ContactLaw, GrainGraph, InputError, RollingResistance, contact_state
from loops.closures import Closure, Spins
from loops.errors import check_choice
from loops.laws.frictional import require_law
from stability.path import Path, follow_stages
from stability.paths.loop_path import LoopPathOptions, LoopPathSolver
from stability.paths.model import path_model
from stability.paths.record import model_choice
from stability.paths.regimes import EdgeTrial, edge_problem
from stability.paths.state import first_state, initial_state, start_mode, unpack
from stability.programmes import Programme, Stage
from stability.rate_problem import RateProblem


def follow_loop(
    graph: GrainGraph,
    law: ContactLaw,
    stages: Sequence[Stage],
    closure: Closure,
    options: LoopPathOptions,
    *,
    rows: int = 0,
    max_steps: int = 20_000,
) -> Path:
    """Follow a loop through its stages, see `stability.follow`."""
    require_law(law)
    if isinstance(law, RollingResistance) and np.isfinite(law.mu_r).any():
        expected = "springs for rolling without a limit, mu_r=inf, in paths of loops"
        raise InputError("law", "a finite mu_r", expected, "Follow the packing, or leave it out.")
    contacts = contact_state(graph)
    model = path_model(graph, contacts, law, closure, options.spins, options.volume)
    model, y, least = first_state(model, contacts)
    solver = LoopPathSolver(
        model=replace(model, search_all=options.model == "full"),
        y=y,
        mode=start_mode(model, contacts),
        options=options,
        atol=max(options.atol, least),
        rows=rows,
        steps_left=max_steps,
        programmes=tuple(stage.programme for stage in stages),
        periodic=graph.cell is not None,
    )
    solver.find_symmetry()
    start = solver.model
    status, message = follow_stages(solver.follow_stage, stages)
    chosen = model_choice(start, options.model, solver.searches, solver.symmetry_kept)
    return solver.record.path(solver.model, status, message, options.subspaces[0], chosen)


def rates_at(
    graph: GrainGraph,
    law: ContactLaw,
    programme: Programme,
    *,
    closure: Closure = "affine",
    spins: Spins = "blocked",
    volume: ArrayLike | None = None,
) -> RateProblem[EdgeTrial]:
    """Rates of a graph under a programme, contacts at the edge of their law included.

    Contacts at yield stick or slide, touching ones part as well, as the motion decides: all
    combinations are tried if there are few.

    Parameters
    ----------
    graph : GrainGraph
        One state, see `follow`.
    law : ContactLaw
        Contact law.
    programme : Programme
        Control; rates are per unit of its loading parameter.
    closure, spins, volume
        As in `follow`.

    Returns
    -------
    RateProblem
        `status` 'unique', 'none' or 'several'; of each solution `rates.mode.regime`,
        `rates.rates.H` and `rates.rates.P`.

    Raises
    ------
    InputError
        As in `follow`.

    Examples
    --------
    >>> from loops import GrainGraph, LinearFrictional
    >>> from stability import programmes, rates_at
    >>> x = [[1, 0], [0, 1], [-1, 0], [0, -1]]
    >>> ring = [[0, 1], [1, 2], [2, 3], [3, 0]]
    >>> square = GrainGraph(x=x, radii=[0.5 ** 0.5] * 4, contacts=ring)
    >>> law = LinearFrictional(kn=1.0, kt=0.2, mu=0.1)
    >>> found = rates_at(square, law, programmes.isotropic_strain())
    >>> found.status, found.taken.rates.mode.regime.tolist()
    ('unique', [1, 1, 1, 1])
    """
    require_law(law)
    check_choice("closure", closure, get_args(Closure))
    check_choice("spins", spins, get_args(Spins))
    contacts = contact_state(graph)
    model = path_model(graph, contacts, law, closure, spins, volume)
    mode, state = start_mode(model, contacts), unpack(model, initial_state(model, contacts))
    return edge_problem(model, state, mode, programme, preferred={}, direction=None)
