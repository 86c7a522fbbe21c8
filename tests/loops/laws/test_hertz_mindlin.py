import mpmath
import numpy as np
import pytest
from scipy.optimize import brentq

from loops import (
    ContactLaw,
    FrictionalLaw,
    GrainGraph,
    HertzMindlin,
    InputError,
    LinearFrictional,
    Regime,
    assemble_tangent,
    contact_state,
    macroscopic_tangent,
)
from patterns import random_loop, regular_polygon
from stability import restrict, symmetric_spectrum
from tests.oracles.finite_motion import (
    assert_slope,
    assert_turns_forces,
    forces_of_spheres,
    hertz_force,
    mindlin_stiffness,
)
from tests.oracles.polygon_thresholds import critical_strain
from tests.oracles.rings import member

YOUNG, POISSON, MU = 3.0, 0.3, 0.5
LAW = HertzMindlin(young=YOUNG, poisson=POISSON, mu=MU)


def one_contact(length=0.9, normal=None, shear=0.0, radii=(0.7, 0.4), law=LAW):
    graph = GrainGraph(x=[[0, 0], [length, 0]], radii=radii, contacts=[[0, 1]])
    normal = law.normal_force(contact_state(graph)) if normal is None else [normal]
    return graph.replace(normal_force=normal, shear_force=[shear])


def regime_of(graph, rates=None, law=LAW):
    rates = None if rates is None else tuple(np.array([rate]) for rate in rates)
    return Regime(int(law.regime(contact_state(graph), rates)[0]))


def hertz_loop(seed, order=6, share=0.0, **options):
    """A random loop with Hertz's normal forces, some contacts at yield."""
    graph = random_loop(order, seed, polydispersity=0.3, strain=0.1, **options)
    normal = LAW.normal_force(contact_state(graph))
    rng = np.random.default_rng(seed)
    mobilised = rng.uniform(-0.9, 0.9, normal.shape)
    sliding = rng.random(normal.shape) < share
    mobilised = np.where(sliding, np.sign(mobilised), mobilised)
    graph = graph.replace(normal_force=normal, shear_force=mobilised * MU * normal)
    return graph, np.where(sliding, Regime.SLIDING, Regime.ELASTIC)


def test_law_meets_the_protocol():
    assert isinstance(LAW, ContactLaw)


def test_normal_force_is_the_slope_of_hertzs_energy():
    """U = (8/15) E* sqrt(R*) delta^(5/2), differentiated to 50 digits."""
    with mpmath.workdps(50):
        e_star = mpmath.mpf(YOUNG) / (2 * (1 - mpmath.mpf(POISSON) ** 2))
        r_i, r_j, at = mpmath.mpf(0.7), mpmath.mpf(0.4), mpmath.mpf(0.9)

        def energy(length):
            root = mpmath.sqrt(r_i * r_j / (r_i + r_j))
            return mpmath.mpf(8) / 15 * e_star * root * (r_i + r_j - length) ** mpmath.mpf("2.5")

        force = float(-mpmath.diff(energy, at))
        stiffness = float(mpmath.diff(energy, at, 2))
    state = contact_state(one_contact())
    np.testing.assert_allclose(LAW.normal_force(state), force, rtol=2e-15)
    np.testing.assert_allclose(LAW.normal_stiffness(state), stiffness, rtol=2e-15)


@pytest.mark.parametrize(("poisson", "ratio"), [(0.0, 1.0), (0.5, 2 / 3), (0.2, 8 / 9)])
def test_mindlins_ratio(poisson, ratio):
    law = HertzMindlin(young=2.0, poisson=poisson)
    for length in (0.5, 0.99, 1 - 1e-9):
        state = contact_state(one_contact(length, radii=(0.5, 0.5), law=law))
        block = law.local_stiffness(state, law.regime(state))[0]
        assert block[1, 1] / block[0, 0] == pytest.approx(ratio, rel=1e-15)
        kt = mindlin_stiffness(2.0, poisson, 0.5, 0.5, length)
        assert block[1, 1] == pytest.approx(kt, rel=1e-15)


def test_sphere_against_a_much_larger_one_is_a_sphere_on_a_plane():
    """R* -> r: Hertz's sphere on a half-space, F = (4/3) E* sqrt(r) delta^1.5."""
    delta = 2.0**-10
    graph = one_contact(length=1e9 + 1 - delta, radii=(1.0, 1e9))
    e_star = YOUNG / (2 * (1 - POISSON**2))
    # The overlap of 1e-3 is all that is left of a length of 1e9: eps 1e9 / 1e-3.
    np.testing.assert_allclose(graph.normal_force, 4 / 3 * e_star * delta**1.5, rtol=4e-4)


