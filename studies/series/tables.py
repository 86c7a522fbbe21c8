"""Loops of several snapshots in memory, as data frames: fates, increments, one table of all."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
from numpy.typing import ArrayLike

from loops import InputError
from loops.errors import check_type, counted, listed, path_of
from patterns import Snapshot, planar
from stability import COMPONENTS
from studies.frames import loop_table
from studies.output import Row, folder_for_files, provenance
from studies.reading import plan_series, reading
from studies.series import evolution
from studies.series.evolution import chain_bends
from studies.series.packing import facts, nonaffinity
from studies.series.skill import actual_values, score_skill
from studies.snapshot.table import loop_columns

File = str | os.PathLike[str]


def fates(before: Snapshot, after: Snapshot) -> pd.DataFrame:
    """One row a loop: its fate between two snapshots.

    Parameters
    ----------
    before, after : Snapshot
        Earlier and later state of one sample, grains known by their ids.

    Returns
    -------
    pandas.DataFrame
        A row a loop of the earlier snapshot, then one a loop that was born: `loop_before`, its
        number (-1 if born); `fate`, see `loop_fates`; `successor`, the later loop that shares most
        sides with it (-1 for none), `successors`, all that share any; `order_before`, `order_after`
        (of the successor), 0 for none; `chain_bend` (degrees), the largest bend of a segment of a
        force chain with a link among the loop's contacts (`ForceChains.bending`; above 1 it
        buckles), nan beside none.

    Raises
    ------
    InputError
        If branches cross, or ids repeat.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_path
    >>> snapshot = read_snapshot(sample_path())
    >>> fates(snapshot, snapshot)["fate"].value_counts().to_dict()
    {'survived': 309}
    """
    before, after = planar(before), planar(after)
    found = evolution.track_loops(before, after)
    return _frame("fates", evolution.fate_columns(found, chain_bends(before, after)[1]))


def increments(before: Snapshot, after: Snapshot) -> pd.DataFrame:
    """One row a loop that survives: its strain, stress and second-order work between two snapshots.

    Parameters
    ----------
    before, after : Snapshot
        Earlier and later state of one sample, grains known by their ids.

    Returns
    -------
    pandas.DataFrame
        `loop_before`, `loop_after`, `order`, `area`; displacement gradient `H11` to `H22` and
        `rotation` (degrees, anticlockwise); where both snapshots have a law `dP11` to `dP22`
        (nominal stress, force per length, compression positive), `hill_work`, `hill_cosine`; the
        work `W2` in the frame that turns with the loop and over the norms `w2`; `affine_W2` to
        `traction_free_W2`, predictions by tangents of the earlier state; `sliding_contacts`.

    Raises
    ------
    InputError
        If branches cross, or ids repeat.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_path
    >>> snapshot = read_snapshot(sample_path())
    >>> table = increments(snapshot, snapshot)
    >>> len(table), float(table["H22"].abs().max()), float(table["W2"].abs().max())
    (309, 0.0, 0.0)
    """
    before, after = planar(before), planar(after)
    found = evolution.track_loops(before, after)
    return _frame("increments", evolution.loop_increments(before, after, found))


def skill(
    pairs: Iterable[tuple[Snapshot, Snapshot]], indicator: Callable[[Snapshot], ArrayLike]
) -> pd.DataFrame:
    """Measure how well an indicator of your own predicts what becomes of the loops.

    Parameters
    ----------
    pairs : iterable of (Snapshot, Snapshot)
        Earlier and later states, of one sample or of several, with forces.
    indicator : callable
        Returns one number for each loop of the earlier snapshot, in the order of
        `snapshot.faces.loops`; a larger one predicts the target. Not a number where it knows
        nothing.

    Returns
    -------
    pandas.DataFrame
        A row for each pair (its place from 0), target and predictor: your `indicator`, and the
        trivial ones `order` (number of grains) and `smallest_N`. Targets are negative second-order
        work (`W2_negative`), the upper tenth of the non-affinity (`nonaffine`), a lost contact
        (`contact_lost`), any change of topology (`topology`). `base`, share of the loops with the
        target; `coverage`; `auc`, the chance that of two loops with and without it the first one
        has the larger number; `rank_correlation`; `loops`.

    Raises
    ------
    InputError
        If the indicator returns another number of values, forces are unknown, or branches cross.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_path
    >>> state = read_snapshot(sample_path())
    >>> table = skill([(state, state)], lambda one: one.faces.order[one.faces.loops])
    >>> table[["target", "predictor"]].drop_duplicates().groupby("target").size().to_dict()
    {'W2_negative': 3, 'contact_lost': 3, 'nonaffine': 3, 'topology': 3}
    """
    rows: list[Row] = []
    remedy = "Give pairs of snapshots, and a function of one."
    check_type("indicator", indicator, Callable, remedy)
    check_type("pairs", pairs, Iterable, remedy)
    for place, pair in enumerate(pairs):
        both = listed(f"pairs[{place}]", pair, Snapshot, remedy)
        if len(both) != 2:
            raise InputError(f"pairs[{place}]", counted(len(both), "snapshot"), "two", remedy)
        before, after = map(planar, both)
        before.mechanics()
        after.mechanics()
        found = evolution.track_loops(before, after)
        own, state = evolution.loop_increments(before, after, found), facts(before, found)
        own["nonaffinity"] = nonaffinity(own, evolution.interval_row(before, after, found, own))
        score = np.asarray(indicator(before), dtype=float)
        if score.shape != state["order"].shape:
            raise InputError(
                f"indicator of pair {place}",
                f"an array of shape {score.shape}",
                f"one number for each of the {len(state['order'])} loops of the earlier snapshot",
                "Return them in the order of snapshot.faces.loops.",
            )
        scores = {
            "indicator": score,
            "order": state["order"].astype(float),
            "smallest_N": -state["smallest_N"],
        }
        for target, value in actual_values(own, state).items():
            for name, values in scores.items():
                measured = score_skill(values, value, signed=False)
                for signed in ("agreement", "precision", "recall"):
                    del measured[signed]
                rows.append({"pair": place, "target": target, "predictor": name} | measured)
    return _frame("skill", {name: [row[name] for row in rows] for name in rows[0]} if rows else {})


def series(
    snapshots: Iterable[File | Snapshot], cells: File | None = None, **how: Any
) -> pd.DataFrame:
    """One row a loop of each of several snapshots, with the strain of the sample between them.

    Parameters
    ----------
    snapshots : iterable of path or Snapshot
        In the order of time, such as `sorted(folder.glob("grains_*.csv"))`; of a file with several
        snapshots all.
    cells : path, optional
        Table of the periodic cells of files: `snap`, `h_xx`, `h_xy`, `h_yx`, `h_yy`.
    **how
        Options of `read_snapshot`, the same for all files.

    Returns
    -------
    pandas.DataFrame
        `snapshot`, its place from 0; displacement gradient of the sample since the first snapshot
        `sample_H11` to `sample_H22`, and over the interval that led here `sample_dH11` to
        `sample_dH22` (from the cells, else from the motion of the grains; nan for the first); then
        the columns of `loop_table`.

    Raises
    ------
    InputError
        As `read_snapshot`; if branches cross or there is no snapshot.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_path
    >>> state = read_snapshot(sample_path())
    >>> table = series([state, state])
    >>> table.groupby("snapshot")["sample_H22"].agg(["size", "max"]).to_numpy().tolist()
    [[309.0, 0.0], [309.0, 0.0]]
    """
    if isinstance(snapshots, str | os.PathLike):
        remedy = f"Write sorted(glob.glob({os.fspath(snapshots)!r})), or put it in brackets."
        raise InputError("snapshots", f"one text, {os.fspath(snapshots)!r}", "a list", remedy)
    tables: list[pd.DataFrame] = []
    F, before = np.eye(2), None
    kinds, remedy = (str, os.PathLike, Snapshot), "Give files or snapshots in the order of time."
    for place, state in enumerate(_read(listed("snapshots", snapshots, kinds, remedy), cells, how)):
        dH = np.full((2, 2), np.nan)
        if before is not None:
            dH = evolution.sample_strain(before, state)[0]
            F = (np.eye(2) - dH) @ F
        own: dict[str, float] = {"snapshot": place}
        own |= {f"sample_H{ij}": h for ij, h in zip(COMPONENTS, (np.eye(2) - F).flat, strict=True)}
        own |= {f"sample_dH{ij}": h for ij, h in zip(COMPONENTS, dH.flat, strict=True)}
        loops = loop_table(state)
        strains = pd.DataFrame(own, index=loops.index)
        tables.append(pd.concat([strains, loops], axis="columns"))
        before = state
    frame = pd.concat(tables, ignore_index=True)
    frame.attrs = provenance("series", {})
    return frame


def animate(snapshots: Iterable[Snapshot], folder: str | os.PathLike[str]) -> None:
    """Write `animation.gif` of snapshots: their loops by order and by smallest eigenvalue.

    Parameters
    ----------
    snapshots : iterable of Snapshot
        States of one sample in order, such as `gl.read_frames(path)`.
    folder : path
        Made if it is not there; with the program ffmpeg it gets `animation.mp4` too.

    Raises
    ------
    InputError
        If there is no snapshot, branches cross, or a file is in place of the folder.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_path
    >>> animate([read_snapshot(sample_path())] * 2, "moving")  # doctest: +SKIP
    """
    from studies.series.figures import SMALLEST, AnimationFrame, animate_series

    states = listed("snapshots", snapshots, Snapshot, "Give snapshots in order.")

    def frames() -> Iterator[AnimationFrame]:
        for number, state in enumerate(map(planar, states)):
            smallest = loop_columns(state)[SMALLEST] if state.mechanical else None
            yield AnimationFrame(state, f"snapshot {number}", smallest)

    with folder_for_files(folder) as partial:
        animate_series(partial, frames(), provenance("loop_table", {}))


def _read(
    snapshots: Sequence[File | Snapshot], cells: File | None, how: dict[str, Any]
) -> Iterator[Snapshot]:
    files = [Path(one) for one in snapshots if not isinstance(one, Snapshot)]
    table = None if cells is None else path_of("cells", cells)
    if table is not None and not files:
        remedy = "Leave it out: snapshots in memory have their cells."
        raise InputError("cells", str(table), "files of snapshots", remedy)
    planned = plan_series(files, table, reading(**how)) if files or not snapshots else []
    for one in snapshots:
        if isinstance(one, Snapshot):
            yield planar(one)
            continue
        path = Path(one).absolute()
        for each in planned:
            if each.path == path:
                yield each.read()


def _frame(name: str, columns: dict[str, Any]) -> pd.DataFrame:
    frame: pd.DataFrame = pa.table(columns).to_pandas()
    frame.attrs = provenance(name, {})
    return frame
