"""Grains that carry nothing: in cages with room and without, at walls, in any units and numbers."""

from dataclasses import replace

import numpy as np
import pytest

from loops import GrainGraph, HertzMindlin, LinearFrictional, PlaneContacts, Scene
from stability import Stage, follow, programmes
from stability.compiled.cages import normals_and_overlaps, parting_and_slip, work_of_shear
from stability.packing import rattlers
from stability.packing.path import PackingPathOptions, PackingPathSolver
from stability.packing.rattlers import (
    CAUGHT_SHARE,
    IN_BALANCE,
    LOADED_SHARE,
    _held,
    carrying_nothing,
    free_rattlers,
    share_until_caught,
)
from tests.packings import contacts_of, jammed, start_state, strained
from tests.stability.packing.walled_packings import between

LAW = LinearFrictional(1.0, 0.5, 0.5)
LARGE, FORCE = 0.505, 0.01
# Radius of the disc that touches all four of a square of spacing 1.
ROOM = np.sqrt(0.5) - LARGE
LATTICE = (
    [[0, 1], [1, 0], [2, 3], [3, 2], [0, 2], [2, 0], [1, 3], [3, 1]],
    [[0, 0], [1, 0], [0, 0], [1, 0], [0, 0], [0, 1], [0, 0], [0, 1]],
)


def caged(small, at, unit=1.0, force=1.0, law=None):
    """A square lattice of four discs with small ones in the first square."""
    small, at = np.atleast_1d(small), np.atleast_2d(at)
    contacts, images = (list(part) for part in LATTICE)
    for k in range(len(small)):
        contacts += [[g, 4 + k] for g in [*range(4), *range(4, 4 + k)]]
    images += [[0, 0]] * (len(contacts) - len(images))
    graph = GrainGraph(
        x=unit * np.vstack([[[0, 0], [1, 0], [0, 1], [1, 1]], at]),
        radii=unit * np.append([LARGE] * 4, small),
        contacts=contacts,
        images=images,
        cell=2 * unit * np.eye(2),
        normal_force=force * np.append([FORCE] * 8, np.zeros(len(contacts) - 8)),
    )
    law = LinearFrictional(force / unit, 0.5 * force / unit, 0.5) if law is None else law
    return contacts_of(start_state(graph), law)


def lattice_around(small, at):
    """The lattice and small grains that are not in its contacts."""
    return GrainGraph(
        x=np.vstack([[[0, 0], [1, 0], [0, 1], [1, 1]], at]), radii=[*[LARGE] * 4, *small],
        contacts=LATTICE[0], images=LATTICE[1], cell=2 * np.eye(2), normal_force=[FORCE] * 8,
    )  # fmt: skip


def of_small(state, first=4):
    """Rows of pairs with small grains, and their overlaps."""
    rows = np.flatnonzero((state.contacts[:, :2] >= first).any(axis=1))
    return rows, state.overlap[rows]


@pytest.mark.parametrize("aside", [(1e-3, 0.0), (7e-4, 5e-4), (-1e-4, 2e-4)])
def test_a_grain_with_room_moves_out_of_overlap_and_carries_nothing(aside):
    """Its cage has room of 1e-4 around it; the others stay."""
    state = caged(ROOM - 1e-4, 0.5 + np.array(aside))
    freed = free_rattlers(state)
    rows, overlap = of_small(freed.state)
    assert freed.rattlers.tolist() == [False] * 4 + [True]
    assert overlap.max() <= 0 and not freed.state.normal_force[rows].any()
    np.testing.assert_array_equal(freed.state.x[:4], state.x[:4])
    np.testing.assert_array_equal(freed.state.normal_force[:8], state.normal_force[:8])
    # Not beyond what the overlaps ask for.
    assert np.linalg.norm(freed.state.x[4] - state.x[4]) < 2 * np.linalg.norm(aside)
    assert freed.released == 0.0


