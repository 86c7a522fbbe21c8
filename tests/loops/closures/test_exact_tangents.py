"""Tangents of loops: gear modes, null spaces, regimes and bad arguments."""

import numpy as np
import pytest

from loops import (
    InputError,
    LinearFrictional,
    Regime,
    affine_tangent,
    assemble_tangent,
    find_faces,
    loop_batches,
    loop_strain,
    macroscopic_tangent,
    polygon_area,
    traction_tangent,
)
from loops.arrays import ROUNDING
from loops.closures.null_space import solve_through_null_space
from loops.closures.spins import _spin_error, affine_spin, spin_of_gradient
from loops.closures.system import boundary_matrix
from patterns import (
    loop_of_snapshot,
    polydisperse_polygon,
    random_loop,
    read_snapshot,
    sample_path,
)
from stability import judge
from tests.oracles.rings import member, random_rings, ring

LAW = LinearFrictional(kn=1.3, kt=0.5, mu=0.5)
RADII = LinearFrictional(kn=1.3, kt=0.5, mu=0.5, shear_increment="radii")


def test_what_a_dropped_direction_might_have_added_is_in_the_error():
    """A direction of 1e-14, loaded with 1e-8 and seen with 1e-8, changes the answer by 1e-2."""
    weak = 1e-14
    matrix = np.diag([1.0, 0.5, weak])
    rhs = np.array([[1.0], [1.0], [1e-8]])
    seen = np.array([[1.0, 0.0, 1e-8]])
    found = solve_through_null_space(matrix, rhs, seen, size=np.abs(matrix))
    assert found.residual < 1e-8
    exact = rhs[0, 0] + 1e-8 * 1e-8 / weak
    assert abs(float((seen @ found.x)[0, 0]) - exact) > 1e-3
    assert found.error[0, 0] > abs(float((seen @ found.x)[0, 0]) - exact)
    # A null vector that carries no load is harmless.
    rhs[2] = 0.0
    assert solve_through_null_space(matrix, rhs, seen, size=np.abs(matrix)).error[0, 0] < 1e-14


def test_the_spin_of_a_loop_is_that_of_its_boundary():
    """Not of a least-squares fit: loops that moved otherwise than affinely."""
    rng = np.random.default_rng(2)
    graph = random_rings(rng, 6, 6)
    graph = graph.replace(x=graph.x + 0.05 * rng.standard_normal(graph.x.shape))
    gradient = np.eye(2) - loop_strain(graph.x0, graph.x)
    np.testing.assert_allclose(affine_spin(graph).row, spin_of_gradient(gradient), atol=1e-15)
    f = gradient[0]
    rigid = affine_spin(graph).row[0] @ (-np.array([[0.0, -1.0], [1.0, 0.0]]) @ f).ravel()
    assert rigid == pytest.approx(1.0, abs=1e-14)


@pytest.mark.parametrize("order", [4, 6, 8])
def test_gear_modes_are_the_limit_of_a_vanishing_resistance(order):
    """`[K + eps, B; B^T, 0]` with eps = 1e-7 kn on the spins times r^2."""
    graph = random_rings(np.random.default_rng(order), 5, order, overlap=1e-2)
    found = traction_tangent(graph, RADII, spins="free")
    assert found.trusted.all()
    eps = 1e-7 * 1.3
    k = assemble_tangent(graph, RADII, spins=True)
    grains = np.arange(2 * order, 3 * order)
    k[:, grains, grains] += eps * graph.radii**2
    system = np.zeros((5, 3 * order + 4, 3 * order + 4))
    system[:, :-4, :-4], boundary = k, boundary_matrix(graph.x0)
    system[:, : 2 * order, -4:] = boundary
    system[:, -4:, : 2 * order] = np.swapaxes(boundary, -1, -2)
    area = polygon_area(graph.x0)
    rhs = np.zeros((5, 3 * order + 4, 4))
    rhs[:, -4:] = -area[:, None, None] * np.eye(4)
    limit = np.linalg.lstsq  # translations are left to the pseudo-inverse
    for b in range(5):
        stress = limit(system[b], rhs[b], rcond=1e-13)[0][-4:]
        size = np.linalg.norm(found.matrix[b])
        # Of the first order in eps over the softness of the loops, about N/l.
        assert np.linalg.norm(stress - found.matrix[b]) < 1e-3 * size


