"""Random loops in balance: forces against the functions of single loops, and their ranks."""

import numpy as np
import pandas as pd
import pytest

from loops import (
    GrainGraph,
    LinearFrictional,
    boundary_vectors,
    love_weber_stress,
    traction_tangent,
)
from stability import judge
from studies.examples import loop_ensembles, save
from studies.examples.loop_ensembles import measures, random_loops, ranked

LAW = LinearFrictional(1.0, 0.5, 0.5)


@pytest.fixture(scope="module", params=[3, 5, 8])
def loops(request):
    rng = np.random.default_rng(request.param)
    return random_loops(rng, request.param, 180, LAW, polydispersity=0.2)


def test_random_loops_balance_a_uniform_stress(loops):
    graph, stress = loops, love_weber_stress(loops)
    d = np.roll(graph.x, -1, axis=1) - graph.x
    n = d / np.linalg.norm(d, axis=-1, keepdims=True)
    t = np.stack([-n[..., 1], n[..., 0]], axis=-1)
    f = graph.normal_force[..., None] * n + graph.shear_force[..., None] * t
    # Contact c pushes grain c + 1 by f, grain c by -f; the stress loads grain i by -P B_i.
    load = -np.einsum("lij,lgj->lgi", stress, boundary_vectors(graph.x))
    resultant = np.roll(f, 1, axis=1) - f + load
    size = np.abs(f).max()
    np.testing.assert_allclose(resultant, 0.0, atol=1e-14 * graph.grain_count * size)
    mean = np.trace(stress, axis1=1, axis2=2) / 2.0
    np.testing.assert_allclose(stress[:, [0, 1], [1, 0]], 0.0, atol=1e-14 * size * len(d[0]))
    share = (stress[:, 0, 0] - stress[:, 1, 1]) / (2.0 * mean)
    assert (share >= 0.0).all() and (share <= 0.6 + 1e-12).all() and share.max() > 0.5


def test_random_loops_keep_the_contact_law(loops):
    N, T = loops.normal_force, np.abs(loops.shear_force)
    assert (N > 0.0).all() and (T < 0.5 * N).all() and (T > 0.4 * N).any()
    touching = loops.radii + np.roll(loops.radii, -1, axis=1)
    length = np.linalg.norm(np.roll(loops.x, -1, axis=1) - loops.x, axis=-1)
    np.testing.assert_allclose(length, touching, rtol=1e-13)
    np.testing.assert_allclose(N.mean(axis=1), 1e-3, rtol=1e-13)


def test_measures_are_those_of_single_loops(loops):
    found = measures(loops, LAW, 1.0)
    for k in (0, 7, 29):
        N, T = loops.normal_force[k], loops.shear_force[k]
        one = GrainGraph(loops.x[k], loops.radii[k], loops.contacts, normal_force=N, shear_force=T)
        tangent = traction_tangent(one, LAW).matrix
        verdict = judge(tangent, "symmetric")
        assert found["lambda_min"][k] == pytest.approx(verdict.lambda_min, abs=1e-13)


def test_loops_of_the_ensemble_itself_have_uniform_ranks():
    rng = np.random.default_rng(5)
    draws = [random_loops(rng, 5, count, LAW, polydispersity=0.2) for count in (3000, 300)]
    random, real = (measures(graph, LAW, 1.0) for graph in draws)
    rank = ranked(real, random)["rank"].dropna()
    # Mean of uniform ranks: standard error 1/sqrt(12 n).
    assert len(rank) > 100 and abs(rank.mean() - 0.5) < 4.0 / np.sqrt(12 * len(rank))
    shifted = ranked(real.assign(lambda_min=real.lambda_min - 0.5), random)["rank"].dropna()
    assert shifted.mean() < 0.2


def test_an_example_writes_its_figure_its_table_and_its_numbers(tmp_path):
    orders = {"order": [3, 4], "rank": [0.5, 0.4], "rank_high": [0.6, 0.5]}
    table = pd.DataFrame(orders)
    save(tmp_path, "loop_ensembles", loop_ensembles.draw(table), {"random": 2}, table)
    names = {path.name for path in tmp_path.iterdir()}
    files = {f"loop_ensembles.{ending}" for ending in ("png", "parquet", "csv")}
    assert names == {*files, "summary.json"}


@pytest.mark.slow
def test_the_study_writes_its_results(tmp_path):
    numbers = loop_ensembles.main(tmp_path / "out", batches=1)
    assert 5000 < numbers["random"] < 36000 and numbers["real"] > 200
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"loop_ensembles.png", "loop_ensembles.parquet", "summary.json"} <= names
