"""Limits and tolerances of paths: what lies on either side of them."""

from dataclasses import replace

import numpy as np
import pytest

from loops import InputError, LinearFrictional, Regime, Scene, contact_state
from patterns import diamond, regular_polygon
from stability import Stage, follow, programmes, rates_at
from stability.paths.model import path_model
from stability.paths.path_segment import eigenvalue_kind, event_functions
from stability.paths.regimes import keeps_control
from stability.paths.ring_rates import VALUES
from stability.paths.state import Mode, initial_state, pack, pairs_in_reach, unpack
from stability.paths.state_rates import UNIT_PARAMETER, Answers, StateRates

LAW = LinearFrictional(kn=1.0, kt=0.2, mu=0.3)


def isotropic(E):
    return Stage(programmes.isotropic_strain(), "H11", E)


def elastic_state(graph, law=LAW, closure="traction"):
    """The state of a graph whose contacts all stick, under isotropic strain."""
    model = path_model(graph, contact_state(graph), law, closure, "blocked", None)
    mode = Mode(
        np.full(graph.contact_count, Regime.ELASTIC, dtype=np.int8), np.zeros(len(model.mu))
    )
    state = unpack(model, initial_state(model, contact_state(graph)))
    return StateRates(model, state, mode, programmes.isotropic_strain(), UNIT_PARAMETER)


def balance_of(here):
    """The number whose sign changes where other paths branch off, as a segment is answered."""
    about = here.model, here.mode
    stage = Stage(here.programme, "H11", 0.1)
    functions = event_functions(*about, stage, 0.0, 1.0, 1.0, ("diagonal",))
    answers, state = Answers(*about, here.programme, functions), here.state
    y = pack(state.place, state.shear_force, state.parameter, state.work)
    answers.p.shared[0, : len(y)], answers.p.shared[1, :5] = y, here.gauge
    answers.reply(VALUES)
    return answers.p.shared[2, len(functions.watch)]


@pytest.mark.parametrize("order", [60, 61])
def test_long_loops_are_not_searched_for_branching(order):
    graph = regular_polygon(order, strain=0.05)
    number = balance_of(elastic_state(graph))
    assert np.isfinite(number) == (order <= 60)


@pytest.mark.parametrize(("off", "refused"), [(5e-10, False), (2e-9, True)])
def test_forces_that_do_not_fit_the_overlaps_are_refused(off, refused):
    confined = regular_polygon(4, strain=0.1)
    beyond = confined.replace(shear_force=np.array([0.03 + off, 0.0, 0.0, 0.0]))
    pressed = confined.replace(normal_force=confined.normal_force + off)
    for graph, name in ((pressed, "normal force"), (beyond, "shear force")):
        if refused:
            with pytest.raises(InputError, match=f"{name} of contact 0"):
                rates_at(Scene(graph, LAW), programmes.isotropic_strain(), closure="affine")
        else:
            assert (
                rates_at(Scene(graph, LAW), programmes.isotropic_strain(), closure="affine").status
                == "unique"
            )


@pytest.mark.parametrize(("gap", "touches"), [(0.0, True), (1e-15, True), (1e-14, False)])
def test_grains_whose_gap_is_rounding_touch(gap, touches):
    graph = regular_polygon(4)
    apart = graph.replace(x=graph.x * (1 + gap), x0=graph.x0 * (1 + gap))
    overlap = path_model(apart, contact_state(apart), LAW, "affine", "blocked", None).overlap0
    assert (overlap == 0.0).all() == touches


@pytest.mark.parametrize(("imaginary", "kind"), [(3e-8, "det_K_zero"), (3e-7, "flutter")])
def test_an_eigenvalue_is_real_within_the_rounding_of_a_double_one(imaginary, kind):
    # Rounding splits a double eigenvalue by its root, 1e-8.
    A = np.diag([1.0, 0.0, 0.0, 0.0])
    A[0, 3], A[3, 0], A[0, 0] = -imaginary, imaginary, 0.0
    A[1, 1] = A[2, 2] = 1.0
    norm = np.linalg.norm(A)
    assert eigenvalue_kind(A * norm, "full", 0) == kind


