"""One step of a set of loops against exact paths, differences and closed identities."""

from functools import cache

import numpy as np
import pytest

from grainloops import LoopMaterial, march, oriented
from loops import (
    CohesiveFrictional,
    FrictionalLaw,
    GrainGraph,
    HertzMindlin,
    InputError,
    LinearFrictional,
    Scene,
    contact_state,
    polygon_area,
)
from patterns import hexagon, polydisperse_polygon, random_loop, regular_polygon
from stability import Stage, follow, programmes
from tests.laws import Springs

MU, ONE = np.tan(np.radians(30)), np.eye(2)[None]
LAW = LinearFrictional(kn=1.0, kt=0.5, mu=MU)
HEXAGON = regular_polygon(6)
HERTZ = HertzMindlin(young=1.0, poisson=0.3, mu=0.4)
BY_DISPLACEMENT = HertzMindlin(young=1.0, poisson=0.3, mu=0.4, shear_history="displacement")
BY_RADII = LinearFrictional(kn=1.0, kt=0.5, mu=MU, shear_increment="radii")


def turned(loop, angle):
    cos, sin = np.cos(angle), np.sin(angle)
    x = loop.x @ np.array([[cos, sin], [-sin, cos]])
    return loop.replace(x=x, x0=x)


def gradient(H11, H22, H12=0.0):
    return np.array([[[1.0 - H11, -H12], [-H12, 1.0 - H22]]])


def stepped(material, H, steps, state=None):
    """The response at the end of a straight path of strain (11, 22, 12)."""
    state = material.start(1) if state is None else state
    begin = np.eye(2) - state.stretch[0]
    for k in range(1, steps + 1):
        part = begin + (np.array([[H[0], H[2]], [H[2], H[1]]]) - begin) * k / steps
        response = material.update(np.eye(2)[None] - part[None], state)
        state = response.state
    return response


def symmetric(P):
    return np.array([P[0], 0.5 * (P[1] + P[2]), P[3]])


def path_end(loop, law, H, closure):
    rate = np.array([H[0], H[2], H[2], H[1]])
    programme = programmes.combination(np.zeros((4, 4)), np.eye(4), rate, "straight")
    stage = Stage(programme, "parameter", 1.0)
    path = follow(Scene(loop, law), stage, closure=closure)
    assert path.status == "finished"
    return path


@pytest.mark.parametrize("steps", [1, 7, 64])
@pytest.mark.parametrize("law", [LAW, BY_RADII])
@pytest.mark.parametrize("loop", [turned(HEXAGON, 0.3), turned(regular_polygon(5), 0.1)])
def test_affine_step_of_any_length_equals_the_path_by_events(loop, law, steps):
    H = (0.06, -0.01, 0.01)
    path = path_end(loop, law, H, "affine")
    assert path.of_kind("yield")
    response = stepped(LoopMaterial(loop, None, law, closure="affine"), H, steps)
    P = symmetric(response.stress.reshape(4))
    exact = symmetric(path.P[-1])
    assert np.abs(P - exact).max() <= 1e-14


GLUE = CohesiveFrictional(kn=1.0, kt=0.5, mu=0.4, adhesion=2e-3)
# Gauss points on [0, 1]; Hertz's law has five.
NODES = [(0.5 + 0.5 * s, 0.5 * w) for s, w in (np.polynomial.legendre.leggauss(n) for n in (60, 5))]
SPHERES = 2 / 3 / (1.0 - 0.3**2), 2.0 * (1.0 - 0.3) / (2.0 - 0.3)


