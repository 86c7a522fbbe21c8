"""Increments of tracked loops against exact motions, and the rows of a series."""

import numpy as np
import pytest

from loops import (
    Fate,
    GrainGraph,
    LinearFrictional,
    Regime,
    assemble_tangent,
    boundary_vectors,
    branch_vectors,
    contact_forces,
    contact_state,
    loop_strain,
    love_weber_stress,
    macroscopic_tangent,
    traction_tangent,
)
from patterns import Snapshot, loop_of_snapshot, random_loop, synthetic_network
from studies.series.evolution import (
    PREDICTIONS,
    evolution_row,
    interval_row,
    loop_increments,
    sample_strain,
    track_loops,
)
from studies.series.run import evolution_table

LAW = LinearFrictional(kn=1.0, kt=0.4, mu=0.5)
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(12)


def state(graph, ids=None, *, law=LAW, regime=None):
    """A tracked state with the law's parameters by contact, as readers give them."""
    count = graph.contact_count
    if law is not None:
        kn, kt, mu = (np.full(count, float(value)) for value in (law.kn, law.kt, law.mu))
        law = LinearFrictional(kn, kt, mu)
        regime = law.regime(contact_state(graph)) if regime is None else regime
    snapshot = Snapshot(
        graph=graph,
        law=law,
        regime=regime,
        ids=np.arange(graph.grain_count) if ids is None else ids,
        wall_contacts=0,
        notes=(),
    )
    return snapshot


def moved(before, u, cell=None):
    """The graph after a displacement, forces by the law: spins blocked, sliding goes on.

    Along straight paths of the centres `T' = -kt t . d'` is integrated by Gauss's rule.
    """
    graph, regime = before.graph, before.regime
    after = graph.replace(x=graph.x + u, x0=graph.x + u, cell=cell, cell0=cell)
    d0, d1 = branch_vectors(graph), branch_vectors(after)
    l0, l1 = np.hypot(*d0.T), np.hypot(*d1.T)
    turned = 0.0
    for point, weight in zip(POINTS, WEIGHTS, strict=True):
        d = d0 + 0.5 * (1 + point) * (d1 - d0)
        t = np.column_stack([-d[:, 1], d[:, 0]]) / np.hypot(*d.T)[:, None]
        turned = turned + 0.5 * weight * np.sum(t * (d1 - d0), axis=1)
    normal = graph.normal_force + LAW.kn * (l0 - l1)
    slides = regime == Regime.SLIDING
    shear = graph.shear_force - LAW.kt * turned
    shear = np.where(slides, np.sign(graph.shear_force) * LAW.mu * normal, shear)
    return after.replace(normal_force=normal, shear_force=shear)


def affinely(before, H):
    graph = before.graph
    cell = None if graph.cell is None else graph.cell - H @ graph.cell
    return moved(before, -graph.x @ H.T, cell)


def table_between(before, after_graph, ids=None):
    after = state(after_graph, ids, regime=before.regime)
    return loop_increments(before, after, track_loops(before, after))


def strain_of(table):
    return np.stack([table[f"H{ij}"] for ij in ("11", "12", "21", "22")], -1).reshape(-1, 2, 2)


def slope(errors):
    return np.log2(np.asarray(errors)[:-1] / np.asarray(errors)[1:])


@pytest.fixture(scope="module")
def packing():
    return state(synthetic_network(150, seed=11, periodic=True))


STRAINS = [
    np.array([[1.0, 0.0], [0.0, 0.3]]),
    np.array([[-0.6, 0.0], [0.0, 1.0]]),
    np.array([[0.2, 0.7], [0.7, -0.5]]),
]


@pytest.mark.parametrize("H", STRAINS)
def test_actual_work_tends_to_the_affine_prediction(packing, H):
    """First order in the increment, in elastic and sliding loops alike."""
    assert np.count_nonzero(packing.regime == Regime.SLIDING) > 20
    errors = []
    for h in (4e-4, 2e-4, 1e-4, 5e-5):
        table = table_between(packing, affinely(packing, h * H))
        assert len(table["order"]) == len(packing.faces.loops)
        np.testing.assert_allclose(strain_of(table) - h * H, 0, atol=1e-14)
        np.testing.assert_allclose(table["rotation"], 0, atol=1e-12)
        errors.append(np.linalg.norm(table["W2"] - table["affine_W2"]) / h**2)
        # Without rotation Hill's work is the same.
        np.testing.assert_allclose(table["hill_work"], table["W2"], rtol=1e-8, atol=1e-14 * h)
    assert np.abs(slope(errors) - 1).max() < 0.01
    assert errors[-1] < 1e-3 * np.linalg.norm(table["affine_W2"]) / h**2
    triangles = table["order"] == 3
    np.testing.assert_allclose(
        table["traction_W2"][triangles], table["affine_W2"][triangles], rtol=1e-9
    )


