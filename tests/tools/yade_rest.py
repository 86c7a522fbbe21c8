"""Hold a state in Yade, then raise the stress by levels, each until rest: yade_rest*.npz.

`yade -n -x -j1 tests/tools/yade_rest.py CONFIG.json`, with Yade 2023.02a (package of Debian 12):

    state               npz with the arrays of a GrainGraph: x, radii, contacts, images, cell
                        (upright), normal_force, shear_force; levels that it has in other
                        directions are kept
    thickness           of the periodic cell; the spheres stand in one plane
    density, kn, kt, mu, dt
    out                 folder of the results
    degrees             directions of the load in the plane (P11, P22), compression positive
    first, largest      first load of the levels, and the last one at most (N/m)
    coarse, fine        load of a level over that before, far from the limit and near it (1.5, 1.08)
    ramp, most_steps    steps in which a level is put on, and after which it is left (1000, 20,000)
    damping             of the levels (0.2)
    moved               in place of first to ramp: {degrees: load under which it moved before}, see
                        below

The law is Cundall and Strack's with Yade's default shear increment. The cell is held until the
unbalanced force is 1e-7 (damping 0.4), and `held.npz` is written. Every direction starts from a
fork of this state. The load is dead: the nominal stress is P = P0 + load (cos, sin), so the goal
of Yade's controller, a Cauchy stress, follows the cell every ten steps (S11 = P11/F22, S22 =
P22/F11). The cell has no shear, a twentieth of the sample's mass, and a strain rate of at most
0.05 / s. A level is at rest when the unbalanced force is below 1e-6 and the
stress within 1e-3 of the load, in two looks 250 steps apart; it is left after `most_steps`, or
where it strains by 1e-2.

The next level is `coarse` times the load, tried in a fork. Where it isn't quiet (no rest in half of
the steps, or 2.5 times the strain per load before it) the fork is dropped, and the load grows by
`fine` a level. So each level starts from rest under the one before, and the last one found no rest.
With `moved` a direction is loaded again, more gently and by no number of a path. Of the load L
under which Yade moved before, levels of a tenth are put on, up to half of L in 20,000 steps each,
up to 0.9 L in 40,000, then levels of a hundredth in 8,000, until one moves: no rest, or a
strain above 1e-4 and ten times that of the level before, per load.
`levels_DEGREES.json` has an entry a level; `yade_rest.npz` holds the state and all of them.
"""

# ruff: noqa: F403, F405
import glob
import json
import math
import os
import sys
import time

import numpy as np
from yade import *
from yade import utils

CONFIG = json.load(open(sys.argv[1]))
# Load of a level over the one before: far from the limit, and near it.
COARSE = CONFIG.get("coarse", 1.5)
FINE = CONFIG.get("fine", 1.08)
# Strain per load over that of the levels before from which on a level isn't quiet.
QUIET = 2.5
# Steps between two looks, in which a level is put on, and after which it is left.
LOOK = 250
RAMP = CONFIG.get("ramp", 1000)
MOST_STEPS = CONFIG.get("most_steps", 20_000)
DAMPING = CONFIG.get("damping", 0.2)
# Unbalanced force at rest of the held state and of a level.
HELD, REST = 1e-7, 1e-6
# Levels of a direction that is loaded again: to which share of its load, by which, in which steps.
GENTLE = ((0.5, 0.1, 20_000), (0.9, 0.1, 40_000), (1.5, 0.01, 8_000))
# Strain of a level that moves, and its strain per load over that of the level before.
MOVES, SOFTER = 1e-4, 10.0
# Error of the stress over the load at rest; below the second one (N/m) it does not count.
WITHIN, LEAST = 1e-3, 5e-4
# Strain of a level that is a flow.
FLOWS = 1e-2
COLUMNS = "degrees load at_rest H11 H22 strain P11 P22 unbalanced kinetic steps".split()


