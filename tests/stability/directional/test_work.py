"""Branch-aware directional analysis against closed forms and the rate problem of the paths."""

from functools import cache

import numpy as np
import pytest

from loops import GrainGraph, InputError, LinearFrictional, Regime, Scene, macroscopic_tangent
from patterns import diamond, regular_polygon
from stability import (
    branch_fraction,
    directional_work,
    plane_cone,
    programmes,
    rates_at,
    restrict,
    second_order_work,
    subspace_basis,
    symmetric_spectrum,
    unstable_fraction,
)
from stability.directional import edge_contacts
from stability.directional.branches import edges_of
from tests.oracles.diamond import TABLE_1, TABLE_2, elastic_moduli, sliding_moduli, tangent
from tests.oracles.drained import drained_path

TABLES = [TABLE_1, TABLE_2]
ANGLES = 2 * np.pi * (np.arange(997) + 0.3) / 997
CIRCLE = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=-1)


def at_yield(table):
    """The diamond at point B of the drained path: graph, law, volume."""
    B = drained_path(table).end
    graph = diamond(table.alpha0, E1=B.E1, E2=B.E2, T=B.T)
    law = LinearFrictional(kn=1.0, kt=table.kappa, mu=table.mu)
    return graph, law, 2 * np.sin(2 * table.alpha0)


def closed_forms(table):
    """Elastic and sliding K at B, and the row whose sign tells sliding, all in closed form."""
    B, a0 = drained_path(table).end, table.alpha0
    s = float(np.sign(B.T))
    elastic = tangent(B.E1, B.E2, B.s1, B.s2, a0, *elastic_moduli(table.kappa))
    sliding = tangent(B.E1, B.E2, B.s1, B.s2, a0, *sliding_moduli(B.alpha, table.mu, s))
    c, n = np.cos(B.alpha), np.sin(B.alpha)
    turn = np.array([np.cos(a0) * n, -np.sin(a0) * c])  # l alpha'
    shorten = np.array([np.cos(a0) * c, np.sin(a0) * n])  # -l' = N'/kn
    return elastic, sliding, s * table.kappa * turn - table.mu * shorten


@pytest.mark.parametrize("table", TABLES)
@pytest.mark.parametrize("closure", ["affine", "traction"])
def test_diamond_at_yield_follows_the_closed_forms(table, closure):
    graph, law, volume = at_yield(table)
    found = directional_work(graph, law, CIRCLE, closure=closure, volume=volume)
    elastic, sliding, row = closed_forms(table)
    slides = CIRCLE @ row > 0
    K = np.where(slides[:, None, None], sliding, elastic)
    assert (found.status == "unique").all() and found.singular == 0
    assert (found.regime == np.where(slides, Regime.SLIDING, Regime.ELASTIC)[:, None]).all()
    np.testing.assert_allclose(found.work[:, 0], second_order_work(K, CIRCLE), atol=1e-13)
    np.testing.assert_array_equal(found.work[:, 0], found.work[:, 1])
    stress = np.einsum("nij,nj->ni", K, CIRCLE)
    np.testing.assert_allclose(
        found.normalised[:, 0], found.work[:, 0] / np.linalg.norm(stress, axis=1), atol=1e-12
    )
    assert 0.2 < slides.mean() < 0.8


@pytest.mark.parametrize("table", TABLES)
@pytest.mark.parametrize("closure", ["affine", "traction"])
def test_edges_of_the_diamond_in_closed_form(table, closure):
    graph, law, volume = at_yield(table)
    found = branch_fraction(graph, law, closure=closure, volume=volume)
    elastic, sliding, row = closed_forms(table)
    expected = []
    for K, half in ((elastic, -row), (sliding, row)):
        for edge in plane_cone(K).edges:
            for angle in (edge, edge + np.pi):
                if half @ [np.cos(angle), np.sin(angle)] > 0:
                    expected.append(angle % (2 * np.pi))
    np.testing.assert_allclose(found.edges, np.sort(expected), atol=1e-12)
    # Forms are even and meet on the line that parts their halves: the mean of their fractions.
    one = [plane_cone(K).opening / np.pi for K in (elastic, sliding)]
    np.testing.assert_allclose([found.elastic, found.sliding], one, atol=1e-12)
    np.testing.assert_allclose(found.unstable, np.mean(one), atol=1e-12)
    assert found.sliding - found.elastic > 0.05 and found.error == 0
    np.testing.assert_allclose(found.surely, found.unstable, atol=1e-15)


