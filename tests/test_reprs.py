"""Every public object of the sample prints one short line, and a small table in a notebook."""

import pickle
from dataclasses import is_dataclass
from xml.etree import ElementTree

import numpy as np
import pytest

import grainloops as gl
import loops
import patterns
import stability.packing
from grainloops import replay
from loops import PlaneContacts, Scene
from loops.in_place import LoopsInPlace
from loops.shown import LONGEST_REPR, Shown
from loops.system import Carrying, System
from patterns.snapshots.cells import rows_by_number
from stability import rates_at
from tests.packings import LAW, jammed, loop_rates, loops_in_place, plane_contacts

SHORT = 300


@pytest.fixture(scope="module")
def objects():
    """What the front door and the packings return, by name."""
    snapshot = gl.read_snapshot(gl.sample_path())
    cells = rows_by_number(gl.sample_path("slow/cells.csv"))
    before, after = (
        gl.read_snapshot(
            gl.sample_path(f"slow/grains_{k}.parquet"), cell=np.reshape(cells[k], (2, 2))
        )
        for k in (10, 11)
    )
    loop = gl.loop(snapshot, 230)
    tangent = gl.traction_tangent(loop.graph, loop.law)
    match = loops.match_contacts(before.graph, before.ids, after.graph, after.ids)
    fates = loops.loop_fates(match, before.faces, after.faces)
    kinetics = gl.order_kinetics([fates])
    stage = gl.Stage(gl.programmes.drained_biaxial(), "H11", 0.3)
    pentagon = gl.regular_polygon(5, strain=0.1)
    path = gl.follow(
        gl.Scene(pentagon, gl.LinearFrictional(1, 0.2, 0.0875)), stage, closure="affine"
    )
    packing, walls = jammed(16, 2), snapshot.walls
    in_place = loops_in_place(Scene(packing, LAW), gl.find_faces(packing))
    response = rates_at(Scene(packing, LAW), H=[[1e-3, 0], [0, 0]])
    along = gl.follow(
        gl.Scene(packing, LAW),
        gl.Stage(gl.programmes.oedometric(), "H11", 1e-5),
        closure="packing",
        rows=1,
    )
    return {
        "snapshot": snapshot,
        "law": snapshot.law,
        "walls": walls,
        "graph": snapshot.graph,
        "faces": snapshot.faces,
        "finding": snapshot.findings[0],
        "contact_state": gl.contact_state(snapshot.graph),
        "chains": gl.force_chains(snapshot.graph),
        "loop": loop,
        "hertz": gl.HertzMindlin(young=np.linspace(1, 2, 900), poisson=0.2),
        "rolling": gl.RollingResistance(snapshot.law, k_r=0.1),
        "tangent": tangent,
        "tangents": gl.loop_tangents(snapshot.graph, snapshot.law, snapshot.faces, "traction"),
        "verdict": gl.judge(tangent, "symmetric"),
        "cone": gl.plane_cone(gl.restrict(tangent, "diagonal")),
        "control": gl.destabilising_control(gl.restrict(tangent, "symmetric")),
        "work": gl.directional_work(loop.graph, loop.law, np.eye(2), closure="traction"),
        "match": match,
        "fates": fates,
        "kinetics": kinetics,
        "balance": kinetics.balance(),
        "steady": kinetics.steady(),
        "stage": stage,
        "programme": stage.programme,
        "path": path,
        "event": path.events[0],
        "model": path.model,
        "rates": gl.rates_at(
            gl.Scene(pentagon, gl.LinearFrictional(1, 0.2, 0.1)), stage.programme, closure="affine"
        ),
        "planes": plane_contacts(snapshot.graph, walls.grain, walls.force, walls.branch),
        "in_place": in_place,
        "system": in_place.system,
        "carrying": in_place.system.carrying,
        "response": response,
        "loop_rates": loop_rates(response, gl.find_faces(packing)),
        "probe": gl.probe(after, 4),
        "held": gl.hold(gl.Scene(packing, LAW)),
        "replay": replay(Scene(packing, LAW), [[1e-6, 0], [0, 0]], duration=1.0),
        "packing_path": along,
        "packing_state": along.states[0],
        "event_of_packing": along.events[:1],
    }


def test_every_object_is_one_short_line(objects):
    said = {name: repr(one) for name, one in objects.items()}
    assert not {name: line for name, line in said.items() if len(line) >= SHORT or "\n" in line}


def test_a_notebook_gets_a_small_table_of_each(objects):
    plain = ("finding", "event_of_packing")
    for name, one in objects.items():
        if name not in plain:
            rows = one._repr_html_()
            assert rows.startswith(f"<table><caption>{type(one).__name__}</caption>"), name
            assert 1 <= rows.count("<tr>") <= 40, name
            # Closed tags alone: the table is well formed.
            assert ElementTree.fromstring(rows).tag == "table", name


def test_the_line_tells_what_an_array_holds(objects):
    law, walls = objects["law"], objects["walls"]
    ends = f"{law.kn.min():.4g} to {law.kn.max():.4g} (819)"
    assert f"kn: {ends}" in repr(law)
    assert repr(walls).startswith("WallContacts(contacts: 61, total force: (")
    fates = objects["fates"]
    assert f"survived: {np.count_nonzero(fates.before == 0)}" in repr(fates)
    assert repr(gl.LinearFrictional(1.0, 0.5)) == (
        "LinearFrictional(kn: 1, kt: 0.5, mu: inf, shear_increment: branch)"
    )


def test_many_facts_end_in_dots_at_the_prompt_and_all_stand_in_the_table():
    class Many(Shown):
        def __init__(self):
            self.facts_of_it = dict.fromkeys(f"a name of some length {k}" for k in range(40))

        def facts(self):
            return self.facts_of_it

    assert repr(Many()).endswith(", ...)") and len(repr(Many())) <= LONGEST_REPR + len(
        "Many(, ...)"
    )
    assert Many()._repr_html_().count("<tr>") == 40


def test_every_dataclass_that_a_room_shows_prints_so():
    """Results of the faces, behind the front door too: none prints its arrays."""
    rooms = (gl, loops, patterns, stability, stability.packing)
    every = [getattr(room, name) for room in rooms for name in dir(room) if name[0] != "_"]
    results = {one for one in every if isinstance(one, type) and is_dataclass(one)}
    results |= {Carrying, LoopsInPlace, PlaneContacts, System}
    assert len(results) > 30
    assert not sorted(one.__name__ for one in results if not issubclass(one, Shown))


def test_an_error_can_be_sent_between_processes():
    error = gl.InputError("radius of grain 3", "-0.1", "a positive length", "Correct the file.")
    sent = pickle.loads(pickle.dumps(error))
    assert str(sent) == str(error) and sent.remedy == error.remedy
