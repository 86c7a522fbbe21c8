"""The rate problem: random complementarity problems, none, several, and ties."""

from dataclasses import dataclass
from itertools import product

import numpy as np
import pytest

from loops import LinearFrictional, Regime, Scene
from patterns import diamond, random_loop, regular_polygon
from stability import Stage, directional_work, follow, programmes, rates_at
from stability.complementarity import Complementarity
from stability.packing.response import MECHANISM, TRUSTED, _status
from stability.regimes import (
    CHOICES,
    HELD_STUCK,
    LEFT,
    OPEN,
    RIGHT,
    STICKS,
    EdgeProblem,
    EdgeRates,
    SlipProblem,
    agreeing,
    of_sets,
)


def may(count, *regimes):
    """Options of contacts that may all take these regimes."""
    return np.tile(np.isin(CHOICES, regimes), (count, 1))


def slips(count):
    return may(count, STICKS, LEFT)


@dataclass(frozen=True, eq=False)
class Trial:
    edge: EdgeRates
    vector: np.ndarray
    trusted: bool = True


def solved(options, rates_for, **given):
    return agreeing(EdgeProblem(options, rates_for), **given)


def complementarity(M, q):
    """Rates of `w = q + M z`, `w, z >= 0`, `w.z = 0`: a contact with `z > 0` slides by z."""

    def rates_for(regimes):
        sliding = regimes == LEFT
        z = np.zeros(len(q))
        if sliding.any():
            z[sliding] = np.linalg.solve(M[np.ix_(sliding, sliding)], -q[sliding])
        w = q + M @ z
        shear = np.where(sliding, z, -w)
        return Trial(EdgeRates(np.zeros(len(q)), shear, np.zeros(len(q))), z)

    return rates_for


def solutions_by_brute_force(M, q):
    found = []
    for sliding in product([False, True], repeat=len(q)):
        S = np.array(sliding)
        z = np.zeros(len(q))
        if S.any():
            z[S] = np.linalg.solve(M[np.ix_(S, S)], -q[S])
        if (z >= 0).all() and (q + M @ z >= -1e-12).all():
            found.append(z)
    return found


@pytest.mark.parametrize("seed", range(20))
def test_positive_definite_problems_have_one_solution(seed):
    rng = np.random.default_rng(seed)
    B = rng.normal(size=(6, 6))
    M, q = B @ B.T + 0.1 * np.eye(6), rng.normal(size=6)
    found = solved(slips(6), complementarity(M, q))
    assert (found.status, found.exhaustive) == ("unique", True)
    (z,) = solutions_by_brute_force(M, q)
    assert found.taken.rates.vector == pytest.approx(z, abs=1e-10)


@pytest.mark.parametrize("seed", range(20))
def test_indefinite_problems_are_counted(seed):
    rng = np.random.default_rng(100 + seed)
    M, q = rng.normal(size=(5, 5)), rng.normal(size=5)
    found = solved(slips(5), complementarity(M, q))
    count = len(solutions_by_brute_force(M, q))
    assert found.status == ("none", "unique", "several")[min(count, 2)]
    assert len(found.solutions) == count


@pytest.mark.parametrize("seed", range(10))
def test_pivoting_solves_what_is_too_many_to_try(seed):
    rng = np.random.default_rng(seed)
    B = rng.normal(size=(30, 30))
    M, q = B @ B.T / 30 + 0.3 * np.eye(30), rng.normal(size=30)
    found = solved(slips(30), complementarity(M, q))
    assert (found.status, found.exhaustive) == ("one found", False)
    z = found.taken.rates.vector
    w = q + M @ z
    assert z.min() >= -1e-9
    assert w.min() >= -1e-9
    assert np.abs(z * w).max() < 1e-9


@pytest.mark.parametrize(
    ("contacts", "status"), [(4, "none"), (5, "none"), (16, "none"), (17, "none")]
)
def test_none_is_said_where_every_combination_was_tried(contacts, status):
    """Up to 4 contacts at yield by their rates, up to 16 by their slips, beyond by a proof."""
    # w = -1 - z can never be positive.
    M, q = -np.eye(contacts), -np.ones(contacts)
    M[:, 0] -= 0.5
    found = solved(slips(contacts), complementarity(M, q))
    assert (found.status, found.exhaustive, found.solutions) == (status, True, ())
    proofs = {4: "", 17: "infeasible"}
    assert found.proof == proofs.get(contacts, "enumeration")


