"""Probes integrated to an amplitude: their limit is the rate problem; Yade's own; what is lost."""

import numpy as np
import pytest

from grainloops import probe
from loops import InputError, LinearFrictional, Scene, find_faces
from stability import Programme, Stage, follow
from stability.packing.probe import probe_to
from tests.packings import LAW, jammed


def by_events(graph, **options):
    """What follows stages of the packing, one after the other."""
    scene = Scene(graph, LAW)
    return lambda stages: [follow(scene, one, closure="packing", **options) for one in stages]


@pytest.fixture(scope="module")
def case():
    graph = jammed(16, 2)
    return graph, find_faces(graph)


@pytest.mark.parametrize("control", ["strain", "stress"])
@pytest.mark.parametrize("subspace", ["diagonal", "symmetric"])
def test_small_amplitudes_are_rates(case, control, subspace):
    graph, _faces = case
    rates = probe(Scene(graph, LAW), 6, control=control, subspace=subspace, yield_band=1 - 1e-6)
    found = probe_to(rates, Scene(graph, LAW), 1e-7, by_events(graph))
    assert set(found.status) == {"finished"} and found.determined.all()
    # What is left is the start's imbalance (1e-7 of forces) and curvature (1e-7 of strain).
    for name in ("strain_rate", "stress_rate"):
        one, two = getattr(found, name), getattr(rates, name)
        assert np.allclose(one, two, rtol=0, atol=5e-7 * np.abs(two).max())
    for name in ("work", "normalised", "loop_work"):
        one, two = getattr(found, name), getattr(rates, name)
        assert np.allclose(one, two, rtol=0, atol=3e-6 * np.abs(two).max())
    assert np.array_equal(found.normalised < 0, rates.normalised < 0)
    assert np.array_equal(found.sliding, rates.sliding)


def test_a_row_is_the_path_itself(case):
    graph, _faces = case
    found = probe_to(
        probe(Scene(graph, LAW), [[3.0, -4.0]]), Scene(graph, LAW), 1e-3, by_events(graph)
    )
    strain = Programme("strain", np.zeros((4, 4)), np.eye(4), [0.6, 0, 0, -0.8])
    path = follow(Scene(graph, LAW), Stage(strain, "parameter", 1e-3), closure="packing")
    assert np.allclose(found.strain_rate[0].ravel(), [0.6, 0, 0, -0.8], rtol=0, atol=1e-10)
    assert np.allclose(found.stress_rate[0].ravel(), (path.P[-1] - path.P[0]) / 1e-3, rtol=1e-12)
    assert len(path.events) > 0 and len(found.cones) == 0


def test_what_is_not_finished_is_not_a_number(case):
    graph, _faces = case
    short = by_events(graph, max_steps=2)
    found = probe_to(probe(Scene(graph, LAW), 2), Scene(graph, LAW), 1e-4, short)
    assert set(found.status) == {"lost"} and not found.determined.any()
    for name in ("strain_rate", "stress_rate", "loop_work", "work", "normalised"):
        assert np.isnan(getattr(found, name)).all()
    assert found.softest is None and np.isnan(found.unstable_fraction)


@pytest.mark.parametrize("amplitude", [0.0, -1e-5, np.nan])
def test_amplitudes_are_positive(case, amplitude):
    graph, _faces = case
    with pytest.raises(InputError, match="amplitude: got"):
        probe_to(
            probe(Scene(graph, LAW), 1),
            Scene(graph, LinearFrictional(1.0, 0.5, 0.5)),
            amplitude,
            by_events(graph),
        )
