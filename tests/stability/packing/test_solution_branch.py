"""Branches of solutions over directions: held to every combination of regimes, tried one by one."""

from collections import Counter
from contextlib import suppress

import numpy as np
import pytest

from loops import InputError
from stability.packing.complementarity import STARTS, basic_values, solve_from
from stability.packing.regime_regions import RegimeRegions
from stability.packing.response import HELD_STUCK, PackingRates
from stability.packing.solution_branch import TURN, trace_branch
from stability.packing.yield_response import yield_response
from tests.stability.packing.test_statuses import AT_YIELD, at_yield, small


def unit(angle):
    return np.array([np.cos(angle), np.sin(angle)])


def every_solution(Q, M, angle):
    """Slips of all solutions, by enumeration of the sets of sliding contacts."""
    q, found = Q @ unit(angle), []
    for number in range(2 ** len(q)):
        sliding = (number >> np.arange(len(q)) & 1).astype(bool)
        values = basic_values(q, M, sliding)
        if np.isfinite(values).all() and (values >= -1e-10).all():
            found.append(np.where(sliding, values, 0.0))
    return found


def slip(Q, M, branch, segment, angle):
    """Slips `z` of a branch's segment at an angle."""
    sliding = branch.sliding[segment]
    return np.where(sliding, basic_values(Q @ unit(angle), M, sliding) if M.size else 0.0, 0.0)


def violation(Q, M, z, angle):
    """Largest wrong sign or product of a pair, over the size of the slip."""
    w = Q @ unit(angle) + M @ z
    size = max(1.0, np.abs(z).max())
    return max(-min(z.min(), w.min()) / size, np.abs(w * z).max() / size**2)


def problem(rng, m, scatter):
    return rng.standard_normal((m, 2)), scatter * rng.standard_normal((m, m)) + np.eye(m)


def branches_from(Q, M, angle):
    return [trace_branch(Q, M, angle, z > 0) for z in every_solution(Q, M, angle)]


@pytest.mark.parametrize("scatter", [0.3, 0.6, 1.0])
def test_branches_hold_every_solution_and_nothing_else(scatter):
    rng, several, folded, none = np.random.default_rng(7), 0, 0, 0
    for _ in range(25):
        Q, M = problem(rng, int(rng.integers(1, 6)), scatter)
        branches = [b for a in TURN * np.arange(6) / 6 for b in branches_from(Q, M, a)]
        assert all(branch.status == "closed" for branch in branches)
        folded += any(len(branch.folds) for branch in branches)
        for angle in rng.uniform(0, TURN, 8):
            true = every_solution(Q, M, angle)
            traced = [slip(Q, M, b, s, angle) for b in branches for s in b.at(angle)]
            several, none = several + (len(true) > 1), none + (len(true) == 0)
            for one, other in ((traced, true), (true, traced)):
                for z in one:
                    assert any(np.abs(z - t).max() <= 1e-9 * (1 + np.abs(z).max()) for t in other)
    assert scatter < 1 or (several > 20 and folded > 5 and none > 5)


def test_a_branch_that_folds_has_two_solutions_on_one_side_and_none_on_the_other():
    # One contact that softens as it slips: w = h1 - z. It sticks or slides where h1 > 0.
    Q, M = np.array([[1.0, 0.0]]), np.array([[-1.0]])
    branch = trace_branch(Q, M, 0.0, np.array([False]))
    assert branch.status == "closed" and branch.winding == 0
    assert sorted(branch.folds) == pytest.approx([0.5 * np.pi, 1.5 * np.pi])
    assert len(branch.at(0.3)) == 2 and len(branch.at(3.0)) == 0
    assert sorted(slip(Q, M, branch, s, 0.3)[0] for s in branch.at(0.3)) == pytest.approx(
        [0, np.cos(0.3)]
    )


