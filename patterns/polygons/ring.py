"""What the polygons share: contacts of a ring, isotropic compression, checks of the outline."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from loops import GrainGraph
from loops.arrays import Flags, Floats, Integers
from patterns.arguments import positive
from patterns.arguments import strain as compressive

# Closer to a branch than this share of the longest branch, a centre lies on it.
ON_BRANCH = 1e-12


def ring_contacts(order: int) -> Integers:
    """(n, 2) contacts (c, c + 1) of a ring of n grains."""
    return np.column_stack([np.arange(order), np.roll(np.arange(order), -1)])


def compressed_ring(
    x0: Floats, radii: ArrayLike, strain: ArrayLike, kn: ArrayLike, mobilised: ArrayLike = 0.0
) -> GrainGraph:
    """A barely touching ring under isotropic compression about the origin.

    The branch of contact c shrinks by the factor `1 - E`, so `N = kn (r_i + r_j) E` and no force
    in extension; written so, `N` keeps its digits at stiff grains.
    """
    compression, kn = compressive("strain", strain), positive("kn", kn)
    size = np.asarray(radii, dtype=float)
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


def is_simple(x: Floats) -> Flags:
    """Whether polygons (..., n, 2) neither cross nor touch themselves.

    No two sides cross, and no corner lies on a side that it doesn't end.
    """
    n = x.shape[-2]
    edge = np.roll(x, -1, axis=-2) - x
    length = np.hypot(edge[..., 0], edge[..., 1])
    # side[..., e, v]: on which side of side e the corner v lies; along: where on it.
    to = x[..., None, :, :] - x[..., :, None, :]
    side = edge[..., :, None, 0] * to[..., 1] - edge[..., :, None, 1] * to[..., 0]
    along = np.einsum("...ek,...evk->...ev", edge, to) / length[..., :, None] ** 2
    beyond = (along - np.clip(along, 0.0, 1.0)) * length[..., :, None]
    distance = np.hypot(side / length[..., :, None], beyond)
    ends = np.eye(n, dtype=bool) | np.roll(np.eye(n, dtype=bool), 1, axis=1)
    touches = ~ends & (distance <= ON_BRANCH * length.max(axis=-1)[..., None, None])
    astride = side * np.roll(side, -1, axis=-1) < 0
    crosses = astride & np.swapaxes(astride, -1, -2)
    return ~(touches | crosses).any(axis=(-2, -1))
