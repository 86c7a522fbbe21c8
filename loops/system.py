"""The linear system of a packing: contacts as springs between freedoms, sparse, with spins.

Every contact has the relative motion `r = (d', w_i, w_j)` and answers with `s = (f', m_i', m_j')`,
`s = -S r`; `G` gives the relative motions from the grains' freedoms, `-G^T s` the external forces
that balance contact forces. A displacement gradient `H'` (compression positive) adds
`r = (-H' d, 0, 0)`, so the motion of the grains beyond the affine one solves

    K v = -G^T S r_aff + loads,    K = G^T S G

moment rows included. Spins and moments are scaled by the mean radius, so all freedoms are lengths.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from loops.arrays import Flags, Floats, Integers, Regimes
from loops.assembly import assembled_sparse, contact_regime, motions
from loops.boundary import Rows
from loops.errors import InputError, counted
from loops.graph import GrainGraph
from loops.laws.frictional import ContactLaw, Regime
from loops.pruning import component_labels, prune_dangling, winding_ranks
from loops.scene import Scene
from loops.shown import Shown


@dataclass(frozen=True, eq=False, repr=False)
class Carrying(Shown):
    """Grains and contacts that carry load, and counts of those that do not.

    `component` (G,) numbers the connected ones, -1 for grains that carry nothing.
    `anchors`: one grain of each component that nothing holds, whose translations are fixed.
    `rattlers`: number of grains with fewer than two contacts, pruned recursively. `clusters`,
    `clustered`: number of components, and of their grains, that touch no wall and no held grain
    and do not wind around the cell.
    """

    grains: Flags
    contacts: Flags
    component: Integers
    anchors: Integers
    rattlers: int
    clusters: int
    clustered: int


def carrying_grains(graph: GrainGraph, closed: Flags, supports: Integers) -> Carrying:
    """Prune rattlers and floating clusters; `supports` (G,): wall contacts, 2 for a held grain."""
    kept, contacts = prune_dangling(graph, closed, supports)
    count, label = component_labels(graph.grain_count, graph.contacts[contacts], kept)
    held = np.bincount(label[kept], weights=supports[kept], minlength=count) > 0
    winds = np.zeros(count, dtype=bool)
    if graph.images is not None:
        winds = winding_ranks(graph.contacts[contacts], graph.images[contacts], label, count) > 0
    good = held | winds
    if not good.any():
        raise InputError(
            "packing",
            f"{counted(count, 'floating cluster')}" if count else "grains that all float",
            "contacts that span the periodic cell, walls, or grains that are held",
            "Give the cell or the walls, or hold the outline's grains.",
        )
    grains = kept & np.append(good, False)[label]
    free = np.flatnonzero(good & ~held)
    first = np.full(count, graph.grain_count)
    np.minimum.at(first, label[kept], np.flatnonzero(kept))
    return Carrying(
        grains=grains,
        contacts=contacts & grains[graph.contacts[:, 0]],
        component=np.where(grains, label, -1),
        anchors=first[free],
        rattlers=int(np.count_nonzero(~kept)),
        clusters=int(np.count_nonzero(~good)),
        clustered=int(np.count_nonzero(kept & ~grains)),
    )


# Springs on the ground at all freedoms, over the typical stiffness: as weak as the matrix needs,
# and no grain is preferred. They resist gear modes and mechanisms. Rates are those without them;
# paths, which are not refined, move by 1e-8 or less (docs/knobs.md).
REGULARISATION = 1e-11


@dataclass(frozen=True, eq=False, repr=False)
class System(Shown):
    """Carrying contacts of a packing and the freedoms of their grains.

    `freedom` (G, 3) numbers the unknowns of each grain (x, y, spin times `length`), -1 where it
    has none; `rows` are all contacts, `kept` (E,) those that carry. `ends` (E, 6) are the freedoms
    of each in the order x_i, y_i, x_j, y_j, w_i, w_j, `branches` (E, 2) go to the other grain or to
    the point of the wall that moves with the strain. `unit` is a typical stiffness, `volume` the
    area that stresses refer to.
    """

    graph: GrainGraph
    law: ContactLaw
    rows: Rows
    carrying: Carrying
    kept: Integers
    branches: Floats
    stiffness: Floats
    regime: Regimes
    freedom: Integers
    ends: Integers
    size: int
    length: float
    unit: float
    volume: float
    held: int

    @cached_property
    def contacts(self) -> Integers:
        """(C',) contacts between grains that carry, the first ones of the system's."""
        return self.kept[self.kept < self.graph.contact_count]

    @property
    def boundary(self) -> str:
        """Return in words what drives the packing: periodic cell, walls, held grains."""
        ends = [] if self.graph.cell is None else ["periodic cell"]
        walls = len(self.kept) - len(self.contacts)
        ends += [f"{walls} wall contacts"] if walls else []
        ends += [f"{counted(self.held, 'grain')} held to the affine motion"] if self.held else []
        return ", ".join(ends)


def packing_system(scene: Scene, *, regime: ArrayLike | None = None) -> System:
    """Prune, number the freedoms and evaluate the contacts, in other regimes if they are given."""
    regimes, state = scene.rows.state.regime, scene.contact_state
    assert regimes is not None
    if regime is not None:
        between = contact_regime(state, scene.law, regime)
        regimes = np.append(between, regimes[len(between) :])
    return system_of(scene, regimes)


def system_of(scene: Scene, regimes: Regimes) -> System:
    """Return the system of a scene whose contacts have these regimes (E,)."""
    graph, boundary, rows = scene.graph, scene.boundary, scene.rows
    count = graph.contact_count
    fixed = np.zeros(graph.grain_count, dtype=bool) if boundary.held is None else boundary.held
    closed = regimes != Regime.OPEN
    supports = 2 * fixed + np.bincount(rows.ends[count:][closed[count:], 0], minlength=len(fixed))
    carrying = carrying_grains(graph, closed[:count], supports)
    bodies = np.append(carrying.grains, np.ones(len(closed) - count, dtype=bool))
    kept = np.flatnonzero(closed & bodies[rows.ends].all(axis=1))
    moves = np.repeat(carrying.grains[:, None], 3, axis=1)
    moves[fixed, :2] = False
    # Bodies beyond the grains move with the strain alone.
    freedom, size = np.full((len(bodies), 3), -1), int(np.count_nonzero(moves))
    freedom[: len(moves)][moves] = np.arange(size)
    pairs = rows.ends[kept]
    ends = np.column_stack([freedom[pairs[:, 0], :2], freedom[pairs[:, 1], :2], freedom[pairs, 2]])
    length = float(graph.radii[carrying.grains].mean())
    scale = np.array([1.0, 1.0, 1.0 / length, 1.0 / length])
    blocks = scale[:, None] * rows.tangents(regimes)[kept] * scale
    unit = float(np.abs(blocks[:, :2, :2]).sum(axis=(1, 2)).mean()) / 2.0 if len(blocks) else 0.0
    if not unit > 0:
        expected = "contacts with stiffness"
        raise InputError("packing", "no contact that resists", expected, "See the law.")
    volume = boundary.volume
    if volume is None or not (np.isfinite(volume) and volume > 0):
        raise InputError("volume", repr(volume), "a positive area", "Give the sample's area.")
    return System(
        graph=graph,
        law=scene.law,
        rows=rows,
        carrying=carrying,
        kept=kept,
        branches=rows.branches[kept],
        stiffness=blocks,
        regime=np.asarray(regimes[kept], dtype=np.int8),
        freedom=freedom[: len(moves)],
        ends=ends,
        size=size,
        length=length,
        unit=unit,
        volume=volume,
        held=int(np.count_nonzero(fixed & carrying.grains)),
    )


def relative_motion(system: System, v: Floats, strain_rate: Floats | None = None) -> Floats:
    """Return motions `r` (E, 4) or (E, 4, k) of the contacts from the freedoms, and from `H'`."""
    r = motions(v.reshape(len(v), -1), system.ends).reshape(-1, 4, *v.shape[1:])
    if strain_rate is not None:
        r[:, :2] -= np.tensordot(system.branches, strain_rate, (1, 1))
    return r


def in_freedoms(system: System, rows: Integers, vectors: Floats) -> sparse.csr_array:
    """Return rows `G^T g` (k, size) of vectors `g` (k, 4) on the motions `r` of some contacts."""
    entries = np.concatenate([-vectors[:, :2], vectors], axis=1)
    ends = system.ends[rows]
    inside = ends >= 0
    start = np.concatenate([[0], np.cumsum(inside.sum(axis=1))])
    shape = (len(rows), system.size)
    return sparse.csr_array((entries[inside], ends[inside], start), shape=shape)


def balancing_forces(system: System, s: Floats) -> Floats:
    """Return external forces `-G^T s` (size[, k]) that balance contact forces `s` (E, 4[, k]).

    Force `f` of i on j needs `+f` on i and `-f` on j from outside, and the opposite of moments.
    """
    parts = np.concatenate([s[:, :2], -s], axis=1).reshape(system.ends.size, *s.shape[2:])
    inside = np.flatnonzero(system.ends.ravel() >= 0)
    rows = system.ends.ravel()[inside]
    spread = sparse.csr_array(
        (np.ones(len(rows)), (rows, inside)), shape=(system.size, system.ends.size)
    )
    return np.asarray(spread @ parts)


def stiffness_matrix(system: System, stiffness: Floats | None = None) -> sparse.csc_array:
    """Return `K = G^T S G` (size, size), nonsymmetric; `stiffness` in place of the system's own."""
    blocks = system.stiffness if stiffness is None else stiffness
    return assembled_sparse(blocks, system.ends, system.size)


def packing_stress(system: System) -> Floats:
    """Return the Cauchy stress `(1/V) sum f (x) d` of all contacts, walls included, (2, 2)."""
    return np.asarray(system.rows.state.forces.T @ system.rows.branches / system.volume)