def test_without_a_proof_none_was_found():
    """Slips with `w >= 0` exist, but `w2 = 1 + z2` lets the second contact stick alone."""
    M, q = np.eye(17), np.ones(17)
    M[0, :2], q[0] = [-1.0, 2.0], -1.0
    found = solved(slips(17), complementarity(M, q))
    assert (found.status, found.exhaustive, found.proof) == ("none found", False, "")


@pytest.mark.parametrize("seed", range(6))
def test_slips_find_all_that_brute_force_finds(seed):
    """Ten contacts of an indefinite problem; pivoting alone stops at the first solution."""
    rng = np.random.default_rng(200 + seed)
    M, q = rng.normal(size=(10, 10)) + 1.5 * np.eye(10), rng.normal(size=10)
    found = solved(slips(10), complementarity(M, q))
    wanted = solutions_by_brute_force(M, q)
    assert len(found.solutions) == len(wanted) and found.exhaustive
    rates = [one.rates.vector for one in found.solutions]
    np.testing.assert_allclose(
        sorted(rates, key=tuple), sorted(wanted, key=tuple), rtol=0, atol=1e-9
    )


def test_other_regimes_are_pivoted_alone():
    """Nine contacts that may part, whose pivots cycle: more than the search tries."""

    def rates_for(regimes):
        opens = regimes == OPEN
        # An open contact would close, a closed one part.
        un = np.where(opens, -1.0, 1.0)
        return Trial(EdgeRates(un, np.zeros(9), np.ones(9)), un)

    found = solved(may(9, STICKS, OPEN, LEFT), rates_for)
    assert (found.status, found.exhaustive, found.combinations) == ("none found", False, 3.0**9)


def test_slips_of_eight_contacts_have_the_solutions_of_all_combinations():
    """Oracle: all 256 combinations by another solve. Of slips a solve each is enough."""
    graph, statuses = random_loop(8, seed=8, polydispersity=0.3, strain=0.02), set()
    at_yield = graph.replace(shear_force=0.5 * graph.normal_force * (-1.0) ** np.arange(8))
    scene = Scene(at_yield, LinearFrictional(1.0, 0.3, 0.5))
    ways = np.random.default_rng(1).normal(size=(6, 4))
    work = directional_work(scene, directions=ways, closure="traction", subspace="full")
    for k, e in enumerate(work.directions.reshape(-1, 2, 2)):
        found = rates_at(scene, H=e, closure="traction")
        assert (found.proof, found.combinations) == ("enumeration", 256.0) and found.tried < 24
        assert found.status == work.status[k]
        statuses.add(found.status)
        if found.solutions:
            works = sorted(float(np.sum(one.rates.stress_rate * e)) for one in found.solutions)
            np.testing.assert_allclose(works[:: max(len(works) - 1, 1)], np.unique(work.work[k]))
    assert len(statuses) > 1


def test_a_loop_of_14_at_yield_has_two_solutions():
    """They differ in one contact, and pivoting met neither. Oracle: all 16,384 combinations."""
    graph = random_loop(14, seed=14, polydispersity=0.3, strain=0.02, convex=False)
    law = LinearFrictional(1.0, 0.3, 0.5)
    at_yield = graph.replace(shear_force=0.5 * graph.normal_force)
    found = rates_at(Scene(at_yield, law), programmes.drained_biaxial(), closure="traction")
    assert (found.status, found.exhaustive, found.tried < 30) == ("several", True, True)
    regimes = {tuple(one.rates.mode.regime.tolist()) for one in found.solutions}
    first = [1, 1, 1, 1, 2, 2, 1, 2, 1, 1, 1, 1, 2, 1]
    assert regimes == {tuple(first), (*first[:2], 2, *first[3:])}


