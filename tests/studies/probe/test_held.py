"""Snapshots that are brought to rest before they are probed or followed."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from grainloops import hold, probe, sustain
from loops import GrainGraph, InputError, Scene
from patterns import Snapshot, read_snapshot, sample_path
from patterns.snapshots.findings import crossings
from stability.packing.hold import unbalanced_force
from studies.questions import Holding
from studies.snapshot.in_packing import held_snapshot
from tests.command import run, run_probe
from tests.packings import LAW, jammed

WALLS = sample_path()


def test_a_sample_between_walls_is_held_and_every_direction_answered(tmp_path):
    summary = run_probe(WALLS, tmp_path / "held", directions=24, hold=True, figures=False)
    assert summary["undetermined"] == 0
    held = summary["held"]
    assert held["status"] == "at rest" and held["control"] == "strain"
    assert held["unbalanced"] <= 1e-6 < 5e-4 < held["unbalanced_before"]
    assert any(note.startswith("held between its walls") for note in summary["notes"])
    assert not any("the state moves" in note for note in summary["notes"])
    stored = json.loads((tmp_path / "held" / "summary.json").read_text())
    assert stored["held"]["gained"] == held["gained"]
    assert stored["provenance"]["configuration"]["hold"] == "strain"


def test_a_state_that_moves_is_said_to_move(tmp_path):
    summary = run_probe(WALLS, tmp_path / "moving", directions=1, figures=False)
    assert summary["held"] is None
    note = next(note for note in summary["notes"] if "the state moves" in note)
    assert "--hold" in note


def test_a_note_does_not_make_the_faces_again():
    before = read_snapshot(WALLS)
    faces = before.faces
    noted, held = held_snapshot(before, None)
    assert held is None and "the state moves" in noted.notes[-1]
    assert vars(noted).get("faces") is faces


def test_unbalanced_force_counts_walls():
    snapshot = read_snapshot(WALLS)
    boundary = snapshot.boundary_and_notes[0]
    total = np.zeros((snapshot.graph.grain_count, 2))
    graph = snapshot.graph
    forces = np.zeros((graph.contact_count, 2))
    for c, (i, j) in enumerate(graph.contacts):
        n = (graph.x[j] - graph.x[i]) / np.hypot(*(graph.x[j] - graph.x[i]))
        forces[c] = graph.normal_force[c] * n + graph.shear_force[c] * np.array([-n[1], n[0]])
        total[j] += forces[c]
        total[i] -= forces[c]
    carried = np.linalg.norm(forces[graph.normal_force > 0], axis=1).mean()
    np.add.at(total, snapshot.walls.grain, snapshot.walls.force)
    expected = np.linalg.norm(total, axis=1).mean() / carried
    assert unbalanced_force(graph, boundary) == pytest.approx(expected)
    # Springs of the walls push as the forces of the file do.
    springs = replace(boundary, walls=replace(boundary.walls, force=None))
    assert unbalanced_force(graph, springs) == pytest.approx(expected, rel=1e-6)


def test_the_held_snapshot_has_its_walls_its_regimes_and_its_ids():
    before = read_snapshot(WALLS)
    after, changes = held_snapshot(before, "strain")
    assert (after.ids == before.ids).all()
    assert after.wall_contacts == len(after.walls.grain) == len(after.walls.force)
    boundary = after.boundary_and_notes[0]
    assert unbalanced_force(after.graph, boundary) < 1.01e-6
    assert changes["sliding"] == np.count_nonzero(after.regime == 2)
    assert (
        after.graph.contact_count
        == before.graph.contact_count + changes["gained"] - (changes["lost"])
    )
    assert len(after.faces.loops) > 100


@pytest.mark.parametrize("change", [{}, {"walls": None}])
def test_what_cannot_be_held_is_said(change, tmp_path):
    with pytest.raises(InputError, match="both"):
        _ = Holding(hold=True, hold_stress=True).control
    snapshot = read_snapshot(WALLS)
    snapshot = type(snapshot)(**{**vars(snapshot), **change})
    if change:
        with pytest.raises(InputError, match=r"walls are not known.*under its weight"):
            held_snapshot(snapshot, "strain")
    else:
        with pytest.raises(InputError, match="between walls"):
            held_snapshot(snapshot, "stress")


def test_what_does_not_come_to_rest_is_refused_in_plain_words(monkeypatch):
    """Each of the ways to miss the rest, told by every question alike."""
    snapshot, scene = read_snapshot(WALLS), Scene(jammed(24, 3, LAW), LAW)
    held, in_cell = hold(snapshot, most_steps=1), hold(scene)

    def refused(question, subject, control, ended, /, **changed):
        found = replace(ended, **changed)
        with monkeypatch.context() as patch:
            patch.setattr(sys.modules["stability.packing.hold"], "hold", lambda *_, **__: found)
            with pytest.raises(InputError) as error:
                question(subject, hold=control)
        return str(error.value).removeprefix("the sample, which was brought to rest first ")

    kept = held.graph.contact_count
    for question in (probe, sustain):
        lost = {"status": "flows", "gained": 0, "lost": 50}
        assert refused(question, snapshot, "strain", held, **lost) == (
            f"(between its walls): got a flow: {kept} of {kept + 50} contacts between grains "
            "are left, expected a state at rest. Look for grains and contacts that are missing, or "
            "take a sample that is jammed."
        )
    said = refused(probe, scene, "strain", in_cell, status="not at rest", steps=500)
    assert said.startswith("(at fixed cell): got an unbalanced force of ") and "500 steps" in said
    strained = {"status": "flows", "control": "stress", "strain": np.diag([0.06, 0.08])}
    said = refused(probe, scene, "stress", in_cell, **strained)
    assert said.startswith("(at fixed stress): got a flow: the cell strains by 0.1, expected")


def test_directions_without_an_answer_stand_first_and_none_at_all_is_exit_1(
    tmp_path, monkeypatch, capsys
):
    def said(undetermined):
        def probed(path, out, **options):
            summary = run_probe(path, out, **options)
            return summary | {"undetermined": undetermined}

        monkeypatch.setattr("studies.probe.run_probe", probed)
        options = ("--directions", 4, "--no-figures", "--out", tmp_path / f"{undetermined}")
        return run("probe", WALLS, *options), capsys.readouterr().out.splitlines()

    status, lines = said(1)
    assert status == 0
    assert lines[0].startswith("no solution found in 1 of 4 directions: shares are of the others; ")
    status, lines = said(4)
    assert status == 1
    assert lines[0] == (
        "no solution found in any of 4 directions; bring the state to rest first with --hold"
    )
    status, lines = said(0)
    assert status == 0 and lines[0].startswith("4 directions of H'")


def test_a_held_snapshot_keeps_along_which_vectors_it_is_periodic():
    graph = jammed(24, 3, LAW)
    regime = np.ones(graph.contact_count, dtype=np.int8)
    state = Snapshot(graph, LAW, regime, np.arange(24), 0, (), periodic=(True, False))
    held, _ = held_snapshot(state, "strain")
    assert held.periodic == (True, False)
    assert held.velocity is None and held.rotation is None


def test_one_contact_is_no_plural():
    held = hold(Scene(jammed(24, 3, LAW), LAW))
    assert "1 contact lost" in str(replace(held, lost=1))
    assert "2 contacts lost" in str(replace(held, lost=2))
    snapshot = read_snapshot(WALLS)
    note = snapshot.without(grains=snapshot.ids[:1]).notes[-1]
    assert note.startswith("1 grain and ")
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    crossed = GrainGraph(x=square, radii=[0.8] * 4, contacts=[[0, 2], [1, 3]])
    assert crossings(crossed).says.startswith("1 pair of branches crosses")