@pytest.mark.parametrize("rule", ["branch", "radii"])
@pytest.mark.parametrize("share", [0.0, 0.5])
def test_tangent_is_the_slope_of_the_law(rule, share):
    """Finite differences of the exactly integrated law: first order one-sided, second centred."""
    graph, regime = hertz_loop(5, share=share)
    assert (share == 0) == (regime == Regime.ELASTIC).all()
    law = HertzMindlin(young=YOUNG, poisson=POISSON, mu=MU, shear_increment=rule)
    np.testing.assert_array_equal(law.regime(contact_state(graph)), regime)
    tangent = assemble_tangent(graph, law, spins=True)
    rng = np.random.default_rng(5)
    v, w = rng.normal(size=(6, 2)), rng.normal(size=6)
    rate = tangent @ np.append(v.ravel(), w)

    def forces(step):
        return forces_of_spheres(graph, YOUNG, POISSON, MU, 0.0, regime, v, w, step, rule)

    assert_slope(forces, rate, 2.0 ** -np.arange(9, 14), atol=0.03)


def test_a_kept_displacement_turns_the_shear_force_with_its_stiffness():
    """`T = -kt(delta) xi`: slope along a compression with slip; with `force` only `kt xi'`."""
    xi, un, ut, step = 0.01, -0.3, 0.2, 1e-6

    def shear(time):
        kt = mindlin_stiffness(YOUNG, POISSON, 0.7, 0.4, 0.9 + time * un)
        return -kt * (xi + time * ut)

    slope = (shear(step) - shear(-step)) / (2 * step)
    state = contact_state(one_contact(shear=shear(0.0)))
    elastic = np.array([Regime.ELASTIC], dtype=np.int8)
    kept = HertzMindlin(YOUNG, POISSON, MU, shear_history="displacement")
    rate = -(kept.local_stiffness(state, elastic)[0] @ [un, ut])[1]
    assert rate == pytest.approx(slope, rel=1e-9)
    added = -(LAW.local_stiffness(state, elastic)[0] @ [un, ut])[1]
    assert added == pytest.approx(shear(0.0) / xi * ut, rel=1e-12)
    with pytest.raises(InputError, match="force or displacement"):
        HertzMindlin(YOUNG, POISSON, MU, shear_history="slip")


def test_a_law_without_its_tangent_has_the_slope_of_its_force():
    class OfForces(FrictionalLaw):
        def closed_force(self, state):
            return LAW.closed_force(state)

    own = OfForces(kt=0.3, mu=0.5)
    for length in (0.9, 1.09, 1.0999):
        state = contact_state(one_contact(length))
        kn, kt = own.stiffnesses(state)
        # Lengths are rounded: eps over a thousandth of the overlap.
        np.testing.assert_allclose(kn, LAW.normal_stiffness(state), rtol=1e-12 / (1.1 - length))
        assert kt == 0.3
    with pytest.raises(NotImplementedError, match="OfForces"):
        OfForces(mu=0.5).stiffnesses(state)


def test_rigid_turn_only_turns_the_forces():
    graph, _ = hertz_loop(8, order=5, share=0.4)
    tangent = assemble_tangent(graph, LAW, spins=True)
    assert_turns_forces(graph, tangent)


def test_same_tangent_as_linear_springs_of_the_current_stiffness():
    """At an instant the law is the linear one with its kn and kt, whatever the regimes."""
    graph, regime = hertz_loop(11, order=7, share=0.4)
    kn = LAW.normal_stiffness(contact_state(graph))
    linear = LinearFrictional(kn=kn, kt=float(LAW.stiffness_ratio) * kn, mu=MU)
    for closure in ("affine", "traction"):
        one, other = (
            macroscopic_tangent(graph, law, closure, spins="free", regime=regime).matrix
            for law in (LAW, linear)
        )
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-13 * np.abs(other).max())


def test_regimes_without_rates():
    assert regime_of(one_contact()) is Regime.ELASTIC
    normal = hertz_force(YOUNG, POISSON, 0.7, 0.4, 0.9)
    assert regime_of(one_contact(shear=-MU * normal)) is Regime.SLIDING
    assert regime_of(one_contact(shear=0.999 * MU * normal)) is Regime.ELASTIC
    assert regime_of(one_contact(length=1.2)) is Regime.OPEN


def test_slip_must_dissipate_or_the_contact_unloads():
    """The yield function after a small elastic step of the integrated law decides."""
    rng, step, length = np.random.default_rng(3), 1e-7, 0.9
    normal = float(hertz_force(YOUNG, POISSON, 0.7, 0.4, length))
    kt = mindlin_stiffness(YOUNG, POISSON, 0.7, 0.4, length)
    for side in (-1.0, 1.0):
        graph = one_contact(shear=side * MU * normal)
        for un, ut in rng.normal(size=(200, 2)):
            after = hertz_force(YOUNG, POISSON, 0.7, 0.4, length + step * un)
            trial = abs(side * MU * normal - kt * ut * step) - MU * after
            expected = Regime.SLIDING if trial >= 0 else Regime.ELASTIC
            assert regime_of(graph, (un, ut)) is expected