def test_neutral_contacts_are_one_solution_and_the_preference_names_it():
    rates_for = complementarity(np.eye(2), np.array([0.0, -1.0]))
    for preferred in ([STICKS, LEFT], [LEFT, LEFT]):
        found = solved(slips(2), rates_for, preferred=np.array(preferred))
        assert found.status == "unique"
        assert found.taken.regimes.tolist() == preferred
        assert found.taken.agreeing.sum(axis=1).tolist() == [2, 1]


def test_of_several_the_symmetric_one_comes_first_then_the_nearest():
    # w1 = 1 - 2 z2, w2 = 1 - 2 z1 and so on: stick, slide both, or either alone.
    M, q = np.array([[1.0, -2.0], [-2.0, 1.0]]), np.array([1.0, 1.0])
    found = solved(slips(2), complementarity(M, q))
    assert found.status == "several"
    assert [each.regimes.tolist() for each in found.solutions] == [[STICKS] * 2, [LEFT] * 2]
    sliding = np.array([1.0, 1.0])
    near = solved(slips(2), complementarity(M, q), direction=sliding)
    assert near.taken.regimes.tolist() == [LEFT] * 2


def test_untrusted_combinations_are_counted_apart():
    def rates_for(regimes):
        return Trial(EdgeRates(np.zeros(1), np.ones(1), np.zeros(1)), np.zeros(1), trusted=False)

    found = solved(slips(1), rates_for)
    assert (found.status, found.singular) == ("none", 2)


@pytest.mark.parametrize(
    ("un", "shear", "expected"),
    [(1.0, 0.0, OPEN), (-1.0, 0.05, STICKS), (-1.0, 0.5, LEFT), (-1.0, -0.5, RIGHT)],
)
def test_a_touching_contact_parts_sticks_or_slides_either_way(un, shear, expected):
    def rates_for(regimes):
        return Trial(
            EdgeRates(np.array([un]), np.array([shear]), np.array([-0.1 * un])), np.ones(1)
        )

    found = solved(may(1, *CHOICES), rates_for)
    assert found.status == "unique"
    assert found.taken.regimes.tolist() == [expected]


@pytest.mark.parametrize("closure", ["affine", "traction"])
@pytest.mark.parametrize(
    ("programme", "regime"),
    [
        (programmes.isotropic_strain(), Regime.ELASTIC),
        (programmes.proportional_strain(1.0, -0.9), Regime.SLIDING),
    ],
)
def test_virgin_diamond_takes_the_regime_of_its_direction(programme, regime, closure):
    law = LinearFrictional(kn=1.0, kt=0.5, mu=0.1)
    found = rates_at(Scene(diamond(np.pi / 4), law), programme, closure=closure)
    assert found.taken.rates.mode.regime.tolist() == [regime] * 4
    assert (found.status, found.exhaustive) == ("unique", True)


@pytest.mark.parametrize("closure", ["affine", "traction"])
def test_virgin_diamond_parts_without_force(closure):
    law = LinearFrictional(kn=1.0, kt=0.5, mu=0.1)
    found = rates_at(Scene(diamond(0.8), law), programmes.isotropic_strain(-1.0), closure=closure)
    assert found.status == "unique"
    assert not np.abs(found.taken.rates.rates.P).max() > 1e-15
    # Relaxed centres may keep a contact that carries nothing; affine ones part everywhere.
    regimes = found.taken.rates.mode.regime.tolist()
    assert closure == "traction" or regimes == [Regime.OPEN] * 4


def test_virgin_ring_of_many_contacts_is_solved_by_pivoting():
    law = LinearFrictional(kn=1.0, kt=0.5, mu=0.1)
    found = rates_at(Scene(regular_polygon(40), law), programmes.oedometric(), closure="affine")
    assert (found.status, found.exhaustive) == ("one found", False)
    rates = found.taken.rates
    # Affine rates of each contact decide alone: s T' > mu N' slides, un' > 0 parts.
    normal, trial = -law.kn * rates.rates.un, -law.kt * rates.rates.ut
    expected = np.where(np.abs(trial) > law.mu * normal, Regime.SLIDING, Regime.ELASTIC)
    neutral = np.abs(rates.rates.un) < 1e-12
    assert rates.mode.regime[~neutral].tolist() == expected[~neutral].tolist()


