"""A packing replayed by equations of motion: closed forms, brute force, and Yade's next states."""

import json
import math

import numpy as np
import pandas as pd
import pytest
from scipy.linalg import expm, logm

from grainloops import replay
from loops import (
    GrainGraph,
    HertzMindlin,
    InputError,
    LinearFrictional,
    RollingResistance,
    Scene,
    contact_state,
)
from loops.neighbours import near_pairs
from patterns import read_snapshot, sample_path
from patterns.snapshots.cells import rows_by_number
from stability import Stage, follow
from stability.packing.equations_of_motion import (
    Moving,
    largest_step,
    lasting,
    masses_of,
    servo_of,
    steered,
    work_of,
)
from stability.programmes import (
    combination,
    drained_biaxial,
    isotropic_stress,
    simple_shear,
)
from tests.packings import LAW, contacts_of, jammed, loop_changes, packing, start_state
from tests.yade_slow import COLLECTION, in_collection, predicted, slow, strain_between

STILL = np.zeros((2, 2))


def pair(distance, **forces):
    return GrainGraph(
        x=[[1.0, 2.0], [1.0 + distance, 2.0]],
        radii=[0.5, 0.5],
        contacts=[[0, 1]],
        images=[[0, 0]],
        cell=4 * np.eye(2),
        **forces,
    )


def test_an_elastic_collision_in_closed_form():
    """Overlap `v/w sin w t`, `w^2 = 2 kn/m`, then the velocities are exchanged."""
    v, omega = 1e-3, np.sqrt(2 * 2.0 / 1.0)
    touching = pair(1.0)
    start = {"mass": [1.0, 1.0], "velocity": [[v, 0], [0, 0]], "damping": 0.0}
    law, dt = LinearFrictional(2.0, 1.0, 0.5), 1e-3
    half = replay(Scene(touching, law), STILL, duration=0.5 * np.pi / omega, time_step=dt, **start)
    # Leapfrog: frequency to (w dt)^2/24, the start half a step off.
    assert half.state.normal_force[0] == pytest.approx(2.0 * v / omega, rel=1e-5)
    after = replay(Scene(touching, law), STILL, duration=1.5 * np.pi / omega, time_step=dt, **start)
    np.testing.assert_allclose(after.velocity, [[0, 0], [v, 0]], atol=1e-5 * v)
    assert after.state.normal_force[0] == 0


def test_a_motion_that_meets_others_in_every_step_is_refused():
    """More than a hundred steps in a row, in each of which pairs have to be listed anew."""
    law, apart = LinearFrictional(1.0, 0.5, 0.5), pair(1.5)
    # Grains may come closer by the listed gap, a fiftieth of the diameter.
    fast = {"velocity": [[0.011, 0.0], [0.011, 0.0]], "time_step": 1.0}
    end = replay(Scene(apart, law), STILL, duration=101.0, **fast)
    np.testing.assert_allclose(end.velocity[:, 0], 0.011)
    with pytest.raises(InputError, match="in one of 102 steps"):
        replay(Scene(apart, law), STILL, duration=102.0, **fast)
    slow = fast | {"velocity": [[0.009, 0.0], [0.009, 0.0]]}
    assert replay(Scene(apart, law), STILL, duration=300.0, **slow).steps == 300


def triangles(law, overlap=1e-3):
    """Triangular lattice of discs of unit diameter, each with six contacts."""
    across, up = np.meshgrid(np.arange(6), np.arange(6))
    x = np.column_stack([(across + 0.5 * (up % 2)).ravel(), np.sqrt(0.75) * up.ravel()])
    cell, radii = 6.0 * np.diag([1.0, np.sqrt(0.75)]), np.full(36, 0.5 * (1.0 + overlap))
    contacts, images = near_pairs(x, cell, radii, 0.0)
    force = np.full(len(contacts), law.kn * overlap)
    return GrainGraph(
        x=x, radii=radii, contacts=contacts, images=images, cell=cell, normal_force=force
    )