@pytest.mark.parametrize("aside", [(0.0, 0.0), (5e-4, 0.0), (3e-4, -6e-4)])
@pytest.mark.parametrize("too_large", [1e-3, 1e-4])
def test_a_grain_without_room_is_loaded_in_balance(too_large, aside):
    """Without friction it ends in the middle, where all four press alike by its overlap."""
    state = caged(ROOM + too_large, 0.5 + np.array(aside), law=LinearFrictional(1.0, 0.5, 0.0))
    freed = free_rattlers(state)
    rows, overlap = of_small(freed.state)
    assert not freed.rattlers.any()
    np.testing.assert_allclose(freed.state.x[4], 0.5, rtol=0, atol=1e-3 * too_large)
    np.testing.assert_allclose(overlap, too_large, rtol=2e-3)
    np.testing.assert_array_equal(freed.state.normal_force[rows], overlap)
    assert np.abs(freed.state.resultants[4]).max() < 2e-3 * too_large
    # It has the energy of its overlaps from now on.
    assert freed.released == pytest.approx(-0.5 * np.sum(overlap**2), rel=1e-12)


@pytest.mark.parametrize("power", [1.0, 1.5])
@pytest.mark.parametrize("stiff", [(3.0, 2.0), (1.0, 0.2)])
def test_springs_that_stiffen_balance_a_grain_without_room_too(power, stiff):
    """Between two pairs of discs across, of which the first ones are stiffer: in closed form.

    `k d^p` is the same on both sides of a pair, with `d` of them together twice the overlap.
    """
    k, overlap = np.array([*[1.0] * 8, *stiff, 1.0, 1.0]), 1e-4
    law = LinearFrictional(k, 0.0, 0.0) if power == 1.0 else HertzMindlin(400.0 * k, 0.0, 0.0)
    freed = free_rattlers(caged(ROOM + overlap, [0.5 + 2e-5, 0.5], law=law))
    ratio = np.array(stiff) ** (1.0 / power)
    ends = 2.0 * overlap / (1.0 + np.concatenate([ratio, 1.0 / ratio[::-1]]))
    assert not freed.rattlers.any()
    np.testing.assert_allclose(of_small(freed.state)[1], ends, rtol=1e-3)
    N = freed.state.normal_force[8:]
    assert np.abs(freed.state.resultants[4]).max() < 1e-6 * N.max()


@pytest.mark.parametrize("aside", [(5e-4, 0.0), (3e-4, -6e-4)])
def test_friction_keeps_a_grain_without_room_where_it_is_loaded(aside):
    """Not in the middle, but in balance, with shear forces within the limit."""
    state = caged(ROOM + 1e-3, 0.5 + np.array(aside))
    freed = free_rattlers(state).state
    N, T = freed.normal_force[8:], freed.shear_force[8:]
    assert np.abs(freed.x[4] - 0.5).max() > 1e-4 and np.abs(T).max() > 0.1 * N.max()
    assert (np.abs(T) <= 0.5 * N * (1 + 1e-9)).all()
    assert np.abs(freed.resultants[4]).max() < 2e-3 * N.max()


@pytest.mark.parametrize("mu", [0.3, 0.5])
@pytest.mark.parametrize("degrees", [1.0, 10.0, 16.0, 17.5, 26.0, 27.0, 40.0])
def test_friction_holds_a_grain_between_two_whose_contacts_lie_in_its_cone(degrees, mu):
    """Held up to the angle of friction, with T = N tan(angle); beyond it slips out.

    Springs in series: a lateral way u takes u sin from the overlaps and shears by u cos, so
    N = kn kt overlap cos^2 / (kn sin^2 + kt cos^2).
    """
    angle, overlap, r = np.radians(degrees), 1e-5, 0.1
    reach = (LARGE + r - overlap) * np.array([np.cos(angle), np.sin(angle)])
    # The two stand in columns of two.
    graph = GrainGraph(
        x=[[0, 0], [2 * reach[0], 0], reach, [0, 1], [2 * reach[0], 1]],
        radii=[LARGE, LARGE, r, LARGE, LARGE],
        contacts=[[0, 3], [3, 0], [1, 4], [4, 1], [2, 0], [1, 2]],
        images=[[0, 0], [0, 1], [0, 0], [0, 1], [0, 0], [0, 0]],
        normal_force=[FORCE] * 4 + [0, 0], cell=[[10, 0], [0, 2]],
    )  # fmt: skip
    state = start_state(graph)
    law = LinearFrictional(1.0, 0.5, mu)
    freed = free_rattlers(contacts_of(state, law), np.arange(5) == 2).state
    N, T = freed.normal_force[4:], freed.shear_force[4:]
    if np.tan(angle) > mu:
        assert not N.any() and not T.any()
        return
    sin, cos = np.sin(angle), np.cos(angle)
    np.testing.assert_allclose(N, 0.5 * overlap * cos**2 / (sin**2 + 0.5 * cos**2), rtol=1e-4)
    np.testing.assert_allclose(np.abs(T), np.tan(angle) * N, rtol=1e-4)
    assert np.abs(freed.resultants[2]).max() < 1e-4 * N.max()


