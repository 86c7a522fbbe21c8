"""A law of a user's own: linear springs with a constant attraction."""

from loops import FrictionalLaw


class Cohesive(FrictionalLaw):
    """N = kn overlap - adhesion until the grains part; friction knows the repulsion alone."""

    def __init__(self, kn, kt, mu, adhesion):
        self.kn, self.kt, self.mu, self.adhesion = kn, kt, mu, adhesion

    def closed_force(self, state):
        return self.kn * state.overlap - self.adhesion

    def stiffnesses(self, state):
        return self.kn, self.kt

    def strength(self, state):
        return self.mu * (state.normal_force + self.adhesion)
