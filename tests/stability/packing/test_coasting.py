"""Grains without load that coast: where they come to, in any intervals and numbers."""

from dataclasses import replace

import numpy as np
import pytest

from loops import GrainGraph, LinearFrictional, Scene
from stability import Stage, programmes
from stability.packing.path import PackingPathOptions, PackingPathSolver
from stability.packing.rattlers import MOST_COAST, settle

LARGE, FORCE = 0.505, 0.01
LATTICE = (
    [[0, 1], [1, 0], [2, 3], [3, 2], [0, 2], [2, 0], [1, 3], [3, 1]],
    [[0, 0], [1, 0], [0, 0], [1, 0], [0, 0], [0, 1], [0, 0], [0, 1]],
)
ALONG = np.sqrt([0.5, 0.5])
# Each interval the push goes on by this much.
PUSH = 5e-4


def solver_of(small, at, order=None, coasting=True):
    """Small discs on the diagonal of the first square of a lattice, and the places of grains."""
    x = np.vstack([[[0, 0], [1, 0], [0, 1], [1, 1]], np.multiply.outer(at, ALONG)])
    radii = np.append([LARGE] * 4, [small] * len(at))
    order = np.arange(len(x)) if order is None else np.array(order)
    place = np.argsort(order)
    graph = GrainGraph(
        x=x[order], radii=radii[order], contacts=place[LATTICE[0]], images=LATTICE[1],
        cell=2 * np.eye(2), normal_force=[FORCE] * 8,
    )  # fmt: skip
    stage = Stage(programmes.isotropic_stress(), "H11", 1e-3)
    scene = Scene(graph, LinearFrictional(1.0, 0.5, 0.5))
    return PackingPathSolver(
        scene, [stage], PackingPathOptions(1e-5, past="stop"), coasting=coasting
    ), place


def goes_on(solver, place, push=0.0, duration=1.0):
    """An interval in which the first disc is moved towards the small ones; their places."""
    start = solver.point
    x = start.state.x.copy()
    x[place[0]] += push * ALONG
    end = replace(start, state=replace(start.state, x=x))
    solver.point = settle(end, start, duration, solver.coasting).listed()
    assert solver.point.rattlers[place[4:]].all()
    np.testing.assert_array_equal(solver.point.state.x[place[:4]], x[place[:4]])
    return solver.point.state.x[place[4:]] @ ALONG


@pytest.mark.parametrize("order", [None, [4, 2, 0, 3, 1]])
@pytest.mark.parametrize("parts", [1, 2, 4])
def test_a_grain_that_was_pushed_goes_on_to_the_next_loaded_one_and_rests_there(parts, order):
    """Pushed by `a` in a unit of load it goes on by `a` in each, in any number of intervals."""
    small = np.sqrt(0.5) - LARGE - 2e-3
    first, last = LARGE + small, np.sqrt(2.0) - LARGE - small
    solver, place = solver_of(small, [first], order)
    for _ in range(parts):
        found = goes_on(solver, place, PUSH / parts, 1.0 / parts)
    assert found == pytest.approx(first + PUSH, abs=1e-9)
    for k in range(2, 12):
        for _ in range(parts):
            found = goes_on(solver, place, duration=1.0 / parts)
        assert found == pytest.approx(min(first + k * PUSH, last), abs=1e-9)
    assert first + 8 * PUSH == pytest.approx(last)
    assert np.abs(solver.point.coast).max() < 1e-9


def test_it_stays_where_it_was_pushed_without_coasting():
    small = np.sqrt(0.5) - LARGE - 2e-3
    solver, place = solver_of(small, [LARGE + small], coasting=False)
    goes_on(solver, place, PUSH)
    assert goes_on(solver, place) == pytest.approx(LARGE + small + PUSH, abs=1e-9)


@pytest.mark.parametrize("order", [None, [5, 4, 2, 0, 3, 1], [1, 4, 0, 2, 5, 3]])
@pytest.mark.parametrize("parts", [1, 3])
def test_a_grain_that_meets_another_pushes_it_on(parts, order):
    """As two of one mass do that stay together: their sum goes on as before; both rest in the end.

    The second one at the loaded disc, the first one at the second.
    """
    small, gap = 0.1, 1.5e-3
    first, last = LARGE + small, np.sqrt(2.0) - LARGE - small
    start = np.array([first, first + 2 * small + gap])
    solver, place = solver_of(small, start, order)
    for _ in range(parts):
        goes_on(solver, place, PUSH / parts, 1.0 / parts)
    for k in range(2, 7):
        for _ in range(parts):
            one, two = goes_on(solver, place, duration=1.0 / parts)
        assert one + two == pytest.approx(start.sum() + k * PUSH, abs=1e-8)
        assert (two > start[1] + 1e-9) == (k > gap / PUSH)
    for _ in range(20 * parts):
        ends = goes_on(solver, place, duration=1.0 / parts)
    np.testing.assert_allclose(ends, [last - 2 * small, last], rtol=0, atol=1e-8)
    assert np.abs(solver.point.coast).max() < 1e-8


def test_a_step_goes_no_further_than_pairs_are_listed():
    """One that is too long for it is cut, and meets the disc that it would have leapt over."""
    small = np.sqrt(0.5) - LARGE - 2e-3
    first, last = LARGE + small, np.sqrt(2.0) - LARGE - small
    solver, place = solver_of(small, [first])
    coast = np.zeros_like(solver.point.state.x)
    coast[place[4]] = 2.0 * ALONG
    solver.point = replace(solver.point, coast=coast)
    most = MOST_COAST * solver.point.listed_gap
    assert goes_on(solver, place) == pytest.approx(first + most, abs=1e-9)
    for _ in range(5):
        found = goes_on(solver, place)
    assert found == pytest.approx(last, abs=1e-9)


def test_grains_that_a_motion_has_moved_start_from_rest():
    """Nothing goes on from before a motion, nor in an interval of no length."""
    small = np.sqrt(0.5) - LARGE - 2e-3
    solver, place = solver_of(small, [LARGE + small])
    found = goes_on(solver, place, PUSH)
    assert np.abs(solver.point.coast).max() > 0
    solver.point = settle(solver.point, None, 1.0, True)
    assert not solver.point.coast.any()
    assert goes_on(solver, place) == pytest.approx(found, abs=1e-12)