@pytest.mark.parametrize("mu", [0.1, 0.5, 2.0])
def test_one_contact_loses_one_nappe(mu):
    # Tangent [[1, 0], [mu, 0]] when sliding, a double cone of opening arctan(mu); else it sticks.
    pair = GrainGraph(
        x=[[0, 0], [1, 1]], radii=[0.8, 0.8], contacts=[[0, 1]],
        normal_force=[1e-16], shear_force=[mu * 1e-16],
    )  # fmt: skip
    law = LinearFrictional(kn=1.0, kt=0.3, mu=mu)
    found = branch_fraction(pair, law, volume=1.0, closure="affine")
    np.testing.assert_allclose(found.sliding, np.arctan(mu) / np.pi, atol=1e-13)
    np.testing.assert_allclose(found.unstable, 0.5 * np.arctan(mu) / np.pi, atol=1e-13)
    # In all four components W2 sees a plane alone: the same fraction, now by sampling.
    full = branch_fraction(pair, law, subspace="full", volume=1.0, scramblings=64, closure="affine")
    assert 0 < full.error < 2e-3 and full.edges is None
    assert abs(full.unstable - found.unstable) < 4 * full.error


def test_touching_contact_in_closed_form():
    # Parting it carries nothing; pressed it sticks, or slides to either side: W2 >= 0 nowhere
    # negative but where friction does work on the other side, |T'| = mu N' along +-ut'.
    pair = GrainGraph(x=[[0, 0], [1, 1]], radii=[0.5**0.5] * 2, contacts=[[0, 1]])
    kt, mu = 0.7, 0.4
    found = directional_work(
        pair, LinearFrictional(kn=1.0, kt=kt, mu=mu), CIRCLE, volume=1.0, closure="affine"
    )
    a, b = CIRCLE @ [0.5**0.5, 0.5**0.5], CIRCLE @ [-(0.5**0.5), 0.5**0.5]
    N = np.maximum(a, 0)
    T = np.clip(kt * b, -mu * N, mu * N)
    np.testing.assert_allclose(found.work[:, 0], N * a + T * b, atol=1e-15)
    slides = kt * np.abs(b) > mu * a
    regime = np.where(a < 0, Regime.OPEN, np.where(slides, Regime.SLIDING, Regime.ELASTIC))
    np.testing.assert_array_equal(found.regime[:, 0], regime)
    assert set(regime) == {0, 1, 2}


@pytest.mark.parametrize("subspace", ["diagonal", "symmetric", "full"])
@pytest.mark.parametrize("closure", ["affine", "traction"])
def test_without_edge_contacts_it_is_the_quadratic_form(closure, subspace):
    graph = regular_polygon(5, strain=0.35)
    law = LinearFrictional(kn=1.0, kt=0.2, mu=0.5)
    found = branch_fraction(graph, law, closure=closure, subspace=subspace)
    K = restrict(macroscopic_tangent(graph, law, closure).matrix, subspace)
    expected = unstable_fraction(symmetric_spectrum(K))
    if closure == "traction":
        assert expected > 0.05
    np.testing.assert_allclose(found.unstable, expected, atol=1e-14)
    assert found.elastic == found.sliding and found.error == 0
    assert found.none == 0 and found.several == 0


def odd_loop(rng, order, law, *, touching=0, yielding=0.8):
    """Irregular loop of odd order whose radii fit its overlaps; contacts at yield or touching."""
    following = (np.arange(order) + 1) % order
    contacts = np.column_stack([np.arange(order), following])
    while True:
        angle = 2 * np.pi * (np.arange(order) + rng.uniform(-0.3, 0.3, order)) / order
        x = rng.uniform(0.8, 1.2, (order, 1)) * np.column_stack([np.cos(angle), np.sin(angle)])
        length = np.linalg.norm(x[following] - x, axis=1)
        normal = 0.2 * length * rng.uniform(0.3, 1.7, order)
        normal[:touching] = 0
        radii = np.linalg.solve(np.eye(order) + np.eye(order)[following], length + normal)
        if radii.min() > 0.05:
            break
    side = rng.choice([-1.0, 1.0], order)
    share = np.where(rng.random(order) < yielding, 1.0, 0.5)
    return GrainGraph(
        x=x, radii=radii, contacts=contacts, normal_force=normal,
        shear_force=side * share * float(law.mu) * normal,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("closure", "spins", "touching", "subspace"),
    [
        ("affine", "blocked", 1, "full"),
        ("affine", "affine", 1, "full"),
        ("affine", "free", 0, "symmetric"),
        ("traction", "blocked", 0, "symmetric"),
        ("traction", "blocked", 1, "diagonal"),
        ("traction", "affine", 1, "full"),
        ("traction", "free", 0, "diagonal"),
    ],
)
def test_solutions_are_those_of_the_rate_problem(closure, spins, touching, subspace):
    rng = np.random.default_rng(3)
    basis = subspace_basis(subspace)
    seen = set()
    for _ in range(12):
        law = LinearFrictional(kn=1.0, kt=rng.uniform(0.1, 1), mu=rng.uniform(0.2, 1))
        graph = odd_loop(rng, int(rng.choice([3, 5])), law, touching=touching)
        directions = rng.standard_normal((3, len(basis)))
        found = directional_work(
            graph, law, directions, closure=closure, spins=spins, subspace=subspace
        )
        for k, e in enumerate(found.directions):
            control = programmes.combination(np.zeros((4, 4)), np.eye(4), e @ basis)
            other = rates_at(Scene(graph, law), control, closure=closure, spins=spins)
            seen.add(other.status)
            assert found.status[k] == other.status
            if other.solutions:
                work = [(basis @ each.rates.rates.P) @ e for each in other.solutions]
                expected = [min(work), max(work)]
                np.testing.assert_allclose(found.work[k], expected, rtol=1e-8, atol=1e-10)
            if other.status == "unique":
                np.testing.assert_array_equal(found.regime[k], other.taken.rates.mode.regime)
    assert "unique" in seen