def chain_of_two(degrees, second, overlap):
    """Two discs between two others: an arch, or with the second one below the line."""
    angle, r = np.radians(degrees), 0.1
    up = np.array([np.cos(angle), np.sin(angle)])
    first = (LARGE + r - overlap) * up
    turn = 0.0 if second == "above" else 2.0 * np.arcsin(first[1] / (2 * r - overlap))
    between = (2 * r - overlap) * np.array([np.cos(0.5 * turn), -np.sin(0.5 * turn)])
    last = -angle if second == "above" else 1.5 * angle
    end = first + between + (LARGE + r - overlap) * np.array([np.cos(last), np.sin(last)])
    graph = GrainGraph(
        x=[[0, 0], end, first, first + between, [0, 1], end + np.array([0, 1])],
        radii=[LARGE, LARGE, r, r, LARGE, LARGE],
        contacts=[[0, 4], [4, 0], [1, 5], [5, 1], [2, 0], [2, 3], [1, 3]],
        images=[[0, 0], [0, 1], [0, 0], [0, 1], [0, 0], [0, 0], [0, 0]],
        normal_force=[FORCE] * 4 + [0] * 3, cell=[[10, 0], [0, 2]],
    )  # fmt: skip
    return contacts_of(start_state(graph), LinearFrictional(1.0, 0.5, 0.7))


@pytest.mark.parametrize("degrees", [0.0, 0.5, 2.0, 10.0])
@pytest.mark.parametrize("second", ["above", "below"])
def test_friction_holds_no_chain_of_two_grains(second, degrees):
    """Six forces, six balances: an arch of two carries nothing, however flat, and rolls away.

    So does one with the second disc below the line, where the three contacts are not in a line.
    """
    overlap = 1e-5
    state = chain_of_two(degrees, second, overlap)
    freed = free_rattlers(state, np.isin(np.arange(6), [2, 3])).state
    assert state.overlap[4:] == pytest.approx([overlap] * 3, rel=1e-6)
    assert not freed.normal_force[4:].any() and not freed.shear_force.any()
    assert freed.overlap[4:].max() < 1e-3 * overlap


# A disc of three contacts and one of two that presses it, between three others that stand.
ARCH_NORMALS = [[0.957, -0.290], [0.0136, 1.0], [0.358, -0.934], [-0.585, 0.811]]
ARCH_ENDS = np.array([[0, 2], [2, 1], [2, 3], [4, 3]])


def arch(law):
    """Two discs of an arch, of which the fourth contact is open at first."""
    n = np.array(ARCH_NORMALS) / np.linalg.norm(ARCH_NORMALS, axis=1, keepdims=True)
    r, gap = np.array([0.12, 0.12, 0.1, 0.2, 0.12]), 1e-5 * np.array([5.1, 4.9, 0.3, -4.2])
    i, j = ARCH_ENDS.T
    d = (r[i] + r[j] - gap)[:, None] * n
    x = np.array([-d[0], d[1], 0 * d[0], d[2], d[2] - d[3]])
    none, cell = np.zeros((4, 2), dtype=int), 9.0 * np.eye(2)
    graph = GrainGraph(
        x=x, radii=r, contacts=ARCH_ENDS, images=none, cell=cell, normal_force=[1.0] * 4
    )
    return contacts_of(start_state(graph), law), n, gap


