"""Statuses of the packing's rate problem, held to a brute force over all regimes."""

from itertools import product

import numpy as np
import pytest

from grainloops import probe
from loops import GrainGraph, InputError, LinearFrictional, Scene
from loops.system import carrying_grains
from patterns import synthetic_network
from stability import rates_at
from stability.complementarity import Complementarity
from stability.packing import response
from stability.packing.response import rate_problem
from stability.regimes import of_sets
from tests.oracles.regimes import solutions

STRAINS = [np.diag([1.0, 0.0]), np.diag([1.0, -1.0]), np.array([[0.3, 0.5], [0.2, -0.6]])]
AT_YIELD = 1.0 - 1e-9


def small(grains, seed, share, force=0.03, kt=0.1, coordination=3.6):
    """The carrying contacts of a small periodic packing, a share of them at yield; its law."""
    cell = [[3.0, 0.2], [-0.2, 2.8]]
    graph = synthetic_network(grains, seed=seed, cell=cell, coordination=coordination)
    rng = np.random.default_rng(seed)
    count, law = graph.contact_count, LinearFrictional(1.0, kt, 0.5)
    normal, on = np.full(count, force), rng.random(count) < share
    side = np.sign(rng.normal(size=count))
    shear = law.mu * normal * np.where(on, side, rng.uniform(-0.8, 0.8, count))
    closed, free = np.ones(count, dtype=bool), np.zeros(grains, dtype=int)
    kept = carrying_grains(graph, closed, free).contacts
    return GrainGraph(
        x=graph.x,
        radii=graph.radii,
        contacts=graph.contacts[kept],
        images=graph.images[kept],
        cell=graph.cell,
        normal_force=normal[kept],
        shear_force=shear[kept],
    ), law


def at_yield(graph, law):
    strength = law.mu * graph.normal_force
    return np.flatnonzero(np.abs(graph.shear_force) >= AT_YIELD * strength)


def held_to_brute_force(cases, most):
    """Compare the statuses of packings that have up to `most` contacts at yield; how many."""
    expected = {0: "none", 1: "unique"}
    seen = dict.fromkeys(("none", "unique", "several"), 0)
    for grains, seed, share, force, kt in cases:
        try:
            graph, law = small(grains, seed, share, force, kt)
        except InputError:
            continue
        rows = at_yield(graph, law)
        if not 1 <= len(rows) <= most:
            continue
        H = STRAINS[seed % 3]
        found = rates_at(Scene(graph, law), H=H, yield_band=AT_YIELD)
        count = len(solutions(graph, law, H, rows))
        # A family counts as its corners, and any others.
        status = "several" if found.families else found.status
        assert status == expected.get(count, "several"), (grains, seed, share, force, kt)
        assert (found.status == "family") == bool(found.families)
        assert found.proof == "enumeration" and found.settled == 0
        seen[status] += 1
    return seen


def test_statuses_are_those_of_a_brute_force_over_all_regimes():
    cases = product((8, 12), range(25), (0.15, 0.4), (0.03,), (0.1, 0.5))
    seen = held_to_brute_force(cases, 5)
    assert seen["none"] > 10 and seen["several"] > 10 and seen["unique"] > 50


@pytest.mark.slow
def test_statuses_of_a_thousand_packings_are_those_of_a_brute_force():
    cases = product((8, 10, 12, 16), range(40), (0.15, 0.4, 0.7), (0.003, 0.03), (0.1, 0.5))
    seen = held_to_brute_force(cases, 8)
    assert sum(seen.values()) > 1000 and min(seen.values()) > 100


def test_a_packing_whose_contacts_at_yield_all_soften_has_no_solution():
    graph = synthetic_network(8, seed=0, cell=[[3.0, 0.2], [-0.2, 2.8]], coordination=3.6)
    normal = np.full(graph.contact_count, 0.03)
    shear = np.where(np.arange(len(normal)) == 0, 0.5 * normal, 0.0)
    graph = graph.replace(normal_force=normal, shear_force=shear)
    law = LinearFrictional(1.0, 0.1, 0.5)
    found = rates_at(Scene(graph, law), H=STRAINS[0])
    assert (found.status, found.candidates, found.proof) == ("none", 1, "enumeration")
    assert (np.diag(rate_problem(Scene(graph, law), yield_band=0.99).whole.of_slip) < 0).all()
    assert (probe(Scene(graph, law), 8).status == "none").any()


