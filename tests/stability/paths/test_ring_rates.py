"""Rates of a loop as a segment asks for them against those of its balance by numpy alone."""

from dataclasses import replace

import numpy as np
import pytest

from loops import (
    CohesiveFrictional,
    HertzMindlin,
    LinearFrictional,
    Regime,
    RollingResistance,
    Scene,
    contact_state,
)
from patterns import random_loop, regular_polygon
from stability import Stage, follow, programmes
from stability.paths import ring_rates
from stability.paths.model import path_model
from stability.paths.path_segment import event_functions
from stability.paths.regimes import path_symmetry
from stability.paths.state import Mode, initial_state
from stability.paths.state_rates import UNIT_PARAMETER, Answers, StateRates
from tests.oracles.path_rates import PlainRates
from tests.stability.paths.whole_paths import irregular

LAWS = {
    "branch": LinearFrictional(1.3, 0.4, 0.3),
    "radii": LinearFrictional(1.3, 0.4, 0.3, "radii"),
    "soft": LinearFrictional(1.3, 1e-3, 0.3),
    "hertz": HertzMindlin(1.0, 0.3, mu=0.3),
    "by displacement": HertzMindlin(1.0, 0.3, mu=0.3, shear_history="displacement"),
    "cohesive": CohesiveFrictional(1.3, 0.4, 0.3, adhesion=0.01),
    "bonded": CohesiveFrictional(1.3, 0.4, 0.3, adhesion=0.01, cohesion=0.02, bonded=True),
}
SHEAR = programmes.combination(np.zeros((4, 4)), np.eye(4), [0.4, 1.0, 0.2, 0.1], "shear")
STAGE = Stage(SHEAR, "H12", 0.3)
MORE_LAWS = ("radii", "soft", "by displacement", "bonded")
PROGRAMMES = (SHEAR, programmes.cauchy_drained(), programmes.undrained(axis=2))
E, S, O = Regime.ELASTIC, Regime.SLIDING, Regime.OPEN  # noqa: E741
REGIMES = {"stick": [], "slides": [(1, S, 1.0)], "two": [(1, S, 1.0), (3, S, -1.0)],
           "opens": [(2, O, 0.0), (1, S, 1.0)]}  # fmt: skip


class OwnLaw(LinearFrictional):
    """A law of one's own, whatever it does."""


class OwnSpheres(HertzMindlin):
    """Spheres of a law of one's own, whose shear forces go with the overlap."""


OWN = OwnLaw(1.3, 0.4, 0.3)
OTHER_LAWS = {
    "own": OWN,
    "own spheres": OwnSpheres(1.0, 0.3, mu=0.3, shear_history="displacement"),
    "rolling": RollingResistance(LAWS["branch"], k_r=0.1),
}


class OwnProgramme(programmes.Programme):
    """A programme whose equations may be anything."""


def states(graph, law, closure, spins, changed, programme, symmetric=False):
    """The same state as paths know it and by numpy alone."""
    contacts = contact_state(graph)
    model = path_model(graph, contacts, law, closure, spins, None)
    n, y = graph.contact_count, initial_state(model, contacts)
    mode = Mode(np.full(n, E, dtype=np.int8), np.zeros(n))
    for c, regime, side in changed:
        mode.regime[c], mode.side[c] = regime, side
    if symmetric:
        here = StateRates(model, y, mode, programme, UNIT_PARAMETER)
        model = replace(model, symmetry=path_symmetry(here, [programme]))
    about = model, y, mode, programme, UNIT_PARAMETER
    return StateRates(*about), PlainRates(*about)


def lopsided(n, law, seed=None):
    """A loop of unequal grains with shear forces of either sign."""
    graph = random_loop(n, n if seed is None else seed, polydispersity=0.3, strain=0.02)
    N = law.normal_force(contact_state(graph))
    return graph.replace(normal_force=N, shear_force=0.1 * N * np.cos(np.arange(n)))