def test_without_contacts_at_yield_one_segment_covers_the_circle():
    branch = trace_branch(np.empty((0, 2)), np.empty((0, 0)), 1.0, np.empty(0, dtype=bool))
    assert branch.winding == 1 and len(branch.folds) == 0
    assert branch.at(0.0).tolist() == branch.at(6.0).tolist() == [0]


def test_many_contacts_keep_all_digits():
    # More exchanges than the transform is kept for.
    rng, m = np.random.default_rng(3), 200
    Q, M = rng.standard_normal((m, 2)), 0.5 * rng.standard_normal((m, m)) / np.sqrt(m) + np.eye(m)
    start = solve_from(Q @ unit(0.4), M, np.zeros(m, dtype=bool))
    branch = trace_branch(Q, M, 0.4, start)
    assert branch.status == "closed" and branch.winding == 1
    assert len(branch.angle) > 2 * m
    for angle in rng.uniform(0, TURN, 20):
        for s in branch.at(angle):
            assert violation(Q, M, slip(Q, M, branch, s, angle), angle) < 1e-12


def test_contacts_that_change_together_are_told_apart():
    rng, closed = np.random.default_rng(5), 0
    for _ in range(20):
        # Two mirrored halves of a packing: contacts come in equal pairs.
        m = int(rng.integers(1, 4))
        one, other = 0.5 * rng.standard_normal((2, m, m)) + np.eye(m) * [[[1.0]], [[0.0]]]
        Q, M = np.tile(rng.standard_normal((m, 2)), (2, 1)), np.block([[one, other], [other, one]])
        branches = [trace_branch(Q, M, 1.0, z > 0, most=500) for z in every_solution(Q, M, 1.0)]
        closed += sum(branch.status == "closed" for branch in branches)
        for branch in branches:
            for angle in rng.uniform(0, TURN, 5):
                for s in branch.at(angle):
                    assert violation(Q, M, slip(Q, M, branch, s, angle), angle) < 1e-9
    assert closed >= 20


def test_a_contact_without_resistance_to_slip_ends_the_branch_as_degenerate():
    Q, M = np.array([[1.0, 0.0], [0.0, 1.0]]), np.array([[0.0, 1.0], [-1.0, 0.0]])
    branch = trace_branch(Q, M, 0.8, np.zeros(2, dtype=bool))
    assert branch.status == "degenerate"
    # The segment around the start is known all the same.
    assert np.sort(branch.angle.ravel())[[0, -1]] == pytest.approx([0.0, 0.5 * np.pi])


def answers(graph, law):
    """Status, proof and number of solutions in 24 directions of strain."""
    rates = PackingRates(yield_response(graph, law, yield_band=AT_YIELD))
    regions = RegimeRegions(rates, "strain", "diagonal", STARTS)
    found = [regions.at(unit(TURN * k / 24)).response for k in range(24)]
    return [(one.status, one.proof, one.solutions) for one in found]


def test_probes_know_the_solutions_that_every_combination_of_regimes_has(monkeypatch):
    # As if contacts were too many to be enumerated: what is said then is held to the enumeration.
    cases = []
    for seed in range(14):
        with suppress(InputError):
            graph, law = small(8, seed, 0.4)
            if 1 <= len(at_yield(graph, law)) <= 12:
                cases.append((graph, law))
    true = [one for graph, law in cases for one in answers(graph, law)]
    for module in ("complementarity", "regime_regions"):
        monkeypatch.setattr(f"stability.packing.{module}.ENUMERATED", 0)
    found = [one for graph, law in cases for one in answers(graph, law)]
    said, missed = Counter(), 0
    for (status, proof, count), (other, other_proof, number) in zip(true, found, strict=True):
        if proof == "enumeration" and other_proof != HELD_STUCK:
            said[status, other] += 1
            # Nothing false: no solution too many.
            assert number <= count
            missed += number < count
    assert ("several", "unique") not in said and ("unique", "none") not in said
    assert missed <= 2
    assert said["several", "several"] > 20 and said["unique", "one found"] > 20
