"""The path of a diamond: its states, operators, energies and events."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from patterns.diamond import DiamondParameters as LoopParameters
from studies.diamond.events import Event
from studies.diamond.operators import Operators, operators
from studies.diamond.parameters import DiamondParameters
from studies.diamond.pieces import drained_rates_by_strain, energy_increments, grid, stored_energy
from studies.diamond.stages import Stretch, stretches
from studies.diamond.states import States, chord_forces, concatenate

Floats = NDArray[np.float64]
NAMED = {"det_K_zero": "I", "programme_change": "A", "yield": "B"}


@dataclass(frozen=True, eq=False)
class DiamondPath:
    """A diamond followed along its programme.

    Attributes
    ----------
    parameters : DiamondParameters
        What was asked.
    loop : patterns.diamond.DiamondParameters
        The diamond.
    states : States
        States in path order; every event is one of them. Where the programme, the regime or the
        contacts change a state stands twice, before and after.
    operators : Operators
        Tangents there.
    work, stored, dissipated : ndarray (n,)
        Work from outside since the start, elastic energy and heat of sliding, over `kn` and the
        reference volume `L10 L20`.
    events : list of Event
        In path order.
    marks : dict of str to int
        Rows of the named states where reached: 'I' (det K = 0 in the confinement), 'A' (its end)
        and 'B' (yield; the row before the contacts slide).
    """

    parameters: DiamondParameters
    loop: LoopParameters
    states: States
    operators: Operators
    work: Floats
    stored: Floats
    dissipated: Floats
    events: list[Event]
    marks: dict[str, int]


def follow(parameters: DiamondParameters) -> DiamondPath:
    """Follow a diamond through the whole programme: to A, to B, and beyond.

    Parameters
    ----------
    parameters : DiamondParameters
        What is asked.

    Returns
    -------
    DiamondPath

    Examples
    --------
    >>> from studies.diamond import DiamondParameters
    >>> from studies.diamond.path import follow
    >>> path = follow(DiamondParameters(table=1))
    >>> {name: round(float(path.states.E1[row]), 6) for name, row in path.marks.items()}
    {'I': 0.166667, 'A': 0.3, 'B': 0.409734}
    """
    loop, parts = parameters.loop(), stretches(parameters)
    rows = [grid(part.piece, [at for at, _ in part.events]) for part in parts]
    states = concatenate([part.piece.states(at) for part, at in zip(parts, rows, strict=True)])
    events = _events(parts, rows)
    work, dissipated = _energies(loop, parts, rows)
    return DiamondPath(
        parameters=parameters,
        loop=loop,
        states=states,
        operators=operators(loop, states),
        work=work,
        stored=stored_energy(loop, states, chord_forces(loop, states)),
        dissipated=dissipated,
        events=events,
        marks=_marks(events, states),
    )


def beyond_yield(path: DiamondPath) -> States | None:
    """State B with the contacts sliding, as the path goes on; None where it has no B.

    Parameters
    ----------
    path : DiamondPath
        From `follow`.

    Returns
    -------
    States or None
        One state.
    """
    if "B" not in path.marks:
        return None
    row = path.marks["B"]
    at_B = path.states.take([row])
    goes_on = row + 1 < len(path.work) and path.states.slip[row + 1] != 0.0
    slip = path.states.slip[row + 1] if goes_on else np.sign(path.states.T[row])
    return replace(at_B, slip=np.array([slip]))


def loading_rates(path: DiamondPath) -> Floats:
    """Direction of the path in the strain plane at every row, unit vectors `(E1', E2')`.

    Parameters
    ----------
    path : DiamondPath
        From `follow`.

    Returns
    -------
    ndarray (n, 2)
        `E1' > 0` along the programme.
    """
    drained = drained_rates_by_strain(path.states, path.operators)
    isotropic = path.states.stage == "isotropic"
    rates = np.stack([np.ones_like(path.work), np.where(isotropic, 1.0, drained[1])], axis=-1)
    return rates / np.linalg.norm(rates, axis=-1, keepdims=True)


def _events(parts: list[Stretch], rows: list[Floats]) -> list[Event]:
    events, before = [], 0
    for part, at in zip(parts, rows, strict=True):
        events += [
            Event(kind, before + int(np.argmin(np.abs(at - where)))) for where, kind in part.events
        ]
        before += len(at)
    return events


def _energies(
    loop: LoopParameters, parts: list[Stretch], rows: list[Floats]
) -> tuple[Floats, Floats]:
    """Work and heat at every row; a piece starts where the one before it ended."""
    work, heat = [np.zeros(1)], [np.zeros(1)]
    for part, at in zip(parts, rows, strict=True):
        increments = energy_increments(loop, part.piece, at)
        for total, increment in zip((work, heat), increments, strict=True):
            total.append(total[-1][-1] + np.concatenate([[0.0], np.cumsum(increment)]))
    return np.concatenate(work[1:]), np.concatenate(heat[1:])


def _marks(events: list[Event], states: States) -> dict[str, int]:
    marks: dict[str, int] = {}
    for kind, row in events:
        name = NAMED.get(kind)
        if name and name not in marks and (name != "I" or states.stage[row] == "isotropic"):
            marks[name] = row
    return marks
