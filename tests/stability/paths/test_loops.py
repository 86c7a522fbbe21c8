"""Paths of longer loops and of packings, under both closures."""

import numpy as np
import pytest

from loops import (
    GrainGraph,
    LinearFrictional,
    Regime,
    Scene,
    assemble_tangent,
    boundary_vectors,
    contact_forces,
    contact_state,
    macroscopic_tangent,
    nominal_stress,
)
from patterns import regular_polygon
from stability import Stage, follow, programmes
from tests.oracles.diamond import DiamondParameters
from tests.oracles.drained import drained_path as exact_drained_path
from tests.oracles.drained import drained_states

CLOSURES = ("affine", "traction")
SPINS = ("blocked", "affine", "free")
INCLINED = [0, 2, 3, 5]


def isotropic(E):
    return Stage(programmes.isotropic_strain(), "H11", E)


def drained(E, rate=1.0):
    return Stage(programmes.drained_biaxial(rate=rate), "H11", E)


def state_of(path, row, graph):
    """The grain graph of one row."""
    return graph.replace(
        x=path.x[row],
        contacts=path.contacts,
        normal_force=path.normal_force[row],
        shear_force=path.shear_force[row],
    )


@pytest.mark.parametrize(("confinement", "closure"), [(0.1, "affine"), (0.25, "traction")])
def test_inclined_contacts_of_a_hexagon_follow_the_diamond(confinement, closure):
    kappa, phi = 0.2, np.radians(8.0)
    exact = exact_drained_path(DiamondParameters(np.radians(60), kappa, phi, confinement))
    law = LinearFrictional(kn=1.0, kt=kappa, mu=np.tan(phi))
    stages = [isotropic(confinement), drained(float(exact.end.E1) + 0.03)]
    path = follow(Scene(regular_polygon(6), law), stages, closure=closure)
    (event,) = path.of_kind("yield")
    assert list(event.contacts) == INCLINED
    row = event.index
    assert path.normal_force[row, INCLINED] == pytest.approx(float(exact.end.N), abs=1e-13)
    assert np.abs(path.shear_force[row, INCLINED]) == pytest.approx(float(exact.end.T), abs=1e-13)
    # Beyond it too, until the branch has turned upright.
    rows = np.flatnonzero(path.stage == 1)
    d = path.x[rows, 1] - path.x[rows, 0]
    alpha = np.arctan2(d[:, 1], -d[:, 0])
    beyond = (alpha > np.radians(60) + 1e-9) & (alpha < np.radians(89))
    state, regime = drained_states(exact, alpha[beyond])
    assert path.normal_force[rows[beyond], 0] == pytest.approx(state.N, abs=1e-12)
    assert np.abs(path.shear_force[rows[beyond], 0]) == pytest.approx(state.T, abs=1e-12)
    assert "sliding" in regime.tolist()


@pytest.mark.parametrize(
    ("order", "closure", "threshold"),
    [
        (3, "affine", 1.2 / 2.2),
        (3, "traction", 1.2 / 2.2),
        (5, "affine", 1.2 / 2.2),
        (5, "traction", 0.2 / 1.2),
        (8, "traction", 0.2 / 1.2),
    ],
)
def test_isotropic_thresholds_of_regular_polygons(order, closure, threshold):
    law = LinearFrictional(kn=1.0, kt=0.2)
    path = follow(Scene(regular_polygon(order), law), isotropic(threshold + 0.02), closure=closure)
    event = path.of_kind("det_Ks_zero")[0]
    assert path.H[event.index, 0] == pytest.approx(threshold, abs=1e-12)


