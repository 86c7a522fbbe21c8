"""States of 2,000 discs at rest, and the levels of dead load under which Yade found rest again.

Made by `tests/tools/yade_rest.py`, which says when a level is at rest. Each level starts from rest
under the one before; the last of a direction is the first under which Yade found none. All three
were made by Yade 2023.02a in periodic cells (radii lognormal, 6 to 18 mm; compaction to 400 N/m
with a friction of 0.1, then 0.5; axis 2 compressed, 400 N/m along axis 1), stopped and held at
their cell:

- slow: axial strain .0074, at its peak (inertial number 5e-5); held from 401, 820 N/m to 403, 814;
- dense: another packing, .029, past its peak (2e-4); held from 427, 811 to 416, 740 N/m, and again;
- held: the moving state of `yade_held.npz` without its velocities; held from 401, 811 to 401, 811.

The last levels are put on at an inertial number of 2e-6 (held), 6e-6 (slow) and 1e-5 (dense).
"""

from pathlib import Path

import numpy as np
import pandas as pd

from loops import GrainGraph, LinearFrictional

STATES = ("slow", "dense", "held")
LAW = LinearFrictional(1e6, 5e5, 0.5, "radii")
PARTS = ("x", "radii", "contacts", "images", "cell", "normal_force", "shear_force")
# Strain of a level that is a large motion.
LARGE = 3e-4


def yade_rest(state):
    """The graph at rest, its law, and a table of levels for each direction in degrees.

    `load` (N/m) along (cos, sin) in the plane (P11, P22), compression positive; `at_rest`; `H11`,
    `H22` from the held state on and `strain`, the norm of their change in the level; `P11`, `P22`,
    the stress in addition to the start's; `unbalanced` and `kinetic` (largest energy, J); `steps`.
    """
    with np.load(Path(__file__).with_name(f"yade_rest_{state}.npz")) as stored:
        graph = GrainGraph(**{part: stored[part] for part in PARTS})
        table = pd.DataFrame({name: stored[f"level {name}"] for name in stored["columns"]})
    levels = {degrees: own.reset_index(drop=True) for degrees, own in table.groupby("degrees")}
    return graph, LAW, levels


def bracket(levels, of="rest"):
    """Loads between which Yade first found no rest, or first moved by a large strain; inf: never.

    `of="large"`: the strain of the level exceeds `LARGE`, or it found no rest.
    """
    ends = ~levels["at_rest"].to_numpy()
    if of == "large":
        ends |= levels["strain"].to_numpy() > LARGE
    load = np.concatenate([[0.0], levels["load"], [np.inf]])
    first = int(np.argmax(ends)) if ends.any() else len(ends)
    return load[first], load[first + 1]
