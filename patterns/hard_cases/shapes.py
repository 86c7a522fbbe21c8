"""Hard shapes: flat, steep and squashed loops, unequal and coincident grains, many grains."""

from __future__ import annotations

import numpy as np

from loops import GrainGraph, LinearFrictional, Regime
from patterns.diamond import diamond
from patterns.hard_cases.case import Scene
from patterns.polygons import polydisperse_polygon, regular_polygon

LAW = LinearFrictional(kn=1.0, kt=0.3, mu=0.5)


def flat_diamond(alpha0: float) -> Scene:
    """Diamond with a branch angle close to zero."""
    return Scene(diamond(alpha0, E1=0.1, E2=0.1, T=0.01), LAW)


def steep_diamond(gap: float) -> Scene:
    """Diamond with a branch angle short of 90 degrees by `gap`."""
    return Scene(diamond(0.5 * np.pi - gap, E1=0.1, E2=0.1, T=0.01), LAW)


def squashed_hexagon(height: float) -> Scene:
    """Hexagon flattened to `height`: all branches nearly on one line."""
    ring = regular_polygon(6, strain=0.05)
    flat = np.array([1.0, height])
    return Scene(ring.replace(x=ring.x * flat, x0=ring.x0 * flat), LAW)


def unequal_sizes(ratio: float) -> Scene:
    """Pentagon with one grain smaller than the others by `ratio`."""
    radii = 0.5 * np.array([1.0, 1.0 / ratio, 1.1, 0.9, 1.2])
    return Scene(polydisperse_polygon(radii, strain=0.05), LAW)


def coincident_grains(distance: float) -> Scene:
    """Pentagon with the centre of grain 1 at `distance` from that of grain 0."""
    ring = regular_polygon(5, strain=0.05)
    x = ring.x.copy()
    x[1] = x[0] + np.array([0.0, distance])
    d = np.roll(x, -1, axis=0) - x
    overlap = np.maximum(1.0 - np.hypot(d[:, 0], d[:, 1]), 0.0)
    graph = GrainGraph(x, ring.radii, ring.contacts, normal_force=overlap)
    # Flagged in contact: the branch that grew longer stays.
    return Scene(graph, LAW, regime=np.full(5, Regime.ELASTIC))


def ring_of(order: float) -> Scene:
    """Regular ring, compressed between the thresholds of the triangle and of longer loops."""
    return Scene(regular_polygon(int(order), strain=0.25), LAW)


def freely_rolling(order: float) -> Scene:
    """Regular ring with free spins; every even one has the gear mode."""
    return Scene(regular_polygon(int(order), strain=0.1), LAW, spins="free")
