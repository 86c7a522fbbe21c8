"""Hard networks: half-edges that leave a grain in nearly the same direction."""

from __future__ import annotations

import numpy as np

from loops import GrainGraph, LinearFrictional
from patterns.hard_cases.case import Scene

SPOKES = 24


def parallel_half_edges(ulps: float, pairs: int = SPOKES) -> Scene:
    """A hub whose spokes come in pairs, the directions of each pair apart by `ulps` roundings.

    Grain 2k + 1 lies on the unit circle, grain 2k + 2 twice as far out, its ordinate moved by so
    many units in the last place against the clock where the abscissa is the larger one, else its
    abscissa. The outer grain's contact comes first: an order that leaves ties as they stand gets
    every pair wrong. With the rim the pairs make `2 pairs` loops of three; half of them are
    slivers.
    """
    angle = 2.0 * np.pi * (np.arange(pairs) + 0.37) / pairs
    near = np.column_stack([np.cos(angle), np.sin(angle)])
    far = 2.0 * near
    axis = (np.abs(near[:, 0]) > np.abs(near[:, 1])).astype(int)
    rows = np.arange(pairs)
    turn = np.where(axis == 1, np.sign(near[:, 0]), -np.sign(near[:, 1]))
    far[rows, axis] += turn * ulps * np.spacing(np.abs(far[rows, axis]))
    x = np.vstack([np.zeros((1, 2)), np.stack([near, far], axis=1).reshape(-1, 2)])
    first, second = 2 * rows + 1, 2 * rows + 2
    hub = np.zeros(pairs, dtype=int)
    contacts = np.vstack(
        [
            np.column_stack([hub, second]),
            np.column_stack([hub, first]),
            np.column_stack([first, second]),
            np.column_stack([second, np.roll(first, -1)]),
        ]
    )
    graph = GrainGraph(x=x, radii=np.ones(len(x)), contacts=contacts)
    return Scene(graph, LinearFrictional(kn=1.0, kt=0.5))
