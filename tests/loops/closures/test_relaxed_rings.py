"""A finite step of a ring whose forces are linear in its branches: one solve is its balance."""

import numpy as np
import pytest

from loops import polygon_area
from loops.closures import ring as equations


def linear_ring(kinds, seed):
    """Branches (n, 2), levers, dead loads, and forces and tangents of contacts of some kinds.

    A contact of two springs is condensed whole, one that slides keeps a motion, an open one two.
    """
    random, n = np.random.default_rng(seed), len(kinds)
    angle = 2 * np.pi * (np.arange(n) + random.uniform(-0.2, 0.2, n)) / n
    x = np.stack([np.cos(angle), np.sin(angle)], axis=1) * random.uniform(0.9, 1.1, (n, 1))
    d = np.roll(x, -1, axis=0) - x
    middle = x + 0.5 * d
    levers = np.stack([middle[:, 1], -middle[:, 0]], axis=1)
    normal = d / np.linalg.norm(d, axis=1)[:, None]
    tangential = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
    K, force = np.zeros((n, 2, 2)), random.normal(size=(n, 2))
    for c, kind in enumerate(kinds):
        frame = np.stack([normal[c], tangential[c]], axis=1)
        own = {"springs": [[1.0, 0.2], [-0.1, 0.6]], "slides": [[1.0, 0.1], [0.5, 0.01]],
               "open": [[0.0, 0.0], [0.0, 0.0]]}[kind]  # fmt: skip
        K[c] = frame @ own @ frame.T
        force[c] *= kind != "open"
    return d, levers, 0.1 * random.normal(size=(n, 2)), force, K, polygon_area(x)


def balanced(d, levers, dead, force, K, area, U):
    """Branches, stress and tangent (4, 4), by one dense system for all branches, f^ and P."""
    n = len(d)
    A, b = np.zeros((2 * n + 6, 2 * n + 6)), np.zeros(2 * n + 6)
    for c in range(n):
        rows, m = slice(2 * c, 2 * c + 2), levers[c]
        # f - K e + dead = f^ - P m.
        A[rows, rows] = K[c]
        A[rows, 2 * n : 2 * n + 2] = np.eye(2)
        A[rows, 2 * n + 2 :] = -np.kron(np.eye(2), m)
        A[2 * n : 2 * n + 2, rows] = np.eye(2)
        A[2 * n + 2 :, rows] = np.kron(np.eye(2), m[:, None])
        b[rows] = force[c] + dead[c]
    b[2 * n : 2 * n + 2] = -d.sum(axis=0)
    b[2 * n + 2 :] = -area * U.ravel() - np.einsum("ci,cj->ij", d, levers).ravel()
    found = np.linalg.solve(A, b)
    H = np.zeros((2 * n + 6, 4))
    H[2 * n + 2 :] = area * np.eye(4)
    return d + found[: 2 * n].reshape(n, 2), found[2 * n + 2 :], np.linalg.solve(A, H)[-4:]


@pytest.mark.parametrize(
    "kinds",
    [["springs"] * 3, ["springs"] * 6, ["springs", "slides"] * 3,
     ["springs", "open", "springs", "slides", "springs", "springs", "slides"]],
    ids=lambda kinds: f"{len(kinds)} {'-'.join(sorted(set(kinds)))}",
)  # fmt: skip
def test_one_solve_balances_a_ring_of_linear_forces(kinds):
    d, levers, dead, force, K, area = linear_ring(kinds, len(kinds))
    n, size, U = len(kinds), np.sqrt(area), np.array([[0.98, 0.01], [0.01, 1.02]])
    wanted, stress, tangent = balanced(d, levers, dead, force, K, area, U)
    branches, P, A = d[None].copy(), np.zeros((1, 1, 4)), np.zeros((1, 1, 16))
    status = np.full((1, 1), equations.MOVING)
    for moving in (1, 0):
        f = force - np.einsum("cij,cj->ci", K, branches[0] - d)
        answers = np.concatenate([f.T, K.reshape(n, 4).T])[None]
        rest = equations.relax(
            answers, np.array([0, n]), U.reshape(1, 4), levers / size, dead, np.array([size]),
            branches, P, A, status,
        )  # fmt: skip
        assert rest == moving
    assert status[0, 0] == equations.RELAXED
    np.testing.assert_allclose(branches[0], wanted, rtol=0, atol=1e-12)
    np.testing.assert_allclose(P[0, 0], stress, rtol=0, atol=1e-12)
    np.testing.assert_allclose(A[0, 0].reshape(4, 4), tangent, rtol=0, atol=1e-12)


def test_a_ring_without_stiffness_or_with_too_many_open_contacts_is_lost():
    for kinds in (["open"] * 5, ["springs", "springs", "open", "open", "open", "open"]):
        d, levers, dead, force, K, area = linear_ring(kinds, 1)
        n, status = len(kinds), np.full((1, 1), equations.MOVING)
        answers = np.concatenate([force.T, K.reshape(n, 4).T])[None]
        size, U = np.sqrt(area), np.eye(2).reshape(1, 4)
        state = d[None].copy(), np.zeros((1, 1, 4)), np.zeros((1, 1, 16)), status
        offsets = np.array([0, n])
        equations.relax(answers, offsets, U, levers / size, dead, np.array([size]), *state)
        assert status[0, 0] == equations.LOST
