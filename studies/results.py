"""Tables and figures of results: `.table()` and `.plot()` of every kind."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from loops import InputError
from loops.lazy import named
from stability import COMPONENTS, PlaneCone, Verdict
from studies.output import Row
from studies.snapshot.stress import Stress

# By the class of a result: the function or the attribute that is its table, and the function that
# draws it.
ANSWERS = {
    "Check": ("rows", ""),
    "Evolution": ("loops", "studies.plots.plot_evolved"),
    "Fabric": ("columns", "studies.plots.plot_fabric"),
    "Forecast": ("loops", "studies.plots.plot_forecast"),
    "LoopDomain": ("rows", "studies.plots.plot_domain"),
    "MacroTangent": ("", "studies.plots.plot_cone"),
    "PackingResponse": ("studies.results.rate_row", ""),
    "Path": ("studies.frames.path_table", "studies.plots.plot_path"),
    "PlaneCone": ("studies.results.cone_rows", ""),
    "Probe": ("studies.probe.probe_table", "studies.plots.plot_envelope"),
    "Regimes": ("studies.results.rate_row", ""),
    "Snapshot": ("studies.frames.loop_table", "studies.plots.plot_map"),
    "SnapshotLoop": ("", "studies.plots.plot_loop"),
    "Stress": ("studies.results.stress_row", ""),
    "Sustained": ("studies.sustain.loading_table", ""),
    "Verdict": ("studies.results.verdict_row", ""),
}


def _places(result: Any) -> tuple[str, str]:
    """Places of the table and of the figure of a result."""
    kinds = (kind.__name__ for kind in type(result).__mro__)
    return next((ANSWERS[kind] for kind in kinds if kind in ANSWERS), ("", ""))


def table_of(result: Any) -> Any:
    """Data frame of a result."""
    place, _ = _places(result)
    if "." in place:
        return named(place)(result)
    if place:
        own = getattr(result, place)
        return own() if callable(own) else own
    return _arrays(result)


def plot_of(result: Any, ax: Axes | None = None) -> Any:
    """Axes with the figure of a result; `InputError` for one that has none."""
    _, place = _places(result)
    if not place:
        kind, remedy = type(result).__name__, "Draw its .table(), or see gl.plot."
        raise InputError(".plot()", kind, "a result with a figure", remedy)
    return named(place)(result, ax=ax)


def _arrays(result: Any) -> pd.DataFrame:
    """Arrays of a result that have one length, a row an entry; else one row of facts."""
    names = getattr(result, "__dataclass_fields__", ())
    values = {name: getattr(result, name) for name in names}
    arrays = {name: v for name, v in values.items() if isinstance(v, np.ndarray) and v.ndim}
    lengths = [len(array) for array in arrays.values()]
    if not lengths:
        return pd.DataFrame([result.facts()])
    rows = max(lengths, key=lambda length: (lengths.count(length), length))
    columns: dict[str, Any] = {}
    for name, array in arrays.items():
        if len(array) == rows:
            columns |= _columns(name, array)
    return pd.DataFrame(columns)


def _columns(name: str, array: Any) -> dict[str, Any]:
    """Columns of an array (rows, ...): components of tensors by their indices."""
    flat = array.reshape(len(array), -1)
    if flat.shape[1] == 1:
        return {name: flat[:, 0]}
    ends = COMPONENTS if array.shape[1:] == (2, 2) else [f"_{k}" for k in range(flat.shape[1])]
    return {f"{name}{end}": flat[:, k] for k, end in enumerate(ends)}


def stress_row(result: Stress) -> pd.DataFrame:
    """Stress of a sample in one row."""
    names = ("p", "p_error", "q", "q_error", "q_over_p", "q_over_p_error", "wall_share", "volume",
             "volume_is", "rattlers")  # fmt: skip
    tensor = {f"S{ij}": s for ij, s in zip(COMPONENTS, result.tensor.ravel(), strict=True)}
    return pd.DataFrame([{**tensor, **{name: getattr(result, name) for name in names}}])


def verdict_row(result: Verdict) -> pd.DataFrame:
    """Verdict in one row."""
    names = ("status", "subspace", "lambda_min", "over_kn", "margin", "tolerance", "mode")
    return pd.DataFrame([{name: getattr(result, name) for name in names}])


def cone_rows(result: PlaneCone) -> pd.DataFrame:
    """A row a cone."""
    columns: dict[str, Any] = {}
    for one in fields(result):
        rows = np.reshape(getattr(result, one.name), (np.size(result.status), -1))
        columns |= _columns(one.name, rows)
    return pd.DataFrame(columns)


def rate_row(result: Any) -> pd.DataFrame:
    """Status and rates of a rate problem in one row."""
    row: Row = {"status": result.status}
    for name, rate in (("H", "strain_rate"), ("P", "stress_rate"), ("cauchy_", "cauchy_rate")):
        values = np.ravel(getattr(result, rate))
        row |= {f"{name}{ij}": value for ij, value in zip(COMPONENTS, values, strict=True)}
    return pd.DataFrame([row])
