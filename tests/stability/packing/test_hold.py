"""Packings brought to rest: closed forms, balance by another sum, walls, held stress."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from grainloops import hold
from loops import (
    GrainGraph,
    InputError,
    LinearFrictional,
    PlaneContacts,
    Scene,
    contact_forces,
    love_weber_stress,
    match_contacts,
)
from patterns import read_snapshot, sample_path
from patterns.snapshots.walls import box_area
from stability.packing import equations_of_motion
from tests.packings import jammed
from tests.stability.packing.walled_packings import between


def resultants(graph, planes=None):
    """(G, 3) forces and moments of all contacts, one by one."""
    total = np.zeros((graph.grain_count, 3))
    images = np.zeros((graph.contact_count, 2)) if graph.images is None else graph.images
    cell = np.zeros((2, 2)) if graph.cell is None else graph.cell
    for (i, j), image, N, T in zip(
        graph.contacts, images, graph.normal_force, graph.shear_force, strict=True
    ):
        d = graph.x[j] + cell @ image - graph.x[i]
        length = np.hypot(*d)
        n = d / length
        f = N * n + T * np.array([-n[1], n[0]])
        arm = 0.5 * (length + graph.radii[i] - graph.radii[j])
        total[j, :2] += f
        total[i, :2] -= f
        total[i, 2] -= arm * T
        total[j, 2] -= (length - arm) * T
    if planes is not None:
        for g, f, b in zip(planes.grain, planes.force, planes.branch, strict=True):
            total[g, :2] += f
            total[g, 2] += b[0] * f[1] - b[1] * f[0]
    return total


def unbalanced(held):
    left = np.linalg.norm(resultants(held.graph, held.boundary.walls)[:, :2], axis=1)
    return left.mean() / np.hypot(held.graph.normal_force, held.graph.shear_force).mean()


def walled_sample():
    snapshot = read_snapshot(sample_path())
    walls = snapshot.walls
    planes = PlaneContacts(walls.grain, -walls.branch, walls.kn, walls.kt)
    area = box_area(snapshot.graph.x, walls)
    return snapshot, between(planes, walls.force, volume=area)


def moving_sample(number=10):
    """A sample of the slow series, and its grains' unit of force."""
    cells = np.genfromtxt(sample_path("slow/cells.csv"), delimiter=",", names=True)
    row = cells[[int(k) for k in cells[cells.dtype.names[0]]].index(number)]
    cell = np.reshape([row[name] for name in ("h_xx", "h_xy", "h_yx", "h_yy")], (2, 2))
    path = sample_path(f"slow/grains_{number}.parquet")
    return read_snapshot(path, cell=cell, shear_increment="radii")


def test_a_periodic_sample_comes_to_rest_at_its_cell():
    snapshot = moving_sample()
    held = hold(Scene(snapshot.graph, snapshot.law))
    assert held.status == "at rest" and held.unbalanced <= 1e-6
    # By another sum than the kernel's.
    assert unbalanced(held) == pytest.approx(held.unbalanced, rel=1e-6)
    assert held.unbalanced_before == pytest.approx(8e-5, rel=0.3)
    np.testing.assert_allclose(held.graph.cell, snapshot.graph.cell, rtol=0, atol=1e-15)
    assert np.abs(held.strain).max() < 1e-13
    np.testing.assert_allclose(held.stress, love_weber_stress(held.graph), rtol=1e-12)
    np.testing.assert_allclose(held.stress_before, love_weber_stress(snapshot.graph), rtol=1e-9)
    # Near its equilibrium before, it stays there, whatever the damping.
    assert held.forces_changed < 2e-3 and held.spread < 1e-3
    assert held.strain_spread == 0.0
    overlap = held.graph.radii[held.graph.contacts].sum(axis=1) - np.linalg.norm(
        branches(held.graph), axis=1
    )
    np.testing.assert_allclose(held.graph.normal_force, held.law.kn * overlap, rtol=1e-9)
    assert (np.abs(held.graph.shear_force) <= 0.5 * held.graph.normal_force * (1 + 1e-12)).all()
    assert held.graph.contact_count == snapshot.graph.contact_count + held.gained - held.lost


def branches(graph):
    i, j = graph.contacts.T
    return graph.x[j] + graph.images @ graph.cell.T - graph.x[i]


