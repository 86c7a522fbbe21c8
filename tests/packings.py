"""Small periodic packings for tests, their own path by another route, and what is asked of them.

Names of inner rooms that many tests of packings ask are taken from here: a wall moves once.

`python -m tests.packings` writes the jammed ones again.
"""

from itertools import product
from pathlib import Path

import numpy as np
from scipy.optimize import fsolve

from grainloops import replay
from loops import GrainGraph, LinearFrictional, Regime, Scene, branch_vectors, contact_state
from loops.arrays import frobenius as frobenius
from loops.boundary import outline_grains as outline_grains
from loops.boundary import plane_contacts as plane_contacts
from loops.contacts import contacts_of as contacts_of
from loops.contacts import start_state as start_state
from loops.in_place import loops_in_place as loops_in_place
from loops.system import packing_system as packing_system
from patterns import Snapshot, read_snapshot, sample_path, synthetic_network, write_snapshot
from stability import Programme, Stage
from stability.packing import loop_changes as loop_changes
from stability.packing import loop_rates as loop_rates
from tests.oracles.lattices import lattice

LAW = LinearFrictional(1.0, 0.5, 0.5, "radii")


def packing(grains=16, seed=1, share=0.9, sliding=0.0, law=LAW):
    """A periodic packing whose contacts are inside the cone up to `share`, some on it."""
    cell = [[4.0, 0.3], [-0.2, 3.7]] if grains < 20 else [[6.0, 0.5], [0.0, 5.0]]
    graph = synthetic_network(grains, seed=seed, cell=cell, coordination=4.8)
    rng = np.random.default_rng(seed)
    normal = 0.01 * rng.uniform(0.5, 1.5, graph.contact_count)
    ratio = share * rng.uniform(-1, 1, graph.contact_count)
    at_yield = rng.random(graph.contact_count) < sliding
    ratio = np.where(at_yield, np.sign(ratio), ratio)
    return graph.replace(normal_force=normal, shear_force=ratio * float(law.mu) * normal)


def with_idle_triangle(graph):
    """The packing with three grains more, in touch with one another and without a force."""
    count = graph.grain_count
    corners = graph.x[0] + 0.01 * np.array([[30.0, 0.0], [31.0, 0.0], [30.0, 1.0]])
    return GrainGraph(
        x=np.vstack([graph.x, corners]),
        radii=np.append(graph.radii, [0.01] * 3),
        contacts=np.vstack([graph.contacts, count + np.array([[0, 1], [1, 2], [0, 2]])]),
        normal_force=np.append(graph.normal_force, [0.0] * 3),
        shear_force=np.append(graph.shear_force, [0.0] * 3),
        images=np.vstack([graph.images, [[0, 0]] * 3]),
        cell=graph.cell,
    )


def strained(strain):
    """The stage that prescribes a displacement gradient."""
    given = Programme("strain", np.zeros((4, 4)), np.eye(4), np.ravel(strain))
    return Stage(given, "parameter", 1.0)


def small_series(folder, count=3):
    """Files of a jammed packing that is compressed along axis 1 and loses contacts."""
    graph, folder = jammed(24, 3), Path(folder)
    folder.mkdir()
    moved = replay(Scene(graph, LAW), [[6e-3, 0], [0, -6e-3]], duration=500.0, rows=count - 1)
    files = [folder / f"grains_{k}.parquet" for k in range(count)]
    for file, state in zip(files, moved.states, strict=True):
        own = state.graph()
        regime = LAW.regime(contact_state(own))
        write_snapshot(file, Snapshot(own, LAW, regime, np.arange(24), 0, ()))
    return files


