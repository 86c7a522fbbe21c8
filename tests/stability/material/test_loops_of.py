"""Loops of a packing as a material, and the H-model's cell against its published rates."""

import numpy as np
import pytest

from grainloops import LoopMaterial, loops_of, march, oriented
from loops import InputError, LinearFrictional, Scene, affine_tangent, love_weber_stress
from patterns import hexagon, read_snapshot, sample_cell, sample_path
from stability import Stage

MU = np.tan(np.radians(30))
ONE = np.eye(2)[None]


@pytest.fixture(scope="module")
def packing():
    return read_snapshot(sample_path("grains_periodic.parquet"), cell=sample_cell())


def test_all_loops_of_a_packing_have_its_stress_and_its_affine_tangent(packing):
    loops = loops_of(packing)
    material = LoopMaterial(loops, closure="affine")
    response = material.update(ONE, material.start(1))
    area = np.abs(np.linalg.det(packing.graph.cell))
    assert abs(loops.areas.sum() / area - 1.0) < 1e-12
    # Contacts of dangling grains belong to no loop, all others to two.
    graph = packing.graph
    counted = np.bincount(loops.contacts, minlength=graph.contact_count)
    assert set(counted) == {0, 2}
    forces = graph.normal_force * (counted > 0), graph.shear_force * (counted > 0)
    sample = love_weber_stress(graph.replace(normal_force=forces[0], shear_force=forces[1]))
    size = np.abs(sample).max()
    half = 0.5 * (sample + sample.T)
    assert np.allclose(response.stress[0], half, rtol=0, atol=1e-8 * size)
    # The packing's affine tangent, with every contact stuck, in the symmetric subspace.
    graph = graph.replace(regime=(counted > 0).astype(np.int8))
    exact = affine_tangent(graph, packing.law).matrix
    own = response.tangent[0].reshape(4, 4)
    basis = np.array([[1, 0, 0, 0], [0, 0, 0, 1], [0, 0.5**0.5, 0.5**0.5, 0]])
    difference = basis @ (own - exact) @ basis.T
    # The antisymmetric part of the packing's stress is a couple of the spins: not of the mean.
    assert np.abs(difference).max() < 1e-5 * np.abs(exact).max()


def test_a_loop_out_of_its_packing_stays_at_rest_under_its_dead_load(packing):
    loops = loops_of(packing, orders=[3, 4, 5, 6], count=50)
    assert set(loops.orders) == {3, 4, 5, 6}
    material = LoopMaterial(loops)
    state = material.start(1)
    response = material.update(ONE, state)
    assert not response.failed.any()
    assert np.allclose(response.state.branches, state.branches, rtol=0, atol=1e-15)
    assert np.allclose(response.state.loop_stress, state.loop_stress, rtol=1e-9)
    # The forces are those of the snapshot, whole contacts, where positions have few digits too.
    size = np.ptp(packing.graph.x)
    rounded = packing.graph.replace(x=size * np.round(packing.graph.x / size, 7))
    for read in (packing, Scene(rounded, packing.law)):
        cut = loops_of(read, orders=[4, 5, 6], count=50)
        stress = LoopMaterial(cut).start(1).loop_stress[0].reshape(-1, 2, 2)
        assert np.allclose(stress, cut.stress / cut.share, rtol=0, atol=1e-9 * stress.max())
    # Mixed orders, one material: the weighted mean of the orders' own.
    F = ONE - np.array([[[2e-6, 0.0], [0.0, -1e-6]]])
    both = material.update(F, state).stress
    apart = []
    for order in (3, 4, 5, 6):
        chosen = loops.weights * (loops.orders == order)
        part = LoopMaterial(loops, chosen)
        apart.append(chosen.sum() * part.update(F, part.start(1)).stress)
    assert np.allclose(both, sum(apart) / loops.weights.sum(), rtol=1e-12)


def test_loops_come_apart_unless_their_packing_loads_them(packing):
    free = LoopMaterial(hexagon(np.radians(60)), None, LinearFrictional(1.0, 0.5, MU))
    apart = free.update(1.02 * ONE, free.start(1))
    assert not apart.stress.any() and not apart.failed.any() and apart.regimes[0, 2] == 1.0
    loaded = LoopMaterial(loops_of(packing, orders=[4, 5, 6], count=50))
    with pytest.raises(InputError, match="100% of the loops of point 0 without a solution"):
        loaded.update(1.02 * ONE, loaded.start(1))


def test_what_loops_of_refuses(packing):
    for options, words in (
        ({"orders": [2]}, "orders"),
        ({"orders": [300]}, "none of the orders"),
        ({"count": 0}, "count"),
    ):
        with pytest.raises(InputError, match=words):
            loops_of(packing, **options)


