"""The boundary of a packing: a periodic cell, contacts with walls, a held outline, or none."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Flags, Floats, Integers, Regimes
from loops.assembly import contact_regime, contact_tangent
from loops.errors import InputError
from loops.faces import FaceKind, Faces
from loops.graph import ContactState, GrainGraph
from loops.laws.frictional import ContactLaw, Regime
from loops.laws.kinds import LinearFrictional
from loops.shown import Shown

BoundaryKind = Literal["free", "cell", "walls", "outline"]

# Feet on one wall: their normals and offsets agree to this share.
SAME_WALL = 1e-6
# Sine of the angle by which walls along the axes lean at most; share of a side to which they are
# flat. Files with seven digits have 1e-7.
UPRIGHT = 1e-6


@dataclass(frozen=True, eq=False, repr=False)
class PlaneContacts(Shown):
    """Contacts of grains with rigid plates.

    A plate moves with the mean strain times its place, `-H' (X - fixed)` with `X` the point of the
    plate nearest to `fixed`: it neither turns nor stretches along itself, so that its frame and its
    geometry have no stiffness.

    Attributes
    ----------
    grain : (W,) array of int
        Grain of each contact.
    branch : (W, 2) array
        From the centre of the grain to its foot on the plate (length).
    kn, kt : (W,) array
        Stiffness (force per length); `kt` is zero where nothing sticks to the wall.
    mu : (W,) array, optional
        Friction; without it a contact that has a shear stiffness never slides. Where it is zero,
        the rate problem takes no shear force into account.
    force : (W, 2) array, optional
        Force of the wall on the grain (force). Without it each pushes by its overlap, and none
        stands at its strength in the rate problem.
    sliding : (W,) array of bool, optional
        Contacts that slide, and keep to it.
    fixed : (2,) array, optional
        Point that stays in place under a strain; by default the lower left corner of the feet, as
        in paths.
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
        """Return the regime (W,) of each contact: elastic with friction, else sliding."""
        sticks = self.kt > 0
        if self.sliding is not None:
            sticks = sticks & ~self.sliding
        return np.where(sticks, Regime.ELASTIC, Regime.SLIDING).astype(np.int8)

    @property
    def friction(self) -> Floats:
        """(W,) friction; where none is known, what has a shear stiffness never slides."""
        return np.where(self.kt > 0, np.inf, 0.0) if self.mu is None else self.mu

    def to_plates(self, x: Floats) -> Floats:
        """Return (W, 2) from the centres of the grains, at `x` (G, 2), to the plates' points."""
        n = self.branch / np.linalg.norm(self.branch, axis=1, keepdims=True)
        feet = x[self.grain] + self.branch
        corner = feet.min(axis=0, initial=np.inf) if self.fixed is None else self.fixed
        aside = corner - feet
        along = aside - np.sum(aside * n, axis=1, keepdims=True) * n
        return np.asarray(self.branch + along)

    def state(self, radii: Floats) -> ContactState:
        """Return the contacts as those with grains of no radius, whose frames keep their direction.

        `radii` (G,) are those of the grains. Without given forces each pushes by its overlap.
        """
        length, touching = np.linalg.norm(self.branch, axis=1), radii[self.grain]
        n, none = self.branch / length[:, None], 0.0 * length
        t = np.column_stack([-n[:, 1], n[:, 0]])
        push = self.kn * np.maximum(touching - length, 0.0)
        force = push[:, None] * n if self.force is None else -self.force
        N, T = np.sum(force * n, axis=1), np.sum(force * t, axis=1)
        if self.mu is not None:
            T = np.where(self.mu > 0, T, 0.0)
        return ContactState(length, n, t, N, T, touching, none, self.regime, none)

    def springs(self, radii: Floats) -> Floats:
        """Return `kn`, `kt`, friction, overlaps and normal forces (5, W); `radii` (G,)."""
        at = self.state(radii)
        overlap = np.maximum(at.overlap, 0.0)
        return np.array([self.kn, self.kt, self.friction, overlap, at.normal_force])


class Walls(NamedTuple):
    """Walls of a box: normals (W, 2) into the sample, a point of each, wall of each contact, box.

    The columns of `cell` (2, 2) are the sides of the box.
    """

    normals: Floats
    points: Floats
    wall: Integers
    cell: Floats


