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

import numpy as np

from loops.arrays import Flags, Floats, frobenius
from loops.in_place import Method, OfOrder, loop_loads, operators_in_place, polygons_of
from loops.scene import Subject, scene_of
from loops.shown import Shown
from loops.system import in_freedoms
from stability.complementarity import SIGN, solve_from
from stability.packing.response import PackingRates, rate_problem
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
    band : float or None
        The share of its strength from which a contact is a candidate; None: all contacts stick.
    matrix : (L, 4, 4) array
        Operators `A_in` of the loops with all candidates sliding, whatever the strain (force per
        length), as `LoopsInPlace` has them.
    smallest : (L,) array
        Smallest eigenvalues in the symmetric subspace (force per length); not numbers where the
        stated error of `matrix` leaves no sign.
    rates : PackingRates
        The rate problem of the candidates, contacts with walls included.
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

    band: float | None
    matrix: Floats
    smallest: Floats
    rates: PackingRates
    softening: int | None
    direction: Floats
    work: Floats
    sliding: Flags

    @property
    def unstable(self) -> Flags:
        """(L,) loops with a negative eigenvalue."""
        return self.smallest < 0

    @property
    def confirmed(self) -> Flags:
        """(L,) unstable loops with a direction of negative work whose regimes agree."""
        return np.isfinite(self.work)


def loops_at_yield(
    subject: Subject, band: float | None, *, method: Method = "auto"
) -> LoopsAtYield:
    """Judge the loops of a packing at rest with the contacts near their strength sliding.

    Contacts are taken by their forces, whatever regimes the graph has. Along the softest mode of an
    unstable loop, and from there towards softer directions, regimes of all candidates are sought
    that agree with their rates: Theory, equation (11.25). A loop for which none are found may have
    some. The state has to be at rest: see `hold`.

    Parameters
    ----------
    subject : Scene or Snapshot
        The packing, one state.
    band : float or None
        Share of its strength from which a contact is a candidate for sliding, in (0, 1]; None lets
        all contacts stick that have a shear force.
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
    # No stress is asked for.
    whole = replace(scene, boundary=replace(scene.boundary, volume=1.0))
    rates = rate_problem(whole, yield_band=1.0 if band is None else band, by_forces=True)
    slides = np.full(len(rates.rows), band is not None)
    system = replace(rates.system, stiffness=rates.stiffness(slides))
    matrix, error = operators_in_place(system, scene.faces, method)
    values, modes = symmetric_modes(restrict(matrix, "symmetric"))
    sure = np.abs(values[:, 0]) > error * frobenius(matrix)
    smallest, count = np.where(sure, values[:, 0], np.nan), len(values)
    direction, work = np.full((count, 3), np.nan), np.full(count, np.nan)
    sliding = np.zeros((count, len(slides)), dtype=bool)
    found = LoopsAtYield(band, matrix, smallest, rates, None, direction, work, sliding)
    if band is None or len(slides) * system.size > MOST_ENTRIES:
        return found
    softening = int(np.count_nonzero(np.diag(rates.whole.of_slip) <= 0))
    for group in polygons_of(scene.graph, scene.faces).groups if not softening else ():
        for k in np.flatnonzero(smallest[group.row] < 0):
            loop, row = loop_slips(rates, group, int(k)), group.row[k]
            for end in (modes[row, :, 0], -modes[row, :, 0]):
                least = descent(*loop, end)
                if least is not None and not least[1] >= work[row]:
                    direction[row], work[row], sliding[row] = least
    return replace(found, softening=softening)


def loop_slips(
    rates: PackingRates, group: OfOrder, k: int
) -> tuple[Floats, Floats, Floats, Floats]:
    """`Q`, `M`, `A`, `Z` of a loop's strain `h` (3,): `w = Q h + M z`, `P = A h + Z z`."""
    system = rates.system
    loads, area = loop_loads(system, group.grains[k], group.vectors[k]), group.area[k]
    under = rates.elastic.solve(loads)
    operator, strain = np.linalg.inv(loads.T @ under / area), loads.T @ rates.whole.motion / area
    push = -(in_freedoms(system, rates.rows, rates.gauge) @ under) @ operator
    basis, M = subspace_basis("symmetric"), rates.whole.of_slip + push @ strain
    return push @ basis.T, M, basis @ operator @ basis.T, basis @ operator @ strain


def descent(
    Q: Floats, M: Floats, A: Floats, Z: Floats, start: Floats
) -> tuple[Floats, float, Flags] | None:
    """Least work met from a direction on: where, how much, who slides; None if not negative.

    The descent goes on to the softest direction of the tangent in the regimes found.
    """
    found, least = None, -SIGN * float(np.linalg.norm(A))
    h, work, sliding = start, np.inf, np.zeros(len(M), dtype=bool)
    for _ in range(VISITED):
        agreeing = solve_from(Q @ h, M, sliding) if len(sliding) else sliding
        if agreeing is None:
            break
        sliding, before = agreeing, work
        tangent = A - Z[:, sliding] @ np.linalg.solve(M[np.ix_(sliding, sliding)], Q[sliding])
        work = float(h @ tangent @ h)
        if work < least:
            found, least = (h, work, sliding), work
        if work > before - FALLS * abs(work):
            break
        softest = symmetric_modes(tangent)[1][:, 0]
        h = softest if softest @ h >= 0 else -softest
    return found
