"""Loops in place by agreeing regimes: against the matrix assembled anew, and against sampling."""

import functools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from loops import HertzMindlin, Regime, Scene, contact_state
from loops.in_place import loop_loads, polygons_of
from loops.system import in_freedoms, relative_motion, stiffness_matrix
from patterns import read_snapshot, sample_path
from stability import restrict, subspace_basis
from stability.complementarity import solve_from
from stability.factor import Factor
from stability.packing import loops_at_yield
from tests.packings import LAW, loops_in_place, packing, packing_system

ROUGH = Path(__file__).parents[2] / "studies/series/rough/grains_04.csv.gz"
CELL = np.array([[0.914723458490276, 0.0], [0.0, 0.897826511170329]])
BASIS = subspace_basis("symmetric")
# Packings of which some loops are unstable, with loops that are confirmed and others that aren't.
SMALL = ((16, 3, 0.3), (16, 7, 0.5), (30, 8, 0.3), (60, 2, 0.2))


@functools.cache
def small(grains, seed, sliding):
    scene = Scene(packing(grains, seed=seed, share=0.9, sliding=sliding), LAW)
    return scene, loops_at_yield(scene, 0.98)


def loop_of(scene, row):
    """Grains, boundary vectors and area of a loop."""
    for grains, vectors, area, rows in polygons_of(scene.graph, scene.faces).groups:
        if row in rows:
            k = int(np.flatnonzero(rows == row)[0])
            return grains[k], vectors[k], area[k]
    raise AssertionError


def with_sliding(scene, yielding, sliding):
    """The scene with the regimes of its contacts: these candidates slide, the others stick."""
    system, boundary = yielding.system, scene.boundary
    regimes, count = system.rows.state.regime.copy(), scene.graph.contact_count
    regimes[system.kept] = system.regime
    regimes[system.kept[yielding.rows[sliding]]] = Regime.SLIDING
    if boundary.walls is not None:
        slides = regimes[count:] == Regime.SLIDING
        boundary = replace(boundary, walls=replace(boundary.walls, sliding=slides))
    return Scene(scene.graph.replace(regime=regimes[:count]), scene.law, boundary)


def rates_of(scene, regimes, row, strain):
    """Motions `r` of the contacts, and the loop's stress, for a strain in given regimes."""
    system = packing_system(regimes)
    grains, vectors, area = loop_of(scene, row)
    loads = loop_loads(system, grains, vectors)
    under = Factor(system).solve(loads)
    stress = np.linalg.solve(loads.T @ under / area, strain)
    return system, relative_motion(system, -under @ stress), stress


def growth_beyond_strength(scene, system, motion):
    """`s T' - mu N'` of each contact if it stuck, by its law."""
    r = np.zeros((len(system.rows.ends), 4))
    r[system.kept] = motion

    def growth(law, state, r):
        g, b_i, b_j = law.shear_kinematics(state)
        turns = r[:, 2:] / system.length
        ut = g * np.sum(r[:, :2] * state.t, axis=1) - b_i * turns[:, 0] - b_j * turns[:, 1]
        un = np.sum(r[:, :2] * state.n, axis=1)
        D = law.local_stiffness(state, np.full(len(state.length), Regime.ELASTIC))
        normal, shear = -np.einsum("cij,jc->ic", D, [un, ut])
        mu = np.broadcast_to(law.mu, state.length.shape)
        return (np.sign(state.shear_force) * shear - mu * normal,)

    return system.rows.each(growth, r)[0][system.kept]


@pytest.mark.parametrize("which", SMALL)
def test_the_matrix_assembled_anew_has_the_same_work_and_no_contact_disagrees(which):
    """Each contact is judged by `s T'` against `mu N'`."""
    scene, found = small(*which)
    assert found.softening == 0 and (found.confirmed <= found.unstable).all()
    agrees(scene, found)


def test_unstable_loops_without_candidates_are_confirmed_by_their_softest_mode():
    """Contacts so compressed that their geometry makes loops unstable, without shear forces."""
    graph = packing(16, seed=2)
    graph = graph.replace(normal_force=30 * graph.normal_force, shear_force=0 * graph.shear_force)
    found = loops_at_yield(Scene(graph, LAW), 0.9)
    assert len(found.rates.rows) == 0 and found.unstable.sum() == 7
    np.testing.assert_array_equal(found.confirmed, found.unstable)
    loops = found.confirmed
    np.testing.assert_allclose(found.work[loops], found.smallest[loops], rtol=1e-9)


def test_loops_of_hertzian_grains_in_regimes_that_agree():
    law = HertzMindlin(20.0, 0.3, 0.5, shear_increment="radii", shear_history="displacement")
    graph = packing(16, seed=3, share=0.9, sliding=0.3)
    N = law.normal_force(contact_state(graph))
    graph = graph.replace(normal_force=N, shear_force=graph.shear_force / graph.normal_force * N)
    scene = Scene(graph, law)
    found = loops_at_yield(scene, 0.98)
    assert found.softening == 0 and found.confirmed.sum() == 6
    agrees(scene, found)


