"""Order of the losses: Ks before K, and the larger subspace before the smaller."""

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from loops import LinearFrictional, Scene, macroscopic_tangent
from patterns import random_loop, regular_polygon
from stability import Stage, follow, programmes, restrict, spectrum, symmetric_spectrum

SUBSPACES = ("full", "symmetric", "diagonal")
CLOSURES = st.sampled_from(["affine", "traction"])
SPINS = st.sampled_from(["blocked", "affine", "free"])
LAWS = st.builds(
    LinearFrictional,
    kn=st.just(1.0),
    kt=st.floats(0.05, 1.5),
    mu=st.sampled_from([0.1, 0.5, np.inf]),
)
LOOPS = st.builds(
    random_loop,
    st.integers(3, 8),
    st.integers(0, 10_000),
    polydispersity=st.sampled_from([0.0, 0.3]),
    strain=st.floats(0.001, 0.3),
)


@settings(max_examples=60)
@given(LOOPS, LAWS, CLOSURES, SPINS)
def test_bromwich_and_interlacing(loop, law, closure, spins):
    """Real parts of the spectrum of K lie between the ends of that of Ks; subspaces are nested."""
    A = macroscopic_tangent(loop, law, closure, spins=spins).matrix
    if not np.isfinite(A).all():
        return
    ends = []
    for subspace in SUBSPACES:
        K = restrict(A, subspace)
        slack = 1e-13 * np.linalg.norm(K)
        symmetric, real = symmetric_spectrum(K), spectrum(K).real
        assert symmetric[0] - slack <= real.min() <= real.max() <= symmetric[-1] + slack
        ends.append((symmetric[0], symmetric[-1]))
    slack = 1e-13 * np.linalg.norm(A)
    for (low, high), (inner_low, inner_high) in pairwise(ends):
        assert low <= inner_low + slack
        assert inner_high <= high + slack


@settings(max_examples=5)
@given(
    st.integers(3, 6),
    st.sampled_from(["vertex", "edge"]),
    st.floats(0.1, 0.8),
    st.floats(3.0, 30.0),
    CLOSURES,
)
def test_losses_come_in_order_along_a_path(order, orientation, kappa, phi, closure):
    """Along a path Ks is lost no later than K, and no later in a larger subspace."""
    law = LinearFrictional(kn=1.0, kt=kappa, mu=np.tan(np.radians(phi)))
    stages = [
        Stage(programmes.isotropic_strain(), "H11", 0.15),
        Stage(programmes.drained_biaxial(), "H11", 0.35),
    ]
    path = follow(
        Scene(regular_polygon(order, orientation=orientation), law),
        stages,
        closure=closure,
        max_steps=300,
    )
    A = path.A[np.isfinite(path.A).all(axis=(1, 2))]
    first = []
    for subspace in SUBSPACES:
        K = restrict(A, subspace)
        slack = 1e-11 * np.linalg.norm(K, axis=(1, 2))
        lost_work = symmetric_spectrum(K)[:, 0] < -slack
        lost_stability = spectrum(K).real.min(axis=-1) < -slack
        assert (lost_work | ~lost_stability).all()
        first.append(int(np.argmax(lost_work)) if lost_work.any() else len(A))
    assert first == sorted(first)
