"""Loops in place on real states: every method against the whole packing, and what theory found."""

import os
from pathlib import Path

import numpy as np
import pytest

from loops import (
    LinearFrictional,
    Regime,
    Scene,
    boundary_vectors,
    find_faces,
    loop_batches,
    polygon_area,
)
from loops.gears import spin_modes
from loops.in_place import inverted, polygons_of
from patterns import read_snapshot, sample_cell, sample_path
from patterns.snapshots.cells import rows_by_number
from stability import restrict, symmetric_part
from stability.factor import Factor
from tests.oracles import eighty_bits
from tests.packings import frobenius, loops_in_place, packing_system

FOLDER = Path(os.environ.get("GRAINLOOPS_DEM", "")) / "yade-slow"
COLLECTION = pytest.mark.collection


class State:
    """A snapshot with its faces, and the whole packing's answer."""

    def __init__(self, snapshot, *, sliding):
        self.law, graph = snapshot.law, snapshot.graph
        if not sliding:
            graph = graph.replace(regime=np.full(graph.contact_count, Regime.ELASTIC, np.int8))
        self.graph, self.faces = graph, find_faces(graph)
        self.order = self.faces.order[self.faces.loops]
        self.whole = self.by(method="whole")

    def by(self, **how):
        return loops_in_place(Scene(self.graph, self.law), self.faces, **how)

    def error(self, found):
        return frobenius(found.matrix - self.whole.matrix) / frobenius(self.whole.matrix)

    def share(self):
        """Of the surroundings in the trace of `A_in`, median by order; 7 and more together."""
        inside, alone = (
            np.trace(restrict(one, "symmetric"), axis1=1, axis2=2)
            for one in (self.whole.matrix, self.whole.alone)
        )
        share, order = 1 - alone / inside, np.minimum(self.order, 7)
        return [float(np.nanmedian(share[order == n])) for n in range(3, 8)]

    def unstable(self, matrix):
        values = smallest(matrix)
        return float(np.mean(values[np.isfinite(values)] < 0))


def smallest(matrix):
    out, known = np.full(len(matrix), np.nan), np.isfinite(matrix).all(axis=(1, 2))
    out[known] = np.linalg.eigvalsh(symmetric_part(restrict(matrix[known], "symmetric")))[:, 0]
    return out


def read(path, cells, number):
    xx, xy, yx, yy = rows_by_number(cells)[number]
    return read_snapshot(path, cell=[[xx, xy], [yx, yy]], shear_increment="radii")


def sample(*, sliding):
    path = sample_path("slow/grains_10.parquet")
    return State(read(path, path.parent / "cells.csv", 10), sliding=sliding)


def sheared_sample(*, sliding):
    path = sample_path("grains_periodic.parquet")
    return State(read_snapshot(path, cell=sample_cell()), sliding=sliding)


@pytest.fixture(scope="module")
def elastic():
    return sample(sliding=False)


@pytest.fixture(scope="module")
def flagged():
    return sample(sliding=True)


@pytest.fixture(scope="module")
def sheared():
    return sheared_sample(sliding=False)


@pytest.fixture(scope="module")
def sheared_and_flagged():
    return sheared_sample(sliding=True)


