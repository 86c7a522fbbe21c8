"""The study behind `grainloops sustain`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from functools import partial
from hashlib import blake2b
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from loops import InputError
from loops.arrays import Floats
from loops.contacts import contacts_at_start
from loops.errors import check_choice
from loops.scene import Scene, Subject, scene_of
from stability import COMPONENTS
from stability.packing import Sustained
from stability.packing import sustain as sustain_packing
from stability.packing.hold import HoldControl
from stability.packing.regime_regions import Subspace
from stability.packing.sustain import LARGE, Loading, load_path
from stability.path import Path as LoadedPath
from studies.clock import Progress
from studies.frames import load_table, loop_work_table, order_work_table, work_shares
from studies.output import (
    Summary,
    code_version,
    components,
    readable,
    require_folder,
    values_of,
)
from studies.questions import Sustaining, taken
from studies.reading import read_planar, reading
from studies.series.workers import Store, do_all, open_runner, run_here
from studies.snapshot.in_packing import held_snapshot, scene_at_rest
from studies.study import files_of, study

# Columns by the names of the attributes: of a direction's path, of its motions and their modes.
LOADS = ("status", "first_large_load", "first_large_strain", "first_large_spread", "limit",
         "limit_spread", "first_instability", "first_event")  # fmt: skip
MOTION = ("status", "lost", "load", "cause", "contact")
COUNTS = ("opened", "closed", "slid")
ENDED = ("released", "kinetic", "steps", *COUNTS)


def run_sustain(
    path: Path,
    out: Path,
    *,
    spread: bool = True,
    hold_stress: bool = False,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
    **how: Any,
) -> Summary:
    """Find the loads that a snapshot sustains, write tables, figures and a report; the summary.

    `how` are the options of `Sustaining` and `read_planar`, and files of `study`. Finished
    directions are kept beside `out`: the same call continues an interrupted run.
    """
    control: HoldControl = "stress" if hold_stress else "strain"
    asked: dict[str, Any] = asdict(taken(Sustaining, how)) | {"spread": spread}
    files = files_of(how)
    configuration = {"path": path, **reading(**how), **asked, "hold": control}
    require_folder(out, force=files.get("force", False))
    with study("sustain", out, configuration, **files) as results:
        moving = read_planar(path, **how)
        _followable(moving.scene, asked["subspace"])
        snapshot, held = held_snapshot(moving, control)
        scene = snapshot.scene
        store = Store(out.absolute(), _digest(scene, asked))
        with open_runner(workers, scheduler, []) as runner:

            def follow(directions: Floats, loading: Loading) -> list[LoadedPath]:
                load = partial(_load, scene, loading)
                return do_all(runner, load, directions, store, progress)

            found = sustain_packing(scene, **asked, follow=follow)
        tables = sustain_tables(found)
        told = asked | {"largest": found.largest, "held": held, "notes": list(snapshot.notes)}
        told |= sustain_summary(found, tables)
        title = f"Loads that {readable(path.name)} sustains"
        summary = results.write_packing(title, snapshot, found, tables, told)
    store.remove()
    return summary


def sustain(
    scene: Subject,
    directions: ArrayLike = 24,
    *,
    subspace: Subspace = "diagonal",
    largest: float | None = None,
    interval: float = 5e-6,
    large: float = LARGE,
    most_snaps: int = 30,
    spread: bool = True,
    hold: HoldControl = "strain",
    progress: Progress | None = None,
) -> Sustained:
    """Load a packing along directions of stress until its first large motion.

    The sample is brought to rest first. Each direction of the stress rate is followed from event to
    event; where its equilibrium is lost the load is kept constant and the equations of motion tell
    whether the sample comes to rest again. The first motion whose strain reaches `large`, or that
    does not come to rest, ends the direction.

    Parameters
    ----------
    scene : Scene or Snapshot
        A packing with forces, periodic or between known walls, under the linear frictional law or
        Hertz and Mindlin's.
    directions : int or (D, m) array_like
        How many, evenly spread; or the directions themselves (m = 2, or 3 with shear), compression
        positive.
    subspace : {'diagonal', 'symmetric'}
        Components (11, 22), or (11, 22, (12 + 21)/sqrt 2).
    largest : float, optional
        Load (force per length) up to which each direction is followed; by default a tenth of the
        mean stress.
    interval : float
        Strain over which the geometry is kept; halved before the first loss of equilibrium until
        that changes by less than 1 %.
    large : float
        Strain from which on a motion is large.
    most_snaps : int
        Smaller motions after which a direction is left 'unfinished'.
    spread : bool
        Whether directions with a large motion are loaded again: with two other numberings of grains
        and contacts, with a third of the damping, and with grains without load that coast; four to
        fourteen times the cost.
    hold : {'strain', 'stress'}
        Whether the sample comes to rest at a fixed cell or at fixed stress.
    progress : callable, optional
        Called after each direction with how many are done, the seconds that the others will take
        at their pace, and how many are left.

    Returns
    -------
    Sustained
        First large motions, limits (the first loss of equilibrium) and modes by direction; see
        `stability.packing.Sustained`.

    Raises
    ------
    InputError
        If a snapshot has no forces, there is neither cell nor known walls, an option is out of its
        range, or the sample does not come to rest.

    Examples
    --------
    A square lattice of discs under 0.01 along each axis comes apart without it:

    >>> import grainloops as gl
    >>> import numpy as np
    >>> lattice = gl.GrainGraph(x=[[0, 0], [1, 0], [0, 1], [1, 1]], radii=[0.5005] * 4,
    ...     contacts=[[0, 1], [1, 0], [2, 3], [3, 2], [0, 2], [2, 0], [1, 3], [3, 1]],
    ...     images=[[0, 0], [1, 0], [0, 0], [1, 0], [0, 0], [0, 1], [0, 0], [0, 1]],
    ...     cell=2 * np.eye(2), normal_force=np.full(8, 0.001))
    >>> scene = gl.Scene(lattice, gl.LinearFrictional(1.0, 0.5, 0.5))
    >>> found = gl.sustain(scene, [[-1, 0], [1, 0]], largest=0.002)
    >>> found.status.tolist(), found.limit.round(6).tolist()
    (['large motion, no rest', 'held'], [0.001, nan])
    """
    check_choice("hold", hold, get_args(HoldControl))
    _followable(scene_of(scene), subspace)
    how: dict[str, Any] = {"subspace": subspace, "largest": largest, "interval": interval}
    how |= {"large": large, "most_snaps": most_snaps, "spread": spread}
    at_rest = scene_at_rest(scene, hold)

    def follow(directions: Floats, loading: Loading) -> list[LoadedPath]:
        load = partial(_load, at_rest, loading)
        return do_all(run_here, load, directions, None, progress)

    return sustain_packing(at_rest, directions, follow=follow, **how)


def _followable(scene: Scene, subspace: Subspace) -> None:
    """Refuse what can't be loaded before it is held."""
    if scene.graph.cell is None:
        if scene.boundary.kind != "walls":
            expected, remedy = "either of them", "Give --cell, or the wall contacts."
            raise InputError("the sample", "no cell and no walls", expected, remedy)
        if subspace == "symmetric":
            remedy = "Walls can't shear the sample: leave --subspace out."
            raise InputError("subspace", "'symmetric'", "'diagonal' between walls", remedy)
    contacts_at_start(scene, still=True)


