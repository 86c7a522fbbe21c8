"""Replays of a series on several ways: last stress against the later snapshot's, and AUC.

`python -m tests.tools.scaling.replays FOLDER --snapshots 22 23 24 [--cells FOLDER/macro.csv]
[--table way.csv]`, FOLDER with tables of Yade and `macro.csv`; prints a row an interval and way.
"""

import argparse
from itertools import pairwise
from pathlib import Path

import numpy as np

from loops import Scene
from patterns.snapshots.snapshot import sample_boundary
from stability.packing import loop_changes, replay
from studies.reading import plan_series, reading
from studies.series.evolution import loop_increments, sample_strain, track_loops
from studies.series.loading import loading_between, read_strains
from studies.series.packing import Following, interval_rate, stress_error
from studies.series.skill import score_skill

WAYS = {
    "as it was made": {},
    "from rest": {"rest": True},
    "from rest, 5e-5": {"inertial_number": 5e-5},
    "damping 0.2": {"damping": 0.2},
    "mixed-2": {"programme": "mixed-2"},
    "2-first": {"programme": "2-first"},
}


def replayed(before, after, times, asked, rest):
    """Error of the last stress, AUC and base rate of negative work of one replay."""
    H, _ = sample_strain(before, after)
    made = loop_increments(before, after, track_loops(before, after))
    loading = loading_between(before, after, H, asked.programme, asked.table, times)
    rate = interval_rate(before, after, H, times, asked, loading)
    still = ("velocity", "spin") if rest else ()
    options = {name: value for name, value in rate.options.items() if name not in still}
    boundary, _ = sample_boundary(before)
    end = replay(
        Scene(before.graph, before.mechanics()[0], boundary),
        loading.strain,
        shares=loading.shares,
        damping=asked.damping,
        **options,
    ).state
    works = loop_changes(before.graph, end, before.faces).normalised_work[made["loop_before"]]
    score = score_skill(-works, np.asarray(made["w2"]), signed=False)
    return stress_error(end, after), score["auc"], score["base"]


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--snapshots", type=int, nargs="+", required=True)
    parser.add_argument("--cells", type=Path)
    parser.add_argument("--table", type=Path)
    given = parser.parse_args()
    paths = [next(given.folder.glob(f"grains_{k:02d}.*")) for k in given.snapshots]
    times, how = given.folder / "macro.csv", reading(shear_increment="radii")
    planned = plan_series(paths, given.cells, how, times)
    ways = dict(WAYS)
    if given.table:
        table = read_strains(given.table)
        ways["table"] = {"programme": table.name, "table": table}
    for one, two in pairwise(planned):
        before, after = one.read(), two.read()
        for name, how in ways.items():
            rest = how.get("rest", False)
            asked = Following(**{key: value for key, value in how.items() if key != "rest"})
            error, auc, base = replayed(before, after, (one.time, two.time), asked, rest)
            print(
                f"{one.name} {name:<18} {100 * error:.4f} % {auc:.4f} base {base:.3f}", flush=True
            )


if __name__ == "__main__":
    main()
