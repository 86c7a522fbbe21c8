"""Regular polygons of equal grains."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from loops import GrainGraph, InputError
from patterns.polygons.ring import compressed_ring

Orientation = Literal["vertex", "edge"]


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
    `1 - strain`, so that `N = kn l0 strain` and `T = 0` (theory note, section 7).

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
    if int(order) != order or order < 3:
        raise InputError("order", str(order), "a whole number of at least 3", "Give more grains.")
    if orientation not in get_args(Orientation):
        raise InputError(
            "orientation", repr(orientation), "'vertex' or 'edge'", "Pick one of these."
        )
    half = np.pi / order
    angles = 2 * half * np.arange(order) + (half if orientation == "edge" else 0.0)
    x0 = radius / np.sin(half) * np.column_stack([np.cos(angles), np.sin(angles)])
    return compressed_ring(x0, np.full(order, radius), strain, kn)
