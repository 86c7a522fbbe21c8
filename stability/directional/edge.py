"""Contacts whose regime the direction of loading decides, and what decides it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops import ContactState, GrainGraph, LinearFrictional, Regime, contact_state
from loops.laws.protocol import Regimes

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

# A contact within this fraction of mu N of yield counts as at yield: paths stop at it to 1e-12.
YIELD_BAND = 1e-10
# Gaps within this fraction of r_i + r_j are touching: the rounding of coordinates.
TOUCH_BAND = 1e-12
# Rates this small against the largest of their direction decide nothing.
SIGN_TOLERANCE = 1e-10


@dataclass(frozen=True, eq=False)
class EdgeContacts:
    """Contacts at the edge of their law, batch axes `...` first.

    Attributes
    ----------
    state : ContactState
        All contacts.
    regime : (..., C) array of int8
        Regime of every contact, those at the edge elastic: the branch on which nothing slides and
        touching contacts stick.
    at_yield : (..., C) array of bool
        `|T| = mu N`: elastic or sliding by direction.
    touching : (..., C) array of bool
        Just in contact without force: open, or closed and then elastic or sliding to either side.
    side : (..., C) array
        Sign of `T` at yield, else 0.
    kn, kt, mu : (..., C) array
        Parameters of the law; `mu` infinite where nothing slides.
    """

    state: ContactState
    regime: Regimes
    at_yield: Mask
    touching: Mask
    side: Floats
    kn: Floats
    kt: Floats
    mu: Floats

    @property
    def anywhere(self) -> NDArray[np.int64]:
        """Contacts at the edge in some state of the batch."""
        edge = self.at_yield | self.touching
        return np.flatnonzero(edge.reshape(-1, edge.shape[-1]).any(axis=0))


def edge_contacts(
    graph: GrainGraph, law: LinearFrictional, regime: ArrayLike | None = None
) -> EdgeContacts:
    """Find the contacts at the edge of their law.

    At yield is a closed contact with `|T| >= mu N (1 - 1e-10)`, or one that is flagged sliding;
    touching one without force and without gap, unless it is flagged open. Frictionless contacts
    slide both ways and are no question.

    Parameters
    ----------
    graph : GrainGraph
        Batch axes `...` allowed.
    law : LinearFrictional
        Contact law.
    regime : (..., C) array of Regime, optional
        Flags of a DEM code; read from the state if left out.

    Returns
    -------
    EdgeContacts

    Examples
    --------
    >>> pair = GrainGraph(x=[[0, 0], [0.9, 0]], radii=[0.5, 0.5], contacts=[[0, 1]],
    ...                   normal_force=[0.1], shear_force=[-0.05])
    >>> edge = edge_contacts(pair, LinearFrictional(kn=1.0, kt=0.5, mu=0.5))
    >>> edge.at_yield.tolist(), edge.side.tolist(), edge.regime.tolist()
    ([True], [-1.0], [1])
    """
    state = contact_state(graph)
    read = law.regime(state) if regime is None else np.asarray(regime, dtype=np.int8)
    shape = np.broadcast_shapes(
        state.length.shape, state.normal_force.shape, state.shear_force.shape, read.shape,
        law.kn.shape, law.kt.shape, law.mu.shape,
    )  # fmt: skip
    read = np.broadcast_to(read, shape)
    kn, kt, mu = (np.broadcast_to(a, shape) for a in (law.kn, law.kt, law.mu))
    N, T = (np.broadcast_to(a, shape) for a in (state.normal_force, state.shear_force))
    closed, frictional = read != Regime.OPEN, (mu > 0.0) & np.isfinite(mu)
    limit = np.where(frictional, mu, 0.0) * N
    yields = (np.abs(T) >= limit * (1.0 - YIELD_BAND)) & (N > 0.0)
    at_yield = closed & frictional & (T != 0.0) & (yields | (read == Regime.SLIDING))
    gap = np.abs(state.length - state.touching_length)
    touching = closed & (N <= 0.0) & (T == 0.0) & (gap <= TOUCH_BAND * state.touching_length)
    base = np.where(at_yield | touching, Regime.ELASTIC, read).astype(np.int8)
    side = np.where(at_yield, np.sign(T), 0.0)
    return EdgeContacts(state, base, at_yield, touching, side, kn, kt, mu)


def unit_directions(directions: Floats) -> Floats:
    """Directions divided by their length, without overflow."""
    size = np.abs(directions).max(axis=-1, keepdims=True)
    scaled = directions / size
    return np.asarray(scaled / np.linalg.norm(scaled, axis=-1, keepdims=True))