@pytest.mark.parametrize(("kn", "unit"), [(1.0, 1.0), (7.0, 1.0), (1.0, 3.0)])
def test_the_largest_stable_step_of_a_lattice_in_closed_form(kn, unit):
    """All discs spin alike: slips of `2 r w` at three contacts a disc, `w^2 = 30 kt/m` at `2/5`."""
    law = LinearFrictional(kn, 2.0 * kn, 5.0)
    graph = triangles(law)
    state = start_state(graph.replace(x=unit * graph.x, x0=None, radii=unit * graph.radii,
                                      cell=unit * graph.cell, cell0=None))  # fmt: skip
    masses, inertias = masses_of(state.radii)
    # The branches are shorter than the diameters, by the overlap.
    expected = 2.0 / np.sqrt(30.0 * law.kt / masses[0] / 1.001**2)
    found = largest_step(masses, inertias, contacts_of(state, law))
    assert found == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("ratio", [0.5, 2.0])
def test_the_default_step_is_stable_whatever_the_shear_stiffness(ratio):
    """A lattice with a little spin comes to rest; in steps of `0.3 sqrt(m/kn)` it may blow up."""
    law = LinearFrictional(1.0, ratio, 1e3)
    spin, m = np.full(36, 1e-9), np.ones(36)
    start = {"mass": m, "spin": spin, "duration": 200.0}
    assert np.abs(replay(Scene(triangles(law), law), STILL, **start).spin).max() < 1e-12
    longer = replay(Scene(triangles(law), law), STILL, time_step=0.3, **start)
    assert (np.abs(longer.spin).max() > 1e-6) == (ratio == 2.0)


def test_a_collision_under_hertzs_law_in_closed_form():
    """Largest overlap `(5 m* v^2/(4 k))^(2/5)` and time of contact `2.9432 overlap/v`."""
    v, young, poisson, reduced = 1e-3, 2.0, 0.3, 0.5
    k = 4 / 3 * young / (2 * (1 - poisson**2)) * np.sqrt(0.25)
    largest = (5 * reduced * v**2 / (4 * k)) ** 0.4
    lasts = 2 * np.sqrt(np.pi) * math.gamma(0.4) / (5 * math.gamma(0.9)) * 2 * largest / v
    law, start = HertzMindlin(young, poisson, 0.5), {"mass": [1.0, 1.0], "damping": 0.0}
    start |= {"velocity": [[v, 0], [0, 0]], "time_step": lasts / 20_000}
    half = replay(Scene(pair(1.0), law), STILL, duration=lasts / 2, **start)
    assert half.state.normal_force[0] == pytest.approx(k * largest**1.5, rel=1e-6)
    early = replay(Scene(pair(1.0), law), STILL, duration=0.999 * lasts, **start)
    late = replay(Scene(pair(1.0), law), STILL, duration=1.001 * lasts, **start)
    assert early.state.normal_force[0] > 0 == late.state.normal_force[0]
    np.testing.assert_allclose(late.velocity, [[0, 0], [v, 0]], atol=1e-6 * v)


@pytest.mark.parametrize("history", ["force", "displacement"])
def test_shear_force_after_compression_is_what_the_contact_remembers(history):
    """`T` stays, or goes with `kt`, as the root of the overlap."""
    law = HertzMindlin(2.0, 0.3, 0.5, shear_history=history)
    graph = pair(0.99, normal_force=[law_force(law, 0.01)], shear_force=[1e-5])
    H = 1.0 - 0.98 / 0.99
    end = replay(
        Scene(graph, law), [[H, 0], [0, 0]], duration=1.0, mass=[1e9, 1e9], time_step=1e-2
    ).state
    assert end.normal_force[0] == pytest.approx(law_force(law, 0.02), rel=1e-6)
    grown = np.sqrt(2.0) if history == "displacement" else 1.0
    assert end.shear_force[0] == pytest.approx(1e-5 * grown, rel=1e-6)


def law_force(law, overlap):
    """Hertz's force of two grains of radius 0.5."""
    return 4 / 3 * law.young / (2 * (1 - law.poisson**2)) * 0.5 * overlap**1.5


