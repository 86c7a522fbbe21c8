"""Stress and strain of loops and samples: Love-Weber averages, the boundary formula, fits."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Floats
from loops.errors import InputError, counted
from loops.geometry import (
    boundary_vectors,
    checked_volume,
    polygon_area,
    reference_volume,
    require_loop,
)
from loops.graph import GrainGraph, HasGraph, contact_state, graph_of
from loops.validation import real


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
    return contact_state(graph).forces


def love_weber_stress(graph: GrainGraph | HasGraph, volume: ArrayLike | None = None) -> Floats:
    """Cauchy stress `sigma = (1/V) sum f (x) d` (Nicot et al. 2016, equation 47).

    Parameters
    ----------
    graph : GrainGraph, or loop, scene or snapshot
        Grain graph, batch axes `...` allowed. `gl.stress` has the walls of a snapshot too.
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
    graph = graph_of(graph)
    if volume is None and graph.cell is not None:
        volume = np.abs(np.linalg.det(graph.cell))
    elif volume is None:
        require_loop(graph)
        volume = np.abs(polygon_area(graph.x))
    state = contact_state(graph)
    branches = state.length[..., None] * state.n
    return _average(state.forces, branches, checked_volume(volume, graph))


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
    area = reference_volume(graph) if volume is None else checked_volume(volume, graph)
    return _average(contact_forces(graph), graph.reference_branches, area)


def cauchy_rate(H: Floats, P: Floats, H_rate: Floats, P_rate: Floats) -> Floats:
    """Return the rate (2, 2) of the Cauchy stress `P F^T / det F`, `F = 1 - H`, all (2, 2)."""
    F, F_rate = np.eye(2) - H, -H_rate
    J = np.linalg.det(F)
    growth = np.trace(np.linalg.solve(F, F_rate))
    return np.asarray((P_rate @ F.T + P @ F_rate.T - growth * P @ F.T) / J)


def _average(forces: Floats, branches: Floats, volume: Floats) -> Floats:
    return np.asarray(np.swapaxes(forces, -1, -2) @ branches / volume[..., None, None])


def loop_strain(x0: ArrayLike, x: ArrayLike) -> Floats:
    """Displacement gradient of loops by the boundary formula, `H = -(1/V0) sum u_i (x) B_i`.

    `B_i` are the boundary vectors of the reference polygon. It is the mean gradient over the
    polygon of a displacement that is linear along every side; exact for an affine motion
    `x = F x0 + c`, where `H = 1 - F`. A translation of either polygon adds nothing.
    Theory, equation (4.6).

    Parameters
    ----------
    x0 : (..., n, 2) array
        Reference corners in order, either way round (length).
    x : (..., n, 2) array
        The same corners moved (length).

    Returns
    -------
    (..., 2, 2) array
        `H`, positive in compression; row = displacement, column = reference direction.

    Raises
    ------
    InputError
        If the shapes differ or a reference polygon has no area.

    Examples
    --------
    >>> import numpy as np
    >>> from loops.stress_strain import loop_strain
    >>> square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    >>> loop_strain(square, square * [0.75, 1.0]).tolist()
    [[0.25, 0.0], [0.0, 0.0]]
    """
    start = real("corners of the loops", x0, ..., None, 2)
    end = real("corners of the loops", x, *start.shape)
    area = np.abs(polygon_area(start))
    if not np.all(area > 0):
        where, received = "reference polygon of a loop", f"area {np.min(area)}"
        raise InputError(where, received, "a positive area", "The centres must not lie on a line.")
    u = (end - end[..., :1, :]) - (start - start[..., :1, :])
    return -np.swapaxes(u, -1, -2) @ boundary_vectors(start) / area[..., None, None]


