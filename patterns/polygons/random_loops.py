"""Random loops, seeded: irregular, convex or not, of equal or unequal discs."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from loops import GrainGraph, InputError, polygon_centroid
from loops.arrays import Flags, Floats, Integers
from loops.validation import finite, nonnegative, positive, whole
from patterns.polygons.shapes import compressed_ring, cyclic_directions

STEPS = 60  # steps of the random walk from the polygon on a circle
WALK_ROUNDS = 50  # repeated walks for loops that are not as wanted yet
CLOSING_STEPS = 4
CLOSED = 1e-12  # largest gap of a closed loop over its perimeter
# Least turn (rad): to the left at all corners of a convex loop, to the right at one of others.
CORNER = 0.02


def random_loop(
    order: int,
    seed: int = 0,
    *,
    convex: bool = True,
    polydispersity: float = 0.0,
    strain: ArrayLike = 0.0,
    mu: float = 0.5,
    radius: float = 0.5,
    kn: float = 1.0,
    size: int | tuple[int, ...] = (),
) -> GrainGraph:
    """A random loop of barely touching discs, or a batch of them, under isotropic compression.

    A random walk in the space of closed loops starts from the discs' polygon on a circle and
    keeps to loops without overlap of grains that aren't neighbours. Branches of such a loop do not
    cross, since each is covered by its two discs. In a convex loop every corner turns left, in the
    others at least one turns right. That holds for the reference; an isotropic strain scales the
    loop, and opposite grains may then overlap: see `opposite_gap`.

    Contacts are consistent: `N = kn (r_i + r_j) strain` is `kn` times the overlap. Shear forces
    are assigned, T uniform in `(-mu N, mu N)`; the grains are not in equilibrium.

    Parameters
    ----------
    order : int
        Number of grains n, at least 3. Loops that aren't convex need room: discs of nearly one
        size have none below order 6.
    seed : int
        Seed; the same arguments give the same loops.
    convex : bool
        Convex loops, or loops with a re-entrant corner.
    polydispersity : float
        Radii are uniform in `radius (1 -+ polydispersity)`; from 0, below 1.
    strain : (...) array
        Isotropic strain `E1 = E2`, compression positive, below 1; broadcasts against `size`.
    mu : float
        Coefficient of friction that bounds T, zero or more.
    radius : float
        Mean radius (length).
    kn : float
        Normal stiffness (force per length).
    size : int or tuple of int
        Batch axes.

    Returns
    -------
    GrainGraph
        Grains counter-clockwise in any orientation, contacts (c, c+1), centroid at the origin.

    Raises
    ------
    InputError
        If an argument leaves its range, or the walk finds no such loop.

    Examples
    --------
    >>> from patterns import opposite_gap, random_loop
    >>> loops = random_loop(7, seed=1, convex=False, polydispersity=0.3, strain=0.01, size=3)
    >>> loops.batch_shape, bool((opposite_gap(loops.replace(x=loops.x0)) >= 0).all())
    ((3,), True)
    """
    order, seed = whole("order", order, 3), whole("seed", seed, 0)
    sizes = size if isinstance(size, tuple | list) else (size,)
    batch = tuple(whole("size", count, 0) for count in sizes)
    radius, mu = float(positive("radius", radius)), float(nonnegative("mu", mu))
    if not 0.0 <= finite("polydispersity", polydispersity) < 1.0:
        expected = "a number from 0, below 1"
        raise InputError("polydispersity", str(polydispersity), expected, "Change the argument.")
    rng = np.random.default_rng(seed)
    radii, directions = _draw(rng, int(np.prod(batch)), order, convex, polydispersity)
    mobilised = mu * rng.uniform(-1.0, 1.0, (*batch, order))
    sides = radii + np.roll(radii, -1, axis=-1)
    edges = sides[..., None] * np.stack([np.cos(directions), np.sin(directions)], axis=-1)
    corners = np.cumsum(edges, axis=-2) - edges
    x0 = radius * (corners - polygon_centroid(corners)[..., None, :])
    return compressed_ring(
        x0.reshape(*batch, order, 2), radius * radii.reshape(*batch, order), strain, kn, mobilised
    )


def _draw(
    rng: np.random.Generator, count: int, order: int, convex: bool, polydispersity: float
) -> tuple[Floats, Floats]:
    """Radii of mean 1 and branch directions, (count, n) each; walks are repeated until all hold."""
    radii, directions = np.empty((count, order)), np.empty((count, order))
    missing = np.arange(count)
    for _ in range(WALK_ROUNDS):
        drawn = 1.0 + polydispersity * rng.uniform(-1.0, 1.0, (len(missing), order))
        walked, good = _walk(rng, drawn, convex)
        radii[missing[good]], directions[missing[good]] = drawn[good], walked[good]
        missing = missing[~good]
        if len(missing) == 0:
            return radii, directions + rng.uniform(-np.pi, np.pi, (count, 1))
    kind = "convex" if convex else "non-convex"
    raise InputError(
        "random loop",
        f"no {kind} loop of order {order} and polydispersity {polydispersity} without overlap "
        f"of opposite grains in {WALK_ROUNDS} rounds",
        "a loop that has room",
        "Change the order, the polydispersity or the seed.",
    )


def _walk(rng: np.random.Generator, radii: Floats, convex: bool) -> tuple[Floats, Flags]:
    """Branch directions at the end of the walk, and whether they make a loop as wanted.

    Within the walk the loops are the last axis, for speed, and edges are complex numbers.
    """
    count, order = radii.shape
    sides = radii + np.roll(radii, -1, axis=-1)
    directions = cyclic_directions(sides).T.copy()
    sides, radii = sides.T.copy(), radii.T.copy()
    i, j = np.triu_indices(order, k=2)
    apart = j - i < order - 1
    pairs = (i[apart], j[apart])
    fault = _fault(directions, sides, radii, pairs, convex)
    for _ in range(STEPS):
        # A turn by a wave around each loop keeps long loops convex, unlike uncorrelated noise.
        periods = rng.integers(1, order // 2 + 1, count)
        place = 2 * np.pi * np.arange(order)[:, None] / order + rng.uniform(0, 2 * np.pi, count)
        wave = 2.0 ** -rng.uniform(0.0, 6.0, count) * np.cos(periods * place)
        trial = _closed(directions + wave, sides)
        other = _fault(trial, sides, radii, pairs, convex)
        # Accept any step where the loop is as wanted, else only steps that reduce the distance.
        accepted = (other == 0) | (other < fault)
        directions = np.where(accepted, trial, directions)
        fault = np.where(accepted, other, fault)
    return _closed(directions, sides).T, fault == 0


def _fault(
    directions: Floats, sides: Floats, radii: Floats, pairs: tuple[Integers, Integers], convex: bool
) -> Floats:
    """Distance of loops from the wanted ones: 0 if reached, inf if open or not turning once."""
    edges = sides * np.exp(1j * directions)
    closed = np.abs(edges.sum(axis=0)) <= CLOSED * sides.sum(axis=0)
    turns = np.roll(directions, -1, axis=0) - directions
    turns = np.mod(turns + np.pi, 2 * np.pi) - np.pi
    once = np.abs(turns.sum(axis=0) - 2 * np.pi) < np.pi
    sharpest = turns.min(axis=0)
    shape = np.maximum(CORNER - sharpest if convex else CORNER + sharpest, 0.0)
    corners, (i, j) = np.cumsum(edges, axis=0) - edges, pairs
    gaps = np.abs(corners[j] - corners[i]) - radii[i] - radii[j]
    overlap = np.maximum(-gaps.min(axis=0, initial=0.0), 0.0)
    return np.where(closed & once, overlap + shape, np.inf)


def _closed(directions: Floats, sides: Floats) -> Floats:
    """Nearby directions that close the loops: Newton with the smallest change."""
    for _ in range(CLOSING_STEPS):
        edges = sides * np.exp(1j * directions)
        gap, x, y = edges.sum(axis=0), edges.real, edges.imag
        # d(gap) = sum (-y, x) d(angle); least change through the 2x2 normal equations.
        a, b, c = (y * y).sum(axis=0), -(x * y).sum(axis=0), (x * x).sum(axis=0)
        det = a * c - b * b
        p, q = (c * gap.real - b * gap.imag) / det, (a * gap.imag - b * gap.real) / det
        directions = directions + y * p - x * q
    return directions
