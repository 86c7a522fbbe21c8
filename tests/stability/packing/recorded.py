"""Whole answers of small packings, number by number: paths, loads, rest, rates, probes, indicators.

`python -m tests.stability.packing.recorded [CASE ...]` stores them anew in `recorded.json`; read
the change with `git diff --word-diff`, and say in the commit why each number moved.
"""

import json
import re
import sys
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from unittest.mock import patch

import numpy as np

from grainloops import hold, indicators, replay
from loops import LinearFrictional, Scene, boundary_of, find_faces
from loops.contacts import PackingState, start_state
from stability import Event, Stage, complementarity, follow, programmes, rates_at
from stability.packing import (
    HeldPacking,
    PackingResponse,
    Probe,
    equations_of_motion,
    loop_changes,
    loop_rates,
    probe,
    regime_factor,
    regime_regions,
    response,
    strain_increment,
    sustain,
)
from stability.packing.loop_quantities import least_squares_nonaffinity
from stability.packing.probe import probe_to
from stability.path import Path as AnyPath
from stability.path import describe
from tests.packings import BRANCH, LAW, LIMITS, jammed, packing, strained
from tests.stability.packing.test_hertz_paths import hertz_of
from tests.stability.packing.test_statuses import small
from tests.stability.packing.test_sustain import SQUARE
from tests.stability.packing.walled_packings import JAMMED, between, jammed_in_box

sustain_module = sys.modules[sustain.__module__]
STORED = Path(__file__).with_suffix(".json")
# Rounding itself, what follows from the other fields, and what these packings do not have.
LEFT_OUT = {"residual", "system", "cell0", "radii", "slopes", "rolling_moment"}
# Fields that are younger than the stored answers.
LEFT_OUT |= {"families", "singular", "at_yield", "ids"}
# Fields of a path of a packing and of an event that are stored; its words tell the others.
OF_PATHS = (
    "status message events parameter stage H P states work energy imbalance intervals limit "
    "limit_spread"
).split()
OF_LOADS = (
    "direction status message first_event limit limit_spread first_instability first_large_load "
    "first_large_strain first_large_spread motions resting H P work energy"
).split()
OF_REPLAYS = "state velocity spin steps time_step duration states".split()
OF_EVENTS = "kind parameter stage index contacts subspace H P".split()
PURE = np.array([[2e-3, 2e-4], [0.0, -2e-3]])
DRAINED = programmes.drained_biaxial()


def plain(value):
    """Numbers, texts, lists and dicts; of a long array its shape and three sums."""
    if isinstance(value, (PackingResponse, Probe)):
        left = np.where(value.residual > 1e-6, value.residual, 0.0)
        return named(value) | {"residual": plain(left)}
    if isinstance(value, PackingState) and np.abs(value.x.mean(axis=0)).max() > 1e-12:
        # A periodic packing drifts as a whole by rounding.
        return plain(replace(value, x=value.x - value.x.mean(axis=0)))
    if isinstance(value, Event):
        told = {name: plain(getattr(value, name)) for name in OF_EVENTS}
        return told | {"detail": describe(value)}
    if isinstance(value, HeldPacking):
        # Stored as the contacts with walls, and their forces.
        walls = value.boundary.walls
        return {name: one for name, one in named(value).items() if name != "boundary"} | {
            "planes": plain(None if walls is None else replace(walls, force=None)),
            "plane_force": plain(np.zeros((0, 2)) if walls is None else walls.force),
        }
    if isinstance(value, AnyPath) and len(value.direction):
        told = {name: plain(getattr(value, name)) for name in OF_LOADS}
        return told | {"load": plain(value.parameter)}
    if isinstance(value, AnyPath):
        return {
            name: plain(getattr(value, name)) for name in (OF_REPLAYS if value.steps else OF_PATHS)
        }
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
    left_out = LEFT_OUT | ({"closed", "law"} if isinstance(value, PackingState) else set())
    given = [one.name for one in fields(value) if one.init]
    names = [name for name in given if name not in left_out and name[0] != "_"]
    return {name: plain(getattr(value, name)) for name in names}


def path_of(graph, law, stage, boundary=None, **how):
    path = follow(Scene(graph, law, boundary), stage, closure="packing", **how)
    found = plain(path) | {"states": plain(path.states[-1])}
    for event in found["events"]:
        event["detail"] = re.sub(r"\S+(?= released)", _energy, event["detail"])
    return found