def by_itself(law, touching, reduced, p, d, T):
    """Forces, shear forces and regimes of contacts that go from the branches p to d, (m, 2)."""
    # Those that were open start anew where they touch.
    D, opened = d - p, np.hypot(*p.T) > touching
    a, b, c = (D * D).sum(axis=1), (p * D).sum(axis=1), (p * p).sum(axis=1) - touching**2
    first = np.where(opened, (-b - np.sqrt(np.maximum(b * b - a * c, 0.0))) / a, 0.0)
    p, T = p + first[:, None] * D, np.where(opened, 0.0, T)
    modulus, ratio = SPHERES

    def springs(length):
        overlap = np.maximum(touching - length, 0.0)
        if isinstance(law, HertzMindlin):
            kn = 1.5 * modulus * np.sqrt(reduced * overlap)
            return kn * overlap / 1.5, ratio * kn
        return law.kn * overlap - np.asarray(law.attraction), law.kt + 0.0 * overlap

    s, w = NODES[law is HERTZ]
    r = np.array([np.hypot(*(p + one * (d - p)).T) for one in s])
    g, turn = touching / r if law is BY_RADII else 1.0, p[:, 0] * d[:, 1] - p[:, 1] * d[:, 0]
    length = np.hypot(*d.T)
    N, kt = springs(length)
    along = np.array([springs(one)[1] for one in r])
    if law is BY_DISPLACEMENT:
        before, along = springs(np.hypot(*p.T))[1], kt
        T = np.where(T == 0.0, 0.0, T * kt / np.where(T == 0.0, 1.0, before))
    T = T - turn * (w[:, None] * along * g / r).sum(axis=0)
    most, closed = law.mu * N + np.asarray(law.cohesion), length < touching
    slides, n = np.abs(T) > most, d / length[:, None]
    N, T = closed * N, closed * np.where(slides, np.sign(T) * most, T)
    force = N[:, None] * n + T[:, None] * np.stack([-n[:, 1], n[:, 0]], axis=1)
    return force, T, np.where(closed, 1 + slides, 0)


@cache
def many_loops():
    orders = np.random.default_rng(0).integers(3, 9, 120)
    return [random_loop(int(n), seed=k) for k, n in enumerate(orders)]


@pytest.mark.parametrize("law", [LAW, BY_RADII, GLUE, HERTZ, BY_DISPLACEMENT])
def test_contacts_of_many_loops_answer_as_each_by_itself(law):
    """Short and long ways, contacts that stay, open, touch again; more of them than a chunk."""
    loops, regimes = many_loops(), set()
    weights = np.random.default_rng(0).random(len(loops))
    material = LoopMaterial(loops, weights, law, closure="affine")
    orders = [loop.grain_count for loop in loops]
    share = np.repeat(weights / weights.sum() / [polygon_area(loop.x) for loop in loops], orders)
    d0 = np.concatenate([np.roll(loop.x, -1, axis=0) - loop.x for loop in loops])
    r, R = (np.concatenate([np.roll(loop.radii, k) for loop in loops]) for k in (0, -1))
    state = material.start(1)
    for H11, H22, H12 in ((0.01, 0.0, 0.001), (-0.05, 0.02, 0.0), (0.04, 0.02, 0.01),
                          (0.4, 0.3, 0.1), (-0.1, -0.1, 0.0), (0.02, 0.01, -0.01)):  # fmt: skip
        U, before = np.array([[1.0 - H11, -H12], [-H12, 1.0 - H22]]), state.stretch[0]
        response = material.update(U[None], state)
        ways = d0 @ before, d0 @ U, state.shear_force[0]
        force, T, regime = by_itself(law, r + R, r * R / (r + R), *ways)
        assert np.abs(response.state.shear_force[0] - T).max() <= 2e-14
        B = np.einsum("m,mi,mj->ij", share, force, d0)
        B = 0.5 * (B + B.T)
        # The Cauchy stress is symmetric.
        E = np.array([[0.0, 1.0], [-1.0, 0.0]])
        B += np.trace(B @ U @ E) / np.trace(U) * E
        assert np.abs(response.stress[0] - B).max() <= 1e-14
        regimes.update(regime.tolist())
        state = response.state
    assert regimes == {0, 1, 2} and len(d0) > 512


