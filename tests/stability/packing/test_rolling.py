"""Springs against rolling in replays, paths and held packings: closed forms, lattices, halving."""

from itertools import pairwise

import numpy as np
import pytest

from grainloops import hold, replay
from loops import (
    GrainGraph,
    InputError,
    LinearFrictional,
    RollingResistance,
    Scene,
    branch_vectors,
)
from stability import Stage, follow, programmes
from tests.packings import LAW, jammed, strained
from tests.stability.packing.test_one_engine import INTERVALS, KAGOME, STRAIN, followed

KR, N, RADII = 0.03, 0.02, (0.5, 0.4)
H = np.array([[2e-3, 2e-4], [0.0, -2e-3]])


def pair(w):
    """Two heavy discs pressed together, of small moments of inertia, in counter-rotation."""
    distance = sum(RADII) - N
    graph = GrainGraph(
        x=[[1, 2], [1 + distance, 2]], radii=RADII, contacts=[[0, 1]], normal_force=[N],
        images=[[0, 0]], cell=4 * np.eye(2),
    )  # fmt: skip
    return graph, {"mass": [1e12] * 2, "inertia": [0.1] * 2, "spin": [-w, w], "damping": 0.0}


def test_two_grains_swing_against_their_spring_in_closed_form():
    """`M = -k_r theta`, `theta = 2 w/W sin W t`, `W^2 = 2 k_r/I`; the energy stays."""
    w, W = 1e-3, np.sqrt(2 * KR / 0.1)
    graph, start = pair(w)
    law = RollingResistance(LinearFrictional(1.0, 0.0, 0.0), KR)
    for turn in (0.3, 0.5, 1.4):
        time = turn * np.pi / W
        end = replay(
            Scene(graph, law), np.zeros((2, 2)), duration=time, time_step=time / 4000, **start
        )
        (M,), theta = end.state.rolling_moment, np.diff(end.state.angle)[0]
        assert M == pytest.approx(-KR * theta, rel=1e-12)
        assert M == pytest.approx(-KR * 2 * w / W * np.sin(turn * np.pi), rel=2e-3, abs=1e-8)
        # Spins are half a step behind.
        spin = end.spin + 0.5 * end.time_step * np.array([-M, M]) / 0.1
        energy = 0.5 * KR * theta**2 + 0.05 * np.sum(spin**2)
        assert energy == pytest.approx(0.1 * w**2, rel=1e-6)


def test_two_grains_roll_at_the_limit_in_closed_form():
    """Beyond `mu_r R N` the moment stays; what was turned beyond takes its work."""
    mu_r, w = 0.02, 0.02
    most = mu_r * 0.5 * 0.4 / 0.9 * N
    graph, start = pair(w)
    law = RollingResistance(LinearFrictional(1.0, 0.0, 0.0), KR, mu_r)
    end = replay(Scene(graph, law), np.zeros((2, 2)), duration=1.0, time_step=1e-4, **start)
    (M,), theta = end.state.rolling_moment, np.diff(end.state.angle)[0]
    assert theta > 5 * most / KR
    assert M == pytest.approx(-most, rel=1e-12)
    spin = end.spin + 0.5 * end.time_step * np.array([-M, M]) / 0.1
    lost = most**2 / (2 * KR) + most * (theta - most / KR)
    assert 0.1 * w**2 - 0.05 * np.sum(spin**2) == pytest.approx(lost, rel=1e-3)


def test_a_moment_ends_where_grains_part():
    graph, start = pair(0.02)
    law = RollingResistance(LinearFrictional(1.0, 0.0, 0.0), KR)
    apart = np.diag([-2 * N, 0.0])
    part = replay(Scene(graph, law), 0.1 * apart, duration=1.0, **start).state
    end = replay(Scene(graph, law), apart, duration=1.0, **start).state
    assert part.rolling_moment[0] < 0 == end.normal_force[0] == end.rolling_moment[0]


