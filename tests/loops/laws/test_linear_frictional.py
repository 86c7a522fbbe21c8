import numpy as np
import pytest

from loops import (
    ContactLaw,
    GrainGraph,
    InputError,
    LinearFrictional,
    Regime,
    contact_state,
    translational_blocks,
)


def one_contact(angle=0.0, length=0.9, normal=0.1, shear=0.0, radii=(0.5, 0.5)):
    return GrainGraph(
        x=[[0, 0], [length * np.cos(angle), length * np.sin(angle)]],
        radii=radii,
        contacts=[[0, 1]],
        normal_force=[normal],
        shear_force=[shear],
    )


def regime_of(law, graph, rates=None):
    return Regime(int(law.regime(contact_state(graph), rates)[0]))


def rates(un, ut):
    return np.array([un]), np.array([ut])


def test_law_meets_the_protocol():
    assert isinstance(LinearFrictional(kn=1.0, kt=0.5), ContactLaw)


def test_elastic_block_of_the_theory():
    graph = one_contact(angle=0.7, length=0.8, normal=0.2, shear=0.03)
    law, state = LinearFrictional(kn=2.0, kt=0.6), contact_state(graph)
    n, t = state.n[0], state.t[0]
    expected = (
        2.0 * np.outer(n, n) + (0.6 - 0.2 / 0.8) * np.outer(t, t) + 0.03 / 0.8 * np.outer(n, t)
    )
    block = translational_blocks(state, law, law.regime(state))[0]
    np.testing.assert_allclose(block, expected, rtol=0, atol=4e-16)


@pytest.mark.parametrize("sign", [-1, 1])
def test_sliding_block_of_the_theory(sign):
    mu = 0.4
    graph = one_contact(angle=-1.1, length=0.8, normal=0.2, shear=sign * mu * 0.2)
    law, state = LinearFrictional(kn=2.0, kt=0.6, mu=mu), contact_state(graph)
    n, t = state.n[0], state.t[0]
    expected = (
        2.0 * np.outer(n, n)
        + sign * mu * 2.0 * np.outer(t, n)
        - 0.25 * np.outer(t, t)
        + sign * mu * 0.25 * np.outer(n, t)
    )
    assert regime_of(law, graph) is Regime.SLIDING
    block = translational_blocks(state, law, law.regime(state))[0]
    np.testing.assert_allclose(block, expected, rtol=0, atol=4e-16)


def test_open_contact_has_no_stiffness():
    graph = one_contact(length=1.1, normal=0.0)
    law, state = LinearFrictional(kn=1.0, kt=0.5), contact_state(graph)
    assert regime_of(law, graph) is Regime.OPEN
    assert not translational_blocks(state, law, law.regime(state)).any()
    assert law.normal_force(state)[0] == 0.0


def test_regimes_without_rates():
    law = LinearFrictional(kn=1.0, kt=0.5, mu=0.5)
    assert regime_of(law, one_contact()) is Regime.ELASTIC
    assert regime_of(law, one_contact(shear=0.0499)) is Regime.ELASTIC
    assert regime_of(law, one_contact(shear=-0.05)) is Regime.SLIDING
    assert regime_of(law, one_contact(length=1.0, normal=0.0)) is Regime.ELASTIC
    never = LinearFrictional(kn=1.0, kt=0.5)
    assert regime_of(never, one_contact(shear=1e6)) is Regime.ELASTIC


def test_slip_must_dissipate_or_the_contact_unloads():
    # Work of friction on the slip, computed here from the elastic predictor.
    mu, kn, kt = 0.5, 1.0, 0.5
    law = LinearFrictional(kn=kn, kt=kt, mu=mu)
    rng = np.random.default_rng(3)
    for side in (-1.0, 1.0):
        graph = one_contact(shear=side * mu * 0.1)
        for un, ut in rng.normal(size=(200, 2)):
            trial = abs(side * mu * 0.1 - kt * ut * 1e-6) - mu * (0.1 - kn * un * 1e-6)
            expected = Regime.SLIDING if trial >= 0 else Regime.ELASTIC
            assert regime_of(law, graph, rates(un, ut)) is expected


def test_touching_contact_opens_only_if_the_branch_lengthens():
    law, graph = LinearFrictional(kn=1.0, kt=0.5, mu=0.5), one_contact(length=1.0, normal=0.0)
    assert regime_of(law, graph, rates(+1.0, 0.0)) is Regime.OPEN
    assert regime_of(law, graph, rates(-1.0, 0.0)) is Regime.ELASTIC


def test_without_friction_every_loaded_contact_slides_and_carries_no_shear():
    law, graph = LinearFrictional(kn=1.0, kt=0.5, mu=0.0), one_contact()
    assert regime_of(law, graph) is Regime.SLIDING
    assert regime_of(law, graph, rates(0.3, -0.4)) is Regime.SLIDING
    state = contact_state(graph)
    assert law.local_stiffness(state, law.regime(state))[0].tolist() == [[1.0, 0.0], [0.0, 0.0]]


@pytest.mark.parametrize("rule", ["branch", "radii"])
def test_shear_increment_is_objective(rule):
    # A rigid turn of the pair, grains included, gives ut' = g l - (b_i + b_j) = 0.
    state = contact_state(one_contact(radii=(0.7, 0.4)))
    g, b_i, b_j = LinearFrictional(kn=1.0, kt=0.5, shear_increment=rule).shear_kinematics(state)
    np.testing.assert_allclose(g * state.length, b_i + b_j, rtol=4e-16)
    expected = 1.0 if rule == "branch" else 1.1 / 0.9
    np.testing.assert_allclose(g, expected, rtol=4e-16)


def test_parameters_are_taken_per_contact():
    law = LinearFrictional(kn=[1.0, 2.0, 3.0], kt=0.5, mu=[0.1, 0.2, 0.3])
    picked = law.take(np.array([[2, 0], [1, 1]]))
    assert picked.kn.tolist() == [[3.0, 1.0], [2.0, 2.0]]
    assert picked.kt.tolist() == 0.5
    assert picked.mu.tolist() == [[0.3, 0.1], [0.2, 0.2]]


@pytest.mark.parametrize(
    ("parameters", "word"),
    [
        ({"kn": 0.0, "kt": 0.5}, "kn"),
        ({"kn": np.nan, "kt": 0.5}, "kn"),
        ({"kn": 1.0, "kt": -0.5}, "kt"),
        ({"kn": 1.0, "kt": [0.5, np.inf]}, "kt"),
        ({"kn": 1.0, "kt": 0.5, "mu": -0.1}, "mu"),
        ({"kn": 1.0, "kt": 0.5, "mu": np.nan}, "mu"),
        ({"kn": 1.0, "kt": 0.5, "shear_increment": "chord"}, "chord"),
    ],
)
def test_bad_parameters_are_named(parameters, word):
    with pytest.raises(InputError, match=word):
        LinearFrictional(**parameters)
