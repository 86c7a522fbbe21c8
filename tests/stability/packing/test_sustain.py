"""Loads that packings sustain: closed forms, slow replays, the energy balance, the modes."""

import functools
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq, fsolve

from loops import (
    GrainGraph,
    HertzMindlin,
    InputError,
    LinearFrictional,
    RollingResistance,
    find_faces,
)
from loops.packing import PlaneContacts
from stability import Stage
from stability.packing import replay, sustain
from stability.packing.state import start_state
from stability.packing.sustain import FAILURE_STRAIN, MODE_STRAIN, keeps_growing
from stability.programmes import proportional_stress
from tests.packings import LAW, diamonds, jammed
from tests.stability.packing.walled_packings import JAMMED, jammed_in_box

SQUARE = GrainGraph(
    x=[[0, 0], [1, 0], [0, 1], [1, 1]],
    radii=[0.505] * 4,
    contacts=[[0, 1], [1, 0], [2, 3], [3, 2], [0, 2], [2, 0], [1, 3], [3, 1]],
    images=[[0, 0], [1, 0], [0, 0], [1, 0], [0, 0], [0, 1], [0, 0], [0, 1]],
    cell=2 * np.eye(2),
    normal_force=np.full(8, 0.01),
)
INTERVAL = 4e-5


@functools.cache
def loaded(grains, seed, turns=6):
    """Eight directions, the sixth of which is (0, -1); up to 0.3 of twice the mean stress."""
    graph = jammed(grains, seed, LAW)
    largest = 0.3 * np.trace(start_state(graph).stress)
    angles = 2 * np.pi * np.arange(8) / 8
    directions = np.column_stack([np.cos(angles), np.sin(angles)])[[turns]]
    return sustain(graph, LAW, directions, largest=largest, interval=INTERVAL).paths[0]


def test_a_square_lattice_fails_where_its_contacts_open():
    """The stress of each axis is its force over the spacing: 0.01."""
    found = sustain(SQUARE, LAW, [[-1, 0], [1, 0], [0, -1]], largest=0.02, interval=1e-4)
    assert found.status.tolist() == ["failed", "held", "failed"]
    np.testing.assert_allclose(found.limit, [0.01, 0.02, 0.01], rtol=1e-9)
    assert found.paths[1].motions == () and np.isnan(found.paths[1].first_event)


@pytest.mark.parametrize(
    "direction", [[-1, 1], [-1, 0], [0, -1]], ids=["across", "axis 1", "axis 2"]
)
def test_a_diamond_fails_where_it_yields(direction):
    """`P11 = (N c - T s)/(s0 d0)`, `P22 = (N s + T c)/(c0 d0)`, `T = kt (a0 - a) = +- mu N`."""
    graph, a0, d0 = diamonds(), np.radians(35), 0.99
    unit = np.array(direction) / np.linalg.norm(direction)
    side = 1.0 if direction[0] else -1.0

    def left(unknown):
        load, a, N = unknown
        T = LAW.kt * (a0 - a)
        P = np.array([N * np.cos(a) - T * np.sin(a), N * np.sin(a) + T * np.cos(a)])
        P /= d0 * np.array([np.sin(a0), np.cos(a0)])
        return [*(P - start_state(graph).stress.diagonal() - load * unit), T - side * LAW.mu * N]

    wanted = fsolve(left, [0.006, a0, 0.01], xtol=1e-12)[0]
    errors = []
    for interval in (4e-5, 2e-5):
        (path,) = sustain(graph, LAW, [direction], largest=0.02, interval=interval).paths
        assert path.status == "failed" and path.first_event == path.first_instability == path.limit
        assert path.failed_under == pytest.approx(1.02 * path.limit, rel=0.01)
        errors.append(abs(path.limit / wanted - 1))
    assert errors[1] < errors[0] < 1.5e-7


