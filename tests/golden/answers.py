"""What the commands answer in small runs, as plain values that JSON holds."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from patterns import Snapshot, sample_cell, sample_path, write_snapshot
from tests.command import run as run_command
from tests.packings import LAW, jammed
from tests.unsaved import leave_files_empty

# Rows kept of a long table: evenly spread, with the first and the last.
ROWS = 9
# Measured by a clock, or words for a reader: a run may change them.
LEFT_OUT = {
    *("definitions", "notes", "version", "signs", "units", "python", "numpy", "processor", "cores"),
    *("seconds_per_item", "peak_bytes", "knee", "path", "paths", "name", "source", "seconds"),
    # Rounding of a state at rest.
    *("spread_seconds", "unbalanced", "unbalanced_before", "forces_changed"),
}
# Free spins of an affine loop: of its gear modes rounding decides which are told from nothing, by
# processor two loops more or less. Exact arithmetic holds the closure, the series its columns.
ROUNDED = "affine_free"
KEPT = "id1 id2 fn fsx fsy kn ks mu sliding".split()
PERIODIC = ",".join(repr(float(value)) for value in sample_cell().ravel())


def run(folder: Path, *arguments: object) -> Path:
    """Result folder of a command, its figures empty files."""
    out = folder / "out"
    with pytest.MonkeyPatch.context() as patch:
        leave_files_empty(patch)
        status = run_command(*arguments, "--out", out)
    if status != 0:
        raise RuntimeError(f"{arguments}: exit status {status}")
    return out


def command(folder: Path, *arguments: object) -> dict[str, Any]:
    """Answer of a command: its summary, its tables and the names of its files."""
    return answer(run(folder, *arguments))


def answer(out: Path) -> dict[str, Any]:
    """Summary, tables and files of a result folder."""
    names = sorted(str(p.relative_to(out)) for p in out.rglob("*") if p.is_file())
    tables = {
        name.removesuffix(".parquet"): table(known(pd.read_parquet(out / name)))
        for name in names
        if name.endswith(".parquet") and not name.startswith(".")
    }
    summary = json.loads((out / "summary.json").read_text())
    summary.get("skill", {}).pop(ROUNDED, None)
    if "path" in tables and "rows" not in tables["path"]:
        # As many as the integrator took steps.
        summary.pop("rows", None)
    files = [name for name in names if not Path(name).name.startswith(".")]
    return {"files": files, "summary": plain(summary), "tables": tables}


def known(frame: pd.DataFrame) -> pd.DataFrame:
    """A table without what turns on rounding."""
    if "predictor" in frame:
        frame = frame[frame["predictor"] != ROUNDED]
    return frame[[name for name in frame if ROUNDED not in str(name)]]


def table(frame: pd.DataFrame) -> dict[str, Any]:
    """Some rows of each column; of all of them the scale, by which numbers are compared.

    The rows of a polygon's path are the steps of the integrator, which a change of rounding moves:
    of these only the ends of its stages are kept.
    """
    columns_found = set(frame.columns)
    by_steps = {"stage", "parameter"} <= columns_found or {"order", "lambda_min"} <= columns_found
    count = len(frame)
    kept = sorted({round(k) for k in np.linspace(0, count - 1, min(ROWS, count))})
    if by_steps:
        piece = frame["stage" if "stage" in frame else "order"].to_numpy()
        kept = sorted({0, *np.flatnonzero(piece[1:] != piece[:-1]).tolist(), count - 1})
    columns = {
        str(name): {"type": kind(frame[name]), **column(frame[name], kept, sums=not by_steps)}
        for name in frame.columns
        if name not in LEFT_OUT
    }
    return {"columns": columns} | ({} if by_steps else {"rows": count})


def column(values: pd.Series, kept: list[int], *, sums: bool) -> dict[str, Any]:
    found: dict[str, Any] = {"values": plain(values.iloc[kept].tolist())}
    if not sums:
        return found
    if values.dtype.kind == "f":
        finite = values[np.isfinite(values)]
        found |= {"scale": float(finite.abs().max()) if len(finite) else 0.0}
        found |= {"finite": len(finite), "sum": math.fsum(finite)}
    elif values.dtype.kind in "iub":
        found |= {"sum": int(values.sum())}
    return found


def kind(values: pd.Series) -> str:
    """`float`, `integer`, `flag`, `text` or `list`, whatever the file's own type."""
    named = {"f": "float", "i": "integer", "u": "integer", "b": "flag"}.get(values.dtype.kind)
    if named or not len(values):
        return named or "text"
    return "text" if isinstance(values.iloc[0], str) else "list"


