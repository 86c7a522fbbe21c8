"""Statuses of rate problems in any frame, numbering and unit, in directions that load no contact.

Along such a direction the rates of a contact at yield vanish: it may stick or slide, and rounding
decides on nothing. Status, regimes that agree, and motion are the same however the loop is written.
"""

from itertools import product

import numpy as np
import pytest

from loops import (
    CohesiveFrictional,
    GrainGraph,
    HertzMindlin,
    LinearFrictional,
    Regime,
    Scene,
    Support,
    contact_state,
)
from patterns import random_loop, regular_polygon
from stability import Stage, directional_work, follow, programmes, rates_at

MU, UNITS = 0.5, (1e-9, 1.0, 1e9)
CLOSURES = list(product(("affine", "traction"), ("blocked", "affine", "free")))
STICKS, SLIDES = frozenset([Regime.ELASTIC]), frozenset([Regime.SLIDING])
EITHER = STICKS | SLIDES
# Regimes of which a solution tells whether they agree: sliding to either side.
CHOICES = np.array([Regime.ELASTIC, Regime.OPEN, Regime.SLIDING, Regime.SLIDING])


def linear(stiffness, length, increment="branch"):
    return LinearFrictional(stiffness, 0.3 * stiffness, MU, increment)


def by_radii(stiffness, length):
    return linear(stiffness, length, "radii")


def hertz(stiffness, length):
    return HertzMindlin(stiffness / length, 0.2, MU)


def sticky(stiffness, length):
    pull = 1e-3 * stiffness * length
    return CohesiveFrictional(stiffness, 0.3 * stiffness, MU, adhesion=pull)


LAWS = (linear, by_radii, hertz, sticky)


def frame(rng, grains):
    """A turn or a mirror, units of length and of force, and where the numbers begin."""
    angle, mirror = rng.uniform(0.0, 2.0 * np.pi), rng.random() < 0.5
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s], [s, c]]) @ np.diag([1.0, -1.0 if mirror else 1.0])
    return turn, rng.choice(UNITS), rng.choice(UNITS), int(rng.integers(grains))


SAME = np.eye(2), 1.0, 1.0, 0


def seen(loop, law, at, in_frame):
    """The loop and its law in a frame, contacts `at` on their side of the friction limit.

    Also the contacts that its contacts were, and the sign of their shear forces.
    """
    (turn, length, force, shift), n = in_frame, loop.grain_count
    grains = np.roll(np.arange(n), shift)
    contacts, sign = grains, 1.0
    if np.linalg.det(turn) < 0:
        # Counter-clockwise again: contact c joins what were grains n - 1 - c and n - 2 - c.
        grains = grains[::-1]
        contacts, sign = np.roll(grains, -1), -1.0
    x, x0 = (length * place[grains] @ turn.T for place in (loop.x, loop.x0))
    made = law(force / length, length)
    image = GrainGraph(x=x, x0=x0, radii=length * loop.radii[grains], contacts=loop.contacts)
    image = image.replace(normal_force=made.normal_force(contact_state(image)))
    limit = made.strength(contact_state(image))
    return image.replace(shear_force=sign * at[contacts] * limit), made, contacts, sign


def along(loop, c, across, turn=SAME[0]):
    """Uniaxial strain along the branch of a contact, or across it, in a frame."""
    i, j = loop.contacts[c]
    e = turn @ ((loop.x[j] - loop.x[i]) / np.linalg.norm(loop.x[j] - loop.x[i]))
    return np.outer(e, e) if not across else np.eye(2) - np.outer(e, e)


def told(found, contacts, sign, in_frame):
    """Status, regimes of the contacts at the edge that agree, and rates of all: units of length."""
    _, length, _, _ = in_frame
    number = {c: int(contacts[c]) for c in range(len(contacts))}
    answers = []
    for one in found.solutions:
        regimes = {
            number[c]: frozenset(CHOICES[can].tolist())
            for c, can in zip(found.contacts.tolist(), one.agreeing, strict=True)
        }
        rates = np.empty((2, len(contacts)))
        rates[:, contacts] = one.rates.rates.un / length, sign * one.rates.rates.ut / length
        answers.append((sorted(regimes.items()), rates))
    answers.sort(key=lambda one: float(np.abs(one[1]).sum()))
    return found.status, answers


