"""Pieces of a path: smooth stretches between changes of programme, regime or contacts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from patterns.diamond import DiamondParameters as LoopParameters
from patterns.diamond.forces import contact_displacement_rates
from studies.diamond.operators import Operators, operators
from studies.diamond.states import States

Floats = NDArray[np.float64]
Rates = tuple[Floats, Floats]
# Rows of a piece, but for those that events add.
STEPS = 200
# Five Gauss points on each of some 200 intervals: the quadrature's error is below round-off.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)


@dataclass(frozen=True, eq=False)
class Piece:
    """A smooth stretch of a path over a parameter that grows or falls from `start` to `end`.

    Attributes
    ----------
    states : callable
        States (n,) at parameters (n,).
    start, end : float
        Parameters of the ends.
    rates : callable
        Rates `E1', E2'` per unit of the parameter, from states and their operators.
    steps : ndarray (m,)
        Parameters between which quadrature must not lump: an integrator's own steps, short where
        the path changes fast. None on an exact path.
    """

    states: Callable[[Floats], States]
    start: float
    end: float
    rates: Callable[[States, Operators], Rates]
    steps: Floats = field(default_factory=lambda: np.zeros(0))


def isotropic_rates(states: States, found: Operators) -> Rates:
    """Rates of the strains per unit of isotropic strain: both 1."""
    return np.ones_like(states.E1), np.ones_like(states.E2)


def drained_rates_by_strain(states: States, found: Operators) -> Rates:
    """Rates of the strains per unit of `E1` under constant `s2`, `E2' = -K21/K22` (26), (32)."""
    return np.ones_like(states.E1), -found.K[:, 1, 0] / found.K[:, 1, 1]


def drained_rates_by_turn(states: States, found: Operators) -> Rates:
    """Rates of the strains per radian of turn under constant `s2` (26), (32).

    The turn follows from `tan(alpha) = tan(alpha0) (1 - E2)/(1 - E1)`. Written so that K22 may
    vanish: there E1 pauses while the branch turns on.
    """
    K21, K22 = found.K[:, 1, 0], found.K[:, 1, 1]
    turning = K22 / (1.0 - states.E1) + K21 / (1.0 - states.E2)
    scale = 1.0 / (np.cos(states.alpha) * np.sin(states.alpha) * turning)
    return K22 * scale, -K21 * scale


def grid(piece: Piece, events: Sequence[float] = ()) -> Floats:
    """Parameters of a piece's rows: an even grid, every event's own, and no twin beside it.

    Parameters
    ----------
    piece : Piece
        The piece.
    events : sequence of float
        Parameters that must be rows.

    Returns
    -------
    ndarray (n,)
        From start to end.

    Examples
    --------
    >>> from studies.diamond.pieces import Piece, grid, isotropic_rates
    >>> piece = Piece(lambda p: p, 0.0, 2.0, isotropic_rates)
    >>> rows = grid(piece, [0.01 + 1e-12, 0.005])
    >>> len(rows), rows[:4].round(3).tolist()
    (202, [0.0, 0.005, 0.01, 0.02])
    """
    if piece.start == piece.end:
        return np.array([piece.start])
    fixed = np.array([piece.start, piece.end, *events])
    even = np.linspace(piece.start, piece.end, STEPS + 1)
    apart = np.abs(even[:, None] - fixed).min(axis=1) > 1e-3 * abs(even[1] - even[0])
    rows = np.unique(np.concatenate([even[apart], fixed]))
    return rows if piece.end > piece.start else rows[::-1]


def energy_increments(loop: LoopParameters, piece: Piece, rows: Floats) -> tuple[Floats, Floats]:
    """Work from outside and heat of sliding between the rows of a piece, by Gauss quadrature.

    The work takes stresses and the strain rates of (26); the heat takes each contact's slip,
    `T (l alpha' - T'/kt)`. Neither knows of the other.

    Parameters
    ----------
    loop : patterns.diamond.DiamondParameters
        The diamond.
    piece : Piece
        The piece.
    rows : ndarray (n,)
        Its parameters.

    Returns
    -------
    work, heat : ndarray (n - 1,)
        Over `kn` and the reference volume `L10 L20`.
    """
    if rows.size < 2:
        return np.zeros(0), np.zeros(0)
    sense = np.sign(rows[-1] - rows[0])
    bounds = sense * np.unique(sense * np.concatenate([rows, piece.steps]))
    half = 0.5 * np.diff(bounds)
    nodes = (bounds[:-1] + half)[:, None] + half[:, None] * _NODES
    states = piece.states(nodes.ravel())
    rate1, rate2 = piece.rates(states, operators(loop, states))
    power = states.s1 * rate1 + states.s2 * rate2
    heating = _heating(loop, states, rate1, rate2)
    weights = half[:, None] * _WEIGHTS
    first = np.searchsorted(sense * bounds, sense * rows[:-1])
    work, heat = (
        np.add.reduceat(np.sum(weights * rate.reshape(nodes.shape), axis=1), first)
        for rate in (power, heating)
    )
    return work, heat


def stored_energy(loop: LoopParameters, states: States, chords: Floats) -> Floats:
    """Elastic energy of the contacts over `kn` and the reference volume `L10 L20`.

    Parameters
    ----------
    loop : patterns.diamond.DiamondParameters
        The diamond.
    states : States
        Where.
    chords : ndarray (n, 2)
        Forces of the contacts between opposite grains.

    Returns
    -------
    ndarray (n,)
    """
    shear = states.T**2 / (2.0 * loop.kappa) if loop.kappa > 0.0 else 0.0 * states.T
    return (2.0 * states.N**2 + 4.0 * shear + 0.5 * np.sum(chords**2, axis=1)) / _volume(loop)


def normal_and_shear_rates(
    loop: LoopParameters, states: States, rate1: Floats, rate2: Floats
) -> tuple[Floats, Floats]:
    """Rates of `N` and of the arc `l alpha` at the contacts under strain rates (16).

    Parameters
    ----------
    loop : patterns.diamond.DiamondParameters
        The diamond.
    states : States
        Where.
    rate1, rate2 : ndarray (n,)
        Strain rates.

    Returns
    -------
    normal, arc : ndarray (n,)
        `N' = -un'` and `l alpha' = -ut'`.
    """
    shortening1 = 2.0 * np.cos(loop.alpha0) * rate1
    shortening2 = 2.0 * np.sin(loop.alpha0) * rate2
    un, ut = contact_displacement_rates(shortening1, shortening2, states.alpha)
    return -un, -ut


def _heating(loop: LoopParameters, states: States, rate1: Floats, rate2: Floats) -> Floats:
    if loop.kappa == 0.0 or not states.slip.any():
        return np.zeros_like(states.T)
    normal, arc = normal_and_shear_rates(loop, states, rate1, rate2)
    heat = 4.0 * states.T * (arc - states.slip * loop.mu * normal / loop.kappa) / _volume(loop)
    return np.where(states.slip == 0.0, 0.0, heat)


def _volume(loop: LoopParameters) -> float:
    """`L10 L20` over `l0` squared."""
    return float(2.0 * np.sin(2.0 * loop.alpha0))
