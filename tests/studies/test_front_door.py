"""What the front door answers by name, and tables and figures of every result."""

from collections import Counter

import matplotlib.figure
import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes

import grainloops as gl
from loops import (
    branch_vectors,
    contact_forces,
    direction_tensors,
    lazy,
    love_weber_stress,
    mean_tensor,
)
from loops.shown import Shown
from patterns.snapshots.walls import box_area
from studies.snapshot.sample import BLOCKS, axis_errors
from studies.snapshot.summary import axes_density
from tests.packings import LAW
from tests.stability.packing.walled_packings import small_sample


@pytest.fixture(scope="module")
def snapshot():
    return gl.read_snapshot(gl.sample_path())


def drawn(result, **how):
    return result.plot(ax=matplotlib.figure.Figure().add_subplot(**how))


@pytest.mark.parametrize("ends", ["cell", "walls", "outline"])
def test_stress_of_the_whole_sample(ends):
    """Love-Weber of all contacts; between walls it is the force of a wall over its length."""
    sample = small_sample(ends, LAW)
    found = gl.stress(sample)
    graph, walls = sample.graph, sample.walls
    if walls is None:
        np.testing.assert_allclose(found.tensor, love_weber_stress(graph, found.volume), rtol=1e-13)
        assert found.walls is None and found.wall_share == 0.0
    else:
        assert found.volume == box_area(graph.x, walls)
        side = np.linalg.norm(walls.branch, axis=1)
        right = walls.branch[:, 0] < -0.9 * side
        height = found.volume / np.ptp(graph.x[walls.grain, 0] - walls.branch[:, 0])
        np.testing.assert_allclose(found.tensor[0, 0], -walls.force[right, 0].sum() / height, 1e-6)
    principal = np.linalg.eigvalsh(0.5 * (found.tensor + found.tensor.T))
    np.testing.assert_allclose((found.p - found.q, found.p + found.q), principal, rtol=1e-12)
    assert "force/length" in repr(found)
    (row,) = found.table().to_dict("records")
    assert row["q_over_p"] == found.q_over_p and row["S22"] == found.tensor[1, 1]


def test_the_error_of_a_stress_is_that_of_independent_blocks():
    """A lattice of equal contacts with random forces: the block's jackknife finds their scatter."""
    rng, n = np.random.default_rng(3), 48
    at = np.stack(np.meshgrid(np.arange(n), np.arange(n), indexing="ij"), axis=-1).reshape(-1, 2)
    grain = np.arange(n * n).reshape(n, n)
    right, up = np.roll(grain, -1, axis=0), np.roll(grain, -1, axis=1)
    contacts = np.concatenate([np.stack([grain, other], axis=-1).reshape(-1, 2)
                               for other in (right, up)])  # fmt: skip
    images = (at[contacts[:, 1]] - at[contacts[:, 0]] < -1).astype(np.int64)
    ratios = []
    for _ in range(40):
        force = rng.exponential(size=2 * n * n)
        graph = gl.GrainGraph(at.astype(float), [0.5] * (n * n), contacts, images=images,
                              cell=n * np.eye(2), normal_force=force)  # fmt: skip
        sample = gl.Snapshot(graph, LAW, np.ones(2 * n * n, np.int8), np.arange(n * n), 0, ())
        found = gl.stress(sample)
        # p is half the sum of two means of n^2 forces of standard deviation 1.
        ratios.append(found.p_error / (0.5 * np.sqrt(2.0) / n))
    assert abs(np.mean(ratios) - 1.0) < 0.1 and BLOCKS == 4


def test_the_error_of_a_stress_by_hand():
    """Four by four blocks of a cell, each left out with its sixteenth of the area."""
    sample = small_sample("cell", LAW)
    graph, found = sample.graph, gl.stress(sample)
    d = branch_vectors(graph)
    middle = graph.x[graph.contacts[:, 0]] + 0.5 * d
    column, row = (4 * np.mod(np.linalg.solve(graph.cell, middle.T), 1.0)).astype(int)
    products = contact_forces(graph)[:, :, None] * d[:, None, :]
    values = []
    for block in range(16):
        left = products[4 * column + row != block].sum(axis=0) / (found.volume * 15 / 16)
        minor, major = np.linalg.eigvalsh(0.5 * (left + left.T))
        values.append(
            [0.5 * (major + minor), 0.5 * (major - minor), (major - minor) / left.trace()]
        )
    errors = np.sqrt(15 * np.var(values, axis=0))
    given = found.p_error, found.q_error, found.q_over_p_error
    np.testing.assert_allclose(given, errors, rtol=1e-10)