def equal(one, other):
    status, answers = one
    assert (status, len(answers)) == (other[0], len(other[1]))
    for (regimes, rates), (others, these) in zip(answers, other[1], strict=True):
        assert regimes == others
        np.testing.assert_allclose(these, rates, rtol=0, atol=1e-10 * np.abs(rates).max())


def sides(rng, loop, count):
    """Sides of contacts at yield, zero for the others; the first contact is one."""
    at = np.zeros(loop.contact_count)
    others = 1 + rng.permutation(loop.contact_count - 1)[: count - 1]
    at[0], at[others] = 1.0, rng.choice([-1.0, 1.0], count - 1)
    return at


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
def test_loops_have_one_status_in_all_frames(law):
    """Regular polygons strained along and across the branch of a contact at yield."""
    rng, either = np.random.default_rng(LAWS.index(law)), 0
    for closure, spins in CLOSURES:
        loop = regular_polygon(int(rng.choice([3, 4, 5, 6])), strain=0.02)
        at = sides(rng, loop, int(rng.integers(1, 3)))
        for across in (False, True):
            answers = []
            for in_frame in [SAME] + [frame(rng, loop.grain_count) for _ in range(4)]:
                graph, made, contacts, sign = seen(loop, law, at, in_frame)
                H = along(loop, 0, across, in_frame[0])
                found = rates_at(Scene(graph, made), H=H, closure=closure, spins=spins)
                answers.append(told(found, contacts, sign, in_frame))
            for other in answers[1:]:
                equal(answers[0], other)
            assert answers[0][0] != "none"
            either += dict(answers[0][1][0][0])[0] == EITHER
    assert either > 0


def test_random_loops_have_one_status_in_all_frames():
    rng, seen_statuses = np.random.default_rng(7), set()
    for seed in range(12):
        closure, spins = CLOSURES[seed % 6]
        loop = random_loop(int(rng.integers(3, 7)), seed, polydispersity=0.3, strain=0.02)
        at, H = sides(rng, loop, int(rng.integers(1, 4))), rng.normal(size=(2, 2))
        answers = []
        for in_frame in (SAME, frame(rng, loop.grain_count), frame(rng, loop.grain_count)):
            graph, made, contacts, sign = seen(loop, linear, at, in_frame)
            scene, turn = Scene(graph, made), in_frame[0]
            found = rates_at(scene, H=turn @ H @ turn.T, closure=closure, spins=spins)
            answers.append(told(found, contacts, sign, in_frame))
        equal(answers[0], answers[1])
        equal(answers[0], answers[2])
        seen_statuses.add(answers[0][0])
    assert seen_statuses >= {"unique", "none"}


@pytest.mark.parametrize(("closure", "spins"), CLOSURES)
def test_work_along_directions_has_one_status_in_all_frames(closure, spins):
    """`rates_at` has the same work; contacts that may stick or slide are told, and stick."""
    rng, loop = np.random.default_rng(3), regular_polygon(4, strain=0.02)
    at, works = sides(rng, loop, 1), []
    for in_frame in [SAME] + [frame(rng, 4) for _ in range(4)]:
        graph, made, contacts, _ = seen(loop, linear, at, in_frame)
        H = along(loop, 0, True, in_frame[0])
        ways = [[H[0, 0], H[1, 1], 2.0**0.5 * H[0, 1]]]
        found = directional_work(
            graph, made, ways, closure=closure, spins=spins, subspace="symmetric"
        )
        assert found.status.tolist() == ["unique"]
        assert found.neutral[0, contacts == 0].all() and found.regime[0, contacts == 0] == 1
        rates = rates_at(Scene(graph, made), H=H, closure=closure, spins=spins).taken.rates
        unit = in_frame[2] / in_frame[1]
        assert found.work[0, 0] == pytest.approx(float(np.sum(rates.stress_rate * H)), rel=1e-9)
        works.append(float(found.work[0, 0]) / unit)
    np.testing.assert_allclose(works, works[0], rtol=1e-9)


