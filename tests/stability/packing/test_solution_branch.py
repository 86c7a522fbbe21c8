"""Branches of solutions over directions: held to every combination of regimes, tried one by one."""

from collections import Counter
from contextlib import suppress
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from grainloops import hold
from loops import GrainGraph, InputError, LinearFrictional, Scene
from patterns import read_snapshot, sample_path
from stability import follow
from stability.complementarity import (
    STARTS,
    basic_values,
    positive_definite,
    solve_complementarity,
    solve_from,
)
from stability.factor import Factor
from stability.packing import probe, rate_problem
from stability.packing.equations_of_motion import Moving, masses_of, servo_of, step_of
from stability.packing.probe import stage_along
from stability.packing.regime_regions import RegimeRegions
from stability.packing.response import (
    CRITICAL,
    SCALED,
    SOLVED,
    WHOLE_CIRCLE,
)
from stability.solution_branch import TURN, SolutionBranch, trace_branch
from studies.snapshot.in_packing import held_snapshot, sample_edge
from tests.packings import contacts_of, start_state
from tests.stability.packing.test_statuses import AT_YIELD, at_yield, small
from tests.tools import small_packings
from tests.yade_slow import COLLECTION, in_collection, slow


def rates_of(graph, law):
    """Return the rate problem of the contacts at their strength."""
    return rate_problem(Scene(graph, law), yield_band=AT_YIELD)


def unit(angle):
    return np.array([np.cos(angle), np.sin(angle)])


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("M", [[[0.0]], [[0.0, 0.0], [0.0, 1.0]]])
def test_a_branch_is_left_where_slip_changes_no_rate(M):
    """A column of zeros: the contact can neither go on nor turn back."""
    Q = np.column_stack([np.ones(len(M)), np.linspace(0.5, 1.0, len(M))])
    found = trace_branch(Q, np.array(M), 0.0, np.zeros(len(M), dtype=bool))
    assert found.status == "degenerate" and not found.sliding[:, 0].any()
    ends = np.sort(found.angle.ravel())[[0, -1]]
    rates = Q @ np.array([np.cos(ends), np.sin(ends)])
    # It is left where the rate of that contact would turn negative.
    np.testing.assert_allclose(rates[0], 0.0, atol=1e-12)


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


def test_a_contact_without_resistance_to_slip_ends_the_branch_as_degenerate():
    Q, M = np.array([[1.0, 0.0], [0.0, 1.0]]), np.array([[0.0, 1.0], [-1.0, 0.0]])
    branch = trace_branch(Q, M, 0.8, np.zeros(2, dtype=bool))
    assert branch.status == "degenerate"
    # The segment around the start is known all the same.
    assert np.sort(branch.angle.ravel())[[0, -1]] == pytest.approx([0.0, 0.5 * np.pi])


def test_segments_at_an_angle_are_those_that_hold_it_in_any_turn():
    """Segments of a branch that winds, forwards and backwards, over several turns."""
    rng = np.random.default_rng(2)
    ends = rng.uniform(-8.0, 8.0, (40, 1)) + rng.uniform(-5.0, 5.0, (40, 2))
    branch = SolutionBranch(ends, np.zeros((40, 0), bool), "closed")
    for angle in (*rng.uniform(-9.0, 9.0, 60), *ends[:5, 0], *(ends[:5, 1] + 3 * TURN)):
        expected = [
            k
            for k, (low, high) in enumerate(np.sort(ends, axis=1))
            if any(low - 1e-9 <= angle + TURN * turn <= high + 1e-9 for turn in range(-9, 10))
        ]
        assert branch.at(angle).tolist() == expected


def packings(seeds, share=0.4, most=12):
    """Small packings with some contacts at yield, and their laws."""
    for seed in seeds:
        with suppress(InputError):
            graph, law = small(8, seed, share)
            if 1 <= len(at_yield(graph, law)) <= most:
                yield graph, law


def test_the_image_of_the_circle_proves_the_number_of_stress_solutions(monkeypatch):
    # As if contacts were too many to be enumerated; held to the enumeration.
    cases = [
        case
        for case in packings(range(20), share=0.25)
        if positive_definite(rates_of(*case).whole.of_slip)
    ]
    true = [probe(Scene(*case), 24, control="stress", yield_band=AT_YIELD) for case in cases]
    for module in ("complementarity", "packing.regime_regions"):
        monkeypatch.setattr(f"stability.{module}.ENUMERATED", 0)
    proved = 0
    for case, other in zip(cases, true, strict=True):
        rates = rates_of(*case)
        regions = RegimeRegions(rates, "stress", "diagonal", STARTS)
        for k, direction in enumerate(other.directions):
            found = regions.at(direction).response
            if found.proof == WHOLE_CIRCLE:
                assert found.status == other.status[k]
                proved += 1
    assert proved > 50


