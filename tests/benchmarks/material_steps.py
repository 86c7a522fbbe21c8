"""Speed against error of a material's steps, with `follow` at the other end.

`python -m tests.benchmarks.material_steps OUT.png`: one regular hexagon, turned by .3 rad, under a
straight strain of (.05, .01); the error is that of the stress, over kn, from the path by events.
"""

import sys
import time

import numpy as np

from grainloops import LoopMaterial
from loops import LinearFrictional, Scene
from patterns import regular_polygon
from stability import Stage, follow, programmes
from studies.style import BLUE, VERMILION, new_figure, styled

LAW = LinearFrictional(1.0, 0.5, np.tan(np.radians(30)))
POINTS = 200
STRAIN = np.array([0.05, 0.0, 0.0, 0.01])


def loop():
    """The hexagon."""
    cos, sin = np.cos(0.3), np.sin(0.3)
    hexagon = regular_polygon(6)
    x = hexagon.x @ np.array([[cos, sin], [-sin, cos]])
    return hexagon.replace(x=x, x0=x)


def stepped(closure, steps):
    """Seconds for a loop's whole path, and the stress (11, 22) at its end."""
    material = LoopMaterial(loop(), None, LAW, closure=closure)
    material.update(np.tile(np.eye(2), (POINTS, 1, 1)), material.start(POINTS))
    state, begin = material.start(POINTS), time.process_time()
    for k in range(1, steps + 1):
        F = np.eye(2) - STRAIN.reshape(2, 2) * k / steps
        response = material.update(np.tile(F, (POINTS, 1, 1)), state)
        state = response.state
    return (time.process_time() - begin) / POINTS, response.stress[0].ravel()[[0, 3]]


@styled()
def main(out):
    """Measure, print and draw."""
    programme = programmes.combination(np.zeros((4, 4)), np.eye(4), STRAIN, "straight")
    figure = new_figure(height=3.0)
    ax = figure.add_subplot()
    for closure, colour in (("affine", BLUE), ("traction", VERMILION)):
        begin = time.process_time()
        path = follow(Scene(loop(), LAW), Stage(programme, "parameter", 1.0), closure=closure)
        seconds, exact = time.process_time() - begin, path.P[-1][[0, 3]]
        found = [stepped(closure, steps) for steps in (1, 4, 16, 64, 256, 1024)]
        # The path by events has a tolerance of 1e-12.
        errors = [max(float(np.abs(P - exact).max()), 1e-16) for _, P in found]
        print(closure, f"follow {seconds:.2f} s;", [f"{t:.1e} s {e:.1e}"
              for (t, _), e in zip(found, errors, strict=True)])  # fmt: skip
        ax.loglog([t for t, _ in found], errors, "o-", color=colour, label=f"material, {closure}")
        ax.loglog(seconds, 1e-12, "s", color=colour, label=f"follow, {closure}")
    ax.set_xlabel("processor time for one loop (s)")
    ax.set_ylabel("error of the stress over $k_n$ (–)")
    ax.legend(loc="best")
    figure.savefig(out, dpi=300)


if __name__ == "__main__":
    main(sys.argv[1])