def _energy(text):
    """An energy in words, without those that are small beside a packing's 1e-5."""
    return text[0] if abs(float(text[0])) > 1e-8 else "next to nothing"


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
def loads():
    """A small motion and a large one, no motions allowed, a failure, shear, walls."""
    own, how = ("theta", "status", "limit", "first_large_load"), {"spread": False}
    graph = jammed(16, 2, LAW)
    largest = 0.3 * np.trace(start_state(graph).stress)
    found = sustain(Scene(graph, LAW), [[1, -1]], largest=largest, interval=4e-5, **how)
    (path,) = found.paths
    yield with_own(found, *own)
    yield plain([path.mode, path.mode.grains])
    found = sustain(
        Scene(graph, LAW), [[1, -1]], largest=largest, interval=1e-4, most_snaps=0, **how
    )
    yield with_own(found, *own)
    # It moves as one, and rounding of its places stays rounding. In a collapse of diamonds, which
    # stood here, it grows a million times in 400 steps.
    found = sustain(Scene(SQUARE, LAW), [[-1, 0]], largest=0.02, interval=1e-4, **how)
    yield with_own(found, *own)
    graph = jammed(12, 1, LAW)
    yield plain(
        sustain(Scene(graph, LAW), [[-1, 0, 1]], subspace="symmetric", interval=1e-4, **how)
    )
    graph, law, walls = small_box(0)
    yield plain(sustain(Scene(graph, law, **walls), [[-1, 0.3]], interval=1e-4, **how))


@case
def motions_that_take_long():
    """Rest that comes late or not at all, through an instability and under a load."""
    graph = jammed(12, 1, LAW)
    how = {"interval": 1e-4, "past": "dynamic"}
    for checks in (200, 1):
        with (
            patch.object(equations_of_motion, "CHECK_STEPS", 50),
            patch.object(equations_of_motion, "MAX_CHECKS", checks),
            patch.object(equations_of_motion, "SNAP_RATE", 1e-4),
        ):
            yield path_of(graph, LAW, strained(4 * PURE), **how)
    with patch.object(sustain_module, "MOST_STEPS", 700):
        largest = 0.3 * np.trace(start_state(graph).stress)
        how = {"interval": 1e-4, "spread": False}
        yield plain(sustain(Scene(graph, LAW), [[0, -1]], largest=largest, **how))


@case
def complementarity_problems():
    """Searches for a scaling, active sets from starts and by enumeration."""
    rng = np.random.default_rng(7)
    for m in (3, 5, 8):
        M = rng.standard_normal((m, m)) + np.diag(rng.uniform(0.0, 2.0, m))
        q = rng.standard_normal(m)
        yield plain(complementarity.scaled_definite(M))
        yield plain(complementarity.scaled_definite(M + 1.5 * np.eye(m)))
        yield plain(complementarity.solve_complementarity(q, M))
        yield plain([complementarity.nearest_regimes(q, M), complementarity.lemke(q, M)])
        with patch.object(complementarity, "ENUMERATED", 0):
            yield plain(complementarity.solve_complementarity(q, M))
        M[:, -1] = M[:, 0]
        M[-1] = M[0]
        yield plain(complementarity.solve_complementarity(q, M))


@case
def paths():
    """By events, with rows, goals of each kind, and each way past an instability."""
    graph = jammed(12, 1, LAW)
    for past in ("viscous", "dynamic", "stop"):
        yield path_of(graph, LAW, strained(4 * PURE), interval=1e-4, past=past, rows=2)
    graph = moved(jammed(16, 2, BRANCH), 1e-5)
    P = start_state(graph).stress[0, 0]
    for stage in (
        Stage(programmes.drained_biaxial(), "H11", 2e-3),
        Stage(programmes.isotropic_stress(), "P11", 1.3 * P),
        [
            Stage(programmes.undrained(), "H11", 4e-4),
            Stage(programmes.drained_biaxial(), "P11", 1.1 * P),
        ],
    ):
        yield path_of(graph, BRANCH, stage, interval=1e-4, rows=2, load_kept=0.5, max_steps=200)


@case
def paths_of_loose_packings():
    """Many events in an interval, an end without load, too few steps."""
    graph = packing(16, 1, 0.9, 0.3)
    yield path_of(graph, LAW, strained(2 * PURE), interval=2e-4, instabilities=50)
    graph = jammed(24, 3, LAW)
    apart = strained([[-8e-2, 0.0], [0.0, -8e-2]])
    yield path_of(graph, LAW, apart, interval=5e-4, instabilities=99)
    yield path_of(graph, LAW, apart, interval=5e-5, max_steps=3)
    yield path_of(graph, LAW, Stage(DRAINED, "H11", 2e-2), interval=5e-4)
    for law in LIMITS:
        yield path_of(jammed(16, 2, law), law, strained(PURE), interval=2e-4)


@case
def paths_that_chatter():
    """As if contacts changed regime again and again, and pivots met no end."""
    graph, loose = jammed(12, 1, LAW), packing(16, 1, 0.9, 0.3)
    for chatter, steps, rank in ((0, 40, 96), (1, 40, 2), (12, 1, 0)):
        with (
            patch.object(strain_increment, "CHATTER", chatter),
            patch.object(regime_factor, "PIVOT_STEPS", steps),
            patch.object(strain_increment, "RANK", rank),
        ):
            yield path_of(graph, LAW, strained(2 * PURE), interval=1e-4, instabilities=99)
            yield path_of(loose, LAW, strained(2 * PURE), interval=1e-5, instabilities=8)
            yield path_of(graph, LAW, strained(2 * PURE), interval=1e-4, past="stop")


