"""Rates of a scene, against differences along paths and motions, and against the old form."""

from dataclasses import replace

import numpy as np
import pytest

import grainloops as gl
from loops import InputError, RollingResistance, Scene, boundary_of
from tests.packings import LAW, jammed, plane_contacts
from tests.stability.packing.walled_packings import JAMMED, between, jammed_in_box

FREE = gl.LinearFrictional(1.0, 0.5, np.inf)
PENTAGON = gl.regular_polygon(5, strain=0.05)
NAN = np.nan
# Strain over which differences are taken: rounding and curvature leave some 1e-6 of the rates.
SIZE = 1e-6
MEANS = ("strain_rate", "stress_rate", "cauchy_rate")


def cauchy(path, row):
    F = np.eye(2) - path.H[row].reshape(2, 2)
    return path.P[row].reshape(2, 2) @ F.T / np.linalg.det(F)


@pytest.mark.parametrize("closure", ["affine", "traction"])
@pytest.mark.parametrize("name", ["cauchy_drained", "simple_shear", "undrained"])
def test_a_loop_against_central_differences_of_its_path(closure, name):
    scene = Scene(PENTAGON, FREE)
    found = gl.rates_at(scene, name, closure=closure, spins="free")
    ends = []
    for sign in (1.0, -1.0):
        programme = getattr(gl.programmes, name)(rate=sign)
        stage = gl.Stage(programme, "parameter", SIZE)
        path = gl.follow(scene, stage, closure=closure, spins="free")
        assert path.status == "finished" and not path.of_kind("yield")
        ends.append((path.H[-1].reshape(2, 2), path.P[-1].reshape(2, 2), cauchy(path, -1)))
    for name, one, other in zip(MEANS, *ends, strict=True):
        rate = (one - other) / (2 * SIZE)
        np.testing.assert_allclose(getattr(found, name), rate, rtol=1e-7, atol=1e-9)


def test_the_reference_of_a_loop_need_not_be_its_state():
    """A path has gone on to a rotated and sheared place; its Cauchy stress changes as it says."""
    stages = [gl.Stage("isotropic_strain", "H11", 0.05), gl.Stage("simple_shear", "H12", 0.1)]
    scene = Scene(gl.regular_polygon(5), FREE)
    path = gl.follow(scene, stages, closure="affine")
    x = path.x[-1]
    state = gl.regular_polygon(5).replace(
        x=x, normal_force=path.normal_force[-1], shear_force=path.shear_force[-1]
    )
    found = gl.rates_at(Scene(state, FREE), "simple_shear", closure="affine")
    further = [
        gl.follow(scene, [*stages[:1], gl.Stage("simple_shear", "H12", 0.1 + h)], closure="affine")
        for h in (SIZE, -SIZE)
    ]
    rate = (cauchy(further[0], -1) - cauchy(further[1], -1)) / (2 * SIZE)
    np.testing.assert_allclose(found.cauchy_rate, rate, rtol=1e-6, atol=1e-9)
    assert np.abs(found.cauchy_rate - found.stress_rate).max() > 1e-3


def packings():
    cell = jammed(24, 3)
    box, planes, force = jammed_in_box(*JAMMED[0])
    rough, other, push = jammed_in_box(*JAMMED[4])
    return {
        "cell": Scene(cell, LAW),
        "box": Scene(box, JAMMED[0][2], between(planes, force, volume=11.0)),
        "rough box": Scene(rough, JAMMED[4][2], between(other, push, volume=11.0)),
        "outline": Scene(cell, LAW, boundary_of(cell, held=np.arange(24) < 3)),
        "rolling": Scene(cell, RollingResistance(LAW, 0.1)),
    }


PACKINGS = packings()
CONTROLS = [
    ([[1.0, 0.3], [-0.2, -0.4]], None),
    ([[1.0, 0.0], [0.0, NAN]], None),
    ([[NAN, 0.0], [0.0, 0.5]], [[0.02, NAN], [NAN, NAN]]),
]