@pytest.mark.parametrize(
    ("increment", "k_r"),
    [("branch", 0.5), pytest.param("radii", 0.05, marks=pytest.mark.slow)],
)
def test_a_lattice_has_the_path_of_the_loops_engine(increment, k_r):
    """Centres go with the cell, three unlike spins; the stiff springs make contacts slide."""
    law = RollingResistance(LinearFrictional(1.0, 0.5, 0.2, increment), k_r)
    whole = follow(Scene(KAGOME, law), strained(STRAIN), closure="affine", spins="free")
    slid = {c for event in whole.of_kind("yield") for c in event.contacts}
    error = []
    for interval in INTERVALS:
        path = followed(Scene(KAGOME, law), strained(STRAIN), interval=interval)
        assert path.status == "finished" and {e.contacts[0] for e in path.events} == slid
        error.append(np.abs(path.P[-1] - whole.P[-1]).max() / np.abs(whole.P[-1]).max())
    assert error[0] < 3e-6 and np.divide(error[:-1], error[1:]).min() > 1.95
    free = followed(Scene(KAGOME, law.law), strained(STRAIN), interval=1e-4)
    assert np.abs(free.P[-1] - whole.P[-1]).max() > 0.01 * np.abs(whole.P[-1]).max()


def kagome_moments(law, steps):
    """`T` and `M` of the lattice by implicit steps of its three spins; centres are affine."""
    i, j = KAGOME.contacts.T
    at_i, at_j = np.eye(3)[i], np.eye(3)[j]
    d0 = branch_vectors(KAGOME)
    T, M = np.zeros(6), np.zeros(6)
    paths = [d0 @ (np.eye(2) - share * STRAIN).T for share in np.linspace(0, 1, steps + 1)]
    for before, after in pairwise(paths):
        length, now = np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1)
        turn = (before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]) / (length * now)
        mean, most = 0.5 * (length + now), float(law.mu_r) * 0.25 * (1.0 - now)
        w = np.zeros(3)
        # Newton's method, exact once it knows which springs yield.
        for _ in range(20):
            shear = T - 0.5 * mean * (turn - 0.5 * (w[i] + w[j]))
            tried = M - float(law.k_r) * (w[j] - w[i])
            rolling, elastic = np.clip(tried, -most, most), np.abs(tried) <= most
            left = -(at_i + at_j).T @ (0.5 * now * shear) + (at_j - at_i).T @ rolling
            if np.abs(left).max() < 1e-17:
                break
            K = -(at_i + at_j).T @ ((0.125 * now * mean * 2)[:, None] * (at_i + at_j))
            K -= float(law.k_r) * (at_j - at_i)[elastic].T @ (at_j - at_i)[elastic]
            w = w - np.linalg.solve(K, left)
        T, M = shear, rolling
    return T, M


@pytest.mark.parametrize("mu_r", [0.1, 0.05, 0.02])
def test_springs_of_a_lattice_yield_as_in_small_implicit_steps(mu_r):
    law = RollingResistance(LinearFrictional(1.0, 0.5, np.inf), 0.05, mu_r)
    path = followed(Scene(KAGOME, law), strained(STRAIN), interval=5e-5)
    assert path.status == "finished"
    assert {(event.kind, event.spring) for event in path.events} == {("yield", "rolling")}
    T, M = kagome_moments(law, 400)
    end = path.states[-1]
    np.testing.assert_allclose(end.shear_force[:6], T, rtol=0, atol=3e-5 * np.abs(T).max())
    np.testing.assert_allclose(end.rolling_moment[:6], M, rtol=0, atol=3e-5 * np.abs(M).max())
    most = mu_r * 0.25 * end.normal_force[:6]
    slid = sorted({c for event in path.events for c in event.contacts})
    np.testing.assert_allclose(np.abs(end.rolling_moment[slid]), most[slid], rtol=1e-12)


