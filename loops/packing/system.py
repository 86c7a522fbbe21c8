"""The linear system of a packing: contacts as springs between freedoms, sparse, with spins.

Every contact has the relative motion `r = (d', w_i, w_j)` and answers with `s = (f', m_i', m_j')`,
`s = -S r`; `G` gives the relative motions from the grains' freedoms, `-G^T s` the external forces
that balance contact forces. A displacement gradient `H'` (compression positive) adds
`r = (-H' d, 0, 0)`, so the motion of the grains beyond the affine one solves

    K v = -G^T S r_aff + loads,    K = G^T S G

moment rows included. Spins and moments are scaled by the mean radius, so all freedoms are lengths.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.sparse.linalg import splu

from loops.arrays import Flags, Floats, Integers, Regimes
from loops.assembly import assembled_sparse, contact_regime, contact_tangent
from loops.errors import InputError
from loops.faces import FaceKind, Faces
from loops.graph import (
    ContactState,
    GrainGraph,
    branch_vectors,
    contact_state,
    require_one_state,
)
from loops.laws.frictional import ContactLaw, LinearFrictional, Regime
from loops.pruning import component_labels, winding_ranks
from loops.shown import Shown


@dataclass(frozen=True, eq=False, repr=False)
class Carrying(Shown):
    """Grains and contacts that carry load, and counts of those that do not.

    `anchors`: one grain of each component that nothing holds, whose translations are fixed.
    `rattlers`: number of grains with fewer than two contacts, pruned recursively. `clusters`,
    `clustered`: number of components, and of their grains, that touch no wall and no held grain
    and do not wind around the cell.
    """

    grains: Flags
    contacts: Flags
    anchors: Integers
    rattlers: int
    clusters: int
    clustered: int


def carrying_grains(graph: GrainGraph, closed: Flags, supports: Integers) -> Carrying:
    """Prune rattlers and floating clusters; `supports` (G,): wall contacts, 2 for a held grain."""
    kept, contacts = np.ones(graph.grain_count, dtype=bool), closed.copy()
    while True:
        degree = supports + np.bincount(graph.contacts[contacts].ravel(), minlength=len(kept))
        loose = kept & (degree < 2)
        if not loose.any():
            break
        kept &= ~loose
        contacts &= kept[graph.contacts].all(axis=1)
    count, label = component_labels(graph.grain_count, graph.contacts[contacts], kept)
    held = np.bincount(label[kept], weights=supports[kept], minlength=count) > 0
    winds = np.zeros(count, dtype=bool)
    if graph.images is not None:
        winds = winding_ranks(graph.contacts[contacts], graph.images[contacts], label, count) > 0
    good = held | winds
    if not good.any():
        raise InputError(
            "packing",
            f"{count} clusters that float" if count else "grains that all float",
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
        anchors=first[free],
        rattlers=int(np.count_nonzero(~kept)),
        clusters=int(np.count_nonzero(~good)),
        clustered=int(np.count_nonzero(kept & ~grains)),
    )


@dataclass(frozen=True, eq=False, repr=False)
class PlaneContacts(Shown):
    """Contacts of grains with rigid plates: branch from centre to foot, stiffness of each.

    A plate moves with the mean strain times its place, `-H' (X - fixed)` with `X` the point of the
    plate nearest to `fixed`: it neither turns nor stretches along itself, so that its frame and its
    geometry have no stiffness. Without `fixed` that is the lower left corner of the feet, as in
    paths. `kt` is zero where the wall has no friction; without `mu` a contact that has a shear
    stiffness never slides. `force` (W, 2) is that of the wall on the grain; without it no contact
    stands at its strength. Contacts that are `sliding` keep to it.
    """

    grain: Integers
    branch: Floats
    kn: Floats
    kt: Floats
    mu: Floats | None = None
    force: Floats | None = None
    sliding: Flags | None = None
    fixed: Floats | None = None

    @property
    def regime(self) -> Regimes:
        """(W,) elastic with friction, else sliding."""
        sticks = self.kt > 0
        if self.sliding is not None:
            sticks = sticks & ~self.sliding
        return np.where(sticks, Regime.ELASTIC, Regime.SLIDING).astype(np.int8)

    def take(self, rows: Flags) -> PlaneContacts:
        """The picked contacts."""
        mu, force = (None if a is None else a[rows] for a in (self.mu, self.force))
        sliding = None if self.sliding is None else self.sliding[rows]
        given = self.grain[rows], self.branch[rows], self.kn[rows], self.kt[rows]
        return PlaneContacts(*given, mu, force, sliding, self.fixed)

    def to_plates(self, x: Floats) -> Floats:
        """(W, 2) from the centres of the grains, at `x` (G, 2), to the point of each plate."""
        n = self.branch / np.linalg.norm(self.branch, axis=1, keepdims=True)
        feet = x[self.grain] + self.branch
        corner = feet.min(axis=0, initial=np.inf) if self.fixed is None else self.fixed
        aside = corner - feet
        along = aside - np.sum(aside * n, axis=1, keepdims=True) * n
        return np.asarray(self.branch + along)

    def state(self, radii: Floats) -> ContactState:
        """The contacts as those with grains of no radius; `radii` (G,)."""
        length = np.linalg.norm(self.branch, axis=1)
        n = self.branch / length[:, None]
        t = np.column_stack([-n[:, 1], n[:, 0]])
        force = np.zeros_like(n) if self.force is None else -self.force
        N, T = np.sum(force * n, axis=1), np.sum(force * t, axis=1)
        return ContactState(length, n, t, N, T, radii[self.grain], 0.0 * length, self.regime)

    def law(self, law: ContactLaw) -> LinearFrictional:
        """Springs and friction of the plates, with the shear increment of the law of the grains."""
        mu = np.full(len(self.kn), np.inf) if self.mu is None else self.mu
        return LinearFrictional(self.kn, self.kt, mu, getattr(law, "shear_increment", "branch"))


def plane_contacts(
    graph: GrainGraph, grain: ArrayLike, force: ArrayLike, foot_to_centre: ArrayLike
) -> PlaneContacts:
    """Contacts with frictionless planes, `kn` from what each carries over its overlap.

    Parameters
    ----------
    graph : GrainGraph
        The packing.
    grain : (W,) array of int
        Grain of each contact.
    force : (W, 2) array
        Force of the wall on the grain (force).
    foot_to_centre : (W, 2) array
        From the foot on the wall to the centre of the grain (length).

    Returns
    -------
    PlaneContacts

    Raises
    ------
    InputError
        If a contact pulls, or carries a force without an overlap.
    """
    who, away = np.asarray(grain, dtype=np.int64), np.asarray(foot_to_centre, dtype=float)
    distance = np.linalg.norm(away, axis=1)
    normal = np.sum(np.asarray(force, dtype=float) * away, axis=1) / distance
    overlap = graph.radii[who] - distance
    closed = normal > 0
    if (normal < 0).any() or (overlap[closed] <= 0).any():
        wrong = int(np.flatnonzero((normal < 0) | (closed & (overlap <= 0)))[0])
        where, expected = f"wall contact {wrong}", "compression where the grain overlaps the wall"
        received = f"normal force {normal[wrong]:g} at an overlap of {overlap[wrong]:g}"
        raise InputError(where, received, expected, "Check the sign of forces and branches.")
    kn = normal[closed] / overlap[closed]
    return PlaneContacts(who[closed], -away[closed], kn, np.zeros(len(kn)))


def outline_grains(graph: GrainGraph, faces: Faces) -> Flags:
    """(G,) grains on the outer cycle of the largest cluster: to hold where walls aren't known."""
    outer = np.flatnonzero(faces.kind == FaceKind.OUTER)
    grains = np.zeros(graph.grain_count, dtype=bool)
    if len(outer):
        face = outer[np.argmax(np.abs(faces.area[outer]))]
        grains[faces.grains[faces.offsets[face] : faces.offsets[face + 1]]] = True
    return grains


