"""Clusters with held grains: three discs in closed form, frames, numbering, units, bad input.

The three discs are those of Kuhn, Prunier and Daouadji, arXiv 1810.11862. The numbers quoted are
from `README.md` of the collection that GRAINLOOPS_PUBLISHED names.
"""

import numpy as np
import pytest

from loops import GrainGraph, InputError, LinearFrictional, Regime, Scene, Support
from stability import programmes, rates_at, slip_problem
from studies.examples import three_discs
from studies.examples.three_discs import LAW, SUPPORT, changing_angles, closed_forms, discs

# beta, q of either contact, entries of M, sum of the slips on the line: as quoted.
QUOTED = [
    (20.0, 0.0638075, -0.0221320, 2.883),
    (26.565, -1.398e-4, -2.501e-4, None),
    (40.0, -0.130073, 0.0833134, None),
]


def turned(angle, graph=None, support=SUPPORT):
    graph = graph or discs(30.0)
    c, s = np.cos(angle), np.sin(angle)
    R = np.array([[c, -s], [s, c]])
    motion = support.motion.copy()
    motion[:, :2] = motion[:, :2] @ R.T
    return graph.replace(x=graph.x @ R.T), Support(support.held, motion)


@pytest.mark.parametrize(("beta", "q", "m", "slip"), QUOTED)
def test_three_discs_have_the_quoted_numbers(beta, q, m, slip):
    angle = np.degrees(np.arctan(0.5)) if beta == 26.565 else beta
    found_q, found_M = slip_problem(discs(angle), LAW, SUPPORT)
    # To half of the last digit quoted, and its rounding.
    assert found_q == pytest.approx(q, abs=5.1e-7 if beta == 40.0 else 5.1e-8)
    assert found_M == pytest.approx(m, abs=5.1e-8)
    if slip:
        found = rates_at(Scene(discs(angle), LAW), SUPPORT)
        assert found.families[0].corners.sum(axis=1) == pytest.approx(slip, abs=5e-4)


@pytest.mark.parametrize("beta", [10.0, 20.0, 26.56, 26.6, 26.7, 40.0, 60.0])
def test_slip_problem_is_its_closed_form(beta):
    q, M = slip_problem(discs(beta), LAW, SUPPORT)
    exact_q, exact_m = closed_forms(beta)
    np.testing.assert_allclose(q, exact_q, rtol=0, atol=1e-15)
    np.testing.assert_allclose(M, exact_m, rtol=0, atol=1e-15)


def test_slip_problem_with_other_stiffnesses_and_units(monkeypatch):
    """kt is not kn; lengths, forces and speeds in other units."""
    law = LinearFrictional(3e4, 2e4, 0.3)
    monkeypatch.setattr(three_discs, "LAW", law)
    monkeypatch.setattr(three_discs, "RADIUS", 0.02)
    monkeypatch.setattr(three_discs, "NORMAL_FORCE", 5.0)
    q, M = slip_problem(discs(25.0), law, SUPPORT)
    exact_q, exact_m = closed_forms(25.0)
    np.testing.assert_allclose(q, exact_q, rtol=1e-12)
    np.testing.assert_allclose(M, exact_m, rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    ("beta", "status", "sticks", "solutions"),
    [(20.0, "family", True, 3), (26.6, "none", False, 0), (40.0, "family", False, 2)],
)
def test_a_line_of_solutions_says_so(beta, status, sticks, solutions):
    found = rates_at(Scene(discs(beta), LAW), SUPPORT)
    q, m = closed_forms(beta)
    assert (found.status, len(found.solutions), found.exhaustive) == (status, solutions, True)
    stuck = [one for one in found.solutions if (one.rates.regime == Regime.ELASTIC).all()]
    assert bool(stuck) == sticks
    assert len(found.families) == (status == "family") and found.contacts.tolist() == [0, 1]
    for line in found.families:
        corners = line.corners[np.argsort(line.corners[:, 0])]
        np.testing.assert_allclose(corners, [[0, -q / m], [-q / m, 0]], rtol=0, atol=1e-10)
        np.testing.assert_allclose(np.abs(line.directions), [[0.5**0.5] * 2], atol=1e-12)
        assert line.directions.sum() == pytest.approx(0.0, abs=1e-12)
        assert line.sliding.all()


