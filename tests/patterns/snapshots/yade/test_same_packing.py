"""One packing through the save and the tables that Yade writes of it."""

import numpy as np
import pytest

from loops import euler_check, find_faces, love_weber_stress
from tests.patterns.snapshots.yade_samples import (
    BOX,
    PERIODIC,
    by_pair,
    cycles,
    snapshot_of,
    table_of,
)


def names(path):
    return path.name


def pairs_of(snapshot):
    return by_pair(snapshot, np.sort(snapshot.ids[snapshot.graph.contacts], axis=1))


@pytest.mark.parametrize("folder", [BOX, PERIODIC], ids=names)
def test_save_has_the_forces_of_the_tables(folder):
    table, saved = table_of(folder), snapshot_of(folder / "state.xml.gz")
    assert cycles(saved) == cycles(table)
    assert len(cycles(table)) > 15
    assert (pairs_of(saved) == pairs_of(table)).all()
    # Both have 17 digits.
    scale = table.graph.normal_force.max()
    for name in ("normal_force", "shear_force"):
        given = by_pair(saved, getattr(saved.graph, name))
        expected = by_pair(table, getattr(table.graph, name))
        assert np.abs(given - expected).max() < 1e-13 * scale
    for name in ("kn", "kt", "mu"):
        given, expected = getattr(saved.law, name), getattr(table.law, name)
        assert np.abs(by_pair(saved, given) / by_pair(table, expected) - 1).max() < 1e-14
    assert (by_pair(saved, saved.regime) == by_pair(table, table.regime)).all()
    assert np.abs(saved.graph.x - table.graph.x).max() < 1e-15


def test_save_has_the_cell_and_the_images_of_the_tables():
    table, saved = table_of(PERIODIC), snapshot_of(PERIODIC / "state.xml.gz")
    assert np.abs(saved.graph.cell - table.graph.cell).max() < 1e-15
    assert saved.graph.cell[0, 1] != 0
    assert saved.graph.images.any()
    assert (by_pair(saved, saved.graph.images) == by_pair(table, table.graph.images)).all()
    stress, expected = love_weber_stress(saved.graph), love_weber_stress(table.graph)
    assert np.abs(stress - expected).max() < 1e-13 * np.abs(expected).max()
    assert euler_check(saved.graph, find_faces(saved.graph)).ok


def test_save_has_the_walls_of_the_tables():
    table, saved = table_of(BOX), snapshot_of(BOX / "state.xml.gz")
    assert saved.wall_contacts == table.wall_contacts == 18
    orders = [np.lexsort([*w.force.T, w.grain]) for w in (saved.walls, table.walls)]
    for name in ("grain", "force", "branch"):
        given, expected = (
            getattr(w, name)[order]
            for w, order in zip((saved.walls, table.walls), orders, strict=True)
        )
        assert np.abs(given - expected).max() < 1e-13 * np.abs(expected).max()


def test_walls_hold_the_grains():
    """Forces of the walls cancel, as the sample is at rest; along x and along y."""
    walls = table_of(BOX).walls
    assert np.abs(walls.force.sum(axis=0)).max() < 1e-6 * np.abs(walls.force).sum()