@pytest.mark.parametrize("name", ["cell", "box", "rough box", "rolling"])
def test_a_packing_against_its_path(name):
    """Without slip; the error of a short path halves with it, and is extrapolated."""
    scene = PACKINGS[name]
    boundary = scene.boundary
    if boundary.walls is not None:
        boundary = replace(boundary, walls=replace(boundary.walls, mu=None))
    scene = Scene(scene.graph, law_without_slip(scene.law), boundary)
    H = np.diag([1.0, -0.4])
    found = gl.rates_at(scene, H=H, regime="elastic")
    programme = gl.programmes.proportional_strain(1.0, -0.4)
    change = []
    for size in (2e-7, 1e-7):
        stage = gl.Stage(programme, "parameter", size)
        path = gl.follow(scene, stage, interval=4e-7)
        start, end = (path.states[row].stress for row in (0, -1))
        assert path.status == "finished" and not path.of_kind("opening")
        area = np.linalg.det(path.states[0].cell) / scene.boundary.volume
        change.append(area * (end - start) / size)
    rate = 2 * change[1] - change[0]
    size = np.abs(rate).max()
    np.testing.assert_allclose(found.cauchy_rate, rate, rtol=0, atol=2e-5 * size)


def law_without_slip(law):
    if isinstance(law, RollingResistance):
        return RollingResistance(law_without_slip(law.law), 0.1)
    return gl.LinearFrictional(law.kn, law.kt, np.inf, law.shear_increment)


@pytest.mark.parametrize("name", ["cell", "box"])
def test_a_programme_is_what_its_components_are(name):
    scene = PACKINGS[name]
    for control, H, P in [
        ("drained_biaxial", [[1.0, 0.0], [0.0, NAN]], None),
        (gl.programmes.proportional_stress(0.3, -0.1), None, [[0.3, NAN], [NAN, -0.1]]),
        ("oedometric", [[1.0, 0.0], [0.0, 0.0]], None),
    ]:
        one, other = gl.rates_at(scene, control), gl.rates_at(scene, H=H, P=P)
        np.testing.assert_array_equal(one.stress_rate, other.stress_rate)
        assert one.status == other.status


def test_equations_of_stress_and_strain_together():
    """A spring around the cell, `P22' = 0.3 H22'`, and rows that are no unit vectors."""
    stress, strain = np.zeros((4, 4)), np.diag([2.0, 1.0, 3.0, -0.3])
    stress[3, 3], strain[1, 2] = 1.0, 1.0
    programme = gl.programmes.combination(stress, strain, [1.0, 0, 0, 0])
    for scene, how in ((PACKINGS["cell"], {}), (Scene(PENTAGON, FREE), {"closure": "affine"})):
        found = gl.rates_at(scene, programme, **how)
        H, P = found.strain_rate.ravel(), found.stress_rate.ravel()
        np.testing.assert_allclose(stress @ P + strain @ H, programme.rate, atol=1e-12)
        again = gl.rates_at(scene, H=found.strain_rate, **how)
        np.testing.assert_allclose(again.stress_rate, found.stress_rate, rtol=1e-8, atol=1e-10)
    held = gl.rates_at(PACKINGS["cell"], "biaxial")
    assert abs(held.cauchy_rate[1, 1]) < 1e-14 and abs(held.stress_rate[1, 1]) > 1e-4
    undrained = gl.rates_at(PACKINGS["cell"], "undrained")
    assert abs(np.trace(undrained.strain_rate)) < 1e-14 and undrained.strain_rate[0, 0] == 1.0


def at_yield():
    T = np.array([0.4, 0.1, -0.4, 0.0, 0.2]) * PENTAGON.normal_force
    return Scene(PENTAGON.replace(shear_force=T), gl.LinearFrictional(1.0, 0.5, 0.4))