@pytest.mark.parametrize("history", ["force", "displacement"])
def test_energy_of_a_packing_under_hertzs_law_closes_with_the_step_squared(history):
    """Work less springs and slip is the energy of motion; slip takes part."""
    law, left = HertzMindlin(5.0, 0.2, 0.3, "radii", history), []
    graph = jammed(16, 2)
    N = np.asarray(law.normal_force(contact_state(graph)))
    graph = graph.replace(normal_force=N, shear_force=np.clip(graph.shear_force, -0.2 * N, 0.2 * N))
    start = contacts_of(start_state(graph), law)
    masses, inertias = masses_of(graph.radii)
    rate, time = 1e-3 * np.array([1.0, 0.3, 0.0, -0.5]), 8.0
    for steps in (1000, 2000, 4000):
        servo = servo_of(start, masses)
        servo = steered(servo, start, np.zeros((4, 4)), np.eye(4), rate)
        moving = Moving(start, masses, inertias, lasting(servo, time))
        assert moving.run(steps, time / steps, 0.0)
        work = work_of(moving, moving.state())
        motion = moving.motion
        half = 0.5 * time / steps
        c = motion.velocity + half * motion.resultant[:, :2] / masses[:, None]
        w = motion.spin + half * motion.resultant[:, 2] / inertias
        kinetic = 0.5 * float(masses @ (c**2).sum(axis=1) + inertias @ w**2)
        assert work[1] > 0 and abs(work[2]) > 0
        left.append((work[3] - kinetic) / work[0])
    # Contacts that open, or start to slide, within a step leave less than the smooth part.
    assert abs(left[2]) < 5e-7 and abs(left[2]) < 0.3 * abs(left[0])


@pytest.mark.parametrize("increment", ["branch", "radii"])
def test_an_undamped_pair_rolls_in_closed_form(increment):
    """Spins against shear: `T = kt w a/W sin W t`, and the energy stays."""
    w, kn, kt, overlap = 1e-5, 2.0, 1.0, 1e-6
    graph, law = pair(1.0 - overlap), LinearFrictional(kn, kt, 50.0, increment)
    start = {"mass": [1.0, 1.0], "spin": [w, w], "damping": 0.0, "time_step": 1e-4}
    arm = 0.5
    Omega = np.sqrt(kt * (2.0 + 2 * arm**2 / 0.1))
    times = np.array([0.2, 0.4, 0.6]) * np.pi / Omega
    ends = [replay(Scene(graph, law), STILL, duration=t, **start) for t in times]
    shear = [end.state.shear_force[0] for end in ends]
    wanted = kt * 2 * arm * w / Omega * np.sin(Omega * times)
    # The first half step, and turning by the overlap's share.
    np.testing.assert_allclose(shear, wanted, rtol=3e-4)
    stored = kn * overlap**2 / 2
    for end in ends:
        N, T = end.state.normal_force[0], end.state.shear_force[0]
        moving = 0.5 * np.sum(end.velocity**2) + 0.5 * 0.1 * np.sum(end.spin**2)
        energy = N**2 / (2 * kn) + T**2 / (2 * kt) + moving
        assert energy - stored == pytest.approx(0.1 * w**2, rel=2e-3)


@pytest.mark.parametrize(("damping", "viscous"), [(0.3, 0.0), (0.0, 0.5)])
def test_damping_of_either_kind_takes_energy(damping, viscous):
    """A pair pressed together flies apart slower than without damping."""
    graph, law = pair(0.999), LinearFrictional(1.0, 0.5, 0.5)
    run = {"mass": [1.0, 1.0], "duration": 5.0, "time_step": 1e-3}
    free, damped = (
        replay(Scene(graph, law), STILL, damping=a, viscous=b, **run).velocity
        for a, b in ((0.0, 0.0), (damping, viscous))
    )
    assert np.abs(free).max() == pytest.approx(1e-3 / np.sqrt(2), rel=1e-4)
    assert 0 < np.abs(damped).max() < 0.95 * np.abs(free).max()


