"""Changes of regime by columns, against a factorisation of the system as it has become."""

import numpy as np
import pytest

from stability.packing.frozen_packing import BATCH, ELASTIC, OPEN, SLIDING, FrozenPacking
from stability.packing.pairs import contact_pairs
from stability.packing.state import start_state
from tests.packings import LAW, jammed

NONE, ALL = np.zeros((4, 4)), np.eye(4)
HELD = np.diag([1.0, 0, 0, 0])
# The first is under prescribed strain, the second holds P11.
CONTROLS = (
    (NONE, ALL, np.array([1.0, 0.2, 0.1, -0.7])),
    (HELD, ALL - HELD, np.array([0, 0, 0, 1.0])),
)
OPENS = 13
CHANGES = (
    (3, SLIDING, 1.0),
    (OPENS, OPEN, 0.0),
    (11, SLIDING, -1.0),
    (3, ELASTIC, 0.0),
    (20, SLIDING, 1.0),
)


def pieces_of(graph, changes=()):
    left = np.arange(graph.contact_count) != OPENS
    graph = graph.replace(
        normal_force=left * graph.normal_force, shear_force=left * graph.shear_force
    )
    state, pairs = start_state(graph), contact_pairs(graph, LAW)
    regime, side = np.full(len(pairs), ELASTIC, dtype=np.int8), np.ones(len(pairs))
    for c, to, on in changes:
        regime[c], side[c] = to, on
    load = np.random.default_rng(0).normal(size=(graph.grain_count, 3))
    return FrozenPacking(
        state, pairs, regime, side, True, 1e-3 * (load - load.mean(axis=0)).ravel()
    )


@pytest.mark.parametrize("control", CONTROLS, ids=["strain", "stress"])
def test_columns_are_a_factorisation_of_the_changed_system(control):
    """The contact that opens has no force left, its grains have contacts enough without it."""
    graph = jammed(36, 5, LAW)
    changed, anew = pieces_of(graph), pieces_of(graph, CHANGES)
    for change in CHANGES:
        changed.set_regime(*change)
        changed.solve(*control)
    found, wanted = (pieces.solve(*control) for pieces in (changed, anew))
    np.testing.assert_allclose(found.h, wanted.h, rtol=0, atol=1e-11)
    motions = changed.motion(found), anew.motion(wanted)
    np.testing.assert_allclose(*motions, rtol=0, atol=1e-10 * np.abs(motions[1]).max())
    assert changed.sign(*control[:2]) == 1.0


def test_columns_solved_ahead_are_those_solved_alone():
    """Of the pairs whose events are due: to the bit, and no more of them than a batch."""
    graph = jammed(36, 5, LAW)
    alone, ahead = pieces_of(graph), pieces_of(graph)
    ahead.due[:10] = np.arange(10.0)
    rows = [len(ahead.due) + c for c in range(BATCH + 2)]
    for pieces in (alone, ahead):
        for row in rows:
            pieces.column(row)
            if row == rows[0]:
                assert len(pieces.ready) == (BATCH - 1 if pieces is ahead else 0)
    np.testing.assert_array_equal(ahead.U[: len(rows)], alone.U[: len(rows)])
    np.testing.assert_array_equal(ahead.mutual[:, :10, :10], alone.mutual[:, :10, :10])


def test_edges_are_kept_by_motion():
    """What is kept of a pair's edge is that of the motion, on either side, as columns come."""
    graph = jammed(36, 5, LAW)
    pieces, some = pieces_of(graph), np.array([3, 5, 20, 30])
    i, j = pieces.frame.grains[some].T
    for change in (None, *CHANGES):
        if change:
            pieces.set_regime(*change)
        rates = pieces.solve(*CONTROLS[0])
        u = pieces.motion(rates).reshape(-1, 3)
        rows = pieces.frame.rows[some]
        d, n, t = rows[:, :6].reshape(-1, 3, 2).swapaxes(0, 1)
        r = u[j, :2] - u[i, :2] - d @ rates.h[:4].reshape(2, 2).T
        un, across = np.sum(n * r, axis=1), np.sum(t * r, axis=1)
        ut = rows[:, 6] * across - rows[:, 7] * u[i, 2] - rows[:, 8] * u[j, 2]
        wanted = pieces.side[some] * LAW.kt * ut - LAW.mu * LAW.kn * un
        size = np.abs(wanted).max()
        np.testing.assert_allclose(
            pieces.edge((rates,), some)[:, 0], wanted, rtol=0, atol=1e-12 * size
        )
        np.testing.assert_allclose(
            [pieces.relative(rates, int(c)) for c in some], np.column_stack([un, ut]),
            rtol=0, atol=1e-12 * np.abs(r).max(),
        )  # fmt: skip
