"""The packing's rate problem against its own path, a dense solve, rotations and bounds."""

import numpy as np
import pytest
from scipy.sparse.linalg import splu

from grainloops import probe
from loops import (
    Boundary,
    GrainGraph,
    HertzMindlin,
    InputError,
    LinearFrictional,
    PlaneContacts,
    Regime,
    RollingResistance,
    Scene,
    affine_tangent,
    assemble_tangent,
    boundary_of,
    branch_vectors,
    contact_forces,
    contact_state,
    contact_tangent,
)
from loops.gears import spin_modes
from loops.system import balancing_forces, in_freedoms, relative_motion
from stability import rates_at
from stability.factor import UNIT_STRAINS
from stability.packing import response
from stability.packing.response import YIELD_BAND, rate_problem
from stability.programmes import component_control
from tests.oracles import eighty_bits
from tests.oracles.cohesive import Cohesive
from tests.packings import LAW, balanced, packing, step
from tests.stability.packing.yade_rest import STATES, yade_rest

H = np.array([[0.8, 0.3], [-0.1, -0.5]])


@pytest.mark.parametrize("increment", ["branch", "radii"])
@pytest.mark.parametrize("sliding", [0.0, 0.3])
def test_rates_are_the_slope_of_the_packings_own_path(increment, sliding):
    law = LinearFrictional(1.0, 0.5, 0.5, increment)
    graph = packing(24, seed=3, sliding=sliding)
    found = rates_at(Scene(graph, law), H=H, yield_band=1.0)
    assert found.status == ("one found" if sliding else "unique") and found.residual < 1e-9
    assert (found.sliding > 0) == (sliding > 0)
    guess = np.column_stack([found.motion, found.spin])
    errors = []
    for dt in (4e-4, 2e-4, 1e-4):
        _, force, _, excess = step(graph, law, found.regime, dt * H, dt * guess)
        rate = (force - contact_forces(graph)) / dt
        errors.append(np.abs(rate - found.force_rate).max())
        # Sticking would leave the cone where the rate problem says sliding, and only there.
        slides = found.regime == Regime.SLIDING
        assert (excess[slides] > 0).all() and (excess[~slides] < 1e-14).all()
    # One-sided differences: the error halves with the step.
    assert np.allclose(np.divide(errors[:-1], errors[1:]), 2.0, atol=0.1)


LAWS = {
    "radii": LAW,
    "Hertz": HertzMindlin(50.0, 0.3, 0.5),
    "rolling": RollingResistance(LAW, 0.1),
    "cohesive": Cohesive(1.0, 0.5, 0.5, 0.004),
}


def at_strength(graph, law, share):
    """The packing with some contacts exactly at the law's own strength."""
    rng = np.random.default_rng(0)
    on = rng.random(graph.contact_count) < share
    strength = law.strength(contact_state(graph))
    shear = np.where(on, np.sign(graph.shear_force) * strength, 0.3 * graph.shear_force)
    return graph.replace(shear_force=shear)


@pytest.mark.parametrize("name", LAWS)
def test_every_law_slides_where_its_own_rule_says_so(name):
    law = LAWS[name]
    graph = at_strength(packing(30, seed=2), law, 0.25)
    found = rates_at(Scene(graph, law), H=H, yield_band=1.0 - 1e-12)
    state, (i, j) = contact_state(graph), graph.contacts.T
    g, b_i, b_j = law.shear_kinematics(state)
    un = np.sum(state.n * found.branch_rate, axis=1)
    ut = g * np.sum(state.t * found.branch_rate, axis=1) - b_i * found.spin[i] - b_j * found.spin[j]
    assert found.candidates > found.sliding > 2
    assert np.array_equal(found.regime, law.regime(state, (un, ut)))


