"""Equations (17)-(57) of the tangents against independent derivations."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from loops import LinearFrictional, Regime, macroscopic_tangent, nominal_stress
from stability import bromwich_margin, restrict, second_order_work, symmetric_part
from tests.oracles.diamond import (
    congruence,
    critical_strain,
    determinant,
    determinant_elastic,
    determinant_sliding,
    force_geometric_tangent,
    force_material_tangent,
    force_rates,
    force_tangent,
    geometric_asymmetry,
    geometric_softening,
    geometric_tangent,
    isotropic_determinant,
    isotropic_tangent,
    lagrangian_tangent,
    material_tangent,
    side_rates,
    tangent,
)
from tests.oracles.paper_samples import Samples, difference, operator_difference, random_samples

Floats = NDArray[np.float64]


def tangent_residuals() -> dict[str, float]:
    """Largest difference of each group of equations from its independent derivation."""
    elastic, sliding = random_samples(sliding=False), random_samples(sliding=True)
    both = (elastic, sliding)
    return {
        "14, 17-20": max(_force_tangent(samples) for samples in both),
        "21-24, 48": max(_lagrangian(samples) for samples in both),
        "25-26": max(_generic(samples) for samples in both),
        "27-28, 53-57": max(_split(samples) for samples in both),
        "29": _material_asymmetry(sliding),
        "30-31": _geometric_asymmetry(elastic),
        "34-36": max(_determinants(samples) for samples in both),
        "37": _softening(elastic),
        "38-43": _isotropic(elastic),
        "44-45": _second_order_work(elastic),
        "46-47": max(_love_weber(samples) for samples in both),
        "49-52": _congruence(elastic),
    }


def appendix_one() -> dict[str, float]:
    """What Appendix I says of `K^` and `K~`, measured: signs agree, eigenvalues do not."""
    samples = random_samples(sliding=False)
    hat, tilde = _hat_and_tilde(samples)
    signs = [np.sign(np.linalg.eigvalsh(symmetric_part(K))) for K in (hat, tilde)]
    square = Samples(**{**vars(samples), "alpha0": np.full_like(samples.alpha0, np.pi / 4)})
    return {
        "signs_differ": float(np.count_nonzero((signs[0] != signs[1]).any(axis=1))),
        "largest_relative_gap": _eigenvalue_gap(hat, tilde),
        "gap_at_45_degrees": _eigenvalue_gap(*_hat_and_tilde(square)),
    }


def _force_tangent(samples: Samples) -> float:
    """`K~ Delta'` against the rates of forces that the contact law gives."""
    rates = side_rates(samples.length, samples.alpha, samples.length_rate, samples.alpha_rate)
    found = np.einsum("nij,nj->ni", _tilde(samples), -np.stack(rates, axis=1))
    expected = force_rates(*samples.law_rates, samples.alpha_rate, *samples.forces, samples.alpha)
    return difference(found.T, expected)


def _lagrangian(samples: Samples) -> float:
    found = lagrangian_tangent(_tilde(samples), samples.alpha0)
    return operator_difference(found, _tangent(samples))


def _generic(samples: Samples) -> float:
    """(26) against the operators of any loop, under both closures."""
    law = LinearFrictional(
        kn=np.ones((len(samples.N), 4)), kt=samples.kappa[:, None], mu=samples.mu[:, None]
    )
    regime = np.full((len(samples.N), 4), Regime.SLIDING if samples.slides else Regime.ELASTIC)
    box = 2.0 * np.sin(2.0 * samples.alpha0)
    errors = []
    for closure in ("affine", "traction"):
        generic: Any = macroscopic_tangent(samples.graph, law, closure, regime=regime, volume=box)
        found = restrict(generic.matrix, "diagonal")
        errors.append(operator_difference(found, _tangent(samples)))
    return max(errors)


def _split(samples: Samples) -> float:
    """Kmat and Kgeo against the transformed parts of `K~`, and their sum against (26)."""
    E1, E2, s1, s2 = samples.carried
    moduli = samples.moduli
    material = material_tangent(E1, E2, samples.alpha0, *moduli)
    geometric = geometric_tangent(E1, E2, s1, s2, samples.alpha0)
    parts = (
        force_material_tangent(*samples.sides, *moduli),
        force_geometric_tangent(*samples.sides, *samples.forces),
    )
    hats = [lagrangian_tangent(part, samples.alpha0) for part in parts]
    return max(
        operator_difference(hats[0], material),
        operator_difference(hats[1], geometric),
        operator_difference(material + geometric, _tangent(samples)),
    )


def _material_asymmetry(samples: Samples) -> float:
    E1, E2, _, _ = samples.carried
    Kmat = material_tangent(E1, E2, samples.alpha0, *samples.moduli)
    return difference(Kmat[:, 0, 1] - Kmat[:, 1, 0], np.sign(samples.T) * samples.mu)


def _geometric_asymmetry(samples: Samples) -> float:
    """`Kgeo12 - Kgeo21` against `-T/(kn l)`: it vanishes where T does."""
    Kgeo = geometric_tangent(*samples.carried, samples.alpha0)
    expected = -samples.T / samples.length
    closed = geometric_asymmetry(*samples.carried, samples.alpha)
    return max(difference(Kgeo[:, 0, 1] - Kgeo[:, 1, 0], expected), difference(closed, expected))


def _determinants(samples: Samples) -> float:
    expected = np.linalg.det(_tangent(samples))
    carried = samples.carried
    general = determinant(*carried, samples.alpha, *samples.moduli)
    if samples.slides:
        own = determinant_sliding(*carried, samples.alpha, samples.mu, np.sign(samples.T))
    else:
        own = determinant_elastic(*carried, samples.alpha, samples.kappa)
    return max(difference(general, expected), difference(own, expected))


def _softening(samples: Samples) -> float:
    """Left side of (37) against `N/(kn l)`."""
    found = geometric_softening(*samples.carried, samples.alpha)
    return difference(found, samples.N / samples.length)


def _isotropic(samples: Samples) -> float:
    """(38)-(40) against (26), the determinant, and (42), (43) at their states."""
    E, alpha0, kappa = samples.N, samples.alpha0, samples.kappa
    t0 = np.tan(alpha0)
    found = isotropic_tangent(E, alpha0, kappa)
    expected = tangent(E, E, E / t0, E * t0, alpha0, kappa, kappa)
    critical = isotropic_tangent(critical_strain(kappa), alpha0, kappa)
    c, s = np.cos(alpha0), np.sin(alpha0)
    at_critical = np.stack([c**2 / t0, c * s, c * s, s**2 * t0], axis=-1).reshape(-1, 2, 2)
    square = isotropic_tangent(E, np.pi / 4, kappa)
    excess = 0.5 * (kappa - E / (1.0 - E))
    at_45 = np.stack([0.5 + excess, 0.5 - excess, 0.5 - excess, 0.5 + excess], axis=-1)
    return max(
        operator_difference(found, expected),
        difference(isotropic_determinant(E, kappa), np.linalg.det(expected)),
        operator_difference(critical, at_critical),
        operator_difference(square, at_45.reshape(-1, 2, 2)),
    )


def _second_order_work(samples: Samples) -> float:
    """`s'.E'` against the quadratic form of Ks; Bromwich's inequality adds its violation."""
    K = _tangent(samples)
    E = np.stack([samples.length_rate, samples.alpha_rate], axis=1)
    form = np.einsum("ni,nij,nj->n", E, symmetric_part(K), E)
    violation = max(0.0, -float(np.min(bromwich_margin(K))))
    return difference(second_order_work(K, E), form) + violation