@cache
def loop_with_several():
    """A pentagon whose rate problem has several solutions in some directions, none in others."""
    rng = np.random.default_rng(11)
    for _ in range(200):
        law = LinearFrictional(kn=1.0, kt=rng.uniform(0.1, 0.4), mu=rng.uniform(0.6, 1))
        graph = odd_loop(rng, 5, law, yielding=1.0)
        found = branch_fraction(graph, law, closure="traction")
        if found.several > 0.02 and found.none > 0.02 and found.unstable - found.surely > 0.01:
            return graph, law, found
    raise AssertionError("no such loop")


def test_several_and_no_solutions_by_their_share_of_the_plane():
    graph, law, found = loop_with_several()
    angle = 2 * np.pi * (np.arange(20_000) + 0.5) / 20_000
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    dense = directional_work(graph, law, circle, closure="traction")
    # A grid misses each end of an arc by one step at most.
    atol = 40 / 20_000
    assert abs((dense.status == "several").mean() - found.several) < atol
    assert abs((dense.status == "none").mean() - found.none) < atol
    assert abs((dense.work[:, 0] < 0).mean() - found.unstable) < atol
    assert abs((dense.work[:, 1] < 0).mean() - found.surely) < atol
    assert np.isnan(dense.work[dense.status == "none"]).all()
    assert (dense.regime[dense.status == "none"] == -1).all()


def test_plane_and_sampling_agree_in_space():
    # A batch of directions in the plane embedded in the symmetric subspace gives the plane's W2.
    rng = np.random.default_rng(5)
    law = LinearFrictional(kn=1.0, kt=0.3, mu=0.5)
    graph = odd_loop(rng, 5, law)
    space = np.column_stack([CIRCLE, np.zeros(len(CIRCLE))])
    plane = directional_work(graph, law, CIRCLE, closure="traction")
    embedded = directional_work(graph, law, space, closure="traction", subspace="symmetric")
    np.testing.assert_array_equal(plane.status, embedded.status)
    np.testing.assert_allclose(plane.work, embedded.work, atol=1e-12)


def test_batch_of_states_is_each_state():
    rng = np.random.default_rng(6)
    law = LinearFrictional(kn=1.0, kt=0.4, mu=0.3)
    angle, E = rng.uniform(0.5, 1.0, 7), rng.uniform(0.02, 0.3, 7)
    N = diamond(angle, E1=E, E2=E).normal_force[:, 0]
    graph = diamond(angle, E1=E, E2=E, T=np.where(np.arange(7) % 2, 0.3, 0.1) * N)
    together = branch_fraction(graph, law, closure="affine")
    work = directional_work(graph, law, CIRCLE[:50], subspace="diagonal", closure="affine").work
    for k in range(7):
        alone = diamond(angle[k], E1=E[k], E2=E[k], T=float(graph.shear_force[k, 0]))
        one = branch_fraction(alone, law, closure="affine")
        np.testing.assert_allclose(together.unstable[k], one.unstable, atol=1e-14)
        edges = together.edges[k][~np.isnan(together.edges[k])]
        np.testing.assert_allclose(edges, one.edges, atol=1e-12)
        np.testing.assert_allclose(
            work[k], directional_work(alone, law, CIRCLE[:50], closure="affine").work, atol=1e-14
        )
    assert np.ptp(together.unstable) > 0.01


