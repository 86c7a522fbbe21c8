"""A series of Yade between rough plates: what is read of them, and what the packing predicts."""

from pathlib import Path

import numpy as np
import pytest

from patterns import read_snapshot
from studies.series.evolution import sample_strain
from studies.snapshot.in_packing import fixed_point

FOLDER = Path(__file__).parent / "rough"


@pytest.fixture(scope="module")
def snapshots():
    return [read_snapshot(FOLDER / f"grains_{k:02d}.csv.gz") for k in (3, 4, 5)]


def test_plates_have_the_springs_and_the_friction_of_the_file(snapshots):
    for snapshot in snapshots:
        boundary, notes = snapshot.boundary_and_notes
        planes = boundary.walls
        assert boundary.kind == "walls" and notes == []
        assert (planes.mu == 0.5).all() and np.allclose(planes.kt, 0.5 * planes.kn, rtol=1e-9)
        state = planes.state(snapshot.graph.radii)
        # N is kn times the overlap, and T is within Coulomb's limit.
        assert np.allclose(state.normal_force, planes.kn * state.overlap, rtol=1e-6)
        assert (np.abs(state.shear_force) <= 0.5 * state.normal_force * (1 + 1e-9)).all()


def test_the_point_at_rest_is_that_of_the_plates(snapshots):
    before, after, _ = snapshots
    H, source = sample_strain(before, after)
    assert source == "walls" and H[1, 1] > 0
    assert np.allclose(fixed_point(before, after, H), 0.0, atol=1e-9)
