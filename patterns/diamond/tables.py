"""Parameters of a diamond's drained biaxial test, and the paper's two sets (Tables 1 and 2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from patterns.arguments import acute_angle, confining_strain, drained_kappa, friction_angle
from patterns.diamond.tangents import isotropic_strain

_CHECKS = {
    "alpha0": acute_angle,
    "kappa": drained_kappa,
    "phi": friction_angle,
    "confinement": confining_strain,
}


@dataclass(frozen=True)
class DiamondParameters:
    """What fixes a drained biaxial test: shape, contact law, confinement. Dimensionless, radians.

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
    confinement=float(isotropic_strain(0.35, np.radians(35.0))),
)
"""Table 2: 35 degrees, an isotropic strain path up to `s1 = 0.35`."""
