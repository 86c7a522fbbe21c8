"""Rotating, mirroring, renumbering or scaling a loop changes nothing but the frame."""

import pytest

from loops import LinearFrictional, Scene, macroscopic_tangent
from patterns import regular_polygon
from stability import Stage, follow, programmes, restrict, symmetric_spectrum


@pytest.mark.parametrize("order", [3, 4, 6, 7])
@pytest.mark.parametrize("orientation", ["vertex", "edge"])
def test_affine_is_never_softer(order, orientation):
    """Along an isotropic path, as long as the loop's K is positive definite (T = 0: symmetric)."""
    stage = Stage(programmes.isotropic_strain(), "H11", 0.25)
    loop = regular_polygon(order, orientation=orientation)
    law = LinearFrictional(kn=1.0, kt=0.4)
    path = follow(Scene(loop, law), stage, closure="affine")
    for row in range(0, len(path), 3):
        state = loop.replace(x=path.x[row], normal_force=path.normal_force[row])
        relaxed = macroscopic_tangent(state, law, "traction").matrix
        for subspace in ("diagonal", "symmetric", "full"):
            difference = restrict(path.A[row] - relaxed, subspace)
            assert symmetric_spectrum(difference)[0] > -1e-13