@pytest.mark.parametrize("law", [LAW, GLUE, Springs(k=1.0, kt=0.5, mu=MU)])
@pytest.mark.parametrize("closure", ["affine", "traction"])
def test_a_loop_that_hardly_touches_has_the_tangent_of_what_follows(law, closure):
    """Into compression its slope, by one-sided differences of the third order."""
    material = LoopMaterial(oriented(HEXAGON, 3), None, law, closure=closure)
    state, D, h = material.start(1), np.array([[1.0, 0.2], [0.2, 0.8]]), 1e-4
    for F in (ONE, ONE - 5e-4 * D):
        stress = [material.update(F - k * h * D, state).stress[0] for k in range(4)]
        numeric = np.tensordot([-11 / 6, 3.0, -1.5, 1 / 3], stress, 1) / h
        tangent = material.update(F, state).tangent[0]
        assert np.abs(np.einsum("ijkl,kl->ij", tangent, D) - numeric).max() < 1e-9


def test_traction_steps_converge_in_second_order_to_the_path_by_events():
    loop, H = turned(HEXAGON, 0.3), (0.05, 0.01, 0.0)
    exact = symmetric(path_end(loop, LAW, H, "traction").P[-1])
    material = LoopMaterial(loop, None, LAW, closure="traction")
    errors = []
    for steps in (1, 64, 1024):
        response = stepped(material, H, steps)
        errors.append(np.abs(symmetric(response.stress.reshape(4)) - exact).max())
    print(errors)
    assert errors[0] < 1e-4 and errors[1] < 5e-8 and errors[2] < 2e-10
    assert errors[1] < 1.5 * errors[0] / 64**2 and errors[2] < 1.5 * errors[1] / 16**2


MATERIALS = {
    "affine": LoopMaterial(oriented(HEXAGON, 5), None, LAW, closure="affine"),
    "traction": LoopMaterial(oriented(regular_polygon(5), 5), None, LAW),
    "cell": LoopMaterial(oriented(hexagon(np.radians(55)), 5), None, LAW, closure="cell"),
    "radii": LoopMaterial(oriented(HEXAGON, 5), None, BY_RADII),
    "hertz": LoopMaterial(oriented(HEXAGON, 5), None, HERTZ),
    "hertz by displacement": LoopMaterial(oriented(HEXAGON, 5), None, BY_DISPLACEMENT),
}


def differences(material, F, state, h=1e-5):
    """dP/dH by central differences of the fourth order."""
    numeric = np.zeros((2, 2, 2, 2))
    for k in range(2):
        for m in range(2):
            for reach, weight in ((1, 8.0), (-1, -8.0), (2, -1.0), (-2, 1.0)):
                moved = F.copy()
                moved[0, k, m] += reach * h
                stress = material.update(moved, state).stress[0]
                numeric[..., k, m] -= weight * stress / (12.0 * h)
    return numeric


# Strain before, and at the end of the step: elastic, sliding, with contacts that touch again.
STEPS = {
    "elastic": ((0.01, 0.012), [[0.985, 0.004], [-0.002, 0.99]]),
    "sliding": ((0.03, 0.01), [[0.92, 0.03], [0.02, 1.0]]),
    "closing": ((-0.02, -0.03), [[0.97, 0.01], [-0.01, 0.985]]),
}


@pytest.mark.parametrize("name", MATERIALS)
@pytest.mark.parametrize("step", STEPS)
def test_tangent_equals_central_differences(name, step):
    material, (before, end) = MATERIALS[name], STEPS[step]
    state = material.update(gradient(*before), material.start(1)).state
    F = np.array([end])
    response = material.update(F, state)
    numeric = differences(material, F, state)
    assert np.abs(numeric - response.tangent[0]).max() < 1e-9 * np.abs(numeric).max()
    if step == "sliding":
        assert response.regimes[0, 1] > 0.0