def test_actual_work_tends_to_the_traction_prediction():
    """A hexagon that relaxes under uniform nominal stress: `K u = -dP B`, forces by the law."""
    loop = random_loop(6, 3)
    before = state(loop.replace(normal_force=0.02 * np.arange(1, 7), shear_force=[0.002] * 6))
    graph = before.graph
    e = np.array([[1.0, 0.4], [0.4, -0.2]])
    A = traction_tangent(graph, LAW).matrix
    dP = (A @ e.ravel()).reshape(2, 2)
    load = -boundary_vectors(graph.x) @ dP.T
    u = np.linalg.lstsq(assemble_tangent(graph, LAW), load.ravel(), rcond=None)[0].reshape(6, 2)
    np.testing.assert_allclose(loop_strain(graph.x, graph.x + u), e, atol=1e-12)
    errors = []
    for h in (4e-4, 2e-4, 1e-4, 5e-5):
        table = table_between(before, moved(before, h * u))
        errors.append(abs(table["W2"][0] - table["traction_W2"][0]) / h**2)
        errors[-1] += abs(table["dP12"][0] - 0.5 * h * dP[0, 1]) / h
    assert np.abs(slope(errors) - 1).max() < 0.02
    assert abs(table["traction_W2"][0] / h**2 - 0.5 * np.sum(dP * e)) < 1e-12
    assert abs(table["affine_W2"][0] / table["traction_W2"][0] - 1) > 0.01


def test_predictions_are_those_of_the_single_loop(packing):
    """In the regimes that the file flags, whatever the forces say."""
    rng = np.random.default_rng(0)
    regime = packing.regime.copy()
    regime[rng.random(len(regime)) < 0.3] = Regime.SLIDING
    before = state(packing.graph, regime=regime)
    H = STRAINS[2] * 1e-3
    table = table_between(before, affinely(before, H))
    for row in rng.choice(len(table["order"]), 12, replace=False):
        loop = loop_of_snapshot(before, table["loop_before"][row])
        assert table["sliding_contacts"][row] == np.count_nonzero(loop.regime == Regime.SLIDING)
        for name, (closure, spins) in PREDICTIONS.items():
            A = macroscopic_tangent(
                loop.graph, loop.law, closure, spins=spins, regime=loop.regime
            ).matrix
            expected = 0.5 * H.ravel() @ A @ H.ravel()
            np.testing.assert_allclose(table[name][row], expected, rtol=1e-9)


def turn(graph, angle):
    R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    cell = None if graph.cell is None else R @ graph.cell
    x = graph.x @ R.T
    return graph.replace(x=x, x0=x, cell=cell, cell0=cell)


@pytest.mark.parametrize("angle", [1e-3, 0.4, -2.0])
def test_a_rigid_rotation_does_no_corotated_work(angle):
    """Alone it leaves `-2 (1 - cos) tr P0` of Hill's work; after a strain it changes no W2."""
    before = state(synthetic_network(100, seed=5))
    graph = before.graph
    turned = table_between(before, turn(graph, angle))
    np.testing.assert_allclose(turned["rotation"], np.degrees(angle), rtol=1e-10)
    P0 = [
        0.5 * np.trace(love_weber_stress(loop_of_snapshot(before, k).graph))
        for k in turned["loop_before"].tolist()
    ]
    expected = -2 * (1 - np.cos(angle)) * np.array(P0)
    np.testing.assert_allclose(turned["hill_work"], expected, rtol=1e-8)
    assert np.abs(turned["W2"]).max() < 1e-15
    strained = affinely(before, 1e-3 * STRAINS[1])
    straight, both = table_between(before, strained), table_between(before, turn(strained, angle))
    scale = np.abs(straight["W2"]).max()
    np.testing.assert_allclose(both["W2"], straight["W2"], rtol=0, atol=1e-10 * scale)
    np.testing.assert_allclose(both["w2"], straight["w2"], rtol=0, atol=1e-8)
    np.testing.assert_allclose(both["affine_W2"], straight["affine_W2"], rtol=1e-9)


def other_names(graph, seed):
    """The same graph: grains renumbered and wrapped, contacts reordered and turned round."""
    rng = np.random.default_rng(seed)
    rank, home = rng.permutation(graph.grain_count), rng.integers(-1, 2, (graph.grain_count, 2))
    order, back = rng.permutation(graph.contact_count), rng.random(graph.contact_count) < 0.5
    old = np.where(back[:, None], graph.contacts[order][:, ::-1], graph.contacts[order])
    images = graph.images[order] * np.where(back, -1, 1)[:, None]
    images = images + home[old[:, 0]] - home[old[:, 1]]
    x, radii = np.empty_like(graph.x), np.empty_like(graph.radii)
    x[rank], radii[rank] = graph.x + home @ graph.cell.T, graph.radii
    ids = np.empty(graph.grain_count, dtype=int)
    ids[rank] = np.arange(graph.grain_count)
    renamed = GrainGraph(
        x=x,
        radii=radii,
        contacts=rank[old],
        images=images,
        cell=graph.cell,
        normal_force=graph.normal_force[order],
        shear_force=graph.shear_force[order],
    )
    return renamed, ids


