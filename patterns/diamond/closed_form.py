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

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops import GrainGraph, InputError, Regime
from loops.arrays import Flags, Floats
from loops.validation import (
    acute_angle,
    confining_strain,
    drained_kappa,
    finite,
    friction_angle,
    nonnegative,
    positive,
    sliding_sign,
    strain,
)

DIAMOND_SIDES = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
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
    overlap = overlap_ratio(E1, E2, alpha0)
    if np.any(overlap < -TOUCHING_ATOL):
        raise InputError(
            "E1, E2",
            f"strains that part the grains by {-float(np.min(overlap)):.3g} of the branch",
            "strains under which every contact still touches (l <= 2 radius)",
            "Compress the diamond, or leave the open contacts out.",
        )
    N = kn * 2.0 * radius * np.maximum(overlap, 0.0)
    cos, sin = np.cos(alpha0), np.sin(alpha0)
    return GrainGraph(
        x=_centres(2.0 * radius * (1.0 - E1) * cos, 2.0 * radius * (1.0 - E2) * sin),
        x0=_centres(2.0 * radius * cos, 2.0 * radius * sin),
        radii=radius[..., None] * np.ones(4),
        contacts=DIAMOND_SIDES,
        normal_force=N[..., None] * np.ones(4),
        shear_force=T[..., None] * DIAMOND_SHEAR_SIGNS,
    )


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
    return (
        2.0 * (1.0 - E1) * np.cos(alpha0) - 1.0,
        2.0 * (1.0 - E2) * np.sin(alpha0) - 1.0,
    )


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


_CHECKS = {
    "alpha0": acute_angle,
    "kappa": drained_kappa,
    "phi": friction_angle,
    "confinement": confining_strain,
}


@dataclass(frozen=True)
class DiamondParameters:
    """Shape, contact law and confinement of a drained biaxial test. Dimensionless, radians.

    `alpha0` in (0, pi/2), `kappa = kt/kn` in [0, 1000], friction angle `phi` in [0, pi/2] (pi/2:
    nothing slides), isotropic strain `confinement` at A in [0, 1); else an `InputError`.

    >>> round(TABLE_1.mu, 5)
    0.08749
    """

    alpha0: float
    kappa: float
    phi: float
    confinement: float

    def __post_init__(self) -> None:
        for name, check in _CHECKS.items():
            object.__setattr__(self, name, float(check(name, getattr(self, name))))

    @property
    def mu(self) -> float:
        """Friction coefficient `tan(phi)`, infinite when nothing slides."""
        return float(np.tan(self.phi)) if self.phi < np.pi / 2 else float("inf")


TABLE_1 = DiamondParameters(
    alpha0=float(np.radians(45.0)), kappa=0.2, phi=float(np.radians(5.0)), confinement=0.3
)
"""Table 1: 45 degrees, `s0 = 0.3`; isotropic in strain and in stress."""

# Isotropic in stress, T/N = -cot(alpha0 + alpha) would exceed tan(14 degrees) from the first
# touch; isotropic in strain with s1 = 0.35 at A gives the curves of Figs. 8 and 9.
TABLE_2 = DiamondParameters(
    alpha0=float(np.radians(35.0)),
    kappa=0.24,
    phi=float(np.radians(14.0)),
    confinement=float(isotropic_strain_of_stress(0.35, np.radians(35.0))),
)
"""Table 2: 35 degrees, an isotropic strain path up to `s1 = 0.35`."""


# ---- states along any path


