"""Loops in their packing with contacts near their strength sliding, and by agreeing regimes.

Contacts from a share of their strength on may slide: the candidates. With all of them sliding a
loop has one operator, `A_in`. Which of them slide depends on its strain `h` though, and on all the
others. `K` has them all sticking, `S = K^-1 P` are the motions of a unit of slip, `G` the rates at
which candidates leave their friction limit, `M = 1 + G S`. A loop of area `V` has the loads `B`,
`U = K^-1 B` and `A = V (B^T U)^-1`; theory, equation (11.25):

    w = -G U A h + (M - G U A B^T S / V) z,    P = A (h + B^T S z / V),    W2 = h . P

with `w, z >= 0` and `w . z = 0`. If all slide, `P = A_in h`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import sparse

from loops.arrays import Flags, Floats, Integers
from loops.assembly import contact_regime
from loops.in_place import LoopsInPlace, Method, loop_loads, loops_in_place, polygons_of
from loops.laws import Regime
from loops.scene import Scene, Subject, scene_of
from loops.shown import Shown
from loops.system import Changed, Factor, System, in_freedoms
from stability.complementarity import SIGN, solve_from
from stability.packing.yielding import (
    YieldResponse,
    condensed,
    linear_answer,
    slip_motion,
    yield_response,
)
from stability.spectra import restrict, subspace_basis, symmetric_modes

# Candidates times freedoms beyond which no regimes are sought (160 MB, half a minute of time).
MOST_ENTRIES = 2e7
# Directions that a descent visits at most.
VISITED = 12
# A descent ends where the work falls by less than this share.
FALLS = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class LoopsAtYield(Shown):
    """Loops in their packing, contacts from a share of their strength on sliding.

    Attributes
    ----------
    band : float
        The share of its strength from which a contact is a candidate.
    place : LoopsInPlace
        Operators of the loops with all candidates sliding, whatever the strain.
    unstable : (L,) array of bool
        Loops with a negative eigenvalue in the symmetric subspace, beyond its error.
    yielding : YieldResponse
        The candidates, contacts with walls included.
    softening : int or None
        Candidates that slip drives on (`M_cc <= 0`): with any, regimes agree in next to no
        direction, and the state has no rates. None where candidates are too many to look.
    direction : (L, 3) array
        Unit strain (11, 22, (12 + 21)/sqrt 2) in which an unstable loop does negative work with
        regimes of all candidates that agree. Not numbers where the descent found none.
    work : (L,) array
        Second-order work in that direction (force per length).
    sliding : (L, m) array of bool
        Candidates that slide there.
    """

    band: float
    place: LoopsInPlace
    unstable: Flags
    yielding: YieldResponse
    softening: int | None
    direction: Floats
    work: Floats
    sliding: Flags

    @property
    def confirmed(self) -> Flags:
        """(L,) unstable loops with a direction of negative work whose regimes agree."""
        return np.isfinite(self.work)


def loops_at_yield(subject: Subject, band: float, *, method: Method = "auto") -> LoopsAtYield:
    """Judge the loops of a packing at rest with the contacts near their strength sliding.

    Contacts are taken by their forces, whatever regimes the graph has. Along the softest mode of an
    unstable loop, and from there towards softer directions, regimes of all candidates are sought
    that agree with their rates: Theory, equation (11.25). A loop for which none are found may have
    some. The state has to be at rest: see `hold`.

    Parameters
    ----------
    subject : Scene or Snapshot
        The packing, one state.
    band : float
        Share of its strength from which a contact is a candidate for sliding, in (0, 1].
    method : {'auto', 'whole', 'blocks'}
        As in `loops_in_place`, for the operators.

    Returns
    -------
    LoopsAtYield

    Raises
    ------
    InputError
        If the packing floats, or the band is no such share.
    """
    scene = scene_of(subject)
    yielding = candidates(scene, band)
    every = np.ones(len(yielding.rows), dtype=bool)
    place = loops_in_place(with_sliding(scene, yielding, every), scene.faces, method=method)
    values, vectors = symmetric_modes(restrict(place.matrix, "symmetric"))
    unstable = values[:, 0] < -place.matrix_error
    count = len(unstable)
    direction, work = np.full((count, 3), np.nan), np.full(count, np.nan)
    sliding, softening = np.zeros((count, len(every)), dtype=bool), None
    if len(every) * yielding.system.size <= MOST_ENTRIES:
        slips = _Slips.of(yielding)
        softening = int(np.count_nonzero(np.diag(slips.matrix) <= 0))
    for grains, bounds, area, rows in polygons_of(scene.graph, scene.faces).groups:
        for k in np.flatnonzero(unstable[rows]) if softening == 0 else ():
            loop, row = slips.of_loop(grains[k], bounds[k], area[k]), rows[k]
            for end in (vectors[row, :, 0], -vectors[row, :, 0]):
                found = loop.descent(end)
                if found is not None and not found[1] >= work[row]:
                    direction[row], work[row], sliding[row] = found
    return LoopsAtYield(band, place, unstable, yielding, softening, direction, work, sliding)


def loops_stuck(subject: Subject, *, method: Method = "auto") -> LoopsInPlace:
    """Operators of the loops in place with every contact sticking that has a shear force.

    Parameters
    ----------
    subject, method
        As in `loops_at_yield`.

    Returns
    -------
    LoopsInPlace
    """
    scene = scene_of(subject)
    yielding = candidates(scene, 1.0)
    none = np.zeros(len(yielding.rows), dtype=bool)
    return loops_in_place(with_sliding(scene, yielding, none), scene.faces, method=method)


def candidates(scene: Scene, band: float) -> YieldResponse:
    """Contacts from a share of their strength on, by their forces alone."""
    state, law, boundary = scene.contact_state, scene.law, scene.boundary
    known = contact_regime(state, law)
    graph = scene.graph.replace(regime=np.where(known == Regime.SLIDING, law.regime(state), known))
    # No stress is asked for.
    boundary = replace(boundary, volume=1.0)
    if boundary.walls is not None:
        boundary = replace(boundary, walls=replace(boundary.walls, sliding=None))
    return yield_response(Scene(graph, law, boundary), yield_band=band)


def with_sliding(scene: Scene, yielding: YieldResponse, sliding: Flags) -> Scene:
    """Return the scene with these candidates sliding and the others sticking."""
    system, boundary = yielding.system, scene.boundary
    regimes, count = system.regime.copy(), len(system.contacts)
    regimes[yielding.rows[sliding]] = Regime.SLIDING
    regime = contact_regime(system.state, scene.law).copy()
    regime[system.contacts] = regimes[:count]
    if boundary.walls is not None:
        slides = np.zeros(len(boundary.walls.grain), dtype=bool)
        slides[system.carrying.grains[boundary.walls.grain]] = regimes[count:] == Regime.SLIDING
        boundary = replace(boundary, walls=replace(boundary.walls, sliding=slides))
    return Scene(scene.graph.replace(regime=regime), scene.law, boundary)


class _Slips(NamedTuple):
    """Candidates of a packing: their motions `S` per unit of slip, rates `G` and matrix `M`."""

    system: System
    factor: Factor | Changed
    motion: Floats
    gauge: sparse.csr_array
    matrix: Floats

    @classmethod
    def of(cls, yielding: YieldResponse) -> _Slips:
        """Solve for a unit of slip of each candidate, all of them sticking."""
        none, every = np.zeros(len(yielding.rows), dtype=bool), np.arange(len(yielding.rows))
        answer = linear_answer(yielding, none)
        motion, _ = slip_motion(yielding, answer, every)
        gauge = in_freedoms(yielding.system, yielding.rows, yielding.gauge)
        matrix, _ = condensed(yielding, none, answer, every, motion)
        return cls(yielding.system, answer.factor, motion, gauge, matrix)

    def of_loop(self, grains: Integers, bounds: Floats, area: float) -> _LoopSlips:
        """Return the slips under the strain of one loop."""
        loads = loop_loads(self.system, grains, bounds)
        under = self.factor.solve(loads)
        operator, strain = np.linalg.inv(loads.T @ under / area), loads.T @ self.motion / area
        rates, basis = -(self.gauge @ under) @ operator, subspace_basis("symmetric")
        return _LoopSlips(
            rates @ basis.T,
            self.matrix + rates @ strain,
            basis @ operator @ basis.T,
            basis @ operator @ strain,
        )


class _LoopSlips(NamedTuple):
    """Rates `w = Q h + M z` of the candidates and stress `P = A h + Z z` of a loop's strain `h`."""

    Q: Floats
    M: Floats
    A: Floats
    Z: Floats

    def descent(self, start: Floats) -> tuple[Floats, float, Flags] | None:
        """Least work met from a direction on: where, how much, who slides; None if not negative.

        The descent goes on to the softest direction of the tangent in the regimes found.
        """
        found, least = None, -SIGN * float(np.linalg.norm(self.A))
        h, work, sliding = start, np.inf, np.zeros(len(self.M), dtype=bool)
        for _ in range(VISITED):
            agreeing = solve_from(self.Q @ h, self.M, sliding) if len(sliding) else sliding
            if agreeing is None:
                break
            sliding, before = agreeing, work
            slips = np.linalg.solve(self.M[np.ix_(sliding, sliding)], self.Q[sliding])
            tangent = self.A - self.Z[:, sliding] @ slips
            work = float(h @ tangent @ h)
            if work < least:
                found, least = (h, work, sliding), work
            if work > before - FALLS * abs(work):
                break
            softest = symmetric_modes(tangent)[1][:, 0]
            h = softest if softest @ h >= 0 else -softest
        return found
