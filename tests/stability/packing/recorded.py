"""Whole answers of small packings, number by number: motions, rest, probes, indicators.

`python -m tests.stability.packing.recorded [CASE ...]` stores them anew in `recorded.json`; read
the change with `git diff --word-diff`, and say in the commit why each number moved.
"""

import json
import sys
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import numpy as np

from grainloops import hold, indicators, probe, replay
from loops import LinearFrictional, Scene, boundary_of, find_faces
from loops.contacts import Contacts
from stability import Stage, programmes
from stability.packing import HeldPacking, PackingResponse, Probe
from stability.packing.loop_quantities import least_squares_nonaffinity
from stability.path import Path as AnyPath
from tests.laws import hertz_of
from tests.packings import BRANCH, LAW, jammed, loop_changes, packing
from tests.stability.packing.walled_packings import JAMMED, between, jammed_in_box

STORED = Path(__file__).with_suffix(".json")
# Rounding itself, what follows from the other fields, and what these packings do not have.
LEFT_OUT = {"residual", "system", "cell0", "radii", "slopes", "rolling_moment"}
# Fields that are younger than the stored answers.
LEFT_OUT |= {"families", "singular", "at_yield", "ids"}
# Fields of a replay that are stored.
OF_REPLAYS = "state velocity spin steps time_step duration states".split()
PURE = np.array([[2e-3, 2e-4], [0.0, -2e-3]])
DRAINED = programmes.drained_biaxial()


def plain(value):
    """Numbers, texts, lists and dicts; of a long array its shape and three sums."""
    if isinstance(value, (PackingResponse, Probe)):
        left = np.where(value.residual > 1e-6, value.residual, 0.0)
        return named(value) | {"residual": plain(left)}
    if isinstance(value, Contacts) and np.abs(value.x.mean(axis=0)).max() > 1e-12:
        # A periodic packing drifts as a whole by rounding.
        return plain(replace(value, x=value.x - value.x.mean(axis=0)))
    if isinstance(value, HeldPacking):
        # Stored as the contacts with walls, and their forces.
        walls = value.boundary.walls
        return {name: one for name, one in named(value).items() if name != "boundary"} | {
            "planes": plain(None if walls is None else replace(walls, force=None)),
            "plane_force": plain(np.zeros((0, 2)) if walls is None else walls.force),
        }
    if isinstance(value, AnyPath):
        return {name: plain(getattr(value, name)) for name in OF_REPLAYS}
    if is_dataclass(value) and not isinstance(value, type):
        return named(value)
    if hasattr(value, "_asdict"):
        return {name: plain(one) for name, one in value._asdict().items() if name not in LEFT_OUT}
    if isinstance(value, dict):
        return {str(name): plain(one) for name, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(one) for one in value]
    if isinstance(value, np.ndarray):
        if value.dtype.kind in "US" or value.size <= 12:
            return plain(value.tolist())
        flat, k = value.ravel(), np.arange(value.size)
        known = np.isfinite(flat) if value.dtype.kind == "f" else np.ones(len(flat), dtype=bool)
        flat = np.where(known, flat, 0).astype(float)
        sums = [float(np.abs(flat).sum()), *(float(flat @ np.cos(a * k)) for a in (0.9, 2.1))]
        return {"shape": list(value.shape), "known": int(known.sum()), "sums": sums}
    if isinstance(value, np.generic):
        return plain(value.item())
    return value if isinstance(value, (int, float, str, bool, type(None))) else str(value)


def named(value):
    """Fields of an answer by name, without what it keeps for itself."""
    # Without cohesion what is closed follows from the forces; the law is that of the case.
    left_out = LEFT_OUT | ({"closed", "law"} if isinstance(value, Contacts) else set())
    given = [one.name for one in fields(value) if one.init]
    names = [name for name in given if name not in left_out and name[0] != "_"]
    return {name: plain(getattr(value, name)) for name in names}


def small_box(k=0):
    grains, seed, law, wall = JAMMED[k]
    graph, planes, force = jammed_in_box(grains, seed, law, wall)
    return graph, law, {"boundary": between(planes, force)}


def moved(graph, size, seed=1):
    """The packing with its grains a little beside their places: out of balance."""
    kick = np.random.default_rng(seed).standard_normal(graph.x.shape)
    return graph.replace(x=graph.x + size * kick)


def with_own(value, *names):
    """The fields and these properties."""
    return plain(value) | {name: plain(getattr(value, name)) for name in names}


CASES = {}


def case(function):
    CASES[function.__name__] = function
    return function


