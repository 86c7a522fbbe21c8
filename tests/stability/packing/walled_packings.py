"""Small packings between walls, and the periodic packing of one and its mirror images."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from grainloops import replay
from loops import Boundary, GrainGraph, LinearFrictional, PlaneContacts, Scene
from patterns import Snapshot, WallContacts
from tests.packings import BRANCH, LAW, jammed

# As in `tests.packings`: told here, for a replay turns on rounding.
STORED = Path(__file__).with_suffix(".npz")
NAMES = ("x", "radii", "contacts", "normal_force", "shear_force")
WALLS = ("grain", "branch", "kn", "kt", "mu")
SMOOTH, ROUGH = (2.0, 0.0, 0.0), (2.0, 1.0, 0.4)
JAMMED = (
    (12, 6, BRANCH, SMOOTH),
    (24, 1, LAW, SMOOTH),
    (36, 5, LAW, SMOOTH),
    (16, 6, BRANCH, ROUGH),
    (36, 3, LAW, ROUGH),
)


def between(planes, force=None, **volume):
    """The boundary of a packing between walls with these forces on the grains."""
    if force is not None:
        planes = replace(planes, force=force)
    return Boundary(walls=planes, **volume)


def some_of(planes, rows):
    """Some contacts with walls, and their forces."""
    by_contact = {k: v[rows] for k, v in vars(planes).items() if v is not None and k != "fixed"}
    return replace(planes, **by_contact)


def jammed_in_box(grains, seed, law=LAW, wall=SMOOTH):
    """A jammed packing between walls with `kn`, `kt` and `mu`: graph, planes and their forces."""
    with np.load(STORED) as stored:
        key = _key(grains, seed, law, wall)
        graph = GrainGraph(**{name: stored[f"{key} {name}"] for name in NAMES})
        planes = PlaneContacts(*(stored[f"{key} wall {name}"] for name in WALLS))
        return graph, planes, stored[f"{key} wall force"]


def small_sample(ends, law):
    """A snapshot of 24 grains that ends at a 'cell', at 'walls' or at an 'outline'."""
    walls = None
    if ends == "cell":
        graph = jammed(24, 3)
    else:
        graph, planes, force = jammed_in_box(24, 1)
        if ends == "walls":
            walls = WallContacts(planes.grain, force, -planes.branch, planes.kn, planes.kt)
    regime = np.ones(graph.contact_count, dtype=np.int8)
    ids = np.arange(graph.grain_count)
    rows = 0 if walls is None else len(walls.grain)
    return Snapshot(graph, law, regime, ids, rows, (), walls, rotation=0.0 * ids)


def split(state, wall):
    """Graph, planes and forces of a state."""
    graph, rows = state.graph(), state.closed & state.at_wall
    grain, branch = state.contacts[rows, 0], state.branches[rows]
    same = (np.full(len(grain), float(k)) for k in wall)
    return graph, PlaneContacts(grain, branch, *same), -state.forces[rows]


def mirrored(graph, planes, plane_force, box):
    """The packing with its images in the right and the upper wall, periodic: grains by copy.

    A contact with a smooth wall becomes one with the grain's own image, half as stiff.
    """
    (left, right), (low, high) = box
    W, L, G = right - left, high - low, graph.grain_count
    copies = [(s, t) for t in (0, 1) for s in (0, 1)]
    x = graph.x - [left, low]
    place = np.vstack([
        np.column_stack([2 * W - x[:, 0] if s else x[:, 0], 2 * L - x[:, 1] if t else x[:, 1]])
        for s, t in copies
    ])  # fmt: skip
    contacts, images, N, T = [], [], [], []
    for k, (s, t) in enumerate(copies):
        contacts.append(graph.contacts + k * G)
        images.append(np.zeros_like(graph.contacts))
        N.append(graph.normal_force)
        T.append(graph.shear_force * (-1) ** (s + t))
    normal = np.sum(plane_force * -planes.branch, axis=1) / np.linalg.norm(planes.branch, axis=1)
    for g, b, n in zip(planes.grain, planes.branch, normal, strict=True):
        axis = int(abs(b[1]) > abs(b[0]))
        far = b[axis] > 0
        for other in (0, 1):
            here = (0, other) if axis == 0 else (other, 0)
            there = (1, other) if axis == 0 else (other, 1)
            contacts.append([[g + G * copies.index(here), g + G * copies.index(there)]])
            image = np.zeros(2, dtype=int)
            image[axis] = 0 if far else -1
            images.append([image])
            N.append([n])
            T.append([0.0])
    return GrainGraph(
        x=place, radii=np.tile(graph.radii, 4), contacts=np.vstack(contacts),
        images=np.vstack(images), cell=np.diag([2 * W, 2 * L]),
        normal_force=np.concatenate(N), shear_force=np.concatenate(T),
    )  # fmt: skip


def _key(grains, seed, law, wall):
    return f"{grains} {seed} {law.shear_increment} {wall}"


def _jam(grains, seed, law, wall, shear=(1e-3, -1e-3)):
    rng = np.random.default_rng(seed)
    radii = rng.uniform(0.4, 0.6, grains)
    across = int(np.ceil(np.sqrt(grains)))
    slots = rng.permutation(across**2)[:grains]
    x = 1.25 * np.column_stack(np.divmod(slots, across)) + rng.uniform(-0.05, 0.05, (grains, 2))
    loose = LinearFrictional(1.0, 0.5, 0.1, law.shear_increment)
    lower, upper = np.array([-0.625] * 2), np.array([1.25 * across - 0.625] * 2)
    # Walls are known by a contact each, here without a force; so is a pair of grains.
    nearest = np.concatenate([np.argmin(x, axis=0), np.argmax(x, axis=0)])
    away = np.vstack([lower - x[nearest[:2]], upper - x[nearest[2:]]])
    feet = away * np.vstack([np.eye(2), np.eye(2)])
    planes = PlaneContacts(nearest, feet, *(np.full(4, k) for k in wall))
    graph = GrainGraph(x=x, radii=radii, contacts=[[0, 1]])
    quiet, force = {"damping": 0.3, "viscous": 0.05}, None
    for density in np.arange(0.76, 0.92, 0.02):
        area = float(np.prod(upper - lower))
        change = 1 - np.sqrt(np.pi * np.sum(radii**2) / density / area)
        how = dict(boundary=between(planes, force), duration=400.0, **quiet)
        end = replay(Scene(graph, loose), change * np.eye(2), **how).state
        graph, planes, force = split(end, wall)
        lower, upper = end.x[-4:].min(axis=0), end.x[-4:].max(axis=0)
        if graph.normal_force.sum() > 0.004 * graph.grain_count:
            break
    for strain in (np.diag(shear), np.zeros((2, 2))):
        how = dict(boundary=between(planes, force), duration=4000.0, **quiet)
        graph, planes, force = split(replay(Scene(graph, law), strain, **how).state, wall)
    return graph, planes, force


def _store():
    found = {}
    for which in JAMMED:
        graph, planes, force = _jam(*which)
        key = _key(*which)
        found |= {f"{key} {name}": getattr(graph, name) for name in NAMES}
        found |= {f"{key} wall {name}": getattr(planes, name) for name in WALLS}
        found[f"{key} wall force"] = force
    np.savez_compressed(STORED, **found)


if __name__ == "__main__":
    _store()
