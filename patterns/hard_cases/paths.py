"""Hard paths: symmetric and nearly symmetric yield, limit points, snap-back, opening."""

from __future__ import annotations

import numpy as np

from loops import GrainGraph, LinearFrictional
from patterns.diamond import TABLE_1 as TABLE
from patterns.diamond import DiamondParameters, diamond, drained_path
from patterns.hard_cases.case import Scene

# Table 1 of Nicot et al. 2016.
TABLE_1 = LinearFrictional(kn=1.0, kt=0.2, mu=float(np.tan(np.radians(5.0))))


def all_yield_at_once(shear: float) -> Scene:
    """Table 1 from A, the four contacts carrying a little shear, each its own, at the start."""
    start = diamond(0.25 * np.pi, E1=0.3, E2=0.3)
    own = start.replace(shear_force=shear * np.array([1.0, -0.5, 0.25, 0.75]))
    return Scene(own, TABLE_1, stages=(("drained_biaxial", "H11", 0.42),))


def yield_of_table_1(shear: float) -> float:
    """`E1` at point B of Table 1; a shear force at the start moves it by as much."""
    return float(drained_path(TABLE).end.E1)


def falling_force(confinement: float) -> Scene:
    """Diamond driven by its axial stress, which has a peak where its contacts yield."""
    start = diamond(0.25 * np.pi, E1=confinement, E2=confinement)
    return Scene(start, TABLE_1, stages=(("force_control", "P11", 2.0),))


def peak(confinement: float) -> float:
    """`E1` where the contacts yield, from the exact drained path."""
    table = DiamondParameters(0.25 * np.pi, TABLE.kappa, TABLE.phi, confinement)
    return float(drained_path(table).end.E1)


def snapping_back(confinement: float) -> Scene:
    """Flat diamond whose axial strain turns back at yield: K22 changes its sign."""
    start = diamond(np.radians(20.0), E1=confinement, E2=confinement)
    law = LinearFrictional(kn=1.0, kt=0.5, mu=float(np.tan(np.radians(5.0))))
    return Scene(start, law, stages=(("drained_biaxial", "H11", 0.4),))


def turning_point(confinement: float) -> float:
    """Largest `E1`, where the contacts yield, from the exact drained path."""
    flat = DiamondParameters(np.radians(20.0), 0.5, np.radians(5.0), confinement)
    return float(drained_path(flat).end.E1)


def through_det_k(kappa: float) -> Scene:
    """Diamond compressed through the strain `kappa/(1 + kappa)` where det K vanishes."""
    law = LinearFrictional(kn=1.0, kt=kappa, mu=0.5)
    end = min(2.0 * kappa / (1.0 + kappa), 0.9)
    return Scene(diamond(0.25 * np.pi), law, stages=(("isotropic_strain", "H11", end),))


def threshold(kappa: float) -> float:
    """`kappa/(1 + kappa)` (theory note, section 5)."""
    return kappa / (1.0 + kappa)


def parting(strain: float) -> Scene:
    """Diamond pulled apart from a small compression."""
    start: GrainGraph = diamond(0.7, E1=strain, E2=strain)
    return Scene(start, TABLE_1, stages=(("isotropic_extension", "H11", -strain),))


def first_touch(strain: float) -> float:
    """Grains just touch in the reference."""
    return 0.0