@pytest.mark.parametrize(("gap", "watched"), [(0.05, 1), (0.15, 0)])
def test_pairs_of_grains_are_watched_when_they_come_near(gap, watched):
    # Opposite grains of a flat diamond, (1, 3), over r_i + r_j = 1.
    graph = diamond(np.arcsin(0.5 * (1.0 + gap)))
    model = path_model(graph, contact_state(graph), LAW, "affine", "blocked", None)
    assert len(pairs_in_reach(model, graph.x)) == watched


@pytest.mark.parametrize(("off", "kept"), [(5e-13, 8), (5e-12, 4)])
def test_a_control_keeps_a_symmetry_within_rounding(off, kept):
    turns = np.linspace(0.0, 2 * np.pi, 5)[:4]
    c, s = np.cos(turns), np.sin(turns)
    rotations = np.moveaxis(np.array([[c, -s], [s, c]]), -1, 0)
    mirrors = rotations @ np.diag([1.0, -1.0])
    control = programmes.proportional_strain(1.0, 1.0 + off)
    assert keeps_control(control, np.concatenate([rotations, mirrors])).sum() == kept


@pytest.mark.parametrize("closure", ["affine", "traction"])
@pytest.mark.parametrize("end", [1e-9, 1e-16])
def test_stages_of_any_length_end_at_their_target(end, closure):
    path = follow(Scene(regular_polygon(5), LAW), isotropic(end), closure=closure)
    assert (path.status, len(path.events)) == ("finished", 0)
    assert path.H[-1, [0, 3]] == pytest.approx([end, end], rel=1e-13, abs=0)
    assert path.normal_force[-1] == pytest.approx(np.full(5, end), rel=1e-13, abs=0)


@pytest.mark.parametrize(("shear", "torn"), [(5e-10, False), (2e-9, True)])
def test_a_shear_force_that_a_parting_contact_may_drop(shear, torn):
    # Isotropic strain turns no branch: the shear force stays until the contacts open.
    start = diamond(np.pi / 4, E1=0.01, E2=0.01, T=shear)
    stage = Stage(programmes.isotropic_strain(-1.0), "H11", -0.01)
    path = follow(Scene(start, LinearFrictional(1.0, 0.2)), stage, closure="traction")
    assert ("part while they carry a force" in path.message) == torn
    assert path.H[-1, 0] == pytest.approx(0.0 if torn else -0.01, abs=1e-12)


@pytest.mark.parametrize(("shear", "events"), [(1e-13, 1), (1.2e-11, 2)])
def test_contacts_that_yield_within_rounding_yield_at_once(shear, events):
    confined = diamond(np.pi / 4, E1=0.3, E2=0.3)
    disturbed = confined.replace(shear_force=shear * np.array([1.0, 0.0, 0.0, 0.0]))
    law = LinearFrictional(kn=1.0, kt=0.2, mu=np.tan(np.radians(5.0)))
    path = follow(
        Scene(disturbed, law), Stage(programmes.drained_biaxial(), "H11", 0.42), closure="affine"
    )
    assert len(path.of_kind("yield")) == events


@pytest.mark.parametrize(("short", "events"), [(3e-13, 2), (1e-9, 0)])
def test_a_stage_that_ends_within_rounding_of_an_event_meets_it(short, events):
    # det K and det Ks of the square vanish at kappa/(1 + kappa).
    path = follow(Scene(diamond(np.pi / 4), LAW), isotropic(1 / 6 - short), closure="affine")
    assert len(path.of_kind("det_K_zero") + path.of_kind("det_Ks_zero")) == events


@pytest.mark.parametrize("speed", [1e-3, 1.0, 50.0])
@pytest.mark.parametrize("closure", ["affine", "traction"])
@pytest.mark.parametrize("gauge", [UNIT_PARAMETER, np.array([0.3, 0.0, 0.0, -1.0, 0.5])])
def test_the_gauge_fixes_the_unit_of_time(speed, closure, gauge):
    """Its product with the rates of strain and load is one, whatever the programme's speed."""
    strain = np.array([1.0, 0.0, 0.0, 0.4])
    programme = programmes.combination(np.zeros((4, 4)), np.eye(4), speed * strain)
    state = elastic_state(diamond(0.8), closure=closure)
    rates = replace(state, programme=programme, gauge=gauge).raw_rates
    assert gauge @ np.append(rates.H, rates.parameter) == pytest.approx(1.0, rel=1e-12)
    np.testing.assert_allclose(rates.H, rates.parameter * speed * strain, rtol=1e-10, atol=1e-12)
