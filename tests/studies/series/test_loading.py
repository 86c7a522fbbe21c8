"""How a sample was loaded between two snapshots: words, tables over time, what cannot be."""

from functools import partial

import numpy as np
import pytest

from grainloops import replay
from loops import InputError, Scene
from patterns import Snapshot
from stability import Stage, follow
from stability.programmes import nominal
from studies.series import packing as series_packing
from studies.series.evolution import track_loops
from studies.series.packing import (
    STRESS_ERROR,
    Following,
    StrainTable,
    in_parts,
    loading_between,
    packing_predictions,
    read_strains,
)
from tests.packings import LAW, jammed
from tests.studies.series.test_packing import PATHS, predict

H = np.array([[2e-3, 3e-4], [0.0, -1e-3]])
QUIET = {"damping": 0.5, "duration": 2000.0, "mass": np.ones(16)}


def at(graph, **how):
    regime, ids = np.ones(graph.contact_count, dtype=np.int8), np.arange(graph.grain_count)
    return Snapshot(graph, LAW, regime, ids, 0, (), mass=np.ones(len(ids)), **how)


def after(end, **how):
    """A later snapshot, with the contacts that carry."""
    kept = end.normal_force > 0
    graph = jammed(16, 2).replace(
        x=end.x, x0=None, contacts=end.contacts[kept], images=end.images[kept], cell=end.cell,
        cell0=None, normal_force=end.normal_force[kept], shear_force=end.shear_force[kept],
    )  # fmt: skip
    return at(graph, **how)


def table(time, F):
    return StrainTable("way.csv", np.array(time, dtype=float), np.array(F))


@pytest.fixture(scope="module")
def pressed():
    """A packing pressed along axis 2 beyond its strain and let back, as a table tells."""
    ends = np.array([np.diag([0.0, 3e-2]), np.diag([0.0, 1e-2])])
    found = replay(Scene(jammed(16, 2), LAW), ends, shares=[0.6, 1.0], **QUIET)
    way = table([0, 1e3, 2.2e3, 3e3, 4e3], np.eye(2) - np.array([0 * H, 0 * H, *ends, ends[1]]))
    return at(jammed(16, 2)), after(found.state), way


def test_words_reach_the_strain_on_their_ways():
    graph = jammed(16, 2)
    one, two = at(graph), at(graph.replace(normal_force=1.1 * graph.normal_force))
    straight = loading_between(one, two, H, "straight")
    np.testing.assert_array_equal(straight.strain, H)
    np.testing.assert_array_equal(straight.stages[0].programme.rate, H.ravel())
    assert straight.size == np.linalg.norm(H) and straight.shares is None
    for axis in (1, 2):
        parts = loading_between(one, two, H, f"{axis}-first")
        first = np.zeros((2, 2))
        first[axis - 1, axis - 1] = H[axis - 1, axis - 1]
        np.testing.assert_array_equal(parts.strain, [first, H])
        ways = np.linalg.norm(first), np.linalg.norm(H - first)
        assert parts.size == pytest.approx(sum(ways))
        # The interval begins with the first part, at the one speed of both.
        np.testing.assert_allclose(parts.start, first * sum(ways) / ways[0])
        rates = [stage.programme.rate for stage in parts.stages]
        np.testing.assert_allclose(rates, [first.ravel(), (H - first).ravel()])


@pytest.mark.parametrize("along", [1, 2])
def test_mixed_control_ends_at_the_strain_along_and_the_stress_across(along):
    """The later state of a replay is reached from its strain along and its stress across alone."""
    found = replay(Scene(jammed(16, 2), LAW), H, **QUIET)
    one, two = at(jammed(16, 2)), after(found.state)
    loading = loading_between(one, two, H, f"mixed-{along}")
    assert isinstance(loading.strain, Stage) and loading.stages == [loading.strain]
    end = replay(Scene(jammed(16, 2), LAW), loading.strain, **QUIET).state
    k = 2 - along
    np.testing.assert_allclose(np.delete(end.strain, 3 * k), np.delete(H, 3 * k), atol=1e-8)
    told, own = (nominal(state.stress, H) for state in (end, found.state))
    size = np.abs(own).max()
    assert told[k, k] == pytest.approx(own[k, k], abs=1e-5 * size)
    # Of a state that is nearly the straight one the strain across comes out.
    assert end.strain[k, k] == pytest.approx(H[k, k], rel=0.05)


def test_a_table_of_strains_is_the_way_that_the_sample_went(pressed):
    """Beyond and back: straight ends elsewhere, the table at the later state itself."""
    before, later, way = pressed
    strain = np.diag([0.0, 1e-2])
    loading = loading_between(before, later, strain, "way.csv", way, (1e3, 3e3))
    np.testing.assert_allclose(loading.strain, [np.diag([0, 3e-2]), strain], rtol=0, atol=1e-15)
    np.testing.assert_allclose(loading.shares, [0.6, 1.0])
    np.testing.assert_allclose(loading.start, np.diag([0.0, 5e-2]))
    assert loading.size == pytest.approx(5e-2)
    size = np.abs(later.graph.normal_force).max()
    forces = {}
    for name, (H, shares) in {"table": loading[:2], "straight": (strain, None)}.items():
        end = replay(Scene(before.graph, LAW), H, shares=shares, **QUIET).state
        forces[name] = after(end).graph
    np.testing.assert_allclose(forces["table"].normal_force, later.graph.normal_force, atol=1e-12)
    other = forces["straight"]
    assert (
        other.contact_count != later.graph.contact_count
        or np.abs(other.normal_force - later.graph.normal_force).max() > 1e-2 * size
    )