def published_rates(d1, alpha, N1, T1, sliding, dl, kn, kt, mu):
    """Rates (d1, d2, alpha) of a cell whose extents change by `dl`; Nicot and Darve (2011).

    Rows: both extents, and the balance of a shoulder, N2 = N1 cos(alpha) + T1 sin(alpha), in
    rates; T1 is positive where alpha grows.
    """
    c, s = np.cos(alpha), np.sin(alpha)
    balance = [c, -1.0, (N1 * s - T1 * c - kt * d1 * s) / kn]
    if sliding:
        side = np.sign(T1)
        balance = [c + side * mu * s, -1.0, (N1 * s - T1 * c) / kn]
    rows = np.array([[2 * c, 1.0, -2 * d1 * s], [2 * s, 0.0, 2 * d1 * c], balance])
    return np.linalg.solve(rows, [dl[0], dl[1], 0.0])


@pytest.mark.parametrize("E", [(0.02, 0.02), (0.06, 0.0)])
def test_cells_follow_the_published_rates(E):
    """Thousands of explicit steps of the published incremental form, to first order."""
    kn, kt, alpha0 = 1.0, 0.5, np.radians(60)
    law = LinearFrictional(kn, kt, MU)
    loop = hexagon(alpha0)
    material = LoopMaterial(loop, None, law, closure="cell")
    extent = np.array([1.0 + 2 * np.cos(alpha0), 2 * np.sin(alpha0)])
    area = np.sin(alpha0) * (2 + 2 * np.cos(alpha0))
    errors = []
    for steps in (2000, 4000):
        d1, d2, alpha, T1 = 1.0, 1.0, alpha0, 0.0
        for _ in range(steps):
            N1 = kn * (1.0 - d1)
            dl = -extent * np.array(E) / steps
            for sliding in (False, True):
                change = published_rates(d1, alpha, N1, T1, sliding, dl, kn, kt, MU)
                new = N1 - kn * change[0], T1 + kt * d1 * change[2]
                if abs(new[1]) < MU * new[0]:
                    break
            T1 = np.sign(T1) * MU * new[0] if sliding else new[1]
            d1, d2, alpha = d1 + change[0], d2 + change[1], alpha + change[2]
        N1, N2 = kn * (1.0 - d1), kn * (1.0 - d2)
        P = np.array([
            2 * N2 * extent[0], 2 * (N1 * np.sin(alpha) - T1 * np.cos(alpha)) * extent[1]
        ]) / area  # fmt: skip
        state = material.start(1)
        for k in range(1, 65):
            response = material.update(ONE - np.diag(E)[None] * k / 64, state)
            state = response.state
        assert (response.regimes[0, 1] > 0) == (E[1] == 0.0)
        errors.append(np.abs(np.diag(response.stress[0]) - P).max())
    # An explicit integration: its error halves with its step.
    assert errors[0] < 1e-5 and errors[1] < 0.55 * errors[0]


def test_a_cell_differs_from_traction_by_the_loads_on_its_shoulders():
    """Under an isotropic strain its axial contacts carry about half of what inclined ones do."""
    law = LinearFrictional(1.0, 0.5, MU)
    loop, F = hexagon(np.radians(60)), 0.98 * ONE
    cell, traction = (
        LoopMaterial(loop, None, law, closure=closure) for closure in ("cell", "traction")
    )
    one, two = (m.update(F, m.start(1)) for m in (cell, traction))
    # Regular, under traction: N = kn l0 E in all contacts, P = 2 N/sqrt(3) over an area of one.
    assert np.allclose(np.diag(two.stress[0]), 0.02 * 2 / 3**0.5 / 1.0, rtol=1e-12)
    d = one.state.branches[0]
    N1, N2 = 1.0 - np.hypot(*d[0]), 1.0 - d[1, 0]
    alpha = np.arctan2(d[0, 1], d[0, 0])
    T1 = -one.state.shear_force[0, 0]
    assert abs(N2 - (N1 * np.cos(alpha) + T1 * np.sin(alpha))) < 1e-14
    assert N2 < 0.7 * N1 and abs(one.stress[0, 0, 0] - one.stress[0, 1, 1]) > 1e-3


def test_averaged_cells_harden_where_averaged_hexagons_peak():
    law = LinearFrictional(1.0, 0.5, MU)
    material = LoopMaterial(oriented(hexagon(np.radians(60)), 36), None, law, closure="cell")
    stages = [Stage("isotropic_stress", "P11", 1e-2), Stage("drained_biaxial", "H11", 0.1)]
    path = march(material, stages, 100)
    ratio = path.P[path.stage == 1, 0] / 1e-2
    assert path.status == "finished" and (np.diff(ratio) > 0).all()
    assert abs(ratio[-1] - 2.62) < 0.05
