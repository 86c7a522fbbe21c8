"""Paths of packings under Hertz and Mindlin's law: closed form, halving, energy, linear limit."""

import numpy as np
import pytest

from grainloops import replay
from loops import GrainGraph, HertzMindlin, Scene, contact_state
from stability import follow
from tests.packings import strained
from tests.stability.packing.walled_packings import JAMMED

ROUGH = next(which for which in JAMMED if which[3][1] > 0)


def square(overlap):
    """A lattice of discs of diameter 1, four in a cell."""
    side = 1.0 - overlap
    return GrainGraph(
        x=side * np.array([[0, 0], [1, 0], [0, 1], [1, 1]]),
        radii=[0.5] * 4,
        cell=2 * side * np.eye(2),
        contacts=[[0, 1], [1, 0], [2, 3], [3, 2], [0, 2], [2, 0], [1, 3], [3, 1]],
        images=[[0, 0], [1, 0], [0, 0], [1, 0], [0, 0], [0, 1], [0, 0], [0, 1]],
    )  # fmt: skip


@pytest.mark.parametrize("strain", [1e-3, -0.9e-2])
def test_a_lattice_under_isotropic_strain_in_closed_form(strain):
    """`N = (4/3) E* sqrt(R*) delta^1.5`, `P11 = N l/A` over the first cell."""
    law, first = HertzMindlin(3.0, 0.3, 0.5), 1e-2
    graph = square(first)
    graph = graph.replace(normal_force=law.normal_force(contact_state(graph)))
    path = follow(Scene(graph, law), strained(strain * np.eye(2)), closure="packing", interval=1e-4)
    l0 = 1.0 - first
    delta = 1.0 - l0 * (1.0 - strain)
    factor = 4 / 3 * 3.0 / (2 * (1 - 0.3**2)) * np.sqrt(0.25)
    np.testing.assert_allclose(path.states[-1].normal_force[:8], factor * delta**1.5, rtol=1e-11)
    assert path.P[-1][0] == pytest.approx(factor * delta**1.5 / l0, rel=1e-11)
    stored = 8 * 0.4 * factor * (delta**2.5 - first**2.5)
    assert path.work[-1, 0] == pytest.approx(stored, rel=1e-9)


@pytest.mark.parametrize("strain", [1e-3, -0.9e-2])
def test_a_lattice_replayed_under_isotropic_strain_in_closed_form(strain):
    """Centres move with the cell, so forces are exact however fast the strain is."""
    law, first = HertzMindlin(3.0, 0.3, 0.5), 1e-2
    graph = square(first)
    graph = graph.replace(normal_force=law.normal_force(contact_state(graph)))
    end = replay(Scene(graph, law), strain * np.eye(2), inertial_number=1e-3).state
    side = (1.0 - first) * (1.0 - strain)
    N = 4 / 3 * 3.0 / (2 * (1 - 0.3**2)) * np.sqrt(0.25) * (1.0 - side) ** 1.5
    # Thousands of steps round positions by 1e-13 in all, over overlaps of 1e-3.
    np.testing.assert_allclose(end.normal_force[:8], N, rtol=1e-9)
    np.testing.assert_allclose(end.stress, N / side * np.eye(2), rtol=1e-9, atol=1e-14)
