"""Pivots against enumeration: regimes of contacts at yield that agree with their rates."""

from collections import Counter

import numpy as np
import pytest

from loops import Scene
from stability import follow, rates_at
from stability.packing import regime_factor, strain_increment
from stability.packing.regime_factor import ELASTIC, RegimeFactor, disagreeing, pivot
from stability.programmes import MixedControl
from tests.packings import LAW, contacts_of, jammed, packing, start_state, strained
from tests.stability.packing.test_regime_factor import stiffness

NONE, ALL = np.zeros((4, 4)), np.eye(4)
HELD = np.diag([1.0, 0, 0, 0])
TINY = 1e-9


def stuck_packing(seed):
    """A random packing half of whose contacts are at yield, all stuck, and these contacts."""
    graph = packing(8, seed=seed, share=0.9, sliding=0.5)
    at_yield = np.abs(graph.shear_force) >= (1 - 1e-9) * LAW.mu * graph.normal_force
    regime = np.full(graph.contact_count, ELASTIC, dtype=np.int8)
    side = np.sign(graph.shear_force)
    state = contacts_of(start_state(graph), LAW)
    frozen = RegimeFactor(state, regime, side)
    return graph, frozen, np.flatnonzero(at_yield)


def settle(frozen, control, critical):
    """Pivot the worst disagreeing contact until none is left; changes of regime in each pivot.

    Where a pivot meets no end, its contact and the unstable mode.
    """
    counts = []
    while True:
        wrong = disagreeing(frozen, frozen.solve(control), critical, TINY)
        if len(wrong) == 0:
            return counts
        changed, mode = pivot(frozen, control, int(wrong[0]), critical, TINY)
        if changed is None:
            return int(wrong[0]), mode
        assert changed[-1] == wrong[0] and len(counts) < 30
        counts.append(len(changed))


@pytest.mark.parametrize("stress_held", [False, True], ids=["strain", "P11 held"])
def test_pivots_find_the_only_solution(stress_held):
    """They lead to that of `rates_at` where enumeration proves that there is no other."""
    counts, compared = [], 0
    for seed in range(12):
        graph, frozen, critical = stuck_packing(seed)
        H = np.random.default_rng(seed).normal(size=(2, 2))
        control = MixedControl(NONE, ALL, H.ravel())
        if stress_held:
            H[0, 0] = np.nan
            control = MixedControl(HELD, ALL - HELD, np.nan_to_num(H.ravel()))
        wanted = rates_at(Scene(graph, LAW), H=H, yield_band=1 - 1e-9)
        if (wanted.status, wanted.proof, wanted.settled) != ("unique", "enumeration", 0):
            continue
        counts += settle(frozen, control, critical)
        compared += 1
        np.testing.assert_array_equal(frozen.regime, wanted.regime)
        strain = frozen.solve(control)[:4]
        np.testing.assert_allclose(strain, wanted.strain_rate.ravel(), rtol=0, atol=1e-4)
    # Many pivots change more contacts than the one that is asked for.
    assert compared > 7 and sum(count > 1 for count in counts) > 5


def held_stiffness(frozen):
    """Dense stiffness in the present regimes, with one grain held."""
    dense = stiffness(frozen)
    dense[[0, 1], [0, 1]] += 1.0
    return dense


@pytest.mark.parametrize("seed", [123, 170])
def test_a_pivot_without_a_solution_changes_no_regime(seed):
    """Regimes are as before the last pivot; `turns` is the sign change of the determinant."""
    _, frozen, critical = stuck_packing(seed)
    control = MixedControl(NONE, ALL, np.random.default_rng(seed).normal(size=4))
    c, mode = settle(frozen, control, critical)
    (wrong, *_) = disagreeing(frozen, frozen.solve(control), critical, TINY)
    assert c == wrong
    signs = []
    for _ in range(2):
        signs.append(np.linalg.slogdet(held_stiffness(frozen))[0])
        frozen.flip(c)
    assert mode["sign_changes"] == (signs[0] != signs[1])