def test_folds_bound_the_directions_without_a_solution():
    bounded = 0
    for graph, law in packings(range(14)):
        found = probe(Scene(graph, law), 72, yield_band=AT_YIELD)
        before, after = found.between_folds.T
        none = np.isin(found.status, ("none", "none found"))
        assert np.isnan(before[~none]).all()
        if not (found.closed and none.any() and len(found.folds)):
            continue
        # All directions between two folds have none.
        for k in np.flatnonzero(none):
            ahead = np.mod(found.theta - before[k], TURN)
            inside = ahead < np.mod(after[k] - before[k], TURN)
            assert none[inside].all() and inside[k]
            bounded += 1
    assert bounded > 20


def test_listed_solutions_agree_with_the_response_to_all_digits():
    for graph, law in packings(range(4)):
        for control in ("strain", "stress"):
            found = probe(Scene(graph, law), 12, control=control, yield_band=AT_YIELD)
            listed = found.solutions
            first = np.unique(listed.direction, return_index=True)[1]
            assert (listed.direction[first] == np.flatnonzero(found.determined)).all()
            for name in ("strain_rate", "stress_rate"):
                ours = getattr(listed, name)[first]
                np.testing.assert_array_equal(ours, getattr(found, name)[found.determined])
            np.testing.assert_allclose(listed.work[first], found.work[found.determined], rtol=1e-9)


def test_stress_steps_are_those_of_yade():
    # Yade 2023.02a, 2000 discs held to 8e-7, the stress stepped along a direction from one state
    # and held again. Columns: direction (degrees), size (N/m), H11, H22, nominal P11, P22.
    with np.load(Path(__file__).with_name("yade_stress_probes.npz")) as stored:
        yade = dict(stored)
    steps = yade.pop("steps")
    steps = steps[steps[:, 1] == 0.5]
    size = np.hypot(*steps[:, 4:].T)
    graph, law = GrainGraph(**yade), LinearFrictional(1e6, 5e5, 0.5, "radii")
    found = probe(Scene(graph, law), steps[:, 4:], control="stress", yield_band=0.999)
    assert (found.status == "unique").all()
    off, elastic = (
        np.linalg.norm(rate[:, [0, 1], [0, 1]] * size[:, None] - steps[:, 2:4], axis=1)
        / np.linalg.norm(steps[:, 2:4], axis=1)
        for rate in (found.strain_rate, found.elastic_strain)
    )
    # 150 degrees is the softest direction: contacts reach their strength on the way, as of a path.
    soft = steps[:, 0] == 150
    assert off[~soft].max() < 0.01 and off[soft].max() < 0.2
    assert (off < 1.05 * elastic).all() and elastic[~soft].max() > 0.03
    (k,) = np.flatnonzero(soft)
    stage = stage_along(steps[k, 4:] / size[k], "diagonal", "stress", size[k])
    path = follow(Scene(graph, law), stage, closure="packing", rows=1, interval=3e-7)
    strain, wanted = path.H[-1, [0, 3]], steps[k, 2:4]
    assert np.linalg.norm(strain - wanted) < 0.05 * np.linalg.norm(wanted)
    assert len(path.of_kind("yield")) == 65


def compared_packings(count, monkeypatch):
    """Totals over small packings of what probes say against all solutions, by brute force."""
    for module in ("complementarity", "packing.regime_regions"):
        monkeypatch.setattr(f"stability.{module}.ENUMERATED", 0)
    totals, done = Counter(), 0
    for _, graph, law in small_packings.packings(most=10):
        for control in ("strain", "stress"):
            counts = small_packings.compared(graph, law, control)
            totals += counts or Counter()
            done += counts is not None
        if done >= 2 * count:
            return totals


def hold_to_brute_force(totals):
    assert totals["false"] == totals["invented"] == totals["missed on a known branch"] == 0
    assert totals["missed"] <= 0.01 * totals["solutions"]


@pytest.mark.slow
def test_nothing_that_probes_say_of_many_small_packings_is_false(monkeypatch):
    totals = compared_packings(60, monkeypatch)
    hold_to_brute_force(totals)
    assert min(totals[f"said {one}"] for one in ("unique", "one found", "several", "none")) > 50


