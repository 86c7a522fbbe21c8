"""Kinematic structural stability: the control that destabilises, and the path that shows it."""

import numpy as np
import pytest

from loops import InputError, LinearFrictional, Scene, boundary_of
from patterns import diamond
from stability import (
    Stage,
    destabilising_control,
    follow,
    plane_cone,
    softening_control,
    strain_driven,
    symmetric_modes,
    symmetric_spectrum,
)
from stability.destabilising import constrained_tangent, control_status
from tests.oracles.diamond import (
    TABLE_1,
    TABLE_2,
    elastic_moduli,
    stress_of_isotropic_strain,
    tangent,
)


def random_operators(seed, count, m):
    return np.random.default_rng(seed).standard_normal((count, m, m))


def smallest_singular_value(matrix):
    return np.linalg.svd(matrix, compute_uv=False)[-1]


def falls(strength, length):
    """Whether the strength falls with every step; events repeat a row."""
    moves = np.diff(length) > 0
    assert moves.sum() >= 3 and np.abs(np.diff(strength)[~moves]).max(initial=0.0) < 1e-15
    return bool((np.diff(strength)[moves] < 0).all())


def diamond_at_A(table):
    """Tangent (26), graph and law of the diamond at the end of its confinement; nothing slides."""
    E = table.confinement
    s1, s2 = stress_of_isotropic_strain(E, table.alpha0)
    K = tangent(E, E, s1, s2, table.alpha0, *elastic_moduli(table.kappa))
    law = LinearFrictional(kn=1.0, kt=table.kappa)
    return K, diamond(table.alpha0, E1=E, E2=E), law, 2 * np.sin(2 * table.alpha0)


@pytest.mark.parametrize("m", [2, 3, 4])
def test_constrained_operators_are_singular_for_indefinite_ones(m):
    found = 0
    for K in random_operators(m, 300, m):
        control = destabilising_control(K)
        values = symmetric_spectrum(K)
        assert control.status == ("found" if values[0] < 0 < values[-1] else "definite")
        if control.status != "found":
            assert np.isnan(control.direction).all()
            continue
        found += 1
        norm = np.linalg.norm(K)
        x, held = control.direction, control.held
        assert abs(x @ K @ x) < 1e-14 * norm and abs(control.work) < 1e-14 * norm
        np.testing.assert_allclose(K @ x, control.reaction * held, atol=2e-14 * norm)
        frame = np.vstack([x, held, control.free])
        np.testing.assert_allclose(frame @ frame.T, np.eye(m), atol=1e-14)
        assert smallest_singular_value(constrained_tangent(K, control)) < 1e-14 * norm
        # Strain held, stresses held, stress driven: no such load can be added.
        driven = np.vstack([held, control.free @ K, x @ K])
        assert smallest_singular_value(driven) < 3e-14 * norm
        assert smallest_singular_value(K) > 1e-6 * norm
    assert found > 150


@pytest.mark.parametrize("m", [2, 3, 4])
def test_definite_operators_resist_every_linear_control(m):
    rng = np.random.default_rng(20 + m)
    for K in random_operators(30 + m, 40, m):
        skew = 0.5 * (K - K.T)
        definite = 0.1 * np.eye(m) + 0.2 * K @ K.T + 3 * skew
        assert destabilising_control(definite).status == "definite"
        least = symmetric_spectrum(definite)[0]
        for held in range(m):
            Q = np.linalg.qr(rng.standard_normal((20, m, m - held)))[0]
            projected = np.swapaxes(Q, -1, -2) @ definite @ Q
            values = np.linalg.svd(projected, compute_uv=False)[:, -1]
            assert values.min() >= least * (1 - 1e-12)


@pytest.mark.parametrize("m", [2, 3, 4])
def test_weaker_reaction_is_held(m):
    for K in random_operators(50 + m, 50, m):
        control = destabilising_control(K)
        if control.status != "found":
            continue
        values, vectors = symmetric_modes(K)
        b = np.arctan(np.sqrt(-values[0] / values[-1]))
        pair = [np.cos(b) * vectors[:, 0] + s * np.sin(b) * vectors[:, -1] for s in (1, -1)]
        sizes = [np.linalg.norm(K @ x) for x in pair]
        np.testing.assert_allclose(control.reaction, min(sizes), rtol=1e-11)
        assert abs(pair[int(np.argmin(sizes))] @ control.direction) > 1 - 1e-12


@pytest.mark.parametrize("table", [TABLE_1, TABLE_2])
def test_isotropic_directions_of_the_diamond_are_edges_of_its_cone(table):
    K, *_ = diamond_at_A(table)
    x = destabilising_control(K).direction
    angle = np.arctan2(x[1], x[0]) % np.pi
    edges = plane_cone(K).edges % np.pi
    assert min(abs(edges - angle)) < 1e-14


