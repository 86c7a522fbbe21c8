"""Operators in place against dense inverses, and what blocks and buffers leave out."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.csgraph import maximum_bipartite_matching

from loops import (
    GrainGraph,
    InputError,
    LinearFrictional,
    Regime,
    Scene,
    assemble_tangent,
    boundary_of,
    boundary_vectors,
    contact_state,
    find_faces,
    in_place,
    loop_batches,
    multifrontal,
    polygon_area,
    traction_tangent,
)
from loops.gears import NEARLY, UNKNOWN, spin_modes
from loops.in_place import (
    SWEPT,
    OfOrder,
    Polygons,
    _compliances,
    _inverses,
    _solve_again,
    inverted,
    polygons_of,
)
from loops.multifrontal import _vertex_cover, dissection, frontal_lu, solve_sketches
from patterns import read_snapshot, sample_path, synthetic_network
from tests.loops.packing.scenes import CASES
from tests.oracles import eighty_bits
from tests.packings import (
    LAW,
    frobenius,
    loops_in_place,
    packing,
    packing_system,
    with_idle_triangle,
)
from tests.tools.loops_in_place import SIGNS, campaign


def dense_operators(graph, law, regime):
    """`A_in` from a pseudo-inverse of the dense tangent: the loads are in balance."""
    K = np.linalg.pinv(assemble_tangent(graph, law, spins=True, regime=regime), rcond=1e-10)
    faces = find_faces(graph)
    out = {}
    for batch in loop_batches(graph, faces):
        vectors, area = boundary_vectors(batch.graph.x), polygon_area(batch.graph.x)
        for face, grains, v, size in zip(batch.face, batch.grains, vectors, area, strict=True):
            B = np.zeros((len(K), 4))
            for grain, vector in zip(grains, v, strict=True):
                B[2 * grain, :2] += vector
                B[2 * grain + 1, 2:] += vector
            out[face] = np.linalg.inv(B.T @ K @ B / size)
    return np.array([out[face] for face in faces.loops])


@pytest.mark.parametrize("sliding", [0.0, 0.15])
def test_in_place_is_the_dense_inverse(sliding):
    graph = packing(30, seed=2, sliding=sliding)
    regime = LAW.regime(contact_state(graph))
    found = loops_in_place(Scene(graph, LAW), find_faces(graph))
    dense = dense_operators(graph, LAW, regime)
    # The pseudo-inverse errs by its condition, about 1e3 roundings.
    assert np.allclose(found.matrix, dense, rtol=1e-11, atol=1e-11)
    assert (found.error > 0).all() and (found.error < 1e-9).all()


def test_surroundings_are_what_the_loop_alone_lacks():
    law = LinearFrictional(1.0, 0.5)
    graph = packing(30, seed=2, share=0.0)
    faces = find_faces(graph)
    found = loops_in_place(Scene(graph, law), faces)
    row = {face: k for k, face in enumerate(faces.loops)}
    for batch in loop_batches(graph, faces):
        alone = traction_tangent(batch.graph, law, spins="free")
        rows = [row[face] for face in batch.face]
        gap = np.linalg.norm(found.alone[rows] - alone.matrix, axis=(1, 2))
        assert (gap <= alone.rounding + found.alone_error[rows])[alone.trusted].all()
    assert np.allclose(found.surroundings, found.matrix - found.alone, equal_nan=True)
    # Springs without shear forces: whatever stands around a loop can only stiffen it.
    values = np.linalg.eigvalsh(found.surroundings + np.swapaxes(found.surroundings, 1, 2))
    assert np.nanmin(values) > -1e-6


def test_errors_and_signs_against_ninety_digits():
    """All families of the campaign in `tests.tools.loops_in_place`, small packings."""
    total, ratios, _ = campaign(20, seed=1, largest=12)
    assert total["answered"] > 200 and total["answered"] > 0.9 * total["standing"]
    assert total["beyond"] == 0
    for name in SIGNS:
        assert total[f"{name} wrong"] == 0 and total[f"{name} claimed"] > 0.8 * total["answered"]
    # Bounds by norms and random vectors are wide, but not without a limit.
    assert 1e-4 < max(ratios.values()) < 0.5


@pytest.mark.slow
def test_errors_and_signs_of_ten_thousand_loops():
    total, ratios, _ = campaign(450, seed=0)
    assert total["loops"] > 9_000 and total["beyond"] == 0
    assert all(total[f"{name} wrong"] == 0 for name in SIGNS)
    assert max(ratios.values()) < 0.5


def test_a_hinged_triangle_changes_nothing_else():
    """It rolls on its one contact, which carries nothing: a mechanism, and a singular matrix."""
    graph = packing(30, seed=2, share=0.0).replace(normal_force=None, shear_force=None)
    regime = np.full(graph.contact_count, Regime.ELASTIC)
    alone = loops_in_place(Scene(graph.replace(regime=regime), LAW), find_faces(graph))
    grain = int(np.argmax(np.linalg.norm(graph.x, axis=1)))
    count = graph.grain_count
    more = graph.x[grain] + 0.2 * np.array([[0.3, 0.9], [1.3, 1.0], [0.7, 1.9]])
    hinged = GrainGraph(
        x=np.vstack([graph.x, more]),
        radii=np.append(graph.radii, [0.1] * 3),
        contacts=np.vstack(
            [graph.contacts, [[grain, count], *(count + np.array([[0, 1], [1, 2], [0, 2]]))]]
        ),
        images=np.vstack([graph.images, np.zeros((4, 2), dtype=int)]),
        cell=graph.cell,
    )
    regime = np.full(hinged.contact_count, Regime.ELASTIC)
    system = packing_system(Scene(hinged, LAW), regime=regime)
    assert system.carrying.grains.all()
    found = inverted(system, polygons_of(graph, find_faces(graph)), np.inf, np.inf)
    change = frobenius(found.matrix - alone.matrix) / frobenius(alone.matrix)
    assert (change < 1e-9).all() and (change < found.error).all() and (found.error < 1e-2).all()


@pytest.mark.parametrize("method", ["whole", "blocks"])
@pytest.mark.parametrize("case", ["spins", "sliding", "no shear stiffness"])
def test_no_loop_is_judged_where_every_grain_is_held(method, case):
    """Spins may stay free: without shear springs nothing at all moves."""
    graph = packing(30, seed=2)
    regime = None if case == "spins" else np.full(graph.contact_count, Regime.SLIDING)
    law = LAW
    if case == "no shear stiffness":
        law, regime = LinearFrictional(1.0, 0.0, 0.5), np.full(graph.contact_count, Regime.ELASTIC)
    found = loops_in_place(
        Scene(
            graph.replace(regime=regime),
            law,
            boundary_of(graph, held=np.ones(graph.grain_count, bool)),
        ),
        find_faces(graph),
        method=method,
    )
    assert np.isnan(found.matrix).all() and np.isnan(found.error).all()
    assert np.isfinite(found.alone).any() or case != "spins"


def plain_lu(dense):
    """Factors of a small matrix in one front."""
    count = len(dense)
    fronts = dissection(np.zeros((count, 2)), np.empty((0, 2), dtype=int))
    return frontal_lu(sparse.csr_array(dense), fronts, np.arange(count)[:, None])


def test_a_front_without_an_inverse_gets_one():
    """One freedom that nothing resists: the others answer as without it."""
    dense = np.diag([2.0, 0.0, 4.0])
    b = np.array([[1.0], [0.0], [1.0]])
    found = plain_lu(dense).solve(b)
    assert np.allclose(found, [[0.5], [0.0], [0.25]], rtol=1e-10)


def test_norms_are_estimated_from_random_vectors():
    rng = np.random.default_rng(0)
    dense = 6.0 * np.eye(30) + rng.normal(size=(30, 30))
    dense *= np.logspace(-3, 3, 30)[:, None]
    inverse, sizes = np.linalg.inv(dense), np.abs(dense)
    c = sizes.sum(axis=0)
    d = (sizes / c).sum(axis=1)
    left, right, _ = solve_sketches(sparse.csr_array(dense), plain_lu(dense))
    for sketch, exact in ((left, inverse * d), (right, inverse.T * c)):
        ratio = np.linalg.norm(sketch, axis=1) / np.linalg.norm(exact, axis=1)
        assert 0.4 < ratio.min() and ratio.max() < 1.7


def test_a_mode_softer_than_its_regularisation_leaves_doubt():
    """Factors of `K + 1e-12`, a mode of 1e-15 in K: the compliance errs by nearly 1e15."""
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(6, 6)))[0]
    soft = turn @ np.diag([1.0, 1.0, 1.0, 1.0, 1.0, 1e-15]) @ turn.T
    left, _, residual = solve_sketches(sparse.csr_array(soft), plain_lu(soft + 1e-12 * np.eye(6)))
    load = turn[:, 5]
    assert np.linalg.norm(load @ left) * np.linalg.norm(load @ residual) > 1e15
    # Nothing is amplified where all is stiff.
    stiff = turn @ np.diag([1.0, 1.0, 1.0, 1.0, 1.0, 0.5]) @ turn.T
    residual = solve_sketches(sparse.csr_array(stiff), plain_lu(stiff))[2]
    assert np.linalg.norm(residual) < 1e-13


def test_the_bound_is_that_of_first_order_or_none():
    """Hand-made norms: `|A left| (|A^T residual| + u |A^T right|) + slips`, twice, and rounding."""
    C = np.diag([1.0, 1.0, 1.0, 1e8])[None]
    left, right, residual, *slips = np.zeros((7, 1, 4, 2))
    left[0, 0, 0], right[0, 1, 0], residual[0, 2, 0] = 3.0, 1e4, 1e-9
    A, error = _inverses(C, np.array([7.0]), left, right, residual, *slips)
    size, u = np.sqrt(3.0 + 1e-16), 8 * np.finfo(float).eps
    solves, rounding = 3.0 * (1e-9 + u * 1e4) / size, u * size * (7.0 + 1e8)
    assert error[0] == pytest.approx(2 * (2 * solves + rounding), rel=1e-12)
    assert np.allclose(A[0], np.diag([1.0, 1.0, 1.0, 1e-8]), rtol=1e-14)
    # Slips: columns times amplitudes, amplitudes times rows.
    for k, norm in enumerate((1e-4, 0.5, 3e-5, 2e-4)):
        slips[k][0, k % 3, 1] = norm
    more = (1e-4 * 3e-5 + 0.5 * 2e-4) / size
    A, error = _inverses(C, np.array([7.0]), left, right, residual, *slips)
    assert error[0] == pytest.approx(2 * (2 * (solves + more) + rounding), rel=1e-12)
    # In the soft direction first order is small, the change of C times A is not.
    for soft in (left, slips[0], slips[1]):
        soft[0, :3], soft[0, 3, 0] = 0.0, 1e9
        A, error = _inverses(C, np.array([7.0]), left, right, residual, *slips)
        assert np.isinf(error[0]) and np.isnan(A).all()
        soft[:] = 0.0
    # Neither is known where rounding alone changes C times A by three tenths, for half of it is.
    none = np.zeros((6, 1, 4, 2))
    for share, known in ((0.3, False), (0.2, True)):
        A, error = _inverses(C, np.array([share / (u * size)]) - 1e8, *none, none[0])
        assert np.isfinite(error[0]) == np.isfinite(A).all() == known
    assert error[0] == pytest.approx(0.4, rel=1e-12)


def test_rounding_of_the_sweep_is_foretold():
    """Nearly singular blocks of single fronts, in a matrix that is not: against 80 bits."""
    rng = np.random.default_rng(0)
    graph = synthetic_network(130, seed=3, coordination=4.6)
    fronts = dissection(graph.x, graph.contacts)
    freedom = np.arange(260).reshape(130, 2)
    dense = np.eye(260)
    for i, j in np.concatenate([graph.contacts, graph.contacts[:, ::-1]]):
        dense[np.ix_(freedom[i], freedom[j])] = rng.normal(size=(2, 2))
    soft = [k for k, front in enumerate(fronts) if not front.children]
    for k in soft:
        own = np.ix_(freedom[fronts[k].own].ravel(), freedom[fronts[k].own].ravel())
        u, s, v = np.linalg.svd(dense[own])
        dense[own] = u @ np.diag(np.append(s[:-1], 1e-6)) @ v
    lu = frontal_lu(sparse.csr_array(dense), fronts, freedom)
    above = {child: k for k, front in enumerate(fronts) for child in front.children}
    exact, ratios, errors = {}, [], []

    def compare(k, at, z, variance):
        part, outer = lu.parts[k], np.empty((0, 0), np.longdouble)
        if k in above:
            numbers, inverse = exact[above[k]]
            place = [numbers.tolist().index(freedom) for freedom in part.rest]
            outer = inverse[np.ix_(place, place)]
        left, right = part.left.astype(np.longdouble), part.right.astype(np.longdouble)
        full = np.block(
            [[part.inverse + right @ outer @ left, -right @ outer], [-outer @ left, outer]]
        )
        exact[k] = at, full
        errors.append(np.max(np.abs(z - full)))
        ratios.append((np.abs(z - full) / np.sqrt(variance)).astype(float).ravel())

    lu.on_fronts(compare)
    assert len(soft) > 3 and np.linalg.cond(dense) < 1e5
    # What two sweeps over such a block amplify, 1e12 roundings, is met and foretold.
    assert max(errors) > 1e-8 * np.abs(np.linalg.inv(dense)).max()
    ratios = np.concatenate(ratios)
    assert ratios.max() < SWEPT and np.quantile(ratios, 0.99) > 0.1


def soft_packing():
    """A packing of 2,000 grains, next to no stiffness in shear: pivots of fronts nearly vanish."""
    snapshot = read_snapshot(sample_path("slow/grains_10.parquet"), shear_increment="radii",
                             cell=[[0.914723458490276, 0.0], [0.0, 0.897826511170329]])  # fmt: skip
    kn = float(np.median(snapshot.law.kn))
    return snapshot.graph, LinearFrictional(kn, 1e-7 * kn, 0.5, "radii")


@pytest.mark.parametrize("many", [5.0, 1000.0])
def test_solving_again_changes_rounding_alone(monkeypatch, many):
    """All loops, or the five whose sweep errs most."""
    graph, law, _ = CASES["several fronts"]
    faces = find_faces(graph)
    expected = loops_in_place(Scene(graph, law), faces, threads=1)
    swept, met = in_place._swept_error, []

    def spy(*given):
        met.append(1e14 * swept(*given))
        return met[-1]

    monkeypatch.setattr(in_place, "_swept_error", spy)
    monkeypatch.setattr(in_place, "AGAIN", many * 4 * expected.system.size)
    found = loops_in_place(Scene(graph, law), faces, threads=1)
    change = frobenius(found.matrix - expected.matrix) / frobenius(expected.matrix)
    again = change > 0
    assert (change < 0.1 * expected.error).all()
    if many == 5.0:
        assert set(np.flatnonzero(again)) == set(np.argsort(-met[0])[:5])
    assert again.sum() == 5 or (many > 5.0 and again.sum() > 0.9 * len(again))
    assert (found.error[again] < expected.error[again]).all()
    assert (found.error[~again] > 1e10 * expected.error[~again]).all()


def test_rounding_of_the_sweep_knows_no_units(monkeypatch):
    graph, law, _ = CASES["several fronts"]
    swept, met = in_place._swept_error, []

    def spy(*given):
        met.append(swept(*given))
        return met[-1]

    monkeypatch.setattr(in_place, "_swept_error", spy)
    for unit in (1.0, 2.0**20):
        scaled = graph.replace(
            x=unit * graph.x, radii=unit * graph.radii, cell=unit * graph.cell,
            normal_force=unit * graph.normal_force, shear_force=unit * graph.shear_force,
        )  # fmt: skip
        loops_in_place(Scene(scaled, law), find_faces(scaled), threads=1)
    np.testing.assert_allclose(met[1], met[0], rtol=1e-9)


def test_solves_are_refined_once():
    """Factors that are off by a thousandth leave a millionth."""
    rng = np.random.default_rng(2)
    dense = 6.0 * np.eye(8) + rng.normal(size=(8, 8))
    lu = plain_lu(dense * (1.0 + 1e-3 * rng.uniform(-1, 1, (8, 8))))
    freedom = np.full((3, 5), -1)
    freedom[:, :2] = [[0, 5], [2, 7], [6, 1]]
    v, area = rng.normal(size=(1, 3, 2)), np.array([0.4])
    loop = Polygons([OfOrder(np.arange(3)[None], v, area, np.array([0]))], np.zeros((1, 2)))
    found = np.zeros((1, 4, 4))
    regular = SimpleNamespace(matrix=sparse.csr_array(dense), freedom=freedom)
    _solve_again(found, np.array([True]), regular, lu, loop)
    place = freedom[:, :2].ravel()
    exact, _ = _compliances(np.linalg.inv(dense)[place[:, None], place][None], v, area)
    change = np.abs(found - exact).max() / np.abs(exact).max()
    assert 1e-9 < change < 1e-5
    none = np.zeros((1, 4, 4))
    _solve_again(none, np.array([False]), regular, lu, loop)
    assert not none.any()


@pytest.mark.slow
def test_loops_that_the_sweep_spoils_are_solved_again(monkeypatch):
    graph, law = soft_packing()
    faces, regime = find_faces(graph), np.full(graph.contact_count, Regime.ELASTIC, np.int8)
    met = []

    def spy(operators, variance):
        met.append(swept(operators, variance))
        return met[-1]

    swept = in_place._swept_error
    monkeypatch.setattr(in_place, "_swept_error", spy)
    found = loops_in_place(Scene(graph.replace(regime=regime), law), faces)
    worst = np.argsort(-met[0])[:12]
    modes = spin_modes(found.system.stiffness, found.system.ends, found.system.size)
    exact = eighty_bits.operators(found.system, faces, modes, some=set(worst.tolist()))[worst]

    def errors(found):
        change = frobenius((found.matrix[worst] - exact).astype(float))
        return change / frobenius(found.matrix[worst]), found.error[worst]

    error, stated = errors(found)
    assert (met[0][worst] > 10 * stated).all() and (error < 1e-3 * stated).all()
    # Where they would be too many, what the sweep makes is stated.
    monkeypatch.setattr(in_place, "AGAIN", 4 * found.system.size * 4.0)
    few, few_stated = errors(loops_in_place(Scene(graph.replace(regime=regime), law), faces))
    # Solved in other batches: the same to rounding.
    assert (few[:4] < 1e-3 * stated[:4]).all()
    np.testing.assert_allclose(few_stated[:4], stated[:4], rtol=1e-6)
    assert (few < few_stated).all() and (few[4:] > 10 * error[4:]).all()
    np.testing.assert_allclose(few_stated[4:], stated[4:] + met[0][worst[4:]], rtol=0.05)


def test_compliance_is_the_mean_strain_of_unit_stresses():
    """`C_abcd = (1/V) sum v_i,b Z_ia,jc v_j,d`, grain by grain, and the size of its terms."""
    rng = np.random.default_rng(0)
    z, v, area = rng.normal(size=(9, 9)), rng.normal(size=(1, 3, 2)), np.array([0.4])
    place = np.array([[[0, 5], [2, 7], [8, 1]]])
    C, terms = _compliances(z[place.reshape(1, 6, 1), place.reshape(1, 1, 6)], v, area)
    expected, largest = np.zeros((2, 2, 2, 2)), 0.0
    for i in range(3):
        for j in range(3):
            part = z[np.ix_(place[0, i], place[0, j])]
            expected += np.einsum("ac,b,d->abcd", part, v[0, i], v[0, j]) / 0.4
            largest = max(largest, np.abs(part).max())
    assert C[0] == pytest.approx(expected.reshape(4, 4), rel=1e-13)
    assert terms[0] == pytest.approx(
        largest * np.linalg.norm(v[0], axis=1).sum() ** 2 / 0.4, rel=1e-13
    )


def gear_train(pairs, count, unit=1.0, radii=None):
    """Modes of spins that roll on each other, radii of 1, 2, 3 and so on if not given."""
    blocks, ends = np.zeros((len(pairs), 4, 4)), np.full((len(pairs), 6), -1)
    radii = 1.0 + np.arange(count) if radii is None else radii
    for k, pair in enumerate(pairs):
        blocks[k, 2:, 2:] = unit * np.outer(radii[pair], radii[pair])
    ends[:, 4:] = pairs
    return spin_modes(blocks, ends, count)


@pytest.mark.parametrize("unit", [1.0, 2.0**60, 2.0**-60])
def test_grains_around_one_are_one_gear_in_any_units(unit):
    # The one in the middle has the lowest number, the highest, one between.
    for pairs in ([[0, 1], [0, 2], [3, 0]], [[3, 0], [1, 3], [2, 3]], [[1, 0], [1, 2], [3, 1]]):
        mode, motion, mismatch = gear_train(pairs, 5, unit)
        assert mode.tolist() == [0, 0, 0, 0, -1]
        assert mismatch.tolist() == [0.0]
        for a, b in pairs:
            assert (1 + a) * motion[a] == pytest.approx(-(1 + b) * motion[b], abs=1e-15)


def test_the_spin_of_the_smallest_gear_is_one():
    """Spins of a train are as the inverse radii, with alternating signs; two trains."""
    radii = np.array([4.0, 2.0, 1.0, 5.0, 0.5])
    mode, motion, _ = gear_train([[0, 1], [1, 2], [3, 4]], 5, radii=radii)
    assert mode.tolist() == [0, 0, 0, 1, 1]
    wanted = np.array([1 / 4, -1 / 2, 1.0, 1 / 10, -1.0])
    np.testing.assert_allclose(motion * np.sign(motion[[0, 0, 0, 3, 3]]), wanted, rtol=1e-14)


@pytest.mark.parametrize("large", [0, 4])
def test_rounding_locks_no_ring_of_small_gears(large):
    """One gear that is a million times larger turns a ring of four, whose spins are as large."""
    radii = np.array([0.7, 1.1, 0.3, 1.3, 0.9])
    radii[large] *= 1e6
    ring = [k for k in range(5) if k != large]
    pairs = [[large, ring[0]], *([ring[k], ring[(k + 1) % 4]] for k in range(4))]
    mode, motion, mismatch = gear_train(pairs, 5, radii=radii)
    assert mode.tolist() == [0] * 5 and mismatch[0] < UNKNOWN
    wanted = np.ones(5) / radii
    wanted[[large, ring[1], ring[3]]] *= -1.0
    np.testing.assert_allclose(motion / motion[ring[0]], wanted / wanted[ring[0]], rtol=1e-12)


def test_gears_and_free_spins_are_found():
    """Two grains that roll on each other alone, a ring of four, a ring of three that locks."""
    pairs = [[0, 1], [2, 3], [3, 4], [4, 5], [5, 2], [6, 7], [7, 8], [8, 6]]
    ratio = {(a, b): (1.0 + a, 1.0 + b) for a, b in pairs}
    blocks = np.zeros((len(pairs) + 1, 4, 4))
    for k, pair in enumerate(pairs):
        blocks[k, 2:, 2:] = np.outer(ratio[tuple(pair)], ratio[tuple(pair)])
    ends = np.full((len(pairs) + 1, 6), -1)
    ends[:-1, 4:] = pairs
    ends[-1, 4:] = 9, 0  # slides: it couples nothing
    mode, motion, mismatch = spin_modes(blocks, ends, 12)
    assert mode.tolist() == [0, 0, 1, 1, 1, 1, -1, -1, -1, 2, -1, -1]
    for a, b in pairs[:5]:
        assert (1 + a) * motion[a] + (1 + b) * motion[b] == pytest.approx(0, abs=1e-15)
    assert np.abs(motion).max() == 1.0 and (motion[6:9] == 0).all()
    # Only the ring of four may miss: by a billionth; by a hundredth it locks.
    assert mismatch[[0, 2]].tolist() == [0.0, 0.0] and mismatch[1] < UNKNOWN
    for miss, closes in ((1e-9, True), (0.99 * NEARLY, True), (1.01 * NEARLY, False)):
        off = blocks.copy()
        off[1, 2:, 2] *= 1.0 + miss
        found, _, missed = spin_modes(off, ends, 12)
        assert (found[2:6] >= 0).all() == closes
        assert not closes or missed[1] == pytest.approx(miss, rel=2e-3)
    ends[0, 5] = -1  # against a wall nothing turns
    assert spin_modes(blocks, ends, 12)[0].tolist() == [-1, -1, 0, 0, 0, 0, -1, -1, -1, 1, -1, -1]


def test_a_separator_is_as_small_as_a_matching_is_large():
    rng = np.random.default_rng(3)
    for _ in range(50):
        edges = np.unique(rng.integers([0, 7], [7, 14], (12, 2)), axis=0)
        cover = _vertex_cover(edges)
        assert np.isin(edges, cover).any(axis=1).all()
        graph = sparse.csr_array((np.ones(len(edges)), edges.T), (14, 14))
        matched = maximum_bipartite_matching(graph, perm_type="column") >= 0
        assert len(cover) == np.count_nonzero(matched)


def test_threads_change_no_bit():
    graph = synthetic_network(400, seed=3, periodic=True, coordination=4.6)
    faces = find_faces(graph)
    one, three = (loops_in_place(Scene(graph, LAW), faces, threads=n) for n in (1, 3))
    assert np.array_equal(one.matrix, three.matrix) and np.array_equal(one.error, three.error)


@pytest.mark.parametrize("share", [1.0, 0.3, 0.0])
def test_tasks_change_no_bit(monkeypatch, share):
    """One task for all fronts, a few, one for each."""
    graph, law, _ = CASES["several fronts"]
    faces = find_faces(graph)
    expected = loops_in_place(Scene(graph, law), faces, threads=1)
    monkeypatch.setattr(multifrontal, "TASK", share)
    found = loops_in_place(Scene(graph, law), faces, threads=1)
    assert np.array_equal(found.matrix, expected.matrix)
    assert np.array_equal(found.error, expected.error)


def test_larger_packings_are_cut_into_blocks(monkeypatch):
    graph = synthetic_network(400, seed=3, periodic=True, coordination=4.6)
    faces, how = find_faces(graph), {"block": 8.0, "buffer": 3.0}
    whole, blocks = (
        loops_in_place(Scene(graph, LAW), faces, method=m, **how) for m in ("whole", "blocks")
    )
    assert not np.array_equal(whole.matrix, blocks.matrix)
    for most, same in ((400, whole), (399, blocks)):
        monkeypatch.setattr(in_place, "WHOLE", most)
        assert np.array_equal(loops_in_place(Scene(graph, LAW), faces, **how).matrix, same.matrix)


def test_a_loop_beyond_its_buffer_has_no_error():
    """Grains of a loop that reaches further than the buffer move with it; all around is held."""
    graph = synthetic_network(400, seed=5, periodic=True, coordination=3.4)
    faces = find_faces(graph)
    order = faces.order[faces.loops]
    near, far = (
        loops_in_place(Scene(graph, LAW), faces, method="blocks", block=5.0, buffer=buffer)
        for buffer in (1.0, 6.0)
    )
    # Near by, held grains may change smaller loops by their whole operator, too.
    assert np.isinf(near.error[order > 8]).all() and (order > 8).any()
    assert np.isfinite(near.matrix).all() and np.isfinite(far.error).all()


def test_a_loop_that_carries_nothing_has_no_operator():
    more = with_idle_triangle(packing(24, seed=3))
    found = loops_in_place(Scene(more, LAW), find_faces(more))
    assert np.isnan(found.matrix).all(axis=(1, 2)).sum() == 1
    with pytest.raises(InputError, match="method"):
        loops_in_place(Scene(more, LAW), find_faces(more), method="patch")


def test_selected_inverse_of_any_matrix_on_any_tree():
    rng = np.random.default_rng(0)
    x = rng.random((150, 2))
    near = np.argsort(np.linalg.norm(x[:, None] - x, axis=2), axis=1)[:, 1:5]
    edges = np.unique(
        np.sort(np.column_stack([np.repeat(np.arange(150), 4), near.ravel()]), axis=1), axis=0
    )
    freedom = np.arange(450).reshape(150, 3)
    freedom[rng.random((150, 3)) < 0.1] = -1
    freedom[freedom >= 0] = np.arange(np.count_nonzero(freedom >= 0))
    size = freedom.max() + 1
    dense = np.zeros((size, size))
    for i, j in np.vstack([edges, np.column_stack([np.arange(150)] * 2)]):
        a, b = freedom[i][freedom[i] >= 0], freedom[j][freedom[j] >= 0]
        dense[np.ix_(a, b)] += rng.normal(size=(len(a), len(b)))
        dense[np.ix_(b, a)] += rng.normal(size=(len(b), len(a)))
    dense += 8.0 * np.eye(size)
    fronts = dissection(x, edges)
    assert np.array_equal(np.sort(np.concatenate([front.own for front in fronts])), np.arange(150))
    lu = frontal_lu(sparse.csr_array(dense), fronts, freedom)
    inverse, met = np.linalg.inv(dense), []

    def compare(k, at, z, variance):
        assert variance.shape == z.shape
        assert np.allclose(z, inverse[np.ix_(at, at)], atol=1e-12)
        met.append(k)

    lu.on_fronts(compare)
    assert sorted(met) == list(range(len(fronts))) and len(fronts) > 5
    b = rng.normal(size=(size, 3))
    assert np.allclose(dense @ lu.solve(b), b, atol=1e-11)
    assert np.allclose(dense.T @ lu.solve(b, transposed=True), b, atol=1e-11)