def balances(n, r):
    """(6, 8) forces on both discs and moments over their radii, of 4 normal and 4 shear forces."""
    rows = np.zeros((2, 3, 2, 4))
    for k, ends in enumerate(ARCH_ENDS):
        for grain, sense in zip(ends, (-1.0, 1.0), strict=True):
            if grain in (2, 3):
                rows[grain - 2, :2, 0, k] = sense * n[k]
                rows[grain - 2, :2, 1, k] = sense * np.array([-n[k, 1], n[k, 0]])
                rows[grain - 2, 2, 1, k] = -1.0
    return rows.reshape(6, 8)


@pytest.mark.parametrize("ratio, mu", [(0.2, 0.5), (0.5, 0.5), (1.0, 0.5), (0.5, 0.3), (0.5, 0.2)])
def test_an_arch_of_two_grains_stands_with_a_contact_that_slides(ratio, mu):
    """In closed form: seven forces of six balances, as large as their ways are compatible.

    Forces are those of the null space with `T = -mu N` where it slides; ways of the seven springs
    do no work on the forces of the null space without friction there. To the ways over lengths.
    """
    state, n, gap = arch(LinearFrictional(1.0, ratio, mu))
    idle = np.isin(np.arange(5), [2, 3])
    moved = rattlers._out_of_overlap(state, idle)
    T = moved.shear_force
    B, slides, signs = balances(n, state.radii), 1, np.sign(T[1])
    assert (np.abs(T) > 0.999 * mu * moved.overlap).tolist() == [False, True, False, False]
    springs = np.delete(np.arange(8), 4 + slides)
    smooth = np.linalg.svd(B[:, springs])[2][-1]
    B[:, slides] += signs * mu * B[:, 4 + slides]
    forces = np.linalg.svd(B[:, springs])[2][-1]
    ways = forces / np.where(springs < 4, 1.0, ratio)
    forces *= (smooth[:4] @ gap) / (smooth @ ways)
    np.testing.assert_allclose(moved.overlap, forces[:4], rtol=1e-3)
    np.testing.assert_allclose(np.delete(T, slides), forces[4:], rtol=1e-3, atol=1e-9)
    np.testing.assert_allclose(T[slides], signs * mu * moved.overlap[slides], rtol=1e-9)


@pytest.mark.parametrize("mu, stands", [(0.1, False), (0.135, True)])
def test_an_arch_falls_where_its_second_disc_is_beyond_its_cones(mu, stands):
    """Its two contacts turn by 14.8 degrees: their forces by half of it from the normals."""
    state, n, gap = arch(LinearFrictional(1.0, 0.5, mu))
    assert np.tan(0.5 * np.arccos(-n[2] @ n[3])) == pytest.approx(0.13, abs=1e-3)
    moved = rattlers._out_of_overlap(state, np.isin(np.arange(5), [2, 3]))
    overlap = moved.overlap
    assert (overlap > 0.01 * gap.max()).all() if stands else overlap.max() < 1e-9 * gap.max()
    assert stands or not moved.shear_force.any()


def test_an_arch_of_springs_that_stiffen_stands_too():
    """Hertz's: in balance, and one contact slides with its strength."""
    state, _, _ = arch(HertzMindlin(1.0, 0.0, 0.5))
    moved = rattlers._out_of_overlap(state, np.isin(np.arange(5), [2, 3]))
    N, T = moved.normal_force, moved.shear_force
    assert (np.abs(T) / N > 0.999 * 0.5).tolist() == [False, True, False, False]
    left = moved.resultants[2:4]
    # To the ways over lengths.
    assert np.abs(left[:, :2]).max() < 3e-4 * N.max() and (N > 0).all()


