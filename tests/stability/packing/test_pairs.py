"""Pairs of a packing and their frames: unequal grains, stiffnesses that are not one."""

from copy import copy
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from loops import (
    CohesiveFrictional,
    GrainGraph,
    HertzMindlin,
    LinearFrictional,
    PlaneContacts,
    RollingResistance,
)
from loops.contacts import AT_YIELD
from loops.laws.of_pairs import law_of
from loops.neighbours import codes, near_pairs, ordered
from tests.laws import Stiffening
from tests.packings import contacts_of, start_state
from tests.stability.packing.walled_packings import between

RADII = np.array([2.0, 3.0, 5.0])
OVERLAP = np.array([0.1, 0.2, 0.05])
LINEAR = LinearFrictional([3.0, 4.0, 5.0], [0.7, 1.1, 0.4], [0.2, 0.3, np.inf], "radii")
HERTZ = HertzMindlin([7.0, 8.0, 9.0], 0.3, 0.4, "branch", "displacement")
OWN = Stiffening(k=3.0, b=2.0, kt=0.7, mu=0.4, c=0.5)
LAWS = {"linear": LINEAR, "Hertz": HERTZ, "own": OWN}


def triangle(law, shear=(0.03, -0.02, 0.01), walls=False):
    """Three unequal grains that touch one another; the first two on a floor, if asked for."""
    i, j = np.array([[0, 1], [0, 2], [1, 2]]).T
    a, b, c = RADII[i] + RADII[j] - OVERLAP
    corner = (a**2 + b**2 - c**2) / (2 * a)
    x = np.array([[0.0, 0.0], [a, 0.0], [corner, np.sqrt(b**2 - corner**2)]])
    # The second grain is larger: its centre is higher above a floor.
    turn = np.arcsin(0.95 / a)
    x = x @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    graph = GrainGraph(
        x=x, radii=RADII, contacts=np.column_stack([i, j]), shear_force=shear,
        normal_force=[1.0] * 3, cell=None if walls else 60.0 * np.eye(2),
        images=None if walls else np.zeros((3, 2), dtype=int),
    )  # fmt: skip
    if not walls:
        state, planes = start_state(graph), None
    else:
        feet = np.array([[0.0, 0.0], [0.0, 0.0]]) - [[0.0, 1.9], [0.0, 2.85]]
        stiff = np.array([6.0, 8.0]), np.array([1.5, 1.0])
        force = np.array([[0.01, 0.5], [-0.02, 0.9]])
        planes = PlaneContacts(np.array([0, 1]), feet, *stiff, np.array([0.1, 0.6]), force)
        state = start_state(graph, between(planes, volume=50.0), still=True)
    state = contacts_of(state, law, between(planes))
    return replace(state, normal_force=state.law.normal_force(state.overlap))


@pytest.mark.parametrize("name", LAWS)
def test_forces_are_slopes_of_energies_and_stiffnesses_of_forces(name):
    state = triangle(LAWS[name])
    size = 1e-6
    np.testing.assert_allclose(state.overlap, OVERLAP, rtol=1e-12)
    np.testing.assert_allclose(state.law.touching, [5.0, 7.0, 8.0])
    one = state.law
    for of, slope in (
        (one.normal_energy, one.normal_force(OVERLAP)),
        (one.normal_force, one.stiffnesses(OVERLAP)[0]),
    ):
        rise = of(OVERLAP + size) - of(OVERLAP - size)
        np.testing.assert_allclose(rise / (2 * size), slope, rtol=1e-6)
    assert (state.law.normal_energy(np.zeros(3)) == 0).all()
    assert (state.law.normal_force(np.zeros(3)) == 0).all()