def test_the_cell_ends_where_it_was_asked_to():
    graph, H = packing(16), np.array([[2e-3, 1e-3], [-5e-4, -1e-3]])
    end = replay(Scene(graph, LAW), H, duration=20.0).state
    np.testing.assert_allclose(end.cell, (np.eye(2) - H) @ graph.cell, rtol=1e-12)


def driven(end, graph):
    """Displacement gradient and nominal stress at the end of a replay."""
    F = end.state.cell @ np.linalg.inv(graph.cell)
    return np.eye(2) - F, np.linalg.det(F) * end.state.stress @ np.linalg.inv(F).T


def strains_of(found, graph):
    """Displacement gradients at the rows of a replay."""
    return np.array([np.eye(2) - one.cell @ np.linalg.inv(graph.cell) for one in found.states])


def test_parts_of_a_straight_way_are_the_straight_way():
    """Cut where its velocity gradient leads, at any times that keep the speed."""
    graph = jammed(16, 2)
    H = np.array([[2e-3, 3e-4], [-1e-4, -1e-3]])
    steps = {"duration": 100.0, "time_step": 0.1}
    whole = replay(Scene(graph, LAW), H, **steps)
    ends = np.array([np.eye(2) - expm(t * logm(np.eye(2) - H)) for t in (0.25, 0.5, 1.0)])
    for how in ({}, {"shares": [0.25, 0.5, 1.0]}):
        parts = replay(Scene(graph, LAW), ends, **steps, **how)
        assert parts.steps == whole.steps
        np.testing.assert_allclose(parts.state.x, whole.state.x, rtol=0, atol=1e-11)
        for name in ("normal_force", "shear_force"):
            one, two = getattr(parts.state, name), getattr(whole.state, name)
            # Overlaps are differences of positions a thousand times as large; rounding of 1,000
            # steps is 1.3e-11 of the largest force on some processors.
            np.testing.assert_allclose(one, two, rtol=0, atol=5e-11 * np.abs(two).max())


def test_parts_are_reached_at_their_shares_and_take_times_as_their_strains():
    """There, a rest, and back: rows of the cell, and the default of as much time as strain."""
    graph = jammed(16, 2)
    H = np.array([[1e-3, 5e-4], [0.0, -4e-4]])
    found = replay(
        Scene(graph, LAW), [H, H, 0 * H], shares=[0.2, 0.6, 1.0], duration=200.0, rows=10
    )
    rows = strains_of(found, graph)
    size = np.linalg.norm(H)
    np.testing.assert_allclose(rows[[2, 4, 6]], [H, H, H], rtol=0, atol=1e-12)
    np.testing.assert_allclose(rows[[1, 8]], [H / 2, H / 2], rtol=0, atol=3e-3 * size)
    np.testing.assert_allclose(rows[[0, 10]], 0.0, atol=1e-12)
    # A third of the way takes a third of the time; the rate is that of the whole way.
    even = replay(Scene(graph, LAW), [H, 3 * H], inertial_number=1e-4, rows=3)
    np.testing.assert_allclose(strains_of(even, graph)[1], H, rtol=0, atol=3e-3 * size)
    longer = replay(Scene(graph, LAW), [2 * H, H], inertial_number=1e-4)
    assert longer.duration == pytest.approx(even.duration, rel=1e-3)
    assert replay(Scene(graph, LAW), H, inertial_number=1e-4).duration == pytest.approx(
        even.duration / 3, rel=1e-2
    )


def test_a_row_pressed_and_let_go_has_its_force_back():
    """Overlap of a row, at rest at the top of the way and at its end."""
    graph = GrainGraph(
        x=[[0, 0], [1, 0]], radii=[0.505] * 2, contacts=[[0, 1], [1, 0]], images=[[0, 0], [1, 0]],
        cell=[[2, 0], [0, 3]], normal_force=[0.01] * 2,
    )  # fmt: skip
    law = LinearFrictional(1.0, 0.5, 0.5)
    H = np.diag([1e-3, 0.0])
    found = replay(Scene(graph, law), [H, 0 * H], duration=1000.0, rows=2)
    top, end = (state.normal_force[:2] for state in found.states[1:])
    np.testing.assert_allclose(top, 0.011, rtol=1e-9)
    np.testing.assert_allclose(end, 0.01, rtol=1e-9)


