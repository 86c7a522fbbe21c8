"""The diamond (11) to (43): geometry, balance, graph, tangent, determinants, states on a path.

Four equal discs form a rhombus of side `l`; `alpha` is the angle between a branch and axis 1.
Forces and strains are positive in compression. `T` is positive when `alpha` grows
(`T' = kt l alpha'`). Angles are radians. All arguments broadcast.

The dimensionless tangent is `s' = K E'`, `s_k = S_k/kn`. K equals the generic macroscopic tangent
restricted to (11, 22) with the bounding box `L10 L20` as reference volume. There `alpha` is
the current branch angle, `angle_from_strains` of the strains.

A contact added between opposite grains lies along an axis, so that it neither turns nor shears: its
force is the overlap, and it adds `1/tan(alpha0)` to K11 or `tan(alpha0)` to K22.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from loops import GrainGraph, InputError
from loops.arrays import Floats, Integers
from loops.validation import acute_angle, finite, nonnegative, positive, sliding_sign, strain

# Opposite grains on axis 1 and on axis 2.
OPPOSITE = ([0, 2], [1, 3])
# As alpha grows, branches (0, 1) and (2, 3) turn clockwise and the two others counter-clockwise;
# the graph counts T along the counter-clockwise tangent, the diamond along growing alpha.
DIAMOND_SHEAR_SIGNS = np.array([1.0, -1.0, 1.0, -1.0])
# Strains of a diamond that barely touches give an overlap of zero up to this rounding.
TOUCHING_ATOL = 4.0 * np.finfo(np.float64).eps
# Strains of a curve between two meetings of opposite grains.
CURVE_STRAINS = 401


def diamond(
    alpha0: ArrayLike,
    *,
    E1: ArrayLike = 0.0,
    E2: ArrayLike = 0.0,
    T: ArrayLike = 0.0,
    radius: ArrayLike = 0.5,
    kn: ArrayLike = 1.0,
) -> GrainGraph:
    """The diamond of four equal grains at strains `E1`, `E2`, centred on the origin.

    Grains run counter-clockwise: 0 right, 1 top, 2 left, 3 bottom. Contacts are (0, 1), (1, 2),
    (2, 3), (3, 0). In the reference the grains barely touch, `l0 = 2 radius`. The normal force
    follows from the positions, `N = kn (l0 - l)` (8a); the shear force is the caller's, because
    it depends on the path. Overlaps of opposite grains are not checked: see `opposite_gaps`.

    Parameters
    ----------
    alpha0 : array_like (...)
        Reference angle between branch and axis 1 in (0, pi/2), radians.
    E1, E2 : array_like (...)
        Strains of the diagonals below 1, compression positive.
    T : array_like (...)
        Shear force in every contact, positive when alpha grows (unit of `kn * radius`).
    radius : array_like (...)
        Radius of the grains, positive.
    kn : array_like (...)
        Normal stiffness, positive. 1 gives dimensionless forces when `radius` is 0.5.

    Returns
    -------
    GrainGraph
        Batch axes are the broadcast shape of the arguments.

    Raises
    ------
    InputError
        If an argument leaves its range, or the strains open the contacts.

    Examples
    --------
    >>> graph = diamond(np.pi / 4, E1=0.3, E2=0.3)
    >>> graph.normal_force.round(12).tolist()
    [0.3, 0.3, 0.3, 0.3]
    >>> diamond(np.radians([35.0, 45.0, 55.0])).batch_shape
    (3,)
    """
    alpha0, radius = acute_angle("alpha0", alpha0), positive("radius", radius)
    E1, E2, T = strain("E1", E1), strain("E2", E2), finite("T", T)
    alpha0, E1, E2, T, radius, kn = np.broadcast_arrays(
        alpha0, E1, E2, T, radius, positive("kn", kn)
    )
    cos, sin = np.cos(alpha0), np.sin(alpha0)
    x = _centres(2.0 * radius * (1.0 - E1) * cos, 2.0 * radius * (1.0 - E2) * sin)
    x0 = _centres(2.0 * radius * cos, 2.0 * radius * sin)
    overlap = overlap_ratio(E1, E2, alpha0)[..., None] * np.ones(4)
    return touching_ring("E1, E2", x, x0, radius, kn, overlap, T[..., None] * DIAMOND_SHEAR_SIGNS)


def touching_ring(
    where: str, x: Floats, x0: Floats, radius: Floats, kn: Floats, overlap: Floats, shear: Floats
) -> GrainGraph:
    """Equal grains (..., n) around a loop from their overlaps over the branch that barely touches.

    `InputError` where a contact opens, with the names of the strains.
    """
    if (overlap < -TOUCHING_ATOL).any():
        received = f"strains that part the grains by {-float(overlap.min()):.3g} of the branch"
        expected = "strains under which every contact still touches (l <= 2 radius)"
        remedy = "Compress the loop, or leave the open contacts out."
        raise InputError(where, received, expected, remedy)
    return GrainGraph(
        x=x,
        x0=x0,
        radii=radius[..., None] * np.ones(x.shape[-2]),
        contacts=ring_contacts(x.shape[-2]),
        normal_force=(2.0 * kn * radius)[..., None] * np.maximum(overlap, 0.0),
        shear_force=shear,
    )


def ring_contacts(order: int) -> Integers:
    """(n, 2) contacts (c, c + 1) of a ring of n grains."""
    return np.column_stack([np.arange(order), np.roll(np.arange(order), -1)])


def _centres(half1: Floats, half2: Floats) -> Floats:
    """Centres (..., 4, 2) of a rhombus with half diagonals `half1`, `half2`."""
    zero = np.zeros_like(half1)
    x = np.stack([half1, zero, -half1, zero], axis=-1)
    y = np.stack([zero, half2, zero, -half2], axis=-1)
    return np.stack([x, y], axis=-1)


def external_forces(N: ArrayLike, T: ArrayLike, alpha: ArrayLike) -> tuple[Floats, Floats]:
    """External forces `F1, F2` that balance the contacts, compression positive (12).

    `2 (N cos(alpha) + T sin(alpha))` and `2 (N sin(alpha) - T cos(alpha))`.
    """
    N, T, alpha = finite("N", N), finite("T", T), finite("alpha", alpha)
    c, s = np.cos(alpha), np.sin(alpha)
    return 2.0 * (N * c + T * s), 2.0 * (N * s - T * c)


def contact_displacement_rates(
    shortening1_rate: ArrayLike, shortening2_rate: ArrayLike, alpha: ArrayLike
) -> tuple[Floats, Floats]:
    """Relative displacement rates at a contact from the shortening rates of the diagonals (16)."""
    D1 = finite("shortening1_rate", shortening1_rate)
    D2 = finite("shortening2_rate", shortening2_rate)
    alpha = finite("alpha", alpha)
    c, s = np.cos(alpha), np.sin(alpha)
    return -0.5 * (c * D1 + s * D2), -0.5 * (s * D1 - c * D2)


def angle_from_strains(E1: ArrayLike, E2: ArrayLike, alpha0: ArrayLike) -> Floats:
    """Branch angle, `tan(alpha) = tan(alpha0) (1 - E2)/(1 - E1)` (below (26))."""
    E1, E2 = strain("E1", E1), strain("E2", E2)
    alpha0 = acute_angle("alpha0", alpha0)
    return np.arctan2((1.0 - E2) * np.sin(alpha0), (1.0 - E1) * np.cos(alpha0))


def overlap_ratio(E1: ArrayLike, E2: ArrayLike, alpha0: ArrayLike) -> Floats:
    """Overlap of a contact over the reference branch, `1 - l/l0`; also `N/(kn l0)` by (8a).

    Written from `l0^2 - l^2`, so that it keeps its relative accuracy at stiff grains, where `l` and
    `l0` agree to many digits. Negative where the contact has opened.
    """
    E1, E2 = strain("E1", E1), strain("E2", E2)
    alpha0 = acute_angle("alpha0", alpha0)
    c, s = np.cos(alpha0), np.sin(alpha0)
    branch = np.hypot((1.0 - E1) * c, (1.0 - E2) * s)
    return (E1 * (2.0 - E1) * c**2 + E2 * (2.0 - E2) * s**2) / (1.0 + branch)


def opposite_gaps(E1: ArrayLike, E2: ArrayLike, alpha0: ArrayLike) -> tuple[Floats, Floats]:
    """Gaps between opposite grains along axes 1 and 2 over the reference branch, `(L_k - l0)/l0`.

    The paper lets them overlap: the gap is then negative (docs/paper.md, departures).
    """
    E1, E2 = strain("E1", E1), strain("E2", E2)
    alpha0 = acute_angle("alpha0", alpha0)
    return (2.0 * (1.0 - E1) * np.cos(alpha0) - 1.0, 2.0 * (1.0 - E2) * np.sin(alpha0) - 1.0)


def opposite_contact_strain(alpha0: ArrayLike) -> Floats:
    """Isotropic strain at which a pair of opposite grains first touches (docs/paper.md)."""
    alpha0 = acute_angle("alpha0", alpha0)
    return 1.0 - 0.5 / np.minimum(np.sin(alpha0), np.cos(alpha0))


def work_shear_then_compress(
    length: ArrayLike, alpha: ArrayLike, compression: ArrayLike, kn: ArrayLike, kt: ArrayLike
) -> Floats:
    """Work of turning the branch at its full length, then shortening it (9)."""
    arc = positive("length", length) * finite("alpha", alpha)
    compression = finite("compression", compression)
    return 0.5 * (nonnegative("kt", kt) * arc**2 + nonnegative("kn", kn) * compression**2)


def work_compress_then_shear(
    length: ArrayLike, alpha: ArrayLike, compression: ArrayLike, kn: ArrayLike, kt: ArrayLike
) -> Floats:
    """Work of shortening the branch, then turning it at the shorter length (10)."""
    length, compression = positive("length", length), finite("compression", compression)
    arc = (length - compression) * finite("alpha", alpha)
    return 0.5 * (nonnegative("kn", kn) * compression**2 + nonnegative("kt", kt) * arc**2)


def elastic_moduli(kappa: ArrayLike) -> tuple[Floats, Floats]:
    """Moduli of elastic contacts, `Lambda1 = Lambda2 = kappa`."""
    kappa = nonnegative("kappa", kappa)
    return kappa, kappa


def sliding_moduli(alpha: ArrayLike, mu: ArrayLike, s: ArrayLike) -> tuple[Floats, Floats]:
    """Moduli of sliding contacts, `Lambda1 = s mu / tan(alpha)`, `Lambda2 = -s mu tan(alpha)`.

    The paper's `zeta_n zeta_t` is read as `s = sign(T)`, which keeps `|T| = mu N` also when the
    contact unloads (docs/paper.md, departures).
    """
    t = np.tan(acute_angle("alpha", alpha))
    friction = sliding_sign("s", s) * nonnegative("mu", mu)
    return friction / t, -friction * t


def material_tangent(
    E1: ArrayLike, E2: ArrayLike, alpha0: ArrayLike, lambda1: ArrayLike, lambda2: ArrayLike
) -> Floats:
    """Material part `Kmat` (..., 2, 2), from the contact law alone (27).

    `Kmat12 - Kmat21` is 0 when elastic and `s mu` when sliding (29).
    """
    alpha = angle_from_strains(E1, E2, alpha0)
    lambda1, lambda2 = finite("lambda1", lambda1), finite("lambda2", lambda2)
    t0, c, s = np.tan(np.asarray(alpha0)), np.cos(alpha), np.sin(alpha)
    return matrix(
        (c**2 + lambda1 * s**2) / t0,
        (1.0 - lambda2) * c * s,
        (1.0 - lambda1) * c * s,
        (s**2 + lambda2 * c**2) * t0,
    )


def geometric_tangent(
    E1: ArrayLike, E2: ArrayLike, s1: ArrayLike, s2: ArrayLike, alpha0: ArrayLike
) -> Floats:
    """Geometric part `Kgeo` (..., 2, 2), from the stresses carried while the branches turn (28).

    Symmetric if and only if `T = 0` (30), (31): `Kgeo12 - Kgeo21 = -T/(kn l)`.
    """
    alpha = angle_from_strains(E1, E2, alpha0)
    t0, c, s = np.tan(np.asarray(alpha0)), np.cos(alpha), np.sin(alpha)
    p1 = finite("s1", s1) / (1.0 - np.asarray(E2))
    p2 = finite("s2", s2) / (1.0 - np.asarray(E1))
    return matrix(-c * s * p2 / t0, c**2 * p2, s**2 * p1, -c * s * p1 * t0)


def tangent(
    E1: ArrayLike,
    E2: ArrayLike,
    s1: ArrayLike,
    s2: ArrayLike,
    alpha0: ArrayLike,
    lambda1: ArrayLike,
    lambda2: ArrayLike,
) -> Floats:
    """Dimensionless tangent `K = Kmat + Kgeo` (..., 2, 2) of `s' = K E'` (25), (26).

    `K = K^/kn`; the printed `K = kn K^` before (26) is a misprint.
    """
    return material_tangent(E1, E2, alpha0, lambda1, lambda2) + geometric_tangent(
        E1, E2, s1, s2, alpha0
    )


def determinant_elastic(
    E1: ArrayLike,
    E2: ArrayLike,
    s1: ArrayLike,
    s2: ArrayLike,
    alpha: ArrayLike,
    kappa: ArrayLike,
) -> Floats:
    """`det K = kappa - N/(kn l)` of elastic contacts (35), zero where (37) holds."""
    return nonnegative("kappa", kappa) - geometric_softening(E1, E2, s1, s2, alpha)


def determinant_sliding(
    E1: ArrayLike,
    E2: ArrayLike,
    s1: ArrayLike,
    s2: ArrayLike,
    alpha: ArrayLike,
    mu: ArrayLike,
    s: ArrayLike,
) -> Floats:
    """`det K` of sliding contacts (36), `s = sign(T)` in place of `zeta_n zeta_t`.

    Where `T = s mu N` it equals `-(1 + mu^2) N/(kn l)`: never positive.
    """
    turning = geometric_asymmetry(E1, E2, s1, s2, alpha)
    return material_asymmetry(mu, s) * turning - geometric_softening(E1, E2, s1, s2, alpha)


def geometric_softening(
    E1: ArrayLike, E2: ArrayLike, s1: ArrayLike, s2: ArrayLike, alpha: ArrayLike
) -> Floats:
    """Left side of (37), `cos a sin a (s2/(1-E1) + s1/(1-E2))`; equal to `N/(kn l)`.

    Balance (12) cancels T from it: an elastic diamond loses `det K` at one branch length,
    `l/l0 = 1/(1 + kappa)`, whatever its angle and shear force.
    """
    alpha = acute_angle("alpha", alpha)
    p1, p2 = _current_stresses(E1, E2, s1, s2)
    return np.cos(alpha) * np.sin(alpha) * (p2 + p1)


def material_asymmetry(mu: ArrayLike, s: ArrayLike) -> Floats:
    """`Kmat12 - Kmat21 = s mu` of sliding contacts (29); elastic ones have none."""
    return sliding_sign("s", s) * nonnegative("mu", mu)


def geometric_asymmetry(
    E1: ArrayLike, E2: ArrayLike, s1: ArrayLike, s2: ArrayLike, alpha: ArrayLike
) -> Floats:
    """`Kgeo12 - Kgeo21 = cos^2(a) s2/(1-E1) - sin^2(a) s1/(1-E2)`, equal to `-T/(kn l)`.

    It vanishes where (30) holds, that is where `T = 0` (31).
    """
    alpha = acute_angle("alpha", alpha)
    p1, p2 = _current_stresses(E1, E2, s1, s2)
    return np.cos(alpha) ** 2 * p2 - np.sin(alpha) ** 2 * p1


def drained_slope(K: ArrayLike) -> Floats:
    """Slope `ds1/dE1 = det K / K22` under constant `s2` (33)."""
    K = finite("K", K)
    if K.shape[-2:] != (2, 2):
        raise InputError("K", f"shape {K.shape}", "(..., 2, 2)", "Reshape it.")
    det_K = K[..., 0, 0] * K[..., 1, 1] - K[..., 0, 1] * K[..., 1, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        return det_K / (K[..., 1, 1] + 0.0)


def _current_stresses(
    E1: ArrayLike, E2: ArrayLike, s1: ArrayLike, s2: ArrayLike
) -> tuple[Floats, Floats]:
    E1, E2 = strain("E1", E1), strain("E2", E2)
    return finite("s1", s1) / (1.0 - E2), finite("s2", s2) / (1.0 - E1)


def stress_of_isotropic_strain(E: ArrayLike, alpha0: ArrayLike) -> tuple[Floats, Floats]:
    """Stresses on the path, `s1 = E/tan(alpha0)` and `s2 = E tan(alpha0)` (39).

    Equal only at 45 degrees: isotropic is the strain, not the stress (docs/paper.md, departures).
    """
    E, t0 = strain("E", E), np.tan(acute_angle("alpha0", alpha0))
    return E / t0, E * t0


def isotropic_strain_of_stress(s1: ArrayLike, alpha0: ArrayLike) -> Floats:
    """Strain that carries the axial stress `s1` on the path: the inverse of (39a)."""
    t0 = np.tan(acute_angle("alpha0", alpha0))
    return strain("isotropic strain under s1", finite("s1", s1) * t0)


def isotropic_tangent(E: ArrayLike, alpha0: ArrayLike, kappa: ArrayLike) -> Floats:
    """Elastic tangent on the path (38), (40); at 45 degrees (43), at the critical strain (42).

    At 45 degrees its eigenvalues are 1 and `kappa - E/(1-E)`.
    """
    alpha0 = acute_angle("alpha0", alpha0)
    excess = isotropic_determinant(E, kappa)
    c, s, t0 = np.cos(alpha0), np.sin(alpha0), np.tan(alpha0)
    coupling = (1.0 - excess) * c * s
    return matrix(c**2 / t0 + excess * c * s, coupling, coupling, s**2 * t0 + excess * c * s)


def isotropic_determinant(E: ArrayLike, kappa: ArrayLike) -> Floats:
    """`det K = kappa - E/(1-E)` on the path, whatever the reference angle (below (43))."""
    E = strain("E", E)
    return nonnegative("kappa", kappa) - E / (1.0 - E)


def critical_strain(kappa: ArrayLike) -> Floats:
    """Isotropic strain `E* = kappa/(1 + kappa)` at which `det K` vanishes (41)."""
    kappa = nonnegative("kappa", kappa)
    return kappa / (1.0 + kappa)


def matrix(k11: Floats, k12: Floats, k21: Floats, k22: Floats) -> Floats:
    """Operators (..., 2, 2) of four broadcasting components (...)."""
    components = np.stack(np.broadcast_arrays(k11, k12, k21, k22), axis=-1)
    return components.reshape((*components.shape[:-1], 2, 2))