@pytest.mark.parametrize("share", [0.5, 2.0])
def test_only_what_is_in_balance_is_held(share):
    """One of four forces is larger by a share of `IN_BALANCE`: the resultant is what it is more."""
    state = caged(ROOM + 1e-3, [0.5, 0.5]).with_normal_forces()
    N = state.normal_force.copy()
    N[8] *= 1.0 + np.sqrt(2.0) * share * IN_BALANCE
    idle, least = np.arange(5) == 4, LOADED_SHARE * FORCE
    held = _held(replace(state, normal_force=N), idle, least)
    assert held.tolist() == [False] * 4 + [share < 1]


@pytest.mark.parametrize("turns", [0.0, 1.0])
def test_a_chain_that_is_not_out_of_overlap_yet_carries_nothing(turns, monkeypatch):
    """Two discs pressed between two others, in a line they are in balance, in an arch not."""
    monkeypatch.setattr(rattlers, "MOST_ROUNDS", 0)
    state = chain_of_two(10.0 * turns, "above", 1e-5)
    freed = free_rattlers(state, np.isin(np.arange(6), [2, 3]))
    assert (freed.state.normal_force[4:] > 0).tolist() == [not turns] * 3
    assert freed.rattlers.any() == bool(turns)


def test_a_grain_in_a_tight_cage_is_loaded_from_the_least_force_on():
    for share, loaded in ((0.5, False), (2.0, True)):
        state = caged(ROOM + share * LOADED_SHARE * FORCE, [0.5, 0.5])
        freed = free_rattlers(state)
        assert freed.rattlers[4] != loaded
        assert (freed.state.normal_force[8:] > 0).all() == loaded


def test_forces_of_a_grain_that_carries_nothing_are_taken_with_their_energy():
    """A small normal force and a shear force; the loaded contacts keep theirs."""
    state = caged(ROOM - 1e-4, [0.5, 0.5])
    N, T = state.normal_force.copy(), state.shear_force.copy()
    overlap = 0.5 * LOADED_SHARE * FORCE
    N[8], T[8], T[0] = overlap, 0.4 * overlap, 0.3 * FORCE
    # On its way to the first of the four until it overlaps by that force.
    x = state.x.copy()
    x[4] -= (1e-4 + overlap) * np.sqrt(0.5)
    state = replace(state, x=x, normal_force=N, shear_force=T, closed=N > 0)
    freed = free_rattlers(state)
    assert freed.rattlers[4] and not freed.state.normal_force[8] and not freed.state.shear_force[8]
    assert freed.state.shear_force[0] == T[0]
    wanted = overlap**2 / 2 + (0.4 * overlap) ** 2 / (2 * 0.5)
    assert freed.released == pytest.approx(wanted, rel=1e-9)


def test_a_grain_that_carried_nothing_stays_so_while_it_has_room():
    """A large force of its overlap is none: it has moved out of it."""
    small, at = ROOM - 1e-4, [0.5 - 1e-3, 0.5]
    state = caged(small, at)
    pressed = state.with_normal_forces()
    before = np.arange(5) == 4
    assert not free_rattlers(pressed).rattlers.any()
    freed = free_rattlers(pressed, before)
    assert freed.rattlers[4] and of_small(freed.state)[1].max() <= 0


def test_two_grains_push_each_other_out_of_overlap():
    """The first is pressed by the lattice and presses on the second, which has room."""
    state = caged([0.08, 0.08], [[0.445, 0.5], [0.596, 0.5]])
    assert of_small(state)[1].max() > 1e-3
    freed = free_rattlers(state)
    _, overlap = of_small(freed.state)
    assert freed.rattlers.tolist() == [False] * 4 + [True] * 2
    assert overlap.max() <= 0 and np.abs(freed.state.x - state.x)[4:].max(axis=1).min() > 1e-4
    # Along their line, for all is even about it.
    np.testing.assert_allclose(freed.state.x[4:, 1], 0.5, rtol=0, atol=1e-12)


