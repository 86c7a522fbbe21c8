"""Scenes to compute with: hard shapes, hard laws and forces, networks that are hard to walk."""

from __future__ import annotations

import numpy as np

from loops import GrainGraph, LinearFrictional, Regime
from patterns.diamond import diamond
from patterns.hard_cases.case import Scene
from patterns.polygons import polydisperse_polygon, regular_polygon

LAW = LinearFrictional(kn=1.0, kt=0.3, mu=0.5)
KAPPA, MU = 0.3, 0.5
RADII = (0.5, 0.6, 0.45, 0.55, 0.5, 0.4)
SPOKES = 24


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


def soft_in_shear(kappa: float) -> Scene:
    """Diamond whose shear stiffness nearly vanishes, compressed to half its threshold."""
    strain = 0.5 * kappa / (1.0 + 0.5 * kappa)
    return Scene(diamond(0.6, E1=strain, E2=strain), LinearFrictional(1.0, kappa, MU))


def stiff_in_shear(kappa: float) -> Scene:
    """Diamond that is stiffer in shear than along the normal."""
    return Scene(diamond(0.6, E1=0.1, E2=0.1, T=0.01), LinearFrictional(1.0, kappa, MU))


def frictionless(strain: float) -> Scene:
    """Diamond with `mu = 0`: nothing but N/l resists turning, and against it."""
    return Scene(diamond(0.6, E1=strain, E2=strain), LinearFrictional(1.0, KAPPA, 0.0))


def infinite_friction(shear: float) -> Scene:
    """Diamond with `mu` infinite, whatever the shear force over `kn l0`."""
    return Scene(diamond(0.6, E1=0.1, E2=0.1, T=shear), LinearFrictional(1.0, KAPPA))


def nearly_open(strain: float) -> Scene:
    """Diamond whose contacts carry next to nothing."""
    return Scene(diamond(0.6, E1=strain, E2=strain), LAW)


def stiff_grains(strain: float) -> Scene:
    """Irregular hexagon of overlap `strain`, its contacts at half their friction."""
    return _loaded_hexagon(strain, 0.5)


def stiff_sliding_grains(strain: float) -> Scene:
    """The same hexagon with every contact sliding."""
    return _loaded_hexagon(strain, 1.0)


def stiff_sliding_diamond(strain: float) -> Scene:
    """Diamond of overlap `strain`, every contact sliding: unstable under either closure."""
    loaded = diamond(0.6, E1=strain, E2=strain)
    signs = np.array([1.0, -1.0, 1.0, -1.0])
    return Scene(loaded.replace(shear_force=MU * signs * loaded.normal_force), LAW)


def _loaded_hexagon(strain: float, mobilised: float) -> Scene:
    ring = polydisperse_polygon(RADII, strain=strain)
    sides = np.array([1.0, 1.0, -1.0, 1.0, -1.0, -1.0])
    return Scene(ring.replace(shear_force=mobilised * MU * sides * ring.normal_force), LAW)


def next_to_yield(excess: float) -> Scene:
    """Diamond with `T = mu N (1 + excess)`."""
    loaded = diamond(0.6, E1=0.1, E2=0.1)
    signs = np.array([1.0, -1.0, 1.0, -1.0])
    shear = MU * loaded.normal_force * (1.0 + excess) * signs
    return Scene(loaded.replace(shear_force=shear), LAW)


def at_threshold(excess: float) -> Scene:
    """Diamond at the strain where det K vanishes, times `1 + excess`."""
    strain = KAPPA / (1.0 + KAPPA) * (1.0 + excess)
    return Scene(diamond(0.6, E1=strain, E2=strain), LAW)


def singular_contact(excess: float) -> Scene:
    """Hexagon of which one contact has `kt = (N/l) (1 + excess)`: its block is singular at 0."""
    ring = regular_polygon(6, strain=0.1)
    kt = np.full(6, KAPPA)
    kt[0] = 0.1 / 0.9 * (1.0 + excess)
    return Scene(ring, LinearFrictional(1.0, kt, MU))


def double_eigenvalue(split: float) -> Scene:
    """Pentagon, whose deviatoric eigenvalues coincide, one contact stiffer in shear by `split`."""
    kt = KAPPA * (1.0 + split * np.eye(5)[0])
    return Scene(regular_polygon(5, strain=0.1), LinearFrictional(1.0, kt, MU))


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