def test_every_point_of_the_line_is_a_solution():
    """Slips in between, imposed as forces on the sticking contacts, leave both at their limit."""
    q, M = slip_problem(discs(40.0), LAW, SUPPORT)
    (line,) = rates_at(Scene(discs(40.0), LAW), SUPPORT).families
    for share in (0.0, 0.3, 1.0):
        z = share * line.corners[0] + (1.0 - share) * line.corners[1]
        assert np.abs(q + M @ z).max() < 1e-14 and z.min() >= 0.0


def test_the_kind_changes_at_two_angles_in_closed_form():
    ends = changing_angles()
    np.testing.assert_allclose(three_discs.located(), ends, rtol=0, atol=1e-10)
    assert ends == pytest.approx([26.55072723249814, 26.622204339169247], abs=1e-12)
    # Closer than that q and M are rounding.
    kinds = [three_discs.response_at(b)["kind"] for e in ends for b in (e - 1e-6, e + 1e-6)]
    assert kinds == ["stick, line", "none", "none", "line"]


@pytest.mark.parametrize("angle", [0.3, np.pi / 2, 2.0])
def test_a_turned_frame_changes_nothing(angle):
    q, M = slip_problem(discs(30.0), LAW, SUPPORT)
    turned_q, turned_M = slip_problem(*turned(angle)[:1], LAW, turned(angle)[1])
    np.testing.assert_allclose(turned_q, q, rtol=0, atol=1e-14)
    np.testing.assert_allclose(turned_M, M, rtol=0, atol=1e-14)
    assert rates_at(Scene(turned(angle)[0], LAW), turned(angle)[1]).status == "family"


def test_numbering_of_grains_and_ends_changes_nothing():
    graph, order = discs(20.0), np.array([2, 0, 1])
    place = np.argsort(order)
    other = GrainGraph(
        x=graph.x[order],
        radii=graph.radii[order],
        contacts=place[graph.contacts][::-1, ::-1],
        normal_force=graph.normal_force[::-1],
        # T changes its sign neither with the ends nor with the numbers.
        shear_force=graph.shear_force[::-1],
    )
    support = Support(SUPPORT.held[order], SUPPORT.motion[order])
    first, second = rates_at(Scene(graph, LAW), SUPPORT), rates_at(Scene(other, LAW), support)
    assert first.status == second.status == "family"
    key = lambda one: sorted(one.families[0].corners.round(9).tolist())  # noqa: E731
    assert key(first) == key(second)
    moved = sorted(one.rates.motion[1].round(9).tolist() for one in first.solutions)
    assert moved == sorted(one.rates.motion[2].round(9).tolist() for one in second.solutions)


def test_rates_of_a_held_loop_are_those_of_its_path():
    """A diamond whose grains move as the affine path of a programme drives them."""
    ring = [[0, 1], [1, 2], [2, 3], [3, 0]]
    x = np.array([[0.7, 0.0], [0.0, 0.75], [-0.7, 0.0], [0.0, -0.75]])
    law = LinearFrictional(1.0, 0.4, 0.05)
    graph = GrainGraph(x=x, radii=[0.55] * 4, contacts=ring)
    d = np.linalg.norm(graph.x[[1, 2, 3, 0]] - graph.x, axis=1)
    graph = graph.replace(normal_force=1.1 - d)
    H = np.array([[1.0, 0.0], [0.0, -0.3]])
    motion = np.column_stack([-x @ H.T, np.zeros(4)])
    found = rates_at(Scene(graph, law), Support([True] * 4, motion))
    path = rates_at(
        Scene(graph, law), programmes.proportional_strain(1.0, -0.3), closure="affine"
    ).taken.rates.rates
    rates, scale = found.taken.rates, path.H[0]
    assert found.status == "unique"
    np.testing.assert_allclose(rates.normal_force, path.normal_force / scale, atol=1e-14)
    np.testing.assert_allclose(rates.shear_force, path.shear_force / scale, atol=1e-14)