STRAINS = [np.diag([1.0, 0.0]), np.diag([1.0, -1.0]), np.array([[0.3, 0.5], [0.2, -0.6]])]
SMALL = [
    (grains, seed, draw)
    for grains, seed in ((12, 1), (16, 2), (24, 3), (36, 5))
    for draw in range(9)
]


def yielding(grains, seed, draw):
    """A jammed packing with a random share of its contacts brought to yield."""
    graph, rng = jammed(grains, seed), np.random.default_rng(draw)
    most = LAW.mu * graph.normal_force
    chosen = rng.random(len(most)) < (0.15, 0.3, 0.5)[draw % 3]
    shear = np.where(chosen, rng.choice([-1, 1], len(most)) * most, 0.9 * graph.shear_force)
    return graph.replace(shear_force=np.clip(shear, -most, most))


def held_to_the_rate_problem(cases):
    """Ask paths for their start, and the rate problem there; statuses, how many paths go on."""
    seen = Counter()
    for grains, seed, draw in cases:
        graph = yielding(grains, seed, draw)
        for H in STRAINS:
            path = follow(
                Scene(graph, LAW),
                strained(1e-8 * H),
                closure="packing",
                rows=1,
                interval=1e-8,
                instabilities=1,
                past="stop",
            )
            start = path.states[0].graph()
            found = rates_at(Scene(start, LAW), H=H, yield_band=1.0 - 1e-6)
            if found.status in ("unique", "several", "family", "one found"):
                assert path.status == "finished", (grains, seed, draw, path.message)
            if found.status == "none":
                assert path.status == "instabilities" and "no regimes agree" in path.message
            seen[found.status, path.status] += 1
    return seen


def test_a_path_finds_the_solution_that_pivots_miss():
    """Raising the slip of one contact ends nowhere here; another set of sliding contacts agrees."""
    seen = held_to_the_rate_problem([(16, 2, 1)])
    assert seen["unique", "finished"] == 3


def path_to_an_instability():
    """A path on which the pivot of a contact meets no end."""
    scene, stage = Scene(yielding(36, 5, 3), LAW), strained(1e-8 * STRAINS[2])
    return follow(scene, stage, closure="packing", rows=1, interval=1e-8)


def test_regimes_are_sought_once_however_many_springs_are_tried(monkeypatch):
    """Proved to have none; three springs are tried before the mode stops."""
    searched, sought = [], regime_factor.agreeing
    springs, added = [], RegimeFactor.add_ground_springs

    def search(problem):
        searched.append(sought(problem))
        return searched[-1]

    def add(packing, grains, spring):
        springs.append(spring)
        added(packing, grains, spring)

    monkeypatch.setattr(regime_factor, "agreeing", search)
    monkeypatch.setattr(RegimeFactor, "add_ground_springs", add)
    path = path_to_an_instability()
    (instability,) = path.of_kind("instability")
    assert instability.cause == "no_regimes" and instability.passed == "dragged"
    assert springs == list(strain_increment.GROUND_SPRINGS[:3])
    assert [found.status for found in searched] == ["none"]


def test_a_light_grain_leaves_before_regimes_of_all_are_sought(monkeypatch):
    """Where every grain counts as light the instability of the test before is none."""
    monkeypatch.setattr(strain_increment, "LIGHT_SHARE", 1e9)
    monkeypatch.setattr(strain_increment, "seek", None)
    path = path_to_an_instability()
    assert path.status == "finished" and not path.of_kind("instability")
    assert "unloaded" in [event.cause for event in path.of_kind("opening")]


@pytest.mark.slow
def test_paths_of_small_packings_go_on_wherever_a_solution_is_known():
    seen = held_to_the_rate_problem(SMALL)
    assert seen["unique", "finished"] > 50 and seen["several", "finished"] > 15
    assert seen["none", "instabilities"] > 0
