"""The rate problem of a graph as it stands."""

from __future__ import annotations

from typing import get_args

from numpy.typing import ArrayLike

from loops import ContactLaw, GrainGraph
from loops.closures import Closure, Spins
from loops.closures.macro_tangent import check_choice
from loops.laws.protocol import require_law
from stability.paths.edge import EdgeTrial, edge_problem
from stability.paths.model import path_model
from stability.paths.state import initial_state, unpack
from stability.paths.walk import start_mode
from stability.programmes import Programme
from stability.rate_problem import RateProblem


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
    combinations are tried if there are few (theory note, sections 2 and 6).

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
    model = path_model(graph, law, closure, spins, volume)
    state = unpack(model, initial_state(model, graph))
    return edge_problem(
        model, state, start_mode(model, graph), programme, preferred={}, direction=None
    )
