"""Speed against error of a loop's path: tolerances of the steps, irregular loops with sliding.

    python -m tests.tools.path_errors

Five random loops of 4 to 12 grains without load are compressed isotropically, then drained;
contacts slide. The reference has tolerances of 1e-13 and steps of .01. Errors are the largest over
the strains at events and the last strain, over the loops.
"""

import time

import numpy as np

from loops import LinearFrictional, Scene
from patterns import random_loop
from stability import Stage, follow

LAW = LinearFrictional(1.0, 0.8, 0.3)
SEEDS = ((4, 3), (5, 2), (6, 1), (8, 5), (12, 4))


def paths(scenes, **options):
    stages = [Stage("isotropic_strain", "H11", 0.01), Stage("drained_biaxial", "H11", 0.06)]
    return [follow(scene, stages, closure="traction", **options) for scene in scenes]


def places(path):
    return np.array([*(event.H for event in path.events), path.H[-1]])


def main():
    scenes = [Scene(random_loop(order, seed), LAW) for order, seed in SEEDS]
    wanted = paths(scenes, rtol=1e-13, atol=1e-15, max_step=0.01)
    for scene, path in zip(scenes, wanted, strict=True):
        kinds = [event.kind for event in path.events]
        print(len(scene.graph.x), path.status, kinds.count("yield"), len(kinds))
    print("rtol  error  ms a path  same events")
    for rtol in (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12):
        begin = time.process_time()
        found = paths(scenes, rtol=rtol, atol=1e-2 * rtol)
        spent = (time.process_time() - begin) / len(scenes)
        same = [len(p.events) == len(w.events) for p, w in zip(found, wanted, strict=True)]
        error = max(
            np.abs(places(p) - places(w)).max()
            for p, w, alike in zip(found, wanted, same, strict=True) if alike
        )  # fmt: skip
        print(f"{rtol:.0e}  {error:.1e}  {1e3 * spent:.1f}  {sum(same)} of {len(same)}")


if __name__ == "__main__":
    main()
