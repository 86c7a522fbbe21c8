"""Second-order work along directions, each with the contact regimes that it activates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops import ContactLaw, GrainGraph, InputError, Regime, macroscopic_tangent
from loops.arrays import Flags, Floats, Regimes
from loops.closures import Closure, Spins
from loops.closures.system import HasLaw, named_closure, with_law
from loops.errors import check_choice, whole_number
from loops.shown import Shown
from loops.validation import finite
from stability.directional.branches import (
    AffineBranches,
    RelaxedBranches,
    YieldingContacts,
    affine_branches,
    edge_contacts,
    edges_of,
    middles,
    plane_directions,
    relaxed_branches,
    unit_directions,
    widths,
)
from stability.second_order_work import unstable_fraction
from stability.spectra import (
    RTOL,
    operator_norm,
    restrict,
    subspace_basis,
    symmetric_part,
    symmetric_spectrum,
)

STATUSES = np.array(["none", "unique", "several"])


# Answers of the rate problem in any direction.
Branches = AffineBranches | RelaxedBranches


@dataclass(frozen=True, eq=False, repr=False)
class DirectionalWork(Shown):
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
    neutral : (..., D, C) array of bool
        Contacts of which another regime agrees with the same rates, as sticking and sliding do
        where neither is loaded; `regime` names the sticking one of these.
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
    neutral: Flags
    edge: YieldingContacts
    singular: int


def directional_work(
    graph: GrainGraph | HasLaw,
    law: ContactLaw | None = None,
    directions: ArrayLike = (),
    *,
    closure: Closure | None = None,
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
    graph : GrainGraph, or loop or scene
        Batch axes `...` allowed where each contact decides by itself.
    law : ContactLaw, optional
        Contact law; that of the loop or scene if left out.
    directions : (..., D, m) array_like
        Strain rates in the components of the subspace, of any length; named after a loop or scene:
        `directional_work(loop, directions=[[1, 0]], closure="traction")`.
    closure : {'affine', 'traction'}
        How the surrounding medium drives the grains; it has to be named.
    spins, volume
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
        Without a closure; if a direction is zero or has not m components, or, under a closure that
        relaxes, if the graph carries batch axes or more than 256 combinations of regimes.

    Examples
    --------
    A contact at yield: pressed on it sticks, and W2 > 0; parting slowly it slides, and W2 < 0.

    >>> from loops import LinearFrictional
    >>> pair = GrainGraph(x=[[0, 0], [1, 1]], radii=[0.8, 0.8], contacts=[[0, 1]],
    ...                   normal_force=[1e-9], shear_force=[0.5e-9])
    >>> law = LinearFrictional(kn=1.0, kt=1.0, mu=0.5)
    >>> found = directional_work(pair, law, [[3.0, 4.0], [-3.0, 0.0], [-4.0, 3.0]],
    ...                          closure="affine", volume=1.0)
    >>> found.status.tolist(), found.regime[:, 0].tolist()
    (['unique', 'unique', 'unique'], [1, 2, 2])
    >>> found.work[:, 0].round(6).tolist()
    [1.0, 0.25, -0.05]
    """
    graph, law = with_law(graph, law)
    branches, edge = law_branches(graph, law, closure, spins, subspace, regime, volume)
    e = finite("directions", directions)
    m = len(subspace_basis(subspace))
    if e.ndim < 2 or e.shape[-1] != m or not (np.abs(e).max(axis=-1, initial=0.0) > 0.0).all():
        expected = f"shape (..., D, {m}), no direction zero"
        raise InputError("directions", f"shape {e.shape}", expected, f"Use those of {subspace!r}.")
    e = unit_directions(e)
    answer = branches.solve(e)
    return DirectionalWork(
        directions=e,
        status=STATUSES[answer.count],
        work=answer.work,
        normalised=answer.cosine,
        regime=answer.regime,
        neutral=answer.neutral,
        edge=edge,
        singular=branches.singular,
    )


def law_branches(
    graph: GrainGraph,
    law: ContactLaw,
    closure: Closure | None,
    spins: Spins,
    subspace: str,
    regime: ArrayLike | None,
    volume: ArrayLike | None,
) -> tuple[Branches, YieldingContacts]:
    """Branches of a graph under its closure, and its contacts at the edge."""
    closure = named_closure(closure)
    check_choice("spins", spins, get_args(Spins))
    edge = edge_contacts(graph, law, regime)
    if closure == "affine" and spins != "free":
        return affine_branches(graph, law, edge, spins, subspace, volume), edge
    if graph.cell is not None:
        raise InputError(
            "graph", "a periodic cell", "a loop, for spins that relax", "Use blocked or affine."
        )
    return relaxed_branches(graph, law, edge, closure, spins, subspace, volume), edge


# Directions in each scrambled sequence, as a power of two.
POINTS_LOG2 = 10


@dataclass(frozen=True, eq=False, repr=False)
class BranchFraction(Shown):
    """Fractions of all directions of a subspace, batch axes `...` first.

    Attributes
    ----------
    unstable : (...) array
        W2 < 0 in some solution of the rate problem.
    surely : (...) array
        W2 < 0 in every solution, and there is one; less than `unstable` only with several.
    none, several : (...) array
        No solution; several.
    elastic : (...) array
        W2 < 0 by the one quadratic form in which every contact at the edge is elastic.
    sliding : (...) array
        The same with every contact at yield sliding, as in a tangent read from the state.
    error : (...) array
        Standard error of `unstable`; zero where it is exact (in the plane).
    edges : (..., B) array or None
        In the plane, angles in [0, 2 pi) where sign(W2) of the worst solution changes, ascending,
        tan(theta) = e2/e1, NaN behind the last; None in more dimensions.
    singular : int
        See `DirectionalWork`.
    """

    unstable: Floats
    surely: Floats
    none: Floats
    several: Floats
    elastic: Floats
    sliding: Floats
    error: Floats
    edges: Floats | None
    singular: int