def plane_stiffness(planes: PlaneContacts, radii: Floats, law: ContactLaw) -> Floats:
    """(W, 4, 4) blocks `S` in the regimes of the contacts, those of `law` between grains.

    Frames keep their directions: of the geometry the growth of the arm alone is left.
    """
    state = replace(planes.state(radii), normal_force=np.zeros(len(planes.kn)))
    blocks = contact_tangent(state, planes.law(law), planes.regime)
    turning = (state.shear_force / state.length)[:, None, None]
    blocks[:, :2, :2] -= turning * state.n[:, :, None] * state.t[:, None, :]
    return blocks


# Stiffness added to the diagonal, over the typical one: it resists gear modes and mechanisms and
# changes no other answer. No sign changed between 1e-9 and 1e-5.
REGULARISATION = 1e-7
# Relative residual at which refinement ends; each step gains several digits.
REFINED = 1e-15
# Right-hand sides that SuperLU solves at a time: fastest with a few.
PANEL = 4


@dataclass(frozen=True, eq=False, repr=False)
class PackingSystem(Shown):
    """Carrying contacts of a packing and the freedoms of their grains.

    `freedom` (G, 3) numbers the unknowns of each grain (x, y, spin times `length`), -1 where it
    has none; `ends` (E, 6) those of each contact in the order x_i, y_i, x_j, y_j, w_i, w_j.
    `contacts` (C',) are the contacts of the graph, wall contacts follow behind them in all arrays
    of length E. `branches` (E, 2) go to the other grain, or to the point of the plate that moves
    with the strain. `unit` is a typical stiffness, `volume` the area that stresses refer to.
    """

    graph: GrainGraph
    law: ContactLaw
    carrying: Carrying
    contacts: Integers
    branches: Floats
    stiffness: Floats
    regime: Regimes
    freedom: Integers
    ends: Integers
    size: int
    length: float
    unit: float
    volume: float
    planes: PlaneContacts | None
    held: int

    @property
    def boundary(self) -> str:
        """Boundary that drives the packing: periodic cell, walls, held grains."""
        ends = [] if self.graph.cell is None else ["periodic cell"]
        ends += [] if self.planes is None else [f"{len(self.planes.grain)} wall contacts"]
        ends += [f"{self.held} grains held to the affine motion"] if self.held else []
        return ", ".join(ends)