@pytest.mark.parametrize("name", MATERIALS)
def test_rotations_do_nothing_and_the_cauchy_stress_is_symmetric(name):
    material = MATERIALS[name]
    state = still = material.start(1)
    for k in range(1, 201):
        F0 = gradient(0.04 * k / 200, 0.01 * k / 200, 0.01 * k / 200)
        angle = 10.0 * k / 200
        R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        turned_response = material.update(R @ F0, state)
        response = material.update(F0, still)
        state, still = turned_response.state, response.state
        cauchy = turned_response.stress[0] @ (R @ F0[0]).T
        assert abs(cauchy[0, 1] - cauchy[1, 0]) <= 1e-15 * np.abs(cauchy).max()
    size = np.abs(response.stress).max()
    assert np.abs(turned_response.stress[0] - R @ response.stress[0]).max() < 1e-12 * size
    there = np.einsum("im,kn,mjnl->ijkl", R, R, response.tangent[0])
    assert np.abs(turned_response.tangent[0] - there).max() < 1e-11 * np.abs(there).max()


def test_traction_of_triangles_is_affine():
    loop = polydisperse_polygon([1.0, 1.3, 0.8])
    both = [
        stepped(LoopMaterial(oriented(loop, 4), None, LAW, closure=closure), (0.05, 0.0, 0.01), 3)
        for closure in ("affine", "traction")
    ]
    assert both[0].regimes[0, 1] > 0
    assert np.allclose(both[0].stress, both[1].stress, rtol=0, atol=1e-14)
    assert np.allclose(both[0].tangent, both[1].tangent, rtol=0, atol=1e-12)


@pytest.mark.parametrize("closure", ["affine", "traction", "cell"])
def test_a_law_of_ones_own_answers_as_the_compiled_one(closure):
    own = Springs(k=1.0, kt=0.5, mu=MU)
    for H in ((0.01, 0.01, 0.002), (0.05, 0.0, 0.01), (-0.01, -0.03, 0.0)):
        a, b = (
            stepped(LoopMaterial(oriented(HEXAGON, 3), None, law, closure=closure), H, 4)
            for law in (LAW, own)
        )
        assert np.array_equal(a.regimes, b.regimes) and np.array_equal(a.failed, b.failed)
        # Five Gauss points over a step of .02, differences of the fourth order.
        assert np.allclose(a.stress, b.stress, rtol=0, atol=1e-13)
        assert np.allclose(a.tangent, b.tangent, rtol=0, atol=1e-9)


def test_contacts_without_friction_slide_without_a_shear_force():
    law = LinearFrictional(kn=1.0, kt=0.5, mu=0.0)
    response = stepped(LoopMaterial(HEXAGON, None, law, closure="affine"), (0.01, 0.01, 0.0), 1)
    assert response.regimes.tolist() == [[0.0, 1.0, 0.0]] and not response.state.shear_force.any()


