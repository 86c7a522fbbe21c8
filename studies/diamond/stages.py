"""The programme stage by stage: its pieces and what happens in them and at their ends."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from patterns.diamond import DiamondParameters as LoopParameters
from patterns.diamond import critical_strain
from studies.diamond.chords import Mode, touching_pieces
from studies.diamond.drained import drained_pieces
from studies.diamond.events import KINDS, crossings, touching_strains
from studies.diamond.parameters import DiamondParameters, OnTouch
from studies.diamond.pieces import Piece, isotropic_rates
from studies.diamond.states import States, isotropic_states

Floats = NDArray[np.float64]
DETERMINANTS = ("det_Ks_zero", "det_K_zero")


@dataclass(frozen=True, eq=False)
class Stretch:
    """A piece and its events, (parameter, kind) in path order; those of its end come last."""

    piece: Piece
    events: list[tuple[float, str]]


def stretches(parameters: DiamondParameters) -> list[Stretch]:
    """The whole programme: isotropic strain to A, then the drained biaxial test.

    Parameters
    ----------
    parameters : DiamondParameters
        What is asked.

    Returns
    -------
    list of Stretch

    Examples
    --------
    >>> from studies.diamond import DiamondParameters
    >>> from studies.diamond.stages import stretches
    >>> [[kind for _, kind in stretch.events] for stretch in stretches(DiamondParameters(table=1))]
    ... # doctest: +NORMALIZE_WHITESPACE
    [['det_Ks_zero', 'det_K_zero', 'opposite_contact', 'programme_change'], ['yield'], []]
    """
    loop, on_touch = parameters.loop(), parameters.contact_on_touch
    confining = _isotropic(loop, on_touch)
    if confining[-1].events[-1][1] != "programme_change":
        return confining
    return confining + _drained(loop, parameters)


def _isotropic(loop: LoopParameters, on_touch: OnTouch) -> list[Stretch]:
    """Isotropic strain; K is symmetric, so that det Ks and det K vanish together (41)."""
    end, touching = loop.confinement, touching_strains(loop)
    meetings = sorted({E for E in touching if 0.0 <= E <= end})
    if on_touch == "add":
        return _isotropic_with_contacts(loop, touching, meetings)
    closing = (end, "programme_change")
    if on_touch == "stop" and meetings:
        closing = (meetings[0], "opposite_contact")
        end, meetings = meetings[0], []
    events = [*_critical(loop, 0.0, end), *((E, "opposite_contact") for E in meetings)]
    piece = _isotropic_piece(loop, 0.0, end, (False, False))
    return [Stretch(piece, [*sorted(events, key=_order), closing])]


def _isotropic_with_contacts(
    loop: LoopParameters, touching: tuple[float, float], meetings: list[float]
) -> list[Stretch]:
    """The same with a contact added wherever opposite grains meet."""
    starts, ends = [0.0, *meetings], [*meetings, loop.confinement]
    found: list[Stretch] = []
    for start, end in zip(starts, ends, strict=True):
        # The first piece carries none, even if grains touch from the start.
        met = len(found) > 0
        chords = (met and touching[0] <= start, met and touching[1] <= start)
        piece = _isotropic_piece(loop, start, end, chords)
        events = crossings(loop, piece, DETERMINANTS) if any(chords) else _critical(loop, 0.0, end)
        kind = "opposite_contact" if len(found) < len(meetings) else "programme_change"
        found.append(Stretch(piece, [*events, (end, kind)]))
    return found


def _drained(loop: LoopParameters, parameters: DiamondParameters) -> list[Stretch]:
    kinds: tuple[str, ...] = (*DETERMINANTS, "opposite_contact")
    if parameters.contact_on_touch == "add":
        touching = touching_strains(loop)
        met = [0.0 <= E <= loop.confinement for E in touching]
        pieces, ends = touching_pieces(loop, Mode(0.0, (met[0], met[1])))
        kinds = DETERMINANTS
    else:
        pieces, ends = drained_pieces(loop, parameters.sliding)
    found = []
    for number, piece in enumerate(pieces):
        at_end = [(piece.end, kind) for kind, where in ends if where == number]
        found.append(Stretch(piece, [*crossings(loop, piece, kinds), *at_end]))
    return _cut(found) if parameters.contact_on_touch == "stop" else found


def _cut(found: list[Stretch]) -> list[Stretch]:
    """Stretches up to where opposite grains meet."""
    for number, stretch in enumerate(found):
        kinds = [kind for _, kind in stretch.events]
        if "opposite_contact" in kinds:
            events = stretch.events[: kinds.index("opposite_contact") + 1]
            piece = replace(stretch.piece, end=events[-1][0])
            return [*found[:number], Stretch(piece, events)]
    return found


def _isotropic_piece(
    loop: LoopParameters, start: float, end: float, chords: tuple[bool, bool]
) -> Piece:
    def states(E: Floats) -> States:
        return isotropic_states(loop, E, chords)

    return Piece(states, start, end, isotropic_rates)


def _critical(loop: LoopParameters, start: float, end: float) -> list[tuple[float, str]]:
    E = float(critical_strain(loop.kappa))
    return [(E, kind) for kind in DETERMINANTS] if start <= E <= end else []


def _order(event: tuple[float, str]) -> tuple[float, int]:
    return event[0], KINDS.index(event[1])