def _load(scene: Scene, loading: Loading, direction: Floats) -> LoadedPath:
    return load_path(scene, direction, loading, scene.faces)


def _digest(scene: Scene, asked: dict[str, Any]) -> str:
    """Digest of all that the directions depend on."""
    law = scene.law
    # Beside a spring for rolling stands the law of the forces.
    parts = scene.graph, scene.boundary.walls, law, vars(law).get("law")
    said = f"{code_version()} {asked} {law.shear_increment} {law.shear_history}"
    digest = blake2b(said.encode(), digest_size=8)
    for values in (value for part in parts if part is not None for value in vars(part).values()):
        if isinstance(values, np.ndarray):
            digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()


def direction_table(found: Sustained) -> pd.DataFrame:
    """One row a direction: loads, spreads, strain, snaps, mode; w2 of the rate problem beside."""
    rows = []
    for path in found.paths:
        mode, rested = path.mode, [one for one in path.motions if one.status == "at rest"]
        taken = [float(np.linalg.norm(one.strain)) for one in rested]
        row = {
            **values_of(path, *LOADS),
            "snaps": len(taken),
            "snap_strain": sum(taken),
            "largest_snap": max(taken, default=0.0),
            "released": path.work[-1, 3] - path.work[0, 3],
            "balance_error": path.balance_error,
            "mode_cause": "" if mode is None else mode.cause,
            "mode_load": np.nan if mode is None else mode.load,
            "mode_grains": 0 if mode is None else len(mode.grains),
        }
        counts = dict.fromkeys(COUNTS, 0) if mode is None else values_of(mode, *COUNTS)
        rows.append(row | {f"mode_{name}": count for name, count in counts.items()})
    head = {"theta_deg": np.degrees(found.theta)}
    head |= zip(("n11", "n22", "n12"), found.directions.T, strict=False)
    ends = components("H", np.array([path.H[-1] for path in found.paths]))
    ends |= components("P", np.array([path.P[-1] for path in found.paths]))
    beside = {"rate_status": found.rates.status, "rate_w2": found.rates.normalised}
    return pd.DataFrame(head).join(pd.DataFrame(rows)).assign(**ends, **beside)


