"""A law with parameters of another number of contacts is refused in one line, wherever it comes."""

import matplotlib.figure
import numpy as np
import pytest

import grainloops as gl
from loops import assemble_tangent, macroscopic_tangent
from tests.packings import jammed

RING = gl.regular_polygon(6, strain=0.02)
PACKING = jammed(16, 2)
STAGE = gl.Stage("isotropic_strain", "H11", 1e-5)


class Own(gl.FrictionalLaw):
    """A law of one's own."""

    def closed_force(self, state):
        return self.kn * state.overlap


def laws(count):
    """Laws with one parameter of so many contacts."""
    many = np.full(count, 0.3)
    linear = {"kn": 1.0, "kt": 0.5, "mu": 0.5}
    cohesive = linear | {"adhesion": 1e-9, "cohesion": 1.0}
    hertz = {"young": 1.0, "poisson": 0.3, "mu": 0.5}
    rolling = {"k_r": 0.1, "mu_r": 0.1}
    for name in linear:
        yield f"linear {name}", gl.LinearFrictional(**linear | {name: many})
        yield f"own {name}", Own(**linear | {name: many})
        between = gl.LinearFrictional(**linear | {name: many})
        yield f"rolling law's {name}", gl.RollingResistance(between, 0.1)
    for name in cohesive:
        yield f"cohesive {name}", gl.CohesiveFrictional(**cohesive | {name: many})
    for name in hertz:
        yield f"Hertz {name}", gl.HertzMindlin(**hertz | {name: many})
    for name in rolling:
        law = gl.LinearFrictional(**linear)
        yield f"rolling {name}", gl.RollingResistance(law, **rolling | {name: many})


def snapshot(graph, law):
    count = graph.contact_count
    return gl.Snapshot(graph, law, np.ones(count, np.int8), np.arange(graph.grain_count), 0, ())


# Everything that takes a graph and a law, of a loop and of a packing.
OF_LOOPS = {
    "affine_tangent": gl.affine_tangent,
    "traction_tangent": gl.traction_tangent,
    "traction, free": lambda graph, law: gl.traction_tangent(graph, law, spins="free"),
    "macroscopic": lambda graph, law: macroscopic_tangent(graph, law, "affine"),
    "assemble_tangent": assemble_tangent,
    "directional_work": lambda graph, law: gl.directional_work(
        graph, law, [[1.0, 0.0]], closure="traction"
    ),
    "LoopMaterial": lambda graph, law: gl.LoopMaterial(gl.oriented(graph, 2), None, law),
    "LoopMaterial affine": lambda graph, law: gl.LoopMaterial(graph, None, law, closure="affine"),
    "plot.envelope": lambda graph, law: gl.plot.envelope(
        graph, law, "affine", ax=matplotlib.figure.Figure().add_subplot()
    ),
    "loop_domain": lambda graph, law: gl.loop_domain(gl.Scene(graph, law), "affine", directions=4),
    "follow": lambda graph, law: gl.follow(gl.Scene(graph, law), STAGE, closure="affine"),
    "rates_at": lambda graph, law: gl.rates_at(
        gl.Scene(graph, law), "isotropic_strain", closure="affine"
    ),
    "Support": lambda graph, law: gl.rates_at(
        gl.Scene(graph, law), gl.Support([True] + [False] * 5)
    ),
}
OF_PACKINGS = {
    "loop_tangents": lambda graph, law: gl.loop_tangents(graph, law, closure="affine"),
    "loop_tangents of a snapshot": lambda graph, law: gl.loop_tangents(
        snapshot(graph, law), closure="affine"
    ),
    "loop_table": lambda graph, law: gl.loop_table(snapshot(graph, law)),
    "loop_table in place": lambda graph, law: gl.loop_table(snapshot(graph, law), in_packing=True),
    "loop": lambda graph, law: gl.loop(snapshot(graph, law), 0),
    "stress": lambda graph, law: gl.stress(snapshot(graph, law)),
    "Scene": gl.Scene,
    "loops_of": lambda graph, law: gl.LoopMaterial(gl.loops_of(gl.Scene(graph, law))),
    "law of a material": lambda graph, law: gl.LoopMaterial(
        gl.loops_of(gl.Scene(graph, gl.LinearFrictional(1.0, 0.5))), None, law
    ),
    "follow a packing": lambda graph, law: gl.follow(gl.Scene(graph, law), STAGE),
    "rates_at a packing": lambda graph, law: gl.rates_at(gl.Scene(graph, law), "biaxial"),
    "probe": lambda graph, law: gl.probe(gl.Scene(graph, law), 4),
    "hold": lambda graph, law: gl.hold(gl.Scene(graph, law)),
    "indicators": lambda graph, law: gl.indicators(gl.Scene(graph, law)),
    "replay": lambda graph, law: gl.replay(gl.Scene(graph, law), 1e-6 * np.eye(2)),
    "evolve": lambda graph, law: gl.evolve(gl.Scene(graph, law), to=1e-6),
    "forecast": lambda graph, law: gl.forecast(gl.Scene(graph, law), to=1e-6),
    "sustain": lambda graph, law: gl.sustain(gl.Scene(graph, law), 1),
}


@pytest.mark.parametrize("question", [*OF_LOOPS, *OF_PACKINGS])
@pytest.mark.parametrize("more", [1, -1])
def test_one_line_says_both_numbers_and_the_remedy(question, more):
    graph, ask = RING, OF_LOOPS.get(question)
    if ask is None:
        graph, ask = PACKING, OF_PACKINGS[question]
    count = graph.contact_count
    for name, law in laws(count + more):
        with pytest.raises(gl.InputError) as caught:
            ask(graph, law)
        said = str(caught.value)
        assert said.startswith(f"{name.split()[-1]} of the contact law: got {count + more} values")
        assert f"each of the {count} contacts" in said and "law.take(kept)" in said


def test_the_law_of_a_part_is_the_law_of_its_contacts():
    """What the remedy says works: the same as a law made for the graph."""
    rng, count = np.random.default_rng(3), RING.contact_count
    kn = rng.uniform(0.5, 1.5, count + 1)
    kept = np.arange(count)
    law = gl.RollingResistance(gl.LinearFrictional(kn, 0.5, 0.5), kn, kn).take(kept)
    other = gl.RollingResistance(gl.LinearFrictional(kn[kept], 0.5, 0.5), kn[kept], kn[kept])
    for spins in ("blocked", "free"):
        one, two = (gl.traction_tangent(RING, one, spins=spins) for one in (law, other))
        np.testing.assert_array_equal(one.matrix, two.matrix)