@pytest.mark.parametrize("more", [-1e-4, 1e-3])
def test_a_grain_in_a_corner_of_two_walls(more):
    """Between the first disc and the walls there is room for a disc of 0.084, and no larger."""
    room = (np.sqrt(2) * 0.5 - LARGE) / (np.sqrt(2) + 1)
    small = room + more
    place = -0.5 + room + np.array([3e-4, -2e-4])
    graph = GrainGraph(
        x=[[0, 0], [1, 0], [0, 1], [1, 1], place], radii=[*[LARGE] * 4, small],
        contacts=[[0, 1], [2, 3], [0, 2], [1, 3], [0, 4]], normal_force=[*[FORCE] * 4, 0.0],
    )  # fmt: skip
    grain = [0, 2, 1, 3, 0, 1, 2, 3, 4, 4]
    branch = 0.5 * np.repeat([[-1, 0], [1, 0], [0, -1], [0, 1]], 2, axis=0)
    branch = np.vstack([branch, [[-0.5 - place[0], 0], [0, -0.5 - place[1]]]])
    planes = PlaneContacts(np.array(grain), branch, np.full(10, 2.0), np.zeros(10))
    state = start_state(graph, between(planes))
    before = np.arange(len(state.x)) == 4
    state = contacts_of(state, LAW, between(planes))
    freed = free_rattlers(state, before)
    rows = np.flatnonzero((state.contacts == 4).any(axis=1))
    overlap = freed.state.overlap[rows]
    assert len(rows) == 3 and freed.rattlers[4] == (more < 0) and not freed.rattlers[5:].any()
    np.testing.assert_array_equal(
        np.delete(freed.state.x, 4, axis=0), np.delete(state.x, 4, axis=0)
    )
    if more < 0:
        assert overlap.max() <= 0
    else:
        assert (overlap > 0).all()
        assert (
            np.abs(freed.state.resultants[4, :2]).max()
            < 1e-2 * freed.state.normal_force[rows].max()
        )


@pytest.mark.parametrize("unit", [2.0**-8, 2.0**12, 2.0**30])
@pytest.mark.parametrize("too_large", [-1e-4, 1e-3])
def test_units_change_nothing(too_large, unit):
    """Powers of two: the same numbers but for their exponents."""
    args = ROOM + too_large, 0.5 + np.array([6e-4, -3e-4])
    state = caged(*args)
    one = free_rattlers(state)
    force = 2.0**12
    state = caged(*args, unit, force)
    other = free_rattlers(state)
    np.testing.assert_array_equal(other.rattlers, one.rattlers)
    np.testing.assert_allclose(other.state.x / unit, one.state.x, rtol=1e-13)
    np.testing.assert_allclose(other.state.normal_force / force, one.state.normal_force, rtol=1e-9)
    assert other.released / (unit * force) == pytest.approx(one.released, rel=1e-9)


@pytest.mark.parametrize("small", [ROOM - 1e-4, ROOM + 1e-3])
def test_numbers_of_grains_change_nothing(small):
    state = caged(small, [0.5007, 0.4996])
    one = free_rattlers(state)
    order, rows = np.array([4, 2, 0, 3, 1]), np.random.default_rng(0).permutation(12)
    place = np.argsort(order)
    graph = GrainGraph(
        x=state.x[order], radii=state.radii[order], contacts=place[state.contacts[rows]],
        images=state.images[rows], cell=state.cell, normal_force=state.normal_force[rows],
    )  # fmt: skip
    again = start_state(graph)
    other = free_rattlers(contacts_of(again, LAW))
    np.testing.assert_array_equal(other.rattlers, one.rattlers[order])
    np.testing.assert_allclose(other.state.x, one.state.x[order], rtol=0, atol=1e-12)
    forces = one.state.normal_force[rows]
    np.testing.assert_allclose(other.state.normal_force, forces, rtol=0, atol=1e-12)


