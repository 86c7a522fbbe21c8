"""Rotating, mirroring, renumbering or scaling a loop changes nothing but the frame."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from loops import GrainGraph, LinearFrictional, Scene, macroscopic_tangent
from patterns import random_loop, regular_polygon
from stability import Stage, follow, programmes, restrict, symmetric_spectrum

CLOSURES = ("affine", "traction")
LAW = LinearFrictional(kn=1.0, kt=0.4, mu=0.5)

unloaded = st.builds(random_loop, st.integers(3, 7), st.integers(0, 10_000))
frames = st.one_of(
    st.tuples(st.just("rotated"), st.floats(-3.0, 3.0)),
    st.tuples(st.just("mirrored"), st.floats(-3.0, 3.0)),
    st.tuples(st.just("renumbered"), st.integers(1, 8)),
    st.tuples(st.just("scaled"), st.floats(1e-3, 1e3)),
)


def moved(loop, frame):
    """The loop in another frame, and the matrix (2, 2) of the frame."""
    kind, value = frame
    turn, size, shift = np.eye(2), 1.0, 0
    if kind in ("rotated", "mirrored"):
        cos, sin = np.cos(value), np.sin(value)
        turn = np.array([[cos, -sin], [sin, cos]])
    if kind == "renumbered":
        shift = int(value)
    if kind == "scaled":
        size = value
    if kind == "mirrored":
        turn = turn @ np.diag([1.0, -1.0])
    grains = np.roll(np.arange(loop.grain_count), shift)
    contacts, sign = grains, 1.0
    if kind == "mirrored":
        # Counter-clockwise again: contact c joins what were grains n-1-c and n-2-c.
        grains = grains[::-1]
        contacts, sign = np.roll(grains, -1), -1.0
    image = GrainGraph(
        x=size * loop.x[grains] @ turn.T,
        x0=size * loop.x0[grains] @ turn.T,
        radii=size * loop.radii[grains],
        contacts=loop.contacts,
        normal_force=size * loop.normal_force[contacts],
        shear_force=sign * size * loop.shear_force[contacts],
    )
    return image, turn


@settings(max_examples=6, deadline=None)
@given(unloaded, frames, st.sampled_from(CLOSURES))
def test_short_paths(loop, frame, closure):
    image, turn = moved(loop, frame)
    size = frame[1] if frame[0] == "scaled" else 1.0
    stage = Stage(programmes.isotropic_strain(), "H11", 0.03)
    there, here = (follow(Scene(graph, LAW), stage, closure=closure) for graph in (loop, image))
    assert there.status == here.status
    both = np.kron(turn, turn)
    wanted = both @ there.P[-1]
    assert np.abs(here.P[-1] - wanted).max() < 1e-10
    kinds = [[e.kind for e in path.events if e.kind in ("yield", "opening")] for path in
             (there, here)]  # fmt: skip
    assert kinds[0] == kinds[1]
    N = there.normal_force[-1].sum() * size
    assert here.normal_force[-1].sum() == pytest.approx(N, rel=1e-9)


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