@case
def motions():
    """Replays: strains, servos, velocities, walls, another law."""
    graph = jammed(12, 1, LAW)
    rng = np.random.default_rng(1)
    kick, turn = 1e-3 * rng.standard_normal((12, 2)), 1e-3 * rng.standard_normal(12)
    drained = Stage(DRAINED, "H11", 1e-3)
    for found in (
        replay(Scene(graph, LAW), PURE, inertial_number=1e-3),
        replay(
            Scene(graph, LAW), PURE, duration=50.0, time_step=0.1, velocity=kick, spin=turn, rows=3
        ),
        replay(Scene(graph, LAW), drained, duration=200.0, damping=0.1, viscous=0.02),
        replay(Scene(graph, LAW), Stage(programmes.undrained(), "H11", 1e-3), duration=200.0),
        replay(Scene(moved(graph, 1e-4), BRANCH), PURE, duration=50.0, mass=1.0 + np.arange(12)),
        replay(Scene(moved(graph, 1e-4), BRANCH), PURE, duration=50.0, balanced=True),
        replay(Scene(graph, LAW), PURE, duration=50.0, inertia=1.0 + np.arange(12)),
        replay(Scene(graph, hertz_of(graph)), 10 * PURE, duration=100.0),
    ):
        yield with_own(found, "states")
    for k in (0, 3):
        graph, law, walls = small_box(k)
        yield plain(replay(Scene(graph, law, **walls), np.diag([5e-3, -5e-3]), duration=100.0))
        yield plain(replay(Scene(graph, law, **walls), drained, duration=200.0))


@case
def rests():
    """Held at fixed cell, fixed stress, between walls; flowing; not at rest."""
    graph, rng = moved(jammed(12, 1, LAW), 1e-4), np.random.default_rng(1)
    kick, turn = 2e-3 * rng.standard_normal((12, 2)), 1e-3 * rng.standard_normal(12)
    loose = {"unbalanced": 1e-3, "damping": (0.3, 0.5)}
    found = [
        hold(Scene(graph, LAW), velocity=kick, spin=turn, **loose),
        hold(Scene(graph, LAW), velocity=kick, control="stress", mass=1 + np.arange(12), **loose),
        hold(
            Scene(graph, LAW),
            velocity=5 * kick,
            unbalanced=1e-10,
            most_steps=1000,
            damping=(0.02, 0.03),
        ),
        hold(Scene(graph, hertz_of(graph)), velocity=kick, inertia=1 + np.arange(12.0), **loose),
        hold(Scene(graph, LinearFrictional(1.0, 0.5, 0.05)), control="stress", **loose),
    ]
    for k in (0, 3):
        graph, law, walls = small_box(k)
        walls = {"boundary": replace(walls["boundary"], volume=12.0)}
        kick = 1e-3 * rng.standard_normal((graph.grain_count, 2))
        graph = moved(graph, 1e-4)
        found.append(hold(Scene(graph, law, **walls), velocity=kick, **loose))
    for one in found:
        yield plain(one) | {"text": str(one)}


@case
def probes():
    """In the plane and with shear, under strain and stress, few and many contacts at yield."""
    own = ("theta", "determined", "softest", "between_folds")
    for control in ("strain", "stress"):
        for seed, share in ((2, 0.3), (5, 0.7)):
            graph = packing(16, seed, 0.9, share)
            for found in (
                probe(Scene(graph, LAW), 8, control=control),
                probe(Scene(graph, LAW), 5, control=control, subspace="symmetric"),
            ):
                yield with_own(found, *own) | {"text": str(found)}
                yield plain(found.solutions.work)


@case
def changes_of_loops():
    graph = jammed(16, 2, BRANCH)
    after = replay(Scene(graph, BRANCH), 3 * PURE, duration=100.0).state
    yield plain(loop_changes(graph, after, find_faces(graph)))


@case
def states_of_loops():
    """Structural indicators; what the best linear map leaves of the grains' motions."""
    for graph in (jammed(24, 3, LAW), packing(16, 3, 0.9, 0.3)):
        yield plain(indicators(Scene(graph, LAW), find_faces(graph)))
    graph, law, walls = small_box(3)
    plates = replace(walls["boundary"].walls, force=None)
    boundary = boundary_of(graph, walls=plates)
    yield plain(indicators(Scene(graph, law, boundary), find_faces(graph)))
    graph = packing(16, 1)
    later = np.random.default_rng(1).standard_normal((graph.contact_count, 2))
    later[::7] = np.nan
    yield plain(least_squares_nonaffinity(graph, later))


if __name__ == "__main__":
    stored = json.loads(STORED.read_text()) if STORED.exists() else {}
    for name in sys.argv[1:] or CASES:
        stored[name] = list(CASES[name]())
    lines = [
        f"{json.dumps(name)}: [\n" + ",\n".join(json.dumps(one) for one in found) + "\n]"
        for name, found in sorted(stored.items())
    ]
    STORED.write_text("{\n" + ",\n".join(lines) + "\n}\n")