def sustain_tables(found: Sustained) -> dict[str, pd.DataFrame]:
    """Tables of directions, motions at constant load, paths, and loops in the modes."""
    faces, weakest, strains = found.scene.faces, weakest_of(found), [f"H{ij}" for ij in COMPONENTS]
    order, area = faces.order[faces.loops], faces.area[faces.loops]
    motions, paths, works = [], [], []
    for angle, path in zip(np.degrees(found.theta), found.paths, strict=True):
        for one in path.motions:
            row = {"theta_deg": angle} | values_of(one, *MOTION)
            row |= zip(strains, one.strain, strict=True)
            motions.append(row | values_of(one, *ENDED) | {"grains": len(one.grains)})
        paths.append(load_table(path))
        paths[-1].insert(0, "theta_deg", angle)
        if path.mode is not None:
            works.append((angle, path.mode.loop_work))
    mode = None if weakest is None else found.paths[weakest].mode
    work = np.zeros(len(order)) if mode is None else mode.loop_work
    orders = pd.DataFrame(columns=["theta_deg", "order", "loops", "area_share"])
    if works:
        angles, each = (np.array(column) for column in zip(*works, strict=True))
        orders = order_work_table(angles, each, order, area)
        orders = orders[[*orders.columns[:5], "negative", "W2_share", "negative_share"]]
    return {
        "sustain": direction_table(found),
        "motions": pd.DataFrame(
            motions, columns=["theta_deg", *MOTION, *strains, *ENDED, "grains"]
        ),
        "paths": pd.concat(paths, ignore_index=True),
        "orders": orders,
        "loops": loop_work_table(order, area, work),
    }


def weakest_of(found: Sustained) -> int | None:
    """The direction with the least load of a large motion, else of a lost equilibrium."""
    for loads in (found.first_large_load, found.limit):
        if not np.isnan(loads).all():
            return int(np.nanargmin(loads))
    return None


def sustain_summary(found: Sustained, tables: dict[str, pd.DataFrame]) -> Summary:
    """Summary of the loads that a sample sustains."""
    rates = found.rates
    statuses, counts = np.unique(found.status, return_counts=True)
    weakest, row, shares = weakest_of(found), None, {}
    if weakest is not None:
        names = ["theta_deg", "status", "first_large_load", "first_large_strain"]
        names += ["first_large_spread", "limit", "limit_spread", "snaps"]
        names += ["mode_grains", "mode_opened", "mode_closed", "mode_slid"]
        whole = tables["sustain"][names].astype(object)
        row = whole.where(whole.notna() & (whole != np.inf), None).iloc[weakest].to_dict()
        row["limit_converged"] = found.paths[weakest].limit_spread < np.inf
        orders = tables["orders"]
        shares = work_shares(orders[orders["theta_deg"] == row["theta_deg"]])
    return {
        "loops": len(tables["loops"]),
        "orders": shares,
        "rate_cones": np.degrees(rates.cones),
        "rate_undetermined": int(np.count_nonzero(~rates.determined)),
        "largest_limit_spread": _largest(path.limit_spread for path in found.paths),
        "largest_first_large_spread": _largest(path.first_large_spread for path in found.paths),
        "seconds": sum(path.seconds for path in found.paths),
        "spread_seconds": sum(path.spread_seconds for path in found.paths),
        "statuses": dict(zip(statuses.tolist(), counts.tolist(), strict=True)),
        "stress": found.stress,
        "weakest": row,
        "balance_error": max(path.balance_error for path in found.paths),
    }


def _largest(spreads: Iterable[float]) -> float | None:
    """Largest of the spreads that are known; None if none is, or if one is infinite."""
    known = [one for one in spreads if not np.isnan(one)]
    return max(known) if known and np.isfinite(known).all() else None
