"""Laws of one's own for tests, and laws under which a packing keeps the forces that it rests in."""

import numpy as np

from loops import FrictionalLaw, HertzMindlin, contact_state


class Springs(FrictionalLaw):
    """`LinearFrictional` without its tangents."""

    def closed_force(self, state):
        return self.k * state.overlap


class Glue(FrictionalLaw):
    """A constant attraction while grains touch, friction of the force beyond it."""

    def closed_force(self, state):
        return self.k * state.overlap - self.pull

    def strength(self, state):
        return self.mu * (state.normal_force + self.pull)


class Stiffening(FrictionalLaw):
    """Springs that stiffen with the overlap, under friction that falls with the force."""

    def closed_force(self, state):
        return self.k * state.overlap * (1.0 + self.b * state.overlap)

    def strength(self, state):
        return self.mu * state.normal_force / (1.0 + self.c * state.normal_force)

    def strength_slope(self, state):
        return self.mu / (1.0 + self.c * state.normal_force) ** 2


class Spheres(FrictionalLaw):
    """Hertz and Mindlin's law, written anew."""

    def closed_force(self, state):
        root = np.sqrt(state.radii_i * state.radii_j / state.touching_length)
        return 2 / 3 * self.modulus * root * state.overlap * np.sqrt(np.maximum(state.overlap, 0.0))

    def stiffnesses(self, state):
        reduced = state.radii_i * state.radii_j / state.touching_length
        root = np.sqrt(reduced * np.maximum(state.overlap, 0.0))
        return self.modulus * root, self.ratio * self.modulus * root


class ByDisplacement(Spheres):
    """The same, with a shear force that goes with `kt`."""

    def coupling(self, state):
        return state.shear_force / (2 * state.overlap)


class Power(FrictionalLaw):
    """The law of `docs/first-steps.md`."""

    def __init__(self, k, kt, mu, m):
        self.k, self.kt, self.mu, self.m = k, kt, mu, m

    def closed_force(self, state):
        return self.k * state.overlap**self.m

    def stiffnesses(self, state):
        return self.k * self.m * state.overlap ** (self.m - 1), self.kt


def factor_of(graph, unit, apart):
    """What the forces of a law are multiplied by to be those of the graph; another one apart."""
    closed = graph.normal_force > 0
    force = np.where(closed, unit.closed_force(contact_state(graph)), 1.0)
    return np.where(closed, graph.normal_force / force, apart)


def hertz_of(graph, history="force", increment="radii"):
    """A modulus for each contact with which Hertz's force is the one that balances the packing."""
    young = factor_of(graph, HertzMindlin(1.0, 0.2), 5.0)
    return HertzMindlin(young, 0.2, 0.5, increment, history)


def stiffening_of(graph):
    """The same for springs that stiffen."""
    how = {"b": 40.0, "c": 5.0, "kt": 0.5, "mu": 0.54, "shear_increment": "radii"}
    return Stiffening(k=factor_of(graph, Stiffening(k=1.0, **how), 1.0), **how)


def power_of(graph):
    """The same for forces that grow with a power of the overlap."""
    return Power(factor_of(graph, Power(1.0, 0.2, 0.5, 1.2), 2.0), 0.2, 0.5, 1.2)