def test_stiffnesses_in_closed_form():
    state = triangle(LINEAR)
    np.testing.assert_allclose(state.law.stiffnesses(OVERLAP), [LINEAR.kn, LINEAR.kt])
    np.testing.assert_allclose(state.law.normal_force(OVERLAP), LINEAR.kn * OVERLAP)
    state = triangle(HERTZ)
    R = np.array([6 / 5, 10 / 7, 15 / 8])
    kn = np.array([7.0, 8.0, 9.0]) / (1 - 0.3**2) * np.sqrt(R * OVERLAP)
    kt = float(HERTZ.stiffness_ratio) * kn
    np.testing.assert_allclose(state.law.stiffnesses(OVERLAP), [kn, kt], rtol=1e-12)
    np.testing.assert_allclose(state.normal_force, 2 / 3 * kn * OVERLAP, rtol=1e-12)
    # Hardly in touch: as at an overlap of 1e-4 of the distance.
    touch = np.array([5.0, 7.0, 8.0])
    np.testing.assert_allclose(state.law.typical_stiffness(state.overlap), kn, rtol=1e-12)
    apart = replace(state, x=1.5 * state.x)
    wanted = kn * np.sqrt(1e-4 * touch / OVERLAP)
    np.testing.assert_allclose(state.law.typical_stiffness(apart.overlap), wanted, rtol=1e-12)
    state = triangle(OWN)
    wanted = 3.0 * (1.0 + 4.0 * OVERLAP), np.full(3, 0.7)
    np.testing.assert_allclose(state.law.stiffnesses(OVERLAP), wanted, rtol=1e-6)


def test_strengths_and_moments_in_closed_form():
    law = RollingResistance(LINEAR, [0.3, 0.5, 0.9], [0.02, np.inf, 0.04])
    state = triangle(law)
    N, R = LINEAR.kn * OVERLAP, np.array([6 / 5, np.nan, 15 / 8])
    np.testing.assert_allclose(state.strength, [0.2 * N[0], 0.3 * N[1], np.inf])
    reach = np.array([0.02 * R[0], np.inf, 0.04 * R[2]])
    np.testing.assert_allclose(state.law.rolling_reach, reach)
    np.testing.assert_allclose(state.rolling_strength, reach * N)
    M = np.array([0.1, 0.2, 0.3])
    wanted = 0.01 / 0.6 + 0.04 / 1.0 + 0.09 / 1.8
    assert state.law.rolling_energy(M) == pytest.approx(wanted, rel=1e-14)
    walled = triangle(law, walls=True)
    assert walled.law.rolling_energy(np.append(M, [0.0, 0.0])) == pytest.approx(wanted, rel=1e-14)
    # Open contacts carry nothing, whatever their springs.
    open_ones = replace(state, normal_force=np.zeros(3))
    assert open_ones.rolling_strength[[0, 2]].tolist() == [0.0, 0.0]
    edge = AT_YIELD * np.array([0.2, 0.3]) * N[:2]
    for share, reached in ((1.0 - 1e-9, False), (1.0 + 1e-9, True)):
        shear = replace(state, shear_force=np.append(share * edge * [1, -1], 9.0))
        assert shear.at_limit().tolist() == [reached, reached, False]
    state = triangle(OWN)
    N = 3.0 * OVERLAP * (1.0 + 2.0 * OVERLAP)
    np.testing.assert_allclose(state.strength, 0.4 * N / (1.0 + 0.5 * N), rtol=1e-12)


@pytest.mark.parametrize("name", ["linear", "Hertz"])
@pytest.mark.parametrize("rolls", [False, True])
def test_the_law_of_pairs_is_the_law_that_they_came_from(name, rolls):
    law = RollingResistance(LAWS[name], [0.3, 0.5, 0.9], 0.02) if rolls else LAWS[name]
    state = triangle(law)
    rows = np.array([True, False, True])
    found = law_of(law, state.law, rows)
    again = contacts_of(
        replace(state, contacts=state.contacts[rows], images=state.images[rows],
                normal_force=state.normal_force[rows], shear_force=state.shear_force[rows]), found
    )  # fmt: skip
    for part in ("kn", "kt", "mu", "k_r", "mu_r"):
        wanted = getattr(state.law, part)[rows]
        np.testing.assert_allclose(getattr(again.law, part), wanted, rtol=1e-12)
    assert type(again.law) is type(state.law) and again.law.remembers == state.law.remembers
    assert again.law.springs == 1 + rolls


WALLED = {
    "linear": LINEAR,
    "Hertz": HERTZ,
    "own": OWN,
    "of each contact": Stiffening(k=np.array([3.0, 4.0, 5.0]), b=2.0, kt=0.7, mu=0.4, c=0.5),
    "smooth": Stiffening(k=3.0, b=2.0, kt=0.0, mu=0.4, c=0.5),
    "cohesive": CohesiveFrictional(3.0, 0.7, 0.4, 0.02),
    "bonds": CohesiveFrictional(3.0, 0.7, 0.4, 0.02, bonded=True),
}


