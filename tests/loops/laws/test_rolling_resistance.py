import numpy as np
import pytest
from scipy.optimize import brentq

from loops import (
    CohesiveFrictional,
    ContactLaw,
    GrainGraph,
    HertzMindlin,
    InputError,
    LinearFrictional,
    Regime,
    RollingResistance,
    assemble_tangent,
    contact_state,
    macroscopic_tangent,
)
from patterns import random_loop, regular_polygon
from stability import restrict, symmetric_spectrum
from tests.oracles.finite_motion import assert_slope, assert_turns_forces, forces_of_spheres
from tests.oracles.polygon_thresholds import critical_strain

KN, KT, MU, KR = 1.3, 0.4, 0.5, 0.07
LINEAR = LinearFrictional(kn=KN, kt=KT, mu=MU)
LAW = RollingResistance(LINEAR, k_r=KR)


def test_law_meets_the_protocol():
    assert isinstance(LAW, ContactLaw)


def test_spin_block_gains_the_graph_laplacian():
    """On any graph, unequal radii, sticking and sliding: k_r (D - A), and nothing elsewhere."""
    graph = random_loop(6, seed=2, polydispersity=0.4, strain=0.05)
    graph = GrainGraph(
        x=graph.x,
        radii=graph.radii,
        contacts=np.vstack([graph.contacts, [[4, 1]]]),
        normal_force=np.append(graph.normal_force, 0.02),
        shear_force=np.append(graph.shear_force, 0.02 * MU),
    )
    regime = LAW.regime(contact_state(graph))
    assert Regime.SLIDING in regime
    added = assemble_tangent(graph, LAW, spins=True) - assemble_tangent(graph, LINEAR, spins=True)
    adjacency = np.zeros((6, 6))
    adjacency[graph.contacts[:, 0], graph.contacts[:, 1]] = 1.0
    adjacency += adjacency.T
    np.testing.assert_allclose(
        added[12:, 12:], KR * (np.diag(adjacency.sum(axis=1)) - adjacency), atol=1e-16
    )
    assert not added[:12].any()
    assert not added[12:, :12].any()


@pytest.mark.parametrize("order", [3, 4, 5, 6, 9, 12])
def test_eigenvalues_of_the_spin_block(order):
    """kt R^2 (2 + 2 cos q) + k_r (2 - 2 cos q), q = 2 pi m/n: the gear mode costs 4 k_r."""
    block = assemble_tangent(regular_polygon(order), LAW, spins=True)[2 * order :, 2 * order :]
    q = 2 * np.pi * np.arange(order) / order
    expected = np.sort(KT * 0.25 * (2 + 2 * np.cos(q)) + KR * (2 - 2 * np.cos(q)))
    np.testing.assert_allclose(np.linalg.eigvalsh(block), expected, atol=1e-14)


@pytest.mark.parametrize("order", [3, 4, 5, 6, 7, 12, 31])
def test_null_space_of_an_unloaded_loop(order):
    """Every relative motion is held: 3 rigid motions; without friction n hinges and one turn.

    Sticking, a null vector has un' = ut' = 0 and equal spins at every contact: a rigid frame, so
    the n - 3 rolling mechanisms are gone. Without shear stiffness the 2 n translations keep n
    null vectors of the n lengths, and the spins turn together.
    """
    graph = regular_polygon(order)
    for kt, nullity in ((KT, 3), (0.0, order + 1)):
        law = RollingResistance(LinearFrictional(kn=1.0, kt=kt), k_r=KR)
        values = np.linalg.svd(assemble_tangent(graph, law, spins=True), compute_uv=False)
        assert np.count_nonzero(values < 1e-12) == nullity
        assert values[-nullity - 1] > 1e-7


@pytest.mark.parametrize("base", ["linear", "hertz"])
def test_rigid_motions_cost_no_moment(base):
    inner = LINEAR if base == "linear" else HertzMindlin(young=2.0, poisson=0.2, mu=MU)
    law = RollingResistance(inner, k_r=KR)
    graph = random_loop(5, seed=4, polydispersity=0.5, strain=0.1)
    tangent = assemble_tangent(graph, law, spins=True)
    still = np.concatenate([np.tile([1.0, -2.0], 5), np.zeros(5)])
    assert np.abs(tangent @ still).max() < 1e-14
    assert_turns_forces(graph, tangent)


def test_tangent_is_the_slope_of_the_law():
    """On top of Hertz-Mindlin, finite differences of the integrated forces and moments."""
    inner = HertzMindlin(young=3.0, poisson=0.3, mu=MU)
    law = RollingResistance(inner, k_r=KR)
    graph = random_loop(6, seed=5, polydispersity=0.3, strain=0.1)
    normal = inner.normal_force(contact_state(graph))
    graph = graph.replace(normal_force=normal, shear_force=0.3 * MU * normal)
    regime = np.full(6, Regime.ELASTIC)
    rng = np.random.default_rng(5)
    v, w = rng.normal(size=(6, 2)), rng.normal(size=6)
    rate = assemble_tangent(graph, law, spins=True) @ np.append(v.ravel(), w)

    def forces(step):
        return forces_of_spheres(graph, 3.0, 0.3, MU, KR, regime, v, w, step)

    assert_slope(forces, rate, 2.0 ** -np.arange(9, 14), atol=0.03)


def test_everything_else_is_the_other_laws():
    graph = random_loop(6, seed=7, polydispersity=0.2, strain=0.05)
    state = contact_state(graph)
    rates = (np.linspace(-1, 1, 6), np.linspace(1, -1, 6))
    np.testing.assert_array_equal(LAW.regime(state, rates), LINEAR.regime(state, rates))
    np.testing.assert_array_equal(LAW.normal_force(state), LINEAR.normal_force(state))
    for closure in ("affine", "traction"):
        for spins in ("blocked", "affine"):
            one, other = (
                macroscopic_tangent(graph, law, closure, spins=spins).matrix
                for law in (LAW, LINEAR)
            )
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-13)