def turned(graph, angle):
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    return graph.replace(x=graph.x @ turn.T, cell=turn @ graph.cell), turn


CHAINS = [
    ((8, 104, 0.4, 1e-5, 0.1, 3.3), [1, 2]),
    ((8, 8, 0.4, 1e-4, 0.5, 3.0), [1, 2, 3]),
]


@pytest.mark.parametrize(("packing", "sliding"), CHAINS, ids=["two slips", "three slips"])
def test_a_soft_chain_that_nothing_holds_is_no_solution(packing, sliding):
    """Grains with two contacts in a row, whose slips have a matrix that is singular to rounding.

    Its forces are a small share of the others': they are judged by themselves.
    """
    graph, law = small(*packing)
    rows = at_yield(graph, law)
    for k, H in enumerate(STRAINS):
        other, turn = turned(graph, 0.4 * k)
        found = rates_at(Scene(other, law), H=turn @ H @ turn.T, yield_band=AT_YIELD)
        assert (found.status, found.proof) == ("none", "enumeration")
        assert len(solutions(graph, law, H, rows)) == 0
    # Regimes that rounding would choose leave the chain out of balance.
    rates = rate_problem(Scene(graph, law), yield_band=AT_YIELD)
    active = np.isin(np.arange(len(rates.every)), sliding)
    found = of_sets(Complementarity(active[None], "enumeration"))
    control = response.component_control(STRAINS[0])
    told = rates._solved(active, found, control).response
    assert told.residual < 1e-6 and told.status == "not converged"


@pytest.mark.parametrize("columns", [2, 3, 4])
def test_a_lattice_strained_across_its_contacts_at_yield_has_one_answer(columns):
    """Columns keep their length: what is at yield in them may stick or slide."""
    at = np.arange(columns)
    x = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2).astype(float)
    i, j = x.astype(int).T
    right, up = (i + 1) % columns + columns * j, i + columns * ((j + 1) % columns)
    images = np.zeros((2, len(x), 2), dtype=int)
    images[0, :, 0], images[1, :, 1] = i + 1 == columns, j + 1 == columns
    sides = np.where(np.random.default_rng(0).random(len(x)) < 0.5, 1.0, -1.0)
    graph = GrainGraph(
        x=x,
        radii=[0.505] * len(x),
        contacts=np.concatenate([np.column_stack([np.arange(len(x)), to]) for to in (right, up)]),
        images=np.concatenate(images),
        cell=columns * np.eye(2),
        normal_force=np.full(2 * len(x), 0.01),
        shear_force=np.concatenate([0.0 * sides, 0.005 * sides]),
    )
    for k in range(6):
        other, turn = turned(graph, 0.3 * k)
        H = turn @ STRAINS[0] @ turn.T
        found = rates_at(Scene(other, LinearFrictional(1.0, 0.5, 0.5)), H=H)
        assert found.status == ("unique" if len(x) < 12 else "one found")
        assert found.neutral.tolist() == list(range(len(x), 2 * len(x)))
        np.testing.assert_allclose(turn.T @ found.stress_rate @ turn, STRAINS[0], atol=1e-13)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("increment", ["branch", "radii"])
@pytest.mark.parametrize("kt", [1e-3, 0.3, 0.5, 0.7, 1.0])
def test_slip_that_nothing_answers_has_no_solution_whatever_rounding_leaves(kt, increment):
    """One grain of a row and its image: slip makes it spin and changes no shear force, `M` is 0.

    Stretched along the row the contact loses strength and its shear force can't follow.
    """
    row = GrainGraph(
        x=[[0, 0]],
        radii=[0.505],
        contacts=[[0, 0]],
        images=[[1, 0]],
        cell=np.diag([1.0, 3.0]),
        normal_force=[0.01],
        shear_force=[0.005],
    )
    law = LinearFrictional(1.0, kt, 0.5, increment)
    rates = rate_problem(Scene(row, law), yield_band=AT_YIELD)
    given = response.component_control(np.diag([1.0, 0.0]), None)
    assert rates.problem(given)[1].tolist() == [[0.0]]
    found = probe(Scene(row, law), [[1.0, 0.3], [1.0, -0.3], [-1.0, 0.3], [-1.0, -0.3]])
    assert found.status.tolist() == ["unique", "unique", "none", "none"]
    assert set(found.proof) == {"enumeration"}
