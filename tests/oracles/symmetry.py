"""Symmetry of a loop alone, without a path."""

import numpy as np

from loops.symmetry import identity, point_group


def loop_symmetry(graph, even=(), odd=()):
    """Point group of a loop's state: centres, reference, radii and forces."""
    if graph.cell is not None or graph.batch_shape:
        return identity(graph.grain_count, len(graph.contacts))
    N, T = graph.normal_force, graph.shear_force
    force = max(float(np.abs(N).max(initial=0.0)), float(np.abs(T).max(initial=0.0))) or 1.0
    return point_group(
        [graph.x, graph.x0],
        graph.contacts,
        graph.radii,
        even=[N / force, *even],
        odd=[T / force, *odd],
    )