def test_held_stress_stays_and_the_cell_gives_way():
    graph, law = jammed(24, 3), LinearFrictional(1.0, 0.5, 0.5, "radii")
    kicked = 2e-3 * np.random.default_rng(1).standard_normal((24, 2))
    held = hold(Scene(graph, law), control="stress", velocity=kicked)
    assert held.status == "at rest"
    assert unbalanced(held) < 1.01e-6
    assert held.forces_changed > 1e-3
    # The nominal stress, over the first cell.
    F = held.graph.cell @ np.linalg.inv(graph.cell)
    after = np.linalg.det(F) * held.stress @ np.linalg.inv(F).T
    before, size = held.stress_before, np.linalg.norm(held.stress_before)
    assert np.abs(np.diag(after - before)).max() < 2e-6 * size
    assert abs(after[0, 1] + after[1, 0] - before[0, 1] - before[1, 0]) < 4e-6 * size
    assert 1e-6 < np.abs(held.strain).max() < 1e-2
    assert abs(held.strain[0, 1] - held.strain[1, 0]) < 1e-9


def test_the_strain_under_a_held_stress_says_what_it_hangs_on(monkeypatch):
    """Runs with the other damping and with other lags, each on its own, differ by no more."""
    graph, law = jammed(36, 5), LinearFrictional(1.0, 0.5, 0.5, "radii")
    pushed = graph.replace(shear_force=0.9 * graph.shear_force)
    how = {"control": "stress"}
    held, turned = (
        hold(Scene(pushed, law), damping=two, **how) for two in ((0.2, 0.4), (0.4, 0.2))
    )
    size, apart = np.linalg.norm(held.strain), [turned.strain - held.strain]
    for times in (3.0, 1.0 / 3.0):
        with monkeypatch.context() as patch:
            patch.setattr(equations_of_motion, "LAG", times * equations_of_motion.LAG)
            apart.append(hold(Scene(pushed, law), **how).strain - held.strain)
    other, slow, quick = np.linalg.norm(apart, axis=(1, 2)) / size
    # The lag is rounded otherwise here: 3e-7 of the difference.
    assert held.strain_spread == pytest.approx(max(other, slow), rel=1e-5)
    assert held.strain_spread == pytest.approx(0.075, rel=0.05)
    assert quick < 1e-3 and held.spread < 1e-6
    assert f"spread {100 * held.strain_spread:.2g} %" in str(held)


def test_a_sample_between_walls_comes_to_rest_with_its_walls():
    snapshot, walls = walled_sample()
    held = hold(Scene(snapshot.graph, snapshot.law, walls))
    assert held.status == "at rest"
    assert unbalanced(held) == pytest.approx(held.unbalanced, rel=1e-6)
    assert held.graph.cell is None and held.graph.images is None
    total, planes = love_weber_stress(held.graph, walls.volume), held.boundary.walls
    total = total - planes.force.T @ planes.branch / walls.volume
    np.testing.assert_allclose(held.stress, total, rtol=1e-12)
    # The walls push against each other: opposite resultants are equal.
    force, n = planes.force, -planes.branch
    for axis in (0, 1):
        along = np.abs(n[:, axis]) > 0.5 * np.linalg.norm(n, axis=1)
        pushes = force[along, axis]
        assert abs(pushes.sum()) < 1e-4 * np.abs(pushes).sum()
    assert held.spread < 0.05


def test_a_disc_between_four_walls_finds_its_place():
    # Springs of unlike stiffness: kn_left (r - x) = kn_right (r - (w - x)).
    graph = GrainGraph(
        x=[[0.49, 0.5], [0.49, 1.49]], radii=[0.5, 0.5], contacts=[[0, 1]], normal_force=[0.01]
    )
    grain = np.array([0, 0, 0, 1, 1, 1])
    branch = np.array(
        [[-0.49, 0.0], [0.48, 0.0], [0.0, -0.5], [-0.49, 0.0], [0.48, 0.0], [0.0, 0.48]]
    )
    planes = PlaneContacts(grain, branch, np.array([2.0, 1.0, 1.0, 2.0, 1.0, 1.0]), np.zeros(6))
    held = hold(Scene(graph, LinearFrictional(1.0, 0.5, 0.0), between(planes, volume=0.97 * 1.97)))
    assert held.status == "at rest"
    # 2 (.5 - x) = .5 - (.97 - x), and three springs of 1 in a row of length 1.97.
    np.testing.assert_allclose(held.graph.x[:, 0], 1.47 / 3.0, atol=1e-7)
    np.testing.assert_allclose(held.graph.x[:, 1], [0.49, 1.48], atol=1e-7)
    np.testing.assert_allclose(held.graph.normal_force, 0.01, atol=1e-8)