def test_parting_and_slip_are_those_of_displacements_and_spins():
    """`n . (u_j - u_i)`, and across it less both spins times radii; a pair with its own image."""
    rng = np.random.default_rng(3)
    ends, idle = np.array([[0, 1, 3, 2, 4], [1, 2, 2, 2, 0]]), np.arange(6) % 3 != 1
    u, c = np.where(idle[:, None], rng.normal(size=(6, 3)), 0.0), np.array([0, 1, 3, 4])
    angle = rng.uniform(0, 7, 4)
    n = np.column_stack([np.cos(angle), np.sin(angle)])
    (part, slip), grains = parting_and_slip(ends, c, n, idle)
    (i, j), t = ends[:, c], np.column_stack([-n[:, 1], n[:, 0]])
    assert grains.tolist() == [0, 2]
    moves = u[grains].ravel()
    apart = (u[j] - u[i])[:, :2]
    np.testing.assert_allclose(part @ moves, np.sum(n * apart, axis=1), rtol=0, atol=1e-15)
    wanted = np.sum(t * apart, axis=1) - u[i, 2] - u[j, 2]
    np.testing.assert_allclose(slip @ moves, wanted, rtol=0, atol=1e-15)


def test_overlaps_are_those_of_the_contact_table_bit_by_bit():
    """Across the border of a cell, and at walls whose contacts keep their normals."""
    rng = np.random.default_rng(0)
    grain = np.array([0, 2, 1, 3, 0, 1, 2, 3])
    branch = 0.5 * np.repeat([[-1, 0], [1, 0], [0, -1], [0, 1]], 2, axis=0)
    planes = PlaneContacts(grain, branch, np.full(8, 2.0), np.zeros(8))
    walled = GrainGraph(
        x=[[0, 0], [1, 0], [0, 1], [1, 1]], radii=[LARGE] * 4,
        contacts=[[0, 1], [2, 3], [0, 2], [1, 3]], normal_force=[FORCE] * 4,
    )  # fmt: skip
    for state in (
        contacts_of(start_state(jammed(12, 1, LAW)), LAW),
        contacts_of(start_state(walled, between(planes)), LAW, between(planes)),
    ):
        state = replace(state, x=state.x + 0.02 * rng.normal(size=state.x.shape))
        ends = np.ascontiguousarray(state.contacts.T)
        offset = state.images @ state.cell.T
        n, length, overlap = normals_and_overlaps(
            ends, offset, state.walls, state.x, state.law.touching
        )
        np.testing.assert_array_equal(overlap, state.overlap)
        np.testing.assert_array_equal(length, state.length)
        np.testing.assert_array_equal(n, state.branches / state.length[:, None])
        assert (overlap > 0).any() and (overlap == 0).any()


def test_work_of_shear_is_the_area_under_force_over_slip():
    """Up to the strength and on; without stiffness there is none."""
    kt, most, slid = (
        np.array([2.0, 2.0, 0.0]),
        np.array([9.0, 1.0, 1.0]),
        np.array([0.3, -4.0, 5.0]),
    )
    for k in range(3):
        ways = np.linspace(0, abs(slid[k]), 80_001)
        force = np.minimum(kt[k] * ways, most[k])
        area = float(np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(ways)))
        found = work_of_shear(np.array([k]), kt, most, slid[[k]])
        assert found == pytest.approx(area, rel=1e-8, abs=1e-15)


def test_grains_that_hang_on_idle_ones_are_idle():
    """Two grains press on each other alone: neither is held."""
    state = caged([0.05, 0.05], [[0.455, 0.5], [0.545, 0.5]])
    N = state.normal_force.copy()
    N[-1] = FORCE
    found = carrying_nothing(replace(state, normal_force=N, closed=N > 0), LOADED_SHARE)
    assert found.tolist() == [False] * 4 + [True] * 2