def test_names_and_wrapping_change_nothing(packing):
    after = affinely(packing, 1e-3 * STRAINS[1])
    plain = table_between(packing, after)
    renamed, ids = other_names(after, 2)
    other = state(renamed, ids)
    found = loop_increments(packing, other, track_loops(packing, other))
    for name, values in plain.items():
        if name != "loop_after":
            atol = 1e-12 if name == "rotation" else 1e-14  # degrees
            np.testing.assert_allclose(found[name], values, rtol=1e-9, atol=atol, err_msg=name)
    # Later loops are named by the later snapshot.
    orders = other.faces.order[other.faces.loops][found["loop_after"]]
    np.testing.assert_array_equal(orders, found["order"])


def test_stress_increments_add_up_to_the_samples(packing):
    """Half-shared increments weighted by area, against the sum over all contacts in loops."""
    after = affinely(packing, 1e-2 * STRAINS[2])
    table = table_between(packing, after)
    graph = packing.graph
    inside = np.isin(np.repeat(packing.faces.kind, packing.faces.order), [0])
    share = np.bincount(packing.faces.contacts[inside], minlength=graph.contact_count) / 2
    change = (contact_forces(after) - contact_forces(graph)) * share[:, None]
    expected = change.T @ branch_vectors(graph)
    total = [np.sum(table["area"] * table[f"dP{ij}"]) for ij in ("11", "12", "21", "22")]
    np.testing.assert_allclose(np.reshape(total, (2, 2)), expected, rtol=1e-11)


def without(graph, lost):
    keep = ~np.isin(np.arange(graph.contact_count), lost)
    return graph.replace(
        contacts=graph.contacts[keep],
        images=graph.images[keep],
        normal_force=graph.normal_force[keep],
        shear_force=graph.shear_force[keep],
    )


def test_without_forces_there_is_strain_and_nothing_else(packing):
    graph = packing.graph
    bare = state(graph, law=None)
    later = affinely(packing, 1e-2 * STRAINS[0])
    after = state(later, law=None)
    table = loop_increments(bare, after, track_loops(bare, after))
    expected = {"loop_before", "loop_after", "order", "area", "rotation"}
    assert set(table) == expected | {"H11", "H12", "H21", "H22"}
    # One side with forces is not enough.
    assert set(loop_increments(bare, packing, track_loops(bare, packing))) == set(table)
    areas = {"order": bare.faces.order[bare.faces.loops], "area": bare.faces.area[bare.faces.loops]}
    assert "S11" not in evolution_row(bare, areas)
    assert "negative_W2" not in interval_row(bare, after, track_loops(bare, after), table)


def plain_table(tracked):
    loops = tracked.faces.loops
    smallest = np.linspace(-1, 1, len(loops))
    smallest[-1] = np.nan
    return {
        "order": tracked.faces.order[loops],
        "area": tracked.faces.area[loops],
        "affine_lambda_min": np.abs(smallest),
        "traction_lambda_min": smallest,
        "traction_free_lambda_min": smallest,
    }


def test_evolution_row(packing):
    row = evolution_row(packing, plain_table(packing))
    graph, order = packing.graph, plain_table(packing)["order"]
    stress = np.reshape([row["S11"], row["S12"], row["S21"], row["S22"]], (2, 2))
    np.testing.assert_allclose(stress, love_weber_stress(graph), rtol=1e-13)
    assert row["area"] == pytest.approx(np.linalg.det(graph.cell))
    assert row["mean_order"] == pytest.approx(order.mean())
    z = row["coordination"]
    # Exact for one cluster that winds around the cell.
    assert len(np.unique(packing.faces.component)) == 1
    assert row["mean_order"] == pytest.approx(2 * z / (z - 2))
    assert sum(row[f"share_{n}"] for n in range(3, 9)) == pytest.approx(1)
    assert sum(row[f"area_share_{n}"] for n in range(3, 9)) == pytest.approx(1)
    assert row["share_8"] == np.mean(order >= 8)
    slides = np.count_nonzero(packing.regime == Regime.SLIDING)
    assert row["sliding_fraction"] == slides / graph.contact_count
    smallest = plain_table(packing)["traction_lambda_min"][:-1]
    assert (row["affine_unstable"], row["traction_unstable"]) == (0, np.mean(smallest < 0))


