"""A law of one's own in paths and replays: against known laws, slow motion, its energy."""

from itertools import pairwise

import numpy as np
import pytest

from grainloops import replay
from loops import FrictionalLaw, GrainGraph, InputError, LinearFrictional, Scene, contact_state
from stability import Stage, follow, programmes
from tests.packings import LAW, jammed, strained
from tests.stability.packing.test_hertz_paths import hertz_of
from tests.stability.packing.walled_packings import JAMMED, between, jammed_in_box

H = np.array([[2e-3, 2e-4], [0.0, -2e-3]])
DRAINED = Stage(programmes.drained_biaxial(), "H11", 2e-3)
ROUGH = next(which for which in JAMMED if which[3][1] > 0)


class Springs(FrictionalLaw):
    """`LinearFrictional` without its tangents."""

    shear_increment = "radii"

    def closed_force(self, state):
        return self.k * state.overlap


class Spheres(FrictionalLaw):
    """Hertz and Mindlin's law, a modulus a contact."""

    shear_increment = "radii"

    def closed_force(self, state):
        root = np.sqrt(state.radii_i * state.radii_j / state.touching_length)
        return 2 / 3 * self.modulus * root * state.overlap**1.5

    def stiffnesses(self, state):
        root = np.sqrt(state.radii_i * state.radii_j / state.touching_length * state.overlap)
        return self.modulus * root, self.ratio * self.modulus * root

    def normal_energy(self, state):
        return 0.4 * self.closed_force(state) * state.overlap

    def local_stiffness(self, state, regime):
        D = super().local_stiffness(state, regime)
        if self.by_displacement:
            D[..., 1, 0] += np.where(regime == 1, state.shear_force / (2 * state.overlap), 0.0)
        return D


class Stiffening(FrictionalLaw):
    """A spring that stiffens, friction that falls with the force; no tangents."""

    def closed_force(self, state):
        return self.k * state.overlap * (1.0 + self.b * state.overlap)

    def strength(self, state):
        return self.mu * state.normal_force / (1.0 + self.c * state.normal_force)

    def local_stiffness(self, state, regime):
        D = super().local_stiffness(state, regime)
        slope = self.mu / (1.0 + self.c * state.normal_force) ** 2
        slides = np.sign(state.shear_force) * slope * self.stiffnesses(state)[0]
        D[..., 1, 0] = np.where(regime == 2, slides, 0.0)
        return D


def events(path):
    return [(event.kind, event.contacts) for event in path.events]


def scene(boundary):
    """Graph, stage and walls."""
    if boundary == "cell":
        return jammed(12, 1), strained(H), {}
    graph, planes, force = jammed_in_box(*ROUGH)
    return graph, DRAINED, {"boundary": between(planes, force)}


def own_and_known(boundary, kind):
    graph, stage, walls = scene(boundary)
    if kind == "linear":
        return graph, stage, walls, Springs(k=1.0, kt=0.5, mu=0.5), LAW
    known = hertz_of(graph, kind)
    how = {"ratio": float(known.stiffness_ratio), "mu": 0.5, "by_displacement": kind != "force"}
    return graph, stage, walls, Spheres(modulus=known.young / (1 - 0.2**2), **how), known


# Differences of the force have rounding of 1e-10; walls under Hertz's law are not springs.
KINDS = [("cell", "linear"), ("box", "linear"), ("cell", "force"), ("cell", "displacement")]


@pytest.mark.parametrize(("boundary", "kind"), KINDS)
def test_a_known_law_written_anew_goes_the_same_path(boundary, kind):
    graph, stage, walls, own, known = own_and_known(boundary, kind)
    how = {"closure": "packing", "interval": 4e-5}
    one, other = (follow(Scene(graph, law, **walls), stage, **how) for law in (own, known))
    assert one.status == other.status == "finished"
    assert events(one) == events(other) and len(one.events) > 1
    a, b = (path.states[-1] for path in (one, other))
    size = np.abs(b.forces).max()
    np.testing.assert_allclose(a.forces, b.forces, atol=1e-8 * size)
    np.testing.assert_allclose(a.x, b.x, atol=1e-10)
    np.testing.assert_allclose(one.work[-1], other.work[-1], atol=1e-8 * other.work[-1, 0])
    np.testing.assert_allclose(one.energy, other.energy, rtol=1e-8)


