"""Random rings of one order, from stiff to soft, on which closures are measured."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from loops import GrainGraph, LinearFrictional, Regime
from loops.arrays import Floats, Regimes
from studies.fifty_digits import affine_tangent_50, as_array, traction_tangent_50

KN, KT, MU, SLIDING = 1.0, 0.4, 0.5, 0.2
EXACT = {"affine": affine_tangent_50, "traction": traction_tangent_50}


class Rings(NamedTuple):
    """Loops, their law and the regimes of their contacts."""

    graph: GrainGraph
    law: LinearFrictional
    regime: Regimes

    def first(self, count: int) -> Rings:
        """The first loops; a single one without batch axes."""
        g, at = self.graph, 0 if count == 1 else slice(count)
        part = GrainGraph(g.x[at], g.radii[at], g.contacts, g.normal_force[at], g.shear_force[at])
        return Rings(part, self.law, self.regime[at])

    def exact(self, k: int, closure: str) -> Floats:
        """Tangent of one loop with 50 digits, rounded."""
        g = self.graph
        state = (g.x[k], g.x0[k], g.normal_force[k], g.shear_force[k])
        return as_array(EXACT[closure](*state, KN, KT, MU, self.regime[k]))


def random_rings(loops: int, order: int, seed: int) -> Rings:
    """Irregular rings: overlaps log-uniform from 1e-8 to 0.3, a fifth of the contacts sliding."""
    rng = np.random.default_rng(seed)
    angle = 2 * np.pi * (np.arange(order) + rng.uniform(-0.3, 0.3, (loops, order))) / order
    distance = rng.uniform(0.8, 1.2, (loops, order))
    x = distance[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    length = np.linalg.norm(np.roll(x, -1, axis=1) - x, axis=-1)
    overlap = 10.0 ** rng.uniform(-8, np.log10(0.3), (loops, 1))
    normal = KN * overlap * length * rng.uniform(0.5, 1.5, (loops, order))
    sliding = rng.random((loops, order)) < SLIDING
    share = np.where(sliding, rng.choice([-1.0, 1.0], (loops, order)), rng.uniform(-0.95, 0.95))
    graph = GrainGraph(
        x=x,
        radii=length.max(axis=1, keepdims=True) * np.full(order, 0.8),
        contacts=np.column_stack([np.arange(order), np.roll(np.arange(order), -1)]),
        normal_force=normal,
        shear_force=share * MU * normal,
    )
    regime = np.where(sliding, Regime.SLIDING, Regime.ELASTIC).astype(np.int8)
    return Rings(graph, LinearFrictional(KN, KT, MU), regime)
