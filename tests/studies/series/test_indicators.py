"""`grainloops series --indicators`: columns, predictors, their signs, and what a restart knows."""

import os
from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pandas as pd
import pytest

from grainloops import indicators
from loops import Scene, branch_vectors
from patterns import write_snapshot
from stability.packing.loop_quantities import EXPECTED
from studies.examples import indicators as benchmark
from studies.reading import plan_series, reading
from studies.series.packing import indicator_columns
from studies.series.skill import INDICATORS
from studies.series.tasks import Extras, Series
from tests.packings import packing
from tests.studies.series.test_packing import tracked
from tests.studies.series.test_run import run

# A small value is expected to be unstable.
SMALL = {"coordination", "slip_criticality", "opening_criticality", "density", "chain"}


@pytest.fixture(scope="module")
def states():
    """A packing of 30 grains in a skewed cell: grains move, forces change, contacts are lost."""
    graph, rng = packing(30, seed=9), np.random.default_rng(1)
    found = [tracked(graph)]
    for _ in range(2):
        kept = np.sort(rng.permutation(graph.contact_count)[2:])
        F = np.diag([1.0003, 0.9994])
        x = graph.x @ F + 2e-3 * rng.standard_normal(graph.x.shape)
        force = graph.normal_force * rng.uniform(0.9, 1.1, graph.contact_count)
        graph = graph.__class__(
            x, graph.radii, graph.contacts[kept], images=graph.images[kept],
            cell=F @ graph.cell,
            normal_force=force[kept], shear_force=graph.shear_force[kept],
        )  # fmt: skip
        found.append(tracked(graph))
    return found


@pytest.fixture(scope="module")
def paths(states, tmp_path_factory):
    folder = tmp_path_factory.mktemp("snapshots")
    files = [folder / f"grains_{k}.parquet" for k in range(len(states))]
    for path, state in zip(files, states, strict=True):
        write_snapshot(path, state)
    return files


@pytest.fixture(scope="module")
def result(paths, tmp_path_factory):
    out = tmp_path_factory.mktemp("results") / "series"
    return out, run(paths, out, indicators=True)


def part(result, dataset, k):
    return pd.read_parquet(result[0] / dataset / f"part-0000{k}-0000{k + 1}.parquet")


def loop_grains(faces):
    """Grains of each loop."""
    parts = pairwise(faces.offsets)
    every = [faces.grains[a:b] for a, b in parts]
    return [every[face] for face in faces.loops]


def d2min(first, second):
    """D2min of the grains by the contacts at the first state: a least-squares problem for each."""
    moved = first.replace(x=second.x, cell=second.cell)
    d, end = branch_vectors(first), branch_vectors(moved)
    out = np.full(first.grain_count, np.nan)
    for grain in range(first.grain_count):
        own = (first.contacts == grain).any(axis=1)
        if own.sum() > 2:
            best, *_ = np.linalg.lstsq(d[own], end[own], rcond=None)
            out[grain] = np.sum((end[own] - d[own] @ best) ** 2) / own.sum()
    return out / first.radii.mean() ** 2


def test_columns_are_the_indicators_of_the_earlier_snapshot(states, result):
    """The past of the first interval is unknown; of the second it is the motion before."""
    for k, before in enumerate(states[:2]):
        columns = part(result, "packing", k)
        found = indicators(
            Scene(before.graph.replace(regime=before.regime), before.law), before.faces
        )
        for name, values in found.items():
            given = columns[f"indicator_{name}"].to_numpy()
            np.testing.assert_allclose(given, values, rtol=1e-7, atol=1e-9, err_msg=name)
    assert part(result, "packing", 0)["indicator_past_nonaffinity"].isna().all()
    past = d2min(states[0].graph, states[1].graph)
    wanted = [np.nanmean(past[grains]) for grains in loop_grains(states[1].faces)]
    given = part(result, "packing", 1)["indicator_past_nonaffinity"]
    np.testing.assert_allclose(given, wanted, rtol=1e-7)