def test_edge_contacts_of_every_kind():
    ring = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
    x = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    graph = GrainGraph(
        x=x, radii=[0.5] * 4, contacts=ring,
        normal_force=[0, 0.1, 0.1, 0.1], shear_force=[0, 0.05 * (1 - 1e-11), 0.02, -0.03],
    )  # fmt: skip
    law = LinearFrictional(kn=1.0, kt=0.5, mu=0.5)
    edge = edge_contacts(graph, law)
    assert edge.touching.tolist() == [True, False, False, False]
    assert edge.at_yield.tolist() == [False, True, False, False]
    flagged = edge_contacts(graph, law, regime=[0, 1, 1, 2])
    assert flagged.touching.tolist() == [False] * 4
    assert flagged.at_yield.tolist() == [False, True, False, True]
    assert flagged.side.tolist() == [0, 1, 0, -1] and flagged.regime.tolist() == [0, 1, 1, 1]
    slippery = edge_contacts(graph, LinearFrictional(kn=1.0, kt=0.5, mu=[0.5, 0, np.inf, 0.5]))
    assert slippery.at_yield.tolist() == [False] * 4
    assert slippery.regime.tolist() == [1, 2, 1, 1]


def test_spins_that_turn_with_the_loop_change_the_shear_that_decides():
    rng = np.random.default_rng(8)
    law = LinearFrictional(kn=1.0, kt=0.3, mu=0.5)
    graph = odd_loop(rng, 5, law)
    e = rng.standard_normal((40, 3))
    options = {"subspace": "symmetric", "closure": "affine"}
    blocked = directional_work(graph, law, e, **options)
    turning = directional_work(graph, law, e, spins="affine", **options)
    # The reference is the current state: no rotation in this subspace, no spin.
    np.testing.assert_allclose(blocked.work, turning.work, atol=1e-14)
    full = rng.standard_normal((40, 4))
    a = directional_work(graph, law, full, subspace="full", closure="affine")
    b = directional_work(graph, law, full, subspace="full", spins="affine", closure="affine")
    assert np.abs(a.work - b.work).max() > 0.1 and (a.regime != b.regime).any()


def test_edges_ignore_arcs_without_length():
    angle = np.array([0.5, 0.5, 2.0, 2.0 + 1e-15, 5.0])
    inside = np.array([False, True, True, False, False])
    np.testing.assert_allclose(edges_of(angle, inside), [0.5, 2.0], atol=1e-12)


def test_bad_input():
    graph, law, volume = at_yield(TABLE_1)
    with pytest.raises(InputError, match="directions"):
        directional_work(graph, law, [[1.0, 0.0, 0.0]], volume=volume, closure="affine")
    with pytest.raises(InputError, match="directions"):
        directional_work(graph, law, [[0.0, 0.0]], volume=volume, closure="affine")
    many = regular_polygon(9, strain=0.1)
    many = many.replace(shear_force=0.5 * many.normal_force)
    strict = LinearFrictional(kn=1.0, kt=0.5, mu=0.5)
    with pytest.raises(InputError, match="512 combinations"):
        branch_fraction(many, strict, closure="traction")
    assert branch_fraction(many, strict, closure="affine").error == 0
    with pytest.raises(InputError, match="batch axes"):
        branch_fraction(regular_polygon(4, strain=[0.1, 0.2]), strict, closure="traction")
    with pytest.raises(InputError, match="scramblings"):
        branch_fraction(graph, law, scramblings=1, closure="affine")


@pytest.mark.parametrize("subspace", ["symmetric", pytest.param("full", marks=pytest.mark.slow)])
def test_sampled_fractions_against_plain_random_directions(subspace):
    graph, law, _ = loop_with_several()
    options = {"closure": "traction", "subspace": subspace}
    found = branch_fraction(graph, law, scramblings=32, **options)
    count = 40_000
    e = np.random.default_rng(17).standard_normal((count, len(subspace_basis(subspace))))
    drawn = directional_work(graph, law, e, **options)
    shares = {
        "unstable": drawn.work[:, 0] < 0,
        "surely": drawn.work[:, 1] < 0,
        "none": drawn.status == "none",
        "several": drawn.status == "several",
    }
    for name, hits in shares.items():
        p = float(hits.mean())
        assert abs(getattr(found, name) - p) < 5 * np.sqrt((p + 1e-4) / count) + 5 * found.error
    assert found.unstable - found.surely > 5 * found.error > 0