def nearest_alone(graph, law, control):
    """Answers in three components, each from the nearest answered direction where it can be."""
    rates = rates_of(graph, law)
    regions = RegimeRegions(rates, control, "symmetric", STARTS)
    rng, rows = np.random.default_rng(1), []
    for direction in rng.standard_normal((40, 3)):
        direction /= np.linalg.norm(direction)
        asked = regions.control(direction)
        followed = regions._from_nearest(direction, asked)
        rows.append((asked, regions.at(direction), followed))
    return rates, rows


@pytest.mark.parametrize("control", ["strain", "stress"])
def test_in_three_components_the_nearest_answer_leads_to_the_solution(control):
    """Followed along great circles, against direct solves and all combinations of regimes."""
    followed = several = 0
    for graph, law in packings(range(5), share=0.3, most=8):
        rates, rows = nearest_alone(graph, law, control)
        for asked, direct, there in rows:
            if there is None or there.response.status not in SOLVED:
                continue
            q, M = rates.problem(asked)
            true = [rates.rates_of(asked, one) for one in solve_complementarity(q, M).active]
            H, P = there.response.strain_rate.ravel(), there.response.stress_rate.ravel()
            off = [max(np.abs(H - h).max(), np.abs(P - p).max()) for h, p in true]
            assert min(off) < 1e-12 * max(np.abs(H).max(), np.abs(P).max(), 1.0)
            if len(true) == 1:
                own = direct.response
                size = max(np.abs(H).max(), np.abs(P).max())
                assert np.abs(H - own.strain_rate.ravel()).max() < 1e-12 * size
                assert np.abs(P - own.stress_rate.ravel()).max() < 1e-12 * size
            followed, several = followed + 1, several + (len(true) > 1)
    assert followed > 60


REAL = ("yade-slow 07", "yade-slow 19", "yade-slow 32", "yade-periodic 06", "yade-medium 05")


def at_rest(name):
    """A held state: the sample of the package, or one of the collection, some between walls."""
    if name == "sample":
        return held_snapshot(read_snapshot(sample_path()), "strain")[0]
    folder, number = name.split()
    macro = pd.read_csv(COLLECTION.parent / folder / "macro.csv").set_index("snap").loc[int(number)]
    periodic = "h_xx" in macro
    cell = (
        macro[["h_xx", "h_xy", "h_yx", "h_yy"]].to_numpy(float).reshape(2, 2) if periodic else None
    )
    path = COLLECTION.parent / folder / f"grains_{number}.parquet"
    return held_snapshot(read_snapshot(path, cell=cell), "strain")[0]


@in_collection
@pytest.mark.parametrize("name", ("sample", *REAL))
def test_traced_solutions_of_real_states_are_those_solved_one_by_one(name):
    """Each from its own search and its own factorisation."""
    yielding = sample_edge(at_rest(name), 0.99)
    found, rates = probe(yielding, 24), yielding
    regions = RegimeRegions(rates, "strain", "diagonal", STARTS)
    compared = 0
    for k in np.flatnonzero(found.determined)[::2]:
        H = found.strain_rate[k].ravel()
        q, M = rates.problem(regions.control(found.directions[k]))
        active = solve_from(q, M, rates.none)
        if active is None:
            continue
        P = Factor(yielding.system, yielding.stiffness(active)).tangent @ H
        listed = found.solutions
        own = listed.stress_rate[listed.direction == k].reshape(-1, 4)
        assert np.abs(own - P).max(axis=1).min() < 1e-12 * np.abs(P).max()
        compared += 1
    assert compared >= (12 if found.determined.all() else 4)


@in_collection
def test_a_state_near_failure_has_two_solutions_or_none_proved():
    # 41 directions without a solution, between two folds, 31 with two: one critical contact.
    found = probe(sample_edge(at_rest("yade-slow 35"), 0.99), 72)
    assert Counter(found.status.tolist()) == {"none": 41, "several": 31}
    assert (found.proof == CRITICAL).all()
    assert np.bincount(found.solutions.direction, minlength=72).max() == 2
    assert np.degrees(found.folds) == pytest.approx([107.167, 310.648], abs=2e-3)
    # Between the folds the count is none, and two outside of them.
    inside = (found.theta > found.folds[0]) & (found.theta < found.folds[1])
    assert (inside == (found.status == "none")).all()