def test_a_path_goes_on_in_all_frames():
    loop = regular_polygon(4, strain=0.02)
    at = np.array([1.0, 0.0, 0.0, 0.0])
    for k in range(6):
        c, s = np.cos(0.1 + 0.2 * np.pi * k), np.sin(0.1 + 0.2 * np.pi * k)
        in_frame = np.array([[c, -s], [s, c]]), 1.0, 1.0, 0
        graph, made, *_ = seen(loop, linear, at, in_frame)
        H = along(loop, 0, True, in_frame[0])
        driven = programmes.combination(np.zeros((4, 4)), np.eye(4), H.ravel())
        path = follow(Scene(graph, made), Stage(driven, "parameter", 1e-3), closure="traction")
        assert path.status == "finished", k


def hanging(contacts, at, N):
    """Two free discs that hang on a held one, which moves: no contact is loaded."""
    x = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 0.75**0.5]])
    return x, np.array(contacts), np.array(at), np.array([[1.0, 0.3, 0.0], [0] * 3, [0] * 3]), N


ROW, TRIANGLE = [[0, 1], [1, 2]], [[0, 1], [1, 2], [0, 2]]


def three_discs(beta):
    """The middle disc of three, both contacts at yield, between a held and a moving one."""
    s, c = np.sin(beta), np.cos(beta)
    x, motion = np.array([[0.0, 0.0], [s, c], [0.0, 2.0 * c]]), np.zeros((3, 3))
    motion[2, 1] = -1.0
    return x, np.array(ROW), np.array([1.0, -1.0]), motion, 5e-4


# `q` vanishes at the first angle, `M` at the second: mu = 0.5, N = 5e-4 kn l.
SLACK, LOST = np.radians([26.55072723249814, 26.622204339169247])


@pytest.mark.parametrize(
    ("case", "held", "status"),
    [
        (hanging(ROW, [1.0, -1.0], 5e-4), [True, False, False], "family"),
        (hanging(TRIANGLE, [1.0, -1.0, 0.0], 1e-9), [True, False, False], "unique"),
        (three_discs(SLACK - 1e-10), [True, False, True], "family"),
        (three_discs(SLACK), [True, False, True], "unique"),
        (three_discs(SLACK + 1e-10), [True, False, True], "none"),
        (three_discs(LOST - 1e-9), [True, False, True], "none"),
        (three_discs(LOST + 1e-9), [True, False, True], "family"),
    ],
    ids=["hanging", "triangle", "slack", "neither", "stuck", "lost", "slips"],
)
def test_supported_clusters_have_one_status_in_all_frames(case, held, status):
    """Next to where `q` or `M` vanish, closer than rounding of a share of either would tell."""
    (x, contacts, at, motion, share), rng = case, np.random.default_rng(5)
    for k in range(8):
        turn, length, force, _ = frame(rng, 3) if k else SAME
        order, sign, moved = rng.permutation(3), np.linalg.det(turn), motion.copy()
        place = np.argsort(order)
        moved[:, :2], N = motion[:, :2] @ turn.T, np.full(len(contacts), share * force)
        graph = GrainGraph(
            x=length * (x @ turn.T)[order],
            radii=[0.5 * length] * 3,
            contacts=place[contacts],
            normal_force=N,
            shear_force=sign * at * MU * N,
        )
        law = LinearFrictional(force / length, force / length, MU)
        support = Support(np.array(held)[order], moved[order])
        found = rates_at(Scene(graph, law), support)
        assert found.status == status, k
        if status == "unique":
            assert sorted(found.neutral.tolist()) == [0, 1]
            slip = found.taken.rates.ut
            np.testing.assert_allclose(slip[0], -slip[1], rtol=0, atol=1e-9)
