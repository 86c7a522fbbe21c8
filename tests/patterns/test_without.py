"""Scenes and snapshots without some grains and contacts."""

from dataclasses import replace

import numpy as np
import pytest

import grainloops as gl
from tests.packings import LAW, jammed
from tests.stability.packing.walled_packings import small_sample


@pytest.fixture(params=["cell", "walls", "outline"])
def sample(request):
    return small_sample(request.param, LAW)


def stress_of(snapshot):
    return gl.stress(snapshot).tensor * gl.stress(snapshot).volume


def test_what_stays_is_as_it_was(sample):
    # One of them at a wall, where there are walls.
    numbers = [2, 5 if sample.walls is None else int(sample.walls.grain[0])]
    gone = sample.ids[numbers]
    first = next(
        pair
        for pair in sample.ids[sample.graph.contacts].tolist()
        if not {*pair} & {*gone.tolist()}
    )
    less = sample.without(grains=gone, contacts=[first[::-1]])
    assert less.ids.tolist() == [one for one in sample.ids.tolist() if one not in gone]
    pairs = sample.ids[sample.graph.contacts]
    stays = ~np.isin(pairs, gone).any(axis=1) & ~(np.sort(pairs) == np.sort(first)).all(axis=1)
    assert 0 < stays.sum() < len(stays) - 1
    assert np.array_equal(less.ids[less.graph.contacts], pairs[stays])
    for name in ("branches", "normal_force", "shear_force"):
        assert np.array_equal(getattr(less.graph, name), getattr(sample.graph, name)[stays]), name
    assert np.array_equal(less.regime, sample.regime[stays])
    kept = np.isin(sample.ids, less.ids)
    assert np.array_equal(less.graph.x, sample.graph.x[kept])
    assert less.scene.boundary.volume == sample.scene.boundary.volume
    assert less.scene.boundary.kind == sample.scene.boundary.kind
    if sample.walls is not None:
        on = np.isin(sample.walls.grain, np.flatnonzero(kept))
        assert np.array_equal(less.ids[less.walls.grain], sample.ids[sample.walls.grain[on]])
        assert np.array_equal(less.walls.force, sample.walls.force[on])
        planes, former = less.scene.boundary.walls, sample.scene.boundary.walls
        on = np.isin(former.grain, np.flatnonzero(kept))
        assert 0 < on.sum() < len(on)
        assert np.array_equal(less.ids[planes.grain], sample.ids[former.grain[on]])
        for name in ("branch", "kn", "kt"):
            assert np.array_equal(getattr(planes, name), getattr(former, name)[on]), name
    if sample.scene.boundary.held is not None:
        assert np.array_equal(less.scene.boundary.held, sample.scene.boundary.held[kept])
    assert less.notes[-1] == f"2 grains and {len(stays) - stays.sum()} contacts left out"
    # As a scene, by the numbers of the grains.
    number = {one: k for k, one in enumerate(sample.ids.tolist())}
    scene = sample.scene.without(numbers, [[number[one] for one in first]])
    assert np.array_equal(scene.graph.contacts, less.graph.contacts)
    assert np.array_equal(scene.ids, less.ids)
    tangents = (gl.affine_tangent(one.graph, one.law, volume=1.0) for one in (scene, less.scene))
    assert np.array_equal(*(tangent.matrix for tangent in tangents))


def test_the_stress_loses_what_the_contacts_carried():
    sample = small_sample("cell", LAW)
    i, j = sample.graph.contacts[0]
    less = sample.without(contacts=[sample.ids[[i, j]]])
    state = gl.contact_state(sample.graph)
    force = state.normal_force[0] * state.n[0] + state.shear_force[0] * state.t[0]
    lost = np.outer(force, sample.graph.branches[0])
    np.testing.assert_allclose(stress_of(sample) - stress_of(less), lost, atol=1e-12)


def test_stresses_refer_to_the_area_of_the_whole_sample(sample):
    """Without the grains that end it too: at one wall, or of the outline."""
    if sample.walls is None:
        rows = np.argmax(sample.graph.x[:, :1], axis=0)
    else:
        rows = sample.walls.grain[sample.walls.branch[:, 0] > 0.01]
    less, whole = sample.without(grains=sample.ids[rows]), gl.stress(sample)
    for one in (less, less.scene, sample.scene.without(grains=rows)):
        assert gl.stress(one).volume == whole.volume == less.scene.boundary.volume
    assert gl.stress(less).volume_is == gl.stress(sample.scene).volume_is == whole.volume_is