def test_a_snapshot_without_loops_has_no_shares():
    chain = GrainGraph(x=[[0, 0], [1, 0]], radii=[0.5] * 2, contacts=[[0, 1]])
    empty = {name: np.zeros(0) for name in ("order", "area", "affine_lambda_min")}
    empty |= {name: np.zeros(0) for name in ("traction_lambda_min", "traction_free_lambda_min")}
    row = evolution_row(state(chain), empty)
    names = ("mean_order", "share_3", "area_share_6", "coordination", "S11", "affine_unstable")
    assert [row[name] for name in names] == [None] * 6
    assert row["loops"] == 0


def test_interval_row(packing):
    lost = np.arange(0, packing.graph.contact_count, 15)
    H = 1e-3 * STRAINS[1]
    after = state(without(affinely(packing, H), lost))
    fates = track_loops(packing, after)
    table = loop_increments(packing, after, fates)
    row = interval_row(packing, after, fates, table)
    np.testing.assert_allclose([row[f"dH{ij}"] for ij in ("11", "22")], H.diagonal(), rtol=1e-10)
    assert row["strain_from"] == "cell"
    assert (row["opened"], row["closed"]) == (len(lost), 0)
    earlier = ("survived", "split", "merged", "changed", "died")
    assert sum(row[name] for name in earlier) == len(fates.before)
    assert row["survived"] == len(table["order"])
    assert row["born"] == np.count_nonzero(fates.after == Fate.BORN)
    for name in PREDICTIONS:
        known = np.isfinite(table[name])
        signs = np.array([[row[f"{name}_{a}_{p}"] for p in SIGNS] for a in SIGNS])
        assert signs.sum() == np.count_nonzero(known)
        assert signs[0].sum() == np.count_nonzero(table["W2"][known] < 0)
        assert signs[:, 0].sum() == np.count_nonzero(table[name][known] < 0)
    assert row["negative_W2"] == np.count_nonzero(table["W2"] < 0)


SIGNS = ("negative", "positive")


def test_strain_of_the_sample():
    rng = np.random.default_rng(3)
    H = 0.1 * rng.uniform(-1, 1, (2, 2))
    for periodic, source in ((True, "cell"), (False, "grains")):
        before = state(synthetic_network(80, seed=1, periodic=periodic))
        after = state(affinely(before, H))
        found, how = sample_strain(before, after)
        np.testing.assert_allclose(found, H, atol=1e-13)
        assert how == source
    # A code may flip a tilted cell by adding one vector to the other.
    before = state(synthetic_network(80, seed=1, periodic=True))
    graph = affinely(before, H)
    flipped = graph.replace(
        cell=graph.cell @ [[1, -1], [0, 1]],
        cell0=None,
        images=graph.images @ np.array([[1, 0], [1, 1]]),
    )
    np.testing.assert_allclose(sample_strain(before, state(flipped))[0], H, atol=1e-13)
    # Grains that left and came don't count; with none in common nothing is known.
    plane = state(synthetic_network(80, seed=1))
    ids = np.arange(80)
    ids[40:] += 1000
    later = affinely(plane, H)
    found, _ = sample_strain(plane, state(later, ids))
    np.testing.assert_allclose(found, H, atol=1e-13)
    found, how = sample_strain(plane, state(later, ids + 5000))
    assert np.isnan(found).all()
    assert how == "unknown"


def test_strains_of_a_series_add_up():
    rng = np.random.default_rng(8)
    H = 0.05 * rng.uniform(-1, 1, (3, 2, 2))
    keys = ("11", "12", "21", "22")
    intervals = [{f"dH{k}": v for k, v in zip(keys, h.flat, strict=True)} for h in H]
    table = evolution_table([{"loops": n} for n in (5, 6, 7, 8)], intervals)
    F = np.eye(2)
    for k, h in enumerate(H):
        F = (np.eye(2) - h) @ F
        found = [table[f"H{ij}"][k + 1] for ij in keys]
        np.testing.assert_allclose(found, (np.eye(2) - F).ravel(), atol=1e-15)
    assert table["loops"].tolist() == [5, 6, 7, 8]
    assert table["shear_strain"][0] == 0
    # Compression by 2 % along one axis, then back: the path goes on.
    there, back = np.diag([0.02, -0.02]), np.diag([-0.02, 0.02])
    steps = [dict(zip((f"dH{k}" for k in keys), h.ravel(), strict=True)) for h in (there, back)]
    path = evolution_table([{}, {}, {}], steps)["shear_strain"]
    np.testing.assert_allclose(path, [0, 0.02, 0.04], rtol=1e-12)
    # An interval of unknown strain leaves the rest unknown.
    unknown = [intervals[0] | dict.fromkeys((f"dH{k}" for k in keys), None), intervals[1]]
    table = evolution_table([{}, {}, {}], unknown)
    assert np.isnan(table["H11"][1:]).all()