def test_series_predict_on_the_way_that_is_given(pressed, monkeypatch):
    """Path and replay; the error of the stress tells which way was wrong."""
    # The path is coarse: 100 intervals for the way.
    monkeypatch.setattr(series_packing, "follow", partial(follow, interval=5e-4))
    before, later, way = pressed
    fates = track_loops(before, later)
    told = {}
    for name, history in (("straight", None), ("way.csv", way)):
        asked = Following(damping=0.5, programme=name, table=history)
        _, row, _ = packing_predictions(before, later, fates, 0.99, asked, (1e3, 3e3))
        told[name] = row
    assert told["way.csv"]["replay_stress_error"] < 1e-9
    assert told["straight"]["replay_stress_error"] > STRESS_ERROR
    assert told["way.csv"]["path_from_replay"] < 0.1
    assert told["way.csv"]["replay_inertial_number"] == pytest.approx(
        5 * told["straight"]["replay_inertial_number"]
    )


def test_rows_between_the_snapshots_count_and_the_ends_are_theirs():
    """Interpolated between rows, measured from the earlier snapshot; what is left is spread."""
    gradient = np.array([[1e-3, 2e-4], [0.0, -2e-3]])
    way = table([0, 2, 3, 7], [np.eye(2) - t * gradient for t in (0, 2, 3, 7)])
    ends, shares = way.between(1.0, 5.0)
    np.testing.assert_allclose(shares, [0.25, 0.5, 1.0])
    F = [np.eye(2) - t * gradient for t in (1, 2, 3, 5)]
    wanted = np.eye(2) - np.array(F[1:]) @ np.linalg.inv(F[0])
    np.testing.assert_allclose(ends, wanted, rtol=0, atol=1e-15)
    more = 1.01 * wanted[-1]
    loading = loading_between(None, None, more, "way.csv", way, (1.0, 5.0))
    np.testing.assert_allclose(loading.strain[-1], more, rtol=1e-12)
    np.testing.assert_allclose(loading.strain[0], wanted[0] + 0.25 * 0.01 * wanted[-1], rtol=1e-9)
    for wrong, said in (
        ((1.0, 5.0, 2.0 * wanted[-1]), "of the snapshots"),
        ((1.0, 9.0, more), "times from 0 to 7, expected those of the snapshots, 1 to 9"),
        ((-1.0, 5.0, more), "times from 0 to 7"),
        ((None, 5.0, more), "no times"),
    ):
        with pytest.raises(InputError, match=said):
            loading_between(None, None, wrong[2], "way.csv", way, wrong[:2])


def test_parts_that_stand_still_take_time_and_no_stage():
    ends = np.array([0 * H, H, H])
    loading = in_parts(ends, np.array([0.2, 0.7, 1.0]))
    assert len(loading.stages) == 1 and len(loading.strain) == 3
    np.testing.assert_array_equal(loading.start, 0 * H)
    assert len(in_parts(ends, None).strain) == 1
    with pytest.raises(InputError, match="rate that is not zero"):
        in_parts(0 * ends, None)


def test_tables_of_cells_and_of_strains_are_read(tmp_path):
    """Cells may be flipped by a lattice vector; strains are those from any first state."""
    way = tmp_path / "way.csv"
    way.write_text("time,h_xx,h_xy,h_yx,h_yy\n0,2,0.9,0,1\n1,2,1.0,0,1\n2,2,-0.9,0,1\n")
    found = read_strains(way)
    np.testing.assert_allclose(found.F[:, 0, 1], [0.0, 0.1, 0.2], atol=1e-12)
    way.write_text("time,H11,H22\n0,0.1,0\n1,0.1,0.01\n")
    np.testing.assert_allclose(read_strains(way).between(0, 1)[0], [np.diag([0, 0.01])], atol=1e-15)
    for text, said in (
        ("time,H11,H22\n0,0.1,0\n0,0.1,0.01\n", "growing times"),
        ("time,H11,H22\n0,0.1,0\n", "growing times"),
        ("time,H11\n0,0.1\n1,0.2\n", "H22"),
        ("snap,H11,H22\n0,0.1,0\n1,0,0\n", "time"),
        ("time,H11,H22\n0,0.1,0\n1,2,0\n", "no area left"),
    ):
        way.write_text(text)
        with pytest.raises(InputError, match=said):
            read_strains(way)
    with pytest.raises(InputError, match=r"'no\.csv', expected straight, 1-first"):
        read_strains(tmp_path.relative_to(tmp_path) / "no.csv")


def test_another_table_is_another_way():
    """Parts of a series are made again where the table has changed, whatever its name."""
    one, two = (table([0, 1], [np.eye(2), np.eye(2) - share * H]) for share in (1.0, 2.0))
    assert repr(one) == repr(table(one.time, one.F)) != repr(two)
    assert "way.csv" not in repr(Following(table=one))


def test_options_of_the_way_are_checked_and_kept(tmp_path):
    for how, said in (
        ({"programme": "back"}, r"--programme: got 'back', expected straight"),
        ({"damping": -0.1}, "--damping"),
    ):
        with pytest.raises(InputError, match=said):
            predict(tmp_path / "out", PATHS[:2], in_packing="events", **how)
    for how in ({"programme": "1-first"}, {"damping": 0.2}):
        with pytest.raises(InputError, match="--in-packing: got the rates alone, expected events"):
            predict(tmp_path / "out", PATHS[:2], **how)
    assert not (tmp_path / "out").exists()
