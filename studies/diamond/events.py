"""Events of the isotropic strain path, in closed form."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from patterns.diamond import DiamondParameters as LoopParameters
from patterns.diamond import critical_strain, opposite_contact_strain
from studies.diamond.parameters import OnTouch
from studies.diamond.states import isotropic_states, operators

# What happens first among events at one strain: a contact made changes the operator, det Ks
# vanishes no later than det K (Bromwich), and the programme changes last.
KINDS = ("opposite_contact", "det_Ks_zero", "det_K_zero", "programme_change")
# Grains that touch in the reference, but for the rounding of the angle.
ROUNDING = 4.0 * np.finfo(np.float64).eps


class Event(NamedTuple):
    """Something that happens at an isotropic strain.

    Attributes
    ----------
    kind : str
        One of 'opposite_contact' (opposite grains meet), 'det_Ks_zero', 'det_K_zero',
        'programme_change' (A: from isotropic strain to the drained biaxial test).
    E : float
        Isotropic strain.
    """

    kind: str
    E: float


def isotropic_events(loop: LoopParameters, on_touch: OnTouch) -> list[Event]:
    """Events of the isotropic strain path up to A, in path order.

    K is symmetric there, so that det Ks and det K vanish together, at `kappa/(1 + kappa)` (41).
    Opposite grains meet at `1 - 1/(2 sin(alpha0))`, or with the cosine beyond 45 degrees (theory
    note section 9).

    Parameters
    ----------
    loop : patterns.diamond.DiamondParameters
        The diamond.
    on_touch : {'ignore', 'stop'}
        Whether the path ends where opposite grains meet.

    Returns
    -------
    list of Event

    Examples
    --------
    >>> from patterns.diamond import TABLE_1
    >>> from studies.diamond.events import isotropic_events
    >>> [(event.kind, round(event.E, 6)) for event in isotropic_events(TABLE_1, "ignore")]
    ... # doctest: +NORMALIZE_WHITESPACE
    [('det_Ks_zero', 0.166667), ('det_K_zero', 0.166667), ('opposite_contact', 0.292893),
     ('programme_change', 0.3)]
    """
    critical = float(critical_strain(loop.kappa))
    events = [
        Event("det_Ks_zero", critical),
        Event("det_K_zero", critical),
        Event("programme_change", loop.confinement),
    ]
    touch = touching_strain(loop)
    if touch >= 0.0:
        events.append(Event("opposite_contact", touch))
    events = sorted(events, key=lambda event: (event.E, KINDS.index(event.kind)))
    reached = [event for event in events if event.E <= loop.confinement]
    met = [k for k, event in enumerate(reached) if event.kind == "opposite_contact"]
    return reached[: met[0] + 1] if met and on_touch == "stop" else reached


def touching_strain(loop: LoopParameters) -> float:
    """Isotropic strain at which opposite grains meet; negative if they overlap from the start.

    Parameters
    ----------
    loop : patterns.diamond.DiamondParameters
        The diamond.

    Returns
    -------
    float
    """
    touch = float(opposite_contact_strain(loop.alpha0))
    return 0.0 if abs(touch) <= ROUNDING else touch


def event_row(loop: LoopParameters, event: Event) -> dict[str, Any]:
    """State and determinants at an event.

    Parameters
    ----------
    loop : patterns.diamond.DiamondParameters
        The diamond.
    event : Event
        From `isotropic_events`.

    Returns
    -------
    dict
        `kind, E1, E2, alpha_deg, s1, s2, N, T, det_K, det_Ks`; forces over `kn l0`, stresses
        over `kn`.
    """
    states = isotropic_states(loop, event.E)
    found = operators(loop, states)
    values = {
        "E1": states.E1,
        "E2": states.E2,
        "alpha_deg": np.degrees(states.alpha),
        "s1": states.s1,
        "s2": states.s2,
        "N": states.N,
        "T": states.T,
        "det_K": found.det_K,
        "det_Ks": found.det_Ks,
    }
    return {"kind": event.kind, **{name: float(value[0]) for name, value in values.items()}}