def compare(found, wanted, atol):
    """Rates to a share of the motion of the contacts, times the stiffness where they are forces."""
    np.testing.assert_allclose(found.H, wanted.H, rtol=0, atol=1e-16)
    np.testing.assert_allclose(found.P, wanted.P, rtol=1e-14, atol=1e-16 * found.model.stiffness)
    rates, others = found.raw_rates, wanted.raw_rates
    assert rates.trusted == others.trusted
    if not others.trusted:
        # Moments that nothing balances leave a residual: no rates.
        functions = event_functions(found.model, found.mode, STAGE, 0.0, 1.0, 1.0, ("diagonal",))
        assert np.isnan(answered(found, ring_rates.RATES, functions)[: len(wanted.y_rates)]).all()
        return
    size = max(np.abs(others.motion[:, :2]).max(), np.abs(others.ut).max())
    force = size * found.model.stiffness
    for name, scale in (
        ("H", np.abs(others.H).max()), ("P", force / found.model.length), ("un", size),
        ("ut", size), ("normal_force", force), ("shear_force", force),
        ("motion", np.abs(others.motion).max()), ("parameter", others.parameter),
    ):  # fmt: skip
        one, other = getattr(rates, name), getattr(others, name)
        np.testing.assert_allclose(one, other, rtol=0, atol=atol * scale, err_msg=name)
    np.testing.assert_allclose(found.A, wanted.A, rtol=0, atol=atol * np.abs(wanted.A).max())
    stage = Stage(found.programme, "P11", 0.3)
    about = 0.1, -1.0, 0.7, ("diagonal", "symmetric", "full")
    functions = event_functions(found.model, found.mode, stage, *about)
    count, y_rates = len(functions.watch), wanted.y_rates
    asked = answered(found, ring_rates.RATES, functions)[: len(y_rates)]
    np.testing.assert_allclose(asked, y_rates, rtol=atol, atol=atol)
    values = answered(found, ring_rates.VALUES, functions)[: count + 1]
    expected = np.append(wanted.values(stage, *about), wanted.balance_determinant)
    # The equations differ, and so does the size of their determinant.
    np.testing.assert_allclose(values[:-1], expected[:-1], rtol=1e3 * atol, atol=1e3 * atol)
    assert np.isnan(values[-1]) == np.isnan(expected[-1])


def answered(here, what, functions):
    """What a segment is answered in a state."""
    answers = Answers(here.model, here.mode, here.programme, functions)
    p = answers.p
    p.shared[0, : len(here.y)], p.shared[1, :5] = here.y, here.gauge
    answers.reply(what)
    return p.shared[2]


@pytest.mark.parametrize("spins", ["blocked", "affine", "free"])
@pytest.mark.parametrize("closure", ["affine", "traction"])
@pytest.mark.parametrize(
    "law",
    [pytest.param(name, marks=[pytest.mark.slow] * (name in MORE_LAWS)) for name in LAWS],
)
def test_rates_are_those_of_the_balance(law, closure, spins):
    """Under free spins of even rings the balance by numpy keeps some digits less."""
    for n in (4, 5):
        graph = lopsided(n, LAWS[law])
        for regimes in REGIMES if spins != "free" else ["stick"]:
            for programme in PROGRAMMES:
                pair = states(graph, LAWS[law], closure, spins, REGIMES[regimes], programme)
                compare(*pair, 1e-10 if spins == "free" else 1e-12)


@pytest.mark.parametrize("spins", ["blocked", "affine", "free"])
@pytest.mark.parametrize("closure", ["affine", "traction"])
@pytest.mark.parametrize("order", [3, 4, 5, 6])
def test_rates_of_symmetric_states_are_those_of_the_balance(order, closure, spins):
    law = LAWS["branch"]
    graph = regular_polygon(order, strain=0.05)
    graph = graph.replace(normal_force=law.normal_force(contact_state(graph)))
    for programme in (programmes.isotropic_strain(), programmes.drained_biaxial(), SHEAR):
        compare(*states(graph, law, closure, spins, [], programme, symmetric=True), 1e-12)