@pytest.mark.parametrize("axis", [1, 2])
def test_simple_shear_keeps_the_area_and_all_but_one_strain(axis):
    """As a programme and as a strain: one way, and the shear stress rises with it."""
    graph, g = jammed(16, 2), 1e-3
    H = np.zeros((2, 2))
    H[axis - 1, 2 - axis] = g
    stage = Stage(simple_shear(axis), "parameter", g)
    one, two = (replay(Scene(graph, LAW), way, duration=2000.0) for way in (stage, H))
    for found in (one, two):
        np.testing.assert_allclose(strains_of(found, graph)[-1], H, rtol=0, atol=1e-9)
        assert np.linalg.det(found.state.cell) == pytest.approx(np.linalg.det(graph.cell))
    stresses = [found.state.stress for found in (one, two)]
    np.testing.assert_allclose(*stresses, rtol=0, atol=1e-4 * np.abs(stresses[0]).max())
    path = follow(Scene(graph, LAW), stage, closure="packing", interval=1e-5)
    np.testing.assert_allclose(path.H[-1], H.ravel(), rtol=0, atol=1e-10)
    rise = one.state.stress - one.states[0].stress
    assert rise[0, 1] > 0 and rise[1, 0] > 0
    told = path.states[-1].stress - path.states[0].stress
    np.testing.assert_allclose(told, rise, rtol=0, atol=0.02 * np.abs(rise).max())


def test_stress_control_of_a_row_in_closed_form():
    """Discs in a row carry `P11 = N/h22`, `N = N0 + kn H11 d`, at rest whatever the masses."""
    d, overlap, kn = 0.99, 0.01, 2.0
    row = GrainGraph(x=[[0, 0], [d, 0]], radii=[0.5] * 2, contacts=[[0, 1], [1, 0]],
                     images=[[0, 0], [1, 0]], cell=np.diag([2 * d, 3.0]),
                     normal_force=[kn * overlap] * 2)  # fmt: skip
    stress, strain = np.diag([1.0, 0, 0, 0]), np.diag([0, 1.0, 1, 1])
    stage = Stage(combination(stress, strain, [1e-4, 0, 0, 0]), "parameter", 3.0)
    H, P = driven(replay(Scene(row, LinearFrictional(kn, 1.0, 0.5)), stage, duration=1e3), row)
    assert P[0, 0] == pytest.approx(kn * overlap / 3 + 3e-4, rel=1e-9)
    assert H[0, 0] == pytest.approx(3e-4 * 3 / (kn * d), rel=1e-9)
    assert np.abs(H.ravel()[1:]).max() == 0


