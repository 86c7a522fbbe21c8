"""`grainloops evolve` along a cycle: where it turns, what comes back, and what is refused."""

import numpy as np
import pytest

import grainloops as gl
from loops import InputError
from patterns import planar
from studies.frames import row_table
from studies.packing_figures import loops_that_come_back
from tests.packings import LAW, jammed

TURNS = (2e-5, -1e-5, 1e-5)


@pytest.fixture(scope="module")
def packing():
    return gl.Scene(jammed(16, 2), LAW)


@pytest.fixture(scope="module")
def cycle(packing):
    return gl.evolve(packing, "drained", to=TURNS, rows=4, axis=1)


def test_the_driven_strain_turns_where_it_is_asked(cycle):
    way = cycle.way
    assert way.status == "finished" and way.turns == TURNS
    table = way.table()
    # The nominal strain that the programme drives; targets are reached to a millionth of an
    # interval of 5e-6.
    np.testing.assert_allclose(table["driven"], table["H11"], rtol=0.0, atol=1e-15)
    ends = table["driven"].to_numpy()[np.flatnonzero(np.diff(way.stage, append=9))]
    np.testing.assert_allclose(ends, TURNS, rtol=0.0, atol=2e-11)
    assert len(table) == 1 + 3 * 4


def test_the_way_to_the_first_turn_is_that_without_a_cycle(packing, cycle):
    alone = gl.evolve(packing, "drained", to=TURNS[0], rows=4, axis=1)
    np.testing.assert_array_equal(cycle.way.P[:5], alone.way.P)
    np.testing.assert_array_equal(cycle.way.H[:5], alone.way.H)


def test_work_of_a_cycle_is_stored_or_spent():
    """A sample of Yade between walls, 1e-5 to and fro: its contacts slide, unload, slide again."""
    names = ("grains_biaxial.csv.gz", "contacts_biaxial.csv.gz")
    cycle = gl.evolve(gl.read_snapshot(*map(gl.sample_path, names)), to=(1e-5, 0.0), rows=1)
    path = cycle.way.table()
    spent = path[["slip_work", "shear_work", "released"]].sum(axis=1)
    stored = path["energy"] - path["energy"][0]
    scale = path["slip_work"].iloc[-1]
    np.testing.assert_allclose(path["work"] - spent, stored, rtol=0.0, atol=1e-9 * scale)
    assert (np.diff(path["slip_work"]) > 0).all()
    # Contacts that slid before the turn stick after it.
    kinds = {(event.stage, event.kind) for event in cycle.way.events}
    assert {(0, "yield"), (1, "unloading")} <= kinds


def test_an_elastic_cycle_comes_back(packing):
    """A lattice whose contacts stay far inside their cones returns to its stress and loops."""
    lattice = gl.GrainGraph(
        x=[[0, 0], [1, 0], [0, 1], [1, 1]], radii=[0.5005] * 4,
        contacts=[[0, 1], [1, 0], [2, 3], [3, 2], [0, 2], [2, 0], [1, 3], [3, 1]],
        images=[[0, 0], [1, 0], [0, 0], [1, 0], [0, 0], [0, 1], [0, 0], [0, 1]],
        cell=2 * np.eye(2), normal_force=np.full(8, 0.001),
    )  # fmt: skip
    scene = gl.Scene(lattice, gl.LinearFrictional(1.0, 0.5, 0.5))
    cycle = gl.evolve(scene, "oedometric", to=(1e-4, -1e-4, 0.0), rows=1)
    np.testing.assert_allclose(cycle.way.P[-1], cycle.way.P[0], rtol=0.0, atol=1e-14)
    loops = cycle.table()
    assert loops["open_from"].isna().all() and not loops["back"].any()


def test_loops_that_open_and_close_again_come_back():
    """Pulled beyond its overlap of 1e-3 a lattice opens, and closes on the way back."""
    lattice = gl.GrainGraph(
        x=[[0, 0], [1, 0], [0, 1], [1, 1]], radii=[0.50005] * 4,
        contacts=[[0, 1], [1, 0], [2, 3], [3, 2], [0, 2], [2, 0], [1, 3], [3, 1]],
        images=[[0, 0], [1, 0], [0, 0], [1, 0], [0, 0], [0, 1], [0, 0], [0, 1]],
        cell=2 * np.eye(2), normal_force=np.full(8, 0.0001),
    )  # fmt: skip
    scene = gl.Scene(lattice, gl.LinearFrictional(1.0, 0.5, 0.5))
    cycle = gl.evolve(scene, "oedometric", to=(-2e-4, 0.0), rows=4, axis=1)
    loops = cycle.table()
    assert loops["back"].all()
    # Contacts along axis 1 open at an extension of 1e-4; rows are 5e-5 apart.
    assert loops["open_from"].to_numpy() == pytest.approx(-1.0e-4, abs=5.1e-5)
    # The figure has all of them, open from the second row on until the way back.
    tables = {"loops": loops, "path": row_table(cycle.way)}
    figure = loops_that_come_back(planar(scene), cycle, tables)
    share = figure.axes[1].lines[0].get_ydata()
    assert {*share} == {0.0, 100.0} and share[0] == share[-1] == 0.0
    kinds = [text.get_text() for text in figure.axes[2].get_yticklabels()]
    assert kinds == [
        "closed\nthroughout: 0",
        f"opened,\nclosed again: {len(loops)}",
        "open\nat the end: 0",
    ]


@pytest.mark.parametrize(
    ("to", "options", "said"),
    [
        ((1e-5, 0.0), {"by": "both"}, "one value"),
        ((1e-5, 1e-5), {}, "other than zero"),
        ((1e-5, float("nan")), {}, "--to"),
        ((0.05, -0.06), {}, "at most 0.1"),
    ],
)
def test_cycles_that_are_refused(packing, to, options, said):
    with pytest.raises(InputError, match=said):
        gl.evolve(packing, "drained", to=to, **options)


def test_a_forecast_takes_one_value(packing):
    with pytest.raises(InputError, match="--to"):
        gl.forecast(packing, "drained", to=(1e-5, -1e-5))


def test_a_path_of_several_stages_has_its_loading_parameter_as_driven(packing):
    """`gl.follow` with stages of its own, which drive different components."""
    stages = [gl.Stage("drained", "parameter", 1e-5), gl.Stage("oedometric", "parameter", 5e-6)]
    path = gl.follow(packing, stages, rows=2)
    table = path.table()
    assert path.status == "finished" and len(table) == 5
    np.testing.assert_array_equal(table["driven"], path.parameter)
    assert table["driven"].iloc[-1] == pytest.approx(1.5e-5, abs=1e-10)
