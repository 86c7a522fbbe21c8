"""Small packings and all that is computed of them: `python -m tests.loops.packing.whole_operators`.

It stores what the packings give now; `test_whole_operators.py` compares. Say in the commit why a
number moved.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from loops import (
    Boundary,
    GrainGraph,
    LinearFrictional,
    PlaneContacts,
    Regime,
    Scene,
    boundary_of,
    find_faces,
)
from loops.gears import spin_modes
from loops.in_place import inverse_at_contacts
from loops.system import balancing_forces, in_freedoms, relative_motion, stiffness_matrix
from patterns import synthetic_network
from stability.factor import Factor
from tests.packings import (
    LAW,
    loops_in_place,
    outline_grains,
    packing,
    packing_system,
    plane_contacts,
    with_idle_triangle,
)

WORDS, NUMBERS = (Path(__file__).with_suffix(suffix) for suffix in (".json", ".npz"))


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
# Further ways to the operators of loops.
BLOCKS = {
    "periodic blocks": ("several fronts", {"method": "blocks", "block": 4.0, "buffer": 1.5}),
    "held blocks": ("held", {"method": "blocks", "block": 3.0, "buffer": 2.0}),
}


def in_place(case, **how):
    """Operators of the loops of a packing."""
    graph, law, options = CASES[case]
    regime, boundary = (options.get(name) for name in ("regime", "boundary"))
    given = graph if regime is None else graph.replace(regime=regime)
    found = loops_in_place(Scene(given, law, boundary), threads=1, **how)
    return {"boundary": found.system.boundary}, {
        "matrix": found.matrix,
        "alone": found.alone,
        "surroundings": found.surroundings,
        "error": found.error,
        "matrix_error": found.matrix_error,
        "alone_error": found.alone_error,
        "surroundings_error": found.surroundings_error,
    }


def system_of(case):
    """The linear system of a packing, solves with it, and the inverse at its contacts."""
    graph, law, options = CASES[case]
    scene = Scene(graph, law, options.get("boundary"))
    system = packing_system(scene, regime=options.get("regime"))
    carrying = system.carrying
    words = {
        "grains": np.flatnonzero(~carrying.grains).tolist(),
        "contacts": np.flatnonzero(~carrying.contacts).tolist(),
        "anchors": carrying.anchors.tolist(),
        "counts": [carrying.rattlers, carrying.clusters, carrying.clustered, system.held],
        "regime": system.regime.tolist(),
        "freedom": system.freedom.tolist(),
        "ends": system.ends.tolist(),
        "size": system.size,
        "boundary": system.boundary,
    }
    wave = np.cos(1.0 + np.arange(system.size))[:, None] * [1.0, -0.5]
    strain = np.array([[[0.3, 1.0], [0.1, 0.0]], [[-0.2, 0.5], [0.4, 0.2]]])
    motion = relative_motion(system, wave, strain)
    forces = -np.einsum("eij,ejk->eik", system.stiffness, motion)
    rows = np.arange(0, len(system.ends), 3)
    matrix = stiffness_matrix(system)
    factor = Factor(system)
    balanced = matrix @ wave
    affine = factor.factors.affine @ strain.reshape(4, 2)
    stress = affine / system.volume + factor.stress(wave)
    mode, moves, _ = spin_modes(system.stiffness, system.ends, system.size)
    words["mode"] = mode.tolist()
    return words, {
        "branches": system.branches,
        "stiffness": system.stiffness,
        "sizes": np.array([system.length, system.unit, system.volume]),
        "motion": motion,
        "single motion": relative_motion(system, wave[:, 0]),
        "forces": balancing_forces(system, forces),
        "stress": stress.reshape(2, 2, 2),
        "rows": in_freedoms(system, rows, motion[rows, :, 0]) @ wave,
        "matrix": balanced,
        "solved": matrix @ factor.solve(balanced),
        "spins": moves,
        "inverse": inverse_at_contacts(system, threads=1),
    }


def feet():
    """Wall contacts from the forces on grains."""
    graph, grain, branch, kn = square()
    away = -branch * (1.0 - 0.01 * kn[:, None] * (np.arange(len(kn)) % 4 > 0)[:, None])
    force = kn[:, None] * (0.01 * np.sign(away)) * (np.arange(len(kn)) % 4 > 0)[:, None]
    found = plane_contacts(graph, grain, force, away)
    return {"grain": found.grain.tolist(), "regime": found.regime.tolist()}, {
        "branch": found.branch, "kn": found.kn, "kt": found.kt
    }  # fmt: skip


def everything():
    """Words and numbers of all cases, by their names."""
    for case in CASES:
        yield f"system, {case}", lambda case=case: system_of(case)
        if case != "smooth walls":
            yield f"in place, {case}", lambda case=case: in_place(case)
    for name, (case, how) in BLOCKS.items():
        yield f"in place, {name}", lambda case=case, how=how: in_place(case, **how)
    yield "wall contacts", feet


def short(values):
    """The numbers, or sums of every hundredth of many, each times a number of its own."""
    if values.size <= 1000:
        return np.ravel(values)
    known = np.isfinite(values.ravel())
    weight = np.where(known, np.cos(np.arange(values.size)), 0.0)
    place = np.arange(values.size) % 100
    sums = np.bincount(place, weight * np.where(known, values.ravel(), 0.0))
    return np.append(sums, np.count_nonzero(known))


def flat(numbers):
    """All numbers one after the other."""
    return np.concatenate([short(values) for values in numbers.values()])


if __name__ == "__main__":
    words, numbers = {}, {}
    for name, answer in everything():
        words[name], found = answer()
        numbers[name] = flat(found)
        print(f"{name}: {len(numbers[name])} numbers")
    lines = [f"{json.dumps(name)}: {json.dumps(value)}" for name, value in words.items()]
    WORDS.write_text("{\n" + ",\n".join(lines) + "\n}\n")
    np.savez_compressed(NUMBERS, **numbers)
