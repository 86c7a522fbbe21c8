"""The fraction of directions in which second-order work is negative, with branches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from loops import ContactLaw, GrainGraph, Regime, macroscopic_tangent
from loops.arrays import Floats, Regimes
from loops.closures import Closure, Spins
from stability.arguments import whole_number
from stability.directional.edge import edges_of, middles, plane_directions, unit_directions, widths
from stability.directional.work import Branches, branches_of
from stability.spectra import RTOL, operator_norm, symmetric_part, symmetric_spectrum
from stability.subspaces import restrict
from stability.unstable_fraction import unstable_fraction

# Directions in each scrambled sequence, as a power of two.
POINTS_LOG2 = 10


@dataclass(frozen=True, eq=False)
class BranchFraction:
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
    closure: Closure = "affine",
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
        Of the sequences.

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
    >>> found = branch_fraction(pair, law, volume=1.0)
    >>> np.tan(np.array([2 * found.unstable, found.sliding]) * np.pi).round(9).tolist()
    [0.5, 0.5]
    >>> float(found.elastic), found.edges.round(6).tolist()
    (0.0, [2.356194, 2.819842])
    """
    whole_number("scramblings", scramblings, least=2)
    whole_number("seed", seed, least=0)
    branches, edge = branches_of(graph, law, closure, spins, subspace, regime, volume)

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
        parts, edges, error = *_in_the_plane(branches), np.zeros_like(elastic)
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


def _in_the_plane(branches: Branches) -> tuple[Floats, Floats]:
    """(4, ...) exact fractions and (..., B) edges."""
    angle = branches.critical_angles()
    flags = _flags(branches, plane_directions(middles(angle)))
    share = widths(angle) / (2.0 * np.pi)
    return (flags * share).sum(axis=-1), edges_of(angle, flags[0])


def _sampled(
    branches: Branches, K: Floats, elastic: Floats, scramblings: int, seed: int
) -> tuple[Floats, Floats]:
    """(4, ...) fractions by quasi-random directions, and the error of the first."""
    # Slow to load, and needed for few scenes.
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
    answer = branches.answer(directions)
    # NaN, where there is no solution, compares as false.
    least, most = answer.work[..., 0] < 0.0, answer.work[..., 1] < 0.0
    return np.stack([least, most, answer.count == 0, answer.count == 2]).astype(np.float64)