def best_fit_strain(x0: ArrayLike, x: ArrayLike) -> Floats:
    """Homogeneous displacement gradient that fits the motion of grains best.

    Minimises `sum |x - c - (1 - H) x0|^2` over `H` and `c`: for a sample without a cell, whose
    walls are not known. Exact for an affine motion.

    Parameters
    ----------
    x0 : (..., G, 2) array
        Reference centres (length).
    x : (..., G, 2) array
        Centres of the same grains later (length).

    Returns
    -------
    (..., 2, 2) array
        `H`, positive in compression; row = displacement, column = reference direction.

    Raises
    ------
    InputError
        If the shapes differ or the reference centres lie on a line.

    Examples
    --------
    >>> import numpy as np
    >>> from loops.stress_strain import best_fit_strain
    >>> x0 = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    >>> best_fit_strain(x0, x0 @ [[0.75, 0.5], [0.25, 1.25]] + 3.0).round(12).tolist()
    [[0.25, -0.25], [-0.5, -0.25]]
    """
    start = real("centres", x0, ..., None, 2)
    end = real("centres", x, *start.shape)
    if start.shape[-2] < 3:
        raise InputError("centres", counted(start.shape[-2], "grain"), "at least 3", "Add grains.")
    r = start - start.mean(axis=-2, keepdims=True)
    u = end - start
    u = u - u.mean(axis=-2, keepdims=True)
    spread = np.swapaxes(r, -1, -2) @ r
    trace = np.trace(spread, axis1=-2, axis2=-1)
    # Centres on a line do not determine the gradient across it.
    if not np.all(np.linalg.det(spread) > 1e-20 * trace**2):
        raise InputError(
            "centres", "all on a line", "grains that span the plane", "Give more grains."
        )
    moment = np.swapaxes(u, -1, -2) @ r
    return -np.swapaxes(np.linalg.solve(spread, np.swapaxes(moment, -1, -2)), -1, -2)


def rotation_and_stretch(H: ArrayLike) -> tuple[Floats, Floats]:
    """Split `F = 1 - H` into a rotation and a stretch, `F = R U` (polar decomposition).

    Parameters
    ----------
    H : (..., 2, 2) array
        Displacement gradient, positive in compression, `det F > 0`.

    Returns
    -------
    angle : (...) array
        Angle of `R`, radians in (-pi, pi], counter-clockwise positive.
    strain : (..., 2, 2) array
        `1 - U`, symmetric, positive in compression; what `H` becomes without the rotation.

    Examples
    --------
    >>> import numpy as np
    >>> from loops.stress_strain import rotation_and_stretch
    >>> turned = np.array([[0.0, -1.0], [1.0, 0.0]]) @ np.diag([0.5, 1.0])
    >>> angle, strain = rotation_and_stretch(np.eye(2) - turned)
    >>> round(float(np.degrees(angle)), 12), strain.round(12).tolist()
    (90.0, [[0.5, 0.0], [0.0, 0.0]])
    """
    # 1 - U from H itself: with U from F, strains of 1e-10 would lose ten digits.
    gradient = np.asarray(H, dtype=float)
    spin = gradient[..., 0, 1] - gradient[..., 1, 0]
    trace = 2.0 - gradient[..., 0, 0] - gradient[..., 1, 1]
    angle = np.arctan2(spin, trace)
    back = rotation_minus_one(-angle)
    strain = gradient + back @ gradient - back
    return angle, 0.5 * (strain + np.swapaxes(strain, -1, -2))


def turning_change(P: Floats, dP: Floats, H: Floats) -> tuple[Floats, Floats]:
    """Return `R^T (P + dP) - P` and `1 - U`: changes in the frame that turns with `1 - H = R U`."""
    angle, strain = rotation_and_stretch(H)
    return dP + rotation_minus_one(-angle) @ (P + dP), strain


def rotation_minus_one(angle: ArrayLike) -> Floats:
    """`R - 1` of rotations by `angle`, to full relative precision for small ones."""
    turn = np.asarray(angle, dtype=float)
    s, versine = np.sin(turn), 2.0 * np.sin(0.5 * turn) ** 2
    return np.stack([np.stack([-versine, -s], axis=-1), np.stack([s, -versine], axis=-1)], axis=-2)