@case
def paths_between_walls():
    for k in (0, 3):
        graph, law, walls = small_box(k)
        shear = strained(np.diag([4e-3, -4e-3]))
        for past in ("viscous", "dynamic"):
            yield path_of(graph, law, shear, interval=2e-4, past=past, **walls)


@case
def paths_under_hertz():
    for history, increment in (("force", "radii"), ("displacement", "branch")):
        graph = jammed(12, 1, LAW if increment == "radii" else BRANCH)
        law = hertz_of(graph, history, increment)
        yield path_of(graph, law, strained(2 * PURE), interval=2e-4)
    graph, _, walls = small_box(3)
    stage = strained(np.diag([2e-3, -1e-3]))
    yield path_of(graph, hertz_of(graph), stage, interval=2e-4, **walls)


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


CONTROLS = (
    ([[1.0, 0.2], [0.0, -0.6]], None),
    ([[1.0, 0.0], [0.0, np.nan]], [[np.nan, np.nan], [np.nan, 0.3]]),
    ([[np.nan, 0.0], [0.0, np.nan]], [[1.0, np.nan], [np.nan, -0.5]]),
)


@case
def rates():
    """The rate problem under strain, stress and both; by enumeration, by starts and by parts."""
    for grains, share in ((16, 0.2), (16, 0.6), (24, 0.5)):
        graph = packing(grains, 2, 0.9, share)
        faces = find_faces(graph)
        for H, P in CONTROLS:
            answer = rates_at(Scene(graph, LAW), H=H, P=P)
            yield plain(answer) | {"loops": plain(loop_rates(answer, faces))}
            with patch.object(response, "CONDENSED", 3), patch.object(response, "PART", 8):
                yield plain(rates_at(Scene(graph, LAW), H=H, P=P))
    for seed in (0, 1, 2, 4, 5):
        graph, law = small(8, seed, 0.5)
        yield plain(rates_at(Scene(graph, law), H=CONTROLS[0][0], yield_band=0.9))


@case
def rates_of_held_and_walled_packings():
    graph, law, walls = small_box(3)
    plates = replace(walls["boundary"].walls, force=None)
    boundary = boundary_of(graph, walls=plates, volume=12.0)
    for band in (0.5, 0.99):
        answer = rates_at(Scene(graph, law, boundary), H=np.diag([1.0, -0.5]), yield_band=band)
        yield plain(answer) | {"loops": plain(loop_rates(answer, find_faces(graph)))}
    graph = packing(16, 3, 0.9, 0.3)
    flags = np.where(np.arange(graph.contact_count) % 5 == 0, 2, 1)
    yield plain(rates_at(Scene(graph, LAW, boundary_of(graph, held=np.arange(16) < 3)), H=PURE))
    yield plain(rates_at(Scene(graph.replace(regime=flags), LAW), H=PURE))
    yield plain(rates_at(Scene(graph, LAW, boundary_of(graph, volume=1.0)), H=PURE))


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


# Packings (grains, seed, share at yield) with folds, cones and directions without a solution.
FEW = ((8, 0, 0.3), (8, 3, 0.3), (8, 5, 0.6), (8, 7, 0.3), (8, 8, 0.3), (10, 6, 0.3), (10, 9, 0.6))


@case
def probes_of_few_contacts():
    """Every combination tried, and as if there were too many: by branches and starts."""
    own = ("softest", "between_folds")
    for control in ("strain", "stress"):
        for grains, seed, share in FEW:
            graph, law = small(grains, seed, share)
            found = probe(Scene(graph, law), 12, control=control, yield_band=0.9)
            answer = with_own(found, *own) | {"text": str(found)}
            if len(found.cones) > 1:
                # Rounding decides between the edges of opposite cones.
                del answer["destabilising"]
            yield answer
        for grains, seed, share in (*FEW[1:5], (10, 1, 0.3)):
            graph, law = small(grains, seed, share)
            with patch.object(complementarity, "ENUMERATED", 0):
                with patch.object(regime_regions, "ENUMERATED", 0):
                    answer = with_own(
                        probe(Scene(graph, law), 8, control=control, yield_band=0.9), *own
                    )
            del answer["destabilising"]
            yield answer


@case
def probes_to_an_amplitude():
    graph = jammed(12, 1, LAW)
    faces = find_faces(graph)
    for control, amplitude in (("strain", 1e-4), ("stress", 1e-4)):
        start = probe(Scene(graph, LAW), [[1.0, 0.3], [-1, -0.2]], control=control, faces=faces)
        yield plain(probe_to(start, Scene(graph, LAW), amplitude))


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