def test_fabric_tells_contacts_by_force_and_loops_by_order(snapshot):
    found = gl.fabric(snapshot)
    table = found.table().set_index("of")
    count = table["count"]
    assert count["strong contacts"] + count["weak contacts"] == count["contacts"] == 819
    orders = Counter(gl.loop_table(snapshot)["order"].clip(upper=8))
    for order in range(3, 9):
        assert count[f"loops of order {order}{'+' if order == 8 else ''}"] == orders[order]
    np.testing.assert_allclose(table["F11"] + table["F22"], 1.0, rtol=1e-13)
    assert table["anisotropy"]["strong contacts"] > table["anisotropy"]["contacts"]
    areas = snapshot.faces.area[snapshot.faces.loops]
    np.testing.assert_allclose(areas, gl.loop_table(snapshot)["area"], rtol=1e-12)


def test_one_loop_or_none_has_no_error_of_its_fabric():
    """A disc that touches its own images: two contacts, none of them strong, and one loop."""
    own = gl.GrainGraph([[0, 0]], [0.505], [[0, 0]] * 2, normal_force=[0.01] * 2,
                        images=[[1, 0], [0, 1]], cell=np.eye(2))  # fmt: skip
    found = gl.fabric(gl.Scene(own, gl.LinearFrictional(1.0, 0.4, 0.5)))
    error = dict(zip(found.of.tolist(), found.anisotropy_error.tolist(), strict=True))
    assert error["contacts"] == pytest.approx(np.sqrt(0.5), rel=1e-15)
    assert np.isnan([error[of] for of in ("strong contacts", "loops", "loops of order 4")]).all()


def test_errors_of_the_fabric_are_those_of_repeated_samples():
    rng = np.random.default_rng(7)
    found, said = [], []
    for _ in range(300):
        angle = rng.vonmises(0.0, 0.4, 400) / 2 + np.pi * rng.integers(2, size=400)
        tensors = direction_tensors(np.stack([np.cos(angle), np.sin(angle)], axis=-1))
        mean = mean_tensor(tensors).mean
        found.append(mean[0, 0] - mean[1, 1])
        said.append(axis_errors(tensors, None, 0.0)[0])
    assert np.mean(said) == pytest.approx(np.std(found), rel=0.12)


@pytest.mark.parametrize("of", ["contacts", "branches", "loops"])
def test_a_rose_has_the_density_of_its_axes(snapshot, of):
    ax = gl.plot.rose(snapshot, of, ax=matplotlib.figure.Figure().add_subplot(projection="polar"))
    bars = [bar for bar in ax.patches if bar.get_height() > 0]
    assert sum(bar.get_height() * bar.get_width() for bar in bars) == pytest.approx(1.0)
    found = axes_density(np.array([0.0, 4.9, 90.0, -90.0]), 10.0, np.ones(4))
    density, error = found["density"], found["error"]
    assert density[0] == density[9] and error[0] == pytest.approx(density[0] / 2**0.5)
    with pytest.raises(gl.InputError, match="polar"):
        gl.plot.rose(snapshot, ax=matplotlib.figure.Figure().add_subplot())
    assert found["angle"][9] == pytest.approx(90.0)


def test_check_is_that_of_the_command(snapshot):
    found = gl.check(snapshot)
    table = found.table()
    assert found.verdict == "ok" and table["check"].iloc[-1] == "crossings"
    tables = snapshot.tables()
    tables["contacts"] = tables["contacts"] | {"fx_on_2": -tables["contacts"]["fx_on_2"]}
    wrong = gl.check(gl.snapshot_from_tables(**tables, strict=False))
    assert wrong.verdict != "ok" and (wrong.table()["severity"] != "ok").any()


def test_every_question_takes_a_loop_of_a_snapshot(snapshot):
    one = gl.loop(snapshot, 230)
    stage = gl.Stage("drained_biaxial", "H11", 1e-5)
    path = gl.follow(one, stage, closure="traction")
    assert len(path.table()) == len(path) and isinstance(drawn(path), Axes)
    rates = gl.rates_at(one, "drained_biaxial", closure="traction")
    (row,) = rates.table().to_dict("records")
    assert row["status"] == rates.status and row["H11"] == rates.strain_rate[0, 0]
    for result in (one, gl.traction_tangent(one.graph, one.law), snapshot):
        assert isinstance(drawn(result), Axes)
    envelope = gl.plot.envelope(one, closure="traction", ax=matplotlib.figure.Figure().subplots())
    assert len(envelope.lines) >= 3


@pytest.mark.parametrize("ends", ["cell", "walls", "outline"])
def test_a_scene_answers_as_its_snapshot(ends):
    sample = small_sample(ends, LAW)
    asked = (gl.loop_table, lambda one: gl.stress(one).table(), lambda one: gl.fabric(one).table())
    for ask in (*asked, lambda one: gl.loop_table(one, in_packing=True)):
        frame, other = ask(sample), ask(sample.scene)
        pd.testing.assert_frame_equal(frame, other, check_exact=True)
    assert gl.check(sample.scene).verdict == "ok"
    one, same = gl.loop(sample, 1), gl.loop(sample.scene, 1)
    np.testing.assert_array_equal(one.graph.x, same.graph.x)
    with pytest.raises(gl.InputError, match=r"got a graph without its law, expected a Scene"):
        gl.fabric(sample.graph)