@pytest.mark.parametrize("order", [4, 6, 8])
@pytest.mark.parametrize("overlap", [1e-2, 1e-4, 1e-6])
def test_rings_of_alternating_grains_have_an_answer_by_either_arms(order, overlap):
    """By symmetry nothing turns the gear mode, so that holding it by a spring changes nothing."""
    graph = polydisperse_polygon(np.tile([1.0, 0.8], order // 2), strain=overlap)
    for law in (
        LinearFrictional(1.0, 0.5, 0.5, "branch"),
        LinearFrictional(1.0, 0.5, 0.5, "radii"),
    ):
        found = traction_tangent(graph, law, spins="free")
        assert found.trusted
        assert found.sensitivity < 1e-12
        k, boundary = assemble_tangent(graph, law, spins=True), boundary_matrix(graph.x0)
        rolling = k[2 * order, 2 * order :]
        ratio = rolling[0] / (rolling[1] + rolling[-1])
        gear = np.append(np.zeros(2 * order), np.tile([1.0, -ratio], order // 2))
        assert np.abs(k @ gear).max() < 1e-14
        k += np.outer(gear, gear)
        system = np.zeros((3 * order + 4, 3 * order + 4))
        system[:-4, :-4], system[: 2 * order, -4:] = k, boundary
        system[-4:, : 2 * order] = boundary.T
        rhs = np.zeros((3 * order + 4, 4))
        rhs[-4:] = -polygon_area(graph.x0) * np.eye(4)
        held = np.linalg.lstsq(system, rhs, rcond=1e-13)[0][-4:]
        np.testing.assert_allclose(found.matrix, held, atol=1e-11 * np.abs(held).max())


def test_loops_of_four_whose_arms_decide_have_no_verdict():
    """Overlaps of a thousandth: both ways of sharing the arms answer, and disagree."""
    graph = random_rings(np.random.default_rng(3), 40, 4, overlap=1e-3)
    for law in (LAW, RADII):
        found = traction_tangent(graph, law, spins="free")
        assert found.trusted.all()
        for k in np.flatnonzero(found.sensitivity > 0.1):
            one = traction_tangent(member(graph, k), law, spins="free")
            assert judge(one, "symmetric").status == "undetermined"
        assert (found.sensitivity > 0.1).mean() > 0.9
        assert (found.rounding < 1e-2 * found.sensitivity).mean() > 0.9
    # Odd loops have no gear mode, equal grains on a regular loop share their arms either way.
    odd = random_rings(np.random.default_rng(4), 10, 5, overlap=1e-3)
    assert (traction_tangent(odd, LAW, spins="free").sensitivity == 0).all()


@pytest.fixture(scope="module")
def sample():
    return read_snapshot(sample_path())


def test_every_loop_of_a_snapshot_is_answered(sample):
    """Free spins, shear by the radii, flagged sliders: gear modes in every even loop."""
    law, _ = sample.mechanics()
    law = LinearFrictional(law.kn, law.kt, law.mu, "radii")
    for batch in loop_batches(sample.graph, find_faces(sample.graph)):
        for closure in ("affine", "traction"):
            own = law.take(batch.contacts)
            assert macroscopic_tangent(batch.graph, own, closure, spins="free").trusted.all()


def test_the_natural_call_answers_as_the_table(sample):
    """Loops cut out one by one carry the regimes that the snapshot flags."""
    from studies.snapshot.table import loop_columns

    faces = find_faces(sample.graph)
    table = loop_columns(sample)
    kn, told = float(np.mean(sample.mechanics()[0].kn)), 0
    for loop in range(len(faces.loops)):
        cut = loop_of_snapshot(sample, loop)
        for closure in ("affine", "traction"):
            own = judge(macroscopic_tangent(cut.graph, cut.law, closure), "symmetric")
            stored = table[f"{closure}_lambda_min"][loop] * kn
            assert own.symmetric_eigenvalues[0] == pytest.approx(stored, rel=1e-9)
        # The state alone does not tell every slider: vibration has unloaded some a little.
        bare = cut.graph.replace(normal_force=cut.graph.normal_force)
        told += int((bare.regime is None) & bool((cut.regime == Regime.SLIDING).any()))
    assert told > 50


def test_regimes_travel_and_are_dropped_with_their_forces():
    graph = random_rings(np.random.default_rng(5), 3, 5)
    regime = np.tile([2, 1, 1, 1, 1], (3, 1))
    flagged = graph.replace(regime=regime)
    assert (flagged.replace(x=graph.x, x0=graph.x).regime == regime).all()
    assert flagged.replace(shear_force=graph.shear_force).regime is None
    for closure in ("affine", "traction"):
        natural = macroscopic_tangent(flagged, LAW, closure).matrix
        named = macroscopic_tangent(graph, LAW, closure, regime=regime).matrix
        np.testing.assert_array_equal(natural, named)
        # An argument overrides what the graph carries.
        elastic = macroscopic_tangent(flagged, LAW, closure, regime=np.ones((3, 5))).matrix
        np.testing.assert_array_equal(elastic, macroscopic_tangent(graph, LAW, closure).matrix)


@pytest.mark.parametrize("volume", [0.0, -1.0, np.nan, np.inf])
@pytest.mark.parametrize("tangent", [affine_tangent, traction_tangent])
def test_volumes_are_positive(tangent, volume):
    with pytest.raises(InputError, match=r"volume: got .*a (positive|finite) number"):
        tangent(random_rings(np.random.default_rng(6), 1, 4), LAW, volume=volume)


def test_regimes_are_regimes():
    graph = random_rings(np.random.default_rng(6), 1, 4)
    with pytest.raises(InputError, match="regime of contact 1: got 3"):
        affine_tangent(graph, LAW, regime=[1, 3, 1, 1])
    with pytest.raises(InputError, match=r"regime of contact 0: got nan"):
        graph.replace(regime=[np.nan, 1, 1, 1])
    with pytest.raises(InputError, match=r"regime: got shape \(3,\)"):
        traction_tangent(graph, LAW, regime=[1, 1, 1])


@pytest.mark.parametrize("tangent", [affine_tangent, traction_tangent, assemble_tangent])
def test_laws_fit_the_graph(tangent):
    graph = random_rings(np.random.default_rng(6), 1, 4)
    for law in (LinearFrictional(np.ones(3), 0.5, 0.5), LinearFrictional(1.0, np.ones(3), 0.5)):
        with pytest.raises(InputError, match=r"k[nt] of the contact law: got 3 values"):
            tangent(graph, law)
    assert ring(3).shape == (3, 2)


def test_errors_do_not_depend_on_units():
    """Stated errors over the size of the operator, lengths and stiffnesses in other units."""
    rng = np.random.default_rng(3)
    loop = random_loop(6, 2, strain=0.05, mu=0.3)
    for spins in ("blocked", "affine", "free"):
        found = []
        for length, kn in ((1.0, 1.0), (1e4, 1e-3), (1e-4, 1e6)):
            graph = loop.replace(
                x=length * loop.x, x0=length * loop.x0, radii=length * loop.radii,
                normal_force=kn * length * loop.normal_force,
                shear_force=kn * length * loop.shear_force,
            )  # fmt: skip
            law = LinearFrictional(kn, 0.5 * kn, 0.5)
            tangent = traction_tangent(graph, law, spins=spins)
            found.append(tangent.error / np.linalg.norm(tangent.matrix))
        # The residual, rounding itself, is a part of them.
        np.testing.assert_allclose(found, found[0], rtol=0.05)
    matrix, rhs = np.diag([2.0, 1.0, 0.0]), rng.normal(size=(3, 1))
    errors = [
        unit * solve_through_null_space(
            unit * matrix, rhs, np.eye(3), size=unit * np.abs(matrix)
        ).error
        for unit in (1.0, 1e6)
    ]  # fmt: skip
    np.testing.assert_allclose(*errors, rtol=1e-9)


def test_the_spin_of_an_exact_gradient_errs_by_its_determinant():
    """F = 2 I, known exactly: half a rounding in all, `|F^-1| e |F| |F^-1|` over two."""
    error = _spin_error(2.0 * np.eye(2), np.zeros((2, 2)))
    np.testing.assert_allclose(error, 0.25 * ROUNDING * np.array([0.0, 1.0, 1.0, 0.0]), rtol=1e-15)
