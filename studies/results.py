"""Tables and figures of results: `.table()` and `.plot()` of every kind."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from loops import InputError, MacroTangent
from loops.lazy import named
from stability import COMPONENTS, PlaneCone
from studies.output import Row

# Columns of the row of a rate problem.
RATES = "status H=strain_rate P=stress_rate cauchy_=cauchy_rate"
# By the class of a result: the function or attribute that is its table, or the attributes of the
# only row (tensors behind the beginning of their columns); and the function that draws it.
ANSWERS = {
    "Check": ("rows", ""),
    "Evolution": ("loops", "studies.packing_figures.draw_driven_stress"),
    "Fabric": ("columns", "studies.plots.plot_fabric"),
    "Forecast": ("loops", "studies.packing_figures.probability_map"),
    "GrainGraph": ("", "studies.plots.plot_loop"),
    "HeldPacking": ("", "studies.plots.plot_scene"),
    "LoopDomain": ("rows", "studies.plots.plot_domain"),
    "LoopSet": ("studies.material.averaged_loops", ""),
    "LoopStudy": ("closures", "studies.one_loop.draw_closures"),
    "MacroTangent": ("studies.results.tangent_rows", "studies.plots.plot_tangents"),
    "MaterialPath": ("studies.material.march_table", "studies.plots.plot_path"),
    "OrderKinetics": ("columns", ""),
    "PackingResponse": (RATES, ""),
    "Path": ("studies.frames.path_table", "studies.plots.plot_path"),
    "PlaneCone": ("studies.results.cone_rows", ""),
    "Probe": ("studies.probe.probe_table", "studies.plots.plot_envelope"),
    "Regimes": (RATES, ""),
    "Scene": ("studies.frames.loop_table", "studies.plots.plot_scene"),
    "Snapshot": ("studies.frames.loop_table", "studies.plots.plot_map"),
    "SnapshotLoop": ("", "studies.plots.plot_loop"),
    "Stress": (
        "S=tensor p p_error q q_error q_over_p q_over_p_error wall_share volume volume_is rattlers",
        "",
    ),
    "Sustained": ("studies.sustain.direction_table", "studies.packing_figures.limit_surface"),
    "Verdict": ("status subspace lambda_min over_kn margin tolerance mode", ""),
}


def _places(result: Any) -> tuple[str, str]:
    """Places of the table and of the figure of a result."""
    kinds = (kind.__name__ for kind in type(result).__mro__)
    return next((ANSWERS[kind] for kind in kinds if kind in ANSWERS), ("", ""))


def table_of(result: Any) -> Any:
    """Data frame of a result."""
    place, _ = _places(result)
    if "." in place:
        table = named(place)(result)
        return table if isinstance(table, pd.DataFrame) else pd.DataFrame(table)
    if " " in place:
        row: Row = {}
        for name in place.split():
            column, _, tensor = name.rpartition("=")
            value = getattr(result, tensor)
            row |= _columns(column, np.reshape(value, (1, 2, 2))) if column else {name: [value]}
        return pd.DataFrame(row)
    if place:
        own = getattr(result, place)
        return pd.DataFrame(own() if callable(own) else own)
    return _arrays(result)


def plot_of(result: Any, ax: Axes | None = None) -> Any:
    """Axes with the figure of a result; `InputError` for one that has none."""
    _, place = _places(result)
    if not place:
        kind, remedy = type(result).__name__, "Draw its .table(), or see gl.plot."
        raise InputError(".plot()", kind, "a result with a figure", remedy)
    draw = named(place)
    if hasattr(draw, "size"):  # a drawing of reports, here into pyplot's axes
        draw = named("studies.plots.drawn")(*draw.size)(draw)
    return draw(result, ax=ax)


def _arrays(result: Any) -> pd.DataFrame:
    """Arrays of a result that have one length, a row an entry; else one row of numbers and words.

    A tensor (2, 2) alone is an entry.
    """
    # Ids belong to the grains of a scene, not to its answer.
    names = (name for name in getattr(result, "__dataclass_fields__", ()) if name != "ids")
    values = {name: getattr(result, name) for name in names}
    arrays = {name: v for name, v in values.items() if isinstance(v, np.ndarray) and v.ndim}
    tensors = {name: v[None] for name, v in arrays.items() if v.shape == (2, 2)}
    lengths = [len(array) for name, array in arrays.items() if name not in tensors]
    rows = max(lengths, key=lambda length: (lengths.count(length), length), default=1)
    columns: dict[str, Any] = {}
    for name, array in (arrays if lengths else tensors).items():
        if len(array) == rows:
            columns |= _columns(name, array)
    if lengths:
        return pd.DataFrame(columns)
    plain = {name: v for name, v in values.items() if isinstance(v, str | int | float)}
    return pd.DataFrame(plain | columns, index=[0]) if plain else pd.DataFrame([result.facts()])


def _columns(name: str, array: Any) -> dict[str, Any]:
    """Columns of an array (rows, ...): components of tensors by their indices."""
    flat = array.reshape(len(array), -1)
    if flat.shape[1] == 1:
        return {name: flat[:, 0]}
    return {f"{name}{end}": flat[:, k] for k, end in enumerate(_ends(array.shape[1:]))}


def _ends(shape: tuple[int, ...]) -> list[str]:
    """Ends of the names of components: of tensors, of operators on them, numbers of others."""
    if shape == (2, 2):
        return [*COMPONENTS]
    if shape == (4, 4):
        return [f"{row}_{column}" for row in COMPONENTS for column in COMPONENTS]
    return [f"_{k}" for k in range(int(np.prod(shape)))]


def tangent_rows(result: MacroTangent) -> pd.DataFrame:
    """A row a tangent: the operator, its stated error."""
    rows = result.matrix.reshape(-1, 4, 4)
    named = ("error", "condition", "sensitivity", "volume", "trusted")
    columns = {name: np.ravel(getattr(result, name)) for name in named}
    return pd.DataFrame(_columns("A", rows) | columns)


def cone_rows(result: PlaneCone) -> pd.DataFrame:
    """A row a cone."""
    columns: dict[str, Any] = {}
    for one in fields(result):
        rows = np.reshape(getattr(result, one.name), (np.size(result.status), -1))
        columns |= _columns(one.name, rows)
    return pd.DataFrame(columns)