@pytest.mark.parametrize("name", LAWS)
def test_sparse_answer_is_the_dense_one(name):
    law, graph = LAWS[name], packing(30, seed=2)
    graph = at_strength(graph, law, 0.0)
    found = rates_at(Scene(graph, law), H=H)
    K = assemble_tangent(graph, law, spins=True)
    S = contact_tangent(contact_state(graph), law, np.ones(graph.contact_count, dtype=np.int8))
    stretch = -branch_vectors(graph) @ H.T
    force = -np.einsum("cij,cj->ci", S[:, :2, :2], stretch)
    loads = np.zeros((graph.grain_count, 3))
    i, j = graph.contacts.T
    np.add.at(loads, i, np.column_stack([force, np.sum(S[:, 2, :2] * stretch, axis=1)]))
    np.add.at(loads, j, np.column_stack([-force, np.sum(S[:, 3, :2] * stretch, axis=1)]))
    flat = np.concatenate([loads[:, :2].ravel(), loads[:, 2]])
    v = np.linalg.lstsq(K, -flat, rcond=1e-11)[0]
    u, w = v[: 2 * len(loads)].reshape(-1, 2), v[2 * len(loads) :]
    total = stretch + u[j] - u[i]
    motion = np.column_stack([total, w[i], w[j]])
    rate = -np.einsum("cij,cj->ci", S[:, :2], motion)
    assert np.abs(flat).max() > 0.1
    assert np.allclose(rate, found.force_rate, atol=1e-9)


def test_a_rotation_turns_forces_and_nothing_else():
    graph, spin = balanced(packing(24, seed=5)), np.array([[0.0, -1.0], [1.0, 0.0]])
    for increment in ("branch", "radii"):
        law = LinearFrictional(1.0, 0.5, np.inf, increment)
        found = rates_at(Scene(graph, law), H=-spin)
        assert np.abs(found.motion).max() < 1e-9
        assert np.allclose(found.spin[found.system.carrying.grains], 1.0, atol=1e-9)
        turned, c = contact_forces(graph) @ spin.T, found.system.contacts
        assert np.allclose(found.force_rate[c], turned[c], atol=1e-11)


def test_relaxed_grains_do_no_more_work_than_affine_ones():
    law = LinearFrictional(1.0, 0.5)
    for seed in range(4):
        graph = packing(30, seed=seed, share=0.0)
        work = np.sum(rates_at(Scene(graph, law), H=H).stress_rate * H)
        assert 0 < work < H.ravel() @ affine_tangent(graph, law).matrix @ H.ravel()


def test_stress_control_meets_the_strain_that_it_causes():
    graph = packing(30, seed=2, sliding=0.3)
    mixed = rates_at(
        Scene(graph, LAW), H=[[np.nan, 0.0], [0.0, 1.0]], P=[[0.25, np.nan], [np.nan, np.nan]]
    )
    assert mixed.status == "one found" and mixed.sliding > 0
    assert mixed.stress_rate[0, 0] == pytest.approx(0.25, abs=1e-9)
    again = rates_at(Scene(graph, LAW), H=mixed.strain_rate)
    assert np.allclose(again.force_rate, mixed.force_rate, atol=1e-9)


def test_large_packings_are_solved_in_parts_to_the_same_end(monkeypatch):
    graph = at_strength(packing(30, seed=4), LAW, 0.6)
    whole = rates_at(Scene(graph, LAW), H=H)
    monkeypatch.setattr(response, "CONDENSED", 5)
    parts = rates_at(Scene(graph, LAW), H=H)
    assert whole.candidates > 20 and 5 < whole.sliding < whole.candidates
    assert parts.status == "one found" and parts.residual < 1e-12
    assert np.allclose(parts.force_rate, whole.force_rate, atol=1e-9)