def repeated(times):
    """A state of a slow compression (Yade, 2,000 discs), its cell repeated along either axis."""
    folder = sample_path("slow")
    cell = np.loadtxt(folder / "cells.csv", delimiter=",", skiprows=1, max_rows=1)[1:5]
    snapshot = read_snapshot(folder / "grains_10.parquet", cell=cell.reshape(2, 2))
    graph, law = snapshot.graph, snapshot.mechanics()[0]
    at = np.array(list(product(range(times), repeat=2)))
    count, copies = graph.grain_count, len(at)
    there = at[:, None] + graph.images
    first = count * np.arange(copies)[:, None]
    second = count * ((there % times) @ [times, 1])
    large = GrainGraph(
        x=(graph.x + (at @ graph.cell.T)[:, None]).reshape(-1, 2),
        radii=np.tile(graph.radii, copies),
        contacts=np.stack([graph.contacts[:, 0] + first, graph.contacts[:, 1] + second], -1)
        .reshape(-1, 2),
        normal_force=np.tile(graph.normal_force, copies),
        shear_force=np.tile(graph.shear_force, copies),
        images=(there // times).reshape(-1, 2),
        cell=times * graph.cell,
        regime=np.full(copies * graph.contact_count, Regime.ELASTIC, dtype=np.int8),
    )  # fmt: skip
    return large, law.take(np.tile(np.arange(graph.contact_count), copies))


def touching_lattice(vectors, branches, cells):
    """Discs of diameter 1 and a lattice's branches of 0.99, shear forces none."""
    count, forces = cells[0] * cells[1], np.full(len(branches), 0.01)
    graph = lattice(0.99 * np.array(vectors), branches, forces, 0 * forces, cells)
    return graph.replace(radii=[0.5] * count)


def diamonds():
    """A diamond of 35 degrees repeated, two grains each way."""
    angle = np.radians(35)
    sides = [[np.cos(angle)] * 2, [np.sin(angle), -np.sin(angle)]]
    return touching_lattice(sides, [(1, 0), (0, 1)], (2, 2))


def forces_after(graph, law, regime, H, u, w):
    """Branches and forces after a step: `N` exact, `T` from the turned branch and the spins."""
    d0 = branch_vectors(graph)
    i, j = graph.contacts.T
    d = d0 - d0 @ H.T + u[j] - u[i]
    l0, length = np.linalg.norm(d0, axis=1), np.linalg.norm(d, axis=1)
    turn = np.arctan2(d0[:, 0] * d[:, 1] - d0[:, 1] * d[:, 0], np.sum(d0 * d, axis=1))
    radii = graph.radii[i], graph.radii[j]
    if law.shear_increment == "radii":
        slip = (radii[0] + radii[1]) * turn - radii[0] * w[i] - radii[1] * w[j]
    else:
        mean = 0.5 * (l0 + length)
        arms = 0.5 * (mean + radii[0] - radii[1]), 0.5 * (mean + radii[1] - radii[0])
        slip = mean * turn - arms[0] * w[i] - arms[1] * w[j]
    N = graph.normal_force - law.kn * (length - l0)
    stuck = graph.shear_force - law.kt * slip
    T = np.where(regime == Regime.SLIDING, np.sign(graph.shear_force) * law.mu * N, stuck)
    n = d / length[:, None]
    force = N[:, None] * n + T[:, None] * np.column_stack([-n[:, 1], n[:, 0]])
    arms = 0.5 * (length + radii[0] - radii[1]), 0.5 * (length + radii[1] - radii[0])
    load = np.zeros((graph.grain_count, 3))
    np.add.at(load[:, :2], j, force)
    np.add.at(load[:, :2], i, -force)
    np.add.at(load[:, 2], i, -arms[0] * T)
    np.add.at(load[:, 2], j, -arms[1] * T)
    return d, force, load, np.abs(stuck) - law.mu * N


def step(graph, law, regime, H, guess):
    """Equilibrium after the displacement gradient `H`; the first state's loads stay."""
    shape = (graph.grain_count, 3)
    still = np.zeros(shape)
    start = forces_after(graph, law, regime, np.zeros((2, 2)), still[:, :2], still[:, 2])[2]
    loose = np.bincount(graph.contacts.ravel(), minlength=len(still)) == 0

    def unbalance(flat):
        v = flat.reshape(shape)
        left = forces_after(graph, law, regime, H, v[:, :2], v[:, 2])[2] - start
        left[loose] = v[loose]
        left[0, :2] += v[0, :2]
        return left.ravel()

    v, _, found, message = fsolve(unbalance, guess.ravel(), full_output=True, xtol=1e-14)
    assert np.abs(unbalance(v)).max() < 1e-13 or found == 1, message
    v = v.reshape(shape)
    return forces_after(graph, law, regime, H, v[:, :2], v[:, 2])


def balanced(graph):
    """The same packing with the forces nearest to its own that leave every grain in balance."""
    state, (i, j) = contact_state(graph), graph.contacts.T
    count = graph.contact_count
    matrix = np.zeros((graph.grain_count, 3, 2, count))
    for c in range(count):
        frame = np.column_stack([state.n[c], state.t[c]])
        matrix[j[c], :2, :, c] += frame
        matrix[i[c], :2, :, c] -= frame
        matrix[i[c], 2, 1, c] -= state.arm_i[c]
        matrix[j[c], 2, 1, c] -= state.arm_j[c]
    matrix = matrix.reshape(-1, 2 * count)
    forces = np.concatenate([graph.normal_force, graph.shear_force])
    forces -= np.linalg.pinv(matrix) @ (matrix @ forces)
    return graph.replace(normal_force=forces[:count], shear_force=forces[count:])


# Packings of a replay are told here, for it turns on rounding: another processor has others.
STORED = Path(__file__).with_suffix(".npz")
BRANCH = LinearFrictional(1.0, 0.5, 0.5, "branch")
LIMITS = (
    LinearFrictional(1.0, 0.5, 0.0, "radii"),
    LinearFrictional(1.0, 0.5, np.inf, "branch"),
    LinearFrictional(1.0, 0.0, 0.5),
)
JAMMED = (
    *product(((12, 1), (16, 2), (24, 3), (36, 5)), (LAW, BRANCH)),
    *product(((16, 2),), LIMITS),
)


def jammed(grains=16, seed=1, law=LAW):
    """A jammed packing of discs in balance, sheared a little so that some contacts slide."""
    with np.load(STORED) as stored:
        key = _key(grains, seed, law)
        return GrainGraph(**{name: stored[f"{key} {name}"] for name in NAMES})


NAMES = ("x", "radii", "contacts", "images", "cell", "normal_force", "shear_force")


def _key(grains, seed, law):
    return f"{grains} {seed} {law.kt} {law.mu} {law.shear_increment}"


def _store():
    found = {
        f"{_key(*which, law)} {name}": getattr(graph, name)
        for which, law in JAMMED
        for graph in [_jam(*which, law)]
        for name in NAMES
    }
    np.savez_compressed(STORED, **found)


def _jam(grains, seed, law, shear=(1e-3, -1e-3)):
    rng = np.random.default_rng(seed)
    radii = rng.uniform(0.4, 0.6, grains)
    across = int(np.ceil(np.sqrt(grains)))
    side = 1.25 * across
    loose = LinearFrictional(1.0, 0.5, 0.1, law.shear_increment)
    slots = rng.permutation(across**2)[:grains]
    x = 1.25 * np.column_stack(np.divmod(slots, across)) + rng.uniform(-0.05, 0.05, (grains, 2))
    graph = GrainGraph(x=x, radii=radii, contacts=[[0, 1]], images=[[9, 9]], cell=side * np.eye(2))
    quiet = {"damping": 0.3, "viscous": 0.05}
    for density in (0.75, 0.80, 0.83, 0.86, 0.88, 0.90):
        change = 1 - np.sqrt(np.pi * np.sum(radii**2) / density / abs(np.linalg.det(graph.cell)))
        graph = replay(
            Scene(graph, loose), change * np.eye(2), duration=400.0, **quiet
        ).state.graph()
        if graph.normal_force.sum() > 0.004 * graph.grain_count:
            break
    graph = replay(Scene(graph, law), np.diag(shear), duration=4000.0, **quiet).state.graph()
    return replay(Scene(graph, law), np.zeros((2, 2)), duration=4000.0, **quiet).state.graph()


if __name__ == "__main__":
    _store()
