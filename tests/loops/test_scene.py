"""A scene stands for graph, law and boundary, and a snapshot for its scene."""

import numpy as np
import pytest

import grainloops as gl
from grainloops import probe, replay
from loops import InputError, boundary_of
from loops.scene import scene_of
from tests.packings import jammed

LAW = gl.LinearFrictional(1.0, 0.5, 0.5)
LOOP = gl.regular_polygon(5, strain=0.1)


@pytest.fixture(scope="module")
def box():
    return gl.read_snapshot(gl.sample_path())


def test_a_scene_ends_at_the_cell_of_its_graph():
    graph = jammed(24, 3)
    assert gl.Scene(graph, LAW).boundary.kind == "cell"
    assert gl.Scene(LOOP, LAW).boundary.kind == "free"
    own = boundary_of(graph, volume=2.0)
    assert gl.Scene(graph, LAW, own).boundary is own
    with pytest.raises(InputError, match=r"boundary of a scene: got Faces, expected a Boundary"):
        gl.Scene(graph, LAW, gl.find_faces(graph))


def test_a_snapshot_has_one_scene_and_its_faces(box):
    found = gl.read_snapshot(gl.sample_path())
    scene = found.scene
    assert found.scene is scene and found.faces is scene.faces
    known = box.faces
    assert box.scene.faces is known
    boundary = box.boundary_and_notes[0]
    assert scene.boundary.kind == "walls" == boundary.kind
    np.testing.assert_array_equal(scene.graph.regime, box.regime)


def test_a_question_takes_a_scene_or_a_snapshot(box):
    whole, other = gl.indicators(box), gl.indicators(box.scene)
    for name, values in whole.items():
        np.testing.assert_array_equal(other[name], values)


def test_probes_of_a_scene_are_those_of_its_snapshot(box):
    first, second = gl.probe(box, 2), gl.probe(box.scene, 2)
    np.testing.assert_array_equal(first.stress_rate, second.stress_rate)
    third = probe(box, 2)
    np.testing.assert_array_equal(first.stress_rate, third.stress_rate)


def test_a_replay_of_so_many_steps():
    scene = gl.Scene(jammed(24, 3), LAW)
    done = replay(scene, 1e-4 * np.eye(2), steps=7)
    again = replay(scene, 1e-4 * np.eye(2), duration=7 * replay_step(scene))
    np.testing.assert_array_equal(done.states[-1].x, again.states[-1].x)
    with pytest.raises(InputError, match="one of them"):
        replay(scene, 1e-4 * np.eye(2), steps=7, duration=1.0)
    with pytest.raises(InputError, match="whole number"):
        replay(scene, 1e-4 * np.eye(2), steps=0)


def replay_step(scene):
    from stability.packing.equations_of_motion import masses_of, step_of
    from tests.packings import contacts_of, start_state

    start = start_state(scene.graph, scene.boundary)
    start = contacts_of(start, scene.law, scene.boundary)
    return step_of(*masses_of(scene.graph.radii), start)


def test_a_scene_in_a_cell_is_followed_as_a_packing():
    scene, stage = gl.Scene(jammed(24, 3), LAW), gl.Stage("oedometric", "H11", 1e-5)
    first = gl.follow(scene, stage)
    second = gl.follow(scene, stage, closure="packing")
    np.testing.assert_array_equal(first.P, second.P)
    affine = gl.follow(scene, stage, closure="affine")
    assert np.abs(affine.P[-1] - first.P[-1]).max() > 0


def test_a_free_scene_names_its_closure():
    with pytest.raises(InputError, match="closure"):
        gl.follow(gl.Scene(LOOP, LAW), gl.Stage("isotropic_strain", "H11", 0.01))


def test_what_is_held_is_a_scene():
    held = gl.hold(gl.Scene(jammed(24, 3), LAW))
    assert held.status == "at rest" and held.scene.graph.regime is not None
    assert gl.hold(held).unbalanced_before <= 1e-5


def test_an_unknown_programme_is_named():
    with pytest.raises(InputError, match="oedometric"):
        gl.Stage("triaxial", "H11", 0.1)


@pytest.mark.parametrize("wrong", [None, 3, "packing"])
def test_what_is_no_scene_is_refused(wrong):
    with pytest.raises(InputError, match="Scene"):
        scene_of(wrong)
    with pytest.raises(InputError, match="Scene"):
        gl.Scene(wrong, LAW)


def test_a_snapshot_without_a_law_says_what_it_lacks():
    grains = {"id": range(3), "x": [0, 1, 0.5], "y": [0, 0, 0.8], "r": [0.55] * 3}
    bare = gl.snapshot_from_tables(grains, {"i": [0, 1, 2], "j": [1, 2, 0]}, strict=False)
    with pytest.raises(InputError, match="forces"):
        gl.hold(bare)


def test_the_front_door_holds_at_most_77_names():
    assert len(gl.__all__) <= 77 and {"Scene", "replay"} <= set(gl.__all__)
