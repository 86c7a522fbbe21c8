"""Path and rates of a loop, from its graph."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import get_args, overload

import numpy as np
from numpy.typing import ArrayLike

from loops import ContactLaw, GrainGraph, InputError, RollingResistance, Support, contact_state
from loops.closures import Closure, Spins
from loops.errors import check_choice
from loops.laws.frictional import require_law
from stability.path import Path, follow_stages
from stability.paths.loop_path import LoopPathOptions, LoopPathSolver
from stability.paths.model import path_model
from stability.paths.record import model_choice
from stability.paths.regimes import EdgeTrial, edge_problem
from stability.paths.state import first_state, initial_state, start_mode, unpack
from stability.paths.supported import SupportedRates, supported_rates
from stability.programmes import Programme, Stage
from stability.regimes import Regimes


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


@overload
def rates_at(graph: GrainGraph, law: ContactLaw, programme: Support) -> Regimes[SupportedRates]: ...


@overload
def rates_at(
    graph: GrainGraph,
    law: ContactLaw,
    programme: Programme,
    *,
    closure: Closure = "affine",
    spins: Spins = "blocked",
    volume: ArrayLike | None = None,
) -> Regimes[EdgeTrial]: ...


def rates_at(
    graph: GrainGraph,
    law: ContactLaw,
    programme: Programme | Support,
    *,
    closure: Closure | None = None,
    spins: Spins | None = None,
    volume: ArrayLike | None = None,
) -> Regimes[EdgeTrial] | Regimes[SupportedRates]:
    """Rates of a graph under a programme, contacts at the edge of their law included.

    Contacts at yield stick or slide, touching ones part as well, as the motion decides: all
    combinations are tried if there are few.

    Parameters
    ----------
    graph : GrainGraph
        One state, see `follow`.
    law : ContactLaw
        Contact law.
    programme : Programme or Support
        Control; rates are per unit of its loading parameter. Or the held grains of a cluster and
        the motions imposed on them: then each grain that is free balances itself, there is no
        closure, and forces need not be those of the overlaps.
    closure, spins, volume
        As in `follow`; 'affine' and 'blocked' if left out. Not of a supported cluster.

    Returns
    -------
    Regimes
        `status` 'unique', 'none', 'several' or 'family' (a line of solutions or more); of each
        solution `rates.mode.regime`, `rates.rates.H` and `rates.rates.P`, of a supported cluster
        `rates.regime`, `rates.motion`, `rates.spin`, `rates.normal_force`, `rates.shear_force`.

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

    A disc on two others, both contacts at yield; one comes nearer. Either contact may slide, and
    any share of the two does:

    >>> from loops import Support
    >>> row = GrainGraph(x=[[0, 0], [0.8, 0.6], [1.6, 0]], radii=[0.5] * 3,
    ...     contacts=[[0, 1], [1, 2]], normal_force=[1e-9] * 2, shear_force=[-1e-10, 1e-10])
    >>> support = Support([True, False, True], [[0, 0, 0], [0, 0, 0], [-1, 0, 0]])
    >>> found = rates_at(row, law, support)
    >>> found.status, found.families[0].corners.round(3).tolist()
    ('family', [[0.333, 0.0], [0.0, 0.333]])
    """
    require_law(law)
    if isinstance(programme, Support):
        given = {"closure": closure, "spins": spins, "volume": volume}
        for name in (name for name, value in given.items() if value is not None):
            expected = "no closure, spins or volume with a support"
            raise InputError(name, f"{given[name]!r}", expected, "Leave it out.")
        return supported_rates(graph, law, programme)
    closure, spins = closure or "affine", spins or "blocked"
    check_choice("closure", closure, get_args(Closure))
    check_choice("spins", spins, get_args(Spins))
    contacts = contact_state(graph)
    model = path_model(graph, contacts, law, closure, spins, volume)
    mode, state = start_mode(model, contacts), unpack(model, initial_state(model, contacts))
    return edge_problem(model, state, mode, programme, preferred={}, direction=None)
