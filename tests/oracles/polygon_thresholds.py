"""Strain at which Ks of a regular loop is lost in (11, 22) under isotropic compression.

In the frames of the contacts a deviatoric load is a wave of two periods around the loop. The
normal forces take their part of it against kn, the shear forces theirs against kt - N/l; the
spins of five and more grains roll with the wave and add `l^2 cot^2(2 pi/n)/(4 k_r)` to 1/kt.
Uniform forces are a wave of one period: they help the triangle alone, where the two are one.
With `N = kn delta/p` (p = 1 linear, 3/2 Hertz) the loss is `N/(kn l) = E/(p (1 - E)) = kappa'`.
"""

import numpy as np
from scipy.optimize import brentq


def critical_strain(order, kappa, closure, *, exponent=1.0, rolling=None):
    """Vertex on axis 1. `rolling(E)` is `k_r/(kn l^2)` at the strain E; None if spins are blocked.

    `inf` is a rigid rolling spring, 0 none.
    """

    def tangential(strain):
        if rolling is None:
            return kappa
        turn = 0.0 if order == 4 else 1 / np.tan(2 * np.pi / order) ** 2 / 4
        if turn == 0:
            return kappa
        ratio = rolling(strain)
        return 0.0 if ratio == 0 else 1 / (1 / kappa + turn / ratio)

    # The triangle has no freedom that the strain leaves; the square on its tip shears alone.
    normal = 1.0 if order != 4 and (closure == "affine" or order == 3) else 0.0

    def excess(strain):
        return strain / (exponent * (1 - strain)) - normal - tangential(strain)

    return brentq(excess, 0.0, 1 - 1e-9, xtol=1e-15, rtol=1e-14)
