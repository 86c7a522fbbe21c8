"""Statistics of a snapshot against closed forms, exact sums and other codes."""

import csv
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.stats

from loops import GrainGraph, LinearFrictional, Regime, find_faces, love_weber_stress
from patterns import (
    Snapshot,
    WallContacts,
    read_snapshot,
    sample_cell,
    sample_path,
    synthetic_network,
)
from studies.output import definitions
from studies.snapshot.sample import stress
from studies.snapshot.summary import (
    axes_block,
    axes_density,
    share,
    snapshot_summary,
    spread,
    spread_by_group,
)
from studies.snapshot.table import GROUPS, group_rows, loop_columns
from tests.packings import packing_system

PERIODIC = sample_path("grains_periodic.parquet")
MECHANICAL = [
    *("stress", "stress_loops", "mean_kn", "normal_force", "sliding_fraction", "sliding_contacts"),
    *("sliding_by_order", "stress_by_order", "untrusted_loops", "unstable_loops"),
    *("mean_unstable_directions", "unstable_by_order", "unstable_directions", "cone_opening"),
    *("eigenvalues", "soft_loops"),
]
WALLED = ["stress_walls", "stress_total", "boundary_area", "boundary_share", "wall_force"]
BLOCK = {"mean", "std", "median", "q25", "q75", "count"}


def of(snapshot):
    """Summary and table of a snapshot."""
    table = loop_columns(snapshot)
    return snapshot_summary(snapshot, table), table


def from_graph(graph, **more):
    """Snapshot of a network, contacts at Coulomb's bound sliding."""
    sliding = np.abs(graph.shear_force) >= 0.5 * graph.normal_force * (1 - 1e-12)
    return Snapshot(
        graph=graph,
        law=LinearFrictional(kn=np.ones(graph.contact_count), kt=0.5, mu=0.5),
        regime=np.where(sliding, Regime.SLIDING, Regime.ELASTIC).astype(np.int8),
        ids=np.arange(graph.grain_count),
        notes=(),
        **{"wall_contacts": 0} | more,
    )


@pytest.fixture(scope="module")
def sample():
    snapshot = read_snapshot(PERIODIC, cell=sample_cell())
    return snapshot, *of(snapshot)


def test_spread_is_numpys():
    rng = np.random.default_rng(1)
    values = rng.normal(size=101)
    found = spread([*values, np.nan])
    assert set(found) == BLOCK
    assert found["count"] == 101
    assert found["std"] == pytest.approx(values.std(), rel=1e-13)
    quartiles = np.quantile(values, [0.25, 0.5, 0.75])
    np.testing.assert_allclose([found[k] for k in ("q25", "median", "q75")], quartiles, rtol=1e-14)


def test_weights_are_repetitions():
    rng = np.random.default_rng(2)
    values, weights = rng.normal(size=50), rng.integers(1, 5, 50)
    found, repeated = spread(values, weights), np.repeat(values, weights)
    assert found["mean"] == pytest.approx(repeated.mean(), rel=1e-12)
    assert found["std"] == pytest.approx(repeated.std(), rel=1e-12)
    # Quartiles count every value once.
    assert found["median"] == np.median(values)
    assert found["count"] == 50


def test_nothing_to_average():
    for found in (spread([]), spread([np.nan]), spread([1.0], [0.0])):
        assert np.isnan(found["mean"])
        assert set(found) == BLOCK
    assert share(np.zeros(0, dtype=bool))["count"] == 0
    assert np.isnan(axes_block(np.array([np.nan]))["direction"])


def test_the_error_of_a_share_is_that_of_a_binomial():
    found = share(np.array([True, False, False, False, False]))
    assert (found["mean"], found["count"]) == (0.2, 5)
    assert found["std_error"] == pytest.approx(np.sqrt(scipy.stats.binom(5, 0.2).var()) / 5)


def test_groups_hold_every_loop_once():
    order = np.array([3, 4, 4, 5, 8, 9, 40])
    groups = group_rows(order)
    apart = np.concatenate([groups[name] for name in ("3", "4", "5", "8+")])
    assert apart.tolist() == list(range(7))
    found = spread_by_group(groups, order.astype(float))
    assert found["8+"]["mean"] == pytest.approx((8 + 9 + 40) / 3)
    assert found["all"]["count"] == 7


