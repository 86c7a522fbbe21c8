"""The diamond for all tests: the closed forms of the package, and those in forces, (13) to (24).

`F' = K~ Delta'` (53) to (57), `Delta` the shortenings of the diagonals `L1`, `L2`. Compression
positive, radians; arguments broadcast.
"""

import numpy as np

from patterns.diamond import *  # noqa: F403
from patterns.diamond.closed_form import *  # noqa: F403
from patterns.diamond.closed_form import (
    external_forces,
    geometric_asymmetry,
    geometric_softening,
    matrix,
)
from patterns.diamond.states import *  # noqa: F403


def side_lengths(length, alpha):
    """Diagonals of the rhombus, `L1 = 2 l cos(alpha)` and `L2 = 2 l sin(alpha)` (11)."""
    return 2.0 * length * np.cos(alpha), 2.0 * length * np.sin(alpha)


def side_rates(length, alpha, length_rate, alpha_rate):
    """Rates of the diagonals (15)."""
    turn = length * alpha_rate
    c, s = np.cos(alpha), np.sin(alpha)
    return 2.0 * (length_rate * c - turn * s), 2.0 * (length_rate * s + turn * c)


def branch_from_sides(L1, L2):
    """Branch length and angle of a rhombus with diagonals `L1`, `L2`: the inverse of (11)."""
    return 0.5 * np.hypot(L1, L2), np.arctan2(L2, L1)


def contact_forces(F1, F2, alpha):
    """Contact forces under external forces `F1`, `F2`: the inverse of (12)."""
    c, s = np.cos(alpha), np.sin(alpha)
    return 0.5 * (F1 * c + F2 * s), 0.5 * (F1 * s - F2 * c)


def force_rates(N_rate, T_rate, alpha_rate, F1, F2, alpha):
    """Rates of the external forces (13): the contact law's part and the turning of the branch."""
    material1, material2 = external_forces(N_rate, T_rate, alpha)
    return material1 - F2 * alpha_rate, material2 + F1 * alpha_rate


def stresses(F1, F2, L10, L20):
    """Nominal stresses `S1 = F1/L20` and `S2 = F2/L10`, conjugate to the strains (21)."""
    return F1 / L20, F2 / L10


def strains(L1, L2, L10, L20):
    """Strains `E_k = 1 - L_k/L_k0`, positive when the diagonal shortens (21)."""
    return (L10 - L1) / L10, (L20 - L2) / L20


def force_material_tangent(L1, L2, lambda1, lambda2, kn=1.0):
    """Material part of `K~`, from the contact law alone (53)."""
    c, s, _ = _branch_direction(L1, L2)
    K = matrix(
        c**2 + lambda1 * s**2,
        (1.0 - lambda2) * c * s,
        (1.0 - lambda1) * c * s,
        s**2 + lambda2 * c**2,
    )
    return np.asarray(kn)[..., None, None] * K


def force_geometric_tangent(L1, L2, F1, F2):
    """Geometric part of `K~`, from the forces carried while the branch turns (54)."""
    c, s, diameter = _branch_direction(L1, L2)
    p1, p2 = F1 / diameter, F2 / diameter
    return matrix(-s * p2, c * p2, s * p1, -c * p1)


def force_tangent(L1, L2, F1, F2, lambda1, lambda2, kn=1.0):
    """Tangent `K~` of `F' = K~ Delta'` (20): (17) when elastic, (19) when sliding."""
    return force_material_tangent(L1, L2, lambda1, lambda2, kn) + force_geometric_tangent(
        L1, L2, F1, F2
    )


def lagrangian_tangent(force_tangent, alpha0):
    """Tangent of `S' = K^ E'` from one of `F' = K~ Delta'`, `K^ = A K~ B` (22), (23).

    `A = diag(1/tan(alpha0), 1)` and `B = diag(1, tan(alpha0))`. Applied to (20), (53), (54) it
    gives (24), (56), (57), where the printed `Lambda kt` stands for `Lambda` and the printed
    `S2` of (57) for `S2/kn`. `K^ = kn K` with the dimensionless `K` of (26).
    """
    t0 = np.tan(alpha0)
    one = np.ones_like(t0)
    return force_tangent * matrix(1.0 / t0, one, one, t0)


def congruence(alpha0):
    """The factor `D = diag(t0^-1/2, t0^1/2)` of `K^ = D K~ D`, `t0 = tan(alpha0)` (Appendix I).

    A congruence, not a similarity: determinants agree and so do the signs of the symmetric
    parts' eigenvalues; the eigenvalues themselves agree only at 45 degrees. The appendix claims
    more (docs/paper.md, departures).
    """
    root = np.sqrt(np.tan(alpha0))
    zero = np.zeros_like(root)
    return matrix(1.0 / root, zero, zero, root)


def _branch_direction(L1, L2):
    diameter = np.hypot(L1, L2)
    return L1 / diameter, L2 / diameter, diameter


def determinant(E1, E2, s1, s2, alpha, lambda1, lambda2):
    """`det K` for any pair of moduli (34)."""
    c, s = np.cos(alpha), np.sin(alpha)
    turning = (lambda1 - lambda2) * c * s * geometric_asymmetry(E1, E2, s1, s2, alpha)
    return s**2 * lambda1 + c**2 * lambda2 - geometric_softening(E1, E2, s1, s2, alpha) + turning