@pytest.mark.parametrize("name", WALLED)
def test_walls_have_the_forces_that_they_were_given(name):
    """By the law, whatever its modulus: slopes of force and energy, `kt/kn` as given, no pull."""
    state = triangle(WALLED[name], walls=True)
    law, at = state.law, state.overlap
    assert len(law) == 5 and law.mu[3:].tolist() == [0.1, 0.6]
    np.testing.assert_allclose(at[3:], [0.1, 0.15], rtol=1e-12)
    np.testing.assert_allclose(state.normal_force[3:], [0.5, 0.9], rtol=1e-12)
    kn, kt = law.stiffnesses(at)
    np.testing.assert_allclose(kt[3:] / kn[3:], [0.25, 0.125], rtol=1e-12)
    size = 1e-6
    slopes = [
        (of(at + size) - of(at - size)) / (2 * size) for of in (law.normal_energy, law.normal_force)
    ]
    np.testing.assert_allclose(slopes, [state.normal_force, kn], rtol=1e-5)
    assert (law.normal_force(np.zeros(5))[3:] == 0).all() and (law.at_touch[3:] == 0).all()
    # As grains of these radii on a plane: the share of the law's own force, deep or not.
    power = {"Hertz": 1.5, "linear": 1.0, "cohesive": 1.0, "bonds": 1.0}.get(name)
    for deep in (0.3, 2.0):
        bend = 1.0 if power else (1 + 2 * deep * at[3:]) / (1 + 2 * at[3:])
        wanted = np.array([0.5, 0.9]) * deep ** (power or 1.0) * bend
        np.testing.assert_allclose(law.normal_force(deep * at)[3:], wanted, rtol=1e-10)
    most = law.shear_strength(at, state.normal_force)[3:]
    np.testing.assert_allclose(most, [0.05, 0.54], rtol=1e-12)
    frame = state.records()
    for part, values in (("kn", kn), ("kt", kt), ("mu", law.mu), ("cohesion", 0.0 * kn)):
        np.testing.assert_allclose(frame[part][3:], values[3:], rtol=1e-12)
    if name != "Hertz":
        filled = law.answer(at, 0.9 * at, state.shear_force)[:3, 3:]
        np.testing.assert_allclose(filled, [state.normal_force[3:], kt[3:], most], rtol=1e-12)


@pytest.mark.parametrize("name", WALLED)
def test_walls_whose_force_is_no_guide_have_the_stiffness_given(name):
    """Apart, or at an overlap that is rounding: 6 and 8 where they stand, or hardly touch."""
    law = triangle(WALLED[name], walls=True).law
    given = law.kn[3:].copy(), law.kt[3:].copy()
    springs = np.array([[6.0, 8.0], [1.5, 1.0], [0.1, 0.6], [0.0, 1e-9], [0.0, 0.9]])
    grains = law.taken(np.arange(3))
    again = grains.with_walls(law.radii[:, 3:], law.wall[3:], springs)
    at = np.concatenate([OVERLAP, 1e-4 * RADII[:2]])
    kn, kt = again.stiffnesses(at)
    np.testing.assert_allclose([kn[3:], kt[3:]], [[6.0, 8.0], [1.5, 1.0]], rtol=1e-12)
    assert not np.allclose(again.kn[3:], given[0])


