"""Stability of many loops at once: modes, unstable directions, cones of their tangents."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from loops.arrays import Floats
from stability.cones import plane_cone
from stability.spectra import symmetric_modes
from stability.subspaces import restrict
from stability.unstable_fraction import unstable_fraction


class LoopStability(NamedTuple):
    """Stability of loops; not a number where the tangent is not finite.

    `eigenvalues` (L, 3): Of Ks in the symmetric subspace (11, 22, (12 + 21)/sqrt 2), ascending
    (unit of the tangent); `unstable_fraction` (L,): Share of the directions of that subspace with
    negative second-order work; `cone_opening` (L,): Opening of the cone of negative second-order
    work in the plane (11, 22), radians; 0 if none; `soft_angle` (L,): Direction of the softest
    mode, radians in (-pi/2, pi/2], see `soft_angle`.
    """

    eigenvalues: Floats
    unstable_fraction: Floats
    cone_opening: Floats
    soft_angle: Floats


def loop_stability(tangents: Floats, *, compiled: bool = False) -> LoopStability:
    """Judge tangents in the symmetric subspace."""
    if compiled:
        from stability.compiled.modes import loop_modes

        values, softest, opening = loop_modes(np.ascontiguousarray(tangents))
    else:
        values, vectors = symmetric_modes(restrict(tangents, "symmetric"))
        softest = vectors[..., :, 0]
        opening = plane_cone(restrict(tangents, "diagonal")).opening
    # Most loops are stable: nothing to integrate.
    fraction = np.where(np.isnan(values[..., 0]), np.nan, 0.0)
    negative = values[..., 0] < 0
    fraction[negative] = unstable_fraction(values[negative])
    return LoopStability(values, fraction, opening, soft_angle(softest))


def loop_spectra(tangents: Floats, *, compiled: bool = False) -> Floats:
    """(L, 3) eigenvalues of Ks in the symmetric subspace alone, as `loop_stability` has them."""
    if compiled:
        from stability.compiled.modes import loop_modes

        return np.asarray(loop_modes(np.ascontiguousarray(tangents))[0])
    return symmetric_modes(restrict(tangents, "symmetric"))[0]


def soft_angle(directions: Floats) -> Floats:
    """Direction of a strain without a sign: the axis of its principal value of larger size.

    A mode is known up to its sign. With the sign that makes this principal value a compression, the
    angle is that of the axis of compression. Of a pure shear both principal values have the same
    size: the angle is then that of either.
    """
    trace = directions[..., 0] + directions[..., 1]
    sign = np.where(trace < 0, -1.0, 1.0)
    difference = sign * (directions[..., 0] - directions[..., 1])
    # Adding zero turns -0 into 0: an angle of -pi/2 would lie outside the range.
    shear = sign * np.sqrt(2.0) * directions[..., 2] + 0.0
    return np.asarray(0.5 * np.arctan2(shear, difference))