def _love_weber(samples: Samples) -> float:
    """Nominal Love-Weber stress of the grain graph against F1/L20, F2/L10."""
    _, _, s1, s2 = samples.carried
    box = 2.0 * np.sin(2.0 * samples.alpha0)
    P = nominal_stress(samples.graph, volume=box)
    return difference((P[:, 0, 0], P[:, 1, 1]), (s1, s2))


def _congruence(samples: Samples) -> float:
    hat, tilde = _hat_and_tilde(samples)
    D = congruence(samples.alpha0)
    return operator_difference(D @ tilde @ D, hat)


def _hat_and_tilde(samples: Samples) -> tuple[Floats, Floats]:
    tilde = _tilde(samples)
    return lagrangian_tangent(tilde, samples.alpha0), tilde


def _eigenvalue_gap(hat: Floats, tilde: Floats) -> float:
    values = [np.sort_complex(np.linalg.eigvals(K)) for K in (hat, tilde)]
    return float(np.max(np.abs(values[0] - values[1]) / np.abs(values[1]).max(axis=1)[:, None]))


def _tilde(samples: Samples) -> Floats:
    return force_tangent(*samples.sides, *samples.forces, *samples.moduli)


def _tangent(samples: Samples) -> Floats:
    return tangent(*samples.carried, samples.alpha0, *samples.moduli)
