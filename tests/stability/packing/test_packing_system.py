"""Factors of blocks 3 x 3 in any order of elimination, against dense systems."""

import numpy as np
import pytest

from stability.compiled.packing_system import (
    LOADS_AT_ONCE,
    eliminate,
    elimination_order,
    solve,
    structure,
)

RNG = np.random.default_rng(7)


def blocks_of(dense, begin, rows):
    """The blocks of a matrix (n, n) numbered by the order of elimination."""
    four = dense.reshape(len(begin) - 1, 3, len(begin) - 1, 3).swapaxes(1, 2)
    column = np.repeat(np.arange(len(begin) - 1), np.diff(begin))
    pivot = four[np.arange(len(four)), np.arange(len(four))]
    return four[rows, column].copy(), four[column, rows].copy(), pivot.copy()


def system(bodies, pairs, place):
    """A matrix without symmetry that couples pairs of bodies, and its structure."""
    ends = RNG.integers(0, bodies, (pairs, 2))
    dense = np.kron(np.eye(bodies), 4.0 * np.eye(3))
    for i, j in place[ends]:
        own = RNG.normal(size=(6, 6))
        at = np.concatenate([3 * i + np.arange(3), 3 * j + np.arange(3)])
        np.add.at(dense, np.ix_(at, at), own @ own.T + 0.5 * (own - own.T))
    return dense, ends, structure(ends, place)


@pytest.mark.parametrize("bodies", [2, 5, 40])
@pytest.mark.parametrize("order", ["as given", "any", "minimum degree"])
def test_solutions_are_those_of_the_dense_system(bodies, order):
    """Several pairs of the same bodies, a body with itself and one alone included."""
    place = RNG.permutation(bodies) if order == "any" else np.arange(bodies)
    if order == "minimum degree":
        place = elimination_order(RNG.integers(0, bodies, (2 * bodies, 2)), bodies)
        assert sorted(place.tolist()) == list(range(bodies))
    dense, _, (begin, rows) = system(bodies, 2 * bodies, place)
    lower, upper, pivot = blocks_of(dense, begin, rows)
    # What is no block is zero before, and the factors fill no other place.
    kept = np.kron(np.eye(bodies), np.ones((3, 3)))
    column = np.repeat(np.arange(bodies), np.diff(begin))
    for i, k in zip(rows, column, strict=True):
        assert i > k
        kept[3 * i : 3 * i + 3, 3 * k : 3 * k + 3] = kept[3 * k : 3 * k + 3, 3 * i : 3 * i + 3] = 1
    assert (dense[kept == 0] == 0).all()
    swap = np.empty((bodies, 3), dtype=np.int64)
    assert eliminate(begin, rows, lower, upper, pivot, swap)
    into = (3 * place[:, None] + np.arange(3)).ravel()
    loads = RNG.normal(size=(3 * bodies, 2 * LOADS_AT_ONCE))
    wanted = np.linalg.solve(dense, loads)[into].T
    for count in (1, LOADS_AT_ONCE, LOADS_AT_ONCE + 1):
        out, x = np.empty((count, 3 * bodies)), loads.copy()
        solve(begin, rows, lower, upper, pivot, swap, into, x, 0, out)
        np.testing.assert_allclose(out, wanted[:count], rtol=0, atol=1e-12 * np.abs(wanted).max())
    # Rows before the first load are passed over.
    start = 3 * (bodies // 2)
    x, late, out = loads.copy(), loads.copy(), np.empty((1, 3 * bodies))
    x[:start] = late[:start] = 0.0
    solve(begin, rows, lower, upper, pivot, swap, into, x, start, out)
    wanted = np.linalg.solve(dense, late)[into, 0]
    np.testing.assert_allclose(out[0], wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())


def test_motions_that_springs_alone_hold_leave_no_load():
    """Of bodies of one contact: the block's inverse would leave shares of it."""
    n, spring = np.array([0.6, 0.64, 0.48]), 1e-9
    dense = np.kron(np.eye(50), np.outer(n, n) + spring * np.eye(3))
    begin, rows = structure(np.zeros((0, 2), dtype=np.int64), np.arange(50))
    factors, swap = blocks_of(dense, begin, rows), np.empty((50, 3), dtype=np.int64)
    assert eliminate(begin, rows, *factors, swap)
    load, out = RNG.normal(size=(150, LOADS_AT_ONCE)), np.empty((1, 150))
    solve(begin, rows, *factors, swap, np.arange(150), load.copy(), 0, out)
    assert np.abs(out).max() > 0.1 / spring
    assert np.abs(dense @ out[0] - load[:, 0]).max() < 1e-15 / spring


def test_a_singular_pivot_is_told():
    begin, rows = structure(np.array([[0, 1]]), np.arange(2))
    lower, upper, pivot = np.ones((1, 3, 3)), np.ones((1, 3, 3)), np.zeros((2, 3, 3))
    assert not eliminate(begin, rows, lower, upper, pivot, np.empty((2, 3), dtype=np.int64))


def test_right_hand_sides_come_by_lanes():
    begin, rows = structure(np.zeros((0, 2), dtype=np.int64), np.arange(1))
    factors = begin, rows, np.zeros((0, 3, 3)), np.zeros((0, 3, 3)), np.eye(3)[None]
    factors += (np.arange(3)[None],)
    for columns, count in ((LOADS_AT_ONCE - 1, 1), (LOADS_AT_ONCE, LOADS_AT_ONCE + 1)):
        with pytest.raises(ValueError, match="no multiple of LOADS_AT_ONCE"):
            solve(*factors, np.arange(3), np.ones((3, columns)), 0, np.empty((count, 3)))