@dataclass(frozen=True, eq=False)
class DiamondStates:
    """States of a diamond with their tangents; arrays (n, ...), radians.

    Forces are over `kn l0`, stresses over `kn`; T is positive when alpha grows. `added (n, 2)`
    tells whether the opposite grains on axis 1, and on axis 2, share a contact. The tangent
    `K (n, 2, 2)` of `s' = K E'` is `material + geometric` (25) to (28), an added contact being
    material; determinants (35), (36), and `det Ks = det K - ((K12 - K21)/2)^2`.
    """

    E1: Floats
    E2: Floats
    alpha: Floats
    N: Floats
    T: Floats
    s1: Floats
    s2: Floats
    sliding: Flags
    added: Flags
    K: Floats
    material: Floats
    geometric: Floats
    det_K: Floats
    det_Ks: Floats

    @property
    def length(self) -> Floats:
        """Branch length over `l0`."""
        return 1.0 - self.N

    @property
    def regime(self) -> NDArray[np.str_]:
        """Regime of the four contacts, 'elastic' or 'sliding'."""
        return np.where(self.sliding, "sliding", "elastic")

    def take(self, rows: NDArray[np.intp] | Sequence[int] | slice) -> DiamondStates:
        """States at these rows."""
        return DiamondStates(*(getattr(self, field.name)[rows] for field in fields(self)))


def diamond_states(
    loop: DiamondParameters,
    E1: ArrayLike,
    E2: ArrayLike,
    T: ArrayLike = 0.0,
    *,
    sliding: ArrayLike = False,
    added: ArrayLike = (False, False),
    N: Floats | None = None,
    s1: Floats | None = None,
    s2: Floats | None = None,
) -> DiamondStates:
    """States (n,) at strains and shear forces, their contacts sticking or sliding.

    Normal force and stresses follow in closed form unless they are given.
    """
    rows = [np.atleast_1d(np.asarray(value, dtype=float)) for value in (E1, E2, T)]
    E1, E2, T = np.broadcast_arrays(*rows)
    sliding = np.broadcast_to(np.asarray(sliding, dtype=bool), E1.shape)
    added = np.broadcast_to(np.asarray(added, dtype=bool), (E1.size, 2))
    alpha0, t0, alpha = loop.alpha0, np.tan(loop.alpha0), angle_from_strains(E1, E2, loop.alpha0)
    N = overlap_ratio(E1, E2, alpha0) if N is None else N
    overlap = -np.stack(opposite_gaps(E1, E2, alpha0), axis=-1) * added
    # Shares of the added contacts in the stresses: they don't turn with the branches.
    across1, across2 = (
        overlap[:, 0] / (2.0 * np.sin(alpha0)),
        overlap[:, 1] / (2.0 * np.cos(alpha0)),
    )
    F1, F2 = external_forces(N, T, alpha)
    s1 = F1 / (2.0 * np.sin(alpha0)) + across1 if s1 is None else s1
    s2 = F2 / (2.0 * np.cos(alpha0)) + across2 if s2 is None else s2
    turning = E1, E2, s1 - across1, s2 - across2
    # Friction may be infinite where nothing slides.
    sign, mu = np.where(T < 0.0, -1.0, 1.0), loop.mu if sliding.any() else 0.0
    pairs = zip(sliding_moduli(alpha, mu, sign), elastic_moduli(loop.kappa), strict=True)
    moduli = (np.where(sliding, slip, stick) for slip, stick in pairs)
    bare = material_tangent(E1, E2, alpha0, *moduli)
    geometric = geometric_tangent(*turning, alpha0)
    springs = np.stack([added[:, 0] / t0, added[:, 1] * t0], axis=-1)
    slip_det, stick_det = (
        determinant_sliding(*turning, alpha, mu, sign),
        determinant_elastic(*turning, alpha, loop.kappa),
    )
    ring = bare + geometric
    det_K = np.where(sliding, slip_det, stick_det) + springs.prod(axis=-1)
    det_K = det_K + springs[:, 0] * ring[:, 1, 1] + springs[:, 1] * ring[:, 0, 0]
    asymmetry = geometric_asymmetry(*turning, alpha)
    asymmetry = asymmetry + np.where(sliding, material_asymmetry(mu, sign), 0.0)
    material = bare + springs[:, :, None] * np.eye(2)
    return DiamondStates(
        *(E1, E2, alpha, N, T, s1, s2, sliding, added),
        *(material + geometric, material, geometric, det_K, det_K - (0.5 * asymmetry) ** 2),
    )


