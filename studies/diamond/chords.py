"""The diamond with contacts added where opposite grains meet (theory note, section 9.3).

An added contact lies along an axis, so that it neither turns nor shears: its force follows from
its gap, and it leaves as it came. The drained stage then has no closed form; it is integrated over
`E1` with the strain `E2` and the shear force `T` as unknowns, restarted at every event.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from patterns.diamond import DiamondParameters as LoopParameters
from patterns.diamond import opposite_gaps
from studies.diamond.drained import AFTER_A
from studies.diamond.operators import operators
from studies.diamond.pieces import Piece, drained_rates_by_strain, normal_and_shear_rates
from studies.diamond.states import States, states_from_strains

Floats = NDArray[np.float64]
Monitor = Callable[[float, Floats], float]
_RTOL, _ATOL = 1e-12, 1e-14
# The dense output is a polynomial of degree 7 over a step: short steps keep it near 1e-12.
_LEAST_STEPS = 40
_MOST_PIECES = 50


@dataclass(frozen=True)
class Mode:
    """Regime of the four contacts (see `States.slip`) and which opposite grains share a contact."""

    slip: float
    chords: tuple[bool, bool]


def touching_pieces(loop: LoopParameters, mode: Mode) -> tuple[list[Piece], list[tuple[str, int]]]:
    """Pieces of the drained stage with added contacts, and what happens at their ends.

    Parameters
    ----------
    loop : patterns.diamond.DiamondParameters
        The diamond.
    mode : Mode
        At A.

    Returns
    -------
    pieces : list of Piece
        Over `E1`.
    ends : list of (str, int)
        Kind of event and the piece at whose end it stands: 'yield', 'unloading',
        'opposite_contact', 'opening' (of an added contact), 'control_limit'.
    """
    E1, last = loop.confinement, min(loop.confinement + AFTER_A, 0.5 * (1.0 + loop.confinement))
    start, pieces, ends = np.array([E1, 0.0]), list[Piece](), list[tuple[str, int]]()
    while E1 < last and len(pieces) < _MOST_PIECES:
        piece, kind, start, after = _next_piece(loop, mode, E1, start, last)
        pieces.append(piece)
        E1, before, mode = piece.end, mode, after
        if kind:
            ends.append((kind, len(pieces) - 1))
        if kind == "control_limit":
            break
        # Where K22 changes its sign in a jump E1 would have to run back: no control by strain.
        stiffness = [_stiffness(loop, one, E1, start) for one in (before, mode)]
        if stiffness[0] * stiffness[1] <= 0.0:
            ends.append(("control_limit", len(pieces) - 1))
            break
    return pieces, ends


def state_of(loop: LoopParameters, mode: Mode, E1: Floats, y: Floats) -> States:
    """States of the drained stage from the unknowns `y (2, n)`: `E2` and `T`.

    Parameters
    ----------
    loop : patterns.diamond.DiamondParameters
        The diamond.
    mode : Mode
        Regime and added contacts.
    E1 : ndarray (n,)
        Axial strains.
    y : ndarray (2, n)
        `E2` and `T`.

    Returns
    -------
    States
    """
    return states_from_strains(
        loop, E1, y[0], y[1], stage="drained", slip=mode.slip, chords=mode.chords
    )


def _next_piece(
    loop: LoopParameters, mode: Mode, E1: float, start: Floats, last: float
) -> tuple[Piece, str, Floats, Mode]:
    """Integrate to the next event: the piece, the event's kind, the unknowns and mode there."""
    watched = _monitors(loop, mode)
    solution = solve_ivp(
        partial(_rates, loop, mode),
        (E1, last),
        start,
        method="DOP853",
        rtol=_RTOL,
        atol=_ATOL,
        max_step=(last - loop.confinement) / _LEAST_STEPS,
        dense_output=True,
        events=[monitor for _, _, monitor in watched],
    )
    dense = solution.sol

    def states(at: Floats) -> States:
        return state_of(loop, mode, at, dense(at))

    piece = Piece(states, E1, float(solution.t[-1]), drained_rates_by_strain, solution.t)
    end = solution.y[:, -1]
    for (kind, after, _), times in zip(watched, solution.t_events, strict=True):
        if times.size:
            slides = kind == "yield"
            return piece, kind, end, replace(after, slip=np.sign(end[1])) if slides else after
    return piece, "", end, mode


def _rates(loop: LoopParameters, mode: Mode, E1: float, y: Floats) -> Floats:
    """Rates of `E2` and `T` under constant `s2`."""
    states = state_of(loop, mode, np.array([E1]), y[:, None])
    rate1, rate2 = drained_rates_by_strain(states, operators(loop, states))
    normal, arc = normal_and_shear_rates(loop, states, rate1, rate2)
    shear = loop.kappa * arc if mode.slip == 0.0 else mode.slip * loop.mu * normal
    return np.array([rate2[0], shear[0]])


def _monitors(loop: LoopParameters, mode: Mode) -> list[tuple[str, Mode, Monitor]]:
    """What may end a piece: kind, mode afterwards, and a function that passes through zero."""
    watched: list[tuple[str, Mode, Monitor]] = []
    if mode.slip == 0.0 and np.isfinite(loop.mu):
        watched.append(("yield", mode, _terminal(partial(_yield_margin, loop), -1.0)))
    if mode.slip != 0.0:
        stuck = replace(mode, slip=0.0)
        watched.append(("unloading", stuck, _terminal(partial(_slip_rate, loop, mode), -1.0)))
    for axis, closed in enumerate(mode.chords):
        chords = (not closed, mode.chords[1]) if axis == 0 else (mode.chords[0], not closed)
        kind = "opening" if closed else "opposite_contact"
        gap = _terminal(partial(_gap, loop, axis), 1.0 if closed else -1.0)
        watched.append((kind, replace(mode, chords=chords), gap))
    stiffness = _terminal(partial(_stiffness, loop, mode), 0.0)
    return [*watched, ("control_limit", mode, stiffness)]


def _terminal(monitor: Monitor, direction: float) -> Monitor:
    """Mark a monitor as scipy wants it: it ends the integration; 0 takes either direction."""

    def marked(E1: float, y: Floats) -> float:
        return monitor(E1, y)

    marked.terminal, marked.direction = True, direction  # type: ignore[attr-defined]
    return marked


def _yield_margin(loop: LoopParameters, E1: float, y: Floats) -> float:
    N = states_from_strains(loop, E1, y[0]).N[0]
    return float(loop.mu * N - abs(y[1]))


def _slip_rate(loop: LoopParameters, mode: Mode, E1: float, y: Floats) -> float:
    """Slip along T: negative where Coulomb's law lets the contacts stick again."""
    states = state_of(loop, mode, np.array([E1]), y[:, None])
    rates = drained_rates_by_strain(states, operators(loop, states))
    normal, arc = normal_and_shear_rates(loop, states, *rates)
    return float(mode.slip * loop.kappa * arc[0] - loop.mu * normal[0])


def _gap(loop: LoopParameters, axis: int, E1: float, y: Floats) -> float:
    return float(opposite_gaps(E1, y[0], loop.alpha0)[axis])


def _stiffness(loop: LoopParameters, mode: Mode, E1: float, y: Floats) -> float:
    """K22: where it vanishes, `E1` no longer controls the path."""
    states = state_of(loop, mode, np.array([E1]), y[:, None])
    return float(operators(loop, states).K[0, 1, 1])
