"""Polar data of the second-order work at the named states of a path."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stability import RTOL, PolarDiagram, polar_diagram
from stability.spectra import operator_norm
from studies.diamond.path import DiamondPath

Floats = NDArray[np.float64]
DIRECTIONS = 720
RADIUS = 2.0


def settled_diagram(K: Floats) -> PolarDiagram:
    """Polar diagrams with `w2 = 0` along directions that K annuls within the tolerance.

    Where det K vanishes, round-off alone decides the sign of w2 in the kernel of K.

    Parameters
    ----------
    K : ndarray (..., 2, 2)
        Tangents.

    Returns
    -------
    PolarDiagram
        Of `DIRECTIONS` directions and radius 2.

    Examples
    --------
    >>> import numpy as np
    >>> from studies.diamond.polar import settled_diagram
    >>> diagram = settled_diagram(np.array([[1.0 + 2e-16, 1.0], [1.0, 1.0]]))
    >>> float(diagram.work.min())
    0.0
    """
    diagram = polar_diagram(K, r=RADIUS, directions=DIRECTIONS)
    stress = np.einsum("...ij,nj->...ni", K, diagram.direction)
    annulled = np.linalg.norm(stress, axis=-1) <= RTOL * operator_norm(K)[..., None]
    work = np.where(annulled, 0.0, diagram.work)
    outward = np.stack([np.cos(diagram.angle), np.sin(diagram.angle)], axis=-1)
    points = (RADIUS + work)[..., None] * outward
    return PolarDiagram(diagram.angle, diagram.direction, work, points)


def polar_table(path: DiamondPath) -> dict[str, Any]:
    """Normalised second-order work in every direction at the named states (45).

    Parameters
    ----------
    path : DiamondPath
        From `follow`.

    Returns
    -------
    dict of str to array
        `state`; `alphaE_deg`, `tan(alphaE) = E1'/E2'`; `w2`; `x, y`, the points of the polar
        diagram, `(2 + w2) (cos alphaE, sin alphaE)`.
    """
    names = list(path.marks)
    diagram = settled_diagram(path.operators.K[list(path.marks.values())])
    return {
        "state": np.repeat(np.array(names, dtype=str), DIRECTIONS),
        "alphaE_deg": np.tile(np.degrees(diagram.angle), len(names)),
        "w2": diagram.work.ravel(),
        "x": diagram.points[..., 0].ravel(),
        "y": diagram.points[..., 1].ravel(),
    }