@dataclass(frozen=True, eq=False, repr=False)
class Boundary(Shown):
    """Boundary of a packing: periodic cell, plates, or an outline of held grains.

    Make it with `boundary_of`. Forces, stresses and strains are positive in compression.

    Attributes
    ----------
    cell : (2, 2) array or None
        Vectors of the periodic cell, as columns (length); None without one.
    walls : PlaneContacts or None
        Contacts with rigid plates, and their forces; None without walls.
    held : (G,) array of bool or None
        Grains whose centres follow the mean strain, such as an outline; None if there are none.
    volume : float or None
        Area that stresses refer to (length squared); None where no stress is asked for.

    Examples
    --------
    >>> from loops import Boundary, GrainGraph, boundary_of
    >>> row = GrainGraph(x=[[0, 0], [1, 0]], radii=[0.5] * 2, contacts=[[0, 1], [1, 0]],
    ...     images=[[0, 0], [1, 0]], cell=[[2, 0], [0, 3]])
    >>> boundary_of(row).kind, boundary_of(row).volume
    ('cell', 6.0)
    >>> Boundary().kind
    'free'
    """

    cell: Floats | None = None
    walls: PlaneContacts | None = None
    held: Flags | None = None
    volume: float | None = None

    @property
    def kind(self) -> BoundaryKind:
        """Return what encloses the packing: 'cell', 'walls', 'outline', or 'free' for nothing."""
        if self.cell is not None:
            return "cell"
        if self.walls is not None and len(self.walls.grain):
            return "walls"
        return "free" if self.held is None or not self.held.any() else "outline"

    def of_kept(self, grains: Integers, count: int) -> Boundary:
        """Return the boundary of the grains that stay of `count`: contacts with walls go along."""
        number, walls = np.full(count, -1), self.walls
        number[grains] = np.arange(len(grains))
        if walls is not None:
            stays = number[walls.grain] >= 0
            own = {k: v[stays] for k, v in vars(walls).items() if v is not None and k != "fixed"}
            walls = replace(walls, **own | {"grain": number[walls.grain[stays]]})
        return replace(self, walls=walls, held=None if self.held is None else self.held[grains])

    def box(self, graph: GrainGraph) -> Walls:
        """Return the four walls along the axes that the contacts touch; they may move.

        The left and the lower wall have the lower left corner, the others the end of its sides.
        `InputError` where the contacts don't touch such walls.
        """
        normals, offsets, wall = self._planes(graph)
        axis = np.argmax(np.abs(normals), axis=1)
        ends = zip(axis, normals, offsets, strict=True)
        sides = {(int(a), bool(n[a] < 0)): offset for a, n, offset in ends}
        upright = np.abs(normals[np.arange(len(axis)), 1 - axis]) < UPRIGHT
        if len(sides) != 4 or len(normals) != 4 or not upright.all():
            listed = ", ".join(f"({n[0]:.3g}, {n[1]:.3g})" for n in normals)
            raise InputError(
                "walls",
                f"{len(normals)} with normals {listed}",
                "one wall on each side of a box along the axes: such walls keep their direction",
                "Other walls can be held, not moved; give a contact with each wall.",
            )
        corner = np.array([sides[0, False], sides[1, False]])
        end = -np.array([sides[0, True], sides[1, True]])
        upper = normals[np.arange(4), axis] < 0
        points = np.where(upper[:, None] & (axis[:, None] == [0, 1]), end, corner)
        return Walls(normals, points, wall, np.diag(end - corner))

    def standing(self, graph: GrainGraph) -> Walls:
        """Return walls of any direction, which stand still around the `volume`."""
        assert self.volume is not None
        normals, offsets, wall = self._planes(graph)
        side = float(np.ptp(graph.x, axis=0)[0]) or np.sqrt(self.volume)
        cell = np.diag([side, self.volume / side])
        return Walls(normals, offsets[:, None] * normals, wall, cell)

    def _planes(self, graph: GrainGraph) -> tuple[Floats, Floats, Integers]:
        """Return normals and offsets of the different walls, and the wall of each contact."""
        assert self.walls is not None
        distance = np.linalg.norm(self.walls.branch, axis=1)
        normal = -self.walls.branch / distance[:, None]
        offset = np.sum(normal * graph.x[self.walls.grain], axis=1) - distance
        size = float(np.abs(graph.x).max() + graph.radii.max())
        key = np.round(np.column_stack([normal, offset / size]) / SAME_WALL).astype(np.int64)
        _, first, wall = np.unique(key, axis=0, return_index=True, return_inverse=True)
        return normal[first], offset[first], wall.ravel()


