"""Loops of grains in contact: regular, polydisperse, random, and the hexagon."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from loops import GrainGraph, InputError, polygon_centroid
from loops.arrays import Flags, Floats, Integers
from loops.errors import check_choice, number, whole_number
from loops.validation import acute_angle, finite, positive
from loops.validation import strain as compressive
from patterns.diamond.closed_form import overlap_ratio, ring_contacts, touching_ring


def compressed_ring(
    x0: Floats, radii: ArrayLike, strain: ArrayLike, kn: ArrayLike, mobilised: Floats | float = 0.0
) -> GrainGraph:
    """A barely touching ring under isotropic compression about the origin.

    The branch of contact c shrinks by the factor `1 - E`, so `N = kn (r_i + r_j) E` and no force
    in extension; written so, `N` keeps its digits at stiff grains.
    """
    compression, kn = compressive("strain", strain), positive("kn", kn)
    size = positive("radii", radii)
    touching = size + np.roll(size, -1, axis=-1)
    closed = np.maximum(compression * kn, 0.0)
    x = x0 * (1 - compression)[..., None, None]
    normal = closed[..., None] * touching
    normal = np.broadcast_to(normal, np.broadcast_shapes(normal.shape, x.shape[:-1]))
    return GrainGraph(
        x=x,
        x0=x0,
        radii=size,
        contacts=ring_contacts(x0.shape[-2]),
        normal_force=normal,
        shear_force=normal * mobilised,
    )


def opposite_gap(graph: GrainGraph) -> Floats:
    """Smallest gap between two grains that share no contact.

    Parameters
    ----------
    graph : GrainGraph
        A loop that is not periodic, batch axes `...` allowed.

    Returns
    -------
    (...) array
        Gap (length), negative where such grains overlap; inf for a triangle.

    Examples
    --------
    >>> from patterns import opposite_gap, regular_polygon
    >>> opposite_gap(regular_polygon(4, strain=[0.0, 0.3])).round(6).tolist()
    [0.414214, -0.010051]
    """
    free = np.triu(np.ones((graph.grain_count, graph.grain_count), dtype=bool), k=1)
    low, high = np.sort(graph.contacts, axis=1).T
    free[low, high] = False
    i, j = np.nonzero(free)
    d = graph.x[..., j, :] - graph.x[..., i, :]
    gap = np.hypot(d[..., 0], d[..., 1]) - graph.radii[..., i] - graph.radii[..., j]
    return np.asarray(np.min(gap, axis=-1, initial=np.inf))


Orientation = Literal["vertex", "edge"]
# Newton at least halves its distance, and ends quadratically: far more steps than needed.
HALF_ANGLE_STEPS = 200
# As alpha grows, branches (0, 1) and (3, 4) turn clockwise, (2, 3) and (5, 0) counter-clockwise;
# the graph counts T along the counter-clockwise tangent, the hexagon along growing alpha.
HEXAGON_SHEAR_SIGNS = np.array([1.0, 0.0, -1.0, 1.0, 0.0, -1.0])
AXIAL = np.array([False, True, False, False, True, False])


def regular_polygon(
    order: int,
    *,
    orientation: Orientation = "vertex",
    strain: ArrayLike = 0.0,
    radius: float = 0.5,
    kn: ArrayLike = 1.0,
) -> GrainGraph:
    """Regular equilateral loop of equal grains under isotropic compression.

    The reference is the barely touching loop, `l0 = 2 r`; the current state is scaled by
    `1 - strain`, so that `N = kn l0 strain` and `T = 0`.

    Parameters
    ----------
    order : int
        Number of grains n, at least 3.
    orientation : {'vertex', 'edge'}
        A corner on axis 1, or an edge across it.
    strain : (...) array
        Isotropic strain `E1 = E2`, compression positive, below 1; gives the batch axes.
    radius : float
        Radius of the grains (length).
    kn : (...) array
        Normal stiffness (force per length).

    Returns
    -------
    GrainGraph
        Grains counter-clockwise, contacts (c, c+1), centre of the polygon at the origin.

    Raises
    ------
    InputError
        For an order below 3, an unknown orientation or a strain that is not below 1.

    Examples
    --------
    >>> from patterns import regular_polygon
    >>> hexagon = regular_polygon(6, strain=0.1)
    >>> hexagon.x.round(12)[0].tolist(), hexagon.normal_force.round(12)[0].tolist()
    ([0.9, 0.0], 0.1)
    """
    order = whole_number("order", order, 3)
    check_choice("orientation", orientation, get_args(Orientation))
    half = np.pi / order
    angles = 2 * half * np.arange(order) + (half if orientation == "edge" else 0.0)
    number("radius", radius, 0.0, open_low=True)
    x0 = radius / np.sin(half) * np.column_stack([np.cos(angles), np.sin(angles)])
    return compressed_ring(x0, np.full(order, radius), strain, kn)


def polydisperse_polygon(
    radii: ArrayLike, *, strain: ArrayLike = 0.0, kn: ArrayLike = 1.0
) -> GrainGraph:
    """Barely touching loop of unequal discs whose centres lie on a circle.

    Branches are `r_i + r_(i+1)` long. A convex polygon on a circle with such sides always exists
    and is unique: the longest branch is shorter than its two neighbours together. The circle's
    centre lies outside the polygon where one branch is long against the others. Equal radii give
    `regular_polygon`. Opposite grains may overlap beside small grains, which is not checked: see
    `opposite_gap`.

    Parameters
    ----------
    radii : (..., n) array
        Radii of the grains in order (length, positive), n >= 3.
    strain : (...) array
        Isotropic strain `E1 = E2`, compression positive, below 1.
    kn : (...) array
        Normal stiffness (force per length).

    Returns
    -------
    GrainGraph
        Grains counter-clockwise, grain 0 in the direction of axis 1 from the circle's centre,
        contacts (c, c+1), centroid at the origin, `N = kn (r_i + r_j) strain`, `T = 0`.

    Raises
    ------
    InputError
        For fewer than three radii, or one that is not positive and finite.

    Examples
    --------
    >>> from patterns import polydisperse_polygon
    >>> from loops import contact_frame
    >>> contact_frame(polydisperse_polygon([1, 2, 1, 3]))[0].round(12).tolist()
    [3.0, 3.0, 4.0, 4.0]
    """
    size = positive("radii", radii)
    if size.ndim == 0 or size.shape[-1] < 3:
        raise InputError("radii", str(radii), "at least three positive lengths", "Correct them.")
    sides = size + np.roll(size, -1, axis=-1)
    directions = cyclic_directions(sides)
    return compressed_ring(_closed_ring(sides, directions), size, strain, kn)


def _closed_ring(sides: Floats, directions: Floats) -> Floats:
    """Corners (..., n, 2) of a polygon about its centroid."""
    edges = sides[..., None] * np.stack([np.cos(directions), np.sin(directions)], axis=-1)
    corners = np.cumsum(edges, axis=-2) - edges
    return corners - polygon_centroid(corners)[..., None, :]


def cyclic_directions(sides: Floats) -> Floats:
    """Directions of the sides of the polygon on a circle, the first corner towards axis 1.

    Half the angle `b` at the circle's centre over the longest side s solves
    `b + sum asin((s_i/s) sin b) = pi`, summed over the other sides. The left side is concave with
    the one root in (0, pi), beyond pi/2 where the centre is outside: Newton from the left stays on
    the left.
    """
    longest = np.argmax(sides, axis=-1)[..., None]
    ratio = sides / np.take_along_axis(sides, longest, axis=-1)
    other = np.arange(sides.shape[-1]) != longest
    half = np.pi / np.where(other, ratio, 1.0).sum(axis=-1, keepdims=True)
    for _ in range(HALF_ANGLE_STEPS):
        angle, slope = _half_angle(half, ratio)
        value = np.where(other, angle, half).sum(axis=-1, keepdims=True) - np.pi
        step = -value / np.where(other, slope, 1.0).sum(axis=-1, keepdims=True)
        half = half + step
        if (np.abs(step) <= 2.0 * np.finfo(float).eps * half).all():
            break
    halves = np.where(other, _half_angle(half, ratio)[0], half)
    return np.cumsum(2.0 * halves, axis=-1) - halves + 0.5 * np.pi


def _half_angle(half: Floats, ratio: Floats) -> tuple[Floats, Floats]:
    """`asin(ratio sin b)` and its slope in b, without cancellation where the ratio is near 1."""
    sine, cosine = np.sin(half), np.cos(half)
    root = np.hypot(cosine, np.sqrt((1.0 - ratio) * (1.0 + ratio)) * sine)
    return np.arctan2(ratio * sine, root), ratio * cosine / root


def hexagon(
    alpha0: ArrayLike,
    *,
    E1: ArrayLike = 0.0,
    E2: ArrayLike = 0.0,
    E_axial: ArrayLike | None = None,
    T: ArrayLike = 0.0,
    radius: ArrayLike = 0.5,
    kn: ArrayLike = 1.0,
) -> GrainGraph:
    """The hexagon of the H-model: four branches at +-alpha to axis 1, two along it.

    Grains run counter-clockwise: 0 right, 1 and 2 above, 3 left, 4 and 5 below. Contacts 1 and 4
    are axial. In the reference six equal grains barely touch, all branches `l0 = 2 radius`; at
    60 degrees it is the regular hexagon. The strains give the extent, `L_k = L_k0 (1 - E_k)`;
    under an isotropic strain `E1 = E2` the hexagon is scaled. The share of `E1` between axial and
    inclined branches is the hexagon's one inner freedom: even (the affine closure) unless
    `E_axial` is given. Normal forces follow from the positions, `N = kn (l0 - l)`; they need not
    be in balance.

    Parameters
    ----------
    alpha0 : (...) array
        Reference angle of the inclined branches to axis 1 in (0, pi/2), radians.
    E1, E2 : (...) array
        Strains of the extent below 1, compression positive.
    E_axial : (...) array, optional
        Strain of the axial branches below 1; `E1` if left out.
    T : (...) array
        Shear force in the inclined contacts, positive when alpha grows (force).
    radius : (...) array
        Radius of the grains (length).
    kn : (...) array
        Normal stiffness (force per length).

    Returns
    -------
    GrainGraph
        Centred on the origin; batch axes are the broadcast shape of the arguments.

    Raises
    ------
    InputError
        If an argument leaves its range, the strains open a contact, or the axial branches take
        up all of the length.

    Examples
    --------
    >>> import numpy as np
    >>> from patterns import hexagon
    >>> hexagon(np.pi / 3, E1=0.1, E2=0.1).normal_force.round(12).tolist()
    [0.1, 0.1, 0.1, 0.1, 0.1, 0.1]
    """
    axial = E1 if E_axial is None else E_axial
    alpha0, E1, E2, axial, T, radius, kn = np.broadcast_arrays(
        acute_angle("alpha0", alpha0),
        compressive("E1", E1),
        compressive("E2", E2),
        compressive("E_axial", axial),
        finite("T", T),
        positive("radius", radius),
        positive("kn", kn),
    )
    l0, cos, sin = 2.0 * radius, np.cos(alpha0), np.sin(alpha0)
    # Strain of the inclined branches along axis 1, from L10 E1 = 2 l0 cos(alpha0) E + l0 E_axial.
    inclined = E1 + (E1 - axial) / (2.0 * cos)
    if not (inclined < 1).all():
        received = "axial branches as long as the hexagon"
        expected = "a strain E1 that leaves room for the inclined branches"
        raise InputError("E1, E_axial", received, expected, "Compress the axial branches more.")
    overlap = np.where(AXIAL, axial[..., None], overlap_ratio(inclined, E2, alpha0)[..., None])
    x = _centres(l0 * (1 - axial), l0 * (1 - inclined) * cos, l0 * (1 - E2) * sin)
    x0, shear = _centres(l0, l0 * cos, l0 * sin), T[..., None] * HEXAGON_SHEAR_SIGNS
    return touching_ring("E1, E2, E_axial", x, x0, radius, kn, overlap, shear)


def _centres(axial: Floats, along: Floats, across: Floats) -> Floats:
    """Centres (..., 6, 2) from the axial branch and the projections of an inclined one."""
    inner, outer, zero = 0.5 * axial, 0.5 * axial + along, np.zeros_like(axial)
    x = np.stack([outer, inner, -inner, -outer, -inner, inner], axis=-1)
    y = np.stack([zero, across, across, zero, -across, -across], axis=-1)
    return np.stack([x, y], axis=-1)


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
    order, seed = whole_number("order", order, 3), whole_number("seed", seed, 0)
    sizes = size if isinstance(size, tuple | list) else (size,)
    batch = tuple(whole_number("size", count, 0) for count in sizes)
    number("radius", radius, 0.0, open_low=True)
    number("mu", mu, 0.0)
    number("kn", kn, 0.0, open_low=True)
    number("polydispersity", polydispersity, 0.0, 1.0, open_high=True)
    rng = np.random.default_rng(seed)
    # Radii of mean 1; walks are repeated until all loops are as wanted.
    count = int(np.prod(batch))
    radii, directions = np.empty((count, order)), np.empty((count, order))
    missing = np.arange(count)
    for _ in range(WALK_ROUNDS):
        drawn = 1.0 + polydispersity * rng.uniform(-1.0, 1.0, (len(missing), order))
        walked, good = _walk(rng, drawn, convex)
        radii[missing[good]], directions[missing[good]] = drawn[good], walked[good]
        missing = missing[~good]
        if len(missing) == 0:
            break
    else:
        kind = "convex" if convex else "non-convex"
        raise InputError(
            "random loop",
            f"no {kind} loop of order {order} and polydispersity {polydispersity} without overlap "
            f"of opposite grains in {WALK_ROUNDS} rounds",
            "a loop that has room",
            "Change the order, the polydispersity or the seed.",
        )
    directions += rng.uniform(-np.pi, np.pi, (count, 1))
    mobilised = mu * rng.uniform(-1.0, 1.0, (*batch, order))
    sides = radii + np.roll(radii, -1, axis=-1)
    x0 = radius * _closed_ring(sides, directions)
    return compressed_ring(
        x0.reshape(*batch, order, 2), radius * radii.reshape(*batch, order), strain, kn, mobilised
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