def test_a_ring_without_continuation_says_so():
    # Regular 12-gon: where its second group of contacts yields, neither sticking nor sliding of
    # either group agrees with prolonged compression, forwards or backwards.
    law = LinearFrictional(kn=1.0, kt=0.2, mu=0.05)
    stages = [
        Stage(programmes.isotropic_strain(), "H11", 0.05),
        Stage(programmes.drained_biaxial(), "H11", 0.1),
    ]
    path = follow(Scene(regular_polygon(12), law), stages, closure="traction")
    assert path.status == "no_solution"
    (event,) = path.of_kind("control_limit")
    assert event.contacts == (2, 3, 8, 9)
    shear, limit = np.abs(path.shear_force[-1]), law.mu * path.normal_force[-1]
    assert np.isclose(shear, limit, rtol=1e-10, atol=0).sum() == 8


def among(q, M, count=14):
    """Contacts of a small problem, and others that stick whatever they do."""
    whole = np.eye(count)
    whole[: len(q), : len(q)] = M
    return np.append(q, np.ones(count - len(q))), whole


# The second contact has to slip for the first one, and would not.
LOST = among(np.array([-1.0, 1.0]), np.array([[-1.0, 2.0], [0.0, 1.0]]))


@pytest.mark.parametrize(
    ("problem", "status", "proof", "sliding"),
    [
        (SlipProblem(np.array([-1.0, 1.0]), np.eye(2)), "unique", "enumeration", [1]),
        (SlipProblem(*among([-1.0], [[1.0]])), "unique", "positive definite", [1]),
        (SlipProblem(*among([-1.0], [[-1.0]])), "none", "infeasible", []),
        (SlipProblem(-np.ones(2), np.array([[1.0, 2.0], [2.0, 1.0]])), "several", "enumeration",
         [2, 1, 1]),
        (SlipProblem(-np.ones(2), np.ones((2, 2))), "family", "enumeration", None),
        (SlipProblem(*LOST), "none found", "", []),
        (SlipProblem(*LOST, free=np.arange(14) > 0), "one found", HELD_STUCK, [0]),
    ],
)  # fmt: skip
def test_sets_that_slide_are_sought_by_the_same_search(problem, status, proof, sliding):
    found = agreeing(problem)
    assert (found.status, found.proof) == (status, proof)
    assert found.exhaustive == (status not in ("none found", "one found"))
    assert found.combinations == 2.0 ** len(problem.q)
    for one in found.solutions:
        assert (one.regimes == LEFT).tolist() == one.rates.tolist()
    if sliding is not None:
        assert [int(one.rates.sum()) for one in found.solutions] == sliding


def test_known_sets_are_all_where_something_proves_it():
    q, M = among([-1.0], [[1.0]])
    first = np.arange(14) == 0
    found = agreeing(SlipProblem(q, M), known=[first, ~first], complete="told")
    assert (found.status, found.proof, len(found.solutions)) == ("unique", "told", 1)
    assert found.taken.rates.tolist() == first.tolist()


def test_a_mechanism_or_a_residual_takes_the_certainty_from_a_packing():
    found = agreeing(SlipProblem(np.array([-1.0, 1.0]), np.eye(2)))
    assert _status(found, found.proof, 0.0) == "unique"
    assert _status(found, MECHANISM, 0.0) == "one found"
    assert _status(found, found.proof, 2 * TRUSTED) == "not converged"
    none = agreeing(SlipProblem(*among([-1.0], [[-1.0]])))
    assert _status(none, none.proof, 1.0) == "none"
    assert _status(none, MECHANISM, 1.0) == "not converged"


@pytest.mark.parametrize("count", [10, 1023, 1024, 3000])
def test_more_combinations_than_a_float_holds(count):
    """Packings have thousands of contacts at yield."""
    found = of_sets(Complementarity(np.zeros((1, count), dtype=bool), "given"))
    assert found.combinations == 2.0 ** min(count, 1023)
    assert found.solutions[0].regimes.shape == (count,)