def test_regimes_that_are_told():
    scene = at_yield()
    how = {"H": [[1.0, 0.1], [0.0, -1.0]], "closure": "affine"}
    stuck, slides = (gl.rates_at(scene, regime=r, **how) for r in ("elastic", "sliding"))
    assert stuck.status == slides.status == "given" and stuck.tried == 1
    assert stuck.taken.rates.mode.regime.tolist() == [1] * 5
    assert slides.taken.rates.mode.regime.tolist() == [2, 1, 2, 1, 1]
    elastic = gl.affine_tangent(scene.graph, scene.law, regime=np.ones(5, dtype=np.int8))
    np.testing.assert_allclose(
        stuck.stress_rate.ravel(), elastic.matrix @ stuck.strain_rate.ravel(), rtol=1e-12
    )
    packing = PACKINGS["cell"]
    H = np.diag([1.0, -1.0])
    all_stick = gl.rates_at(packing, H=H, regime="elastic")
    never = gl.rates_at(Scene(packing.graph, law_without_slip(packing.law)), H=H)
    assert all_stick.status == "given" and all_stick.candidates > 0 == all_stick.sliding
    np.testing.assert_array_equal(all_stick.stress_rate, never.stress_rate)
    all_slide = gl.rates_at(packing, H=H, regime="sliding")
    assert all_slide.sliding == all_slide.candidates == all_stick.candidates
    # Of all choices that which agrees is between them; the wrong ones are counted.
    best = gl.rates_at(packing, H=H)
    assert best.disagreeing == 0 < max(all_stick.disagreeing, all_slide.disagreeing)


def test_a_snapshot_stands_for_its_scene():
    snapshot = gl.read_snapshot(gl.sample_path())
    one = gl.rates_at(snapshot, "drained_biaxial")
    other = gl.rates_at(snapshot.scene, "drained_biaxial")
    np.testing.assert_array_equal(one.cauchy_rate, other.cauchy_rate)


def test_no_solution_has_no_rates():
    """A contact along axis 1 carries nothing along axis 2."""
    graph = gl.GrainGraph([[0.0, 0.0], [1.0, 0.0]], [0.5] * 2, [[0, 1]])
    scene = Scene(graph, FREE, boundary_of(graph, volume=1.0))
    found = gl.rates_at(scene, P=[[NAN, 0.0], [0.0, 1.0]], closure="affine", regime="elastic")
    assert found.status == "none" and np.isnan(found.cauchy_rate).all()


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ({}, "a programme, or H= and P="),
        ({"programme": "oedometric", "H": np.eye(2)}, "a programme and components"),
        ({"programme": "triaxial"}, "oedometric"),
        ({"H": [1.0, 2.0]}, "shape"),
        ({"H": np.eye(2), "P": np.eye(2)}, "both of 11, 12, 21, 22"),
        ({"H": [[NAN, 0], [0, 0]], "P": [[NAN] * 2] * 2}, "stress_rate"),
        ({"H": np.eye(2), "regime": "open"}, "regime"),
        ({"H": np.eye(2), "spins": "free"}, "spins"),
        ({"H": np.eye(2), "closure": "traction", "starts": 3}, "starts"),
        ({"H": np.eye(2), "yield_band": 0.0}, "yield_band"),
    ],
)
def test_what_cannot_be_asked(asked, told):
    with pytest.raises(InputError, match=told):
        gl.rates_at(PACKINGS["cell"], **asked)


def test_a_free_scene_names_its_closure_and_a_free_packing_floats():
    with pytest.raises(InputError, match="closure"):
        gl.rates_at(Scene(PENTAGON, FREE), "oedometric")
    with pytest.raises(InputError, match="float"):
        gl.rates_at(Scene(PENTAGON, FREE, boundary_of(PENTAGON, volume=1.0)), "oedometric",
                    closure="packing")  # fmt: skip


def test_walls_without_a_force_push_by_their_overlap():
    graph = gl.GrainGraph([[0.49, 0.49]], [0.5], np.zeros((0, 2), dtype=int))
    branch = np.array([[-0.49, 0], [0.49, 0], [0, -0.49], [0, 0.49]])
    known = plane_contacts(graph, [0] * 4, -branch / 0.49 * 0.01, -branch)
    rates = []
    for walls in (known, replace(known, force=None)):
        scene = Scene(graph, LAW, boundary_of(graph, walls=walls, volume=0.98**2))
        rates.append(gl.rates_at(scene, H=np.diag([1.0, 0.0])).cauchy_rate)
    np.testing.assert_allclose(rates[0], rates[1], rtol=1e-12)
