"""Probes of lattices known by hand, of the paper's diamond, against one response at a time."""

import sys

import numpy as np
import pytest

from grainloops import probe
from loops import Boundary, InputError, LinearFrictional, Scene, affine_tangent, find_faces
from stability import complementarity, plane_cone, rates_at, regimes, restrict
from stability.packing import regime_regions, response
from stability.packing.response import CRITICAL, SCALED
from tests.oracles.diamond import elastic_moduli, sliding_moduli, tangent
from tests.oracles.lattices import lattice, lattice_rates
from tests.packings import LAW, packing

# The function hides it.
probe_module = sys.modules["stability.packing.probe"]
# Contacts that are put exactly on their strength are found there up to rounding.
AT_YIELD = 1.0 - 1e-9
LATTICE_LAW = LinearFrictional(1.0, 0.5, 0.3)


def turned(angle, vectors):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]]) @ np.asarray(vectors, dtype=float)


SQUARE = turned(0.4, np.eye(2)), [(1, 0), (0, 1)], [0.01, 0.02], [0.003, -0.003], (True, False)


def against_hand(case, cells, directions=24):
    vectors, branches, normal, shear, at_yield = case
    graph = lattice(vectors, branches, np.array(normal), np.array(shear), cells)
    found = probe(Scene(graph, LATTICE_LAW), directions, yield_band=AT_YIELD)
    count = cells[0] * cells[1]
    for k, H in enumerate(found.strain_rate):
        ((P, slides),) = lattice_rates(vectors, branches, normal, shear, LATTICE_LAW, H, at_yield)
        assert np.allclose(found.stress_rate[k], P, atol=1e-14)
        assert found.work[k] == pytest.approx(np.sum(P * H), abs=1e-14)
        assert found.sliding[k] == count * np.count_nonzero(slides)
    assert 0 < np.count_nonzero(found.sliding) < directions
    return found


def test_a_square_lattice_sheared_to_yield_answers_as_by_hand():
    found = against_hand(SQUARE, (1, 1))
    assert (found.status == "unique").all()
    # Rows of the lattice share the slip in any proportion: other regimes, the same stress.
    wider = against_hand(SQUARE, (2, 2))
    assert np.array_equal(wider.status == "family", wider.sliding > 0)
    assert np.allclose(wider.stress_rate, found.stress_rate, atol=1e-14)


ALPHA0, KAPPA = np.radians(40.0), 0.2


def rhombic(E1, E2, share, mu):
    """The diamond tiled, and its closed tangents in the present configuration."""
    half = np.array([(1 - E1) * np.cos(ALPHA0), (1 - E2) * np.sin(ALPHA0)])
    N = 1.0 - np.linalg.norm(half)
    T = share * mu * N
    alpha = np.arctan2(half[1], half[0])
    F1, F2 = (
        2 * (N * np.cos(alpha) + T * np.sin(alpha)),
        2 * (N * np.sin(alpha) - T * np.cos(alpha)),
    )
    s = F1 / (2 * np.sin(ALPHA0)), F2 / (2 * np.cos(ALPHA0))
    # T is positive when alpha grows: clockwise on the branch that falls.
    graph = lattice(np.column_stack([half, half * [1, -1]]), [(1, 0), (0, 1)], [N, N], [-T, T])
    to_stress, to_strain = np.diag([1 / (1 - E2), 1 / (1 - E1)]), np.diag([1 - E1, 1 - E2])
    moduli = elastic_moduli(KAPPA), sliding_moduli(alpha, mu, np.sign(share))
    tangents = [to_stress @ tangent(E1, E2, *s, ALPHA0, *pair) @ to_strain for pair in moduli]
    return graph, tangents, (alpha, N, T)


