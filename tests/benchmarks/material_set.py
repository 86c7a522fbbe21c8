"""Time of a material's steps: 100,008 hexagons, 1,000 steps.

`python -m tests.benchmarks.material_set affine|traction [STEPS]`: 2,778 points of 36 hexagons each,
each point strained by .05 in a direction of its own, on two threads.
"""

import sys
import time

import numpy as np

from grainloops import LoopMaterial, oriented
from loops import LinearFrictional
from patterns import regular_polygon

POINTS, ORIENTATIONS = 2778, 36
LAW = LinearFrictional(1.0, 0.5, np.tan(np.radians(30)))


def main(closure, steps=1000):
    """Take the steps; print seconds by the clock, of the processor, and per loop and step."""
    loops = oriented(regular_polygon(6), ORIENTATIONS)
    material = LoopMaterial(loops, None, LAW, closure=closure, threads=2)
    # Compression along one axis; across it from extension to as much compression.
    angle = np.radians(np.linspace(-20.0, 45.0, POINTS))
    H = 0.005 * np.eye(2) + 0.05 * np.stack([np.cos(angle), np.sin(angle)], -1)[:, None] * np.eye(2)
    state = material.start(POINTS)
    material.update(np.tile(np.eye(2), (POINTS, 1, 1)), state)
    wall, processor = time.perf_counter(), time.process_time()
    for k in range(1, steps + 1):
        response = material.update(np.eye(2) - k / steps * H, state)
        state = response.state
        if k % 100 == 0:
            spent = time.perf_counter() - wall, time.process_time() - processor
            print(k, *(f"{seconds:.0f} s" for seconds in spent), flush=True)
    wall, processor = time.perf_counter() - wall, time.process_time() - processor
    each = processor / (POINTS * ORIENTATIONS * steps)
    sliding, lost = response.regimes[:, 1].mean(), response.failed.mean()
    print(
        f"{closure}, {POINTS * ORIENTATIONS} loops, {steps} steps: {wall:.0f} s by the clock, "
        f"{processor:.0f} s of processor, {1e6 * each:.3f} us per loop and step; at the end "
        f"{sliding:.0%} of the contacts slide, {lost:.1%} of the loops are lost"
    )


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:]))
