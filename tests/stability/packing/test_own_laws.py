"""A law of one's own in paths and replays: against known laws, slow motion, its energy."""

import numpy as np
import pytest

from grainloops import replay
from loops import FrictionalLaw, GrainGraph, InputError, LinearFrictional, Scene
from stability import Stage, follow, programmes
from tests.laws import ByDisplacement, Spheres, Springs, hertz_of
from tests.packings import LAW, jammed, strained
from tests.stability.packing.walled_packings import JAMMED, between, jammed_in_box

H = np.array([[2e-3, 2e-4], [0.0, -2e-3]])
DRAINED = Stage(programmes.drained_biaxial(), "H11", 2e-3)
ROUGH = next(which for which in JAMMED if which[3][1] > 0)


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
        return graph, stage, walls, Springs(k=1.0, kt=0.5, mu=0.5, shear_increment="radii"), LAW
    known = hertz_of(graph, kind)
    how = {"ratio": float(known.stiffness_ratio), "mu": 0.5, "shear_increment": "radii"}
    spheres = Spheres if kind == "force" else ByDisplacement
    return graph, stage, walls, spheres(modulus=known.young / (1 - 0.2**2), **how), known


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
    # The energy of springs that are not known is a quadrature of their force.
    np.testing.assert_allclose(one.energy, other.energy, rtol=1e-6)


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
