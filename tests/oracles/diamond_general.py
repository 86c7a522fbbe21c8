"""The diamond's determinant for any moduli (34), and its drained path over the branch angle."""

import numpy as np

from loops.validation import finite
from patterns.diamond.closed_form import geometric_asymmetry, geometric_softening
from tests.oracles.drained import drained_states_after_turn


def determinant(E1, E2, s1, s2, alpha, lambda1, lambda2):
    """`det K` for any pair of moduli (34)."""
    c, s = np.cos(alpha), np.sin(alpha)
    turning = (lambda1 - lambda2) * c * s * geometric_asymmetry(E1, E2, s1, s2, alpha)
    return s**2 * lambda1 + c**2 * lambda2 - geometric_softening(E1, E2, s1, s2, alpha) + turning


def drained_states(path, alpha):
    """States of a path where the branch stands at `alpha`, and their regimes."""
    return drained_states_after_turn(path, finite("alpha", alpha) - path.parameters.alpha0)
