"""Hard laws and forces: limits of stiffness and friction, opening, yield, singular operators."""

from __future__ import annotations

import numpy as np

from loops import LinearFrictional
from patterns.diamond import diamond
from patterns.hard_cases.case import Scene
from patterns.hard_cases.shapes import LAW
from patterns.polygons import polydisperse_polygon, regular_polygon

KAPPA, MU = 0.3, 0.5
RADII = (0.5, 0.6, 0.45, 0.55, 0.5, 0.4)


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