@pytest.mark.parametrize("spins", SPINS)
@pytest.mark.parametrize("closure", CLOSURES)
def test_rows_agree_with_the_closures_and_the_stress(closure, spins):
    graph = regular_polygon(5)
    law = LinearFrictional(kn=1.0, kt=0.3, mu=0.08)
    shear = programmes.combination(np.zeros((4, 4)), np.eye(4), [0, 1, 0.4, 0], "shear")
    stages = [isotropic(0.08), Stage(shear, "H12", 0.04)]
    path = follow(Scene(graph, law), stages, closure=closure, spins=spins)
    # Free spins roll the shear away.
    assert (path.regime == Regime.SLIDING).any() == (spins != "free")
    for row in (1, len(path) // 2, len(path) - 1):
        state = state_of(path, row, graph)
        assert path.P[row] == pytest.approx(nominal_stress(state).ravel(), abs=1e-15)
        assert path.normal_force[row] == pytest.approx(
            law.normal_force(contact_state(state)), abs=1e-15
        )
        A = macroscopic_tangent(state, law, closure, spins=spins, regime=path.regime[row])
        size = np.linalg.norm(A.matrix)
        assert path.A[row] == pytest.approx(A.matrix, abs=1e-11 * size)
        assert path.P_rate[row] == pytest.approx(A.matrix @ path.H_rate[row], abs=1e-11 * size)


def test_traction_path_stays_in_balance():
    rng = np.random.default_rng(7)
    graph = _balanced_ring(rng)
    law = LinearFrictional(kn=1.0, kt=0.3, mu=0.6)
    path = follow(Scene(graph, law), [isotropic(0.05), drained(0.06)], closure="traction")
    assert path.status == "finished"
    assert path.imbalance.max() < 1e-13
    state = state_of(path, -1, graph)
    i, j = path.contacts.T
    balance = -boundary_vectors(graph.x0) @ path.P[-1].reshape(2, 2).T
    np.add.at(balance, i, -contact_forces(state))
    np.add.at(balance, j, contact_forces(state))
    assert np.abs(balance).max() < 1e-13
    assert np.abs(path.energy_error).max() < 1e-12


def _balanced_ring(rng):
    """An irregular hexagon of unequal grains that just touch: no force, hence in balance."""
    x = regular_polygon(6).x * 1.3 + rng.uniform(-0.12, 0.12, (6, 2))
    ring = np.column_stack([np.arange(6), np.roll(np.arange(6), -1)])
    sides = np.hypot(*(np.roll(x, -1, axis=0) - x).T)
    # r_c + r_{c+1} = side c: six equations of rank five; the last side is made to fit.
    matrix = np.eye(6) + np.roll(np.eye(6), 1, axis=1)
    radii = np.linalg.lstsq(matrix, sides)[0]
    touching = radii + np.roll(radii, -1)
    return _with_sides(x, radii, touching, ring)


def _with_sides(x, radii, sides, ring):
    """Move the centres until every side has its length (Newton, smallest displacement)."""
    for _ in range(20):
        d = np.roll(x, -1, axis=0) - x
        lengths = np.hypot(*d.T)
        n = d / lengths[:, None]
        jacobian = np.zeros((6, 12))
        for c, (i, j) in enumerate(ring):
            jacobian[c, 2 * i : 2 * i + 2], jacobian[c, 2 * j : 2 * j + 2] = -n[c], n[c]
        x = x + np.linalg.lstsq(jacobian, sides - lengths)[0].reshape(6, 2)
    return GrainGraph(x=x, radii=radii, contacts=ring)


@pytest.mark.parametrize(
    ("order", "kappa", "phi", "confinement", "end"),
    [
        # Beyond B of Table 1 the four free grains of the diamond find other ways.
        (4, 0.2, 5.0, 0.3, 0.55),
        (6, 0.237, 11.8, 0.046, 0.2),
    ],
)
def test_branching_is_where_the_balance_of_the_grains_is_singular(
    order, kappa, phi, confinement, end
):
    law = LinearFrictional(kn=1.0, kt=kappa, mu=np.tan(np.radians(phi)))
    graph = regular_polygon(order)
    path = follow(Scene(graph, law), [isotropic(confinement), drained(end)], closure="traction")
    assert path.status == "finished"
    (event,) = path.of_kind("branching")
    # Determinants of states around it, at Chebyshev points, and the root of their polynomial.
    points = event.H[0] + 4e-3 * np.cos(np.pi * (np.arange(9, -1, -1) + 0.5) / 10)
    stages = [isotropic(confinement), *(drained(E) for E in points)]
    path = follow(Scene(graph, law), stages, closure="traction")
    rows = [np.flatnonzero(path.stage == stage)[-1] for stage in range(1, 11)]
    determinants = [_controlled_determinant(path, row, law, graph) for row in rows]
    roots = np.polynomial.Polynomial.fit(points, determinants, 9).roots()
    (root,) = [root.real for root in roots if abs(root - event.H[0]) < 2e-3]
    assert event.H[0] == pytest.approx(root, abs=1e-11)
    assert event.parameter == pytest.approx(root, abs=1e-11)


def _controlled_determinant(path, row, law, graph):
    """Determinant of balance, gradient and drained control for (u, P, H), mean motion zero."""
    state, m = state_of(path, row, graph), 2 * graph.grain_count
    K = assemble_tangent(state, law, regime=path.regime[row])
    B, V = boundary_vectors(graph.x0), path.volume
    system = np.zeros((m + 8, m + 8))
    system[:m, :m] = K + np.kron(np.ones((m // 2, m // 2)), np.eye(2))
    for a in range(2):
        system[a:m:2, m + 2 * a : m + 2 * a + 2] = B
        system[m + 2 * a : m + 2 * a + 2, a:m:2] = B.T
    system[m : m + 4, m + 4 :] = V * np.eye(4)
    system[m + 4 : m + 7, m + 4 : m + 7] = np.eye(3)
    system[m + 7, m + 3] = 1.0
    return np.linalg.det(system)


@pytest.mark.parametrize("spins", SPINS)
def test_rigid_turn_of_a_periodic_or_free_loop_changes_nothing(spins):
    """Objectivity: a rotation path leaves N; with spins that follow it leaves T too."""
    graph = regular_polygon(5, strain=0.1)
    law = LinearFrictional(kn=1.0, kt=0.3)

    class Rotation(programmes.Programme):
        def equations(self, H, P):
            # F' = W F: H' = -W (I - H), W the unit rotation.
            F = np.eye(2) - H.reshape(2, 2)
            W = np.array([[0.0, -1.0], [1.0, 0.0]])
            return self.stress, self.strain, -(W @ F).ravel()

    turn = Rotation("turn", np.zeros((4, 4)), np.eye(4), np.array([0.0, 1.0, -1.0, 0.0]))
    path = follow(Scene(graph, law), Stage(turn, "parameter", 0.5), spins=spins, closure="affine")
    assert path.normal_force[-1] == pytest.approx(path.normal_force[0], abs=1e-12)
    if spins == "blocked":
        assert path.shear_force[-1] == pytest.approx(-0.3 * 0.9 * 0.5, abs=1e-12)
    else:
        assert path.shear_force[-1] == pytest.approx(0.0, abs=1e-12)
