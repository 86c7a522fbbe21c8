"""Decisions of the solver of a loop's path, taken by themselves, in any units."""

from types import SimpleNamespace

import numpy as np
import pytest

from loops import GrainGraph, LinearFrictional, Regime, contact_state
from loops.laws.frictional import TOUCHING_RTOL
from patterns import regular_polygon
from stability import Stage, programmes
from stability.paths.loop_path import RELEASE, LoopPathOptions, LoopPathSolver
from stability.paths.model import path_model
from stability.paths.state import Mode, initial_state

UNITS = [(1.0, 1.0), (2.0**-9, 2.0**30), (2.0**9, 2.0**-30)]
STAGE = Stage(programmes.isotropic_strain(), "H11", 0.1)


def solver_of(graph, law, closure="traction", **options):
    model = path_model(graph, contact_state(graph), law, closure, "blocked", None)
    mode = Mode(np.full(len(graph.contacts), Regime.ELASTIC, dtype=np.int8),
                np.zeros(len(graph.contacts)))  # fmt: skip
    return LoopPathSolver(
        model, initial_state(model, contact_state(graph)), mode, LoopPathOptions(**options),
        1e-14, 0, 10, (STAGE.programme,),
    )  # fmt: skip


def square(length, kn, overlap=0.0):
    """A square with sides of one length, its law and forces in some units."""
    loop, law = regular_polygon(4), LinearFrictional(kn, 0.3 * kn, 0.2)
    graph = GrainGraph(
        x=length * loop.x, radii=(1.0 + overlap) * length * loop.radii, contacts=loop.contacts
    )
    return graph.replace(normal_force=law.normal_force(contact_state(graph))), law


@pytest.mark.parametrize(("length", "kn"), UNITS)
def test_forces_that_count_as_none_are_a_share_of_stiffness_and_length(length, kn):
    """Normal forces `kn` times the overlap of grains of diameter 1, sides of 1."""
    for share in (0.5, 2.0):
        solver = solver_of(*square(length, kn, share * RELEASE))
        assert solver._carries_nothing(solver.at(STAGE.programme)) == (share < 1.0)
        force = np.array([0.0, share * RELEASE * kn * length, 0.0, 0.0])
        for normal, shear in ((force, 0.0 * force), (0.0 * force, -force)):
            contacts = SimpleNamespace(normal_force=normal, shear_force=shear)
            end = SimpleNamespace(fired=[("opening", 1)], here=SimpleNamespace(contacts=contacts))
            found = solver._outcome(STAGE, end)
            assert (found is None) == (share < 1.0)
            assert found is None or (found[0] == "lost" and "contacts [1] part" in found[1])


def test_a_loop_that_came_apart_tells_how_many_contacts_are_open():
    solver = solver_of(*square(1.0, 1.0))
    solver.mode.regime[2] = Regime.OPEN
    status, message = solver._came_apart()
    assert status == "no_load" and "(1 of 4 open)" in message


@pytest.mark.parametrize(("length", "kn"), UNITS)
def test_grains_that_overlap_by_more_than_rounding_press_at_once(length, kn):
    """Two opposite grains of a square are moved together."""
    for share, regime in ((0.5, Regime.OPEN), (2.0, Regime.ELASTIC)):
        solver = solver_of(*square(length, kn), contact_on_touch="add", model="full")
        x = solver.model.x0
        d = x[2] - x[0]
        way = np.hypot(*d) - length * (1.0 - share * TOUCHING_RTOL)
        place = np.zeros((4, 2))
        place[0] = way * d / np.hypot(*d)
        solver.y[: place.size] = place.ravel()
        end = SimpleNamespace(fired=[("opposite_contact", 0)], pairs=np.array([[0, 2]]))
        solver._take_on_contacts(end)
        assert solver.mode.regime.tolist() == [Regime.ELASTIC] * 4 + [regime]
