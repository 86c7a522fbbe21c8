import numpy as np
import pytest

from loops import (
    GrainGraph,
    InputError,
    LinearFrictional,
    Regime,
    affine_tangent,
    assemble_tangent,
    boundary_vectors,
    contact_state,
    macroscopic_tangent,
    nominal_stress,
    traction_tangent,
)
from loops.closures.spins import affine_spin
from loops.closures.tangents import solved
from patterns import regular_polygon
from tests.oracles.finite_motion import external_forces
from tests.oracles.loop_balls import exact_tangent
from tests.oracles.rings import member, random_rings, ring, slide

LAW = LinearFrictional(kn=1.3, kt=0.5, mu=0.5)
SYMMETRIC = np.array([[1, 0, 0, 0], [0, 0, 0, 1], [0, 0.5**0.5, 0.5**0.5, 0]])


def relative(a, b):
    return np.linalg.norm(a - b, axis=(-2, -1)) / np.linalg.norm(b, axis=(-2, -1))


def with_open_chord(graph, law, regime=None):
    """Traction tangent by the saddle system: of the loop with a chord that carries nothing."""
    batch, n = graph.normal_force.shape[:-1], graph.grain_count
    regime = law.regime(contact_state(graph)) if regime is None else np.asarray(regime)
    added = np.zeros((*batch, 1))
    contacts = np.vstack([graph.contacts, [[0, n // 2]]])
    braced = GrainGraph(
        x=graph.x, x0=graph.x0, radii=graph.radii, contacts=contacts,
        normal_force=np.concatenate([graph.normal_force, added], axis=-1),
        shear_force=np.concatenate([graph.shear_force, added], axis=-1),
    )  # fmt: skip
    regime = np.concatenate([np.broadcast_to(regime, (*batch, n)), added], axis=-1)
    return traction_tangent(braced, law, regime=regime.astype(np.int8))


@pytest.mark.parametrize("order", range(4, 13))
def test_equations_of_a_ring_equal_the_saddle_system(order):
    """100 irregular loops of each order, elastic: below 1e-12."""
    graph = random_rings(np.random.default_rng(order), 100, order)
    ring_of, saddle = traction_tangent(graph, LAW), with_open_chord(graph, LAW)
    assert ring_of.trusted.all()
    assert saddle.trusted.all()
    assert relative(ring_of.matrix, saddle.matrix).max() < 1e-12
    # The two conditions bound the difference; rounding cannot be less than one unit.
    bound = np.finfo(float).eps * (ring_of.condition + saddle.condition)
    assert (relative(ring_of.matrix, saddle.matrix) < bound).all()


@pytest.mark.parametrize("overlap", [1e-1, 1e-3, 1e-5, 1e-8, 1e-10])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.6, 1.0])
def test_traction_against_fifty_digits(overlap, share):
    """Elastic to wholly sliding, soft to stiff: the stated condition bounds the error."""
    rng = np.random.default_rng(11)
    graph, regime = slide(rng, random_rings(rng, 4, 5, overlap=overlap), share)
    found = traction_tangent(graph, LAW, regime=regime)
    assert found.trusted.all()
    for b in range(4):
        exact = exact_tangent(member(graph, b), LAW, regime[b])
        error = relative(found.matrix[b], exact)
        assert error < np.finfo(float).eps * found.condition[b]
        if not (regime[b] == Regime.SLIDING).all():
            assert error < 1e-13


def test_traction_moves_grains_in_equilibrium():
    """Forces of the law after a small relaxed step: uniform stress, error of second order."""
    rng = np.random.default_rng(12)
    graph = member(random_rings(rng, 1, 6, overlap=0.1), 0)
    gradient = rng.normal(size=(2, 2))
    matrix = traction_tangent(graph, LAW).matrix
    stress_rate = (matrix @ gradient.ravel()).reshape(2, 2)
    # Grain velocities that balance -P' B, by least squares on the grain-level tangent.
    k = assemble_tangent(graph, LAW)
    load = -(boundary_vectors(graph.x) @ stress_rate.T).ravel()
    v = np.linalg.lstsq(k, load, rcond=1e-12)[0].reshape(6, 2)
    area = nominal_volume(graph)
    np.testing.assert_allclose(-(v.T @ boundary_vectors(graph.x)) / area, gradient, atol=1e-12)
    still = external_forces(graph, 1.3, 0.5, 0.5, [1] * 6, v, np.zeros(6), 0.0)[:12]
    errors = []
    for step in 2.0 ** -np.arange(10, 14):
        moved = external_forces(graph, 1.3, 0.5, 0.5, [1] * 6, v, np.zeros(6), step)[:12]
        errors.append(np.linalg.norm(moved - still - step * load))
    np.testing.assert_allclose(np.diff(np.log2(errors)), -2.0, atol=0.02)


def nominal_volume(graph):
    x = graph.x0
    return 0.5 * np.sum(x[:, 0] * np.roll(x[:, 1], -1) - x[:, 1] * np.roll(x[:, 0], -1))


def test_affine_tangent_is_the_slope_of_the_nominal_stress():
    """Move every centre by -H x0 and take the stress by the exactly integrated law."""
    rng = np.random.default_rng(13)
    graph = member(random_rings(rng, 1, 6, overlap=0.1), 0)
    gradient = rng.normal(size=(2, 2))
    v = -graph.x0 @ gradient.T
    for spins, w in (("blocked", 0.0), ("affine", 0.5 * (gradient[0, 1] - gradient[1, 0]))):
        rate = affine_tangent(graph, LAW, spins=spins).matrix @ gradient.ravel()
        errors = []
        for step in 2.0 ** -np.arange(8, 12):
            # sum f (x) d0 = -sum F (x) x0 with external forces F.
            out = [
                external_forces(graph, 1.3, 0.5, 0.5, [1] * 6, v, np.full(6, w), s)[:12]
                for s in (step, -step)
            ]
            change = (out[0] - out[1]).reshape(6, 2) / (2 * step)
            stress = -(change.T @ graph.x0).ravel() / nominal_volume(graph)
            errors.append(np.linalg.norm(stress - rate))
        np.testing.assert_allclose(np.diff(np.log2(errors)), -2.0, atol=0.02)


@pytest.mark.parametrize("closure", ["affine", "traction"])
def test_batch_equals_one_by_one(closure):
    rng = np.random.default_rng(14)
    graph, regime = slide(rng, random_rings(rng, 6, 5), 0.3)
    law = LinearFrictional(kn=rng.uniform(1, 2, (6, 5)), kt=rng.uniform(0.2, 1, (6, 5)), mu=0.5)
    for spins in ("blocked", "affine", "free"):
        together = macroscopic_tangent(graph, law, closure, spins=spins, regime=regime)
        for b in range(6):
            alone = member(graph, b)
            one = LinearFrictional(kn=law.kn[b], kt=law.kt[b], mu=0.5)
            single = macroscopic_tangent(alone, one, closure, spins=spins, regime=regime[b])
            np.testing.assert_allclose(single.matrix, together.matrix[b], rtol=1e-9, atol=1e-11)


def test_blocked_and_affine_spins_agree_in_the_symmetric_subspace():
    """On the current configuration a symmetric H holds no rotation."""
    graph = random_rings(np.random.default_rng(15), 20, 6)
    blocked = affine_tangent(graph, LAW, spins="blocked").matrix
    affine = affine_tangent(graph, LAW, spins="affine").matrix
    np.testing.assert_allclose(affine @ SYMMETRIC.T, blocked @ SYMMETRIC.T, atol=1e-13)
    assert np.abs(affine - blocked).max() > 0.1


def test_affine_spins_are_objective():
    """A rigid turn of a loop, spins included, only turns its forces: P' = W P."""
    graph = regular_polygon(5, strain=0.2)
    turn = -np.array([[0.0, -1.0], [1.0, 0.0]])
    # Along F' = W F the displacement gradient rate is H' = -W F, F = 0.8 identity.
    h_rate = (0.8 * turn).ravel()
    p = nominal_stress(graph)
    expected = -turn @ p
    rate = affine_tangent(graph, LAW, spins="affine").matrix @ h_rate
    np.testing.assert_allclose(rate.reshape(2, 2), expected, atol=1e-14)
    relaxed = traction_tangent(graph, LAW, spins="affine").matrix @ h_rate
    np.testing.assert_allclose(relaxed.reshape(2, 2), expected, atol=1e-13)


def test_affine_is_never_softer_than_traction():
    """For T = 0 and spins blocked both are symmetric; the affine field is one trial field."""
    rng = np.random.default_rng(16)
    for order in (3, 4, 5, 8):
        graph = random_rings(rng, 30, order, overlap=0.01, mu=0.0)
        difference = affine_tangent(graph, LAW).matrix - traction_tangent(graph, LAW).matrix
        np.testing.assert_allclose(difference, np.swapaxes(difference, -1, -2), atol=1e-12)
        assert np.linalg.eigvalsh(difference).min() > -1e-12


def test_free_spins_relax_the_moments():
    """The spins found leave no moment rate: checked through the assembled tangent."""
    graph = regular_polygon(5, strain=0.1)
    k = assemble_tangent(graph, LAW, spins=True)
    d0 = graph.reference_branches
    matrix = affine_tangent(graph, LAW, spins="free").matrix
    for component in range(4):
        gradient = np.eye(4)[component].reshape(2, 2)
        v = (-graph.x0 @ gradient.T).ravel()
        w = np.linalg.solve(k[10:, 10:], -k[10:, :10] @ v)
        f = k[:10, :10] @ v + k[:10, 10:] @ w
        stress = -(f.reshape(5, 2).T @ graph.x0).ravel() / nominal_volume(graph)
        np.testing.assert_allclose(stress, matrix[:, component], atol=1e-13)
    assert d0.shape == (5, 2)


@pytest.mark.parametrize("order", [4, 6, 12])
def test_gear_mode_is_passed_through(order):
    """Even loops: one null vector more, and the answer stays trusted."""
    graph = regular_polygon(order, strain=0.1)
    free = affine_tangent(graph, LAW, spins="free")
    assert free.trusted
    assert np.isfinite(free.matrix).all()


def test_rolling_mechanisms_keep_the_answer_where_the_stress_is_unique():
    """Unloaded n-gon, free spins: n - 3 mechanisms; its traction tangent is singular but known."""
    for order in (4, 5, 6):
        tangent = traction_tangent(regular_polygon(order), LAW, spins="free")
        assert tangent.trusted
        assert np.linalg.matrix_rank(tangent.matrix, tol=1e-10) < 4


def test_chord_stiffens_the_diamond():
    """Two triangles: the fifth contact, out of the ring, is taken by the saddle system."""
    diamond = regular_polygon(4, strain=0.3)
    braced = diamond.replace(
        contacts=np.vstack([diamond.contacts, [[1, 3]]]),
        normal_force=np.append(diamond.normal_force, 0.01),
        shear_force=np.zeros(5),
    )
    plain, stiff = traction_tangent(diamond, LAW).matrix, traction_tangent(braced, LAW).matrix
    # The chord lies along axis 2 and adds its block there: kn l0^2 / V0 = 1.3 * 2 / 1.
    np.testing.assert_allclose((stiff - plain)[3, 3], 1.3 * 2.0, atol=1e-12)


def test_a_triangle_of_contacts_without_shear_has_an_answer():
    """kt = 0 and N = 0 leave k_c singular."""
    triangle = regular_polygon(3)
    tangent = traction_tangent(triangle, LinearFrictional(kn=1.0, kt=0.0))
    assert tangent.trusted
    # A frictionless triangle is a truss: exactly the affine one.
    exact = affine_tangent(triangle, LinearFrictional(kn=1.0, kt=0.0)).matrix
    np.testing.assert_allclose(tangent.matrix, exact, atol=1e-13)


def test_at_a_pole_no_number_is_given_without_its_condition():
    """A pentagon's traction tangent runs through infinity where the affine one loses a mode."""
    law = LinearFrictional(kn=1.0, kt=0.3)
    pole = 1.3 / 2.3

    def at(strain):
        return traction_tangent(regular_polygon(5, strain=strain), law)

    assert at(pole - 1e-3).trusted
    assert at(pole + 1e-3).trusted
    for strain in (np.nextafter(pole, 0), pole, np.nextafter(pole, 1)):
        assert not at(strain).trusted or at(strain).condition > 1e12


def test_all_open_carries_nothing():
    graph = regular_polygon(4)
    tangent = traction_tangent(graph, LAW, regime=[Regime.OPEN] * 4)
    assert tangent.trusted
    assert np.abs(tangent.matrix).max() < 1e-14


@pytest.mark.parametrize("overlap", [1e-4, 1e-7])
def test_condition_of_the_saddle_system_counts_the_softness_of_the_loop(overlap):
    """Stiff contacts that all slide make a loop as soft as N/l: K's rounding weighs 1/softness."""
    rng = np.random.default_rng(18)
    graph, regime = slide(rng, random_rings(rng, 6, 6, overlap=overlap), 1.0)
    found = with_open_chord(graph, LAW, regime)
    worst = 0.0
    for b in range(6):
        exact = exact_tangent(member(graph, b), LAW, regime[b])
        error = relative(found.matrix[b], exact)
        assert error < np.finfo(float).eps * found.condition[b]
        worst = max(worst, error / np.finfo(float).eps)
    assert worst > 0.1 / overlap  # the loss is real: a plain condition number would not bound it


def test_answers_that_cannot_be_trusted_are_withheld():
    one = np.ones(())
    for residual, ambiguity, trusted in ((0.0, 0.0, True), (1e-6, 0.0, False), (0.0, 0.1, False)):
        tangent = solved(np.eye(4), "traction", "free", one, one, one * residual, one * ambiguity)
        assert tangent.trusted == trusted
        assert np.isnan(tangent.matrix).all() != trusted
        assert ("1 of 1" in str(tangent)) == trusted


def test_affine_spin_of_a_sheared_state():
    """w = (L21 - L12)/2 with L = -H F^-1, F far from symmetric."""
    rng = np.random.default_rng(19)
    reference = random_rings(rng, 1, 6)
    f = np.array([[0.9, 0.4], [-0.1, 1.1]])
    graph = GrainGraph(
        x=reference.x[0] @ f.T,
        x0=reference.x[0],
        radii=reference.radii[0],
        contacts=reference.contacts,
    )
    for component in range(4):
        gradient = np.eye(4)[component].reshape(2, 2)
        velocity_gradient = -gradient @ np.linalg.inv(f)
        expected = 0.5 * (velocity_gradient[1, 0] - velocity_gradient[0, 1])
        assert affine_spin(graph).row[component] == pytest.approx(expected, abs=1e-14)
    cell = np.array([[2.0, 0.1], [0.0, 3.0]])
    periodic = graph.replace(cell=f @ cell, cell0=cell)
    np.testing.assert_allclose(affine_spin(periodic).row, affine_spin(graph).row, atol=1e-14)


def test_a_mirrored_loop_gives_the_mirrored_operator():
    rng = np.random.default_rng(17)
    graph = random_rings(rng, 5, 6)
    mirrored = graph.replace(
        x=graph.x * [1, -1], x0=graph.x0 * [1, -1], shear_force=-graph.shear_force
    )
    mirror = np.diag([1.0, -1.0, -1.0, 1.0])
    for closure in ("affine", "traction"):
        a = macroscopic_tangent(graph, LAW, closure).matrix
        b = macroscopic_tangent(mirrored, LAW, closure).matrix
        np.testing.assert_allclose(b, mirror @ a @ mirror, atol=1e-13)


def test_two_hundred_grains():
    graph = regular_polygon(200, strain=0.1)
    ring_of, saddle = traction_tangent(graph, LAW), with_open_chord(graph, LAW)
    assert ring_of.trusted
    assert saddle.trusted
    assert relative(ring_of.matrix, saddle.matrix) < 1e-10


def test_unknown_choices_are_refused():
    graph = regular_polygon(3)
    with pytest.raises(InputError, match=r"closure.*'uniform'"):
        macroscopic_tangent(graph, LAW, "uniform")
    with pytest.raises(InputError, match=r"spins.*'rolling'"):
        affine_tangent(graph, LAW, spins="rolling")
    flat = GrainGraph(x=[[0, 0], [1, 0], [2, 0]], radii=[1, 1, 1], contacts=ring(3))
    with pytest.raises(InputError, match=r"polygon of the loop: got area 0\.0"):
        traction_tangent(flat, LAW)
    packing = GrainGraph(x=[[0, 0], [1, 0]], radii=[1, 1], contacts=[[0, 1]])
    with pytest.raises(InputError, match="loop of 2 grains"):
        affine_tangent(packing, LAW)
    assert affine_tangent(packing, LAW, volume=2.0).trusted
    assert ring(3).shape == (3, 2)
