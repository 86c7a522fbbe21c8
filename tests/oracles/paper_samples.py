"""Random diamonds on which the equations are measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops import GrainGraph
from patterns import diamond
from stability import operator_norm
from tests.oracles.diamond import (
    branch_from_sides,
    contact_forces,
    elastic_moduli,
    external_forces,
    sliding_moduli,
    strains,
    stresses,
)

Floats = NDArray[np.float64]
COUNT, SEED = 1000, 20160801


@dataclass(frozen=True, eq=False)
class Samples:
    """Random loaded diamonds and rates; arrays (n,), `kn = l0 = 1`."""

    alpha0: Floats
    kappa: Floats
    mu: Floats
    length: Floats
    alpha: Floats
    N: Floats
    T: Floats
    length_rate: Floats
    alpha_rate: Floats

    @property
    def forces(self) -> tuple[Floats, Floats]:
        """External forces (12)."""
        return external_forces(self.N, self.T, self.alpha)

    @property
    def sides(self) -> tuple[Floats, Floats]:
        """Diagonals (11)."""
        return 2.0 * self.length * np.cos(self.alpha), 2.0 * self.length * np.sin(self.alpha)

    @property
    def slides(self) -> bool:
        """Whether the contacts stand at yield, `|T| = mu N`."""
        return bool(np.allclose(np.abs(self.T), self.mu * self.N))

    @property
    def moduli(self) -> tuple[Floats, Floats]:
        """Moduli of (20)."""
        if self.slides:
            return sliding_moduli(self.alpha, self.mu, np.sign(self.T))
        return elastic_moduli(self.kappa)

    @property
    def law_rates(self) -> tuple[Floats, Floats]:
        """Rates of N and T by (8), with `s = sign(T)` in (8c)."""
        normal = -self.length_rate
        if self.slides:
            return normal, np.sign(self.T) * self.mu * normal
        return normal, self.kappa * self.length * self.alpha_rate

    @property
    def graph(self) -> GrainGraph:
        """The grain graph, batch axis (n,)."""
        E1, E2, _, _ = self.carried
        return diamond(self.alpha0, E1=E1, E2=E2, T=self.T)

    @property
    def carried(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Strains and dimensionless stresses `E1, E2, s1, s2`."""
        L10, L20 = 2.0 * np.cos(self.alpha0), 2.0 * np.sin(self.alpha0)
        return (*strains(*self.sides, L10, L20), *stresses(*self.forces, L10, L20))


def random_samples(*, sliding: bool, count: int = COUNT) -> Samples:
    """Random diamonds, seeded: between stiff and soft, flat and steep, elastic or at yield."""
    rng = np.random.default_rng(SEED + sliding)
    alpha0 = np.radians(rng.uniform(10.0, 80.0, count))
    alpha = np.clip(alpha0 + np.radians(rng.uniform(-8.0, 8.0, count)), 0.1, 1.45)
    # The state as strains tell it, so that every route starts from the same numbers.
    N, mu = rng.uniform(0.02, 0.4, count), np.tan(np.radians(rng.uniform(3.0, 35.0, count)))
    length, alpha = branch_from_sides(
        2.0 * (1.0 - N) * np.cos(alpha), 2.0 * (1.0 - N) * np.sin(alpha)
    )
    share = rng.choice([-1.0, 1.0], count) if sliding else rng.uniform(-0.9, 0.9, count)
    T = share * mu * N
    N, T = contact_forces(*external_forces(N, T, alpha), alpha)
    return Samples(
        alpha0=alpha0,
        kappa=rng.uniform(0.05, 1.5, count),
        mu=mu,
        length=length,
        alpha=alpha,
        N=N,
        T=T,
        length_rate=rng.normal(size=count),
        alpha_rate=rng.normal(size=count),
    )


def difference(found: ArrayLike, expected: ArrayLike) -> float:
    """Largest difference over the largest size of what is expected."""
    expected = np.asarray(expected)
    return float(np.max(np.abs(np.asarray(found) - expected)) / np.max(np.abs(expected)))


def operator_difference(found: NDArray[np.float64], expected: NDArray[np.float64]) -> float:
    """Largest relative difference of operators, Frobenius norms."""
    return float(np.max(operator_norm(found - expected) / operator_norm(expected)))
