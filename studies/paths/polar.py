"""Normalised second-order work in every direction, each with the regimes that it activates."""

from __future__ import annotations

from typing import Any

import numpy as np

from loops import GrainGraph, LinearFrictional, Regime
from loops.arrays import Flags, Floats
from patterns.diamond.geometry import contact_displacement_rates
from stability import (
    RTOL,
    PolarDiagram,
    directional_work,
    normalised_second_order_work,
    operator_norm,
    polar_diagram,
)
from studies.paths.diamond import FollowedDiamond, beyond_yield
from studies.paths.states import operators

DIRECTIONS = 720
RADIUS = 2.0


def operator_diagram(K: Floats) -> PolarDiagram:
    """Polar diagram of one operator; `w2 = 0` along directions that K annuls within the tolerance.

    Where det K vanishes, round-off alone decides the sign of w2 in the kernel of K.
    """
    diagram = polar_diagram(K, r=RADIUS, directions=DIRECTIONS)
    return _settled(diagram, K, diagram.work)


def state_diagram(found: FollowedDiamond, name: str) -> tuple[PolarDiagram, Flags]:
    """Polar diagram at a named state, and in which directions its contacts slide.

    At B every direction has the regime that it activates, elastic or sliding. The printed rule is
    Coulomb's but where the contacts slide outward while N falls.
    """
    path, row = found.path, found.marks[name]
    K = found.K[row]
    diagram = polar_diagram(K, r=RADIUS, directions=DIRECTIONS)
    closed = path.regime[row] != Regime.OPEN
    graph = found.options.graph()
    here = GrainGraph(
        x=path.x[row],
        x0=graph.x,
        radii=graph.radii,
        contacts=path.contacts[closed],
        normal_force=path.normal_force[row, closed],
        shear_force=path.shear_force[row, closed],
    )
    coulomb = LinearFrictional(1.0, found.loop.kappa, found.loop.mu)
    by_branch = directional_work(here, coulomb, diagram.direction, volume=path.volume)
    work, slides = by_branch.normalised[:, 0], by_branch.regime[:, 0] == Regime.SLIDING
    if name == "B" and not found.options.law().keeps_strength:
        shortening = 2.0 * np.array([np.cos(found.loop.alpha0), np.sin(found.loop.alpha0)])
        shortening = shortening * diagram.direction
        un, ut = contact_displacement_rates(
            shortening[:, 0], shortening[:, 1], found.states.alpha[row]
        )
        falls = slides & (un > 0.0) & (ut * found.states.T[row] < 0.0)
        work = np.where(falls, _beyond(found, diagram.direction), work)
    return _settled(diagram, K, work), slides


def _beyond(found: FollowedDiamond, direction: Floats) -> Floats:
    """w2 with the contacts sliding by the path's rule."""
    states = beyond_yield(found)
    if states is None:
        return np.zeros(len(direction))
    return normalised_second_order_work(operators(found.loop, states).K[0], direction)


def beyond_diagram(found: FollowedDiamond) -> PolarDiagram | None:
    """Polar diagram at B with sliding contacts in all directions, as beyond B; None without B."""
    states = beyond_yield(found)
    return None if states is None else operator_diagram(operators(found.loop, states).K[0])


def polar_table(found: FollowedDiamond) -> dict[str, Any]:
    """Normalised second-order work in every direction at the named states (45).

    `alphaE_deg`, `tan(alphaE) = E1'/E2'`; `w2`; `x, y`, the points of the polar diagram,
    `(2 + w2) (cos alphaE, sin alphaE)`; `regime` that the direction activates.
    """
    names = list(found.marks)
    diagrams = [state_diagram(found, name) for name in names]
    none = np.zeros(0)
    points = np.concatenate([np.zeros((0, 2)), *(diagram.points for diagram, _ in diagrams)])
    slides = np.concatenate([none, *(slides for _, slides in diagrams)])
    return {
        "state": np.repeat(np.array(names, dtype=str), DIRECTIONS),
        "alphaE_deg": np.concatenate([none, *(np.degrees(d.angle) for d, _ in diagrams)]),
        "w2": np.concatenate([none, *(diagram.work for diagram, _ in diagrams)]),
        "x": points[:, 0],
        "y": points[:, 1],
        "regime": np.where(slides == 1.0, "sliding", "elastic"),
    }


def _settled(diagram: PolarDiagram, K: Floats, work: Floats) -> PolarDiagram:
    stress = np.einsum("ij,nj->ni", K, diagram.direction)
    annulled = np.linalg.norm(stress, axis=-1) <= RTOL * operator_norm(K)
    work = np.where(annulled, 0.0, work)
    outward = np.stack([np.cos(diagram.angle), np.sin(diagram.angle)], axis=-1)
    points = (RADIUS + work)[..., None] * outward
    return PolarDiagram(diagram.angle, diagram.direction, work, points)
