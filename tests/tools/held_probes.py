"""Hold and probe every snapshot of a collection: `python -m tests.tools.held_probes DEM OUT.csv`.

Writes one row a snapshot, and prints one line of a table for each series. With numbers of snapshots
of `yade-slow` after it the motion of these in twelve strain directions, answered or not.
"""

import csv
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd

from loops import InputError, Scene
from loops.contacts import contacts_of, start_state
from patterns import read_snapshot
from stability.packing.equations_of_motion import Moving, masses_of, servo_of, step_of
from stability.packing.hold import hold
from stability.packing.probe import probe_edge
from stability.packing.yielding import yield_response
from studies.probe import probe
from studies.snapshot.in_packing import held_snapshot

SOFT = {"kn": 1e6, "kt": 5e5, "mu": 0.5}


def snapshots(collection):
    """Series, path and options of reading of every snapshot with forces."""
    for folder in sorted(collection.glob("yade-*")):
        macro = folder / "macro.csv"
        if not macro.exists():
            continue
        cells = pd.read_csv(macro).set_index("snap")
        for path in sorted(folder.glob("grains_*")):
            if "plain" in path.name:
                continue
            number = int("".join(c for c in path.name if c.isdigit())[:2])
            how = {}
            if "h_xx" in cells:
                names = ["h_xx", "h_xy", "h_yx", "h_yy"]
                how["cell"] = cells.loc[number, names].to_numpy(float).reshape(2, 2)
            yield folder.name, path, how
    for path in sorted((collection / "lammps" / "periodic").glob("dump.atoms*")):
        yield "lammps periodic", path, SOFT
    for path in sorted((collection / "lammps" / "walls").glob("dump.atoms*")):
        yield "lammps walls", path, SOFT
    for path in sorted((collection / "liggghts").glob("atoms*")):
        yield "liggghts", path, SOFT | {"mu": 0.3}
    for path in sorted((collection / "liggghts" / "gravity").glob("atoms*")):
        yield "liggghts gravity", path, SOFT


def measured(path, how):
    """What holding changed, and the share of 72 strain directions that is answered."""
    snapshot = read_snapshot(path, **how)
    begin = time.process_time()
    at_rest, held = held_snapshot(snapshot, "strain")
    between = time.process_time()
    found = probe(at_rest, 72)
    end = time.process_time()
    before, after = held["stress_before"], held["stress"]
    return {
        "unbalanced": held["unbalanced_before"],
        "answered": float(np.mean(found.determined | (found.status == "none"))),
        "hold_s": between - begin,
        "probe_s": end - between,
        "stress_change": float(np.linalg.norm(after - before) / np.linalg.norm(before)),
        "forces_changed": held["forces_changed"],
        "spread": held["spread"],
        "candidates": found.candidates,
        "smallest_w2": None if found.softest is None else float(found.normalised[found.softest]),
        "statuses": "; ".join(
            f"{count} {name}"
            for name, count in zip(*np.unique(found.status, return_counts=True), strict=True)
        ),
    }


def motions(snapshot, directions, strain=1e-8, steps=20_000, looks=5):
    """Probe of the held state, and its rates of stress and fastest grain in parts of a slow strain.

    Contacts of the yield band are put on their limit, what this leaves out of balance is a load.
    (D, looks, 2, 2) in place of `P'`; (D, looks) speeds over the strain rate, in mean radii.
    """
    held = hold(Scene(snapshot.graph, snapshot.law), unbalanced=1e-8)
    graph, law = held.graph, held.law
    edge = yield_response(Scene(graph, law), yield_band=0.99)
    found = probe_edge(edge, directions)
    rows, shear = edge.system.contacts[edge.rows], graph.shear_force.copy()
    mu = np.broadcast_to(law.mu, shear.shape)
    shear[rows] = np.sign(shear[rows]) * mu[rows] * graph.normal_force[rows]
    start = contacts_of(start_state(graph.replace(shear_force=shear)), law)
    masses, inertias = masses_of(graph.radii)
    dt, servo = step_of(masses, inertias, start), servo_of(start, masses)
    stresses, speeds = [], []
    for direction in found.directions:
        gradient = -np.diag(direction) * strain / (steps * dt)
        moving = Moving(start, masses, inertias, servo, gradient=gradient)
        moving.load(-moving.motion.resultant)
        for _ in range(looks):
            moving.run(steps // looks, dt)
            stresses.append(moving.state().stress)
            fastest = np.linalg.norm(moving.motion.velocity, axis=1).max()
            speeds.append(fastest * steps * dt / strain / start.mean_radius)
    shape = len(found.directions), looks
    path = np.reshape(stresses, (*shape, 2, 2))
    first = np.broadcast_to(start.stress, (shape[0], 1, 2, 2))
    rates = np.diff(path, axis=1, prepend=first) * looks / strain
    return found, rates, np.reshape(speeds, shape)


def print_motions(collection, numbers):
    """A line a direction: status, fastest grain of each part, error of the stress rates."""
    series = {path.name: how for name, path, how in snapshots(collection) if name == "yade-slow"}
    for number in numbers:
        name = f"grains_{int(number):02d}.parquet"
        how = series[name] | {"shear_increment": "radii"}
        found, rates, speeds = motions(read_snapshot(collection / "yade-slow" / name, **how), 12)
        told = found.stress_rate[:, None]
        off = np.linalg.norm(rates - told, axis=(2, 3)) / np.linalg.norm(told, axis=(2, 3))
        for row in zip(found.theta, found.status, speeds, off, strict=True):
            print(name, *(np.round(part, 4) if part is not row[1] else part for part in row))


def main(collection, out, *numbers):
    """Measure all snapshots, a line as each is done."""
    if numbers:
        print_motions(Path(collection), numbers)
        return
    rows = []
    for series, path, how in snapshots(Path(collection)):
        try:
            row = measured(path, how)
        except InputError as error:
            row = {"refused": str(error)[:160]}
        rows.append({"series": series, "snapshot": path.name, **row})
        print(rows[-1], flush=True)
    table = pd.DataFrame(rows)
    table.to_csv(out, index=False, quoting=csv.QUOTE_MINIMAL, float_format="%.4g")
    for series, part in table.groupby("series", sort=False):
        known = part.dropna(subset=["answered"]) if "answered" in part else part.iloc[:0]
        if not len(known):
            print(f"| {series} | {len(part)} | refused |")
            continue
        spans = [
            " to ".join(f"{v:.2g}" for v in np.quantile(known[name], [0.0, 1.0]))
            for name in ("unbalanced", "stress_change", "spread", "hold_s", "probe_s")
        ]
        print(f"| {series} | {len(known)} of {len(part)} | {known.answered.min():.3f} |", *spans)


if __name__ == "__main__":
    main(*sys.argv[1:])