@pytest.mark.parametrize("interval", [2e-4, 5e-5])
def test_a_cage_that_closes_loads_its_grain_and_lets_it_go_again(interval):
    """Its force is that of the geometry from the strain on at which there is no room.

    Strained to `e` all distances are `1 - e` of the first; energy is closed there and back.
    """
    gap, most = 2e-4, 2e-3
    middles = np.array([[0.5, 0.5], [1.5, 0.5], [0.5, 1.5], [1.5, 1.5]])
    aside = 1e-4 * np.array([[1.0, 0.5], [-0.3, 0.2], [0.0, -1.0], [0.4, 0.4]])
    graph = lattice_around([ROOM - gap] * 4, middles + aside)
    there = [strained(most * np.eye(2)), strained(-most * np.eye(2))]
    path = follow(Scene(graph, LAW), there, closure="packing", interval=interval, rows=10)
    assert path.status == "finished" and not path.of_kind("instability")
    seen = 0
    for row, end in enumerate(path.states):
        small = np.flatnonzero((end.contacts >= 4).any(axis=1))
        assert len(small) in (0, 16)
        wanted = max(0.0, LARGE + ROOM - gap - np.sqrt(0.5) * (1 - path.H[row, 0]))
        least = LOADED_SHARE * end.mean_force
        if wanted > 2 * least:
            np.testing.assert_allclose(end.normal_force[small], wanted, rtol=0, atol=2 * least)
            seen += 1
        elif not wanted:
            assert not end.normal_force[small].any()
    assert seen > 8
    assert not path.states[-1].normal_force[path.states[-1].contacts.max(axis=1) >= 4].any()
    worst = np.abs(path.work[:, 0] - path.work[:, 1:].sum(axis=1) - path.energy + path.energy[0])
    assert worst.max() < 1e-9 * np.abs(path.work[:, 0]).max()


@pytest.mark.parametrize("interval", [2e-4, 5e-5])
def test_an_interval_ends_where_a_grain_is_caught(interval):
    """Its force grows from next to nothing: at the end of the interval it was .014 of the mean."""
    graph = lattice_around([ROOM - 1e-4], [[0.5003, 0.5]])
    stage = Stage(programmes.isotropic_stress(), "H11", 1e-3)
    solver = PackingPathSolver(
        Scene(graph, LAW), [stage], PackingPathOptions(interval, past="viscous")
    )
    solver.start_stage(0, stage, 1)
    while solver.point.rattlers.any():
        assert solver.step(interval) is None
    state = solver.point.state
    largest = state.normal_force[(state.contacts == 4).any(axis=1)].max()
    assert LOADED_SHARE <= largest / state.mean_force <= 1.05 * CAUGHT_SHARE
    assert np.abs(solver.point.imbalance).max() <= 1.05 * largest


def test_a_load_that_is_there_at_once_cuts_no_interval():
    """A cage too tight by 1e-3 from the start on has no place of less load; one that closes has."""
    end, idle = caged(ROOM + 1e-3, [0.5, 0.5]), np.arange(5) == 4
    assert share_until_caught(end, end, idle, idle) == 1.0
    start = replace(end, x=end.x[4] + 1.02 * (end.x - end.x[4]))
    # In closed form: there the overlap is the load that ends an interval, or less.
    at = 1.0 - 1e-3 / (0.02 * np.sqrt(0.5))
    share = share_until_caught(start, end, idle, idle)
    assert at < share < at + CAUGHT_SHARE * end.mean_force / (0.02 * np.sqrt(0.5))


def test_a_grain_that_a_motion_has_loaded_keeps_its_forces():
    """A state at rest is in balance with them: taken for what it was before, it would lose them."""
    stage = Stage(programmes.isotropic_stress(), "H11", 1e-3)
    solver = PackingPathSolver(
        Scene(jammed(12, 1, LAW), LAW), [stage], PackingPathOptions(2e-4, past="stop")
    )
    solver.start_stage(0, stage, 1)
    end, balance = solver.point.state, np.abs(solver.point.imbalance).max()
    rattlers = carrying_nothing(end, LOADED_SHARE)
    rattlers[end.contacts[int(np.argmax(end.normal_force))]] = True
    solver.point = replace(solver.point, rattlers=rattlers)
    solver.go_on_from(end, np.zeros(4), 0.0)
    state = solver.point.state
    np.testing.assert_array_equal(state.normal_force, end.normal_force)
    np.testing.assert_array_equal(state.shear_force, end.shear_force)
    assert np.abs(solver.point.imbalance).max() <= balance + 1e-15