@pytest.mark.parametrize("name", ["elastic", "flagged"])
def test_selected_inverse_is_the_direct_solve(request, name):
    """Solves of the rates, refined until they know no regularisation."""
    state = request.getfixturevalue(name)
    system = packing_system(Scene(state.graph, state.law))
    factor = Factor(system)
    row = {face: k for k, face in enumerate(state.faces.loops)}
    for batch in loop_batches(state.graph, state.faces):
        vectors, area = boundary_vectors(batch.graph.x), polygon_area(batch.graph.x)
        for k in range(0, len(batch.face), 1 + len(batch.face) // 3):
            B = np.zeros((system.size, 4))
            np.add.at(B[:, :2], system.freedom[batch.grains[k], 0], vectors[k])
            np.add.at(B[:, 2:], system.freedom[batch.grains[k], 1], vectors[k])
            compliance = B.T @ factor.solve(B) / area[k]
            at = row[batch.face[k]]
            change = frobenius(state.whole.matrix[at] - np.linalg.inv(compliance))
            assert change < state.whole.matrix_error[at]
    # A bound that says nothing would withhold signs.
    assert np.max(state.whole.error) < 1e-8
    assert np.isfinite(state.whole.matrix).all()


def test_blocks_converge_to_the_whole(elastic):
    """As R^-1.9; 0.2 is what the slope scatters by from state to state."""
    system = packing_system(Scene(elastic.graph, elastic.law))
    polygons, points = polygons_of(elastic.graph, elastic.faces), []
    for buffer in (4.0, 8.0):
        found = inverted(system, polygons, 6.0, buffer)
        points.append((np.log(np.median(found.rho)), np.log(np.median(elastic.error(found)))))
    slope = np.polyfit(*np.transpose(points), 1)[0]
    assert slope == pytest.approx(-1.9, abs=0.2)


@pytest.mark.parametrize("buffer", [4.0, pytest.param(8.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", ["elastic", "flagged", "sheared", "sheared and flagged"])
def test_the_stated_error_of_blocks_holds(request, name, buffer):
    """Sheared far, the elastic packing is no longer definite: soft modes reach through it."""
    state = request.getfixturevalue(name.replace(" ", "_"))
    found = state.by(method="blocks", block=25.0, buffer=buffer)
    assert (found.error > 0).all()
    own = frobenius(found.matrix - state.whole.matrix)
    assert np.mean(own <= found.matrix_error) >= 0.99
    # A bound says something only where it is not far above; soft modes leave nothing to say. It
    # is infinite where held grains of a narrow buffer may change a loop by its whole operator.
    if "sheared" not in name:
        assert np.isfinite(found.error).mean() > (0.98 if buffer > 5.0 else 0.5)
        change = 1.0 - 1.0 / (1.0 + found.error)
        assert np.median(change / state.error(found)) < 200


def test_loops_across_the_border_are_judged_where_they_stand(elastic):
    """Unrolled from their first grain they were once taken to lie at the cell's corner."""
    found = elastic.by(method="blocks", block=6.0, buffer=4.0)
    error, crossing = elastic.error(found), np.zeros(len(elastic.order), dtype=bool)
    for batch in loop_batches(elastic.graph, elastic.faces):
        over = elastic.graph.images[batch.contacts].any(axis=(1, 2))
        crossing[np.searchsorted(elastic.faces.loops, batch.face[over])] = True
    assert 50 < crossing.sum() < 200
    # Large loops, which reach across more often, have the larger errors.
    assert np.median(error[crossing]) < 1.5 * np.median(error[~crossing])
    assert error.max() < 0.35


def test_what_surrounds_the_loops(elastic, flagged):
    """Shares of the sample; cut out, every loop of five and more is unstable."""
    assert elastic.share() == pytest.approx([0.22, 0.13, 0.45, 0.43, 1.0], abs=0.04)
    assert elastic.unstable(elastic.whole.matrix) == 0
    assert elastic.unstable(elastic.whole.surroundings) < 0.003
    assert (smallest(elastic.whole.alone)[elastic.order >= 5] < 0).all()
    assert flagged.unstable(flagged.whole.matrix) == pytest.approx(0.05, abs=0.02)
    assert flagged.unstable(flagged.whole.alone) > 0.6


@pytest.mark.slow
@pytest.mark.parametrize("name", ["flagged", "sheared_and_flagged", "elastic", "sheared"])
def test_stated_errors_against_eighty_bits(request, name):
    """13,548 loops of four states, soft in shear: ratios of the springs from 0.5 down."""
    state = request.getfixturevalue(name)
    kn, mu = (float(np.median(p)) for p in (state.law.kn, state.law.mu))
    for ratio in (0.5, 1e-8) if "flagged" in name else (0.5, 1e-6, 1e-8, 1e-10):
        law = LinearFrictional(kn, ratio * kn, mu, "radii")
        regime = state.graph.regime
        found = loops_in_place(
            Scene(state.graph.replace(regime=regime), law), state.faces, method="whole"
        )
        system = found.system
        modes = spin_modes(system.stiffness, system.ends, system.size)
        exact = eighty_bits.operators(system, state.faces, modes)
        error = frobenius((found.matrix - exact).astype(float)) / frobenius(found.matrix)
        assert np.isfinite(found.matrix).all() and np.isfinite(error).all()
        assert (error < 0.5 * found.error).all()


@pytest.mark.slow
@COLLECTION
def test_what_surrounds_the_loops_of_the_slow_series():
    """Elastic: at least 99.7 % of surroundings positive definite, no loop in place unstable."""
    shares, inside, around, alone, sliding = [], [], [], [], []
    for number in (2, 7, 12, 17, 22, 27, 32):
        path, cells = FOLDER / f"grains_{number:02d}.parquet", FOLDER / "macro.csv"
        state = State(read(path, cells, number), sliding=False)
        shares.append(state.share())
        inside.append(state.unstable(state.whole.matrix))
        around.append(state.unstable(state.whole.surroundings))
        alone.append(np.mean(smallest(state.whole.alone) < 0))
        flags = State(read(path, cells, number), sliding=True)
        sliding.append(flags.unstable(flags.whole.matrix))
        blocks = flags.by(method="blocks", block=25.0, buffer=8.0)
        assert np.mean(flags.error(blocks) <= blocks.error) >= 0.99
        # Nothing is withheld for rounding's sake.
        assert np.isfinite(flags.whole.matrix).all() and flags.whole.error.max() < 1e-6
    assert max(inside) == 0 and max(around) <= 0.003
    assert np.mean(shares, axis=0) == pytest.approx([0.22, 0.13, 0.45, 0.43, 1.0], abs=0.03)
    assert np.mean(alone) == pytest.approx(0.50, abs=0.03)
    assert 0.04 < np.mean(sliding) < 0.13
