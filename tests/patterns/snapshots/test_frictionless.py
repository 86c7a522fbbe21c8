"""Samples without friction: what is read, counted and answered of them."""

import numpy as np
import pytest

import grainloops as gl
from tests.patterns.resting import resting

KN = 1.0


def read(sample, noise=1e-17, **law):
    contacts = sample.contacts()
    contacts["ft"] = noise * np.random.default_rng(0).choice([-1.0, 1.0], len(contacts["ft"]))
    walls = sample.walls() if len(sample.grain) else None
    given = {"kn": KN, "mu": 0.0, **law}
    cell = sample.cell if all(sample.periodic) else None
    return gl.snapshot_from_tables(sample.grains(), contacts, walls=walls, cell=cell, **given)


@pytest.mark.parametrize("noise", [0.0, 1e-17, 1e-7])
@pytest.mark.parametrize("law", [{}, {"kt": 0.001}])
def test_rounding_is_no_shear(noise, law):
    snapshot = read(resting(), noise, **law)
    assert not snapshot.graph.shear_force.any()
    assert (snapshot.regime == gl.Regime.ELASTIC).all()
    assert not np.asarray(snapshot.law.kt).any()
    assert gl.check(snapshot).verdict == "ok"


@pytest.mark.parametrize("periodic", [(True, True), (False, False)])
@pytest.mark.parametrize("mu", [0.0, 0.5])
def test_constraints_are_those_of_frictionless_grains(periodic, mu):
    sample = resting(periodic)
    count = len(sample.x)
    degree = np.bincount(sample.pairs.ravel(), minlength=count)
    walls = np.bincount(sample.grain, minlength=count)
    held = degree + walls >= 3
    wanted = (degree / 2 + walls)[held].sum() / (2 * held.sum())
    (jammed,) = [one for one in read(sample, mu=mu, kt=0.5).findings if one.check == "jammed"]
    assert jammed.number == pytest.approx(wanted, rel=1e-12)
    assert jammed.severity == "ok"


def test_shear_that_is_none_of_rounding_is_kept_and_doubted():
    snapshot = read(resting(), 1e-3)
    assert np.abs(snapshot.graph.shear_force).max() == pytest.approx(1e-3)
    assert {one.check for one in snapshot.findings if one.severity == "doubt"} >= {"friction"}


def hertz(sample, **columns):
    """The sample with Hertz's forces of its overlaps, and what the table has of the law."""
    reach = sample.radii[sample.pairs]
    overlap = reach.sum(axis=1) - np.linalg.norm(sample.branch, axis=1)
    kn = np.sqrt(reach.prod(axis=1) / reach.sum(axis=1) * overlap)
    contacts = sample.contacts() | {"fn": 2 / 3 * kn * overlap} | columns
    return contacts, kn


@pytest.mark.parametrize("given", ["moduli", "tangents"])
def test_frictionless_under_hertz(given):
    sample = resting()
    contacts, kn = hertz(sample, mu=np.zeros(len(sample.pairs)))
    # E* = E/(2 (1 - nu^2)) = 1/2: the tangent is 2 E* sqrt(R* overlap).
    law = {"law": "hertz", "young": 1 - 0.3**2, "poisson": 0.3}
    if given == "tangents":
        contacts |= {"kn": kn, "ks": 0.8 * kn}
        law = {"law": "hertz"}
    snapshot = gl.snapshot_from_tables(sample.grains(), contacts, cell=sample.cell, **law)
    found, shear = snapshot.law.stiffnesses(gl.contact_state(snapshot.graph))
    np.testing.assert_allclose(found, kn, rtol=1e-12)
    assert not shear.any()
    assert (snapshot.regime == gl.Regime.ELASTIC).all()