def test_what_a_law_overrides_holds_beside_a_spring():
    """Formulae and facts for checks of tables too, which the base would answer for itself."""
    bonds = CohesiveFrictional(2.0, 0.5, 0.3, 0.01, bonded=True)
    spheres = HertzMindlin(1.0, 0.3, 0.2, shear_history="displacement")
    state = contact_state(random_loop(6, seed=7, polydispersity=0.2, strain=0.05))
    for law in (bonds, spheres):
        both = RollingResistance(law, KR)
        for name in ("stiffnesses", "coupling", "strength", "strength_slope", "gap"):
            one, other = (np.asarray(getattr(each, name)(state)) for each in (both, law))
            np.testing.assert_array_equal(one, other)
        for name in ("cohesive", "bonded", "adhesion", "overlap_power", "of_moduli", "mu"):
            assert getattr(both, name) == getattr(law, name)
        assert both.table_words is None


def test_open_contacts_have_no_spring_and_springs_add_up():
    pair = GrainGraph(x=[[0, 0], [1.1, 0]], radii=[0.5, 0.5], contacts=[[0, 1]])
    state = contact_state(pair)
    assert LAW.rolling_stiffness(state, LAW.regime(state)).tolist() == [0.0]
    assert not assemble_tangent(pair, LAW, spins=True).any()
    # A touching contact that the rates open loses its spring too.
    touching = contact_state(pair.replace(x=[[0, 0], [1.0, 0]]))
    twice = RollingResistance(LAW, k_r=0.01)
    for un, expected in ((1.0, 0.0), (-1.0, KR + 0.01)):
        regime = twice.regime(touching, (np.array([un]), np.zeros(1)))
        assert twice.rolling_stiffness(touching, regime).tolist() == [pytest.approx(expected)]


def test_stiffnesses_are_taken_per_contact():
    law = RollingResistance(LinearFrictional(kn=[1.0, 2.0, 3.0], kt=0.5), k_r=[0.1, 0.2, 0.3])
    picked = law.take(np.array([[2, 0], [1, 1]]))
    assert picked.k_r.tolist() == [[0.3, 0.1], [0.2, 0.2]]
    assert picked.law.kn.tolist() == [[3.0, 1.0], [2.0, 2.0]]
    assert LAW.take(np.array([0, 0])).k_r.tolist() == KR


@pytest.mark.parametrize("value", [-0.1, np.nan, np.inf])
def test_bad_stiffness_is_named(value):
    with pytest.raises(InputError, match="k_r"):
        RollingResistance(LINEAR, k_r=value)


def smallest(order, strain, closure, law):
    loop = regular_polygon(order, strain=strain)
    loop = loop.replace(normal_force=law.normal_force(contact_state(loop)))
    tangent = macroscopic_tangent(loop, law, closure, spins="free")
    return symmetric_spectrum(restrict(tangent.matrix, "diagonal"))[0]


@pytest.mark.parametrize("closure", ["affine", "traction"])
@pytest.mark.parametrize("order", [3, 4, 5, 6, 7, 8])
@pytest.mark.parametrize("k_r", [1e-4, 0.02, 1.0])
def test_critical_strain_with_free_spins(order, closure, k_r):
    """E/(1 - E) = kappa', 1/kappa' = 1/kappa + (1 - E)^2 cot^2(2 pi/n)/(4 k_r), kn = l0 = 1."""
    law = RollingResistance(LinearFrictional(kn=1.0, kt=0.3), k_r=k_r)
    expected = critical_strain(order, 0.3, closure, rolling=lambda e: k_r / (1 - e) ** 2)
    # Beyond its zero the traction operator has a pole, above 1/2.
    high = 0.45 if closure == "traction" and order > 3 else 0.7
    found = brentq(lambda e: smallest(order, e, closure, law), 1e-6, high, xtol=1e-15)
    assert abs(found - expected) < 1e-9


def test_a_stiff_rolling_spring_brings_back_the_diamonds_threshold():
    """But for the share kappa cot^2(2 pi/n)/(4 k_r) of the formula above."""
    law = RollingResistance(LinearFrictional(kn=1.0, kt=0.3), k_r=1e4)
    for order in (4, 5, 8):
        found = brentq(lambda e, n=order: smallest(n, e, "traction", law), 1e-6, 0.5, xtol=1e-15)
        assert abs(found - 0.3 / 1.3) < 1e-5


def hertz_rolling(k_r):
    def ratio(strain):
        # kn = 2 E* sqrt(R* delta) with E = 1, nu = 0.2, radii 1/2, delta = E.
        return k_r / (2 * (1 / 1.92) * np.sqrt(0.25 * strain) * (1 - strain) ** 2)

    return ratio


@pytest.mark.parametrize("closure", ["affine", "traction"])
@pytest.mark.parametrize("order", [3, 5, 6, 8])
def test_critical_strain_of_hertzian_grains_that_resist_rolling(order, closure):
    law = RollingResistance(HertzMindlin(young=1.0, poisson=0.2), k_r=0.03)
    expected = critical_strain(
        order, 8 / 9, closure, exponent=1.5, rolling=lambda e: hertz_rolling(0.03)(max(e, 1e-300))
    )
    high = 0.58 if closure == "traction" and order > 3 else 0.8
    found = brentq(lambda e: smallest(order, e, closure, law), 1e-4, high, xtol=1e-15)
    assert abs(found - expected) < 1e-9