def test_one_diamond_tiled_has_the_papers_polar_diagram():
    graph, (K, _), _ = rhombic(0.35, 0.25, 0.4, 0.5)
    found = probe(Scene(graph, LinearFrictional(1.0, KAPPA, 0.5)), 72)
    P = found.directions @ K.T
    assert np.allclose(found.stress_rate[:, [0, 1], [0, 1]], P, atol=1e-13)
    w2 = np.sum(found.directions * P, axis=1) / np.linalg.norm(P, axis=1)
    assert np.allclose(found.normalised, w2, atol=1e-13) and w2.min() < -0.1
    # One piece, so the cone is double: both nappes, to the closed form's angles.
    edges = plane_cone(K).edges
    assert found.cones.shape == (2, 2) and found.refined.all() and len(found.arcs) == 1
    assert np.allclose(np.mod(found.cones[0] - edges + 1, np.pi), 1, atol=1e-9)
    assert np.allclose(found.cones[1] - found.cones[0], np.pi, atol=1e-9)
    assert found.unstable_fraction == pytest.approx(plane_cone(K).opening / np.pi, abs=1e-9)
    assert found.destabilising.status == "found" and abs(found.destabilising.work) < 1e-9


@pytest.mark.parametrize("side", [1, -1])
def test_one_diamond_tiled_slides_as_the_papers_does(side):
    mu = 0.4
    graph, (elastic, sliding), (alpha, N, T) = rhombic(0.15, 0.1, side, mu)
    found = probe(Scene(graph, LinearFrictional(1.0, KAPPA, mu)), 72, yield_band=AT_YIELD)
    length = 1.0 - N
    e1, e2 = found.directions.T
    more = length * (e1 * np.cos(alpha) ** 2 + e2 * np.sin(alpha) ** 2)
    trial = KAPPA * length * (e1 - e2) * np.sin(alpha) * np.cos(alpha)
    slides = np.sign(T) * trial > mu * more
    P = np.where(slides[:, None], found.directions @ sliding.T, found.directions @ elastic.T)
    assert np.array_equal(found.sliding == 8, slides) and 10 < slides.sum() < 60
    assert np.allclose(found.stress_rate[:, [0, 1], [0, 1]], P, atol=1e-13)
    # The paper blocks the spins. Free ones allow other regimes too; the least slip is its answer.
    assert found.determined.all()


def test_elastic_packings_are_never_stiffer_than_the_affine_sum():
    law = LinearFrictional(1.0, 0.5)
    for seed in range(4):
        graph = packing(30, seed=seed, share=0.0)
        A = restrict(affine_tangent(graph, law).matrix, "symmetric")
        found = probe(Scene(graph, law), 40, subspace="symmetric")
        affine = np.einsum("di,ij,dj->d", found.directions, A, found.directions)
        assert (found.work > 0).all() and (found.work < affine).all()
        assert found.destabilising.status == "definite" and found.unstable_fraction == 0.0


def said(found, k):
    """Statuses of one response: a probe proves more of them, of what a search alone has found."""
    proved = found.proof[k] in (SCALED, CRITICAL)
    searched = {"unique": "one found", "none": "none found"}
    return {found.status[k]} | ({searched.get(found.status[k], "several")} if proved else set())


@pytest.mark.parametrize("subspace", ["diagonal", "symmetric"])
def test_strain_probes_are_the_responses_one_by_one(subspace):
    graph = packing(30, seed=3, sliding=0.3)
    found = probe(Scene(graph, LAW), 24, subspace=subspace)
    assert len(found.arcs) > 5 and found.residual.max() < 1e-12
    for k, H in enumerate(found.strain_rate):
        one = rates_at(Scene(graph, LAW), H=H)
        assert one.status in said(found, k) and found.sliding[k] == one.sliding
        size = np.abs(one.stress_rate).max()
        assert np.allclose(found.stress_rate[k], one.stress_rate, rtol=0, atol=1e-13 * size)
        elastic = rates_at(Scene(graph, LinearFrictional(1.0, 0.5, np.inf, "radii")), H=H)
        assert np.allclose(found.elastic_stress[k], elastic.stress_rate, atol=1e-12)


def test_stress_probes_are_the_responses_one_by_one():
    graph = packing(30, seed=3, sliding=0.3)
    found = probe(Scene(graph, LAW), 12, control="stress")
    assert found.determined.sum() > 5 and len(found.arcs) > 3
    for k, (p1, p2) in enumerate(found.directions):
        one = rates_at(
            Scene(graph, LAW), H=[[np.nan, 0], [0, np.nan]], P=[[p1, np.nan], [np.nan, p2]]
        )
        assert one.status in said(found, k)
        if found.determined[k]:
            assert np.allclose(found.strain_rate[k], one.strain_rate, rtol=1e-10, atol=1e-12)
            assert np.allclose(np.diag(found.stress_rate[k]), [p1, p2], atol=1e-11)
        else:
            assert np.isnan(
                [found.work[k], found.normalised[k], *found.stress_rate[k].ravel()]
            ).all()


