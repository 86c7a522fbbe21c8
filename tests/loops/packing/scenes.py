"""Scenes of small packings: periodic, sliding, gears, between walls, held at the outline."""

import numpy as np

from loops import (
    Boundary,
    GrainGraph,
    LinearFrictional,
    PlaneContacts,
    Regime,
    boundary_of,
    find_faces,
)
from patterns import synthetic_network
from tests.packings import LAW, outline_grains, packing, with_idle_triangle


def square(rows=3, columns=4):
    """A square lattice between walls, its corners aside: spins are gears."""
    x = np.array([[i, 0.98 * j] for i in range(columns) for j in range(rows)], dtype=float)
    number = np.arange(rows * columns).reshape(columns, rows)
    contacts = [*zip(number[:-1].ravel(), number[1:].ravel(), strict=True)]
    contacts += [*zip(number[:, :-1].ravel(), number[:, 1:].ravel(), strict=True)]
    radii = 0.5 + 0.01 * (np.arange(len(x)) % 3)
    graph = GrainGraph(x, radii, contacts)
    grain = np.concatenate([number[0], number[-1], number[:, 0], number[:, -1]])
    feet = np.repeat([[-0.5, 0.0], [0.5, 0.0], [0.0, -0.5], [0.0, 0.5]],
                     [rows, rows, columns, columns], axis=0)  # fmt: skip
    kn = 2.0 + 0.1 * np.arange(len(grain))
    return graph, grain, feet, kn


def gears():
    """A periodic square lattice, 4 by 4: all spins turn together, against their neighbours."""
    x = np.array([[i, j] for i in range(4) for j in range(4)], dtype=float)
    contacts, images = [], []
    for i in range(4):
        for j in range(4):
            contacts += [[4 * i + j, 4 * ((i + 1) % 4) + j], [4 * i + j, 4 * i + (j + 1) % 4]]
            images += [[int(i == 3), 0], [0, int(j == 3)]]
    normal = 0.01 + 0.001 * (np.arange(32) % 5)
    return GrainGraph(x, np.full(16, 0.505), contacts, images=images, cell=[[4.0, 0], [0, 4.0]],
                      normal_force=normal, shear_force=0.1 * normal)  # fmt: skip


def ladders():
    """Two ladders of four rungs that wind around a cell: each one's spins are gears."""
    x = np.array([[i, 3.0 * k + j] for k in (0, 1) for i in range(4) for j in (0, 0.98)])
    contacts, images = [], []
    for k in (0, 8):
        for i in range(4):
            a, b = k + 2 * i, k + 2 * ((i + 1) % 4)
            contacts += [[a, a + 1], [a, b], [a + 1, b + 1]]
            images += [[0, 0], [int(i == 3), 0], [int(i == 3), 0]]
    return GrainGraph(x, np.full(16, 0.505), contacts, images=images, cell=[[4.0, 0], [0, 6.0]])


def _cases():
    plain = LinearFrictional(1.0, 0.5)
    walled, grain, feet, kn = square()
    smooth = PlaneContacts(grain, feet, kn, np.zeros(len(kn)))
    rough = PlaneContacts(grain, feet, kn, 0.4 * kn)
    some = synthetic_network(60, seed=1, coordination=4.6)
    loose = synthetic_network(40, seed=4, periodic=True, coordination=3.6)
    more = synthetic_network(130, seed=3, periodic=True, coordination=4.6)
    slides = packing(24, seed=2, sliding=0.15)
    given = np.where(np.arange(slides.contact_count) % 7, Regime.ELASTIC, Regime.SLIDING)
    given[5] = Regime.OPEN
    return {
        "periodic": (packing(16), LAW, {}),
        "sliding": (slides, LAW, {}),
        "given regimes": (slides, LAW, {"regime": given.astype(np.int8)}),
        "idle triangle": (with_idle_triangle(packing(16, seed=3)), LAW, {}),
        "loose": (loose, LAW, {}),
        "gears": (gears(), plain, {}),
        "two gears": (ladders(), plain, {}),
        "gears held": (
            ladders(),
            plain,
            {"boundary": boundary_of(ladders(), held=np.arange(16) % 9 == 0)},
        ),
        "smooth walls": (walled, plain, {"boundary": Boundary(walls=smooth, volume=9.0)}),
        "rough walls": (walled, plain, {"boundary": Boundary(walls=rough, volume=9.0)}),
        "held": (
            some,
            plain,
            {"boundary": Boundary(held=outline_grains(some, find_faces(some)), volume=9.0)},
        ),
        "several fronts": (more, LAW, {}),
    }


CASES = _cases()
