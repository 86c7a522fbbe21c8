"""Even loops of unequal grains with free spins: grains nearly roll on one another as gears do."""

import numpy as np
import pytest

import grainloops as gl

pytest.importorskip("flint")

from tests.oracles.loop_balls import ball_tangent

KT, MU = 0.3, 0.5
LAW = gl.LinearFrictional(1.0, KT, MU)
RADII = 0.5 * np.array([1.0, 0.8, 1.2, 0.9, 1.0, 1.1])


def ring(strain, shear=0.0, radii=RADII):
    graph = gl.polydisperse_polygon(radii, strain=strain)
    share = np.array([0.3, -0.8, 0.1, 0.6, -0.2, 0.4])
    return graph.replace(shear_force=shear * share * graph.normal_force)


@pytest.mark.parametrize("closure", ["affine", "traction"])
@pytest.mark.parametrize("strain", [2e-2, 1e-4, 1e-6])
@pytest.mark.parametrize("shear", [0.0, 0.4])
def test_the_tangent_of_a_path_is_the_exact_one(strain, shear, closure):
    """Depths beneath the contacts are rounded as lengths are, by 1e-16 / strain of themselves.

    The slip of the gear mode is a hundredth of their difference at most.
    """
    graph = ring(strain, shear)
    stage = gl.Stage("isotropic_strain", "H11", 1.000001 * strain)
    path = gl.follow(gl.Scene(graph, LAW), stage, closure=closure, spins="free")
    blocks = LAW.local_stiffness(gl.contact_state(graph), np.ones(6))
    wanted, _ = ball_tangent(graph, blocks, False, closure, "free")
    error = np.abs(path.A[0] - wanted).max() / np.abs(wanted).max()
    assert error < 1e-13 / strain


@pytest.mark.parametrize("shear", [0.0, 0.4])
def test_a_drained_path_takes_few_steps(shear):
    """Rates without noise: the integrator takes its longest steps."""
    stage = gl.Stage("drained_biaxial", "H11", 0.05)
    scene = gl.Scene(ring(0.02, shear), LAW)
    path = gl.follow(scene, stage, closure="traction", spins="free", max_steps=100)
    assert path.status == "finished" and len(path) < 50


def test_a_path_from_the_first_touch_leaves_the_gear_mode():
    """There it has no stiffness at all; the path begins at a strain of 1e-6."""
    stages = [gl.Stage("isotropic_strain", "H11", 0.02), gl.Stage("drained_biaxial", "H11", 0.03)]
    path = gl.follow(
        gl.Scene(ring(0.0), LAW), stages, closure="traction", spins="free", max_steps=150
    )
    assert path.status == "finished" and path.H[0, 0] == pytest.approx(1e-6)
    assert np.abs(path.energy_error).max() < 1e-5
    row = path.of_kind("programme_change")[0].index
    here = gl.traction_tangent(graph_of(path, row), LAW, spins="free")
    assert float(here.error) < 1e-5
    np.testing.assert_allclose(path.A[row], here.matrix, rtol=0, atol=float(here.error))


@pytest.mark.parametrize("order", [3, 5])
def test_a_moment_that_nothing_balances_is_no_motion(order):
    """Spins of a chain roll along; the friction of its sliding end turns them, and they don't rest.

    Only where all contacts stick is there a motion.
    """
    graph = gl.regular_polygon(order, strain=0.02)
    graph = graph.replace(shear_force=MU * graph.normal_force * (np.arange(order) == 0))
    scene, seen = gl.Scene(graph, LAW), set()
    for angle in np.radians(np.arange(0, 360, 20) + 3):
        e = np.array([np.cos(angle), np.sin(angle)])
        rates = np.array([e[0], 0, 0, e[1]])
        control = gl.programmes.combination(np.zeros((4, 4)), np.eye(4), rates)
        found = gl.rates_at(scene, control, closure="traction", spins="free")
        work = gl.directional_work(graph, LAW, e[None], closure="traction", spins="free")
        seen.add(found.status)
        assert work.status[0] == found.status
        assert all((one.rates.mode.regime != gl.Regime.SLIDING).all() for one in found.solutions)
    assert seen == {"unique", "none"}


def graph_of(path, row):
    """The loop of a row, with the forces it has there."""
    start = ring(0.0)
    forces = {"normal_force": path.normal_force[row], "shear_force": path.shear_force[row]}
    return start.replace(x=path.x[row], **forces)


@pytest.mark.parametrize("number", [5, 43])
def test_even_loops_of_a_snapshot_are_followed_from_the_tangent_of_their_closure(number):
    """Shear by the radii: spins that roll everywhere feel nothing, and no moments act on them."""
    loop = gl.loop(gl.read_snapshot(gl.sample_path()), number)
    assert loop.graph.grain_count % 2 == 0 and loop.law.shear_increment == "radii"
    stage = gl.Stage("drained_biaxial", "H11", 1e-5)
    path = gl.follow(loop, stage, closure="traction", spins="free")
    wanted = gl.traction_tangent(loop, spins="free").matrix
    assert path.status == "finished"
    np.testing.assert_allclose(path.A[0], wanted, rtol=0, atol=1e-10 * np.abs(wanted).max())