@pytest.mark.parametrize(("boundary", "kind"), KINDS)
def test_a_known_law_written_anew_is_replayed_as_it(boundary, kind):
    graph, _, walls, own, known = own_and_known(boundary, kind)
    strain, left = np.diag([1e-3, -1e-3]), []
    for step in (0.15, 0.075) if kind == "displacement" else (0.15,):
        # Cundall's damping goes by signs, in which rounding grows.
        calm = {"damping": 0.0, "viscous": 0.02}
        how = {"inertial_number": 1e-4, "time_step": step, **calm}
        a, b = (replay(Scene(graph, law, **walls), strain, **how) for law in (own, known))
        assert a.steps == b.steps > 800
        left.append(np.abs(a.state.forces - b.state.forces).max() / np.abs(b.state.forces).max())
    slides = np.abs(b.state.shear_force) >= 0.5 * b.state.normal_force * (1 - 1e-12)
    assert boundary == "box" or np.any(slides & b.state.closed)
    if kind == "displacement":
        # The force that goes with `kt` is added step by step: of the first order.
        assert left[1] < 0.8 * left[0] < 1e-4
    else:
        assert left[0] < 1e-9


@pytest.fixture(scope="module")
def stiffening():
    """A law under which a packing keeps the forces that it rests in, its packing and paths."""
    graph = jammed(12, 1)
    unit = Stiffening(k=1.0, b=40.0, c=5.0, kt=0.5, mu=0.54)
    forces = np.where(graph.normal_force > 0, unit.closed_force(contact_state(graph)), 1.0)
    k = np.where(graph.normal_force > 0, graph.normal_force / forces, 1.0)
    law = Stiffening(k=k, b=40.0, c=5.0, kt=0.5, mu=0.54)
    sizes = (4e-5, 2e-5, 1e-5)
    return (
        graph,
        law,
        [follow(Scene(graph, law), strained(H), interval=s, closure="packing") for s in sizes],
    )


def test_halving_the_interval_halves_the_error_and_the_energy_closes(stiffening):
    graph, _, paths = stiffening
    assert {path.status for path in paths} == {"finished"}
    assert events(paths[0]) == events(paths[1]) == events(paths[2])
    assert len({kind for kind, _ in events(paths[0])}) > 1
    ends = [path.states[-1].forces[: graph.contact_count] for path in paths]
    coarse, fine = (np.linalg.norm(a - b) / np.linalg.norm(ends[-1]) for a, b in pairwise(ends))
    assert coarse / fine > 1.9 and fine < 1e-4
    for path in paths:
        work, *spent = path.work[-1]
        assert abs(work - sum(spent) - (path.energy[-1] - path.energy[0])) < 1e-10 * work


@pytest.mark.slow
def test_slow_replays_come_to_the_forces_of_the_path(stiffening):
    """Half the rate has half the distance."""
    graph, law, paths = stiffening
    first = np.arange(graph.contact_count)
    wanted = paths[-1].states[-1].forces[first]
    ends = [replay(Scene(graph, law), H, duration=t, viscous=0.02).state for t in (2e3, 4e3)]
    left = [end.forces[first] - wanted for end in ends]
    fast, slow = np.linalg.norm(left, axis=(1, 2))
    assert 1.9 < fast / slow < 2.3 and slow < 4e-5 * np.linalg.norm(wanted)


