"""States of 2,000 discs at rest, and the levels of dead load under which Yade found rest again.

Made by `tests/tools/yade_rest.py` of revision 755ec1cc, which says when a level is at rest. Each
level starts from rest under the one before; the last of a direction is the first under which Yade
found none. The states are of periodic samples (Yade 2023.02a, radii lognormal and cut at 6 and
18 mm), stopped and held:

- slow: compacted to 400 N/m with a friction of 0.1, sheared with 0.5 to an axial strain of 0.0074,
  near the peak, at an inertial number of 5e-5; stress 401, 820 N/m, held 403, 814;
- dense: other grains, strain 0.029, at 2e-4: 427, 811 N/m, held 416, 740;
- held: the moving state of `yade_held.npz` without its velocities: 401, 811 N/m, held 401, 811.

The last levels are put on at an inertial number of 2e-6 (held), 6e-6 (slow) and 1e-5 (dense).
Both directions of dense, slow at 90 and held at 120 degrees were loaded again by levels of 1 to
3 %, in 1,000 (slow), 4,000 (dense) and 8,000 steps (held) each, held for up to 80,000. Levels 50 %
apart, put on in 1,000, set off the motion of dense at 150 degrees under 10.9 N/m. held at 120, both
directions of dense, and slow at 150 degrees as a control, stand here as loaded once more, by the
driver's rule `moved`, from the loads under which they had moved: 1.545, 13.314, 15.898, 2.989 N/m.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from loops import GrainGraph, LinearFrictional

STATES = ("slow", "dense", "held")
LAW = LinearFrictional(1e6, 5e5, 0.5, "radii")
PARTS = ("x", "radii", "contacts", "images", "cell", "normal_force", "shear_force")
# Strain of a level that moves, and its strain per load over that of the level before.
MOVES = 1e-4
SOFTER = 10.0


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


def bracket(levels):
    """Loads between which the sample first moved in Yade; inf: never.

    A level moves if it finds no rest, or strains by 1e-4 and by ten times as much as the level
    before, per load. Those without rest were left under way: the last ones of held at 150 and 180
    degrees, followed on, strained by 3.01e-4 and 3.05e-4 and were at rest again after some 40,000
    steps.
    """
    load = np.concatenate([[0.0], levels["load"], [np.inf]])
    slope = levels["strain"].to_numpy() / np.diff(load[:-1])
    moves = ~levels["at_rest"].to_numpy()
    moves[1:] |= (levels["strain"].to_numpy() > MOVES)[1:] & (slope[1:] > SOFTER * slope[:-1])
    first = int(np.argmax(moves)) if moves.any() else len(moves)
    return load[first], load[first + 1]