def test_rates_do_not_depend_on_units_or_place():
    graph = packing(24, seed=3, sliding=0.3)
    found = rates_at(Scene(graph, LAW), H=H)
    x, cell = 1e-3 * (graph.x + 64.0), 1e-3 * graph.cell
    moved = graph.replace(
        x=x,
        x0=x,
        radii=1e-3 * graph.radii,
        cell=cell,
        cell0=cell,
        normal_force=1e3 * graph.normal_force,
        shear_force=1e3 * graph.shear_force,
    )
    scaled = rates_at(Scene(moved, LinearFrictional(1e6, 5e5, 0.5, "radii")), H=H)
    assert scaled.sliding == found.sliding
    assert np.allclose(scaled.stress_rate, 1e6 * found.stress_rate, rtol=1e-9)


def renumbered(graph, seed):
    """The packing in other numbers, and the old number of each grain."""
    rng = np.random.default_rng(seed)
    grains, rows = rng.permutation(graph.grain_count), rng.permutation(graph.contact_count)
    ends = np.argsort(grains)[graph.contacts[rows]]
    return GrainGraph(
        x=graph.x[grains], radii=graph.radii[grains], contacts=ends,
        images=graph.images[rows], cell=graph.cell, normal_force=graph.normal_force[rows],
        shear_force=graph.shear_force[rows],
    ), grains  # fmt: skip


@pytest.mark.parametrize("regime", [None, "sliding"])
def test_motions_have_no_mean_and_other_numbers_the_same(regime):
    """All contacts of three grains slide in the second: nothing resists their spins."""
    graph = packing(24, seed=3, sliding=0.3)
    if regime:
        on = np.isin(graph.contacts, [2, 9, 17]).any(axis=1)
        law = np.sign(graph.shear_force) * float(LAW.mu) * graph.normal_force
        graph = graph.replace(shear_force=np.where(on, law, graph.shear_force))
    found = rates_at(Scene(graph, LAW), H=H, regime=regime)
    assert (found.status == "not converged") == (regime is not None)
    size = np.abs(found.motion).max()
    assert np.abs(found.motion.mean(axis=0)).max() < 1e-15 * size
    for seed in range(3):
        other, grains = renumbered(graph, seed)
        again = rates_at(Scene(other, LAW), H=H, regime=regime)
        # Free spins move fast under their load: others have the rounding of that.
        most = 1e-12 * max(size, np.abs(found.spin).max())
        np.testing.assert_allclose(again.motion, found.motion[grains], rtol=0, atol=most)
        np.testing.assert_allclose(again.spin, found.spin[grains], rtol=0, atol=most)


def test_what_carries_nothing_changes_nothing():
    graph = packing(24, seed=3)
    more = GrainGraph(
        x=np.vstack([graph.x, [[50.0, 50.0], graph.x[0] + 0.1, graph.x[0] + 0.2]]),
        radii=np.append(graph.radii, [0.5, 0.5, 0.5]),
        contacts=np.vstack([graph.contacts, [[0, 25], [25, 26]]]),
        normal_force=np.append(graph.normal_force, [1.0, 1.0]),
        shear_force=np.append(graph.shear_force, [0.0, 0.0]),
        images=np.vstack([graph.images, [[0, 0]] * 2]),
        cell=graph.cell,
    )
    one, two = rates_at(Scene(graph, LAW), H=H), rates_at(Scene(more, LAW), H=H)
    assert two.system.carrying.rattlers == one.system.carrying.rattlers + 3
    assert np.allclose(two.stress_rate, one.stress_rate, atol=1e-12)
    assert (two.force_rate[-2:] == 0).all()


