"""Contacts added where opposite grains meet: thresholds, drained stage, what is written."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from loops import LinearFrictional, affine_tangent
from patterns import diamond
from stability import restrict, symmetric_spectrum
from studies.paths.options import DiamondOptions
from tests.oracles.diamond import added_critical_strain, definite_intervals, isotropic_tangents
from tests.studies.paths.followed import followed


def added(**arguments):
    return followed(contact_on_touch="add", **arguments)


def graph_operator(alpha0, kappa, E1, E2=None, T=0.0, axes=(True, True)):
    """(11, 22) of a grain graph with contacts between overlapping opposite grains."""
    graph = diamond(alpha0, E1=E1, E2=E1 if E2 is None else E2, T=T)
    pairs = [pair for pair, wanted in zip(((0, 2), (1, 3)), axes, strict=True) if wanted]
    across = [np.linalg.norm(graph.x[i] - graph.x[j]) for i, j in pairs]
    pairs, across = zip(*[(p, d) for p, d in zip(pairs, across, strict=True) if d < 1], strict=True)
    graph = graph.replace(
        contacts=np.concatenate([graph.contacts, pairs]),
        normal_force=np.concatenate([graph.normal_force, 1.0 - np.array(across)]),
        shear_force=np.concatenate([graph.shear_force, np.zeros(len(pairs))]),
    )
    law = LinearFrictional(kn=1.0, kt=kappa)
    return restrict(affine_tangent(graph, law, volume=2 * np.sin(2 * alpha0)).matrix, "diagonal")


# Isotropic strain


@pytest.mark.parametrize(
    ("alpha0", "axes"),
    [(45.0, (True, True)), (35.0, (False, True)), (55.0, (True, False)), (35.0, (True, True))],
)
@pytest.mark.parametrize("kappa", [0.05, 0.24, 0.9])
def test_critical_strain_is_the_root_of_a_graph_with_chords(alpha0, axes, kappa):
    loop = DiamondOptions(alpha0_deg=alpha0, kappa=kappa).parameters
    found = added_critical_strain(loop, axes)

    def lowest(E):
        return symmetric_spectrum(graph_operator(loop.alpha0, kappa, E, axes=axes))[0]

    root = brentq(lowest, found - 0.02, found + 0.02, xtol=1e-15)
    assert abs(root - found) < 1e-13
    assert lowest(found - 0.01) > 0.0 > lowest(found + 0.01)


@pytest.mark.parametrize("kappa", [0.05, 0.24, 0.9])
def test_with_both_contacts_the_diamond_has_the_triangles_limit(kappa):
    for alpha0 in (32.0, 45.0, 57.0):
        loop = DiamondOptions(alpha0_deg=alpha0, kappa=kappa).parameters
        limit = added_critical_strain(loop, (True, True))
        assert limit == pytest.approx((1.0 + kappa) / (2.0 + kappa), rel=1e-15)


@pytest.mark.parametrize("table", [1, 2])
@pytest.mark.parametrize("with_contacts", [False, True])
def test_definite_intervals_are_those_of_the_eigenvalues(table, with_contacts):
    loop = DiamondOptions(table=table).parameters
    E, K = isotropic_tangents(loop, added=with_contacts)
    eigenvalues = symmetric_spectrum(K)
    intervals = definite_intervals(loop, added=with_contacts)
    for strain, lowest in zip(E, eigenvalues[:, 0], strict=True):
        clear = all(abs(strain - end) > 1e-9 for pair in intervals for end in pair)
        if np.isfinite(strain) and clear:
            assert (lowest > 0.0) == any(a < strain < b for a, b in intervals)


def test_added_contacts_start_unloaded():
    for table in (1, 2):
        path = added(table=table)
        for kind, row in path.listed:
            if kind in ("opposite_contact", "opening"):
                rows = path.states.take([row, row + 1])
                np.testing.assert_allclose(rows.s1, rows.s1[0], rtol=1e-14)
                np.testing.assert_allclose(rows.s2, rows.s2[0], rtol=1e-14)
                assert (rows.added[0] != rows.added[1]).any()


# Drained stage


@pytest.mark.parametrize("table", [1, 2])
def test_drained_stage_agrees_with_an_integration_in_forces(table):
    """To the first event: unknowns l, alpha and T under F2 held, contact by contact."""
    path = added(table=table)
    loop = path.loop
    start, (stop, kind) = (
        path.marks["A"] + 1,
        next((row, kind) for kind, row in path.listed if row > path.marks["A"]),
    )
    assert kind in ("opening", "opposite_contact")
    touching = path.states.added[start]
    L10, L20, states = 2 * np.cos(loop.alpha0), 2 * np.sin(loop.alpha0), path.states
    F2 = states.s2[start] * L10

    def lateral(E2, E1, T):
        L1, L2 = L10 * (1 - E1), L20 * (1 - E2)
        length, a = 0.5 * np.hypot(L1, L2), np.arctan2(L2, L1)
        return 2 * ((1 - length) * np.sin(a) - T * np.cos(a)) + touching[1] * (1 - L2) - F2

    def geometry(E1, T):
        E2 = brentq(lateral, -0.3, 0.4, args=(E1, T), xtol=1e-15)
        L1, L2 = L10 * (1 - E1), L20 * (1 - E2)
        return E2, 0.5 * np.hypot(L1, L2), np.arctan2(L2, L1)

    def rate(E1, T):
        # dT = kappa l d(alpha), by a central difference of alpha at T held and moved.
        h = 1e-6
        turn = (geometry(E1 + h, T[0])[2] - geometry(E1 - h, T[0])[2]) / (2 * h)
        with_T = (geometry(E1, T[0] + h)[2] - geometry(E1, T[0] - h)[2]) / (2 * h)
        arc = loop.kappa * geometry(E1, T[0])[1]
        return [arc * turn / (1.0 - arc * with_T)]

    span = states.E1[start], states.E1[stop]
    T = solve_ivp(rate, span, [0.0], "DOP853", rtol=1e-10, atol=1e-13).y[0, -1]
    E2 = geometry(span[1], T)[0]
    assert abs(T - states.T[stop]) < 1e-9
    assert abs(E2 - states.E2[stop]) < 1e-9


# The last two pass next to K22 = 0 as the contacts start to slide: the path turns sharply there.
@pytest.mark.parametrize(
    "arguments",
    [
        {"table": 1},
        {"table": 2},
        {"alpha0_deg": 30.0},
        {"alpha0_deg": 31.6179, "kappa": 1.1501, "phi_deg": 24.5084, "confine": 0.03169},
        {"alpha0_deg": 30.4361, "kappa": 2.7997, "phi_deg": 5.1495, "confine": 0.59145},
    ],
    ids=str,
)
def test_energy_balance_closes_with_contacts(arguments):
    path = added(**arguments)
    assert path.energy_imbalance() < 5e-12
    assert np.all(np.diff(path.energies["dissipated"]) >= 0.0)
    s2 = path.states.s2[path.stage == "drained"]
    np.testing.assert_allclose(s2, s2[0], rtol=1e-13)


@pytest.mark.parametrize("table", [1, 2])
def test_tangents_with_contacts_are_those_of_a_graph_with_chords(table):
    path = added(table=table)
    found = path.verification()
    assert found["generic_vs_closed_form_max_relative"] < 1e-13
    assert found["det_K_max_difference"] < 1e-13
    assert found["generic_affine_untrusted"] == found["generic_traction_untrusted"] == 0
    elastic = path.states.added.any(axis=1) & ~path.states.sliding
    for row in np.flatnonzero(elastic)[5::97]:
        s = path.states
        K = graph_operator(path.loop.alpha0, path.loop.kappa, s.E1[row], s.E2[row], s.T[row])
        np.testing.assert_allclose(path.states.K[row], K, atol=1e-13)


def test_contacts_make_the_diamond_stable_and_hardening():
    for table in (1, 2):
        path = added(table=table)
        drained = path.stage == "drained"
        assert symmetric_spectrum(path.states.K[drained])[:, 0].min() > 0.05
        assert np.all(np.diff(path.states.s1[drained]) > -1e-14)
        assert not any(path.states.K[drained, 1, 1] <= 0.0)


def test_yield_with_contacts_stands_on_coulombs_cone():
    path = added(table=1)
    row = path.marks["B"]
    assert abs(path.states.T[row] - path.loop.mu * path.states.N[row]) < 1e-13
    slides = path.states.sliding
    ratio = path.states.T[slides] / path.states.N[slides]
    np.testing.assert_allclose(ratio, path.loop.mu, rtol=1e-10)


# Files