def test_grains_are_known_by_their_ids(states):
    """Another order of the grains later is another order of the loops alone."""
    start, after = states[:2]
    order = np.random.default_rng(2).permutation(30)
    graph = after.graph
    turned = graph.__class__(
        graph.x[order], graph.radii[order], np.argsort(order)[graph.contacts], images=graph.images,
        cell=graph.cell, normal_force=graph.normal_force, shear_force=graph.shear_force,
    )  # fmt: skip
    other = replace(after, graph=turned, ids=order)
    found = indicator_columns(other, start)["indicator_past_nonaffinity"]
    past = d2min(start.graph, graph)
    wanted = [np.nanmean(past[order[grains]]) for grains in loop_grains(other.faces)]
    np.testing.assert_allclose(found, wanted, rtol=1e-8)


def test_predictors_have_the_sign_that_is_expected(result):
    """AUC of each by counting pairs; base rate, rate problem and trivial predictors beside."""
    out, summary = result
    skill = pd.read_parquet(out / "skill.parquet").set_index(
        ["snapshot_before", "target", "predictor"]
    )
    assert {name for name, sign in EXPECTED.items() if sign < 0} == SMALL
    columns, own = part(result, "packing", 1), part(result, "increments", 1)
    actual = np.full(len(columns), np.nan)
    actual[own.loop_before] = own.w2
    lost = np.where(columns.contact_lost, -1.0, 1.0)
    for target, value in (("W2_negative", actual), ("contact_lost", lost)):
        for name, column in INDICATORS.items():
            score = columns[column].to_numpy() * (-1 if name in SMALL else 1)
            known = np.isfinite(score)
            with np.errstate(invalid="ignore"):
                there, beside = score[known & (value < 0)], score[known & (value > 0)]
            pairs = product(there, beside)
            auc = np.mean([1.0 if a > b else 0.5 if a == b else 0.0 for a, b in pairs])
            row = skill.loc[(1, target, name)]
            assert row.auc == pytest.approx(auc, rel=1e-12), name
            assert row.base == skill.loc[(1, target, "packing")].base > 0
    assert skill.loc[(0, "W2_negative", "past_nonaffinity")].loops == 0
    assert set(EXPECTED) < set(summary["skill"])


def test_a_packing_that_floats_has_no_indicators():
    graph = packing(24, seed=3)
    across = graph.images.any(axis=1)
    alone = graph.__class__(
        graph.x, graph.radii, graph.contacts[~across], images=graph.images[~across], cell=graph.cell
    )
    columns = indicator_columns(tracked(alone), None)
    assert tuple(columns) == tuple(INDICATORS.values())
    assert all(np.isnan(values).all() for values in columns.values())


def test_a_restart_knows_the_snapshot_before(paths, tmp_path):
    """An interval with indicators depends on three snapshots, one without them on two."""

    def fingerprints(asked):
        planned = plan_series(paths, None, reading())
        series = Series(planned, tmp_path, Extras(candidates=0.99, indicators=asked))
        return [task.fingerprint for task in series.intervals]

    plain, asked = fingerprints(False), fingerprints(True)
    os.utime(paths[0], ns=(0, 0))
    changed, with_past = fingerprints(False), fingerprints(True)
    assert [a == b for a, b in zip(plain, changed, strict=True)] == [False, True]
    assert [a == b for a, b in zip(asked, with_past, strict=True)] == [False, False]
    assert not set(plain) & set(asked)


def test_scores_of_a_series_are_those_of_its_table(result):
    """By `skill.parquet`; shuffled targets keep the base rate and lose the AUC."""
    out, _ = result
    found = benchmark.scores(out)
    known = pd.read_parquet(out / "skill.parquet")
    keys = ["snapshot_after", "target", "predictor"]
    both = found.merge(known, on=keys)
    assert len(both) == len(found) == (known.predictor.isin(benchmark.COMPARED)).sum()
    for name in ("auc", "base", "coverage"):
        np.testing.assert_array_equal(both[f"{name}_x"], both[f"{name}_y"])
    # The cell is strained by (-3e-4, 6e-4): the second is the larger compression.
    assert set(found.step) == {6e-4}


@pytest.mark.slow
def test_shuffled_targets_are_chance(result):
    """Ninety-five in a hundred 95 % intervals contain one half."""
    many = pd.concat(benchmark.scores(result[0], seed) for seed in range(30))
    inside = []
    for _, rows in many.groupby(["snapshot_after", "target", "predictor"]):
        low, high = benchmark.interval(rows.shuffled)[1:]
        if np.isfinite(low) and rows.shuffled.std() > 0:
            inside.append(low <= 0.5 <= high)
    assert len(inside) > 100 and 0.85 < np.mean(inside) <= 1.0