def test_the_load_is_raised_to_the_largest_at_most():
    """The largest load is above the limit of the diamonds, by less than a fiftieth."""
    (free,) = sustain(diamonds(), LAW, [[-1, 1]], largest=0.02, interval=1e-4).paths
    largest = 1.01 * free.limit
    (path,) = sustain(diamonds(), LAW, [[-1, 1]], largest=largest, interval=1e-4).paths
    assert path.failed_under == pytest.approx(largest, rel=1e-12)
    assert free.failed_under == pytest.approx(1.02 * free.limit, rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(("grains", "seed", "turns"), [(12, 1, 6), (24, 3, 7), (36, 5, 6)])
def test_a_slow_replay_fails_under_the_load_that_fails(grains, seed, turns):
    """It strains like the path below the limit, and runs off above the load that failed."""
    graph, path = jammed(grains, seed, LAW), loaded(grains, seed, turns)
    assert path.status == "failed"
    strain = []
    for load in (0.98 * path.limit, 1.02 * path.failed_under):
        stage = Stage(proportional_stress(*path.direction), "parameter", load)
        end = replay(graph, LAW, stage, duration=2e5).state
        strain.append(np.linalg.norm(end.cell @ np.linalg.inv(graph.cell) - np.eye(2)))
    at_limit = np.linalg.norm(path.H[-1])
    assert strain[0] < 1.05 * at_limit and strain[1] > 2 * at_limit + FAILURE_STRAIN


def test_a_snap_is_gone_through():
    """A packing of 12 snaps once and then fails; the load of the rows never falls."""
    path = loaded(12, 1)
    assert path.status == "failed" and [one.status for one in path.motions] == ["at rest", "failed"]
    (snap,) = path.snaps
    assert path.first_instability == snap.lost < snap.load < path.limit < path.failed_under
    assert np.linalg.norm(snap.strain) > 1e-4 and snap.released > 0 and snap.kinetic > 0
    assert (np.diff(path.load) >= 0).all() and path.load[-1] == path.limit
    np.testing.assert_allclose(
        path.P[:, [0, 3]] - path.P[0, [0, 3]], path.load[:, None] * path.direction, atol=3e-7
    )
    np.testing.assert_allclose(path.H[:, [1, 2]], 0.0, atol=1e-9)


def test_a_snap_ends_under_its_load_whatever_the_error_of_the_path_before():
    """The stress of the rows is `P0 + load direction`; long intervals leave an error before."""
    graph = jammed(24, 3, LAW)
    largest = 0.3 * np.trace(start_state(graph).stress)
    (path,) = sustain(graph, LAW, [[0, -1]], largest=largest, interval=1e-3).paths
    (snap,) = path.snaps
    row = int(np.flatnonzero(path.load == snap.load)[0])
    error = path.P[:, [0, 3]] - path.P[0, [0, 3]] - path.load[:, None] * path.direction
    before, after = np.abs(error[[row - 1, row]]).max(axis=1) / (snap.load - snap.lost)
    # The error after it is what counts as rest: 1e-3 of the rise.
    assert before > 0.02 and after < 1e-3


def test_without_snaps_a_direction_is_unfinished():
    path = loaded(12, 1)
    graph = jammed(12, 1, LAW)
    largest = 0.3 * np.trace(start_state(graph).stress)
    direction, how = [path.direction], {"interval": INTERVAL, "most_snaps": 0}
    found = sustain(graph, LAW, direction, largest=largest, **how).paths[0]
    assert found.status == "unfinished" and "more than 0 motions" in found.message
    assert found.limit == pytest.approx(path.first_instability, rel=1e-9)


@pytest.fixture
def growing(monkeypatch):
    """The load grows in the equations of motion from the first loss of equilibrium on."""
    monkeypatch.setattr(sys.modules["stability.packing.sustain"], "BY_EVENTS", 0)


def test_a_square_lattice_fails_under_a_load_that_grows(growing):
    """As by events: at 0.01. Loads that are kept lie 2 to 4 % apart."""
    (path,) = sustain(SQUARE, LAW, [[-1, 0]], largest=0.02, interval=1e-4).paths
    assert path.status == "failed" and "grows slowly" in path.motions[-1].cause
    assert path.limit <= 0.01 * (1 + 1e-9) < path.failed_under < 1.04 * path.limit
    assert path.load[-1] == path.limit and path.motions[-1].lost == path.limit


@pytest.mark.parametrize(("grains", "seed", "turns"), [(12, 1, 6), (12, 1, 5), (24, 3, 6)])
def test_a_load_that_grows_has_the_limits_of_events(growing, grains, seed, turns):
    """Snaps are gone through; energy is balanced, and the end is under its load."""
    by_events, path = loaded(grains, seed, turns), loaded.__wrapped__(grains, seed, turns)
    assert path.status == by_events.status
    assert path.limit == pytest.approx(by_events.limit, rel=0.02)
    assert path.balance_error < 1e-10 and len(path.motions) <= 2
    error = path.P[-1, [0, 3]] - path.P[0, [0, 3]] - path.load[-1] * path.direction
    assert np.abs(error).max() < 1e-3 * path.limit
    assert path.work[-1, 3] >= 0.99 * sum(snap.released for snap in path.snaps) > 0


@pytest.mark.parametrize(("grains", "seed", "turns"), [(12, 1, 6), (12, 1, 5), (24, 3, 6)])
def test_the_energy_balance_closes_through_snaps(grains, seed, turns):
    path = loaded(grains, seed, turns)
    assert len(path.snaps) > 0 and path.balance_error < 1e-10
    # Each snap loses energy, and the rows count it.
    assert path.work[-1, 3] >= 0.99 * sum(snap.released for snap in path.snaps) > 0


def test_the_mode_of_a_failure():
    """The diamonds collapse alike and affinely; the motion feeds on internal second-order work."""
    (path,) = sustain(diamonds(), LAW, [[-1, 1]], largest=0.02, interval=1e-4).paths
    mode = path.mode
    assert mode is path.motions[-1] and np.linalg.norm(mode.strain) > FAILURE_STRAIN > MODE_STRAIN
    assert np.abs(mode.displacement).max() < 1e-13 and mode.opened == mode.closed == 0
    np.testing.assert_allclose(mode.loop_work, mode.loop_work[0], rtol=1e-6)
    assert mode.loop_work.shape == (len(find_faces(diamonds()).loops),) and mode.loop_work[0] < 0


def test_strain_that_keeps_growing():
    t = np.linspace(0.0, 1.0, 200)
    faster, slower = FAILURE_STRAIN * 1.1 * t**2, FAILURE_STRAIN * 1.1 * np.sqrt(t)
    assert keeps_growing(faster, t) and not keeps_growing(slower, t)
    assert not keeps_growing(faster, 1 - t) and not keeps_growing(0.8 * faster, t)
    # The last doubling within one look.
    assert keeps_growing([0.0, 0.1 * FAILURE_STRAIN, 2 * FAILURE_STRAIN], [0.0, 1.0, 0.5])


def test_directions_with_shear():
    """A square lattice under shear: branches tilt by `e`, `P12 = T - N e`, `T = mu N` at the end.

    The direction counts the shear stress sqrt 2 times.
    """
    how = {"subspace": "symmetric", "largest": 0.01, "interval": 2e-5}
    found = sustain(SQUARE, LAW, [[0, 0, 1]], **how)
    (path,) = found.paths
    # `T = kt (r_i + r_j) e`, `N = kn (r_i + r_j - sqrt(1 + e^2))`.
    e = brentq(lambda e: LAW.kt * 1.01 * e - LAW.mu * (1.01 - np.hypot(1, e)), 0, 0.02, xtol=1e-15)
    N = 1.01 - np.hypot(1, e)
    assert path.limit == pytest.approx(np.sqrt(2) * (LAW.mu - e) * N, rel=2e-4)


def test_bad_input():
    with pytest.raises(InputError, match="largest"):
        sustain(SQUARE, LAW, 4, largest=-1.0)
    with pytest.raises(InputError, match="directions"):
        sustain(SQUARE, LAW, [[0.0, 0.0]])
    with pytest.raises(InputError, match="subspace"):
        sustain(SQUARE, LAW, 4, subspace="full")
    with pytest.raises(InputError, match="damping"):
        sustain(SQUARE, LAW, 4, damping=1.0)
    with pytest.raises(InputError, match="most_snaps"):
        sustain(SQUARE, LAW, 4, most_snaps=-1)
    with pytest.raises(InputError, match="law"):
        sustain(SQUARE, RollingResistance(RollingResistance(LAW, 0.1), 0.1), 4)


@pytest.mark.slow
def test_a_square_of_hertzian_discs_fails_where_its_contacts_open():
    """Each carries `2/3 E/(1 - nu^2) sqrt(r/2) overlap^(3/2)`: the stress of both axes."""
    law = HertzMindlin(1.0, 0.3, 0.5)
    force = 2 / 3 / (1 - 0.3**2) * np.sqrt(0.505 / 2) * 0.01**1.5
    found = sustain(SQUARE, law, [[-1, 0]], largest=2 * force, interval=1e-4)
    assert found.status.tolist() == ["failed"]
    # Its stiffness vanishes with the force: the control meets its limit a little before.
    assert found.limit == pytest.approx([force], rel=1e-6)


def test_a_square_of_discs_between_walls_fails_where_its_contacts_open():
    """Two contacts with 0.01 on a wall of length 2: the stress of each axis is 0.01."""
    graph = GrainGraph(
        x=[[0, 0], [1, 0], [0, 1], [1, 1]], radii=[0.505] * 4,
        contacts=[[0, 1], [2, 3], [0, 2], [1, 3]], normal_force=[0.01] * 4,
    )  # fmt: skip
    grain = [0, 2, 1, 3, 0, 1, 2, 3]
    branch = 0.5 * np.repeat([[-1, 0], [1, 0], [0, -1], [0, 1]], 2, axis=0)
    planes = PlaneContacts(np.array(grain), branch, np.full(8, 2.0), np.zeros(8))
    directions = [[-1, 0], [1, 0], [0, -1]]
    found = sustain(graph, LAW, directions, largest=0.02, interval=1e-4, planes=planes)
    assert found.status.tolist() == ["failed", "held", "failed"]
    np.testing.assert_allclose(found.limit, [0.01, 0.02, 0.01], rtol=1e-9)
    assert found.paths[0].mode.displacement.shape == (4, 2)
    with pytest.raises(InputError, match="box"):
        sustain(graph, LAW, [[0, 0, 1]], subspace="symmetric", largest=0.01, planes=planes)


@pytest.mark.parametrize("which", [JAMMED[0], JAMMED[4]], ids=["smooth", "rough"])
def test_a_slow_replay_between_walls_fails_under_the_load_that_fails(which):
    graph, planes, force = jammed_in_box(*which)
    walls = {"planes": planes, "plane_force": force}
    largest = 0.25 * np.trace(start_state(graph, planes, force).stress)
    how = {"largest": largest, "interval": INTERVAL, **walls}
    (path,) = sustain(graph, which[2], [[-1, 1]], **how).paths
    assert path.status == "failed" and path.balance_error < 1e-10
    strain = []
    for load in (0.98 * path.limit, 1.02 * path.failed_under):
        stage = Stage(proportional_stress(*path.direction), "parameter", load)
        end = replay(graph, which[2], stage, duration=2e4, **walls).state
        strain.append(np.linalg.norm(end.strain))
    at_limit = np.linalg.norm(path.H[-1])
    assert strain[0] < 1.05 * at_limit and strain[1] > 2 * at_limit + FAILURE_STRAIN


@functools.cache
def yade(state):
    """A state that Yade held, and in rows: degrees, load held, load moved.

    b: strain .003; a: .030; c: a, restarted and held again.
    """
    with np.load(Path(__file__).with_name("yade_stress_steps.npz")) as stored:
        names = ("x", "radii", "contacts", "images", "cell", "normal_force", "shear_force")
        return GrainGraph(**{name: stored[f"{state} {name}"] for name in names}), stored[
            f"{state} yade"
        ]


YADE_LAW = LinearFrictional(1e6, 5e5, 0.5, "radii")
STEPS = [("b", k) for k in range(6)] + [("a", k) for k in range(4)]
FAST = ("a", 1)


@pytest.mark.parametrize(
    ("state", "row"), [pytest.param(*s, marks=[pytest.mark.slow] * (s != FAST)) for s in STEPS]
)
def test_limits_lie_between_the_loads_that_yade_held_and_moved_under(state, row):
    """Stress steps in Yade from the same state at rest, 1,000 discs; inf: it held them all."""
    graph, rows = yade(state)
    theta, held, moved = rows[row]
    direction = [np.cos(np.radians(theta)), np.sin(np.radians(theta))]
    largest = min(1.5 * moved, max(held, 1.0) if np.isinf(moved) else np.inf)
    (path,) = sustain(graph, YADE_LAW, [direction], largest=largest).paths
    # The stored energy is a hundred times the work, and overlaps are rounded by their diameters.
    overlap = graph.normal_force.mean() / YADE_LAW.kn
    rounding = np.finfo(float).eps * path.energy[0] * 2 * graph.radii.mean() / overlap
    work = np.abs(path.work[:, 0]).max()
    assert path.balance_error * work < 1e-10 * work + 2 * rounding
    if np.isinf(moved):
        assert path.status in ("held", "snapped") and path.limit == pytest.approx(held, rel=1e-6)
    else:
        assert path.status == "failed" and held <= path.limit < path.failed_under <= moved


@pytest.mark.parametrize(
    "row", [pytest.param(k, marks=[pytest.mark.slow] * (k not in (2, 7))) for k in range(8)]
)
def test_limits_of_a_state_that_yade_held_again(row):
    """Within Yade's loads or up to 7 % above: its levels are applied in a thousand steps."""
    graph, rows = yade("c")
    theta, held, moved = rows[row]
    direction = [np.cos(np.radians(theta)), np.sin(np.radians(theta))]
    largest = held if np.isinf(moved) else 1.5 * moved
    (path,) = sustain(graph, YADE_LAW, [direction], largest=largest).paths
    if np.isinf(moved):
        assert path.status == "held" and path.limit == pytest.approx(held, rel=1e-6)
    else:
        assert path.status == "failed" and path.first_instability < moved
        assert held <= path.limit <= 1.07 * moved
