"""What is to be foreseen of the loops of an interval, and what foresees it.

Of survived loops: negative second-order work, and with the packing the upper tenth of the actual
non-affinity. Of all earlier loops, with the packing: the loss of a contact, any change of topology.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
from numpy.typing import NDArray

from loops.arrays import Floats
from loops.loop_strain import rotation_and_stretch

Columns = dict[str, NDArray[Any]]
TARGET, *OTHERS = ("W2_negative", "nonaffine", "contact_lost", "topology")
# Predictors by what they are read from. A higher score means likelier. Closures foretell from the
# strain that the loop really took; `*_lambda_min` and the others know the earlier snapshot alone,
# persistence the loop's past; own motions are those of the interval, an upper bound.
OF_INCREMENTS = {
    "affine": "affine_W2",
    "affine_free": "affine_free_W2",
    "traction": "traction_W2",
    "traction_free": "traction_free_W2",
}
OF_LOOPS = (
    *("affine_lambda_min", "traction_lambda_min", "traction_free_lambda_min"),
    "packing_lambda_min",
)
# Closures know no strain of a loop that came apart.
OF_SURVIVED = ("W2_negative", "nonaffine")
# Who foretells by a sign: a score that is positive for what is foretold.
BY_EVENTS = {"packing_path": "path", "replay": "replay"}
EVENTS = ("packing", "own_motion", "persistence")
SIGNED: dict[str, tuple[str, ...]] = {
    "W2_negative": (*EVENTS, *BY_EVENTS, *OF_INCREMENTS, *OF_LOOPS),
    "nonaffine": (),
    "contact_lost": (*EVENTS, *BY_EVENTS),
    "topology": (*EVENTS, *BY_EVENTS),
}
TIMES = {"packing": "packing", "own_motion": "own", **BY_EVENTS}
STRAIN = ("H11", "H12", "H21", "H22")
READ = (
    *("snapshot_before", "snapshot_after", "loop_before", "loop_after", "order", "w2"),
    *("nonaffinity", "sliding_contacts", "smallest_N", "fate", "contact_lost"),
    *("packing_w2", "packing_nonaffinity", "packing_opening", "packing_closing"),
    *("path_w2", "path_nonaffinity", "path_opening", "path_closing"),
    *("replay_w2", "replay_nonaffinity", "replay_opening", "replay_closing"),
    *("own_w2", "own_opening", "own_closing", *STRAIN, *OF_INCREMENTS.values(), *OF_LOOPS),
)
# A time of 0 is as soon as can be.
SOONEST = 1e-12


def part_columns(part: Path) -> Columns:
    """What is needed of a part of any dataset."""
    there = pyarrow.parquet.read_schema(part).names
    names = [name for name in READ if name in there]
    table = pyarrow.parquet.read_table(part, columns=names)
    return {name: table.column(name).to_numpy() for name in names}


def targets(
    own: Columns, state: Columns, earlier: Columns | None
) -> Iterator[tuple[str, str, Floats, Floats, bool]]:
    """Target, predictor, its score, what is negative where it came true, whether signs foretell.

    `own` are the increments of an interval, `state` the table of its earlier snapshot and what the
    packing foretells, `earlier` the increments of the interval before. Values are of all loops.
    """
    # Over the square of the strain: a larger step has more work of either sign.
    H = np.stack([own[name] for name in STRAIN], axis=1).reshape(-1, 2, 2)
    square = np.sum(rotation_and_stretch(H)[1] ** 2, axis=(1, 2))
    size = np.where(square > 0, square, np.nan)
    closures = {
        name: _of_all(state, -own[column] / size, own["loop_before"])
        for name, column in OF_INCREMENTS.items()
    }
    known = {name: -state[name] for name in OF_LOOPS if name in state}
    counts = {"order": state["order"].astype(float)}
    counts["sliding"] = state["sliding_contacts"].astype(float)
    if "smallest_N" in state:
        counts["smallest_N"] = -state["smallest_N"]
    for target, value, foretold, past in _asked(own, state, earlier):
        strained = closures if target in OF_SURVIVED else {}
        scores = foretold | strained | known | {"persistence": past} | counts
        for name, score in scores.items():
            yield target, name, score, value, name in SIGNED[target]


def _asked(
    own: Columns, state: Columns, earlier: Columns | None
) -> Iterator[tuple[str, Floats, dict[str, Floats], Floats]]:
    """Target, its value, what the packing and the own motions foretell, and the past."""
    at = own["loop_before"]
    unknown = np.full(len(state["order"]), np.nan)

    def past(name: str) -> Floats:
        return unknown if earlier is None else _of_all(state, earlier[name], earlier["loop_after"])

    packed = "fate" in state
    work = {"packing": -state["packing_w2"], "own_motion": -state["own_w2"]} if packed else {}
    walked = {name: column for name, column in BY_EVENTS.items() if f"{column}_w2" in state}
    work |= {name: -state[f"{column}_w2"] for name, column in walked.items()}
    yield TARGET, _of_all(state, own["w2"], at), work, -past("w2")
    if not packed:
        return
    moved = own["nonaffinity"]
    tenth = np.quantile(moved, 0.9) - moved if len(moved) else moved
    nonaffinity = {"packing": state["packing_nonaffinity"]}
    nonaffinity |= {name: state[f"{column}_nonaffinity"] for name, column in walked.items()}
    yield "nonaffine", _of_all(state, tenth, at), nonaffinity, past("nonaffinity")
    # A loop that did not survive the interval before came to be in it.
    new = unknown if earlier is None else np.where(np.isnan(past("w2")), 1.0, -1.0)
    opening, closing = (
        {
            name: state[f"{column}_{what}"]
            for name, column in TIMES.items()
            if f"{column}_{what}" in state
        }
        for what in ("opening", "closing")
    )
    soon = {name: _soon(time) for name, time in opening.items()}
    yield "contact_lost", np.where(state["contact_lost"], -1.0, 1.0), soon, new
    soon = {name: _soon(np.minimum(opening[name], closing[name])) for name in opening}
    yield "topology", np.where(state["fate"] == "survived", 1.0, -1.0), soon, new


def _of_all(state: Columns, values: Floats, rows: NDArray[np.int64]) -> Floats:
    """Values of some loops, not numbers for the others."""
    every = np.full(len(state["order"]), np.nan)
    every[rows] = values
    return every


def _soon(time: Floats) -> Floats:
    """Positive where it happens within the interval."""
    return 1.0 / np.maximum(time, SOONEST) - 1.0
