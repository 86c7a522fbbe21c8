"""States of the diamond along a path, and where its isotropic tangents are definite."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops.arrays import Flags, Floats
from loops.validation import acute_angle, confining_strain, drained_kappa, friction_angle
from patterns.diamond.closed_form import (
    CURVE_STRAINS,
    TOUCHING_ATOL,
    angle_from_strains,
    critical_strain,
    determinant_elastic,
    determinant_sliding,
    elastic_moduli,
    external_forces,
    geometric_asymmetry,
    geometric_tangent,
    isotropic_strain_of_stress,
    material_asymmetry,
    material_tangent,
    opposite_contact_strain,
    opposite_gaps,
    overlap_ratio,
    sliding_moduli,
)

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
