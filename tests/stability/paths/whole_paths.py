"""Paths of tiny loops and everything they hold: `python -m tests.stability.paths.whole_paths`.

It stores what the paths hold now; `test_whole_paths.py` compares. Say in the commit why a number
moved.
"""

from __future__ import annotations

import json
import re
from dataclasses import asdict
from pathlib import Path

import numpy as np

from loops import (
    GrainGraph,
    HertzMindlin,
    LinearFrictional,
    RollingResistance,
    Scene,
    boundary_of,
    contact_state,
)
from patterns import diamond, regular_polygon, synthetic_network
from stability import Stage, follow, programmes, rates_at
from stability.path import describe
from stability.paths.domain import LIMITS, Fan, FanLimits

WORDS, NUMBERS = (Path(__file__).with_suffix(suffix) for suffix in (".json", ".npz"))
ROWS = {"rows": 2}
LAW = LinearFrictional(1.0, 0.2, np.tan(np.radians(5.0)))
ROUGH = LinearFrictional(1.0, 0.2)
NUMBER = re.compile(r"-?\d+\.\d+(?:e[-+]?\d+)?|-?\d+e[-+]?\d+")
SHEAR = programmes.combination(np.zeros((4, 4)), np.eye(4), [0.4, 1.0, 0.2, 0.1], "shear")
MEAN = programmes.combination(
    np.array([[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [1.0, 0, 0, 1]]),
    np.array([[1.0, 0, 0, -1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 0]]),
    [1, 0, 0, 0],
    "constant mean stress",
)


def isotropic(E, rate=1.0):
    return Stage(programmes.isotropic_strain(rate), "H11", E)


def drained(E, rate=1.0):
    return Stage(programmes.drained_biaxial(rate=rate), "H11", E)


def oedometric(E, rate=1.0):
    return Stage(programmes.oedometric(rate=rate), "H11", E)


def irregular(chord=False, law=None):
    """Five unequal grains, overlapping, with shear forces; the law has values of each contact."""
    angle = np.radians([10.0, 75.0, 160.0, 215.0, 300.0])
    # No unit of length or force is one.
    x = 3.0 * (np.column_stack([np.cos(angle), 1.1 * np.sin(angle)]) + np.array([0.3, -0.2]))
    ring = np.array([[0, 1], [1, 2], [2, 3], [3, 4], [4, 0]])
    length = np.linalg.norm(x[ring[:, 1]] - x[ring[:, 0]], axis=1)
    wanted = length * [1.04, 1.05, 1.06, 1.07, 1.08]
    radii = np.linalg.solve(np.eye(5) + np.roll(np.eye(5), 1, axis=1), wanted)
    if chord:
        ring = np.vstack([ring, [1, 3]])
        radii = radii + np.array([0.0, 0.9, 0.0, 0.9, 0.0])
        radii[[0, 2, 4]] -= 0.6
    c = np.arange(len(ring))
    law = law or LinearFrictional(40.0 + 4.0 * c, 12.0 + 2.0 * c, 0.3 - 0.03 * c)
    graph = GrainGraph(x=x, radii=np.abs(radii), contacts=ring)
    N = law.normal_force(contact_state(graph))
    return graph.replace(normal_force=N, shear_force=0.1 * N * (-1.0) ** c), law


def periodic():
    """Eight grains in a skewed cell."""
    graph = synthetic_network(8, seed=0, cell=[[3.0, 0.2], [-0.2, 2.8]], coordination=3.6)
    forces = {"normal_force": LAW.normal_force(contact_state(graph)), "shear_force": None}
    return graph.replace(**forces), LAW


def _cases():
    five, own = irregular()
    chord, chord_law = irregular(chord=True)
    tri = HertzMindlin(young=1.0, poisson=0.3, mu=0.2)
    spheres = regular_polygon(5, strain=0.01)
    spheres = spheres.replace(normal_force=tri.normal_force(contact_state(spheres)))
    rolling = RollingResistance(LinearFrictional(1.0, 0.3, 0.2), k_r=0.1)
    limit = Stage(programmes.proportional_stress(-1, 0), "P11", -0.5)
    twisted = regular_polygon(5, strain=0.1).replace(shear_force=np.full(5, 0.1))
    pull = programmes.isotropic_stress(-1.0)
    at_yield = diamond(np.pi / 4, E1=0.1, E2=0.1, T=0.1 * float(LAW.mu) * 0.9)
    all_spaces = {"subspace": ("diagonal", "symmetric", "full")}
    tr = {"closure": "traction"}
    return {
        "reversal": (diamond(np.pi / 4), LAW,
                     [isotropic(0.3), drained(0.45), drained(0.44, -1), drained(0.5)],
                     {"volume": 2.0, **all_spaces}),
        "every step": (diamond(0.7), LAW, [isotropic(0.3), drained(0.42)],
                       {"rows": 0}),
        "reversal traction": (diamond(np.pi / 4), LAW,
                              [isotropic(0.3), drained(0.45), drained(0.44, -1)],
                              {"volume": 2.0, **tr}),
        "opens": (regular_polygon(4), LAW, [isotropic(0.1), oedometric(-0.2, -1),
                                            oedometric(0.05)], {}),
        "opens sheared": (diamond(np.pi / 4), ROUGH, [isotropic(0.1), oedometric(-0.3, -1)], {}),
        "torn": (diamond(np.pi / 4), ROUGH, [isotropic(0.1), oedometric(-0.3, -1)], tr),
        "touch": (diamond(np.radians(35)), LAW, [isotropic(0.3)], tr),
        "touch stop": (diamond(np.radians(35)), LAW, [isotropic(0.3)],
                       {"contact_on_touch": "stop"}),
        "touch add": (diamond(np.radians(35)), LAW, [isotropic(0.3), drained(0.33)],
                      {**tr, "contact_on_touch": "add"}),
        "touch add affine": (diamond(np.radians(35)), LAW, [isotropic(0.3), drained(0.33)],
                             {"contact_on_touch": "add"}),
        "many touch": (regular_polygon(13), LAW, [isotropic(0.49)], {}),
        "flutter": (twisted, LinearFrictional(1.0, 0.1), [isotropic(0.56)],
                    {"subspace": "symmetric"}),
        "limit": (diamond(np.radians(20)), ROUGH,
                  [isotropic(0.18), limit, Stage(programmes.oedometric(), "H11", 0.5,
                                                 fallback=True)], {}),
        "not needed": (diamond(np.radians(40)), ROUGH,
                       [isotropic(0.1), Stage(programmes.oedometric(), "H11", 0.2,
                                              fallback=True), isotropic(0.12)], {}),
        "branching": (regular_polygon(6), LinearFrictional(1.0, 0.237, np.tan(np.radians(11.8))),
                      [isotropic(0.046), drained(0.17)], tr),
        "collapse": (diamond(np.pi / 4), LAW, [isotropic(0.1), oedometric(1.5)], {}),
        "few steps": (diamond(np.pi / 4), LAW, [isotropic(0.3)],
                      {"max_steps": 3, "rows": 0}),
        "away": (diamond(np.pi / 4, E1=0.05, E2=0.05), LAW, [isotropic(-0.1)], {}),
        "at once": (regular_polygon(4), LAW, [isotropic(0.1), isotropic(0.1), isotropic(0.12)],
                    {}),
        "carries nothing": (regular_polygon(3), LinearFrictional(1.0, 0.3, 0.3),
                            [isotropic(0.1), Stage(pull, "P11", 0.0), Stage(pull, "P11", -0.1)],
                            tr),
        "no solution": (diamond(np.radians(30)), LAW,
                        [Stage(programmes.isotropic_stress(), "P11", 0.1)], tr),
        "at yield": (at_yield, LAW, [drained(0.15)], tr),
        "undrained": (diamond(np.radians(40)), LAW,
                      [isotropic(0.1), Stage(programmes.undrained(axis=2), "H22", 0.15)], tr),
        "stress": (regular_polygon(5), LAW,
                   [isotropic(0.1), Stage(programmes.proportional_stress(1, 0.3), "P11", 0.25),
                    Stage(programmes.isotropic_stress(), "parameter", 0.01)], tr),
        "mean stress": (regular_polygon(6, strain=0.1), ROUGH, [Stage(MEAN, "H11", 0.12)], tr),
        "pentagon": (five, own, [Stage(SHEAR, "H12", 0.05), drained(0.06)], {**tr, **all_spaces}),
        "pentagon affine": (five, own, [Stage(SHEAR, "H12", 0.05), drained(0.06)],
                            {"rows": 0}),
        "pentagon free": (five, own, [Stage(SHEAR, "H12", 0.03)], {**tr, "spins": "free"}),
        "pentagon turned": (five, own, [Stage(SHEAR, "H12", 0.03)],
                            {**tr, "spins": "affine"}),
        "affine turned": (five, own, [Stage(SHEAR, "H12", 0.03)], {"spins": "affine"}),
        "affine free": (five, own, [Stage(SHEAR, "H12", 0.03)], {"spins": "free"}),
        "chord": (chord, chord_law, [Stage(SHEAR, "H12", 0.03)], tr),
        "chord turned": (chord, chord_law, [Stage(SHEAR, "H12", 0.03)],
                         {**tr, "spins": "affine"}),
        "square free": (regular_polygon(5), LAW, [isotropic(0.05), drained(0.08)],
                        {**tr, "spins": "free"}),
        "full": (regular_polygon(4, strain=0.1), LAW, [drained(0.13)], {**tr, "model": "full"}),
        "soft": (regular_polygon(5, strain=0.05), LinearFrictional(1.0, 1e-3, 0.1),
                 [drained(0.08)], tr),
        "first touch": (regular_polygon(3), tri, [isotropic(0.05), drained(0.06)], {}),
        "first touch relaxed": (regular_polygon(4), tri, [isotropic(0.05), drained(0.06)], tr),
        "spheres": (spheres, tri, [drained(0.04)], {**tr, "spins": "free"}),
        "rolling": (regular_polygon(5, strain=0.05), rolling, [Stage(SHEAR, "H12", 0.02)],
                    {**tr, "spins": "free"}),
        "frictionless": (diamond(np.radians(40)), LinearFrictional(1.0, 0.2, 0.0),
                         [isotropic(0.1), drained(0.12)], tr),
        "radii": (diamond(np.radians(40)), LinearFrictional(1.0, 0.2, 0.1,
                                                            shear_increment="radii"),
                  [isotropic(0.1), drained(0.16)], tr),
        "periodic": (*periodic(), [Stage(SHEAR, "H12", 0.02)], {"subspace": "symmetric"}),
    }  # fmt: skip


CASES = _cases()
# Names of `Path.columns` that are rounding or amplify it.
NOISE = ("energy_error", "imbalance")


def split(text):
    """Words of a text with its decimal numbers taken out, and these numbers."""
    return NUMBER.sub("#", text), [float(one) for one in NUMBER.findall(text)]


def scene_of(graph, law, options):
    """Return the scene of a case, whose options tell the volume."""
    return Scene(graph, law, boundary_of(graph, volume=options.get("volume")))


def asked_of(options):
    """Return the options of a case without its volume, affine if they name no closure."""
    return {"closure": "affine"} | {n: one for n, one in options.items() if n != "volume"}


def followed(case):
    graph, law, stages, options = CASES[case]
    return follow(scene_of(graph, law, options), stages, **ROWS | asked_of(options))


def held(path):
    """Words (JSON) and numbers of a path: all of its columns, events and messages."""
    message, values = split(path.message)
    events = []
    for event in path.events:
        detail, some = split(describe(event))
        events.append([event.kind, event.stage, event.index, list(event.contacts), detail,
                       event.subspace])  # fmt: skip
        values += [event.parameter, *event.H, *event.P, *some]
    model = asdict(path.model)
    kept, some = split(model.pop("kept"))
    words = [path.status, message, events, model, kept, path.subspace, path.contacts.tolist()]
    columns = path.columns()
    exact = [name for name in columns if name.startswith(("regime", "stage"))]
    words.append({name: columns[name].tolist() for name in exact})
    numbers = {name: columns[name] for name in columns if name not in exact}
    numbers |= {"x": path.x, "events": np.array(values + some), "volume": np.array(path.volume)}
    return json.loads(json.dumps(words)), numbers


# Loops whose fans are stored: graph, law, closure, control, degrees of the programmes.
FANS = {
    "square": (regular_polygon(4), LAW, "traction", "strain", [-60.0, -20.0, 10.0, 45.0, 80.0]),
    "pentagon": (irregular()[0], irregular()[1], "traction", "stress", [40.0, 0.0]),
    "pentagon affine": (irregular()[0], irregular()[1], "affine", "strain", [-90.0, 20.0]),
    "hexagon": (regular_polygon(6), ROUGH, "traction", "stress", [-30.0, 20.0, 45.0]),
}


def fan(name):
    """Words and numbers of the first limits of a fan."""
    graph, law, closure, control, angles = FANS[name]
    found = Fan(Scene(graph, law), closure, "blocked", control, np.radians(angles), 0.3)
    limits = FanLimits.none(found)
    for row in range(len(angles)):
        limits.follow(found, row)
    words = {kind: limits.found[kind].tolist() for kind in LIMITS}
    numbers = {}
    for kind in LIMITS:
        H, P, x, regime = (each[limits.found[kind]] for each in limits.states[kind])
        words[f"{kind} regime"] = regime.tolist()
        numbers |= {f"{kind} H": H, f"{kind} P": P, f"{kind} x": x}
    return words, numbers


def rates(case):
    """Words and numbers of the rate problem of a first state."""
    graph, law, stages, options = CASES[case]
    given = {name: one for name, one in asked_of(options).items() if name in ("closure", "spins")}
    found = rates_at(scene_of(graph, law, options), stages[0].programme, **given)
    words = [found.status, len(found.solutions), found.combinations, found.tried]
    taken = found.taken.rates
    words.append(taken.mode.regime.tolist())
    own = taken.rates
    return json.loads(json.dumps(words)), {
        name: np.asarray(getattr(own, name), dtype=float)
        for name in ("H", "P", "parameter", "un", "ut", "normal_force", "shear_force", "motion")
    }


def everything():
    """Words and numbers of all cases, by their names."""
    for case in CASES:
        yield f"path, {case}", lambda case=case: held(followed(case))
    for case in ("reversal", "pentagon", "pentagon free", "frictionless"):
        yield f"rates, {case}", lambda case=case: rates(case)
    for name in FANS:
        yield f"fan, {name}", lambda name=name: fan(name)


def flat(numbers):
    """All numbers one after the other."""
    return np.concatenate([np.ravel(values) for values in numbers.values()])


if __name__ == "__main__":
    words, numbers = {}, {}
    for name, answer in everything():
        words[name], found = answer()
        numbers[name] = flat(found)
        print(f"{name}: {len(numbers[name])} numbers")
    lines = [f"{json.dumps(name)}: {json.dumps(value)}" for name, value in words.items()]
    WORDS.write_text("{\n" + ",\n".join(lines) + "\n}\n")
    np.savez_compressed(NUMBERS, **numbers)
