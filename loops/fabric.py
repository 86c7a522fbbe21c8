"""Fabric of a packing: how its contacts and its loops are oriented."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Floats
from loops.errors import InputError
from loops.faces import Faces

TENSORS_AT_ONCE = 2**14  # tensors at a time


class TensorMean(NamedTuple):
    """Weighted mean of symmetric tensors, their standard deviation and number."""

    mean: Floats
    std: Floats
    number: int


def mean_tensor(tensors: ArrayLike, weights: ArrayLike | None = None) -> TensorMean:
    """Weighted mean and standard deviation of symmetric tensors, component by component.

    Parameters
    ----------
    tensors : (L, 2, 2) array
        Tensors.
    weights : (L,) array, optional
        Weights, not negative; all alike if left out.

    Returns
    -------
    TensorMean
        Not a number where there is nothing to average.

    Examples
    --------
    >>> from loops.fabric import mean_tensor
    >>> mean, std, number = mean_tensor([[[1, 0], [0, 0]], [[0, 0], [0, 1]]])
    >>> mean.tolist(), std.tolist(), number
    ([[0.5, 0.0], [0.0, 0.5]], [[0.5, 0.0], [0.0, 0.5]], 2)
    """
    values = np.asarray(tensors, dtype=float).reshape(-1, 4)
    weight = np.ones(len(values)) if weights is None else np.asarray(weights, dtype=float)
    total = weight.sum()
    if not total > 0:
        return TensorMean(np.full((2, 2), np.nan), np.full((2, 2), np.nan), len(values))
    mean, square = weight @ values / total, np.zeros(4)
    for part in _blocks(len(values)):
        apart = values[part] - mean
        square += weight[part] @ (apart * apart)
    std = np.sqrt(square / total)
    return TensorMean(mean.reshape(2, 2), std.reshape(2, 2), len(values))


def _blocks(count: int) -> Iterator[slice]:
    """Slices of so many tensors that temporary arrays stay in the cache."""
    for start in range(0, count, TENSORS_AT_ONCE):
        yield slice(start, min(start + TENSORS_AT_ONCE, count))


def direction_tensors(vectors: ArrayLike) -> Floats:
    """Tensors of directions, `v (x) v / |v|^2`; of branches their mean is Satake's fabric tensor.

    Parameters
    ----------
    vectors : (..., 2) array
        Vectors, none of them zero.

    Returns
    -------
    (..., 2, 2) array
        Symmetric tensors of trace 1.

    Examples
    --------
    >>> from loops.fabric import direction_tensors
    >>> direction_tensors([3.0, 0.0]).tolist()
    [[1.0, 0.0], [0.0, 0.0]]
    """
    v = np.asarray(vectors, dtype=float)
    tensors = np.empty((*v.shape, 2))
    flat, out = v.reshape(-1, 2), tensors.reshape(-1, 4)
    for part in _blocks(len(flat)):
        x, y = flat[part].T.copy()
        square = x * x + y * y
        out[part, 0], out[part, 3] = x * x / square, y * y / square
        out[part, 1] = out[part, 2] = x * y / square
    return tensors


def edge_tensors(branches: ArrayLike, faces: Faces) -> Floats:
    """Shape of each loop by its edges: `sum e (x) e / sum |e|^2` over the branches around it.

    Half the unit tensor for every regular polygon, so only the shape counts, neither the size nor
    the order of a loop.

    Parameters
    ----------
    branches : (C, 2) array
        Branch vectors of the packing (length), from `branch_vectors`.
    faces : Faces
        Its faces, from `find_faces`.

    Returns
    -------
    (L, 2, 2) array
        Symmetric tensors of trace 1, in the order of `faces.loops`.

    Examples
    --------
    >>> from loops import GrainGraph, branch_vectors, find_faces
    >>> from loops.fabric import edge_tensors
    >>> oblong = GrainGraph(x=[[0, 0], [3, 0], [3, 1], [0, 1]], radii=[1.6] * 4,
    ...                     contacts=[[0, 1], [1, 2], [2, 3], [3, 0]])
    >>> edge_tensors(branch_vectors(oblong), find_faces(oblong)).round(12).tolist()
    [[[0.9, 0.0], [0.0, 0.1]]]
    """
    if len(faces.loops) == 0:
        return np.empty((0, 2, 2))
    d = np.asarray(branches, dtype=float)
    sums = np.empty((len(faces.kind), 3))
    cuts = np.searchsorted(faces.offsets, np.arange(0, faces.offsets[-1], TENSORS_AT_ONCE))
    for start, stop in pairwise(np.unique(np.append(cuts, len(sums))).tolist()):
        begin, end = faces.offsets[start], faces.offsets[stop]
        # The sign of an edge doesn't matter.
        x, y = d[faces.contacts[begin:end]].T.copy()
        for column, product in enumerate((x * x, x * y, y * y)):
            sums[start:stop, column] = np.add.reduceat(product, faces.offsets[start:stop] - begin)
    sums = sums[faces.loops]
    sums /= (sums[:, 0] + sums[:, 2])[:, None]
    return sums[:, [0, 1, 1, 2]].reshape(-1, 2, 2)


def principal(tensor: ArrayLike) -> tuple[Floats, Floats]:
    """Anisotropy of symmetric tensors and the direction of their larger principal value.

    Parameters
    ----------
    tensor : (..., 2, 2) array
        Tensors; their symmetric part is taken.

    Returns
    -------
    anisotropy : (...) array
        Difference of the principal values; of a fabric tensor from 0 to 1, and half the amplitude
        `a` of the density of directions `(1 + a cos 2(theta - direction))/(2 pi)`, which is the
        Fourier series of second order.
    direction : (...) array
        Angle to axis 1, radians in (-pi/2, pi/2]; 0 where the tensor is isotropic.

    Raises
    ------
    InputError
        If the tensors are not 2 by 2.

    Examples
    --------
    >>> from loops.fabric import principal
    >>> [float(value) for value in principal([[0.25, 0.0], [0.0, 0.75]])]
    [0.5, 1.5707963267948966]
    """
    s = np.asarray(tensor, dtype=float)
    if s.shape[-2:] != (2, 2):
        raise InputError("tensor", f"shape {s.shape}", "(..., 2, 2)", "Give tensors of the plane.")
    # + 0.0 turns -0.0 into 0.0, which would be -90 degrees.
    difference, shear = s[..., 0, 0] - s[..., 1, 1], s[..., 0, 1] + s[..., 1, 0] + 0.0
    return np.hypot(difference, shear), 0.5 * np.arctan2(shear, difference)


def axial_mean(angles: ArrayLike, weights: ArrayLike | None = None) -> tuple[float, float]:
    """Mean of axes, which are the same turned by 180 degrees: by doubled angles.

    Parameters
    ----------
    angles : (L,) array
        Angles of the axes (radians).
    weights : (L,) array, optional
        Weights; all alike if left out.

    Returns
    -------
    direction : float
        Mean axis, radians in (-pi/2, pi/2]; not a number without angles.
    resultant : float
        From 0, no axis preferred, to 1, all alike.

    Examples
    --------
    >>> import numpy as np
    >>> from loops.fabric import axial_mean
    >>> direction, resultant = axial_mean(np.radians([80.0, -80.0]))
    >>> round(float(np.degrees(abs(direction))), 9), round(resultant, 9)
    (90.0, 0.939692621)
    """
    angle = np.asarray(angles, dtype=float)
    weight = np.ones(len(angle)) if weights is None else np.asarray(weights, dtype=float)
    if not weight.sum() > 0:
        return float("nan"), float("nan")
    mean = np.array([weight @ np.cos(2 * angle), weight @ np.sin(2 * angle)]) / weight.sum()
    return float(0.5 * np.arctan2(mean[1], mean[0])), float(np.hypot(*mean))