def test_the_stress_of_a_scene_refers_to_its_area():
    scene = small_sample("walls", LAW).scene
    wide = gl.Scene(scene.graph, scene.law, replace(scene.boundary, volume=100.0))
    tensor = gl.stress(scene).tensor * scene.boundary.volume / 100.0
    np.testing.assert_allclose(gl.stress(wide).tensor, tensor, rtol=1e-13)
    np.testing.assert_allclose(gl.hold(wide, unbalanced=0.1).stress_before, tensor, rtol=1e-9)


def test_a_sample_without_a_contact_is_brought_to_rest():
    scene = gl.Scene(jammed(16, 2), LAW)
    pair = scene.graph.contacts[np.argmin(scene.graph.normal_force)]
    held = gl.hold(scene.without(contacts=[pair]))
    assert held.status == "at rest"


def test_nothing_left_out_is_the_same(sample):
    same = sample.without()
    assert np.array_equal(same.graph.contacts, sample.graph.contacts)
    assert same.notes[-1] == "0 grains and 0 contacts left out"


@pytest.mark.parametrize(("what", "said"), [
    ({"grains": [10**6]}, "without: got ids 1000000, expected ids of the snapshot"),
    ({"contacts": [[0, 10**6]]}, "ids .*1000000"),
    ({"contacts": [1, 2]}, "contacts: got shape"),
    ({"grains": [0.5]}, "grains: got"),
    ({"grains": "a"}, "grains: got 'a'"),
])  # fmt: skip
def test_what_is_not_there_is_named(what, said):
    sample = small_sample("cell", LAW)
    with pytest.raises(gl.InputError, match=said):
        sample.without(**what)
    scene = {"grains": [99], "contacts": [[0, 0]]}
    with pytest.raises(gl.InputError, match="without: got grain 99, contact 0-0, expected grains"):
        sample.scene.without(**scene)


@pytest.mark.parametrize("ends", ["cell", "walls"])
def test_a_sample_at_rest_keeps_the_ids_of_its_grains(tmp_path, ends):
    """Without its first grain numbers and ids differ: tables, fates and files are by ids."""
    sample = small_sample(ends, LAW)
    less = sample.without(grains=sample.ids[:1])
    held = gl.hold(less)
    assert np.array_equal(held.ids, less.ids)
    assert np.array_equal(held.scene.ids, less.ids)
    table = gl.loop_table(held)
    assert len(table) and {one for row in table["grains"] for one in row} <= {*less.ids.tolist()}
    # The same scene has the same loops.
    assert {*gl.fates(less, less.scene)["fate"]} == {"survived"}
    before = {frozenset(row) for row in gl.loop_table(less)["grains"]}
    after = {frozenset(row) for row in table["grains"]}
    fates = gl.fates(less, held)
    assert (fates["fate"] == "survived").sum() == len(before & after) > 0
    gl.write_snapshot(tmp_path / "grains_held.parquet", held)
    again = gl.read_snapshot(tmp_path / "grains_held.parquet")
    assert np.array_equal(again.ids, less.ids)
    assert np.array_equal(again.graph.contacts, held.graph.contacts)
    # Files hold the components of forces.
    forces = again.graph.normal_force, held.graph.normal_force
    np.testing.assert_allclose(*forces, rtol=1e-12)


def test_ids_of_a_scene_are_whole_numbers_one_a_grain():
    graph = gl.regular_polygon(4)
    scene = gl.Scene(graph, LAW, ids=[7, 5, 9, 8])
    assert scene.without(grains=[1]).ids.tolist() == [7, 9, 8]
    for ids in ([1, 2, 3], [0.5, 1.0, 2.0, 3.0]):
        with pytest.raises(gl.InputError, match="ids of a scene"):
            gl.Scene(graph, LAW, ids=ids)


def test_contacts_that_stay_keep_their_springs():
    sample = gl.read_snapshot(gl.sample_path())
    pairs = sample.ids[sample.graph.contacts]
    less = sample.without(grains=sample.ids[:1], contacts=pairs[[40]])
    stays = ~(pairs == sample.ids[0]).any(axis=1) & ~(pairs == pairs[40]).all(axis=1)
    assert np.ptp(sample.law.kn) > 0 and 1 < np.count_nonzero(~stays) < 10
    assert np.array_equal(less.law.kn, sample.law.kn[stays])
    for name in ("mass", "rotation"):
        assert np.array_equal(getattr(less, name), getattr(sample, name)[1:])