def test_axes_block_is_scipys_circular_statistics():
    angles = np.random.default_rng(3).normal(70.0, 25.0, 300)
    found = axes_block(angles)
    mean = scipy.stats.circmean(angles, high=90, low=-90)
    assert found["direction"] == pytest.approx(mean, abs=1e-9)
    std = scipy.stats.circstd(angles, high=90, low=-90)
    assert found["std"] == pytest.approx(std, abs=1e-9)


def test_density_of_axes_integrates_to_one():
    angles = np.random.default_rng(4).uniform(-180, 180, 1000)
    found = axes_density(angles, 10.0)
    assert 2 * np.sum(found["density"]) * np.radians(10.0) == pytest.approx(1.0)
    assert axes_density(angles + 180.0, 10.0)["count"].tolist() == found["count"].tolist()
    assert axes_density(np.array([4.9, -4.9, 5.1, 175.1]), 10.0)["count"][:2].tolist() == [3, 1]


def test_full_lattice_in_closed_form():
    """70 grains with six contacts each: 140 regular triangles."""
    s, _ = of(from_graph(synthetic_network(70, periodic=True, coordination=6, jitter=0)))
    assert (s["loops"], s["coordination"], s["mean_order"]) == (140, 6.0, 3.0)
    assert s["coordination_all"] == 6.0
    assert s["mean_order_from_coordination"] == 3.0
    assert s["contacts_per_grain"]["std"] == 0.0
    area = 3**0.5 / 4
    assert s["orders_grouped"]["3"]["share"] == s["orders_grouped"]["3"]["area_share"] == 1.0
    assert s["orders_grouped"]["8+"] == {"loops": 0, "area": 0.0, "share": 0.0, "area_share": 0.0}
    assert s["loop_area_by_order"]["3"]["mean"] == pytest.approx(area, rel=1e-12)
    assert s["elongation_by_order"]["all"]["mean"] == pytest.approx(1.0, abs=1e-9)
    assert s["contact_fabric"]["fourier_amplitude"] < 1e-14
    assert s["loop_shape"]["all"]["anisotropy"] < 1e-13
    np.testing.assert_allclose(s["loop_shape"]["3"]["tensor"], np.eye(2) / 2, atol=1e-13)
    # No contact is lost at an outline or dangling: loop stresses make up the sample's.
    np.testing.assert_allclose(s["stress_loops"], s["stress"], rtol=1e-11, atol=1e-15)


def test_loop_stresses_add_up_to_love_weber(sample):
    snapshot, s, table = sample
    faces = find_faces(snapshot.graph)
    graph, dangling = snapshot.graph, np.ones(snapshot.graph.contact_count, dtype=bool)
    dangling[faces.contacts] = False
    zero = {name: np.where(dangling, 0.0, getattr(graph, name)) for name in ("normal_force",)}
    kept = graph.replace(**zero, shear_force=np.where(dangling, 0.0, graph.shear_force))
    expected = love_weber_stress(kept)
    np.testing.assert_allclose(s["stress_loops"], expected, atol=1e-12 * np.abs(expected).max())
    # So do the groups, weighted by their areas.
    by_group = s["stress_by_order"]["tensor"]
    parts = [by_group[g]["mean"] * s["orders_grouped"][g]["area"] for g in GROUPS]
    total = np.sum(parts, axis=0) / s["area"]
    np.testing.assert_allclose(total, expected, atol=1e-12 * np.abs(expected).max())
    pressure = s["stress_by_order"]["pressure"]["all"]["mean"]
    assert pressure == pytest.approx(np.trace(expected) / 2, rel=1e-12)
    assert s["stress_by_order"]["deviator"]["4"]["mean"] == pytest.approx(
        np.average(
            table["deviator"][table["order"] == 4], weights=table["area"][table["order"] == 4]
        ),
        rel=1e-12,
    )


def test_orders_and_coordination(sample):
    _, s, table = sample
    for n, area in s["orders_area"].items():
        assert area == pytest.approx(table["area"][table["order"] == int(n)].sum(), rel=1e-12)
    assert sum(s["orders_area"].values()) == pytest.approx(s["area"], rel=1e-12)
    assert sum(group["loops"] for group in s["orders_grouped"].values()) == s["loops"]
    assert s["contacts_per_grain"]["mean"] == pytest.approx(s["coordination"], rel=1e-14)
    assert s["contacts_per_grain"]["count"] == s["vertices"]
    assert s["order_spread"]["mean"] == pytest.approx(s["mean_order"])


