"""Bonded discs in a periodic cell, sheared slowly: the sample `bonded` of Yade.

`yade -n -x -j1 yade_bonded.py OUT`, with `yade_export.py` beside it (three minutes). Discs are
compressed without cohesion to an isotropic pressure and come to rest; then every contact becomes a
bond (`grains_00`). The cell is strained at constant area, `STEPS` times by `STRAIN`, and comes to
rest before each table is written; the sample has those from `grains_01` on. Bonds are those of
`gl.CohesiveFrictional(bonded=True)`.
"""

# ruff: noqa: F403, F405
import math
import sys

import numpy as np
from yade import *
from yade import utils

OUT = sys.argv[1]
COUNT, SEED = 300, 5
# SI units. The stiffness of a contact is `2 YOUNG r1 r2/(r1 + r2)`, in shear half of it.
YOUNG, SHEAR_RATIO, DENSITY, PRESSURE = 1e8, 0.5, 2600.0, 400.0
FRICTION_FIRST, FRICTION = 0.1, 0.5
# Pull of a bond over the mean normal force, and its shear strength at N = 0 over its pull.
PULL, SHEAR = 0.5, 3.0
# Strain before the first table and between two; inertial number in between.
BEFORE, STEPS, STRAIN, INERTIAL = 2e-3, 5, 1e-4, 1e-6
# Unbalanced force of a sample at rest.
AT_REST = 1e-7

with open("yade_export.py") as file:
    snippet = {}
    exec(compile(file.read(), "yade_export.py", "exec"), snippet)
rng = np.random.default_rng(SEED)
material = O.materials.append(
    CohFrictMat(
        young=YOUNG,
        poisson=SHEAR_RATIO,
        density=DENSITY,
        frictionAngle=math.atan(FRICTION_FIRST),
        isCohesive=False,
        momentRotationLaw=False,
        fragile=False,
    )
)
radii = rng.uniform(0.006, 0.014, COUNT)
spacing, columns = 2.02 * radii.max(), math.ceil(math.sqrt(COUNT))
rows, depth = math.ceil(COUNT / columns), 6.0 * radii.max()
O.periodic = True
O.cell.setBox(columns * spacing, rows * spacing, depth)
for k, slot in enumerate(rng.permutation(columns * rows)[:COUNT]):
    row, column = divmod(int(slot), columns)
    jitter = (spacing / 2 - radii[k]) * rng.uniform(-0.6, 0.6, 2)
    place = (column + 0.5) * spacing + jitter[0], (row + 0.5) * spacing + jitter[1]
    body = sphere((*place, depth / 2), radii[k], material=material)
    body.state.blockedDOFs = "zXY"
    O.bodies.append(body)
mass = sum(body.state.mass for body in O.bodies) / COUNT
O.dt = 0.3 * min(math.sqrt(b.state.mass / (YOUNG * b.shape.radius)) for b in O.bodies)
newton = NewtonIntegrator(damping=0.2)
O.engines = [
    ForceResetter(),
    InsertionSortCollider([Bo1_Sphere_Aabb()]),
    InteractionLoop(
        [Ig2_Sphere_Sphere_ScGeom6D()],
        [Ip2_CohFrictMat_CohFrictMat_CohFrictPhys()],
        [Law2_ScGeom6D_CohFrictPhys_CohesionMoment()],
    ),
    PyRunner(iterPeriod=1, command="export()", label="writing", dead=True),
    PeriTriaxController(
        label="triax",
        dynCell=True,
        goal=(-PRESSURE / depth, -PRESSURE / depth, 0),
        stressMask=3,
        maxStrainRate=(1, 1, 0),
        maxUnbalanced=1e-9,
        relStressTol=1e-4,
        dead=True,
    ),
    newton,
]
time_unit = math.sqrt(mass / PRESSURE)


def contacts():
    return [i for i in O.interactions if i.isReal]


def export():
    snippet["export_tables"](OUT)


def rest(limit, checks=400):
    """Run until the unbalanced force is below the limit."""
    for _ in range(checks):
        O.run(1000, True)
        if utils.unbalancedForce() < limit:
            return


def strain(by, rate):
    """Strain at constant area, shorter along y, then come to rest."""
    O.cell.velGrad = Matrix3(rate, 0, 0, 0, -rate, 0, 0, 0, 0)
    O.run(round(by / rate / O.dt), True)
    O.cell.velGrad = Matrix3.Zero
    rest(AT_REST)


def write(step):
    """Write tables of this instant, and say how many bonds are left."""
    writing.dead = False
    O.step()
    writing.dead = True
    stress, bonds = -utils.getStress() * depth, sum(not i.phys.cohesionBroken for i in contacts())
    force = utils.unbalancedForce()
    said = f"{len(contacts())} contacts, {bonds} bonds, unbalanced {force:.1e}"
    print(step, said, "stress", [stress[k, j] for k in (0, 1) for j in (0, 1)], flush=True)


compaction, h = 0.005 / time_unit, O.cell.hSize
share = h[0, 0] * h[1, 1] * 0.78 / (math.pi * float((radii**2).sum()))
O.cell.velGrad = Matrix3(-compaction, 0, 0, 0, -compaction, 0, 0, 0, 0)
O.run(int(0.5 * math.log(share) / compaction / O.dt), True)
O.cell.velGrad = Matrix3.Zero
triax.dead, triax.maxStrainRate, newton.damping = False, (5 * compaction, 5 * compaction, 0), 0.4
rest(1e-4, 60)
triax.dead, O.cell.velGrad = True, Matrix3.Zero
rest(1e-6)
O.materials[material].frictionAngle = math.atan(FRICTION)
pull = PULL * float(np.mean([i.phys.normalForce.norm() for i in contacts()]))
for i in contacts():
    i.phys.tangensOfFrictionAngle = FRICTION
    i.phys.normalAdhesion, i.phys.shearAdhesion = pull, SHEAR * pull
    # Not fragile: a bond may slide. `unpMax` zero: it breaks where its pull is reached.
    i.phys.cohesionBroken, i.phys.fragile, i.phys.unpMax = False, False, 0.0
rest(AT_REST)
print("pull", pull, flush=True)
write("bonded")
rate = INERTIAL / time_unit
strain(BEFORE, 5 * rate)
for step in range(STEPS + 1):
    if step:
        strain(STRAIN, rate)
    write(step)