def agrees(scene, found, step=1):
    """Work and regimes of confirmed loops, by the matrix assembled in these regimes."""
    for row in np.flatnonzero(found.confirmed)[::step]:
        sliding, h = found.sliding[row], found.direction[row]
        assert np.linalg.norm(h) == pytest.approx(1.0, abs=1e-14)
        regimes = with_sliding(scene, found.rates, sliding)
        operator = restrict(loops_in_place(regimes).matrix[row], "symmetric")
        size = np.linalg.norm(operator)
        assert found.work[row] < 0
        assert found.work[row] == pytest.approx(h @ operator @ h, abs=1e-12 * size)
        system, motion, stress = rates_of(scene, regimes, row, h @ BASIS)
        assert found.work[row] == pytest.approx(h @ BASIS @ stress, abs=1e-12 * size)
        beyond = growth_beyond_strength(scene, system, motion)[found.rates.rows]
        tol = 1e-9 * np.abs(beyond).max()
        assert (beyond[sliding] > -tol).all() and (beyond[~sliding] < tol).all()


def test_how_many_loops_are_confirmed():
    """In the second and the fourth packing one of them only by going on from the softest mode."""
    found = [small(*which)[1] for which in SMALL]
    assert [int(one.unstable.sum()) for one in found] == [1, 7, 2, 7]
    assert [int(one.confirmed.sum()) for one in found] == [1, 2, 1, 1]


@functools.cache
def inverse_of(which):
    """Dense pseudo-inverse with all candidates sticking; their slips and rates."""
    yielding = small(*which)[1].rates
    system = yielding.system
    inverse = np.linalg.pinv(stiffness_matrix(system).toarray(), rcond=1e-10)
    push, gauge = (
        in_freedoms(system, yielding.rows, vectors).toarray()
        for vectors in (yielding.push, yielding.gauge)
    )
    return inverse, -inverse @ push.T, gauge


def slips_of(which, row):
    """`Q`, `M`, `A`, `Z` with `w = Q h + M z` and `P = A h + Z z`, by dense algebra."""
    scene, found = small(*which)
    inverse, motion, gauge = inverse_of(which)
    grains, vectors, area = loop_of(scene, row)
    B = loop_loads(found.rates.system, grains, vectors)
    A = area * np.linalg.inv(B.T @ inverse @ B)
    rates, strain = -gauge @ inverse @ B @ A, B.T @ motion / area
    M = np.eye(len(gauge)) + gauge @ motion + rates @ strain
    return rates @ BASIS.T, M, BASIS @ A @ BASIS.T, BASIS @ A @ strain


@pytest.mark.parametrize("which", SMALL)
def test_all_or_no_slips_give_the_operators_in_place(which):
    """`P = A_in h` with all candidates sliding, the stuck operator with none."""
    scene, found = small(*which)
    stuck = loops_at_yield(scene, None).matrix
    for row in np.flatnonzero(np.isfinite(found.matrix[:, 0, 0]))[::5]:
        Q, M, A, Z = slips_of(which, row)
        size = np.linalg.norm(A)
        slid = restrict(found.matrix[row], "symmetric")
        np.testing.assert_allclose(A - Z @ np.linalg.solve(M, Q), slid, atol=1e-11 * size, rtol=0)
        np.testing.assert_allclose(A, restrict(stuck[row], "symmetric"), atol=1e-12 * size, rtol=0)


def sphere(count):
    """Unit directions evenly over the sphere."""
    at = np.arange(count) + 0.5
    z, angle = 1 - 2 * at / count, np.pi * (1 + 5**0.5) * at
    return np.column_stack([*(np.sqrt(1 - z * z) * (np.cos(angle), np.sin(angle))), z])


@pytest.mark.parametrize("which", SMALL)
def test_directions_that_sampling_finds_are_found(which):
    """Descent misses no loop of these that 100 directions find, and none of its works is larger."""
    found = small(*which)[1]
    for row in np.flatnonzero(found.unstable):
        Q, M, A, Z = slips_of(which, row)
        least = np.inf
        for h in sphere(100):
            sliding = solve_from(Q @ h, M, np.zeros(len(M), dtype=bool))
            if sliding is not None:
                slip = np.linalg.solve(M[np.ix_(sliding, sliding)], -(Q @ h)[sliding])
                least = min(least, h @ (A @ h + Z[:, sliding] @ slip))
        assert found.confirmed[row] or not least < 0
        assert not found.work[row] > least + 1e-9 * np.linalg.norm(A)


def sample():
    return read_snapshot(sample_path("slow/grains_10.parquet"), cell=CELL).scene


@pytest.mark.slow
def test_loops_of_a_sample_in_regimes_that_agree():
    """Two thousand discs at rest: 293 candidates, 33 of 61 loops are confirmed."""
    scene = sample()
    found = loops_at_yield(scene, 0.999)
    assert (len(found.rates.rows), found.softening) == (293, 0)
    assert (int(found.unstable.sum()), int(found.confirmed.sum())) == (61, 33)
    agrees(scene, found, step=4)


def test_contacts_with_rough_plates_slide_too():
    scene = read_snapshot(ROUGH).scene
    found = loops_at_yield(scene, 0.7)
    at_plates = found.rates.rows >= len(found.rates.system.contacts)
    assert found.confirmed.sum() == 4 and found.sliding[found.confirmed][:, at_plates].any()
    agrees(scene, found, step=2)