@pytest.mark.parametrize("walled", [True, False])
def test_rattlers_are_those_of_the_stress_and_of_the_packing(sample, walled):
    """Grains with fewer than two contacts, walls counted, removed one by one."""
    snapshot, s = sample[:2]
    if walled:
        snapshot = read_snapshot(sample_path())
        s = of(snapshot)[0]
    ends = snapshot.graph.contacts.tolist()
    ends += [] if snapshot.walls is None else snapshot.walls.grain[:, None].tolist()
    left, before = set(range(s["grains"])), 0
    while len(left) != before:
        before, degree = len(left), np.zeros(s["grains"], dtype=int)
        for pair in ends:
            degree[pair] += left.issuperset(pair)
        left = {grain for grain in left if degree[grain] >= 2}
    assert s["rattlers"] == s["grains"] - len(left) == stress(snapshot).rattlers
    assert packing_system(snapshot.scene).carrying.rattlers == s["rattlers"]
    assert (s["dangling_grains"] > s["rattlers"]) == walled


def test_stability_by_closure_and_order(sample):
    _, s, table = sample
    for closure in ("affine", "traction"):
        unstable = table[f"{closure}_lambda_min"] < 0
        for name, rows in group_rows(table["order"]).items():
            found = s["unstable_by_order"][closure][name]
            p, n = unstable[rows].mean(), len(unstable[rows])
            assert (found["mean"], found["count"]) == (pytest.approx(p), n)
            assert found["std_error"] == pytest.approx((p * (1 - p) / n) ** 0.5)
            middle = s["eigenvalues"][closure]["lambda_mid"][name]["median"]
            assert middle == pytest.approx(np.median(table[f"{closure}_lambda_mid"][rows]))
        opening = table[f"{closure}_cone_opening"]
        assert s["cone_opening"][closure]["all"]["count"] == np.sum(opening > 0)
        soft = s["soft_loops"][closure]
        assert soft["soft_angle"]["count"] == soft["long_axis"]["count"] == unstable.sum()
    assert unstable.sum() == 7
    mean = scipy.stats.circmean(table["traction_soft_angle"][unstable], high=90, low=-90)
    assert soft["soft_angle"]["direction"] == pytest.approx(mean, abs=1e-9)
    assert s["sliding_contacts"]["mean"] == s["sliding_fraction"]
    sliding = table["sliding_contacts"] / table["order"]
    assert s["sliding_by_order"]["all"]["mean"] == pytest.approx(sliding.mean())


def test_a_turned_snapshot_turns_its_statistics(sample):
    snapshot, before, _ = sample
    angle = np.radians(25.0)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    graph = snapshot.graph
    x, cell = graph.x @ turn.T, turn @ graph.cell
    after, _ = of(replace(snapshot, graph=graph.replace(x=x, x0=x, cell=cell, cell0=cell)))
    pairs = [
        (before["contact_fabric"], after["contact_fabric"]),
        (before["contact_fabric_by_length"], after["contact_fabric_by_length"]),
        *((before["loop_shape"][g], after["loop_shape"][g]) for g in ("3", "8+", "all")),
    ]
    for one, other in pairs:
        turned = turn @ one["tensor"] @ turn.T
        np.testing.assert_allclose(other["tensor"], turned, atol=1e-12)
        assert other["anisotropy"] == pytest.approx(one["anisotropy"], abs=1e-12)
        assert apart(other["direction"], one["direction"] + 25.0) < 1e-8
    scale = np.abs(before["stress"]).max()
    for name in ("stress", "stress_loops"):
        turned = turn @ before[name] @ turn.T
        np.testing.assert_allclose(after[name], turned, atol=1e-12 * scale)
    assert after["orders"] == before["orders"]
    # A loop's long axis turns with it; axes of unstable loops are few and well defined.
    for name in ("long_axis", "soft_angle"):
        one, other = (s["soft_loops"]["traction"][name] for s in (before, after))
        assert apart(other["direction"], one["direction"] + 25.0) < 1e-6
        assert other["resultant"] == pytest.approx(one["resultant"], abs=1e-8)
    one, other = before["long_axis"], after["long_axis"]
    assert apart(other["direction"], one["direction"] + 25.0) < 1e-6


def apart(one, other):
    """Angle between two axes, degrees."""
    return abs((one - other + 90.0) % 180.0 - 90.0)


def test_without_forces_the_mechanical_keys_are_absent(sample):
    snapshot, full, _ = sample
    s, table = of(replace(snapshot, law=None, regime=None))
    assert "pressure" not in table
    assert not set(s) & {*MECHANICAL, *WALLED, "boundary_area_is"}
    assert set(MECHANICAL) <= set(full)
    for key in s.keys() - {"definitions"}:
        np.testing.assert_equal(s[key], full[key])
    assert s["definitions"] == definitions("snapshot")
    assert full["definitions"] == definitions("snapshot", "snapshot_forces")


