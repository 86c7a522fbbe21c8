"""Bad input to the diamond is named: what, where, expected, remedy."""

from importlib import import_module

import numpy as np
import pytest

from loops import InputError
from patterns import diamond
from tests.oracles.diamond import (
    DiamondParameters,
    critical_strain,
    determinant_sliding,
    drained_slope,
    elastic_moduli,
    isotropic_strain_of_stress,
    overlap_ratio,
    sliding_moduli,
    tangent,
    work_shear_then_compress,
)

BAD_CALLS = {
    "angle zero": (lambda: diamond(0.0), r"alpha0: got 0, expected an angle between"),
    "angle right": (lambda: diamond(np.pi / 2), r"alpha0: got 1\.57"),
    "angle in degrees": (lambda: diamond(45.0), r"alpha0: got 45, .*radians"),
    "angle in a batch": (lambda: diamond([0.5, -0.5]), r"alpha0\[1\]: got -0\.5"),
    "angle missing": (lambda: diamond(np.nan), r"alpha0: got nan, expected a finite number"),
    "strain one": (lambda: diamond(0.7, E1=1.0), r"E1: got 1, .*below 1"),
    "strain infinite": (lambda: diamond(0.7, E2=-np.inf), r"E2: got -inf, expected a finite"),
    "strain parts grains": (lambda: diamond(0.7, E1=-0.1), r"E1, E2: .*part the grains.*Compress"),
    "shear missing": (lambda: diamond(0.7, T=np.nan), r"T: got nan"),
    "radius zero": (lambda: diamond(0.7, radius=0.0), r"radius: got 0, expected a positive"),
    "stiffness zero": (lambda: diamond(0.7, kn=0.0), r"kn: got 0, expected a positive"),
    "kappa negative": (lambda: elastic_moduli([0.1, -0.1]), r"kappa\[1\]: got -0\.1.*zero or more"),
    "kappa at the critical strain": (lambda: critical_strain(-1.0), r"kappa: got -1,"),
    "friction negative": (lambda: sliding_moduli(0.7, -0.1, 1), r"mu: got -0\.1"),
    "sign zero": (lambda: sliding_moduli(0.7, 0.1, 0), r"s: got 0, expected \+1 or -1"),
    "sign of sliding": (
        lambda: determinant_sliding(0.1, 0.1, 0.1, 0.1, 0.7, 0.1, 2),
        r"s: got 2, expected \+1 or -1",
    ),
    "branch angle": (lambda: sliding_moduli(1.6, 0.1, 1), r"alpha: got 1\.6"),
    "overlap strain": (lambda: overlap_ratio(0.1, 2.0, 0.5), r"E2: got 2"),
    "stress missing": (lambda: tangent(0.1, 0.1, np.nan, 0.1, 0.7, 0.2, 0.2), r"s1: got nan"),
    "stress too high": (
        lambda: isotropic_strain_of_stress(1.5, np.pi / 4),
        r"isotropic strain under s1",
    ),
    "slope shape": (lambda: drained_slope([1.0, 2.0]), r"K: got shape \(2,\)"),
    "work length": (lambda: work_shear_then_compress(0.0, 1, 1, 1, 1), r"length: got 0"),
    "parameters angle": (lambda: DiamondParameters(1.6, 0.2, 0.1, 0.1), r"alpha0: got 1\.6"),
    "parameters kappa": (lambda: DiamondParameters(0.7, -0.2, 0.1, 0.1), r"kappa: got -0\.2"),
    "parameters friction": (lambda: DiamondParameters(0.7, 0.2, 1.7, 0.1), r"phi: got 1\.7"),
    "parameters confinement": (
        lambda: DiamondParameters(0.7, 0.2, 0.1, -0.1),
        r"confinement: got -0\.1.*expected a compressive strain in \[0, 1\)",
    ),
}


@pytest.mark.parametrize("name", BAD_CALLS)
def test_bad_input_is_named(name):
    call, message = BAD_CALLS[name]
    with pytest.raises(InputError, match=message):
        call()


def test_frictionless_and_infinite_friction():
    assert DiamondParameters(0.7, 0.2, 0.0, 0.1).mu == 0.0
    assert DiamondParameters(0.7, 0.2, np.pi / 2, 0.1).mu == np.inf


def test_everything_public_is_documented_and_exported():
    # By its name: `patterns` may offer the constructor under the package's own.
    package = import_module("patterns.diamond")
    shown = [value for value in vars(package).values() if callable(value)]
    assert len(shown) > 15 and all(value.__doc__ for value in shown)
