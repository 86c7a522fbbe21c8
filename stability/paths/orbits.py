"""Contacts at the edge of their law that take the same regime by symmetry."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stability.paths.model import PathModel
from stability.paths.state import Mode
from stability.rate_problem import Choice

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class EdgeOrbits:
    """Contacts at the edge in orbits: one of each is asked, the others follow.

    Attributes
    ----------
    asked : (m,) array of int
        First contact of every orbit.
    options : tuple of tuple of Choice
        Its regimes.
    contacts : (E,) array of int
        All contacts of these orbits,
    orbit : (E,) array of int
        the orbit of each, and
    sign : (E,) array
        what turns the side of the first into its own.
    """

    asked: Integers
    options: tuple[tuple[Choice, ...], ...]
    contacts: Integers
    orbit: Integers
    sign: Floats

    def applied(self, mode: Mode, choices: Sequence[Choice]) -> Mode:
        """Regimes of all contacts for one choice per orbit."""
        regime, side = mode.regime.copy(), mode.side.copy()
        chosen = np.array([choice.regime for choice in choices], dtype=np.int8)
        chosen_side = np.array([choice.side for choice in choices], dtype=float)
        regime[self.contacts] = chosen[self.orbit]
        side[self.contacts] = chosen_side[self.orbit] * self.sign
        return Mode(regime, side)


def edge_orbits(model: PathModel, options: Mapping[int, tuple[Choice, ...]]) -> EdgeOrbits:
    """Gather contacts at the edge by the model's symmetry; each by itself without one.

    Parameters
    ----------
    model : PathModel
        Constants.
    options : mapping
        Regimes open to every contact at the edge.

    Returns
    -------
    EdgeOrbits
    """
    at_edge = np.array(list(options), dtype=np.int64)
    if model.symmetry is None:
        each = np.arange(len(at_edge))
        return EdgeOrbits(at_edge, tuple(options.values()), at_edge, each, np.ones(len(each)))
    first = model.symmetry.contact_orbits
    # A mirror turns the side; without friction there is none to turn.
    parity = np.where(model.mu > 0, model.symmetry.contact_parity, 1.0)
    allowed: dict[int, tuple[Choice, ...]] = {}
    for c, can in options.items():
        allowed.setdefault(int(first[c]), _carried(can, float(parity[c])))
    asked = np.array(list(allowed), dtype=np.int64)
    contacts = np.flatnonzero(np.isin(first, asked))
    orbit = np.argsort(asked)[np.searchsorted(np.sort(asked), first[contacts])]
    return EdgeOrbits(asked, tuple(allowed.values()), contacts, orbit, parity[contacts])


def asked_first(
    model: PathModel, orbits: EdgeOrbits, preferred: Mapping[int, Choice]
) -> dict[int, Choice]:
    """Preferred choices of any contact of an orbit, as the one that is asked has them."""
    if model.symmetry is None:
        return dict(preferred)
    first: dict[int, Choice] = {}
    for c, k, sign in zip(orbits.contacts, orbits.orbit, orbits.sign, strict=True):
        choice = preferred.get(int(c))
        if choice is not None:
            first.setdefault(int(orbits.asked[k]), Choice(choice.regime, sign * choice.side))
    return first


def _carried(can: tuple[Choice, ...], parity: float) -> tuple[Choice, ...]:
    """Options as the first contact of the orbit has them; on a mirror nothing slides."""
    return tuple(
        Choice(each.regime, parity * each.side) for each in can if each.side == 0.0 or parity != 0.0
    )
