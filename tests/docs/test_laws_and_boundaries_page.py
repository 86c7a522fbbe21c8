"""`docs/laws-and-boundaries.md`: every cell of its table, run with every law that it stands for."""

import re
from dataclasses import replace

import numpy as np
import pytest

import grainloops as gl
from grainloops import hold, replay
from loops import (
    CohesiveFrictional,
    HertzMindlin,
    LinearFrictional,
    RollingResistance,
    Scene,
    contact_state,
)
from stability import Stage, follow, programmes
from stability.packing.probe import probe, probe_to
from studies.series.evolution import track_loops
from studies.series.packing import Following, packing_predictions
from studies.snapshot.in_packing import sample_edge
from tests.docs.pages import page
from tests.laws import Power
from tests.packings import LAW, loops_in_place
from tests.stability.packing.walled_packings import small_sample
from tests.stability.test_every_law import REFUSED

BAND = 1 - 1e-6


LAWS = {
    "linear": [LAW],
    "hertz": [
        HertzMindlin(5.0, 0.2, 0.5),
        HertzMindlin(5.0, 0.2, 0.5, shear_history="displacement"),
    ],
    "cohesive": [
        CohesiveFrictional(1.0, 0.5, 0.5, 1e-4, bonded=bonded, shear_increment="radii")
        for bonded in (False, True)
    ],
    "own": [Power(2.0, 0.2, 0.5, 1.2)],
    "rolling": [
        RollingResistance(LinearFrictional(1.0, 0.5, 0.5), 0.02),
        RollingResistance(HertzMindlin(5.0, 0.2, 0.5), 0.02, 0.1),
        RollingResistance(Power(2.0, 0.2, 0.5, 1.2), 0.02, 0.1),
    ],
}


def fitted(law, graph):
    """The law with moduli, one a contact, under which the packing keeps the forces it rests in."""
    if isinstance(law, CohesiveFrictional):
        attraction = 0.0 if law.bonded else law.adhesion
        kn = (graph.normal_force + attraction) / contact_state(graph).overlap
        how = law.adhesion, law.cohesion, law.bonded, law.shear_increment
        return CohesiveFrictional(kn, law.kt, law.mu, *how)
    closed = np.asarray(law.closed_force(contact_state(graph)))
    share = np.where(graph.normal_force > 0, graph.normal_force / closed, 1.0)
    if isinstance(law, HertzMindlin):
        how = law.mu, law.shear_increment, law.shear_history
        return HertzMindlin(law.young * share, law.poisson, *how)
    if isinstance(law, RollingResistance):
        return RollingResistance(fitted(law.law, graph), law.k_r, law.mu_r)
    return Power(law.k * share, law.kt, law.mu, law.m) if isinstance(law, Power) else law


def sample(boundary, law):
    """A small snapshot that ends so, at rest under the law."""
    one = small_sample(boundary, law)
    graph = one.graph
    law = fitted(law, graph)
    N = np.maximum(np.asarray(law.normal_force(contact_state(graph))), 1e-12)
    T = np.clip(graph.shear_force, -0.4 * N, 0.4 * N)
    return replace(one, graph=graph.replace(normal_force=N, shear_force=T), law=law)


def in_place(one):
    boundary = one.boundary_and_notes[0]
    return loops_in_place(Scene(one.graph, one.law, boundary), one.faces).matrix


def amplitude(one):
    found = probe(sample_edge(one, BAND), 2, faces=one.faces)

    def paths(stages):
        return [follow(one.scene, stage, closure="packing") for stage in stages]

    return probe_to(found, one.scene, 1e-6, paths).strain_rate


def at_rest(one):
    boundary = one.boundary_and_notes[0]
    return hold(Scene(one.graph, one.law, boundary)).stress


def packing_path(one):
    boundary = one.boundary_and_notes[0]
    stage = Stage(programmes.drained_biaxial(), "H11", 1e-5)
    return follow(Scene(one.graph, one.law, boundary), stage, closure="packing").P


def motion(one):
    boundary = one.boundary_and_notes[0]
    scene, H = Scene(one.graph, one.law, boundary), 1e-5 * np.diag([1.0, -0.5])
    return replay(scene, H, inertial_number=1e-4).state.stress


def predicted(one, by_events=False):
    less = 1 - 1e-6
    cell = None if one.graph.cell is None else less * one.graph.cell
    graph = one.graph.replace(x=less * one.graph.x, x0=None, cell=cell, cell0=None)
    later = replace(one, graph=graph)
    columns, row, notes = packing_predictions(
        one, later, track_loops(one, later), BAND, Following() if by_events else None
    )
    if row["packing_status"] == "refused" or any("not followed" in note for note in notes):
        raise gl.InputError("series", "; ".join(notes), "a packing that is followed", "See there.")
    return columns["path_w2" if by_events else "packing_work"]


DONE = {
    "`loop_table`": lambda one: gl.loop_table(one)["traction_lambda_min"],
    "`snapshot --in-packing`": in_place,
    "`probe`": lambda one: probe(sample_edge(one, BAND), 4, faces=one.faces).elastic_stress,
    "`probe --amplitude`": amplitude,
    "`--hold`": at_rest,
    '`evolve`, `follow(closure="packing")`': packing_path,
    "`replay`": motion,
    "`sustain`": lambda one: gl.sustain(one, 2, largest=1e-3).paths[0].parameter,
    "`series --in-packing`": predicted,
    "`series --in-packing events`": lambda one: predicted(one, by_events=True),
}
ENDS = ("cell", "walls", "outline")
COLUMNS = [(law, boundary) for law in LAWS for boundary in ENDS]


def rows():
    """Cells of the table by its first column."""
    lines = [line for line in page("laws-and-boundaries").splitlines() if line.startswith("| `")]
    return {cells[0]: cells[1:] for cells in ([c.strip() for c in line.strip("|").split("|")]
                                              for line in lines)}  # fmt: skip


def test_the_table_names_everything_that_is_run():
    assert list(rows()) == list(DONE)
    assert all(len(cells) == len(ENDS) for cells in rows().values())


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.slow] * (n == "`sustain`")) for n in DONE]
)
@pytest.mark.parametrize("column", range(len(COLUMNS)))
def test_a_cell_works_or_ends_in_its_error(name, column):
    law, boundary = COLUMNS[column]
    said = rows()[name][ENDS.index(boundary)]
    for own in LAWS[law]:
        one = sample(boundary, own)
        if said == "yes":
            assert np.isfinite(np.asarray(DONE[name](one), dtype=float)).any()
        else:
            message = re.search(rf"^- {re.escape(said)}: `(.*)`", page("laws-and-boundaries"), re.M)
            with pytest.raises(gl.InputError, match=re.escape(message[1])):
                DONE[name](one)


def test_laws_that_loops_and_materials_refuse_are_told():
    """The table of single loops, beside what `test_every_law` runs."""
    text = page("laws-and-boundaries")
    lines = [[c.strip() for c in line.strip("|").split("|")] for line in text.splitlines()]
    kinds = "linear Hertz attraction bond own rolling".split()
    column = {"bonds": "bond", "anew_mindlin": "own", "limited": "rolling"}
    refused = {(tool, column[law.__name__]): said for (tool, law), said in REFUSED.items()}
    for tool in ("tangents", "path of a loop", "material"):
        (cells,) = (cells[1:] for cells in lines if cells[0].startswith(f"{tool}: "))
        for kind, cell in zip(kinds, cells, strict=True):
            said = refused.get((tool, kind))
            assert (cell == "yes") == (said is None)
            assert said is None or re.search(rf"^- {cell}.*: `got {said}`$", text, re.M)
