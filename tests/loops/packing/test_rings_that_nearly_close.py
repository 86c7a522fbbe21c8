"""Rings of gears that nearly close: operators against 90 digits, and what is not known."""

import numpy as np
import pytest

from loops import GrainGraph, LinearFrictional, Regime, Scene, find_faces
from loops.gears import HIDDEN, UNKNOWN, spin_modes
from loops.in_place import inverse_at_contacts
from tests.packings import frobenius, loops_in_place, packing_system
from tests.tools.loops_in_place import SIGNS, campaign, closing_packing, compared


def lattice(off, seed=1, *, radii=0.0, increment="branch"):
    """A square lattice of 16 gears, positions and radii off by so much; its law and regimes."""
    rng = np.random.default_rng(seed)
    graph = lattice_of(off * rng.uniform(-1, 1, (16, 2)), 0.5 + radii * rng.uniform(-1, 1, 16))
    law = LinearFrictional(1.0, 0.5, 0.3, increment)
    return graph, law, np.full(32, Regime.ELASTIC, np.int8)


def lattice_of(moves, radii):
    i, j = np.divmod(np.arange(16), 4)
    to = [4 * ((i + 1) % 4) + j, 4 * i + (j + 1) % 4]
    contacts = np.column_stack([np.tile(np.arange(16), 2), np.concatenate(to)])
    images = np.zeros((32, 2), dtype=int)
    images[:16, 0], images[16:, 1] = i == 3, j == 3
    x = np.column_stack([i, j]) + moves
    none = np.zeros(32)
    return GrainGraph(x, radii, contacts, images=images, cell=4 * np.eye(2),
                      normal_force=none, shear_force=none)  # fmt: skip


def mismatch(graph, law, regime):
    system = packing_system(Scene(graph, law), regime=regime)
    return spin_modes(system.stiffness, system.ends, system.size)[2]


def test_mismatches_from_rounding_to_locked():
    """Five lattices, their mismatch from 1e-14 to 1e-3, sliding contacts in some."""
    families = ("3e-2", "1e-3", "1e-4", "1e-6", "2e-7")
    total, ratios, _ = campaign(5, 5, 16, families, closing_packing)
    assert total["beyond"] == 0 and all(total[f"{name} wrong"] == 0 for name in SIGNS)
    assert total["answered"] > 0.9 * total["loops"] > 60
    assert 1e-3 < max(ratios.values()) < 0.5


@pytest.mark.slow
def test_ten_thousand_loops_of_rings_that_nearly_close():
    total, ratios, _ = campaign(720, 0, 16, ("closing",), closing_packing)
    assert total["loops"] > 9_000 and total["beyond"] == 0
    assert all(total[f"{name} wrong"] == 0 for name in SIGNS)
    assert total["answered"] > 0.8 * total["loops"] and max(ratios.values()) < 0.5


@pytest.mark.parametrize("off", [1e-2, 1e-4, 1e-6])
def test_the_slip_of_the_ring_is_felt(off):
    """However small the mismatch: the lattice of equal grains, a gear, answers otherwise."""
    graph, law, regime = lattice(off, radii=off)
    assert UNKNOWN < mismatch(graph, law, regime)[0] < 1e-3
    count, ratio, stated = compared(graph, law, regime)
    assert count["answered"] == 16 and count["beyond"] == 0 and ratio > 1e-4
    faces = find_faces(graph)
    slips = loops_in_place(Scene(graph.replace(regime=regime), law), faces)
    gears = loops_in_place(Scene(lattice(off)[0].replace(regime=regime), law), faces)
    change = frobenius(slips.matrix - gears.matrix) / frobenius(gears.matrix)
    assert np.median(change) > 0.05 and (stated < 1e-14 / off**2).all()


def test_a_ring_that_may_close_by_rounding_is_not_judged():
    """Two sizes of grains in turn, no overlap: the arms are the radii but for rounding."""
    turn = 0.1 * (np.indices((4, 4)).sum(axis=0).ravel() % 2)
    graph, regime = lattice_of(np.zeros((16, 2)), 0.4 + turn), np.full(32, 1, np.int8)
    faces = find_faces(graph)
    by_branch, by_radii = (
        loops_in_place(
            Scene(graph.replace(regime=regime), LinearFrictional(1.0, 0.5, 0.3, increment)), faces
        )
        for increment in ("branch", "radii")
    )
    assert np.isnan(by_branch.matrix).all() and np.isinf(by_branch.error).all()
    assert np.isfinite(by_radii.matrix).all() and (by_radii.error < 1e-9).all()


def test_numbers_and_units_change_rounding_alone():
    graph, law, regime = lattice(1e-3, radii=1e-3)
    faces = find_faces(graph)
    found = loops_in_place(Scene(graph.replace(regime=regime), law), faces)
    turn = np.random.default_rng(5).permutation(16)
    place = np.argsort(turn)
    flip = np.arange(32) % 3 == 0
    ends = place[graph.contacts]
    ends[flip] = ends[flip, ::-1]
    images = np.where(flip[:, None], -graph.images, graph.images)
    unit = 2.0**20
    other = graph.replace(
        x=unit * graph.x[turn], radii=unit * graph.radii[turn], contacts=ends[::-1],
        images=images[::-1], cell=unit * graph.cell,
    )  # fmt: skip
    moved = find_faces(other)
    again = loops_in_place(
        Scene(other.replace(regime=regime), LinearFrictional(unit, 0.5 * unit)), moved
    )
    centres = [
        np.sort([np.sort(f.grains[slice(*f.offsets[k : k + 2])]) for k in f.loops], axis=1)
        for f in (faces, moved)
    ]
    order = [place[centres[0]], centres[1]]
    rows = [[np.flatnonzero((order[1] == np.sort(one)).all(axis=1))[0]] for one in order[0]]
    change = frobenius(again.matrix[np.ravel(rows)] / unit - found.matrix)
    assert (change < found.matrix_error).all() and (change > 0).any()


def test_motion_at_contacts_leaves_out_what_rounding_hides():
    """Below HIDDEN a ring is a gear: its motion is that of equal grains; above it slips."""
    graph, law, regime = lattice(1e-5, radii=1e-5)
    assert UNKNOWN < mismatch(graph, law, regime)[0] < HIDDEN
    near, gear = (
        inverse_at_contacts(packing_system(Scene(one, law), regime=regime))
        for one in (graph, lattice(1e-5)[0])
    )
    assert np.abs(near - gear).max() < 1e-3 * np.abs(gear).max()
    graph, law, regime = lattice(1e-2, radii=1e-2)
    far = inverse_at_contacts(packing_system(Scene(graph, law), regime=regime))
    assert np.abs(far).max() > 1e3 * np.abs(gear).max()
