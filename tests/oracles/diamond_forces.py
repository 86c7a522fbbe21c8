"""The diamond in forces and shortenings: (13) to (24), (53) to (57).

`F' = K~ Delta'`, `Delta` the shortenings of the diagonals `L1`, `L2`. Compression positive,
radians; arguments broadcast.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from loops import InputError
from loops.validation import acute_angle, finite, nonnegative, positive
from patterns.diamond.closed_form import external_forces, matrix

Floats = np.ndarray


def side_lengths(length: ArrayLike, alpha: ArrayLike) -> tuple[Floats, Floats]:
    """Diagonals of the rhombus, `L1 = 2 l cos(alpha)` and `L2 = 2 l sin(alpha)` (11)."""
    length, alpha = positive("length", length), finite("alpha", alpha)
    return 2.0 * length * np.cos(alpha), 2.0 * length * np.sin(alpha)


def side_rates(
    length: ArrayLike,
    alpha: ArrayLike,
    length_rate: ArrayLike,
    alpha_rate: ArrayLike,
) -> tuple[Floats, Floats]:
    """Rates of the diagonals (15)."""
    length, alpha = positive("length", length), finite("alpha", alpha)
    length_rate = finite("length_rate", length_rate)
    turn = length * finite("alpha_rate", alpha_rate)
    c, s = np.cos(alpha), np.sin(alpha)
    return 2.0 * (length_rate * c - turn * s), 2.0 * (length_rate * s + turn * c)


def branch_from_sides(L1: ArrayLike, L2: ArrayLike) -> tuple[Floats, Floats]:
    """Branch length and angle of a rhombus with diagonals `L1`, `L2`: the inverse of (11)."""
    L1, L2 = positive("L1", L1), positive("L2", L2)
    return 0.5 * np.hypot(L1, L2), np.arctan2(L2, L1)


def contact_forces(F1: ArrayLike, F2: ArrayLike, alpha: ArrayLike) -> tuple[Floats, Floats]:
    """Contact forces under external forces `F1`, `F2`: the inverse of (12)."""
    F1, F2, alpha = finite("F1", F1), finite("F2", F2), finite("alpha", alpha)
    c, s = np.cos(alpha), np.sin(alpha)
    return 0.5 * (F1 * c + F2 * s), 0.5 * (F1 * s - F2 * c)


def force_rates(
    N_rate: ArrayLike,
    T_rate: ArrayLike,
    alpha_rate: ArrayLike,
    F1: ArrayLike,
    F2: ArrayLike,
    alpha: ArrayLike,
) -> tuple[Floats, Floats]:
    """Rates of the external forces (13): the contact law's part and the turning of the branch."""
    material1, material2 = external_forces(N_rate, T_rate, alpha)
    alpha_rate = finite("alpha_rate", alpha_rate)
    return material1 - finite("F2", F2) * alpha_rate, material2 + finite("F1", F1) * alpha_rate


def stresses(F1: ArrayLike, F2: ArrayLike, L10: ArrayLike, L20: ArrayLike) -> tuple[Floats, Floats]:
    """Nominal stresses `S1 = F1/L20` and `S2 = F2/L10`, conjugate to the strains (21)."""
    F1, F2 = finite("F1", F1), finite("F2", F2)
    return F1 / positive("L20", L20), F2 / positive("L10", L10)


def strains(L1: ArrayLike, L2: ArrayLike, L10: ArrayLike, L20: ArrayLike) -> tuple[Floats, Floats]:
    """Strains `E_k = 1 - L_k/L_k0`, positive when the diagonal shortens (21)."""
    L10, L20 = positive("L10", L10), positive("L20", L20)
    return (L10 - positive("L1", L1)) / L10, (L20 - positive("L2", L2)) / L20


def force_material_tangent(
    L1: ArrayLike, L2: ArrayLike, lambda1: ArrayLike, lambda2: ArrayLike, kn: ArrayLike = 1.0
) -> Floats:
    """Material part of `K~`, from the contact law alone (53)."""
    c, s, _ = _branch_direction(L1, L2)
    lambda1, lambda2 = finite("lambda1", lambda1), finite("lambda2", lambda2)
    K = matrix(
        c**2 + lambda1 * s**2,
        (1.0 - lambda2) * c * s,
        (1.0 - lambda1) * c * s,
        s**2 + lambda2 * c**2,
    )
    return nonnegative("kn", kn)[..., None, None] * K


def force_geometric_tangent(L1: ArrayLike, L2: ArrayLike, F1: ArrayLike, F2: ArrayLike) -> Floats:
    """Geometric part of `K~`, from the forces carried while the branch turns (54)."""
    c, s, diameter = _branch_direction(L1, L2)
    p1, p2 = finite("F1", F1) / diameter, finite("F2", F2) / diameter
    return matrix(-s * p2, c * p2, s * p1, -c * p1)


def force_tangent(
    L1: ArrayLike,
    L2: ArrayLike,
    F1: ArrayLike,
    F2: ArrayLike,
    lambda1: ArrayLike,
    lambda2: ArrayLike,
    kn: ArrayLike = 1.0,
) -> Floats:
    """Tangent `K~` of `F' = K~ Delta'` (20): (17) when elastic, (19) when sliding."""
    return force_material_tangent(L1, L2, lambda1, lambda2, kn) + force_geometric_tangent(
        L1, L2, F1, F2
    )


def lagrangian_tangent(force_tangent: ArrayLike, alpha0: ArrayLike) -> Floats:
    """Tangent of `S' = K^ E'` from one of `F' = K~ Delta'`, `K^ = A K~ B` (22), (23).

    `A = diag(1/tan(alpha0), 1)` and `B = diag(1, tan(alpha0))`. Applied to (20), (53), (54) it
    gives (24), (56), (57), where the printed `Lambda kt` stands for `Lambda` and the printed
    `S2` of (57) for `S2/kn`. `K^ = kn K` with the dimensionless `K` of (26).
    """
    operator = finite("force_tangent", force_tangent)
    if operator.shape[-2:] != (2, 2):
        raise InputError("force_tangent", f"shape {operator.shape}", "(..., 2, 2)", "Reshape it.")
    t0 = np.tan(acute_angle("alpha0", alpha0))
    one = np.ones_like(t0)
    return operator * matrix(1.0 / t0, one, one, t0)


def congruence(alpha0: ArrayLike) -> Floats:
    """The factor `D = diag(t0^-1/2, t0^1/2)` of `K^ = D K~ D`, `t0 = tan(alpha0)` (Appendix I).

    A congruence, not a similarity: determinants agree and so do the signs of the symmetric
    parts' eigenvalues; the eigenvalues themselves agree only at 45 degrees. The appendix claims
    more (docs/paper.md, departures).
    """
    root = np.sqrt(np.tan(acute_angle("alpha0", alpha0)))
    zero = np.zeros_like(root)
    return matrix(1.0 / root, zero, zero, root)


def _branch_direction(L1: ArrayLike, L2: ArrayLike) -> tuple[Floats, Floats, Floats]:
    L1, L2 = positive("L1", L1), positive("L2", L2)
    diameter = np.hypot(L1, L2)
    return L1 / diameter, L2 / diameter, diameter
