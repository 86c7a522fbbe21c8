"""Domains against `follow`, programme by programme: where each ends, by what, at which stress."""

import numpy as np
import pytest

import grainloops as gl

LAW = gl.LinearFrictional(1.0, 0.3, 0.5)
# Events that end a programme, by the name of the end; of several at one state the first counts.
ENDS = {"det_Ks_zero": "det_Ks_zero", "det_K_zero": "det_K_zero", "control_limit": "limit",
        "opening": "opening"}  # fmt: skip
# Strains of two independent integrations.
ATOL = 1e-11


def random_scene(order, seed):
    """A loop under load, which need not be in balance; shear forces up to .4 of the strength."""
    return gl.Scene(gl.random_loop(order, seed, polydispersity=0.2, strain=0.02, mu=0.2), LAW)


def followed_end(scene, closure, degrees, control, size):
    """What ends one programme that `follow` takes to this size, with strain and stress there."""
    b, make = np.radians(degrees), getattr(gl.programmes, f"proportional_{control}")
    graph = scene.graph.replace(x0=scene.graph.x)
    stage = gl.Stage(make(np.cos(b), np.sin(b)), "parameter", size)
    path = gl.follow(gl.Scene(graph, scene.law), stage, closure=closure, subspace="diagonal")
    ends = [event for event in path.events if event.kind in ENDS]
    if not ends:
        assert path.status == "finished"
        return "end", path.H[-1, [0, 3]], path.P[-1, [0, 3]]
    kind, row = ENDS[ends[0].kind], ends[0].index
    if kind == "limit" and abs(path.normal_force[row]).min() < ATOL:
        # A contact parts, and without it nothing goes on.
        kind = "opening"
    return kind, path.H[row, [0, 3]], path.P[row, [0, 3]]


def held_to_follow(scene, closure, domain, rows):
    """Hold rows of a domain to `follow`; how many there are of each kind."""
    control, start = domain.control, domain.start
    for _, row in rows.iterrows():
        H, P = (row[names].to_numpy(float) for names in (["E1", "E2"], ["s1", "s2"]))
        # A little further: where the loop has an end, `follow` must have it too.
        size = np.hypot(*(H if control == "strain" else P - start))
        size *= 1.0 if row["kind"] == "end" else 1.05
        found = followed_end(scene, closure, row["programme_deg"], control, size)
        assert found[0] == row["kind"], (row["programme_deg"], found, row["kind"])
        np.testing.assert_allclose(found[1], H, rtol=0, atol=ATOL)
        np.testing.assert_allclose(found[2], P, rtol=0, atol=ATOL)
    return rows["kind"].value_counts().to_dict()


@pytest.mark.slow
@pytest.mark.parametrize("closure", ["affine", "traction"])
@pytest.mark.parametrize(("order", "seed"), [(12, 0), *((4 + k % 6, k) for k in range(10))])
def test_programmes_of_random_loops_end_where_follow_ends_them(order, seed, closure):
    scene = random_scene(order, seed)
    domain = gl.loop_domain(scene, closure, directions=13)
    assert domain.status == "stable"
    assert sum(held_to_follow(scene, closure, domain, domain.rows).values()) == 13


@pytest.mark.slow
@pytest.mark.parametrize(("order", "seed"), [(5, 1), (6, 3)])
def test_programmes_of_stress_end_where_follow_ends_them(order, seed):
    scene = random_scene(order, seed)
    domain = gl.loop_domain(scene, "traction", control="stress", directions=13)
    held_to_follow(scene, "traction", domain, domain.rows)


def test_a_contact_that_sticks_again_as_another_yields_ends_no_programme():
    """On the last programme the operator becomes indefinite there, and no limit is reached."""
    scene = random_scene(5, 40)
    domain = gl.loop_domain(scene, "traction", directions=5)
    assert domain.rows["kind"].tolist() == ["opening", "det_Ks_zero", "end", "end", "det_Ks_zero"]
    held_to_follow(scene, "traction", domain, domain.rows.iloc[[-1]])


@pytest.mark.slow
def test_a_hexagon_ends_no_programme_where_regimes_change_together():
    scene = random_scene(6, 3)
    domain = gl.loop_domain(scene, "traction")
    assert domain.rows["kind"].value_counts().to_dict() == {"det_Ks_zero": 210, "end": 151}
    rows = domain.rows.iloc[[17, 44, 254, 275, 276]]
    assert np.hypot(*rows.iloc[3][["E1", "E2"]]) == pytest.approx(0.026456, abs=5e-7)
    held_to_follow(scene, "traction", domain, rows)