@pytest.mark.parametrize("unit", [1.0, 2.0**-30])
@pytest.mark.parametrize("mu", [0.25, np.inf])
def test_a_strain_that_moves_a_mechanism_is_not_converged(mu, unit):
    """A square lattice of large and small discs: turning by turns, they load no contact."""
    number = np.arange(16).reshape(4, 4)
    pairs = [(number, np.roll(number, -1, axis)) for axis in (0, 1)]
    images = [np.zeros((4, 4, 2), dtype=int) for _ in pairs]
    images[0][-1, :, 0] = images[1][:, -1, 1] = 1
    i, j = np.divmod(number.ravel(), 4)
    graph = GrainGraph(
        x=0.98 * np.column_stack([i, j]),
        radii=np.where((i + j) % 2, 0.6, 0.4),
        contacts=np.concatenate([np.stack(pair, axis=-1).reshape(-1, 2) for pair in pairs]),
        images=np.concatenate(images).reshape(-1, 2),
        cell=0.98 * 4 * np.eye(2),
        normal_force=unit * np.full(32, 0.02),
        shear_force=unit * np.repeat([0.005, -0.005], 16),
    )
    law = LinearFrictional(unit * 1.0, unit * 0.5, mu)
    for strain in (np.diag([1.0, 0.0]), H):
        found = rates_at(Scene(graph, law), H=strain)
        assert (found.status, found.proof) == ("not converged", "mechanism")
        assert found.residual > 1e-3
    assert found.candidates == (32 if mu == 0.25 else 0)


def with_ratio(graph, contact, share):
    """The packing with one contact at a share of its strength, the others without shear force."""
    shear = np.zeros(graph.contact_count)
    shear[contact] = share * LAW.mu * graph.normal_force[contact]
    return graph.replace(shear_force=shear)


def test_contacts_of_a_grain_with_two_are_candidates_from_their_full_strength_on():
    graph = packing(24, seed=0)
    degree = np.bincount(graph.contacts.ravel())
    grain = int(np.flatnonzero(degree == 2)[0])
    of_two = int(np.flatnonzero((graph.contacts == grain).any(axis=1))[0])
    of_more = int(np.flatnonzero((degree[graph.contacts] > 2).all(axis=1))[0])
    for contact, share, counts in (
        (of_more, 0.995, (1, 0)),
        (of_two, 0.995, (0, 1)),
        (of_two, 1.0 - 1e-7, (1, 0)),
        (of_two, 1.0 - 1e-5, (0, 1)),
    ):
        found = rates_at(Scene(with_ratio(graph, contact, share), LAW), H=H)
        assert (found.candidates, found.settled) == counts
    # A wall is a third contact.
    wall = PlaneContacts(np.array([grain]), np.array([[0.0, 0.4]]), np.ones(1), np.zeros(1))
    found = rates_at(
        Scene(with_ratio(graph, of_two, 0.995), LAW, boundary_of(graph, walls=wall)), H=H
    )
    assert (found.candidates, found.settled) == (1, 0)


@pytest.mark.parametrize("condensed", [600, 5])
def test_contacts_of_a_grain_with_two_stick_where_nothing_is_found_otherwise(
    condensed, monkeypatch
):
    monkeypatch.setattr(response, "CONDENSED", condensed)
    graph = packing(30, seed=3, sliding=0.3)
    found = rates_at(Scene(graph, LAW), H=H)
    assert (found.status, found.proof) == ("one found", "two-contact grains stick")
    assert (found.candidates, found.settled, found.disagreeing) == (18, 2, 0)
    degree = np.bincount(graph.contacts.ravel())
    of_two = (degree[graph.contacts] == 2).any(axis=1)
    assert (found.regime[of_two] == Regime.ELASTIC).all()
    # Without them it is a solution like any other.
    shear = np.where(of_two, 0.9, 1.0) * graph.shear_force
    stuck = rates_at(Scene(graph.replace(shear_force=shear), LAW), H=H)
    proved = ("unique", "positive definite") if condensed == 600 else ("one found", "")
    assert (stuck.status, stuck.proof, stuck.settled) == (*proved, 0)
    assert np.array_equal(stuck.regime, found.regime)


def test_contacts_that_all_stand_at_yield():
    graph = packing(30, seed=2, sliding=1.0)
    found = rates_at(Scene(graph, LAW), H=H)
    assert found.candidates + found.settled == len(found.system.contacts)
    assert found.status == "none found" and 0 < found.disagreeing < found.candidates