def test_reactions_balance_and_a_free_disc_without_contacts_stays():
    graph = discs(40.0)
    graph = GrainGraph(
        x=np.vstack([graph.x, [9.0, 9.0]]),
        radii=[1.0] * 4,
        contacts=graph.contacts,
        normal_force=graph.normal_force,
        shear_force=graph.shear_force,
    )
    support = Support(np.vstack([SUPPORT.held, [False] * 3]), np.vstack([SUPPORT.motion, [0] * 3]))
    rates = rates_at(Scene(graph, LAW), support).taken.rates
    np.testing.assert_allclose(rates.reaction[:, :2].sum(axis=0), 0.0, atol=1e-14)
    assert not rates.motion[3].any() and not rates.reaction[[1, 3]].any()


def test_reactions_are_the_same_in_other_units(monkeypatch):
    """Forces and a moment: of grains in motion across the contacts, whose spins are held."""
    found = []
    for length in (1.0, 2.0**-6):
        monkeypatch.setattr(three_discs, "RADIUS", length)
        monkeypatch.setattr(three_discs, "NORMAL_FORCE", 1e-3 * length)
        motion = length * np.array([[0.0, 0, 0], [0, 0, 0], [0.5, -1, 0]])
        support = Support([True, False, True], motion)
        rates = rates_at(Scene(discs(25.0), LAW), support).taken.rates
        found.append(rates.reaction / (length * np.array([1.0, 1.0, length])))
    assert np.abs(found[0][:, 2]).max() > 1e-2
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-13)


def test_a_touching_disc_parts_or_presses_as_it_is_moved():
    pair = GrainGraph(x=[[0, 0], [1, 0]], radii=[0.5] * 2, contacts=[[0, 1]])
    for speed, regime, N in ((-1.0, Regime.ELASTIC, 1.0), (1.0, Regime.OPEN, 0.0)):
        support = Support([True, True], [[0, 0, 0], [speed, 0, 0]])
        found = rates_at(Scene(pair, LAW), support)
        assert (found.status, found.taken.rates.regime.tolist()) == ("unique", [regime])
        assert found.taken.rates.normal_force == pytest.approx([N])


@pytest.mark.parametrize(
    ("held", "motion", "said"),
    [
        ([[True, True]], None, "held: got shape"),
        ([True, False], [[0, 0, 0]], "motion: got shape"),
        ([True, False], [[0, 0, np.nan], [0, 0, 0]], r"motion\[0, 2\]: got nan"),
        ([True, False], [[0, 0, 0], [0, 1, 0]], "freedom 1 of grain 1"),
    ],
)
def test_a_support_that_does_not_fit_is_named(held, motion, said):
    with pytest.raises(InputError, match=said):
        Support(held, motion)


def test_questions_that_a_support_does_not_answer():
    with pytest.raises(InputError, match="2 grains"):
        rates_at(Scene(discs(20.0), LAW), Support([True, True], [[0, 1, 0], [0, 0, 0]]))
    with pytest.raises(InputError, match="zero everywhere"):
        rates_at(Scene(discs(20.0), LAW), Support([True] * 3))
    with pytest.raises(InputError, match="closure"):
        rates_at(Scene(discs(20.0), LAW), SUPPORT, closure="affine")
    with pytest.raises(InputError, match="may part"):
        pair = GrainGraph(x=[[0, 0], [1, 0]], radii=[0.5] * 2, contacts=[[0, 1]])
        slip_problem(pair, LAW, Support([True, True], [[0, 0, 0], [-1, 0, 0]]))