@pytest.mark.parametrize("share", [1e-2, 1e-4, 0.7e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("name", WALLED)
def test_walls_that_barely_touch_start_with_their_force(name, share):
    """Whatever the overlap over the radius: force, stiffness and strength are those given."""
    law = triangle(WALLED[name], walls=True).law
    at = np.concatenate([OVERLAP, share * law.radii[0, 3:]])
    given = law.normal_force(at)[3:], *(k[3:] for k in law.stiffnesses(at))
    springs = np.array([*given[1:], law.friction[3:], at[3:], given[0]])
    again = law.taken(np.arange(3)).with_walls(law.radii[:, 3:], law.wall[3:], springs)
    # Overlaps are differences of lengths: of 1e-8 of the radius half the digits are left.
    bound = max(1e-10, 4e-16 / share)
    found = again.normal_force(at)[3:], *(k[3:] for k in again.stiffnesses(at))
    np.testing.assert_allclose(found, given, rtol=bound)


def test_walls_without_a_friction_slide_or_never_do():
    """With a shear stiffness they never slide."""
    state = triangle(LINEAR, walls=True)
    planes = PlaneContacts(np.array([0, 1]), np.ones((2, 2)), np.ones(2), np.array([0.0, 1.0]))
    assert contacts_of(state, LINEAR, between(planes)).law.mu[3:].tolist() == [0.0, np.inf]


@pytest.mark.parametrize("by_radii", [False, True])
@pytest.mark.parametrize("name", LAWS)
def test_a_frame_has_the_slopes_of_force_and_moment(name, by_radii):
    """The force turns with the pair, the levers grow with it, spins shear by them."""
    law = copy(LAWS[name])
    object.__setattr__(law, "shear_increment", "radii" if by_radii else "branch")
    state = triangle(RollingResistance(law, 0.3, 0.02))
    frame, unit, size = state.records(), RADII.mean(), 1e-6
    free, springs = frame[:3], frame[3:]
    N, T = state.normal_force, state.shear_force
    d, length = state.branches, np.linalg.norm(state.branches, axis=1)
    ri, rj = RADII[state.contacts].T

    def force(d):
        n = d / np.linalg.norm(d, axis=1)[:, None]
        return N[:, None] * n + T[:, None] * np.column_stack([-n[:, 1], n[:, 0]])

    np.testing.assert_allclose(free["n"], d / length[:, None], rtol=1e-12)
    np.testing.assert_allclose(free["t"][:, 0], -free["n"][:, 1], rtol=1e-12)
    across = size * free["t"]
    slope = (force(d + across) - force(d - across)) / (2 * size)
    np.testing.assert_allclose(free["rotation"], slope, rtol=1e-6, atol=1e-9)
    arms = 0.5 * np.column_stack([length + ri - rj, length + rj - ri])
    np.testing.assert_allclose(free["arm"], arms / unit, rtol=1e-12)
    levers = np.column_stack([ri, rj]) if by_radii else arms
    np.testing.assert_allclose(free["lever"], levers / unit, rtol=1e-12)
    np.testing.assert_allclose(free["turning"], (ri + rj) / length if by_radii else 1.0)
    # Moments are levers times T: half of T for each unit that the pair grows by.
    np.testing.assert_allclose(free["growth"], 0.5 * T / unit, rtol=1e-12)
    kn, kt = state.law.stiffnesses(OVERLAP)
    np.testing.assert_allclose(free["kn"], kn, rtol=1e-9)
    np.testing.assert_allclose(free["kt"], kt, rtol=1e-9)
    if name == "Hertz":
        # T goes with kt, which goes with the root of the overlap.
        fall = T * (np.sqrt(1 + size) - np.sqrt(1 - size)) / (2 * size * OVERLAP)
        np.testing.assert_allclose(free["coupling"], fall, rtol=1e-6)
    # Strength along the tangent: slope and cohesion.
    moved = [replace(state, x=(1 - s) * state.x) for s in (0.0, size, -size)]
    most = [replace(one, normal_force=one.law.normal_force(one.overlap)).strength for one in moved]
    finite = np.isfinite(state.law.mu)
    assert (free["slides"] == finite).all()
    there = free["mu"] * N + free["cohesion"]
    np.testing.assert_allclose(there[finite], most[0][finite], rtol=1e-12)
    if name == "own":
        rise = (most[1] - most[2]) / (2 * size * length)
        np.testing.assert_allclose(free["mu"] * free["kn"], rise, rtol=1e-5)
    # A spring against rolling: moments over the mean radius, levers of one.
    np.testing.assert_allclose(springs["kt"], 0.3 / unit**2, rtol=1e-12)
    reach = 0.02 * ri * rj / (ri + rj) / unit
    np.testing.assert_allclose(springs["mu"], reach, rtol=1e-12)
    assert (springs["lever"] == [1.0, -1.0]).all() and (springs["arm"] == [1.0, -1.0]).all()
    assert (free["push"] == 1).all() and (springs["push"] == 0).all()
    np.testing.assert_allclose(springs["kn"], free["kn"])


@pytest.mark.parametrize("name", ["Hertz", "own"])
def test_contacts_that_may_open_have_the_force_over_their_overlap(name):
    """So they open where the grains part; open ones have it at the reach."""
    state = triangle(LAWS[name])
    for reach in (0.15, 0.3):
        frame = state.records(reach)
        secant, tangent = state.normal_force / OVERLAP, state.law.stiffnesses(OVERLAP)[0]
        np.testing.assert_allclose(frame["kn"], np.where(reach < OVERLAP, tangent, secant))
    apart = replace(state, x=1.5 * state.x, normal_force=np.zeros(3), shear_force=np.zeros(3))
    frame, at = apart.records(0.2), np.full(3, 0.2)
    np.testing.assert_allclose(frame["kn"], state.law.normal_force(at) / 0.2, rtol=1e-9)
    if name == "Hertz":
        assert (frame["coupling"] == 0).all()
    else:
        assert np.isfinite(frame["mu"]).all() and (frame["cohesion"] == 0).all()
        near = state.records(0.3)
        np.testing.assert_allclose(near["mu"], state.strength / state.normal_force)
        np.testing.assert_allclose(near["cohesion"], 0.0, atol=1e-12)


@pytest.mark.parametrize("gap", [0.0, 0.3, 2.0])
@pytest.mark.parametrize("shift", [0.0, 40.0])
def test_near_pairs_of_a_skewed_cell_are_those_of_a_search(gap, shift):
    """Every image within some cells, the grains' own ones included."""
    rng = np.random.default_rng(int(10 * gap))
    cell = np.array([[2.2, 1.5], [-0.3, 1.8]])
    x, radii = rng.uniform(-3, 3, (4, 2)) + shift, rng.uniform(0.2, 0.6, 4)
    grains, images = near_pairs(x, cell, radii, gap)
    found = {
        (*map(int, pair), *map(int, image)) for pair, image in zip(grains, images, strict=True)
    }
    home = np.floor(np.linalg.solve(cell, x.T).T).astype(int)
    wanted = set()
    for i, j in product(range(4), repeat=2):
        for a, b in product(range(-6, 7), repeat=2):
            image = np.array([a, b]) + home[i] - home[j]
            if i > j or (i == j and (a, b) <= (0, 0)):
                continue
            if np.linalg.norm(x[j] + cell @ image - x[i]) < radii[i] + radii[j] + gap:
                wanted.add((i, j, *map(int, image)))
    assert found == wanted and (gap == 0.0 or len(found) > 3)


@pytest.mark.parametrize("name", ["linear", "Hertz"])
def test_new_pairs_have_medians_and_walls_are_as_stiff_as_known(name):
    """Under Hertz's law stiffnesses over the root of the effective radius; walls over the radius.

    The third grain comes near the floor.
    """
    law = RollingResistance(LAWS[name], [0.3, 0.5, 0.9], [0.02, 0.03, 0.04])
    state = triangle(law, walls=True)

    def springs(law):
        i, j = law.radii
        R = np.where(j > 0, i * j / (i + j), i)
        unit = np.sqrt(R) if name == "Hertz" else 1.0
        kn, kt = law.stiffnesses(np.full(len(law), 0.1))
        return kn / unit, kt / unit, law.mu

    x = np.array(state.x)
    x[2] = [20.0, 5.05 - 1.9]
    more = replace(state, x=x + np.array([0.0, 30.0])).with_near(0.1)
    new = more.contacts[5:]
    assert len(state.walls) == 1 and new.tolist() == [[2, 3]]
    x[2] = [-20.0, 8.0]
    assert len(replace(state, x=x).with_near(0.1).contacts) == 5
    R = RADII[[0, 1]]
    for known, found in zip(springs(state.law), springs(more.law), strict=True):
        np.testing.assert_allclose(found[:5], known, rtol=1e-12)
        old = known[3:]
        proportional = np.std(old / R) * old.mean() < np.std(old) * (old / R).mean()
        wanted = (old / R).mean() * RADII[2] if proportional else old.mean()
        assert found[-1] == pytest.approx(wanted, rel=1e-12)
    assert more.law.k_r[-1] == 0.0
    # A pair of grains that were not in touch.
    less, known = state.law.taken(np.arange(1, 5)), springs(state.law)
    parts = ("contacts", "images", "normal_force", "shear_force", "rolling_moment", "closed")
    fewer = replace(state, law=less, **{part: getattr(state, part)[1:] for part in parts})
    more = fewer.with_near(0.1)
    assert more.contacts[-1].tolist() == [0, 1]
    for values, found in zip(known[:2], springs(more.law)[:2], strict=True):
        assert found[-1] == pytest.approx(np.median(values[1:3]), rel=1e-12)
    assert more.law.k_r[-1] == pytest.approx(0.7) and more.law.mu_r[-1] == 0.035


@pytest.mark.parametrize("rows", [[1, 4], [0, 2], [3], [0, 1, 2, 3, 4]])
@pytest.mark.parametrize(
    "law", [LINEAR, HERTZ, Stiffening(k=np.array([3.0, 4.0, 5.0]), b=2.0, kt=0.7, mu=0.4, c=0.5)]
)
def test_the_law_of_some_pairs_gives_what_that_of_all_does(law, rows):
    """Bit by bit, with walls among them and parameters of their own."""
    law = triangle(law, walls=True).law
    some, overlap = law.taken(np.array(rows)), 0.01 * np.arange(5.0)
    N = law.normal_force(overlap)
    np.testing.assert_array_equal(some.normal_force(overlap[rows]), N[rows])
    np.testing.assert_array_equal(
        some.normal_energy(overlap[rows]), law.normal_energy(overlap)[rows]
    )
    most = law.shear_strength(overlap, N)
    np.testing.assert_array_equal(some.shear_strength(overlap[rows], N[rows]), most[rows])
    for k, all_pairs in zip(some.stiffnesses(overlap[rows]), law.stiffnesses(overlap), strict=True):
        np.testing.assert_array_equal(k, all_pairs[rows])
    for part in ("touching", "at_touch", "rolling_reach"):
        np.testing.assert_array_equal(getattr(some, part), getattr(law, part)[rows])


def test_a_pair_has_one_code_whatever_the_list_it_is_in():
    """Five bodies, two images either way: all differ, and the same pair has the same code."""
    every = np.array(list(product(range(5), range(5), range(-2, 3), range(-2, 3))))
    some = np.random.default_rng(1).permutation(every)[:30]
    found, again = codes((every[:, :2], every[:, 2:]), (some[:, :2], some[:, 2:]))
    assert len(set(found.tolist())) == len(every)
    rows = {tuple(row): code for row, code in zip(every.tolist(), found.tolist(), strict=True)}
    assert [rows[tuple(row)] for row in some.tolist()] == again.tolist()


def test_pairs_are_ordered_by_grain_and_by_image():
    grains = np.array([[3, 1], [1, 3], [2, 2], [2, 2], [2, 2], [2, 2]])
    images = np.array([[1, -2], [1, -2], [-1, 2], [1, -2], [0, -1], [0, 1]])
    found, at = ordered(grains, images)
    assert found.tolist() == [[1, 3], [1, 3], *[[2, 2]] * 4]
    assert at.tolist() == [[-1, 2], [1, -2], [1, -2], [1, -2], [0, 1], [0, 1]]


def test_pairs_of_an_own_law_that_are_apart_stand_at_a_small_overlap():
    """In a frame of `n` and `t`; new ones have the law of the median stiffness."""
    law = Stiffening(k=np.array([3.0, 9.0, 4.0]), b=2.0, kt=0.7, mu=0.4, c=0.5)
    state = triangle(law)
    touch, made = state.law.contacts(np.array([0.1, 0.0, 0.05]))
    assert touch.tolist() == [True, False, True]
    np.testing.assert_allclose(made.overlap, [0.1, 7e-4, 0.05], rtol=1e-9)
    assert (made.n == [1.0, 0.0]).all() and (made.t == [0.0, 1.0]).all()
    rows = np.array([False, True, True])
    kept = {
        part: getattr(state, part)[rows]
        for part in ("contacts", "images", "normal_force", "shear_force")
    }
    fewer = replace(state, **kept)
    more = contacts_of(fewer, law.take([1, 2])).with_near(0.1)
    assert more.contacts[-1].tolist() == [0, 1] and more.law.law.k.tolist() == [9.0, 4.0, 6.5]
    lone = replace(fewer, **{part: values[:1] for part, values in kept.items()})
    both = contacts_of(lone, law.take([1])).with_near(0.1)
    assert both.law.law.k.tolist() == [9.0] * 3
    assert more.law.radii[:, -1].tolist() == [2.0, 3.0]
