from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from loops import CohesiveFrictional, GrainGraph, InputError, Scene, contact_state
from patterns import (
    read_frames,
    read_snapshot,
    sample_cell,
    sample_path,
    snapshot_from_tables,
    write_snapshot,
)


@pytest.mark.parametrize("ending", ["parquet", "csv"])
@pytest.mark.parametrize("periodic", [True, False])
def test_written_files_are_read_back(tmp_path, ending, periodic):
    name = "grains_periodic.parquet" if periodic else "grains_biaxial.csv.gz"
    first = read_snapshot(sample_path(name), cell=sample_cell() if periodic else None)
    path = tmp_path / f"grains_7.{ending}"
    write_snapshot(path, first)
    second = read_snapshot(path)
    for field in ("x", "radii", "contacts", "images", "cell"):
        np.testing.assert_array_equal(getattr(second.graph, field), getattr(first.graph, field))
    largest = np.abs(first.graph.normal_force).max()
    for field in ("normal_force", "shear_force"):
        expected = getattr(first.graph, field)
        np.testing.assert_allclose(getattr(second.graph, field), expected, atol=4e-16 * largest)
    for field in ("kn", "kt", "mu"):
        np.testing.assert_array_equal(getattr(second.law, field), getattr(first.law, field))
    np.testing.assert_array_equal(second.regime, first.regime)
    np.testing.assert_array_equal(second.ids, first.ids)
    assert not [file for file in tmp_path.iterdir() if file.name.startswith(".")]


@pytest.mark.parametrize("ending", ["parquet", "csv"])
@pytest.mark.parametrize(
    "when", [{}, {"step": 0.0}, {"time": 0.1 + 0.2}, {"step": 7e6, "time": 0.7}]
)
def test_the_step_and_the_time_are_kept(tmp_path, ending, when):
    """In files and in tables in memory; what is not known stays unknown."""
    first = replace(read_snapshot(sample_path()), **{"step": None, "time": None} | when)
    write_snapshot(tmp_path / f"grains_1.{ending}", first)
    (frame,) = read_frames(tmp_path / f"grains_1.{ending}")
    again = read_snapshot(tmp_path / f"grains_1.{ending}"), snapshot_from_tables(**first.tables())
    for second in (frame, *again, first.without(grains=first.ids[:1])):
        assert (second.step, second.time) == (when.get("step"), when.get("time"))


def test_a_written_dump_has_its_step(tmp_path):
    first = read_snapshot(sample_path("lammps/dump.atoms.0.gz"))
    first = replace(first, step=40000)
    write_snapshot(tmp_path / "grains_1.parquet", first)
    assert read_snapshot(tmp_path / "grains_1.parquet").step == first.step == 40000


def test_another_snapshot_of_the_name_leaves_no_cell_behind(tmp_path):
    path = tmp_path / "grains_1.parquet"
    write_snapshot(path, read_snapshot(sample_path("grains_periodic.parquet"), cell=sample_cell()))
    assert (tmp_path / "cell_1.json").exists()
    write_snapshot(path, read_snapshot(sample_path()))
    assert read_snapshot(path).graph.cell is None


def test_names_that_can_not_be_read_again(tmp_path):
    snapshot = read_snapshot(sample_path())
    for name in ("discs.parquet", "grains_1.xlsx"):
        with pytest.raises(InputError, match=r"grains\.\.\. ending"):
            write_snapshot(tmp_path / name, snapshot)


@pytest.mark.parametrize("ending", [".parquet", ".csv"])
def test_rotations_of_the_grains_are_kept(tmp_path, ending):
    """By the ids, walls left aside, whatever the column is called; there are none without it."""
    grains = pd.read_csv(sample_path()).rename(columns={"theta_z": "turned"})
    mixed = grains.sample(frac=1.0, random_state=0)
    mixed.to_csv(tmp_path / "grains_0.csv", index=False)
    contacts = pd.read_csv(sample_path("contacts_biaxial.csv.gz"))
    contacts.to_csv(tmp_path / "contacts_0.csv", index=False)
    assert read_snapshot(tmp_path / "grains_0.csv").rotation is None
    found = read_snapshot(tmp_path / "grains_0.csv", columns={"theta_z": "turned"})
    spheres = grains[grains.type == 0].sort_values("id")
    assert 0 < len(spheres) < len(grains)
    np.testing.assert_array_equal(found.ids, spheres.id)
    np.testing.assert_array_equal(found.rotation, spheres.turned)
    assert np.ptp(found.rotation) > 0
    np.testing.assert_array_equal(found.graph.radii, spheres.radius)
    write_snapshot(tmp_path / f"grains_1{ending}", found)
    again = read_snapshot(tmp_path / f"grains_1{ending}")
    np.testing.assert_array_equal(again.rotation, found.rotation)


@pytest.mark.parametrize("overlaps", [(0.002, 0.002), (0.005, 0.015)], ids=["pull", "no pressure"])
@pytest.mark.parametrize("bonded", [True, False])
def test_forces_of_a_cohesive_lattice_push_or_pull_as_its_springs(tmp_path, bonded, overlaps):
    """It is read as it was written; forces with the other sign, or of the other axis, are not."""
    law = CohesiveFrictional(1.0, 0.5, 0.5, adhesion=0.01, bonded=bonded)
    step = 1.0 - np.array(overlaps) + (0.01 if bonded else 0.0)
    at, row = np.divmod(np.arange(25), 5)
    beside, above = 5 * at + (row + 1) % 5, (np.arange(25) + 5) % 25
    images = np.zeros((50, 2), dtype=int)
    images[:25, 0], images[25:, 1] = row == 4, at == 4
    contacts = np.column_stack([np.tile(np.arange(25), 2), np.append(beside, above)])
    graph = GrainGraph(
        np.column_stack([row, at]) * step, np.full(25, 0.5), contacts,
        images=images, cell=5 * np.diag(step),
    )  # fmt: skip
    graph = graph.replace(normal_force=law.normal_force(contact_state(graph)))
    write_snapshot(tmp_path / "grains_1.csv", Scene(graph, law))
    found = read_snapshot(tmp_path / "grains_1.csv")
    np.testing.assert_allclose(found.graph.normal_force, graph.normal_force, rtol=0, atol=1e-15)
    assert not any("doubt" in note for note in found.notes)
    tables = found.tables()
    given = {name: np.array(column) for name, column in tables["contacts"].items()}
    x, y = given["fx_on_2"], given["fy_on_2"]
    for fx, fy, words in ((-x, -y, "they pull"), (y, x, "x and y exchanged")):
        tables["contacts"] = given | {"fx_on_2": fx, "fy_on_2": fy}
        with pytest.raises(InputError, match=words):
            snapshot_from_tables(**tables)