def test_stress_on_the_sphere_keeps_the_strain_symmetric():
    graph = packing(30, seed=3, sliding=0.3)
    found = probe(Scene(graph, LAW), 12, control="stress", subspace="symmetric")
    known = found.determined
    assert known.any()
    H, P = found.strain_rate[known], found.stress_rate[known]
    assert np.allclose(H, np.swapaxes(H, 1, 2), atol=1e-12)
    parts = np.stack([P[:, 0, 0], P[:, 1, 1], (P[:, 0, 1] + P[:, 1, 0]) / 2**0.5], axis=1)
    assert np.allclose(parts, found.directions[known], atol=1e-10)
    assert found.unstable_fraction == pytest.approx(np.mean(found.work[known] < 0), abs=1e-12)


def test_many_contacts_at_yield_are_probed_one_direction_after_the_other(monkeypatch):
    graph = packing(30, seed=3, sliding=0.3)
    whole = probe(Scene(graph, LAW), 6)
    monkeypatch.setattr(response, "CONDENSED", 3)
    parts = probe(Scene(graph, LAW), 6)
    assert np.array_equal(parts.sliding, whole.sliding)
    assert np.allclose(parts.stress_rate, whole.stress_rate, atol=1e-12)


def test_directions_that_are_not_searched_are_answered_by_the_branches(monkeypatch):
    """Every fifth of 24 is; its branches have the solutions of all."""
    graph = packing(16, 1, sliding=0.3)
    monkeypatch.setattr(regime_regions.RegimeRegions, "_prove", lambda self: None)
    everywhere = probe(Scene(graph, LAW), 24, yield_band=AT_YIELD)
    count = everywhere.candidates
    assert count > 5 and everywhere.determined.all() and everywhere.closed
    monkeypatch.setattr(probe_module, "SEARCH_WORK", 24 * count**3 / 5)
    assert probe_module.search_step(count, 24) == 5
    searched = []

    def counted(q, M, starts, *rest, **given):
        searched.append(starts)
        return complementarity.solve_complementarity(q, M, starts, *rest, **given)

    monkeypatch.setattr(regimes, "solve_complementarity", counted)
    fewer = probe(Scene(graph, LAW), 24, yield_band=AT_YIELD)
    assert np.count_nonzero(searched[:24]) == 5
    np.testing.assert_allclose(fewer.stress_rate, everywhere.stress_rate, rtol=1e-12)


def test_a_step_of_searches_is_one_up_to_592_contacts():
    assert [probe_module.search_step(m, 72) for m in (0, 592, 593, 746, 747)] == [1, 1, 2, 2, 3]


def test_loops_carry_the_samples_work():
    graph = packing(30, seed=3, sliding=0.3)
    faces = find_faces(graph)
    found = probe(Scene(graph, LAW), 12)
    assert np.allclose(found.loop_work.sum(axis=1), found.work, rtol=1e-11)
    assert np.array_equal(found.order, faces.order[faces.loops])
    assert found.area.sum() == pytest.approx(found.system.volume)


def under_load(seed, sliding):
    """A packing whose normal forces are a tenth of kn l: soft, with contacts at yield."""
    graph = packing(30, seed=seed, sliding=sliding)
    return graph.replace(normal_force=10 * graph.normal_force, shear_force=10 * graph.shear_force)


def at_angle(theta):
    return [[np.cos(theta), np.sin(theta)]]


def test_cones_end_where_the_work_of_the_regimes_there_vanishes():
    graph = under_load(7, 0.3)
    found = probe(Scene(graph, LAW), 72)
    assert len(found.cones) == 1 and found.refined.all() and found.determined.all()
    for begin, end in found.cones:
        for angle, inwards in ((begin, 1e-4), (end, -1e-4)):
            assert abs(probe(Scene(graph, LAW), at_angle(angle)).normalised[0]) < 1e-8
            assert probe(Scene(graph, LAW), at_angle(angle + inwards)).normalised[0] < -1e-7
            assert probe(Scene(graph, LAW), at_angle(angle - inwards)).normalised[0] > 1e-7
    width = np.ptp(found.cones, axis=1).sum()
    assert found.unstable_fraction == pytest.approx(width / (2 * np.pi), rel=1e-12)
    assert found.unstable_fraction == pytest.approx(np.mean(found.work < 0), abs=2 / 72)


