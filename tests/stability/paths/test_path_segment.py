"""Parts of a path's segment: event functions in any units, first crossings, roots, branchings."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from loops import GrainGraph, LinearFrictional, Regime, contact_state
from patterns import random_loop
from stability import Stage, programmes
from stability.paths.model import path_model
from stability.paths.path_segment import (
    SAMPLES,
    Segment,
    _branchings,
    _right_hand_side,
    _root,
    _Step,
    eigenvalue_kind,
    event_functions,
    first_crossing,
    pair_overlaps,
)
from stability.paths.state import Mode, initial_state, scales, unpack
from stability.paths.state_rates import UNIT_PARAMETER, StateRates


def start_of(programme, length=1.0, kn=1.0, closure="traction", regimes=()):
    """Model, regimes and state of a lopsided loop whose grains overlap by .01 of their distance."""
    loop = random_loop(5, 3, polydispersity=0.3)
    law = LinearFrictional(kn, 0.3 * kn, 0.2)
    graph = GrainGraph(x=length * loop.x, radii=1.01 * length * loop.radii, contacts=loop.contacts)
    shear = 1e-3 * kn * length * np.array([1.0, -0.5, 0.2, 0.0, 1.5])
    graph = graph.replace(normal_force=law.normal_force(contact_state(graph)), shear_force=shear)
    model = path_model(graph, contact_state(graph), law, closure, "blocked", None)
    mode = Mode(np.full(5, Regime.ELASTIC, dtype=np.int8), np.zeros(5))
    for c, (regime, side) in enumerate(regimes):
        mode.regime[c], mode.side[c] = regime, side
    y = initial_state(model, contact_state(graph))
    return model, mode, y, StateRates(model, unpack(model, y), mode, programme, UNIT_PARAMETER)


REGIMES = [(Regime.SLIDING, 1.0), (Regime.OPEN, 0.0)]
LOADS = {
    "strain": lambda size: programmes.proportional_strain(0.8 * size, 0.6 * size),
    "stress": lambda size: programmes.proportional_stress(0.8 * size, 0.6 * size),
}


@pytest.mark.parametrize("load", LOADS)
def test_event_functions_are_numbers_without_units(load):
    """Forces and gaps are over a size of the strains; rates do not know it, nor how fast it is."""
    stage = Stage(LOADS[load](1.0), "H11", 0.1)

    def values(stage, size, **units):
        model, mode, _, here = start_of(stage.programme, regimes=REGIMES, **units)
        found = event_functions(model, mode, stage, 0.0, 1.0, size, ("diagonal",))
        return model, found, found.values(here)

    model, functions, plain = values(stage, 1.0)
    kinds = np.array(functions.kinds)
    assert set(kinds) >= {"yield", "unloading", "opening", "closing", "control_limit"}
    assert (functions.items[-3:] == -1).all() and (np.abs(plain[:-1]) > 1e-6).all()
    overlap = model.overlap0 / model.touching
    np.testing.assert_allclose(plain[kinds == "opening"], -overlap[[0, 2, 3, 4]], rtol=1e-9)
    np.testing.assert_allclose(plain[kinds == "closing"], overlap[1], rtol=1e-9)
    beyond = 1e-3 * np.array([0.2, 0.0, 1.5]) - 0.2 * model.overlap0[[2, 3, 4]]
    np.testing.assert_allclose(plain[kinds == "yield"], beyond / model.length, rtol=1e-9)
    _, _, other = values(stage, 1.0, length=2.0**-9, kn=2.0**30)
    np.testing.assert_allclose(other, plain, rtol=1e-9, atol=1e-12)
    _, _, halved = values(stage, 0.5)
    sized = np.isin(kinds, ("yield", "opening", "closing"))
    np.testing.assert_allclose(halved, np.where(sized, 2.0, 1.0) * plain, rtol=1e-9)
    _, _, fast = values(Stage(LOADS[load](8.0), "H11", 0.1), 1.0)
    np.testing.assert_allclose(fast, plain, rtol=1e-9)


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e9])
def test_a_pair_of_eigenvalues_is_real_within_a_share_of_the_operator(size):
    """`1 +- i e` in the plane of H11, H22: a tenth of the share, and ten times it."""
    for e, kind in ((1e-8, "det_K_zero"), (1e-6, "flutter")):
        A = size * np.diag([1.0, 2.0, 2.0, 1.0])
        A[0, 3], A[3, 0] = size * e, -size * e
        assert eigenvalue_kind(A, "diagonal", 0) == kind
    assert eigenvalue_kind(np.nan * A, "diagonal", 0) == "det_K_zero"


def at_of(function):
    return lambda theta: SimpleNamespace(balance_determinant=function(theta), theta=theta)


@pytest.mark.parametrize(("until", "count"), [(1.0, 2), (0.5, 1), (0.05, 0)])
def test_branchings_are_the_changes_of_sign_before_an_event(until, count):
    at = at_of(lambda theta: (theta - 0.1) * (theta - 0.6) * (theta + 2.0))
    samples = [at(theta) for theta in SAMPLES]
    found = [place.theta for place in _branchings(SimpleNamespace(at=at), samples, until)]
    np.testing.assert_allclose(found, [0.1, 0.6][:count], rtol=0, atol=1e-12)
    at = at_of(lambda theta: -1.0 - theta)
    assert not _branchings(SimpleNamespace(at=at), [at(theta) for theta in SAMPLES], until)


def test_a_root_that_no_bracket_holds_is_found_by_halving():
    """No number before .3, negative up to .6."""
    found = _root(lambda theta: np.array([np.nan if theta < 0.3 else theta - 0.6]), 0, 0.0, 1.0)
    assert found == pytest.approx(0.6, rel=0, abs=1e-15)


def lines(slopes, roots, calls):
    """Functions `slope (theta - root)`, their table at the samples, and a record of the calls."""

    def values(theta):
        calls.append(theta)
        return slopes * (theta - roots)

    return slopes * (SAMPLES[:, None] - roots), values


def test_the_likeliest_function_is_tried_first():
    """Of straight lines the first root is known at once, whatever their slopes."""
    for slopes in ([1.0, 1.0, 1.0], [50.0, 1.0, 1e-3], [1e-3, 1.0, 50.0]):
        calls = []
        table, values = lines(np.array(slopes), np.array([0.7, 0.4, 0.3]), calls)
        place, which = first_crossing(table, SAMPLES, np.full(3, 1e-12), values)
        assert which == 2 and place == pytest.approx(0.3, abs=1e-14)
        assert len(calls) <= 5


def test_a_function_that_starts_at_its_event_has_it_there():
    """By rounding it is above zero at the second sample, and rises."""
    calls = []
    table, values = lines(np.array([1.0, 1.0]), np.array([0.25 - 1e-14, 0.9]), calls)
    assert first_crossing(table, SAMPLES, np.full(2, 1e-12), values) == (0.25, 0)
    assert calls == []


def step_of(closure="traction"):
    """A segment's step that is too long for its tolerance."""
    programme = programmes.proportional_strain(0.8, 0.6)
    model, mode, y, _ = start_of(programme, closure=closure)
    stage = Stage(programme, "H11", 0.4)
    functions = event_functions(model, mode, stage, 0.0, 1.0, 1.0, ("diagonal",))
    segment = Segment(model, mode, stage, functions, 1e-12, 1e-14 * scales(model), 1.0, np.inf, 1.0)
    return _Step(segment, 0.0, y, 0.4, y, None, UNIT_PARAMETER)


def test_a_part_of_a_step_is_integrated_in_as_many_steps_as_it_takes():
    step = step_of()
    found = step.integrate(0.5)

    def rates(t, y):
        return _right_hand_side(step.segment, UNIT_PARAMETER, t, y)

    exact = solve_ivp(rates, (0.0, 0.2), step.y_begin, "RK45", rtol=1e-10, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-8)
    assert np.abs(found - step.y_begin).max() > 0.01
    assert step.integrate(0.0) is step.y_begin


def test_functions_without_a_side_yet_have_no_event():
    """Signs are 1, -1 and, of a function that has not left zero, 0."""
    step, pairs = step_of(), np.array([[0, 2]])
    functions = step.segment.functions
    signs = np.resize([1.0, -1.0, 0.0], len(functions.kinds) + 1)
    here = step.at(1.0)
    wanted = (
        np.append(functions.values(here), pair_overlaps(step.segment.model, pairs, here.x)) * signs
    )
    np.testing.assert_array_equal(step.signed_values(pairs, signs, 1.0), wanted)