def test_tables_of_results(snapshot):
    tangent = gl.loop_tangents(snapshot.graph, snapshot.law, snapshot.faces, "traction")
    cones = gl.plane_cone(gl.restrict(tangent, "diagonal"))
    assert len(cones.table()) == 309 and {"opening", "edges_0"} <= set(cones.table())
    one = gl.loop(snapshot, 230)
    verdict = gl.judge(gl.traction_tangent(one.graph, one.law), "symmetric", kn=snapshot.mean_kn)
    assert verdict.table()["over_kn"].item() == verdict.over_kn
    with pytest.raises(gl.InputError, match=r"Verdict.*a result with a figure"):
        verdict.plot()


def test_without_the_front_door_a_table_says_what_is_missing(monkeypatch, snapshot):
    monkeypatch.setattr(lazy, "SERVED", lazy.SERVED.copy())
    for name in ("table", "plot"):
        assert name in lazy.SERVED
    monkeypatch.setattr("loops.shown.SERVED", {})
    with pytest.raises(gl.InputError, match="import grainloops"):
        Shown.table(snapshot)


def test_evolution_is_drawn_with_its_errors(tmp_path):
    columns = {"shear_strain": [0.0, 1.0], "q_over_p": [0.1, 0.3], "q_over_p_error": [0.01, 0.02]}
    table = pd.DataFrame(columns)
    table.to_parquet(tmp_path / "evolution.parquet")
    for given in (table, tmp_path, tmp_path / "evolution.parquet"):
        ax = gl.plot.evolution(given, ax=matplotlib.figure.Figure().subplots())
        np.testing.assert_array_equal(ax.lines[0].get_ydata(), [0.1, 0.3])
        assert ax.get_ylabel() == "$q/p$ (–)" and len(ax.collections) == 1
    with pytest.raises(gl.InputError, match="one of the table evolution"):
        gl.plot.evolution(table, "nothing")
    with pytest.raises(gl.InputError, match="a file that is there"):
        gl.plot.evolution(tmp_path / "none")


@pytest.mark.parametrize("degrees", [0.0, 12.0, 89.0])
def test_friction_by_its_angle(degrees):
    phi, mu = np.radians(degrees), np.tan(np.radians(degrees))
    laws = (
        (gl.LinearFrictional, {"kn": 1.0, "kt": 0.2}),
        (gl.HertzMindlin, {"young": 1.0, "poisson": 0.2}),
        (gl.CohesiveFrictional, {"kn": 1.0, "kt": 0.2, "adhesion": 0.1}),
    )
    for law, parameters in laws:
        assert law(**parameters, phi=phi).mu == law(**parameters, mu=mu).mu == mu
    with pytest.raises(gl.InputError, match=r"phi of .*np\.radians\(30\)"):
        gl.LinearFrictional(1.0, 0.2, phi=30.0)
    with pytest.raises(gl.InputError, match="mu, phi: got both"):
        gl.LinearFrictional(1.0, 0.2, 0.5, phi=phi)


def test_a_snapshot_takes_the_angle_of_friction():
    path = gl.sample_path("lammps/dump.atoms.0.gz")
    spring = {"kn": 1e6, "kt": 5e5}
    by_angle = gl.read_snapshot(path, **spring, phi=np.arctan(0.5))
    np.testing.assert_allclose(by_angle.law.mu, gl.read_snapshot(path, **spring, mu=0.5).law.mu)
    with pytest.raises(gl.InputError, match="mu, phi: got both"):
        gl.read_snapshot(path, **spring, mu=0.5, phi=0.1)


def test_a_loop_scene_or_snapshot_stands_for_its_graph_and_law(snapshot):
    """To the bit what its graph and law give."""
    loop, way = gl.loop(snapshot, 62), [[1.0, 0.0], [0.6, 0.8]]
    scene = gl.Scene(loop.graph, loop.law)
    for tangent in (gl.affine_tangent, gl.traction_tangent):
        known = tangent(loop.graph, loop.law, spins="affine").matrix
        for one in (loop, scene):
            assert np.array_equal(tangent(one, spins="affine").matrix, known)
        other = gl.LinearFrictional(1.0, 0.3, 0.5)
        assert np.array_equal(tangent(loop, other).matrix, tangent(loop.graph, other).matrix)
    known = gl.directional_work(loop.graph, loop.law, way, closure="traction").work
    given = gl.directional_work(loop, directions=way, closure="traction").work
    assert np.array_equal(given, known)
    whole = gl.loop_tangents(snapshot.graph, snapshot.law, snapshot.faces, "traction").matrix
    assert np.array_equal(gl.loop_tangents(snapshot, closure="traction").matrix, whole)
    assert np.array_equal(gl.love_weber_stress(loop), gl.love_weber_stress(loop.graph))
    assert np.array_equal(gl.contact_state(snapshot).n, gl.contact_state(snapshot.graph).n)
    assert np.array_equal(gl.find_faces(snapshot).area, snapshot.faces.area)
    chains = gl.force_chains(snapshot.graph).chain
    assert np.array_equal(gl.force_chains(snapshot).chain, chains)
    assert gl.to_networkx(loop).number_of_edges() == loop.graph.contact_count


