"""Parts of the packing's rate problem by themselves, against closed forms."""

from copy import copy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from loops import GrainGraph, InputError, Scene, contact_state
from loops.laws.of_pairs import as_known, require_movable
from stability.complementarity import principal_transform, scaled_definite
from stability.packing import rate_problem, regime_regions
from stability.packing.regime_regions import RegimeRegions, cones
from stability.solution_branch import trace_branch
from tests.packings import LAW, packing


def test_where_all_directions_soften_the_cone_is_the_whole_circle():
    angles = np.array([2.0, 0.5, 4.0])
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    found = cones(None, directions, [SimpleNamespace(normalised=-0.1)] * 3)
    np.testing.assert_allclose(found.ends, [[0.5, 0.5 + 2 * np.pi]], rtol=1e-14)
    assert not found.refined.any()
    # Half a turn is left out, or there is no plane: nothing is said.
    assert cones(None, directions[:2], [SimpleNamespace(normalised=-0.1)] * 2) is None
    assert cones(None, np.eye(3), [SimpleNamespace(normalised=-0.1)] * 3) is None


@pytest.mark.parametrize(("diagonal", "status"), [(1e-7, "degenerate"), (1e-2, "closed")])
def test_a_small_pivot_is_small_beside_its_column(diagonal, status):
    """Contact 0 reaches its limit first, at a quarter of a turn; its column is 1e6."""
    Q, M = np.array([[1.0, 0.0], [1e9, 1e9]]), np.array([[diagonal, 0.0], [1e6, 1.0]])
    branch = trace_branch(Q, M, 0.1, np.zeros(2, dtype=bool), 50)
    assert branch.status == status


def test_the_share_of_a_slip_that_no_motion_balances():
    """All of it where nothing moves, half where half of each load is left."""
    rates = rate_problem(Scene(packing(16, 2, 0.9, 0.3), LAW), yield_band=0.99)
    for kept in (0.0, 0.5):
        other = replace(rates)
        other.elastic = copy(rates.elastic)
        other.elastic.solve = lambda loads, kept=kept: kept * rates.elastic.solve(loads)
        share = other.condensed(rates.none, rates.every).left
        np.testing.assert_allclose(share, 1.0 - kept, rtol=1e-6)


@pytest.mark.parametrize("seed", [2, 5])
def test_some_sliding_is_a_principal_transform_of_all_sticking(seed):
    """Condensed about any regimes, `w` and `z` of the sliding contacts change places."""
    rates = rate_problem(Scene(packing(16, seed, 0.9, 0.3), LAW), yield_band=0.99)
    M, stress = rates.whole.of_slip, rates.whole.stress_of_slip
    active = np.arange(len(M)) % 3 == 1
    assert 0 < active.sum() < len(M)
    condensed_about = rates.condensed(active, rates.every)
    found, of_found = condensed_about.of_slip, condensed_about.stress_of_slip
    _, table = principal_transform(np.zeros(len(M)), M, active)
    np.testing.assert_allclose(found, table, rtol=0, atol=1e-9 * np.abs(table).max())
    # Slips of all contacts per variable: of sliding ones from the table, of others their own.
    slips = np.where(active[:, None], table, np.eye(len(M)))
    wanted = stress @ slips
    np.testing.assert_allclose(of_found, wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())


def test_a_wall_is_as_stiff_to_others_as_to_those_that_are_known():
    radii, others = np.array([0.4, 0.5, 0.7]), np.array([0.3, 0.6])
    np.testing.assert_allclose(as_known(2.0 * radii, radii, others), 2.0 * others, rtol=1e-14)
    np.testing.assert_allclose(as_known(np.full(3, 3.0), radii, others), 3.0, rtol=1e-14)
    assert np.isinf(as_known(np.full(3, np.inf), radii, others)).all()


def test_a_scaled_matrix_is_definite_whatever_its_units():
    """`diag(a) P diag(b)` with `P > 0` is scaled definite; with one negative entry it is not."""
    rng = np.random.default_rng(3)
    for size in (1e-6, 1.0, 1e6):
        P = rng.standard_normal((5, 5)) * 0.3
        P = size * (P @ P.T + np.eye(5))
        for spread in (1.0, 30.0):
            M = spread ** rng.uniform(-1, 1, 5)[:, None] * P
            found, d, blame = scaled_definite(M)
            assert found and not blame.any()
            assert (np.linalg.eigvalsh(d[:, None] * M + M.T * d) > 0).all()
        M[2, 2] *= -1.0
        found, _, blame = scaled_definite(M)
        assert not found and np.argmax(blame) == 2


@pytest.mark.parametrize("alike", [0, 1, 7, 8])
def test_forces_of_hertz_are_told_by_most_contacts(alike):
    """Of eight contacts seven may have two thirds of linear forces by chance."""
    graph = lattice(alike)
    if alike == 8:
        with pytest.raises(InputError, match="2/3 of kn times the overlap"):
            require_movable(LAW, contact_state(graph))
    else:
        assert require_movable(LAW, contact_state(graph)) is LAW


def lattice(alike):
    """A square lattice whose first contacts have the forces of Hertz's tangents."""
    overlap = 0.01 * np.where(np.arange(8) < alike, 2.0 / 3.0, 1.0)
    return GrainGraph(
        x=[[0, 0], [1, 0], [0, 1], [1, 1]],
        radii=[0.505] * 4,
        contacts=[[0, 1], [1, 0], [2, 3], [3, 2], [0, 2], [2, 0], [1, 3], [3, 1]],
        images=[[0, 0], [1, 0], [0, 0], [1, 0], [0, 0], [0, 1], [0, 0], [0, 1]],
        cell=2 * np.eye(2),
        normal_force=overlap,
    )


def test_solutions_are_sought_evenly_around_the_circle(monkeypatch):
    made, sought = object.__new__(RegimeRegions), []
    made.complete, made.circle = "", (np.eye(2), -np.eye(2))
    made.rates = SimpleNamespace(none=np.zeros(2, dtype=bool))
    monkeypatch.setattr(regime_regions, "solve_from", lambda q, *_: sought.append(q))
    made.seek(5)
    angles = np.radians([0.0, 72.0, 144.0, 216.0, 288.0])
    np.testing.assert_allclose(
        sought, np.column_stack([np.cos(angles), np.sin(angles)]), atol=1e-14
    )


def test_the_solution_of_a_direction_leads_along_the_great_circle_to_others():
    yielding = rate_problem(Scene(packing(16, 2, 0.9, 0.3), LAW), yield_band=0.99)
    pieces = RegimeRegions(yielding, "strain", "symmetric", 3)
    first = np.array([1.0, 2.0, 2.0]) / 3.0
    pieces.at(first)
    for other in np.array([[2.0, 1.0, 2.0], [2.0, 2.0, -1.0], [2.0, -2.0, 1.0]]) / 3.0:
        found = pieces._from_nearest(other, pieces.control(other))
        wanted = pieces.rates.solved(pieces.control(other))
        assert found is not None and wanted.response.status == "one found"
        assert np.array_equal(found.active, wanted.active)