@pytest.mark.parametrize(("k_r", "mu_r"), [(0.05, np.inf), (0.05, 0.02), (2.0, 0.1)])
def test_a_held_packing_keeps_its_moments(k_r, mu_r):
    """Its resultants vanish with them, and it stays at rest; steps suit stiff springs."""
    moved = replay(Scene(jammed(24, 3), LAW), H, duration=30.0).state.graph()
    held = hold(Scene(moved, RollingResistance(LAW, k_r, mu_r)), unbalanced=1e-7)
    assert held.status == "at rest"
    graph, stage = held.graph, strained(0.1 * H)
    path = follow(Scene(graph, held.law), stage, closure="packing")
    state = path.states[0]
    assert np.abs(graph.rolling_moment).max() > 1e-3 * graph.normal_force.mean()
    assert np.abs(state.resultants).max() < 1e-5 * state.mean_force
    again = hold(Scene(graph, held.law), unbalanced=1e-7)
    np.testing.assert_allclose(
        again.graph.rolling_moment, graph.rolling_moment, rtol=0, atol=1e-5 * state.mean_force
    )
    bare = Scene(graph.replace(rolling_moment=None), held.law)
    without = follow(bare, stage, closure="packing").states[0]
    assert np.abs(without.resultants).max() > 1e-3 * state.mean_force
    np.testing.assert_array_equal(state.rolling_moment[: len(graph.contacts)], graph.rolling_moment)


def test_bad_input():
    with pytest.raises(InputError, match="mu_r of the contact law"):
        RollingResistance(LAW, 0.1, -0.1)
    with pytest.raises(InputError, match="a finite mu_r"):
        follow(Scene(KAGOME, RollingResistance(LAW, 0.1, 0.1)), strained(STRAIN), closure="affine")
    with pytest.raises(InputError, match="rolling_moment"):
        KAGOME.replace(rolling_moment=[0.0])
    law = RollingResistance(LAW, [0.1, 0.2], [0.3, 0.4]).take(np.array([1]))
    assert (law.k_r.tolist(), law.mu_r.tolist(), law.shear_increment) == ([0.2], [0.4], "radii")
    graph = KAGOME.replace(rolling_moment=np.ones(6))
    five = {"contacts": graph.contacts[:5], "images": graph.images[:5]}
    with pytest.raises(InputError, match="without rolling_moment"):
        graph.replace(**five, normal_force=graph.normal_force[:5], shear_force=[0.0] * 5)
    assert graph.replace(**five, **graph.at_contacts(slice(5))).rolling_moment.tolist() == [1.0] * 5


def test_energy_of_the_springs():
    """M**2/(2 k_r) of contacts with a spring; the others have none."""
    graph = jammed(12, 1, LAW)
    k_r = np.where(np.arange(graph.contact_count) % 2, 0.02, 0.0)
    M = np.linspace(-1e-3, 2e-3, graph.contact_count)
    wanted = sum(m**2 / (2 * k) for m, k in zip(M, k_r, strict=True) if k)
    for law, energy in ((RollingResistance(LAW, k_r), wanted), (LAW, 0.0)):
        starts = [
            follow(Scene(start, law), strained(1e-9 * H), closure="packing").energy[0]
            for start in (graph.replace(rolling_moment=M), graph)
        ]
        assert starts[0] - starts[1] == pytest.approx(energy, rel=1e-9, abs=1e-18)


def test_a_moment_without_a_spring_is_none():
    """Half of the contacts have no stiffness: a moment given there neither acts nor is stored."""
    graph = jammed(12, 1, LAW)
    k_r = np.where(np.arange(graph.contact_count) % 2, 0.02, 0.0)
    springs, moment = k_r > 0, np.full(graph.contact_count, 1e-4)
    law = RollingResistance(LAW, k_r)
    given, wanted = (
        graph.replace(rolling_moment=M) for M in (moment, np.where(springs, moment, 0))
    )
    # In extension contacts open; the path stays where they are closed.
    stage = Stage(programmes.isotropic_strain(), "H11", 1e-5)
    ends = [replay(Scene(one, law), -5e-3 * np.eye(2), duration=50.0) for one in (given, wanted)]
    count = graph.contact_count
    assert (ends[1].state.normal_force[:count][~springs] == 0).any()
    paths = [
        follow(Scene(one, law), stage, closure="packing", rows=2, interval=1e-4)
        for one in (given, wanted)
    ]
    for a, b in ((ends[0].state, ends[1].state), (paths[0].states[-1], paths[1].states[-1])):
        np.testing.assert_array_equal(a.rolling_moment, b.rolling_moment)
        np.testing.assert_array_equal(a.x, b.x)