def two(**forces):
    return GrainGraph(
        x=[[0, 0], [0.98, 0]], radii=[0.5, 0.5], contacts=[[0, 1]], images=[[0, 0]],
        cell=4 * np.eye(2), normal_force=[0.02], **forces,
    )  # fmt: skip


def class_with(**changes):
    return type("Mine", (Springs,), changes)(k=1.0, kt=0.5, mu=0.5)


REFUSED = {
    "without Mine.stiffnesses": lambda: type("Mine", (Springs,), {})(k=1.0, mu=0.5),
    "without Mine.closed_force": lambda: type("Mine", (FrictionalLaw,), {})(kn=1.0, kt=0.5),
    "Mine with gap": lambda: class_with(gap=lambda self, state: -2.0 * state.overlap),
    "Mine with keeps_strength": lambda: class_with(keeps_strength=False),
    "vanishes or pulls": lambda: class_with(closed_force=lambda self, state: state.overlap + 0.01),
    "not negative where": lambda: class_with(closed_force=lambda self, state: state.overlap - 0.01),
}


@pytest.mark.parametrize("message", REFUSED)
def test_a_law_that_no_path_can_follow_is_refused_before_anything_is_computed(message):
    with pytest.raises(InputError, match=message):
        follow(Scene(two(), REFUSED[message]()), strained(1e-3 * np.eye(2)), closure="packing")


def test_a_law_derived_from_a_known_one_is_taken_as_it_is_written():
    """Twice as stiff under half the overlap: the subclass rules, not its base."""

    class Twice(LinearFrictional):
        def closed_force(self, state):
            return 2.0 * self.kn * state.overlap

        def stiffnesses(self, state):
            return 2.0 * self.kn, self.kt

    graph = two(shear_force=[0.0])
    end = replay(
        Scene(graph, Twice(1.0, 0.5, 0.5)), np.zeros((2, 2)), duration=1e-9, time_step=1e-9
    ).state
    assert end.normal_force[0] == pytest.approx(0.04, rel=1e-9)


@pytest.mark.parametrize("boundary", ["cell", "box"])
def test_a_compiled_law_is_replayed_as_numpy_does(boundary):
    """In a cell and beside springs at walls; the answer says how the law was asked."""
    graph, _, walls = scene(boundary)
    calm = {"inertial_number": 1e-3, "damping": 0.0, "viscous": 0.02}
    ends = []
    for compiled in (True, False):
        law = Springs(k=1.0, kt=0.5, mu=0.5, compiled=compiled)
        ends.append(replay(Scene(graph, law, **walls), np.diag([1e-3, -1e-3]), **calm))
    assert [end.law_asked for end in ends] == ["compiled", "numpy"]
    a, b = (end.state for end in ends)
    np.testing.assert_allclose(a.forces, b.forces, atol=1e-11 * np.abs(b.forces).max())


def test_a_law_is_compiled_where_the_run_is_long():
    graph, law = jammed(12, 1), Springs(k=1.0, kt=0.5, mu=0.5)
    short, long = (replay(Scene(graph, law), np.diag([1e-5, 0]), steps=n) for n in (2_499, 2_500))
    assert (short.law_asked, long.law_asked) == ("numpy", "compiled")
    known = replay(Scene(graph, LAW), np.diag([1e-5, 0]), steps=10)
    assert known.law_asked == "kernel"


def test_a_law_that_numba_cannot_compile_is_asked_in_numpy():
    class Changed(Springs):
        def local_stiffness(self, state, regime):
            return super().local_stiffness(state, regime)

    graph = jammed(12, 1)
    end = replay(Scene(graph, Changed(k=1.0, kt=0.5, mu=0.5)), np.diag([1e-5, 0]), steps=2_500)
    assert end.law_asked == "numpy: it changes local_stiffness"
    law = Changed(k=1.0, kt=0.5, mu=0.5, compiled=True)
    with pytest.raises(InputError, match="compiled=True; it changes local_stiffness"):
        replay(Scene(graph, law), np.diag([1e-5, 0]), steps=10)
