"""What stands against a single answer along a path, against another assembly of the matrix."""

import numpy as np
import pytest

from loops import Scene
from stability import Stage, follow
from stability.complementarity import solve_complementarity
from stability.packing import path as room
from stability.packing.path import columns
from stability.packing.response import component_control, rate_problem
from tests.oracles.minors import principal_minors
from tests.packings import LAW, jammed, packing

NAN = np.nan


def path_of(grains=24, seed=3, law=LAW, rows=8, to=2e-3, pathologies=True):
    stage = Stage("drained_biaxial", "parameter", to)
    scene = Scene(jammed(grains, seed), law)
    return follow(scene, stage, rows=rows, interval=2e-5, pathologies=pathologies)


@pytest.fixture(scope="module")
def path():
    found = path_of()
    assert found.status == "finished"
    return found


def at_limit(seed):
    """Return a path of one short interval from a state with many contacts at their limit."""
    graph = packing(16, seed, sliding=0.3)
    stage = Stage("drained_biaxial", "parameter", 1e-9)
    return follow(Scene(graph, LAW), stage, interval=1e-9, pathologies=True)


def watched(monkeypatch):
    """Return a list to which every problem that is judged adds `q`, `M` and the answer."""
    judge, seen = room._judged, []

    def judged(q, M, w2, *errors):
        found = judge(q, M, w2, *errors)
        seen.append((q, M, found))
        return found

    monkeypatch.setattr(room, "_judged", judged)
    return seen


def by_rates(graph, sliding):
    """`q`, `M` of the rate problem, assembled and condensed elsewhere, under the same control."""
    regime = np.where(sliding, 2, 1).astype(np.int8)
    found = rate_problem(Scene(graph.replace(regime=regime), LAW), yield_band=1 - 1e-6)
    return found.problem(component_control([[1, 0], [0, NAN]]))


@pytest.mark.parametrize("seed", [1, 2])
def test_matrix_is_that_of_the_rate_problem(seed, monkeypatch):
    """At the start, where nominal stresses are those of this state; free of rows' scales."""
    seen = watched(monkeypatch)
    state = at_limit(seed).states[0]
    q, M, _ = seen[0]
    sliding = np.abs(state.shear_force) >= (1 - 1e-6) * 0.5 * state.normal_force
    other_q, other = by_rates(state.graph(), sliding[state.closed])
    assert len(M) > 2 and M.shape == other.shape
    ours, theirs = (one * one.T / np.outer(np.diag(one), np.diag(one)) for one in (M, other))
    np.testing.assert_allclose(ours, theirs, rtol=1e-5, atol=1e-7)
    assert (np.sign(q) == np.sign(other_q)).all()


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_answers_are_those_of_brute_force(seed, monkeypatch):
    seen = watched(monkeypatch)
    at_limit(seed)
    for q, M, found in seen:
        assert found.candidates == len(q)
        assert found.p_matrix == bool((principal_minors(M) > 0).all())
        assert found.definite == bool(np.linalg.eigvalsh(M + M.T)[0] > 0)
        assert found.solutions == len(solve_complementarity(q, M, enumerated=len(q)).active)
        assert found.proved == (found.p_matrix or len(q) <= 12)


def test_symmetric_with_one_candidate_and_not_with_two(path):
    counts = {one.candidates: one.symmetric for one in path.pathologies}
    assert max(counts) > 2 and min(counts) < 2 and all(counts[m] == (m < 2) for m in counts)


def test_looking_changes_nothing():
    with_it, without = path_of(), path_of(pathologies=False)
    assert not without.pathologies and len(with_it.pathologies) == len(with_it)
    assert (with_it.P == without.P).all() and (with_it.H == without.H).all()
    assert [e.kind for e in with_it.events] == [e.kind for e in without.events]


def test_second_order_work_is_that_of_the_path(path):
    """Against the change of stress from row to row, where no contact changes its regime."""
    fine = path_of(rows=50)
    at = np.array([event.parameter for event in fine.events])
    for k in range(1, 49):
        left, right = fine.parameter[[k, k + 1]]
        if not ((at > left - 1e-5) & (at < right + 1e-5)).any():
            H, P = (values[k + 1] - values[k] for values in (fine.H, fine.P))
            w2 = (P @ H) / np.linalg.norm(P) / np.linalg.norm(H)
            assert fine.pathologies[k].w2 == pytest.approx(w2, abs=2e-3)
            break
    else:
        pytest.fail("no interval without an event")


def test_what_is_withheld_says_why(monkeypatch):
    monkeypatch.setattr(room, "FEW_CANDIDATES", 2)
    monkeypatch.setattr(room, "has_definite_scaling", lambda M: False)
    monkeypatch.setattr(room, "positive_definite", lambda M: False)
    (found, *_) = at_limit(1).pathologies
    assert found.candidates > 1 and found.p_matrix is None and found.solutions == -1
    assert found.withheld == f"{found.candidates} candidates, fewer than 2 wanted for the minors"
    monkeypatch.setattr(room, "MOST_CANDIDATES", 1)
    (found, *_) = at_limit(1).pathologies
    assert np.isnan(found.asymmetry) and found.symmetric is None and np.isfinite(found.w2)
    table = columns((found, replace_none(found)))
    assert np.isnan(table["p_matrix"][0]) and table["p_matrix"][1] == 1.0
    assert table["withheld"][0] == f"{found.candidates} candidates, 1 at most"


def replace_none(found):
    return found._replace(p_matrix=True)
