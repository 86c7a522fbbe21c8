"""Rates of every loop of a packing under the response of the packing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loops.arrays import Flags, Floats
from loops.faces import Faces
from loops.geometry import boundary_vectors, polygon_area
from loops.graph import GrainGraph, branch_vectors, contact_state
from loops.loop_batches import LoopBatch, loop_batches
from loops.shown import Shown
from loops.stress_strain import contact_forces
from stability.packing.response import PackingResponse
from stability.packing.state import PackingState

QUARTER_TURN: Floats = np.array([[0.0, -1.0], [1.0, 0.0]])


@dataclass(frozen=True, eq=False, repr=False)
class LoopRates(Shown):
    """Rates of the loops of a packing, in the order of `Faces.loops`.

    Where a loop has a contact that carries nothing its rates are not numbers.

    Attributes
    ----------
    strain : (L, 2, 2) array
        Displacement gradient `H'` of the polygon from the branch rates (boundary formula).
    stress : (L, 2, 2) array
        Nominal stress rate `P' = (1/(2 V)) sum f' (x) d`, contacts shared with the neighbours.
    second_order_work : (L,) array
        `W2 = (P' - theta' J P) : sym H'`, in the frame that turns with the loop.
    normalised_work : (L,) array
        The same over the norms of its two factors.
    additive_work : (L,) array
        `w = -(1/(2 V)) sum f'.d'`: areas times `w` sum to the sample's `V P':H'`.
    nonaffinity : (L,) array
        `|sym H'_loop - sym H'| / |sym H'|`.
    opening, closing : (L,) array
        Time until the first contact has lost its force, and until the first gap across the loop has
        closed, in the unit of time of `H'`; infinite if none does.
    area : (L,) array
        Areas of the polygons.
    """

    strain: Floats
    stress: Floats
    second_order_work: Floats
    normalised_work: Floats
    additive_work: Floats
    nonaffinity: Floats
    opening: Floats
    closing: Floats
    area: Floats


def loop_rates(response: PackingResponse, faces: Faces) -> LoopRates:
    """Read the loops' rates from the packing's: Theory, equations (11.3) and (11.4).

    Parameters
    ----------
    response : PackingResponse
        From `packing_response`.
    faces : Faces
        Faces of the same graph.

    Returns
    -------
    LoopRates
    """
    graph = response.system.graph
    carries = np.zeros(graph.contact_count, dtype=bool)
    carries[response.system.contacts] = True
    rates = response.strain_rate, response.branch_rate, response.force_rate
    return _of_all(_Parts(graph, carries, *rates), faces)


def loop_changes(before: GrainGraph, after: PackingState, faces: Faces) -> LoopRates:
    """Changes of every loop up to a later state, as rates over a unit of time.

    Parameters
    ----------
    before : GrainGraph
        The packing at the start.
    after : PackingState
        Of the same packing, from `replay` or `follow`.
    faces : Faces
        Faces of the start.

    Returns
    -------
    LoopRates
        Loops that have opened included; `strain` is the change of the displacement gradient, times
        are shares of the way as if overlaps and gaps had changed evenly.
    """
    count = before.contact_count
    d, end = branch_vectors(before), after.branches[:count]
    parts = _Parts(
        before,
        np.ones(count, dtype=bool),
        after.strain,
        end - d,
        after.forces[:count] - contact_forces(before),
    )
    # By the overlap: below 1 where a contact is open at the end.
    length = np.linalg.norm(d, axis=1)
    overlap = before.radii[before.contacts].sum(axis=1) - length
    parts.losing = _time(overlap, length - np.linalg.norm(end, axis=1))
    return _of_all(parts, faces)


def loop_sums(values: Floats, faces: Faces) -> Floats:
    """(L,) sums over the contacts of each loop."""
    face = np.repeat(np.arange(len(faces.kind)), faces.order)
    sums = np.bincount(face, values[faces.contacts], minlength=len(faces.kind))
    return np.asarray(sums[faces.loops])


def _of_all(parts: _Parts, faces: Faces) -> LoopRates:
    count = len(faces.loops)
    row = np.empty(len(faces.kind), dtype=np.int64)
    row[faces.loops] = np.arange(count)
    out: dict[str, Floats] = {name: np.empty(count) for name in LoopRates.__annotations__}
    out |= {name: np.empty((count, 2, 2)) for name in ("strain", "stress")}
    for batch in loop_batches(parts.graph, faces):
        for name, values in parts.of(batch).items():
            out[name][row[batch.face]] = values
    return LoopRates(**out)


class _Parts:
    """Rates of the branches, forces and normal forces of a packing's contacts."""

    def __init__(
        self, graph: GrainGraph, carries: Flags, strain: Floats, branch: Floats, force: Floats
    ) -> None:
        state = contact_state(graph)
        self.graph, self.carries = graph, carries
        self.strain, self.branch_rate, self.force_rate = strain, branch, force
        self.forces, self.branches = contact_forces(graph), branch_vectors(graph)
        turn = np.sum(state.t * branch, axis=1) / state.length
        normal = np.sum(state.n * force, axis=1) + state.shear_force * turn
        self.losing = _time(state.normal_force, normal)

    def of(self, batch: LoopBatch) -> dict[str, Floats]:
        """Fields of `LoopRates` for loops of one order."""
        c, x = batch.contacts, batch.graph.x
        known = self.carries[c].all(axis=1)
        sides = np.roll(x, -1, axis=1) - x
        # Whether a loop's sides run along its contacts or against them.
        along = np.sign(np.sum(sides * self.branches[c], axis=2, keepdims=True))
        stretch = along * self.branch_rate[c]
        force, rate = along * self.forces[c], along * self.force_rate[c]
        area = polygon_area(x)
        v = np.cumsum(stretch, axis=1) - stretch
        strain = -np.swapaxes(v, 1, 2) @ boundary_vectors(x) / area[:, None, None]
        half = 0.5 / area[:, None, None]
        stress = half * np.swapaxes(rate, 1, 2) @ sides
        spin = 0.5 * (strain[:, 0, 1] - strain[:, 1, 0])
        held = half * np.swapaxes(force, 1, 2) @ sides
        turned = stress - spin[:, None, None] * (QUARTER_TURN @ held)
        e = 0.5 * (strain + np.swapaxes(strain, 1, 2))
        whole = 0.5 * (self.strain + self.strain.T)
        work = np.sum(turned * e, axis=(1, 2))
        with np.errstate(invalid="ignore", divide="ignore"):
            sizes = np.linalg.norm(turned, axis=(1, 2)) * np.linalg.norm(e, axis=(1, 2))
            normalised = work / sizes
            nonaffinity = np.linalg.norm(e - whole, axis=(1, 2)) / np.linalg.norm(whole)
        columns = {
            "strain": strain,
            "stress": stress,
            "second_order_work": work,
            "normalised_work": normalised,
            "additive_work": -np.sum(rate * stretch, axis=(1, 2)) / (2 * area),
            "nonaffinity": nonaffinity,
            "opening": self.losing[c].min(axis=1),
            "closing": _first_closing(x, batch.graph.radii, v),
        }
        for values in columns.values():
            values[~known] = np.nan
        return columns | {"area": area}


def _time(left: Floats, rate: Floats) -> Floats:
    """Time until `left` is used up at `rate`; infinite where it grows."""
    falls = rate < 0
    return np.where(falls, np.maximum(left, 0.0) / np.where(falls, -rate, 1.0), np.inf)


def _first_closing(x: Floats, radii: Floats, v: Floats) -> Floats:
    """Earliest closing of a gap between grains of a loop that aren't neighbours along it."""
    n = x.shape[1]
    first = np.full(len(x), np.inf)
    for apart in range(2, n // 2 + 1):
        other = (np.arange(n) + apart) % n
        d, rate = x[:, other] - x, v[:, other] - v
        length = np.linalg.norm(d, axis=2)
        gap = length - radii - radii[:, other]
        closing = np.sum(d * rate, axis=2) / np.where(length > 0, length, 1.0)
        # Grains that overlap without a contact of their own, or meet themselves, have no gap.
        time = np.where(gap > 0, _time(gap, closing), np.inf)
        first = np.minimum(first, time.min(axis=1))
    return first
