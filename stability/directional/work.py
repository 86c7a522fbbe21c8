"""Second-order work along directions, each with the contact regimes that it activates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops import ContactLaw, GrainGraph, InputError
from loops.arrays import Floats, Regimes
from loops.closures import Closure, Spins
from loops.closures.macro_tangent import check_choice
from stability.directional.affine import affine_branches
from stability.directional.edge import Answer, YieldingContacts, edge_contacts, unit_directions
from stability.directional.relaxed import relaxed_branches
from stability.subspaces import subspace_basis

STATUSES = np.array(["none", "unique", "several"])


class Branches(Protocol):
    """Answers of the rate problem in any direction."""

    @property
    def singular(self) -> int:
        """Combinations of regimes whose equations have no single answer."""
        ...

    def answer(self, directions: Floats) -> Answer:
        """Solutions along unit directions (..., D, m)."""
        ...

    def critical_angles(self) -> Floats:
        """(..., A) ascending angles between which nothing changes, in the plane."""
        ...


@dataclass(frozen=True, eq=False)
class DirectionalWork:
    """Second-order work along directions, batch axes `...` first.

    Attributes
    ----------
    directions : (..., D, m) array
        Unit strain rates e in the subspace.
    status : (..., D) array of str
        'unique', 'none' or 'several' solutions of the rate problem.
    work : (..., D, 2) array
        Smallest and largest `W2 = P':H'` of the solutions per unit strain rate; the same if it is
        unique, NaN if there is none.
    normalised : (..., D, 2) array
        `w2`, W2 over the sizes of both rates (45), of the same two solutions.
    regime : (..., D, C) array of int8
        `Regime` of every contact in the solution with the smallest W2; -1 if there is none.
    edge : YieldingContacts
        Contacts at the edge of their law.
    singular : int
        Combinations of regimes whose equations have no single answer, a mechanism for instance.
        They count for no solution: with 'none', the loop may also move in one of them.
    """

    directions: Floats
    status: NDArray[np.str_]
    work: Floats
    normalised: Floats
    regime: Regimes
    edge: YieldingContacts
    singular: int


def directional_work(
    graph: GrainGraph,
    law: ContactLaw,
    directions: ArrayLike,
    *,
    closure: Closure = "affine",
    spins: Spins = "blocked",
    subspace: str = "diagonal",
    regime: ArrayLike | None = None,
    volume: ArrayLike | None = None,
) -> DirectionalWork:
    """Second-order work along directions, branch by branch.

    A contact at yield slides or sticks, a touching one parts, sticks or slides, depending on the
    direction. Under the affine closure with spins blocked or affine the contacts are independent of
    each other; under a closure that relaxes they make a complementarity problem, solved by trying
    all combinations of regimes.

    Parameters
    ----------
    graph : GrainGraph
        Batch axes `...` allowed where each contact decides by itself.
    law : ContactLaw
        Contact law.
    directions : (..., D, m) array_like
        Strain rates in the components of the subspace, of any length.
    closure, spins, volume
        As in `loops.macroscopic_tangent`.
    subspace : {'diagonal', 'symmetric', 'full'}
        Where the directions and W2 live, m = 2, 3 or 4.
    regime : (..., C) array of Regime, optional
        Flags of a DEM code: sliding contacts count as at yield. Read from the state if left out.

    Returns
    -------
    DirectionalWork

    Raises
    ------
    InputError
        If a direction is zero or has not m components, or, under a closure that relaxes, if the
        graph carries batch axes or more than 256 combinations of regimes.

    Examples
    --------
    A contact at yield: pressed on it sticks, and W2 > 0; parting slowly it slides, and W2 < 0.

    >>> from loops import LinearFrictional
    >>> pair = GrainGraph(x=[[0, 0], [1, 1]], radii=[0.8, 0.8], contacts=[[0, 1]],
    ...                   normal_force=[1e-9], shear_force=[0.5e-9])
    >>> law = LinearFrictional(kn=1.0, kt=1.0, mu=0.5)
    >>> found = directional_work(pair, law, [[3.0, 4.0], [-3.0, 0.0], [-4.0, 3.0]], volume=1.0)
    >>> found.status.tolist(), found.regime[:, 0].tolist()
    (['unique', 'unique', 'unique'], [1, 2, 2])
    >>> found.work[:, 0].round(6).tolist()
    [1.0, 0.25, -0.05]
    """
    branches, edge = branches_of(graph, law, closure, spins, subspace, regime, volume)
    e = np.asarray(directions, dtype=np.float64)
    m = len(subspace_basis(subspace))
    if e.ndim < 2 or e.shape[-1] != m or not (np.abs(e).max(axis=-1, initial=0.0) > 0.0).all():
        expected = f"shape (..., D, {m}), no direction zero"
        raise InputError("directions", f"shape {e.shape}", expected, f"Use those of {subspace!r}.")
    e = unit_directions(e)
    answer = branches.answer(e)
    return DirectionalWork(
        directions=e,
        status=STATUSES[answer.count],
        work=answer.work,
        normalised=answer.cosine,
        regime=answer.regime,
        edge=edge,
        singular=branches.singular,
    )


def branches_of(
    graph: GrainGraph,
    law: ContactLaw,
    closure: Closure,
    spins: Spins,
    subspace: str,
    regime: ArrayLike | None,
    volume: ArrayLike | None,
) -> tuple[Branches, YieldingContacts]:
    """Branches of a graph under its closure, and its contacts at the edge."""
    check_choice("closure", closure, get_args(Closure))
    check_choice("spins", spins, get_args(Spins))
    edge = edge_contacts(graph, law, regime)
    if closure == "affine" and spins != "free":
        return affine_branches(graph, law, edge, spins, subspace, volume), edge
    if graph.cell is not None:
        raise InputError(
            "graph", "a periodic cell", "a loop, for spins that relax", "Use blocked or affine."
        )
    return relaxed_branches(graph, law, edge, closure, spins, subspace, volume), edge