def test_discs_between_rough_walls_turn_and_move_as_their_springs_say():
    # A row between two smooth walls, under a rough ceiling and on a rough floor; contacts between
    # the discs slide freely. The floor pushes the first disc besides.
    arm, kt, push = 0.49, 0.5, 3e-4
    graph = GrainGraph(
        x=[[0.0, 0.49], [0.99, 0.49], [1.98, 0.49]], radii=[0.5] * 3, contacts=[[0, 1], [1, 2]],
        normal_force=[0.01] * 2,
    )  # fmt: skip
    grain = np.array([0, 0, 1, 1, 2, 2, 0, 2])
    branch = np.array([[0.0, -arm], [0.0, arm]] * 3 + [[-arm, 0.0], [arm, 0.0]])
    stiffness = np.ones(8), np.append(np.full(6, kt), [0.0, 0.0])
    force = -0.01 * branch / arm
    force[0, 0] = push
    planes = PlaneContacts(grain, branch, *stiffness)
    held = hold(Scene(graph, LinearFrictional(1.0, 0.5, 0.0), between(planes, force, volume=2.9)))
    assert held.status == "at rest"
    # Floor: T = -push + kt (u + arm w), ceiling: T = -kt (u - arm w); force on the disc, moment.
    K = np.zeros((6, 6))
    for k in range(3):
        K[k, k], K[3 + k, 3 + k] = -2.0 * kt, -2.0 * kt * arm
    K[:3, :3] -= np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]])
    u, w = np.split(np.linalg.solve(K, [-push, 0, 0, -push, 0, 0]), 2)
    np.testing.assert_allclose(held.graph.x[:, 0] - graph.x[:, 0], u, atol=1e-3 * push)
    floor, ceiling = -push * np.array([1, 0, 0]) + kt * (u + arm * w), -kt * (u - arm * w)
    walls = held.boundary.walls
    along = walls.force[:, 0]
    shear = {
        (int(g), bool(b[1] < 0)): f
        for g, b, f in zip(walls.grain, walls.branch, along, strict=True)
        if b[1] != 0
    }
    np.testing.assert_allclose([shear[g, True] for g in range(3)], -floor, atol=1e-3 * push)
    np.testing.assert_allclose([shear[g, False] for g in range(3)], ceiling, atol=1e-3 * push)


def test_a_packing_that_loses_its_friction_flows_under_its_stress():
    graph, law = jammed(24, 3), LinearFrictional(1.0, 0.5, 0.01, "radii")
    squeezed = graph.replace(shear_force=0.5 * np.sign(graph.shear_force) * graph.normal_force)
    held = hold(Scene(squeezed, law), control="stress", most_steps=20_000)
    assert held.status == "flows"
    assert np.linalg.norm(held.strain) > 0.05


def test_a_hold_that_is_cut_short_says_so():
    snapshot = moving_sample()
    held = hold(Scene(snapshot.graph, snapshot.law), most_steps=1)
    assert held.status == "not at rest" and held.unbalanced > 1e-6


def test_where_one_damping_alone_comes_to_rest_its_state_is_the_answer():
    """With next to no damping it does not come to rest in these steps."""
    graph, law = jammed(24, 3), LinearFrictional(1.0, 0.5, 0.5, "radii")
    kicked = 2e-3 * np.random.default_rng(1).standard_normal((24, 2))
    options = {"velocity": kicked, "most_steps": 4000, "unbalanced": 1e-6}
    slow = hold(Scene(graph, law), damping=(0.001, 0.002), **options)
    found = hold(Scene(graph, law), damping=(0.001, 0.4), **options)
    assert slow.status == slow.other_status == "not at rest" and slow.damping == 0.001
    assert (found.status, found.other_status, found.damping) == ("at rest", "not at rest", 0.4)
    assert "at rest with damping 0.4 (other damping: not at rest)" in str(found)
    alone = hold(Scene(graph, law), damping=(0.4, 0.4), **options)
    np.testing.assert_array_equal(found.graph.normal_force, alone.graph.normal_force)
    assert found.unbalanced == alone.unbalanced < 1e-6 < slow.unbalanced


@pytest.mark.parametrize(
    "options, told",
    [
        ({"control": "force"}, "control"),
        ({"unbalanced": 0.0}, "unbalanced"),
        ({"damping": (0.0, 0.4)}, "damping"),
        ({"damping": (0.2, 1.5)}, "damping"),
        ({"mass": [-1.0] * 600}, "mass"),
        ({"boundary": {"volume": None}}, "no volume"),
        ({"control": "stress"}, "stress"),
        ({"boundary": {"walls": None}}, "no cell"),
    ],
)
def test_bad_input_is_one_clear_error(options, told):
    snapshot, walls = walled_sample()
    boundary = replace(walls, **options.get("boundary", {}))
    asked = {name: one for name, one in options.items() if name != "boundary"}
    with pytest.raises(InputError, match=told):
        hold(Scene(snapshot.graph, snapshot.law, boundary), **asked)