@pytest.mark.parametrize(("control", "sliding"), [("strain", 0.6), ("stress", 0.3)])
def test_a_cone_next_to_what_is_undetermined_ends_where_its_work_is_still_negative(
    control, sliding
):
    graph = under_load(0, sliding)
    found = probe(Scene(graph, LAW), 36, control=control)
    sharp = found.refined.ravel()
    assert sharp.any() and not sharp.all() and not found.determined.all()
    for angle, refined in zip(found.cones.ravel(), sharp, strict=True):
        there = probe(Scene(graph, LAW), at_angle(angle), control=control).normalised[0]
        assert abs(there) < 1e-8 if refined else there < -1e-4


def test_the_destabilising_control_calls_up_nothing_but_the_reaction():
    graph = under_load(7, 0.3)
    control = probe(Scene(graph, LAW), 72).destabilising
    there = probe(Scene(graph, LAW), [control.direction])
    stress = np.diag(there.stress_rate[0])
    assert control.held @ control.direction == pytest.approx(0.0, abs=1e-12)
    assert np.allclose(stress, control.reaction * control.held, atol=1e-8)
    # Of the two edges, the one whose reaction is weaker.
    ends = [
        probe(Scene(graph, LAW), at_angle(end)) for end in probe(Scene(graph, LAW), 72).cones[0]
    ]
    reactions = [np.linalg.norm(np.diag(end.stress_rate[0])) for end in ends]
    assert control.reaction == pytest.approx(min(reactions), rel=1e-6)
    assert max(reactions) > 1.01 * min(reactions)
    # On the sphere it lies along the softest direction.
    sphere = probe(Scene(graph, LAW), 40, subspace="symmetric")
    assert np.allclose(sphere.destabilising.direction, sphere.directions[sphere.softest])
    assert sphere.destabilising.work == pytest.approx(sphere.work[sphere.softest], rel=1e-9)


def test_a_rate_that_vanishes_at_the_end_of_an_arc_agrees_with_either_regime():
    graph = packing(30, seed=6, sliding=0.3)
    ends = probe(Scene(graph, LAW), 36).arcs[:, 1]
    found = probe(Scene(graph, LAW), np.column_stack([np.cos(ends), np.sin(ends)]))
    assert found.determined.all() and (found.disagreeing == 0).all() and len(ends) > 20


def test_where_there_is_no_solution_nothing_is_said():
    found = probe(Scene(under_load(0, 0.3), LAW), 72)
    unknown = ~found.determined
    assert 10 < unknown.sum() < 60
    assert np.isin(found.status[unknown], ["none", "none found"]).all()
    assert np.isnan(found.work[unknown]).all() and np.isnan(found.loop_work[unknown]).all()
    assert "undetermined" in str(found)
    # Beyond its strength a sample answers to no load at all.
    graph = under_load(2, 0.6)
    loads = probe(Scene(graph, LAW), 36, control="stress")
    lost = probe(Scene(graph, LAW), loads.directions[~loads.determined], control="stress")
    assert len(lost.directions) == 30 and lost.softest is None and len(lost.cones) == 0
    assert np.isnan(lost.unstable_fraction) and lost.destabilising.status == "undetermined"


def test_bad_input_is_one_clear_error():
    graph = packing(24, seed=3)
    for how, named in (
        ({"directions": 0}, "directions"),
        ({"directions": 2.5}, "directions"),
        ({"directions": [[0.0, 0.0]]}, "directions"),
        ({"directions": [[1.0, 0.0, 0.0]]}, "directions"),
        ({"subspace": "full"}, "subspace"),
        ({"control": "both"}, "control"),
        ({"yield_band": 1.01}, "yield_band"),
        ({"yield_band": 0.0}, "yield_band"),
        ({"yield_band": np.nan}, "yield_band"),
    ):
        with pytest.raises(InputError, match=named):
            probe(Scene(graph, LAW), **how)
    floating = graph.replace(cell=None, cell0=None, images=None)
    with pytest.raises(InputError, match="float"):
        probe(Scene(floating, LAW, Boundary(volume=1.0)))