def test_every_key_is_defined(sample):
    walled, _ = of(box())
    # The run adds the force chains and quadrons, which it finds beside the tables.
    elsewhere = {"spread", "force_chains", "quadrons"}
    assert set(walled) - {"definitions", "notes"} == set(walled["definitions"]) - elsewhere
    assert set(walled) - set(sample[1]) == {*WALLED, "boundary_area_is"}


def box(*, leaning=0.0):
    """Four discs of radius 1 in a box of side 4, pressed by 3 at each of 12 contacts."""
    x = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    graph = GrainGraph(
        x=x,
        radii=np.full(4, 1.0),
        contacts=[[0, 1], [1, 2], [2, 3], [3, 0]],
        normal_force=np.full(4, 3.0),
    )
    grain = np.repeat(np.arange(4), 2)
    branch = np.zeros((8, 2))
    branch[0::2, 0], branch[1::2, 1] = -x[:, 0], -x[:, 1]
    branch[0, 1] = leaning
    walls = WallContacts(grain, 3.0 * branch, branch)
    return from_graph(graph, wall_contacts=8, walls=walls)


def test_walls_of_a_box_by_hand():
    s, _ = of(box())
    # Six of force on each wall of four of length: 1.5, half of it through the walls' contacts.
    assert (s["boundary_area"], s["boundary_area_is"]) == (16.0, "box within the walls")
    np.testing.assert_allclose(s["stress_total"], 1.5 * np.eye(2), rtol=1e-14)
    np.testing.assert_allclose(s["stress_walls"], 0.75 * np.eye(2), rtol=1e-14)
    assert s["boundary_share"] == pytest.approx(0.5, rel=1e-14)
    assert s["wall_force"] == spread(np.full(8, 3.0))
    # The key that was there before stays over the polygon of the centres.
    np.testing.assert_allclose(s["stress"], 12 / 4 * np.eye(2), rtol=1e-14)
    assert s["area"] == 4.0


def test_other_walls_take_the_outline():
    s, _ = of(box(leaning=0.1))
    assert (s["boundary_area"], s["boundary_area_is"]) == (4.0, "outline of the network")
    assert s["boundary_share"] == pytest.approx((24 + 3 * 0.1**2) / (48 + 3 * 0.1**2), rel=1e-12)
    snapshot = box()
    some = np.arange(8) != 0
    walls = WallContacts(
        *(getattr(snapshot.walls, name)[some] for name in ("grain", "force", "branch"))
    )
    s, _ = of(replace(snapshot, walls=walls))
    assert s["boundary_area"] == 16.0


def test_a_leaning_wall_is_no_box():
    """Left, top, and one wall that leans across the lower right corner."""
    whole = box()
    kept = np.array([0, 5, 2])
    branch = whole.walls.branch[kept].copy()
    branch[2] = [-0.6, 0.8]
    walls = WallContacts(whole.walls.grain[kept], 3.0 * branch, branch)
    s, _ = of(replace(whole, walls=walls))
    assert s["boundary_area_is"] == "outline of the network"
    np.testing.assert_allclose(s["stress_walls"], 3.0 * branch.T @ branch / 4.0, rtol=1e-14)


FOLDER = os.environ.get("GRAINLOOPS_DEM")
BOXES = sorted(Path(FOLDER).glob("yade-*/grains_*")) if FOLDER else []
BOXES = [path for path in BOXES if path.parent.name not in ("yade-periodic", "yade-slow")]


@pytest.mark.collection
@pytest.mark.parametrize("path", BOXES, ids=[f"{p.parent.name}-{p.name[7:9]}" for p in BOXES])
def test_stress_with_walls_is_yades(path):
    number = int(path.name.split("_")[1][:2])
    with open(path.parent / "macro.csv") as file:
        macro = next(row for row in csv.DictReader(file) if int(row["snap"]) == number)
    s, _ = of(read_snapshot(path))
    assert s["boundary_area"] == pytest.approx(
        float(macro["width"]) * float(macro["height"]), rel=1e-12
    )
    # Tension is positive there; the walls are frictionless.
    yade = [-float(macro["gs_xx"]), -float(macro["gs_yy"])]
    np.testing.assert_allclose(np.diag(s["stress_total"]), yade, rtol=1e-12)