def plain(value: Any) -> Any:
    """Values that JSON holds, without what a run may change; numbers not finite become text."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items() if k not in LEFT_OUT}
    if isinstance(value, list | tuple | np.ndarray):
        return [plain(one) for one in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value


def write_series(folder: Path, count: int) -> list[Path]:
    """Snapshots made of the sample: compressed a little more each, with contacts lost."""
    grains = pd.read_csv(sample_path())[["id", "type", "x", "y", "radius"]]
    contacts = pd.read_csv(sample_path("contacts_biaxial.csv.gz"))[KEPT]
    order = np.random.default_rng(5).permutation(len(contacts))
    paths = []
    for k in range(count):
        moved = grains.assign(x=grains.x * (1 + 0.001 * k), y=grains.y * (1 - 0.002 * k))
        paths.append(folder / f"grains_{k:02d}.csv")
        moved.to_csv(paths[-1], index=False)
        left = contacts.iloc[np.sort(order[15 * k :])]
        left.to_csv(folder / f"contacts_{k:02d}.csv", index=False)
    return paths


def series(folder: Path) -> dict[str, Any]:
    return command(folder, "series", *write_series(folder, 3), "--workers", 1)


def write_packing(folder: Path) -> list[Path]:
    """A jammed packing of 24 grains, and the same strained a little."""
    graph, paths = jammed(24, 3, LAW), [folder / f"grains_{k}.parquet" for k in (0, 1)]
    for path, stretch in zip(paths, ([1.0, 1.0], [1.0005, 0.999]), strict=True):
        cell = graph.cell * np.array(stretch)[:, None]
        moved = graph.replace(x=graph.x * stretch, cell=cell)
        regime = np.ones(graph.contact_count, dtype=np.int8)
        write_snapshot(path, Snapshot(moved, LAW, regime, np.arange(24) + 7, 0, ()))
    return paths


def of_packing(name: str, *arguments: object, files: int = 1) -> Callable[[Path], dict[str, Any]]:
    return lambda folder: command(folder, name, *write_packing(folder)[:files], *arguments)


def on(*arguments: object) -> Callable[[Path], dict[str, Any]]:
    return lambda folder: command(folder, *arguments)


def sample(name: str) -> Path:
    return Path(sample_path(name))


BENCH = "directions,hard-cases"
FOLLOWED = ("--rows", 4, "--interval", 1e-4, "--inertial-number", 1e-4)
OWN = ("--alpha0", 60, "--kappa", 0.3, "--phi", 10, "--confine", 0.05)
CASES: dict[str, Callable[[Path], dict[str, Any]]] = {
    "diamond-table1": on("diamond", "--table", 1),
    "diamond-table2": on("diamond", "--table", 2),
    "diamond-table2-add": on("diamond", "--table", 2, "--contact-on-touch", "add"),
    "diamond-own-stop": on("diamond", *OWN, "--contact-on-touch", "stop"),
    "diamond-own-traction": on("diamond", *OWN, "--closure", "traction"),
    "diamond-table1-full": on("diamond", "--table", 1, "--model", "full"),
    "polygon-5": on("polygon", "--order", 5),
    "polygon-6-edge-free": on(
        *("polygon", "--order", 6, "--orientation", "edge", "--spins", "free"),
        *("--closure", "traction"),
    ),
    "polygon-4-oedometric": on("polygon", "--order", 4, "--programme", "oedometric"),
    "polygon-compare": on("polygon", "--compare", "3-5"),
    "domain": on("domain", "--directions", 91, "--alpha0", "45,60"),
    "snapshot-periodic": on(
        "snapshot", sample("grains_periodic.parquet"), "--cell", PERIODIC, "--no-figures"
    ),
    "snapshot-biaxial": on("snapshot", sample("grains_biaxial.csv.gz")),
    "series": series,
    "check": on("check", sample("grains_biaxial.csv.gz")),
    "probe": of_packing("probe", "--directions", 12),
    "sustain": of_packing(
        *("sustain", "--directions", 3, "--largest", 5e-4, "--interval", 1e-4, "--no-spread"),
        *("--workers", 1),
    ),
    "evolve": of_packing(
        *("evolve", "--programme", "drained", "--axis", 2, "--to", 1e-3, "--by", "both"),
        *(*FOLLOWED, "--pathologies"),
        files=2,
    ),
    "forecast": of_packing("forecast", "--programme", "oedometric", "--to", -2e-3, *FOLLOWED),
    "material": on("material", "--orientations", 6, "--steps", 20),
    "material-packing": of_packing("material", "--programme", "oedometric", "--steps", 5),
    "bench": on("bench", "--quick", "--only", BENCH),
    "bench-all-hard-cases": on("bench", "--only", "closures,hard-cases"),
}
# Too long for every run: `pytest -m slow tests/golden`.
SLOW = {
    *(
        "bench-all-hard-cases",
        "diamond-own-traction",
        "diamond-table1-full",
    ),
    *("diamond-table2", "polygon-4-oedometric", "polygon-6-edge-free", "polygon-compare"),
}