def stiffness_of_grains(sample):
    """`dP/dH` of springs without friction, from the second derivative of their energy."""
    count, n, length = len(sample.x), sample.normal, np.linalg.norm(sample.branch, axis=1)
    t = np.stack([-n[:, 1], n[:, 0]], axis=1)
    along = KN * np.einsum("ci,cj->cij", n, n)
    blocks = along - (sample.force / length)[:, None, None] * np.einsum("ci,cj->cij", t, t)
    one, two = sample.pairs.T
    incidence = np.zeros((len(one), count))
    rows = np.arange(len(one))
    np.add.at(incidence, (rows, two), 1.0)
    np.add.at(incidence, (rows, one), -1.0)
    K = np.einsum("cg,cij,ch->gihj", incidence, blocks, incidence).reshape(2 * count, 2 * count)
    units = np.eye(4).reshape(4, 2, 2)
    answers = []
    for H in units:
        # d' = -H l + u_2 - u_1, forces on the second grain f' = -blocks d'.
        affine = -sample.branch @ H.T
        load = np.einsum("cg,cij,cj->gi", incidence, blocks, affine).ravel()
        u = np.linalg.lstsq(K, -load, rcond=1e-10)[0].reshape(count, 2)
        moved = affine + u[two] - u[one]
        change = -np.einsum("cij,cj->ci", blocks, moved)
        answers.append(np.einsum("ci,cj->ij", change, sample.branch).ravel() / sample.size**2)
    return np.array(answers).T


@pytest.mark.parametrize("kt", [0.0, 0.001, 0.5])
def test_probe_answers_with_the_springs_alone(kt):
    sample = resting()
    found = gl.probe(read(sample, kt=kt), directions=8)
    wanted = found.strain_rate.reshape(-1, 4) @ stiffness_of_grains(sample).T
    np.testing.assert_allclose(found.stress_rate.reshape(-1, 4), wanted, atol=1e-9)
    assert not np.any(found.sliding)


def test_a_scene_with_shear_stiffness_and_no_friction_has_no_candidates():
    sample = resting()
    graph = read(sample).graph
    noise = 1e-17 * np.random.default_rng(1).choice([-1.0, 1.0], graph.contact_count)
    scene = gl.Scene(graph.replace(shear_force=noise, regime=None), gl.LinearFrictional(1, 0.5, 0))
    found = gl.probe(scene, directions=8)
    wanted = found.strain_rate.reshape(-1, 4) @ stiffness_of_grains(sample).T
    np.testing.assert_allclose(found.stress_rate.reshape(-1, 4), wanted, atol=1e-9)
    assert not np.any(found.sliding)


@pytest.mark.parametrize(("names", "sign"), [(("fx_on_2", "fy_on_2"), 1), (("fx", "fy"), -1)])
def test_rough_walls_around_grains_without_friction(names, sign):
    """The walls' friction asks for no shear stiffness between the grains, which have none.

    Forces of either grain, here the first one, are turned at the walls as between the grains.
    """
    sample = resting((False, False))
    grains, own, walls = sample.grains(), sample.contacts(), sample.walls()
    wall, many = len(grains["id"]), len(walls["id"])
    grains = {name: np.append(values, 0) for name, values in grains.items()}
    grains |= {"id": np.arange(wall + 1), "type": np.append(np.zeros(wall), 1)}
    on_2 = own["fn"][:, None] * sample.normal
    contacts = {
        "id1": np.append(own["id1"], np.full(many, wall)),
        "id2": np.append(own["id2"], walls["id"]),
        names[0]: sign * np.append(on_2[:, 0], walls["fx"]),
        names[1]: sign * np.append(on_2[:, 1], walls["fy"]),
        "branch_x": np.append(sample.branch[:, 0], walls["branch_x"]),
        "branch_y": np.append(sample.branch[:, 1], walls["branch_y"]),
        "mu": np.append(np.zeros(len(own["fn"])), np.full(many, 0.5)),
    }
    snapshot = gl.snapshot_from_tables(grains, contacts, kn=KN)
    assert snapshot.mechanical and not np.asarray(snapshot.law.kt).any()
    assert snapshot.wall_contacts == many and (snapshot.walls.mu == 0.5).all()
    assert np.abs(snapshot.walls.force - sample.push).max() == 0
    assert "act on the walls" not in " ".join(snapshot.notes)
