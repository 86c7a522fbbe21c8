"""Events of a diamond's path: exact under isotropic strain, roots on the exact path beyond A."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from patterns.diamond import DiamondParameters as LoopParameters
from patterns.diamond import opposite_gaps
from patterns.diamond.geometry import opposite_contact_strain
from studies.diamond.operators import Operators, operators
from studies.diamond.pieces import Piece, grid
from studies.diamond.states import States

Floats = NDArray[np.float64]
# What happens first among events of one state: a contact made changes the operator, det Ks
# vanishes no later than det K (Bromwich), and the regime or the programme changes last.
KINDS = (
    "opposite_contact",
    "det_Ks_zero",
    "det_K_zero",
    "programme_change",
    "yield",
    "unloading",
    "opening",
    "control_limit",
)
# Grains that touch in the reference, but for the rounding of the angle.
ROUNDING = 4.0 * np.finfo(np.float64).eps


class Event(NamedTuple):
    """Something that happens on the path.

    Attributes
    ----------
    kind : str
        'opposite_contact': opposite grains meet. 'det_Ks_zero', 'det_K_zero'.
        'programme_change': A, from isotropic strain to the drained biaxial test. 'yield': B, all
        four contacts reach `|T| = mu N`. 'unloading': sliding contacts stick again. 'opening':
        contacts lose their force. 'control_limit': E1 cannot grow on.
    row : int
        Row of the path: the state as the path arrives there, before anything changes.
    """

    kind: str
    row: int


def touching_strains(loop: LoopParameters) -> tuple[float, float]:
    """Strains E1 and E2 at which the opposite grains on axis 1, and on axis 2, meet.

    Parameters
    ----------
    loop : patterns.diamond.DiamondParameters
        The diamond.

    Returns
    -------
    E1, E2 : float
        `1 - l0/L10` and `1 - l0/L20`; negative where the grains overlap from the start.

    Examples
    --------
    >>> from patterns.diamond import TABLE_2
    >>> from studies.diamond.events import touching_strains
    >>> [round(E, 6) for E in touching_strains(TABLE_2)]
    [0.389613, 0.128277]
    """
    on1, on2 = (1.0 - 0.5 / length for length in (np.cos(loop.alpha0), np.sin(loop.alpha0)))
    first = float(opposite_contact_strain(loop.alpha0))
    # At 45 degrees both pairs meet at once, whatever the rounding of sine and cosine.
    on1, on2 = (first if abs(E - first) <= ROUNDING else float(E) for E in (on1, on2))
    return tuple(0.0 if abs(E) <= ROUNDING else E for E in (on1, on2))  # type: ignore[return-value]


def crossings(
    loop: LoopParameters, piece: Piece, kinds: tuple[str, ...] = KINDS
) -> list[tuple[float, str]]:
    """Parameters within a piece where a determinant vanishes or opposite grains meet.

    Sign changes between the rows of the piece's even grid, refined to round-off.

    Parameters
    ----------
    loop : patterns.diamond.DiamondParameters
        The diamond.
    piece : Piece
        The piece.
    kinds : tuple of str
        Kinds to look for.

    Returns
    -------
    list of (float, str)
        Parameter and kind, in path order.
    """
    rows = grid(piece)
    states = piece.states(rows)
    values = _monitored(loop, states, operators(loop, states))
    found = []
    for column, (kind, falling) in enumerate(_WATCHED):
        if kind not in kinds:
            continue
        before, after = values[:-1, column], values[1:, column]
        passes = (before > 0.0) & (after <= 0.0)
        if not falling:
            passes |= (before < 0.0) & (after >= 0.0)
        for k in np.flatnonzero(passes):
            root = brentq(_along(loop, piece, column), rows[k], rows[k + 1], xtol=1e-16, rtol=1e-15)
            found.append((float(root), kind))
    # Backwards where the parameter falls: in the order of the path either way.
    sense = 1.0 if piece.end >= piece.start else -1.0
    return sorted(found, key=lambda item: (sense * item[0], KINDS.index(item[1])))


def event_values(loop: LoopParameters, states: States, row: int) -> dict[str, float]:
    """State and determinants at an event.

    Parameters
    ----------
    loop : patterns.diamond.DiamondParameters
        The diamond.
    states : States
        States of the path.
    row : int
        Which.

    Returns
    -------
    dict
        `E1, E2, alpha_deg, s1, s2, N, T, det_K, det_Ks`; forces over `kn l0`, stresses over `kn`.
    """
    here = states.take([row])
    found = operators(loop, here)
    values: dict[str, Any] = {
        "E1": here.E1,
        "E2": here.E2,
        "alpha_deg": np.degrees(here.alpha),
        "s1": here.s1,
        "s2": here.s2,
        "N": here.N,
        "T": here.T,
        "det_K": found.det_K,
        "det_Ks": found.det_Ks,
    }
    return {name: float(value[0]) for name, value in values.items()}


# Columns of what is watched, and whether only the passage from above counts.
_WATCHED = (
    ("opposite_contact", True),
    ("opposite_contact", True),
    ("det_Ks_zero", False),
    ("det_K_zero", False),
)


def _monitored(loop: LoopParameters, states: States, found: Operators) -> Floats:
    gaps = opposite_gaps(states.E1, states.E2, loop.alpha0)
    return np.stack([*gaps, found.det_Ks, found.det_K], axis=-1)


def _along(loop: LoopParameters, piece: Piece, column: int) -> Callable[[float], float]:
    def value(at: float) -> float:
        states = piece.states(np.array([at]))
        return float(_monitored(loop, states, operators(loop, states))[0, column])

    return value
