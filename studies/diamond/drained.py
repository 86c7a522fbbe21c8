"""The drained biaxial stage by the exact solution: elastic, then sliding by either rule."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from loops import InputError
from patterns.diamond import DiamondParameters as LoopParameters
from patterns.diamond import DrainedPath, drained_path, drained_states_after_turn
from studies.diamond.operators import operators
from studies.diamond.parameters import Sliding
from studies.diamond.pieces import Piece, drained_rates_by_turn
from studies.diamond.states import States, states_from_strains

Floats = NDArray[np.float64]
# Strain followed after A, and at least after B.
AFTER_A, AFTER_B = 0.3, 0.15
_BISECTIONS = 200


def drained_pieces(
    loop: LoopParameters, sliding: Sliding
) -> tuple[list[Piece], list[tuple[str, int]]]:
    """Pieces of the drained stage, and what happens at their ends.

    Parameters
    ----------
    loop : patterns.diamond.DiamondParameters
        The diamond.
    sliding : {'coulomb', 'printed'}
        Rule of sliding contacts.

    Returns
    -------
    pieces : list of Piece
        Over the turn of the branch, radians: elastic; sliding; stuck again if alpha falls.
    ends : list of (str, int)
        Kind of event and the piece at whose end it stands: 'opening', 'control_limit', 'yield',
        'unloading'.
    """
    path = drained_path(loop)
    if path.status == "opening":
        return [_piece(path, "coulomb", 0.0, 0.0, 0.0)], [("opening", 0)]
    last = _last_turn(path, sliding)
    stop = float(path.end.turn)
    if not np.isfinite(stop) or abs(stop) > abs(last):
        return [_piece(path, "coulomb", 0.0, 0.0, last)], []
    elastic = _piece(path, "coulomb", 0.0, 0.0, stop)
    if path.status == "limit":
        return [elastic], [("control_limit", 0)]
    if _snaps_back(path, sliding):
        return [elastic], [("yield", 0), ("control_limit", 0)]
    return _beyond_yield(path, sliding, elastic, last)


def slip_sign(path: DrainedPath, sliding: Sliding) -> float:
    """What multiplies `mu N'` in `T'` beyond B.

    Coulomb's law takes `sign(T)`, the direction of the turn. (8c) as printed takes
    `zeta_n zeta_t`: where alpha grows N falls, so that both signs differ and T grows; where it
    falls N grows and the two rules agree.

    Parameters
    ----------
    path : patterns.diamond.DrainedPath
        From `drained_path`.
    sliding : {'coulomb', 'printed'}
        Rule of sliding contacts.

    Returns
    -------
    float
    """
    return -1.0 if sliding == "printed" else float(path.direction)


def sliding_states(path: DrainedPath, sliding: Sliding, turn: Floats) -> States:
    """States beyond B by either rule; both are algebraic under constant `s2`.

    With `T = T_B + s mu (N - N_B)` balance (12b) gives
    `N (sin a - s mu cos a) = f + (T_B - s mu N_B) cos a`, `f = F2/(2 kn l0)`.

    Parameters
    ----------
    path : patterns.diamond.DrainedPath
        Path that yields.
    sliding : {'coulomb', 'printed'}
        Rule of sliding contacts.
    turn : ndarray (n,)
        Turns of the branch since A, radians.

    Returns
    -------
    States

    Examples
    --------
    >>> from patterns.diamond import TABLE_1, drained_path
    >>> from studies.diamond.drained import sliding_states
    >>> path = drained_path(TABLE_1)
    >>> turn = path.end.turn + np.array([0.0, 0.2])
    >>> for rule in ("coulomb", "printed"):
    ...     states = sliding_states(path, rule, turn)
    ...     print((states.T / states.N / TABLE_1.mu).round(3).tolist())
    [1.0, 1.0]
    [1.0, 1.272]
    """
    s = slip_sign(path, sliding)
    if s == path.direction:
        return _exact_states(path, s, turn)
    p, B = path.parameters, path.end
    alpha, f = p.alpha0 + turn, p.confinement * np.sin(p.alpha0)
    held = float(B.T - s * p.mu * B.N)
    N = (f + held * np.cos(alpha)) / (np.sin(alpha) - s * p.mu * np.cos(alpha))
    E1 = 1.0 - (1.0 - N) * np.cos(alpha) / np.cos(p.alpha0)
    E2 = 1.0 - (1.0 - N) * np.sin(alpha) / np.sin(p.alpha0)
    return states_from_strains(p, E1, E2, held + s * p.mu * N, stage="drained", slip=s)


def _piece(path: DrainedPath, sliding: Sliding, slip: float, start: float, end: float) -> Piece:
    states: Callable[[Floats], States] = partial(_exact_states, path, slip)
    if slip != 0.0:
        states = partial(sliding_states, path, sliding)
    return Piece(states, start, end, drained_rates_by_turn)


def _exact_states(path: DrainedPath, slip: float, turn: Floats) -> States:
    found, _ = drained_states_after_turn(path, turn)
    return States(
        stage=np.full(found.E1.shape, "drained"),
        slip=np.full(found.E1.shape, slip),
        chords=np.zeros((found.E1.size, 2), dtype=bool),
        E1=found.E1,
        E2=found.E2,
        length=found.length,
        alpha=found.alpha,
        N=found.N,
        T=found.T,
        s1=found.s1,
        s2=found.s2,
    )


def _beyond_yield(
    path: DrainedPath, sliding: Sliding, elastic: Piece, last: float
) -> tuple[list[Piece], list[tuple[str, int]]]:
    slip, stick = slip_sign(path, sliding), path.stick_angle - path.parameters.alpha0
    if np.isfinite(stick) and abs(stick) < abs(last):
        sliding_piece = _piece(path, sliding, slip, elastic.end, stick)
        stuck = _piece(path, "coulomb", 0.0, stick, last)
        return [elastic, sliding_piece, stuck], [("yield", 0), ("unloading", 1)]
    return [elastic, _piece(path, sliding, slip, elastic.end, last)], [("yield", 0)]


def _snaps_back(path: DrainedPath, sliding: Sliding) -> bool:
    """Whether `E1` would have to fall as the contacts start to slide."""
    if slip_sign(path, sliding) == path.direction:
        return path.snaps_back
    states = sliding_states(path, sliding, np.atleast_1d(path.end.turn))
    rate, _ = drained_rates_by_turn(states, operators(path.parameters, states))
    return bool(path.direction * rate[0] < 0.0)


def _last_turn(path: DrainedPath, sliding: Sliding) -> float:
    """Turn at which the followed strain is used up; `E1` grows with the turn up to there."""
    p, at_B = path.parameters, float(path.end.E1)
    latest = at_B if path.status == "yield" else p.confinement
    goal = min(max(p.confinement + AFTER_A, latest + AFTER_B), 0.5 * (1.0 + latest))
    low, high = 0.0, (0.5 * np.pi if path.direction > 0 else 0.0) - p.alpha0
    if path.status == "limit":
        high = float(path.end.turn)
        if not _passed(path, sliding, high, goal):
            return high
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if _passed(path, sliding, middle, goal) else (middle, high)
    return low


def _passed(path: DrainedPath, sliding: Sliding, turn: float, goal: float) -> bool:
    """Whether `E1` has passed the goal, or the centres of the grains have met before."""
    beyond = path.status == "yield" and abs(turn) > abs(float(path.end.turn))
    try:
        if beyond:
            states = sliding_states(path, sliding, np.atleast_1d(turn))
        else:
            states = _exact_states(path, 0.0, np.atleast_1d(turn))
    except InputError:
        return True
    return bool(states.E1[0] > goal)