@in_collection
@pytest.mark.parametrize(("name", "proof"), [("yade-slow 07", SCALED), ("yade-slow 05", CRITICAL)])
def test_real_states_have_one_solution_in_each_direction_proved(name, proof):
    found = probe(sample_edge(at_rest(name), 0.99), 72)
    assert (found.status == "unique").all() and (found.proof == proof).all()


@in_collection
@pytest.mark.parametrize("number", ("11", "32"))
def test_negative_work_on_the_strain_circle_shows_on_the_stress_circle(number):
    yielding = sample_edge(at_rest(f"yade-slow {number}"), 0.99)
    strain = probe(yielding, 72).solutions
    unstable = strain.normalised < -1e-6
    stress = strain.stress_rate[unstable][:, [0, 1], [0, 1]]
    found = probe(yielding, stress, control="stress").solutions
    assert unstable.any()
    for k, (H, P) in enumerate(zip(strain.strain_rate[unstable], stress, strict=True)):
        wanted = H / np.linalg.norm(P)
        own = found.strain_rate[found.direction == k]
        off = np.abs(own - wanted).max(axis=(1, 2), initial=0.0)
        assert off.min(initial=np.inf) < 1e-9 * np.abs(wanted).max()
        assert found.normalised[found.direction == k].min() < -1e-6


def test_a_branch_found_late_answers_the_directions_before_it_too(monkeypatch):
    for module in ("complementarity", "packing.regime_regions"):
        monkeypatch.setattr(f"stability.{module}.ENUMERATED", 0)
    _, graph, law = next(case for case in small_packings.packings() if case[0] == 39)
    counts = small_packings.compared(graph, law, "strain")
    assert counts["solutions"] == counts["found"] == 26 and counts["false"] == 0


def motions(snapshot, directions, strain=1e-8, steps=20_000, looks=5):
    """Probe of the held state, and its rates of stress and fastest grain in parts of a slow strain.

    Contacts of the yield band are put on their limit, what this leaves out of balance is a load.
    (D, looks, 2, 2) in place of `P'`; (D, looks) speeds over the strain rate, in mean radii.
    """
    held = hold(Scene(snapshot.graph, snapshot.law), unbalanced=1e-8)
    graph, law = held.graph, held.law
    edge = rate_problem(Scene(graph, law), yield_band=0.99)
    found = probe(edge, directions)
    rows, shear = edge.system.contacts[edge.rows], graph.shear_force.copy()
    mu = np.broadcast_to(law.mu, shear.shape)
    shear[rows] = np.sign(shear[rows]) * mu[rows] * graph.normal_force[rows]
    start = contacts_of(start_state(graph.replace(shear_force=shear)), law)
    masses, inertias = masses_of(graph.radii)
    dt, servo = step_of(masses, inertias, start), servo_of(start, masses)
    stresses, speeds = [], []
    for direction in found.directions:
        gradient = -np.diag(direction) * strain / (steps * dt)
        moving = Moving(start, masses, inertias, servo, gradient=gradient)
        moving.load(-moving.motion.resultant)
        for _ in range(looks):
            moving.run(steps // looks, dt)
            stresses.append(moving.state().stress)
            fastest = np.linalg.norm(moving.motion.velocity, axis=1).max()
            speeds.append(fastest * steps * dt / strain / start.mean_radius)
    shape = len(found.directions), looks
    path = np.reshape(stresses, (*shape, 2, 2))
    first = np.broadcast_to(start.stress, (shape[0], 1, 2, 2))
    rates = np.diff(path, axis=1, prepend=first) * looks / strain
    return found, rates, np.reshape(speeds, shape)


@pytest.mark.slow
@pytest.mark.collection
def test_a_state_snaps_where_no_rates_were_found():
    """Strained slowly, it follows the rates that were found; without any, a grain runs away."""
    snapshot, _ = slow(26)
    angles = np.radians([60.0, 300.0, 150.0, 210.0])
    found, rates, speeds = motions(snapshot, np.column_stack([np.cos(angles), np.sin(angles)]))
    assert found.status.tolist() == ["several"] * 2 + ["none found"] * 2
    for k in (0, 1):
        told = np.diag(found.stress_rate[k])
        for rate in rates[k]:
            assert np.linalg.norm(np.diag(rate) - told) < 3e-3 * np.linalg.norm(told)
    assert speeds[:2].max() < 100 < 1e4 < speeds[2:].max(axis=1).min()
