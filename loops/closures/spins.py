"""Spin rules: what the grains' spins do while the loop is driven."""

from __future__ import annotations

import numpy as np

from loops.arrays import Floats
from loops.graph import GrainGraph, branch_vectors, reference_branch_vectors


def deformation_gradient(graph: GrainGraph) -> Floats:
    """Mean deformation gradient F of the current state, `d = F d0`.

    Taken from the cells if periodic, else by least squares over the branches; exact for a state
    that was reached affinely.

    Parameters
    ----------
    graph : GrainGraph
        Grain graph, batch axes `...` allowed.

    Returns
    -------
    (..., 2, 2) array
        Dimensionless; the identity if the reference is the current configuration.
    """
    if graph.cell is not None and graph.cell0 is not None:
        return graph.cell @ np.linalg.inv(graph.cell0)
    d, d0 = branch_vectors(graph), reference_branch_vectors(graph)
    pair = np.swapaxes(d0, -1, -2) @ d0
    return np.swapaxes(d, -1, -2) @ d0 @ np.linalg.inv(pair)


def affine_spin(graph: GrainGraph) -> Floats:
    """Spin of the loop per component of `H'`: the rotation rate of the velocity gradient.

    `L = -H' F^-1` and `w = (L21 - L12)/2`, counter-clockwise positive.

    Parameters
    ----------
    graph : GrainGraph
        Grain graph, batch axes `...` allowed.

    Returns
    -------
    (..., 4) array
        `w = row . (H11, H12, H21, H22)`.

    Examples
    --------
    >>> from loops import GrainGraph
    >>> from loops.closures.spins import affine_spin
    >>> triangle = GrainGraph(x=[[0, 0], [1, 0], [0, 1]], radii=[0.5] * 3,
    ...                       contacts=[[0, 1], [1, 2], [2, 0]])
    >>> (affine_spin(triangle).round(12) + 0.0).tolist()
    [0.0, 0.5, -0.5, 0.0]
    """
    inverse = np.linalg.inv(deformation_gradient(graph))
    return 0.5 * np.stack(
        [inverse[..., 0, 1], inverse[..., 1, 1], -inverse[..., 0, 0], -inverse[..., 1, 0]],
        axis=-1,
    )