def build():
    """The sample of the state, with its shear forces, its cell held."""
    state, thickness = dict(np.load(CONFIG["state"])), CONFIG["thickness"]
    (a, b), (c, d) = state["cell"]
    O.periodic = True
    O.cell.hSize = Matrix3(a, b, 0, c, d, 0, 0, 0, thickness)
    O.cell.trsf = Matrix3.Identity
    grain = O.materials.append(
        FrictMat(
            young=1e8, poisson=0.5, density=CONFIG["density"], frictionAngle=math.atan(CONFIG["mu"])
        )
    )
    for (x, y), r in zip(state["x"], state["radii"], strict=True):
        body = sphere((x, y, thickness / 2), r, material=grain)
        body.state.blockedDOFs = "zXY"
        O.bodies.append(body)
    O.dt = CONFIG["dt"]
    stiffness = {
        name: MatchMaker(algo="val", val=CONFIG[key]) for name, key in (("kn", "kn"), ("ks", "kt"))
    }
    O.engines = [
        ForceResetter(),
        InsertionSortCollider([Bo1_Sphere_Aabb()]),
        InteractionLoop(
            [Ig2_Sphere_Sphere_ScGeom()],
            [Ip2_FrictMat_FrictMat_FrictPhys(**stiffness)],
            [Law2_ScGeom_FrictPhys_CundallStrack()],
        ),
        PyRunner(iterPeriod=10, command="steer()", label="steering", dead=True),
        PeriTriaxController(
            label="triax",
            dynCell=True,
            goal=(-1, -1, 0),
            stressMask=3,
            dead=True,
            maxStrainRate=(0.05, 0.05, 0),
            maxUnbalanced=1e-12,
            relStressTol=1e-9,
            mass=0.05 * sum(b.state.mass for b in O.bodies),
            growDamping=0.5,
        ),
        NewtonIntegrator(damping=0.4, label="newton", dead=True),
    ]
    O.step()
    # Sums the forces of this step, in which no shear acts yet. Left out, they kick the next one.
    utils.unbalancedForce()
    pairs = map(tuple, state["contacts"].tolist())
    shear = dict(zip(pairs, state["shear_force"], strict=True))
    for one in O.interactions:
        if one.isReal:
            pair, n = (one.id1, one.id2), one.geom.normal
            # The sign of T is that of a rotation, whichever grain is the first.
            T = shear.get(pair, shear.get(pair[::-1], 0.0))
            one.phys.shearForce = T * Vector3(-n[1], n[0], 0)
    newton.dead = False


def write_held(name):
    rows = [i for i in O.interactions if i.isReal]
    n = np.array([(i.geom.normal[0], i.geom.normal[1]) for i in rows])
    shear = np.array([(i.phys.shearForce[0], i.phys.shearForce[1]) for i in rows])
    h = O.cell.hSize
    np.savez(
        name,
        x=np.array([(b.state.pos[0], b.state.pos[1]) for b in O.bodies]),
        radii=np.array([b.shape.radius for b in O.bodies]),
        contacts=np.array([(i.id1, i.id2) for i in rows]),
        images=np.array([(i.cellDist[0], i.cellDist[1]) for i in rows]),
        cell=np.array([[h[0, 0], h[0, 1]], [h[1, 0], h[1, 1]]]),
        normal_force=np.array([i.phys.normalForce.dot(i.geom.normal) for i in rows]),
        shear_force=n[:, 0] * shear[:, 1] - n[:, 1] * shear[:, 0],
    )


def stretch():
    h = O.cell.hSize
    return h[0, 0] / h0[0], h[1, 1] / h0[1]


def stress():
    """Cauchy stress of the two axes (N/m), compression positive."""
    S = utils.getStress() * CONFIG["thickness"]
    return -S[0, 0], -S[1, 1]


def steer():
    F1, F2 = stretch()
    thickness = CONFIG["thickness"]
    triax.goal = (-P[0] / F2 / thickness, -P[1] / F1 / thickness, 0)


def at_level(before, load, angle, expected, ramp=RAMP):
    """One level from the load before: its entry, and whether it is quiet."""
    global P
    e0 = np.subtract(1, stretch())
    steps, kinetic, late, quiet_looks, begin = 0, 0.0, 0.0, 0, time.time()
    while True:
        now = before + (load - before) * min(1.0, (steps + LOOK) / ramp)
        P = (P0[0] + now * math.cos(angle), P0[1] + now * math.sin(angle))
        O.run(LOOK, True)
        steps += LOOK
        e, S, F = np.subtract(1, stretch()), stress(), stretch()
        own = (S[0] * F[1], S[1] * F[0])
        error = max(abs(own[0] - P[0]), abs(own[1] - P[1]))
        unbalanced, energy = utils.unbalancedForce(), utils.kineticEnergy()
        kinetic = max(kinetic, energy)
        late = max(late, energy) if steps > 2 * ramp else 0.0
        strain = float(np.linalg.norm(e - e0))
        good = steps > ramp and unbalanced < REST and error < max(WITHIN * load, LEAST)
        quiet_looks = quiet_looks + 1 if good else 0
        most = MOST_STEPS if expected is None else MOST_STEPS // 2
        rest, lost = quiet_looks == 2, steps >= most or strain > FLOWS
        hasty = expected is not None and strain > max(2 * QUIET * expected, 1e-6)
        if rest or lost or hasty:
            break
    entry = dict(
        load=load,
        at_rest=rest,
        H11=e[0],
        H22=e[1],
        strain=strain,
        unbalanced=unbalanced,
        kinetic=kinetic,
        kinetic_late=late,
        P11=own[0] - P0[0],
        P22=own[1] - P0[1],
        steps=steps,
        seconds=time.time() - begin,
    )
    return entry, rest and (expected is None or strain < QUIET * expected)


