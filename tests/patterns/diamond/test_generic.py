"""The operator of any loop, restricted to (11, 22), against the diamond's own (26)."""

import numpy as np
import pytest

from loops import LinearFrictional, Regime, affine_tangent, nominal_stress, traction_tangent
from patterns import diamond
from stability import restrict
from tests.oracles.diamond import elastic_moduli, sliding_moduli, tangent

COUNT = 1200


def random_diamonds(seed, sliding):
    """Random states: angles 10 to 80 degrees, overlaps to 40 %, either sign of T."""
    rng = np.random.default_rng(seed)
    alpha0 = np.radians(rng.uniform(10, 80, COUNT))
    kappa, mu = rng.uniform(0.01, 1.5, COUNT), np.tan(np.radians(rng.uniform(2, 40, COUNT)))
    e1 = rng.uniform(0.0, 0.4, COUNT)
    e2 = e1 * rng.uniform(0.6, 1.4, COUNT)
    normal = diamond(alpha0, E1=e1, E2=e2).normal_force[:, 0]
    side = np.sign(rng.uniform(-1, 1, COUNT))
    share = 1.0 if sliding else rng.uniform(0, 0.99, COUNT)
    shear = side * share * mu * np.maximum(normal, 0)
    loop = diamond(alpha0, E1=e1, E2=e2, T=shear)
    keep = normal > 1e-3
    return loop, alpha0, kappa, mu, e1, e2, shear, keep


@pytest.mark.parametrize("sliding", [False, True])
@pytest.mark.parametrize("closure", [affine_tangent, traction_tangent])
def test_generic_operator_is_equation_26(closure, sliding):
    loop, alpha0, kappa, mu, e1, e2, shear, keep = random_diamonds(26, sliding)
    assert keep.sum() >= 1000
    box = 2 * np.sin(2 * alpha0)
    s = nominal_stress(loop, volume=box)
    law = LinearFrictional(kn=1.0, kt=kappa[:, None], mu=mu[:, None])
    regime = np.full((COUNT, 4), Regime.SLIDING if sliding else Regime.ELASTIC)
    found = closure(loop, law, regime=regime, volume=box)
    generic = restrict(found.matrix, "diagonal")
    alpha = np.arctan(np.tan(alpha0) * (1 - e2) / (1 - e1))
    moduli = sliding_moduli(alpha, mu, np.sign(shear)) if sliding else elastic_moduli(kappa)
    closed = tangent(e1, e2, s[:, 0, 0], s[:, 1, 1], alpha0, *moduli)
    error = np.linalg.norm(generic - closed, axis=(1, 2)) / np.linalg.norm(closed, axis=(1, 2))
    if closure is affine_tangent:
        assert error[keep].max() < 1e-13
    else:
        # The relaxing closure solves a system: its stated condition bounds the error.
        bound = np.maximum(1e-13, np.finfo(float).eps * found.condition)
        assert (error < bound)[keep].all()
        assert np.median(error[keep]) < 1e-14
    # The symmetric loop keeps (11, 22) apart from shear.
    mixed = found.matrix[keep][:, [0, 3]][:, :, [1, 2]]
    assert np.abs(mixed).max() < 1e-10


def test_the_test_bites():
    """With the wrong sign of T the comparison fails by far."""
    loop, alpha0, kappa, mu, e1, e2, _, keep = random_diamonds(27, sliding=False)
    box = 2 * np.sin(2 * alpha0)
    s = nominal_stress(loop, volume=box)
    law = LinearFrictional(kn=1.0, kt=kappa[:, None], mu=mu[:, None])
    wrong = loop.replace(shear_force=-loop.shear_force)
    generic = restrict(affine_tangent(wrong, law, volume=box).matrix, "diagonal")
    closed = tangent(e1, e2, s[:, 0, 0], s[:, 1, 1], alpha0, *elastic_moduli(kappa))
    assert np.abs(generic - closed)[keep].max() > 1e-2
