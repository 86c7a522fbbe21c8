"""Every event carries the state at its own place, whatever the rows of the path are."""

from functools import cache
from typing import get_args, get_type_hints

import numpy as np
import pytest

from loops import LinearFrictional
from patterns import diamond, regular_polygon
from stability import Event, Stage, follow, programmes
from tests.stability.paths.whole_paths import asked_of, scene_of

LAW = LinearFrictional(kn=1.0, kt=0.2, mu=np.tan(np.radians(5.0)))
PLAIN = LinearFrictional(kn=1.0, kt=0.1)


def isotropic(E):
    return Stage(programmes.isotropic_strain(), "H11", E)


def drained(E, rate=1.0):
    return Stage(programmes.drained_biaxial(rate=rate), "H11", E)


def oedometric(E, rate=1.0):
    return Stage(programmes.oedometric(rate=rate), "H11", E)


def twisted_pentagon():
    """Pentagon whose contacts all carry the same shear force: its shear moduli are complex."""
    return regular_polygon(5, strain=0.1).replace(shear_force=np.full(5, 0.1))


CASES = {
    "reversal": (diamond(np.pi / 4), LAW, [isotropic(0.3), drained(0.45), drained(0.44, -1)], {}),
    "contacts open": (regular_polygon(4), LAW, [isotropic(0.1), oedometric(-0.2, -1),
                                                oedometric(0.05)], {}),
    "grains touch": (diamond(np.radians(35)), LAW, [isotropic(0.3)], {"closure": "traction"}),
    "flutter": (twisted_pentagon(), PLAIN, [isotropic(0.56)], {"subspace": "symmetric"}),
    "limit": (diamond(np.radians(20)), LinearFrictional(1.0, 0.2),
              [isotropic(0.18), Stage(programmes.proportional_stress(-1, 0), "P11", -0.5)], {}),
    "branching": (regular_polygon(6), LinearFrictional(1.0, 0.237, np.tan(np.radians(11.8))),
                  [isotropic(0.046), drained(0.2)], {"closure": "traction"}),
}  # fmt: skip


@cache
def followed(case, rows):
    graph, law, stages, options = CASES[case]
    return follow(scene_of(graph, law, options), stages, rows=rows, **asked_of(options))


def test_the_cases_hold_every_kind_of_event_of_a_loop():
    found = {event.kind for case in CASES for event in followed(case, 0).events}
    assert found == {*get_args(get_type_hints(Event)["kind"])} - {"instability"}


@pytest.mark.parametrize("case", CASES)
def test_events_do_not_depend_on_the_rows(case):
    every_step = followed(case, 0)
    for rows in (3, 60):
        path = followed(case, rows)
        assert len(path) != len(every_step)
        assert len(path.events) == len(every_step.events)
        for event, other in zip(path.events, every_step.events, strict=True):
            assert (event.kind, event.contacts) == (other.kind, other.contacts)
            assert event.parameter == pytest.approx(other.parameter, abs=1e-14)
            np.testing.assert_allclose(event.H, other.H, rtol=0, atol=1e-14)
            np.testing.assert_allclose(event.P, other.P, rtol=0, atol=1e-14)


@pytest.mark.parametrize("case", CASES)
def test_a_path_that_ends_at_an_event_ends_in_the_state_of_the_event(case):
    graph, law, stages, options = CASES[case]
    places = {(event.stage, event.H): event for event in followed(case, 0).events}
    for (stage, H), event in places.items():
        ends_there = Stage(stages[stage].programme, "H11", H[0])
        path = follow(
            scene_of(graph, law, options),
            [*stages[:stage], ends_there],
            rows=3,
            **asked_of(options),
        )
        assert path.status == "finished"
        assert path.parameter[-1] == pytest.approx(event.parameter, abs=1e-11)
        np.testing.assert_allclose(path.H[-1], H, rtol=0, atol=1e-11)
        np.testing.assert_allclose(path.P[-1], event.P, rtol=0, atol=1e-11)


def test_flutter_is_where_the_shear_modulus_of_a_ring_vanishes():
    # Affine isotropic strain: the material part (1 + kappa)(1 - E) meets the geometric part E.
    path = followed("flutter", 0)
    (event,) = path.of_kind("flutter")
    assert event.H[0] == pytest.approx(1.1 / 2.1, abs=1e-12)