@pytest.mark.parametrize(
    ("question", "said"),
    [
        (lambda one: gl.traction_tangent(one.graph), "contact law: got none, expected a law"),
        (lambda one: gl.traction_tangent("loop"), "first argument: got str, expected a graph"),
        (lambda one: gl.directional_work(one, [[1.0, 0.0]], closure="affine"), "law: got list"),
        (lambda one: gl.directional_work(one, closure="affine"), "directions: got shape"),
        (lambda one: gl.judge(one), r"operator: got SnapshotLoop.*gl\.traction_tangent\(loop\)"),
        (lambda one: gl.plot.cone(one), "operator: got SnapshotLoop"),
        (
            lambda one: gl.follow(one, "drained_biaxial"),
            r"stages: got 'drained_biaxial'.*gl\.Stage",
        ),
        (lambda one: gl.find_faces(62), "first argument: got int"),
        (lambda one: gl.stress("grains.csv"), r"got str.*gl\.read_snapshot\(path\)"),
        (lambda one: gl.follow(one.graph, gl.Stage("biaxial", "H11", 0.1)), "a graph without"),
        (lambda one: gl.rates_at(one.graph, "biaxial"), r"got a graph without.*Scene\(graph, law"),
    ],
)
def test_what_is_no_loop_or_lacks_its_law_is_told(snapshot, question, said):
    with pytest.raises(gl.InputError, match=said):
        question(gl.loop(snapshot, 62))


def test_a_map_takes_a_column_by_its_name(snapshot):
    table = gl.loop_table(snapshot)
    for given in ("area", table["area"]):
        ax = gl.plot.map(snapshot, given, ax=matplotlib.figure.Figure().add_subplot())
        np.testing.assert_array_equal(ax.collections[0].get_array(), table["area"])
    with pytest.raises(gl.InputError, match=r"values: got 'arae'.*column of gl\.loop_table"):
        gl.plot.map(snapshot, "arae")


def test_a_law_of_ones_own_says_what_it_lacks():
    class Own(gl.FrictionalLaw):
        def closed_force(self, state):
            return self.k * state.overlap

    ring = gl.regular_polygon(5, strain=0.02)
    with pytest.raises(NotImplementedError, match=r"Own\.stiffnesses: give the law kt="):
        gl.traction_tangent(ring, Own(k=1.0))
    with pytest.raises(NotImplementedError, match=r"FrictionalLaw\.closed_force: write this"):
        gl.FrictionalLaw(kt=1.0).normal_force(gl.contact_state(ring))


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_errors_of_an_axis_are_those_of_its_parts(turn):
    """Of weighted axes: along the mean direction and across it, whatever the frame."""
    rng = np.random.default_rng(5)
    axes, weights = rng.normal(0.0, 0.6, 400) + 0.3, rng.random(400)
    tensors = direction_tensors(np.stack([np.cos(axes + turn), np.sin(axes + turn)], axis=-1))
    share = weights / weights.sum()
    mean = share @ np.exp(2j * axes)
    relative = np.exp(2j * axes) * np.exp(-1j * np.angle(mean)) - abs(mean)
    along, across = axis_errors(tensors, weights, 0.5 * float(np.angle(mean)) + turn)
    assert along == pytest.approx(np.linalg.norm(share * relative.real), rel=1e-12)
    assert across == pytest.approx(np.linalg.norm(share * relative.imag), rel=1e-12)
    assert abs(along - across) > 0.1 * along


@pytest.mark.parametrize("grains", [1, 3])
def test_a_sample_without_loops_cell_and_walls_has_no_stress(grains):
    """A chain of grains fills no area."""
    x = 0.99 * np.arange(grains)[:, None] * [1.0, 0.0]
    pairs, N = np.arange(grains - 1)[:, None] + [0, 1], np.full(grains - 1, 0.01)
    chain = gl.GrainGraph(x, [0.5] * grains, pairs.reshape(-1, 2), N, 0.0 * N)
    with pytest.raises(gl.InputError, match="no cell, no box of walls and no loops"):
        gl.stress(gl.Scene(chain, gl.LinearFrictional(1.0, 0.5)))
