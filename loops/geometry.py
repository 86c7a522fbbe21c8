"""Geometry of the polygon that a loop's centres form."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Floats, as_complex
from loops.errors import InputError
from loops.graph import GrainGraph
from loops.validation import fits, positive


def polygon_area(x: Floats) -> Floats:
    """Signed area of polygons, positive if counter-clockwise.

    Parameters
    ----------
    x : (..., n, 2) array
        Corners in order (length).

    Returns
    -------
    (...) array
        Area (length squared).

    Examples
    --------
    >>> import numpy as np
    >>> from loops import polygon_area
    >>> float(polygon_area(np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])))
    1.0
    """
    # Corners relative to the first one: no cancellation far from the origin.
    r = x - x[..., :1, :]
    return 0.5 * np.sum(_cross(r, np.roll(r, -1, axis=-2)), axis=-1)


def area_growth(x: Floats) -> Floats:
    """(...) sum of the sizes of the terms of `polygon_area` over the area: large if flat."""
    r = from_centroid(x)
    s = np.roll(r, -1, axis=-2)
    terms = np.abs(r[..., 0] * s[..., 1]) + np.abs(r[..., 1] * s[..., 0])
    with np.errstate(divide="ignore"):
        return 0.5 * terms.sum(axis=-1) / np.abs(polygon_area(x))


def from_centroid(x: Floats) -> Floats:
    """(..., n, 2) corners relative to the centroid of the polygon, wherever it lies."""
    r = x - x[..., :1, :]
    return r - polygon_centroid(r)[..., None, :]


def polygon_perimeter(x: Floats) -> Floats:
    """Perimeter of polygons.

    Parameters
    ----------
    x : (..., n, 2) array
        Corners in order (length).

    Returns
    -------
    (...) array
        Perimeter (length).

    Examples
    --------
    >>> import numpy as np
    >>> from loops import polygon_perimeter
    >>> float(polygon_perimeter(np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])))
    4.0
    """
    edges = np.roll(x, -1, axis=-2) - x
    return np.hypot(edges[..., 0], edges[..., 1]).sum(axis=-1)


def polygon_centroid(x: Floats) -> Floats:
    """Centroid of the area of polygons.

    Parameters
    ----------
    x : (..., n, 2) array
        Corners in order (length).

    Returns
    -------
    (..., 2) array
        Centroid (length); not finite if the area is zero.

    Examples
    --------
    >>> import numpy as np
    >>> from loops import polygon_centroid
    >>> polygon_centroid(np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])).tolist()
    [0.5, 0.5]
    """
    first = x[..., 0, :]
    r = x - x[..., :1, :]
    following = np.roll(r, -1, axis=-2)
    weight = _cross(r, following)
    with np.errstate(divide="ignore", invalid="ignore"):
        moment = np.einsum("...n,...nk->...k", weight, r + following)
        return first + moment / (3 * weight.sum(axis=-1))[..., None]


def polygon_shape(x: Floats) -> tuple[Floats, Floats]:
    """Elongation and orientation of polygons, from the second moment of their area.

    Parameters
    ----------
    x : (..., n, 2) array
        Corners in order (length).

    Returns
    -------
    elongation : (...) array
        Ratio of the long to the short principal axis of the equivalent ellipse, at least 1.
    orientation : (...) array
        Angle of the long axis to axis 1, in radians in (-pi/2, pi/2].

    Examples
    --------
    >>> import numpy as np
    >>> from loops import polygon_shape
    >>> elongation, orientation = polygon_shape(np.array([[0.0, 0], [3, 0], [3, 1], [0, 1]]))
    >>> round(float(elongation), 12), float(orientation)
    (3.0, 0.0)
    """
    z = as_complex(from_centroid(x))
    s = np.roll(z, -1, axis=-1)
    # Sums over the triangles (0, z, s) of 24 times the mean moment and, turned, its deviation; a
    # clockwise polygon has negative ones.
    weight = (z.conj() * s).imag
    size = np.sum(weight * (np.abs(z) ** 2 + np.abs(s) ** 2 + (z.conj() * s).real), axis=-1)
    turned = np.sign(size) * np.sum(weight * (z * z + z * s + s * s), axis=-1) + 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        elongation = np.sqrt((np.abs(size) + np.abs(turned)) / (np.abs(size) - np.abs(turned)))
    return elongation, 0.5 * np.angle(turned)


def boundary_vectors(x: Floats) -> Floats:
    """Boundary vectors `B_i`: half the sum of the outward edge vectors that meet at corner i.

    `B_i = R (x_{i+1} - x_{i-1})/2`, where R turns an edge into its outward normal. A uniform
    stress `P` (compression positive) loads corner i by `-P B_i`, and the displacement gradient of
    the polygon is `-(1/V0) sum u_i (x) B_i`. Theory, equation (4.5).

    Parameters
    ----------
    x : (..., n, 2) array
        Corners in order, either way round (length).

    Returns
    -------
    (..., n, 2) array
        Boundary vectors (length); they sum to zero.

    Examples
    --------
    >>> import numpy as np
    >>> from loops import boundary_vectors
    >>> boundary_vectors(np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])).tolist()
    [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]
    """
    return outward(x, 0.5 * (np.roll(x, -1, axis=-2) - np.roll(x, 1, axis=-2)))


def outward(x: Floats, edges: Floats) -> Floats:
    """Turn edge vectors of a polygon by 90 degrees, outward."""
    side = np.where(polygon_area(x) < 0, -1.0, 1.0)[..., None, None]
    return side * np.stack([edges[..., 1], -edges[..., 0]], axis=-1)


def reference_volume(graph: GrainGraph) -> Floats:
    """Reference volume `V0` (an area): of the cell if periodic, else of the loop's polygon.

    Parameters
    ----------
    graph : GrainGraph
        A loop, or a periodic packing; batch axes `...` allowed.

    Returns
    -------
    (...) array
        Area in the reference configuration (length squared).

    Raises
    ------
    InputError
        If the graph is neither, or its area is zero.
    """
    if graph.cell0 is not None:
        volume = np.abs(np.linalg.det(graph.cell0))
    else:
        require_loop(graph)
        volume = np.abs(polygon_area(graph.x0))
    return checked_volume(volume, graph)


def volume_growth(graph: GrainGraph) -> Floats:
    """(...) factor by which rounding is amplified in `reference_volume`."""
    if graph.cell0 is None:
        return area_growth(graph.x0)
    a = np.abs(graph.cell0)
    terms = a[..., 0, 0] * a[..., 1, 1] + a[..., 0, 1] * a[..., 1, 0]
    return np.asarray(terms / np.abs(np.linalg.det(graph.cell0)))


def checked_volume(volume: ArrayLike, graph: GrainGraph) -> Floats:
    """The volume as an array, or `InputError` unless positive and of the graph's states."""
    area = positive("volume", volume)
    if not fits(area.shape, graph.batch_shape, 1):
        expected = "a number, or one for each state of the graph"
        raise InputError("volume", f"shape {area.shape}", expected, "Correct volume.")
    return area


def require_loop(graph: GrainGraph) -> None:
    """Raise `InputError` unless contacts 0..n-1 are the ring 0-1-2-...-0; chords may follow."""
    n = graph.grain_count
    ring = np.column_stack([np.arange(n), np.roll(np.arange(n), -1)])
    contacts = graph.contacts[:n]
    if n >= 3 and len(contacts) == n and np.array_equal(contacts, ring):
        return
    wrong = np.flatnonzero((contacts != ring[: len(contacts)]).any(axis=1))
    c = int(wrong[0]) if len(wrong) else len(contacts)
    received = f"grains {contacts[c].tolist()}" if c < len(contacts) else "nothing"
    expected = f"grains [{c % n}, {(c + 1) % n}]: at least 3 grains in order, chords after the ring"
    remedy = "Order it by gl.loop(graph, law=law); a packing needs volume= and the affine closure."
    raise InputError(f"contact {c} of a loop of {n} grains", received, expected, remedy)


def _cross(a: Floats, b: Floats) -> Floats:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
