"""Random irregular loops, seeded: star-shaped, unequal radii, forces assigned."""

import numpy as np

from loops import GrainGraph


def random_rings(
    rng: np.random.Generator, count: int, order: int, *, overlap: float = 0.05, mu: float = 0.5
) -> GrainGraph:
    """`count` loops of one order with |T| < mu N and N/l about `overlap` (kn = 1)."""
    angles = 2 * np.pi * (np.arange(order) + rng.uniform(-0.3, 0.3, (count, order))) / order
    distance = rng.uniform(0.8, 1.2, (count, order))
    x = distance[..., None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    edges = np.roll(x, -1, axis=1) - x
    length = np.hypot(edges[..., 0], edges[..., 1])
    normal = overlap * length * rng.uniform(0.2, 1.8, (count, order))
    # Radii longer than any branch asks for: the forces are assigned, not the overlaps.
    return GrainGraph(
        x=x,
        radii=length.max(axis=1, keepdims=True) * rng.uniform(0.55, 0.9, (count, order)),
        contacts=ring(order),
        normal_force=normal,
        shear_force=mu * normal * rng.uniform(-0.95, 0.95, (count, order)),
    )


def ring(order: int) -> np.ndarray:
    """Contacts (c, c+1) of a ring."""
    return np.column_stack([np.arange(order), np.roll(np.arange(order), -1)])


def through(corners, normal_force, shear_force) -> GrainGraph:
    """The ring through corners, under these forces."""
    n = len(corners)
    return GrainGraph(corners, np.ones(n), ring(n), normal_force, shear_force)


def member(graph: GrainGraph, k: int, **changes) -> GrainGraph:
    """The `k`-th loop of a batch."""
    names = ("x", "x0", "radii", "normal_force", "shear_force")
    picked = {name: getattr(graph, name)[k] for name in names if getattr(graph, name).ndim > 1}
    return GrainGraph(**{"contacts": graph.contacts, "radii": graph.radii, **picked, **changes})


def slide(rng: np.random.Generator, graph: GrainGraph, share: float, mu: float = 0.5):
    """Put a share of the contacts on the yield surface; return the graph and the regimes."""
    sliding = rng.random(graph.normal_force.shape) < share
    side = np.where(graph.shear_force < 0, -1.0, 1.0)
    shear = np.where(sliding, side * mu * graph.normal_force, graph.shear_force)
    return graph.replace(shear_force=shear), np.where(sliding, 2, 1)