def test_touching_contact_is_soft_and_opens_if_the_branch_lengthens():
    graph = one_contact(length=1.1)
    state = contact_state(graph)
    assert regime_of(graph) is Regime.ELASTIC
    assert not LAW.local_stiffness(state, LAW.regime(state)).any()
    assert regime_of(graph, (1.0, 0.0)) is Regime.OPEN
    assert regime_of(graph, (-1.0, 0.0)) is Regime.ELASTIC


def test_open_contact_carries_nothing():
    state = contact_state(one_contact(length=1.3))
    assert LAW.normal_force(state)[0] == 0.0
    assert not LAW.local_stiffness(state, LAW.regime(state)).any()


def test_touching_loop_is_soft():
    """Hertz's springs start from nothing."""
    for closure in ("affine", "traction"):
        matrix = macroscopic_tangent(regular_polygon(6), LAW, closure).matrix
        assert np.abs(matrix).max() < 1e-15


def test_stiffness_of_a_rounded_snapshot_follows_the_force():
    """An overlap of 1e-6 read from six digits is lost; the force in the table is not."""
    exact = one_contact(length=1.1 - 1e-6)
    rounded = exact.replace(x=[[0, 0], [1.1, 0]])
    stiffness = [LAW.normal_stiffness(contact_state(graph))[0] for graph in (exact, rounded)]
    assert stiffness[0] == stiffness[1] > 0


def test_parameters_are_taken_per_contact():
    law = HertzMindlin(young=[1.0, 2.0, 3.0], poisson=0.2, mu=[0.1, 0.2, 0.3])
    picked = law.take(np.array([[2, 0], [1, 1]]))
    assert picked.young.tolist() == [[3.0, 1.0], [2.0, 2.0]]
    assert picked.poisson.tolist() == 0.2
    assert picked.mu.tolist() == [[0.3, 0.1], [0.2, 0.2]]
    assert HertzMindlin(1.0, 0.2, shear_increment="radii").take(np.array([0])).shear_increment == (
        "radii"
    )


def test_a_batch_is_its_members():
    batch, _ = hertz_loop(13, order=5, size=4)
    tangent = assemble_tangent(batch, LAW, spins=True)
    for k in range(4):
        one = member(batch, k)
        np.testing.assert_allclose(
            tangent[k], assemble_tangent(one, LAW, spins=True), rtol=0, atol=1e-15
        )


def smallest(order, strain, closure, law, spins="blocked"):
    loop = regular_polygon(order, strain=strain)
    loop = loop.replace(normal_force=law.normal_force(contact_state(loop)))
    tangent = macroscopic_tangent(loop, law, closure, spins=spins)
    return symmetric_spectrum(restrict(tangent.matrix, "diagonal"))[0]


@pytest.mark.parametrize("closure", ["affine", "traction"])
@pytest.mark.parametrize("order", [3, 4, 5, 6, 7, 8])
@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.5])
def test_critical_strain(order, closure, poisson):
    """kappa/(kappa + 2/3) for loops that relax, (1 + kappa)/(5/3 + kappa) for those that don't."""
    law, kappa = HertzMindlin(young=1.0, poisson=poisson), 2 * (1 - poisson) / (2 - poisson)
    relaxed = order == 4 or (closure == "traction" and order > 4)
    # Beyond its zero the traction operator has a pole, at the affine one's zero.
    high = 0.65 if relaxed else 0.8
    found = brentq(lambda e: smallest(order, e, closure, law), 0.05, high, xtol=1e-15)
    expected = kappa / (kappa + 2 / 3) if relaxed else (1 + kappa) / (5 / 3 + kappa)
    assert abs(found - expected) < 1e-9
    assert abs(critical_strain(order, kappa, closure, exponent=1.5) - expected) < 1e-13


def test_free_spins():
    """The triangle holds until 3/5; five and more grains roll from the first load."""
    found = brentq(lambda e: smallest(3, e, "traction", LAW, "free"), 0.05, 0.8, xtol=1e-15)
    assert abs(found - 0.6) < 1e-9
    for order in (5, 6, 7, 8):
        assert smallest(order, 1e-4, "traction", LAW, "free") < 0


@pytest.mark.parametrize(
    ("parameters", "word"),
    [
        ({"young": 0.0, "poisson": 0.2}, "young"),
        ({"young": [1.0, np.nan], "poisson": 0.2}, "young"),
        ({"young": 1.0, "poisson": 0.51}, "poisson"),
        ({"young": 1.0, "poisson": -1.0}, "poisson"),
        ({"young": 1.0, "poisson": 0.2, "mu": -0.1}, "mu"),
        ({"young": 1.0, "poisson": 0.2, "shear_increment": "chord"}, "chord"),
    ],
)
def test_bad_parameters_are_named(parameters, word):
    with pytest.raises(InputError, match=word):
        HertzMindlin(**parameters)