def test_attraction_pulls_where_grains_touch():
    law = CohesiveFrictional(kn=1.0, kt=0.5, mu=MU, adhesion=1e-3)
    response = stepped(LoopMaterial(HEXAGON, None, law), (0.0, 0.0, 0.0), 1)
    loop = HEXAGON.replace(normal_force=np.full(6, -1e-3))
    area = 1.5 * np.sqrt(3.0)
    assert loop.normal_force[0] < 0
    assert np.allclose(response.stress[0], -3e-3 / area * np.eye(2), rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("law", [HERTZ, BY_DISPLACEMENT])
@pytest.mark.parametrize("closure", ["affine", "traction"])
def test_hertz_converges_to_the_path_by_events(law, closure):
    # From a compressed state: at first touch the path by events starts at a first strain.
    loop = turned(HEXAGON, 0.3)
    loop = loop.replace(x=0.99 * loop.x, x0=0.99 * loop.x)
    H = (0.03, 0.005, 0.0)
    loop = loop.replace(normal_force=law.normal_force(contact_state(loop)))
    exact = symmetric(path_end(loop, law, H, closure).P[-1])
    material = LoopMaterial(loop, None, law, closure=closure)
    errors = [
        np.abs(symmetric(stepped(material, H, steps).stress.reshape(4)) - exact).max()
        for steps in (8, 64)
    ]
    assert errors[1] < 1e-6 * np.abs(exact).max() and errors[1] < 0.05 * errors[0] + 1e-14


def test_sets_points_blocks_threads_and_numbers_change_nothing():
    mixed = [regular_polygon(n) for n in (3, 5, 8)]
    weights = [1.0, 2.0, 3.0]
    H = (0.03, 0.0, 0.005)
    together = stepped(LoopMaterial(mixed, weights, LAW), H, 3)
    apart = [stepped(LoopMaterial(loop, None, LAW), H, 3).stress for loop in mixed]
    mean = sum(w * P for w, P in zip(weights, apart, strict=True)) / 6.0
    assert np.allclose(together.stress, mean, rtol=0, atol=1e-15)
    # The first grain, the direction of the axes, units.
    loop, H = random_loop(7, seed=4, strain=0.01), (0.03, 0.02, 0.005)
    assert np.abs(loop.shear_force).min() > 0
    roll = loop.replace(
        x=np.roll(loop.x, 2, axis=0),
        shear_force=np.roll(loop.shear_force, 2),
    )
    a = stepped(LoopMaterial(loop, None, LAW), H, 3)
    b = stepped(LoopMaterial(roll, None, LAW), H, 3)
    assert np.allclose(a.stress, b.stress, rtol=0, atol=1e-14)
    larger = loop.replace(
        x=1e-3 * loop.x, radii=1e-3 * loop.radii, shear_force=2e5 * loop.shear_force
    )
    c = stepped(LoopMaterial(larger, None, LinearFrictional(2e8, 1e8, MU)), H, 3)
    assert np.allclose(c.stress, 2e8 * a.stress, rtol=0, atol=1e-14 * 2e8)
    # Many points at once, some in each block, by one thread and by two.
    points = 1500
    materials = [LoopMaterial(HEXAGON, None, LAW, threads=threads) for threads in (1, 2)]
    F = np.eye(2) - np.linspace(0.0, 0.05, points)[:, None, None] * np.diag([1.0, -0.2])
    one, two = (material.update(F, material.start(points)) for material in materials)
    assert np.array_equal(one.stress, two.stress) and np.array_equal(one.tangent, two.tangent)
    last = materials[0].update(F[-1:], materials[0].start(1))
    assert np.array_equal(one.stress[-1:], last.stress)


def test_tension_positive_is_the_same_tangent():
    response = stepped(MATERIALS["traction"], (0.03, 0.0, 0.005), 2)
    turned_sign = response.to_tension_positive()
    assert np.array_equal(turned_sign.stress, -response.stress)
    assert np.array_equal(turned_sign.tangent, response.tangent)


# ---- averages under drained biaxial compression


def drained(loop, closure="traction", end=0.1):
    material = LoopMaterial(oriented(loop, 36), None, LAW, closure=closure)
    rest = march(material, Stage("isotropic_stress", "P11", 1e-2), 10)
    start = rest.H[-1, 0]
    stages = [Stage("isotropic_stress", "P11", 1e-2), Stage("drained_biaxial", "H11", start + end)]
    path = march(material, stages, round(end / 5e-4))
    rows = path.stage == 1
    ratio, strain = path.P[rows, 0] / path.P[rows, 3], path.H[rows, 0] - start
    return ratio, strain, path.work[rows]


def test_averaged_hexagons_peak():
    ratio, strain, work = drained(HEXAGON, end=0.07)
    peak = ratio.argmax()
    assert abs(ratio[peak] - 4.649) < 1e-3 and abs(strain[peak] - 0.0610) < 1e-9
    assert abs(strain[np.flatnonzero(work < 0)[0]] - 0.0615) < 1e-9


@pytest.mark.parametrize(
    "loop, closure",
    [(hexagon(np.radians(45)), "traction"), (regular_polygon(4), "traction"),
     (regular_polygon(3), "traction"), (HEXAGON, "affine")],
)  # fmt: skip
def test_other_averages_harden(loop, closure):
    ratio, strain, work = drained(loop, closure)
    assert len(strain) == 201 and (np.diff(ratio) > 0).all() and (work[1:] > 0).all()


# ---- bad input


class Coupled(Springs):
    """Normal and shear are coupled while it sticks."""

    def local_stiffness(self, state, regime):
        stiffness = super().local_stiffness(state, regime)
        stiffness[..., 0, 1] = 0.1
        return stiffness


class Integrated(Springs):
    """Its sliding shear force has a rate of its own."""

    keeps_strength = False


@pytest.mark.parametrize(
    "law, words",
    [
        (CohesiveFrictional(1.0, 0.5, MU, 1e-3, bonded=True), "bonds, which break for good"),
        (Coupled(k=1.0, kt=0.5, mu=MU), "a normal force of the overlap alone"),
        (Integrated(k=1.0, kt=0.5, mu=MU), "Integrated with keeps_strength"),
        (FrictionalLaw(kn=1.0, kt=0.5), "FrictionalLaw.closed_force"),
        ("linear", "got str, expected a law derived from"),
        (None, "got none, expected a contact law"),
    ],
)
def test_laws_that_cannot_be_stepped(law, words):
    with pytest.raises(InputError, match=words):
        LoopMaterial(HEXAGON, None, law)


def test_loops_and_weights_that_are_none():
    bare = GrainGraph(x=HEXAGON.x, radii=HEXAGON.radii, contacts=np.zeros((0, 2), dtype=int))
    for loops, words in (
        (bare, "contact 0 of a loop"),
        ([], "got none"),
        ("hexagon", "got .hexagon."),
    ):
        with pytest.raises(InputError, match=words):
            LoopMaterial(loops, None, LAW)
    backwards = HEXAGON.x[::-1]
    with pytest.raises(InputError, match="clockwise"):
        LoopMaterial(HEXAGON.replace(x=backwards, x0=backwards), None, LAW)
    for weights in ([0.0, 0.0], [1.0, -1.0], [1.0], [np.nan, 1.0]):
        with pytest.raises(InputError, match="weights"):
            LoopMaterial(oriented(HEXAGON, 2), weights, LAW)
    with pytest.raises(InputError, match="hexagons"):
        LoopMaterial(regular_polygon(5), None, LAW, closure="cell")
    with pytest.raises(InputError, match="mirror planes"):
        LoopMaterial(random_loop(6, seed=1), None, LAW, closure="cell")
    with pytest.raises(InputError, match="closure"):
        LoopMaterial(HEXAGON, None, LAW, closure="reuss")
    for count in (0, 1.5):
        with pytest.raises(InputError, match="orientations"):
            oriented(HEXAGON, count)


def test_a_refused_step_leaves_the_state_valid():
    material = LoopMaterial(oriented(HEXAGON, 4), None, LAW)
    state = stepped(material, (0.02, 0.01, 0.0), 2).state
    good = material.update(gradient(0.03, 0.0), state)
    for F, words in (
        (np.diag([1.0, -1.0])[None], "det F = -1, expected det F > 0"),
        (np.full((1, 2, 2), np.nan), "finite number"),
        (np.eye(2), "shape"),
        (np.array([[[0.3, 0.0], [0.0, 2.5]]]), "of the loops of point 0 without a solution"),
    ):
        with pytest.raises(InputError, match=words):
            material.update(F, state)
    again = material.update(gradient(0.03, 0.0), state)
    assert np.array_equal(good.stress, again.stress)
    with pytest.raises(InputError, match="state of the material"):
        LoopMaterial(HEXAGON, None, LAW).update(np.eye(2)[None], state)


def test_programmes_that_a_march_cannot_end():
    with pytest.raises(InputError, match="drives"):
        march(MATERIALS["traction"], Stage("isotropic_strain", "P11", 1e-2))