def branch_fraction(
    graph: GrainGraph,
    law: ContactLaw,
    *,
    closure: Closure | None = None,
    spins: Spins = "blocked",
    subspace: str = "diagonal",
    regime: ArrayLike | None = None,
    volume: ArrayLike | None = None,
    scramblings: int = 16,
    seed: int = 0,
) -> BranchFraction:
    """Unstable fraction of directions, each in the regimes that it activates.

    Opposite directions activate different regimes: of the two nappes of a cone often one is left.
    In the plane the bounds of the regimes and the zeros of W2 between them are located, and the
    fractions are exact. In three and four dimensions scrambled Sobol sequences of 1024 directions
    each give the difference from the elastic form, whose own fraction is known exactly; their
    scatter is the error, and without contacts at the edge there is none.

    Parameters
    ----------
    graph, law, closure, spins, subspace, regime, volume
        As in `directional_work`.
    scramblings : int
        Independent sequences, 2 or more; the error falls as its square root.
    seed : int
        Seed of the sequences.

    Returns
    -------
    BranchFraction

    Raises
    ------
    InputError
        As `directional_work`.

    Examples
    --------
    A contact at yield has, sliding both ways, a double cone of opening atan(mu). One nappe of it
    is real: in the other the contact would be pressed, and sticks.

    >>> from loops import LinearFrictional
    >>> pair = GrainGraph(x=[[0, 0], [1, 1]], radii=[0.8, 0.8], contacts=[[0, 1]],
    ...                   normal_force=[1e-15], shear_force=[0.5e-15])
    >>> law = LinearFrictional(kn=1.0, kt=1.0, mu=0.5)
    >>> found = branch_fraction(pair, law, closure="affine", volume=1.0)
    >>> np.tan(np.array([2 * found.unstable, found.sliding]) * np.pi).round(9).tolist()
    [0.5, 0.5]
    >>> float(found.elastic), found.edges.round(6).tolist()
    (0.0, [2.356194, 2.819842])
    """
    whole_number("scramblings", scramblings, least=2)
    whole_number("seed", seed, least=0)
    branches, edge = law_branches(graph, law, closure, spins, subspace, regime, volume)

    def form(regimes: Regimes) -> Floats:
        tangent = macroscopic_tangent(
            graph, law, closure, spins=spins, regime=regimes, volume=volume
        )
        return restrict(tangent.matrix, subspace)

    K = form(edge.regime)
    elastic = _form_fraction(K)
    sliding = _form_fraction(
        form(np.where(edge.at_yield, Regime.SLIDING, edge.regime).astype(np.int8))
    )
    if subspace == "diagonal":
        angle = branches.critical_angles()
        flags = _flags(branches, plane_directions(middles(angle)))
        share = widths(angle) / (2.0 * np.pi)
        parts, error = (flags * share).sum(axis=-1), np.zeros_like(elastic)
        edges: Floats | None = edges_of(angle, flags[0])
    else:
        parts, error = _sampled(branches, K, elastic, scramblings, seed)
        edges = None
    unstable, surely, none, several = parts
    return BranchFraction(
        unstable, surely, none, several, elastic, sliding, error, edges, branches.singular
    )


def _form_fraction(K: Floats) -> Floats:
    """Unstable fraction of a quadratic form, eigenvalues within round-off of zero set to zero."""
    values = symmetric_spectrum(K)
    small = np.abs(values) <= RTOL * operator_norm(K)[..., None]
    return unstable_fraction(np.where(small, 0.0, values))


def _sampled(
    branches: Branches, K: Floats, elastic: Floats, scramblings: int, seed: int
) -> tuple[Floats, Floats]:
    """(4, ...) fractions by quasi-random directions, and the error of the first."""
    # Imported here, since it is slow to load and rarely used.
    from scipy.stats import norm, qmc

    Ks, m = symmetric_part(K), K.shape[-1]
    known = np.isfinite(elastic)
    means = []
    for child in np.random.default_rng(seed).spawn(scramblings):
        points = qmc.Sobol(m, rng=child).random_base2(POINTS_LOG2)
        # Sobol points avoid 1 but not 0, where the normal quantile is infinite.
        directions = unit_directions(norm.ppf(np.maximum(points, 2.0**-64)))
        flags = _flags(branches, directions)
        form = np.einsum("di,...ij,dj->...d", directions, Ks, directions) < 0.0
        flags[:2] -= np.where(known[..., None], form, 0.0)
        means.append(flags.mean(axis=-1))
    mean = np.mean(means, axis=0)
    mean[:2] += np.where(known, elastic, 0.0)
    error = np.std([each[0] for each in means], axis=0, ddof=1) / np.sqrt(scramblings)
    return np.clip(mean, 0.0, 1.0), np.asarray(error)


def _flags(branches: Branches, directions: Floats) -> Floats:
    """(4, ..., D) 1 or 0: W2 < 0 in some solution, in all; no solution; several."""
    answer = branches.solve(directions)
    # NaN, where there is no solution, compares as false.
    least, most = answer.work[..., 0] < 0.0, answer.work[..., 1] < 0.0
    return np.stack([least, most, answer.count == 0, answer.count == 2]).astype(np.float64)