def packing_system(
    graph: GrainGraph,
    law: ContactLaw,
    *,
    regime: ArrayLike | None = None,
    planes: PlaneContacts | None = None,
    held: ArrayLike | None = None,
    volume: float | None = None,
) -> PackingSystem:
    """Prune, number the freedoms and evaluate the contacts; `held` (G,) grains move affinely."""
    require_one_state(graph)
    state = contact_state(graph)
    regimes = np.broadcast_to(contact_regime(state, law, regime), graph.contacts.shape[:1])
    fixed = np.zeros(graph.grain_count, dtype=bool) if held is None else np.asarray(held, bool)
    supports = 2 * fixed.astype(np.int64)
    if planes is not None:
        supports += np.bincount(planes.grain, minlength=len(fixed))
    carrying = carrying_grains(graph, regimes != Regime.OPEN, supports)
    kept = np.flatnonzero(carrying.contacts)
    moves = np.repeat(carrying.grains[:, None], 3, axis=1)
    moves[fixed, :2] = False
    freedom, size = np.full(moves.shape, -1), int(np.count_nonzero(moves))
    freedom[moves] = np.arange(size)
    length = float(graph.radii[carrying.grains].mean())
    blocks = contact_tangent(state, law, regimes)[kept]
    branches, pairs = branch_vectors(graph)[kept], graph.contacts[kept]
    ends = np.column_stack([freedom[pairs[:, 0], :2], freedom[pairs[:, 1], :2], freedom[pairs, 2]])
    if planes is not None:
        to_plates = planes.to_plates(graph.x)[carrying.grains[planes.grain]]
        planes = planes.take(carrying.grains[planes.grain])
        blocks = np.concatenate([blocks, plane_stiffness(planes, graph.radii, law)])
        branches = np.concatenate([branches, to_plates])
        own, none = freedom[planes.grain], np.full((len(planes.grain), 2), -1)
        at_planes = np.column_stack([own[:, :2], none, own[:, 2], none[:, 0]])
        ends = np.concatenate([ends, at_planes])
        regimes = np.concatenate([regimes[kept], planes.regime])
    else:
        regimes = regimes[kept]
    scale = np.array([1.0, 1.0, 1.0 / length, 1.0 / length])
    blocks = scale[:, None] * blocks * scale
    unit = float(np.abs(blocks[:, :2, :2]).sum(axis=(1, 2)).mean()) / 2.0 if len(blocks) else 0.0
    if not unit > 0:
        raise InputError(
            "packing", "no contact that resists", "contacts with stiffness", "See the law."
        )
    if volume is None and graph.cell is not None:
        volume = float(abs(np.linalg.det(graph.cell)))
    if volume is None or not (np.isfinite(volume) and volume > 0):
        raise InputError("volume", repr(volume), "a positive area", "Give the sample's area.")
    return PackingSystem(
        graph=graph,
        law=law,
        carrying=carrying,
        contacts=kept,
        branches=branches,
        stiffness=blocks,
        regime=np.asarray(regimes, dtype=np.int8),
        freedom=freedom,
        ends=ends,
        size=size,
        length=length,
        unit=unit,
        volume=volume,
        planes=planes,
        held=int(np.count_nonzero(fixed & carrying.grains)),
    )


def relative_motion(system: PackingSystem, v: Floats, strain_rate: Floats | None = None) -> Floats:
    """(E, 4) or (E, 4, k): motions `r` of the contacts from the freedoms, and from `H'`."""
    padded = np.concatenate([v, np.zeros((1, *v.shape[1:]))])
    at = padded[system.ends]
    r = np.concatenate([at[:, 2:4] - at[:, :2], at[:, 4:]], axis=1)
    if strain_rate is not None:
        r[:, :2] -= np.tensordot(system.branches, strain_rate, (1, 1))
    return r