def test_diamond_of_table_1_in_closed_form():
    # K = (1/2) [[1 + d, 1 - d], [1 - d, 1 + d]]: eigenvalues 1 along (1, 1), d = kappa - E/(1 - E).
    K, *_ = diamond_at_A(TABLE_1)
    d = 0.2 - 0.3 / 0.7
    control = destabilising_control(K)
    b = np.arctan(np.sqrt(-d))
    expected = np.cos(b) * np.array([1, -1]) + np.sin(b) * np.array([1, 1])
    np.testing.assert_allclose(np.abs(control.direction @ expected), np.sqrt(2), rtol=1e-14)
    # |K x|^2 = cos(b)^2 d^2 + sin(b)^2 = -d for x in the eigenframe.
    np.testing.assert_allclose(control.reaction, np.sqrt(-d), rtol=1e-13)


@pytest.mark.parametrize("table", [TABLE_1, TABLE_2])
def test_path_under_the_control_loses_strength_in_one_sense(table):
    K, graph, law, volume = diamond_at_A(table)
    control = destabilising_control(K)
    lost = []
    for rate in (1.0, -1.0):
        stage = Stage(strain_driven(control, "diagonal", rate), "parameter", 0.02)
        path = follow(Scene(graph, law, boundary_of(graph, volume=volume)), stage, closure="affine")
        assert path.status == "finished"
        strain = (path.H - path.H[0])[:, [0, 3]]
        np.testing.assert_allclose(strain @ control.held, 0, atol=1e-13)
        strength = rate * (path.P - path.P[0])[:, [0, 3]] @ control.direction
        length = rate * strain @ control.direction
        # A peak in the state itself: no term of first order.
        early = (length > 0) & (length < 0.005)
        assert np.abs(strength[early] / length[early]).max() < 0.01
        lost.append(falls(strength, length))
        assert lost[-1] == bool(strength[-1] < 0)
    assert sorted(lost) == [False, True]


@pytest.mark.parametrize("table", [TABLE_1, TABLE_2])
def test_path_inside_the_cone_softens_at_once(table):
    K, graph, law, volume = diamond_at_A(table)
    control = softening_control(K)
    assert control.work == pytest.approx(symmetric_spectrum(K)[0], rel=1e-12)
    path = follow(
        Scene(graph, law, boundary_of(graph, volume=volume)),
        Stage(strain_driven(control, "diagonal"), "parameter", 0.02),
        closure="affine",
    )
    strength = (path.P - path.P[0])[:, [0, 3]] @ control.direction
    length = (path.H - path.H[0])[:, [0, 3]] @ control.direction
    assert falls(strength, length)
    k = int(np.argmax(length > 1e-6))
    np.testing.assert_allclose(strength[k] / length[k], control.work, rtol=20 * length[k])


@pytest.mark.parametrize(("m", "subspace"), [(2, "diagonal"), (3, "symmetric"), (4, "full")])
def test_programmes_say_what_the_control_says(m, subspace):
    rng = np.random.default_rng(m)
    basis = {2: np.eye(4)[[0, 3]], 3: None, 4: np.eye(4)}[m]
    if basis is None:
        basis = np.array([[1, 0, 0, 0], [0, 0, 0, 1], [0, 0.5**0.5, 0.5**0.5, 0]])
    K = rng.standard_normal((m, m))
    assert control_status(K) == "found"
    A = basis.T @ K @ basis + (np.eye(4) - basis.T @ basis)
    control = destabilising_control(K)
    strain = strain_driven(control, subspace, 2.0)
    H = np.linalg.solve(strain.stress @ A + strain.strain, strain.rate)
    np.testing.assert_allclose(H, 2 * control.direction @ basis, atol=1e-12)


def test_refusals():
    assert destabilising_control([[1.0, 1.0], [1.0, 1.0]]).status == "singular"
    assert destabilising_control([[-1.0, 0.5], [0.0, -1.0]]).status == "definite"
    assert destabilising_control([[1.0, np.nan], [1.0, 1.0]]).status == "undetermined"
    # Semi-definite Ks, regular K: the isotropic vector sits on the boundary, within the tolerance.
    assert destabilising_control([[1.0, 1.0], [-1.0, 0.0]]).status == "undetermined"
    assert softening_control(np.eye(2)).status == "definite"
    assert softening_control([[1.0, 1.0], [-1.0, 0.0]]).status == "undetermined"
    with pytest.raises(InputError, match="inside the instability cone"):
        softening_control([[1.0, 0.0], [0.0, -1.0]], [2.0, 1.0])
    with pytest.raises(InputError, match="direction"):
        softening_control([[1.0, 0.0], [0.0, -1.0]], [0.0, 0.0])
    with pytest.raises(InputError, match="operator"):
        destabilising_control(np.zeros((3, 2, 2)))
    with pytest.raises(InputError, match="control"):
        strain_driven(destabilising_control(np.eye(2)), "diagonal")
    with pytest.raises(InputError, match="control"):
        strain_driven(destabilising_control(np.diag([1.0, -1.0])), "symmetric")


def test_symmetric_operator_along_its_own_direction_needs_no_reaction():
    control = softening_control(np.diag([1.0, 2.0, -0.5]))
    assert control.reaction == 0 and control.work == -0.5
    frame = np.vstack([control.direction, control.held, control.free])
    np.testing.assert_allclose(np.abs(np.linalg.det(frame)), 1, rtol=1e-14)
