"""Random loops in balance: forces against the functions of single loops, and their ranks."""

import numpy as np
import pandas as pd
import pytest

from loops import (
    GrainGraph,
    LinearFrictional,
    Regime,
    boundary_vectors,
    love_weber_stress,
    traction_tangent,
)
from stability import judge, restrict, symmetric_spectrum, unstable_fraction
from studies.examples import loop_ensembles
from studies.examples.loop_ensembles import measures, random_loops, ranked

LAW = LinearFrictional(1.0, 0.5, 0.5)


@pytest.fixture(scope="module", params=[3, 5, 8])
def loops(request):
    rng = np.random.default_rng(request.param)
    return random_loops(rng, request.param, 30, np.array([0.4, 0.5, 0.6]), LAW, 1e-3, 0.5)


def test_random_loops_balance_a_uniform_stress(loops):
    graph = loops.graph
    d = np.roll(graph.x, -1, axis=1) - graph.x
    n = d / np.linalg.norm(d, axis=-1, keepdims=True)
    t = np.stack([-n[..., 1], n[..., 0]], axis=-1)
    f = graph.normal_force[..., None] * n + graph.shear_force[..., None] * t
    # Contact c pushes grain c + 1 by f, grain c by -f; the stress loads grain i by -P B_i.
    load = -np.einsum("lij,lgj->lgi", loops.stress, boundary_vectors(graph.x))
    resultant = np.roll(f, 1, axis=1) - f + load
    size = np.abs(f).max()
    np.testing.assert_allclose(resultant, 0.0, atol=1e-8 * size)
    np.testing.assert_allclose(love_weber_stress(graph), loops.stress, atol=1e-8 * size)
    assert (loops.stress[:, 0, 1] == loops.stress[:, 1, 0]).all()


def test_random_loops_keep_the_contact_law(loops):
    graph = loops.graph
    N, T = graph.normal_force, np.abs(graph.shear_force)
    slides = graph.regime == Regime.SLIDING
    assert (N > 0.0).all() and (T <= 0.5 * N * (1 + 1e-9)).all()
    np.testing.assert_allclose(T[slides], 0.5 * N[slides], rtol=1e-9)
    assert (T[~slides] < 0.5 * N[~slides] * (1 - 1e-9)).all()
    assert set(np.unique(loops.sliding)) == {0, 1, 2}
    length = np.linalg.norm(np.roll(graph.x, -1, axis=1) - graph.x, axis=-1)
    overlap = graph.radii + np.roll(graph.radii, -1, axis=1) - length
    np.testing.assert_allclose(overlap, N, rtol=0, atol=1e-10)
    assert 3e-4 < overlap.mean() < 3e-3


def test_measures_are_those_of_single_loops(loops):
    many = loops.graph
    found = measures(many, LAW, 1.0, 0.5)
    for k in (0, 7, 29):
        N, T = many.normal_force[k], many.shear_force[k]
        one = GrainGraph(many.x[k], many.radii[k], many.contacts, normal_force=N, shear_force=T)
        tangent = traction_tangent(one, LAW, regime=many.regime[k]).matrix
        verdict = judge(tangent, "symmetric")
        assert found["lambda_min"][k] == pytest.approx(verdict.lambda_min, abs=1e-13)
        values = symmetric_spectrum(restrict(tangent, "symmetric"))
        assert found["unstable"][k] == pytest.approx(unstable_fraction(values), abs=1e-13)


def test_loops_of_the_ensemble_itself_have_uniform_ranks():
    rng = np.random.default_rng(5)
    radii = np.array([0.4, 0.5, 0.6])
    draws = [random_loops(rng, 5, count, radii, LAW, 1e-3, 0.5) for count in (3000, 300)]
    parts = [pd.DataFrame(measures(draw.graph, LAW, 1.0, 0.5)) for draw in draws]
    random, real = (part.assign(order=5) for part in parts)
    rank = ranked(real, random).rank_lambda.dropna()
    # Mean of uniform ranks: standard error 1/sqrt(12 n).
    assert len(rank) > 100 and abs(rank.mean() - 0.5) < 4.0 / np.sqrt(12 * len(rank))
    shifted = ranked(real.assign(lambda_min=real.lambda_min - 0.5), random).rank_lambda.dropna()
    assert shifted.mean() < 0.2


@pytest.mark.slow
def test_the_study_writes_its_results(tmp_path):
    numbers = loop_ensembles.main(tmp_path / "out", loops=8000)
    assert numbers["random"] == 8000 and numbers["real"] > 200
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"loop_ensembles.png", "loop_ensembles.parquet", "summary.json"} <= names