def in_freedoms(system: PackingSystem, rows: Integers, vectors: Floats) -> sparse.csr_array:
    """(k, size): vectors `g` (k, 4) on the motions `r` of some contacts, as rows `G^T g`."""
    entries = np.concatenate([-vectors[:, :2], vectors], axis=1)
    ends = system.ends[rows]
    inside = ends >= 0
    start = np.concatenate([[0], np.cumsum(inside.sum(axis=1))])
    shape = (len(rows), system.size)
    return sparse.csr_array((entries[inside], ends[inside], start), shape=shape)


def balancing_forces(system: PackingSystem, s: Floats) -> Floats:
    """(size,) or (size, k): external forces `-G^T s` that balance contact forces `s` (E, 4[, k]).

    Force `f` of i on j needs `+f` on i and `-f` on j from outside, and the opposite of moments.
    """
    parts = np.concatenate([s[:, :2], -s], axis=1).reshape(system.ends.size, *s.shape[2:])
    inside = np.flatnonzero(system.ends.ravel() >= 0)
    rows = system.ends.ravel()[inside]
    spread = sparse.csr_array(
        (np.ones(len(rows)), (rows, inside)), shape=(system.size, system.ends.size)
    )
    return np.asarray(spread @ parts)


def stiffness_matrix(system: PackingSystem, stiffness: Floats | None = None) -> sparse.csc_array:
    """`K = G^T S G`, (size, size), nonsymmetric; `stiffness` in place of the system's own."""
    blocks = system.stiffness if stiffness is None else stiffness
    return assembled_sparse(blocks, system.ends, system.size)


def packing_stress_rate(system: PackingSystem, s: Floats) -> Floats:
    """Nominal stress rate `P' = (1/V) sum f' (x) d`, (2, 2) or (2, 2, k)."""
    return np.einsum("ei...,ej->ij...", s[:, :2], system.branches) / system.volume


class Factors(Protocol):
    """Solver of linear systems with one matrix."""

    def solve(self, rhs: Floats, /) -> Floats:
        """(size,) or (size, k) solutions."""
        ...


@dataclass(frozen=True, eq=False, repr=False)
class UpdatedFactors(Shown):
    """Factors of `K - P G` from those of `K`.

    `change` (size, k) is `K^-1 P`, `gauge` (k, size) is `(1 - G K^-1 P)^-1 G`.
    """

    lu: Factors
    change: Floats
    gauge: Floats

    def solve(self, rhs: Floats, /) -> Floats:
        """(size,) or (size, k) solutions (Woodbury)."""
        v = self.lu.solve(rhs)
        return np.asarray(v + self.change @ (self.gauge @ v))


@dataclass(frozen=True, eq=False, repr=False)
class Factor(Shown):
    """`K`, and LU factors of `K` made regular by `factorised`."""

    matrix: sparse.csc_array
    lu: Factors

    def solve(self, loads: Floats, *, refinements: int = 8) -> Floats:
        """(size,) or (size, k) solutions; refinement removes the effect of the regularisation."""
        v = self._panels(loads)
        goal, before = REFINED * np.linalg.norm(loads), np.inf
        for _ in range(refinements):
            left = loads - self.matrix @ v
            # Loads on a mechanism stay unbalanced: refinement would only increase its motion.
            size = float(np.linalg.norm(left))
            if size <= goal or size > 0.5 * before:
                break
            before = size
            v += self._panels(left)
        return v

    def _panels(self, loads: Floats) -> Floats:
        if loads.ndim == 1:
            return self.lu.solve(loads)
        out = np.empty(loads.shape, order="F")
        for start in range(0, loads.shape[1], PANEL):
            part = slice(start, start + PANEL)
            out[:, part] = self.lu.solve(np.asfortranarray(loads[:, part]))
        return out


def factorised(system: PackingSystem, stiffness: Floats | None = None) -> Factor:
    """LU factors of `K` with a small stiffness on its diagonal, anchors on springs without load.

    `stiffness` (E, 4, 4) replaces that of the system.
    """
    matrix = stiffness_matrix(system, stiffness)
    springs = np.full(system.size, REGULARISATION * system.unit)
    springs[system.freedom[system.carrying.anchors, :2].ravel()] += system.unit
    try:
        lu = splu(
            (matrix + sparse.diags_array(springs)).tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.001,
            options={"SymmetricMode": True},
        )
    except RuntimeError as error:
        raise InputError(
            "packing", "a singular system", "contacts that hold the grains", f"SuperLU: {error}."
        ) from error
    return Factor(matrix, lu)
