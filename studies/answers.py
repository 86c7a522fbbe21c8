"""Answers of the front door about a sample, and tables and figures of every result."""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass
from functools import partial, singledispatch
from operator import attrgetter, methodcaller
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from loops import InputError, MacroTangent
from loops.lazy import named
from loops.scene import Subject
from loops.shown import Shown
from patterns import Snapshot, loop_of_snapshot
from patterns.snapshots.findings import SEVERITIES, Finding, crossings, worst_severity
from patterns.snapshots.snapshot import SnapshotLoop, snapshot_of
from stability import COMPONENTS, Path, PlaneCone, Regimes, Verdict
from stability.packing import PackingResponse, Probe, Sustained
from studies.evolve import Evolution
from studies.forecast import Forecast
from studies.output import Row
from studies.present_domain import LoopDomain
from studies.snapshot.fabric import Fabric
from studies.snapshot.stress import Stress


@dataclass(frozen=True, eq=False, repr=False)
class Check(Shown):
    """Findings of `check`: the worst of `SEVERITIES`, and a finding for each check."""

    verdict: str
    findings: tuple[Finding, ...]

    def facts(self) -> dict[str, object]:
        """Facts that the prompt and a notebook show."""
        wrong = [one for one in self.findings if one.severity != "ok"]
        counts: dict[str, object] = {
            str(name): sum(one.severity == name for one in self.findings) for name in SEVERITIES
        }
        said = {one.check: f"{one.severity}: {one.says}" for one in wrong}
        return {"verdict": self.verdict, **counts, **said}


def check(snapshot: Snapshot | Subject) -> Check:
    """Check a snapshot for consistency, as `grainloops check` does: signs, units, balance.

    Parameters
    ----------
    snapshot : Snapshot or Scene
        A file that fails is read with `read_snapshot(path, strict=False)`; of a scene only the
        crossings of its branches are checked.

    Returns
    -------
    Check
        `verdict` is 'ok', 'doubt' or 'error'; `.table()` has a row a check with what to do.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_path
    >>> check(read_snapshot(sample_path())).verdict
    'ok'
    """
    snapshot = snapshot_of(snapshot)
    findings = (*snapshot.findings, crossings(snapshot.graph))
    return Check(worst_severity(findings), findings)


def loop(snapshot: Snapshot | Subject, number: int) -> SnapshotLoop:
    """Take one loop out of a snapshot; every question about a scene takes it.

    Parameters
    ----------
    snapshot : Snapshot or Scene
        With a law.
    number : int
        Of the loop in the column `loop` of `loop_table`.

    Returns
    -------
    SnapshotLoop
        `graph`, `law`, `regime`, `ids` of its grains, `scene`.

    Raises
    ------
    InputError
        If there is no loop of that number.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_path
    >>> one = loop(read_snapshot(sample_path()), 62)
    >>> one.graph.grain_count == len(one.ids), one.scene.boundary.kind
    (True, 'free')
    """
    return loop_of_snapshot(snapshot_of(snapshot), number)


@singledispatch
def table_of(result: Any) -> pd.DataFrame:
    """Data frame of a result: its arrays of one length, a row an entry, else one row of facts."""
    values = (
        {one.name: getattr(result, one.name) for one in fields(result)}
        if is_dataclass(result)
        else {}
    )
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
    if array.ndim == 1:
        return {name: array}
    flat = array.reshape(len(array), -1)
    ends = COMPONENTS if array.shape[1:] == (2, 2) else [f"_{k}" for k in range(flat.shape[1])]
    return {f"{name}{end}": flat[:, k] for k, end in enumerate(ends)}


@table_of.register
def _(result: Check) -> pd.DataFrame:
    return pd.DataFrame([one._asdict() for one in result.findings])


@table_of.register
def _(result: Stress) -> pd.DataFrame:
    names = ("p", "p_error", "q", "q_error", "q_over_p", "q_over_p_error", "wall_share", "volume",
             "volume_is", "rattlers")  # fmt: skip
    tensor = {f"S{ij}": s for ij, s in zip(COMPONENTS, result.tensor.ravel(), strict=True)}
    return pd.DataFrame([{**tensor, **{name: getattr(result, name) for name in names}}])


@table_of.register
def _(result: Verdict) -> pd.DataFrame:
    names = ("status", "subspace", "lambda_min", "over_kn", "margin", "tolerance", "mode")
    return pd.DataFrame([{name: getattr(result, name) for name in names}])


@table_of.register
def _(result: PlaneCone) -> pd.DataFrame:
    rows = np.size(result.status)
    columns: dict[str, Any] = {}
    for one in fields(result):
        values = np.asarray(getattr(result, one.name))
        columns |= _columns(one.name, values.reshape(rows, -1) if values.size > rows else
                            values.reshape(rows))  # fmt: skip
    return pd.DataFrame(columns)


table_of.register(Evolution, methodcaller("loops"))
table_of.register(Fabric, methodcaller("columns"))
table_of.register(Forecast, attrgetter("loops"))
table_of.register(LoopDomain, attrgetter("rows"))


@table_of.register(Regimes)
@table_of.register(PackingResponse)
def _(result: Any) -> pd.DataFrame:
    row: Row = {"status": result.status}
    for name, rate in (("H", "strain_rate"), ("P", "stress_rate"), ("cauchy_", "cauchy_rate")):
        values = np.ravel(getattr(result, rate))
        row |= {f"{name}{ij}": value for ij, value in zip(COMPONENTS, values, strict=True)}
    return pd.DataFrame([row])


@singledispatch
def plot_of(result: Any, ax: Axes | None = None) -> Axes:
    """Axes with the figure of a result; `InputError` for one that has none."""
    kind = type(result).__name__
    remedy = "Draw its .table(), or see gl.plot."
    raise InputError(".plot()", kind, "a result with a figure", remedy)


@plot_of.register
def _(result: Fabric, ax: Axes | None = None) -> Axes:
    from studies.plots import plot_rose

    return plot_rose(result.snapshot, ax=ax)


def _ask(place: str, result: Any, **how: Any) -> Any:
    """Ask a function that is loaded when it is first needed."""
    return named(place)(result, **how)


for kind, place in (
    (Snapshot, "studies.frames.loop_table"),
    (Path, "studies.frames.path_table"),
    (Probe, "studies.probe.probe_table"),
    (Sustained, "studies.sustain.loading_table"),
):
    table_of.register(kind, partial(_ask, place))
for result, place in (
    (Evolution, "studies.plots.plot_evolved"),
    (Forecast, "studies.plots.plot_forecast"),
    (LoopDomain, "studies.plots.plot_domain"),
    (MacroTangent, "studies.plots.plot_cone"),
    (Path, "studies.plots.plot_path"),
    (Probe, "studies.plots.plot_envelope"),
    (Snapshot, "studies.plots.plot_map"),
    (SnapshotLoop, "studies.plots.plot_loop"),
):
    plot_of.register(result, partial(_ask, place))