def go(degrees):
    """Levels of one direction, in forks of forks; the last of them writes."""
    angle, levels, slope, coarse_from = math.radians(degrees), [], None, 0.0
    newton.damping, triax.dead, steering.dead = DAMPING, False, False
    while True:
        load = levels[-1]["load"] if levels else 0.0
        if load >= CONFIG["largest"] or (levels and not levels[-1]["at_rest"]):
            break
        following = load * COARSE or CONFIG["first"]
        if load >= coarse_from:
            child = os.fork()
            if child == 0:
                expected = None if slope is None else slope * (following - load)
                entry, quiet = at_level(load, following, angle, expected)
                print(degrees, "coarse", entry, flush=True)
                if not quiet:
                    os._exit(1)
            elif os.waitpid(child, 0)[1] == 0:
                os._exit(0)
            else:
                coarse_from = following
                continue
        else:
            following = min(load * FINE, coarse_from) if load else following / COARSE
            entry, _ = at_level(load, following, angle, None)
            print(degrees, "fine", entry, flush=True)
        own = entry["strain"] / (following - load)
        slope = own if slope is None else min(own, COARSE * slope)
        levels.append(entry)
    write_levels(degrees, levels)


def write_levels(degrees, levels):
    with open(f"{CONFIG['out']}/levels_{degrees:g}.json", "w") as file:
        json.dump(levels, file, indent=1)
    os._exit(0)


def go_gently(degrees, moved):
    """Levels by shares of the load under which the direction moved before."""
    angle, levels, share, slope = math.radians(degrees), [], 0.0, math.inf
    newton.damping, triax.dead, steering.dead = DAMPING, False, False
    for end, rise, ramp in GENTLE:
        while share < end - 1e-9:
            before, share = share * moved, share + rise
            entry, _ = at_level(before, share * moved, angle, None, ramp)
            print(degrees, "gentle", entry, flush=True)
            levels.append(entry)
            own = entry["strain"] / (rise * moved)
            if not entry["at_rest"] or (entry["strain"] > MOVES and own > SOFTER * slope):
                write_levels(degrees, levels)
            slope = own
    write_levels(degrees, levels)


def pack():
    """The held state and the levels of all directions, in one file for the tests."""
    stored = dict(np.load(f"{CONFIG['out']}/held.npz"))
    stored |= {"contacts": stored["contacts"].astype(np.int16)}
    stored |= {"images": stored["images"].astype(np.int8), "columns": np.array(COLUMNS)}
    rows = []
    for name in glob.glob(f"{CONFIG['out']}/levels_*.json"):
        degrees = float(name.split("_")[-1].removesuffix(".json"))
        rows += [{"degrees": degrees, **entry} for entry in json.load(open(name))]
    if "level degrees" in (known := np.load(CONFIG["state"])):
        stored |= {name: known[name] for name in known if not name.startswith("level ")}
        again = {row["degrees"] for row in rows}
        old = zip(*(known[f"level {column}"] for column in COLUMNS), strict=True)
        rows += [dict(zip(COLUMNS, row, strict=True)) for row in old if row[0] not in again]
    rows.sort(key=lambda row: (row["degrees"], row["load"]))
    stored |= {f"level {column}": np.array([row[column] for row in rows]) for column in COLUMNS}
    np.savez_compressed(f"{CONFIG['out']}/yade_rest.npz", **stored)


build()
os.makedirs(CONFIG["out"], exist_ok=True)
print("start", stress(), flush=True)
for _ in range(60):
    O.run(2500, True)
    print("hold", O.iter, utils.unbalancedForce(), stress(), flush=True)
    if utils.unbalancedForce() < HELD:
        break
write_held(f"{CONFIG['out']}/held.npz")
P0 = P = stress()
h0 = (O.cell.hSize[0, 0], O.cell.hSize[1, 1])
for degrees in CONFIG["degrees"]:
    child = os.fork()
    if child == 0:
        if "moved" in CONFIG:
            go_gently(degrees, CONFIG["moved"][f"{degrees:g}"])
        go(degrees)
    os.waitpid(child, 0)
pack()