def test_what_floats_or_has_no_area_is_refused():
    graph = packing(24, seed=3)
    plane = GrainGraph(graph.x, graph.radii, graph.contacts[:0])
    with pytest.raises(InputError, match="grains that all float"):
        rates_at(Scene(plane, LAW, Boundary(volume=1.0)), H=H, closure="packing")
    triangle = GrainGraph([[0, 0], [1, 0], [0, 1]], [0.6] * 3, [[0, 1], [1, 2], [2, 0]])
    with pytest.raises(InputError, match="float"):
        rates_at(Scene(triangle, LAW, Boundary(volume=1.0)), H=H, closure="packing")
    held = np.array([True, True, False])
    with pytest.raises(InputError, match="volume"):
        rates_at(Scene(triangle, LAW, Boundary(held=held)), H=H)
    boundary = Boundary(held=held, volume=0.5)
    assert rates_at(Scene(triangle, LAW, boundary), H=H).status == "unique"
    with pytest.raises(InputError, match=r"H: got shape \(2,\), expected shape \(2, 2\)"):
        rates_at(Scene(graph, LAW), H=[1.0, 2.0])
    with pytest.raises(InputError, match=r"stress_rate: got .* Give zero to hold the stress"):
        rates_at(Scene(graph, LAW), H=np.full((2, 2), np.nan), P=[[np.nan] * 2] * 2)


@pytest.mark.slow
@pytest.mark.parametrize("state", STATES)
def test_q_and_M_are_those_of_eighty_bits(state):
    """Straight from the contacts, all candidates sticking; slips are refined in 80 bits."""
    graph, law, _ = yade_rest(state)
    yielding = rate_problem(Scene(graph, law), yield_band=YIELD_BAND)
    rates, system, rows = yielding, yielding.system, yielding.rows
    q, M = rates.problem(component_control(H))
    modes = spin_modes(system.stiffness, system.ends, system.size)
    K, number = eighty_bits.matrix_of(system, modes)
    assert K.shape[0] == system.size and (number >= 0).all()
    affine = relative_motion(system, np.zeros((system.size, 4)), UNIT_STRAINS) @ H.ravel()
    strained = balancing_forces(system, np.einsum("eij,ej->ei", system.stiffness, affine))
    loads = np.column_stack([-in_freedoms(system, rows, yielding.push).T.toarray(), strained])
    lu = splu(K.astype(float).tocsc())
    motion = eighty_bits.refined(K, lu, loads.astype(eighty_bits.LONG)).astype(float)
    relative = np.array([relative_motion(system, v)[rows] for v in motion.T])
    edges = np.einsum("ci,kci->ck", yielding.gauge, relative)
    wanted = np.eye(len(rows)) + edges[:, :-1]
    np.testing.assert_allclose(M, wanted, rtol=0, atol=1e-13 * np.abs(wanted).max())
    wanted = edges[:, -1] + np.sum(yielding.gauge * affine[rows], axis=1)
    np.testing.assert_allclose(q, wanted, rtol=0, atol=1e-13 * np.abs(wanted).max())


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_a_stress_that_does_not_determine_the_strain_is_refused(angle):
    """A row of grains across the cell resists a stretch along itself alone, in every frame."""
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    row = GrainGraph(
        x=[[0, 0], [0.99, 0]] @ turn.T, radii=[0.5, 0.5], contacts=[[0, 1], [1, 0]],
        images=[[0, 0], [1, 0]], cell=turn @ np.diag([1.98, 3.0]), normal_force=[0.01, 0.01],
    )  # fmt: skip
    for P in (np.diag([1.0, -1.0]), np.diag([1.0, 0.0])):
        with pytest.raises(InputError, match="do not determine the strain rates"):
            rates_at(Scene(row, LAW), P=turn @ P @ turn.T)
    if not angle:
        with pytest.raises(InputError, match="do not determine the strain rates"):
            probe(Scene(row, LAW), 4, control="stress")
    assert rates_at(Scene(row, LAW), H=np.eye(2)).status == "unique"
