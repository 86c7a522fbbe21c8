"""A scene stands for graph, law and boundary, and a snapshot for its scene."""

import numpy as np
import pytest

import grainloops as gl
import stability
from loops import InputError
from loops.boundary import boundary_of
from loops.in_place import loops_in_place
from loops.scene import of_scene, scene_of
from patterns.snapshots.snapshot import sample_boundary
from stability import programmes
from stability.packing import packing_increment, probe, replay
from stability.packing import sustain as sustain_packing
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
    boundary, _ = sample_boundary(box)
    assert scene.boundary.kind == "walls" == boundary.kind
    np.testing.assert_array_equal(scene.graph.regime, box.regime)


def test_a_question_takes_a_scene_a_snapshot_or_the_former_pair(box):
    boundary, _ = sample_boundary(box)
    whole = gl.indicators(box)
    with pytest.warns(DeprecationWarning, match=r"use indicators\(Scene\(graph, law, boundary\)"):
        pair = gl.indicators(box.graph, box.law, box.faces, regime=box.regime, boundary=boundary)
    for other in (gl.indicators(box.scene), pair):
        for name, values in whole.items():
            np.testing.assert_array_equal(other[name], values)


def test_probes_of_a_scene_are_those_of_its_snapshot(box):
    first, second = gl.probe(box, 2), gl.probe(box.scene, 2)
    np.testing.assert_array_equal(first.stress_rate, second.stress_rate)
    third = probe(box, 2)
    np.testing.assert_array_equal(first.stress_rate, third.stress_rate)


def test_a_regime_that_is_given_is_that_of_the_graph():
    seen = []

    def question(scene):
        seen.append(scene)

    graph = jammed(24, 3)
    flags = np.full(graph.contact_count, gl.Regime.SLIDING, dtype=np.int8)
    with pytest.warns(DeprecationWarning, match="question"):
        of_scene()(question)(graph, LAW, regime=flags)
    np.testing.assert_array_equal(seen[0].graph.regime, flags)


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
    from loops.contacts import contacts_of, start_state
    from stability.packing.equations_of_motion import masses_of, step_of

    start = start_state(scene.graph, scene.boundary)
    start = contacts_of(start, scene.law, scene.boundary)
    return step_of(*masses_of(scene.graph.radii), start)


def test_a_scene_in_a_cell_is_followed_as_a_packing():
    scene, stage = gl.Scene(jammed(24, 3), LAW), gl.Stage("oedometric", "H11", 1e-5)
    first = gl.follow(scene, stage)
    second = gl.follow(scene, stage, closure="packing")
    np.testing.assert_array_equal(first.P, second.P)
    with pytest.warns(DeprecationWarning, match=r"follow\(Scene\(graph, law\)"):
        old = gl.follow(scene.graph, LAW, gl.Stage(programmes.oedometric(), "H11", 1e-5))
    affine = gl.follow(scene, stage, closure="affine")
    np.testing.assert_array_equal(old.P, affine.P)
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


def test_the_front_door_holds_at_most_72_names():
    assert len(gl.__all__) <= 72 and {"Scene", "replay"} <= set(gl.__all__)


def test_names_that_left_the_front_door_work_with_a_warning():
    with pytest.warns(DeprecationWarning, match=r"use stability.spectrum"):
        assert gl.spectrum is stability.spectrum


def old_forms():
    graph = jammed(12, 1)
    faces = gl.find_faces(graph)
    return {
        "probe": lambda *first: probe(*first, 2).stress_rate,
        "sustain": lambda *first: sustain_packing(*first, [[-1, 0]], largest=1e-6).limit,
        "indicators": lambda *first: gl.indicators(*first)["vibrality"],
        "hold": lambda *first: gl.hold(*first).stress,
        "replay": lambda *first: gl.replay(*first, 1e-6 * np.eye(2), steps=3).state.x,
        "packing_increment": lambda *first: packing_increment(*first, 1e-6 * np.eye(2)).motion,
        "loops_in_place": lambda *first: loops_in_place(*first, faces).matrix,
    }, graph


@pytest.mark.parametrize("name", old_forms()[0])
def test_every_old_form_warns_and_says_what_to_write(name):
    ask, graph = old_forms()[0][name], old_forms()[1]
    told = rf"{name}\(graph, law, ...\) is gone with the next release: use {name}\(Scene\("
    with pytest.warns(DeprecationWarning, match=told):
        old = ask(graph, LAW)
    np.testing.assert_array_equal(old, ask(gl.Scene(graph, LAW)))