def boundary_of(
    graph: GrainGraph,
    *,
    walls: PlaneContacts | None = None,
    held: ArrayLike | None = None,
    volume: float | None = None,
) -> Boundary:
    """Return the boundary of a graph: its periodic cell, or the walls or held grains given.

    Parameters
    ----------
    graph : GrainGraph
        The packing, one state.
    walls : PlaneContacts, optional
        Contacts with rigid plates.
    held : (G,) array of bool, optional
        Grains whose centres follow the mean strain, as the outline where walls aren't known.
    volume : float, optional
        Area that stresses refer to (length squared); that of the cell if left out.

    Returns
    -------
    Boundary

    Examples
    --------
    >>> from loops import GrainGraph, boundary_of
    >>> pair = GrainGraph(x=[[0, 0], [1, 0]], radii=[0.5] * 2, contacts=[[0, 1]])
    >>> boundary_of(pair, held=[True, False], volume=1.0).kind
    'outline'
    """
    if volume is None and graph.cell is not None:
        volume = float(abs(np.linalg.det(graph.cell)))
    fixed = None if held is None else np.asarray(held, dtype=bool)
    return Boundary(graph.cell, walls, fixed, volume)


def plane_contacts(
    graph: GrainGraph, grain: ArrayLike, force: ArrayLike, foot_to_centre: ArrayLike
) -> PlaneContacts:
    """Return contacts with frictionless walls, `kn` from what each carries over its overlap.

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
        Those that carry a force.

    Raises
    ------
    InputError
        If a contact pulls, or carries a force without an overlap.
    """
    who, away = np.asarray(grain, dtype=np.int64), np.asarray(foot_to_centre, dtype=float)
    given, distance = np.asarray(force, dtype=float), np.linalg.norm(away, axis=1)
    normal = np.sum(given * away, axis=1) / distance
    overlap = graph.radii[who] - distance
    closed = normal > 0
    if (normal < 0).any() or (overlap[closed] <= 0).any():
        wrong = int(np.flatnonzero((normal < 0) | (closed & (overlap <= 0)))[0])
        where, expected = f"wall contact {wrong}", "compression where the grain overlaps the wall"
        received = f"normal force {normal[wrong]:g} at an overlap of {overlap[wrong]:g}"
        raise InputError(where, received, expected, "Check the sign of forces and branches.")
    kn = normal[closed] / overlap[closed]
    none = np.zeros(len(kn))
    return PlaneContacts(who[closed], -away[closed], kn, none, none, given[closed])


def outline_grains(graph: GrainGraph, faces: Faces) -> Flags:
    """Return (G,) the grains on the outer cycle of the largest cluster, to hold without walls."""
    outer = np.flatnonzero(faces.kind == FaceKind.OUTER)
    grains = np.zeros(graph.grain_count, dtype=bool)
    if len(outer):
        face = outer[np.argmax(np.abs(faces.area[outer]))]
        grains[faces.grains[faces.offsets[face] : faces.offsets[face + 1]]] = True
    return grains


class Rows(NamedTuple):
    """All contacts of a scene in one table: between grains (C,), then with walls.

    `ends` (E, 2) are bodies: beyond the grains each contact with a wall has a body of its own,
    which follows the mean strain. `branches` (E, 2) go to the other grain, or to the point of the
    wall that does. `laws` are those of parts of the rows, `state` has the regimes known of all.
    """

    laws: tuple[tuple[ContactLaw, slice], ...]
    state: ContactState
    ends: Integers
    branches: Floats

    def each(self, ask: Callable[..., Sequence[Any]], *given: Any) -> tuple[Any, ...]:
        """Return arrays (E, ...) that a function gives for a law, its contacts and their rows."""
        found = (ask(law, self.state.take(c), *(a[c] for a in given)) for law, c in self.laws)
        return tuple(np.concatenate(parts) for parts in zip(*found, strict=True))

    def tangents(self, regimes: Regimes) -> Floats:
        """Return blocks `S` (E, 4, 4) in these regimes."""
        (blocks,) = self.each(lambda law, state, r: (contact_tangent(state, law, r),), regimes)
        return np.asarray(blocks)


def rows_of(graph: GrainGraph, law: ContactLaw, boundary: Boundary, state: ContactState) -> Rows:
    """Return the contacts of a packing, `state` with one another, then with its walls."""
    state, walls = replace(state, regime=contact_regime(state, law)), boundary.walls
    between = (law, slice(graph.contact_count))
    if walls is None:
        return Rows((between,), state, graph.contacts, graph.branches)
    increment: Any = getattr(law, "shear_increment", "branch")
    springs = LinearFrictional(walls.kn, walls.kt, walls.friction, increment)
    parts = replace(state, turns=np.ones(graph.contact_count)), walls.state(graph.radii)
    beyond = graph.grain_count + np.arange(len(walls.grain))
    return Rows(
        (between, (springs, slice(graph.contact_count, None))),
        ContactState(*(np.concatenate([getattr(of, k) for of in parts]) for k in vars(state))),
        np.concatenate([graph.contacts, np.column_stack([walls.grain, beyond])]),
        np.concatenate([graph.branches, walls.to_plates(graph.x)]),
    )
