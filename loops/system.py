"""The linear system of a packing: contacts as springs between freedoms, sparse, with spins.

Every contact has the relative motion `r = (d', w_i, w_j)` and answers with `s = (f', m_i', m_j')`,
`s = -S r`; `G` gives the relative motions from the grains' freedoms, `-G^T s` the external forces
that balance contact forces. A displacement gradient `H'` (compression positive) adds
`r = (-H' d, 0, 0)`, so the motion of the grains beyond the affine one solves

    K v = -G^T S r_aff + loads,    K = G^T S G

moment rows included. Spins and moments are scaled by the mean radius, so all freedoms are lengths.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from loops.arrays import Flags, Floats, Integers, Regimes
from loops.assembly import assembled_sparse, contact_regime
from loops.boundary import Rows
from loops.compiled import WIDTH
from loops.errors import InputError
from loops.graph import GrainGraph
from loops.laws.frictional import ContactLaw, Regime
from loops.pruning import component_labels, winding_ranks
from loops.scene import Scene
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


# Springs on the ground at all freedoms, over the typical stiffness: as weak as the matrix needs,
# and no grain is preferred. They resist gear modes and mechanisms. Rates are those without them;
# paths, which are not refined, move by 1e-8 or less (docs/knobs.md).
REGULARISATION = 1e-11
# Relative residual at which refinement ends; one step reaches rounding.
REFINED = 1e-14
# Steps of refinement at most.
REFINEMENTS = 8
# Stiffness over the typical one against which a mechanism moves under its load: so fast that
# regimes without it are preferred, and so slow that forces keep nine digits.
MECHANISM = 1e-7
# Motion of a unit load over a unit stiffness from which on mechanisms are looked for.
SOFT = 1e8
# So many motions are tried at once, more as long as all of them are mechanisms.
TRIED = (4, 16, 64)
# Right-hand sides that SuperLU solves at a time: fastest with a few.
PANEL = 4
# Entries of all right-hand sides beyond which the kernel is worth loading.
LOADS_BY_KERNEL = 1_000_000


class Mechanisms(NamedTuple):
    """Motions `R` (size, m) that meet no force, and `L` (m, size): `K R = 0`, `L K = 0`, `L R = 1`.

    `R L` takes from a load what no motion balances, from a motion its mechanisms. `compliance`
    (m, 1) moves them under a load, translations by none.
    """

    R: Floats
    L: Floats
    compliance: Floats


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
        ends += [f"{self.held} grains held to the affine motion"] if self.held else []
        return ", ".join(ends)

    @cached_property
    def translations(self) -> Mechanisms:
        """Translations of the components that nothing holds."""
        carrying, graph = self.carrying, self.graph
        pairs, anchors = graph.contacts[carrying.contacts], carrying.anchors
        _, label = component_labels(graph.grain_count, pairs, carrying.grains)
        T = np.zeros((self.size, 2 * len(anchors)))
        for k, anchor in enumerate(anchors):
            together = np.flatnonzero(label == label[anchor])
            for axis in (0, 1):
                T[self.freedom[together, axis], 2 * k + axis] = len(together) ** -0.5
        return Mechanisms(T, T.T, np.zeros((T.shape[1], 1)))


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
    padded = np.concatenate([v, np.zeros((1, *v.shape[1:]))])
    at = padded[system.ends]
    r = np.concatenate([at[:, 2:4] - at[:, :2], at[:, 4:]], axis=1)
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


def packing_stress_rate(system: System, s: Floats) -> Floats:
    """Return the nominal stress rate `P' = (1/V) sum f' (x) d`, (2, 2) or (2, 2, k)."""
    return np.einsum("ei...,ej->ij...", s[:, :2], system.branches) / system.volume


def packing_stress(system: System) -> Floats:
    """Return the Cauchy stress `(1/V) sum f (x) d` of all contacts, walls included, (2, 2)."""
    state = system.rows.state
    forces = state.normal_force[:, None] * state.n + state.shear_force[:, None] * state.t
    return np.asarray(forces.T @ system.rows.branches / system.volume)


@dataclass(frozen=True, eq=False, repr=False)
class Factor(Shown):
    """LU factors of `K` on weak springs, at one geometry and in reference regimes.

    `matrix` is `K` without the springs, against which solutions are refined, `unit` its typical
    stiffness, `translations` those that nothing resists.
    """

    matrix: sparse.csc_array
    lu: SuperLU
    unit: float
    translations: Mechanisms

    def solve(self, loads: Floats, *, refine: int = REFINEMENTS) -> Floats:
        """Return motions (size,) or (size, k) as without springs.

        What mechanisms cannot carry of a load is left out of balance, and moves them.
        """
        return _solved(self.mechanisms, self.matrix, self.once, loads, refine)

    @cached_property
    def mechanisms(self) -> Mechanisms:
        """Translations, and other motions that meet no force, if they are few."""
        T = self.translations.R
        # Spins that nothing resists and nothing loads stay where they are.
        touched = abs(self.matrix).sum(axis=0) + abs(self.matrix).sum(axis=1) > 0
        load = np.where(touched, np.cos(np.arange(len(T)) ** 2.0), 0.0)
        if self.unit * np.linalg.norm(self.lu.solve(load)) > SOFT * np.linalg.norm(load):
            for tried in TRIED:
                R, L = (self._softest(load, tried, trans) for trans in ("N", "T"))
                if R.shape[1] == L.shape[1] < tried:
                    R, L = np.hstack([T, R - T @ (T.T @ R)]), np.hstack([T, L])
                    compliance = np.full((R.shape[1], 1), 1.0 / (MECHANISM * self.unit))
                    compliance[: T.shape[1]] = 0.0
                    return Mechanisms(R, np.asarray(np.linalg.solve(L.T @ R, L.T)), compliance)
        return self.translations

    def _softest(self, load: Floats, count: int, trans: str) -> Floats:
        """Return null vectors (size, m) of `K`, or of its transpose, among so many motions."""
        x = load[:, None] * np.cos(np.outer(np.arange(len(load)), np.arange(count)))
        for _ in range(3):
            x = np.linalg.qr(self.lu.solve(x, trans=trans))[0]
        matrix = self.matrix if trans == "N" else self.matrix.T
        _, stiffness, vectors = np.linalg.svd(matrix @ x, full_matrices=False)
        return np.asarray(x @ vectors[stiffness <= 2.0 * REGULARISATION * self.unit].T)

    def once(self, loads: Floats) -> Floats:
        """Return motions under up to eight loads on the springs, without refinement."""
        if loads.ndim == 1 or loads.shape[1] <= PANEL:
            return np.asarray(self.lu.solve(np.asfortranarray(loads)))
        from loops.compiled.columns import solve_eight

        x = np.zeros((len(loads), WIDTH))
        x[self.lu.perm_r, : loads.shape[1]] = loads
        solve_eight(*self._triangles, x)
        return x[self.lu.perm_c, : loads.shape[1]]

    def changed(
        self, matrix: sparse.csc_array, columns: Floats, gauge: sparse.csr_array
    ) -> Changed:
        """Return the factors of `matrix`, `K - P G`, from columns `K^-1 P` (size, k)."""
        small = np.linalg.inv(np.eye(columns.shape[1]) - gauge @ columns)
        return Changed(matrix, self, columns, gauge, small)

    @cached_property
    def _triangles(self) -> tuple[Any, ...]:
        L, U = self.lu.L, self.lu.U
        return L.indptr, L.indices, L.data, U.indptr, U.indices, U.data


@dataclass(frozen=True, eq=False, repr=False)
class Changed(Shown):
    """Factors of `K - P G` from those of `K`, after Woodbury.

    `columns` (size, k) are `K^-1 P`, `gauge` (k, size) is `G`, `small` (k, k) the inverse of
    `1 - G K^-1 P`.
    """

    matrix: sparse.csc_array
    reference: Factor
    columns: Floats
    gauge: sparse.csr_array
    small: Floats

    def solve(self, loads: Floats, *, refine: int = REFINEMENTS) -> Floats:
        """Return motions (size,) or (size, k); refinement removes the effect of the springs."""
        return _solved(self.reference.translations, self.matrix, self.once, loads, refine)

    def once(self, loads: Floats) -> Floats:
        """Return motions under up to eight loads on the springs, without refinement."""
        v = self.reference.once(loads)
        return np.asarray(v + self.columns @ (self.small @ (self.gauge @ v)))


def _solved(
    mechanisms: Mechanisms,
    matrix: sparse.csc_array,
    once: Callable[[Floats], Floats],
    loads: Floats,
    refine: int,
) -> Floats:
    """Return solutions of `matrix`, a few at a time, by those of a matrix close to it."""
    if loads.ndim == 1:
        return _solved(mechanisms, matrix, once, loads[:, None], refine)[:, 0]
    R, L, compliance = mechanisms
    left = L @ loads
    loads = loads - R @ left
    width = WIDTH if loads.size > LOADS_BY_KERNEL else PANEL
    out = np.empty(loads.shape, order="F")
    for start in range(0, loads.shape[1], width):
        part = slice(start, start + width)
        out[:, part] = _corrected(matrix, once, loads[:, part], refine)
    out += R @ (compliance * left - L @ out)
    return out


def _corrected(
    matrix: sparse.csc_array, once: Callable[[Floats], Floats], loads: Floats, refine: int
) -> Floats:
    """Return solutions of `matrix` under up to eight loads, each refined while that halves it."""
    v = once(loads)
    goal, before = REFINED * np.linalg.norm(loads, axis=0), np.full(loads.shape[1], np.inf)
    for _ in range(refine):
        left = loads - matrix @ v
        size = np.linalg.norm(left, axis=0)
        better = (size > goal) & (size <= 0.5 * before)
        if not better.any():
            break
        before = size
        v[:, better] += once(left[:, better])
    return v


def factorised(system: System, stiffness: Floats | None = None) -> Factor:
    """Return LU factors of `K` on weak springs, anchors on stiff ones without load.

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
    return Factor(matrix, lu, system.unit, system.translations)
