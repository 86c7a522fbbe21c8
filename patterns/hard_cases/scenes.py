"""Scenes to compute with: hard shapes, hard laws and forces, networks that are hard to walk."""

from __future__ import annotations

import numpy as np

from loops import GrainGraph, LinearFrictional, Regime
from patterns.diamond import diamond
from patterns.hard_cases.case import Scene
from patterns.polygons import polydisperse_polygon, regular_polygon

KAPPA, MU = 0.3, 0.5
LAW = LinearFrictional(kn=1.0, kt=KAPPA, mu=MU)
RADII = (0.5, 0.6, 0.45, 0.55, 0.5, 0.4)
SPOKES = 24
# kappa and friction of Table 1 of Nicot et al. 2016.
KAPPA_1, MU_1 = 0.2, float(np.tan(np.radians(5.0)))


def on_diamond(
    strain: float, kappa: float = KAPPA, mu: float = MU, T: float = 0.0, alpha0: float = 0.6
) -> Scene:
    """Diamond under an isotropic strain, and a shear force."""
    return Scene(diamond(alpha0, E1=strain, E2=strain, T=T), LinearFrictional(1.0, kappa, mu))


def path_of_diamond(
    strain: float,
    programme: str,
    quantity: str,
    end: float,
    alpha0: float = 0.25 * np.pi,
    kappa: float = KAPPA_1,
) -> Scene:
    """A path from an isotropic strain on."""
    start, law = diamond(alpha0, E1=strain, E2=strain), LinearFrictional(1.0, kappa, MU_1)
    return Scene(start, law, stages=((programme, quantity, end),))


def all_yield_at_once(shear: float) -> Scene:
    """Table 1 from A, the four contacts carrying a little shear, each its own, at the start."""
    scene = path_of_diamond(0.3, "drained_biaxial", "H11", 0.42)
    own = scene.graph.replace(shear_force=shear * np.array([1.0, -0.5, 0.25, 0.75]))
    return Scene(own, scene.law, stages=scene.stages)


def mobilised_diamond(strain: float, mobilised: float) -> Scene:
    """Diamond with `|T| = mobilised mu N`, of either sign."""
    loaded = diamond(0.6, E1=strain, E2=strain)
    signs = np.array([1.0, -1.0, 1.0, -1.0])
    return Scene(loaded.replace(shear_force=MU * loaded.normal_force * mobilised * signs), LAW)


def loaded_hexagon(strain: float, mobilised: float) -> Scene:
    """Irregular hexagon of overlap `strain` with `|T| = mobilised mu N`."""
    ring = polydisperse_polygon(RADII, strain=strain)
    sides = np.array([1.0, 1.0, -1.0, 1.0, -1.0, -1.0])
    return Scene(ring.replace(shear_force=mobilised * MU * sides * ring.normal_force), LAW)


def squashed_hexagon(height: float) -> Scene:
    """Hexagon flattened to `height`: all branches nearly on one line."""
    ring = regular_polygon(6, strain=0.05)
    flat = np.array([1.0, height])
    return Scene(ring.replace(x=ring.x * flat, x0=ring.x0 * flat), LAW)


def ring_with(order: int, kt: float) -> Scene:
    """Regular ring whose first contact has a shear stiffness of its own."""
    own = np.append(kt, np.full(order - 1, KAPPA))
    return Scene(regular_polygon(order, strain=0.1), LinearFrictional(1.0, own, MU))


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
    one, two = [hub, hub, first, second], [second, first, second, np.roll(first, -1)]
    contacts = np.stack([np.concatenate(one), np.concatenate(two)], axis=1)
    graph = GrainGraph(x=x, radii=np.ones(len(x)), contacts=contacts)
    return Scene(graph, LinearFrictional(kn=1.0, kt=0.5))