def graph_of_states(loop: DiamondParameters, states: DiamondStates) -> GrainGraph:
    """The states as a batch of grain graphs with their regimes; added contacts come last."""
    graph = diamond(loop.alpha0, E1=states.E1, E2=states.E2, T=states.T)
    sides = np.where(states.sliding, Regime.SLIDING, Regime.ELASTIC)
    regime = np.repeat(sides[:, None], 4, axis=1)
    if not states.added.any():
        return graph.replace(regime=regime)
    overlap = -np.stack(opposite_gaps(states.E1, states.E2, loop.alpha0), axis=-1)
    force = np.where(states.added, np.maximum(overlap, 0.0), 0.0)
    across = np.where(states.added, Regime.ELASTIC, Regime.OPEN)
    return graph.replace(
        contacts=np.concatenate([graph.contacts, OPPOSITE]),
        normal_force=np.concatenate([graph.normal_force, force], axis=-1),
        shear_force=np.concatenate([graph.shear_force, 0.0 * force], axis=-1),
        regime=np.concatenate([regime, across], axis=1),
    )


def touching_strains(loop: DiamondParameters) -> tuple[float, float]:
    """Strains E1 and E2 at which the opposite grains on axis 1, and on axis 2, meet.

    `1 - l0/L10` and `1 - l0/L20`; negative where the grains overlap from the start.
    """
    on1, on2 = (1.0 - 0.5 / length for length in (np.cos(loop.alpha0), np.sin(loop.alpha0)))
    first = float(opposite_contact_strain(loop.alpha0))
    # At 45 degrees both pairs meet at once, whatever the rounding of sine and cosine.
    on1, on2 = (first if abs(E - first) <= TOUCHING_ATOL else float(E) for E in (on1, on2))
    return tuple(0.0 if abs(E) <= TOUCHING_ATOL else E for E in (on1, on2))  # type: ignore[return-value]


def added_critical_strain(loop: DiamondParameters, added: tuple[bool, bool]) -> float:
    """Isotropic strain at which `det K` vanishes with contacts on axis 1, on axis 2.

    From (40) with `1/tan(alpha0)` added to K11 and `tan(alpha0)` to K22. With both it is
    `(1 + kappa)/(2 + kappa)` whatever the angle: that of the triangle.
    """
    cos2, sin2 = np.cos(loop.alpha0) ** 2, np.sin(loop.alpha0) ** 2
    reserve = {
        (False, False): 0.0,
        (True, False): sin2 / (1.0 + cos2),
        (False, True): cos2 / (1.0 + sin2),
        (True, True): 1.0,
    }[added]
    return float(critical_strain(loop.kappa + reserve))


def definite_intervals(loop: DiamondParameters, *, added: bool) -> list[tuple[float, float]]:
    """Isotropic strains over which Ks is positive definite, in rising order."""
    found: list[tuple[float, float]] = []
    for start, end, contacts in _between_meetings(loop, 1.0, added):
        end = min(end, added_critical_strain(loop, contacts))
        if end > start:
            joined = found and found[-1][1] == start
            found[-1:] = [(found[-1][0], end)] if joined else [*found[-1:], (start, end)]
    return found


def isotropic_tangents(loop: DiamondParameters, *, added: bool) -> tuple[Floats, Floats]:
    """Strains (n,) and tangents (n, 2, 2) under isotropic strain, past the last stable one.

    NaN separates the parts of the path where a contact is added.
    """
    last = 1.05 * definite_intervals(loop, added=True)[-1][1]
    strains, tangents = [], []
    for start, end, contacts in _between_meetings(loop, last, added):
        E = np.linspace(start, end, CURVE_STRAINS)
        strains += [E, np.full(1, np.nan)]
        tangents += [diamond_states(loop, E, E, added=contacts).K, np.full((1, 2, 2), np.nan)]
    return np.concatenate(strains), np.concatenate(tangents)


def _between_meetings(
    loop: DiamondParameters, last: float, added: bool
) -> list[tuple[float, float, tuple[bool, bool]]]:
    """Start and end of each part of the isotropic path, and the contacts added on axis 1 and 2."""
    on1, on2 = touching_strains(loop)
    meetings = sorted({E for E in (on1, on2) if 0.0 < E < last}) if added else []
    return [
        (start, end, (added and on1 <= start, added and on2 <= start))
        for start, end in pairwise([0.0, *meetings, last])
    ]
