"""Love-Weber stress, equation (47)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Floats
from loops.geometry import polygon_area, reference_volume, require_loop
from loops.graph import GrainGraph, contact_frame, reference_branch_vectors


def contact_forces(graph: GrainGraph) -> Floats:
    """Force of grain i on grain j, `f = N n + T t`.

    Parameters
    ----------
    graph : GrainGraph
        Grain graph, batch axes `...` allowed.

    Returns
    -------
    (..., C, 2) array
        Contact forces (force); pushing apart where `N > 0`.

    Examples
    --------
    >>> from loops import GrainGraph, contact_forces
    >>> pair = GrainGraph(x=[[0, 0], [1, 0]], radii=[0.5, 0.5], contacts=[[0, 1]],
    ...                   normal_force=[2.0], shear_force=[1.0])
    >>> contact_forces(pair).tolist()
    [[2.0, 1.0]]
    """
    _, n, t = contact_frame(graph)
    return _forces(graph, n, t)


def _forces(graph: GrainGraph, n: Floats, t: Floats) -> Floats:
    return graph.normal_force[..., None] * n + graph.shear_force[..., None] * t


def love_weber_stress(graph: GrainGraph, volume: ArrayLike | None = None) -> Floats:
    """Cauchy stress `sigma = (1/V) sum f (x) d` (Nicot et al. 2016, equation 47).

    Parameters
    ----------
    graph : GrainGraph
        Grain graph, batch axes `...` allowed.
    volume : (...) array, optional
        Current area V (length squared). The cell's if periodic, else the loop's polygon.

    Returns
    -------
    (..., 2, 2) array
        Stress (force per length), positive in compression; row = force, column = branch.

    Raises
    ------
    InputError
        If the volume is left out and the graph is neither periodic nor a loop.

    Examples
    --------
    >>> from loops import GrainGraph, love_weber_stress
    >>> x = [[0, 0], [1, 0], [1, 1], [0, 1]]
    >>> square = GrainGraph(x=x, radii=[0.6] * 4, contacts=[[0, 1], [1, 2], [2, 3], [3, 0]],
    ...                     normal_force=[0.2] * 4)
    >>> love_weber_stress(square).round(12).tolist()
    [[0.4, 0.0], [0.0, 0.4]]
    """
    if volume is None:
        volume = _current_volume(graph)
    length, n, t = contact_frame(graph)
    forces = _forces(graph, n, t)
    n *= length[..., None]
    return _average(forces, n, volume)


def nominal_stress(graph: GrainGraph, volume: ArrayLike | None = None) -> Floats:
    """Nominal stress `P = (1/V0) sum f (x) d0`, conjugate to the displacement gradient `H`.

    Theory, equation (4.2).

    Parameters
    ----------
    graph : GrainGraph
        Grain graph, batch axes `...` allowed.
    volume : (...) array, optional
        Reference area V0 (length squared). The cell's if periodic, else the loop's polygon.

    Returns
    -------
    (..., 2, 2) array
        Stress (force per length), positive in compression; row = force, column = reference
        branch. `P = sigma` where the reference is the current configuration.

    Raises
    ------
    InputError
        If the volume is left out and the graph is neither periodic nor a loop.
    """
    if volume is None:
        volume = reference_volume(graph)
    return _average(contact_forces(graph), reference_branch_vectors(graph), volume)


def _average(forces: Floats, branches: Floats, volume: ArrayLike) -> Floats:
    total = np.swapaxes(forces, -1, -2) @ branches
    return total / np.asarray(volume, dtype=float)[..., None, None]


def _current_volume(graph: GrainGraph) -> Floats:
    if graph.cell is not None:
        return np.abs(np.linalg.det(graph.cell))
    require_loop(graph)
    return np.abs(polygon_area(graph.x))