def test_a_servo_holds_what_the_path_holds():
    """Drained: strain and stress approach those of the quasi-static path as the rate falls."""
    graph, quiet = jammed(16, 2), {"damping": 0.3, "viscous": 0.05}
    stage = Stage(drained_biaxial(2, -1.0), "H22", -2e-3)
    path = follow(Scene(graph, LAW), stage, closure="packing", interval=2e-5)
    assert path.status == "finished" and len(path.events) > 0
    off = []
    for duration in (5e3, 5e4):
        H, P = driven(replay(Scene(graph, LAW), stage, duration=duration, **quiet), graph)
        assert H[1, 1] == pytest.approx(-2e-3, rel=1e-11) and H[0, 1] == H[1, 0] == 0
        assert P[0, 0] == pytest.approx(path.P[0, 0], rel=1e-5)
        off.append(np.abs(np.array([H[0, 0], P[1, 1]]) / [path.H[-1, 0], path.P[-1, 3]] - 1).max())
    assert off[1] < 2e-4 and off[1] < off[0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"law": RollingResistance(RollingResistance(LAW, 0.1), 0.1)},
            "at most one spring for rolling",
        ),
        ({"strain": [[1.5, 0], [0, 0]]}, "strain"),
        ({"strain": np.zeros((0, 2, 2))}, "strain"),
        ({"strain": np.zeros((2, 2, 2)), "shares": [0.5, 0.9]}, "2 numbers that rise to 1"),
        (
            {"strain": np.zeros((2, 2, 2)), "shares": [1.0]},
            r"shares: got shape \(1,\), expected shape \(2,\)",
        ),
        ({"strain": np.zeros((2, 2, 2)), "shares": [0.0, 1.0]}, "2 numbers that rise to 1"),
        ({"mass": [1.0]}, "mass"),
        ({"damping": -1}, "damping"),
        ({"inertial_number": 0}, "inertial_number"),
        ({"rows": 0}, "rows"),
        ({"strain": Stage(isotropic_stress(), "P11", 1.0)}, "P11 at the end, expected 'parameter'"),
        ({"strain": Stage(drained_biaxial(1), "H22", 1.0)}, "H22 at the end, expected 'parameter'"),
        ({"strain": Stage(drained_biaxial(1), "H11", -1e-4)}, "a target that lies ahead"),
        ({"graph": pair(0.99).replace(cell=None, cell0=None, images=None)}, "no walls"),
    ],
)
def test_bad_input(change, message):
    given = {"graph": packing(12), "law": LAW, "strain": 1e-5 * np.eye(2)} | change
    with pytest.raises(InputError, match=message):
        replay(Scene(given.pop("graph"), given.pop("law")), given.pop("strain"), **given)


def test_yades_next_state_of_the_sample_series():
    """Started at rest with unit density at the run's rate, without the velocities of Yade."""
    cells = sample_path("slow/cells.csv")
    one, two = (
        read_snapshot(
            cells.parent / f"grains_{k}.parquet",
            cell=np.reshape(rows_by_number(cells)[k], (2, 2)),
            shear_increment="radii",
        )
        for k in (10, 11)
    )
    end = replay(Scene(one.graph, one.law), strain_between(one, two), inertial_number=2e-6)
    assert predicted(one, two, lambda f: loop_changes(one.graph, end.state, f)) > 0.9995
    assert end.state.unbalanced < 1.5e-4


@pytest.mark.slow
@in_collection
@pytest.mark.parametrize("number", [10, 24])
def test_strain_ratio_of_yades_sample(number):
    """`P11` held and `H22` driven, as the sample was: `H11'/H22'` from rest, at the run's rate."""
    (one, _), (two, _) = slow(number), slow(number + 1)
    strain = strain_between(one, two)
    stage = Stage(drained_biaxial(2), "H22", strain[1, 1])
    H, _ = driven(replay(Scene(one.graph, one.law), stage), one.graph)
    assert H[0, 0] / H[1, 1] == pytest.approx(strain[0, 0] / strain[1, 1], rel=0.006)


@pytest.mark.slow
@in_collection
@pytest.mark.parametrize(("numbers", "least"), [(range(3, 22), 0.999), (range(22, 32), 0.998)])
def test_yades_next_states(numbers, least):
    """Steps of 2e-5 and 1e-4 with Yade's own velocities, time step and damping."""
    dt = json.loads((COLLECTION / "params.json").read_text())["dt"]
    found = []
    for number in numbers:
        (one, t), (two, later) = slow(number), slow(number + 1)
        H = strain_between(one, two)
        grains = pd.read_parquet(COLLECTION / f"grains_{number:02d}.parquet")
        grains = grains.set_index("id").loc[one.ids]
        end = replay(
            Scene(one.graph, one.law),
            H,
            duration=later - t,
            time_step=dt,
            mass=grains["mass"],
            velocity=grains[["vx", "vy"]].to_numpy() + one.graph.x @ H.T / (later - t),
            spin=grains["omega_z"],
        )
        changes = lambda f, one=one, end=end: loop_changes(one.graph, end.state, f)  # noqa: E731
        found.append(predicted(one, two, changes))
    assert np.mean(found) > least