def test_a_packing_without_contact_force_is_refused():
    row = GrainGraph(
        x=[[0, 0], [1, 0]], radii=[0.5] * 2, contacts=[[0, 1], [1, 0]], images=[[0, 0], [1, 0]],
        cell=[[2, 0], [0, 3]], normal_force=[0.0, 0.0],
    )  # fmt: skip
    with pytest.raises(InputError, match="hold: got no contact force"):
        hold(Scene(row, LinearFrictional(1.0, 0.5, 0.5)))


def test_yade_holds_a_moving_state_to_the_same_forces():
    # Yade 2023.02a, 2000 discs 50 steps after a restart, held at fixed cell with damping 0.4:
    # spheres of density 2600, moments of inertia 2/5 m r^2.
    with np.load(Path(__file__).with_name("yade_held.npz")) as stored:
        yade = dict(stored)
    graph = GrainGraph(
        **{name: yade[name] for name in ("x", "radii", "images", "cell")},
        **{name: yade[name] for name in ("contacts", "normal_force", "shear_force")},
    )
    at_rest = GrainGraph(
        x=yade["x"], radii=yade["radii"], contacts=yade["held_contacts"], cell=yade["cell"],
        images=yade["held_images"], normal_force=yade["held_normal_force"],
        shear_force=yade["held_shear_force"],
    )  # fmt: skip
    mass = 4.0 / 3.0 * np.pi * 2600.0 * graph.radii**3
    held = hold(
        Scene(graph, LinearFrictional(1e6, 5e5, 0.5, "radii")),
        damping=(0.4, 0.2),
        mass=mass,
        velocity=yade["velocity"],
        spin=yade["spin"],
    )
    assert held.status == "at rest"
    assert held.unbalanced_before == pytest.approx(6.8e-3, rel=0.01)
    ids = np.arange(graph.grain_count)
    found, known = held.graph, at_rest
    match = match_contacts(found, ids, known, ids)
    both = match.shared
    assert len(both) == found.contact_count == known.contact_count
    sign = np.where(match.reversed[both], -1.0, 1.0)[:, None]
    ours, theirs = contact_forces(found)[both], sign * contact_forces(known)[match.after[both]]
    moved = np.linalg.norm(contact_forces(known) - _first_forces(graph, known, ids))
    # Steps are alike, rounding and where the damping ends are not.
    assert np.linalg.norm(ours - theirs) < 3e-4 * np.linalg.norm(theirs)
    assert np.linalg.norm(ours - theirs) < 0.1 * moved
    strength = 0.5 * known.normal_force[match.after[both]]
    slides = np.abs(known.shear_force[match.after[both]]) >= 0.999 * strength
    assert held.sliding == pytest.approx(np.count_nonzero(slides), abs=2)
    assert held.stress == pytest.approx(love_weber_stress(known), rel=3e-5, abs=5e-3)


def _first_forces(graph, known, ids):
    """Forces of the start on the contacts that are known at the end; zero of new ones."""
    match = match_contacts(known, ids, graph, ids)
    forces = np.zeros((known.contact_count, 2))
    both = match.shared
    sign = np.where(match.reversed[both], -1.0, 1.0)[:, None]
    forces[both] = sign * contact_forces(graph)[match.after[both]]
    return forces


def test_yade_holds_a_state_under_way_from_rest_to_the_same_forces():
    # Yade 2023.02a, 500 discs of yade_dense.py (seed 31) after a restart by yade_restart.py.
    with np.load(Path(__file__).with_name("yade_held_dense.npz")) as stored:
        yade = dict(stored)
    names = ("contacts", "images", "normal_force", "shear_force")
    same = {name: yade[name] for name in ("x", "radii", "cell")}
    graph = GrainGraph(**same, **{name: yade[name] for name in names})
    known = GrainGraph(**same, **{name: yade[f"held_{name}"] for name in names})
    mass = 4.0 / 3.0 * np.pi * 2600.0 * graph.radii**3
    held = hold(
        Scene(graph, LinearFrictional(1e6, 5e5, 0.5, "radii")), damping=(0.4, 0.2), mass=mass
    )
    assert held.status == "at rest"
    ids = np.arange(graph.grain_count)
    assert held.graph.contact_count == known.contact_count
    ours, theirs = _first_forces(held.graph, known, ids), contact_forces(known)
    moved = np.linalg.norm(theirs - _first_forces(graph, known, ids))
    # The two dampings of `hold` are further apart: 0.7 % of the forces.
    assert np.linalg.norm(theirs - ours) < 4e-3 * np.linalg.norm(theirs)
    assert np.linalg.norm(theirs - ours) < 0.1 * moved
    slides = np.abs(known.shear_force) >= 0.999 * 0.5 * known.normal_force
    assert held.sliding == pytest.approx(np.count_nonzero(slides), abs=2)
    off = held.stress - love_weber_stress(known)
    assert np.linalg.norm(off) < 5e-4 * np.linalg.norm(held.stress)