@pytest.mark.parametrize(
    ("law", "spins", "regimes"),
    [("own", "free", "stick"), ("own", "affine", "opens"), ("own spheres", "blocked", "two"),
     ("rolling", "affine", "two"),
     ("rolling", "free", "stick"), ("branch", "free", "opens"), ("radii", "free", "two")],
)  # fmt: skip
@pytest.mark.parametrize("closure", ["affine", "traction"])
def test_rates_under_other_laws_and_of_spins_that_roll_along(law, closure, spins, regimes):
    """Forces of a law of one's own are given to the kernels; numpy solves what they do not."""
    one = (LAWS | OTHER_LAWS)[law]
    graph = lopsided(5, one)
    for programme in PROGRAMMES:
        compare(*states(graph, one, closure, spins, REGIMES[regimes], programme), 1e-12)


@pytest.mark.parametrize(
    ("order", "closure", "spins", "programme", "target"),
    [pytest.param(4, "traction", "free", SHEAR, ("H12", 0.05), marks=pytest.mark.slow),
     (6, "affine", "free", SHEAR, ("H12", 0.05)),
     (6, "traction", "blocked", programmes.drained_biaxial(), ("H11", 0.09))],
)  # fmt: skip
def test_a_law_of_ones_own_follows_the_path_of_its_formulae(
    order, closure, spins, programme, target
):
    """Also where grains of an even loop nearly roll on one another, up to a mechanism."""
    graph, stage = lopsided(order, LAWS["branch"], seed=3), Stage(programme, *target)
    how = {"closure": closure, "spins": spins}
    found, wanted = (follow(Scene(graph, law), stage, **how) for law in (OWN, LAWS["branch"]))
    assert found.status == wanted.status and len(wanted.events) > 0
    assert [(e.kind, e.contacts) for e in found.events] == [
        (e.kind, e.contacts) for e in wanted.events
    ]
    for one, other in zip(found.events, wanted.events, strict=True):
        np.testing.assert_allclose(one.H, other.H, rtol=0, atol=1e-13)


@pytest.mark.parametrize("spins", ["blocked", "affine", "free"])
@pytest.mark.parametrize("closure", ["affine", "traction"])
def test_rates_of_a_loop_with_a_chord(closure, spins):
    graph, law = irregular(chord=True)
    for programme in PROGRAMMES:
        for regimes in ("stick", "opens") if spins != "free" else ("stick",):
            compare(*states(graph, law, closure, spins, REGIMES[regimes], programme), 1e-12)


def test_a_programme_of_ones_own_says_what_it_controls_in_each_state():
    graph, law = lopsided(5, LAWS["branch"]), LAWS["branch"]
    plain = programmes.undrained(axis=2)
    pair = [
        states(graph, law, "traction", "blocked", REGIMES["two"], one)[0]
        for one in (plain, OwnProgramme(**vars(plain)))
    ]
    np.testing.assert_allclose(*(here.raw_rates.P for here in pair), rtol=1e-14)
    assert OwnProgramme(**vars(plain)).equations(pair[0].H, pair[0].P)[1][3].any()


def test_kernels_alone_serve_rings_of_known_laws_under_known_programmes():
    graph, law, free = lopsided(5, LAWS["branch"]), LAWS["branch"], [(1, S, 1.0)]
    own = OwnProgramme("own", SHEAR.stress, SHEAR.strain, SHEAR.rate)
    rolling = RollingResistance(law, k_r=0.1)
    for one, spins, changed, programme, served in (
        (law, "blocked", [], SHEAR, True), (OWN, "blocked", [], SHEAR, False),
        (rolling, "blocked", [], SHEAR, False), (law, "blocked", [], own, False),
        (law, "free", [], SHEAR, True), (law, "free", free, SHEAR, False),
    ):  # fmt: skip
        here, _ = states(graph, one, "traction", spins, changed, programme)
        assert Answers(here.model, here.mode, programme).compiled == served
